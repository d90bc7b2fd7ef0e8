"""Visibility of any points in the maps of the last render: the mask's own answers, and nothing of
the renderer disturbed."""

import gc
import threading

import numpy as np
import pytest
import small_scenes
from test_cull_exclusive import random_case

import csm
from csm import scenes

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal")
SUN = csm.Sun(small_scenes.SUNS["high"])
POINTS = np.random.default_rng(70).uniform((-10, 0, -10), (10, 6, 10), size=(400, 3))


def surfaces(frame):
    """World points and normals of the pixels that see something."""
    points = small_scenes.positions_of(frame)[frame.valid]
    return points, frame.normal[frame.valid].astype(float)


@pytest.mark.parametrize("changes", [
    {}, {"filter": "pcf", "filter_size": 5, "blend": "linear"}, {"filter": "pcf", "filter_size": 2},
    {"select": "interval", "blend": "smooth", "fade_width": 0.4},
    {"select": "frustum", "filter": "pcf"},
    {"cull": "exclusive", "blend": "linear", "blend_width": 0.3}, {"cull": "none"},
    {"warp": "lispsm", "blend": "linear"}, {"warp": "psm", "cull": "none"},
    {"light_basis": "world"}, {"fit": "visible", "turned": True}, {"split": "sdsm"},
    {"filter": "vsm"}, {"filter": "vsm", "cull": "none"},  # not trilinear: a point has no pixel
    {"filter": "none"}, {"depth_format": "d16", "reversed_depth": True}, {"storage": "atlas"},
    {"bias": "manual", "bias_side": "caster", "slope_bias": 1.0, "caster_faces": "back"},
], ids=str)  # fmt: skip
def test_pixels_get_their_own_mask(renderer, changes):
    # Places come back through float32 depths: compares within their rounding may turn, and texels
    # at whose rim a point lies. Instances, culled maps and moments all have their turn.
    scene, camera = small_scenes.copies(), small_scenes.camera(0)
    settings = csm.ShadowSettings(map_size=(256, 128, 128, 64), **changes)
    frame = renderer.render(scene, camera, SUN, settings, outputs=OUTPUTS)
    found = renderer.visibility(*surfaces(frame))
    mask, index = frame.mask[frame.valid], frame.cascade_index[frame.valid]
    assert found.mask.shape == found.cascade_index.shape == found.blend_weight.shape == mask.shape
    assert [a.dtype.name for a in vars(found).values()] == ["float32", "uint8", "float32"]
    assert 0.02 < np.mean(mask < 1.0) < 0.98 or settings.filter == "none"
    assert np.mean(np.abs(found.mask - mask) > 1e-3) < 2e-3
    assert np.mean(found.cascade_index != index) < 2e-3
    assert (found.blend_weight > 0).any() == (settings.canonical().blend != "none")
    # a second time from the maps that are whole now
    again = renderer.visibility(*surfaces(frame))
    assert all(map(np.array_equal, vars(again).values(), vars(found).values()))


@pytest.mark.parametrize("changes", [
    {}, {"blend": "linear", "filter": "pcf"}, {"warp": "tsm"}, {"filter": "vsm"},
    {"cull": "exclusive"},
], ids=str)  # fmt: skip
@pytest.mark.parametrize("outputs", [("mask",), ("shadow_maps",), ("valid",)], ids=str)
def test_points_get_what_a_render_with_points_says(renderer, changes, outputs):
    # to the bit, whether the render drew whole maps, culled ones or none at all
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    settings = csm.ShadowSettings(map_size=128, **changes)
    normals = np.random.default_rng(71).normal(size=POINTS.shape)
    for given in (None, normals):
        frame = renderer.render(
            scene, camera, SUN, settings, outputs=("mask",), points=POINTS, point_normals=given
        )
        direct = renderer.visibility(POINTS, given)
        renderer.render(scene, camera, SUN, settings, outputs=outputs)
        late = renderer.visibility(POINTS, given)
        for found in (direct, late):
            assert np.array_equal(found.mask, frame.point_visibility)
            assert np.array_equal(found.cascade_index, frame.point_cascade)
            assert np.array_equal(found.blend_weight, frame.point_blend_weight)
    assert 0.05 < frame.point_visibility.mean() < 0.95


