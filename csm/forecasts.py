"""What settings can be expected to get wrong, and to cost, from signals alone: no render."""

import math
from dataclasses import dataclass, replace

import numpy as np

from .cascades import fit_cascades
from .sampling import surface_steps
from .settings import map_sizes
from .spaces import transform_points

__all__ = ["CostModel", "Forecaster", "forecast_cost"]

# An edge cannot move further than the shadow is wide, which is not known: pixels at which it ends.
FARTHEST = 4.0
# A disc's penumbra of width w differs from a hard edge by 2 w / (3 pi) pixels a pixel of edge.
DISC = 2.0 / (3.0 * math.pi)
# Of what hard edges miss of a penumbra, what percentage-closer soft shadows still miss: measured.
SOFT_REST = 0.3
# Of the automatic bias: texels of slope, and the steepest slope.
BIAS_TEXELS, STEEPEST = 0.25, 1000.0
# Measured over forecast errors: of broad casters, and what thin ones add, whose shadows a quarter
# of the picture does not resolve and a coarse map loses altogether.
EDGE_FACTOR, THIN_FACTOR = 0.7, 2.0


class Forecaster:
    """Expected errors of settings for one scene, camera and sun.

    Windows are fitted once for each number of cascades; other map sizes only scale them.

    Parameters
    ----------
    signals : Signals
    scene : Scene
    """

    def __init__(self, signals, scene):
        self._signals, self._scene, self._known = signals, scene, {}

    def aliasing(self, settings):
        """Expected share of facing pixels on the wrong side because texels have a size.

        Within half a texel along u and v a point is judged by its texel's centre, which displaces
        an edge by the mean of ``|a . d|`` over that square, a being the edge's direction taken back
        to texels: ``max / 4 + min² / (12 max)`` of ``|a_u|`` and ``|a_v|``. Lengths times
        displacements, over the pixels that face the sun; see docs/numerics.md 13.

        Parameters
        ----------
        settings : ShadowSettings

        Returns
        -------
        share : float
            0 without edges.
        """
        area = pixels = 0.0
        for number, view in enumerate(self._signals.views):
            sizes = map_sizes(settings)
            across, cascade, _ = self._taken(number, settings)
            if len(view.edges):
                across = across / np.asarray(sizes, float)[cascade][:, None]
                least, most = np.sort(np.abs(across), axis=1).T
                mean = most / 4.0 + least**2 / (12.0 * np.maximum(most, 1e-12))
                area += float((view.edge_lengths * np.minimum(mean, FARTHEST)).sum())
            pixels += view.facing_count * self._signals.pixels / view.pixel_count
        factor = EDGE_FACTOR + THIN_FACTOR * self._signals.thin_share
        return factor * area / pixels if pixels else 0.0

    def error(self, settings):
        """Expected error, as ``max_error`` counts it: texels, and what a filter makes of penumbrae.

        Parameters
        ----------
        settings : ShadowSettings

        Returns
        -------
        share : float
        """
        if settings.filter == "none":
            return float(self._signals.shadowed_share)
        soft = self.penumbra() * (SOFT_REST if settings.filter == "pcss" else 1.0)
        return math.hypot(self.aliasing(settings), soft) + self.leak(settings)

    def leak(self, settings):
        """Share of facing pixels in shadow that the bias is expected to light.

        Where the occluder is nearer along the light than a quarter texel of slope: contacts, and
        walls that the light grazes.

        Parameters
        ----------
        settings : ShadowSettings

        Returns
        -------
        share : float
        """
        if settings.bias != "auto":
            return 0.0
        sizes = map_sizes(settings)
        lit = count = 0
        for number, view in enumerate(self._signals.views):
            *_, sides = self._taken(number, settings)
            if len(view.gaps):
                texels = sides[0] / np.asarray(sizes, float)[sides[1]]
                bias = BIAS_TEXELS * texels * np.minimum(view.gradients, STEEPEST)
                lit += int(np.count_nonzero(view.gaps < bias))
            count += len(view.gaps)
        return lit / count if count else 0.0

    def penumbra(self):
        """Mean absolute error of hard edges where the sun has a disc.

        Returns
        -------
        share : float
        """
        area = pixels = 0.0
        for view in self._signals.views:
            area += float((view.edge_lengths * np.minimum(view.penumbra_widths(), 64.0)).sum())
            pixels += view.facing_count * self._signals.pixels / view.pixel_count
        return DISC * area / pixels if pixels else 0.0

    def texel_sides(self, settings):
        """Longer side of a texel of each cascade that receivers take (n,) [m]."""
        view = self._signals.views[0]
        cascades = self._fitted(view, settings.replace(filter="hard"))
        sides = cascades.texel_size.max(axis=1)
        wide = sides > 1e-3 * sides.max()  # slices without receivers have windows of nothing
        return sides[wide]

    def _fitted(self, view, settings):
        return fit_cascades(
            view.camera, view.sun, settings, scene=self._scene, receivers=view.receivers
        )

    def _taken(self, number, settings):
        """Of the edges the displacement (e, 2) [pixels] by steps over a whole map, and the cascade.

        And of the receivers the longer side [m] and the index of theirs (m,), (m,).
        """
        one = settings.replace(map_size=2048, depth_format="d32f", filter="hard").canonical()
        key = number, one
        if key not in self._known:
            self._known[key] = self._measure(self._signals.views[number], one)
        return self._known[key]

    def _measure(self, view, settings):
        cascades = self._fitted(view, settings)
        cascade = _selected(cascades, view.camera, settings, view.edges)
        gradients = cascades.uvz_from_world[cascade][:, :2, :3]
        steps = surface_steps(view.camera, view.edges, view.edge_normals, gradients)
        across = np.einsum("ea,eak->ek", view.edge_across, steps)
        of_receivers = _selected(cascades, view.camera, settings, view.receivers)
        windows = cascades.texel_size.max(axis=1) * np.asarray(cascades.map_size, float)
        return across, cascade, (windows[of_receivers], of_receivers)


