"""snap="approximate": few window sizes on one lattice (docs/numerics.md 19; listing 4.1.2 of
[Zhang2009], whose offset is rounded up without a margin and loses up to a texel)."""

import numpy as np
import oracles
import pytest
from views import clip_points, misses, scene_of, turned

import csm
from csm import _core

LINEAR, GEOMETRIC = 0, 1
SPACINGS = {"linear": LINEAR, "geometric": GEOMETRIC}
BASE = 200.0
SCENE = scene_of([[-100, -5, -100], [100, 15, 100]])
OVERHEAD = csm.Sun((0, 1, 0))  # the scene is 200 m wide, seen from here


def camera_at(turn, eye=(0.0, 0.0, 0.0), far=30.0, tilt=-0.15):
    ahead = np.array([np.cos(turn), tilt, np.sin(turn)])
    eye = np.array(eye) + np.array([0, 2.0, 0])
    return csm.Camera.look_at(eye, eye + ahead, fov_y_deg=60, near=0.5, far=far, size=(16, 9))


def settings_for(spacing, levels, hysteresis=0, **more):
    values = dict(
        snap="approximate", level_spacing=spacing, level_count=levels, level_hysteresis=hysteresis,
        fit="box", map_size=256, cascade_count=2, view_range="camera", filter="pcf", filter_size=3,
    )  # fmt: skip
    return csm.ShadowSettings(**{**values, **more})


def raw_ratios(camera, cascades, padding=1, size=256):
    """(n, 2) share of the base that each window needs, by the formula: extent S / (S - 1 - 2p)."""
    out = []
    for i in range(cascades.count):
        corners = oracles.camera_corners(camera, *cascades.splits[i : i + 2])
        extent = np.ptp(corners @ cascades.light_from_world[i][:2, :3].T, axis=0)
        out.append(extent * size / (size - 1 - 2 * padding) / BASE)
    return np.array(out)


def least_level(ratio, spacing, levels):
    """(level, size) that is at least ratio, by search from the definition."""
    if spacing == "linear":
        level = next(c for c in range(1, 10 * levels) if c / levels >= ratio * (1 - 1e-12))
        return level, level / levels
    level = next(
        k for k in range(-4 * levels, levels) if 2 ** (8 * k / levels) >= ratio * (1 - 1e-12)
    )
    return level, 2 ** (8 * level / levels)


@pytest.mark.parametrize("hysteresis", [0, 2])
@pytest.mark.parametrize("levels", [16, 64, 256])
@pytest.mark.parametrize("spacing", SPACINGS)
def test_a1_windows_take_few_sizes_on_one_lattice(figure, spacing, levels, hysteresis):
    settings = settings_for(spacing, levels, hysteresis)
    rng = np.random.default_rng(40)
    held, missed, excess, off, beyond = None, 0, 0.0, 0.0, 0.0
    for frame in range(150):
        turn = 0.01 * frame
        camera = camera_at(turn, eye=(1.5 * np.cos(turn), 0, 1.5 * np.sin(turn)))
        held = csm.fit_cascades(camera, OVERHEAD, settings, scene=SCENE, held=held)
        missed += misses(camera, held, 1, rng, scene=SCENE, samples=10)
        ratio = held.texel_size * 256 / BASE
        raw = raw_ratios(camera, held)
        # Never smaller than asked: the scale, base over window, is never above the raw one.
        excess = max(excess, (raw / ratio).max() - 1)
        for (i, axis), value in np.ndenumerate(ratio):
            level, size = least_level(raw[i, axis], spacing, levels)
            allowed = [
                (level + h) / levels if spacing == "linear" else size * 2 ** (8 * h / levels)
                for h in range(hysteresis + 1)
            ]
            off = max(off, min(abs(value / each - 1) for each in allowed))
        scale = held.clip_from_light[:, [0, 1], [0, 1]]
        corner = (-1 - held.clip_from_light[:, :2, 3]) / scale
        beyond = max(beyond, np.abs(corner / held.texel_size - held.lattice).max())
    figure("A1", "points outside their window", missed, 0, "points")
    figure("A1", "scale above the raw one", excess, 1e-12, "relative")
    figure("A1", "scale outside the level set", off, 1e-9, "relative")
    figure("A1", "window's corner from whole texels", beyond, 1e-9, "texels")


def turning(spacing, levels, hysteresis, frames=1000):
    """Sizes of the last cascade along x while the camera turns 0.01 rad a frame."""
    settings = settings_for(spacing, levels, hysteresis, cascade_count=1)
    held, sizes, raw = None, [], []
    for frame in range(frames):
        camera = camera_at(0.01 * frame)
        held = csm.fit_cascades(camera, OVERHEAD, settings, scene=SCENE, held=held)
        sizes.append(float(held.texel_size[0, 0]))
        raw.append(raw_ratios(camera, held)[0, 0])
    changes = np.count_nonzero(np.diff(sizes))
    return len(set(sizes)), changes, len(set(np.round(raw, 12)))


