"""Published listings, reproduced as printed and shown wrong by figures; beside each, what csm does
with the same data (docs/numerics.md 25)."""

import itertools

import listings
import numpy as np
import oracles
import pytest
from views import clip_points, scene_of, turned

import csm
from csm import _core, spaces

SUN = csm.Sun((0.4, 0.8, 0.3))
BASIS = csm.fit_cascades(csm.Camera.look_at((0, 0, 1), (0, 0, 0)), SUN, csm.ShadowSettings())
BASIS = BASIS.light_from_world[0][:3, :3]
SIZE = 1024


def a_walk(steps=1000, seed=0):
    """Cameras that move at random, and the settings of two cascades."""
    rng = np.random.default_rng(seed)
    camera = turned(rng, near=0.1, far=60.0)
    for _ in range(steps):
        yield camera
        camera = camera.translated(rng.normal(size=3))


SETTINGS = csm.ShadowSettings(cascade_count=2, map_size=SIZE, view_range="camera")


def spheres_of(camera):
    """Centre in light space and radius of the sphere of each slice."""
    splits = csm.split_distances(camera.near, camera.far, SETTINGS.cascade_count)
    for near, far in itertools.pairwise(splits):
        depth, radius = _core.fit_sphere(camera, near, far)
        yield BASIS @ (camera.eye - depth * camera.backward), radius


# -- [Zhang2009] listing 4.1.1: exact stabilisation ------------------------------------------------


def printed_corners(camera, unit_texels):
    """Corner of each window [texels] with the printed snapping; its unit is R/S, half a texel."""
    for centre, radius in spheres_of(camera):
        scale = 2 * unit_texels  # the corrected unit is that of a map half as large
        snapped = listings.zhang_4_1_1_centre(centre[:2], radius, SIZE / scale)
        texel = 2 * radius / SIZE
        yield (snapped - radius) / texel, (snapped - centre[:2]) / texel


def jumps(corners):
    """Share of pairs of frames between which the texel grid of some cascade moves by no whole
    number of texels."""
    moved = np.diff(np.asarray(corners), axis=0)
    return (np.abs(moved - np.round(moved)) > 1e-6).any(axis=2).mean()


def test_the_printed_snap_unit_lets_the_grid_jump_in_three_of_four_frames():
    printed = [[corner for corner, _ in printed_corners(camera, 0.5)] for camera in a_walk()]
    # Half texels in either of two axes: one in four pairs of frames keeps both.
    assert jumps(printed) == pytest.approx(0.75, abs=0.05)
    half_off = np.abs(np.asarray(printed) % 1.0 - 0.5) < 0.25
    assert half_off.any(axis=2).mean() == pytest.approx(0.75, abs=0.05)
    ours = []
    for camera in a_walk():
        cascades = csm.fit_cascades(camera, SUN, SETTINGS)
        clip = cascades.clip_from_light
        corner = (-1 - clip[:, :2, 3]) / clip[:, [0, 1], [0, 1]] / cascades.texel_size
        ours.append(corner)
    assert jumps(ours) == 0.0


@pytest.mark.parametrize(("unit_texels", "overhang"), [(0.5, 0.5), (1.0, 1.0)])
def test_ceil_without_a_margin_moves_the_sphere_out_of_its_window(unit_texels, overhang):
    # The window is the sphere's own square, moved up by less than a unit: what lies on its lower
    # side is outside by as much.
    out = [shift for camera in a_walk() for _, shift in printed_corners(camera, unit_texels)]
    assert np.max(out) == pytest.approx(overhang, abs=0.01)
    assert np.max(out) < overhang
    for camera in a_walk(steps=200):
        cascades = csm.fit_cascades(camera, SUN, SETTINGS)
        for i, (centre, radius) in enumerate(spheres_of(camera)):
            low = cascades.lattice[i] * cascades.texel_size[i]
            high = low + SIZE * cascades.texel_size[i]
            assert (low <= centre[:2] - radius).all()
            assert (centre[:2] + radius <= high).all()


