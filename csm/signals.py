"""What a scene, seen by a camera under a sun, asks of its shadows: measured on coarse renders.

Nothing is traced. Two or three frames of a quarter of the picture's width and height with small
maps say where shadow edges are, how far their occluders are, how surfaces stand to the sun; what
settings would make of that, `csm.forecasts` works out.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from .cascades import fit_cascades
from .sampling import LIT, NO_CASCADE, surface_steps
from .settings import ShadowSettings
from .spaces import frozen, transform_points
from .tracing import FACING

__all__ = ["FACES_SHARE", "Signals", "View", "light_gradients", "measure_signals"]

COARSE = 4  # pixels of the picture along a pixel of the coarse one
LEAST_SIZE = 160  # of a coarse picture, along its shorter side: smaller ones lose what is thin
RECEIVERS = 4000  # that windows are fitted to in forecasts
EDGES = 4000  # places of edges that forecasts look at; the others count through these
DEPTH_BINS = 24
THIN_TEXELS = 2  # a caster of at most so many texels of the coarse map across is thin
LAYER_RATIO = 2.0  # occluders whose distances from a receiver differ by this are layers

FACES_SHARE = 2e-4  # of the coarse picture's facing pixels, that may change without back faces

#: The coarse maps: four, so that casters and receivers of each are counted.
PROBE = ShadowSettings(map_size=512, fit="visible", snap="none", cull="exclusive")
PROBE_OUTPUTS = ("mask", "valid", "view_depth", "normal", "cascade_index", "shadow_maps")


@dataclass(frozen=True, eq=False)
class View:
    """One camera under one sun, coarsely: arrays of what it sees.

    Attributes
    ----------
    camera : Camera
        At its full size.
    sun : Sun
    pixel_count, seen_count, facing_count, shadowed_count : int
        Of the coarse picture: all, with a surface, facing the sun, and of those in shadow.
    receivers : (m, 3) float64
        World points of surfaces that face the sun, at most some thousands.
    receiver_depths : (m,) float64
        Their view depths [m].
    slopes : (m,) float64
        Tangents of their normals' angle to the sun.
    gradients : (m,) float64
        ``|gx| + |gy|`` of their depth in light space [m/m], what a bias is made of.
    gaps : (m,) float64
        From each of them to its occluder along the light [m], inf where it is lit.
    edges : (e, 3) float64
        World points of surfaces where a shadow edge runs.
    edge_normals : (e, 3) float64
        Normals of those surfaces.
    edge_across : (e, 2) float64
        Unit directions across the edges in the picture, to the right and down.
    edge_lengths : (e,) float64
        Pixels of the full picture along each edge.
    blocker_distances : (e,) float64
        From the receiver to its occluder along the light [m].
    thin_share, layered_share : float
        Of the casters' texels in the coarse maps; of the edges.
    triangles : tuple of int
        Drawn for each of the coarse maps.
    needless_chunks : int
        That exclusive culling left out of them.
    cascade_shares : tuple of float
        Receivers in each of them.
    """

    camera: object
    sun: object
    pixel_count: int
    seen_count: int
    facing_count: int
    shadowed_count: int
    receivers: np.ndarray
    receiver_depths: np.ndarray
    slopes: np.ndarray
    gradients: np.ndarray
    gaps: np.ndarray
    edges: np.ndarray
    edge_normals: np.ndarray
    edge_across: np.ndarray
    edge_lengths: np.ndarray
    blocker_distances: np.ndarray
    thin_share: float
    layered_share: float
    triangles: tuple[int, ...]
    needless_chunks: int
    cascade_shares: tuple[float, ...]

    def penumbra_widths(self):
        """Width of the sun's penumbra at every edge [pixels of the full picture].

        A disc of diameter d degrees makes a penumbra ``2 tan(d / 2)`` times the occluder's distance
        wide, across the light; how wide that is in the picture, `surface_steps` says.

        Returns
        -------
        widths : (e,) float64
        """
        steps = surface_steps(self.camera, self.edges, self.edge_normals, light_gradients(self.sun))
        across = np.einsum("ea,eak->ek", self.edge_across, steps)
        return self.penumbra_metres() * np.linalg.norm(across, axis=1)

    def penumbra_metres(self):
        """Width of the sun's penumbra at every edge, across the light (e,) [m]."""
        angle = math.radians(self.sun.angular_diameter_deg)
        return 2.0 * math.tan(0.5 * angle) * self.blocker_distances


