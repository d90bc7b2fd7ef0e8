"""What a scene, seen by a camera under a sun, asks of its shadows: measured on coarse renders.

Nothing is traced. One to five frames of a quarter of the picture's width and height with small
maps say where shadow edges are, how far their occluders are, how surfaces stand to the sun; what
settings would make of that, `csm.forecasts` works out.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from . import _core
from .cascades import fit_cascades
from .caster_load import Casters, sample_casters
from .caster_sides import FACES_SHARE, Sides, measure_sides
from .coarse_look import (
    blockers_of,
    edges_of,
    facing_of,
    gaps_of,
    layered_share_of,
    look_at_pixels,
    outline_of,
    receivers_of,
    thin_share_of,
)
from .horizons import ends_of
from .sampling import LIT
from .settings import ShadowSettings
from .spaces import frozen, light_gradients
from .tasks import begin

__all__ = ["Signals", "View", "measure_signals"]

COARSE = 4  # pixels of the picture along a pixel of the coarse one
LEAST_SIZE = 160  # of a coarse picture, along its shorter side: smaller ones lose what is thin
READERS = 2  # threads that read a frame while the next ones are drawn
NEAREST = 1e-9  # [m] of view depths, for their ratios

#: The coarse maps: four, so that casters and receivers of each are counted.
PROBE = ShadowSettings(map_size=512, fit="visible", snap="none", cull="exclusive")
#: One map over all that is drawn, whose depth range says how long they are.
WHOLE = PROBE.replace(fit="sphere", cascade_count=1)
HORIZON = ShadowSettings(filter="none")
HORIZON_OUTPUTS = ("valid", "view_depth", "normal")
PROBE_OUTPUTS = ("mask", "valid", "view_depth", "normal", "cascade_index", "shadow_maps")


@dataclass(frozen=True, eq=False)
class View:
    """One camera under one sun, coarsely: arrays of what it sees.

    Receivers, edges and outline are each in the order of view depth.

    Attributes
    ----------
    camera : Camera
        At its full size.
    sun : Sun
    pixel_count, seen_count, facing_count, shadowed_count : int
        Of the coarse picture: all, with a surface, facing the sun, and of those in shadow.
    receivers : (m, 3) float64
        World points of surfaces that face the sun, at most some thousands.
    outline : (k, 3) float64
        The outermost of all such points, across the light and in slices of depth; planes are
        followed between the coarse pixels where they end.
    receiver_depths : (m,) float64
        View depths of the receivers [m].
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
        Of the casters' texels in the coarse maps; of the receivers in full shadow.
    triangles : tuple of int
        Drawn for each of the coarse maps.
    casters : Casters
        A sample of the triangles that cast.
    layers : tuple of float
        How often they cover each of the coarse maps, on average, all their sides counted.
    needless_chunks : int
        That exclusive culling left out of them.
    cascade_shares : tuple of float
        Receivers in each of them.
    axes : (2, 3) float64
        Unit vectors across the light: `light_gradients`.
    """

    camera: object
    sun: object
    pixel_count: int
    seen_count: int
    facing_count: int
    shadowed_count: int
    receivers: np.ndarray
    outline: np.ndarray
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
    casters: Casters
    layers: tuple[float, ...]
    needless_chunks: int
    cascade_shares: tuple[float, ...]
    axes: np.ndarray

    @cached_property
    def held(self):
        """What windows are fitted to (m + e + k, 3): receivers, edges, outline."""
        return frozen(np.concatenate([self.receivers, self.edges, self.outline]))

    @cached_property
    def held_depths(self):
        """View depths of those (m + e + k,) [m], ascending within each of the three."""
        depths = (self.held - self.camera.eye) @ -self.camera.backward
        ends = np.cumsum([len(self.receivers), len(self.edges), len(self.outline)])
        for some in np.split(depths, ends[:-1]):
            np.maximum.accumulate(some, out=some)  # in order but for rounding
        return frozen(depths)

    @cached_property
    def steps_across(self):
        """How far a metre along each of `light_gradients` leads across each edge (e, 2) [pixels].

        Pixels of the full picture.
        """
        steps = _core.surface_steps(self.camera, self.edges, self.edge_normals, self.axes)
        return np.einsum("ea,eak->ek", self.edge_across, steps)

    def penumbra_widths(self):
        """Width of the sun's penumbra at every edge [pixels of the full picture].

        A disc of diameter d degrees makes a penumbra ``2 tan(d / 2)`` times the occluder's distance
        wide, across the light; how wide that is in the picture, `steps_across` says.

        Returns
        -------
        widths : (e,) float64
        """
        return self._penumbrae

    @cached_property
    def _penumbrae(self):
        return frozen(self.penumbra_metres() * np.linalg.norm(self.steps_across, axis=1))

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
    layers : tuple of float
        How often triangles cover each of those, on average, all their sides counted.
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
    penumbra_metres : float
        90th percentile of that across the light [m], of the widest view.
    thin_share : float
        Of casters' texels in maps of 512² that belong to casters at most two texels wide.
    layered_share : float
        Of receivers in full shadow over which occluders lie in layers, such as two of which one is
        twice as far: more than a tenth of the light bleeds there under variance shadow maps.
    light_view_angle_deg : float
        Between the view and the way to the sun; near 180 the sun is behind the camera, near 0 in
        the face of it (duelling frusta at both).
    sun_elevation_deg : float
        Of a path the lowest.
    depth_span : float
        Of the maps' depth range [m]; the longest of all views.
    origin_distance : float
        Of the camera from the scene's origin [m].
    orthographic : bool
        Whether any camera of a path is.
    camera_moves, sun_moves : bool
        A path was given.
    front_matters : float
        Share of the facing pixels that change when front sides alone cast; 1, unmeasured, where
        nothing is in shadow, too few pixels face the sun to say, or hardly a side does not.
    faces_matter : float
        Share of them that change when back sides alone cast; 1, unmeasured, where front sides do.
    bias_matters : float
        Share of them that change when, besides, nothing is biased; 0, unmeasured, where
        `faces_matter` is small, or shadows are lost, without a bias.
    back_gain : float
        Of the pixels that the coarse maps get wrong, against finer ones, the share that back sides
        alone spare; 0 where that was not asked.
    lit_area : float
        Of the casters' area across the light, the share that faces it.
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
    layers: tuple[float, ...]
    needless_chunks: int
    slope_percentiles: np.ndarray
    bias_slope: float
    edge_share: float
    penumbra_pixels: np.ndarray
    penumbra_metres: float
    thin_share: float
    layered_share: float
    light_view_angle_deg: float
    sun_elevation_deg: float
    depth_span: float
    origin_distance: float
    orthographic: bool
    camera_moves: bool
    sun_moves: bool
    front_matters: float
    faces_matter: float
    bias_matters: float
    back_gain: float
    lit_area: float
    scene_triangles: int

    @property
    def pixels(self):
        """Number of pixels of the full picture."""
        width, height = self.views[0].camera.size
        return width * height

    def to_dict(self):
        """Return the numbers as plain values, without the views."""
        plain = {}
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if name != "views":
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
    views, sides = [], []
    with ThreadPoolExecutor(READERS) as beside:
        for number in taken:
            camera, sun = cameras[min(number, len(cameras) - 1)], suns[min(number, len(suns) - 1)]
            view, seen = _look(renderer, scene, camera, sun, beside)
            sides.append(seen)
            views.append(view)
    return _summary(scene, tuple(views), cameras, suns, sides)


def coarse_camera(camera):
    """Camera of the coarse picture, and how many pixels of the full one are one of its."""
    shrink = _shrink_of(camera)
    size = _coarse_size(camera)
    return camera.replace(
        size=size, half_width=camera.half_width, half_height=camera.half_height
    ), shrink


def _shrink_of(camera):
    return max(1.0, min(COARSE, min(camera.size) / LEAST_SIZE))


def _coarse_size(camera):
    shrink = _shrink_of(camera)
    return tuple(max(1, round(side / shrink)) for side in camera.size)


def _look(renderer, scene, camera, sun, beside):
    """Render one view coarsely and read it, the one beside the other."""
    render = partial(renderer.render, timed=False)  # what waits for passes waits for each of them
    axes = light_gradients(sun)
    sample = begin(beside, sample_casters, scene, axes)
    small, shrink = coarse_camera(camera)
    # only even splits can begin at or behind an orthographic camera
    probe = PROBE if camera.near > 0.0 else PROBE.replace(split="uniform")
    frame = render(scene, small, sun, probe, outputs=PROBE_OUTPUTS)
    look = look_at_pixels(frame, sun, PROBE.cascade_count)

    def again(finer=1, **changes):
        settings = probe.replace(map_size=finer * PROBE.map_size, **changes)
        # what the camera sees stays, so that maps alone are drawn anew
        other = render(scene, small, sun, settings, outputs=("mask",), reuse="same")
        return other.mask >= LIT

    casters = sample.result()
    plain = [(small, frame.view_depth, look.facing)]
    outlined = begin(beside, _outlined, camera, plain, frame, scene, axes)
    fields = [
        begin(beside, _casters, casters, frame, look),
        begin(beside, _edges, small, frame, look, shrink),
        begin(beside, _receivers, small, frame, look, sun),
    ]
    # where nothing is in shadow no picture says which sides of casters are needed
    sides = (
        measure_sides(casters.lit_area, look.lit, look.judged, look.facing_count, again)
        if look.shadowed_count
        else Sides(1.0, lit_area=casters.lit_area)
    )
    ends, part, outline = outlined.result()
    if part is not None:
        fine = render(scene, part, sun, HORIZON, outputs=HORIZON_OUTPUTS)
        pictures = [*plain, (part, fine.view_depth, facing_of(fine, sun))]
        outline = outline_of(pictures, ends, axes)
    outline = _ordered({"point": outline}, outline @ -camera.backward)["point"]
    view = {name: value for some in fields for name, value in some.result().items()}
    return View(camera=camera, sun=sun, outline=frozen(outline), axes=frozen(axes), **view), sides


def _outlined(camera, pictures, frame, scene, axes):
    """Ends of planes, the part at their horizon, and the outline of all, if there is no part."""
    ((small, _, facing),) = pictures
    ends, part = ends_of(camera, small, frame, facing, scene.bounds)
    return ends, part, outline_of(pictures, ends, axes) if part is None else None


def _ordered(arrays, depths):
    """Arrays of points in the order of depth."""
    order = np.argsort(depths, kind="stable")
    return {name: values.take(order, axis=0) for name, values in arrays.items()}


def _receivers(small, frame, look, sun):
    """What the first frame says of surfaces that face the sun: fields of `View`."""
    receivers = receivers_of(small, frame, look, sun)
    receivers = _ordered(receivers, receivers["depth"])
    return dict(
        pixel_count=look.facing.size,
        seen_count=look.seen_count,
        facing_count=look.facing_count,
        shadowed_count=look.shadowed_count,
        receivers=frozen(receivers["point"]),
        receiver_depths=frozen(receivers["depth"]),
        slopes=frozen(receivers["slope"]),
        gradients=frozen(receivers["gradient"]),
        gaps=frozen(gaps_of(frame, receivers)),
        layered_share=layered_share_of(frame, receivers),
    )


def _edges(small, frame, look, shrink):
    """What it says of shadow edges."""
    edges = edges_of(small, frame, look.judged, look.lit, shrink)
    edges = _ordered(edges, frame.view_depth[edges["rows"], edges["columns"]])
    return dict(
        edges=frozen(edges["point"]),
        edge_normals=frozen(edges["normal"]),
        edge_across=frozen(edges["across"]),
        edge_lengths=frozen(edges["length"]),
        blocker_distances=frozen(blockers_of(frame, edges)),
    )


def _casters(casters, frame, look):
    """What it says of casters, of which some are kept."""
    kept = casters.thinned(frame.cascades)
    return dict(
        thin_share=thin_share_of(frame),
        triangles=tuple(int(n) for n in frame.info["triangles_drawn"]),
        casters=kept,
        layers=tuple(kept.load(frame.cascades).layers.sum(axis=(1, 2)).tolist()),
        needless_chunks=int(sum(frame.info["chunks_culled_exclusive"])),
        cascade_shares=tuple(n / max(look.facing_count, 1) for n in look.cascade_counts),
    )


def _summary(scene, views, cameras, suns, sides):
    """Gather the views' numbers."""
    first = views[0]

    def pooled(name):
        return _joined([getattr(view, name) for view in views])

    def worst(name):
        return max(getattr(view, name) for view in views)

    facing = sum(view.facing_count for view in views)
    seen = sum(view.seen_count for view in views)
    depths = np.maximum(pooled("receiver_depths"), NEAREST)
    bins, counts = _core.depth_histogram(depths)
    near, far = _core.percentiles(depths, (1, 99)) if len(depths) else (1.0, 1.0)
    penumbra = [view.penumbra_widths() for view in views]
    fitted = [fit_cascades(view.camera, view.sun, WHOLE, scene=scene) for view in views]
    (width, height), (coarse_width, coarse_height) = first.camera.size, _coarse_size(first.camera)
    factor = width / coarse_width * (height / coarse_height)
    length = sum(float(view.edge_lengths.sum()) for view in views)
    return Signals(
        views=views,
        seen_share=seen / sum(view.pixel_count for view in views),
        facing_share=facing / max(seen, 1),
        shadowed_share=sum(view.shadowed_count for view in views) / max(facing, 1),
        depth_edges=frozen(bins),
        depth_shares=frozen(counts / max(len(depths), 1)),
        depth_ratio=float(far / near),
        cascade_shares=first.cascade_shares,
        casters=first.triangles,
        layers=first.layers,
        needless_chunks=worst("needless_chunks"),
        slope_percentiles=frozen(_core.percentiles(pooled("slopes"), (50, 90, 99))),
        bias_slope=float(_core.percentiles(pooled("gradients"), (50,))[0]),
        edge_share=length / max(facing * factor, 1.0),
        penumbra_pixels=frozen(_core.percentiles(_joined(penumbra), (50, 90, 99))),
        penumbra_metres=max(
            float(_core.percentiles(view.penumbra_metres(), (90,))[0]) for view in views
        ),
        thin_share=worst("thin_share"),
        layered_share=worst("layered_share"),
        light_view_angle_deg=math.degrees(
            math.acos(_cosine(float(-first.camera.backward @ first.sun.to_light)))
        ),
        sun_elevation_deg=min(
            math.degrees(math.asin(_cosine(float(sun.to_light[1])))) for sun in suns
        ),
        depth_span=max(float(one.depth_range[0, 1] - one.depth_range[0, 0]) for one in fitted),
        origin_distance=float(np.linalg.norm(first.camera.eye - scene.origin)),
        orthographic=any(camera.orthographic for camera in cameras),
        camera_moves=len(cameras) > 1 and any(one != cameras[0] for one in cameras[1:]),
        sun_moves=len(suns) > 1 and any(one != suns[0] for one in suns[1:]),
        front_matters=max(one.front for one in sides),
        faces_matter=max(one.back for one in sides),
        bias_matters=max(one.bias for one in sides),
        # where back sides change hardly a pixel, what they gain was not asked
        back_gain=min((one.gain for one in sides if one.back > FACES_SHARE), default=0.0),
        lit_area=max(one.lit_area for one in sides),
        scene_triangles=int(scene.triangle_count),
    )


def _joined(arrays):
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def _cosine(value):
    """What rounding has led out of [-1, 1], at its end."""
    return max(-1.0, min(value, 1.0))
