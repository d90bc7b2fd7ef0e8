"""Cascade fits per second on one core, for every fit, snap and split: compiles csrc/core alone with
bench_fit.c, runs it and prints a table.

The goal is 100 000 cascades per second, matrices included. The time is CPU time of one thread.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GOAL = 1e5  # cascades per second per core
FLAGS = "-std=c11 -O2 -Wall -Wextra -ffp-contract=off".split()


def build(folder):
    """Path of the program, compiled with the compiler of CC (cc)."""
    program = Path(folder) / "bench_fit"
    sources = [*sorted((ROOT / "csrc/core").glob("*.c")), ROOT / "benchmarks/bench_fit.c"]
    compiler = os.environ.get("CC", "cc").split()
    command = [*compiler, *FLAGS, f"-I{ROOT / 'csrc'}", *sources, "-lm", "-o", program]
    subprocess.run(command, check=True)
    return program


def measured(seconds):
    """List of (setting, value, snap, cascades per second)."""
    with tempfile.TemporaryDirectory() as folder:
        command = [build(folder), str(seconds)]
        text = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    lines = [line.split() for line in text.splitlines()]
    return [(setting, value, snap, float(rate)) for setting, value, snap, rate in lines]


def print_table(rows, setting):
    """One line per value of a setting, one column per snap."""
    rows = [row for row in rows if row[0] == setting]
    snaps = list(dict.fromkeys(snap for _, _, snap, _ in rows))
    print(f"{setting:12}" + "".join(f"{snap:>14}" for snap in snaps))
    for value in dict.fromkeys(value for _, value, _, _ in rows):
        rates = [rate for _, v, _, rate in rows if v == value]
        print(f"{value:12}" + "".join(f"{rate / 1e6:12.2f} M" for rate in rates))


def main():
    """Measure, print, and say whether the goal is met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=0.5, help="of each line of the table")
    rows = measured(parser.parse_args().seconds)
    print("millions of cascades per second and core, four per fit, matrices included")
    print_table(rows, "fit")
    print_table(rows, "split")
    slowest = min(rows, key=lambda row: row[3])
    verdict = "met" if slowest[3] >= GOAL else "missed"
    print(f"slowest: {' '.join(slowest[:3])}, {slowest[3]:.0f}; goal of {GOAL:.0f}: {verdict}")
    return 0 if slowest[3] >= GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
