"""Warps of light windows (L1 of docs/numerics.md 16; the formulas: 21): what any homography of the
light plane must keep, and what each paper promises of its own."""

import itertools

import numpy as np
import oracles
import pytest

import csm
from csm import _core

LISPSM, PSM, TSM = 1, 2, 3
WARPS = {"lispsm": LISPSM, "psm": PSM, "tsm": TSM}
GAMMAS = [0.0, 1e-9, 1e-6, 1e-3, 0.1, 1.0, np.pi / 2, np.pi - 1e-6, np.pi]
RATIOS = [2.0, 10.0, 1e3, 1e5]
MANY_RATIOS = [2.0, 3.0, 10.0, 30.0, 100.0, 1e3, 1e4, 1e5]
SIZE = 1024


def ranges(sample, all_of_them):
    more = [value for value in all_of_them if value not in sample]
    return [*sample, *(pytest.param(value, marks=pytest.mark.slow) for value in more)]


def lens(fov_y_deg=60.0, near=1.0, far=100.0, aspect=16 / 9):
    """A camera at the origin that looks down -z."""
    half = np.tan(np.radians(fov_y_deg / 2))
    return csm.Camera(np.zeros(3), *np.eye(3), half * aspect, half, near, far, (160, 90), False)


def light_at(gamma, azimuth=0.4):
    """to_light for light that travels at an angle gamma [rad] from the view direction."""
    side = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return -(np.cos(gamma) * np.array([0.0, 0.0, -1.0]) + np.sin(gamma) * side)


class Warp:
    """A warp of a slice as the formulas read it: local = (light xy - origin) / extent."""

    def __init__(self, kind, camera, to_light, near, far, size=SIZE, padding=0):
        made = _core.make_warp(camera, to_light, near, far, kind, size, padding)
        self.basis = made["light_from_world"][:3, :3]
        self.origin, self.extent = made["origin"], made["extent"]
        self.strength, self.clip = made["strength"], made["clip_from_local"]

    def local(self, points):
        """(..., 2) of points relative to the eye, in world axes."""
        return ((points @ self.basis.T)[..., :2] - self.origin) / self.extent

    def project(self, points, depth=0.0, dtype=np.float64):
        """Clip xyzw of points, their depth in the map's range as given."""
        local = self.local(points).astype(dtype)
        depth = np.broadcast_to(np.asarray(depth, dtype)[..., None], (*local.shape[:-1], 1))
        ones = np.ones_like(depth)
        return np.concatenate([local, depth, ones], axis=-1) @ self.clip.T.astype(dtype)

    def ndc(self, points, depth=0.0):
        clip = self.project(points, depth)
        return clip[..., :3] / clip[..., 3:]


def slices_of(near, far):
    """The whole range, and the slices of cascades of it."""
    cuts = csm.split_distances(near, far, 4)
    return [(near, far), *itertools.pairwise(cuts)]


def sample(camera, near, far, count=4000, seed=3):
    """Points of a slice relative to the eye: corners, edges, faces, inside."""
    return oracles.sample_slice(camera, near, far, count, np.random.default_rng(seed))


# -------------------------------------------------------------------------------------------------
# Any warp


@pytest.mark.parametrize("ratio", ranges(RATIOS, MANY_RATIOS))
@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("warp", WARPS)
def test_l1_slices_lie_in_the_cube_under_parallel_rays(figure, warp, gamma, ratio):
    # Doubles: a few roundings of coordinates as large as the slice.
    outside = bent = farthest = 0.0
    lowest_w = np.inf
    for fov in (5.0, 60.0, 120.0):
        camera = lens(fov, far=ratio)
        for near, far in slices_of(1.0, ratio):
            for padding in (0, 3):
                made = Warp(WARPS[warp], camera, light_at(gamma), near, far, padding=padding)
                assert np.isfinite(made.clip).all()
                assert np.isfinite(made.basis).all()
                points = sample(camera, near, far, 200)
                inner = 1.0 - 2.0 * padding / SIZE
                clip = made.project(points)
                ndc = clip[:, :2] / clip[:, 3:]
                outside = max(outside, np.abs(ndc).max() - inner)
                lowest_w = min(lowest_w, clip[:, 3].min())
                # x, y and w know nothing of the depth along the light, z of nothing else: rays
                # stay parallel to the map's depth axis, and depth grows along each
                bent = max(bent, np.abs(made.clip[[0, 1, 3], 2]).max())
                assert np.array_equal(made.clip[2], [0.0, 0.0, 1.0, 0.0])
                farthest = max(farthest, (1.0 / clip[:, 3]).max() - 1.0)
    assert lowest_w > 0.0
    figure("L1", "slices outside the cube", outside, 1e-9, "of the half width")
    figure("L1", "light rays bent", bent, 0.0, "clip units")
    figure("L1", "depths beyond 1", farthest, 1e-9)


