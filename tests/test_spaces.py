"""Every convention of docs/conventions.md, pinned by a known point at a known place.

Most scenes are rectangles whose edges lie on texel edges, under suns along an axis: there the
light's axes are world axes (docs/numerics.md 6), so every expectation is counted in whole texels or
pixels.
"""

import numpy as np
import pytest

import csm
from csm import _core, spaces

OVERHEAD = csm.Sun((0, 1, 0))


def rectangles(*parts):
    """A scene of horizontal rectangles (x0, x1, y, z0, z1)."""
    positions, triangles = [], []
    for x0, x1, y, z0, z1 in parts:
        first = len(positions)
        positions += [(x0, y, z0), (x0, y, z1), (x1, y, z1), (x1, y, z0)]
        triangles += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return csm.Scene.from_arrays(positions, triangles)


def map_camera(y=3.0, height=16.0, size=(64, 64)):
    """Straight down from under any caster above y: north (-z) on top of the picture, east right."""
    return csm.Camera.orthographic(
        (0, y, 0), (0, 0, 0), up=(0, 0, -1), height=height, near=0.125, far=20, size=size
    )


def pixel_centres(camera):
    """World x of every column and world z of every row of `map_camera`."""
    width, height = camera.size
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * camera.half_width
    z = ((np.arange(height) + 0.5) / height * 2 - 1) * camera.half_height
    return x, z


# -- world, view, clip -----------------------------------------------------------------------------


def test_view_looks_down_minus_z_with_x_right_and_y_up():
    camera = csm.Camera.look_at((0, 0, 5), (0, 0, 0))
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    expected = [(0, 0, -5), (1, 0, -5), (0, 1, -5), (0, 0, -4)]
    assert np.array_equal(spaces.transform_points(camera.view_from_world, points), expected)
    assert np.linalg.det(camera.view_from_world) == 1.0  # right-handed


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_clip_is_minus_one_to_one_in_xy_and_zero_to_one_in_z(kind):
    make = csm.Camera.look_at if kind == "perspective" else csm.Camera.orthographic
    camera = make((1, 2, 3), (-4, 0, 2), near=0.5, far=40.0, size=(32, 18))
    corners = _core.frustum_corners(camera, camera.near, camera.far)
    clip = spaces.transform_points(camera.clip_from_view @ camera.view_from_world, corners)
    # LBN LTN RTN RBN, then the same at far; rounding of a few products of numbers below 100
    expected = [(x, y, z) for z in (0, 1) for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    np.testing.assert_allclose(clip, expected, atol=1e-12)
    planes = _core.frustum_planes(camera, camera.near, camera.far)
    middle = corners.mean(axis=0)
    assert (planes[:, :3] @ middle + planes[:, 3] > 0).all()
    assert np.argmin(np.abs(planes[:, :3] @ corners[0] + planes[:, 3])) in (0, 2, 4)
    outwards = [-camera.right, camera.right, -camera.up, camera.up, camera.backward]
    for plane, side in zip(planes, [*outwards, -camera.backward], strict=True):
        assert plane[:3] @ side < 0  # left, right, bottom, top, near, far, normals inwards


def test_matrices_of_the_core_and_of_numpy_agree():
    camera = csm.Camera.look_at((7, 3, -2), (1, 0.5, 9), fov_y_deg=37, size=(640, 360))
    view_from_world, clip_from_view = _core.camera_matrices(camera)
    # the same formulas in double: a few roundings of numbers of the order of 10
    np.testing.assert_allclose(view_from_world, camera.view_from_world, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(clip_from_view, camera.clip_from_view, rtol=1e-14, atol=1e-14)


def test_view_depth_is_metres_along_the_view_axis_not_along_the_ray(renderer):
    wall = csm.Scene.from_arrays(
        [(-9, -9, -6), (9, -9, -6), (9, 9, -6), (-9, 9, -6)], [(0, 1, 2), (0, 2, 3)]
    )
    camera = csm.Camera.look_at((0, 0, 2), (0, 0, 0), fov_y_deg=90, far=50, size=(16, 16))
    frame = renderer.render(wall, camera, csm.Sun((0, 0, 1)), outputs=("view_depth", "valid"))
    assert frame.valid.all()
    # 8 m everywhere, in the corners too; float32
    np.testing.assert_allclose(frame.view_depth, 8.0, rtol=4 * 2.0**-24)


# -- images ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("place", "rows", "columns"),
    [((3.0, 3.0), slice(0, 8), slice(8, 16)), ((-3.0, -3.0), slice(8, 16), slice(0, 8))],
    ids=["up and right", "down and left"],
)
def test_row_0_of_an_image_is_its_top(renderer, place, rows, columns):
    x, y = place
    corners = [(x - 1, y - 1, 0), (x + 1, y - 1, 0), (x + 1, y + 1, 0), (x - 1, y + 1, 0)]
    scene = csm.Scene.from_arrays(corners, [(0, 1, 2), (0, 2, 3)])
    camera = csm.Camera.orthographic((0, 0, 5), (0, 0, 0), height=16, far=9, size=(16, 16))
    frame = renderer.render(scene, camera, csm.Sun((0, 0, 1)), outputs=("valid",))
    expected = np.zeros((16, 16), bool)
    row, column = int(8 - y), int(8 + x)
    expected[row - 1 : row + 1, column - 1 : column + 1] = True  # a pixel is a metre
    assert expected[rows, columns].sum() == 4
    assert np.array_equal(frame.valid, expected)


def test_a_pixel_is_sampled_at_its_centre(renderer, evidence):
    # A slope x = depth seen head-on by parallel rays: the depth in column i is that of its centre.
    scene = csm.Scene.from_arrays(
        [(-8, -8, -8), (8, -8, -24), (8, 8, -24), (-8, 8, -8)], [(0, 1, 2), (0, 2, 3)]
    )
    camera = csm.Camera.orthographic((0, 0, 0), (0, 0, -1), height=8, far=50, size=(8, 8))
    frame = renderer.render(scene, camera, csm.Sun((0, 0, 1)), outputs=("view_depth",))
    expected = np.broadcast_to(16.0 + np.arange(8) - 3.5, (8, 8))
    evidence(rendered=frame.view_depth, reference=expected)
    np.testing.assert_allclose(frame.view_depth, expected, rtol=1e-6)  # float32 planes


# -- sun and light ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sun", "to_light"),
    [
        (csm.Sun.from_angles(0, 0), (0, 0, 1)),
        (csm.Sun.from_angles(90, 0), (1, 0, 0)),
        (csm.Sun.from_angles(180, 0), (0, 0, -1)),
        (csm.Sun.from_angles(33, 90), (0, 1, 0)),
        (csm.Sun.from_angles(90, 45), (0.5**0.5, 0.5**0.5, 0)),
        (csm.Sun.from_compass(0, 0), (0, 0, -1)),
        (csm.Sun.from_compass(90, 0), (1, 0, 0)),
        (csm.Sun.from_compass(180, 0), (0, 0, 1)),
        (csm.Sun.from_compass(270, 45), (-(0.5**0.5), 0.5**0.5, 0)),
        (csm.Sun((3, 0, 4)), (0.6, 0, 0.8)),
    ],
    ids=["0", "90", "180", "zenith", "45 high", "north", "east", "south", "west", "vector"],
)
def test_to_light_points_from_the_surface_to_the_sun(sun, to_light):
    np.testing.assert_allclose(sun.to_light, to_light, atol=2.0**-52)


