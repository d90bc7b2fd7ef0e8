"""Biases on planes of every slope: no acne with the closed form, acne without it, shadows not lost
by more than theory says (docs/numerics.md 11; D1 and D2 of 16)."""

import mask_oracle
import numpy as np
import pytest
import small_scenes

import csm
from csm import shapes

TO_LIGHT = np.array([0.36, 0.8, 0.48])
SLOPES = [0.0, 0.1, 1.0, 5.0, 50.0, 1e3]
AZIMUTHS = [0.0, 22.5, 45.0]
FILTERS = {
    1: 0,
    2: 0.5,
    3: 1,
    5: 2,
    7: 3,
}  # filter_size to the reach of its taps beyond their own texel
MAP_SIZE = 96
EXTENT = 10.0  # m of the plane, across the light
RASTER = 2.0**-7  # texels of slope: sub-texel snapping of corners and its interpolation
RANGE_ROUNDING = 4.0 * 2.0**-24  # clip depth


class Plane:
    """A plane tilted against the light, and a camera that looks straight at all of it: in light
    space both are squares of EXTENT metres, however long the plane must be for that. The view is
    a thin slice, so that texels are square at every azimuth."""

    def __init__(self, slope, azimuth_deg):
        self.sun = csm.Sun(TO_LIGHT)
        x_axis, y_axis = self.light_axes()
        azimuth = np.radians(azimuth_deg)
        steepest = np.cos(azimuth) * x_axis + np.sin(azimuth) * y_axis
        level = np.cross(steepest, self.sun.to_light)
        uphill = (steepest + slope * self.sun.to_light) / np.hypot(1.0, slope)
        half = 0.5 * EXTENT * np.array([1.0, np.hypot(1.0, slope)])
        corners = [a * half[0] * level + b * half[1] * uphill for a, b in
                   ((-1, -1), (1, -1), (1, 1), (-1, 1))]  # fmt: skip
        self.scene = csm.Scene.from_arrays(corners, [[0, 1, 2], [0, 2, 3]])
        normal = np.cross(level, uphill)
        self.camera = csm.Camera(
            5.0 * normal, level, uphill, normal, 0.9 * half[0], 0.9 * half[1], 4.999, 5.001,
            (150, 150), True,
        )  # fmt: skip

    def light_axes(self):
        """Light x and y as the cascades have them."""
        camera = csm.Camera.look_at((0, 0, 1), (0, 0, 0))
        fitted = csm.fit_cascades(camera, self.sun, csm.ShadowSettings())
        return fitted.light_from_world[0][:2, :3]

    def render(self, renderer, **changes):
        """Rows of pixels that nothing shadows; all of them face the sun."""
        settings = csm.ShadowSettings(cascade_count=1, map_size=MAP_SIZE, fit="box", **changes)
        outputs = ("mask", "valid", "shadow_maps")
        frame = renderer.render(self.scene, self.camera, self.sun, settings, outputs=outputs)
        assert frame.valid.all()
        return frame

    def acne(self, renderer, **changes):
        """Share of pixels that are not lit."""
        return float((self.render(renderer, **changes).mask < 1.0).mean())


def filter_of(filter_size):
    return {"filter": "pcf", "filter_size": filter_size} if filter_size > 1 else {}


def closed_form(frame, reach, depth_format, share=1.0):
    """Manual biases: `share` of the slope term of docs/numerics.md 11, all of the other terms."""
    span = np.diff(frame.cascades.depth_range[0])[0]
    texel = frame.cascades.texel_size[0].max()
    quantum = mask_oracle.QUANTUM[depth_format]
    # Coordinates up to the plane's far end, in float32, on both sides of the compare.
    coordinates = np.abs(frame.camera.eye).max() + frame.camera.half_height
    rounding = 0.5 * quantum + RANGE_ROUNDING + 16.0 * 2.0**-24 * coordinates / span
    return {
        "bias": "manual",
        "slope_bias": share * (reach + 0.5) + (RASTER if share == 1.0 else 0.0),
        "constant_bias_texels": rounding * span / texel,
    }


# -- acne ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("depth_format", mask_oracle.QUANTUM)
@pytest.mark.parametrize("slope", SLOPES)
def test_d1_automatic_bias_leaves_no_acne(figure, renderer, slope, depth_format):
    worst = 0.0
    for azimuth in AZIMUTHS:
        plane = Plane(slope, azimuth)
        for filter_size in FILTERS:
            changes = {"depth_format": depth_format, **filter_of(filter_size)}
            worst = max(worst, plane.acne(renderer, **changes))
    figure("D1", f"acne under the automatic bias, {depth_format}", worst, 0, "share")