@pytest.mark.parametrize("warp", WARPS)
@pytest.mark.parametrize("padding", [0, 1, 7])
def test_l1_the_whole_map_lies_before_the_horizon(figure, warp, padding):
    # The texels of the padding too: 1/w is linear over the map, so its corners decide.
    lowest = np.inf
    corners = np.array([[-1, -1, 1], [1, -1, 1], [-1, 1, 1], [1, 1, 1]], float)
    for gamma in (0.1, 0.7, np.pi / 2, 2.0):
        for ratio in (2.0, 1e3, 1e10):
            for size in (16, 2048):
                camera = lens(50.0, far=ratio)
                made = Warp(WARPS[warp], camera, light_at(gamma), 1.0, ratio, size, padding)
                plane = made.clip[np.ix_([0, 1, 3], [0, 1, 3])]
                inverse_w = np.linalg.solve(plane, corners.T)[2]
                lowest = min(lowest, inverse_w.min())
                assert inverse_w.max() <= 1.0 + 1e-9
    figure("L1", "map beyond the horizon", -lowest, 0.0, "1/w")


@pytest.mark.parametrize("warp", WARPS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_l1_no_farther_from_linear_than_a_quarter_of_d_over_n(figure, warp, ratio):
    worst = 0.0
    for gamma in GAMMAS:
        camera = lens(far=ratio)
        made = Warp(WARPS[warp], camera, light_at(gamma), 1.0, ratio)
        points = sample(camera, 1.0, ratio)
        share = made.local(points)[:, 1]  # y / d
        away = np.abs(0.5 * (made.ndc(points)[:, 1] + 1.0) - share).max()
        worst = max(worst, away - made.strength / 4.0)  # strength is d / n
    figure("L1", "|t - y/d| over d/(4n)", worst, 1e-9)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("warp", WARPS)
def test_l1_orthographic_where_light_and_view_are_parallel(figure, warp, ratio):
    # Against the plain window round the slice along the same axes. The fade bounds the strength by
    # its value a degree off times the angle; that of a thin beam is up to the square root of the
    # ratio or, under psm, the ratio.
    for gamma, tolerance in ((0.0, 1e-9), (1e-9, 1e-9), (np.pi - 1e-9, 1e-9), (np.pi, 1e-9)):
        worst = 0.0
        for fov in (60.0, 120.0):
            camera = lens(fov, far=ratio)
            for near, far in slices_of(1.0, ratio):
                made = Warp(WARPS[warp], camera, light_at(gamma), near, far)
                flat = sample(camera, near, far, 200)
                light = (flat @ made.basis.T)[:, :2]
                low, high = light[:8].min(axis=0), light[:8].max(axis=0)
                plain = (2.0 * light - low - high) / (high - low)
                worst = max(worst, np.abs(made.ndc(flat)[:, :2] - plain).max())
        figure("L1", "from orthographic at parallel light", worst, tolerance, "of the half width")


@pytest.mark.parametrize("warp", WARPS)
def test_strengths_fade_as_light_and_view_become_parallel(warp):
    camera = lens(5.0, far=30.0)
    gammas = np.geomspace(1e-9, 0.3, 60)
    strengths = np.array(
        [Warp(WARPS[warp], camera, light_at(gamma), 1.0, 30.0).strength for gamma in gammas]
    )
    assert (
        strengths <= (29.0 + 1e-6) * np.minimum(1.0, np.sin(gammas) / np.sin(np.radians(1)))
    ).all()
    assert strengths[-1] > 1.0  # or nothing was warped


@pytest.mark.parametrize("warp", WARPS)
def test_l1_float32_keeps_its_digits(figure, warp):
    # Local coordinates are rounded to 2^-24 of the slice. Where n = d/strength is small the map is
    # 1 + strength times as long there, so that much of it is the rounding of the point itself.
    worst = relative = 0.0
    for gamma in GAMMAS:
        for ratio in MANY_RATIOS:
            camera = lens(far=ratio)
            for near, far in slices_of(1.0, ratio):
                made = Warp(WARPS[warp], camera, light_at(gamma), near, far)
                points = sample(camera, near, far, 100)
                exact = made.ndc(points)[:, :2]
                single = made.project(points, dtype=np.float32)
                away = np.abs(single[:, :2] / single[:, 3:] - exact).max()
                worst = max(worst, away)
                relative = max(relative, away / (1.0 + made.strength))
    figure("L1", "float32 against doubles", worst, 1e-3, "of the half width")
    figure("L1", "float32, over 1 + strength", relative, 1e-6, "of the half width")


def test_a_shifted_eye_loses_what_the_scaled_form_keeps():
    # The published form moves the origin n before the body and projects (y + n): in float32 that
    # sum swallows y. The scaled form never forms it.
    y = np.linspace(0.0, 1.0, 1001).astype(np.float32)
    lost = {}
    for n in (1e3, 1e5, 1e7):
        n32 = np.float32(n)
        a, b = (n32 + 1 + n32) / np.float32(1), np.float32(-2) * n32 * (n32 + 1)
        naive = (a + b / (y + n32) + np.float32(1)) / np.float32(2)
        s = np.float32(1.0 / n)
        scaled = y * (np.float32(1) + s) / (np.float32(1) + s * y)
        exact = y.astype(float) * (1 + 1 / n) / (1 + y.astype(float) / n)
        lost[n] = np.abs(naive - exact).max()
        assert np.abs(scaled - exact).max() < 2e-7
    assert lost[1e3] > 2e-5
    assert lost[1e7] > 0.4


def test_orthographic_cameras_have_no_perspective_to_follow():
    camera = csm.Camera(np.zeros(3), *np.eye(3), 3.0, 2.0, -4.0, 20.0, (16, 9), True)
    for kind in WARPS.values():
        made = Warp(kind, camera, light_at(1.0), -4.0, 20.0)
        assert made.strength == 0.0
        ndc = made.ndc(oracles.camera_corners(camera, -4.0, 20.0))[:, :2]
        np.testing.assert_allclose([ndc.min(axis=0), ndc.max(axis=0)], [[-1, -1], [1, 1]])


def test_bases_are_rotations_whose_y_axis_is_the_view():
    for gamma in (0.3, 1.0, np.pi / 2, 2.8):
        camera, to_light = lens(), light_at(gamma)
        for kind in (LISPSM, TSM):
            basis = Warp(kind, camera, to_light, 1.0, 100.0).basis
            np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=5e-15)
            assert np.linalg.det(basis) > 0
            np.testing.assert_allclose(basis[2], to_light, atol=1e-15)
            seen = basis @ [0, 0, -1]
            np.testing.assert_allclose(seen[0], 0.0, atol=1e-15)
            assert seen[1] > 0.0


