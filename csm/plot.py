"""Pictures of cascades and of frames, for people who explain or look for what went wrong.

Every function draws on `ax` (a new figure without it) and returns the axes. They need matplotlib
(extra ``plot``), which is imported when the first of them is called. Lengths are in metres, texels
where it says so; cascade i has one colour in all pictures, of a palette that is told apart with
every kind of colour vision.

==================== ==============================================================
`splits`             where schemes cut the view
`texels_per_pixel`   how fine each map is along the view
`plan`               slices and light windows from above, as they meet the ground
`light_plan`         slices and light windows along the light
`view_3d`            slices and light windows in space
`light_view`         a map as the light sees it, the visible part outlined
`ground_texels`      texels on the ground: what a skew or a warp does to them
`resolution`         texels against pixels, for each pixel of a frame
`texel_outlines`     the grid of texels on the surfaces of a frame
`texel_cubes`        what the maps stored, put back into the world
`lattice_phases`     whether the texel grid stands still along a path
`texel_sizes`        whether texels keep their size along a path
==================== ==============================================================
"""

from itertools import pairwise

import numpy as np

from . import outlines
from .plot_frames import resolution, texel_cubes, texel_outlines
from .plot_style import CASCADE_COLOURS, GREY, heading, new_axes
from .plot_windows import ground_texels, light_plan, light_view, plan, view_3d

__all__ = [
    "CASCADE_COLOURS",
    "ground_texels",
    "lattice_phases",
    "light_plan",
    "light_view",
    "plan",
    "resolution",
    "splits",
    "texel_cubes",
    "texel_outlines",
    "texel_sizes",
    "texels_per_pixel",
    "view_3d",
]

JUMP = 1e-3  # texels that a phase may move without being a jump
LINE_STYLES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)), (0, (7, 3)))


def splits(named, *, ax=None):
    """Draw where schemes cut the view: a bar per scheme, a colour per cascade.

    Parameters
    ----------
    named : dict of str to Cascades
        Schemes by name, drawn from top to bottom. Anything with `splits` will do, or the
        (n + 1,) view depths [m] themselves.
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
        View depth is logarithmic where every depth is positive.
    """
    depths = {name: np.asarray(getattr(one, "splits", one)) for name, one in named.items()}
    ax = new_axes(ax, (7.5, 1.2 + 0.45 * len(depths)))
    logarithmic = all((one > 0).all() for one in depths.values())
    ax.set_xscale("log" if logarithmic else "linear")
    for row, one in enumerate(depths.values()):
        for i, (near, far) in enumerate(pairwise(one)):
            ax.barh(row, far - near, left=near, height=0.72, color=CASCADE_COLOURS[i], lw=0)
            if i:
                ax.text(near, row, f" {near:.3g}", va="center", fontsize="x-small", color="white")
    ax.set_yticks(range(len(depths)), list(depths))
    ax.invert_yaxis()
    ax.tick_params(axis="y", length=0)
    ax.set_xlim(min(one[0] for one in depths.values()), max(one[-1] for one in depths.values()))
    ax.set_xlabel("view depth [m]")
    heading(ax, "where the view is cut")
    return ax


def texels_per_pixel(named, camera, *, ax=None):
    """Draw how many pixels a texel covers along the view, were each slice served by its own map.

    Perspective aliasing: the side of a texel over that of a pixel at the same depth, for a surface
    that faces both the camera and the sun (docs/numerics.md 13). Below 1 the map is finer than the
    picture.

    Parameters
    ----------
    named : dict of str to Cascades
    camera : Camera
        Its field of view and height in pixels set the size of a pixel.
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
    """
    ax = new_axes(ax)
    per_depth = 2.0 * camera.half_height / camera.size[1]
    lines = []
    for number, (name, cascades) in enumerate(named.items()):
        depth, ratio = [], []
        for i, (near, far) in enumerate(pairwise(cascades.splits)):
            # Along an orthographic view pixels do not grow: two points would do.
            along = np.linspace(near, far, 60) if near <= 0 else np.geomspace(near, far, 60)
            pixel = per_depth * (np.ones_like(along) if camera.orthographic else along)
            depth.extend(along)
            ratio.extend(cascades.texel_size[i].max() / pixel)
        style = {"color": CASCADE_COLOURS[number % 8], "ls": LINE_STYLES[number % 8]}
        lines += ax.plot(depth, ratio, lw=1.8, label=name, **style)
    ax.axhline(1.0, color=GREY, lw=1.0, zorder=0)
    ax.set_xscale("linear" if min(line.get_xdata().min() for line in lines) <= 0 else "log")
    ax.set_yscale("log")
    ax.set_xlim(*(f(line.get_xdata()) for f, line in ((np.min, lines[0]), (np.max, lines[0]))))
    ax.set_xlabel("view depth [m]")
    ax.set_ylabel("side of a texel [pixels]")
    heading(ax, "perspective aliasing: above 1 a texel is larger than a pixel")
    ax.legend(frameon=False, fontsize="small")
    return ax


