"""Masks against every compare done once more in doubles, and what a pixel is against exact rays."""

import drawings
import mask_oracle
import numpy as np
import pytest
import small_scenes

import csm
from csm import shapes

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal", "shadow_maps")
FILTERS = {
    "hard": {"filter": "hard"},
    "pcf 2x2": {"filter": "pcf", "filter_size": 2},
    "pcf 3x3": {"filter": "pcf", "filter_size": 3},
    "pcf 5x5": {"filter": "pcf", "filter_size": 5},
    "pcf 7x7": {"filter": "pcf", "filter_size": 7},
}
SIZE = (96, 54)
# An overhead sun is left out: ground at one depth, compared to within float32's rounding of it,
# would leave most of the picture undecided.
SUNS = ("high", "low", "in_the_face")
BASE = csm.ShadowSettings(map_size=256)


def frame_of(renderer, scene, camera, sun, settings):
    return renderer.render(scene, camera, csm.Sun(sun), settings, outputs=OUTPUTS)


def assert_mask_matches(frame, evidence=None):
    """The mask inside the oracle's interval wherever both took the same cascade, which they do
    wherever the oracle is sure; and the interval is a single value almost everywhere."""
    oracle = mask_oracle.evaluate(frame)
    mask, index = frame.mask[frame.valid], frame.cascade_index[frame.valid]
    if evidence is not None:
        expected = np.ones(frame.mask.shape)
        expected[frame.valid] = 0.5 * (oracle.lowest + oracle.highest)
        evidence(rendered=frame.mask, reference=expected, settings=frame.settings)
    assert (index == oracle.index)[oracle.index_sure].all()
    same = index == oracle.index
    # Sums of up to 49 answers in float32.
    assert (mask >= oracle.lowest - 1e-6)[same].all()
    assert (mask <= oracle.highest + 1e-6)[same].all()
    allowance = 0.04 if frame.settings.filter_size == 2 else 1e-6
    if (frame.settings.filter_weights, frame.settings.kernel) != ("box", "texels"):
        allowance = 0.01  # weights that go with the point
    assert (oracle.highest - oracle.lowest <= allowance).mean() > 0.95
    assert oracle.index_sure.mean() > 0.99
    return oracle


# -- compares --------------------------------------------------------------------------------------


@pytest.mark.parametrize("select", ["map", "interval"])
@pytest.mark.parametrize("filter_name", FILTERS)
def test_every_compare(renderer, evidence, filter_name, select):
    settings = BASE.replace(select=select, **FILTERS[filter_name])
    shades = set()
    for scene_number, make in enumerate(small_scenes.SCENES.values()):
        scene = make()
        for sun_number, sun in enumerate(SUNS):
            if (scene_number + sun_number) % 2 == (select == "map"):
                continue  # the other half is the other selection's
            camera = small_scenes.camera((scene_number + sun_number) % 4, SIZE)
            frame = frame_of(renderer, scene, camera, small_scenes.SUNS[sun], settings)
            assert_mask_matches(frame, evidence)
            shades |= set(np.unique(frame.mask).tolist())
    size = {"hard": 1}.get(settings.filter, settings.filter_size)
    assert {0.0, 1.0} < shades if size > 1 else shades == {0.0, 1.0}
    if size % 2:
        steps = np.array(sorted(shades)) * size * size
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-4)


@pytest.mark.parametrize(
    "changes",
    [
        {"depth_format": "d16"},
        {"depth_format": "d24", "filter": "pcf", "filter_size": 5},
        {"fit": "box"},
        {"fit": "diameter", "snap": "none"},
        {"fit": "scene", "cascade_count": 1, "map_size": 500},
        {"cascade_count": 8, "map_size": 65, "split": "logarithmic"},
        {"bias": "manual"},
        {"bias": "manual", "constant_bias_texels": 1.5},
        {"bias": "manual", "slope_bias": 0.7},
        {"bias": "manual", "slope_bias": 2.5, "fit": "box", "map_size": 64},
        {"bias": "manual", "constant_bias_texels": -0.5, "slope_bias": 1.0},
        {"bias": "manual", "normal_offset_texels": 0.8, "slope_bias": 0.2},
        {"bias": "manual", "normal_offset_texels": -0.4},
        {"bias": "manual", "receiver_plane": True, "constant_bias_texels": 0.1},
        {
            "bias": "manual", "receiver_plane": True, "slope_bias": 0.05,
            "filter": "pcf", "filter_size": 7,
        },
    ],
    ids=lambda changes: " ".join(f"{name}={value}" for name, value in changes.items()),
)  # fmt: skip
def test_every_compare_under_other_settings(renderer, evidence, changes):
    settings = BASE.replace(**changes)
    for number, (scene, sun) in enumerate(
        [("plane and box", "low"), ("soup", "high"), ("copies", "in_the_face"), ("stairs", "low")]
    ):
        camera, scene = small_scenes.camera(number, SIZE), small_scenes.SCENES[scene]()
        frame = frame_of(renderer, scene, camera, small_scenes.SUNS[sun], settings)
        assert_mask_matches(frame, evidence)