def test_padding_that_leaves_no_texel_is_refused():
    with pytest.raises(ValueError, match=r"map_size must be > 6"):
        Warp(LISPSM, lens(), light_at(1.0), 1.0, 9.0, size=6, padding=3)


# -------------------------------------------------------------------------------------------------
# LiSPSM [Wimmer2004]: the error along the axis, its optimum


def errors(made, camera, near, far):
    """(dy/dt)/z over many points of a slice: a texel along the axis on the screen; from finite
    differences of the projection."""
    points = sample(camera, near, far)
    step = 1e-6 * made.extent[1]
    moved = made.ndc(points + step * made.basis[1])[:, 1] - made.ndc(points)[:, 1]
    return 2.0 * step / moved / (-points[:, 2]), points


def closed_form(made, strength, camera, near, far):
    """The same for another strength, from t(y) = (y/d)(1 + d/n)/(1 + y/n)."""
    points = sample(camera, near, far)
    share = made.local(points)[:, 1]
    return made.extent[1] * (1 + strength * share) ** 2 / (1 + strength) / -points[:, 2]


@pytest.mark.parametrize("ratio", RATIOS)
def test_l1_optimum_at_right_angles_equalises_the_ends(figure, ratio):
    camera = lens(far=ratio)
    made = Warp(LISPSM, camera, light_at(np.pi / 2), 1.0, ratio)
    n_opt = 1.0 + np.sqrt(ratio)  # near + sqrt(near far)
    n = made.extent[1] / made.strength
    figure("L1", "n against n_opt", abs(n / n_opt - 1.0), 1e-9)
    error = closed_form(made, made.strength, camera, 1.0, ratio)
    depth = -sample(camera, 1.0, ratio)[:, 2]
    ends = [error[depth < 1.0 + 1e-9].max(), error[depth > ratio * (1 - 1e-9)].max()]
    figure("L1", "ends apart", abs(ends[0] / ends[1] - 1.0), 1e-9)
    uniform = closed_form(made, 0.0, camera, 1.0, ratio).max()
    gain = uniform / error.max()
    figure("L1", "gain over uniform against sqrt(zf/zn)", abs(gain / np.sqrt(ratio) - 1), 1e-9)


