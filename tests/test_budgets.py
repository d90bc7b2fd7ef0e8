"""Choosing by timed frames: what is timed is faked, the truth is every candidate's faked time."""

from types import SimpleNamespace

import numpy as np
import pytest

import csm
from csm.budgets import ROUNDS, TIMED, _fitted, _reaches, _timed, choose_timed, within_budget
from csm.costs import CostModel, forecast_cost
from csm.search import STEPS, Search
from csm.settings import map_sizes
from csm.signals import measure_signals

STEP = 2 ** (1 / STEPS)  # of sizes; errors of edges are as large as texels


@pytest.fixture(scope="module")
def search_for(plain_renderer):
    """Function that makes a search with a goal; the box is looked at once."""
    scene = csm.scenes.plane_and_box()
    camera, sun = scene.cameras["corner"].replace(size=(640, 360)), scene.suns["diagonal"]
    signals = measure_signals(plain_renderer, scene, (camera,), (sun,))

    def make(budget_ms, max_error=None):
        goal = {"max_error": max_error, "budget_ms": budget_ms, "max_bytes": None}
        return Search(signals, scene, goal, 16384)

    return make


class Machine:
    """Times settings by a truth, and remembers which: truth(maps, others, settings), in ms."""

    def __init__(self, search, truth, factors=()):
        self.forecaster, self._truth, self._factors = search.forecaster, truth, factors
        self.every = search.candidates(CostModel())
        self.settings, self.ms = [], []

    def parts(self, settings):
        return self._truth(*CostModel().parts(settings, self.forecaster), settings)

    def __call__(self, settings):
        assert settings not in self.settings  # nothing is timed twice
        calls = len(self.settings)
        factor = self._factors[calls] if calls < len(self._factors) else 1.0
        parts = tuple(factor * one for one in self.parts(settings))
        self.settings.append(settings)
        self.ms.append(sum(parts))
        return [parts] * TIMED

    def best(self, budget, without=()):
        """Least error of all candidates that truly fit."""
        fitting = [
            one.error
            for one in self.every
            if sum(self.parts(one.settings)) <= budget and one.settings not in without
        ]
        return min(fitting)

    def budget(self, share):
        """Time between those of the cheapest and the dearest candidate."""
        times = [sum(self.parts(one.settings)) for one in self.every]
        return min(times) + share * (max(times) - min(times))


def chosen_by(search_for, truth, share, factors=(), **goal):
    machine = Machine(search_for(1.0), truth, factors)
    budget = machine.budget(share)
    chosen, model = choose_timed(search_for(budget, **goal), machine)
    assert len(machine.settings) <= ROUNDS <= 6
    assert chosen.ms == forecast_cost(chosen.settings, machine.forecaster, model)
    at = machine.settings.index(chosen.settings)
    assert chosen.ms == pytest.approx(machine.ms[at], rel=1e-12)
    return chosen, machine, budget


def timed_errors(machine, budget):
    """Errors of what was timed to fit."""
    errors = {one.settings: one.error for one in machine.every}
    timed = zip(machine.settings, machine.ms, strict=True)
    return [errors[one] for one, ms in timed if ms <= budget]


@pytest.mark.parametrize("share", [0.02, 0.2, 0.6, 1.01])
@pytest.mark.parametrize("maps", [1 / 3, 1.0, 3.0])
@pytest.mark.parametrize("all_of_it", [0.02, 1.0])
def test_model_that_is_off_by_factors_finds_the_best_in_two_rounds(
    search_for, share, maps, all_of_it
):
    """Two factors are what is fitted: the first round tells both, the second uses them."""
    chosen, machine, budget = chosen_by(
        search_for, lambda m, o, _: (all_of_it * maps * m, all_of_it * o), share
    )
    assert chosen.error == machine.best(budget)
    assert len(machine.settings) <= (1 if maps == all_of_it == 1.0 else 2)


@pytest.mark.parametrize("share", [0.1, 0.25, 0.6])
def test_costs_that_the_model_does_not_know_are_bracketed(search_for, share):
    """Everything slows down with the texels, as caches overflow: 1 x 256² is no answer."""

    def truth(maps, others, settings):
        texels = sum(side**2 for side in map_sizes(settings)) / 1e8
        return maps * (0.5 + 3.0 * texels), others * (0.6 + 2.0 * texels)

    chosen, machine, budget = chosen_by(search_for, truth, share)
    assert sum(machine.parts(chosen.settings)) <= budget
    assert chosen.error <= STEP * machine.best(budget)


@pytest.mark.parametrize("at", range(3))
@pytest.mark.parametrize("share", [0.1, 0.25, 0.6])
def test_slow_outlier_costs_what_it_hits_and_a_step(search_for, at, share):
    """Maps cost threefold, and one setting's frames are five times as slow as they should be."""
    factors = [5.0 if call == at else 1.0 for call in range(ROUNDS)]
    chosen, machine, budget = chosen_by(search_for, lambda m, o, _: (3 * m, o), share, factors)
    assert sum(machine.parts(chosen.settings)) <= budget
    hit = machine.settings[at : at + 1]
    assert chosen.error <= STEP * machine.best(budget, hit)


