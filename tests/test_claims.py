"""The claims of the sources: verdicts say what planted numbers say, the page says what was
measured, and what costs little is measured again (benchmarks/claims.py)."""

import dataclasses
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import csm

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "benchmarks"))

import claim_filters  # noqa: E402
import claim_measures  # noqa: E402
import claim_page  # noqa: E402
import claim_times  # noqa: E402
import claim_verdicts  # noqa: E402
import claim_views  # noqa: E402
import claims  # noqa: E402
from claim_table import BETTER, CLAIMS  # noqa: E402
from claim_verdicts import (  # noqa: E402
    DEPENDS,
    FAILS,
    HOLDS,
    NOT_REPRODUCED,
    OPEN,
    REPRODUCED,
    UNDECIDED,
)

DOCS = ROOT / "docs"
MEASURED = sorted(DOCS.glob("claims_measured*.json"))
BY_ID = {claim.id: claim for claim in CLAIMS}
TINY = (96, 64)


def planted(group, values):
    return [claim_verdicts.Case(f"case {i}", group, v) for i, v in enumerate(values)]


def inside_and_outside(rule):
    """Six values each of what a rule states and of what it does not."""
    if math.isinf(rule.high):
        inside, outside = rule.low * 1.2 + 0.01, rule.low * 0.5 - 0.01
    elif rule.low <= 0.0:
        inside, outside = rule.high * 0.5, rule.high * 2.0
    else:
        inside, outside = 0.5 * (rule.low + rule.high), rule.high * 2.0
    spread = np.linspace(0.99, 1.01, 6)
    return inside * spread, outside * spread


def astride(rule):
    """Values about the one bound that a rule has, or its upper one."""
    bound = rule.low if math.isinf(rule.high) else rule.high
    return bound * np.array([0.6, 0.8, 0.9, 1.1, 1.2, 1.4])


# -- verdicts --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BY_ID)
def test_every_claim_can_get_every_verdict(name):
    rule = BY_ID[name].rule
    inside, outside = inside_and_outside(rule)

    def verdict(*groups):
        cases = [case for i, values in enumerate(groups) for case in planted(f"group {i}", values)]
        return claim_verdicts.judge(cases, rule)

    assert verdict(inside).text == verdict(inside, inside).text == REPRODUCED
    assert verdict(outside).text == verdict(outside, outside).text == NOT_REPRODUCED
    mixed = verdict(inside, outside)
    assert mixed.text == DEPENDS
    assert mixed.those(HOLDS) == ["group 0"]
    assert mixed.those(FAILS) == ["group 1"]
    assert claim_verdicts.condition(mixed) == "Holds: group 0. Fails: group 1"
    alone = verdict(astride(rule))
    assert alone.text == UNDECIDED
    assert alone.groups[0].status == OPEN
    assert claim_verdicts.condition(alone) == ""
    both = verdict(outside, astride(rule))
    assert both.text == NOT_REPRODUCED, "it holds nowhere"
    said = "Fails: group 0. Differs from case to case: group 1"
    assert claim_verdicts.condition(both) == said
    assert verdict(inside, astride(rule)).text == DEPENDS


def test_five_cases_say_nothing():
    """Chance makes five of one sign in one of sixteen."""
    few, enough = planted("few", [0.5] * 5), planted("enough", [0.5] * 6)
    verdict = claim_verdicts.judge([*few, *enough], BETTER)
    assert [group.status for group in verdict.groups] == [OPEN, HOLDS]
    assert claim_verdicts.condition(verdict) == "Holds: enough. Too few cases to tell: few"


def test_a_tie_is_no_win():
    """Errors that differ by less than a twentieth do not beat each other."""
    tied = np.linspace(0.97, 1.03, 8)
    assert claim_verdicts.judge(planted("tied", tied), BETTER).text == NOT_REPRODUCED


