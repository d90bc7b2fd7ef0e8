"""Pictures of where slices and light windows lie: from above, along the light, in space."""

import numpy as np

from . import outlines
from .cascades import check_kinds
from .plot_style import (
    CASCADE_COLOURS,
    GREY,
    INK,
    as_length,
    cascade_legend,
    heading,
    new_axes,
)
from .spaces import as_number, as_whole, transform_points

__all__ = ["ground_texels", "light_plan", "light_view", "plan", "view_3d"]

MOST_TRIANGLES = 20_000  # of a scene drawn in space
BELOW = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.12), "ncols": 2}


def plan(cascades, camera, *, height=0.0, ax=None):
    """Draw the camera's slices from above, and each window where its light meets the ground.

    Parameters
    ----------
    cascades : Cascades
    camera : Camera
    height : float
        World y of the ground [m].
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
        World x to the right, -z (north) upwards. Slices are filled, windows are outlined.
    """
    check_kinds(camera=camera)
    ax = new_axes(ax, (6.4, 6.0))
    for i in reversed(range(cascades.count)):
        corners = outlines.slice_corners(camera, *cascades.splits[i : i + 2])
        above = outlines.convex_hull(corners[:, ::2] * (1, -1))
        ax.fill(*above.T, color=CASCADE_COLOURS[i], alpha=0.45, lw=0)
        window = outlines.footprint(cascades, i, height) * (1, -1)
        if np.isfinite(window).all():
            ax.plot(*np.vstack([window, window[:1]]).T, color=CASCADE_COLOURS[i], lw=1.6)
    eye = camera.eye[[0, 2]] * (1, -1)
    ax.plot(*eye, "o", color=INK, ms=4)
    _light_arrow(ax, outlines.to_light(cascades, 0)[[0, 2]] * (-1, 1))
    ax.set_aspect("equal")
    ax.set_xlabel("east, world x [m]")
    ax.set_ylabel("north, −z [m]")
    heading(ax, f"slices (filled), and windows where they meet y = {height:g} m")
    cascade_legend(ax, _texel_labels(cascades), **BELOW)
    return ax


def light_plan(cascades, camera, *, points=None, ax=None):
    """Draw slices and windows as the light sees them.

    Parameters
    ----------
    cascades : Cascades
    camera : Camera
    points : (m, 3) array_like, optional
        World points [m] to show as dots, such as the surfaces that are seen.
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
        Light x and y from the world's origin [m]; in the basis of cascade 0.
    """
    check_kinds(camera=camera)
    ax = new_axes(ax, (6.4, 6.0))
    light_from_world = cascades.light_from_world[0]
    if points is not None:
        seen = transform_points(light_from_world, points)
        seen = seen[np.isfinite(seen).all(axis=-1)]
        ax.plot(*seen[:, :2].T, ",", color=GREY, zorder=0, rasterized=True)
    for i in reversed(range(cascades.count)):
        corners = outlines.slice_corners(camera, *cascades.splits[i : i + 2])
        outline = outlines.convex_hull(transform_points(light_from_world, corners)[:, :2])
        ax.fill(*outline.T, color=CASCADE_COLOURS[i], alpha=0.40, lw=0)
        # The light runs along the window's sides: its near face is all that is seen.
        window = outlines.window_corners(cascades, i)[:4]
        edge = outlines.convex_hull(transform_points(light_from_world, window)[:, :2])
        ax.plot(*np.vstack([edge, edge[:1]]).T, color=CASCADE_COLOURS[i], lw=1.6)
    ax.set_aspect("equal")
    ax.set_xlabel("light x [m]")
    ax.set_ylabel("light y [m]")
    heading(ax, "slices (filled) and windows along the light")
    cascade_legend(ax, _texel_labels(cascades), **BELOW)
    return ax


