"""Soft shadows through moments against the sun's disc traced by Embree: walls and poles whose
shadows fall from four heights (docs/numerics.md 28)."""

import functools

import numpy as np
import pytest

import csm
from csm import shapes

ELEVATION, DIAMETER = 50.0, 4.0  # [degrees]
HEIGHTS = (1.5, 3.0, 6.0, 9.0)  # [m]; a shadow's edge lies HEIGHT / sin(ELEVATION) from its caster
STANDS = (-12.0, -4.0, 4.0, 12.0)  # z [m]
TANGENT = np.tan(np.radians(DIAMETER / 2))
MAPS = ("variance", "summed")


def sun(diameter=DIAMETER):
    towards = np.radians(ELEVATION)
    return csm.Sun((np.cos(towards), np.sin(towards), 0.0), angular_diameter_deg=diameter)


@functools.cache
def scene(kind):
    """A wall or a pole of each height over level ground; shadows fall towards -x."""
    parts = [shapes.ground(30.0)]
    for height, z in zip(HEIGHTS, STANDS, strict=True):
        if kind == "wall":
            parts.append(shapes.box((-0.05, 0, z - 3), (0.05, height, z + 3)))
        else:  # its shadow is looked at a metre below its top's
            parts.append(shapes.box((-0.15, 0, z - 0.15), (0.15, height + 1, z + 0.15)))
    return csm.Scene.from_arrays(*shapes.join(*parts))


def radius(k):
    """Of the disc's penumbra across the light [m]."""
    return HEIGHTS[k] / np.sin(np.radians(ELEVATION)) * TANGENT


def strip(kind, k):
    """A view from above along which the shadow of the wall's top, or of the pole, is crossed."""
    x = -HEIGHTS[k] / np.tan(np.radians(ELEVATION))
    if kind == "wall":
        half, size = 2.2 * radius(k) / np.sin(np.radians(ELEVATION)) * 8 / 256, (256, 8)
    else:
        half, size = 2.2 * (radius(k) + 0.15), (8, 256)
    return csm.Camera.orthographic(
        (x, 50, STANDS[k]), (x, 0, STANDS[k]), up=(0, 0, -1), height=2 * half, near=1, far=60,
        size=size,
    )  # fmt: skip


def settings(pcss_map, **more):
    base = {"cascade_count": 1, "map_size": 1024, "fit": "scene", "filter_size": 65}
    return csm.ShadowSettings(**{**base, "filter": "pcss", "pcss_map": pcss_map, **more})


@functools.cache
def true_profile(kind, k):
    mask = csm.truth(scene(kind), strip(kind, k), sun(), rays_per_pixel=256).mask
    return mask.mean(axis=0 if kind == "wall" else 1)


def profile(renderer, kind, k, wanted, light=None):
    frame = renderer.render(scene(kind), strip(kind, k), light or sun(), wanted, outputs=("mask",))
    return frame.mask.mean(axis=0 if kind == "wall" else 1)


def width(light):
    """Pixels over which light rises from a tenth to nine tenths."""
    light = np.maximum.accumulate(light if light[0] < light[-1] else light[::-1])
    at = np.arange(len(light))
    return np.interp(0.9, light, at) - np.interp(0.1, light, at)


@pytest.mark.parametrize("pcss_map", MAPS)
def test_penumbra_of_a_wall_is_the_suns(renderer, pcss_map):
    """Within 10 % where the disc's radius is 4 texels or more. Below that, at 2.5 texels, four
    lookups between texels are as wide themselves: 12 % too soft; summed areas are not."""
    for k in range(len(HEIGHTS)):
        light, truth = profile(renderer, "wall", k, settings(pcss_map)), true_profile("wall", k)
        tolerance = 0.15 if k == 0 and pcss_map == "variance" else 0.10
        assert width(light) / width(truth) == pytest.approx(1.0, abs=tolerance), HEIGHTS[k]
        assert np.abs(light - truth).mean() < 0.035


@pytest.mark.parametrize("pcss_map", MAPS)
def test_penumbra_grows_with_the_distance(renderer, pcss_map):
    """In metres it is a share of the height alone; pictures are some four radii wide."""
    metres = [width(profile(renderer, "wall", k, settings(pcss_map))) * radius(k) for k in range(4)]
    slopes = np.array(metres[1:]) / HEIGHTS[1:]
    assert np.ptp(slopes) / slopes.mean() < 0.06
    assert metres[0] / HEIGHTS[0] == pytest.approx(slopes.mean(), rel=0.15)


