"""What windows make of a view: the core's loops against plain Python, point by point."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

import csm
from csm import _core
from csm.arrangements import LEFT_OUT, narrowest
from csm.caster_load import Casters
from csm.outlines import convex_hull
from csm.sampling import surface_steps, uv_gradients
from csm.spaces import light_gradients

# Sums of thousands of doubles of one sign, each rounded: 1e-12 of them is far more than that.
CLOSE = dict(rel=1e-12, abs=1e-12)
SUN = csm.Sun((0.5, 1.0, 0.3))
BIAS, STEEPEST, MOST = 0.25, 4.0, 300.0


def in_order(camera, points):
    """Points in the order of view depth."""
    return points[np.argsort((points - camera.eye) @ -camera.backward)]


def seen(seed, receivers=60, edges=40, others=25, orthographic=False):
    """What a camera may see, as a `csm.signals.View` has it; normals and ways across of edges."""
    rng = np.random.default_rng(seed)
    eye, target = (0.0, 6.0, 20.0), (1.0, 0.0, 0.0)
    make = csm.Camera.orthographic if orthographic else csm.Camera.look_at
    camera = make(eye, target, **({"height": 12.0} if orthographic else {}), near=0.5, far=80.0)
    count = receivers + edges + others
    depth = rng.uniform(1.0, 60.0, (count, 1))
    aside = rng.uniform(-0.7, 0.7, (count, 2)) * (8.0 if orthographic else depth)
    points = camera.eye - depth * camera.backward + aside @ np.stack([camera.right, camera.up])
    kinds = np.split(points, [receivers, receivers + edges])
    points = np.concatenate([in_order(camera, some) for some in kinds])
    normals = SUN.to_light + rng.normal(scale=0.4, size=(edges, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    angle = rng.uniform(0.0, 2.0 * np.pi, edges)
    across, axes = np.stack([np.cos(angle), np.sin(angle)], axis=1), light_gradients(SUN)
    at = points[receivers : receivers + edges]
    view = SimpleNamespace(
        camera=camera,
        sun=SUN,
        held=points,
        held_depths=(points - camera.eye) @ -camera.backward,
        gradients=rng.uniform(0, 8, receivers),
        edge_lengths=rng.uniform(0, 3, edges),
        axes=axes,
        steps_across=np.einsum("ea,eak->ek", across, surface_steps(camera, at, normals, axes)),
    )
    return view, normals, across


def points_told(view, cascades, select):
    """What the core says of every point, and the windows' longer sides [m]."""
    sides = cascades.texel_size.max(axis=1) * cascades.map_size
    return _core.arranged_points(
        view, cascades.uvz_from_world, cascades.splits, sides, select == "interval", BIAS, STEEPEST
    ), sides


def place(matrix, point):
    """(u, v) of a point on a map."""
    at = np.asarray(matrix) @ np.append(point, 1.0)
    return at[:2] / at[3]


def chosen(camera, cascades, select, point):
    """Which cascade answers, by the definition, and whose slice holds the point."""
    depth = float((point - camera.eye) @ -camera.backward)
    last = cascades.count - 1
    slices = [i for i in range(last) if depth <= cascades.splits[i + 1]] + [last]
    if select == "interval":
        return slices[0], slices[0]
    inside = (
        i for i in range(last) if all(0.0 <= x <= 1.0 for x in place(cascades.uvz_from_world[i],
                                                                      point))
    )  # fmt: skip
    return next(inside, last), slices[0]


CASES = [
    (count, select, changes, orthographic)
    for count, select, (changes, orthographic) in itertools.product(
        (1, 3),
        ("map", "interval"),
        (({}, False), ({"turned": True}, False), ({"warp": "lispsm"}, False), ({}, True)),
    )
]


