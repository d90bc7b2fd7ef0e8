"""The light's axes: orthonormal and right-handed for every direction; no direction is refused."""

import drawings
import numpy as np
import pytest

import csm
from csm import _core

TOLERANCE = 5e-15  # products of three rounded unit components, a few roundings each


def errors_of(to_light):
    """The rotation; how far its rows are from orthonormal, from right-handed, from the light."""
    basis = _core.light_basis(to_light)
    rotation = basis[:3, :3]
    scaled = np.asarray(to_light, np.longdouble)
    scaled = scaled / np.abs(scaled).max()
    direction = (scaled / np.sqrt((scaled * scaled).sum())).astype(np.float64)
    assert np.array_equal(basis[3], [0, 0, 0, 1])
    assert np.array_equal(basis[:3, 3], [0, 0, 0])
    return rotation, (
        np.abs(rotation @ rotation.T - np.eye(3)).max(),
        np.abs(np.cross(rotation[0], rotation[1]) - rotation[2]).max(),
        np.abs(rotation[2] - direction).max(),
    )


def check(to_light):
    rotation, (skew, turned_over, aside) = errors_of(to_light)
    assert skew <= TOLERANCE
    assert turned_over <= TOLERANCE
    assert aside <= 4 * 2.0**-53
    return rotation


def draw_errors(axes, errors):
    """Errors of (n, 3) in the order of `errors_of`, as shares of the directions."""
    shares = (np.arange(len(errors)) + 0.5) / len(errors)
    for column, name in zip(errors.T, ("orthonormal", "right-handed", "light"), strict=True):
        axes.step(np.sort(column), shares, label=f"from {name}")
    axes.axvline(TOLERANCE, color="r")
    axes.set(xlabel="error", ylabel="share of the directions")
    axes.legend()


def record(figure, directions):
    """The worst of many directions."""
    errors = np.array([errors_of(each)[1] for each in directions])
    skew, turned_over, aside = errors.max(axis=0)
    figure(
        "B1", "axes from orthonormal", skew, TOLERANCE,
        picture=lambda: drawings.chart(lambda axes: draw_errors(axes, errors)),
    )  # fmt: skip
    figure("B1", "axes from right-handed", turned_over, TOLERANCE)
    figure("B1", "third axis from the light", aside, 4 * 2.0**-53)


AXES = [tuple(sign * row) for row in np.eye(3) for sign in (1.0, -1.0)]


@pytest.mark.parametrize("axis", AXES)
def test_b1_along_an_axis(figure, axis):
    record(figure, [axis])
    rotation = check(axis)
    # Along an axis the other two axes are axes as well, to the bit.
    assert set(np.abs(rotation).ravel().tolist()) == {0.0, 1.0}


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("power", range(1, 17))
def test_b1_near_an_axis(figure, axis, power):
    tilts = [sign * 10.0**-power * tilt for tilt in np.eye(3) for sign in (1.0, -1.0)]
    record(figure, [np.asarray(axis) + tilt for tilt in tilts])


def test_axes_are_those_of_the_shortest_turn():
    # The formula of Duff et al. is the shortest rotation from +z, or from -z where z < 0, to the
    # light, applied to x and y; written here by Rodrigues. From -z, y comes out mirrored.
    rng = np.random.default_rng(0)
    for direction in rng.normal(size=(500, 3)):
        to_light = direction / np.linalg.norm(direction)
        start = np.array([0.0, 0.0, np.copysign(1.0, to_light[2])])
        x, y, z = np.cross(start, to_light)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = np.eye(3) + cross + cross @ cross / (1 + start @ to_light)
        expected = np.stack([turn[:, 0], start[2] * turn[:, 1], to_light])
        np.testing.assert_allclose(_core.light_basis(direction)[:3, :3], expected, atol=TOLERANCE)


