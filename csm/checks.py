"""Cascades proved sound, or not: gaps, overflow, depth, a texel grid that moves."""

from dataclasses import dataclass

import numpy as np

from . import _core
from .camera import Camera
from .cascades import Cascades
from .spaces import as_number, frozen, real_array

__all__ = ["CascadeCheck", "CheckProblem", "check_cascades"]

KINDS = ("gap", "overflow", "depth", "lattice", "extent", "handedness")
SELECTS = ("interval", "map", "frustum")
# Rasterisers place vertices on a grid of 1/256 texel: a smaller miss moves nothing of its own.
TOLERANCE_TEXELS = 1.0 / 256.0
QUANTUM_TOLERANCE = 1.0 / 64.0
# Of a depth range stored with 16 bits, with 24, and as float32 in its upper half.
QUANTA = (65535.0, 16777215.0, 16777216.0)


@dataclass(frozen=True)
class CheckProblem:
    """One thing that is wrong with one cascade in one frame.

    Attributes
    ----------
    kind : {"gap", "overflow", "depth", "lattice", "extent", "handedness"}
    cascade, frame : int
    amount : float
        How much, in `unit`.
    unit : str
        ``"texels"``, ``"m"``, ``"share of receivers"``, ``"quanta"`` or ``""``.
    text : str
        The same as a sentence.
    points : tuple of (float, float, float)
        World points where it shows [m]; empty where it shows everywhere.
    """

    kind: str
    cascade: int
    frame: int
    amount: float
    unit: str
    text: str
    points: tuple = ()


@dataclass(frozen=True, eq=False, repr=False)
class CascadeCheck:
    """What `check_cascades` found; ``print`` shows it as a table.

    Attributes
    ----------
    problems : tuple of CheckProblem
        In the order of frames, then cascades; empty for sound cascades.
    frame_count : int
    select : {"interval", "map", "frustum"}
    splits : (n + 1,) float64
        View depths of the first frame [m].
    map_size : (n,) int32
        Of the first frame.
    utilisation : (n,) float64
        Share of texels whose column meets the visible slice, mean over the frames. With selection
        by map or frustum a map serves all of the view from its slice on, and that is counted.
    overlap : (n, n) float64
        ``overlap[i, j]``: share of slice i (of its volume, or of its receivers) that map j holds,
        mean over the frames. The diagonal of sound cascades is 1 under ``select="interval"``.
    texels_per_pixel : (n, 2) float64
        Lowest and highest over slice and frames: side of a pixel over side of a texel, both at
        the point, for a surface that faces camera and light. Below 1 texels are seen. NaN where
        nothing of a slice is visible.
    texel_size : (n, 2) float64
        Along the map's x and y in the first frame [m]; under a warp at its centre.
    depth_span : (n,) float64
        Length of the depth range along the light in the first frame [m].
    """

    problems: tuple
    frame_count: int
    select: str
    splits: np.ndarray
    map_size: np.ndarray
    utilisation: np.ndarray
    overlap: np.ndarray
    texels_per_pixel: np.ndarray
    texel_size: np.ndarray
    depth_span: np.ndarray

    @property
    def ok(self):
        """Whether nothing is wrong."""
        return not self.problems

    @property
    def kinds(self):
        """The kinds of problem that occur, as a tuple in a fixed order."""
        found = {problem.kind for problem in self.problems}
        return tuple(kind for kind in KINDS if kind in found)

    @property
    def gap_points(self):
        """(k, 3) world points [m] that no map holds, of every gap."""
        points = [p for problem in self.problems if problem.kind == "gap" for p in problem.points]
        return np.array(points, np.float64).reshape(-1, 3)

    def __repr__(self):
        problems = f"{_counted(len(self.problems), 'problem')}: {', '.join(self.kinds)}"
        found = "ok" if self.ok else problems
        return f"CascadeCheck({found}; cascades={len(self.map_size)}, frames={self.frame_count})"

    def __str__(self):
        cascades = _counted(len(self.map_size), "cascade")
        lines = [
            f"{cascades}, {_counted(self.frame_count, 'frame')}, select {self.select}: "
            + ("sound" if self.ok else _counted(len(self.problems), "problem")),
            "",
            "cascade   from [m]     to [m]    map  texel [m]  depth [m]   used  texels per pixel",
        ]
        for i in range(len(self.map_size)):
            low, high = self.texels_per_pixel[i]
            density = f"{low:7.3g} to {high:.3g}" if np.isfinite(low) else "nothing visible"
            lines.append(
                f"{i:7d} {self.splits[i]:10.4g} {self.splits[i + 1]:10.4g} {self.map_size[i]:6d} "
                f"{self.texel_size[i].max():10.4g} {self.depth_span[i]:10.4g} "
                f"{self.utilisation[i]:6.1%}  {density}"
            )
        return "\n".join([*lines, *self._problem_lines()])

    def _problem_lines(self):
        groups = {}
        for problem in self.problems:
            groups.setdefault((KINDS.index(problem.kind), problem.cascade), []).append(problem)
        for (kind, cascade), group in sorted(groups.items()):
            worst = max(group, key=lambda problem: problem.amount)
            yield ""
            where = f"cascade {cascade}"
            if self.frame_count > 1:
                count = len({problem.frame for problem in group})
                where += f", {count} of {self.frame_count} frames, worst in {worst.frame}"
            yield f"{KINDS[kind]}: {where}"
            yield f"  {worst.text}"


