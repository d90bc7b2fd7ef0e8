"""Texels that a filter compares for each receiver and how much each counts, in doubles: weights as
areas and densities, discs from the script that made them, noise from its own formula
(docs/numerics.md 32)."""

from dataclasses import dataclass

import numpy as np

from scripts import poisson_discs

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


@dataclass
class Seen:
    """What of a pixel decides its kernel besides its place; (m,) each."""

    view_depth: np.ndarray
    lot: np.ndarray  # 0 to 1


def seen_of(frame):
    """Of the valid pixels, in row order."""
    rows, columns = np.nonzero(frame.valid)
    from_below = frame.valid.shape[0] - 1 - rows
    lot = gradient_noise(columns, from_below)
    return Seen(frame.view_depth[frame.valid].astype(np.float64), lot)


def gradient_noise(x, y):
    """[Jimenez2014] in float32, as pixels draw it."""
    inner = np.float32(0.06711056) * x.astype(np.float32)
    inner += np.float32(0.00583715) * y.astype(np.float32)
    return np.mod(np.float32(52.9829189) * np.mod(inner, np.float32(1.0)), np.float32(1.0))


def half_widths(frame, i, view_depth):
    """(m, 2) half widths of the kernel in texels of map i."""
    settings, cascades, camera = frame.settings, frame.cascades, frame.camera
    most = 0.5 * settings.filter_size
    ones = np.ones((len(view_depth), 2))
    if settings.kernel == "texels" or (settings.kernel == "world" and cascades.count == 1):
        return most * ones
    pixel = 2.0 * camera.half_height / camera.size[1] * ones
    if not camera.orthographic:
        pixel *= view_depth[:, None]
    metres = most * (pixel if settings.kernel == "screen" else cascades.texel_size[0].min())
    centred = settings.filter == "pcf" and settings.filter_weights != "box"
    return np.clip(metres / cascades.texel_size[i] * ones, 1.0 if centred else 0.5, most)


def taps(frame, i, texel, seen, texel_error):
    """Yields ((m, 2) texels, (m,) weights, (m,) bool whether float32 is sure of the texel)."""
    settings = frame.settings
    if settings.filter == "poisson":
        yield from _disc_taps(settings, texel, half_widths(frame, i, seen.view_depth), seen.lot,
                              texel_error)  # fmt: skip
        return
    # hard compares; under a point sun so are those of pcss
    radius = settings.filter_size // 2 if settings.filter == "pcf" else 0
    assert radius or settings.filter == "hard" or frame.sun.angular_diameter_deg == 0.0
    own = np.floor(texel)
    sure = np.ones(len(texel), bool)
    half = half_widths(frame, i, seen.view_depth) if radius else np.full(texel.shape, 0.5)
    for dv in range(-radius, radius + 1):
        for du in range(-radius, radius + 1):
            there = own + np.array([du, dv])
            weights = _weights(settings.filter_weights if radius else "box", there, texel, half)
            yield there, weights.prod(axis=1), sure


def _weights(name, there, point, half):
    """(m, 2) weights along both axes of texels of unit side."""
    if name == "box":  # the part of the texel under a window round the point's own texel
        point = np.floor(point) + 0.5
        return np.maximum(np.minimum(there + 1, point + half) - np.maximum(there, point - half), 0)
    if name == "bilinear":  # a window round the point, narrower by a texel
        high = np.minimum(there + 1, point + half - 0.5)
        return np.maximum(high - np.maximum(there, point - half + 0.5), 0.0)
    away = there + 0.5 - point
    if name == "tent":
        return np.maximum(half - np.abs(away), 0.0)
    sigma = 0.5 * half
    return np.maximum(np.exp(-0.5 * (away / sigma) ** 2) - np.exp(-2.0), 0.0)


def disc(settings):
    """(n, 2) places in the unit disc."""
    count = settings.tap_count
    if settings.disc == "poisson":
        return poisson_discs.disc(count)
    number = np.arange(count)
    radius, angle = np.sqrt((number + 0.5) / count), number * GOLDEN_ANGLE
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _disc_taps(settings, texel, half, lot, texel_error):
    angle = 2.0 * np.pi * lot.astype(np.float64) * settings.rotated
    cosine, sine = np.cos(angle), np.sin(angle)
    # A lot is a fraction of numbers up to 53 in float32: 4e-6; as an angle 3e-5 of the radius.
    slack = texel_error + 1e-4 * half
    for x, y in disc(settings):
        away = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
        place = texel + half * away
        sure = (np.abs(place - np.round(place)) > slack).all(axis=1)
        yield np.floor(place), np.ones(len(texel)), sure
