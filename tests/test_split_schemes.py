"""Ways to cut the view range, through `csm.fit_cascades`: closed forms, quantiles of the points
themselves, what must be covered, what must not flicker (docs/numerics.md 17)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

import csm
from csm import shapes

SUN = csm.Sun((0.3, 0.8, 0.45))
SPLITS = "practical uniform logarithmic manual resolution sdsm percentages histogram".split()
BY_HAND = {"manual": (2.0, 9.0, 30.0), "percentages": (1.0, 8.0, 40.0)}
SEEN = ("sdsm", "histogram")


def camera(near=0.1, far=1000.0, fov=60.0, size=(160, 90), eye=(0, 2, 0)):
    ahead = np.add(eye, (0.2, -0.1, -1.0))
    return csm.Camera.look_at(eye, ahead, fov_y_deg=fov, near=near, far=far, size=size)


def flat(near=-20.0, far=60.0):
    return csm.Camera.orthographic((1, 2, 3), (4, 1, -9), height=12, near=near, far=far)


def setting(split, **more):
    more.setdefault("view_range", "camera")
    return csm.ShadowSettings(
        split=split, manual_splits=BY_HAND.get(split, ()), **{"map_size": 256, **more}
    )


def fitted(view, settings, **more):
    return csm.fit_cascades(view, SUN, settings, **more)


def points_at(view, depths, rng):
    """(m, 3) points of the view at these view depths, anywhere in the picture."""
    depths = np.asarray(depths, np.float64)
    spread = np.ones_like(depths) if view.orthographic else depths
    x = rng.uniform(-1, 1, depths.shape) * view.half_width * spread
    y = rng.uniform(-1, 1, depths.shape) * view.half_height * spread
    axes = np.stack([view.right, view.up, -view.backward])
    return view.eye + np.stack([x, y, depths], axis=1) @ axes


def depths_of(view, points):
    return -(np.asarray(points, np.float64) - view.eye) @ view.backward


def some_points(view, seed=1, count=500):
    rng = np.random.default_rng(seed)
    low = view.near if view.orthographic else 2.0
    return points_at(view, rng.uniform(low, 0.5 * view.far, count), rng)


# -- equal resolution (S2) -------------------------------------------------------------------------


@pytest.mark.parametrize("fit", ["sphere", "diameter", "scene", "box"])
@pytest.mark.parametrize("fov", [30, 60, 100])
def test_s2_equal_maps_are_cut_logarithmically(figure, fov, fit):
    view = camera(fov=fov)
    worst = 0.0
    for snap in ("exact", "none"):
        for count in (1, 2, 4, 8):
            cascades = fitted(
                view, setting("resolution", fit=fit, snap=snap, cascade_count=count, map_size=1024)
            )
            expected = view.near * (view.far / view.near) ** (np.arange(count + 1) / count)
            if fit != "scene":
                worst = max(worst, np.abs(cascades.splits / expected - 1).max())
            assert cascades.splits[[0, -1]].tolist() == [view.near, view.far]
    figure("S2", "equal maps: cuts off the logarithmic scheme", worst, 1e-6, "relative")


@pytest.mark.parametrize("sizes", [(1024,) * 4, (2048, 1024, 1024, 512), (512, 2048, 256, 777)])
@pytest.mark.parametrize("fov", [30, 60, 100])
def test_s2_texels_are_equally_many_pixels(figure, fov, sizes):
    view = camera(fov=fov)
    worst = 0.0
    for fit, more in (
        ("sphere", {}),
        ("sphere", {"snap": "none", "filter": "pcf", "filter_size": 7}),
        ("diameter", {"filter": "pcf", "filter_size": 5}),
        ("sphere", {"first_split": 4.0}),
    ):
        cascades = fitted(view, setting("resolution", fit=fit, map_size=sizes, **more))
        texel_per_pixel = cascades.texel_size[:, 0] / cascades.splits[:-1]
        texel_per_pixel = texel_per_pixel[1:] if "first_split" in more else texel_per_pixel
        worst = max(worst, np.ptp(texel_per_pixel) / texel_per_pixel.min())
        assert (np.diff(cascades.splits) > 0).all()
    # The last split is assigned; the others are solved to 1e-13.
    figure("S2", "texels in pixels at the near ends differ", worst, 1e-6, "relative")


def test_wide_views_divide_the_range_as_their_maps_do():
    """Beyond a diagonal of 90 degrees the sphere's radius is k times far, so every ratio of two
    splits is proportional to the map's texels."""
    view = camera(fov=100)
    sizes = np.array([2048, 1024, 1024, 512])
    cascades = fitted(view, setting("resolution", map_size=tuple(sizes), snap="none"))
    ratios = sizes * (view.far / view.near / np.prod(sizes * 1.0)) ** 0.25
    assert cascades.splits[1:] / cascades.splits[:-1] == pytest.approx(ratios, rel=1e-12)