def test_the_interval_decides_and_not_the_mean():
    wide = [0.2, 0.3, 1.4, 1.5, 0.9, 0.66]  # geometric mean 0.66
    (group,) = claim_verdicts.judge(planted("wide", wide), BETTER).groups
    assert group.mean < 0.95 < group.interval[1]
    assert group.status == OPEN


def test_means_of_ratios_are_geometric_and_of_differences_not():
    values = [0.25, 4.0, 1.0]
    ratio, difference = (
        claim_verdicts.judge(planted("g", values), claim_verdicts.Rule(0, 9, kind)).groups[0]
        for kind in ("ratio", "difference")
    )
    assert ratio.mean == pytest.approx(1.0)
    assert difference.mean == pytest.approx(1.75)


def test_a_range_is_asked_of_every_case():
    rule = claim_verdicts.Rule(2.0, 4.0, "range")
    centred = [1.0] * 3 + [5.0] * 3  # the mean lies within, and no case does
    assert claim_verdicts.judge(planted("g", centred), rule).text == NOT_REPRODUCED
    assert claim_verdicts.judge(planted("g", [3.0] * 5 + [9.0]), rule).text == REPRODUCED


@pytest.mark.parametrize("value", [math.nan, math.inf, 0.0, -1.0])
def test_a_measure_that_fails_is_not_left_out(value):
    with pytest.raises(ValueError, match="case 1"):
        claim_verdicts.judge(planted("g", [0.5, value, 0.5]), BETTER)
    with pytest.raises(ValueError, match="no case"):
        claim_verdicts.judge([], BETTER)


# -- the page --------------------------------------------------------------------------------------


def read():
    return [json.loads(path.read_text(encoding="utf-8")) for path in MEASURED]


def test_page_is_made_of_what_was_measured():
    assert MEASURED[0].name == "claims_measured.json"
    written = (DOCS / "claims.md").read_text(encoding="utf-8")
    assert written == claim_page.page(CLAIMS, read()), (
        "run: python benchmarks/claims.py "
        "--from docs/claims_measured*.json --markdown docs/claims.md"
    )


def test_page_has_every_claim_with_its_verdict():
    first = read()[0]
    assert list(first["claims"]) == list(BY_ID)
    lines = claim_page.overview(CLAIMS, [first]).splitlines()[2:]
    for claim, line in zip(CLAIMS, lines, strict=True):
        verdict = claim_page.verdict_of(first, claim)
        assert f"**{verdict.text}**" in line
        statuses = {group.status for group in verdict.groups}
        assert (len(statuses) > 1) == bool(claim_verdicts.condition(verdict))
        assert claim.source in line


def test_every_scene_that_a_case_is_of_is_named():
    """But for the suns over the sky, which are over no scene."""
    for one in read():
        cases = [case["name"] for rows in one["claims"].values() for case in rows]
        of_scenes = {name.split(" ")[0].rstrip(",") for name in cases if "°, sun" not in name}
        assert of_scenes <= set(one["scenes"])


def test_page_follows_the_numbers():
    """Other numbers, another verdict; a second machine, another column; what is absent is said."""
    claim, first = BY_ID["blend-both"], read()[0]
    rows = first["claims"][claim.id]
    other = {
        **first,
        "label": "planted",
        "claims": {claim.id: [{**row, "value": 1.4} for row in rows]},
    }
    overview = claim_page.overview(CLAIMS, [first, other])
    assert "| planted |" in overview.splitlines()[0]
    (line,) = (one for one in overview.splitlines() if f"#{claim.id})" in one)
    assert line.split("|")[4].strip() == f"**{REPRODUCED}**"
    (line,) = (one for one in overview.splitlines() if "#blend-branching)" in one)
    assert line.split("|")[4].strip() == "not measured"


