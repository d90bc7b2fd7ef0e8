"""Off-centre frusta: a tile of a picture shows what the picture shows there, in view, truth and
shadow, and every fit holds its slices."""

import pickle

import numpy as np
import oracles
import pytest
import small_scenes
from views import assert_finite, misses, scene_of, turned, uncovered

import csm

SUN = csm.Sun(small_scenes.SUNS["high"])
WHOLE = small_scenes.camera(0, size=(192, 108))
ABOVE = csm.Camera.orthographic((3, 20, 4), (0, 0, 0), height=16, near=-5, far=60, size=(192, 108))
TILES = {
    "right half": (slice(0, 108), slice(96, 192)),
    "lower left corner": (slice(60, 108), slice(0, 72)),
    "odd": (slice(31, 77), slice(53, 190)),
}
EVERY_TILE = pytest.mark.parametrize("tile", list(TILES.values()), ids=list(TILES))
BOTH = pytest.mark.parametrize("whole", [WHOLE, ABOVE], ids=["perspective", "orthographic"])


def tile_camera(camera, tile):
    """The camera whose picture is these rows and columns of another's."""
    width, height = camera.size
    rows, columns = tile
    share_x = (columns.start + columns.stop) / width - 1.0
    share_y = 1.0 - (rows.start + rows.stop) / height
    size = columns.stop - columns.start, rows.stop - rows.start
    return camera.replace(
        half_width=camera.half_width * size[0] / width,
        half_height=camera.half_height * size[1] / height,
        centre_x=camera.centre_x + share_x * camera.half_width,
        centre_y=camera.centre_y + share_y * camera.half_height,
        size=size,
    )


def off_centre(rng, fov, **changes):
    camera = turned(rng, fov, **changes)
    aside = rng.normal(size=2) * 10.0 ** rng.uniform(-3, 0.6)
    return camera.replace(
        centre_x=aside[0] * camera.half_width, centre_y=aside[1] * camera.half_height
    )


@BOTH
@EVERY_TILE
def test_a_tile_of_the_truth_is_the_truth_of_the_tile(whole, tile):
    scene = small_scenes.soup()
    expected = csm.truth(scene, whole, SUN)
    traced = csm.truth(scene, tile_camera(whole, tile), SUN)
    # Rays differ by a rounding of their tangents: at most a pixel where it decides.
    for name in ("valid", "facing", "mask"):
        differ = getattr(traced, name) != getattr(expected, name)[tile]
        assert np.count_nonzero(differ) <= 1, name
    same = traced.valid & expected.valid[tile]
    np.testing.assert_allclose(
        traced.position[same], expected.position[tile][same], rtol=0, atol=1e-9
    )


@BOTH
@EVERY_TILE
def test_a_tile_of_the_view_is_the_view_of_the_tile(renderer, whole, tile):
    scene = small_scenes.soup()
    outputs = ("mask", "valid", "view_depth", "normal")
    settings = csm.ShadowSettings(filter="none")  # facing alone: no map, so nothing depends on fits
    expected = renderer.render(scene, whole, SUN, settings, outputs=outputs)
    shown = renderer.render(scene, tile_camera(whole, tile), SUN, settings, outputs=outputs)
    # A rasteriser snaps corners to 1/256 pixel of its own picture: pixels on outlines may flip.
    flipped = shown.valid != expected.valid[tile]
    turned_away = (shown.normal != expected.normal[tile]).any(axis=-1)
    assert np.mean(flipped) <= 1e-3
    assert np.mean(turned_away) <= 5e-3
    assert shown.valid.mean() > 0.2
    same = shown.valid & expected.valid[tile] & ~turned_away
    assert np.array_equal(shown.mask[same], expected.mask[tile][same])
    # The ray is rounded to float32: grazing surfaces multiply it by their slope.
    np.testing.assert_allclose(
        shown.view_depth[same], expected.view_depth[tile][same], rtol=1e-5, atol=0
    )


@EVERY_TILE
@pytest.mark.parametrize("fit", ["sphere", "diameter", "box", "shifted", "clipped", "focus"])
def test_the_shadows_of_a_tile_are_as_right_as_those_of_the_picture(renderer, tile, fit):
    scene = csm.scenes.stairs(6)
    settings = csm.ShadowSettings(fit=fit, map_size=512)
    frame = renderer.render(scene, WHOLE, SUN, settings)
    shown = renderer.render(scene, tile_camera(WHOLE, tile), SUN, settings)
    whole = csm.compare(frame, csm.truth(scene, WHOLE, SUN))
    report = csm.compare(shown, csm.truth(scene, shown.camera, SUN))
    assert report.judged_count > 500
    # The same pixels and finer maps: a tile is never worse but by a few pixels on edges.
    there = whole.wrong_side[tile].sum() / whole.judged[tile].sum()
    assert report.disagreement <= there + 5e-3
    assert report.beyond_range == 0.0


@pytest.mark.parametrize("fit", ["sphere", "diameter", "box", "scene"])
def test_c1_off_centre_slices_lie_in_their_own_inner_windows(figure, fit):
    rng = np.random.default_rng(40)
    missed = 0
    for padding in (0, 3):
        settings = csm.ShadowSettings(
            fit=fit, filter="pcf" if padding else "hard", filter_size=2 * padding + 1 or 3,
            map_size=256, snap="exact" if padding else "none",
        )  # fmt: skip
        for fov in (1, 60, 120, 170):
            camera = off_centre(rng, fov, eye=rng.normal(size=3) * 100)
            cascades = csm.fit_cascades(camera, csm.Sun(rng.normal(size=3)), settings)
            assert_finite(cascades)
            missed += misses(camera, cascades, padding, rng)
    figure("C1", f"{fit}, off-centre: points outside their window", missed, 0, "points")


