"""The cases of a sweep: a scene, a camera and a sun each, given as objects or by name."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from .arguments import find_camera, find_scene, find_sun
from .camera import Camera, checked_size
from .digests import scene_digest
from .scene import Scene
from .scenes import SCENES
from .sun import Sun

__all__ = ["Case", "camera_from_text", "camera_text", "cases_of", "sun_from_text", "sun_text"]


@dataclass(frozen=True)
class Case:
    """One case of a sweep.

    Attributes
    ----------
    name : str
    scene, camera, sun
        What is rendered and traced.
    source : str or None
        File or made scene that `scene` came from, which another process can load itself.
    ground : float or None
        Height of a ground put under the scene of `source` [m].
    scene_digest : str
    """

    name: str
    scene: Scene = field(repr=False)
    camera: Camera
    sun: Sun
    source: str | None
    ground: float | None
    scene_digest: str


def cases_of(cases, size=None):
    """Check the cases of a sweep, and load those given by name.

    Parameters
    ----------
    cases : mapping of str to (scene, camera, sun)
        Each an object, or what `csm render` takes: a file or the name of a made scene; a camera and
        a sun by their names in it or described; None for the scene's first. A scene may also be
        ``(source, ground)``, with a ground at that height [m], and a sun ``(name, diameter)``, with
        a disc of that width [degrees]. Or a Case, which is taken as it is.
    size : (int, int), optional
        Of every picture, instead of the cameras' own.

    Returns
    -------
    cases : tuple of Case

    Raises
    ------
    TypeError, ValueError, OSError
        If a case is none.
    """
    if not isinstance(cases, Mapping):
        raise TypeError(f"cases must map names to (scene, camera, sun) (got {cases!r})")
    if not cases:
        raise ValueError("cases must have at least one case (got none)")
    size = None if size is None else checked_size(size)
    loaded, digests = {}, {}
    return tuple(_case(name, case, size, loaded, digests) for name, case in cases.items())


def _case(name, case, size, loaded, digests):
    if not isinstance(name, str) or not name:
        raise TypeError(f"cases must have names (got {name!r})")
    if isinstance(case, Case):
        return case
    if not isinstance(case, (tuple, list)) or len(case) != 3:
        raise TypeError(f"cases: {name!r} must be (scene, camera, sun) (got {case!r})")
    scene, camera, sun = case
    source = ground = None
    if isinstance(scene, (tuple, list)) and len(scene) == 2:
        scene, ground = scene
    if isinstance(scene, str):
        # Another process, or a table read later, may stand in another folder.
        source = scene if scene in SCENES else str(Path(scene).absolute())
        if (source, ground) not in loaded:
            loaded[source, ground] = find_scene(scene, ground, f"cases: {name!r}: scene")
        scene = loaded[source, ground]
    if not isinstance(scene, Scene):
        raise TypeError(
            f"cases: {name!r}: scene must be a csm.Scene, a file or the name of a made scene "
            f"(got {scene!r})"
        )
    try:
        camera, sun = _found_camera(scene, camera), _found_sun(scene, sun)
    except ValueError as error:
        raise ValueError(f"cases: {name!r}: {error}") from None
    for what, value, kind in (("camera", camera, Camera), ("sun", sun, Sun)):
        if not isinstance(value, kind):
            raise TypeError(
                f"cases: {name!r}: {what} must be a csm.{kind.__name__} or a name (got {value!r})"
            )
    if id(scene) not in digests:
        digests[id(scene)] = scene_digest(scene)
    camera = camera if size is None else camera.replace(size=size)
    return Case(name, scene, camera, sun, source, ground, digests[id(scene)])


def _found_camera(scene, camera):
    if camera is not None and not isinstance(camera, str):
        return camera
    name = next(iter(scene.cameras), None) if camera is None else camera
    # A named camera keeps its pixels, one described has those of `Camera.look_at`.
    size = scene.cameras[name].size if name in scene.cameras else (1920, 1080)
    return find_camera(scene, camera, size, "camera")[1]


def _found_sun(scene, sun):
    diameter = None
    if isinstance(sun, (tuple, list)) and len(sun) == 2:
        sun, diameter = sun
    if sun is not None and not isinstance(sun, str):
        return sun
    return find_sun(scene, sun, diameter, "sun")[1]


def camera_text(camera):
    """JSON of a camera, to the last bit."""
    return json.dumps(
        {field.name: _listed(getattr(camera, field.name)) for field in fields(Camera)}
    )


def camera_from_text(text):
    """Camera of such a JSON."""
    return Camera(**json.loads(text))


def sun_text(sun):
    """JSON of a sun, to the last bit."""
    return json.dumps({name: _listed(value) for name, value in vars(sun).items()})


def sun_from_text(text):
    """Sun of such a JSON: its direction as it was, not normalised again."""
    values = json.loads(text)
    sun = object.__new__(Sun)
    sun.__setstate__({**values, "to_light": np.array(values["to_light"], np.float64)})
    return sun


def _listed(value):
    return value.tolist() if isinstance(value, np.ndarray) else value
