"""What a coarse frame shows: shadow edges, their occluders, what is thin among the casters."""

import numpy as np

from .sampling import LIT, edge_slopes
from .spaces import transform_points

__all__ = [
    "blockers_of",
    "edges_of",
    "gaps_of",
    "layered_share_of",
    "outline_of",
    "positions_of",
    "thin_share_of",
]

EDGES = 3000  # places of edges that forecasts look at; the others count through these
THIN_TEXELS = 2  # a caster of at most so many texels of the coarse map across is thin
DIRECTIONS, SLICES = 16, 12  # in which, and of depth, the outermost points are kept
CURVED = 0.25  # of a surface's slope that it may change by from texel to texel of the coarse map
LAYERS_BLEED = 0.1  # share of the light that layers of occluders let into a variance map


def positions_of(camera, view_depth, rows, columns):
    """World points (m, 3) of pixels."""
    x, y = camera.pixel_plane()
    across = x[columns, None] * camera.right + y[rows, None] * camera.up
    depth = view_depth[rows, columns].astype(np.float64)[:, None]
    if camera.orthographic:
        return camera.eye + across - depth * camera.backward
    return camera.eye + depth * (across - camera.backward)


def outline_of(points, depths, light_axes):
    """Outermost of points across the light, of every slice of depth: windows reach to them.

    Parameters
    ----------
    points : (m, 3) float64
    depths : (m,) float64
        View depths [m].
    light_axes : (2, 3) float64
        Across the light.

    Returns
    -------
    outline : (k, 3) float64
        At most 192; none of none.
    """
    if not len(points):
        return points
    angles = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
    along = points @ light_axes.T @ np.stack([np.cos(angles), np.sin(angles)])
    low, high = max(depths.min(), 1e-9), max(depths.max(), 2e-9)
    slices = np.searchsorted(np.geomspace(low, high, SLICES + 1)[1:-1], depths)
    kept = [
        on[along[on].argmax(axis=0)]
        for on in (np.flatnonzero(slices == k) for k in range(SLICES))
        if len(on)
    ]
    return points[np.unique(np.concatenate(kept))]


