"""Moment shadow maps against the bound solved anew: from the paper's equations in doubles, by
linear programming, and on every distribution of a rendered map (docs/numerics.md 28)."""

import itertools

import numpy as np
import plates
import pytest
from scipy.optimize import linprog

import csm

# (storage rounds three times: moments, and the blur along each axis)
BIAS = {"float32": 2e-6, "unorm16": 1.5e-4}
ARCSINE = np.array([0.0, 0.5, 0.0, 0.375])
PENS = {"two": (0.3, 0.8), "three": (0.2, 0.5, 0.9)}


def moments(depths, shares):
    """(..., 4) moments of depths, -1 to 1, with shares."""
    return np.stack([(shares * depths**k).sum(-1) for k in (1, 2, 3, 4)], -1)


def least_shadow(b, z):
    """Mass before z of the three depths with moments b that hold z: the lower bound of
    [Peters2015], algorithm 3, in doubles."""
    b1, b2, b3, b4 = b
    hankel = np.array([[1, b1, b2], [b1, b2, b3], [b2, b3, b4]])
    weights = np.linalg.solve(hankel, [1, z, z * z])
    depths = np.array([z, *np.roots(weights[::-1]).real])
    masses = np.linalg.solve(np.vander(depths, 3, increasing=True).T, [1, b1, b2])
    return masses[1:][depths[1:] < z].sum()


def least_shadow_between_ends(b, z, count=1501):
    """The same of depths from -1 to 1 alone, by linear programming over `count` of them and z."""
    grid = np.unique(np.append(np.linspace(-1, 1, count), z))
    equations = np.vander(grid, 5, increasing=True).T
    solved = linprog((grid < z).astype(float), A_eq=equations, b_eq=[1, *b], bounds=(0, None))
    assert solved.status == 0, solved.message
    return solved.fun


def biased(b, bias):
    return (1 - bias) * np.asarray(b) + bias * ARCSINE


def stored_moments(frame):
    """(s, s, 4) moments of depths from -1 to 1 in a frame, undone by matrix where in 16 bits."""
    stored = frame.moments[0].astype(np.float64)
    if frame.settings.moment_format != "unorm16":
        return stored
    root = np.sqrt(3.0)
    to_stored = [[1.5, 0, -2, 0], [0, 4, 0, -4], [root / 2, 0, -2 * root / 9, 0], [0, 0.5, 0, 0.5]]
    return (stored - [0.5, 0, 0.5, 0]) @ np.linalg.inv(to_stored).T


def depths_around(frame, place, radius):
    """(m, n) depths and weights that a box blur and a lookup between texels see at places."""
    stored = frame.shadow_maps[0].astype(np.float64)
    near = place - 0.5
    corner = np.floor(near).astype(int)
    share = near - corner
    offsets = list(itertools.product(range(-radius, radius + 2), repeat=2))
    found = np.stack([stored[corner[:, 1] + v, corner[:, 0] + u] for u, v in offsets], 1)

    def weight(offset, share):
        own = abs(offset) <= radius
        return own * (1 - share) + (abs(offset - 1) <= radius) * share

    weights = np.stack([weight(u, share[:, 0]) * weight(v, share[:, 1]) for u, v in offsets], 1)
    return found, weights / (2 * radius + 1) ** 2


@pytest.fixture(scope="module")
def trials():
    """Places and depths by lot, half of them close to a plate's depth."""
    random = np.random.default_rng(5)
    texels = random.uniform(4, 60, (4000, 2))
    depths = random.uniform(0.02, 0.98, 4000)
    close = random.choice(PENS["three"], 2000) + random.choice([-1, 1], 2000) * 10.0 ** (
        random.uniform(-4, -1.3, 2000)
    )
    depths[:2000] = close
    return texels, depths


@pytest.mark.parametrize("moment_format", BIAS)
@pytest.mark.parametrize("pens", PENS)
def test_v1_shadow_is_never_more_than_the_true_one(renderer, trials, moment_format, pens, figure):
    texels, depths = trials
    wanted = plates.settings(filter="msm", filter_size=3, moment_format=moment_format)
    world = plates.scene(PENS[pens])
    shadows = {}
    for bound in ("hamburger", "hausdorff"):
        frame, lit = plates.seen(renderer, world, wanted.replace(msm_bound=bound), texels, depths)
        shadows[bound] = 1.0 - lit
        assert np.isfinite(lit).all()
        found, weights = depths_around(frame, texels, 1)
        true = (weights * (found < depths[:, None])).sum(1)
        # a receiver whose float32 depth may lie on either side of a plate is none of the claim
        clear = np.abs(found - depths[:, None]).min(1) > 1e-6
        figure(
            "V1",
            f"msm: shadow beyond the true one, {moment_format}",
            (shadows[bound] - true)[clear].max(),
            2.0 * BIAS[moment_format],
        )
        # it must not be trivially small either
        behind = clear & (true > 0.999) & (depths > max(PENS[pens]) + 0.05)
        assert behind.any()
        assert shadows[bound][behind].mean() > 0.9
    # what is known of the range's ends tells more, but nothing of two depths, which are known
    gained = shadows["hausdorff"] - shadows["hamburger"]
    assert gained.min() > -10.0 * BIAS[moment_format]
    assert gained.max() > 0.05 or pens == "two"


