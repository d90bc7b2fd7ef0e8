"""A renderer as a function of its arguments: the same call gives the same bits, whatever came
before, at every picture size, for every choice of outputs."""

import itertools
import pickle
import re

import mask_oracle
import numpy as np
import pytest
import small_scenes

import csm

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal", "shadow_maps")
SUN = csm.Sun((0.4, 1.0, 0.3))
BASE = csm.ShadowSettings(map_size=128)


@pytest.fixture(scope="module")
def scene():
    return small_scenes.copies()


def draw(renderer, scene, camera, settings=BASE, outputs=OUTPUTS, **more):
    return renderer.render(scene, camera, SUN, settings, outputs=outputs, **more)


def assert_same_bits(one, two, names=OUTPUTS):
    for name in names:
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes(), name


# -- a function of its arguments -------------------------------------------------------------------


def test_a_frame_does_not_depend_on_what_was_rendered_before(fresh_renderer, scene):
    # Sizes of picture and maps, formats, filters, outputs and points in a random order, against
    # each alone in a renderer of its own. The range has a memory along a walk: "camera" has none.
    cases = [
        (
            small_scenes.camera(number % 4, size),
            csm.ShadowSettings(
                view_range="camera", split="logarithmic", cascade_count=count, map_size=map_size,
                depth_format=depth_format, filter=filter_name, filter_size=filter_size,
            ),
        )
        for number, (size, count, map_size, depth_format, filter_name, filter_size) in enumerate(
            [
                ((64, 36), 4, 128, "d32f", "hard", 3),
                ((200, 10), 1, 300, "d16", "pcf", 5),
                ((7, 90), 2, 64, "d24", "pcf", 2),
                ((64, 36), 4, 128, "d16", "none", 3),
                ((130, 70), 3, 99, "d32f", "pcf", 3),
            ]
        )
    ]  # fmt: skip
    outputs = OUTPUTS[:-1]
    alone = [draw(fresh_renderer(), scene, *case, outputs) for case in cases]
    renderer = fresh_renderer()
    order = np.random.default_rng(8).integers(len(cases), size=40)
    for step, number in enumerate(order):
        points = np.zeros((step % 3, 3)) if step % 4 == 0 else None
        frame = draw(renderer, scene, *cases[number], outputs, points=points)
        assert_same_bits(frame, alone[number], outputs)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_every_choice_of_outputs_gives_the_same_arrays(renderer, scene, count):
    # Alone, in pairs, and all but one: a choice is a program of its own.
    camera = small_scenes.camera(0, (96, 54))
    whole = draw(renderer, scene, camera)
    for number, names in enumerate(itertools.combinations(OUTPUTS, count)):
        if count == 2 and number % 3:
            continue
        frame = draw(renderer, scene, camera, outputs=names)
        assert_same_bits(frame, whole, names)
        for missing in set(OUTPUTS) - set(names):
            with pytest.raises(AttributeError, match=missing):
                getattr(frame, missing)


def test_the_order_and_repetition_of_outputs_do_not_matter(renderer, scene):
    camera = small_scenes.camera(0, (96, 54))
    whole = draw(renderer, scene, camera)
    assert_same_bits(draw(renderer, scene, camera, outputs=OUTPUTS[::-1]), whole)
    assert_same_bits(draw(renderer, scene, camera, outputs=(*OUTPUTS, *OUTPUTS)), whole)


def test_reload_changes_no_bit(fresh_renderer, scene):
    renderer = fresh_renderer()
    before = draw(renderer, scene, small_scenes.camera(1))
    renderer.reload()
    after = draw(renderer, scene, small_scenes.camera(1))
    assert_same_bits(before, after)
    assert after.info["programs_compiled"] == before.info["programs_compiled"] > 0
    assert draw(renderer, scene, small_scenes.camera(1)).info["programs_compiled"] == 0


def test_without_debug_the_bits_are_the_same(fresh_renderer, scene):
    plain = draw(fresh_renderer(debug=False), scene, small_scenes.camera(2))
    assert_same_bits(draw(fresh_renderer(), scene, small_scenes.camera(2)), plain)


