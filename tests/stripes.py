"""Slats over a ground: stripes of light whose share of every pixel is known."""

import numpy as np
import probes

import csm
from csm import shapes


def striped():
    """Slats high above the ground, seen from between the two."""
    positions, triangles = shapes.ground(200.0)
    slats = np.arange(-60, 60)[:, None, None] * np.array([0.5, 0.0, 0.0])
    corners = np.array([[0, 3, -60], [0.25, 3, -60], [0.25, 3, 30], [0, 3, 30]]) + slats
    more = np.array([[0, 2, 1], [0, 3, 2]]) + 4 * np.arange(120)[:, None, None] + len(positions)
    return csm.Scene.from_arrays(
        np.concatenate([positions, corners.reshape(-1, 3)]),
        np.concatenate([triangles, more.reshape(-1, 3)]),
    )


def stripe_share(camera, to_light, samples=8):
    """(h, w) share of each pixel's ground that the slats of `striped` leave in the sun."""
    column, row = probes.centres(camera)
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    lit = np.zeros(row.shape)
    for dx in offsets:
        for dy in offsets:
            ground = probes.ground_points(camera, column + dx, row + dy)
            x = ground[..., 0] + 3.0 * to_light[0] / to_light[1]
            lit += np.mod(x, 0.5) >= 0.25
    return lit / samples**2
