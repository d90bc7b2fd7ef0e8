"""Culling under transitions: a map keeps the casters of receivers that only blend into it, and
leaves out nothing under the band of a finer one (docs/numerics.md 30)."""

import numpy as np
import oracles
import pytest
from test_cull_exclusive import FITS, KERNELS, _Scene, assert_masks_equal, place, random_case
from views import clip_points

import csm
from csm import _core

BLENDS = ["linear", "smooth", "dither"]
SELECTS = ["map", "interval", "frustum"]


@pytest.mark.parametrize("scenes", [9, pytest.param(90, marks=pytest.mark.slow)], ids=["9", "90"])
def test_g1_masks_of_random_scenes_are_equal_under_transitions(figure, renderer, scenes):
    dropped = mixed = 0
    for number in range(scenes):
        scene, camera, sun, rng = random_case(200 + number)
        settings = csm.ShadowSettings(
            map_size=(256, 128, 200, 64) if number % 4 == 2 else 128,
            select=SELECTS[number % 3],
            blend=BLENDS[number // 3 % 3],
            blend_width=float(rng.choice([0.05, 0.3, 1.0])),
            fade_width=float(rng.choice([0.0, 0.2])),
            snap=str(rng.choice(["exact", "none"])),
            lam=float(rng.choice([0.3, 0.8])),
            **list(KERNELS.values())[number % len(KERNELS)],
        )
        if number % 5 == 4:
            settings = settings.replace(bias="manual", normal_offset_texels=3.0)
        frames = assert_masks_equal(
            figure, renderer, scene, camera, sun, settings, "masks under transitions"
        )
        dropped += sum(frames[1].info["chunks_culled"])
        mixed += np.count_nonzero(frames[3].point_blend_weight)
    assert dropped > 10 * scenes  # so that the equality says something
    assert mixed > 10 * scenes


@pytest.mark.parametrize(("fit", "select", "blend"), [
    (fit, SELECTS[i % 3], BLENDS[i // 2 % 3]) for i, fit in enumerate(FITS)
])  # fmt: skip
def test_g1_masks_are_equal_under_every_fit_and_transition(figure, renderer, fit, select, blend):
    scene, camera, sun, _ = random_case(1)
    settings = csm.ShadowSettings(
        map_size=128, select=select, blend=blend, blend_width=0.4, **FITS[fit], **KERNELS[1]
    )
    assert_masks_equal(figure, renderer, scene, camera, sun, settings, "masks under transitions")


@pytest.mark.parametrize("changes", [
    {"warp": "lispsm"}, {"warp": "tsm", "select": "interval"}, {"light_basis": "world"},
    {"texcoord": "interpolated"}, {"pancake": True}, {"depth_range": "window"},
    {"depth_range": "manual", "manual_depth_range": (-30.0, 12.0)},
    {"bias": "manual", "bias_side": "caster", "slope_bias": 2.0, "constant_bias_texels": 1.0},
    {"caster_faces": "back"}, {"filter": "vsm"}, {"max_distance": 12.0, "fade_width": 0.5},
], ids=str)  # fmt: skip
def test_g1_masks_are_equal_under_transitions_of_narrow_maps(figure, renderer, changes):
    scene, camera, sun, _ = random_case(2)
    settings = csm.ShadowSettings(
        map_size=128, blend="linear", blend_width=0.5, **{**KERNELS[7], **changes}
    )
    assert_masks_equal(figure, renderer, scene, camera, sun, settings, "masks under transitions")


# -- against the rule itself -----------------------------------------------------------------------


def view_points(camera, cascades, rng, count=20_000):
    """Visible points inside the scene and their view depths."""
    points = oracles.sample_slice(camera, cascades.splits[0], cascades.splits[-1], count, rng)
    inside = ((points >= _Scene.bounds[0]) & (points <= _Scene.bounds[1])).all(axis=1)
    points = points[inside]
    return points, (points - camera.eye) @ -camera.backward


def deepness(cascades, i, points, padding):
    """How far inside window i, as a share of its half side."""
    rim = 1.0 - 2.0 * padding / cascades.map_size[i]
    return rim - np.abs(clip_points(cascades, i, points)[:, :2]).max(axis=1)


def blending(cascades, settings, points, depth, padding):
    """For each map from the second on, the points that a finer map blends into it."""
    width, count = settings.blend_width, cascades.count
    deep = np.array([deepness(cascades, i, points, padding) for i in range(count)])
    if settings.select == "interval":
        own = np.clip(np.searchsorted(cascades.splits[1:-1], depth), 0, count - 1)
    else:
        own = np.where((deep > 0).any(axis=0), (deep > 0).argmax(axis=0), count)
    for i in range(1, count):
        held = (deep[i] > 0.0) & (own < i)
        for between in range(1, i):  # the next map is the first that holds the receiver
            held &= (deep[between] <= 0.0) | (own >= between)
        if settings.select == "interval":
            start = cascades.splits[i] - width * (cascades.splits[i] - cascades.splits[i - 1])
            held &= (own == i - 1) & (depth > start)
        else:
            held &= np.take_along_axis(deep, np.minimum(own, count - 1)[None], 0)[0] < width
        yield i, points[held]


def specks_over(points, cascades, i, padding, to_light, rng):
    """Specks anywhere up the light from the texels that lookups of the points may fetch."""
    light = cascades.light_from_world[i][:2, :3]
    reach = (padding + 0.5) * cascades.texel_size[i]
    lookups = points + (rng.uniform(-1.0, 1.0, size=(len(points), 2)) * reach) @ light
    above = lookups + rng.uniform(0, 80, size=(len(points), 1)) * to_light
    return np.concatenate([above - 1e-9, above + 1e-9], axis=1)


@pytest.mark.parametrize("width", [0.1, 0.6])
@pytest.mark.parametrize("select", SELECTS)
def test_g1_casters_over_a_band_are_kept(figure, select, width):
    """Casters that a map needs for receivers of finer ones are kept under a transition; without one
    the same culling drops some of them."""
    lost = lost_without = checked = 0
    for seed in range(8):
        camera, sun, settings, _, rng = place(seed, 1)
        settings = settings.replace(
            select=select, blend="linear", blend_width=width, cull="inclusive"
        )
        cascades = csm.fit_cascades(camera, sun, settings, scene=_Scene)
        padding = 0 if select == "frustum" else 1
        points, depth = view_points(camera, cascades, rng)
        for i, needed in blending(cascades, settings, points, depth, padding):
            specks = specks_over(needed, cascades, i, 1, sun.to_light, rng)
            for blend in ("linear", "none"):
                kept = _core.cull_boxes(
                    camera, sun.to_light, settings.replace(blend=blend), _Scene.bounds, specks, i,
                    margin_texels=2.0,
                )  # fmt: skip
                if blend == "linear":
                    lost += len(specks) - len(kept)
                else:
                    lost_without += len(specks) - len(kept)
            checked += len(specks)
    assert checked > 1000
    figure("G1", f"casters over a band dropped, select {select}", lost, 0, "specks")
    assert lost_without > 10 or (select != "interval" and width < 0.5)


@pytest.mark.parametrize("width", [0.1, 0.6])
@pytest.mark.parametrize("select", ["map", "frustum"])
def test_g1_no_caster_under_the_band_of_a_finer_map_is_left_out(figure, select, width):
    lost = lost_without = checked = left_out = 0
    for seed in range(8):
        camera, sun, settings, _, rng = place(seed, 1)
        settings = settings.replace(select=select, blend="linear", blend_width=width)
        cascades = csm.fit_cascades(camera, sun, settings, scene=_Scene)
        padding = 0 if select == "frustum" else 1
        points = rng.uniform(*_Scene.bounds, size=(30_000, 3))
        boxes = rng.uniform(*_Scene.bounds, size=(2000, 3))
        boxes = np.concatenate([boxes - 0.02, boxes + 0.02], axis=1)
        for i, needed in blending(cascades, settings, points, points[:, 0], padding):
            specks = specks_over(needed, cascades, i, 1, sun.to_light, rng)
            counts = {}
            for blend in ("linear", "none"):
                options = {"margin_texels": 2.0, "whole_window": True}
                arguments = (
                    camera, sun.to_light, settings.replace(blend=blend), _Scene.bounds
                )  # fmt: skip
                held = len(_core.cull_boxes(*arguments, specks, i, **options))
                kept = _core.cull_boxes(
                    *arguments, specks, i, border_texels=padding + 1.0, **options
                )
                counts[blend] = held - len(kept)
                checked += held
                if blend == "linear":
                    all_of = len(_core.cull_boxes(*arguments, boxes, i, **options))
                    left_out += all_of - len(
                        _core.cull_boxes(
                            *arguments, boxes, i, border_texels=padding + 1.0, **options
                        )
                    )
            lost += counts["linear"]
            lost_without += counts["none"]
    assert checked > 1000
    figure("G1", "casters under a finer map's band dropped", lost, 0, "specks")
    assert lost_without > 10  # what the finer rectangles drop where they do not shrink
    assert left_out > 100 or width > 0.5  # and they still leave out much
