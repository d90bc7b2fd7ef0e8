"""The points of a sweep: every combination of the axes' values on top of the base settings."""

import itertools
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields

from .settings import ShadowSettings

__all__ = ["Axis", "Point", "axes_of", "points_of", "setting_text", "settings_from_text"]

SETTINGS = {field.name: field for field in fields(ShadowSettings)}
RESERVED = ("case",)


@dataclass(frozen=True)
class Axis:
    """One axis: labels in their order, and the settings that each of them changes."""

    name: str
    labels: tuple
    changes: tuple[dict, ...]


@dataclass(frozen=True)
class Point:
    """One combination: where it lies on the axes, and its settings or why there are none.

    Attributes
    ----------
    index : tuple of int
        Along each axis.
    wanted : dict
        Every setting as it was asked for, valid or not.
    settings : ShadowSettings or None
    message : str
        Why the settings are refused, else "".
    """

    index: tuple[int, ...]
    wanted: dict = field(repr=False)
    settings: ShadowSettings | None
    message: str = ""


def axes_of(axes):
    """Check the axes of a sweep.

    Parameters
    ----------
    axes : mapping
        Of a setting to its values, ``{"map_size": [512, 1024]}``; or of any other name to labels
        and the settings they stand for, ``{"technique": {"sharp": {"filter": "hard"}, "soft":
        {"filter": "pcf", "filter_size": 5}}}``.

    Returns
    -------
    axes : tuple of Axis

    Raises
    ------
    TypeError, ValueError
        If a name is no setting, an axis is empty or repeats itself, or two change one setting.
    """
    if not isinstance(axes, Mapping):
        raise TypeError(f"axes must be a mapping of settings to values (got {axes!r})")
    checked, owners = [], {}
    for name, values in axes.items():
        if not isinstance(name, str) or not name or name in RESERVED:
            raise ValueError(f"axes: an axis may not be called {name!r}")
        axis = _labelled(name, values) if isinstance(values, Mapping) else _plain(name, values)
        if not axis.labels:
            raise ValueError(f"axes: {name} must have at least one value (got none)")
        if len(set(axis.labels)) != len(axis.labels):
            raise ValueError(f"axes: {name} has a value twice (got {list(axis.labels)})")
        for setting in {setting for changes in axis.changes for setting in changes}:
            if setting not in SETTINGS:
                raise ValueError(
                    f"axes: {setting!r} is no setting; there are {', '.join(sorted(SETTINGS))}"
                )
            if owners.setdefault(setting, name) != name:
                raise ValueError(f"axes: both {owners[setting]} and {name} change {setting}")
        checked.append(axis)
    return tuple(checked)


def _labelled(name, values):
    if name in SETTINGS:
        raise ValueError(
            f"axes: {name} is a setting, so its values must be a list "
            "(an axis of labels needs a name of its own)"
        )
    for label, changes in values.items():
        if not isinstance(label, str) or not isinstance(changes, Mapping):
            raise TypeError(
                f"axes: {name} must map labels to settings (got {label!r}: {changes!r})"
            )
    return Axis(name, tuple(values), tuple(dict(changes) for changes in values.values()))


def _plain(name, values):
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable):
        raise TypeError(f"axes: {name} must be a list of values (got {values!r})")
    values = [_native(value) for value in values]
    labels = tuple(_label(value) for value in values)
    kinds = {float if type(label) is int else type(label) for label in labels}
    if len(kinds) > 1:  # an axis holds one kind: all become texts
        labels = tuple(map(str, labels))
    return Axis(name, labels, tuple({name: value} for value in values))


def _native(value):
    """Return a value as plain Python has it: no numpy scalars and arrays, no lists."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    return tuple(_native(item) for item in value) if isinstance(value, (list, tuple)) else value


def _label(value):
    """Return what stands on the axis: a number, a bool or a text."""
    if isinstance(value, (bool, int, float, str)):
        return value
    return ",".join(map(str, value)) if isinstance(value, tuple) else repr(value)


def points_of(base, axes):
    """Every combination of the axes, in the order of a nested loop over them.

    Parameters
    ----------
    base : ShadowSettings
    axes : sequence of Axis

    Returns
    -------
    points : list of Point
    """
    points = []
    for index in itertools.product(*(range(len(axis.labels)) for axis in axes)):
        changes = {}
        for axis, number in zip(axes, index, strict=True):
            changes |= axis.changes[number]
        try:
            settings = base.replace(**changes)
            points.append(Point(index, settings.to_dict(), settings))
        except (TypeError, ValueError) as error:
            wanted = base.to_dict() | {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in changes.items()
            }
            points.append(Point(index, wanted, None, str(error)))
    return points


def setting_text(value):
    """Text of a setting in a table: words as they are, the rest as JSON."""
    return value if isinstance(value, str) else json.dumps(value)


def settings_from_text(row):
    """Read the settings of a table's row.

    Parameters
    ----------
    row : mapping of str to str
        With a column for every setting, from `setting_text`.

    Returns
    -------
    settings : ShadowSettings

    Raises
    ------
    ValueError
        If a column is missing or its text is no value of the setting.
    """
    values = {}
    for name, setting in SETTINGS.items():
        if name not in row:
            raise ValueError(f"the table has no column {name!r}: another version of csm wrote it")
        try:
            values[name] = row[name] if setting.type is str else json.loads(row[name])
        except ValueError:
            raise ValueError(f"{name} must be JSON (got {row[name]!r})") from None
    return ShadowSettings(**values)