@pytest.mark.parametrize("pcss_map", MAPS)
def test_shadow_of_a_pole_fades_as_the_suns(renderer, pcss_map):
    """From a core that sees nothing of the sun to one that sees half of it."""
    for k in range(len(HEIGHTS)):
        light, truth = profile(renderer, "pole", k, settings(pcss_map)), true_profile("pole", k)
        assert light.min() == pytest.approx(truth.min(), abs=0.08)
        # the pole is 10 texels wide, and a texel's edge lies half a texel off: its shadow's area is
        # right to a tenth
        assert (1 - light).sum() / (1 - truth).sum() == pytest.approx(1.0, abs=0.14)
        assert np.abs(light - truth).mean() < 0.045
    assert truth.min() > 0.5 > 0.1 > true_profile("pole", 1).min()


@pytest.mark.parametrize("pcss_map", MAPS)
def test_a_point_sun_and_contacts_are_hard(renderer, pcss_map):
    texels = 2.0  # that an edge may be wide without a penumbra: a lookup between texels, squared
    wide = profile(renderer, "wall", 2, settings(pcss_map))
    hard = profile(renderer, "wall", 2, settings(pcss_map), sun(0.0))
    camera = strip("wall", 2)
    frame = renderer.render(scene("wall"), camera, sun(0.0), settings(pcss_map))
    texel = frame.cascades.texel_size[0].max() / np.sin(np.radians(ELEVATION))
    pixel = 2 * camera.half_width / camera.size[0]
    assert width(hard) * pixel < texels * texel < 0.2 * width(wide) * pixel
    assert hard.min() < 0.01
    assert hard.max() == 1.0
    # beside the foot of the wall, where its side's shadow begins: the penumbra is narrower than a
    # texel there, 7 cm behind it
    foot = csm.Camera.orthographic((-0.12, 50, 7.0), (-0.12, 0, 7.0), up=(0, 0, -1), height=0.6,
                                   near=1, far=60, size=(4, 200))  # fmt: skip
    side = renderer.render(scene("wall"), foot, sun(), settings(pcss_map)).mask.mean(axis=1)
    assert width(side) * 0.6 / 200 < texels * texel
    assert side.min() < 0.1


@pytest.mark.parametrize("pcss_map", MAPS)
def test_eaves_shadow_walls_high_over_the_ground(renderer, pcss_map):
    """A sun along the wall: it is narrow in the map, the ground beside it far away. A mean over a
    wide area lies behind the wall, as if nothing stood before it."""
    house = csm.Scene.from_arrays(
        *shapes.join(
            shapes.ground(20.0),
            shapes.box((-4, 0, -4), (0, 8, 4)),
            shapes.box((-4.5, 8, -4.5), (0.6, 8.2, 4.5)),
        )
    )
    camera = csm.Camera.look_at((9, 7, 1), (0, 6, 0), fov_y_deg=35, near=1, far=40, size=(80, 60))
    light = csm.Sun((0.2, 0.77, 0.6), angular_diameter_deg=DIAMETER)
    truth = csm.truth(house, camera, light, rays_per_pixel=64)
    frame = renderer.render(house, camera, light, settings(pcss_map, fit="sphere"))
    judged = truth.valid & truth.facing
    dark = judged & (truth.mask < 0.05)
    assert np.count_nonzero(dark) > 1000
    assert frame.mask[dark].mean() < 0.02
    assert np.abs(frame.mask - truth.mask)[judged].mean() < 0.03


@pytest.mark.parametrize("pcss_map", MAPS)
def test_skewed_maps_show_the_same_penumbra(renderer, pcss_map):
    """Under light_basis="world" a disc is an ellipse in the map, here with the wall along an axis;
    the window is as narrow as the strip, so that texels are a thousand times longer than wide."""
    light = profile(renderer, "wall", 2, settings(pcss_map, light_basis="world"))
    assert width(light) / width(true_profile("wall", 2)) == pytest.approx(1.0, abs=0.1)


def test_sixteen_bits_are_enough_for_a_penumbra(renderer):
    """Rounding is a standard deviation of some 1/400 of the range, 10 cm; the caster is 8 m off."""
    light = profile(renderer, "wall", 2, settings("variance", moment_format="unorm16"))
    assert width(light) / width(true_profile("wall", 2)) == pytest.approx(1.0, abs=0.1)
    assert light.min() < 0.01


@pytest.mark.parametrize("filter_size", [5, 17])
def test_filter_size_limits_the_penumbra(renderer, filter_size):
    light = profile(renderer, "wall", 3, settings("summed", filter_size=filter_size))
    camera = strip("wall", 3)
    frame = renderer.render(scene("wall"), camera, sun(), settings("summed"))
    texel = frame.cascades.texel_size[0] / [np.sin(np.radians(ELEVATION)), 1.0]
    pixel = 2 * camera.half_width / camera.size[0]
    # eight tenths of a square's side lie between the two shares of light
    assert width(light) * pixel < 0.85 * filter_size * texel.max()
    assert width(light) < width(profile(renderer, "wall", 3, settings("summed")))
