"""Pareto fronts, halvings and ties, against brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from csm.fronts import FEWEST_CASES, best_within, next_halvings, on_front, paired_interval
from csm.settings import ShadowSettings
from csm.techniques import BASELINE, FAMILIES, TECHNIQUES, settings_by_name

number = st.floats(0.0, 10.0).map(lambda value: round(value, 1)) | st.just(float("nan"))
pairs = st.lists(st.tuples(number, number), min_size=1, max_size=30)


@given(pairs)
def test_front_is_what_nothing_dominates(points):
    costs, errors = np.array(points).T
    front = on_front(costs, errors)
    known = [i for i, pair in enumerate(points) if not np.isnan(pair).any()]
    for i in range(len(points)):
        beaten = any(
            (costs[j] <= costs[i] and errors[j] <= errors[i])
            and ((costs[j], errors[j]) != (costs[i], errors[i]) or j < i)
            for j in known
        )
        assert front[i] == (i in known and not beaten)


@given(pairs)
def test_next_halving_is_the_cheapest_of_half_the_error(points):
    costs, errors = np.array(points).T
    for i, found in enumerate(next_halvings(costs, errors)):
        enough = [
            j for j in range(len(points)) if errors[j] <= errors[i] / 2 and not np.isnan(costs[j])
        ]
        if not enough or np.isnan(costs[i]) or errors[i] == 0.0:
            assert found.index is None
        else:
            assert costs[found.index] == min(costs[j] for j in enough)
            assert errors[found.index] <= errors[i] / 2


def test_what_has_no_error_is_not_halved():
    found = next_halvings([3.0, 1.0, 2.0], [0.0, 0.0, 0.1])
    assert [one.index for one in found] == [None, None, 1]


def test_best_within_a_budget():
    assert best_within([1, 2, 3], [0.5, 0.2, 0.1], 2.5) == 1
    assert best_within([1, 2, 3], [0.5, 0.2, 0.1], 0.5) is None
    assert best_within([1, np.nan], [np.nan, 0.1], 9) is None


def test_a_tie_and_a_difference():
    rng = np.random.default_rng(4)
    base = rng.random(40)
    low, high = paired_interval(base + 0.1 + 0.01 * rng.standard_normal(40), base)
    assert 0.09 < low < high < 0.11
    low, high = paired_interval(base + 0.01 * rng.standard_normal(40), base)
    assert low < 0.0 < high
    assert np.isnan(paired_interval([np.nan], [1.0])).all()


def test_no_interval_where_a_sign_test_could_not_tell():
    """Differences all of one sign come by chance at 2 (1/2)^n: 5 % of it takes six cases."""
    assert 2 * 0.5**FEWEST_CASES < 0.05 < 2 * 0.5 ** (FEWEST_CASES - 1)
    better, worse = np.linspace(0.1, 0.2, FEWEST_CASES), np.linspace(0.4, 0.5, FEWEST_CASES)
    assert paired_interval(better, worse)[1] < 0.0
    assert np.isnan(paired_interval(better[1:], worse[1:])).all()
    worse[0] = np.nan
    assert np.isnan(paired_interval(better, worse)).all()


def test_techniques_are_settings_with_names_of_their_own():
    names = [technique.name for technique in TECHNIQUES]
    assert len(set(names)) == len(names) >= 60
    assert {technique.family for technique in TECHNIQUES} == set(FAMILIES)
    assert settings_by_name()[BASELINE] == {}
    every = [ShadowSettings(**technique.settings).canonical() for technique in TECHNIQUES]
    assert len(set(every)) == len(every), "two names for one thing"


@pytest.mark.parametrize(
    "name", ["1 map of 4096", "2 of 2896", "3 of 2364", "6 of 1672", "8 of 1448"]
)
def test_equal_memory_is_equal(name):
    settings = ShadowSettings(**settings_by_name()[name])
    texels = settings.cascade_count * settings.map_size**2
    assert texels == pytest.approx(4 * 2048**2, rel=2e-3)


def test_one_map_is_a_map_and_a_warp_of_it_a_warp():
    family = {technique.name: technique.family for technique in TECHNIQUES}
    assert family["1 of 2048"] == "maps and cascades"
    assert family["1 of 2048, LiSPSM"] == "warps"
