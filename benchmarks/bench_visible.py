"""Windows round what is seen beside windows that stand still: error, flicker and cost on a walk.

``python benchmarks/bench_visible.py`` walks through the made scenes. Every setting is rendered at
each step, one after the other, so that all see the same machine. Flicker is the mean change of the
mask from frame to frame at fixed points of the scene that stay in sight (static sun: the truth
does not change).
"""

import argparse
import sys
from contextlib import ExitStack

import numpy as np

import csm
from csm.arguments import parse_size

SETTINGS = {
    "sphere, exact": {},
    "sphere, free": {"snap": "none"},
    "visible, exact": {"fit": "visible"},
    "visible, free": {"fit": "visible", "snap": "none"},
    "visible, turned": {"fit": "visible", "turned": True},
}
SCENES = ("town", "forest", "stairs")


def walk(camera, steps):
    """The camera going forward and turning, 3 cm and 0.2 degrees a frame."""
    for step in range(steps):
        angle = np.radians(0.2 * step)
        ahead = -camera.backward
        turned = np.cos(angle) * ahead + np.sin(angle) * camera.right
        eye = camera.eye + 0.03 * step * ahead
        yield csm.Camera.look_at(
            eye, eye + turned, fov_y_deg=camera.fov_y_deg, near=camera.near, far=camera.far,
            size=camera.size,
        )  # fmt: skip


def median(rows):
    return {name: np.median([row[name] for row in rows]) for name in rows[0]}


def measure(renderers, scene, camera, sun, steps):
    """Rows of (name, disagreement %, flicker %, shadow passes ms, receiver passes ms)."""
    first = csm.truth(scene, camera, sun)
    seen = first.position[first.valid & first.facing]
    normals = first.normal[first.valid & first.facing]
    chosen = np.random.default_rng(1).permutation(len(seen))[:4000]
    points, normals = seen[chosen], normals[chosen]
    last, changes, wrong, times = {}, {}, {}, {}
    for here in walk(camera, steps):
        truth = csm.truth(scene, here, sun)
        for name, changed in SETTINGS.items():
            frame = renderers[name].render(
                scene, here, sun, csm.ShadowSettings(**changed), points=points,
                point_normals=normals,
            )  # fmt: skip
            visibility = np.where(frame.point_cascade == 255, np.nan, frame.point_visibility)
            if name in last:
                changes.setdefault(name, []).append(np.nanmean(abs(visibility - last[name])))
            last[name] = visibility
            wrong.setdefault(name, []).append(csm.compare(frame, truth).disagreement)
            times.setdefault(name, []).append(frame.timings_ms)
    for name in SETTINGS:
        at = median(times[name])
        shadow = sum(ms for key, ms in at.items() if key.startswith("shadow_map_"))
        reduce = sum(ms for key, ms in at.items() if key.startswith("receiver_"))
        yield name, 100 * np.mean(wrong[name]), 100 * np.mean(changes[name]), shadow, reduce


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--size", type=parse_size, default=(960, 540), metavar="WxH")
    options.add_argument("--steps", type=int, default=24)
    options.add_argument("--backend", default="auto")
    arguments = options.parse_args()
    print(
        f"{'scene':9} {'setting':16} {'wrong %':>8} {'flicker %':>10} {'maps ms':>8} {'sums ms':>8}"
    )
    with ExitStack() as stack:
        # a renderer each: what one frame holds for the next is of frames with equal settings
        renderers = {
            name: stack.enter_context(csm.Renderer(arguments.backend)) for name in SETTINGS
        }
        for name in SCENES:
            scene = csm.scenes.SCENES[name]()
            camera = next(iter(scene.cameras.values())).replace(size=arguments.size)
            sun = next(iter(scene.suns.values()))
            for row in measure(renderers, scene, camera, sun, arguments.steps):
                label, wrong, flicker, shadow, reduce = row
                print(
                    f"{name:9} {label:16} {wrong:8.3f} {flicker:10.4f} {shadow:8.1f} {reduce:8.2f}"
                )
                sys.stdout.flush()


if __name__ == "__main__":
    main()
