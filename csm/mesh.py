"""A mesh: triangles over vertices, immutable and checked when it is made."""

from dataclasses import dataclass

import numpy as np

from .spaces import frozen, real_array

__all__ = ["Mesh"]


@dataclass(frozen=True, eq=False, init=False)
class Mesh:
    """Triangles over their vertices, in the mesh's own space.

    Parameters
    ----------
    positions : (n, 3) array_like
        Vertices, finite; copied.
    triangles : (m, 3) array_like of int
        Vertex indices, counter-clockwise seen from the front, m >= 1; copied.
    name : str
        For messages.

    Attributes
    ----------
    positions : (n, 3) float64
        Read-only, C-contiguous.
    triangles : (m, 3) int32
        Read-only, C-contiguous.

    Raises
    ------
    TypeError, ValueError
        If shape, type or range is wrong; the text says which entry.
    """

    positions: np.ndarray
    triangles: np.ndarray
    name: str

    def __init__(self, positions, triangles, name=""):
        if not isinstance(name, str):
            raise TypeError(f"name must be a string (got {name!r})")
        label = f" of mesh {name!r}" if name else ""
        positions = real_array(f"positions{label}", positions)
        if positions.ndim != 2 or positions.shape[1] != 3:
            raise ValueError(f"positions{label} must be (n, 3) (got shape {positions.shape})")
        positions = np.array(positions, np.float64, order="C")
        bad = ~np.isfinite(positions).all(axis=1)
        if bad.any():
            first = int(np.argmax(bad))
            raise ValueError(
                f"positions{label} must be finite (vertex {first} is {positions[first].tolist()})"
            )
        object.__setattr__(self, "positions", frozen(positions))
        object.__setattr__(
            self, "triangles", frozen(_checked_triangles(triangles, len(positions), label))
        )
        object.__setattr__(self, "name", name)

    def __repr__(self):
        return (
            f"<Mesh {self.name!r}: {len(self.triangles)} triangles, {len(self.positions)} vertices>"
        )

    def __getstate__(self):
        return (self.positions, self.triangles, self.name)

    def __setstate__(self, state):
        # Arrays come out of a pickle writable.
        positions, triangles, name = state
        self.__dict__.update(positions=frozen(positions), triangles=frozen(triangles), name=name)


def _checked_triangles(triangles, vertex_count, label):
    given = np.asarray(triangles)
    if given.dtype.kind not in "iu":
        raise TypeError(f"triangles{label} must be integers (got dtype {given.dtype})")
    if given.ndim != 2 or given.shape[1] != 3:
        raise ValueError(f"triangles{label} must be (m, 3) (got shape {given.shape})")
    if len(given) == 0:
        raise ValueError(f"triangles{label} must have at least one row (got 0)")
    if vertex_count > np.iinfo(np.int32).max:
        raise ValueError(f"positions{label} must have fewer than 2^31 rows (got {vertex_count})")
    low, high = int(given.min()), int(given.max())
    if low < 0 or high >= vertex_count:
        wrong = low if low < 0 else high
        raise ValueError(
            f"triangles{label} must hold indices from 0 to {vertex_count - 1} (got {wrong})"
        )
    return np.array(given, np.int32, order="C")


def drop_unused(positions, triangles):
    """Keep only the positions that triangles use, in their order, and renumber the triangles."""
    used = np.zeros(len(positions), bool)
    used[triangles] = True
    if used.all():
        return positions, triangles
    new_index = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return positions[used], new_index[triangles]
