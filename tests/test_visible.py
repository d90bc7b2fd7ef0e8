"""Windows and ranges fitted to what is seen (docs/numerics.md 22), against traced receivers."""

import numpy as np
import pytest

import csm
from csm import _core, shapes

SIZE = (96, 54)
SUNS = {"high": (0.3, 0.9, 0.25), "grazing": (0.9, 0.12, 0.3), "below the camera": (0.1, 0.4, -1)}


def yard(offset=(0.0, 0.0, 0.0), seed=3):
    """A ground with blocks on it, 60 m wide."""
    rng = np.random.default_rng(seed)
    lower = rng.uniform((-26, 0, -26), (24, 0, 24), size=(60, 3))
    upper = lower + rng.uniform((0.3, 0.4, 0.3), (4, 5, 4), size=(60, 3))
    blocks = shapes.mesh("blocks", shapes.boxes(lower, upper))
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(30.0)), blocks])
    if not np.any(offset):
        return scene
    vertices = [mesh.positions + np.asarray(offset) for mesh in scene.meshes]
    parts = [
        csm.Scene.from_arrays(positions, mesh.triangles)
        for positions, mesh in zip(vertices, scene.meshes, strict=True)
    ]
    return parts[0].merge(*parts[1:])


def cameras(offset=(0.0, 0.0, 0.0)):
    look, parallel = csm.Camera.look_at, csm.Camera.orthographic
    centred = {
        "eye level": look((3, 2, 22), (0, 1, 0), near=0.3, far=200, size=SIZE),
        "down": look((0, 40, 0.1), (0, 0, 0), near=1, far=100, size=SIZE),
        "orthographic": parallel((20, 20, 20), (0, 0, 0), height=30, near=1, far=90, size=SIZE),
    }
    return {name: camera.translated(offset) for name, camera in centred.items()}


def judged(truth):
    return truth.valid & truth.facing


@pytest.mark.parametrize("sun", SUNS)
@pytest.mark.parametrize("camera", cameras())
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"snap": "none"},
        {"turned": True},
        {"select": "interval"},
        {"split": "sdsm"},
        {"split": "histogram", "turned": True},
        {"filter": "pcf", "filter_size": 7, "snap": "none"},
        {"filter": "pcf", "filter_size": 5, "turned": True, "select": "frustum"},
        {"cascade_count": 1, "turned": True},
        {"cascade_count": 8, "map_size": (256, 64, 64, 64, 32, 32, 32, 32)},
    ],
    ids=lambda changes: ",".join(f"{k}={v}" for k, v in changes.items()) or "default",
)
def test_c1_every_visible_receiver_has_a_map(renderer, figure, camera, sun, changes):
    scene, camera, sun = yard(), cameras()[camera], csm.Sun(SUNS[sun])
    settings = csm.ShadowSettings(fit="visible", map_size=256).replace(**changes)
    frame = renderer.render(scene, camera, sun, settings)
    truth = csm.truth(scene, camera, sun)
    seen = judged(truth) & frame.valid
    assert seen.any()
    figure("C1", "visible receivers in no map", (frame.cascade_index[seen] == 255).sum(), 0)
    # with the kernel inside its own window, by the matrices that are handed out
    border = settings.filter_size // 2 if settings.filter == "pcf" else 0
    border = 0 if settings.select == "frustum" else border
    outside = 0
    for i in range(settings.cascade_count):
        own = seen & (frame.cascade_index == i)
        uvz = csm.spaces.transform_points(frame.cascades.uvz_from_world[i], truth.position[own])
        inner = border / frame.cascades.map_size[i] - 1e-4
        outside += ((uvz[:, :2] < inner) | (uvz[:, :2] > 1 - inner)).any(axis=1).sum()
    figure("C1", "visible receivers outside their own map", outside, 0)


@pytest.mark.parametrize("camera", cameras())
@pytest.mark.parametrize("turned", [False, True])
def test_windows_are_as_tight_as_the_receivers_allow(renderer, camera, turned):
    """Half a pixel's footprint apart at most: both see the same pixel centres, so what is left is
    the margin for float32, 2^-20 of the scene's 60 m, on each side."""
    scene, camera, sun = yard(), cameras()[camera], csm.Sun(SUNS["high"])
    settings = csm.ShadowSettings(fit="visible", snap="none", map_size=256, turned=turned)
    frame = renderer.render(scene, camera, sun, settings)
    truth = csm.truth(scene, camera, sun)
    depth = -(truth.position - camera.eye) @ camera.backward
    compared = 0
    for i in range(4):
        low, high = frame.cascades.splits[i : i + 2]
        own = judged(truth) & (depth > low) & (depth <= high)
        near_split = judged(truth) & ((abs(depth - low) < 1e-3) | (abs(depth - high) < 1e-3))
        if own.sum() < 20 or near_split.any():
            continue
        light = csm.spaces.transform_points(frame.cascades.light_from_world[i], truth.position[own])
        extent = np.ptp(light[:, :2], axis=0)
        window = frame.cascades.texel_size[i] * frame.cascades.map_size[i]
        assert (window >= extent).all()
        least = 256 * 2.0**-20 * 61
        assert (window <= np.maximum(extent + 4 * 2.0**-20 * 61, least) * (1 + 1e-4)).all()
        compared += 1
    assert compared


