"""What bounds promise (docs/numerics.md 27; V1 and V2 of 16): never darker than the share of the
kernel that is lit, lit where nothing stands, no more light through occluders than in theory."""

import moment_oracle
import numpy as np
import pytest
import small_scenes
from test_bias import AZIMUTHS, SLOPES, Plane

import csm

FILTERS = {
    "vsm": {"filter": "vsm"},
    "lvsm": {"filter": "lvsm"},
    "evsm2": {"filter": "evsm2"},
    "evsm4": {"filter": "evsm4"},
    "esm": {"filter": "esm"},
    "esm log": {"filter": "esm", "log_filter": True, "exponent": 50.0},
}
FORMATS = [(name, moment_format) for moment_format in ("float32", "float16") for name in FILTERS]
FORMATS += [(name, "unorm16") for name in ("vsm", "lvsm", "esm log")]
U = 2.0**-24


class Layers:
    """Level sheets under a vertical sun, cut at x: depths are shares of the range, exactly.

    Parameters
    ----------
    depths : tuple
        Of the sheets, from -x to +x.
    cuts : tuple
        Texels in x where one sheet ends and the next begins.
    span : float
        The depth range [m].
    """

    sun = csm.Sun((0, 1, 0))

    def __init__(self, depths, cuts=(0.0,), span=10.0, map_size=160):
        self.span = span
        side = 4.0
        self.camera = csm.Camera.orthographic(
            (0, 1.1 * span, 0), (0, 0, 0), up=(0, 0, -1), height=side, near=0.05 * span,
            far=1.2 * span, size=(32, 32),
        )  # fmt: skip
        self.settings = csm.ShadowSettings(
            cascade_count=1, map_size=map_size, fit="box", depth_range="manual", cull="none",
            manual_depth_range=(-span, 0.0), view_range="camera",
        )  # fmt: skip
        # of the widest kernel's border; sheets meet at x = 0, on the lattice, whatever the border
        self.texel = side / (map_size - 1 - 2 * 33)
        edges = [-50.0, *(cut * self.texel for cut in cuts), 50.0]
        corners = []
        for depth, low, high in zip(depths, edges[:-1], edges[1:], strict=True):
            y = self.y_of(depth)
            corners += [[low, y, -50], [high, y, -50], [high, y, 50], [low, y, 50]]
        quads = 4 * np.arange(len(depths))[:, None, None]
        triangles = (quads + np.array([[0, 2, 1], [0, 3, 2]])).reshape(-1, 3)
        self.scene = csm.Scene.from_arrays(corners, triangles)

    def y_of(self, depth):
        return self.span * (1.0 - depth)

    def points(self, depth, count=201, reach=1.5):
        x = np.linspace(-reach, reach, count)
        return np.stack([x, np.full(count, self.y_of(depth)), np.full(count, 0.013)], axis=1)

    def lit(self, renderer, points, **changes):
        """(visibility of points, the frame)."""
        settings = self.settings.replace(**{"bias": "manual", **changes})
        frame = renderer.render(
            self.scene, self.camera, self.sun, settings, outputs=("shadow_maps", "moments"),
            points=points, point_normals=np.tile([0.0, 1.0, 0.0], (len(points), 1)),
        )  # fmt: skip
        assert (frame.point_cascade == 0).all()
        return frame.point_visibility.astype(np.float64), frame


def lit_share(frame, points, depth):
    """Share of the kernel, as blurred and looked up, whose depths are at or behind `depth`."""
    settings = frame.settings
    behind = (frame.shadow_maps[0] >= depth)[..., None].astype(np.float64)
    if settings.filter_size > 1:
        half = moment_oracle.half_widths(frame, 0)
        behind = moment_oracle.blur(behind, settings.filter_weights, half)
    texels = small_scenes.texels_of(frame.cascades, 0, points)[:, :2]
    return moment_oracle.looked_up(behind, texels)[:, 0]


