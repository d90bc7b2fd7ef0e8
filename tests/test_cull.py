"""Culling: nothing that can shadow a visible receiver is dropped, most of the rest is."""

import drawings
import numpy as np
import oracles
import pytest
from views import clip_points, turned

import csm
from csm import _core

BOUNDS = np.array([[-60.0, 0.0, -60.0], [60.0, 25.0, 60.0]])
SELECTS = ["map", "interval"]


def view(rng, *, inside=True):
    """A camera in the scene, or above it looking in."""
    if not inside:
        return csm.Camera.look_at(
            (80, 90, 70), (0, 0, 0), fov_y_deg=40, near=1, far=400, size=(16, 9)
        )
    eye = rng.uniform(BOUNDS[0], BOUNDS[1]) * [0.7, 0.5, 0.7] + [0, 0.5, 0]
    target = eye + rng.normal(size=3) * [1, 0.3, 1]
    return csm.Camera.look_at(eye, target, fov_y_deg=60, near=0.2, far=300, size=(16, 9))


def sun_for(camera, number, rng):
    """High, low, in the camera's face, in its back, overhead, from below, in turn."""
    low = camera.backward * [1, 0, 1] + [0, 0.08, 0]
    directions = [
        (0.4, 1.0, 0.3), low * [-1, 1, -1], low, (0, 1, 0), (0.9, 0.1, 0.2), (0.3, -0.5, 0.4),
    ]  # fmt: skip
    return csm.Sun(np.array(directions[number % 6]) + 1e-3 * rng.normal(size=3))


def boxes_in(bounds, count, rng):
    """(count, 6) boxes of all sizes, cut to the bounds, some flat."""
    centre = rng.uniform(bounds[0] - 3, bounds[1] + 3, size=(count, 3))
    half = 10.0 ** rng.uniform(-2, 0.7, size=(count, 3))
    half[rng.uniform(size=(count, 3)) < 0.1] = 0.0
    ends = np.clip(centre - half, *bounds), np.clip(centre + half, *bounds)
    return np.concatenate(ends, axis=1)


def receivers_of(camera, cascades, i, select, padding, count, rng):
    """Visible points inside the scene that a lookup in map i may serve: by interval its slice, by
    map every slice from its own on; only where the map holds them."""
    last = cascades.count if select == "map" else i + 1
    points = oracles.sample_slice(camera, cascades.splits[i], cascades.splits[last], count, rng)
    inside = ((points >= BOUNDS[0]) & (points <= BOUNDS[1])).all(axis=1)
    held = np.abs(clip_points(cascades, i, points)[:, :2]) <= 1 - 2 * padding / cascades.map_size[i]
    return points[inside & held.all(axis=1)]


def lookups_of(points, cascades, i, padding, rng):
    """The points, moved in the light's x and y to where their kernel may fetch: up to padding
    texels and half a texel to a centre."""
    reach = (padding + 0.5) * cascades.texel_size[i]
    shift = rng.uniform(-1, 1, size=(len(points), 2)) * reach
    return points + shift @ cascades.light_from_world[i][:2, :3]


def kept_boxes(camera, sun, settings, boxes, i, padding, **options):
    kept = _core.cull_boxes(
        camera, sun.to_light, settings, BOUNDS, boxes, i, margin_texels=padding, **options
    )
    assert (np.diff(kept.astype(np.int64)) > 0).all()
    mask = np.zeros(len(boxes), bool)
    mask[kept] = True
    return mask


def check_scene(number, select, rng, samples, box_count):
    camera = view(rng, inside=number % 4 != 3)
    sun = sun_for(camera, number, rng)
    padding = (0, 1, 3, 7, 15)[number % 5]
    settings = csm.ShadowSettings(
        map_size=256, select=select, filter="pcf" if padding else "hard",
        filter_size=2 * padding + 1 if padding else 3,
    )  # fmt: skip
    cascades = csm.fit_cascades(camera, sun, settings, scene=_Scene)
    boxes = boxes_in(BOUNDS, box_count, rng)
    # Casters behind the eye, in the far corners of the scene, and one round everything.
    behind = camera.eye + camera.backward * rng.uniform(0.1, 30, size=(20, 1))
    boxes = np.concatenate([boxes, np.c_[behind - 0.5, behind + 0.5], [BOUNDS.ravel()]])
    needed_count = dropped = 0
    for i in range(cascades.count):
        points = receivers_of(camera, cascades, i, select, padding, samples, rng)
        lookups = lookups_of(points, cascades, i, padding, rng)
        kept = kept_boxes(camera, sun, settings, boxes, i, padding)
        for box, is_kept in zip(boxes, kept, strict=True):
            if not is_kept:
                dropped += oracles.rays_hit_box(lookups, sun.to_light, box).any()
        # The sharper form: a speck anywhere above a receiver.
        above = lookups + rng.uniform(0, 80, size=(len(lookups), 1)) * sun.to_light
        specks = np.concatenate([above - 1e-9, above + 1e-9], axis=1)
        dropped += np.count_nonzero(~kept_boxes(camera, sun, settings, specks, i, padding))
        needed_count += len(lookups)
    return needed_count, dropped


