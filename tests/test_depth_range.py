"""Near and far of the maps: the four modes of [MSDN] (docs/numerics.md 19), and what a static
point's stored depth does in each."""

import itertools

import numpy as np
import pytest
from views import clip_points, scene_of, turned

import csm
from csm import shapes, spaces

LEVELS = {"d16": 2**16 - 1, "d24": 2**24 - 1, "d32f": 2**24}
SUN = csm.Sun((0.4, 0.8, 0.3))


def settings_for(mode, **more):
    if mode == "pancake":
        return csm.ShadowSettings(pancake=True, **more)
    by_hand = {"manual_depth_range": (-80.0, 80.0)} if mode == "manual" else {}
    return csm.ShadowSettings(depth_range=mode, **by_hand, **more)


@pytest.mark.parametrize("depth_format", LEVELS)
@pytest.mark.parametrize("mode", ["pancake", "window", "manual", "scene"])
@pytest.mark.parametrize(
    "extent", [10.0, 1e4, *(pytest.param(span, marks=pytest.mark.slow) for span in (100.0, 1e3))]
)
def test_d3_static_points_keep_their_stored_depth(figure, mode, depth_format, extent):
    # Float32 has no even quanta: near moves by 1/256 of the span, exact in it, and a stored depth
    # by the rounding of its binade, half a quantum of 24 bits.
    rng = np.random.default_rng(50)
    settings = settings_for(mode, depth_format=depth_format, cascade_count=2, view_range="camera")
    scene = scene_of(np.array([[-9.0, -0.2, -9.0], [9.0, 0.4, 9.0]]) * extent)
    if mode == "pancake":
        scene = scene_of([[-9 * extent] * 3, [9 * extent] * 3])
    points = rng.uniform(-1, 1, size=(300, 3)) * np.array([1, 0.1, 1]) * extent / 20
    camera = turned(rng, near=0.01 * extent, far=extent)
    quanta, first, held, changed, moved = LEVELS[depth_format], {}, None, 0, set()
    for _ in range(150):
        camera = camera.translated(rng.normal(size=3) * extent / 150)
        held = csm.fit_cascades(camera, SUN, settings, scene=scene, held=held)
        span = -1 / held.clip_from_light[1, 2, 2]
        near = held.depth_range[1, 0]
        z = clip_points(held, 1, points)[:, 2]
        inside = (z > 0) & (z < 1)
        if depth_format == "d32f":
            stored, tolerance = z.astype(np.float32).astype(np.float64), 2.0**-24 * 1.01
            decided = np.ones(len(z), bool)
        else:
            stored, tolerance = np.round(z * quanta) / quanta, 1e-3 / quanta
            decided = np.abs(z * quanta % 1 - 0.5) > 1e-3
        decoded = np.where(inside & decided, near / span + stored, np.nan)
        before = first.setdefault(span, decoded.copy())
        both = np.isfinite(before) & np.isfinite(decoded)
        changed += np.count_nonzero(np.abs(decoded - before)[both] > tolerance)
        np.copyto(before, decoded, where=np.isnan(before))
        moved.add(near)
    figure("D3", f"{mode}: decoded depths that changed", changed, 0, "points")
    figure("D3", f"{mode}: spans on a path", len(first), 4 if mode == "window" else 1, "spans")
    if mode in ("pancake", "window"):
        assert len(moved) > 3
    else:
        assert len(moved) == 1


def depths_in_window(cascades, i, bounds, rng):
    """Light-view depths of points of the scene's box that a map covers."""
    points = rng.uniform(bounds[0], bounds[1], size=(20000, 3))
    grid = np.array(list(itertools.product(*np.linspace(bounds[0], bounds[1], 9).T)))
    points = np.concatenate([points, grid])
    inside = (np.abs(clip_points(cascades, i, points)[:, :2]) <= 1).all(axis=1)
    return -spaces.transform_points(cascades.light_from_world[i], points[inside])[:, 2]


@pytest.mark.parametrize("basis", ["orthonormal", "world"])
@pytest.mark.parametrize("snap", ["exact", "none", "approximate"])
def test_d3_the_window_range_holds_the_scene_over_the_window(figure, snap, basis):
    rng = np.random.default_rng(51)
    settings = settings_for("window", snap=snap, light_basis=basis)
    outside, longest, shorter = 0, 0.0, 0
    for _ in range(20):
        scene = scene_of([[-300, 0, -200], [300, rng.uniform(1, 60), 250]])
        camera = turned(rng, eye=rng.uniform(-80, 80, 3))
        sun = csm.Sun(rng.normal(size=3) + np.array([0, 2, 0]))
        cascades = csm.fit_cascades(camera, sun, settings, scene=scene)
        whole = csm.fit_cascades(camera, sun, settings.replace(depth_range="scene"), scene=scene)
        for i in range(4):
            near, far = cascades.depth_range[i]
            depths = depths_in_window(cascades, i, scene.bounds, rng)
            outside += np.count_nonzero((depths < near) | (depths > far))
            shorter += far - near < 0.9 * np.ptp(whole.depth_range[i])
            assert far - near <= np.ptp(whole.depth_range[i])
            if len(depths) > 2000 and snap == "none":
                longest = max(longest, (far - near) / np.ptp(depths))
    # Under a skew depth is height alone, so that the whole scene's range is as short.
    assert shorter > 20 or basis == "world"
    figure("D3", "window: points outside the range", outside, 0, "points")
    if snap == "none":
        # sampling finds the ends to a few percent
        figure("D3", "window: span against what was sampled", longest, 1.3, "times")


