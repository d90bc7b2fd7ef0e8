"""Files to scenes: against the facts beside the test scenes, a second reader, and hostile files."""

import json
import signal
import struct
import subprocess
import sys
import threading
import types

import numpy as np
import pytest
from gltf_files import TRIANGLE, Builder, one_triangle
from scene_files import entries, load_scene, pairs, scene_path

import csm

pytest.importorskip("trimesh")
NAMES = list(entries()) or ["denhaag_lod2"]  # one name skips with its reason
FACE = np.array([[0, 1, 2]], np.uint16)


def read_glb(path):
    """A second reader, for the plain files of the test scenes: meshes, and (mesh, matrix) drawn."""
    data = path.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    header, blob = json.loads(data[20 : 20 + size]), data[28 + size :]

    def array(number, dtype, width):
        accessor = header["accessors"][number]
        view = header["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(blob, dtype, accessor["count"] * width, start).reshape(-1, width)

    meshes = []
    for mesh in header["meshes"]:
        (primitive,) = mesh["primitives"]
        index_type = {5123: "<u2", 5125: "<u4"}[
            header["accessors"][primitive["indices"]]["componentType"]
        ]
        indices = array(primitive["indices"], index_type, 1).reshape(-1, 3)
        meshes.append((array(primitive["attributes"]["POSITION"], "<f4", 3), indices))
    drawn = []

    def visit(number, world):
        node = header["nodes"][number]
        if "matrix" in node:
            local = np.array(node["matrix"]).reshape(4, 4).T
        else:
            assert not {"rotation", "scale"} & set(node) or "mesh" not in node
            local = np.eye(4)
            local[:3, 3] = node.get("translation", (0, 0, 0))
        if "mesh" in node:
            drawn.append((node["mesh"], world @ local))
        for child in node.get("children", []):
            visit(child, world @ local)

    for root in header["scenes"][header["scene"]]["nodes"]:
        visit(root, np.eye(4))
    return meshes, drawn


def drawn_triangles(scene):
    """Corners of every drawn triangle, in an order that does not depend on the file's."""
    positions, triangles = scene.flatten()
    corners = positions[triangles].reshape(len(triangles), 9)
    return corners[np.lexsort(corners.T)]


# ----------------------------------------------------------------------------- the real test files


@pytest.mark.parametrize("name", NAMES)
def test_scene_agrees_with_the_facts_beside_it(name):
    scene, facts = load_scene(name), entries()[name]
    assert scene.triangle_count == facts["triangles"]
    assert scene.stored_triangle_count == facts["unique_triangles"]
    assert len(scene.meshes) == facts["meshes"]
    assert scene.georeference.tolist() == facts["georeference"]
    # The facts are rounded to a millimetre.
    assert np.abs(scene.bounds - scene.georeference - facts["bounds"]).max() <= 5.01e-4
    assert list(scene.cameras) == list(facts["cameras"])
    assert list(scene.suns) == list(facts["suns"])


@pytest.mark.parametrize("name", NAMES)
def test_scene_agrees_with_a_second_reader(name):
    scene = load_scene(name)
    meshes, drawn = read_glb(scene_path(entries()[name]["file"]))
    assert len(drawn) == len(scene.instance_mesh)
    if scene.clips:  # the rest pose of a skin is compared in test_animation
        return
    for number, mesh in enumerate(scene.meshes):
        assert np.array_equal(mesh.positions, meshes[number][0])
        assert np.array_equal(mesh.triangles, meshes[number][1])
    key = lambda item: (int(item[0]), item[1].ravel().tolist())  # noqa: E731
    expected = sorted(drawn, key=key)
    got = sorted(zip(scene.instance_mesh, scene.world_from_instance, strict=True), key=key)
    for (mesh, matrix), (mesh_got, matrix_got) in zip(expected, got, strict=True):
        assert mesh == mesh_got
        assert np.array_equal(matrix, matrix_got)  # the georeference is exact in double


def test_forest_keeps_its_instances():
    scene = load_scene("forest_assembled")
    assert len(scene.instance_mesh) == 1001
    assert len(scene.meshes) == 6
    assert scene.stored_triangle_count == 17_584
    assert scene.triangle_count == 1_797_538


@pytest.mark.parametrize("name", ["denhaag_lod2", "bigtujunga_dem"])
def test_georeference_costs_no_precision(name):
    scene = load_scene(name)
    local, _ = read_glb(scene_path(entries()[name]["file"]))
    assert scene.instance_mesh.tolist() == list(range(len(local)))  # so flatten keeps their order
    relative, _ = scene.flatten(scene.origin)
    # Sums of doubles below 2e4 m, against positions that were at 3.8e6 m on the way.
    expected = np.concatenate([p for p, _ in local]) + (scene.georeference - scene.origin)
    assert np.array_equal(relative.astype(np.float32), expected.astype(np.float32))


def test_views_are_relative_to_the_georeference():
    scene = load_scene("denhaag_lod2")
    facts = entries()["denhaag_lod2"]["cameras"]["street"]
    camera = scene.cameras["street"]
    assert np.array_equal(camera.eye, np.add(facts["eye"], scene.georeference))
    assert camera.fov_y_deg == pytest.approx(facts["fov_y_deg"], abs=1e-12)
    assert (camera.near, camera.far) == (facts["near"], facts["far"])
    forward = np.subtract(facts["at"], facts["eye"])
    assert np.allclose(-camera.backward, forward / np.linalg.norm(forward), atol=1e-15)
    sun = entries()["denhaag_lod2"]["suns"]["winter"]["to_light"]
    assert np.allclose(scene.suns["winter"].to_light, sun / np.linalg.norm(sun), atol=1e-15)


def test_every_pair_names_a_camera_and_a_sun():
    if not pairs():
        pytest.skip("the test scenes are absent")
    assert len(pairs()) == 87
    assert len(pairs(in_means=True)) == 68
    for name, camera, sun in pairs():
        assert camera in entries()[name]["cameras"]
        assert sun in entries()[name]["suns"]


# ------------------------------------------------------------------------------- files made here


def test_node_transforms_compose(tmp_path):
    builder = Builder()
    mesh = builder.mesh(TRIANGLE, FACE)
    leaf = builder.node(mesh=mesh, rotation=[0, np.sqrt(0.5), 0, np.sqrt(0.5)])  # 90 about y
    turned = builder.node(mesh=mesh, translation=[1, 2, 3], scale=[2, -1, 1], children=[leaf])
    builder.node(children=[turned], translation=[1e6, 0, 0], name="georeference")
    scene = csm.load(builder.save(tmp_path / "nodes.glb"))
    assert scene.georeference.tolist() == [1e6, 0, 0]
    assert len(scene.meshes) == 1
    assert scene.name == "nodes"
    corners = {tuple(np.round(row, 9)) for row in scene.flatten()[0]}
    parent = [(1e6 + 1 + 2 * x, 2 - y, 3 + z) for x, y, z in TRIANGLE.tolist()]
    child = [(1e6 + 1 + 2 * z, 2 - y, 3 - x) for x, y, z in TRIANGLE.tolist()]
    assert corners == {*parent, *child}


@pytest.mark.parametrize("index_type", [np.uint8, np.uint16, np.uint32])
def test_index_types_strips_and_plain_lists(tmp_path, index_type):
    strip = np.random.default_rng(1).uniform(-1, 1, (5, 3))
    expected = np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4]])  # glTF 2.0, section 3.7.2.1
    builder = Builder()
    builder.node(mesh=builder.mesh(strip, expected.astype(index_type)))
    as_list = drawn_triangles(csm.load(builder.save(tmp_path / "list.glb")))
    builder = Builder()
    builder.node(mesh=builder.mesh(strip, np.arange(5, dtype=index_type), mode=5))
    as_strip = csm.load(builder.save(tmp_path / "strip.glb"))
    builder = Builder()
    builder.node(mesh=builder.mesh(strip[expected].reshape(-1, 3)))
    plain = drawn_triangles(csm.load(builder.save(tmp_path / "plain.glb")))
    assert np.array_equal(as_list, plain)

    def normals(scene):
        positions, triangles = scene.flatten()
        a, b, c = np.moveaxis(positions[triangles], 1, 0)
        return np.cross(b - a, c - a)

    assert np.allclose(
        normals(as_strip), normals(csm.load(tmp_path / "list.glb")), rtol=1e-6, atol=1e-12
    )