def test_l1_gain_of_a_slice_is_the_root_of_its_ratio(figure):
    camera = lens(far=1000.0)
    worst = 0.0
    for near, far in slices_of(1.0, 1000.0)[1:]:
        made = Warp(LISPSM, camera, light_at(np.pi / 2), near, far)
        gain = (
            closed_form(made, 0.0, camera, near, far).max()
            / closed_form(made, made.strength, camera, near, far).max()
        )
        worst = max(worst, abs(gain / np.sqrt(far / near) - 1.0))
    figure("L1", "gain per slice", worst, 1e-9)


@pytest.mark.parametrize("gamma", [0.05, 0.3, 0.8, 1.3, 2.2])
@pytest.mark.parametrize("fov", [5.0, 45.0, 100.0])
def test_no_other_strength_has_a_smaller_worst_texel(gamma, fov):
    camera = lens(fov, far=80.0)
    made = Warp(LISPSM, camera, light_at(gamma), 1.0, 80.0)
    ours = closed_form(made, made.strength, camera, 1.0, 80.0).max()
    others = [
        closed_form(made, strength, camera, 1.0, 80.0).max()
        for strength in np.concatenate([[0.0], np.geomspace(1e-3, 79.0, 200)])
    ]
    assert ours <= min(others) * (1 + 1e-9)
    # the general form of public code, z0 and z1 the eye depths at the light-space ends
    z1 = 1.0 + made.extent[1] * np.sin(gamma)
    assert ours <= closed_form(made, np.sqrt(z1) - 1.0, camera, 1.0, 80.0).max() * (1 + 1e-9)


@pytest.mark.parametrize("warp", WARPS)
def test_no_warp_has_a_worse_texel_than_none(warp):
    for gamma in (0.02, 0.3, 0.8, np.pi / 2, 2.2, 3.0):
        for fov in (5.0, 45.0, 100.0):
            for ratio in (1.5, 20.0, 1e3):
                camera = lens(fov, far=ratio)
                made = Warp(WARPS[warp], camera, light_at(gamma), 1.0, ratio)
                measured, _ = errors(made, camera, 1.0, ratio)
                unwarped = closed_form(made, 0.0, camera, 1.0, ratio).max()
                # finite differences of 1e-6 in doubles
                assert measured.max() <= unwarped * (1 + 1e-5 * (1 + made.strength))


# -------------------------------------------------------------------------------------------------
# PSM [Stamminger2002] and TSM [Martin2004]


def test_psm_at_right_angles_is_the_post_perspective_space_of_the_camera():
    camera = lens(50.0, far=40.0)
    made = Warp(PSM, camera, light_at(np.pi / 2, azimuth=np.pi / 2), 1.0, 40.0)
    points = sample(camera, 1.0, 40.0)
    depth = -points[:, 2]
    ndc = made.ndc(points)
    assert made.extent[1] / made.strength == pytest.approx(1.0, rel=1e-9)  # n = near
    # the light comes from above: across is the camera's x, along is its depth, post-perspective
    across = points[:, 0] / depth / camera.half_width
    np.testing.assert_allclose(np.abs(ndc[:, 0]), np.abs(across), atol=1e-9)
    along = 2.0 * (40.0 / 39.0) * (1.0 - 1.0 / depth) - 1.0
    np.testing.assert_allclose(ndc[:, 1], along, atol=1e-9)


def moved_back(camera, near, far, slide, points):
    """Clip xyzw of points (or directions, with w = 0) for a camera that stands `slide` further back
    and just holds the slice; z in [0, 1]."""
    one = np.ones_like(points[..., 0]) if points.shape[-1] == 3 else points[..., 3]
    n, f = near + slide, far + slide
    depth = -points[..., 2] + slide * one
    narrower = far / f
    return np.stack(
        [
            points[..., 0] / (camera.half_width * narrower),
            points[..., 1] / (camera.half_height * narrower),
            f / (f - n) * (depth - n * one),
            depth,
        ],
        axis=-1,
    )


