"""What measures points, in whatever process: renders, judges, times.

A worker process, of a pool or of Dask, keeps here its one renderer and the scene and truth it had
last. Here and not in a function of the user's, because what a notebook defines gets fresh globals
with every task that Dask sends.
"""

import atexit
import datetime
import math
import os
import pickle
import platform
import socket
import threading
import time
from dataclasses import dataclass, field

from .arguments import find_scene
from .digests import code_digest, digest, scene_digest
from .errors import ContextError
from .metrics import compare
from .plans import map_bytes
from .renderer import Renderer
from .sweep_journal import FAILED, OK, blank_record
from .timing import HOST, in_turns, quartiles, total_ms, warm_up_s
from .truth_cache import truth_arrays, truth_from_arrays

__all__ = [
    "MASK_CAUSES",
    "Job",
    "Load",
    "Options",
    "mark_of",
    "measure",
    "packed",
    "release",
    "run_task",
    "stage_of",
]

#: Causes that two masks tell, without further rays.
MASK_CAUSES = ("total", "too_bright", "too_dark")
TIMED_OUTPUTS = ("mask",)
JUDGED_OUTPUTS = ("mask", "valid", "cascade_index")


@dataclass(frozen=True)
class Options:
    """How points are measured: the arguments of `csm.sweep` that a worker needs."""

    causes: tuple[str, ...]
    repeats: int | None
    backend: str
    stage: str
    reference: object = field(default=None, repr=False)  # settings timed beside every few points


@dataclass(frozen=True)
class Job:
    """One point's work: its key in the journal, and its settings."""

    key: str
    settings: object = field(repr=False)


@dataclass(frozen=True, eq=False)
class Load:
    """A case as it travels to another process: the scene, or how to load it, and the truth."""

    scene_digest: str
    scene: object = field(repr=False)
    source: str | None
    ground: float | None
    camera: object
    sun: object
    truth: dict = field(repr=False)
    code: str


def packed(case, truth):
    """Return a Case and its Truth as a Load; a scene that the worker can load stays behind."""
    by_name = case.source is not None
    return Load(
        case.scene_digest,
        None if by_name else case.scene,
        case.source,
        case.ground,
        case.camera,
        case.sun,
        truth_arrays(truth),
        code_digest(compiled=False),
    )


# -- measuring ------------------------------------------------------------------------------------


def measure(renderer, truth, jobs, options, *, stopped=lambda: False):
    """Measure jobs of one case, timed in turns.

    Parameters
    ----------
    renderer : Renderer
    truth : Truth
        Of the case: its scene, camera and sun are rendered.
    jobs : sequence of Job
    options : Options
    stopped : callable
        Asked between renders; True ends the work, what is not finished has no record.

    Yields
    ------
    record : dict
        For the journal, as soon as it is complete.
    """
    judged = {}
    for job in jobs:
        if stopped():
            return
        try:
            judged[job.key] = _judge(renderer, truth, job.settings, options)
        except ContextError:
            raise  # not the point's fault
        except Exception as error:
            yield _record(job, FAILED, renderer, message=_sentence(error))

    def frame_times(job):
        renderer.forget()
        start = time.perf_counter()
        frame = renderer.render(
            truth.scene, truth.camera, truth.sun, job.settings, outputs=TIMED_OUTPUTS
        )
        whole = 1e3 * (time.perf_counter() - start)
        if job.key in judged:
            judged[job.key]["info"] = frame.info
        return {**frame.timings_ms, HOST: max(0.0, whole - sum(frame.timings_ms.values()))}

    left = [job for job in jobs if job.key in judged]
    pace = _pace_of(left, options.reference)
    timed = in_turns(
        left if pace is None or pace in left else [pace, *left], frame_times,
        repeats=options.repeats, stopped=stopped, warm_up=warm_up_s(renderer.info),
    )  # fmt: skip
    waiting, pace_ms, mark = [], None if pace else math.nan, mark_of(options.reference)
    for job, samples in timed:
        if isinstance(samples, ContextError):
            raise samples
        if job is pace:
            failed = isinstance(samples, Exception)
            pace_ms = math.nan if failed else _summed(samples)["total"][0]
        if job in left:
            waiting.append((job, samples))
        if pace_ms is not None:
            for one in waiting:
                yield _timed_record(*one, renderer, judged, pace_ms, mark)
            waiting.clear()


def _pace_of(jobs, reference):
    """Job that all groups of a case's points are timed beside: one of these, or its own."""
    if reference is None or not jobs:
        return None
    same = [job for job in jobs if job.settings.canonical() == reference.canonical()]
    return same[0] if same else Job("", reference)


def mark_of(settings):
    """What settings are known by that others are timed beside; "" of none."""
    return "" if settings is None else digest(settings.canonical().to_dict())


