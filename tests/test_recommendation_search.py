"""What csm.recommend searches among: warps, cascades that hold receivers, costs of the machine."""

import dataclasses
import pickle
import warnings

import numpy as np
import pytest

import csm
from csm import shapes
from csm.arguments import find_cameras
from csm.costs import GPU, CostModel, cost_model_of, forecast_cost
from csm.forecasts import Forecaster
from csm.plans import map_bytes
from csm.search import Search
from csm.signals import measure_signals
from csm.verification import picture_error

SIZE = (640, 360)
NO_GOAL = {"max_error": None, "budget_ms": None, "max_bytes": None}


@pytest.fixture(scope="module")
def road():
    scene = csm.scenes.long_road()
    return scene, scene.cameras["driver"].replace(size=SIZE), scene.suns["side"]


def test_a_warp_is_taken_where_it_makes_shadows_better(renderer, road):
    scene, _, sun = road
    camera = scene.cameras["bridge"].replace(size=SIZE)
    signals = measure_signals(renderer, scene, [camera], [sun])
    search = Search(signals, scene, NO_GOAL, 16384, GPU)
    assert search.choose(GPU).settings.warp == "lispsm"
    one = csm.ShadowSettings(fit="visible", snap="none", cascade_count=1, map_size=1024)
    both = one.replace(warp="lispsm"), one
    truth = csm.truth(scene, camera, sun, rays_per_pixel=16)
    warped, plain = (picture_error(renderer.render(scene, camera, sun, s), truth) for s in both)
    assert warped < 0.7 * plain
    forecast, without = (search.forecaster.error(s) for s in both)
    assert forecast < 0.7 * without


def test_what_means_nothing_under_a_warp_is_not_recommended(renderer, road):
    scene, camera, sun = road
    signals = measure_signals(renderer, scene, [camera], [sun])
    signals = dataclasses.replace(signals, needless_chunks=3)  # which calls for exclusive culling
    search = Search(signals, scene, NO_GOAL, 16384)
    every = [one.settings for one in search.candidates(CostModel())]
    for family in search.families:  # of whose words none was checked
        assert csm.ShadowSettings.from_dict(family.arranged.to_dict()) == family.arranged
    warped = [one for one in every if one.warp != "none"]
    assert any(one.cascade_count > 1 for one in warped)
    assert any(one.cull == "exclusive" for one in every)
    for settings in warped:
        assert settings.canonical().cull == settings.cull == "inclusive"
        if settings.cascade_count > 1:
            assert settings.canonical().select == settings.select
        assert settings.depth_format == "d32f"  # no step of 16 bits is the same everywhere
        assert not settings.turned


@pytest.mark.parametrize(
    ("name", "camera", "sun"), [("wires", "under", "noon"), ("stairs", "foot", "along")]
)
def test_what_cannot_be_snapped_is_never_considered_in_motion(renderer, name, camera, sun):
    scene = csm.scenes.SCENES[name]()
    camera, sun = scene.cameras[camera].replace(size=SIZE), scene.suns[sun]
    loose = {}
    for moves in (False, True):
        path = [camera, camera.translated(0.1 * camera.right)][: 1 + moves]
        signals = measure_signals(renderer, scene, path, [sun])
        every = [one.arranged for one in Search(signals, scene, NO_GOAL, 16384).families]
        loose[moves] = [one for one in every if one.turned or one.warp != "none"]
    assert loose[False], "nor is there anything to leave out, else"
    assert not loose[True]


