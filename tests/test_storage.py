"""Where maps lie: tiles that never meet, one answer from every storage, every byte named."""

import itertools

import map_oracle
import mask_oracle
import numpy as np
import pytest
import small_scenes
from hypothesis import given
from hypothesis import strategies as st
from test_shadow_map import assert_maps_match
from test_shadow_mask import assert_mask_matches

import csm
from csm import _core

SIZE = (96, 54)
SUN = csm.Sun(small_scenes.SUNS["high"])
OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal", "shadow_maps")
FILTERS = {
    "hard": {"filter": "hard"},
    "2x2": {"filter": "pcf", "filter_size": 2},
    "5x5": {"filter": "pcf", "filter_size": 5},
    "vsm": {"filter": "vsm", "filter_size": 3},
}
STORAGES = {
    "array": {"storage": "array"},
    "atlas": {"storage": "atlas"},
    "copied atlas": {"storage": "atlas", "copied_tiles": True},
    "copied atlas with borders": {"storage": "atlas", "copied_tiles": True, "tile_border": 3},
    "separate": {"storage": "separate"},
    "cube": {"storage": "cube"},
}
UNEQUAL = (61, 96, 40)
BASE = csm.ShadowSettings(cascade_count=3, map_size=64)


def draw(renderer, settings, *, scene=None, number=0, outputs=OUTPUTS, **more):
    scene = small_scenes.soup() if scene is None else scene
    camera = small_scenes.camera(number, size=SIZE)
    return renderer.render(scene, camera, SUN, settings, outputs=outputs, **more)


@pytest.fixture(scope="module")
def renderer():
    """In fragments, whose masks compile in a third of the time; test_stages.py has both equal."""
    with csm.Renderer(debug=True, stage="fragment") as renderer:
        yield renderer
        left = renderer._core.messages()
        assert not [text for _, severity, text in left if severity in ("high", "medium")]


# -- packing ---------------------------------------------------------------------------------------


# A shelf as high as its first tile is full for two thirds at worst: four tiles of just over half
# the first one's side leave 1.5 times their area, the most that 60,000 random sets came to.
WORST_PACKING = 1.6


def packed(sizes, border):
    settings = csm.ShadowSettings(
        cascade_count=len(sizes), map_size=tuple(sizes), storage="atlas", tile_border=border
    )
    places, size = _core.storage_places(settings)
    return np.array(places), np.array(size)


def tiles_overlap(places, border):
    low, high = places[:, :2] - border, places[:, :2] + places[:, 2:3] + border
    count = len(places)
    return any(
        (np.minimum(high[i], high[j]) > np.maximum(low[i], low[j])).all()
        for i in range(count) for j in range(i)
    )  # fmt: skip


@given(
    st.lists(st.integers(1, 4096) | st.sampled_from([256, 257, 512, 1024]), min_size=1, max_size=8),
    st.integers(0, 64),
)
def test_tiles_with_their_borders_lie_apart_in_the_atlas(sizes, border):
    places, (width, height) = packed(sizes, border)
    assert places[:, 2].tolist() == sizes
    assert (places[:, :2] >= border).all()
    assert (places[:, 0] + places[:, 2] + border <= width).all()
    assert (places[:, 1] + places[:, 2] + border <= height).all()
    assert not tiles_overlap(places, border)
    tiles = sum((size + 2 * border) ** 2 for size in sizes)
    assert tiles <= width * height <= WORST_PACKING * tiles
    # no row or column of the atlas beyond its tiles
    assert (places[:, 0] + places[:, 2]).max() + border == width
    assert (places[:, 1] + places[:, 2]).max() + border == height


@pytest.mark.parametrize(
    ("sizes", "size"),
    [
        ((512,) * 4, (1024, 1024)),
        ((512,), (512, 512)),
        ((2048, 1024, 1024), (2048, 3072)),
        ((4096,) * 5, (8192, 12288)),  # a strip of 20480 is smaller, but not for every driver
        ((4096,) * 8, (8192, 16384)),
        ((2048,) * 5, (2048, 10240)),
    ],
    ids=str,
)
def test_an_atlas_is_as_small_as_every_driver_can_hold(sizes, size):
    assert sorted(packed(sizes, 0)[1]) == sorted(size)


def test_an_atlas_beyond_the_driver_is_refused_by_name(renderer):
    side = renderer.info["max_texture_size"] // 2 + 1
    settings = BASE.replace(storage="atlas", map_size=side, cascade_count=4)
    with pytest.raises(csm.LimitError, match=r"shadow_maps \d+ x \d+ x 1 exceeds GL_MAX_TEXTURE_S"):
        draw(renderer, settings, outputs=("mask",))
    with pytest.raises(csm.LimitError, match=r"shadow_maps_0 \d+ x \d+ x 1 exceeds GL_MAX_TEXTURE"):
        draw(renderer, settings.replace(storage="separate", map_size=4 * side), outputs=("mask",))