class _Scene:
    bounds = BOUNDS


@pytest.mark.parametrize("select", SELECTS)
@pytest.mark.parametrize(
    ("scenes", "samples", "boxes"),
    [(30, 300, 60), pytest.param(100, 3000, 300, marks=pytest.mark.slow)],
)
def test_g1_no_needed_caster_is_dropped(figure, select, scenes, samples, boxes):
    rng = np.random.default_rng(30)
    checked = [check_scene(number, select, rng, samples, boxes) for number in range(scenes)]
    lookups, dropped = np.sum(checked, axis=0)
    assert lookups > 100 * scenes
    figure("G1", f"needed casters dropped, select {select}", dropped, 0, "casters")


def test_culling_drops_most_of_what_the_window_alone_keeps():
    # Casters all over the scene, and cascades by slice, where the hull is tightest: at least 40 %
    # of what the window alone keeps must go.
    rng = np.random.default_rng(32)
    kept = whole = 0
    for _ in range(25):
        camera = view(rng)
        sun = sun_for(camera, 0, rng)
        boxes = boxes_in(BOUNDS, 400, rng)
        settings = csm.ShadowSettings(map_size=1024, select="interval")
        for i in range(4):
            kept += kept_boxes(camera, sun, settings, boxes, i, 0).sum()
            whole += kept_boxes(camera, sun, settings, boxes, i, 0, whole_window=True).sum()
    assert kept < 0.6 * whole


@pytest.mark.parametrize("select", SELECTS)
@pytest.mark.parametrize(
    "kernel", [{"filter": "hard"}, {"filter": "pcf", "filter_size": 7}], ids=["hard", "pcf"]
)
def test_g1_masks_are_equal_to_the_bit_without_culling(figure, renderer, select, kernel):
    scene = csm.scenes.long_road()
    for camera in scene.cameras.values():
        camera = camera.replace(size=(320, 180))
        for sun in scene.suns.values():
            settings = csm.ShadowSettings(map_size=512, select=select, **kernel)
            culled = renderer.render(scene, camera, sun, settings)
            full = renderer.render(scene, camera, sun, settings.replace(cull="none"))
            differing = np.count_nonzero(culled.mask != full.mask)
            figure(
                "G1", "mask with culling against without", differing, 0, "pixels",
                picture=lambda a=full.mask, b=culled.mask: drawings.compared(a, b),
            )  # fmt: skip
            drawn = [sum(frame.info["triangles_drawn"]) for frame in (culled, full)]
            assert drawn[0] < drawn[1]


def overhead_case():
    """A camera that looks down -z from (0, 5, 0) with a right angle, a sun overhead."""
    camera = csm.Camera.look_at((0, 5, 0), (0, 5, -1), fov_y_deg=90, near=1, far=41, size=(9, 9))
    settings = csm.ShadowSettings(cascade_count=1, view_range="camera", map_size=1024)
    return camera, csm.Sun((0, 1, 0)), settings


def speck(*place):
    return np.repeat([-0.01, 0.01], 3) + np.tile(place, 2)


@pytest.mark.parametrize(
    ("place", "kept", "whole"),
    [
        ((0, 20, -10), True, True),  # above the view
        ((0, 24, 3), False, True),  # behind the eye, high up
        ((0, 5, -45), False, True),  # beyond far
        ((9, 5, -10), True, True),  # at the side, inside
        ((11, 5, -10), False, True),  # at the side, outside
        ((0, 0.5, -20), True, True),  # on the ground
        ((59, 5, 59), False, False),  # outside the window
    ],
)
def test_places_under_an_overhead_sun(place, kept, whole):
    camera, sun, settings = overhead_case()
    boxes = speck(*place)[None]
    assert kept_boxes(camera, sun, settings, boxes, 0, 0).tolist() == [kept]
    assert kept_boxes(camera, sun, settings, boxes, 0, 0, whole_window=True).tolist() == [whole]