def noise(settings, depth, gap):
    """How much rounding may take off a bound v / (v + d^2) of a receiver with no surface nearer to
    its depth than `gap`: v + d^2 = E (t - z)^2 >= gap^2, so dp/dv <= 1 / gap^2, dp/dm <= 1/gap."""
    off = moment_oracle.least_variance(settings), moment_oracle.mean_rounding(settings)
    if settings.filter == "esm":  # Markov: a share of the power
        exponent = moment_oracle.exponents(settings)[0]
        return np.expm1(exponent * (off[1] + 2 * U)) + 1e-5
    if settings.filter.startswith("evsm"):
        # in units of the larger of receiver and mean; a mean behind the receiver is lit anyway
        positive, negative = moment_oracle.exponents(settings)
        gap = -np.expm1(-2.0 * min(positive, negative) * gap)
        u = moment_oracle.rounding(settings) * moment_oracle.roundings(settings)
        return 2.0 * (off[0] / gap**2 + 2.0 * u / gap) + 1e-5
    length = 1.0
    if settings.filter == "lvsm":
        own = min(int(depth * settings.layer_count), settings.layer_count - 1)
        begin, end = moment_oracle.layer_ends(settings, own)
        gap, length = min(gap, depth - begin), end - begin
    return off[0] * (length / gap) ** 2 + 2.0 * off[1] / gap + 1e-5


# -- V1 --------------------------------------------------------------------------------------------

STACKS = {
    "flat": ((0.5,), ()),
    "two layers": ((0.2, 0.5), (0.0,)),
    "far behind": ((0.3, 0.97), (0.0,)),
    "three layers": ((0.2, 0.35, 0.5), (-6.0, 6.0)),
}


RECEIVERS = (0.1, 0.28, 0.42, 0.6, 0.9)
RANGES = {
    "flat": (1.0, 65),
    "two layers": (1e4, 33),
    "far behind": (1e2, 9),
    "three layers": (1e3, 65),
}


def check_bound(figure, renderer, name, moment_format, stack, span, filter_size):
    depths, cuts = STACKS[stack]
    layers = Layers(depths, cuts, span)
    changes = {"filter_size": filter_size, "moment_format": moment_format, **FILTERS[name]}
    points = [layers.points(receiver) for receiver in RECEIVERS]
    every, frame = layers.lit(renderer, np.concatenate(points), **changes)
    wrong = np.count_nonzero(~((every >= 0.0) & (every <= 1.0)))
    figure("V1", f"no visibility, {moment_format}", wrong, 0, "points")
    assert np.isfinite(frame.moments).all()
    for receiver, there, lit in zip(RECEIVERS, points, np.split(every, len(points)), strict=True):
        gap = np.abs(frame.shadow_maps[0] - receiver).min()
        missing = (lit_share(frame, there, receiver) - lit).max()
        allowed = noise(frame.settings, receiver, gap)
        figure(
            "V1", f"darker than the lit share, {name}, {moment_format}", missing / allowed, 1,
            "of what rounding allows",
        )  # fmt: skip
        if receiver < min(depths):
            assert (lit == 1.0).all()


@pytest.mark.parametrize(("name", "moment_format"), FORMATS)
def test_v1_no_darker_than_the_share_that_is_lit(figure, renderer, name, moment_format):
    for stack, (span, filter_size) in RANGES.items():
        check_bound(figure, renderer, name, moment_format, stack, span, filter_size)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "moment_format"), FORMATS)
@pytest.mark.parametrize("stack", STACKS)
def test_v1_full_ranges(figure, renderer, stack, name, moment_format):
    for span in (1.0, 1e2, 1e4):
        for filter_size in (9, 33, 65):
            check_bound(figure, renderer, name, moment_format, stack, span, filter_size)


FLAT = [(0.03, 1.0, 9), (0.26, 1e2, 65), (0.5, 1e4, 1), (0.74, 1e3, 9), (0.98, 1e4, 65)]


@pytest.mark.parametrize(("name", "moment_format"), FORMATS)
def test_v1_a_flat_receiver_stays_lit(figure, renderer, name, moment_format):
    # To the bit, at every depth of the range and under every kernel, with the automatic bias.
    for depth, span, filter_size in FLAT:
        layers = Layers((depth,), (), span)
        changes = {"filter_size": filter_size, "moment_format": moment_format, **FILTERS[name]}
        lit, _ = layers.lit(renderer, layers.points(depth, 41), bias="auto", **changes)
        figure("V1", f"flat receiver in shadow, {moment_format}", (lit != 1.0).mean(), 0, "share")


@pytest.mark.parametrize(("name", "moment_format"), FORMATS)
def test_v1_a_tilted_receiver_stays_lit(figure, renderer, name, moment_format):
    worst = 0.0
    for slope in SLOPES:
        for azimuth in AZIMUTHS[1:2] if moment_format == "unorm16" else AZIMUTHS[1:]:
            changes = {"filter_size": 9, "moment_format": moment_format, **FILTERS[name]}
            worst = max(worst, Plane(slope, azimuth).acne(renderer, **changes))
    figure("V1", f"tilted receiver in shadow, {name}, {moment_format}", worst, 0, "share")


