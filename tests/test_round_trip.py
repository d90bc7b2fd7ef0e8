"""Settings and recommendations as JSON and TOML: what is read is what was written, to the bit."""

import dataclasses
import json
import struct
import tomllib

import numpy as np
import pytest
from any_settings import any_settings
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

import csm
from csm import cli
from csm.formats import SUFFIXES, read_json, read_toml, write_json, write_toml
from csm.plans import map_bytes
from csm.recommendation import Reasons
from csm.records import load_settings

SIZE = (160, 90)
SUN = csm.Sun((0.3, 1.0, 0.25), 0.53)  # whose unit vector, divided by its length, moves a bit
FORMS = [("to_json", "from_json"), ("to_toml", "from_toml")]
forms = pytest.mark.parametrize(("write", "read"), FORMS, ids=["json", "toml"])


def view(**more):
    return csm.Camera.look_at((6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=100, size=SIZE, **more)


def bits(value):
    """A value with its floats as bytes, so that -0 is not 0 and a last bit counts."""
    if isinstance(value, dict):
        return {key: bits(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [bits(item) for item in value]
    if isinstance(value, float):
        return struct.pack(">d", value)
    return type(value).__name__, value


@pytest.fixture(scope="module")
def box():
    return csm.scenes.plane_and_box()


@pytest.fixture(scope="module")
def kept():
    return {}


@pytest.fixture
def found(kept, renderer, box):
    """One on a path under a goal out of reach: nothing in it is empty or None that may be."""
    if not kept:
        path = [view(), view().translated((0.1, 0.0, 0.03))]
        kept["found"] = csm.recommend(
            box, path, SUN, max_error=0.0, max_bytes=1 << 20, renderer=renderer
        )
    return kept["found"]


# -- settings --------------------------------------------------------------------------------------


@forms
@hypothesis_settings(max_examples=60, deadline=None)
@given(settings=any_settings, lam=st.floats(0, 1), slope=st.floats(-1e6, 1e6))
def test_settings_come_back_bit_for_bit(write, read, settings, lam, slope):
    splits = tuple(lam + 0.1 * (k + 1) for k in range(settings.cascade_count - 1))
    settings = settings.replace(lam=lam, slope_bias=slope, manual_splits=splits)
    again = getattr(csm.ShadowSettings, read)(getattr(settings, write)())
    assert again == settings
    assert bits(again.to_dict()) == bits(settings.to_dict())
    assert hash(again) == hash(settings)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_settings_come_back_from_files(tmp_path, suffix):
    settings = csm.ShadowSettings(
        cascade_count=3, map_size=(64, 48, 32), split="manual", manual_splits=(0.1 + 0.2, 1e22)
    )
    path = tmp_path / f"settings{suffix}"
    settings.save(path)
    assert csm.ShadowSettings.load(path) == settings
    assert load_settings(path) == settings


def test_file_of_a_person_says_only_what_differs(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('# four small ones\nmap_size = 512\nfilter = "pcf"\nlam = 1\n')
    assert csm.ShadowSettings.load(path) == csm.ShadowSettings(map_size=512, filter="pcf", lam=1.0)


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("map_sise = 512", ValueError, ["map_sise", "did you mean 'map_size'", "cascade_count"]),
        ('map_size = "big"', TypeError, ["map_size", "whole number", "'big'"]),
        ("lam = 1.5", ValueError, ["lam", "1.5", "0", "1"]),
        ('filter = "soft"', ValueError, ["filter", "soft", "hard"]),
        ("lam = nan", ValueError, ["lam", "finite", "nan"]),
        ("cascade_count = 4.5", ValueError, ["cascade_count", "whole", "4.5"]),
        ("turned = 2", TypeError, ["turned", "True or False", "2"]),
        ("lam = 0.5\nlam = 0.6", ValueError, ["TOML", "overwrite"]),
        ("[map_size]\na = 1", TypeError, ["map_size", "whole number"]),
        ("lam 3", ValueError, ["TOML"]),
    ],
)  # fmt: skip
def test_bad_settings_are_named_with_what_is_allowed(tmp_path, text, error, words):
    with pytest.raises(error) as caught:
        csm.ShadowSettings.from_toml(text)
    assert all(word in str(caught.value) for word in words)
    path = tmp_path / "bad.toml"
    path.write_text(text)
    for load in (csm.ShadowSettings.load, load_settings):
        with pytest.raises(error) as caught:
            load(path)
        assert all(word in str(caught.value) for word in [str(path), *words])


@pytest.mark.parametrize(
    ("text", "error", "match"),
    [
        ("[1, 2]", ValueError, "must be an object"),
        ('{"lam": 0.5, "lam": 0.6}', ValueError, "'lam' is there twice"),
        ('{"lam": NaN}', ValueError, "no number of JSON: NaN"),
        ('{"lam": 0.5', ValueError, "no JSON"),
        ("[" * 100000, ValueError, "no JSON"),
        (b"{}", TypeError, "text must be a str"),
        ('{"lam": null}', TypeError, "lam must be a number"),
    ],
)
def test_bad_json_is_refused(text, error, match):
    with pytest.raises(error, match=match):
        csm.ShadowSettings.from_json(text)


def test_files_of_other_kinds_are_refused(tmp_path):
    settings = csm.ShadowSettings()
    for name in ("settings.yaml", "settings"):
        with pytest.raises(ValueError, match=r"must end in \.json or \.toml"):
            settings.save(tmp_path / name)
        with pytest.raises(ValueError, match=r"must end in \.json or \.toml"):
            csm.ShadowSettings.load(tmp_path / name)
    assert not list(tmp_path.iterdir())
    with pytest.raises(FileNotFoundError):
        csm.ShadowSettings.load(tmp_path / "none.toml")
    (tmp_path / "picture.toml").write_bytes(b"\x89PNG\r\n")
    with pytest.raises(ValueError, match=r"picture\.toml: is no text"):
        csm.ShadowSettings.load(tmp_path / "picture.toml")


# -- the writer of TOML ----------------------------------------------------------------------------

texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
plain = st.booleans() | st.integers() | st.floats(allow_nan=False) | texts
values = st.recursive(
    plain | st.lists(plain, max_size=3),
    lambda inner: (
        st.dictionaries(texts, inner, max_size=3)
        | st.lists(st.dictionaries(texts, inner, max_size=2), min_size=1, max_size=2)
    ),
    max_leaves=8,
)


@hypothesis_settings(max_examples=60, deadline=None)
@given(table=st.dictionaries(texts, values, max_size=4))
def test_toml_and_json_say_any_plain_table(table):
    assert bits(tomllib.loads(write_toml(table))) == bits(table)
    assert bits(read_toml(write_toml(table))) == bits(table)
    finite = json.loads(write_json(table))  # strict: no word that JSON does not have
    assert bits(read_json(write_json(table))) == bits(finite)


def test_json_has_words_for_what_is_not_finite_and_toml_has_its_own():
    table = {"a": [float("inf"), float("-inf")], "b": float("nan"), "c": None}
    assert json.loads(write_json(table)) == {"a": ["inf", "-inf"], "b": "nan", "c": None}
    again = tomllib.loads(write_toml(table))
    assert again["a"] == table["a"]
    assert np.isnan(again["b"])
    assert "c" not in again
    with pytest.raises(TypeError, match="TOML has no complex"):
        write_toml({"a": 1j})
    with pytest.raises(TypeError, match="TOML has no NoneType"):
        write_toml({"a": [None]})


# -- recommendations -------------------------------------------------------------------------------


@forms
def test_recommendation_comes_back_bit_for_bit(found, write, read):
    again = getattr(csm.Recommendation, read)(getattr(found, write)())
    assert bits(again.to_dict()) == bits(found.to_dict())
    assert again.settings == found.settings
    assert again.reasons == found.reasons  # dataclasses: what they turned round, too
    assert [type(r.value) for r in again.reasons] == [type(r.value) for r in found.reasons]
    assert (again.goal, again.met, again.obstacle) == (found.goal, found.met, found.obstacle)
    assert again.obstacle
    assert (again.splits, again.texels) == (found.splits, found.texels)
    assert str(again) == str(found)
    for name, value in vars(found.signals).items():
        if name != "views":
            other = getattr(again.signals, name)
            assert type(other) is type(value)
            assert bits(np.asarray(other).tolist()) == bits(np.asarray(value).tolist())
    (cameras, suns), (seen, lit) = again.path, found.path
    assert cameras == seen
    assert [bits(one.to_light) for one in suns] == [bits(one.to_light) for one in lit]
    assert suns[0].angular_diameter_deg == lit[0].angular_diameter_deg


@forms
def test_none_and_what_is_not_finite_come_back(found, write, read):
    signals = dataclasses.replace(found.signals, depth_ratio=float("inf"))
    sizes = (64,) * found.settings.cascade_count
    settings = found.settings.replace(map_size=sizes)
    reasons = Reasons(
        dataclasses.replace(one, flipped=None, value=sizes) if one.effect == "map_size" else one
        for one in found.reasons
    )
    goal = {"max_error": None, "budget_ms": 12.5, "max_bytes": None}
    odd = dataclasses.replace(
        found, signals=signals, reasons=reasons, goal=goal, met=True, obstacle=None,
        settings=settings, map_bytes=map_bytes(settings),
    )  # fmt: skip
    again = getattr(csm.Recommendation, read)(getattr(odd, write)())
    assert again.goal == goal
    assert again.obstacle is None
    assert [one.value for one in again.reasons] == [one.value for one in reasons]
    assert again == odd
    assert again.signals.depth_ratio == float("inf")


@pytest.mark.parametrize("value", ['"\\ud800"', "1" + 400 * "0"], ids=["surrogate", "huge"])
def test_values_that_no_setting_can_hold_are_refused_with_their_place(tmp_path, value):
    path = tmp_path / "mine.json"
    name = "split" if value.startswith('"') else "lam"
    path.write_text(f'{{"{name}": {value}}}')
    with pytest.raises(ValueError, match=r"mine\.json: "):
        csm.ShadowSettings.load(path)


def test_scene_is_not_in_a_file_and_is_given_back(tmp_path, renderer, box, found):
    path = tmp_path / "found.toml"
    found.save(path)
    again = csm.Recommendation.load(path)
    assert again.scene is None
    digest = found.to_dict()["scene"]["digest"]
    with pytest.raises(ValueError, match=f"verify needs the scene.*{digest}.*with_scene"):
        again.verify(renderer=renderer)
    with pytest.raises(ValueError, match=f"scene must be the one .*{digest}"):
        again.with_scene(csm.scenes.plane_and_box().with_ground(-3.0))
    with pytest.raises(TypeError, match=r"scene must be a csm\.Scene"):
        again.with_scene(None)
    whole = again.with_scene(box)
    assert bits(whole.to_dict()) == bits(found.to_dict())
    # the coarse pictures, which are not in a file either, are looked at again
    one = dataclasses.replace(whole, reasons=Reasons(whole.reasons[:1]))
    kept = dataclasses.replace(found, reasons=Reasons(found.reasons[:1]))
    proofs = [r.verify(renderer=renderer, rays_per_pixel=1, repeats=1) for r in (one, kept)]
    assert proofs[0].recommended.error == proofs[1].recommended.error


@pytest.mark.parametrize(
    ("near", "far", "orthographic"),
    [(-100.0, -1.0, True), (-50.0, 0.0, True), (0.0, 90.0, True), (1e-3, 1e9, False)],
)
def test_splits_that_a_camera_allows_are_read_back(renderer, box, near, far, orthographic):
    """An orthographic camera may see what lies behind it, and nothing else."""
    camera = view()
    if orthographic:
        camera = camera.replace(orthographic=True, half_width=8.0, half_height=4.5)
    if far <= 0.0:
        camera = camera.replace(eye=camera.eye - 30.0 * camera.backward)
    found = csm.recommend(box, camera.replace(near=near, far=far), SUN, renderer=renderer)
    assert len(found.splits) > 1
    for kind in ("json", "toml"):
        text = getattr(found, f"to_{kind}")()
        again = getattr(csm.Recommendation, f"from_{kind}")(text)
        assert again == found


def test_settings_of_a_recommendation_are_read_from_its_file(tmp_path, found):
    for suffix in SUFFIXES:
        path = tmp_path / f"found{suffix}"
        found.save(path)
        assert load_settings(path) == found.settings


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda v: v.pop("signals"), ValueError, ["needs 'signals'"]),
        (lambda v: v.update(extra=1), ValueError, ["'extra'", "expected_error"]),
        (lambda v: v.update(format="csm 0"), ValueError, ["format", "csm 0", "csm recommendation"]),
        (lambda v: v["settings"].update(lam=3), ValueError, ["settings", "lam", "3"]),
        (lambda v: v["settings"].update(size=3), ValueError, ["settings", "'size'", "map_size"]),
        (lambda v: v.update(met=1), TypeError, ["met", "true or false", "1"]),
        (lambda v: v.update(map_bytes=1.5), TypeError, ["map_bytes", "whole number", "1.5"]),
        (lambda v: v.update(expected_ms="x"), TypeError, ["expected_ms", "number", "'x'"]),
        (lambda v: v["goal"].update(speed=1), ValueError, ["goal", "'speed'", "budget_ms"]),
        (lambda v: v["signals"].pop("bias_slope"), ValueError, ["signals", "'bias_slope'"]),
        (lambda v: v["signals"].update(casters=[1.5]), TypeError, ["casters", "whole", "1.5"]),
        (lambda v: v["reasons"][2].update(taken="yes"), TypeError, ["reasons[2]", "taken", "yes"]),
        (lambda v: v["reasons"][1].pop("cost"), ValueError, ["reasons[1]", "'cost'"]),
        (
            lambda v: v["reasons"][0].update(flipped={"filter": "x"}),
            ValueError, ["reasons[0]", "filter", "x"],
        ),
        (lambda v: v["path"].update(suns=[]), ValueError, ["path.suns", "at least 1"]),
        (lambda v: v["path"]["cameras"][1].update(far=0), ValueError, ["path.cameras[1]", "far"]),
        (lambda v: v["path"]["suns"][0].update(to_light=[0, 0, 0]), ValueError, ["to_light"]),
        (lambda v: v["scene"].update(bounds=[1, 2]), ValueError, ["scene.bounds", "two points"]),
        (lambda v: v.update(splits=3), TypeError, ["splits", "list", "3"]),
        # what contradicts itself
        (
            lambda v: v["settings"].update(cascade_count=v["settings"]["cascade_count"] + 1),
            ValueError, ["splits", "ascending", "settings.cascade_count"],
        ),
        (lambda v: v["splits"].reverse(), ValueError, ["splits", "ascending"]),
        (
            lambda v: v["splits"].__setitem__(-1, 1e8),
            ValueError, ["splits", "first camera's near", "1000000"],
        ),
        (lambda v: v["splits"].__setitem__(0, -1.0), ValueError, ["splits", "near", "-1"]),
        (
            lambda v: v["scene"].update(bounds=[[1, 1, 1], [0, 2, 2]]),
            ValueError, ["scene.bounds", "least and greatest"],
        ),
        (
            lambda v: v["reasons"][0].update(taken=False),
            ValueError, ["reasons[0]", "taken of 'shadows' must be True", "False"],
        ),
        (
            lambda v: v["reasons"][-1].update(taken=not v["reasons"][-1]["taken"]),
            ValueError, ["reasons[", "taken of", "as in settings"],
        ),
        (lambda v: v["texels"].append(0.1), ValueError, ["texels", "settings.cascade_count"]),
        (lambda v: v["texels"].__setitem__(0, -0.1), ValueError, ["texels", "-0.1"]),
        (lambda v: v.update(map_bytes=-4), ValueError, ["map_bytes", "settings", "-4"]),
        (lambda v: v.update(map_bytes=10**18), ValueError, ["map_bytes", "settings", "10000000"]),
        (lambda v: v["settings"].update(map_size=77), ValueError, ["map_bytes", "must be"]),
        (lambda v: v["settings"].update(snap="none"), ValueError, ["'snap'", "'none'", "'exact'"]),
        (lambda v: v.update(expected_error=-0.1), ValueError, ["expected_error", "-0.1", "0"]),
        (lambda v: v.update(expected_ms="nan"), ValueError, ["expected_ms", "nan"]),
        (lambda v: v["goal"].update(max_error=2.0), ValueError, ["goal.max_error", "2", "1"]),
        (lambda v: v.update(met=True), ValueError, ["obstacle", "met True"]),
        (lambda v: v.update(obstacle=""), ValueError, ["obstacle", "met False"]),
        (
            lambda v: v.update(met=True, obstacle=None),
            ValueError, ["met must be false", "expected_error", "goal.max_error"],
        ),
        (
            lambda v: v.update(
                met=True, obstacle=None,
                goal=dict(max_error=None, budget_ms=0.5 * v["expected_ms"], max_bytes=None),
            ),
            ValueError, ["met must be false", "expected_ms", "goal.budget_ms"],
        ),
        (
            lambda v: v.update(
                met=True, obstacle=None, goal=dict(max_error=None, budget_ms=None, max_bytes=1)
            ),
            ValueError, ["met must be false", "map_bytes", "goal.max_bytes"],
        ),
        (lambda v: v.update(reasons=[]), ValueError, ["reasons", "empty", "cascade_count"]),
        (
            lambda v: v["reasons"][3].update(effect="sparkle"),
            ValueError, ["reasons[3]", "sparkle", "map_size"],
        ),
        (
            lambda v: v["reasons"].append(dict(v["reasons"][0])),
            ValueError, ["reasons[", "'shadows'", "twice"],
        ),
        (
            lambda v: v["signals"].update(facing_share=1.5),
            ValueError, ["signals.facing_share", "0 to 1", "1.5"],
        ),
        (
            lambda v: v["signals"]["cascade_shares"].__setitem__(1, -0.5),
            ValueError, ["signals.cascade_shares", "-0.5"],
        ),
        (lambda v: v["signals"].update(scene_triangles=-3), ValueError, ["scene_triangles", "-3"]),
    ],
)  # fmt: skip
def test_bad_recommendations_are_named(found, change, error, words):
    values = json.loads(found.to_json())
    change(values)
    with pytest.raises(error) as caught:
        csm.Recommendation.from_json(json.dumps(values))
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_a_file_that_contradicts_itself_is_named_and_its_settings_still_serve(tmp_path, found):
    values = json.loads(found.to_json())
    values["settings"]["cascade_count"] = found.settings.cascade_count + 1
    path = tmp_path / "edited.json"
    path.write_text(json.dumps(values))
    with pytest.raises(ValueError, match=r"edited\.json: splits must be .*cascade_count"):
        csm.Recommendation.load(path)
    assert load_settings(path).cascade_count == found.settings.cascade_count + 1
    values["settings"]["lam"] = 3
    path.write_text(json.dumps(values))
    with pytest.raises(ValueError, match=r"edited\.json: settings: lam .*3"):
        load_settings(path)


