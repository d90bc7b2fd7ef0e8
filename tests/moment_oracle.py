"""What prefiltered filters must store and answer, in doubles, written from the papers.

Moments: of depths in a frame's own `shadow_maps`, blurred by brute force with a two-dimensional
kernel. Answers: of receivers, from the frame's own `moments`. Where float32 or a format rounds, the
answer is an interval.

[Donnelly2006] variance, [Annen2008] exponential, [Lauritzen2008] exponential and layered variance.
"""

import math

import mask_oracle
import numpy as np

EPS = {"float32": 2.0**-24, "float16": 2.0**-10}  # of the number; 16 bits may be cut off
LARGEST = {"float32": 3.4028e38, "float16": 65504.0}
STEP = 1.0 / 65535.0
EXPONENTIAL = ("evsm2", "evsm4", "esm")


# -- kernels ---------------------------------------------------------------------------------------


def weights(kind, half_width):
    """Weights of the texels around one, -r to r, of sum 1."""
    reach = math.ceil(half_width + 0.5)
    away = np.abs(np.arange(-reach, reach + 1, dtype=np.float64))
    if kind == "box":  # what the window covers of each texel
        w = np.clip(np.minimum(half_width, away + 0.5) - (away - 0.5), 0.0, 1.0)
    elif kind == "bilinear":  # of each texel's tent, one texel to either side
        w = np.clip(half_width - away, 0.0, 1.0)
    elif kind == "tent":
        w = np.maximum(half_width - away, 0.0)
    else:  # two standard deviations to the end of the window, where it comes to nothing
        w = np.maximum(np.exp(-0.5 * (away / (0.5 * half_width)) ** 2) - np.exp(-2.0), 0.0)
    return w / w.sum()


def half_widths(frame, cascade):
    """Texels from the middle of a cascade's kernel to its end, along u and v."""
    settings, sides = frame.settings, frame.cascades.texel_size
    most = 0.5 * settings.filter_size
    if settings.kernel != "world":
        return np.full(2, most)
    least = 0.5 if settings.filter_weights == "box" else 1.0
    return np.clip(most * sides[0].min() / sides[cascade], min(least, most), most)


def blur(values, kind, halves):
    """(s, s, k) mean under the kernel round each texel; beyond the rim is the rim."""
    size = len(values)
    matrices = []
    for half in halves:
        w = weights(kind, half)
        reach = len(w) // 2
        at = np.clip(np.arange(size)[:, None] + np.arange(-reach, reach + 1), 0, size - 1)
        matrix = np.zeros((size, size))
        np.add.at(matrix, (np.arange(size)[:, None], at), w)
        matrices.append(matrix)
    across, along = matrices
    return np.stack([along @ channel @ across.T for channel in np.moveaxis(values, -1, 0)], axis=-1)


# -- numbers ---------------------------------------------------------------------------------------


def roundings(settings):
    """How often a moment is rounded: made, blurred along x and y, looked up."""
    return 2 + (2 if settings.filter_size > 1 else 0)


def exponents(settings):
    """Positive and negative; by default nine tenths of what the format holds."""
    positive = settings.exponent
    if not positive:
        largest = math.log(LARGEST[settings.moment_format])
        limit = largest if settings.filter == "esm" else largest / 2
        positive = 0.9 * math.floor(100 * limit) / 100
    return positive, settings.negative_exponent or positive


def rounding(settings):
    """Of a moment by its format: a share of the number, or of the range for unorm16."""
    if settings.moment_format == "unorm16":
        return 0.5 * STEP
    u = EPS[settings.moment_format]
    if settings.moment_format == "float16" and settings.filter.startswith("evsm"):
        u = max(u, 2.0**-24 / math.exp(-2.0 * max(exponents(settings))))  # subnormal squares
    return u


def least_variance(settings):
    """Of centred depths; of exponential warps a share of the square. m2 - m1^2 of numbers that are
    off by a share u of themselves: u m2 + 2 u m1^2."""
    u = rounding(settings) * roundings(settings)
    if settings.filter.startswith("evsm"):
        return 3.0 * u
    if settings.moment_format == "unorm16":  # m1 off by u, |m1| <= 1/2; m2 by u / 4
        return u + 0.25 * u
    return 3.0 * u * 0.25


