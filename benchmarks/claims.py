"""Claims of the sources on cascaded shadow maps, each measured and given a verdict.

``python benchmarks/claims.py --json FILE`` measures all of them on this machine, ``--only ID`` one
(again for more), ``--list`` names them. ``--markdown FILE`` writes the page; with ``--from JSON …`` it
is made from what was measured before, on one machine or several, and nothing is measured. Real
scenes are taken from ``--folder`` or CSM_SCENES if that is given; ``--scenes NAME …`` takes only some.
"""

import argparse
import datetime
import json
import math
import os
import platform
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import claim_filters
import claim_measures
import claim_times
from cases import note
from claim_page import page
from claim_verdicts import Rule, condition, judge
from claim_views import SIZE, Bench

import csm
from csm.digests import commit

BETTER = Rule(0.0, 0.95)  # a ratio of errors, at least a twentieth less


@dataclass(frozen=True)
class Claim:
    """What a source says, what is measured, and which numbers would be what it says."""

    id: str
    title: str
    source: str
    says: str
    measured: str
    value: str  # what a case's number is, in a few words
    states: str  # the rule in words
    rule: Rule
    measure: object = field(repr=False)  # function, Bench to list of Case
    why: str
    timed: bool = False


CLAIMS = (
    Claim(
        "stabilisation-area",
        "Exact stabilisation wastes 2.8 to 4.0 times the area",
        "[Zhang2009] 4.1, exact solution",
        'a "considerable portion" of the map is wasted by spheres. The text has no figure; 2.8 to 4.0 '
        "times was handed to us without a source.",
        "area of the window of `fit=sphere, snap=exact` over that of a tight one that is not "
        "stabilised, mean of four cascades: the box along light x and y (`fit=box`), and the smallest "
        "turned rectangle. 40 suns over the sky for fields of view of 45°, 60° and 90°, and all views.",
        "area, sphere over tight",
        "2.8 to 4.0 in four fifths of the cases",
        Rule(2.8, 4.0, "range"),
        claim_measures.stabilisation_area,
        "A slice seen end-on is as wide as it is high, and the square round its sphere is little more "
        "than twice its box; seen from the side it is thin, and the ratio has no bound as the slice "
        "gets flatter. The range asked about is that of light across the view against the "
        "smallest rectangle. A square of the slice's diameter is as stable and never larger.",
    ),
    Claim(
        "blend-branching",
        "Blending between cascades costs 15 % more where shaders branch",
        "[Stone]",
        '"only increased costs by about 15%" with good dynamic branching.',
        "time of the mask's pass with `blend=linear` over that without; only pixels in a transition "
        "look up a second cascade. 4 x 1024².",
        "time, blend over none",
        "1.075 to 1.225, half of the increase to one and a half times it",
        Rule(1.075, 1.225),
        claim_times.blend_branching,
        "WHY",
        timed=True,
    ),
    Claim(
        "blend-both",
        "Blending costs 40 % more where shaders do not branch",
        "[Stone]",
        'without branching "the cost of applying shadows grew by 40%".',
        "the same with csm's own shaders less the one branch: both cascades are looked up for every "
        "pixel and weighted, with a weight of 0 outside of transitions. The pictures are equal to the "
        "bit, or the measurement stops.",
        "time, both over none",
        "1.2 to 1.6, half of the increase to one and a half times it",
        Rule(1.2, 1.6),
        claim_times.blend_both,
        "WHY",
        timed=True,
    ),
    Claim(
        "more-cascades-error",
        "More, smaller maps are better: 5 x 640² against 3 x 1024²",
        "[Stone]",
        'five maps "increase the effective shadow map resolution" over three of 1024². Those were '
        "perspective maps with splits by hand; here both are plain ones.",
        "error of 5 x 640² over that of 3 x 1024², hard compare, with the same splits. Five have 0.65 of "
        "the texels. The near plane is put at half the depth of the nearest receivers. Cascades of equal "
        "ratio have finer texels by five than by three if the range reaches more than "
        f"(1024/640)^7.5 = {claim_measures.DEEP:.0f} times its near end: the condition, refined after a "
        "trial run.",
        "error, five over three",
        "at most 0.95",
        BETTER,
        claim_measures.more_cascades_error,
        "WHY",
    ),
    Claim(
        "more-cascades-cost",
        "5 x 640² cost half of 3 x 1024²",
        "[Stone]",
        '"half the cost" of three perspective maps that were looked up one by one.',
        "time of a whole frame with 5 x 640² over that with 3 x 1024²; both look up one cascade a pixel.",
        "time, five over three",
        "at most 0.6",
        Rule(0.0, 0.6),
        claim_times.more_cascades_cost,
        "WHY",
        timed=True,
    ),
    Claim(
        "vsm-no-cheaper",
        "Variance maps are no cheaper than good PCF for large outdoor cascades",
        "[Stone]",
        'their "performance was only equal" to eight Poisson taps.',
        "time of a whole frame with `filter=vsm` over that with compares under a kernel as wide, "
        f"outdoors. Beside it the errors against a sun of {claim_times.SUN_DISC}°.",
        "time, variance over compares",
        "at least 0.95",
        Rule(0.95, math.inf),
        claim_times.variance_maps,
        "WHY",
        timed=True,
    ),
    Claim(
        "splits-uniform",
        "Practical splits beat uniform ones",
        "[Zhang2006], [Zhang2009]",
        'the practical scheme "provides a practical solution".',
        "error with `split=practical` (λ = 0.5) over that with `uniform`, 4 x 1024²; each view with its "
        "own near plane and with one at half the depth of the nearest receivers.",
        "error, practical over uniform",
        "at most 0.95",
        BETTER,
        claim_measures.splits_uniform,
        "WHY",
    ),
    Claim(
        "splits-logarithmic",
        "Practical splits beat logarithmic ones",
        "[Zhang2006], [Zhang2009]",
        "the same; logarithmic splits are optimal in theory and too short near the eye.",
        "error with `split=practical` (λ = 0.5) over that with `logarithmic`, the same views. The "
        "condition, refined after a trial run: logarithmic cascades that end before the nearest "
        "hundredth of the receivers.",
        "error, practical over logarithmic",
        "at most 0.95",
        BETTER,
        claim_measures.splits_logarithmic,
        "WHY",
    ),
    Claim(
        "map-selection",
        "Selection by map gains most when light and view are parallel",
        "[Zhang2009] 4.1, [MSDN]",
        'interval selection is not optimal "once the light becomes almost parallel" to the view.',
        "how much finer texels are under `select=map` than under `interval`, in levels (log2), mean over "
        "all that is seen; light 5° from the view less light 85° from it. 30° and 60° lie between, in the "
        "JSON with the ratios of the errors.",
        "levels gained, 5° less 85°",
        "at least 0.1 levels more",
        Rule(0.1, math.inf, "difference"),
        claim_measures.map_selection,
        "WHY",
    ),
    Claim(
        "warping",
        "Warping with partitioning beats larger maps",
        "[Lloyd2006] as it is commonly cited",
        "a warp in each cascade lowers the error more than texels do. We read it in the paper's own "
        "measure too, the coarsest texels.",
        "LiSPSM in each of 4 x 512² over maps of four times the texels without warp, 4 x 1024² and "
        "1 x 2048², box fits, not snapped, near plane at half the depth of the nearest receivers: mean "
        f"error, and the length of texels in pixels that {100 - claim_measures.COARSEST} % of the "
        "receivers exceed.",
        "warped over larger",
        "at most 0.95",
        BETTER,
        claim_measures.warping,
        "WHY",
    ),
    Claim(
        "light-bleeding",
        "Light bleeding falls with resolution",
        "[MSDN]",
        'bleeding of variance maps is "lessened by using higher resolution textures".',
        "light leaks (the cause of `csm.compare`) of 4 x 1024² over those of 4 x 512², `filter=vsm`: with "
        "3 x 3 texels both times, and with a kernel as wide in metres (7 x 7 at 1024, as bilinear lookups "
        "add a texel).",
        "leak, 1024² over 512²",
        "at most 0.9",
        Rule(0.0, 0.9),
        claim_filters.light_bleeding,
        "WHY",
    ),
    Claim(
        "sixteen-bits",
        "16-bit depths need the quantum's bias and no more",
        "[theomader]; csm's closed form",
        'fewer bits have a "high quantization error" that bias hides; in closed form half a quantum does.',
        "the least of 0, ¼, ½, 1 and 2 quanta of constant bias with which a D16 map shows no more acne "
        "than a D32F one without (receiver plane and a quarter texel of slope in both; one map of 2048²), "
        "in the scene's depth range and in one 16 times as long. The condition, refined after a trial "
        "run: on how many receivers half a quantum exceeds the slope's bias.",
        "quanta needed",
        "¼ to 1 in four fifths of the cases",
        Rule(0.25, 1.0, "range"),
        claim_filters.sixteen_bits,
        "WHY",
    ),
    Claim(
        "seams",
        "One cascade a quad, or analytic gradients, remove the seam",
        "[Zhang2009] 4.1 (PSVSM), [MSDN]",
        'the method of PSVSM "solves this problem well"; so do derivatives in light space.',
        "what `gradients=quad` and `analytic` leave of the error that a seam adds under `hardware`; "
        "`filter=vsm`, 4 x 1024², selection by interval. What a seam adds is the error of pixels in quads "
        "of two cascades less that of the same pixels with all splits a tenth farther and a tenth nearer. "
        "(Pixels beside the seam, the first measure, lie on other surfaces.)",
        "share of the seam left",
        "at most 0.2",
        Rule(-math.inf, 0.2, "difference"),
        claim_filters.seams,
        "WHY",
    ),
)


