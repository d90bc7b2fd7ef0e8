"""Cascades read back from clip matrices: either depth range, either hand, skewed and warped."""

import numpy as np
import oracles
import pytest
from views import kinds, rescaled_depth, shifted, turned

import csm
from csm import spaces

SUN = csm.Sun((0.35, 0.8, 0.25))
CAMERA = csm.Camera.look_at((3, 6, 9), (0, 4, -20), near=0.5, far=120, size=(160, 90))
SETTINGS = csm.ShadowSettings(fit="box", snap="none", map_size=256)
# Clip z of an engine at the caster side and at the far side, and the row operation to get there.
RANGES = {(0, 1): (1.0, 0.0), (-1, 1): (2.0, -1.0), (1, 0): (-1.0, 1.0), (1, -1): (-2.0, 1.0)}


def warped(cascades, strength, i=None):
    """The same windows seen through a homography of the map's x and y that keeps them a square:
    texels are smaller at its lower end. w = 1 + strength * y."""
    warp = np.diag([1 - abs(strength), 1.0, 1 - abs(strength), 1.0])
    warp[1, 3] = warp[3, 1] = strength
    clip = cascades.clip_from_world.copy()
    chosen = slice(None) if i is None else i
    clip[chosen] = warp @ clip[chosen]
    return clip


@pytest.mark.parametrize("clip_z", RANGES)
@pytest.mark.parametrize("mirror", [1, -1], ids=["plain", "mirrored"])
@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_what_was_placed_is_read_back(clip_z, mirror, offset):
    camera = CAMERA.translated((offset, 0, -offset))
    ours = csm.fit_cascades(camera, SUN, SETTINGS)
    scale, start = RANGES[clip_z]
    clip = ours.clip_from_world.copy()
    clip[:, 0] *= mirror
    clip[:, 2] = scale * clip[:, 2] + start * clip[:, 3]
    read = csm.Cascades.from_matrices(clip, ours.splits, ours.map_size, clip_z=clip_z)
    far = 1 + offset  # digits that coordinates cost
    assert np.allclose(read.texel_size, ours.texel_size, rtol=1e-13)
    assert np.allclose(read.depth_range, ours.depth_range, rtol=1e-13, atol=1e-14 * far)
    assert np.allclose(read.light_from_world[:, 2], ours.light_from_world[:, 2], atol=1e-15)
    turn = read.light_from_world[:, :3, :3]
    assert np.allclose(turn @ turn.transpose(0, 2, 1), np.eye(3), atol=1e-15)
    assert (np.linalg.det(turn) > 0).all()
    points = oracles.sample_slice(camera, 0.5, 100, 50, np.random.default_rng(1))
    for i in range(4):
        expected = spaces.transform_points(ours.clip_from_world[i], points) * [mirror, 1, 1]
        for matrix in (
            read.clip_from_world[i],
            read.clip_from_light[i] @ read.light_from_world[i],
        ):
            assert np.allclose(spaces.transform_points(matrix, points), expected, atol=1e-13 * far)
        uvz = spaces.transform_points(read.uvz_from_world[i], points)
        assert np.allclose(uvz, expected * [0.5, 0.5, 1] + [0.5, 0.5, 0], atol=1e-13 * far)
    assert (read.lattice == 0).all()
    assert csm.check_cascades(read, camera).ok
    assert csm.check_cascades(read, camera, select="map").ok


def test_a_depth_read_the_wrong_way_is_not_sound():
    ours = csm.fit_cascades(CAMERA, SUN, SETTINGS)
    depths = -oracles.camera_corners(CAMERA, 0.5, 120) @ ours.light_from_world[0, 2, :3]
    tight = rescaled_depth(ours, depths.min() - 1, depths.max() + 1)
    assert csm.check_cascades(tight, CAMERA).ok
    clip = tight.clip_from_world.copy()
    clip[:, 2] = 2 * clip[:, 2] - clip[:, 3]
    wrong = csm.Cascades.from_matrices(clip, ours.splits, ours.map_size)  # taken as (0, 1)
    assert kinds(csm.check_cascades(wrong, CAMERA)) == {"depth"}


