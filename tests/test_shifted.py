"""Spheres shifted along the view (Y1): when they can be, that they leave no gap, what they gain."""

import numpy as np
import oracles
import pytest
from views import misses, turned, uncovered

import csm
from csm import _core

SLOPES = [0.1, 0.3, 0.59, 0.8, 1.0, 1.18, 2.0, 2.9]
RATIOS = [1.05, 2.0, 3.0, 6.0, 30.0, 1000.0]


def lens(k, ratio, **changes):
    """A camera at the origin that looks down -z, 16:9, with k the slope of its corner rays."""
    half_height = k / np.hypot(16 / 9, 1)
    size, near = (16, 9), 1.0
    camera = csm.Camera(
        np.zeros(3), *np.eye(3), half_height * 16 / 9, half_height, near, ratio, size, False
    )
    return camera.replace(**changes)


def held(centres, radii, points):
    """Whether any sphere holds each point (right, up, depth), to 1e-12 of its radius."""
    distances = np.linalg.norm(points[:, None] - centres, axis=2)
    return (distances <= radii * (1 + 1e-12)).any(axis=1)


def whole_section(centre, radius, k):
    """View depths where a sphere on the axis holds a centred view's cross-section, from the roots
    of (1 + k^2) z^2 - 2 c z + c^2 - R^2."""
    a, c = 1 + k * k, centre
    root = np.sqrt(c * c - a * (c * c - radius * radius))
    return (c - root) / a, (c + root) / a


@pytest.mark.parametrize("k", SLOPES)
@pytest.mark.parametrize("ratio", RATIOS)
def test_y1_a_slice_shifts_only_beyond_the_hidden_condition(figure, k, ratio):
    camera = lens(k, ratio)
    centre, radius = _core.fit_sphere(camera, 1.0, ratio)
    shifted, same, first, last = _core.fit_shifted(camera, 1.0, ratio)
    assert same == radius
    possible = k * k > (ratio - 1) / (ratio + 1)
    # k^2 = 1 and the ratios of the table meet nowhere, so the sign is beyond doubt.
    assert (shifted > centre * (1 + 1e-9)) == possible
    if possible:
        expected = 1 + np.sqrt(radius**2 - k * k)
        figure("Y1", "centre from n + sqrt(R^2 - k^2 n^2)", abs(shifted / expected - 1), 1e-9)
        section = whole_section(shifted, radius, k)
        miss = max(abs(max(section[0], 0.0) - first), abs(section[1] - last)) / ratio
        figure("Y1", "whole cross-section from its roots", miss, 1e-9, "of far")


