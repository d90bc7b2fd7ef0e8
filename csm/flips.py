"""How answers of `csm.decisions.TABLE` are turned round: other settings, as changes."""

import math

import numpy as np

from .arrangements import USUAL
from .map_shares import equal_side, size_parts, unequal_sizes
from .settings import map_sizes, map_texels
from .situations import COUNTS, TAPS, is_default_split, several, wanted_size

__all__ = [
    "equal_maps",
    "equal_memory",
    "fewer",
    "half_size",
    "nearest_faces",
    "other_filter",
    "other_split",
    "other_warp",
    "resized",
]


def equal_memory(at):
    """Two maps of as many texels as one."""
    side = int(map_sizes(at.settings)[0] / np.sqrt(2.0))
    return {"cascade_count": 2, "map_size": max(side, 1)}


def fewer(at):
    """The next smaller number of maps that is considered."""
    return _rearranged(at, cascade_count=max(n for n in COUNTS if n < at.settings.cascade_count))


def _rearranged(at, **changes):
    """Changes, and, of unequal maps, as many texels shared out anew among the other windows."""
    settings = at.settings
    if not isinstance(settings.map_size, tuple):
        return changes
    texels = map_texels(settings)
    other = settings.replace(**changes, map_size=USUAL, storage="array")
    parts = None
    if other.cascade_count > 1:
        parts = size_parts(other, at.forecaster, at.model)
    if parts is None:
        side = round(math.sqrt(texels / other.cascade_count))
        return {**changes, "map_size": side, "storage": "array"}
    sides = unequal_sizes(parts, math.sqrt(texels / np.square(parts).sum()))
    return {**changes, "map_size": tuple(sides.tolist())}


def equal_maps(at):
    """Of maps of unequal sizes: equal ones that miss as much; else textures of their own."""
    if not isinstance(at.settings.map_size, tuple):
        return {"storage": "separate"}
    side = equal_side(at.settings, at.forecaster) or max(at.settings.map_size)
    return {"storage": "array", "map_size": math.ceil(side)}


def half_size(at):
    """Maps of half the side."""
    return resized(at, 0.5)


def resized(at, factor):
    """Maps of a multiple of their sides."""
    size = at.settings.map_size
    # a kernel must fit
    least = at.settings.filter_size + 2 if at.settings.filter == "pcss" else 1
    sides = [max(least, int(factor * side)) for side in np.ravel(size)]
    return {"map_size": tuple(sides) if isinstance(size, tuple) else sides[0]}


def nearest_faces(signals):
    """Of front and back sides alone those that change fewer pixels."""
    return "front" if signals.front_matters <= signals.faces_matter else "back"


def other_warp(at):
    """A warp for none, none for a warp: the word alone."""
    return "lispsm" if at.settings.warp == "none" else "none"


def other_split(at):
    """Turn the answer about splits.

    None where the camera's near allows no other scheme, and of one window round what is seen,
    which any scheme leaves where it is.
    """
    if not several(at) and at.settings.fit == "visible":
        return None
    if any(view.camera.near <= 0.0 for view in at.signals.views):
        return None
    if is_default_split(at.settings):
        return _rearranged(at, split="sdsm")
    return _rearranged(at, split="practical", lam=0.5)


def other_filter(at):
    """Turn the filter's answer: a hard one for a soft, a soft one for a hard."""
    if at.settings.filter not in ("hard", "none"):
        return {"filter": "hard"}
    if at.settings.filter == "none":
        return None
    if at.signals.views[0].sun.angular_diameter_deg > 0.0:
        return {"filter": "pcss", "filter_size": wanted_size(at), "tap_count": TAPS[-1]}
    return {"filter": "pcf", "filter_size": 3}
