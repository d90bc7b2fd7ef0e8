"""Colours and axes that every picture of `csm.plot` shares."""

import numpy as np

__all__ = [
    "CASCADE_COLOURS",
    "GREY",
    "INK",
    "as_length",
    "cascade_legend",
    "heading",
    "new_axes",
    "pyplot",
    "readable_ticks",
    "rgb",
]

# Okabe and Ito's palette, told apart with every kind of colour vision, in an order that keeps
# neighbours furthest apart. Cascade i has colour i, in every picture.
CASCADE_COLOURS = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#56B4E9",
    "#CC79A7",
    "#F0E442",
    "#8C8C8C",
)
INK = "#222222"
GREY = "#9A9A9A"


def pyplot():
    """`matplotlib.pyplot`, or an ImportError that names the extra."""
    try:
        from matplotlib import pyplot as found
    except ImportError as error:
        raise ImportError(
            "csm.plot needs matplotlib: pip install cascaded-shadow-maps[plot]"
        ) from error
    return found


def new_axes(ax, size=(7.0, 4.2), **subplot):
    """Axes given by the caller, or those of a new figure of this size [inches]."""
    plt = pyplot()
    if ax is None:
        _, ax = plt.subplots(figsize=size, layout="constrained", subplot_kw=subplot)
    if not subplot:
        ax.spines[["top", "right"]].set_visible(False)
    return ax


def heading(ax, text):
    """Title at the left, where a reader begins."""
    ax.set_title(text, loc="left", fontsize="medium", color=INK)


def cascade_legend(ax, labels, *, title=None, **options):
    """Explain the colours of cascades, in their order; `labels` maps index to text."""
    from matplotlib.patches import Patch

    handles = [
        Patch(facecolor=CASCADE_COLOURS[i], edgecolor="none", label=text)
        for i, text in labels.items()
    ]
    return ax.legend(handles=handles, title=title, frameon=False, fontsize="small", **options)


def as_length(metres):
    """Text of a length with a unit that leaves no leading zeros."""
    if metres >= 1.0:
        return f"{metres:.2g} m" if metres < 100.0 else f"{metres:.0f} m"
    return f"{1e2 * metres:.2g} cm" if metres >= 0.01 else f"{1e3 * metres:.2g} mm"


def rgb(colour):
    """Numbers (3,) float64, 0 to 1, of a "#rrggbb"."""
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0


def readable_ticks(ax, zero):
    """Label logarithmic axes: 1, 2 and 5 of every decade, plain along x, per cent along y.

    `zero` is where on the y axis 0 is drawn, None if it is not.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_minor_formatter(NullFormatter())
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    if zero is not None:
        ax.axhline(zero, color=GREY, lw=0.5, ls=":")
        ax.annotate(
            "0", (0.0, zero), xycoords=("axes fraction", "data"), xytext=(-4, 0),
            textcoords="offset points", ha="right", va="center",
        )  # fmt: skip
    ax.yaxis.set_major_formatter(
        lambda value, _: f"{100.0 * value:.3g} %" if zero is None or value > 1.2 * zero else ""
    )
