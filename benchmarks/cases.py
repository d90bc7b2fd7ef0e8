"""Real scenes and how a pair of camera and sun is judged; shared by the accuracy benchmarks.

The scenes are not part of this repository: ``--scenes`` or the environment variable CSM_SCENES
names the folder with their scenes.json.
"""

import argparse
import json
import os
import sys
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import csm
from csm.arguments import parse_settings, parse_size
from csm.metrics import edge_yardstick

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal")


def parser(description):
    """Options that the accuracy benchmarks share."""
    options = argparse.ArgumentParser(description=description)
    options.add_argument("--scenes", default=os.environ.get("CSM_SCENES"), metavar="DIR")
    options.add_argument("--size", type=parse_size, default=(1280, 720), metavar="WxH")
    options.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="changes")
    options.add_argument("--backend", default="auto")
    return options


def parsed(options):
    """(arguments, settings); ends the program with a sentence if something is wrong."""
    arguments = options.parse_args()
    if not arguments.scenes or not (Path(arguments.scenes) / "scenes.json").is_file():
        options.error("the real scenes are needed: set CSM_SCENES to the folder of scenes.json")
    try:
        return arguments, parse_settings(arguments.changes)
    except (TypeError, ValueError) as error:
        options.error(str(error))


def entries(folder):
    """What scenes.json says, by scene name."""
    return json.loads((Path(folder) / "scenes.json").read_text(encoding="utf-8"))


@lru_cache(maxsize=1)  # neighbouring cases share their scene
def load(path):
    """The scene of a file."""
    return csm.load(path)


@dataclass
class Case:
    """One camera under one sun, rendered and judged."""

    frame: csm.Frame
    truth: csm.Truth
    report: csm.ErrorReport
    yardstick: object


def judge(renderer, scene, camera_name, sun_name, size, settings, *, outputs=OUTPUTS):
    """Render and trace one pair."""
    camera, sun = scene.cameras[camera_name].replace(size=size), scene.suns[sun_name]
    frame = renderer.render(scene, camera, sun, settings, outputs=outputs)
    truth = csm.truth(scene, camera, sun)
    return Case(frame, truth, csm.compare(frame, truth), edge_yardstick(frame, truth))


def note(text):
    """A line about what is being done, out of the way of the table."""
    print(text, file=sys.stderr, flush=True)
