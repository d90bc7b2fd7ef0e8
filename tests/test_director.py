"""Along a path: settings that stay do not flicker, maps that stay are told of and counted."""

import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import small_scenes
from paths import SIZE, path, step

import csm
from csm.budgets import corrected
from csm.costs import CostModel
from csm.plans import map_bytes
from csm.search import Forecast

SUN = csm.Sun((0.35, 0.8, 0.5))
MASK = ("mask",)


def view(far_off, size=(160, 90)):
    """The box of `plane_and_box` from one direction."""
    eye = far_off * np.array([6, 4.5, 8])
    return csm.Camera.look_at(eye, (-0.5, 0.6, 0), fov_y_deg=45, far=100, size=size)


BOX_SUN = csm.Sun((1, 1, 0))


@pytest.fixture(scope="module")
def boundary(plain_renderer):
    """Two views of a box, and a largest error between those of one small map at both."""
    scene, near, far = csm.scenes.plane_and_box(), view(0.68), view(0.85)
    # the Director asks for a camera in motion, so a path is what it compares with
    path_to = {"sun": BOX_SUN, "max_error": 1.0, "renderer": plain_renderer}
    small = csm.recommend(scene, [far, far], **path_to).settings
    small = small.replace(snap="exact", turned=False)
    errors = [
        csm.recommend(scene, [one, one], BOX_SUN, renderer=plain_renderer).forecast(small).error
        for one in (near, far)
    ]
    assert errors[1] < 0.95 * errors[0]
    return scene, near, far, sum(errors) / 2


def changes_on(renderer, boundary, pattern, **more):
    """How often the settings changed after the first frame; n is the near view, f the far one."""
    scene, near, far, limit = boundary
    held = []
    with csm.Director(scene, max_error=limit, renderer=renderer, **more) as director:
        for one in pattern:
            director.render({"n": near, "f": far}[one], BOX_SUN, outputs=MASK)
            held.append(director.settings)
        report = director.report()
    changes = sum(a != b for a, b in pairwise(held))
    assert report.changes == changes
    assert all(one.snap == "exact" and not one.turned for one in held), "as for a path"
    return changes, report


@pytest.mark.parametrize("pattern", ["fnfnfnfn", "nfnfnfnf", "fffnnnfffnnn"])
def test_settings_change_at_most_once_on_a_path_to_and_fro(renderer, boundary, pattern):
    changes, report = changes_on(renderer, boundary, pattern)
    assert changes <= 1
    assert len(report.decisions) >= 4, "the view changed enough to look again"


def test_without_hysteresis_they_flicker(renderer, boundary):
    changes, _ = changes_on(renderer, boundary, "fnfnfnfn", patience=0)
    assert changes == 7


@pytest.mark.parametrize(
    "goal",
    [{"max_bytes": 600_000}, {"max_error": 1e-5, "max_bytes": 600_000}],
    ids=["knee", "error"],
)
def test_where_nothing_reaches_the_goal_they_do_not_flicker_either(renderer, goal):
    scene = csm.scenes.town(5000)
    views = [scene.cameras[name].replace(size=SIZE) for name in ("street", "oblique")]
    found = [
        csm.recommend(scene, [one, one], scene.suns["noon"], renderer=renderer, **goal)
        for one in views
    ]
    assert not any(one.met for one in found)
    assert found[0].settings != found[1].settings
    held = []
    with csm.Director(scene, renderer=renderer, **goal) as director:
        for number in range(8):
            director.render(views[number % 2], scene.suns["noon"], outputs=MASK)
            held.append(director.settings)
        assert len(director.report().decisions) == 8
        assert len(set(held)) == 1
        # but where the camera stays about there, the nearest is taken
        aside = 0.1 * np.linalg.norm(np.ptp(scene.bounds.reshape(2, 3), axis=0))
        director.render(
            views[1].translated(aside * views[1].right), scene.suns["noon"], outputs=MASK
        )
        assert director.report().decisions[-1].reason.endswith("the new ones are nearer")
        assert director.settings not in held


