"""Cascades: the light windows that cover the view, as matrices."""

import threading
import weakref
from dataclasses import dataclass

import numpy as np

from . import _core
from .camera import Camera
from .cutouts import core_meshes
from .matrices import read_matrices
from .scene import Scene
from .settings import ShadowSettings
from .sun import Sun

__all__ = ["Cascades", "bias_metres", "fit_cascades", "part_boxes"]

_KINDS = {"scene": Scene, "camera": Camera, "sun": Sun, "settings": ShadowSettings}


def check_kinds(**arguments):
    """Raise TypeError unless arguments of these names are what the names say."""
    for name, value in arguments.items():
        if not isinstance(value, _KINDS[name]):
            raise TypeError(
                f"{name} must be a csm.{_KINDS[name].__name__} (got {type(value).__name__})"
            )


@dataclass(frozen=True, eq=False)
class Cascades:
    """Splits, matrices, texel grid and depth range of n cascades; arrays are read-only.

    Attributes
    ----------
    splits : (n + 1,) float64
        Ascending view depths [m]; cascade i is fitted to ``splits[i]`` to ``splits[i + 1]``.
    light_from_world : (n, 4, 4) float64
        Rotation about the world origin, light +z being `to_light`; a skew under
        ``light_basis="world"``, whose x and y axes lie along the world's and whose z counts the
        metres along the ray to the light. Under ``sun_step_deg`` of the stepped sun.
    clip_from_light, clip_from_world : (n, 4, 4) float64
        Clip x, y in [-1, 1], z from 0 at the caster side to 1.
    uvz_from_world : (n, 4, 4) float64
        u, v in [0, 1] over the map, (0, 0) at its lower left; z as in clip space.
    texel_size : (n, 2) float64
        Along light x and y [m].
    lattice : (n, 2) int64
        Lower corner of the window in texels from the world origin; all 0 if not snapped.
    depth_range : (n, 2) float64
        Light-view depths [m], the negative of light z, of clip z 0 and 1.
    map_size : (n,) int32
        Texels along a side.
    range_step : int or None
        k where the view range was rounded up to ``near * 2**(k / 4)``, else None.
    hold : bytes
        What the next frame's fit holds on to (`fit_cascades` with ``held=``): steps of ranges and
        sizes, axes carried on. Opaque; empty where nothing is held.
    pancake : bool
        Whether casters before the depth range are flattened onto its near end.

    Notes
    -----
    Matrices are composed in double. A point at a distance d from the world origin lands within
    ``4 * 2**-52 * d / texel_size`` texels of its place: 1e-4 texels for d = 1e8 m and texels of
    1 mm.
    """

    splits: np.ndarray
    light_from_world: np.ndarray
    clip_from_light: np.ndarray
    clip_from_world: np.ndarray
    uvz_from_world: np.ndarray
    texel_size: np.ndarray
    lattice: np.ndarray
    depth_range: np.ndarray
    map_size: np.ndarray
    range_step: int | None = None
    hold: bytes = b""
    pancake: bool = False

    @classmethod
    def from_matrices(cls, clip_from_world, splits, map_size, *, clip_z=(0, 1), pancake=False):
        """Cascades that somebody else has placed, from their matrices.

        Parameters
        ----------
        clip_from_world : (n, 4, 4) or (4, 4) array_like
            One matrix per cascade for column vectors, ``clip = M @ (x, y, z, 1)``: the
            translation is the last column. Of parallel light: affine, or warped, a projective
            map of the place across the light. A mirrored map is as good as any.
        splits : (n + 1,) array_like
            Ascending view depths [m] of the slices that the cascades are meant for.
        map_size : int or (n,) array_like of int
            Texels along a side, 1 to 65536.
        clip_z : (float, float)
            Clip depth (after the division by w) at the caster side and at the far side: (0, 1),
            (-1, 1) where OpenGL's own range is kept, (1, 0) for a reversed depth.
        pancake : bool
            Whether casters before the near side are kept, flattened onto it by a depth clamp.

        Returns
        -------
        cascades : Cascades
            With clip z from 0 to 1. `light_from_world` is a rotation whose x axis is that of the
            map; what it does not explain (a mirror, a skew, a warp) is in `clip_from_light`.
            Under a warp `texel_size` holds at the map's centre. `lattice` is all 0.

        Raises
        ------
        TypeError, ValueError
            If shapes do not fit, splits do not ascend, or a matrix is transposed, not finite, maps
            the world to no area, or is that of a lamp with a place.
        """
        return cls(**read_matrices(clip_from_world, splits, map_size, clip_z), pancake=pancake)

    def __post_init__(self):
        self._freeze()

    def __setstate__(self, state):
        self.__dict__.update(state)
        self._freeze()

    def _freeze(self):
        for value in self.__dict__.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @property
    def count(self):
        """Number of cascades."""
        return len(self.map_size)

    def __repr__(self):
        splits = ", ".join(f"{split:.4g}" for split in self.splits)
        return f"Cascades(count={self.count}, splits=[{splits}] m)"


