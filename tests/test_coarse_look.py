"""csrc/core/coarse_*.c against their definitions, pixel by pixel in plain Python."""

from types import SimpleNamespace

import numpy as np
import pytest

import csm
from csm.coarse_look import (
    blockers_of,
    edges_of,
    gaps_of,
    layered_share_of,
    outline_of,
    thin_share_of,
)
from csm.horizons import ends_of, points_of
from csm.sampling import edge_slopes

SIZES = [(9, 7), (1, 8), (8, 1), (1, 1), (2, 3)]  # width, height
FLAT = 0.02
WALLS = 10
EVERYWHERE = np.array([[-2e3] * 3, [2e3] * 3])


def camera_of(size, orthographic=False):
    camera = csm.Camera.look_at((3, 2, 5), (1, 1, -4), fov_y_deg=50, near=0.5, far=300, size=size)
    return camera.replace(orthographic=True) if orthographic else camera


def point_of(camera, x, y, depth):
    """World point that a camera sees at a place of its picture plane."""
    across = x * camera.right + y * camera.up
    ahead = -np.asarray(camera.backward)
    if camera.orthographic:
        return camera.eye + across + depth * ahead
    return camera.eye + depth * (across + ahead)


def pixel_point(camera, depths, row, column):
    x, y = camera.pixel_plane()
    return point_of(camera, x[column], y[row], float(depths[row, column]))


def by_row(points):
    return np.array(sorted(map(tuple, points))).reshape(-1, 3)


# -- thin casters ----------------------------------------------------------------------------------


def maps_of(depths, texel=0.1, span=10.0, matrices=None, **more):
    """A frame of these maps (n, size, size)."""
    count = len(depths)
    matrices = np.broadcast_to(np.eye(4), (count, 4, 4)) if matrices is None else matrices
    cascades = SimpleNamespace(
        count=count,
        uvz_from_world=matrices,
        texel_size=np.full((count, 2), (0.5 * texel, texel)),
        depth_range=np.full((count, 2), (1.0, 1.0 + span)),
    )
    return SimpleNamespace(shadow_maps=np.asarray(depths, np.float32), cascades=cascades, **more)


@pytest.mark.parametrize(("width", "share"), [(1, 1.0), (2, 1.0), (3, 2 / 3), (4, 0.0), (5, 0.0)])
@pytest.mark.parametrize("shift", [0, 7])  # across the border too
@pytest.mark.parametrize("turned", [False, True])
def test_a_comb_is_thin_up_to_two_texels(width, share, shift, turned):
    """Of three texels the middle one has its background within two on both sides; outlines count
    half, along one axis alone."""
    row = np.roll(np.where(np.arange(32) % 16 < width, 0.25, 1.0), shift)
    comb = np.tile(row, (32, 1))
    assert thin_share_of(maps_of([comb.T if turned else comb])) == share


def thin_by_hand(frame):
    thin, outline = 0, 0.0
    for depths, size, reach in zip(
        frame.shadow_maps, frame.cascades.texel_size, frame.cascades.depth_range, strict=True
    ):
        jump = np.float32(4.0 * max(size) / (reach[1] - reach[0]))
        n = len(depths)
        for v in range(n):
            for u in range(n):
                found = []
                for dv, du in ((1, 0), (0, 1)):
                    sides = [
                        any(
                            depths[(v + s * k * dv) % n, (u + s * k * du) % n] > depths[v, u] + jump
                            for k in (1, 2)
                        )
                        for s in (-1, 1)
                    ]
                    outline += 0.5 * any(sides)
                    found.append(all(sides))
                thin += any(found)
    return min(thin / outline, 1.0) if outline else 0.0


