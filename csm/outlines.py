"""The geometry that `csm.plot` draws: slices and windows as corners, texels as lines and boxes.

Arrays in, arrays out; no picture is made here. Windows are read from `uvz_from_world` alone, so
whatever made the matrices (a skewed light, a warp, another engine) is shown as it is.
"""

import numpy as np

from . import _core, shapes
from .mesh import Mesh
from .sampling import NO_CASCADE
from .scene import Scene
from .spaces import transform_points

__all__ = [
    "EDGES",
    "column_hits",
    "convex_hull",
    "first_map",
    "footprint",
    "lattice_phases",
    "pixel_points",
    "slice_corners",
    "slice_outline",
    "texel_boxes",
    "texel_grid",
    "texel_lines",
    "visible_slice",
    "window_corners",
]

# Of corners in the order of the core: left bottom, left top, right top, right bottom; near, far.
EDGES = np.array(
    [(k, (k + 1) % 4) for k in range(4)]
    + [(4 + k, 4 + (k + 1) % 4) for k in range(4)]
    + [(k, 4 + k) for k in range(4)]
)
FACES = np.array(
    [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
)
SQUARE = np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)])
LEAST_W = 1e-9  # nearer to the eye of a warped map nothing has an image
HALF_FOR_SURE = 1e-6  # texels, above what rounding leaves of a half


def slice_corners(camera, near, far):
    """Corners of the part of a camera's view between two depths [m], (8, 3) world points."""
    return _core.frustum_corners(camera, near, far)


def visible_slice(cascades, cascade, select):
    """View depths [m] whose points may look a map up, by the rule of selection.

    Parameters
    ----------
    cascades : Cascades
    cascade : int
    select : {"map", "frustum", "interval"}
        ``"interval"``: those of the cascade's own slice; otherwise all from there to the end of
        the range, as a map answers for what it holds beyond its slice, and finer maps for what
        lies before it.

    Returns
    -------
    near, far : float

    Raises
    ------
    ValueError
        If `select` is another word.
    """
    if select not in ("map", "frustum", "interval"):
        raise ValueError(f"select must be map, frustum or interval (got {select!r})")
    last = cascade + 1 if select == "interval" else -1
    return float(cascades.splits[cascade]), float(cascades.splits[last])


def window_corners(cascades, cascade, depths=(0.0, 1.0)):
    """Corners of what a map holds between two of its depths, (8, 3) world points."""
    uvz = np.column_stack([np.tile(SQUARE, (2, 1)), np.repeat(depths, 4)])
    return transform_points(np.linalg.inv(cascades.uvz_from_world[cascade]), uvz)


