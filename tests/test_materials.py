"""Cut-outs of glTF files: what is read, what is as if it were not there, what is refused."""

import base64

import numpy as np
import pytest
from cutout_scenes import level, looked_up
from gltf_files import Builder, cut_out_square, png

import csm

pytest.importorskip("trimesh")
ALPHA = np.random.default_rng(9).integers(0, 256, (6, 10), np.uint8)
SUN = csm.Sun((0.2, 1.0, 0.1))


def loaded(builder, tmp_path):
    return csm.load(builder.save(tmp_path / "square.glb"))


def material(builder):
    return builder.header["materials"][0]


def texture_info(builder):
    return material(builder)["pbrMetallicRoughness"]["baseColorTexture"]


def attributes(builder):
    return builder.header["meshes"][0]["primitives"][0]["attributes"]


def test_a_masked_square_comes_whole(tmp_path):
    scene = loaded(cut_out_square(ALPHA), tmp_path)
    (mesh,) = scene.meshes
    assert (mesh.alpha == ALPHA).all()
    assert mesh.alpha.dtype == np.uint8
    assert mesh.uv.tolist() == [[0, 0], [0, 1], [1, 1], [1, 0]]
    assert mesh.alpha_cutoff == 0.5
    assert mesh.name == "mesh"
    assert scene.clips == {}
    assert loaded(cut_out_square(ALPHA, alphaCutoff=0.1), tmp_path).meshes[0].alpha_cutoff == 0.1


def test_a_file_is_rendered_and_traced_as_its_arrays(renderer, tmp_path):
    # the arrays go through nothing that reads files
    camera = csm.Camera.look_at((2, 3, 3), (0, 0.5, 0), near=0.1, far=20, size=(96, 54))
    file = loaded(cut_out_square(ALPHA), tmp_path).with_ground(0.0)
    arrays = csm.Scene([level(1.0, 1.0, alpha=ALPHA)]).with_ground(0.0)
    for of_file, of_arrays in (
        (csm.truth(file, camera, SUN), csm.truth(arrays, camera, SUN)),
        (renderer.render(file, camera, SUN), renderer.render(arrays, camera, SUN)),
    ):
        assert (of_file.mask == of_arrays.mask).all()
        assert (of_file.valid == of_arrays.valid).all()
        assert 0.5 < of_file.mask.mean() < 0.99


@pytest.mark.parametrize("mode", [None, "OPAQUE", "BLEND"])
def test_opaque_and_blend_are_whole(tmp_path, mode):
    builder = cut_out_square(ALPHA)
    material(builder)["alphaMode"] = mode
    if mode is None:
        del material(builder)["alphaMode"]
    assert loaded(builder, tmp_path).meshes[0].alpha is None
    # beside a masked primitive they are read by the same reader, and still whole
    builder.header["materials"].append(cut_out_square(ALPHA).header["materials"][0])
    builder.node(mesh=builder.mesh(np.eye(3, dtype=np.float32)), name="other")
    builder.header["meshes"][1]["primitives"][0].update(
        material=1, attributes={**attributes(builder)}, indices=1
    )
    square, other = loaded(builder, tmp_path).meshes
    assert square.alpha is None
    assert (other.alpha == ALPHA).all()


def test_instances_and_transforms_are_those_of_files_without_cutouts(tmp_path):
    def two(builder):
        builder.header["nodes"][0]["children"] = [
            builder.node(mesh=0, translation=[3, 0, 0], scale=[-1, 2, 1])
        ]
        builder.header["nodes"][0]["rotation"] = [0, 0.6, 0, 0.8]
        builder.node(name="georeference", translation=[1e6, 2e6, 3.0])
        return builder

    masked = loaded(two(cut_out_square(ALPHA)), tmp_path)
    plain = loaded(two(cut_out_square(ALPHA, alphaMode="OPAQUE")), tmp_path)
    assert len(masked.instance_mesh) == 2
    assert len(masked.meshes) == 1
    assert masked.georeference.tolist() == plain.georeference.tolist()
    corners = [scene.flatten()[0][scene.flatten()[1]] for scene in (masked, plain)]
    ordered = [c[np.lexsort(c.reshape(len(c), 9).T)] for c in corners]
    assert np.allclose(*ordered, rtol=0, atol=1e-9)


