"""The matrix of hard cases: what is easy to get wrong, tested, with its worst figures.

The cases are tests (docs/numerics.md 16): this module runs those that carry an id of the matrix in
their names, once without OpenGL and once per back end, and reads what they recorded;
`csm.hard_case_page` makes a table and a page of it.
"""

import importlib.util
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from .errors import CsmError

__all__ = [
    "CASES",
    "NO_BACKEND",
    "RECORDS",
    "TESTS_THAT_FAIL",
    "Row",
    "collect",
    "find_tests",
    "kept_rows",
    "missing",
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

    @property
    def used(self):
        """Share of the tolerance that the worst figure uses up; of none, 0 if passed, else 1."""
        if self.tolerance > 0:
            return max(self.worst / self.tolerance, 0.0)
        return 0.0 if self.passed else 1.0


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
    return _rows_in(own, backend)


def kept_rows(folder):
    """Rows that `collect` left in a folder, of all back ends.

    Parameters
    ----------
    folder : path-like
        As given to ``csm hard-cases --out``.

    Returns
    -------
    rows : list of Row
        In the order of `CASES`.

    Raises
    ------
    FileNotFoundError
        If nothing was left there.
    ValueError
        If what is there cannot be read.
    """
    rows = []
    for records in sorted(Path(folder).glob(f"*/{RECORDS}")):
        try:
            rows += _rows_in(records.parent, records.parent.name)[0]
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{records} holds no records of hard cases: {error}") from error
    if not rows:
        raise FileNotFoundError(
            f"no hard cases in {folder}: csm hard-cases --out {folder} puts them there"
        )
    return _in_order(rows)


def _in_order(rows):
    order = list(CASES)
    return sorted(rows, key=lambda row: order.index(row.case))


def _rows_in(folder, backend):
    """Rows in order, and who drew, of one run."""
    records = json.loads((folder / RECORDS).read_text(encoding="utf-8"))
    rows = [_row_of(figure, backend, folder) for figure in records["figures"]]
    rows += [_tests_row(case, tests, backend) for case, tests in records["tests"].items()]
    return _in_order(rows), records["driver"]


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
