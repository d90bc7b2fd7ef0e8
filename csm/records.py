"""Recommendations as plain values, and back: what a file of one holds, and what it cannot hold.

A scene is not written, only its digest and its bounds; the arrays of coarse pictures
(`Signals.views`) are not written either. Everything else comes back bit for bit.
"""

from dataclasses import fields

import numpy as np

from .camera import Camera
from .decisions import Reason
from .digests import scene_digest
from .formats import check_keys, named, read_file
from .record_rules import GOAL_RANGES, check_agreement
from .settings import ShadowSettings
from .signals import Signals
from .spaces import as_vector, frozen, real_array
from .sun import Sun

__all__ = ["FORMAT", "known_scene", "load_settings", "plain_values", "read_values"]

FORMAT = "csm recommendation 1"
UNIT = 1e-15  # how far from 1 the length of a unit vector may be, written by us

KEYS = (
    *("format", "expected_error", "expected_ms", "map_bytes", "met", "obstacle"),
    *("splits", "texels"),
    *("settings", "goal", "signals", "scene", "path", "reasons"),
)
OPTIONAL = ("obstacle",)  # None, which TOML leaves out
ADDED = ("verification", "exports")  # by `csm recommend --json`: not read
GOALS = tuple(GOAL_RANGES)
REASON_KEYS = tuple(field.name for field in fields(Reason))
CAMERA_KEYS = tuple(field.name for field in fields(Camera))
SUN_KEYS = ("to_light", "angular_diameter_deg")
SIGNAL_FIELDS = {f.name: f.type for f in fields(Signals) if f.name != "views"}


def plain_values(recommendation):
    """Everything of a recommendation that a file can hold.

    Parameters
    ----------
    recommendation : Recommendation

    Returns
    -------
    values : dict
        Text, numbers, truth values, None, lists and dicts of them.
    """
    settings = recommendation.settings.to_dict()
    reasons = []
    for reason in recommendation.reasons:
        flipped = reason.flipped and {
            name: value
            for name, value in reason.flipped.to_dict().items()
            if value != settings[name]
        }
        reasons.append({**vars(reason), "value": _plain(reason.value), "flipped": flipped})
    cameras, suns = recommendation.path
    return {
        "format": FORMAT,
        "settings": settings,
        "reasons": reasons,
        "signals": _plain(recommendation.signals.to_dict()),
        "splits": list(recommendation.splits),
        "texels": list(recommendation.texels),
        "expected_error": recommendation.expected_error,
        "expected_ms": recommendation.expected_ms,
        "map_bytes": recommendation.map_bytes,
        "goal": dict(recommendation.goal),
        "met": recommendation.met,
        "obstacle": recommendation.obstacle,
        "scene": known_scene(recommendation),
        "path": {
            "cameras": [{key: _plain(getattr(one, key)) for key in CAMERA_KEYS} for one in cameras],
            "suns": [{key: _plain(getattr(one, key)) for key in SUN_KEYS} for one in suns],
        },
    }


def known_scene(recommendation):
    """Digest and bounds of a recommendation's scene, whether it has that or was read from a file.

    Parameters
    ----------
    recommendation : Recommendation

    Returns
    -------
    known : dict
        ``digest`` : str; ``bounds`` : list of two points [m].
    """
    scene = recommendation.scene
    if scene is None:
        return dict(recommendation.scene_mark)
    return {"digest": scene_digest(scene), "bounds": scene.bounds.tolist()}


def read_values(values):
    """What makes a recommendation, of the values that `plain_values` gives.

    Parameters
    ----------
    values : dict
        None may be left out.

    Returns
    -------
    arguments : dict
        Of `Recommendation`; its scene is None.

    Raises
    ------
    TypeError, ValueError
        If a key is missing or unknown, a value is not allowed, or two contradict each other, as
        splits and the number of cascades; the text says which.
    """
    needed = [key for key in KEYS if key not in OPTIONAL]
    check_keys("a recommendation", values, (*KEYS, *ADDED), needed)
    if values["format"] != FORMAT:
        raise ValueError(f"format must be {FORMAT!r} (got {values['format']!r})")
    settings = _within("settings", ShadowSettings.from_dict, values["settings"])
    check_keys("scene", values["scene"], ("digest", "bounds"), ("digest", "bounds"))
    check_keys("path", values["path"], ("cameras", "suns"), ("cameras", "suns"))
    bounds = real_array("scene.bounds", values["scene"]["bounds"]).astype(np.float64)
    if bounds.shape != (2, 3) or not (np.isfinite(bounds).all() and (bounds[0] <= bounds[1]).all()):
        raise ValueError(
            f"scene.bounds must be two points, least and greatest (got {bounds.tolist()})"
        )
    obstacle = values.get("obstacle")
    found = {
        "settings": settings,
        "reasons": [
            _within(f"reasons[{number}]", _reason, one, settings)
            for number, one in enumerate(_list("reasons", values["reasons"]))
        ],
        "signals": _within("signals", _signals, values["signals"]),
        **{
            name: tuple(_number(name, one) for one in _list(name, values[name]))
            for name in ("splits", "texels")
        },
        "expected_error": _number("expected_error", values["expected_error"]),
        "expected_ms": _number("expected_ms", values["expected_ms"]),
        "map_bytes": _exactly("map_bytes", values["map_bytes"], int),
        "goal": _within("goal", _goal, values["goal"]),
        "met": _exactly("met", values["met"], bool),
        "obstacle": None if obstacle is None else _exactly("obstacle", obstacle, str),
        "scene": None,
        "scene_mark": {
            "digest": _exactly("scene.digest", values["scene"]["digest"], str),
            "bounds": bounds.tolist(),
        },
        "path": (
            tuple(
                _within(f"path.cameras[{number}]", _camera, one)
                for number, one in enumerate(_list("path.cameras", values["path"]["cameras"], 1))
            ),
            tuple(
                _within(f"path.suns[{number}]", _sun, one)
                for number, one in enumerate(_list("path.suns", values["path"]["suns"], 1))
            ),
        ),
    }
    check_agreement(found)
    return found


