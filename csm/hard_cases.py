"""The matrix of hard cases: what is easy to get wrong, tested, with its worst figures.

The cases are tests (docs/numerics.md 16): this module runs those that carry an id of the matrix in
their names, once without OpenGL and once per back end, and makes a table and a page of what they
recorded.
"""

import base64
import html
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from .errors import CsmError

__all__ = [
    "CASES",
    "NO_BACKEND",
    "RECORDS",
    "Row",
    "collect",
    "find_tests",
    "missing",
    "page",
    "table",
    "write_page",
]

CASES = {
    "S1": "split distances",
    "S2": "splits of equal screen-space resolution",
    "F1": "smallest sphere of a slice",
    "F2": "diameter of a slice",
    "X1": "exact stabilisation",
    "X2": "exact stabilisation, rendered",
    "X3": "far from the world origin",
    "A1": "approximate stabilisation",
    "B1": "light basis",
    "C1": "coverage of the view",
    "C2": "selection of a cascade",
    "Q1": "one cascade for a quad of pixels",
    "Q2": "footprints across splits",
    "T1": "texture coordinates",
    "D1": "depth bias",
    "D2": "receiver planes towards edge-on",
    "D3": "depth range that moves",
    "V1": "filterable maps: bounds and rounding",
    "V2": "light behind two occluders",
    "L1": "warps",
    "M1": "transitions and fade",
    "Y1": "shifted spheres",
    "K1": "world-aligned light matrix",
    "G1": "culling of casters",
    "G2": "clipping to bounds",
    "R1": "geometry at the edge of what can be drawn",
    "W1": "extreme cameras",
}
RECORDS = "records.json"  # what one run of the tests leaves in its folder
NO_BACKEND = "none"
TESTS_THAT_FAIL = "tests that fail"


@dataclass(frozen=True)
class Row:
    """One line of the matrix: a check of a case, by one back end.

    Attributes
    ----------
    case, what, unit : str
    backend : str
        ``"none"`` for what needs no OpenGL.
    worst, tolerance : float
        The figure nearest to its tolerance, or farthest beyond, and that tolerance.
    cases : int
        Number of figures, or of tests.
    passed : bool
        Whether all of them were within their tolerances.
    test : str
        The test of the worst figure, as pytest names it.
    picture : Path or None
    """

    case: str
    what: str
    backend: str
    worst: float
    tolerance: float
    unit: str
    cases: int
    passed: bool
    test: str
    picture: Path | None


def find_tests(folder=None):
    """Folder of the tests of the hard cases.

    Parameters
    ----------
    folder : path-like, optional
        By default ``tests`` beside the package, as in a checkout, then ``tests`` in the current
        folder.

    Returns
    -------
    folder : Path

    Raises
    ------
    FileNotFoundError
        If there are none: an installed wheel holds the package alone.
    """
    beside = [Path(__file__).resolve().parents[1] / "tests", Path.cwd() / "tests"]
    for candidate in beside if folder is None else [Path(folder)]:
        if (candidate / "hard_case_records.py").exists():
            return candidate.resolve()
    where = "beside the package or in this folder" if folder is None else f"in {folder}"
    raise FileNotFoundError(
        f"no hard-case tests {where}: they come with a checkout or the source distribution, not "
        "with an installed wheel; --tests names their folder"
    )