def _selected(cascades, camera, settings, points):
    """Index (m,) of the cascade that answers for each point."""
    cascade = np.full(len(points), cascades.count - 1)
    depth = (points - camera.eye) @ -camera.backward
    for i in reversed(range(cascades.count)):
        if settings.select == "interval":
            inside = depth <= cascades.splits[i + 1]
        else:
            uv = transform_points(cascades.uvz_from_world[i], points)[:, :2]
            inside = (np.abs(uv - 0.5) <= 0.5).all(axis=1)
        cascade[inside] = i
    return cascade


@dataclass(frozen=True)
class CostModel:
    """Milliseconds of a frame, from what it draws; nothing is timed.

    Attributes
    ----------
    view_pixel, view_triangle, receiver_pixel, mask_pixel : float
        Of a million pixels, or of a thousand triangles, of the passes over the picture [ms].
    soft : float
        Factor of the mask's pass under percentage-closer soft shadows.
    map_texel, map_triangle, map_pass : float
        Of a million texels, of a thousand triangles, and of each map [ms].
    back_faces : float
        Share of a map's time with back faces alone.
    source : str
        Where the numbers come from.
    """

    view_pixel: float = 9.0
    view_triangle: float = 0.17
    receiver_pixel: float = 7.5
    mask_pixel: float = 21.0
    soft: float = 10.0
    map_texel: float = 7.0
    map_triangle: float = 0.55
    map_pass: float = 1.0
    back_faces: float = 0.55
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
        names = [n for n in self.__dataclass_fields__ if n not in ("soft", "back_faces", "source")]
        return replace(self, source=source, **{n: factor * getattr(self, n) for n in names})

    def with_maps(self, factor):
        """Copy with the times of shadow maps multiplied."""
        names = ("map_texel", "map_triangle", "map_pass")
        return replace(self, **{name: factor * getattr(self, name) for name in names})

    def parts(self, settings, signals):
        """Milliseconds of the shadow maps, and of everything else.

        Parameters
        ----------
        settings : ShadowSettings
        signals : Signals

        Returns
        -------
        maps, others : float
        """
        pixels = signals.pixels / 1e6
        others = self.view_pixel * pixels + self.view_triangle * signals.scene_triangles / 1e3
        if settings.filter == "none":
            return 0.0, others + 0.5 * self.mask_pixel * pixels
        others += self.mask_pixel * pixels * (self.soft if settings.filter == "pcss" else 1.0)
        if settings.fit == "visible":
            others += self.receiver_pixel * pixels * (2.0 if settings.turned else 1.0)
        sizes = map_sizes(settings)
        maps = self.map_texel * sum(size * size for size in sizes) / 1e6
        maps += self.map_triangle * drawn_triangles(settings.cascade_count, signals) / 1e3
        maps += self.map_pass * settings.cascade_count
        return maps * (self.back_faces if settings.caster_faces == "back" else 1.0), others


def forecast_cost(settings, signals, model=None):
    """Milliseconds that a frame is expected to take.

    Parameters
    ----------
    settings : ShadowSettings
    signals : Signals
    model : CostModel, optional
        By default that of llvmpipe on two cores, the same on every machine.

    Returns
    -------
    ms : float
    """
    return math.fsum((model or CostModel()).parts(settings, signals))


def drawn_triangles(count, signals):
    """Triangles that so many cascades are expected to draw, from the four of the coarse maps.

    The first map of one cascade meets what the widest of four meets, and more; each further one
    adds what those did on average.
    """
    four = sum(signals.casters)
    one = min(signals.scene_triangles, max(four, 1))
    return one + max(four - one, 0.1 * one) * (count - 1) / 3.0
