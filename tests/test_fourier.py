"""Convolution shadow maps: the stored terms, the series, its ringing (docs/numerics.md 28)."""

import numpy as np
import plates
import pytest

import csm

DEPTHS = (0.25, 0.4, 0.9)


def series(terms, depths):
    """Share of light from (m, 2 M) filtered sines and cosines and receivers' depths, unbounded:
    [Annen2007], the step's series with c_k = pi (2 k - 1)."""
    sines, cosines = terms[:, 0::2], terms[:, 1::2]
    c = np.pi * (2 * np.arange(1, sines.shape[1] + 1) - 1)
    angle = c * np.asarray(depths)[:, None]
    return 0.5 + 2 * ((np.cos(angle) * sines - np.sin(angle) * cosines) / c).sum(1)


def terms_of(depth, count):
    c = np.pi * (2 * np.arange(1, count + 1) - 1)
    angle = np.atleast_1d(depth)[:, None] * c
    return np.stack([np.sin(angle), np.cos(angle)], -1).reshape(len(angle), -1)


def stored_terms(frame):
    stored = frame.moments[0].astype(np.float64)
    return 2 * stored - 1 if frame.settings.moment_format == "unorm16" else stored


# float32: the argument of the last term, 31 pi times a depth of 24 bits, and the driver's sine;
# half floats are off by up to 2^-11 of up to 1 (llvmpipe cuts them off), 16 bits by half of
# 2 / 65535
ROUNDING = {"float32": 2e-5, "float16": 2e-5 + 2.0**-11, "unorm16": 2e-5 + 1 / 65535}


@pytest.mark.parametrize("moment_format", ROUNDING)
@pytest.mark.parametrize("count", [2, 8, 16])
def test_terms_are_sines_and_cosines_of_the_maps_depths(renderer, count, moment_format):
    wanted = plates.settings(
        filter="fourier",
        filter_size=1,
        fourier_terms=count,
        moment_format=moment_format,
        map_size=32,
    )
    world = plates.scene(np.linspace(0.05, 0.97, 30))
    frame = renderer.render(world, plates.CAMERA, plates.SUN, wanted,
                            outputs=("moments", "shadow_maps"))  # fmt: skip
    expected = terms_of(frame.shadow_maps[0].ravel().astype(np.float64), count)
    found = stored_terms(frame).reshape(len(expected), -1)
    np.testing.assert_allclose(found, expected, atol=ROUNDING[moment_format])


@pytest.mark.parametrize("count", [4, 16])
@pytest.mark.parametrize("moment_format", ROUNDING)
def test_visibility_is_the_series_of_the_filtered_terms(renderer, count, moment_format):
    random = np.random.default_rng(3)
    texels, depths = random.uniform(4, 60, (1000, 2)), random.uniform(0.01, 0.99, 1000)
    wanted = plates.settings(
        filter="fourier", filter_size=5, fourier_terms=count, moment_format=moment_format
    )
    frame, lit = plates.seen(renderer, plates.scene(DEPTHS), wanted, texels, depths)
    filtered = plates.bilinear(stored_terms(frame), texels)
    expected = np.clip(series(filtered, depths), 0, 1)
    assert 0.2 < np.mean((expected > 0.05) & (expected < 0.95))
    # llvmpipe weighs neighbours with 8 bits: 2^-9 of their difference, at most 1 in the series
    np.testing.assert_allclose(lit, expected, atol=2.0**-8 + 1e-4)


def seen_terms(renderer, count):
    """Terms of one depth as a frame stores them, and the depth."""
    wanted = plates.settings(filter="fourier", filter_size=1, fourier_terms=count, map_size=16)
    frame = renderer.render(plates.scene((0.5,), count=0), plates.CAMERA, plates.SUN, wanted,
                            outputs=("moments", "shadow_maps"))  # fmt: skip
    return stored_terms(frame)[8, 8][None], float(frame.shadow_maps[0][8, 8])


def test_ringing_overshoots_by_nine_percent(renderer):
    """The step's series of M terms overshoots most at 1 / (2 M), by 8.97 % for M = 16."""
    terms, depth = seen_terms(renderer, 16)
    nearer = np.linspace(0, 0.3, 3001)
    light = series(np.repeat(terms, len(nearer), 0), depth - nearer)
    assert light.max() - 1 == pytest.approx(0.0897, rel=0.01)
    assert nearer[light.argmax()] == pytest.approx(1 / 32, abs=2e-4)
    assert light[0] == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize(("count", "error"), [(4, 0.34), (8, 0.20), (16, 0.013)])
def test_a_receiver_a_fiftieth_of_the_range_nearer(renderer, count, error):
    terms, depth = seen_terms(renderer, count)
    assert abs(series(terms, [depth - 0.02])[0] - 1) == pytest.approx(error, rel=0.05)
    wanted = plates.settings(filter="fourier", filter_size=1, fourier_terms=count, map_size=16)
    texels = np.array([[8.5, 8.5], [8.5, 8.5]])
    _, lit = plates.seen(renderer, plates.scene((0.5,), count=0), wanted, texels,
                         [depth - 0.02, depth + 0.02])  # fmt: skip
    # the mask keeps within 0 and 1, and is the same on the dark side
    assert lit[0] == pytest.approx(min(1.0, 1.013 if count == 16 else 1 - error), abs=0.01)
    assert lit[1] == pytest.approx(1 - lit[0], abs=1e-4)


@pytest.mark.parametrize("count", [4, 8, 16])
def test_the_automatic_bias_lights_what_is_lit_and_no_more(renderer, count):
    """A surface sees half of itself: the bias moves it to where the series first reaches 1."""
    world = plates.scene((0.5,), count=0)
    wanted = plates.settings(filter="fourier", filter_size=3, fourier_terms=count)
    lit = {
        bias: renderer.render(world, plates.CAMERA, plates.SUN, wanted.replace(bias=bias)).mask
        for bias in ("manual", "auto")
    }
    assert lit["manual"].max() == pytest.approx(0.5, abs=1e-3)
    assert lit["auto"].min() > 0.995
    terms = terms_of(0.5, count)
    x = 0.3066 / count
    assert series(terms, [0.5 - x])[0] == pytest.approx(1.0, abs=0.01)
    assert series(terms, [0.5 - 0.9 * x])[0] < 0.98


def test_odd_numbers_of_terms_are_refused():
    with pytest.raises(ValueError, match="fourier_terms must be even"):
        csm.plan(csm.ShadowSettings(filter="fourier", fourier_terms=5))
