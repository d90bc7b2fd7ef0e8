"""The truth against slow double-precision rays, closed forms and invariants."""

import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

pytest.importorskip("embreex", reason="csm.truth needs embreex")

from csm import embree, scenes
from csm.camera import Camera
from csm.disc import disc_directions
from csm.scene import Scene
from csm.sun import Sun
from csm.tracing import truth

BOX_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (0, 2) for z in (-1, 1)], float)
BOX_QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
BOX_TRIANGLES = np.concatenate([BOX_QUADS[:, [0, 1, 2]], BOX_QUADS[:, [0, 2, 3]]])
SUN_45 = Sun((1.0, 1.0, 0.0))


def quad(corners):
    return Scene.from_arrays(np.array(corners, float), [[0, 1, 2], [0, 2, 3]])


def ground(half=100.0, y=0.0):
    return quad([[-half, y, -half], [-half, y, half], [half, y, half], [half, y, -half]])


def box(offset=(0, 0, 0), size=1.0):
    return Scene.from_arrays(BOX_CORNERS * size + offset, BOX_TRIANGLES)


def from_above(half_height=5.0, size=(64, 64), **changes):
    """Parallel rays straight down: column j looks at x, row i at z, in steps of one pixel."""
    camera = Camera.orthographic(
        (0, 50, 0), (0, 0, 0), up=(0, 0, -1), height=2 * half_height, near=1, far=100, size=size
    )
    return camera.replace(**changes)


