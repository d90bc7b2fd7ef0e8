"""Words of the command line to scenes, cameras, suns and settings; every refusal is a sentence."""

import difflib
import os
import re
from dataclasses import fields
from pathlib import Path

import numpy as np

from .camera import MAX_SIZE, Camera
from .formats import named
from .loading import load, load_elevation
from .scenes import SCENES
from .settings import ShadowSettings
from .spaces import as_number
from .sun import Sun
from .tracing import MAX_RAYS_PER_PIXEL

__all__ = [
    "INTERRUPTED",
    "add_backend_option",
    "check_folder",
    "find_camera",
    "find_cameras",
    "find_scene",
    "find_sun",
    "find_suns",
    "parse_file",
    "parse_folder",
    "parse_rays",
    "parse_settings",
    "parse_size",
]

ELEVATION_SUFFIXES = (".npz", ".npy", ".tif", ".tiff")
INTERRUPTED = 130  # exit status: 128 + SIGINT, as shells have it
CAMERA_WORDS = ("eye", "target", "up", "fov", "near", "far")


def add_backend_option(add):
    """Add ``--backend`` to a subcommand; `add` is its parser's ``add_argument``."""
    add(
        "--backend",
        choices=("auto", "egl", "osmesa", "glfw"),
        default="auto",
        help="how OpenGL is opened (default auto, which CSM_BACKEND replaces)",
    )


def check_folder(folder, said="--out"):
    """Refuse a folder that cannot be written, before any work is done.

    Parameters
    ----------
    folder : Path
        May be new; may hold other files, which are left alone.
    said : str
        What the user wrote before it.

    Raises
    ------
    OSError
        If it is a file, or it or the nearest folder above it is not writable.
    """
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(f"{said} {folder}: is a file, not a folder")
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        raise PermissionError(f"{said} {folder}: {existing} is not a folder that may be written to")


def find_scene(text, ground=None, said="SCENE"):
    """Load a file, or make the scene of that name.

    Parameters
    ----------
    text : str
        A name of `csm.scenes.SCENES`, or a path; a file named like a made scene is ``./name``.
    ground : float, optional
        Put a ground at this height over the scene's georeference [m].
    said : str
        What a refusal calls the text.

    Returns
    -------
    scene : Scene

    Raises
    ------
    OSError, ValueError, ImportError
        If there is neither such a file nor such a scene, or it does not load.
    """
    if text in SCENES:
        scene = SCENES[text]()
    elif Path(text).suffix.lower() in ELEVATION_SUFFIXES:
        scene = load_elevation(text)
    elif Path(text).suffix or Path(text).exists():
        scene = load(text)
    else:
        known = ", ".join(SCENES)
        raise ValueError(
            f"{said} must be a file or one of {known} (got {text!r}{_hint(text, SCENES)})"
        )
    return scene if ground is None else scene.with_ground(scene.georeference[1] + ground)


def find_camera(scene, text, size, said="--camera"):
    """Return the camera of that name, or the one described, with a number of pixels.

    Parameters
    ----------
    scene : Scene
    text : str or None
        A name, or ``eye=x,y,z,target=x,y,z`` with ``up``, ``fov``, ``near``, ``far`` if wanted, eye
        and target relative to the scene's georeference; far reaches all of the scene by default.
        None: the scene's first camera.
    size : (int, int)
        Width and height in pixels.
    said : str
        What a refusal calls the text.

    Returns
    -------
    name : str or None
    camera : Camera

    Raises
    ------
    ValueError
        If there is no such camera or the description is wrong.
    """
    if not _is_described(text):
        name = _named("camera", said, text, scene.cameras, "eye=x,y,z,target=x,y,z")
        return name, scene.cameras[name].replace(size=size)
    words = _camera_words(text, said)
    return None, _described_camera(scene, words, _reach(scene, words), size)


def find_cameras(scene, texts, size, said="--camera"):
    """Return the cameras of a path, from as many texts.

    Parameters
    ----------
    scene : Scene
    texts : sequence of str
        As for `find_camera`, but that cameras described without ``far`` share the farthest of
        theirs: a far of its own for each would cut the shadow range anew on every step.
        None at all: the scene's first camera.
    size : (int, int)
        Width and height in pixels.
    said : str
        What a refusal calls a text.

    Returns
    -------
    cameras : tuple of Camera

    Raises
    ------
    ValueError
        If one is none.
    """
    described = [_camera_words(text, said) for text in texts if _is_described(text)]
    far = max((_reach(scene, words) for words in described if "far" not in words), default=None)
    words = iter(described)
    return tuple(
        _described_camera(scene, next(words), far, size)
        if _is_described(text)
        else find_camera(scene, text, size, said)[1]
        for text in texts or (None,)
    )


