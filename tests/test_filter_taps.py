"""Filters that compare depths: kernels of every weight, width and fetch, discs of taps, against the
same compares in doubles (docs/numerics.md 32). PCSS: test_filter_pcss.py."""

import re
from pathlib import Path

import kernel_oracle
import mask_oracle
import numpy as np
import pytest
import small_scenes
from test_bias import AZIMUTHS, Plane
from test_shadow_mask import OUTPUTS, SIZE, assert_mask_matches

import csm
from scripts import poisson_discs

WEIGHTS = ("box", "bilinear", "tent", "gaussian")
SELECTS = ("map", "interval", "frustum")
BASE = csm.ShadowSettings(map_size=128)


def render(renderer, settings, number=0, scene=None, sun="low", size=SIZE):
    scene = scene or list(small_scenes.SCENES.values())[number % 4]()
    camera = small_scenes.camera(number % 4, size)
    sun = csm.Sun(small_scenes.SUNS[sun])
    return renderer.render(scene, camera, sun, settings, outputs=OUTPUTS)


# -- kernels of texels -----------------------------------------------------------------------------


# Sizes 1 and 2, which no weights change, are in test_shadow_mask.py.
PCF = [(weights, 3, select) for weights in WEIGHTS for select in SELECTS]
PCF += [
    (weights, size, SELECTS[(number + size) % 3])
    for number, weights in enumerate(WEIGHTS)
    for size in (5, 9, 33)
]


@pytest.mark.parametrize(("weights", "filter_size", "select"), PCF)
def test_pcf_is_the_weighted_mean_of_compares(renderer, evidence, weights, filter_size, select):
    settings = BASE.replace(
        filter="pcf", filter_size=filter_size, filter_weights=weights, select=select
    )
    frame = render(renderer, settings, WEIGHTS.index(weights) + filter_size)
    assert_mask_matches(frame, evidence)
    assert ((frame.mask > 0.0) & (frame.mask < 1.0)).sum() > 50


@pytest.mark.parametrize("kernel", ["world", "screen"])
@pytest.mark.parametrize("weights", WEIGHTS)
def test_kernels_of_any_width(renderer, evidence, weights, kernel):
    select = SELECTS[(WEIGHTS.index(weights) + len(kernel)) % 2]
    settings = BASE.replace(
        filter="pcf", filter_size=9, filter_weights=weights, kernel=kernel, select=select,
        fit="box", map_size=128 if kernel == "world" else 64,
    )  # fmt: skip
    frame = render(renderer, settings, WEIGHTS.index(weights), sun="high")
    depths = kernel_oracle.seen_of(frame).view_depth
    widths = [kernel_oracle.half_widths(frame, i, depths) for i in range(4)]
    assert (np.concatenate(widths) % 0.5 != 0.0).any()
    assert_mask_matches(frame, evidence)


@pytest.mark.parametrize("kernel", ["texels", "world", "screen"])
@pytest.mark.parametrize("weights", WEIGHTS)
def test_gathered_depths_and_single_taps_give_the_same_bits(renderer, weights, kernel):
    select = SELECTS[(WEIGHTS.index(weights) + len(kernel)) % 2]
    settings = BASE.replace(
        filter="pcf", filter_size=7, filter_weights=weights, kernel=kernel, select=select
    )
    gathered = render(renderer, settings, 2)
    single = render(renderer, settings.replace(filter_fetch="taps"), 2)
    assert np.array_equal(gathered.mask, single.mask)
    assert len(np.unique(gathered.mask)) > 10


@pytest.mark.parametrize("weights", ["bilinear", "tent", "gaussian"])
def test_weights_centred_on_the_point_leave_no_steps(renderer, weights):
    # Seen from near by, a box jumps by a column of texels where the point enters the next one;
    # what is centred on the point changes little from pixel to pixel.
    scene = csm.scenes.plane_and_box()
    camera = csm.Camera.orthographic(
        (-3.0, 5, 0), (-3.0, 0, 0), up=(0, 0, -1), height=0.5, near=1, far=10, size=(400, 100)
    )
    camera = camera.replace(half_width=1.0)
    steps = {}
    for name in ("box", weights):
        settings = csm.ShadowSettings(
            cascade_count=1, map_size=64, filter="pcf", filter_size=5, filter_weights=name,
            fit="scene",
        )  # fmt: skip
        frame = renderer.render(scene, camera, csm.Sun((1, 1, 0)), settings)
        texel = frame.cascades.texel_size.max() * np.sqrt(2.0) / (2.0 / 400)  # pixels along x
        steps[name] = np.abs(np.diff(frame.mask, axis=1)).max()
    assert steps["box"] > 0.19
    # The heaviest column of texels passes from weight 0 to its largest over more than two texels.
    assert texel > 10
    assert steps[weights] < 1.0 / texel