@pytest.mark.parametrize("moment_format", BIAS)
def test_two_depths_and_a_receiver_between_are_exact(renderer, moment_format):
    # Far from both, the bias lets as much light through as its own share times what the variance
    # makes of it: 30 times the bias at a tenth of the range
    random = np.random.default_rng(6)
    texels, depths = random.uniform(4, 60, (2000, 2)), random.uniform(0.4, 0.7, 2000)
    wanted = plates.settings(filter="msm", filter_size=5, moment_format=moment_format)
    frame, lit = plates.seen(renderer, plates.scene(PENS["two"]), wanted, texels, depths)
    found, weights = depths_around(frame, texels, 2)
    true = 1.0 - (weights * (found < depths[:, None])).sum(1)
    assert 0.2 < np.mean((true > 0.01) & (true < 0.99))
    np.testing.assert_allclose(lit, true, atol=30 * BIAS[moment_format])


@pytest.mark.parametrize("moment_format", BIAS)
@pytest.mark.parametrize("bound", ["hamburger", "hausdorff"])
def test_mask_is_the_papers_of_its_moments(renderer, trials, moment_format, bound):
    # linear programming knows depths on a grid alone, too coarse beside a plate
    first, count = (1700, 600) if bound == "hamburger" else (2000, 40)
    texels, depths = (values[first : first + count] for values in trials)
    wanted = plates.settings(
        filter="msm", filter_size=3, moment_format=moment_format, msm_bound=bound
    )
    frame, lit = plates.seen(renderer, plates.scene(PENS["three"]), wanted, texels, depths)
    at = biased(plates.bilinear(stored_moments(frame), texels), BIAS[moment_format])
    solve = least_shadow if bound == "hamburger" else least_shadow_between_ends
    expected = np.array([solve(b, 2 * z - 1) for b, z in zip(at, depths, strict=True)])
    # beside a plate the bound falls from all to nothing within the roundings of moments and of a
    # lookup's weights
    error = np.abs(1 - lit - expected)
    assert error.max() < 0.05
    assert error.mean() < 1e-3


def test_sixteen_bits_keep_moments_to_their_rounding(renderer):
    """Each stored number is off by at most half a step; undone, moments are off by as much as the
    inverse adds up."""
    wanted = plates.settings(filter="msm", filter_size=1, moment_format="unorm16")
    world = plates.scene(np.linspace(0.02, 0.97, 40))
    frame = renderer.render(world, plates.CAMERA, plates.SUN, wanted,
                            outputs=("moments", "shadow_maps"))  # fmt: skip
    depth = 2.0 * frame.shadow_maps[0].astype(np.float64) - 1.0
    exact = np.stack([depth, depth**2, depth**3, depth**4], -1)
    error = np.abs(stored_moments(frame) - exact).max(axis=(0, 1))
    root = np.sqrt(3.0)
    sums = np.array([1 / 3 + root, 1 + 1 / 8, 3 / 4 + 3 * root / 4, 1 + 1 / 8])
    assert (error <= 0.5 / 65535 * sums + 1e-6).all()
    assert (error > 0.1 / 65535).all()  # it is 16 bits that are read


def leak(depths, shares, z, bias):
    return 1.0 - least_shadow(biased(moments(2 * np.array(depths) - 1, np.array(shares)), bias),
                              2 * z - 1)  # fmt: skip


def test_v2_two_occluders_leak_next_to_nothing(figure):
    figure("V2", "msm: light behind two occluders", abs(leak((0.2, 0.5), (0.5, 0.5), 0.9, 1e-9)),
           1e-8)  # fmt: skip
    variance = 0.15**2
    vsm = variance / (variance + 0.55**2)
    assert vsm == pytest.approx(0.0692, abs=1e-4)
    for bias in BIAS.values():
        assert leak((0.2, 0.5), (0.5, 0.5), 0.9, bias) < 10 * bias < 0.1 * vsm
    # three occluders are one more than four moments tell apart, and still better than two moments
    three = leak((0.2, 0.4, 0.6), np.full(3, 1 / 3), 0.9, BIAS["float32"])
    variance = np.var([0.2, 0.4, 0.6])
    assert 1e-3 < three < 0.5 * variance / (variance + 0.5**2)


def test_half_floats_are_refused():
    with pytest.raises(ValueError, match="moment_format must be float32 or unorm16 for msm"):
        csm.plan(csm.ShadowSettings(filter="msm", moment_format="float16"))
