"""The effect table: what compiles what, off means absent, and the page written from it."""

import itertools
import json
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import csm
from csm import _core
from csm.plans import OUTPUTS, output_bits
from scripts import effect_costs
from scripts.effect_needs import NEEDS, needs_of, values_of

ROOT = Path(__file__).resolve().parents[1]
TABLE = _core.effect_table()
NAMED = {row["name"]: row for row in TABLE if row["name"]}
PASS_BITS = {
    "shadow_map": 1, "view": 2, "shadow_mask": 4, "receiver_bounds": 32,
    "shadow_moments": 64, "shadow_blur": 128, "shadow_sum": 256,
}  # fmt: skip
ALL_OUTPUTS = output_bits(OUTPUTS)[0]

# Where every pass that sees a setting runs.
SEEN_WITH = {"cascade_count": {"fit": "visible"}}
SMALL = csm.ShadowSettings(map_size=128)


def settings_with(name, value):
    """Small settings in which one value has its meaning."""
    needs = {**needs_of(name, value), **SEEN_WITH.get(name, {}), name: value}
    if name == "cascade_count" and value == 1:
        needs["manual_splits"] = ()
    return SMALL.replace(**needs)


SINGLES = [
    pytest.param(settings_with(name, value), id=f"{name}={value}")
    for name, row in NAMED.items()
    for value in values_of(row)
] + [pytest.param(settings_with("normal_offset_texels", 1.5), id="normal_offset_texels=1.5")]


def keys(settings, outputs=ALL_OUTPUTS):
    """Program key of each pass that runs."""
    steps, _, _, _ = _core.plan(settings, 8, 8, outputs)
    return {name: key for name, _, key in steps}


# -- the table -------------------------------------------------------------------------------------


def test_rows_are_consistent():
    assert len({row["id"] for row in TABLE}) == len(TABLE)
    names = [row["name"] for row in TABLE if row["name"]]
    assert len(set(names)) == len(names)
    for row in TABLE:
        assert row["help"], row["id"]
        assert not row["passes"] & ~0x3FF, row["id"]
        if row["name"]:
            assert row["id"] == row["name"].upper()
        if row["type"] == "enum":
            assert (row["min"], row["max"] + 1) == (0, len(row["choices"].split()))
            assert row["default"] in row["choices"].split()
        else:
            assert row["min"] <= row["default"] <= row["max"]


def test_page_is_what_the_table_says():
    write = runpy.run_path(str(ROOT / "scripts/effects_page.py"))
    written = (ROOT / "docs/effects.md").read_text(encoding="utf-8")
    assert written == write["page"](), "run: python -m scripts.effects_page"


def test_page_has_cost_and_error_of_every_value():
    measured = json.loads((ROOT / "docs/effects_measured.json").read_text(encoding="utf-8"))
    expected = {(name, value): besides for name, value, besides in effect_costs.rows()}
    found = {(row["setting"], row["value"]): row for row in measured["rows"]}
    assert found.keys() == expected.keys(), "run: python -m scripts.effect_costs"
    assert len(found) == len(measured["rows"])
    for (name, value), row in found.items():
        besides = json.loads(json.dumps(expected[name, value]))
        assert row["besides"] == besides, (name, value)
        # What can be told without rendering is so today.
        settings = effect_costs.settings_of(name, value, expected[name, value])
        assert row["bytes"] == effect_costs.map_bytes(settings), (name, value)
        assert row["time"] > 0, (name, value)
        assert row["ms"] > 0, (name, value)
        assert 0 <= row["disagreement"] <= 2.001 * row["error"], (name, value)
        assert 0 < row["error_disc"] < 1, (name, value)
    base = measured["base"]
    assert base["bytes"] == effect_costs.map_bytes(effect_costs.BASE)
    assert base["error"] == found["filter", "hard"]["error"]


# -- masks and keys --------------------------------------------------------------------------------


def different(first, second):
    return {name for name in first.keys() & second.keys() if first[name] != second[name]}


# Filters with every pass there is, for rows that only prefiltered maps see.
PREFILTERED = ({"filter": "vsm"}, {"filter": "savsm"}, {"filter": "pcss", "pcss_map": "variance"})


