"""What settings can be expected to get wrong, from signals alone: no render."""

import math
from dataclasses import dataclass, fields
from functools import cached_property
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from . import _core
from .arrangements import FARTHEST, USUAL, Arranged, narrowest
from .caster_sides import FACES_SHARE, wanted_faces
from .settings import MANUAL_BIASES, ShadowSettings, changed, map_sizes

__all__ = ["Expected", "Forecaster", "Missed", "check_known", "rest_of", "sides_of"]

# A disc's penumbra of width w differs from a hard edge by 2 w / (3 pi) pixels a pixel of edge.
DISC = 2.0 / (3.0 * math.pi)
# Of what hard edges miss of a penumbra, what percentage-closer soft shadows of 16 taps still miss,
# and what those of 8 taps miss more: measured.
SOFT_REST, SOFT_FEW = 0.2, 0.08
# An edge cannot be softer than its shadow is wide, either: pixels at which penumbrae end.
WIDEST = 64.0
# Of soft shadows [texels].
LARGEST_KERNEL = 65
# Measured over forecast errors: of broad casters, and what thin ones add, whose shadows a quarter
# of the picture does not resolve and a coarse map loses altogether.
EDGE_FACTOR, THIN_FACTOR = 0.7, 2.0
# Of maps of unequal sizes measured over forecast errors, beside equal ones of the same forecast: of
# 75 real and made views equal ones were better by 1.7 % (median; quartiles -6 and +1 %). Edges that
# are far away are not all seen in the coarse picture.
UNEQUAL = 1.03


#: Fields of settings that move no window; the selection only says which of them answers.
WITHOUT_WINDOWS = {
    "map_size", "storage", "depth_format", "filter", "filter_size", "tap_count", "disc",
    "caster_faces", "cull", "select",
}  # fmt: skip
#: Of those, what windows are fitted with.
SUPPOSED = {"map_size": USUAL, "storage": "array", "depth_format": "d32f", "filter": "hard"}


@dataclass(frozen=True)
class Expected:
    """What settings are expected to get wrong; shares of the pixels that face the sun.

    Attributes
    ----------
    error : float, or (k,) float64
        As ``max_error`` counts it; of so many sizes of maps, if so many were asked about.
    held : float, or (k,) float64
        The same under a kernel that holds all penumbrae.
    left_out : float, or (k,) float64
        Of penumbrae, by a kernel that does not.
    """

    error: float
    held: float
    left_out: float


#: What is forecast, setting by setting; others change errors or costs by what no signal tells.
KNOWN = (
    ("filter", "none, hard or pcss", lambda s: s.filter in ("none", "hard", "pcss")),
    ("pcss_map", "depth", lambda s: s.pcss_map == "depth"),
    (
        "bias",
        "auto, or manual without any where caster_faces is back",
        lambda s: (
            s.bias == "auto"
            or (s.caster_faces == "back" and not any(getattr(s, name) for name in MANUAL_BIASES))
        ),
    ),
    ("plane", "normal", lambda s: s.plane == "normal"),
    ("depth_range", "anything but manual", lambda s: s.depth_range != "manual"),
    ("max_distance", "0", lambda s: s.max_distance == 0.0),
    ("fade_width", "0", lambda s: s.fade_width == 0.0),
    ("sun_step_deg", "0", lambda s: s.sun_step_deg == 0.0),
)


def check_known(settings):
    """Refuse settings of which no error is forecast.

    Parameters
    ----------
    settings : ShadowSettings

    Raises
    ------
    ValueError
        Naming the first of them, its value and what is forecast.
    """
    own = settings.canonical()  # what means nothing beside the others is as it is by default
    for name, allowed, known in KNOWN:
        if not known(own):
            raise ValueError(
                f"settings.{name} must be {allowed} to be forecast (got {getattr(own, name)!r})"
            )


class Missed(NamedTuple):
    """What `Forecaster.aliasing`, `leak` and `left_out` say of settings, or of several (k,)."""

    aliasing: float
    leak: float
    left_out: float


