"""Small scenes with cut-outs, and what slow doubles say of them."""

import numpy as np

import csm
from csm import shapes, spaces

QUAD_UV = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], float)
QUAD_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
CHECKER = (np.indices((8, 8)).sum(axis=0) % 2 * 255).astype(np.uint8)


def level(height=3.0, half=2.0, uv=QUAD_UV, alpha=CHECKER, cutoff=0.5):
    """A level square about the y axis; u goes along x, v along z."""
    corners = half * np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], float)
    corners[:, 1] = height
    return csm.Mesh(corners, QUAD_TRIANGLES, "level", uv, alpha, cutoff)


def solid(mesh):
    """The same mesh without its cut-out."""
    return csm.Mesh(mesh.positions, mesh.triangles, mesh.name)


def on_ground(*meshes, half=10.0):
    return csm.Scene([shapes.mesh("ground", shapes.ground(half)), *meshes])


def scraps(seed=4, count=40):
    """Triangles at random under images of odd sizes, some placed again turned, scaled, mirrored."""
    rng = np.random.default_rng(seed)
    meshes = [shapes.mesh("ground", shapes.ground(12.0))]
    for name, shape in (("a", (5, 3)), ("b", (33, 70)), ("c", (1, 1)), ("d", (2, 65))):
        centre = rng.uniform((-6, 0.5, -6), (6, 5, 6), size=(count // 4, 1, 3))
        corners = centre + rng.normal(size=(count // 4, 3, 3)) * 1.3
        uv = rng.uniform(-2.0, 3.0, size=(3 * (count // 4), 2))
        alpha = rng.uniform(size=shape).astype(np.float32)
        triangles = np.arange(3 * (count // 4)).reshape(-1, 3)
        meshes.append(csm.Mesh(corners.reshape(-1, 3), triangles, name, uv, alpha, 0.45))
    stand = shapes.placements(rng.uniform(-3, 3, (3, 3)), (10, 80, 200), [1.0, 0.6, 0.8])
    stand[1, :3, 0] *= -1.0  # a mirror
    return csm.Scene(
        meshes,
        [0, 1, 2, 3, 4, 1, 2, 2],
        np.concatenate([np.tile(np.eye(4), (5, 1, 1)), stand]),
        name="scraps",
    )


def looked_up(mesh, places):
    """Whether the mesh is there at places (..., 2) of its image, texel by texel."""
    height, width = mesh.alpha.shape
    share = mesh.alpha / 255.0 if mesh.alpha.dtype == np.uint8 else mesh.alpha
    column = np.floor(places[..., 0] * width).astype(int) % width
    row = np.floor(places[..., 1] * height).astype(int) % height
    return share[row, column] >= mesh.alpha_cutoff


def first_hits(scene, origins, directions):
    """Parameter of the nearest hit that is there, by every triangle in doubles; inf for none."""
    best = np.full(len(origins), np.inf)
    for number, transform in zip(scene.instance_mesh, scene.world_from_instance, strict=True):
        mesh = scene.meshes[number]
        positions = spaces.transform_points(transform, mesh.positions) - scene.origin
        positions = positions.astype(np.float32).astype(np.float64) + scene.origin
        for triangle in mesh.triangles:
            a, b, c = positions[triangle]
            with np.errstate(divide="ignore", invalid="ignore"):
                matrix = np.stack([b - a, c - a, -np.ones(3)], axis=1)
                normal = np.cross(matrix[:, 0], matrix[:, 1])
                t = ((a - origins) @ normal) / (directions @ normal)
                inside = origins + t[:, None] * directions - a
                gram = np.linalg.inv(matrix[:, :2].T @ matrix[:, :2])
                second, third = gram @ (inside @ matrix[:, :2]).T
            met = (second >= 0) & (third >= 0) & (second + third <= 1) & (t > 1e-5) & (t < best)
            if mesh.alpha is not None:
                shares = np.nan_to_num(np.stack([1 - second - third, second, third], axis=1))
                met &= looked_up(mesh, np.clip(shares, 0, 1) @ mesh.uv[triangle])
            best[met] = t[met]
    return best
