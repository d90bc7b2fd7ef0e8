"""What `csm render` leaves behind: pictures, arrays, and a summary for programs and for people."""

import json
import math
import os
import platform
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from .pictures import (
    cascades_picture,
    error_picture,
    lit_picture,
    maps_picture,
    mask_picture,
    save_png,
)

__all__ = ["summarise", "summary_text", "write_results"]

SUMMARY = "summary.json"
FILES = (
    "picture.png",
    "mask.png",
    "cascades.png",
    "maps.png",
    "error.png",
    "frame.npz",
    SUMMARY,
)
LANDSCAPE = 1500.0  # a scene of this width [m] is drawn as terrain
MEGABYTE = 1e6
BY_SIGN = ("total", "too_bright", "too_dark")  # what takes no more rays


def write_results(folder, frame, summary, *, truth=None, report=None, terrain=False):
    """Write every file, or none: what fails or is interrupted on the way is undone.

    The files are made in a hidden folder beside their places and moved there when all are complete;
    those of an earlier run are held in the same folder until then. A process that is killed, or
    interrupted again while it undoes, may leave that folder, ``.csm-*``, with what it held.

    Parameters
    ----------
    folder : Path
        Made if need be. Files of an earlier run are replaced; others are left alone.
    frame : Frame
    summary : dict
        From `summarise`.
    truth : Truth, optional
    report : ErrorReport, optional
    terrain : bool
        As in `lit_picture`.

    Returns
    -------
    names : list of str
        The files written.

    Raises
    ------
    OSError
        If writing fails; nothing then has changed.
    """
    made = [path for path in (folder, *folder.absolute().parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Inside the folder: moving a file to its name is atomic on one file system only.
        held = Path(tempfile.mkdtemp(prefix=".csm-", dir=folder))
        try:
            for name, picture in _pictures(frame, report, terrain):
                save_png(held / name, picture)
            np.savez(held / "frame.npz", **_arrays(frame, truth, report))
            text = json.dumps(_plain(summary), indent=1, allow_nan=False)
            (held / SUMMARY).write_text(text + "\n", encoding="utf-8")
        except BaseException:
            shutil.rmtree(held, ignore_errors=True)
            raise
        names = [name for name in FILES if (held / name).exists()]
        _put_in_place(held, folder, names)
    except BaseException:
        for path in made:  # the deepest first; what somebody else has put there stays
            with suppress(OSError):
                path.rmdir()
        raise
    return names


def _put_in_place(held, folder, names):
    """Move the new files out of `held` to their names, and drop it with those of an earlier run."""
    earlier = held / "earlier"
    try:
        earlier.mkdir()
        for name in FILES:
            if (folder / name).is_dir():
                raise IsADirectoryError(f"--out {folder}: {name} there is a folder")
            if os.path.lexists(folder / name):
                os.replace(folder / name, earlier / name)
        for name in names:
            os.replace(held / name, folder / name)
    except BaseException:
        # By what lies where, not by what was noted: an interrupt may fall between the two.
        for name in FILES:
            if os.path.lexists(earlier / name):
                os.replace(earlier / name, folder / name)
            elif name in names and not (held / name).exists():
                (folder / name).unlink(missing_ok=True)
        shutil.rmtree(held, ignore_errors=True)
        raise
    shutil.rmtree(held, ignore_errors=True)


def _pictures(frame, report, terrain):
    picture = lit_picture(frame, terrain=terrain)
    yield "picture.png", picture
    yield "mask.png", mask_picture(frame)
    yield "cascades.png", cascades_picture(frame, picture)
    if "shadow_maps" in frame.outputs:  # filter="none" makes none
        yield "maps.png", maps_picture(frame)
    if report is not None:
        yield "error.png", error_picture(report, picture)


def _arrays(frame, truth, report):
    """Return what frame.npz holds: the frame's arrays and matrices, and the truth's."""
    arrays = {name: getattr(frame, name) for name in frame.outputs}
    if isinstance(arrays.get("shadow_maps"), tuple):  # of different sizes: an array each
        for i, depth in enumerate(arrays.pop("shadow_maps")):
            arrays[f"shadow_map_{i}"] = depth
    for name in (
        *("splits", "texel_size", "lattice", "depth_range", "light_from_world"),
        *("clip_from_light", "clip_from_world", "uvz_from_world"),
    ):
        arrays[name] = getattr(frame.cascades, name)
    arrays["view_from_world"] = frame.camera.view_from_world
    arrays["clip_from_view"] = frame.camera.clip_from_view
    arrays["to_light"] = frame.sun.to_light
    if truth is not None:
        arrays["truth_mask"] = truth.mask
        arrays["truth_facing"] = truth.facing
        arrays["truth_occluder_distance"] = truth.occluder_distance.astype(np.float32)
        arrays["judged"] = report.judged
    return arrays


def summarise(
    scene, frame, *, names=(None, None), version, seconds, truth=None, judged=None, causes=BY_SIGN
):
    """Gather what a run was and what it found, as plain nested dicts.

    Parameters
    ----------
    scene : Scene
    frame : Frame
    names : (str or None, str or None)
        Of camera and sun, where they have one.
    version : str
        Of csm.
    seconds : dict of str to float
        Wall time of the stages.
    truth : Truth, optional
    judged : (ErrorReport, EdgeYardstick), optional
    causes : sequence of str or None
        Causes to work out, None for all that there are.

    Returns
    -------
    summary : dict
    """
    camera, sun = frame.camera, frame.sun
    summary = {
        "csm": version,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scene": {
            "name": scene.name,
            "triangles": scene.triangle_count,
            "stored_triangles": scene.stored_triangle_count,
            "bounds": scene.bounds,
            "georeference": scene.georeference,
        },
        "camera": {
            "name": names[0],
            **{key: getattr(camera, key) for key in ("eye", "right", "up", "backward")},
            "fov_y_deg": camera.fov_y_deg,
            "near": camera.near,
            "far": camera.far,
            "size": camera.size,
            "orthographic": camera.orthographic,
        },
        "sun": {
            "name": names[1],
            "to_light": sun.to_light,
            "angular_diameter_deg": sun.angular_diameter_deg,
        },
        "settings": frame.settings.to_dict(),
        "cascades": _cascade_rows(frame),
        "timings_ms": dict(frame.timings_ms),
        "seconds": dict(seconds),
        "info": dict(frame.info),
    }
    if truth is not None:
        report, yardstick = judged
        summary["truth"] = {"rays_per_pixel": truth.rays_per_pixel}
        summary["error"] = report.to_dict(causes) | {
            "edge_yardstick": yardstick.value,
            "edge_pairs": yardstick.edge_pairs,
        }
    return summary


def _cascade_rows(frame):
    if frame.settings.filter == "none":
        return []
    seen = np.count_nonzero(frame.valid) or 1
    return [
        {
            "near": frame.cascades.splits[i],
            "far": frame.cascades.splits[i + 1],
            "texel_size": frame.cascades.texel_size[i],
            "depth_range": frame.cascades.depth_range[i],
            "pixel_share": np.count_nonzero(frame.cascade_index == i) / seen,
        }
        for i in range(len(frame.cascades.texel_size))
    ]


def summary_text(summary):
    """Lay a summary out as text for people.

    Parameters
    ----------
    summary : dict
        From `summarise`.

    Returns
    -------
    text : str
        Some twenty lines, at most 80 columns.
    """
    scene, camera, info = summary["scene"], summary["camera"], summary["info"]
    width, height = camera["size"]
    lines = [
        f"{scene['name'] or 'scene'}: {scene['triangles']:,} triangles, camera "
        f"{camera['name'] or 'as given'}, sun {summary['sun']['name'] or 'as given'}, "
        f"{width} x {height}",
        f"{info.get('backend', '')}: {info.get('renderer', '')}".strip(": "),
        "",
    ]
    if summary["cascades"]:
        lines.append("cascade   from [m]     to [m]  texel [m]     pixels")
        for i, row in enumerate(summary["cascades"]):
            lines.append(
                f"{i:7d} {row['near']:10.4g} {row['far']:10.4g} "
                f"{max(row['texel_size']):10.4g} {row['pixel_share']:10.1%}"
            )
        lines.append("")
    lines += [f"{'pass':20}{'ms':>8}"]
    lines += [f"{name:20}{ms:8.2f}" for name, ms in summary["timings_ms"].items()]
    for key, what in (("bytes", "textures and buffers"), ("scene_bytes", "the scene")):
        if key in info:
            lines.append(f"{info[key] / MEGABYTE:.1f} MB for {what}")
    if "error" in summary:
        lines += ["", *_error_lines(summary["error"])]
    return "\n".join(lines)


def _error_lines(error):
    if not error["judged_count"]:
        return ["No pixel faces the sun within the shadow range: nothing to judge."]
    mean, yardstick = error["mean"], error["edge_yardstick"]
    rows = [
        ("wrong side of 0.5", error["disagreement"]),
        ("  expected of edges at this resolution", yardstick),
        ("mean absolute error", mean["total"]),
        *((f"  {name.replace('_', ' ')}", mean[name]) for name in mean if name != "total"),
        ("sun-facing pixels beyond the range", error["beyond_range"]),
    ]
    head = f"against ray tracing, {error['judged_count']:,} sun-facing pixels judged"
    return [head, *(f"{what:42}{value:8.3%}" for what, value in rows)]


def _plain(value):
    """Return a value as JSON has it: lists for arrays, null for what is not a finite number."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