def test_a_skewed_light_space_is_read():
    # x and z of the world along the light to the plane y = 0; depth is height.
    x, y, z = SUN.to_light
    skew = np.array([[1, -x / y, 0], [0, -z / y, 1], [0, -1, 0]], float)
    corners = oracles.camera_corners(CAMERA, CAMERA.near, CAMERA.far) @ skew.T
    low, high = corners.min(axis=0) - 0.1, corners.max(axis=0) + 0.1
    crop = np.eye(4)
    crop[:2, :2] = np.diag(2 / (high - low)[:2])
    crop[:2, 3] = -(high + low)[:2] / (high - low)[:2]
    crop[2, 2], crop[2, 3] = 1 / (high - low)[2], -low[2] / (high - low)[2]
    light = np.eye(4)
    light[:3, :3] = skew
    read = csm.Cascades.from_matrices(crop @ light, (CAMERA.near, CAMERA.far), 512)
    assert np.allclose(read.light_from_world[0, 2, :3], SUN.to_light, atol=1e-12)
    assert np.allclose(read.clip_from_light @ read.light_from_world, crop @ light, atol=1e-12)
    assert csm.check_cascades(read, CAMERA).ok
    assert kinds(csm.check_cascades(shifted(read, 0, 40), CAMERA)) == {"overflow"}


@pytest.mark.parametrize("strength", [0.05, -0.4, 0.9])
def test_a_warped_window_is_read(strength):
    ours = csm.fit_cascades(CAMERA, SUN, SETTINGS)
    read = csm.Cascades.from_matrices(warped(ours, strength), ours.splits, ours.map_size)
    assert np.allclose(read.light_from_world[:, 2, :3], SUN.to_light, atol=1e-12)
    for i in range(4):
        # The world point at the middle of the map, and steps of a texel across the light from it.
        middle = unproject(read.clip_from_world[i], [0, 0, 0.5])
        for axis in range(2):
            step = read.light_from_world[i, axis, :3] * 1e-6
            moved = spaces.transform_points(read.uvz_from_world[i], [middle - step, middle + step])
            texels = np.abs(moved[1] - moved[0])[axis] * 256
            assert read.texel_size[i, axis] == pytest.approx(2e-6 / texels, rel=1e-6)
        along = read.light_from_world[i, 2, :3]
        depth = -(middle @ along)
        for z, end in enumerate(read.depth_range[i]):
            place = spaces.transform_points(
                read.clip_from_world[i], [middle - (end - depth) * along]
            )
            assert place[0] == pytest.approx([0, 0, z], abs=1e-9)


@pytest.mark.parametrize("strength", [0.05, -0.4, 0.9])
def test_warped_windows_are_checked_by_their_own_texels(strength):
    ours = csm.fit_cascades(CAMERA, SUN, SETTINGS)
    read = csm.Cascades.from_matrices(warped(ours, strength), ours.splits, ours.map_size)
    # The homography keeps the window's sides, but narrows its lower end: what sticks out there?
    check = csm.check_cascades(read, CAMERA)
    for i in range(4):
        corners = oracles.camera_corners(CAMERA, *ours.splits[i : i + 2])
        outside = np.abs(spaces.transform_points(read.clip_from_world[i], corners)[:, :2]).max() - 1
        found = [p.amount for p in check.problems if (p.kind, p.cascade) == ("overflow", i)]
        if outside > 1e-4:
            assert found == pytest.approx([outside * 128], rel=1e-9)
        else:
            assert not found
    assert kinds(check) <= {"overflow"}
    moved = shifted(read, 3, 240)
    gaps = csm.check_cascades(moved, CAMERA, select="map")
    assert kinds(gaps) == {"gap"}
    for matrix in moved.clip_from_world[3:]:  # the others end before in depth or across
        clip = spaces.transform_points(matrix, gaps.gap_points)
        assert (np.abs(clip[:, :2]).max(axis=1) > 1).all()


