"""What the hard-case tests record: the worst figure of each check and its picture, as JSON and PNG
files for `csm.hard_cases`."""

import json
import math
import re

import numpy as np

from csm.hard_cases import CASES, RECORDS
from csm.pictures import save_png


def cases_of(test_name):
    """Ids of the matrix in a test's name: ("F1", "F2") of ``test_f1_f2_spheres``."""
    found = re.match(r"test((?:_[a-z]\d)+)_", test_name)
    ids = found[1].strip("_").upper().split("_") if found else ()
    return tuple(name for name in ids if name in CASES)


def severity(worst, tolerance):
    """How much of its tolerance a figure uses up; more than 1 is a failure."""
    if math.isnan(worst):
        return math.inf
    if tolerance > 0:
        return worst / tolerance
    return 0.0 if worst <= tolerance else math.inf


def _as_picture(picture):
    """(h, w, 3) bytes of a picture, or of a function that draws it."""
    array = np.asarray(picture() if callable(picture) else picture)
    if array.dtype != np.uint8 or array.shape[2:] not in ((), (3,)):
        raise TypeError(f"picture: (h, w) or (h, w, 3) uint8 (got {array.shape} {array.dtype})")
    return np.repeat(array[..., None], 3, axis=-1) if array.ndim == 2 else array


class Recorder:
    """Figures and outcomes of one run of pytest.

    Parameters
    ----------
    folder : Path or None
        Where they go; None keeps nothing, and draws no picture.
    """

    def __init__(self, folder):
        self._folder = folder
        self._figures = {}
        self._outcomes = {}

    def add(self, case, what, worst, tolerance, unit, test, picture):
        """One figure; of equal ones the first with a picture stays."""
        if case not in CASES:
            raise ValueError(f"{case!r} is no hard case: {', '.join(CASES)}")
        if self._folder is None:
            return
        new = severity(worst, tolerance)
        entry = self._figures.setdefault(
            (case, what), {"cases": 0, "failed": 0, "severity": -1e300}
        )
        entry["cases"] += 1
        entry["failed"] += not worst <= tolerance
        better_shown = entry.get("picture") is None and picture is not None
        if new > entry["severity"] or (new == entry["severity"] and better_shown):
            shown = None if picture is None else _as_picture(picture)
            entry |= {
                "severity": new, "worst": worst, "tolerance": tolerance, "unit": unit,
                "test": test, "picture": shown,
            }  # fmt: skip

    def outcome(self, test, outcome):
        """How a test with the ids of hard cases in its name ended."""
        for case in cases_of(test.rpartition("::")[2]):
            self._outcomes.setdefault(case, []).append((test, outcome))

    def write(self, driver):
        """Write what was recorded, ``driver`` being who drew it (None if nothing was drawn)."""
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        figures = []
        for number, ((case, what), entry) in enumerate(self._figures.items()):
            entry = {"case": case, "what": what, **entry}
            del entry["severity"]
            if entry["picture"] is not None:
                name = f"{case}-{number}.png"
                save_png(self._folder / name, entry["picture"])
                entry["picture"] = name
            figures.append(entry)
        records = {"driver": driver, "figures": figures, "tests": self._outcomes}
        text = json.dumps(records, indent=1)
        (self._folder / RECORDS).write_text(text, encoding="utf-8")