def test_resolution_of_all_slices_from_the_near_plane():
    """Windows of fit = scene start at near: larger than the slice's own diameter."""
    view = camera(fov=20)
    cascades = fitted(view, setting("resolution", fit="scene"))
    diagonal = math.hypot(view.half_width, view.half_height)
    far = cascades.splits[1:]
    across = np.hypot(far - view.near, diagonal * (far + view.near))
    diameter = np.maximum(2 * diagonal * far, across)
    assert np.ptp(diameter / cascades.splits[:-1]) < 1e-9 * diameter[0] / view.near


def test_resolution_of_an_orthographic_view():
    """A pixel is equally large at all depths: texels are equal, and so are slices of equal maps."""
    for near in (-20.0, 0.0, 5.0):
        view = flat(near=near)
        even = fitted(view, setting("resolution", map_size=512))
        assert even.splits == pytest.approx(np.linspace(near, 60, 5), abs=1e-10)
        uneven = fitted(view, setting("resolution", map_size=(520, 512, 512, 500)))
        assert np.ptp(uneven.texel_size) < 1e-9 * uneven.texel_size.min()


def test_maps_too_unequal_for_a_short_range_keep_a_least_share():
    """Even at no length a map of 64 texels is coarser than one of 4096 over all of the range."""
    view = camera(near=1.0, far=2.0)
    cascades = fitted(view, setting("resolution", map_size=(4096, 64, 64, 4096)))
    shares = np.diff(np.log(cascades.splits)) / math.log(2.0) * 4
    assert shares[1:3] == pytest.approx(1 / 64, rel=1e-9)
    texel_per_pixel = cascades.texel_size[:, 0] / cascades.splits[:-1]
    assert texel_per_pixel[0] == pytest.approx(texel_per_pixel[3], rel=1e-9)


# -- by hand ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", [camera(), flat(), flat(near=0.0)], ids=["lens", "-20", "0"])
def test_percentages_are_of_the_view_range(view):
    cascades = fitted(view, setting("percentages"))
    expected = [view.near + (view.far - view.near) * p / 100 for p in (0, 1, 8, 40, 100)]
    assert cascades.splits == pytest.approx(expected, rel=1e-15)


def test_percentages_follow_a_range_cut_to_the_scene():
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(30.0))])
    cascades = fitted(camera(), setting("percentages", view_range="scene"), scene=scene)
    assert cascades.splits[-1] < 100
    shares = (cascades.splits - 0.1) / (cascades.splits[-1] - 0.1)
    assert shares == pytest.approx([0, 0.01, 0.08, 0.4, 1], rel=1e-12)


@pytest.mark.parametrize("split", sorted(set(SPLITS) - set(BY_HAND)))
def test_the_first_cascade_ends_at_first_split_and_the_scheme_divides_the_rest(split):
    view = camera()
    points = some_points(view)
    cascades = fitted(view, setting(split, first_split=4.0, lam=0.7), receivers=points)
    assert cascades.splits[1] == 4.0
    near, far = cascades.splits[[0, -1]]
    if split in ("practical", "uniform", "logarithmic", "sdsm"):
        scheme = "practical" if split == "sdsm" else split
        rest = csm.split_distances(4.0, far, 3, scheme=scheme, lam=0.7)
        assert np.array_equal(cascades.splits[1:], rest)
    if split == "resolution":
        assert cascades.splits[1:] == pytest.approx(4 * 250 ** (np.arange(4) / 3), rel=1e-9)
    assert near < 4.0 < cascades.splits[2]