def test_several_primitives_load_in_the_same_order_every_time(tmp_path):
    # trimesh gives such nodes random names; the hash seed must not matter either.
    builder = one_triangle()
    builder.header["meshes"][0]["primitives"] *= 3
    for i in range(4):
        builder.node(mesh=0, translation=[float(i % 3), i, -i])
    path = builder.save(tmp_path / "several.glb")
    code = (
        f"import csm, hashlib; s = csm.load({str(path)!r}); print(hashlib.sha256("
        "s.instance_mesh.tobytes() + s.world_from_instance.tobytes()).hexdigest())"
    )
    answers = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PATH": "/usr/bin"},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    scene = csm.load(path)
    assert len(answers) == 1
    assert scene.triangle_count == 15


def test_gltf_with_buffers_beside_it_and_inside(tmp_path):
    import base64

    builder = one_triangle()
    header = builder._finished_header()
    for uri in ("data.bin", "data:application/octet-stream;base64," +
                base64.b64encode(builder.data).decode()):  # fmt: skip
        header["buffers"] = [{"byteLength": len(builder.data), "uri": uri}]
        (tmp_path / "a.gltf").write_text(json.dumps(header))
        (tmp_path / "data.bin").write_bytes(builder.data)
        scene = csm.load(str(tmp_path / "a.gltf"))
        assert scene.flatten()[0].tolist() == TRIANGLE.tolist()
        (tmp_path / "data.bin").unlink()
    header["buffers"][0]["uri"] = "data.bin"
    (tmp_path / "a.gltf").write_text(json.dumps(header))
    with pytest.raises(OSError, match=r"data\.bin"):
        csm.load(tmp_path / "a.gltf")


