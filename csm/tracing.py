"""The truth: what exact rays say about every pixel.

A ray through each pixel's centre finds the surface, a ray from there to the sun says whether it is
lit. Everything is relative to ``scene.origin`` and rounded to float32 once, as on the GPU, so that
what is judged is what was drawn; points and normals come from the rounded triangles in doubles.
"""

from dataclasses import dataclass, field

import numpy as np

from .camera import Camera
from .disc import DiscCount, disc_directions
from .embree import in_chunks, tree_of
from .scene import Scene
from .spaces import as_number
from .sun import Sun

__all__ = ["NotConverged", "Truth", "truth"]

FACING = 1e-5  # n . L above which a surface faces the sun: below, rounding decides
MAX_RAYS_PER_PIXEL = 1 << 16


class NotConverged(ValueError):
    """The standard error that was asked for is out of reach of this scene, camera and sun."""


@dataclass(frozen=True, eq=False)
class Truth:
    """Ray-traced visibility of the sun from every pixel. Made by `truth`.

    It pickles: arrays and inputs travel; `trace` builds its tree again where it arrives.

    Attributes
    ----------
    mask : (h, w) float32
        Visibility of the sun, 0 to 1, row 0 on top: of the disc's share that is seen with
        ``rays_per_pixel > 1``, otherwise of a point sun at its centre. 1 where `valid` is False,
        0 where a surface does not face the sun.
    mask_point : (h, w) float32
        Visibility of the point sun; `mask` itself unless the truth is soft.
    valid : (h, w) bool
        A surface is seen there, between the camera's near and far.
    facing : (h, w) bool
        The geometric normal, turned to the camera, has ``normal . to_light > 1e-5``.
    position : (h, w, 3) float64
        World point under the pixel's centre [m]; NaN where not valid.
    normal : (h, w, 3) float64
        Unit geometric normal, turned to the camera; 0 where not valid.
    occluder_distance : (h, w) float64
        Along the ray to the point sun, to the nearest triangle [m]; inf where the sun is seen or
        no ray was sent (not valid, not facing).
    scene, camera, sun
        What was traced.
    rays_per_pixel : int
        As asked for; with ``standard_error=`` as many as that took.
    standard_error : float
        Of `mask`, where the disc is seen in part; NaN unless it was asked for.
    """

    mask: np.ndarray
    mask_point: np.ndarray
    valid: np.ndarray
    facing: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    occluder_distance: np.ndarray
    scene: Scene = field(repr=False)
    camera: Camera = field(repr=False)
    sun: Sun = field(repr=False)
    rays_per_pixel: int
    standard_error: float = float("nan")

    def trace(self, points, normals=None):
        """Visibility of the point sun from any points of the world.

        Parameters
        ----------
        points : (m, 3) array_like
            World points [m], on a surface or anywhere.
        normals : (m, 3) array_like, optional
            Unit normals of the surfaces they lie on, turned to the side that is looked at. With
            them a ray starts two float32 steps off its surface and a surface that does not face
            the sun sees nothing of it, as in `mask`. Without, it starts two steps towards the sun,
            which does not clear a surface that the light grazes.

        Returns
        -------
        visibility : (m,) float32
            1 where the sun is seen, 0 where not.

        Raises
        ------
        ValueError
            If an array is not (m, 3), not finite, or the two differ in length.
        """
        visibility, _ = self._towards_sun(points, normals, distances=False)
        return visibility

    def occluder_distances(self, points, normals=None):
        """Distance to what first hides the point sun from any points of the world.

        Parameters
        ----------
        points, normals : (m, 3) array_like
            As for `trace`.

        Returns
        -------
        distance : (m,) float64
            Along the ray to the sun [m]; inf where it is seen, 0 where a surface of a given normal
            does not face it.

        Raises
        ------
        ValueError
            As for `trace`.
        """
        return self._towards_sun(points, normals, distances=True)[1]

    def shows_itself(self, points, normals):
        """Whether the light's first surface along the ray through a point is the point's own.

        What a texel of a shadow map stores there is then the surface that it is compared with.

        Parameters
        ----------
        points, normals : (m, 3) array_like
            Points on surfaces [m] and their unit normals; only those on a triangle can be shown.

        Returns
        -------
        own : (m,) bool
        """
        points, normals = _points("points", points), _points("normals", normals)
        tree = tree_of(self.scene)
        own = np.zeros(len(points), bool)
        reach = 2.0 * float(np.linalg.norm(np.ptp(tree.bounds, axis=0))) + 1.0

        def work(part, stop):
            local = points[part] - tree.origin
            inwards = -normals[part]
            beneath = tree.query(tree.lifted(local, normals[part]), inwards)
            down = np.broadcast_to(-self.sun.to_light, local.shape)
            first = tree.query(local + reach * self.sun.to_light, down)
            own[part] = (beneath >= 0) & (beneath == first)

        in_chunks(work, len(points))
        return own

    def _towards_sun(self, points, normals, distances):
        """Visibility of the point sun (m,), and, where asked for, the occluders' distances (m,)."""
        points = _points("points", points)
        lift_along = np.broadcast_to(self.sun.to_light, points.shape)
        if normals is not None:
            lift_along = _points("normals", normals)
            if len(lift_along) != len(points):
                raise ValueError(
                    "normals must be as many as points "
                    f"(got {len(lift_along)} normals, {len(points)} points)"
                )
        tree = tree_of(self.scene)
        visibility = np.zeros(len(points), np.float32)
        distance = np.zeros(len(points) if distances else 0)

        def work(part, stop):
            facing = np.flatnonzero(lift_along[part] @ self.sun.to_light > FACING)
            origins = tree.lifted(points[part][facing] - tree.origin, lift_along[part][facing])
            to_light = np.broadcast_to(self.sun.to_light, origins.shape)
            hit = tree.query(origins, to_light)
            visibility[part][facing] = hit < 0
            if distances:
                far = np.full(len(facing), np.inf)
                blocked = np.flatnonzero(hit >= 0)
                met = tree.meet(
                    hit[blocked], origins[blocked], to_light[blocked], self.sun.to_light
                )
                far[blocked] = np.maximum(met[0], 0.0)
                distance[part][facing] = far

        in_chunks(work, len(points))
        return visibility, distance


