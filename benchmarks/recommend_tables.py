"""The tables of docs/recommendation.md, from the files of bench_recommend.py.

``python benchmarks/recommend_tables.py rows.jsonl quick.jsonl`` writes them between the marks in
the docs; ``--print`` shows them instead. Goals are shown for every machine, driver, number of
processes and kind of run that the files are of, the other tables for the one of which most
decisions are known. Of a case that is in several files of one of these the last counts. Cases that
no file has are listed with the reason.
"""

import argparse
import os
import re
import sys
from pathlib import Path

import numpy as np
from bench_recommend import case_names, read, scenes

from csm.decisions import split_text
from csm.settings import ShadowSettings, maps_text
from csm.situations import is_default_split

DOCS = Path(__file__).resolve().parents[1] / "docs" / "recommendation.md"
RELATIVE, ABSOLUTE = 0.05, 5e-4  # how far from everything on
SHOWN = 3  # refuted cases of an effect that are named
FRAMES = 3  # of the recommendation, that the analysis may take
WHOLE = "whole_frame_ms"
ANALYSED = {  # by what of them
    WHOLE: "all that `render` gives by default",
    "frame_ms": "of which the mask alone comes back",
}
MARKS = ("<!-- {}: benchmarks/recommend_tables.py -->", "<!-- end of {} -->")


def gathered(paths):
    """Lines by case, of those that have a case, by machine; that of most decisions first."""
    machines = {}
    for path in paths:
        for case, line in read(path).items():
            lines = machines.setdefault(machine(line), {})
            known = lines.get(case)
            if known is None or "failed" in known or "failed" not in line:
                lines[case] = line
    order = sorted(machines, key=lambda name: -sum(map(worth, machines[name].values())))
    return {name: machines[name] for name in order}


def machine(line):
    """What ran a case, and how: of quick lines the truth has fewer rays, so they stay apart."""
    shared = f", {line['processes']} processes at once" if line["processes"] != 1 else ""
    quick = ", quick" if line.get("kind") == "quick" else ""
    width, height = line["size"]
    return f"{line['driver']} on {line['cores']} cores{shared}{quick}, {width} x {height}"


def worth(line):
    """What a line says: nothing but a failure, errors and times, or decisions too."""
    return 0 if "failed" in line else 2 if line["kind"] == "full" else 1


def turned(line):
    """Decisions that were turned round; of the others of a line there is nothing to turn."""
    return [row for row in line.get("rows", []) if row["confirmed"] is not None]


def is_near(line):
    """Whether the error is within the goal of everything on."""
    full = line["full_error"]
    return line["error"] <= max((1.0 + RELATIVE) * full, full + ABSOLUTE)


def what(line):
    """The recommended settings in a few words."""
    s = line["settings"]
    if line["dark"]:
        return "no shadow maps"
    settings = ShadowSettings.from_dict(s)
    maps = maps_text(settings)
    words = [f"{maps} {s['depth_format']} {s['filter']}"]
    if s["filter"] == "pcss":
        words.append(f"{s['tap_count']} taps")
    words += ["turned"] if s["turned"] else []
    words += [s["warp"]] if s["warp"] != "none" else []
    words += [] if is_default_split(settings) else [split_text(settings)]
    words += [s["caster_faces"]] if s["caster_faces"] != "both" else []
    return " ".join(words)


def why_missed(line):
    """Why an error is out of the goal: what was forecast of both."""
    return (
        f"forecast {100 * line['forecast']:.3f} beside {100 * line['full_forecast']:.3f}, "
        f"is {100 * line['error']:.3f} beside {100 * line['full_error']:.3f}"
    )


def frames_of_analysis(line, frame="frame_ms"):
    """How many frames of the recommendation the analysis took: of which the mask comes back."""
    return line["analysis_ms"] / line[frame]


