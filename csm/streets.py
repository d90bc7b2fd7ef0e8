"""Built scenes of any size: a road to the horizon, a town."""

import numpy as np

from .camera import Camera
from .plants import broadleaf, bush, conifer
from .scene import Scene
from .shapes import box, boxes_at, ground, join, mesh, placements, repeat, roof, tube
from .spaces import as_number, as_whole
from .sun import Sun

__all__ = ["long_road", "town"]


def long_road(length=2000.0):
    """Lay a straight road to the horizon with lamps, barriers, signs: near and far at 1e4.

    Parameters
    ----------
    length : float
        Along -z [m], 100 to 20,000.

    Returns
    -------
    scene : Scene
        Cameras ``driver`` (1.2 m over the road), ``bridge`` (from above, down the road). Suns
        ``side``, ``evening`` (6 degrees, across), ``ahead`` (in the face of the driver: dueling
        frusta).
    """
    length = as_number("length", length, 100.0, 2e4)
    lamp = join(
        tube([(0, 0, 0), (0, 7.5, 0), (0.5, 8.4, 0), (2.0, 8.6, 0)], (0.09, 0.06, 0.05, 0.04), 8),
        box((1.6, 8.5, -0.14), (2.4, 8.62, 0.14)),
    )
    sign = join(tube([(0, 0, 0), (0, 3.1, 0)], 0.035), box((-0.45, 2.2, -0.01), (0.45, 3.1, 0.01)))
    barrier_post = box((-0.06, 0, -0.06), (0.06, 0.75, 0.06))
    lamp_z = -np.arange(12.0, length, 35.0)
    sign_z = -np.arange(30.0, length, 140.0)
    post_z = -np.arange(0.0, length, 4.0)

    def beside(x, z):
        return np.stack([np.full_like(z, x), np.zeros_like(z), z], axis=1)

    turned = np.where(np.arange(len(lamp_z)) % 2, 180.0, 0.0)
    lamp_points = beside(-5.0, lamp_z)
    lamp_points[:, 0] *= np.where(turned > 0, -1.0, 1.0)
    rails = [box((x - 0.02, 0.5, -length), (x + 0.02, 0.78, 0)) for x in (-4.4, 4.4)]
    kerbs = [box((min(x, 1.1 * x), 0, -length), (max(x, 1.1 * x), 0.12, 0)) for x in (-3.6, 3.6)]
    verge, middle = 0.06 * length + 60.0, -0.5 * length
    lower, upper = (-verge, 0.0, middle - 0.55 * length), (verge, 0.0, middle + 0.55 * length)
    ground = (
        np.array([lower, (lower[0], 0, upper[2]), upper, (upper[0], 0, lower[2])]),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
    )
    return Scene(
        [
            mesh("ground", ground),
            mesh("road", *kerbs),
            mesh("lamps", repeat(lamp, placements(lamp_points, turned))),
            mesh("signs", repeat(sign, placements(beside(4.9, sign_z)))),
            mesh(
                "barriers",
                *rails,
                *(repeat(barrier_post, placements(beside(x, post_z))) for x in (-4.4, 4.4)),
            ),
        ],
        name="long_road",
        cameras={
            "driver": Camera.look_at((-1.6, 1.2, -2), (-1.2, 1.1, -80), near=0.2, far=2.0 * length),
            "bridge": Camera.look_at((3, 9.5, 6), (-0.5, 0, -55), near=0.5, far=2.0 * length),
        },
        suns={
            "side": Sun.from_compass(100, 30, 0.53),
            "evening": Sun.from_compass(285, 6, 0.53),
            "ahead": Sun.from_compass(4, 9, 0.53),
        },
    )


