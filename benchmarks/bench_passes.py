"""Time of each pass, and of the whole job beside the same job hand-written with moderngl.

The job is a hard-shadow frame of the code-made town: camera pass, four 2048 x 2048 maps, mask,
mask in a numpy array. Both sides run in turns in one process and write into an array they keep;
what is compared is the ratio within a round, since absolute times follow the machine's mood.
"""

import argparse
import os
import time

import numpy as np
from peer_moderngl import Peer

import csm
from csm import scenes

GOALS = {50_000: 0.8, 1_000_000: 0.6}  # wall time of csm over that of the peer
VIEW = ("roofs", "afternoon")  # camera and sun of the town
MAP_SIZE = 2048


def size_of(text):
    """(width, height) from "1920x1080"."""
    width, height = text.lower().split("x")
    return int(width), int(height)


def arguments():
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15, help="rounds of both sides, in turns")
    parser.add_argument("--size", type=size_of, default=(1920, 1080), help="of the mask [px]")
    parser.add_argument("--triangles", type=int, nargs="+", default=list(GOALS))
    parser.add_argument("--backend", default="auto")
    return parser.parse_args()


def timed(job):
    """(result, wall ms, CPU ms of all threads) of one call."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = job()
    return result, 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu)


def quartiles(values):
    """Median and quartiles as text."""
    low, median, high = np.percentile(values, [25, 50, 75])
    return f"{median:8.2f} ({low:.2f} to {high:.2f})"


def measure(renderer, peer, job, rounds):
    """Run both sides in turns.

    Returns
    -------
    times : (rounds, 2, 2) float64
        Wall and CPU [ms] of csm and of the peer.
    passes : dict of str to list of float
        csm's ms per pass, one number per round.
    masks : tuple of (height, width) float32
    """
    scene, camera, sun, settings, cascades = job
    shadow_range = (cascades.splits[0], cascades.splits[-1])
    frame = renderer.render(scene, camera, sun, settings, outputs=("mask",))
    sides = [
        lambda: renderer.render(scene, camera, sun, settings, outputs=("mask",), out=frame),
        lambda: peer.render(camera, sun.to_light, shadow_range, cascades.depth_range[0]),
    ]
    for _ in range(2):  # shaders are compiled at the first draw
        masks = [side() for side in sides]
    times, passes = np.zeros((rounds, 2, 2)), {}
    for number in range(rounds):
        for side in (0, 1) if number % 2 else (1, 0):
            masks[side], *times[number, side] = timed(sides[side])
        for name, ms in masks[0].timings_ms.items():
            passes.setdefault(name, []).append(ms)
    return times, passes, (masks[0].mask, masks[1])


def report(triangle_count, times, passes, masks, goal):
    """Print one case."""
    print(f"\ntown, {triangle_count:,} triangles, {masks[0].shape[1]} x {masks[0].shape[0]}")
    print("  csm, pass                    ms: median (quartiles)")
    for name, ms in passes.items():
        print(f"    {name:24} {quartiles(ms)}")
    print("  whole job                    wall ms                     CPU ms")
    for side, name in enumerate(("csm", "moderngl by hand")):
        wall, cpu = times[:, side, 0], times[:, side, 1]
        print(f"    {name:20} {quartiles(wall):28}{quartiles(cpu)}")
    ratios = times[:, 0] / times[:, 1]
    print(f"    {'ratio in a round':20} {quartiles(ratios[:, 0]):28}{quartiles(ratios[:, 1])}")
    different = np.mean((masks[0] >= 0.5) != (masks[1] >= 0.5))
    print(f"  masks differ in {different:.3%} of the pixels")
    if goal is not None:
        median = np.median(ratios[:, 0])
        print(f"  goal: wall ratio at most {goal} - {'reached' if median <= goal else 'missed'}")


def main():
    """Measure and print every case."""
    options = arguments()
    settings = csm.ShadowSettings(cascade_count=4, map_size=MAP_SIZE)
    threads = os.environ.get("LP_NUM_THREADS", "unset")
    print(f"{os.cpu_count()} cores, LP_NUM_THREADS {threads}, {options.rounds} rounds in turns")
    for triangles in options.triangles:
        scene = scenes.town(triangles=triangles)
        camera = scene.cameras[VIEW[0]].replace(size=options.size)
        sun = scene.suns[VIEW[1]]
        cascades = csm.fit_cascades(camera, sun, settings, scene=scene)
        with csm.Renderer(backend=options.backend) as renderer:
            peer = Peer(*scene.flatten(), scene.origin, options.size, MAP_SIZE)
            job = (scene, camera, sun, settings, cascades)
            times, passes, masks = measure(renderer, peer, job, options.rounds)
            peer.release()
        report(scene.triangle_count, times, passes, masks, GOALS.get(triangles))


if __name__ == "__main__":
    main()