def misses(line, analysis=True):
    """Which goals a case misses, and why; "" where none. The analysis only if that is asked for."""
    told = [] if is_near(line) else [why_missed(line)]
    if analysis and frames_of_analysis(line) >= FRAMES:
        told.append(
            f"analysis {line['analysis_ms']:.0f} ms, {frames_of_analysis(line):.1f} frames of "
            f"{line['frame_ms']:.0f} ms"
        )
    return "; ".join(told)


def cases_table(lines):
    """One row a case; where most take a long analysis, the table of goals says so once."""
    slow = sum(frames_of_analysis(line) >= FRAMES for line in lines.values())
    out = [
        "| case | recommended | error % | everything on % | time | confirmed | misses |",
        "|---|---|---|---|---|---|---|",
    ]
    for case, line in sorted(lines.items()):
        rows = turned(line)
        held = f"{sum(row['confirmed'] for row in rows)}/{len(rows)}" if rows else ""
        out.append(
            f"| {case} | {what(line)} | {100 * line['error']:.3f} | "
            f"{100 * line['full_error']:.3f} | {line['ms'] / line['full_ms']:.2f} | {held} | "
            f"{misses(line, analysis=2 * slow < len(lines))} |"
        )
    return out


def goals_table(runs):
    """What was to be reached, and was, by machine."""
    columns = [goals_reached(lines) for lines in runs.values()]
    out = ["| goal | " + " | ".join(runs) + " |", "|---" * (1 + len(runs)) + "|"]
    for goal in dict.fromkeys(name for column in columns for name in column):
        out.append(f"| {goal} | " + " | ".join(column.get(goal, "") for column in columns) + " |")
    return out


def goals_reached(lines):
    """The same of one machine, by goal."""
    rows = [row for line in lines.values() for row in turned(line)]
    ratios = [line["ms"] / line["full_ms"] for line in lines.values()]
    reached = {
        "within 5 % of the error or 0.05 % of the pixels of everything on": (
            f"{sum(map(is_near, lines.values()))} of {len(lines)}"
        ),
        "whole frame at most half the time of everything on, median": (
            f"{np.median(ratios):.2f}, quartiles {np.percentile(ratios, 25):.2f} and "
            f"{np.percentile(ratios, 75):.2f}, at most {max(ratios):.2f}"
        ),
    }
    if rows:
        held, strict = (sum(row[key] for row in rows) for key in ("confirmed", "strict"))
        reached["decisions confirmed, at least 90 %"] = (
            f"{held} of {len(rows)}, {held / len(rows):.1%}; {strict} "
            f"({strict / len(rows):.0%}) if what was left out may not make the picture worse either"
        )
    in_turns = all(WHOLE in line for line in lines.values())  # older ones took none
    for frame, kind in ANALYSED.items() if in_turns else ():
        spent = np.array([frames_of_analysis(line, frame) for line in lines.values()])
        analysis, of = (
            np.median([line[name] for line in lines.values()]) for name in ("analysis_ms", frame)
        )
        reached[f"the analysis costs less than three frames of the recommendation, {kind}"] = (
            f"{np.count_nonzero(spent < FRAMES)} of {len(spent)}; median {np.median(spent):.1f}, "
            f"at most {spent.max():.1f}; {analysis:.3g} ms beside frames of {of:.3g} ms"
        )
    return reached


def effects_table(lines):
    """How each row of the table of decisions did."""
    by_effect = {}
    for line in lines.values():
        for row in line.get("rows", []):
            by_effect.setdefault(row["effect"], []).append(row)
    out = ["| effect | taken | turned round | confirmed | strictly |", "|---|---|---|---|---|"]
    for effect, rows in by_effect.items():
        judged = [row for row in rows if row["confirmed"] is not None]
        taken, held, strict = (
            sum(row[key] for row in some)
            for some, key in ((rows, "taken"), (judged, "confirmed"), (judged, "strict"))
        )
        out.append(
            f"| {effect} | {taken} of {len(rows)} | {len(judged)} of {len(rows)} | "
            f"{held} of {len(judged)} | {strict} of {len(judged)} |"
        )
    return out if by_effect else ["No decision was turned round."]