def test_one_cascade_or_splits_by_hand_have_no_first_split():
    view = camera()
    one = fitted(view, setting("practical", cascade_count=1, first_split=4.0))
    assert one.splits.tolist() == [0.1, 1000.0]
    assert fitted(view, setting("manual", first_split=4.0)).splits[1] == 2.0


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"first_split": 0.05}, "first_split must lie between .*near 0.1 .*, 1000 .* 0.05"),
        ({"first_split": 0.1}, "first_split must lie between .* near 0.1"),
        ({"first_split": 1000.0}, "first_split must lie between .* 1000 .*got 1000"),
        ({"first_split": 4.0, "max_distance": 3.0}, "first_split .* max_distance, 3 "),
        ({"max_distance": 0.1}, "max_distance must be > the camera's near .* 0.1, near 0.1"),
        ({"split": "manual", "manual_splits": (1, 2, 9), "max_distance": 9.0}, "manual_splits"),
        ({"split": "sdsm"}, "split sdsm needs receivers"),
        ({"split": "histogram"}, "split histogram needs receivers"),
        ({"split": "sdsm", "cascade_count": 1}, "split sdsm needs receivers"),
    ],
)
def test_what_contradicts_the_camera_is_refused_by_name(changes, text):
    with pytest.raises(ValueError, match=text):
        fitted(camera(), setting("practical").replace(**changes))


@pytest.mark.parametrize("view", [camera(), flat(near=-1.0)], ids=["lens", "orthographic"])
@pytest.mark.parametrize("split", ["uniform", "resolution", "manual"])
def test_a_scene_nearer_than_a_distance_by_hand_leaves_it_in_the_range(split, view):
    """All of the scene lies within 3 m: the first cascade still ends at 4 m, the rest stay."""
    at = view.eye - 2.0 * view.backward
    scene = csm.Scene([shapes.mesh("box", shapes.boxes([at - 0.3], [at + 0.3]))])
    changes = {"manual_splits": (1.0, 2.0, 4.0)} if split == "manual" else {"first_split": 4.0}
    near_it = fitted(view, setting(split, view_range="scene").replace(**changes), scene=scene)
    assert near_it.splits[-1] >= 4.0 + (4.0 - view.near) / 64
    assert near_it.splits[-1] < 6.0
    assert 4.0 in near_it.splits
    assert (np.diff(near_it.splits) > 0).all()
    free = fitted(view, setting(split).replace(**changes))
    assert near_it.texel_size[0] == pytest.approx(free.texel_size[0], rel=1e-15)


def test_first_split_outside_of_what_is_seen_is_not_taken():
    view = camera()
    rng = np.random.default_rng(3)
    for split in SEEN:
        for depths in ((10.0, 300.0), (0.5, 2.0)):
            points = points_at(view, rng.uniform(*depths, 300), rng)
            asked = fitted(view, setting(split, first_split=4.0), receivers=points)
            never = fitted(view, setting(split), receivers=points)
            assert np.array_equal(asked.splits, never.splits)


# -- distance --------------------------------------------------------------------------------------


def test_max_distance_ends_the_range_where_it_is_the_least():
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(30.0))])
    for split in SPLITS:
        view = camera()
        points = some_points(view)
        for limit in (40.0, 35.5):
            base = setting(split, max_distance=limit, view_range="scene")
            cut = fitted(view, base.replace(view_range="camera"), receivers=points)
            assert cut.splits[-1] == limit
            in_scene = fitted(view, base, receivers=points, scene=scene)
            assert in_scene.splits[-1] <= limit
        beyond = fitted(view, setting(split, max_distance=5000.0), receivers=points)
        assert np.array_equal(beyond.splits, fitted(view, setting(split), receivers=points).splits)


def test_beyond_max_distance_all_is_lit(renderer):
    rng = np.random.default_rng(5)
    lower = rng.uniform((-25, 0, -25), (25, 0, 25), size=(80, 3))
    blocks = shapes.boxes(lower, lower + rng.uniform(0.5, 3, size=(80, 3)))
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(30.0)), shapes.mesh("blocks", blocks)])
    view = camera(eye=(0, 8, 30), near=0.5, far=200)
    outputs = ("mask", "valid", "view_depth", "cascade_index", "normal")
    frames = {}
    for limit in (0.0, 30.0):
        settings = csm.ShadowSettings(map_size=512, max_distance=limit)
        frame = frames[limit] = renderer.render(scene, view, SUN, settings, outputs=outputs)
        assert frame.cascades.splits[-1] == limit or limit == 0.0
    frame = frames[30.0]
    beyond = frame.valid & (frame.view_depth > 30.0 * (1 + 1e-5))
    within = frame.valid & (frame.view_depth < 30.0 * (1 - 1e-5))
    assert beyond.sum() > 500
    assert within.sum() > 500
    facing = frame.normal @ SUN.to_light > 1e-3
    assert (frame.cascade_index[beyond] == 255).all()
    assert (frame.mask[beyond & facing] == 1).all()
    assert (frame.cascade_index[within] < 4).all()
    assert (frames[0.0].mask[beyond & facing] == 0).any()  # there are shadows to leave out


