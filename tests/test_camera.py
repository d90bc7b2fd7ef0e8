"""Cameras and suns: where they look, that they are values, what they refuse."""

import pickle

import numpy as np
import pytest

from csm.scene import Camera, Sun

NAN, INF = float("nan"), float("inf")


def project(camera, points):
    """Clip coordinates divided by w, written out from the conventions (not from csm.spaces)."""
    clip = camera.clip_from_view @ camera.view_from_world @ np.append(points, 1.0)
    return clip[:3] / clip[3]


# ----------------------------------------------------------------------------------------- camera


def test_camera_sees_what_it_looks_at():
    camera = Camera.look_at((3, 4, 5), (1, -2, 0), fov_y_deg=40, near=0.5, far=50, size=(640, 360))
    forward = -camera.backward
    # Rounding of a few dot products of numbers below 10.
    assert np.allclose(project(camera, np.array([1.0, -2, 0]))[:2], 0, atol=1e-14)
    assert project(camera, camera.eye + 0.5 * forward)[2] == pytest.approx(0, abs=1e-14)
    assert project(camera, camera.eye + 50 * forward)[2] == pytest.approx(1, abs=1e-14)
    edge = camera.eye + 7 * (forward + np.tan(np.radians(20)) * camera.up)
    assert project(camera, edge)[1] == pytest.approx(1, abs=1e-13)
    side = camera.eye + 7 * (forward + np.tan(np.radians(20)) * 640 / 360 * camera.right)
    assert project(camera, side)[0] == pytest.approx(1, abs=1e-13)
    assert camera.fov_y_deg == pytest.approx(40, abs=1e-12)
    assert camera.up[1] > 0


def test_orthographic_camera_is_a_box():
    camera = Camera.orthographic(
        (0, 10, 0), (0, 0, 0), up=(0, 0, -1), height=6, near=-5, far=30, size=(200, 100)
    )
    assert camera.orthographic is True
    assert camera.fov_y_deg == 0.0
    # Straight down with north up: +x is right, -z is the top of the picture.
    assert np.allclose(project(camera, np.array([6.0, 0, 0])), [1, 0, 15 / 35], atol=1e-15)
    assert np.allclose(project(camera, np.array([0, -3, -3.0])), [0, 1, 18 / 35], atol=1e-15)
    assert Camera.look_at((0, 0, 1), (0, 0, 0)).orthographic is False


@pytest.mark.parametrize("tilt", [1e-5, 1e-4, 1e-2])
def test_camera_nearly_along_up_stays_orthonormal(tilt):
    camera = Camera.look_at((0, 0, 0), (tilt, -1, 0))
    axes = np.stack([camera.right, camera.up, camera.backward])
    assert np.abs(axes @ axes.T - np.eye(3)).max() < 1e-15 * 4
    assert np.linalg.det(axes) > 0


def test_camera_replace_keeps_the_shape_of_pixels():
    camera = Camera.look_at((0, 0, 5), (0, 0, 0), fov_y_deg=60, size=(1920, 1080))
    square = camera.replace(size=(500, 500))
    assert square.half_width == pytest.approx(square.half_height, rel=1e-15)
    assert square.fov_y_deg == camera.fov_y_deg
    narrow = camera.replace(fov_y_deg=30)
    assert narrow.half_width / narrow.half_height == pytest.approx(1920 / 1080, rel=1e-15)
    assert camera.replace(far=9).half_width == camera.half_width
    assert camera.replace(half_width=0.5).half_height == camera.half_height
    oblong = camera.replace(half_width=2 * camera.half_width).replace(size=(300, 300))
    assert oblong.half_width == pytest.approx(2 * oblong.half_height, rel=1e-15)
    moved = camera.translated((1, 2, 3))
    assert moved.eye.tolist() == [1, 2, 8]
    assert moved.replace(eye=camera.eye) == camera
    assert moved != camera


def test_camera_and_sun_are_values():
    camera, sun = Camera.look_at((3, 1, 2), (0, 0.3, 0)), Sun((0.3, 0.8, 0.1), 0.53)
    for view, other in ((camera, camera.translated((0, 0, 1))), (sun, Sun((0.3, 0.8, 0.1)))):
        copy = pickle.loads(pickle.dumps(view))
        assert copy == view
        assert hash(copy) == hash(view)
        assert view != other
        assert view != "a string"
    assert not pickle.loads(pickle.dumps(camera)).eye.flags.writeable
    assert not pickle.loads(pickle.dumps(sun)).to_light.flags.writeable
    with pytest.raises(AttributeError):
        camera.near = 1.0
    with pytest.raises(ValueError, match="read-only"):
        camera.eye[0] = 1.0