def truth(scene, camera, sun, *, rays_per_pixel=1, standard_error=None, progress=None):
    """Trace what every pixel of a camera sees of the sun.

    One ray per pixel centre finds the surface; from there one shadow ray goes to the sun's centre
    and, for ``rays_per_pixel > 1``, that many more to points spread over its disc. The same input
    gives the same bits, whatever the number of threads.

    Parameters
    ----------
    scene : Scene
        Every triangle has two sides and is opaque, but for what a mesh's `alpha` cuts out of it,
        which rays pass through. The tree built for it is kept while it lives.
    camera : Camera
    sun : Sun
        Its ``angular_diameter_deg`` counts only with more than one ray.
    rays_per_pixel : int
        1: a point sun. More, up to 65536: the share of the disc that is seen; a disc of diameter 0
        is a point whatever the number.
    standard_error : float, optional
        Trace patterns of `rays_per_pixel` rays (2 or more), each drawn anew, until the standard
        error of their mean is at most this: the root mean square over the pixels that see a part of
        the disc, from the scatter of the patterns. At least two patterns; all pixels get as many.
    progress : callable, optional
        Called with the share done, 0 to 1, from the calling thread; with `standard_error` anew for
        every pattern.

    Returns
    -------
    truth : Truth

    Raises
    ------
    ImportError
        If embreex is missing.
    TypeError, ValueError
        If an argument is of the wrong kind or out of range, or the standard error takes more than
        65536 rays per pixel.
    KeyboardInterrupt
        On Ctrl-C, within a second; only the tree of a new scene is built in one call of Embree,
        half a second per million triangles, that nothing interrupts.

    References
    ----------
    .. [Wald2014] Wald, Woop, Benthin, Johnson, Ernst: Embree: a kernel framework for efficient CPU
       ray tracing. ACM Trans. Graph. 33(4), 2014. doi:10.1145/2601097.2601199
    """
    for name, value, kind in (
        ("scene", scene, Scene),
        ("camera", camera, Camera),
        ("sun", sun, Sun),
    ):
        if not isinstance(value, kind):
            raise TypeError(f"{name} must be a csm.{kind.__name__} (got {type(value).__name__})")
    if not isinstance(rays_per_pixel, (int, np.integer)) or isinstance(rays_per_pixel, bool):
        raise TypeError(f"rays_per_pixel must be an int (got {rays_per_pixel!r})")
    if not 1 <= rays_per_pixel <= MAX_RAYS_PER_PIXEL:
        raise ValueError(f"rays_per_pixel must be 1 to {MAX_RAYS_PER_PIXEL} (got {rays_per_pixel})")
    if standard_error is not None:
        standard_error = as_number("standard_error", standard_error, 1e-9, 1.0)
        if rays_per_pixel < 2:
            raise ValueError("standard_error needs rays_per_pixel of 2 or more (got 1)")
    soft = rays_per_pixel > 1 and sun.angular_diameter_deg > 0.0
    tree = tree_of(scene)
    width, height = camera.size
    count = width * height
    picture = _Picture.empty(count, soft)

    disc = DiscCount.empty(count if soft else 0, int(rays_per_pixel))

    def work(part, stop):
        picture.trace(tree, camera, sun, part)
        if soft:
            picture.trace_disc(tree, sun, disc, part, stop)

    in_chunks(work, count, progress)
    if soft:
        if standard_error is not None:
            _converge(picture, tree, sun, disc, standard_error, progress)
        picture.mask[:] = picture.mask_point
        picture.mask[picture.facing] = disc.share[picture.facing]
    shaped = {
        name: array.reshape(height, width, *array.shape[1:])
        for name, array in vars(picture).items()
    }
    return Truth(
        **shaped,
        scene=scene,
        camera=camera,
        sun=sun,
        rays_per_pixel=disc.rays * disc.patterns if soft else int(rays_per_pixel),
        standard_error=_reached(soft, disc, standard_error),
    )