def refuted_list(lines):
    """What was refuted by effect, the cases where turning it round gains most first."""
    by_effect = {}
    for case, line in sorted(lines.items()):
        for row in line.get("rows", []):
            if row["confirmed"] is False:
                found = (row["error"] - line["error"], f"{case} ({row['why']})")
                by_effect.setdefault(row["effect"], []).append(found)
    out = []
    for effect, cases in by_effect.items():
        shown = [text for _, text in sorted(cases)[:SHOWN]]
        more = f"; and {len(cases) - len(shown)} more" if len(cases) > len(shown) else ""
        out.append(f"- `{effect}`, {len(cases)}: {'; '.join(shown)}{more}")
    return out or ["None."]


def elsewhere(runs):
    """Cases that miss the goal of the error on the other machines, and are within it on the first.

    What the first one misses too is in the table of cases.
    """
    (_, first), *others = runs.items()
    out = []
    for name, lines in others:
        missed = [
            f"{case} ({what(line)}: {why_missed(line)})"
            for case, line in sorted(lines.items())
            if not is_near(line) and (case not in first or is_near(first[case]))
        ]
        out.append(f"- {name}: {'; '.join(missed) or 'none'}")
    return out or ["- no other machine"]


def missing_list(lines, failed, folder):
    """Cases without a line, and why."""
    out = [f"- {case}: failed, {reason}" for case, reason in sorted(failed.items())]
    for name, make in scenes(folder):
        absent = [c for c, _, _ in case_names(name, make()) if c not in lines and c not in failed]
        out += [f"- {case}: not run" for case in absent]
    if not folder:
        out.append("- the real scenes were not at hand to list their cases (CSM_SCENES)")
    return out or ["None: every camera under every sun of every scene is in the table."]


def blocks(runs, folder):
    """Lines of text by the name of their block."""
    good = {
        name: {case: line for case, line in lines.items() if "failed" not in line}
        for name, lines in runs.items()
    }
    good = {name: lines for name, lines in good.items() if lines}
    if not good:
        sys.exit("no case in these files")
    name, first = next(iter(good.items()))
    failed = {case: line["failed"] for case, line in runs[name].items() if "failed" in line}
    return {
        "cases": cases_table(first),
        "goals": goals_table(good),
        "effects": effects_table(first),
        "refuted": refuted_list(first),
        "elsewhere": elsewhere(good),
        "missing": missing_list(first, failed, folder),
    }


def replaced(text, name, lines):
    """Text with the block of a name filled anew."""
    first, last = (mark.format(name) for mark in MARKS)
    pattern = re.compile(re.escape(first) + r".*?" + re.escape(last), re.DOTALL)
    if not pattern.search(text):
        sys.exit(f"no place for {name} in the docs: {first} … {last}")
    body = "\n".join([first, "", *lines, "", last])
    return pattern.sub(lambda _: body, text)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("files", type=Path, nargs="+", metavar="FILE")
    options.add_argument("--scenes", default=os.environ.get("CSM_SCENES"), metavar="DIR")
    options.add_argument("--docs", type=Path, default=DOCS, metavar="FILE")
    options.add_argument("--print", action="store_true", dest="shown")
    arguments = options.parse_args()
    absent = [str(path) for path in arguments.files if not path.exists()]
    if absent:
        options.error(f"no file {', '.join(absent)}")
    found = blocks(gathered(arguments.files), arguments.scenes)
    if arguments.shown:
        for name, lines in found.items():
            print(f"## {name}\n\n" + "\n".join(lines) + "\n")
        return
    text = arguments.docs.read_text(encoding="utf-8")
    for name, lines in found.items():
        text = replaced(text, name, lines)
    arguments.docs.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