@pytest.mark.parametrize("count", [5000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_b1_random_directions(figure, count):
    record(figure, np.random.default_rng(1).normal(size=(count, 3)))


@pytest.mark.parametrize("scale", [5e-324, 1e-310, 1e-160, 1e160, 1e308])
def test_b1_any_length_gives_the_same_axes(figure, scale):
    record(figure, [np.array([1.0, -1.0, 1.0]) * scale])
    direction = np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(
        check(direction * scale), check(direction), rtol=0, atol=4 * 2.0**-53
    )


def test_matrix_is_indexed_row_column_with_column_major_memory():
    basis = _core.light_basis((0.3, 0.8, 0.2))
    assert basis.strides == (8, 32)
    np.testing.assert_allclose(basis[:3, :3] @ basis[2, :3], [0, 0, 1], atol=TOLERANCE)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_b1_the_axes_turn_with_the_light_over_the_zenith(figure, side):
    # The one discontinuity is at z = 0-/0+ (docs/numerics.md 6). On either side of it the steepest
    # entry is 1 - x^2 / (1 + |z|), whose gradient (2x, x^2) is at most sqrt(5) long: 3 steps
    # with rounding. (2 steps are what a transported basis keeps to.)
    step = 1e-4
    angles = step * np.arange(-2000, 2001)
    path = np.stack([np.sin(angles), np.cos(angles), np.full_like(angles, side * 1e-3)], axis=1)
    frames = np.array([check(to_light) for to_light in path])
    change = np.abs(np.diff(frames, axis=0)).max() / step
    figure("B1", "axes turn over the zenith, fixed basis", change, 3, "steps of the light")


@pytest.mark.parametrize(
    "to_light", [(0, 0, 0), (np.nan, 0, 1), (0, np.inf, 1), (-np.inf, 0, 0), (-0.0, 0.0, 0.0)]
)
def test_b1_no_direction_is_refused(to_light):
    with pytest.raises(ValueError, match="to_light"):
        _core.light_basis(to_light)


def test_wrong_shape_is_refused():
    with pytest.raises((TypeError, ValueError), match="to_light"):
        _core.light_basis((1.0, 2.0))


# -- carried on from frame to frame (docs/numerics.md 18) ------------------------------------------


CAMERA = csm.Camera.look_at((0, 2, 5), (0, 2, -90), near=0.1, far=100)
TRANSPORTED = csm.ShadowSettings(light_basis="transported", cascade_count=1)


def transported(path):
    """(n, 3, 3) axes along a path of directions, each frame held by the next."""
    held, axes = None, []
    for to_light in path:
        held = csm.fit_cascades(CAMERA, csm.Sun(to_light), TRANSPORTED, held=held)
        axes.append(held.light_from_world[0, :3, :3])
    return np.array(axes)


def test_b1_transported_axes_turn_no_faster_than_the_light(figure):
    # Through the pole and through z = 0, where the fixed basis jumps.
    step = 1e-4
    angles = step * np.arange(-1500, 1501)
    zero = np.zeros_like(angles)
    for path in (
        np.stack([np.sin(angles), np.cos(angles), zero], axis=1),
        np.stack([zero + 0.3, np.cos(angles), np.sin(angles)], axis=1),
        np.stack([np.sin(angles), zero + 1e-9, -np.cos(angles)], axis=1),
    ):
        axes = transported(path)
        change = np.linalg.norm(np.diff(axes, axis=0), axis=2).max() / step
        figure("B1", "axes turn, transported", change, 2, "steps of the light")
        skew = np.abs(axes @ axes.swapaxes(1, 2) - np.eye(3)).max()
        figure("B1", "transported axes from orthonormal", skew, TOLERANCE)
        turned_over = np.abs(np.cross(axes[:, 0], axes[:, 1]) - axes[:, 2]).max()
        figure("B1", "transported axes from right-handed", turned_over, TOLERANCE)


def test_b1_a_resting_sun_keeps_its_transported_axes_to_the_bit(figure):
    path = [(0.3, 1, 0.2), (0.31, 1, 0.2)] + [(0.32, 1, 0.2)] * 50
    axes = transported(path)
    figure("B1", "creep of transported axes at rest", np.ptp(axes[2:], axis=0).max(), 0)


def test_transported_starts_from_the_fixed_basis_and_after_a_half_turn():
    for path in ([(0.3, 1, 0.2)], [(0.3, 1, 0.2), (-0.3, -1, -0.2)]):
        np.testing.assert_array_equal(
            transported(path)[-1], _core.light_basis(csm.Sun(path[-1]).to_light)[:3, :3]
        )


def test_b1_lights_of_any_length_are_placed(figure):
    for basis in ("orthonormal", "world", "transported"):
        settings = csm.ShadowSettings(light_basis=basis)
        first, tiny = (
            _core.fit_cascades(CAMERA, np.array([1.0, 2.0, -1.0]) * scale, settings)
            for scale in (1.0, 1e-310)
        )
        off = np.abs(first["light_from_world"] - tiny["light_from_world"]).max()
        figure("B1", "axes of a denormal light", off, 1e-12)
        with pytest.raises(ValueError, match="to_light"):
            _core.fit_cascades(CAMERA, (0.0, 0.0, 0.0), settings)


# -- a sun in steps --------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0.1, 1.0, 7.0, 30.0, 90.0])
def test_b1_a_stepped_sun_is_never_far_from_the_sun(figure, step):
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(3000, 3))
    # round the poles, where rings are short
    directions[:1000] = [0, 1, 0] + rng.normal(size=(1000, 3)) * np.radians(step) * 1.5
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    stepped = np.array([_core.sun_step(each, step) for each in directions])
    apart = 2 * np.arcsin(np.linalg.norm(stepped - directions, axis=1).clip(0, 2) / 2)
    figure("B1", "a stepped sun from the sun", np.degrees(apart).max() / step, 0.8, "steps")
    np.testing.assert_allclose(np.linalg.norm(stepped, axis=1), 1, rtol=1e-15)
    # a step of a step is itself: it is a lattice
    again = np.array([_core.sun_step(each, step) for each in stepped])
    assert np.abs(again - stepped).max() < 1e-12


def test_a_stepped_sun_moves_the_maps_and_not_the_facing():
    settings = csm.ShadowSettings(sun_step_deg=1.0)
    axes = {
        csm.fit_cascades(CAMERA, csm.Sun.from_angles(30 + moved, 40), settings)
        .light_from_world[0].tobytes()
        for moved in np.linspace(0, 5, 101)
    }  # fmt: skip
    assert 4 <= len(axes) <= 6
    np.testing.assert_array_equal(_core.sun_step((0.3, 0.8, 0.1), 0.0), (0.3, 0.8, 0.1))
