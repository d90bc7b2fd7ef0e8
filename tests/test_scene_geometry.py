"""What the GPU gets of a scene: instances stored once, chunks, planes; how they are stored shows in
no bit of a map or a mask.

Coordinates are dyadic and faces axis-aligned where bits are compared: then every product of the
transforms is exact, and any difference is a fault of the storage.
"""

import gc
import math

import numpy as np
import pytest

import csm
from csm.shapes import box, join
from csm.spaces import transform_points

# Culling goes by chunks: what it drops outside the picture may depend on how triangles are stored.
SETTINGS = csm.ShadowSettings(cascade_count=2, map_size=256, cull="none")
OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps", "normal")
CAMERA = csm.Camera.look_at((6, 6, 10), (-0.5, 0.5, 0), far=80, size=(96, 54))
SUN = csm.Sun((-2, 3, -1))  # towards the camera, so that shadows show
GROUND = csm.Mesh([(-16, 0, -16), (-16, 0, 16), (16, 0, 16), (16, 0, -16)], [(0, 1, 2), (0, 2, 3)])


def post(name="post"):
    """A box with an arm to one side: no symmetry that could hide a wrong transform."""
    parts = box((-0.5, 0, -0.5), (0.5, 3, 0.5)), box((0.5, 2, -0.25), (2.5, 2.5, 0.25))
    return csm.Mesh(*join(*parts), name)


def placed(*linear_and_offset):
    """(k, 4, 4) transforms."""
    transforms = np.tile(np.eye(4), (len(linear_and_offset), 1, 1))
    for transform, (linear, offset) in zip(transforms, linear_and_offset, strict=True):
        transform[:3, :3] = linear
        transform[:3, 3] = offset
    return transforms


QUARTER_TURN = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # about y
TRANSFORMS = {
    "moved": placed((np.eye(3), (2, 0, 1)), (np.eye(3), (-4.5, 0.25, 2))),
    "turned": placed((QUARTER_TURN, (2, 0, 1)), (QUARTER_TURN @ QUARTER_TURN, (-4, 0, 2))),
    "scaled": placed((2 * np.eye(3), (2, 0, 1)), (np.diag([0.5, 1.5, 4.0]), (-4, 0, 2))),
    "mirrored": placed(
        (np.diag([-1.0, 1, 1]), (2, 0, 1)), (np.diag([1.0, 1, -1]) @ QUARTER_TURN, (-4, 0, 2))
    ),
    "lying": placed(
        (np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]), (1, 1, 1)), (-np.eye(3), (-4, 3, 2))
    ),
}


def scene_of(mesh, transforms, **more):
    """The ground once, the mesh at every transform."""
    return csm.Scene(
        [GROUND, mesh],
        [0] + [1] * len(transforms),
        np.concatenate([np.eye(4)[None], transforms]),
        **more,
    )


def flat(scene):
    """The same triangles with every instance baked, corners in their order.

    `Scene.flatten` flips the faces of mirrored instances, and a rasteriser may interpolate a
    triangle differently from another first corner.
    """
    parts = []
    for number, transform in zip(scene.instance_mesh, scene.world_from_instance, strict=True):
        mesh = scene.meshes[number]
        parts.append((transform_points(transform, mesh.positions), mesh.triangles))
    return csm.Scene.from_arrays(*join(*parts))


def assert_same_bits(first, second, outputs=OUTPUTS):
    for name in outputs:
        assert np.array_equal(getattr(first, name), getattr(second, name)), name


def assert_shows_shadows(frame):
    ground = frame.valid & (np.abs(frame.normal[..., 1]) > 0.99)
    assert 0.02 < (frame.mask < 0.5)[ground].mean() < 0.9


# -- instances -------------------------------------------------------------------------------------


@pytest.mark.parametrize("filter_", ["hard", "pcf"])
@pytest.mark.parametrize("kind", TRANSFORMS)
def test_instances_render_as_their_baked_triangles(renderer, evidence, kind, filter_):
    scene = scene_of(post(), TRANSFORMS[kind])
    settings = SETTINGS.replace(filter=filter_)
    stored, baked = (
        renderer.render(one, CAMERA, SUN, settings, outputs=OUTPUTS) for one in (scene, flat(scene))
    )
    assert scene.stored_triangle_count < scene.triangle_count
    assert_shows_shadows(baked)
    evidence(rendered=stored.mask, reference=baked.mask, settings=settings)
    assert_same_bits(stored, baked)