def test_medians_are_taken_place_by_place():
    rows = [
        {"times": [1.0, 2.0], "by": {"x": 3.0}, "known": None},
        {"times": [5.0, 0.0], "by": {"x": 4.0}, "known": 7.0},
        {"times": [3.0, 1.0], "by": {"x": 5.0}, "known": None},
    ]
    cases = [claim_verdicts.Case("c", "g", 1.0, row) for row in rows]
    measured = {"claims": {"seams": [dataclasses.asdict(case) for case in cases]}}
    shown = claim_page.details(BY_ID["seams"], measured)
    assert shown == "- g. times: 3 / 1; by: x 4; known: 7\n"
    assert claim_page.plain(claim_page.middle([None, None])) == "none"


def test_written_json_reads_as_it_was():
    cases = planted("a | group", [0.123456789, 2.0])
    found = {"label": "here", "size": [4, 2], "scenes": ["x"], "machine": {"driver": "d"},
             "claims": {"one": [dataclasses.asdict(case) for case in cases]}}  # fmt: skip
    again = json.loads(claims.to_json(found))
    assert again["claims"]["one"][0]["value"] == 0.123457
    assert again["claims"]["one"][1] == found["claims"]["one"][1]
    assert {k: v for k, v in again.items() if k != "claims"} == {
        k: v for k, v in found.items() if k != "claims"
    }


def test_parts_measured_one_by_one_make_one_file():
    stamp = {"driver": "d", "machine": "m", "commit": "c", "clock": "k", "load": "1", "date": "1",
             "command": "one"}  # fmt: skip
    one = {
        "label": "a",
        "size": [4, 2],
        "scenes": ["x"],
        "machine": stamp,
        "claims": {"seams": [1]},
    }
    now = {**stamp, "load": "2", "command": "two"}
    other = {**one, "machine": now, "claims": {"splits-uniform": [2]}}
    both = claims.joined(one, other)
    assert list(both["claims"]) == ["splits-uniform", "seams"], "in the table's order"
    assert both["machine"]["load"] == "1; 2"
    again = claims.joined(both, {**one, "claims": {"seams": [3]}})
    assert again["claims"]["seams"] == [3]
    for name in ("driver", "commit"):
        with pytest.raises(SystemExit, match=name):
            claims.joined(one, {**other, "machine": {**now, name: "else"}})
    with pytest.raises(SystemExit, match="scenes"):
        claims.joined(one, {**other, "scenes": ["y"]})


# -- measured again --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bench():
    with csm.Renderer() as renderer:
        yield claim_views.Bench(renderer, only=("plane_and_box", "stairs"), size=TINY)


def groups_of(name, measured):
    return {g.name: g for g in claim_verdicts.judge(measured, BY_ID[name].rule).groups}


def test_areas_again(bench):
    """Geometry alone is the same on every machine: the checked-in suns come out to the digit."""
    again = {(c.name, c.group): c.value for c in claim_measures.stabilisation_area(bench)}
    kept = read()[0]["claims"]["stabilisation-area"]
    suns = {(c["name"], c["group"]): c["value"] for c in kept if "°, sun " in c["name"]}
    assert len(suns) == 2 * len(claim_measures.FOVS) * claim_measures.SUNS
    for key, value in suns.items():
        assert again[key] == pytest.approx(value, rel=1e-5)


def test_areas_of_a_slice_seen_end_on(bench):
    """Light along a square view: a sphere's square over the far end's box has a closed form."""
    camera = csm.Camera.look_at(
        (0, 9, 0), (0, 0, 0), (0, 0, -1), fov_y_deg=60, near=1, far=9, size=(64, 64)
    )
    sun = csm.Sun((0, 1, 0))
    ratio = (
        claim_measures.window_areas(camera, sun, fit="sphere")[-1]
        / (claim_measures.turned_areas(camera, sun)[-1])
    )
    k2 = 2 * math.tan(math.radians(30)) ** 2  # squared slope of a corner ray
    splits = csm.fit_cascades(camera, sun, csm.ShadowSettings(view_range="camera")).splits
    near, far = splits[-2:]
    assert k2 * (far + near) >= far - near, "the sphere is centred on the far end"
    # 4 k² f² over (2 tan 30° f)²; windows have a margin of a texel or two of 2048
    assert ratio == pytest.approx(2.0, rel=0.01)


