"""Error reports and the edge yardstick against hand counts, closed forms and sampling."""

import json
import math
import pickle
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

import csm
from csm.camera import Camera
from csm.metrics import compare, edge_yardstick, undersampling
from csm.sun import Sun

CAMERA = Camera.look_at((0, 5, 8), (0, 0, 0), size=(4, 3))
SUN = Sun((1, 1, 0))


SETTINGS = csm.ShadowSettings()


@dataclass
class FakeFrame:
    """What `compare` reads of a Frame."""

    mask: np.ndarray
    valid: np.ndarray
    cascade_index: np.ndarray
    camera: Camera = CAMERA
    sun: Sun = SUN
    cascades: object = None
    settings: csm.ShadowSettings = SETTINGS


@dataclass
class FakeTruth:
    """What `compare` reads of a Truth."""

    mask: np.ndarray
    valid: np.ndarray
    facing: np.ndarray
    camera: Camera = CAMERA
    sun: Sun = SUN
    position: np.ndarray = None
    normal: np.ndarray = None


def all_judged(mask, reference):
    shape = np.shape(mask)
    frame = FakeFrame(np.array(mask, np.float32), np.ones(shape, bool), np.zeros(shape, np.uint8))
    truth = FakeTruth(np.array(reference, np.float32), np.ones(shape, bool), np.ones(shape, bool))
    return frame, truth


def test_numbers_of_a_picture_counted_by_hand():
    mask = [[1.0, 0.0, 0.75, 0.25], [0.5, 0.5, 1.0, 0.0]]
    reference = [[1.0, 1.0, 0.5, 0.5], [0.25, 1.0, 0.0, 0.0]]
    report = compare(mask, reference)
    total = [[0, -1, 0.25, -0.25], [0.25, -0.5, 1, 0]]
    assert report.per_pixel["total"].tolist() == total
    assert report.mean["total"] == 3.25 / 8
    assert report.mean["false_light"] == 1.5 / 8
    assert report.mean["false_shadow"] == 1.75 / 8
    assert report.largest["total"] == 1.0
    assert report.root_mean_square["total"] == math.sqrt((1 + 3 * 0.0625 + 0.25 + 1) / 8)
    # 0.5 is lit: the pixels on different sides are (0, 1), (0, 3), (1, 0) and (1, 2).
    assert report.disagreement == 4 / 8
    assert report.wrong_side.tolist() == [[False, True, False, True], [True, False, True, False]]
    assert report.judged_count == 8
    assert report.beyond_range == 0.0


def test_causes_add_up_and_have_their_signs():
    rng = np.random.default_rng(3)
    report = compare(rng.random((40, 50)), rng.random((40, 50)))
    light, shadow = report.per_pixel["false_light"], report.per_pixel["false_shadow"]
    assert (light >= 0).all()
    assert (shadow <= 0).all()
    assert np.array_equal(light + shadow, report.per_pixel["total"])
    assert report.percentile_99["total"] == np.percentile(np.abs(report.per_pixel["total"]), 99)
    # Mean difference of two independent uniform numbers is 1/3, deviation below 0.24 / sqrt(2000).
    assert report.mean["total"] == pytest.approx(1 / 3, abs=5 * 0.24 / math.sqrt(2000))


def test_only_what_is_seen_faces_the_sun_and_is_in_range_is_judged():
    """Every pixel is wrong by 1; each of four rules takes one pixel out."""
    frame, truth = all_judged(np.zeros((2, 4)), np.ones((2, 4)))
    frame.valid[0, 0] = False
    truth.valid[0, 1] = False
    truth.facing[0, 2] = False
    frame.cascade_index[0, 3] = 255
    report = compare(frame, truth)
    assert report.judged.tolist() == [[False] * 4, [True] * 4]
    assert report.judged_count == 4
    assert report.mean["total"] == report.disagreement == 1.0
    assert not report.per_pixel["total"][0].any()
    assert report.beyond_range == 1 / 5


def test_valid_of_two_arrays():
    report = compare([[0.0, 1.0]], [[1.0, 1.0]], valid=np.array([[True, False]]))
    assert report.mean["false_shadow"] == report.disagreement == 1.0
    assert report.judged_count == 1


def test_nothing_judged_is_nan_not_zero():
    report = compare([[0.0]], [[1.0]], valid=np.array([[False]]))
    assert math.isnan(report.disagreement)
    assert all(math.isnan(value) for value in report.mean.values())
    assert "no pixel" in str(report)


