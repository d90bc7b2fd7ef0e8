"""Meshes and scenes: what they hold, what they refuse, what moving them keeps."""

import gc
import pickle
import weakref

import numpy as np
import pytest

import csm
from csm.scene import Camera, Mesh, Scene, Sun

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
FACE = np.array([[0, 1, 2]])
NAN, INF = float("nan"), float("inf")


def random_scene(seed=3, instances=7):
    """Two random meshes under random affine instances, some of which mirror."""
    random = np.random.default_rng(seed)
    meshes = [
        Mesh(random.normal(size=(n, 3)), random.integers(0, n, (2 * n, 3)), f"m{n}")
        for n in (20, 35)
    ]
    transforms = np.tile(np.eye(4), (instances, 1, 1))
    transforms[:, :3] = random.normal(size=(instances, 3, 4))
    return Scene(meshes, np.arange(instances) % 2, transforms, name="random")


def tetrahedron():
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    return Mesh(positions, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]), "tetrahedron")


def signed_volume(positions, triangles):
    a, b, c = np.moveaxis(positions[triangles], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def project(camera, points):
    """Clip coordinates divided by w, written out from the conventions (not from csm.spaces)."""
    clip = camera.clip_from_view @ camera.view_from_world @ np.append(points, 1.0)
    return clip[:3] / clip[3]


# ------------------------------------------------------------------------------------------- mesh


def test_mesh_copies_and_freezes():
    positions, triangles = TRIANGLE.astype(np.float32)[:, ::-1], FACE.astype(np.uint8)
    mesh = Mesh(positions, triangles, "a")
    positions[0] = triangles[0] = 99
    assert mesh.positions.dtype == np.float64
    assert mesh.triangles.dtype == np.int32
    assert mesh.positions.flags.c_contiguous
    assert mesh.positions.max() == 1.0
    assert mesh.triangles.tolist() == [[0, 1, 2]]
    for array in (mesh.positions, mesh.triangles):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(AttributeError):
        mesh.name = "b"


@pytest.mark.parametrize(
    ("positions", "triangles", "error", "text"),
    [
        ([[0, 0, NAN], [0, 1, 0], [1, 0, 0]], FACE, ValueError, r"finite \(vertex 0 is .*nan"),
        ([[0, 0, 0], [0, INF, 0], [1, 0, 0]], FACE, ValueError, r"finite \(vertex 1 is .*inf"),
        (TRIANGLE[:, :2], FACE, ValueError, r"positions must be \(n, 3\) \(got shape \(3, 2\)"),
        (TRIANGLE.ravel(), FACE, ValueError, r"\(got shape \(9,\)"),
        (TRIANGLE.astype(complex), FACE, TypeError, "real numbers .*complex"),
        ([["a", "b", "c"]], FACE, TypeError, "real numbers"),
        ([[1, 2], [3]], FACE, TypeError, "positions must be an array"),
        (TRIANGLE, FACE.astype(float), TypeError, "integers .*float64"),
        (TRIANGLE, FACE > 0, TypeError, "integers .*bool"),
        (TRIANGLE, FACE[:, :2], ValueError, r"\(m, 3\) \(got shape \(1, 2\)"),
        (TRIANGLE, FACE[:0], ValueError, "at least one row"),
        (TRIANGLE, FACE + 1, ValueError, r"indices from 0 to 2 \(got 3\)"),
        (TRIANGLE, FACE - 1, ValueError, r"indices from 0 to 2 \(got -1\)"),
        (TRIANGLE, np.array([[0, 1, 2**40]]), ValueError, r"0 to 2 \(got 1099511627776\)"),
        (np.zeros((0, 3)), FACE, ValueError, "indices from 0 to -1"),
    ],
)
def test_mesh_refuses(positions, triangles, error, text):
    with pytest.raises(error, match=text):
        Mesh(positions, triangles)


def test_mesh_names_itself_in_errors():
    with pytest.raises(ValueError, match="of mesh 'hull' must hold indices"):
        Mesh(TRIANGLE, FACE + 1, "hull")


# ------------------------------------------------------------------------------------------ scene


def test_scene_counts_and_bounds():
    scene = random_scene()
    assert scene.triangle_count == 4 * 40 + 3 * 70
    assert scene.stored_triangle_count == 110
    drawn = []
    for number, matrix in zip(scene.instance_mesh, scene.world_from_instance, strict=True):
        mesh = scene.meshes[number]
        corners = mesh.positions[np.unique(mesh.triangles)]
        drawn.append((matrix @ np.column_stack([corners, np.ones(len(corners))]).T).T[:, :3])
    drawn = np.concatenate(drawn)
    assert np.allclose(scene.bounds, [drawn.min(0), drawn.max(0)], rtol=1e-14, atol=1e-14)


def test_vertices_of_no_triangle_do_not_count():
    scene = Scene.from_arrays(np.vstack([TRIANGLE, [1e6, 0, 0]]), FACE)
    assert scene.bounds.tolist() == [[0, 0, 0], [1, 1, 0]]


def test_flatten_bakes_instances_and_flips_mirrored_faces():
    mirror = np.diag([-1.0, 2, 1, 1])
    turned = np.array([[0.0, 0, 1, 5], [0, 1, 0, 6], [-1, 0, 0, 7], [0, 0, 0, 1]])
    scene = Scene([tetrahedron()], [0, 0], np.stack([mirror, turned]))
    positions, triangles = scene.flatten()
    assert positions.dtype == np.float64
    assert triangles.dtype == np.int32
    assert positions[:4].tolist() == (tetrahedron().positions * [-1, 2, 1]).tolist()
    assert positions[5].tolist() == [5, 6, 6]
    # Outside stays outside: both volumes are positive, 2/6 and 1/6.
    first, second = triangles[:4], triangles[4:]
    assert first.max() == 3
    assert second.min() == 4
    assert signed_volume(positions, first) == pytest.approx(2 / 6, rel=1e-14)
    assert signed_volume(positions - [5, 6, 7], second) == pytest.approx(1 / 6, rel=1e-14)


@pytest.mark.parametrize("offset", [(0, 0, 0), (78642, 2, -457941), (1e8, -3e7, 2**31)])
def test_moved_by_whole_metres_the_relative_positions_keep_their_bits(offset):
    # What the GPU and the truth see: float32 relative to the scene's origin. A scene of float32
    # positions (24 bits, so doubles hold them at 1e8 to 1e-8 m) under a translation.
    random = np.random.default_rng(5)
    positions = random.uniform(-300, 500, (200, 3)).astype(np.float32)
    triangles = random.integers(0, 200, (300, 3))
    here = Scene.from_arrays(positions, triangles)
    there = here.placed(offset)
    assert (there.origin - here.origin).tolist() == list(map(float, offset))
    a, b = (scene.flatten(scene.origin)[0].astype(np.float32) for scene in (here, there))
    assert np.array_equal(a, b)
    assert np.abs(here.origin - here.bounds.mean(axis=0)).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("extent", [1e-3, 0.7, 30.0, 5e4, 1e7])
def test_origin_is_near_the_centre_of_scenes_of_any_size(extent):
    random = np.random.default_rng(11)
    positions = random.uniform(-0.3, 0.7, (30, 3)) * extent
    scene = Scene.from_arrays(positions, random.integers(0, 30, (20, 3)))
    size = (scene.bounds[1] - scene.bounds[0]).max()
    # Half a step of at most 1 m and at most 1/1024 of the extent.
    away = np.abs(scene.origin - scene.bounds.mean(axis=0)).max()
    assert away <= min(0.5, size / 2048) * (1 + 1e-9)


def test_flatten_relative_is_flatten_minus_the_point():
    scene = random_scene()
    point = np.array([10.0, -3.0, 2.0])
    assert np.allclose(scene.flatten(point)[0], scene.flatten()[0] - point, atol=1e-13)


def test_merge_shares_meshes_and_keeps_instances():
    tree, cameras = Scene([tetrahedron()]), {"a": Camera.look_at((0, 0, 5), (0, 0, 0))}
    other = random_scene().replace(cameras=cameras, suns={"s": Sun((0, 1, 0))})
    copies = [tree.placed((x, 0, 0), scale=2, turn_deg=30 * x) for x in range(3)]
    wood = Scene.merge(*copies, other)
    assert len(wood.meshes) == 3
    assert wood.stored_triangle_count == 4 + 110
    assert wood.triangle_count == 12 + other.triangle_count
    assert list(wood.cameras) == ["a"]
    assert list(wood.suns) == ["s"]
    parts = [scene.flatten() for scene in (*copies, other)]
    positions, triangles = wood.flatten()
    assert np.array_equal(positions, np.concatenate([p for p, _ in parts]))
    expected = [p[t] for p, t in parts]
    assert np.array_equal(positions[triangles], np.concatenate(expected))
    assert copies[0].merge(copies[1]).triangle_count == 8
    twice = other.merge(other.replace(cameras={"a": cameras["a"].translated((1, 0, 0))}))
    assert twice.cameras["a"] == cameras["a"]
    with pytest.raises(TypeError, match=r"merge takes csm\.Scene"):
        Scene.merge(tree, "tree")


def test_ground_lies_under_the_scene_and_faces_up():
    scene = random_scene().replace(suns={"s": Sun((0, 1, 0))})
    grounded = scene.with_ground(-7.5)
    assert grounded.triangle_count == scene.triangle_count + 2
    assert list(grounded.suns) == ["s"]
    positions, triangles = grounded.flatten()
    a, b, c = np.moveaxis(positions[triangles[-2:]], 1, 0)
    normals = np.cross(b - a, c - a)
    assert (normals[:, 1] > 0).all()
    assert np.abs(normals[:, [0, 2]]).max() == 0
    corners = positions[-4:]
    assert (corners[:, 1] == -7.5).all()
    extent = (scene.bounds[1] - scene.bounds[0]).max()
    assert np.allclose(np.ptp(corners, axis=0)[[0, 2]], 4 * extent, rtol=1e-14)
    assert np.allclose(corners.mean(axis=0)[[0, 2]], scene.bounds.mean(axis=0)[[0, 2]], atol=1e-12)
    assert np.ptp(scene.with_ground(0, size=3).flatten()[0][-4:, 0]) == pytest.approx(3)
    with pytest.raises(ValueError, match="y must be a finite height"):
        scene.with_ground(NAN)
    with pytest.raises(ValueError, match="size must be > 0"):
        scene.with_ground(0, size=0)


def test_placed_moves_the_views_along():
    camera = Camera.look_at((2, 3, 9), (0, 1, 0), near=0.5, far=80, size=(320, 200))
    flat = Camera.orthographic((2, 3, 9), (0, 1, 0), height=7, near=0.5, far=80, size=(320, 200))
    scene = random_scene().replace(cameras={"p": camera, "o": flat}, suns={"s": Sun((1, 2, 3))})
    placed = scene.placed((100, -20, 3), scale=0.01, turn_deg=57)
    before, after = scene.flatten()[0], placed.flatten()[0]
    # Every point is seen at the same pixel and depth: clip coordinates of lengths up to 100.
    for name in ("p", "o"):
        for i in range(0, len(before), 17):
            assert np.allclose(
                project(scene.cameras[name], before[i]),
                project(placed.cameras[name], after[i]),
                rtol=1e-9,
                atol=1e-9,
            )
    # The angle between the sun and any edge is kept; +z turns towards +x.
    edge, moved = before[1] - before[0], (after[1] - after[0]) / 0.01
    assert moved @ placed.suns["s"].to_light == pytest.approx(edge @ scene.suns["s"].to_light)
    turned = Scene.from_arrays([[0, 0, 1], [1, 0, 0], [0, 1, 0]], FACE).placed(turn_deg=90)
    assert turned.flatten()[0].tolist() == [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    with pytest.raises(ValueError, match="scale"):
        scene.placed(scale=0)


def test_scene_is_immutable_hashable_and_collected():
    scene = random_scene().replace(suns={"s": Sun((0, 1, 0))})
    with pytest.raises(AttributeError):
        scene.name = "other"
    for array in (scene.bounds, scene.origin, scene.world_from_instance, scene.instance_mesh):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(TypeError):
        scene.suns["t"] = Sun((0, 1, 0))
    assert len({scene, scene.replace(), scene}) == 2
    reference = weakref.ref(scene)
    del scene, array
    gc.collect()
    assert reference() is None


def test_scene_pickles():
    scene = csm.scenes.plane_and_box().with_ground(-3)
    copy = pickle.loads(pickle.dumps(scene))
    assert copy.cameras == dict(scene.cameras)
    assert copy.suns == dict(scene.suns)
    for a, b in zip(copy.flatten(), scene.flatten(), strict=True):
        assert np.array_equal(a, b)
    for array in (copy.bounds, copy.world_from_instance, copy.meshes[0].positions):
        assert not array.flags.writeable
    with pytest.raises(TypeError):
        copy.cameras["x"] = None


EYE = np.eye(4)[None]
BAD_ROW = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]])[None]


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        (([],), ValueError, "at least one mesh"),
        ((["mesh"],), TypeError, "csm.Mesh objects .got str"),
        (([tetrahedron()], [0, 1]), ValueError, r"instance_mesh must be 0 to 0 \(got 1\)"),
        (([tetrahedron()], [-1]), ValueError, r"instance_mesh must be 0 to 0 \(got -1\)"),
        (([tetrahedron()], [0.0]), TypeError, "instance_mesh must be .k,. integers"),
        (([tetrahedron()] * 2, [0, 0]), ValueError, r"mesh 1 has none"),
        (([tetrahedron()], []), TypeError, "instance_mesh must be .k,. integers"),
        (([tetrahedron()], [0], np.eye(4)), ValueError, r"\(1, 4, 4\) \(got shape \(4, 4\)"),
        (([tetrahedron()], [0], EYE * NAN), ValueError, "finite .instance 0"),
        (([tetrahedron()], [0], BAD_ROW), ValueError, "affine"),
        (([tetrahedron()], [0], EYE * [1, 0, 1, 1]), ValueError, "invertible .instance 0"),
        (([tetrahedron()], [0], np.diag([1e200, 1, 1, 1])[None]), ValueError, "at most 1e.18 m"),
    ],
)
def test_scene_refuses(arguments, error, text):
    with pytest.raises(error, match=text):
        Scene(*arguments)