def test_elevation_and_azimuth_formula():
    azimuth, elevation = np.radians(200.0), np.radians(25.0)
    expected = (
        np.cos(elevation) * np.sin(azimuth),
        np.sin(elevation),
        np.cos(elevation) * np.cos(azimuth),
    )
    np.testing.assert_allclose(csm.Sun.from_angles(200, 25).to_light, expected, atol=4e-16)


@pytest.fixture(scope="module")
def walk():
    """Cascades of an oblique camera and sun, to look at as matrices."""
    scene = rectangles((-30, 40, 0, -50, 20), (2, 4, 6, -9, -7))
    camera = csm.Camera.look_at((5, 4, 9), (-3, 0, -20), far=200, size=(160, 90))
    return scene, camera, csm.Sun.from_angles(-70, 35)


def test_light_from_world_is_a_rotation_about_the_world_origin_with_z_to_the_sun(walk):
    scene, camera, sun = walk
    light_from_world = csm.fit_cascades(camera, sun, csm.ShadowSettings(), scene=scene)
    for matrix in light_from_world.light_from_world:
        assert np.array_equal(matrix[:, 3], (0, 0, 0, 1))
        assert np.array_equal(matrix[3], (0, 0, 0, 1))
        rotation = matrix[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15 * 4)
        assert np.linalg.det(rotation) > 0  # right-handed
        np.testing.assert_allclose(rotation[2], sun.to_light, atol=2.0**-52)