@pytest.mark.parametrize(("count", "select", "changes", "orthographic"), CASES)
def test_a_view_is_arranged_as_its_definition_says(count, select, changes, orthographic):
    view, normals, across = seen(7, orthographic=orthographic)
    settings = csm.ShadowSettings(
        cascade_count=count, fit="visible", snap="none", split="uniform", **changes
    )
    camera, points, gradients, lengths = view.camera, view.held, view.gradients, view.edge_lengths
    # fitted to some of the points, so that others lie outside of every map
    cascades = csm.fit_cascades(camera, SUN, settings, receivers=points[::2])
    told, sides = points_told(view, cascades, select)
    moved, reach, edge_cascade, bias, receiver_cascade = told
    m, e = len(gradients), len(lengths)
    both = [chosen(camera, cascades, select, point) for point in points]
    taken = np.array([one for one, _ in both])
    assert edge_cascade.tolist() == taken[m : m + e].tolist()
    assert receiver_cascade.tolist() == taken[:m].tolist()
    assert count == 1 or len(set(taken[:m])) > 1, "nothing to choose between"
    for k in range(m):
        wanted = BIAS * sides[taken[k]] * min(gradients[k], STEEPEST)
        assert bias[k] == pytest.approx(wanted, **CLOSE)
    uvz = np.asarray(cascades.uvz_from_world)
    for k in range(e):
        at = slice(m + k, m + k + 1)
        slopes = uv_gradients(uvz[taken[at]], points[at])
        # the way across the edge, taken back to the map by duals of its own gradients
        steps = surface_steps(camera, points[at], normals[k : k + 1], slopes)[0]
        u, v = np.abs(across[k] @ steps)
        mean = max(u, v) / 4.0 + min(u, v) ** 2 / (12.0 * max(u, v))
        # those gradients are rounded across the light, and divided by the way across the edge
        assert moved[k] == pytest.approx(mean, rel=1e-9)
        assert reach[k] == pytest.approx(math.hypot(u, v), rel=1e-9)
    assert (gradients > STEEPEST).any()


@pytest.mark.parametrize(("count", "select", "changes", "orthographic"), CASES)
def test_windows_are_those_of_a_fit_and_sums_those_of_points(count, select, changes, orthographic):
    view, _, _ = seen(11, orthographic=orthographic)
    settings = csm.ShadowSettings(
        cascade_count=count, fit="visible", snap="none", split="sdsm", select=select, **changes
    )
    # the same fit of points in no order, whose depths the core works out
    shuffled = np.random.default_rng(1).permutation(view.held)
    cascades = csm.fit_cascades(view.camera, SUN, settings, receivers=shuffled)
    (moved, _, edge_cascade, *_), wanted = points_told(view, cascades, select)
    most = float(np.median(moved))  # half of them end there
    uvz, splits, sides, displaced, held = _core.arrange(view, settings, None, None, most)
    # depths were rounded on another way
    assert splits == pytest.approx(cascades.splits, rel=1e-14)
    assert uvz == pytest.approx(cascades.uvz_from_world, rel=1e-9, abs=1e-9)
    assert sides == pytest.approx(wanted, rel=1e-9)
    sums = np.bincount(edge_cascade, view.edge_lengths * np.minimum(moved, most), minlength=count)
    assert displaced == pytest.approx(sums, rel=1e-9)
    slices = np.searchsorted(splits[1:-1], view.held_depths)
    assert held == [i in slices for i in range(count)]


def test_what_lies_on_a_split_belongs_before_it():
    """And receivers at the near and the far end of a camera's range are in it."""
    depths = np.array([1.0, 5.0, 5.0, 12.0, 20.0])  # whole, so that no step rounds
    view = square_view(np.ones((len(depths), 2)), np.ones(len(depths)))
    view.held, view.held_depths = np.stack([0.0 * depths, 10.0 - depths, 0.0 * depths], 1), depths
    settings = csm.ShadowSettings(
        cascade_count=3, fit="visible", snap="none", split="manual", manual_splits=(5.0, 12.0)
    )
    cascades = csm.fit_cascades(view.camera, view.sun, settings, receivers=view.held)
    _, _, taken, _, _ = points_told(view, cascades, "interval")[0]
    assert taken.tolist() == [0, 0, 0, 1, 2]
    assert _core.arrange(view, settings, None, None, MOST)[-1] == [True, True, True]
    by_seen = csm.ShadowSettings(cascade_count=1, fit="visible", snap="none", split="sdsm")
    for receivers in (view.held, view.held[::-1]):
        seen = csm.fit_cascades(view.camera, view.sun, by_seen, receivers=receivers)
        assert seen.splits.tolist() == [1.0, 20.0]
    assert _core.arrange(view, by_seen, None, None, MOST)[1].tolist() == [1.0, 20.0]


