"""Filtered maps looked up in smaller levels: trilinear and along the footprint, against the same in
numpy (docs/numerics.md 29)."""

import numpy as np
import probes
import pytest
import small_scenes
import stripes

import csm

TO_LIGHT = (0.4, 1.0, 0.3)
SIZE = (64, 48)
BASE = csm.ShadowSettings(
    filter="vsm", filter_size=1, cascade_count=2, map_size=256, lookup="trilinear"
)
# Steps of a pixel [texels], times a factor that the setting bleed_power carries.
FOOTPRINTS = {
    "square": ("vec4(1.0, 0.0, 0.0, 1.0)", [[1, 0], [0, 1]]),
    "long": ("vec4(8.0, 0.0, 0.0, 1.0)", [[8, 0], [0, 1]]),
    "upright": ("vec4(0.0, 8.0, 1.0, 0.0)", [[0, 8], [1, 0]]),
    "leaning": ("vec4(4.5, 3.5, 3.5, 4.5)", [[4.5, 3.5], [3.5, 4.5]]),
    "leaning back": ("vec4(4.5, -3.5, -3.5, 4.5)", [[4.5, -3.5], [-3.5, 4.5]]),
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """Function from a footprint's name, a factor, and settings to the first moment that every pixel
    looked up, and the frame with its maps."""
    made = {}

    def ask(what, name, factor, settings, outputs=("mask", "cascade_index", "moments"), **more):
        if name not in made:
            folder = tmp_path_factory.mktemp("footprint")
            expression = f"frame.bleed.z * {FOOTPRINTS[name][0]}"
            made[name] = csm.Renderer(shader_dir=probes.folder(folder, expression))
        camera = small_scenes.camera(0, size=SIZE)
        settings = settings.replace(bleed_power=float(factor))
        scene = small_scenes.soup()
        return probes.ask(made[name], what, scene, camera, TO_LIGHT, settings, outputs, **more)

    yield ask
    for one in made.values():
        one.close()


def bilinear(level_map, place, level):
    """Values of a (s, s) level at places in texels of the full map, clamped at its rim."""
    at = np.clip(place / 2**level - 0.5, 0, len(level_map) - 1)
    low = np.minimum(np.floor(at).astype(int), len(level_map) - 2)
    f = at - low
    u, v = low[:, 0], low[:, 1]
    near = level_map[v, u] * (1 - f[:, 0]) + level_map[v, u + 1] * f[:, 0]
    far = level_map[v + 1, u] * (1 - f[:, 0]) + level_map[v + 1, u + 1] * f[:, 0]
    return near * (1 - f[:, 1]) + far * f[:, 1]


def boxes(full, level):
    """Means of squares of 2^level texels."""
    side = len(full) >> level
    return full.reshape(side, 1 << level, side, 1 << level).mean(axis=(1, 3))


def looked_up(answers, name, factor, settings, lookup):
    """(found, wanted) first moments of the pixels that face the sun inside a map; ``lookup`` takes
    a map's first moments and places in it."""
    frame = answers("moments", name, factor, settings)
    place = np.stack(
        [answers(axis, name, factor, settings, ("mask",)).mask for axis in "uv"], axis=-1
    ).astype(np.float64)
    facing = place.any(axis=-1) & (frame.cascade_index != 255)
    assert facing.sum() > 500
    wanted = np.full(facing.shape, np.nan)
    for i in range(frame.cascades.count):
        own = facing & (frame.cascade_index == i)
        wanted[own] = lookup(frame.moments[i][..., 0].astype(np.float64), place[own])
    return frame.mask[facing], wanted[facing]


# Places are float32 texels of up to 256: 2^-16 of a texel's difference of up to 1, and sums.
ROUNDING = 2.0**-16 + 8 * 2.0**-24


@pytest.mark.parametrize("level", range(5))
def test_a_level_is_the_mean_of_boxes(answers, level):
    """A footprint of 2^n texels is looked up between the means of squares of as many."""
    found, wanted = looked_up(
        answers, "square", 2**level, BASE,
        lambda full, place: bilinear(boxes(full, level), place, level),
    )  # fmt: skip
    assert np.abs(found - wanted).max() < ROUNDING
    assert np.ptp(found) > 0.1


def test_between_levels_lies_between_them(answers):
    """A footprint of 3 texels mixes the levels of 2 and 4."""
    found, wanted = looked_up(
        answers, "square", 3.0, BASE,
        lambda full, place: np.stack(
            [bilinear(boxes(full, level), place, level) for level in (1, 2)], axis=-1
        ).sum(axis=-1),
    )  # fmt: skip
    fine, _ = looked_up(answers, "square", 2.0, BASE, lambda full, place: place[:, 0])
    coarse = wanted - fine
    assert (found >= np.minimum(fine, coarse) - ROUNDING).all()
    assert (found <= np.maximum(fine, coarse) + ROUNDING).all()
    apart = np.abs(fine - coarse) > 1e-3
    share = ((found - fine) / (coarse - fine))[apart]
    # log2 3 = 1.58; drivers may steepen the mix about its middle, by a factor of two
    assert abs(np.median(share) - 0.585) < 0.1


@pytest.mark.parametrize("name", [name for name in FOOTPRINTS if name != "square"])
@pytest.mark.parametrize(("anisotropy", "factor", "level"), [(8, 1, 0), (2, 1, 2), (8, 4, 2)])
def test_lookups_lie_along_the_footprint(answers, name, anisotropy, factor, level):
    """A footprint of 8 by 1 texels in any direction: the mean of as many lookups as allowed."""
    steps = factor * np.array(FOOTPRINTS[name][1], float)
    axes, lengths, _ = np.linalg.svd(steps.T)
    lookups = min(round(lengths[0] / lengths[1]), anisotropy)
    assert np.log2(lengths[0] / lookups) == pytest.approx(level)

    def lookup(full, place):
        shifts = ((np.arange(lookups) + 0.5) / lookups - 0.5)[:, None] * lengths[0] * axes[:, 0]
        reduced = boxes(full, level)
        return np.mean([bilinear(reduced, place + shift, level) for shift in shifts], axis=0)

    settings = BASE.replace(lookup="anisotropic", anisotropy=anisotropy)
    found, wanted = looked_up(answers, name, factor, settings, lookup)
    # the level is a float32 logarithm: a millionth of the next level is mixed in
    assert np.abs(found - wanted).max() < 2 * ROUNDING + 1e-5


def test_a_small_map_is_not_mixed_with_what_lies_beside_it(answers):
    """Kernels over the rim of a map in the corner of a larger layer: the coarsest level is that of
    the map alone."""
    base = BASE.replace(select="frustum", split="manual", manual_splits=(4,), fit="box")
    texels = np.stack(np.meshgrid([100, 112, 119, 123, 127.5], [3, 40, 80, 120, 127]), axis=-1)
    for filter_size in (1, 3):
        found = []
        for sizes in ((128, 128), (512, 128)):
            settings = base.replace(map_size=sizes, filter_size=filter_size)
            window = answers("moments", "square", 16.0, settings).cascades.uvz_from_world[1]
            uvz = np.concatenate([texels.reshape(-1, 2) / 128, np.full((25, 1), 0.5)], axis=1)
            points = (uvz - window[:3, 3]) @ np.linalg.inv(window[:3, :3]).T
            frame = answers("moments", "square", 16.0, settings, (), points=points)
            found.append(np.where(frame.point_cascade == 1, frame.point_visibility, np.nan))
        both = np.isfinite(found[0]) & np.isfinite(found[1])
        assert both[[3, 4, 8, 9]].any(), "beyond the middle of the last texel of the level"
        assert both.sum() > 10
        assert np.abs(found[0] - found[1])[both].max() < 2 * ROUNDING
        assert np.ptp(found[0][both]) > 1e-3


def test_kernels_stay_in_the_map(answers):
    """What a map answers for lies one and a half texels of the coarsest level from its rim."""
    for what in "uv":
        frame = answers(what, "square", 1.0, BASE)
        own = (frame.cascade_index != 255) & (frame.mask != 0)
        assert frame.mask[own].min() >= 24.0 - 1e-3
        assert frame.mask[own].max() <= 256 - 24.0 + 1e-3


# -- in pictures -----------------------------------------------------------------------------------


def test_along_the_footprint_is_sharper(renderer):
    """Stripes away from the camera, seen at a slant: trilinear lookups, as wide as the footprint is
    long, wash them out; lookups along it keep what a pixel can show."""
    sun = csm.Sun((0.3, 1, 0.1))
    view = csm.Camera.look_at(
        (0, 1.2, 8), (0, 0, 0), fov_y_deg=30, near=0.3, far=60, size=(160, 60)
    )
    base = BASE.replace(map_size=1024, gradients="analytic", max_distance=40.0, fit="box")
    truth = stripes.stripe_share(view, sun.to_light)
    scene, error = stripes.striped(), {}
    for lookup in ("trilinear", "anisotropic"):
        frame = renderer.render(scene, view, sun, base.replace(lookup=lookup, anisotropy=16))
        assert np.isfinite(frame.mask).all()
        own = (frame.cascade_index != 255) & (frame.view_depth > 6) & (frame.view_depth < 14)
        assert own.sum() > 1000
        error[lookup] = np.abs(frame.mask - truth)[own].mean()
    assert error["anisotropic"] < 0.5 * error["trilinear"]


@pytest.mark.parametrize("lookup", ["trilinear", "anisotropic"])
@pytest.mark.parametrize("gradients", ["hardware", "analytic"])
def test_grazing_views_are_finite(renderer, lookup, gradients):
    """A camera a tenth of a millimetre above the ground, and one exactly in its plane."""
    settings = BASE.replace(map_size=128, lookup=lookup, gradients=gradients)
    for height in (1e-4, 0.0):
        view = csm.Camera.look_at(
            (6, height, 8), (0, height, 0), fov_y_deg=60, near=0.01, far=60, size=(41, 31)
        )
        frame = renderer.render(csm.scenes.plane_and_box(), view, csm.Sun(TO_LIGHT), settings)
        assert np.isfinite(frame.mask).all()
        assert frame.mask.min() >= 0.0
        assert frame.mask.max() <= 1.0


# -- off is absent ---------------------------------------------------------------------------------


def test_levels_exist_where_they_are_looked_up():
    """Full size alone: one level, no pass that makes smaller ones; how many lookups is a number."""
    plain = csm.plan(BASE.replace(lookup="bilinear", anisotropy=16, gradients="quad"))
    assert plain == csm.plan(BASE.replace(lookup="bilinear"))
    assert "shadow_mips" not in {step.name for step in plain.passes}
    assert "shadow_mips" in {step.name for step in csm.plan(BASE).passes}
    few, many = (
        csm.plan(BASE.replace(lookup="anisotropic", anisotropy=count)) for count in (2, 16)
    )
    assert few == many
    for name in ("hard", "pcf"):
        settings = csm.ShadowSettings(filter=name)
        assert csm.plan(settings) == csm.plan(settings.replace(lookup="anisotropic"))