def test_other_limits_are_refused_by_name(renderer):
    info = dict(renderer.info)
    few = {"max_layers": 2, "max_samples": 1, "max_cube_size": 32}
    draw(renderer, BASE, outputs=("mask",))
    try:
        renderer._info = {**info, **few}
        for changes, text in (
            ({}, r"shadow_maps 64 x 64 x 3 exceeds GL_MAX_ARRAY_TEXTURE_LAYERS 2"),
            ({"storage": "cube"}, r"shadow_maps 64 x 64 x 6 exceeds GL_MAX_CUBE_MAP_TEXTURE_SIZE"),
            (
                {"filter": "vsm", "samples": 2, "cascade_count": 1},
                r"shadow_samples 64 x 64 x 1 of 2 samples exceeds GL_MAX_DEPTH_TEXTURE_SAMPLES 1",
            ),
        ):
            if "cube" in changes.values():
                renderer._info["max_layers"] = 6
            with pytest.raises(csm.LimitError, match=text):
                draw(renderer, BASE.replace(**changes), outputs=("mask",))
            renderer._info["max_layers"] = 2
    finally:
        renderer._info = info


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"cascade_count": 7}, "cascade_count must be 1 to 6 under storage cube"),
        ({"map_size": (64, 64, 32)}, "map_size must be the same for all cascades"),
    ],
)
def test_a_cube_has_six_faces_of_one_size(changes, text):
    with pytest.raises(ValueError, match=text):
        BASE.replace(storage="cube", **changes)


def sample(first, second):
    """A third of the pairs, in which every name occurs; the others belong to the sweep."""
    return [
        pytest.param(one, other, marks=[] if (i + j) % 3 == 0 else [pytest.mark.sweep])
        for i, one in enumerate(first) for j, other in enumerate(second)
    ]  # fmt: skip


# -- one answer ------------------------------------------------------------------------------------


OTHERS = {
    "": {},
    "unequal": {"map_size": UNEQUAL, "select": "interval"},
    "reversed d16": {"reversed_depth": True, "depth_format": "d16", "select": "frustum"},
    "d24 warped": {"depth_format": "d24", "warp": "lispsm", "snap": "none"},
    "turned blended": {"fit": "visible", "turned": True, "blend": "linear"},
    "exclusive pancaked": {"cull": "exclusive", "reversed_depth": True},
}


@pytest.mark.parametrize(("filter_name", "other"), sample(FILTERS, OTHERS))
def test_the_same_mask_from_the_same_depths_whatever_holds_them(renderer, filter_name, other):
    settings = BASE.replace(**FILTERS[filter_name], **OTHERS[other])
    expected = draw(renderer, settings)
    assert 0.02 < expected.mask[expected.valid].mean() < 0.98
    for name, storage in STORAGES.items():
        if name in ("array", "atlas") or (name == "cube" and isinstance(settings.map_size, tuple)):
            continue
        frame = draw(renderer, settings.replace(**storage))
        for own, others in zip(frame.shadow_maps, expected.shadow_maps, strict=True):
            assert np.array_equal(own, others), name
        for output in OUTPUTS[:-1]:
            assert np.array_equal(getattr(frame, output), getattr(expected, output)), (name, output)


@pytest.mark.parametrize("filter_name", FILTERS)
def test_a_tile_drawn_in_place_gives_the_same_mask_but_for_a_few_pixels(
    figure, renderer, filter_name
):
    """A rasteriser snaps corners to sub-texels of its target: depths of a tile differ in their last
    bits, and so does a compare that they decide."""
    settings = BASE.replace(map_size=(128, 96, 61), **FILTERS[filter_name])
    pixels = differing = 0
    for number in range(3):
        expected = draw(renderer, settings, number=number)
        frame = draw(renderer, settings.replace(storage="atlas", tile_border=1), number=number)
        assert_maps_match(frame, small_scenes.soup())
        assert np.array_equal(frame.cascade_index, expected.cascade_index)
        # moments are of all bits of the depths: beyond 8 bits a mask is no other picture
        away = np.abs(frame.mask - expected.mask) > (1 / 512 if filter_name == "vsm" else 0.0)
        differing += np.count_nonzero(away)
        pixels += away.size
    figure("R1", "masks that an atlas makes otherwise", differing / pixels, 1e-3, "of the pixels")