def test_culled_maps_alone_would_not_do(renderer):
    # what the test above could miss: casters that only points outside the picture need
    scene, camera, sun, _ = random_case(2)
    settings = csm.ShadowSettings(map_size=128, cascade_count=2)
    whole, culled = (
        renderer.render(scene, camera, sun, settings.replace(cull=cull), outputs=("shadow_maps",))
        for cull in ("none", "inclusive")
    )
    assert np.mean(culled.shadow_maps != whole.shadow_maps) > 1e-3
    points = np.random.default_rng(72).uniform(*scene.bounds, size=(20_000, 3)) * 0.5
    late = renderer.visibility(points)
    renderer.render(scene, camera, sun, settings.replace(cull="none"), outputs=("mask",))
    assert np.array_equal(renderer.visibility(points).mask, late.mask)


def frames_alike(one, other):
    assert one.outputs == other.outputs
    for name in one.outputs:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert np.array_equal(one.cascades.lattice, other.cascades.lattice)
    assert one.cascades.hold == other.cascades.hold
    ours, theirs = dict(one.info), dict(other.info)
    ours.pop("programs_compiled")
    theirs.pop("programs_compiled")
    assert ours == theirs
    assert one.timings_ms.keys() == other.timings_ms.keys()


@pytest.mark.parametrize("changes", [
    {}, {"warp": "lispsm"}, {"snap": "approximate", "level_hysteresis": 2}, {"filter": "vsm"},
    {"blend": "dither", "cull": "exclusive"},
], ids=str)  # fmt: skip
def test_a_walk_is_the_same_with_looks_in_between(renderer, changes):
    scene = small_scenes.soup()
    settings = csm.ShadowSettings(map_size=64, **changes)
    cameras = [small_scenes.camera(0).translated((0, 0, 0.05 * step)) for step in range(4)]
    walks = []
    for looks in (False, True):
        walk = []
        renderer.render(small_scenes.SCENES["stairs"](), cameras[0], SUN, settings)
        for camera in cameras:
            walk.append(renderer.render(scene, camera, SUN, settings))
            if looks:
                renderer.visibility(POINTS)
        walks.append(walk)
    for one, other in zip(*walks, strict=True):
        frames_alike(one, other)


def test_looks_leave_no_objects_behind(fresh_renderer):
    renderer = fresh_renderer()
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    warped = csm.ShadowSettings(map_size=64, warp="lispsm", filter="pcf")
    counts = []
    for _ in range(3):
        for settings in (warped, csm.ShadowSettings(map_size=64, cascade_count=2)):
            renderer.render(scene, camera, SUN, settings, outputs=("mask",))
            renderer.visibility(POINTS)
        info = renderer.info
        counts.append((info["live_objects"], info["programs_compiled"]))
    assert counts[1] == counts[2] == counts[0]


def test_the_last_scene_must_be_there_where_maps_were_culled(fresh_renderer):
    renderer = fresh_renderer()
    camera = small_scenes.camera(0)
    scene = small_scenes.soup()
    renderer.render(scene, camera, SUN, csm.ShadowSettings(map_size=64), outputs=("mask",))
    whole = renderer.visibility(POINTS).mask
    del scene
    gc.collect()
    # drawn whole before: the maps are enough
    assert np.array_equal(renderer.visibility(POINTS).mask, whole)
    renderer.render(small_scenes.soup(), camera, SUN, csm.ShadowSettings(map_size=64))
    gc.collect()
    with pytest.raises(ValueError, match="needs the scene of the last render"):
        renderer.visibility(POINTS)
    # another scene at what may be the same address is not taken for it
    renderer.render(small_scenes.soup(), camera, SUN, csm.ShadowSettings(map_size=64, cull="none"))
    gc.collect()
    assert np.array_equal(renderer.visibility(POINTS).mask, whole)


