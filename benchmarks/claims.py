"""Claims of the sources on cascaded shadow maps, each measured and given a verdict.

``python benchmarks/claims.py --json FILE`` measures all of them on this machine, ``--only ID`` one
(again for more; a FILE that is there keeps its others), ``--list`` names them. ``--markdown FILE``
writes the page; with ``--from JSON …`` it is made from what was measured before, on one machine or
several, and nothing is measured. Real scenes are taken from ``--folder``, or CSM_SCENES if that is
set; ``--scenes NAME …`` takes only some. ``--label`` names the machine on the page. The files of
other machines belong beside the first: ``docs/claims_measured_NAME.json``.
"""

import argparse
import datetime
import json
import os
import platform
import sys
import time
from dataclasses import asdict
from pathlib import Path

from cases import note
from claim_page import page
from claim_table import CLAIMS
from claim_verdicts import condition, judge
from claim_views import FAR, SIZE, Bench

import csm
from csm.arguments import parse_size
from csm.digests import commit


def machine(renderer, loads):
    """Who measured, and how busy the machine was."""
    info = renderer.info
    driver = ", ".join(info[name] for name in ("backend", "renderer", "version"))
    return {
        "driver": f"{driver}, stage {info['stage']}",
        "machine": f"{platform.machine()}, {len(os.sched_getaffinity(0))} cores",
        "load": " and ".join(f"{load:.1f}" for load in loads),
        "commit": commit() or "no checkout",
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "command": "python benchmarks/claims.py " + " ".join(sys.argv[1:]),
    }


def measure(claims, options):
    """Measure claims; the file is written after each, so that nothing is lost."""
    loads = [os.getloadavg()[0]]
    commit()  # what is loaded now: it is remembered, whatever is edited meanwhile
    with csm.Renderer(options.backend) as renderer:
        bench = Bench(renderer, options.folder, options.scenes, options.size)
        probe = bench.render(bench.views[0], csm.ShadowSettings(), outputs=("mask",))
        clock = probe.info["clock"]
        label = options.label or renderer.info["renderer"].split("(")[0].strip()
        views = bench.views + bench.views_of(FAR)  # all that any claim takes
        scenes = list(dict.fromkeys(view.scene_name for view in views))
        found = {"label": label, "size": list(options.size), "scenes": scenes, "claims": {}}
        earlier = {}
        if options.only and options.json and options.json.exists():
            earlier = json.loads(options.json.read_text(encoding="utf-8"))
        for claim in claims:
            start = time.perf_counter()
            cases = claim.measure(bench)
            if not cases:
                note(f"{claim.id}: no case, these scenes say nothing about it")
                continue
            verdict = judge(cases, claim.rule)
            found["claims"][claim.id] = [asdict(case) for case in cases]
            found["machine"] = machine(renderer, [loads[0], os.getloadavg()[0]]) | {"clock": clock}
            if options.json:
                together = joined(earlier, found) if earlier else found
                options.json.write_text(to_json(together), encoding="utf-8")
            note(f"{claim.id}: {verdict.text} ({time.perf_counter() - start:.0f} s)")
            print(f"{claim.title}: {verdict.text}. {condition(verdict)}")
            for group in verdict.groups:
                print(
                    f"    {group.status:5} {group.mean:8.3f}  {group.count:3} cases  {group.name}"
                )
    return found


def joined(earlier, found):
    """What a file has of other claims with what was measured now, if the same machine did both."""
    for name in ("size", "scenes", "label"):
        if earlier[name] != found[name]:
            raise SystemExit(f"the file has {name} {earlier[name]}, now it is {found[name]}")
    old, new = earlier["machine"], found["machine"]
    for name in ("driver", "machine", "commit", "clock"):
        if old[name] != new[name]:
            raise SystemExit(
                f"the file was measured with {name} {old[name]}, now it is {new[name]}"
            )
    both = earlier["claims"] | found["claims"]
    order = [claim.id for claim in CLAIMS if claim.id in both]
    stamps = {name: f"{old[name]}; {new[name]}" for name in ("load", "command", "date")}
    return found | {"machine": new | stamps, "claims": {name: both[name] for name in order}}


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
    options.add_argument("--size", type=parse_size, default=SIZE, metavar="WxH")
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
        files = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(options.files)]
    else:
        files = [measure(claims, options)]
    if options.markdown:
        options.markdown.write_text(page(claims, files), encoding="utf-8")


if __name__ == "__main__":
    main()
