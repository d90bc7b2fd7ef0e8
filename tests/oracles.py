"""Slow, obvious versions of the core's formulas, written from the papers and the specification,
never from the C: exact decimals, brute force over subsets, enumeration of vertices."""

import decimal
import itertools

import numpy as np

U = 2.0**-53  # half the spacing of doubles at 1


def split_distances(near, far, count, lam):
    """Practical scheme in 60 decimal digits, rounded to double at the end; (count + 1,)."""
    with decimal.localcontext() as context:
        context.prec = 60
        n, f, weight = decimal.Decimal(near), decimal.Decimal(far), decimal.Decimal(lam)
        log_ratio = (f / n).ln()
        splits = []
        for i in range(count + 1):
            share = decimal.Decimal(i) / count
            logarithmic = n * (share * log_ratio).exp()
            splits.append(float(weight * logarithmic + (1 - weight) * (n + (f - n) * share)))
    return np.array(splits)


def view_corners(half_width, half_height, near, far, orthographic=False, centre=(0.0, 0.0)):
    """(8, 3) corners as (right, up, depth), in the order LB LT RT RB, near then far."""
    corners = []
    for depth in (near, far):
        spread = 1.0 if orthographic else depth
        for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1)):
            across, along = centre[0] + x * half_width, centre[1] + y * half_height
            corners.append((across * spread, along * spread, depth))
    return np.array(corners)


def camera_corners(camera, near, far):
    """(8, 3) world corners of a camera's slice."""
    local = view_corners(
        camera.half_width,
        camera.half_height,
        near,
        far,
        orthographic=camera.orthographic,
        centre=(camera.centre_x, camera.centre_y),
    )
    return camera.eye + local @ np.stack([camera.right, camera.up, -camera.backward])


def enclosing_ball_radius(points):
    """Radius of the smallest ball round a few points: the smallest circumscribed ball of two,
    three or four of them that holds the rest."""
    points = np.asarray(points, np.longdouble)
    best = np.inf
    for size in (2, 3, 4):
        for subset in itertools.combinations(range(len(points)), size):
            ball = _circumscribed(points[list(subset)].astype(np.float64))
            if ball is None:
                continue
            distances = np.sqrt(((points - ball) ** 2).sum(axis=1))
            best = min(best, float(distances.max()))
    return best


def _circumscribed(points):
    """Centre of the smallest ball through all points; None if they are dependent."""
    edges = points[1:] - points[0]
    gram = edges @ edges.T
    if np.linalg.matrix_rank(gram) < len(gram):
        return None
    weights = np.linalg.solve(2.0 * gram, np.diag(gram))
    return points[0] + weights @ edges


def polytope_vertices(planes, tolerance):
    """Vertices of {p: n . p + d >= 0}: every meeting point of three planes that lies inside the
    rest by more than ``-tolerance``; (k, 3), k = 0 if the planes hold nothing."""
    planes = np.asarray(planes, np.float64)
    triples = np.array(list(itertools.combinations(range(len(planes)), 3)))
    normals, offsets = planes[triples, :3], planes[triples, 3]
    regular = np.abs(np.linalg.det(normals)) > 1e-12
    points = np.linalg.solve(normals[regular], -offsets[regular][..., None])[..., 0]
    inside = points @ planes[:, :3].T + planes[:, 3] >= -tolerance
    return points[inside.all(axis=1)]


def box_planes(bounds):
    """(6, 4) planes of a box (2, 3), normals inwards."""
    low, high = np.asarray(bounds, np.float64).reshape(2, 3)
    return np.concatenate([np.c_[np.eye(3), -low], np.c_[-np.eye(3), high]])


def camera_planes(camera, near, far):
    """(6, 4) world planes of a camera's slice through triples of its corners, normals inwards."""
    corners = camera_corners(camera, near, far)
    centre = corners.mean(axis=0)
    planes = []
    for face in ((0, 1, 5), (3, 2, 6), (0, 3, 7), (1, 2, 6), (0, 1, 2), (4, 5, 6)):
        a, b, c = corners[list(face)]
        # Of the far corners one edge may be a million times the other: scaled before the product.
        normal = np.cross((b - a) / np.linalg.norm(b - a), (c - b) / np.linalg.norm(c - b))
        normal /= np.linalg.norm(normal)
        offset = -normal @ a
        sign = 1.0 if normal @ centre + offset > 0 else -1.0
        planes.append([*(sign * normal), sign * offset])
    return np.array(planes)


def sample_slice(camera, near, far, count, rng):
    """(count, 3) world points in a slice: its corners, then points of its edges, faces and inside,
    even in screen position and in depth."""
    corners = camera_corners(camera, near, far)
    t = rng.uniform(size=(count, 3))
    snapped = rng.uniform(size=(count, 3)) < 0.4
    t[snapped] = np.round(t[snapped])
    depth = near + (far - near) * t[:, 2]
    spread = np.ones_like(depth) if camera.orthographic else depth
    x = (camera.centre_x + (2.0 * t[:, 0] - 1.0) * camera.half_width) * spread
    y = (camera.centre_y + (2.0 * t[:, 1] - 1.0) * camera.half_height) * spread
    points = camera.eye + np.stack([x, y, depth], axis=1) @ np.stack(
        [camera.right, camera.up, -camera.backward]
    )
    return np.concatenate([corners, points])[:count]


def rays_hit_box(origins, direction, box):
    """Whether the half line from each origin (n, 3) along a direction meets a box (6,): slabs."""
    low, high = np.asarray(box[:3]), np.asarray(box[3:])
    enter, leave = np.zeros(len(origins)), np.full(len(origins), np.inf)
    for axis in range(3):
        if direction[axis] == 0.0:
            beside = (origins[:, axis] < low[axis]) | (origins[:, axis] > high[axis])
            leave[beside] = -np.inf
            continue
        a = (low[axis] - origins[:, axis]) / direction[axis]
        b = (high[axis] - origins[:, axis]) / direction[axis]
        enter, leave = np.maximum(enter, np.minimum(a, b)), np.minimum(leave, np.maximum(a, b))
    return enter <= leave


def random_rotation(rng):
    """A rotation matrix, even over all of them."""
    q = rng.normal(size=4)
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