def test_every_compare_of_an_orthographic_camera(renderer, evidence):
    scene = csm.scenes.plane_and_box()
    camera = scene.cameras["map"].replace(size=small_scenes.SIZE)
    for select in ("map", "interval"):
        frame = frame_of(renderer, scene, camera, (1, 1, 0), BASE.replace(select=select))
        assert_mask_matches(frame, evidence)


def test_the_shadow_of_a_box_in_closed_form(renderer):
    # The sun at 45 degrees from +x throws the box's shadow onto x -3 to -1, z -1 to 1. A pixel
    # may be wrong up to a texel of the map from the edge, on the ground sqrt(2) texels along x.
    scene = csm.scenes.plane_and_box()
    camera = scene.cameras["map"].replace(size=(240, 240))
    frame = frame_of(renderer, scene, camera, (1, 1, 0), csm.ShadowSettings(map_size=1024))
    x, _, z = np.moveaxis(small_scenes.positions_of(frame), -1, 0)
    margin = np.sqrt(2.0) * frame.cascades.texel_size.max()
    # Signed distance from the shadow's outline, the box's top with it: lit, x from -1 to 1.
    inside = np.minimum(1.0 - np.abs(x + 2.0), 1.0 - np.abs(z))
    ground = np.abs(x) > 1.0
    sure = (np.abs(inside) > margin) & (np.abs(x + 1.0) > margin)
    shadow = (inside > 0.0) & ground
    assert np.array_equal(frame.mask == 0.0, shadow | ~sure & (frame.mask == 0.0))
    assert (frame.mask[sure & shadow] == 0.0).all()
    assert np.count_nonzero(sure & shadow) == pytest.approx(4.0 * (240 / 12) ** 2, rel=0.1)


# -- what does not face the sun, and what is not there ---------------------------------------------


@pytest.mark.parametrize("filter_name", [*FILTERS, "none"])
def test_facing_is_a_rule_of_every_filter(renderer, filter_name):
    settings = BASE.replace(**FILTERS.get(filter_name, {"filter": "none"}))
    outputs = OUTPUTS[:-1] if filter_name == "none" else OUTPUTS
    turned_away = 0
    for scene in (make() for make in small_scenes.SCENES.values()):
        for sun in SUNS:
            sun = csm.Sun(small_scenes.SUNS[sun])
            frame = renderer.render(scene, small_scenes.camera(3), sun, settings, outputs=outputs)
            cosine = frame.normal.astype(np.float64) @ sun.to_light
            away = frame.valid & (cosine <= 1e-5 - mask_oracle.EPS)
            assert (frame.mask[away] == 0.0).all()
            turned_away += np.count_nonzero(away)
            if filter_name == "none":
                assert (frame.mask[frame.valid & (cosine > 1e-5 + mask_oracle.EPS)] == 1.0).all()
                assert (frame.cascade_index == mask_oracle.NO_CASCADE).all()
    assert turned_away > 5000


@pytest.mark.parametrize("filter_name", [*FILTERS, "none"])
def test_where_nothing_is_seen(renderer, filter_name):
    scene, camera = csm.scenes.plane_and_box(), small_scenes.camera(1)
    settings = BASE.replace(**FILTERS.get(filter_name, {"filter": "none"}))
    frame = renderer.render(scene, camera, csm.Sun((1, 1, 0)), settings, outputs=OUTPUTS[:-1])
    sky = ~frame.valid
    assert sky.any()
    assert (frame.mask[sky] == 1.0).all()
    assert np.isposinf(frame.view_depth[sky]).all()
    assert (frame.cascade_index[sky] == mask_oracle.NO_CASCADE).all()
    assert (frame.normal[sky] == 0.0).all()


@pytest.mark.parametrize("elevation", [-80.0, -30.0, -1.0])
def test_r1_a_sun_below_the_horizon_lights_no_ground(renderer, elevation):
    scene, camera = csm.scenes.plane_and_box(), small_scenes.camera(2)
    sun = csm.Sun.from_angles(30.0, elevation)
    frame = renderer.render(scene, camera, sun, BASE, outputs=OUTPUTS)
    up = frame.valid & (frame.normal[..., 1] > 0.5)
    assert up.any()
    assert (frame.mask[up] == 0.0).all()
    assert np.isfinite(frame.mask).all()


