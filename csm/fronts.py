"""Which techniques nothing beats, and what the next halving of the error costs."""

from dataclasses import dataclass

import numpy as np

__all__ = [
    "FEWEST_CASES",
    "Halving",
    "best_within",
    "next_halvings",
    "on_front",
    "paired_interval",
]

# Of n differences of one sign a sign test says that chance gives them at 2 (1/2)^n: below 5 % from
# 6 on. A bootstrap of fewer draws from too little: its interval is narrower than it claims.
FEWEST_CASES = 6


def on_front(costs, errors):
    """Pareto front: those that no other beats in one without losing in the other.

    Parameters
    ----------
    costs, errors : (n,) array_like
        Less is better; NaN is never on the front.

    Returns
    -------
    front : (n,) bool
        Of equal points the first alone.
    """
    costs, errors = (np.asarray(one, float) for one in (costs, errors))
    front = np.zeros(len(costs), bool)
    known = np.flatnonzero(np.isfinite(costs) & np.isfinite(errors))
    least = np.inf
    for i in known[np.lexsort((known, errors[known], costs[known]))]:
        if errors[i] < least:
            front[i] = True
            least = errors[i]
    return front


@dataclass(frozen=True)
class Halving:
    """The cheapest technique with at most half the error of another.

    Attributes
    ----------
    index : int or None
        None where there is none.
    factor : float
        Its cost over the other's; below 1 it is cheaper too.
    """

    index: int | None
    factor: float


def next_halvings(costs, errors):
    """What the next halving of the error costs, for each technique.

    Parameters
    ----------
    costs, errors : (n,) array_like

    Returns
    -------
    halvings : list of Halving
        What has no error has none to halve.
    """
    costs, errors = (np.asarray(one, float) for one in (costs, errors))
    found = []
    for cost, error in zip(costs, errors, strict=True):
        enough = np.flatnonzero((errors <= 0.5 * error) & np.isfinite(costs))
        if error > 0.0 and len(enough) and np.isfinite(cost):
            best = int(enough[np.argmin(costs[enough])])
            factor = costs[best] / cost if cost > 0.0 else np.inf
            found.append(Halving(best, float(factor)))
        else:
            found.append(Halving(None, float("nan")))
    return found


def best_within(costs, errors, budget):
    """Index of the least error within a budget, None without any.

    Parameters
    ----------
    costs, errors : (n,) array_like
    budget : float

    Returns
    -------
    index : int or None
    """
    costs, errors = (np.asarray(one, float) for one in (costs, errors))
    affordable = np.flatnonzero((costs <= budget) & np.isfinite(errors))
    return int(affordable[np.argmin(errors[affordable])]) if len(affordable) else None


def paired_interval(one, other, *, share=0.95, draws=4000, seed=1):
    """Bootstrap interval of the mean difference of two techniques over the same cases.

    Two of them differ only if the interval leaves 0 out. With fewer than 6 cases none can be told
    at 5 %, and there is no interval.

    Parameters
    ----------
    one, other : (n,) array_like
        Errors of the cases, in the same order.
    share : float
        Of the draws within the interval.
    draws, seed : int

    Returns
    -------
    interval : (float, float)
        NaN with fewer than `FEWEST_CASES` of finite errors.

    References
    ----------
    .. [Efron1979] Efron: Bootstrap methods: another look at the jackknife. Annals of Statistics
       7(1), 1979. doi:10.1214/aos/1176344552
    """
    difference = np.asarray(one, float) - np.asarray(other, float)
    difference = difference[np.isfinite(difference)]
    if len(difference) < FEWEST_CASES:
        return float("nan"), float("nan")
    drawn = np.random.default_rng(seed).integers(0, len(difference), (draws, len(difference)))
    tail = 50.0 * (1.0 - share)
    low, high = np.percentile(difference[drawn].mean(axis=1), [tail, 100.0 - tail])
    return float(low), float(high)
