"""Pictures of a Frame, for people: never the input of a metric.

Every function takes arrays of a Frame and returns (h, w, 3) uint8, sRGB, row 0 on top; `save_png`
writes one.
"""

import numpy as np

__all__ = [
    "cascades_picture",
    "error_picture",
    "lit_picture",
    "maps_picture",
    "mask_picture",
    "save_png",
]

# Linear light. On a clear day the sun gives about five times what the sky gives; less here, so that
# shadows keep their drawing.
SUN_LIGHT = np.array([1.00, 0.92, 0.78])
LOW_SUN_LIGHT = np.array([1.00, 0.66, 0.38])
SKY_LIGHT = np.array([0.20, 0.25, 0.34])
GROUND_LIGHT = np.array([0.10, 0.09, 0.07])
CLEAR_AIR = 20_000.0  # distance at which air takes over, if the picture reaches that far [m]
SKY_ZENITH = np.array([0.13, 0.28, 0.58])
SKY_HORIZON = np.array([0.60, 0.70, 0.80])
PLASTER = np.array([0.62, 0.59, 0.54])
MEADOW = np.array([0.20, 0.27, 0.10])
ROCK = np.array([0.235, 0.225, 0.145])

CASCADE_COLOURS = (
    np.array(
        [
            [214, 69, 65],
            [66, 150, 76],
            [62, 104, 206],
            [222, 170, 32],
            [150, 84, 190],
            [38, 166, 172],
            [226, 120, 54],
            [150, 150, 60],
        ]
    )
    / 255.0
)
FALSE_LIGHT = np.array([0.05, 0.45, 1.00])
FALSE_SHADOW = np.array([1.00, 0.50, 0.00])
NOTHING_SEEN = (0.80, 0.87, 0.95)  # pale blue, which no grey is
NO_MAP_DEPTH = np.array([0.10, 0.12, 0.20])


def lit_picture(frame, *, terrain=False):
    """Draw the scene in sun and sky light with its shadows.

    Parameters
    ----------
    frame : Frame
        With `mask`, `valid`, `view_depth` and `normal`.
    terrain : bool
        Colour surfaces as meadow where they are flat and rock where they are steep, instead of
        plaster.

    Returns
    -------
    picture : (h, w, 3) uint8
    """
    camera, to_light = frame.camera, frame.sun.to_light
    view = _view_directions(camera)
    sky = _sky(view, to_light)
    normal = frame.normal.astype(np.float64)
    up = normal[..., 1:2]
    albedo = PLASTER
    if terrain:
        albedo = ROCK + (MEADOW - ROCK) * _smoothstep(0.70, 0.93, up)
    sun = np.clip(normal @ to_light, 0.0, 1.0) * frame.mask
    # A low sun is red and the sky under it dim: 1 from 25 degrees of elevation up.
    day = _smoothstep(-0.05, 0.42, to_light[1])
    sun_light = LOW_SUN_LIGHT + (SUN_LIGHT - LOW_SUN_LIGHT) * day
    ambient = GROUND_LIGHT + (SKY_LIGHT - GROUND_LIGHT) * (0.5 + 0.5 * up)
    light = sun[..., None] * sun_light + ambient * (0.35 + 0.65 * day)
    colour = _exposed(albedo * light, frame.valid)

    depth = np.where(frame.valid, frame.view_depth, 0.0).astype(np.float64)
    reach = max(CLEAR_AIR, 2.0 * np.percentile(depth, 95))
    air = 1.0 - np.exp(-np.maximum(depth, 0.0) / reach)[..., None]
    colour += (SKY_HORIZON - colour) * air
    return _to_srgb(np.where(frame.valid[..., None], colour, sky))


def mask_picture(frame):
    """Draw the mask itself: white lit, black shadowed, pale blue where nothing is seen.

    Parameters
    ----------
    frame : Frame
        With `mask` and `valid`.

    Returns
    -------
    picture : (h, w, 3) uint8
    """
    grey = np.repeat(np.asarray(frame.mask, np.float64)[..., None], 3, axis=-1)
    return _to_bytes(np.where(frame.valid[..., None], grey, NOTHING_SEEN))


