"""What windows of cascades make of a coarse view, whatever the size of their maps."""

from functools import cached_property

from . import _core
from .cascades import part_boxes

__all__ = ["FARTHEST", "LEFT_OUT", "USUAL", "Arranged", "narrowest"]

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


class Arranged:
    """Windows round what a view shows, and what they make of it.

    By maps of one texel: sizes divide it. What holds at every point is worked out when it is asked
    for: most windows are only compared by their sums.

    Attributes
    ----------
    uvz_from_world : (n, 4, 4) float64
    windows : (n,) float64
        Longer side of each window [m].
    displaced : list of float
        Edges' displacements by each cascade, times their lengths [pixels²].
    held : list of bool
        Whether receivers, edges or outline lie between each one's splits.
    """

    def __init__(self, view, settings, scene):
        self._view, self._by_interval = view, settings.select == "interval"
        # windows round a sample alone would be smaller than real ones, and leave out edges
        self.uvz_from_world, self._splits, self.windows, self.displaced, self.held = _core.arrange(
            view,
            settings,
            scene.bounds.ravel(),
            part_boxes(scene) if settings.fit == "focus" else None,
            FARTHEST * USUAL,
        )

    @cached_property
    def wide(self):
        """Which windows hold more than nothing (n,)."""
        return self.windows > NOTHING * self.windows.max()

    @cached_property
    def _points(self):
        return _core.arranged_points(
            self._view,
            self.uvz_from_world,
            self._splits,
            self.windows,
            self._by_interval,
            BIAS_TEXELS,
            STEEPEST,
        )

    @property
    def moved(self):
        """How far edges are displaced on average (e,) float64 [pixels]."""
        return self._points[0]

    @property
    def reach(self):
        """Across edges, of a disc as wide as the map (e,) float64 [pixels]."""
        return self._points[1]

    @property
    def edge_cascade(self):
        """Cascades that answer for edges (e,) int."""
        return self._points[2]

    @property
    def receiver_bias(self):
        """Of receivers, along the light (m,) float64 [m]."""
        return self._points[3]

    @property
    def receiver_cascade(self):
        """Cascades that answer for receivers (m,) int."""
        return self._points[4]


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
