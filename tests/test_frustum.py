"""Corners, planes and matrices of a camera's slice, and what a box holds of it."""

import drawings
import numpy as np
import oracles
import pytest

import csm
from csm import _core, spaces

PERSPECTIVE = csm.Camera.look_at(
    (3.0, 2.0, -5.0), (1.0, 1.0, 7.0), fov_y_deg=50, near=0.2, far=90, size=(1280, 720)
)
ORTHOGRAPHIC = csm.Camera.orthographic(
    (3.0, 2.0, -5.0), (1.0, 1.0, 7.0), height=8.0, near=-4.0, far=60, size=(1280, 720)
)
STEEP = csm.Camera.look_at((0, 10, 0), (0, 0, 0), up=(1, 0, 1), fov_y_deg=100, near=1, far=20)
OFF_CENTRE = PERSPECTIVE.replace(centre_x=1.3, centre_y=-0.2)
BOTH = pytest.mark.parametrize(
    "camera",
    [PERSPECTIVE, ORTHOGRAPHIC, OFF_CENTRE, ORTHOGRAPHIC.replace(centre_x=-9.0, centre_y=3.0)],
    ids=["perspective", "ortho", "off-centre", "ortho off-centre"],
)


def test_corners_of_a_camera_at_the_origin():
    camera = csm.Camera.look_at(
        (0, 0, 0), (0, 0, -1), fov_y_deg=90, near=1, far=10, size=(200, 100)
    )
    # Looks down -z, tangents 2 and 1: the corners are whole numbers; order LB LT RT RB, near, far.
    expected = [(-2, -1, -1), (-2, 1, -1), (2, 1, -1), (2, -1, -1)]
    expected += [(-20, -10, -10), (-20, 10, -10), (20, 10, -10), (20, -10, -10)]
    corners = _core.frustum_corners(camera, 1.0, 10.0)
    # tan(45 deg) in doubles is 1 - 1e-16.
    np.testing.assert_allclose(corners, expected, rtol=4 * oracles.U, atol=0)


