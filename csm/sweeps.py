"""Sweeps: every combination of settings over scenes, cameras and suns, judged and timed."""

import contextlib
import dataclasses
import importlib
import os
import sys
from pathlib import Path

from .arguments import check_folder
from .digests import code_digest, commit, digest
from .errors import CsmError
from .metrics import CAUSES
from .progress import Progress
from .renderer import Renderer
from .settings import ShadowSettings
from .spaces import as_whole
from .sweep_cases import camera_from_text, cases_of, sun_from_text
from .sweep_journal import FAILED, INVALID, Journal, blank_record
from .sweep_points import axes_of, points_of, settings_from_text
from .sweep_provenance import provenance
from .sweep_runs import DaskWorkers, PoolWorkers, run_here, run_on
from .sweep_tables import (
    COLUMNS,
    dataset_of,
    outcome_of,
    passes_of,
    read_row,
    read_value,
    rows_of,
    values_of,
    write_csv,
    write_netcdf,
)
from .sweep_worker import MASK_CAUSES, Job, Options, mark_of, measure
from .timing import MOST_REPEATS
from .tracing import NotConverged
from .truth_cache import cached_truth

__all__ = ["repeat_point", "sweep"]

JOURNAL, TRUTHS, NETCDF, TABLE = "journal.jsonl", "truth", "sweep.nc", "points.csv"
MOST_PROCESSES = 1024


def sweep(
    cases,
    axes,
    *,
    base=None,
    out=None,
    processes=1,
    client=None,
    progress=None,
    repeats=None,
    size=None,
    rays_per_pixel=1,
    standard_error=None,
    causes=None,
    backend="auto",
    stage="auto",
):
    """Error, time and memory of every combination of settings, over scenes, cameras and suns.

    Every point is rendered, judged by the ray-traced truth of its case, which is traced once, and
    timed. A combination that is not valid, and a point that fails, is a record in ``status`` and
    ``message`` with NaN for numbers. The numbers are the same to the bit, times excepted, in this
    process, in others and on Dask, resumed or not, on one kind of machine.

    Parameters
    ----------
    cases : mapping of str to (scene, camera, sun)
        Objects, or names as on the command line: ``("town", "street", "low")``,
        ``("town.glb", "eye=0,20,60,target=0,5,0", "238,33")``, None for a scene's first camera or
        sun; for a scene ``("town.glb", 0.0)`` puts a ground at that height, for a sun ``("low",
        0.53)`` is one of that diameter [degrees]. What is given by name other
        processes load themselves, and a row of the table can be repeated without it.
    axes : mapping
        Settings to lists of values; or a name of your own to labels that stand for several
        settings each, ``{"technique": {"sharp": {"filter": "hard"}, "soft": {…}}}``.
    base : ShadowSettings, optional
        What the axes do not say; the defaults if not given.
    out : path, optional
        Folder for ``journal.jsonl``, to which every finished point goes at once; ``truth/``;
        and, at the end, ``sweep.nc`` and ``points.csv``. A sweep that is called again with it
        computes what is not in the journal: points are known by the digest of scene, camera, sun,
        canonical settings, the arguments below from `repeats` on, and csm's own code.
    processes : int
        1: in this process. More: so many worker processes, each with a renderer of its own; they
        share the cores and so disturb each other's times. A script must then guard its call with
        ``if __name__ == "__main__":``, as `multiprocessing` has it.
    client : distributed.Client, optional
        Measure on the workers of a Dask cluster, best with one thread each.
    progress : bool or callable, optional
        A bar on stderr, by default where that is a terminal; or what takes the share done, 0 to 1.
    repeats : int, optional
        Frames timed of each point; by default at least 5, going on until the quartiles lie within
        10 % of the median or 50 are done.
    size : (int, int), optional
        Width and height of every picture [px], instead of the cameras' own.
    rays_per_pixel, standard_error
        Of the truth, as for `csm.truth`.
    causes : sequence of str, optional
        Causes of error to report, as in `ErrorReport.mean`; by default those that take no more rays
        than the truth's.
    backend, stage : str
        As for `Renderer`.

    Returns
    -------
    dataset : xarray.Dataset
        Dimensions ``case`` and one for each axis, in the order given. Variables: ``error_<cause>``
        (mean absolute), with ``aliasing`` also ``expected_aliasing``, theory's;
        ``disagreement``, ``beyond_range``, ``judged_count``; ``ms_total``, the
        passes without ``readback``, ``ms_<pass>``, the cascades of a pass added up, 0 where
        settings have no such pass, and ``ms_host``, what the call took beside: medians, with
        quartiles in ``…_q1`` and ``…_q3``; ``frames``, how many were timed; ``bytes`` of a frame
        and ``bytes_maps``, its maps and what makes them; ``status``, ``message``, ``key``;
        ``ms_reference``, what the first settings of all took beside the point: points are timed in
        groups, and a machine's pace changes from group to group. Units and provenance in the
        attributes.

    Raises
    ------
    TypeError, ValueError, OSError
        If an argument breaks its rule.
    ImportError
        If xarray, netCDF4 (with `out`), embreex or dask (with `client`) is missing.
    ContextError
        If there is no OpenGL.
    BlockingIOError
        If another sweep is writing to `out`.
    KeyboardInterrupt
        On Ctrl-C; what is finished stays in the journal.

    Notes
    -----
    A point's first frames, which compile and allocate, do not count, nor does the frame after
    another point's; eight points of a case and the sweep's first settings are timed in turns.
    ``clock`` in the attributes names the
    clock; docs/sweeps.md says more.

    Examples
    --------
    >>> import csm
    >>> scene = csm.scenes.plane_and_box()
    >>> case = (scene, scene.cameras["corner"], scene.suns["diagonal"])
    >>> found = csm.sweep({"box": case}, {"map_size": [64, 128]}, size=(64, 48), repeats=1)
    >>> found.sizes["map_size"], found.disagreement.attrs["units"]
    (2, '1')
    """
    folder = None if out is None else Path(out)
    if folder is not None:
        check_folder(folder, "out")
    axes, cases = axes_of(axes), cases_of(cases, size)
    base = ShadowSettings() if base is None else base
    if not isinstance(base, ShadowSettings):
        raise TypeError(f"base must be a csm.ShadowSettings (got {type(base).__name__})")
    options = _options(causes, repeats, backend, stage)
    rays = {"rays_per_pixel": rays_per_pixel, "standard_error": standard_error}
    workers, measured_by = _workers(processes, client)
    _check_packages(out, {axis.name for axis in axes})
    points = points_of(base, axes)
    first = next((point.settings for point in points if point.settings is not None), None)
    keys = _keys(cases, points, options, rays)  # what is timed beside a point is no part of it
    options = dataclasses.replace(options, reference=first)
    with Journal(None if folder is None else folder / JOURNAL) as journal:
        left = _left(cases, keys, points, journal)
        with _bar(progress, sum(map(len, left)), len(set(keys.values()))) as advance:

            def land(record):
                journal.add(record)
                advance()

            work = _work(cases, left, None if folder is None else folder / TRUTHS, rays, land)
            if workers is not None:
                run_on(workers, work, options, land)
            elif any(left):
                run_here(work, options, land)
        records = _records(cases, points, keys, journal, mark_of(first))
        protocol = {**rays, **vars(options)}
        del protocol["reference"]
        dataset = dataset_of(
            cases,
            axes,
            records,
            causes=options.causes,
            attributes=provenance(cases, axes, base, records.values(), protocol, measured_by),
        )
        if folder is not None:
            write_netcdf(dataset, folder / NETCDF)
            protocol |= {"csm": dataset.attrs["csm"], "commit": commit(), "code": code_digest()}
            write_csv(rows_of(cases, axes, points, records, protocol=protocol), folder / TABLE)
    return dataset