def test_slanted_instances_differ_from_baked_ones_by_rounding_alone(renderer, evidence):
    rng = np.random.default_rng(5)
    transforms = []
    for x in (-6, -3, 0, 3, 6):
        # turned, stretched, turned: normals then do not go with the matrix itself
        first, last = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
        linear = last * rng.uniform(0.5, 1.5, 3) @ first
        transforms.append((linear, (x, 2, rng.uniform(-4, 4))))
    scene = scene_of(post(), placed(*transforms))
    stored, baked = (
        renderer.render(one, CAMERA, SUN, SETTINGS, outputs=OUTPUTS) for one in (scene, flat(scene))
    )
    assert_shows_shadows(baked)
    evidence(rendered=stored.mask, reference=baked.mask, settings=SETTINGS)
    # vertices differ by 2^-24 of 16 m, so only pixels cut by an edge to 1e-6 of their size change
    changed = (stored.mask != baked.mask) | (stored.valid != baked.valid)
    assert changed.mean() < 2e-3
    both = ~changed & stored.valid & (np.abs(stored.normal - baked.normal).max(axis=-1) < 1e-3)
    assert both.sum() > 0.99 * stored.valid.sum()
    np.testing.assert_allclose(stored.view_depth[both], baked.view_depth[both], rtol=1e-5)
    np.testing.assert_allclose(stored.normal[both], baked.normal[both], atol=1e-5)


