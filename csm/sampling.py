"""How coarse a shadow map is against the picture, and what theory expects of that."""

from dataclasses import dataclass

import numpy as np

__all__ = [
    "EdgeYardstick",
    "edge_slopes",
    "edges_to_expect",
    "expected_aliasing",
    "mean_displacement",
    "output_of",
    "pixels_per_texel",
    "surface_steps",
    "undersampling",
    "uv_gradients",
    "visibilities",
]

LIT = 0.5  # a mask of at least this counts as lit
NO_CASCADE = 255


def visibilities(name, value):
    """Check visibilities.

    Parameters
    ----------
    name : str
        What the refusal calls them.
    value : (h, w) array_like

    Returns
    -------
    visibilities : (h, w) float64

    Raises
    ------
    ValueError
        If it is no such array or leaves [0, 1].
    """
    array = np.asarray(value)
    if array.dtype.kind not in "fiub" or array.ndim != 2:
        raise ValueError(
            f"{name} must be an (h, w) array of real numbers "
            f"(got shape {array.shape}, dtype {array.dtype})"
        )
    array = array.astype(np.float64)
    outside = ~((array >= 0.0) & (array <= 1.0))
    if outside.any():
        raise ValueError(
            f"{name} must lie in [0, 1], where 1 is lit "
            f"(got {array[outside][0]:g} and {np.count_nonzero(outside) - 1} more)"
        )
    return array


def undersampling(frame, truth):
    """How many pixels a texel of the shadow map covers, at its longest.

    A step of one texel moves the shadow's sample along the surface; m is the largest stretch of
    that map from texels to pixels (the largest singular value of its Jacobian), at most 1 where
    the map is as fine as the picture. It grows without bound as the surface turns from the sun.
    Texels are where `uvz_from_world` puts them, so a skewed light and a warp count as they are.

    Parameters
    ----------
    frame : Frame
        For `cascade_index`, `cascades` and the camera.
    truth : Truth
        For position and normal of the surfaces.

    Returns
    -------
    m : (h, w) float64
        Pixels per texel; NaN where no cascade was chosen or the surface does not face the sun.
    """
    jacobian = pixels_per_texel(frame, truth)
    return _largest_singular_value(jacobian.reshape(-1, 2, 2)).reshape(jacobian.shape[:2])


def pixels_per_texel(frame, truth):
    """How a step of one texel in u and v moves the shadow's sample in the picture.

    Parameters
    ----------
    frame : Frame
        For `cascade_index`, `cascades` and the camera.
    truth : Truth
        For position and normal of the surfaces.

    Returns
    -------
    jacobian : (h, w, 2, 2) float64
        ``[..., x or y, u or v]``, pixels to the right and down; NaN where no cascade was chosen or
        the surface does not face the sun.
    """
    index = output_of(frame, "cascade_index")
    if index.shape != truth.mask.shape:
        raise ValueError(
            f"frame and truth must have one size (got {index.shape} and {truth.mask.shape})"
        )
    rows, columns = np.nonzero(truth.facing & (index != NO_CASCADE))
    cascade = index[rows, columns]
    point, normal = truth.position[rows, columns], truth.normal[rows, columns]

    # gradients of u and v in texels
    gradient = uv_gradients(np.asarray(frame.cascades.uvz_from_world)[cascade], point)
    gradient *= np.asarray(frame.cascades.map_size)[cascade][:, None, None]
    jacobian = np.full((*index.shape, 2, 2), np.nan)
    jacobian[rows, columns] = surface_steps(truth.camera, point, normal, gradient)
    return jacobian