@pytest.mark.parametrize("storage", [name for name in STORAGES if "copied" not in name])
@pytest.mark.parametrize("select", ["map", "frustum"])
def test_every_compare_from_every_storage(renderer, evidence, storage, select):
    settings = BASE.replace(**STORAGES[storage], select=select, filter="pcf", filter_size=5)
    if storage != "cube":
        settings = settings.replace(map_size=UNEQUAL)
    for reversed_depth in (False, True):
        frame = draw(renderer, settings.replace(reversed_depth=reversed_depth), number=1)
        assert_mask_matches(frame, evidence)
        assert_maps_match(frame, small_scenes.soup())


@pytest.mark.parametrize(("filter_name", "size"), [("hard", 1), ("2x2", 3), ("5x5", 5)])
def test_the_smallest_maps_that_a_kernel_allows(renderer, filter_name, size):
    """Every lookup is at the rim."""
    settings = BASE.replace(
        map_size=size, select="interval", snap="none", fit="visible", **FILTERS[filter_name]
    )
    with pytest.raises(ValueError, match="map_size must be"):
        draw(renderer, settings.replace(map_size=size - 1))
    expected = draw(renderer, settings)
    assert_mask_matches(expected)
    for storage in ("copied atlas", "separate", "cube"):
        frame = draw(renderer, settings.replace(**STORAGES[storage]))
        assert np.array_equal(frame.mask, expected.mask), storage


# -- leaks -----------------------------------------------------------------------------------------


def plates(rectangles, height):
    """Horizontal rectangles (x0, z0, x1, z1) at a height."""
    positions, triangles = [], []
    for x0, z0, x1, z1 in rectangles:
        first = len(positions)
        positions += [(x0, height, z0), (x0, height, z1), (x1, height, z1), (x1, height, z0)]
        triangles += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return positions, triangles


def checker_scene(window, own_is_black):
    """Casters over a window and nothing beside it, or over all beside it and nothing in it."""
    x0, z0, x1, z1 = window
    far = 4000.0
    around = [(-far, -far, x0, far), (x1, -far, far, far), (x0, -far, x1, z0), (x0, z1, x1, far)]
    lid, triangles = plates([window] if own_is_black else around, 40.0)
    # of no area for the sun overhead, so that the scene's bounds are the same in both
    ends = [(-far, 0.0, 0.0), (-far, 50.0, 0.0), (far, 50.0, 0.0)]
    triangles.append((len(lid), len(lid) + 1, len(lid) + 2))
    return csm.Scene.from_arrays(np.array(lid + ends), triangles)


def window_of(cascades, i):
    """x0, z0, x1, z1 [m] of a window under a sun overhead."""
    world_from_uvz = np.linalg.inv(cascades.uvz_from_world[i])
    corners = csm.spaces.transform_points(world_from_uvz, [(0, 0, 0.5), (1, 1, 0.5)])
    return (*corners.min(axis=0)[[0, 2]], *corners.max(axis=0)[[0, 2]])


CHECKER_SIZES = (64, 33, 48, 64)
CHECKER_CAMERA = csm.Camera.look_at(
    (0, 10, 0), (0, 10, -100), near=1, far=200, fov_y_deg=40, size=(8, 8)
)


CHECKED = {"15x15": {"filter": "pcf", "filter_size": 15}, "hard": {"filter": "hard"}} | {
    f"{k}x{k}": {"filter": "pcf", "filter_size": k} for k in (2, 3)
}


@pytest.mark.parametrize(("kernel_name", "select"), sample(CHECKED, ["interval", "map", "frustum"]))
def test_r1_tiles_are_a_checker_of_black_and_white(figure, renderer, kernel_name, select):
    """One map is black, the others white where they do not lie in it, and the other way round:
    points at its rim see one colour alone, with a kernel of p = 7 and no border between tiles."""
    base = csm.ShadowSettings(
        map_size=CHECKER_SIZES, select=select, view_range="camera", split="uniform", cull="none",
        fit="diameter", **CHECKED[kernel_name],
    )  # fmt: skip
    rng = np.random.default_rng(11)
    points = rng.uniform((-180, 0, -260), (180, 0, 60), (6000, 3))
    normals = np.tile((0.0, 1.0, 0.0), (len(points), 1))
    sun, scene = csm.Sun((0, 1, 0)), checker_scene((-1, -1, 1, 1), own_is_black=True)
    placed = renderer.render(scene, CHECKER_CAMERA, sun, base, outputs=(), points=points).cascades
    leaks = checked = at_rim = 0
    for own, own_is_black in itertools.product(range(4), (False, True)):
        scene = checker_scene(window_of(placed, own), own_is_black)
        for storage in ("array", "atlas", "copied atlas with borders", "separate"):
            frame = renderer.render(
                scene, CHECKER_CAMERA, sun, base.replace(**STORAGES[storage]), outputs=(),
                points=points, point_normals=normals,
            )  # fmt: skip
            assert np.array_equal(frame.cascades.uvz_from_world, placed.uvz_from_world)
            texels = small_scenes.texels_of(placed, own, points)[:, :2]
            rim = np.minimum(texels, CHECKER_SIZES[own] - texels).min(axis=1)
            here = (frame.point_cascade == own) & (rim > 0.0)  # by interval they may lie outside
            answers = frame.point_visibility[here]
            leaks += np.count_nonzero(answers != (0.0 if own_is_black else 1.0))
            checked += len(answers)
            at_rim += np.count_nonzero(rim[here] < 7.5)
    assert checked > 2000
    assert at_rim > 100
    figure("R1", "leaks from tile to tile", leaks, 0, "points")


