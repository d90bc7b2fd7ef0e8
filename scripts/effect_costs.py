"""Measure the cost and error of every value of every effect: ``python -m scripts.effect_costs``.

One standard scene, camera and sun. Writes docs/effects_measured.json, from which
``python -m scripts.effects_page`` fills the page. Needs the extra ``truth`` and a renderer.
"""

import argparse
import json
import math
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


def timed(render, ms_of, settings, long):
    """ms of a frame after one of the same settings that does not count.

    What takes longer than `long` [ms] is taken at once: what a first frame adds is no matter there.
    """
    first = ms_of(partial(render, settings))
    return first if first > long else ms_of(partial(render, settings))


def times(render, ms_of, every, rounds):
    """Median ms of each settings, and of its ratio to the base rendered next to it.

    Yields what is known after each round, by settings. What takes ten times as long as the base is
    measured in the first round alone.
    """
    taken = {settings: [] for settings in every}
    for _ in range(rounds):
        for settings, pairs in taken.items():
            if pairs and pairs[0][1] > LONG:
                continue
            base = timed(render, ms_of, BASE, math.inf)
            one = timed(render, ms_of, settings, LONG * base)
            pairs.append((one, one / base))
        yield {
            settings: [statistics.median(column) for column in zip(*pairs, strict=True)]
            for settings, pairs in taken.items()
        }


def measure(rounds, rays, wanted):
    """Everything that the page says of the wanted rows, as plain values, after each round."""
    scene = csm.scenes.town(20_000)
    camera, sun = scene.cameras[CAMERA].replace(size=SIZE), scene.suns[SUN]
    point = csm.truth(scene, camera, sun)
    disc = csm.truth(scene, camera, sun, rays_per_pixel=rays)
    listed = [(row, settings_of(*row).canonical()) for row in wanted]
    every = dict.fromkeys([BASE.canonical(), *(settings for _, settings in listed)])
    with csm.Renderer() as renderer:
        info = renderer.info

        def render(settings, outputs=("mask",)):
            return renderer.render(scene, camera, sun, settings, outputs=outputs)

        clock, ms_of = timer(renderer)
        found = {}
        for settings in every:
            frame = render(settings, OUTPUTS)
            render(settings)  # other outputs are other programs: all are compiled before times
            reports = [csm.compare(frame, truth) for truth in (point, disc)]
            found[settings] = {
                "bytes": map_bytes(settings),
                "disagreement": reports[0].disagreement,
                "error": reports[0].mean["total"],
                "error_disc": reports[1].mean["total"],
            }
        print(f"{len(every)} different settings", flush=True)
        for number, known in enumerate(times(render, ms_of, every, rounds), 1):
            for settings, (ms, ratio) in known.items():
                found[settings] |= {"ms": ms, "time": ratio}
            print(f"round {number} of {rounds}", flush=True)
            yield {
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
                "rounds": number,
                "rays": rays,
                "base": rounded(found[BASE.canonical()]),
                "rows": [
                    {"setting": row[0], "value": row[1], "besides": row[2], **rounded(found[one])}
                    for row, one in listed
                ],
            }


def rounded(numbers):
    """Four digits of each number; whole ones as they are."""
    return {
        key: value if isinstance(value, int) else float(f"{value:.4g}")
        for key, value in numbers.items()
    }


def chosen(names):
    """Rows of some settings ("filter") or of some of their values ("filter=savsm"); else all."""
    every = rows()
    picked = [row for row in every if not names or {row[0], f"{row[0]}={row[1]}"} & {*names}]
    known = {text for name, value, _ in every for text in (name, f"{name}={value}")}
    unknown = [name for name in names if name not in known]
    if unknown:
        raise SystemExit(f"no effect or value of one: {', '.join(unknown)}")
    return picked


def merged(found, path):
    """New rows in the place of those that a file has; the rest of it as it was."""
    before = json.loads(path.read_text(encoding="utf-8"))
    fresh = {(row["setting"], row["value"]): row for row in found["rows"]}
    rows_ = [fresh.get((row["setting"], row["value"]), row) for row in before["rows"]]
    return {**before, "rows": rows_}


def main():
    """Measure and write."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--rounds", type=int, default=5, help="frames that count, of each")
    options.add_argument("--rays", type=int, default=64, help="to the sun's disc, of each pixel")
    options.add_argument("--only", nargs="+", default=[], help="settings or setting=value; the "
                         "other rows stay as the file has them")  # fmt: skip
    options.add_argument("--out", type=Path, default=MEASURED)
    given = options.parse_args()
    for found in measure(given.rounds, given.rays, chosen(given.only)):
        write(merged(found, given.out) if given.only else found, given.out)
    print(given.out)


def write(found, path):
    """JSON with a line for each row, whole at any time."""
    head = {key: value for key, value in found.items() if key != "rows"}
    lines = ",\n".join("    " + json.dumps(row) for row in found["rows"])
    text = json.dumps(head, indent=2)[:-2] + f',\n  "rows": [\n{lines}\n  ]\n}}\n'
    path.with_suffix(".new").write_text(text, encoding="utf-8")
    path.with_suffix(".new").replace(path)


if __name__ == "__main__":
    main()
