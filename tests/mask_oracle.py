"""What a mask must be, given the frame's own maps, depths and normals: every compare and every
choice of cascade of every pixel, in doubles (docs/numerics.md 11).

Shaders compute in float32. A compare or a texel that float32 may decide either way makes the answer
an interval: `lowest` counts every such compare as shadowed, `highest` as lit.
"""

from dataclasses import dataclass

import kernel_oracle
import numpy as np
import small_scenes

NO_CASCADE = 255
FACING = 1e-5
EPS = 2.0**-23
QUANTUM = {"d32f": 2.0**-24, "d24": 2.0**-24, "d16": 1 / 65535}
STEEPEST = 1e3  # tangent to the light beyond which a slope is not followed any further


@dataclass
class Bias:
    """What is subtracted from the receiver's depth, in texels of the larger side except `depth`."""

    receiver_plane: bool
    constant: float
    slope: float
    normal_offset: float
    depth: float  # of clip depth


def bias_of(settings):
    """`auto` by the filter, `manual` by the numbers."""
    if settings.bias == "manual":
        return Bias(
            settings.receiver_plane,
            settings.constant_bias_texels,
            settings.slope_bias,
            settings.normal_offset_texels,
            0.0,
        )
    quantum = QUANTUM[settings.depth_format]
    depth = 0.5 * quantum + 4.0 * 2.0**-24  # half a quantum and the rounding of the range
    if settings.filter == "pcf" and settings.filter_size == 2:
        return Bias(False, 0.0, 1.25, 0.0, depth)
    return Bias(True, 0.0, 0.25, 0.0, depth)


@dataclass
class Placed:
    """Receivers in the window of one cascade; arrays of one entry per receiver."""

    texel: np.ndarray  # (m, 2) u, v in texels
    depth: np.ndarray  # clip depth
    gradient: np.ndarray  # (m, 2) metres of light-view depth per metre along light x, y
    slope: np.ndarray  # (m, 2) clip depth per texel
    bias: np.ndarray  # clip depth
    texel_error: float  # what float32 may move `texel` by
    depth_error: float  # and `depth`
    compare_error: (
        np.ndarray
    )  # and a depth that is compared, at the centre of a texel of the kernel


@dataclass
class MaskOracle:
    """Intervals of the mask, and the cascades that may be taken; (m,) each."""

    lowest: np.ndarray
    highest: np.ndarray
    index: np.ndarray
    index_sure: np.ndarray


def receivers_of(frame):
    """(m, 3) positions and normals, (m,) view depths of the valid pixels, in row order."""
    return (
        small_scenes.positions_of(frame)[frame.valid],
        frame.normal[frame.valid].astype(np.float64),
        frame.view_depth[frame.valid].astype(np.float64),
    )