@pytest.mark.parametrize("range_m", [1e3, 1e5])
@pytest.mark.parametrize("depth_format", mask_oracle.QUANTUM)
def test_d1_automatic_bias_covers_the_quanta_of_long_ranges(
    figure, renderer, depth_format, range_m
):
    worst = 0.0
    # Specks far up and down the light stretch the depth range; the quantum grows with it.
    for slope in (0.0, 0.1, 5.0):
        plane = Plane(slope, 22.5)
        for end in (-0.5, 0.5):
            speck = end * range_m * plane.sun.to_light + 50.0 * plane.light_axes()[0]
            triangle = speck + 1e-3 * np.eye(3)
            plane.scene = plane.scene.merge(csm.Scene.from_arrays(triangle, [[0, 1, 2]]))
        for filter_size in FILTERS:
            changes = {"depth_format": depth_format, **filter_of(filter_size)}
            worst = max(worst, plane.acne(renderer, **changes))
    figure("D1", f"acne under the automatic bias, {depth_format}", worst, 0, "share")


@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize("slope", SLOPES[1:-1])
def test_d1_without_bias_half_the_surface_is_acne(renderer, slope, azimuth):
    # Zero is a value. A point is as likely above the centre of its texel as below.
    acne = Plane(slope, azimuth).acne(renderer, bias="manual")
    assert acne == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("filter_size", FILTERS)
@pytest.mark.parametrize("depth_format", mask_oracle.QUANTUM)
def test_d1_the_closed_form_is_enough(figure, renderer, depth_format, filter_size):
    worst = 0.0
    for slope in SLOPES[:-1]:
        for azimuth in AZIMUTHS:
            plane = Plane(slope, azimuth)
            fitted = plane.render(renderer, depth_format=depth_format, **filter_of(filter_size))
            changes = closed_form(fitted, FILTERS[filter_size], depth_format)
            changes |= {"depth_format": depth_format, **filter_of(filter_size)}
            worst = max(worst, plane.acne(renderer, **changes))
    figure("D1", f"acne at 1.0 of the closed form, {depth_format}", worst, 0, "share")


@pytest.mark.parametrize("depth_format", mask_oracle.QUANTUM)
@pytest.mark.parametrize("span", [10.0, 1e3, 1e5])
@pytest.mark.parametrize("reach", range(4))
def test_d1_the_closed_form_in_doubles(figure, reach, span, depth_format):
    # No renderer: a plane in a map of depths at texel centres, rounded to the format, looked up
    # through a kernel. Nothing fails at 1.0 of the bound; at 0.9 something does where the steepest
    # direction is the map's diagonal.
    quantum, texel = mask_oracle.QUANTUM[depth_format] * span, 0.01
    rng = np.random.default_rng(40 + reach)
    worst, found = -1.0, True
    at = rng.uniform(-0.5, 0.5, size=(4000, 2))
    at[:4] = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * (0.5 - 1e-9)
    texels = rng.integers(0, 1000, size=(4000, 2))
    taps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2), axis=-1).reshape(-1, 2)
    for slope in SLOPES:
        for azimuth in AZIMUTHS:
            turn = np.radians(azimuth)
            gradient = slope * np.array([np.cos(turn), np.sin(turn)])
            # Depths in doubles, relative to the middle of the range: what matters is the quantum.
            depth = (texels + at) @ gradient * texel
            centres = (texels[:, None] + taps) @ gradient * texel
            stored = np.round(centres / quantum) * quantum
            needed = (depth[:, None] - stored).max(axis=1)
            tilt = np.abs(gradient).sum() * texel * (reach + 0.5)
            rounding = 64 * 2.0**-53 * np.abs(centres).max()
            bound = tilt + 0.5 * quantum
            worst = max(worst, (needed - bound - rounding).max() / bound)
            if azimuth == 45.0 and tilt > quantum:
                found &= (needed > 0.9 * tilt - 0.5 * quantum).any()
    figure("D1", "bias needed beyond the closed form, in doubles", worst, 0, "relative")
    assert found, "nine tenths of the bound would do"