def _counted(number, noun):
    return f"{number} {noun}{'s' * (number != 1)}"


def check_cascades(
    cascades,
    camera,
    *,
    select="interval",
    scene=None,
    receivers=None,
    border_texels=0,
):
    """Prove a set of cascades sound, or say what is wrong with it, where and by how much.

    Works from the clip matrices alone, so that somebody else's cascades
    (`Cascades.from_matrices`) are judged by the same measure as ours. Slices and windows are
    convex: what corners say holds for every point between them.

    Parameters
    ----------
    cascades : Cascades or sequence of Cascades
        A sequence is a path: one set per frame, all of as many cascades.
    camera : Camera or sequence of Camera
        As many as sets of cascades.
    select : {"interval", "map", "frustum"}
        How a receiver finds its map. ``"interval"``: a slice must lie in its own map, and what
        does not is `overflow`. ``"map"``, ``"frustum"``: any map will do, and what none holds is a
        `gap`.
    scene : Scene, optional
        Or anything with ``bounds`` (2, 3) [m]. Slices are cut to it, and its bounds are where
        casters may be. Without it a slice is all of its view frustum, sky and underground.
    receivers : (m, 3) array_like, optional
        Visible world points [m]: they alone are judged then. Those outside the camera's frustum are
        left out; those beyond the last split are gaps. For a path, one array for all frames or a
        sequence of arrays.
    border_texels : float
        Kernel radius that must stay free along a map's edges [texels].

    Returns
    -------
    check : CascadeCheck

    Raises
    ------
    TypeError, ValueError
        If frames do not correspond, an argument breaks its rule, or a matrix cannot be judged.

    Notes
    -----
    The kinds of problem: `gap`, a visible point in no map; `overflow`, part of a slice outside its
    own map, in texels; `depth`, part of a slice, or what the scene's bounds hold above it, outside
    the depth range, in metres, and over a path a depth range that moves by parts of its quanta
    while the texel grid stands still; `lattice`, the texel grid moves between frames, in texels of
    at most one half; `extent`, texel or map size changes between frames; `handedness`, a map is
    mirrored against the others, or looks along the light the other way.

    What counts as a miss: more than 1/256 texel (a rasteriser's own grid) or 2^-17 of the depth
    range, beyond the rounding of doubles at this distance from the world origin. Depth moves by
    whole quanta if they are quanta of 16 bits, 24 bits or float32. Casters are judged by the
    scene's bounds: what looks empty above a slice may hold one. Cascades with ``pancake`` lose
    none (docs/numerics.md 23).
    """
    sets, cameras, bounds, seen = matched_frames(cascades, camera, scene, receivers)
    if select not in SELECTS:
        raise ValueError(f"select must be one of {', '.join(SELECTS)} (got {select!r})")
    border = as_number("border_texels", border_texels, 0.0, 1e6, rule="a number >= 0")
    measured = [
        _core.coverage(
            frame_camera,
            one.clip_from_world,
            one.splits,
            one.map_size,
            select != "interval",
            border,
            TOLERANCE_TEXELS,
            scene_bounds=bounds,
            receivers=points,
        )
        for one, frame_camera, points in zip(sets, cameras, seen, strict=True)
    ]
    problems = []
    agreed = sum(one["mirrored"] for one in measured[0]) * 2 > len(measured[0])
    for frame, cascade_list in enumerate(measured):
        for i, found in enumerate(cascade_list):
            problems += _coverage_problems(
                sets[frame], i, frame, found, select, seen[frame], agreed
            )
        problems += _handedness_problems(sets[frame], frame, cascade_list, measured[0], agreed)
    for i in range(sets[0].count):
        problems += _motion_problems(sets, cameras, i)
    problems.sort(key=lambda problem: (problem.frame, problem.cascade, KINDS.index(problem.kind)))
    return CascadeCheck(
        problems=tuple(problems),
        frame_count=len(sets),
        select=select,
        splits=sets[0].splits,
        map_size=sets[0].map_size,
        **_figures(measured),
    )


