"""Maps of level plates under a sun at the zenith, and receivers at any place and depth above them.

Depths in such a map are exactly known: a plate at height y under `RANGE` has depth 1 - y / RANGE.
`points=` asks for receivers that no surface holds, so that filters can be tried on any receiver.
"""

import numpy as np

import csm
from csm import shapes, spaces

RANGE = 10.0  # [m], the maps' depth range
SIDE = 8.0  # [m] of what is seen
SUN = csm.Sun(to_light=(0, 1, 0))
CAMERA = csm.Camera.orthographic(
    (0, 20, 0), (0, 0, 0), up=(0, 0, -1), height=SIDE, near=1, far=40, size=(32, 32)
)


def settings(**more):
    """One map over what is seen, without any bias."""
    plain = {
        "cascade_count": 1,
        "map_size": 64,
        "fit": "box",
        "view_range": "camera",
        "depth_range": "manual",
        "manual_depth_range": (-RANGE, 0.0),
        "bias": "manual",
        "receiver_plane": False,
    }
    return csm.ShadowSettings(**{**plain, **more})


def scene(depths, count=400, seed=0, largest=0.6):
    """Square plates by lot, each at one of `depths`, over a ground at the last of them."""
    random = np.random.default_rng(seed)
    height = RANGE * (1.0 - np.asarray(depths, np.float64))
    ground, triangles = shapes.ground(3.0 * SIDE)
    positions, corners = [np.add(ground, [0.0, height[-1], 0.0])], [triangles]
    for _ in range(count):
        side = random.uniform(0.1, largest)
        middle = random.uniform(-0.7 * SIDE, 0.7 * SIDE, 2)
        y = random.choice(height)
        plate, triangles = shapes.ground(side)
        corners.append(triangles + sum(map(len, positions)))
        positions.append(np.add(plate, [middle[0], y, middle[1]]))
    return csm.Scene.from_arrays(np.concatenate(positions), np.concatenate(corners))


def receivers(cascades, texels, depths):
    """World points at (m, 2) places in texels and (m,) depths of the first map."""
    uvz = np.column_stack([np.asarray(texels) / cascades.map_size[0], depths])
    return spaces.transform_points(np.linalg.inv(cascades.uvz_from_world[0]), uvz)


def places(frame, count, seed, border):
    """(count, 2) places [texels] by lot, `border` texels from the rim."""
    size = frame.cascades.map_size[0]
    return np.random.default_rng(seed).uniform(border, size - border, (count, 2))


def bilinear(texture, place):
    """(m, k) values of a (s, s, k) texture between texels; at its rim those at the rim."""
    place = np.clip(place, 0.5, len(texture) - 0.5) - 0.5
    corner = np.clip(np.floor(place), 0, len(texture) - 2).astype(int)
    share = place - corner
    total = 0.0
    for v in (0, 1):
        for u in (0, 1):
            weight = np.abs(1 - u - share[:, 0]) * np.abs(1 - v - share[:, 1])
            total = total + weight[:, None] * texture[corner[:, 1] + v, corner[:, 0] + u]
    return total


def seen(renderer, world, wanted, texels, depths, outputs=("moments", "shadow_maps")):
    """The frame, and its visibility of receivers at places [texels] and depths."""
    frame = renderer.render(world, CAMERA, SUN, wanted, outputs=outputs)
    points = receivers(frame.cascades, texels, depths)
    again = renderer.render(world, CAMERA, SUN, wanted, outputs=outputs, points=points)
    return again, again.point_visibility.astype(np.float64)
