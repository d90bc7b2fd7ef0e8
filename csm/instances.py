"""Instances: meshes set into the world by matrices, as arrays."""

import numpy as np

from .spaces import frozen, real_array, transform_points

__all__ = [
    "MAX_EXTENT",
    "checked_instance_mesh",
    "checked_transforms",
    "chosen_origin",
    "flattened",
    "measured_bounds",
]

# Float32 holds squares of distances up to 1e38; beyond this extent [m] shaders would overflow.
MAX_EXTENT = 1e18

# An instance whose determinant is this small against its columns' lengths has lost a dimension.
SINGULAR = 1e-12


def checked_instance_mesh(instance_mesh, mesh_count):
    """Check the mesh of each instance: (k,) int32 read-only; None is every mesh once.

    Raises TypeError or ValueError with what is wrong.
    """
    given = np.arange(mesh_count) if instance_mesh is None else np.asarray(instance_mesh)
    if given.dtype.kind not in "iu" or given.ndim != 1:
        raise TypeError(
            f"instance_mesh must be (k,) integers (got shape {given.shape}, dtype {given.dtype})"
        )
    if given.size and (given.min() < 0 or given.max() >= mesh_count):
        wrong = given.min() if given.min() < 0 else given.max()
        raise ValueError(f"instance_mesh must be 0 to {mesh_count - 1} (got {wrong})")
    unused = np.setdiff1d(np.arange(mesh_count), given)
    if unused.size:
        raise ValueError(f"every mesh must have an instance (mesh {unused[0]} has none)")
    return frozen(np.array(given, np.int32))


def checked_transforms(world_from_instance, count):
    """Check affine matrices: (count, 4, 4) float64 read-only; None is the identity.

    Raises TypeError or ValueError with the first instance that is wrong.
    """
    if world_from_instance is None:
        return frozen(np.tile(np.eye(4), (count, 1, 1)))
    given = real_array("world_from_instance", world_from_instance)
    if given.shape != (count, 4, 4):
        raise ValueError(f"world_from_instance must be ({count}, 4, 4) (got shape {given.shape})")
    transforms = np.array(given, np.float64, order="C")
    finite = np.isfinite(transforms).all(axis=(1, 2))
    affine = (transforms[:, 3] == (0.0, 0.0, 0.0, 1.0)).all(axis=1)
    invertible = _invertible(np.where(finite[:, None, None], transforms[:, :3, :3], 0.0))
    for sound, rule in ((finite, "finite"), (affine, "affine"), (invertible, "invertible")):
        if not sound.all():
            first = int(np.argmin(sound))
            raise ValueError(
                f"world_from_instance must be {rule} (instance {first} is "
                f"{transforms[first].tolist()})"
            )
    return frozen(transforms)


def _invertible(linear):
    # The volume that the columns' directions span: a tiny scale is fine, a flat one is not.
    # Dividing each column by its largest entry keeps tiny and huge scales representable.
    largest = np.abs(linear).max(axis=1, keepdims=True)
    linear = linear / np.where(largest > 0.0, largest, 1.0)
    lengths = np.linalg.norm(linear, axis=1).prod(axis=1)
    return np.abs(np.linalg.det(linear)) > SINGULAR * lengths


def measured_bounds(meshes, instance_mesh, world_from_instance):
    """Measure the corners of every drawn vertex: (2, 3) float64 read-only, world [m].

    Raises ValueError if the scene is too large for float32 shaders.
    """
    # Only vertices of triangles count: a stray one must not stretch the cascades.
    used = [mesh.positions[np.unique(mesh.triangles)] for mesh in meshes]
    bounds = np.array([[np.inf] * 3, [-np.inf] * 3])
    with np.errstate(over="ignore", invalid="ignore"):
        for number, transform in zip(instance_mesh, world_from_instance, strict=True):
            points = transform_points(transform, used[number])
            np.minimum(bounds[0], points.min(axis=0), out=bounds[0])
            np.maximum(bounds[1], points.max(axis=0), out=bounds[1])
        extent = (bounds[1] - bounds[0]).max()
    if not np.isfinite(bounds).all() or not extent <= MAX_EXTENT:
        raise ValueError(
            f"a scene must span at most {MAX_EXTENT:g} m (got bounds {bounds.tolist()})"
        )
    return frozen(bounds)


def chosen_origin(bounds):
    """Round the bounds' centre to a power of two of at most 1 m: (3,) float64, read-only.

    The step is at most 1/1024 of the extent, so float32 loses nothing by it; moving a scene by
    whole metres then moves the origin by exactly as much.
    """
    lower, upper = bounds
    extent = float((upper - lower).max())
    step = 1.0 if extent <= 0.0 else min(1.0, 2.0 ** (np.floor(np.log2(extent)) - 10.0))
    return frozen(np.round((lower + 0.5 * (upper - lower)) / step) * step + 0.0)  # no -0


def flattened(meshes, instance_mesh, world_from_instance, relative_to):
    """Bake instances: positions (n, 3) float64 minus `relative_to`, triangles (m, 3) int32.

    The point is subtracted from the translations before they are applied, so that large
    coordinates cost no precision. Faces of mirroring instances are flipped. Raises ValueError if
    the vertices are 2^31 or more.
    """
    drawn = [meshes[number] for number in instance_mesh]
    vertex_starts = np.cumsum([0, *(len(mesh.positions) for mesh in drawn)])
    triangle_starts = np.cumsum([0, *(len(mesh.triangles) for mesh in drawn)])
    if vertex_starts[-1] > np.iinfo(np.int32).max:
        raise ValueError(
            f"a scene flattens to fewer than 2^31 vertices (this one has {vertex_starts[-1]})"
        )
    positions = np.empty((vertex_starts[-1], 3))
    triangles = np.empty((triangle_starts[-1], 3), np.int32)
    mirrored = np.linalg.det(world_from_instance[:, :3, :3]) < 0
    for i, mesh in enumerate(drawn):
        transform = world_from_instance[i].copy()
        transform[:3, 3] -= relative_to
        first, last = vertex_starts[i : i + 2]
        positions[first:last] = transform_points(transform, mesh.positions)
        rows = slice(*triangle_starts[i : i + 2])
        order = [0, 2, 1] if mirrored[i] else [0, 1, 2]
        np.add(mesh.triangles[:, order], np.int32(first), out=triangles[rows])
    return positions, triangles
