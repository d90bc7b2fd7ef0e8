"""A sweep's records as an xarray.Dataset with units, and as a flat table of text."""

import csv
import json
import os
import uuid
from pathlib import Path

import numpy as np

from .sweep_cases import camera_text, sun_text
from .sweep_points import setting_text

__all__ = [
    "COLUMNS",
    "VALUES",
    "dataset_of",
    "outcome_of",
    "passes_of",
    "read_row",
    "read_value",
    "rows_of",
    "write_csv",
    "write_netcdf",
]

# Variable: dtype, units, what it is.
VALUES = {
    "disagreement": (
        np.float64,
        "1",
        "share of the judged pixels on the other side of 0.5 than the truth",
    ),
    "beyond_range": (np.float64, "1", "share of the sun-facing pixels that no cascade covers"),
    "judged_count": (np.float64, "1", "pixels judged"),
    "bytes": (np.float64, "bytes", "textures and buffers of a frame that makes the mask alone"),
    "bytes_maps": (np.float64, "bytes", "of those, shadow maps, moments and what makes them"),
    "ms_reference": (
        np.float64,
        "ms",
        "median total of the sweep's first settings, timed in turns with this point",
    ),
}
# What comes with a cause, where that is asked for.
WITH_CAUSES = {
    "aliasing": (
        "expected_aliasing",
        (np.float64, "1", "aliasing that theory expects of texels of this size"),
    )
}
# What else a row of the table holds, beside errors, times, settings and labels of axes.
COLUMNS = (
    *("row", "case", "status", "message", "key", "frames"),
    *("scene", "ground", "scene_digest", "camera", "sun"),
    *("rays_per_pixel", "standard_error", "causes", "repeats", "backend", "stage"),
    *("csm", "commit", "code", "clock", "host", "machine", "finished"),
    *("renderer", "version", "stage_used"),
)
SPECIAL = {
    "total": "all passes but readback",
    "host": "the call outside of all passes: placing cascades, submitting, Python's own",
}
QUARTILES = (("", "median"), ("_q1", "first quartile"), ("_q3", "third quartile"))


def dataset_of(cases, axes, records, *, causes, attributes):
    """Put records on their axes.

    Parameters
    ----------
    cases : sequence of Case
    axes : sequence of Axis
    records : dict of (case number, *axis numbers) to dict
    causes : sequence of str
    attributes : dict
        Provenance.

    Returns
    -------
    dataset : xarray.Dataset
    """
    import xarray

    names = ("case", *(axis.name for axis in axes))
    shape = (len(cases), *(len(axis.labels) for axis in axes))
    passes = passes_of(records.values())
    arrays = {}

    def fill(name, value_of, dtype, **attrs):
        array = np.empty(shape, dtype)
        for place, record in records.items():
            array[place] = value_of(record)
        arrays[name] = (names, array, attrs)

    for cause in causes:
        text = f"mean absolute error by {cause}, over the judged pixels"
        fill(f"error_{cause}", _error(cause), np.float64, units="1", long_name=text)
    for name, (dtype, units, text) in values_of(causes).items():
        fill(name, _value(name), dtype, units=units, long_name=text)
    for name in passes:
        what = SPECIAL.get(name, f"pass {name}, all cascades")
        for place, (ending, statistic) in enumerate(QUARTILES):
            text = f"{statistic} of the time of {what}"
            fill(f"ms_{name}{ending}", _ms(name, place), np.float64, units="ms", long_name=text)
    fill("frames", lambda record: record["frames"], np.int64, units="1", long_name="frames timed")
    for name, text in (
        ("status", "ok; invalid: no such settings; failed; lost: the process died"),
        ("message", "why there are no numbers"),
        ("key", "what the point is known by in the journal"),
    ):
        fill(name, _text(name), object, long_name=text)
    coordinates = {"case": ("case", np.array([case.name for case in cases], object))}
    for axis in axes:
        text = isinstance(axis.labels[0], str)
        labels = np.array(axis.labels, object if text else None)
        coordinates[axis.name] = (axis.name, labels)
    return xarray.Dataset(arrays, coordinates, attributes)


def values_of(causes):
    """`VALUES`, and what comes with these causes."""
    return VALUES | dict(more for cause, more in WITH_CAUSES.items() if cause in causes)


