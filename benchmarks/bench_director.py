"""A director beside plain rendering along two paths: time, maps that stayed, flicker.

``python benchmarks/bench_director.py`` walks through made scenes, and through the real ones where
``--scenes`` or CSM_SCENES names their folder, on two paths: a walk of 3 cm and 0.2 degrees a frame,
and a head that turns by 0.03 degrees a frame. At every step all ways are rendered one after the
other, in an order that changes, so that all see the same machine. Ratios are medians over the
frames after the first, of the passes that draw the maps and of whole frames without readback.
Flicker is the mean change of the visibility from frame to frame at fixed points of the scene that
stay in range; the sun stands still, so the truth does not change.
"""

import argparse
import os
import sys
from contextlib import ExitStack
from pathlib import Path

import cases
import numpy as np

import csm
from csm.arguments import parse_settings, parse_size
from csm.timing import total_ms

MADE = ("town", "forest", "stairs")
REAL = (("denhaag_lod2", "street", "winter"), ("sponza_dabrovic", "court", "axis"))
PATHS = {"walk": (0.03, 0.2), "turn": (0.0, 0.03)}  # metres and degrees a frame
WAYS = ("plain", "kept", "scrolled")


def path(camera, steps, metres, degrees):
    """The camera going forward and turning to the right."""
    for step in range(steps):
        angle = np.radians(degrees * step)
        ahead = -camera.backward
        turned = np.cos(angle) * ahead + np.sin(angle) * camera.right
        eye = camera.eye + metres * step * ahead
        yield csm.Camera.look_at(
            eye, eye + turned, fov_y_deg=camera.fov_y_deg, near=camera.near, far=camera.far,
            size=camera.size,
        )  # fmt: skip


def fixed_points(scene, camera, sun):
    """Up to 4000 lit or shadowed points of the first picture, and their normals."""
    first = csm.truth(scene, camera, sun)
    seen = first.valid & first.facing
    chosen = np.random.default_rng(1).permutation(np.count_nonzero(seen))[:4000]
    return first.position[seen][chosen], first.normal[seen][chosen]


def ways(scene, settings, renderers):
    """Functions from camera, sun and what else is asked for to a frame; reports of directors."""
    directors = {
        way: csm.Director(scene, settings, renderer=renderers[way], scroll=way == "scrolled")
        for way in WAYS[1:]
    }

    def plain(camera, sun, **asked):
        return renderers["plain"].render(scene, camera, sun, settings, **asked)

    return {"plain": plain} | {way: one.render for way, one in directors.items()}, directors


def flicker(scene, settings, renderers, cameras, sun):
    """Mean change [%] at fixed points from frame to frame, by way."""
    points, normals = fixed_points(scene, cameras[0], sun)
    render, _ = ways(scene, settings, renderers)
    found = {}
    for way in WAYS:
        seen = []
        for camera in cameras:
            frame = render[way](
                camera, sun, outputs=("mask",), points=points, point_normals=normals
            )
            seen.append(np.where(frame.point_cascade == 255, np.nan, frame.point_visibility))
        found[way] = 100.0 * np.nanmean(np.abs(np.diff(seen, axis=0)))
    return found


def measure(scene, settings, renderers, cameras, sun):
    """A row a way: times, shares of maps [%], flicker, pixels that differ from plain ones [%]."""
    for renderer in renderers.values():
        renderer.forget()
    flickered = flicker(scene, settings, renderers, cameras[:20], sun)
    render, directors = ways(scene, settings, renderers)
    times, differ = {way: [] for way in WAYS}, {way: [] for way in WAYS}
    for number, camera in enumerate(cameras):
        masks = {}
        for way in np.roll(WAYS, number):
            frame = render[way](camera, sun, outputs=("mask",))
            masks[way] = frame.mask
            spent = frame.timings_ms
            maps = sum(ms for name, ms in spent.items() if name.startswith("shadow_map_"))
            if number:
                times[way].append((maps, total_ms(spent)))
        for way in WAYS:
            differ[way].append(np.mean(masks[way] != masks["plain"]))
    medians = {way: np.median(times[way], axis=0) for way in WAYS}
    means = {way: np.mean(times[way], axis=0) for way in WAYS}
    for way in WAYS:
        counts = directors[way].report().maps if way in directors else {"draw": 1}
        total = sum(counts.values())
        yield (
            way, medians[way][0], medians[way][0] / medians["plain"][0],
            means[way][0] / means["plain"][0], medians[way][1] / medians["plain"][1],
            *(100.0 * counts.get(name, 0) / total for name in ("keep", "add", "scroll")),
            flickered[way], 100.0 * np.mean(differ[way]),
        )  # fmt: skip


def scenes(folder):
    """Name, scene, camera and sun of every scene there is."""
    for name in MADE:
        scene = csm.scenes.SCENES[name]()
        yield name, scene, next(iter(scene.cameras.values())), next(iter(scene.suns.values()))
    if not folder or not (Path(folder) / "scenes.json").is_file():
        cases.note("no real scenes: set CSM_SCENES to the folder of scenes.json")
        return
    for name, camera, sun in REAL:
        scene = cases.load(Path(folder) / f"{name}.glb")
        yield name, scene, scene.cameras[camera], scene.suns[sun]


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--scenes", default=os.environ.get("CSM_SCENES"), metavar="DIR")
    options.add_argument("--size", type=parse_size, default=(960, 540), metavar="WxH")
    options.add_argument("--steps", type=int, default=40)
    options.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="changes")
    options.add_argument("--backend", default="auto")
    arguments = options.parse_args()
    try:
        settings = parse_settings(arguments.changes)
    except (TypeError, ValueError) as error:
        options.error(str(error))
    print(
        f"{'scene':17} {'path':5} {'way':9} {'maps ms':>8} {'ratio':>6} {'mean':>6} {'frame':>6} "
        f"{'kept %':>7} {'added %':>8} {'scroll %':>9} {'flicker %':>10} {'differ %':>9}"
    )
    with ExitStack() as stack:
        renderers = {way: stack.enter_context(csm.Renderer(arguments.backend)) for way in WAYS}
        for name, scene, camera, sun in scenes(arguments.scenes):
            for label, (metres, degrees) in PATHS.items():
                cameras = list(
                    path(camera.replace(size=arguments.size), arguments.steps, metres, degrees)
                )
                for row in measure(scene, settings, renderers, cameras, sun):
                    way, ms, ratio, mean, frame, kept, added, scrolled, flickers, differs = row
                    print(
                        f"{name:17} {label:5} {way:9} {ms:8.2f} {ratio:6.3f} {mean:6.3f} "
                        f"{frame:6.2f} {kept:7.0f} {added:8.0f} {scrolled:9.0f} {flickers:10.4f} "
                        f"{differs:9.4f}"
                    )
                    sys.stdout.flush()


if __name__ == "__main__":
    main()