@dataclass(frozen=True, eq=False)
class Signals:
    """What was measured. Shares are 0 to 1; percentiles are over receivers or edges.

    Attributes
    ----------
    views : tuple of View
        One, or of a path its first, middle and last.
    seen_share : float
        Of the picture that shows a surface.
    facing_share : float
        Of what is seen that faces the sun.
    shadowed_share : float
        Of what faces the sun that is in shadow.
    depth_edges, depth_shares : (25,), (24,) float64
        Histogram of the visible receivers' view depth [m], in equal ratios.
    depth_ratio : float
        Farthest over nearest hundredth of them.
    cascade_shares : tuple of float
        Receivers in each of four cascades of the practical scheme.
    casters : tuple of int
        Triangles drawn for each of those.
    needless_chunks : int
        Chunks of casters that only finer maps need, in all of those.
    slope_percentiles : (3,) float64
        Median, 90th and 99th percentile of tan of receivers' angle to the sun.
    bias_slope : float
        Median of ``|gx| + |gy|``, what a depth bias is made of.
    edge_share : float
        Length of shadow edges [pixels] over the pixels that face the sun.
    penumbra_pixels : (3,) float64
        Median, 90th and 99th percentile of the penumbra's width.
    thin_share : float
        Of casters' texels in maps of 512² that belong to casters at most two texels wide.
    layered_share : float
        Of shadow edges near which occluders lie at distances that differ by a factor of two: light
        bleeds there under variance shadow maps.
    light_view_angle_deg : float
        Between the view and the way to the sun; near 180 the sun is behind the camera, near 0 in
        the face of it (duelling frusta at both).
    sun_elevation_deg : float
    depth_span : float
        Of the maps' depth range [m].
    origin_distance : float
        Of the camera from the scene's origin [m].
    orthographic : bool
    camera_moves, sun_moves : bool
        A path was given.
    faces_matter : float
        Share of the facing pixels that change when back faces alone cast.
    bias_matters : float
        Share of them that change when back faces alone cast and nothing is biased; 1, unmeasured,
        where back faces alone change too much.
    scene_triangles : int
    """

    views: tuple[View, ...]
    seen_share: float
    facing_share: float
    shadowed_share: float
    depth_edges: np.ndarray
    depth_shares: np.ndarray
    depth_ratio: float
    cascade_shares: tuple[float, ...]
    casters: tuple[int, ...]
    needless_chunks: int
    slope_percentiles: np.ndarray
    bias_slope: float
    edge_share: float
    penumbra_pixels: np.ndarray
    thin_share: float
    layered_share: float
    light_view_angle_deg: float
    sun_elevation_deg: float
    depth_span: float
    origin_distance: float
    orthographic: bool
    camera_moves: bool
    sun_moves: bool
    faces_matter: float
    bias_matters: float
    scene_triangles: int
    renders_ms: dict = field(default_factory=dict, repr=False)

    @property
    def pixels(self):
        """Number of pixels of the full picture."""
        width, height = self.views[0].camera.size
        return width * height

    def to_dict(self):
        """Return the numbers as plain values, without the views and without times."""
        plain = {}
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if name not in ("views", "renders_ms"):
                plain[name] = value.tolist() if isinstance(value, np.ndarray) else value
        return plain