def test_g1_what_lies_below_the_visible_part_is_dropped():
    # A sun in the camera's face: what stands behind the eye is below all receivers, seen from it.
    camera = csm.Camera.look_at((0, 5, 0), (0, 5, -1), fov_y_deg=60, near=0.1, far=100, size=(9, 9))
    sun = csm.Sun((0, 0, -1))
    settings = csm.ShadowSettings(cascade_count=4, view_range="camera", map_size=2048)
    boxes = np.stack([speck(0, 5, -20), speck(0, 5, 50)])
    assert kept_boxes(camera, sun, settings, boxes, 0, 0).tolist() == [True, False]
    assert kept_boxes(camera, sun, settings, boxes, 0, 0, whole_window=True).tolist() == [
        True,
        True,
    ]


def test_a_wide_box_behind_a_turned_camera_is_dropped():
    # It crosses the lines through every edge of the outline; only the outline's own extent in light
    # y, which starts at cos 20 - sin 20 = 0.6 m, tells them apart.
    turn = np.radians(20)
    camera, sun, settings = overhead_case()
    camera = csm.Camera.look_at(
        (0, 5, 0), (np.sin(turn), 5, -np.cos(turn)), fov_y_deg=90, near=1, far=41, size=(9, 9)
    )
    box = np.array([[-30.0, 5.0, 3.0, 30.0, 6.0, 5.0]])
    assert kept_boxes(camera, sun, settings, box, 0, 0).tolist() == [False]
    assert kept_boxes(camera, sun, settings, box, 0, 0, whole_window=True).tolist() == [True]


def test_g1_float32_positions_of_a_large_scene_are_allowed_for():
    # 36 km and texels below a millimetre: float32 moves casters by many texels.
    bounds = np.array([[-18e3, 0, -18e3], [18e3, 2e3, 18e3]])
    camera = csm.Camera.look_at((0, 100, 0), (1, 99, 1), near=0.05, far=5e4, size=(16, 9))
    sun, settings = csm.Sun((1, 1, 1)), csm.ShadowSettings(cascade_count=8, lam=1.0)
    rng = np.random.default_rng(36)
    wide = _Scene()
    wide.bounds = bounds
    cascades = csm.fit_cascades(camera, sun, settings, scene=wide)
    assert cascades.texel_size[0, 0] < 1e-3
    corners = oracles.sample_slice(camera, *cascades.splits[[0, -1]], 8, rng)
    held = (np.abs(clip_points(cascades, 0, corners)[:, :2]) <= 1).all(axis=1)
    assert held.sum() >= 4  # the near corners at least: nothing is more at the edge
    moved = corners[held] + rng.choice([-1, 1], size=(held.sum(), 3)) * 2.0**-22 * 36e3
    specks = np.concatenate([moved, moved], axis=1)
    kept = _core.cull_boxes(camera, sun.to_light, settings, bounds, specks, 0)
    assert len(kept) == held.sum()


def test_g1_a_kernel_widens_the_hull_by_its_radius():
    camera, sun, settings = overhead_case()
    cascades = csm.fit_cascades(camera, sun, settings, scene=_Scene)
    texel = cascades.texel_size[0, 0]
    # The side of the view at depth 10 is x = 10, leaning by 45 degrees: a square of m texels round
    # a point reaches 2 m texels along x at constant z.
    for margin in (0, 4, 16):
        reach = 2 * (margin + 1) * texel
        for distance, expected in ((0.9 * reach, True), (1.1 * reach + 0.03, False)):
            box = speck(10 + 0.01 + distance, 5, -10)[None]
            assert kept_boxes(camera, sun, settings, box, 0, margin).tolist() == [expected]


def test_g1_a_camera_that_sees_nothing_needs_nothing():
    camera = csm.Camera.look_at((0, 500, 0), (0, 600, 1), near=1, far=100)
    sun, settings = csm.Sun((0, 1, 0.2)), csm.ShadowSettings()
    boxes = boxes_in(BOUNDS, 50, np.random.default_rng(33))
    assert not kept_boxes(camera, sun, settings, boxes, 0, 0).any()


