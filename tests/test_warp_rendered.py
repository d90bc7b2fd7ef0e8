"""Warped cascades rendered: what maps hold, what masks answer, what a warp is worth, and that it is
absent where it is off (L1 of docs/numerics.md 16; the formulas: 21)."""

import map_oracle
import numpy as np
import pytest
import small_scenes

import csm
from csm import _core, shapes, spaces

WARPS = ["lispsm", "psm", "tsm"]
OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal", "shadow_maps")
BASE = csm.ShadowSettings(map_size=256, cascade_count=1, fit="box", snap="none")
FACING = 1e-5

# A scene, a view and a sun: angles between light and view of 37 to 143 degrees.
CASES = list(
    zip(
        small_scenes.SCENES.values(),
        (0, 1, 2, 3),
        ("high", "low", "in_the_face", "high"),
        strict=True,
    )
)


def frame_of(renderer, scene, camera, sun, settings, **more):
    return renderer.render(scene, camera, csm.Sun(sun), settings, outputs=OUTPUTS, **more)


# -- maps ------------------------------------------------------------------------------------------


def before_the_horizon(triangle, lowest_w):
    """Triangles, clip xyzw, of the part of one where w is at least `lowest_w`."""
    polygon = []
    for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        if a[3] >= lowest_w:
            polygon.append(a)
        if (a[3] >= lowest_w) != (b[3] >= lowest_w):
            polygon.append(a + (b - a) * (lowest_w - a[3]) / (b[3] - a[3]))
    return [np.array([polygon[0], *polygon[k : k + 2]]) for k in range(1, len(polygon) - 1)]


def warped_corners(scene, cascades, i):
    """`map_oracle.texel_corners` for a warped map: u, v in texels and depth. w is 1 or more on the
    map, so what lies beyond is cut off first: part of it is behind the horizon."""
    positions, triangles = scene.flatten()
    matrix = cascades.uvz_from_world[i]
    clip = np.concatenate([positions, np.ones((len(positions), 1))], axis=1) @ matrix.T
    corners = [
        part for triangle in clip[triangles] for part in before_the_horizon(triangle, 1.0 - 1e-7)
    ]
    corners = np.array(corners)
    corners = corners[..., :3] / corners[..., 3:]
    corners[..., :2] *= cascades.map_size[i]
    return corners


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("warp", WARPS)
def test_warped_maps_hold_the_nearest_triangle(renderer, warp, count):
    settings = BASE.replace(warp=warp, cascade_count=count, map_size=96, cull="none")
    for scene, number, sun in (
        (small_scenes.soup(20), 0, "high"),
        (small_scenes.copies(8), 1, "low"),
    ):
        camera = small_scenes.camera(number)
        frame = frame_of(renderer, scene, camera, small_scenes.SUNS[sun], settings)
        for i, stored in enumerate(frame.shadow_maps.astype(np.float64)):
            corners = warped_corners(scene, frame.cascades, i)
            oracle = map_oracle.rasterise(corners, len(stored))
            sure, covered = oracle.sure, oracle.owner >= 0
            # Coordinates are rounded where w is small, and stretched there by 1 + strength:
            # a texel in a thousand beside an edge more than the unwarped oracle allows.
            assert ((stored < 1.0) == covered)[sure].mean() >= 0.999
            within = (stored >= oracle.lowest - 2e-6) & (stored <= oracle.highest + 2e-6)
            assert within[sure].mean() >= 0.999
            assert sure.mean() > 0.8


# -- masks: every compare --------------------------------------------------------------------------


def derivative(function, at, step):
    """Central difference of a function of points along light x, then y; (..., 2, k)."""
    return np.stack(
        [(function(at + step * e) - function(at - step * e)) / (2.0 * step) for e in np.eye(2)], -2
    )


