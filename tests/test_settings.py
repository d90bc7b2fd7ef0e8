"""ShadowSettings: the contract's defaults, the effect table field by field, the canonical form."""

import copy
import inspect
import json
import pickle
import re
from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest
from any_settings import any_settings
from hypothesis import given

import csm
from csm import _core
from csm.settings import changed, draw_alike

# What scripts rely on, written down apart from the code.
PUBLIC_DEFAULTS = {
    "cascade_count": 4,
    "map_size": 2048,
    "split": "practical",
    "lam": 0.5,
    "view_range": "scene",
    "fit": "sphere",
    "snap": "exact",
    "select": "map",
    "light_basis": "orthonormal",
    "warp": "none",
    "cull": "inclusive",
    "depth_format": "d32f",
    "filter": "hard",
    "filter_size": 3,
    "filter_weights": "box",
    "storage": "array",
    "gradients": "hardware",
    "blend": "none",
    "bias": "auto",
}
# Values that mean "nothing added": a default never changes the picture of a setting not named.
OFF = {
    "manual_splits": (),
    "first_split": 0.0,
    "max_distance": 0.0,
    "turned": False,
    "sun_step_deg": 0.0,
    "level_spacing": "linear",
    "level_count": 64,
    "level_hysteresis": 0,
    "texcoord": "position",
    "depth_range": "scene",
    "manual_depth_range": (),
    "pancake": False,
    "constant_bias_texels": 0.0,
    "slope_bias": 0.0,
    "normal_offset_texels": 0.0,
    "receiver_plane": False,
    "bias_side": "receiver",
    "caster_faces": "both",
    "tile_border": 0,
    "copied_tiles": False,
    "reversed_depth": False,
    "filter_fetch": "gather",
    "kernel": "texels",
    "disc": "poisson",
    "tap_count": 16,
    "rotated": False,
    "pcss_map": "depth",
    "moment_format": "float32",
    "lookup": "bilinear",
    "anisotropy": 8,
    "samples": 1,
    "exponent": 0.0,
    "negative_exponent": 0.0,
    "log_filter": False,
    "msm_bound": "hamburger",
    "layer_count": 4,
    "fourier_terms": 16,
    "bleed_step": 0.0,
    "bleed_power": 1.0,
    "plane": "normal",
    "blend_width": 0.1,
    "fade_width": 0.0,
}
TABLE = {row["name"]: row for row in _core.effect_table() if row["name"]}
NUMBERS = {row["name"]: row for row in _core.number_table()}
FIELDS = {field.name: field for field in fields(csm.ShadowSettings)}


def documented(name):
    """The type line and the text of a parameter in the class's docstring."""
    match = re.search(
        rf"^(?:\w+, )*{name}(?:, \w+)* : (.*)\n((?:    .*\n|\n)*)",
        inspect.cleandoc(csm.ShadowSettings.__doc__),  # as Python 3.13 keeps it
        flags=re.MULTILINE,
    )
    assert match, f"{name} is not documented"
    return match[1], match[2]


@pytest.mark.parametrize("name", PUBLIC_DEFAULTS)
def test_default_is_that_of_the_contract(name):
    assert getattr(csm.ShadowSettings(), name) == PUBLIC_DEFAULTS[name]


@pytest.mark.parametrize("name", OFF)
def test_default_is_off(name):
    assert getattr(csm.ShadowSettings(), name) == OFF[name]


def test_every_field_is_known_here():
    assert FIELDS.keys() == PUBLIC_DEFAULTS.keys() | OFF.keys()


@pytest.mark.parametrize("name", TABLE)
def test_effect_is_a_field_of_equal_type_and_default(name):
    row, field = TABLE[name], FIELDS[name]
    assert field.default == row["default"]
    assert type(field.default) is {"enum": str, "int": int, "bool": bool}[row["type"]]
    kind, text = documented(name)
    if row["type"] == "enum":
        first, *rest = row["choices"].split()
        assert kind == "{" + ", ".join(f'"{choice}"' for choice in (first, *rest)) + "}"
        assert field.default == first
    else:
        assert kind == row["type"]
    assert text.strip() or row["type"] == "enum"


@pytest.mark.parametrize("name", NUMBERS)
def test_number_is_a_field_of_equal_default_and_keeps_its_range(name):
    row, field = NUMBERS[name], FIELDS[name]
    assert row["help"]
    assert field.type is float
    assert field.default == row["default"]
    for value in (row["min"], row["max"]):
        # exponents have a limit of their own in each format, less than that of the table
        needs = {"filter": "hard"} if "exponent" in name else {}
        assert getattr(csm.ShadowSettings(**needs, **{name: value}), name) == value
    for value in (np.nextafter(row["min"], -np.inf), np.nextafter(row["max"], np.inf)):
        with pytest.raises(ValueError, match=name):
            csm.ShadowSettings(**{name: value})


