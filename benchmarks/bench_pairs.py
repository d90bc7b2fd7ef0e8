"""Seconds that the whole table of pairs of effects takes cold: every program compiled anew.

The rows are dealt to one process a core, each with its own renderers, since a driver compiles
programs one after another. Run it with nothing else on the machine. Prints the rows, the programs,
the seconds of wall time and of all processes together, and the rows that failed.
"""

import argparse
import multiprocessing
import os
import sys
import time
from pathlib import Path

os.environ["MESA_SHADER_CACHE_DISABLE"] = "true"  # before a driver is loaded
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import pairwise
import test_pairs

import csm


def render(rows):
    """Render these rows: driver, programs compiled, processor seconds and failures."""
    scenes, problems = test_pairs.all_scenes(), []
    with (
        csm.Renderer(debug=True, stage="compute") as compute,
        csm.Renderer(debug=True, stage="fragment") as fragment,
    ):
        renderers = {"compute": compute, "fragment": fragment}
        for row in rows:
            problem = test_pairs.problem_of(row, renderers, scenes)
            if problem:
                problems.append(f"{problem}: {pairwise.text(row)}")
        programs = sum(renderer.info["programs_compiled"] for renderer in renderers.values())
        driver = compute.info["renderer"]
    return driver, programs, time.process_time(), problems


def main():
    """Print the figures; the exit status is 1 if a row failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    cores = len(os.sched_getaffinity(0))
    parser.add_argument("--processes", type=int, default=cores, help="default: one a core")
    count = parser.parse_args().processes
    start = time.perf_counter()
    rows, possible = pairwise.table()
    with multiprocessing.get_context("spawn").Pool(count) as pool:
        parts = pool.map(render, [rows[first::count] for first in range(count)], chunksize=1)
    wall = time.perf_counter() - start
    programs, seconds = (sum(part[which] for part in parts) for which in (1, 2))
    problems = [problem for part in parts for problem in part[3]]
    print(f"{parts[0][0]}: {len(rows)} rows for {possible.sum() // 2} pairs, in {count} processes")
    print(f"{programs} programs, {wall:.1f} s of wall time, {seconds:.1f} s of all processes")
    print(f"{len(problems)} rows failed", *problems, sep="\n")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
