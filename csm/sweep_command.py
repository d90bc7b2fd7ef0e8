"""The subcommand `csm sweep`: a sweep from a file, its table, and a row of it once more."""

import itertools
import math
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .arguments import INTERRUPTED, check_folder, parse_folder
from .scenes import SCENES
from .settings import ShadowSettings
from .sweep_tables import QUARTILES
from .sweeps import JOURNAL, NETCDF, TABLE, repeat_point, sweep

__all__ = ["SWEEP_EXAMPLES", "SWEEP_HELP", "add_sweep_options", "read_sweep", "run_sweep"]

SWEEP_HELP = """\
Measure error, time and memory of every combination of settings, over scenes, cameras and suns, as
a TOML file says, and write what came of it:

  points.csv      a row for every point, from any of which it can be measured again
  sweep.nc        the same as an xarray.Dataset: a dimension for each axis
  journal.jsonl   every finished point, as it comes
  truth/          the ray-traced truths

Called again with the same folder it computes only what the journal does not have, so a sweep that
was killed or interrupted goes on. docs/sweeps.md describes the file and the columns.
"""

SWEEP_EXAMPLES = """\
the file:
  size = [480, 270]
  [cases.street]
  scene = "town"                # a file beside this one, or the name of a made scene
  camera = ["street", "roofs"]  # names, or eye=x,y,z,target=x,y,z; several make several cases
  sun = "238,33"                # a name, x,y,z or azimuth,elevation
  [base]
  cascade_count = 3
  [axes]
  map_size = [512, 1024, 2048]
  filter = ["hard", "pcf"]

examples:
  csm sweep sweep.toml --out results
  csm sweep sweep.toml --out results --processes 4
  csm sweep --out results --repeat-row 7

exit status: 0 done, 1 --repeat-row found other numbers, 2 bad input, 130 interrupted
"""

KEYS = (
    *("cases", "axes", "base", "size", "repeats", "processes", "rays_per_pixel"),
    *("standard_error", "causes", "backend", "stage"),
)
CASE_KEYS = ("scene", "camera", "sun", "ground", "sun_diameter")
WIDEST = 40  # rows of the table on stdout


def add_sweep_options(command):
    """Add the options of `csm sweep` to its parser."""
    add = command.add_argument
    add("file", metavar="FILE.toml", nargs="?", help="cases, axes, base settings")
    add("--out", metavar="DIR", required=True, help="folder for the files, made if new")
    add(
        "--processes",
        metavar="N",
        type=int,
        help="worker processes, which disturb each other's times (default: the file's, or 1)",
    )
    add(
        "--resume",
        action="store_true",
        help="go on with what the folder's journal has; it is done anyway",
    )
    add(
        "--repeat-row",
        metavar="N",
        type=int,
        help="measure row N of the folder's points.csv again and compare",
    )
    add("--quiet", action="store_true", help="no progress on stderr, no table on stdout")


def run_sweep(options):
    """Run the subcommand; 1 if a repeated row has other numbers."""
    folder = parse_folder(options.out)
    if options.repeat_row is not None:
        if options.file is not None:
            raise ValueError("--repeat-row takes its settings from the table: give no FILE.toml")
        return _repeat(folder, options)
    if options.file is None:
        raise ValueError("csm sweep needs a FILE.toml")
    arguments = read_sweep(options.file)
    if options.processes is not None:
        arguments["processes"] = options.processes
    check_folder(folder)
    try:
        dataset = sweep(**arguments, out=folder, progress=not options.quiet)
    except KeyboardInterrupt:
        return interrupted(folder)
    if not options.quiet:
        print(table_text(dataset))
        print(f"\n{folder}: {TABLE}, {NETCDF}")
    return 0


def _repeat(folder, options):
    found, stored = repeat_point(folder / TABLE, options.repeat_row)
    same = True
    for column, value in found.items():
        timed = column.startswith("ms_") or column == "frames"
        if timed and column.endswith(tuple(ending for ending, _ in QUARTILES if ending)):
            continue
        if not timed:
            same = same and _equal(value, stored[column])
        note = "" if timed else "  same" if _equal(value, stored[column]) else "  OTHER"
        if not options.quiet:
            print(f"{column:22}{_text(stored[column]):>14}{_text(value):>14}{note}")
    return int(not same)


def _equal(one, other):
    return one == other or (one is None and other is None)


def _text(value):
    return "-" if value is None else f"{value:.6g}"


def interrupted(folder):
    """Say where a sweep's finished points are; the exit status."""
    print(
        f"csm: interrupted; what is finished is in {folder / JOURNAL}, and the same command "
        "goes on from there",
        file=sys.stderr,
    )
    return INTERRUPTED


