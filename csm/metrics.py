"""Masks against the truth: how wrong, where, and how much theory says cannot be helped.

Everything works on arrays, so that images of other engines are judged by the same rules.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

__all__ = ["EdgeYardstick", "ErrorReport", "compare", "edge_yardstick", "undersampling"]

LIT = 0.5  # a mask of at least this counts as lit
NO_CASCADE = 255

# Every cause of the error budget (docs/numerics.md 15), and what telling it apart needs beside the
# two masks.
CAUSES = {
    "total": None,
    "aliasing": "exact visibility at the texels' centres",
    "penumbra": "exact visibility averaged over the filter's taps",
    "false_light": None,
    "false_shadow": None,
    "peter_panning": "the occluder's distance against the bias that was applied",
    "light_leak": "the occluder's distance against the bias that was applied",
    "seam": "the mask of the one cascade, without blend or fade",
}


class _ByCause(Mapping):
    """A value per cause; a cause of the full budget that is not there says what it would need."""

    def __init__(self, values):
        self._values = dict(values)

    def __getitem__(self, cause):
        if cause in self._values:
            return self._values[cause]
        if cause in CAUSES:
            raise ValueError(
                f"the error by {cause!r} needs {CAUSES[cause]}; "
                f"this report compares masks alone and has {', '.join(self._values)}"
            )
        raise KeyError(f"no cause {cause!r}; the causes are {', '.join(CAUSES)}")

    def __contains__(self, cause):
        return cause in self._values

    def __iter__(self):
        return iter(self._values)

    def __len__(self):
        return len(self._values)

    def __repr__(self):
        return repr(self._values)


@dataclass(frozen=True, eq=False)
class ErrorReport:
    """A mask against a reference. Made by `compare`.

    The causes, of two masks and of a Frame and a Truth alike: ``total``, the difference;
    ``false_light``, its part above 0 (brighter than the truth); ``false_shadow``, its part below 0
    (darker: acne, but also a shadow edge that reaches too far). They add up: ``total = false_light
    + false_shadow``.

    Attributes
    ----------
    per_pixel : mapping of str to (h, w) float64
        Signed error, -1 to 1, of each cause; 0 outside `judged`.
    judged : (h, w) bool
        Pixels that count: a surface that faces the sun and lies within the shadow range.
    wrong_side : (h, w) bool
        Judged pixels where one is lit (at least 0.5) and the other is not.
    beyond_range : float
        Share of the pixels with a sun-facing surface that no cascade covers, 0 to 1.
    """

    per_pixel: Mapping = field(repr=False)
    judged: np.ndarray = field(repr=False)
    wrong_side: np.ndarray = field(repr=False)
    beyond_range: float

    @cached_property
    def judged_count(self):
        """Number of judged pixels; where it is 0 every mean is NaN."""
        return int(np.count_nonzero(self.judged))

    @cached_property
    def disagreement(self):
        """Share of the judged pixels on the wrong side of 0.5. Blind to acne above it."""
        return self._share(np.count_nonzero(self.wrong_side))

    @cached_property
    def mean(self):
        """Mean of the absolute values, by cause."""
        return self._summary(lambda values: values.mean())

    @cached_property
    def percentile_99(self):
        """99th percentile of the absolute values, by cause."""
        return self._summary(lambda values: np.percentile(values, 99))

    @cached_property
    def largest(self):
        """Largest absolute value, by cause."""
        return self._summary(lambda values: values.max())

    @cached_property
    def root_mean_square(self):
        """Root of the mean square, by cause."""
        return self._summary(lambda values: np.sqrt(np.mean(values**2)))

    def to_dict(self):
        """Return the numbers as nested plain dicts and floats, NaN where nothing was judged."""
        by_cause = ("mean", "percentile_99", "largest", "root_mean_square")
        return {
            "disagreement": self.disagreement,
            **{name: dict(getattr(self, name)) for name in by_cause},
            "judged_count": self.judged_count,
            "judged_share": self.judged_count / self.judged.size,
            "beyond_range": self.beyond_range,
        }

    def __str__(self):
        if not self.judged_count:
            return "no pixel shows a surface that faces the sun within the shadow range"
        lines = [
            f"disagreement {self.disagreement:8.3%} of {self.judged_count} judged pixels",
            f"{'':13}{'mean':>9}{'99 %':>9}{'largest':>9}{'rms':>9}",
        ]
        for cause in self.mean:
            columns = (self.mean, self.percentile_99, self.largest, self.root_mean_square)
            numbers = "".join(f"{column[cause]:9.3%}" for column in columns)
            lines.append(f"{cause.replace('_', ' '):13}{numbers}")
        if self.beyond_range:
            lines.append(f"{self.beyond_range:.3%} of the sun-facing pixels are beyond the range")
        return "\n".join(lines)

    def _share(self, count):
        return count / self.judged_count if self.judged_count else float("nan")

    def _summary(self, reduce):
        if not self.judged_count:
            return _ByCause(dict.fromkeys(self.per_pixel, float("nan")))
        return _ByCause(
            {
                cause: float(reduce(np.abs(values[self.judged])))
                for cause, values in self.per_pixel.items()
            }
        )


def compare(frame, truth, *, valid=None):
    """Judge a mask by a reference.

    Parameters
    ----------
    frame : Frame or (h, w) array_like
        What was rendered: a Frame with `mask`, `valid` and `cascade_index`, or visibilities, 0 to
        1.
    truth : Truth or (h, w) array_like
        What is right: a Truth for a Frame, visibilities for an array. A soft truth is compared as
        it is, penumbrae and all.
    valid : (h, w) array_like of bool, optional
        With two arrays, the pixels to judge; all of them by default.

    Returns
    -------
    report : ErrorReport
        Over the pixels where frame and truth see a surface, it faces the sun and a cascade was
        chosen.

    Raises
    ------
    TypeError
        If one is an array and the other is not.
    ValueError
        If sizes differ, values leave [0, 1], the frame lacks an output that is needed, or frame and
        truth do not show the same camera and sun.
    """
    rendered, traced = hasattr(frame, "mask"), hasattr(truth, "mask")
    if rendered != traced:
        raise TypeError(
            "compare takes a Frame and a Truth, or two mask arrays "
            f"(got {type(frame).__name__} and {type(truth).__name__})"
        )
    if rendered:
        if valid is not None:
            raise TypeError("valid is for two arrays: a Frame and a Truth bring their own")
        return _compare_frame(frame, truth)
    mask, truth = _visibilities("frame", frame), _visibilities("truth", truth)
    _same_shape(mask, truth)
    judged = np.ones(mask.shape, bool) if valid is None else np.asarray(valid)
    if judged.dtype != bool or judged.shape != mask.shape:
        raise ValueError(
            f"valid must be a bool array of shape {mask.shape} "
            f"(got {judged.dtype}, shape {judged.shape})"
        )
    return _report(mask, truth, judged, beyond_range=0.0)


def _compare_frame(frame, truth):
    mask = _visibilities("frame.mask", _output(frame, "mask"))
    reference = _visibilities("truth.mask", truth.mask)
    _same_shape(mask, reference)
    for name in ("camera", "sun"):
        one, other = vars(getattr(frame, name)), vars(getattr(truth, name))
        for key in one:
            if not np.array_equal(one[key], other[key]):
                raise ValueError(
                    f"frame and truth must show the same {name} "
                    f"(their {key} is {one[key]} and {other[key]})"
                )
    facing = _output(frame, "valid") & truth.valid & truth.facing
    covered = _output(frame, "cascade_index") != NO_CASCADE
    if frame.settings.filter == "none":
        covered[...] = True  # the picture without shadows, a baseline: it has no range to be beyond
    facing_count = np.count_nonzero(facing)
    beyond = np.count_nonzero(facing & ~covered)
    return _report(
        mask, reference, facing & covered, beyond / facing_count if facing_count else 0.0
    )


def _report(mask, reference, judged, beyond_range):
    total = np.where(judged, mask - reference, 0.0)
    per_pixel = {
        "total": total,
        "false_light": np.maximum(total, 0.0),
        "false_shadow": np.minimum(total, 0.0),
    }
    wrong_side = judged & ((mask >= LIT) != (reference >= LIT))
    return ErrorReport(_ByCause(per_pixel), judged, wrong_side, float(beyond_range))


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
    index = _output(frame, "cascade_index")
    _same_shape(index, truth.mask)
    rows, columns = np.nonzero(truth.facing & (index != NO_CASCADE))
    cascade = index[rows, columns]
    point, normal = truth.position[rows, columns], truth.normal[rows, columns]
    camera = truth.camera

    # Gradients of u and v in texels; a step of one texel is what they are dual to in the surface.
    uvz = np.asarray(frame.cascades.uvz_from_world)[cascade]
    w = np.einsum("mk,mk->m", uvz[:, 3, :3], point) + uvz[:, 3, 3]
    uv = (np.einsum("mak,mk->ma", uvz[:, :2, :3], point) + uvz[:, :2, 3]) / w[:, None]
    gradient = (uvz[:, :2, :3] - uv[..., None] * uvz[:, 3:, :3]) / w[:, None, None]
    gradient *= np.asarray(frame.cascades.map_size)[cascade][:, None, None]
    across_v, across_u = (np.cross(gradient[:, k], normal) for k in (1, 0))
    volume = np.einsum("mk,mk->m", gradient[:, 0], across_v)
    step = np.stack([across_v, -across_u], axis=1) / volume[:, None, None]

    width, height = camera.size
    pixels = np.array([0.5 * width / camera.half_width, -0.5 * height / camera.half_height])
    across = np.stack([camera.right, camera.up])
    moved = np.einsum("aj,mkj->mak", across, step)
    if not camera.orthographic:
        # d(x / z) = (dx - (x / z) dz) / z
        relative = point - camera.eye
        depth = relative @ -camera.backward
        slant = (relative @ across.T) / depth[:, None]
        moved -= slant[:, :, None] * (step @ -camera.backward)[:, None, :]
        moved /= depth[:, None, None]
    jacobian = pixels[:, None] * moved  # (m, 2, 2): d(pixel) / d(texel)
    m = np.full(index.shape, np.nan)
    m[rows, columns] = _largest_singular_value(jacobian)
    return m


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


def edge_yardstick(frame, truth, *, largest=4.0):
    """Disagreement that a shadow map of this resolution is expected to have.

    A map compared at the nearest texel misplaces a shadow edge by a quarter of a texel on average:
    0.25 (edge along an axis of the map) to 0.236 (diagonal) of a texel of area per unit length.
    The edge's length in pixels is pi/4 times the number of neighbouring pixels that it separates
    (Cauchy and Crofton), a texel there is m pixels long (`undersampling`, the mean of the two
    pixels).

    Parameters
    ----------
    frame : Frame
    truth : Truth
    largest : float
        Cap of m [pixels per texel]: where a surface is nearly edge-on to the sun m has no bound and
        a single pixel would decide the sum.

    Returns
    -------
    yardstick : EdgeYardstick
        With its value: sum over separated pairs of ``(pi/4) min(m, largest) / 4``, divided by the
        judged pixels.
    """
    judged = compare(frame, truth).judged
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


def _output(frame, name):
    """Return an output of a frame, or say how to get it."""
    try:
        return np.asarray(getattr(frame, name))
    except AttributeError as error:
        raise ValueError(
            f"the frame's {name} is needed: ask for it with outputs ({error})"
        ) from error


def _visibilities(name, value):
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


def _same_shape(one, other):
    if one.shape != other.shape:
        raise ValueError(f"both masks must have one shape (got {one.shape} and {other.shape})")
