"""What csm.recommend reads from coarse pictures: windows up to the horizon, kernels."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
import small_scenes

import csm
from csm import shapes
from csm.forecasts import Forecaster
from csm.horizons import ends_of, points_of
from csm.search import KNEE_PIXELS, KNEE_SHARE, NO_MATTER
from csm.settings import map_sizes
from csm.signals import coarse_camera, measure_signals
from csm.tracing import FACING
from csm.verification import everything_on

SIZE = (640, 360)
SUN = csm.Sun((0.4, 1, 0.3))
OUTPUTS = ("valid", "view_depth", "normal")
MASK = ("valid", "mask", "normal")


def plain(half):
    return csm.Scene([shapes.mesh("ground", shapes.ground(half))])


def look(renderer, scene, camera):
    """Depths and normals of a picture, and which of its pixels face the sun."""
    frame = renderer.render(scene, camera, SUN, csm.ShadowSettings(filter="none"), outputs=OUTPUTS)
    return frame, frame.valid & (frame.normal @ SUN.to_light.astype(np.float32) > FACING)


def low(up=(0, 1, 0), eye=(0, 1.2, 0)):
    """A camera just above the ground that sees the horizon."""
    return csm.Camera.look_at(eye, (1.0, 1.15, -9.0), up=up, fov_y_deg=45, far=9000.0, size=SIZE)


# -- planes between coarse pixels ------------------------------------------------------------------


@pytest.mark.parametrize("up", [(0, 1, 0), (0, -1, 0), (1, 0, 0.1), (-1, 0, 0)])
def test_planes_end_where_the_full_picture_has_them(renderer, up):
    """Every point is a pixel of the full picture, and none of the farthest is left out."""
    scene, camera = plain(800.0), low(up)
    small, shrink = coarse_camera(camera)
    fine, seen = look(renderer, scene, camera)
    coarse, facing = look(renderer, scene, small)
    ends = points_of(ends_of(camera, small, coarse, facing, scene.bounds)[0])
    assert np.abs(ends[:, 1]).max() < 0.02  # on the ground; depths come in single precision
    depths = (ends - camera.eye) @ -camera.backward
    expected = float(fine.view_depth[seen].max())
    assert float(coarse.view_depth[facing].max()) < 0.8 * expected  # the coarse picture ends before
    assert depths.max() == pytest.approx(expected, rel=0.01)
    assert shrink > 2.0


@pytest.mark.parametrize("up", [(0, 1, 0), (0, -1, 0), (1, 0, 0.1), (-1, 0, 0)])
def test_the_part_at_the_horizon_is_one_of_the_full_picture(renderer, up):
    scene, camera = plain(4000.0), low(up)
    small, _ = coarse_camera(camera)
    fine, seen = look(renderer, scene, camera)
    coarse, facing = look(renderer, scene, small)
    _, part = ends_of(camera, small, coarse, facing, scene.bounds)
    assert part.size[0] * part.size[1] <= facing.size
    strip, there = look(renderer, scene, part)
    points = small_scenes.positions_of(strip)[there]
    # its pixels are pixels of the full picture, the farthest among them
    x, y = camera.pixel_plane()
    for axis, own in zip((x, y), part.pixel_plane(), strict=True):
        nearest = np.abs(own[:, None] - axis).min(axis=1)
        assert nearest.max() < 1e-9
    depths = (points - camera.eye) @ -camera.backward
    assert depths.max() == pytest.approx(float(fine.view_depth[seen].max()), rel=1e-4)


def test_no_horizon_no_part(renderer):
    scene = csm.scenes.plane_and_box()
    above = csm.Camera.look_at((6, 9, 8), (0, 0, 0), fov_y_deg=30, far=100, size=SIZE)
    small, _ = coarse_camera(above)
    coarse, facing = look(renderer, scene, small)
    assert facing.any()
    assert ends_of(above, small, coarse, facing, scene.bounds)[1] is None


@pytest.mark.parametrize(
    ("camera", "sun", "changes"),
    [
        ("driver", "evening", {"cascade_count": 1}),
        ("driver", "evening", {"cascade_count": 2, "split": "sdsm"}),
        ("driver", "side", {"cascade_count": 1}),
    ],
)
def test_windows_of_a_long_road_are_those_of_frames(renderer, camera, sun, changes):
    """Trees on the horizon, lower than a coarse pixel, are receivers and hold windows open."""
    scene = csm.scenes.long_road()
    camera, sun = scene.cameras[camera].replace(size=SIZE), scene.suns[sun]
    settings = csm.ShadowSettings(map_size=512, fit="visible", snap="none", **changes)
    frame = renderer.render(scene, camera, sun, settings, outputs=("mask",))
    expected = Forecaster(measure_signals(renderer, scene, [camera], [sun]), scene)
    sides = expected.texel_sides(settings)
    assert sides == pytest.approx(frame.cascades.texel_size.max(axis=1), rel=0.25)


def test_no_look_waits_for_passes(renderer, monkeypatch):
    """Nobody reads how long a coarse frame's passes take, and to time one is to wait for it."""
    scene, render, frames = csm.scenes.long_road(), csm.Renderer.render, []
    monkeypatch.setattr(
        csm.Renderer, "render", lambda *a, **k: frames.append(render(*a, **k)) or frames[-1]
    )
    for camera in ("bridge", "driver"):  # with finer maps, and with a horizon
        camera = scene.cameras[camera].replace(size=SIZE)
        measure_signals(renderer, scene, [camera], [scene.suns["ahead"]])
    assert {"none", "hard"} == {frame.settings.filter for frame in frames}
    assert {"both", "back"} <= {frame.settings.caster_faces for frame in frames}
    assert [list(frame.timings_ms) for frame in frames] == len(frames) * [["readback"]]