# -- kernels of metres and of pixels ---------------------------------------------------------------


def edge_profile(renderer, settings, depth, size=(400, 24), orthographic=False, fov_y_deg=4.0):
    """(x, mask) across the shadow of a long wall's top on level ground, averaged over rows, seen
    by a camera that looks straight down, `depth` above the ground or as wide as from there; the
    frame."""
    wall = csm.Mesh([[0, 0, -40], [0, 0, 40], [0, 2, 40], [0, 2, -40]], [[0, 1, 2], [0, 2, 3]])
    ground = [[-40, 0, -40], [-40, 0, 40], [40, 0, 40], [40, 0, -40]]
    scene = csm.Scene([csm.Mesh(ground, [[0, 1, 2], [0, 2, 3]]), wall])
    camera = csm.Camera.look_at(
        (-2, depth, 0), (-2, 0, 0), up=(0, 0, -1), near=0.5, far=40, fov_y_deg=fov_y_deg, size=size
    )
    if orthographic:
        camera = csm.Camera.orthographic(
            (-2, 20, 0), (-2, 0, 0), up=(0, 0, -1), height=2.0 * depth * camera.half_height,
            near=1, far=40, size=size,
        )  # fmt: skip
    frame = renderer.render(scene, camera, csm.Sun((1, 1, 0.3)), settings, outputs=OUTPUTS)
    return small_scenes.positions_of(frame)[0, :, 0], frame.mask.mean(axis=0), frame


def width(x, profile):
    """Distance [m] from 90 to 10 % of light along x, at the end of the shadow about x = -2."""
    at_edge = np.abs(x + 2.0) < 1.2
    x, profile = x[at_edge][::-1], profile[at_edge][::-1]
    assert profile[0] < 0.01
    assert profile[-1] > 0.99
    return abs(np.interp(0.9, profile, x) - np.interp(0.1, profile, x))


@pytest.mark.parametrize("filter_name", ["pcf", "poisson"])
def test_a_world_kernel_is_as_wide_in_every_cascade(renderer, filter_name):
    # The camera looks down from two heights, each in a slice of its own.
    more = {"disc": "vogel", "tap_count": 64} if filter_name == "poisson" else {}
    settings = csm.ShadowSettings(
        cascade_count=2, map_size=1024, filter=filter_name, filter_size=17, kernel="world",
        split="manual", manual_splits=(9.0,), view_range="camera", select="interval", **more,
    )  # fmt: skip
    widths, texels = [], []
    for depth in (8.0, 20.0):
        x, profile, frame = edge_profile(renderer, settings, depth)
        index = np.unique(frame.cascade_index)
        assert len(index) == 1
        texels.append(frame.cascades.texel_size[index[0]].max())
        widths.append(width(x, profile))
        half = kernel_oracle.half_widths(frame, index[0], np.array([depth]))[0]
        metres = half * frame.cascades.texel_size[index[0]]
        np.testing.assert_allclose(metres, 8.5 * frame.cascades.texel_size[0].min(), rtol=1e-9)
    assert texels[1] > 3 * texels[0]
    # Both edges are on the lattice of their texels: a texel of the coarser map at each end, on
    # ground that the sun meets at an angle.
    assert widths[1] == pytest.approx(widths[0], abs=2.0 * texels[1])
    x, profile, _ = edge_profile(renderer, settings.replace(kernel="texels"), 20.0)
    assert width(x, profile) > 2.0 * widths[1]


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_screen_kernel_is_as_many_pixels_at_every_depth(renderer, orthographic):
    settings = csm.ShadowSettings(
        cascade_count=1, map_size=512, filter="pcf", filter_size=31, kernel="screen", fit="scene"
    )
    found = []
    for depth in (6.0, 12.0):
        x, profile, frame = edge_profile(renderer, settings, depth, (960, 40), orthographic, 5.0)
        pixel = abs(x[1] - x[0])
        found.append(width(x, profile) / pixel)
        texel = frame.cascades.texel_size.max() / pixel
        assert texel > 1.0  # else the kernel would be as many texels
        # The kernel is a square across the sun's rays, which meet the ground at an angle: somewhat
        # wider there than its 31 pixels, of which up to 80 % lie between 10 and 90 % of an edge.
        assert 0.6 * 31 < found[-1] < 1.5 * 31
    assert found[1] == pytest.approx(found[0], abs=2.0 * texel)