@pytest.mark.parametrize("goal", [{}, {"max_error": 0.0}, {"max_error": 0.5}, {"budget_ms": 1e6}])
@pytest.mark.parametrize("turns", [(0, 15, 0, 15, 0), (15, 0, 15, 0, 15)], ids=["over", "within"])
def test_what_breaks_the_bytes_gives_way_at_once_and_nothing_that_fits_to_it(renderer, goal, turns):
    scene = csm.scenes.plane_and_box()
    camera = next(iter(scene.cameras.values())).replace(size=SIZE)
    most = 140_000  # one map of 16 bits; square to the sun, what is flat is given 32
    held = []
    with csm.Director(scene, max_bytes=most, renderer=renderer, **goal) as director:
        for degrees in turns:
            angle = math.radians(degrees)
            sun = csm.Sun((math.sin(angle), math.cos(angle), 0.0))
            director.render(camera, sun, outputs=MASK)
            held.append((map_bytes(director.settings), director.recommendation.map_bytes))
        reasons = [one.reason for one in director.report().decisions]
    found = [131_072 if degrees else 262_144 for degrees in turns]
    assert [told for _, told in held] == found
    assert [kept for kept, _ in held] == [found[0]] + 4 * [131_072]
    assert turns[0] or "262144 bytes)" in reasons[1]


class Told:
    """A recommendation of settings by their size, of which some meet the goal where it was made."""

    def __init__(self, size, *good):
        self.settings, self.good = csm.ShadowSettings(cascade_count=1, map_size=size), good
        told = self.forecast(self.settings)
        self.met = told.met
        self.expected_error, self.expected_ms = told.error, told.ms
        self.map_bytes = map_bytes(self.settings)
        self.signals = SimpleNamespace(sun_moves=False)

    def forecast(self, settings):
        size = settings.map_size
        return Forecast(1.0 / size, float(size), size in self.good)

    def meeting(self, other):
        both = [size for size in self.good if size in other.good]
        return csm.ShadowSettings(cascade_count=1, map_size=min(both)) if both else None


def let_looks_find(monkeypatch, told):
    """Look by look of a director, instead of what it sees."""
    every = iter(told)
    monkeypatch.setattr("csm.director.recommend_from", lambda *a, **k: next(every))
    monkeypatch.setattr(csm.Director, "_costs", lambda self: None)


def sizes_held(monkeypatch, renderer, told, **goal):
    """Sizes of the maps that a director holds, frame by frame, where a look finds what is told."""
    let_looks_find(monkeypatch, told)
    held = []
    goal = goal or {"max_error": 0.1}
    with csm.Director(csm.scenes.plane_and_box(), renderer=renderer, **goal) as director:
        for number in range(len(told)):
            director.render(view(1.0 + 0.5 * (number % 2)), BOX_SUN, outputs=MASK)
            held.append(director.settings.map_size)
        assert len(director.report().decisions) == len(told), "every frame is another place"
    return held


def test_what_follows_a_choice_that_was_soon_missed_meets_the_goal_at_both_places(
    monkeypatch, renderer
):
    one, other = Told(64, 64, 96), Told(32, 32, 96)
    assert sizes_held(monkeypatch, renderer, [one, other]) == [64, 96]
    late = [one] * 11 + [other]  # it has served long enough
    assert sizes_held(monkeypatch, renderer, late) == [64] * 11 + [32]


def test_another_scene_is_looked_at_after_thirty_frames(monkeypatch, renderer):
    let_looks_find(monkeypatch, 3 * [Told(64, 64)])
    scenes = [csm.scenes.plane_and_box() for _ in range(2)]
    with csm.Director(scenes[0], max_error=0.1, renderer=renderer) as director:
        for number in range(63):
            director.scene = scenes[number % 2]  # as an animation does in every frame
            director.render(view(1.0), BOX_SUN, outputs=MASK)
        looks = director.report().decisions
    assert [one.trigger for one in looks] == ["first frame", "another scene", "another scene"]
    assert [one.frame for one in looks] == [0, 31, 62], "the thirtieth is of the scene looked at"


def test_no_gain_is_worth_bytes_that_are_not_there(monkeypatch, renderer):
    small, large = Told(64), Told(128)  # 16384 and 65536 bytes; half the error, and no goal met
    assert sizes_held(monkeypatch, renderer, [small] + 5 * [large], max_bytes=20_000) == 6 * [64]
    assert sizes_held(monkeypatch, renderer, [large, small], max_bytes=20_000) == [128, 64]
    assert sizes_held(monkeypatch, renderer, [large, small], max_bytes=20) == [128, 64]
    free = sizes_held(monkeypatch, renderer, [small] + 3 * [large], max_bytes=200_000)
    assert free == [64, 64, 128, 128]
    # a look that finds too much between two that find what is nearer begins anew
    told = [small, Told(72), large, Told(72), Told(72)]
    assert sizes_held(monkeypatch, renderer, told, max_bytes=30_000)[-2:] == [64, 72]


