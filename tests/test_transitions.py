"""Transitions: weights of blending maps along rays through their bands, the fade at the end of the
range (docs/numerics.md 30; M1 of 16)."""

import drawings
import numpy as np
import pytest
import small_scenes

import csm
from csm import shapes, spaces

KERNEL = {"filter": "pcf", "filter_size": 3}
SELECTS = ["map", "interval", "frustum"]
WIDTHS = [0.05, 0.2, 1.0]
FITS = [("sphere", 0.05), ("box", 0.2), ("diameter", 1.0), ("shifted", 0.2), ("scene", 0.1)]


def smooth(weight):
    return weight * weight * (3.0 - 2.0 * weight)


def shares(cascades, settings, points):
    """(n, m) how far inside each window the points lie, in widths of the transition; -inf where the
    depth range does not hold them."""
    out = []
    for i in range(cascades.count):
        clip = spaces.transform_points(cascades.clip_from_world[i], points)
        border = settings.filter_size // 2 if settings.filter == "pcf" else 0
        border *= settings.select != "frustum"
        rim = 1.0 - 2.0 * border / cascades.map_size[i]
        share = (rim - np.abs(clip[:, :2]).max(axis=1)) / settings.blend_width
        out.append(np.where(np.abs(clip[:, 2] - 0.5) <= 0.5, share, -np.inf))
    return np.array(out)


def expected_weights(cascades, settings, points, view_depth):
    """(own, next, weight of next) by the rule of docs/numerics.md 30, in doubles."""
    share = shares(cascades, settings, points)
    count, splits = cascades.count, cascades.splits
    own, following = np.full(len(points), count), np.full(len(points), count)
    weight = np.zeros(len(points))
    for k in range(len(points)):
        held = np.flatnonzero(share[:, k] > 0.0)
        if settings.select == "interval":
            i = min(int((view_depth[k] > splits[1:-1]).sum()), count - 1)
            after, outside = i + 1, 1.0
            deep = (splits[i + 1] - view_depth[k]) / (
                settings.blend_width * (splits[i + 1] - splits[i])
            )
            there = share[after, k] if after < count else 0.0
        else:
            if not held.size:
                continue
            i, after = held[0], held[1] if held.size > 1 else count
            deep, there = share[i, k], share[after, k] if after < count else 0.0
            finer = share[:i, k][np.isfinite(share[:i, k])]
            outside = min([1.0, *(-finer)])
        own[k], following[k] = i, after
        deep, there, outside = np.clip([deep, there, outside], 0.0, 1.0)
        part = (1.0 - deep) * there * outside
        weight[k] = part / (deep + part) if part > 0.0 else 0.0
    return own, following, weight


def rays_through_the_view(camera, far, count, steps, rng):
    """(count, steps, 3) points along straight lines inside the view, and their view depths."""
    ends = []
    for _ in range(2):
        depth = rng.uniform(camera.near, far, count)
        x, y = rng.uniform(-0.95, 0.95, (2, count)) * [[camera.half_width], [camera.half_height]]
        ends.append((x, y, depth))
    along = np.linspace(0.0, 1.0, steps)[None, :, None]
    world = [
        camera.eye + np.stack([x * z, y * z, z], axis=-1) @ np.stack(
            [camera.right, camera.up, -camera.backward]
        )
        for x, y, z in ends
    ]  # fmt: skip
    points = world[0][:, None] * (1.0 - along) + world[1][:, None] * along
    depth = (points - camera.eye) @ -camera.backward
    return points, depth


def lookups(renderer, settings, points, camera=None):
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(40.0, y=-30.0)), _far_corner()])
    camera = camera or small_scenes.camera(0, near=0.5, far=60.0)
    return renderer.render(
        scene, camera, csm.Sun((0.4, 1.0, 0.3)), settings, outputs=("mask",),
        points=points.reshape(-1, 3),
    )  # fmt: skip


def _far_corner():
    """A speck high up, so that the depth range holds the whole view."""
    return shapes.mesh("speck", shapes.box((30, 40, 30), (30.1, 40.1, 30.1)))


