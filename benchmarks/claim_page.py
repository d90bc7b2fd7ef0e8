"""docs/claims.md: the claims, their verdicts and the numbers, from what was measured."""

from statistics import median

from claim_verdicts import Case, condition, judge

HEAD = """\
# Claims of the sources, tested

Written by `python benchmarks/claims.py --from docs/claims_measured*.json --markdown docs/claims.md`
from what that script measured; do not edit.

What articles and books on cascaded shadow maps say, measured with `csm` on scenes made by code and
on real ones. A claim is **reproduced** if it holds under every condition it was tried under; it
**depends on** the condition that is named if it holds under some; it is **not reproduced** if it
holds under none and fails under some, **undecided** if it differs from case to case under all.

- A case is one number: mostly the error (mean absolute, against ray tracing) or the time of one
  choice over that of the other, on one view of one scene. Cases are grouped by condition.
- A group **holds** where its mean, and all of the 95 % bootstrap interval of the mean, lie within
  what the claim states; it **fails** where all of that lies outside; anything else, or fewer than
  six cases, is **open**. Means of ratios are geometric. For claims about a range the share of the
  cases that lie in it decides: four fifths hold, one fifth fails. Cases share scenes, so that an
  interval speaks of these scenes and not of all there are.
- Thresholds were written down before the run that is shown. The conditions of four claims were
  refined, and the measure of seams was replaced, after trial runs on the same scenes: they say so.
- Errors are those of pixels that face the sun, {size[0]} x {size[1]} (light bleeding 320 x 180).
  Times are medians of frames of 1280 x 720 in turns, and are the driver's: software on a CPU is not
  a GPU. Another machine gets a column of its own by
  `python benchmarks/claims.py --json docs/claims_measured_NAME.json --label NAME`.

"""
MEASURED_BY = """\
| | {names} |
|---|{lines}
| driver | {drivers} |
| machine | {machines} |
| load average, first and last minute | {loads} |
| clock of passes | {clocks} |
| commit | {commits} |
| scenes | {scenes} |
| command | {commands} |

"""
MEDIANS = """\
Medians of the cases' other numbers (of lists place by place; times in ms with their quartiles):
"""


def number(value):
    """Three digits."""
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def cell(text):
    """Text that does not end a cell of a table."""
    return str(text).replace("|", "\\|").replace("\n", " ")


def cases_of(measured, claim):
    """Cases of a claim in what was measured; None if it was left out."""
    found = measured["claims"].get(claim.id)
    return None if found is None else [Case(**case) for case in found]


def verdict_of(measured, claim):
    """Verdict of a claim in what was measured; None if it was left out."""
    cases = cases_of(measured, claim)
    return None if cases is None else judge(cases, claim.rule)


def brief(group):
    """A group's mean with its interval, or the span of its cases."""
    low, high = group.interval
    return f"{number(group.mean)} [{number(low)}, {number(high)}]"


def span(verdict):
    """Means of a verdict's groups, from the least to the largest."""
    ends = [number(f(group.mean for group in verdict.groups)) for f in (min, max)]
    return " to ".join(dict.fromkeys(ends))


def each(claim, files, text_of):
    """A text of each machine's verdict; under its name where a claim about time has several."""
    found = []
    for measured in files:
        verdict = verdict_of(measured, claim)
        if verdict is not None and text_of(verdict):
            name = f"{measured['label']}: " if claim.timed and len(files) > 1 else ""
            found.append(name + text_of(verdict))
    return cell("; ".join(found if claim.timed else found[:1]))


def overview(claims, files):
    """One line a claim."""
    names = [measured["label"] for measured in files]
    if len(files) == 1:
        names.append("a GPU")
    lines = [
        f"| claim | source | {' | '.join(names)} | means of the conditions | condition |",
        "|---|---|" + "---|" * (len(names) + 2),
    ]
    for claim in claims:
        verdicts = [verdict_of(measured, claim) for measured in files]
        said = [f"**{verdict.text}**" if verdict else "not measured" for verdict in verdicts]
        if len(files) == 1:
            said.append("not measured" if claim.timed else "")
        numbers = f"{claim.value}: {each(claim, files, span)}"
        lines.append(
            f"| [{claim.title}](#{claim.id}) | {claim.source} | {' | '.join(said)} | {numbers} | "
            f"{each(claim, files, condition)} |"
        )
    return "\n".join(lines) + "\n"


def groups_table(claim, measured):
    """What each condition gave on one machine."""
    verdict = verdict_of(measured, claim)
    if verdict is None:
        return f"{measured['label']}: not measured.\n"
    rows = [
        f"{measured['label']}: **{verdict.text}**",
        "",
        f"| condition | cases | {claim.value} | lowest | highest | |",
        "|---|---|---|---|---|---|",
    ]
    for group in verdict.groups:
        ends = [f"{number(one.value)} ({one.name})" for one in (group.lowest, group.highest)]
        shares = f", {group.share:.0%} in the range" if claim.rule.kind == "range" else ""
        rows.append(
            f"| {cell(group.name)} | {group.count} | {brief(group)}{shares} | {cell(ends[0])} | "
            f"{cell(ends[1])} | {group.status} |"
        )
    return "\n".join(rows) + "\n"


def plain(value):
    """Numbers of any shape as text."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {plain(one)}" for name, one in value.items())
    if isinstance(value, list):
        return " / ".join(plain(one) for one in value)
    return "none" if value is None else number(value)


def middle(values):
    """Median of numbers, of lists or of dicts of them place by place; None where all are None."""
    first = values[0]
    if isinstance(first, dict):
        return {name: middle([one[name] for one in values]) for name in first}
    if isinstance(first, list):
        return [middle(list(ones)) for ones in zip(*values, strict=True)]
    known = [value for value in values if value is not None]
    return median(known) if known else None


def details(claim, measured):
    """Medians of what else the cases of each condition have."""
    lines = []
    cases = cases_of(measured, claim) or ()
    for group in dict.fromkeys(case.group for case in cases):
        numbers = [case.numbers for case in cases if case.group == group]
        shown = "; ".join(
            f"{name}: {plain(middle([one[name] for one in numbers]))}" for name in numbers[0]
        )
        lines.append(f"- {group}. {shown}")
    return "\n".join(lines) + "\n"


def section(claim, files):
    """All about one claim."""
    shown = files if claim.timed else [one for one in files if claim.id in one["claims"]][:1]
    tables = "\n".join(
        f"{groups_table(claim, measured)}\n{MEDIANS}\n{details(claim, measured)}"
        for measured in shown or files[:1]
    )
    return (
        f'\n<a id="{claim.id}"></a>\n\n## {claim.title}\n\n'
        f"*Source:* {claim.source}: {claim.says}\n\n"
        f"*Measured:* {claim.measured}\n\n"
        f"*The claim states* of that number: {claim.states}.\n\n"
        f"{tables}\n{claim.why}\n"
    )


def page(claims, files):
    """The page, from the table of claims and what one machine or several measured."""
    facts = [one["machine"] for one in files]
    head = HEAD.format(size=files[0]["size"])
    by = MEASURED_BY.format(
        names=" | ".join(one["label"] for one in files),
        lines="---|" * len(files),
        **{
            f"{name}s": " | ".join(cell(fact[name]) for fact in facts)
            for name in ("driver", "machine", "load", "clock", "commit", "command")
        },
        scenes=" | ".join(cell(", ".join(one["scenes"])) for one in files),
    )
    parts = [head, by, overview(claims, files), *(section(claim, files) for claim in claims)]
    return "".join(parts)
