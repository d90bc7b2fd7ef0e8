"""Where passes over pixels and texels run: compute or fragment, by what the driver is faster at."""

import threading

import numpy as np

from . import _core
from .camera import Camera
from .settings import ShadowSettings

__all__ = ["STAGES", "check_stage", "faster_stage"]

#: Names in the order of their numbers in the core.
STAGES = ("compute", "fragment")

# Compute is what the figures of the documentation are of: the other must be faster beyond noise.
CLEARLY_FASTER = 0.9
ROUNDS = 5
SIZE = (256, 256)

_known = {}  # driver -> stage; one answer for all renderers of a process
_lock = threading.Lock()


def check_stage(stage):
    """Refuse what is no stage.

    Parameters
    ----------
    stage : object

    Raises
    ------
    ValueError
        If it is not ``"auto"``, ``"compute"`` or ``"fragment"``.
    """
    if stage not in ("auto", *STAGES):
        raise ValueError(f"stage must be one of auto, {', '.join(STAGES)} (got {stage!r})")


def faster_stage(info, open_core):
    """The stage that a driver is faster at; timed once a process, then remembered.

    A mask without shadows is made a few times in each stage by turns: its programs compile in a
    tenth of a second, and what the stages differ in is how pixels get into a shader and answers out
    of it. That is done in a context of its own: a renderer's programs and objects are its user's.

    Parameters
    ----------
    info : dict
        What the core says of a renderer on the driver in question.
    open_core : callable
        Makes another one.

    Returns
    -------
    stage : {"compute", "fragment"}
    """
    driver = tuple(info[name] for name in ("backend", "vendor", "renderer", "version"))
    with _lock:
        if driver not in _known:
            core = open_core()
            try:
                _known[driver] = _faster_of(_times(core))
            finally:
                core.close()
        return _known[driver]


def _faster_of(times_ms):
    """By the least times [ms]: whatever else a machine does only adds to them."""
    compute, fragment = (min(times_ms[stage]) for stage in STAGES)
    return "fragment" if fragment < CLEARLY_FASTER * compute else "compute"


def _times(core):
    """Milliseconds of the mask, a list for each stage."""
    camera = Camera.look_at((0, 3, 4), (0, 0, 0), near=1.0, far=20.0, size=SIZE)
    corners = np.array([[-9.0, 0, -9], [0, 0, 9], [9, 0, -9]])
    scene = ((corners, np.array([[0, 1, 2]], np.int32)),), np.zeros(1, np.int32), np.eye(4)[None]
    handle = core.upload(*scene, np.zeros(3))
    bounds = np.concatenate([corners.min(axis=0), corners.max(axis=0)])
    arrays = {"mask": np.empty(SIZE, np.float32)}
    times = {stage: [] for stage in STAGES}
    for _ in range(ROUNDS):
        for number, stage in enumerate(STAGES):
            core.set_stage(number)
            result = core.render(
                handle, camera, np.array([0.0, 1.0, 0.0]), ShadowSettings(filter="none"), bounds,
                None, _core.OUTPUTS["mask"], arrays, None, None, 0.0,
            )  # fmt: skip
            times[stage].append(result["lists"]["timings_ms"]["shadow_mask"])
    return times