def test_what_a_view_holds_is_in_the_order_of_depth(renderer):
    """The core finds a slice's points by their place; so each array must be of the same order."""
    scene = csm.scenes.forest()
    camera, sun = scene.cameras["path"].replace(size=SIZE), scene.suns["day"]
    view = measure_signals(renderer, scene, [camera], [sun]).views[0]
    ends = np.cumsum([len(view.receivers), len(view.edges), len(view.outline)])
    kinds = np.split(view.held_depths, ends[:-1])
    assert all(len(depths) > 50 and (np.diff(depths) >= 0.0).all() for depths in kinds)
    depths = (view.held - camera.eye) @ -camera.backward
    assert view.held_depths == pytest.approx(depths, rel=1e-12)
    # receivers and what is told of them are of the same pixels
    assert view.receiver_depths == pytest.approx(kinds[0], rel=1e-6)


LATE = """
import atexit, sys, threading, time
import csm

def look():
    scene = csm.scenes.plane_and_box()
    camera = scene.cameras["corner"].replace(size=(64, 48))
    with csm.Renderer(sys.argv[1]) as renderer:
        found = csm.recommend(scene, camera, scene.suns["diagonal"], renderer=renderer)
    print(found.settings.cascade_count)

def late():
    time.sleep(0.5)  # until the main thread is at its end
    look()

look()
if sys.argv[2] == "thread":
    threading.Thread(target=late).start()
else:
    atexit.register(look)
"""


