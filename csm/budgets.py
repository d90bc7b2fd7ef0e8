"""Frames within a budget: a cost model that is corrected by frames that were timed."""

import math
from dataclasses import dataclass, replace

import numpy as np

from .candidates import Candidate, cheapest, finest
from .costs import CostModel, forecast_cost
from .timing import total_ms

__all__ = ["choose_timed", "corrected", "frame_times", "within_budget"]

TIMED = 3  # frames timed of a setting, after one that is not; their median counts
ROUNDS = 6  # of timing and choosing again under a budget: settings timed at most
SOURCE = "frames timed here"


def frame_times(frame):
    """Milliseconds of a frame's shadow maps, and of everything else.

    Parameters
    ----------
    frame : Frame

    Returns
    -------
    maps, others : float
        ``readback`` is in neither.
    """
    maps = sum(ms for name, ms in frame.timings_ms.items() if "shadow_map" in name)
    return maps, total_ms(frame.timings_ms) - maps


def corrected(model, settings, forecaster, times):
    """Cost model that forecasts what was timed.

    Parameters
    ----------
    model : CostModel
    settings : ShadowSettings
        Those that were timed.
    forecaster : Forecaster
        Of the view that was timed.
    times : sequence of (float or None, float)
        From `frame_times`, a frame each; None for maps that were not all drawn, which say nothing
        of what they cost. The medians count.

    Returns
    -------
    model : CostModel
        The same without times. Maps that were never timed keep their costs.
    """
    if not times:
        return model
    maps = [one for one, _ in times if one is not None]
    expected_maps, expected_others = model.parts(settings, forecaster)
    factor = float(np.median([one for _, one in times])) / expected_others
    if factor <= 0.0:
        return model
    scaled = model.scaled(factor, SOURCE)
    if not maps:
        return scaled.with_maps(1.0 / factor)
    measured = float(np.median(maps))
    if expected_maps > 0.0 and measured > 0.0:
        return scaled.with_maps(measured / expected_maps / factor)
    return scaled


@dataclass(frozen=True)
class Point:
    """Settings that were timed.

    Attributes
    ----------
    candidate : Candidate
        With the time that was measured.
    maps, others : float
        What `corrected` made of the frames [ms].
    model : CostModel
        The one that forecasts just that.
    """

    candidate: Candidate
    maps: float
    others: float
    model: CostModel


def within_budget(renderer, scene, search):
    """Choose, time the choice, correct the model, choose again: `choose_timed` with real frames.

    Parameters
    ----------
    renderer : Renderer
    scene : Scene
    search : Search

    Returns
    -------
    chosen : Candidate
    model : CostModel

    Notes
    -----
    Renders at most 24 frames: of at most six settings one that is not counted and three that are.
    """
    view = search.signals.views[0]

    def times_of(settings):
        frames = [
            renderer.render(scene, view.camera, view.sun, settings, outputs=("mask",))
            for _ in range(TIMED + 1)
        ][1:]
        return [frame_times(one) for one in frames]

    return choose_timed(search, times_of)


