"""Prefiltered maps (docs/numerics.md 27): what is stored equals the moments of the frame's depths
under a kernel applied by brute force, what a pixel is told the paper's formula on them."""

import moment_oracle
import numpy as np
import pytest
import small_scenes

import csm

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal", "shadow_maps", "moments")
SIZE = (96, 54)
SIZES = (97, 64)  # odd, and of two sizes in one array
BIAS = {"bias": "manual", "slope_bias": 0.25, "constant_bias_texels": 0.1, "receiver_plane": True}
BASE = csm.ShadowSettings(map_size=SIZES, cascade_count=2, filter_size=5, **BIAS)
U = 2.0**-24

FILTERS = {
    "vsm": {"filter": "vsm"},
    "lvsm": {"filter": "lvsm"},
    "lvsm of 2": {"filter": "lvsm", "layer_count": 2},
    "evsm2": {"filter": "evsm2"},
    "evsm4": {"filter": "evsm4"},
    "evsm4 of two exponents": {"filter": "evsm4", "exponent": 5.0, "negative_exponent": 3.0},
    "esm": {"filter": "esm"},
    "esm log": {"filter": "esm", "log_filter": True, "exponent": 60.0},
}
KERNELS = [(1, "box"), (3, "box"), (5, "gaussian"), (9, "tent"), (7, "bilinear"), (33, "box")]
UNITS = ("vsm", "lvsm", "esm log")  # what fits unorm16


@pytest.fixture(scope="module")
def view():
    sun = csm.Sun(small_scenes.SUNS["high"])
    return small_scenes.soup(), small_scenes.camera(size=SIZE), sun


def cases():
    """Every kernel for one filter of each kind, every format with one kernel."""
    every = []
    for name in FILTERS:
        formats = ["float32", "float16", *(["unorm16"] if name in UNITS else [])]
        for moment_format in formats:
            full = moment_format == "float32" and name in ("vsm", "evsm4", "esm log")
            every += [
                pytest.param(name, moment_format, size, kind,
                             id=f"{name}, {moment_format}, {kind} {size}")
                for size, kind in (KERNELS if full else KERNELS[2:3])
            ]  # fmt: skip
    return every


def settings_of(name, moment_format="float32", filter_size=5, kind="box", **more):
    """Small maps; a kernel of 33 needs larger ones."""
    sizes = (131, 128) if filter_size > 9 else SIZES
    changes = {"moment_format": moment_format, "filter_size": filter_size, "filter_weights": kind}
    return BASE.replace(**{"map_size": sizes, **FILTERS[name], **changes, **more})


def moment_tolerance(settings, exact):
    """What arithmetic and storage may leave of blurred moments, element by element."""
    stored = moment_oracle.rounding(settings) * moment_oracle.roundings(settings)
    n = settings.filter_size
    if settings.filter in moment_oracle.EXPONENTIAL and not settings.log_filter:
        # exp() of an argument c d that is rounded three times, and squared. A mean of texels in
        # differences to one of them, n times what the mean is, summed in n steps, along two axes.
        share = 6 * max(moment_oracle.exponents(settings)) + 8 + 2 * n * n
        return (stored + share * U) * np.abs(exact)
    # n sums of differences of at most 1, along two axes; log_filter: log and exp of size 1 / c
    return stored + (4 + 2 * n) * U


@pytest.mark.parametrize(("name", "moment_format", "filter_size", "kind"), cases())
def test_moments_are_those_of_the_depths_and_pixels_are_told_the_bound(
    renderer, view, evidence, name, moment_format, filter_size, kind
):
    settings = settings_of(name, moment_format, filter_size, kind)
    frame = renderer.render(*view, settings, outputs=OUTPUTS)
    assert len(np.unique(frame.cascade_index[frame.valid])) >= 2
    for i in range(2):
        exact = moment_oracle.blurred_moments(frame, i)
        assert frame.moments[i].shape == exact.shape
        assert np.isfinite(frame.moments[i]).all()
        error = np.abs(frame.moments[i] - exact)
        assert (error <= moment_tolerance(settings, exact)).all()
    lowest, highest = moment_oracle.mask_interval(frame)
    mask = frame.mask[frame.valid]
    evidence(rendered=frame.mask, settings=settings)
    # a handful of roundings of a number up to 1
    assert np.maximum(lowest - mask, mask - highest).max() <= 16 * U
    assert (highest - lowest).mean() < 1e-3, "the intervals say nothing"
    if filter_size <= 9:  # wider than what stands there, only the farthest counts for exponents
        assert ((mask > 0.01) & (mask < 0.99)).sum() > 100, "no penumbra"


