"""The plugin in somebody else's suite: found by pytest, passes, fails with evidence."""

import json
import os
import shutil
import subprocess
import sys
from importlib.metadata import entry_points

import numpy as np
import pytest

import csm
from csm.digests import scene_digest
from csm.pytest_plugin import assert_shadows_match, evidence_folder, write_evidence
from csm.records import load_settings
from csm.sweep_cases import camera_from_text, sun_from_text

pytest.importorskip("embreex", reason="the plugin compares with the truth (extra: truth)")

SUITE = """
import os

import csm
import pytest

SCENE = csm.scenes.plane_and_box()
CAMERA = csm.Camera.look_at((-7, 5, 1), (-1, 0.5, -0.7), fov_y_deg=40, far=100, size=(64, 48))
SUN = csm.Sun.from_compass(125, 35)
GOOD = csm.ShadowSettings(map_size=256)
OURS = GOOD.replace(bias=os.environ["OUR_BIAS"])


def test_our_shadows(shadow_case):
    case = shadow_case(SCENE, CAMERA, SUN, GOOD)
    assert case.report.disagreement < 0.05
    case.check(max_error=0.05, causes={"false_shadow": 0.01})


def test_without_bias(shadow_case):
    shadow_case(SCENE, CAMERA, SUN, OURS).check(max_error=0.05, causes={"false_shadow": 0.01})


@pytest.mark.parametrize("name", ["a/b c", "a_b_c"])
def test_two_cases(shadow_case, name):
    cases = [shadow_case(SCENE, CAMERA, SUN, OURS.replace(map_size=size)) for size in (64, 128)]
    wrong = 0
    for case in cases:
        try:
            case.check(max_error=0.05)
        except AssertionError:
            wrong += 1
    assert not wrong


@pytest.mark.parametrize("words", [
    ("plane_and_box", CAMERA, SUN), (SCENE, "corner", SUN), (SCENE, CAMERA, "noon"),
    (SCENE, CAMERA, SUN, {"map_size": 64}),
])
def test_names(shadow_case, words):
    with pytest.raises(TypeError, match="(scene|camera|sun|settings) must be a csm"):
        shadow_case(*words)
"""


def test_pytest_finds_the_plugin():
    found = entry_points(group="pytest11", name="csm")
    assert [one.value for one in found] == ["csm.pytest_plugin"]


def run_suite(tmp_path, bias):
    (tmp_path / "test_engine.py").write_text(SUITE)
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--shadow-evidence",
         "left", str(tmp_path)],
        cwd=tmp_path, capture_output=True, text=True, timeout=100,
        env=os.environ | {"OUR_BIAS": bias},
    ).stdout  # fmt: skip


def test_a_suite_fails_with_evidence_that_goes_when_it_passes(tmp_path):
    text = run_suite(tmp_path, "manual")
    assert "3 failed, 5 passed" in text, text
    assert "shadows do not match" in text
    assert "false_shadow" in text
    pictures = ("rendered", "reference", "difference")
    files = {
        *(f"{name}.png" for name in pictures), *(f"{name}.npy" for name in pictures),
        "settings.json", "numbers.json",
    }  # fmt: skip
    left = sorted((tmp_path / "left").iterdir())
    assert len(left) == 3, "a folder for each test that failed, whatever its name"
    assert all({path.name for path in folder.iterdir()} - {"case_2"} == files for folder in left)
    assert [(folder / "case_2").is_dir() for folder in left] == [True, True, False]
    sizes = [
        json.loads((folder / "settings.json").read_text())["settings"]["map_size"]
        for folder in (left[0], left[0] / "case_2")
    ]
    assert sizes == [64, 128]
    assert "test_without_bias" in left[2].name

    (left[2] / "note.txt").write_text("mine")
    text = run_suite(tmp_path, "auto")
    assert "8 passed" in text, text
    assert [path.name for path in tmp_path.glob("left/**/*") if path.is_file()] == ["note.txt"]
    assert [path.name for path in tmp_path.glob("left/*")] == [left[2].name]


def test_evidence_is_enough_to_repeat(tmp_path, renderer):
    scene = csm.scenes.plane_and_box()
    camera = csm.Camera.look_at((-7, 5, 1), (-1, 0.5, -0.7), fov_y_deg=40, far=100, size=(64, 48))
    sun = csm.Sun(csm.Sun.from_compass(125, 35).to_light, 2.0)
    settings = csm.ShadowSettings(map_size=256, bias="manual")
    frame = renderer.render(scene, camera, sun, settings)
    truth = csm.truth(scene, camera, sun, rays_per_pixel=4)
    with pytest.raises(AssertionError, match="do not match"):
        assert_shadows_match(frame, truth, max_error=0.0, folder=tmp_path)
    kept = json.loads((tmp_path / "settings.json").read_text())
    assert csm.ShadowSettings.from_dict(kept["settings"]) == settings
    assert load_settings(tmp_path / "settings.json") == settings
    assert kept["scene"] == {
        "name": scene.name, "digest": scene_digest(scene), "triangles": scene.triangle_count,
    }  # fmt: skip
    again = camera_from_text(json.dumps(kept["camera"])), sun_from_text(json.dumps(kept["sun"]))
    repeated = renderer.render(scene, *again, settings)
    np.testing.assert_array_equal(repeated.mask, np.load(tmp_path / "rendered.npy"))
    traced = csm.truth(scene, *again, rays_per_pixel=kept["rays_per_pixel"])
    np.testing.assert_array_equal(traced.mask, np.load(tmp_path / "reference.npy"))