def corner_share(azimuth_deg, share):
    """Share of a texel's area whose slope term is above `share` of the largest: the corner where
    (c x + s y) > share (c + s) / 2 with x, y in -1/2 .. 1/2, a triangle or a strip."""
    c, s = np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))
    missing = 0.5 * (1.0 - share) * (c + s)
    return missing if s < 1e-9 else 0.5 * missing**2 / (c * s)


@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize("slope", [0.1, 1.0, 5.0, 50.0])
def test_d1_nine_tenths_of_the_closed_form_are_not(figure, renderer, slope, azimuth):
    # The closed form is tight: what is missing shows at the corners of the texels, and only there.
    plane = Plane(slope, azimuth)
    fitted = plane.render(renderer)
    frame = plane.render(renderer, **closed_form(fitted, 0, "d32f", share=0.9))
    acne = float((frame.mask < 1.0).mean())
    # 22,500 pixels sample the corners of some 9000 texels; half of it for chance and for the
    # rounding terms, which are there in full.
    expected = corner_share(azimuth, 0.9)
    figure(
        "D1", "acne at 0.9 of the closed form, from theory", abs(acne / expected - 1), 0.5,
        "relative", picture=lambda: np.round(255 * frame.mask).astype(np.uint8),
    )  # fmt: skip


def test_d1_a_kernel_needs_a_bias_of_its_own_reach(renderer):
    # The bias of one tap under 7 x 7 compares without a receiver plane: acne; with it: none.
    plane = Plane(1.0, 45.0)
    fitted = plane.render(renderer, **filter_of(7))
    small = closed_form(fitted, 0, "d32f") | filter_of(7)
    assert plane.acne(renderer, **small) > 0.5
    assert plane.acne(renderer, **small, receiver_plane=True) == 0.0


@pytest.mark.parametrize("filter_size", [1, 3, 7])
@pytest.mark.parametrize("slope", SLOPES[:-1])
def test_d1_a_receiver_plane_needs_no_slope_bias(figure, renderer, slope, filter_size):
    worst = 0.0
    # Exact on planes: what is left is half a quantum and rounding, and the rasteriser's own term.
    for azimuth in AZIMUTHS:
        plane = Plane(slope, azimuth)
        fitted = plane.render(renderer, **filter_of(filter_size))
        changes = closed_form(fitted, 0, "d32f") | filter_of(filter_size)
        changes |= {"receiver_plane": True, "slope_bias": RASTER}
        worst = max(worst, plane.acne(renderer, **changes))
    figure("D1", "acne with a receiver plane and q/2", worst, 0, "share")


def test_d1_a_normal_offset_lifts_by_its_texels(renderer):
    # Moved by o t sin(theta) along the normal, a plane's depth changes by o t sin / cos =
    # o t |g|: at azimuth 0 half a texel's slope is needed, less shows acne, more none.
    plane = Plane(1.0, 0.0)
    fitted = plane.render(renderer)
    constant = closed_form(fitted, 0, "d32f")["constant_bias_texels"]
    changes = {"bias": "manual", "constant_bias_texels": constant}
    # Along the slope: half a texel of it, of which cos(theta)^2 is by depth and sin^2 by place.
    assert plane.acne(renderer, **changes, normal_offset_texels=0.25) > 0.1
    assert plane.acne(renderer, **changes, normal_offset_texels=0.75) == 0.0


@pytest.mark.parametrize("elevation", [0.1, 1.0, 5.0])
@pytest.mark.parametrize("filter_size", FILTERS)
def test_d2_grazing_light_leaves_bare_ground_lit(figure, renderer, filter_size, elevation):
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(200.0))])
    camera = small_scenes.camera(near=0.1, far=500.0)
    settings = csm.ShadowSettings(map_size=512, **filter_of(filter_size))
    for azimuth in (0.0, 33.0, 135.0):
        sun = csm.Sun.from_angles(azimuth, elevation)
        frame = renderer.render(scene, camera, sun, settings, outputs=("mask",))
        figure(
            "D2", "bare ground in shadow under a grazing sun", (frame.mask != 1.0).mean(), 0,
            "share", picture=lambda mask=frame.mask: np.round(255 * mask).astype(np.uint8),
        )  # fmt: skip


