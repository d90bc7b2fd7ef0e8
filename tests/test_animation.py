"""Poses of animated glTF: against closed forms, a slow second implementation, and invariants."""

import pickle

import numpy as np
import pytest
from gltf_files import TRIANGLE, Builder
from scene_files import load_scene, scene_path

import csm
from csm.animation import Track, read_animation, sample_track
from csm.gltf import read_gltf
from csm.scene import Scene

pytest.importorskip("trimesh")
spatial = pytest.importorskip("scipy.spatial.transform")

FACE = np.array([[0, 1, 2]], np.uint16)
HALF = np.sqrt(0.5)


def moving(path="translation", interpolation="LINEAR", times=(0.0, 1.0, 3.0), values=None, **node):
    """A file with one triangle whose node has one animated property in the clip ``move``."""
    builder = Builder()
    number = builder.node(mesh=builder.mesh(TRIANGLE, FACE), **node)
    values = np.array([[0, 0, 0], [1, 0, 0], [1, 4, 0]]) if values is None else values
    sampler = {
        "input": builder.accessor(np.array(times, np.float32)),
        "output": builder.accessor(np.array(values, np.float32)),
        "interpolation": interpolation,
    }
    target = {"node": number, "path": path}
    builder.header["animations"] = [
        {"name": "move", "channels": [{"sampler": 0, "target": target}], "samplers": [sampler]}
    ]
    return builder


def track(path, values, interpolation="LINEAR", times=(0.0, 1.0, 3.0)):
    return Track(0, path, np.array(times), np.array(values, np.float64), interpolation)


# ---------------------------------------------------------------------------------------- sampling


@pytest.mark.parametrize(
    ("interpolation", "seconds", "expected"),
    [
        ("LINEAR", 0.25, [0.25, 0, 0]),
        ("LINEAR", 2.0, [1, 2, 0]),
        ("LINEAR", 3.0, [1, 4, 0]),
        ("LINEAR", -1.0, [0, 0, 0]),
        ("LINEAR", 9.0, [1, 4, 0]),
        ("STEP", 0.99, [0, 0, 0]),
        ("STEP", 1.0, [1, 0, 0]),
        ("STEP", 2.9, [1, 0, 0]),
        ("STEP", 3.0, [1, 4, 0]),
    ],
)
def test_steps_and_lines(interpolation, seconds, expected):
    values = [[0, 0, 0], [1, 0, 0], [1, 4, 0]]
    got = sample_track(track("translation", values, interpolation), seconds)
    assert np.allclose(got, expected, atol=1e-15)


@pytest.mark.parametrize("seconds", np.linspace(0, 3, 13).tolist())
def test_a_cubic_is_reproduced(seconds):
    # A Hermite spline with the exact slopes at its ends is the cubic itself.
    def curve(t):
        return np.array([t**3 - 2 * t, 4.0 - t**2, 0.5 * t])

    def slope(t):
        return np.array([3 * t**2 - 2, -2 * t, 0.5])

    values = [[slope(t), curve(t), slope(t)] for t in (0.0, 1.0, 3.0)]
    got = sample_track(track("translation", values, "CUBICSPLINE"), seconds)
    assert np.allclose(got, curve(seconds), atol=1e-14)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_rotation_turns_at_a_constant_rate_the_shorter_way(share, sign):
    random = np.random.default_rng(6)
    start, end = random.normal(size=(2, 4))
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    end = np.copysign(1.0, start @ end) * end
    got = sample_track(track("rotation", [start, sign * end], times=(0.0, 2.0)), 2.0 * share)
    assert np.linalg.norm(got) == pytest.approx(1, abs=1e-15)
    between = spatial.Slerp([0, 1], spatial.Rotation.from_quat([start, end]))(share)
    assert np.allclose(spatial.Rotation.from_quat(got).as_matrix(), between.as_matrix(), atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-5])
def test_tiny_rotations_keep_their_digits(angle):
    end = [np.sin(angle / 2), 0, 0, np.cos(angle / 2)]
    got = sample_track(track("rotation", [[0, 0, 0, 1], end], times=(0.0, 1.0)), 0.25)
    # The sine of an eighth of the angle, to the rounding of the quaternion's entries.
    assert got[0] == pytest.approx(np.sin(angle / 8), abs=1e-16, rel=1e-9)


# ------------------------------------------------------------------------------------- clips, made


def test_node_animation_moves_instances(tmp_path):
    scene = csm.load(moving().save(tmp_path / "a.glb"))
    assert scene.clips == {"move": 3.0}
    assert scene.flatten()[0].tolist() == TRIANGLE.tolist()
    posed = scene.at("move", 2.0)
    assert np.allclose(posed.flatten()[0], TRIANGLE + np.array([1, 2, 0]), atol=1e-7)
    # Meshes are shared: only the matrix has changed.
    assert posed.meshes[0] is scene.meshes[0]
    assert posed.at("move", 0.25).flatten()[0][0].tolist() == [0.25, 0, 0]


