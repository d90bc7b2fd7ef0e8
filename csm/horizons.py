"""Where planes end between the pixels of a coarse picture, and what stands on their horizon."""

from . import _core

__all__ = ["ends_of", "points_of"]


def ends_of(camera, small, frame, facing, bounds):
    """Where planes go on past their last coarse pixels, along rows and columns.

    A plane's inverse depth is linear in the picture, so three pixels in a line say whether it is
    one and where it goes on. Between the last of them and the centre of the next coarse pixel,
    which shows something else, the full picture has pixels of its own: towards a horizon these lie
    many times as far off. They count as far as the scene's box reaches, and before what is seen
    next. What stands on a horizon and is lower than a coarse pixel, the coarse picture does not
    see.

    Parameters
    ----------
    camera, small : Camera
        Of the full and of the coarse picture.
    frame : Frame
        The coarse one.
    facing : (h, w) bool
        Its pixels that face the sun.
    bounds : (2, 3) float64
        Least and greatest corner of the scene's box, which holds all that is seen.

    Returns
    -------
    ends : object
        For `csm.coarse_look.outline_of`; `points_of` says what they are.
    part : Camera or None
        Of the full picture in which planes reach their horizon against the sky: its pixels round
        the last coarse pixels of such planes and the next ones. None without a horizon, under an
        orthographic camera, and of more pixels than the coarse picture has.

    Raises
    ------
    ValueError
        If an array is not of the coarse camera's size.
    """
    ends, box = _core.coarse_plane_ends(
        camera, small, frame.view_depth, frame.valid, facing, bounds
    )
    return ends, None if box is None else _part_of(camera, small, box)


def points_of(ends):
    """World points (k, 3) that pixels of the full picture see past ends of planes.

    Raises
    ------
    TypeError
        If they are not of `ends_of`.
    """
    return _core.coarse_end_points(ends)


def _part_of(camera, small, box):
    """The full camera's pixels of a box of coarse ones, or None if these are too many."""
    top, left, bottom, right = box
    (width, height), (coarse_width, coarse_height) = camera.size, small.size
    left, right = left * width // coarse_width, -(-right * width // coarse_width)
    top, bottom = top * height // coarse_height, -(-bottom * height // coarse_height)
    size = right - left, bottom - top
    if size[0] * size[1] > coarse_width * coarse_height:
        return None
    return camera.replace(
        size=size,
        half_width=camera.half_width * size[0] / width,
        half_height=camera.half_height * size[1] / height,
        centre_x=camera.centre_x + ((left + right) / width - 1.0) * camera.half_width,
        centre_y=camera.centre_y + (1.0 - (top + bottom) / height) * camera.half_height,
    )
