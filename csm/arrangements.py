"""What windows of cascades make of a coarse view, whatever the size of their maps."""

from dataclasses import dataclass

import numpy as np

from .cascades import fit_cascades
from .sampling import mean_displacement, surface_steps, uv_gradients
from .spaces import transform_points

__all__ = ["FARTHEST", "LEFT_OUT", "USUAL", "Arranged", "arrange", "narrowest"]

# An edge cannot move further than the shadow is wide, which is not known: pixels at which it ends.
FARTHEST = 8.0
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
    windows : (n,) float64
        Longer side of each window [m].
    held : (n,) bool
        Whether receivers lie between each one's splits.
    cascades : Cascades
        What was fitted.
    """

    moved: np.ndarray
    reach: np.ndarray
    edge_cascade: np.ndarray
    receiver_bias: np.ndarray
    receiver_cascade: np.ndarray
    windows: np.ndarray
    held: np.ndarray
    cascades: object

    def displaced(self, lengths):
        """Edges' displacement of each cascade, times their lengths (n,) [pixels²].

        Parameters
        ----------
        lengths : (e,) float64
            [pixels].
        """
        moved = np.minimum(self.moved, FARTHEST * USUAL)
        return np.bincount(self.edge_cascade, lengths * moved, len(self.windows))


def arrange(view, settings, scene):
    """Fit windows to a view, and read what they make of its edges and receivers.

    Parameters
    ----------
    view : View
    settings : ShadowSettings
    scene : Scene

    Returns
    -------
    arranged : Arranged
    """
    # windows round a sample alone would be smaller than real ones, and leave out edges
    held = np.concatenate([view.receivers, view.edges, view.outline])
    cascades = fit_cascades(view.camera, view.sun, settings, scene=scene, receivers=held)
    windows = cascades.texel_size.max(axis=1) * np.asarray(cascades.map_size, float)
    points = np.concatenate([view.receivers, view.edges])
    selected = _selected(cascades, view.camera, settings, points)
    taken, cascade = np.split(selected, [len(view.receivers)])
    bias = BIAS_TEXELS * windows[taken] * np.minimum(view.gradients, STEEPEST)
    across = np.abs(_across(view, cascades, settings, cascade))
    reach = np.linalg.norm(across, axis=1)  # of a disc one map wide: an ellipse in the picture
    moved = mean_displacement(across)
    depths = (held - view.camera.eye) @ -view.camera.backward
    slices = np.searchsorted(cascades.splits[1:-1], depths)
    some = np.bincount(slices, minlength=cascades.count) > 0
    return Arranged(moved, reach, cascade, bias, taken, windows, some, cascades)


def _across(view, cascades, settings, cascade):
    """How far a step over a whole map along u and v leads across each edge (e, 2) [pixels]."""
    uvz = np.asarray(cascades.uvz_from_world)
    if settings.warp != "none":  # texels differ from place to place
        gradients = uv_gradients(uvz[cascade], view.edges)
        steps = surface_steps(view.camera, view.edges, view.edge_normals, gradients)
        return np.einsum("ea,eak->ek", view.edge_across, steps)
    metres = np.linalg.inv(uvz[:, :2, :3] @ view.axes.T)
    return np.einsum("ek,ekj->ej", view.steps_across, metres[cascade])


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
    # what a kernel of part q leaves out falls with q, along straight lines between the edges' own
    reach = np.maximum(reach, 1e-12)
    parts = wide / reach
    order = np.argsort(-parts)
    parts, gain = parts[order], (lengths * reach)[order]
    slope = np.cumsum(gain)
    left = np.cumsum(gain * parts) - slope * np.append(parts[1:], 0.0)  # down at the next edge
    at = int(np.argmax(left >= allowed))
    below = float(np.append(parts[1:], 0.0)[at])
    return below + (float(left[at]) - allowed) / float(slope[at])


def _selected(cascades, camera, settings, points):
    """Index (m,) of the cascade that answers for each point."""
    if settings.select == "interval":
        depth = (points - camera.eye) @ -camera.backward
        return np.searchsorted(cascades.splits[1:-1], depth)
    uvz = np.asarray(cascades.uvz_from_world)
    if settings.warp != "none":
        uv = np.stack([transform_points(one, points)[:, :2] for one in uvz])
    else:
        uv = points @ uvz[:, :2, :3].transpose(0, 2, 1) + uvz[:, None, :2, 3]
    near = np.abs(uv - 0.5) <= 0.5
    inside = near[..., 0] & near[..., 1]
    inside[-1] = True  # what no map holds is left to the last
    return inside.argmax(axis=0)