# -- what is seen (SDSM) ---------------------------------------------------------------------------


@hypothesis_settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    near=st.sampled_from([1e-3, 0.1, 1.0]),
    ratio=st.sampled_from([1.5, 10.0, 1e4]),
    span=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    split=st.sampled_from(SEEN),
    count=st.integers(1, 8),
)
def test_seen_range_holds_every_receiver(seed, near, ratio, span, split, count):
    rng = np.random.default_rng(seed)
    view = camera(near=near, far=near * ratio)
    shares = rng.uniform(min(span), max(span), 40)
    depths = np.minimum(near * ratio**shares * (1 + 1e-9), view.far * (1 - 1e-9))
    points = points_at(view, depths, rng)
    measured = depths_of(view, points)
    cascades = fitted(view, setting(split, cascade_count=count, fit="box"), receivers=points)
    low, high = cascades.splits[[0, -1]]
    # as float32, and as a float32 position would have it
    single = np.float32(measured).astype(np.float64)
    assert low == near or low < min(measured.min(), single.min())
    assert high == view.far or high > max(measured.max(), single.max())
    # No more than a rung of a quarter octave too far out, and the 2^-20 for float32.
    rung = 2**0.25 * (1 + 1e-5)
    assert low >= measured.min() / rung * (1 - 1e-12)
    assert high <= measured.max() * rung * (1 + 1e-12)
    assert (np.diff(cascades.splits) > 0).all()
    # Every receiver is inside the window of its slice.
    own = np.clip(np.searchsorted(cascades.splits, measured, side="left") - 1, 0, count - 1)
    homogeneous = np.c_[points, np.ones(len(points))]
    uvz = np.einsum("nij,nj->ni", cascades.uvz_from_world[own], homogeneous)[:, :3]
    assert (uvz >= 0).all()
    assert (uvz <= 1).all()


@pytest.mark.parametrize("lam", [0.0, 0.5, 1.0])
def test_sdsm_cuts_what_is_seen_by_the_practical_scheme(lam):
    view = camera()
    points = some_points(view)
    cascades = fitted(view, setting("sdsm", lam=lam), receivers=points)
    near, far = cascades.splits[[0, -1]]
    depths = depths_of(view, points)
    assert depths.min() / 2**0.25 < near < depths.min()
    assert depths.max() < far < depths.max() * 2**0.25
    assert np.array_equal(cascades.splits, csm.split_distances(near, far, 4, lam=lam))
    for end in (near, far):
        rungs = 4 * math.log2(end / 0.1)
        assert rungs == pytest.approx(round(rungs), abs=1e-9)


def test_receivers_out_of_the_range_do_not_count():
    view = camera()
    rng = np.random.default_rng(4)
    seen = points_at(view, rng.uniform(5, 50, 200), rng)
    others = points_at(view, [-3.0, 0.05, 2000.0], rng)
    for split in SEEN:
        alone = fitted(view, setting(split), receivers=seen)
        among = fitted(view, setting(split), receivers=np.concatenate([seen, others]))
        assert np.array_equal(alone.splits, among.splits)


@pytest.mark.parametrize("points", [np.empty((0, 3)), [[0.0, 0.0, 900.0]]], ids=["none", "behind"])
def test_where_nothing_is_seen_the_range_is_the_scenes(points):
    view = camera()
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(30.0))])
    expected = fitted(view, setting("practical", view_range="scene"), scene=scene)
    sdsm = fitted(view, setting("sdsm", view_range="scene"), scene=scene, receivers=points)
    assert np.array_equal(sdsm.splits, expected.splits)
    assert sdsm.range_step == expected.range_step
    logarithmic = setting("logarithmic", view_range="scene")
    histogram = fitted(
        view, setting("histogram", view_range="scene"), scene=scene, receivers=points
    )
    assert np.array_equal(histogram.splits, fitted(view, logarithmic, scene=scene).splits)


def walked(view, settings, frames, hold=True):
    """Splits along a walk whose frames are points seen."""
    held, splits = None, []
    for points in frames:
        cascades = fitted(view, settings, receivers=points, held=held)
        held = cascades if hold else None
        splits.append(cascades.splits)
    return np.array(splits)


