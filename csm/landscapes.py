"""Landscapes with plants: a wood on rolling ground, and the real terrain of the demo."""

import numpy as np

from .camera import Camera
from .elevation import grid_mesh, read_elevation, surface_height
from .mesh import Mesh
from .plants import planted
from .scene import Scene
from .shapes import mesh
from .spaces import as_whole
from .sun import Sun

__all__ = ["demo_terrain", "forest"]


def _terrain(height, half, cells):
    """Height field over a square: `height` is a function of arrays x and z."""
    sides = np.linspace(-half, half, cells + 1)
    x, z = np.meshgrid(sides, sides)
    return grid_mesh(height(x, z), 2.0 * half / cells)


def forest(trees=1500):
    """Grow a wood on rolling ground: plants are instances of four meshes, not baked.

    Parameters
    ----------
    trees : int
        Number of plants, 20 to 200,000, about one per 60 square metres.

    Returns
    -------
    scene : Scene
        Cameras ``path`` (eye 1.7 m over the ground, leaves within metres), ``canopy`` (over the
        crowns), ``edge`` (the wood from outside). Suns ``day``, ``low`` (light through the
        trunks), ``ahead`` (in the face of camera ``path``).
    """
    trees = as_whole("trees", trees, 20, 200_000)
    random = np.random.default_rng(20240501)
    half = 0.5 * np.sqrt(60.0 * trees)

    def height(x, z):
        return 3.0 * np.sin(x / 37.0) * np.cos(z / 41.0) + 1.2 * np.sin(x / 11.0 + z / 17.0)

    # Candidates in random order; a strip along z stays free: the path.
    points = random.uniform(-half, half, (2 * trees, 2))
    path_x = 4.0 * np.sin(points[:, 1] / 23.0)
    free = np.abs(points[:, 0] - path_x) < 2.2
    points = points[~free][:trees]
    on_ground = np.stack([points[:, 0], height(*points.T) - 0.05, points[:, 1]], axis=1)
    plants, kinds, transforms = planted(on_ground, random, (0.35, 0.2, 0.2, 0.25))
    ground = mesh("ground", _terrain(height, half + 40.0, 120))

    def over(x, z, above):
        return (x, float(height(x, z)) + above, z)

    start = 0.55 * half
    return Scene(
        [ground, *plants],
        np.concatenate([[0], kinds + 1]),
        np.concatenate([np.eye(4)[None], transforms]),
        name="forest",
        cameras={
            "path": Camera.look_at(
                over(4.0 * np.sin(start / 23.0), start, 1.7),
                over(4.0 * np.sin((start - 30) / 23.0), start - 30.0, 2.5),
                fov_y_deg=65,
                near=0.1,
                far=1500,
            ),
            "canopy": Camera.look_at(over(0, 0.7 * half, 32), over(0, -0.4 * half, 0), far=1500),
            "edge": Camera.look_at(
                over(-half - 30, 0.35 * half, 7), over(-0.2 * half, -0.1 * half, 5), far=1500
            ),
        },
        suns={
            "day": Sun.from_compass(210, 48, 0.53),
            "low": Sun.from_compass(265, 12, 0.53),
            "ahead": Sun.from_compass(3, 14, 0.53),
        },
    )


def demo_terrain(trees=4000):
    """Real terrain in Tennessee with code-made trees: the scene of the demo.

    The heights are the elevation sample that ships inside matplotlib: 30 x 32 km around the
    Jacksboro fault, 236 to 1076 m high, in cells of about 74 x 93 m, the grid's centre at
    x = z = 0. The trees stand around the camera ``ridge``, denser towards it, as instances.

    Parameters
    ----------
    trees : int
        0 to 200,000.

    Returns
    -------
    scene : Scene
        Cameras ``ridge`` (along a mountain ridge, one flank in the sun and one in the shade, to
        the plain at 20 km), ``crest`` (among the trees, against the evening sun), ``overview``
        (the whole terrain). Suns ``evening`` (8 degrees: ridges throw kilometre shadows),
        ``morning``, ``day``.

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    """
    trees = as_whole("trees", trees, 0, 200_000)
    try:
        from matplotlib import cbook
    except ImportError as error:
        raise ImportError(
            "the demo's terrain is in matplotlib: pip install cascaded-shadow-maps[plot]"
        ) from error
    path = cbook.get_sample_data("jacksboro_fault_dem.npz", asfileobj=False)
    heights, cell_size, _ = read_elevation(path)

    def over(x, z, above):
        return (x, float(surface_height(heights, cell_size, x, z)) + above, z)

    # Near planes just before what is seen: splits by logarithm start there.
    def looking(eye, compass_deg, down_deg, fov_y_deg, near):
        towards = Sun.from_compass(compass_deg, -down_deg).to_light
        return Camera.look_at(eye, eye + towards, fov_y_deg=fov_y_deg, near=near, far=50_000)

    ridge = over(5600.0, -5750.0, 80.0)
    meshes, instance_mesh, transforms = [Mesh(*grid_mesh(heights, cell_size), "terrain")], [0], []
    if trees:
        random = np.random.default_rng(1086)
        # Equal numbers per ring of distance: density falls with distance, as the eye needs it.
        distance, angle = random.uniform(10.0, 1600.0, trees), random.uniform(0, 2 * np.pi, trees)
        x, z = ridge[0] + distance * np.sin(angle), ridge[2] + distance * np.cos(angle)
        y = surface_height(heights, cell_size, x, z) - 0.3  # roots
        plants, kinds, transforms = planted(
            np.stack([x, y, z], axis=1), random, (0.55, 0.15, 0.15, 0.15)
        )
        meshes += plants
        instance_mesh = np.concatenate([[0], kinds + 1])
    return Scene(
        meshes,
        instance_mesh,
        np.concatenate([np.eye(4)[None], np.reshape(transforms, (-1, 4, 4))]),
        name="demo",
        cameras={
            "ridge": looking(ridge, 75, 12, 45, near=60),
            "crest": looking(over(5890.0, -5870.0, 22.0), 248, 5, 50, near=20),
            "overview": looking((2000.0, 15000.0, 27000.0), 356, 33, 45, near=12_000),
        },
        suns={
            "evening": Sun.from_compass(288, 8, 0.53),
            "morning": Sun.from_compass(105, 14, 0.53),
            "day": Sun.from_compass(200, 50, 0.53),
        },
    )
