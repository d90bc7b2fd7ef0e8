"""Spaces and the matrices between them, in numpy.

World and view are right-handed, y up in the world, metres; a camera looks down -z. Clip space has
x and y in [-1, 1] and z in [0, 1] with 0 at the near plane (``_rh_zo``: right-handed, zero to one).
Matrices act on column vectors and are named ``to_from``: ``clip_from_world = clip_from_view @
view_from_world``. The C core has its own copies of what rendering needs; tests hold both equal.
"""

import math

import numpy as np

__all__ = [
    "look_at",
    "look_at_axes",
    "ortho_rh_zo",
    "perspective_rh_zo",
    "sun_direction",
    "transform_directions",
    "transform_points",
]

# Two directions closer than this angle [rad] have no usable cross product: at 1e-6 the axes still
# come out orthonormal to 1e-10, which the C core asks of a camera (1e-9).
PARALLEL_RAD = 1e-6


def as_number(name, value, low=-math.inf, high=math.inf, *, rule=None):
    """Check that a value is a finite number in [low, high].

    Parameters
    ----------
    name : str
        How the argument is called where the user wrote it.
    value : object
        What the user gave.
    low, high : float
        Bounds, both allowed.
    rule : str, optional
        The rule in words; by default the bounds.

    Returns
    -------
    number : float

    Raises
    ------
    TypeError
        If the value is not a real number.
    ValueError
        If it is not finite or out of bounds.
    """
    rule = rule or f"a number from {low:g} to {high:g}"
    if isinstance(value, (bool, np.bool_, str, bytes)):
        raise TypeError(f"{name} must be {rule} (got {value!r})")
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be {rule} (got {value!r})") from None
    except OverflowError:  # a whole number without a float
        raise ValueError(f"{name} must be {rule} (got one of more than 300 digits)") from None
    if not math.isfinite(number) or not low <= number <= high:
        raise ValueError(f"{name} must be {rule} (got {number:g})")
    return number


def as_whole(name, value, low, high):
    """Check that a value is a whole number in [low, high]; TypeError or ValueError if not."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} must be a whole number from {low} to {high} (got {value!r})")
    return int(as_number(name, value, low, high))


def as_vector(name, value, length=3):
    """Copy a value to a read-only float64 vector of finite numbers.

    Parameters
    ----------
    name : str
        How the argument is called where the user wrote it.
    value : array_like
        What the user gave; it is copied.
    length : int
        How many numbers are wanted.

    Returns
    -------
    vector : (length,) float64

    Raises
    ------
    TypeError
        If the entries are not real numbers.
    ValueError
        If the shape is wrong or an entry is not finite.
    """
    given = real_array(name, value)
    if given.shape != (length,):
        raise ValueError(f"{name} must be {length} numbers (got shape {given.shape})")
    vector = given.astype(np.float64)
    if not np.isfinite(vector).all():
        raise ValueError(f"{name} must be finite (got {vector.tolist()})")
    return frozen(vector)


def frozen(array):
    """Make an array read-only and return it."""
    array.flags.writeable = False
    return array


def real_array(name, value):
    """Convert to an array of real numbers of whatever shape; TypeError if it is none."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be an array of real numbers ({error})") from None
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name} must be an array of real numbers (got dtype {array.dtype})")
    return array


def unit(name, value):
    """Normalise a vector, read-only (3,) float64; ValueError if it has no length."""
    vector = as_vector(name, value)
    largest = np.abs(vector).max()
    if largest == 0.0:
        raise ValueError(f"{name} must not be the zero vector (got {vector.tolist()})")
    # Dividing by the largest entry first keeps tiny and huge vectors from under- or overflowing.
    scaled = vector / largest
    direction = scaled / math.sqrt(scaled @ scaled)
    return frozen(direction)


def look_at_axes(eye, target, up=(0.0, 1.0, 0.0)):
    """Axes of a camera that looks from one point at another.

    Parameters
    ----------
    eye, target : (3,) array_like
        World points [m], not equal.
    up : (3,) array_like
        Any direction that is not along the view.

    Returns
    -------
    right, up, backward : (3,) float64
        Orthonormal, right-handed; the camera looks along ``-backward``.

    Raises
    ------
    ValueError
        If the points coincide or `up` is parallel to the view (within 1e-6 rad).
    """
    eye, target = as_vector("eye", eye), as_vector("target", target)
    if np.array_equal(eye, target):
        raise ValueError(f"target must differ from eye (both are {eye.tolist()})")
    backward = unit("eye - target", eye - target)
    upwards = unit("up", up)
    right = np.cross(upwards, backward)
    if math.sqrt(right @ right) < PARALLEL_RAD:
        raise ValueError(
            "up must not be parallel to the view direction "
            f"(got up {upwards.tolist()}, view {(-backward).tolist()})"
        )
    right = unit("right", right)
    # A second Gram-Schmidt pass: one pass leaves 1e-10 when up is nearly parallel to the view.
    right = unit("right", right - backward * (right @ backward))
    return right, unit("up", np.cross(backward, right)), backward


def look_at(eye, target, up=(0.0, 1.0, 0.0)):
    """`view_from_world` of a camera that looks from one point at another.

    Parameters
    ----------
    eye, target, up : (3,) array_like
        As in `look_at_axes`.

    Returns
    -------
    view_from_world : (4, 4) float64

    Raises
    ------
    ValueError
        As `look_at_axes`.
    """
    return view_from_axes(as_vector("eye", eye), *look_at_axes(eye, target, up))


