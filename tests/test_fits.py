"""Light windows of slices: the smallest sphere, the diameter, boxes; every slice is covered."""

import drawings
import numpy as np
import oracles
import pytest
from views import assert_finite, clip_points, misses, scene_of, turned

import csm
from csm import _core, plot

FITS = ["sphere", "box", "diameter", "scene"]
FOVS = [0.1, 1, 5, 20, 45, 60, 90, 120, 150, 170, 179]
ASPECTS = [0.1, 1.0, 16 / 9, 32 / 9, 10.0]
RATIOS = [1.001, 1.5, 3.0, 10.0, 1e3, 1e6]
LIGHT_ANGLES = [0, 1e-9, 1e-6, 1e-3, 5, 30, 60, 90, 120, 175, 180]


def lens(half_width, half_height, near=1.0, far=2.0, orthographic=False, centre=(0.0, 0.0)):
    """A camera at the origin that looks down -z."""
    size = (64, 64)
    return csm.Camera(
        np.zeros(3), *np.eye(3), half_width, half_height, near, far, size, orthographic, *centre
    )


def tangents(ratio):
    """Half widths and heights, some beside the angle where the cases of the sphere meet."""
    for fov in FOVS:
        for aspect in ASPECTS:
            half_height = np.tan(np.radians(fov / 2))
            yield half_height * aspect, half_height
    for beside in (0.99, 0.9995, 1.0, 1.0005, 1.01):
        half = np.sqrt(beside * (ratio - 1.0) / (ratio + 1.0) / 2)
        yield half, half


def draw_sphere(axes, corners, centre, radius):
    """A slice and its sphere, cut through two opposite corner rays."""
    across = np.hypot(*corners[:, :2].T) * np.array([-1, -1, 1, 1] * 2)
    axes.fill(corners[[0, 2, 6, 4], 2], across[[0, 2, 6, 4]], alpha=0.4)
    turn = np.linspace(0, 2 * np.pi, 200)
    axes.plot(centre + radius * np.cos(turn), radius * np.sin(turn))
    axes.set(aspect="equal", xlabel="view depth", ylabel="along the diagonal")


def draw_boxes(axes, corners, rotations, diameter):
    """Light-space outlines of a slice under some rotations, in the square of its diameter."""
    for rotation in rotations:
        turned = (corners @ rotation)[:, :2]
        turned -= 0.5 * (turned.min(axis=0) + turned.max(axis=0))
        axes.plot(*turned[[0, 1, 2, 3, 0, 4, 5, 6, 7, 4]].T, linewidth=0.7)
    half = 0.5 * diameter
    axes.plot([-half, half, half, -half, -half], [-half, -half, half, half, -half], "k")
    axes.set(aspect="equal", xlabel="light x", ylabel="light y")


# -------------------------------------------------------------------------------------------------
# The fits themselves (docs/numerics.md 4 and 5)


@pytest.mark.parametrize("ratio", RATIOS)
def test_f1_sphere_holds_the_corners_and_is_the_smallest(figure, ratio):
    outside = excess = -1.0
    shown = None
    for half_width, half_height in tangents(ratio):
        centre, radius = _core.fit_sphere(lens(half_width, half_height), 1.0, ratio)
        corners = oracles.view_corners(half_width, half_height, 1.0, ratio)
        distances = np.linalg.norm(corners - [0, 0, centre], axis=1)
        if distances.max() / radius - 1 > outside:
            outside, shown = distances.max() / radius - 1, (corners, centre, radius)
        excess = max(excess, radius / oracles.enclosing_ball_radius(corners) - 1)
    # A handful of roundings each; the brute force solves systems of condition up to 1e6.
    figure(
        "F1", "corners outside the sphere", outside, 1e-12, "relative",
        picture=lambda: drawings.chart(lambda axes: draw_sphere(axes, *shown), title="through the "
                                       "corner rays: slice, smallest sphere"),
    )  # fmt: skip
    figure("F1", "radius above brute force", excess, 1e-9, "relative")


