"""Cameras on their way through small scenes."""

import numpy as np
import small_scenes

import csm

SIZE = (64, 36)


def step(camera, forward=0.0, aside=0.0, turn_deg=0.0):
    """The camera moved along its axes [m] and turned about the world's y."""
    angle = np.radians(turn_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    ahead = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]) @ -camera.backward
    eye = camera.eye - forward * camera.backward + aside * camera.right
    return csm.Camera.look_at(
        eye, eye + ahead, fov_y_deg=camera.fov_y_deg, near=camera.near, far=camera.far,
        size=camera.size,
    )  # fmt: skip


def path(camera=None):
    """Stand, creep, turn where no window moves, step, turn far, and stand again."""
    camera = camera or small_scenes.camera(0, size=SIZE)
    moves = [
        {}, {}, {"aside": 0.003}, {"turn_deg": 0.02}, {"turn_deg": -0.05}, {"forward": 0.04},
        {"forward": 0.3, "turn_deg": 1.0}, {}, {"turn_deg": 40.0}, {"turn_deg": 0.02}, {},
    ]  # fmt: skip
    for move in moves:
        camera = step(camera, **move) if move else camera
        yield camera