def edges_of(camera, frame, judged, lit, shrink):
    """Places of neighbouring judged pixels on different sides of 0.5."""
    slope_x, slope_y = edge_slopes(lit)
    parts = []
    for axis, (one, other) in enumerate(
        (
            (np.s_[:, :-1], np.s_[:, 1:]),
            (np.s_[:-1, :], np.s_[1:, :]),
        )
    ):
        rows, columns = np.nonzero(judged[one] & judged[other] & (lit[one] != lit[other]))
        step = (rows + axis, columns + 1 - axis)
        across = np.stack(
            [slope[rows, columns] + slope[step] for slope in (slope_x, slope_y)], axis=1
        )
        length = np.linalg.norm(across, axis=1, keepdims=True)
        along_axis = np.eye(2)[axis]
        across = np.where(length > 1e-9, across / np.where(length > 1e-9, length, 1.0), along_axis)
        dark_first = ~lit[rows, columns]
        dark = (np.where(dark_first, rows, step[0]), np.where(dark_first, columns, step[1]))
        parts.append((dark[0], dark[1], across, shrink * np.abs(across[:, axis])))
    every = max(1, -(-sum(len(part[0]) for part in parts) // EDGES))
    rows, columns, across, length = (
        np.concatenate(column)[::every] for column in zip(*parts, strict=True)
    )
    length = length * every
    return {
        "rows": rows,
        "columns": columns,
        "point": positions_of(camera, frame.view_depth, rows, columns),
        "normal": frame.normal[rows, columns].astype(np.float64),
        "across": across,
        "length": length,
    }


def gaps_of(frame, points, rows, columns):
    """Distance [m] from dark pixels to what the coarse map holds before them; inf for lit ones."""
    gaps = np.full(len(rows), np.inf)
    index = frame.cascade_index[rows, columns]
    dark = frame.mask[rows, columns] < LIT
    for i in range(frame.cascades.count):
        on = np.flatnonzero(dark & (index == i))
        gap = _gaps_around(frame, i, points[on], 0)[:, 0]
        # dark by the plane at the texel's centre alone: how near the occluder is, is not known
        gaps[on] = np.where(gap > 0.0, gap, np.inf)
    return gaps


def blockers_of(frame, edges):
    """Occluders' distances [m] at the dark side of edges."""
    distances = np.zeros(len(edges["rows"]))
    index = frame.cascade_index[edges["rows"], edges["columns"]]
    for i in range(frame.cascades.count):
        on = np.flatnonzero(index == i)
        if not len(on):
            continue
        own, slope = _own_depths(frame, i, edges["point"][on], edges["normal"][on], 1)
        gap = _gaps_around(frame, i, edges["point"][on], 1) + own
        t = float(frame.cascades.texel_size[i].max())
        # nearer ones are the surface itself, which curves by a part of its slope
        gap = np.where(gap > t * (0.5 + CURVED * slope[:, None]), gap, np.nan)
        with np.errstate(all="ignore"):
            near = np.where(np.isnan(gap).all(axis=1), 0.0, _nan_min(gap))
            far = np.where(np.isnan(gap).all(axis=1), 0.0, -_nan_min(-gap))
        distances[on] = np.where(near > 0.0, 0.5 * (near + far), 0.5 * t)
    return distances


def layered_share_of(frame, points, rows, columns):
    """Share of receivers in full shadow that a variance map would light by more than a tenth.

    In full shadow are those before which all 5 x 5 texels of the coarse map hold an occluder.
    Whatever the depths z of these are, no light comes through; by their mean and variance alone
    ``var / (var + (receiver - mean)²)`` may [Lauritzen2007]. One sheet across the light has no
    variance. Two layers, a half of the kernel each, give a tenth where one is twice as far from
    the receiver as the other: var = (g/2)² and mean 3g/2 before it.

    Parameters
    ----------
    frame : Frame
        With its maps and the picture's cascades.
    points : (m, 3) float64
        Receivers, in the world.
    rows, columns : (m,) int
        Their pixels.

    Returns
    -------
    share : float
        0 where nothing is in full shadow.
    """
    full = layered = 0
    index = frame.cascade_index[rows, columns]
    for i in range(frame.cascades.count):
        gap = _gaps_around(frame, i, points[index == i], 2)
        t = float(frame.cascades.texel_size[i].max())
        gap = gap[(gap > 0.5 * t).all(axis=1)]  # nearer ones are the surface itself
        variance = gap.var(axis=1)
        full += len(gap)
        bleeds = variance > LAYERS_BLEED * (variance + gap.mean(axis=1) ** 2)
        layered += int(np.count_nonzero(bleeds))
    return layered / max(full, 1)


def _gaps_around(frame, cascade, points, reach):
    """Distance [m] (m, k) from points to what a map holds before them, within a reach [texels]."""
    depths = frame.shadow_maps[cascade]
    uvz = transform_points(frame.cascades.uvz_from_world[cascade], points)
    u, v = np.moveaxis(_texels_around(uvz[:, :2] * len(depths), len(depths), reach), -1, 0)
    around = depths[v, u]
    span = float(np.diff(frame.cascades.depth_range[cascade])[0])
    return (uvz[:, 2:] - around.astype(np.float64)) * span


def _texels_around(places, size, reach):
    """Texels (m, k, 2) of a map of a size round places in it (m, 2), all within the map."""
    steps = range(-reach, reach + 1)
    offsets = np.array([(du, dv) for dv in steps for du in steps])
    return np.clip(places.astype(int), reach, size - 1 - reach)[:, None] + offsets


def _own_depths(frame, cascade, points, normals, reach):
    """How much deeper a point's own plane lies at the texels of `_gaps_around` (m, k) [m].

    And its steepness (m,): the sum of its slopes along u and v [m/m].
    """
    cascades = frame.cascades
    size = frame.shadow_maps[cascade].shape[0]
    uvz = np.asarray(cascades.uvz_from_world[cascade])
    along = np.cross(uvz[1, :3], normals), np.cross(normals, uvz[0, :3])
    volume = along[0] @ uvz[0, :3]
    volume = np.where(np.abs(volume) > 1e-12 * np.abs(volume).max(initial=0.0), volume, np.inf)
    span = float(np.diff(cascades.depth_range[cascade])[0])
    # of one map's width [m]
    slopes = np.stack([step @ uvz[2, :3] for step in along], axis=1) / volume[:, None] * span
    away = transform_points(uvz, points)[:, :2] * size
    texels = _texels_around(away, size, reach) + 0.5
    own = np.einsum("mka,ma->mk", texels - away[:, None], slopes) / size
    steepness = np.abs(slopes).sum(axis=1) / (size * cascades.texel_size[cascade].max())
    return own, steepness


def _nan_min(values):
    return np.where(np.isnan(values), np.inf, values).min(axis=1)


def thin_share_of(frame):
    """Share of casters' texels before something else on both sides within two texels."""
    thin = casters = 0
    for i, depths in enumerate(frame.shadow_maps):
        if not (depths < 1.0).any():
            continue
        span = float(np.diff(frame.cascades.depth_range[i])[0])
        jump = 4.0 * float(frame.cascades.texel_size[i].max()) / span
        behind = np.zeros(depths.shape, bool)
        for axis in (0, 1):
            ahead = np.zeros(depths.shape, bool)
            after = np.zeros(depths.shape, bool)
            for step in range(1, THIN_TEXELS + 1):
                ahead |= np.roll(depths, step, axis) - depths > jump
                after |= np.roll(depths, -step, axis) - depths > jump
            behind |= ahead & after
            casters += 0.5 * np.count_nonzero(ahead | after)
        thin += np.count_nonzero(behind)
    return float(min(thin / casters, 1.0)) if casters else 0.0