def changes(values):
    return int((np.diff(values, axis=0) != 0).any(axis=-1).sum())


@pytest.mark.parametrize("split", SEEN)
def test_noise_in_what_is_seen_does_not_flash(split):
    """The ends of what is seen tremble by a few per cent round a rung, as the nearest and the
    farthest pixel do: without a memory the splits flash, with it they settle at once."""
    view = camera()
    rng = np.random.default_rng(6)
    near_rung, far_rung = 0.1 * 2 ** (17 / 4), 0.1 * 2 ** (43 / 4)
    frames = []
    for _ in range(200):
        low, high = near_rung * rng.uniform(0.95, 1.05), far_rung * rng.uniform(0.95, 1.05)
        frames.append(points_at(view, np.r_[low, high, np.geomspace(2.5, 150, 40)], rng))
    held = walked(view, setting(split), frames)
    free = walked(view, setting(split), frames, hold=False)
    assert changes(held[:, [0]]) <= 1
    assert changes(held[:, [-1]]) <= 1
    assert changes(held) <= 2
    assert changes(free) > 50


def test_a_held_range_is_at_most_one_rung_longer():
    view = camera()
    rng = np.random.default_rng(7)
    depths = 3.0 * np.exp(np.cumsum(rng.normal(0, 0.05, 300)))
    held = walked(view, setting("sdsm"), [points_at(view, [d, 3 * d], rng) for d in depths])
    rung = 2**0.25
    assert (held[:, 0] < depths).all()
    assert (held[:, 0] > depths / rung**2 * (1 - 1e-5)).all()
    assert (held[:, -1] > 3 * depths).all()
    assert (held[:, -1] < 3 * depths * rung**2 * (1 + 1e-5)).all()


# -- quantiles -------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [2, 4, 8])
@pytest.mark.parametrize("shape", ["even", "clusters", "far"])
def test_histogram_cuts_lie_at_quantiles(count, shape):
    view = camera()
    rng = np.random.default_rng(8)
    depths = {
        "even": np.exp(rng.uniform(np.log(1), np.log(700), 4000)),
        "clusters": np.r_[rng.uniform(1, 9, 2000), rng.uniform(40, 300, 2000)],
        "far": rng.uniform(1, 900, 4000),
    }[shape]
    points = points_at(view, depths, rng)
    cascades = fitted(view, setting("histogram", cascade_count=count), receivers=points)
    exact = np.quantile(depths, np.arange(1, count) / count, method="lower")
    cuts = cascades.splits[1:-1]
    steps = 8 * np.log2(cuts / 0.1)
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    if shape == "far" and count == 8:
        # Quantiles closer together than the steps of an eighth of an octave move apart, outwards.
        assert (np.diff(np.round(steps)) >= 1).all()
        return
    # Half a step of rounding, and one bin of log depth.
    allowed = 2 ** (1 / 16) * (view.far / view.near) ** (1 / 256)
    assert (np.maximum(cuts / exact, exact / cuts) <= allowed * (1 + 1e-9)).all()


def test_a_gap_belongs_to_the_cascade_behind_it():
    view = camera()
    rng = np.random.default_rng(9)
    depths = np.r_[rng.uniform(2, 4, 1000), rng.uniform(200, 400, 1000)]
    settings = setting("histogram", cascade_count=2)
    cascades = fitted(view, settings, receivers=points_at(view, depths, rng))
    assert 3.9 < cascades.splits[1] < 4.6


@pytest.mark.parametrize("depth", [0.1, 7.0, 1000.0])
def test_receivers_at_one_depth_are_cut_evenly(depth):
    """A range of one or two rungs has no room for cuts on rungs: equal ratios then."""
    view = camera()
    points = points_at(view, np.full(50, depth), np.random.default_rng(10))
    points += 1e-9 * view.backward * (1 if depth == 1000.0 else -1)  # inside, whatever rounding
    cascades = fitted(view, setting("histogram", cascade_count=8), receivers=points)
    near, far = cascades.splits[[0, -1]]
    assert far / near <= 2**0.5 * (1 + 1e-9)
    expected = csm.split_distances(near, far, 8, scheme="logarithmic")
    assert np.array_equal(cascades.splits, expected)