OBJ = """v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0.5 1e6\n
g wall\nf 1 2 3 4\ng roof\nf 1/1 2/2 5/3\nvt 0 0\nvt 1 0\nvt 1 1\n"""
PLY = """ply\nformat ascii 1.0\nelement vertex 5\nproperty double x\nproperty double y
property double z\nelement face 2\nproperty list uchar int vertex_indices\nend_header
0 0 0\n1 0 0\n1 1 0\n0 1 0\n0.5 0.5 1000000\n4 0 1 2 3\n3 0 1 4\n"""
STL = """solid s\n{}endsolid s\n""".format(
    "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners)
        + "endloop\nendfacet\n"
        for corners in (
            ((0, 0, 0), (1, 0, 0), (1, 1, 0)),
            ((0, 0, 0), (1, 1, 0), (0, 1, 0)),
            ((0, 0, 0), (1, 0, 0), (0.5, 0.5, 1e6)),
        )
    )
)


@pytest.mark.parametrize(("suffix", "text"), [("obj", OBJ), ("ply", PLY), ("stl", STL)])
def test_other_formats(tmp_path, suffix, text):
    path = tmp_path / f"shape.{suffix}"
    path.write_text(text)
    scene = csm.load(path)
    assert scene.triangle_count == 3
    assert scene.bounds.tolist() == [[0, 0, 0], [1, 1, 1e6]]
    positions, triangles = scene.flatten()
    a, b, c = np.moveaxis(positions[triangles], 1, 0)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # The quad of area 1 and the tall triangle, whose height over its base is hypot(0.5, 1e6).
    assert sorted(areas) == pytest.approx([0.5, 0.5, 0.5 * np.hypot(0.5, 1e6)], rel=1e-9)
    assert scene.cameras == {}


# ------------------------------------------------------------------------------- hostile files


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("empty.glb", b"", "at least 20 bytes|JSON"),
        ("text.glb", b"hello, this is not a glb at all", "JSON"),
        ("empty.obj", b"", "."),
        ("words.obj", b"v a b c\nf 1 2 3\n", "malformed: "),
        ("range.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "malformed: an index, as a face's"),
        ("nan.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
        ("count.ply", PLY.replace("vertex 5", "vertex 900000000000").encode(), "."),
        ("short.stl", b"\0" * 80 + b"\xff\xff\xff\xff", "."),
        ("a.fbx", b"x", r"ends in \.glb, \.gltf, \.obj.*got '\.fbx'"),
        ("a.npz", b"x", "use csm.load_elevation"),
    ],
)
def test_hostile_files_are_refused_by_name(tmp_path, name, content, text):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=text) as caught:
        csm.load(path)
    assert name in str(caught.value)


@pytest.mark.parametrize("load", [csm.load, csm.load_elevation])
def test_missing_files(tmp_path, load):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.glb: no such file"):
        load(tmp_path / "nowhere.glb")
    with pytest.raises(IsADirectoryError, match="is a folder"):
        load(tmp_path)
    with pytest.raises(TypeError, match=r"path must be a path \(got 5\)"):
        load(5)


# ----------------------------------------------------------------------------------- Ctrl-C


