"""What csm.recommend makes of real and made scenes, each of its decisions put to the proof.

``python benchmarks/bench_recommend.py --only denhaag --out rows.jsonl`` appends a line a case, and
leaves out those that are there already, so it can be run in parts; without ``--only`` all cases of
the scenes of CSM_SCENES and the made scenes. ``--part 0/4`` takes every fourth pair of a scene's
cameras and suns. ``--table rows.jsonl`` prints what the lines say. ``--bytes`` compares at equal
memory over the eleven views of bench_accuracy.py, ``--maps`` one map against four.
"""

import argparse
import json
import os
import time
from pathlib import Path

import numpy as np
from bench_accuracy import CASES
from cases import entries, load, note

import csm
from csm.arguments import parse_size
from csm.forecasts import Forecaster
from csm.signals import measure_signals
from csm.timing import total_ms

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
REPEATS = 2
SOFT_RAYS = 16
RELATIVE, ABSOLUTE = 0.05, 5e-4  # how far from everything on
FOUR = 4 * 2048**2 * 4  # bytes


def cases(folder, only):
    """(name, function to the scene) of all scenes."""
    if folder:
        for name, entry in entries(folder).items():
            if only in name:
                path = f"{folder}/{entry['file']}"
                yield name, lambda path=path: load(path)
    for name in MADE:
        if only in name:
            yield name, csm.scenes.SCENES[name]


def judge(renderer, scene, camera, sun):
    """One line: how near everything on, at which share of its time, which decisions hold."""
    csm.recommend(scene, camera, sun, renderer=renderer)  # programs
    soft = sun.angular_diameter_deg > 0.0
    start = time.perf_counter()
    found = csm.recommend(scene, camera, sun, renderer=renderer)
    analysis = 1e3 * (time.perf_counter() - start)
    proof = found.verify(
        renderer=renderer, rays_per_pixel=SOFT_RAYS if soft else 1, repeats=REPEATS
    )
    full, ours = proof.everything_on, proof.recommended
    times = {"full": [], "ours": []}
    for _ in range(3):
        for key, row in (("full", full), ("ours", ours)):
            start = time.perf_counter()
            frame = renderer.render(scene, camera, sun, row.settings, outputs=("mask",))
            times[key].append((total_ms(frame.timings_ms), 1e3 * (time.perf_counter() - start)))
    ms = {key: np.median([one[0] for one in rows]) for key, rows in times.items()}
    settings = ours.settings
    return {
        "count": settings.cascade_count if settings.filter != "none" else 0,
        "size": settings.map_size,
        "filter": settings.filter,
        "format": settings.depth_format,
        "split": settings.split,
        "turned": settings.turned,
        "faces": settings.caster_faces,
        "snap": settings.snap,
        "forecast": found.expected_error,
        "facing": found.signals.facing_share * found.signals.seen_share,
        "full_error": full.error,
        "error": ours.error,
        "full_ms": ms["full"],
        "ms": ms["ours"],
        "full_bytes": full.bytes,
        "bytes": ours.bytes,
        "analysis_ms": analysis,
        "frame_ms": float(np.median([one[1] for one in times["ours"]])),
        "confirmed": sum(row.confirmed for row in proof.decisions),
        "strict": sum(row.strict for row in proof.decisions),
        "decisions": len(proof.decisions),
        "refuted": [f"{row.name}: {row.why}" for row in proof.decisions if not row.confirmed],
        "rows": [
            (row.name, row.taken, row.confirmed, row.strict, row.error) for row in proof.decisions
        ],
    }


def run(arguments):
    """Append a line a case."""
    done = set()
    if arguments.out.exists():
        done = {json.loads(line)["case"] for line in arguments.out.read_text().splitlines()}
    with csm.Renderer(arguments.backend) as renderer:
        for name, make in cases(arguments.scenes, arguments.only):
            scene = make()
            for i, (camera_name, camera) in enumerate(scene.cameras.items()):
                for j, (sun_name, sun) in enumerate(scene.suns.items()):
                    if (i + j) % arguments.part[1] != arguments.part[0]:
                        continue
                    case = f"{name} / {camera_name} / {sun_name}"
                    if case in done:
                        continue
                    row = judge(renderer, scene, camera.replace(size=arguments.size), sun)
                    with arguments.out.open("a") as file:
                        file.write(json.dumps({"case": case, **row}) + "\n")
                    note(f"{case}: {row['error']:.5f} of {row['full_error']:.5f}")


def table(path):
    """Print the lines as a table, and the goals."""
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    print("| case | recommended | error % | everything on % | time | confirmed | misses |")
    print("|---|---|---|---|---|---|---|")
    ratios, near, spent = [], [], []
    for row in sorted(rows, key=lambda row: row["case"]):
        what = (
            f"{row['count']} x {row['size']}² {row['format']} {row['filter']}"
            + (" turned" if row["turned"] else "")
            + (" sdsm" if row["split"] == "sdsm" else "")
            + (" back" if row["faces"] == "back" else "")
        )
        if not row["count"]:
            what = "no shadow maps"
        good = row["error"] <= max((1 + RELATIVE) * row["full_error"], row["full_error"] + ABSOLUTE)
        ratios.append(row["ms"] / row["full_ms"])
        near.append(good)
        spent.append(row["analysis_ms"] / row["frame_ms"])
        print(
            f"| {row['case']} | {what} | {100 * row['error']:.3f} | {100 * row['full_error']:.3f} "
            f"| {ratios[-1]:.2f} | {row['confirmed']}/{row['decisions']} "
            f"| {'' if good else 'error'} |"
        )
    confirmed, strict, count = (
        sum(row[key] for row in rows) for key in ("confirmed", "strict", "decisions")
    )
    print(f"\n{len(rows)} cases; within 5 % or 0.05 % of everything on: {sum(near)}")
    print(f"time over everything on: median {np.median(ratios):.2f}")
    print(
        f"decisions confirmed: {confirmed} of {count} ({confirmed / count:.1%}); {strict} strictly"
    )
    below = np.mean(np.array(spent) < 3)
    print(
        f"analysis, in frames of the recommendation: median {np.median(spent):.1f}, "
        f"at most {max(spent):.1f}, below three in {below:.0%}"
    )
    by_effect = {}
    for row in rows:
        for name, _, holds, *_ in row["rows"]:
            by_effect.setdefault(name, []).append(holds)
    for name, holds in by_effect.items():
        print(f"  {name:14} {sum(holds)}/{len(holds)}")


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
                texts.append(f"{found.settings.cascade_count} x {found.settings.map_size}²")
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


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--scenes", default=os.environ.get("CSM_SCENES"), metavar="DIR")
    options.add_argument("--size", type=parse_size, default=(1280, 720), metavar="WxH")
    options.add_argument("--only", default="", metavar="PART", help="of a scene's name")
    options.add_argument(
        "--part", type=lambda text: tuple(map(int, text.split("/"))), default=(0, 1), metavar="K/N"
    )
    options.add_argument("--out", type=Path, default=Path("recommend.jsonl"), metavar="FILE")
    options.add_argument("--table", type=Path, metavar="FILE")
    options.add_argument("--bytes", action="store_true")
    options.add_argument("--maps", action="store_true")
    options.add_argument("--backend", default="auto")
    arguments = options.parse_args()
    if arguments.table:
        table(arguments.table)
    elif arguments.bytes:
        at_equal_bytes(arguments)
    elif arguments.maps:
        one_map_or_four(arguments)
    else:
        run(arguments)


if __name__ == "__main__":
    main()
