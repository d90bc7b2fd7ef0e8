"""From our numbers to an engine's: splits, sizes of maps, biases. No engine by name."""

import math

import numpy as np

__all__ = [
    "exponent_splits",
    "fit_exponent",
    "fit_lambda",
    "least_constant",
    "power_of_two",
    "resampled",
    "scheme_of",
    "shares",
]

SAME = 1e-6  # relative difference of split distances that are one
EXPONENTS = (0.1, 1e3)  # that a distribution is looked for in
GRID = 100  # places at which a maximum or minimum is looked for before it is refined
STEEPEST_DEG = 89.9


def shares(splits, *, from_near):
    """Inner splits as shares of the shadow distance.

    Parameters
    ----------
    splits : (n + 1,) array_like
        View depths [m], ascending.
    from_near : bool
        Counted from the first of them, ``(s - near) / (far - near)``, or from the camera,
        ``s / far``.

    Returns
    -------
    shares : list of float
        n - 1 of them.
    """
    near, far = (float(splits[0]) if from_near else 0.0), float(splits[-1])
    return [(float(s) - near) / (far - near) for s in splits[1:-1]]


def resampled(splits, count):
    """Splits for another number of cascades along the same curve.

    Parameters
    ----------
    splits : (n + 1,) array_like
        View depths [m].
    count : int

    Returns
    -------
    splits : (count + 1,) float64
        The curve through (k / n, splits[k]), of equal ratios between them (of equal lengths where
        near is not positive), at i / count. Where count divides n these are some of the splits
        themselves; of uniform, logarithmic and practical ones, those of the same scheme.
    """
    splits = np.asarray(splits, np.float64)
    if count == len(splits) - 1:
        return splits.copy()
    at = np.arange(count + 1) / count
    knots = np.linspace(0.0, 1.0, len(splits))
    if splits[0] <= 0.0:
        return np.interp(at, knots, splits)
    made = np.exp(np.interp(at, knots, np.log(splits)))
    whole = np.isclose(at * (len(splits) - 1), np.round(at * (len(splits) - 1)), atol=1e-12)
    exact = splits[np.round(at * (len(splits) - 1)).astype(int)]
    return np.where(whole, exact, made)


def _schemes(splits):
    """Uniform and logarithmic splits (n + 1,) of the same range."""
    near, far = float(splits[0]), float(splits[-1])
    at = np.arange(len(splits)) / (len(splits) - 1)
    uniform = near + (far - near) * at
    return uniform, near * (far / near) ** at if near > 0.0 else uniform


def fit_lambda(splits):
    """Weight of the logarithmic scheme that comes nearest to splits, by least squares.

    Parameters
    ----------
    splits : (n + 1,) array_like
        View depths [m].

    Returns
    -------
    lam : float
        0 (uniform) to 1 (logarithmic).
    splits : (n + 1,) float64
        Those of that weight [m].
    """
    splits = np.asarray(splits, np.float64)
    uniform, logarithmic = _schemes(splits)
    across = logarithmic - uniform
    square = float(across @ across)
    lam = float(across @ (splits - uniform)) / square if square > 0.0 else 0.0
    lam = min(max(lam, 0.0), 1.0)
    return lam, uniform + lam * across


def scheme_of(splits):
    """Name of the scheme that gives these splits, or None.

    Parameters
    ----------
    splits : (n + 1,) array_like
        View depths [m].

    Returns
    -------
    name : {"practical", "uniform", "logarithmic"} or None
        Practical with equal weights. Of a single slice practical: all are the same.
    """
    splits = np.asarray(splits, np.float64)
    uniform, logarithmic = _schemes(splits)
    made = {"uniform": uniform}
    if splits[0] > 0.0:
        made = {
            "practical": 0.5 * (uniform + logarithmic),
            "uniform": uniform,
            "logarithmic": logarithmic,
        }
    for name, other in made.items():
        if np.allclose(splits, other, rtol=SAME, atol=0.0):
            return name
    return None


def exponent_splits(exponent, near, far, count):
    """Splits whose slices grow by one factor.

    Parameters
    ----------
    exponent : float
        Length of a slice over that of the one before it.
    near, far : float
        View depths [m].
    count : int

    Returns
    -------
    splits : (count + 1,) float64
        ``near + (far - near) * sum(e^j, j < i) / sum(e^j, j < count)``.
    """
    lengths = float(exponent) ** np.arange(count)
    return near + (far - near) * np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()


def fit_exponent(splits):
    """Factor between slices that comes nearest to splits.

    Parameters
    ----------
    splits : (n + 1,) array_like
        View depths [m].

    Returns
    -------
    exponent : float
        With the smallest of the largest ratios between a split and its nearest counterpart; 1 of a
        single slice.
    splits : (n + 1,) float64
        Those of that factor [m].
    """
    splits = np.asarray(splits, np.float64)
    near, far, count = splits[0], splits[-1], len(splits) - 1

    def worst(logarithm):
        made = exponent_splits(math.exp(logarithm), near, far, count)
        if near > 0.0:
            return np.abs(np.log(made[1:-1] / splits[1:-1])).max()
        return np.abs(made[1:-1] - splits[1:-1]).max()

    if count == 1:
        return 1.0, splits.copy()
    grid = np.linspace(*np.log(EXPONENTS), GRID)
    best = int(np.argmin([worst(one) for one in grid]))
    exponent = math.exp(_least(worst, grid[max(best - 1, 0)], grid[min(best + 1, GRID - 1)]))
    return exponent, exponent_splits(exponent, near, far, count)


def _least(function, low, high):
    """Where a function of one valley is least: golden sections."""
    shrink = (math.sqrt(5.0) - 1.0) / 2.0
    a, b = high - shrink * (high - low), low + shrink * (high - low)
    at_a, at_b = function(a), function(b)
    for _ in range(60):
        if at_a <= at_b:
            high, b, at_b = b, a, at_a
            a = high - shrink * (high - low)
            at_a = function(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + shrink * (high - low)
            at_b = function(b)
    return 0.5 * (low + high)


def power_of_two(size):
    """Smallest power of two that is not below a size."""
    return 1 << max(int(size) - 1, 0).bit_length()


def least_constant(needed, given):
    """Depth bias that must be added where a bias by the normal does not do.

    A plane at the angle t to the light needs ``needed * tan(t)`` texels of bias along the light;
    an engine's bias by the normal is worth ``given(t)`` texels there.

    Parameters
    ----------
    needed : float
        Texels.
    given : callable
        Of angles [radians], texels along the light.

    Returns
    -------
    constant : float
        Texels along the light: the most that is missing at any angle up to 89.9 degrees.
    """
    angles = np.radians(np.linspace(0.0, STEEPEST_DEG, 4000))
    return float(max(0.0, (needed * np.tan(angles) - given(angles)).max()))
