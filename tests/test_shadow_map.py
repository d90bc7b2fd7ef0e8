"""Shadow maps against triangles rasterised in doubles: coverage, depth, formats, culling."""

import map_oracle
import numpy as np
import pytest
import small_scenes

import csm
from csm import shapes

SIZE = 96
QUANTUM = {"d32f": 2.0**-24, "d24": 1 / (2**24 - 1), "d16": 1 / (2**16 - 1)}
BASE = csm.ShadowSettings(map_size=SIZE, cascade_count=3, cull="none")


def assert_maps_match(frame, scene, *, clamp=False):
    """Coverage exact and depth within its bounds at every texel that is sure; most texels are."""
    half_quantum = 0.5 * QUANTUM[frame.settings.depth_format]
    sure_count = covered_count = 0
    for i, stored in enumerate(frame.shadow_maps):
        corners = map_oracle.texel_corners(scene, frame.cascades, i)
        oracle = map_oracle.rasterise(corners, len(stored), clamp=clamp)
        sure, covered = oracle.sure, oracle.owner >= 0
        stored = stored.astype(np.float64)
        assert ((stored < 1.0) == covered)[sure].all()
        assert (stored >= oracle.lowest - half_quantum)[sure].all()
        assert (stored <= oracle.highest + half_quantum)[sure].all()
        sure_count += np.count_nonzero(sure)
        covered_count += np.count_nonzero(sure & covered)
    texels = sum(stored.size for stored in frame.shadow_maps)
    assert sure_count > 0.98 * texels
    assert covered_count > 0.05 * texels


def render_maps(renderer, scene, camera, sun, settings):
    return renderer.render(scene, camera, sun, settings, outputs=("shadow_maps",))


# -- what is stored --------------------------------------------------------------------------------


def test_a_box_under_an_overhead_sun_in_closed_form(renderer):
    scene = csm.scenes.plane_and_box()
    settings = BASE.replace(map_size=128)
    frame = render_maps(renderer, scene, scene.cameras["corner"], csm.Sun((0, 1, 0)), settings)
    cascades = frame.cascades
    for i, stored in enumerate(frame.shadow_maps.astype(np.float64)):
        # docs/numerics.md 6 for (0, 1, 0): light x is world x, light y is world -z.
        corner = cascades.lattice[i] * cascades.texel_size[i]
        x, minus_z = corner[:, None] + (np.arange(128) + 0.5) * cascades.texel_size[i][:, None]
        near, far = cascades.depth_range[i]
        top, plane = (-2.0 - near) / (far - near), (0.0 - near) / (far - near)
        margin = map_oracle.SURE * cascades.texel_size[i].max()
        inside = np.maximum(np.abs(x)[None, :], np.abs(minus_z)[:, None])
        assert (np.abs(inside - 1.0) > margin).all(), "no texel centre lies on the box's edge"
        expected = np.where(inside < 1.0, top, np.where(inside < 20.0, plane, 1.0))
        np.testing.assert_allclose(stored, expected, rtol=0, atol=map_oracle.RANGE_ROUNDING)
        assert np.count_nonzero(inside < 1.0) >= 16


@pytest.mark.parametrize("sun", small_scenes.SUNS)
@pytest.mark.parametrize("scene", small_scenes.SCENES)
def test_maps_hold_the_nearest_triangle(renderer, scene, sun):
    scene, sun = small_scenes.SCENES[scene](), csm.Sun(small_scenes.SUNS[sun])
    for number in range(4):
        frame = render_maps(renderer, scene, small_scenes.camera(number), sun, BASE)
        assert_maps_match(frame, scene)


@pytest.mark.parametrize("depth_format", QUANTUM)
def test_formats_store_to_half_a_quantum(renderer, depth_format):
    scene, sun = small_scenes.soup(), csm.Sun(small_scenes.SUNS["high"])
    settings = BASE.replace(depth_format=depth_format)
    frame = render_maps(renderer, scene, small_scenes.camera(), sun, settings)
    assert_maps_match(frame, scene)
    if depth_format != "d32f":
        # Fixed point: whole quanta, up to the float32 that they come back as.
        quanta = frame.shadow_maps.astype(np.float64) / QUANTUM[depth_format]
        rounding = 2.0**-24 / QUANTUM[depth_format]
        assert np.abs(quanta - np.round(quanta)).max() <= rounding


