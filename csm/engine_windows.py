"""What the rows of an engine are asked about: our settings, in the engine's own windows."""

from functools import cached_property

import numpy as np

from . import _core
from .cascades import bias_metres, fit_cascades
from .conversions import resampled
from .settings import MANUAL_BIASES, ShadowSettings, map_sizes

__all__ = ["EngineWindows"]


class EngineWindows:
    """What the rows of an engine are asked about: our settings, in the engine's own windows.

    Attributes
    ----------
    settings : ShadowSettings
        Ours, in canonical form.
    camera : Camera
    sun : Sun
    ours, count : int
        Cascades here and there.
    splits : (count + 1,) float64
        View depths [m] of the engine's cascades; the first begins at the camera's near.
    near, begin, far : float
        The camera's near, where our first cascade begins, and the end of the range [m].
    our_sizes : tuple of int
        Texels along each of our maps.
    our_size, size : int
        Texels along the largest of them, and along a cascade's there.
    our_texels : tuple of float
        Longer side of a texel of each of our cascades [m], if known.
    """

    def __init__(self, engine, settings, camera, sun, scene, splits, texels=()):
        self.settings, self.camera, self.sun, self._scene = settings, camera, sun, scene
        self._engine, self.our_texels = engine, texels
        self.ours = len(splits) - 1
        self.count = min(engine.counts, key=lambda n: (n < self.ours, abs(n - self.ours)))
        if self.ours > max(engine.counts):
            self.count = max(engine.counts)
        self.our_sizes = map_sizes(settings)
        self.our_size = max(self.our_sizes)
        self.size = engine.map_size(self.our_size, self.count)
        self.near, self.begin, self.far = camera.near, float(splits[0]), float(splits[-1])
        made = resampled(splits, self.count)
        self.splits = np.concatenate([[min(self.near, made[0])], made[1:]])

    @cached_property
    def _cascades(self):
        """Windows like the engine's."""
        inner = tuple(float(one) for one in self.splits[1:-1])
        depth_format, depth_range = self._engine.depth(self)
        settings = ShadowSettings(
            cascade_count=self.count,
            map_size=self.size,
            split="manual",
            manual_splits=inner,
            max_distance=self.far,
            view_range="camera",
            fit=self.fit,
            depth_format=depth_format,
            depth_range=depth_range,
        )
        return fit_cascades(self.camera, self.sun, settings, scene=self._scene)

    @property
    def fit(self):
        """Which of our fits the engine's windows are like."""
        return self._engine.fit(self)

    @property
    def texels(self):
        """Longer side of a texel of each of the engine's cascades (count,) [m]."""
        return self._cascades.texel_size.max(axis=1)

    @cached_property
    def diameters(self):
        """Longest diagonal of each slice (count,) [m]."""
        longest = []
        for near, far in zip(self.splits, self.splits[1:], strict=False):
            corners = _core.frustum_corners(self.camera, float(near), float(far))
            across = corners[:, None] - corners[None]
            longest.append(float(np.sqrt((across**2).sum(axis=-1)).max()))
        return np.array(longest)

    @property
    def caster_span(self):
        """Length of the scene along the light [m]; without one, of the longest slice."""
        if self._scene is None:
            return float(self.diameters.max())
        low, high = np.asarray(self._scene.bounds)
        return float(np.abs(self.sun.to_light) @ (high - low))

    @cached_property
    def _bias(self):
        """Constant part (count,) [m], and texels of bias per tangent of a plane's angle."""
        kernel = self._engine.kernel(self)
        probe = ShadowSettings(
            filter="hard" if kernel == 1 else "pcf",
            filter_size=3 if kernel == 1 else kernel,
            bias=self.settings.bias,
            depth_format=self._engine.depth(self)[0],
        )
        by_plane = bias_metres(self._cascades, probe.replace(bias="manual"))
        if self.settings.bias == "auto":
            constant = [one["constant_m"] for one in bias_metres(self._cascades, probe)]
            slope, normal = by_plane[0]["needed_slope_m"], 0.0
        else:
            ours = bias_metres(self._cascades, self._manual(probe))
            constant = [one["constant_m"] for one in ours]
            slope, normal = ours[0]["slope_m"], ours[0]["normal_offset_m"]
            if self.settings.receiver_plane:  # which no engine has: the plane's reach instead
                slope += by_plane[0]["needed_slope_m"]
        constant = np.maximum(constant, 0.0)  # `negative_bias` tells
        slope, normal = max(float(slope), 0.0), max(float(normal), 0.0)
        texel = float(self.texels[0])
        # |gx| + |gy| is at most sqrt(2) times the tangent; an offset along the normal by sin t
        # texels is worth tan t along the light
        return constant, (np.sqrt(2.0) * slope + normal) / texel

    def _manual(self, probe):
        names = (*MANUAL_BIASES, "bias_side")
        return probe.replace(**{name: getattr(self.settings, name) for name in names})

    @property
    def negative_bias(self):
        """Say which biases by hand are negative, which no engine takes; None without one."""
        if self.settings.bias != "manual":
            return None
        values = {name: getattr(self.settings, name) for name in MANUAL_BIASES}
        found = [f"{name} {value:g}" for name, value in values.items() if value < 0.0]
        return f"negative, held to 0: {', '.join(found)}" if found else None

    @property
    def constant_m(self):
        """Bias along the light that does not depend on slopes (count,) [m]."""
        return self._bias[0]

    @property
    def normal_texels(self):
        """Bias of a plane at the angle t to the light [texels] over tan t."""
        return float(self._bias[1])
