"""Meshes and scenes: immutable arrays, checked when they are made."""

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from .camera import Camera
from .elevation import grid_centre, grid_mesh
from .instances import (
    MAX_EXTENT,
    checked_instance_mesh,
    checked_transforms,
    chosen_origin,
    flattened,
    measured_bounds,
)
from .mesh import Mesh
from .spaces import as_number, as_vector, transform_directions, transform_points
from .sun import Sun

__all__ = ["Camera", "Mesh", "Scene", "Sun"]


@dataclass(frozen=True)
class Part:
    """An animated file inside a scene: where its instances and posed meshes are.

    `animation` has ``clips`` (name to duration [s]) and ``pose(clip, seconds)`` that returns
    ``(posed, world_from_instance)``: positions by its own mesh number, and (k, 4, 4) transforms.
    """

    animation: object
    meshes: tuple  # scene mesh of each mesh of the animation
    first_instance: int
    world_from_part: np.ndarray  # (4, 4)


@dataclass(frozen=True, eq=False, init=False)
class Scene:
    """Meshes set into the world, with the cameras and suns that came with them.

    Immutable, compared by identity. Make one with `csm.load`, `csm.load_elevation`,
    `from_arrays`, `from_elevation` or a function of `csm.scenes`.

    Parameters
    ----------
    meshes : sequence of Mesh
        Each used by at least one instance.
    instance_mesh : (k,) array_like of int, optional
        Mesh of each instance; by default every mesh once.
    world_from_instance : (k, 4, 4) array_like, optional
        Affine, invertible; identity by default. A negative determinant mirrors: faces are flipped.
    name : str
    cameras, suns : mapping of str to Camera, Sun
    georeference : (3,) array_like
        World point that cameras of a scenes file and of the command line are relative to [m].
    origin : (3,) array_like, optional
        World point that float32 positions are relative to; by default chosen from the bounds.
    parts : sequence of Part
        What `at` can pose.

    Attributes
    ----------
    bounds : (2, 3) float64
        Lower and upper corner of every drawn vertex, world [m].
    origin : (3,) float64
        The bounds' centre rounded to a power of two of at most 1 m (and at most 1/1024 of the
        extent), so that a scene moved by whole metres keeps its origin-relative positions to the
        bit as long as doubles hold them.
    triangle_count, stored_triangle_count : int
        With every instance counted, and in memory.
    clips : mapping of str to float
        Animation clips and their durations [s].

    Raises
    ------
    TypeError, ValueError
        If a value breaks its rule; the text names it.
    """

    meshes: tuple[Mesh, ...]
    instance_mesh: np.ndarray
    world_from_instance: np.ndarray
    name: str
    cameras: MappingProxyType
    suns: MappingProxyType
    georeference: np.ndarray
    bounds: np.ndarray
    origin: np.ndarray
    parts: tuple[Part, ...]

    def __init__(
        self,
        meshes,
        instance_mesh=None,
        world_from_instance=None,
        *,
        name="",
        cameras=None,
        suns=None,
        georeference=(0.0, 0.0, 0.0),
        origin=None,
        parts=(),
    ):
        put = object.__setattr__.__get__(self)
        if not isinstance(name, str):
            raise TypeError(f"name must be a string (got {name!r})")
        meshes = tuple(meshes)
        for mesh in meshes:
            if not isinstance(mesh, Mesh):
                raise TypeError(f"meshes must be csm.Mesh objects (got {type(mesh).__name__})")
        if not meshes:
            raise ValueError("a scene must have at least one mesh (got none)")
        put("meshes", meshes)
        put("instance_mesh", checked_instance_mesh(instance_mesh, len(meshes)))
        put("world_from_instance", checked_transforms(world_from_instance, len(self.instance_mesh)))
        put("name", name)
        put("cameras", MappingProxyType(_checked_views("cameras", cameras, Camera)))
        put("suns", MappingProxyType(_checked_views("suns", suns, Sun)))
        put("georeference", as_vector("georeference", georeference))
        bounds = measured_bounds(meshes, self.instance_mesh, self.world_from_instance)
        put("bounds", bounds)
        put("origin", chosen_origin(bounds) if origin is None else as_vector("origin", origin))
        put("parts", tuple(parts))

    @classmethod
    def from_arrays(
        cls,
        positions,
        triangles,
        *,
        name="",
        cameras=None,
        suns=None,
        uv=None,
        alpha=None,
        alpha_cutoff=0.5,
    ):
        """Make a scene of one mesh.

        Parameters
        ----------
        positions : (n, 3) array_like
            World positions [m]; copied.
        triangles : (m, 3) array_like of int
            Vertex indices, counter-clockwise seen from the front; copied.
        name : str
        cameras, suns : mapping of str to Camera, Sun
        uv, alpha, alpha_cutoff
            A cut-out, as `Mesh` takes it.

        Returns
        -------
        scene : Scene

        Raises
        ------
        TypeError, ValueError
            As `Mesh`.
        """
        mesh = Mesh(positions, triangles, name, uv, alpha, alpha_cutoff)
        return cls([mesh], name=name, cameras=cameras, suns=suns)

    @classmethod
    def from_elevation(cls, heights, cell_size, origin=None, *, name="", cameras=None, suns=None):
        """Make a terrain from a grid of heights, two triangles per cell.

        Parameters
        ----------
        heights : (rows, columns) array_like
            Samples [m], row 0 north, at least 2 x 2. A cell with a NaN corner is a hole.
        cell_size : float or (float, float)
            Distance of samples [m], or (east, north).
        origin : (2,) array_like, optional
            Easting and northing of sample [0, 0] [m]: the terrain then stands at its place on the
            map (+x east, -z north) and `georeference` is the grid's centre at height 0. Without
            it the grid's centre is at x = z = 0.
        name : str
        cameras, suns : mapping of str to Camera, Sun

        Returns
        -------
        scene : Scene

        Raises
        ------
        TypeError, ValueError
            If a value breaks its rule, or every cell is a hole.
        """
        positions, triangles = grid_mesh(heights, cell_size)
        # Vertices stay relative to the grid's centre, like the local space of a georeferenced
        # file; the instance moves them in double.
        centre = grid_centre(heights, cell_size, origin)
        world_from_instance = np.eye(4)[None]
        world_from_instance[0, :3, 3] = centre
        return cls(
            [Mesh(positions, triangles, name)],
            world_from_instance=world_from_instance,
            name=name,
            cameras=cameras,
            suns=suns,
            georeference=centre,
        )

    def merge(self, *scenes):
        """Put scenes together: ``Scene.merge(a, b, c)`` or ``a.merge(b, c)``.

        Nothing is moved (see `placed`) and meshes that are the same object are stored once. Of
        cameras and suns with one name the first scene's wins; name and georeference are the first
        scene's.

        Parameters
        ----------
        *scenes : Scene

        Returns
        -------
        scene : Scene

        Raises
        ------
        TypeError
            If one is not a Scene.
        """
        scenes = (self, *scenes)
        for scene in scenes:
            if not isinstance(scene, Scene):
                raise TypeError(f"merge takes csm.Scene objects (got {type(scene).__name__})")
        numbers, meshes, instance_mesh, parts = {}, [], [], []
        cameras, suns = {}, {}
        for scene in scenes:
            for mesh in scene.meshes:
                if id(mesh) not in numbers:
                    numbers[id(mesh)] = len(meshes)
                    meshes.append(mesh)
            new_number = np.array([numbers[id(mesh)] for mesh in scene.meshes], np.int32)
            first = sum(map(len, instance_mesh))
            instance_mesh.append(new_number[scene.instance_mesh])
            parts += [
                Part(
                    part.animation,
                    tuple(int(new_number[mesh]) for mesh in part.meshes),
                    part.first_instance + first,
                    part.world_from_part,
                )
                for part in scene.parts
            ]
            cameras = {**scene.cameras, **cameras}
            suns = {**scene.suns, **suns}
        return Scene(
            meshes,
            np.concatenate(instance_mesh),
            np.concatenate([scene.world_from_instance for scene in scenes]),
            name=self.name,
            cameras=cameras,
            suns=suns,
            georeference=self.georeference,
            parts=parts,
        )

    def with_ground(self, y=0.0, size=None):
        """Add a horizontal ground of two triangles.

        Parameters
        ----------
        y : float
            World height [m]; of a georeferenced scene ``scene.georeference[1] + y`` is y metres
            over its local zero.
        size : float, optional
            Side of the square [m], centred under the scene. By default four times the largest
            extent (x, y or z): a shadow at 30 degrees of sun stays on it, while the ground does
            not push the bounds, and with them the cascades of ``view_range="scene"``, far out.

        Returns
        -------
        scene : Scene

        Raises
        ------
        TypeError, ValueError
            If a value breaks its rule.
        """
        y = as_number("y", y, rule="a finite height in metres")
        lower, upper = self.bounds
        extent = float((upper - lower).max())
        size = as_number("size", 4.0 * extent if size is None else size, 0.0, MAX_EXTENT)
        if size == 0.0:
            raise ValueError("size must be > 0 (got 0; give one for a scene without extent)")
        corners = 0.5 * size * np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]])
        world_from_ground = np.eye(4)[None]
        world_from_ground[0, :3, 3] = 0.5 * (lower + upper)
        world_from_ground[0, 1, 3] = y
        mesh = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), "ground")
        return self.merge(Scene([mesh], world_from_instance=world_from_ground))

    def placed(self, offset=(0.0, 0.0, 0.0), *, scale=1.0, turn_deg=0.0):
        """Scale the scene, turn it about the y axis, then move it; cameras and suns too.

        Parameters
        ----------
        offset : (3,) array_like
            World vector [m].
        scale : float
            > 0.
        turn_deg : float
            From +z towards +x, like a sun's azimuth.

        Returns
        -------
        scene : Scene
            It shares its meshes with this one: merging placed copies makes instances.

        Raises
        ------
        TypeError, ValueError
            If a value breaks its rule.
        """
        scale = as_number("scale", scale, 1e-12, 1e12)
        turn = Sun.from_angles(as_number("turn_deg", turn_deg, rule="a finite angle"), 0.0).to_light
        rotation = np.array([[turn[2], 0, turn[0]], [0, 1, 0], [-turn[0], 0, turn[2]]])
        moved = np.eye(4)
        moved[:3, :3] = scale * rotation
        moved[:3, 3] = as_vector("offset", offset)
        return Scene(
            self.meshes,
            self.instance_mesh,
            moved @ self.world_from_instance,
            name=self.name,
            cameras={name: _moved_camera(c, moved, scale) for name, c in self.cameras.items()},
            suns={
                name: Sun(rotation @ sun.to_light, sun.angular_diameter_deg)
                for name, sun in self.suns.items()
            },
            georeference=transform_points(moved, self.georeference),
            parts=[
                Part(part.animation, part.meshes, part.first_instance, moved @ part.world_from_part)
                for part in self.parts
            ],
        )

    def at(self, clip, seconds):
        """Pose the animated parts that have a clip; what else is in the scene stays.

        Parameters
        ----------
        clip : str
            One of `clips`.
        seconds : float
            Time in the clip [s], 0 to its duration; outside the clip repeats (the time is taken
            modulo the duration).

        Returns
        -------
        scene : Scene
            With the same `origin`, so that what does not move keeps its bits.

        Raises
        ------
        ValueError
            If there is no such clip (the text lists them), the time is not finite, or the clip
            scales something flat at that time.
        """
        seconds = as_number("seconds", seconds, rule="a finite time in seconds")
        if clip not in self.clips:
            known = ", ".join(map(repr, self.clips)) or "none: the scene is not animated"
            raise ValueError(f"clip must be one of the scene's clips, {known} (got {clip!r})")
        meshes, transforms = list(self.meshes), np.array(self.world_from_instance)
        for part in self.parts:
            if clip not in part.animation.clips:
                continue
            posed, world_from_instance = part.animation.pose(clip, seconds)
            for number, positions in posed.items():
                meshes[part.meshes[number]] = meshes[part.meshes[number]].posed(positions)
            last = part.first_instance + len(world_from_instance)
            transforms[part.first_instance : last] = part.world_from_part @ world_from_instance
        return self._with(meshes=meshes, world_from_instance=transforms)

    def replace(self, **changes):
        """Change `name`, `cameras`, `suns` or `georeference`.

        Parameters
        ----------
        **changes
            Fields as in the class.

        Returns
        -------
        scene : Scene

        Raises
        ------
        TypeError
            If a name is none of the four.
        """
        allowed = ("name", "cameras", "suns", "georeference")
        for name in changes:
            if name not in allowed:
                raise TypeError(f"Scene.replace changes {', '.join(allowed)} (got {name!r})")
        return self._with(**changes)

    def _with(self, **changes):
        fields = {
            "meshes": self.meshes,
            "instance_mesh": self.instance_mesh,
            "world_from_instance": self.world_from_instance,
            "name": self.name,
            "cameras": self.cameras,
            "suns": self.suns,
            "georeference": self.georeference,
            "origin": self.origin,
            "parts": self.parts,
        }
        return Scene(**{**fields, **changes})

    @property
    def clips(self):
        """Animation clips of the scene and their durations [s]."""
        clips = {}
        for part in self.parts:
            clips.update(part.animation.clips)
        return clips

    @property
    def triangle_count(self):
        """Triangles drawn, every instance counted."""
        counts = np.array([len(mesh.triangles) for mesh in self.meshes])
        return int(counts[self.instance_mesh].sum())

    @property
    def stored_triangle_count(self):
        """Triangles in memory, every mesh counted once."""
        return sum(len(mesh.triangles) for mesh in self.meshes)

    def flatten(self, relative_to=(0.0, 0.0, 0.0)):
        """Bake every instance into one pair of arrays.

        Parameters
        ----------
        relative_to : (3,) array_like
            World point that is subtracted from the instances' translations before they are
            applied, as the upload does with `origin`: large coordinates then cost no precision.

        Returns
        -------
        positions : (n, 3) float64
            World positions minus `relative_to` [m].
        triangles : (m, 3) int32
            Instance after instance; flipped where an instance mirrors.

        Raises
        ------
        ValueError
            If the vertices are 2^31 or more.
        """
        return flattened(
            self.meshes,
            self.instance_mesh,
            self.world_from_instance,
            as_vector("relative_to", relative_to),
        )

    def __repr__(self):
        return (
            f"<Scene {self.name!r}: {self.triangle_count} triangles "
            f"({self.stored_triangle_count} stored), {len(self.instance_mesh)} instances>"
        )

    def __getstate__(self):
        return {
            **self.__dict__,
            "cameras": dict(self.cameras),
            "suns": dict(self.suns),
        }

    def __setstate__(self, state):
        # Arrays come out of a pickle writable, and a mapping proxy does not go into one.
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        state["cameras"] = MappingProxyType(state["cameras"])
        state["suns"] = MappingProxyType(state["suns"])
        self.__dict__.update(state)


def _checked_views(what, views, kind):
    if views is None:
        return {}
    try:
        views = dict(views)
    except (TypeError, ValueError):
        raise TypeError(f"{what} must be a mapping of names (got {views!r})") from None
    for name, view in views.items():
        if not isinstance(name, str) or not isinstance(view, kind):
            raise TypeError(
                f"{what} must map names to csm.{kind.__name__} (got {name!r}: {view!r})"
            )
    return views


def _moved_camera(camera, moved, scale):
    """Move a camera by a similarity: of the moved scene it sees what it saw before."""
    axes = {
        name: transform_directions(moved, getattr(camera, name)) / scale
        for name in ("right", "up", "backward")
    }
    changes = {"near": camera.near * scale, "far": camera.far * scale}
    if camera.orthographic:
        for name in ("half_width", "half_height", "centre_x", "centre_y"):
            changes[name] = getattr(camera, name) * scale
    return camera.replace(eye=transform_points(moved, camera.eye), **axes, **changes)
