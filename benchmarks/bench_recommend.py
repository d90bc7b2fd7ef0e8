"""What csm.recommend makes of real and made scenes, each of its decisions put to the proof.

``python benchmarks/bench_recommend.py --json rows.jsonl`` appends a line to the file as each case
ends and leaves out those that are there already, so that it can be stopped and started again; what
failed is written down too, and tried again by the next run. All cases are every camera under every
sun of the scenes of CSM_SCENES and of the made scenes; ``--only denhaag`` takes those with that in
their name, ``--part 0/4`` every fourth, ``--processes 4`` shares them out (times then mean little).
``--quick`` renders only everything on and the recommendation: error and time, no decision turned
round. ``--bytes`` compares at equal memory over the eleven views of bench_accuracy.py, ``--maps``
one map against four; both print the rows of their tables and write no file.

benchmarks/recommend_tables.py makes the tables of docs/recommendation.md of such files.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
import traceback
from pathlib import Path

import numpy as np
from bench_accuracy import CASES
from cases import entries, load, note

import csm
from csm.arguments import parse_size
from csm.forecasts import Forecaster
from csm.settings import maps_text
from csm.signals import measure_signals
from csm.timing import HOST, all_in_turns, total_ms, warm_up_s
from csm.verification import everything_on, picture_error

MADE = (
    "plane_and_box",
    "fence",
    "wires",
    "stairs",
    "long_road",
    "foliage",
    "forest",
    "town",
    "demo",
)
REPEATS = 3  # frames timed of each flip
ROUNDS = 5  # frames of everything on and the recommendation that count, in turns; medians count
QUICK_ROUNDS = 4
SOFT_RAYS, QUICK_RAYS = 16, 4  # of the truth under a sun with a disc
FOUR = 4 * 2048**2 * 4  # bytes
OUTPUTS = ("mask", "valid", "cascade_index")
ANALYSIS, WHOLE = "analysis", "whole"


def scenes(folder):
    """(name, function to the scene) of all scenes."""
    if folder:
        for name, entry in entries(folder).items():
            path = f"{folder}/{entry['file']}"
            yield name, lambda path=path: load(path)
    for name in MADE:
        yield name, csm.scenes.SCENES[name]


def case_names(name, scene):
    """(case, camera, sun) of all pairs of a scene."""
    return [
        (f"{name} / {camera} / {sun}", camera, sun)
        for camera in scene.cameras
        for sun in scene.suns
    ]


def timed(renderer, scene, camera, sun, wanted, rounds):
    """Passes [ms] of the frames that count of settings, taken in turns: lists by name.

    What a call takes outside of all passes is one of them. The analysis takes its turns as frames
    do, since a GPU that waited for it alone would run slower than for frames; so do frames of the
    recommendation with all that `Renderer.render` gives by default, maps among it.
    """

    def frame_times(name):
        start = time.perf_counter()
        if name == ANALYSIS:
            csm.recommend(scene, camera, sun, renderer=renderer)
        elif name == WHOLE:
            renderer.render(scene, camera, sun, wanted["ours"])
        else:
            frame = renderer.render(scene, camera, sun, wanted[name], outputs=("mask",))
        whole = 1e3 * (time.perf_counter() - start)
        if name in (ANALYSIS, WHOLE):
            return {name: whole}
        return {**frame.timings_ms, HOST: max(0.0, whole - sum(frame.timings_ms.values()))}

    jobs, warm_up = [*wanted, ANALYSIS, WHOLE], warm_up_s(renderer.info)
    return all_in_turns(jobs, frame_times, repeats=rounds, warm_up=warm_up)


def compared(renderer, scene, camera, sun, found, rounds):
    """Time of the recommendation beside everything on, and what was forecast."""
    settings, signals = found.settings, found.signals
    wanted = {"full": everything_on(sun), "ours": settings}
    passes = timed(renderer, scene, camera, sun, wanted, rounds)
    total = {name: [total_ms(one) for one in passes[name]] for name in wanted}
    row = {
        "settings": settings.canonical().to_dict(),
        "dark": settings.filter == "none",
        "forecast": found.expected_error,
        "forecast_ms": found.expected_ms,
        "signals": {k: v for k, v in signals.to_dict().items() if not k.startswith("depth_")},
        "full_ms": float(np.median(total["full"])),
        "ms": float(np.median(total["ours"])),
        "full_least_ms": min(total["full"]),
        "least_ms": min(total["ours"]),
        "frame_ms": float(np.median([sum(one.values()) for one in passes["ours"]])),
        "whole_frame_ms": float(np.median([total_ms(one) for one in passes[WHOLE]])),
        "analysis_ms": float(np.median([total_ms(one) for one in passes[ANALYSIS]])),
        "full_bytes": csm.plans.map_bytes(wanted["full"]),
        "bytes": found.map_bytes,
    }
    for name, key in (("full", "full_passes"), ("ours", "passes")):
        split = passes[name]
        row[key] = {one: float(np.median([s[one] for s in split])) for one in split[0]}
    if not row["dark"]:
        forecaster = Forecaster(signals, scene)
        row["full_forecast"] = forecaster.error(wanted["full"])
    return row


def judge_quickly(renderer, scene, camera, sun):
    """Error and time of everything on and of the recommendation."""
    found = csm.recommend(scene, camera, sun, renderer=renderer)
    soft = sun.angular_diameter_deg > 0.0
    truth = csm.truth(scene, camera, sun, rays_per_pixel=QUICK_RAYS if soft else 1)
    errors = {
        name: picture_error(renderer.render(scene, camera, sun, one, outputs=OUTPUTS), truth)
        for name, one in (("full_error", everything_on(sun)), ("error", found.settings))
    }
    row = compared(renderer, scene, camera, sun, found, QUICK_ROUNDS)
    return {**errors, **row}


def judge(renderer, scene, camera, sun):
    """The same, and which decisions hold when they are turned round."""
    found = csm.recommend(scene, camera, sun, renderer=renderer)
    soft = sun.angular_diameter_deg > 0.0
    proof = found.verify(
        renderer=renderer, rays_per_pixel=SOFT_RAYS if soft else 1, repeats=REPEATS
    )
    full, ours = proof.everything_on, proof.recommended
    return {
        "full_error": full.error,
        "error": ours.error,
        **compared(renderer, scene, camera, sun, found, ROUNDS),
        "rows": [
            {
                "effect": row.name,
                "taken": row.taken,
                "confirmed": row.confirmed,
                "strict": row.strict,
                "error": row.error,
                "ms": row.ms_least,
                "why": row.why,
            }
            for row in (*proof.decisions, *proof.unturned)
        ],
    }


def read(path):
    """Lines of a file by case, later ones instead of earlier ones; {} without a file."""
    if not path.exists():
        return {}
    lines = [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
    return {line["case"]: line for line in lines if "case" in line}


def append(path, line):
    """Add a line to a file in one piece, whoever else writes to it."""
    data = (json.dumps(line) + "\n").encode()
    handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        os.write(handle, data)
    finally:
        os.close(handle)


def machine(renderer):
    """What ran it, for the tables."""
    info = renderer.info
    return {
        "driver": info["renderer"],
        "version": info["version"],
        "cores": os.cpu_count(),
        "platform": platform.platform(),
        "csm": csm.__version__,
    }


def run(arguments):
    """Append a line a case."""
    done = {case for case, line in read(arguments.json).items() if "failed" not in line}
    number, judged = -1, judge_quickly if arguments.quick else judge
    with csm.Renderer(arguments.backend) as renderer:
        common = {
            "kind": "quick" if arguments.quick else "full",
            "size": list(arguments.size),
            "processes": arguments.of_processes,
            **machine(renderer),
        }
        for name, make in scenes(arguments.scenes):
            if arguments.only and arguments.only not in name:
                continue
            scene = make()
            for case, camera_name, sun_name in case_names(name, scene):
                number += 1
                if number % arguments.part[1] != arguments.part[0] or case in done:
                    continue
                camera, start = scene.cameras[camera_name], time.perf_counter()
                try:
                    row = judged(
                        renderer, scene, camera.replace(size=arguments.size), scene.suns[sun_name]
                    )
                except Exception as error:  # the others go on; what failed is in the file
                    traceback.print_exc()
                    row = {"failed": f"{type(error).__name__}: {error}"}
                row["took_s"] = time.perf_counter() - start
                append(arguments.json, {"case": case, **common, **row})
                note(said(case, row))


def said(case, row):
    """A line about a case."""
    if "failed" in row:
        return f"{case}: failed, {row['failed']}"
    refuted = [one["effect"] for one in row.get("rows", []) if one["confirmed"] is False]
    return (
        f"{case}: error {100 * row['error']:.3f} of {100 * row['full_error']:.3f} %, "
        f"time {row['ms']:.0f} of {row['full_ms']:.0f} ms, {row['took_s']:.1f} s"
        + (f", refuted {', '.join(refuted)}" if refuted else "")
    )


def share_out(arguments, words):
    """Run the cases in several processes, each a part of this one's part; their exit status."""
    k, n = arguments.part
    jobs = [
        subprocess.Popen(
            [sys.executable, __file__, *words, "--processes", "1",
             "--of-processes", str(arguments.processes),
             "--part", f"{k + n * i}/{n * arguments.processes}"]
        )
        for i in range(arguments.processes)
    ]  # fmt: skip
    return max(job.wait() for job in jobs)


