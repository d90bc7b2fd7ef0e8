"""Number, size, splits and axes of the maps: forecasts of every arrangement, and the choice."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .arrangements import LEFT_OUT
from .candidates import Family
from .caster_sides import FACES_SHARE, wanted_faces
from .costs import CostModel, forecast_cost
from .forecasts import Expected, Forecaster, Missed, rest_of
from .map_shares import filling_burden, size_parts, unequal_sizes
from .plans import map_bytes
from .settings import ShadowSettings, changed, map_texels
from .situations import (
    COUNTS,
    GAIN,
    SMALLEST,
    SOFT_PIXELS,
    TAPS,
    WARP_GAIN,
    WORLD_ELEVATION_DEG,
    Situation,
    wanted_size,
)
from .verification import everything_over

__all__ = ["Forecast", "Search"]

STEPS = 4  # of sizes, from one to its double
SIZES = tuple(round(SMALLEST * 2 ** (k / STEPS)) for k in range(4 * STEPS + 1))  # to 4096
#: Split schemes between which the forecast chooses: the first is that of all defaults. The later
#: ones cut nearer slices, the last in equal ratios of depth.
SCHEMES = (
    {"split": "practical"},
    {"split": "practical", "lam": 0.75},
    {"split": "practical", "lam": 0.9},
    {"split": "logarithmic"},
)
# What everything switched on may still gain, as forecast: two fifths of what it may as measured,
# 5 % or 0.05 % of the pixels. Of 55 real pairs, forecasts within that were so measured in 52; of
# what the factors miss, the median is 12 %.
KNEE_SHARE, KNEE_PIXELS = 0.02, 2e-4
# Of everything on's time: what costs so little more than the cheapest at the knee is taken where it
# spares an effect, or else where it is more exact. Finer maps are nearly free where there is little
# to fill, and on a GPU.
NEARLY_FREE = 0.01
NO_MATTER = KNEE_PIXELS / 4.0  # by so much less error nothing is bought, however cheap


@dataclass(frozen=True)
class Forecast:
    """What is expected of settings.

    Attributes
    ----------
    error : float
    ms : float
    met : bool
        Whether that is on the goal's side.
    """

    error: float
    ms: float
    met: bool


@dataclass(frozen=True)
class _Knee:
    """Most that texels may miss, that kernels may leave out, or that both may err all in all.

    And what everything on costs [ms].
    """

    held: float
    left_out: float
    error: float
    full_ms: float

    def holds(self, expected):
        """Whether what is expected, of one or of several settings, is no more than that."""
        texels = (expected.held <= self.held) & (expected.left_out <= self.left_out)
        return texels | (expected.error <= self.error)


class Search:
    """Number, sizes, splits and axes of the maps.

    Parameters
    ----------
    signals : Signals
    scene : Scene
    goal : dict
        ``max_error``, ``budget_ms``, ``max_bytes``.
    largest : int
        Side of the largest map that the driver holds [texels].
    model : CostModel, optional
        Of the machine, before anything is timed there.
    """

    def __init__(self, signals, scene, goal, largest, model=None):
        self.signals, self.goal = signals, goal
        self.model = CostModel() if model is None else model
        self.forecaster = Forecaster(signals, scene)
        self._largest, self._burdens = largest, {}
        self._known_costs, self._known_knees = {}, {}

    @property
    def bytes_bind(self):
        """Whether ``max_bytes`` rule out maps that are considered."""
        return not self._allowed.all()

    def candidates(self, model):
        """All settings that are considered, with forecasts; the rows' answers are in them.

        Parameters
        ----------
        model : CostModel

        Returns
        -------
        candidates : list of Candidate
            Some hundreds.
        """
        costs = self._costs(model)
        return [self._candidate(at, costs) for at in np.flatnonzero(self._allowed)]

    def least_ms(self, model):
        """Forecast [ms] of the cheapest candidate."""
        return float(self._costs(model)[self._allowed].min())

    def least_error(self):
        """Forecast error of the most exact candidate."""
        return float(self._expected.error[self._allowed].min())

    @cached_property
    def families(self):
        """Every arrangement, its sizes and filters, with forecasts of the error."""
        return [family for sized in self._sized for family in sized]

    @cached_property
    def _sized(self):
        """Of every arrangement and its sizes the families, one a filter."""
        if not sum(view.facing_count for view in self.signals.views):
            # only even splits can begin at or behind an orthographic camera
            split = "uniform" if self.signals.orthographic else "practical"
            dark = self.situation(ShadowSettings(filter="none", split=split))
            return [[Family(dark, np.array([SMALLEST]), Missed(0.0, 0.0, 0.0))]]
        filters = self._filters()
        return [
            self._filtered(sized, sizes, filters)
            for count in COUNTS
            for arranged in self._arrangements(count)
            for sized, sizes in self._sizes(arranged)
        ]

    def _filters(self):
        """Changes for every filter that is considered, that which is called for first.

        Where hard edges are, soft ones may still be what an error takes that was asked for.
        """
        hard = {"filter": "hard"}
        pcss = [{"filter": "pcss", "tap_count": taps} for taps in TAPS]
        if self.signals.penumbra_pixels[2] >= SOFT_PIXELS:
            return [*pcss, hard]
        if self.goal["max_error"] is not None and self.signals.penumbra_pixels[2] > 0.0:
            return [hard, *pcss]
        return [hard]

    @cached_property
    def _sides(self):
        """Sides of maps that the driver holds (k,)."""
        return np.array([size for size in SIZES if size <= self._largest])

    def _sizes(self, arranged):
        """Settings and sizes of their maps: equal ones (k,), and of a still unequal ones (k, n)."""
        largest = self._sides
        every = [(arranged, largest)]
        if arranged.cascade_count == 1 or arranged.snap != "none":
            return every
        parts = size_parts(arranged, self.forecaster, self.model)
        if parts is None:
            return every
        sizes = unequal_sizes(parts, largest)
        # side by side at most: an atlas of them is no larger than the largest map
        held = sizes.sum(axis=1) <= self._largest
        unequal = sizes[held & (sizes.min(axis=1) < sizes.max(axis=1))]
        return [*every, (changed(arranged, storage="atlas"), unequal)] if len(unequal) else every

    def _filtered(self, arranged, sizes, filters):
        """Candidates of an arrangement under each filter, one a size."""
        told, known, found = self.forecaster, {}, []
        for changes in filters:
            at = self.situation(changed(arranged, **changes))
            name = at.settings.filter
            if name not in known:  # taps change none of it
                kernels = wanted_size(at, sizes) if name == "pcss" else None
                known[name] = told.missed(at.settings, sizes, kernels), kernels
            found.append(Family(at, sizes, *known[name]))
        return found

    def situation(self, settings):
        """What the rows are asked about settings."""
        return Situation(self.signals, self.forecaster, settings, self.model)

    @cached_property
    def _places(self):
        """Family and row of every candidate (m, 2)."""
        counts = [len(one.sizes) for one in self.families]
        number = np.repeat(np.arange(len(counts)), counts)
        first = np.cumsum(counts) - counts
        return np.stack([number, np.arange(len(number)) - first[number]], axis=1)

    def _by_family(self, of):
        """What a function says of each family, for every candidate (m,)."""
        return np.array([of(one) for one in self.families])[self._places[:, 0]]

    @cached_property
    def _expected(self):
        """What is expected of every candidate, (m,) each."""
        missed, end = np.empty((len(Missed._fields), len(self._places))), 0
        for one in self.families:
            start, end = end, end + len(one.sizes)
            for column, values in zip(missed, one.missed, strict=True):
                column[start:end] = values
        rest = self._by_family(lambda one: rest_of(one.arranged))
        return self.forecaster.together(Missed(*missed), rest)

    @cached_property
    def _allowed(self):
        """Which candidates are within ``max_bytes`` (m,); where none is, those of fewest bytes."""
        most = self.goal["max_bytes"]
        if most is None:
            return np.ones(len(self._places), bool)
        sizes = np.concatenate([one.map_bytes for one in self.families])
        return sizes <= max(most, sizes.min())

    def _costs(self, model):
        """Forecast of every candidate (m,) [ms]."""
        if model not in self._known_costs:
            costs = []
            for sized in self._sized:
                arranged, sizes = sized[0].arranged, sized[0].sizes
                maps = _each(model.maps(arranged, self.forecaster, sizes), len(sizes))
                costs += [maps + model.others(one.arranged, self.forecaster) for one in sized]
            self._known_costs[model] = np.concatenate(costs)
        return self._known_costs[model]

    def _candidate(self, at, costs):
        number, row = self._places[at]
        told = self._expected
        expected = Expected(float(told.error[at]), float(told.held[at]), float(told.left_out[at]))
        return self.families[number].candidate(row, expected, costs[at])

    def choose(self, model, reach=None, without=()):
        """The candidate that the goal asks for.

        Parameters
        ----------
        model : CostModel
        reach : float, optional
            Forecast [ms] up to which candidates are within ``budget_ms``, by default that itself.
        without : sequence of ShadowSettings
            That are not within it, whatever is forecast.

        Returns
        -------
        candidate : Candidate
            Where none is within the budget, the cheapest.
        """
        limit, budget = self.goal["max_error"], self.goal["budget_ms"]
        reach = budget if reach is None else reach
        costs, error = self._costs(model), self._expected.error
        texels = np.concatenate(
            [part for one in self._sized for part in len(one) * [one[0].texels]]
        )

        def least(among, *keys):
            rows = np.flatnonzero(among)
            order = np.lexsort([key[rows] for key in reversed(keys)])
            return self._candidate(rows[order[0]], costs)

        affordable = self._allowed.copy()
        if budget is not None:
            affordable &= costs <= reach
        for settings in without:
            alike = affordable & (texels == map_texels(settings))
            for at in np.flatnonzero(alike):
                affordable[at] = self._candidate(at, costs).settings != settings
        if not affordable.any():
            return least(self._allowed, costs, error)
        if limit is not None:
            good = affordable & (error <= limit)
            keys = (costs, error, texels) if good.any() else (error, costs, texels)
            return least(good if good.any() else affordable, *keys)
        if budget is not None:
            return least(affordable, error, costs, texels)
        called_for = self.families[0].arranged.filter
        knee = self._knee(called_for, model)
        good = affordable & self._filtered_by(called_for) & knee.holds(self._expected)
        if good.any():
            nearly_free = good & (costs <= costs[good].min() + NEARLY_FREE * knee.full_ms)
            effects = self._by_family(lambda one: one.effects)
            nearly_free &= effects == effects[nearly_free].min()
            nearly_free &= error <= error[nearly_free].min() + NO_MATTER
            return least(nearly_free, costs, error, texels)
        # what is called for is not to be had: soft edges by few texels are no better than hard ones
        return least(affordable, error, costs, texels)

    def _knee(self, called_for, model):
        """What is at the knee, under the filter that is called for.

        What kernels leave out of penumbrae is asked apart, and may be no more than everything on
        leaves out itself, or what the choice of kernels allows: that everything on cuts penumbrae
        off excuses no coarser texels. But what errs no more, all in all, than the cheapest of
        those is as good as they are.
        """
        if (called_for, model) in self._known_knees:  # a path asks about every candidate
            return self._known_knees[called_for, model]
        everything = everything_over(self.signals.views).replace(filter=called_for)
        told = self._expected
        full = self.forecaster.expected(everything)
        margin = max(KNEE_PIXELS, KNEE_SHARE * full.held)
        held = full.held + margin
        left_out = max(full.left_out, LEFT_OUT * self.forecaster.penumbra()) + margin
        among = self._allowed & self._filtered_by(called_for)
        among &= (told.held <= held) & (told.left_out <= left_out)
        most = -math.inf
        if among.any():
            rows = np.flatnonzero(among)
            most = float(told.error[rows[self._costs(model)[rows].argmin()]])
        full_ms = float(forecast_cost(everything, self.forecaster, model))
        knee = self._known_knees[called_for, model] = _Knee(held, left_out, most, full_ms)
        return knee

    def _filtered_by(self, name):
        """Which candidates have a filter (m,)."""
        return self._by_family(lambda one: one.arranged.filter == name)

    def forecast(self, settings, model):
        """Error and cost of any settings, and whether they meet the goal.

        Parameters
        ----------
        settings : ShadowSettings
        model : CostModel

        Returns
        -------
        forecast : Forecast
        """
        expected = self.forecaster.expected(settings)
        error = float(expected.error)
        ms = float(forecast_cost(settings, self.forecaster, model))
        limit, budget = self.goal["max_error"], self.goal["budget_ms"]
        enough = limit is None or error <= limit
        if limit is None and budget is None:
            enough = bool(self._knee(self.families[0].arranged.filter, model).holds(expected))
        met = (
            enough
            and (budget is None or ms <= budget)
            and map_bytes(settings) <= (self.goal["max_bytes"] or math.inf)
        )
        return Forecast(error, ms, met)

    @cached_property
    def _plain(self):
        """Settings of plain windows, however many: what signals call for by themselves."""
        signals = self.signals
        faces = wanted_faces(signals)
        skewed = signals.sun_moves and signals.sun_elevation_deg > WORLD_ELEVATION_DEG
        return ShadowSettings(
            fit="visible",
            snap="exact" if signals.camera_moves or signals.sun_moves else "none",
            caster_faces=faces,
            bias="manual" if faces == "back" and signals.bias_matters <= FACES_SHARE else "auto",
            light_basis="world" if skewed else "orthonormal",
        )

    def _arrangements(self, count):
        """Settings for so many cascades: plain, and with splits and axes that the forecast likes.

        Which of them is worth its pass over the picture, the costs decide.
        """
        signals = self.signals
        moves = signals.camera_moves or signals.sun_moves
        exclusive = count > 1 and signals.needless_chunks
        settings = changed(
            self._plain, cascade_count=count, cull="exclusive" if exclusive else "inclusive"
        )
        every = [settings]
        if signals.orthographic:
            every = [self._selected(changed(settings, split="uniform"))]
        elif count > 1:
            every = self._split(settings)
        # more maps that save nothing are considered where finer ones are wanted than a map can be
        if not moves and self._saves(count, every):  # neither can be snapped
            every += [
                one
                for plain in every
                for one in (
                    *self._better(plain, turned=True),
                    # exclusive culling means nothing under a warp
                    *map(
                        self._selected,
                        self._better(plain, WARP_GAIN, warp="lispsm", cull="inclusive"),
                    ),
                )
            ]
        held = [one for one in every if not self.forecaster.has_idle_cascades(one)]
        return held if count > 1 else every

    def _saves(self, count, every):
        """Whether so many maps cost less for an error than fewer do."""
        burden = min(self._burden(one) for one in every)
        fewer = min((it for n, it in self._burdens.items() if n < count), default=math.inf)
        self._burdens[count] = burden
        return burden <= (1.0 - GAIN) * fewer

    def _split(self, settings):
        """Settings by the scheme that costs least, and by what is seen if that costs less."""
        schemes = [changed(settings, **one) for one in SCHEMES]
        held = [one for one in schemes if not self.forecaster.has_idle_cascades(one)]
        burdens = [self._burden(one) for one in held]
        best = [
            one for one, it in zip(held, burdens, strict=True) if it <= min(burdens) / (1.0 - GAIN)
        ]
        seen = changed(settings, split="sdsm")
        every = best[:1]
        if not held or self._burden(seen) < (1.0 - GAIN) * min(burdens):
            every.append(seen)
        return [self._selected(one) for one in every]

    def _burden(self, settings):
        return filling_burden(settings, self.forecaster, self.model)

    def _selected(self, settings):
        """Settings, by interval where map selection gains nothing."""
        if settings.cascade_count == 1 or settings.cull == "exclusive":
            return settings
        if self._gains(settings, select="interval"):
            return settings
        return changed(settings, select="interval")

    def _gains(self, settings, **changes):
        """Whether settings are better than changed ones by what counts."""
        return self._missed(settings) < (1.0 - GAIN) * self._missed(changed(settings, **changes))

    def _better(self, settings, gain=GAIN, **changes):
        """Changed settings, if the forecast gains by them what counts; in a list."""
        other = changed(settings, **changes)
        better = self._missed(other) < (1.0 - gain) * self._missed(settings)
        return [other] if better else []

    def _missed(self, settings):
        """What edges miss by maps of one usual size, but for a factor of them all."""
        return sum(self.forecaster.displaced(settings))


def _each(values, count):
    """As many numbers (count,), of as many or of one for all."""
    return values if np.ndim(values) else np.full(count, float(values))
