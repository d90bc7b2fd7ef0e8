"""Landscapes with plants: a wood, a park of cut-outs, and the real terrain of the demo."""

import numpy as np

from .camera import Camera
from .elevation import grid_mesh, read_elevation, surface_height
from .mesh import Mesh
from .plants import card_tree, planted
from .scene import Scene
from .shapes import boxes_at, ground, mesh, placements
from .spaces import as_whole
from .sun import Sun

__all__ = ["demo_terrain", "foliage", "forest"]


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


def foliage(trees=9):
    """Plant a park of leaves on cards behind a wire-mesh fence: casters with cut-outs.

    The trees are instances of two meshes, limbs and a crown of 170 cards; the fence is two
    triangles, over which an image of one mesh of 6 cm repeats.

    Parameters
    ----------
    trees : int
        1 to 10,000, about one per 30 square metres.

    Returns
    -------
    scene : Scene
        Cameras ``under`` (light through a crown), ``fence`` (its wires' shadow, farther off thinner
        than texels), ``park``. Suns ``noon``, ``low`` (14 degrees, through all the
        crowns), ``edge_on`` (in the plane of the fence).
    """
    trees = as_whole("trees", trees, 1, 10_000)
    random = np.random.default_rng(7)
    columns = int(np.ceil(np.sqrt(trees)))
    half = 3.0 * columns
    row, column = np.divmod(np.arange(trees), columns)
    places = 6.0 * np.stack([column, np.zeros(trees), row], axis=1) + (3.0 - half, 0.0, 3.0 - half)
    places[:, [0, 2]] += random.uniform(-1.2, 1.2, (trees, 2))
    heights = random.uniform(4.5, 7.0, trees)
    stand = placements(places, random.uniform(0.0, 360.0, trees), heights)
    z, size, height = half + 1.5, 0.06, 1.8
    corners = np.array([[-half, 0.05, z], [half, 0.05, z], [half, height, z], [-half, height, z]])
    uv = (corners[:, :2] - corners[3, :2]) / (size, -size)
    fence = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), "fence", uv, _wire_image(0.06), 0.5)
    feet = np.array([(x, 0.0, z + 0.03) for x in np.linspace(-half, half, columns + 1)])
    posts = boxes_at(feet, (-0.03, 0.0, 0.0), (0.03, height + 0.05, 0.06))
    return Scene(
        [mesh("ground", ground(half + 14.0)), *card_tree(5), fence, mesh("posts", posts)],
        np.concatenate([[0], np.full(trees, 1), np.full(trees, 2), [3, 4]]),
        np.concatenate([np.eye(4)[None], stand, stand, np.eye(4)[None], np.eye(4)[None]]),
        name="foliage",
        cameras={
            "under": Camera.look_at(
                (0.3 * half, 1.7, half + 0.8), (-0.3 * half, 0.9, -0.2 * half), near=0.1, far=300
            ),
            "fence": Camera.look_at(
                (half - 0.5, 1.6, z + 3.2), (0.2 * half, 0.1, z - 0.3), near=0.1, far=300
            ),
            "park": Camera.look_at(
                (-half - 3.0, 5.5, half + 7.0), (0, 1.8, 0), fov_y_deg=50, far=300
            ),
        },
        suns={
            "noon": Sun.from_compass(200, 58, 0.53),
            "low": Sun.from_compass(310, 14, 0.53),
            "edge_on": Sun((1.0, 0.5, 0.0)),
        },
    )


def _wire_image(wire, side=64):
    """Alpha of one mesh of a wire fence, (side, side) uint8: a diamond; `wire` in image sides."""
    v, u = (np.indices((side, side)) + 0.5) / side
    away = np.minimum(np.abs((u + v) % 1.0 - 0.5), np.abs((u - v) % 1.0 - 0.5)) / np.sqrt(2.0)
    return np.where(away <= wire, 255, 0).astype(np.uint8)


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