def test_what_meets_the_goal_gives_way_to_nothing_that_does_not(monkeypatch, renderer):
    held, missed = Told(80, 80), Told(64, 80)
    assert sizes_held(monkeypatch, renderer, [held] + 4 * [missed]) == 5 * [80]


def test_after_a_miss_cheaper_settings_must_be_so_for_longer(monkeypatch, renderer):
    one, other, cheap = Told(64, 64, 96), Told(32, 32, 96), Told(16, 16, 64, 96)
    calm = sizes_held(monkeypatch, renderer, [one] + 3 * [cheap])
    assert calm == [64, 64, 16, 16], "in two looks in a row"
    missed = sizes_held(monkeypatch, renderer, [one, other] + 5 * [cheap])
    assert missed == [64, 96, 96, 96, 96, 16, 16], "in four"


def test_settings_that_miss_the_goal_are_left_and_cheaper_ones_taken_with_patience(
    renderer, boundary
):
    scene, near, _, limit = boundary
    limit /= 20.0  # maps so large that those of the next views are cheaper by a tenth
    beyond = [view(k) for k in (0.85, 1.1, 1.4, 1.75)]
    with csm.Director(scene, max_error=limit, renderer=renderer) as director:
        for camera in (near, *beyond):
            director.render(camera, BOX_SUN, outputs=MASK)
        decisions = director.report().decisions
        assert [one.changed for one in decisions[:2]] == [True, False]
        assert any(one.changed for one in decisions[2:])
        cheap = director.settings
        director.render(near, BOX_SUN, outputs=MASK)
        assert "miss the goal" in director.report().decisions[-1].reason
        assert director.settings != cheap
        assert director.recommendation.forecast(director.settings).met


def test_it_looks_again_only_where_the_view_changed(renderer):
    scene = csm.scenes.plane_and_box()
    with csm.Director(scene, renderer=renderer) as director:

        def looked(camera, sun=BOX_SUN):
            return director.render(camera, sun, outputs=MASK).info["director"]["decision"]

        here = view(1.0)
        assert looked(here).trigger == "first frame"
        assert looked(here) is None
        assert looked(step(here, aside=0.3, turn_deg=3.0)) is None
        assert "moved" in looked(step(here, aside=4.0)).trigger
        assert "turned" in looked(step(here, aside=4.0, turn_deg=20.0)).trigger
        here = step(here, aside=4.0, turn_deg=20.0)
        assert "lens" in looked(here.replace(far=50.0)).trigger
        here = here.replace(far=50.0)
        assert looked(here, csm.Sun((1, 1.01, 0))) is None
        turned = looked(here, csm.Sun((1, 1.2, 0)))
        assert "sun" in turned.trigger
        assert director.settings.light_basis == "world"


def test_director_of_fixed_settings_gives_fresh_masks_and_counts(renderers):
    reusing, plain = renderers
    scene, settings = small_scenes.copies(200), csm.ShadowSettings(map_size=64)
    actions, texels, triangles, ms = [], 0, 0, 0.0
    with csm.Director(scene, settings, renderer=reusing, scroll=False) as director:
        for camera in path():
            frame = director.render(camera, SUN, outputs=MASK)
            fresh = plain.render(scene, camera, SUN, settings, outputs=MASK)
            assert np.array_equal(frame.mask, fresh.mask)
            told = frame.info["director"]
            assert told["decision"] is None
            actions += told["actions"]
            assert told["kept"] == [i for i, a in enumerate(told["actions"]) if a == "keep"]
            drawn = sum(fresh.info["triangles_drawn"]) - told["triangles_saved"]
            assert drawn == sum(frame.info["triangles_drawn"])
            kept = told["kept"] + told["added"]
            assert told["texels_saved"] == len(kept) * 64 * 64
            texels += told["texels_saved"]
            triangles += told["triangles_saved"]
            ms += told["ms_saved"]
        report = director.report()
    assert report.maps == {name: actions.count(name) for name in report.maps}
    assert (report.texels_saved, report.triangles_saved) == (texels, triangles)
    assert report.ms_saved == pytest.approx(ms)
    assert report.maps["keep"] >= 12
    assert report.frames == 11
    assert f"{report.maps['keep']:,}" in str(report)
    assert "<table" in report._repr_html_()
    reusing.render(scene, camera, SUN, settings, outputs=MASK)  # it is not the director's to close