def test_surfaces_have_two_sides(renderer):
    # The same triangle with either winding: its mask is that of the side that is seen.
    corners = [[-2, 0, -2], [2, 0, -2], [0, 0, 2]]
    camera = csm.Camera.look_at((0.1, 3, 0.2), (0, 0, 0), near=0.1, far=20, size=(32, 32))
    for triangle in ([0, 1, 2], [0, 2, 1]):
        scene = csm.Scene.from_arrays(corners, [triangle])
        lit = frame_of(renderer, scene, camera, (0.2, 1, 0.1), BASE)
        assert (lit.normal[lit.valid] @ [0, 1, 0] > 0.99).all()
        assert (lit.mask[lit.valid] == 1.0).all()
        unlit = frame_of(renderer, scene, camera, (0.2, -1, 0.1), BASE)
        assert (unlit.mask[unlit.valid] == 0.0).all()


# -- cascades --------------------------------------------------------------------------------------


@pytest.mark.parametrize("filter_size", [1, 7])
@pytest.mark.parametrize("fit", ["sphere", "box", "diameter", "scene"])
def test_c2_map_selection_is_never_coarser_than_interval_selection(
    figure, renderer, fit, filter_size
):
    finer = coarser = out_of_range = 0
    for number in range(4):
        scene = small_scenes.SCENES["stairs"]()
        settings = BASE.replace(fit=fit, filter="pcf", filter_size=filter_size)
        sun = small_scenes.SUNS[SUNS[number % 3]]
        camera = small_scenes.camera(number)
        by_map = frame_of(renderer, scene, camera, sun, settings)
        by_interval = frame_of(renderer, scene, camera, sun, settings.replace(select="interval"))
        for frame in (by_map, by_interval):
            beyond = frame.cascade_index[frame.valid] >= settings.cascade_count
            out_of_range += np.count_nonzero(beyond)
        coarser += np.count_nonzero(by_map.cascade_index > by_interval.cascade_index)
        finer += np.count_nonzero(by_map.cascade_index < by_interval.cascade_index)
    assert finer > 1000
    indices = by_interval.cascade_index / 4.0, by_map.cascade_index / 4.0
    figure(
        "C2", "index by map above that by interval", coarser, 0, "pixels",
        picture=lambda: drawings.compared(*indices),
    )  # fmt: skip
    figure("C2", "index of no cascade inside the range", out_of_range, 0, "pixels")


@pytest.mark.parametrize("ulps", [-1, 0, 1])
def test_c2_a_depth_exactly_on_a_split_belongs_to_the_nearer_slice(figure, renderer, ulps):
    # A wall at view depth 8, exactly so in float32; the split one step before, on, or after it.
    split = np.float32(8.0)
    for _ in range(abs(ulps)):
        split = np.nextafter(split, np.float32(np.inf * ulps))
    wall = [[-30, -30, -8], [30, -30, -8], [30, 30, -8], [-30, 30, -8]]
    scene = csm.Scene.from_arrays(wall, [[0, 1, 2], [0, 2, 3]])
    camera = csm.Camera.look_at((0, 0, 0), (0, 0, -1), near=0.5, far=40, size=(32, 16))
    settings = BASE.replace(
        select="interval", cascade_count=2, split="manual", manual_splits=(float(split),),
        view_range="camera",
    )  # fmt: skip
    frame = frame_of(renderer, scene, camera, (0.1, 0.2, 1.0), settings)
    assert (frame.view_depth == 8.0).all()
    wrong = np.count_nonzero(frame.cascade_index != (1 if ulps < 0 else 0))
    figure("C2", "index on a split and one ulp beside", wrong, 0, "pixels")
    assert (frame.mask == 1.0).all()


@pytest.mark.parametrize("select", ["map", "interval"])
def test_c2_the_end_of_the_range_is_inside(figure, renderer, select):
    # view_range="scene" ends where the scene ends: its last pixel still has a cascade.
    for number in range(4):
        scene = small_scenes.copies()
        settings = BASE.replace(select=select)
        camera = small_scenes.camera(number, far=1000.0)
        frame = frame_of(renderer, scene, camera, (0.4, 1, 0.3), settings)
        assert frame.cascades.splits[-1] < 100.0
        lost = np.count_nonzero(frame.cascade_index[frame.valid] >= 4)
        figure("C2", "pixels without a cascade at the end of the range", lost, 0, "pixels")


