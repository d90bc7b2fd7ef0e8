"""How maps of unequal sizes share what they may cost.

What edges miss under cascade i is a / s for a map of s texels a side, what its texels cost w s².
For a sum of misses the sum of costs is least where s goes with the cube root of a / w: the
multiplier of Lagrange makes a / s² = 2 l w s. Then the costs are ``(sum (a² w)^(1/3))³`` over the
misses' square, and those of equal maps ``(sum a)² sum w``.
"""

import math

import numpy as np

from .forecasts import UNEQUAL
from .settings import map_sizes

__all__ = ["equal_side", "filling_burden", "size_parts", "texels_spared", "unequal_sizes"]

SIDE_STEP, SIDE_LEAST = 16, 256  # of sides: whole steps of texels, and the least
#: Times the texels that equal maps as good must take, if unequal ones are to be considered.
WORTH = 1.25
#: Of the largest. Smaller maps are forecast to be better still, and were not: of 33 real views
#: with parts down to 0.05 the recommendation took 0.56 of everything on's time, with 0.35 and 0.5
#: 0.53. The coarse picture does not show all edges that are far away.
LEAST_PART = 0.5


def size_parts(settings, forecaster, model):
    """Sizes that cost least for what edges miss.

    Parameters
    ----------
    settings : ShadowSettings
        Of several cascades.
    forecaster : Forecaster
    model : CostModel

    Returns
    -------
    parts : list of float or None
        Of the largest; None where equal maps are nearly as good.
    """
    area = forecaster.displaced(settings)
    if not max(area) > 0.0:
        return None
    each = zip(area, model.usual_costs(settings, forecaster), strict=True)
    parts = [math.cbrt(one / cost) for one, cost in each]
    most = max(parts)
    parts = [max(part / most, LEAST_PART) for part in parts]
    return parts if _texels_spared(area, parts) >= WORTH else None


def unequal_sizes(parts, largest):
    """Sides of maps in whole steps.

    Parameters
    ----------
    parts : (n,) array_like
    largest : float or (k,) float64
        Side of the largest [texels].

    Returns
    -------
    sides : (n,) or (k, n) int
    """
    wanted = np.multiply.outer(np.asarray(largest, float), parts)
    return np.maximum(SIDE_STEP * np.round(wanted / SIDE_STEP).astype(int), SIDE_LEAST)


def equal_side(settings, forecaster):
    """Side of equal maps that miss what unequal ones do [texels]; None where nothing is missed."""
    area = forecaster.displaced(settings)
    return _equal_side(area, map_sizes(settings)) if max(area) > 0.0 else None


def texels_spared(settings, forecaster):
    """How many times the texels of unequal maps equal ones as good have; None as `equal_side`."""
    area = forecaster.displaced(settings)
    return _texels_spared(area, map_sizes(settings)) if max(area) > 0.0 else None


def _equal_side(area, sides):
    missed = sum(one / side for one, side in zip(area, sides, strict=True))
    return sum(area) / (UNEQUAL * missed)


def _texels_spared(area, sides):
    return len(sides) * _equal_side(area, sides) ** 2 / sum(side * side for side in sides)


def filling_burden(settings, forecaster, model):
    """What it costs to fill maps of the best sizes for one error, but for a common factor.

    Parameters
    ----------
    settings : ShadowSettings
        Where they are snapped maps are equal.
    forecaster : Forecaster
    model : CostModel

    Returns
    -------
    burden : float
    """
    area, texel = forecaster.displaced(settings), model.usual_costs(settings, forecaster)
    if settings.snap != "none":
        return sum(area) ** 2 * sum(texel)
    each = zip(area, texel, strict=True)
    return sum(math.cbrt(one * one * cost) for one, cost in each) ** 3