def mean_rounding(settings):
    """Depth by which a stored mean may be off."""
    u = rounding(settings) * roundings(settings)
    if settings.filter == "lvsm":
        u *= min(2.0 / settings.layer_count, 1.0)
    if settings.moment_format == "unorm16":
        return u
    if settings.filter in EXPONENTIAL and not settings.log_filter:
        return u / ((1.0 if settings.filter == "esm" else 2.0) * min(exponents(settings)))
    return 0.5 * u


# -- moments ---------------------------------------------------------------------------------------


def layer_ends(settings, i):
    """Depths where layer i begins and ends: its part of the range and half a part either way."""
    count = settings.layer_count
    return max((i - 0.5) / count, 0.0), min((i + 1.5) / count, 1.0)


def layer(settings, depth, i):
    """Depth in layer i, 0 to 1."""
    begin, end = layer_ends(settings, i)
    return np.clip((depth - begin) / (end - begin), 0.0, 1.0)


def pair(settings, depth):
    """Stored moments of depths 0 to 1: centred depth and its square, as the format takes them."""
    c = depth - 0.5
    if settings.moment_format == "unorm16":
        return np.stack([depth, 4.0 * c * c], axis=-1)
    return np.stack([c, c * c], axis=-1)


def moments_of(settings, depth):
    """(..., k) what is stored of depths."""
    depth = np.asarray(depth, np.float64)
    positive, negative = exponents(settings) if settings.filter in EXPONENTIAL else (0.0, 0.0)
    if settings.filter == "vsm":
        return pair(settings, depth)
    if settings.filter == "lvsm":
        layers = [layer(settings, depth, i) for i in range(settings.layer_count)]
        return np.concatenate([pair(settings, each) for each in layers], axis=-1)
    if settings.filter == "esm":
        stored = pair(settings, depth)[..., :1]
        return stored if settings.log_filter else np.exp(positive * depth)[..., None]
    up, down = np.exp(positive * (2 * depth - 1)), -np.exp(-negative * (2 * depth - 1))
    channels = [up, up * up, down, down * down]
    return np.stack(channels[: 2 if settings.filter == "evsm2" else 4], axis=-1)


def blurred_moments(frame, cascade):
    """(s, s, k) moments of a frame's map of depths under its kernel."""
    settings = frame.settings
    half = half_widths(frame, cascade)
    depth = frame.shadow_maps[cascade].astype(np.float64)
    values = moments_of(settings, depth)
    if settings.filter_size == 1:
        return values
    if settings.log_filter:  # the logarithm of the mean of powers
        powers = np.exp(settings.exponent * (depth - 1.0))[..., None]
        mean = np.log(blur(powers, settings.filter_weights, half)) / settings.exponent + 1.0
        return pair(settings, mean[..., 0])[..., :1]
    return blur(values, settings.filter_weights, half)


# -- bounds ----------------------------------------------------------------------------------------


def chebyshev(depth, mean, square, least, scaled=False):
    """Largest share at or behind `depth` that a mean and a second moment allow; `least` is the
    variance that rounding alone may make, `scaled` as a share of the larger square."""
    depth, mean, square = (np.asarray(x, np.float64) for x in (depth, mean, square))
    if scaled:
        least = least * np.maximum(np.abs(depth), np.abs(mean)) ** 2
    variance = np.maximum(square - mean * mean, least)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = variance / (variance + (depth - mean) ** 2)
    return np.where(depth <= mean, 1.0, share)


def without_bleeding(settings, lit):
    step, power = settings.bleed_step, settings.bleed_power
    return np.clip((lit - step) / (1.0 - step), 0.0, 1.0) ** power


def _pair_share(settings, found, depth, extra):
    least = least_variance(settings)
    mean, square = found[..., 0], found[..., 1]
    if settings.moment_format == "unorm16":
        mean, square = mean - 0.5, 0.25 * square
    return chebyshev(depth - 0.5, mean, square + extra * 0.25, least)