def test_light_axes_do_not_depend_on_the_camera(walk):
    scene, camera, sun = walk
    turned = csm.Camera.look_at((-7, 30, 2), (4, 0, 9), up=(1, 0, 0), far=90, size=(31, 77))
    settings = csm.ShadowSettings()
    first, second = (csm.fit_cascades(c, sun, settings, scene=scene) for c in (camera, turned))
    assert np.array_equal(first.light_from_world, second.light_from_world)


def test_matrices_are_column_major_to_c_and_row_column_to_numpy(walk):
    scene, camera, sun = walk
    cascades = csm.fit_cascades(camera, sun, csm.ShadowSettings(), scene=scene)
    uvz_from_clip = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]])
    point = np.array([1.5, -2.0, 3.25, 1.0])
    for name in ("light_from_world", "clip_from_light", "clip_from_world", "uvz_from_world"):
        stack = getattr(cascades, name)
        assert stack.shape == (4, 4, 4)
        assert stack.strides == (128, 8, 32), name
    for i in range(4):
        light = cascades.light_from_world[i] @ point
        clip = cascades.clip_from_world[i] @ point
        # inner names cancel, vectors are columns; numbers of the order of 100 in double
        np.testing.assert_allclose(cascades.clip_from_light[i] @ light, clip, atol=1e-12)
        np.testing.assert_allclose(uvz_from_clip @ clip, cascades.uvz_from_world[i] @ point)


@pytest.mark.parametrize("map_size", [256, 255], ids=["even", "odd"])
def test_lower_corner_of_a_snapped_window_is_lattice_times_texel_size(walk, map_size):
    scene, camera, sun = walk
    settings = csm.ShadowSettings(map_size=map_size)
    cascades = csm.fit_cascades(camera, sun, settings, scene=scene)
    assert np.any(cascades.lattice)
    for i in range(4):
        corner = [*(cascades.lattice[i] * cascades.texel_size[i]), 0, 1]
        opposite = [*((cascades.lattice[i] + map_size) * cascades.texel_size[i]), 0, 1]
        for point, expected in ((corner, -1.0), (opposite, 1.0)):
            clip = cascades.clip_from_light[i] @ point
            np.testing.assert_allclose(clip[:2], expected, atol=1e-12)
    free = csm.fit_cascades(camera, sun, settings.replace(snap="none"), scene=scene)
    assert not free.lattice.any()


def test_depth_is_minus_light_z_and_0_at_the_caster_side(walk):
    scene, camera, sun = walk
    cascades = csm.fit_cascades(camera, sun, csm.ShadowSettings(), scene=scene)
    for i, (near, far) in enumerate(cascades.depth_range):
        assert near < far
        z = [(cascades.clip_from_light[i] @ (0, 0, -depth, 1))[2] for depth in (near, far)]
        np.testing.assert_allclose(z, (0, 1), atol=1e-12)
        higher, lower = (
            (cascades.clip_from_world[i] @ (*(height * sun.to_light), 1))[2] for height in (5, 0)
        )
        assert higher < lower


# -- shadow maps -----------------------------------------------------------------------------------


def test_a_known_point_lands_on_a_known_texel(renderer, evidence):
    """Two rectangles of whole texels over a ground: the map is what one paints by hand.

    Under the overhead sun light x = world x and light y = -world z (docs/numerics.md 6), so the
    texel of a point is (-z / t - lattice_y, x / t - lattice_x) as [v, u].
    """
    ground = (-12.0, 12.0, 0.0, -12.0, 12.0)
    camera = csm.Camera.look_at((0, 2, 6), (0, 0, 0), far=40, size=(64, 36))
    settings = csm.ShadowSettings(cascade_count=2, map_size=64, cull="none")

    # the fit does not depend on small casters inside the bounds of ground and mast
    mast = (11.5, 11.75, 4.0, 11.5, 11.75)
    empty = rectangles(ground, mast)
    cascades = csm.fit_cascades(camera, OVERHEAD, settings, scene=empty)
    t = cascades.texel_size[0]
    lattice = cascades.lattice[0]
    assert np.array_equal(cascades.light_from_world[0][:2, :3], [[1, 0, 0], [0, 0, -1]])
    texels = {"low": (20, 24, 1.0, 30, 33), "high": (40, 41, 3.0, 9, 10)}  # u0 u1 height v0 v1
    casters = [
        (
            (lattice[0] + u0) * t[0],
            (lattice[0] + u1) * t[0],
            height,
            -(lattice[1] + v1) * t[1],
            -(lattice[1] + v0) * t[1],
        )
        for u0, u1, height, v0, v1 in texels.values()
    ]
    frame = renderer.render(rectangles(ground, mast, *casters), camera, OVERHEAD, settings)
    assert np.array_equal(frame.cascades.clip_from_world, cascades.clip_from_world)

    near, far = cascades.depth_range[0]
    u, v = np.meshgrid(lattice[0] + np.arange(64) + 0.5, lattice[1] + np.arange(64) + 0.5)
    inside = (np.abs(u * t[0]) < 12) & (np.abs(v * t[1]) < 12)
    expected = np.where(inside, (0.0 - near) / (far - near), 1.0)
    for u0, u1, height, v0, v1 in texels.values():
        expected[v0:v1, u0:u1] = (-height - near) / (far - near)
    evidence(rendered=frame.shadow_maps[0], reference=expected, settings=settings)
    assert expected[0, 0] != expected[31, 22] != expected[9, 40]
    # float32 depth of float32 positions: some ulp of 1; the heights are 0.1 and more apart
    np.testing.assert_allclose(frame.shadow_maps[0], expected, atol=8 * 2.0**-24)


