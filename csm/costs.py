"""What a frame costs, from what it draws: no render, and nothing is timed."""

from dataclasses import dataclass, replace

import numpy as np

from .arrangements import USUAL
from .forecasts import sides_of

__all__ = ["GPU", "CostModel", "cost_model_of", "forecast_cost"]


@dataclass(frozen=True)
class CostModel:
    """Milliseconds of a frame, from what it draws; nothing is timed.

    Attributes
    ----------
    view_pixel, view_triangle, receiver_pixel, turned_pixel, range_pixel : float
        Of a million pixels, or of a thousand triangles, of the passes over the picture [ms]: what
        is seen, its windows, those of turned ones, ranges of splits.
    mask_pixel, mask_cascade, mask_tap : float
        The mask's, of a million pixels; of a million that face the sun and each cascade; and of a
        million and each tap of percentage-closer soft shadows [ms].
    map_texel, map_layer, map_line : float
        Of a million texels of the maps, of a million that a side of a caster covers, and of a
        million along outlines of casters [ms].
    map_triangle, map_pass : float
        Of a thousand triangles, and of each map [ms].
    cutout, warp : float
        Factors of covered texels: of casters with a cut-out, whose shader looks it up, and under a
        warp, whose depths a shader writes.
    source : str
        Where the numbers come from.
    """

    view_pixel: float = 2.6
    view_triangle: float = 0.085
    receiver_pixel: float = 6.3
    turned_pixel: float = 8.0
    range_pixel: float = 7.0
    mask_pixel: float = 11.0
    mask_cascade: float = 1.9
    mask_tap: float = 4.2
    map_texel: float = 0.61
    map_layer: float = 0.42
    map_line: float = 2.9
    map_triangle: float = 0.12
    map_pass: float = 0.24
    cutout: float = 2.8
    warp: float = 3.4
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
        fixed = ("cutout", "warp", "source")
        names = [n for n in self.__dataclass_fields__ if n not in fixed]
        return replace(self, source=source, **{n: factor * getattr(self, n) for n in names})

    def with_maps(self, factor):
        """Copy with the times of shadow maps multiplied."""
        names = [name for name in self.__dataclass_fields__ if name.startswith("map_")]
        return replace(self, **{name: factor * getattr(self, name) for name in names})

    def parts(self, settings, forecaster, map_size=None):
        """Milliseconds of the shadow maps, and of everything else.

        Parameters
        ----------
        settings : ShadowSettings
        forecaster : Forecaster
        map_size : int, (k,) or (k, n) int, optional
            Of all maps, instead of that of the settings.

        Returns
        -------
        maps : float, or (k,) float64
        others : float
        """
        maps = self.maps(settings, forecaster, map_size)
        return maps, self.others(settings, forecaster)

    def maps(self, settings, forecaster, map_size=None):
        """Milliseconds of the shadow maps, whatever the filter.

        Parameters
        ----------
        settings : ShadowSettings
        forecaster : Forecaster
        map_size : int, (k,) or (k, n) int, optional
            Of all maps, instead of that of the settings.

        Returns
        -------
        maps : float, or (k,) float64
            0 without shadow maps.
        """
        if settings.filter == "none":
            return 0.0
        sides = sides_of(settings, map_size)
        maps = (np.square(sides) / 1e6 * self.texel_costs(settings, forecaster, sides)).sum(axis=-1)
        load = forecaster.load(settings)
        drawn = load.needed if settings.cull == "exclusive" else load.triangles
        return maps + (
            self.map_triangle * float(drawn.sum()) / 1e3 + self.map_pass * settings.cascade_count
        )

    def others(self, settings, forecaster):
        """Milliseconds of everything else, whatever the maps' sizes.

        Parameters
        ----------
        settings : ShadowSettings
        forecaster : Forecaster

        Returns
        -------
        others : float
        """
        signals, pixels = forecaster.signals, forecaster.signals.pixels / 1e6
        others = self.view_pixel * pixels + self.view_triangle * signals.scene_triangles / 1e3
        others += self.mask_pixel * pixels
        if settings.filter == "none":
            return others
        facing = pixels * signals.seen_share * signals.facing_share
        others += self.mask_cascade * settings.cascade_count * facing
        if settings.filter == "pcss":
            others += self.mask_tap * pixels * settings.tap_count
        if settings.fit == "visible":
            others += self.receiver_pixel * pixels
            others += self.turned_pixel * pixels if settings.turned else 0.0
        if settings.split == "sdsm":
            others += self.range_pixel * pixels
        return others

    def texel_costs(self, settings, forecaster, sides):
        """Milliseconds of a million texels of each map, by what covers them.

        Parameters
        ----------
        settings : ShadowSettings
        forecaster : Forecaster
        sides : (n,), (1,), (k, 1) or (k, n) float64
            Of the maps [texels]: the finer, the less of what is covered are outlines.

        Returns
        -------
        costs : (n,) or (k, n) float64
        """
        layers, lines = forecaster.load(settings).drawn(settings.caster_faces, self.cutout)
        return self._texel_cost(settings, np.asarray(layers), np.asarray(lines), sides)

    def usual_costs(self, settings, forecaster):
        """`texel_costs` of maps of the usual size, as a list."""
        drawn = forecaster.load(settings).drawn(settings.caster_faces, self.cutout)
        return [self._texel_cost(settings, *each, USUAL) for each in zip(*drawn, strict=True)]

    def _texel_cost(self, settings, layers, lines, sides):
        """The same of what covers texels, of one map or of several."""
        covered = self.map_layer * layers + self.map_line * lines / sides
        return self.map_texel + covered * (self.warp if settings.warp != "none" else 1.0)


#: Of a GPU: what fills maps is clearing and storing them as much as casters, passes over the
#: picture are nearly free, and so are depths that a shader writes. Fitted to 320 frames.
GPU = CostModel(
    view_pixel=0.35,
    view_triangle=0.0008,
    receiver_pixel=0.03,
    turned_pixel=0.03,
    range_pixel=0.03,
    mask_pixel=0.025,
    mask_cascade=0.003,
    mask_tap=0.0035,
    map_texel=0.09,
    map_layer=0.058,
    map_line=0.03,
    map_triangle=0.0015,
    map_pass=0.0115,
    cutout=2.6,
    warp=1.1,
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


def forecast_cost(settings, forecaster, model=None, map_size=None):
    """Milliseconds that a frame is expected to take.

    Parameters
    ----------
    settings : ShadowSettings
    forecaster : Forecaster
    model : CostModel, optional
        By default that of llvmpipe on two cores, the same on every machine.
    map_size : int, (k,) or (k, n) int, optional
        Of all maps, instead of that of the settings.

    Returns
    -------
    ms : float, or (k,) float64
    """
    maps, others = (model or CostModel()).parts(settings, forecaster, map_size)
    return maps + others