def passes_of(records):
    """Names of the passes that any record has, ``total`` first, then in the order of a frame."""
    passes = {"total": None}
    for record in records:
        passes.update(dict.fromkeys(record["ms"] or ()))
    return list(passes)


def _text(name):
    return lambda record: record[name]


def _number(value):
    return np.nan if value is None else value


def _value(name):
    return lambda record: _number((record["values"] or {}).get(name))


def _error(cause):
    return lambda record: _number((record["values"] or {"errors": {}})["errors"].get(cause))


def _ms(name, place):
    """Time of a pass: 0 where settings have no such pass, NaN where a point has no numbers."""

    def value_of(record):
        return np.nan if record["ms"] is None else record["ms"].get(name, (0.0, 0.0, 0.0))[place]

    return value_of


def write_netcdf(dataset, path):
    """Write a dataset; the file appears, or is replaced, when it is complete."""
    path = Path(path)
    beside = path.with_name(f".{uuid.uuid4().hex}.nc")
    try:
        dataset.to_netcdf(beside, engine="netcdf4")
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def rows_of(cases, axes, points, records, *, protocol):
    """Flat rows, one for each point, from any of which it can be repeated.

    Parameters
    ----------
    cases : sequence of Case
    axes : sequence of Axis
    points : sequence of Point
    records : dict of (case number, *axis numbers) to dict
    protocol : dict of str to object
        What all points were measured with, e.g. ``rays_per_pixel``.

    Returns
    -------
    rows : list of dict of str to str
        Numbers as Python writes them, to the last bit; empty where there is none.
    """
    passes = passes_of(records.values())
    labelled = [axis for axis in axes if any(axis.name not in changes for changes in axis.changes)]
    rows = []
    for number, case in enumerate(cases):
        for point in points:
            record = records[number, *point.index]
            labels = {
                axis.name: axis.labels[place]
                for axis, place in zip(axes, point.index, strict=True)
                if axis in labelled
            }
            row = {"row": len(rows), "case": case.name, **labels}
            row |= {"status": record["status"], "message": record["message"]}
            row |= outcome_of(record, passes, protocol["causes"])
            row |= point.wanted
            row |= {
                "scene": case.source or "",
                "ground": case.ground,
                "scene_digest": case.scene_digest,
                "camera": camera_text(case.camera),
                "sun": sun_text(case.sun),
            }
            row |= protocol | {"causes": " ".join(protocol["causes"])}
            row |= {name: record[name] for name in ("clock", "host", "machine", "finished", "key")}
            row |= {name: record["driver"].get(name, "") for name in ("renderer", "version")}
            row["stage_used"] = record["driver"].get("stage", "")
            rows.append({name: "" if v is None else setting_text(v) for name, v in row.items()})
    return rows


def outcome_of(record, passes, causes):
    """Flat numbers of a record by column, None where there is none."""
    found, ms = record["values"] or {}, record["ms"]
    outcome = {f"error_{cause}": found.get("errors", {}).get(cause) for cause in causes}
    outcome |= {name: found.get(name) for name in values_of(causes)}
    for name in passes:
        for place, (ending, _) in enumerate(QUARTILES):
            value = None if ms is None else ms.get(name, (0.0, 0.0, 0.0))[place]
            outcome[f"ms_{name}{ending}"] = value
    return outcome | {"frames": record["frames"]}


def write_csv(rows, path):
    """Write rows; the file appears, or is replaced, when it is complete."""
    path = Path(path)
    beside = path.with_name(f".{uuid.uuid4().hex}.csv")
    try:
        with open(beside, "w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            table.writeheader()
            table.writerows(rows)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def read_row(path, number):
    """Read one row of such a table.

    Parameters
    ----------
    path : path
    number : int
        From 0, as in the column ``row``.

    Returns
    -------
    row : dict of str to str

    Raises
    ------
    ValueError
        If there is no such row.
    """
    csv.field_size_limit(1 << 24)
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    if not 0 <= number < len(rows):
        raise ValueError(f"{path} has rows 0 to {len(rows) - 1} (got {number})")
    return rows[number]


def read_value(text):
    """Return a cell as a number, or as the text that it is; None where it is empty."""
    if text == "":
        return None
    try:
        return json.loads(text)
    except ValueError:
        return text
