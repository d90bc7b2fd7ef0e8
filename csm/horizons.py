"""Where planes end between the pixels of a coarse picture, and what stands on their horizon."""

import numpy as np

__all__ = ["ends_of", "horizon_of"]

FLAT = 0.02  # of the step from pixel to pixel, that the next one may differ by on a plane
WAYS = ((0, 1), (0, -1), (1, 1), (1, -1))  # axis of the picture, and which way along it


def ends_of(camera, small, frame, facing, bounds):
    """Points of the full picture past the last coarse pixels of planes, along rows and columns.

    A plane's inverse depth is linear in the picture, so three pixels in a line say whether it is
    one and where it goes on. Between the last of them and the centre of the next coarse pixel,
    which shows something else, the full picture has pixels of its own: towards a horizon these lie
    many times as far off. They count as far as the scene's box reaches, and before what is seen
    next.

    Parameters
    ----------
    camera, small : Camera
        Of the full and of the coarse picture.
    frame : Frame
        The coarse one.
    facing : (h, w) bool
        Its pixels that face the sun.
    bounds : (2, 3) float64
        Least and greatest corner of the scene's box.

    Returns
    -------
    points : (k, 3) float64
        In the world.
    """
    linear = _linear_depth(camera, frame)
    found = [_ends_along(camera, small, linear, frame.valid, facing, way) for way in WAYS]
    x, y, depths = (np.concatenate(part) for part in zip(*found, strict=True))
    across = x[:, None] * camera.right + y[:, None] * camera.up
    if camera.orthographic:
        points = camera.eye + across - depths[:, None] * camera.backward
    else:
        points = camera.eye + depths[:, None] * (across - camera.backward)
    slack = 1e-6 * np.abs(bounds).max()  # of depths in single precision
    inside = ((points >= bounds[0] - slack) & (points <= bounds[1] + slack)).all(axis=1)
    inside &= depths <= camera.far
    return points[inside]


def horizon_of(camera, small, frame, facing):
    """Part of the full picture in which planes reach their horizon against the sky.

    What stands there and is lower than a coarse pixel, the coarse picture does not see.

    Parameters
    ----------
    camera, small : Camera
        Of the full and of the coarse picture.
    frame : Frame
        The coarse one.
    facing : (h, w) bool
        Its pixels that face the sun.

    Returns
    -------
    part : Camera or None
        The full camera's pixels round the last coarse pixels of such planes and the next ones. None
        without a horizon, and of more pixels than the coarse picture has.
    """
    if camera.orthographic:
        return None
    linear, shape, held = _linear_depth(camera, frame), facing.shape, []
    for axis, sign in WAYS:
        images = (np.moveaxis(a, axis, 0)[::sign] for a in (linear, frame.valid, facing))
        rows, columns, last, step, _, seen = _planes_end(*images)
        gone = ~seen & (last + step <= 0.0)
        for ahead in (2, 3):  # rows count from the first of three pixels
            along = np.minimum(rows[gone] + ahead, shape[axis] - 1)
            along = along if sign > 0 else shape[axis] - 1 - along
            pair = along, columns[gone]
            held.append(np.stack([pair[axis], pair[1 - axis]], axis=1))
    held = np.concatenate(held)
    if not len(held):
        return None
    (top, left), (bottom, right) = held.min(axis=0), held.max(axis=0) + 1
    (width, height), (coarse_height, coarse_width) = camera.size, shape
    left, right = left * width // coarse_width, -(-right * width // coarse_width)
    top, bottom = top * height // coarse_height, -(-bottom * height // coarse_height)
    size = int(right - left), int(bottom - top)
    if size[0] * size[1] > facing.size:
        return None
    return camera.replace(
        size=size,
        half_width=camera.half_width * size[0] / width,
        half_height=camera.half_height * size[1] / height,
        centre_x=camera.centre_x + ((left + right) / width - 1.0) * camera.half_width,
        centre_y=camera.centre_y + (1.0 - (top + bottom) / height) * camera.half_height,
    )


def _linear_depth(camera, frame):
    """What is linear in the picture on a plane: the inverse of depth, or depth."""
    depth = frame.view_depth.astype(np.float64)
    depth = np.where(frame.valid, depth, 1.0)
    return depth if camera.orthographic else 1.0 / depth


def _planes_end(linear, valid, facing):
    """Where planes end down the rows, and what is seen next.

    Rows of the first of three pixels in line, columns, the last one's depth as `_linear_depth` has
    it, its step, the next pixel's depth, and whether anything is seen there.
    """
    last, step = linear[2:], linear[2:] - linear[1:-1]
    # past the picture's border nothing is seen
    after, seen = (np.concatenate([a[3:], np.zeros_like(a[:1])]) for a in (linear, valid))
    on = facing[2:] & facing[1:-1] & facing[:-2]
    on &= np.abs(step - (linear[1:-1] - linear[:-2])) <= FLAT * np.abs(step)
    on &= ~(seen & (np.abs(after - last - step) <= FLAT * np.abs(step)))
    return *np.nonzero(on), *(a[on] for a in (last, step, after, seen))


def _ends_along(camera, small, linear, valid, facing, way):
    """Picture plane x, y and view depth of such pixels along one axis, up or down it."""
    axis, sign = way
    linear, valid, facing = (
        np.moveaxis(image, axis, 0)[::sign] for image in (linear, valid, facing)
    )
    count, full = len(linear), camera.size[1 - axis]
    rows, columns, last, step, after, seen = _planes_end(linear, valid, facing)
    ratio = full / count
    centre = (rows + 2.5) * ratio
    along, crossing = camera.pixel_plane()[1 - axis], small.pixel_plane()[axis]
    parts = []
    for k in range(1, int(np.ceil(ratio)) + 1):
        pixel = np.floor(centre - 0.5).astype(int) + k
        ahead = (pixel + 0.5 - centre) / ratio
        value = last + step * ahead
        keep = (pixel < full) & (ahead < 1.0) & (value > 0.0)
        depth = value if camera.orthographic else 1.0 / np.where(keep, value, 1.0)
        behind = after if camera.orthographic else 1.0 / np.where(seen, after, 1.0)
        keep &= ~seen | (depth <= behind)
        here = along[::sign][pixel[keep]], crossing[columns[keep]]
        parts.append((here[1 - axis], here[axis], depth[keep]))
    return [np.concatenate(part) for part in zip(*parts, strict=True)]