def test_factor_multiplies_the_image(tmp_path):
    builder = cut_out_square(ALPHA, alphaCutoff=0.3)
    material(builder)["pbrMetallicRoughness"]["baseColorFactor"] = [1, 0, 0, 0.6]
    mesh = loaded(builder, tmp_path).meshes[0]
    assert np.allclose(mesh.alpha, ALPHA / 255 * 0.6, atol=1e-7)
    places = (np.indices((60, 60)).T + 0.5) / 60
    assert (looked_up(mesh, places) == looked_up(level(alpha=ALPHA, cutoff=0.5), places)).all()


@pytest.mark.parametrize(("alpha", "there"), [(0.5, True), (0.49, False), (None, True)])
def test_without_an_image_the_factor_decides(tmp_path, alpha, there):
    builder = cut_out_square(ALPHA)
    material(builder)["pbrMetallicRoughness"] = (
        {} if alpha is None else {"baseColorFactor": [1, 1, 1, alpha]}
    )
    scene = loaded(builder, tmp_path).with_ground(0.0)
    camera = csm.Camera.look_at((0, 3, 0.1), (0, 0, 0), near=0.1, far=20, size=(9, 9))
    assert np.isclose(csm.truth(scene, camera, SUN).position[4, 4, 1], 1.0 if there else 0.0)


def test_an_image_without_alpha_is_whole(tmp_path):
    builder = cut_out_square(ALPHA)
    builder.header["images"] = [{"bufferView": builder.blob(png(ALPHA, "LA"))}]
    assert (loaded(builder, tmp_path).meshes[0].alpha == ALPHA).all()
    import io

    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(ALPHA).save(out, "JPEG")
    builder.header["images"] = [{"bufferView": builder.blob(out.getvalue())}]
    assert (loaded(builder, tmp_path).meshes[0].alpha == 255).all()


@pytest.mark.parametrize("place", ["data", "file"])
def test_images_outside_the_buffers(tmp_path, place):
    builder = cut_out_square(ALPHA)
    (tmp_path / "leaf 1.png").write_bytes(png(ALPHA))
    data = f"data:image/png;base64,{base64.b64encode(png(ALPHA)).decode()}"
    uri = {"data": data, "file": "leaf%201.png"}[place]
    builder.header["images"] = [{"uri": uri}]
    assert (loaded(builder, tmp_path).meshes[0].alpha == ALPHA).all()
    builder.header["images"] = [{"uri": "gone.png"}]
    with pytest.raises(FileNotFoundError, match=r"gone\.png"):
        loaded(builder, tmp_path)


def test_images_are_decoded_once_and_shared(tmp_path):
    builder = cut_out_square(ALPHA)
    builder.header["meshes"].append({**builder.header["meshes"][0], "name": "twin"})
    builder.node(mesh=1, translation=[0, 1, 0])
    first, second = loaded(builder, tmp_path).meshes
    assert first.alpha is second.alpha


def test_any_set_of_coordinates_and_any_width(tmp_path):
    builder = cut_out_square(ALPHA)
    second = np.array([[0, 255], [255, 255], [255, 0], [0, 0]], np.uint8)
    attributes(builder)["TEXCOORD_1"] = builder.accessor(second, normalized=True)
    texture_info(builder)["texCoord"] = 1
    assert loaded(builder, tmp_path).meshes[0].uv.tolist() == [[0, 1], [1, 1], [1, 0], [0, 0]]