@pytest.mark.parametrize("size", [5, 6, 19, 64, 65, 131])
@pytest.mark.parametrize("cast", [0.05, 0.4, 0.8])
def test_thin_share_by_hand(size, cast):
    rng = np.random.default_rng(size)
    depths = np.where(rng.random((3, size, size)) < cast, rng.random((3, size, size)), 1.0)
    depths[1] = np.round(depths[1], 1)
    depths[2] = 1.0  # no casters
    frame = maps_of(depths)
    assert thin_share_of(frame) == thin_by_hand(frame)
    assert thin_share_of(maps_of(depths[2:])) == 0.0


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("place", [0, 1, 4, 63])
def test_what_is_just_a_jump_farther_off_is_not_something_else(axis, place):
    """Whatever rounds: both depths and the jump, 4 texels of 3/64 m over a metre, are exact."""
    depths = np.ones((1, 64, 64))
    at = [0, slice(None), slice(None)]
    at[1 + axis] = place
    for near, expected in ((0.8125, 0.0), (0.75, 1.0)):
        depths[tuple(at)] = near
        frame = maps_of(depths, texel=3 / 64, span=1.0)
        assert thin_share_of(frame) == thin_by_hand(frame) == expected


def test_a_map_and_its_transpose_are_as_thin():
    """Wires along either axis, at the border, too."""
    for place in (0, 1, 77, 130):
        depths = np.ones((131, 131))
        depths[20:60, 20:60] = 0.5
        depths[place] = 0.25
        assert thin_share_of(maps_of([depths])) == thin_share_of(maps_of([depths.T])) > 0.5


# -- outline ---------------------------------------------------------------------------------------


def outline_by_hand(pictures, points, axes):
    found = []
    for camera, depths, facing in pictures:
        for row, column in zip(*np.nonzero(facing), strict=True):
            depth = float(depths[row, column])
            found.append((depth, pixel_point(camera, depths, row, column)))
    camera = pictures[0][0]
    found += [(float((point - camera.eye) @ -camera.backward), point) for point in points]
    low, high = min(depth for depth, _ in found), max(depth for depth, _ in found)
    slices = [[] for _ in range(12)]
    for depth, point in found:
        borders = [low * (high / low) ** (k / 12) for k in range(1, 12)]
        slices[sum(border < depth for border in borders)].append(point)
    kept = set()
    for inside in slices:
        for k in range(16):
            along = np.array([np.cos(k * np.pi / 8), np.sin(k * np.pi / 8)]) @ axes
            if inside:
                kept.add(tuple(max(inside, key=lambda point: point @ along)))
    return kept


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("size", [*SIZES, (23, 31)])
def test_outline_by_hand(size, orthographic):
    rng = np.random.default_rng(sum(size))
    camera = camera_of(size, orthographic)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    pictures = [
        (camera, rng.uniform(1, 90, size[::-1]).astype(np.float32), rng.random(size[::-1]) < share)
        for share in (0.8, 0.3)
    ]
    if any(facing.any() for *_, facing in pictures):
        expected = by_row(outline_by_hand(pictures, [], axes))
        assert by_row(outline_of(pictures, None, axes)) == pytest.approx(expected, rel=1e-12)
    dark = [(camera, pictures[0][1], np.zeros(size[::-1], bool))]
    assert outline_of(dark, None, axes).shape == (0, 3)


@pytest.mark.parametrize("away", [0.0, 1e4, 1e7])
@pytest.mark.parametrize("orthographic", [False, True])
def test_outline_of_a_plane_by_hand(orthographic, away):
    """Most blocks of its pixels lie within what others reach to; blocks are cut off at the border,
    and planes go on past their last pixels."""
    size = width, height = 139, 75
    camera = camera_of(size, orthographic)
    camera = camera.replace(eye=camera.eye + away * np.array([1.0, 0.3, -0.7]))
    full = finer(camera, 4)
    axes = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0][:2]
    below = np.arange(1, height + 1)[:, None] + 0.1 * np.arange(width)
    depths = (70.0 / below if not orthographic else 90.0 - below).astype(np.float32)
    depths[20:24, 30:60] *= 0.5  # something stands before it
    facing = below > 3.0
    frame = SimpleNamespace(view_depth=depths, valid=np.ones(facing.shape, bool))
    ends, _ = ends_of(full, camera, frame, facing, camera.eye + EVERYWHERE)
    points = points_of(ends)
    assert len(points) > 500
    pictures = [(camera, depths, facing)]
    kept = outline_of(pictures, ends, axes)
    expected = by_row(outline_by_hand(pictures, points, axes))
    assert by_row(kept) == pytest.approx(expected, rel=1e-12)
    past = {tuple(point) for point in points}
    assert any(tuple(point) in past for point in kept)