@pytest.mark.parametrize("name", NAMED)
def test_effect_recompiles_only_the_passes_that_see_it(name):
    row = NAMED[name]
    seeing = {pass_ for pass_, bit in PASS_BITS.items() if row["passes"] & bit}
    changed = set()
    bases = [settings_with(name, value) for value in values_of(row)]
    for given in ({}, *PREFILTERED) if row["passes"] & 0x1C0 else ({},):
        given = {key: value for key, value in given.items() if key != name}
        every = [keys(settings.replace(**given)) for settings in bases]
        for first, second in itertools.combinations(every, 2):
            changed |= different(first, second)
    # bias is resolved on the CPU into receiver_plane, which the mask sees,
    # a skewed basis, a warp and the kernel's size into effects of their own
    resolved = {
        "filter_size": {"shadow_mask"},
        "bias": {"shadow_mask"},
        "light_basis": {"shadow_mask"},
        "warp": {"shadow_map", "shadow_mask"},
    }
    assert changed == seeing | resolved.get(name, set())


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("constant_bias_texels", (-1.0, 0.0, 2.5)),
        ("slope_bias", (0.0, 0.25, 3.0)),
        ("normal_offset_texels", (0.5, 1.0, 2.0)),
        ("lam", (0.0, 0.5, 1.0)),
        ("map_size", (64, 65, 4096)),
        ("manual_splits", ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))),
    ],
)
def test_numbers_recompile_nothing(name, values):
    base = csm.ShadowSettings(
        bias="manual", split="manual" if name == "manual_splits" else "practical",
        manual_splits=(7.0, 8.0, 9.0), normal_offset_texels=0.125,
    )  # fmt: skip
    assert len({tuple(keys(base.replace(**{name: value})).items()) for value in values}) == 1


def test_no_filter_recompiles_a_map():
    every = [settings_with("filter", value) for value in values_of(NAMED["filter"])]
    every += [settings_with("filter_size", value) for value in values_of(NAMED["filter_size"])]
    maps = {keys(settings).get("shadow_map") for settings in every}
    assert len(maps - {None}) == 1


def test_keys_of_all_singles_differ_as_their_defines_do():
    by_defines = {}
    for parameters in SINGLES:
        settings = parameters.values[0]
        for name, key in keys(settings).items():
            defines = _core.program_defines(name, settings, ALL_OUTPUTS)
            assert by_defines.setdefault((name, defines), key) == key
    assert len(set(by_defines.values())) == len(by_defines)


def test_all_names_are_always_defined_once_and_0_where_not_seen():
    every = {row["id"] for row in TABLE}
    for name in ("view", "shadow_map", "shadow_mask", "shadow_points"):
        text = _core.program_defines(name, csm.ShadowSettings(filter="pcf"), ALL_OUTPUTS)
        defined = dict(re.findall(r"^#define CSM_(\w+) (-?\d+)$", text, flags=re.MULTILINE))
        assert len(defined) == text.count("#define")
        assert defined.keys() >= every
        bit = PASS_BITS["shadow_mask" if name == "shadow_points" else name]
        for row in TABLE:
            if not row["passes"] & bit:
                assert defined[row["id"]] == "0", f"{name} must not see {row['id']}"
            for value, choice in enumerate(row["choices"].split()):
                assert defined[f"{row['id']}_{choice.upper()}"] == str(value)


