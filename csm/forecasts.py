"""What settings can be expected to get wrong, and to cost, from signals alone: no render."""

import math
from dataclasses import dataclass, replace

import numpy as np

from .arrangements import arrange
from .settings import map_sizes

__all__ = ["GPU", "CostModel", "Expected", "Forecaster", "cost_model_of", "forecast_cost"]

# An edge cannot move further than the shadow is wide, which is not known: pixels at which it ends.
FARTHEST = 8.0
# A disc's penumbra of width w differs from a hard edge by 2 w / (3 pi) pixels a pixel of edge.
DISC = 2.0 / (3.0 * math.pi)
# Of what hard edges miss of a penumbra, what percentage-closer soft shadows of 16 taps still miss,
# and what those of 8 taps miss more: measured.
SOFT_REST, SOFT_FEW = 0.2, 0.08
# An edge cannot be softer than its shadow is wide, either: pixels at which penumbrae end.
WIDEST = 64.0
# Of soft shadows [texels].
LARGEST_KERNEL = 65
# Of the widest window: slices without receivers have windows of nothing.
NOTHING = 1e-3
# Measured over forecast errors: of broad casters, and what thin ones add, whose shadows a quarter
# of the picture does not resolve and a coarse map loses altogether.
EDGE_FACTOR, THIN_FACTOR = 0.7, 2.0


#: Fields of settings that move no window.
WITHOUT_WINDOWS = {
    "map_size", "depth_format", "filter", "filter_size", "tap_count", "disc", "caster_faces",
    "cull",
}  # fmt: skip


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


