"""Flicker: how the shadow at fixed points of the world changes from frame to frame.

The same points are asked for in every frame, so that the camera's own motion is removed exactly:
nothing is warped or interpolated (docs/numerics.md 15).
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from .cascades import check_kinds
from .disc import SOFT_RAYS, disc_directions
from .embree import in_chunks, tree_of
from .sampling import NO_CASCADE
from .spaces import transform_points
from .tracing import FACING

__all__ = ["FlickerReport", "flicker"]

DEPTH_SHARE = 1e-3  # of the view depth, by which a point may lie behind what its pixel shows


@dataclass(frozen=True, eq=False)
class FlickerReport:
    """Change of visibility at fixed points from each frame to the next. Made by `flicker`.

    Attributes
    ----------
    changes : (n - 1, m) float64
        Between frames t and t + 1 at each point, 0 to 1; of a moving sun what is left after its
        own change. NaN where the point is not seen in both, or beyond the shadow range in one.
    crossed : (n - 1, m) bool
        The point was answered for by another cascade.
    """

    changes: np.ndarray = field(repr=False)
    crossed: np.ndarray = field(repr=False)

    @cached_property
    def mean(self):
        """Mean change at points that stay in their cascade; NaN without any."""
        return _mean(self.changes[~self.crossed])

    @cached_property
    def transition(self):
        """Mean change at points that change cascade; NaN without any."""
        return _mean(self.changes[self.crossed])

    @cached_property
    def transition_share(self):
        """Share of the changes counted that are of points that change cascade."""
        counted = np.isfinite(self.changes)
        return _mean(self.crossed[counted].astype(float))

    @cached_property
    def largest(self):
        """Largest change at a point that stays in its cascade; NaN without any."""
        values = _finite(self.changes[~self.crossed])
        return float(values.max()) if len(values) else float("nan")

    @cached_property
    def per_point(self):
        """(m,) mean change of each point, cascades crossed or not; NaN where it never counted."""
        return _column_means(self.changes)

    def as_picture(self, seen):
        """Flicker map: `per_point` at the pixels that the points were taken from.

        Parameters
        ----------
        seen : (h, w) array_like of bool
            True where the points were taken, row by row: ``truth.position[seen]``.

        Returns
        -------
        picture : (h, w) float64
            NaN elsewhere.

        Raises
        ------
        ValueError
            If it does not hold as many pixels as there are points.
        """
        seen, count = np.asarray(seen), len(self.per_point)
        if seen.dtype != bool or seen.ndim != 2 or np.count_nonzero(seen) != count:
            raise ValueError(
                f"seen must be an (h, w) array of bool that is True at {count} pixels "
                f"(got {seen.dtype}, shape {seen.shape}, {np.count_nonzero(seen)} of them True)"
            )
        picture = np.full(seen.shape, np.nan)
        picture[seen] = self.per_point
        return picture

    @cached_property
    def per_step(self):
        """(n - 1,) mean change from each frame to the next at points that stay in their cascade."""
        return _column_means(np.where(self.crossed, np.nan, self.changes).T)

    @cached_property
    def count(self):
        """Number of changes counted, in `mean` and `transition` together."""
        return int(np.count_nonzero(np.isfinite(self.changes)))

    def __str__(self):
        if not self.count:
            return "no point is seen in two frames running within the shadow range"
        between = "none of them between cascades"
        if self.transition_share > 0.0:
            between = (
                f"{self.transition_share:.2%} of them between cascades ({self.transition:.4%})"
            )
        return f"flicker {self.mean:.4%} over {self.count:,} changes, {between}"


def flicker(frames, *, scene=None):
    """Flicker along a path of the camera, of the sun, or of the field of view.

    A change counts at points that lie in both pictures and are not hidden there. For a static scene
    and sun the truth does not change, so all change is flicker. Of a sun that moves the true change
    is subtracted: ``max(0, |mask's change| - |truth's change|)``, of a sun with a disc that of the
    share of its disc that is seen, over 64 rays, the same ones of the disc at a point in every
    frame.

    Parameters
    ----------
    frames : sequence of Frame
        Two or more, in order, rendered with the same `points` (and best with their normals), e.g.
        position and normal of a Truth where it is valid and faces the sun: a point for each pixel.
        What windows and splits hold from frame to frame belongs to the path: begin it with
        `Renderer.forget`.
    scene : Scene, optional
        What was rendered. With it rays say whether a point is hidden from the camera, and what the
        true change is; it is needed where the sun moves. Without, a point is taken as hidden where
        its pixel's `view_depth` is nearer, if the frames have it.

    Returns
    -------
    report : FlickerReport

    Raises
    ------
    TypeError, ValueError
        If there are fewer than two frames, one was rendered without points or with others, or the
        sun moves and no scene is given.
    """
    if not isinstance(frames, Iterable):
        raise TypeError(
            f"frames must be a sequence of two Frames or more (got one {type(frames).__name__})"
        )
    frames = list(frames)
    if len(frames) < 2:
        raise ValueError(f"flicker needs two frames or more (got {len(frames)})")
    points = _common_points(frames)
    moving = any(not np.array_equal(one.sun.to_light, frames[0].sun.to_light) for one in frames[1:])
    if scene is not None:
        check_kinds(scene=scene)
    if moving and scene is None:
        raise ValueError("the sun moves: the scene is needed to tell flicker from the true change")
    cascade = np.array([frame.point_cascade for frame in frames])
    counted = (cascade != NO_CASCADE) & np.array([_seen(frame, points, scene) for frame in frames])
    visibility = np.array([frame.point_visibility for frame in frames], np.float64)
    changes = np.abs(np.diff(visibility, axis=0))
    if moving:
        true = np.array([_sunlit(scene, points, frame) for frame in frames], np.float64)
        changes = np.maximum(changes - np.abs(np.diff(true, axis=0)), 0.0)
    both = np.array([one & other for one, other in pairwise(counted)])
    crossed = cascade[1:] != cascade[:-1]
    return FlickerReport(np.where(both, changes, np.nan), crossed & both)


def _common_points(frames):
    points = None
    for i, frame in enumerate(frames):
        here = getattr(frame, "points", None)
        if here is None:
            raise ValueError(f"frame {i} has no points: render every frame with the same points=")
        if points is not None and not np.array_equal(here, points):
            raise ValueError(f"frame {i} was rendered with other points than frame 0")
        points = here
    return points


def _seen(frame, points, scene):
    """Whether each point lies in the picture of a frame and nothing hides it there."""
    camera = frame.camera
    relative = points - camera.eye
    depth = relative @ -camera.backward
    ndc = transform_points(camera.clip_from_view @ camera.view_from_world, points)[:, :2]
    inside = (np.abs(ndc) <= 1.0).all(axis=1) & (depth >= camera.near) & (depth <= camera.far)
    if scene is not None:
        inside[inside] = ~_hidden(scene, camera, points[inside], depth[inside])
    elif "view_depth" in frame.outputs:
        width, height = camera.size
        column = np.clip(((ndc[inside, 0] + 1.0) * 0.5 * width).astype(int), 0, width - 1)
        row = np.clip(((1.0 - ndc[inside, 1]) * 0.5 * height).astype(int), 0, height - 1)
        # a slanted surface falls behind its pixel's centre within the pixel itself
        shown = frame.view_depth[row, column].astype(np.float64)
        pixel = 2.0 * camera.half_height / height * (1.0 if camera.orthographic else shown)
        inside[inside] = depth[inside] <= shown * (1.0 + DEPTH_SHARE) + 4.0 * pixel
    return inside


def _hidden(scene, camera, points, depth):
    """Whether a triangle lies between the camera and each point, a thousandth before it or more."""
    tree = tree_of(scene)
    towards = camera.backward if camera.orthographic else (camera.eye - points)
    towards = np.broadcast_to(towards, points.shape)
    # the ray's parameter runs from 0 at the point to 1 at the camera
    towards = towards * depth[:, None] if camera.orthographic else towards
    hidden = np.zeros(len(points), bool)

    def work(part, stop):
        origins = points[part] - tree.origin + DEPTH_SHARE * towards[part]
        hit = tree.query(origins, towards[part])
        met = np.flatnonzero(hit >= 0)
        rays = origins[met], towards[part][met]
        hidden[part.start + met] = _before_camera(tree, hit[met], *rays, camera, depth[part][met])

    in_chunks(work, len(points))
    return hidden


def _before_camera(tree, triangles, origins, towards, camera, depth):
    """Whether rays meet their triangles before they reach the camera's near plane."""
    corners = tree.corners[triangles].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slope = np.einsum("mk,mk->m", normal, towards)
    height = np.einsum("mk,mk->m", normal, corners[:, 0] - origins)
    with np.errstate(divide="ignore", invalid="ignore"):
        parameter = np.nan_to_num(height / slope)
    return parameter + DEPTH_SHARE < 1.0 - camera.near / depth


