"""Footprints and cascades of the quads that two cascades share (docs/numerics.md 29; Q1 and Q2 of
16): by hardware derivatives, by one index for the quad, and in light space."""

import itertools

import numpy as np
import probes
import pytest
import small_scenes
import stripes

import csm
from csm import shapes

TO_LIGHT = (0.4, 1.0, 0.3)
NONE = 255
ODD = (101, 75)


@pytest.fixture(scope="module")
def probe(tmp_path_factory):
    """Renderer whose filters answer with what they were given."""
    with csm.Renderer(shader_dir=probes.folder(tmp_path_factory.mktemp("probe"))) as renderer:
        yield renderer


@pytest.fixture(scope="module")
def fragments():
    """Renderer whose passes over pixels are fragments."""
    with csm.Renderer(stage="fragment") as renderer:
        yield renderer


# -- Q1: one index for a quad ----------------------------------------------------------------------


def rule(quad, fine=True):
    """[Zhang2009] 4.1.6 corrected: log2 of the largest difference of powers of two, where any."""
    power = 2.0**quad
    dx, dy = np.abs(np.diff(power, axis=1)), np.abs(np.diff(power, axis=0))
    if not fine:  # one difference for the whole quad, from its first row and column
        dx, dy = dx[:1].repeat(2, axis=0), dy[:, :1].repeat(2, axis=1)
    dx, dy = dx.repeat(2, axis=1), dy.repeat(2, axis=0)
    dxy = np.abs(np.diff(dy, axis=1)).repeat(2, axis=1)
    largest = np.maximum(dxy, np.maximum(dx, dy))
    return np.where(largest > 0, np.floor(np.log2(np.maximum(largest, 0.5))), quad)  # an int


def all_quads(count):
    return [np.array(q).reshape(2, 2) for q in itertools.product(range(count), repeat=4)]


def test_q1_the_rule_needs_fine_derivatives_and_adjacent_indices(figure):
    """All 256 quads of four cascades: what the corrected rule does, and what it cannot."""
    adjacent = [q for q in all_quads(4) if np.ptp(q) <= 1]
    missed = sum((rule(q) != q.min()).any() for q in adjacent)
    figure("Q1", "quads of adjacent indices that fine derivatives miss", missed, 0, "quads")
    two_levels = all_quads(2)
    coarse = [q for q in two_levels if (rule(q, fine=False) != q.min()).any()]
    assert len(coarse) == 2, "coarse derivatives do not see the fourth pixel"
    apart = [q for q in all_quads(4) if np.ptp(q) >= 2]
    assert len(apart) == 210
    inconsistent = [q for q in apart if np.ptp(rule(q)) > 0]
    assert len(inconsistent) == 40, "a difference of such powers is no power"