class Forecaster:
    """Expected errors of settings for one scene, camera and sun.

    Windows are fitted once for each arrangement of them; other map sizes only scale their texels.
    So wherever a map's size is asked for, sizes (k,) may be given instead of settings of so many
    sizes, and the answer is as many.

    Parameters
    ----------
    signals : Signals
    scene : Scene
    """

    def __init__(self, signals, scene):
        self._signals, self._scene, self._known = signals, scene, {}
        self._soft = self._wide = None

    def aliasing(self, settings, map_size=None):
        """Expected share of facing pixels on the wrong side because texels have a size.

        Within half a texel along u and v a point is judged by its texel's centre, which displaces
        an edge by the mean of ``|a . d|`` over that square, a being the edge's direction taken back
        to texels: ``max / 4 + min² / (12 max)`` of ``|a_u|`` and ``|a_v|``. Lengths times
        displacements, over the pixels that face the sun; see docs/numerics.md 13.

        Parameters
        ----------
        settings : ShadowSettings
        map_size : int or (k,) int, optional
            Of all maps, instead of that of the settings.

        Returns
        -------
        share : float, or (k,) float64
            0 without edges.
        """
        area, pixels = 0.0, self._facing()
        for number, view in enumerate(self._signals.views):
            known = self._taken(number, settings)
            if len(view.edges):
                moved = known.moved / _size_at(settings, map_size, known.edge_cascade)
                area += (view.edge_lengths * np.minimum(moved, FARTHEST)).sum(axis=-1)
        factor = EDGE_FACTOR + THIN_FACTOR * self._signals.thin_share
        return factor * area / pixels if pixels else 0.0

    def error(self, settings, map_size=None):
        """Expected error, as ``max_error`` counts it: texels, and what a filter makes of penumbrae.

        Parameters
        ----------
        settings : ShadowSettings
        map_size : int or (k,) int, optional
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
        map_size, filter_size : int or (k,) int, optional
            Of all maps, and of the kernel, instead of those of the settings.

        Returns
        -------
        expected : Expected
        """
        if settings.filter == "none":
            dark = float(self._signals.shadowed_share)
            return Expected(dark, dark, 0.0)
        aliasing, leak = self.aliasing(settings, map_size), self.leak(settings, map_size)
        left = 0.0
        if settings.filter == "pcss":
            left = self.left_out(settings, map_size, filter_size)
        held = np.hypot(aliasing, self.softness(settings, 0.0)) + leak
        return Expected(np.hypot(aliasing, self.softness(settings, left)) + leak, held, left)

    def softness(self, settings, left=None):
        """Mean absolute error of penumbrae under the filter of the settings.

        Parameters
        ----------
        settings : ShadowSettings
        left : float or (k,) float64, optional
            What the kernel leaves out, if not `left_out`.

        Returns
        -------
        share : float, or (k,) float64
            `penumbra` under hard edges.
        """
        soft = self.penumbra()
        if settings.filter != "pcss":
            return soft
        rest = SOFT_REST + SOFT_FEW * max(0.0, 16.0 / settings.tap_count - 1.0)
        left = self.left_out(settings) if left is None else left
        return rest * (soft - left) + left

    def left_out(self, settings, map_size=None, filter_size=None):
        """Mean absolute error of penumbrae that are as wide as a kernel can make them.

        A kernel of k texels t makes none wider than k t. A ramp of that width lies between the step
        and the ramp of width w, so that what it misses is what the step misses, less what a step
        would miss of k t: ``2 (w - k t) / (3 pi)``.

        Parameters
        ----------
        settings : ShadowSettings
        map_size : int or (k,) int, optional
            Of all maps, instead of that of the settings.
        filter_size : int or (k,) int, optional
            Side of the kernel [texels], likewise.

        Returns
        -------
        share : float, or (k,) float64
            0 where the kernel is as wide as all penumbrae, `penumbra` where it is nothing.
        """
        kernel, area = settings.filter_size if filter_size is None else filter_size, 0.0
        for number, view in enumerate(self._signals.views):
            if len(view.edges):
                known, wide = self._taken(number, settings), self._penumbrae()[number]
                part = _column(kernel) / _size_at(settings, map_size, known.edge_cascade)
                missing = np.maximum(wide - part * known.reach, 0.0)
                area += (view.edge_lengths * missing).sum(axis=-1)
        pixels = self._facing()
        return DISC * area / pixels if pixels else 0.0

    def kernel(self, settings, map_size):
        """Least kernel that holds the penumbrae.

        Parameters
        ----------
        settings : ShadowSettings
        map_size : int or (k,) int
            Of all maps.

        Returns
        -------
        side : int or (k,) int
            Odd, 5 to 65 texels; what leaves out a twentieth of what hard edges miss, and rounding.
        """
        wanted = max(
            self._taken(number, settings).wanted for number in range(len(self._signals.views))
        )
        half = np.ceil(0.5 * np.minimum(wanted * np.asarray(map_size), LARGEST_KERNEL))
        return np.clip(2 * half.astype(int) + 3, 5, LARGEST_KERNEL)

    def leak(self, settings, map_size=None):
        """Share of facing pixels in shadow that the bias is expected to light.

        Where the occluder is nearer along the light than a quarter texel of slope: contacts, and
        walls that the light grazes.

        Parameters
        ----------
        settings : ShadowSettings
        map_size : int or (k,) int, optional
            Of all maps, instead of that of the settings.

        Returns
        -------
        share : float, or (k,) float64
        """
        if settings.bias != "auto":
            return 0.0
        lit = count = 0
        for number, view in enumerate(self._signals.views):
            if len(view.gaps):
                known = self._taken(number, settings)
                size = _size_at(settings, map_size, known.receiver_cascade)
                lit += np.count_nonzero(view.gaps < known.receiver_bias / size, axis=-1)
            count += len(view.gaps)
        return lit / count if count else 0.0

    def penumbra(self):
        """Mean absolute error of hard edges where the sun has a disc.

        Returns
        -------
        share : float
        """
        if self._soft is None:
            wide, pixels = self._penumbrae(), self._facing()
            views = self._signals.views
            area = sum(float(v.edge_lengths @ w) for v, w in zip(views, wide, strict=True))
            self._soft = DISC * area / pixels if pixels else 0.0
        return self._soft

    def _penumbrae(self):
        """Width [pixels] of the penumbra at the edges of each view."""
        if self._wide is None:
            views = self._signals.views
            self._wide = [np.minimum(view.penumbra_widths(), WIDEST) for view in views]
        return self._wide

    def _facing(self):
        """Pixels of the full pictures that face the sun."""
        views = self._signals.views
        return sum(v.facing_count * self._signals.pixels / v.pixel_count for v in views)

    def texel_sides(self, settings, map_size=None):
        """Longer side of a texel of each cascade that receivers take (n,), or (k, n) [m]."""
        windows = self._taken(0, settings).windows
        wide = windows > NOTHING * windows.max()
        if map_size is None:
            return windows[wide] / np.asarray(map_sizes(settings), float)[wide]
        return windows[wide] / _column(map_size)

    def has_idle_cascades(self, settings):
        """Whether a cascade has no receivers in any view.

        Parameters
        ----------
        settings : ShadowSettings

        Returns
        -------
        idle : bool
        """
        views = range(len(self._signals.views))
        held = np.any([self._taken(number, settings).held for number in views], axis=0)
        return not held.all()

    def _taken(self, number, settings):
        """What an arrangement of windows makes of one view."""
        key = number, tuple(v for k, v in vars(settings).items() if k not in WITHOUT_WINDOWS)
        if key not in self._known:
            one = settings.replace(map_size=2048, depth_format="d32f", filter="hard")
            self._known[key] = arrange(
                self._signals.views[number], self._penumbrae()[number], one, self._scene
            )
        return self._known[key]