def test_a1_levels_along_a_turning_path(figure):
    # 1000 frames want hundreds of sizes and get a handful; hysteresis halves the changes.
    few, changes, wanted = turning("linear", 64, 0)
    _, calmer, _ = turning("linear", 64, 2)
    assert wanted > 500
    figure("A1", "sizes on a turning path, 64 linear levels", few, 20, "sizes")
    figure("A1", "frames that change the size, of 999", changes, 150, "frames")
    figure("A1", "the same with a hysteresis of 2, against without", calmer / changes, 0.8, "times")


def test_a1_a_size_keeps_its_texels_phase_wherever_the_camera_is(figure):
    settings = settings_for("geometric", 64)
    rng = np.random.default_rng(41)
    points = rng.uniform(-20, 20, size=(50, 3))
    first, moved = {}, 0.0
    for _ in range(200):
        camera = camera_at(rng.uniform(0, 7), eye=rng.uniform(-20, 20, 3) * [1, 0, 1])
        cascades = csm.fit_cascades(camera, OVERHEAD, settings, scene=SCENE)
        for i in range(2):
            places = clip_points(cascades, i, points)[:, :2] * 128 + 128 + cascades.lattice[i]
            before = first.setdefault(tuple(cascades.texel_size[i]), places)
            moved = max(moved, np.abs(places - before).max())
    assert len(first) < 60
    figure("A1", "phase of fixed points at one size", moved, 1e-9, "texels")


def test_a1_the_printed_offset_loses_up_to_a_texel(figure):
    # Listing 4.1.2: ceil of the offset, in texels, with no margin. Rounding with a margin loses
    # nothing (above).
    rng = np.random.default_rng(42)
    lost = 0.0
    for _ in range(500):
        low, high = np.sort(rng.uniform(-1, 1, 2))
        scale = 64 / np.ceil(64 / (2 / (high - low)))
        offset = np.ceil(-0.5 * (high + low) * scale * 128) / 128
        lost = max(lost, (high * scale + offset - 1) * 128, (-1 - (low * scale + offset)) * 128)
    assert lost > 0.5
    figure("A1", "texels that the printed offset loses", lost, 1.0, "texels")


@pytest.mark.parametrize("spacing", SPACINGS)
def test_levels_hold_and_let_go(spacing):
    for ratio in np.geomspace(1e-3, 3, 50):
        size, level = _core.snap_level(ratio, SPACINGS[spacing], 64)
        assert size >= ratio
        below = (level - 1) / 64 if spacing == "linear" else 2 ** ((level - 1) / 8)
        assert below < ratio
        for held in range(level - 2, level + 5):
            kept = held if level < held <= level + 2 else level
            assert _core.snap_level(ratio, SPACINGS[spacing], 64, 2, held)[1] == kept
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="ratio must be > 0"):
            _core.snap_level(bad, SPACINGS[spacing], 64)


@pytest.mark.parametrize("fit", ["sphere", "box", "diameter", "scene", "clipped", "focus"])
@pytest.mark.parametrize("basis", ["orthonormal", "world"])
def test_a1_every_fit_and_basis_takes_levels(figure, fit, basis):
    rng = np.random.default_rng(43)
    settings = settings_for("geometric", 64, fit=fit, light_basis=basis)
    missed = 0
    for number in range(20):
        camera, sun = turned(rng, eye=rng.normal(size=3) * 20), csm.Sun((0.3, 0.8, 0.1 * number))
        for scene in (SCENE, None):
            cascades = csm.fit_cascades(camera, sun, settings, scene=scene)
            if fit not in ("clipped", "focus"):
                missed += misses(camera, cascades, 1, rng, scene=scene, samples=10)
            corner = cascades.lattice * cascades.texel_size
            scale = cascades.clip_from_light[:, [0, 1], [0, 1]]
            np.testing.assert_allclose(
                (-1 - cascades.clip_from_light[:, :2, 3]) / scale, corner, rtol=1e-12, atol=1e-9
            )
    figure("A1", f"{fit}: points outside their window", missed, 0, "points")


def test_a_scene_of_one_point_has_no_levels():
    scene = scene_of([[1, 1, 1], [1, 1, 1]])
    with pytest.raises(ValueError, match="snap approximate has no level"):
        csm.fit_cascades(camera_at(0), OVERHEAD, settings_for("linear", 64), scene=scene)
