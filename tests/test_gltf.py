"""glTF files that would load wrongly without a word, or are damaged: each is one sentence."""

import numpy as np
import pytest
from gltf_files import TRIANGLE, Builder, one_triangle

import csm
from csm.gltf import read_gltf

pytest.importorskip("trimesh")
FACE = np.array([[0, 1, 2]], np.uint16)


def spoilt(**changes):
    """A builder of one triangle; `changes` are functions of its header's parts, by name."""
    builder = one_triangle()
    for what, change in changes.items():
        change(builder.header[what] if what in builder.header else builder.header)
    return builder


def sparse(accessors):
    accessors[0]["sparse"] = {"count": 1}


def without_buffer(accessors):
    del accessors[0]["bufferView"]


def gpu_instances(nodes):
    nodes[0]["extensions"] = {"EXT_mesh_gpu_instancing": {}}


REFUSED = {
    "sparse positions": (spoilt(accessors=sparse), "POSITION is a sparse accessor"),
    "positions without data": (spoilt(accessors=without_buffer), "accessor 0 has no data"),
    "huge count": (spoilt(accessors=lambda a: a[0].update(count=10**12)), "beyond its buffer view"),
    "offset out of buffer": (spoilt(accessors=lambda a: a[0].update(byteOffset=8)), "beyond its b"),
    "negative offset": (spoilt(accessors=lambda a: a[0].update(byteOffset=-4)), "bad offset"),
    "quantised": (spoilt(accessors=lambda a: a[0].update(componentType=5123)), "must be float"),
    "normalised": (spoilt(accessors=lambda a: a[0].update(normalized=True)), "must be float"),
    "two components": (spoilt(accessors=lambda a: a[0].update(type="VEC2")), "must be VEC3"),
    "unknown type": (spoilt(accessors=lambda a: a[0].update(type="VEC9")), "no valid component"),
    "fan": (spoilt(meshes=lambda m: m[0]["primitives"][0].update(mode=6)), "triangle fans"),
    "lines only": (spoilt(meshes=lambda m: m[0]["primitives"][0].update(mode=1)), "no triangles"),
    "no accessor": (spoilt(meshes=lambda m: m[0]["primitives"][0].update(indices=9)), "no entry 9"),
    "morphed": (spoilt(meshes=lambda m: m[0].update(weights=[0.0, 0.5])), "morph targets"),
    "no nodes": (spoilt(nodes=list.clear), "no triangles"),
    "required extension": (
        spoilt(extensionsRequired=lambda h: h.update(extensionsRequired=["KHR_draco_m"])),
        "requires extensions.*KHR_draco_m",
    ),
    "gpu instances": (spoilt(nodes=gpu_instances), "EXT_mesh_gpu_instancing"),
    "nan transform": (
        spoilt(nodes=lambda n: n[0].update(translation=[0, float("nan"), 0])),
        "fini",
    ),
    "flat transform": (spoilt(nodes=lambda n: n[0].update(scale=[1, 0, 1])), "invertible"),
    "missing mesh": (spoilt(nodes=lambda n: n[0].update(mesh=5)), "meshes has no entry 5"),
    "missing child": (spoilt(nodes=lambda n: n[0].update(children=[8])), "nodes has no entry 8"),
    "cycle": (spoilt(nodes=lambda n: n[0].update(children=[0])), "cycle"),
    "two parents": (
        spoilt(nodes=lambda n: n.extend([{"children": [0]}, {"children": [0]}])),
        "node 0 has two parents",
    ),
    "missing scene": (spoilt(scene=lambda h: h.update(scene=4, scenes=[{}])), "no entry 4"),
    "version 1": (spoilt(asset=lambda a: a.update(version="1.0")), "glTF 2 is read"),
    "network": (
        spoilt(x=lambda h: h.update(buffers=[{"byteLength": 4, "uri": "http://a/b"}])),
        "not from the network",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refuses_what_would_load_wrongly(case, tmp_path):
    builder, text = REFUSED[case]
    path = builder.save(tmp_path / "bad.glb")
    with pytest.raises(ValueError, match=text) as caught:
        csm.load(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("positions", "triangles", "text"),
    [
        (np.where(np.arange(9).reshape(3, 3) == 4, np.nan, TRIANGLE), FACE, "finite .vertex 1"),
        (np.full((3, 3), np.inf, np.float32), FACE, "finite .vertex 0"),
        (TRIANGLE, np.array([[0, 1, 3]], np.uint16), r"from 0 to 2 \(got 3\)"),
        (TRIANGLE, np.array([[0, 1, 2, 0]], np.uint16), "reshape"),
    ],
)
def test_refuses_bad_vertices_and_indices(tmp_path, positions, triangles, text):
    builder = Builder()
    builder.node(mesh=builder.mesh(positions, triangles))
    with pytest.raises(ValueError, match=text) as caught:
        csm.load(builder.save(tmp_path / "bad.glb"))
    assert "bad.glb" in str(caught.value)


def interleaved(stride):
    """One triangle whose rows stand `stride` bytes apart, 99 between them."""
    builder = one_triangle()
    rows = np.full((5, stride // 4), 99, np.float32)
    rows[:3, : min(3, stride // 4)] = TRIANGLE[:, : stride // 4]
    builder.accessor(rows.reshape(-1))
    view = builder.header["accessors"].pop()["bufferView"]
    builder.header["bufferViews"][view]["byteStride"] = stride
    builder.header["accessors"][0]["bufferView"] = view
    return builder


def test_interleaved_rows(tmp_path):
    path = interleaved(28).save(tmp_path / "a.glb")
    assert csm.load(path).flatten()[0].tolist() == TRIANGLE.tolist()
    assert read_gltf(path).accessor(0).tolist() == TRIANGLE.tolist()
    with pytest.raises(ValueError, match="ends beyond its buffer view"):
        csm.load(interleaved(8).save(tmp_path / "b.glb"))


def test_every_truncation_is_one_sentence(tmp_path):
    data = one_triangle().save(tmp_path / "whole.glb").read_bytes()
    path = tmp_path / "cut.glb"
    for length in range(0, len(data), 23):
        path.write_bytes(data[:length])
        with pytest.raises(ValueError, match=r"cut\.glb: .{8}"):
            csm.load(path)


def refusal(path):
    """The error of loading a file, None if it loads; other kinds of errors escape."""
    try:
        csm.load(path)
    except (ValueError, OSError) as error:
        return error
    return None


def test_damaged_bytes_never_escape_as_another_error(tmp_path):
    # One byte at a time: the file loads, or the error says which file.
    data = bytearray(one_triangle().save(tmp_path / "whole.glb").read_bytes())
    path, errors = tmp_path / "damaged.glb", []
    random = np.random.default_rng(8)
    for position in range(0, len(data), 5):
        spoiled = data.copy()
        spoiled[position] = random.integers(256)
        path.write_bytes(spoiled)
        errors.append(refusal(path))
    texts = [str(error) for error in errors if isinstance(error, ValueError)]
    assert len(texts) > 40
    assert all("damaged.glb" in text for text in texts)