@pytest.mark.parametrize("ratio", RATIOS)
def test_f1_sphere_is_continuous_where_its_two_cases_meet(figure, ratio):
    k2 = (ratio - 1.0) / (ratio + 1.0)
    fits = []
    for nudge in (-1e-12, 0.0, 1e-12):
        half = np.sqrt(k2 * (1 + nudge) / 2)
        fits.append(_core.fit_sphere(lens(half, half), 1.0, ratio))
    fits = np.array(fits)
    jump = np.ptp(fits, axis=0).max() / fits.max()
    figure("F1", "jump where the two cases meet", jump, 1e-10, "relative")


def off_centre_tangents(rng):
    """Half widths, half heights and centres: inside the picture, at its rim, far beyond."""
    for fov in (0.1, 20, 60, 150, 179):
        for aspect in (1.0, 32 / 9):
            halves = np.tan(np.radians(fov / 2)) * np.array([aspect, 1.0])
            for shift in ((0.3, 0.0), (0.0, -1.0), (0.999, 1.001), (-4.0, 2.0)):
                yield *halves, halves * shift
            yield *halves, halves * rng.normal(size=2) * 10.0 ** rng.uniform(-6, 1)


@pytest.mark.parametrize("ratio", [1.001, 3.0, 1e3, 1e6])
def test_f1_sphere_of_off_centre_frusta(figure, ratio):
    rng = np.random.default_rng(11)
    outside = excess = -1.0
    for half_width, half_height, centre in off_centre_tangents(rng):
        camera = lens(half_width, half_height, centre=centre)
        (ball,), (radius,), _ = _core.fit_spheres(camera, [1.0, ratio], False)
        corners = oracles.view_corners(half_width, half_height, 1.0, ratio, centre=centre)
        distances = np.linalg.norm(corners - ball, axis=1)
        outside = max(outside, distances.max() / radius - 1)
        excess = max(excess, radius / oracles.enclosing_ball_radius(corners) - 1)
    figure("F1", "off-centre: corners outside the sphere", outside, 1e-12, "relative")
    figure("F1", "off-centre: radius above brute force", excess, 1e-9, "relative")


def test_f1_a_centre_of_zero_is_the_limit_of_small_ones():
    # Both cases of the sphere, and the closed forms of centred frusta beside the general ones.
    for ratio in (1.5, 30.0):
        centred = _core.fit_spheres(lens(0.5, 0.3), [1.0, ratio], False)
        beside = _core.fit_spheres(lens(0.5, 0.3, centre=(1e-12, -1e-12)), [1.0, ratio], False)
        for one, other in zip(centred, beside, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-10)


@pytest.mark.parametrize("ratio", RATIOS)
def test_f2_diameter_of_off_centre_frusta(figure, ratio):
    rng = np.random.default_rng(12)
    aside = above = -1.0
    for half_width, half_height, centre in off_centre_tangents(rng):
        camera = lens(half_width, half_height, centre=centre)
        diameter = _core.fit_diameter(camera, 1.0, ratio)
        corners = oracles.view_corners(half_width, half_height, 1.0, ratio, centre=centre)
        largest = np.linalg.norm(corners[:, None] - corners, axis=2).max()
        aside = max(aside, abs(diameter / largest - 1))
        above = max(above, 1 - 2 * _core.fit_sphere(camera, 1.0, ratio)[1] / diameter)
    figure("F2", "off-centre: diameter from the largest distance", aside, 1e-12, "relative")
    figure("F2", "off-centre: D above 2R", above, 1e-12, "relative")


