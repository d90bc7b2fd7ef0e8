"""Pictures of a report, as the bytes of PNG files: fronts, and crops of masks and errors."""

import io

import numpy as np

from .fronts import on_front
from .pictures import NOTHING_SEEN
from .plot_style import CASCADE_COLOURS, GREY, INK, heading, new_axes, pyplot, readable_ticks

__all__ = ["crop_picture", "error_crop_picture", "front_picture", "png_of_figure", "png_of_picture"]

COLOURS = CASCADE_COLOURS[:6] + CASCADE_COLOURS[7:]  # without yellow, which white swallows
MARKERS = "os^DvPX"
LABELS = 14  # of points on a front, so that they can be read
ROUNDING = 1e-6  # masks are float32: an error or a flicker of less is none


def front_picture(costs, errors, names, families, *, title, cost, error):
    """Draw techniques by cost and error; those that nothing beats on a line, with their names.

    Parameters
    ----------
    costs, errors : (n,) array_like
        Errors as shares. NaN is left out; an error of 0, or below the 1e-6 that rounding makes, has
        a line of its own at the foot.
    names : sequence of str
    families : sequence of str
        Of each technique: its colour.
    title, cost, error : str
        Of the picture and its axes.

    Returns
    -------
    png : bytes
    """
    costs, errors = (np.asarray(one, float) for one in (costs, errors))
    errors = np.where(np.abs(errors) < ROUNDING, 0.0, errors)
    usable = (costs > 0.0) & (errors >= 0.0)
    shown, least = _off_zero(errors)
    ax = new_axes(None, (9.0, 5.2))
    ax.set(xscale="log", yscale="log", xlabel=cost, ylabel=error)
    heading(ax, title)
    for number, family in enumerate(dict.fromkeys(families)):
        own = usable & np.array([one == family for one in families])
        colour, marker = COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]
        ax.plot(costs[own], shown[own], marker, color=colour, label=family, ms=5, mew=0)
    front = np.flatnonzero(on_front(np.where(usable, costs, np.nan), errors))
    front = front[np.argsort(costs[front])]
    ax.step(costs[front], shown[front], where="post", color=INK, lw=1, zorder=0)
    for place, i in enumerate(front[:LABELS]):
        ax.annotate(
            names[i],
            (costs[i], shown[i]),
            xytext=(4, 5 if place % 2 == 0 else -11),
            textcoords="offset points",
            fontsize="x-small",
            color=INK,
        )
    readable_ticks(ax, least)
    ax.grid(True, which="major", color=GREY, alpha=0.3, lw=0.5)
    ax.legend(frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return png_of_figure(ax.figure)


def _off_zero(errors):
    """Errors as drawn on a logarithmic axis: 0 lies below the least other; and where that is."""
    positive = errors[errors > 0.0]
    zero = 0.4 * positive.min() if len(positive) else ROUNDING
    return np.where(errors == 0.0, zero, errors), zero if (errors == 0.0).any() else None


def crop_picture(mask, scale=2):
    """Picture of a crop of a mask: black is shadow, pale blue where nothing is seen.

    Parameters
    ----------
    mask : (h, w) array_like
        Visibilities; NaN where nothing is seen.
    scale : int
        Pixels of the picture per pixel of the mask.

    Returns
    -------
    png : bytes
    """
    mask = np.asarray(mask, float)
    return png_of_picture(_enlarged(_seen(mask, np.clip(mask, 0.0, 1.0)[..., None]), scale))


def error_crop_picture(mask, reference, scale=2):
    """Picture of a crop's error: blue where too bright, orange where too dark, white where right.

    Parameters
    ----------
    mask, reference : (h, w) array_like
        Visibilities; NaN where nothing is seen, which is pale blue.
    scale : int

    Returns
    -------
    png : bytes
    """
    difference = np.asarray(mask, float) - np.asarray(reference, float)
    bright = np.array([0.0, 0.45, 0.70]) - 1.0
    dark = np.array([0.84, 0.37, 0.0]) - 1.0
    picture = (
        1.0
        + np.clip(difference, 0.0, 1.0)[..., None] * bright
        + np.clip(-difference, 0.0, 1.0)[..., None] * dark
    )
    return png_of_picture(_enlarged(_seen(difference, picture), scale))


def _seen(values, picture):
    """(h, w, 3) picture, pale blue where values (h, w) are NaN."""
    return np.where(np.isnan(values)[..., None], NOTHING_SEEN, picture)


def _enlarged(picture, scale):
    return picture.repeat(scale, axis=0).repeat(scale, axis=1)


def png_of_picture(picture):
    """PNG of a picture.

    Parameters
    ----------
    picture : (h, w, 3) array_like
        0 to 1.

    Returns
    -------
    png : bytes
    """
    from PIL import Image

    file = io.BytesIO()
    image = Image.fromarray(np.round(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8))
    image.quantize(64).save(file, "PNG", optimize=True)
    return file.getvalue()


def png_of_figure(figure):
    """PNG of a matplotlib figure, which is closed.

    Parameters
    ----------
    figure : matplotlib Figure

    Returns
    -------
    png : bytes
    """
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=110)
    pyplot().close(figure)
    return file.getvalue()