@pytest.mark.parametrize("orthographic", [False, True])
def test_outline_past_ends_by_hand(orthographic):
    """Of planes in pieces, which come and go behind each other: where slices of depth lie between
    a pixel and what is seen past it, each point between counts."""
    rng = np.random.default_rng(9)
    camera = camera_of((16, 12), orthographic)
    axes, won = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2], 0
    for _ in range(12):
        frame, facing = pieces_of_planes(rng, (16, 12), orthographic, horizon=True)
        ends, _ = ends_of(finer(camera, 4), camera, frame, facing, EVERYWHERE)
        pictures, points = [(camera, frame.view_depth, facing)], points_of(ends)
        kept = outline_of(pictures, ends, axes)
        expected = by_row(outline_by_hand(pictures, points, axes))
        assert by_row(kept) == pytest.approx(expected, rel=1e-12)
        past = {tuple(point) for point in points}
        won += sum(tuple(point) in past for point in kept)
    assert won > 100


# -- ends of planes --------------------------------------------------------------------------------


def ends_by_hand(camera, small, frame, facing):
    """Points, and coarse pixels (row, column) round the horizon."""
    (width, height), full = small.size, camera.size
    x, y = camera.pixel_plane()
    small_x, small_y = small.pixel_plane()

    def value(row, column):
        depth = float(frame.view_depth[row, column]) if frame.valid[row, column] else 1.0
        return depth if camera.orthographic else 1.0 / depth

    points, box = [], []
    for row in range(height):
        for column in range(width):
            for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                line = [(row - k * down, column - k * right) for k in (2, 1, 0)]
                if not all(0 <= r < height and 0 <= c < width and facing[r, c] for r, c in line):
                    continue
                first, second, last = (value(*at) for at in line)
                step, ahead = last - second, (row + down, column + right)
                if abs(step - (second - first)) > FLAT * abs(step):
                    continue
                inside = 0 <= ahead[0] < height and 0 <= ahead[1] < width
                seen = inside and frame.valid[ahead]
                if seen and abs(value(*ahead) - last - step) <= FLAT * abs(step):
                    continue
                if not seen and last + step <= 0.0 and not camera.orthographic:
                    box += [(row, column), ahead if inside else (row, column)]
                for pixel in range(full[1] if down else full[0]):
                    ratio = (full[1] / height) if down else (full[0] / width)
                    place = (pixel + 0.5) / ratio - 0.5  # in coarse pixels
                    far = (place - (row if down else column)) * (down or right)
                    depth = last + step * far
                    if not (0.0 < far < 1.0 and depth > 0.0):
                        continue
                    next_one = value(*ahead) if seen else 0.0
                    if not camera.orthographic:
                        depth, next_one = 1.0 / depth, 1.0 / next_one if seen else 0.0
                    if depth <= camera.far and (not seen or depth <= next_one):
                        at = (small_x[column], y[pixel]) if down else (x[pixel], small_y[row])
                        points.append(point_of(camera, *at, depth))
    return points, box


def finer(camera, ratio):
    """The camera of the full picture, of so many pixels along one of this."""
    width, height = camera.size
    return camera.replace(size=(width * ratio, height * ratio), half_width=camera.half_width,
                          half_height=camera.half_height)  # fmt: skip