def collect(tests, folder, *, backend=NO_BACKEND, slow=False):
    """Run the hard-case tests of one kind.

    Parameters
    ----------
    tests : Path
        As `find_tests` gives it.
    folder : Path
        Records and pictures go to ``folder/<backend>``.
    backend : str
        ``"none"`` runs the tests that draw nothing; ``"egl"``, ``"osmesa"`` or ``"glfw"`` those
        that do, with that back end.
    slow : bool
        The full ranges of the parameters instead of a sample.

    Returns
    -------
    rows : list of Row
        In the order of `CASES`.
    driver : str or None
        Who drew.

    Raises
    ------
    ImportError
        If pytest is missing.
    CsmError
        If the tests could not be run.
    """
    if importlib.util.find_spec("pytest") is None:
        raise ImportError("the hard cases need pytest: pip install cascaded-shadow-maps[test]")
    own = folder.resolve() / backend
    _forget(own)
    marks = "not rendered" if backend == NO_BACKEND else "rendered"
    marks += " and not sweep" + ("" if slow else " and not slow")
    command = [
        sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--hard-cases", str(own),
        "-m", marks, str(tests),
    ]  # fmt: skip
    done = subprocess.run(
        command,
        cwd=tests.parent,
        env=os.environ | ({} if backend == NO_BACKEND else {"CSM_BACKEND": backend}),
        capture_output=True,
        text=True,
        check=False,
    )
    # pytest: 1 is a failed test, 5 that none carries an id and draws (or does not).
    if done.returncode not in (0, 1, 5) or not (own / RECORDS).exists():
        last = (done.stdout + done.stderr).strip().splitlines()[-12:]
        raise CsmError("the hard-case tests could not be run:\n" + "\n".join(last))
    records = json.loads((own / RECORDS).read_text(encoding="utf-8"))
    rows = [_row_of(figure, backend, own) for figure in records["figures"]]
    rows += [_tests_row(case, tests, backend) for case, tests in records["tests"].items()]
    order = list(CASES)
    return sorted(rows, key=lambda row: order.index(row.case)), records["driver"]


def _forget(folder):
    """Remove what an earlier run left, and nothing else."""
    records = folder / RECORDS
    if records.exists():
        for figure in json.loads(records.read_text(encoding="utf-8"))["figures"]:
            if figure["picture"] is not None:
                (folder / figure["picture"]).unlink(missing_ok=True)
        records.unlink()


def _row_of(figure, backend, folder):
    picture = figure["picture"]
    return Row(
        backend=backend,
        passed=figure["failed"] == 0,
        picture=None if picture is None else folder / picture,
        **{k: figure[k] for k in ("case", "what", "worst", "tolerance", "unit", "cases", "test")},
    )


def _tests_row(case, tests, backend):
    """The line that says how many of a case's tests fail, whatever they record."""
    ran = [(test, outcome) for test, outcome in tests if outcome != "skipped"]
    failed = [test for test, outcome in ran if outcome != "passed"]
    return Row(
        case=case,
        what=TESTS_THAT_FAIL,
        backend=backend,
        worst=len(failed),
        tolerance=0,
        unit="tests",
        cases=len(ran),
        passed=not failed and len(ran) > 0,
        test=failed[0] if failed else tests[0][0],
        picture=None,
    )


def missing(rows):
    """Ids of the matrix that no row shows, in order.

    Parameters
    ----------
    rows : list of Row

    Returns
    -------
    cases : list of str
    """
    shown = {row.case for row in rows}
    return [case for case in CASES if case not in shown]


