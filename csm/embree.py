"""Which triangle a ray meets (Embree, through embreex) and where (doubles): one tree per scene.

embreex reads past arrays of unequal length, follows indices out of range and has no lower end for
a ray; all three are dealt with here and nowhere else.
"""

import os
import threading
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from .cutouts import Cutouts, has_cutout
from .tasks import begin

__all__ = ["RayTree", "in_chunks", "tree_of"]

CHUNK_RAYS = 1 << 16  # rays of one call into Embree, some milliseconds
CHUNK_TRIANGLES = 1 << 17  # copied with the GIL held, about 0.15 s


class RayTree:
    """The triangles of a scene around its origin, as float32, and Embree's tree over them."""

    def __init__(self, scene):
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError as error:
            raise ImportError(
                "csm.truth needs embreex: pip install cascaded-shadow-maps[truth]"
            ) from error
        self.origin = scene.origin
        self.bounds = scene.bounds - scene.origin
        positions, triangles = scene.flatten(relative_to=scene.origin)
        rounded = positions.astype(np.float32)
        # (m, 3, 3): as separate triangles there are no indices that Embree could follow out of
        # range. Shared corners stay bit-equal, which is what robust mode needs at edges.
        self.corners = rounded[triangles]
        self._cutouts = Cutouts(scene) if has_cutout(scene) else None
        self._least_step = max(2.0**-46 * float(np.abs(self.bounds).max()), 1e-300)
        self._embree = EmbreeScene(robust=True)
        for first in range(0, len(self.corners), CHUNK_TRIANGLES):
            TriangleMesh(self._embree, self.corners[first : first + CHUNK_TRIANGLES])
        # The tree is built by the first call, which must be alone.
        self.query(np.zeros((1, 3)), np.ones((1, 3)))

    def query(self, origins, directions):
        """Find the first triangle along each ray, -1 for none; where it is cut out it is not met.

        Takes two (m, 3) float arrays, returns (m,) int64.
        """
        found = self._first(origins, directions)
        if self._cutouts is not None:
            self._walk_on(found, origins, directions)
        return found

    def _walk_on(self, found, origins, directions):
        """Send rays that met a triangle where it is cut out on, from there, until none is left.

        embreex has no filter callbacks: a ray starts again two float32 steps behind what it met,
        and twice as far again while that is not behind it, as where it runs along the triangle.
        """
        rays = np.flatnonzero(found >= 0)
        rays = rays[self._cutouts.row[found[rays]] >= 0]
        reached, doubled, last = np.zeros(len(rays)), np.zeros(len(rays)), found[rays]
        while len(rays):
            start, along = origins[rays], directions[rays]
            parameter, weights = self._place(last, start, along)
            through = ~self._cutouts.there(last, weights)
            rays, start, along, last = rays[through], start[through], along[through], last[through]
            parameter = np.maximum(parameter[through], reached[through])
            point = start + parameter[:, None] * along
            step = 2.0 * 2.0**-23 * np.maximum(np.abs(point), np.abs(start)).max(axis=1, initial=0)
            step = np.maximum(step, self._least_step)  # at the origin itself it would be none
            step = np.ldexp(step / np.linalg.norm(along, axis=1), doubled[through].astype(int))
            reached = parameter + step
            met = self._first(start + reached[:, None] * along, along)
            found[rays] = met
            again = met == last
            on = np.flatnonzero(met >= 0)
            on = on[self._cutouts.row[met[on]] >= 0]
            doubled = np.where(again, doubled[through] + 1.0, 0.0)[on]
            rays, reached, last = rays[on], reached[on], met[on]

    def _place(self, triangles, origins, directions):
        """Where rays meet the planes of triangles with a cut-out, in doubles.

        Returns the ray parameter (m,) and the shares of the corners (m, 3), held to the triangle:
        Embree lets rays by a rounding outside meet it.
        """
        corners = self.corners[triangles].astype(np.float64)
        edges = corners[:, 1:] - corners[:, :1]
        across = np.cross(directions, edges[:, 1])
        volume = np.einsum("ij,ij->i", across, edges[:, 0])
        offset = origins - corners[:, 0]
        twisted = np.cross(offset, edges[:, 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            second = np.einsum("ij,ij->i", across, offset) / volume
            third = np.einsum("ij,ij->i", twisted, directions) / volume
            parameter = np.einsum("ij,ij->i", twisted, edges[:, 1]) / volume
        # a ray in the triangle's plane meets it nowhere in particular: at its first corner
        second, third, parameter = np.nan_to_num(
            [second, third, parameter], nan=0.0, posinf=0.0, neginf=0.0
        )
        square = np.einsum("ij,ij->i", directions, directions)
        span = np.einsum("ikj,ij->ik", corners - origins[:, None, :], directions) / square[:, None]
        parameter = np.clip(parameter, span.min(axis=1), span.max(axis=1))
        weights = np.clip(np.stack([1.0 - second - third, second, third], axis=1), 0.0, 1.0)
        return parameter, weights / weights.sum(axis=1, keepdims=True)

    def _first(self, origins, directions):
        if origins.shape != directions.shape or origins.shape[1:] != (3,):
            raise AssertionError(f"rays of shapes {origins.shape} and {directions.shape}")
        if not len(origins):
            return np.zeros(0, np.int64)
        found = self._embree.run(
            np.ascontiguousarray(origins, np.float32),
            np.ascontiguousarray(directions, np.float32),
            query="INTERSECT",
            output=True,
        )
        triangle = found["geomID"].astype(np.int64) * CHUNK_TRIANGLES + found["primID"]
        return np.where(found["primID"] < 0, -1, triangle)

    def meet(self, triangles, origins, directions, axis):
        """Meet rays with the planes of the triangles that Embree says they hit, in doubles.

        `axis` has ``axis . direction == 1``. The parameter is held within what the triangle's
        corners span along the axis: at a triangle seen edge-on its plane says nothing.

        Returns the ray parameter (m,) and the unit normal turned against the ray (m, 3).
        """
        corners = self.corners[triangles].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.sqrt(np.einsum("ij,ij->i", normal, normal))
        normal /= np.where(length > 0.0, length, 1.0)[:, None]
        slope = np.einsum("ij,ij->i", normal, directions)
        height = np.einsum("ij,ij->i", normal, corners[:, 0] - origins)
        span = np.einsum("ikj,j->ik", corners - origins[:, None, :], axis)
        low, high = span.min(axis=1), span.max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            parameter = np.clip(height / slope, low, high)
        parameter = np.where(np.isnan(parameter), 0.5 * (low + high), parameter)
        return parameter, np.where(slope[:, None] > 0.0, -normal, normal)

    @staticmethod
    def lifted(points, normals):
        """Lift origins of shadow rays off their surface by two float32 steps.

        Steps of the point's largest coordinate: a smaller lift rounds back onto the surface, a
        larger one loses contact shadows.
        """
        lift = 2.0 * 2.0**-23 * np.abs(points).max(axis=1, initial=0.0)
        return points + lift[:, None] * normals

    def nearest_depth(self, camera):
        """Return a view depth that nothing of the scene lies before [m]."""
        corners = np.stack(np.meshgrid(*self.bounds.T), axis=-1).reshape(8, 3)
        depths = (corners - (camera.eye - self.origin)) @ -camera.backward
        return depths.min() - 0.01 * np.ptp(self.bounds, axis=0).max()


_trees = weakref.WeakKeyDictionary()  # Scene to RayTree: one tree for any cameras and suns
# Held while a tree is built, some seconds: a signal handler or a finaliser that traces meanwhile on
# the same thread must not wait for itself.
_trees_lock = threading.RLock()


def _renew_lock_after_fork():
    """In a forked child the thread that held the lock does not exist, and would never let go."""
    global _trees_lock
    _trees_lock = threading.RLock()


os.register_at_fork(after_in_child=_renew_lock_after_fork)


def tree_of(scene):
    """Return the `RayTree` of a scene, built at the first call and kept while the scene lives."""
    with _trees_lock:
        tree = _trees.get(scene)
        if tree is None:
            tree = _trees[scene] = RayTree(scene)
        return tree


def in_chunks(work, count, progress=None):
    """Call ``work(part, stop)`` for slices of ``range(count)`` on all cores.

    An exception, Ctrl-C among them, leaves after the calls into Embree that are under way, each of
    some milliseconds: `stop` is set and what has not begun is dropped.
    """
    stop = threading.Event()
    parts = [slice(first, min(first + CHUNK_RAYS, count)) for first in range(0, count, CHUNK_RAYS)]
    with ThreadPoolExecutor(_core_count()) as pool:
        try:
            futures = [begin(pool, work, part, stop) for part in parts]
            for done, future in enumerate(futures, 1):
                future.result()
                if progress is not None:
                    progress(done / len(futures))
        except BaseException:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _core_count():
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))
