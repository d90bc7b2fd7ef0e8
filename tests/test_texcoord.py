"""Light coordinates interpolated between vertices, against those of each pixel's position."""

import drawings
import numpy as np
import pytest
import small_scenes

import csm

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal")
POSITION = csm.ShadowSettings(map_size=1024)
INTERPOLATED = POSITION.replace(texcoord="interpolated")
SUN = csm.Sun((0.5, 1.0, 0.35))
WARPS = {"orthographic": "none", "perspective": "lispsm"}
FURTHEST = 1.3  # coordinate of a corner of the triangle, over its side


def bars_over_a_triangle(side):
    """One receiving triangle that many bars stand over, and a camera on it, so that the triangle
    crosses its near plane; the camera's own measure is a metre, less over a small triangle."""
    unit = min(1.0, side / 50.0)
    rng = np.random.default_rng(7)
    corners = side * np.array([[-1.0, 0, 0.7], [1.0, 0, 0.7], [0.1, 0, -1.3]])
    centre = rng.uniform((-12, 0.5, -35), (12, 2.5, 0), (90, 3)) * unit
    turn = rng.uniform(0, np.pi, 90)
    along = np.stack([np.cos(turn), 0 * turn, np.sin(turn)], axis=-1) * 1.5 * unit
    across = np.stack([-np.sin(turn), 0 * turn, np.cos(turn)], axis=-1) * 0.08 * unit
    ends = [centre - along - across, centre - along + across, centre + along + across]
    ends.append(centre + along - across)
    positions = np.concatenate([corners, np.stack(ends, axis=1).reshape(-1, 3)])
    first = 3 + 4 * np.arange(90)[:, None]
    triangles = np.concatenate(
        [[[0, 1, 2]], first + np.array([0, 1, 2]), first + np.array([0, 2, 3])]
    )
    camera = csm.Camera.look_at(
        np.array([0.3, 1.7, 2.0]) * unit, np.array([0, 0, -12.0]) * unit,
        fov_y_deg=60, near=0.1 * unit, far=60 * unit, size=(480, 270),
    )  # fmt: skip
    return csm.Scene.from_arrays(positions, triangles), camera


def texels_to(frame, chosen):
    """(m,) texels of its cascade from each chosen pixel's exact point to the next line between
    texels, (m, 2) its texel coordinates."""
    points = small_scenes.positions_of(frame)[chosen]
    index = frame.cascade_index[chosen]
    place = np.empty((len(points), 2))
    for i in np.unique(index):
        own = index == i
        place[own] = small_scenes.texels_of(frame.cascades, i, points[own])[:, :2]
    return np.abs(place - np.round(place)).min(axis=1)


