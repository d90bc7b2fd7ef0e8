"""Cascades as arrays: where a known point lands, depth ranges, view ranges, refusals."""

import pickle

import drawings
import numpy as np
import oracles
import pytest
from views import assert_covers, assert_finite, scene_of, turned

import csm
from csm import _core, spaces

# -------------------------------------------------------------------------------------------------
# Matrices


def test_a_known_point_lands_on_a_known_texel():
    # A sun overhead: light x is world x, light y is north (-z), depth grows downwards.
    camera = csm.Camera.orthographic(
        (0, 50, 0), (0, 0, 0), up=(0, 0, -1), height=16, near=10, far=90, size=(64, 64)
    )
    settings = csm.ShadowSettings(
        cascade_count=1, map_size=16, split="uniform", fit="box", snap="none"
    )
    scene = scene_of([[-8, 0, -8], [8, 4, 8]])
    cascades = csm.fit_cascades(camera, csm.Sun((0, 1, 0)), settings, scene=scene)
    np.testing.assert_allclose(cascades.texel_size, [[1.0, 1.0]], rtol=1e-15)
    uvz = spaces.transform_points(
        cascades.uvz_from_world[0], [[-7.5, 0, 7.5], [7.5, 4, 7.5], [-7.5, 2, -4.5]]
    )
    np.testing.assert_allclose(uvz[:, :2] * 16, [[0.5, 0.5], [15.5, 0.5], [0.5, 12.5]], atol=1e-12)
    # The range of 4 m is widened by some 1e-5 m, for float32 rounding.
    np.testing.assert_allclose(uvz[:, 2], [1.0, 0.0, 0.5], atol=1e-4)
    assert uvz[0, 2] < 1.0
    assert uvz[1, 2] > 0.0


def test_matrices_agree_with_each_other():
    rng = np.random.default_rng(10)
    camera = turned(rng, eye=(30, 2, -7))
    settings = csm.ShadowSettings(map_size=(256, 255, 101, 64), fit="box")
    cascades = csm.fit_cascades(
        camera, csm.Sun((1, 2, 3)), settings, scene=scene_of([[-9] * 3, [9] * 3])
    )
    half = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]])
    assert cascades.map_size.tolist() == [256, 255, 101, 64]
    for i in range(4):
        light_from_world = cascades.light_from_world[i]
        np.testing.assert_allclose(light_from_world[2, :3], csm.Sun((1, 2, 3)).to_light, atol=1e-15)
        product = cascades.clip_from_light[i] @ light_from_world
        np.testing.assert_allclose(cascades.clip_from_world[i], product, rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(
            cascades.uvz_from_world[i], half @ product, rtol=1e-14, atol=1e-15
        )
        sides = cascades.texel_size[i] * cascades.map_size[i]
        corner = cascades.lattice[i] * cascades.texel_size[i]
        near, far = cascades.depth_range[i]
        ends = [[*corner, -near], [*(corner + sides), -far]]
        clip = spaces.transform_points(cascades.clip_from_light[i], ends)
        np.testing.assert_allclose(clip, [[-1, -1, 0], [1, 1, 1]], atol=1e-13)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, -1, 1)])
