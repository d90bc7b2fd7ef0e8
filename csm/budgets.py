"""Frames within a budget: a cost model that is corrected by frames that were timed."""

from dataclasses import replace

import numpy as np

from .forecasts import CostModel, forecast_cost
from .timing import total_ms

__all__ = ["corrected", "frame_times", "within_budget"]

TIMED = 3  # frames timed of a setting; their median counts
ROUNDS = 4  # of timing and choosing again under a budget


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


def corrected(model, settings, signals, times):
    """Cost model that forecasts what was timed.

    Parameters
    ----------
    model : CostModel
    settings : ShadowSettings
        Those that were timed.
    signals : Signals
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
    expected_maps, expected_others = model.parts(settings, signals)
    factor = float(np.median([one for _, one in times])) / expected_others
    if factor <= 0.0:
        return model
    scaled = model.scaled(factor, "frames timed here")
    if not maps:
        return scaled.with_maps(1.0 / factor)
    measured = float(np.median(maps))
    if expected_maps > 0.0 and measured > 0.0:
        return scaled.with_maps(measured / expected_maps / factor)
    return scaled


def within_budget(renderer, scene, search):
    """Choose, time the choice, correct the model, choose again until the choice fits.

    Parameters
    ----------
    renderer : Renderer
    scene : Scene
    search : Search

    Returns
    -------
    chosen : Candidate
        With the time that the model forecasts, which is the one that was measured of it.
    model : CostModel
        Of this machine, corrected by the frames of that choice.
    """
    view, signals = search.signals.views[0], search.signals

    def timed(settings, model):
        frames = [
            renderer.render(scene, view.camera, view.sun, settings, outputs=("mask",))
            for _ in range(TIMED + 1)
        ][1:]
        return corrected(model, settings, signals, [frame_times(one) for one in frames])

    def costing(candidate, model):
        return replace(candidate, ms=forecast_cost(candidate.settings, signals, model))

    model = CostModel()
    chosen = search.choose(model)
    fitting = None
    for _ in range(ROUNDS):
        model = timed(chosen.settings, model)
        measured = costing(chosen, model)
        if measured.ms <= search.goal["budget_ms"] and (
            fitting is None or measured.error < fitting[0].error
        ):
            fitting = measured, model
        again = search.choose(model)
        if again.settings == chosen.settings:
            break
        chosen = again
    if fitting is not None:
        return fitting
    cheapest = search.choose(model)
    model = timed(cheapest.settings, model)
    return costing(cheapest, model), model