@pytest.mark.parametrize(("seconds", "same"), [(3.5, 0.5), (-0.5, 2.5), (3e6 + 1.5, 1.5)])
def test_clips_repeat(tmp_path, seconds, same):
    scene = csm.load(moving().save(tmp_path / "a.glb"))
    assert np.allclose(
        scene.at("move", seconds).flatten()[0], scene.at("move", same).flatten()[0], atol=1e-6
    )


def test_the_last_key_frame_can_be_seen(tmp_path):
    scene = csm.load(moving().save(tmp_path / "a.glb"))
    assert scene.at("move", 3.0).flatten()[0][0].tolist() == [1, 4, 0]


def test_children_follow_and_the_georeference_is_exact(tmp_path):
    builder = moving(
        "rotation", values=[[0, 0, 0, 1], [0, HALF, 0, HALF], [0, 1, 0, 0]], name="hub"
    )
    hub = builder.header["nodes"][0]
    hub["children"] = [builder.node(mesh=0, translation=[10, 0, 0])]
    builder.node(children=[0], translation=[78642.0, 2.0, -457941.0], name="georeference")
    scene = csm.load(builder.save(tmp_path / "a.glb"))
    assert scene.georeference.tolist() == [78642.0, 2.0, -457941.0]
    assert len(scene.meshes) == 1
    assert len(scene.instance_mesh) == 2
    posed = scene.at("move", 1.0)  # 90 degrees about y: +x goes to -z
    positions = posed.flatten(scene.georeference)[0]
    assert np.allclose(positions[3], [0, 0, -10], atol=1e-6)
    assert np.array_equal(posed.origin, scene.origin)


def test_posed_scenes_merge_and_move(tmp_path):
    scene = csm.load(moving().save(tmp_path / "a.glb"))
    whole = scene.placed((100, 0, 0), scale=2).with_ground(-1).merge(scene.at("move", 3.0))
    posed = whole.at("move", 1.0)
    assert posed.triangle_count == 1 + 2 + 1
    positions = posed.flatten()[0]
    assert np.allclose(
        positions[:3], 100 * np.array([1, 0, 0]) + 2 * (TRIANGLE + np.array([1, 0, 0]))
    )
    assert np.array_equal(positions[3:7], whole.flatten()[0][3:7])
    assert np.allclose(positions[7:], TRIANGLE + np.array([1, 0, 0]))
    assert pickle.loads(pickle.dumps(whole)).at("move", 1.0).flatten()[0].tolist() == (
        positions.tolist()
    )


def skinned():
    """Two joints, the second 1 over the first; three vertices bound to one, both and the other."""
    builder = Builder()
    mesh = builder.mesh(np.array([[0.0, 0, 0], [0, 1, 0], [0, 2, 0]]), FACE)
    attributes = builder.header["meshes"][mesh]["primitives"][0]["attributes"]
    joints = np.array([[0, 1, 0, 0]] * 3, np.uint8)
    weights = np.array([[255, 0, 0, 0], [51, 204, 0, 0], [0, 255, 0, 0]], np.uint8)
    attributes["JOINTS_0"] = builder.accessor(joints)
    attributes["WEIGHTS_0"] = builder.accessor(weights, normalized=True)
    upper = builder.node(translation=[0, 1, 0])
    lower = builder.node(children=[upper])
    # The mesh node's own transform must be ignored (glTF 2.0, section 3.7.3.3).
    builder.node(mesh=mesh, skin=0, translation=[50, 0, 0])
    bind = np.tile(np.eye(4), (2, 1, 1))
    bind[1, 1, 3] = -1.0
    builder.header["skins"] = [
        {"joints": [lower, upper], "inverseBindMatrices": builder.accessor(bind)}
    ]
    values = [[0, 0, 0, 1], [0, 0, HALF, HALF]]
    builder.header["animations"] = [
        {
            "channels": [{"sampler": 0, "target": {"node": upper, "path": "rotation"}}],
            "samplers": [
                {
                    "input": builder.accessor(np.array([0, 2.0])),
                    "output": builder.accessor(np.array(values)),
                }
            ],
        }
    ]
    return builder


def test_skin_bends_at_its_joint(tmp_path):
    scene = csm.load(skinned().save(tmp_path / "a.glb"))
    assert scene.clips == {"clip_0": 2.0}
    rest, bent = scene.flatten()[0], scene.at("clip_0", 2.0).flatten()[0]
    assert np.allclose(rest, [[0, 0, 0], [0, 1, 0], [0, 2, 0]], atol=1e-7)
    # The upper joint turns by 90 degrees about z at (0, 1, 0): the tip goes to (-1, 1, 0).
    assert np.allclose(bent, [[0, 0, 0], [0, 1, 0], [-1, 1, 0]], atol=1e-7)
    half = scene.at("clip_0", 1.0).flatten()[0]
    assert np.allclose(half[2], [-HALF, 1 + HALF, 0], atol=1e-7)


