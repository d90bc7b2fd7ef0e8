"""Cascades of different map sizes: layers of one array, each map in a corner of its layer."""

import numpy as np
import pytest
import small_scenes
from test_shadow_map import assert_maps_match
from test_shadow_mask import FILTERS, SIZE, assert_mask_matches

import csm
from csm.pictures import CASCADE_COLOURS, maps_picture

SIZES = (160, 96, 61, 33)
SUN = csm.Sun(small_scenes.SUNS["high"])
OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal", "shadow_maps")


def draw(renderer, scene, settings, *, number=0, outputs=OUTPUTS, **more):
    camera = small_scenes.camera(number, size=SIZE)
    return renderer.render(scene, camera, SUN, settings, outputs=outputs, **more)


def fill_layers(renderer, *, with_casters):
    """Every texel of every layer: under a lid close to the sun, or of nothing."""
    half = 1e4 if with_casters else 1e-3
    corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]]) * half + (0, 400, 0)
    lid = csm.Scene.from_arrays(corners, [[0, 1, 2], [0, 2, 3]])
    settings = csm.ShadowSettings(map_size=max(SIZES), cull="none")
    camera = small_scenes.camera(0, size=SIZE)
    frame = renderer.render(lid, camera, csm.Sun((0, 1, 0)), settings, outputs=OUTPUTS)
    assert ((frame.shadow_maps < 1.0) == with_casters).all()


@pytest.mark.parametrize("order", [SIZES, SIZES[::-1], (33, 160, 61, 96)], ids=str)
@pytest.mark.parametrize("scene", ["soup", "copies"])
def test_every_map_holds_what_it_must(renderer, scene, order):
    scene = small_scenes.SCENES[scene]()
    settings = csm.ShadowSettings(map_size=order, cull="none")
    frame = draw(renderer, scene, settings, outputs=("shadow_maps",))
    assert isinstance(frame.shadow_maps, tuple)
    assert [depth.shape for depth in frame.shadow_maps] == [(size, size) for size in order]
    assert frame.info["map_size"] == list(order) == frame.cascades.map_size.tolist()
    assert_maps_match(frame, scene)


@pytest.mark.parametrize("depth_format", ["d32f", "d24", "d16"])
def test_a_map_is_the_same_whatever_the_others_sizes(renderer, depth_format):
    # sphere fits and practical splits do not look at other maps' sizes: so nothing may change
    scene = small_scenes.soup()
    settings = csm.ShadowSettings(map_size=SIZES, depth_format=depth_format)
    frame = draw(renderer, scene, settings, outputs=("shadow_maps",))
    for i, size in enumerate(SIZES):
        alone = draw(renderer, scene, settings.replace(map_size=size), outputs=("shadow_maps",))
        assert np.array_equal(frame.shadow_maps[i], alone.shadow_maps[i])


def test_equal_sizes_one_by_one_are_one_number(renderer):
    scene, settings = small_scenes.soup(), csm.ShadowSettings(map_size=96, filter="pcf")
    one = draw(renderer, scene, settings)
    four = draw(renderer, scene, settings.replace(map_size=(96,) * 4))
    assert four.shadow_maps.shape == (4, 96, 96)
    for name in OUTPUTS:
        assert np.array_equal(getattr(one, name), getattr(four, name))


@pytest.mark.parametrize("select", ["map", "interval", "frustum"])
@pytest.mark.parametrize("filter_name", ["hard", "pcf 2x2", "pcf 5x5"])
def test_c2_every_compare(renderer, evidence, filter_name, select):
    settings = csm.ShadowSettings(
        map_size=(96, 128, 64, 160), select=select, **FILTERS[filter_name]
    )
    used = set()
    for number, scene in enumerate(("soup", "copies")):
        frame = draw(renderer, small_scenes.SCENES[scene](), settings, number=number)
        assert_mask_matches(frame, evidence)
        used |= set(np.unique(frame.cascade_index[frame.valid]))
    assert len(used - {255}) > 1


