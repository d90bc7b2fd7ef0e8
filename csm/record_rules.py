"""What a file of a recommendation must agree on with itself.

A file that a person edits may say one thing in its settings and another in what was derived from
them; such a file is refused, key by key, so that nothing is told of settings that it is not about.
"""

import itertools
import math

from .decisions import TABLE, value_of
from .plans import map_bytes
from .situations import Situation

__all__ = ["GOAL_RANGES", "check_agreement"]

#: Least and most of each goal.
GOAL_RANGES = {"max_error": (0.0, 1.0), "budget_ms": (1e-6, 1e9), "max_bytes": (1.0, 1e15)}
SHARES = (
    *("seen_share", "facing_share", "shadowed_share", "depth_shares", "cascade_shares"),
    *("thin_share", "layered_share", "front_matters", "faces_matter", "bias_matters", "lit_area"),
)
NOT_NEGATIVE = (
    *("casters", "layers", "needless_chunks", "scene_triangles", "edge_share", "penumbra_pixels"),
    *("penumbra_metres", "depth_span", "origin_distance"),
)
#: Of what is expected of the settings, the goal that bounds it.
GOAL_OF = {"expected_error": "max_error", "expected_ms": "budget_ms", "map_bytes": "max_bytes"}
ROUNDING = 1e-9  # beyond 1 that a share may be by its sums
ROWS = {row.effect: row for row in TABLE}


def check_agreement(found):
    """Refuse parts of a recommendation that contradict each other, or what can be at all.

    Parameters
    ----------
    found : dict
        Arguments of `Recommendation`, each of its own kind already.

    Raises
    ------
    ValueError
        Naming the key, its value and what is allowed.
    """
    (first, *_), _ = found["path"]
    _check_windows(found["settings"], found["splits"], found["texels"], first)
    expected = map_bytes(found["settings"])
    if found["map_bytes"] != expected:
        raise ValueError(
            f"map_bytes must be {expected}, that of its settings (got {found['map_bytes']})"
        )
    for name in ("expected_error", "expected_ms"):
        _check_range(name, found[name], 0.0, math.inf)
    for name, (low, high) in GOAL_RANGES.items():
        if found["goal"][name] is not None:
            _check_range(f"goal.{name}", found["goal"][name], low, high)
    if found["met"] != (found["obstacle"] is None) or found["obstacle"] == "":
        raise ValueError(
            "obstacle must say what is in the way where met is false, and be left out where it is "
            f"true (got met {found['met']}, obstacle {found['obstacle']!r})"
        )
    for name, limit in GOAL_OF.items():
        most = found["goal"][limit]
        if found["met"] and most is not None and found[name] > most:
            raise ValueError(
                f"met must be false where {name} exceeds goal.{limit} "
                f"(got {found[name]} and {most})"
            )
    _check_signals(found["signals"])
    _check_reasons(found["reasons"], Situation(found["signals"], None, found["settings"]))


def _check_windows(settings, splits, texels, camera):
    """One slice and one texel a cascade, in what the camera sees; none without maps."""
    if settings.filter == "none":
        for name, given in (("splits", splits), ("texels", texels)):
            if len(given):
                raise ValueError(
                    f"{name} must be empty, as settings.filter is 'none': there are no maps "
                    f"(got {list(given)})"
                )
        return
    count = settings.cascade_count
    ascending = all(math.isfinite(one) for one in splits) and all(
        near < far for near, far in itertools.pairwise(splits)
    )
    if len(splits) != count + 1 or not ascending:
        raise ValueError(
            f"splits must be {count + 1} ascending view depths [m], as settings.cascade_count is "
            f"{count} (got {list(splits)})"
        )
    if not camera.near <= splits[0] < splits[-1] <= camera.far:
        raise ValueError(
            f"splits must lie between the first camera's near {camera.near:g} and far "
            f"{camera.far:g} (got {list(splits)})"
        )
    good = all(math.isfinite(one) and one >= 0.0 for one in texels)
    if len(texels) != count or not good:
        raise ValueError(
            f"texels must be {count} {'length' if count == 1 else 'lengths'} [m], as "
            f"settings.cascade_count is {count} (got {list(texels)})"
        )


def _check_range(name, value, low, high):
    if not low <= value <= high or math.isinf(value):
        most = "" if math.isinf(high) else f" and at most {high:g}"
        raise ValueError(f"{name} must be at least {low:g}{most} (got {value:g})")


def _check_signals(signals):
    for names, high in ((SHARES, 1.0 + ROUNDING), (NOT_NEGATIVE, math.inf)):
        for name in names:
            value = getattr(signals, name)
            for one in value if hasattr(value, "__len__") else (value,):
                if not 0.0 <= one <= high:
                    rule = "0 to 1" if high < math.inf else "at least 0"
                    raise ValueError(f"signals.{name} must be {rule} (got {one:g})")


def _check_reasons(reasons, at):
    """Every reason is about another effect, and gives what the settings have of it."""
    if not reasons:
        raise ValueError(f"reasons must not be empty: there are {', '.join(ROWS)}")
    seen = set()
    for number, reason in enumerate(reasons):
        where = f"reasons[{number}]"
        if reason.effect not in ROWS:
            raise ValueError(
                f"{where}: effect must be one of {', '.join(ROWS)} (got {reason.effect!r})"
            )
        if reason.effect in seen:
            raise ValueError(f"{where}: effect {reason.effect!r} is there twice")
        seen.add(reason.effect)
        value, taken = value_of(reason.effect, at.settings), bool(ROWS[reason.effect].taken(at))
        if reason.value != value:
            raise ValueError(
                f"{where}: value of {reason.effect!r} must be {value!r}, as in settings "
                f"(got {reason.value!r})"
            )
        if reason.taken != taken:
            raise ValueError(
                f"{where}: taken of {reason.effect!r} must be {taken}, as in settings "
                f"(got {reason.taken})"
            )