def measured(renderer, scene, camera, sun, settings, truth):
    """Disagreement and mean absolute error [%]."""
    frame = renderer.render(
        scene, camera, sun, settings, outputs=("mask", "valid", "cascade_index")
    )
    report = csm.compare(frame, truth)
    return 100 * report.disagreement, 100 * report.mean["total"]


def at_equal_bytes(arguments):
    """The eleven views at the bytes of 4 x 2048² in 32 bits, and at a quarter."""
    known, figures = entries(arguments.scenes), []
    with csm.Renderer(arguments.backend) as renderer:
        for name, camera_name, sun_name in CASES:
            scene = load(f"{arguments.scenes}/{known[name]['file']}")
            camera, sun = (
                scene.cameras[camera_name].replace(size=arguments.size),
                scene.suns[sun_name],
            )
            truth, line, texts = csm.truth(scene, camera, sun), [], []
            for share in (1, 4):
                found = csm.recommend(
                    scene, camera, sun, max_error=0.0, max_bytes=FOUR / share, renderer=renderer
                )
                line += measured(renderer, scene, camera, sun, found.settings, truth)
                texts.append(maps_text(found.settings))
            figures.append(line)
            print(f"| {name} {camera_name} {sun_name} | " + " | ".join(
                f"{text}: {line[2 * k]:.3f} / {line[2 * k + 1]:.3f}" for k, text in enumerate(texts)
            ) + " |", flush=True)  # fmt: skip
    mean = np.mean(figures, axis=0)
    print(f"| mean | {mean[0]:.3f} / {mean[1]:.3f} | {mean[2]:.3f} / {mean[3]:.3f} |")


