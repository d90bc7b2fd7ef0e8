"""The `csm` command."""

import argparse
import os
import re
import sys
import tempfile
import time
import warnings
from contextlib import contextmanager
from pathlib import Path

from .arguments import (
    INTERRUPTED,
    add_backend_option,
    check_folder,
    check_ground,
    check_sun_diameter,
    find_camera,
    find_scene,
    find_sun,
    parse_folder,
    parse_rays,
    parse_settings,
    parse_size,
)
from .check_files import read_check
from .checks import check_cascades
from .errors import CsmError
from .hard_case_page import page, table, write_page
from .hard_cases import CASES, NO_BACKEND, collect, find_tests, missing
from .metrics import compare, edge_yardstick
from .progress import Progress
from .recommend_command import (
    RECOMMEND_EXAMPLES,
    RECOMMEND_HELP,
    add_recommend_options,
    run_recommend,
)
from .records import load_settings
from .renderer import Renderer, backends
from .report_command import REPORT_EXAMPLES, REPORT_HELP, add_report_options, run_report
from .results import (
    BY_SIGN,
    LANDSCAPE,
    summarise,
    summary_text,
    write_results,
)
from .scenes import SCENES
from .sweep_command import SWEEP_EXAMPLES, SWEEP_HELP, add_sweep_options, run_sweep
from .tracing import truth

__all__ = ["main"]

BAD_INPUT = 2
PIPE_CLOSED = 141  # 128 + SIGPIPE
OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps", "normal")

RENDER_HELP = f"""\
Draw one frame of a scene with cascaded shadow maps and write what came of it:

  picture.png    the scene in sun and sky light, with its shadows
  mask.png       the shadow mask: white lit, black shadowed, pale blue where nothing is seen
  cascades.png   the picture tinted by cascade: red, green, blue, yellow from the nearest on
  maps.png       the shadow maps as the sun sees them, nearest brightest, dark blue empty
  error.png      with --truth: blue too light, orange too dark
  frame.npz      mask, depths, maps, matrices (and the truth) as arrays
  summary.json   settings, cascades, times, errors, driver

SCENE is a file (.glb .gltf .obj .ply .stl .off; height grids .npz .npy .tif) or one of
  {", ".join(SCENES)}
which are made by code. Cameras and suns of a scenes.json beside the file go by name.
"""

RENDER_EXAMPLES = """\
examples:
  csm render demo --truth --out demo
  csm render town.glb --camera eye=0,20,60,target=0,5,0 --sun 238,33 --out pictures
  csm render forest --set cascade_count=2 --set filter=pcf --set filter_size=5 --out pictures
  csm render town --settings town.toml --set map_size=1024 --out pictures
  csm render dem.npz --camera eye=0,3e3,9e3,target=0,500,0 --sun=-0.4,0.2,0.3 --out pictures

exit status: 0 done, 2 bad input (one sentence on stderr, nothing written), 130 interrupted
"""

CHECK_HELP = """\
Prove the cascades of a file sound, one frame or a path, or say what is wrong with them: gaps,
overflow, depth range, a texel grid that moves, a size that changes, a mirrored map.
docs/check-format.md describes the file; csm.write_check writes one.

exit status: 0 sound, 1 problems found, 2 bad input (one sentence on stderr)
"""

HARD_CASES_HELP = """\
Run the hard-case tests of a checkout, those without OpenGL once and those that draw once per back
end, and print for every check the worst figure, its tolerance and the number of cases.
docs/numerics.md 16 says what the cases are.

exit status: 0 all passed, 1 a case failed or did not run, 2 bad input
"""


def main(arguments=None):
    """Run the command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Words after ``csm``; by default those of the process.

    Returns
    -------
    status : int
        0 done, 1 a check or a hard case failed, 2 bad input, 130 interrupted, 141 the reader of
        what is printed has gone.
    """
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    try:
        options = _parser().parse_args(_joined(arguments))
        with warnings.catch_warnings():
            warnings.showwarning = _say
            status = options.run(options) or 0
            sys.stdout.flush()
            return status
    except BrokenPipeError:  # who reads has enough, as under head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for the flush at the end
        return PIPE_CLOSED
    except SystemExit as stop:  # argparse: help and version with 0, refusals with 2
        return stop.code
    except KeyboardInterrupt:
        print("csm: interrupted, nothing written", file=sys.stderr)
        return INTERRUPTED
    except (CsmError, ImportError, MemoryError, OSError, TypeError, ValueError) as error:
        if os.environ.get("CSM_TRACEBACK"):
            raise
        _say(error)
        return BAD_INPUT