def test_a_skin_without_clips_stands_in_its_rest_pose(tmp_path):
    builder = skinned()
    del builder.header["animations"]
    builder.header["nodes"][1]["translation"] = [0, 0, 7]
    scene = csm.load(builder.save(tmp_path / "a.glb"))
    assert scene.clips == {}
    assert np.allclose(scene.flatten()[0][:, 2], 7, atol=1e-6)


# ------------------------------------------------------------------------------------------ the fox


def slow_pose(document, clip, seconds):
    """Skinned vertices of the fox, a vertex and a joint at a time, rotations by scipy."""
    nodes = document.header["nodes"]
    local = []
    for node in nodes:
        matrix = np.eye(4)
        matrix[:3, :3] = spatial.Rotation.from_quat(node.get("rotation", [0, 0, 0, 1])).as_matrix()
        matrix[:3, 3] = node.get("translation", [0, 0, 0])
        local.append(matrix)
    for item in document.header["animations"]:
        if item["name"] != clip:
            continue
        for channel in item["channels"]:
            sampler = item["samplers"][channel["sampler"]]
            times = document.accessor(sampler["input"])
            values = document.accessor(sampler["output"])
            matrix = local[channel["target"]["node"]]
            clamped = min(max(seconds, times[0]), times[-1])
            if channel["target"]["path"] == "rotation":
                slerp = spatial.Slerp(times, spatial.Rotation.from_quat(values))
                matrix[:3, :3] = slerp(clamped).as_matrix()
            else:
                assert channel["target"]["path"] == "translation"
                columns = [np.interp(clamped, times, column) for column in values.T]
                matrix[:3, 3] = columns
    parent = {child: n for n, node in enumerate(nodes) for child in node.get("children", [])}

    def world(number):
        return (world(parent[number]) if number in parent else np.eye(4)) @ local[number]

    skin = document.header["skins"][0]
    inverse_bind = document.accessor(skin["inverseBindMatrices"])
    joints = [
        world(node) @ inverse_bind[i].reshape(4, 4).T for i, node in enumerate(skin["joints"])
    ]
    attributes = document.header["meshes"][0]["primitives"][0]["attributes"]
    positions, indices, weights = (
        document.accessor(attributes[name]) for name in ("POSITION", "JOINTS_0", "WEIGHTS_0")
    )
    out = np.zeros_like(positions)
    for vertex in range(0, len(positions), 7):
        bound = sum(w * joints[j] for w, j in zip(weights[vertex], indices[vertex], strict=True))
        out[vertex] = (bound @ np.append(positions[vertex], 1.0))[:3] / weights[vertex].sum()
    return out


@pytest.mark.parametrize("clip", ["Survey", "Walk", "Run"])
def test_fox_agrees_with_the_slow_pose(clip):
    scene = load_scene("fox_animated")
    document = read_gltf(scene_path("fox_animated.glb"))
    for share in (0.0, 0.13, 0.77, 1.0):
        seconds = share * scene.clips[clip]
        got = scene.at(clip, seconds).flatten()[0]
        # Same doubles in another order, lengths of 100 units.
        assert np.abs(got - slow_pose(document, clip, seconds))[::7].max() < 1e-10


def test_fox_at_rest_is_its_bind_pose():
    scene = load_scene("fox_animated")
    bind = scene.parts[0].animation.skins[0].positions
    # Inverse bind matrices are float32: 100 units * 2^-24 * a chain of ten joints.
    assert np.abs(scene.flatten()[0] - bind).max() < 1e-4


@pytest.mark.parametrize("clip", ["Survey", "Walk", "Run"])
def test_fox_clips_are_cycles(clip):
    scene = load_scene("fox_animated")
    duration = scene.clips[clip]
    start, end = scene.at(clip, 0.0).flatten()[0], scene.at(clip, duration).flatten()[0]
    assert np.abs(start - end).max() < 1e-9
    # It moves in between, and continuously: 1 ms apart, nothing jumps by more than 2 units.
    middle = scene.at(clip, 0.5 * duration).flatten()[0]
    assert np.abs(middle - start).max() > 5
    assert np.abs(scene.at(clip, 0.5 * duration + 1e-3).flatten()[0] - middle).max() < 2
    assert np.abs(scene.at(clip, 1.25 * duration).flatten()[0] - scene.at(
        clip, 0.25 * duration).flatten()[0]).max() < 1e-9  # fmt: skip