def brute_force(corners, origins, directions):
    """First hit of each ray with (m, 3, 3) triangles in doubles: index (-1: none) and parameter."""
    best = np.full(len(origins), np.inf)
    index = np.full(len(origins), -1)
    for number, (a, b, c) in enumerate(corners):
        p = np.cross(directions, c - a)
        determinant = p @ (b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("ij,ij->i", origins - a, p) / determinant
            q = np.cross(origins - a, b - a)
            v = np.einsum("ij,ij->i", directions, q) / determinant
            t = (q @ (c - a)) / determinant
        closer = (determinant != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < best)
        best[closer], index[closer] = t[closer], number
    return index, best


@pytest.fixture(scope="module")
def clutter():
    rng = np.random.default_rng(7)
    boxes = [box(rng.uniform(-9, 9, 3) * (1, 0, 1), rng.uniform(0.2, 1.5)) for _ in range(12)]
    sheets = [quad(rng.uniform(-6, 6, 3) + rng.normal(size=(4, 3))) for _ in range(6)]
    return Scene.merge(ground(20.0), *boxes, *sheets)


@pytest.mark.parametrize("orthographic", [False, True], ids=["perspective", "orthographic"])
def test_equals_brute_force_in_doubles(clutter, orthographic):
    size = (96, 64)
    camera = Camera.look_at((11, 7, 13), (0, 1, 0), fov_y_deg=50, near=0.1, far=60, size=size)
    if orthographic:
        camera = Camera.orthographic((11, 7, 13), (0, 1, 0), height=14, near=1, far=60, size=size)
    sun = Sun((0.5, 0.6, -0.4))
    result = truth(clutter, camera, sun)

    positions, triangles = clutter.flatten(relative_to=clutter.origin)
    corners = positions.astype(np.float32).astype(float)[triangles]
    column, row = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    x = ((column + 0.5) / size[0] * 2 - 1).ravel() * camera.half_width
    y = (1 - (row + 0.5) / size[1] * 2).ravel() * camera.half_height
    across = np.outer(x, camera.right) + np.outer(y, camera.up)
    origins = camera.eye - clutter.origin + (across if orthographic else 0 * across)
    directions = -camera.backward + (0 * across if orthographic else across)
    hit, depth = brute_force(corners, origins, directions)
    seen = hit >= 0
    # A float32 ray strays some 1e-6 m at 20 m; the chance that one of these 6144 pixels of 0.2 m
    # has an edge within that is below 1 %, so nothing may differ.
    assert np.array_equal(result.valid.ravel(), seen)
    points = origins[seen] + depth[seen, None] * directions[seen]
    assert result.position[result.valid] == pytest.approx(points + clutter.origin, abs=1e-9)

    edges = corners[hit[seen]]
    normal = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    normal *= -np.sign(np.einsum("ij,ij->i", normal, directions[seen]))[:, None]
    assert result.normal[result.valid] == pytest.approx(normal, abs=1e-12)
    facing = normal @ sun.to_light > 1e-5
    assert np.array_equal(result.facing[result.valid], facing)

    to_light = np.broadcast_to(sun.to_light, points.shape)
    blocker, distance = brute_force(corners, points + 1e-9 * normal, to_light)
    lit = facing & (blocker < 0)
    assert 0.1 < lit.mean() < 0.9, "the scene must have both to prove anything"
    assert np.array_equal(result.mask[result.valid], lit.astype(np.float32))
    blocked = facing & (blocker >= 0)
    expected = np.where(blocked, distance, np.inf)
    assert result.occluder_distance[result.valid] == pytest.approx(expected, abs=1e-6)


def test_shadow_of_a_box_at_45_degrees():
    """A box of 2 m throws a shadow of 2 m; the ray enters it through the side at x = -1."""
    result = truth(Scene.merge(ground(), box()), from_above(), SUN_45)
    x, z = result.position[..., 0], result.position[..., 2]
    on_ground = result.position[..., 1] < 1e-9
    shadow = on_ground & (x > -3) & (x < -1) & (np.abs(z) < 1)
    assert shadow.sum() > 100
    assert np.array_equal(result.mask, (~shadow).astype(np.float32))
    # Corners are small integers, exact in float32: only the doubles' own rounding is left.
    expected = np.where(shadow, np.sqrt(2.0) * (-1.0 - x), np.inf)
    assert result.occluder_distance == pytest.approx(expected, abs=1e-12)


def test_row_0_is_on_top_and_pixels_are_hit_at_their_centres():
    result = truth(ground(), from_above(half_height=4.0, size=(16, 8)), SUN_45)
    z, x = np.meshgrid(
        -4 + 1.0 * (np.arange(8) + 0.5), -8 + 1.0 * (np.arange(16) + 0.5), indexing="ij"
    )
    expected = np.stack([x, 0 * x, z], axis=-1)
    assert result.position == pytest.approx(expected, abs=1e-12)
    assert result.mask.dtype == np.float32
    assert result.valid.dtype == result.facing.dtype == bool
    assert result.position.dtype == result.normal.dtype == np.float64


def test_near_and_far_are_view_depths():
    """What lies before near is looked through, what lies beyond far is not seen."""
    scene = Scene.merge(ground(), box())
    through = truth(scene, from_above(near=48.5), SUN_45)  # the box's top is at depth 48
    assert np.abs(through.position[..., 1]).max() < 1e-9
    inside = (np.abs(through.position[..., [0, 2]]) < 1).all(axis=-1)
    assert not through.mask[inside].any(), "what is cut away from the view still throws a shadow"
    top_alone = truth(scene, from_above(far=49.0), SUN_45)
    assert np.array_equal(top_alone.valid, inside)
    assert (top_alone.mask[~top_alone.valid] == 1).all()
    assert np.isnan(top_alone.position[~top_alone.valid]).all()
    assert not top_alone.normal[~top_alone.valid].any()
    assert not top_alone.facing[~top_alone.valid].any()


@pytest.mark.parametrize("orthographic", [False, True], ids=["perspective", "orthographic"])
def test_a_camera_far_away_sees_the_same(orthographic):
    """At 1e6 m a float32 ray origin is 0.06 m off: rays must start near the scene."""
    away = np.array([0.6, 0.64, 0.48]) * 1e6
    camera = Camera.orthographic(away, (0, 0, 0), height=8, near=0.1, far=2e6, size=(64, 64))
    if not orthographic:
        camera = Camera.look_at(
            away, (0, 0, 0), fov_y_deg=np.degrees(8e-6), near=0.1, far=2e6, size=(64, 64)
        )
    close = Camera.orthographic(away / 1e5, (0, 0, 0), height=8, near=0.1, far=50, size=(64, 64))
    scene = Scene.merge(ground(), box())
    far, expected = truth(scene, camera, SUN_45), truth(scene, close, SUN_45)
    # The perspective rays spread by 4e-6 rad over the 4 m of the scene's depth, 1e-5 m.
    assert far.position == pytest.approx(expected.position, abs=1e-4)
    assert np.array_equal(far.mask, expected.mask)


@pytest.mark.parametrize("offset", [(78642.0, 2.0, -457941.0), (2.0**33, 0.0, -(2.0**20))])
def test_a_georeference_changes_nothing(offset):
    """Whole metres keep the origin-relative positions to the bit, so the rays are the same."""
    scene, camera = (
        Scene.merge(ground(), box()),
        Camera.look_at((6, 5, 7), (0, 0, 0), size=(80, 60)),
    )
    here = truth(scene, camera, SUN_45)
    there = truth(scene.placed(offset), camera.translated(offset), SUN_45)
    assert np.array_equal(here.mask, there.mask)
    assert np.array_equal(here.facing, there.facing)
    # One step of a double at the offset; the camera's eye was rounded to it too.
    step = np.spacing(np.abs(offset).max())
    assert there.position[there.valid] - offset == pytest.approx(
        here.position[here.valid], abs=4 * step
    )


def test_a_kilometre_slope_does_not_shadow_itself():
    """The lift grows with the coordinates: a fixed 1e-6 m gave 4 % false shadow at 815 m."""
    slope = quad([[-18e3, 0, -9e3], [-18e3, 0, 9e3], [18e3, 900, 9e3], [18e3, 900, -9e3]])
    camera = Camera.look_at((-16e3, 400, 300), (18e3, 500, 0), near=1, far=5e4, size=(160, 90))
    result = truth(slope, camera, Sun((1.0, 0.03, 0.2)))
    assert result.facing.sum() > 5000
    assert (result.mask[result.facing] == 1).all()


def test_a_gap_of_a_tenth_of_a_millimetre_is_a_contact_shadow():
    """The lift near the origin is 2.4e-7 of the largest coordinate: 1e-6 m at 4 m."""
    lid = quad([[-1, 1e-4, -1], [-1, 1e-4, 1], [1, 1e-4, 1], [1, 1e-4, -1]])
    result = truth(Scene.merge(ground(4.0), lid), from_above(near=49.99995), Sun((0, 1, 0)))
    under = (np.abs(result.position[..., [0, 2]]) < 1).all(axis=-1)
    assert under.any()
    assert np.array_equal(result.mask[result.valid], (~under).astype(np.float32)[result.valid])


def test_surfaces_have_two_sides_and_face_by_their_normal():
    scene = ground()
    below = Camera.look_at((0, -5, 0), (0, 0, 0), up=(0, 0, -1), size=(8, 8))
    seen_from_below = truth(scene, below, Sun((0, 1, 0)))
    assert (seen_from_below.normal == (0, -1, 0)).all()
    assert not seen_from_below.facing.any()
    assert not seen_from_below.mask.any()
    sun_below = truth(scene, below, Sun((0, -1, 0)))
    assert sun_below.facing.all()
    assert (sun_below.mask == 1).all()


@pytest.mark.parametrize(("slope", "facing"), [(0.0, False), (9e-6, False), (1.1e-5, True)])
def test_facing_begins_at_1e_minus_5(slope, facing):
    result = truth(ground(), from_above(size=(4, 4)), Sun((1.0, slope, 0.0)))
    assert (result.facing == facing).all()
    assert (result.mask == facing).all()


def test_instances_and_mirrors_are_traced_where_they_stand():
    corner = Scene.from_arrays(
        [[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    )
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    transforms = np.stack([np.eye(4), mirror])
    transforms[1, :3, 3] = 4, 0, 0
    instanced = Scene(corner.meshes, [0, 0], transforms)
    positions, triangles = instanced.flatten()
    camera = Camera.look_at((4, 5, 9), (2, 0, 1), size=(80, 60))
    one, other = (
        truth(s, camera, Sun((1.0, 0.2, 0.1)))
        for s in (instanced, Scene.from_arrays(positions, triangles))
    )
    assert np.array_equal(one.mask, other.mask)
    assert np.array_equal(one.normal, other.normal)
    assert 0 < one.mask[one.facing].mean() < 1


def test_any_number_of_threads_gives_the_same_bits(clutter, monkeypatch):
    camera = Camera.look_at((11, 7, 13), (0, 1, 0), size=(400, 200))  # more than one chunk
    sun = Sun((0.5, 0.6, -0.4), angular_diameter_deg=5.0)
    results = []
    for threads in (1, 4):
        monkeypatch.setattr(embree, "_core_count", lambda threads=threads: threads)
        results.append(truth(clutter, camera, sun, rays_per_pixel=3))
    for name in ("mask", "mask_point", "valid", "position", "normal", "occluder_distance"):
        one, other = (getattr(result, name) for result in results)
        assert one.tobytes() == other.tobytes(), name


def disc_share(offset):
    """Share of a unit disc on the far side of a chord at `offset` from its centre, -1 to 1."""
    offset = np.clip(offset, -1, 1)
    return (np.arccos(offset) - offset * np.sqrt(1 - offset**2)) / np.pi


def test_a_standard_error_out_of_reach_is_refused(monkeypatch):
    monkeypatch.setattr("csm.tracing.MAX_RAYS_PER_PIXEL", 40)
    with pytest.raises(ValueError, match=r"standard_error 1e-06 takes more than 40 rays.*after 40"):
        truth(*half_plane((8, 8)), rays_per_pixel=8, standard_error=1e-6)


def test_penumbra_of_a_straight_edge_is_the_share_of_the_disc():
    """Sun overhead, a half plane 10 m up: in the small-angle limit a chord cuts the disc."""
    roof = quad([[0, 10, -50], [0, 10, 50], [50, 10, 50], [50, 10, -50]])
    scene, diameter, rays = Scene.merge(ground(), roof), 10.0, 256
    camera = from_above(half_height=2.0, size=(64, 64), near=45.0)
    result = truth(scene, camera, Sun((0, 1, 0), diameter), rays_per_pixel=rays)
    x = result.position[..., 0]
    radius = 10 * np.tan(np.radians(diameter / 2))
    # The sun's directions are equal in solid angle, the chord formula in the plane: they differ by
    # (radius / 10 m)^2 / 4 = 0.002 at most.
    expected, curvature = disc_share(x / radius), 0.002
    error = result.mask - expected
    # Stratified or not, a mean of n rays of a share p has a deviation of at most sqrt(1 / 4n).
    assert np.abs(error).max() < 5 * np.sqrt(0.25 / rays) + curvature
    column_means = error.mean(axis=0)  # 64 pixels of the same x, each turned on its own
    assert np.abs(column_means).max() < 5 * np.sqrt(0.25 / (rays * 64)) + curvature
    assert np.array_equal(result.mask_point, (x < 0).astype(np.float32))


def half_plane(size=(64, 64)):
    """Scene, camera and sun of 10 degrees overhead: a roof's edge along x = 0, 10 m up."""
    roof = quad([[0, 10, -50], [0, 10, 50], [50, 10, 50], [50, 10, -50]])
    camera = from_above(half_height=2.0, size=size, near=45.0)
    return Scene.merge(ground(), roof), camera, Sun((0, 1, 0), 10.0)


def test_the_standard_error_asked_for_is_the_error_there_is():
    what = half_plane((56, 56))
    exact = truth(*what, rays_per_pixel=1024).mask.astype(float)
    rays = []
    for target in (0.05, 0.02, 0.008):
        found = truth(*what, rays_per_pixel=8, standard_error=target)
        assert found.standard_error <= target
        partly = (found.mask > 0) & (found.mask < 1)
        real = np.sqrt(np.mean((found.mask - exact)[partly] ** 2))
        # The root of a mean square of 1,000 normal errors is known to 2.2 % (one sigma); nine of
        # those, for errors that are not normal where little is seen, and for the 1024 rays' own.
        assert partly.sum() > 1000
        assert real == pytest.approx(found.standard_error, rel=0.2)
        assert found.rays_per_pixel % 8 == 0
        rays.append(found.rays_per_pixel)
    # It stops as soon as it may: a pattern less was not enough (the error falls as one over the
    # root of the patterns).
    assert rays == sorted(set(rays))
    assert found.standard_error * np.sqrt(rays[-1] / (rays[-1] - 8)) > 0.97 * target


def test_a_standard_error_gives_the_same_bits_whatever_the_threads(monkeypatch):
    what = half_plane((40, 20))
    monkeypatch.setattr(embree, "CHUNK_RAYS", 96)
    one = truth(*what, rays_per_pixel=4, standard_error=0.05)
    monkeypatch.setattr(embree, "_core_count", lambda: 1)
    monkeypatch.setattr(embree, "CHUNK_RAYS", 1 << 16)
    other = truth(*what, rays_per_pixel=4, standard_error=0.05)
    assert one.mask.tobytes() == other.mask.tobytes()
    assert one.standard_error == other.standard_error
    assert one.rays_per_pixel == other.rays_per_pixel >= 8


def test_patterns_are_independent_and_the_first_is_the_one_without():
    pixels, sun = np.arange(500), Sun((0.3, 0.8, -0.5), angular_diameter_deg=40.0)
    patterns = [
        np.stack([disc_directions(sun, 8, ray, pixels, pattern) for ray in range(8)])
        for pattern in range(3)
    ]
    assert np.array_equal(
        patterns[0], np.stack([disc_directions(sun, 8, ray, pixels) for ray in range(8)])
    )
    for one, other in ((0, 1), (0, 2), (1, 2)):
        a, b = (patterns[k][0] - patterns[k][0].mean(axis=0) for k in (one, other))
        correlation = (a * b).mean(axis=0) / np.sqrt((a**2).mean(axis=0) * (b**2).mean(axis=0))
        assert np.abs(correlation).max() < 5 / np.sqrt(500)


def test_a_point_has_no_standard_error_and_one_not_asked_for_is_unknown():
    scene, camera, sun = half_plane((8, 8))
    point = truth(scene, camera, Sun(sun.to_light), rays_per_pixel=4, standard_error=0.01)
    assert point.standard_error == 0.0
    assert np.isnan(truth(scene, camera, sun, rays_per_pixel=4).standard_error)
    assert np.isnan(truth(scene, camera, sun).standard_error)


def test_directions_fill_the_disc_evenly():
    rays, pixels, sun = 16, np.arange(4000), Sun((0.3, 0.8, -0.5), angular_diameter_deg=40.0)
    directions = np.concatenate([disc_directions(sun, rays, k, pixels) for k in range(rays)])
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0, abs=1e-12)
    cosine = directions @ sun.to_light
    edge = np.cos(np.radians(20.0))
    assert edge <= cosine.min() < edge + 1e-3 < 1 - 1e-5 < cosine.max() <= 1 + 1e-15
    # On a cap of equal solid angle the cosine is uniform. Strata make its mean far better than
    # 5 deviations of independent samples.
    count = len(cosine)
    assert cosine.mean() == pytest.approx((1 + edge) / 2, abs=5 * (1 - edge) / np.sqrt(12 * count))
    sideways = directions - cosine[:, None] * sun.to_light
    assert np.abs(sideways.mean(axis=0)).max() < 5 * np.sin(np.radians(20)) / np.sqrt(2 * count)


def test_a_point_is_a_point_whatever_the_rays():
    scene, camera = Scene.merge(ground(), box()), from_above()
    point = truth(scene, camera, SUN_45)
    assert np.shares_memory(point.mask, point.mask_point)
    for sun, rays in ((SUN_45, 16), (Sun(SUN_45.to_light, 5.0), 1)):
        same = truth(scene, camera, sun, rays_per_pixel=rays)
        assert np.array_equal(same.mask, point.mask)
    soft = truth(scene, camera, Sun(SUN_45.to_light, 5.0), rays_per_pixel=16)
    assert np.array_equal(soft.mask_point, point.mask)
    partly = (soft.mask > 0) & (soft.mask < 1)
    assert partly.any()
    assert (soft.mask[~soft.facing & soft.valid] == 0).all()


def test_trace_says_of_a_pixels_point_what_the_mask_says(clutter):
    camera = Camera.look_at((11, 7, 13), (0, 1, 0), size=(96, 64))
    result = truth(clutter, camera, Sun((0.5, 0.6, -0.4), 3.0), rays_per_pixel=4)
    seen = result.valid
    traced = result.trace(result.position[seen], result.normal[seen])
    assert traced.dtype == np.float32
    # The same rays but for one double rounding to the world and back.
    assert np.array_equal(traced, result.mask_point[seen])


def test_trace_of_free_points_needs_no_normal():
    result = truth(Scene.merge(ground(), box()), from_above(size=(4, 4)), SUN_45)
    points = [[-2, 0.5, 0], [-2, 1.5, 0], [-2, 1.5, 3], [0, 3, 0], [-2, -0.5, 0], [3, 1, 0]]
    assert result.trace(points).tolist() == [0, 1, 1, 1, 0, 1]
    assert result.trace([[3, 0, 0]], [[0, -1, 0]]).tolist() == [0]
    assert result.trace(np.zeros((0, 3))).shape == (0,)


@pytest.mark.parametrize(
    ("points", "normals", "text"),
    [
        ([1.0, 2.0, 3.0], None, r"points must be \(m, 3\).*\(3,\)"),
        ([[0.0, np.nan, 0.0]], None, "points must be finite"),
        ([["a", "b", "c"]], None, "points must be .* real numbers"),
        ([[0.0, 1.0, 0.0]], [[0.0, 1.0, 0.0]] * 2, "2 normals, 1 points"),
        ([[0.0, 1.0, 0.0]], [[0.0, np.inf, 0.0]], "normals must be finite"),
    ],
)
def test_trace_refuses(points, normals, text):
    result = truth(ground(), from_above(size=(2, 2)), SUN_45)
    with pytest.raises(ValueError, match=text):
        result.trace(points, normals)


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"scene": "town"}, TypeError, r"scene must be a csm\.Scene \(got str\)"),
        ({"camera": None}, TypeError, r"camera must be a csm\.Camera"),
        ({"sun": (0, 1, 0)}, TypeError, r"sun must be a csm\.Sun \(got tuple\)"),
        ({"rays_per_pixel": 2.0}, TypeError, r"rays_per_pixel must be an int \(got 2\.0\)"),
        ({"rays_per_pixel": True}, TypeError, "rays_per_pixel must be an int"),
        ({"rays_per_pixel": 0}, ValueError, r"rays_per_pixel must be 1 to 65536 \(got 0\)"),
        ({"rays_per_pixel": 65537}, ValueError, r"\(got 65537\)"),
        ({"standard_error": 0.1}, ValueError, r"needs rays_per_pixel of 2 or more \(got 1\)"),
        ({"rays_per_pixel": 2, "standard_error": 0.0}, ValueError, "standard_error must be"),
        ({"rays_per_pixel": 2, "standard_error": "low"}, TypeError, "standard_error must be"),
    ],
)
def test_truth_refuses(change, error, text):
    arguments = {"scene": ground(), "camera": from_above(size=(2, 2)), "sun": SUN_45, **change}
    views = [arguments.pop(name) for name in ("scene", "camera", "sun")]
    with pytest.raises(error, match=text):
        truth(*views, **arguments)


