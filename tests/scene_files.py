"""Where the real test scenes are; the one place that knows.

They are not part of this repository. `CSM_SCENES` names their folder; without it they are looked
for in ``../shared/scenes`` beside the repository. Tests that need them skip when they are absent.
"""

import functools
import json
import os
from pathlib import Path

import pytest

_DEFAULT = Path(__file__).resolve().parents[2] / "shared" / "scenes"
FOLDER = Path(os.environ.get("CSM_SCENES") or _DEFAULT)


def scene_path(file_name):
    """Path of a scene file; skips the running test, with the reason, if it is absent."""
    path = FOLDER / file_name
    if not path.is_file():
        pytest.skip(f"test scene {path} is absent (set CSM_SCENES to the folder that holds it)")
    return path


@functools.cache
def entries():
    """The facts of scenes.json by scene name; empty if the scenes are absent."""
    path = FOLDER / "scenes.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


@functools.cache
def load_scene(name):
    """A scene by its name in scenes.json, loaded once per session."""
    import csm

    entry = entries().get(name)
    if entry is None:
        pytest.skip(f"test scene {name!r} is absent (set CSM_SCENES to the folder that holds it)")
    return csm.load(scene_path(entry["file"]))


def pairs(*, in_means=None):
    """(scene name, camera name, sun name) of every pair, or only those that count in averages."""
    return [
        (name, *pair.split("/"))
        for name, entry in entries().items()
        for pair, facts in entry["pairs"].items()
        if in_means is None or facts["in_means"] == in_means
    ]