def _size_at(settings, map_size, cascade):
    """Texels along the map of each point: a number, or (k, 1), where all maps have as many."""
    if map_size is not None:
        return _column(map_size)
    sizes = map_sizes(settings)
    return float(sizes[0]) if len(set(sizes)) == 1 else np.asarray(sizes, float)[cascade]


def _column(values):
    """A number, or several (k, 1) to be met with as many values as there are points."""
    return float(values) if np.ndim(values) == 0 else np.asarray(values, float)[:, None]


@dataclass(frozen=True)
class CostModel:
    """Milliseconds of a frame, from what it draws; nothing is timed.

    Attributes
    ----------
    view_pixel, view_triangle, receiver_pixel, turned_pixel, range_pixel, mask_pixel : float
        Of a million pixels, or of a thousand triangles, of the passes over the picture [ms]: what
        is seen, its windows, those of turned ones, ranges of splits, the mask.
    soft : float
        Factor of the mask's pass under percentage-closer soft shadows of 16 taps.
    map_texel, map_area : float
        Of a million texels that hold a caster, with both sides of triangles drawn, and of a million
        of all [ms].
    map_triangle, map_pass : float
        Of a thousand triangles, and of each map [ms].
    warp : float
        Factor of the texels' under a warp, whose depths a shader writes.
    source : str
        Where the numbers come from.
    """

    view_pixel: float = 8.5
    view_triangle: float = 0.15
    receiver_pixel: float = 7.5
    turned_pixel: float = 7.0
    range_pixel: float = 8.0
    mask_pixel: float = 20.0
    soft: float = 9.0
    map_texel: float = 10.5
    map_area: float = 0.0
    map_triangle: float = 0.29
    map_pass: float = 1.0
    warp: float = 2.5
    source: str = "llvmpipe on two cores"

    def scaled(self, factor, source):
        """Copy with all times multiplied.

        Parameters
        ----------
        factor : float
        source : str

        Returns
        -------
        model : CostModel
        """
        names = [n for n in self.__dataclass_fields__ if n not in ("soft", "warp", "source")]
        return replace(self, source=source, **{n: factor * getattr(self, n) for n in names})

    def with_maps(self, factor):
        """Copy with the times of shadow maps multiplied."""
        names = ("map_texel", "map_area", "map_triangle", "map_pass")
        return replace(self, **{name: factor * getattr(self, name) for name in names})

    def parts(self, settings, signals, map_size=None):
        """Milliseconds of the shadow maps, and of everything else.

        Parameters
        ----------
        settings : ShadowSettings
        signals : Signals
        map_size : int or (k,) int, optional
            Of all maps, instead of that of the settings.

        Returns
        -------
        maps : float, or (k,) float64
        others : float
        """
        pixels = signals.pixels / 1e6
        others = self.view_pixel * pixels + self.view_triangle * signals.scene_triangles / 1e3
        if settings.filter == "none":
            return 0.0, others + 0.5 * self.mask_pixel * pixels
        soft = 1.0 + (self.soft - 1.0) * settings.tap_count / 16.0
        others += self.mask_pixel * pixels * (soft if settings.filter == "pcss" else 1.0)
        if settings.fit == "visible":
            others += self.receiver_pixel * pixels
            others += self.turned_pixel * pixels if settings.turned else 0.0
        if settings.split == "sdsm":
            others += self.range_pixel * pixels
        count = settings.cascade_count
        sizes = map_sizes(settings) if map_size is None else _column(map_size)
        texels = np.broadcast_to(
            np.square(np.asarray(sizes, float)) / 1e6, (*np.shape(sizes)[:-1], count)
        )
        held = (texels * _covers(count, signals)).sum(axis=-1)
        maps = self.map_texel * held * _drawn_share(settings, signals)
        maps *= self.warp if settings.warp != "none" else 1.0
        maps += self.map_area * texels.sum(axis=-1)
        maps += self.map_triangle * drawn_triangles(count, signals) / 1e3
        return maps + self.map_pass * count, others