def test_a_missing_embreex_names_the_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex.rtcore_scene", None)
    with pytest.raises(ImportError, match=r"pip install cascaded-shadow-maps\[truth\]"):
        truth(ground(), from_above(size=(2, 2)), SUN_45)


def test_one_tree_serves_cameras_and_suns_and_goes_with_its_scene():
    scene = ground()
    truth(scene, from_above(size=(2, 2)), SUN_45)
    tree = embree.tree_of(scene)
    truth(scene, from_above(size=(3, 3)), Sun((0, 1, 0)))
    assert embree.tree_of(scene) is tree
    kept = len(embree._trees)
    del scene
    assert len(embree._trees) == kept - 1


def test_a_truth_pickles_and_still_traces():
    result = truth(Scene.merge(ground(), box()), from_above(size=(8, 8)), SUN_45)
    copy = pickle.loads(pickle.dumps(result))
    assert copy.mask.tobytes() == result.mask.tobytes()
    assert copy.trace([[-2, 0.5, 0], [3, 1, 0]]).tolist() == [0, 1]


def test_progress_rises_to_one():
    seen = []
    truth(ground(), from_above(size=(400, 400)), SUN_45, progress=seen.append)
    assert seen == sorted(seen)
    assert len(seen) == 3
    assert seen[-1] == 1.0