@pytest.mark.parametrize("name", FIELDS)
def test_field_is_documented(name):
    assert documented(name)[0]


@pytest.mark.parametrize("name", TABLE)
def test_every_value_of_an_effect_is_taken_and_others_are_not(name):
    row = TABLE[name]
    if row["type"] == "enum":
        extra = {
            "split": {"cascade_count": 2, "manual_splits": (3.0,)},
            "depth_range": {"manual_depth_range": (-2.0, 5.0)},
        }.get(name, {})
        for choice in row["choices"].split():
            changed = csm.ShadowSettings(**extra).replace(**{name: choice})
            assert getattr(changed, name) == choice
        bad = [row["choices"].split()[0].upper(), "", row["choices"]]
    elif row["type"] == "int":
        for value in (row["min"], row["max"]):
            assert getattr(csm.ShadowSettings(**{name: value}), name) == value
        bad = [row["min"] - 1, row["max"] + 1]
    else:
        assert getattr(csm.ShadowSettings(**{name: not row["default"]}), name) != row["default"]
        bad = []
    for value in bad:
        with pytest.raises(ValueError, match=name):
            csm.ShadowSettings(**{name: value})


def test_frozen_equal_hashable_copied_and_pickled():
    settings = csm.ShadowSettings(map_size=512, filter="pcf", filter_size=5)
    with pytest.raises(FrozenInstanceError):
        settings.map_size = 1024
    same = csm.ShadowSettings(filter_size=5, filter="pcf", map_size=512)
    for other in (same, copy.copy(settings), pickle.loads(pickle.dumps(settings))):
        assert other == settings
        assert hash(other) == hash(settings)
    assert settings != settings.replace(map_size=513)


def test_replace_changes_a_copy():
    settings = csm.ShadowSettings(lam=0.25)
    changed = settings.replace(map_size=64, snap="none")
    assert (settings.map_size, settings.snap) == (2048, "exact")
    assert (changed.map_size, changed.snap, changed.lam) == (64, "none", 0.25)


def test_sizes_per_cascade_follow_the_count():
    settings = csm.ShadowSettings(cascade_count=3, map_size=(64, 32, 16))
    assert settings.replace(cascade_count=2).map_size == (64, 32)
    assert settings.replace(cascade_count=4).map_size == (64, 32, 16, 16)


def test_dict_is_plain_and_makes_the_same_settings():
    settings = csm.ShadowSettings(
        cascade_count=3, split="manual", manual_splits=(2, 9.5), map_size=(64, 64, 32)
    )
    text = json.dumps(settings.to_dict())
    assert csm.ShadowSettings(**json.loads(text)) == settings


def test_numbers_of_numpy_are_numbers():
    settings = csm.ShadowSettings(
        cascade_count=np.int64(2),
        map_size=np.array([64, 32], np.uint16),
        lam=np.float32(0.5),
        pancake=np.bool_(True),
        split="manual",
        manual_splits=np.array([7.0]),
    )
    assert settings.to_dict() == json.loads(json.dumps(settings.to_dict()))
    assert (settings.map_size, settings.manual_splits) == ((64, 32), (7.0,))
    assert settings.pancake is True


@pytest.mark.parametrize("name", ["map_size", "manual_splits"])
@pytest.mark.parametrize("text", ["2048", "big", b"64"])
def test_text_is_no_number_nor_a_sequence_of_digits(name, text):
    with pytest.raises(TypeError, match=rf"{name} must be .*\(got {re.escape(repr(text))}\)"):
        csm.ShadowSettings(**{name: text})