def test_without_bounds_the_frustum_alone_decides():
    camera, sun, settings = overhead_case()
    boxes = np.stack([speck(0, 300, -10), speck(30, 5, -10)])
    kept = _core.cull_boxes(camera, sun.to_light, settings, None, boxes, 0)
    assert kept.tolist() == [0]


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_g1_the_view_keeps_every_box_it_sees(offset):
    rng = np.random.default_rng(34)
    dropped = 0
    for number in range(40):
        camera = view(rng, inside=number % 2 == 0)
        boxes = boxes_in(BOUNDS, 300, rng)
        moved = camera.translated([offset] * 3)
        kept = np.zeros(len(boxes), bool)
        kept[
            _core.cull_boxes(
                moved, (0, 1, 0), csm.ShadowSettings(), BOUNDS + offset, boxes + offset, -1
            )
        ] = True
        # Points of the boxes, dense near their surfaces: none that is seen in a dropped box.
        t = np.clip(rng.uniform(-0.5, 1.5, size=(len(boxes), 200, 3)), 0, 1)
        points = boxes[:, None, :3] + t * (boxes[:, None, 3:] - boxes[:, None, :3])
        local = (points - camera.eye) @ np.stack([camera.right, camera.up, -camera.backward]).T
        seen = (local[..., 2] >= camera.near) & (local[..., 2] <= camera.far)
        seen &= np.abs(local[..., 0]) <= camera.half_width * local[..., 2]
        seen &= np.abs(local[..., 1]) <= camera.half_height * local[..., 2]
        assert kept[seen.any(axis=1)].all()
        dropped += (~kept).sum()
    assert dropped > 2000


@pytest.mark.parametrize(
    ("boxes", "cascade", "text"),
    [
        (np.zeros((3, 5)), 0, r"boxes: expected shape \(n, 6\)"),
        (np.zeros((3, 6)), 4, "cascade must be -1 to 3 .got 4"),
        (np.zeros((3, 6)), -2, "cascade must be -1 to 3 .got -2"),
    ],
)
def test_bad_arguments_are_refused(boxes, cascade, text):
    camera = turned(np.random.default_rng(35))
    with pytest.raises(ValueError, match=text):
        _core.cull_boxes(camera, (0, 1, 0), csm.ShadowSettings(), BOUNDS, boxes, cascade)


@pytest.mark.parametrize("select", ["map", "interval"])
def test_g1_culling_knows_how_far_receivers_are_moved(renderer, select):
    # A normal offset looks for casters that many texels to the side of what is seen.
    scene = csm.scenes.town(5_000)
    camera = scene.cameras["street"].replace(size=(320, 180))
    settings = csm.ShadowSettings(
        map_size=512, select=select, bias="manual", receiver_plane=True, normal_offset_texels=48.0
    )
    for sun in scene.suns.values():
        culled, whole = (
            renderer.render(scene, camera, sun, settings.replace(cull=cull), outputs=("mask",)).mask
            for cull in ("inclusive", "none")
        )
        assert np.array_equal(culled, whole)


@pytest.mark.parametrize("yaw", np.radians([0.0, 10.15, 37.0, 90.0, 123.4, 260.0]))
@pytest.mark.parametrize("warp", ["none", "lispsm"])
def test_g1_an_outline_along_the_axes_keeps_its_corners(renderer, figure, yaw, warp):
    """A parallel view under a sun in the zenith has an outline with sides along light x and y once
    the window is turned to it: corners of one side differ by rounding alone."""
    scene, sun = csm.scenes.town(), csm.Sun((0, 1, 0))
    eye = np.array([11.56707687, 21.4725754, -22.5657439])
    ahead = np.array([np.sin(yaw), -0.5, np.cos(yaw)])
    camera = csm.Camera.orthographic(eye, eye + ahead, height=30, near=1, far=500, size=(160, 90))
    settings = csm.ShadowSettings(cascade_count=1, map_size=500, warp=warp, select="interval")
    masks = [
        renderer.render(scene, camera, sun, settings.replace(cull=cull)).mask
        for cull in ("none", "inclusive")
    ]
    assert (masks[0] == 0).any()
    figure("G1", "pixels changed, outline along the axes", (masks[0] != masks[1]).sum(), 0)