@pytest.mark.parametrize("distance", [10.0**exponent for exponent in range(9)])
@pytest.mark.parametrize("snap", ["exact", "none"])
def test_x3_world_offsets_cost_no_texels(figure, axis, distance, snap):
    rng = np.random.default_rng(11)
    offset = np.array(axis) * distance
    camera = turned(rng, near=0.5, far=20.0).translated(offset)
    scene = scene_of(np.array([[-10.0] * 3, [10.0] * 3]) + offset)
    settings = csm.ShadowSettings(map_size=1024, snap=snap, cascade_count=2)
    cascades = csm.fit_cascades(camera, csm.Sun((0.4, 0.8, 0.3)), settings, scene=scene)
    local = rng.uniform(-10, 10, size=(500, 3)).astype(np.float32)
    for i in range(2):
        texel = cascades.texel_size[i]
        # Truth in 64-bit mantissas, from the rotation and the window's corner.
        exact = (local.astype(np.longdouble) + offset) @ cascades.light_from_world[i][:2, :3].T
        corner = (-1 - cascades.clip_from_light[i][:2, 3]) / cascades.clip_from_light[i][
            [0, 1], [0, 1]
        ]
        if snap == "exact":
            corner = cascades.lattice[i] * texel.astype(np.longdouble)
        exact = (exact - corner) / texel
        # As documented in Cascades: 4 * 2^-52 of the distance, in texels, doubles all the way.
        bound = 1e-9 + 4 * 2.0**-52 * (np.linalg.norm(offset) + 20) / texel.min()
        world = spaces.transform_points(cascades.uvz_from_world[i], local + offset)
        moved = np.abs(local + offset - local.astype(np.longdouble) - offset).max() / texel.min()
        assert np.abs(world[:, :2] * 1024 - exact).max() <= bound + 2 * moved
        # As the GPU has it: float32 positions and matrix, relative to a fixed origin of the scene.
        uvz_from_local = cascades.uvz_from_world[i] @ spaces_translation(scene.origin)
        near_origin = (local + (offset - scene.origin)).astype(np.float32)
        rounded = uvz_from_local.astype(np.float32)
        gpu = (near_origin @ rounded[:2, :3].T + rounded[:2, 3]) * np.float32(1024)
        # Ten float32 roundings of sums below 2 in u, v and of positions of 17 m: the same 1e-3
        # texels at every offset (0.03 texels of float32 would be left at 1e4 m of world offset).
        error = np.abs(gpu - exact).max()
        figure(
            "X3", "place of a float32 vertex, as the GPU has it", error, 1e-3 + bound, "texels",
            picture=lambda off=(gpu - exact): drawings.chart(
                lambda axes: axes.plot(*off.astype(float).T, "."), size=(4, 4),
                title=f"texels off in u and v, {distance:g} m away",
            ),
        )  # fmt: skip


def spaces_translation(vector):
    matrix = np.eye(4)
    matrix[:3, 3] = vector
    return matrix


# -------------------------------------------------------------------------------------------------
# Depth range


@pytest.mark.parametrize("to_light", [(0, 1, 0), (1, 0, 0), (0.3, 0.5, -0.2), (1e-9, 1, 0)])
@pytest.mark.parametrize(
    "bounds",
    [
        [[-10, -1, -20], [10, 5, 30]],
        [[-10, 0, -20], [10, 0, 30]],
        [[1e6, 0, 1e6], [1e6 + 3e4, 2000, 1e6 + 2e4]],
    ],
    ids=["box", "flat", "far off"],
)
def test_depth_range_holds_the_scene_and_ignores_the_camera(to_light, bounds):
    rng = np.random.default_rng(12)
    scene = scene_of(bounds)
    ranges = []
    for _ in range(10):
        camera = turned(rng, eye=rng.normal(size=3) * 100 + scene.origin)
        cascades = csm.fit_cascades(camera, csm.Sun(to_light), csm.ShadowSettings(), scene=scene)
        ranges.append(cascades.depth_range)
    assert np.ptp(ranges, axis=(0, 1)).max() == 0.0
    near, far = ranges[0][0]
    grid = np.stack(np.meshgrid(*np.array(bounds, float).T), axis=-1).reshape(-1, 3)
    depth = -grid @ csm.Sun(to_light).to_light
    extent = np.ptp(bounds, axis=0).max()
    # Wide enough for float32 positions (2^-24 of the extent and a transform), and no wider than
    # float32 makes necessary.
    room = min((depth - near).min(), (far - depth).min())
    assert room >= 2.0**-21 * extent
    assert room <= 2.0**-19 * extent + 1e-6 * (far - near) + 1e-6


def test_without_a_scene_the_range_is_the_slice_and_as_much_towards_the_light():
    rng = np.random.default_rng(13)
    camera = turned(rng)
    sun = csm.Sun(rng.normal(size=3))
    for snap, slack in (("none", 1e-5), ("exact", 0.02)):
        cascades = csm.fit_cascades(camera, sun, csm.ShadowSettings(snap=snap))
        for i in range(4):
            _, radius = _core.fit_sphere(camera, *cascades.splits[i : i + 2])
            near, far = cascades.depth_range[i]
            assert far - near == pytest.approx(4 * radius, rel=slack)
            corners = oracles.camera_corners(camera, *cascades.splits[i : i + 2])
            depth = -corners @ sun.to_light
            assert near + 2 * radius * (1 - slack) <= depth.min()
            assert depth.max() <= far


