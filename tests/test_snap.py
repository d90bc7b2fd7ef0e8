"""Exact stabilisation: the texel grid stays where it is in the world, in x, y and in depth (X1 and
D3 of docs/numerics.md 16)."""

import itertools

import drawings
import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st
from views import scene_of, turned

import csm
from csm import _core, spaces

EXACT, NONE = 0, 1
SIZES = [64, 255, 256, 1024, 4096]
PADDINGS = [0, 1, 3, 7]
PATHS = ["walk", "turn", "creep"]


def suns():
    """Six along the axes, twenty at random."""
    rng = np.random.default_rng(20)
    axes = [sign * row for row in np.eye(3) for sign in (1.0, -1.0)]
    return [csm.Sun(direction) for direction in [*axes, *rng.normal(size=(20, 3))]]


def settings_for(size, padding, **changes):
    return csm.ShadowSettings(
        map_size=size, cascade_count=2, view_range="camera",
        filter="pcf" if padding else "hard", filter_size=2 * padding + 1 if padding else 3,
        **changes,
    )  # fmt: skip


def path_of(kind, steps, texel, rng):
    """Cameras of a random walk, a pure rotation, a creep of 1e-4 texels per frame."""
    camera = turned(rng, fov=50, near=0.5, far=60, eye=rng.normal(size=3) * 100)
    heading = rng.normal(size=3)
    heading /= np.linalg.norm(heading)
    for _ in range(steps):
        yield camera
        if kind == "walk":
            camera = camera.translated(rng.normal(size=3))
        if kind == "creep":
            camera = camera.translated(1e-4 * texel * heading)
        else:
            axes = oracles.random_rotation(rng)
            camera = camera.replace(right=axes[0], up=axes[1], backward=axes[2])


def draw_drift(axes, drifts):
    """How far a point has moved within its texel since the first frame, (frames, cascades, 2)."""
    for i in range(drifts.shape[1]):
        axes.plot(drifts[:, i], label=[f"cascade {i}, {axis}" for axis in "uv"])
    axes.set(xlabel="frame", ylabel="texels since the first frame")
    axes.legend(fontsize=8)


def check_path(figure, kind, size, padding, sun, fit, steps, rng):
    off_lattice = drift = 0.0  # in roundings of their distance
    sizes_changed = 0
    drifts = []
    settings = settings_for(size, padding, fit=fit)
    points = rng.uniform(-200, 200, size=(2000, 3))
    texel = phase = None
    for camera in path_of(kind, steps, 0.05, rng):
        cascades = csm.fit_cascades(camera, sun, settings)
        if texel is None:
            texel = cascades.texel_size
        sizes_changed += not np.array_equal(cascades.texel_size, texel)
        scale = cascades.clip_from_light[:, [0, 1], [0, 1]]
        corner = (-1 - cascades.clip_from_light[:, :2, 3]) / scale
        texels_off = np.abs(corner).max() / texel.min() + size
        off = np.abs(corner / texel - cascades.lattice).max()
        off_lattice = max(off_lattice, off / (2.0**-52 * texels_off))
        # The place of fixed points within their texels: u * S counts from the window's corner, the
        # lattice from the world's origin.
        places = np.stack(
            [spaces.transform_points(m, points)[:, :2] * size for m in cascades.uvz_from_world]
        )
        places += cascades.lattice[:, None, :]
        if phase is None:
            phase = places
        reach = (np.abs(points).max() * 2 + np.abs(corner).max()) / texel.min() + size
        drift = max(drift, np.abs(places - phase).max() / (2.0**-52 * reach))
        drifts.append((places - phase)[:, 0])
    # To the bit; N is the distance from the world's origin in texels.
    figure("X1", "steps with another texel size", sizes_changed, 0, "frames")
    figure("X1", "window's corner from whole texels", off_lattice, 8, "N 2^-52 texels")
    figure(
        "X1", "phase of fixed points", drift, 8, "N 2^-52 texels",
        picture=lambda: drawings.chart(
            lambda axes: draw_drift(axes, np.array(drifts)), title=f"{kind}, {fit}, map {size}"
        ),
    )  # fmt: skip


@pytest.mark.parametrize("kind", PATHS)
@pytest.mark.parametrize("fit", ["sphere", "diameter"])
def test_x1_a_moving_camera_leaves_the_texel_grid_in_place(figure, kind, fit):
    rng = np.random.default_rng(21)
    for number, sun in enumerate(suns()):
        size, padding = SIZES[number % len(SIZES)], PADDINGS[number % len(PADDINGS)]
        check_path(figure, kind, size, padding, sun, fit, 40, rng)


@pytest.mark.slow
@pytest.mark.parametrize("kind", PATHS)
@pytest.mark.parametrize(("size", "padding"), list(itertools.product(SIZES, PADDINGS)))
def test_x1_thousand_steps(figure, kind, size, padding):
    rng = np.random.default_rng(22)
    every = suns()
    for sun in (every[size % 6], every[6 + padding]):
        check_path(figure, kind, size, padding, sun, "sphere", 1000, rng)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("number", range(26))