@pytest.mark.parametrize("name", ["vsm", "esm log"])
def test_a_lookup_over_the_rim_takes_the_texels_at_it(renderer, view, name):
    # Under select frustum kernels reach over the rim; the second map's layer holds more than it.
    settings = settings_of(name, select="frustum", filter_size=9)
    scene, camera, sun = view
    frame = renderer.render(scene, camera.replace(size=(320, 180)), sun, settings, outputs=OUTPUTS)
    lowest, highest = moment_oracle.mask_interval(frame)
    mask = frame.mask[frame.valid]
    assert np.maximum(lowest - mask, mask - highest).max() <= 16 * U
    positions = small_scenes.positions_of(frame)
    at_rim = 0
    for i, size in enumerate(SIZES):
        own = frame.valid & (frame.cascade_index == i)
        texels = small_scenes.texels_of(frame.cascades, i, positions[own])[:, :2]
        at_rim += (np.minimum(texels, size - texels).min(axis=1) < 0.5).sum()
    assert at_rim > 20


def test_kernels_of_one_width_in_metres(renderer, view):
    settings = settings_of("vsm", filter_size=33, kernel="world")
    frame = renderer.render(*view, settings, outputs=OUTPUTS)
    halves = np.array([moment_oracle.half_widths(frame, i) for i in range(2)])
    metres = halves * frame.cascades.texel_size
    assert (halves[1] < 0.8 * halves[0]).all()
    assert halves[0].max() == 16.5
    assert metres == pytest.approx(metres[0, 0])
    for kind in ("box", "bilinear", "tent", "gaussian"):
        settings = settings.replace(filter_weights=kind)
        frame = renderer.render(*view, settings, outputs=OUTPUTS)
        for i in range(2):
            exact = moment_oracle.blurred_moments(frame, i)
            assert np.abs(frame.moments[i] - exact).max() <= (
                moment_tolerance(settings, exact) + 4 * U * halves[i].max()  # the width in float32
            )


@pytest.mark.parametrize("moment_format", ["float32", "float16", "unorm16"])
def test_compute_and_fragment_give_the_same_bits(fresh_renderer, view, moment_format):
    renderers = [fresh_renderer(stage=stage) for stage in ("compute", "fragment")]
    for name in UNITS if moment_format == "unorm16" else FILTERS:
        settings = settings_of(name, moment_format, kind="gaussian")
        frames = [each.render(*view, settings, outputs=OUTPUTS) for each in renderers]
        np.testing.assert_array_equal(frames[0].mask, frames[1].mask)
        for a, b in zip(frames[0].moments, frames[1].moments, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["vsm", "evsm4", "lvsm", "esm"])
def test_culling_changes_no_bit(renderer, name):
    # Means are of what lies behind receivers too, even 20 m below all that is seen: a tray,
    # half of it in the shadow of a roof, above the ground and a pit.
    def level(y, x, z):
        return [[x[0], y, z[0]], [x[1], y, z[0]], [x[1], y, z[1]], [x[0], y, z[1]]]

    quads = [
        level(0, (-0.05, 0.05), (-0.05, 0.05)), level(40, (-9, 0), (-9, 9)),
        level(-20, (-9, 9), (-9, 9)), level(-60, (20, 21), (-9, 9)),
    ]  # fmt: skip
    scene = csm.Scene([csm.Mesh(quad, [[0, 2, 1], [0, 3, 2]]) for quad in quads])
    camera = csm.Camera.orthographic(
        (0, 0.5, 0), (0, 0, 0), up=(0, 0, -1), height=0.2, near=0.4, far=0.6, size=(64, 64)
    )
    settings = csm.ShadowSettings(
        map_size=256, cascade_count=1, filter_size=9, filter=name, exponent=4.0
    )
    frames = [
        renderer.render(scene, camera, csm.Sun((0, 1, 0)), settings.replace(cull=cull, fit="box"))
        for cull in ("none", "inclusive")
    ]
    assert frames[1].info["triangles_drawn"][0] < frames[0].info["triangles_drawn"][0]
    np.testing.assert_array_equal(frames[0].mask, frames[1].mask)
    assert ((frames[0].mask > 0.05) & (frames[0].mask < 0.95)).sum() > 50


