"""Settings that are considered, and what is forecast of them."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .forecasts import Expected, Missed
from .plans import map_bytes
from .settings import ShadowSettings, changed, map_texels
from .situations import Situation, is_default_split, wanted_format

__all__ = ["Candidate", "Family", "cheapest", "finest"]


@dataclass(frozen=True)
class Candidate:
    """An arrangement of windows with maps of some sizes, and what is forecast of it.

    Attributes
    ----------
    arranged : ShadowSettings
        All but the size of the maps and what hangs on it.
    map_size : int or tuple of int
    error, ms : float
    changes : dict
        Size, and what hangs on it.
    expected : Expected
        The error in its parts.
    """

    arranged: ShadowSettings = field(repr=False)
    map_size: int | tuple[int, ...]
    error: float
    ms: float
    changes: dict = field(default_factory=dict, repr=False)
    expected: Expected = field(default=None, repr=False)

    @cached_property
    def settings(self):
        """The whole of them; made when they are asked for, since most never are."""
        return self.arranged.replace(**self.changes)

    @property
    def texels(self):
        """Of all maps."""
        return map_texels(self.settings)


@dataclass(frozen=True, eq=False)
class Family:
    """Candidates of one arrangement and filter, one a size.

    Attributes
    ----------
    at : Situation
        What rows are asked about the arrangement.
    sizes : (k,) or (k, n) int
        Of all maps, or of each.
    missed : Missed
        Of as many values, or of one for all.
    kernels : list of int, optional
        Of soft shadows [texels].
    """

    at: Situation
    sizes: np.ndarray
    missed: Missed
    kernels: list[int] | None = None

    @property
    def arranged(self):
        """All settings but the size of the maps and what hangs on it."""
        return self.at.settings

    @cached_property
    def changes(self):
        """Lists of as many values: sizes, and what hangs on them; most are never asked for."""
        sides = self.sizes.tolist()
        changes = {"map_size": [tuple(one) for one in sides] if self.sizes.ndim == 2 else sides}
        if self.kernels is not None:
            changes["filter_size"] = self.kernels
        if self.arranged.filter != "none":
            changes["depth_format"] = wanted_format(self.at, self.sizes, self.kernels)
        return changes

    @property
    def texels(self):
        """Of all maps (k,)."""
        squares = np.square(self.sizes.astype(float))
        if squares.ndim == 1:
            return squares * self.arranged.cascade_count
        return squares.sum(axis=1)

    @property
    def map_bytes(self):
        """Of all maps (k,); those of one format go with texels, but for what an atlas leaves."""
        rows = range(len(self.sizes))
        if self.sizes.ndim == 2:
            return np.array([self._bytes_of(row) for row in rows])
        formats = self.changes.get("depth_format", len(rows) * [None])
        texels = self.texels
        firsts = {name: formats.index(name) for name in set(formats)}
        a_texel = {name: self._bytes_of(row) / texels[row] for name, row in firsts.items()}
        return np.round(texels * [a_texel[name] for name in formats]).astype(np.int64)

    def _bytes_of(self, row):
        return map_bytes(changed(self.arranged, **self._changes_of(row)))

    def _changes_of(self, row):
        return {name: values[row] for name, values in self.changes.items()}

    @property
    def effects(self):
        """How many effects they take that plain maps do without."""
        settings = self.arranged
        return (
            (settings.warp != "none")
            + settings.turned
            + (not is_default_split(settings))
            + (self.sizes.ndim == 2)
        )

    def candidate(self, row, expected, ms):
        """One of them, with what is expected of it and its cost."""
        changes = self._changes_of(row)
        return Candidate(
            self.arranged, changes["map_size"], expected.error, float(ms), changes, expected
        )


def cheapest(candidate):
    """Sort by cost, then by error."""
    return candidate.ms, candidate.error, candidate.texels


def finest(candidate):
    """Sort by error, then by cost."""
    return candidate.error, candidate.ms, candidate.texels