def fit_cascades(camera, sun, settings, *, scene=None, receivers=None, held=None):
    """Light windows for the slices of a camera's view; needs no OpenGL.

    Parameters
    ----------
    camera : Camera
    sun : Sun
    settings : ShadowSettings
    scene : Scene, optional
        Its bounds cut the view range (``view_range="scene"``), the windows of ``fit="clipped"`` and
        ``"focus"`` (this one by the boxes of its parts, too), and give the depth range, which
        then does not depend on the camera. Without it the range is the camera's, and the depth
        range holds each slice and as much again towards the light.
    receivers : (m, 3) array_like, optional
        World points [m] of what the camera sees, facing the sun: what ``fit="visible"`` and
        ``split="sdsm"`` and ``"histogram"`` are fitted to. Others do not read them.
    held : Cascades, optional
        Of the frame before: steps of ranges and sizes are kept while they still fit, so that they
        do not flicker.

    Returns
    -------
    cascades : Cascades

    Raises
    ------
    TypeError, ValueError
        If camera, sun and settings do not go together (a split that needs near > 0, a map smaller
        than its kernel, manual splits outside the view range) or `receivers` has another shape.

    Notes
    -----
    The range of ``view_range="scene"`` is rounded up so that texel sizes stay constant while the
    camera moves. An orthographic camera whose near is not positive has no ratio to round by: its
    far is only cut to the scene.
    """
    check_kinds(camera=camera, sun=sun, settings=settings)
    if scene is not None and not hasattr(scene, "bounds"):  # all that is read of it
        check_kinds(scene=scene)
    if held is not None and not isinstance(held, Cascades):
        raise TypeError(f"held must be a csm.Cascades or None (got {held!r})")
    if receivers is not None:
        receivers = np.asarray(receivers)
        if receivers.ndim != 2 or receivers.shape[1] != 3 or receivers.dtype.kind not in "fiu":
            raise ValueError(
                "receivers must be (m, 3) numbers "
                f"(got shape {receivers.shape}, dtype {receivers.dtype})"
            )
        if not np.isfinite(receivers).all():
            wrong = int(np.argmin(np.isfinite(receivers).all(axis=1)))
            raise ValueError(
                f"receivers must be finite (number {wrong} is {receivers[wrong].tolist()})"
            )
    fitted = _core.fit_cascades(
        camera,
        sun.to_light,
        settings,
        scene_bounds=None if scene is None else scene.bounds.ravel(),
        held=(held.hold or None) if held is not None else None,
        receivers=receivers,
        boxes=part_boxes(scene) if settings.fit == "focus" else None,
    )
    return Cascades(**fitted)


def bias_metres(cascades, settings):
    """Biases of settings in metres along the light; needs no OpenGL.

    Parameters
    ----------
    cascades : Cascades
    settings : ShadowSettings

    Returns
    -------
    biases : list of dict
        One per cascade, empty under ``filter="none"``. With g = (gx, gy) the change of light-view
        depth over light x and y on a surface [m/m] and θ the angle between its normal and the sun:

        - ``side``: "receiver", or "caster" where constant and slope push casters back in the map
        - ``constant_m``: bias at any slope; under ``bias="auto"`` whole depth quanta and the
          rounding of float32 depths
        - ``slope_m``: to be multiplied by |gx| + |gy|, on casters by the larger of both
        - ``normal_offset_m``: to be multiplied by sin θ, along the normal
        - ``receiver_plane``: whether compares follow the receiver's plane
        - ``needed_constant_m``, ``needed_slope_m``: the least without acne on a plane, on the
          receiver's side: half a quantum, and the reach of the filter, none along a receiver plane
        - ``texel_m``: the larger side of a texel, ``quantum_m``: the step of stored depths

        Under a warp all of them hold at the map's centre. ``bias="auto"`` takes each side of a
        texel by itself and adds the float32 rounding of each receiver's own position
        (docs/numerics.md 11 and 30).

    Raises
    ------
    TypeError
        If `cascades` or `settings` is something else.
    """
    if not isinstance(cascades, Cascades):
        raise TypeError(f"cascades must be a csm.Cascades (got {type(cascades).__name__})")
    check_kinds(settings=settings)
    if settings.filter == "none":
        return []
    return _core.bias_metres(
        settings, cascades.clip_from_light, cascades.map_size, cascades.depth_range
    )


_boxes = weakref.WeakKeyDictionary()  # Scene to (m, 6) boxes of its parts
_boxes_lock = threading.Lock()


def part_boxes(scene):
    """Boxes of a scene's parts, worked out once while it lives; None where there are no parts."""
    if not isinstance(scene, Scene):
        return None
    with _boxes_lock:
        boxes = _boxes.get(scene)
    if boxes is None:
        boxes = _core.scene_boxes(
            core_meshes(scene), scene.instance_mesh, scene.world_from_instance, scene.origin
        )
        with _boxes_lock:
            _boxes[scene] = boxes
    return boxes