# -- pictures --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def view():
    scene = csm.scenes.plane_and_box()
    camera = csm.Camera.look_at((-6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=100, size=(48, 27))
    return scene, camera, scene.suns["morning"]


def check_frame(frame):
    """A mask of this view has a dark side of the box and, for the most part, ground with light on
    it: all of it without acne, a part of it under a kernel without bias."""
    assert np.isfinite(frame.mask).all()
    assert frame.mask.min() == 0.0
    assert frame.mask.max() == 1.0
    assert (frame.mask == 0)[frame.valid].mean() > 0.01
    assert (frame.mask > 0.1)[frame.valid].mean() > 0.4


@pytest.mark.parametrize("settings", SINGLES)
def test_each_value_alone_compiles_and_renders(renderer, view, settings):
    check_frame(renderer.render(*view, settings, outputs=("mask", "valid")))


COMPILED = {
    "cascade_count": (1, 8),
    "select": ("map", "interval"),
    "pancake": (False, True),
    "depth_format": ("d32f", "d16"),
    "filter": ("hard", "none", "pcf"),
    "filter_size": (1, 2, 3, 33),
    "receiver_plane": (False, True),
    "normal_offset_texels": (0.0, 1.0),
}


@pytest.mark.sweep
@pytest.mark.parametrize(("first", "second"), [*itertools.combinations(COMPILED, 2)])
def test_each_pair_of_values_compiles_and_renders(renderer, view, first, second):
    for values in itertools.product(COMPILED[first], COMPILED[second]):
        changes = dict(zip((first, second), values, strict=True))
        needs = {}
        for name in (first, second):
            needs |= {**NEEDS.get(name, {}), **SEEN_WITH.get(name, {})}
        needs |= changes
        settings = SMALL.replace(**needs)
        check_frame(renderer.render(*view, settings, outputs=("mask", "valid")))


@pytest.mark.parametrize(
    ("named", "never_named"),
    [
        ({"filter_size": 7}, {}),
        ({"filter": "pcf", "filter_size": 1}, {"filter": "hard"}),
        ({"constant_bias_texels": 50.0, "slope_bias": 9.0}, {}),
        ({"normal_offset_texels": 5.0, "receiver_plane": False}, {}),
        ({"bias": "manual", "normal_offset_texels": 0.0}, {"bias": "manual"}),
        ({"bias": "manual", "receiver_plane": False}, {"bias": "manual"}),
        ({"lam": 0.9, "split": "uniform"}, {"split": "uniform"}),
        ({"manual_splits": (1.0, 2.0, 3.0)}, {}),
        ({"cascade_count": 1, "split": "logarithmic"}, {"cascade_count": 1}),
        ({"filter": "none", "fit": "box", "bias": "manual", "pancake": True}, {"filter": "none"}),
    ],
    ids=lambda changes: " ".join(f"{name}={value}" for name, value in changes.items()) or "default",
)
def test_what_is_off_equals_what_was_never_named(renderer, view, named, never_named):
    frames, plans = [], []
    for changes in (named, never_named):
        settings = SMALL.replace(**changes)
        frames.append(renderer.render(*view, settings, points=[(0.5, 0.0, 2.0)]))
        plans.append(csm.plan(settings, size=(48, 27)))
    assert plans[0] == plans[1]
    assert frames[0].outputs == frames[1].outputs
    for name in frames[0].outputs:
        assert np.array_equal(getattr(frames[0], name), getattr(frames[1], name)), name
    assert frames[0].info["settings"] == frames[1].info["settings"]
    assert frames[0].info["bytes"] == frames[1].info["bytes"]


def test_zero_is_a_value(renderer, view):
    """No bias at all is not the default bias: it shows acne, and should."""
    outputs = ("mask", "normal", "valid")
    bare = renderer.render(*view, SMALL.replace(bias="manual"), outputs=outputs)
    default = renderer.render(*view, SMALL, outputs=outputs)
    ground = default.valid & (default.normal[..., 1] > 0.99)
    assert (bare.mask < default.mask)[ground].mean() > 0.1
    assert not (bare.mask > default.mask)[ground].any()


# -- off is absent ---------------------------------------------------------------------------------

BASES = {
    "default": SMALL,
    "pcf": SMALL.replace(filter="pcf"),
    "vsm": SMALL.replace(filter="vsm"),
    "one cascade": SMALL.replace(cascade_count=1),
    "approximate": SMALL.replace(snap="approximate", light_basis="world"),
    "warped": SMALL.replace(warp="lispsm"),
    "pancaked": SMALL.replace(pancake=True),
    "none": SMALL.replace(filter="none"),
}
NUMBERS = {row["name"]: row for row in _core.number_table()}


def off_cases():
    """(base, name, value): values that the canonical form of a base takes no notice of."""
    for base_name, base in BASES.items():
        canonical = base.canonical()
        values = {name: values_of(row) for name, row in NAMED.items()}
        values |= {name: (row["max"],) for name, row in NUMBERS.items()}
        for name, all_values in values.items():
            for value in all_values:
                more = NEEDS.get((name, value), {})
                try:
                    named = base.replace(**{name: value}, **{
                        key: given for key, given in more.items() if key.startswith("manual_")
                    })  # fmt: skip
                except ValueError:
                    continue  # not even a value, beside this base
                if named != base and named.canonical() == canonical:
                    yield base_name, name, named


OFF = list(off_cases())


def test_every_setting_is_off_somewhere_besides_filter_none():
    off = {name for base, name, _ in OFF if base != "none"}
    # whatever else is set, these have a meaning at all of their values
    always = {
        "fit", "snap", "warp", "select", "texcoord", "depth_format", "storage",
        "caster_faces", "filter", "view_range", "bias", "cascade_count", "reversed_depth",
        "sun_step_deg", "max_distance", "fade_width", "plane", "pancake",
    }  # fmt: skip
    assert (NAMED.keys() | NUMBERS.keys()) - off <= always
    # and without shadows nothing has
    without = {name for base, name, _ in OFF if base == "none"}
    assert (NAMED.keys() | NUMBERS.keys()) - without == {"filter"}


def test_what_is_off_plans_what_was_never_named():
    for base, name, named in OFF:
        for outputs in (OUTPUTS, ("mask",), ("shadow_maps",)):
            if outputs == ("shadow_maps",) and base == "none":
                continue
            expected = csm.plan(BASES[base], size=(48, 27), outputs=outputs)
            assert csm.plan(named, size=(48, 27), outputs=outputs) == expected, (base, name)


@pytest.mark.parametrize("base", BASES)
def test_what_is_off_leaves_every_bit_of_the_mask(renderer, view, base):
    expected = renderer.render(*view, BASES[base], outputs=("mask",))
    # the last value of each setting; all values plan the same
    for name, named in {name: named for where, name, named in OFF if where == base}.items():
        frame = renderer.render(*view, named, outputs=("mask",))
        assert frame.info["programs_compiled"] == 0, name
        assert np.array_equal(frame.mask, expected.mask), name
        assert frame.info["bytes"] == expected.info["bytes"], name