# -- sizes of pictures -----------------------------------------------------------------------------

SIZES = [(1, 1), (1, 40), (40, 1), (7, 5), (8, 8), (31, 9), (33, 17), (257, 3), (130, 66)]


@pytest.mark.parametrize("size", SIZES, ids="{0[0]}x{0[1]}".format)
@pytest.mark.parametrize("scene_name", ["plane and box", "copies"])
def test_every_size_is_filled_to_its_last_pixel(renderer, evidence, scene_name, size):
    # Threads answer for several pixels and groups for tiles of them: no pixel may be left out.
    scene = small_scenes.SCENES[scene_name]()
    camera = small_scenes.camera(2, size, near=0.5)
    for outputs in (OUTPUTS, ("valid",), ("view_depth",), ("normal",), ("cascade_index",)):
        frame = draw(renderer, scene, camera, outputs=outputs)
        if outputs == OUTPUTS:
            whole = frame
        assert_same_bits(frame, whole, outputs)
    evidence(rendered=whole.view_depth, reference=whole.mask, settings=whole.settings)
    truth = csm.truth(scene, camera, SUN)
    few = max(1, round(0.02 * size[0] * size[1]))
    assert np.count_nonzero(whole.valid != truth.valid) <= few
    both = whole.valid & truth.valid
    depth = -(truth.position - camera.eye) @ camera.backward
    assert np.count_nonzero(~np.isclose(whole.view_depth, depth, rtol=1e-3)[both]) <= few
    oracle = mask_oracle.evaluate(whole)
    mask, index = whole.mask[whole.valid], whole.cascade_index[whole.valid]
    assert (index == oracle.index)[oracle.index_sure].all()
    assert ((mask >= oracle.lowest) & (mask <= oracle.highest))[index == oracle.index].all()


def test_a_kernel_that_takes_several_bands(renderer):
    # 33 x 33 compares for 640 x 360 pixels are more than one batch of work; some hundred pixels
    # of every row of bands are looked up once more.
    scene = csm.scenes.plane_and_box()
    camera = small_scenes.camera(0, (640, 360))
    settings = csm.ShadowSettings(map_size=512, filter="pcf", filter_size=33)
    frame = draw(renderer, scene, camera, settings)
    row, column = np.nonzero(frame.valid & (frame.cascade_index < 4))
    chosen = np.random.default_rng(9).permutation(len(row))[:400]
    row, column = row[chosen], column[chosen]
    positions = small_scenes.positions_of(frame)[row, column]
    normals = frame.normal[row, column].astype(np.float64)
    index, mask = frame.cascade_index[row, column], frame.mask[row, column]
    facing = normals @ SUN.to_light > 1e-4
    for i in range(4):
        own = (index == i) & facing
        lowest, highest = mask_oracle.visibility(frame, i, positions[own], normals[own], 80.0)
        assert (mask[own] >= lowest - 1e-5).all()
        assert (mask[own] <= highest + 1e-5).all()
    assert np.ptp(row) > 200, "three bands of 96 rows"


@pytest.mark.parametrize("orthographic", [False, True])
def test_near_and_far_cut_what_is_seen(renderer, orthographic):
    scene = csm.scenes.plane_and_box()
    if orthographic:
        camera = csm.Camera.orthographic((7, 5, 9), (-0.5, 0.6, 0), height=9, size=(160, 90))
    else:
        camera = small_scenes.camera()
    everything = draw(renderer, scene, camera.replace(near=0.1, far=200.0))
    depth = everything.view_depth
    near, far = np.quantile(depth[everything.valid], [0.3, 0.7])
    cut = draw(renderer, scene, camera.replace(near=near, far=far))
    seen = everything.valid & (depth <= far)
    # Where near cuts the surface away, what lies behind it comes out: the box is closed.
    margin = np.abs(depth - far) > 1e-4 * far
    kept = seen & (depth > near * (1 + 1e-4)) & margin
    np.testing.assert_allclose(cut.view_depth[kept], depth[kept], rtol=1e-6)
    assert not (cut.valid & everything.valid & ~seen & margin).any()
    assert (cut.view_depth[cut.valid] >= near * (1 - 1e-6)).all()
    assert (cut.view_depth[cut.valid] <= far * (1 + 1e-6)).all()


