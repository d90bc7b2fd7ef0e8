"""Small glTF files for tests, written from the specification and by nothing of csm."""

import io
import json
import struct

import numpy as np
from PIL import Image

TYPES = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
COMPONENTS = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125}


class Builder:
    """Collects accessors in one buffer; `header` is the JSON and may be changed before `save`."""

    def __init__(self):
        self.data = b""
        self.header = {
            "asset": {"version": "2.0"},
            "accessors": [],
            "bufferViews": [],
            "meshes": [],
            "nodes": [],
        }

    def accessor(self, array, **extra):
        """Append an array (matrices as (n, 4, 4), row by column) and return its number."""
        array = np.asarray(array)
        if array.dtype == np.float64:
            array = array.astype(np.float32)
        kind = array.shape[1:]
        stored = array.transpose(0, 2, 1) if kind == (4, 4) else array
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": stored.nbytes}
        self.data += np.ascontiguousarray(stored).tobytes()
        self.header["bufferViews"].append(view)
        self.header["accessors"].append(
            {
                "bufferView": len(self.header["bufferViews"]) - 1,
                "componentType": COMPONENTS.get(array.dtype.name, 5126),
                "count": len(array),
                "type": TYPES[kind],
                **extra,
            }
        )
        return len(self.header["accessors"]) - 1

    def blob(self, data):
        """Append bytes and return the number of their buffer view."""
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.data += data
        self.header["bufferViews"].append(view)
        return len(self.header["bufferViews"]) - 1

    def mesh(self, positions, triangles=None, name="mesh", **extra):
        """Append a mesh of one primitive and return its number."""
        primitive = {"attributes": {"POSITION": self.accessor(positions)}, **extra}
        if triangles is not None:
            primitive["indices"] = self.accessor(np.asarray(triangles).reshape(-1))
        self.header["meshes"].append({"name": name, "primitives": [primitive]})
        return len(self.header["meshes"]) - 1

    def node(self, **fields):
        """Append a node and return its number."""
        self.header["nodes"].append(fields)
        return len(self.header["nodes"]) - 1

    def _finished_header(self):
        header = dict(self.header)
        if "scenes" not in header and header["nodes"]:
            children = {c for node in header["nodes"] for c in node.get("children", [])}
            roots = [n for n in range(len(header["nodes"])) if n not in children]
            header.update(scene=0, scenes=[{"nodes": roots}])
        return {key: value for key, value in header.items() if value != []}

    def save(self, path):
        """Write a .glb and return its path."""
        header = self._finished_header()
        if self.data:
            header.setdefault("buffers", [{"byteLength": len(self.data)}])
        text = json.dumps(header).encode()
        text += b" " * (-len(text) % 4)
        data = self.data + b"\0" * (-len(self.data) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        if data:
            chunks += struct.pack("<II", len(data), 0x004E4942) + data
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        return path


def png(alpha, mode="RGBA"):
    """A PNG file whose alpha is the (h, w) uint8 array; its colours are noise."""
    alpha = np.asarray(alpha, np.uint8)
    noise = np.random.default_rng(1).integers(0, 256, (*alpha.shape, len(mode) - 1), np.uint8)
    out = io.BytesIO()
    Image.fromarray(np.dstack([noise, alpha]), mode).save(out, "PNG")
    return out.getvalue()


def cut_out_square(alpha, uv=((0, 0), (0, 1), (1, 1), (1, 0)), **material):
    """A file with a level square of side 2 at height 1 under a MASK material with an image.

    u goes along x, v along z, as in `cutout_scenes.level`.
    """
    builder = Builder()
    corners = np.array([[-1, 1, -1], [-1, 1, 1], [1, 1, 1], [1, 1, -1]], np.float32)
    mesh = builder.mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.uint16), material=0)
    attributes = builder.header["meshes"][mesh]["primitives"][0]["attributes"]
    attributes["TEXCOORD_0"] = builder.accessor(np.asarray(uv, np.float32))
    builder.node(mesh=mesh, name="square")
    builder.header.update(
        materials=[
            {
                "alphaMode": "MASK",
                "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
                **material,
            }
        ],
        textures=[{"source": 0}],
        images=[{"bufferView": builder.blob(png(alpha)), "mimeType": "image/png"}],
    )
    return builder


TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)


def one_triangle():
    """A file with one triangle, to be spoilt."""
    builder = Builder()
    builder.node(mesh=builder.mesh(TRIANGLE, np.array([[0, 1, 2]], np.uint16)), name="triangle")
    return builder