def oracle_of(frame, i):
    """(lowest, highest) visibility of each valid pixel from map i by a hard compare with a manual
    bias, in doubles. Planes go through the inverse transpose of the map's matrix; texel sides are
    differences of positions."""
    settings, cascades = frame.settings, frame.cascades
    size = int(cascades.map_size[i])
    positions = small_scenes.positions_of(frame)[frame.valid]
    normals = frame.normal[frame.valid].astype(np.float64)
    light = cascades.light_from_world[i][:3, :3]
    texels_from_light = np.diag([size, size, 1.0, 1.0]) @ (
        cascades.uvz_from_world[i] @ np.linalg.inv(cascades.light_from_world[i])
    )

    def texels_of(points_ls):
        return spaces.transform_points(texels_from_light, points_ls)

    def side_of_texel(points_ls):
        """Larger side [m] at each point, from d(u, v)/d(light x, y)."""
        step = 1e-5
        rows = derivative(
            lambda xy: texels_of(np.concatenate([xy, points_ls[:, 2:]], 1))[:, :2],
            points_ls[:, :2],
            step,
        )
        return np.linalg.norm(np.linalg.inv(rows), axis=2).max(axis=1)

    normals_ls = normals @ light.T
    cosine = np.maximum(normals_ls[:, 2:], 1e-3)
    gradient = np.abs(normals_ls[:, :2] / cosine).sum(axis=1)
    points_ls = positions @ light.T
    side = side_of_texel(points_ls)
    sine = np.linalg.norm(np.cross(normals, frame.sun.to_light), axis=1)
    points_ls = points_ls + normals_ls * (settings.normal_offset_texels * side * sine)[:, None]
    at = texels_of(points_ls)
    w = points_ls @ texels_from_light[3, :3] + texels_from_light[3, 3]
    metres = side * (settings.constant_bias_texels + settings.slope_bias * gradient)
    bias = metres / np.diff(cascades.depth_range[i]) / w
    # plane . (x, 1) = 0 in light space; a point M x of the map's space lies on inverse(M)^T plane.
    # Without the receiver's own it is the plane at its distance from the light.
    if not settings.receiver_plane:
        normals_ls = np.broadcast_to([0.0, 0.0, 1.0], normals_ls.shape)
    planes = np.concatenate([normals_ls, -(normals_ls * points_ls).sum(axis=1)[:, None]], axis=1)
    planes = planes @ np.linalg.inv(texels_from_light)
    texel = np.floor(at[:, :2])
    depth = -((planes[:, :2] * (texel + 0.5)).sum(axis=1) + planes[:, 3]) / planes[:, 2] - bias
    u, v = np.clip(texel, 0, size - 1).astype(int).T
    stored = frame.shadow_maps[i].astype(np.float64)[v, u]
    # Float32: positions to 2^-23 of the scene, some ten roundings; steep planes turn that into
    # depth, and slopes come from normals that are as coarse.
    error = (1.0 + gradient) * (2e-5 + np.abs(bias) * 1e-4)
    lowest = (np.minimum(depth, 1.0) + error <= stored) | (stored == 1.0)
    highest = (np.minimum(depth, 1.0) - error <= stored) | (stored == 1.0)
    on_edge = (np.abs(at[:, :2] - np.round(at[:, :2])) < 2e-3 * (1.0 + 1e-2 * w[:, None])).any(1)
    facing = normals @ frame.sun.to_light
    lit = facing > FACING
    return (lowest & ~on_edge & lit), ((highest | on_edge) & lit), np.abs(facing - FACING) < 1e-6


@pytest.mark.parametrize(
    "bias",
    [
        {"constant_bias_texels": 1.5, "receiver_plane": True},
        {"slope_bias": 1.0, "constant_bias_texels": 0.5},
        {"normal_offset_texels": 1.5, "constant_bias_texels": 0.3, "receiver_plane": True},
    ],
    ids=lambda bias: next(iter(bias)),
)
@pytest.mark.parametrize("warp", WARPS)
def test_every_compare_under_a_warp(renderer, evidence, warp, bias):
    settings = BASE.replace(warp=warp, bias="manual", select="interval", **bias)
    shades = undecided = total = 0
    for make, number, sun in CASES:
        camera = small_scenes.camera(number, near=1.0)
        frame = frame_of(renderer, make(), camera, small_scenes.SUNS[sun], settings)
        lowest, highest, edge_on = oracle_of(frame, 0)
        mask = frame.mask[frame.valid]
        wrong = (mask < lowest) | (mask > highest)
        wrong[edge_on] = False
        picture = np.zeros(frame.mask.shape)
        picture[frame.valid] = wrong
        evidence(rendered=frame.mask, wrong=picture, settings=settings)
        assert not wrong.any()
        shades += np.ptp(mask) > 0
        undecided += np.count_nonzero(lowest != highest)
        total += mask.size
    assert shades >= 3
    assert undecided < 0.12 * total