@pytest.mark.parametrize("place", [8191.0003, 8190.99912345])
def test_the_eye_keeps_its_place_below_a_step_of_float32(renderer, place):
    # A wall at x = 8192 seen from a metre before it: float32 steps by 0.0005 m there.
    wall = [[8192, -9000, -9000], [8192, 9000, -9000], [8192, 9000, 9000], [8192, -9000, 9000]]
    wall = np.array(wall, float)
    scene = csm.Scene.from_arrays(
        np.concatenate([wall, wall * [-1, 1, 1]]), [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    )
    assert np.array_equal(scene.origin, np.zeros(3))
    camera = csm.Camera.look_at((place, 0, 0), (8192, 0, 0), near=0.1, far=1e5, size=(32, 18))
    frame = draw(renderer, scene, camera, outputs=("view_depth",))
    np.testing.assert_allclose(frame.view_depth, 8192 - place, rtol=4 * 2.0**-24)


# -- what a frame says -----------------------------------------------------------------------------


def test_info_and_times(renderer, scene):
    camera = small_scenes.camera()
    frame = draw(renderer, scene, camera, points=np.zeros((5, 3)))
    passes = ["view", *(f"shadow_map_{i}" for i in range(4)), "shadow_mask", "shadow_points"]
    assert list(frame.timings_ms) == [*passes, "readback"]
    assert all(milliseconds >= 0.0 for milliseconds in frame.timings_ms.values())
    assert frame.info["clock"] in ("timer query", "wall clock around glFinish")
    assert frame.info["settings"] == BASE.canonical().to_dict()
    assert frame.info["chunks"] > 0
    for drawn, culled in zip(frame.info["chunks_drawn"], frame.info["chunks_culled"], strict=True):
        assert drawn + culled == frame.info["chunks"]
    assert frame.info["chunks_viewed"] <= frame.info["chunks"]
    assert max(frame.info["triangles_drawn"]) <= scene.triangle_count
    assert frame.camera is camera
    assert frame.sun is SUN
    assert frame.settings is BASE
    assert frame.cascades.count == 4


@pytest.mark.parametrize("filter_name", ["hard", "pcss", "evsm4"])
@pytest.mark.parametrize("split", ["practical", "sdsm"])
def test_a_frame_that_is_not_timed_is_the_same(renderer, scene, split, filter_name):
    camera, settings = small_scenes.camera(), BASE.replace(split=split, filter=filter_name)
    outputs = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps", "normal")
    timed = draw(renderer, scene, camera, settings, outputs=outputs)
    untimed = draw(renderer, scene, camera, settings, outputs=outputs, timed=False)
    assert list(untimed.timings_ms) == ["readback"]
    assert untimed.timings_ms["readback"] > 0.0
    assert untimed.info["clock"] == "none: passes were not timed"
    for name in outputs:
        assert np.array_equal(getattr(timed, name), getattr(untimed, name))
    again = draw(renderer, scene, camera, settings, outputs=outputs, timed=np.bool_(True))
    assert list(again.timings_ms) == list(timed.timings_ms)
    assert len(again.timings_ms) > 5


@pytest.mark.parametrize("timed", [0, None, "no", np.zeros(2)])
def test_timed_is_a_bool(renderer, scene, timed):
    with pytest.raises(TypeError, match="timed must be True or False"):
        draw(renderer, scene, small_scenes.camera(), timed=timed)


def test_what_is_not_asked_for_takes_no_pass(renderer, scene):
    camera = small_scenes.camera()
    maps = [f"shadow_map_{i}" for i in range(4)]
    for outputs, passes in (
        (("shadow_maps",), maps),
        (("valid",), ["view", "shadow_mask"]),
        (("view_depth", "normal"), ["view", "shadow_mask"]),
        (("mask",), ["view", *maps, "shadow_mask"]),
    ):
        timings = draw(renderer, scene, camera, outputs=outputs).timings_ms
        assert list(timings) == [*passes, "readback"]
    unfiltered = draw(renderer, scene, camera, BASE.replace(filter="none"), outputs=("mask",))
    assert list(unfiltered.timings_ms) == ["view", "shadow_mask", "readback"]


def test_frames_hold_what_the_contract_says(renderer, scene):
    frame = draw(renderer, scene, small_scenes.camera(), points=np.zeros((5, 3)))
    expected = {
        "mask": ((90, 160), np.float32),
        "valid": ((90, 160), np.bool_),
        "view_depth": ((90, 160), np.float32),
        "cascade_index": ((90, 160), np.uint8),
        "normal": ((90, 160, 3), np.float32),
        "shadow_maps": ((4, 128, 128), np.float32),
        "point_visibility": ((5,), np.float32),
        "point_cascade": ((5,), np.uint8),
    }
    for name, (shape, dtype) in expected.items():
        array = getattr(frame, name)
        assert (array.shape, array.dtype) == (shape, dtype)
        assert array.flags.c_contiguous
        assert name in dir(frame)
    cascades = frame.cascades
    for name in ("light_from_world", "clip_from_light", "clip_from_world", "uvz_from_world"):
        assert getattr(cascades, name).shape == (4, 4, 4)
        assert getattr(cascades, name).dtype == np.float64
    assert cascades.splits.shape == (5,)
    assert cascades.texel_size.shape == cascades.depth_range.shape == (4, 2)
    assert (cascades.lattice.shape, cascades.lattice.dtype) == ((4, 2), np.int64)


def test_the_default_outputs(renderer, scene):
    frame = renderer.render(scene, small_scenes.camera(), SUN)
    for name in ("mask", "valid", "view_depth", "cascade_index", "shadow_maps"):
        assert getattr(frame, name).size
    with pytest.raises(AttributeError, match="normal"):
        frame.normal  # noqa: B018
    assert frame.settings == csm.ShadowSettings()


def test_cascades_are_those_of_fit_cascades(renderer, scene):
    for number in range(4):
        camera = small_scenes.camera(number)
        frame = draw(renderer, scene, camera, outputs=("shadow_maps",))
        alone = csm.fit_cascades(camera, SUN, BASE, scene=scene)
        assert frame.cascades.range_step == alone.range_step
        for name in ("splits", "uvz_from_world", "texel_size", "lattice", "depth_range"):
            assert np.array_equal(getattr(frame.cascades, name), getattr(alone, name))


def test_the_info_of_a_frame_is_of_its_own_render(fresh_renderer, scene):
    """However late it is first read, and one dict from then on, which `Director` writes into."""
    one, other = fresh_renderer(), fresh_renderer()
    camera = small_scenes.camera()
    early = draw(one, scene, camera, reuse="same").info
    late, reused = (draw(other, scene, camera, reuse="same") for _ in range(2))
    other.render(scene, small_scenes.camera(1), SUN, BASE.replace(cascade_count=2, filter="pcf"))
    other.close()
    assert late.info == early
    for frame, action in ((late, "draw"), (reused, "keep")):
        assert {one["action"] for one in frame.info["reuse"]} == {action}
    late.info["more"] = 1
    assert late.info["more"] == 1
    assert pickle.loads(pickle.dumps(late)).info == late.info


def test_frames_pickle(renderer, scene):
    frame = draw(renderer, scene, small_scenes.camera(), points=np.zeros((5, 3)))
    copy = pickle.loads(pickle.dumps(frame))
    assert_same_bits(copy, frame, [*OUTPUTS, "point_visibility", "point_cascade"])
    assert copy.settings == frame.settings
    assert copy.camera == frame.camera
    assert copy.info == frame.info
    assert np.array_equal(copy.cascades.uvz_from_world, frame.cascades.uvz_from_world)
    assert np.array_equal(
        small_scenes.positions_of(copy), small_scenes.positions_of(frame), equal_nan=True
    )


def test_renderers_and_frames_print_what_they_are(fresh_renderer, scene):
    renderer = fresh_renderer()
    assert re.fullmatch(r"<csm.Renderer \w+ .+>", repr(renderer))
    frame = draw(renderer, scene, small_scenes.camera())
    assert repr(frame).startswith("Frame(160x90, mask, ")
    assert re.search(r"; \d+\.\d ms\)$", repr(frame))
    untimed = draw(renderer, scene, small_scenes.camera(), timed=False)
    assert repr(untimed).endswith("; no pass timed)")
    renderer.close()
    assert repr(renderer).endswith("closed>")


# -- points with normals, one cascade's mask, limits before work -----------------------------------


def test_points_with_normals_are_answered_as_pixels_are(renderer):
    # The centres of the pixels, from the truth: what differs is float32 rounding of the point.
    scene = csm.scenes.town(5_000)
    camera = scene.cameras["street"].replace(size=(160, 90))
    for sun in (*scene.suns.values(), csm.Sun((0.9, 0.05, 0.3))):
        truth = csm.truth(scene, camera, sun)
        points, normals = truth.position[truth.valid], truth.normal[truth.valid]
        frame = renderer.render(scene, camera, sun, points=points, point_normals=3.0 * normals)
        same = frame.valid[truth.valid]
        differs = frame.point_visibility != frame.mask[truth.valid]
        assert differs[same].mean() <= 2e-3
        assert (frame.point_visibility[~truth.facing[truth.valid]] == 0).all()


@pytest.mark.parametrize(
    ("normals", "words"),
    [
        (np.ones((2, 3)), "as many as points"),
        (np.zeros((3, 3)), "must not be zero"),
        (np.full((3, 3), np.nan), "point_normals must be finite"),
        (np.ones(3), "point_normals must be (m, 3)"),
    ],
    ids=["other length", "zero", "nan", "one row"],
)
def test_bad_point_normals_are_refused(renderer, normals, words):
    scene = csm.scenes.plane_and_box()
    camera, sun = scene.cameras["corner"].replace(size=(16, 9)), scene.suns["diagonal"]
    with pytest.raises(ValueError, match=re.escape(words)):
        renderer.render(scene, camera, sun, points=np.ones((3, 3)), point_normals=normals)


def test_mask_single_is_the_mask_while_nothing_blends(renderer):
    scene = csm.scenes.plane_and_box()
    camera, sun = scene.cameras["corner"].replace(size=(160, 90)), scene.suns["diagonal"]
    both = renderer.render(scene, camera, sun, outputs=("mask", "mask_single"))
    alone = renderer.render(scene, camera, sun, outputs=("mask_single",))
    assert np.array_equal(both.mask, both.mask_single)
    assert np.array_equal(both.mask, alone.mask_single)
    assert alone.outputs == ("mask_single",)
    assert 0.0 < both.mask.mean() < 1.0


def test_an_output_the_driver_cannot_hold_is_refused_before_any_work(renderer):
    scene = csm.scenes.plane_and_box()
    sun = scene.suns["diagonal"]
    side = 16384 if renderer.info["max_buffer_bytes"] < 16384**2 * 12 else None
    if side is None:
        pytest.skip("this driver holds the largest camera's normals")
    camera = scene.cameras["corner"].replace(size=(side, side))
    with pytest.raises(csm.LimitError, match="normal of 16384 x 16384 pixels"):
        renderer.render(scene, camera, sun, outputs=("normal",))


def test_no_shadows_is_a_baseline_that_can_be_judged(renderer):
    scene = csm.scenes.plane_and_box()
    camera, sun = scene.cameras["corner"].replace(size=(160, 90)), scene.suns["diagonal"]
    truth = csm.truth(scene, camera, sun)
    frame = renderer.render(scene, camera, sun, csm.ShadowSettings(filter="none"))
    report = csm.compare(frame, truth)
    shadowed = (truth.mask == 0) & truth.facing & frame.valid
    assert report.disagreement == pytest.approx(shadowed.sum() / report.judged_count)
    assert report.disagreement > 0.0