def repeat_point(table, row, *, cases=None):
    """Measure a point of a sweep again, from its row in ``points.csv``.

    Parameters
    ----------
    table : path
    row : int
        As in the table's first column.
    cases : mapping of str to (scene, camera, sun), optional
        As for `sweep`: needed where the scene was given as an object, which a table does not hold.

    Returns
    -------
    found : dict of str to float
        By the names of the table's columns: errors, memory and times, measured anew.
    stored : dict of str to float
        The same columns of the table.

    Raises
    ------
    OSError, ValueError
        If there is no such row, it has no numbers, its scene is not to be had, or what is there is
        another one.
    """
    stored = read_row(table, row)
    if stored["status"] == INVALID:
        raise ValueError(f"row {row} has no valid settings: {stored['message']}")
    settings = settings_from_text(stored)
    camera, sun = camera_from_text(stored["camera"]), sun_from_text(stored["sun"])
    name, scene = stored["case"], (stored["scene"], read_value(stored["ground"]))
    if cases is not None and name in cases:
        scene = cases[name][0]
    elif not stored["scene"]:
        raise ValueError(f"row {row} needs cases= with {name!r}: its scene was given as an object")
    (case,) = cases_of({name: (scene, camera, sun)})
    if case.scene_digest != stored["scene_digest"]:
        raise ValueError(f"row {row}: the scene of {name!r} is not the one that was measured")
    options = _options(
        stored["causes"].split(),
        read_value(stored["repeats"]),
        stored["backend"],
        stored["stage"],
    )
    rays = {key: read_value(stored[key]) for key in ("rays_per_pixel", "standard_error")}
    traced = cached_truth(case.scene, camera, sun, **rays)
    with Renderer(options.backend, stage=options.stage) as renderer:
        (record,) = measure(renderer, traced, [Job(stored["key"], settings)], options)
    outcome = outcome_of(record, passes_of([record]), options.causes)
    return outcome, {column: read_value(stored.get(column, "")) for column in outcome}