def test_f1_f2_sphere_and_diameter_of_an_orthographic_slice():
    camera = lens(3.0, 2.0, -4.0, 8.0, orthographic=True)
    assert _core.fit_sphere(camera, -4.0, 8.0) == pytest.approx((2.0, 7.0), rel=1e-15)
    assert _core.fit_diameter(camera, -4.0, 8.0) == pytest.approx(14.0, rel=1e-15)
    aside = lens(3.0, 2.0, -4.0, 8.0, orthographic=True, centre=(10.0, -1.0))
    (centre,), (radius,), _ = _core.fit_spheres(aside, [-4.0, 8.0], False)
    assert (*centre, radius) == pytest.approx((10.0, -1.0, 2.0, 7.0), rel=1e-15)
    assert _core.fit_diameter(aside, -4.0, 8.0) == pytest.approx(14.0, rel=1e-15)


@pytest.mark.parametrize("ratio", RATIOS)
def test_f2_diameter_is_the_largest_distance_and_bounds_every_box(figure, ratio):
    aside = overhang = below = above = -1.0
    shown = None
    rng = np.random.default_rng(4)
    rotations = np.array([oracles.random_rotation(rng) for _ in range(1000)])
    for half_width, half_height in tangents(ratio):
        camera = lens(half_width, half_height)
        diameter = _core.fit_diameter(camera, 1.0, ratio)
        corners = oracles.view_corners(half_width, half_height, 1.0, ratio)
        largest = np.linalg.norm(corners[:, None] - corners, axis=2).max()
        aside = max(aside, abs(diameter / largest - 1))
        sides = np.ptp(corners @ rotations, axis=1)
        if sides.max() / diameter - 1 > overhang:
            overhang, shown = sides.max() / diameter - 1, (corners, diameter)
        radius = _core.fit_sphere(camera, 1.0, ratio)[1]
        below = max(below, 1 - 2 * radius / diameter)
        above = max(above, 2 * radius / diameter - 2 / np.sqrt(3))
    figure("F2", "diameter from the largest corner distance", aside, 1e-12, "relative")
    worst = np.argsort(np.ptp(shown[0] @ rotations, axis=1).max(axis=1))[-6:]
    figure(
        "F2", "boxes under 1000 rotations beyond D", overhang, 1e-12, "relative",
        picture=lambda: drawings.chart(
            lambda axes: draw_boxes(axes, shown[0], rotations[worst], shown[1]), size=(4, 4)
        ),
    )  # fmt: skip
    figure("F2", "D above 2R", below, 1e-12, "relative")
    # 2R/D is at most 2/sqrt(3), by Jung's theorem for the plane of the axis.
    figure("F2", "2R/D above 2/sqrt(3)", above, 1e-12)


def test_box_window_touches_its_slice_on_every_side():
    rng = np.random.default_rng(5)
    settings = csm.ShadowSettings(fit="box", snap="none", cascade_count=3)
    for _ in range(20):
        camera = turned(rng, eye=rng.normal(size=3) * 50)
        cascades = csm.fit_cascades(camera, csm.Sun(rng.normal(size=3)), settings)
        for i in range(3):
            corners = oracles.camera_corners(camera, *cascades.splits[i : i + 2])
            clip = clip_points(cascades, i, corners)[:, :2]
            np.testing.assert_allclose(clip.min(axis=0), -1, atol=1e-11)
            np.testing.assert_allclose(clip.max(axis=0), 1, atol=1e-11)


def test_scene_fit_reaches_from_near_to_each_split():
    rng = np.random.default_rng(6)
    camera, sun = turned(rng), csm.Sun(rng.normal(size=3))
    cascades = csm.fit_cascades(camera, sun, csm.ShadowSettings(fit="scene", snap="none"))
    for i in range(4):
        whole = camera.replace(far=cascades.splits[i + 1])
        alone = csm.fit_cascades(
            whole, sun, csm.ShadowSettings(fit="box", snap="none", cascade_count=1)
        )
        np.testing.assert_allclose(cascades.texel_size[i], alone.texel_size[0], rtol=1e-12)