def view_from_axes(eye, right, up, backward):
    """`view_from_world` (4, 4) from a position and an orthonormal basis."""
    view_from_world = np.eye(4)
    view_from_world[:3, :3] = right, up, backward
    view_from_world[:3, 3] = -(view_from_world[:3, :3] @ eye)
    return view_from_world


def perspective_rh_zo(half_width, half_height, near, far, centre=(0.0, 0.0)):
    """`clip_from_view` of a perspective camera, z from 0 at near to 1 at far.

    Parameters
    ----------
    half_width, half_height : float
        Tangents of the half fields of view.
    near, far : float
        View depths [m], ``0 < near < far``.
    centre : (2,) array_like
        Tangents right of and above the view axis at which the picture's centre is seen.

    Returns
    -------
    clip_from_view : (4, 4) float64
    """
    clip_from_view = np.zeros((4, 4))
    clip_from_view[0, 0] = 1.0 / half_width
    clip_from_view[1, 1] = 1.0 / half_height
    clip_from_view[0, 2] = centre[0] / half_width
    clip_from_view[1, 2] = centre[1] / half_height
    clip_from_view[2, 2] = -far / (far - near)
    clip_from_view[2, 3] = -near * far / (far - near)
    clip_from_view[3, 2] = -1.0
    return clip_from_view


def ortho_rh_zo(left, right, bottom, top, near, far):
    """`clip_from_view` of a box of parallel rays, z from 0 at near to 1 at far.

    Parameters
    ----------
    left, right, bottom, top : float
        Sides in view x and y [m].
    near, far : float
        View depths [m], ``near < far``, of any sign.

    Returns
    -------
    clip_from_view : (4, 4) float64
    """
    clip_from_view = np.eye(4)
    clip_from_view[0, 0] = 2.0 / (right - left)
    clip_from_view[1, 1] = 2.0 / (top - bottom)
    clip_from_view[2, 2] = -1.0 / (far - near)
    clip_from_view[0, 3] = -(right + left) / (right - left)
    clip_from_view[1, 3] = -(top + bottom) / (top - bottom)
    clip_from_view[2, 3] = -near / (far - near)
    return clip_from_view


def sun_direction(azimuth_deg, elevation_deg):
    """Point to the sun: the unit vector of its angles.

    Parameters
    ----------
    azimuth_deg : float
        0 is +z (south on a map), 90 is +x (east).
    elevation_deg : float
        Height over the horizon, -90 to 90.

    Returns
    -------
    to_light : (3,) float64
        ``(cos el sin az, sin el, cos el cos az)``; exact at multiples of 90 degrees.

    Raises
    ------
    ValueError
        If an angle is not finite or the elevation out of range.
    """
    azimuth_deg = as_number("azimuth_deg", azimuth_deg, rule="a finite angle in degrees")
    elevation_deg = as_number("elevation_deg", elevation_deg, -90.0, 90.0)
    sin_az, cos_az = _sin_cos_deg(azimuth_deg)
    sin_el, cos_el = _sin_cos_deg(elevation_deg)
    return np.array([cos_el * sin_az, sin_el, cos_el * cos_az])


def light_gradients(sun):
    """Two unit vectors (2, 3) across the light, for lengths in metres."""
    light = sun.to_light.tolist()
    least = min(range(3), key=lambda axis: abs(light[axis]))
    x_axis = np.array(_cross(light, [float(axis == least) for axis in range(3)]))
    x_axis /= math.sqrt(x_axis @ x_axis)
    return np.array([x_axis, _cross(light, x_axis.tolist())])


def _cross(one, other):
    """What ``np.cross`` gives of two vectors, which takes twenty times as long."""
    (a, b, c), (x, y, z) = one, other
    return [b * z - c * y, c * x - a * z, a * y - b * x]


def _sin_cos_deg(angle_deg):
    """Sine and cosine; 0 and +-1 exactly at the axes, where a hard shadow shows 6e-17."""
    quarter, rest = divmod(angle_deg, 90.0)
    sine, cosine = math.sin(math.radians(rest)), math.cos(math.radians(rest))
    return ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))[int(quarter) % 4]


def transform_points(matrix, points):
    """Points through a matrix, with the division by w where the matrix is projective.

    Parameters
    ----------
    matrix : (4, 4) array_like
        ``to_from``, acting on column vectors.
    points : (..., 3) array_like

    Returns
    -------
    points : (..., 3) float64
        Where w is 0 the result is inf or NaN: such a point has no image.
    """
    matrix, points = np.asarray(matrix, np.float64), np.asarray(points, np.float64)
    out = points @ matrix[:3, :3].T + matrix[:3, 3]
    if not np.array_equal(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        with np.errstate(divide="ignore", invalid="ignore"):
            out /= (points @ matrix[3, :3] + matrix[3, 3])[..., None]
    return out


def transform_directions(matrix, directions):
    """Directions (differences of points) through an affine matrix: its translation is left out.

    Parameters
    ----------
    matrix : (4, 4) array_like
        ``to_from``, affine.
    directions : (..., 3) array_like

    Returns
    -------
    directions : (..., 3) float64
        Not normalised.
    """
    return np.asarray(directions, np.float64) @ np.asarray(matrix, np.float64)[:3, :3].T