# -- discs -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("rotated", [False, True])
@pytest.mark.parametrize(
    ("disc", "tap_count"), [("poisson", 8), ("poisson", 16), ("vogel", 5), ("vogel", 64)]
)
def test_every_compare_in_a_disc(renderer, evidence, disc, tap_count, rotated):
    number = tap_count + rotated
    settings = BASE.replace(
        filter="poisson", filter_size=9, disc=disc, tap_count=tap_count, rotated=rotated,
        select=SELECTS[number % 3], map_size=256,
    )  # fmt: skip
    frame = render(renderer, settings, number, sun="high")
    oracle = mask_oracle.evaluate(frame)
    mask, index = frame.mask[frame.valid], frame.cascade_index[frame.valid]
    same = index == oracle.index
    assert same[oracle.index_sure].all()
    assert (mask >= oracle.lowest - 1e-6)[same].all()
    assert (mask <= oracle.highest + 1e-6)[same].all()
    # a tap of the disc now and then lies on the line between two texels
    assert (oracle.highest - oracle.lowest).mean() < 0.01
    assert len(np.unique(mask)) > tap_count / 3


@pytest.mark.parametrize("kernel", ["world", "screen"])
def test_discs_of_any_width(renderer, kernel):
    settings = BASE.replace(
        filter="poisson", filter_size=15, kernel=kernel, rotated=True, map_size=256
    )
    frame = render(renderer, settings, 1)
    oracle = mask_oracle.evaluate(frame)
    mask = frame.mask[frame.valid]
    same = frame.cascade_index[frame.valid] == oracle.index
    assert (mask >= oracle.lowest - 1e-6)[same].all()
    assert (mask <= oracle.highest + 1e-6)[same].all()
    assert (oracle.highest - oracle.lowest).mean() < 0.02


@pytest.mark.parametrize("count", poisson_discs.COUNTS)
def test_the_shader_holds_the_discs_of_the_script(count):
    shaders = Path(csm.renderer.__file__).parents[1] / "shaders" / "include" / "disc.glsl"
    text = shaders.read_text().split(f"poisson_disc[{count}] =")[1].split(");")[0]
    found = np.array(re.findall(r"vec2\((-?[\d.]+), (-?[\d.]+)\)", text), float)
    disc = poisson_discs.disc(count)
    np.testing.assert_array_equal(found, disc)
    # Taps stay in the disc, apart from each other, with the disc's own mean and variances.
    assert (np.hypot(*disc.T) < 1.0).all()
    np.testing.assert_allclose(disc.mean(axis=0), 0.0, atol=1e-5)
    np.testing.assert_allclose(disc.T @ disc / count, 0.25 * np.eye(2), atol=1e-5)
    # 40 % of the area covered by circles that do not meet; random points leave next to none.
    assert count * (0.5 * poisson_discs.least_distance(disc)) ** 2 > 0.4


def disc_mean(frame, i, positions, normals, scale, radius=64):
    """(m,) share of lit area in the disc, by a fine grid of points in it."""
    at = mask_oracle.place(frame, i, positions, normals, scale)
    stored = frame.shadow_maps[i].astype(np.float64)
    side = (np.arange(radius) + 0.5) / radius * 2.0 - 1.0
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    lit, count = np.zeros(len(positions)), 0
    for place in grid[np.hypot(*grid.T) < 1.0]:
        texel = np.floor(at.texel + 0.5 * frame.settings.filter_size * place)
        depth = at.depth - at.bias + (at.slope * (texel + 0.5 - at.texel)).sum(axis=1)
        u, v = np.clip(texel, 0, len(stored) - 1).astype(int).T
        lit += np.minimum(depth, 1.0) <= stored[v, u]
        count += 1
    return lit / count


def test_discs_converge_to_the_mean_of_the_disc(renderer):
    errors = {}
    base = BASE.replace(filter="poisson", filter_size=25, cascade_count=1, map_size=256)
    cases = [("vogel", n, turned) for n in (4, 16, 64) for turned in (False, True)]
    for disc, count, turned in [*cases, ("poisson", 8, False), ("poisson", 16, True)]:
        settings = base.replace(disc=disc, tap_count=count, rotated=turned)
        frame = render(renderer, settings, 0)
        positions, normals, _ = mask_oracle.receivers_of(frame)
        facing = normals @ frame.sun.to_light > 1e-3
        if not errors:
            truth = disc_mean(frame, 0, positions[facing], normals[facing], 80.0)
            soft = (truth > 0.02) & (truth < 0.98)
            assert soft.sum() > 300
        off = frame.mask[frame.valid][facing][soft] - truth[soft]
        errors[disc, count, turned] = np.sqrt((off**2).mean()), abs(off.mean())
    for (_, count, _), (rms, mean) in errors.items():
        # Taps drawn blindly err by sqrt(p (1 - p) / n); spread evenly they must do better.
        blind = np.sqrt((truth[soft] * (1.0 - truth[soft])).mean() / count)
        assert rms < (0.7 if count > 8 else 0.9) * blind
        assert mean < 0.25 * blind
    for turned in (False, True):
        rms = [errors["vogel", n, turned][0] for n in (4, 16, 64)]
        assert rms[1] < 0.6 * rms[0]
        assert rms[2] < 0.6 * rms[1]


