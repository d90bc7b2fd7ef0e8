"""`csm sweep`: the file it reads, the table it prints, the row it repeats."""

import csv
import json
import os
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("embreex", reason="csm sweep needs the extras truth and sweep")
pytest.importorskip("netCDF4", reason="csm sweep needs the extras truth and sweep")
pytest.importorskip("xarray", reason="csm sweep needs the extras truth and sweep")

import xarray

import csm
from csm import cli
from csm.sweep_command import read_sweep

FILE = """
size = [32, 24]
repeats = 1

[cases.box]
scene = "plane_and_box"
camera = ["corner", "contact"]
sun = "diagonal"

[base]
cascade_count = 2

[axes]
map_size = [64, 32]
[axes.technique]
sharp = { filter = "hard" }
soft = { filter = "pcf", filter_size = 5 }
"""


def run(*words):
    return cli.main(["sweep", *map(str, words)])


def written(tmp_path, text=FILE):
    path = tmp_path / "sweep.toml"
    path.write_text(text)
    return path


def refused(capsys, *words):
    """The one line on stderr of a refusal."""
    assert run(*words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_it_does_what_the_api_does(gl, tmp_path, capsys):
    out = tmp_path / "deep" / "out"
    assert run(written(tmp_path), "--out", out) == 0
    captured = capsys.readouterr()
    found = xarray.load_dataset(out / "sweep.nc")
    assert found.error_total.dims == ("case", "map_size", "technique")
    assert found.case.values.tolist() == ["box corner", "box contact"]
    here = csm.sweep(
        {"a": ("plane_and_box", "contact", "diagonal")},
        {"map_size": [32], "filter_size": [5]},
        base=csm.ShadowSettings(cascade_count=2, filter="pcf"),
        size=(32, 24),
        repeats=1,
    )
    there = found.sel(case="box contact", map_size=32, technique="soft")
    assert there.error_total.item() == here.error_total.item()
    assert there.key.item() == here.key.item()

    assert "box corner: 4 points, the most accurate first" in captured.out
    assert f"{there.disagreement.item():.3%}" in captured.out
    assert captured.out.splitlines()[-1] == f"{out}: points.csv, sweep.nc"
    assert captured.err.startswith("sweep of 8 points …")
    order = [line.split()[0] for line in captured.out.splitlines() if "%" in line][:4]
    assert order == sorted(order, key=lambda text: float(text.rstrip("%")))

    # Again it has nothing to do, and leaves what is there as it is.
    before = (out / "journal.jsonl").read_bytes(), (out / "points.csv").read_bytes()
    assert run(written(tmp_path), "--out", out, "--resume", "--quiet") == 0
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "")
    assert ((out / "journal.jsonl").read_bytes(), (out / "points.csv").read_bytes()) == before

    assert run("--out", out, "--repeat-row", 7) == 0
    captured = capsys.readouterr()
    assert "OTHER" not in captured.out
    assert captured.out.count("  same") == 8