def footprint(cascades, cascade, height, uv=SQUARE):
    """Where the light through points of a map meets a horizontal plane.

    Parameters
    ----------
    cascades : Cascades
    cascade : int
    height : float
        World y of the plane [m].
    uv : (..., 2) array_like
        Points of the map, 0 to 1; its corners unless given.

    Returns
    -------
    points : (..., 2) float64
        World x and z [m]; not finite where the light runs along the plane.
    """
    uv = np.asarray(uv, np.float64)
    world_from_uvz = np.linalg.inv(cascades.uvz_from_world[cascade])
    ends = [
        transform_points(world_from_uvz, np.concatenate([uv, np.full((*uv.shape[:-1], 1), z)], -1))
        for z in (0.0, 1.0)
    ]
    along = ends[1] - ends[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (height - ends[0][..., 1]) / along[..., 1]
        return (ends[0] + share[..., None] * along)[..., ::2]


def texel_grid(cascades, cascade, height, every):
    """Borders of texels on a horizontal plane, every so many texels of the world's lattice.

    Parameters
    ----------
    cascades : Cascades
    cascade : int
    height : float
        World y of the plane [m].
    every : int
        Texels from line to line. Lines are counted from the lattice's origin, so that the same
        lines are drawn wherever the window is.

    Returns
    -------
    lines : (k, 2, 2) float64
        World x and z [m] of both ends of each line.
    """
    size = int(cascades.map_size[cascade])
    lines = []
    for axis in (0, 1):
        first = -int(cascades.lattice[cascade, axis]) % every
        at = np.arange(first, size + 1, every) / size
        uv = np.empty((len(at), 2, 2))
        uv[:, :, axis] = at[:, None]
        uv[:, :, 1 - axis] = (0.0, 1.0)
        lines.append(footprint(cascades, cascade, height, uv))
    return np.concatenate(lines)


def convex_hull(points):
    """Corners of the convex hull of points (m, 2), counter-clockwise: Andrew's monotone chain."""
    points = np.unique(np.asarray(points, np.float64), axis=0)
    if len(points) < 3:
        return points

    def chain(ordered):
        hull = []
        for point in ordered:
            while len(hull) > 1:
                a, b = hull[-1] - hull[-2], point - hull[-2]
                if a[0] * b[1] - a[1] * b[0] > 0.0:
                    break
                hull.pop()
            hull.append(point)
        return hull[:-1]

    return np.array(chain(points) + chain(points[::-1]))


def slice_outline(cascades, cascade, camera, near, far):
    """Outline of a part of the view as a map shows it.

    Parameters
    ----------
    cascades : Cascades
    cascade : int
    camera : Camera
    near, far : float
        View depths [m].

    Returns
    -------
    outline : (k, 2) float64
        Corners in texels, counter-clockwise; not cut to the map.
    """
    corners = slice_corners(camera, near, far)
    homogeneous = np.column_stack([corners, np.ones(8)]) @ cascades.uvz_from_world[cascade].T
    kept = [homogeneous[homogeneous[:, 3] > LEAST_W]]
    # Where an edge passes the eye of a warped map it is cut: the rest of it has no image.
    start, end = homogeneous[EDGES[:, 0]], homogeneous[EDGES[:, 1]]
    crossing = (start[:, 3] > LEAST_W) != (end[:, 3] > LEAST_W)
    start, end = start[crossing], end[crossing]
    share = (LEAST_W - start[:, 3]) / (end[:, 3] - start[:, 3])
    kept.append(start + share[:, None] * (end - start))
    points = np.concatenate(kept)
    uv = points[:, :2] / points[:, 3:]
    return convex_hull(uv) * int(cascades.map_size[cascade])


def column_hits(cascades, cascade, camera, near, far):
    """Texels whose column, the light through the texel's centre, meets a part of the view.

    Parameters
    ----------
    cascades : Cascades
    cascade : int
    camera : Camera
    near, far : float
        View depths [m].

    Returns
    -------
    hits : (size, size) bool
        ``[v, u]``, v = 0 at the bottom. Its mean is the map's utilisation.
    """
    size = int(cascades.map_size[cascade])
    world_from_uvz = np.linalg.inv(cascades.uvz_from_world[cascade])
    # w of the world has one sign over a map that can be looked up at all.
    centre_w = world_from_uvz[3] @ (0.5, 0.5, 0.5, 1.0)
    planes = _core.frustum_planes(camera, near, far) @ (world_from_uvz * np.sign(centre_w))
    at = (np.arange(size) + 0.5) / size
    first, last = np.zeros((size, size)), np.ones((size, size))
    for a, b, c, d in planes:
        beside = a * at[None, :] + b * at[:, None] + d  # inside where beside + c z >= 0
        if c == 0.0:
            last[beside < 0.0] = -1.0
        elif c > 0.0:
            np.maximum(first, beside / -c, out=first)
        else:
            np.minimum(last, beside / -c, out=last)
    return first <= last


def lattice_phases(path, cascade, point):
    """Where a fixed world point lies within its texel, from frame to frame.

    Parameters
    ----------
    path : sequence of Cascades
        One per frame.
    cascade : int
    point : (3,) array_like
        World point [m]; it need not lie in the map, the lattice goes on.

    Returns
    -------
    phases : (m, 2) float64
        Along u and v in texels, relative to the first frame, above -0.5 and up to 0.5. All 0 where
        the texel grid falls onto itself.
    """
    point = np.asarray(point, np.float64)
    texels = np.array(
        [
            transform_points(frame.uvz_from_world[cascade], point)[:2] * frame.map_size[cascade]
            for frame in path
        ]
    )
    moved = texels - texels[0]
    moved -= np.round(moved)
    # Half a texel either way is one place, whichever way its last bits point.
    return np.where(moved < HALF_FOR_SURE - 0.5, moved + 1.0, moved)


def pixel_points(frame):
    """World point under each pixel's centre, (h, w, 3) float64 [m]; NaN where nothing is seen."""
    camera = frame.camera
    x, y = camera.pixel_plane()
    depth = np.where(frame.valid, frame.view_depth.astype(np.float64), np.nan)[..., None]
    across = x[None, :, None] * camera.right + y[:, None, None] * camera.up
    if camera.orthographic:
        return np.where(np.isnan(depth), np.nan, camera.eye + across) - depth * camera.backward
    return camera.eye + depth * (across - camera.backward)


def texel_lines(cascades, index, points, every):
    """How strongly a border between texels shows at each pixel.

    Parameters
    ----------
    cascades : Cascades
    index : (h, w) uint8
        The cascade of each pixel, 255 for none.
    points : (h, w, 3) float64
        World point of each pixel [m]; NaN where nothing is seen.
    every : sequence of int
        Per cascade: texels from line to line.

    Returns
    -------
    strength : (h, w) float64
        1 within a quarter pixel of a line, 0 from a pixel and a quarter on; it fades where lines
        are less than four pixels apart, so that they never run together into a tone.
    """
    strength = np.zeros(index.shape)
    seen = np.isfinite(points).all(axis=-1)
    for i in range(cascades.count):
        own = seen & (index == i)
        if not own.any():
            continue
        uv = transform_points(cascades.uvz_from_world[i], points)[..., :2]
        # Counted from the lattice's origin, so that lines stay put while the window moves.
        cells = (uv * cascades.map_size[i] + cascades.lattice[i]) / every[i]
        for axis in (0, 1):
            coordinate = cells[..., axis]
            per_pixel = np.hypot(*np.gradient(coordinate))
            apart = 1.0 / np.maximum(per_pixel, 1e-12)  # pixels from line to line
            distance = np.abs(coordinate - np.round(coordinate)) * apart
            line = np.clip(1.25 - distance, 0.0, 1.0) * np.clip((apart - 2.0) / 2.0, 0.0, 1.0)
            strength = np.where(own & (line > strength), line, strength)
    return strength


def texel_boxes(frame):
    """Every stored texel put back into the world as a box of its own size.

    Parameters
    ----------
    frame : Frame
        With `shadow_maps`, drawn with ``cull="none"`` so that they hold everything.

    Returns
    -------
    scene : Scene
        A mesh ``cascade 0``, ``cascade 1``, … for each map that stored anything. The face of a box
        towards the sun lies at the stored depth; a texel whose point a finer map holds is left
        out.

    Raises
    ------
    ValueError
        If no map stored anything.
    """
    cascades = frame.cascades
    meshes = []
    for i, depth in enumerate(frame.shadow_maps):
        size = int(cascades.map_size[i])
        v, u = np.nonzero(depth < 1.0)
        uvz = np.column_stack([(u + 0.5) / size, (v + 0.5) / size, depth[v, u].astype(np.float64)])
        centres = transform_points(np.linalg.inv(cascades.uvz_from_world[i]), uvz)
        left = first_map(cascades, centres) >= i
        if left.any():
            corners = _box_corners(cascades, i, uvz[left, :2], centres[left])
            _, triangles = shapes.boxes(*np.zeros((2, len(corners), 3)))
            meshes.append(Mesh(corners.reshape(-1, 3), triangles, name=f"cascade {i}"))
    if not meshes:
        raise ValueError("frame.shadow_maps hold no caster: there is no texel to draw")
    return Scene(meshes, name="texels")


def _box_corners(cascades, cascade, uv, points):
    """Corners (m, 8, 3) of boxes between the light rays through the corners of texels.

    The faces towards the light hold the points (m, 3): one depth all over where the map has no
    warp, across the light otherwise. A box is as thick as its texel is wide there.
    """
    world_from_uvz = np.linalg.inv(cascades.uvz_from_world[cascade])
    unit_box = shapes.box((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0))[0]
    corner_uv = uv[:, None] + unit_box[:, :2] / int(cascades.map_size[cascade])
    near, far = (
        transform_points(
            world_from_uvz, np.concatenate([corner_uv, np.full((len(uv), 8, 1), z)], axis=-1)
        )
        for z in (0.0, 1.0)
    )
    down = -to_light(cascades, cascade)
    if not is_warped(cascades, cascade):
        down = cascades.uvz_from_world[cascade, 2, :3]
        down = down / np.linalg.norm(down)
    along = (far - near) / ((far - near) @ down)[..., None]
    front = near + ((points @ down)[:, None] - near @ down)[..., None] * along
    edges = front[:, (1, 4)] - front[:, :1]  # along u and v
    thick = np.linalg.norm(edges, axis=-1).max(axis=1)
    return front + (thick[:, None] * unit_box[:, 2])[..., None] * along


def to_light(cascades, cascade):
    """Unit vector (3,) along a map's light rays, towards the sun."""
    ends = window_corners(cascades, cascade)
    towards = ends[0] - ends[4]
    return towards / np.linalg.norm(towards)


def is_warped(cascades, cascade):
    """Whether texels of a map differ in size."""
    return not np.array_equal(cascades.uvz_from_world[cascade, 3], (0.0, 0.0, 0.0, 1.0))


def first_map(cascades, points):
    """Index of the first map that holds points (..., 3), 255 where none does; uint8."""
    index = np.full(points.shape[:-1], NO_CASCADE, np.uint8)
    for i in reversed(range(cascades.count)):
        uvz = transform_points(cascades.uvz_from_world[i], points)
        index[((uvz >= 0.0) & (uvz <= 1.0)).all(axis=-1)] = i
    return index