# -- weights ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("fit", "width"), FITS)
@pytest.mark.parametrize("select", SELECTS)
def test_m1_weights_along_rays(figure, renderer, select, fit, width):
    rng = np.random.default_rng(60)
    camera = small_scenes.camera(0, near=0.5, far=60.0)
    settings = csm.ShadowSettings(
        cascade_count=3, map_size=(256, 128, 128), select=select, fit=fit, blend="linear",
        blend_width=width, view_range="camera", **KERNEL,
    )  # fmt: skip
    points, depth = rays_through_the_view(camera, 58.0, 12, 400, rng)
    frame = lookups(renderer, settings, points)
    weight = frame.point_blend_weight.astype(float)
    figure("M1", "weights outside 0 to 1", np.count_nonzero(~((weight >= 0) & (weight <= 1))), 0)
    flat = points.reshape(-1, 3)
    own, _, expected = expected_weights(
        frame.cascades, frame.settings.canonical(), flat, depth.ravel()
    )
    index = np.where(own == 3, 255, own)
    # Float32 places points to some 1e-5 of half a map; at a rim it may choose either map, and where
    # two rims meet the weight is steep.
    same = frame.point_cascade == index
    assert same.mean() > 0.995
    error = np.abs(weight - expected)[same]
    # part of a map's half side, over the band's share of it, steeper by the overlap of maps
    figure("M1", "weights against doubles", np.quantile(error, 0.995), 4e-5 / width)
    assert (weight > 0).mean() > 0.01


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("select", SELECTS)
def test_m1_deep_inside_the_next_map_a_weight_falls_evenly_over_the_band(
    figure, renderer, select, width
):
    """Away from the camera along its axis, where the sphere of the next slice holds the band."""
    camera = small_scenes.camera(0, near=0.5, far=60.0)
    settings = csm.ShadowSettings(
        cascade_count=2, map_size=256, select=select, blend="linear", blend_width=width,
        view_range="camera", split="manual", manual_splits=(12.0,), **KERNEL,
    )  # fmt: skip
    depth = np.linspace(0.6, 40.0, 4000)
    points = camera.eye - depth[:, None] * camera.backward
    frame = lookups(renderer, settings, points)
    share = shares(frame.cascades, settings, points)
    own_map, weight = frame.point_cascade, frame.point_blend_weight.astype(float)
    finer = np.where(own_map == 0, 1.0 - weight, 0.0)  # of the first map
    deep = share[1] >= 1.0  # where no rim of the second map is near
    first = own_map == 0
    assert (np.diff(finer)[deep[1:]] <= 1e-5 / width).all()  # monotone
    along = (
        (12.0 - depth) / (width * 11.5) if select == "interval" else share[0]
    )  # in widths of the band
    if (deep & first & (along < 1)).any():
        expected = np.clip(along, 0.0, 1.0)
        error = np.abs(finer - expected)[deep & first]
        figure("M1", "slope of a weight, 1 / band", error.max(), 4e-5 / width)
    per_step = np.abs(np.diff(along))[deep[1:] & first[1:]]
    steps = np.abs(np.diff(finer))[deep[1:] & first[1:]]
    assert (steps <= per_step + 1e-4 / width).all()


