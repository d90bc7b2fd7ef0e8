"""Which texels of a shadow map a filter averages, and how much each counts.

The same rules as the shaders (docs/numerics.md 27, 28 and 32), in doubles, for judging: what an
exact map would give under this filter is what the filter itself changes.
"""

import re
from functools import cache
from importlib import resources

import numpy as np

from .disc import GOLDEN_ANGLE

__all__ = ["half_widths", "kernel_of", "pixel_lots", "taps_of"]

PREFILTERED = ("vsm", "evsm2", "evsm4", "esm", "msm", "lvsm", "fourier")


def half_widths(frame, cascade, view_depth):
    """Half widths of the kernel along u and v.

    Parameters
    ----------
    frame : Frame
        Its `cascades`, `camera` and `settings`, which are canonical.
    cascade : int
    view_depth : (m,) float64
        [m].

    Returns
    -------
    half : (m, 2) float64
        [texels].
    """
    settings, camera = frame.settings, frame.camera
    most = 0.5 * settings.filter_size
    ones = np.ones((len(view_depth), 2))
    if settings.kernel == "texels":
        return most * ones
    texel = np.asarray(frame.cascades.texel_size)
    metres = most * texel[0].min()
    if settings.kernel == "screen":
        pixel = 2.0 * camera.half_height / camera.size[1]
        metres = most * pixel * (1.0 if camera.orthographic else view_depth[:, None])
    least = min(0.5 if settings.filter_weights == "box" else 1.0, most)
    return np.clip(metres / texel[cascade] * ones, least, most)


def kernel_of(settings):
    """What `taps_of` and `half_widths` ask of settings: equal ones average the same texels.

    Parameters
    ----------
    settings : ShadowSettings
        Canonical.

    Returns
    -------
    kernel : tuple
    """
    kind = "prefiltered" if settings.filter in PREFILTERED else settings.filter
    names = ("filter_size", "filter_weights", "kernel", "disc", "tap_count", "rotated")
    return (kind, *(getattr(settings, name) for name in names))


def taps_of(settings, fraction, half, lot):
    """Texels that a filter averages around points.

    Parameters
    ----------
    settings : ShadowSettings
        Canonical.
    fraction : (m, 2) float64
        Where in its texel each point lies, 0 to 1.
    half : (m, 2) float64
        Half widths of the kernel [texels].
    lot : (m,) float64
        By which a disc is turned, 0 to 1.

    Returns
    -------
    taps : list of ((m, 2) int, (m,) float64)
        Texels from the one that holds each point, and their weights, which add up to 1; None where
        the footprint is that of the sun's disc and not of the map.
    """
    if settings.filter == "hard":
        return [(np.zeros(fraction.shape, int), np.ones(len(fraction)))]
    if settings.filter == "pcss":
        return None
    if settings.filter == "poisson":
        return _disc_taps(settings, fraction, half, lot)
    if settings.filter == "pcf" and settings.filter_size == 2:
        offsets = np.arange(-1, 2)
        return _square(offsets, *(_bilinear(offsets, part) for part in fraction.T))
    reach = int(np.ceil(half.max())) + 1
    offsets = np.arange(-reach, reach + 1)
    axes = zip(fraction.T, half.T, strict=True)
    if settings.filter in PREFILTERED:
        weights = [_blurred_lookup(settings, offsets, f, h) for f, h in axes]
    elif settings.filter == "savsm":
        weights = [_covered(offsets, f, h) for f, h in axes]
    else:
        weights = [_kernel(settings, offsets, f, h) for f, h in axes]
    return _square(offsets, *weights)


def _square(offsets, across, along):
    """Products of the weights (m, n) along both axes; texels that nobody looks at are left out."""
    taps = []
    for i, du in enumerate(offsets):
        for j, dv in enumerate(offsets):
            weight = across[:, i] * along[:, j]
            if weight.any():
                taps.append((np.broadcast_to((du, dv), (len(weight), 2)), weight))
    return taps


