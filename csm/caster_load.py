"""What casters lay on shadow maps: how often they cover their texels, and with how many triangles.

On a rasteriser a map takes as long as all the triangles over it do, one behind the other; what of
them is seen from the sun in the end does not matter. So triangles are looked at, not maps: some
thousands of them, each as the box that it fills across the light.
"""

import threading
import weakref
from dataclasses import dataclass, field

import numpy as np

from . import _core
from .spaces import frozen

__all__ = ["Casters", "Load", "sample_casters"]

SAMPLED = 10_000  # triangles that are looked at
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclass(frozen=True, eq=False)
class Load:
    """What casters lay on maps.

    Attributes
    ----------
    layers : (n, 2, 2) float64
        Of each cascade how often its map is covered, on average: by sides that face the sun and by
        those that do not, each without and with a cut-out.
    lines : (n, 2, 2) float64
        How often their outlines lead along a side of the map, likewise.
    triangles, needed : (n,) float64
        Over each map, and of those which do not lie within an earlier one.
    """

    layers: np.ndarray
    lines: np.ndarray
    triangles: np.ndarray
    needed: np.ndarray
    _known: dict = field(default_factory=dict, repr=False)

    def drawn(self, faces, cutout):
        """Layers and lines of the sides that are drawn, of each cascade.

        Parameters
        ----------
        faces : {"both", "front", "back"}
        cutout : float
            Times that what has a cut-out counts.

        Returns
        -------
        layers, lines : list of float
        """
        if (faces, cutout) not in self._known:  # every size of the maps asks
            sides = {"both": slice(0, 2), "front": slice(0, 1), "back": slice(1, 2)}[faces]
            self._known[faces, cutout] = tuple(
                [sum(plain + cutout * cut for plain, cut in each[sides]) for each in one.tolist()]
                for one in (self.layers, self.lines)
            )
        return self._known[faces, cutout]


@dataclass(frozen=True, eq=False)
class Casters:
    """Triangles across the light: boxes that hold them, in the plane of two axes [m].

    Attributes
    ----------
    axes : (2, 3) float64
        Of that plane, unit.
    centre, half : (t, 2) float64
        Of each triangle's box [m].
    area : (t,) float64
        Across the light [m²], positive where it faces the sun.
    cut : (t,) bool
        Whether it has a cut-out.
    weight : (t,) float64
        Triangles that it stands for.
    """

    axes: np.ndarray
    centre: np.ndarray
    half: np.ndarray
    area: np.ndarray
    cut: np.ndarray
    weight: np.ndarray

    @property
    def lit_area(self):
        """Of the area across the light, the share that faces it.

        One half for closed surfaces, one for a plain; one half where nothing has an area.
        """
        area = self.weight * self.area
        total = np.abs(area).sum()
        return float(0.5 + 0.5 * (area.sum() / total)) if total else 0.5

    def thinned(self, cascades):
        """Fewer of them, so that each of some windows keeps enough.

        The windows of near cascades are small, and hold few of all triangles. So triangles are
        classed by the first window that they touch; of each class the largest stay, and of the
        others, sorted by area, every k-th, for k of them.

        Parameters
        ----------
        cascades : Cascades
            Any of this light; finer windows first.

        Returns
        -------
        casters : Casters
        """
        kept, weight = _core.casters_thinned(self, cascades.uvz_from_world)
        return Casters(
            self.axes,
            *(
                frozen(one.take(kept, axis=0))
                for one in (self.centre, self.half, self.area, self.cut)
            ),
            frozen(self.weight.take(kept) * weight),
        )

    def load(self, cascades):
        """What they lay on the maps of cascades without a warp.

        Parameters
        ----------
        cascades : Cascades

        Returns
        -------
        load : Load
        """
        return Load(*_core.casters_load(self, cascades.uvz_from_world))


def sample_casters(scene, axes):
    """At most 10 000 triangles of a scene, one out of each as long stretch of them.

    Parameters
    ----------
    scene : Scene
    axes : (2, 3) float64
        Unit, across the light, and with the way to it right-handed: `csm.spaces.light_gradients`.

    Returns
    -------
    casters : Casters
    """
    some = _sample(scene)
    x, y = ((some.corners @ axis).reshape(3, -1) for axis in axes)
    return Casters(axes, *_core.casters_across(x, y, some.side), some.cut, some.weight)


@dataclass(frozen=True, eq=False)
class _Sample:
    """Triangles of a scene.

    Attributes
    ----------
    corners : (3 t, 3) float64
        All first, all second, all third ones [m].
    side : (t,) float64
        -1 where mirrored, else 1.
    cut : (t,) bool
        Whether it has a cut-out.
    weight : (t,) float64
        Triangles that it stands for.
    """

    corners: np.ndarray
    side: np.ndarray
    cut: np.ndarray
    weight: np.ndarray


_samples = weakref.WeakKeyDictionary()  # Scene to its _Sample
_samples_lock = threading.Lock()


def _sample(scene):
    """The sample of a scene, taken once while it lives: no camera and no sun matters to it."""
    with _samples_lock:
        known = _samples.get(scene)
    if known is None:
        known = _take_sample(scene)
        with _samples_lock:
            _samples[scene] = known
    return known


def _take_sample(scene):
    sizes = np.array([len(mesh.triangles) for mesh in scene.meshes])
    starts = np.concatenate([[0], np.cumsum(sizes[scene.instance_mesh])])
    count = min(int(starts[-1]), SAMPLED)
    # one of every so many, not always the same of them: meshes repeat, and a stride of their
    # period would meet but one of their triangles
    places = (np.arange(count) + GOLDEN * np.arange(count) % 1.0) * (starts[-1] / count)
    wanted = np.minimum(places.astype(int), starts[-1] - 1)
    instance = np.searchsorted(starts, wanted, side="right") - 1
    corners, cut = np.empty((3, count, 3)), np.zeros(count, bool)
    for number in np.unique(scene.instance_mesh[instance]):
        mesh = scene.meshes[number]
        on = np.flatnonzero(scene.instance_mesh[instance] == number)
        own = mesh.positions[mesh.triangles[wanted[on] - starts[instance[on]]]]
        to_world = scene.world_from_instance[instance[on]]
        corners[:, on] = (
            own @ to_world[:, :3, :3].transpose(0, 2, 1) + to_world[:, None, :3, 3]
        ).transpose(1, 0, 2)
        cut[on] = mesh.alpha is not None
    mirrored = np.sign(np.linalg.det(scene.world_from_instance[:, :3, :3]))
    weight = np.full(count, starts[-1] / max(count, 1))
    return _Sample(*map(frozen, (corners.reshape(-1, 3), mirrored[instance], cut, weight)))