@pytest.mark.parametrize(
    "changes",
    [
        {"map_size": 2},
        {"map_size": 255},
        {"map_size": 97, "snap": "none"},
        {"fit": "box", "snap": "none"},
        {"fit": "box"},
        {"fit": "diameter"},
        {"fit": "scene"},
        {"cascade_count": 1},
        {"cascade_count": 8, "map_size": 48},
        {"filter": "pcf", "filter_size": 15},
        {"split": "logarithmic", "view_range": "camera"},
        {"split": "manual", "manual_splits": (4.0, 9.0)},
    ],
    ids=lambda changes: " ".join(f"{name}={value}" for name, value in changes.items()),
)
def test_every_window_is_filled_by_its_own_matrices(renderer, changes):
    scene, sun = small_scenes.copies(), csm.Sun(small_scenes.SUNS["high"])
    settings = BASE.replace(**changes)
    frame = render_maps(renderer, scene, small_scenes.camera(), sun, settings)
    assert_maps_match(frame, scene)


def test_far_away_maps_are_as_good_as_at_the_origin(renderer):
    # Positions relative to the scene's fixed origin: the tolerance of the oracle is not widened.
    offset = np.array([3.0e6, 120.0, -5.0e6])
    scene = small_scenes.soup().placed(offset)
    camera = small_scenes.camera().translated(offset)
    frame = render_maps(renderer, scene, camera, csm.Sun(small_scenes.SUNS["low"]), BASE)
    assert_maps_match(frame, scene)


# -- culling ---------------------------------------------------------------------------------------

CULLED_SCENES = {
    "town": lambda: csm.scenes.town(6000),
    "forest": lambda: csm.scenes.forest(60),
    "long road": lambda: csm.scenes.long_road(600.0),
    "fence": csm.scenes.fence,
}


def used_texels(frame, radius):
    """(n, s, s) bool: texels that the lookup of some visible, sun-facing pixel may read."""
    used = np.zeros(frame.shadow_maps.shape, bool)
    facing = frame.valid & (frame.normal @ frame.sun.to_light > 1e-5)
    positions = small_scenes.positions_of(frame)
    size = frame.shadow_maps.shape[1]
    for i in range(len(used)):
        own = positions[facing & (frame.cascade_index == i)]
        texel = small_scenes.texels_of(frame.cascades, i, own)[:, :2]
        for dv in range(-radius, radius + 1):
            for du in range(-radius, radius + 1):
                u, v = np.floor(texel + np.array([du, dv])).astype(int).T
                inside = (u >= 0) & (v >= 0) & (u < size) & (v < size)
                used[i][v[inside], u[inside]] = True
    return used


@pytest.mark.parametrize("select", ["map", "interval"])
@pytest.mark.parametrize("scene", CULLED_SCENES)
def test_g1_culling_changes_no_mask_and_no_texel_that_is_used(figure, renderer, scene, select):
    scene = CULLED_SCENES[scene]()
    culled = 0
    outputs = ("mask", "valid", "view_depth", "cascade_index", "normal", "shadow_maps")
    for number, camera in enumerate(scene.cameras.values()):
        camera = camera.replace(size=small_scenes.SIZE)
        for j, sun in enumerate(scene.suns.values()):
            radius = (0, 1, 3)[(number + j) % 3]
            settings = csm.ShadowSettings(
                map_size=128, select=select, pancake=j % 2 == 1,
                filter="pcf" if radius else "hard", filter_size=2 * radius + 1 if radius else 3,
            )  # fmt: skip
            with_culling, without = (
                renderer.render(scene, camera, sun, settings.replace(cull=cull), outputs=outputs)
                for cull in ("inclusive", "none")
            )
            differing = np.count_nonzero(with_culling.mask != without.mask)
            figure("G1", "mask with culling against without", differing, 0, "pixels")
            assert np.array_equal(with_culling.cascade_index, without.cascade_index)
            used = used_texels(without, radius)
            assert used.any()
            other = np.count_nonzero(with_culling.shadow_maps[used] != without.shadow_maps[used])
            figure("G1", "texels in use with culling against without", other, 0, "texels")
            culled += sum(with_culling.info["chunks_culled"])
            assert sum(without.info["chunks_culled"]) == 0
    assert culled > 0