def test_x1_thousand_steps_under_every_sun(figure, number):
    rng = np.random.default_rng(220 + number)
    for kind, fit in itertools.product(PATHS, ("sphere", "diameter")):
        check_path(figure, kind, 1024, 1, suns()[number], fit, 1000, rng)


@pytest.mark.parametrize("distance", [0.0, 1e2, 1e4, 1e6])
def test_x1_phase_in_float32(figure, distance):
    """As a shader has it: positions and matrix in float32. From the world's origin the phase of a
    fixed point may move by a rounding of its distance; relative to a near point that is fixed to
    the world, with the lattice kept as integers, it stays."""
    rng = np.random.default_rng(24)
    origin = np.round(rng.normal(size=3) * distance)
    local = rng.uniform(-8, 8, size=(500, 3)).astype(np.float32)
    settings, sun = settings_for(1024, 1), csm.Sun((0.4, 0.8, 0.3))
    camera = turned(rng, near=0.5, far=20.0, eye=origin)
    world_phase, local_phase = [], []
    for _ in range(200):
        camera = camera.translated(rng.normal(size=3) * 0.1)
        cascades = csm.fit_cascades(camera, sun, settings)
        matrix = cascades.uvz_from_world[0]
        shift = np.eye(4)
        shift[:3, 3] = origin
        points = (local + origin).astype(np.float32)
        for phases, m, p in (
            (world_phase, matrix, points),
            (local_phase, matrix @ shift, local),
        ):
            m = m.astype(np.float32)
            at = (p @ m[:2, :3].T + m[:2, 3]) * np.float32(1024) + cascades.lattice[0]
            phases.append(at.astype(np.float64))
        texels_off_origin = np.abs(points / cascades.texel_size[0, 0]).max()
    # N * 2^-23, N being the distance from the world's origin in texels.
    moved = [np.abs(np.array(each) - each[0]).max() for each in (world_phase, local_phase)]
    bound = max(1e-3, texels_off_origin * 2.0**-23)
    figure("X1", "phase in float32 from the world's origin", moved[0], bound, "texels")
    figure("X1", "phase in float32 from a near point", moved[1], 1e-3, "texels")


def test_x1_a_box_fit_keeps_its_texels_while_the_camera_only_moves(figure):
    rng = np.random.default_rng(23)
    settings = settings_for(512, 0, fit="box")
    camera, sun = turned(rng), csm.Sun((1, 2, 3))
    sizes = [
        csm.fit_cascades(camera.translated(rng.normal(size=3) * 1e3), sun, settings).texel_size
        for _ in range(50)
    ]
    figure("X1", "texel size of a box under translation", np.ptp(sizes, axis=0).max(), 0, "m")


def test_x1_without_snapping_the_grid_does_move():
    # What the tests above would see if snapping did nothing.
    rng = np.random.default_rng(24)
    settings = settings_for(256, 0, snap="none")
    camera, sun = turned(rng), csm.Sun((1, 2, 3))
    places = []
    for _ in range(20):
        cascades = csm.fit_cascades(camera.translated(rng.normal(size=3)), sun, settings)
        assert not cascades.lattice.any()
        places.append(cascades.uvz_from_world[0, :2, 3] * 256 % 1.0)
    assert np.ptp(places, axis=0).min() > 0.5


def test_rounding_of_the_range_is_the_only_change_of_texel_size():
    scene = scene_of([[-300, 0, -300], [300, 20, 300]])
    rng = np.random.default_rng(25)
    held, sizes, steps = None, [], []
    sun, settings = csm.Sun((1, 2, 3)), csm.ShadowSettings()
    for _ in range(300):
        camera = turned(rng, near=0.1, far=2000, eye=rng.uniform(-200, 200, 3) * [1, 0, 1] + 3)
        cascades = csm.fit_cascades(camera, sun, settings, scene=scene, held=held)
        held = cascades
        sizes.append(tuple(cascades.texel_size[:, 0]))
        steps.append(held.range_step)
    assert len(set(steps)) > 3
    assert len(set(sizes)) == len(set(steps))


# -------------------------------------------------------------------------------------------------
# Depth (docs/numerics.md 8): with pancaking the range moves, by whole quanta