@pytest.mark.parametrize("light", WARPS)
@pytest.mark.parametrize("side", [1.0, 1e3, 1.6e4])
def test_t1_methods_agree_with_each_other_and_with_rays(figure, renderer, side, light):
    """Where two hard masks differ on a plane, a line between texels lies between the two light
    positions: its distance from the exact point is what the further one is off at least.

    The matrix's 0.05 texel is less than float32 can tell of the corners of the largest triangle. A
    light coordinate of a corner is three products, added up with a rounding for each: three times
    half a step of a float32 of 1.3 * 1.6e4, 1/512 m, is 2.9 mm or 0.16 texel of 18 mm; points
    between take at most that. 0.10 was reached. A smaller triangle's rounding is below 0.05."""
    scene, camera = bars_over_a_triangle(side)
    settings = POSITION.replace(warp=WARPS[light])
    by_position, interpolated = (
        renderer.render(scene, camera, SUN, settings.replace(texcoord=way), outputs=OUTPUTS)
        for way in ("position", "interpolated")
    )
    assert np.array_equal(by_position.valid, interpolated.valid)
    near_map = by_position.cascade_index != 255
    assert near_map.mean() > 0.3
    same = by_position.cascade_index == interpolated.cascade_index
    figure("T1", "pixels of another cascade", np.mean(~same), 1e-3)
    judged = same & by_position.valid & near_map
    apart = judged & (by_position.mask != interpolated.mask)
    picture = lambda: drawings.compared(by_position.mask, interpolated.mask)  # noqa: E731
    worst = texels_to(by_position, apart).max(initial=0.0)
    rounding = 1.5 * np.spacing(np.float32(FURTHEST * side)) / by_position.cascades.texel_size.min()
    tolerance = 1.0 if light == "perspective" else max(0.05, rounding)
    what = f"between methods, {light}, triangle of {side:g}"
    figure("T1", what, worst, tolerance, "texels", picture)
    if side < 1e4:
        figure("T1", "masks of two methods that differ", apart.mean(), 1e-3, "pixels", picture)
    # by rays: at most a texel from where an edge of the true shadow lies, and half a texel's
    # diagonal for the nearest compare itself: a ray a texel and a half away agrees
    truth = csm.truth(scene, camera, SUN)
    for frame, way in ((by_position, "position"), (interpolated, "interpolated")):
        wrong = judged & truth.valid & truth.facing & (frame.mask != truth.mask)
        wrong = np.argwhere(wrong)
        assert len(wrong) < 0.15 * np.count_nonzero(judged)
        off = [texels_from_truth(frame, truth, *pixel) for pixel in wrong[:: len(wrong) // 60 + 1]]
        figure("T1", f"{way} against rays, {light}", max(off, default=0.0), 1.0, "texels")


def texels_from_truth(frame, truth, row, column):
    """Texels, beyond the nearest compare's half diagonal, to where a ray has the mask's answer."""
    i = frame.cascade_index[row, column]
    point = truth.position[row, column]
    light = frame.cascades.light_from_world[i][:3, :3]
    for reach in np.arange(0.0, 4.1, 0.25):
        turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        step = np.stack([np.cos(turn), np.sin(turn)], axis=-1) * (reach + np.sqrt(0.5))
        # on the receiver's plane: along it as far as light x, y go
        normal = frame.normal[row, column].astype(np.float64)
        shift = (step * texel_sides(frame, i, point)) @ light[:2]
        shift = shift - np.outer(shift @ normal / (light[2] @ normal), light[2])
        seen = truth.trace(point + shift, np.tile(normal, (len(shift), 1)))
        if (seen == frame.mask[row, column]).any():
            return reach
    return 4.25


def texel_sides(frame, i, point):
    """Sides [m] of the texel of a map at a point, by differences."""
    light = frame.cascades.light_from_world[i][:2, :3]
    step = 0.01 * frame.cascades.texel_size[i]
    here, *there = (
        small_scenes.texels_of(frame.cascades, i, place)[:2]
        for place in (point, point + step[0] * light[0], point + step[1] * light[1])
    )
    return step / np.array([np.linalg.norm(place - here) for place in there])


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"filter": "pcf", "filter_size": 5},
        {"select": "interval"},
        {"map_size": (512, 256, 128, 64)},
        {"bias": "manual", "normal_offset_texels": 2.0, "slope_bias": 1.0},
        {"fit": "box", "snap": "none"},
        {"warp": "tsm"},
    ],
    ids=lambda changes: " ".join(f"{k}={v}" for k, v in changes.items()) or "default",
)
@pytest.mark.parametrize("scene", small_scenes.SCENES)
def test_t1_masks_of_scenes_agree(figure, renderer, scene, changes):
    made = small_scenes.SCENES[scene]()
    camera = small_scenes.camera(1, size=(320, 180))
    one, two = (
        renderer.render(
            made, camera, csm.Sun(small_scenes.SUNS["high"]), settings.replace(**changes),
            outputs=OUTPUTS,
        )
        for settings in (POSITION, INTERPOLATED)
    )  # fmt: skip
    assert np.array_equal(one.valid, two.valid)
    assert np.array_equal(one.normal, two.normal)
    np.testing.assert_allclose(two.view_depth, one.view_depth, rtol=1e-5)
    differing = (np.abs(one.mask - two.mask) > 1e-6).mean()
    figure("T1", "masks of scenes that differ", differing, 1e-3, "pixels")
    assert (one.cascade_index != two.cascade_index).mean() <= 1e-3


def test_what_is_not_seen_is_as_ever(renderer):
    scene = small_scenes.soup()
    camera = small_scenes.camera(0).replace(far=12.0)
    frame = renderer.render(scene, camera, SUN, INTERPOLATED, outputs=OUTPUTS)
    beyond = ~frame.valid
    assert 0.05 < beyond.mean() < 0.95
    assert (frame.mask[beyond] == 1.0).all()
    assert (frame.cascade_index[beyond] == 255).all()
    assert np.isposinf(frame.view_depth[beyond]).all()
    assert (frame.normal[beyond] == 0.0).all()


def test_orthographic_camera(renderer):
    scene = small_scenes.soup()
    view = csm.Camera.orthographic(
        (6, 8, 9), (0, 0.5, 0), height=14.0, near=0.1, far=40, size=(160, 90)
    )
    one, two = (
        renderer.render(scene, view, SUN, settings, outputs=OUTPUTS)
        for settings in (POSITION, INTERPOLATED)
    )
    assert np.array_equal(one.valid, two.valid)
    assert np.array_equal(one.normal, two.normal)
    assert (one.mask != two.mask).mean() <= 1e-3


def test_points_take_their_positions(renderer):
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    points = np.random.default_rng(4).uniform((-6, 0, -6), (6, 4, 6), size=(500, 3))
    one, two = (
        renderer.render(scene, camera, SUN, settings, outputs=("mask",), points=points)
        for settings in (POSITION, INTERPOLATED)
    )
    assert np.array_equal(one.point_visibility, two.point_visibility)
    assert np.array_equal(one.point_cascade, two.point_cascade)


def test_off_means_absent():
    with_, without = (csm.plan(settings) for settings in (INTERPOLATED, POSITION))
    names = [[step.name for step in plan.passes] for plan in (with_, without)]
    assert "shadow_forward" not in names[1]
    assert [name.replace("forward", "mask") for name in names[0]] == names[1]
    assert (with_.textures, with_.bytes) == (without.textures, without.bytes)
    assert INTERPOLATED.replace(filter="none").canonical().texcoord == "position"