# -- pancaking -------------------------------------------------------------------------------------


def tower_scene():
    """A ground, and a slab 60 m over it that no slice of the camera reaches up to."""
    slab = shapes.mesh("slab", shapes.box((-2, 60, -3), (2, 61, 3)))
    post = shapes.mesh("post", shapes.box((-0.2, 0, -5), (0.2, 2, -4.6)))
    return csm.Scene([shapes.mesh("ground", shapes.ground(40.0)), slab, post])


def test_pancaking_flattens_what_lies_before_the_slice(renderer):
    scene, camera = tower_scene(), small_scenes.camera(1, far=30.0)
    sun = csm.Sun((0.1, 1.0, 0.05))
    settings = BASE.replace(pancake=True)
    frame = render_maps(renderer, scene, camera, sun, settings)
    assert_maps_match(frame, scene, clamp=True)
    span = np.diff(frame.cascades.depth_range)[:, 0]
    assert (span < 60.0).all(), "the slab is outside every range"
    assert (frame.shadow_maps[-1] == 0.0).any(), "and flattened onto the near plane"


@pytest.mark.parametrize("select", ["map", "interval"])
def test_r1_pancaking_changes_no_shadow(figure, renderer, select):
    # By map, a narrower range may leave a pixel to another cascade, whose texels are its own.
    # Elsewhere only the rounding of depths differs, and only a compare that is as close as that
    # may go the other way: measured 0 of 1.1 million.
    differing = same = total = 0
    settings = csm.ShadowSettings(map_size=256, select=select)
    for make in (tower_scene, *small_scenes.SCENES.values()):
        scene = make()
        for sun in small_scenes.SUNS.values():
            for number in range(4):
                plain, flattened = (
                    renderer.render(
                        scene, small_scenes.camera(number), csm.Sun(sun),
                        settings.replace(pancake=pancake), outputs=("mask", "cascade_index"),
                    )
                    for pancake in (False, True)
                )  # fmt: skip
                alike = plain.cascade_index == flattened.cascade_index
                differing += np.count_nonzero((plain.mask != flattened.mask) & alike)
                same += np.count_nonzero(alike)
                total += alike.size
    figure("R1", "shadows changed by pancaking", differing / total, 1e-5, "share")
    assert same == total if select == "interval" else same > 0.9 * total


def test_bare_ground_is_lit_up_to_its_rim(renderer):
    # Texels beyond the rim are empty; the receiver's plane, followed to their centres, is deeper
    # than the scene, and still nothing is there to shadow it.
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(20.0))])
    views = [
        ((-17, 2, -17), (-20, 0, -20)),
        ((0, 30, 0.1), (0, 0, 0)),
        ((16, 2, -16), (20, 0, -20)),
        ((0, 3, -14), (0, 0, -20)),
    ]
    for filter_size in (1, 2, 5, 9):
        for sun in (csm.Sun.from_angles(0, 2), csm.Sun.from_angles(45, 10)):
            for pancake in (False, True):
                for eye, target in views:
                    camera = csm.Camera.look_at(eye, target, far=100, size=small_scenes.SIZE)
                    settings = csm.ShadowSettings(
                        map_size=256, filter="pcf", filter_size=filter_size, pancake=pancake
                    )
                    frame = renderer.render(scene, camera, sun, settings, outputs=("mask",))
                    assert (frame.mask == 1.0).all()