def test_acne_above_one_half_is_seen_by_the_mean_alone():
    frame, truth = all_judged(np.full((3, 4), 0.7), np.ones((3, 4)))
    report = compare(frame, truth)
    assert report.disagreement == 0.0
    assert report.mean["total"] == pytest.approx(0.3, abs=1e-7)  # float32 0.7


@pytest.mark.parametrize("cause", ["aliasing", "penumbra", "peter_panning", "light_leak", "seam"])
def test_a_cause_that_is_not_there_says_what_it_needs(cause):
    # True of both kinds of report: neither has a scene to trace.
    for report in (compare([[0.0]], [[1.0]]), compare(*all_judged([[0.0]], [[1.0]]))):
        assert cause not in report.mean
        for values in (report.mean, report.per_pixel, report.largest):
            said = (
                f"'{cause}' needs .*; this report compares masks alone and has total, false_light"
            )
            with pytest.raises(ValueError, match=said):
                values[cause]


def test_an_unknown_cause_lists_the_known():
    with pytest.raises(KeyError, match=r"'acne'.*aliasing"):
        compare([[0.0]], [[1.0]]).mean["acne"]


def test_a_report_is_readable_saves_as_json_and_pickles():
    report = compare([[0.0, 1.0, 0.5, 1.0]], [[1.0, 1.0, 0.5, 1.0]])
    assert "25.000% of 4 judged" in str(report)
    saved = json.loads(json.dumps(report.to_dict()))
    assert saved["mean"] == {"total": 0.25, "false_light": 0.0, "false_shadow": 0.25}
    assert saved["disagreement"] == 0.25
    assert pickle.loads(pickle.dumps(report)).to_dict() == report.to_dict()


@pytest.mark.parametrize(
    ("mask", "truth", "valid", "text"),
    [
        ([[0.0]], [[0.0, 1.0]], None, r"one shape \(got \(1, 1\) and \(1, 2\)\)"),
        ([0.0, 1.0], [0.0, 1.0], None, r"frame must be an \(h, w\) array"),
        ([[1.5]], [[1.0]], None, r"frame must lie in \[0, 1\].*got 1.5"),
        ([[1.0]], [[math.nan]], None, r"truth must lie in \[0, 1\].*got nan"),
        ([["lit"]], [[1.0]], None, "frame must be .* real numbers"),
        ([[1.0]], [[1.0]], [[1.0]], r"valid must be a bool array of shape \(1, 1\)"),
        ([[1.0]], [[1.0]], [True], r"valid must be a bool array of shape \(1, 1\)"),
    ],
)
def test_compare_refuses_arrays(mask, truth, valid, text):
    with pytest.raises(ValueError, match=text):
        compare(mask, truth, valid=valid)


def test_compare_refuses_a_frame_against_an_array():
    frame, truth = all_judged([[1.0]], [[1.0]])
    with pytest.raises(TypeError, match="FakeFrame and ndarray"):
        compare(frame, truth.mask)
    with pytest.raises(TypeError, match="valid is for two arrays"):
        compare(frame, truth, valid=truth.valid)


def test_compare_refuses_another_camera_or_sun():
    frame, truth = all_judged([[1.0]], [[1.0]])
    frame.camera = CAMERA.translated((1, 0, 0))
    with pytest.raises(ValueError, match=r"same camera \(their eye is \[1\. 5\. 8\.\]"):
        compare(frame, truth)
    frame.camera, frame.sun = CAMERA, Sun((1, 1, 0), 0.5)
    with pytest.raises(ValueError, match=r"same sun .*angular_diameter_deg is 0\.5 and 0"):
        compare(frame, truth)


def test_compare_names_the_output_that_was_not_asked_for():
    frame, truth = all_judged([[1.0]], [[1.0]])
    del frame.cascade_index
    with pytest.raises(
        ValueError, match="frame's cascade_index is needed: ask for it with outputs"
    ):
        compare(frame, truth)


# ------------------------------------------------------------------------------------- yardstick


def light_from_world(to_light):
    """Any rotation whose third row is to_light."""
    x = np.cross((0.0, 0.0, 1.0) if abs(to_light[2]) < 0.9 else (1.0, 0.0, 0.0), to_light)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = x, np.cross(to_light, x), to_light
    return matrix