def _house(random):
    """Return a house on about 8 x 10 m, its front at -x: walls, roof, chimney, balcony, windows."""
    width, depth = random.uniform(7.0, 9.0), random.uniform(8.0, 11.0)
    storeys = int(random.integers(1, 4))
    eaves = 0.4 + 2.9 * storeys
    x, z = 0.5 * width, 0.5 * depth
    parts = [
        box((-x, 0, -z), (x, eaves, z)),
        roof((-x, eaves, -z), (x, eaves + random.uniform(1.8, 3.2), z)),
        box((0.3 * x, eaves, 0.3 * z), (0.3 * x + 0.6, eaves + 3.6, 0.3 * z + 0.6)),
    ]
    centres = np.array(
        [
            (side * (x + 0.03), 1.6 + 2.9 * storey, along)
            for storey in range(storeys)
            for along in np.linspace(-z + 1.6, z - 1.6, 3)
            for side in (-1, 1)
        ]
    )
    # Lintel and sill stand proud of the wall: casters of a hand's breadth.
    parts.append(boxes_at(centres, (-0.08, 0.7, -0.62), (0.08, 0.82, 0.62)))
    parts.append(boxes_at(centres, (-0.16, -0.88, -0.7), (0.16, -0.8, 0.7)))
    if storeys == 3:
        bars = np.arange(-1.5, 1.51, 0.25)
        at = np.stack([np.full_like(bars, -x - 1.15), np.full_like(bars, 3.3), bars], axis=1)
        parts += [
            box((-x - 1.2, 3.15, -1.6), (-x, 3.3, 1.6)),
            box((-x - 1.2, 4.25, -1.6), (-x - 1.1, 4.33, 1.6)),
            boxes_at(at, (-0.012, 0, -0.012), (0.012, 0.95, 0.012)),
        ]
    return join(*parts)


def _gardens():
    """Return three fronts of a plot of 18 m at x = -9, each with a lamp: pickets, wall, hedge."""
    lamp = join(
        tube([(-10.5, 0, 8.8), (-10.5, 4.8, 8.8), (-11.4, 5.2, 8.8)], (0.07, 0.05, 0.04), 6),
        box((-11.7, 5.12, 8.68), (-11.1, 5.28, 8.92)),
    )
    z = np.arange(-8.8, 8.9, 0.4)
    at = np.stack([np.full_like(z, -9.0), np.zeros_like(z), z], axis=1)
    pickets = [
        boxes_at(at, (-0.02, 0, -0.06), (0.02, 1.05, 0.06)),
        box((-8.98, 0.3, -9.0), (-8.94, 0.4, 9.0)),
        box((-8.98, 0.8, -9.0), (-8.94, 0.9, 9.0)),
    ]
    z = np.arange(-9.0, 9.1, 3.0)
    at = np.stack([np.full_like(z, -9.0), np.zeros_like(z), z], axis=1)
    wall = [
        box((-9.1, 0, -9.0), (-8.9, 0.6, 9.0)),
        boxes_at(at, (-0.16, 0, -0.16), (0.16, 0.95, 0.16)),
        tube([(-9, 0.85, -9), (-9, 0.85, 9)], 0.02, 6),
    ]
    hedge = [box((-9.4, 0, -9.0), (-8.6, 1.2, -1.0)), box((-9.4, 0, 0.6), (-8.6, 1.2, 9.0))]
    return [join(lamp, *front) for front in (pickets, wall, hedge)]


