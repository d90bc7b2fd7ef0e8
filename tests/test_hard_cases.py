"""The report of the hard cases: what is recorded, refused, tabled and shown."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hard_case_records import Recorder, cases_of, severity

from csm import cli, hard_case_page, hard_cases

TESTS = Path(__file__).resolve().parent
NUMERICS = TESTS.parent / "docs" / "numerics.md"

TOY = """
import numpy as np
import pytest

def test_f1_f2_both(figure):
    figure("F1", "small", 0.1, 1.0, "m", picture=np.zeros((2, 3), np.uint8))
    figure("F1", "small", 0.5, 1.0, "m", picture=lambda: np.full((2, 3, 3), 9, np.uint8))

def test_f1_larger(figure):
    figure("F1", "small", 0.5, 0.4, "m")

def test_s1_skipped():
    pytest.skip("not here")

def test_f9_is_no_case():
    assert False

def test_other():
    assert False

@pytest.mark.slow
def test_f2_long(figure):
    figure("F2", "long", 0, 0)
"""


@pytest.fixture
def toy(tmp_path):
    """A folder of tests with this suite's fixtures."""
    folder = tmp_path / "tests"
    folder.mkdir()
    for name in ("conftest.py", "hard_case_records.py", "scene_files.py"):
        (folder / name).write_text((TESTS / name).read_text())
    (folder / "test_toy.py").write_text(TOY)
    settings = '[pytest]\naddopts = -m "not slow"\nmarkers =\n    slow: slow\n    sweep: sweep\n'
    (tmp_path / "pytest.ini").write_text(settings)
    return folder


def test_every_case_stands_in_the_docs():
    section = NUMERICS.read_text(encoding="utf-8").split("## 16.")[1].split("\n## ")[0]
    rows = re.findall(r"^\| ([A-Z]\d) \|.*\|(.*)\|$", section, flags=re.MULTILINE)
    assert [case for case, _ in rows] == list(hard_cases.CASES)
    for case, files in rows:
        names = re.findall(r"`(test_\w+\.py)`", files)
        assert names, f"no test of {case} is named"
        for name in names:
            text = (TESTS / name).read_text()
            assert re.search(rf"def test(_[a-z]\d)*_{case.lower()}_", text), f"{name} has no {case}"


@pytest.mark.parametrize(
    ("name", "cases"),
    [
        ("test_f1_holds[3]", ("F1",)),
        ("test_f1_x2_holds", ("F1", "X2")),
        ("test_f1x_holds", ()),
        ("test_d16_depths", ()),
        ("test_z9_unknown", ()),
        ("test_a_box_f1_holds", ()),
    ],
)
def test_ids_in_names(name, cases):
    assert cases_of(name) == cases


def test_severity_orders_figures_of_different_tolerances():
    assert severity(0.5, 1.0) < severity(0.8, 1.0) < severity(2e-9, 1e-9) < severity(1, 0)
    assert severity(0.0, 0.0) == 0.0
    assert severity(float("nan"), 1.0) == np.inf
    assert severity(-1.0, 1e-9) < 0.0


def test_figures_check_and_keep_the_worst(toy):
    rows, driver = hard_cases.collect(toy, toy / "out")
    assert driver is None
    by_name = {(row.case, row.what): row for row in rows}
    small = by_name["F1", "small"]
    assert (small.worst, small.tolerance, small.unit, small.cases) == (0.5, 0.4, "m", 3)
    assert not small.passed
    assert small.test.endswith("test_f1_larger")
    assert small.picture is None, "of another case than the worst"
    failing = by_name["F1", hard_cases.TESTS_THAT_FAIL]
    assert (failing.worst, failing.cases, failing.passed) == (1, 2, False)
    both = by_name["F2", hard_cases.TESTS_THAT_FAIL]
    assert (both.worst, both.cases, both.passed) == (0, 1, True)
    skipped = by_name["S1", hard_cases.TESTS_THAT_FAIL]
    assert (skipped.cases, skipped.passed) == (0, False), "what is skipped has not passed"
    assert len(rows) == 4
    text = hard_case_page.table(rows)
    assert re.search(r"^FAIL +F1 +small +0\.5 +0\.4 +m +3 +none$", text, flags=re.MULTILINE)
    assert re.search(r"^FAIL +X1 +no test ran", text, flags=re.MULTILINE)
    more, _ = hard_cases.collect(toy, toy / "out", slow=True)
    assert ("F2", "long") in {(row.case, row.what) for row in more}