def plane_view(camera, sun, normal, texels):
    """Frame and truth of the plane through the world's origin, one cascade per row of `texels`."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    width, height = camera.size
    column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    x = (2 * column / width - 1)[..., None] * camera.half_width * camera.right
    across = x + (1 - 2 * row / height)[..., None] * camera.half_height * camera.up
    source = camera.eye + across if camera.orthographic else camera.eye
    direction = -camera.backward if camera.orthographic else across - camera.backward
    distance = -(source @ normal) / (direction @ normal)
    position = source + distance[..., None] * direction
    shape = (height, width)
    index = np.broadcast_to(np.arange(width) * len(texels) // width, shape).astype(np.uint8)
    size = 100
    texels_from_light = [np.diag([1.0 / (size * x), 1.0 / (size * y), 1.0, 1.0]) for x, y in texels]
    cascades = SimpleNamespace(
        uvz_from_world=np.array(texels_from_light) @ light_from_world(sun.to_light),
        map_size=np.full(len(texels), size),
    )
    ones = np.ones(shape, bool)
    frame = FakeFrame(np.ones(shape), ones, index, camera, sun, cascades)
    normals = np.broadcast_to(normal, (*shape, 3))
    return frame, FakeTruth(np.ones(shape), ones, ones.copy(), camera, sun, position, normals)


@pytest.mark.parametrize("orthographic", [False, True], ids=["perspective", "orthographic"])
def test_undersampling_is_the_longest_texel_in_pixels(orthographic):
    """Against texels pushed along the light onto the plane and projected, by finite differences."""
    views = {"size": (6, 4), "near": 0.1, "far": 100}
    camera = Camera.look_at((3, 6, 8), (0, 0.5, 0), fov_y_deg=55, **views)
    if orthographic:
        camera = Camera.orthographic((3, 6, 8), (0, 0.5, 0), height=7, **views)
    sun, texels = Sun((0.4, 0.7, -0.3)), [(0.05, 0.03), (0.2, 0.2)]
    frame, truth = plane_view(camera, sun, (0.1, 1.0, 0.2), texels)
    clip_from_world = camera.clip_from_view @ camera.view_from_world

    def pixel(point):
        clip = clip_from_world @ np.append(point, 1.0)
        return 0.5 * clip[:2] / clip[3] * camera.size

    expected = np.zeros(truth.mask.shape)
    light = light_from_world(sun.to_light)[:3, :3]
    for i, j in np.ndindex(expected.shape):
        point, normal = truth.position[i, j], truth.normal[i, j]
        columns = []
        for axis in (0, 1):
            moved = 1e-5 * texels[frame.cascade_index[i, j]][axis] * light[axis]
            moved = moved - sun.to_light * (moved @ normal) / (sun.to_light @ normal)
            columns.append((pixel(point + moved) - pixel(point - moved)) / 2e-5)
        expected[i, j] = np.linalg.svd(np.stack(columns, axis=1))[1][0]
    # A central difference of 1e-5 texel: 1e-10 relative, and 1e-16 * 800 pixels / 1e-5.
    assert undersampling(frame, truth) == pytest.approx(expected, rel=1e-7)


def test_undersampling_under_a_skew_and_a_warp():
    """Texels are wherever the matrix puts them: against pixels pushed to either side."""
    camera = Camera.look_at((3, 6, 8), (0, 0.5, 0), fov_y_deg=55, size=(6, 4), near=0.1, far=100)
    frame, truth = plane_view(camera, Sun((0.4, 0.7, -0.3)), (0.1, 1.0, 0.2), [(0.05, 0.03)])
    uvz_from_world = frame.cascades.uvz_from_world[0]
    uvz_from_world[0, :3] += (0.02, -0.01, 0.03)
    uvz_from_world[3, :3] = (0.01, 0.004, -0.02)
    normal, step = truth.normal[0, 0], 1e-4
    expected = np.zeros(truth.mask.shape)
    for i, j in np.ndindex(expected.shape):
        columns = []
        for move in np.eye(2):
            texels = []
            for side in (0.5 * step, -0.5 * step):
                column, row = np.array([j + 0.5, i + 0.5]) + side * move
                x, y = (2 * column / 6 - 1) * camera.half_width, (1 - row / 2) * camera.half_height
                ray = x * camera.right + y * camera.up - camera.backward
                point = camera.eye - (camera.eye @ normal) / (ray @ normal) * ray
                uvz = uvz_from_world @ np.append(point, 1.0)
                texels.append(100 * uvz[:2] / uvz[3])
            columns.append((texels[0] - texels[1]) / step)
        expected[i, j] = 1.0 / np.linalg.svd(np.stack(columns, axis=1))[1][1]
    # A central difference of 1e-4 pixel: 1e-8 relative, and 1e-16 * 1e4 texels / 1e-4.
    assert undersampling(frame, truth) == pytest.approx(expected, rel=1e-6)


def test_undersampling_of_a_facing_plane_is_texel_over_pixel():
    """docs/numerics.md 13: m = t H / (2 ty z), and projection adds nothing head-on."""
    camera = Camera.look_at((0, 10, 0), (0, 0, 0), up=(0, 0, -1), fov_y_deg=40, size=(9, 9))
    frame, truth = plane_view(camera, Sun((0, 1, 0)), (0, 1, 0), [(0.25, 0.1)])
    expected = 0.25 * 9 / (2 * math.tan(math.radians(20)) * 10)
    assert undersampling(frame, truth) == pytest.approx(np.full((9, 9), expected), rel=1e-12)


def test_undersampling_is_nan_where_there_is_no_cascade_or_no_sun():
    camera = Camera.look_at((0, 10, 0), (0, 0, 0), up=(0, 0, -1), size=(3, 3))
    frame, truth = plane_view(camera, Sun((0, 1, 0)), (0, 1, 0), [(0.25, 0.1)])
    frame.cascade_index[0, 0] = 255
    truth.facing[1, 1] = False
    expected = np.zeros((3, 3), bool)
    expected[0, 0] = expected[1, 1] = True
    assert np.array_equal(np.isnan(undersampling(frame, truth)), expected)


def head_on(size=(400, 300), texel=0.7, turn=0.3):
    """A camera straight down on pixels of 1 m, texels of `texel` m turned by `turn` rad."""
    camera = Camera.orthographic(
        (0, 9, 0), (0, 0, 0), up=(0, 0, -1), height=size[1], near=1, far=20, size=size
    )
    sun = Sun((0, 1, 0))
    frame, truth = plane_view(camera, sun, (0, 1, 0), [(texel, texel)])
    light = np.eye(4)
    light[:3, :3] = (
        (math.cos(turn), 0, math.sin(turn)),
        (math.sin(turn), 0, -math.cos(turn)),
        (0, 1, 0),
    )
    frame.cascades.light_from_world = light[None]
    return frame, truth


def test_yardstick_predicts_the_error_of_a_nearest_texel_map():
    """A disc's shadow, stored at texel centres, looked up at the nearest: the experiment."""
    texel, radius, ratios = 3.1, 100.0, []
    for turn in (0.0, 0.2, 0.5, 0.785):
        frame, truth = head_on(texel=texel, turn=turn)
        light_xy = truth.position @ frame.cascades.light_from_world[0, :2, :3].T

        def lit(xy):
            return np.hypot(xy[..., 0] - 1.7, xy[..., 1] + 2.3) > radius

        truth.mask = lit(light_xy).astype(np.float32)
        stored = (np.floor(light_xy / texel) + 0.5) * texel
        frame.mask = lit(stored).astype(np.float32)
        yardstick = edge_yardstick(frame, truth)
        expected_edge = 2 * math.pi * radius
        assert yardstick.edge_pairs * math.pi / 4 == pytest.approx(expected_edge, rel=0.01)
        ratios.append(compare(frame, truth).disagreement / yardstick.value)
    # The law is 0.250 of a texel at an edge along an axis, 0.236 at 45 degrees; a circle has all
    # directions: 0.243 / 0.25 = 0.97. Some 200 texels lie on the edge, each with a deviation of
    # about its mean, so one circle is good to 7 %, four to 4 %: three deviations.
    assert np.mean(ratios) == pytest.approx(0.97, abs=0.12)


