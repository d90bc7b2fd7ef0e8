"""Clip matrices of parallel light, whoever made them, read back as spaces and sizes."""

import numpy as np

from .spaces import as_vector, as_whole, real_array

__all__ = ["read_matrices"]

MAX_CASCADES = 8
MAX_SIZE = 65536
PARALLEL = 1e-5  # what float32 elements leave of a direction
UVZ_FROM_CLIP = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]])


def read_matrices(clip_from_world, splits, map_size, clip_z):
    """Return the arrays of `csm.Cascades` for matrices of any origin, as a dict by name.

    Parameters, results and errors are those of `csm.Cascades.from_matrices`.
    """
    matrices = _checked_matrices(clip_from_world)
    count = len(matrices)
    splits = as_vector("splits", splits, count + 1).copy()
    if not (np.diff(splits) > 0).all():
        raise ValueError(f"splits must ascend (got {splits.tolist()})")
    sizes = _checked_sizes(map_size, count)
    near_z, far_z = as_vector("clip_z", clip_z, 2)
    if sorted((near_z, far_z)) not in ([0.0, 1.0], [-1.0, 1.0]):
        raise ValueError(
            "clip_z must be (0, 1), (-1, 1), or either of them reversed "
            f"(got {near_z:g}, {far_z:g})"
        )

    clip = matrices.copy()
    clip[:, 2] = (matrices[:, 2] - near_z * matrices[:, 3]) / (far_z - near_z)
    spaces = [_read_matrix(i, clip[i], sizes[i]) for i in range(count)]
    return {
        "splits": splits,
        "clip_from_world": clip,
        "uvz_from_world": UVZ_FROM_CLIP @ clip,
        "lattice": np.zeros((count, 2), np.int64),
        "map_size": sizes,
        **{name: np.stack([space[name] for space in spaces]) for name in spaces[0]},
    }


def _checked_matrices(value):
    matrices = real_array("clip_from_world", value).astype(np.float64)
    if matrices.shape == (4, 4):
        matrices = matrices[None]
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4):
        raise ValueError(f"clip_from_world must be (n, 4, 4) (got shape {matrices.shape})")
    if not 1 <= len(matrices) <= MAX_CASCADES:
        raise ValueError(
            f"clip_from_world must hold 1 to {MAX_CASCADES} matrices (got {len(matrices)})"
        )
    for i, matrix in enumerate(matrices):
        if not np.isfinite(matrix).all():
            raise ValueError(f"clip_from_world[{i}] must be finite (got {matrix.tolist()})")
        # An affine matrix ends in the row 0 0 0 1; with that as its column it lies on its side.
        if not matrix[:3, 3].any() and matrix[3, :3].any():
            raise ValueError(
                f"clip_from_world[{i}] looks transposed: its last row {matrix[3].tolist()} holds "
                "the translation; give matrices for column vectors, clip = M @ (x, y, z, 1)"
            )
        if (matrix[3, :3] == 0).all() and matrix[3, 3] == 0:
            raise ValueError(f"clip_from_world[{i}] gives every point w = 0")
    return matrices


def _checked_sizes(map_size, count):
    given = real_array("map_size", map_size)
    if given.ndim == 0:
        given = np.repeat(given, count)
    if given.shape != (count,):
        raise ValueError(
            f"map_size must be one number or one for each of {count} cascades "
            f"(got shape {given.shape})"
        )
    return np.array([as_whole("map_size", size, 1, MAX_SIZE) for size in given.tolist()], np.intc)


def _read_matrix(i, clip, size):
    """Rotation, rest, texel size and depth range of one matrix with clip z in [0, 1]."""
    to_light = _columns(i, clip)
    # Where x and y are 0: the middle of the map, on the column that passes the world origin.
    across = np.stack([clip[0, :3], clip[1, :3], to_light])
    centre = np.linalg.solve(across, np.array([-clip[0, 3], -clip[1, 3], 0.0]))
    middle = clip @ np.append(centre, 1.0)
    w = middle[3]
    if not w > 0.0:
        raise ValueError(
            f"clip_from_world[{i}] gives w = {w:g} at the map's middle: it must be > 0"
        )
    x_axis = clip[0, :3] / np.linalg.norm(clip[0, :3])
    light_from_world = np.eye(4)
    light_from_world[:3, :3] = x_axis, np.cross(to_light, x_axis), to_light
    clip_from_light = clip @ light_from_world.T  # the inverse of a rotation
    # Along the middle column z grows by w times this per metre; light-view depth is -light z.
    slope = -(clip[2, :3] @ to_light) / w
    near = -(to_light @ centre) - middle[2] / w / slope
    return {
        "light_from_world": light_from_world,
        "clip_from_light": clip_from_light,
        "texel_size": 2.0 * w / (size * np.abs(np.diag(clip_from_light)[:2])),
        "depth_range": np.array([near, near + 1.0 / slope]),
    }


def _columns(i, clip):
    """Direction along which neither x, y nor w changes, towards smaller z."""
    x, y, z, w = clip[:, :3]
    lengths = np.linalg.norm(clip[:, :3], axis=1)
    across = np.cross(x, y)
    sine = np.linalg.norm(across)
    if not sine > 1e-9 * lengths[0] * lengths[1]:
        raise ValueError(f"clip_from_world[{i}] maps the world to a line: x and y change alike")
    to_light = across / sine
    along = z @ to_light
    if not abs(along) > 1e-12 * lengths[2]:
        raise ValueError(f"clip_from_world[{i}] has no depth: z does not change along the light")
    if abs(w @ to_light) > PARALLEL * lengths[3]:
        raise ValueError(
            f"clip_from_world[{i}] is that of a lamp with a place (w changes along its rays): "
            "only parallel light has cascades"
        )
    return -to_light if along > 0.0 else to_light
