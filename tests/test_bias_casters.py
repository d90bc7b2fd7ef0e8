"""Biases on the casters' side and the sides of casters that are drawn: pushed back by as much as
receivers would be lifted, closed solids that cast by their backs (docs/numerics.md 30)."""

import map_oracle
import mask_oracle
import numpy as np
import pytest
import small_scenes
from test_bias import AZIMUTHS, FILTERS, SLOPES, Plane, closed_form, corner_share
from test_bias import filter_of as filtered

import csm
from csm import shapes

CASTERS = {"bias": "manual", "bias_side": "caster"}
MAPS = ("shadow_maps",)


def steepest_share(azimuth_deg):
    """(|gx| + |gy|) / max(|gx|, |gy|): what the rasteriser's measure of a slope leaves out."""
    axes = np.abs([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))])
    return axes.sum() / axes.max()


def on_casters(changes, azimuth):
    slope = changes["slope_bias"] * steepest_share(azimuth)
    return changes | {"bias_side": "caster", "slope_bias": slope}


# -- the rasteriser's slope ------------------------------------------------------------------------


@pytest.mark.parametrize("reverse", [False, True], ids=["", "reversed"])
@pytest.mark.parametrize("depth_format", mask_oracle.QUANTUM)
def test_d1_casters_pushed_back_by_the_closed_form_show_no_acne(
    figure, renderer, depth_format, reverse
):
    worst = 0.0
    common = {"depth_format": depth_format, "reversed_depth": reverse}
    for slope in SLOPES[:-1]:
        for azimuth in AZIMUTHS:
            plane = Plane(slope, azimuth)
            for size in (1, 7):
                frame = plane.render(renderer, **common, **filtered(size))
                changes = on_casters(closed_form(frame, FILTERS[size], depth_format), azimuth)
                worst = max(worst, plane.acne(renderer, **changes, **common, **filtered(size)))
    figure("D1", f"acne, casters pushed back by the closed form, {depth_format}", worst, 0, "share")


@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize("slope", [0.1, 1.0, 50.0])
def test_d1_nine_tenths_of_the_push_are_not_enough(figure, renderer, slope, azimuth):
    plane = Plane(slope, azimuth)
    fitted = plane.render(renderer)
    changes = closed_form(fitted, 0, "d32f", share=0.9)
    frame = plane.render(renderer, **on_casters(changes, azimuth))
    plain = plane.render(renderer, **CASTERS, constant_bias_texels=changes["constant_bias_texels"])
    covered = (frame.shadow_maps[0] < 1.0) & (plain.shadow_maps[0] < 1.0)
    pushed = np.median((frame.shadow_maps[0] - plain.shadow_maps[0])[covered])
    texel, span = frame.cascades.texel_size[0].max(), np.diff(frame.cascades.depth_range[0])[0]
    steepest = slope * np.cos(np.radians(azimuth)) * texel / span  # max(|gx|, |gy|)
    measured = pushed / (0.45 * steepest_share(azimuth) * steepest)
    # OpenGL leaves it to the driver whether a slope is the length of the gradient or the larger of
    # its parts; 1 % for the float32 depths of a map between which slopes are measured.
    most = np.hypot(1.0, np.tan(np.radians(azimuth)))
    assert 0.99 <= measured <= 1.01 * most
    if measured < 1.01:
        acne, expected = float((frame.mask < 1.0).mean()), corner_share(azimuth, 0.9)
        figure(
            "D1", "acne at 0.9 of the push, from theory", abs(acne / expected - 1), 0.5, "relative",
            picture=lambda: np.round(255 * frame.mask).astype(np.uint8),
        )  # fmt: skip


