"""Measure the cost and error of every value of every effect: ``python -m scripts.effect_costs``.

One standard scene, camera and sun. Writes docs/effects_measured.json, from which
``python -m scripts.effects_page`` fills the page. Needs the extra ``truth`` and a renderer.
"""

import argparse
import json
import os
import statistics
import time
from functools import partial
from pathlib import Path

import csm
from csm import _core
from csm.timing import by_pass, total_ms
from scripts.effect_needs import needs_of, values_of

MEASURED = Path(__file__).resolve().parents[1] / "docs" / "effects_measured.json"
SIZE = (960, 540)
BASE = csm.ShadowSettings(map_size=1024)
CAMERA, SUN = "roofs", "afternoon"
OUTPUTS = ("mask", "valid", "cascade_index")
LONG = 10.0  # times the base
# Values that the shared table gives for small scenes, for this one.
HERE = {
    ("split", "manual"): {"manual_splits": (20.0, 45.0, 80.0)},
    ("depth_range", "manual"): {"manual_depth_range": (-100.0, 95.0)},
}


def rows():
    """(setting, value, settings besides) of every value of every effect that has a name."""
    return [
        (row["name"], value, HERE.get((row["name"], value), needs_of(row["name"], value)))
        for row in _core.effect_table()
        if row["name"]
        for value in values_of(row)
    ]


def settings_of(name, value, besides):
    """The settings of a row."""
    return BASE.replace(**besides, **{name: value})


def map_bytes(settings):
    """Bytes of what only shadows need: maps, moments and what they are made from."""
    plan = csm.plan(settings, size=SIZE, outputs=OUTPUTS)
    return sum(texture.bytes for texture in plan.textures if not texture.name.startswith("view_"))


def timer(renderer):
    """(what is timed, function from a job that renders to its ms).

    On software GL every core works for the passes, and others may want the cores: the processor
    time of the process is what can be repeated there. Elsewhere it is that of the passes.
    """

    def processor(render):
        start = time.process_time()
        render()
        return 1e3 * (time.process_time() - start)

    def passes(render):
        return total_ms(by_pass(render().timings_ms))

    if renderer.info["software"]:
        return "processor time of all cores", processor
    return "time of all passes but the readback", passes


def times(render, ms_of, every, rounds):
    """Median ms of each settings, and of its ratio to the base rendered next to it.

    Each frame that counts follows one of the same settings that does not. What takes ten times as
    long as the base is measured once: noise is no matter there.
    """
    taken = {settings: [] for settings in every}
    for number in range(rounds):
        for settings, pairs in taken.items():
            if pairs and pairs[0][1] > LONG:
                continue
            one = {}
            for side in (settings, BASE) if number % 2 else (BASE, settings):
                render(side)
                one[side] = ms_of(partial(render, side))
            pairs.append((one[settings], one[settings] / one[BASE]))
        print(f"round {number + 1} of {rounds}", flush=True)
    return {
        settings: [statistics.median(column) for column in zip(*pairs, strict=True)]
        for settings, pairs in taken.items()
    }


def measure(rounds, rays):
    """Everything that the page says, as plain values."""
    scene = csm.scenes.town(20_000)
    camera, sun = scene.cameras[CAMERA].replace(size=SIZE), scene.suns[SUN]
    point = csm.truth(scene, camera, sun)
    disc = csm.truth(scene, camera, sun, rays_per_pixel=rays)
    listed = [(row, settings_of(*row).canonical()) for row in rows()]
    every = dict.fromkeys([BASE.canonical(), *(settings for _, settings in listed)])
    with csm.Renderer() as renderer:
        info = renderer.info

        def render(settings, outputs=("mask",)):
            return renderer.render(scene, camera, sun, settings, outputs=outputs)

        clock, ms_of = timer(renderer)

        found = {}
        for settings in every:
            frame = render(settings, OUTPUTS)
            reports = [csm.compare(frame, truth) for truth in (point, disc)]
            found[settings] = {
                "bytes": map_bytes(settings),
                "disagreement": reports[0].disagreement,
                "error": reports[0].mean["total"],
                "error_disc": reports[1].mean["total"],
            }
        print(f"{len(every)} different settings", flush=True)
        for settings, (ms, ratio) in times(render, ms_of, every, rounds).items():
            found[settings] |= {"ms": ms, "time": ratio}
    return {
        "driver": info["renderer"],
        "version": info["version"],
        "stage": info["stage"],
        "clock": clock,
        "cores": len(os.sched_getaffinity(0)),
        "csm": csm.__version__,
        "scene": f"town(20000), camera {CAMERA}, sun {SUN}",
        "sun_deg": sun.angular_diameter_deg,
        "size": list(SIZE),
        "map_size": BASE.map_size,
        "rounds": rounds,
        "rays": rays,
        "base": rounded(found[BASE.canonical()]),
        "rows": [
            {"setting": name, "value": value, "besides": besides, **rounded(found[settings])}
            for (name, value, besides), settings in listed
        ],
    }


def rounded(numbers):
    """Four digits of each number; whole ones as they are."""
    return {
        key: value if isinstance(value, int) else float(f"{value:.4g}")
        for key, value in numbers.items()
    }


def main():
    """Measure and write."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--rounds", type=int, default=5, help="frames that count, of each")
    options.add_argument("--rays", type=int, default=64, help="to the sun's disc, of each pixel")
    options.add_argument("--out", type=Path, default=MEASURED)
    given = options.parse_args()
    found = measure(given.rounds, given.rays)
    head = {key: value for key, value in found.items() if key != "rows"}
    lines = ",\n".join("    " + json.dumps(row) for row in found["rows"])
    text = json.dumps(head, indent=2)[:-2] + f',\n  "rows": [\n{lines}\n  ]\n}}\n'
    given.out.write_text(text, encoding="utf-8")
    print(given.out)


if __name__ == "__main__":
    main()