def maps_picture(frame, *, side=768):
    """Draw every shadow map, as seen from the sun: what is nearest to it is brightest.

    Each map is stretched over the depths that it holds, shrunk to at most `side` pixels by taking
    the nearest of each block of texels (so thin casters stay), and turned to have light-view y
    upwards. Dark blue: no caster.

    Parameters
    ----------
    frame : Frame
        With `shadow_maps`.
    side : int
        Pixels along a side of one map at most.

    Returns
    -------
    picture : (h, w, 3) uint8
        Maps from left to right, then top to bottom, framed in the colours of `cascades_picture`.
    """
    tiles = [
        _map_tile(depth, side, CASCADE_COLOURS[i]) for i, depth in enumerate(frame.shadow_maps)
    ]
    columns = int(np.ceil(np.sqrt(len(tiles))))
    rows = -(-len(tiles) // columns)
    height, width = np.max([tile.shape[:2] for tile in tiles], axis=0)
    sheet = np.full((rows * height, columns * width, 3), 255, np.uint8)
    for i, tile in enumerate(tiles):
        top, left = i // columns * height, i % columns * width
        sheet[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return sheet


def cascades_picture(frame, picture):
    """Tint a picture of the scene by the cascade that each pixel looks up.

    Parameters
    ----------
    frame : Frame
        With `cascade_index` and `valid`.
    picture : (h, w, 3) uint8
        Of `lit_picture`.

    Returns
    -------
    picture : (h, w, 3) uint8
        Red, green, blue, yellow, … from the nearest on; grey beyond the shadow range.
    """
    index = frame.cascade_index
    brightness = _brightness(picture)[..., None]
    tint = CASCADE_COLOURS[np.minimum(index, len(CASCADE_COLOURS) - 1)]
    tint = np.where((index == 255)[..., None], 0.6, tint)
    tinted = tint * (0.25 + 0.95 * brightness)
    return _to_bytes(np.where(frame.valid[..., None], tinted, picture / 255.0))


def error_picture(report, picture):
    """Mark in a picture of the scene where the mask is wrong.

    Parameters
    ----------
    report : ErrorReport
    picture : (h, w, 3) uint8
        Of `lit_picture`.

    Returns
    -------
    picture : (h, w, 3) uint8
        Blue false light and orange false shadow, by their size, over pale grey; what is not judged
        is darker.
    """
    grey = _brightness(picture)
    grey = np.where(report.judged, 0.45 + 0.5 * grey, 0.15 + 0.5 * grey)[..., None]
    total = report.per_pixel["total"][..., None]
    light = np.maximum(total, 0.0)
    shadow = np.maximum(-total, 0.0)
    return _to_bytes(grey * (1.0 - light - shadow) + light * FALSE_LIGHT + shadow * FALSE_SHADOW)


def save_png(path, picture):
    """Write a picture to a PNG file.

    Parameters
    ----------
    path : path-like
    picture : (h, w, 3) uint8

    Raises
    ------
    ImportError
        If Pillow is missing.
    """
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError(
            "writing pictures needs Pillow: pip install cascaded-shadow-maps[plot]"
        ) from error
    Image.fromarray(picture).save(path, format="PNG", compress_level=6)


def _view_directions(camera):
    """Return unit directions (h, w, 3) of the pixels' rays."""
    x, y = camera.pixel_plane()
    if camera.orthographic:
        x, y = 0.0 * x, 0.0 * y
    view = x[None, :, None] * camera.right + y[:, None, None] * camera.up - camera.backward
    return view / np.linalg.norm(view, axis=-1, keepdims=True)


def _sky(view, to_light):
    """Return what is seen where there is no surface, (h, w, 3) linear: bluer upwards, a glow."""
    height = np.clip(view[..., 1:2], 0.0, 1.0)
    sky = SKY_HORIZON + (SKY_ZENITH - SKY_HORIZON) * np.sqrt(height)
    glow = np.clip(view @ to_light, 0.0, 1.0)[..., None]
    return sky + SUN_LIGHT * (0.25 * glow**16 + 0.8 * glow**5000)


def _exposed(colour, valid):
    """Scale linear colours so that the brightest surfaces come out light, as a camera would.

    Within limits: a night stays dark, and snow-white noon is not pulled down to grey.
    """
    if not valid.any():
        return colour
    bright = np.percentile(colour[valid].mean(axis=-1), 98)
    return colour * np.clip(0.55 / max(bright, 1e-6), 1.0, 5.0)


def _map_tile(depth, side, frame_colour):
    """Return one shadow map as (s, s, 3) uint8 with a border of `frame_colour`."""
    block = -(-len(depth) // side)
    padding = -len(depth) % block
    depth = np.pad(depth, (0, padding), constant_values=1.0)
    nearest = depth.reshape(len(depth) // block, block, -1, block).min(axis=(1, 3))
    nearest = nearest[::-1].astype(np.float64)
    held = nearest < 1.0
    low, high = np.percentile(nearest[held], (0.5, 99.5)) if held.any() else (0.0, 1.0)
    grey = 1.0 - 0.92 * np.clip((nearest - low) / max(high - low, 1e-12), 0.0, 1.0)
    tile = _to_bytes(np.where(held[..., None], grey[..., None], NO_MAP_DEPTH))
    border = max(1, len(tile) // 128)
    framed = np.empty((len(tile) + 2 * border, len(tile) + 2 * border, 3), np.uint8)
    framed[:] = _to_bytes(frame_colour)
    framed[border:-border, border:-border] = tile
    return framed


def _smoothstep(low, high, value):
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _brightness(picture):
    """Return the luma (h, w), 0 to 1, of an sRGB picture."""
    return picture @ np.array([0.2126, 0.7152, 0.0722]) / 255.0


def _to_srgb(linear):
    linear = np.clip(linear, 0.0, 1.0)
    low = linear <= 0.0031308
    return _to_bytes(np.where(low, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055))


def _to_bytes(values):
    return np.round(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)