def _converge(picture, tree, sun, disc, target, progress):
    """Trace patterns over the disc until their mean is as good as asked for."""

    def work(part, stop):
        picture.trace_disc(tree, sun, disc, part, stop)

    while disc.patterns < 2 or disc.standard_error > target:
        if disc.rays * (disc.patterns + 1) > MAX_RAYS_PER_PIXEL:
            raise NotConverged(
                f"standard_error {target:g} takes more than {MAX_RAYS_PER_PIXEL} rays per pixel "
                f"({disc.standard_error:g} after {disc.rays * disc.patterns})"
            )
        disc.patterns += 1
        in_chunks(work, len(picture.mask), progress)


def _reached(soft, disc, target):
    """Return the standard error reached; a point sun has none, one not asked for is unknown."""
    if target is None:
        return float("nan")
    return disc.standard_error if soft else 0.0


@dataclass
class _Picture:
    """The arrays of a `Truth`, one entry per pixel; chunks write their own part."""

    mask: np.ndarray
    mask_point: np.ndarray
    valid: np.ndarray
    facing: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    occluder_distance: np.ndarray

    @classmethod
    def empty(cls, count, soft):
        mask_point = np.ones(count, np.float32)
        return cls(
            mask=mask_point.copy() if soft else mask_point,
            mask_point=mask_point,
            valid=np.zeros(count, bool),
            facing=np.zeros(count, bool),
            position=np.full((count, 3), np.nan),
            normal=np.zeros((count, 3)),
            occluder_distance=np.full(count, np.inf),
        )

    def trace(self, tree, camera, sun, part):
        """Find the surface under each pixel of `part`, and whether it sees the point sun."""
        rows, columns = np.divmod(np.arange(part.start, part.stop), camera.size[0])
        sources, directions = _pixel_rays(camera, tree.origin, rows, columns)
        # With these directions the ray parameter is the view depth. Starting where the scene can
        # start keeps float32 origins at the scene's own scale, however far away the camera is.
        start = max(camera.near, tree.nearest_depth(camera))
        hit = tree.query(sources + start * directions, directions)
        seen = np.flatnonzero(hit >= 0)
        depth, normal = tree.meet(hit[seen], sources[seen], directions[seen], -camera.backward)
        within = (depth >= camera.near) & (depth <= camera.far)
        seen, depth, normal = seen[within], depth[within], normal[within]
        point = sources[seen] + depth[:, None] * directions[seen]
        facing = normal @ sun.to_light > FACING

        pixel = part.start + seen
        self.valid[pixel] = True
        self.facing[pixel] = facing
        self.position[pixel] = point + tree.origin
        self.normal[pixel] = normal
        self.mask_point[pixel] = 0.0

        pixel, point, normal = pixel[facing], point[facing], normal[facing]
        to_light = np.broadcast_to(sun.to_light, point.shape)
        blocker = tree.query(tree.lifted(point, normal), to_light)
        self.mask_point[pixel] = blocker < 0
        blocked = np.flatnonzero(blocker >= 0)
        distance, _ = tree.meet(blocker[blocked], point[blocked], to_light[blocked], sun.to_light)
        self.occluder_distance[pixel[blocked]] = np.maximum(distance, 0.0)

    def trace_disc(self, tree, sun, disc, part, stop):
        """Count what each pixel of `part` sees of the disc, by the pattern that is on."""
        pixel = part.start + np.flatnonzero(self.facing[part])
        normal = self.normal[pixel]
        origins = tree.lifted(self.position[pixel] - tree.origin, normal)
        seen = np.zeros(len(pixel), np.int64)
        for ray in range(disc.rays):
            if stop.is_set():
                return
            directions = disc_directions(sun, disc.rays, ray, pixel, disc.patterns - 1)
            # A part of the disc below the surface's own horizon is hidden by the surface.
            above = np.einsum("ij,ij->i", directions, normal) > FACING
            seen += above & (tree.query(origins, directions) < 0)
        disc.add(pixel, seen)


def _pixel_rays(camera, origin, rows, columns):
    """Return sources (m, 3) relative to `origin`, and directions (m, 3) per metre of view depth."""
    x, y = camera.pixel_plane()
    across = x[columns, None] * camera.right + y[rows, None] * camera.up
    eye = camera.eye - origin
    if camera.orthographic:
        return eye + across, np.broadcast_to(-camera.backward, across.shape)
    return np.broadcast_to(eye, across.shape), across - camera.backward


def _points(name, value):
    array = np.asarray(value)
    if array.dtype.kind not in "fiu" or array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(
            f"{name} must be (m, 3) real numbers (got shape {array.shape}, dtype {array.dtype})"
        )
    array = array.astype(np.float64)
    if not np.isfinite(array).all():
        raise ValueError(
            f"{name} must be finite (got {int((~np.isfinite(array)).sum())} that are not)"
        )
    return array
