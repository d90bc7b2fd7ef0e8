"""Only what a scene calls for: signals against closed forms, decisions, goals, their proof."""

import dataclasses
import importlib
import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import csm
from csm import cli, shapes, verification
from csm.decisions import TABLE
from csm.forecasts import DISC, Forecaster
from csm.plans import map_bytes
from csm.recommendation import Reasons
from csm.signals import measure_signals
from csm.situations import SMALLEST, Situation, wanted_format
from csm.verification import everything_on

SIZE = (320, 180)
NOON = csm.Sun((0, 1, 0))


def plane(half=20.0):
    """A ground and nothing on it."""
    return csm.Scene([shapes.mesh("ground", shapes.ground(half))])


def inside_out_room():
    """A closed box, to stand in: floor and walls see no sun through it."""
    return csm.Scene([shapes.mesh("room", shapes.box((-5, 0, -5), (5, 4, 5)))])


def view(eye=(6, 4.5, 8), target=(-0.5, 0.6, 0), **more):
    return csm.Camera.look_at(eye, target, fov_y_deg=45, far=100, size=SIZE, **more)


def on(found, effect):
    """The reason about an effect."""
    return next(reason for reason in found.reasons if reason.effect == effect)


@pytest.fixture(scope="module")
def box():
    return csm.scenes.plane_and_box()


# -- scenes that call for little -------------------------------------------------------------------


@pytest.mark.parametrize("diameter", [0.0, 0.53, 6.0])
def test_plain_at_noon_takes_one_small_hard_map(renderer, diameter):
    sun = csm.Sun(NOON.to_light, diameter)
    found = csm.recommend(plane(), view(), sun, renderer=renderer)
    assert (found.settings.cascade_count, found.settings.filter) == (1, "hard")
    assert found.settings.map_size == 256
    assert found.signals.edge_share == 0.0


def test_view_that_no_sun_reaches_takes_no_shadow_pass(renderer):
    below = csm.Sun((0.2, -1.0, 0.1))  # under the ground, which is seen from above
    found = csm.recommend(plane(), view(), below, renderer=renderer)
    assert found.settings.filter == "none"
    assert [reason.effect for reason in found.reasons] == ["shadows"]
    planned = csm.plan(found.settings, outputs=("mask",))
    assert not [step for step in planned.passes if "shadow_map" in step.name]
    assert not [texture for texture in planned.textures if "shadow" in texture.name]
    assert found.map_bytes == 0


def test_without_maps_nothing_is_fitted(renderer):
    """Not even where no maps could be: behind a camera, or too fine for so far from the origin."""
    flat = [[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 1.0]]
    scene = csm.Scene.from_arrays(flat, [[0, 2, 1]])
    behind = csm.Camera.orthographic((0, 5, 0), (0, 0, 0.1), height=4, near=-2, far=20, size=SIZE)
    far_out = np.array([4e5, 0.0, -7e5])
    point = csm.Scene.from_arrays(np.zeros((3, 3)) + far_out, [[0, 1, 2]])
    fine = csm.Camera.look_at((1e-6, 0, 0), (0, 0, 0), near=1e-10, far=1e-7, size=SIZE)
    below = [csm.Sun((0.1, -1.0, 0.1)), csm.Sun((0.2, -1.0, 0.1))]
    for where, camera in ((scene, behind), (point, fine.translated(far_out))):
        found = csm.recommend(where, camera, below, renderer=renderer)
        assert found.settings.filter == "none"
        assert (found.splits, found.texels) == ((), ())
        assert csm.Recommendation.from_json(found.to_json()) == found
        assert found.export("unity").settings["Light.shadows"].value == "LightShadows.None"
        assert str(found).startswith("no shadow maps")