# -- the constant part -----------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [{}, {"reversed_depth": True}, {"pancake": True}], ids=str)
@pytest.mark.parametrize("depth_format", mask_oracle.QUANTUM)
@pytest.mark.parametrize("texels", [3.0, -3.0])
def test_a_constant_moves_every_depth_by_as_many_metres(renderer, texels, depth_format, changes):
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    settings = csm.ShadowSettings(
        cascade_count=2, map_size=128, depth_format=depth_format, cull="none", **CASTERS, **changes
    )
    sun = csm.Sun(small_scenes.SUNS["high"])
    plain, moved = (
        renderer.render(scene, camera, sun, settings.replace(constant_bias_texels=t), outputs=MAPS)
        for t in (0.0, texels)
    )
    for i in range(2):
        span = np.diff(plain.cascades.depth_range[i])[0]
        expected = texels * plain.cascades.texel_size[i].max() / span
        before, after = plain.shadow_maps[i].astype(float), moved.shadow_maps[i].astype(float)
        covered = before < 1.0
        assert covered.mean() > 0.05
        # what is moved before the near end stays at it, what is moved past the far end is gone
        error = np.abs(after - np.clip(before + expected, 0.0, 1.0))[covered]
        # Rounded to the format, and interpolated in float32, in both maps; slivers, whose planes
        # start from the map's corner at hundreds of times their depth, lose more of it.
        tolerance = 2.0 * (mask_oracle.QUANTUM[depth_format] + map_oracle.RANGE_ROUNDING)
        assert np.quantile(error, 0.995) <= tolerance
        assert error.max() <= 4.0 * tolerance
        assert (after[~covered] == 1.0).all()


@pytest.mark.parametrize("constant", [0.6, 4.0, -0.5])
@pytest.mark.parametrize("warp", ["none", "lispsm", "tsm"])
def test_casters_pushed_back_are_receivers_lifted(renderer, warp, constant):
    # The same compare, but for a quantum and, under a warp, the size of a texel at its centre
    # instead of at the point.
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    settings = csm.ShadowSettings(
        map_size=128, warp=warp, bias="manual", receiver_plane=True, constant_bias_texels=constant
    )
    for name in ("high", "low"):
        masks = [
            renderer.render(
                scene, camera, csm.Sun(small_scenes.SUNS[name]), settings.replace(bias_side=side),
                outputs=("mask",),
            ).mask
            for side in ("receiver", "caster")
        ]  # fmt: skip
        plain = renderer.render(
            scene, camera, csm.Sun(small_scenes.SUNS[name]),
            settings.replace(constant_bias_texels=0.0), outputs=("mask",),
        )  # fmt: skip
        assert np.mean(masks[0] != plain.mask) > 0.02  # the bias does something
        assert np.mean(masks[0] != masks[1]) < (1e-3 if warp == "none" else 5e-3)


@pytest.mark.parametrize("warp", ["none", "lispsm", "psm", "tsm"])
def test_a_slope_is_pushed_back_in_a_warped_map_too(renderer, warp):
    # Bare ground: acne on half of it without a slope, none at 1/2 texel of |gx| + |gy| and what
    # 2 max(|gx|, |gy|) and the rasteriser make of it.
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(40.0))])
    camera = small_scenes.camera(1, near=0.2, far=40.0)
    sun = csm.Sun.from_angles(57.0, 28.0)
    settings = csm.ShadowSettings(map_size=256, warp=warp, **CASTERS, constant_bias_texels=1e-3)
    acne = {}
    for slope in (0.0, 0.25, 1.05):
        frame = renderer.render(
            scene, camera, sun, settings.replace(slope_bias=slope), outputs=("mask", "valid")
        )
        acne[slope] = np.mean(frame.mask[frame.valid] < 1.0)
    assert acne[0.0] > 0.3
    assert 0.01 < acne[0.25] < acne[0.0]
    assert acne[1.05] == 0.0


# -- sides -----------------------------------------------------------------------------------------