@pytest.mark.parametrize(
    ("camera", "sun", "orthographic"),
    [("street", "noon", False), ("oblique", "afternoon", False), ("street", "noon", True)],
)
@pytest.mark.parametrize("needless", [0, 3])
def test_culling_and_selection_are_taken_where_they_spare_something(
    renderer, camera, sun, orthographic, needless
):
    scene = csm.scenes.town(5000)
    camera, sun = scene.cameras[camera].replace(size=SIZE), scene.suns[sun]
    if orthographic:
        ahead = camera.eye - camera.backward
        camera = csm.Camera.orthographic(camera.eye, ahead, height=40, far=camera.far, size=SIZE)
    signals = measure_signals(renderer, scene, [camera], [sun])
    signals = dataclasses.replace(signals, needless_chunks=needless)
    search, taken = Search(signals, scene, NO_GOAL, 16384), set()
    for family in search.families:
        settings = family.arranged
        if settings.cascade_count == 1 or settings.warp != "none":
            assert settings.cull == "inclusive", "no map is finer, or its windows say nothing"
            continue
        assert settings.cull == ("exclusive" if needless else "inclusive")
        by_map, by_depth = (
            search.forecaster.aliasing(settings.replace(select=select, cull="inclusive"))
            for select in ("map", "interval")
        )
        gains = by_map < 0.99 * by_depth
        assert settings.select == ("map" if needless or gains else "interval")
        taken.add(settings.select)
    assert "map" in taken or (orthographic and not needless)


def test_bytes_of_many_sizes_are_those_of_each(renderer):
    scene = csm.scenes.SCENES["fence"]()
    camera, sun = scene.cameras["along"].replace(size=SIZE), scene.suns["across"]
    signals = measure_signals(renderer, scene, [camera], [sun])
    search = Search(signals, scene, NO_GOAL, 16384)
    told = [size for family in search.families for size in family.map_bytes.tolist()]
    every = search.candidates(CostModel())
    assert told == [map_bytes(one.settings) for one in every]
    assert {one.settings.storage for one in every} == {"array", "atlas"}
    assert {one.settings.depth_format for one in every} == {"d16", "d32f"}


@pytest.fixture(scope="module")
def gap():
    """Ground at one's feet, and a cliff 700 m away: nothing is seen between."""
    near = csm.Scene([shapes.mesh("ground", shapes.box((-3, -1, -6), (3, 0, -2)))])
    far = csm.Scene([shapes.mesh("cliff", shapes.box((-200, -60, -760), (200, 60, -700)))])
    camera = csm.Camera.look_at(
        (0, 1.7, 0), (0, 0.2, -8), fov_y_deg=50, near=0.1, far=900, size=SIZE
    )
    return csm.Scene.merge(near, far), camera, csm.Sun((0.3, 1, 1.5))


def receivers_per_slice(view, settings, scene):
    held = np.concatenate([view.receivers, view.outline])
    cascades = csm.fit_cascades(view.camera, view.sun, settings, scene=scene, receivers=held)
    depths = (held - view.camera.eye) @ -view.camera.backward
    return np.histogram(depths, cascades.splits)[0]


def test_no_cascade_without_receivers(renderer, gap):
    scene, camera, sun = gap
    signals = measure_signals(renderer, scene, [camera], [sun])
    (view,) = signals.views
    practical = csm.ShadowSettings(fit="visible", snap="none")
    assert (receivers_per_slice(view, practical, scene) == 0).any(), "four slices have a gap"
    search = Search(signals, scene, NO_GOAL, 16384)
    every = {one.arranged for one in search.candidates(CostModel())}
    assert max(one.cascade_count for one in every) > 1
    for settings in every:
        if settings.warp == "none":
            counts = receivers_per_slice(view, settings, scene)
            assert settings.cascade_count == 1 or (counts > 0).all(), settings
    found = csm.recommend(scene, camera, sun, renderer=renderer)
    outputs = ("mask", "valid", "view_depth", "normal")
    frame = renderer.render(scene, camera, sun, found.settings, outputs=outputs)
    facing = frame.valid & (frame.normal @ sun.to_light > 1e-3)
    depth = frame.view_depth[facing]
    assert (np.histogram(depth, frame.cascades.splits)[0] > 0).all()