def load_settings(path):
    """Settings of a file: one of settings, of a recommendation, or what a failed test left.

    Parameters
    ----------
    path : path_like
        ``.json`` or ``.toml``. Of a recommendation its settings alone count: a person may have
        changed them, which then are no longer those that the rest of the file is about.

    Returns
    -------
    settings : ShadowSettings

    Raises
    ------
    OSError, TypeError, ValueError
        If it cannot be read, is no such file, or a setting is unknown or breaks its rule.
    """
    values = read_file(path)
    with named(path):
        if values.get("format") == FORMAT:
            check_keys("a recommendation", values, (*KEYS, *ADDED), ["settings"])
            return _within("settings", ShadowSettings.from_dict, values["settings"])
        if isinstance(values.get("settings"), dict):  # evidence of csm.pytest_plugin
            values = values["settings"]
        return ShadowSettings.from_dict(values)


def _within(where, read, *arguments):
    """Read a part; a refusal says where it is."""
    with named(where):
        return read(*arguments)


def _reason(values, settings):
    needed = [key for key in REASON_KEYS if key != "flipped"]
    check_keys("a reason", values, REASON_KEYS, needed)
    value, flipped = values["value"], values.get("flipped")
    if flipped is not None:
        check_keys("flipped", flipped, list(settings.to_dict()))
        flipped = settings.replace(**flipped)
    texts = {
        key: _exactly(key, values[key], str)
        for key in ("effect", "measured", "threshold", "source", "cost")
    }
    return Reason(
        **texts,
        value=tuple(value) if isinstance(value, list) else value,
        taken=_exactly("taken", values["taken"], bool),
        flipped=flipped,
        saves=_exactly("saves", values["saves"], bool),
    )


def _signals(values):
    check_keys("signals", values, SIGNAL_FIELDS, SIGNAL_FIELDS)
    read = {}
    for name, kind in SIGNAL_FIELDS.items():
        value = values[name]
        if kind is np.ndarray:
            read[name] = frozen(np.array([_number(name, one) for one in _list(name, value)]))
        elif kind is float:
            read[name] = _number(name, value)
        elif kind in (int, bool):
            read[name] = _exactly(name, value, kind)
        else:  # tuple[float, ...], tuple[int, ...]
            whole = kind.__args__[0] is int
            read[name] = tuple(
                _exactly(name, one, int) if whole else _number(name, one)
                for one in _list(name, value)
            )
    return Signals(views=(), **read)


def _goal(values):
    check_keys("goal", values, GOALS)
    given = {key: values.get(key) for key in GOALS}
    return {key: None if one is None else _number(key, one) for key, one in given.items()}


def _camera(values):
    check_keys("a camera", values, CAMERA_KEYS, CAMERA_KEYS)
    return Camera(**values)


def _sun(values):
    check_keys("a sun", values, SUN_KEYS, SUN_KEYS)
    sun = Sun(**values)
    given = as_vector("to_light", values["to_light"])
    if abs(np.linalg.norm(given) - 1.0) <= UNIT:  # dividing it by its length again may move a bit
        object.__setattr__(sun, "to_light", frozen(given))
    return sun


def _list(name, value, least=0):
    if not isinstance(value, list | tuple):
        raise TypeError(f"{name} must be a list (got {value!r})")
    if len(value) < least:
        raise ValueError(f"{name} must have at least {least} entry")
    return value


def _exactly(name, value, kind):
    if type(value) is not kind:
        words = {int: "a whole number", bool: "true or false", str: "a text"}
        raise TypeError(f"{name} must be {words[kind]} (got {value!r})")
    return value


def _number(name, value):
    """A float; "inf" and "nan" are how JSON says what is not finite."""
    if isinstance(value, str) and value in ("inf", "-inf", "nan"):
        return float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{name} must be a number (got {value!r})")
    return float(value)


def _plain(value):
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value