def solids():
    """Closed solids in the air: a box baked, one mirrored and baked, cones drawn as instances,
    every third mirrored."""
    box = shapes.mesh("box", shapes.box((-1, 3, -1), (1, 4, 1)))
    mirrored = shapes.mesh("mirrored", shapes.box((2, 2, 2), (4, 2.5, 4)))
    cone = shapes.mesh("cone", shapes.cone(0.8, 0.0, 2.0, sides=6))
    rng = np.random.default_rng(3)
    scales = rng.uniform(0.6, 1.5, (12, 3))
    scales[::3, 0] *= -1.0
    angles = np.arange(12) * np.pi / 6
    places = np.stack([6 * np.cos(angles), np.full(12, 1.0), 6 * np.sin(angles)], axis=-1)
    cones = shapes.placements(places, rng.uniform(0, 360, 12), scales)
    mirror = np.diag([1.0, 1.0, -1.0, 1.0])
    return csm.Scene(
        [box, mirrored, cone], [0, 1] + [2] * 12, np.concatenate([[np.eye(4), mirror], cones])
    )


@pytest.mark.parametrize("changes", [
    {}, {"light_basis": "world"}, {"warp": "lispsm"}, {"reversed_depth": True}, {"pancake": True},
    {"fit": "visible", "turned": True}, {"storage": "atlas"}, {"depth_format": "d16"},
], ids=str)  # fmt: skip
@pytest.mark.parametrize("to_light", [(0.4, 1.0, 0.3), (-0.5, 0.6, -0.7), (0.3, -1.0, 0.4)])
def test_front_faces_are_those_that_face_the_sun(renderer, changes, to_light):
    # Of closed solids the sun sees fronts, and every ray that enters leaves through a back.
    scene, camera = solids(), small_scenes.camera(0)
    settings = csm.ShadowSettings(cascade_count=2, map_size=128, cull="none", **changes)
    both, front, back = (
        renderer.render(
            scene, camera, csm.Sun(to_light), settings.replace(caster_faces=faces), outputs=MAPS
        ).shadow_maps
        for faces in ("both", "front", "back")
    )
    seen = 0
    for i in range(2):
        covered = both[i] < 1.0
        seen += np.count_nonzero(covered)
        # but for slivers at an outline, where rounding decides which side a face shows
        assert np.count_nonzero(front[i] != both[i]) <= 2
        assert np.count_nonzero((back[i] < 1.0) != covered) <= 2
        assert np.count_nonzero(back[i] < front[i]) <= 2
        thick = (back[i] > front[i])[covered & (back[i] > 0.0)]  # pancaked ones have no thickness
        assert np.count_nonzero(~thick) <= 2
    assert seen > 100


def box_on_ground(elevation):
    """A box of 2 x 1 x 4 m on a ground that faces up, and a camera straight above its west side,
    whence the sun does not come."""
    box = shapes.mesh("box", shapes.box((0, 0, -2), (2, 1, 2)))
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(8.0)), box])
    camera = csm.Camera.orthographic(
        (0.0, 10, 0), (0.0, 0, 0), up=(0, 0, -1), height=1.0, near=1, far=20, size=(800, 40)
    )
    return (
        scene,
        camera.replace(half_width=1.6, half_height=0.5),
        csm.Sun.from_angles(90.0, elevation),
    )