def machine(renderer, loads):
    """Who measured, and how busy the machine was."""
    info = renderer.info
    return {
        "driver": f"{info['backend']}: {info['renderer']}, {info['version']}, stage {info['stage']}",
        "machine": f"{platform.machine()}, {len(os.sched_getaffinity(0))} cores",
        "load": " and ".join(f"{load:.1f}" for load in loads),
        "commit": commit() or "no checkout",
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "command": "python benchmarks/claims.py " + " ".join(sys.argv[1:]),
    }


def measure(claims, options):
    """Measure claims; the file is written after each, so that nothing is lost."""
    loads = [os.getloadavg()[0]]
    with csm.Renderer(options.backend) as renderer:
        bench = Bench(renderer, options.folder, options.scenes, options.size)
        probe = bench.render(bench.views[0], csm.ShadowSettings(), outputs=("mask",))
        label = options.label or renderer.info["renderer"].split("(")[0].strip()
        scenes = list(dict.fromkeys(view.scene_name for view in bench.views))
        found = {"label": label, "size": list(options.size), "scenes": scenes, "claims": {}}
        for claim in claims:
            start = time.perf_counter()
            cases = claim.measure(bench)
            verdict = judge(cases, claim.rule)
            found["claims"][claim.id] = [asdict(case) for case in cases]
            found["machine"] = machine(renderer, [loads[0], os.getloadavg()[0]])
            found["machine"]["clock"] = probe.info["clock"]
            if options.json:
                options.json.write_text(to_json(found), encoding="utf-8")
            note(f"{claim.id}: {verdict.text} ({time.perf_counter() - start:.0f} s)")
            print(f"{claim.title}: {verdict.text}. {condition(verdict)}")
            for group in verdict.groups:
                print(
                    f"    {group.status:5} {group.mean:8.3f}  {group.count:3} cases  {group.name}"
                )
    return found


