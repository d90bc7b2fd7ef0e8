"""A table of settings in which every pair of values that can matter together does so in some row.

A value matters in a row if the canonical form keeps it; a default, if another value of the same
setting would be kept in its place. Rows are made greedily: each starts from a pair that no row has
yet, with what both need, and takes for every other setting the value that adds the most pairs.
"""

import functools
import itertools
from types import SimpleNamespace

import numpy as np

import csm
from csm import _core

TABLE = {row["name"]: row for row in _core.effect_table() if row["name"]}
NUMBERS = {  # that turn an effect on, or code with it
    "normal_offset_texels": (0.0, 1.0),
    "constant_bias_texels": (0.0, 1.0),
    "fade_width": (0.0, 0.5),
    "bleed_step": (0.0, 0.2),
}
# No settings, but effects; in the order of their costs.
OUTSIDE = {
    "instanced": (False, True),
    "cut_out": (False, True),
    "stage": ("fragment", "compute"),
}
WHOLE = {
    "cascade_count": (2, 1, 3),
    "filter_size": (3, 1, 2, 7),
    "level_count": (64, 2),
    "level_hysteresis": (0, 2),
    "tile_border": (0, 3),
    "tap_count": (16, 5),
    "anisotropy": (8, 2),
    "samples": (1, 2, 4),
    "layer_count": (4, 2),
    "fourier_terms": (4, 2),
}
SIZES = {True: 96, False: (96, 89, 80)}  # of maps, equal or not; wider than any kernel
EQUAL = "equal sizes"

BLURRED = ("vsm", "evsm2", "evsm4", "esm", "msm", "lvsm", "fourier")
DISCS = ("poisson", "pcss")
LEAKING = ("vsm", "evsm2", "evsm4", "msm", "lvsm", "savsm")
TAPPED = ("hard", "pcf", *DISCS)


def _filters(*names, **more):
    return [{"filter": name, **more} for name in names]


# What must be set besides, so that a setting, or one value of it, matters: any of these.
NEEDS = {
    "filter_size": _filters("pcf", *DISCS, "savsm", *BLURRED),
    "filter_weights": _filters("pcf", *BLURRED),
    "filter_fetch": _filters("pcf"),
    "kernel": _filters("pcf", "poisson", "savsm", *BLURRED),
    "disc": _filters(*DISCS),
    "tap_count": _filters(*DISCS),
    "rotated": _filters(*DISCS),
    "pcss_map": _filters("pcss"),
    "moment_format": _filters(*BLURRED),
    "lookup": _filters(*BLURRED),
    "anisotropy": _filters(*BLURRED, lookup="anisotropic"),
    "gradients": _filters(*BLURRED, lookup="trilinear") + _filters(*BLURRED, lookup="anisotropic"),
    "samples": _filters(*BLURRED, "savsm")
    + _filters("pcss", pcss_map="variance")
    + _filters("pcss", pcss_map="summed"),
    "log_filter": _filters("esm"),
    "msm_bound": _filters("msm"),
    "layer_count": _filters("lvsm"),
    "fourier_terms": _filters("fourier"),
    "bleed_step": _filters(*LEAKING),
    "turned": [{"fit": "visible"}],
    "level_spacing": [{"snap": "approximate"}],
    "level_count": [{"snap": "approximate"}],
    "level_hysteresis": [{"snap": "approximate"}],
    "tile_border": [{"storage": "atlas"}],
    "copied_tiles": [{"storage": "atlas"}],
    "receiver_plane": _filters(*TAPPED, bias="manual"),
    "plane": _filters(*TAPPED) + _filters(*TAPPED, bias="manual", receiver_plane=True),
    "bias_side": [{"bias": "manual", "constant_bias_texels": 1.0}],
    "constant_bias_texels": [{"bias": "manual"}],
    "normal_offset_texels": [{"bias": "manual"}],
    ("select", "frustum"): _filters("pcf", *DISCS, "savsm", *BLURRED),
}


def values_of(name):
    """Values of a factor, the default first: what is not told apart stays at it."""
    if name in WHOLE:
        return WHOLE[name]
    if name in NUMBERS:
        return NUMBERS[name]
    if name in OUTSIDE:
        return OUTSIDE[name]
    if name == EQUAL:
        return (True, False)
    row = TABLE[name]
    choices = row["choices"].split() if row["type"] == "enum" else (False, True)
    assert row["type"] != "int", f"{name} must have a few values in pairwise.WHOLE"
    default = row["default"]
    return (default, *(value for value in choices if value != default))


# What others depend on comes first.
FIRST = (
    "filter",
    "cascade_count",
    "bias",
    "lookup",
    "storage",
    "snap",
    "fit",
    "constant_bias_texels",
)
FACTORS = [*FIRST, *(name for name in (*TABLE, *NUMBERS, *OUTSIDE, EQUAL) if name not in FIRST)]
LEVELS = [(name, value) for name in FACTORS for value in values_of(name)]
NUMBER = {level: i for i, level in enumerate(LEVELS)}
DEFAULTS = {name: values_of(name)[0] for name in FACTORS}
FIELDS = csm.ShadowSettings().to_dict()