def view_3d(cascades, camera, *, scene=None, cascade=None, ax=None):
    """Draw slices and light windows in space.

    Parameters
    ----------
    cascades : Cascades
    camera : Camera
    scene : Scene, optional
        Drawn in grey; of a large one every k-th triangle.
    cascade : int, optional
        The one window to draw; all of them otherwise.
    ax : matplotlib Axes3D, optional
        Made with ``projection="3d"``.

    Returns
    -------
    ax : matplotlib Axes3D
        East (x), north (-z) and up (y) [m]. Edges of a window are thick over the depths of its
        slice, thin over the rest of its depth range.
    """
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    check_kinds(camera=camera)
    ax = new_axes(ax, (7.5, 6.0), projection="3d")
    everything = []
    for i in range(cascades.count):
        corners = outlines.slice_corners(camera, *cascades.splits[i : i + 2])
        everything.append(_upright(corners))
        faces = _upright(corners)[outlines.FACES]
        ax.add_collection3d(Poly3DCollection(faces, facecolor=CASCADE_COLOURS[i], alpha=0.28))
        if cascade in (None, i):
            depth = transform_points(cascades.uvz_from_world[i], corners)[:, 2]
            for depths, width in (((0.0, 1.0), 0.5), ((depth.min(), depth.max()), 1.6)):
                window = _upright(outlines.window_corners(cascades, i, depths))
                edges = window[outlines.EDGES]
                ax.add_collection3d(Line3DCollection(edges, colors=CASCADE_COLOURS[i], lw=width))
            everything.append(window)
    everything = np.concatenate(everything)
    if scene is not None:
        _scene_in_space(ax, scene, everything.min(axis=0), everything.max(axis=0))
    lowest, highest = everything.min(axis=0), everything.max(axis=0)
    for axis, low, high in zip("xyz", lowest, highest, strict=True):
        getattr(ax, f"set_{axis}lim")(low, high)
    ax.set_box_aspect(highest - lowest)
    ax.view_init(elev=24.0, azim=-68.0)
    ax.set_xlabel("east [m]")
    ax.set_ylabel("north [m]")
    ax.set_zlabel("up [m]")
    heading(ax, "slices (filled) and light windows (edges)")
    cascade_legend(ax, _texel_labels(cascades), title="cascade", loc="upper left")
    return ax


def light_view(cascades, camera, cascade=0, *, shadow_map=None, select="map", ax=None):
    """Draw a map as the light sees it, with the part of the view that can look it up outlined.

    Parameters
    ----------
    cascades : Cascades
    camera : Camera
    cascade : int
    shadow_map : (size, size) array_like, optional
        Depths to draw behind, ``frame.shadow_maps[cascade]``; near the light is bright.
    select : {"map", "frustum", "interval"}
        What can look the map up: points of its own slice alone, or all that it holds from there to
        the end of the range [Sylvan]_. `csm.check_cascades` has the same share as numbers.
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
        In texels. Used texels are clear, unused ones are veiled; the title has their share, the
        utilisation.

    References
    ----------
    .. [Sylvan] S. Sylvan: Improving shadow map utilization for cascaded shadow maps. Web article.
    """
    check_kinds(camera=camera)
    cascade = as_whole("cascade", cascade, 0, cascades.count - 1)
    ax = new_axes(ax, (5.4, 5.4))
    size = int(cascades.map_size[cascade])
    near, far = outlines.visible_slice(cascades, cascade, select)
    used = outlines.column_hits(cascades, cascade, camera, near, far)
    picture = np.ones((size, size))
    if shadow_map is not None:
        depth = np.asarray(shadow_map, np.float64)
        stored = depth[depth < 1.0]
        low, high = np.percentile(stored, (0.5, 99.5)) if len(stored) else (0.0, 1.0)
        picture = 0.95 - 0.75 * np.clip((depth - low) / max(high - low, 1e-12), 0.0, 1.0)
    veiled = picture[..., None] * (1.0, 1.0, 1.0)
    veiled = np.where(used[..., None], veiled, 0.45 * veiled + 0.55 * np.array((0.90, 0.75, 0.72)))
    ax.imshow(veiled, origin="lower", extent=(0, size, 0, size), interpolation="nearest")
    own = outlines.slice_outline(cascades, cascade, camera, *cascades.splits[cascade : cascade + 2])
    reach = outlines.slice_outline(cascades, cascade, camera, near, far)
    for outline, style in ((reach, "-"), (own, "--")):
        ax.plot(*np.vstack([outline, outline[:1]]).T, style, color=CASCADE_COLOURS[3], lw=1.6)
    ax.set_xlim(0, size)
    ax.set_ylim(0, size)
    ax.set_xlabel("u [texels]")
    ax.set_ylabel("v [texels]")
    side = as_length(cascades.texel_size[cascade].max())
    where = "in the middle" if outlines.is_warped(cascades, cascade) else "each"
    heading(ax, f"cascade {cascade}: {used.mean():.0%} of {size}² texels used, {side} {where}")
    return ax


