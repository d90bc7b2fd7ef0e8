"""Figures of coverage against brute force: which texels a slice meets, what maps hold of it."""

import numpy as np
import oracles
import pytest
from views import kinds, rescaled_depth, scene_of, shifted, volume_samples

import csm
from csm import spaces

spatial = pytest.importorskip("scipy.spatial")

SUN = csm.Sun((0.35, 0.8, 0.25))
CAMERA = csm.Camera.look_at((3, 6, 9), (0, 4, -20), near=0.5, far=120, size=(160, 90))
BOX = csm.ShadowSettings(fit="box", snap="none", map_size=256)
SPHERE = csm.ShadowSettings(fit="sphere", map_size=256)


def depths(points):
    return (points - CAMERA.eye) @ -CAMERA.backward


def texels_met(polygon, size):
    """Share of the texels of a map that a convex polygon (k, 2), in texels, meets: texels of which
    no side and no side of the polygon separates it."""
    hull = polygon[spatial.ConvexHull(polygon).vertices]
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    texels = np.stack(np.meshgrid(np.arange(size), np.arange(size)), -1).reshape(-1, 1, 2) + corners
    met = np.ones(len(texels), bool)
    edges = np.roll(hull, -1, axis=0) - hull
    for normal in [*np.eye(2), *np.stack([edges[:, 1], -edges[:, 0]], 1)]:
        of_hull, of_texels = hull @ normal, texels @ normal
        met &= (of_texels.max(axis=1) > of_hull.min()) & (of_texels.min(axis=1) < of_hull.max())
    return met.mean()


@pytest.mark.parametrize("select", ["interval", "map"])
@pytest.mark.parametrize("bounded", [False, True])
def test_utilisation_is_the_share_of_texels_that_the_slice_meets(select, bounded):
    scene = scene_of([[-20, 0, -60], [20, 8, 5]]) if bounded else None
    cascades = csm.fit_cascades(CAMERA, SUN, SPHERE.replace(map_size=37), scene=scene)
    check = csm.check_cascades(cascades, CAMERA, select=select, scene=scene)
    for i in range(4):
        last = cascades.splits[4] if select == "map" else cascades.splits[i + 1]
        planes = oracles.camera_planes(CAMERA, cascades.splits[i], last)
        if bounded:
            planes = np.concatenate([planes, oracles.box_planes(scene.bounds)])
        vertices = oracles.polytope_vertices(planes, 1e-9)
        texels = spaces.transform_points(cascades.uvz_from_world[i], vertices)[:, :2] * 37
        assert check.utilisation[i] == pytest.approx(texels_met(texels, 37), abs=1e-12)


@pytest.mark.parametrize("bounded", [False, True])
def test_overlap_is_the_share_of_volume_that_each_map_holds(bounded):
    scene = scene_of([[-20, 0, -60], [20, 8, 5]]) if bounded else None
    cascades = csm.fit_cascades(CAMERA, SUN, SPHERE, scene=scene)
    check = csm.check_cascades(cascades, CAMERA, scene=scene)
    rng = np.random.default_rng(4)
    for i in range(4):
        points = volume_samples(CAMERA, *cascades.splits[i : i + 2], 100000, rng)
        if bounded:
            points = points[((points >= scene.bounds[0]) & (points <= scene.bounds[1])).all(axis=1)]
        for j in range(4):
            clip = spaces.transform_points(cascades.clip_from_world[j], points)
            held = (np.abs(clip[:, :2]) <= 1).all(axis=1) & (clip[:, 2] >= 0) & (clip[:, 2] <= 1)
            noise = 4 * np.sqrt(0.25 / len(points))
            assert check.overlap[i, j] == pytest.approx(held.mean(), abs=noise)