def answer(settings, found, depth, lift=0.0, extra=0.0):
    """Visibility of receivers at `depth` with looked-up moments `found` (..., k).

    `lift`: what the receiver's plane adds to the exponent of evsm4's negative warp. `extra` is a
    share of the largest square, added to every second moment: how much float32 may lose there.
    """
    depth = np.asarray(depth, np.float64)
    if settings.filter == "vsm":
        lit = _pair_share(settings, found, depth, extra)
    elif settings.filter == "lvsm":
        own = np.clip((depth * settings.layer_count).astype(int), 0, settings.layer_count - 1)
        lit = np.zeros(np.broadcast_shapes(depth.shape, found.shape[:-1]))
        for i in range(settings.layer_count):
            here = _pair_share(
                settings, found[..., 2 * i : 2 * i + 2], layer(settings, depth, i), extra
            )
            lit = np.where(own == i, here, lit)
    elif settings.filter == "esm":
        power = np.log(np.maximum(found[..., 0], 1e-300)) - exponents(settings)[0] * depth
        return np.exp(np.minimum(power, 0.0))
    else:
        positive, negative = exponents(settings)
        least = least_variance(settings)
        up = np.exp(positive * (2 * depth - 1))
        square = found[..., 1] + extra * found[..., 0] ** 2
        lit = chebyshev(up, found[..., 0], square, least, scaled=True)
        if settings.filter == "evsm4":
            down = -np.exp(np.minimum(lift - negative * (2 * depth - 1), negative))
            square = found[..., 3] + extra * found[..., 2] ** 2
            lit = np.minimum(lit, chebyshev(down, found[..., 2], square, least, scaled=True))
    return without_bleeding(settings, lit)


def looked_up(moments, texels):
    """(m, k) bilinear mean of the four texels around places (m, 2) in texels, inside the map."""
    size = len(moments)
    place = np.clip(texels, 0.5, size - 0.5) - 0.5
    corner = np.clip(np.floor(place).astype(int), 0, max(size - 2, 0))
    share = place - corner
    total = 0.0
    for dv in (0, 1):
        for du in (0, 1):
            weight = np.abs(1 - du - share[:, 0]) * np.abs(1 - dv - share[:, 1])
            row, column = (np.minimum(corner[:, a] + d, size - 1) for a, d in ((1, dv), (0, du)))
            total = total + weight[:, None] * moments[row, column].astype(np.float64)
    return total


def plane_lift(settings, slope):
    """Logarithm of the mean of exp(-2 c z) over a plane of `slope` (m, 2) [depth per texel] under a
    box as wide as kernel and lookup, over its value in the middle."""
    a = 2.0 * exponents(settings)[1] * (settings.filter_size // 2 + 1) * np.abs(slope)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        exact = a + np.log(-np.expm1(-2.0 * a) / (2.0 * a))
    return np.where(a < 1e-3, a * a / 6.0, exact).sum(axis=-1)


def mask_interval(frame):
    """(lowest, highest) visibility of every valid pixel from the frame's own moments."""
    settings = frame.settings
    positions, normals, view_depth = mask_oracle.receivers_of(frame)
    scale = max(float(np.abs(positions).max()), float(view_depth.max()))
    index = frame.cascade_index[frame.valid]
    lowest, highest = np.ones(len(index)), np.ones(len(index))
    for i in range(frame.cascades.count):
        own = index == i
        if not own.any():
            continue
        at = mask_oracle.place(frame, i, positions[own], normals[own], scale)
        lift = 0.0
        if settings.filter == "evsm4" and settings.receiver_plane:
            lift = plane_lift(settings, at.slope)
        depth = at.depth - at.bias
        moments = frame.moments[i]
        if settings.log_filter:  # bilinear in powers of the depths that are stored
            offset = 0.0 if settings.moment_format == "unorm16" else 0.5
            moments = np.exp(settings.exponent * (moments.astype(np.float64) + offset))
        found = [
            looked_up(moments, at.texel + np.array([dx, dy]) * at.texel_error)
            for dx in (-1, 0, 1) for dy in (-1, 0, 1)
        ]  # fmt: skip
        # float32 evaluates m2 - m1^2: each, and the lookup, off by a few units of the square
        rounded = 8.0 * EPS["float32"] if settings.filter != "esm" else 0.0
        answers = [
            answer(settings, f, depth + sign * at.compare_error, lift, extra)
            for f in found for sign in (-1, 0, 1) for extra in (-rounded, rounded)
        ]  # fmt: skip
        lowest[own], highest[own] = np.min(answers, axis=0), np.max(answers, axis=0)
    facing = normals @ frame.sun.to_light
    lowest[facing <= mask_oracle.FACING + mask_oracle.EPS] = 0.0
    highest[facing <= mask_oracle.FACING - mask_oracle.EPS] = 0.0
    return lowest, highest