def lattice_phases(named, *, cascade=0, point=(0.0, 0.0, 0.0), ax=None):
    """Draw whether the texel grid falls onto itself along a path of frames.

    A fixed world point lies somewhere within its texel. Where that place moves, shadow edges crawl.
    Each path has a band, one texel high; dots and crosses are the place along u and v, relative to
    the first frame.

    Parameters
    ----------
    named : dict of str to sequence of Cascades
        Paths by name, one Cascades per frame.
    cascade : int
    point : (3,) array_like
        World point [m].
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
        The share of pairs of frames between which the grid jumps is written beside each band.
    """
    ax = new_axes(ax, (7.5, 1.2 + 0.8 * len(named)))
    for row, (name, path) in enumerate(named.items()):
        phases = outlines.lattice_phases(path, cascade, point)
        base = -1.25 * row
        ax.axhspan(base - 0.5, base + 0.5, color="#F2F2F2", lw=0, zorder=0)
        ax.axhline(base, color=GREY, lw=0.6, zorder=1)
        frames = np.arange(len(phases))
        ax.plot(frames, base + phases[:, 0], ".", ms=3.5, color=CASCADE_COLOURS[0], zorder=2)
        ax.plot(frames, base + phases[:, 1], "x", ms=3.0, mew=0.8, color=CASCADE_COLOURS[3])
        share = float(jumps(phases).mean()) if len(phases) > 1 else 0.0
        text = f"{name}\n{share:.0%} of steps jump"
        ax.text(1.01, base, text, transform=ax.get_yaxis_transform(), va="center", fontsize="small")
    rows = -1.25 * np.arange(len(named))
    ax.set_yticks(
        np.concatenate([rows - 0.5, rows, rows + 0.5]),
        ["−½"] * len(rows) + ["0"] * len(rows) + ["½"] * len(rows),
        fontsize="x-small",
    )
    ax.set_xlabel("frame")
    ax.set_ylabel("place in the texel [texels]")
    heading(
        ax, f"a fixed point within its texel of cascade {cascade}: dots along u, crosses along v"
    )
    return ax


def jumps(phases):
    """Whether the texel grid moves between neighbouring frames, (m - 1,) bool."""
    moved = np.diff(phases, axis=0)
    moved -= np.round(moved)
    return (np.abs(moved) > JUMP).any(axis=1)


def texel_sizes(named, *, cascade=0, ax=None):
    """Draw the size of a texel along a path of frames.

    Parameters
    ----------
    named : dict of str to sequence of Cascades
        Paths by name, one Cascades per frame.
    cascade : int
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
        The larger side of a texel [m]; beside each name the number of different sizes.
    """
    ax = new_axes(ax)
    for number, (name, path) in enumerate(named.items()):
        sizes = np.array([frame.texel_size[cascade].max() for frame in path])
        count = len(np.unique(np.round(sizes / sizes.max(), 12)))
        label = f"{name}: {count} size{'s' if count > 1 else ''}"
        style = {"color": CASCADE_COLOURS[number % 8], "ls": LINE_STYLES[number % 8]}
        ax.plot(sizes, drawstyle="steps-mid", lw=1.5, label=label, **style)
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("frame")
    ax.set_ylabel("side of a texel [m]")
    heading(ax, f"texels of cascade {cascade} along the path")
    ax.legend(frameon=False, fontsize="small")
    return ax