def test_pictures_are_of_the_worst_case(tmp_path):
    recorder = Recorder(tmp_path)
    recorder.add("F1", "one", 0.1, 1.0, "", "a", np.zeros((2, 3), np.uint8))
    recorder.add("F1", "one", 0.3, 1.0, "", "b", lambda: np.full((2, 3, 3), 9, np.uint8))
    recorder.add("F1", "one", 0.2, 1.0, "", "c", lambda: pytest.fail("drawn, but not the worst"))
    recorder.outcome("x.py::test_f1_one", "passed")
    recorder.write("somebody")
    (figure,) = json.loads((tmp_path / hard_cases.RECORDS).read_text())["figures"]
    assert (figure["test"], figure["cases"]) == ("b", 3)
    assert (tmp_path / figure["picture"]).read_bytes().startswith(b"\x89PNG")
    with pytest.raises(TypeError, match=r"picture: .*uint8"):
        recorder.add("F1", "two", 0.1, 1.0, "", "d", np.zeros((2, 3)))
    with pytest.raises(ValueError, match="'Z9' is no hard case"):
        recorder.add("Z9", "two", 0.1, 1.0, "", "d", None)


def row(**changes):
    values = {
        "case": "F1", "what": "a < b", "backend": "egl", "worst": 1.0, "tolerance": 2.0,
        "unit": "m", "cases": 3, "passed": True, "test": "t.py::test_f1_x", "picture": None,
    }  # fmt: skip
    return hard_cases.Row(**values | changes)


def test_the_page_stands_alone(tmp_path):
    picture = tmp_path / "p.png"
    picture.write_bytes(b"not really")
    rows = [row(picture=picture), row(worst=3.0, passed=False, what="worse")]
    text = hard_case_page.page(rows, {"egl": "some <driver>"}, version="1", slow=False)
    assert "a &lt; b" in text
    assert "some &lt;driver&gt;" in text
    assert "data:image/png;base64," in text
    assert not re.search(r"(src|href)='(?!data:|#)", text), "needs no other file"
    assert text.count("FAIL") == 1 + len(hard_cases.CASES) - 1
    path = hard_case_page.write_page(tmp_path / "new", text)
    assert path.read_text(encoding="utf-8") == text
    assert [each.name for each in path.parent.iterdir()] == ["hard_cases.html"]


def test_the_command_says_where_the_tests_are_missing(tmp_path, capsys):
    assert cli.main(["hard-cases", "--tests", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "no hard-case tests in" in error
    assert "not with an installed wheel" in error


def test_the_command_runs_prints_and_writes(toy, capsys, tmp_path):
    out = tmp_path / "pages"
    words = ["hard-cases", "--tests", str(toy), "--out", str(out), "--backend", "egl"]
    assert cli.main(words) == 1, "the toy fails"
    printed = capsys.readouterr().out
    assert str(out / "hard_cases.html") in printed
    assert "F1    small" in printed
    assert (out / "none" / hard_cases.RECORDS).exists()


def test_tests_that_cannot_run_are_no_figures(toy):
    (toy / "conftest.py").write_text("raise RuntimeError('broken')")
    with pytest.raises(hard_cases.CsmError, match=r"could not be run(.|\n)*broken"):
        hard_cases.collect(toy, toy / "out")


def test_the_option_is_quiet_without_a_folder(toy):
    # Without --hard-cases nothing is selected, drawn or written.
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(toy)],
        capture_output=True,
        text=True,
        check=False,
        cwd=toy.parent,
        env=os.environ,
    )
    assert "3 failed, 1 passed, 1 skipped" in done.stdout
    assert not list(toy.glob("**/*.png"))