class Forecaster:
    """Expected errors of settings for one scene, camera and sun.

    Windows are fitted once for each arrangement of them; other map sizes only scale their texels.
    So wherever a map's size is asked for, sizes (k,) may be given instead of settings of so many
    sizes, or (k, n) of n maps each, and the answer is as many.

    Parameters
    ----------
    signals : Signals
    scene : Scene
    """

    def __init__(self, signals, scene):
        self.signals, self._scene, self._known = signals, scene, {}
        self._wanted, self._loads = {}, {}
        self._keys, self._numbers = {}, {}
        self._soft = self._wide = None

    def aliasing(self, settings, map_size=None, filter_size=None):
        """Expected share of facing pixels on the wrong side because texels have a size.

        Within half a texel along u and v a point is judged by its texel's centre, which displaces
        an edge by the mean of ``|a . d|`` over that square, a being the edge's direction taken back
        to texels: ``max / 4 + min² / (12 max)`` of ``|a_u|`` and ``|a_v|``. Lengths times
        displacements, over the pixels that face the sun; see docs/numerics.md 13.

        Parameters
        ----------
        settings : ShadowSettings
        map_size, filter_size : int, (k,) or, of maps, (k, n) int, optional
            Of all maps, and of the kernel, instead of those of the settings.

        Returns
        -------
        share : float, or (k,) float64
            0 without edges.
        """
        sides = _inside(settings, sides_of(settings, map_size), filter_size)
        return self._aliasing(settings, sides, _unequal(settings, map_size))

    def _aliasing(self, settings, sides, unequal):
        area, pixels = 0.0, self._facing
        for number, view in enumerate(self.signals.views):
            if len(view.edges):
                known = self._taken(number, settings)
                area = area + _core.sum_capped(
                    known.edge_cascade, sides, known.moved, view.edge_lengths, FARTHEST
                )
        factor = EDGE_FACTOR + THIN_FACTOR * self.signals.thin_share
        factor *= UNEQUAL if unequal else 1.0
        return factor / pixels * area if pixels else 0.0

    def error(self, settings, map_size=None):
        """Expected error, as ``max_error`` counts it: texels, and what a filter makes of penumbrae.

        Parameters
        ----------
        settings : ShadowSettings
        map_size : int, (k,) or (k, n) int, optional
            Of all maps, instead of that of the settings.

        Returns
        -------
        share : float, or (k,) float64
        """
        return self.expected(settings, map_size).error

    def expected(self, settings, map_size=None, filter_size=None):
        """Expected error, and what the kernel of soft shadows has to do with it.

        Parameters
        ----------
        settings : ShadowSettings
        map_size, filter_size : int, (k,) or, of maps, (k, n) int, optional
            Of all maps, and of the kernel, instead of those of the settings.

        Returns
        -------
        expected : Expected
        """
        if settings.filter == "none":
            dark = float(self.signals.shadowed_share)
            return Expected(dark, dark, 0.0)
        told = self.together(self.missed(settings, map_size, filter_size), rest_of(settings))
        more = self.changed_by_sides(settings)
        return Expected(np.minimum(told.error + more, 1.0), told.held + more, told.left_out)

    def changed_by_sides(self, settings):
        """What casting by other sides than those that are wanted changes, and no bias under them.

        Parameters
        ----------
        settings : ShadowSettings

        Returns
        -------
        share : float
            Of the facing pixels, as coarse pictures have shown it; 0 where none did.
        """
        told, faces, share = self.signals, settings.caster_faces, 0.0
        measured = {"both": 0.0, "front": told.front_matters, "back": told.faces_matter}[faces]
        if faces != wanted_faces(told) and measured < 1.0:  # 1: it was not asked
            share += measured
        if faces == "back" and settings.bias == "manual" and told.bias_matters > FACES_SHARE:
            share += told.bias_matters
        return share

    def together(self, missed, rest):
        """Errors of what is missed, under filters that leave a rest of penumbrae.

        Parameters
        ----------
        missed : Missed
        rest : float or (k,) float64
            From `rest_of`.

        Returns
        -------
        expected : Expected
        """
        aliasing, leak, left = missed
        held = np.hypot(aliasing, self._softness(rest, 0.0)) + leak
        error = np.hypot(aliasing, self._softness(rest, left)) + leak
        return Expected(np.minimum(error, 1.0), held, left)

    def missed(self, settings, map_size=None, filter_size=None):
        """What is missed however many taps there are: the three of them at once.

        Parameters
        ----------
        settings : ShadowSettings
        map_size, filter_size : int, (k,) or, of maps, (k, n) int, optional
            Of all maps, and of the kernel, instead of those of the settings.

        Returns
        -------
        missed : Missed
        """
        sides = _inside(settings, sides_of(settings, map_size), filter_size)
        soft = settings.filter == "pcss"
        return Missed(
            self._aliasing(settings, sides, _unequal(settings, map_size)),
            self._leak(settings, sides),
            self._left_out(settings, sides, filter_size) if soft else 0.0,
        )

    def softness(self, settings):
        """Mean absolute error of penumbrae under the filter of the settings.

        Parameters
        ----------
        settings : ShadowSettings

        Returns
        -------
        share : float
            `penumbra` under hard edges.
        """
        if settings.filter != "pcss":
            return self.penumbra()
        return self._softness(rest_of(settings), self.left_out(settings))

    def _softness(self, rest, left):
        return rest * (self.penumbra() - left) + left

    def left_out(self, settings, map_size=None, filter_size=None):
        """Mean absolute error of penumbrae that are as wide as a kernel can make them.

        A kernel of k texels t makes none wider than k t. A ramp of that width lies between the step
        and the ramp of width w, so that what it misses is what the step misses, less what a step
        would miss of k t: ``2 (w - k t) / (3 pi)``.

        Parameters
        ----------
        settings : ShadowSettings
        map_size : int, (k,) or (k, n) int, optional
            Of all maps, instead of that of the settings.
        filter_size : int or (k,) int, optional
            Side of the kernel [texels], likewise.

        Returns
        -------
        share : float, or (k,) float64
            0 where the kernel is as wide as all penumbrae, `penumbra` where it is nothing.
        """
        sides = _inside(settings, sides_of(settings, map_size), filter_size)
        return self._left_out(settings, sides, filter_size)

    def _left_out(self, settings, sides, filter_size):
        area, pixels = 0.0, self._facing
        # a part q of the map reaches q times as far as all of it
        parts = sides / _column(settings.filter_size if filter_size is None else filter_size)
        for number, view in enumerate(self.signals.views):
            if len(view.edges):
                known, wide = self._taken(number, settings), self._penumbrae()[number]
                area = area + _core.sum_missing(
                    known.edge_cascade, parts, known.reach, wide, view.edge_lengths
                )
        return DISC / pixels * area if pixels else 0.0

    def kernel(self, settings, map_size):
        """Least kernel that holds the penumbrae.

        Parameters
        ----------
        settings : ShadowSettings
        map_size : int, (k,) or (k, n) int
            Of all maps.

        Returns
        -------
        side : int or (k,) int
            Odd, 5 to 65 texels; what leaves out a twentieth of what hard edges miss, and rounding.
        """
        sizes = np.asarray(map_size)
        several = sizes.ndim == 2
        largest = sizes.max(axis=1) if several else sizes
        parts = sizes[-1] / sizes[-1].max() if several else np.ones(1)
        views = range(len(self.signals.views))
        wanted = max(self._least_part(number, settings, parts) for number in views)
        half = np.ceil(0.5 * np.minimum(wanted * largest, LARGEST_KERNEL))
        return np.minimum(np.maximum(2 * half.astype(int) + 3, 5), LARGEST_KERNEL)

    def _least_part(self, number, settings, parts):
        """Least part of the largest map that a kernel must be wide, where maps are such parts."""
        key = number, self._key(settings), tuple(parts.tolist())
        if key not in self._wanted:
            view, known = self.signals.views[number], self._taken(number, settings)
            reach = known.reach / (parts[known.edge_cascade] if len(parts) > 1 else 1.0)
            self._wanted[key] = narrowest(reach, self._penumbrae()[number], view.edge_lengths)
        return self._wanted[key]

    def leak(self, settings, map_size=None, filter_size=None):
        """Share of facing pixels in shadow that the bias is expected to light.

        Where the occluder is nearer along the light than a quarter texel of slope: contacts, and
        walls that the light grazes.

        Parameters
        ----------
        settings : ShadowSettings
        map_size, filter_size : int, (k,) or, of maps, (k, n) int, optional
            Of all maps, and of the kernel, instead of those of the settings.

        Returns
        -------
        share : float, or (k,) float64
        """
        return self._leak(settings, _inside(settings, sides_of(settings, map_size), filter_size))

    def _leak(self, settings, sides):
        if settings.bias != "auto":
            return 0.0
        lit = count = 0
        for number, view in enumerate(self.signals.views):
            if len(view.gaps):
                known = self._taken(number, settings)
                lit = lit + _core.count_less(
                    known.receiver_cascade, sides, view.gaps, known.receiver_bias
                )
            count += len(view.gaps)
        return lit / count if count else 0.0

    def penumbra(self):
        """Mean absolute error of hard edges where the sun has a disc.

        Returns
        -------
        share : float
        """
        if self._soft is None:
            wide, pixels = self._penumbrae(), self._facing
            views = self.signals.views
            area = sum(float(v.edge_lengths @ w) for v, w in zip(views, wide, strict=True))
            self._soft = DISC * area / pixels if pixels else 0.0
        return self._soft

    def _penumbrae(self):
        """Width [pixels] of the penumbra at the edges of each view."""
        if self._wide is None:
            views = self.signals.views
            self._wide = [np.minimum(view.penumbra_widths(), WIDEST) for view in views]
        return self._wide

    @cached_property
    def _facing(self):
        """Pixels of the full pictures that face the sun."""
        views = self.signals.views
        return sum(v.facing_count * self.signals.pixels / v.pixel_count for v in views)

    def texel_sides(self, settings, map_size=None, filter_size=None):
        """Longer side of a texel of each cascade that receivers take (n,), or (k, n) [m]."""
        known = self._taken(0, settings)
        sides = sides_of(settings, map_size)
        return (known.windows / _inside(settings, sides, filter_size))[..., known.wide]

    def has_idle_cascades(self, settings):
        """Whether a cascade has no receivers in any view.

        Parameters
        ----------
        settings : ShadowSettings

        Returns
        -------
        idle : bool
        """
        views = range(len(self.signals.views))
        held = zip(*(self._taken(number, settings).held for number in views), strict=True)
        return not all(map(any, held))

    def displaced(self, settings):
        """What a map's size divides to give the displacement of the edges it answers for.

        Parameters
        ----------
        settings : ShadowSettings

        Returns
        -------
        area : list of float
            Of each cascade: lengths times displacements by a map of one texel [pixels²].
        """
        views = range(len(self.signals.views))
        each = zip(*(self._taken(number, settings).displaced for number in views), strict=True)
        return list(map(sum, each))

    def load(self, settings):
        """What casters lay on the maps of a path's first view.

        Windows turned or warped hold what those along the axes do.

        Parameters
        ----------
        settings : ShadowSettings

        Returns
        -------
        load : csm.caster_load.Load
        """
        key, _ = self._key(settings)
        if key not in self._loads:
            if settings.turned or settings.warp != "none":
                self._loads[key] = self.load(changed(settings, turned=False, warp="none"))
            else:
                self._loads[key] = self.signals.views[0].casters.load(self._taken(0, settings))
        return self._loads[key]

    def _taken(self, number, settings):
        """What an arrangement of windows makes of one view."""
        key = number, self._key(settings)
        if key not in self._known:
            supposed = changed(settings, **SUPPOSED)
            self._known[key] = Arranged(self.signals.views[number], supposed, self._scene)
        return self._known[key]

    def _key(self, settings):
        """Numbers of what of settings moves windows, and the selection; read once of each.

        A shifted sphere hangs on the selection itself.
        """
        known = self._keys.get(id(settings))
        if known is None or known[0] is not settings:  # ids of what was pickled are others' now
            moves = _windows_of(vars(settings))
            if settings.fit == "shifted":
                moves += (settings.select,)
            number = self._numbers.setdefault(moves, len(self._numbers))
            # with the settings, so that no others get their id while this lives
            known = self._keys[id(settings)] = settings, (number, settings.select)
        return known[1]


