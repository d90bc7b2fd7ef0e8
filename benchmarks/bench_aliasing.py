"""Aliasing that is measured beside what theory expects: the eleven views of bench_accuracy.py.

A line for each view and size of the maps: the mean aliasing of `csm.compare` and
`ErrorReport.expected_aliasing`, in per cent of the sun-facing pixels, and their ratio
(docs/numerics.md 15). Settings are csm's defaults but for the size of the maps, and --set.
"""

import numpy as np
from bench_accuracy import CASES
from cases import entries, judge, load, note, parsed, parser

import csm

SIZES = (512, 1024, 2048)


def main():
    """Print the table."""
    arguments, settings = parsed(parser(__doc__.splitlines()[0]))
    known = entries(arguments.scenes)
    figures = []
    print(f"aliasing, % of sun-facing pixels, {arguments.size}")
    print(f"{'':40}{'measured':>10}{'expected':>10}{'ratio':>8}")
    with csm.Renderer(arguments.backend) as renderer:
        for scene_name, camera, sun in CASES:
            scene = load(f"{arguments.scenes}/{known[scene_name]['file']}")
            for size in SIZES:
                changed = settings.replace(map_size=size)
                report = judge(renderer, scene, camera, sun, arguments.size, changed).report
                figures.append((report.mean["aliasing"], report.expected_aliasing))
                name = f"{scene_name[:13]} {camera} {sun}, {size}"
                measured, expected = figures[-1]
                print(
                    f"{name:40}{100 * measured:10.3f}{100 * expected:10.3f}"
                    f"{measured / expected:8.2f}",
                    flush=True,
                )
        note(f"{renderer.info['renderer']}, {settings}")
    measured, expected = np.transpose(figures)
    low, middle, high = np.percentile(measured / expected, [0, 50, 100])
    print(f"\nmeasured over expected: {low:.2f} to {high:.2f}, median {middle:.2f}; ", end="")
    print(f"of the sums {measured.sum() / expected.sum():.2f}")


if __name__ == "__main__":
    main()