def test_pancake_takes_the_slice_alone_unless_the_scene_is_shorter():
    rng = np.random.default_rng(14)
    settings = csm.ShadowSettings(pancake=True, view_range="camera")
    scene = scene_of([[-500, -300, -500], [500, 300, 500]])
    alone = np.zeros(4, int)
    for _ in range(50):
        sun = csm.Sun(rng.normal(size=3) + np.array([0.0, 2.0, 0.0]))
        camera = turned(rng, far=1000.0, eye=rng.uniform(-200, 200, 3))
        cascades = csm.fit_cascades(camera, sun, settings, scene=scene)
        whole = csm.fit_cascades(camera, sun, settings.replace(pancake=False), scene=scene)
        for i in range(4):
            centre, radius = _core.fit_sphere(camera, *cascades.splits[i : i + 2])
            length, most = np.diff(cascades.depth_range[i])[0], np.diff(whole.depth_range[i])[0]
            # One of 255 steps is spent on rounding near down, and some room on float32.
            assert length <= most
            assert min(2 * radius, most) <= length <= min(2 * radius * 1.005 + 0.01, most)
            if length == most:
                assert np.array_equal(cascades.depth_range[i], whole.depth_range[i])
                continue
            alone[i] += 1
            # The whole sphere is held, whichever way its slice is turned.
            depth = -(camera.eye - centre * camera.backward) @ sun.to_light
            assert cascades.depth_range[i, 0] < depth - radius
            assert depth + radius < cascades.depth_range[i, 1]
    assert alone[0] == 50
    assert alone[3] == 0


# -------------------------------------------------------------------------------------------------
# View range and splits


@pytest.fixture
def street():
    return scene_of([[-20, 0, -100], [20, 15, 10]])


def test_view_range_is_cut_to_the_scene_and_rounded_up(street):
    camera = csm.Camera.look_at((0, 2, 5), (0, 2, -90), near=0.1, far=1000, size=(16, 9))
    cascades = csm.fit_cascades(camera, csm.Sun((0, 1, 1)), csm.ShadowSettings(), scene=street)
    far = cascades.splits[-1]
    assert far == 0.1 * 2.0 ** (cascades.range_step / 4)
    assert 105 <= far < 105 * 1.001 * 2**0.25
    np.testing.assert_array_equal(cascades.splits, csm.split_distances(0.1, far, 4))
    farther = camera.translated((0, 0, 0.2 * far))
    before = csm.fit_cascades(farther, csm.Sun((0, 1, 1)), csm.ShadowSettings(), scene=street)
    assert before.range_step == cascades.range_step + 1
    held = csm.fit_cascades(
        camera, csm.Sun((0, 1, 1)), csm.ShadowSettings(), scene=street, held=before
    )
    assert held.range_step == cascades.range_step + 1
    assert held.splits[-1] == 0.1 * 2.0 ** (held.range_step / 4)


def test_view_range_never_exceeds_the_cameras(street):
    camera = csm.Camera.look_at((0, 2, 5), (0, 2, -90), near=0.1, far=50, size=(16, 9))
    cascades = csm.fit_cascades(camera, csm.Sun((0, 1, 1)), csm.ShadowSettings(), scene=street)
    assert cascades.splits[-1] == 50.0
    assert 0.1 * 2.0 ** (cascades.range_step / 4) >= 50.0


def test_a_camera_that_sees_nothing_gets_the_smallest_range(street):
    camera = csm.Camera.look_at((0, 2, 50), (0, 2, 90), near=0.1, far=1000)
    cascades = csm.fit_cascades(camera, csm.Sun((0, 1, 1)), csm.ShadowSettings(), scene=street)
    assert cascades.splits[-1] == 0.1 * 2**0.25
    assert_finite(cascades)


@pytest.mark.parametrize("given", ["camera range", "no scene"])
def test_view_range_of_the_camera(street, given):
    camera = csm.Camera.look_at((0, 2, 5), (0, 2, -90), near=0.1, far=1000)
    settings = csm.ShadowSettings(view_range="camera" if given == "camera range" else "scene")
    scene = street if given == "camera range" else None
    cascades = csm.fit_cascades(camera, csm.Sun((0, 1, 1)), settings, scene=scene)
    assert cascades.splits[0] == 0.1
    assert cascades.splits[-1] == 1000.0
    assert cascades.range_step is None