def stub_of_trimesh(heard):
    """A trimesh that is interrupted and, like the real one, goes on after any BaseException."""

    def load_scene(*_, **__):
        try:
            signal.raise_signal(signal.SIGINT)
        except BaseException as error:
            heard.append(error)
        raise RuntimeError("the loader fell over")

    return types.SimpleNamespace(load_scene=load_scene)


def test_an_interrupt_that_the_loader_swallows_still_arrives(tmp_path, monkeypatch):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0")
    heard = []
    monkeypatch.setitem(sys.modules, "trimesh", stub_of_trimesh(heard))
    with pytest.raises(KeyboardInterrupt):
        csm.load(path)
    assert heard == []  # so nothing of the loader's work was cut off half-way
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interrupt_during_the_import_of_trimesh_still_arrives(tmp_path, monkeypatch):
    (tmp_path / "trimesh.py").write_text(
        "import signal\n"
        "try:\n    signal.raise_signal(signal.SIGINT)\nexcept BaseException:\n    pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "trimesh")
    (tmp_path / "a.obj").write_text("v 0 0 0")
    with pytest.raises(KeyboardInterrupt):
        csm.load(tmp_path / "a.obj")


def test_the_handler_of_the_program_gets_the_interrupt(tmp_path, monkeypatch):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0")
    monkeypatch.setitem(sys.modules, "trimesh", stub_of_trimesh([]))
    got = []

    def of_the_program(number, frame):
        got.append(number)

    before = signal.signal(signal.SIGINT, of_the_program)
    try:
        # it does not raise, so the loader's own failure is what the caller sees
        with pytest.raises(ValueError, match="the loader fell over"):
            csm.load(path)
        assert signal.getsignal(signal.SIGINT) is of_the_program
    finally:
        signal.signal(signal.SIGINT, before)
    assert got == [signal.SIGINT]


def test_a_file_loads_beside_the_main_thread(tmp_path):
    path = one_triangle().save(tmp_path / "one.glb")
    counts = []
    thread = threading.Thread(target=lambda: counts.append(csm.load(path).triangle_count))
    thread.start()
    thread.join()
    assert counts == [1]


# ------------------------------------------------------------------------------- scenes.json


def beside(tmp_path, entry):
    path = one_triangle().save(tmp_path / "one.glb")
    (tmp_path / "scenes.json").write_text(entry if isinstance(entry, str) else json.dumps(entry))
    return path


CAMERA = {"eye": [0, 0, 9], "at": [0, 0, 0], "fov_y_deg": 50, "near": 0.1, "far": 99}


def test_views_of_a_file_that_is_named(tmp_path):
    sun = {"to_light": [0, 3, 4], "angular_diameter_deg": 0.5}
    entry = {"file": "one.glb", "cameras": {"c": {**CAMERA, "size": [64, 32]}}, "suns": {"s": sun}}
    scene = csm.load(beside(tmp_path, {"x": {"file": "other.glb"}, "one": entry}))
    assert scene.cameras["c"].size == (64, 32)
    assert np.allclose(scene.suns["s"].to_light, [0, 0.6, 0.8], atol=1e-15)
    assert scene.suns["s"].angular_diameter_deg == 0.5
    assert csm.load(beside(tmp_path, {"x": {"file": "other.glb"}})).cameras == {}


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        ("{", "scenes.json"),
        ("[1, 2]", r"the file must be a JSON object of names \(got \[1, 2\]\)"),
        ({"one": 5}, r"entry 'one' must be a JSON object of names \(got 5\)"),
        ({"one": {"file": "one.glb", "cameras": [1]}}, r"cameras must be .*\(got \[1\]\)"),
        ({"one": {"file": "one.glb", "cameras": {"c": 5}}}, "camera 'c' must be a JSON object"),
        ({"one": {"file": "one.glb", "suns": {"s": "up"}}}, "sun 's' must be a JSON object"),
        ({"one": {"file": "one.glb", "cameras": {"c": {"eye": [0, 0, 1]}}}}, "'at' is missing"),
        ({"one": {"file": "one.glb", "cameras": {"c": {**CAMERA, "far": 0.01}}}}, "far must be >"),
        ({"one": {"file": "one.glb", "suns": {"s": {"to_light": [0, 0, 0]}}}}, "zero vector"),
        ({"one": {"file": "one.glb", "georeference": [1, 2, 3]}}, "is not that of one.glb"),
    ],
)
def test_damaged_views_are_refused(tmp_path, entry, text):
    with pytest.raises(ValueError, match=text) as caught:
        csm.load(beside(tmp_path, entry))
    assert "scenes.json" in str(caught.value)