def _is_described(text):
    """Whether a text describes a camera, and does not name one."""
    return text is not None and "=" in text


def _camera_words(text, said):
    """Return the numbers that describe a camera, by their words."""
    words = {}
    for part in re.split(r",(?=\s*[A-Za-z_]+\s*=)", text):
        word, _, value = part.partition("=")
        word = word.strip()
        if word not in CAMERA_WORDS or word in words:
            problem = "twice" if word in words else f"unknown{_hint(word, CAMERA_WORDS)}"
            raise ValueError(
                f"{said} takes {', '.join(CAMERA_WORDS)}, each once ({word!r} is {problem})"
            )
        count = 3 if word in ("eye", "target", "up") else 1
        words[word] = _numbers(f"{said} {word}", value, count)
    for word in ("eye", "target"):
        if word not in words:
            raise ValueError(f"{said} needs {word}=x,y,z (got {text!r})")
    return words


def _reach(scene, words):
    """Return the far with which a described camera sees to the end of the scene [m]."""
    farthest = np.abs(scene.bounds - scene.georeference - words["eye"]).max(axis=0)
    return 1.01 * float(np.linalg.norm(farthest))


def _described_camera(scene, words, far, size):
    """Return the camera that words describe, with that far if they give none."""
    # Looked at locally and moved: a direction between points at 1e6 m would lose digits.
    camera = Camera.look_at(
        words["eye"],
        words["target"],
        words.get("up", (0.0, 1.0, 0.0)),
        fov_y_deg=words.get("fov", [60.0])[0],
        near=words.get("near", [0.1])[0],
        far=words.get("far", [far])[0],
        size=size,
    )
    return camera.translated(scene.georeference)


def find_sun(scene, text, diameter=None, said="--sun"):
    """Return the sun of that name, or the one described.

    Parameters
    ----------
    scene : Scene
    text : str or None
        A name; ``x,y,z`` towards the sun; or ``azimuth,elevation`` in degrees, azimuth by the
        compass: 0 north (-z), 90 east (+x). None: the scene's first sun.
    diameter : float, optional
        Of the disc [degrees]; by default the named sun's own, or 0.
    said : str
        What a refusal calls the text.

    Returns
    -------
    name : str or None
    sun : Sun

    Raises
    ------
    ValueError
        If there is no such sun or the description is wrong.
    """
    name = None
    if text is None or not re.match(r"\s*[-+.\d]", text):
        name = _named("sun", said, text, scene.suns, "x,y,z or azimuth,elevation")
        sun = scene.suns[name]
    else:
        numbers = _numbers(said, text, 2, 3)
        sun = Sun(numbers) if len(numbers) == 3 else Sun.from_compass(*numbers)
    return name, sun if diameter is None else Sun(sun.to_light, diameter)


def check_ground(height):
    """Refuse a ``--ground`` that is no height, before a scene is loaded for it.

    Parameters
    ----------
    height : float or None
        In metres.

    Raises
    ------
    ValueError
        If it is not finite.
    """
    if height is not None:
        as_number("--ground", height, rule="a finite height in metres")


def check_sun_diameter(diameter):
    """Refuse a ``--sun-diameter`` that no sun may have, before a scene is loaded for it.

    Parameters
    ----------
    diameter : float or None
        In degrees.

    Raises
    ------
    ValueError
        If it is out of range.
    """
    if diameter is not None:
        with named("--sun-diameter"):
            Sun((0.0, 1.0, 0.0), diameter)


def find_suns(scene, texts, diameter=None, said="--sun"):
    """Return the suns of a path, from as many texts.

    Parameters
    ----------
    scene : Scene
    texts : sequence of str
        As for `find_sun`. None at all: the scene's first sun.
    diameter : float, optional
        Of every disc [degrees]; by default a named sun's own, or 0.
    said : str
        What a refusal calls a text.

    Returns
    -------
    suns : tuple of Sun

    Raises
    ------
    ValueError
        If one is none.
    """
    return tuple(find_sun(scene, text, diameter, said)[1] for text in texts or (None,))