@pytest.mark.parametrize(
    ("changes", "error", "text"),
    [
        ({"cameras": {"a": Sun((0, 1, 0))}}, TypeError, "cameras must map names to csm.Camera"),
        ({"suns": {3: Sun((0, 1, 0))}}, TypeError, "suns must map names to csm.Sun"),
        ({"suns": [Sun((0, 1, 0))]}, TypeError, "suns must be a mapping"),
        ({"georeference": (1, 2)}, ValueError, "georeference must be 3 numbers"),
        ({"name": 3}, TypeError, "name must be a string"),
        ({"meshes": ()}, TypeError, "Scene.replace changes name, cameras"),
    ],
)
def test_scene_replace_refuses(changes, error, text):
    with pytest.raises(error, match=text):
        random_scene().replace(**changes)


def test_tiny_and_huge_instances_are_kept():
    # Singular is judged against the columns' lengths, not absolutely.
    for scale in (1e-100, 1e15):
        matrix = np.diag([scale, scale, scale, 1.0])[None]
        assert Scene([tetrahedron()], [0], matrix).triangle_count == 4


def test_a_still_scene_has_no_clips():
    assert random_scene().clips == {}
    with pytest.raises(ValueError, match=r"not animated.*got 'Walk'"):
        random_scene().at("Walk", 0.5)