@pytest.mark.parametrize("warp", WARPS)
def test_l1_bare_ground_is_lit_under_every_warp(renderer, figure, warp):
    # The receiver's plane through the warp is exact: no acne, at any tilt, format and kernel.
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(40.0))])
    worst = 0.0
    for depth_format in ("d32f", "d16"):
        for filter_size in (1, 2, 5):
            settings = BASE.replace(
                warp=warp, filter="pcf", filter_size=filter_size, depth_format=depth_format,
                cascade_count=1 + filter_size // 2,
            )  # fmt: skip
            for sun in (
                csm.Sun.from_angles(20, 3),
                csm.Sun.from_angles(200, 40),
                csm.Sun((0, 1, 0)),
            ):
                for eye, target in (((-35, 2, -30), (10, 0, 5)), ((0, 30, 0.1), (0, 0, 0))):
                    camera = csm.Camera.look_at(eye, target, far=120, size=small_scenes.SIZE)
                    frame = renderer.render(scene, camera, sun, settings, outputs=("mask",))
                    worst = max(worst, 1.0 - float(frame.mask.min()))
    figure("L1", "acne on bare ground under a warp", worst, 0.0, "of the light")


# -- against the truth -----------------------------------------------------------------------------


def posts():
    """A long ground with thin posts, about as many at 2 m as at 90 m on the picture."""
    rng = np.random.default_rng(5)
    x = np.geomspace(2.0, 90.0, 250)
    z = rng.uniform(-0.5, 0.5, len(x)) * x
    sides = [0.04, 0.5, 0.04]
    boxes = [
        shapes.mesh(f"post {k}", shapes.box(foot, foot + size))
        for k, (foot, size) in enumerate(
            zip(np.stack([x, 0 * x, z], 1), x[:, None] ** 0.5 * sides, strict=True)
        )
    ]
    return csm.Scene([shapes.mesh("ground", shapes.ground(120.0)), *boxes])


def disagreement(renderer, scene, camera, sun, settings, truth):
    frame = renderer.render(
        scene,
        camera,
        sun,
        settings,
        outputs=("mask", "valid", "cascade_index", "view_depth", "normal"),
    )
    return csm.compare(frame, truth).disagreement


def test_l1_one_warped_map_beats_one_that_is_not(renderer, figure):
    # Along a ground from 1.5 m to 100 m at right angles to the light, sampling alone makes the
    # error; theory promises a worst texel smaller by sqrt(zf/zn) = 8 along the axis.
    scene, sun = posts(), csm.Sun((0.0, 1.0, 1.0))
    camera = csm.Camera.look_at(
        (0, 1.5, 0), (60, 0, 0), fov_y_deg=45, near=1.5, far=100, size=(480, 270)
    )
    truth = csm.truth(scene, camera, sun)
    errors = {
        warp: disagreement(
            renderer, scene, camera, sun, BASE.replace(warp=warp, map_size=512), truth
        )
        for warp in ("none", *WARPS)
    }
    assert errors["none"] > 0.02  # or there was nothing to gain
    # half of it would do: where posts stand close, no map resolves them
    for warp in WARPS:
        figure("L1", f"{warp} over no warp at right angles", errors[warp] / errors["none"], 0.5)


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("warp", WARPS)
def test_l1_masks_under_a_warp_agree_with_the_truth(renderer, figure, warp, count):
    # Near is put where the pictures begin: a warp spends the texels on what is near, and the few
    # centimetres before the eye would take most of psm's.
    settings = BASE.replace(cascade_count=count, map_size=512)
    plain, warped = [], []
    for make, number, sun in CASES:
        scene, sun_ = make(), csm.Sun(small_scenes.SUNS[sun])
        camera = small_scenes.camera(number, size=(240, 135), near=1.0, far=30.0)
        truth = csm.truth(scene, camera, sun_)
        plain.append(disagreement(renderer, scene, camera, sun_, settings, truth))
        warped.append(
            disagreement(renderer, scene, camera, sun_, settings.replace(warp=warp), truth)
        )
    worse = np.array(warped) - np.array(plain)
    figure("L1", f"{warp}, {count} maps: mean disagreement", np.mean(warped), 0.015)
    figure("L1", f"{warp}, {count} maps: worse than no warp", worse.max(), 0.02)


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("warp", WARPS)
def test_l1_a_warp_holds_what_is_seen(renderer, figure, warp, count):
    # A warp has to hold less of a slice whose windows lie round the visible receivers: each of them
    # keeps a cascade, and texels are finer, so that the error over all the cases is smaller.
    settings = BASE.replace(cascade_count=count, map_size=512, warp=warp)
    outputs = ("mask", "valid", "cascade_index", "view_depth", "normal")
    errors, lost = {"box": [], "visible": []}, 0
    for make, number, sun in CASES:
        scene, sun_ = make(), csm.Sun(small_scenes.SUNS[sun])
        camera = small_scenes.camera(number, size=(240, 135))
        truth = csm.truth(scene, camera, sun_)
        for fit, found in errors.items():
            frame = renderer.render(scene, camera, sun_, settings.replace(fit=fit), outputs=outputs)
            found.append(csm.compare(frame, truth).disagreement)
        seen = truth.valid & truth.facing & frame.valid
        lost += np.count_nonzero(seen & (frame.cascade_index == 255))
    figure("L1", "visible receivers without a warped map", lost, 0, "pixels")
    ratio = np.mean(errors["visible"]) / np.mean(errors["box"])
    figure("L1", f"{warp}, {count} maps: fit visible over box", ratio, 1.0)