@pytest.mark.parametrize("offset", [0.0, 1.0, 3.0])
def test_a_normal_offset_loses_no_receiver(renderer, offset):
    # The rim of the ground towards the sun is where the depth range begins: lifted, it is before.
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(20.0))])
    settings = BASE.replace(bias="manual", normal_offset_texels=offset, slope_bias=1.0)
    for eye, target in (((-17, 2, -17), (-20, 0, -20)), ((0, 30, 0.1), (0, 0, 0))):
        camera = csm.Camera.look_at(eye, target, far=100, size=small_scenes.SIZE)
        for sun in (csm.Sun.from_angles(180.0, 40.0), csm.Sun.from_angles(225.0, 10.0)):
            frame = frame_of(renderer, scene, camera, sun.to_light, settings)
            assert (frame.cascade_index[frame.valid] < 4).all()
            assert (frame.mask == 1.0).all()


# -- points ----------------------------------------------------------------------------------------


def test_points_in_the_open_and_in_the_middle_of_a_shadow(renderer):
    # Far from the rim of a shadow neither texels nor biases matter: closed forms decide. The sun
    # at 45 degrees from +x: x - y is constant along its rays, and they leave the box at x = -1.
    scene, camera = csm.scenes.plane_and_box(), small_scenes.camera(2)
    points = np.random.default_rng(4).uniform((-4, 0.2, -3), (4, 3, 3), size=(6000, 3))
    settings = BASE.replace(map_size=1024)
    frame = renderer.render(
        scene, camera, csm.Sun((1, 1, 0)), settings, outputs=("mask",), points=points
    )
    assert frame.point_visibility.shape == frame.point_cascade.shape == (6000,)
    # A point of unknown surface is biased as at 45 degrees to the light, by 3/4 texel of a slope
    # of sqrt(2); with half its own texel's diagonal that is less than two.
    margin = 2.0 * frame.cascades.texel_size.max()
    x, y, z = points.T
    in_box = np.maximum(np.maximum(np.abs(x), np.abs(z)) - 1.0, y - 2.0)
    in_beam = np.minimum(np.minimum(1.0 - np.abs(z), (x - y + 3.0) / np.sqrt(2.0)), -1.0 - x)
    sure = (in_box > margin) & (np.abs(in_beam) > margin) & (frame.point_cascade < 4)
    assert np.count_nonzero(sure & (in_beam > 0.0)) > 60
    assert np.count_nonzero(sure & (in_beam < 0.0)) > 1000
    assert np.array_equal(frame.point_visibility[sure] == 0.0, in_beam[sure] > 0.0)


def test_points_choose_cascades_as_pixels_do(renderer):
    scene, camera = small_scenes.SCENES["stairs"](), small_scenes.camera()
    for select in ("map", "interval"):
        settings = BASE.replace(select=select)
        frame = frame_of(renderer, scene, camera, small_scenes.SUNS["high"], settings)
        points = small_scenes.positions_of(frame)[frame.valid]
        again = renderer.render(
            scene, camera, csm.Sun(small_scenes.SUNS["high"]), settings,
            outputs=("cascade_index",), points=points,
        )  # fmt: skip
        oracle = mask_oracle.evaluate(frame)
        differ = again.point_cascade != frame.cascade_index[frame.valid]
        # Two float32 positions of one point; by interval, two float32 depths.
        if select == "map":
            assert not (differ & oracle.index_sure).any()
        assert differ.mean() < 0.005


def test_no_points_and_many(renderer):
    scene, camera, sun = csm.scenes.plane_and_box(), small_scenes.camera(), csm.Sun((1, 1, 0))
    none = renderer.render(scene, camera, sun, BASE, outputs=(), points=np.zeros((0, 3)))
    assert none.point_visibility.shape == (0,)
    points = np.tile([[-2.0, 0.5, 0.0], [-6.0, 0.5, 0.0]], (150_000, 1))
    many = renderer.render(scene, camera, sun, BASE, outputs=(), points=points)
    assert (many.point_visibility[::2] == 0.0).all()
    assert (many.point_visibility[1::2] == 1.0).all()


# -- what is seen ----------------------------------------------------------------------------------