def unproject(clip_from_world, clip):
    homogeneous = np.linalg.inv(clip_from_world) @ [*clip, 1]
    return homogeneous[:3] / homogeneous[3]


def test_random_windows_are_read_for_every_direction():
    rng = np.random.default_rng(11)
    for _ in range(200):
        camera = turned(rng, eye=rng.normal(size=3) * 100)
        ours = csm.fit_cascades(camera, csm.Sun(rng.normal(size=3)), SETTINGS)
        read = csm.Cascades.from_matrices(ours.clip_from_world, ours.splits, 256)
        assert np.allclose(read.light_from_world[:, 2], ours.light_from_world[:, 2], atol=1e-14)
        assert np.allclose(read.texel_size, ours.texel_size, rtol=1e-12)
        assert np.allclose(read.depth_range, ours.depth_range, rtol=1e-12, atol=1e-9)


def test_one_matrix_is_one_cascade():
    ours = csm.fit_cascades(CAMERA, SUN, SETTINGS.replace(cascade_count=1))
    read = csm.Cascades.from_matrices(ours.clip_from_world[0], ours.splits, 256, pancake=True)
    assert read.count == 1
    assert read.pancake
    assert read.map_size.dtype == np.intc
    with pytest.raises(ValueError, match="read-only"):
        read.clip_from_world[0, 0, 0] = 1


def test_bad_matrices_are_refused_by_name():
    ours = csm.fit_cascades(CAMERA, SUN, SETTINGS)
    good, splits = ours.clip_from_world, ours.splits
    lamp = spaces.perspective_rh_zo(1, 1, 1, 100) @ spaces.look_at(
        (0, 10, 0), (0, 0, -1), (0, 1, 0)
    )
    flat = good.copy()
    flat[1, 1] = flat[1, 0]
    no_depth = good.copy()
    no_depth[2, 2] = 0
    behind = good.copy()
    behind[0, 3, 3] = -1
    nothing = good.copy()
    nothing[0, 3, 3] = 0
    cases = [
        (good.transpose(0, 2, 1), splits, 256, (0, 1), r"clip_from_world\[0\] looks transposed"),
        (lamp, (1, 2), 256, (0, 1), "lamp with a place"),
        (flat, splits, 256, (0, 1), r"clip_from_world\[1\] maps the world to a line"),
        (no_depth, splits, 256, (0, 1), r"clip_from_world\[2\] has no depth"),
        (behind, splits, 256, (0, 1), "must be > 0"),
        (nothing, splits, 256, (0, 1), "w = 0"),
        (good * np.nan, splits, 256, (0, 1), "must be finite"),
        (good[:, :3], splits, 256, (0, 1), r"\(n, 4, 4\)"),
        (np.repeat(good, 3, axis=0), splits, 256, (0, 1), "1 to 8 matrices"),
        (good, splits[:3], 256, (0, 1), "splits must be 5 numbers"),
        (good, splits[::-1], 256, (0, 1), "splits must ascend"),
        (good, splits, (256, 256), (0, 1), "map_size must be one number or one for each"),
        (good, splits, 0, (0, 1), "map_size must be"),
        (good, splits, 256, (1, 1), r"clip_z must be \(0, 1\)"),
    ]
    for clip, edges, size, clip_z, match in cases:
        with pytest.raises(ValueError, match=match):
            csm.Cascades.from_matrices(clip, edges, size, clip_z=clip_z)
    with pytest.raises(TypeError, match="clip_from_world must be an array"):
        csm.Cascades.from_matrices("matrix", splits, 256)
    with pytest.raises(TypeError, match="map_size must be a whole number"):
        csm.Cascades.from_matrices(good, splits, 256.5)
