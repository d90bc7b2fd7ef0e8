"""What the analysis of csm.recommend takes, beside frames of what it recommends.

``python benchmarks/bench_analysis.py`` takes every pair of bench_recommend.py, ``--only town``
those with that in their scene's name. Recommendations and frames take turns, so that a GPU is as
warm for one as for the other; medians of each count. Frames are all that `Renderer.render` gives by
default, and the mask alone; with their passes timed, as by default, and without, as are the coarse
frames of the analysis. Every pair prints a line; the last lines are the table of
docs/recommendation.md.
"""

import argparse
import os
import time

import numpy as np
from bench_recommend import ANALYSIS, case_names, scenes
from cases import note
from recommend_tables import FRAMES

import csm
from csm.arguments import parse_size
from csm.timing import all_in_turns, total_ms, warm_up_s

BESIDE = {
    "all that `render` gives by default": {},
    "the same, not timed": {"timed": False},
    "the mask alone": {"outputs": ("mask",)},
    "the mask alone, not timed": {"outputs": ("mask",), "timed": False},
}


def measure(renderer, scene, camera, sun, rounds):
    """Medians [ms] of the analysis and of frames beside it, by name."""
    settings = csm.recommend(scene, camera, sun, renderer=renderer).settings

    def times(name):
        start = time.perf_counter()
        if name == ANALYSIS:
            csm.recommend(scene, camera, sun, renderer=renderer)
        else:
            renderer.render(scene, camera, sun, settings, **BESIDE[name])
        return {name: 1e3 * (time.perf_counter() - start)}

    found = all_in_turns(
        [ANALYSIS, *BESIDE], times, repeats=rounds, warm_up=warm_up_s(renderer.info)
    )
    return {name: float(np.median([total_ms(one) for one in found[name]])) for name in found}


def table(rows):
    """Lines about all pairs."""
    analysis = np.array([row[ANALYSIS] for row in rows])
    yield f"{len(rows)} pairs, analysis {np.median(analysis):.3g} ms (median)"
    yield "| frames | ms, median | analysis below three | in frames, median | at most |"
    yield "|---|---|---|---|---|"
    for name in BESIDE:
        frames = np.array([row[name] for row in rows])
        ratio = analysis / frames
        yield (
            f"| {name} | {np.median(frames):.3g} | {(ratio < FRAMES).sum()} of {len(rows)} "
            f"| {np.median(ratio):.2g} | {ratio.max():.2g} |"
        )


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--scenes", default=os.environ.get("CSM_SCENES"), metavar="DIR")
    options.add_argument("--size", type=parse_size, default=(1280, 720), metavar="WxH")
    options.add_argument("--only", default="", metavar="PART", help="of a scene's name")
    options.add_argument("--rounds", type=int, default=5, help="that count, of each")
    options.add_argument("--backend", default="auto")
    arguments = options.parse_args()
    if not arguments.scenes:
        note("no --scenes and no CSM_SCENES: made scenes only")
    rows = []
    with csm.Renderer(arguments.backend) as renderer:
        note(renderer.info["renderer"])
        for name, make in scenes(arguments.scenes):
            if arguments.only not in name:
                continue
            scene = make()
            for case, camera, sun in case_names(name, scene):
                camera = scene.cameras[camera].replace(size=arguments.size)
                row = measure(renderer, scene, camera, scene.suns[sun], arguments.rounds)
                rows.append(row)
                print(f"{case}: {', '.join(f'{ms:.2f}' for ms in row.values())} ms", flush=True)
    print(*table(rows), sep="\n")


if __name__ == "__main__":
    main()