# -- round about -----------------------------------------------------------------------------------


@pytest.mark.parametrize("warp", WARPS)
def test_culling_changes_no_warped_mask(renderer, warp):
    culled = 0
    scene = csm.scenes.town(6000)
    for camera in scene.cameras.values():
        for sun in list(scene.suns.values())[:2]:
            frames = [
                renderer.render(
                    scene, camera.replace(size=small_scenes.SIZE), sun,
                    csm.ShadowSettings(map_size=128, warp=warp, cull=cull),
                    outputs=("mask", "cascade_index"),
                )
                for cull in ("inclusive", "none")
            ]  # fmt: skip
            assert np.array_equal(frames[0].mask, frames[1].mask)
            assert np.array_equal(frames[0].cascade_index, frames[1].cascade_index)
            culled += sum(frames[0].info["chunks_culled"])
    assert culled > 0


@pytest.mark.parametrize("warp", WARPS)
def test_points_outside_the_map_and_behind_its_horizon_have_no_cascade(renderer, warp):
    scene, camera = csm.scenes.plane_and_box(), small_scenes.camera(near=1.0, far=20.0)
    sun = csm.Sun((0.3, 1.0, 0.2))
    behind = camera.eye + camera.backward * np.linspace(2.0, 60.0, 30)[:, None]
    behind = np.concatenate([behind, [[0.0, 0.0, 0.0]]])
    settings = BASE.replace(warp=warp)
    frame = renderer.render(scene, camera, sun, settings, outputs=("mask",), points=behind)
    matrix = frame.cascades.clip_from_world[0]
    w = behind @ matrix[3, :3] + matrix[3, 3]
    assert (w < 0).any(), "some lie behind the horizon"
    assert (frame.point_cascade[:-1] == 255).all()
    assert (frame.point_visibility[:-1] == 1.0).all()
    assert frame.point_cascade[-1] == 0


@pytest.mark.parametrize("warp", WARPS)
def test_far_from_the_origin_a_warped_mask_is_the_same(renderer, warp):
    offset = np.array([3.0e6, 120.0, -5.0e6])
    scene, camera = small_scenes.soup(), small_scenes.camera(near=1.0)
    masks = [
        frame_of(
            renderer, scene.placed(by), camera.translated(by), small_scenes.SUNS["high"],
            BASE.replace(warp=warp, cascade_count=3),
        ).mask
        for by in (np.zeros(3), offset)
    ]  # fmt: skip
    assert (masks[0] != masks[1]).mean() < 2e-3


def test_a_warp_that_is_off_is_absent(fresh_renderer):
    renderer = fresh_renderer()
    scene, camera = small_scenes.soup(), small_scenes.camera()
    before = frame_of(renderer, scene, camera, small_scenes.SUNS["high"], BASE)
    objects, programs = (renderer.info[key] for key in ("live_objects", "programs_compiled"))
    for warp in WARPS:
        frame_of(renderer, scene, camera, small_scenes.SUNS["high"], BASE.replace(warp=warp))
    # one caster and one mask program for all three, and a buffer that goes with the next frame
    assert renderer.info["programs_compiled"] == programs + 2
    assert renderer.info["live_objects"] == objects + 3
    after = frame_of(renderer, scene, camera, small_scenes.SUNS["high"], BASE)
    assert renderer.info["live_objects"] == objects + 2
    assert np.array_equal(before.mask, after.mask)
    assert np.array_equal(before.shadow_maps, after.shadow_maps)
    steps = {name for name, _, _ in _core.plan(BASE, 8, 8, 1)[0]}
    assert steps == {name for name, _, _ in _core.plan(BASE.replace(warp="psm"), 8, 8, 1)[0]}
    for name in ("shadow_map", "shadow_mask"):
        assert "#define CSM_WARPED 0\n" in _core.program_defines(name, BASE, 1)
        warped = _core.program_defines(name, BASE.replace(warp="tsm").canonical(), 1)
        assert "#define CSM_WARPED 1\n" in warped