def test_costs_to_begin_with_are_those_of_the_driver(renderer, road):
    assert cost_model_of({"software": True}) == CostModel()
    assert cost_model_of({"software": False}) == GPU
    scene, camera, sun = road
    told = Forecaster(measure_signals(renderer, scene, [camera], [sun]), scene)
    plain = csm.ShadowSettings(fit="visible", cascade_count=2, map_size=2048)
    changes = ({"warp": "lispsm"}, {"split": "sdsm"}, {"turned": True})

    def dearer(model):
        before = forecast_cost(plain, told, model)
        return [forecast_cost(plain.replace(**one), told, model) / before for one in changes]

    # a shader that writes depth, and passes over the picture, are what software lacks hands for
    software, gpu = dearer(CostModel()), dearer(GPU)
    assert software[0] > 1.2
    assert 1.0 < gpu[0] < 1.05
    assert min(software[1:]) > 1.02
    assert max(gpu[1:]) < 1.02
    larger = plain.replace(map_size=4096)
    assert forecast_cost(larger, told, GPU) > 1.5 * forecast_cost(plain, told, GPU)


@pytest.mark.parametrize("model", [CostModel(), GPU], ids=["llvmpipe", "gpu"])
def test_costs_of_many_sizes_are_those_of_each(renderer, road, model):
    scene, camera, sun = road
    told = Forecaster(measure_signals(renderer, scene, [camera], [sun]), scene)
    settings, sizes = csm.ShadowSettings(fit="visible", cascade_count=3), np.array([256, 1722])
    together = forecast_cost(settings, told, model, map_size=sizes)
    for size, cost in zip(sizes.tolist(), together, strict=True):
        assert cost == forecast_cost(settings.replace(map_size=size), told, model)


def test_forecasts_of_many_sizes_are_those_of_each(renderer, road):
    scene, camera, sun = road
    search = Search(measure_signals(renderer, scene, [camera], [sun]), scene, NO_GOAL, 16384)
    for one in search.candidates(CostModel())[::29]:
        assert one.error == search.forecast(one.settings, CostModel()).error
        assert one.ms == search.forecast(one.settings, CostModel()).ms


def test_soft_shadows_are_taken_where_only_they_reach_the_error_asked_for(renderer, road):
    """In a tiny picture penumbrae are narrower than a pixel, and still what hard edges miss."""
    scene, camera, sun = road
    camera = camera.replace(size=(64, 36))
    hard = csm.recommend(scene, camera, sun, max_error=0.5, renderer=renderer)
    assert hard.settings.filter == "hard"
    search = Search(hard.signals, scene, NO_GOAL, 16384)
    assert {one.arranged.filter for one in search.families} == {"hard"}
    asked = 0.9 * min(one.error for one in search.candidates(CostModel()))
    found = csm.recommend(scene, camera, sun, max_error=asked, renderer=renderer)
    assert found.settings.filter == "pcss"
    assert found.met


def test_few_bytes_are_not_spent_on_soft_edges_that_err_more(renderer):
    """Where the knee is out of reach, the nearest is the least error there is, whatever the filter:
    by a map of 256² soft edges were forecast to miss more than hard ones, for twice the time."""
    scene = csm.scenes.town()
    camera, sun = scene.cameras["street"].replace(size=(320, 180)), scene.suns["afternoon"]
    signals = measure_signals(renderer, scene, (camera,), (sun,))
    chosen = {}
    for most in (2**17, 2**22):
        search = Search(signals, scene, {**NO_GOAL, "max_bytes": most}, 16384)
        one, model = search.choose(search.model), search.model
        assert not search.forecast(one.settings, model).met
        assert one.error == search.least_error()
        every = search.candidates(model)
        assert {other.arranged.filter for other in every} == {"hard", "pcss"}
        assert not any(other.error <= one.error and other.ms < one.ms for other in every)
        chosen[most] = one.arranged.filter
    assert chosen == {2**17: "hard", 2**22: "pcss"}