@pytest.mark.parametrize("bias_m", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("elevation", [35.0, 55.0])
def test_backs_leak_along_the_foot_and_nowhere_else(renderer, elevation, bias_m):
    """Where the solid stands on its receiver its back lies d / sin(theta) up the ray from a point d
    off its foot: with depths lifted by b it is lit for d < b sin(theta), as behind a thin wall
    (docs/numerics.md 11). Fronts are the solid's thickness further away and shadow all of it."""
    scene, camera, sun = box_on_ground(elevation)
    settings = csm.ShadowSettings(cascade_count=1, map_size=1024, bias="manual")
    texel = csm.fit_cascades(camera, sun, settings, scene=scene).texel_size.max()
    settings = settings.replace(constant_bias_texels=bias_m / texel)
    sine, cosine = np.sin(np.radians(elevation)), np.cos(np.radians(elevation))
    frames = {
        faces: renderer.render(scene, camera, sun, settings.replace(caster_faces=faces))
        for faces in ("both", "front", "back")
    }
    x = small_scenes.positions_of(frames["back"])[20, :, 0]
    reach = 1.0 / np.tan(np.radians(elevation))  # of the shadow
    # a texel along the ground, of which half is the lookup's, half the centre's, and a pixel; and
    # where lookups are lifted the wall's own slope
    slack = texel / sine + 0.5 * texel * (cosine / sine) * cosine + 3.2 / 800
    shadow = (x < -slack) & (x > -reach + slack)
    lit = frames["back"].mask[20] == 1.0
    strip = (x > -bias_m * cosine + slack) & (x < -slack)
    assert lit[strip].all()
    assert not lit[shadow & (x < -bias_m * cosine - slack)].any()
    assert lit[x < -reach - slack].all()
    for faces in ("both", "front"):
        assert not (frames[faces].mask[20] == 1.0)[shadow].any()


@pytest.mark.parametrize("elevation", [35.0, 55.0])
def test_backs_need_no_bias_on_what_the_sun_sees(renderer, elevation):
    scene, camera, sun = box_on_ground(elevation)
    settings = csm.ShadowSettings(cascade_count=1, map_size=512, bias="manual")
    frames = {
        faces: renderer.render(scene, camera, sun, settings.replace(caster_faces=faces))
        for faces in ("both", "back")
    }
    auto = renderer.render(scene, camera, sun, settings.replace(bias="auto"))
    texel = auto.cascades.texel_size.max()
    x = small_scenes.positions_of(auto)[20, :, 0]
    sine = np.sin(np.radians(elevation))
    reach = 1.0 / np.tan(np.radians(elevation))
    # near its western edge the box is thinner than half a texel of depth
    seen = ((x > 2.0 * texel / sine) | (x < -reach - 2.0 * texel / sine)) & (x > -1.5)
    assert (x[seen] > 0).any()
    assert (x[seen] < 0).any() or reach > 1.4
    assert (frames["back"].mask[20][seen] == 1.0).all()
    assert (frames["both"].mask[20][seen] < 1.0).mean() > 0.3  # acne, without any bias
    # the edge of the shadow is the same: the outline of a solid belongs to its fronts and backs
    edge = np.abs(x + reach) < 4.0 * texel / sine
    backs = renderer.render(scene, camera, sun, settings.replace(bias="auto", caster_faces="back"))
    assert np.array_equal(backs.mask[20][edge], auto.mask[20][edge])


# -- in metres -------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [
    {"bias": "manual", "constant_bias_texels": 1.5, "slope_bias": 2.0, "normal_offset_texels": 0.7},
    {"bias": "manual", "bias_side": "caster", "constant_bias_texels": -2.0, "slope_bias": 1.0},
    {"filter": "pcf", "filter_size": 5},
    {"filter": "pcf", "filter_size": 2, "depth_format": "d16"},
    {"bias": "manual", "filter": "pcf", "filter_size": 7, "receiver_plane": True},
    {"bias": "manual", "filter": "pcf", "filter_size": 7},
], ids=str)  # fmt: skip
def test_metres_are_texels_and_quanta_of_each_cascade(renderer, changes):
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    settings = csm.ShadowSettings(map_size=(64, 128, 64, 32), **changes)
    frame = renderer.render(scene, camera, csm.Sun((0.4, 1, 0.3)), settings, outputs=("mask",))
    biases = frame.info["bias"]
    assert biases == csm.bias_metres(frame.cascades, settings)
    manual = settings.bias == "manual"
    two = settings.filter == "pcf" and settings.filter_size == 2
    plane = settings.receiver_plane if manual else not two
    reach = 1.0 if two else 0.5 + (settings.filter_size // 2 if settings.filter == "pcf" else 0)
    for i, bias in enumerate(biases):
        texel = frame.cascades.texel_size[i].max()
        span = np.diff(frame.cascades.depth_range[i])[0]
        quantum = mask_oracle.QUANTUM[settings.depth_format] * span
        rounding = 0.0 if manual else quantum + 4.0 * 2.0**-24 * span
        slope = settings.slope_bias if manual else 1.25 if two else 0.25
        expected = {
            "texel_m": texel,
            "quantum_m": quantum,
            "constant_m": settings.constant_bias_texels * texel + rounding,
            "slope_m": slope * texel,
            "normal_offset_m": settings.normal_offset_texels * texel,
            "needed_constant_m": 0.5 * quantum,
            "needed_slope_m": 0.0 if plane else reach * texel,
        }
        assert bias.pop("side") == settings.bias_side
        assert bias.pop("receiver_plane") == plane
        assert bias == pytest.approx(expected, rel=1e-12)


def test_metres_of_what_a_map_does(renderer):
    # the depth that a receiver is lifted by, found by bisection of where a roof stops to shadow
    ground = [[-4, 0, -4], [-4, 0, 4], [4, 0, 4], [4, 0, -4]]
    settings = csm.ShadowSettings(
        cascade_count=1, map_size=64, bias="manual", constant_bias_texels=2.0
    )
    camera = csm.Camera.look_at((0, 6, 3), (0, 0, 0), near=0.5, far=20, size=(64, 64))
    low, high = 0.0, 2.0
    for _ in range(20):
        height = 0.5 * (low + high)
        roof = np.array(ground) * [1, 0, 1] + [0, height, 0]
        post = [[5, 0, 0], [5, 2, 0], [5, 0, 1]]  # keeps the bounds, hence the window
        scene = csm.Scene.from_arrays(
            [*ground, *roof, *post], [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7], [8, 9, 10]]
        )
        frame = renderer.render(
            scene, camera, csm.Sun((0, 1, 0)), settings, outputs=("mask",), points=[[0.3, 0, 0.2]]
        )
        low, high = (height, high) if frame.point_visibility[0] == 1.0 else (low, height)
    assert low == pytest.approx(frame.info["bias"][0]["constant_m"], abs=1e-4)