def test_a_thousand_instances_are_stored_once(renderer):
    mesh = post()
    x, z = np.meshgrid(np.arange(-16, 16.0), np.arange(-16, 16.0))
    offsets = np.stack([x, 0 * x, z], axis=-1).reshape(-1, 3)
    transforms = placed(*((0.25 * np.eye(3), offset) for offset in offsets[:1000]))
    thousand, five_hundred = (scene_of(mesh, some) for some in (transforms, transforms[:500]))
    frame = renderer.render(thousand, CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
    drawn = 2 + 1000 * len(mesh.triangles)
    assert thousand.triangle_count == drawn
    assert frame.info["triangles_drawn"] == [drawn] * 2

    # one more instance costs 3 x 4 floats, whatever its mesh holds
    fewer = renderer.render(five_hundred, CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
    assert frame.info["scene_bytes"] - fewer.info["scene_bytes"] == 500 * 12 * 4
    baked = renderer.render(flat(thousand), CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
    assert baked.info["scene_bytes"] > 10 * frame.info["scene_bytes"]
    assert_shows_shadows(baked)
    assert_same_bits(frame, baked)


def many_kinds(count):
    """Meshes of their own, two of each: a command for every one of them in every pass."""
    rng = np.random.default_rng(7)
    places = rng.integers(-60, 60, (count, 2, 2)) * 0.25
    places[:, 1] += 0.125  # no two of a mesh at one place
    sides = rng.integers(1, 9, (50, 3)) * 0.0625
    meshes = ([csm.Mesh(*box((0, 0, 0), side)) for side in sides] * (count // 50 + 1))[:count]
    transforms = placed(*((np.eye(3), (x, 0, z)) for x, z in places.reshape(-1, 2)))
    numbers = np.concatenate([[0], 1 + np.arange(2 * count) // 2])
    return csm.Scene([GROUND, *meshes], numbers, np.concatenate([np.eye(4)[None], transforms]))


def test_frames_of_few_draws_and_of_many_follow_one_another(fresh_renderer):
    """What a pass draws lies behind what those before it do, in buffers that grow in a frame's
    middle, and from 128 KiB, 6553 draws of 20 bytes, grow for a single pass alone."""
    renderer, baked_in = fresh_renderer(), fresh_renderer()
    few, some, many, most = (many_kinds(count) for count in (3, 400, 7_000, 13_000))
    live = []
    for scene in (few, some, many, most, some, few):
        frame = renderer.render(scene, CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
        baked = baked_in.render(flat(scene), CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
        assert_same_bits(frame, baked)
        assert frame.info["triangles_drawn"] == [scene.triangle_count] * 2
        info = renderer.info
        live.append(info["live_objects"] - info["programs_compiled"])
    a_scene = live[1] - live[0]
    assert live == [live[0] + a_scene * scenes for scenes in (0, 1, 2, 3, 3, 3)]


def test_a_mesh_that_occurs_once_costs_no_instance(renderer):
    alone = csm.Scene([GROUND, post()], world_from_instance=[np.eye(4), TRANSFORMS["turned"][0]])
    frame = renderer.render(alone, CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
    baked = renderer.render(flat(alone), CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
    assert frame.info["scene_bytes"] == baked.info["scene_bytes"]
    assert_same_bits(frame, baked)


# -- order -----------------------------------------------------------------------------------------


def many_boxes(seed=3, count=150):
    """A mesh of more triangles than any chunk holds: boxes in a cloud over the ground."""
    rng = np.random.default_rng(seed)
    corners = rng.integers(-64, 64, (count, 3)) / 8 + (0, 9, 0)
    sides = rng.integers(1, 8, (count, 3)) / 8
    parts = [box(low, low + side) for low, side in zip(corners, sides, strict=True)]
    return csm.Mesh(*join(*parts), "boxes")


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_triangles_shows_in_no_bit(renderer, evidence, seed):
    mesh = many_boxes()
    order = np.random.default_rng(seed).permutation(len(mesh.triangles))
    shuffled = csm.Mesh(mesh.positions, mesh.triangles[order])
    first, second = (
        renderer.render(scene_of(one, placed((np.eye(3), (0, 0, 0)))), CAMERA, SUN, SETTINGS,
                        outputs=OUTPUTS)
        for one in (mesh, shuffled)
    )  # fmt: skip
    assert_shows_shadows(first)
    evidence(rendered=second.mask, reference=first.mask, settings=SETTINGS)
    assert_same_bits(first, second)


def test_the_numbers_of_vertices_show_in_no_bit(renderer):
    mesh = many_boxes()
    order = np.random.default_rng(9).permutation(len(mesh.positions))
    renumbered = csm.Mesh(mesh.positions[order], np.argsort(order)[mesh.triangles])
    first, second = (
        renderer.render(csm.Scene([GROUND, one]), CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
        for one in (mesh, renumbered)
    )
    assert_same_bits(first, second)


def test_how_triangles_are_shared_among_meshes_shows_in_no_bit(renderer):
    mesh = many_boxes()
    thirds = [csm.Mesh(mesh.positions, part) for part in np.array_split(mesh.triangles, 3)]
    whole, parts = (
        renderer.render(csm.Scene(meshes), CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
        for meshes in ([GROUND, mesh], [thirds[1], GROUND, thirds[2], thirds[0]])
    )
    assert_same_bits(whole, parts)


# -- chunks ----------------------------------------------------------------------------------------


def test_chunks_are_drawn_or_culled_and_triangles_counted(renderer):
    scene = scene_of(
        many_boxes(count=400), placed(*((np.eye(3), (x, 0, -x)) for x in (-40, 0, 40)))
    )
    everything = renderer.render(scene, CAMERA, SUN, SETTINGS).info
    assert everything["triangles_drawn"] == [scene.triangle_count] * 2
    assert everything["chunks_culled"] == [0, 0]
    culled = renderer.render(scene, CAMERA, SUN, SETTINGS.replace(cull="inclusive")).info
    assert culled["chunks"] == everything["chunks"] > 3
    for drawn, dropped in zip(culled["chunks_drawn"], culled["chunks_culled"], strict=True):
        assert drawn + dropped == culled["chunks"]
    assert sum(culled["chunks_culled"]) > culled["chunks"] / 2
    for triangles in culled["triangles_drawn"]:
        assert 0 < triangles < scene.triangle_count


@pytest.mark.parametrize("count", [383, 384, 385, 768, 769])
def test_no_triangle_is_lost_at_the_end_of_a_chunk(renderer, count):
    # a row of strips, each two triangles high; every one of them is seen from above
    x = np.arange(count)
    left, right = 0.0625 * x, 0.0625 * (x + 1)
    zero = np.zeros(count)
    positions = np.stack(
        [np.stack([left, zero, zero - 2], -1), np.stack([left, zero, zero + 2], -1),
         np.stack([right, zero, zero], -1)], axis=1,
    )  # fmt: skip
    scene = csm.Scene.from_arrays(positions.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    width = 2 * math.ceil(count / 2)
    camera = csm.Camera.orthographic(
        (0.03125 * width, 5, 0), (0.03125 * width, 0, 0), up=(0, 0, -1), height=0.0625, far=9,
        size=(width, 1),
    )  # fmt: skip
    frame = renderer.render(scene, camera, csm.Sun((0, 1, 0)), SETTINGS, outputs=("valid",))
    assert frame.valid.sum() == count


# -- planes ----------------------------------------------------------------------------------------


def test_r1_triangles_without_area_change_nothing(renderer):
    mesh = many_boxes()
    degenerate = np.array([[0, 0, 1], [5, 5, 5], [2, 9, 2]], np.int32)
    line = csm.Mesh(
        np.concatenate([mesh.positions, [(-3, 1, 0), (0, 1, 0), (3, 1, 0)]]),
        np.concatenate([degenerate, mesh.triangles, [np.arange(3) + len(mesh.positions)]]),
    )
    first, second = (
        renderer.render(csm.Scene([GROUND, one]), CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
        for one in (mesh, line)
    )
    assert np.isfinite(second.normal).all()
    assert_same_bits(first, second)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6, 1e12])
def test_normals_are_unit_and_towards_the_camera_at_every_scale(renderer, scale):
    mesh = csm.scenes.plane_and_box().flatten()
    scene = csm.Scene.from_arrays(mesh[0] * scale, mesh[1])
    camera = csm.Camera.look_at(
        np.array((6, 4.5, 8)) * scale, np.array((0, 0.5, 0)) * scale,
        near=0.1 * scale, far=100 * scale, size=(48, 27),
    )  # fmt: skip
    frame = renderer.render(scene, camera, SUN, SETTINGS, outputs=OUTPUTS)
    seen = frame.normal[frame.valid].astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(seen, axis=1), 1.0, atol=1e-6)
    height, width = frame.valid.shape
    rows, columns = np.nonzero(frame.valid)
    side = (2 * (columns + 0.5) / width - 1)[:, None] * camera.half_width * camera.right
    rise = (1 - 2 * (rows + 0.5) / height)[:, None] * camera.half_height * camera.up
    assert ((seen * (side + rise - camera.backward)).sum(axis=1) < 0).all()
    assert set(map(tuple, np.abs(seen).round(5))) == {(1, 0, 0), (0, 1, 0), (0, 0, 1)}
    assert 0.01 < (frame.mask == 0)[frame.valid].mean() < 0.9


def extreme_view(rng):
    """A scene of random triangles, a camera, a sun and settings, of any size and anywhere; None
    where one is refused (a light window too far away for doubles, say)."""
    size, away = 10.0 ** rng.integers(-12, 17), 10.0 ** rng.integers(-6, 16) * rng.integers(2)
    count = rng.integers(3, 40)
    positions = rng.normal(size=(count, 3)) * size + rng.normal(size=3) * away
    mesh = csm.Mesh(positions, rng.integers(0, count, (rng.integers(1, 60), 3)))
    transforms = placed(
        *((rng.normal(size=(3, 3)) * 10.0 ** rng.integers(-8, 8), rng.normal(size=3) * size)
          for _ in range(rng.integers(1, 4)))
    )  # fmt: skip
    try:
        scene = csm.Scene([mesh], [0] * len(transforms), transforms)
        middle, extent = scene.bounds.mean(axis=0), np.ptp(scene.bounds, axis=0).max()
        near = extent * 10.0 ** rng.integers(-6, 1)
        camera = csm.Camera.look_at(
            middle + rng.normal(size=3) * extent * 10.0 ** rng.integers(-2, 3),
            middle + rng.normal(size=3) * size,
            fov_y_deg=rng.uniform(0.01, 179), near=near, far=near * 10 ** rng.uniform(2, 9),
            size=(13, 9),
        )  # fmt: skip
        settings = SETTINGS.replace(
            map_size=int(rng.integers(4, 70)), snap=str(rng.choice(["exact", "none"])),
            fit=str(rng.choice(["sphere", "box", "diameter", "scene"])),
            cull=str(rng.choice(["inclusive", "none"])), pancake=bool(rng.integers(2)),
        )  # fmt: skip
        sun = csm.Sun(rng.normal(size=3))
        csm.fit_cascades(camera, sun, settings, scene=scene)
    except ValueError:
        return None
    return scene, camera, sun, settings


def test_r1_scenes_of_any_size_and_place_give_numbers(renderer):
    rng = np.random.default_rng(0)
    views = [view for view in (extreme_view(rng) for _ in range(100)) if view]
    assert len(views) > 50
    seen = 0
    for view in views:
        frame = renderer.render(*view, outputs=OUTPUTS)
        assert np.isfinite(frame.normal).all()
        assert np.isfinite(frame.view_depth[frame.valid]).all()
        assert np.isin(frame.mask, (0, 1)).all()
        assert np.isin(frame.cascade_index, (0, 1, 255)).all()
        assert ((frame.shadow_maps >= 0) & (frame.shadow_maps <= 1)).all()
        seen += frame.valid.any()
    assert seen > 20


# -- life ------------------------------------------------------------------------------------------


def test_a_scene_is_uploaded_once_and_freed_with_its_last_reference(renderer):
    scene = scene_of(post(), TRANSFORMS["moved"])
    renderer.render(scene, CAMERA, SUN, SETTINGS)
    live = renderer.info["live_objects"]
    other_camera = CAMERA.translated((1, 0, 0))
    renderer.render(scene, other_camera, SUN, SETTINGS)
    assert renderer.info["live_objects"] == live
    frame = renderer.render(scene, CAMERA, SUN, SETTINGS)
    del scene
    gc.collect()
    assert renderer.info["live_objects"] < live
    assert frame.mask.shape == (54, 96), "frames hold nothing of the scene"


def test_arrays_may_change_after_a_scene_is_made(renderer):
    positions, triangles = post().positions.copy(), post().triangles.copy()
    scene = csm.Scene([GROUND, csm.Mesh(positions, triangles)])
    before = renderer.render(scene, CAMERA, SUN, SETTINGS, outputs=OUTPUTS)
    positions += 100
    triangles[:] = 0
    assert_same_bits(before, renderer.render(scene, CAMERA, SUN, SETTINGS, outputs=OUTPUTS))