def test_texels_per_pixel_are_those_of_a_step_of_one_pixel():
    cascades = csm.fit_cascades(CAMERA, SUN, SPHERE)
    check = csm.check_cascades(cascades, CAMERA)
    for i in range(4):
        pixels = 2 * CAMERA.half_height / CAMERA.size[1] * cascades.splits[i : i + 2]
        assert check.texels_per_pixel[i] == pytest.approx(pixels / cascades.texel_size[i, 0])


def test_receivers_alone_are_judged_when_given():
    good = csm.fit_cascades(CAMERA, SUN, BOX)
    bad = shifted(good, 2, 30.0)
    points = oracles.sample_slice(CAMERA, *good.splits[[0, 4]], 20000, np.random.default_rng(7))
    clip = spaces.transform_points(bad.clip_from_world[2], points)
    own = (depths(points) > good.splits[2]) & (depths(points) <= good.splits[3])
    inside = (np.abs(clip[:, :2]) <= 1).all(axis=1)
    check = csm.check_cascades(bad, CAMERA, receivers=points)
    assert kinds(check) == {"overflow"}
    assert check.overlap[2, 2] == pytest.approx((own & inside).sum() / own.sum(), abs=1e-3)
    outside = np.abs(clip[own, :2]).max() - 1
    assert check.problems[0].amount == pytest.approx(outside * 128, rel=1e-9)
    kept = points[~own | inside]
    check = csm.check_cascades(bad, CAMERA, receivers=kept)
    assert check.ok
    texels = (spaces.transform_points(bad.uvz_from_world[2], kept[own[~own | inside]]) * 256)[:, :2]
    used = len(np.unique(np.floor(texels).clip(0, 255), axis=0)) / 256**2
    assert check.utilisation[2] == pytest.approx(used, rel=0.01)


def test_receivers_outside_the_picture_do_not_count():
    good = csm.fit_cascades(CAMERA, SUN, SPHERE)
    behind = CAMERA.eye + CAMERA.backward * [[1.0], [50.0]]
    beside = CAMERA.eye - 20 * CAMERA.backward + 1e3 * CAMERA.right
    check = csm.check_cascades(good, CAMERA, receivers=[*behind, beside])
    assert check.ok
    assert (check.utilisation == 0).all()


def test_receivers_in_a_map_but_not_in_its_depth_are_a_matter_of_depth():
    good = csm.fit_cascades(CAMERA, SUN, SPHERE)
    points = oracles.sample_slice(CAMERA, 0.5, 119.9, 2000, np.random.default_rng(7))
    depth = -(points @ good.light_from_world[0, 2, :3])
    bad = rescaled_depth(good, good.depth_range.min(), depth.max() - 2.0)
    for select in ("interval", "map"):
        check = csm.check_cascades(bad, CAMERA, receivers=points, select=select)
        assert kinds(check) == {"depth"}
        assert max(p.amount for p in check.problems) == pytest.approx(2.0)


def test_receivers_on_a_split_belong_to_the_map_that_holds_them():
    # Depths of points on a split come out a rounding before or behind it, in any engine.
    good = csm.fit_cascades(CAMERA, SUN, BOX)
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-1, 1, (2, 500)) * [[CAMERA.half_width], [CAMERA.half_height]]
    axes = np.stack([CAMERA.right, CAMERA.up, -CAMERA.backward])
    rounding = 1 + 1e-13 * rng.uniform(-1, 1, (500, 1))
    for split in good.splits[1:]:
        points = CAMERA.eye + np.stack([x, y, np.ones(500)], 1) * split * rounding @ axes
        assert 0.1 < (depths(points) > split).mean() < 0.9
        for select in ("interval", "map"):
            assert csm.check_cascades(good, CAMERA, receivers=points, select=select).ok
    farther = CAMERA.eye + np.stack([x, y, np.ones(500)], 1) * (good.splits[4] * (1 + 1e-9)) @ axes
    wider = CAMERA.replace(far=CAMERA.far + 1)
    assert kinds(csm.check_cascades(good, wider, receivers=farther)) == {"gap"}