def test_manual_splits_are_taken_as_given_and_widen_a_cut_range(street):
    camera = csm.Camera.look_at((0, 2, 5), (0, 2, -90), near=0.1, far=1000)
    settings = csm.ShadowSettings(split="manual", cascade_count=4, manual_splits=(1.5, 30, 200))
    cascades = csm.fit_cascades(camera, csm.Sun((0, 1, 1)), settings, scene=street)
    assert cascades.splits[:-1].tolist() == [0.1, 1.5, 30.0, 200.0]
    assert 200 < cascades.splits[-1] < 200 * 2**0.25


@pytest.mark.parametrize("inner", [(0.1, 5, 9), (0.05, 5, 9), (1, 5, 1000), (1, 5, 1e9)])
def test_manual_splits_outside_the_range_are_refused(inner):
    camera = csm.Camera.look_at((0, 2, 5), (0, 2, -90), near=0.1, far=1000)
    settings = csm.ShadowSettings(split="manual", manual_splits=inner)
    with pytest.raises(ValueError, match=r"manual_splits must ascend between .* 0.1 and far 1000"):
        csm.fit_cascades(camera, csm.Sun((0, 1, 1)), settings)


def test_orthographic_near_behind_the_camera(street):
    camera = csm.Camera.orthographic((0, 2, 5), (0, 2, -90), height=6, near=-10, far=500)
    sun = csm.Sun((0, 1, 1))
    for split in ("practical", "logarithmic"):
        with pytest.raises(ValueError, match=f"near must be > 0 for split {split} .got near -10"):
            csm.fit_cascades(camera, sun, csm.ShadowSettings(split=split), scene=street)
    cascades = csm.fit_cascades(camera, sun, csm.ShadowSettings(split="uniform"), scene=street)
    # Cut to the scene's far wall at z = -100, not rounded.
    assert cascades.splits[-1] == pytest.approx(105.0, rel=1e-5)
    assert cascades.range_step is None
    assert_covers(camera, cascades, 0, np.random.default_rng(15), scene=street)


# -------------------------------------------------------------------------------------------------
# The Python face


CAMERA = csm.Camera.look_at((0, 2, 5), (0, 2, -90), near=0.1, far=1000)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"map_size": 1}, "map_size must be > 1 for a kernel radius of 0 texels with snap exact"),
        ({"map_size": 15, "filter": "pcf", "filter_size": 15}, "map_size must be > 15 .* 7 texels"),
        ({"cascade_count": 9}, "cascade_count"),
        ({"lam": 2.0}, "lam"),
    ],
)
def test_settings_that_cannot_be_fitted_are_refused(changes, text):
    with pytest.raises(ValueError, match=text):
        csm.fit_cascades(CAMERA, csm.Sun((0, 1, 0)), csm.ShadowSettings(**changes))


@pytest.mark.parametrize("bounds", [[0, 0, 0, 1, -1, 1], [np.nan, 0, 0, 1, 1, 1]])
def test_the_core_refuses_broken_bounds(bounds):
    with pytest.raises(ValueError, match="bounds must be finite"):
        _core.fit_cascades(CAMERA, (0, 1, 0), csm.ShadowSettings(), bounds)


@pytest.mark.parametrize("receivers", [np.zeros(3), np.zeros((4, 2)), [["a", "b", "c"]]])
def test_receivers_must_be_points(receivers):
    with pytest.raises(ValueError, match=r"receivers must be \(m, 3\)"):
        csm.fit_cascades(CAMERA, csm.Sun((0, 1, 0)), csm.ShadowSettings(), receivers=receivers)


def test_cascades_are_frozen_and_survive_pickling():
    cascades = csm.fit_cascades(CAMERA, csm.Sun((0, 1, 0)), csm.ShadowSettings())
    again = pickle.loads(pickle.dumps(cascades))
    for name in cascades.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(cascades, name))
    for each in (cascades, again):
        with pytest.raises(AttributeError):
            each.splits = np.zeros(5)
        with pytest.raises(ValueError, match="read-only"):
            each.texel_size[0, 0] = 1.0
    assert cascades.clip_from_world.strides == (128, 8, 32)
    assert cascades.lattice.dtype == np.int64
    assert cascades.splits.shape == (5,)
    assert "count=4" in repr(cascades)
