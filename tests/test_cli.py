"""The command line: files that are complete, refusals that are one sentence and leave nothing."""

import io
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

import csm
from csm import cli, results
from csm.arguments import find_camera, find_scene, find_sun, parse_settings, parse_size
from csm.progress import Progress

for package in ("embreex", "PIL", "trimesh"):
    pytest.importorskip(package, reason="the command line is tested with every extra it uses")

SMALL = ("--size", "96x64", "--set", "map_size=256")
ALL_FILES = {
    "picture.png",
    "mask.png",
    "cascades.png",
    "maps.png",
    "error.png",
    "frame.npz",
    "summary.json",
}


def files(folder):
    return {path.name for path in folder.iterdir()} if folder.exists() else None


def run(*words):
    return cli.main([str(word) for word in words])


def small_frame():
    """A frame with what `write_results` needs, and a summary."""
    scene = csm.scenes.plane_and_box()
    camera = scene.cameras["corner"].replace(size=(8, 8))
    settings = csm.ShadowSettings(map_size=16)
    with csm.Renderer() as renderer:
        frame = renderer.render(
            scene, camera, scene.suns["diagonal"], settings, outputs=cli.OUTPUTS
        )
    return frame, {"csm": csm.__version__}


def refused(capsys, *words):
    """The one line on stderr that an exit status of 2 comes with."""
    assert run(*words) == 2
    captured = capsys.readouterr()
    lines = captured.err.splitlines()
    assert lines[-1].startswith("csm")
    assert not any(line.startswith(("csm", "usage")) for line in lines[:-1])
    assert "Traceback" not in captured.err
    return lines[-1]


# ------------------------------------------------------------------------------------------- render


def test_render_writes_what_the_api_gives(gl, tmp_path, capsys):
    out = tmp_path / "deep" / "out"
    words = ("--camera", "corner", "--sun", "diagonal", "--truth", "--out", out, *SMALL)
    assert run("render", "plane_and_box", *words) == 0
    assert files(out) == ALL_FILES

    scene = csm.scenes.plane_and_box()
    camera, sun = scene.cameras["corner"].replace(size=(96, 64)), scene.suns["diagonal"]
    with csm.Renderer() as renderer:
        frame = renderer.render(scene, camera, sun, csm.ShadowSettings(map_size=256))
    truth = csm.truth(scene, camera, sun)
    report = csm.compare(frame, truth)
    with np.load(out / "frame.npz", allow_pickle=False) as saved:
        for name in ("mask", "valid", "view_depth", "cascade_index", "shadow_maps"):
            assert saved[name].tobytes() == getattr(frame, name).tobytes(), name
        assert saved["normal"].shape == (64, 96, 3)
        assert np.array_equal(saved["clip_from_world"], frame.cascades.clip_from_world)
        assert np.array_equal(saved["truth_mask"], truth.mask)
        assert np.array_equal(saved["judged"], report.judged)

    summary = json.loads((out / "summary.json").read_text())
    assert summary["error"]["disagreement"] == report.disagreement
    signs = ("total", "too_bright", "too_dark")
    assert summary["error"]["mean"] == {name: report.mean[name] for name in signs}
    assert summary["settings"]["map_size"] == 256
    assert summary["camera"]["name"] == "corner"
    assert summary["camera"]["size"] == [96, 64]
    assert summary["sun"]["to_light"] == sun.to_light.tolist()
    assert summary["csm"] == csm.__version__
    assert summary["info"]["renderer"] == frame.info["renderer"]
    assert summary["timings_ms"].keys() == frame.timings_ms.keys()
    assert len(summary["cascades"]) == 4

    captured = capsys.readouterr()
    assert f"{report.mean['total']:8.3%}" in captured.out
    assert max(map(len, captured.out.splitlines()[:-1])) <= 80
    stages = [line.split(" …")[0] for line in captured.err.splitlines()]
    assert stages == [
        "loading plane_and_box", "rendering", "tracing the truth", "judging", "writing",
    ]  # fmt: skip


def test_pictures_have_the_pixels_asked_for(gl, tmp_path):
    from PIL import Image

    assert run("render", "stairs", "--out", tmp_path, "--truth", "--quiet", *SMALL) == 0
    for name in ("picture", "mask", "cascades", "error"):
        with Image.open(tmp_path / f"{name}.png") as image:
            assert image.size == (96, 64)
            assert image.mode == "RGB"