@pytest.mark.parametrize("select", SELECTS)
def test_m1_shares_of_all_maps_are_continuous_and_sum_to_one(figure, renderer, select):
    """Of each map, its share as own or next: no step is larger than a few thousandths of a band
    would allow, even where rims of several maps cross."""
    rng = np.random.default_rng(61)
    camera = small_scenes.camera(0, near=0.5, far=60.0)
    settings = csm.ShadowSettings(
        cascade_count=3, map_size=256, select=select, blend="linear", blend_width=0.3,
        view_range="camera", **KERNEL,
    )  # fmt: skip
    points, depth = rays_through_the_view(camera, 50.0, 20, 3000, rng)
    frame = lookups(renderer, settings, points)
    flat = points.reshape(-1, 3)
    own, following, _ = expected_weights(frame.cascades, settings, flat, depth.ravel())
    total = np.zeros((4, len(flat)))
    weight = frame.point_blend_weight.astype(float)
    index = np.minimum(frame.point_cascade, 3)
    total[index, np.arange(len(flat))] = 1.0 - weight
    total[np.where(index == own, following, own), np.arange(len(flat))] += weight
    assert np.abs(total.sum(axis=0) - 1.0).max() <= 1e-12
    jumps = np.abs(np.diff(total.reshape(4, *depth.shape), axis=2)).max(axis=0)
    assert (jumps > 0).mean() > 0.05
    # A ray of 50 m in 3000 steps moves some 1/500 of the first map's band a step; where two rims
    # are near each other, the transition has their distance alone.
    figure("M1", f"largest step of a map's share, {select}", jumps.max(), 0.12, "share")


# -- what pixels get -------------------------------------------------------------------------------


def roofed(renderer, select, blend, width, **changes):
    """A ground wholly under a roof, seen from between them, and biases by which the first map finds
    it in shadow and the second one lit: its mask is the weight of the second map."""
    scene = csm.Scene(
        [
            shapes.mesh("ground", shapes.ground(60.0)),
            csm.Mesh([[-60, 4, -60], [60, 4, -60], [60, 4, 60], [-60, 4, 60]],
                     [[0, 1, 2], [0, 2, 3]]),
        ]
    )  # fmt: skip
    camera = csm.Camera.look_at((0, 2, 0), (0, 0.5, -8), fov_y_deg=60, near=0.5, far=50,
                                size=(144, 96))  # fmt: skip
    settings = csm.ShadowSettings(
        cascade_count=2, map_size=128, split="manual", manual_splits=(9.0,), select=select,
        blend=blend, blend_width=width, view_range="camera", bias="manual", max_distance=45.0,
        **changes,
    )  # fmt: skip
    sun = csm.Sun((0.02, 1.0, 0.01))
    texel = csm.fit_cascades(camera, sun, settings, scene=scene).texel_size.max(axis=1)
    between = 4.0 / np.sqrt(texel[0] * texel[1])  # lifts by less than 4 m, then by more
    settings = settings.replace(constant_bias_texels=between)
    assert texel[0] * between < 3.5
    assert texel[1] * between > 4.5
    outputs = ("mask", "mask_single", "valid", "view_depth", "cascade_index", "normal")
    frame = renderer.render(scene, camera, sun, settings, outputs=outputs)
    frame.scene = scene
    on_ground = frame.valid & (small_scenes.positions_of(frame)[..., 1] < 0.1)
    on_ground &= frame.cascade_index != 255
    assert on_ground.mean() > 0.3
    return frame, on_ground


def weights_of(frame, on_ground):
    points = small_scenes.positions_of(frame)[on_ground]
    depth = frame.view_depth[on_ground].astype(float)
    own, _, weight = expected_weights(frame.cascades, frame.settings, points, depth)
    out = np.full(frame.mask.shape, np.nan)
    out[on_ground] = np.where(own == 0, weight, 1.0)
    return out


@pytest.mark.parametrize("texcoord", ["position", "interpolated"])
@pytest.mark.parametrize("select", ["map", "interval"])
def test_m1_a_mask_mixes_two_maps_by_their_weight(figure, renderer, select, texcoord):
    frames = {}
    for blend in ("linear", "smooth"):
        frames[blend], ground = roofed(renderer, select, blend, 0.4, texcoord=texcoord)
    linear = frames["linear"]
    weight = weights_of(linear, ground)
    assert ((weight > 0.05) & (weight < 0.95)).sum() > 200
    # Float32 places a point to 1e-5 of half a map; interpolated between vertices to 1e-3 texel.
    for blend, expected in (("linear", weight), ("smooth", smooth(weight))):
        error = np.abs(frames[blend].mask - expected)[ground]
        figure(
            "M1", "mask of two maps against their weights", np.quantile(error, 0.999), 1e-3,
            picture=lambda mask=frames[blend].mask: drawings.compared(mask, np.nan_to_num(weight)),
        )  # fmt: skip
    # one map alone: the first shadows all, the second nothing
    single = np.where(linear.cascade_index == 0, 0.0, 1.0)
    assert np.array_equal(linear.mask_single[ground], single[ground])
    hard = renderer.render(
        linear.scene, linear.camera, linear.sun, linear.settings.replace(blend="none"),
        outputs=("mask",),
    )  # fmt: skip
    assert np.array_equal(hard.mask[ground], single[ground])