def test_a_warped_map_has_its_own_metres_at_its_centre():
    scene, camera = small_scenes.soup(), small_scenes.camera(1)
    settings = csm.ShadowSettings(warp="lispsm", map_size=256, bias="manual", slope_bias=1.0)
    cascades = csm.fit_cascades(camera, csm.Sun((-0.8, 0.4, 0.5)), settings, scene=scene)
    for i, bias in enumerate(csm.bias_metres(cascades, settings)):
        assert bias["texel_m"] == pytest.approx(cascades.texel_size[i].max(), rel=1e-9)
        # a step of the stored depth at the map's centre, in the middle of the range
        matrix = np.linalg.inv(cascades.clip_from_light[i])
        ends = [matrix @ [0, 0, 0.5 + step, 1.0] for step in (0.0, 2.0**-24)]
        metres = np.diff([end[2] / end[3] for end in ends])[0]
        assert bias["quantum_m"] == pytest.approx(abs(metres), rel=1e-2)


def test_without_maps_there_is_no_bias():
    settings = csm.ShadowSettings(filter="none")
    cascades = csm.fit_cascades(small_scenes.camera(0), csm.Sun((0, 1, 0)), csm.ShadowSettings())
    assert csm.bias_metres(cascades, settings) == []
    with pytest.raises(TypeError, match=r"cascades must be a csm\.Cascades"):
        csm.bias_metres("none", settings)
    with pytest.raises(TypeError, match=r"settings must be a csm\.ShadowSettings"):
        csm.bias_metres(cascades, None)