def test_orthographic_sky_is_no_receiver_and_one_map_is_not_split(renderer):
    scene = csm.scenes.town(8000)
    camera = csm.Camera.orthographic(
        (-20, 17, 60), (15, 4, -20), height=120, far=500, size=(160, 90)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = csm.recommend(scene, camera, csm.Sun.from_compass(238, 33), renderer=renderer)
    assert not renderer.render(scene, camera, csm.Sun((0, 1, 0))).valid.all(), "no sky"
    if found.settings.cascade_count == 1:
        (reason,) = (one for one in found.reasons if one.effect == "split")
        assert not reason.taken


@pytest.mark.parametrize("first", [0, 1])
def test_a_path_of_both_kinds_of_camera_takes_what_both_allow(renderer, first):
    scene = csm.scenes.town()
    camera = scene.cameras["street"].replace(size=(160, 90))
    flat = camera.replace(orthographic=True, near=-100.0, half_width=20.0, half_height=11.0)
    path = [camera, flat][:: 1 - 2 * first]
    sun = scene.suns["noon"]
    found = csm.recommend(scene, path, sun, renderer=renderer)
    assert found.signals.orthographic
    assert found.settings.split == "uniform" or found.settings.cascade_count == 1
    for one in path:
        renderer.render(scene, one, sun, found.settings, outputs=("mask",))


def test_even_splits_that_are_all_a_camera_allows_are_no_choice(renderer):
    camera = csm.Camera.orthographic(
        (0, 6, 30), (0, 0, 0), height=12, near=-5, far=400, size=(320, 180)
    )
    found = csm.recommend(csm.scenes.fence(), camera, csm.Sun((1, 0.2, 0.1)), renderer=renderer)
    assert found.settings.cascade_count > 1
    assert found.settings.split == "uniform"
    (reason,) = (one for one in found.reasons if one.effect == "split")
    assert not reason.taken
    assert reason.flipped is None


def test_a_path_is_biased_unless_its_back_sides_cast(renderer):
    """One view of it had asked what back sides gain, and one had no need to."""
    scene, sun = csm.scenes.plane_and_box(), csm.Sun.from_compass(90, 45)
    words = [f"eye={x},4.5,8,target=0,0.5,0" for x in (6, 6.03)]
    path = find_cameras(scene, words, (160, 90))
    found = csm.recommend(scene, path, sun, renderer=renderer)
    assert found.settings.bias == "auto" or found.settings.caster_faces == "back"
    for camera in path:
        error = picture_error(
            renderer.render(scene, camera, sun, found.settings), csm.truth(scene, camera, sun)
        )
        assert error < 0.002, "half of the ground was striped with shadow"


def test_settings_are_known_by_themselves_alone(renderer, road):
    """Also after a copy, in which ids are those of settings that are gone."""
    scene, camera, sun = road
    found = csm.recommend(scene, camera, sun, max_error=0.01, renderer=renderer)
    copied = pickle.loads(pickle.dumps(found.forecaster))
    others = [csm.ShadowSettings(fit="visible", cascade_count=n, lam=0.3) for n in (1, 2, 3)]
    expected = [Forecaster(found.signals, scene).error(one) for one in others]
    some = next(iter(copied._keys.values()))
    copied._keys.update({id(one): some for one in others})  # whose ids they happen to get
    assert [copied.error(one) for one in others] == expected
    assert len(set(expected)) > 1


@pytest.mark.parametrize("goal", [{}, {"max_error": 0.01}, {"max_bytes": 10**6}])
def test_a_recommendation_comes_back_from_a_pickle(renderer, road, goal):
    scene, camera, sun = road
    found = csm.recommend(scene, camera, sun, renderer=renderer, **goal)
    copied = pickle.loads(pickle.dumps(found))
    assert copied == found
    other = found.settings.replace(map_size=700)
    assert copied.forecast(other) == found.forecast(other)


@pytest.mark.parametrize(
    ("given", "error", "text"),
    [
        ({"repeats": 0}, ValueError, "repeats must be a number from 1 to 10000"),
        ({"repeats": 1.5}, TypeError, "repeats must be a whole number from 1 to 10000"),
        ({"renderer": 3}, TypeError, "renderer must be a csm.Renderer"),
    ],
)
def test_verify_says_what_it_takes(renderer, road, given, error, text):
    found = csm.recommend(*road, renderer=renderer)
    with pytest.raises(error, match=text):
        found.verify(**{"renderer": renderer, **given})