def squares(image, where, side):
    """(k, side * side) values of all squares of pixels that lie in the mask."""
    windows = np.lib.stride_tricks.sliding_window_view(image, (side, side))
    inside = np.lib.stride_tricks.sliding_window_view(where, (side, side)).all(axis=(-1, -2))
    return windows[inside].reshape(-1, side * side)


@pytest.mark.parametrize("select", ["map", "interval"])
def test_m1_dithered_pixels_take_one_map_and_their_mean_is_the_weight(figure, renderer, select):
    frame, ground = roofed(renderer, select, "dither", 0.6)
    weight = weights_of(frame, ground)
    assert np.isin(frame.mask[ground], (0.0, 1.0)).all()
    mixed = ground & (np.nan_to_num(weight) > 0.02) & (np.nan_to_num(weight) < 0.98)
    assert mixed.sum() > 500
    # Of the values of interleaved gradient noise in a square, the share below a weight differs from
    # it by at most 0.177 in 3 x 3 pixels and 0.065 in 8 x 8 (measured over 256 x 256 pixels); a
    # weight that changes within the square counts its change.
    for side, tolerance in ((3, 0.18), (8, 0.066)):
        taken = squares(frame.mask, mixed, side)
        wanted = squares(np.nan_to_num(weight), mixed, side)
        error = np.abs(taken.mean(axis=1) - wanted.mean(axis=1)) - np.ptp(wanted, axis=1)
        assert error.size > 50
        figure("M1", f"mean of a dither over {side} x {side} pixels", error.max(), tolerance)
    assert abs(frame.mask[mixed].mean() - weight[mixed].mean()) < 0.01
    # which lot a pixel draws is its own: the same in the next frame
    again = renderer.render(frame.scene, frame.camera, frame.sun, frame.settings, outputs=("mask",))
    assert np.array_equal(again.mask, frame.mask)


def test_points_draw_lots_of_their_own(renderer):
    # Many points of one place share its weight; a point keeps its lot, whatever its number.
    settings = csm.ShadowSettings(
        cascade_count=2, map_size=256, blend="dither", blend_width=0.5, view_range="camera",
        **KERNEL,
    )  # fmt: skip
    rng = np.random.default_rng(62)
    camera = small_scenes.camera(0, near=0.5, far=60.0)
    points, _ = rays_through_the_view(camera, 40.0, 40, 500, rng)
    frame = lookups(renderer, settings, points)
    linear = lookups(renderer, settings.replace(blend="linear"), points)
    assert np.isin(frame.point_blend_weight, (0.0, 1.0)).all()
    mixed = (linear.point_blend_weight > 0) & (linear.point_blend_weight < 1)
    assert mixed.sum() > 500
    taken, weight = frame.point_blend_weight[mixed], linear.point_blend_weight[mixed]
    # independent draws: four standard deviations of their mean
    deviation = np.sqrt((weight * (1 - weight)).sum()) / mixed.sum()
    assert abs(taken.mean() - weight.mean()) < 4 * deviation
    order = rng.permutation(len(points.reshape(-1, 3)))
    moved = lookups(renderer, settings, points.reshape(-1, 3)[order])
    assert np.array_equal(moved.point_blend_weight, frame.point_blend_weight[order])