def quads_of(values):
    """(n, 4) values of the whole quads of a picture; GL counts rows from below."""
    height, width = values.shape[0] // 2 * 2, values.shape[1] // 2 * 2
    upwards = values[::-1][:height, :width]
    return upwards.reshape(height // 2, 2, width // 2, 2).swapaxes(1, 2).reshape(-1, 4)


def holding(frame, quads_points, radius):
    """(cascades, n, 4) texels by which each map holds the points of quads with its kernel."""
    held = []
    for i in range(frame.cascades.count):
        place = small_scenes.texels_of(frame.cascades, i, quads_points)
        size = frame.cascades.map_size[i]
        inside = np.minimum(place[..., :2], size - place[..., :2]).min(axis=-1) - radius
        in_range = np.minimum(place[..., 2], 1.0 - place[..., 2])
        held.append(np.where(in_range >= 0.0, inside, -np.inf))
    return np.array(held)


@pytest.mark.parametrize("select", ["map", "interval", "frustum"])
@pytest.mark.parametrize("size", [ODD, (64, 64), (1, 3)])
@pytest.mark.parametrize("scene", ["soup", "stairs"])
def test_q1_a_quad_takes_one_map_that_holds_it(renderer, figure, scene, size, select):
    """Of the pixels' own maps the finest that holds the quad, else the coarsest."""
    settings = csm.ShadowSettings(
        cascade_count=3, map_size=192, filter="vsm", filter_size=1, lookup="trilinear",
        select=select, split="uniform", fit="box",
    )  # fmt: skip
    view = small_scenes.camera(0, size=size)
    arguments = (small_scenes.SCENES[scene](), view, csm.Sun(TO_LIGHT))
    outputs = ("mask", "valid", "view_depth", "cascade_index")
    own = renderer.render(*arguments, settings, outputs=outputs)
    shared = renderer.render(*arguments, settings.replace(gradients="quad"), outputs=outputs)
    assert np.isfinite(shared.mask).all()
    assert ((own.cascade_index == NONE) == (shared.cascade_index == NONE)).all()

    before, after = quads_of(own.cascade_index), quads_of(shared.cascade_index)
    counted = before != NONE
    low = np.where(counted, before, 99).min(axis=-1, initial=99)
    high = np.where(counted, before.astype(int), -1).max(axis=-1, initial=-1)
    mixed = low < high
    if size == ODD:
        assert mixed.sum() >= 10, "the picture has seams"
    low, high, after, counted = low[mixed], high[mixed], after[mixed].astype(int), counted[mixed]
    points = small_scenes.positions_of(own)
    points = np.stack([quads_of(points[..., axis])[mixed] for axis in range(3)], axis=-1)
    radius = 0 if select == "frustum" else 24
    depth = np.where(counted, holding(own, points, radius), np.inf).min(axis=-1)  # (cascades, n)
    tolerance = 1e-3  # texels: float32 of positions some 20 m from the origin
    row = np.arange(len(low))
    wanted = np.where(depth[low, row] >= 0, low, np.where(depth[high, row] >= 0, high, -1))
    near = (np.abs(depth[[low, high], row]) < tolerance).any(axis=0)
    for_all = np.where(counted, after, wanted[:, None])
    judged = (wanted >= 0) & ~near
    wrong = (for_all != wanted[:, None]).any(axis=-1) & judged
    figure("Q1", f"quads of more than one index, select {select}", wrong.sum(), 0, "quads")
    outside = depth[for_all[judged, 0], row[judged]]
    figure("Q1", "texels of a quad outside its map", -outside.min(initial=0.0), 0.0, "texels")
    # where neither map holds the quad, every pixel keeps its own
    kept = (after == before[mixed]) | ~counted
    assert kept[(wanted < 0) & ~near].all()
    if size == ODD and select == "map":
        assert judged.mean() > 0.5


# -- Q2: footprints --------------------------------------------------------------------------------


VIEWS = {
    "walking": csm.Camera.look_at(
        (3, 6, 5), (1, 0, -20), fov_y_deg=50, near=0.5, far=150, size=ODD
    ),
    "rolled": csm.Camera.look_at(
        (0, 9, 0), (6, 0, -9), (1, 2, 0), fov_y_deg=70, near=0.5, far=150, size=ODD
    ),
    "orthographic": csm.Camera.orthographic(
        (0, 20, 20), (0, 0, 0), height=30, near=1, far=80, size=ODD
    ),
}  # fmt: skip


def cosines(view):
    """(h, w) between the ray of each pixel and the normal of the ground."""
    column, row = probes.centres(view)
    if view.orthographic:
        return np.full(row.shape, -view.backward[1])
    rays = probes.ground_points(view, column, row) - view.eye
    return rays[..., 1] / np.linalg.norm(rays, axis=-1)


def footprints(probe, view, **changes):
    """Steps (h, w, 2, 2) of every pixel, exact ones by central differences, the frame."""
    scene = csm.Scene.from_arrays(*shapes.ground(400.0))
    base = {
        "filter": "vsm", "filter_size": 1, "map_size": 512, "lookup": "trilinear",
        "cascade_count": 3, "fit": "box", "split": "logarithmic",
    }  # fmt: skip
    settings = csm.ShadowSettings(**base | changes)
    outputs = ("mask", "cascade_index")
    steps, frame = probes.ask_footprint(probe, scene, view, TO_LIGHT, settings, outputs=outputs)
    column, row = probes.centres(view)
    index = frame.cascade_index

    def texels(dx, dy):
        points = probes.ground_points(view, column + dx, row - dy)
        return probes.texels_of(frame.cascades, index, points)

    h = 1e-4  # pixels: error h^2 of the third derivative, and 1e-13 / h of rounding
    exact = np.stack([texels(h, 0) - texels(-h, 0), texels(0, h) - texels(0, -h)], axis=-2) / (
        2 * h
    )
    return steps, exact, frame


def level(steps):
    """Trilinear level of a footprint, before it is cut at 0."""
    return np.log2(np.linalg.norm(steps, axis=-1).max(axis=-1))


def at_seams(frame):
    """Pixels of quads with more than one cascade, none of which leaves the range."""
    index = frame.cascade_index.astype(int)
    size = frame.camera.size
    mixed, inside = np.zeros(index.shape, bool), index != NONE
    for along_y in (False, True):
        row, column = probes.quad_partner(size, along_y)
        there = (row >= 0) & (column < size[0])
        other = index[np.where(there, row, 0), np.where(there, column, 0)]
        mixed |= there & (other != index)
        inside &= there & (other != NONE)
    return mixed & inside


@pytest.mark.parametrize(
    "warp",
    ["none", "lispsm", *(pytest.param(w, marks=pytest.mark.slow) for w in ("psm", "tsm"))],
)
@pytest.mark.parametrize("view", VIEWS)
def test_q2_analytic_steps_are_central_differences(probe, figure, view, warp):
    steps, exact, frame = footprints(probe, VIEWS[view], gradients="analytic", warp=warp)
    # longer ones are cut, and below a thousandth of a texel the float32 map has no digits
    longest = np.linalg.norm(exact, axis=-1).max(axis=-1)
    own = (frame.cascade_index != NONE) & (longest < 500)
    assert own.mean() > 0.3
    error = np.linalg.norm(steps - exact, axis=(-1, -2)) / np.linalg.norm(exact, axis=(-1, -2))
    # a warp adds some ten roundings of its divisor and its bend, and float32 directions of rays
    # lose digits against the ground as the cosine between them
    tolerance = 1e-6 if warp == "none" else 3e-6
    towards = np.abs(cosines(VIEWS[view]))
    steep = own & (towards > 0.25)
    figure("Q2", f"analytic steps, {warp}", error[steep].max(), tolerance, "relative")
    assert (error * towards)[own].max() < 6e-7


@pytest.mark.parametrize("warp", ["none", "lispsm"])
@pytest.mark.parametrize("far", [20.0, 1e4])
def test_q2_levels_do_not_jump_at_seams(probe, figure, warp, far):
    """Analytic and quad levels are those of one map at every seam; the hardware's are not."""
    scale = far / 150.0
    view = csm.Camera.look_at(
        (3 * scale, 6 * scale, 5 * scale), (scale, 0, -20 * scale), fov_y_deg=50,
        near=0.5 * scale, far=far, size=ODD,
    )  # fmt: skip
    jump = {}
    for gradients in ("hardware", "quad", "analytic"):
        steps, exact, frame = footprints(probe, view, gradients=gradients, warp=warp)
        own = at_seams(frame) if gradients != "quad" else frame.cascade_index != NONE
        if gradients == "quad":
            own &= at_seams(footprints(probe, view, gradients="hardware", warp=warp)[2])
        if gradients != "analytic":  # differences over the quad, in the pixel's map
            column, row = probes.centres(view)
            here = probes.ground_points(view, column, row)
            away = []
            for along_y in (False, True):
                other_row, other_column = probes.quad_partner(view.size, along_y)
                there = probes.ground_points(view, other_column + 0.5, other_row + 0.5)
                away.append(
                    probes.texels_of(frame.cascades, frame.cascade_index, there)
                    - probes.texels_of(frame.cascades, frame.cascade_index, here)
                )
            exact = np.stack(away, axis=-2)
        longest = np.linalg.norm(exact, axis=-1).max(axis=-1)
        own &= longest < 500
        assert own.sum() >= 20
        jump[gradients] = np.abs(level(steps) - level(exact))[own].max()
    figure("Q2", f"level at seams, analytic, {warp}", jump["analytic"], 0.01, "levels")
    figure("Q2", f"level at seams, quad, {warp}", jump["quad"], 0.01, "levels")
    assert jump["hardware"] > 1.0, "the seam that the others close"


def test_q2_footprints_of_turned_windows(probe):
    """A window turned against light space turns its steps, too."""
    steps, exact, frame = footprints(
        probe, VIEWS["walking"], gradients="analytic", fit="visible", turned=True
    )
    own = frame.cascade_index != NONE
    error = np.linalg.norm(steps - exact, axis=(-1, -2)) / np.linalg.norm(exact, axis=(-1, -2))
    own &= np.linalg.norm(exact, axis=-1).max(axis=-1) < 500
    assert (error * np.abs(cosines(VIEWS["walking"])))[own].max() < 6e-7, "as without a turn"


# -- the seam in the picture -----------------------------------------------------------------------


def seam(frame):
    """Mean difference of visibility between neighbours of different cascades."""
    differences = []
    index = frame.cascade_index.astype(int)
    for axis in (0, 1):
        a, b = index[:-1, :] if axis == 0 else index[:, :-1], np.delete(index, 0, axis)
        across = (a != b) & (a != NONE) & (b != NONE)
        differences.append(np.abs(np.diff(frame.mask, axis=axis))[across])
    return float(np.concatenate(differences).mean())


@pytest.mark.parametrize("lookup", ["trilinear", "anisotropic"])
def test_the_seam_is_there_and_goes_away(renderer, figure, lookup):
    """Light of pixels in quads of two cascades, against the share of each that lies in the sun."""
    view = csm.Camera.look_at(
        (0, 2, 8), (0, 0, 2), (0.2, 1, 0), fov_y_deg=40, near=0.3, far=30, size=(240, 136)
    )
    base = csm.ShadowSettings(
        filter="vsm", filter_size=1, map_size=1024, lookup=lookup, split="manual",
        manual_splits=(5, 8, 12), fit="box", select="interval",
    )  # fmt: skip
    scene, sun = stripes.striped(), csm.Sun((0.3, 1, 0.1))
    frames = {
        gradients: renderer.render(scene, view, sun, base.replace(gradients=gradients))
        for gradients in ("hardware", "quad", "analytic")
    }
    truth = stripes.stripe_share(view, sun.to_light)
    own = at_seams(frames["hardware"]) & (frames["hardware"].view_depth < 10)
    assert own.sum() > 100
    off = {name: np.abs(frame.mask - truth)[own].mean() for name, frame in frames.items()}
    picture = np.concatenate(
        [np.round(255 * frame.mask).astype(np.uint8) for frame in frames.values()]
    )
    share = {"trilinear": 0.9, "anisotropic": 0.3}[lookup]
    for name in ("quad", "analytic"):
        figure("Q2", f"error at seams, {name}, {lookup}", off[name] / off["hardware"], share,
               "of the hardware's", picture)  # fmt: skip
    if lookup == "trilinear":  # sharper stripes differ more from pixel to pixel than a seam does
        jump = {name: seam(frame) for name, frame in frames.items()}
        assert max(jump["quad"], jump["analytic"]) < 0.95 * jump["hardware"]
    # away from seams the three agree about how much light there is
    assert np.ptp([frame.mask.mean() for frame in frames.values()]) < 2e-3


# -- stages and points -----------------------------------------------------------------------------


@pytest.mark.parametrize("gradients", ["hardware", "quad", "analytic"])
@pytest.mark.parametrize(
    "more",
    [
        {"lookup": "trilinear"},
        {"lookup": "anisotropic", "blend": "linear"},
        pytest.param(
            {"lookup": "trilinear", "warp": "lispsm", "blend": "dither"}, marks=pytest.mark.slow
        ),
    ],
    ids=["trilinear", "anisotropic, blended", "warped, dithered"],
)
def test_stages_give_the_same_bits(renderer, fragments, gradients, more):
    settings = csm.ShadowSettings(
        filter="vsm", map_size=256, cascade_count=2, gradients=gradients, **more
    )
    frames = []
    for one in (renderer, fragments):
        arguments = (small_scenes.soup(), small_scenes.camera(0, size=ODD), csm.Sun(TO_LIGHT))
        frames.append(one.render(*arguments, settings))
    assert (frames[0].cascade_index == frames[1].cascade_index).all()
    assert (frames[0].mask == frames[1].mask).all()
    assert np.isfinite(frames[0].mask).all()


@pytest.mark.parametrize("gradients", ["hardware", "quad", "analytic"])
def test_vertices_give_the_steps_of_positions(renderer, gradients):
    """Coordinates from vertices: neighbours are those of the view, whatever draws the pixel."""
    settings = csm.ShadowSettings(
        filter="vsm", map_size=256, lookup="trilinear", gradients=gradients
    )
    arguments = (csm.scenes.plane_and_box(), small_scenes.camera(0), csm.Sun(TO_LIGHT))
    by_position = renderer.render(*arguments, settings)
    by_vertex = renderer.render(*arguments, settings.replace(texcoord="interpolated"))
    same = by_position.cascade_index == by_vertex.cascade_index
    assert same.mean() > 0.999
    # coordinates agree to 0.05 texel (T1): a twentieth of a penumbra of a texel
    assert np.abs(by_position.mask - by_vertex.mask)[same].max() < 0.05


def test_points_have_no_footprint(probe):
    """A point is looked up at full size: no pixel says how far its neighbours are."""
    points = np.array([[0.0, 0.0, -5.0], [2.0, 0.0, -30.0]])
    scene = csm.Scene.from_arrays(*shapes.ground(400.0))
    for gradients in ("hardware", "quad", "analytic"):
        settings = csm.ShadowSettings(
            filter="vsm", map_size=64, cascade_count=2, lookup="trilinear", gradients=gradients
        )
        for what in probes.FOOTPRINT:
            frame = probes.ask(
                probe, what, scene, VIEWS["walking"], TO_LIGHT, settings,
                outputs=(), points=points,
            )  # fmt: skip
            assert (frame.point_visibility == 0.0).all()


# -- off is absent ---------------------------------------------------------------------------------


def test_gradients_mean_nothing_without_levels():
    """Without smaller levels nobody looks at a neighbour: the same programs, for all three."""
    for base in (
        csm.ShadowSettings(),
        csm.ShadowSettings(filter="vsm"),
        csm.ShadowSettings(filter="esm", lookup="trilinear", log_filter=True),
    ):
        plans = [
            csm.plan(base.replace(gradients=gradients))
            for gradients in ("hardware", "quad", "analytic")
        ]
        assert plans[0] == plans[1] == plans[2]
    one = csm.ShadowSettings(filter="vsm", lookup="trilinear", cascade_count=1)
    assert csm.plan(one) == csm.plan(one.replace(gradients="quad"))
    assert csm.plan(one) != csm.plan(one.replace(gradients="analytic"))


def test_planes_from_derivatives_leave_footprints_analytic(renderer):
    """Planes are from the quad, footprints from the pixel's own plane, all the same: at an edge of
    depth, where the quad's steps run over it, analytic footprints stay what they are beside planes
    from normals. (They once became those of the quad, to the bit.)"""
    scene = csm.scenes.plane_and_box()
    camera = csm.Camera.look_at((-6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=60, size=(96, 64))
    # one cascade: the steps of hardware are those of quad
    settings = csm.ShadowSettings(map_size=256, cascade_count=1, filter="evsm4", lookup="trilinear")
    masks = {
        (gradients, plane): renderer.render(
            scene, camera, scene.suns["morning"],
            settings.replace(gradients=gradients, plane=plane), outputs=("mask",),
        ).mask
        for gradients in ("hardware", "analytic") for plane in ("normal", "derivatives")
    }  # fmt: skip
    analytic = masks["analytic", "derivatives"]

    def differing(other):
        return np.count_nonzero(np.abs(analytic - masks[other]) > 0.01)

    # measured 10 pixels, where the plane of a quad is none, against 35
    assert 2 * differing(("analytic", "normal")) < differing(("hardware", "derivatives"))
