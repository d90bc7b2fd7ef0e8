"""Building blocks of the scenes made by code: closed shapes and height fields as plain arrays.

A shape is a pair (positions (n, 3) float64, triangles (m, 3) int32), counter-clockwise from
outside. y is up.
"""

import math

import numpy as np

from .mesh import Mesh
from .spaces import transform_points

__all__ = [
    "box",
    "boxes",
    "boxes_at",
    "cone",
    "globe",
    "ground",
    "join",
    "mesh",
    "placements",
    "repeat",
    "roof",
    "tube",
]

_BOX_CORNERS = np.array([[x, y, z] for y in (0, 1) for z in (0, 1) for x in (0, 1)], np.float64)
_BOX_TRIANGLES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]),  # bottom, top
        *([0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]),  # north (-z), south (+z)
        *([0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),  # west (-x), east (+x)
    ],
    np.int32,
)


def join(*shapes):
    """Put shapes into one; the parts are not welded."""
    starts = np.cumsum([0, *(len(positions) for positions, _ in shapes)])
    triangles = [part + np.int32(start) for (_, part), start in zip(shapes, starts, strict=False)]
    return np.concatenate([positions for positions, _ in shapes]), np.concatenate(triangles)


def mesh(name, *shapes):
    """Make a Mesh of shapes."""
    return Mesh(*join(*shapes), name)


def repeat(shape, transforms):
    """Bake a shape once per matrix, (k, 4, 4), into one shape."""
    positions, triangles = shape
    placed = [transform_points(transform, positions) for transform in transforms]
    starts = np.arange(len(placed), dtype=np.int32) * np.int32(len(positions))
    return np.concatenate(placed), (triangles[None] + starts[:, None, None]).reshape(-1, 3)


def placements(points, turns_deg=0.0, scales=1.0):
    """Matrices that scale, turn about y (from +z towards +x) and move a shape.

    Parameters
    ----------
    points : (k, 3) array_like
        Where the shape's origin goes [m].
    turns_deg : (k,) array_like or float
    scales : (k,), (k, 3) array_like or float

    Returns
    -------
    world_from_shape : (k, 4, 4) float64
    """
    points = np.asarray(points, np.float64).reshape(-1, 3)
    turns = np.radians(np.broadcast_to(turns_deg, len(points)))
    scales = np.asarray(scales, np.float64)
    scales = np.broadcast_to(scales[:, None] if scales.ndim == 1 else scales, (len(points), 3))
    matrices = np.zeros((len(points), 4, 4))
    matrices[:, 0, 0] = matrices[:, 2, 2] = np.cos(turns)
    matrices[:, 0, 2] = np.sin(turns)
    matrices[:, 2, 0] = -np.sin(turns)
    matrices[:, 1, 1] = 1.0
    matrices[:, :3, :3] *= scales[:, None, :]
    matrices[:, :3, 3] = points
    matrices[:, 3, 3] = 1.0
    return matrices


def box(lower, upper):
    """Axis-aligned box between two corners [m], 12 triangles."""
    return boxes([lower], [upper])


def boxes(lowers, uppers):
    """Axis-aligned boxes between corners (k, 3) [m] in one shape."""
    lowers, uppers = np.asarray(lowers, np.float64), np.asarray(uppers, np.float64)
    positions = lowers[:, None] + _BOX_CORNERS * (uppers - lowers)[:, None]
    starts = 8 * np.arange(len(lowers), dtype=np.int32)
    return positions.reshape(-1, 3), (_BOX_TRIANGLES[None] + starts[:, None, None]).reshape(-1, 3)


def boxes_at(points, lower, upper):
    """Axis-aligned boxes that reach from `lower` to `upper` about each point (k, 3) [m]."""
    points = np.asarray(points, np.float64)
    return boxes(points + np.asarray(lower), points + np.asarray(upper))