@pytest.mark.parametrize(
    ("changes", "error", "text"),
    [
        ({"near": 0.0}, ValueError, r"near must be > 0 .* \(got near 0\)"),
        ({"near": -1.0}, ValueError, "near must be > 0"),
        ({"near": 10.0, "far": 2.0}, ValueError, r"far must be > near \(got near 10, far 2\)"),
        ({"far": 0.1}, ValueError, "far must be > near"),
        ({"far": INF}, ValueError, "far must be a finite"),
        ({"near": "0.1"}, TypeError, "near must be a finite"),
        ({"fov_y_deg": 0.0}, ValueError, "fov_y_deg must be an angle between 0 and 180"),
        ({"fov_y_deg": 180.0}, ValueError, r"fov_y_deg .* \(got 180\)"),
        ({"fov_y_deg": NAN}, ValueError, "fov_y_deg"),
        ({"size": (0, 10)}, ValueError, r"size must be .*1 to 16384 \(got \(0, 10\)\)"),
        ({"size": (70000, 10)}, ValueError, "size must be .*70000"),
        ({"size": (10.0, 10)}, TypeError, "whole pixels"),
        ({"size": 10}, TypeError, "whole pixels"),
        ({"size": (1, 2, 3)}, TypeError, "whole pixels"),
        ({"eye": (0, 0)}, ValueError, r"eye must be 3 numbers \(got shape \(2,\)\)"),
        ({"eye": (0, NAN, 0)}, ValueError, "eye must be finite"),
        ({"target": (0, 0, 5)}, ValueError, "target must differ from eye"),
        ({"target": "there"}, TypeError, "target must be an array of real numbers"),
        ({"up": (0, 0, 1)}, ValueError, "up must not be parallel to the view direction"),
        ({"up": (0, 0, 0)}, ValueError, "up must not be the zero vector"),
    ],
)
def test_camera_refuses(changes, error, text):
    with pytest.raises(error, match=text):
        Camera.look_at(**{"eye": (0, 0, 5), "target": (0, 0, 0), **changes})


def test_camera_refuses_skew_axes_and_unknown_fields():
    camera = Camera.look_at((0, 0, 5), (0, 0, 0))
    with pytest.raises(ValueError, match="orthonormal and right-handed"):
        camera.replace(right=-camera.right)
    with pytest.raises(ValueError, match="orthonormal"):
        camera.replace(up=camera.up + 1e-6)
    with pytest.raises(TypeError, match="no field 'fov'"):
        camera.replace(fov=3)
    with pytest.raises(TypeError, match="fov_y_deg is for perspective"):
        Camera.orthographic((0, 0, 5), (0, 0, 0)).replace(fov_y_deg=30)
    with pytest.raises(TypeError, match="orthographic must be True or False"):
        camera.replace(orthographic=1)


# -------------------------------------------------------------------------------------------- sun


def test_sun_angles():
    # Exact: a hard shadow shows the 6e-17 that a plain cosine leaves at 90 degrees.
    assert Sun.from_angles(0, 0).to_light.tolist() == [0, 0, 1]
    assert Sun.from_angles(90, 0).to_light.tolist() == [1, 0, 0]
    assert Sun.from_angles(-90, 0).to_light.tolist() == [-1, 0, 0]
    assert Sun.from_angles(33, 90).to_light.tolist() == [0, 1, 0]
    assert Sun.from_compass(0, 0).to_light.tolist() == [0, 0, -1]
    assert Sun.from_compass(90, 0).to_light.tolist() == [1, 0, 0]
    assert Sun.from_compass(180, 0).to_light.tolist() == [0, 0, 1]
    assert Sun.from_compass(270, 0).to_light.tolist() == [-1, 0, 0]
    for azimuth, elevation in (
        (33.0, 12.0),
        (120.0, 20.0),
        (-170.0, 60.0),
        (299.0, -5.0),
        (725.0, 1.0),
    ):
        a, e = np.radians(azimuth), np.radians(elevation)
        expected = [np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)]
        assert np.allclose(Sun.from_angles(azimuth, elevation).to_light, expected, atol=1e-14)
        assert np.allclose(
            Sun.from_compass(180 - azimuth, elevation).to_light, expected, atol=1e-14
        )


@pytest.mark.parametrize("scale", [1e-300, 1e-9, 1.0, 7.0, 1e300])
def test_sun_normalises_any_length(scale):
    to_light = Sun(np.array([0.6, 0.0, -0.8]) * scale).to_light
    assert np.allclose(to_light, [0.6, 0, -0.8], atol=4e-16)


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (lambda: Sun((0, 0, 0)), ValueError, "to_light must not be the zero vector"),
        (lambda: Sun((0, NAN, 1)), ValueError, "to_light must be finite"),
        (lambda: Sun((0, 1)), ValueError, "to_light must be 3 numbers"),
        (lambda: Sun((0, 1, 0), -0.1), ValueError, "angular_diameter_deg must be an angle"),
        (lambda: Sun((0, 1, 0), 180), ValueError, r"below 180 degrees \(got 180\)"),
        (lambda: Sun((0, 1, 0), "wide"), TypeError, "angular_diameter_deg"),
        (lambda: Sun.from_angles(0, 91), ValueError, r"elevation_deg .*-90 to 90 \(got 91\)"),
        (lambda: Sun.from_angles(INF, 0), ValueError, "azimuth_deg"),
        (lambda: Sun.from_compass(None, 0), TypeError, "azimuth_deg"),
    ],
)
def test_sun_refuses(make, error, text):
    with pytest.raises(error, match=text):
        make()