@pytest.mark.parametrize(
    "changes",
    [
        {"light_basis": "transported"},
        {"fit": "visible", "split": "sdsm", "sun_step_deg": 0.5},
        {"snap": "approximate", "fit": "box", "level_count": 32},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_what_others_render_in_between_costs_maps_and_changes_nothing(renderers, changes):
    shared, plain = renderers
    scene, other = small_scenes.copies(), small_scenes.soup()
    settings = csm.ShadowSettings(map_size=64, **changes)
    camera, sun = small_scenes.camera(0, size=SIZE), SUN
    with csm.Director(scene, settings, renderer=shared, scroll=False) as director:
        for number in range(8):
            camera = step(camera, forward=0.01, turn_deg=0.05)
            sun = csm.Sun(sun.to_light + np.array([0.01, 0.0, 0.02]))
            frame = director.render(camera, sun, outputs=MASK)
            fresh = plain.render(scene, camera, sun, settings, outputs=MASK)
            assert np.array_equal(frame.mask, fresh.mask), number
            shared.render(other, camera, sun, outputs=MASK)


def test_the_walk_of_a_shared_renderer_is_not_the_directors(renderers):
    shared, plain = renderers
    scene, camera = small_scenes.copies(), small_scenes.camera(0, size=SIZE)
    settings = csm.ShadowSettings(map_size=64, light_basis="transported")
    with csm.Director(scene, settings, renderer=shared) as director:
        for number in range(4):
            sun = csm.Sun((0.35 + 0.03 * number, 0.8, 0.5 - 0.02 * number))
            ours = shared.render(scene, camera, sun, settings, outputs=MASK)
            fresh = plain.render(scene, camera, sun, settings, outputs=MASK)
            assert np.array_equal(ours.mask, fresh.mask), number
            director.render(camera, csm.Sun((-0.4, 0.8, 0.1 * number)), outputs=MASK)


def test_what_time_is_saved_is_what_the_map_took(renderer, monkeypatch):
    scene, settings = small_scenes.soup(), csm.ShadowSettings(map_size=64, filter="vsm")
    camera = small_scenes.camera(0, size=SIZE)
    with csm.Director(scene, settings, renderer=renderer) as director:
        first = director.render(camera, SUN, outputs=MASK)
        second = director.render(camera, SUN, outputs=MASK)
    maps = [ms for name, ms in first.timings_ms.items() if name[-1].isdigit()]
    assert len(maps) == 12  # map, moments and blur of each
    assert second.info["director"]["ms_saved"] == pytest.approx(sum(maps))
    assert not [name for name in second.timings_ms if name[-1].isdigit()]


def test_animated_scene_is_drawn_anew(renderers):
    reusing, plain = renderers
    settings, camera = csm.ShadowSettings(map_size=64), small_scenes.camera(0, size=SIZE)
    moments = [small_scenes.soup(seed=seed) for seed in (1, 2, 1)]
    with csm.Director(moments[0], settings, renderer=reusing) as director:
        for scene in moments:
            frame = director.render(camera, SUN, scene=scene, outputs=MASK)
            fresh = plain.render(scene, camera, SUN, settings, outputs=MASK)
            assert frame.info["director"]["drawn"] == [0, 1, 2, 3]
            assert np.array_equal(frame.mask, fresh.mask)
        assert director.render(camera, SUN, outputs=MASK).info["director"]["kept"] == [0, 1, 2, 3]


def test_slow_walk_draws_few_maps_whole(renderer):
    """The case that must win: spheres on their lattice, a camera that walks and turns slowly."""
    scene = csm.scenes.town(5000)
    camera = next(iter(scene.cameras.values())).replace(size=SIZE)
    sun = next(iter(scene.suns.values()))
    for scroll in (False, True):
        settings = csm.ShadowSettings(map_size=512)
        with csm.Director(scene, settings, renderer=renderer, scroll=scroll) as director:
            director.render(camera, sun, outputs=MASK)
            drawn = 0
            for _ in range(20):
                camera = step(camera, forward=0.02, turn_deg=0.01)
                frame = director.render(camera, sun, outputs=MASK)
                drawn += sum(frame.info["triangles_drawn"])
            report = director.report()
        assert (report.maps["draw"] - 4) / 80 < (0.05 if scroll else 0.5)
        assert report.triangles_saved > (10 if scroll else 1) * drawn


def test_without_maps_there_is_nothing_to_save(renderer):
    with csm.Director(
        small_scenes.soup(), csm.ShadowSettings(filter="none"), renderer=renderer
    ) as director:
        frame = director.render(small_scenes.camera(0, size=SIZE), SUN, outputs=MASK)
        assert frame.info["director"]["actions"] == ()
        assert director.report().maps == dict.fromkeys(("draw", "keep", "add", "scroll"), 0)
        assert "0 maps" in str(director.report())


def test_director_says_what_is_wrong(renderer):
    scene, settings = small_scenes.soup(), csm.ShadowSettings()
    for error, text, arguments in (
        (TypeError, "scene must be a csm.Scene", {"scene": 1}),
        (TypeError, "settings must be a csm.ShadowSettings", {"settings": {}}),
        (ValueError, "settings are fixed.*max_error", {"settings": settings, "max_error": 0.1}),
        (ValueError, "max_error", {"max_error": 2.0}),
        (TypeError, "renderer must be a csm.Renderer", {"renderer": 3}),
        (TypeError, "scroll must be", {"scroll": "yes"}),
        (ValueError, "margin", {"margin": -1.0}),
        (ValueError, "patience", {"patience": -1}),
    ):
        with pytest.raises(error, match=text):
            csm.Director(**{"scene": scene, "renderer": renderer} | arguments)
    camera = small_scenes.camera(0, size=SIZE)
    with pytest.raises(ValueError, match="reuse must be one of never, same, scrolled"):
        renderer.render(scene, camera, SUN, reuse="always")
    director = csm.Director(scene, settings, renderer=renderer)
    with pytest.raises(TypeError, match="camera must be"):
        director.render(None, SUN)
    director.close()
    director.close()
    with pytest.raises(csm.ContextError, match="director is closed"):
        director.render(camera, SUN)


def test_director_closes_a_renderer_of_its_own(gl):
    with csm.Director(small_scenes.soup(), csm.ShadowSettings(map_size=32)) as director:
        director.render(small_scenes.camera(0, size=SIZE), SUN, outputs=MASK)
        own = director._renderer
    with pytest.raises(csm.ContextError, match="closed"):
        own.render(small_scenes.soup(), small_scenes.camera(0, size=SIZE), SUN)


# -- recommendations that it weighs ----------------------------------------------------------------


UNKNOWN = [
    {"filter": "vsm"},
    {"filter": "pcf", "filter_size": 33},
    {"pcss_map": "summed", "filter": "pcss"},
    {"bias": "manual", "caster_faces": "both"},
    {"bias": "manual", "caster_faces": "back", "slope_bias": 1.0},
    {"bias": "manual", "caster_faces": "back", "constant_bias_texels": -1.0},
    {"bias": "manual", "caster_faces": "back", "normal_offset_texels": 1.0},
    {"plane": "derivatives", "filter": "pcss", "bias": "auto", "caster_faces": "both"},
    {"depth_range": "manual", "manual_depth_range": (1.0, 2.0)},
    {"max_distance": 5.0},
    {"fade_width": 1.0},
    {"sun_step_deg": 1.0},
]


def test_forecast_of_what_was_recommended_is_its_own(renderer, boundary):
    scene, near, far, limit = boundary
    found = [csm.recommend(scene, one, BOX_SUN, max_error=limit, renderer=renderer)
             for one in (near, far)]  # fmt: skip
    for one in found:
        assert one.forecast(one.settings).error == one.expected_error
        assert one.forecast(one.settings).ms == one.expected_ms
        assert one.forecast(one.settings).met == one.met
    with pytest.raises(TypeError, match=r"others must be csm.Recommendation \(got 3\)"):
        found[0].meeting(3)
    both = found[0].meeting(found[1])
    assert all(one.forecast(both).met for one in found)
    assert not found[0].forecast(both.replace(map_size=16)).met
    with pytest.raises(TypeError, match="settings must be"):
        found[0].forecast(None)
    for changes in UNKNOWN:
        name = next(iter(changes))
        with pytest.raises(ValueError, match=f"settings.{name} must be .* to be forecast"):
            found[0].forecast(both.replace(**changes))
    # of hard edges neither says anything
    plain = both.replace(pcss_map="variance", kernel="world")
    assert found[0].forecast(plain) == found[0].forecast(both)
    found[0].forecast(both.replace(bias="manual", caster_faces="back"))
    read = csm.Recommendation.from_json(found[0].to_json())
    with pytest.raises(ValueError, match="read from a file forecasts no other settings"):
        read.forecast(both)
    missed = csm.recommend(scene, near, BOX_SUN, max_bytes=1, renderer=renderer)
    for one in (found[0], missed):
        with pytest.raises(ValueError, match="read from a file forecasts no other settings"):
            one.meeting(read)


# -- under a budget --------------------------------------------------------------------------------


def away(number):
    """Views of the box, far enough from one to the next for a look each."""
    return view(0.7 + 0.25 * number)


def renders_of_looks(renderer, monkeypatch, **goal):
    """How often each of four frames of a director rendered, its own frame with them."""
    renders, counts = [], []
    render = type(renderer).render

    def counted(self, *arguments, **more):
        renders.append(arguments)
        return render(self, *arguments, **more)

    monkeypatch.setattr(type(renderer), "render", counted)
    with csm.Director(csm.scenes.plane_and_box(), renderer=renderer, **goal) as director:
        for number in range(4):
            before = len(renders)
            frame = director.render(away(number), BOX_SUN, outputs=MASK)
            assert frame.info["director"]["decision"] is not None
            counts.append(len(renders) - before)
    return counts


def test_looks_under_a_budget_render_no_more_than_others(renderer, monkeypatch):
    free = renders_of_looks(renderer, monkeypatch)
    within = renders_of_looks(renderer, monkeypatch, budget_ms=1e6)
    assert within[1:] == free[1:]
    assert within[0] > free[0]  # the first times frames: nothing is known of this machine


def test_frames_tell_a_director_what_they_cost(renderer, monkeypatch):
    """Frames that begin to take ten times as long are over the budget at the next look."""
    slow = [1.0]
    timed = csm.director.frame_times

    def slowed(frame):
        return tuple(slow[0] * ms for ms in timed(frame))

    monkeypatch.setattr(csm.director, "frame_times", slowed)
    with csm.Director(csm.scenes.plane_and_box(), budget_ms=1e6, renderer=renderer) as director:
        for _ in range(3):
            director.render(away(0), BOX_SUN, outputs=MASK)
        costs = director.recommendation.cost_model
        assert costs.source == "frames timed here"
        slow[0] = 1e9
        director.render(away(0), BOX_SUN, outputs=MASK)
        director._times = director._times[-1:]  # the slow one
        rich = director.settings
        director.render(away(1), BOX_SUN, outputs=MASK)
        assert director.recommendation.cost_model.mask_pixel > 1e6 * costs.mask_pixel
        assert not director.recommendation.forecast(rich).met
        assert not director.recommendation.met


@pytest.mark.parametrize("budget", [1e6, 1e-3])
def test_under_a_budget_a_forecast_is_what_is_expected(renderer, budget):
    scene = csm.scenes.plane_and_box()
    found = csm.recommend(scene, view(1.0), BOX_SUN, budget_ms=budget, renderer=renderer)
    again = found.forecast(found.settings)
    assert again.ms == found.expected_ms
    assert again.error == found.expected_error
    assert again.met == found.met == (budget == 1e6)


def test_corrected_costs_are_those_that_were_timed(renderer):
    scene = csm.scenes.plane_and_box()
    found = csm.recommend(scene, view(1.0), BOX_SUN, renderer=renderer)
    told, settings, model = found.forecaster, found.settings, CostModel()
    times = [(3.0, 40.0), (5.0, 44.0), (90.0, 900.0)]
    maps, others = corrected(model, settings, told, times).parts(settings, told)
    assert (maps, others) == (pytest.approx(5.0), pytest.approx(44.0))  # the medians
    before = model.parts(settings, told)[0]
    kept = corrected(model, settings, told, [(None, 44.0)]).parts(settings, told)
    assert kept == (pytest.approx(before), pytest.approx(44.0))
    assert corrected(model, settings, told, []) is model