def _sunlit(scene, points, frame):
    """Share of a frame's sun that points see; none where a known surface turns away.

    A point whose normal is not known starts a step towards the sun, which does not clear a surface
    that the light grazes.
    """
    tree, sun, normals = tree_of(scene), frame.sun, frame.point_normals
    normals = np.broadcast_to(sun.to_light, points.shape) if normals is None else normals
    rays = SOFT_RAYS if sun.angular_diameter_deg > 0.0 else 1
    seen = np.zeros(len(points), np.int64)

    def work(part, stop):
        facing = part.start + np.flatnonzero(normals[part] @ sun.to_light > FACING)
        normal = normals[facing]
        origins = tree.lifted(points[facing] - tree.origin, normal)
        for ray in range(rays):
            if stop.is_set():
                return
            directions = np.broadcast_to(sun.to_light, origins.shape)
            if rays > 1:
                directions = disc_directions(sun, rays, ray, facing)
            # a part of the disc below the surface's own horizon is hidden by the surface
            above = np.einsum("mk,mk->m", directions, normal) > FACING
            seen[facing] += above & (tree.query(origins, directions) < 0)

    in_chunks(work, len(points))
    return seen / rays


def _finite(values):
    return values[np.isfinite(values)]


def _mean(values):
    values = _finite(values)
    return float(values.mean()) if len(values) else float("nan")


def _column_means(changes):
    counted = np.isfinite(changes)
    number = counted.sum(axis=0)
    total = np.where(counted, changes, 0.0).sum(axis=0)
    return np.where(number, total / np.maximum(number, 1), np.nan)
