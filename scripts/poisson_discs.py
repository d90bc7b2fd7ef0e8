"""Poisson discs of shaders/include/disc.glsl: ``python -m scripts.poisson_discs`` prints them.

Points kept apart in the unit disc by best candidate [Mitchell1991]: each new one is the farthest
from its neighbours of many drawn at random. Of many such sets the one with the largest least
distance is kept. It is moved to the centroid and stretched to the variances of the disc, 0 and 1/4
along every direction, so that an edge seen through few taps lies where it does through the disc,
and is as wide.
"""

import functools

import numpy as np

COUNTS = (8, 16)
SETS, CANDIDATES = 400, 40


def best_candidates(rng, count):
    """(count, 2) points of the unit disc."""
    points = np.zeros((0, 2))
    for number in range(count):
        angle = rng.uniform(0.0, 2.0 * np.pi, (number + 1) * CANDIDATES)
        radius = np.sqrt(rng.uniform(size=len(angle)))
        drawn = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        gaps = np.linalg.norm(drawn[:, None] - points[None], axis=-1).min(axis=1, initial=9.0)
        points = np.concatenate([points, drawn[[gaps.argmax()]]])
    return points


def normalised(points):
    """The points with the centroid and the variances of a disc."""
    points = points - points.mean(axis=0)
    variances, axes = np.linalg.eigh(points.T @ points / len(points))
    return points @ (axes * (0.5 / np.sqrt(variances))) @ axes.T


def least_distance(points):
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
    return gaps[~np.eye(len(points), dtype=bool)].min()


@functools.cache
def disc(count):
    """(count, 2) float64 points, rounded as they are printed, the innermost first."""
    rng = np.random.default_rng(count)
    sets = (normalised(best_candidates(rng, count)) for _ in range(SETS))
    inside = [points for points in sets if (points**2).sum(axis=1).max() < 0.999]
    best = max(inside, key=least_distance)
    return np.round(best[np.argsort((best**2).sum(axis=1))], 5)


def text(count):
    """The GLSL constant."""
    rows = ",\n".join(f"    vec2({x:.5f}, {y:.5f})" for x, y in disc(count))
    return f"const vec2 poisson_disc[{count}] = vec2[](\n{rows});"


if __name__ == "__main__":
    for count in COUNTS:
        print(text(count))
