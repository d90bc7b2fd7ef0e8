"""Paths on the command line: csm recommend with several cameras, several suns, or both."""

import json
import subprocess
import sys

import pytest

import csm
from csm import cli
from csm.arguments import find_cameras, find_suns

SIZE = (160, 90)
WORDS = ["recommend", "plane_and_box", "--size", "160x90", "--quiet"]
EYES = ("6,4.5,8", "6.04,4.5,8", "6.08,4.5,8")


def cameras(*eyes, more=""):
    """Words that describe a camera at each of the places."""
    return [f"--camera=eye={eye},target=-0.5,0.6,0{more}" for eye in eyes]


def told(capsys, *words):
    """What the command says as JSON."""
    capsys.readouterr()
    assert cli.main([*WORDS, *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_reader_that_has_gone_is_no_error():
    words = [sys.executable, "-m", "csm", *WORDS]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as command:
        command.stdout.close()  # as head does when it has its lines
        said = command.stderr.read()
        assert command.wait() == 141
    assert b"rror" not in said


def test_cameras_in_a_row_are_a_path(capsys):
    found = told(capsys, *cameras(*EYES), "--sun", "238,40")
    assert found["settings"]["snap"] == "exact"
    assert found["signals"]["camera_moves"]
    assert not found["signals"]["sun_moves"]
    eyes = [camera["eye"] for camera in found["path"]["cameras"]]
    assert eyes == [[float(x) for x in eye.split(",")] for eye in EYES], "in the order given"
    still = told(capsys, *cameras(*EYES[:1]), "--sun", "238,40")
    assert still["settings"]["snap"] == "none"
    again = told(capsys, *cameras(EYES[0], EYES[0]), "--sun", "238,40")
    assert again["settings"]["snap"] == "none", "one place twice is no motion"


def test_suns_in_a_row_are_a_path(capsys):
    suns = ["--sun", "-0.5,0.8,0.3", "--sun", "238,50", "--sun", "diagonal"]
    found = told(capsys, *suns, "--sun-diameter", "0.5")
    assert found["signals"]["sun_moves"]
    assert found["settings"]["light_basis"] == "world"
    assert [sun["angular_diameter_deg"] for sun in found["path"]["suns"]] == [0.5] * 3
    both = told(capsys, *cameras(*EYES[:2]), *suns[:4])
    assert both["signals"]["camera_moves"]
    assert both["signals"]["sun_moves"]


def test_as_many_of_both_or_one(capsys):
    assert cli.main([*WORDS, *cameras(*EYES), "--sun", "238,40", "--sun", "238,41"]) == 2
    assert "camera and sun must be as many, or one (got 3 and 2)" in capsys.readouterr().err
    assert cli.main([*WORDS, "--camera", "corner", "--camera", "cornr"]) == 2
    assert "did you mean 'corner'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--max-error", "2", "max_error"),
        ("--ground", "inf", "--ground must be a finite height in metres (got inf)"),
        ("--sun-diameter", "400", "--sun-diameter: angular_diameter_deg must be"),
    ],
)
def test_what_is_refused_is_refused_before_a_scene_is_looked_for(capsys, option, value, words):
    assert cli.main(["recommend", "missing.glb", option, value]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "missing" not in said


def test_a_path_is_judged_by_its_flicker_and_exported_for_its_first_view(capsys):
    # coarse maps, whose steps are seen in so small a picture
    words = [*cameras(*EYES), "--sun", "238,40", "--max-error", "0.02"]
    found = told(capsys, *words, "--verify", "--export", "unity")
    rows = {row["name"]: row for row in found["verification"]["rows"]}
    # of the shadow of a box that the camera creeps round, free windows change hundreds of points
    assert rows["snap"]["flicker"] > 10.0 * rows["recommended"]["flicker"]
    assert rows["snap"]["flicker"] > 0.0
    scene = csm.scenes.plane_and_box()
    path = find_cameras(scene, [word.partition("=")[2] for word in words[:3]], SIZE)
    sun = csm.Sun.from_compass(238, 40)
    same = csm.recommend(scene, path, sun, max_error=0.02)
    assert found["exports"]["unity"] == json.loads(json.dumps(same.export("unity").to_dict()))


def test_cameras_described_without_far_share_the_farthest():
    scene = csm.scenes.plane_and_box()
    near, far = "eye=6,4,8,target=0,0,0", "eye=60,4,8,target=0,0,0"
    alone = [find_cameras(scene, [text], SIZE)[0].far for text in (near, far)]
    assert alone[0] < alone[1]
    path = find_cameras(scene, [near, far, "corner", f"{near},far=9"], SIZE)
    assert [camera.far for camera in path[:2]] == [alone[1]] * 2
    assert path[2] == scene.cameras["corner"].replace(size=SIZE)
    assert path[3].far == 9.0


def test_nothing_named_is_the_scenes_first_view():
    scene = csm.scenes.plane_and_box()
    (camera,), (sun,) = find_cameras(scene, [], SIZE), find_suns(scene, [])
    assert camera == next(iter(scene.cameras.values())).replace(size=SIZE)
    assert sun == next(iter(scene.suns.values()))
    with pytest.raises(ValueError, match="--sun must be one of"):
        find_suns(scene, ["diagonal", "dawn"])
