"""The skewed basis of light_basis="world" (docs/numerics.md 18): its axes, its way out at low sun,
windows that hold their slices, and the picture it gives."""

import numpy as np
import pytest
from views import assert_finite, misses, scene_of, turned

import csm
from csm import shapes

WORLD = csm.ShadowSettings(light_basis="world", map_size=256)
LEAVES, RETURNS = 2.0**1.5, 2.0**1.25  # 1 / sine of the elevation, where the skew ends and begins
ELEVATIONS = (90.0, 60.0, 30.0, 10.0, 5.0, 2.0, 0.1, 0.0)


def is_skewed(cascades):
    rotation = cascades.light_from_world[0, :3, :3]
    return not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("side", [1, -1], ids=["above", "below"])
@pytest.mark.parametrize("elevation", ELEVATIONS)
def test_k1_axes_follow_the_world_and_depth_the_ray(figure, elevation, side):
    rng = np.random.default_rng(30)
    for azimuth in (0.0, 33.0, 90.0, 217.0):
        sun = csm.Sun.from_angles(azimuth, side * elevation)
        cascades = csm.fit_cascades(turned(rng), sun, WORLD)
        assert_finite(cascades)
        axes = cascades.light_from_world[0, :3, :3]
        assert np.linalg.det(axes) > 0  # right-handed, for light from below too
        # A metre along the ray is a metre of light z and nothing else.
        along = axes @ sun.to_light
        figure("K1", "a metre along the ray", np.abs(along - [0, 0, 1]).max(), 1e-9, "m")
        if 1 / max(abs(sun.to_light[1]), 1e-9) > LEAVES:
            off = np.abs(axes @ axes.T - np.eye(3)).max()
            figure("K1", "axes from orthonormal at low sun", off, 5e-15)
            continue
        # [theomader]: points of a horizontal plane keep their x and, turned over, their z.
        flat = axes @ np.array([[1.0, 0, 0], [0, 0, -side]]).T
        figure("K1", "axes from the world's", np.abs(flat.T - np.eye(3)[:2]).max(), 1e-9)


def test_k1_the_grid_on_the_ground_stands_while_the_sun_moves(figure):
    camera = turned(np.random.default_rng(31))
    ground = np.random.default_rng(32).uniform(-50, 50, size=(200, 3)) * [1, 0, 1]
    for fit in ("sphere", "diameter"):
        first, moved = None, 0.0
        for step in range(1000):
            sun = csm.Sun.from_angles(np.degrees(1e-4 * step), 50.0)
            cascades = csm.fit_cascades(camera, sun, WORLD.replace(fit=fit))
            at = ground @ cascades.light_from_world[0, :2, :3].T / cascades.texel_size[0]
            first = at if first is None else first
            moved = max(moved, np.abs(at - first).max())
        figure("K1", "grid on the ground under a moving sun", moved, 1e-9, "texels")
        # The orthonormal axes do not stand: what the test would see without the skew.
        plain = [
            csm.fit_cascades(
                camera, csm.Sun.from_angles(azimuth, 50.0), WORLD.replace(light_basis="orthonormal")
            )
            for azimuth in (0.0, 5.0)
        ]
        a, b = (ground @ one.light_from_world[0, :2, :3].T / one.texel_size[0] for one in plain)
        assert np.abs(a - b).max() > 1.0


def test_k1_texels_have_few_sizes_while_the_sun_climbs(figure):
    camera = turned(np.random.default_rng(33))
    held, sizes, worst = None, set(), 0.0
    for elevation in np.linspace(30, 90, 601):
        sun = csm.Sun.from_angles(20.0, elevation)
        held = csm.fit_cascades(camera, sun, WORLD, held=held)
        plain = csm.fit_cascades(camera, sun, WORLD.replace(light_basis="orthonormal"))
        sizes.add(float(held.texel_size[0, 0]))
        ratio = held.texel_size[0, 0] / plain.texel_size[0, 0] * np.sin(np.radians(elevation))
        assert ratio >= 1 - 1e-12
        worst = max(worst, ratio)
    # 30 degrees is a stretch of 2, one octave of eight steps; a held step is one too large.
    figure("K1", "sizes of a texel from 30 to 90 degrees", len(sizes), 9, "sizes")
    figure("K1", "texels larger than the skew needs", worst, 2 ** (2 / 8) + 1e-12, "times")


