"""Files of cascades to check: how somebody else's engine tells what it placed.

docs/check-format.md describes the format.
"""

import difflib
import json
import re
from dataclasses import MISSING, fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from .camera import Camera
from .cascades import Cascades
from .checks import SELECTS, matched_frames
from .spaces import as_number, real_array

__all__ = ["read_check", "write_check"]

FORMAT = "csm check 1"
LAYOUTS = ("rows", "columns")
HANDS = ("right", "left")
# What a frame may say for itself, or the file for all frames.
SHARED = ("splits", "map_size", "clip_z", "pancake", "receivers")
FILE_KEYS = (
    *("format", "comment", "layout", "handedness", "select", "border_texels", "scene_bounds"),
    *(*SHARED, "frames"),
)
FRAME_KEYS = ("comment", "camera", "clip_from_world", *SHARED)
LOOK_KEYS = ("eye", "target", "forward", "up", "fov_y_deg", "height", "near", "far", "size")
AXES_KEYS = tuple(field.name for field in fields(Camera))
VECTORS = ("eye", "target", "forward", "up", "right", "backward")
MIRROR = np.array([1.0, 1.0, -1.0])  # of a left-handed world, into a right-handed one


def read_check(path):
    """Read a file of cascades to check.

    Parameters
    ----------
    path : path_like
        A JSON file, docs/check-format.md.

    Returns
    -------
    cascades : list of Cascades
    cameras : list of Camera
        One per frame; a left-handed world is mirrored in z.
    options : dict
        The rest of what `check_cascades` takes: ``check_cascades(cascades, cameras, **options)``.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError, TypeError
        If it is no such file; the text says where and why.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:  # of JSON, or bytes that are no UTF-8
        raise ValueError(f"{path}: not a JSON file ({error})") from None
    try:
        return _read(content)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{path}: {error}") from None


def write_check(
    path, cascades, camera, *, select="interval", scene=None, receivers=None, border_texels=0
):
    """Write cascades and their cameras to a file that ``csm check`` reads.

    Numbers are written with all their digits: what is read back gives the same check.

    Parameters
    ----------
    path : path_like
        Replaced if it is there.
    cascades, camera, select, scene, receivers, border_texels
        As in `check_cascades`; of a scene its bounds are written.

    Raises
    ------
    OSError
        If the file cannot be written.
    TypeError, ValueError
        As `check_cascades`.
    """
    sets, cameras, bounds, seen = matched_frames(cascades, camera, scene, receivers)
    if select not in SELECTS:
        raise ValueError(f"select must be one of {', '.join(SELECTS)} (got {select!r})")
    content = {"format": FORMAT, "layout": "rows", "handedness": "right", "select": select}
    content["border_texels"] = as_number("border_texels", border_texels, 0.0, rule="a number >= 0")
    if bounds is not None:
        content["scene_bounds"] = bounds.tolist()
    content["frames"] = [
        _frame_content(one, frame_camera, points)
        for one, frame_camera, points in zip(sets, cameras, seen, strict=True)
    ]
    text = json.dumps(content, indent=1, allow_nan=False)
    # A vector, or a row of a matrix, on one line.
    text = re.sub(r"\[[^\[\]{}]*\]", lambda numbers: " ".join(numbers[0].split()), text)
    Path(path).write_text(text + "\n", encoding="utf-8")


def _frame_content(cascades, camera, receivers):
    values = {key: getattr(camera, key) for key in AXES_KEYS}
    frame = {
        "camera": {
            key: value.tolist() if isinstance(value, np.ndarray) else value
            for key, value in values.items()
        },
        "splits": cascades.splits.tolist(),
        "map_size": cascades.map_size.tolist(),
        "pancake": cascades.pancake,
        "clip_from_world": cascades.clip_from_world.tolist(),
    }
    if receivers is not None:
        frame["receivers"] = receivers.tolist()
    return frame


# -- reading ---------------------------------------------------------------------------------------


def _read(content):
    _check_keys("the file", content, FILE_KEYS, ("format", "frames"))
    if content["format"] != FORMAT:
        raise ValueError(f'format must be "{FORMAT}" (got {content["format"]!r})')
    layout = _choice(content, "layout", LAYOUTS)
    mirror = MIRROR if _choice(content, "handedness", HANDS) == "left" else np.ones(3)
    frames = content["frames"]
    if not isinstance(frames, list) or not frames:
        raise ValueError("frames must be a list of at least one frame")
    sets, cameras, seen = [], [], []
    for number, frame in enumerate(frames):
        where = f"frames[{number}]"
        _check_keys(where, frame, FRAME_KEYS, ("camera", "clip_from_world"))
        merged = {key: content[key] for key in SHARED if key in content} | frame
        for key in ("splits", "map_size"):
            if key not in merged:
                raise ValueError(f"{where} needs {key}, its own or one of the file")
        try:
            cameras.append(_camera(merged["camera"], mirror))
            sets.append(_cascades(merged, layout, mirror))
            seen.append(_receivers(merged, mirror))
        except (TypeError, ValueError) as error:
            raise type(error)(f"{where}: {error}") from None
    options = {
        "select": _choice(content, "select", SELECTS),
        "border_texels": content.get("border_texels", 0),
    }
    if content.get("scene_bounds") is not None:
        options["scene"] = SimpleNamespace(bounds=_bounds(content["scene_bounds"], mirror))
    if any(points is not None for points in seen):
        if any(points is None for points in seen):
            raise ValueError("receivers must be given for every frame or for none")
        options["receivers"] = seen
    return sets, cameras, options


def _check_keys(where, value, known, required):
    if not isinstance(value, dict):
        raise TypeError(f"{where} must be an object with keys (got {type(value).__name__})")
    for key in value:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else ""
            raise ValueError(f"{where} has no key {key!r}{hint} (it has {', '.join(known)})")
    for key in required:
        if key not in value:
            raise ValueError(f"{where} needs {key}")


def _choice(content, key, choices):
    """A word of the file, by default the first of its choices."""
    word = content.get(key, choices[0])
    if word not in choices:
        raise ValueError(f"{key} must be one of {', '.join(choices)} (got {word!r})")
    return word


def _cascades(frame, layout, mirror):
    given = real_array("clip_from_world", frame["clip_from_world"]).astype(np.float64)
    if given.ndim < 1 or given.size % 16 or given.shape[-1] not in (4, 16):
        raise ValueError(
            "clip_from_world must be a list of matrices, each 16 numbers or 4 lists of 4 "
            f"(got shape {given.shape})"
        )
    matrices = given.reshape(-1, 4, 4)
    if layout == "columns":
        matrices = matrices.transpose(0, 2, 1)
    pancake = frame.get("pancake", False)
    if not isinstance(pancake, bool):
        raise TypeError(f"pancake must be true or false (got {pancake!r})")
    try:
        return Cascades.from_matrices(
            matrices * np.append(mirror, 1.0),
            frame["splits"],
            frame["map_size"],
            clip_z=frame.get("clip_z", (0, 1)),
            pancake=pancake,
        )
    except ValueError as error:
        other = LAYOUTS[1 - LAYOUTS.index(layout)]
        hint = f' (or say "layout": "{other}")' if "looks transposed" in str(error) else ""
        raise ValueError(f"{error}{hint}") from None


def _camera(words, mirror):
    if not isinstance(words, dict):
        raise TypeError(f"camera must be an object with keys (got {type(words).__name__})")
    given = {}
    for key, value in words.items():
        if key in VECTORS:
            value = real_array(f"camera.{key}", value)
            if value.shape != (3,):
                raise ValueError(f"camera.{key} must be 3 numbers (got shape {value.shape})")
            value = value * mirror
        given[key] = value
    if "size" in given:
        size = given["size"]
        given["size"] = tuple(size) if isinstance(size, list) else size
    if "backward" in given or "right" in given:
        needed = [field.name for field in fields(Camera) if field.default is MISSING]
        needed.remove("orthographic")
        _check_keys("camera", given, AXES_KEYS, needed)
        return Camera(**{"orthographic": False, **given})
    _check_keys("camera", given, LOOK_KEYS, ("eye", "near", "far", "size"))
    if ("target" in given) == ("forward" in given):
        raise ValueError("camera needs either target (a point) or forward (a direction)")
    if ("fov_y_deg" in given) == ("height" in given):
        raise ValueError("camera needs either fov_y_deg or, of parallel rays, height [m]")
    eye = given.pop("eye")
    forward = given.pop("forward") if "forward" in given else given.pop("target") - eye
    make = Camera.orthographic if "height" in given else Camera.look_at
    # Looked at from the origin and moved: far from it a target would lose digits.
    return make((0.0, 0.0, 0.0), forward, **given).translated(eye)


def _receivers(frame, mirror):
    if frame.get("receivers") is None:
        return None
    points = real_array("receivers", frame["receivers"])
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"receivers must be a list of points (got shape {points.shape})")
    return points * mirror


def _bounds(value, mirror):
    bounds = real_array("scene_bounds", value).astype(np.float64)
    if bounds.shape != (2, 3):
        raise ValueError(f"scene_bounds must be [[x, y, z], [x, y, z]] (got shape {bounds.shape})")
    if (bounds[0] > bounds[1]).any():
        raise ValueError(f"scene_bounds must be the lower and the upper corner (got {value})")
    return np.sort(bounds * mirror, axis=0)  # a mirror swaps the ends in z
