"""Cameras, scenes and checks that the tests of the core share."""

import numpy as np
import oracles

import csm
from csm import spaces


def turned(rng, fov=60.0, near=0.1, far=100.0, size=(16, 9), eye=(0.0, 0.0, 0.0)):
    """A camera with a random orientation, roll included."""
    axes = oracles.random_rotation(rng)
    half_height = np.tan(np.radians(fov / 2))
    return csm.Camera(
        np.array(eye), *axes, half_height * size[0] / size[1], half_height, near, far, size, False
    )


def scene_of(bounds):
    """A scene with just these bounds: two triangles between opposite corners of the box."""
    low, high = np.asarray(bounds, float)
    middle = [low[0], high[1], 0.5 * (low[2] + high[2])]
    return csm.Scene.from_arrays(
        [low, high, middle, [high[0], low[1], low[2]]], [[0, 1, 2], [0, 1, 3]]
    )


def clip_points(cascades, i, points):
    return spaces.transform_points(cascades.clip_from_world[i], points)


def assert_finite(cascades):
    for name in ("splits", "clip_from_light", "clip_from_world", "uvz_from_world", "texel_size"):
        assert np.isfinite(getattr(cascades, name)).all(), name
    assert (cascades.texel_size > 0).all()
    assert (np.diff(cascades.depth_range, axis=1) > 0).all()


def assert_covers(camera, cascades, padding, rng, *, scene=None, samples=60):
    """Slices inside their own inner windows, points of the view in a window not after theirs; in
    depth only points inside the scene, where there is one."""
    assert misses(camera, cascades, padding, rng, scene=scene, samples=samples) == 0


def uncovered(camera, cascades, padding, rng, *, scene=None, samples=200):
    """Number of sampled points of the view, in the scene where there is one, that no map's inner
    window and depth range hold."""
    inner = 1 - 2 * padding / cascades.map_size
    reach = np.abs(oracles.camera_corners(camera, camera.near, cascades.splits[-1])).max()
    reach = max(reach, np.abs(camera.eye).max())
    slack = 1e-12 + 32 * oracles.U * reach / (cascades.texel_size.min(axis=1) * cascades.map_size)
    bare = 0
    for i in range(cascades.count):
        points = oracles.sample_slice(camera, *cascades.splits[i : i + 2], samples, rng)
        if scene is not None:
            points = points[((points >= scene.bounds[0]) & (points <= scene.bounds[1])).all(axis=1)]
        held = np.zeros(len(points), bool)
        for j in range(cascades.count):
            clip = clip_points(cascades, j, points)
            inside = (np.abs(clip[:, :2]) <= inner[j] + slack[j]).all(axis=1)
            held |= inside & (clip[:, 2] >= -slack[j]) & (clip[:, 2] <= 1 + slack[j])
        bare += np.count_nonzero(~held)
    return bare


def misses(camera, cascades, padding, rng, *, scene=None, samples=60):
    """Number of sampled points of the slices that their own inner window, or every window up to
    it, does not hold; in depth only points inside the scene count, where there is one."""
    missed = 0
    inner = 1 - 2 * padding / cascades.map_size
    # Rounding: coordinates up to the farthest corner in doubles, in half windows.
    reach = np.abs(oracles.camera_corners(camera, camera.near, cascades.splits[-1])).max()
    reach = max(reach, np.abs(camera.eye).max())
    slack = 1e-12 + 32 * oracles.U * reach / (cascades.texel_size.min(axis=1) * cascades.map_size)
    for i in range(cascades.count):
        points = oracles.sample_slice(camera, *cascades.splits[i : i + 2], samples, rng)
        first = np.full(len(points), 99)
        depth_free = np.zeros(len(points), bool)
        if scene is not None:
            depth_free = ((points < scene.bounds[0]) | (points > scene.bounds[1])).any(axis=1)
        for j in reversed(range(cascades.count)):
            clip = clip_points(cascades, j, points)
            held = (np.abs(clip[:, :2]) <= inner[j] + slack[j]).all(axis=1)
            held &= depth_free | ((clip[:, 2] >= 0) & (clip[:, 2] <= 1))
            first[held] = j
            if j == i:
                missed += np.count_nonzero(~held)
        missed += np.count_nonzero(first > i)
    return missed


# Cascades with defects, and what checks say of them


def kinds(check):
    return {problem.kind for problem in check.problems}


def shifted(cascades, i, texels, axis=0):
    """The same cascades with one map moved by some of its texels."""
    clip = cascades.clip_from_world.copy()
    clip[i, axis] += 2.0 * texels / cascades.map_size[i] * clip[i, 3]
    return csm.Cascades.from_matrices(clip, cascades.splits, cascades.map_size)


def rescaled_depth(cascades, near, far):
    """The same windows with another depth range [m, light-view depths]."""
    clip = cascades.clip_from_world.copy()
    clip[:, 2] = 0.0
    clip[:, 2, :3] = -cascades.light_from_world[:, 2, :3]
    clip[:, 2, 3] = -near
    clip[:, 2] /= far - near
    return csm.Cascades.from_matrices(clip, cascades.splits, cascades.map_size)


def volume_samples(camera, near, far, count, rng):
    """World points even in the volume of the view between two depths."""
    depth = np.cbrt(rng.uniform(near**3, far**3, count))
    x, y = rng.uniform(-1, 1, (2, count)) * [[camera.half_width], [camera.half_height]] * depth
    return camera.eye + np.stack([x, y, depth], 1) @ np.stack(
        [camera.right, camera.up, -camera.backward]
    )