@BOTH
def test_corners_equal_the_oracle_and_clip_space(camera):
    corners = _core.frustum_corners(camera, camera.near, camera.far)
    np.testing.assert_allclose(
        corners, oracles.camera_corners(camera, camera.near, camera.far), rtol=0, atol=1e-12
    )
    view_from_world, clip_from_view = _core.camera_matrices(camera)
    clip = spaces.transform_points(clip_from_view @ view_from_world, corners)
    expected = [(-1, -1), (-1, 1), (1, 1), (1, -1)] * 2
    np.testing.assert_allclose(clip[:, :2], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(clip[:, 2], [0] * 4 + [1] * 4, rtol=0, atol=1e-12)


@BOTH
def test_matrices_equal_those_of_python(camera):
    view_from_world, clip_from_view = _core.camera_matrices(camera)
    np.testing.assert_allclose(view_from_world, camera.view_from_world, rtol=0, atol=1e-14)
    np.testing.assert_allclose(clip_from_view, camera.clip_from_view, rtol=1e-14, atol=1e-14)


@BOTH
def test_planes_hold_their_corners(camera):
    near, far = 2.0, 40.0
    planes = _core.frustum_planes(camera, near, far)
    corners = _core.frustum_corners(camera, near, far)
    distances = corners @ planes[:, :3].T + planes[:, 3]
    np.testing.assert_allclose(np.linalg.norm(planes[:, :3], axis=1), 1.0, rtol=1e-15)
    on_plane = np.zeros((8, 6), bool)  # left right bottom top near far
    on_plane[[0, 1, 4, 5], 0] = on_plane[[2, 3, 6, 7], 1] = True
    on_plane[[0, 3, 4, 7], 2] = on_plane[[1, 2, 5, 6], 3] = True
    on_plane[:4, 4] = on_plane[4:, 5] = True
    # Coordinates of some 100 m and a few roundings each.
    assert np.abs(distances[on_plane]).max() <= 1e-12
    assert distances[~on_plane].min() > 0.1


def test_corners_do_not_lose_digits_where_unprojection_does():
    # f/n = 1e10: going through clip space, depth would be off by eps f/n = 2e-6 relative.
    camera = csm.Camera.look_at((0, 0, 0), (0, 0, -1), fov_y_deg=60, near=1e-4, far=1e6)
    corners = _core.frustum_corners(camera, camera.near, camera.far)
    assert np.array_equal(corners[:4, 2], [-1e-4] * 4)
    assert np.array_equal(corners[4:, 2], [-1e6] * 4)


def random_boxes(camera, rng, count):
    """Boxes of all sizes in and round the frustum, a third of them flat or lines."""
    near, far = camera.near, camera.far
    for _ in range(count):
        inside = oracles.sample_slice(camera, near, far, 40, rng)[rng.integers(8, 40)]
        centre = inside + rng.normal(size=3) * 10.0 ** rng.uniform(-2, 2)
        half = 10.0 ** rng.uniform(-2, 2.3, size=3)
        half[rng.uniform(size=3) < 0.15] = 0.0
        yield np.stack([centre - half, centre + half])


@pytest.mark.parametrize(
    "camera",
    [PERSPECTIVE, ORTHOGRAPHIC, STEEP, OFF_CENTRE],
    ids=["perspective", "ortho", "steep", "off-centre"],
)
def test_g2_depth_of_a_box_equals_vertex_enumeration(figure, camera):
    rng = np.random.default_rng(3)
    planes = oracles.camera_planes(camera, camera.near, camera.far)
    met, worst, pairs = 0, 0.0, []
    for bounds in random_boxes(camera, rng, 150):
        all_planes = np.concatenate([planes, oracles.box_planes(bounds)])
        tolerance = 1e-9  # coordinates of 100 m in doubles, normals good to 1e-13
        vertices = oracles.polytope_vertices(all_planes, tolerance)
        depth = _core.frustum_depth_of_box(camera, bounds)
        if depth is None:
            # Only what touches to within the tolerance may be judged differently.
            assert len(oracles.polytope_vertices(all_planes, -tolerance)) == 0
            continue
        met += 1
        assert len(vertices) > 0
        expected = ((vertices - camera.eye) @ -camera.backward).max()
        worst = max(worst, abs(depth - expected) / camera.far)
        pairs.append((expected, depth))
    assert met > 50
    figure(
        "G2", "depth of the scene's bounds in view", worst, 1e-6, "of far",
        picture=lambda: drawings.chart(
            lambda axes: axes.plot(*np.transpose(pairs), "."), size=(4, 4),
            title="depth by vertices [m], by the core [m]",
        ),
    )  # fmt: skip


def test_g2_a_box_round_the_frustum_gives_far_and_a_box_behind_gives_none():
    everything = np.array([[-1e4] * 3, [1e4] * 3])
    assert _core.frustum_depth_of_box(PERSPECTIVE, everything) == PERSPECTIVE.far
    behind = PERSPECTIVE.eye + 10 * PERSPECTIVE.backward
    assert _core.frustum_depth_of_box(PERSPECTIVE, np.stack([behind - 1, behind + 1])) is None


def test_g2_a_flat_box_across_the_frustum():
    camera = csm.Camera.look_at((0, 2, 0), (0, 2, -1), fov_y_deg=90, near=0.5, far=100)
    ground = [[-20, 0, -30], [20, 0, 5]]
    assert _core.frustum_depth_of_box(camera, ground) == pytest.approx(30, abs=1e-12)
    # A wall without thickness, seen edge-on.
    wall = [[0, -5, -7], [0, 5, -6]]
    assert _core.frustum_depth_of_box(camera, wall) == pytest.approx(7, abs=1e-12)


def test_g2_a_box_that_touches_the_frustum_is_met():
    camera = csm.Camera.look_at((0, 0, 0), (0, 0, -1), fov_y_deg=60, near=1, far=16, size=(9, 9))
    assert _core.frustum_depth_of_box(camera, [[-1, -1, -0.9], [1, 1, 5]]) is None
    assert _core.frustum_depth_of_box(camera, [[-1, -1, -1], [1, 1, 5]]) == 1.0
    assert _core.frustum_depth_of_box(camera, [[-1, -1, -30], [1, 1, -16]]) == 16.0


def test_depth_keeps_its_digits_far_from_the_origin():
    # Whole metres, so that the moved numbers are exact and only the core's own roundings count.
    offset = np.array([1e8, -1e8, 1e8])
    bounds = np.array([[-20.0, -4.0, -3.0], [20.0, 9.0, 30.0]])
    here = _core.frustum_depth_of_box(PERSPECTIVE, bounds)
    there = _core.frustum_depth_of_box(PERSPECTIVE.translated(offset), bounds + offset)
    assert there == here


def broken(**changes):
    """A camera-like object past Python's own checks, as a C caller could make one."""
    names = "eye right up backward half_width half_height near far size orthographic"
    names = [*names.split(), "centre_x", "centre_y"]
    values = {name: getattr(PERSPECTIVE, name) for name in names} | changes
    return type("Broken", (), values)()


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"eye": np.array([0, np.nan, 0])}, "eye must be finite"),
        ({"right": 2 * PERSPECTIVE.right}, "orthonormal"),
        ({"right": -PERSPECTIVE.right}, "right-handed"),
        ({"half_width": 0.0}, "half_width .* > 0 .got 0"),
        ({"half_height": np.inf}, "half_height .* finite"),
        ({"centre_x": np.nan}, "centre_x and centre_y must be finite .got nan, 0"),
        ({"near": 5.0, "far": 2.0}, "far must be > near, both finite .got near 5, far 2"),
        ({"near": 0.0}, "near must be > 0 for a perspective camera"),
        ({"size": (0, 10)}, "size must be at least 1 x 1 pixels .got 0 x 10"),
        ({"near": -1.0, "size": (10, 0)}, "near must be > 0 .*\n.*size must be"),
    ],
)
def test_a_broken_camera_is_refused_with_every_reason(changes, text):
    with pytest.raises(ValueError, match=text):
        _core.frustum_corners(broken(**changes), 1.0, 2.0)


@pytest.mark.parametrize(("near", "far"), [(2.0, 1.0), (1.0, 1.0), (0.0, np.nan), (1.0, np.inf)])
def test_a_slice_must_have_a_length(near, far):
    with pytest.raises(ValueError, match="far must be > near"):
        _core.frustum_planes(PERSPECTIVE, near, far)