def test_before_a_render_and_after_one_that_failed(fresh_renderer, tmp_path):
    renderer = fresh_renderer()
    needs = "visibility needs the maps of a render before it"
    with pytest.raises(ValueError, match=needs):
        renderer.visibility(POINTS)
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    renderer.render(scene, camera, SUN, csm.ShadowSettings(map_size=64), outputs=("mask",))
    renderer.visibility(POINTS)
    # refused before anything is drawn: the maps are still those of the render before
    with pytest.raises(ValueError, match="points"):
        renderer.render(scene, camera, SUN, points=[[0, 0]])
    renderer.visibility(POINTS)
    wide = csm.ShadowSettings(map_size=8, filter="pcf", filter_size=9)
    with pytest.raises(ValueError, match="map_size"):
        renderer.render(scene, camera, SUN, wide, outputs=("mask",))
    with pytest.raises(ValueError, match=needs):
        renderer.visibility(POINTS)
    renderer.close()
    with pytest.raises(csm.ContextError, match="closed"):
        renderer.visibility(POINTS)


@pytest.mark.parametrize(("arguments", "error", "text"), [
    (([[0, 0]],), ValueError, r"points must be .m, 3. .got shape"),
    (([0.0, 1.0, 2.0],), ValueError, r"points must be .m, 3."),
    ((None,), TypeError, "points must be an array of real numbers"),
    (([[0, np.nan, 0]],), ValueError, "points must be finite .number 0"),
    (([[0, 0, 0]], [[0, 0]]), ValueError, r"normals must be .m, 3."),
    (([[0, 0, 0]], [[0, 1, 0], [0, 1, 0]]), ValueError, r"normals must be as many as points, 1"),
    (([[0, 0, 0], [1, 1, 1]], [[0, 1, 0], [0, 0, 0]]), ValueError,
     r"normals must not be zero .number 1"),
    (([[0, 0, 0]], [[0, np.inf, 0]]), ValueError, "normals must be finite"),
])  # fmt: skip
def test_bad_arguments_are_refused(renderer, arguments, error, text):
    settings = csm.ShadowSettings(map_size=32, cascade_count=1)
    renderer.render(scenes.plane_and_box(), small_scenes.camera(0), SUN, settings)
    with pytest.raises(error, match=text):
        renderer.visibility(*arguments)


@pytest.mark.parametrize("filter_name", ["hard", "none"])
def test_no_points_and_no_maps(renderer, filter_name):
    scene = scenes.plane_and_box()
    settings = csm.ShadowSettings(map_size=32, cascade_count=1, filter=filter_name)
    renderer.render(scene, small_scenes.camera(0), SUN, settings)
    empty = renderer.visibility(np.empty((0, 3)))
    assert [len(array) for array in vars(empty).values()] == [0, 0, 0]
    if filter_name == "none":
        found = renderer.visibility(POINTS)
        assert (found.mask == 1.0).all()
        assert (found.cascade_index == 255).all()
        assert (found.blend_weight == 0.0).all()
        turned = renderer.visibility(POINTS[:2], [SUN.to_light, -SUN.to_light])
        assert turned.mask.tolist() == [1.0, 0.0]  # as a mask is, without maps


def test_threads_look_into_one_renderer(renderer):
    # Calls are serialised, and the last render is the renderer's, whoever made it.
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    settings = csm.ShadowSettings(map_size=64)
    renderer.render(scene, camera, SUN, settings, outputs=("mask",))
    expected = renderer.visibility(POINTS).mask
    wrong = []

    def look():
        for _ in range(5):
            found = renderer.visibility(POINTS)
            wrong.append(not np.array_equal(found.mask, expected))
            renderer.render(scene, camera, SUN, settings, outputs=("mask",))

    threads = [threading.Thread(target=look) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(wrong) == 15
    assert not any(wrong)