def ground_texels(cascades, cascade=0, *, camera=None, height=0.0, lines=32, ax=None):
    """Draw the borders of a map's texels where its light meets the ground.

    Parameters
    ----------
    cascades : Cascades
    cascade : int
    camera : Camera, optional
        Its slice is filled.
    height : float
        World y of the ground [m].
    lines : int
        How many lines to draw across the map, about: every texel would be a tone.
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
        World x to the right, -z (north) upwards [m].
    """
    from matplotlib.collections import LineCollection

    cascade = as_whole("cascade", cascade, 0, cascades.count - 1)
    lines = as_whole("lines", lines, 1, 1024)
    height = as_number("height", height)
    ax = new_axes(ax, (5.6, 5.4))
    if camera is not None:
        corners = outlines.slice_corners(camera, *cascades.splits[cascade : cascade + 2])
        above = outlines.convex_hull(corners[:, ::2] * (1, -1))
        ax.fill(*above.T, color=CASCADE_COLOURS[cascade], alpha=0.35, lw=0)
    every = max(1, 2 ** round(np.log2(cascades.map_size[cascade] / lines)))
    grid = outlines.texel_grid(cascades, cascade, height, every) * (1, -1)
    grid = grid[np.isfinite(grid).all(axis=(1, 2))]
    ax.add_collection(LineCollection(grid, colors=CASCADE_COLOURS[cascade], lw=0.6))
    ax.autoscale_view()
    _light_arrow(ax, outlines.to_light(cascades, cascade)[[0, 2]] * (-1, 1))
    ax.set_aspect("equal")
    ax.set_xlabel("east, world x [m]")
    ax.set_ylabel("north, −z [m]")
    heading(ax, f"cascade {cascade} on y = {height:g} m: a line every {every} texels")
    return ax


def _upright(points):
    """World points (..., 3) as (east, north, up)."""
    return points[..., [0, 2, 1]] * (1.0, -1.0, 1.0)


def _texel_labels(cascades):
    sizes = cascades.texel_size.max(axis=1)
    return {i: f"{i}: {as_length(size)} texels" for i, size in enumerate(sizes)}


def _light_arrow(ax, towards):
    """Mark in a corner of a plan where the light travels to, (2,) on the ground."""
    length = float(np.hypot(*towards))
    if length < 1e-9:
        return  # straight down
    x, y = 0.07 * np.asarray(towards) / length
    options = {"xycoords": "axes fraction", "annotation_clip": False}
    ax.annotate(
        "",
        (0.92 + x, 0.92 + y),
        (0.92 - x, 0.92 - y),
        arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.4},
        **options,
    )
    ax.annotate("light", (0.92, 0.80), ha="center", fontsize="x-small", color=INK, **options)


def _scene_in_space(ax, scene, low, high):
    """Add the triangles of a scene that lie in a box of (east, north, up)."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    positions, triangles = scene.flatten()
    corners = _upright(np.asarray(positions, np.float64)[triangles])
    centre = corners.mean(axis=1)
    corners = corners[((centre >= low) & (centre <= high)).all(axis=1)]
    corners = corners[:: -(-len(corners) // MOST_TRIANGLES) or 1]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    up = np.abs(normal[:, 2]) / np.where(length > 0.0, length, 1.0)
    shade = 0.55 + 0.35 * up
    faces = Poly3DCollection(
        corners, facecolors=np.repeat(shade[:, None], 3, axis=1), lw=0, alpha=0.5
    )
    ax.add_collection3d(faces)
