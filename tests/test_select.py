"""Selection by map, by interval, by frustum: one order between their indices, everywhere."""

import drawings
import numpy as np
import pytest
import small_scenes
from test_shadow_mask import assert_mask_matches

import csm
from csm import spaces

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal", "shadow_maps")
SIZES = {"equal": 256, "unequal": (256, 128, 64, 192)}
SUNS = ("high", "low", "in_the_face")
BASE = csm.ShadowSettings(filter="pcf", filter_size=7)


def frames_of(renderer, scene, camera, sun, settings):
    """By frustum, map, interval."""
    return [
        renderer.render(scene, camera, sun, settings.replace(select=select), outputs=OUTPUTS)
        for select in ("frustum", "map", "interval")
    ]


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("fit", ["sphere", "box", "diameter", "shifted"])
def test_c2_frustum_is_never_coarser_than_map_nor_map_than_interval(figure, renderer, fit, sizes):
    coarser = out_of_range = finer = 0
    for number in range(4):
        scene = small_scenes.SCENES["stairs"]()
        camera, sun = small_scenes.camera(number), csm.Sun(small_scenes.SUNS[SUNS[number % 3]])
        settings = BASE.replace(fit=fit, map_size=SIZES[sizes])
        frames = frames_of(renderer, scene, camera, sun, settings)
        frustum, by_map, interval = (frame.cascade_index.astype(int) for frame in frames)
        for frame in frames:
            out_of_range += np.count_nonzero(frame.cascade_index[frame.valid] >= 4)
        coarser += np.count_nonzero(frustum > by_map)
        # a shifted window serves what is seen of later slices, so its own slice may be another's
        if fit != "shifted":
            coarser += np.count_nonzero(by_map > interval)
        finer += np.count_nonzero(frustum < by_map)
    assert finer > 100  # the kernel's border is what they differ by
    figure(
        "C2", "index by frustum above that by map, by map above by interval", coarser, 0, "pixels",
        picture=lambda: drawings.compared(frustum / 4.0, by_map / 4.0),
    )  # fmt: skip
    figure("C2", "index of no cascade inside the range", out_of_range, 0, "pixels")


@pytest.mark.parametrize("sizes", SIZES)
def test_c2_frustum_takes_the_first_window_that_holds_the_point(figure, renderer, sizes):
    """Points all over, by the windows' own matrices in doubles; within 0.01 texel of a rim float32
    may decide either way."""
    scene, camera = small_scenes.soup(), small_scenes.camera(0)
    points = np.random.default_rng(8).uniform((-14, 0, -14), (14, 6, 14), size=(20_000, 3))
    for select, border in (("frustum", 0), ("map", 3)):
        settings = BASE.replace(select=select, map_size=SIZES[sizes], max_distance=13.0)
        frame = renderer.render(
            scene, camera, csm.Sun((0.4, 1, 0.3)), settings, outputs=("mask",), points=points
        )
        expected, sure = np.full(len(points), 255), np.ones(len(points), bool)
        cascades = frame.cascades
        for i in reversed(range(cascades.count)):
            uvz = spaces.transform_points(cascades.uvz_from_world[i], points)
            texels = uvz[:, :2] * cascades.map_size[i]
            inside = np.minimum(texels - border, cascades.map_size[i] - border - texels).min(axis=1)
            depth = np.minimum(uvz[:, 2], 1.0 - uvz[:, 2])
            expected[(inside > 0) & (depth > 0)] = i
            sure &= (np.abs(inside) > 0.01) & (np.abs(depth) > 1e-5)
        depth = spaces.transform_points(camera.view_from_world, points)[:, 2] * -1.0
        expected[depth > cascades.splits[-1]] = 255
        sure &= np.abs(depth - cascades.splits[-1]) > 1e-3
        assert sure.mean() > 0.95
        assert len(np.unique(expected)) == 5
        wrong = np.count_nonzero((frame.point_cascade != expected) & sure)
        figure("C2", f"first window that holds a point, by {select}", wrong, 0, "points")
        assert (frame.point_visibility[expected == 255][sure[expected == 255]] == 1.0).all()


@pytest.mark.parametrize("kernel", [2, 3, 7])
def test_c2_a_kernel_over_the_rim_takes_the_texels_at_it_again(renderer, evidence, kernel):
    # every compare, in doubles, with taps moved in to the map's own rim
    scene = small_scenes.soup()
    settings = csm.ShadowSettings(
        map_size=(64, 96, 48, 128), select="frustum", filter="pcf", filter_size=kernel
    )
    over = 0
    for number in range(2):
        frame = renderer.render(
            scene, small_scenes.camera(number), csm.Sun((0.4, 1.0, 0.3)), settings, outputs=OUTPUTS
        )
        assert_mask_matches(frame, evidence)
        index = frame.cascade_index[frame.valid]
        points = small_scenes.positions_of(frame)[frame.valid]
        for i in range(frame.cascades.count):
            texels = small_scenes.texels_of(frame.cascades, i, points[index == i])[:, :2]
            size = frame.cascades.map_size[i]
            over += np.count_nonzero(np.minimum(texels, size - texels).min(axis=1) < kernel // 2)
    assert over > 50


@pytest.mark.parametrize("ulps", [-1, 0, 1])
def test_c2_the_end_of_the_range_and_an_ulp_beside_it(figure, renderer, ulps):
    # A wall at view depth 8 exactly; the shadows end there, or one float32 step before or after.
    end = np.float32(8.0)
    for _ in range(abs(ulps)):
        end = np.nextafter(end, np.float32(np.inf * ulps))
    wall = [[-30, -30, -8], [30, -30, -8], [30, 30, -8], [-30, 30, -8]]
    scene = csm.Scene.from_arrays(wall, [[0, 1, 2], [0, 2, 3]])
    camera = csm.Camera.look_at((0, 0, 0), (0, 0, -1), near=0.5, far=40, size=(32, 16))
    settings = BASE.replace(map_size=256, view_range="camera", max_distance=float(end))
    for frame in frames_of(renderer, scene, camera, csm.Sun((0.1, 0.2, 1.0)), settings):
        assert (frame.view_depth == 8.0).all()
        # a step beyond counts as the end itself: depths of float32 meet splits of doubles there
        lost = np.count_nonzero(frame.cascade_index > 3)
        figure("C2", "index at the end of the range and one ulp beside", lost, 0, "pixels")
        assert (frame.mask == 1.0).all()
    beyond = settings.replace(max_distance=7.99)
    for frame in frames_of(renderer, scene, camera, csm.Sun((0.1, 0.2, 1.0)), beyond):
        assert (frame.cascade_index == 255).all()
        assert (frame.mask == 1.0).all()


def test_without_a_kernel_frustum_is_map():
    assert csm.ShadowSettings(select="frustum").canonical().select == "map"
    assert BASE.replace(select="frustum").canonical().select == "frustum"
