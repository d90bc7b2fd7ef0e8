"""Files of cascades to check, and the command that judges them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from views import kinds, shifted

import csm
from csm import cli

DOCS = Path(__file__).resolve().parents[1] / "docs" / "check-format.md"
SUN = csm.Sun((0.35, 0.8, 0.25))
CAMERA = csm.Camera.look_at((3, 6, 9), (0, 4, -20), near=0.5, far=120, size=(160, 90))
SETTINGS = csm.ShadowSettings(fit="box", snap="none", map_size=256)


def example():
    (text,) = re.findall(r"```json\n(.*?)```", DOCS.read_text(), flags=re.DOTALL)
    return json.loads(text)


def run(tmp_path, content, *words):
    path = tmp_path / "cascades.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return cli.main(["check", str(path), *words])


def found_in(tmp_path, content):
    path = tmp_path / "cascades.json"
    path.write_text(json.dumps(content))
    cascades, cameras, options = csm.read_check(path)
    return csm.check_cascades(cascades, cameras, **options)


def test_the_example_of_the_docs_is_sound(tmp_path, capsys):
    assert run(tmp_path, example()) == 0
    out = capsys.readouterr().out
    assert out.startswith("2 cascades, 1 frame, select interval: sound\n")


def test_a_defect_is_told_and_exits_with_1(tmp_path, capsys):
    content = example()
    content["frames"][0]["clip_from_world"][1][3] = 0.5
    assert run(tmp_path, content) == 1
    assert "\noverflow: cascade 1\n" in capsys.readouterr().out
    assert run(tmp_path, content, "--quiet") == 1
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("select", ["interval", "map"])
@pytest.mark.parametrize("orthographic", [False, True])
def test_what_is_written_gives_the_same_check(tmp_path, select, orthographic):
    camera = CAMERA
    if orthographic:
        camera = csm.Camera.orthographic((0, 5, 0), (10, 0, -30), height=20, near=1, far=80)
    cameras = [camera.translated((0.3 * i, 0, 0)) for i in range(3)]
    sets = [shifted(csm.fit_cascades(c, SUN, SETTINGS), 2, 30) for c in cameras]
    scene = csm.scenes.plane_and_box()
    points = camera.eye + camera.backward * [[-5.0], [-20.0]]
    options = {"select": select, "scene": scene, "receivers": points, "border_texels": 1.5}
    for chosen in ({"select": select}, options):
        path = tmp_path / "path.json"
        csm.write_check(path, sets, cameras, **chosen)
        read, read_cameras, more = csm.read_check(path)
        assert read_cameras == cameras
        again = csm.check_cascades(read, read_cameras, **more)
        check = csm.check_cascades(sets, cameras, **chosen)
        assert again.problems == check.problems
        assert np.array_equal(again.utilisation, check.utilisation)
        assert np.array_equal(again.overlap, check.overlap)


def test_matrices_by_columns_are_those_by_rows(tmp_path):
    content = example()
    rows = np.array(content["frames"][0]["clip_from_world"]).reshape(-1, 4, 4)
    for turned in (rows.transpose(0, 2, 1), rows.transpose(0, 2, 1).reshape(-1, 16)):
        content |= {"layout": "columns"}
        content["frames"][0]["clip_from_world"] = turned.tolist()
        assert found_in(tmp_path, content).ok


def test_opengl_depth_is_the_same_cascade(tmp_path):
    content = example() | {"clip_z": [-1, 1]}
    for matrix in content["frames"][0]["clip_from_world"]:
        matrix[8:12] = [0, -0.0625, 0, 0]
    assert found_in(tmp_path, content).ok


@pytest.mark.parametrize("defect", [False, True])
def test_a_left_handed_world_is_mirrored(tmp_path, defect):
    right = example()
    right["scene_bounds"] = [[-30, 0, -18], [30, 4, 5]]
    right["receivers"] = [[0, 1, -10], [1, 2, -3]]
    if defect:
        right["frames"][0]["clip_from_world"][1][7] = -1.6
    left = json.loads(json.dumps(right)) | {"handedness": "left"}
    left["scene_bounds"] = [[-30, 0, -5], [30, 4, 18]]
    left["receivers"] = [[0, 1, 10], [1, 2, 3]]
    left["frames"][0]["camera"]["forward"] = [0, 0, 1]
    for matrix in left["frames"][0]["clip_from_world"]:
        for row in range(4):
            matrix[4 * row + 2] *= -1
    one, other = found_in(tmp_path, right), found_in(tmp_path, left)
    assert one.problems == other.problems
    assert one.ok != defect
    assert np.allclose(one.utilisation, other.utilisation)


def test_a_path_is_a_list_of_frames(tmp_path):
    content = example()
    frames = []
    for step in range(4):
        frame = json.loads(json.dumps(content["frames"][0]))
        frame["comment"] = f"step {step}"
        frame["camera"]["eye"] = [0.01 * step, 2, 0]
        for matrix, scale in zip(frame["clip_from_world"], (0.125, 0.04), strict=True):
            matrix[3] = -0.01 * step * scale  # windows that follow the camera freely
        frames.append(frame)
    content["frames"] = frames
    check = found_in(tmp_path, content)
    assert kinds(check) == {"lattice"}
    assert {problem.frame for problem in check.problems} == {1, 2, 3}


def without(content, key):
    return {name: value for name, value in content.items() if name != key}


def frame_with(**changes):
    content = example()
    content["frames"][0] |= changes
    return content


def camera_with(**changes):
    content = example()
    camera = content["frames"][0]["camera"] | changes
    content["frames"][0]["camera"] = {k: v for k, v in camera.items() if v is not None}
    return content


BAD = {
    "not JSON": ("{", "not a JSON file"),
    "a list": ([], "the file must be an object"),
    "no format": (without(example(), "format"), "the file needs format"),
    "a later format": (example() | {"format": "csm check 9"}, "format must be"),
    "a misspelt key": (example() | {"spilts": [1, 2]}, "'spilts'; did you mean 'splits'?"),
    "no frames": (example() | {"frames": []}, "at least one frame"),
    "an unknown layout": (
        example() | {"layout": "row-major"},
        "layout must be one of rows, columns",
    ),
    "no splits": (without(example(), "splits"), "frames[0] needs splits"),
    "splits that fall": (example() | {"splits": [6, 5, 4]}, "frames[0]: splits must ascend"),
    "the other layout": (
        frame_with(clip_from_world=[[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 4, 5, 1]] * 2),
        'say "layout": "columns"',
    ),
    "15 numbers": (frame_with(clip_from_world=[[1] * 15]), "16 numbers"),
    "words": (frame_with(clip_from_world="none"), "array of real numbers"),
    "a missing near": (camera_with(near=None), "camera needs near"),
    "a bad near": (camera_with(near=-1), "near must be > 0"),
    "two directions": (camera_with(target=[0, 0, 0]), "either target"),
    "two lenses": (camera_with(height=3), "either fov_y_deg"),
    "an eye of two": (camera_with(eye=[0, 2]), "camera.eye must be 3 numbers"),
    "bounds upside down": (
        example() | {"scene_bounds": [[1, 1, 1], [0, 0, 0]]},
        "lower and the upper corner",
    ),
    "a word for pancake": (example() | {"pancake": "yes"}, "pancake must be true or false"),
    "a border too wide": (example() | {"border_texels": 600}, "border_texels must be less"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_with_one_sentence(tmp_path, capsys, name):
    content, sentence = BAD[name]
    assert run(tmp_path, content) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert line.startswith("csm: ")
    assert sentence in line


def test_a_missing_file_is_refused(tmp_path, capsys):
    assert cli.main(["check", str(tmp_path / "none.json")]) == 2
    assert "none.json" in capsys.readouterr().err


def test_a_file_that_cannot_be_written_right_is_not(tmp_path):
    cascades = csm.fit_cascades(CAMERA, SUN, SETTINGS)
    path = tmp_path / "out.json"
    with pytest.raises(ValueError, match="select must be"):
        csm.write_check(path, cascades, CAMERA, select="depth")
    with pytest.raises(TypeError, match="camera must be"):
        csm.write_check(path, cascades, None)
    assert not path.exists()