def smallest_area(points):
    """Of all rectangles round points in a plane: one has a side along an edge of their hull."""
    hull = convex_hull(points)
    along = np.roll(hull, -1, axis=0) - hull
    along /= np.linalg.norm(along, axis=1)[:, None]
    across = along @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    return min(
        np.ptp(points @ one) * np.ptp(points @ two) for one, two in zip(along, across, strict=True)
    )


@pytest.mark.parametrize("count", [3, 5, 31, 32, 33, 40, 64, 255, 256, 257, 900])
@pytest.mark.parametrize("kind", ["noise", "disc", "grid", "strip"])
def test_turned_windows_are_the_smallest_rectangles(count, kind):
    """However many points there are to leave out before the hull."""
    rng = np.random.default_rng(count)
    at = rng.uniform(-5.0, 5.0, (count, 2))
    if kind == "disc":
        at *= (5.0 / np.linalg.norm(at, axis=1))[:, None]
    elif kind == "grid":
        at = np.round(at)
    elif kind == "strip":
        at = at @ np.array([[0.8, 0.6], [-0.06, 0.08]])
    at[:3] = (-5.0, -1.0), (4.0, 2.0), (1.0, -3.0)  # not all on a line
    camera = csm.Camera.orthographic(
        (0, 10, 0), (0, 0, 0), up=(0, 0, -1), height=30.0, near=1.0, far=20.0, size=(30, 30)
    )
    points = np.stack([at[:, 0], 0.0 * at[:, 0], at[:, 1]], axis=1)
    settings = csm.ShadowSettings(
        cascade_count=1, fit="visible", snap="none", split="uniform", turned=True
    )
    cascades = csm.fit_cascades(camera, csm.Sun((0, 1, 0)), settings, receivers=points)
    area = np.prod(cascades.texel_size[0] * cascades.map_size[0])
    # a texel and the rounding of float32 are left round it
    assert area == pytest.approx(smallest_area(at), rel=5e-3)


def test_a_slice_without_points_is_not_held():
    view, _, _ = seen(5)
    settings = csm.ShadowSettings(
        cascade_count=3, snap="none", split="manual", manual_splits=(61.0, 70.0)
    )
    assert _core.arrange(view, settings, None, None, MOST)[-1] == [True, False, False]


@pytest.mark.parametrize(
    ("receivers", "edges", "others"), [(0, 0, 4), (5, 0, 0), (0, 5, 0), (0, 0, 0)]
)
def test_a_view_may_lack_points(receivers, edges, others):
    view, _, _ = seen(3, receivers, edges, others)
    settings = csm.ShadowSettings(cascade_count=2, snap="none", split="uniform")
    cascades = csm.fit_cascades(view.camera, SUN, settings)
    told, _ = points_told(view, cascades, "map")
    assert [one.shape for one in told] == [(edges,)] * 3 + [(receivers,)] * 2
    *_, displaced, held = _core.arrange(view, settings, None, None, MOST)
    assert any(held) == (len(view.held) > 0)
    assert edges or displaced == [0.0, 0.0]