def test_turning_the_disc_changes_no_mean(renderer):
    base = BASE.replace(filter="poisson", filter_size=25, map_size=256)
    for disc in ("poisson", "vogel"):
        fixed = render(renderer, base.replace(disc=disc), 0, size=(192, 108))
        turned = render(renderer, base.replace(disc=disc, rotated=True), 0, size=(192, 108))
        soft = (turned.mask > 0.0) & (turned.mask < 1.0) | (fixed.mask > 0.0) & (fixed.mask < 1.0)
        off = (turned.mask - fixed.mask)[soft]
        assert soft.sum() > 1000
        assert (off != 0.0).mean() > 0.5  # it does something
        # Each pixel is off by its own lot: the mean of n of them by sqrt(n) less.
        assert abs(off.mean()) < 3.0 * off.std() / np.sqrt(soft.sum()) + 1e-3


# -- bias ------------------------------------------------------------------------------------------

KERNELS = [
    {"filter": "pcf", "filter_size": 7, "filter_weights": "gaussian"},
    {"filter": "pcf", "filter_size": 5, "filter_weights": "tent", "kernel": "screen"},
    {"filter": "pcf", "filter_size": 7, "kernel": "screen"},
    {"filter": "poisson", "filter_size": 7, "rotated": True},
    {"filter": "poisson", "filter_size": 3, "disc": "vogel", "tap_count": 32},
    {"filter": "pcss", "filter_size": 9, "rotated": True},
]


@pytest.mark.parametrize("depth_format", mask_oracle.QUANTUM)
@pytest.mark.parametrize(
    "changes", KERNELS, ids=lambda changes: "-".join(map(str, changes.values()))
)
def test_d1_kernels_of_any_shape_leave_no_acne(figure, renderer, changes, depth_format):
    # The receiver's plane at the centre of the texel that is fetched, whatever the kernel's reach.
    worst = 0.0
    for slope in (0.0, 1.0, 5.0, 50.0):
        for azimuth in AZIMUTHS:
            plane = Plane(slope, azimuth)
            plane.sun = csm.Sun(plane.sun.to_light, angular_diameter_deg=3.0)
            worst = max(worst, plane.acne(renderer, depth_format=depth_format, **changes))
    figure("D1", f"acne under the automatic bias, {depth_format}", worst, 0, "share")


# -- what is absent, and what is refused -----------------------------------------------------------


def test_stages_give_the_same_bits(fresh_renderer):
    frames = []
    for stage in ("compute", "fragment"):
        renderer = fresh_renderer(stage=stage)
        for changes in KERNELS:
            frames.append(render(renderer, BASE.replace(**changes), 1).mask)
    for one, other in zip(frames[: len(KERNELS)], frames[len(KERNELS) :], strict=True):
        assert np.array_equal(one, other)


def test_settings_without_meaning_make_no_program_of_their_own():
    other = {"disc": "vogel", "tap_count": 7, "rotated": True}
    for filter_name in ("hard", "pcf"):
        plain = BASE.replace(filter=filter_name)
        assert csm.plan(plain.replace(**other)) == csm.plan(plain)
    taps = BASE.replace(filter="poisson")
    assert csm.plan(taps.replace(filter_weights="tent", filter_fetch="taps")) == csm.plan(taps)
    for size in (1, 2):  # one compare, and the hardware's four
        small = BASE.replace(filter="pcf", filter_size=size)
        more = {"filter_weights": "tent", "filter_fetch": "taps", "kernel": "screen"}
        assert csm.plan(small.replace(**more)) == csm.plan(small)
    one = taps.replace(cascade_count=1)
    assert csm.plan(one) == csm.plan(one.replace(kernel="world"))
    # and of what has a meaning only the mask's pass hears
    for changes in ({"tap_count": 8}, {"disc": "vogel"}, {"rotated": True}, {"kernel": "screen"}):
        changed, plain = csm.plan(taps.replace(**changes)), csm.plan(taps)
        assert changed.textures == plain.textures
        assert {name for name, _ in set(changed.programs) - set(plain.programs)} == {"shadow_mask"}


@pytest.mark.parametrize("filter_name", ["poisson", "pcss"])
def test_a_poisson_disc_has_8_or_16_taps(filter_name):
    with pytest.raises(ValueError, match=r"tap_count must be 8 or 16 with disc poisson \(got 12\)"):
        csm.ShadowSettings(filter=filter_name, tap_count=12)
    csm.ShadowSettings(filter=filter_name, tap_count=12, disc="vogel")
    csm.ShadowSettings(filter="pcf", tap_count=12)