def test_turned_windows_are_the_smallest_rectangles():
    """Against every angle in steps of 0.1 degrees, on points scattered in a slanted strip."""
    rng = np.random.default_rng(8)
    camera = csm.Camera.look_at((0, 60, 0.1), (0, 0, 0), near=1, far=100, size=SIZE)
    strip = rng.uniform((-25, 0, -2), (25, 0, 2), (400, 3))
    angle = np.radians(33)
    points = strip @ np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    sun = csm.Sun((0, 1, 0))
    base = csm.ShadowSettings(fit="visible", snap="none", cascade_count=1, view_range="camera")
    cascades = csm.fit_cascades(camera, sun, base.replace(turned=True), receivers=points)
    area = np.prod(cascades.texel_size[0] * cascades.map_size[0])
    flat = csm.spaces.transform_points(_core.light_basis(sun.to_light), points)[:, :2]
    turns = np.radians(np.arange(0, 90, 0.1))
    best = min(
        np.prod(np.ptp(flat @ [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]], axis=0))
        for a in turns
    )
    assert area <= best * (1 + 1e-3)
    plain = csm.fit_cascades(camera, sun, base, receivers=points)
    assert area < 0.5 * np.prod(plain.texel_size[0] * plain.map_size[0])


def test_points_and_pixels_fit_the_same_windows(renderer):
    scene, camera, sun = yard(), cameras()["eye level"], csm.Sun(SUNS["high"])
    truth = csm.truth(scene, camera, sun)
    for changes in ({}, {"split": "sdsm"}, {"cascade_count": 2}):
        settings = csm.ShadowSettings(fit="visible", map_size=256).replace(**changes)
        frame = renderer.render(scene, camera, sun, settings)
        fitted = csm.fit_cascades(
            camera, sun, settings, scene=scene, receivers=truth.position[judged(truth)]
        )
        np.testing.assert_allclose(fitted.splits, frame.cascades.splits, rtol=1e-6)
        np.testing.assert_allclose(fitted.texel_size, frame.cascades.texel_size, rtol=1e-9)
        assert np.abs(fitted.lattice - frame.cascades.lattice).max() <= 1


@pytest.mark.parametrize("power", [4, 6, 7])
def test_x3_far_from_the_origin(renderer, figure, power):
    offset = (10.0**power, 0, -(10.0**power))
    sun = csm.Sun(SUNS["high"])
    # without snapping the window goes along; a lattice has another phase there
    settings = csm.ShadowSettings(fit="visible", map_size=256, snap="none")
    here = renderer.render(yard(), cameras()["eye level"], sun, settings)
    there = renderer.render(yard(offset), cameras(offset)["eye level"], sun, settings)
    both = here.valid & there.valid
    assert (there.cascade_index[there.valid & (there.mask > 0)] != 255).all()
    different = (abs(here.mask - there.mask) > 0.5)[both].mean()
    figure("X3", "mask far away, fit visible", different, 1e-4, unit="share of pixels")


# -- motion ----------------------------------------------------------------------------------------


def test_sizes_in_motion_are_steps_and_held():
    """A creeping camera: quantised sizes change seldom, held ones less than free ones, and while a
    size stays the texel grid of the world does not move."""
    scene, sun = yard(), csm.Sun(SUNS["high"])
    settings = csm.ShadowSettings(fit="visible", map_size=256)
    changes = {True: 0, False: 0}
    for hold in changes:
        held, before = None, None
        for step in range(40):
            at = np.array([3 + 0.02 * np.sin(step), 2, 22 - 0.03 * step])
            ahead = at + np.array([0, -0.1, -2])
            camera = csm.Camera.look_at(at, ahead, near=0.3, far=200, size=SIZE)
            truth = csm.truth(scene, camera, sun)
            cascades = csm.fit_cascades(
                camera, sun, settings, scene=scene, receivers=truth.position[judged(truth)],
                held=held,
            )  # fmt: skip
            steps = 8 * np.log2(cascades.texel_size * (256 - 1) / 2)
            np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
            if before is not None:
                same = cascades.texel_size == before.texel_size
                changes[hold] += (~same).sum()
            held, before = (cascades if hold else None), cascades
    assert changes[True] < changes[False]


def test_nothing_seen_is_no_error(renderer):
    scene = yard()
    camera = csm.Camera.look_at((0, 5, 0), (0, 50, 1), near=0.3, far=200, size=SIZE)
    for split in ("practical", "sdsm", "histogram"):
        settings = csm.ShadowSettings(fit="visible", split=split, map_size=64)
        frame = renderer.render(scene, camera, csm.Sun(SUNS["high"]), settings)
        assert not frame.valid.any()
        assert (frame.mask == 1).all()
        assert np.isfinite(frame.cascades.uvz_from_world).all()


def test_without_receivers_it_says_what_is_missing():
    camera, sun = cameras()["down"], csm.Sun(SUNS["high"])
    with pytest.raises(ValueError, match="receivers"):
        csm.fit_cascades(camera, sun, csm.ShadowSettings(fit="visible"))


def test_off_is_absent():
    passes = {step.name for step in csm.plan(csm.ShadowSettings()).passes}
    assert not any("receiver" in name for name in passes)
    seen = csm.plan(csm.ShadowSettings(fit="visible", turned=True, split="sdsm"))
    names = [step.name for step in seen.passes]
    assert names.count("receiver_range") == 1
    assert names.count("receiver_bounds") == 2
