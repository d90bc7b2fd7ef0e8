"""A mesh: triangles over vertices, immutable and checked when it is made."""

from dataclasses import dataclass

import numpy as np

from .cutouts import checked_cutout
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
    uv : (n, 2) array_like, optional
        Where each vertex lies in the image `alpha`, as in glTF: (0, 0) is its upper left corner,
        (1, 1) its lower right, v down; beyond them it repeats. Finite, over at most 2^20 texels;
        copied.
    alpha : (h, w) array_like, optional
        A cut-out, row 0 on top: float32 in [0, 1] or uint8; copied, unless it is read-only.
        Of the triangles there is what lies over texels with ``alpha >= alpha_cutoff``: neither a
        camera nor the light sees the rest. The nearest texel decides, unfiltered. `uv` and
        `alpha` come together or not at all.
    alpha_cutoff : float
        0 or more, as a share: of uint8, 255 is 1.

    Attributes
    ----------
    positions : (n, 3) float64
        Read-only, C-contiguous.
    triangles : (m, 3) int32
        Read-only, C-contiguous.
    uv : (n, 2) float64 or None
    alpha : (h, w) float32 or uint8 or None
        Read-only, C-contiguous.
    alpha_cutoff : float
        0.5 without a cut-out.

    Raises
    ------
    TypeError, ValueError
        If shape, type or range is wrong; the text says which entry.
    """

    positions: np.ndarray
    triangles: np.ndarray
    name: str
    uv: np.ndarray | None
    alpha: np.ndarray | None
    alpha_cutoff: float

    def __init__(self, positions, triangles, name="", uv=None, alpha=None, alpha_cutoff=0.5):
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
        put = object.__setattr__.__get__(self)
        put("positions", frozen(positions))
        put("triangles", frozen(_checked_triangles(triangles, len(positions), label)))
        put("name", name)
        cutout = checked_cutout(label, len(positions), self.triangles, uv, alpha, alpha_cutoff)
        for field, value in zip(("uv", "alpha", "alpha_cutoff"), cutout, strict=True):
            put(field, value)

    def posed(self, positions):
        """Return the same triangles, name and cut-out over other positions."""
        return Mesh(positions, self.triangles, self.name, self.uv, self.alpha, self.alpha_cutoff)

    def __repr__(self):
        cutout = "" if self.alpha is None else ", with a cut-out"
        return (
            f"<Mesh {self.name!r}: {len(self.triangles)} triangles, "
            f"{len(self.positions)} vertices{cutout}>"
        )

    def __setstate__(self, state):
        # Arrays come out of a pickle writable.
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        self.__dict__.update(state)


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