def roof(lower, upper, overhang=0.4, thickness=0.15):
    """Gable roof over a box's footprint: the ridge runs along z from the eaves' height to the top.

    Two slabs of the given thickness [m] with overhanging eaves, and the gable walls; 28 triangles.
    """
    (x0, y0, z0), (x1, y1, z1) = lower, upper
    middle, lift = 0.5 * (x0 + x1), (y1 - y0) / (0.5 * (x1 - x0))
    slabs = []
    for edge, sign in ((x0 - overhang, -1), (x1 + overhang, 1)):
        positions, triangles = box(
            (0, -thickness, z0 - overhang), (abs(edge - middle), 0, z1 + overhang)
        )
        positions[:, 1] += y1 + thickness - lift * positions[:, 0]
        positions[:, 0] = middle + sign * positions[:, 0]
        slabs.append((positions, triangles if sign > 0 else triangles[:, [0, 2, 1]]))
    gables = []
    for z, order in ((z0, [0, 2, 1]), (z1, [0, 1, 2])):
        corners = np.array([[x0, y0, z], [x1, y0, z], [middle, y1, z]])
        # Two-sided and thin: a gable is the end of a room, seen from outside and inside alike.
        gables.append((corners, np.array([order, order[::-1]], np.int32)))
    return join(*slabs, *gables)


def tube(path, radius, sides=6):
    """Round bar along a path of points (k, 3) [m], open at its ends; 2 (k - 1) sides triangles."""
    path = np.asarray(path, np.float64)
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.where(np.abs(along[:, 1:2]) < 0.9, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    across = np.cross(along, across)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(along, across)
    angles = np.arange(sides) * (2.0 * math.pi / sides)
    ring = np.cos(angles)[:, None] * across[:, None] + np.sin(angles)[:, None] * other[:, None]
    radius = np.broadcast_to(radius, len(path))[:, None, None]
    return (path[:, None] + radius * ring).reshape(-1, 3), _wound(len(path), sides)


def _wound(rings, sides):
    first = (np.arange(rings - 1)[:, None] * sides + np.arange(sides)).astype(np.int32)
    beside = (np.arange(rings - 1)[:, None] * sides + (np.arange(sides) + 1) % sides).astype(
        np.int32
    )
    a, b, c, d = first, beside, beside + sides, first + sides
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3).astype(np.int32)


def cone(radius, bottom, top, sides=8):
    """Cone about the y axis between two heights [m], with its floor; 2 sides - 2 triangles."""
    angles = np.arange(sides) * (2.0 * math.pi / sides)
    rim = np.stack([radius * np.sin(angles), np.full(sides, bottom), radius * np.cos(angles)], 1)
    index = np.arange(sides, dtype=np.int32)
    mantle = np.stack([index, (index + 1) % sides, np.full(sides, sides, np.int32)], axis=1)
    floor = np.stack([np.zeros(sides - 2, np.int32), index[2:], index[1:-1]], axis=1)
    return np.vstack([rim, [0.0, top, 0.0]]), np.concatenate([mantle, floor])


def globe(centre, radius, rings=4, sides=7):
    """Ball as rings of triangles about a centre [m]; 2 sides (rings - 1) triangles."""
    polar = np.pi * np.arange(1, rings) / rings
    azimuth = np.arange(sides) * (2.0 * math.pi / sides)
    body = np.stack(
        [
            np.sin(polar)[:, None] * np.sin(azimuth),
            np.broadcast_to(-np.cos(polar)[:, None], (rings - 1, sides)),
            np.sin(polar)[:, None] * np.cos(azimuth),
        ],
        axis=-1,
    ).reshape(-1, 3)
    index = np.arange(sides, dtype=np.int32)
    beside, last = (index + 1) % sides, np.int32(sides * (rings - 2))
    south, north = np.full(sides, len(body), np.int32), np.full(sides, len(body) + 1, np.int32)
    caps = [
        np.stack([south, beside, index], axis=1),
        np.stack([north, last + index, last + beside], axis=1),
    ]
    positions = np.vstack([body, [0, -1, 0], [0, 1, 0]]) * radius + np.asarray(centre)
    return positions, np.concatenate([_wound(rings - 1, sides), *caps]).astype(np.int32)


def ground(half, y=0.0):
    """Square of two triangles, facing up."""
    corners = np.array([[-half, y, -half], [-half, y, half], [half, y, half], [half, y, -half]])
    return corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)