def test_misses_in_a_row_shorten_the_way_from_what_fitted(search_for):
    """On a busy machine frames missed by 1 % until the rounds were over: 1 x 256² was left."""
    budget = 20.0
    search, model = search_for(budget), CostModel()
    every = sorted(search.candidates(model), key=lambda one: one.ms)
    low, high = (
        _timed(one, search, lambda _, ms=ms: [(0.5 * ms, 0.5 * ms)])
        for one, ms in ((every[0], 10.0), (every[-1], 40.0))
    )
    least, most = every[0].ms, every[-1].ms
    for row in (1, 2, 3):
        reach, _ = _reaches([low] + row * [high], search, model)
        assert reach == pytest.approx(least * (most / least) ** (0.5 / row))  # 10 ms, 20, 40
        assert least < reach < most
    reach, _ = _reaches([high, low], search, model)
    assert reach >= least * (most / least) ** 0.5


@pytest.mark.parametrize("seed", range(12))
def test_what_is_chosen_is_the_most_exact_that_was_timed_to_fit(search_for, seed):
    random = np.random.default_rng(seed)
    scale = np.exp(random.normal(0.0, 1.0, 2))
    noise = np.exp(random.normal(0.0, 0.4, ROUNDS))
    chosen, machine, budget = chosen_by(
        search_for, lambda m, o, _: (scale[0] * m, scale[1] * o), random.uniform(0.02, 0.9), noise
    )
    fitting = timed_errors(machine, budget)
    if fitting:
        assert chosen.error == min(fitting)
    else:
        assert chosen.ms == pytest.approx(min(machine.ms))


def test_error_and_budget_give_the_cheapest_that_reaches_both(search_for):
    """Maps that are dear make a smaller one cheaper, which is less exact and exact enough."""
    limit = 8e-5
    chosen, machine, budget = chosen_by(
        search_for, lambda m, o, _: (20 * m, o), 0.6, max_error=limit
    )
    good = [error for error in timed_errors(machine, budget) if error <= limit]
    assert min(good) < chosen.error <= limit  # the most exact would be the other
    costs = [sum(machine.parts(c.settings)) for c in machine.every if c.error <= limit]
    assert chosen.ms == pytest.approx(min(costs))


@pytest.mark.parametrize("at", range(3))
def test_model_fits_all_that_was_timed_but_one_outlier(search_for, at):
    search = search_for(1.0)
    machine = Machine(
        search, lambda m, o, _: (3 * m, 0.5 * o), [9.0 * (k == at) + 1 for k in range(3)]
    )
    points = [_timed(machine.every[k], search, machine) for k in (0, 40, -1)]
    model = _fitted(points, search)
    for one in machine.every[::10]:
        assert model.parts(one.settings, search.forecaster) == pytest.approx(
            machine.parts(one.settings)
        )


def test_budget_that_nothing_fits_gives_the_cheapest(search_for):
    chosen, machine, _ = chosen_by(search_for, lambda m, o, _: (m, o), -0.1)
    costs = [sum(machine.parts(one.settings)) for one in machine.every]
    assert chosen.ms == pytest.approx(min(costs))


def test_last_round_is_the_cheapest_where_nothing_fitted(search_for):
    """All take ever so little longer than the budget: what is chosen next is always a bit less."""
    budget = 12.0
    search = search_for(budget)

    def truth(maps, others, settings):
        longer = 1.0001 + 1e-6 * maps
        return tuple(longer * budget * one / (maps + others) for one in (maps, others))

    machine = Machine(search, truth)
    chosen, _ = choose_timed(search, machine)
    assert chosen.ms == pytest.approx(min(machine.ms), rel=1e-9)
    sizes = [max(map_sizes(one)) for one in machine.settings]
    least = min(max(map_sizes(one.settings)) for one in machine.every)
    assert len(sizes) == ROUNDS
    assert sizes[-1] == least < min(sizes[:-1])


def test_frames_timed_are_bounded_and_first_ones_do_not_count(search_for):
    """A driver makes its code in a program's first frame."""
    machine = Machine(search_for(1.0), lambda m, o, _: (3 * m, o))
    budget = machine.budget(0.1)
    search, rendered = search_for(budget), []

    class Renderer:
        def render(self, scene, camera, sun, settings, outputs):
            assert (scene, outputs) == ("scene", ("mask",))
            maps, others = CostModel().parts(settings, search.forecaster)
            factor = 1.0 if settings in rendered else 1000.0
            rendered.append(settings)
            times = {"shadow_map_0": 3 * maps, "shadow_mask": others, "readback": 1e3}
            return SimpleNamespace(timings_ms={k: factor * v for k, v in times.items()})

    chosen, _ = within_budget(Renderer(), "scene", search)
    assert chosen.error == machine.best(budget)
    assert len(rendered) == 2 * (TIMED + 1)
    assert ROUNDS * (TIMED + 1) == 24  # as it is documented


def test_the_sixth_is_the_cheapest_where_nothing_fitted_until_then(search_for):
    budget = 30.0
    search = search_for(budget)
    least = min(search.candidates(search.model), key=lambda one: (one.ms, one.error)).settings

    def nearly(maps, others, settings):
        """All but the cheapest miss by a hundredth, so that each next choice is a little less."""
        whole = 0.5 * budget if settings == least else 1.01 * budget
        return whole * maps / (maps + others), whole * others / (maps + others)

    machine = Machine(search, nearly)
    chosen, _ = choose_timed(search, machine)
    assert len(machine.settings) == ROUNDS
    assert least not in machine.settings[:-1]
    assert machine.settings[-1] == chosen.settings == least