def _say(message, *_where, **_source):
    """Print an error or a warning as one sentence, without the place in the source."""
    sentence = "; ".join(line.strip() for line in str(message).splitlines() if line.strip())
    print(f"csm: {sentence or type(message).__name__}", file=sys.stderr)


class _Parser(argparse.ArgumentParser):
    """Refuses with one sentence instead of the whole usage."""

    def error(self, message):
        self.exit(BAD_INPUT, f"{self.prog}: {message} (see {self.prog} --help)\n")


def _parser():
    from . import __version__

    parser = _Parser(
        prog="csm",
        description="Cascaded shadow maps as numbers: pictures, arrays and errors of one frame.",
        epilog="csm render --help says more. CSM_TRACEBACK=1 shows where a refusal came from.",
    )
    parser.add_argument("--version", action="version", version=f"csm {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    render = commands.add_parser(
        "render",
        help="draw a scene with its shadows; pictures, arrays, times, errors",
        description=RENDER_HELP,
        epilog=RENDER_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_render_options(render)
    render.set_defaults(run=_render)
    info = commands.add_parser(
        "info",
        help="the OpenGL back ends of this machine",
        description="For each back end: available or why not, OpenGL version, driver, limits.",
    )
    info.set_defaults(run=_info)
    check = commands.add_parser(
        "check",
        help="prove cascades sound, ours or anybody's, from a file of matrices",
        description=CHECK_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    check.add_argument("file", metavar="FILE.json", help="cameras, matrices, splits, map sizes")
    check.add_argument("--quiet", action="store_true", help="no table on stdout")
    check.set_defaults(run=_check)
    sweeping = commands.add_parser(
        "sweep",
        help="error, time and memory of many settings, as a file says; resumed after a kill",
        description=SWEEP_HELP,
        epilog=SWEEP_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_sweep_options(sweeping)
    sweeping.set_defaults(run=run_sweep)
    reporting = commands.add_parser(
        "report",
        help="the page about what accuracy costs in time, on scenes of yours",
        description=REPORT_HELP,
        epilog=REPORT_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_report_options(reporting)
    reporting.set_defaults(run=run_report)
    advice = commands.add_parser(
        "recommend",
        help="only the settings a scene calls for, each with its reason and its proof",
        description=RECOMMEND_HELP,
        epilog=RECOMMEND_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_recommend_options(advice)
    advice.set_defaults(run=run_recommend)
    cases = commands.add_parser(
        "hard-cases",
        help="run the tests of what is easy to get wrong; a table and a page of their figures",
        description=HARD_CASES_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_hard_case_options(cases)
    cases.set_defaults(run=_hard_cases)
    return parser


def _add_hard_case_options(cases):
    add = cases.add_argument
    add("--tests", metavar="DIR", help="the tests of a checkout (default: beside the package)")
    add(
        "--backend",
        choices=("egl", "osmesa", "glfw"),
        action="append",
        help="draw with this back end; may be repeated (default: every one that opens)",
    )
    add("--out", metavar="DIR", help="folder for hard_cases.html and the pictures")
    add("--slow", action="store_true", help="full ranges of the parameters: an hour, not minutes")
    add("--quiet", action="store_true", help="no progress on stderr, no table on stdout")


def _add_render_options(render):
    add = render.add_argument
    add("scene", metavar="SCENE", help="a file, or the name of a made scene")
    add(
        "--camera",
        metavar="CAMERA",
        help="a name, or eye=x,y,z,target=x,y,z with up=x,y,z fov=DEGREES near=M far=M if wanted "
        "(fov 60, near 0.1, far to the end of the scene), relative to a georeference; "
        "default: the scene's first",
    )
    add(
        "--sun",
        metavar="SUN",
        help="a name, x,y,z towards the sun, or azimuth,elevation in degrees, azimuth by the "
        "compass (0 north = -z, 90 east = +x); default: the scene's first",
    )
    add("--out", metavar="DIR", required=True, help="folder for the files, made if new")
    add("--size", metavar="WxH", default="1280x720", help="pixels (default 1280x720)")
    add(
        "--settings",
        metavar="FILE",
        help="settings to begin with: .toml or .json, of settings or of csm recommend --out",
    )
    add(
        "--set",
        metavar="KEY=VALUE",
        dest="changes",
        action="append",
        default=[],
        help="change a setting of csm.ShadowSettings; may be repeated",
    )
    add(
        "--ground",
        metavar="Y",
        type=float,
        help="put a ground under the scene at this height, relative to a georeference [m]",
    )
    add("--truth", action="store_true", help="trace the exact mask too, and judge by it")
    add(
        "--rays",
        metavar="N",
        help="with --truth: rays per pixel over the sun's disc (default 1: a point sun)",
    )
    add(
        "--causes",
        action="store_true",
        help="with --truth: tell errors apart by cause; a ray per pixel and texel of the kernel",
    )
    add(
        "--sun-diameter",
        metavar="DEG",
        type=float,
        help="width of the sun's disc (default: the named sun's own, or 0)",
    )
    add_backend_option(add)
    add("--quiet", action="store_true", help="no progress on stderr, no table on stdout")


def _joined(arguments):
    """Tie ``--sun -1,2,3`` into one word: argparse takes the minus for an option."""
    joined = []
    for word in arguments:
        if joined and joined[-1] in ("--sun", "--ground") and re.match(r"-[\d.]", word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _render(options):
    from . import __version__

    # Everything that can be refused is looked at before the first slow step.
    size = parse_size(options.size)
    base = None if options.settings is None else load_settings(options.settings)
    settings = parse_settings(options.changes, base)
    if options.rays is not None and not options.truth:
        raise ValueError("--rays needs --truth")
    if options.causes and not options.truth:
        raise ValueError("--causes needs --truth")
    rays = 1 if options.rays is None else parse_rays(options.rays)
    check_ground(options.ground)
    check_sun_diameter(options.sun_diameter)
    folder = parse_folder(options.out)
    check_folder(folder)

    progress, seconds = Progress(quiet=options.quiet), {}
    with _timed(progress, seconds, "load", f"loading {options.scene}"):
        scene = find_scene(options.scene, options.ground)
    camera_name, camera = find_camera(scene, options.camera, size)
    sun_name, sun = find_sun(scene, options.sun, options.sun_diameter)
    traced = judged = report = None
    with (
        _timed(progress, seconds, "render", "rendering"),
        Renderer(backend=options.backend) as renderer,
    ):
        outputs = (*OUTPUTS, "mask_single") if options.causes else OUTPUTS
        frame = renderer.render(scene, camera, sun, settings, outputs=outputs)
    if options.truth:
        with _timed(progress, seconds, "truth", "tracing the truth") as advance:
            traced = truth(scene, camera, sun, rays_per_pixel=rays, progress=advance)
        report = compare(frame, traced)
        judged = report, edge_yardstick(frame, traced)
    names = (camera_name, sun_name)
    with progress.stage("judging"):
        summary = summarise(
            scene,
            frame,
            names=names,
            version=__version__,
            seconds=seconds,
            truth=traced,
            judged=judged,
            causes=None if options.causes else BY_SIGN,
        )
    terrain = (scene.bounds[1] - scene.bounds[0])[[0, 2]].min() >= LANDSCAPE
    with progress.stage("writing"):
        written = write_results(
            folder, frame, summary, truth=traced, report=report, terrain=terrain
        )
    if not options.quiet:
        print(summary_text(summary))
        print(f"\n{folder}: {', '.join(written)}")


@contextmanager
def _timed(progress, seconds, key, text):
    """Run a stage of the progress and note its seconds."""
    start = time.perf_counter()
    with progress.stage(text) as advance:
        yield advance
    seconds[key] = time.perf_counter() - start


def _info(options):
    """Print what each back end offers."""
    for backend in backends():
        name, reason = backend["name"], backend["reason"]
        print(
            f"{name}: {'available' if backend['available'] else reason.removeprefix(f'{name}: ')}"
        )
        for key, value in backend["info"].items():
            if key not in ("backend", "programs_compiled", "live_objects"):
                text = f"{value:,}" if type(value) is int else value
                print(f"  {key.replace('_', ' '):20}{text}")


def _check(options):
    """Judge a file of cascades; 1 if anything is wrong."""
    cascades, cameras, more = read_check(options.file)
    check = check_cascades(cascades, cameras, **more)
    if not options.quiet:
        print(check)
    return int(not check.ok)


def _hard_cases(options):
    """Run the matrix; 1 if anything failed."""
    from . import __version__

    tests = find_tests(options.tests)
    names = options.backend or [each["name"] for each in backends() if each["available"]]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if options.out is not None:
            folder = parse_folder(options.out)
            check_folder(folder)
        rows, drivers = [], {}
        for name in dict.fromkeys([NO_BACKEND, *names]):
            text = "hard cases without OpenGL" if name == NO_BACKEND else f"hard cases on {name}"
            with Progress(quiet=options.quiet).stage(text):
                more, driver = collect(tests, folder, backend=name, slow=options.slow)
            rows += more
            if driver:
                drivers[name] = driver
        rows.sort(key=lambda row: list(CASES).index(row.case))
        if not options.quiet:
            print(table(rows))
        if options.out is not None:
            text = page(rows, drivers, version=__version__, slow=options.slow)
            path = write_page(folder, text)
            if not options.quiet:
                print(path)
    return int(not all(row.passed for row in rows) or bool(missing(rows)))