@pytest.mark.parametrize("to_light", [(0, 1, 0), (0, 0, 1), (1, 0, 0), (0, -1, 0), (0.3, 1, 0.2)])
@pytest.mark.parametrize(
    "corners",
    [
        [[-1, -1, 0], [1, -1, 0], [0, 1, 0]],
        [[-1e-5, -1e-5, 0], [1e-5, -1e-5, 0], [0, 1e-5, 0]],
        [[-1e6, -1, 1e6], [1e6, -1, 1e6], [0, -1, -1e6]],
        [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
        [[0, 0, 0]] * 3,
        [[-1, 0, 0], [1, 1e-7, 0], [1, -1e-7, 0]],
    ],
    ids=["plain", "tiny", "huge", "line", "point", "sliver"],
)
def test_a_single_triangle_calls_for_little(renderer, corners, to_light):
    """Its own shadow falls on nothing: no maps, or, turned to the sun, one of the smallest."""
    scene = csm.Scene.from_arrays(corners, [[0, 1, 2]])
    camera = csm.Camera.look_at((0, 0, 3), (0, 0, 0), far=50.0, size=SIZE)
    settings = csm.recommend(scene, camera, csm.Sun(to_light), renderer=renderer).settings
    assert settings.filter == "none" or (settings.cascade_count, settings.map_size) == (1, 256)


def test_closed_interior_takes_one_small_map(renderer):
    camera = csm.Camera.look_at((0, 1.7, 3), (0, 1, -4), far=30, size=SIZE)
    found = csm.recommend(inside_out_room(), camera, csm.Sun((0.3, 1, 0.2)), renderer=renderer)
    assert found.signals.shadowed_share > 0.99
    # fine enough that the bias lights no strip of a wall; nothing beside everything on
    assert found.settings.cascade_count == 1
    assert found.settings.map_size <= 1024


def test_still_is_not_stabilised_and_a_path_is(renderer, box):
    sun = csm.Sun((1, 1, 0))
    still = csm.recommend(box, view(), sun, renderer=renderer)
    assert still.settings.snap == "none"
    assert not on(still, "snap").taken
    path = [view(eye=(6 + 0.05 * k, 4.5, 8)) for k in range(4)]
    moving = csm.recommend(box, path, sun, renderer=renderer)
    assert moving.settings.snap == "exact"
    assert not moving.settings.turned
    assert on(moving, "snap").taken
    views = moving.signals.views
    assert [one.camera for one in views] == [path[0], path[1], path[3]], "first, middle, last"


@pytest.mark.parametrize(
    ("elevation", "basis"), [(45, "world"), (22, "world"), (19, "orthonormal"), (5, "orthonormal")]
)
def test_the_grid_stands_still_under_a_moving_sun_that_is_high_enough(
    renderer, box, elevation, basis
):
    suns = [csm.Sun.from_compass(120 + k, elevation) for k in range(4)]
    assert csm.recommend(box, view(), suns, renderer=renderer).settings.light_basis == basis


def test_soft_shadows_need_a_disc_wider_than_a_pixel(renderer, box):
    chosen = {
        width: csm.recommend(box, view(), csm.Sun((1, 1, 0), width), renderer=renderer).settings
        for width in (0.0, 0.01, 4.0)
    }
    assert [one.filter for one in chosen.values()] == ["hard", "hard", "pcss"]


def test_sixteen_bits_only_where_their_step_is_below_the_bias(renderer, box):
    sun = csm.Sun((1, 1, 0))
    path = [view(), view().translated((0.1, 0.0, 0.0))]  # in motion nothing is warped
    near = csm.recommend(box, path, sun, renderer=renderer)
    assert near.settings.depth_format == "d16"
    tower = csm.Scene.merge(
        box, csm.Scene([shapes.mesh("far", shapes.box((9e4, 0, -50), (1e5, 9e3, 50)))])
    )
    far = csm.recommend(tower, path, sun, renderer=renderer)
    assert far.settings.depth_format == "d32f"


@pytest.mark.parametrize("slope", [0.1, 3.0])
def test_the_step_of_sixteen_bits_is_compared_with_a_quarter_texel_of_slope(slope):
    span = 0.25 * 0.01 * slope * 65535.0  # metres, over which that is one step
    at = SimpleNamespace(
        settings=csm.ShadowSettings(),
        signals=SimpleNamespace(depth_span=span, bias_slope=slope),
        finest_texel=lambda sizes, kernels: np.array([1.01, 0.99]) * 0.01,
    )
    assert wanted_format(at, [1000, 1020]) == ["d16", "d32f"]


# -- signals ---------------------------------------------------------------------------------------


def test_signals_of_a_box_are_those_of_its_geometry(renderer, box):
    sun = csm.Sun((1, 1, 0), 1.0)
    signals = measure_signals(renderer, box, [view()], [sun])
    seen = signals.views[0]
    # ground, top and the side to the sun all stand 45 degrees from it
    assert np.allclose(seen.slopes, 1.0, atol=1e-5)
    # the ends of the shadow are cast by the top, 2 m up along a ray of 45 degrees
    metres = seen.penumbra_metres().max()
    expected = 2.0 * math.tan(math.radians(0.5)) * 2.0 * math.sqrt(2.0)
    assert metres == pytest.approx(expected, rel=0.15)  # a coarse map's texel of depth
    assert signals.sun_elevation_deg == pytest.approx(45.0)
    assert not signals.orthographic
    assert signals.depth_shares.sum() == pytest.approx(1.0)
    depth = np.concatenate([one.receiver_depths for one in signals.views])
    assert signals.depth_edges[0] <= depth.min() <= depth.max() <= signals.depth_edges[-1] * 1.001
    truth = csm.truth(box, view(), sun)
    facing = truth.facing.sum() / truth.valid.sum()
    assert signals.facing_share == pytest.approx(facing, abs=0.02)  # pixels of a quarter
    shadowed = 1.0 - truth.mask_point[truth.facing].mean()
    assert signals.shadowed_share == pytest.approx(shadowed, abs=0.01)


def test_edge_length_is_that_of_the_full_picture(renderer, box):
    # no pixel's centre on the box's outline
    camera = box.cameras["map"].replace(half_height=5.53, size=(640, 360))
    signals = measure_signals(renderer, box, [camera], [csm.Sun((1, 1, 0))])
    # seen from above: 2 m by 2 m beside the box, whose top is lit
    seen = signals.views[0]
    length = signals.edge_share * seen.facing_count * signals.pixels / seen.pixel_count
    assert length == pytest.approx(4 * 2 * 180 / 5.53, rel=0.15)  # corners: a coarse pixel each


def test_disc_coefficient_is_the_integral_of_a_covered_disc():
    # share of a disc beyond a line at x, against a step, over the penumbra's width
    x = (np.arange(20000) + 0.5) / 20000
    covered = (np.arccos(x) - x * np.sqrt(1 - x * x)) / np.pi
    assert covered.mean() == pytest.approx(DISC, rel=1e-4)


@pytest.mark.parametrize("size", [128, 512])
def test_forecast_is_near_what_is_traced(renderer, size):
    scene, sun = csm.scenes.stairs(12), csm.Sun.from_compass(285, 32)
    camera = scene.cameras["side"].replace(size=(640, 360))
    settings = csm.ShadowSettings(map_size=size, cascade_count=2, fit="visible", snap="none")
    signals = measure_signals(renderer, scene, [camera], [sun])
    forecast = Forecaster(signals, scene).error(settings)
    frame = renderer.render(scene, camera, sun, settings)
    error = csm.compare(frame, csm.truth(scene, camera, sun)).disagreement
    # thin balusters, a quarter of the picture: a factor of two either way
    assert 0.5 * error < forecast < 2.0 * error


# -- goals -----------------------------------------------------------------------------------------


def test_looser_errors_are_cheaper_and_both_are_reached(renderer):
    scene = csm.scenes.stairs(12)
    camera = scene.cameras["side"].replace(size=SIZE)
    sun = csm.Sun.from_compass(285, 32)
    fine, loose = (
        csm.recommend(scene, camera, sun, max_error=error, renderer=renderer)
        for error in (0.002, 0.02)
    )
    assert fine.met
    assert loose.met
    assert fine.expected_error <= 0.002 < loose.expected_error <= 0.02
    assert loose.expected_ms < fine.expected_ms
    assert loose.map_bytes < fine.map_bytes


def test_unreachable_error_gives_the_nearest_and_names_the_effect(renderer, box):
    found = csm.recommend(
        box, view(), csm.Sun((1, 1, 0)), max_error=0.0, max_bytes=1 << 20, renderer=renderer
    )
    assert not found.met
    assert "map_size" in found.obstacle
    assert "max_bytes" in found.obstacle
    assert found.map_bytes <= 1 << 20
    assert found.obstacle in str(found)
    roomier = csm.recommend(
        box, view(), csm.Sun((1, 1, 0)), max_error=0.0, max_bytes=1 << 24, renderer=renderer
    )
    assert roomier.expected_error < found.expected_error


def test_budget_buys_accuracy(renderer, box):
    sun = csm.Sun((1, 1, 0))
    rich = csm.recommend(box, view(), sun, budget_ms=1e6, renderer=renderer)
    assert rich.met
    poor = csm.recommend(box, view(), sun, budget_ms=1e-3, renderer=renderer)
    assert not poor.met
    assert poor.obstacle.split(":")[0] in ("map_size", "filter")
    assert poor.obstacle.endswith("of 0.001 ms")
    assert rich.expected_error < poor.expected_error
    assert poor.map_bytes < rich.map_bytes


def test_knee_beyond_the_bytes_is_not_met(renderer):
    scene = csm.scenes.town(5000)
    where = scene, scene.cameras["street"].replace(size=(160, 90)), scene.suns["noon"]
    wide = csm.recommend(*where, renderer=renderer)
    assert wide.met
    found = csm.recommend(*where, max_bytes=2**17, renderer=renderer)
    assert not found.met
    assert "max_bytes" in found.obstacle
    for one in (wide, found):
        assert one.forecast(one.settings).met == one.met


@pytest.mark.parametrize("goal", [{}, {"max_error": 0.0}, {"budget_ms": 1e-3}, {"budget_ms": 1e6}])
def test_bytes_that_hold_no_map_give_the_smallest_and_say_so(renderer, box, goal):
    found = csm.recommend(
        box, view(), csm.Sun((1, 1, 0)), max_bytes=1000, **goal, renderer=renderer
    )
    assert not found.met
    assert found.settings.cascade_count == 1
    assert found.map_bytes == SMALLEST**2 * {"d16": 2, "d32f": 4}[found.settings.depth_format]
    assert found.obstacle.startswith("map_size: ")
    assert f"{found.map_bytes} bytes, max_bytes is 1000" in found.obstacle
    assert not found.forecast(found.settings).met


@pytest.mark.parametrize(
    ("most", "effect"),
    [
        (1000, "map_size"),
        (131_071, "map_size"),
        (131_072, "depth_format"),
        (262_143, "depth_format"),
    ],
)
def test_where_16_bits_would_fit_the_format_is_in_the_way(renderer, box, most, effect):
    found = csm.recommend(box, view(), NOON, max_bytes=most, renderer=renderer)
    assert found.settings.depth_format == "d32f"
    assert found.map_bytes == 262_144
    assert found.obstacle.startswith(f"{effect}: ")


def test_no_maps_are_within_any_bytes(renderer, box):
    dark = csm.recommend(box, view(), csm.Sun((0, -1, 0)), max_bytes=1, renderer=renderer)
    assert dark.met
    assert dark.map_bytes == 0


@pytest.mark.parametrize("size", [(1, 1), (1, 50), (300, 1)])
def test_picture_of_one_row_or_column(renderer, box, size):
    camera = view().replace(size=size)
    found = csm.recommend(box, camera, csm.Sun((1, 1, 0)), renderer=renderer)
    assert found.settings.cascade_count >= 1


def test_orthographic_camera_whose_range_begins_behind_it(renderer, box):
    camera = box.cameras["map"].replace(size=(96, 54), near=-10.0)
    found = csm.recommend(box, camera, csm.Sun((1, 1, 0.3)), renderer=renderer)
    assert found.settings.split == "uniform"
    assert on(found, "split").flipped is None
    ahead = csm.recommend(box, camera.replace(near=1.0), csm.Sun((1, 1, 0.3)), renderer=renderer)
    assert found.expected_error == pytest.approx(ahead.expected_error, rel=0.5)
    proof = found.verify(renderer=renderer, repeats=1)
    assert proof.recommended.error <= proof.everything_on.error + 5e-3


def test_what_was_rendered_before_does_not_count(renderer, box):
    sun = csm.Sun((1, 1, 0.3))
    first = csm.recommend(box, view(), sun, renderer=renderer)
    settings = csm.ShadowSettings(map_size=64, light_basis="transported")
    before = renderer.render(box, view(), sun, settings, outputs=("mask",))
    assert csm.recommend(box, view(), sun, renderer=renderer).to_dict() == first.to_dict()
    after = renderer.render(box, view(), sun, settings, outputs=("mask",))
    assert np.array_equal(before.mask, after.mask)


def test_a_recommendation_is_no_step_of_a_walk(renderer, plain_renderer):
    """Here the rounded range would hold what it was at a camera 0.4 m further off."""
    scene = plane()
    far, near = (view(eye=(6 + 0.02 * k, 4.5, 8)) for k in (-40, -60))
    fresh = csm.recommend(scene, near, NOON, renderer=plain_renderer)
    csm.recommend(scene, far, NOON, renderer=renderer)
    assert csm.recommend(scene, near, NOON, renderer=renderer).to_dict() == fresh.to_dict()


def test_same_input_same_answer(renderer, box):
    one, other = (
        csm.recommend(box, view(), csm.Sun((1, 1, 0), 0.53), renderer=renderer) for _ in range(2)
    )
    assert one.settings == other.settings
    assert one.to_dict() == other.to_dict()
    assert str(one) == str(other)


@pytest.mark.parametrize(
    ("changes", "error", "match"),
    [
        ({"max_error": -0.1}, ValueError, "max_error"),
        ({"max_error": "small"}, TypeError, "max_error"),
        ({"budget_ms": 0.0}, ValueError, "budget_ms"),
        ({"max_bytes": 0}, ValueError, "max_bytes"),
        ({"camera": 3}, TypeError, "camera must be a csm.Camera"),
        ({"camera": "street"}, TypeError, "sequence of them .got 'street'"),
        ({"sun": []}, TypeError, "sun must be a csm.Sun"),
        ({"scene": None}, TypeError, "scene"),
        (
            {"camera": [view(), view()], "sun": [NOON] * 3},
            ValueError,
            "camera and sun must be as many",
        ),
    ],
)
def test_wrong_arguments_are_named(renderer, box, changes, error, match):
    arguments = {"scene": box, "camera": view(), "sun": NOON, "renderer": renderer, **changes}
    with pytest.raises(error, match=match):
        csm.recommend(**arguments)


# -- reasons and their proof -----------------------------------------------------------------------


def test_table_has_one_row_an_effect():
    names = [row.effect for row in TABLE]
    assert len(names) == len(set(names))
    fields = csm.ShadowSettings().to_dict()
    assert all(name in fields or name == "shadows" for name in names)
    assert {"cascade_count", "map_size", "split", "fit", "select", "filter", "bias", "blend"} < set(
        names
    )
    assert {"snap", "cull", "storage", "depth_format"} < set(names)
    for row in TABLE:
        assert row.calls_for
        assert row.threshold
        assert row.source
        assert row.cost


def test_reasons_with_maps_of_many_sizes_are_no_wider(renderer):
    scene = csm.scenes.SCENES["stairs"]()
    camera, sun = next(iter(scene.cameras.values())), next(iter(scene.suns.values()))
    found = csm.recommend(scene, camera.replace(size=SIZE), sun, renderer=renderer)
    sides = tuple(range(1024, 1024 + 16 * 6, 16))
    reasons = Reasons(
        dataclasses.replace(one, value=sides) if one.effect == "map_size" else one
        for one in found.reasons
    )
    assert max(map(len, str(reasons).splitlines())) <= 120


def test_reasons_say_what_was_measured(renderer, box):
    found = csm.recommend(box, view(), csm.Sun((1, 1, 0)), renderer=renderer)
    assert [reason.effect for reason in found.reasons] == [row.effect for row in TABLE]
    text = str(found.reasons)
    lines = text.splitlines()
    assert len([line for line in lines if not line.startswith(" ")]) == len(TABLE) + 1
    assert max(map(len, lines)) <= 120
    column = slice(lines[0].index("measured"), lines[0].index("threshold"))
    measured = " ".join(line[column].strip() for line in lines)
    assert all(reason.measured in measured for reason in found.reasons)
    assert "<table>" in found._repr_html_()
    assert found._repr_html_().count("<tr>") == len(TABLE) + 1
    restored = json.loads(json.dumps(found.to_dict()))
    assert csm.ShadowSettings(**restored["settings"]) == found.settings
    for reason in found.reasons:  # a decision turned round is another decision
        if reason.flipped is not None:
            assert reason.flipped.canonical() != found.settings.canonical()
    absent = {reason.effect for reason in found.reasons if reason.flipped is None}
    several = found.settings.cascade_count > 1
    assert "tap_count" in absent
    assert ("blend" in absent) == ("select" in absent) == (not several)


@pytest.mark.parametrize(
    ("changes", "nothing"),
    [
        ({"turned": True, "snap": "none"}, {"snap", "light_basis", "tap_count"}),
        ({"select": "interval"}, {"cull", "tap_count"}),
        ({"cascade_count": 1}, {"blend", "cull", "select", "split", "tap_count"}),
        ({"cascade_count": 1, "fit": "sphere"}, {"blend", "cull", "select", "tap_count", "turned"}),
    ],
)
def test_what_would_draw_the_same_is_not_turned(renderer, box, changes, nothing):
    signals = measure_signals(renderer, box, [view()], [csm.Sun((1, 1, 0))])
    settings = csm.ShadowSettings(**{"fit": "visible", "map_size": 256, **changes})
    at = Situation(signals, Forecaster(signals, box), settings)
    reasons = [row.reason(at) for row in TABLE]
    assert {one.effect for one in reasons if one.flipped is None} == nothing


@pytest.mark.parametrize("changes", [{"select": "interval"}, {"split": "sdsm"}])
def test_one_map_is_neither_selected_nor_split(renderer, box, changes):
    settings = csm.ShadowSettings(cascade_count=1, fit="visible", map_size=128, snap="none")
    masks = [
        renderer.render(box, view(), csm.Sun((1, 1, 0)), one, outputs=("mask",)).mask
        for one in (settings, settings.replace(**changes))
    ]
    assert np.array_equal(*masks)
    assert masks[0].min() < 0.5


def test_verification_does_not_count_what_it_could_not_turn(renderer, box):
    found = csm.recommend(box, view(), csm.Sun((1, 1, 0)), renderer=renderer)
    same = found.settings.replace(tap_count=5)  # of a hard filter: the same settings, said anew
    assert same != found.settings
    shadows, taps = on(found, "shadows"), on(found, "tap_count")
    untold = dataclasses.replace(taps, flipped=same)
    found = dataclasses.replace(found, reasons=Reasons([shadows, taps, untold]))
    proof = found.verify(renderer=renderer, repeats=1)
    assert [row.name for row in proof.decisions] == ["shadows"]
    assert [row.confirmed for row in proof.unturned] == [None, None]
    assert all(row.error == proof.recommended.error for row in proof.unturned)
    assert proof.confirmed_share == 1.0
    assert str(proof).count("nothing to turn") == 2
    assert [row["confirmed"] for row in proof.to_dict()["rows"][2:]] == [True, None, None]


@pytest.mark.slow
def test_verification_turns_every_decision_round(renderer, box):
    sun = csm.Sun((1, 1, 0))
    found = csm.recommend(box, view(), sun, renderer=renderer)
    proof = found.verify(renderer=renderer, repeats=1)
    assert proof.everything_on.settings == everything_on(sun)
    assert proof.recommended.settings == found.settings
    turned = [reason.effect for reason in found.reasons if reason.flipped is not None]
    assert [row.name for row in proof.decisions] == turned
    assert {row.name for row in proof.unturned} == {row.effect for row in TABLE} - set(turned)
    by_name = {row.name: row for row in proof.decisions}
    truth = csm.truth(box, view(), sun)
    unshadowed = 1.0 - truth.mask[truth.facing].mean()
    assert by_name["shadows"].error == pytest.approx(unshadowed, abs=1e-6)
    for name in ("shadows", "fit"):
        assert by_name[name].taken
        assert by_name[name].confirmed
        assert by_name[name].error > 1.01 * proof.recommended.error
    assert by_name["depth_format"].bytes > proof.recommended.bytes
    assert by_name["warp"].settings.warp == "lispsm"
    assert proof.confirmed_share == np.mean([row.confirmed for row in proof.decisions])
    assert json.loads(json.dumps(proof.to_dict()))["rows"][1]["error"] == proof.recommended.error
    assert len(str(proof).splitlines()) == len(found.reasons) + 3


def test_tables_leave_out_what_could_not_be_turned(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[1] / "benchmarks"))
    tables = importlib.import_module("recommend_tables")

    def row(effect, confirmed, error=0.1):
        return {
            "effect": effect, "taken": False, "confirmed": confirmed, "strict": confirmed,
            "error": error, "why": f"{error:g}",
        }  # fmt: skip

    rows = [row("blend", None), row("snap", True), row("snap", False), row("snap", None)]
    line = {
        "rows": rows, "ms": 1.0, "full_ms": 2.0, "analysis_ms": 1.0, "frame_ms": 1.0,
        "whole_frame_ms": 0.25,
        "error": 0.1, "full_error": 0.1, "dark": True, "settings": {},
        "forecast": 0.1, "full_forecast": 0.1,
    }  # fmt: skip
    other = {**line, "rows": [], "ms": 0.5}
    runs = {"one": {"a": line}, "two": {"a": other, "b": {**other, "error": 0.2}}}
    told = "\n".join(tables.goals_table(runs))
    assert "| 1 of 2, 50.0%;" in told
    assert "`render` gives by default | 0 of 1; median 4.0, at most 4.0; 1 ms beside" in told
    assert "of which the mask alone comes back | 1 of 1; median 1.0" in told
    assert "| 0.50, quartiles 0.50 and 0.50, at most 0.50 | 0.25, quartiles" in told
    assert "of everything on | 1 of 1 | 1 of 2 |" in told
    (missed,) = tables.elsewhere(runs)
    assert missed.startswith("- two: b (")
    assert "a (" not in missed
    assert "| 1/2 |" in tables.cases_table({"a": line})[-1]
    assert tables.effects_table({"a": line})[2:] == [
        "| blend | 0 of 1 | 0 of 1 | 0 of 0 | 0 of 0 |",
        "| snap | 0 of 3 | 2 of 3 | 1 of 2 | 1 of 2 |",
    ]
    assert tables.refuted_list({"a": line}) == ["- `snap`, 1: a (0.1)"]
    lines = {
        name: {**line, "rows": [row("snap", False, error)]}
        for name, error in (("a", 0.09), ("b", 0.05), ("c", 0.08), ("d", 0.2))
    }
    gains_most_first = "- `snap`, 4: b (0.05); c (0.08); a (0.09); and 1 more"
    assert tables.refuted_list(lines) == [gains_most_first]


