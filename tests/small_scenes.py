"""Scenes of few triangles for oracles that try every triangle, with cameras and suns."""

import numpy as np

import csm
from csm import shapes, spaces

SIZE = (160, 90)

SUNS = {
    "high": (0.4, 1.0, 0.3),
    "low": (-0.8, 0.25, 0.5),
    "axis": (0.0, 1.0, 0.0),
    "in_the_face": (-0.6, 0.3, -0.74),
}


def soup(count=60, seed=1):
    """Triangles of all sizes and directions over a ground."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform((-8, 0.5, -8), (8, 6, 8), size=(count, 1, 3))
    corners = centre + rng.normal(size=(count, 3, 3)) * 10.0 ** rng.uniform(
        -1.5, 0.4, (count, 1, 1)
    )
    ground, triangles = shapes.ground(14.0)
    positions = np.concatenate([ground, corners.reshape(-1, 3)])
    more = np.arange(3 * count).reshape(-1, 3) + len(ground)
    return csm.Scene.from_arrays(positions, np.concatenate([triangles, more]), name="soup")


def copies(count=14, seed=2):
    """One pyramid placed many times: turned, scaled unevenly, mirrored; drawn as instances."""
    rng = np.random.default_rng(seed)
    pyramid = shapes.mesh("pyramid", shapes.cone(0.8, 0.0, 2.0, sides=4))
    points = rng.uniform((-7, 0, -7), (7, 0.5, 7), size=(count, 3))
    scales = rng.uniform(0.4, 1.5, size=(count, 3))
    scales[::3, 0] *= -1.0
    matrices = shapes.placements(points, rng.uniform(0, 360, count), scales)
    ground = shapes.mesh("ground", shapes.ground(12.0))
    return csm.Scene(
        [ground, pyramid],
        [0] + [1] * count,
        np.concatenate([np.eye(4)[None], matrices]),
        name="copies",
    )


SCENES = {
    "plane and box": csm.scenes.plane_and_box,
    "stairs": lambda: csm.scenes.stairs(6),
    "soup": soup,
    "copies": copies,
}


def camera(number=0, size=SIZE, near=0.2, far=80.0):
    """Views of a scene about the origin, some 15 m wide."""
    eye, target = [
        ((7, 5, 9), (-0.5, 0.6, 0)),
        ((-4, 0.9, 3), (1, 0.8, -2)),
        ((0.5, 16, 0.2), (0, 0, 0)),
        ((-9, 2.0, -7), (0, 1.5, 0)),
    ][number]
    return csm.Camera.look_at(eye, target, fov_y_deg=50, near=near, far=far, size=size)


def pixel_rays(camera):
    """(h, w, 3) from the eye to view depth 1 through each pixel's centre, and where rays start."""
    width, height = camera.size
    x = (2.0 * (np.arange(width) + 0.5) / width - 1.0) * camera.half_width + camera.centre_x
    y = (1.0 - 2.0 * (np.arange(height) + 0.5) / height) * camera.half_height + camera.centre_y
    across = x[None, :, None] * camera.right + y[:, None, None] * camera.up
    if camera.orthographic:
        return np.broadcast_to(-camera.backward, across.shape), camera.eye + across
    return across - camera.backward, np.broadcast_to(camera.eye, across.shape)


def positions_of(frame):
    """(h, w, 3) float64 world point of each pixel, from its view depth; not finite where none."""
    directions, starts = pixel_rays(frame.camera)
    depth = np.where(frame.valid, frame.view_depth.astype(np.float64), np.nan)
    return starts + depth[..., None] * directions


def texels_of(cascades, i, points):
    """(..., 3): u and v in texels and clip depth of world points in map i."""
    uvz = spaces.transform_points(cascades.uvz_from_world[i], points)
    uvz[..., :2] *= cascades.map_size[i]
    return uvz