@pytest.mark.parametrize("points", [3000, pytest.param(100_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("k", SLOPES)
@pytest.mark.parametrize("count", range(1, 7))
def test_y1_a_chain_leaves_no_gap(figure, k, count, points):
    rng = np.random.default_rng(50)
    late = loss = -1.0
    gaps = 0
    for ratio in RATIOS:
        camera = lens(k, ratio)
        splits = csm.split_distances(1.0, ratio, count, lam=0.5 + 0.5 * (count % 2))
        centres, radii, whole = _core.fit_spheres(camera, splits, True)
        plain, plain_radii, _ = _core.fit_spheres(camera, splits, False)
        assert np.array_equal(radii, plain_radii)
        assert (centres[:, 2] >= plain[:, 2]).all()
        late = max(late, (whole[1:, 0] - whole[:-1, 1]).max(initial=-1) / ratio)
        loss = max(loss, whole[0, 0] - 1.0, (ratio - whole[-1, 1]) / ratio)
        half = points // 2
        depth = np.concatenate([rng.uniform(1, ratio, half), ratio ** rng.uniform(0, 1, half)])
        depth = np.concatenate([depth, splits, whole.ravel().clip(1, ratio)])
        share = rng.uniform(-1, 1, (len(depth), 2))
        for side in (np.sign(share), share):  # corner rays, then inside
            across = side * [camera.half_width, camera.half_height] * depth[:, None]
            gaps += np.count_nonzero(~held(centres, radii, np.c_[across, depth]))
    figure("Y1", "z_in(i+1) beyond z_out(i)", late, 1e-9, "of far")
    figure("Y1", "chain short of near or far", loss, 1e-9, "relative")
    figure("Y1", "points in no sphere", gaps, 0, "points")


def utilisation(camera, sun, fit, i):
    """Share of a map's texels whose column meets what map i serves of the view: from where finer
    maps end to hold it whole. Columns are sampled along the light."""
    settings = csm.ShadowSettings(fit=fit, lam=1.0, cascade_count=3, snap="none")
    cascades = csm.fit_cascades(camera, sun, settings)
    _, _, whole = _core.fit_spheres(camera, cascades.splits, fit == "shifted")
    first = cascades.splits[0] if i == 0 else whole[i - 1, 1]
    planes = oracles.camera_planes(camera, first, camera.far)
    grid = (np.arange(64) + 0.5) / 32 - 1
    uv = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    world_from_clip = np.linalg.inv(cascades.clip_from_world[i])
    start = np.c_[uv, np.zeros(len(uv)), np.ones(len(uv))] @ world_from_clip[:3].T
    # The part of each line inside all planes.
    height = start @ planes[:, :3].T + planes[:, 3]
    slope = planes[:, :3] @ sun.to_light
    with np.errstate(divide="ignore"):
        at = -height / slope
    low = np.where(slope > 0, at, -np.inf).max(axis=1)
    high = np.where(slope < 0, at, np.inf).min(axis=1)
    outside = ((np.abs(slope) < 1e-12) & (height < 0)).any(axis=1)
    return np.mean((low <= high) & ~outside)


@pytest.mark.parametrize("ratio", [3.0, 30.0, 1000.0])
def test_y1_shifting_never_lowers_utilisation(figure, ratio):
    camera = lens(1.18, ratio)
    worst, gain = -1.0, 0.0
    for to_light in ((1, 0, 0), (0, 1, 0), (1, 1, 0)):
        sun = csm.Sun(to_light)
        for i in range(3):
            before, after = (utilisation(camera, sun, fit, i) for fit in ("sphere", "shifted"))
            worst, gain = max(worst, before - after), max(gain, after - before)
    # A column of the sampling grid may fall to either side of an edge.
    figure("Y1", "utilisation lost by shifting", worst, 1 / 64, "share")
    # The three slices of f/n = 3 already reach past far: shifting them would gain nothing.
    assert gain > 0.05 or ratio == 3.0


@pytest.mark.parametrize("fov", [20, 60, 90, 150])
def test_y1_windows_of_shifted_spheres_hold_every_point_of_the_view(figure, fov):
    rng = np.random.default_rng(51)
    bare = 0
    for padding in (0, 3):
        settings = csm.ShadowSettings(
            fit="shifted", map_size=256, filter="pcf" if padding else "hard",
            filter_size=2 * padding + 1 if padding else 3,
        )  # fmt: skip
        for _ in range(4):
            camera = turned(rng, fov, eye=rng.normal(size=3) * 50)
            cascades = csm.fit_cascades(camera, csm.Sun(rng.normal(size=3)), settings)
            bare += uncovered(camera, cascades, padding, rng, samples=1000)
    figure("Y1", "points in no map", bare, 0, "points")


def test_selection_by_interval_and_orthographic_cameras_take_the_plain_sphere():
    rng = np.random.default_rng(52)
    camera, sun = turned(rng, 90), csm.Sun((0.3, 0.7, 0.5))
    for one, changes in (
        (camera, {"select": "interval"}),
        (csm.Camera.orthographic((0, 5, 9), (0, 0, 0)), {}),
    ):
        shifted = csm.fit_cascades(one, sun, csm.ShadowSettings(fit="shifted", **changes))
        plain = csm.fit_cascades(one, sun, csm.ShadowSettings(fit="sphere", **changes))
        assert np.array_equal(shifted.clip_from_world, plain.clip_from_world)
        assert misses(one, shifted, 0, rng) == 0
    moved = csm.fit_cascades(camera, sun, csm.ShadowSettings(fit="shifted"))
    assert not np.array_equal(moved.clip_from_world[0], plain.clip_from_world[0])
    assert misses(camera, moved, 0, rng) > 0  # corners of slices are left to the next map


def test_splits_of_a_chain_must_ascend():
    with pytest.raises(ValueError, match="splits must be 2 to 9 ascending"):
        _core.fit_spheres(lens(1.0, 10.0), [1.0, 3.0, 3.0], True)