def test_a_second_run_replaces_its_own_files_alone(gl, tmp_path, capsys):
    words = ("render", "plane_and_box", "--out", tmp_path, *SMALL)
    assert run(*words, "--truth") == 0
    (tmp_path / "notes.txt").write_text("mine")
    assert run(*words, "--set", "filter=none", "--quiet") == 0
    # No truth, no error.png; no maps, no maps.png: those of the first run would tell of another.
    assert files(tmp_path) == ALL_FILES - {"error.png", "maps.png"} | {"notes.txt"}
    assert "error" not in json.loads((tmp_path / "summary.json").read_text())
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_soft_truth_has_penumbrae(gl, tmp_path):
    words = ("--sun", "1,1,0", "--sun-diameter", "10", "--truth", "--rays", "16", "--quiet")
    assert run("render", "plane_and_box", *words, "--out", tmp_path, *SMALL) == 0
    with np.load(tmp_path / "frame.npz") as saved:
        soft = saved["truth_mask"]
        assert ((soft > 0) & (soft < 1)).any()
    assert json.loads((tmp_path / "summary.json").read_text())["truth"]["rays_per_pixel"] == 16


def test_cameras_and_suns_of_a_scenes_file_go_by_name(gl, tmp_path):
    (tmp_path / "tent.obj").write_text(
        "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv 0 1 0\nf 1 3 2\nf 1 4 3\nf 1 2 5\nf 3 4 5\n"
    )
    views = {"eye": [3, 2, 4], "at": [0, 0.3, 0], "fov_y_deg": 40, "near": 0.1, "far": 50}
    entry = {
        "file": "tent.obj",
        "cameras": {"door": views},
        "suns": {"noon": {"to_light": [1, 2, 0]}},
    }
    (tmp_path / "scenes.json").write_text(json.dumps({"tent": entry}))
    out = tmp_path / "out"
    words = ("--camera", "door", "--sun", "noon", "--ground", "-0.5", "--out", out)
    assert run("render", tmp_path / "tent.obj", *words, "--quiet", *SMALL) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["camera"]["eye"] == [3, 2, 4]
    assert summary["scene"]["triangles"] == 6
    assert summary["scene"]["bounds"][0][1] == -0.5
    with np.load(out / "frame.npz") as saved:
        assert saved["mask"].min() == 0


def test_info_tells_of_every_back_end(gl, capsys):
    assert run("info") == 0
    lines = capsys.readouterr().out.splitlines()
    found = {b["name"]: b for b in csm.backends()}
    assert [line.split(":")[0] for line in lines if not line.startswith(" ")] == list(found)
    for name, backend in found.items():
        line = next(line for line in lines if line.startswith(f"{name}:"))
        assert line.endswith("available" if backend["available"] else backend["reason"][-20:])
    text = "\n".join(lines)
    assert "version " in text
    assert "max texture size" in text


@pytest.mark.parametrize(
    "words", [["--help"], ["render", "--help"], ["info", "--help"], ["--version"]]
)
def test_help_and_version(words, capsys):
    assert cli.main(words) == 0
    assert csm.__version__ in (out := capsys.readouterr().out) or "usage: csm" in out


def test_python_m_csm_is_csm():
    done = subprocess.run(
        [sys.executable, "-m", "csm", "--version"], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, f"csm {csm.__version__}\n")