def square_view(steps, lengths):
    """Straight down, one metre a pixel; edges in the middle with these ways across."""
    camera = csm.Camera.orthographic(
        (0, 10, 0), (0, 0, 0), up=(0, 0, -1), height=100.0, near=1.0, far=20.0, size=(100, 100)
    )
    count = len(lengths)
    return SimpleNamespace(
        camera=camera, sun=csm.Sun((0, 1, 0)), held=np.zeros((count, 3)),
        held_depths=np.full(count, 10.0), gradients=np.zeros(0), edge_lengths=np.array(lengths),
        axes=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), steps_across=np.array(steps),
    )  # fmt: skip


def test_a_square_window_moves_an_edge_by_a_quarter_of_it():
    """A closed form. An edge along an axis is displaced by a quarter of the window, a diagonal one
    by sqrt(2) / 6 of it; a disc as wide reaches all of it."""
    side = 8.0
    uvz = np.array([[[1 / side, 0, 0, 0.5], [0, 0, -1 / side, 0.5], [0, -0.1, 0, 1], [0, 0, 0, 1]]])
    view = square_view([[1.0, 0.0], [0.0, -1.0], [np.sqrt(0.5), np.sqrt(0.5)]], [1.0, 2.0, 3.0])
    moved, reach, *_ = _core.arranged_points(view, uvz, [1.0, 20.0], [side], False, BIAS, STEEPEST)
    quarter, diagonal = side / 4.0, side * np.sqrt(2.0) / 6.0
    assert moved == pytest.approx([quarter, quarter, diagonal], **CLOSE)
    assert reach == pytest.approx([side] * 3, **CLOSE)


def test_sums_of_many_edges_are_whole():
    """More edges than are summed up at once, and a rest: a fit round the view is 100 m a side."""
    count = 1000
    lengths = np.arange(1.0, count + 1.0)
    view = square_view(np.tile([[0.0, 1.0]], (count, 1)), lengths)
    settings = csm.ShadowSettings(
        cascade_count=1, fit="sphere", snap="none", split="uniform", map_size=512
    )
    _, _, (side,), (displaced,), held = _core.arrange(view, settings, None, None, 1e9)
    assert displaced == pytest.approx(0.25 * side * lengths.sum(), **CLOSE)
    assert held == [True]


WRONG = {
    "held": (np.zeros((4, 3)), "held must begin with the points of 3 gradients and 2 lengths"),
    "held_depths": (np.zeros(5), "held_depths: expected shape \\(6,\\), got \\(5,\\)"),
    "steps_across": (np.zeros((3, 2)), "steps_across: expected shape \\(2, 2\\), got \\(3, 2\\)"),
    "splits": ([1.0, 2.0, 3.0], "splits: expected 2 numbers, got 3"),
    "sides": ([1.0, 2.0], "sides: expected 1 numbers, got 2"),
    "axes": (np.eye(2), "axes: expected 6 numbers, got 4"),
    "uvz": (np.zeros((9, 4, 4)), "uvz_from_world must be 1 to 8 matrices"),
}


@pytest.mark.parametrize("name", [*WRONG, "flat"])
def test_arrays_that_do_not_fit_are_refused(name):
    view = dict(
        held=np.zeros((6, 3)), held_depths=np.zeros(6), gradients=np.zeros(3),
        axes=np.eye(3)[:2], steps_across=np.ones((2, 2)), edge_lengths=np.ones(2),
    )  # fmt: skip
    windows = dict(uvz=np.eye(4)[None], splits=[1.0, 9.0], sides=[1.0])

    def ask():
        _core.arranged_points(SimpleNamespace(**view), *windows.values(), False, 1.0, 1.0)

    ask()
    flat = (np.diag([1.0, 0.0, 1.0, 1.0])[None], "map the plane across the light to an area")
    wrong, text = WRONG.get(name, flat)
    (view if name in view else windows)["uvz" if name == "flat" else name] = wrong
    if name == "held":
        view["held_depths"] = np.zeros(4)
    with pytest.raises(ValueError, match=text):
        ask()


# -- sums, a number a size -------------------------------------------------------------------------

