"""How a claim gets its verdict: from the cases measured, by a rule that was fixed before.

A case is one number, the *value*, with the *group* it belongs to: the condition under which it was
measured. A rule says which values the claim states. The verdict follows from the groups:

- **reproduced**: it holds in every group;
- **depends on**: it holds in some; the condition is in which groups it holds and in which not;
- **not reproduced**: it holds in none, and fails in some or all;
- **undecided**: it neither holds nor fails in any.

In a group the mean of the values (of their logarithms, if they are ratios) has a 95 % bootstrap
interval over the cases. The claim *holds* there if the whole interval lies within what it states,
*fails* if all of it lies outside, and is *open* if it straddles the bound or there are fewer than
six cases, of which chance alone makes an interval. Of a claim about a range ("2.8 to 4.0 times") it
is asked of every case: it holds if four fifths of them lie within, and fails if no more than one
fifth does.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from csm.fronts import FEWEST_CASES

REPRODUCED, NOT_REPRODUCED = "reproduced", "not reproduced"
DEPENDS, UNDECIDED = "depends on", "undecided"
HOLDS, FAILS, OPEN = "holds", "fails", "open"
LEAST_CASES = FEWEST_CASES
RESAMPLES = 4000
SHARE = 0.8  # of the cases of a group, for claims about a range


@dataclass(frozen=True)
class Case:
    """One measured case of a claim."""

    name: str
    group: str
    value: float
    numbers: dict = field(default_factory=dict)  # what else was measured, for people


@dataclass(frozen=True)
class Rule:
    """Values that the claim states: from low to high.

    kind: "ratio" and "difference" are judged by the mean of a group, of logarithms or of the values
    themselves, "range" by the share of its cases.
    """

    low: float
    high: float
    kind: str = "ratio"

    def holds_for(self, value):
        """Whether a value is what the claim states."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Group:
    """What the cases of one condition say."""

    name: str
    status: str
    count: int
    mean: float  # geometric, of ratios
    interval: tuple  # 95 % of its bootstrap
    share: float  # of the cases that lie within what the claim states
    lowest: Case
    highest: Case


@dataclass(frozen=True)
class Verdict:
    """What became of a claim."""

    text: str
    groups: tuple

    def those(self, status):
        """Names of the groups of a status."""
        return [group.name for group in self.groups if group.status == status]


def bootstrap(values):
    """(mean, low, high): the mean and its 95 % bootstrap interval; the same ones every time."""
    values = np.asarray(values, float)
    picks = np.random.default_rng(1).integers(0, len(values), (RESAMPLES, len(values)))
    low, high = np.percentile(values[picks].mean(axis=1), (2.5, 97.5))
    return float(values.mean()), float(low), float(high)


def judge_group(name, cases, rule):
    """Judge the cases of one condition."""
    values = [case.value for case in cases]
    mapped = np.log(values) if rule.kind == "ratio" else np.asarray(values)
    back = math.exp if rule.kind == "ratio" else float
    mean, low, high = (back(one) for one in bootstrap(mapped))
    share = sum(rule.holds_for(value) for value in values) / len(values)
    if len(values) < LEAST_CASES:
        status = OPEN
    elif rule.kind == "range":
        status = HOLDS if share >= SHARE else FAILS if share <= 1.0 - SHARE + 1e-9 else OPEN
    elif rule.low <= low and high <= rule.high:
        status = HOLDS
    else:
        status = FAILS if high < rule.low or low > rule.high else OPEN
    ordered = sorted(cases, key=lambda case: case.value)
    return Group(name, status, len(cases), mean, (low, high), share, ordered[0], ordered[-1])


def judge(cases, rule):
    """Verdict of a claim; groups in the order in which they come.

    Values that are not finite, and ratios that are not positive, are refused: a measure that fails
    must say so, not vanish.
    """
    if not cases:
        raise ValueError("no case was measured: a verdict needs some")
    for case in cases:
        sound = math.isfinite(case.value) and (rule.kind != "ratio" or case.value > 0.0)
        if not sound:
            raise ValueError(f"case {case.name} ({case.group}) has no value ({case.value})")
    names = dict.fromkeys(case.group for case in cases)
    groups = tuple(judge_group(n, [c for c in cases if c.group == n], rule) for n in names)
    statuses = {group.status for group in groups}
    if HOLDS in statuses:
        return Verdict(REPRODUCED if statuses == {HOLDS} else DEPENDS, groups)
    return Verdict(NOT_REPRODUCED if FAILS in statuses else UNDECIDED, groups)


def condition(verdict):
    """In which groups a claim holds and in which not; "" where it is one and the same in all."""
    if len({group.status for group in verdict.groups}) < 2:
        return ""
    few = [group.name for group in verdict.groups if group.count < LEAST_CASES]
    said = {
        "holds": verdict.those(HOLDS),
        "fails": verdict.those(FAILS),
        "differs from case to case": [name for name in verdict.those(OPEN) if name not in few],
        "too few cases to tell": few,
    }
    parts = [f"{words}: {'; '.join(names)}" for words, names in said.items() if names]
    return ". ".join(part[0].upper() + part[1:] for part in parts)
