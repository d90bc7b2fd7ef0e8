"""The subcommand `csm report`: techniques swept over scenes, and the page about them."""

import sys
from argparse import BooleanOptionalAction
from pathlib import Path

from .arguments import (
    add_backend_option,
    check_folder,
    check_sun_diameter,
    find_camera,
    find_scene,
    find_sun,
    parse_folder,
    parse_rays,
    parse_size,
)
from .disc import SOFT_RAYS
from .formats import named
from .hard_cases import kept_rows
from .progress import Progress
from .report_runs import sweep_techniques
from .reports import report
from .scenes import SCENES
from .spaces import as_number, as_whole
from .sweep_command import interrupted
from .techniques import FAMILIES, settings_by_name
from .timing import MOST_REPEATS

__all__ = ["REPORT_EXAMPLES", "REPORT_HELP", "add_report_options", "run_report"]

REPORT_HELP = """\
Measure every technique of the literature on scenes of yours and write one page, report.html, that
needs no other file: error against time and memory with what nothing beats, what the next halving
of the error costs, the least error within a budget, flicker, and the same spot under every
technique beside the ray-traced truth.

SCENE is a file or the name of a made scene; SCENE:CAMERA:SUN picks a camera and a sun of it by
name, otherwise its first ones count. Called again with the same folder it goes on where it was
stopped, and measures what is new.
"""

REPORT_EXAMPLES = """\
examples:
  csm report town --out report
  csm report town.glb:street:morning forest --size 640x360 --out report
  csm report town --families prefiltered,soft --out report
"""

REPEATS = 5


def add_report_options(command):
    """Add the options of `csm report` to its parser."""
    add = command.add_argument
    add("scenes", metavar="SCENE", nargs="+", help="a file or a made scene, or SCENE:CAMERA:SUN")
    add("--out", metavar="DIR", required=True, help="folder for the page, made if new")
    add("--size", default="960x540", metavar="WxH", help="of every picture (default 960x540)")
    add(
        "--families",
        metavar="A,B",
        help=f"only these families of techniques: {', '.join(FAMILIES)}",
    )
    add(
        "--causes",
        action=BooleanOptionalAction,
        default=True,
        help="errors by cause, which take a ray per pixel and texel of every kernel (default yes)",
    )
    add(
        "--rays",
        default=str(SOFT_RAYS),
        metavar="N",
        help=f"rays per pixel to the disc of a sun that has one (default {SOFT_RAYS})",
    )
    add(
        "--standard-error",
        type=float,
        metavar="E",
        help="of the soft truth: rays are added until it is at most this (default: --rays alone)",
    )
    add(
        "--sun-diameter",
        type=float,
        metavar="DEG",
        help="of the suns' discs in degrees; the real sun's is 0.53 (default: the suns' own)",
    )
    add(
        "--repeats",
        type=int,
        default=REPEATS,
        metavar="N",
        help=f"frames timed of each technique (default {REPEATS})",
    )
    add(
        "--processes",
        type=int,
        default=1,
        metavar="N",
        help="worker processes; they disturb each other's times (default 1)",
    )
    add(
        "--hard-cases",
        metavar="DIR",
        help="folder that csm hard-cases --out wrote, to be summed up on the page",
    )
    add_backend_option(add)
    add("--quiet", action="store_true", help="no progress on stderr, no path on stdout")


def find_case(text, size, diameter=None):
    """Scene, camera and sun of ``SCENE[:CAMERA[:SUN]]``.

    Parameters
    ----------
    text : str
        As much of it as is a file's path, colons and all, or a made scene's name is the scene.
    size : (int, int)
        Of the camera.
    diameter : float, optional
        Of the sun's disc [degrees], instead of its own.

    Returns
    -------
    name : str
    case : (Scene, Camera, Sun)

    Raises
    ------
    OSError, ValueError, ImportError
        If a part is none.
    """
    source, words = _source_and_views(text)
    if len(words) > 2:
        raise ValueError(
            f"SCENE may name a camera and a sun after it, as SCENE:CAMERA:SUN (got {text!r})"
        )
    camera, sun = (*words, "", "")[:2]
    scene = find_scene(source)
    camera_name, found_camera = find_camera(
        scene, camera or None, size, f"the camera in SCENE {text!r}"
    )
    sun_name, found_sun = find_sun(scene, sun or None, diameter, f"the sun in SCENE {text!r}")
    stem = source.rsplit("/", 1)[-1].rsplit(".", 1)[0]
    names = stem, camera_name or camera, sun_name or sun  # what was described is its own name
    return ", ".join(names), (scene, found_camera, found_sun)


def _source_and_views(text):
    """Scene, and what names its camera and sun; of beginnings that are files the longest."""
    parts = text.split(":")
    for count in range(len(parts), 0, -1):
        source = ":".join(parts[:count])
        if source in SCENES or Path(source).is_file():
            return source, parts[count:]
    return parts[0], parts[1:]


def run_report(options):
    """Run the subcommand."""
    folder, size = parse_folder(options.out), parse_size(options.size)
    rays = parse_rays(options.rays)
    families = None
    if options.families is not None:
        families = [one.strip() for one in options.families.split(",")]
    with named("--families"):
        techniques = settings_by_name(families)
    repeats = as_whole("--repeats", options.repeats, 1, MOST_REPEATS)
    error = options.standard_error
    if error is not None:
        with named("--standard-error"):
            error = as_number("standard_error", error, 1e-9, 1.0)
            if rays < 2:
                raise ValueError(f"takes --rays of 2 or more (got {rays})")
    check_sun_diameter(options.sun_diameter)
    check_folder(folder)
    if options.hard_cases is not None:
        kept_rows(options.hard_cases)
    progress = Progress(quiet=options.quiet)
    with progress.stage("loading"):
        cases = {}
        for text in options.scenes:
            name, case = find_case(text, size, options.sun_diameter)
            if name in cases:
                raise ValueError(
                    f"SCENE: two are called {name!r} (the second is {text!r}): "
                    "give each once, and files names of their own"
                )
            cases[name] = case
    said = f"{len(techniques)} techniques over {len(cases)} case(s)"
    with progress.stage(said) as advance:
        try:
            dataset = sweep_techniques(
                cases,
                families=families,
                out=folder / "sweep",
                size=size,
                repeats=repeats,
                rays_per_pixel=rays,
                standard_error=error,
                causes=options.causes,
                processes=options.processes,
                backend=options.backend,
                progress=advance,
            )
        except KeyboardInterrupt:
            return interrupted(folder / "sweep")
    if not (dataset.status == "ok").any():
        raise ValueError(f"nothing could be measured: {dataset.message.values.ravel()[0]}")
    with progress.stage("writing"):
        page = report(dataset, out=folder, hard_cases=options.hard_cases)
    if not options.quiet:
        print(page, file=sys.stdout)
    return 0