def test_a_window_that_misses_the_scene_takes_the_scenes_range():
    camera = turned(np.random.default_rng(52), eye=(5e4, 0, 0))
    scene = scene_of([[-30, 0, -20], [30, 9, 25]])
    ranges = [
        csm.fit_cascades(camera, SUN, settings_for(mode), scene=scene).depth_range
        for mode in ("window", "scene")
    ]
    np.testing.assert_array_equal(*ranges)


def test_a_range_by_hand_is_taken_as_given_and_checked():
    camera = turned(np.random.default_rng(53))
    scene = scene_of([[-30, 0, -20], [30, 9, 25]])
    settings = settings_for("manual").replace(manual_depth_range=(-3.0, 4.0))
    cascades = csm.fit_cascades(camera, SUN, settings, scene=scene)
    np.testing.assert_array_equal(cascades.depth_range, [[-3.0, 4.0]] * 4)
    problems = csm.check_cascades(cascades, camera, scene=scene).problems
    assert "depth" in {problem.kind for problem in problems}
    for bad in ((4.0, -3.0), (1.0, 1.0), (0.0, np.inf), (1.0,)):
        with pytest.raises(ValueError, match="manual_depth_range"):
            settings.replace(manual_depth_range=bad)


@pytest.fixture(scope="module")
def yard():
    """A ground with blocks and, behind the camera, a tower that throws its shadow into view."""
    rng = np.random.default_rng(5)
    lower = rng.uniform((-26, 0, -26), (24, 0, 24), size=(40, 3))
    upper = lower + rng.uniform((0.3, 0.4, 0.3), (4, 5, 4), size=(40, 3))
    tower = shapes.boxes(np.array([[-3.0, 0, 27]]), np.array([[3.0, 25, 29]]))
    return csm.Scene(
        [
            shapes.mesh("ground", shapes.ground(30.0)),
            shapes.mesh("blocks", shapes.boxes(lower, upper)),
            shapes.mesh("tower", tower),
        ]
    )


CAMERA = csm.Camera.look_at((0, 3, 24), (0, 1, 0), near=0.3, far=200, size=(240, 135))
BEHIND = csm.Sun((0.05, 0.7, 0.6))  # from behind the camera, over the tower


@pytest.mark.parametrize("mode", ["window", "pancake", "manual"])
def test_g1_casters_behind_the_camera_shadow_in_every_mode(figure, renderer, yard, mode):
    frames = [
        renderer.render(yard, CAMERA, BEHIND, settings_for(each, map_size=512))
        for each in ("scene", mode)
    ]
    without = renderer.render(
        csm.Scene(yard.meshes[:2]), CAMERA, BEHIND, settings_for("scene", map_size=512)
    )
    seen = frames[0].valid
    # the tower's shadow is a good part of the picture
    assert np.mean(frames[0].mask[seen] < without.mask[seen]) > 0.02
    different = np.mean(frames[0].mask[seen] != frames[1].mask[seen])
    # The quantum differs, so compares within a quantum of equal may change.
    figure("G1", f"{mode}: pixels unlike the whole scene's range", different, 2e-3, "share")


def test_what_lies_outside_a_range_by_hand_is_clipped(renderer, yard):
    # Only the ground's own depths: the casters above are lost.
    heights = csm.ShadowSettings(
        map_size=256, depth_range="manual", manual_depth_range=(-0.5, 100.0), light_basis="world"
    )
    frame = renderer.render(yard, CAMERA, csm.Sun((0, 1, 0)), heights, outputs=("shadow_maps",))
    for i in range(4):
        stored = frame.shadow_maps[i]
        depth = -0.5 + stored[stored < 1] * 100.5
        assert depth.min() >= -0.5
    # Receivers outside are in no map: lit, and said so.
    none = heights.replace(manual_depth_range=(500.0, 600.0))
    frame = renderer.render(yard, CAMERA, csm.Sun((0, 1, 0)), none)
    assert (frame.cascade_index[frame.valid] == 255).all()