def test_a_map_holds_the_same_whatever_shares_its_array(renderer, view):
    # A layer of 64 texels in an array of 97: what lies beyond the rim is never mixed in.
    fixed = {"split": "manual", "manual_splits": (9.0,), "fit": "diameter"}
    alone = settings_of("evsm4", map_size=(64, 64), **fixed)
    shared = settings_of("evsm4", map_size=(97, 64), **fixed)
    frames = [renderer.render(*view, s, outputs=OUTPUTS) for s in (shared, alone)]
    np.testing.assert_array_equal(frames[0].moments[1], frames[1].moments[1])
    second = (frames[0].cascade_index == 1) & (frames[1].cascade_index == 1)
    assert second.sum() > 200
    # a place in an array of 97 is another float32 than in one of 64: 2^-24 of it, in texels
    masks = [frame.mask[second] for frame in frames]
    np.testing.assert_allclose(*masks, rtol=0, atol=97 * U)


# -- several samples a texel -----------------------------------------------------------------------


@pytest.mark.parametrize("name", ["vsm", "evsm4", "lvsm"])
def test_moments_of_samples_are_their_mean(renderer, name):
    # A sheet ends in the middle of a column of texels: half of its samples are the sheet's.
    def scene(edge):
        sheet = [[-4, 2, -4], [edge, 2, -4], [edge, 2, 4], [-4, 2, 4]]
        ground = [[-9, 0, -9], [9, 0, -9], [9, 0, 9], [-9, 0, 9]]
        triangles = np.array([[0, 2, 1], [0, 3, 2]])
        return csm.Scene.from_arrays(sheet + ground, np.concatenate([triangles, triangles + 4]))

    camera = csm.Camera.look_at((0, 8, 0.1), (0, 0, 0), fov_y_deg=60, near=1, far=20, size=(24, 24))
    sun = csm.Sun((0, 1, 0))
    settings = csm.ShadowSettings(
        cascade_count=1, map_size=64, fit="diameter", filter_size=1, samples=4,
        depth_range="manual", manual_depth_range=(-8.0, 0.0), view_range="camera",
        cull="none", **FILTERS[name],
    )  # fmt: skip
    texel = csm.fit_cascades(camera, sun, settings).texel_size[0, 0]
    frame = renderer.render(scene(2.5 * texel), camera, sun, settings, outputs=("moments",))
    at_sheet, at_ground = moment_oracle.moments_of(settings, np.array([0.75, 1.0]))
    span = at_ground - at_sheet
    channel = int(np.argmax(np.abs(span)))
    share = (frame.moments[0][..., channel] - at_sheet[channel]) / span[channel]
    quarters = np.round(4 * share) / 4
    expected = at_sheet + quarters[..., None] * span
    # the sheet's depth in float32, and what exp() makes of it
    np.testing.assert_allclose(frame.moments[0], expected, rtol=500 * U, atol=500 * U)
    inside = quarters[26:38]  # rows under the sheet
    assert (inside == 0.5).any(axis=1).all(), "no half-covered texel"
    assert set(np.unique(inside)) == {0.0, 0.5, 1.0}
    one = renderer.render(
        scene(2.5 * texel), camera, sun, settings.replace(samples=1), outputs=("moments",)
    )
    assert not np.isclose(one.moments[0], 0.5 * (at_sheet + at_ground)).all(axis=-1).any()