def to_json(found):
    """One line a case; floats of six digits, which is more than any of them means."""

    def rounded(value):
        if isinstance(value, dict):
            return {key: rounded(one) for key, one in value.items()}
        if isinstance(value, list):
            return [rounded(one) for one in value]
        return float(f"{value:.6g}") if isinstance(value, float) else value

    rest = {key: value for key, value in found.items() if key != "claims"}
    claims = ",\n".join(
        f"  {json.dumps(name)}: [\n    "
        + ",\n    ".join(json.dumps(rounded(case), ensure_ascii=False) for case in cases)
        + "\n  ]"
        for name, cases in found["claims"].items()
    )
    head = json.dumps(rest, ensure_ascii=False, indent=1)[:-2]
    return f'{head},\n "claims": {{\n{claims}\n }}\n}}\n'


def arguments():
    """The command line."""
    known = [claim.id for claim in CLAIMS]
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--only", action="append", choices=known, metavar="ID", default=[])
    options.add_argument("--list", action="store_true", help="name the claims and end")
    options.add_argument("--scenes", nargs="+", default=[], metavar="NAME")
    options.add_argument("--folder", default=os.environ.get("CSM_SCENES"), metavar="DIR")
    options.add_argument("--size", type=csm.arguments.parse_size, default=SIZE, metavar="WxH")
    options.add_argument("--backend", default="auto")
    options.add_argument(
        "--label", help="of this machine on the page; its driver's name if left out"
    )
    options.add_argument("--json", type=Path, metavar="FILE", help="what is measured goes there")
    options.add_argument("--from", nargs="+", type=Path, metavar="JSON", dest="files", default=[])
    options.add_argument("--markdown", type=Path, metavar="FILE", help="the page goes there")
    return options.parse_args()


def main():
    """Measure, or read what was measured; write the page."""
    options = arguments()
    claims = [claim for claim in CLAIMS if not options.only or claim.id in options.only]
    if options.list:
        for claim in claims:
            print(f"{claim.id:22}{claim.title} ({claim.source})")
        return
    if options.files:
        files = [json.loads(path.read_text(encoding="utf-8")) for path in options.files]
    else:
        files = [measure(claims, options)]
    if options.markdown:
        options.markdown.write_text(page(claims, files), encoding="utf-8")


if __name__ == "__main__":
    main()