# -- arguments -------------------------------------------------------------------------------------


def matched_frames(cascades, camera, scene, receivers):
    """Return cascades, cameras, bounds and receivers that correspond, or say why they do not."""
    sets, cameras = _frames(cascades, camera)
    return sets, cameras, _bounds(scene), _receivers(receivers, len(sets))


def _frames(cascades, camera):
    sets = [cascades] if isinstance(cascades, Cascades) else cascades
    cameras = [camera] if isinstance(camera, Camera) else camera
    for name, values, kind in (("cascades", sets, Cascades), ("camera", cameras, Camera)):
        if not isinstance(values, (list, tuple)) or not all(isinstance(v, kind) for v in values):
            raise TypeError(
                f"{name} must be a csm.{kind.__name__} or a list of them "
                f"(got {type(values).__name__})"
            )
    if len(sets) != len(cameras) or not sets:
        raise ValueError(
            f"a path needs one camera for each set of cascades, and one at least "
            f"(got {len(sets)} sets, {len(cameras)} cameras)"
        )
    counts = {one.count for one in sets}
    if len(counts) > 1:
        raise ValueError(
            f"the frames of a path must have as many cascades each (got {sorted(counts)})"
        )
    return sets, cameras


def _bounds(scene):
    if scene is None:
        return None
    if not hasattr(scene, "bounds"):
        raise TypeError(f"scene must be a csm.Scene or have bounds (got {type(scene).__name__})")
    bounds = real_array("scene.bounds", scene.bounds).astype(np.float64)
    if bounds.shape != (2, 3) or not np.isfinite(bounds).all() or (bounds[0] > bounds[1]).any():
        raise ValueError(f"scene.bounds must be (2, 3), finite, min <= max (got {bounds.tolist()})")
    return bounds


def _receivers(receivers, frames):
    """One array, or None, for each frame."""
    if receivers is None:
        return [None] * frames
    several = isinstance(receivers, (list, tuple)) and len(receivers) == frames
    if several and all(np.ndim(points) == 2 for points in receivers):
        return [_points(points) for points in receivers]
    return [_points(receivers)] * frames


def _points(receivers):
    points = real_array("receivers", receivers).astype(np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"receivers must be (m, 3) numbers (got shape {points.shape})")
    if not np.isfinite(points).all():
        raise ValueError("receivers must be finite")
    return points


# -- one frame -------------------------------------------------------------------------------------


def _place(point):
    return "({:.6g}, {:.6g}, {:.6g})".format(*point)


def _coverage_problems(cascades, i, frame, found, select, receivers, agreed):
    """Gap, overflow and depth of one cascade in one frame."""
    near, far = cascades.splits[i : i + 2]
    what = "receivers of" if receivers is not None else "part of"
    slice_text = f"{what} slice {i} ({near:.4g} to {far:.4g} m)"
    if len(found["gap_points"]):
        points = tuple(map(tuple, found["gap_points"].tolist()))
        if receivers is None:
            amount, unit = found["gap_texels"], "texels"
            text = f"{slice_text} in no map, up to {amount:.3g} texels outside its own"
        else:
            amount, unit = found["gap_share"], "share of receivers"
            text = f"{amount:.3%} of the {slice_text} in no map or beyond the last split"
        yield CheckProblem("gap", i, frame, amount, unit, f"{text}, as {_place(points[0])}", points)

    amount, point = found["overflow"]
    if select == "interval" and amount > found["tolerance_texels"]:
        metres = amount * max(found["texel_size"])
        text = f"{slice_text} {amount:.4g} texels ({metres:.3g} m) outside its map, at "
        yield CheckProblem("overflow", i, frame, amount, "texels", text + _place(point), (point,))

    span = f"depth range of {found['depth_span']:.4g} m"
    sides = {"before": "before the near", "behind": "behind the far"}
    depths = {
        name: (found[name], f"{slice_text} {{:.4g}} m {side}") for name, side in sides.items()
    }
    # which end casters stand before is in doubt only where a map disagrees with the others
    if not cascades.pancake and found["mirrored"] == agreed:
        text = "casters may stand {:.4g} m before the near"
        depths["caster"] = found["caster"], f"over slice {i} {text}"
    worst = max(depths.values(), key=lambda pair: pair[0][0])
    (amount, point), text = worst
    if amount > found["tolerance_depth"]:
        text = f"{text.format(amount)} end of its {span}, at {_place(point)}"
        yield CheckProblem("depth", i, frame, amount, "m", text, (point,))


