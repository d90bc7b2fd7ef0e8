"""Masks against the truth: how wrong, where, and how much theory says cannot be helped.

Everything works on arrays, so that images of other engines are judged by the same rules.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .causes import CAUSES, Stages
from .frame import Frame
from .sampling import (
    LIT,
    NO_CASCADE,
    EdgeYardstick,
    MissingOutput,
    edges_to_expect,
    expected_aliasing,
    output_of,
    undersampling,
    visibilities,
)
from .tracing import Truth

__all__ = ["EdgeYardstick", "ErrorReport", "compare", "edge_yardstick", "undersampling"]

ROUNDING = 1e-12  # of sums of weights that make 1
FAINT = 1e-4  # of a mask in float32: less is no shadow that anybody meant

# What telling a cause apart needs beside two masks.
NEEDS = {
    "aliasing": "exact visibility at the texels' centres",
    "perspective_aliasing": "exact visibility at the texels' centres",
    "projection_aliasing": "exact visibility at the texels' centres",
    "phase_aliasing": "exact visibility at the texels' centres",
    "penumbra": "exact visibility averaged over the filter's taps",
    "peter_panning": "the occluder's distance against the bias that was applied",
    "light_leak": "the occluder's distance against the bias that was applied",
    "seam": "the mask of the one cascade, without blend or fade",
}


class _ByCause(Mapping):
    """A value per cause, worked out when it is asked for; what is not there says what it needs."""

    def __init__(self, names, value_of):
        self._names, self._value_of, self._values = tuple(names), value_of, {}

    def __getitem__(self, cause):
        if cause not in self._names:
            if cause in NEEDS:
                raise ValueError(
                    f"the error by {cause!r} needs {NEEDS[cause]}; "
                    f"this report compares masks alone and has {', '.join(self._names)}"
                )
            raise KeyError(f"no cause {cause!r}; the causes are {', '.join(CAUSES)}")
        if cause not in self._values:
            self._values[cause] = self._value_of(cause)
        return self._values[cause]

    def __contains__(self, cause):
        return cause in self._names

    def __iter__(self):
        return iter(self._names)

    def __len__(self):
        return len(self._names)

    def __repr__(self):
        return f"<by cause: {', '.join(self._names)}>"


class _Masks:
    """Signed errors of two masks alone."""

    names = ("total", "false_light", "false_shadow")

    def __init__(self, mask, reference, judged):
        self.total = np.where(judged, mask - reference, 0.0)

    def __call__(self, cause):
        if cause == "total":
            return self.total
        bright = cause in ("false_light", "too_bright")
        return (np.maximum if bright else np.minimum)(self.total, 0.0)


class _Unshadowed(_Masks):
    """Signed errors of a frame drawn without shadows: they have no cause but that."""

    names = (*_Masks.names, "too_bright", "too_dark")


class _Budget(_Masks):
    """Signed errors of a frame by cause; what takes rays is traced when it is asked for."""

    names = CAUSES

    def __init__(self, mask, truth, stages):
        super().__init__(mask, truth.mask, stages.judged)
        self.stages = stages
        self.mask = mask

    def _difference(self, one, other):
        return np.where(self.stages.judged, one - other, 0.0)

    def __call__(self, cause):
        stages, truth = self.stages, self.stages.truth
        if cause in ("total", "too_bright", "too_dark"):
            return super().__call__(cause)
        if cause == "seam":
            return self._difference(self.mask, self.stages.single)
        if cause == "penumbra":
            softened = np.asarray(truth.mask_point, float) - np.asarray(truth.mask, float)
            return self._difference(stages.filtered - stages.at_texel_centres, -softened)
        if cause.endswith("aliasing"):
            aliasing = self._difference(stages.at_texel_centres, truth.mask_point)
            return aliasing * self._share(cause)
        rest = self._difference(stages.single, stages.filtered)
        if cause == "false_shadow":
            return np.minimum(rest, 0.0)
        return np.where(
            self._near_occluder == (cause == "peter_panning"), np.maximum(rest, 0.0), 0.0
        )

    @cached_property
    def _near_occluder(self):
        """Where the map lost a shadow whose occluder lies within the applied bias."""
        lost = self._difference(self.stages.single, self.stages.filtered) > ROUNDING
        return self.stages.near_occluder(lost)

    def _share(self, cause):
        if cause == "aliasing":
            return 1.0
        perspective, projection = self.stages.aliasing_shares
        if cause == "perspective_aliasing":
            return perspective
        if cause == "projection_aliasing":
            return projection
        return 1.0 - perspective - projection


class _Summary:
    """One number of the absolute values of a cause over the judged pixels."""

    def __init__(self, per_pixel, judged, kind):
        self.per_pixel, self.judged, self.kind = per_pixel, judged, kind

    def __call__(self, cause):
        values = np.abs(self.per_pixel[cause][self.judged])
        if not values.size:
            return float("nan")
        return float(SUMMARIES[self.kind](values))


SUMMARIES = {
    "mean": np.mean,
    "percentile_99": lambda values: np.percentile(values, 99),
    "largest": np.max,
    "root_mean_square": lambda values: np.sqrt(np.mean(values**2)),
}


@dataclass(frozen=True, eq=False)
class ErrorReport:
    """A mask against a reference. Made by `compare`.

    Of two masks alone the causes are ``total``, the difference, ``false_light``, its part above 0
    (brighter than the truth), and ``false_shadow``, its part below 0, which add up to it.

    Of a Frame and a Truth ``too_bright`` and ``too_dark`` are those parts, and the causes tell why.
    ``aliasing``: the texel's centre sees something else than the point; its parts by perspective
    (texels coarser than pixels on a surface that faces the camera), by projection (a surface turned
    from the light) and by phase (neither, but the texel's centre lies elsewhere). ``penumbra``:
    what the filter's kernel blurs, against a soft truth what it blurs unlike the sun's disc.
    Soft shadows (``pcss``) of a sun with a disc average no texels: they have no aliasing, what they
    err by where the truth sees a part of the disc is ``penumbra``, and the rest falls to the causes
    below; `expected_aliasing` says nothing of them.
    ``false_shadow``: darker than an exact map under the same filter: acne. ``peter_panning`` and
    ``light_leak``: brighter than that, with an occluder within the applied bias or without.
    ``seam``: what blending between cascades and fading change. ``total = aliasing + penumbra +
    false_shadow + peter_panning + light_leak + seam``, pixel by pixel. Each is traced when it is
    first asked for: a ray per judged pixel and texel of the filter's kernel.

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
        return self._summary("mean")

    @cached_property
    def percentile_99(self):
        """99th percentile of the absolute values, by cause."""
        return self._summary("percentile_99")

    @cached_property
    def largest(self):
        """Largest absolute value, by cause."""
        return self._summary("largest")

    @cached_property
    def root_mean_square(self):
        """Root of the mean square, by cause."""
        return self._summary("root_mean_square")

    @property
    def own_surface(self):
        """Judged pixels with false shadow whose own texel shows their own triangle: their number.

        Acne in the strict sense: the surface shadows itself.

        Raises
        ------
        ValueError
            If the report compares masks alone.
        """
        dark = self.per_pixel["false_shadow"] < -FAINT
        return int(np.count_nonzero(dark & self._stages("own_surface").own_surface))

    @cached_property
    def expected_aliasing(self):
        """Mean aliasing that theory expects of texels of this size along the truth's edges.

        See `csm.sampling.expected_aliasing`. A solid that stands on the ground adds to what is
        measured: near its foot a texel's centre may lie inside it.

        Raises
        ------
        ValueError
            If the report compares masks alone.
        """
        stages = self._stages("expected_aliasing")
        return stages.shared(
            "expected aliasing",
            lambda: expected_aliasing(stages.frame, stages.truth, stages.judged),
        )

    def _stages(self, name):
        budget = self.per_pixel._value_of
        if not isinstance(budget, _Budget):
            raise ValueError(f"{name} needs a Frame and a Truth; this report compares masks alone")
        return budget.stages

    def to_dict(self, causes=None):
        """Return the numbers as nested plain dicts and floats, NaN where nothing was judged.

        Parameters
        ----------
        causes : sequence of str, optional
            Those to work out; all of them by default.
        """
        by_cause = ("mean", "percentile_99", "largest", "root_mean_square")
        causes = tuple(self.per_pixel) if causes is None else causes
        return {
            "disagreement": self.disagreement,
            **{name: {one: getattr(self, name)[one] for one in causes} for name in by_cause},
            "judged_count": self.judged_count,
            "judged_share": self.judged_count / self.judged.size,
            "beyond_range": self.beyond_range,
        }

    def __str__(self):
        if not self.judged_count:
            return "no pixel shows a surface that faces the sun within the shadow range"
        lines = [
            f"disagreement {self.disagreement:8.3%} of {self.judged_count} judged pixels",
            f"{'':20}{'mean':>9}{'99 %':>9}{'largest':>9}{'rms':>9}",
        ]
        for cause in self.mean:
            columns = (self.mean, self.percentile_99, self.largest, self.root_mean_square)
            try:
                numbers = "".join(f"{column[cause]:9.3%}" for column in columns)
            except MissingOutput as error:  # what was not rendered does not hide the rest
                numbers = f"   needs the frame's {error.output}"
            lines.append(f"{cause.replace('_', ' '):20}{numbers}")
        if self.beyond_range:
            lines.append(f"{self.beyond_range:.3%} of the sun-facing pixels are beyond the range")
        return "\n".join(lines)

    def _share(self, count):
        return count / self.judged_count if self.judged_count else float("nan")

    def _summary(self, kind):
        return _ByCause(self.per_pixel, _Summary(self.per_pixel, self.judged, kind))


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
        If one is an array and the other is not, or a Truth comes first.
    ValueError
        If sizes differ, values leave [0, 1], the frame lacks an output that is needed, or frame and
        truth do not show the same camera and sun.
    """
    if isinstance(frame, Truth) or isinstance(truth, Frame):
        raise TypeError(
            "compare takes the Frame first and the Truth second "
            f"(got {type(frame).__name__} and {type(truth).__name__})"
        )
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
    mask, truth = visibilities("frame", frame), visibilities("truth", truth)
    _same_shape(mask, truth)
    judged = np.ones(mask.shape, bool) if valid is None else np.asarray(valid)
    if judged.dtype != bool or judged.shape != mask.shape:
        raise ValueError(
            f"valid must be a bool array of shape {mask.shape} "
            f"(got {judged.dtype}, shape {judged.shape})"
        )
    return _report(_Masks(mask, truth, judged), mask, truth, judged, beyond_range=0.0)


def _compare_frame(frame, truth):
    mask = visibilities("frame.mask", output_of(frame, "mask"))
    reference = visibilities("truth.mask", truth.mask)
    _same_shape(mask, reference)
    for name in ("camera", "sun"):
        one, other = vars(getattr(frame, name)), vars(getattr(truth, name))
        for key in one:
            if not np.array_equal(one[key], other[key]):
                raise ValueError(
                    f"frame and truth must show the same {name} "
                    f"(their {key} is {one[key]} and {other[key]})"
                )
    facing = output_of(frame, "valid") & truth.valid & truth.facing
    covered = output_of(frame, "cascade_index") != NO_CASCADE
    if frame.settings.filter == "none":
        covered[...] = True  # the picture without shadows, a baseline: it has no range to be beyond
    facing_count = np.count_nonzero(facing)
    beyond = np.count_nonzero(facing & ~covered)
    judged = facing & covered
    budget = _Unshadowed(mask, reference, judged)
    if hasattr(frame, "cascades") and hasattr(truth, "trace") and frame.settings.filter != "none":
        budget = _Budget(mask, truth, Stages(frame, truth, judged))
    return _report(budget, mask, reference, judged, beyond / facing_count if facing_count else 0.0)


def _report(budget, mask, reference, judged, beyond_range):
    wrong_side = judged & ((mask >= LIT) != (reference >= LIT))
    return ErrorReport(_ByCause(budget.names, budget), judged, wrong_side, float(beyond_range))


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
    return edges_to_expect(frame, truth, compare(frame, truth).judged, largest)


def _same_shape(one, other):
    if one.shape != other.shape:
        raise ValueError(f"both masks must have one shape (got {one.shape} and {other.shape})")