def test_what_a_warp_makes_meaningless_is_reset():
    settings = csm.ShadowSettings(
        warp="lispsm",
        snap="exact",
        light_basis="world",
        cull="exclusive",
        fit="visible",
        turned=True,
    ).canonical()
    assert (settings.snap, settings.light_basis, settings.cull) == (
        "none",
        "orthonormal",
        "inclusive",
    )
    assert not settings.turned


@pytest.mark.parametrize("warp", WARPS)
@pytest.mark.parametrize("fit", ["sphere", "box", "scene"])
def test_fitted_cascades_are_the_warps_of_their_slices(warp, fit):
    camera, sun = small_scenes.camera(near=0.5), csm.Sun((0.4, 1.0, 0.3))
    settings = csm.ShadowSettings(warp=warp, fit=fit, filter="pcf", filter_size=5, map_size=300)
    cascades = csm.fit_cascades(camera, sun, settings)
    kind = 1 + WARPS.index(warp)
    for i in range(cascades.count):
        near = cascades.splits[0 if fit == "scene" else i]
        far = cascades.splits[i + 1]
        made = _core.make_warp(camera, sun.to_light, near, far, kind, 300, 2)
        basis = made["light_from_world"]
        np.testing.assert_array_equal(cascades.light_from_world[i], basis)
        corner = _core.frustum_corners(camera, near, far)
        local = ((corner - camera.eye) @ basis[:3, :3].T)[:, :2] - made["origin"]
        local = np.c_[local / made["extent"], np.zeros(8), np.ones(8)] @ made["clip_from_local"].T
        clip = spaces.transform_points(cascades.clip_from_world[i], corner)
        np.testing.assert_allclose(clip[:, :2], local[:, :2] / local[:, 3:], atol=1e-9)
        inner = 1.0 - 2.0 * 2 / 300
        np.testing.assert_allclose(clip[:, :2].min(axis=0), -inner, atol=1e-9)
        np.testing.assert_allclose(clip[:, :2].max(axis=0), inner, atol=1e-9)
        # light-view depths of 0 and 1 where w is 1, and the texel at the centre
        middle = np.linalg.inv(cascades.clip_from_light[i])
        ends = spaces.transform_points(middle, [[0, 0, 0.0], [2 / 300, 0, 0.0], [0, 2 / 300, 0.0]])
        sides = np.linalg.norm(ends[1:] - ends[0], axis=1)
        # a whole texel against the derivative: the texel grows by its strength over the map
        np.testing.assert_allclose(sides, cascades.texel_size[i], rtol=0.2)
        row = cascades.clip_from_light[i][2]
        np.testing.assert_allclose(-row[2], 1 / np.diff(cascades.depth_range[i])[0], rtol=1e-12)
        np.testing.assert_allclose(row[3] / row[2], cascades.depth_range[i][0], rtol=1e-9)
        assert (cascades.lattice[i] == 0).all()


@pytest.mark.parametrize("warp", WARPS)
def test_l1_a_clipped_slice_is_held(figure, warp):
    # The warp then holds less than the slice too: its points inside the scene's bounds.
    scene = small_scenes.soup()
    rng = np.random.default_rng(11)
    outside = 0.0
    for number, name in enumerate(small_scenes.SUNS):
        camera, sun = small_scenes.camera(number), csm.Sun(small_scenes.SUNS[name])
        camera = camera.replace(centre_x=0.15, centre_y=-0.1)
        settings = csm.ShadowSettings(warp=warp, fit="clipped", cascade_count=3)
        cascades = csm.fit_cascades(camera, sun, settings, scene=scene)
        points = rng.uniform(*scene.bounds, size=(20000, 3))
        view = (points - camera.eye) @ np.stack([camera.right, camera.up, -camera.backward], 1)
        x = (view[:, 0] / view[:, 2] - camera.centre_x) / camera.half_width
        y = (view[:, 1] / view[:, 2] - camera.centre_y) / camera.half_height
        seen = (np.abs(x) <= 1) & (np.abs(y) <= 1) & (view[:, 2] >= camera.near)
        assert seen.sum() > 500
        for i in range(3):
            near, far = cascades.splits[i : i + 2]
            own = points[seen & (view[:, 2] >= near) & (view[:, 2] <= far)]
            if len(own):
                clip = spaces.transform_points(cascades.clip_from_world[i], own)
                outside = max(outside, np.abs(clip[:, :2]).max() - 1.0)
    figure("L1", "clipped slices outside the cube", outside, 1e-9, "of the half width")