def test_histogram_leaves_what_lies_beyond_max_distance_out():
    view = camera()
    rng = np.random.default_rng(11)
    near, far = rng.uniform(2, 40, 3000), rng.uniform(60, 900, 9000)
    settings = setting("histogram", max_distance=50.0)
    both = fitted(view, settings, receivers=points_at(view, np.r_[near, far], rng))
    alone = fitted(view, settings, receivers=points_at(view, near, rng))
    assert both.splits[-1] == 50.0
    assert np.array_equal(both.splits[:-1], alone.splits[:-1])


# -- orthographic cameras, all schemes -------------------------------------------------------------


@pytest.mark.parametrize("near", [-20.0, 0.0, 0.5])
@pytest.mark.parametrize("split", SPLITS)
def test_orthographic_cameras_of_any_near(split, near):
    """What divides by depth needs a positive near; the rest takes any."""
    view = flat(near=near)
    points = some_points(view)
    with_logs = setting(split, lam=0.5)
    if near <= 0 and split in ("practical", "logarithmic", "sdsm"):
        with pytest.raises(ValueError, match=f"near must be > 0 for split {split}.* near {near:g}"):
            fitted(view, with_logs, receivers=points)
        if split == "logarithmic":
            return
    cascades = fitted(view, with_logs.replace(lam=0.0), receivers=points)
    assert (np.diff(cascades.splits) > 0).all()
    depths = depths_of(view, points)
    if split not in SEEN:
        assert cascades.splits[[0, -1]].tolist() == [near, 60.0]
        return
    step = 80 / 64 if near < 0 else 60 / 64  # rungs in lengths where near has no ratio
    low, high = cascades.splits[[0, -1]]
    assert low <= depths.min()
    assert high >= depths.max()
    if near <= 0:
        assert low > depths.min() - step * (1 + 1e-3)
        assert high < depths.max() + step * (1 + 1e-3)
    if split == "sdsm":
        assert cascades.splits == pytest.approx(np.linspace(low, high, 5), rel=1e-14, abs=1e-12)
    else:
        exact = np.quantile(depths, [0.25, 0.5, 0.75])
        assert np.abs(cascades.splits[1:-1] - exact).max() <= (step if near <= 0 else 0.1 * 60)


def test_receivers_in_the_plane_of_an_orthographic_eye():
    """Depth 0 on a rung, without any relative rounding to spare."""
    view = flat(near=-32.0, far=32.0)
    points = view.eye + np.array([[1.0], [-2.0], [0.5]]) * view.right
    cascades = fitted(view, setting("sdsm", lam=0.0), receivers=points)
    assert cascades.splits[0] <= 0 <= cascades.splits[-1]
    assert (np.diff(cascades.splits) > 0).all()


@hypothesis_settings(max_examples=150, deadline=None)
@given(
    split=st.sampled_from(SPLITS),
    count=st.integers(1, 8),
    near=st.floats(1e-4, 10),
    ratio=st.floats(1.05, 1e7),
    lam=st.floats(0, 1),
    first=st.none() | st.floats(0.01, 0.95),
    limit=st.none() | st.floats(0.1, 1.5),
    fit=st.sampled_from(["sphere", "box", "diameter", "scene"]),
    seed=st.integers(0, 1000),
)
def test_splits_ascend_and_stay_in_the_range(
    split, count, near, ratio, lam, first, limit, fit, seed
):
    rng = np.random.default_rng(seed)
    far = near * ratio
    view = camera(near=near, far=far)
    by_hand = sorted(rng.uniform(5, 95, count - 1)) if split in BY_HAND else []
    reach = near + (far - near) * limit if limit else far
    if split == "manual":
        by_hand = [near + (min(reach, far) - near) * percent / 100 for percent in by_hand]
    settings = csm.ShadowSettings(
        cascade_count=count, split=split, manual_splits=tuple(by_hand), lam=lam, map_size=128,
        max_distance=reach if limit else 0.0, view_range="camera", fit=fit,
        first_split=near + (min(reach, far) - near) * first if first else 0.0,
    )  # fmt: skip
    points = points_at(view, near * ratio ** rng.uniform(0, 1, 30), rng)
    cascades = fitted(view, settings, receivers=points)
    assert (np.diff(cascades.splits) > 0).all()
    assert cascades.splits[0] >= near
    assert cascades.splits[-1] <= min(reach, far)
    if split not in SEEN:
        assert cascades.splits[[0, -1]].tolist() == [near, min(reach, far)]