# -- what to do -----------------------------------------------------------------------------------


def _options(causes, repeats, backend, stage):
    if causes is None:
        causes = [cause for cause in MASK_CAUSES if cause in CAUSES]
    if isinstance(causes, str):
        raise TypeError(f"causes must be a sequence of names (got the string {causes!r})")
    causes = tuple(causes)
    for cause in causes:
        if cause not in CAUSES:
            raise ValueError(f"causes may name {', '.join(CAUSES)} (got {cause!r})")
    if len(set(causes)) != len(causes):
        raise ValueError(f"causes names one twice (got {causes})")
    if backend == "auto":  # two back ends must not pass for one
        backend = os.environ.get("CSM_BACKEND") or "auto"
    if repeats is not None:
        repeats = as_whole("repeats", repeats, 1, MOST_REPEATS)
    return Options(causes, repeats, backend, stage)


def _workers(processes, client):
    processes = as_whole("processes", processes, 1, MOST_PROCESSES)
    if client is not None:
        if processes != 1:
            raise ValueError(f"processes and client exclude each other (got {processes})")
        workers = DaskWorkers(client)
        return workers, f"workers of Dask, {workers.count} at once"
    if processes > 1:
        return PoolWorkers(processes), f"{processes} processes at once"
    return None, "one process"


def _check_packages(out, axis_names):
    """Say what is missing before anything is done, and what an axis would hide."""
    needed = {"xarray": "sweep"} if out is None else {"xarray": "sweep", "netCDF4": "sweep"}
    for package, extra in needed.items():
        try:
            importlib.import_module(package)
        except ImportError as error:
            raise ImportError(
                f"csm.sweep needs {package}: pip install cascaded-shadow-maps[{extra}]"
            ) from error
    for name in axis_names:
        if name in values_of(CAUSES) or name in COLUMNS or name.startswith(("error_", "ms_")):
            raise ValueError(f"axes: an axis may not be called {name!r}, as a result is")


def _keys(cases, points, options, rays):
    """Keys of the valid points by their place: equal ones are one piece of work."""
    protocol = (__name__, code_digest(), rays, options)
    settings = {
        point.index: digest(point.settings.canonical().to_dict())
        for point in points
        if point.settings is not None
    }
    keys = {}
    for number, case in enumerate(cases):
        shown = digest(case.scene_digest, case.camera, case.sun, protocol)
        keys |= {(number, *index): digest(shown, text) for index, text in settings.items()}
    return keys


def _left(cases, keys, points, journal):
    """Jobs of each case that the journal does not have, each once."""
    settings = {point.index: point.settings for point in points}
    jobs, known = [[] for _ in cases], set()
    for (number, *index), key in keys.items():
        if key not in known and key not in journal:
            known.add(key)
            jobs[number].append(Job(key, settings[tuple(index)]))
    return jobs


def _work(cases, left, truths, rays, land):
    """Yield each case that has work left with its truth."""
    for case, jobs in zip(cases, left, strict=True):
        if not jobs:
            continue
        try:
            traced = cached_truth(case.scene, case.camera, case.sun, truths, **rays)
        except (CsmError, MemoryError, NotConverged) as error:
            for job in jobs:
                land(blank_record(job.key, FAILED, f"no truth: {error or type(error).__name__}"))
            continue
        yield case, traced, jobs


def _records(cases, points, keys, journal, mark):
    """Return the record of every place.

    What earlier sweeps into the same folder timed beside other settings has no pace here.
    """
    records = {}
    for number in range(len(cases)):
        for point in points:
            place = (number, *point.index)
            if point.settings is None:
                records[place] = blank_record("", INVALID, point.message)
            else:
                record = journal[keys[place]]
                if record["values"] and record["values"].get("reference") != mark:
                    record = {**record, "values": {**record["values"], "ms_reference": None}}
                records[place] = record
    return records


@contextlib.contextmanager
def _bar(progress, left, count):
    """Yield what is called when a point is done."""
    done = 0
    if callable(progress):
        stage = contextlib.nullcontext(progress)
    else:
        shown = sys.stderr.isatty() if progress is None else progress
        known = f", {count - left} known" if left < count else ""
        stage = Progress(quiet=not shown).stage(f"sweep of {count} points{known}")
    with stage as tell:

        def advance():
            nonlocal done
            done += 1
            tell(done / left)

        yield advance