#: What of settings moves windows.
_windows_of = itemgetter(
    *(one.name for one in fields(ShadowSettings) if one.name not in WITHOUT_WINDOWS)
)


def rest_of(settings):
    """Of penumbrae that a kernel holds, the share that a filter misses: hard edges all of it."""
    if settings.filter != "pcss":
        return 1.0
    return SOFT_REST + SOFT_FEW * max(0.0, 16.0 / settings.tap_count - 1.0)


def sides_of(settings, map_size=None):
    """Sides of the maps of settings, or of other sizes of all of them or of each.

    Parameters
    ----------
    settings : ShadowSettings
    map_size : int, (k,) or (k, n) int, optional

    Returns
    -------
    sides : (n,), (1,), (k, 1) or (k, n) float64
        To be met with as many values as there are cascades [texels].
    """
    if map_size is None:
        return np.asarray(map_sizes(settings), float)
    sides = np.asarray(map_size, float)
    return sides if sides.ndim == 2 else sides[..., None]


def _unequal(settings, map_size):
    """Whether maps are of several sizes."""
    if map_size is None:
        return isinstance(settings.map_size, tuple) and len(set(settings.map_size)) > 1
    return np.ndim(map_size) == 2


def _inside(settings, sizes, filter_size=None):
    """Texels of a map that lie over its window: a kernel needs a border round it."""
    if settings.filter != "pcss":
        return sizes
    kernel = _column(settings.filter_size if filter_size is None else filter_size)
    return np.maximum(sizes - kernel - 1.0, 0.125 * sizes)


def _column(values):
    """A number, or several (k, 1) to be met with as many values as there are points."""
    return float(values) if np.ndim(values) == 0 else np.asarray(values, float)[:, None]