def test_a_row_with_other_numbers_is_told(gl, tmp_path, capsys):
    assert run(written(tmp_path), "--out", tmp_path / "out", "--quiet") == 0
    table = tmp_path / "out" / "points.csv"
    with open(table, newline="") as file:
        rows = list(csv.DictReader(file))
    rows[2]["error_total"] = "0.5"
    with open(table, "w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    assert run("--out", tmp_path / "out", "--repeat-row", 2) == 1
    assert capsys.readouterr().out.count("OTHER") == 1


def test_files_and_grounds_lie_beside_it(gl, tmp_path):
    rows = "\n".join(f"v {x} {y} {z}" for x, y, z in ((0, 1, 0), (2, 1, 0), (0, 1, 2)))
    (tmp_path / "roof.obj").write_text(f"{rows}\nf 1 2 3\n")
    pytest.importorskip("trimesh", reason="files need the extra mesh")
    text = """
    size = [16, 12]
    repeats = 1
    rays_per_pixel = 4
    [cases.roof]
    scene = "roof.obj"
    camera = "eye=3,4,5,target=0,0,0"
    sun = ["238,33", "0.2,1,0.1"]
    ground = 0
    sun_diameter = 2
    [axes]
    map_size = [32]
    """
    assert run(written(tmp_path, text), "--out", tmp_path / "out", "--quiet") == 0
    found = xarray.load_dataset(tmp_path / "out" / "sweep.nc")
    assert found.case.values.tolist() == ["roof 238,33", "roof 0.2,1,0.1"]
    assert (found.status == "ok").all()
    cases = json.loads(found.attrs["cases"])
    assert cases["roof 238,33"]["ground"] == 0.0
    assert cases["roof 238,33"]["triangles"] == 3
    assert cases["roof 238,33"]["sun"]["angular_diameter_deg"] == 2.0
    assert run("--out", tmp_path / "out", "--repeat-row", 1, "--quiet") == 0


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("repeats = 1", "repeets = 1", "unknown key 'repeets'; there are cases, axes, base"),
        ("repeats = 1", "repeats = ", "Invalid value"),
        ("repeats = 1", "repeats = 0", "repeats must be"),
        ("[axes]\nmap_size = [64, 32]\n[axes.technique]", "[other]", "unknown key 'other'"),
        ("camera = [", "kamera = [", r"unknown key 'kamera' in [cases.box]; there are scene"),
        ('scene = "plane_and_box"', "", "[cases.box] must have a scene"),
        ('scene = "plane_and_box"', "scene = 3", "[cases.box] scene must be a text or a list"),
        ('"plane_and_box"', '"nowhere.glb"', "nowhere.glb"),
        ("cascade_count = 2", "cascade_count = 9", "[base]: cascade_count must be 1 to 8"),
        ('sun = "diagonal"', 'sun = "blue"', "cases: 'box corner': sun must be one of"),
        ("[base]", '["cases"."box corner"]\nscene = "stairs"\n[base]', "called 'box corner'"),
        ('["corner", "contact"]', '"nope"', "cases: 'box': camera must be one of corner"),
        ('["corner", "contact"]', '"eye=1,2"', "cases: 'box': camera eye must be 3 numbers"),
        ('"plane_and_box"', '"nowhere"', "cases: 'box corner': scene must be a file or one of"),
        ('sun = "diagonal"', 'ground = "x"', "[cases.box] ground must be a number (got 'x')"),
    ],
)
def test_a_wrong_file_is_one_sentence(tmp_path, capsys, old, new, text):
    assert old in FILE
    path = written(tmp_path, FILE.replace(old, new))
    line = refused(capsys, path, "--out", tmp_path / "out", "--quiet")
    assert text in line
    assert not (tmp_path / "out").exists()


def test_words_that_do_not_go_together(tmp_path, capsys):
    out = ("--out", tmp_path / "out")
    assert "needs a FILE.toml" in refused(capsys, *out)
    assert "give no FILE.toml" in refused(capsys, written(tmp_path), *out, "--repeat-row", 1)
    assert "points.csv" in refused(capsys, *out, "--repeat-row", 1)
    assert "nowhere.toml" in refused(capsys, tmp_path / "nowhere.toml", *out)
    (tmp_path / "file").write_text("")
    line = refused(capsys, written(tmp_path), "--out", tmp_path / "file")
    assert "is a file, not a folder" in line


def test_a_spoilt_journal_is_said_in_one_sentence(gl, tmp_path, capsys):
    out = tmp_path / "out"
    words = (written(tmp_path, FILE.replace("[64, 32]", "[32]")), "--out", out, "--quiet")
    assert run(*words) == 0
    journal = out / "journal.jsonl"
    whole = journal.read_text()
    journal.write_text("spoilt\n" + whole)
    capsys.readouterr()
    assert run(*words) == 0
    assert capsys.readouterr().err == (
        f"csm: {journal}: 1 line(s) held no record and are removed; "
        "what they stood for is computed again\n"
    )
    assert journal.read_text() == whole
    assert run(*words) == 0
    assert capsys.readouterr().err == ""


def test_the_help_shows_a_file_that_is_read(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "csm", "sweep", "--help"], capture_output=True, text=True, check=True
    ).stdout
    text = done[done.index("the file:\n") + 10 : done.index("examples:")]
    found = read_sweep(written(tmp_path, "\n".join(line.strip() for line in text.splitlines())))
    assert list(found["cases"]) == ["street street", "street roofs"]
    assert found["axes"] == {"map_size": [512, 1024, 2048], "filter": ["hard", "pcf"]}
    assert found["size"] == [480, 270]


def test_an_interrupt_says_where_the_rest_is(gl, tmp_path):
    many = FILE.replace("[64, 32]", str([16 + i for i in range(300)]))
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "csm", "sweep", written(tmp_path, many), "--out", out],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    start = time.monotonic()
    journal = out / "journal.jsonl"
    while not (journal.exists() and journal.read_bytes().count(b"\n") > 3):
        assert process.poll() is None
        assert time.monotonic() - start < 60
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert f"interrupted; what is finished is in {journal}" in errors
    assert "Traceback" not in errors