def kernel_radius(settings):
    """Texels from the point's own that are kept free around it."""
    size = settings.filter_size
    disc = (size + 1) // 2
    return {"pcf": size // 2, "poisson": disc, "pcss": disc}.get(settings.filter, 0)


def place(frame, i, positions, normals, scale):
    """Receivers in map i. `scale` [m] is the largest coordinate that float32 held on the way."""
    settings, cascades = frame.settings, frame.cascades
    bias = bias_of(settings)
    texel_size = cascades.texel_size[i]
    largest = texel_size.max()
    span = np.diff(cascades.depth_range[i])[0]
    light = cascades.light_from_world[i][:3, :3]
    normals_ls = normals @ np.linalg.inv(light)  # by the inverse transpose, for a skew
    cosine = np.maximum(normals_ls[:, 2], 1.0 / STEEPEST)
    gradient = normals_ls[:, :2] / cosine[:, None]
    sine = np.linalg.norm(np.cross(normals, frame.sun.to_light), axis=1)
    moved = positions + normals * (bias.normal_offset * largest * sine)[:, None]
    uvz = small_scenes.texels_of(cascades, i, moved)
    sides = largest if settings.bias == "manual" else texel_size
    metres = bias.constant * largest + bias.slope * (np.abs(gradient) * sides).sum(axis=1)
    slope = gradient * texel_size / span
    # Float32: some ten roundings of coordinates as large as `scale`; the normal's error, tilted
    # away from the light, turns into an error of the gradient; the range's own rounding.
    texel_error = 8.0 * EPS * scale / texel_size.min()
    depth_error = 8.0 * EPS * scale / span + 4.0 * EPS
    reach = (kernel_radius(settings) + 1.5 + bias.slope) * largest / span
    gradient_error = 8.0 * EPS * (1.0 + (gradient**2).sum(axis=1))
    compare_error = depth_error + np.abs(slope).sum(axis=1) * texel_error + gradient_error * reach
    return Placed(
        uvz[:, :2], uvz[:, 2], gradient, slope, metres / span + bias.depth,
        texel_error, depth_error, compare_error,
    )  # fmt: skip


def choose(frame, positions, normals, view_depth, scale):
    """(index, sure): the cascade of each receiver by the rule of `select`, and whether float32
    could not have chosen another."""
    cascades, settings = frame.cascades, frame.settings
    inner = cascades.splits[1:-1].astype(np.float32)
    by_interval = (view_depth[:, None] > inner).sum(axis=1)
    if settings.select == "interval":
        return by_interval, np.ones(len(positions), bool)
    index = np.full(len(positions), NO_CASCADE)
    sure = np.ones(len(positions), bool)
    # by frustum a kernel may reach over the rim
    padding = 0 if settings.select == "frustum" else kernel_radius(settings)
    for i in range(cascades.count):
        at = place(frame, i, positions, normals, scale)
        size = cascades.map_size[i]
        inside = np.minimum(at.texel - padding, size - padding - at.texel).min(axis=1)
        depth = small_scenes.texels_of(cascades, i, positions)[:, 2]  # of the surface itself
        in_range = np.minimum(depth, 1.0 - depth)
        taken = (inside >= 0.0) & (in_range >= 0.0)
        near = (np.abs(inside) <= at.texel_error) | (np.abs(in_range) <= at.depth_error)
        undecided = index == NO_CASCADE
        sure &= ~(undecided & near)
        index[undecided & taken] = i
    return index, sure


def visibility(frame, i, positions, normals, scale, seen=None):
    """(lowest, highest) visibility of receivers looked up in map i, facing left out. `seen` is
    needed by kernels that depend on the pixel."""
    settings = frame.settings
    at = place(frame, i, positions, normals, scale)
    stored = frame.shadow_maps[i].astype(np.float64)
    if settings.filter == "pcf" and settings.filter_size == 2:
        return _bilinear(at, stored)
    if seen is None:
        seen = kernel_oracle.Seen(np.zeros(len(positions)), np.zeros(len(positions)))
    plane = bias_of(settings).receiver_plane
    lit, total = np.zeros((2, len(positions))), np.zeros(len(positions))
    for texel, weight, sure in kernel_oracle.taps(frame, i, at.texel, seen, at.texel_error):
        # beyond the rim the nearest texel inside is taken again
        texel = np.clip(texel, 0, len(stored) - 1)
        depth = at.depth - at.bias
        if plane:
            depth = depth + (at.slope * (texel + 0.5 - at.texel)).sum(axis=1)
        answer = _compare(depth, _fetch(stored, texel), at.compare_error)
        lit += weight * np.where(sure, answer, [[0.0], [1.0]])
        total += weight
    lit /= total
    if settings.filter == "pcf" and (settings.filter_weights, settings.kernel) != ("box", "texels"):
        # Weights go with the point and the width, but one answer of all has no weight to share.
        mixed = (lit > 0.0) & (lit < 1.0)
        lit += np.array([[-1.0], [1.0]]) * mixed * (8.0 * at.texel_error + 1e-5)
    # Where the point may lie in the next texel, the whole kernel may.
    near_edge = (np.abs(at.texel - np.round(at.texel)) <= at.texel_error).any(axis=1)
    if settings.filter != "poisson":
        lit[0, near_edge], lit[1, near_edge] = 0.0, 1.0
    return np.clip(lit, 0.0, 1.0)


def _fetch(stored, texel):
    u, v = np.clip(texel, 0, len(stored) - 1).astype(int).T
    return stored[v, u]


def _compare(depth, stored, error):
    """(2, m) lowest and highest answer of a compare; an empty texel holds 1 and shadows nothing."""
    depth = np.minimum(depth, 1.0)
    return np.stack([depth + error <= stored, depth - error <= stored]) | (stored == 1.0)


def _bilinear(at, stored):
    """Mean of the 2 x 2 texels around the point with weights by distance; hardware holds the
    weights' fractions to 8 bits."""
    corner = np.floor(at.texel - 0.5)
    fraction = at.texel - 0.5 - corner
    lit = np.zeros((2, len(at.depth)))
    for dv in (0, 1):
        for du in (0, 1):
            weight = np.abs(1 - du - fraction[:, 0]) * np.abs(1 - dv - fraction[:, 1])
            stored_there = _fetch(stored, corner + np.array([du, dv]))
            answer = _compare(at.depth - at.bias, stored_there, at.compare_error)
            lit += weight * answer
    steps = 2.0 * (2.0**-8 + at.texel_error)
    return np.clip(np.stack([lit[0] - steps, lit[1] + steps]), 0.0, 1.0)


def evaluate(frame):
    """The oracle's answer for every valid pixel of a frame with mask, normals, depths and maps."""
    positions, normals, view_depth = receivers_of(frame)
    origin_scale = np.ptp(small_scenes.positions_of(frame)[frame.valid], axis=0).max()
    scale = max(origin_scale, float(np.abs(positions).max()), float(view_depth.max()))
    index, index_sure = choose(frame, positions, normals, view_depth, scale)
    lowest, highest = np.ones(len(index)), np.ones(len(index))
    seen = kernel_oracle.seen_of(frame)
    for i in range(frame.cascades.count):
        own = index == i
        pixels = kernel_oracle.Seen(seen.view_depth[own], seen.lot[own])
        lowest[own], highest[own] = visibility(
            frame, i, positions[own], normals[own], scale, pixels
        )
    facing = normals @ frame.sun.to_light
    lowest[facing <= FACING + EPS] = 0.0
    highest[facing <= FACING - EPS] = 0.0
    return MaskOracle(lowest, highest, index, index_sure)
