"""Coverage of every fit: brute force over points of the view, and what checks say of the same."""

import numpy as np
import oracles
import pytest
from views import clip_points, scene_of, turned

import csm

# Every fit; whether a slice lies in its own window, or only some window holds each point of it.
OWN = {
    "sphere": True,
    "box": True,
    "diameter": True,
    "scene": True,
    "shifted": False,
    "clipped": True,
    "focus": True,
    "visible": True,
    "visible, turned": True,
}
ANGLES = [0, 1e-9, 1e-6, 1e-3, 5, 30, 60, 90, 120, 175, 180]
FOVS = [15, 60, 95, 150]


def sun_at(camera, angle_deg, rng):
    """A sun at an angle to the view direction, on a random side of it."""
    side = np.cross(camera.backward, rng.normal(size=3))
    side /= np.linalg.norm(side)
    angle = np.radians(angle_deg)
    return csm.Sun(-np.cos(angle) * camera.backward + np.sin(angle) * side)


def seen_points(camera, cascades_range, scene, rng, count=400):
    """Points of the view: corners, edges, faces and inside; in the scene where there is one."""
    points = oracles.sample_slice(camera, *cascades_range, count, rng)
    if scene is not None:
        inside = rng.uniform(scene.bounds[0], scene.bounds[1], (count, 3))
        points = np.concatenate([points, inside])
        points = points[((points >= scene.bounds[0]) & (points <= scene.bounds[1])).all(axis=1)]
    depth = (points - camera.eye) @ -camera.backward
    x, y = (points - camera.eye) @ camera.right, (points - camera.eye) @ camera.up
    seen = (depth >= cascades_range[0]) & (depth <= cascades_range[1])
    seen &= (np.abs(x) <= camera.half_width * depth) & (np.abs(y) <= camera.half_height * depth)
    return points[seen], depth[seen]


def missed_points(cascades, points, depth, padding, own):
    """Points that no inner window holds; and, where slices lie in their own windows, points that
    their own does not hold. Depth included."""
    held = []
    for i in range(cascades.count):
        inner = 1 - 2 * padding / cascades.map_size[i]
        clip = clip_points(cascades, i, points)
        # Coordinates in doubles, in half windows; points on a face come out on either side.
        reach = np.abs(points).max(initial=0) / (
            cascades.texel_size[i].min() * cascades.map_size[i]
        )
        slack = 1e-9 + 64 * oracles.U * reach
        holds = (np.abs(clip[:, :2]) <= inner + slack).all(axis=1)
        held.append(holds & (clip[:, 2] >= -slack) & (clip[:, 2] <= 1 + slack))
    missed = np.count_nonzero(~np.any(held, axis=0))
    if own:
        slices = np.searchsorted(cascades.splits[1:-1], depth, side="left")
        missed += np.count_nonzero(~np.array(held)[slices, np.arange(len(points))])
    return missed


def check_fit(fit, padding, angle, fov, rng, **changes):
    """(missed points, problems told, points) of one fit to one view."""
    camera = turned(rng, fov, eye=rng.normal(size=3) * 100)
    scene = None
    visible = fit.startswith("visible")
    if fit in ("clipped", "focus") or (not visible and rng.uniform() < 0.5):
        size = 10.0 ** rng.uniform(0.5, 2)
        middle = camera.eye - 0.5 * size * camera.backward
        scene = scene_of(middle + np.sort(rng.normal(size=(2, 3)), axis=0) * size)
    settings = csm.ShadowSettings(
        fit="visible" if visible else fit, turned=fit.endswith("turned"),
        map_size=256, cascade_count=1 + padding % 4,
        filter="pcf" if padding else "hard", filter_size=2 * padding + 1 if padding else 3,
        **changes,
    )  # fmt: skip
    receivers = None
    if visible:
        receivers = seen_points(camera, (camera.near, camera.far), None, rng)[0]
    sun = sun_at(camera, angle, rng)
    cascades = csm.fit_cascades(camera, sun, settings, scene=scene, receivers=receivers)
    if receivers is None:
        points, depth = seen_points(camera, cascades.splits[[0, -1]], scene, rng)
    else:
        # Depths on the last split come out on either side of it.
        depth = (receivers - camera.eye) @ -camera.backward
        sure = depth < cascades.splits[-1] * (1 - 1e-9)
        points, depth = receivers[sure], depth[sure]
    missed = missed_points(cascades, points, depth, padding, OWN[fit])
    select = "interval" if OWN[fit] else "map"
    check = csm.check_cascades(
        cascades, camera, select=select, scene=scene, receivers=receivers, border_texels=padding
    )
    return missed, check, len(points)


@pytest.mark.parametrize("fit", OWN)
@pytest.mark.parametrize("padding", range(8))
def test_c1_every_point_of_the_view_is_in_an_inner_window(figure, fit, padding):
    rng = np.random.default_rng([list(OWN).index(fit), padding])
    missed = seen = 0
    for angle in ANGLES:
        for fov in FOVS:
            lost, check, count = check_fit(
                fit, padding, angle, fov, rng, snap="exact" if padding % 2 else "none"
            )
            assert check.ok, f"{fit} {padding} {angle} {fov}: {check}"
            missed += lost
            seen += count
    assert seen > 100 * len(ANGLES)
    figure("C1", f"{fit}: points of the view outside their inner windows", missed, 0, "points")


@pytest.mark.slow
@pytest.mark.parametrize("fit", OWN)
@pytest.mark.parametrize("snap", ["exact", "none", "approximate"])
def test_c1_every_fit_at_length(figure, fit, snap):
    rng = np.random.default_rng([list(OWN).index(fit), len(snap)])
    missed = 0
    for padding in range(8):
        for angle in ANGLES:
            for fov in [0.1, *FOVS, 179]:
                for _ in range(5):
                    lost, check, _ = check_fit(fit, padding, angle, fov, rng, snap=snap)
                    assert check.ok, f"{fit} {snap} {padding} {angle} {fov}: {check}"
                    missed += lost
    figure("C1", f"{fit}: points of the view outside their inner windows", missed, 0, "points")


@pytest.mark.parametrize("warp", ["lispsm", "psm", "tsm"])
@pytest.mark.parametrize("fit", ["sphere", "box", "diameter", "scene"])
def test_c1_warped_windows_hold_their_slices_too(figure, warp, fit):
    rng = np.random.default_rng([len(warp), list(OWN).index(fit)])
    missed = 0
    for padding in (0, 3):
        for angle in ANGLES:
            for fov in (15, 95):
                lost, check, _ = check_fit(fit, padding, angle, fov, rng, warp=warp, snap="none")
                assert check.ok, f"{warp} {fit} {padding} {angle} {fov}: {check}"
                missed += lost
    figure("C1", f"{warp}: points of the view outside their inner windows", missed, 0, "points")
