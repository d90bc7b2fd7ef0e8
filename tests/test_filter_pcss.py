"""Soft shadows of a sun disc: penumbrae as wide as rays have them, hard where nothing is between
(docs/numerics.md 32)."""

import numpy as np
import pytest
import small_scenes
from test_shadow_mask import OUTPUTS as ORACLE_OUTPUTS
from test_shadow_mask import SIZE, assert_mask_matches

import csm
from csm import shapes

SUN_DEG = 5.0
OUTPUTS = ("mask", "valid", "view_depth")
DISTANCES = (1.0, 2.0, 3.0, 4.0)
CONVERGED = {"filter": "pcss", "filter_size": 65, "tap_count": 64, "disc": "vogel", "rotated": True}


def occluder(kind, distance):
    """(scene, point of the shadow's edge, that far along the ray below the edge of a wall or of a
    pole); the sun is at 45 degrees from +x. Both are thin: a map knows the side to the sun."""
    height = distance * np.sqrt(0.5)
    if kind == "wall":
        thing, edge = shapes.box((-0.01, 0, -6), (0.01, height, 6)), (-height, 0.0, 0.0)
    else:
        thing, edge = shapes.box((-0.01, 0, -0.8), (0.01, 8, 0.8)), (-height, 0.0, 0.8)
    ground = shapes.mesh("ground", shapes.ground(12.0))
    return csm.Scene([ground, shapes.mesh(kind, thing)]), np.array(edge)


def profiles(renderer, kind, distance, sun_deg=SUN_DEG, **changes):
    """(places [m], mask and truth across the edge, averaged along it)."""
    scene, edge = occluder(kind, distance)
    up = (0, 0, -1) if kind == "wall" else (1, 0, 0)  # columns run across the edge
    half = max(3.0 * distance * np.tan(np.radians(0.5 * SUN_DEG)), 0.1)
    camera = csm.Camera.orthographic(
        edge + np.array([0, 10, 0]), edge, up=up, height=2.0 * half, near=7, far=13, size=(96, 96)
    )
    settings = csm.ShadowSettings(cascade_count=1, map_size=1024, view_range="camera")
    settings = settings.replace(**CONVERGED).replace(**changes)
    sun = csm.Sun.from_angles(90.0, 45.0, angular_diameter_deg=sun_deg)
    frame = renderer.render(scene, camera, sun, settings, outputs=OUTPUTS)
    truth = csm.truth(scene, camera, sun, rays_per_pixel=64 if sun_deg else 1)
    places = (np.arange(96) + 0.5) / 96 * 2.0 * half
    mask, exact = frame.mask.mean(axis=0), truth.mask.mean(axis=0)
    if exact[0] > exact[-1]:
        mask, exact = mask[::-1], exact[::-1]
    return places, mask, exact, frame


def width(places, profile, share=0.1):
    rising = np.maximum.accumulate(profile)
    return np.interp(1.0 - share, rising, places) - np.interp(share, rising, places)


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("kind", ["wall", "pole"])
def test_penumbrae_are_as_wide_as_those_of_rays(renderer, kind, distance):
    places, mask, exact, frame = profiles(renderer, kind, distance)
    radius = distance * np.tan(np.radians(0.5 * SUN_DEG))
    assert 6.0 < radius / frame.cascades.texel_size.max() < 30.0
    for share in (0.1, 0.05):
        assert width(places, mask, share) == pytest.approx(width(places, exact, share), rel=0.1)
    # Half a texel, which the penumbra meets over its whole width, and the taps' own 1/64.
    texel = frame.cascades.texel_size.max()
    assert np.abs(mask - exact).max() < 0.5 * texel / radius + 3.0 / 64
    # By theory: the wall is met at 45 degrees, and 0.687 of a disc's diameter hold 80 % of it.
    theory = 0.687 * 2.0 * radius * (np.sqrt(2.0) if kind == "wall" else 1.0)
    assert width(places, mask) == pytest.approx(theory, rel=0.1)


@pytest.mark.parametrize("changes", [
    {"light_basis": "world"}, {"warp": "lispsm"}, {"storage": "atlas"},
    {"depth_format": "d16"}, {"tap_count": 16, "disc": "poisson"}, {"reversed_depth": True},
], ids=lambda changes: " ".join(map(str, changes.values())))  # fmt: skip
def test_penumbrae_by_other_ways(renderer, changes):
    tolerance = 0.15 if changes.get("tap_count") == 16 else 0.1  # 16 taps miss part of the blockers
    # a skew makes an ellipse of the sun's disc, a warp has depths that no metre is constant in
    places, mask, exact, _ = profiles(renderer, "wall", 3.0, **changes)
    assert width(places, mask) == pytest.approx(width(places, exact), rel=tolerance)


