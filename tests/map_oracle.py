"""What a shadow map must hold: triangles rasterised by plane equations in doubles, written from the
conventions, never from the C or the shaders.

A rasteriser may move each corner to its sub-texel grid, by at most 1/256 texel along each axis.
Coverage of a texel is therefore sure unless its centre lies that near an edge, and a depth
interpolated between moved corners differs from the plane's by at most the slope times that: at a
point inside, the weights that mix the corners also mix their displacements.
"""

from dataclasses import dataclass

import numpy as np

from csm import spaces

SUB_TEXEL = 2.0**-8  # texels: the largest displacement of a corner along an axis
SURE = 2.0 * SUB_TEXEL  # a centre further than this from an edge (length of the displacement, and
# as much again for float32 coordinates) is covered for sure or for sure not
RANGE_ROUNDING = 4.0 * 2.0**-23  # of clip depth in float32: scale, offset, interpolation, store


@dataclass
class MapOracle:
    """One cascade's map, (s, s) each, indexed [v, u]: depth is between `lowest` and `highest`
    wherever `sure`, that is, where no edge is near the texel's centre."""

    depth: np.ndarray  # float64, of the planes; 1 where nothing is
    lowest: np.ndarray
    highest: np.ndarray
    sure: np.ndarray  # bool
    owner: np.ndarray  # int64: the triangle in front, -1 for none


def texel_corners(scene, cascades, i):
    """(m, 3, 3) float64: u and v in texels, clip depth, of every corner of every drawn triangle."""
    positions, triangles = scene.flatten()
    uvz = spaces.transform_points(cascades.uvz_from_world[i], positions)
    uvz[:, :2] *= cascades.map_size[i]
    return uvz[triangles]


def rasterise(corners, size, *, clamp=False):
    """Map of triangles given by `texel_corners`; `clamp` flattens what lies before depth 0."""
    depth = np.ones((size, size))
    sure, owner = np.ones((size, size), bool), np.full((size, size), -1)
    oracle = MapOracle(depth, depth.copy(), depth.copy(), sure, owner)
    for number, triangle in enumerate(corners):
        _draw(oracle, number, triangle, size, clamp)
    return oracle


def _draw(oracle, number, triangle, size, clamp):
    low = np.floor(triangle[:, :2].min(axis=0) - 1.0).astype(int)
    high = np.ceil(triangle[:, :2].max(axis=0) + 1.0).astype(int)
    (u0, v0), (u1, v1) = np.clip(low, 0, size), np.clip(high, 0, size)
    if u0 >= u1 or v0 >= v1:
        return
    part = np.s_[v0:v1, u0:u1]
    centre = np.stack(np.meshgrid(np.arange(u0, u1) + 0.5, np.arange(v0, v1) + 0.5), axis=-1)
    oracle.sure[part] &= _distance_to_edges(centre, triangle[:, :2]) > SURE
    a, b, c = triangle
    area = _cross(b[:2] - a[:2], c[:2] - a[:2])
    if area == 0.0:
        return
    weight_a = _cross(c[:2] - b[:2], centre - b[:2]) / area
    weight_b = _cross(a[:2] - c[:2], centre - c[:2]) / area
    weights = np.stack([weight_a, weight_b, 1.0 - weight_a - weight_b], axis=-1)
    inside = (weights >= 0.0).all(axis=-1)
    depth = weights @ triangle[:, 2]
    tolerance = np.abs(_slope(triangle, area)).sum() * SUB_TEXEL + RANGE_ROUNDING
    if clamp:
        depth = np.clip(depth, 0.0, 1.0)
    else:
        assert (triangle[:, 2] > 0.0).all()
        assert (triangle[:, 2] < 1.0).all()
    oracle.owner[part][inside & (depth < oracle.depth[part])] = number
    for bound, value in (
        (oracle.depth, depth),
        (oracle.lowest, depth - tolerance),
        (oracle.highest, depth + tolerance),
    ):
        np.minimum(bound[part], value, out=bound[part], where=inside)


def _slope(triangle, area):
    """Change of depth per texel along u and v on the triangle's plane."""
    one, other = triangle[1] - triangle[0], triangle[2] - triangle[0]
    along_u = one[2] * other[1] - other[2] * one[1]
    along_v = other[2] * one[0] - one[2] * other[0]
    return np.array([along_u, along_v]) / area


def _cross(one, other):
    return one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]


def _distance_to_edges(points, corners):
    """Texels from each point (..., 2) to the nearest of the three edges."""
    nearest = np.full(points.shape[:-1], np.inf)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = end - start
        length_squared = edge @ edge
        along = (points - start) @ edge / (length_squared or 1.0)
        offset = points - start - np.clip(along, 0.0, 1.0)[..., None] * edge
        nearest = np.minimum(nearest, np.hypot(offset[..., 0], offset[..., 1]))
    return nearest