# ----------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["townn"], "SCENE must be a file or one of .*did you mean 'town'"),
        (["gone.glb"], "gone.glb: no such file"),
        (["broken.obj"], "broken.obj: "),
        (["broken.npz"], "broken.npz"),
        (["town", "--camera", "nowhere"], "--camera must be one of street.*got 'nowhere'"),
        (["town", "--camera", "eye=1,2,3"], "needs target=x,y,z"),
        (["town", "--camera", "eye=1,2,target=0,0,0"], "--camera eye must be 3 numbers.*'1,2'"),
        (["town", "--camera", "eye=1,2,3,target=1,2,3"], "target must differ from eye"),
        (["town", "--camera", "eye=1,2,3,target=0,0,0,zoom=2"], "'zoom' is unknown"),
        (["town", "--camera", "eye=1,2,3,eye=0,0,0"], "'eye' is twice"),
        (["town", "--camera", "eye=1,2,3,target=0,0,0,near=-1"], "near must be > 0"),
        (["town", "--camera", "eye=1,2,3,target=0,0,0,near=9,far=2"], "far must be > near"),
        (["town", "--camera", "eye=1,2,3,target=0,0,0,fov=190"], "fov_y_deg must be an angle"),
        (["town", "--sun", "dawn"], "--sun must be one of .*got 'dawn'"),
        (["town", "--sun", "0,0,0"], "to_light must not be the zero vector"),
        (["town", "--sun", "1"], "--sun must be 2 or 3 numbers.*got '1'"),
        (["town", "--sun", "10,95"], "elevation_deg must be a number from -90 to 90.*95"),
        (["town", "--sun", "1,nan,0"], "--sun must be 2 or 3 numbers"),
        (["town", "--sun-diameter", "200"], "angular_diameter_deg must be .*200"),
        (["gone.glb", "--ground", "nan"], "--ground must be a finite height in metres .*nan"),
        (["gone.glb", "--sun-diameter", "-1"], "--sun-diameter: angular_diameter_deg must"),
        (["town", "--size", "1280"], "--size must be WIDTHxHEIGHT.*'1280'"),
        (["town", "--set", "map_size"], "--set takes key=value.*'map_size'"),
        (["town", "--set", "map_sise=4"], "knows no 'map_sise'; did you mean 'map_size'"),
        (["town", "--set", "lam=0.2", "--set", "lam=0.3"], "--set lam is given twice"),
        (["town", "--set", "lam=2"], "lam must be .*got 2"),
        (["town", "--set", "filter=pfc"], "filter must be one of: hard none pcf.*'pfc'"),
        (["town", "--set", "cascade_count=9"], "cascade_count must be .*9"),
        (["town", "--set", "map_size=70000"], "70000"),
        (["town", "--set", "pancake=maybe"], "pancake must be true or false.*'maybe'"),
        (["town", "--set", "lam=0.2", "--ground", "up"], "--ground: invalid float value: 'up'"),
        (["town", "--rays", "4"], "--rays needs --truth"),
        (["town", "--backend", "vulkan"], "invalid choice: 'vulkan'"),
        (["town", "--outt", "x"], "unrecognized arguments: --outt x"),
    ],
    ids=lambda value: "_".join(value).replace("--", "") if isinstance(value, list) else "",
)
def test_bad_input_is_one_sentence_and_writes_nothing(
    gl, tmp_path, monkeypatch, capsys, words, sentence
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.obj").write_text("v 0 0 0\nf 1 2 3\n")
    (tmp_path / "broken.npz").write_bytes(b"PK\x03\x04 not an archive")
    before = files(tmp_path)
    line = refused(capsys, "render", *words, "--out", "out")
    assert re.search(sentence, line), line
    assert files(tmp_path) == before


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--truth", "--rays", "0"], "--rays must be a whole number from 1 to 65536 .*'0'"),
        (["--truth", "--rays", "65537"], "--rays must be .*'65537'"),
        (["--truth", "--rays", "many"], "--rays must be .*'many'"),
        (["--size", "0x10"], "--size must be .*each 1 to 16384.*'0x10'"),
        (["--size", "64x16385"], "--size must be .*'64x16385'"),
        (["--size", "9" * 5000 + "x10"], "--size must be"),
        (["--out", ""], "--out must name a folder .*''"),
    ],
)
def test_bad_numbers_and_no_folder_are_refused_before_anything_is_loaded(
    tmp_path, monkeypatch, capsys, words, sentence
):
    def never(*_):
        raise AssertionError("loaded")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "find_scene", never)
    out = () if "--out" in words else ("--out", "out")
    line = refused(capsys, "render", "plane_and_box", *words, *out)
    assert re.search(sentence, line), line
    assert files(tmp_path) == set()


@pytest.mark.parametrize("words", [[], ["paint"], ["render"], ["render", "town"]])
def test_a_command_that_is_not_complete(capsys, words):
    assert "(see csm" in refused(capsys, *words)