def test_shadows_harden_towards_contact(renderer):
    widths = []
    for distance in (0.5, *DISTANCES):
        places, mask, _, _ = profiles(renderer, "wall", distance)
        widths.append(width(places, mask) / distance)
    np.testing.assert_allclose(widths, np.mean(widths), rtol=0.1)  # in proportion to the distance


def test_filter_size_limits_the_penumbra(renderer):
    places, mask, _, frame = profiles(renderer, "wall", 4.0, filter_size=17)
    radius = 8.5 * frame.cascades.texel_size.max()
    assert width(places, mask) == pytest.approx(0.687 * 2.0 * radius * np.sqrt(2.0), rel=0.1)


@pytest.mark.parametrize("scene", small_scenes.SCENES)
def test_under_a_point_sun_it_is_a_hard_compare(renderer, scene):
    scene = small_scenes.SCENES[scene]()
    for number, select in enumerate(("map", "interval")):
        camera = small_scenes.camera(number, SIZE)
        settings = csm.ShadowSettings(
            map_size=256, select=select, filter="pcss", filter_size=9, rotated=bool(number)
        )
        sun = csm.Sun(small_scenes.SUNS["low"])
        frame = renderer.render(scene, camera, sun, settings, outputs=ORACLE_OUTPUTS)
        assert_mask_matches(frame)
        assert set(np.unique(frame.mask)) <= {0.0, 1.0}


@pytest.mark.parametrize("height", [1.0, 3.0])
def test_blockers_outside_the_cone_of_the_sun_count_nothing(renderer, height):
    # A wall's face towards the sun reaches down to the receiver: most of it is within reach of the
    # search, and nearer than the edge that throws the penumbra. Texels of a quarter of its radius
    # alone widen it by 2 %; the mean of all blockers in reach makes it 5 % narrower.
    places, mask, exact, frame = profiles(renderer, "wall", height, map_size=int(1024 / height))
    assert frame.cascades.texel_size.max() * 32 > 4 * height * np.tan(np.radians(0.5 * SUN_DEG))
    assert width(places, mask) == pytest.approx(width(places, exact), rel=0.03)


def test_a_low_edge_before_a_high_one_darkens_only_its_own_penumbra(renderer):
    # The shadow of a low wall ends a little beyond that of a high one. Past its penumbra only the
    # high wall still hides part of the sun, through a disc that is wide enough to meet both.
    low, high, between = 0.25, 4.0, 0.04
    scene, edge = occluder("wall", low)
    foot = np.sqrt(0.5) * (high - low) + between
    tall = shapes.box((foot - 0.01, 0, -6), (foot + 0.01, np.sqrt(0.5) * high, 6))
    scene = scene.merge(csm.Scene([shapes.mesh("tall", tall)]))
    camera = csm.Camera.orthographic(
        edge + np.array([0, 10, 0]), edge, up=(0, 0, -1), height=0.8, near=7, far=13, size=(96, 96)
    )
    settings = csm.ShadowSettings(cascade_count=1, map_size=1024, view_range="camera", **CONVERGED)
    sun = csm.Sun.from_angles(90.0, 45.0, angular_diameter_deg=SUN_DEG)
    frame = renderer.render(scene, camera, sun, settings, outputs=OUTPUTS)
    truth = csm.truth(scene, camera, sun, rays_per_pixel=64)
    away = (edge[0] - small_scenes.positions_of(frame)[0, :, 0]) * np.sqrt(0.5)
    beyond = (away > 0.065) & (away < 0.2)
    off = (frame.mask.mean(axis=0) - truth.mask.mean(axis=0))[beyond]
    assert truth.mask.mean(axis=0)[beyond].min() < 0.85
    assert np.abs(off).max() < 0.06


def test_the_diameter_of_the_sun_is_a_number_of_the_frame(renderer):
    scene, camera = csm.scenes.plane_and_box(), small_scenes.camera()
    settings = csm.ShadowSettings(cascade_count=1, map_size=256, **CONVERGED)
    soft = []
    compiled = None
    for degrees in (0.0, 0.53, 5.0, 20.0):
        sun = csm.Sun((1, 1, 0), angular_diameter_deg=degrees)
        frame = renderer.render(scene, camera, sun, settings)
        soft.append(int(((frame.mask > 0.0) & (frame.mask < 1.0)).sum()))
        compiled = compiled or renderer.info["programs_compiled"]
        assert renderer.info["programs_compiled"] == compiled
    assert soft[0] == 0
    assert soft[1] < soft[2] < soft[3]
