"""Published listings as printed, errors and all, for tests that show what is wrong with them.

[Zhang2009] is Zhang, Zaprjagaev, Bentham: Practical cascaded shadow maps (listings 4.1.1 to 4.1.6);
[MSDN] and [theomader] are the articles of docs/references.md. Rewritten for numpy; names follow the
sources. Not to be used.
"""

import numpy as np

# -- [Zhang2009] -----------------------------------------------------------------------------------


def zhang_4_1_1_centre(centre, radius, size_sm):
    """The centre of the window of MatrixOrthoProjection(-radius, radius, ...), along up or side."""
    return np.ceil(centre * size_sm / radius) * radius / size_sm


def zhang_4_1_1_origin(centre, direction, far):
    """The light's position, from which depths near to far are drawn along `direction`."""
    return centre - direction * far


def zhang_4_1_2(low, high, size_sm):
    """Scale and offset of the crop along one axis of the light's post-perspective space."""
    quantizer = 64.0
    scale = 2.0 / (high - low)
    scale = 1.0 / np.ceil(1.0 / scale * quantizer) * quantizer
    offset = -0.5 * (high + low) * scale
    half_texture = 0.5 * size_sm
    return scale, np.ceil(offset * half_texture) / half_texture


def zhang_4_1_3(texcoord):
    """Which of a point's four atlas coordinates (4, 2) is sampled; None for "lit" without a look.

    The third line lacks a parenthesis; it is supplied here, nothing else.
    """
    centres = ((0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75))
    reach = [np.abs(texcoord[i] - centres[i]).max() for i in range(4)]
    sampled = 0
    if reach[0] >= 0.25:
        sampled = 1
        if reach[1] <= 0.25:
            sampled = 2
            if reach[2] <= 0.25:
                sampled = 3
                if reach[3] <= 0.25:
                    return None
    return sampled


def zhang_4_1_4(split):
    """The map that either method samples for a split; None is "the rest of the code"."""
    return 0 if split > 1 else None


def zhang_4_1_6(split_index):
    """Split indices of a quad (2, 2), made "consistent"."""
    power = np.round(2.0**split_index).astype(int)
    dx = np.abs(np.diff(power, axis=1)).repeat(2, axis=1)
    dy = np.abs(np.diff(power, axis=0)).repeat(2, axis=0)
    dxy = np.abs(np.diff(dy, axis=1)).repeat(2, axis=1)
    _split = np.maximum(dxy, np.maximum(dx, dy))  # computed, never used
    return np.where(power > 0, np.log(power).astype(int), split_index)


# -- [MSDN] ----------------------------------------------------------------------------------------


def msdn_interval_index(depth, splits):
    """Interval-based selection; `splits` are the far depths of the cascades."""
    count = len(splits)
    index = np.count_nonzero(np.asarray(depth)[..., None] > splits, axis=-1)
    return np.minimum(index, count)


def msdn_shadow_to_screen(ddx, ddy):
    """The inverse of the matrix with rows ddx and ddy of the shadow map's coordinates."""
    inverse_determinant = 1.0 / (ddx[0] * ddy[1] - ddx[1] * ddy[0])
    return np.array([[ddy[1], -ddx[1]], [-ddy[0], ddx[0]]]) * inverse_determinant


def msdn_pcf_offsets(right, up, first, last):
    """What the PCF loop adds to the depth it compares at each tap, the sum never being reset."""
    offsets, depth = {}, 0.0
    for x in range(first, last):
        for y in range(first, last):
            depth += right * x + up * y
            offsets[x, y] = depth
    return offsets


# -- [theomader] -----------------------------------------------------------------------------------


def theomader_view(look, light_position):
    """mShadowView, for row vectors: x and y along world x and z."""
    return np.linalg.inv(
        [
            [1, 0, 0, 0],
            [0, 0, -1, 0],
            [-look[0], -look[1], -look[2], 0],
            [*light_position, 1],
        ]
    )


def theomader_window(low, high, shadow_map_size):
    """min and max of the projection along one axis, `shadow_map_size` being a size in the world."""
    step = 1.0 / shadow_map_size
    return low - (low - np.round(low / step) * step), high + shadow_map_size


def theomader_split_depth(depth, near, far):
    """A split's view depth after a projection to clip space and back, in float32."""
    n, f, z = (np.float32(value) for value in (near, far, depth))
    scale, shift = f / (f - n), n * f / (f - n)
    with np.errstate(divide="ignore"):
        return shift / (scale - (scale * z - shift) / z)