def uv_gradients(uvz_from_world, points):
    """How u and v of a map change at points of the world; under a warp from place to place.

    Parameters
    ----------
    uvz_from_world : (m, 4, 4) float64
        Of the map that each point falls into.
    points : (m, 3) float64

    Returns
    -------
    gradients : (m, 2, 3) float64
        Of u and v, 0 to 1 over the map, per metre.
    """
    uvz = uvz_from_world
    w = np.einsum("mk,mk->m", uvz[:, 3, :3], points) + uvz[:, 3, 3]
    uv = (np.einsum("mak,mk->ma", uvz[:, :2, :3], points) + uvz[:, :2, 3]) / w[:, None]
    return (uvz[:, :2, :3] - uv[..., None] * uvz[:, 3:, :3]) / w[:, None, None]


def surface_steps(camera, points, normals, gradients):
    """How steps in light space move points of a surface in the picture.

    A step of one along one coordinate of light space, the other staying, moves along the surface by
    the vector dual to the coordinates' gradients there.

    Parameters
    ----------
    camera : Camera
    points, normals : (m, 3) float64
        On surfaces, world space.
    gradients : (2, 3) or (m, 2, 3) float64
        Of the two coordinates, per metre.

    Returns
    -------
    steps : (m, 2, 2) float64
        ``[point, right or down, coordinate]`` [pixels of the camera].
    """
    gradients = np.broadcast_to(gradients, (len(points), 2, 3))
    along_u, along_v = _cross(gradients[:, 1], normals), _cross(normals, gradients[:, 0])
    volume = np.einsum("mk,mk->m", gradients[:, 0], along_u)
    volume = np.where(volume == 0.0, 1e-300, volume)
    step = np.stack([along_u, along_v], axis=1) / volume[:, None, None]
    across = np.stack([camera.right, camera.up])
    moved = np.einsum("aj,mkj->mak", across, step)
    if not camera.orthographic:
        # d(x / z) = (dx - (x / z) dz) / z
        relative = points - camera.eye
        depth = relative @ -camera.backward
        slant = (relative @ across.T) / depth[:, None]
        moved = moved - slant[:, :, None] * (step @ -camera.backward)[:, None, :]
        moved = moved / depth[:, None, None]
    width, height = camera.size
    pixels = np.array([0.5 * width / camera.half_width, -0.5 * height / camera.half_height])
    return pixels[:, None] * moved


def _cross(one, other):
    """Products (m, 3) of rows, as of ``np.cross``, which takes three times as long."""
    (a, b, c), (x, y, z) = one.T, other.T
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


def _largest_singular_value(matrices):
    """Return it for (m, 2, 2): a turn and a reflection, each with its own scale, added up."""
    a, b, c, d = np.moveaxis(matrices.reshape(-1, 4), 1, 0)
    return 0.5 * (np.hypot(a + d, c - b) + np.hypot(a - d, c + b))


@dataclass(frozen=True)
class EdgeYardstick:
    """What sampling alone is expected to get wrong along shadow edges.

    Attributes
    ----------
    value : float
        Expected disagreement, a share of the judged pixels; NaN without any.
    edge_pairs : int
        Neighbouring judged pixels on different sides of 0.5 in the truth.
    judged_count : int
        Below 100 the value means nothing.
    """

    value: float
    edge_pairs: int
    judged_count: int

    def __float__(self):
        return self.value