SIDES = {
    "equal": np.array([[200.0], [317.0], [4096.0]]),
    "unequal": np.array([[200.0, 300.0, 150.0], [4096.0, 256.0, 1000.0]]),
    "one": np.array([[512.0, 256.0, 128.0]]),
    "none": np.zeros((0, 3)),
}


def points_of_maps(seed=5, count=200):
    rng = np.random.default_rng(seed)
    window = rng.integers(0, 3, count).astype(np.int32)
    values, other, weights = (
        rng.uniform(0, 4000, count),
        rng.uniform(0, 9, count),
        rng.uniform(0, 2, count),
    )
    return window, values, other, weights


@pytest.mark.parametrize("sides", SIDES)
def test_sums_are_those_of_every_point_under_every_size(sides):
    window, values, other, weights = points_of_maps()
    gaps = np.where(other > 7.0, np.inf, other)
    sides, capped, missing, less = SIDES[sides], [], [], []
    for row in sides:
        side = [row[i] if len(row) > 1 else row[0] for i in window]
        every = list(zip(values, side, other, weights, gaps, strict=True))
        capped.append(sum(w * min(x / s, 6.0) for x, s, _, w, _ in every))
        missing.append(sum(w * max(o - x / s, 0.0) for x, s, o, w, _ in every))
        less.append(sum(g < x / s for x, s, _, _, g in every))
    assert _core.sum_capped(window, sides, values, weights, 6.0) == pytest.approx(capped, **CLOSE)
    assert _core.sum_missing(window, sides, values, other, weights) == pytest.approx(
        missing, **CLOSE
    )
    assert _core.count_less(window, sides, gaps, values).tolist() == less
    assert not len(sides) or (max(less) > 0 and max(values / 200.0) > 6.0)


@pytest.mark.parametrize("columns", [1, 3])
def test_sums_of_a_size_hang_on_no_other_size(columns):
    """To the bit: a candidate is judged as settings of its own are."""
    window, values, other, weights = points_of_maps()
    sides = np.random.default_rng(columns).uniform(150.0, 4096.0, (17, columns))
    for call, given in (
        (_core.sum_capped, (values, weights, 6.0)),
        (_core.sum_missing, (values, other, weights)),
        (_core.count_less, (other, values)),
    ):
        together = call(window, sides, *given)
        assert [call(window, row, *given) for row in sides] == together.tolist()
        assert [call(window, row[None], *given)[0] for row in sides] == together.tolist()
        assert len(set(together.tolist())) > 5


def test_sums_over_nothing_are_nothing():
    none, sides = np.zeros(0), SIDES["equal"]
    window = none.astype(np.int32)
    assert _core.sum_capped(window, sides, none, none, 1.0).tolist() == [0.0] * 3
    assert _core.sum_missing(window, sides, none, none, none).tolist() == [0.0] * 3
    assert _core.count_less(window, sides, none, none).tolist() == [0] * 3
    assert _core.least_part(none, none, none, 0.0) == 0.0


@pytest.mark.parametrize("index", [-1, 3])
def test_a_window_that_no_column_has_is_refused(index):
    window, values, other, weights = points_of_maps()
    window[17] = index
    for call, given in (
        (_core.sum_capped, (values, weights, 1.0)),
        (_core.sum_missing, (values, other, weights)),
        (_core.count_less, (other, values)),
    ):
        with pytest.raises(ValueError, match=f"window must be 0 to 2.*got {index} at 17"):
            call(window, SIDES["unequal"], *given)
        call(window, SIDES["equal"], *given)  # one column is every window's


def test_sums_of_other_lengths_are_refused():
    window, values, other, weights = points_of_maps()
    sides = SIDES["equal"]
    with pytest.raises(ValueError, match="window: expected shape \\(200,\\), got \\(199,\\)"):
        _core.sum_capped(window[1:], sides, values, weights, 1.0)
    with pytest.raises(ValueError, match="weights: expected shape \\(200,\\), got \\(199,\\)"):
        _core.sum_missing(window, sides, values, other, weights[1:])
    with pytest.raises(ValueError, match="gaps: expected shape \\(200,\\), got \\(199,\\)"):
        _core.count_less(window, sides, other[1:], values)
    with pytest.raises(ValueError, match="wide: expected shape \\(200,\\), got \\(199,\\)"):
        _core.least_part(values, other[1:], weights, 0.0)
    with pytest.raises(ValueError, match="allowed must be >= 0"):
        _core.least_part(values, other, weights, -1.0)
    with pytest.raises(ValueError, match="sides must have a column"):
        _core.count_less(window, np.zeros((2, 0)), other, values)


