"""Other measures: edges, penumbrae, seams between cascades, what texels are for, what keeps still.

See docs/numerics.md 15.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from .metrics import compare
from .sampling import LIT, pixels_per_texel, undersampling
from .settings import ShadowSettings
from .tracing import Truth

__all__ = [
    "EdgeDistances",
    "PenumbraError",
    "SeamSteps",
    "SettingsStability",
    "TexelUse",
    "boundary_distance",
    "penumbra_error",
    "seam_steps",
    "settings_stability",
    "texel_use",
]


@dataclass(frozen=True, eq=False)
class EdgeDistances:
    """How far shadow edges are from where they should be. Made by `boundary_distance`.

    Attributes
    ----------
    from_mask : (k,) float64
        From each edge of the mask to the nearest of the truth [pixels]; inf without any.
    from_truth : (l,) float64
        From each edge of the truth to the nearest of the mask [pixels]: edges that were lost.
    """

    from_mask: np.ndarray = field(repr=False)
    from_truth: np.ndarray = field(repr=False)

    @property
    def mean(self):
        """Mean of both [pixels]; NaN without edges."""
        return _mean(np.concatenate([self.from_mask, self.from_truth]))

    @property
    def percentile_95(self):
        """95th percentile of both [pixels]; NaN without edges."""
        both = np.concatenate([self.from_mask, self.from_truth])
        return float(np.percentile(both, 95)) if both.size else float("nan")

    @property
    def largest(self):
        """Largest of both [pixels], the Hausdorff distance; NaN without edges."""
        both = np.concatenate([self.from_mask, self.from_truth])
        return float(both.max()) if both.size else float("nan")


def boundary_distance(frame, truth):
    """Distance between the shadow edges of a mask and of the truth, in pixels.

    Edges lie between neighbouring judged pixels on different sides of one half.

    Parameters
    ----------
    frame : Frame
    truth : Truth

    Returns
    -------
    distances : EdgeDistances

    Raises
    ------
    TypeError
        If they are plain arrays, or anything else.
    """
    judged = _report("boundary_distance", frame, truth).judged
    mask, reference = _edges(frame.mask, judged), _edges(truth.mask, judged)
    return EdgeDistances(_nearest(mask, reference), _nearest(reference, mask))


def _report(name, frame, truth):
    """Compare a Frame and a Truth; plain arrays have neither surfaces nor cascades."""
    if not hasattr(frame, "cascades") or not isinstance(truth, Truth):
        raise TypeError(
            f"{name} takes a Frame and a Truth "
            f"(got {type(frame).__name__} and {type(truth).__name__}); csm.compare judges arrays"
        )
    return compare(frame, truth)


def _edges(mask, judged):
    """(k, 2) row and column of the middle of every edge between two pixels."""
    lit = np.asarray(mask) >= LIT
    places = []
    for one, other, shift in (
        (np.s_[:, :-1], np.s_[:, 1:], (0.0, 0.5)),
        (np.s_[:-1, :], np.s_[1:, :], (0.5, 0.0)),
    ):
        edge = judged[one] & judged[other] & (lit[one] != lit[other])
        places.append(np.argwhere(edge) + np.array(shift))
    return np.concatenate(places)


def _nearest(places, others):
    """Distance from each place (k, 2) to the nearest of others (l, 2); inf without any."""
    if not len(others):
        return np.full(len(places), np.inf)
    nearest = np.empty(len(places))
    step = max(1, 4_000_000 // len(others))
    for first in range(0, len(places), step):
        part = places[first : first + step]
        apart = part[:, None, :] - others[None, :, :]
        nearest[first : first + step] = np.sqrt((apart**2).sum(axis=-1).min(axis=1))
    return nearest


@dataclass(frozen=True)
class PenumbraError:
    """A mask's penumbrae against those of the sun's disc. Made by `penumbra_error`.

    Attributes
    ----------
    root_mean_square : float
        Of the difference, over pixels where mask or truth is neither lit nor dark; NaN without any.
    bias : float
        Mean of the difference there: above 0 too bright.
    width_ratio : float
        How wide the mask's penumbrae are beside the truth's: the ratio of the sums of v (1 - v),
        which over a ramp is a sixth of its width; NaN where the truth has none.
    pixel_count : int
    """

    root_mean_square: float
    bias: float
    width_ratio: float
    pixel_count: int


def penumbra_error(frame, truth):
    """Penumbrae of a mask against a soft truth.

    Parameters
    ----------
    frame : Frame
    truth : Truth
        With more than one ray per pixel.

    Returns
    -------
    error : PenumbraError

    Raises
    ------
    TypeError
        If they are plain arrays, or anything else.
    ValueError
        If the truth is that of a point sun.
    """
    judged = _report("penumbra_error", frame, truth).judged
    if truth.rays_per_pixel == 1:
        raise ValueError("penumbra_error needs a soft truth: csm.truth(..., rays_per_pixel=64)")
    mask, soft = (np.asarray(one.mask, np.float64)[judged] for one in (frame, truth))
    partial = ((mask > 0.0) & (mask < 1.0)) | ((soft > 0.0) & (soft < 1.0))
    difference = (mask - soft)[partial]
    widths = [(one * (1.0 - one)).sum() for one in (mask, soft)]
    return PenumbraError(
        float(np.sqrt(_mean(difference**2))),
        _mean(difference),
        float(widths[0] / widths[1]) if widths[1] > 0.0 else float("nan"),
        int(np.count_nonzero(partial)),
    )


@dataclass(frozen=True)
class SeamSteps:
    """Steps of a mask where cascades meet that the truth does not have. Made by `seam_steps`.

    Attributes
    ----------
    pair_count : int
        Neighbouring judged pixels that different cascades answer for.
    excess : float
        By how much the mask differs more within such a pair than the truth, 0 where it differs
        less: the mean over them all; NaN without any.
    """

    pair_count: int
    excess: float

    @property
    def per_thousand(self):
        """Steps from dark to lit, or as much in parts of them, per 1000 such pairs."""
        return 1000.0 * self.excess


def seam_steps(frame, truth):
    """How visible the boundaries between cascades are.

    The cause ``seam`` of `csm.compare` is what blending and fading change; this is what is seen of
    two cascades that disagree, blended or not.

    Parameters
    ----------
    frame : Frame
    truth : Truth

    Returns
    -------
    steps : SeamSteps

    Raises
    ------
    TypeError
        If they are plain arrays, or anything else.
    """
    judged = _report("seam_steps", frame, truth).judged
    index = np.asarray(frame.cascade_index)
    mask, reference = (np.asarray(one.mask, np.float64) for one in (frame, truth))
    excess = []
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :])):
        pair = judged[one] & judged[other] & (index[one] != index[other])
        steps, true = (np.abs(of[one] - of[other])[pair] for of in (mask, reference))
        excess.append(np.maximum(steps - true, 0.0))
    excess = np.concatenate(excess)
    return SeamSteps(len(excess), _mean(excess))


@dataclass(frozen=True, eq=False)
class TexelUse:
    """What the texels of each map are used for. Made by `texel_use`.

    Attributes
    ----------
    used : (n,) int
        Texels that hold the point of a judged pixel of their cascade.
    utilisation : (n,) float64
        Their share of the map, 0 to 1.
    receivers : (n,) float64
        Share of the judged pixels that each map answers for.
    texels_per_pixel : (h, w) float64
        Texels in the area of a pixel; NaN where not judged.
    coarsest : (h, w) float64
        Length of a texel in pixels where it is longest, as `csm.metrics.undersampling`.
    """

    used: np.ndarray
    utilisation: np.ndarray
    receivers: np.ndarray
    texels_per_pixel: np.ndarray = field(repr=False)
    coarsest: np.ndarray = field(repr=False)

    @property
    def wasted(self):
        """(n,) share of the texels of each map that no judged pixel lies in."""
        return 1.0 - self.utilisation

    def histogram(self, edges):
        """Share of the judged pixels by texels per pixel.

        Parameters
        ----------
        edges : sequence of float
            Ascending; below the first and above the last count too.

        Returns
        -------
        shares : (len(edges) + 1,) float64
        """
        known = self.texels_per_pixel[np.isfinite(self.texels_per_pixel)]
        bins = np.searchsorted(np.asarray(edges, float), known, side="right")
        return np.bincount(bins, minlength=len(edges) + 1) / max(len(known), 1)


def texel_use(frame, truth):
    """Which texels the picture uses, and how many a pixel gets.

    Parameters
    ----------
    frame : Frame
    truth : Truth

    Returns
    -------
    use : TexelUse

    Raises
    ------
    TypeError
        If they are plain arrays, or anything else.
    """
    report = _report("texel_use", frame, truth)
    cascades, index = frame.cascades, np.asarray(frame.cascade_index)
    sizes = np.asarray(cascades.map_size, np.int64)
    used = np.zeros(cascades.count, np.int64)
    answered = np.zeros(cascades.count)
    for i in range(cascades.count):
        own = report.judged & (index == i)
        point = truth.position[own]
        uvz = np.asarray(cascades.uvz_from_world[i])
        w = point @ uvz[3, :3] + uvz[3, 3]
        texel = np.floor((point @ uvz[:2, :3].T + uvz[:2, 3]) / w[:, None] * sizes[i]).astype(int)
        texel = np.clip(texel, 0, sizes[i] - 1)
        used[i] = len(np.unique(texel[:, 1] * sizes[i] + texel[:, 0]))
        answered[i] = np.count_nonzero(own) / max(report.judged_count, 1)
    jacobian = np.where(report.judged[..., None, None], pixels_per_texel(frame, truth), np.nan)
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # numpy flags the NaN of what is not judged
        area = np.abs(np.linalg.det(jacobian))
        density = 1.0 / area
    coarsest = np.where(report.judged, undersampling(frame, truth), np.nan)
    return TexelUse(used, used / sizes**2, answered, density, coarsest)


@dataclass(frozen=True)
class SettingsStability:
    """How often settings change along a path. Made by `settings_stability`.

    Attributes
    ----------
    steps : int
        From each frame to the next.
    changed : tuple of int
        Frames whose settings differ from those of the frame before.
    by_effect : dict of str to int
        Changes of each setting that changed at all.
    returns : int
        Changes of a setting back to what it was before its last change: choices that flicker.
    """

    steps: int
    changed: tuple[int, ...]
    by_effect: dict[str, int]
    returns: int

    @property
    def changed_share(self):
        """Share of the steps at which anything changed; NaN without steps."""
        return len(self.changed) / self.steps if self.steps else float("nan")

    def __str__(self):
        if not self.changed:
            return f"the same settings over {self.steps} steps"
        most = sorted(self.by_effect.items(), key=lambda item: -item[1])
        return (
            f"{len(self.changed)} of {self.steps} steps change settings ("
            + ", ".join(f"{name} {count}" for name, count in most)
            + f"); {self.returns} changes go back"
        )


def settings_stability(path):
    """Whether the choice of settings keeps still along a path.

    Parameters
    ----------
    path : sequence of ShadowSettings, Recommendation or Frame
        In the order of the frames. Compared is the canonical form, which is what is drawn.

    Returns
    -------
    stability : SettingsStability

    Raises
    ------
    TypeError
        If one of them is none of these, or it is one of these itself.
    """
    if not isinstance(path, Iterable):
        raise TypeError(
            "path must be a sequence of ShadowSettings, Recommendations or Frames "
            f"(got one {type(path).__name__})"
        )
    drawn = []
    for number, one in enumerate(path):
        settings = getattr(one, "settings", one)
        if not isinstance(settings, ShadowSettings):
            raise TypeError(
                f"path must hold ShadowSettings, Recommendations or Frames "
                f"(got {type(one).__name__} at {number})"
            )
        drawn.append(settings.canonical().to_dict())
    changed, by_effect, before, returns = set(), {}, {}, 0
    for number, (last, now) in enumerate(pairwise(drawn), 1):
        for name, value in now.items():
            if value == last[name]:
                continue
            changed.add(number)
            by_effect[name] = by_effect.get(name, 0) + 1
            returns += name in before and before[name] == value
            before[name] = last[name]
    return SettingsStability(
        max(len(drawn) - 1, 0), tuple(sorted(changed)), by_effect, int(returns)
    )


def _mean(values):
    return float(values.mean()) if values.size else float("nan")
