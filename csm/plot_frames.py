"""Pictures of a frame: how its texels lie on the surfaces that are seen."""

import numpy as np

from . import metrics, outlines
from .camera import Camera
from .cascades import check_kinds
from .pictures import lit_picture
from .plot_style import CASCADE_COLOURS, as_length, cascade_legend, heading, new_axes, rgb
from .renderer import Renderer
from .settings import ShadowSettings

__all__ = ["resolution", "texel_cubes", "texel_outlines"]

LEAST_PIXELS = 6.0  # from line to line of `texel_outlines`, where most of a cascade is seen


def resolution(frame, truth, *, ax=None):
    """Draw for each pixel how many pixels the texel that it looks up covers, at its longest.

    Parameters
    ----------
    frame : Frame
        With `cascade_index`.
    truth : Truth
        Of the same scene, camera and sun: for the surfaces.
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
        `csm.metrics.undersampling` in steps of 2: white where texel and pixel are alike, orange
        where texels are larger than pixels, purple where they are smaller; grey where no map is
        looked up (nothing seen, not facing the sun, beyond the range).
    """
    from matplotlib.colors import LogNorm

    m = metrics.undersampling(frame, truth)
    ax = new_axes(ax, (7.5, 4.6))
    ax.set_facecolor("#BDBDBD")
    image = ax.imshow(m, cmap="PuOr_r", norm=LogNorm(1 / 16, 16), interpolation="nearest")
    bar = ax.figure.colorbar(image, ax=ax, shrink=0.8, extend="both", label="texel [pixels]")
    ticks = 2.0 ** np.arange(-4, 5, 2)
    bar.set_ticks(ticks, labels=["1/16", "1/4", "1", "4", "16"])
    bar.ax.minorticks_off()
    judged = np.isfinite(m)
    coarse = float((m[judged] > 1.0).mean()) if judged.any() else float("nan")
    heading(ax, f"texels larger than pixels at {coarse:.0%} of what faces the sun")
    return _as_picture(ax)


def texel_outlines(frame, *, every=None, ax=None):
    """Draw the grid of shadow texels on the surfaces of a frame, a colour per cascade.

    Parameters
    ----------
    frame : Frame
        With `mask`, `valid`, `view_depth`, `cascade_index` and `normal`.
    every : int or sequence of int, optional
        Texels from line to line, for all cascades or each; otherwise a power of two per cascade,
        such that lines are some pixels apart where most of it is seen.
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
        The legend says per cascade how large a texel is and how many lie between two lines.
    """
    count = frame.cascades.count
    if every is None:
        every = [_spacing(frame, i) for i in range(count)]
    every = [int(one) for one in np.broadcast_to(every, count)]
    if min(every) < 1:
        raise ValueError(f"every must be at least 1 texel (got {min(every)})")
    points = outlines.pixel_points(frame)
    lines = outlines.texel_lines(frame.cascades, frame.cascade_index, points, every)[..., None]
    picture = lit_picture(frame) / 255.0
    tint = _tints()[frame.cascade_index]
    light = (0.35 + 0.95 * picture.mean(axis=-1, keepdims=True)) * tint
    flat = np.where(frame.valid[..., None], np.clip(0.25 * picture + 0.75 * light, 0, 1), picture)
    ax = new_axes(ax, (8.5, 5.2))
    ax.imshow(flat * (1.0 - 0.75 * lines), interpolation="nearest")
    labels = {
        i: f"{i}: {as_length(frame.cascades.texel_size[i].max())} texels, a line every {every[i]}"
        for i in range(count)
        if (frame.cascade_index == i).any()
    }
    cascade_legend(ax, labels, loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=2)
    heading(ax, "the texel grid on what is seen")
    return _as_picture(ax)


def texel_cubes(frame, *, camera=None, renderer=None, ax=None):
    """Draw what the maps stored, each texel put back into the world as a box of its own size.

    Flat ground comes out as a floor of tiles, surfaces that slope away from the light as stairs;
    what no light reaches is missing.

    Parameters
    ----------
    frame : Frame
        With `shadow_maps`, drawn with ``cull="none"`` so that they hold everything. Maps of 64 to
        256 texels show best.
    camera : Camera, optional
        Where to look from; the frame's own camera otherwise.
    renderer : Renderer, optional
        Draws the boxes; one is made, and closed again, without it.
    ax : matplotlib Axes, optional

    Returns
    -------
    ax : matplotlib Axes
    """
    camera = frame.camera if camera is None else camera
    check_kinds(camera=camera)
    boxes = outlines.texel_boxes(frame)
    arguments = (boxes, camera, frame.sun, ShadowSettings(filter="none"))
    outputs = ("mask", "valid", "view_depth", "normal")
    if renderer is None:
        with Renderer() as renderer:
            seen = renderer.render(*arguments, outputs=outputs)
    else:
        seen = renderer.render(*arguments, outputs=outputs)
    points = outlines.pixel_points(seen)
    index = outlines.first_map(frame.cascades, points)
    facing = np.clip(seen.normal @ frame.sun.to_light, 0.0, 1.0)
    sideways = np.abs(seen.normal @ camera.right)
    light = 0.40 + 0.55 * facing + 0.15 * sideways * (1.0 - facing)
    # Lines around the faces towards the light: neighbours at one depth would run together.
    ones = np.ones(frame.cascades.count, int)
    lines = outlines.texel_lines(frame.cascades, index, points, ones) * (facing > 0.5)
    picture = _tints()[index] * (light * (1.0 - 0.45 * lines))[..., None]
    picture = np.where(seen.valid[..., None], picture, (0.93, 0.95, 0.97))
    ax = new_axes(ax, (8.5, 5.2))
    ax.imshow(np.clip(picture, 0.0, 1.0), interpolation="nearest")
    labels = {
        i: f"{i}: {as_length(frame.cascades.texel_size[i].max())}"
        for i in range(frame.cascades.count)
        if (index == i).any()
    }
    cascade_legend(ax, labels, loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=4)
    heading(ax, "what the maps stored: a box per texel")
    return _as_picture(ax)


def _spacing(frame, cascade):
    """Texels from line to line so that lines are `LEAST_PIXELS` apart where most is seen."""
    own = frame.valid & (frame.cascade_index == cascade)
    if not own.any():
        return 1
    depth = float(np.median(frame.view_depth[own]))
    camera: Camera = frame.camera
    pixel = 2.0 * camera.half_height / camera.size[1] * (1.0 if camera.orthographic else depth)
    # Ground seen at a slant is foreshortened to about a third.
    texels = 3.0 * LEAST_PIXELS * pixel / float(frame.cascades.texel_size[cascade].max())
    return 2 ** max(0, round(np.log2(texels)))


def _tints():
    """Colours (256, 3) by cascade index; light grey for none."""
    tints = np.full((256, 3), 0.80)
    tints[: len(CASCADE_COLOURS)] = [rgb(colour) for colour in CASCADE_COLOURS]
    return tints


def _as_picture(ax):
    """Take ticks and spines away: pixels are no coordinate that anybody reads."""
    ax.set_xticks([])
    ax.set_yticks([])
    ax.spines[:].set_visible(False)
    return ax