def choose_timed(search, times_of):
    """Best settings that were timed to lie within the budget.

    Every round times the choice, fits the model to all that were timed, and chooses again up to
    the forecast at which the budget is expected to be used up (`_reaches`), but nothing that was
    timed to miss it. It ends when the choice was timed before, or after six rounds; the sixth is
    the cheapest candidate's if nothing fitted until then.

    Parameters
    ----------
    search : Search
        With a ``budget_ms``.
    times_of : callable
        Takes ShadowSettings, returns a sequence of (maps, others) as `frame_times` does. Called at
        most six times, never twice with the same.

    Returns
    -------
    chosen : Candidate
        Of those that were timed and fit: the most exact, or, if some reach ``max_error``, the
        cheapest of these. If none fits, the cheapest that was timed. With the time that the model
        forecasts, which is the one that was measured of it.
    model : CostModel
        Of this machine, corrected by the frames of that choice.
    """
    budget, limit = search.goal["budget_ms"], search.goal["max_error"]
    model, points = search.model, []
    chosen = search.choose(model)
    while True:
        points.append(_timed(chosen, search, times_of))
        if len(points) == ROUNDS:
            break
        fits = any(point.candidate.ms <= budget for point in points)
        model = _fitted(points, search)
        reaches = _reaches(points, search, model)
        if len(points) == ROUNDS - 1 and not fits:
            reaches = (0.0,)  # which nothing lies within: the cheapest is chosen
        missed = [point.candidate.settings for point in points if point.candidate.ms > budget]
        timed = [point.candidate.settings for point in points]
        choices = (search.choose(model, reach, missed) for reach in reaches)
        chosen = next((one for one in choices if one.settings not in timed), None)
        if chosen is None:
            break
    fitting = [point for point in points if point.candidate.ms <= budget]
    good = [p for p in fitting if limit is not None and p.candidate.error <= limit]
    order = finest if fitting and not good else cheapest
    best = min(good or fitting or points, key=lambda point: order(point.candidate))
    return best.candidate, best.model


def _timed(candidate, search, times_of):
    """Point of a candidate."""
    forecaster = search.forecaster
    model = corrected(search.model, candidate.settings, forecaster, times_of(candidate.settings))
    ms = float(forecast_cost(candidate.settings, forecaster, model))
    maps, others = model.parts(candidate.settings, forecaster)
    return Point(replace(candidate, ms=ms), maps, others, model)


def _fitted(points, search):
    """Cost model by all that was timed: medians of the ratios, which one outlier does not move.

    One factor is of maps and one of everything else: what is timed of large maps would else tell
    what small ones cost, whose frame is made of other things.
    """
    model, ratios = search.model, ([], [])
    for point in points:
        expected = model.parts(point.candidate.settings, search.forecaster)
        for found, was, now in zip(ratios, expected, (point.maps, point.others), strict=True):
            if was > 0.0 and now > 0.0:
                found.append(math.log(now / was))
    maps, others = (math.exp(np.median(one)) if one else 1.0 for one in ratios)
    return model.scaled(others, SOURCE).with_maps(maps / others)


def _reaches(points, search, model):
    """Forecasts [ms] at which the budget is expected to be used up: two, in order of trial.

    Two factors do not fit every setting. So the budget is taken to forecasts by what was timed on
    both sides of it: between the dearest that fitted and the cheapest dearer one that did not, by
    power law (straight between logarithms); where there is one side alone, by its ratio. If one of
    the two sides is an outlier, the fitted model knows better: what it says itself, but no more
    than was timed not to fit. The lesser of the two is tried after a miss, the greater after what
    fitted. After n misses in a row the way from the dearest that fitted (or the cheapest of all)
    is gone by its n-th part alone: what misses by a little each time must not use up the rounds.
    """
    budget = search.goal["budget_ms"]
    known = [
        (forecast_cost(point.candidate.settings, search.forecaster, model), point.candidate.ms)
        for point in points
    ]
    low = max((one for one in known if one[1] <= budget), default=None)
    misses = [one for one in known if one[1] > budget and (low is None or one[0] > low[0])]
    high = min(misses, default=None)
    if low is None or high is None:
        forecast, ms = low or high
        reach = budget * forecast / ms
    else:
        share = math.log(budget / low[1]) / math.log(high[1] / low[1])
        reach = low[0] * (high[0] / low[0]) ** share
    reaches = reach, max(reach, budget if high is None else min(budget, high[0]))
    row = next((n for n, one in enumerate(reversed(known)) if one[1] <= budget), len(known))
    if not row:
        return reaches[::-1]
    least = search.least_ms(model) if low is None else low[0]
    return (least * (reach / least) ** (1.0 / row) if reach > least else reach), reaches[1]