@pytest.mark.parametrize("share", [0.0, 1e-6, 0.05, 0.7, 1.0, 2.0])
def test_the_least_part_leaves_out_what_is_allowed(share):
    _, values, wide, weights = points_of_maps()
    values[:3] = 0.0, 1e-15, 1e-9
    wide[:3] = 0.0, 0.0, 1e-6
    allowed = share * float(weights @ wide)
    part = _core.least_part(values, wide, weights, allowed)

    def left(q):
        return float((weights * np.maximum(wide - q * values, 0.0)).sum())

    if share >= 1.0:
        assert part == 0.0
        return
    assert left(part * (1.0 + 1e-12)) <= allowed * (1.0 + 1e-9) + 1e-12
    assert left(part * (1.0 - 1e-6)) > allowed


def test_the_narrowest_kernel_of_one_edge_and_of_two():
    """Of one edge that is as wide as all of the map: all but a twentieth. Of two of one width, of
    which one reaches twice as far, so that it ends first: 2 w - 3 q r = w / 10."""
    one = np.ones(1)
    assert narrowest(one, one, one) == pytest.approx(1.0 - LEFT_OUT, **CLOSE)
    reach, wide = np.array([2.0, 1.0]), np.ones(2)
    # q = 0.5 is where the first ends: the other leaves half; from there on 1 - q = 0.1
    assert narrowest(reach, wide, wide) == pytest.approx(1.0 - 2.0 * LEFT_OUT, **CLOSE)
    assert narrowest(reach, np.zeros(2), wide) == 0.0


# -- windows, and the casters over them ------------------------------------------------------------


@pytest.mark.parametrize("changes", [{}, {"turned": True}, {"split": "sdsm", "turned": True}])
def test_each_window_lies_close_round_the_points_of_its_slice(changes):
    """However many cascades there are, and whatever turn each has of its own."""
    view, _, _ = seen(11, receivers=900)
    camera, points = view.camera, view.held
    settings = csm.ShadowSettings(
        cascade_count=3, fit="visible", snap="none", **{"split": "uniform", **changes}
    )
    cascades = csm.fit_cascades(camera, SUN, settings, receivers=points)
    depths = (points - camera.eye) @ -camera.backward
    slices = np.searchsorted(cascades.splits[1:-1], depths)
    axes = np.asarray(cascades.light_from_world)[:, 0, :3]
    turns = np.abs(np.cross(axes[0], axes[1:])).max(axis=1)
    assert ("turned" in changes) == (turns > 0.01).all()
    for i in range(3):
        uv = np.array([place(cascades.uvz_from_world[i], point) for point in points[slices == i]])
        # room for the rounding of float32, a millionth of what is seen, on either side
        assert uv.min(axis=0) == pytest.approx([0.0, 0.0], abs=1e-4)
        assert uv.max(axis=0) == pytest.approx([1.0, 1.0], abs=1e-4)
        assert uv.min() >= 0.0
        assert uv.max() <= 1.0