@pytest.mark.parametrize("where", ["thread", "atexit"])
def test_a_recommendation_can_be_made_while_the_interpreter_ends(renderer, where, tmp_path):
    """No thread can be started then: a frame is read where it was drawn."""
    result = subprocess.run(
        [sys.executable, "-c", LATE, renderer.info["backend"], where],
        capture_output=True, text=True, timeout=60, check=False,
        cwd=tmp_path,  # so that the package is that of the tests
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    first, again = result.stdout.split()
    assert first == again


# -- kernels ---------------------------------------------------------------------------------------


@pytest.fixture
def floating(renderer):
    """A square that floats 2 m above the ground, seen from above; every edge has one penumbra."""
    corners = [[-0.5, 2, -0.5], [-0.5, 2, 0.5], [0.5, 2, 0.5], [0.5, 2, -0.5]]
    scene = csm.Scene.merge(plain(6.0), csm.Scene.from_arrays(corners, [[0, 1, 2], [0, 2, 3]]))
    camera = csm.Camera.look_at((-3, 9, 0), (-1.5, 0, 0), fov_y_deg=35, far=60, size=SIZE)
    sun = csm.Sun((1, 2, 0), 6.0)
    width = 2.0 * np.tan(np.radians(3.0)) * np.sqrt(5.0)  # across the light [m]
    signals = measure_signals(renderer, scene, [camera], [sun])
    seen = signals.views[0]  # coarse maps tell the distance to some per cent; here it is known
    known = np.full(len(seen.edges), np.sqrt(5.0))
    view = dataclasses.replace(seen, blocker_distances=known)
    return scene, sun, width, dataclasses.replace(signals, views=(view,))


@pytest.mark.parametrize("elevation", [60.0, 25.0, 12.0])
def test_a_slanted_receiver_is_no_occluder_of_its_own(renderer, elevation):
    """Next to a point its own ground lies nearer to the sun, by its slope times a texel."""
    corners = [[-2, 2, -2], [-2, 2, 2], [2, 2, 2], [2, 2, -2]]
    scene = csm.Scene.merge(plain(60.0), csm.Scene.from_arrays(corners, [[0, 1, 2], [0, 2, 3]]))
    sun = csm.Sun.from_compass(90, elevation, 0.5)
    centre = -2.0 / np.tan(np.radians(elevation)) * np.array([1.0, 0.0, 0.0])
    camera = csm.Camera.look_at(
        centre + np.array([0, 30, 1]), centre, fov_y_deg=30, far=90, size=SIZE
    )
    (seen,) = measure_signals(renderer, scene, [camera], [sun]).views
    on_ground = seen.edges[:, 1] < 1.0
    assert np.count_nonzero(on_ground) > 50
    distance = 2.0 / np.sin(np.radians(elevation))
    assert np.median(seen.blocker_distances[on_ground]) == pytest.approx(distance, rel=0.05)
    assert np.percentile(seen.blocker_distances[on_ground], 10) > 0.8 * distance


def missed(width, kernel):
    """Mean absolute difference of two disc's ramps across an edge, by brute force [m]."""
    x = np.linspace(-width, width, 200001)

    def ramp(side):
        t = np.clip(2.0 * x / max(side, 1e-12), -1.0, 1.0)
        return 0.5 + (t * np.sqrt(1.0 - t * t) + np.arcsin(t)) / np.pi

    return np.abs(ramp(width) - ramp(min(kernel, width))).mean() * 2.0 * width


@pytest.mark.parametrize("part", [0.2, 0.5, 0.8, 1.5])
def test_what_a_kernel_leaves_out_of_penumbrae(floating, part):
    """As much as two ramps of covered discs differ by, one as wide as the kernel's texels."""
    scene, _, width, signals = floating
    forecaster = Forecaster(signals, scene)
    settings = csm.ShadowSettings(cascade_count=1, fit="sphere", filter="pcss", filter_size=9)
    # a sphere's texels are square, and its window has a border for the kernel
    size = round(9 * 1e4 * forecaster.texel_sides(settings, 10000)[0] / (part * width)) + 10
    kernel = 9 * forecaster.texel_sides(settings, size)[0]
    assert kernel == pytest.approx(part * width, rel=0.02)
    expected = missed(width, kernel) / missed(width, 0.0)
    told = forecaster.left_out(settings, size) / forecaster.penumbra()
    assert told == pytest.approx(expected, abs=0.02)  # of whole sizes of maps
    whole = forecaster.expected(settings, size)
    assert (whole.error > whole.held) == (whole.left_out > 0.0) == (part < 1.0)
    half = forecaster.expected(settings, size, 5)
    # a narrower border leaves the window more texels: four of some hundreds
    assert half.held == pytest.approx(whole.held, rel=4 / size)
    assert half.left_out > whole.left_out


@pytest.mark.parametrize("size", [256, 512, 1024])
def test_kernels_hold_penumbrae_and_not_much_more(floating, size):
    scene, _, width, signals = floating
    forecaster = Forecaster(signals, scene)
    settings = csm.ShadowSettings(cascade_count=1, fit="sphere", filter="pcss", map_size=size)
    wanted = width / forecaster.texel_sides(settings)[0]
    kernel = forecaster.kernel(settings, size)
    assert kernel % 2 == 1
    assert 0.9 * wanted <= kernel <= 1.1 * wanted + 5.0  # 2 to 5 of rounding
    assert forecaster.left_out(settings, size, kernel) <= 0.05 * forecaster.penumbra()


def test_a_kernel_that_cuts_penumbrae_off_is_as_wrong_as_forecast(renderer, floating):
    """Measured: what two kernels differ by in the picture is what forecasts say."""
    scene, sun, width, signals = floating
    forecaster, camera = Forecaster(signals, scene), signals.views[0].camera
    settings = csm.ShadowSettings(
        cascade_count=1, fit="sphere", snap="none", filter="pcss", tap_count=64, disc="vogel"
    )
    size = round(1e4 * forecaster.texel_sides(settings, 10000)[0] / (width / 33.0))
    masks = [
        renderer.render(
            scene, camera, sun, settings.replace(map_size=size, filter_size=side), outputs=MASK
        )
        for side in (17, 45)
    ]
    facing = masks[0].valid & (masks[0].normal @ sun.to_light.astype(np.float32) > FACING)
    differ = np.abs(masks[0].mask - masks[1].mask)[facing].mean()
    assert differ == pytest.approx(forecaster.left_out(settings, size, 17), rel=0.2)


def test_a_kernel_of_everything_on_excuses_no_coarser_texels(renderer):
    """The knee: texels as good as everything on's, and kernels that leave out no more than its."""
    scene = csm.scenes.town(8000)
    camera, sun = scene.cameras["street"].replace(size=SIZE), scene.suns["evening"]
    found = csm.recommend(scene, camera, sun, renderer=renderer)
    forecaster = Forecaster(found.signals, scene)
    full, ours = (forecaster.expected(s) for s in (everything_on(sun), found.settings))
    margin = max(KNEE_PIXELS, KNEE_SHARE * full.held)
    assert full.left_out > margin  # its kernel is too narrow here
    left = max(full.left_out, 0.05 * forecaster.penumbra()) + margin
    held = [
        one
        for one in found._measured().candidates(found.cost_model)
        if one.arranged.filter == "pcss"
        and one.expected.held <= full.held + margin
        and one.expected.left_out <= left
    ]
    assert ours.error <= min(held, key=lambda one: one.ms).error + NO_MATTER
    assert found.met
    assert found.forecast(found.settings).met
    coarser = found.settings.replace(map_size=tuple(one // 2 for one in map_sizes(found.settings)))
    assert not found.forecast(coarser).met


# -- layers of occluders ---------------------------------------------------------------------------


@pytest.mark.parametrize("sun", [csm.Sun((0, 1, 0)), csm.Sun((0.3, 1, 0.2))], ids=["zenith", "low"])
@pytest.mark.parametrize(
    ("sheet_top", "slats_top", "bleeds"),
    [
        (None, None, False),
        (1.5, None, False),
        (None, 6.0, False),  # between slats light falls in: that is no full shadow
        (1.5, 1.8 * 1.5, False),
        (1.5, 2.1 * 1.5, True),
        (1.5, 6.0, True),
    ],
    ids=["plain", "sheet", "slats", "near", "twice", "far"],
)
def test_layers_are_occluders_of_which_one_is_twice_as_far(
    renderer, sun, sheet_top, slats_top, bleeds
):
    """The most that shares of a kernel let in, (r-1)²/(r+1)², is a tenth at heights of r = 1.92.

    Slanting light adds the slope of the sheet within the kernel, 2 % of its height.
    """
    parts = [shapes.mesh("ground", shapes.ground(10.0))]
    if sheet_top is not None:
        top = shapes.box((-3, sheet_top - 0.02, -3), (3, sheet_top, 3))
        parts.append(shapes.mesh("sheet", top))
    if slats_top is not None:
        slats = [
            shapes.box((x - 0.3, slats_top - 0.02, -3), (x + 0.3, slats_top, 3))
            for x in np.linspace(-2.4, 2.4, 5)
        ]
        parts.append(shapes.mesh("slats", *slats))
    camera = csm.Camera.look_at((0, 1, 9), (0, 0, 0), fov_y_deg=45, far=100, size=SIZE)
    found = measure_signals(renderer, csm.Scene(parts), (camera,), (sun,))
    # ten edges, four texels of about 3 cm each, of 6 m: a fifth; slanting light meets fewer
    assert (found.layered_share > 0.05) if bleeds else (found.layered_share == 0.0)