def _timed_record(job, samples, renderer, judged, pace_ms, mark):
    if isinstance(samples, Exception):
        return _record(job, FAILED, renderer, message=_sentence(samples))
    found = judged[job.key]
    found |= {"bytes": found["info"]["bytes"], "ms_reference": pace_ms, "reference": mark}
    return _record(job, OK, renderer, found=found, ms=_summed(samples), frames=len(samples))


def _judge(renderer, truth, settings, options):
    """Render a point as if it were the first there is, and compare it with the truth."""
    outputs = JUDGED_OUTPUTS
    if set(options.causes) - set(MASK_CAUSES):
        outputs += ("mask_single",)
    renderer.forget()
    frame = renderer.render(truth.scene, truth.camera, truth.sun, settings, outputs=outputs)
    report = compare(frame, truth)
    expected = {}
    if "aliasing" in options.causes and "aliasing" in report.mean:
        expected["expected_aliasing"] = float(report.expected_aliasing)
    return {
        # a frame without shadows has no causes
        "errors": {
            cause: float(report.mean[cause]) if cause in report.mean else float("nan")
            for cause in options.causes
        },
        **expected,
        "disagreement": float(report.disagreement),
        "beyond_range": report.beyond_range,
        "judged_count": report.judged_count,
        "bytes_maps": map_bytes(settings),
        "info": frame.info,
    }


def _summed(samples):
    """Median and quartiles [ms] of each pass and of the total."""
    ms = {name: quartiles([passes[name] for passes in samples]) for name in samples[0]}
    return {"total": quartiles([total_ms(passes) for passes in samples]), **ms}


def _record(job, status, renderer, *, message="", found=None, ms=None, frames=0):
    info = renderer.info if found is None else found.pop("info")
    driver = ("backend", "platform", "vendor", "renderer", "version", "stage")
    return blank_record(job.key, status, message) | {
        "values": found,
        "ms": ms,
        "frames": frames,
        "driver": {name: info[name] for name in driver},
        "clock": info.get("clock", ""),
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds"),
        "host": socket.gethostname(),
        "machine": f"{platform.machine()}, {len(os.sched_getaffinity(0))} cores",
        "process": os.getpid(),
    }


def _sentence(error):
    text = "; ".join(line.strip() for line in str(error).splitlines() if line.strip())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


# -- a worker process -----------------------------------------------------------------------------

_lock = threading.Lock()  # one task at a time: others would be in its times
_kept = {}  # "renderer": (key, Renderer), "scene": (digest, Scene), "load": (Load or path, Truth)


def run_task(load, jobs, options, stopped=lambda: False):
    """Measure jobs in a worker process.

    Parameters
    ----------
    load : Load or str
        Or the path of a pickled one.
    jobs : sequence of Job
    options : Options
    stopped : callable
        As in `measure`.

    Returns
    -------
    records : list of dict

    Raises
    ------
    RuntimeError
        If this process has another csm or another scene of that name.
    ContextError
        If it has no OpenGL.
    """
    with _lock:
        truth = _truth_of(load)
        return list(measure(_renderer_of(options), truth, jobs, options, stopped=stopped))


def stage_of(options):
    """Return the stage that this process takes for `options`: one for all workers of a sweep."""
    with _lock:
        return _renderer_of(options).info["stage"]


def release():
    """Close the renderer of this process and drop its scene, unless a task is at work."""
    if _lock.acquire(blocking=False):
        try:
            _close_renderer()
            _kept.clear()
        finally:
            _lock.release()


def _truth_of(load):
    known = _kept.get("load")
    if known is not None and (known[0] is load or (isinstance(load, str) and known[0] == load)):
        return known[1]
    name = load
    if isinstance(load, str):
        with open(load, "rb") as file:
            load = pickle.load(file)
    if load.code != code_digest(compiled=False):
        raise RuntimeError(
            f"the worker on {socket.gethostname()} has another csm than the sweep: install the same"
        )
    scene = _scene_of(load)
    truth = truth_from_arrays(load.truth, scene, load.camera, load.sun)
    _kept["load"] = (name, truth)
    return truth


def _scene_of(load):
    known = _kept.get("scene")
    if known is not None and known[0] == load.scene_digest:
        return known[1]
    scene = load.scene
    if scene is None:
        scene = find_scene(load.source, load.ground)
        if scene_digest(scene) != load.scene_digest:
            raise RuntimeError(
                f"the worker on {socket.gethostname()} finds another scene at {load.source!r}"
            )
    _kept["scene"] = (load.scene_digest, scene)
    return scene


def _renderer_of(options):
    key = (options.backend, options.stage)
    known = _kept.get("renderer")
    if known is None or known[0] != key:
        _close_renderer()
        _kept["renderer"] = (key, Renderer(options.backend, stage=options.stage))
    return _kept["renderer"][1]


def _close_renderer():
    _, renderer = _kept.pop("renderer", (None, None))
    if renderer is not None:
        renderer.close()


atexit.register(release)
