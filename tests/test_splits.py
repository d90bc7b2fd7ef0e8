"""Where the view range is cut: values against 60-digit decimals, ends, order, refusals."""

import math

import drawings
import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st

import csm
from csm import _core

NEARS = [1e-4, 1e-3, 0.1, 1.0, 1e3]
RATIOS = [1.001, 10.0, 1e3, 1e6, 1e10]
LAMS = [0.0, 0.25, 0.5, 0.75, 1.0]


def draw_splits(axes, near, far):
    """The splits of 8 cascades, a row per weight."""
    for lam in LAMS:
        splits = csm.split_distances(near, far, 8, lam=lam)
        axes.plot(splits, np.full(9, lam), "|-", markersize=14)
    axes.set(xscale="log", xlabel="view depth [m]", ylabel="lam", yticks=LAMS)


@pytest.mark.parametrize("near", NEARS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_s1_practical_splits_equal_exact_decimals(figure, near, ratio):
    far = near * ratio
    worst = worst_single = 0.0
    disordered = moved_ends = 0
    for lam in LAMS:
        for count in range(1, 9):
            splits = csm.split_distances(near, far, count, scheme="practical", lam=lam)
            expected = oracles.split_distances(near, far, count, lam)
            single = splits.astype(np.float32)
            worst = max(worst, np.abs(splits / expected - 1).max())
            worst_single = max(worst_single, np.abs(single / expected - 1).max())
            assert splits.shape == (count + 1,)
            assert splits.dtype == np.float64
            moved_ends += (splits[0] != near) + (splits[-1] != far)
            disordered += (np.diff(splits) <= 0).sum() + (np.diff(single) <= 0).sum()
    figure("S1", "ends moved", moved_ends, 0, "splits")
    figure("S1", "splits not above the one before", disordered, 0, "splits")
    # log, exp and the sum are each good to half an ulp; exp turns the log's error, at most
    # u ln(f/n), into a relative one: 8 u (1 + ln f/n) covers all with room to spare.
    figure(
        "S1", "error", worst, 8 * oracles.U * (1 + math.log(ratio)), "relative",
        picture=lambda: drawings.chart(
            lambda axes: draw_splits(axes, near, far), title=f"splits, near {near:g}, far {far:g} m"
        ),
    )  # fmt: skip
    figure("S1", "error as float32, as shaders have them", worst_single, 2e-6, "relative")


@pytest.mark.parametrize("scheme", ["uniform", "logarithmic"])
def test_pure_schemes_are_the_ends_of_the_practical_one(scheme):
    lam = {"uniform": 0.0, "logarithmic": 1.0}[scheme]
    splits = csm.split_distances(0.3, 700.0, 5, scheme=scheme, lam=0.37)
    assert np.array_equal(splits, csm.split_distances(0.3, 700.0, 5, lam=lam))


@pytest.mark.parametrize("near", NEARS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_s1_logarithmic_splits_have_one_ratio(figure, near, ratio):
    worst = 0.0
    for count in range(1, 9):
        splits = csm.split_distances(near, near * ratio, count, scheme="logarithmic")
        worst = max(worst, np.abs(splits[1:] / splits[:-1] / ratio ** (1 / count) - 1).max())
    # Two splits, each as good as above.
    tolerance = 16 * oracles.U * (1 + math.log(ratio))
    figure("S1", "ratios of the logarithmic scheme differ", worst, tolerance, "relative")


@given(
    near=st.floats(1e-4, 1e4),
    ratio=st.floats(1.0001, 1e8),
    count=st.integers(1, 8),
    lam=st.floats(0, 1),
    power=st.integers(-20, 20),
)
def test_splits_scale_with_the_scene(near, ratio, count, lam, power):
    far = near * ratio
    splits = csm.split_distances(near, far, count, lam=lam)
    scaled = csm.split_distances(near * 2.0**power, far * 2.0**power, count, lam=lam)
    # A power of two scales every product and sum without rounding, except that exp(share * log) is
    # the same number in both: equal to the bit.
    assert np.array_equal(scaled, splits * 2.0**power)


def test_uniform_takes_a_near_behind_the_camera():
    splits = csm.split_distances(-10.0, 30.0, 4, scheme="uniform")
    assert splits.tolist() == [-10.0, 0.0, 10.0, 20.0, 30.0]


@pytest.mark.parametrize(
    ("arguments", "options", "error", "text"),
    [
        ((0.0, 10.0, 4), {}, ValueError, "near must be > 0 for split practical .got near 0"),
        ((-1.0, 10.0, 4), {"scheme": "logarithmic"}, ValueError, "near must be > 0 .* near -1"),
        ((10.0, 2.0, 4), {}, ValueError, "far must be > near .got near 10, far 2"),
        ((1.0, 1.0, 4), {"scheme": "uniform"}, ValueError, "far must be > near"),
        ((math.nan, 10.0, 4), {}, ValueError, "near must be .*finite.* nan"),
        ((1.0, math.inf, 4), {}, ValueError, "far must be .*finite.* inf"),
        (("a", 10.0, 4), {}, TypeError, "near must be .* 'a'"),
        ((1.0, 10.0, 0), {}, ValueError, "count must be 1 to 8 .got 0"),
        ((1.0, 10.0, 9), {}, ValueError, "count must be 1 to 8 .got 9"),
        ((1.0, 10.0, 2.5), {}, TypeError, "count must be a whole number .* 2.5"),
        ((1.0, 10.0, 10**30), {}, ValueError, "count must be 1 to 8"),
        ((1.0, 10.0, 4), {"lam": -0.1}, ValueError, "lam must be a number from 0 to 1 .got -0.1"),
        ((1.0, 10.0, 4), {"lam": 1.1}, ValueError, "lam must be .* 1.1"),
        ((1.0, 10.0, 4), {"lam": math.nan}, ValueError, "lam must be .* nan"),
        ((1.0, 10.0, 4), {"scheme": "cubic"}, ValueError, "scheme must be one of .* 'cubic'"),
        ((1.0, np.nextafter(1.0, 2.0), 4), {}, ValueError, "no room for count = 4"),
    ],
)
def test_s1_bad_input_is_refused_by_name(arguments, options, error, text):
    with pytest.raises(error, match=text):
        csm.split_distances(*arguments, **options)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((1.0, 10.0, 9, 0, 0.5), "count must be 1 to 8"),
        ((1.0, 10.0, 4, 3, 0.5), "scheme must be practical"),
        ((math.inf, 10.0, 4, 0, 0.5), "finite"),
        ((1.0, 10.0, 4, 0, math.nan), "lam must be 0 to 1"),
    ],
)
def test_the_core_checks_without_python(arguments, text):
    with pytest.raises(ValueError, match=text):
        _core.split_distances(*arguments)


@given(near=st.floats(1e-4, 1e3), depth=st.floats(0, 1e7))
def test_rounded_range_is_the_least_step_that_reaches(near, depth):
    far, step = _core.range_round_up(near, depth)
    assert step >= 1
    assert far == near * 2.0 ** (step / 4)
    assert far >= depth
    assert step == 1 or near * 2.0 ** ((step - 1) / 4) < depth


@given(near=st.floats(1e-3, 10), depth=st.floats(1e-3, 1e6), held=st.integers(-3, 130))
def test_a_held_step_stays_while_one_too_far(near, depth, held):
    _, least = _core.range_round_up(near, depth)
    _, step = _core.range_round_up(near, depth, held)
    assert step == (held if held in (least, least + 1) else least)


@pytest.mark.parametrize(("near", "depth"), [(0.0, 1.0), (-1.0, 1.0), (1.0, math.nan)])
def test_range_refuses_what_has_no_ratio(near, depth):
    with pytest.raises(ValueError, match="near must be > 0"):
        _core.range_round_up(near, depth)


def test_range_survives_extreme_ratios():
    far, step = _core.range_round_up(5e-324, 1e308)
    assert far >= 1e308
    assert 5e-324 * 2.0 ** ((step - 1) / 4) < 1e308