def test_out_must_be_a_folder_that_can_be_written(tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    assert "is a file" in refused(capsys, "render", "town", "--out", tmp_path / "file")
    assert "not a folder" in refused(capsys, "render", "town", "--out", tmp_path / "file" / "in")
    assert (tmp_path / "file").read_text() == "mine"
    if os.getuid() != 0:  # root may write everywhere
        tmp_path.chmod(0o500)
        assert "written to" in refused(capsys, "render", "town", "--out", tmp_path / "new")


def test_an_unknown_back_end_in_the_environment(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("CSM_BACKEND", "vulkan")
    line = refused(capsys, "render", "plane_and_box", "--out", tmp_path / "out")
    assert "CSM_BACKEND must be one of auto, egl, osmesa, glfw (got 'vulkan')" in line
    assert files(tmp_path / "out") is None


def test_a_write_that_fails_leaves_what_was_there(gl, tmp_path, capsys, monkeypatch):
    words = ("render", "plane_and_box", *SMALL, "--out")
    assert run(*words, tmp_path / "old", "--quiet") == 0
    before = {p.name: p.read_bytes() for p in (tmp_path / "old").iterdir()}

    def full(path, picture):
        if path.name == "maps.png":
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(results, "save_png", full)
    for folder in ("old", "new"):
        assert "No space left" in refused(capsys, *words, tmp_path / folder)
    assert {p.name: p.read_bytes() for p in (tmp_path / "old").iterdir()} == before
    assert files(tmp_path) == {"old"}


@pytest.mark.parametrize("kind", [OSError, KeyboardInterrupt])
@pytest.mark.parametrize("last", ["before", "after"])
@pytest.mark.parametrize("step", range(1, 13))
def test_a_move_that_fails_is_undone(gl, tmp_path, monkeypatch, kind, last, step):
    # The first run leaves six files that the second moves aside, and it puts six in place: each
    # of those twelve moves fails once, before or after it happened.
    frame, summary = small_frame()
    old, new = tmp_path / "old", tmp_path / "made" / "new"
    results.write_results(old, frame, summary)
    (old / "error.png").write_bytes(b"of a run with the truth")
    (old / "picture.png").write_bytes(b"of an earlier run")
    (old / "maps.png").unlink()
    before = {path.name: path.read_bytes() for path in old.iterdir()}
    assert len(before) == 6
    replace = os.replace

    def failing(*names):
        nonlocal moves
        moves += 1
        if moves == count and last == "before":
            raise kind("stopped")
        replace(*names)
        if moves == count and last == "after":
            raise kind("stopped")

    monkeypatch.setattr(os, "replace", failing)
    moves, count = 0, step
    with pytest.raises(kind, match="stopped"):
        results.write_results(old, frame, summary)
    assert {path.name: path.read_bytes() for path in old.iterdir()} == before
    moves, count = 0, min(step, 6)
    with pytest.raises(kind, match="stopped"):
        results.write_results(new, frame, summary)
    assert files(tmp_path) == {"old"}, "neither the folder nor the one made above it"


def test_a_folder_in_the_place_of_a_file_is_no_file_to_replace(gl, tmp_path):
    (tmp_path / "mask.png").mkdir()
    (tmp_path / "mask.png" / "notes.txt").write_text("mine")
    with pytest.raises(IsADirectoryError, match=r"mask\.png there is a folder"):
        results.write_results(tmp_path, *small_frame())
    assert files(tmp_path) == {"mask.png"}
    assert files(tmp_path / "mask.png") == {"notes.txt"}


@pytest.mark.parametrize("where", ["truth", "write_results"])
def test_ctrl_c_is_130_and_writes_nothing(gl, tmp_path, capsys, monkeypatch, where):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, where, interrupt)
    assert run("render", "plane_and_box", "--truth", "--out", tmp_path / "out", *SMALL) == 130
    assert capsys.readouterr().err.endswith("\ncsm: interrupted, nothing written\n")
    assert files(tmp_path / "out") is None


def test_csm_traceback_shows_where_a_refusal_comes_from(tmp_path, monkeypatch):
    monkeypatch.setenv("CSM_TRACEBACK", "1")
    with pytest.raises(ValueError, match="SCENE must be"):
        run("render", "townn", "--out", tmp_path)


# -------------------------------------------------------------------------------------------- words


@pytest.fixture(scope="module")
def mapped():
    """A terrain at its place on the map."""
    heights = np.add.outer(np.zeros(3), [0.0, 10.0, 30.0])
    return csm.Scene.from_elevation(heights, 100.0, origin=(78600.0, 458000.0))


def test_a_described_camera_is_relative_to_the_georeference(mapped):
    name, camera = find_camera(mapped, "eye=5,20,300,target=0,10,0,fov=30,near=2", (64, 48))
    assert name is None
    expected = csm.Camera.look_at(
        (5, 20, 300), (0, 10, 0), fov_y_deg=30, near=2, far=camera.far, size=(64, 48)
    )
    assert np.array_equal(camera.eye, expected.eye + mapped.georeference)
    assert np.array_equal(camera.backward, expected.backward), "no digit lost to the offset"
    corners = np.stack(np.meshgrid(*mapped.bounds.T), axis=-1).reshape(-1, 3)
    depths = (corners - camera.eye) @ -camera.backward
    assert depths.max() <= camera.far, "far reaches all of the scene by default"


def test_up_and_far_of_a_described_camera(mapped):
    _, camera = find_camera(mapped, "eye=0,500,0, target=0,0,0, up=0,0,-1, far=1e3", (10, 10))
    assert camera.far == 1000.0
    assert camera.up == pytest.approx([0, 0, -1])


def test_without_a_word_the_scenes_first_views(mapped):
    scene = csm.scenes.plane_and_box()
    assert find_camera(scene, None, (10, 10))[0] == next(iter(scene.cameras))
    assert find_sun(scene, None)[0] == next(iter(scene.suns))
    for find, options in ((find_camera, [(10, 10)]), (find_sun, [])):
        with pytest.raises(ValueError, match=r"the scene brings no (camera|sun): give one with --"):
            find(mapped, None, *options)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0,45", (0, 1, -1)),  # north
        ("90,0", (1, 0, 0)),  # east
        ("180, 45", (0, 1, 1)),
        ("-0.4,0.8,.3", (-0.4, 0.8, 0.3)),
        ("+1,1e1,-0", (1, 10, 0)),
    ],
)
def test_suns_by_compass_or_direction(mapped, text, expected):
    name, sun = find_sun(mapped, text)
    assert name is None
    assert sun.to_light == pytest.approx(np.array(expected) / np.linalg.norm(expected), abs=1e-15)
    assert sun.angular_diameter_deg == 0.0
    assert find_sun(mapped, text, 0.5)[1].angular_diameter_deg == 0.5