def _handedness_problems(cascades, frame, measured, first, agreed):
    """Maps that are mirrored, or look the other way, against most of the others."""
    reference = np.sum([one["to_light"] for one in first], axis=0)
    for i, one in enumerate(measured):
        if np.linalg.det(cascades.light_from_world[i][:3, :3]) <= 0.0:
            what = "its light_from_world is mirrored: no rotation"
        elif np.dot(one["to_light"], reference) < 0.0:
            what = "its depth runs along the light the other way"
        elif one["mirrored"] != agreed:
            what = "its map is mirrored against the others"
        else:
            continue
        text = f"cascade {i}: {what}"
        yield CheckProblem("handedness", i, frame, 1.0, "", text)


# -- a path ----------------------------------------------------------------------------------------


def _motion_problems(sets, cameras, i):
    """What moved of one cascade, against the last frame since which nothing had."""
    anchor = 0
    for frame in range(1, len(sets)):
        before, after, camera = sets[anchor], sets[frame], cameras[anchor]
        near = max(before.splits[i], camera.near)
        far = min(before.splits[i + 1], camera.far)
        if not near < far:  # a slice that is not seen: any points will do
            near, far = camera.near, camera.far
        sizes = int(before.map_size[i]), int(after.map_size[i])
        move = _core.coverage_move(
            camera,
            near,
            far,
            before.clip_from_world[i],
            sizes[0],
            after.clip_from_world[i],
            sizes[1],
        )
        problem = _moved(i, frame, sizes, move)
        if problem is not None:
            anchor = frame
            yield problem


def _moved(i, frame, sizes, move):
    if sizes[0] != sizes[1]:
        text = f"map {i} changes from {sizes[0]} to {sizes[1]} texels a side"
        return CheckProblem("extent", i, frame, abs(sizes[1] - sizes[0]), "texels", text)
    tolerance = TOLERANCE_TEXELS + move["rounding_texels"]
    before, after = np.array(move["texel_size"])
    axis = int(np.argmax(np.abs(after / before - 1.0)))
    # A changed texel moves the grid by as many texels as half a window has, times the change.
    if abs(after[axis] / before[axis] - 1.0) * 0.5 * sizes[0] > tolerance:
        sides = before[axis] * sizes[0], after[axis] * sizes[0]
        text = f"window {i} changes from {sides[0]:.8g} to {sides[1]:.8g} m a side, its texels "
        text += f"from {before[axis]:.6g} to {after[axis]:.6g} m"
        return CheckProblem("extent", i, frame, abs(sides[1] - sides[0]), "m", text)
    if move["texels"] > tolerance:
        text = (
            f"the texel grid of cascade {i} moves by {move['texels']:.3g} texels, whole ones aside"
        )
        return CheckProblem("lattice", i, frame, move["texels"], "texels", text)
    off = move["depth_quanta"]
    slack = [QUANTUM_TOLERANCE + move["rounding_depth"] * quanta for quanta in QUANTA]
    # Quanta finer than what the rounding resolves are no excuse.
    moved = [o > s or s >= 0.5 for o, s in zip(off, slack, strict=True)]
    if off[0] > slack[0] and all(moved):
        text = (
            f"the depth range of cascade {i} moves by {move['depth']:.4g} m, {off[0]:.2g} quanta "
        )
        text += "of 16 bits beside whole ones, while its texel grid stands still"
        return CheckProblem("depth", i, frame, off[0], "quanta", text)
    return None


# -- figures ---------------------------------------------------------------------------------------


def _figures(measured):
    """What does not depend on right or wrong, over all frames."""
    density = np.array([[one["texels_per_pixel"] for one in frame] for frame in measured])
    low, high = density[..., 0].min(axis=0), density[..., 1].max(axis=0)
    range_ = np.stack([low, high], axis=1)
    range_[~np.isfinite(range_)] = np.nan
    mean = {
        name: np.mean([[one[name] for one in frame] for frame in measured], axis=0)
        for name in ("utilisation", "overlap")
    }
    first = {
        name: np.array([one[name] for one in measured[0]]) for name in ("texel_size", "depth_span")
    }
    figures = {"texels_per_pixel": range_, **mean, **first}
    return {name: frozen(array) for name, array in figures.items()}