def test_empty_texels_are_1(renderer):
    scene = rectangles((-6, 6, 0, -6, 6))
    camera = csm.Camera.look_at((0, 2, 6), (0, 0, 0), far=40, size=(64, 36))
    settings = csm.ShadowSettings(cascade_count=1, map_size=64, view_range="camera")
    frame = renderer.render(scene, camera, OVERHEAD, settings, outputs=("shadow_maps",))
    assert frame.shadow_maps.shape == (1, 64, 64)
    drawn = frame.shadow_maps[0] < 1
    side = 12 / frame.cascades.texel_size[0]  # in texels; whole texels differ by one at most
    assert (np.abs(np.sqrt(drawn.sum()) - side) <= 1).all()
    assert drawn.sum() < 0.1 * drawn.size


# -- shadows ---------------------------------------------------------------------------------------


def shadow_of_a_slab(renderer, sun, height=4.0):
    """Mask of a ground below a slab of x and z from -1 to 1, seen from between the two."""
    scene = rectangles((-12, 12, 0, -12, 12), (-1, 1, height, -1, 1))
    camera = map_camera()
    settings = csm.ShadowSettings(map_size=512)
    frame = renderer.render(scene, camera, sun, settings)
    assert frame.valid.all()
    np.testing.assert_allclose(frame.view_depth, 3.0, rtol=1e-6)
    return frame, camera


@pytest.mark.parametrize(
    ("sun", "shift"),
    [
        (OVERHEAD, (0, 0)),
        (csm.Sun.from_angles(0, 90), (0, 0)),
        (csm.Sun.from_angles(90, 45), (-4, 0)),
        (csm.Sun.from_compass(90, 45), (-4, 0)),
        (csm.Sun.from_compass(180, 45), (0, -4)),
        (csm.Sun.from_angles(0, 45), (0, -4)),
        (csm.Sun.from_compass(0, 45), (0, 4)),
    ],
    ids=["overhead", "90 degrees", "from +x", "from east", "from south", "from +z", "from north"],
)
def test_a_shadow_lies_opposite_the_sun(renderer, evidence, sun, shift):
    """Straight under the slab with the sun overhead, height / tan(elevation) away otherwise."""
    frame, camera = shadow_of_a_slab(renderer, sun)
    x, z = pixel_centres(camera)
    inside_x, inside_z = np.abs(x - shift[0]) < 1, np.abs(z - shift[1]) < 1
    expected = 1.0 - (inside_z[:, None] & inside_x[None, :])  # 1 is lit
    evidence(rendered=frame.mask, reference=expected, settings=frame.settings)
    assert (expected == 0).sum() == 8 * 8
    # pixels are 0.25 m with centres 0.125 m from the shadow's edge; texels stay below half of that
    assert frame.cascades.texel_size.max() * 2**0.5 < 0.125
    assert np.array_equal(frame.mask, expected)


def test_mask_is_1_where_nothing_is_seen_and_depth_is_inf(renderer):
    camera = map_camera(height=32.0)
    frame = renderer.render(
        rectangles((-8, 8, 0, -8, 8)), camera, OVERHEAD, csm.ShadowSettings(map_size=128),
        outputs=("mask", "valid", "view_depth", "cascade_index", "normal"),
    )  # fmt: skip
    x, z = pixel_centres(camera)
    seen = (np.abs(z) < 8)[:, None] & (np.abs(x) < 8)[None, :]
    assert np.array_equal(frame.valid, seen)
    assert (frame.mask[~seen] == 1).all()
    assert np.isposinf(frame.view_depth[~seen]).all()
    assert (frame.cascade_index[~seen] == 255).all()
    assert (frame.normal[~seen] == 0).all()
    assert (frame.mask[seen] == 1).all()
    assert (frame.cascade_index[seen] < 4).all()