@pytest.mark.parametrize("select", ["map", "interval", "frustum"])
@pytest.mark.parametrize(
    "kernel", [{"filter": "hard"}, *({"filter": "pcf", "filter_size": k} for k in (2, 3, 15))],
    ids=["hard", "2x2", "3x3", "15x15"],
)  # fmt: skip
def test_r1_nothing_leaks_from_the_rest_of_a_layer(figure, renderer, kernel, select):
    """Layers that were full of casters before, and layers that were empty: no lookup may tell, also
    at the rim, also for points outside every window."""
    scene = small_scenes.soup()
    settings = csm.ShadowSettings(map_size=SIZES, select=select, cull="none", **kernel)
    rng = np.random.default_rng(3)
    points = np.concatenate(
        [
            rng.uniform((-8, 0, -8), (8, 3, 8), (2000, 3)),
            rng.uniform((-40, 0, -40), (40, 5, 40), (2000, 3)),
        ]
    )
    frames = []
    for with_casters in (False, True):
        fill_layers(renderer, with_casters=with_casters)
        frames.append(draw(renderer, scene, settings, points=points))
    clean, dirty = frames
    differing = np.count_nonzero(clean.mask != dirty.mask)
    differing += np.count_nonzero(clean.point_visibility != dirty.point_visibility)
    assert 0.05 < clean.point_visibility.mean() < 0.99
    figure("R1", "leaks from beyond a map in its layer", differing, 0, "pixels and points")


def test_the_plan_and_the_frame_tell_the_bytes_of_the_whole_array(renderer):
    settings = csm.ShadowSettings(map_size=SIZES)
    outputs = ("mask", "shadow_maps")
    maps = {texture.name: texture for texture in csm.plan(settings).textures}["shadow_maps"]
    assert (maps.width, maps.height, maps.layers) == (160, 160, 4)
    assert maps.bytes == 160 * 160 * 4 * 4
    frame = draw(renderer, small_scenes.soup(), settings, outputs=outputs)
    assert frame.info["bytes"] == csm.plan(settings, size=SIZE, outputs=outputs).bytes


def test_out_is_written_again_and_must_have_the_same_sizes(renderer):
    scene, settings = small_scenes.soup(), csm.ShadowSettings(map_size=SIZES)
    first = draw(renderer, scene, settings)
    expected = [depth.copy() for depth in first.shadow_maps]
    for depth in first.shadow_maps:
        depth[...] = -1.0
    again = draw(renderer, scene, settings, out=first)
    for i, depth in enumerate(again.shadow_maps):
        assert depth is first.shadow_maps[i]
        assert np.array_equal(depth, expected[i])
    equal = draw(renderer, scene, settings.replace(map_size=96))
    with pytest.raises(ValueError, match=r"out: shadow_maps must be a tuple of 4 arrays"):
        draw(renderer, scene, settings, out=equal)
    with pytest.raises(ValueError, match=r"out: shadow_maps must have shape .*got 4 arrays"):
        draw(renderer, scene, settings.replace(map_size=96), out=first)
    with pytest.raises(ValueError, match=r"out: shadow_maps\[1\] must have shape \(97, 97\)"):
        draw(renderer, scene, settings.replace(map_size=(160, 97, 61, 33)), out=first)


def test_the_picture_of_the_maps_has_a_tile_for_each(renderer):
    frame = draw(renderer, small_scenes.soup(), csm.ShadowSettings(map_size=SIZES))
    sheet = maps_picture(frame)
    side = 160 + 2
    assert sheet.shape == (2 * side, 2 * side, 3)
    for i, size in enumerate(SIZES):
        corner = sheet[i // 2 * side, i % 2 * side]
        assert np.abs(corner / 255.0 - CASCADE_COLOURS[i]).max() < 0.01
        inner = sheet[i // 2 * side :, i % 2 * side :][1 : size + 1, 1 : size + 1]
        assert len(np.unique(inner)) > 10  # casters at many depths
