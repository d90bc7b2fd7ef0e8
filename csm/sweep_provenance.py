"""Where the numbers of a sweep came from: the attributes of its dataset."""

import datetime
import json
import platform
from importlib import metadata

import numpy as np

from .digests import code_digest, commit
from .sweep_cases import camera_text, sun_text
from .timing import LEAST, MOST, SPREAD

__all__ = ["provenance"]


def provenance(cases, axes, base, records, protocol, measured_by):
    """Attributes of a sweep's dataset: strings and numbers, as netCDF has them.

    Parameters
    ----------
    cases : sequence of Case
    axes : sequence of Axis
    base : ShadowSettings
    records : iterable of dict
    protocol : dict of str to object
        The arguments of `csm.sweep` that all points were measured with.
    measured_by : str
        Who did, e.g. ``"this process"``.

    Returns
    -------
    attributes : dict of str to str or number
    """
    found = [record for record in records if record["driver"]]
    versions = {
        "numpy": np.__version__,
        **{name: _version(name) for name in ("xarray", "embreex", "netCDF4")},
    }
    shown = {
        case.name: {
            "scene": case.source or case.scene.name,
            "scene_digest": case.scene_digest,
            "triangles": case.scene.triangle_count,
            "ground": case.ground,
            "camera": json.loads(camera_text(case.camera)),
            "sun": json.loads(sun_text(case.sun)),
        }
        for case in cases
    }
    repeats = protocol["repeats"]
    return {
        "title": "Shadow error, time and memory by settings",
        "csm": metadata.version("cascaded-shadow-maps"),
        "commit": commit(),
        "code": code_digest(),
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "versions": json.dumps(versions),
        "driver": _each({_driver_text(record["driver"]) for record in found}),
        "machine": _each({record["machine"] for record in found}),
        "clock": _each({record["clock"] for record in found if record["clock"]}),
        "backend": protocol["backend"],
        "stage": protocol["stage"],
        "stage_used": _each({record["driver"]["stage"] for record in found}),
        "measured_by": measured_by,
        "timing": (
            "medians and quartiles over frames that count; a frame that does not count goes before "
            "whenever another point's was drawn; points of a case in turns, eight at a time, with "
            "the sweep's first settings among them (ms_reference); ms_total is the sum of the "
            "passes without readback"
        ),
        "repeats": (
            f"{LEAST} to {MOST}, until the quartiles lie within {SPREAD:.0%} of the median"
            if repeats is None
            else str(repeats)
        ),
        "rays_per_pixel": protocol["rays_per_pixel"],
        "standard_error": protocol["standard_error"] or "",
        "seed": "none in the sweep: what is spread is a function of the numbers of pixel and ray",
        "causes": " ".join(protocol["causes"]),
        "base": json.dumps(base.to_dict()),
        "axes": json.dumps({axis.name: list(axis.changes) for axis in axes}),
        "cases": json.dumps(shown),
    }


def _version(package):
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def _driver_text(driver):
    return f"{driver['backend']} ({driver['platform']}): {driver['renderer']}, {driver['version']}"


def _each(texts):
    return "; ".join(sorted(texts))
