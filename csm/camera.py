"""The camera: where it stands, what it sees, how many pixels it has."""

import math
from dataclasses import dataclass

import numpy as np

from .spaces import (
    as_number,
    as_vector,
    look_at_axes,
    ortho_rh_zo,
    perspective_rh_zo,
    view_from_axes,
)

__all__ = ["Camera"]

MAX_SIZE = 16384
ORTHONORMAL_TOLERANCE = 1e-9  # what the C core asks
_AXES = ("right", "up", "backward")


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera, perspective or orthographic.

    Use `look_at` or `orthographic`; the fields are what the C core works with.

    Parameters
    ----------
    eye : (3,) array_like
        World position [m].
    right, up, backward : (3,) array_like
        Orthonormal, right-handed world axes; the camera looks along ``-backward``.
    half_width, half_height : float
        Perspective: tangents of the half fields of view. Orthographic: half extents [m].
    near, far : float
        View depths of what is drawn [m]; ``0 < near < far`` (near of any sign if orthographic).
    size : (int, int)
        Width and height in pixels, each 1 to 16384.
    orthographic : bool
        Whether rays are parallel.
    centre_x, centre_y : float
        Where the picture's centre is seen, right of and above the view axis, in the units of
        `half_width`: tangents (perspective) or metres (orthographic). 0 but for off-centre frusta:
        tiles of a larger picture, a jitter of parts of a pixel (``2 * half_width / size[0]`` is
        one), the eyes of a headset, portals.

    Raises
    ------
    TypeError, ValueError
        If a value breaks its rule; the text names it.
    """

    eye: np.ndarray
    right: np.ndarray
    up: np.ndarray
    backward: np.ndarray
    half_width: float
    half_height: float
    near: float
    far: float
    size: tuple[int, int]
    orthographic: bool
    centre_x: float = 0.0
    centre_y: float = 0.0

    def __post_init__(self):
        put = object.__setattr__.__get__(self)
        for name in ("eye", *_AXES):
            put(name, as_vector(name, getattr(self, name)))
        axes = np.stack([getattr(self, name) for name in _AXES])
        error = np.abs(axes @ axes.T - np.eye(3)).max()
        if error > ORTHONORMAL_TOLERANCE or np.linalg.det(axes) < 0:
            raise ValueError(
                "right, up, backward must be orthonormal and right-handed to "
                f"{ORTHONORMAL_TOLERANCE:g} (got {axes.tolist()})"
            )
        for name in ("half_width", "half_height"):
            put(name, as_number(name, getattr(self, name), 1e-9, 1e9))
        for name in ("centre_x", "centre_y"):
            put(name, as_number(name, getattr(self, name), -1e9, 1e9))
        if not isinstance(self.orthographic, (bool, np.bool_)):
            raise TypeError(f"orthographic must be True or False (got {self.orthographic!r})")
        put("orthographic", bool(self.orthographic))
        near = as_number("near", self.near, rule="a finite view depth in metres")
        far = as_number("far", self.far, rule="a finite view depth in metres")
        if not self.orthographic and near <= 0.0:
            raise ValueError(f"near must be > 0 for a perspective camera (got near {near:g})")
        if far <= near:
            raise ValueError(f"far must be > near (got near {near:g}, far {far:g})")
        put("near", near)
        put("far", far)
        put("size", checked_size(self.size))

    @classmethod
    def look_at(
        cls,
        eye,
        target,
        up=(0.0, 1.0, 0.0),
        fov_y_deg=60.0,
        near=0.1,
        far=500.0,
        size=(1920, 1080),
        *,
        centre=(0.0, 0.0),
    ):
        """Make a perspective camera that looks from one point at another; pixels are square.

        Parameters
        ----------
        eye, target : (3,) array_like
            World points [m].
        up : (3,) array_like
            A direction that comes out upwards in the picture; not along the view.
        fov_y_deg : float
            Vertical field of view, between 0 and 180 degrees.
        near, far : float
            View depths of what is drawn [m], ``0 < near < far``.
        size : (int, int)
            Width and height in pixels.
        centre : (2,) array_like
            Tangents right of and above the view axis at which the picture's centre is seen.

        Returns
        -------
        camera : Camera

        Raises
        ------
        TypeError, ValueError
            If a value breaks its rule.
        """
        size = checked_size(size)
        half_height = _half_height(fov_y_deg)
        half_width = half_height * size[0] / size[1]
        axes = look_at_axes(eye, target, up)
        centre = as_vector("centre", centre, 2)
        return cls(eye, *axes, half_width, half_height, near, far, size, False, *centre)

    @property
    def fov_y_deg(self):
        """Vertical field of view [degrees] of the picture were its centre on the view axis.

        0 for an orthographic camera: its rays are parallel.
        """
        return 0.0 if self.orthographic else math.degrees(2.0 * math.atan(self.half_height))

    @property
    def view_from_world(self):
        """(4, 4) float64."""
        return view_from_axes(self.eye, self.right, self.up, self.backward)

    @property
    def clip_from_view(self):
        """(4, 4) float64, z from 0 at near to 1 at far."""
        w, h = self.half_width, self.half_height
        x, y = self.centre_x, self.centre_y
        if self.orthographic:
            return ortho_rh_zo(x - w, x + w, y - h, y + h, self.near, self.far)
        return perspective_rh_zo(w, h, self.near, self.far, (x, y))

    def pixel_plane(self):
        """Where the centres of the pixels are seen: x per column and y per row, row 0 on top.

        Returns
        -------
        x : (width,) float64
        y : (height,) float64
            Tangents right of and above the view axis (perspective) or metres (orthographic).
        """
        (width, height), columns, rows = self.size, *map(np.arange, self.size)
        x = self.centre_x + (2.0 * (columns + 0.5) / width - 1.0) * self.half_width
        y = self.centre_y + (1.0 - 2.0 * (rows + 0.5) / height) * self.half_height
        return x, y

    def translated(self, offset):
        """Move the camera.

        Parameters
        ----------
        offset : (3,) array_like
            World vector [m].

        Returns
        -------
        camera : Camera
        """
        return self.replace(eye=self.eye + as_vector("offset", offset))

    def replace(self, **changes):
        """Change some fields.

        Parameters
        ----------
        **changes
            Any field of the class, or ``fov_y_deg`` of a perspective camera. When `size` or
            `fov_y_deg` changes and `half_width` is not given, it follows so that pixels keep
            their shape; `centre_x` and `centre_y` stay.

        Returns
        -------
        camera : Camera

        Raises
        ------
        TypeError
            If a name is not a field.
        ValueError
            If a value breaks its rule.
        """
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}
        unknown = set(changes) - set(fields) - {"fov_y_deg"}
        if unknown:
            names = ", ".join([*fields, "fov_y_deg"])
            raise TypeError(f"Camera has no field {sorted(unknown)[0]!r}; it has {names}")
        if "fov_y_deg" in changes:
            if changes.get("orthographic", self.orthographic) or "half_height" in changes:
                raise TypeError(
                    "fov_y_deg is for perspective cameras and excludes half_height "
                    f"(got fov_y_deg {changes['fov_y_deg']!r})"
                )
            changes["half_height"] = _half_height(changes.pop("fov_y_deg"))
        fields.update(changes)
        if "half_width" not in changes:
            width, height = checked_size(fields["size"])
            pixel_shape = self.half_width * self.size[1] / (self.half_height * self.size[0])
            half_height = as_number("half_height", fields["half_height"], 1e-9, 1e9)
            if (half_height, width, height) != (self.half_height, *self.size):
                fields["half_width"] = half_height * width / height * pixel_shape
        return Camera(**fields)

    def _key(self):
        vectors = [tuple(getattr(self, name).tolist()) for name in ("eye", *_AXES)]
        scalars = (self.half_width, self.half_height, self.near, self.far)
        centre = (self.centre_x, self.centre_y)
        return (*vectors, *scalars, self.size, self.orthographic, *centre)

    def __eq__(self, other):
        return self._key() == other._key() if isinstance(other, Camera) else NotImplemented

    def __hash__(self):
        return hash(self._key())

    def __reduce__(self):
        return Camera, self._key()


def _orthographic(
    cls,
    eye,
    target,
    up=(0.0, 1.0, 0.0),
    height=10.0,
    near=0.1,
    far=500.0,
    size=(1920, 1080),
    *,
    centre=(0.0, 0.0),
):
    """Make a camera of parallel rays that looks from one point at another; pixels are square.

    Parameters
    ----------
    eye, target : (3,) array_like
        World points [m].
    up : (3,) array_like
        A direction that comes out upwards in the picture; not along the view.
    height : float
        What the picture spans from bottom to top [m].
    near, far : float
        View depths of what is drawn [m], ``near < far``. Near may be 0 or negative: shadows then
        need ``split="uniform"`` or ``"manual"``, as the other schemes take ratios of depths.
    size : (int, int)
        Width and height in pixels.
    centre : (2,) array_like
        Where the picture's centre is seen, right of and above the view axis [m].

    Returns
    -------
    camera : Camera

    Raises
    ------
    TypeError, ValueError
        If a value breaks its rule.
    """
    size = checked_size(size)
    half_height = 0.5 * as_number("height", height, 2e-9, 2e9)
    half_width = half_height * size[0] / size[1]
    axes = look_at_axes(eye, target, up)
    centre = as_vector("centre", centre, 2)
    return cls(eye, *axes, half_width, half_height, near, far, size, True, *centre)


# `Camera.orthographic(...)` makes a camera, `camera.orthographic` says whether it is one. Both
# names are fixed; a field and a method cannot share a class body, an instance value hides a
# class's method.
_orthographic.__name__ = "orthographic"
_orthographic.__qualname__ = "Camera.orthographic"
Camera.orthographic = classmethod(_orthographic)


def _half_height(fov_y_deg):
    rule = "an angle between 0 and 180 degrees"
    fov_y_deg = as_number("fov_y_deg", fov_y_deg, 1e-6, 180.0 - 1e-6, rule=rule)
    return math.tan(math.radians(0.5 * fov_y_deg))


def checked_size(size):
    """Check a (width, height) in pixels; TypeError or ValueError if it is none."""
    rule = f"(width, height) in whole pixels, each 1 to {MAX_SIZE}"
    try:
        numbers = tuple(size)
    except TypeError:
        raise TypeError(f"size must be {rule} (got {size!r})") from None
    if len(numbers) != 2 or not all(
        isinstance(n, (int, np.integer)) and not isinstance(n, bool) for n in numbers
    ):
        raise TypeError(f"size must be {rule} (got {size!r})")
    if not all(1 <= n <= MAX_SIZE for n in numbers):
        raise ValueError(f"size must be {rule} (got {numbers})")
    return int(numbers[0]), int(numbers[1])