@pytest.mark.parametrize("select", ["map", "interval", "frustum"])
@pytest.mark.parametrize("warp", ["lispsm", "psm", "tsm"])
def test_m1_weights_in_warped_maps(figure, renderer, warp, select):
    rng = np.random.default_rng(63)
    camera = small_scenes.camera(0, near=0.5, far=60.0)
    settings = csm.ShadowSettings(
        cascade_count=3, map_size=256, select=select, warp=warp, blend="linear", blend_width=0.3,
        view_range="camera", **KERNEL,
    )  # fmt: skip
    points, depth = rays_through_the_view(camera, 58.0, 12, 200, rng)
    frame = lookups(renderer, settings, points)
    flat = points.reshape(-1, 3)
    own, _, expected = expected_weights(frame.cascades, settings, flat, depth.ravel())
    same = frame.point_cascade == np.where(own == 3, 255, own)
    assert same.mean() > 0.99
    error = np.abs(frame.point_blend_weight - expected)[same]
    figure("M1", "weights of warped maps against doubles", np.quantile(error, 0.99), 1e-3)
    assert (expected > 0).mean() > 0.005


# -- the end of the range --------------------------------------------------------------------------


def shaded_ray(renderer, depth, **changes):
    """Visibility of points straight ahead at these view depths, under a roof that shadows all."""
    roof = [[-90, 4, -90], [90, 4, -90], [90, 4, 90], [-90, 4, 90]]
    scene = csm.Scene.from_arrays(
        [*roof, [-90, -1, -90], [90, -1, 90], [90, -1, -90]], [[0, 1, 2], [0, 2, 3], [4, 5, 6]]
    )
    camera = csm.Camera.look_at((0, 0, 30), (0, 0, 0), near=0.5, far=80, size=(16, 9))
    settings = csm.ShadowSettings(cascade_count=3, map_size=256, **changes)
    points = camera.eye - np.asarray(depth, float)[:, None] * camera.backward
    return renderer.render(scene, camera, csm.Sun((0, 1, 0)), settings, outputs=("mask",),
                           points=points)  # fmt: skip


@pytest.mark.parametrize("width", [0.02, 0.3, 1.0])
@pytest.mark.parametrize("changes", [
    {"view_range": "camera"}, {"max_distance": 37.0},
    {"view_range": "camera", "max_distance": 51.3},
    {"view_range": "camera", "blend": "linear", "select": "interval"}, {"blend": "smooth"},
], ids=str)  # fmt: skip
def test_m1_shadows_fade_evenly_to_exactly_none(figure, renderer, changes, width):
    depth = np.linspace(0.6, 60.0, 2000)
    frame = shaded_ray(renderer, depth, fade_width=width, **changes)
    splits = frame.cascades.splits
    end = splits[-1]
    fade = width * (end - splits[0])
    expected = 1.0 - np.clip((end - depth) / fade, 0.0, 1.0)
    figure(
        "M1", "visibility in the fade, from a straight line",
        np.abs(frame.point_visibility - expected).max(), 4e-5,
    )  # fmt: skip
    assert (np.diff(frame.point_visibility) >= 0).all()
    at_end = np.float32(end)
    around = [np.nextafter(at_end, np.float32(0)), at_end, np.nextafter(at_end, np.float32(1e9))]
    there = shaded_ray(renderer, around, fade_width=width, **changes)
    assert there.point_visibility[0] > 1.0 - 1e-4
    assert (there.point_visibility[1:] == 1.0).all()
    without = shaded_ray(renderer, depth, **changes)
    inside = depth < end * (1 - 1e-6)
    assert (without.point_visibility[inside] == 0.0).all()  # a hard end, without
    assert (without.point_visibility[depth > end * (1 + 1e-5)] == 1.0).all()


def test_transitions_that_do_nothing_are_none():
    canonical = csm.ShadowSettings(blend="linear", cascade_count=1).canonical()
    assert canonical.blend == "none"
    assert csm.ShadowSettings(blend="smooth", blend_width=0.0).canonical().blend == "none"
    assert csm.ShadowSettings(blend_width=0.7).canonical().blend_width == 0.1
    assert csm.ShadowSettings(blend="dither").canonical().blend == "dither"