def test_k1_a_setting_sun_changes_axes_once(figure):
    camera = turned(np.random.default_rng(34))
    held, kinds = None, []
    elevations = np.degrees(np.arcsin(1 / LEAVES)) + np.linspace(3, -3, 400)
    wobble = 0.3 * np.sin(np.arange(400))  # a sun that goes to and fro as it sets
    for elevation in elevations + wobble:
        held = csm.fit_cascades(camera, csm.Sun.from_angles(70, elevation), WORLD, held=held)
        kinds.append(is_skewed(held))
    figure("K1", "changes of axes as the sun sets", np.count_nonzero(np.diff(kinds)), 1, "changes")
    assert kinds[0]
    assert not kinds[-1]
    back = np.degrees(np.arcsin(1 / RETURNS))
    for elevation, expected in ((back - 0.1, False), (back + 0.1, True)):
        held = csm.fit_cascades(camera, csm.Sun.from_angles(70, elevation), WORLD, held=held)
        assert is_skewed(held) == expected


@pytest.mark.parametrize("fit", ["sphere", "box", "diameter", "scene", "clipped", "focus"])
def test_c1_skewed_windows_hold_their_slices(figure, fit):
    rng = np.random.default_rng(35)
    missed = 0
    for elevation in (90, 60, 45, 30, 21, -21, -60):
        for fov in (15, 60, 150):
            camera = turned(rng, fov, eye=rng.normal(size=3) * 100)
            sun = csm.Sun.from_angles(rng.uniform(0, 360), elevation)
            # normal offsets move receivers by more texels than in the world
            settings = WORLD.replace(fit=fit, filter="pcf", filter_size=5)
            for scene in (None, scene_of([[-300, -10, -200], [300, 40, 250]])):
                cascades = csm.fit_cascades(camera, sun, settings, scene=scene)
                assert is_skewed(cascades) == (elevation != 90)
                if scene is None or fit not in ("clipped", "focus"):
                    missed += misses(camera, cascades, 2, rng, scene=scene)
    figure("C1", f"{fit}, skewed: points outside their window", missed, 0, "points")


@pytest.fixture(scope="module")
def yard():
    rng = np.random.default_rng(5)
    lower = rng.uniform((-26, 0, -26), (24, 0, 24), size=(60, 3))
    upper = lower + rng.uniform((0.3, 0.4, 0.3), (4, 5, 4), size=(60, 3))
    blocks = shapes.mesh("blocks", shapes.boxes(lower, upper))
    return csm.Scene([shapes.mesh("ground", shapes.ground(30.0)), blocks])


CAMERA = csm.Camera.look_at((18, 3, 20), (0, 1, 0), near=0.3, far=200, size=(240, 135))


@pytest.mark.parametrize("filter_size", [1, 5])
def test_k1_rendered_masks_are_as_good_as_orthonormal(figure, renderer, yard, filter_size):
    sun = csm.Sun.from_angles(33, 60)
    truth = csm.truth(yard, CAMERA, sun)
    settings = csm.ShadowSettings(map_size=512, filter="pcf", filter_size=filter_size)
    wrong = {}
    for basis in ("orthonormal", "world"):
        frame = renderer.render(yard, CAMERA, sun, settings.replace(light_basis=basis))
        wrong[basis] = csm.compare(frame, truth).mean["total"]
    assert wrong["orthonormal"] > 0
    # Texels on the ground are 1.22 times as large in area; edges of blocks add chance.
    figure("K1", "error against orthonormal, 60 degrees",
           wrong["world"] / wrong["orthonormal"], 1.3, "times")  # fmt: skip


@pytest.mark.parametrize("elevation", [60.0, 30.0, -50.0])
def test_g1_culling_changes_no_bit_under_a_skew(figure, renderer, yard, elevation):
    sun = csm.Sun.from_angles(33, elevation)
    settings = csm.ShadowSettings(
        map_size=256, light_basis="world", filter="pcf", filter_size=7,
        bias="manual", normal_offset_texels=3.0, receiver_plane=True,
    )  # fmt: skip
    frames = {
        cull: renderer.render(yard, CAMERA, sun, settings.replace(cull=cull))
        for cull in ("none", "inclusive", "exclusive")
    }
    for cull in ("inclusive", "exclusive"):
        different = np.count_nonzero(frames[cull].mask != frames["none"].mask)
        figure("G1", f"pixels that {cull} culling changes, skewed", different, 0, "pixels")


def test_depth_is_constant_on_the_ground_so_no_slope_bias_is_needed(renderer):
    # [theomader], [Stone]: horizontal planes have constant depth under the skew.
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(30.0))])
    settings = csm.ShadowSettings(map_size=64, light_basis="world", bias="manual",
                                  constant_bias_texels=1e-3)  # fmt: skip
    sun = csm.Sun.from_angles(10, 40)
    frame = renderer.render(scene, CAMERA, sun, settings)
    assert frame.mask[frame.valid & (frame.cascade_index < 4)].min() == 1.0
    plain = renderer.render(scene, CAMERA, sun, settings.replace(light_basis="orthonormal"))
    assert plain.mask[plain.valid & (plain.cascade_index < 4)].min() == 0.0