def test_texels_of_the_diameter_fit_are_never_larger_than_of_the_sphere():
    rng = np.random.default_rng(7)
    for fov in (10, 30, 60, 90):
        camera, sun = turned(rng, fov), csm.Sun(rng.normal(size=3))
        sizes = [
            csm.fit_cascades(camera, sun, csm.ShadowSettings(fit=fit)).texel_size
            for fit in ("diameter", "sphere")
        ]
        assert (sizes[0] <= sizes[1] * (1 + 1e-12)).all()


# -------------------------------------------------------------------------------------------------
# Coverage and selection (C1 and W1 of docs/numerics.md 16)


def light_at(camera, angle_deg, rng):
    """A sun at an angle from the direction of view."""
    around = rng.uniform(0, 2 * np.pi)
    side = np.cos(around) * camera.right + np.sin(around) * camera.up
    angle = np.radians(angle_deg)
    return csm.Sun(-np.cos(angle) * camera.backward + np.sin(angle) * side)


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("padding", range(8))
def test_c1_every_slice_lies_in_its_own_inner_window(figure, fit, padding):
    rng = np.random.default_rng(100 + padding)
    settings = csm.ShadowSettings(
        fit=fit, filter="pcf" if padding else "hard", filter_size=2 * padding + 1 if padding else 3,
        map_size=256, snap="exact" if padding % 2 else "none", cascade_count=1 + padding % 4,
    )  # fmt: skip
    missed = 0
    for angle in LIGHT_ANGLES:
        for fov in (15, 60, 95, 150):
            camera = turned(rng, fov, eye=rng.normal(size=3) * 100)
            cascades = csm.fit_cascades(camera, light_at(camera, angle, rng), settings)
            assert_finite(cascades)
            missed += misses(camera, cascades, padding, rng)
    figure(
        "C1", f"{fit}: points outside their window", missed, 0, "points",
        picture=lambda: drawings.chart(
            lambda axes: plot.light_plan(cascades, camera, ax=axes),
            size=(5, 5),
        ),
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("snap", ["exact", "none"])
def test_c1_coverage_at_length(figure, fit, snap):
    missed = 0
    rng = np.random.default_rng(8)
    for padding in range(8):
        settings = csm.ShadowSettings(
            fit=fit, filter="pcf" if padding else "hard",
            filter_size=2 * padding + 1 if padding else 3, map_size=64, snap=snap,
        )  # fmt: skip
        for angle in LIGHT_ANGLES:
            for fov in (0.1, 15, 60, 95, 150, 179):
                for _ in range(10):
                    camera = turned(rng, fov, eye=rng.normal(size=3) * 1000)
                    cascades = csm.fit_cascades(camera, light_at(camera, angle, rng), settings)
                    missed += misses(camera, cascades, padding, rng)
    figure("C1", f"{fit}: points outside their window", missed, 0, "points")


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("fov", [0.1, 179.0])
@pytest.mark.parametrize("up", [(0, 0, 1), (1, 0, 1)], ids=["level", "rolled"])
@pytest.mark.parametrize("down", [True, False], ids=["down", "up"])
@pytest.mark.parametrize("teleport", [0.0, 1e6])
def test_w1_extreme_cameras_are_finite_and_covered(figure, fit, fov, up, down, teleport):
    missed = 0
    rng = np.random.default_rng(9)
    eye = np.array([1.0, 2.0, 3.0]) + teleport
    target = eye + np.array([0.0, -1.0 if down else 1.0, 0.0])
    camera = csm.Camera.look_at(eye, target, up=up, fov_y_deg=fov, near=1e-4, far=1e6, size=(16, 9))
    for to_light in ((0, 1, 0), (0.3, -1e-9, 0.5), (1, 1, 1)):
        for scene in (None, scene_of(np.array([[-50.0, 0, -50], [50, 10, 50]]) + teleport)):
            cascades = csm.fit_cascades(
                camera, csm.Sun(to_light), csm.ShadowSettings(fit=fit), scene=scene
            )
            assert_finite(cascades)
            missed += misses(camera, cascades, 0, rng, scene=scene)
    figure("W1", f"{fit}: points outside their window", missed, 0, "points")
