"""csm beside other engines against ray-traced truth: eleven views of real scenes.

Two figures per case, in per cent of the sun-facing pixels: how many are on the wrong side of 0.5,
and the mean absolute error; the first is blind to acne that stays above 0.5. csm runs with its
default settings (4 cascades of 2048 x 2048, hard compare) unless --set changes them. The peers'
figures were measured once, by us, on the same scenes, size, number and size of cascades and
software rasteriser; those marked tuned had their biases chosen with the truth in hand:

    three.js CSM addon, PCF: its default bias; 3 texels of depth and 0.5 texel of normal bias per
    cascade; the same with hard compare. Babylon.js CascadedShadowGenerator, PCF: default
    (stabilised); tuned with automatic bounds and lambda 1. A hand-written moderngl renderer,
    tuned: PCF 3 x 3, and 2 x 2 bilinear compare.
"""

import numpy as np
from cases import entries, judge, load, note, parsed, parser

import csm

PEERS = (
    "three",
    "three tuned",
    "three hard",
    "babylon",
    "babylon tuned",
    "moderngl",
    "moderngl hard",
)
# scene, camera, sun: (disagreement, mean absolute error) [%] of each of PEERS
CASES = {
    ("ms_shadow_columns", "top", "sample"): (
        (48.39, 48.75), (0.40, 0.79), (0.41, 0.41), (35.43, 44.99), (0.20, 0.63), (0.27, 0.80),
        (0.24, 0.34),
    ),
    ("ms_shadow_columns", "aisle", "grazing"): (
        (50.85, 49.93), (0.06, 15.72), (0.06, 0.06), (44.21, 47.35), (0.05, 5.77), (0.04, 0.35),
        (0.04, 0.06),
    ),
    ("ms_shadow_columns", "dueling", "dueling"): (
        (37.82, 35.14), (0.22, 12.04), (0.32, 0.32), (39.00, 34.90), (0.06, 5.70), (0.18, 0.86),
        (0.32, 0.39),
    ),
    ("sponza_dabrovic", "nave", "shaft"): (
        (5.70, 5.45), (0.44, 0.88), (0.47, 0.47), (3.63, 5.13), (0.46, 1.12), (0.30, 0.89),
        (0.35, 0.47),
    ),
    ("sponza_dabrovic", "court", "overhead"): (
        (28.17, 28.61), (1.41, 1.67), (1.41, 1.41), (0.55, 1.63), (2.03, 2.45), (0.45, 1.40),
        (0.49, 0.70),
    ),
    ("littlest_tokyo", "street", "morning"): (
        (45.71, 40.23), (1.82, 2.80), (1.89, 1.89), (21.05, 34.50), (2.31, 3.10), (1.29, 3.40),
        (1.37, 1.81),
    ),
    ("littlest_tokyo", "above", "grazing"): (
        (27.23, 25.21), (2.26, 4.13), (2.28, 2.28), (15.47, 23.07), (1.88, 2.88), (1.69, 4.21),
        (1.65, 2.12),
    ),
    ("dutch_ship", "deck", "side"): (
        (22.66, 22.61), (3.67, 5.34), (3.93, 3.93), (12.60, 20.09), (5.78, 7.10), (2.55, 4.66),
        (2.42, 2.97),
    ),
    ("denhaag_lod2", "street", "winter"): (
        (17.18, 16.94), (0.21, 0.66), (0.31, 0.31), (9.71, 15.97), (0.03, 0.10), (0.06, 0.42),
        (0.10, 0.18),
    ),
    ("denhaag_lod2", "oblique", "summer"): (
        (45.11, 46.14), (0.82, 1.82), (0.93, 0.93), (31.75, 42.82), (0.77, 2.02), (0.59, 2.82),
        (0.69, 1.09),
    ),
    ("denhaag_lod2", "oblique", "sunset"): (
        (11.74, 12.42), (1.92, 5.69), (1.83, 1.83), (9.53, 12.76), (0.80, 5.92), (1.84, 5.82),
        (1.82, 2.72),
    ),
}  # fmt: skip
GOAL = 0.7  # largest mean of either figure [%]


def row(name, figures):
    """One line of the table."""
    return f"{name:32}" + "".join(f"{a:8.2f} /{b:6.2f}" for a, b in figures)


def main():
    """Print the table."""
    arguments, settings = parsed(parser(__doc__.splitlines()[0]))
    known = entries(arguments.scenes)
    figures = []
    print(f"disagreement / mean absolute error, % of sun-facing pixels, {arguments.size}")
    print(f"{'':32}" + "".join(f"{name:>16}" for name in ("csm", *PEERS)))
    with csm.Renderer(arguments.backend) as renderer:
        for (scene_name, camera, sun), peers in CASES.items():
            scene = load(f"{arguments.scenes}/{known[scene_name]['file']}")
            report = judge(renderer, scene, camera, sun, arguments.size, settings).report
            ours = (100.0 * report.disagreement, 100.0 * report.mean["total"])
            figures.append((ours, *peers))
            print(row(f"{scene_name[:13]} {camera} {sun}", figures[-1]), flush=True)
        note(f"{renderer.info['renderer']}, {settings}")
    means = np.mean(figures, axis=0)
    print(row("mean", means))
    ours, best = means[0], means[1:].min(axis=0)
    verdict = "reached" if ours.max() <= GOAL else "missed"
    print(f"\ngoal: both means at most {GOAL} %: {verdict}; csm {ours[0]:.3f} and {ours[1]:.3f} %,")
    print(f"best of the peers {best[0]:.2f} and {best[1]:.2f} %")


if __name__ == "__main__":
    main()
