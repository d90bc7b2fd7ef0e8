"""Cut-outs: an image that says what of a mesh's triangles is there (docs/numerics.md 26).

The rule is the shaders': the nearest texel, wrapping round, and there where alpha reaches the
cut-off. `Cutouts` applies it to points that rays hit.
"""

import weakref

import numpy as np

from .spaces import as_number, frozen, real_array

__all__ = ["MAX_SIDE", "MAX_SPAN", "Cutouts", "checked_cutout", "core_meshes", "has_cutout"]

MAX_SIDE = 16384  # texels: CSM_MAX_CUTOUT
MAX_SPAN = 1 << 20  # texels over which the coordinates of a mesh go: CSM_MAX_CUTOUT_SPAN


def checked_cutout(label, vertex_count, triangles, uv, alpha, alpha_cutoff):
    """Check what a `csm.Mesh` is given: uv, alpha and alpha_cutoff; (None, None, 0.5) for none.

    Raises TypeError or ValueError that begins with what is wrong and `label`.
    """
    cutoff = as_number(f"alpha_cutoff{label}", alpha_cutoff, 0.0)
    if uv is None and alpha is None:
        return None, None, 0.5
    if uv is None or alpha is None:
        missing = "uv" if uv is None else "alpha"
        raise ValueError(f"uv and alpha{label} must come together (got no {missing})")
    alpha = _checked_alpha(f"alpha{label}", alpha)
    uv = np.array(real_array(f"uv{label}", uv), np.float64, order="C")
    if uv.shape != (vertex_count, 2):
        raise ValueError(
            f"uv{label} must be ({vertex_count}, 2), a row per position (got shape {uv.shape})"
        )
    bad = ~np.isfinite(uv).all(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        raise ValueError(f"uv{label} must be finite (vertex {first} is {uv[first].tolist()})")
    used = uv[np.unique(triangles)]
    spans = (used.max(axis=0) - np.floor(used.min(axis=0))) * alpha.shape[::-1]
    if not spans.max() <= MAX_SPAN:
        raise ValueError(
            f"uv{label} must go over at most {MAX_SPAN} texels of alpha, {alpha.shape[1]} x "
            f"{alpha.shape[0]} (got {spans.max():.9g})"
        )
    return frozen(uv), alpha, cutoff


def _checked_alpha(name, alpha):
    given = real_array(name, alpha)
    if given.ndim != 2 or not all(1 <= side <= MAX_SIDE for side in given.shape):
        raise ValueError(
            f"{name} must be (h, w), 1 to {MAX_SIDE} texels each way (got shape {given.shape})"
        )
    if given.dtype != np.uint8 and given.dtype.kind != "f":
        raise TypeError(f"{name} must be floats or uint8 (got dtype {given.dtype})")
    if given.dtype != np.uint8 and not ((given >= 0) & (given <= 1)).all():
        raise ValueError(
            f"{name} must be 0 to 1 everywhere (got {given.min():g} to {given.max():g})"
        )
    kind = np.uint8 if given.dtype == np.uint8 else np.float32
    flags = given.flags
    if given.dtype == kind and flags.owndata and flags.c_contiguous and not flags.writeable:
        return given  # so that meshes may share one image
    return frozen(np.array(given, kind, order="C"))


def has_cutout(scene):
    """Whether a mesh of the scene has one."""
    return any(mesh.alpha is not None for mesh in scene.meshes)


_there = {}  # id of an image and cut-off, to the image (weakly) and its texels that are there


def texels_there(mesh):
    """(h, w) bool, read-only: where alpha reaches the cut-off. One array for meshes that share."""
    key = (id(mesh.alpha), mesh.alpha_cutoff)
    known = _there.get(key)
    if known is None:
        share = mesh.alpha / 255.0 if mesh.alpha.dtype == np.uint8 else mesh.alpha
        there = frozen(np.greater_equal(share, mesh.alpha_cutoff))
        gone = weakref.ref(mesh.alpha, lambda _: _there.pop(key, None))
        known = _there.setdefault(key, (gone, there))
    return known[1]


def core_meshes(scene):
    """Meshes of a scene as the core takes them: positions, triangles; uv, texels if cut out."""
    return tuple(
        (mesh.positions, mesh.triangles)
        if mesh.alpha is None
        else (mesh.positions, mesh.triangles, mesh.uv, texels_there(mesh))
        for mesh in scene.meshes
    )


class Cutouts:
    """The cut-outs of a scene's triangles, in the order of `Scene.flatten`.

    Attributes
    ----------
    row : (m,) int32
        Of each triangle among those with a cut-out, -1 without.
    """

    def __init__(self, scene):
        mirrored = np.linalg.det(scene.world_from_instance[:, :3, :3]) < 0
        rows, corners, numbers, self._images = [], [], [], []
        known = {}  # mesh number to image number
        count = 0
        for number, flipped in zip(scene.instance_mesh, mirrored, strict=True):
            mesh = scene.meshes[number]
            length = len(mesh.triangles)
            if mesh.alpha is None:
                rows.append(np.full(length, -1, np.int32))
                continue
            if number not in known:
                known[number] = len(self._images)
                self._images.append(texels_there(mesh))
            order = [0, 2, 1] if flipped else [0, 1, 2]
            corners.append(mesh.uv[mesh.triangles[:, order]])
            numbers.append(np.full(length, known[number], np.int32))
            rows.append(np.arange(count, count + length, dtype=np.int32))
            count += length
        self.row = np.concatenate(rows)
        self._corners = np.concatenate(corners)
        self._numbers = np.concatenate(numbers)

    def there(self, triangles, weights):
        """Whether points of triangles with a cut-out are there: (k,) bool.

        `weights` (k, 3) are the shares of the triangles' corners in the points.
        """
        rows = self.row[triangles]
        places = np.einsum("ik,ikj->ij", weights, self._corners[rows])
        numbers = self._numbers[rows]
        there = np.empty(len(rows), bool)
        for number in np.unique(numbers):
            image = self._images[number]
            of_image = numbers == number
            texels = np.floor(places[of_image] * image.shape[::-1]).astype(np.int64)
            there[of_image] = image[texels[:, 1] % image.shape[0], texels[:, 0] % image.shape[1]]
        return there