@pytest.mark.parametrize("scene", small_scenes.SCENES)
def test_surfaces_against_exact_rays(renderer, scene):
    scene = small_scenes.SCENES[scene]()
    for number in range(4):
        camera = small_scenes.camera(number)
        frame = frame_of(renderer, scene, camera, (0.4, 1, 0.3), BASE)
        truth = csm.truth(scene, camera, frame.sun)
        depth = -(truth.position - camera.eye) @ camera.backward
        # A pixel whose centre lies within the rasteriser's grid of an edge may see either side.
        both = frame.valid & truth.valid
        same = both & (np.einsum("ijk,ijk->ij", frame.normal, truth.normal) > 1 - 1e-5)
        assert np.count_nonzero(frame.valid != truth.valid) < 0.002 * both.size
        assert np.count_nonzero(both & ~same) < 0.01 * both.size
        # Float32 plane against double: the plane's offset and the eye's distance round to 2^-24
        # of the scene's size, divided by the cosine between ray and normal.
        rays, _ = small_scenes.pixel_rays(camera)
        cosine = np.abs(np.einsum("ijk,ijk->ij", rays, truth.normal))
        extent = np.abs(scene.bounds - scene.origin).max() + np.nanmax(depth)
        tolerance = 16.0 * 2.0**-24 * extent * (1.0 + 1.0 / np.maximum(cosine, 1e-6))
        close = np.abs(frame.view_depth - depth) <= tolerance
        assert np.count_nonzero(same & ~close) < 0.002 * both.size
        assert np.count_nonzero(same & close) > 0.98 * np.count_nonzero(both)


@pytest.mark.parametrize("distance", [0.0, 1e3, 1e5])
def test_view_depth_far_from_the_world_origin(renderer, distance):
    scene = csm.scenes.plane_and_box().placed((distance, 0.0, -distance))
    camera = small_scenes.camera().translated((distance, 0.0, -distance))
    here = frame_of(renderer, scene, camera, (1, 1, 0), BASE)
    rays, _ = small_scenes.pixel_rays(camera)
    ground = here.valid & (here.normal[..., 1] > 0.99) & (here.view_depth < 60)
    expected = -camera.eye[1] / np.where(rays[..., 1] < 0.0, rays[..., 1], np.nan)
    on_ground = ground & (np.abs(here.view_depth - expected) < 0.1)
    assert np.count_nonzero(on_ground) > 3000
    np.testing.assert_allclose(here.view_depth[on_ground], expected[on_ground], rtol=1e-5)


def test_r1_triangles_across_the_eye_and_the_near_plane(renderer):
    # One triangle from behind the eye to the horizon.
    scene = csm.Scene.from_arrays([[-1e3, 0, 1e3], [1e3, 0, 1e3], [0, 0, -3e3]], [[0, 1, 2]])
    camera = csm.Camera.look_at((0, 2, 0), (0, 0, -10), near=0.1, far=5e3, size=small_scenes.SIZE)
    frame = frame_of(renderer, scene, camera, (0.3, 1, 0.2), BASE)
    rays, _ = small_scenes.pixel_rays(camera)
    expected = -2.0 / np.where(rays[..., 1] < 0, rays[..., 1], np.nan)
    near = expected < 500.0
    assert frame.valid[near].all()
    np.testing.assert_allclose(frame.view_depth[near], expected[near], rtol=2e-4)
    assert (frame.mask == 1.0).all()


# -- scenes that are next to nothing ---------------------------------------------------------------


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0, 0], [0, 0, 0], [0, 0, 0]],
        [[-1, 0, 0], [0, 0, 0], [1, 0, 0]],
        [[-1, 0, 0], [1, 0, 0], [0, 1e-12, 0]],
    ],
    ids=["point", "line", "sliver"],
)
def test_r1_triangles_without_area(renderer, corners):
    ground, triangles = shapes.ground(5.0)
    positions = np.concatenate([ground, np.add(corners, [0.0, 1.0, 0.0])])
    scene = csm.Scene.from_arrays(positions, np.concatenate([triangles, [[4, 5, 6]]]))
    frame = frame_of(renderer, scene, small_scenes.camera(), (0.3, 1, 0.2), BASE)
    assert np.isfinite(frame.mask).all()
    ground_pixels = frame.valid & (frame.normal[..., 1] > 0.9)
    assert (frame.mask[ground_pixels] == 1.0).mean() > 0.999


def test_r1_a_stack_of_equal_triangles_is_one(renderer):
    scene = csm.scenes.plane_and_box()
    positions, triangles = scene.flatten()
    scene = csm.Scene.from_arrays(positions, triangles)
    stack = csm.Scene.from_arrays(positions, np.tile(triangles, (5, 1)))
    for sun in SUNS:
        one, five = (
            frame_of(renderer, each, small_scenes.camera(), small_scenes.SUNS[sun], BASE)
            for each in (scene, stack)
        )
        assert np.array_equal(one.shadow_maps, five.shadow_maps)
        assert np.array_equal(one.mask, five.mask)