INTERRUPTED = """
import numpy as np
from csm.camera import Camera
from csm.scene import Scene
from csm.sun import Sun
from csm.tracing import truth
quad = [[-9, 0, -9], [-9, 0, 9], [9, 0, 9], [9, 0, -9]]
scene = Scene.from_arrays(np.array(quad, float), [[0, 1, 2], [0, 2, 3]])
camera = Camera.look_at((0, 5, 9), (0, 0, 0), size=(1920, 1080))
sun = Sun((0, 1, 0), angular_diameter_deg=5.0)
truth(scene, camera.replace(size=(8, 8)), sun)
print("tracing", flush=True)
try:
    truth(scene, camera, sun, rays_per_pixel=20000)
except KeyboardInterrupt:
    again = truth(scene, camera.replace(size=(8, 8)), sun)
    print("stopped", again.mask.mean() == 1.0, flush=True)
"""


def test_ctrl_c_stops_within_a_second_and_leaves_a_usable_tree():
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline() == "tracing\n"
        time.sleep(0.5)
        start = time.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "stopped True\n"
        assert time.monotonic() - start < 1.0
    finally:
        process.kill()
        process.communicate()


# ---------------------------------------------------------------------------------- the tree's lock


def test_a_trace_may_begin_while_another_builds_its_tree(monkeypatch):
    """As a signal handler on the same thread does; a lock of one entry would wait for itself."""
    outer, inner = scenes.plane_and_box(), scenes.stairs(3)

    class Nested(embree.RayTree):
        def __init__(self, scene):
            super().__init__(scene)
            if scene is outer:
                embree.tree_of(inner)

    monkeypatch.setattr(embree, "RayTree", Nested)
    done = []
    thread = threading.Thread(target=lambda: done.append(embree.tree_of(outer)), daemon=True)
    thread.start()
    thread.join(30)
    assert len(done) == 1
    assert embree.tree_of(outer) is done[0]


FORK = """
import os, signal, threading
import csm
from csm import embree

scene = csm.scenes.plane_and_box()
held, over = threading.Event(), threading.Event()

def hold():
    with embree._trees_lock:
        held.set()
        over.wait()

threading.Thread(target=hold).start()
held.wait()
child = os.fork()
if child == 0:
    signal.alarm(20)  # ends a child that waits for ever
    embree.tree_of(scene)
    os._exit(0)
status = os.waitpid(child, 0)[1]
over.set()
raise SystemExit(status)
"""


def test_a_fork_while_a_tree_is_built_leaves_the_child_a_lock():
    done = subprocess.run([sys.executable, "-c", FORK], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
