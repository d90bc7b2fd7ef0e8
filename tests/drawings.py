"""Pictures of the worst case of a figure, (h, w, 3) uint8, for the report of the hard cases."""

import numpy as np

RED = (220, 40, 40)


def compared(first, second):
    """Two masks (h, w) in 0 to 1 beside each other; where they differ, red on the second."""
    greys = [np.round(255 * np.clip(np.nan_to_num(each), 0, 1)).astype(np.uint8)
             for each in (first, second)]  # fmt: skip
    pictures = [np.repeat(grey[..., None], 3, axis=-1) for grey in greys]
    pictures[1][np.asarray(first) != np.asarray(second)] = RED
    gap = np.full((len(greys[0]), 4, 3), 200, np.uint8)
    return np.concatenate([pictures[0], gap, pictures[1]], axis=1)


def chart(draw, *, size=(6.4, 3.6), title=""):
    """What ``draw(axes)`` draws on the axes of matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(size, dpi=100, layout="constrained")
    axes = figure.add_subplot()
    draw(axes)
    axes.set_title(title, fontsize=10)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