def test_casters_are_classed_by_the_first_map_that_their_box_meets():
    view, _, _ = seen(11)
    camera, points = view.camera, view.held
    settings = csm.ShadowSettings(cascade_count=3, fit="visible", snap="none", split="uniform")
    cascades = csm.fit_cascades(camera, SUN, settings, receivers=points)
    rng, axes = np.random.default_rng(2), light_gradients(SUN)
    centre, half = rng.uniform(-60, 60, (400, 2)), rng.uniform(0, 3, (400, 2))
    count = len(centre)
    wanted = []
    for at, reach in zip(centre, half, strict=True):
        corners = [(at + reach * sign) @ axes for sign in itertools.product((-1, 1), repeat=2)]
        meets = []
        for uvz in cascades.uvz_from_world:
            uv = np.array([place(uvz, corner) for corner in corners])
            meets.append(bool((uv.max(axis=0) > 0.0).all() and (uv.min(axis=0) < 1.0).all()))
        wanted.append(meets.index(True) if any(meets) else 3)
    assert set(wanted) == {0, 1, 2, 3}
    # of classes of so few all are kept, class by class
    assert max(wanted.count(kind) for kind in range(4)) <= 300
    casters = Casters(axes, centre, half, np.ones(count), np.zeros(count, bool), np.ones(count))
    kept, _ = _core.casters_thinned(casters, cascades.uvz_from_world)
    assert kept.tolist() == sorted(range(count), key=lambda k: (wanted[k], k))


@pytest.mark.parametrize("count", [0, 1, 300])
def test_casters_load_maps_by_the_parts_of_their_boxes(count):
    """Against each box and map by itself; some boxes are seen edge on, some touch a map's border
    from without, some lie on it. Their maps are squares of 2, 4 and 8 m, one within the other."""
    rng, axes = np.random.default_rng(count), np.eye(3)[:2]
    centre = rng.choice([-5.0, -1.5, -0.5, 0.0, 0.5, 1.0, 1.5, 3.0], (count, 2))
    centre[::3] += rng.uniform(-0.5, 0.5, (len(centre[::3]), 2))
    half = rng.choice([0.0, 0.25, 0.5, 1.0], (count, 2))
    area, cut = rng.normal(size=count), rng.random(count) < 0.4
    weight = rng.uniform(1.0, 3.0, count)
    maps = np.stack([np.diag([1 / side, 1 / side, 1.0, 1.0]) for side in (2.0, 4.0, 8.0)])
    maps[:, :2, 3] = 0.5
    layers, lines = np.zeros((3, 2, 2)), np.zeros((3, 2, 2))
    triangles, needed = np.zeros(3), np.zeros(3)
    for k in range(count):
        earlier = False
        for i, side in enumerate((2.0, 4.0, 8.0)):
            low = np.maximum(centre[k] - half[k], -side / 2)
            part = np.minimum(centre[k] + half[k], side / 2) - low
            if (part < 0.0).any() or ((part == 0.0) & (half[k] > 0.0)).any():
                continue
            wide = half[k] > 0.0
            share = (part[wide] / (2.0 * half[k][wide])).prod()
            kind = int(area[k] < 0.0), int(cut[k])
            layers[i][kind] += weight[k] * share * abs(area[k]) / side**2
            lines[i][kind] += weight[k] * 2.0 * np.hypot(*part) / side
            triangles[i] += weight[k]
            needed[i] += 0.0 if earlier else weight[k]
            earlier |= np.allclose(part, 2.0 * half[k], rtol=1e-9, atol=0.0)
    casters = Casters(axes, centre, half, area, cut, weight)
    found = _core.casters_load(casters, maps)
    for got, wanted in zip(found, (layers, lines, triangles, needed), strict=True):
        assert got == pytest.approx(wanted, **CLOSE)
    assert count < 300 or (needed[1:] < triangles[1:]).all()


def test_casters_that_do_not_fit_are_refused():
    none = np.zeros((2, 2))
    casters = Casters(np.eye(3)[:2], none, none, np.ones(3), np.zeros(2, bool), np.ones(2))
    for call in (_core.casters_load, _core.casters_thinned):
        with pytest.raises(ValueError, match=r"area: expected shape \(2,\), got \(3,\)"):
            call(casters, np.eye(4)[None])
        with pytest.raises(ValueError, match="uvz_from_world must be 1 to 8 matrices"):
            call(casters, np.zeros((0, 4, 4)))
