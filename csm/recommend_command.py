"""The subcommand `csm recommend`: only the settings a scene calls for, and their proof."""

import os

from .arguments import (
    add_backend_option,
    check_ground,
    check_sun_diameter,
    find_cameras,
    find_scene,
    find_suns,
    parse_file,
    parse_size,
)
from .export import ENGINES
from .formats import SUFFIXES, write_json
from .progress import Progress
from .recommendation import checked_goal, recommend
from .renderer import Renderer

__all__ = [
    "RECOMMEND_EXAMPLES",
    "RECOMMEND_HELP",
    "add_recommend_options",
    "run_recommend",
]

RECOMMEND_HELP = """\
Look at a scene on a few coarse renders and say which settings it calls for: how many cascades, of
what size, which filter, bias, format …, each with the measurement that called for it, and each
effect left out with the measurement that says it would not matter. docs/recommendation.md has the
table.

SCENE is a file or the name of a made scene, as for csm render.

Several cameras, several suns, or as many of both are a path, in the order given: what stabilises is
then looked at, too.
"""

RECOMMEND_EXAMPLES = """\
examples:
  csm recommend town
  csm recommend town.glb --camera street --sun 238,33 --max-error 0.002
  csm recommend forest --budget-ms 150 --verify
  csm recommend town --sun 90,20 --sun 135,45 --sun 180,55    # the sun moves
  csm recommend town --camera eye=0,2,40,target=0,2,0 --camera eye=0.1,2,40,target=0,2,0 --verify
  csm recommend stairs --json > stairs.json
  csm recommend town --out town.toml      # and then: csm render town --settings town.toml --out …
  csm recommend town --export godot --export unity=Shadows.cs

exit status: 0 done, 1 the goal is out of reach (the nearest is printed), 2 bad input
"""


def add_recommend_options(command):
    """Add the options of `csm recommend` to its parser."""
    add = command.add_argument
    add("scene", metavar="SCENE", help="a file, or the name of a made scene")
    for view in ("camera", "sun"):
        add(
            f"--{view}",
            metavar=view.upper(),
            dest=f"{view}s",
            action="append",
            default=[],
            help="as for csm render; default: the scene's first; may be repeated: a path",
        )
    add(
        "--sun-diameter",
        metavar="DEG",
        type=float,
        help="width of the sun's disc, of all of a path (default: the named sun's own, or 0)",
    )
    add("--size", metavar="WxH", default="1280x720", help="pixels (default 1280x720)")
    add("--ground", metavar="Y", type=float, help="put a ground under the scene at this height")
    add(
        "--max-error",
        metavar="SHARE",
        type=float,
        help="cheapest settings whose forecast error is at most this share, 0 to 1",
    )
    add("--budget-ms", metavar="MS", type=float, help="best settings within this time here")
    add(
        "--max-bytes",
        metavar="N",
        type=float,
        help="bytes of shadow maps, at most; where not one map fits, the smallest is the nearest",
    )
    add("--verify", action="store_true", help="turn every decision round and judge by the truth")
    add("--json", action="store_true", help="print everything as JSON")
    add(
        "--out",
        metavar="FILE",
        help="write the recommendation to a .toml or .json; csm render --settings takes it",
    )
    add(
        "--export",
        metavar="ENGINE[=FILE]",
        dest="exports",
        action="append",
        default=[],
        help="nearest settings of an engine (of a path, for its first camera and sun) and what has "
        "no counterpart there, printed, or a snippet to paste written to the file; "
        f"{', '.join(ENGINES)}; may be repeated",
    )
    add_backend_option(add)
    add("--quiet", action="store_true", help="no progress on stderr")


def run_recommend(options):
    """Run the subcommand; 1 if the goal is out of reach."""
    size = parse_size(options.size)
    check_ground(options.ground)
    check_sun_diameter(options.sun_diameter)
    out = None if options.out is None else parse_file("--out", options.out, SUFFIXES)
    exports = _parse_exports(options.exports)
    goal = checked_goal(options.max_error, options.budget_ms, options.max_bytes)
    _check_one_each({"--out": out, **{f"--export {one}": at for one, at in exports.items()}})
    progress = Progress(quiet=options.quiet)
    with progress.stage(f"loading {options.scene}"):
        scene = find_scene(options.scene, options.ground)
    cameras = find_cameras(scene, options.cameras, size)
    suns = find_suns(scene, options.suns, options.sun_diameter)
    proof = None
    with Renderer(backend=options.backend) as renderer:
        with progress.stage("looking at the scene"):
            found = recommend(scene, cameras, suns, **goal, renderer=renderer)
        if options.verify:
            with progress.stage("turning every decision round"):
                proof = found.verify(renderer=renderer)
    exported = {engine: found.export(engine) for engine in exports}
    if out is not None:
        found.save(out)
    for engine, path in exports.items():
        if path is not None:
            exported[engine].write(path)
    if options.json:
        told = found.to_dict()
        if proof is not None:
            told["verification"] = proof.to_dict()
        if exported:
            told["exports"] = {engine: one.to_dict() for engine, one in exported.items()}
        print(write_json(told), end="")
    else:
        print(found)
        if proof is not None:
            print(f"\n{proof}")
        for engine, one in exported.items():
            print(f"\n{one}" if exports[engine] else f"\n{one}\n\n{one.text}", end="")
        if exported:
            print()
    return int(not found.met)


def _check_one_each(files):
    """Refuse options that would write one file over another."""
    taken = {}
    for option, path in files.items():
        if path is None:
            continue
        first = taken.setdefault(os.path.realpath(path), option)
        if first != option:
            raise ValueError(f"{first} and {option} name one file (got {str(path)!r} twice)")


def _parse_exports(words):
    """Return the file, or None, of each engine that words like ``unity=Shadows.cs`` name."""
    exports = {}
    for word in words:
        engine, equals, text = word.partition("=")
        if engine not in ENGINES:
            raise ValueError(f"--export must be one of {', '.join(ENGINES)} (got {engine!r})")
        if engine in exports:
            raise ValueError(f"--export {engine} is given twice")
        exports[engine] = parse_file(f"--export {engine}", text) if equals else None
    return exports