def test_a_range_that_is_cut_shorter_than_34_prefers_three():
    """The condition of more-cascades is where texels of equal ratios are equally fine."""
    deep = claim_measures.DEEP
    assert deep ** (1 / 5) / 640 == pytest.approx(deep ** (1 / 3) / 1024)


def test_quanta_again(bench):
    """Planted: a floor that faces the sun needs half a quantum; the box's scene does not."""
    cases = claim_filters.sixteen_bits(bench)
    assert {case.value for case in cases if case.numbers["flat share"] == 0.0} == {0.0}
    view = bench.views[0].replace("overhead", sun=csm.Sun((0.02, 1, 0.01)))
    facing = claim_views.Bench(bench.renderer, only=("plane_and_box",), size=TINY)
    facing.views = [view]
    needed = {case.name: case for case in claim_filters.sixteen_bits(facing)}
    case = needed[f"{view.name}, range 16 times the scene's"]
    assert case.numbers["flat share"] > 0.5
    assert 0.25 <= case.value <= 0.5, case.numbers["acne"]


def test_seams_again(bench):
    cases = claim_filters.seams(
        claim_views.Bench(bench.renderer, only=("stairs",), size=(320, 180))
    )
    assert len(cases) >= 2
    for case in cases:
        assert case.value < 0.3, case
        assert case.numbers["added by the seam"]["hardware"] > 0.0


def test_seam_pixels_are_quads_of_two_cascades():
    index = np.zeros((5, 6), np.uint8)  # five rows: GL's quads begin at the last
    index[:, 3:] = 1
    counted = np.ones(index.shape, bool)
    wanted = np.zeros(index.shape, bool)
    wanted[1:, 2:4] = True
    assert (claim_filters.seam_pixels(index, counted) == wanted).all()
    counted[4, 2] = False
    wanted[3:, 2:4] = False
    assert (claim_filters.seam_pixels(index, counted) == wanted).all()
    index[:, 2:] = 1
    assert not claim_filters.seam_pixels(index, counted).any()


def test_angles_are_those_between_light_and_view(bench):
    for degrees in (0.0, 20.0, 85.0):
        view = claim_views.at_angle(bench.views[0], degrees)
        travel, look = -view.sun.to_light, -view.camera.backward
        assert np.degrees(np.arccos(travel @ look)) == pytest.approx(degrees, abs=1e-5)


def test_a_blend_without_its_branch_is_the_same_picture(bench, tmp_path):
    """So the two costs of blending are costs of one picture."""
    settings = csm.ShadowSettings(
        cascade_count=3, map_size=128, filter="pcf", blend="linear", blend_width=0.9,
        split="manual", manual_splits=(9.5, 12.0), select="interval",
    )  # fmt: skip
    view = bench.views[0]
    shaders = claim_times.without_branch(tmp_path)
    assert claim_times.BRANCH not in (shaders / "include/visibility.glsl").read_text()
    with csm.Renderer(shader_dir=shaders, stage=bench.renderer.info["stage"]) as other:
        masks = [
            bench.render(view, settings, outputs=("mask",), renderer=one).mask
            for one in (None, other)
        ]
    single = bench.render(view, settings.replace(blend="none"), outputs=("mask",)).mask
    assert np.array_equal(*masks)
    assert not np.array_equal(masks[0], single), "there is a transition to see"
    assert claim_times.blended_share(bench, view, settings) > 0.0


def test_scenes_that_are_not_there_are_refused():
    with pytest.raises(ValueError, match="nowhere"):
        claim_views.Bench(None, only=("nowhere",))