# -- edge-on ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("cosine", [1e-1, 1e-3, 2e-5, 1e-5, 1e-7, 0.0, -1e-7, -1e-3])
@pytest.mark.parametrize("filter_size", FILTERS)
def test_d2_surfaces_towards_edge_on_are_finite(figure, renderer, filter_size, cosine):
    # A wall and a ground; the sun comes down the wall's face, `cosine` off its plane.
    wall = shapes.mesh("wall", shapes.box((-5, 0, -1), (5, 4, 0)))
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(12.0)), wall])
    camera = csm.Camera.look_at((1, 3, 8), (0, 1.5, 0), near=0.1, far=60, size=small_scenes.SIZE)
    down_the_face = np.array([0.6, 0.8, 0.0]) * np.sqrt(1.0 - cosine * cosine)
    sun = csm.Sun(down_the_face + np.array([0.0, 0.0, cosine]))
    settings = csm.ShadowSettings(map_size=256, **filter_of(filter_size))
    outputs = ("mask", "valid", "normal", "view_depth", "cascade_index")
    frame = renderer.render(scene, camera, sun, settings, outputs=outputs)
    wrong = np.count_nonzero(~((frame.mask >= 0.0) & (frame.mask <= 1.0)))
    figure(
        "D2", "pixels that are no visibility, towards edge-on", wrong, 0, "pixels",
        picture=lambda: np.round(255 * frame.mask).astype(np.uint8),
    )  # fmt: skip
    face = frame.valid & (frame.normal[..., 2] > 0.99)
    ground = frame.valid & (frame.normal[..., 1] > 0.99)
    assert np.count_nonzero(face) > 1000
    assert np.count_nonzero(ground) > 1000
    if cosine <= 1e-5 - mask_oracle.EPS:
        assert (frame.mask[face] == 0.0).all()
    if cosine == 1e-1 and filter_size == 1:
        # Nothing stands before the wall, but a texel's centre may lie past its foot, where the
        # wall's plane goes on below the ground.
        assert (frame.mask[face] == 1.0).mean() > 0.98
    # The ground before the wall is in nobody's shadow, out of the kernel's reach.
    z = small_scenes.positions_of(frame)[..., 2]
    reach = (filter_size / 2 + 1.0) * frame.cascades.texel_size.max() / 0.8
    assert (frame.mask[ground & (z > reach)] == 1.0).all()


# -- peter-panning ---------------------------------------------------------------------------------


@pytest.mark.parametrize("bias_m", [0.1, 0.3])
@pytest.mark.parametrize("elevation", [25.0, 45.0, 65.0])
def test_a_bias_lights_a_strip_along_the_foot_of_a_wall(renderer, elevation, bias_m):
    # A point of the ground d from a wall across the light sees it at d / sin(theta) along the ray:
    # with depths lifted by b it counts as lit if d < b sin(theta).
    wall = [[0, 0, -4], [0, 0, 4], [0, 3, 4], [0, 3, -4]]
    scene = csm.Scene(
        [shapes.mesh("ground", shapes.ground(6.0)), csm.Mesh(wall, [[0, 1, 2], [0, 2, 3]])]
    )
    camera = csm.Camera.orthographic(
        (-0.5, 10, 0), (-0.5, 0, 0), up=(0, 0, -1), height=1.0, near=1, far=20, size=(1000, 40)
    )
    camera = camera.replace(half_width=0.6, half_height=0.5)
    sun = csm.Sun.from_angles(90.0, elevation)  # towards +x: the shadow falls to -x
    settings = csm.ShadowSettings(cascade_count=1, map_size=1024, bias="manual")
    fitted = csm.fit_cascades(camera, sun, settings, scene=scene)
    texel = fitted.texel_size.max()
    settings = settings.replace(constant_bias_texels=bias_m / texel)
    frame = renderer.render(scene, camera, sun, settings)
    x = small_scenes.positions_of(frame)[20, :, 0]
    lit = (frame.mask[20] == 1.0) & (x < 0.0)
    width = lit.sum() * 1.2 / 1000
    sine = np.cos(np.radians(elevation))
    # Depths are those of the texels' centres: half a texel of slope on the wall (cot) and on the
    # ground (tan), the lookup's own half texel along the ground, and a pixel.
    slack = 0.5 * texel * (sine * (1 / sine + sine / np.sin(np.radians(elevation)) + 1))
    slack += 0.5 * texel / np.sin(np.radians(elevation)) + 1.2 / 1000
    assert width == pytest.approx(bias_m * sine, abs=slack)
    assert lit[(x < -1e-3) & (x > -bias_m * sine + slack)].all()