def test_masks_of_any_engine_are_judged(tmp_path):
    truth = np.ones((4, 5))
    mask = truth.copy()
    assert_shadows_match(mask, truth, max_error=0.0)
    mask[1, 1] = 0.0
    assert_shadows_match(mask, truth, max_error=0.05, causes={"false_shadow": 0.05})
    with pytest.raises(AssertionError, match=r"disagreement 5\.0000% > 1\.0000%"):
        assert_shadows_match(mask, truth, max_error=0.01, folder=tmp_path)
    with pytest.raises(AssertionError, match="false_shadow 5"):
        assert_shadows_match(
            mask, truth, max_error=1.0, causes={"false_shadow": 0.0}, folder=tmp_path
        )
    with pytest.raises(AssertionError, match=str(tmp_path / "here")):
        assert_shadows_match(mask, truth, max_error=0.0, folder=tmp_path / "here")
    assert (tmp_path / "here" / "difference.png").stat().st_size > 50


def test_of_two_failures_the_last_ones_evidence_is_left(tmp_path, renderer):
    scene = csm.scenes.plane_and_box()
    sky = csm.Camera.look_at((0, 5, 9), (0, 50, 9.1), up=(0, 0, 1), far=50, size=(8, 8))
    sun = csm.Sun((1, 1, 0))
    frame, truth = renderer.render(scene, sky, sun), csm.truth(scene, sky, sun)
    with pytest.raises(AssertionError, match=f"nothing was judged; see {tmp_path}"):
        assert_shadows_match(frame, truth, max_error=0.0, folder=tmp_path)
    assert (tmp_path / "settings.json").exists()
    assert (tmp_path / "rendered.png").exists()
    with pytest.raises(AssertionError, match="do not match"):
        assert_shadows_match(np.zeros((2, 3)), np.ones((2, 3)), max_error=0.0, folder=tmp_path)
    assert not (tmp_path / "settings.json").exists(), "of an array nothing is known"


def test_evidence_goes_where_the_running_test_leaves_it(request):
    folder = evidence_folder(request.config, request.node.nodeid)
    assert not folder.exists()
    try:
        with pytest.raises(AssertionError) as failed:
            assert_shadows_match(np.zeros((2, 3)), np.ones((2, 3)), max_error=0.0)
        assert str(folder) in str(failed.value)
        for name in ("rendered.png", "reference.png", "difference.png"):
            assert (folder / name).exists()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"max_error": -0.1}, "max_error.*-0.1"),
        ({"max_error": float("nan")}, "max_error.*nan"),
        ({"max_error": "1%"}, "max_error.*1%"),
        ({"max_error": 0.1, "causes": {"alias": 0.1}}, "no 'alias'; there are total"),
        ({"max_error": 0.1, "causes": {"aliasing": 0.1}}, "aliasing.*needs"),
        ({"max_error": 0.1, "causes": {"false_light": 2.0}}, "false_light.*2.0"),
    ],
)
def test_bad_limits_are_refused(limits, words):
    with pytest.raises(ValueError, match=words):
        assert_shadows_match(np.ones((2, 2)), np.ones((2, 2)), **limits)


def test_nothing_judged_is_no_success():
    nothing = csm.compare(np.ones((1, 1)), np.ones((1, 1)), valid=np.zeros((1, 1), bool))
    assert nothing.judged_count == 0
    dark = csm.truth(
        csm.scenes.plane_and_box(),
        csm.Camera.look_at((0, 5, 9), (0, 0, 0), far=50, size=(8, 8)),
        csm.Sun((0, -1, 0)),
    )
    with csm.Renderer() as renderer:
        frame = renderer.render(dark.scene, dark.camera, dark.sun, csm.ShadowSettings(map_size=64))
    with pytest.raises(AssertionError, match="nothing was judged"):
        assert_shadows_match(frame, dark, max_error=1.0)


def test_evidence_of_any_shape(tmp_path):
    write_evidence(tmp_path, {"maps": np.zeros((2, 3, 4)), "flat": np.eye(3)}, {"a": 1})
    assert {path.name for path in tmp_path.iterdir()} == {
        "maps.npy", "flat.npy", "flat.png", "settings.json",
    }  # fmt: skip


def test_masks_are_drawn_as_they_are(tmp_path):
    """A mask without shadow is white, not black; grey is where a difference is none."""
    from PIL import Image

    rendered, reference = np.ones((3, 4)), np.ones((3, 4))
    reference[0, 0] = 0.5
    write_evidence(tmp_path, {"rendered": rendered, "reference": reference})
    drawn = {
        name: np.asarray(Image.open(tmp_path / f"{name}.png").convert("L"))
        for name in ("rendered", "reference", "difference")
    }
    assert (drawn["rendered"] == 255).all()
    assert drawn["reference"][0, 0] == 128
    assert drawn["difference"][0, 0] == 191
    assert (drawn["difference"].ravel()[1:] == 128).all()