def town(triangles=50_000):
    """Build a town of gabled houses, gardens and trees; more triangles make it larger.

    Rows of plots of 20 x 18 m stand back to back between streets of 8 m, filled from the middle
    outwards until the number of triangles is reached. Everything is baked into two meshes.

    Parameters
    ----------
    triangles : int
        Wanted number, 5,000 to 20 million; the result is less than one plot (1,800) larger.

    Returns
    -------
    scene : Scene
        Cameras ``street`` (eye level, down a street), ``roofs`` (over the roofs to the horizon),
        ``oblique`` (the whole town). Suns ``noon``, ``afternoon``, ``evening`` (5 degrees, along
        the streets' fences), ``ahead`` (in the face of camera ``street``).
    """
    triangles = as_whole("triangles", triangles, 5_000, 20_000_000)
    random = np.random.default_rng(7)
    houses, gardens = [_house(random) for _ in range(12)], _gardens()
    trees = [broadleaf(4), conifer(), bush(5)]
    sizes = [[len(shape[1]) for shape in kind] for kind in (houses, gardens, trees, trees)]
    # Enough plots in a square about the middle even if all were of the smallest kinds.
    reach = int(np.ceil(0.5 * np.sqrt(triangles / sum(map(min, sizes))))) + 2
    columns, rows = (grid.ravel() for grid in np.mgrid[-reach:reach, -reach:reach])
    # Two columns of plots share a back line, then comes a street; a cross street every five rows.
    x = 20.0 * columns + 8.0 * np.floor_divide(columns, 2) + 14.0
    z = 18.0 * rows + 9.0 + 10.0 * np.floor_divide(rows, 5)
    kinds = np.stack([random.integers(0, len(size), len(x)) for size in sizes])
    counts = sum(np.array(size)[kind] for size, kind in zip(sizes, kinds, strict=True))
    nearest = np.argsort(np.hypot(x - x.mean(), z - z.mean()), kind="stable")
    last = int(np.searchsorted(np.cumsum(counts[nearest]), triangles - 2))
    taken = nearest[: last + 1]
    x, z, kinds, left = x[taken], z[taken], kinds[:, taken], columns[taken] % 2 == 0

    # A front is built at -x: plots whose street is on the other side are turned.
    points, turns = np.stack([x, 0 * x, z], axis=1), np.where(left, 0.0, 180.0)
    behind = np.where(left, 1.0, -1.0)[:, None] * (7.0, 0.0, 0.0)
    shapes = [*_baked(houses, kinds[0], points, turns), *_baked(gardens, kinds[1], points, turns)]
    for corner, kind in zip((6.5, -6.5), kinds[2:], strict=True):
        at = points + behind + (0.0, 0.0, corner)
        at[:, [0, 2]] += random.uniform(-1.0, 1.0, (len(x), 2))
        heights = random.uniform(3.5, 8.0, len(x)) * np.where(kind == 2, 0.25, 1.0)
        shapes += _baked(trees, kind, at, random.uniform(0, 360, len(x)), heights)
    half = float(np.abs(points).max()) + 25.0
    return Scene(
        [mesh("ground", ground(half)), mesh("town", *shapes)],
        name="town",
        cameras={
            "street": Camera.look_at(
                (-1.5, 1.7, 0.55 * half), (1.0, 2.0, -0.5 * half), far=4.0 * half
            ),
            "roofs": Camera.look_at(
                (-30.0, 18.0, 0.62 * half), (12.0, 3.0, -0.1 * half), near=0.5, far=4.0 * half
            ),
            "oblique": Camera.look_at(
                (0.75 * half, 0.7 * half, 1.15 * half),
                (-0.05 * half, 0, 0.1 * half),
                fov_y_deg=45,
                near=1,
                far=5.0 * half,
            ),
        },
        suns={
            "noon": Sun.from_compass(165, 58, 0.53),
            "afternoon": Sun.from_compass(238, 33, 0.53),
            "evening": Sun.from_compass(281, 5, 0.53),
            "ahead": Sun.from_compass(2, 12, 0.53),
        },
    )


def _baked(shapes, kinds, points, turns_deg, scales=1.0):
    """Return the shapes that `kinds` (k,) names, each set on its points (k, 3)."""
    scales = np.broadcast_to(scales, len(points))
    chosen = [kinds == number for number in range(len(shapes))]
    return [
        repeat(shape, placements(points[on], turns_deg[on], scales[on]))
        for shape, on in zip(shapes, chosen, strict=True)
        if on.any()
    ]