@pytest.mark.parametrize("winding", [1, -1], ids=["front", "back"])
@pytest.mark.parametrize("filter_", ["hard", "pcf", "none"])
def test_surfaces_are_two_sided_and_dark_when_turned_from_the_sun(renderer, winding, filter_):
    floor = [(-5, 0, -5), (-5, 0, 5), (5, 0, 5), (5, 0, -5)]
    triangles = np.array([(0, 1, 2), (0, 2, 3)])[:, ::winding]
    scene = csm.Scene.from_arrays(floor, triangles)
    settings = csm.ShadowSettings(filter=filter_, map_size=64)
    for side, lit in ((1.0, 1.0), (-1.0, 0.0)):
        camera = csm.Camera.orthographic(
            (0, 3 * side, 0), (0, 0, 0), up=(0, 0, -1), height=4, far=9, size=(8, 8)
        )
        frame = renderer.render(scene, camera, OVERHEAD, settings, outputs=("mask", "normal"))
        np.testing.assert_allclose(frame.normal, np.broadcast_to((0, side, 0), (8, 8, 3)))
        assert (frame.mask == lit).all()


@pytest.mark.parametrize(("cosine", "lit"), [(-1e-3, 0.0), (0.0, 0.0), (9e-6, 0.0), (1.1e-5, 1.0)])
def test_a_surface_faces_the_sun_beyond_a_cosine_of_1e_5(renderer, cosine, lit):
    wall = [(0, -5, -5), (0, -5, 5), (0, 5, 5), (0, 5, -5)]
    scene = csm.Scene.from_arrays(wall, [(0, 1, 2), (0, 2, 3)])
    camera = csm.Camera.orthographic((3, 0, 0), (0, 0, 0), height=4, far=9, size=(8, 8))
    settings = csm.ShadowSettings(filter="none")
    frame = renderer.render(scene, camera, csm.Sun((cosine, 1, 0)), settings, outputs=("mask",))
    assert (frame.mask == lit).all()


def test_index_is_0_in_the_nearest_cascade_and_grows_with_depth(renderer):
    scene = rectangles((-60, 60, 0, -100, 60))
    camera = csm.Camera.look_at((0, 2, 50), (0, 0, 30), near=0.5, far=150, size=(32, 64))
    settings = csm.ShadowSettings(cascade_count=4, map_size=128, select="interval")
    frame = renderer.render(scene, camera, OVERHEAD, settings)
    inner = frame.cascades.splits[1:-1]
    seen = frame.valid
    # a split is rounded to float32 on its way, depths have its error: leave those pixels out
    gap = np.abs(frame.view_depth[seen, None] / inner - 1).min(axis=1) > 1e-5
    expected = np.searchsorted(inner, frame.view_depth[seen])
    assert np.array_equal(frame.cascade_index[seen][gap], expected[gap])
    assert set(expected[gap].tolist()) == {0, 1, 2, 3}


def test_index_is_255_and_light_is_1_beyond_the_shadow_range(renderer):
    scene = rectangles((-12, 12, 0, -12, 12), (-5, 5, 2, -5, 5))
    camera = csm.Camera.look_at((0, 4, 8), (0, 0, 0), near=0.5, far=100, size=(16, 9))
    settings = csm.ShadowSettings(map_size=128)
    end = csm.fit_cascades(camera, OVERHEAD, settings, scene=scene).splits[-1]
    inside = (0.0, 0.5, 0.0)  # under the slab
    beyond = camera.eye - camera.backward * (1.01 * end)
    frame = renderer.render(scene, camera, OVERHEAD, settings, points=[inside, beyond])
    assert frame.point_cascade.tolist() == [frame.point_cascade[0], 255]
    assert frame.point_cascade[0] < 4
    assert frame.point_visibility.tolist() == [0.0, 1.0]


def test_without_a_filter_there_is_no_cascade(renderer):
    frame = renderer.render(
        rectangles((-12, 12, 0, -12, 12), (-5, 5, 2, -5, 5)),
        csm.Camera.look_at((0, 4, 8), (0, 0, 0), near=0.5, far=100, size=(16, 9)),
        OVERHEAD,
        csm.ShadowSettings(filter="none"),
        points=[(0, 0.5, 0)],
    )
    assert (frame.cascade_index == 255).all()
    assert frame.point_cascade.tolist() == [255]
    assert frame.point_visibility.tolist() == [1.0]
    with pytest.raises(AttributeError, match="filter='none' makes no shadow_maps"):
        frame.shadow_maps  # noqa: B018
