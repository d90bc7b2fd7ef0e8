"""Plants made by code, and how they are set on points: instances of small meshes.

Leaves are closed balls, or cards: two triangles under an image that cuts leaves out of them.
"""

import numpy as np

from .mesh import Mesh
from .shapes import cone, globe, join, mesh, placements, tube

__all__ = ["broadleaf", "bush", "card_tree", "cards", "conifer", "leaf_image", "planted"]

LEAF_IMAGE_SIDE = 128  # texels


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


def cards(corners):
    """Join quadrilaterals (k, 4, 3), the whole image on each: positions, triangles and uv."""
    count = len(corners)
    quad = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    triangles = quad + 4 * np.arange(count, dtype=np.int32)[:, None, None]
    uv = np.tile([(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)], (count, 1))
    return corners.reshape(-1, 3), triangles.reshape(-1, 3), uv


def leaf_image():
    """Alpha of a twig with leaves, (128, 128) uint8: pointed ovals on both sides of a stem."""
    y, x = (np.indices((LEAF_IMAGE_SIDE, LEAF_IMAGE_SIDE)) + 0.5) / LEAF_IMAGE_SIDE
    inside = 0.008 - np.abs(x - 0.5)  # [image sides], positive in a leaf or the stem
    inside = np.minimum(inside, y - 0.2)
    for i in range(7):
        foot, side = 0.93 - 0.11 * i, (-1.0, 1.0)[i % 2]
        angle = np.radians(58.0 - 4.0 * i) if i < 6 else 0.0  # the last leaf ends the twig
        length, half = 0.40 - 0.025 * i, 0.085 - 0.004 * i
        along = side * (x - 0.5) * np.sin(angle) + (foot - y) * np.cos(angle)
        across = side * (x - 0.5) * np.cos(angle) - (foot - y) * np.sin(angle)
        share = np.clip(along / length, 0.0, 1.0)
        inside = np.maximum(inside, half * 4.0 * share * (1.0 - share) - np.abs(across))
    # a ramp two texels wide, so that the cut-off chooses how full the leaves are
    alpha = np.clip(0.5 + 0.5 * LEAF_IMAGE_SIDE * inside, 0.0, 1.0)
    return np.round(255.0 * alpha).astype(np.uint8)


def card_tree(seed, twigs=170):
    """Return a tree 1 m high as two meshes: trunk and limbs, and a crown of cards with leaves."""
    random = np.random.default_rng(seed)
    limbs = [tube([(0, 0, 0), (0.01, 0.3, 0), (0, 0.75, 0.01)], (0.03, 0.022, 0.006), 7)]
    corners = np.empty((twigs, 4, 3))
    for i in range(twigs):
        lift = (i + 0.5) / twigs
        reach = 0.34 * np.sqrt(lift * (1.0 - lift) * 4.0) * random.uniform(0.35, 1.0)
        angle = 2.399963 * i  # the golden angle
        outwards = np.array([np.sin(angle), random.uniform(-0.2, 0.7), np.cos(angle)])
        outwards /= np.linalg.norm(outwards)
        foot = reach * outwards * (1.0, 0.0, 1.0) + (0.0, 0.28 + 0.6 * lift, 0.0)
        across = np.cross(outwards, random.normal(size=3))
        side = random.uniform(0.13, 0.19)
        across *= 0.5 * side / np.linalg.norm(across)
        bottom, top = foot - 0.3 * side * outwards, foot + 0.7 * side * outwards
        corners[i] = [bottom - across, bottom + across, top + across, top - across]
        if i % 14 == 7:
            limbs.append(tube([(0, 0.28 + 0.45 * lift, 0), foot], (0.009, 0.003), 4))
    positions, triangles, uv = cards(corners)
    crown = Mesh(positions, triangles, "crown", uv, leaf_image(), 0.5)
    return mesh("limbs", *limbs), crown