# -- absent unless asked for -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("vsm", {"exponent": 3.0, "log_filter": True, "layer_count": 8, "negative_exponent": 2.0}),
        ("vsm", {"bleed_step": 0.0, "bleed_power": 1.0}),
        ("evsm2", {"negative_exponent": 2.0}),
        ("esm", {"bleed_step": 0.3, "bleed_power": 2.0}),
        ("esm log", {"lookup": "trilinear"}),
        ("evsm4", {"filter_size": 1, "filter_weights": "gaussian", "kernel": "world"}),
    ],
)
def test_what_has_no_meaning_changes_nothing(renderer, view, name, change):
    settings = settings_of(name, filter_size=change.get("filter_size", 5))
    plans = [csm.plan(s, size=SIZE) for s in (settings, settings.replace(**change))]
    assert plans[0] == plans[1]
    masks = [renderer.render(*view, s).mask for s in (settings, settings.replace(**change))]
    np.testing.assert_array_equal(*masks)


def test_each_filter_pays_for_its_own_moments():
    texels = 2 * 97 * 97
    numbers = {"vsm": 2, "lvsm": 8, "lvsm of 2": 4, "evsm2": 2, "evsm4": 4, "esm": 1, "esm log": 1}
    for name, count in numbers.items():
        for moment_format, width in (("float32", 4), ("float16", 2)):
            plan = csm.plan(settings_of(name, moment_format), size=SIZE, outputs=("mask",))
            textures = {texture.name: texture for texture in plan.textures}
            assert textures["moments"].bytes == texels * count * width
            slices = 4 if name == "lvsm" else 1
            assert textures["moments_between"].bytes == 97 * 97 * min(count, 4) * width
            assert textures["moments"].layers == 2 * max(slices // 2, 1)
            assert [step.name for step in plan.passes].count("shadow_blur") == 2
        unblurred = csm.plan(settings_of(name, filter_size=1), size=SIZE, outputs=("mask",))
        assert "moments_between" not in {texture.name for texture in unblurred.textures}
        assert "shadow_blur" not in {step.name for step in unblurred.passes}
    plain = csm.plan(BASE.replace(filter="hard"), size=SIZE, outputs=("mask",))
    assert not {"moments", "moments_between"} & {texture.name for texture in plain.textures}


# -- errors ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"filter": "evsm2", "exponent": 44.37}, "exponent must be at most 44.36"),
        ({"filter": "evsm4", "exponent": 5.55, "moment_format": "float16"}, "at most 5.54"),
        ({"filter": "evsm4", "negative_exponent": 5.55, "moment_format": "float16"},
         "negative_exponent must be at most 5.54"),
        ({"filter": "esm", "exponent": 88.73}, "at most 88.72"),
        ({"filter": "esm", "exponent": 11.1, "moment_format": "float16"}, "at most 11.08"),
        ({"filter": "evsm2", "exponent": 44.0, "lookup": "trilinear"}, "at most 43.66"),
        ({"filter": "evsm4", "moment_format": "unorm16"}, "moment_format must be float32 or"),
        ({"filter": "esm", "moment_format": "unorm16"}, "moment_format must be float32 or"),
        ({"filter": "lvsm", "layer_count": 3}, "layer_count must be even"),
        ({"filter": "vsm", "samples": 3}, "samples must be 1, 2, 4 or 8"),
        ({"filter": "vsm", "bleed_step": 1.0}, "bleed_step must be"),
    ],
)  # fmt: skip
def test_what_a_format_cannot_hold_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        csm.ShadowSettings(**change)


@pytest.mark.parametrize("name", ["evsm2", "evsm4", "esm"])
@pytest.mark.parametrize("moment_format", ["float32", "float16"])
@pytest.mark.parametrize("filter_size", [1, 9, 65])
def test_at_the_limit_nothing_overflows(renderer, view, name, moment_format, filter_size):
    limit = {"float32": 44.36, "float16": 5.54} if name != "esm" else (
        {"float32": 88.72, "float16": 11.08}
    )  # fmt: skip
    settings = settings_of(
        name, moment_format, filter_size, exponent=limit[moment_format], map_size=140, samples=4
    )
    frame = renderer.render(*view, settings, outputs=OUTPUTS)
    assert np.isfinite(frame.moments).all()
    assert frame.moments.max() > 0.9 * moment_oracle.LARGEST[moment_format]
    assert np.isfinite(frame.mask).all()
    assert 0.0 <= frame.mask.min() <= frame.mask.max() <= 1.0