def _scaled(weights):
    return weights / weights.sum(axis=1, keepdims=True)


def _kernel(settings, offsets, fraction, half):
    """Weights (m, n) of pcf along one axis."""
    half = half[:, None]
    if settings.filter_weights == "box":  # around the texel that holds the point
        weights = np.clip(half + 0.5 - np.abs(offsets)[None, :], 0.0, 1.0)
        return _scaled(np.broadcast_to(weights, (len(fraction), len(offsets))))
    away = np.abs(offsets[None, :] + 0.5 - fraction[:, None])
    if settings.filter_weights == "bilinear":
        return _scaled(np.clip(half - away, 0.0, 1.0))
    if settings.filter_weights == "tent":
        return _scaled(np.maximum(half - away, 0.0))
    return _scaled(np.maximum(np.exp(-2.0 * (away / half) ** 2) - np.exp(-2.0), 0.0))


def _covered(offsets, fraction, half):
    """Share (m, n) of each texel under a window round the point."""
    low, high = fraction[:, None] - half[:, None], fraction[:, None] + half[:, None]
    inside = np.minimum(offsets[None, :] + 1, high) - np.maximum(offsets[None, :], low)
    return _scaled(np.maximum(inside, 0.0))


def _bilinear(offsets, fraction):
    """Weights (m, n) of a lookup between texel centres."""
    return np.maximum(1.0 - np.abs(offsets[None, :] + 0.5 - fraction[:, None]), 0.0)


def _blurred_lookup(settings, offsets, fraction, half):
    """Weights (m, n) of a lookup between texels of a blurred map: a blur is the texels' own."""
    blur = _kernel(settings, offsets, np.array([0.5]), half[:1])[0]
    lookup = _bilinear(np.arange(-1, 2), fraction)
    weights = np.zeros((len(fraction), len(offsets)))
    for shift in (-1, 0, 1):
        moved = np.roll(blur, shift)
        moved[-1 if shift < 0 else 0] *= shift == 0
        weights += lookup[:, shift + 1, None] * moved
    return _scaled(weights)


@cache
def _poisson_disc(count):
    """(n, 2) places in the unit disc: those of the shader, which alone has them."""
    text = resources.files("csm.shaders").joinpath("include/disc.glsl").read_text("utf-8")
    table = text.split(f"poisson_disc[{count}] = vec2[](")[1].split(");")[0]
    pairs = re.findall(r"vec2\((-?[\d.]+), (-?[\d.]+)\)", table + ")")
    return np.array(pairs, float)


def _disc_taps(settings, fraction, half, lot):
    count = settings.tap_count
    if settings.disc == "poisson":
        disc = _poisson_disc(count)
    else:
        number = np.arange(count)
        radius, angle = np.sqrt((number + 0.5) / count), number * GOLDEN_ANGLE
        disc = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    turn = 2.0 * np.pi * lot * settings.rotated
    cosine, sine = np.cos(turn), np.sin(turn)
    weight = np.full(len(fraction), 1.0 / count)
    taps = []
    for x, y in disc:
        away = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
        taps.append((np.floor(fraction + half * away).astype(int), weight))
    return taps


def pixel_lots(shape):
    """Interleaved gradient noise of every pixel, as shaders draw it.

    Parameters
    ----------
    shape : (int, int)
        Height and width; row 0 is on top.

    Returns
    -------
    lots : (h, w) float64
        0 to 1.

    References
    ----------
    .. [Jimenez2014] Jimenez: Next generation post processing in Call of Duty: Advanced Warfare.
       SIGGRAPH 2014 course.
    """
    height, width = shape
    y, x = np.mgrid[height - 1 : -1 : -1, 0:width].astype(np.float32)
    inner = np.float32(0.06711056) * x + np.float32(0.00583715) * y
    return np.mod(np.float32(52.9829189) * np.mod(inner, np.float32(1)), np.float32(1)).astype(
        float
    )
