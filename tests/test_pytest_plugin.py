"""The plugin in somebody else's suite: found by pytest, passes, fails with evidence."""

import json
import subprocess
import sys
from importlib.metadata import entry_points

import numpy as np
import pytest

import csm
from csm.pytest_plugin import assert_shadows_match, write_evidence

pytest.importorskip("embreex", reason="the plugin compares with the truth (extra: truth)")

SUITE = """
import csm
import pytest

SCENE = csm.scenes.plane_and_box()
CAMERA = csm.Camera.look_at((-7, 5, 1), (-1, 0.5, -0.7), fov_y_deg=40, far=100, size=(64, 48))
SUN = csm.Sun.from_compass(125, 35)


def test_our_shadows(shadow_case):
    case = shadow_case(SCENE, CAMERA, SUN, csm.ShadowSettings(map_size=256))
    assert case.report.disagreement < 0.05
    case.check(max_error=0.05, causes={"false_shadow": 0.01})


def test_without_bias(shadow_case):
    shadow_case(SCENE, CAMERA, SUN, csm.ShadowSettings(map_size=256, bias="manual")).check(
        max_error=0.05, causes={"false_shadow": 0.01}
    )
"""


def test_pytest_finds_the_plugin():
    found = entry_points(group="pytest11", name="csm")
    assert [one.value for one in found] == ["csm.pytest_plugin"]


def test_a_suite_passes_and_fails_with_evidence(tmp_path):
    (tmp_path / "test_engine.py").write_text(SUITE)
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--shadow-evidence",
         "left", str(tmp_path)],
        cwd=tmp_path, capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert "1 failed, 1 passed" in run.stdout, run.stdout
    assert "shadows do not match" in run.stdout
    assert "false_shadow" in run.stdout
    left = {path.name for path in tmp_path.glob("left/*/*")}
    pictures = ("rendered", "reference", "difference")
    assert left == {
        *(f"{name}.png" for name in pictures), *(f"{name}.npy" for name in pictures),
        "settings.json", "numbers.json",
    }  # fmt: skip
    (folder,) = tmp_path.glob("left/*")
    assert "test_without_bias" in folder.name
    settings = json.loads((folder / "settings.json").read_text())
    assert csm.ShadowSettings(**settings) == csm.ShadowSettings(map_size=256, bias="manual")
    assert np.load(folder / "difference.npy").min() == -1.0


def test_masks_of_any_engine_are_judged(tmp_path):
    truth = np.ones((4, 5))
    mask = truth.copy()
    assert_shadows_match(mask, truth, max_error=0.0)
    mask[1, 1] = 0.0
    assert_shadows_match(mask, truth, max_error=0.05, causes={"false_shadow": 0.05})
    with pytest.raises(AssertionError, match=r"disagreement 5\.0000% > 1\.0000%"):
        assert_shadows_match(mask, truth, max_error=0.01)
    with pytest.raises(AssertionError, match="false_shadow 5"):
        assert_shadows_match(mask, truth, max_error=1.0, causes={"false_shadow": 0.0})
    with pytest.raises(AssertionError, match=str(tmp_path / "here")):
        assert_shadows_match(mask, truth, max_error=0.0, folder=tmp_path / "here")
    assert (tmp_path / "here" / "difference.png").stat().st_size > 50


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
