"""What moment, Fourier, summed-area and prefiltered soft shadows have in common: bare ground stays
lit, masks are finite, both stages give the same bits, and what is off is absent."""

import numpy as np
import plates
import pytest
import small_scenes

import csm
from csm import shapes

FILTERS = {
    "msm": {"filter": "msm"},
    "msm, 16 bits": {"filter": "msm", "moment_format": "unorm16"},
    "msm between ends": {"filter": "msm", "msm_bound": "hausdorff"},
    "fourier": {"filter": "fourier", "fourier_terms": 8},
    "fourier, half floats": {"filter": "fourier", "moment_format": "float16"},
    "fourier, 16 bits": {"filter": "fourier", "moment_format": "unorm16"},
    "savsm": {"filter": "savsm"},
    "pcss, variance": {"filter": "pcss", "pcss_map": "variance"},
    "pcss, variance, 16 bits": {
        "filter": "pcss", "pcss_map": "variance", "moment_format": "unorm16"
    },
    "pcss, summed": {"filter": "pcss", "pcss_map": "summed"},
}  # fmt: skip
SOFT_SUN = {"angular_diameter_deg": 3.0}


def settings(name, **more):
    base = {"cascade_count": 2, "map_size": 128, "filter_size": 5}
    return csm.ShadowSettings(**{**base, **FILTERS[name], **more})


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("elevation", [80, 35, 12])
def test_bare_ground_is_lit(renderer, name, elevation):
    """A kernel sees the receiver's own plane before and behind it: the automatic bias covers it."""
    ground = csm.Scene.from_arrays(*shapes.join(shapes.ground(40.0)))
    sun = csm.Sun.from_angles(33.0, elevation)
    sun = csm.Sun(sun.to_light, **SOFT_SUN)
    for size in (1, 5, 15):
        frame = renderer.render(ground, small_scenes.camera(2), sun,
                                settings(name, filter_size=size))  # fmt: skip
        # a series rings: past the first place where it is 1 it comes down to Si(2 pi) / pi + 1 / 2,
        # 0.951; half floats round its terms to 2^-11, and many are added
        least = 0.94 if "half" in name else 0.95 if "fourier" in name else 0.99
        assert frame.mask[frame.valid].min() > least, size


@pytest.mark.parametrize("name", FILTERS)
def test_v1_masks_are_numbers_from_0_to_1(renderer, name, figure):
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    wrong = 0
    for size, span in ((1, 30.0), (9, 1e4), (65, 30.0)):
        wanted = settings(name, filter_size=size, map_size=200, depth_range="manual",
                          manual_depth_range=(-0.5 * span, 0.5 * span))  # fmt: skip
        for sun in ("high", "low", "in_the_face"):
            light = csm.Sun(small_scenes.SUNS[sun], **SOFT_SUN)
            frame = renderer.render(scene, camera, light, wanted, outputs=("mask", "moments"))
            wrong += np.count_nonzero(~((frame.mask >= 0) & (frame.mask <= 1)))
            wrong += np.count_nonzero(~np.isfinite(frame.moments))
            assert frame.mask.std() > 0.05
    figure("V1", f"{name}: not a number from 0 to 1", wrong, 0, "pixels")


@pytest.fixture(scope="module")
def stages():
    with csm.Renderer(stage="compute") as compute, csm.Renderer(stage="fragment") as fragment:
        yield compute, fragment


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("name", FILTERS)
def test_stages_agree_to_the_bit(stages, name, samples):
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    sun = csm.Sun(small_scenes.SUNS["high"], **SOFT_SUN)
    wanted = settings(name, samples=samples, map_size=(128, 90))
    compute, fragment = (
        renderer.render(scene, camera, sun, wanted, outputs=("mask", "moments"))
        for renderer in stages
    )
    np.testing.assert_array_equal(compute.mask, fragment.mask)
    for one, other in zip(compute.moments, fragment.moments, strict=True):
        np.testing.assert_array_equal(one, other)
    assert 0.05 < compute.mask.mean() < 0.95


@pytest.mark.parametrize("name", FILTERS)
def test_several_samples_mix_moments(renderer, name):
    """Where some of four samples show a plate and the others the ground, stored numbers are that
    share of the plate's and the rest of the ground's: means of moments, not moments of a mean."""
    world = plates.scene((0.3, 0.8))  # on either side of the middle: centred depths have a sign
    wanted = plates.settings(filter_size=1, **FILTERS[name])
    outputs = ("moments", "shadow_maps")
    single = renderer.render(world, plates.CAMERA, plates.SUN, wanted, outputs=outputs)
    stored, depth = single.moments[0].astype(np.float64), single.shadow_maps[0]
    plate, ground = (stored[np.abs(depth - at) < 1e-3].mean(axis=0) for at in (0.3, 0.8))
    mixed = renderer.render(
        world, plates.CAMERA, plates.SUN, wanted.replace(samples=4), outputs=("moments",)
    ).moments[0].astype(np.float64)  # fmt: skip
    share = ((mixed - ground) @ (plate - ground)) / ((plate - ground) @ (plate - ground))
    rounding = 2e-3 if "half" in name else 2e-4
    np.testing.assert_allclose(4 * share, np.round(4 * share), atol=4 * rounding)
    assert set(np.round(4 * share).astype(int).ravel()) == {0, 1, 2, 3, 4}
    back = share[..., None] * plate + (1 - share[..., None]) * ground
    np.testing.assert_allclose(mixed, back, atol=rounding)


NEIGHBOURS = {
    "msm_bound": ("hausdorff", "savsm"),
    "fourier_terms": (8, "msm"),
    "pcss_map": ("summed", "fourier"),
    "moment_format": ("float16", "savsm"),
    "bleed_step": (0.2, "fourier"),
    "tap_count": (8, "savsm"),
    "lookup": ("trilinear", "savsm"),
}


@pytest.mark.parametrize("name", NEIGHBOURS)
def test_what_means_nothing_is_absent(name):
    """A setting of another filter changes no pass, texture, byte or program."""
    value, other = NEIGHBOURS[name]
    plain = csm.ShadowSettings(filter=other)
    assert str(csm.plan(plain.replace(**{name: value}))) == str(csm.plan(plain))


@pytest.mark.parametrize(
    ("name", "slices", "texel_bytes", "between", "mips"),
    [
        ("msm", 1, 16, True, False),
        ("msm, 16 bits", 1, 8, True, False),
        ("fourier", 4, 16, True, False),
        ("fourier, 16 bits", 8, 8, True, False),
        ("savsm", 1, 8, True, False),
        ("pcss, variance", 1, 8, False, True),
        ("pcss, variance, 16 bits", 1, 4, False, True),
        ("pcss, summed", 1, 8, True, False),
    ],
)
def test_textures_are_those_that_are_looked_up(name, slices, texel_bytes, between, mips):
    size = 128
    plan = csm.plan(settings(name))
    textures = {texture.name: texture for texture in plan.textures}
    moments = textures["moments"]
    sides = [size >> level for level in range(5)] if mips else [size]
    assert moments.bytes == sum(side * side for side in sides) * 2 * slices * texel_bytes
    assert ("moments_between" in textures) == between
    assert ("shadow_mips" in str(plan)) == mips
    assert ("shadow_sum" in str(plan)) == (name in ("savsm", "pcss, summed"))
    assert ("shadow_blur" in str(plan)) == (between and "shadow_sum" not in str(plan))
