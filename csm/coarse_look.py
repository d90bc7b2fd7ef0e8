"""What a coarse frame shows: shadow edges, their occluders, what is thin among the casters."""

from dataclasses import dataclass

import numpy as np

from . import _core
from .sampling import LIT
from .tracing import FACING

__all__ = [
    "Look",
    "blockers_of",
    "edges_of",
    "facing_of",
    "gaps_of",
    "layered_share_of",
    "look_at_pixels",
    "outline_of",
    "receivers_of",
    "thin_share_of",
]


@dataclass(frozen=True)
class Look:
    """What the pixels of a coarse frame show.

    Attributes
    ----------
    facing, judged, lit : (h, w) bool
        A surface that faces the sun; of these, those with a cascade; the mask is lit.
    seen_count, facing_count, shadowed_count : int
        Pixels with a surface; that face the sun; judged ones that are not lit.
    cascade_counts : tuple of int
        How many that face the sun each cascade has.
    """

    facing: np.ndarray
    judged: np.ndarray
    lit: np.ndarray
    seen_count: int
    facing_count: int
    shadowed_count: int
    cascade_counts: tuple[int, ...]


def look_at_pixels(frame, sun, cascade_count):
    """Go through the pixels of a frame once.

    Parameters
    ----------
    frame : Frame
        With mask, normals and cascades.
    sun : Sun
    cascade_count : int
        Cascades that are counted, from the nearest on.

    Returns
    -------
    look : Look

    Raises
    ------
    ValueError
        If the arrays are not of one size, or cascades are more than there can be.
    """
    return Look(
        *_core.coarse_look(
            frame.valid,
            frame.normal,
            frame.mask,
            frame.cascade_index,
            sun.to_light,
            FACING,
            LIT,
            cascade_count,
        )
    )


def facing_of(frame, sun):
    """Pixels (h, w) whose surface the sun sees."""
    return _core.coarse_facing(frame.valid, frame.normal, sun.to_light, FACING)


def receivers_of(camera, frame, look, sun):
    """Some of the surfaces that face the sun.

    Parameters
    ----------
    camera : Camera
        Of the coarse picture.
    frame : Frame
    look : Look
        What its pixels show.
    sun : Sun

    Returns
    -------
    receivers : dict
        Of at most 2000 pixels, every so manieth of those that face the sun: ``point`` (m, 3),
        ``depth`` (m,) [m], ``slope``, the tangent of the normal's angle to the sun, ``gradient``,
        ``|gx| + |gy|`` of its depth in light space [m/m], ``cascade`` uint8, and whether it is
        ``dark``.

    Raises
    ------
    ValueError
        If an array is not of the camera's size.
    """
    axes = frame.cascades.light_from_world[0][:2, :3]
    return _core.coarse_receivers(
        camera,
        frame.view_depth,
        frame.normal,
        look.facing,
        look.lit,
        frame.cascade_index,
        sun.to_light,
        axes,
        FACING,
    )


def outline_of(pictures, ends, light_axes):
    """Outermost of points across the light, of every slice of depth: windows reach to them.

    Parameters
    ----------
    pictures : sequence of (Camera, (h, w) float32, (h, w) bool)
        1 to 4: camera, view depths [m] and which pixels count, with their points of the world. All
        look from where the first does, the same way.
    ends : object or None
        Ends of planes of the first picture, as of `csm.horizons.ends_of`: what the full picture
        sees past them counts too.
    light_axes : (2, 3) float64
        Across the light.

    Returns
    -------
    outline : (k, 3) float64
        Of 12 slices of view depth in equal ratios the outermost in 16 directions, at most 192; none
        of none.

    Raises
    ------
    ValueError
        If a picture is not of its camera's size, or there is none.
    TypeError
        If ends are something else.
    """
    return _core.coarse_outline(tuple(pictures), ends, light_axes)


def edges_of(camera, frame, judged, lit, shrink):
    """Places of neighbouring judged pixels on different sides of 0.5.

    Parameters
    ----------
    camera : Camera
        Of the coarse picture.
    frame : Frame
    judged, lit : (h, w) bool
    shrink : float
        Pixels of the full picture along one of the coarse one.

    Returns
    -------
    edges : dict
        Of at most 3000 edges the dark pixel's ``rows``, ``columns`` (e,), ``point`` and ``normal``
        (e, 3), ``across`` (e, 2), the unit direction of `csm.sampling.edge_slopes` in the picture,
        and ``length`` (e,) [pixels of the full picture]: an edge that is looked at counts for those
        that are not.

    Raises
    ------
    ValueError
        If an array is not of the camera's size.
    """
    return _core.coarse_edges(camera, frame.view_depth, frame.normal, judged, lit, shrink)


def gaps_of(frame, receivers):
    """Distance [m] from dark receivers to what the coarse map holds before them; inf for lit ones.

    Also where it holds nothing before them: dark by the plane at the texel's centre alone.
    """
    return _core.coarse_gaps(
        _maps(frame), receivers["point"], receivers["cascade"], receivers["dark"]
    )


def blockers_of(frame, edges):
    """Occluders' distances [m] at the dark side of edges.

    The middle of the nearest and the farthest in 3 x 3 texels of the coarse map. The receiver's own
    plane there is taken off, and what lies within half a texel and a quarter of its slope counts as
    the surface itself.
    """
    index = frame.cascade_index
    index = index.ravel().take(edges["rows"] * index.shape[1] + edges["columns"])
    return _core.coarse_blockers(_maps(frame), edges["point"], edges["normal"], index)


def layered_share_of(frame, receivers):
    """Share of receivers in full shadow that a variance map would light by more than a tenth.

    In full shadow are those before which all 5 x 5 texels of the coarse map hold an occluder.
    Whatever the depths z of these are, no light comes through; by their mean and variance alone
    ``var / (var + (receiver - mean)²)`` may [Lauritzen2007]. One sheet across the light has no
    variance. Two layers, a half of the kernel each, give a tenth where one is twice as far from
    the receiver as the other: var = (g/2)² and mean 3g/2 before it.

    Parameters
    ----------
    frame : Frame
        With its maps.
    receivers : dict
        As of `receivers_of`.

    Returns
    -------
    share : float
        0 where nothing is in full shadow.
    """
    return _core.coarse_layered_share(_maps(frame), receivers["point"], receivers["cascade"])


def thin_share_of(frame):
    """Share of casters' texels before something else on both sides within two texels."""
    return _core.coarse_thin_share(_maps(frame))


def _maps(frame):
    """A frame's maps as the core reads them."""
    cascades = frame.cascades
    return frame.shadow_maps, cascades.uvz_from_world, cascades.texel_size, cascades.depth_range