@pytest.mark.parametrize("depth_format", ["d16", "d24"])
@pytest.mark.parametrize("extent", [10.0, pytest.param(300.0, marks=pytest.mark.slow), 1e4])
def test_d3_decoded_depth_of_static_points_is_constant(figure, depth_format, extent):
    levels = {"d16": 2**16 - 1, "d24": 2**24 - 1}[depth_format]
    rng = np.random.default_rng(26)
    settings = csm.ShadowSettings(
        pancake=True, depth_format=depth_format, cascade_count=2, view_range="camera"
    )
    scene = scene_of([[-9 * extent] * 3, [9 * extent] * 3])
    points = rng.uniform(-extent / 20, extent / 20, size=(500, 3))
    camera = turned(rng, near=0.01 * extent, far=extent)
    first = spans = None
    moved, changed, off_steps = set(), 0, 0.0
    steps_taken = []
    for _ in range(200):
        camera = camera.translated(rng.normal(size=3) * extent / 200)
        cascades = csm.fit_cascades(camera, csm.Sun((1, 2, 3)), settings, scene=scene)
        z_scale = -cascades.clip_from_light[:, 2, 2]
        if spans is None:
            spans = 1 / z_scale
        assert np.array_equal(1 / z_scale, spans)
        # Near is a whole number of steps of 1/255 of the span, each a whole number of quanta.
        near_steps = cascades.depth_range[:, 0] / spans * 255
        off_steps = max(off_steps, np.abs(near_steps - np.round(near_steps)).max())
        near_quanta = int(np.round(near_steps[1])) * (levels // 255)
        moved.add(near_quanta)
        steps_taken.append(near_steps[1])
        z = spaces.transform_points(cascades.clip_from_world[1], points)[:, 2] * levels
        # In the world: stored number plus the quanta of near. Points within 1e-4 quanta of a
        # rounding boundary are left out: there the last bit of a double decides.
        decided = np.abs(z % 1.0 - 0.5) > 1e-4
        decoded = np.where(decided, np.round(z) + near_quanta, np.nan)
        if first is None:
            first = decoded
        both = ~np.isnan(first) & ~np.isnan(decoded)
        assert both.mean() > 0.99
        changed += np.count_nonzero(decoded[both] != first[both])
    assert len(moved) > 3
    figure("D3", "near from whole 1/255 of the span", off_steps, 1e-9, "steps")
    figure(
        "D3", "decoded depths that changed", changed, 0, "points",
        picture=lambda: drawings.chart(
            lambda axes: axes.plot(steps_taken, ".-"), title="near of the range [1/255 of its span]"
        ),
    )  # fmt: skip


# -------------------------------------------------------------------------------------------------
# The window (docs/numerics.md 7)


@given(
    centre=st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)),
    half=st.tuples(st.floats(1e-2, 1e4), st.floats(1e-2, 1e4)),
    size=st.integers(17, 5000),
    padding=st.integers(0, 7),
    snap=st.sampled_from([EXACT, NONE]),
)
def test_a_padded_window_keeps_its_content_inside(centre, half, size, padding, snap):
    corner, texel, lattice = _core.snap_window(centre, half, size, padding, snap)
    centre, half = np.array(centre), np.array(half)
    spent = 2 * padding + (1 if snap == EXACT else 0)
    np.testing.assert_allclose(texel * (size - spent), 2 * half, rtol=1e-15)
    # Rounded in units of the texel, at the distance of the window: a few parts in 2^52 of it.
    slack = 8 * 2.0**-52 * (np.abs(centre) + half + size * texel)
    assert (corner + padding * texel <= centre - half + slack).all()
    assert (corner + (size - padding) * texel >= centre + half - slack).all()
    if snap == EXACT:
        assert lattice.dtype == np.int64
        assert np.array_equal(corner, lattice * texel)
    else:
        assert lattice.tolist() == [0, 0]
        np.testing.assert_allclose(corner + size / 2 * texel, centre, atol=slack.max())


def test_unit_of_snapping_is_one_texel_and_the_corner_is_snapped():
    # 2H/S, not R/S (the listing of [Zhang2009]). 8 texels of 1 m, one for
    # rounding: a window of half extent 3.5 m.
    for size in (8, 9):
        half = (size - 1) / 2
        starts = []
        for centre in np.linspace(-2, 2, 41):
            corner, texel, lattice = _core.snap_window((centre, 0), (half, half), size, 0, EXACT)
            assert texel.tolist() == [1.0, 1.0]
            assert corner[0] == lattice[0] == np.round(corner[0])
            starts.append(corner[0])
        assert set(np.diff(starts)) == {0.0, 1.0}


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (((0, 0), (1, 1), 3, 1, EXACT), "map_size must be > 3 for a kernel radius of 1 texels"),
        (((0, 0), (1, 1), 2, 1, NONE), "map_size must be > 2 .* with snap none .got 2"),
        (((0, 0), (0, 1), 64, 0, EXACT), "extent > 0 .got centre 0, half extent 0"),
        (((1e18, 0), (1, 1), 64, 0, EXACT), "more than 2.53 texels from the world origin"),
        (((0, 0), (1, 1), 64, -1, EXACT), "kernel radius of -1"),
    ],
)
def test_impossible_windows_are_refused(arguments, text):
    with pytest.raises(ValueError, match=text):
        _core.snap_window(*arguments)
