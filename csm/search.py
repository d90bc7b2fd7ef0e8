"""Number, size, splits and axes of the maps: forecasts of every arrangement, and the choice."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby, product

import numpy as np

from .arrangements import LEFT_OUT
from .caster_sides import FACES_SHARE
from .decisions import (
    COUNTS,
    GAIN,
    SMALLEST,
    SOFT_PIXELS,
    TAPS,
    WARP_GAIN,
    WORLD_ELEVATION_DEG,
    Situation,
    wanted_faces,
    wanted_format,
    wanted_size,
)
from .forecasts import CostModel, Expected, Forecaster, forecast_cost
from .plans import map_bytes
from .settings import ShadowSettings
from .verification import everything_on

__all__ = ["Candidate", "Forecast", "Search", "cheapest", "finest"]

STEPS = 4  # of sizes, from one to its double
SIZES = tuple(round(SMALLEST * 2 ** (k / STEPS)) for k in range(4 * STEPS + 1))  # to 4096
# What everything switched on may still gain, as forecast: two fifths of what it may as measured,
# 5 % or 0.05 % of the pixels. Of 55 real pairs, forecasts within that were so measured in 52; of
# what the factors miss, the median is 12 %.
KNEE_SHARE, KNEE_PIXELS = 0.02, 2e-4


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
class Candidate:
    """An arrangement of windows with maps of one size, and what is forecast of it.

    Attributes
    ----------
    arranged : ShadowSettings
        All but the size of the maps and what hangs on it.
    map_size : int
    error, ms : float
    changes : dict
        Size, and what hangs on it.
    expected : Expected
        The error in its parts.
    """

    arranged: ShadowSettings = field(repr=False)
    map_size: int
    error: float
    ms: float
    changes: dict = field(default_factory=dict, repr=False)
    expected: Expected = field(default=None, repr=False)

    @cached_property
    def settings(self):
        """The whole of them; made when they are asked for, since most never are."""
        return self.arranged.replace(**self.changes)

    @property
    def texels(self):
        """Of all maps."""
        return self.arranged.cascade_count * self.map_size**2


class Search:
    """Number, size, splits and axes of the maps.

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
        self._largest, self._found = largest, None

    @property
    def most_bytes(self):
        """Bytes of the largest maps that are considered where nothing bounds them."""
        side = max(size for size in SIZES if size <= self._largest)
        return map_bytes(ShadowSettings(cascade_count=max(COUNTS), map_size=side))

    def candidates(self, model):
        """All settings that are considered, with forecasts; the rows' answers are in them."""
        if not sum(view.facing_count for view in self.signals.views):
            dark = ShadowSettings(filter="none")
            ms = forecast_cost(dark, self.signals, model)
            return [Candidate(dark, SMALLEST, 0.0, ms, expected=Expected(0.0, 0.0, 0.0))]
        if self._found is None:
            self._found = self._forecast()
        every = []
        for _, sized in groupby(self._found, key=lambda one: id(one.arranged)):
            sized = list(sized)
            sizes = np.array([one.map_size for one in sized])
            costs = forecast_cost(sized[0].arranged, self.signals, model, map_size=sizes).tolist()
            every += [replace(one, ms=ms) for one, ms in zip(sized, costs, strict=True)]
        return every

    def _forecast(self):
        """Every arrangement and size; where soft shadows are called for, under them and hard ones.

        The first filter is the one that is called for. Where hard edges are, soft ones may still be
        what an error takes that was asked for.
        """
        soft = self.signals.penumbra_pixels[2] >= SOFT_PIXELS
        arranged = [one for count in COUNTS for one in self._arrangements(count)]
        most, found = self.goal["max_bytes"], []
        filters = [{"filter": "hard"}]
        pcss = [{"filter": "pcss", "tap_count": taps} for taps in TAPS]
        if soft:
            filters = pcss + filters
        elif self.goal["max_error"] is not None and self.signals.penumbra_pixels[2] > 0.0:
            filters += pcss
        for settings, changes in product(arranged, filters):
            found += self._sized(settings.replace(**changes))
        if most is not None:
            found = [one for one in found if map_bytes(one.settings) <= most]
        if not found:
            raise ValueError(
                f"max_bytes must hold one map of {SMALLEST} x {SMALLEST} (got {most:g})"
            )
        return found

    def _sized(self, settings):
        """Candidates of an arrangement, one a size, with all that hangs on the size."""
        at = Situation(self.signals, self.forecaster, settings)
        sizes = np.array([size for size in SIZES if size <= self._largest])
        depends = {"map_size": sizes.tolist(), "depth_format": wanted_format(at, sizes)}
        if settings.filter == "pcss":
            depends["filter_size"] = wanted_size(at, sizes)
        expected = self.forecaster.expected(settings, sizes, depends.get("filter_size"))
        parts = (
            np.broadcast_to(part, sizes.shape).tolist()
            for part in (expected.error, expected.held, expected.left_out)
        )
        changes = (
            dict(zip(depends, one, strict=True)) for one in zip(*depends.values(), strict=True)
        )
        forecasts = (Expected(*one) for one in zip(*parts, strict=True))
        return [
            Candidate(settings, one["map_size"], forecast.error, 0.0, one, forecast)
            for one, forecast in zip(changes, forecasts, strict=True)
        ]

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
        every = self.candidates(model)
        limit, budget = self.goal["max_error"], self.goal["budget_ms"]
        reach = budget if reach is None else reach
        affordable = [c for c in every if budget is None or c.ms <= reach]
        if without:
            sizes = {one.map_size for one in without}  # settings are made of few candidates
            affordable = [
                c for c in affordable if c.map_size not in sizes or c.settings not in without
            ]
        if not affordable:
            return min(every, key=lambda c: (c.ms, c.error))
        if limit is not None:
            good = [c for c in affordable if c.error <= limit]
            return min(good, key=cheapest) if good else min(affordable, key=finest)
        if budget is not None:
            return min(affordable, key=finest)
        called_for = every[0].arranged.filter
        affordable = [c for c in affordable if c.arranged.filter == called_for]
        enough = self._knee(called_for)
        good = [c for c in affordable if enough(c.expected)]
        return min(good, key=cheapest) if good else min(affordable, key=finest)

    def _knee(self, called_for):
        """Whether what is expected is at the knee, under the filter that is called for: a function.

        What kernels leave out of penumbrae is asked apart, and may be no more than everything on
        leaves out itself, or what the choice of kernels allows: that everything on cuts penumbrae
        off excuses no coarser texels.
        """
        first = self.signals.views[0]
        full = everything_on(first.sun, camera=first.camera).replace(filter=called_for)
        full = self.forecaster.expected(full)
        margin = max(KNEE_PIXELS, KNEE_SHARE * full.held)
        held = full.held + margin
        left_out = max(full.left_out, LEFT_OUT * self.forecaster.penumbra()) + margin
        return lambda expected: expected.held <= held and expected.left_out <= left_out

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
        ms = float(forecast_cost(settings, self.signals, model))
        limit, budget = self.goal["max_error"], self.goal["budget_ms"]
        enough = limit is None or error <= limit
        if limit is None and budget is None:
            enough = self._knee(self.candidates(model)[0].arranged.filter)(expected)
        met = (
            enough
            and (budget is None or ms <= budget)
            and map_bytes(settings) <= (self.goal["max_bytes"] or math.inf)
        )
        return Forecast(error, ms, met)

    def _arrangements(self, count):
        """Settings for so many cascades: plain, and with splits and axes that the forecast likes.

        Which of them is worth its pass over the picture, the costs decide.
        """
        signals = self.signals
        moves = signals.camera_moves or signals.sun_moves
        settings = ShadowSettings(
            cascade_count=count,
            fit="visible",
            snap="exact" if moves else "none",
            cull="exclusive" if count > 1 and signals.needless_chunks else "inclusive",
            caster_faces=wanted_faces(signals),
            bias="manual" if signals.bias_matters <= FACES_SHARE else "auto",
            light_basis=(
                "world"
                if signals.sun_moves and signals.sun_elevation_deg > WORLD_ELEVATION_DEG
                else "orthonormal"
            ),
        )
        every = [settings]
        if signals.orthographic:
            every = [settings.replace(split="uniform")]
        elif count > 1:
            plain = self._selected(settings)
            every = [plain, *self._better(plain, split="sdsm")]
            if self.forecaster.has_idle_cascades(plain):
                every = [plain.replace(split="sdsm")]
        if not moves:  # neither can be snapped
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

    def _selected(self, settings):
        """Settings, by interval where map selection gains nothing."""
        if settings.cascade_count == 1 or settings.cull == "exclusive":
            return settings
        if self._gains(settings, select="interval"):
            return settings
        return settings.replace(select="interval")

    def _gains(self, settings, **changes):
        """Whether settings are better than changed ones by what counts."""
        now, then = (self.forecaster.aliasing(s) for s in (settings, settings.replace(**changes)))
        return now < (1.0 - GAIN) * then

    def _better(self, settings, gain=GAIN, **changes):
        """Changed settings, if the forecast gains by them what counts; in a list."""
        changed = settings.replace(**changes)
        now, then = (self.forecaster.aliasing(s) for s in (settings, changed))
        return [changed] if then < (1.0 - gain) * now else []


def cheapest(candidate):
    """Sort by cost, then by error."""
    return candidate.ms, candidate.error, candidate.texels


def finest(candidate):
    """Sort by error, then by cost."""
    return candidate.error, candidate.ms, candidate.texels
