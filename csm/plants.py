"""Plants made by code, and how they are set on points: instances of four small meshes."""

import numpy as np

from .shapes import cone, globe, join, mesh, placements, tube

__all__ = ["broadleaf", "bush", "conifer", "planted"]


def conifer():
    """Return a conifer 1 m high: a trunk and four cones; 64 triangles."""
    tiers = [cone(0.21 - 0.042 * i, 0.16 + 0.19 * i, 0.50 + 0.166 * i, 7) for i in range(4)]
    return join(tube([(0, 0, 0), (0, 0.25, 0)], (0.024, 0.018), 8), *tiers)


def broadleaf(seed):
    """Return a broad-leaved tree 1 m high: six balls of leaves on limbs; 288 triangles."""
    random = np.random.default_rng(seed)
    parts = [tube([(0, 0, 0), (0, 0.25, 0), (0.02, 0.5, 0.01)], (0.035, 0.026, 0.014), 6)]
    for i in range(6):
        angle, lift = i * 2.4 + random.uniform(-0.3, 0.3), random.uniform(0.5, 0.8)
        reach = 0.24 * (1.0 - 1.6 * abs(lift - 0.62))
        centre = np.array([reach * np.sin(angle), lift, reach * np.cos(angle)])
        parts.append(tube([(0, 0.34, 0), centre], (0.012, 0.005), 4))
        parts.append(_leaves(centre, random.uniform(0.15, 0.2), random))
    return join(*parts)


def bush(seed):
    """Return a bush 1 m high; 144 triangles."""
    random = np.random.default_rng(seed)
    parts = []
    for i in range(4):
        centre = (0.35 * np.sin(1.6 * i), random.uniform(0.3, 0.55), 0.35 * np.cos(1.6 * i))
        parts.append(_leaves(centre, random.uniform(0.32, 0.45), random))
    return join(*parts)


def _leaves(centre, radius, random):
    """Return an uneven ball: a smooth one would throw the shadow of a balloon."""
    ball, triangles = globe((0, 0, 0), radius, 4, 6)
    return ball * random.uniform(0.8, 1.15, (len(ball), 1)) + centre, triangles


def _plants():
    """Meshes of the plants and their heights (low, high) [m]."""
    return [
        (mesh("conifer", conifer()), (9.0, 19.0)),
        (mesh("broadleaf_a", broadleaf(1)), (7.0, 14.0)),
        (mesh("broadleaf_b", broadleaf(2)), (6.0, 12.0)),
        (mesh("bush", bush(3)), (0.8, 2.2)),
    ]


def planted(points, random, shares):
    """Set plants on points (k, 3): meshes, instance_mesh and world_from_instance."""
    plants = _plants()
    kinds = random.choice(len(plants), len(points), p=shares)
    low, high = np.array([heights for _, heights in plants])[kinds].T
    heights = random.uniform(low, high)
    widths = heights * random.uniform(0.85, 1.2, len(points))
    scales = np.stack([widths, heights, widths], axis=1)
    turns = random.uniform(0.0, 360.0, len(points))
    return [plant for plant, _ in plants], kinds, placements(points, turns, scales)
