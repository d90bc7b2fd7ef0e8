"""Which texels of a shadow map a filter averages, and how much each counts.

The same rules as the shaders (docs/numerics.md 26 to 28), in doubles, for judging: what an exact
map would give under this filter is what the filter itself changes.
"""

from dataclasses import dataclass

import numpy as np

__all__ = ["Footprint", "footprint_of"]

PREFILTERED = ("vsm", "evsm2", "evsm4", "esm", "msm", "lvsm", "fourier")


@dataclass(frozen=True)
class Footprint:
    """Texels around the one that holds each of m points, the same along both axes.

    Attributes
    ----------
    offsets : (n,) int
        Texels from the one that holds the point.
    across, along : (m, n) float64
        Weights along u and v, each with sum 1; a texel counts their product.
    """

    offsets: np.ndarray
    across: np.ndarray
    along: np.ndarray


def kernel_weights(settings, offsets, fraction, half_width):
    """Weights (m, n) along one axis of a kernel of a half width [texels], scaled to sum 1."""
    away = offsets[None, :] + 0.5 - fraction[:, None]
    half_width = np.broadcast_to(half_width, fraction.shape)[:, None]
    if settings.filter_weights == "box":
        weights = np.clip(half_width + 0.5 - np.abs(offsets)[None, :], 0.0, 1.0)
        weights = np.broadcast_to(weights, away.shape)
    elif settings.filter_weights == "bilinear":
        weights = np.clip(half_width - np.abs(away), 0.0, 1.0)
    elif settings.filter_weights == "tent":
        weights = np.maximum(half_width - np.abs(away), 0.0)
    else:
        inside = np.abs(away) < half_width + 0.5
        weights = np.where(inside, np.exp(-2.0 * (away / half_width) ** 2), 0.0)
    return weights / weights.sum(axis=1, keepdims=True)


def footprint_of(settings, fraction, half_width):
    """Texels that a filter averages around points.

    Parameters
    ----------
    settings : ShadowSettings
        Canonical.
    fraction : (m, 2) float64
        Where in its texel each point lies, 0 to 1.
    half_width : float or (m,) float64
        Of the kernel [texels].

    Returns
    -------
    footprint : Footprint or None
        None where the filter's footprint is no rectangle of texels.
    """
    if settings.filter == "hard":
        one = np.ones((len(fraction), 1))
        return Footprint(np.zeros(1, int), one, one)
    if settings.filter == "pcf" and settings.filter_size == 2:
        offsets = np.arange(-1, 2)
        return Footprint(offsets, *(_bilinear(offsets, part) for part in fraction.T))
    if settings.filter == "pcf":
        radius = settings.filter_size // 2
        offsets = np.arange(-radius, radius + 1)
        return Footprint(
            offsets, *(kernel_weights(settings, offsets, part, half_width) for part in fraction.T)
        )
    if settings.filter in PREFILTERED:
        radius = int(np.max(half_width))
        offsets = np.arange(-radius - 1, radius + 2)
        blur = kernel_weights(
            settings, np.arange(-radius, radius + 1), np.array([0.5]), half_width
        )[0]
        return Footprint(offsets, *(_blurred_lookup(offsets, blur, part) for part in fraction.T))
    return None


def _bilinear(offsets, fraction):
    """Weights (m, n) of a lookup between texel centres."""
    return np.maximum(1.0 - np.abs(offsets[None, :] + 0.5 - fraction[:, None]), 0.0)


def _blurred_lookup(offsets, blur, fraction):
    """Weights (m, n) of a bilinear lookup in a blurred map."""
    lookup = _bilinear(np.arange(-1, 2), fraction)
    weights = np.zeros((len(fraction), len(offsets)))
    for shift in range(3):
        weights[:, shift : shift + len(blur)] += lookup[:, shift, None] * blur
    return weights