def from_the_light(camera, to_light, near, far, slide, points):
    """(m, 2) picture and (m,) distance of points as an ordinary look-at camera sees them in the
    post-perspective space of a camera moved back, from the image of the light there, towards the
    cube's centre. A distance that changes sign lies behind it."""
    seen = moved_back(camera, near, far, slide, points)
    seen = seen[:, :3] / seen[:, 3:]
    light = moved_back(camera, near, far, slide, np.append(-to_light, 0.0))
    centre = np.array([0.0, 0.0, 0.5])
    eye = light[:3] / light[3]
    ahead = (centre - eye) / np.linalg.norm(centre - eye)
    right = np.cross(ahead, [0.3, 0.5, -0.8])
    right /= np.linalg.norm(right)
    from_eye = seen - eye
    along = from_eye @ ahead
    return from_eye @ np.stack([right, np.cross(right, ahead)], -1) / along[:, None], along * (
        moved_back(camera, near, far, slide, points)[:, 3]
    )


@pytest.mark.parametrize("gamma", [0.5, 0.9, 1.2, 1.4, 1.8, 2.2])
def test_psm_projects_the_post_perspective_space_from_the_image_of_the_light(gamma):
    # Independent of the closed form: points and light go through the camera's projection and are
    # seen from the light's image. Up to an affine map of the texture that must be our map, for the
    # distance the camera is moved back by, which is found here from the strength alone.
    camera, to_light, near, far = lens(40.0, far=6.0), light_at(gamma), 1.0, 6.0
    made = Warp(PSM, camera, to_light, near, far)
    points = sample(camera, near, far, 500)

    def strength(slide):
        w = from_the_light(camera, to_light, near, far, slide, points)[1]
        w = w * np.sign(w.sum())
        return w.max() / w.min() - 1.0 if w.min() > 0 else np.inf

    low, high = 0.0, 1e4
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if strength(middle) > made.strength else (low, middle)
    picture, _ = from_the_light(camera, to_light, near, far, high, points)
    picture = np.column_stack([picture, np.ones(len(picture))])
    ours = made.ndc(points)[:, :2]
    affine, *_ = np.linalg.lstsq(picture, ours, rcond=None)
    assert abs(np.linalg.det(affine[:2])) > 1e-6
    np.testing.assert_allclose(picture @ affine, ours, atol=1e-6)


def test_psm_moves_back_where_the_light_is_in_view():
    # At 20 degrees of 60 the image of the light lies beside the cube's far face: unmoved, part of
    # the slice would lie behind the horizon.
    camera = lens(60.0, far=50.0)
    made = Warp(PSM, camera, light_at(np.radians(20)), 1.0, 50.0)
    assert 0.0 < made.strength < 49.0
    assert (made.project(sample(camera, 1.0, 50.0))[:, 3] > 0).all()


def test_tsm_gives_the_focus_80_percent():
    for ratio in (4.0, 100.0):
        camera = lens(40.0, far=ratio)
        made = Warp(TSM, camera, light_at(np.pi / 2), 1.0, ratio)
        focus = ratio**0.8  # 80 % of the logarithm of the range
        t = 0.5 * (made.ndc(np.array([0.0, 0.0, -focus]))[1] + 1.0)
        assert t == pytest.approx(0.8, abs=1e-9)
        # Martin and Tan's eta with xi = -0.6: the distance of the point of projection
        lam, delta = made.extent[1], focus - 1.0
        eta = (lam * delta + lam * delta * -0.6) / (lam - 2 * delta - lam * -0.6)
        assert made.extent[1] / made.strength == pytest.approx(eta, rel=1e-9)


def test_tsm_is_the_tightest_trapezoid_about_its_centre_line():
    # Sides through the point of projection touch the slice: its picture touches all four borders.
    camera = lens(70.0, far=30.0)
    for gamma in (0.4, 1.0, 1.6):
        made = Warp(TSM, camera, light_at(gamma), 1.0, 30.0)
        ndc = made.ndc(oracles.camera_corners(camera, 1.0, 30.0))[:, :2]
        np.testing.assert_allclose(ndc.min(axis=0), -1.0, atol=1e-9)
        np.testing.assert_allclose(ndc.max(axis=0), 1.0, atol=1e-9)