def test_c1_shifted_spheres_of_off_centre_views_leave_no_gap(figure):
    rng = np.random.default_rng(41)
    bare = 0
    for fov in (20, 60, 90, 120, 170):
        for count in (2, 4):
            camera = off_centre(rng, fov)
            settings = csm.ShadowSettings(fit="shifted", cascade_count=count, lam=1.0, snap="none")
            cascades = csm.fit_cascades(camera, csm.Sun(rng.normal(size=3)), settings)
            bare += uncovered(camera, cascades, 0, rng, samples=2000)
    figure("C1", "shifted, off-centre: points in no window", bare, 0, "points")


def test_x1_texels_of_off_centre_spheres_stand_still_while_the_camera_moves():
    rng = np.random.default_rng(42)
    # A jitter by parts of a pixel, as of temporal antialiasing, and a centre far from the axis.
    for x in (2 * WHOLE.half_width / 192 * 0.25, 3.0):
        camera = turned(rng, 50).replace(centre_x=x, centre_y=-0.125 * x)
        first = csm.fit_cascades(camera, SUN, csm.ShadowSettings())
        for _ in range(50):
            axes = oracles.random_rotation(rng)
            moved = camera.replace(
                eye=rng.normal(size=3) * 100, right=axes[0], up=axes[1], backward=axes[2]
            )
            cascades = csm.fit_cascades(moved, SUN, csm.ShadowSettings())
            assert np.array_equal(cascades.texel_size, first.texel_size)


def test_the_middle_of_an_off_centre_picture_is_its_centre():
    camera = csm.Camera.look_at((0, 0, 0), (0, 0, -1), fov_y_deg=90, size=(3, 3), centre=(2, -1))
    points = camera.clip_from_view @ camera.view_from_world @ [14.0, -7.0, -7.0, 1.0]
    np.testing.assert_allclose(points[:2] / points[3], 0, atol=1e-15)
    x, y = camera.pixel_plane()
    np.testing.assert_allclose(x, [2 - 2 / 3, 2, 2 + 2 / 3], rtol=1e-15)
    np.testing.assert_allclose(y, [-1 + 2 / 3, -1, -1 - 2 / 3], rtol=1e-15)
    above = csm.Camera.orthographic((0, 0, 0), (0, 0, -1), height=4, size=(2, 2), centre=(5, 6))
    points = above.clip_from_view @ above.view_from_world @ [7.0, 8.0, -7.0, 1.0]
    np.testing.assert_allclose(points[:2], 1, atol=1e-15)
    corners = oracles.camera_corners(above, 1.0, 2.0) - above.eye
    assert corners[:, 0].min() == pytest.approx(3, abs=1e-12)


def test_an_off_centre_camera_is_a_value_of_its_own():
    camera = csm.Camera.look_at((0, 1, 2), (0, 0, 0), centre=(0.25, -0.5))
    assert (camera.centre_x, camera.centre_y) == (0.25, -0.5)
    assert pickle.loads(pickle.dumps(camera)) == camera
    assert camera != csm.Camera.look_at((0, 1, 2), (0, 0, 0))
    assert camera.replace(size=(64, 64)).centre_x == 0.25
    assert camera.replace(centre_x=0, centre_y=0) == csm.Camera.look_at((0, 1, 2), (0, 0, 0))
    with pytest.raises(ValueError, match="centre must be 2 numbers"):
        csm.Camera.look_at((0, 1, 2), (0, 0, 0), centre=0.3)
    with pytest.raises(ValueError, match="centre_x must be a number"):
        camera.replace(centre_x=np.inf)


@pytest.mark.parametrize("fit", ["shifted", "clipped", "focus"])
@pytest.mark.parametrize("fov", [0.1, 179.0])
@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.7, -2.0)], ids=["centred", "off-centre"])
def test_w1_extreme_cameras_of_the_shared_fits(figure, fit, fov, centre):
    rng = np.random.default_rng(43)
    bare = 0
    for teleport in (0.0, 1e6):
        eye = np.array([1.0, 2.0, 3.0]) + teleport
        camera = csm.Camera.look_at(
            eye, eye - [0, 1, 0], up=(1, 0, 1), fov_y_deg=fov, near=1e-4, far=1e6, size=(16, 9)
        )
        camera = camera.replace(
            centre_x=centre[0] * camera.half_width, centre_y=centre[1] * camera.half_height
        )
        for to_light in ((0, 1, 0), (0.3, -1e-9, 0.5), (1, 1, 1)):
            for scene in (None, scene_of(np.array([[-50.0, 0, -50], [50, 10, 50]]) + teleport)):
                cascades = csm.fit_cascades(
                    camera, csm.Sun(to_light), csm.ShadowSettings(fit=fit), scene=scene
                )
                assert_finite(cascades)
                bare += uncovered(camera, cascades, 0, rng, scene=scene, samples=100)
    figure("W1", f"{fit}: points in no map", bare, 0, "points")