def table(rows):
    """The matrix as text.

    Parameters
    ----------
    rows : list of Row

    Returns
    -------
    text : str
    """
    lines = [("", "case", "what", "worst", "tolerance", "unit", "cases", "back end")]
    for row in rows:
        mark = "ok" if row.passed else "FAIL"
        worst, tolerance = f"{row.worst:.3g}", f"{row.tolerance:.3g}"
        lines.append(
            (mark, row.case, row.what, worst, tolerance, row.unit, str(row.cases), row.backend)
        )
    lines += [("FAIL", case, "no test ran", "", "", "", "0", "") for case in missing(rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    to_right = {3, 4, 6}
    text = "\n".join(
        "  ".join(
            word.rjust(width) if i in to_right else word.ljust(width)
            for i, (word, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )
    failed = sum(not row.passed for row in rows) + len(missing(rows))
    return f"{text}\n\n{len(rows)} rows, {failed} failed"


STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 72rem; color: #222; }
table { border-collapse: collapse; width: 100%; font-size: 13px; }
th, td { text-align: left; padding: 2px 8px; border-bottom: 1px solid #ddd; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
td.ok { color: #1a7f37; } td.fail { color: #fff; background: #c62828; }
.bar { background: #eee; width: 90px; height: 9px; } .bar i { display: block; height: 9px; }
section { margin-top: 2rem; } figure { display: inline-block; margin: 0 1rem 1rem 0; }
figure img { image-rendering: pixelated; border: 1px solid #ccc; min-width: 240px;
  max-width: 34rem; }
figcaption { font-size: 12px; max-width: 34rem; color: #555; overflow-wrap: anywhere; }
"""


def page(rows, drivers, *, version, slow):
    """The matrix and its pictures as one HTML page that needs no other file.

    Parameters
    ----------
    rows : list of Row
    drivers : dict of str to str
        Who drew, by back end.
    version : str
        Of csm.
    slow : bool
        Whether the full ranges ran.

    Returns
    -------
    text : str
    """
    escape = html.escape
    failed = sum(not row.passed for row in rows) + len(missing(rows))
    scope = "full ranges of the parameters" if slow else "a sample of the parameters"
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>csm: hard cases</title>",
        f"<style>{STYLE}</style><h1>Hard cases</h1>",
        f"<p>csm {escape(version)}, {scope}: {len(rows)} rows, ",
        f"<b>{'all passed' if not failed else f'{failed} failed'}</b>.</p><ul>",
        *(f"<li>{escape(name)}: {escape(driver)}</li>" for name, driver in drivers.items()),
        "</ul><p>Each row shows the figure that comes nearest to its tolerance, or exceeds it; "
        "the bar is the share of the tolerance it uses up.</p>",
        "<table><tr><th></th><th>case</th><th>what</th><th>worst</th><th>tolerance</th>"
        "<th></th><th>unit</th><th>cases</th><th>back end</th></tr>",
        *map(_html_row, rows),
        *(
            f"<tr><td class='fail'>FAIL</td><td>{case}</td><td colspan='7'>no test ran</td></tr>"
            for case in missing(rows)
        ),
        "</table>",
    ]
    for case, title in CASES.items():
        shown = [row for row in rows if row.case == case and row.picture is not None]
        if shown:
            parts.append(f"<section id='{case}'><h2>{case}: {escape(title)}</h2>")
            parts += map(_html_picture, shown)
            parts.append("</section>")
    return "".join(parts) + "</html>\n"


def _html_row(row):
    if row.tolerance > 0:
        share = min(max(row.worst / row.tolerance, 0.0), 1.0)
    else:
        share = 0.0 if row.passed else 1.0
    colour = "#1a7f37" if row.passed else "#c62828"
    bar = f"<div class='bar'><i style='width:{90 * share:.0f}px;background:{colour}'></i></div>"
    link = f"<a href='#{row.case}'>{row.case}</a>" if row.picture else row.case
    mark = ("ok", "ok") if row.passed else ("fail", "FAIL")
    return (
        f"<tr><td class='{mark[0]}'>{mark[1]}</td><td title='{CASES[row.case]}'>{link}</td>"
        f"<td title='{html.escape(row.test, quote=True)}'>{html.escape(row.what)}</td>"
        f"<td class='number'>{row.worst:.3g}</td><td class='number'>{row.tolerance:.3g}</td>"
        f"<td>{bar}</td><td>{html.escape(row.unit)}</td><td class='number'>{row.cases}</td>"
        f"<td>{row.backend}</td></tr>"
    )


def _html_picture(row):
    data = base64.b64encode(row.picture.read_bytes()).decode("ascii")
    caption = f"{row.what}: {row.worst:.3g} of {row.tolerance:.3g} {row.unit}, back end "
    return (
        f"<figure><img src='data:image/png;base64,{data}' alt=''><figcaption>"
        f"{html.escape(caption + row.backend)}<br><small>{html.escape(row.test)}</small>"
        "</figcaption></figure>"
    )


def write_page(folder, text):
    """Write the page; a reader never sees half of one.

    Parameters
    ----------
    folder : Path
    text : str

    Returns
    -------
    path : Path
        ``folder/hard_cases.html``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(
        "w", dir=folder, suffix=".html", delete=False, encoding="utf-8"
    ) as file:
        file.write(text)
    path = folder / "hard_cases.html"
    os.chmod(file.name, 0o644)
    os.replace(file.name, path)
    return path
