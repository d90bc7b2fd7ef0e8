"""Seconds that the whole table of pairs of effects takes cold: every program compiled anew.

Run it with nothing else on the machine. Prints the rows, the programs, the seconds of wall time and
of all cores, and the rows that failed.
"""

import os
import sys
import time
from pathlib import Path

os.environ["MESA_SHADER_CACHE_DISABLE"] = "true"  # before a driver is loaded
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import pairwise
import test_pairs

import csm


def main():
    """Print the figures; the exit status is 1 if a row failed."""
    start, start_of_cores = time.perf_counter(), time.process_time()
    rows, possible = pairwise.table()
    made = time.perf_counter() - start
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
    wall, cores = time.perf_counter() - start, time.process_time() - start_of_cores
    print(f"{driver}: {len(rows)} rows for {possible.sum() // 2} pairs, made in {made:.1f} s")
    print(f"{programs} programs, {wall:.1f} s of wall time, {cores:.1f} s of all cores together")
    print(f"{len(problems)} rows failed", *problems, sep="\n")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