# -- formats ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("storage", ["array", "atlas", "separate", "cube"])
@pytest.mark.parametrize("depth_format", ["d32f", "d24", "d16"])
def test_reversed_maps_come_back_the_same_within_the_quantum(renderer, depth_format, storage):
    settings = BASE.replace(depth_format=depth_format, storage=storage)
    plain = draw(renderer, settings, outputs=("shadow_maps",)).shadow_maps
    frame = draw(renderer, settings.replace(reversed_depth=True), outputs=("shadow_maps",))
    assert_maps_match(frame, small_scenes.soup())
    # both are rounded to their format and, on the way there, as floats
    tolerance = mask_oracle.QUANTUM[depth_format] + 2.0 * map_oracle.RANGE_ROUNDING
    assert np.abs(plain.astype(np.float64) - frame.shadow_maps).max() <= tolerance
    assert np.array_equal(plain == 1.0, frame.shadow_maps == 1.0)
    assert 0.05 < (plain < 1.0).mean() < 1.0


# -- bytes -----------------------------------------------------------------------------------------


def textures_of(settings, outputs=("mask",)):
    return {texture.name: texture for texture in csm.plan(settings, outputs=outputs).textures}


def test_unequal_maps_take_only_their_bytes_apart():
    settings = BASE.replace(map_size=UNEQUAL)
    apart = textures_of(settings.replace(storage="separate"))
    for i, size in enumerate(UNEQUAL):
        assert apart[f"shadow_maps_{i}"].bytes == 4 * size * size
    assert "shadow_maps" not in apart
    assert textures_of(settings)["shadow_maps"].bytes == 4 * 3 * max(UNEQUAL) ** 2
    atlas = textures_of(settings.replace(storage="atlas", tile_border=2))["shadow_maps"]
    assert (atlas.width, atlas.height) == tuple(packed(UNEQUAL, 2)[1])
    assert atlas.bytes == 4 * atlas.width * atlas.height < 4 * 3 * max(UNEQUAL) ** 2


@pytest.mark.parametrize("depth_format", ["d32f", "d16"])
def test_a_copied_tile_costs_the_map_it_is_drawn_in(depth_format):
    settings = BASE.replace(map_size=UNEQUAL, storage="atlas", depth_format=depth_format)
    plain, copied = textures_of(settings), textures_of(settings.replace(copied_tiles=True))
    assert copied.keys() - plain.keys() == {"shadow_tile"}
    assert copied["shadow_tile"].bytes == {"d32f": 4, "d16": 2}[depth_format] * max(UNEQUAL) ** 2


def test_a_cube_has_all_its_faces():
    cube = textures_of(BASE.replace(storage="cube"))["shadow_maps"]
    assert (cube.layers, cube.bytes) == (6, 4 * 6 * 64 * 64)


def test_textures_come_and_go_with_the_storage(fresh_renderer):
    """As many objects as the plan has textures, whatever was there before."""
    renderer = fresh_renderer(stage="fragment")
    scene, outputs = small_scenes.soup(), ("shadow_maps", "moments")

    def objects_beyond_textures(settings):
        draw(renderer, settings, scene=scene, outputs=outputs)
        info = renderer.info
        return (
            info["live_objects"] - info["programs_compiled"] - len(textures_of(settings, outputs))
        )

    first = objects_beyond_textures(BASE)
    for name in (*STORAGES, *reversed(STORAGES)):
        assert objects_beyond_textures(BASE.replace(**STORAGES[name])) == first, name
    moments = BASE.replace(**FILTERS["vsm"], samples=2)
    for changes in (moments, moments.replace(storage="separate", samples=1), BASE):
        assert objects_beyond_textures(changes) == first


def test_samples_leave_no_storage_to_choose():
    plain = BASE.replace(**FILTERS["vsm"], samples=2)
    for storage in STORAGES.values():
        assert plain.replace(**storage).canonical() == plain.canonical()
