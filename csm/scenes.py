"""Scenes made by code, each with named cameras and suns that show a hard or a typical case.

Everything is deterministic: the same arguments give the same arrays. `SCENES` maps the names that
the command line takes to the functions. Lengths in metres, y up, ground at or near y = 0.
"""

import numpy as np

from .camera import Camera
from .landscapes import demo_terrain, foliage, forest
from .scene import Scene
from .shapes import box, boxes, boxes_at, ground, join, mesh, placements, repeat, tube
from .spaces import as_number, as_whole
from .streets import long_road, town
from .sun import Sun

__all__ = [
    "SCENES",
    "demo_terrain",
    "fence",
    "foliage",
    "forest",
    "long_road",
    "plane_and_box",
    "stairs",
    "town",
    "wires",
]


def plane_and_box():
    """Set a box of 2 m on a plane: the smallest scene whose shadow has a closed form.

    The plane is y = 0, 40 m wide; the box spans x and z from -1 to 1 and y from 0 to 2, so the sun
    ``diagonal`` (45 degrees, from +x) throws the shadow x from -3 to -1, z from -1 to 1.

    Returns
    -------
    scene : Scene
        Cameras ``corner`` (typical), ``contact`` (peter-panning at the foot), ``map`` (straight
        down, parallel rays). Suns ``diagonal``, ``morning``, ``grazing``, ``overhead``.
    """
    return Scene(
        [mesh("plane", ground(20.0)), mesh("box", box((-1, 0, -1), (1, 2, 1)))],
        name="plane_and_box",
        cameras={
            "corner": Camera.look_at((6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=100),
            "contact": Camera.look_at((-3.6, 0.8, 2.6), (-1, 0.35, 0.1), near=0.05, far=100),
            "map": Camera.orthographic(
                (0, 20, 0), (0, 0, 0), up=(0, 0, -1), height=12, near=1, far=40
            ),
        },
        suns={
            "diagonal": Sun((1, 1, 0)),
            "morning": Sun.from_compass(125, 35, 0.53),
            "grazing": Sun.from_compass(110, 4, 0.53),
            "overhead": Sun((0, 1, 0)),
        },
    )


def fence(length=60.0):
    """Set up a picket fence: thin casters whose gaps fall below a texel in the distance.

    Parameters
    ----------
    length : float
        Of the fence along x [m], 1 to 10,000.

    Returns
    -------
    scene : Scene
        Cameras ``along`` (0.3 m beside the slats, down the fence), ``front``. Suns ``across``
        (long comb of shadows), ``low`` (4 degrees), ``edge_on`` (light in the plane of the slats).
    """
    length = as_number("length", length, 1.0, 1e4)
    x = np.arange(-0.5 * length, 0.5 * length, 0.14)
    zero = np.zeros_like(x)
    feet = np.stack([x, zero, zero], axis=1)
    slats = boxes_at(feet, (-0.035, 0.06, -0.01), (0.035, 1.1, 0.01))
    rails = [box((-0.5 * length, y, 0.01), (0.5 * length, y + 0.08, 0.05)) for y in (0.25, 0.8)]
    post_x = np.arange(-0.5 * length, 0.5 * length + 1e-9, 2.1)
    feet = np.stack([post_x, np.zeros_like(post_x), np.zeros_like(post_x)], axis=1)
    posts = boxes_at(feet, (-0.05, 0, 0.05), (0.05, 1.0, 0.15))
    return Scene(
        [mesh("ground", ground(0.6 * length + 10.0)), mesh("fence", slats, *rails, posts)],
        name="fence",
        cameras={
            "along": Camera.look_at(
                (-0.48 * length, 1.5, 0.3 + 1.2), (0.2 * length, 0.2, 0.2), near=0.05, far=300
            ),
            "front": Camera.look_at((1.5, 1.6, 5.0), (0, 0.4, 0), near=0.1, far=300),
        },
        suns={
            "across": Sun.from_compass(330, 28, 0.53),
            "low": Sun.from_compass(345, 4, 0.53),
            "edge_on": Sun((1, 0.35, 0)),
        },
    )


def wires(spans=6):
    """Poles with wires of 1 cm: casters that are far thinner than a texel and a pixel.

    Parameters
    ----------
    spans : int
        Number of spans of 40 m along x, 1 to 200.

    Returns
    -------
    scene : Scene
        Cameras ``under`` (shadows of the wires within metres), ``far`` (the whole line).
        Suns ``noon``, ``low`` (8 degrees, wires' shadows far from the wires), ``parallel`` (light
        along the wires).
    """
    spans = as_whole("spans", spans, 1, 200)
    span, top, sag = 40.0, 9.0, 1.1
    pole_x = span * (np.arange(spans + 1) - 0.5 * spans)
    arm_y, offsets = (top - 0.4, top - 1.6), (-0.9, -0.3, 0.3, 0.9)
    pole = join(
        tube([(0, 0, 0), (0, 0.5 * top, 0), (0, top, 0)], (0.16, 0.14, 0.11), 8),
        *(box((-0.06, y - 0.06, -1.1), (0.06, y + 0.06, 1.1)) for y in arm_y),
        *(tube([(0, y, z), (0, y + 0.2, z)], 0.04) for y in arm_y for z in offsets),
    )
    poles = repeat(pole, placements([(x, 0.0, 0.0) for x in pole_x]))
    along = np.linspace(0.0, 1.0, 17)
    lines = []
    for y in arm_y:
        for z in offsets:
            for x in pole_x[:-1]:
                # A parabola, which a catenary of this sag differs from by less than a centimetre.
                drop = 4.0 * sag * along * (1.0 - along)
                path = np.stack([x + span * along, y + 0.2 - drop, np.full_like(along, z)], axis=1)
                lines.append(tube(path, 0.005, 4))
    return Scene(
        [
            mesh("ground", ground(0.5 * spans * span + 30.0)),
            mesh("poles", poles),
            mesh("wires", *lines),
        ],
        name="wires",
        cameras={
            "under": Camera.look_at(
                (pole_x[0] + 3.0, 1.7, 1.5), (pole_x[0] + 16.0, 0.0, -5.5), near=0.1, far=600
            ),
            "far": Camera.look_at(
                (-0.3 * spans * span, 10.0, 28.0), (0, 3.0, -3.0), fov_y_deg=50, near=0.5, far=800
            ),
        },
        suns={
            "noon": Sun.from_compass(190, 55, 0.53),
            "low": Sun.from_compass(200, 8, 0.53),
            "parallel": Sun((1, 0.45, 0)),
        },
    )


def stairs(steps=24):
    """Build a flight of stairs with balusters: many small faces that shade each other.

    Parameters
    ----------
    steps : int
        2 to 500; each 0.30 m deep and 0.17 m high, up towards -z.

    Returns
    -------
    scene : Scene
        Cameras ``foot`` (up the flight), ``side``. Suns ``along`` (just over the slope of the
        flight: treads and risers almost edge-on), ``across`` (balusters onto the steps),
        ``behind`` (the flight shades itself).
    """
    steps = as_whole("steps", steps, 2, 500)
    depth, rise, half = 0.30, 0.17, 1.4
    number = np.arange(steps)
    treads = boxes(
        np.stack([np.full(steps, -half), np.zeros(steps), -(number + 1.0) * depth], axis=1),
        np.stack([np.full(steps, half), (number + 1.0) * rise, -number * depth], axis=1),
    )
    back, top = -steps * depth, steps * rise
    landing = box((-half, 0, back - 3.0), (half, top, back))
    balusters, rails = [], []
    for side in (-half + 0.1, half - 0.1):
        feet = np.stack(
            [np.full(steps, side), (number + 1.0) * rise, -(number + 0.5) * depth], axis=1
        )
        balusters.append(boxes_at(feet, (-0.012, 0, -0.012), (0.012, 0.9, 0.012)))
        rails.append(tube(feet[[0, -1]] + np.array([0, 0.92, 0]), 0.03, 8))
    wall = box((half + 0.2, 0, back - 3.0), (half + 0.5, top + 1.5, 0.5))
    reach = 0.5 * steps * depth
    return Scene(
        [
            mesh("ground", ground(steps * depth + 8.0)),
            mesh("stairs", treads, landing),
            mesh("railing", *balusters, *rails),
            mesh("wall", wall),
        ],
        name="stairs",
        cameras={
            "foot": Camera.look_at((-0.9, 1.7, 3.0), (0.2, 0.5 * top, back), near=0.05, far=200),
            "side": Camera.look_at(
                (-1.1 * reach - 3.0, 0.5 * top + 2.5, 0.5), (0.3, 0.42 * top, -reach), far=200
            ),
        },
        suns={
            "along": Sun((0.12, rise + 0.03, depth)),
            "across": Sun.from_compass(285, 32, 0.53),
            "behind": Sun((-0.5, 0.5, -1.0)),
        },
    )


SCENES = {
    "plane_and_box": plane_and_box,
    "fence": fence,
    "wires": wires,
    "stairs": stairs,
    "long_road": long_road,
    "foliage": foliage,
    "forest": forest,
    "town": town,
    "demo": demo_terrain,
}