def read_sweep(path):
    """Read a sweep from a TOML file.

    Parameters
    ----------
    path : path

    Returns
    -------
    arguments : dict
        For `csm.sweep`, cases and axes among them.

    Raises
    ------
    OSError, ValueError
        If there is no such file, it is no TOML, or a key is missing or unknown.
    """
    path = Path(path)
    try:
        with open(path, "rb") as file:
            content = tomllib.load(file)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: {error}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is no text ({error})") from None
    _only(path, "", content, KEYS)
    for key in ("cases", "axes"):
        if not isinstance(content.get(key), Mapping) or not content[key]:
            raise ValueError(f"{path}: needs a table [{key}] with at least one entry")
    cases = {}
    for name, entry in content.pop("cases").items():
        more = _cases(path, name, entry)
        for twice in cases.keys() & more.keys():
            raise ValueError(f"{path}: two cases are called {twice!r}")
        cases |= more
    base = content.pop("base", {})
    if not isinstance(base, Mapping):
        raise ValueError(f"{path}: [base] must be a table of settings")
    try:
        base = ShadowSettings().replace(**base)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: [base]: {error}") from None
    return {"cases": cases, "base": base, **content}


def _cases(path, name, entry):
    """Return the cases of one table: every combination of its scenes, cameras and suns."""
    if not isinstance(entry, Mapping) or "scene" not in entry:
        raise ValueError(f"{path}: [cases.{name}] must have a scene")
    _only(path, f" in [cases.{name}]", entry, CASE_KEYS)
    several = {}
    for key in ("scene", "camera", "sun"):
        values = entry.get(key)
        values = values if isinstance(values, list) else [values]
        if not values or not all(
            isinstance(v, str) or (v is None and key != "scene") for v in values
        ):
            raise ValueError(f"{path}: [cases.{name}] {key} must be a text or a list of texts")
        several[key] = values
    ground, diameter = (_number(path, name, entry, key) for key in ("ground", "sun_diameter"))
    cases = {}
    for words in itertools.product(*several.values()):
        varied = [w for w, values in zip(words, several.values(), strict=True) if len(values) > 1]
        source, camera, sun = _source(path, words[0]), *words[1:]
        cases[" ".join([name, *varied])] = (
            source if ground is None else (source, ground),
            camera,
            sun if diameter is None else (sun, diameter),
        )
    return cases


def _number(path, name, entry, key):
    value = entry.get(key)
    if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float))):
        raise ValueError(f"{path}: [cases.{name}] {key} must be a number (got {value!r})")
    return value if value is None else float(value)


def _source(path, scene):
    """Return the scene as it is found from anywhere: files lie beside the TOML file."""
    return scene if scene in SCENES else str((path.parent / scene).absolute())


def _only(path, where, entry, known):
    for key in entry:
        if key not in known:
            raise ValueError(f"{path}: unknown key {key!r}{where}; there are {', '.join(known)}")


def table_text(dataset):
    """Lay a sweep out for people: the best points of each case, then what has no numbers.

    Parameters
    ----------
    dataset : xarray.Dataset

    Returns
    -------
    text : str
    """
    axes = list(dataset.status.dims[1:])
    lines = []
    measures = [
        ("disagreement", "wrong side", "{:.3%}"),
        ("error_total", "mean error", "{:.3%}"),
        ("ms_total", "ms", "{:.2f}"),
        ("bytes_maps", "MB of maps", "{:.1f}"),
    ]
    measures = [row for row in measures if row[0] in dataset]
    for case in dataset.case.values:
        part = dataset.sel(case=case)
        points = [
            (place, {name: part[name].values[place] for name, *_ in measures})
            for place in np.ndindex(part.status.shape)
            if part.status.values[place] == "ok"
        ]
        points.sort(key=lambda point: _order(point[1]["disagreement"]))
        lines.append(f"{case}: {len(points)} points, the most accurate first")
        lines.append("".join(f"{title:>12}" for _, title, _ in measures) + f"  {', '.join(axes)}")
        for place, values in points[:WIDEST]:
            labels = [str(part[axis].values[k]) for axis, k in zip(axes, place, strict=True)]
            scaled = values | {"bytes_maps": values.get("bytes_maps", 0.0) / 1e6}
            numbers = "".join(f"{form.format(scaled[name]):>12}" for name, _, form in measures)
            lines.append(f"{numbers}  {', '.join(labels)}")
        if len(points) > WIDEST:
            lines.append(f"{'':12}  and {len(points) - WIDEST} more in {TABLE}")
        lines.append("")
    statuses = dataset.status.values.ravel()
    messages = dataset.message.values.ravel()
    for text in dict.fromkeys(
        f"{s}: {m}" for s, m in zip(statuses, messages, strict=True) if s != "ok"
    ):
        count = sum(f"{s}: {m}" == text for s, m in zip(statuses, messages, strict=True))
        lines.append(f"{count} x {text}")
    return "\n".join(lines).rstrip()


def _order(value):
    return math.inf if math.isnan(value) else value