def pieces_of_planes(rng, size, orthographic, horizon):
    """A frame of three planes, one up to a horizon, and which of its pixels face the sun."""
    rows, columns = np.indices(size[::-1])
    level, tilts = rng.uniform(0.1, 1.0, 3), rng.uniform(-0.05, 0.05, (3, 2))
    planes = [a + b * rows + c * columns for a, (b, c) in zip(level, tilts, strict=True)]
    if horizon:
        planes[0] = 0.03 * (size[1] // 2 - rows + 0.3)
    which = (rows + columns > rng.uniform(0, 20)).astype(int) + (rng.random(size[::-1]) < 0.1)
    linear = np.choose(which, planes)
    valid = (linear > 1 / 250) & (rng.random(size[::-1]) < 0.97)
    depth = np.where(valid, np.abs(linear) if orthographic else 1 / np.abs(linear), 1e9)
    facing = valid & (rng.random(size[::-1]) < 0.95)
    return SimpleNamespace(view_depth=depth.astype(np.float32), valid=valid), facing


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("ratio", [2, 4])
@pytest.mark.parametrize("size", [*SIZES, (16, 12), (150, 12), (9, 140)])  # more than 64 at once
def test_ends_of_planes_by_hand(size, ratio, orthographic):
    rng = np.random.default_rng(sum(size) + ratio)
    camera = camera_of((size[0] * ratio, size[1] * ratio), orthographic)
    small = camera.replace(size=size, half_width=camera.half_width, half_height=camera.half_height)
    total = boxes = 0
    for trial in range(6):
        frame, facing = pieces_of_planes(rng, size, orthographic, horizon=trial % 2)
        ends, part = ends_of(camera, small, frame, facing, EVERYWHERE)
        points = points_of(ends)
        expected, box = ends_by_hand(camera, small, frame, facing)
        assert len(points) == len(expected)
        assert by_row(points) == pytest.approx(by_row(expected), rel=1e-9)
        if not box:
            assert part is None
        else:
            rows, columns = np.array(box).T
            wide = ((np.ptp(columns) + 1) * ratio, (np.ptp(rows) + 1) * ratio)
            assert part is None if np.prod(wide) > np.prod(size) else part.size == wide
        total, boxes = total + len(points), boxes + bool(box)
    if np.prod(size) > 100:
        assert total > 100
        assert orthographic or boxes


def test_a_wall_ends_at_the_border_of_the_picture():
    """Whatever lies next in memory: of every row and column the outer half of both last pixels."""
    camera = camera_of((14, 10))
    small = camera.replace(size=(7, 5), half_width=camera.half_width,
                           half_height=camera.half_height)  # fmt: skip
    seen = np.ones((5, 7), bool)
    frame = SimpleNamespace(view_depth=np.full((5, 7), 8.0, np.float32), valid=seen)
    ends, part = ends_of(camera, small, frame, seen, EVERYWHERE)
    points = points_of(ends)
    assert len(points) == 2 * 5 + 2 * 7
    assert part is None
    assert (points - camera.eye) @ -camera.backward == pytest.approx(8.0)


@pytest.mark.parametrize(("bend", "goes_on"), [(0.019, True), (-0.019, True), (0.021, False)])
@pytest.mark.parametrize("at", [2, 3])  # the step before or after the last of three pixels
def test_a_plane_bends_by_two_per_cent_of_a_step(bend, goes_on, at):
    """Three pixels in a row that bend more are none (at 2), and end if the next bends so (at 3)."""
    camera = camera_of((20, 4)).replace(orthographic=True)
    small = camera.replace(size=(5, 1), half_width=camera.half_width,
                           half_height=camera.half_height)  # fmt: skip
    steps = (1, 1 + bend, 5, 1) if at == 2 else (1, 1, 1 + bend, 1)
    depth = 8.0 + np.concatenate([[0.0], np.cumsum(steps)])
    frame = SimpleNamespace(view_depth=depth[None].astype(np.float32), valid=np.ones((1, 5), bool))
    facing = np.array([[True, True, True, False, False]])
    points = points_of(ends_of(camera, small, frame, facing, EVERYWHERE)[0])
    along = (points - camera.eye) @ camera.right
    to_the_right = along[along > small.pixel_plane()[0][2]]
    # four pixels lie between the centres of two coarse ones
    assert len(to_the_right) == (4 if goes_on == (at == 2) else 0)


def test_ground_ends_at_its_horizon():
    """Of a level camera rows above the ground end, full ones between the coarse: height over y."""
    camera = csm.Camera.look_at((0, 1.5, 0), (0, 1.5, -1), fov_y_deg=60, far=1000, size=(40, 54))
    size = (20, 27)
    small = camera.replace(size=size, half_width=camera.half_width, half_height=camera.half_height)
    _, y = small.pixel_plane()
    ground = np.repeat((y < -0.01)[:, None], 20, axis=1)  # the middle row looks along it
    depth = np.where(ground, 1.5 / np.maximum(-y[:, None], 1e-9), 1000.0).astype(np.float32)
    frame = SimpleNamespace(view_depth=depth, valid=ground)
    ends, part = ends_of(camera, small, frame, ground, EVERYWHERE)
    points = points_of(ends)
    assert points[:, 1] == pytest.approx(0.0, abs=1e-3)
    last = y[y < -0.01].max()
    rows = camera.pixel_plane()[1]
    between = rows[(rows < 0.0) & (rows > last + 1e-9)]
    found = np.unique(np.round(-points[-points[:, 2] > 1.5 / -last * 1.01, 2], 2))
    assert found == pytest.approx(np.sort(1.5 / -between), rel=1e-3)
    assert part.size == (40, 4)  # two rows of coarse pixels
    nearer = np.array([[-2e3, -1.0, -20.0], [2e3, 1.0, 0.0]])
    kept = points_of(ends_of(camera, small, frame, ground, nearer)[0])
    assert 0 < len(kept) < len(points)
    assert kept[:, 2].min() >= -20.1


# -- edges -----------------------------------------------------------------------------------------


def edges_by_hand(camera, frame, judged, lit, shrink):
    height, width = lit.shape
    slopes = edge_slopes(lit)
    found = []
    for axis in (0, 1):
        for row in range(height - axis):
            for column in range(width - 1 + axis):
                one, other = (row, column), (row + axis, column + 1 - axis)
                if not (judged[one] and judged[other] and lit[one] != lit[other]):
                    continue
                across = np.array([slope[one] + slope[other] for slope in slopes])
                length = np.hypot(*across)
                across = across / length if length > 1e-9 else np.eye(2)[axis]
                dark = other if lit[one] else one
                point = pixel_point(camera, frame.view_depth, *dark)
                found.append((dark, point, frame.normal[dark], across, shrink * abs(across[axis])))
    every = max(1, -(-len(found) // 3000))
    return found[::every], every


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("size", [*SIZES, (40, 60)])
def test_edges_by_hand(size, orthographic):
    rng = np.random.default_rng(sum(size))
    camera, shape = camera_of(size, orthographic), size[::-1]
    frame = SimpleNamespace(
        view_depth=rng.uniform(1, 9, shape).astype(np.float32),
        normal=rng.normal(size=(*shape, 3)).astype(np.float32),
    )
    checks = np.indices(shape).sum(axis=0) % 2 == 0  # whose means are level
    for judged, lit in (
        (rng.random(shape) < 0.8, rng.random(shape) < 0.5),
        (np.ones(shape, bool), checks),
        (np.zeros(shape, bool), checks),
    ):
        edges = edges_of(camera, frame, judged, lit, 3.5)
        expected, every = edges_by_hand(camera, frame, judged, lit, 3.5)
        assert every == (2 if size == (40, 60) and judged.all() else 1)
        assert len(edges["rows"]) == len(expected)
        for k, (dark, point, normal, across, length) in enumerate(expected):
            assert (edges["rows"][k], edges["columns"][k]) == dark
            assert edges["point"][k] == pytest.approx(point, rel=1e-12)
            assert np.array_equal(edges["normal"][k], normal)
            assert edges["across"][k] == pytest.approx(across, abs=1e-14)
            assert edges["length"][k] == pytest.approx(length * every, abs=1e-12)


@pytest.mark.parametrize(("pairs", "count", "every"), [(3000, 3000, 1), (3001, 1501, 2)])
def test_edges_are_counted_up_to_three_thousand(pairs, count, every):
    camera, shape = camera_of((pairs + 1, 1)), (1, pairs + 1)
    frame = SimpleNamespace(
        view_depth=np.ones(shape, np.float32), normal=np.ones((*shape, 3), np.float32)
    )
    lit = np.indices(shape)[1] % 2 == 0
    edges = edges_of(camera, frame, np.ones(shape, bool), lit, 2.0)
    assert len(edges["rows"]) == count
    assert edges["length"] == pytest.approx(2.0 * every)


# -- occluders -------------------------------------------------------------------------------------


@pytest.fixture(params=["affine", "projective"])
def lookups(request):
    """A frame of two maps, and points of which some fall outside, with normals."""
    rng = np.random.default_rng(8)
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[:, :3] += rng.uniform(-0.3, 0.3, (2, 3, 4))
    if request.param == "projective":
        matrices[:, 3, :3] = rng.uniform(0.0, 0.2, (2, 3))
    # a map of layers, holes among them, and one of noise
    near = np.tile(np.where(np.arange(9) > 6, 0.4, 0.1), (9, 1))
    near[1, 1] = near[7, 3] = 1.0
    depths = [near, rng.random((9, 9))]
    shape, count = (20, 30), 600
    frame = maps_of(
        depths,
        matrices=matrices,
        mask=(rng.random(shape) < 0.3).astype(np.float32),
        cascade_index=rng.choice(np.array([0, 1, 255], np.uint8), shape),
    )
    rows, columns = np.indices(shape).reshape(2, -1)
    normals = rng.normal(size=(count, 3))
    u, v = matrices[0, :2, :3]
    # of walls along the light, but for rounding
    normals[:WALLS], frame.cascade_index[0, :WALLS] = rng.normal(size=(WALLS, 2)) @ (u, v), 0
    return frame, rng.uniform(-0.2, 1.2, (count, 3)), normals, rows, columns


def receivers_at(frame, points, rows, columns):
    return {
        "point": points,
        "cascade": frame.cascade_index[rows, columns],
        "dark": frame.mask[rows, columns] < 0.5,
    }


def looked_up(frame, point, cascade, reach):
    """u, v [texels] of a point, and (u, v, gap [m]) of the texels around it."""
    moved = frame.cascades.uvz_from_world[cascade] @ [*point, 1.0]
    depths, (near, far) = frame.shadow_maps[cascade], frame.cascades.depth_range[cascade]
    u, v = moved[:2] / moved[3] * len(depths)
    middle = [min(max(int(np.floor(p)), reach), len(depths) - 1 - reach) for p in (u, v)]
    steps = range(-reach, reach + 1)
    texels = [(middle[0] + i, middle[1] + j) for j in steps for i in steps]
    return (u, v), [
        (i, j, (moved[2] / moved[3] - float(depths[j, i])) * (far - near)) for i, j in texels
    ]


def test_gaps_by_hand(lookups):
    frame, points, _, rows, columns = lookups
    gaps = gaps_of(frame, receivers_at(frame, points, rows, columns))
    met = 0
    for k, point in enumerate(points):
        at, expected = (rows[k], columns[k]), np.inf
        if frame.cascade_index[at] < 2 and frame.mask[at] < 0.5:
            gap = looked_up(frame, point, frame.cascade_index[at], 0)[1][0][2]
            expected = gap if gap > 0.0 else np.inf
        met += np.isfinite(expected)
        assert gaps[k] == pytest.approx(expected, rel=1e-12)
    assert 50 < met < 500


def test_blockers_by_hand(lookups):
    """A point's own plane is met by solving for where it lies over a texel's centre."""
    frame, points, normals, rows, columns = lookups
    edges = {"rows": rows, "columns": columns, "point": points, "normal": normals}
    distances = blockers_of(frame, edges)
    texel = frame.cascades.texel_size.max()
    met = 0
    for k, (point, normal) in enumerate(zip(points, normals, strict=True)):
        cascade = frame.cascade_index[rows[k], columns[k]]
        if cascade == 255:
            assert distances[k] == 0.0
            continue
        size = len(frame.shadow_maps[cascade])
        span = float(np.diff(frame.cascades.depth_range[cascade])[0])
        matrix = frame.cascades.uvz_from_world[cascade][:3, :3]
        system = np.stack([matrix[0], matrix[1], normal])
        slopes = np.zeros(2)  # [m per map]
        if k >= WALLS:
            slopes = [span * matrix[2] @ np.linalg.solve(system, e) for e in np.eye(3)[:2]]
        least = texel * (0.5 + 0.25 * np.abs(slopes).sum() / (size * texel))
        (u, v), around = looked_up(frame, point, cascade, 1)
        gaps = [g + ((i + 0.5 - u) * slopes[0] + (j + 0.5 - v) * slopes[1]) / size
                for i, j, g in around]  # fmt: skip
        held = [gap for gap in gaps if gap > least]
        met += bool(held)
        expected = 0.5 * (min(held) + max(held)) if held else 0.5 * texel
        assert distances[k] == pytest.approx(expected, rel=1e-9)
    assert met > 100


def test_layers_by_hand(lookups):
    frame, points, _, rows, columns = lookups
    texel = frame.cascades.texel_size.max()
    full, layered = 0, 0
    for k, point in enumerate(points):
        cascade = frame.cascade_index[rows[k], columns[k]]
        if cascade < 2:
            gaps = np.array([gap for *_, gap in looked_up(frame, point, cascade, 2)[1]])
            if (gaps > 0.5 * texel).all():
                full += 1
                layered += gaps.var() > 0.1 * (gaps.var() + gaps.mean() ** 2)
    assert 0 < layered < full
    assert layered_share_of(frame, receivers_at(frame, points, rows, columns)) == pytest.approx(
        layered / full
    )
    nowhere = points[:0], rows[:0], columns[:0]
    assert layered_share_of(frame, receivers_at(frame, *nowhere)) == 0.0


# -- refusals --------------------------------------------------------------------------------------


def test_arrays_of_other_sizes_are_refused():
    camera, axes = camera_of((4, 3)), np.eye(3)[:2]
    depth, seen = np.ones((3, 4), np.float32), np.ones((3, 4), bool)
    frame = SimpleNamespace(view_depth=depth, valid=seen, normal=np.ones((3, 4, 3), np.float32))
    with pytest.raises(ValueError, match=r"facing: expected shape \(3, 4\), got \(4, 3\)"):
        outline_of([(camera, depth, seen.T)], None, axes)
    for wrong in (np.empty((2, 3)), "ends"):
        with pytest.raises(TypeError, match="ends: expected what coarse_plane_ends gives"):
            outline_of([(camera, depth, seen)], wrong, axes)
        with pytest.raises(TypeError, match="ends: expected what coarse_plane_ends gives"):
            points_of(wrong)
    with pytest.raises(ValueError, match="pictures"):
        outline_of([], None, axes)
    with pytest.raises(ValueError, match="light_axes"):
        outline_of([(camera, depth, seen)], None, axes[:1])
    with pytest.raises(ValueError, match="facing"):
        ends_of(camera, camera, frame, seen[:2], EVERYWHERE)
    with pytest.raises(ValueError, match="bounds"):
        ends_of(camera, camera, frame, seen, EVERYWHERE[0])
    for name in ("judged", "lit"):
        given = {"judged": seen, "lit": seen} | {name: seen[:, 1:]}
        with pytest.raises(ValueError, match=name):
            edges_of(camera, frame, **given, shrink=1.0)


def test_maps_and_points_that_do_not_fit_are_refused(lookups):
    frame, points, normals, rows, columns = lookups
    for shape in ((1, 4, 4), (1, 8, 9)):
        with pytest.raises(ValueError, match="shadow_maps must be square, of at least 5"):
            thin_share_of(maps_of(np.ones(shape)))
    frame.cascades.texel_size = frame.cascades.texel_size[:1]
    with pytest.raises(ValueError, match="texel_size"):
        thin_share_of(frame)
    frame = maps_of(frame.shadow_maps, mask=frame.mask, cascade_index=frame.cascade_index)
    with pytest.raises(ValueError, match="cascade_index"):
        gaps_of(frame, receivers_at(frame, points, rows[1:], columns[1:]))
    edges = {"rows": rows, "columns": columns, "point": points, "normal": normals[1:]}
    with pytest.raises(ValueError, match="normals"):
        blockers_of(frame, edges)
    frame.cascades.uvz_from_world = frame.cascades.uvz_from_world[:1]
    with pytest.raises(ValueError, match="uvz_from_world"):
        layered_share_of(frame, receivers_at(frame, points, rows, columns))