def expected_aliasing(frame, truth, judged):
    """Share of the judged pixels that texels of this size and place are expected to misjudge.

    An edge is displaced by what lies between a point and its texel's centre, anywhere within half
    a texel along u and v. With a = Jᵀn, the edge's normal n in the picture taken back to texels,
    the mean of |n . J d| over that square is ``max/4 + min²/(12 max)`` of |a_u| and |a_v|: a
    quarter of a texel for an edge along an axis, 0.236 for a diagonal one. Lengths are summed over
    neighbouring pixels that the edge separates, those in a row weighted by |n_x| and those in a
    column by |n_y|.

    Parameters
    ----------
    frame : Frame
    truth : Truth
        The point sun's visibility counts.
    judged : (h, w) bool

    Returns
    -------
    share : float
        NaN where nothing is judged.
    """
    count = np.count_nonzero(judged)
    if not count:
        return float("nan")
    lit = np.asarray(truth.mask_point) >= LIT
    jacobian = pixels_per_texel(frame, truth)
    slope_x, slope_y = edge_slopes(lit)
    expected = 0.0
    for one, other, axis in (
        (np.s_[:, :-1], np.s_[:, 1:], 0),
        (np.s_[:-1, :], np.s_[1:, :], 1),
    ):
        edge = judged[one] & judged[other] & (lit[one] != lit[other])
        normal = np.stack([(slope[one] + slope[other])[edge] for slope in (slope_x, slope_y)], -1)
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        normal /= np.where(length > 0.0, length, 1.0)
        taken = 0.5 * (jacobian[one] + jacobian[other])[edge]
        mean = mean_displacement(np.abs(np.einsum("ma,mak->mk", normal, taken)))
        expected += float((mean * np.abs(normal[:, axis])).sum())
    return expected / count


def mean_displacement(across):
    """Mean of ``|a . d|`` for d uniform over a texel's square: how far an edge is displaced.

    Parameters
    ----------
    across : (m, 2) float64
        ``|a_u|`` and ``|a_v|``: the edge's direction taken back to texels.

    Returns
    -------
    mean : (m,) float64
        ``max / 4 + min² / (12 max)``.
    """
    least, most = np.minimum(*across.T), np.maximum(*across.T)
    return most / 4.0 + least**2 / (12.0 * np.maximum(most, 1e-12))


def edge_slopes(lit):
    """Which way it gets lighter at every pixel, smoothed over 5 x 5 of them.

    Parameters
    ----------
    lit : (h, w) bool

    Returns
    -------
    slope_x, slope_y : (h, w) float64
        Along columns and rows; 0 along a side of one pixel, where nothing changes.
    """
    smooth = _smoothed(lit.astype(np.float64))
    slope_y, slope_x = (
        np.gradient(smooth, axis=axis) if smooth.shape[axis] > 1 else np.zeros_like(smooth)
        for axis in (0, 1)
    )
    return slope_x, slope_y


def _smoothed(values):
    """Binomial mean over 5 x 5 pixels: the direction of an edge of pixels, not of a stair."""
    padded = np.pad(values, 2, mode="edge")
    rows = sum(w * padded[k : k + values.shape[0]] for k, w in enumerate((1, 4, 6, 4, 1)))
    return sum(w * rows[:, k : k + values.shape[1]] for k, w in enumerate((1, 4, 6, 4, 1))) / 256.0


def edges_to_expect(frame, truth, judged, largest):
    """Expected disagreement over judged pixels; see `csm.metrics.edge_yardstick`.

    Parameters
    ----------
    frame : Frame
    truth : Truth
    judged : (h, w) bool
    largest : float
        Cap of m [pixels per texel].

    Returns
    -------
    yardstick : EdgeYardstick
    """
    m = np.minimum(undersampling(frame, truth), largest)
    lit = truth.mask >= LIT
    expected, pairs = 0.0, 0
    for one, other in (
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[:-1, :], np.s_[1:, :]),
    ):
        edge = judged[one] & judged[other] & (lit[one] != lit[other])
        pairs += int(np.count_nonzero(edge))
        expected += float((0.5 * (m[one] + m[other]))[edge].sum()) * (np.pi / 4.0) / 4.0
    count = int(np.count_nonzero(judged))
    return EdgeYardstick(expected / count if count else float("nan"), pairs, count)


class MissingOutput(ValueError):
    """A frame was rendered without an output that is needed."""

    def __init__(self, output):
        super().__init__(
            f"the frame's {output} is needed: ask for it with outputs=(..., {output!r})"
        )
        self.output = output


def output_of(frame, name):
    """Return an output of a frame, or say how to get it."""
    try:
        return np.asarray(getattr(frame, name))
    except AttributeError as error:
        raise MissingOutput(name) from error