# -- canonical form --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given_", "canonical"),
    [
        ({"filter_size": 9}, {}),
        ({"filter": "pcf", "filter_size": 1}, {}),
        ({"filter": "pcf", "filter_size": 9}, {"filter": "pcf", "filter_size": 9}),
        ({"split": "uniform", "lam": 0.9}, {"split": "uniform"}),
        ({"manual_splits": (1.0, 2.0, 3.0)}, {}),
        ({"cascade_count": 1, "split": "logarithmic", "lam": 0.1}, {"cascade_count": 1}),
        ({"constant_bias_texels": 3.0, "slope_bias": 2.0, "normal_offset_texels": 1.0}, {}),
        ({"receiver_plane": True}, {}),
        (
            {"bias": "manual", "slope_bias": 2.0, "receiver_plane": True},
            {"bias": "manual", "slope_bias": 2.0, "receiver_plane": True},
        ),
        ({"map_size": (64,) * 4}, {"map_size": 64}),
        (
            {"filter": "none", "map_size": 64, "cascade_count": 2, "fit": "box", "snap": "none"},
            {"filter": "none"},
        ),
        ({"filter": "none", "bias": "manual", "slope_bias": 2.0}, {"filter": "none"}),
    ],
    ids=[
        "size without kernel", "1 x 1 pcf is hard", "pcf", "lam of no weight", "splits not manual",
        "one cascade has no splits", "numbers under auto", "plane under auto", "manual",
        "equal sizes", "no shadows", "no shadows, no bias",
    ],
)  # fmt: skip
def test_what_has_no_meaning_is_at_its_default(given_, canonical):
    expected = csm.ShadowSettings(**canonical).canonical()
    assert csm.ShadowSettings(**given_).canonical() == expected
    for name, value in canonical.items():
        assert getattr(expected, name) == value


@given(settings=any_settings)
def test_canonical_form_is_its_own_and_means_the_same(settings):
    canonical = settings.canonical()
    assert canonical.canonical() == canonical
    checked = csm.ShadowSettings(**canonical.to_dict())  # every field is as a check leaves it
    assert list(vars(checked).items()) == list(vars(canonical).items())
    assert list(map(type, vars(checked).values())) == list(map(type, vars(canonical).values()))
    # same passes, textures, programs; the same bias
    assert csm.plan(canonical, size=(8, 8)) == csm.plan(settings, size=(8, 8))
    assert _core.bias_terms(canonical) == _core.bias_terms(settings)


@pytest.mark.parametrize("count", [0, -1, 9, 10**9, "3", None, 2.5])
def test_a_replaced_count_is_checked_before_sizes_follow_it(count):
    several = csm.ShadowSettings(map_size=(1024, 512, 256, 128))
    kinds = (TypeError, ValueError)
    with pytest.raises(kinds) as plain:
        csm.ShadowSettings(cascade_count=count)
    with pytest.raises(kinds) as replaced:
        several.replace(cascade_count=count)
    assert type(replaced.value) is type(plain.value)
    assert str(replaced.value) == str(plain.value)
    assert several.replace(cascade_count=2.0).map_size == (1024, 512)
    assert several.replace(cascade_count=6).map_size == (1024, 512, 256, 128, 128, 128)


def test_what_draws_alike():
    """As canonical forms are equal; no zero has a sign, and each of equal sizes may be given."""
    one = csm.ShadowSettings(bias="manual", slope_bias=1.0, cascade_count=2)
    for changes, alike in (
        ({"constant_bias_texels": -0.0}, True),
        ({"map_size": (2048, 2048)}, True),
        ({"fade_width": 0.0, "tap_count": 8}, True),  # no disc to tap
        ({"slope_bias": 1.0 + 1e-12}, False),
        ({"map_size": (2048, 1024)}, False),
        ({"cascade_count": 3}, False),
    ):
        other = one.replace(**changes)
        assert draw_alike(one, other) == alike == (one.canonical() == other.canonical())


def test_a_number_that_no_float_holds_is_refused_by_name():
    with pytest.raises(ValueError, match="max_distance must be finite"):
        csm.ShadowSettings(max_distance=10**400)


def test_words_are_plain():
    assert type(csm.ShadowSettings(filter=np.str_("pcf")).filter) is str


def test_settings_by_right_words_are_those_that_replace_makes():
    one = csm.ShadowSettings(cascade_count=3)
    for changes in ({"select": "interval"}, {"filter": "pcss", "tap_count": 8}, {"turned": True}):
        assert changed(one, **changes) == one.replace(**changes)
        assert one == csm.ShadowSettings(cascade_count=3)
    with pytest.raises(ValueError, match="filter must be one of: hard none pcf"):
        csm.plan(changed(one, filter="soft"))  # the core asks about all


class Asked:
    """Settings by attribute alone: nothing lies in a dict of their own."""

    __slots__ = ("settings",)

    def __init__(self, settings):
        self.settings = settings

    def __getattr__(self, name):
        return getattr(self.settings, name)


@given(any_settings)
def test_settings_are_read_by_attribute_where_they_have_no_dict(settings):
    assert _core.canonical_settings(Asked(settings)) == _core.canonical_settings(settings)