def test_a_tilted_receiver_needs_what_it_is_given(renderer):
    # evsm4 without the receiver's plane darkens a slope by itself: the negative warp bends down.
    plane = Plane(5.0, 45.0)
    manual = {"filter": "evsm4", "filter_size": 9, "bias": "manual", "slope_bias": 0.25}
    assert plane.acne(renderer, **manual, receiver_plane=False) > 0.9
    assert plane.acne(renderer, **manual, receiver_plane=True) == 0.0
    # 16 bits without the rounding of their mean in the bias darken flat ground at some depth.
    darkest = 1.0
    for depth in (0.2003, 0.3001, 0.7001, 0.8003):
        layers = Layers((depth,), ())
        changes = {"filter": "vsm", "moment_format": "float16", "bias": "manual"}
        darkest = min(darkest, layers.lit(renderer, layers.points(depth, 5), **changes)[0].min())
    assert darkest < 1.0


# -- V2 --------------------------------------------------------------------------------------------


def two_occluders(first, second, receiver, filter_name, share=0.5, exponent=40.0, layer=(0.4, 1.0)):
    """Light that exact moments let through two occluders, in doubles."""
    warp = {
        "vsm": lambda z: z,
        "lvsm": lambda z: np.clip((z - layer[0]) / (layer[1] - layer[0]), 0.0, 1.0),
        "evsm": lambda z: np.exp(exponent * z),
    }[filter_name]
    values, receiver = warp(np.array([first, second])), warp(np.float64(receiver))
    weights = np.array([share, 1.0 - share])
    mean = weights @ values
    variance = weights @ (values - mean) ** 2
    return float(moment_oracle.chebyshev(receiver, mean, variance + mean**2, 0.0))


def test_v2_closed_forms(figure):
    # SPEC: occluders at .2 and .5, receiver at .9, half the kernel each.
    expected = {"vsm": 0.069, "lvsm": 0.012, "evsm": 3e-15}
    for name, value in expected.items():
        off = abs(two_occluders(0.2, 0.5, 0.9, name) / value - 1.0)
        figure("V2", f"leak by closed form, {name}", off, 0.2, "relative")
    for share in np.linspace(0.05, 0.95, 19):
        leaks = [two_occluders(0.2, 0.5, 0.9, name, share) for name in ("vsm", "lvsm", "evsm")]
        assert leaks[0] > leaks[1] > leaks[2] > 0.0
    # Permuted: what is behind the receiver is lit, and every bound lets that through.
    for name in expected:
        assert two_occluders(0.2, 0.9, 0.5, name) >= 0.5
        assert two_occluders(0.5, 0.9, 0.2, name) == 1.0


def middle(layers):
    """One point where the kernel sees both sheets alike: on the line between two texels."""
    return np.array([[0.0, layers.y_of(0.9), 0.013]])


def test_v2_rendered(figure, renderer):
    layers = Layers((0.2, 0.5))
    kernel = {"filter_size": 33}

    def leak(**changes):
        return float(layers.lit(renderer, middle(layers), **kernel, **changes)[0][0])

    vsm = leak(filter="vsm")
    figure("V2", "leak rendered, vsm", abs(vsm / 0.069 - 1.0), 0.2, "relative")
    # a share of 33 texels: the line is half a texel beside the middle at most
    assert vsm == pytest.approx(two_occluders(0.2, 0.5, 0.9, "vsm"), abs=0.004)
    lvsm = leak(filter="lvsm", layer_count=4)  # its last layer begins at .625, behind both
    evsm = leak(filter="evsm2", exponent=20.0)  # of -1 to 1: 40 of 0 to 1
    floor = {
        name: moment_oracle.least_variance(layers.settings.replace(filter=name, **kernel))
        for name in ("lvsm", "evsm2")
    }
    assert lvsm <= floor["lvsm"] / (0.275 / 0.375) ** 2 * 1.01
    assert evsm <= floor["evsm2"] * 1.01
    assert leak(filter="evsm4", exponent=20.0) <= evsm
    # ESM lets half of exp(40 (.5 - .9)) through.
    esm = leak(filter="esm", exponent=40.0)
    assert esm == pytest.approx(0.5 * np.exp(-16.0), rel=0.1)