def test_the_printed_light_position_clips_half_of_the_sphere():
    rng = np.random.default_rng(2)
    ball = rng.normal(size=(20_000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    ball *= rng.uniform(size=(20_000, 1)) ** (1 / 3)
    camera = next(a_walk())
    direction = -SUN.to_light
    cascades = csm.fit_cascades(camera, SUN, SETTINGS)
    for i, (centre_ls, radius) in enumerate(spheres_of(camera)):
        centre = BASIS.T @ centre_ls
        near, far = 0.1, 8 * radius
        origin = listings.zhang_4_1_1_origin(centre, direction, far)
        depth = (centre + radius * ball - origin) @ direction
        # The centre lies on the far plane: all of the sphere behind it is lost.
        assert ((depth < near) | (depth > far)).mean() == pytest.approx(0.5, abs=0.02)
        ours = clip_points(cascades, i, centre + radius * ball)[:, 2]
        assert ((ours >= 0) & (ours <= 1)).all()


def test_a_depth_range_that_is_not_snapped_changes_every_stored_depth():
    rng = np.random.default_rng(3)
    points = rng.uniform(-20, 20, size=(500, 3))
    quanta = 2**16 - 1
    scene = scene_of([[-500] * 3, [500] * 3])
    settings = SETTINGS.replace(pancake=True, depth_format="d16")
    printed, ours = [], []
    for camera in a_walk(steps=60):
        (centre, radius), _ = spheres_of(camera)
        centre = BASIS.T @ centre
        near, far = 0.0, 8 * radius
        origin = listings.zhang_4_1_1_origin(centre, -SUN.to_light, far)
        stored = np.round((-(points - origin) @ SUN.to_light - near) / (far - near) * quanta)
        # As a place in the world: what the light's own place adds to a stored depth.
        printed.append(stored * (far - near) / quanta - origin @ SUN.to_light)
        cascades = csm.fit_cascades(camera, SUN, settings, scene=scene)
        near, far = cascades.depth_range[0]
        stored = np.round(clip_points(cascades, 0, points)[:, 2] * quanta)
        ours.append(stored * (far - near) / quanta + near)
    quantum = 8 * radius / quanta
    moved = np.abs(np.diff(printed, axis=0)).max(axis=1)
    assert (moved > 1e-3 * quantum).mean() > 0.99, "in every frame"
    # Ours: equal up to points on the edge between two numbers, and rounding.
    assert (np.abs(np.diff(ours, axis=0)) > 1e-9).mean() < 1e-3


# -- [Zhang2009] listing 4.1.2: approximate stabilisation ------------------------------------------


def test_printed_offsets_lose_up_to_a_texel():
    rng = np.random.default_rng(4)
    worst = 0.0
    for _ in range(20_000):
        low = rng.uniform(-1, 0.9)
        high = min(low + 10.0 ** rng.uniform(-1.5, 0), 1.0)
        scale, offset = listings.zhang_4_1_2(low, high, SIZE)
        assert scale <= 2 / (high - low) * (1 + 1e-12)
        overhang = max(high * scale + offset - 1, -1 - (low * scale + offset)) * SIZE / 2
        worst = max(worst, overhang)
    assert 0.7 < worst <= 1.0
    # Ours, where sizes come in levels too: the slice lies inside.
    settings = SETTINGS.replace(snap="approximate", fit="box")
    scene = scene_of([[-500] * 3, [500] * 3])
    for camera in a_walk(steps=100):
        cascades = csm.fit_cascades(camera, SUN, settings, scene=scene)
        for i in range(2):
            corners = oracles.camera_corners(camera, *cascades.splits[i : i + 2])
            assert np.abs(clip_points(cascades, i, corners)[:, :2]).max() <= 1.0 + 1e-12


def test_printed_levels_end_at_a_64th():
    # A window of 1/1000 of the base gets the scale 64 instead of 1000.
    scale, _ = listings.zhang_4_1_2(0.0, 0.002, SIZE)
    assert scale == 64.0
    assert 1000 / scale == pytest.approx(15.6, abs=0.05)


# -- [Zhang2009] listings 4.1.3 and 4.1.4: selection -----------------------------------------------


def atlas_coordinates(cascades, points):
    """(m, 4, 2) of each point in the quarters of the atlas that listing 4.1.3 tests."""
    corners = np.array([[0.0, 0.0], [0.0, 0.5], [0.5, 0.0], [0.5, 0.5]])
    uv = [spaces.transform_points(each, points)[:, :2] for each in cascades.uvz_from_world]
    return np.stack(uv, axis=1) * 0.5 + corners


def test_nested_tests_are_wrong_for_every_point_outside_the_first_map(renderer):
    rng = np.random.default_rng(5)
    scene = csm.scenes.plane_and_box()
    camera = scene.cameras["corner"].replace(size=(8, 8))
    sun = scene.suns["diagonal"]
    points = oracles.sample_slice(camera, camera.near, 60.0, 4000, rng)
    points = points[((points > scene.bounds[0]) & (points < scene.bounds[1])).all(axis=1)]
    settings = csm.ShadowSettings(cascade_count=4, map_size=256, split="logarithmic")
    frame = renderer.render(scene, camera, sun, settings, outputs=(), points=points)
    uv = atlas_coordinates(frame.cascades, points)
    centres = np.array([[0.25, 0.25], [0.25, 0.75], [0.75, 0.25], [0.75, 0.75]])
    held = np.abs(uv - centres).max(axis=2) < 0.25
    first = np.where(held.any(axis=1), held.argmax(axis=1), 255)
    printed = [listings.zhang_4_1_3(each) for each in uv]
    beyond = first > 0
    assert beyond.sum() > 100
    # Never the first map that holds the point; "lit" only where the other three all hold it.
    wrong = [sampled is None or sampled != right
             for sampled, right in zip(printed, first, strict=True)]  # fmt: skip
    assert np.array_equal(wrong, beyond)
    lit = np.array([sampled is None for sampled in printed])
    assert np.array_equal(lit, beyond & held[:, 1:].all(axis=1))
    # Points on the rim of a map to float32 aside.
    rim = (np.abs(np.abs(uv - centres).max(axis=2) - 0.25) < 1e-5).any(axis=1)
    assert np.array_equal(frame.point_cascade[~rim], first[~rim])


def test_the_printed_split_test_samples_the_first_map_for_the_last_split():
    assert [listings.zhang_4_1_4(split) for split in range(3)] == [None, None, 0]


# -- [Zhang2009] section "Correct computation of texture coordinates" ------------------------------


def test_coordinates_from_the_position_are_right_and_those_divided_per_vertex_are_not():
    # "Method 2 is wrong" is false: by linearity both methods are one. Division by the light's w in
    # the vertex shader is what goes wrong, on a triangle of 13 km under a light in perspective.
    rng = np.random.default_rng(6)
    corners = np.c_[[[-6.5e3, 0, -50], [6.5e3, 0, -80], [0, 0, -13e3]], np.ones(3)]
    camera = csm.Camera.look_at((0, 30, 0), (0, 25, -100), near=1.0, far=2e4, size=(16, 9))
    w = -(corners[:, :3] - camera.eye) @ camera.backward
    light = csm.Camera.look_at((0, 60, 20), (0, 0, -6e3), fov_y_deg=150, near=1, far=3e4)
    perspective = light.clip_from_view @ light.view_from_world
    parallel = csm.fit_cascades(camera, SUN, SETTINGS).clip_from_world[1]
    per_vertex = 0.0
    for matrix in (parallel, perspective):
        texture = corners @ matrix.T
        for weights in rng.dirichlet(np.ones(3), size=2000):
            shares = weights / w / (weights / w).sum()
            first = shares @ texture
            second = matrix @ (shares @ corners)
            scale = np.abs(matrix) @ (shares @ np.abs(corners))
            assert (np.abs(first - second) <= 16 * oracles.U * scale).all()
            divided = shares @ (texture[:, :2] / texture[:, 3:])
            off = np.abs(divided - first[:2] / first[3]).max() * SIZE / 2
            per_vertex = max(per_vertex, off)
    assert per_vertex > 1e3  # texels


# -- [Zhang2009] listing 4.1.6: one index per quad -------------------------------------------------


def consistent_index(quad):
    """The rule corrected: where neighbours differ, the logarithm of the difference of powers."""
    power = 2.0**quad
    dx = np.abs(np.diff(power, axis=1)).repeat(2, axis=1)
    dy = np.abs(np.diff(power, axis=0)).repeat(2, axis=0)
    dxy = np.abs(np.diff(dy, axis=1)).repeat(2, axis=1)
    difference = np.maximum(dxy, np.maximum(dx, dy))
    return np.where(difference > 0, np.log2(np.maximum(difference, 1)), quad)


def test_the_printed_quad_rule_is_wrong_in_65_of_80_quads():
    patterns = np.reshape(list(itertools.product((0, 1), repeat=4)), (16, 2, 2))
    quads = [low + pattern for low in range(5) for pattern in patterns]
    wrong = [(listings.zhang_4_1_6(quad) != quad.min()).any() for quad in quads]
    assert (sum(wrong), len(wrong)) == (65, 80)
    assert all((consistent_index(quad) == quad.min()).all() for quad in quads)


# -- [MSDN] ----------------------------------------------------------------------------------------


def test_printed_interval_selection_leaves_the_array(renderer):
    scene = scene_of([[-40, -40, -300], [40, 40, -1]])
    camera = csm.Camera.look_at((0, 0, 0), (0, 0, -1), near=1.0, far=100.0, size=(8, 8))
    settings = csm.ShadowSettings(select="interval", view_range="camera", map_size=64)
    depths = np.array([2.0, 60.0, 99.0, 101.0, 250.0])
    points = np.stack([0 * depths, 0 * depths, -depths], axis=1)
    frame = renderer.render(
        scene, camera, csm.Sun((0.3, 1, 0.2)), settings, outputs=(), points=points
    )
    printed = listings.msdn_interval_index(depths, frame.cascades.splits[1:])
    right = np.searchsorted(frame.cascades.splits[1:], depths)
    assert printed.tolist() == right.tolist()
    assert (printed[3:] == 4).all(), "one past the last of four cascades"
    assert frame.point_cascade.tolist() == [*right[:3], 255, 255]
    assert (frame.point_visibility[3:] == 1.0).all()


def test_the_printed_inverse_is_right_for_row_vectors_and_wrong_transposed():
    rng = np.random.default_rng(7)
    off, off_transposed = [], []
    for _ in range(500):
        gradient = rng.normal(size=2)
        ddx, ddy = rng.normal(size=(2, 2))
        depths = np.array([ddx @ gradient, ddy @ gradient])
        inverse = listings.msdn_shadow_to_screen(ddx, ddy)
        # As printed: the texel to the right, a row vector, times the matrix; then the depths.
        right, up = (np.array(step) @ inverse @ depths for step in ((1.0, 0.0), (0.0, 1.0)))
        scale = np.abs(inverse).max() * np.abs(depths).max()
        off.append(np.abs(np.array([right, up]) - gradient).max() / scale)
        off_transposed.append(np.abs(inverse.T @ depths - gradient).max() / np.abs(gradient).max())
    assert np.max(off) <= 1e-14
    assert np.median(off_transposed) > 0.1


def test_the_printed_pcf_loop_adds_up_offsets():
    worst = 0.0
    for angle in np.linspace(0, 2 * np.pi, 361):
        right, up = np.cos(angle), np.sin(angle)
        printed = listings.msdn_pcf_offsets(right, up, -1, 2)
        true = {(x, y): right * x + up * y for x, y in printed}
        off = max(abs(printed[tap] - true[tap]) for tap in true)
        worst = max(worst, off / max(map(abs, true.values())))
    assert worst == pytest.approx(3.0)


# -- [theomader] -----------------------------------------------------------------------------------


def test_printed_window_of_the_stable_article_changes_its_size():
    # A world of 100 m on 512 texels: the step should be 0.195 m.
    rng = np.random.default_rng(8)
    texels = []
    for _ in range(500):
        extent = rng.uniform(40.0, 60.0)
        low = rng.uniform(-50, 50)
        low, high = listings.theomader_window(low, low + extent, 100.0)
        assert abs(low / 0.01 - round(low / 0.01)) < 1e-6, "steps of 1/100 m, not of a texel"
        texels.append((high - low) / 512)
    assert min(texels) > 100 / 512 * 1.4
    assert max(texels) / min(texels) > 1.1


def test_the_printed_view_is_singular_where_the_light_is_level_with_its_target():
    # Not "in the y = 0 plane": the determinant is 1 / look.y wherever the light is.
    for height in (0.0, 7.0):
        position = np.array([3.0, height, -2.0])
        for drop in (1.0, 0.1, 1e-3, 1e-6):
            look = np.array([np.sqrt(1 - drop * drop), -drop, 0.0])
            view = listings.theomader_view(look, position)
            assert abs(np.linalg.det(view)) == pytest.approx(1 / drop, rel=1e-6)
        with pytest.raises(np.linalg.LinAlgError):
            listings.theomader_view(np.array([1.0, 0.0, 0.0]), position)


def test_the_printed_grid_hangs_on_the_light():
    # The same sun seen from another place moves the grid of every point of the ground.
    point = np.array([5.0, 0.0, 3.0, 1.0])
    look = np.array([0.3, -0.9, 0.1])
    here, there = (
        point @ listings.theomader_view(look, position)
        for position in ((0.0, 50.0, 0.0), (0.013, 50.0, 0.0))
    )
    assert np.abs(there - here)[:2].max() == pytest.approx(0.013)
    # A direction has no place: csm's axes and lattice are those of the world's origin.
    cascades = csm.fit_cascades(next(a_walk(1)), SUN, SETTINGS)
    assert np.array_equal(cascades.light_from_world[0][:3, 3], [0, 0, 0])
    skewed = csm.fit_cascades(next(a_walk(1)), SUN, SETTINGS.replace(light_basis="world"))
    assert np.array_equal(skewed.light_from_world[0][:3, 3], [0, 0, 0])


def test_splits_through_clip_space_lose_their_digits_in_float32():
    errors = []
    for ratio in (1e4, 1e6, 1e8):
        depths = np.geomspace(1.0, ratio, 50)
        found = np.array([listings.theomader_split_depth(z, 1.0, ratio) for z in depths])
        errors.append(np.abs(found / depths - 1).max())
        camera = csm.Camera.look_at((0, 0, 0), (0, 0, -1), near=1.0, far=ratio)
        for near, far in itertools.pairwise(depths):
            corners = _core.frustum_corners(camera, near, far)
            assert np.array_equal(-corners[[0, 4], 2], [near, far])
    assert 1e-5 < errors[0] < 1e-3
    assert 1e-3 < errors[1] < 1e-1
    assert errors[2] > 0.1


# -- [Sylvan] --------------------------------------------------------------------------------------


@pytest.mark.parametrize("tangent", [0.1, 0.3, 0.41, 0.59, 0.8, 1.0])
def test_a_sphere_can_be_shifted_only_if_the_view_is_wide_enough(tangent):
    # The condition that the article does not name: k^2 > (f - n) / (f + n). Without it the near
    # corners lie on the smallest sphere already, and any shift along the view loses them.
    k2 = 2 * tangent * tangent
    for ratio in (1.05, 2.0, 3.0, 30.0):
        camera = csm.Camera(np.zeros(3), *np.eye(3), tangent, tangent, 1.0, ratio, (8, 8), False)
        centre, radius = _core.fit_sphere(camera, 1.0, ratio)
        near_corner = oracles.view_corners(tangent, tangent, 1.0, ratio)[0]
        shifted = near_corner - [0, 0, centre + 1e-3 * radius]
        lost = np.linalg.norm(shifted) > radius
        assert lost == (k2 <= (ratio - 1) / (ratio + 1))