def test_verification_refutes_a_wrong_decision(renderer, box):
    # shadows of a large sun under a hard filter: adding the soft one must show
    found = csm.recommend(box, view(), csm.Sun((1, 1, 0), 6.0), max_error=0.9, renderer=renderer)
    assert found.settings.filter == "hard"  # the cheapest within nine tenths
    found = dataclasses.replace(found, reasons=Reasons([on(found, "filter")]))
    proof = found.verify(renderer=renderer, rays_per_pixel=16, repeats=1)
    (row,) = proof.decisions
    assert not row.taken
    assert not row.confirmed
    assert row.error < proof.recommended.error


def test_flicker_judges_stabilisation_on_a_path(renderer, box):
    path = [view(eye=(6 + 0.031 * k, 4.5 + 0.017 * k, 8)) for k in range(5)]
    found = csm.recommend(box, path, csm.Sun((1, 0.8, 0.3)), max_error=0.01, renderer=renderer)
    found = dataclasses.replace(found, reasons=Reasons([on(found, "snap")]))
    proof = found.verify(renderer=renderer, repeats=1)
    (row,) = proof.decisions
    assert row.confirmed
    assert row.flicker > proof.recommended.flicker


@pytest.mark.parametrize(
    ("make", "camera", "sun"),
    [
        (lambda: csm.scenes.town(8000), "street", "noon"),
        (csm.scenes.stairs, "foot", "across"),
        (csm.scenes.plane_and_box, "contact", "diagonal"),
    ],
    ids=["town", "stairs", "box"],
)
def test_recommendation_is_near_everything_on(renderer, make, camera, sun):
    scene = make()
    sun = csm.Sun(scene.suns[sun].to_light)
    # four times the pixels of the other tests: of those, 0.05 % are eighteen
    camera = scene.cameras[camera].replace(size=(640, 360))
    truth = csm.truth(scene, camera, sun)
    found = csm.recommend(scene, camera, sun, renderer=renderer)
    ours, full = (
        csm.compare(renderer.render(scene, camera, sun, settings), truth).disagreement
        for settings in (found.settings, everything_on(sun))
    )
    assert ours <= max(1.05 * full, full + 5e-4)
    assert map_bytes(found.settings) < 0.5 * map_bytes(everything_on(sun))