def one_map_or_four(arguments):
    """One map of 4096² against four of 2048²: what is forecast, what is measured."""
    known = entries(arguments.scenes)
    views = (
        ("denhaag_lod2", "oblique", "winter"),
        ("denhaag_lod2", "street", "winter"),
        ("ms_shadow_columns", "aisle", "dueling"),
        ("ms_shadow_columns", "aisle", "grazing"),
    )
    with csm.Renderer(arguments.backend) as renderer:
        for name, camera_name, sun_name in views:
            scene = load(f"{arguments.scenes}/{known[name]['file']}")
            camera, sun = (
                scene.cameras[camera_name].replace(size=arguments.size),
                scene.suns[sun_name],
            )
            truth = csm.truth(scene, camera, sun)
            forecaster = Forecaster(measure_signals(renderer, scene, [camera], [sun]), scene)
            for fit in ("sphere", "scene", "visible"):
                four = csm.ShadowSettings(fit=fit)
                one = four.replace(cascade_count=1, map_size=4096)
                told = [100 * forecaster.error(s) for s in (one, four)]
                seen = [measured(renderer, scene, camera, sun, s, truth)[0] for s in (one, four)]
                print(f"| {name} {camera_name} {sun_name} | {fit} | {told[0]:.3f} | {told[1]:.3f} "
                      f"| {seen[0]:.3f} | {seen[1]:.3f} |", flush=True)  # fmt: skip


def parse_part(text):
    """(k, n) from "k/n"."""
    try:
        k, n = map(int, text.split("/"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be K/N (got {text!r})") from None
    if not 0 <= k < n:
        raise argparse.ArgumentTypeError(f"must be K/N with 0 <= K < N (got {text!r})")
    return k, n


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--scenes", default=os.environ.get("CSM_SCENES"), metavar="DIR")
    options.add_argument("--size", type=parse_size, default=(1280, 720), metavar="WxH")
    options.add_argument("--only", default="", metavar="PART", help="of a scene's name")
    options.add_argument("--part", type=parse_part, default=(0, 1), metavar="K/N")
    options.add_argument("--processes", type=int, default=1, metavar="N")
    options.add_argument("--of-processes", type=int, default=1, help=argparse.SUPPRESS)
    options.add_argument("--json", type=Path, default=Path("recommend.jsonl"), metavar="FILE")
    options.add_argument("--quick", action="store_true", help="no decision is turned round")
    options.add_argument("--bytes", action="store_true")
    options.add_argument("--maps", action="store_true")
    options.add_argument("--backend", default="auto")
    arguments = options.parse_args()
    if not arguments.scenes:
        note("no --scenes and no CSM_SCENES: made scenes only")
    if arguments.bytes:
        at_equal_bytes(arguments)
    elif arguments.maps:
        one_map_or_four(arguments)
    elif arguments.processes > 1:
        sys.exit(share_out(arguments, sys.argv[1:]))
    else:
        run(arguments)


if __name__ == "__main__":
    main()
