"""What a render gives back: arrays, matrices, times."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import _core
from .plans import OUTPUTS
from .settings import map_sizes

__all__ = ["Frame", "Visibility"]

POINT_OUTPUTS = ("point_visibility", "point_cascade", "point_blend_weight")


@dataclass(frozen=True, eq=False)
class Visibility:
    """What shadow maps say of points in the world.

    Attributes
    ----------
    mask : (m,) float32
        Visibility of the sun, 0 to 1, 1 = lit.
    cascade_index : (m,) uint8
        255 = none: beyond the shadow range or outside every map, lit.
    blend_weight : (m,) float32
        Share of the next cascade in `mask`, 0 to 1; that of `cascade_index` is the rest.
    """

    mask: np.ndarray
    cascade_index: np.ndarray
    blend_weight: np.ndarray


class Frame:
    """Arrays of one render; holds no OpenGL object, pickles, outlives its renderer.

    Attributes
    ----------
    mask : (h, w) float32
        Visibility of the sun, 0 to 1, 1 = lit; row 0 is on top. 1 where `valid` is False, 0 where
        a surface does not face the sun.
    mask_single : (h, w) float32
        The mask of the one cascade `cascade_index`, without blend or fade. Only if asked for.
    valid : (h, w) bool
        A surface is seen there.
    view_depth : (h, w) float32
        [m], inf where not valid.
    cascade_index : (h, w) uint8
        255 = none: beyond the shadow range, lit.
    shadow_maps : (n, size, size) float32, or a tuple of (size, size) float32
        ``[cascade, v, u]``, v = 0 at the bottom; depth 0 at the caster side, 1 far. A tuple of
        ``[v, u]`` where the settings give the cascades different sizes. Under the
        default ``cull="inclusive"`` they hold what can shadow the picture; ``cull="none"`` draws
        everything.
    moments : (n, size, size, k) float32, or a tuple of (size, size, k) float32
        What a prefiltered filter looks up, ``[cascade, v, u, channel]``, after its blur; of summed
        areas what each texel added. Only if asked for, and only under such a filter.
    normal : (h, w, 3) float32
        Geometric normal towards the camera, 0 where not valid; only if asked for.
    point_visibility, point_cascade, point_blend_weight : (m,) float32, uint8, float32
        At the `points` of the render; the weight is that of the next cascade in the visibility.
    points, point_normals : (m, 3) float64 or None
        World points [m] that were asked for, and the unit normals that were given for them.
    cascades : Cascades
    camera : Camera
    sun : Sun
    settings : ShadowSettings
    timings_ms : dict of str to float
        Milliseconds per pass, in order; of a frame that was not timed ``readback`` alone, which
        is no measure of the frame.
    info : dict
        Driver, back end, clock of the timings, bytes, programs, canonical settings, culling:
        ``chunks_drawn`` and ``triangles_drawn`` per cascade, ``chunks_culled`` and, of those,
        ``chunks_culled_exclusive``, what exclusive culling alone left out. ``bias`` is
        `csm.bias_metres` of the frame: what its biases are in metres, a dict per cascade. Where
        maps may be reused, ``reuse`` is a dict per map: ``action`` (draw, keep, add, scroll),
        ``shift`` of the window [texels], and what was spared: ``texels_saved``,
        ``triangles_saved``.

    Raises
    ------
    AttributeError
        For an output that was not asked for.
    """

    def __init__(
        self, arrays, *, cascades, camera, sun, settings, timings_ms, info,
        points=None, point_normals=None,
    ):  # fmt: skip
        self._arrays = arrays
        self.points = points
        self.point_normals = point_normals
        self.cascades = cascades
        self.camera = camera
        self.sun = sun
        self.settings = settings
        self.timings_ms = timings_ms
        if callable(info):
            self._make_info = info
        else:
            self.info = info

    @cached_property
    def info(self):
        """What else is known of the render, made when it is first read: see the class."""
        try:
            return self._make_info()
        except AttributeError as error:  # which else would say that a Frame has no info
            raise RuntimeError(f"info of a frame could not be made: {error}") from error

    def __getstate__(self):
        state = {**self.__dict__, "info": self.info}
        state.pop("_make_info", None)
        return state

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self._arrays:
            return self._arrays[name]
        if name == "shadow_maps" and self.settings.filter == "none":
            raise AttributeError("filter='none' makes no shadow_maps")
        if name == "moments" and not _core.moment_numbers(self.settings):
            raise AttributeError(f"filter={self.settings.filter!r} makes no moments")
        if name in OUTPUTS:
            raise AttributeError(f"{name} was not asked for: render with outputs=({name!r}, ...)")
        if name in POINT_OUTPUTS:
            raise AttributeError(f"{name} was not asked for: render with points=...")
        raise AttributeError(f"a Frame has no {name}")

    def __dir__(self):
        return [*super().__dir__(), *self._arrays]

    @property
    def outputs(self):
        """Names of the arrays this frame has."""
        return tuple(self._arrays)

    def __repr__(self):
        width, height = self.camera.size
        total = f"{sum(self.timings_ms.values()):.1f} ms"
        if list(self.timings_ms) == ["readback"]:
            total = "no pass timed"
        return f"Frame({width}x{height}, {', '.join(self._arrays)}; {total})"


def array_shapes(camera, settings, outputs, point_count):
    """Shape and dtype of each array of a frame.

    Parameters
    ----------
    camera : Camera
    settings : ShadowSettings
    outputs : sequence of str
    point_count : int or None
        None without points.

    Returns
    -------
    shapes : dict of str to (shape, dtype)
        For maps of different sizes a tuple of them.
    """
    width, height = camera.size
    image = (height, width)
    sizes = map_sizes(settings)
    numbers = _core.moment_numbers(settings) if "moments" in outputs else 0
    every = {
        "mask": (image, np.float32),
        "mask_single": (image, np.float32),
        "valid": (image, np.bool_),
        "view_depth": (image, np.float32),
        "cascade_index": (image, np.uint8),
        "shadow_maps": _map_shapes(sizes, ()),
        "moments": _map_shapes(sizes, (numbers,)),
        "normal": ((*image, 3), np.float32),
    }
    shapes = {name: every[name] for name in OUTPUTS if name in outputs}
    if settings.filter == "none":
        shapes.pop("shadow_maps", None)
    if not numbers:
        shapes.pop("moments", None)
    if point_count is not None:
        shapes["point_visibility"] = ((point_count,), np.float32)
        shapes["point_cascade"] = ((point_count,), np.uint8)
        shapes["point_blend_weight"] = ((point_count,), np.float32)
    return shapes


def _map_shapes(sizes, more):
    if len(set(sizes)) == 1:
        return ((len(sizes), sizes[0], sizes[0], *more), np.float32)
    return tuple(((size, size, *more), np.float32) for size in sizes)


def prepare_arrays(shapes, out):
    """New arrays, or those of an earlier frame.

    Parameters
    ----------
    shapes : dict of str to (shape, dtype)
        From `array_shapes`.
    out : Frame or None

    Returns
    -------
    arrays : dict of str to ndarray
        A tuple where `shapes` has one.

    Raises
    ------
    TypeError, ValueError
        If `out` is no Frame or an array of it has another shape.
    """
    if out is not None and not isinstance(out, Frame):
        raise TypeError(f"out must be a Frame of an earlier render (got {type(out).__name__})")
    return {
        name: _prepared(name, wanted, None if out is None else out._arrays.get(name))
        for name, wanted in shapes.items()
    }


def _prepared(name, wanted, earlier):
    if isinstance(wanted[1], tuple):  # one array for each map
        if earlier is None:
            earlier = (None,) * len(wanted)
        if not isinstance(earlier, tuple) or len(earlier) != len(wanted):
            raise ValueError(f"out: {name} must be a tuple of {len(wanted)} arrays")
        return tuple(
            _prepared(f"{name}[{i}]", *pair)
            for i, pair in enumerate(zip(wanted, earlier, strict=True))
        )
    shape, dtype = wanted
    if earlier is None:
        return np.empty(shape, dtype)
    if not isinstance(earlier, np.ndarray) or earlier.shape != shape:
        found = f"{len(earlier)} arrays" if isinstance(earlier, tuple) else earlier.shape
        raise ValueError(f"out: {name} must have shape {shape} (got {found})")
    return earlier