@pytest.mark.parametrize("occluders", [(0.1, 0.6), (0.6, 0.1), (0.2, 0.3), (0.15, 0.7)])
def test_v2_permuted_occluders_rendered(figure, renderer, occluders):
    layers = Layers(occluders)
    leaks = {}
    for name, changes in {
        "vsm": {}, "lvsm": {"layer_count": 2}, "evsm2": {}, "evsm4": {},
    }.items():  # fmt: skip
        lit, _ = layers.lit(
            renderer, middle(layers), filter=name, filter_size=33, filter_weights="box", **changes
        )
        leaks[name] = float(lit[0])
    assert leaks["vsm"] > leaks["lvsm"] > leaks["evsm2"] >= leaks["evsm4"]
    exact = {
        "vsm": two_occluders(*occluders, 0.9, "vsm"),
        "lvsm": two_occluders(*occluders, 0.9, "lvsm", layer=(0.25, 1.0)),
    }
    for name, value in exact.items():
        figure("V2", f"leak rendered, {name}", abs(leaks[name] / value - 1.0), 0.2, "relative")


@pytest.mark.parametrize("name", ["vsm", "lvsm", "evsm2", "evsm4"])
def test_v2_what_lies_behind_is_let_through(renderer, name):
    # The receiver between both: half of the kernel is lit, and a bound of two depths is exact.
    layers = Layers((0.2, 0.7))
    points = middle(layers)
    points[:, 1] = layers.y_of(0.6)
    lit, frame = layers.lit(renderer, points, filter=name, filter_size=33)
    assert lit[0] >= lit_share(frame, points, 0.6)[0] - noise(frame.settings, 0.6, 0.1)
    points[:, 1] = layers.y_of(0.1)
    assert layers.lit(renderer, points, filter=name, filter_size=33)[0][0] == 1.0


@pytest.mark.parametrize("moment_format", ["float32", "unorm16"])
@pytest.mark.parametrize("layer_count", [2, 4, 8])
def test_layers_leave_no_line_of_light(renderer, layer_count, moment_format):
    # A receiver just where its layer begins is not taken for the occluders that are cut off there.
    layers = Layers((0.02,), ())
    depths = np.linspace(0.15, 1.0, 2000)
    points = np.tile(layers.points(0.5, 1), (len(depths), 1))
    points[:, 1] = layers.y_of(depths)
    changes = {"filter": "lvsm", "layer_count": layer_count, "moment_format": moment_format}
    lit, frame = layers.lit(renderer, points, filter_size=5, **changes)
    # at least half a part of the range before the receiver, or all of .13, in a layer of two parts
    nearest = min(0.25, 0.13 / min(2.0 / layer_count, 0.75))
    least = moment_oracle.least_variance(frame.settings)
    assert lit.max() <= least / (least + nearest**2) * 1.02


# -- bleeding reduced ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["vsm", "lvsm", "evsm4"])
def test_reducing_bleeding_darkens_and_no_more(renderer, name):
    layers = Layers((0.3, 0.6))
    changes = {"filter": name, "filter_size": 17, "layer_count": 2}
    if name == "evsm4":
        changes["exponent"] = 2.0  # so weak that light bleeds
    points = layers.points(0.68, reach=0.5)

    def lit(**more):
        return layers.lit(renderer, points, **changes, **more)[0]

    plain = lit()
    assert 0.0 < plain.max() < 1.0
    before = plain
    for step in (0.05, 0.2, 0.5, 0.99):
        here = lit(bleed_step=step)
        np.testing.assert_allclose(
            here, np.clip((plain - step) / (1.0 - step), 0.0, 1.0), atol=4 * U / (1.0 - step)
        )
        assert (here <= before).all()
        before = here
    assert (before == 0.0).all()
    before = plain
    for power in (1.5, 2.0, 8.0):
        here = lit(bleed_power=power)
        np.testing.assert_allclose(here, plain**power, atol=64 * U)
        assert (here <= before).all()
        before = here
    both = lit(bleed_step=0.1, bleed_power=2.0)
    np.testing.assert_allclose(both, np.clip((plain - 0.1) / 0.9, 0, 1) ** 2, atol=64 * U)
    lit_point = layers.points(0.1, 5)
    assert (layers.lit(renderer, lit_point, **changes, bleed_step=0.5)[0] == 1.0).all()