def changes_of(row):
    """Settings of a row as keywords of ShadowSettings."""
    changes = {name: row[name] for name in (*TABLE, *NUMBERS)}
    count = row["cascade_count"]
    sizes = SIZES[row[EQUAL]]
    changes["map_size"] = sizes if row[EQUAL] else sizes[:count]
    if row["split"] in ("manual", "percentages"):
        changes["manual_splits"] = (3.0, 9.0)[: count - 1]
    if row["depth_range"] == "manual":
        changes["manual_depth_range"] = (-50.0, 50.0)
    return changes


def canonical(row):
    """Canonical settings of a row as a dict, or None if they are not valid."""
    changes = changes_of(row)
    sizes = changes["map_size"]
    if row[EQUAL]:
        changes["map_size"] = (sizes,) * row["cascade_count"]
    try:
        return _core.canonical_settings(SimpleNamespace(**{**FIELDS, **changes}))
    except ValueError:
        return None


def _kept(row, found, name):
    if name in OUTSIDE:
        return True
    if name == EQUAL:
        return row["cascade_count"] > 1 and row["filter"] != "none"
    return found[name] == row[name]


def _matters(row, found, name):
    """Whether the value that a valid row has of a factor makes a difference."""
    if not _kept(row, found, name):
        return False
    if row[name] != DEFAULTS[name] or name in OUTSIDE or name == EQUAL:
        return True
    for other in values_of(name)[1:]:
        changed = {**row, name: other}
        found_there = canonical(changed)
        if found_there and _kept(changed, found_there, name):
            return True
    return False


def mattering(row):
    """Numbers of the levels that make a difference in a row; empty if it is not valid."""
    found = canonical(row)
    if found is None:
        return []
    return [NUMBER[name, row[name]] for name in FACTORS if _matters(row, found, name)]


def _needs(level):
    return NEEDS.get(level) or NEEDS.get(level[0]) or [{}]


def _seed(first, second):
    """Fewest changes of the defaults under which both levels matter, or None."""
    pair = dict((first, second))
    for one, other in itertools.product(_needs(first), _needs(second)):
        changes = {**one, **other}
        if any(one[name] != other[name] for name in one.keys() & other.keys()):
            continue
        if any(changes[name] != pair[name] for name in changes.keys() & pair.keys()):
            continue
        changes.update(pair)
        row = {**DEFAULTS, **changes}
        found = canonical(row)
        if found and all(_matters(row, found, name) for name in pair):
            return changes
    return None


def _extended(changes, uncovered):
    """The row that a seed grows to."""
    row = {**DEFAULTS, **changes}
    found = canonical(row)
    set_, numbers = set(changes), [NUMBER[level] for level in changes.items()]
    numbers = [i for i in numbers if _matters(row, found, LEVELS[i][0])]
    for name in FACTORS:
        if name in set_:
            continue
        best, gain, best_found = row[name], 0, found
        sibling = False  # whether any value but the default is kept
        for value in (*values_of(name)[1:], values_of(name)[0]):
            wins = int(uncovered[NUMBER[name, value], numbers].sum())
            if wins <= gain and (sibling or value != DEFAULTS[name]):
                continue
            trial = {**row, name: value}
            trial_found = canonical(trial)
            if trial_found is None or not _kept(trial, trial_found, name):
                continue
            if any(not _kept(trial, trial_found, LEVELS[i][0]) for i in numbers):
                continue
            if value != DEFAULTS[name]:
                sibling = True
            elif not sibling:
                continue
            if wins > gain:
                best, gain, best_found = value, wins, trial_found
        row[name], found = best, best_found
        if gain:
            numbers.append(NUMBER[name, best])
    return row


@functools.cache
def table():
    """Rows, and a square array of the pairs of levels that can matter together."""
    count = len(LEVELS)
    possible = np.zeros((count, count), bool)
    seeds = {}
    for a, b in itertools.combinations(range(count), 2):
        if LEVELS[a][0] != LEVELS[b][0]:
            seed = _seed(LEVELS[a], LEVELS[b])
            if seed is not None:
                seeds[a, b] = seed
                possible[a, b] = possible[b, a] = True
    uncovered, rows = possible.copy(), []
    # the pairs with the most needs first: others fit in beside them
    for a, b in sorted(seeds, key=lambda pair: -len(seeds[pair])):
        if uncovered[a, b]:
            row = _extended(seeds[a, b], uncovered)
            there = mattering(row)
            if a not in there or b not in there:  # what was added took their meaning
                row = {**DEFAULTS, **seeds[a, b]}
                there = mattering(row)
            rows.append(row)
            uncovered[np.ix_(there, there)] = False
    return rows, possible


def text(row):
    """What a row has besides the defaults."""
    return ", ".join(f"{name}={row[name]}" for name in FACTORS if row[name] != DEFAULTS[name])