def test_fox_keeps_origin_views_and_faces():
    scene = load_scene("fox_animated").with_ground(0.0)
    posed = scene.at("Run", 0.4)
    assert np.array_equal(posed.origin, scene.origin)
    assert posed.cameras == scene.cameras
    assert posed.clips == scene.clips
    assert np.array_equal(posed.meshes[0].triangles, scene.meshes[0].triangles)
    assert posed.meshes[1] is scene.meshes[1]


# ------------------------------------------------------------------------------------------- errors


def morphing(builder):
    builder.header["animations"][0]["channels"][0]["target"]["path"] = "weights"


def by_matrix(builder):
    builder.header["nodes"][0]["matrix"] = np.eye(4).ravel().tolist()


def unknown_interpolation(builder):
    builder.header["animations"][0]["samplers"][0]["interpolation"] = "BEZIER"


def missing_node(builder):
    builder.header["animations"][0]["channels"][0]["target"]["node"] = 12


def missing_sampler(builder):
    builder.header["animations"][0]["channels"][0]["sampler"] = 12


def same_buffer_for_both(builder):
    sampler = builder.header["animations"][0]["samplers"][0]
    sampler["output"] = sampler["input"]


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (morphing, "clip 'move' animates 'weights'"),
        (by_matrix, "animates node 0, which is given by a matrix"),
        (unknown_interpolation, "interpolation 'BEZIER'"),
        (missing_node, "nodes has no entry 12"),
        (missing_sampler, r"a\.glb: "),
        (same_buffer_for_both, "a sampler's values must be finite, one per time"),
    ],
)
def test_damaged_clips_are_refused(tmp_path, spoil, text):
    builder = moving()
    spoil(builder)
    with pytest.raises(ValueError, match=text) as caught:
        csm.load(builder.save(tmp_path / "a.glb"))
    assert "a.glb" in str(caught.value)


def test_damaged_times_and_skins_are_refused(tmp_path):
    with pytest.raises(ValueError, match="must ascend"):
        csm.load(moving(times=(0.0, 2.0, 1.0)).save(tmp_path / "a.glb"))
    with pytest.raises(ValueError, match="rotation of length 0"):
        csm.load(moving(rotation=[0, 0, 0, 0]).save(tmp_path / "a.glb"))
    builder = skinned()
    builder.header["skins"][0]["joints"] = [1]
    with pytest.raises(ValueError, match="names joint 1 of 1"):
        csm.load(builder.save(tmp_path / "a.glb"))
    builder = skinned()
    attributes = builder.header["meshes"][0]["primitives"][0]["attributes"]
    attributes["WEIGHTS_0"] = builder.accessor(np.zeros((3, 4)))
    with pytest.raises(ValueError, match="not all 0 for a vertex"):
        csm.load(builder.save(tmp_path / "a.glb"))


def test_unknown_clips_and_times_are_refused(tmp_path):
    scene = csm.load(moving().save(tmp_path / "a.glb"))
    with pytest.raises(ValueError, match=r"one of the scene's clips, 'move' \(got 'run'\)"):
        scene.at("run", 0.0)
    with pytest.raises(ValueError, match="seconds must be a finite time"):
        scene.at("move", float("nan"))


def test_an_unanimated_file_reads_the_same_both_ways(tmp_path):
    # The reader of skins against trimesh, on a hierarchy with every kind of transform.
    builder = Builder()
    mesh = builder.mesh(TRIANGLE, FACE)
    leaf = builder.node(mesh=mesh, rotation=[0.1, 0.7, -0.1, 0.7], scale=[1, 2, -3])
    matrix = np.array([[0, 1, 0, 5], [-1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1.0]])
    middle = builder.node(mesh=mesh, matrix=matrix.T.ravel().tolist(), children=[leaf])
    builder.node(children=[middle], translation=[1e5, 0, -3], rotation=[0, 0, 0.6, 0.8])
    strip = np.random.default_rng(2).uniform(-1, 1, (6, 3))
    builder.node(mesh=builder.mesh(strip, np.arange(6, dtype=np.uint8), mode=5), name="strip")
    path = builder.save(tmp_path / "a.glb")
    scene, animation = csm.load(path), read_animation(read_gltf(path))
    _, world_from_instance = animation.pose()
    own = Scene(animation.meshes, [m for m, _ in animation.instances], world_from_instance)
    areas = []
    for positions, triangles in (scene.flatten(), own.flatten()):
        a, b, c = np.moveaxis(positions[triangles], 1, 0)
        centres = (a + b + c) / 3
        # Centre and facing of every triangle, whichever corner it starts at.
        rows = np.hstack([centres, np.cross(b - a, c - a)]).round(5)
        areas.append(rows[np.lexsort(rows.T)])
    assert np.allclose(*areas, atol=3e-5)