#: Of a GPU: what fills maps is clearing and storing them as much as casters, passes over the
#: picture are nearly free, and so are depths that a shader writes. Fitted to 320 frames.
GPU = CostModel(
    view_pixel=0.45,
    view_triangle=0.0008,
    receiver_pixel=0.03,
    turned_pixel=0.03,
    range_pixel=0.03,
    mask_pixel=0.045,
    soft=7.0,
    map_texel=0.17,
    map_area=0.15,
    map_triangle=0.0016,
    map_pass=0.05,
    warp=1.0,
    source="an H200",
)


def cost_model_of(info):
    """Cost model to begin with on a driver.

    Parameters
    ----------
    info : mapping
        `Renderer.info`.

    Returns
    -------
    model : CostModel
    """
    return CostModel() if info["software"] else GPU


def forecast_cost(settings, signals, model=None, map_size=None):
    """Milliseconds that a frame is expected to take.

    Parameters
    ----------
    settings : ShadowSettings
    signals : Signals
    model : CostModel, optional
        By default that of llvmpipe on two cores, the same on every machine.
    map_size : int or (k,) int, optional
        Of all maps, instead of that of the settings.

    Returns
    -------
    ms : float, or (k,) float64
    """
    maps, others = (model or CostModel()).parts(settings, signals, map_size)
    return maps + others


def drawn_triangles(count, signals):
    """Triangles that so many cascades are expected to draw, from the four of the coarse maps.

    The first map of one cascade meets what the widest of four meets, and more; each further one
    adds what those did on average.
    """
    four = sum(signals.casters)
    one = min(signals.scene_triangles, max(four, 1))
    return one + max(four - one, 0.1 * one) * (count - 1) / 3.0


def _covers(count, signals):
    """Shares of texels (count,) that hold a caster, from those of the four coarse maps."""
    four = np.asarray(signals.covers)
    if count == 1 or not len(four):
        return np.full(count, four.max(initial=0.0))
    at = (np.arange(count) + 0.5) / count * len(four)
    return four[np.minimum(at.astype(int), len(four) - 1)]


def _drawn_share(settings, signals):
    """Share of the casters' fill that is drawn."""
    return {"both": 1.0, "front": signals.lit_area, "back": 1.0 - signals.lit_area}[
        settings.caster_faces
    ]
