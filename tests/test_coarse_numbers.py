"""What is read from coarse frames in the core, against numpy on whole arrays."""

from types import SimpleNamespace

import numpy as np
import pytest

import csm
from csm import _core
from csm.caster_load import Casters
from csm.coarse_look import facing_of, look_at_pixels, receivers_of
from csm.sampling import surface_steps
from csm.spaces import light_gradients

SUN = csm.Sun((0.4, 1.0, -0.3))
SIZES = [(1, 1), (7, 3), (16, 9), (129, 70)]  # width, height


def camera_of(size, orthographic=False):
    camera = csm.Camera.look_at((3, 2, 5), (1, 1, -4), fov_y_deg=50, near=0.5, far=300, size=size)
    return camera.replace(orthographic=True) if orthographic else camera


def frame_of(size, seed=0):
    """A frame of noise, with pixels of every kind."""
    rng, shape = np.random.default_rng(seed), size[::-1]
    normal = rng.normal(size=(*shape, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    turns = csm.fit_cascades(camera_of(size), SUN, csm.ShadowSettings()).light_from_world
    return SimpleNamespace(
        valid=rng.random(shape) < 0.9,
        normal=normal.astype(np.float32),
        mask=rng.choice(np.array([0.0, 0.25, 0.5, 1.0], np.float32), shape),
        cascade_index=rng.choice(np.array([0, 1, 2, 3, 255], np.uint8), shape),
        view_depth=rng.uniform(1.0, 90.0, shape).astype(np.float32),
        cascades=SimpleNamespace(light_from_world=turns),
    )


# -- pixels ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", SIZES)
def test_pixels_are_counted_as_by_numpy(size):
    frame = frame_of(size)
    look = look_at_pixels(frame, SUN, 4)
    facing = frame.valid & (frame.normal.astype(float) @ SUN.to_light > 1e-5)
    judged, lit = facing & (frame.cascade_index != 255), frame.mask >= 0.5
    assert np.array_equal(look.facing, facing)
    assert np.array_equal(facing_of(frame, SUN), facing)
    assert np.array_equal(look.judged, judged)
    assert np.array_equal(look.lit, lit)
    assert look.seen_count == np.count_nonzero(frame.valid)
    assert look.facing_count == np.count_nonzero(facing)
    assert look.shadowed_count == np.count_nonzero(judged & ~lit)
    index = frame.cascade_index[facing]
    assert look.cascade_counts == tuple(np.count_nonzero(index == i) for i in range(4))
    other = np.random.default_rng(1).random(lit.shape) < 0.5
    wanted = np.count_nonzero(judged & (lit != other))
    assert _core.coarse_changed(judged, lit, other) == wanted


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("size", SIZES)
def test_receivers_are_every_so_manieth(size, orthographic):
    frame, camera = frame_of(size), camera_of(size, orthographic)
    look = look_at_pixels(frame, SUN, 4)
    found = receivers_of(camera, frame, look, SUN)
    stride = max(1, -(-look.facing_count // 2000))
    assert size != SIZES[-1] or stride > 1
    rows, columns = (axis[::stride] for axis in np.nonzero(look.facing))
    x, y = camera.pixel_plane()
    across = x[columns, None] * camera.right + y[rows, None] * camera.up
    depth = frame.view_depth[rows, columns].astype(float)
    ahead = -depth[:, None] * camera.backward
    point = camera.eye + ahead + (across if orthographic else depth[:, None] * across)
    normal = frame.normal[rows, columns].astype(float)
    cosine = np.clip(normal @ SUN.to_light, 1e-5, 1.0)
    in_light = np.abs(normal @ frame.cascades.light_from_world[0][:2, :3].T)
    assert found["point"] == pytest.approx(point, rel=1e-12)
    assert np.array_equal(found["depth"], depth)
    # where a normal lies along the light to 1e-8, its slope is rounding
    assert found["slope"] == pytest.approx(np.sqrt(1 / cosine**2 - 1), rel=1e-9, abs=1e-7)
    assert found["gradient"] == pytest.approx(in_light.sum(axis=1) / cosine, rel=1e-9)
    assert np.array_equal(found["cascade"], frame.cascade_index[rows, columns])
    assert np.array_equal(found["dark"], frame.mask[rows, columns] < 0.5)


def test_none_that_faces_the_sun_gives_none():
    frame = frame_of((9, 5))
    frame.valid[:] = False
    look = look_at_pixels(frame, SUN, 4)
    assert (look.seen_count, look.facing_count, look.cascade_counts) == (0, 0, (0, 0, 0, 0))
    assert receivers_of(camera_of((9, 5)), frame, look, SUN)["point"].shape == (0, 3)


# -- numbers ---------------------------------------------------------------------------------------


def numbers(kind, count):
    rng = np.random.default_rng(count)
    return {
        "noise": rng.normal(size=count),
        "equal": np.full(count, 3.5),
        "few": rng.integers(0, 4, count).astype(float),
        "sorted": np.arange(count, dtype=float),
        "falling": -np.arange(count, dtype=float),
        "endless": np.where(rng.random(count) < 0.2, np.inf, rng.random(count)),
    }[kind]


@pytest.mark.parametrize("count", [1, 2, 16, 17, 40, 2000])
@pytest.mark.parametrize("kind", ["noise", "equal", "few", "sorted", "falling", "endless"])
def test_percentiles_are_those_of_numpy(kind, count):
    values, at = numbers(kind, count), (0, 1, 50, 50, 90, 99, 100, 20)
    before = values.copy()
    with np.errstate(invalid="ignore"):  # between two that are endless
        wanted = np.percentile(values, at)
    assert np.array_equal(_core.percentiles(values, at), wanted, equal_nan=True)
    assert np.array_equal(values, before)


def test_what_is_no_number_counts_as_greatest():
    values = np.array([np.nan, 3.0, 1.0, np.nan, 2.0] * 9)
    ordered = np.sort(values)
    found = _core.percentiles(values, (0, 25, 50, 75, 100))
    assert np.array_equal(found, ordered[[0, 11, 22, 33, 44]], equal_nan=True)
    assert np.array_equal(_core.percentiles(np.empty(0), (50, 90)), (0.0, 0.0))


@pytest.mark.parametrize("count", [1, 5, 3000])
@pytest.mark.parametrize("same", [False, True])
def test_depths_are_counted_as_by_numpy(count, same):
    depths = np.exp(np.random.default_rng(count).uniform(-3, 7, count))
    depths = np.full(count, depths[0]) if same else depths
    edges, counts = _core.depth_histogram(depths)
    low, high = depths.min(), max(depths.max(), depths.min() * (1 + 1e-9))
    assert (edges[0], edges[-1]) == (low, high)
    assert edges == pytest.approx(np.geomspace(low, high, 25), rel=1e-13)
    assert np.array_equal(counts, np.histogram(depths, edges)[0])
    assert counts.sum() == count


def test_of_no_depths_there_are_none():
    edges, counts = _core.depth_histogram(np.empty(0))
    assert edges == pytest.approx(1.0)
    assert not counts.any()


@pytest.mark.parametrize("orthographic", [False, True])
def test_steps_along_surfaces_are_those_of_the_judge(orthographic):
    rng, camera = np.random.default_rng(3), camera_of((640, 360), orthographic)
    points = camera.eye + rng.uniform(-5, 5, (300, 3)) - 20.0 * camera.backward
    normals, axes = rng.normal(size=(300, 3)), light_gradients(SUN)
    normals[0] = axes[0]  # edge on to the light
    wanted = surface_steps(camera, points, normals, axes)
    # of a sum of three products that may cancel: against the largest of its parts
    scale = np.abs(wanted).max(axis=(1, 2), keepdims=True)
    found = _core.surface_steps(camera, points, normals, axes)
    assert (found / scale)[1:] == pytest.approx((wanted / scale)[1:], abs=1e-11)
    assert np.abs(found[0]).max() > 1e12


# -- casters ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, 1, 300, 1500])
def test_boxes_across_the_light_are_those_of_numpy(count):
    rng = np.random.default_rng(count)
    x, y = rng.normal(size=(2, 3, count))
    side = rng.choice([-1.0, 1.0], count)
    centre, half, area = _core.casters_across(x, y, side)
    at = np.stack([x, y], axis=-1)
    low, high = (at.min(axis=0), at.max(axis=0)) if count else (at[0], at[0])
    assert np.array_equal(centre, 0.5 * (low + high))
    assert np.array_equal(half, 0.5 * (high - low))
    one, two = at[1] - at[0], at[2] - at[0]
    assert np.array_equal(area, 0.5 * side * (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]))


@pytest.mark.parametrize("count", [0, 5, 700, 4000])
def test_casters_are_thinned_as_by_hand(count):
    """Equal areas, and some that differ in the last bits alone, among them."""
    rng = np.random.default_rng(count)
    centre, half = rng.uniform(-2, 2, (count, 2)), rng.uniform(0, 0.1, (count, 2))
    area = rng.choice([1.0, 2.5, -2.5, 1e-300, 0.0], count)
    area *= 1.0 + 2.0**-52 * rng.integers(0, 9, count)
    area[::2] = rng.normal(size=len(area[::2]))
    windows = np.tile(np.eye(4), (3, 1, 1))
    for window, wide in zip(windows, (0.5, 1.2, 2.6), strict=True):
        window[0, 0] = window[1, 1] = 1.0 / wide
        window[:2, 3] = 0.5
    low, high = centre - half, centre + half
    inside = [((high > -0.5 * w) & (low < 0.5 * w)).all(axis=1) for w in (0.5, 1.2, 2.6)]
    kind = np.select(inside, [0, 1, 2], 3)
    kept, weight = [], []
    for number in range(4):
        among = sorted(np.flatnonzero(kind == number), key=lambda i: (-abs(area[i]), i))
        if len(among) <= 300:
            kept += sorted(among)
            weight += [1.0] * len(among)
            continue
        rest = among[75:]
        step = -(-len(rest) // 225)
        some = rest[step // 2 :: step]
        kept += among[:75] + some
        weight += [1.0] * 75 + [len(rest) / len(some)] * len(some)
    axes = np.eye(3)[:2]
    casters = Casters(axes, centre, half, area, np.zeros(count, bool), np.ones(count))
    numbers, found = _core.casters_thinned(casters, windows)
    assert numbers.tolist() == [int(i) for i in kept]
    assert found.tolist() == weight
    assert found.sum() == pytest.approx(count)
    assert count < 4000 or len(kept) < count


# -- refusals --------------------------------------------------------------------------------------


def test_what_does_not_fit_is_refused():
    frame, camera = frame_of((6, 4)), camera_of((6, 4))
    look = look_at_pixels(frame, SUN, 4)
    with pytest.raises(ValueError, match="cascade_count must be 1 to 8"):
        look_at_pixels(frame, SUN, 9)
    with pytest.raises(ValueError, match=r"view_depth: expected shape \(4, 5\)"):
        receivers_of(camera_of((5, 4)), frame, look, SUN)
    with pytest.raises(ValueError, match="other"):
        _core.coarse_changed(look.facing, look.lit, look.lit[1:])
    frame.normal = frame.normal[:, 1:]
    for read in (lambda: facing_of(frame, SUN), lambda: look_at_pixels(frame, SUN, 4)):
        with pytest.raises(ValueError, match="normal"):
            read()
    with pytest.raises(ValueError, match="percentiles from 0 to 100"):
        _core.percentiles(np.ones(3), (50, 101))
    with pytest.raises(ValueError, match="1 to 16 percentiles"):
        _core.percentiles(np.ones(3), ())
    for wrong in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(ValueError, match="depths must be positive and finite"):
            _core.depth_histogram(np.array([1.0, wrong]))
    with pytest.raises(ValueError, match="normals"):
        _core.surface_steps(camera, np.ones((3, 3)), np.ones((2, 3)), np.eye(3)[:2])
    with pytest.raises(ValueError, match="x"):
        _core.casters_across(np.ones((3, 4)), np.ones((3, 5)), np.ones(5))
