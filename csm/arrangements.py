"""What windows of cascades make of a coarse view, whatever the size of their maps."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import _core
from .cascades import fit_checked

__all__ = ["FARTHEST", "LEFT_OUT", "USUAL", "Arranged", "arrange", "fit_windows", "narrowest"]

# An edge cannot move further than the shadow is wide, which is not known: pixels at which it ends.
FARTHEST = 8.0
# Of the widest window: slices without receivers have windows of nothing.
NOTHING = 1e-3
USUAL = 2048  # side of maps, where one must be supposed
# Of the automatic bias: texels of slope, and the steepest slope.
BIAS_TEXELS, STEEPEST = 0.25, 1000.0
# Of what hard edges miss of penumbrae, the share that a kernel may leave out: a quarter of what
# taps miss (forecasts.SOFT_REST). Wider kernels thin the taps of narrow penumbrae.
LEFT_OUT = 0.05


@dataclass(frozen=True)
class Arranged:
    """What windows make of a view, by maps of one texel: sizes divide it.

    Attributes
    ----------
    moved : (e,) float64
        How far edges are displaced on average [pixels].
    reach : (e,) float64
        Across edges, of a disc as wide as the map [pixels].
    edge_cascade, receiver_cascade : (e,), (m,) int
        That answer for edges and receivers.
    receiver_bias : (m,) float64
        Along the light [m].
    displaced : list of float
        Edges' displacements by each cascade, times their lengths [pixels²].
    windows : (n,) float64
        Longer side of each window [m].
    held : list of bool
        Whether receivers lie between each one's splits.
    """

    moved: np.ndarray
    reach: np.ndarray
    edge_cascade: np.ndarray
    receiver_bias: np.ndarray
    receiver_cascade: np.ndarray
    displaced: list[float]
    windows: np.ndarray
    held: list[bool]

    @cached_property
    def wide(self):
        """Which windows hold more than nothing (n,)."""
        return self.windows > NOTHING * self.windows.max()


def fit_windows(view, settings, scene):
    """Windows round what a view shows.

    Parameters
    ----------
    view : View
    settings : ShadowSettings
    scene : Scene

    Returns
    -------
    cascades : Cascades
    """
    # windows round a sample alone would be smaller than real ones, and leave out edges
    return fit_checked(view.camera, view.sun, settings, scene, view.held)


def arrange(view, cascades, by_interval):
    """Read what windows make of a view's edges and receivers.

    Parameters
    ----------
    view : View
    cascades : Cascades
        From `fit_windows`.
    by_interval : bool
        Whether slices say which window answers, instead of the first that holds a point.

    Returns
    -------
    arranged : Arranged
    """
    windows = cascades.texel_size.max(axis=1) * cascades.map_size
    moved, reach, edge_cascade, bias, receiver_cascade, displaced, held = _core.arrange(
        view.camera,
        cascades.uvz_from_world,
        cascades.splits,
        windows,
        by_interval,
        view.held,
        view.gradients,
        view.axes,
        view.steps_across,
        view.edge_lengths,
        BIAS_TEXELS,
        STEEPEST,
        FARTHEST * USUAL,
    )
    return Arranged(
        moved,
        reach,
        edge_cascade,
        bias,
        receiver_cascade,
        displaced.tolist(),  # few numbers that much is made of: quicker without arrays
        windows,
        held.tolist(),
    )


def narrowest(reach, wide, lengths):
    """Least part of a map that leaves out no more of penumbrae than `LEFT_OUT`.

    Parameters
    ----------
    reach, wide, lengths : (e,) float64
        Of edges: of a disc as wide as the map, of their penumbrae, along them [pixels].

    Returns
    -------
    part : float
    """
    allowed = LEFT_OUT * float(lengths @ wide)
    if not allowed > 0.0:
        return 0.0
    return _core.least_part(reach, wide, lengths, allowed)