def test_yardstick_by_hand_with_cap():
    frame, truth = head_on(size=(10, 10), texel=2.0)
    truth.mask[:, 5:] = 0.0  # ten horizontal pairs, no vertical ones
    assert edge_yardstick(frame, truth).edge_pairs == 10
    assert float(edge_yardstick(frame, truth)) == pytest.approx(10 * math.pi / 4 * 2 / 4 / 100)
    frame, truth = head_on(size=(10, 10), texel=50.0)
    truth.mask[:, 5:] = 0.0
    assert edge_yardstick(frame, truth).value == pytest.approx(10 * math.pi / 4 * 4 / 4 / 100)
    uncapped = edge_yardstick(frame, truth, largest=math.inf)
    assert uncapped.value == pytest.approx(10 * math.pi / 4 * 50 / 4 / 100)


def test_yardstick_counts_pairs_of_judged_pixels_only():
    frame, truth = head_on(size=(10, 10))
    truth.mask[:, 5:] = 0.0
    truth.facing[:4, 5] = False
    frame.cascade_index[4:6, 4] = 255
    yardstick = edge_yardstick(frame, truth)
    assert yardstick.edge_pairs == 4
    assert yardstick.judged_count == 94
    frame.cascade_index[:] = 255
    assert math.isnan(edge_yardstick(frame, truth).value)