def test_a_named_sun_keeps_its_disc_unless_told():
    scene = csm.scenes.plane_and_box()
    name = next(name for name, sun in scene.suns.items() if sun.angular_diameter_deg)
    assert find_sun(scene, name) == (name, scene.suns[name])
    assert find_sun(scene, name, 0.0)[1].angular_diameter_deg == 0.0


@pytest.mark.parametrize("word", ["--sun", "--ground"])
def test_a_value_may_begin_with_a_minus(word):
    assert cli._joined([word, "-1,0.5,2", "--quiet"]) == [f"{word}=-1,0.5,2", "--quiet"]
    assert cli._joined([word, "--quiet"]) == [word, "--quiet"]


def test_settings_take_the_type_of_their_defaults():
    words = [
        *("cascade_count=2", "map_size=512,1024", "lam=0.75", "filter=pcf", "filter_size=5"),
        *("receiver_plane=on", "bias=manual", "slope_bias=1"),
    ]
    settings = parse_settings(words)
    assert settings == csm.ShadowSettings(
        cascade_count=2,
        map_size=(512, 1024),
        lam=0.75,
        filter="pcf",
        filter_size=5,
        receiver_plane=True,
        bias="manual",
        slope_bias=1.0,
    )
    assert parse_settings([]) == csm.ShadowSettings()


def test_one_manual_split_is_a_list_of_one():
    words = ["split=manual", "cascade_count=2", "manual_splits=12.5"]
    assert parse_settings(words).manual_splits == (12.5,)


def test_sizes():
    assert parse_size("1280x720") == (1280, 720)
    assert parse_size(" 8X4 ") == (8, 4)


def test_a_made_scene_wins_over_a_folder_of_its_name(tmp_path, monkeypatch):
    """`csm render demo --out demo` must work the second time too."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stairs").mkdir()
    assert find_scene("stairs").name == "stairs"
    with pytest.raises(OSError, match="is a folder"):
        find_scene("./stairs")


def test_ground_is_relative_to_the_georeference(tmp_path):
    np.savez(
        tmp_path / "dem.npz",
        elevation=np.full((3, 3), 50.0),
        cell=10.0,
        easting0=7e4,
        northing0=4e5,
    )
    scene = find_scene(str(tmp_path / "dem.npz"), ground=-5.0)
    assert scene.bounds[0, 1] == scene.georeference[1] - 5.0


# ----------------------------------------------------------------------------------------- progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_progress_is_a_line_per_stage():
    stream = io.StringIO()
    with Progress(stream).stage("thinking") as advance:
        assert stream.getvalue() == "thinking …", "said when it begins"
        advance(0.5)
    assert re.fullmatch(r"thinking … \d\.\d s\n", stream.getvalue())


def test_progress_of_a_failure_leaves_the_line_clear():
    stream = io.StringIO()
    with pytest.raises(ValueError, match="no"), Progress(stream).stage("thinking"):
        raise ValueError("no")
    assert stream.getvalue() == "thinking …\n"


@pytest.mark.parametrize("rich_missing", [False, True], ids=["rich", "without_rich"])
def test_progress_on_a_terminal(monkeypatch, rich_missing):
    if rich_missing:
        monkeypatch.setitem(sys.modules, "rich.console", None)
    else:
        pytest.importorskip("rich")
    stream = Terminal()
    with Progress(stream).stage("thinking") as advance:
        advance(0.5)
        advance(1.0)
    assert re.search(r"thinking … \d\.\d s\n$", stream.getvalue())


def test_quiet_progress_says_nothing():
    stream = Terminal()
    with Progress(stream, quiet=True).stage("thinking") as advance:
        advance(1.0)
    assert stream.getvalue() == ""