def parse_size(text):
    """Return (width, height) of ``WIDTHxHEIGHT``; ValueError if it is none."""
    # Of at most 9 digits: int refuses thousands of them with a sentence of its own.
    match = re.fullmatch(r"(\d{1,9})[xX](\d{1,9})", text.strip())
    size = (int(match[1]), int(match[2])) if match else ()
    if not size or not all(1 <= side <= MAX_SIZE for side in size):
        raise ValueError(
            "--size must be WIDTHxHEIGHT in pixels, each 1 to "
            f"{MAX_SIZE}, like 1280x720 (got {text!r})"
        )
    return size


def parse_rays(text):
    """Return the number of rays per pixel that a text says; ValueError if it is none."""
    if not re.fullmatch(r"\d{1,9}", text.strip()) or not 1 <= int(text) <= MAX_RAYS_PER_PIXEL:
        raise ValueError(
            f"--rays must be a whole number from 1 to {MAX_RAYS_PER_PIXEL} (got {text!r})"
        )
    return int(text)


def parse_folder(text):
    """Return the path of a folder; ValueError for no text, which a path would take for ``.``."""
    if not text.strip():
        raise ValueError(f"--out must name a folder (got {text!r})")
    return Path(text)


def parse_file(option, text, suffixes=None):
    """Return the path of a file to be written; refused before any work is done.

    Parameters
    ----------
    option : str
        What the user wrote before it.
    text : str
    suffixes : sequence of str, optional
        That it may end in.

    Returns
    -------
    path : Path

    Raises
    ------
    OSError, ValueError
        If it ends otherwise, is a folder, or its folder is not there.
    """
    path = Path(text)
    if not text.strip():
        raise ValueError(f"{option} must name a file (got {text!r})")
    if suffixes and path.suffix.lower() not in suffixes:
        raise ValueError(f"{option} must end in {' or '.join(suffixes)} (got {text!r})")
    if path.is_dir():
        raise IsADirectoryError(f"{option} {text}: is a folder, not a file")
    if not path.absolute().parent.is_dir():
        raise FileNotFoundError(f"{option} {text}: its folder is not there")
    return path


def parse_settings(words, base=None):
    """Return the `ShadowSettings` that words like ``map_size=1024`` change from the defaults.

    Parameters
    ----------
    words : sequence of str
        ``key=value``; several numbers are separated by commas.
    base : ShadowSettings, optional
        To be changed instead of the defaults.

    Returns
    -------
    settings : ShadowSettings

    Raises
    ------
    ValueError
        If a key is unknown or given twice, or a value is not allowed.
    """
    defaults = ShadowSettings()
    known = [field.name for field in fields(ShadowSettings)]
    changes = {}
    for word in words:
        key, equals, value = (part.strip() for part in word.partition("="))
        if not equals or not value:
            raise ValueError(f"--set takes key=value (got {word!r})")
        if key not in known:
            raise ValueError(
                f"--set knows no {key!r}{_hint(key, known)}; the settings are {', '.join(known)}"
            )
        if key in changes:
            raise ValueError(f"--set {key} is given twice")
        changes[key] = _value(key, value, getattr(defaults, key))
    return (base or defaults).replace(**changes)


def _value(key, text, default):
    """Return the text as what the setting's default is: a bool, several numbers, one, a word."""
    if isinstance(default, bool):
        values = {"true": True, "on": True, "1": True, "false": False, "off": False, "0": False}
        if text.lower() not in values:
            raise ValueError(f"--set {key} must be true or false (got {text!r})")
        return values[text.lower()]
    if isinstance(default, tuple) or "," in text:
        return tuple(_number(part) for part in text.split(",") if part.strip())
    return _number(text)


def _number(text):
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text.strip()


def _numbers(what, text, *counts):
    """Return the comma-separated numbers of a text, as many as one of `counts`."""
    parts = text.split(",")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = None
    if numbers is None or len(numbers) not in counts or not np.isfinite(numbers).all():
        wanted = " or ".join(map(str, counts))
        raise ValueError(
            f"{what} must be {wanted} number{'s' * (counts[-1] > 1)}, with commas (got {text!r})"
        )
    return numbers


def _named(kind, said, name, views, otherwise):
    if name in views:
        return name
    if name is None:
        if views:
            return next(iter(views))
        raise ValueError(f"the scene brings no {kind}: give one with {said} {otherwise}")
    known = f"one of {', '.join(views)}, or {otherwise}" if views else f"{otherwise}"
    raise ValueError(f"{said} must be {known} (got {name!r}{_hint(name, views)})")


def _hint(word, known):
    close = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""