def test_texture_transform_is_that_of_the_extension(tmp_path):
    # Its two examples: the lower left quadrant, turned; and v from the bottom.
    for transform, wanted in (
        (
            {"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5]},
            [[0, 1], [0.5, 1], [0.5, 0.5], [0, 0.5]],
        ),
        ({"offset": [0, 1], "scale": [1, -1]}, [[0, 1], [0, 0], [1, 0], [1, 1]]),
        ({}, [[0, 0], [0, 1], [1, 1], [1, 0]]),
    ):
        builder = cut_out_square(ALPHA)
        texture_info(builder)["extensions"] = {"KHR_texture_transform": transform}
        builder.header["extensionsRequired"] = ["KHR_texture_transform"]
        assert np.allclose(loaded(builder, tmp_path).meshes[0].uv, wanted, atol=1e-15)
    texture_info(builder)["extensions"]["KHR_texture_transform"] = {"texCoord": 1}
    with pytest.raises(ValueError, match="material 0: its texture needs TEXCOORD_1"):
        loaded(builder, tmp_path)


@pytest.mark.parametrize("mode", [33071, 33648])
def test_other_wraps_are_read_where_they_change_nothing(tmp_path, mode):
    inside = cut_out_square(ALPHA)
    beyond = cut_out_square(ALPHA, uv=[[0, 0], [0, 1.5], [1, 1], [1, 0]])
    for builder in (inside, beyond):
        builder.header["samplers"] = [{"wrapT": mode}]
        builder.header["textures"][0]["sampler"] = 0
    assert (loaded(inside, tmp_path).meshes[0].alpha == ALPHA).all()
    with pytest.raises(ValueError, match=f"wrapT is {mode} and coordinates go from 0 to 1.5"):
        loaded(beyond, tmp_path)
    beyond.header["samplers"] = [{"wrapS": mode}]
    assert loaded(beyond, tmp_path).meshes[0].uv.max() == 1.5


def colours(builder, values, **extra):
    attributes(builder)["COLOR_0"] = builder.accessor(values, **extra)


SPOILT = {
    "no texture": (lambda b: b.header["textures"].clear(), "textures has no entry 0"),
    "no material": (
        lambda b: b.header["meshes"][0]["primitives"][0].update(material=3),
        "materials has no entry 3",
    ),
    "no coordinates": (lambda b: attributes(b).pop("TEXCOORD_0"), "needs TEXCOORD_0"),
    "too few": (
        lambda b: attributes(b).update(TEXCOORD_0=b.accessor(np.zeros((3, 2), np.float32))),
        "3 texture coordinates for 4 positions",
    ),
    "integers": (
        lambda b: attributes(b).update(TEXCOORD_0=b.accessor(np.zeros((4, 2), np.uint8))),
        "TEXCOORD_0 must be VEC2 of floats or normalised",
    ),
    "nan": (
        lambda b: attributes(b).update(TEXCOORD_0=b.accessor(np.full((4, 2), np.nan))),
        "uv of mesh 'mesh' must be finite",
    ),
    "basisu": (
        lambda b: b.header.update(textures=[{"extensions": {"KHR_texture_basisu": {}}}]),
        "its image is in KHR_texture_basisu, which csm does not read",
    ),
    "broken image": (
        lambda b: b.header.update(images=[{"bufferView": b.blob(png(ALPHA)[:60])}]),
        "its image cannot be decoded",
    ),
    "no image": (lambda b: b.header.update(images=[{}]), r"material 0 is malformed .*uri"),
    "network": (lambda b: b.header.update(images=[{"uri": "http://a/b"}]), "not from the network"),
    "view": (lambda b: b.header.update(images=[{"bufferView": 99}]), "bufferViews has no entry 99"),
    "cut off": (
        lambda b: b.header["bufferViews"][b.header["images"][0]["bufferView"]].update(
            byteLength=10**6
        ),
        "ends beyond its buffer",
    ),
    "vertex alpha": (
        lambda b: colours(b, np.full((4, 4), 0.5, np.float32)),
        "vertex colours have an alpha",
    ),
    "specular": (
        lambda b: material(b).update(extensions={"KHR_materials_pbrSpecularGlossiness": {}}),
        "pbrSpecularGlossiness",
    ),
    "cutoff": (lambda b: material(b).update(alphaCutoff="half"), "material 0: could not convert"),
    "negative cutoff": (lambda b: material(b).update(alphaCutoff=-1.0), "alpha_cutoff of mesh"),
    "factor": (
        lambda b: material(b)["pbrMetallicRoughness"].update(baseColorFactor=[1, 1]),
        "material 0 is malformed",
    ),
}


@pytest.mark.parametrize("case", SPOILT)
def test_refuses_what_would_be_cut_out_wrongly(case, tmp_path):
    spoil, text = SPOILT[case]
    builder = cut_out_square(ALPHA)
    spoil(builder)
    with pytest.raises(ValueError, match=text) as caught:
        loaded(builder, tmp_path)
    assert "square.glb" in str(caught.value)


def test_vertex_colours_without_alpha_are_left_out(tmp_path):
    for values, extra in (
        (np.full((4, 3), 0.5, np.float32), {}),
        (np.array([[9, 9, 9, 255]] * 4, np.uint8), {"normalized": True}),
    ):
        builder = cut_out_square(ALPHA)
        colours(builder, values, **extra)
        assert (loaded(builder, tmp_path).meshes[0].alpha == ALPHA).all()


def test_animated_and_skinned_meshes_keep_their_cutouts(tmp_path):
    builder = cut_out_square(ALPHA)
    times, moves = builder.accessor(np.array([0.0, 1.0])), builder.accessor(np.eye(3)[:2] * 2.0)
    builder.header["animations"] = [
        {
            "name": "sway",
            "samplers": [{"input": times, "output": moves}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
        }
    ]
    attributes(builder)["JOINTS_0"] = builder.accessor(np.zeros((4, 4), np.uint8))
    attributes(builder)["WEIGHTS_0"] = builder.accessor(np.tile([1.0, 0, 0, 0], (4, 1)))
    builder.header["skins"] = [{"joints": [0]}]
    for skin in ({}, {"skin": 0}):
        builder.node(mesh=0, **skin)
    scene = loaded(builder, tmp_path)
    posed = scene.at("sway", 1.0)
    assert len(posed.meshes) >= 2
    for mesh in (*scene.meshes, *posed.meshes):
        assert (mesh.alpha == ALPHA).all()
        assert mesh.uv.shape == (4, 2)
    assert not np.array_equal(scene.bounds, posed.bounds)


def refusal(path):
    """Text of the ValueError of loading a file, None if it loads; other errors escape."""
    try:
        csm.load(path)
    except ValueError as error:
        return str(error)
    return None


def test_damaged_bytes_are_one_sentence(tmp_path):
    data = bytearray(cut_out_square(ALPHA[:2, :2]).save(tmp_path / "whole.glb").read_bytes())
    path, texts = tmp_path / "damaged.glb", []
    random = np.random.default_rng(8)
    for position in range(0, len(data), 7):
        spoiled = data.copy()
        spoiled[position] = random.integers(256)
        path.write_bytes(spoiled)
        texts.append(refusal(path))
    texts = [text for text in texts if text is not None]
    assert len(texts) > 60
    assert all("damaged.glb" in text for text in texts)


def test_a_missing_pillow_names_the_command(tmp_path, monkeypatch):
    import sys

    path = cut_out_square(ALPHA).save(tmp_path / "square.glb")
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(ImportError, match=r"pip install cascaded-shadow-maps\[mesh\]"):
        csm.load(path)


def test_a_strip_keeps_its_coordinates(tmp_path):
    builder = Builder()
    source = cut_out_square(ALPHA)
    builder.data, builder.header = source.data, source.header
    primitive = builder.header["meshes"][0]["primitives"][0]
    primitive.update(mode=5, indices=builder.accessor(np.array([0, 1, 3, 2], np.uint16)))
    (mesh,) = loaded(builder, tmp_path).meshes
    assert mesh.uv[mesh.triangles].tolist() == [
        [[0, 0], [0, 1], [1, 0]],
        [[1, 0], [0, 1], [1, 1]],
    ]