def measure_signals(renderer, scene, cameras, suns):
    """Look at a scene coarsely.

    Parameters
    ----------
    renderer : Renderer
    scene : Scene
    cameras : sequence of Camera
        One, or a path.
    suns : sequence of Sun
        One, or a path of as many.

    Returns
    -------
    signals : Signals
        The same for the same input and driver.
    """
    last = max(len(cameras), len(suns)) - 1
    taken = sorted({0, last // 2, last})
    views, spent, changes = [], {}, []
    for number in taken:
        camera, sun = cameras[min(number, len(cameras) - 1)], suns[min(number, len(suns) - 1)]
        view, changed = _look(renderer, scene, camera, sun, spent)
        changes.append(changed)
        views.append(view)
    return _summary(scene, tuple(views), cameras, suns, np.max(changes, axis=0), spent)


def light_gradients(sun):
    """Two unit vectors (2, 3) across the light, for lengths in metres."""
    x_axis = np.cross(sun.to_light, np.eye(3)[np.abs(sun.to_light).argmin()])
    x_axis /= np.linalg.norm(x_axis)
    return np.stack([x_axis, np.cross(sun.to_light, x_axis)])


def coarse_camera(camera):
    """Camera of the coarse picture, and how many pixels of the full one are one of its."""
    shrink = max(1.0, min(COARSE, min(camera.size) / LEAST_SIZE))
    size = tuple(max(1, round(side / shrink)) for side in camera.size)
    return camera.replace(
        size=size, half_width=camera.half_width, half_height=camera.half_height
    ), shrink


def _look(renderer, scene, camera, sun, spent):
    """Render one view coarsely and read it."""
    small, shrink = coarse_camera(camera)
    # only even splits can begin at or behind an orthographic camera
    probe = PROBE if camera.near > 0.0 else PROBE.replace(split="uniform")
    frame = renderer.render(scene, small, sun, probe, outputs=PROBE_OUTPUTS)
    facing = frame.valid & (frame.normal @ sun.to_light.astype(np.float32) > FACING)
    judged = facing & (frame.cascade_index != NO_CASCADE)
    lit = frame.mask >= LIT
    count = int(np.count_nonzero(facing))
    for name, ms in frame.timings_ms.items():
        spent[name] = spent.get(name, 0.0) + ms

    def changed(**changes):
        other = renderer.render(scene, small, sun, probe.replace(**changes), outputs=("mask",))
        for name, ms in other.timings_ms.items():
            spent[name] = spent.get(name, 0.0) + ms
        return np.count_nonzero(judged & (lit != (other.mask >= LIT))) / max(count, 1)

    faces = changed(caster_faces="back")
    # without back faces alone, what needs no bias is too rare to be worth a render
    bias = changed(caster_faces="back", bias="manual") if faces <= FACES_SHARE else 1.0

    rows, columns = np.nonzero(facing)
    stride = max(1, -(-len(rows) // RECEIVERS))
    rows, columns = rows[::stride], columns[::stride]
    receivers = _positions(small, frame.view_depth, rows, columns)
    normals = frame.normal[rows, columns].astype(np.float64)
    cosine = np.clip(normals @ sun.to_light, FACING, 1.0)
    in_light = np.abs(normals @ frame.cascades.light_from_world[0][:2, :3].T)
    edges = _edges(small, frame, judged, lit, shrink)
    distances, layered = _blockers(frame, edges)
    index = frame.cascade_index[facing]
    return View(
        camera=camera,
        sun=sun,
        pixel_count=facing.size,
        seen_count=int(np.count_nonzero(frame.valid)),
        facing_count=count,
        shadowed_count=int(np.count_nonzero(judged & ~lit)),
        receivers=frozen(receivers),
        receiver_depths=frozen(frame.view_depth[rows, columns].astype(np.float64)),
        slopes=frozen(np.sqrt(1.0 / cosine**2 - 1.0)),
        gradients=frozen(in_light.sum(axis=1) / cosine),
        gaps=frozen(_gaps(frame, receivers, rows, columns)),
        edges=frozen(edges["point"]),
        edge_normals=frozen(edges["normal"]),
        edge_across=frozen(edges["across"]),
        edge_lengths=frozen(edges["length"]),
        blocker_distances=frozen(distances),
        thin_share=_thin_share(frame),
        layered_share=float(layered),
        triangles=tuple(int(n) for n in frame.info["triangles_drawn"]),
        needless_chunks=int(sum(frame.info["chunks_culled_exclusive"])),
        cascade_shares=tuple(
            float(np.count_nonzero(index == i) / max(count, 1)) for i in range(PROBE.cascade_count)
        ),
    ), (faces, bias)


def _positions(camera, view_depth, rows, columns):
    """World points (m, 3) of pixels."""
    x, y = camera.pixel_plane()
    across = x[columns, None] * camera.right + y[rows, None] * camera.up
    depth = view_depth[rows, columns].astype(np.float64)[:, None]
    if camera.orthographic:
        return camera.eye + across - depth * camera.backward
    return camera.eye + depth * (across - camera.backward)


def _edges(camera, frame, judged, lit, shrink):
    """Places of neighbouring judged pixels on different sides of 0.5."""
    smooth = _smoothed(lit.astype(np.float64))
    # along a side of one pixel nothing changes, and there is nothing to take a difference of
    slope_y, slope_x = (
        np.gradient(smooth, axis=axis) if smooth.shape[axis] > 1 else np.zeros_like(smooth)
        for axis in (0, 1)
    )
    parts = []
    for axis, (one, other) in enumerate(
        (
            (np.s_[:, :-1], np.s_[:, 1:]),
            (np.s_[:-1, :], np.s_[1:, :]),
        )
    ):
        rows, columns = np.nonzero(judged[one] & judged[other] & (lit[one] != lit[other]))
        step = (rows + axis, columns + 1 - axis)
        across = np.stack(
            [slope[rows, columns] + slope[step] for slope in (slope_x, slope_y)], axis=1
        )
        length = np.linalg.norm(across, axis=1, keepdims=True)
        along_axis = np.eye(2)[axis]
        across = np.where(length > 1e-9, across / np.where(length > 1e-9, length, 1.0), along_axis)
        dark_first = ~lit[rows, columns]
        dark = (np.where(dark_first, rows, step[0]), np.where(dark_first, columns, step[1]))
        parts.append((dark[0], dark[1], across, shrink * np.abs(across[:, axis])))
    every = max(1, -(-sum(len(part[0]) for part in parts) // EDGES))
    rows, columns, across, length = (
        np.concatenate(column)[::every] for column in zip(*parts, strict=True)
    )
    length = length * every
    return {
        "rows": rows,
        "columns": columns,
        "point": _positions(camera, frame.view_depth, rows, columns),
        "normal": frame.normal[rows, columns].astype(np.float64),
        "across": across,
        "length": length,
    }


def _smoothed(values):
    """Binomial mean over 5 x 5 pixels: the direction of an edge of pixels, not of a stair."""
    padded = np.pad(values, 2, mode="edge")
    rows = sum(w * padded[k : k + values.shape[0]] for k, w in enumerate((1, 4, 6, 4, 1)))
    return sum(w * rows[:, k : k + values.shape[1]] for k, w in enumerate((1, 4, 6, 4, 1))) / 256.0


def _gaps(frame, points, rows, columns):
    """Distance [m] from dark pixels to what the coarse map holds before them; inf for lit ones."""
    gaps = np.full(len(rows), np.inf)
    index = frame.cascade_index[rows, columns]
    dark = frame.mask[rows, columns] < LIT
    for i in range(frame.cascades.count):
        on = np.flatnonzero(dark & (index == i))
        size = frame.shadow_maps[i].shape[0]
        uvz = transform_points(frame.cascades.uvz_from_world[i], points[on])
        u, v = np.clip((uvz[:, :2] * size).astype(int), 0, size - 1).T
        span = float(np.diff(frame.cascades.depth_range[i])[0])
        gaps[on] = np.maximum((uvz[:, 2] - frame.shadow_maps[i][v, u]) * span, 0.0)
    return gaps


def _blockers(frame, edges):
    """Occluders' distances [m] at the dark side of edges, and the share with layers of them."""
    cascades = frame.cascades
    distances = np.zeros(len(edges["rows"]))
    layered = 0
    index = frame.cascade_index[edges["rows"], edges["columns"]]
    for i in range(cascades.count):
        on = np.flatnonzero(index == i)
        if not len(on):
            continue
        depths = frame.shadow_maps[i]
        size = depths.shape[0]
        uvz = transform_points(cascades.uvz_from_world[i], edges["point"][on])
        texel = np.clip((uvz[:, :2] * size).astype(int), 1, size - 2)
        around = np.stack(
            [depths[texel[:, 1] + dv, texel[:, 0] + du] for dv in (-1, 0, 1) for du in (-1, 0, 1)],
            axis=1,
        ).astype(np.float64)
        span = float(np.diff(cascades.depth_range[i])[0])
        gap = (uvz[:, 2:] - around) * span
        t = float(cascades.texel_size[i].max())
        gap = np.where(gap > 0.5 * t, gap, np.nan)  # nearer ones are the surface itself
        with np.errstate(all="ignore"):
            near = np.where(np.isnan(gap).all(axis=1), 0.0, _nan_min(gap))
            far = np.where(np.isnan(gap).all(axis=1), 0.0, -_nan_min(-gap))
        distances[on] = np.where(near > 0.0, 0.5 * (near + far), 0.5 * t)
        layered += int(np.count_nonzero(far > LAYER_RATIO * np.maximum(near, 2.0 * t)))
    return distances, layered / max(len(distances), 1)


def _nan_min(values):
    return np.where(np.isnan(values), np.inf, values).min(axis=1)


def _thin_share(frame):
    """Share of casters' texels before something else on both sides within two texels."""
    thin = casters = 0
    for i, depths in enumerate(frame.shadow_maps):
        if not (depths < 1.0).any():
            continue
        span = float(np.diff(frame.cascades.depth_range[i])[0])
        jump = 4.0 * float(frame.cascades.texel_size[i].max()) / span
        behind = np.zeros(depths.shape, bool)
        for axis in (0, 1):
            ahead = np.zeros(depths.shape, bool)
            after = np.zeros(depths.shape, bool)
            for step in range(1, THIN_TEXELS + 1):
                ahead |= np.roll(depths, step, axis) - depths > jump
                after |= np.roll(depths, -step, axis) - depths > jump
            behind |= ahead & after
            casters += 0.5 * np.count_nonzero(ahead | after)
        thin += np.count_nonzero(behind)
    return float(min(thin / casters, 1.0)) if casters else 0.0


def _summary(scene, views, cameras, suns, changes, spent):
    """Gather the views' numbers."""
    first = views[0]

    def pooled(name):
        return np.concatenate([getattr(view, name) for view in views])

    def worst(name):
        return max(getattr(view, name) for view in views)

    facing = sum(view.facing_count for view in views)
    seen = sum(view.seen_count for view in views)
    depths = np.maximum(pooled("receiver_depths"), 1e-9)
    low, high = (depths.min(), depths.max()) if len(depths) else (1.0, 1.0)
    bins = np.geomspace(low, max(high, low * (1.0 + 1e-9)), DEPTH_BINS + 1)
    counts = np.histogram(np.clip(depths, bins[0], bins[-1]), bins)[0] / max(len(depths), 1)
    near, far = np.percentile(depths, (1, 99)) if len(depths) else (1.0, 1.0)
    penumbra = np.concatenate([view.penumbra_widths() for view in views])
    fitted = fit_cascades(
        first.camera, first.sun, PROBE.replace(fit="sphere", cascade_count=1), scene=scene
    )
    factor = float(
        np.prod([a / b for a, b in zip(first.camera.size, _coarse_size(first), strict=True)])
    )
    length = sum(float(view.edge_lengths.sum()) for view in views)
    return Signals(
        views=views,
        seen_share=seen / sum(view.pixel_count for view in views),
        facing_share=facing / max(seen, 1),
        shadowed_share=sum(view.shadowed_count for view in views) / max(facing, 1),
        depth_edges=frozen(bins),
        depth_shares=frozen(counts),
        depth_ratio=float(far / near),
        cascade_shares=first.cascade_shares,
        casters=first.triangles,
        needless_chunks=worst("needless_chunks"),
        slope_percentiles=frozen(_percentiles(pooled("slopes"), (50, 90, 99))),
        bias_slope=float(_percentiles(pooled("gradients"), (50,))[0]),
        edge_share=length / max(facing * factor, 1.0),
        penumbra_pixels=frozen(_percentiles(penumbra, (50, 90, 99))),
        thin_share=worst("thin_share"),
        layered_share=worst("layered_share"),
        light_view_angle_deg=math.degrees(
            math.acos(np.clip(-first.camera.backward @ first.sun.to_light, -1.0, 1.0))
        ),
        sun_elevation_deg=math.degrees(math.asin(np.clip(first.sun.to_light[1], -1.0, 1.0))),
        depth_span=float(np.diff(fitted.depth_range[0])[0]),
        origin_distance=float(np.linalg.norm(first.camera.eye - scene.origin)),
        orthographic=first.camera.orthographic,
        camera_moves=len(cameras) > 1 and any(one != cameras[0] for one in cameras[1:]),
        sun_moves=len(suns) > 1 and any(one != suns[0] for one in suns[1:]),
        faces_matter=float(changes[0]),
        bias_matters=float(changes[1]),
        scene_triangles=int(scene.triangle_count),
        renders_ms=spent,
    )


def _coarse_size(view):
    return coarse_camera(view.camera)[0].size


def _percentiles(values, at):
    return np.percentile(values, at) if len(values) else np.zeros(len(at))