def test_the_headline_has_every_size(renderer, box):
    found = csm.recommend(box, view(), csm.Sun((1, 1, 0)), renderer=renderer)
    settings = csm.ShadowSettings(cascade_count=3, map_size=(2880, 1152, 512), storage="atlas")
    for changed, said in (
        (settings, "2880² + 1152² + 512² D32F, hard"),
        (settings.replace(map_size=512), "3 x 512² D32F, hard"),
    ):
        assert str(dataclasses.replace(found, settings=changed)).startswith(said)


# -- the command -----------------------------------------------------------------------------------


def test_command_prints_the_table(capsys):
    words = ["recommend", "plane_and_box", "--sun", "diagonal", "--size", "160x90", "--quiet"]
    assert cli.main(words) == 0
    told = capsys.readouterr().out
    assert "cascade_count" in told
    assert cli.main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert csm.ShadowSettings(**told["settings"]).snap == "none"
    assert cli.main([*words, "--max-error", "0", "--max-bytes", "300000"]) == 1
    assert "goal not met" in capsys.readouterr().out
    assert cli.main([*words, "--max-error", "2"]) == 2
    assert "max_error" in capsys.readouterr().err


def row_of(taken, error):
    return verification.Row(
        "warp", taken, csm.ShadowSettings(), error=error, flicker=float("nan"), ms=9.0,
        ms_least=9.0, bytes=1000, triangles=50, maps_ms=8.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("taken", "change", "held", "strictly"),
    [
        (True, 0.011, True, True),
        (True, 0.009, False, False),
        (True, -0.011, False, False),
        (False, 0.009, True, True),
        (False, -0.009, True, True),
        (False, 0.011, True, False),  # it makes the picture worse: left out with reason
        (False, -0.011, False, False),
    ],
)
def test_what_matters_is_a_hundredth_of_the_error(taken, change, held, strictly):
    class Reason:
        effect, saves = "warp", False

    Reason.taken = taken
    ours, other = row_of(taken, 0.02), row_of(taken, 0.02 * (1.0 + change))
    assert verification._verdict(Reason, ours, other, False)[:2] == (held, strictly)


def test_what_is_taken_to_save_must_save():
    plain = row_of(True, 0.01)

    class Reason:
        effect, taken, saves = "cull", True, True

    def verdict(**other):
        return verification._verdict(Reason, plain, dataclasses.replace(plain, **other), False)

    assert verdict() == (False, False, "saves nothing; error +0.0% without")
    assert not verdict(maps_ms=8.2)[0], "within what times differ by anyway"
    assert verdict(maps_ms=8.5)[0], "beyond it"
    assert verdict(maps_ms=16.0) == (True, True, "saves 50% of the maps' time; error +0.0% without")
    assert verdict(triangles=51)[2].startswith("saves 1 triangles")
    assert verdict(bytes=2_001_000)[2].startswith("saves 2.0 MB")
    assert not verdict(bytes=2000, error=0.009)[0], "it costs a tenth of the error"