@pytest.mark.parametrize("to_light", [(0.2, -1.0, 0.1), (0.2, 1.0, 0.1)], ids=["dark", "lit"])
@pytest.mark.parametrize("target", [(0, 0, 0), (0, 90, 1)], ids=["down", "sky"])
def test_whatever_is_recommended_is_read(renderer, box, to_light, target):
    camera = csm.Camera.look_at((6, 4.5, 8), target, far=100, size=SIZE)
    made = csm.recommend(box, camera, csm.Sun(to_light), renderer=renderer)
    assert csm.Recommendation.from_toml(made.to_toml()) == made


def test_recommendations_are_equal_if_their_files_are(renderer, box, found):
    again = csm.Recommendation.from_json(found.to_json())
    assert again == found
    assert hash(again) == hash(found)
    assert len({again, found}) == 1
    assert dataclasses.replace(found, expected_ms=found.expected_ms + 1.0) != found
    assert found != found.settings
    twice = [csm.recommend(box, view(), SUN, renderer=renderer) for _ in range(2)]
    assert twice[0] == twice[1]  # nothing in it depends on time
    assert twice[0] != found


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_mark_of_byte_order_is_read_over(tmp_path, suffix):
    settings = csm.ShadowSettings(map_size=77)
    path = tmp_path / f"marked{suffix}"
    settings.save(path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert csm.ShadowSettings.load(path) == load_settings(path) == settings
    text = path.read_text(encoding="utf-8")
    read = csm.ShadowSettings.from_json if suffix == ".json" else csm.ShadowSettings.from_toml
    assert read(text) == settings


def test_what_stands_in_the_way_is_escaped_in_html(found):
    odd = dataclasses.replace(found, obstacle="a < b & <script>")
    assert "a &lt; b &amp; &lt;script&gt;" in odd._repr_html_()
    assert "<script>" not in odd._repr_html_()
    assert "a < b & <script>" in str(odd)


# -- the commands ----------------------------------------------------------------------------------

WORDS = ["recommend", "plane_and_box", "--sun", "diagonal", "--size", "160x90", "--quiet"]


def test_commands_hand_settings_on(tmp_path, capsys):
    path = tmp_path / "box.toml"
    assert cli.main([*WORDS, "--out", str(path)]) == 0
    written = csm.Recommendation.load(path)
    out = tmp_path / "pictures"
    words = ["render", "plane_and_box", "--size", "64x36", "--quiet", "--out", str(out)]
    assert cli.main([*words, "--settings", str(path), "--set", "map_size=64"]) == 0
    used = json.loads((out / "summary.json").read_text())["settings"]
    assert csm.ShadowSettings(**used) == written.settings.replace(map_size=64).canonical()
    capsys.readouterr()
    assert cli.main([*words, "--settings", str(tmp_path / "no.toml")]) == 2
    (tmp_path / "bad.json").write_text('{"filtre": "pcf"}')
    assert cli.main([*words, "--settings", str(tmp_path / "bad.json")]) == 2
    told = capsys.readouterr().err
    assert "bad.json" in told
    assert "did you mean 'filter'" in told


@pytest.mark.parametrize(
    ("words", "match"),
    [
        (["--out", "box.yaml"], "--out must end in .json or .toml"),
        (["--out", "nowhere/box.toml"], "its folder is not there"),
        (["--export", "cryengine"], "--export must be one of threejs"),
        (["--export", "unity=nowhere/a.cs"], "--export unity nowhere/a.cs"),
        (["--export", "unity", "--export", "unity"], "--export unity is given twice"),
        (["--export", "unity="], "--export unity must name a file"),
        (
            ["--export", "unity=a.cs", "--export", "godot=./a.cs"],
            "unity and --export godot name one",
        ),
        (["--out", "a.toml", "--export", "unity=a.toml"], "--out and --export unity name one file"),
    ],
)
def test_bad_words_are_refused_before_any_work(tmp_path, monkeypatch, capsys, words, match):
    monkeypatch.chdir(tmp_path)
    assert cli.main([*WORDS, *words]) == 2
    assert match in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_what_the_command_prints_as_json_is_read(tmp_path, capsys):
    path = tmp_path / "told.json"
    assert cli.main([*WORDS, "--json", "--export", "unity", "--verify"]) == 0
    path.write_text(capsys.readouterr().out)
    assert {"verification", "exports"} <= json.loads(path.read_text()).keys()
    read = csm.Recommendation.load(path)
    assert read.settings == csm.ShadowSettings.from_dict(json.loads(path.read_text())["settings"])
    assert not {"verification", "exports"} & read.to_dict().keys()


def test_command_exports(tmp_path, capsys):
    path = tmp_path / "shadows.gd"
    assert cli.main([*WORDS, "--export", "filament", "--export", f"godot={path}"]) == 0
    told = capsys.readouterr().out
    assert "options.mapSize = " in told
    assert "directional_shadow_max_distance" in told
    assert "light.directional_shadow_max_distance = " in path.read_text()
    assert cli.main([*WORDS, "--json", "--export", "unity"]) == 0
    exported = json.loads(capsys.readouterr().out)["exports"]["unity"]
    assert exported["settings"]["shadowDistance"]["unit"] == "m"
    assert exported["missing"]["fit"]
