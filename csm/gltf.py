"""glTF 2.0 as JSON and numpy arrays: what trimesh does not tell, and what it does not read.

trimesh loads geometry and node transforms, but reads some valid files wrongly without a word
(sparse and quantised positions, fans, nodes with two parents) and drops skins and animations.
`refuse_what_trimesh_misreads` finds the first kind from the JSON; `Document.accessor` reads the
arrays that the second kind needs.
"""

import base64
import json
import struct
import urllib.parse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

__all__ = [
    "Document",
    "hierarchy",
    "parents_first",
    "read_gltf",
    "refuse_what_trimesh_misreads",
]

FLOAT = 5126
TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = 4, 5, 6
_DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", FLOAT: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


@dataclass(frozen=True)
class Document:
    """A glTF file: its JSON and its buffers."""

    header: dict
    buffers: tuple[bytes, ...]
    folder: Path = Path()

    def read(self, uri):
        """Read what a uri names: itself, or a file beside this one."""
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2], validate=True)
        if "://" in uri:
            raise ValueError(f"files are read from the disk, not from the network (got {uri!r})")
        return (self.folder / urllib.parse.unquote(uri)).read_bytes()

    def view_bytes(self, number):
        """Bytes of one buffer view; ValueError if it ends beyond its buffer."""
        view = self.item("bufferViews", number)
        start, length, buffer = view.get("byteOffset", 0), view["byteLength"], view["buffer"]
        if not all(isinstance(value, int) and value >= 0 for value in (start, length, buffer)):
            raise ValueError(f"bufferView {number} has a bad offset or length")
        if buffer >= len(self.buffers) or start + length > len(self.buffers[buffer]):
            raise ValueError(f"bufferView {number} ends beyond its buffer")
        return self.buffers[buffer][start : start + length]

    def items(self, what):
        """Return the JSON array `what`, or an empty list.

        Raises ValueError if it is something else than a list of objects.
        """
        items = self.header.get(what, [])
        if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
            raise ValueError(f"{what} is not a list of objects")
        return items

    def item(self, what, number):
        """One entry of the JSON array `what`; ValueError if there is none of that number."""
        items = self.items(what)
        if not isinstance(number, int) or not 0 <= number < len(items):
            raise ValueError(f"{what} has no entry {number!r} (it has {len(items)})")
        return items[number]

    def accessor(self, number):
        """One accessor as an array.

        Parameters
        ----------
        number : int
            Index into the file's accessors.

        Returns
        -------
        array : (count,) or (count, width) ndarray
            float64 if stored as floats or normalised integers, else int64. Matrices come out
            with their 16 numbers in file order, column after column.

        Raises
        ------
        ValueError
            If it is sparse, has no data or points outside its buffer.
        """
        accessor = self.item("accessors", number)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise ValueError(f"accessor {number} is sparse or empty, which csm does not read")
        dtype, width, count = _layout(accessor, number)
        view = self.item("bufferViews", accessor["bufferView"])
        row_bytes = dtype.itemsize * width
        stride = view.get("byteStride", row_bytes)
        self._check_reach(number, accessor, view, count, row_bytes, stride)
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        flat = np.frombuffer(self.buffers[view["buffer"]], np.uint8)
        rows = np.lib.stride_tricks.as_strided(flat[start:], (count, row_bytes), (stride, 1))
        array = np.ascontiguousarray(rows).view(dtype)
        if accessor.get("normalized"):
            # glTF 2.0, section 3.6.2.2 and 3.11: c / max, clamped at -1 for signed types.
            array = np.maximum(array / np.iinfo(dtype).max, -1.0)
        array = array.astype(np.float64 if array.dtype.kind == "f" else np.int64)
        return array[:, 0] if width == 1 else array

    def check_accessors(self):
        """Raise ValueError unless every accessor lies inside its buffer.

        A wrong count is found here, before anything allocates by it.
        """
        for number, accessor in enumerate(self.items("accessors")):
            dtype, width, count = _layout(accessor, number)
            if "bufferView" in accessor:
                view = self.item("bufferViews", accessor["bufferView"])
                row_bytes = dtype.itemsize * width
                stride = view.get("byteStride", row_bytes)
                self._check_reach(number, accessor, view, count, row_bytes, stride)
            elif count > 0 and "sparse" not in accessor:
                raise ValueError(f"accessor {number} has no data (no bufferView)")

    def _check_reach(self, number, accessor, view, count, row_bytes, stride):
        inside, start = accessor.get("byteOffset", 0), view.get("byteOffset", 0)
        length, buffer = view.get("byteLength"), view.get("buffer")
        numbers = (inside, start, length, buffer, stride)
        if not all(isinstance(value, int) and value >= 0 for value in numbers):
            raise ValueError(f"accessor {number} has a bad offset, length or stride {numbers}")
        if buffer >= len(self.buffers) or start + length > len(self.buffers[buffer]):
            raise ValueError(f"accessor {number}: its buffer view ends beyond its buffer")
        if stride < row_bytes or inside + (count - 1) * stride + row_bytes > length:
            raise ValueError(f"accessor {number} ends beyond its buffer view ({count} rows)")


def _layout(accessor, number):
    dtype, width = _DTYPES.get(accessor.get("componentType")), _WIDTHS.get(accessor.get("type"))
    count = accessor.get("count")
    if dtype is None or width is None or not isinstance(count, int) or count < 1:
        raise ValueError(f"accessor {number} has no valid componentType, type and count")
    return np.dtype(dtype), width, count


def read_gltf(path):
    """Read the JSON and the buffers of a ``.glb`` or ``.gltf`` file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    document : Document

    Raises
    ------
    ValueError
        If the file is not glTF 2.0; without the path, which `csm.load` adds.
    OSError
        If it, or a buffer beside it, cannot be read.
    """
    data = Path(path).read_bytes()
    text, chunk = _glb_chunks(data) if data[:4] == b"glTF" else (data, None)
    try:
        header = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"its JSON is damaged ({error})") from error
    if not isinstance(header, dict) or not isinstance(header.get("asset"), dict):
        raise ValueError("it is not glTF: the JSON has no asset")
    if not str(header["asset"].get("version", "")).startswith("2"):
        raise ValueError(f"glTF 2 is read (got version {header['asset'].get('version')!r})")
    document = Document(header, (), Path(path).parent)
    buffers = []
    for number, buffer in enumerate(document.items("buffers")):
        buffers.append(_buffer_bytes(document, buffer, chunk if number == 0 else None))
        length = buffer.get("byteLength")
        if not isinstance(length, int) or length > len(buffers[-1]):
            raise ValueError(f"buffer {number} is shorter than its byteLength {length!r}")
    return Document(header, tuple(buffers), document.folder)


def _glb_chunks(data):
    """Return JSON and binary chunk of a .glb; the second may be None."""
    if len(data) < 20:
        raise ValueError(f"a .glb has at least 20 bytes (got {len(data)})")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2 or length > len(data):
        raise ValueError(f"its .glb header is damaged (version {version}, length {length})")
    chunks, position = [], 12
    while position + 8 <= length:
        size, kind = struct.unpack_from("<II", data, position)
        if position + 8 + size > length:
            raise ValueError("a chunk ends beyond the file")
        chunks.append((kind, data[position + 8 : position + 8 + size]))
        position += 8 + size
    if not chunks or chunks[0][0] != 0x4E4F534A:  # "JSON"
        raise ValueError("its first chunk is not JSON")
    binary = [chunk for kind, chunk in chunks[1:] if kind == 0x004E4942]  # "BIN"
    return chunks[0][1], binary[0] if binary else None


def _buffer_bytes(document, buffer, chunk):
    uri = buffer.get("uri")
    if uri is None:
        if chunk is None:
            raise ValueError("a buffer has no uri and the file no binary chunk")
        return chunk
    return document.read(uri)


def hierarchy(document):
    """Read which node stands under which.

    Parameters
    ----------
    document : Document

    Returns
    -------
    parents : tuple of int
        Of each node, -1 for a root.
    reached : set of int
        Nodes of the file's default scene; all, if it has no scenes.

    Raises
    ------
    ValueError
        If a node has two parents, is its own ancestor, or names a node or mesh that is not there.
    """
    nodes = document.items("nodes")
    parents = [-1] * len(nodes)
    for number, node in enumerate(nodes):
        if "mesh" in node:
            document.item("meshes", node["mesh"])
        for child in node.get("children", []):
            document.item("nodes", child)
            if parents[child] >= 0:
                raise ValueError(f"node {child} has two parents")
            parents[child] = number
    parents_first(parents)
    roots = [number for number, parent in enumerate(parents) if parent < 0]
    if document.items("scenes"):
        roots = document.item("scenes", document.header.get("scene", 0)).get("nodes", [])
    reached, waiting = set(), list(roots)
    while waiting:
        number = waiting.pop()
        reached.add(number)
        waiting += document.item("nodes", number).get("children", [])
    return tuple(parents), reached


def parents_first(parents):
    """Order nodes, every parent before its children; ValueError if one is its own ancestor."""
    order, done = [], [False] * len(parents)
    for node in range(len(parents)):
        chain = []
        while node >= 0 and not done[node]:
            if len(chain) > len(parents):
                raise ValueError("the node hierarchy has a cycle")
            chain.append(node)
            node = parents[node]
        for node in reversed(chain):
            done[node] = True
            order.append(node)
    return order


def refuse_what_trimesh_misreads(document):
    """Raise ValueError for a file that would load wrongly without a word.

    Parameters
    ----------
    document : Document

    Raises
    ------
    ValueError
        For required extensions, GPU instancing, nodes with two parents or in a cycle, accessors
        outside their buffers, positions or indices that are sparse, quantised or without data,
        triangle fans, and morph targets that are not at rest.
    """
    header = document.header
    # a texture transform touches cut-outs alone, and there it is honoured
    required = [n for n in header.get("extensionsRequired", []) if n != "KHR_texture_transform"]
    if required:
        names = ", ".join(map(str, required))
        raise ValueError(f"it requires extensions, which csm does not read: {names}")
    document.check_accessors()
    hierarchy(document)
    for node in document.items("nodes"):
        if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            raise ValueError("it uses EXT_mesh_gpu_instancing, which csm does not read")
        _refuse_morphed(node)
    for mesh in document.items("meshes"):
        _refuse_morphed(mesh)
        for primitive in mesh.get("primitives", []):
            _refuse_primitive(document, primitive)


def _refuse_morphed(item):
    if any(item.get("weights", [])):
        raise ValueError("it has morph targets with weights other than 0, which csm does not read")


def _refuse_primitive(document, primitive):
    mode = primitive.get("mode", TRIANGLES)
    if mode == TRIANGLE_FAN:
        raise ValueError("it has triangle fans (mode 6); export triangles instead")
    if mode not in (TRIANGLES, TRIANGLE_STRIP):
        return  # points and lines have no surface: skipped
    attributes = primitive.get("attributes", {})
    if "POSITION" not in attributes:
        raise ValueError("a primitive has no POSITION")
    positions = document.item("accessors", attributes["POSITION"])
    if positions["type"] != "VEC3":
        raise ValueError(f"POSITION must be VEC3 (got {positions['type']})")
    if positions["componentType"] != FLOAT or positions.get("normalized"):
        raise ValueError(
            "POSITION must be float (5126): quantised positions are not read "
            f"(got componentType {positions['componentType']})"
        )
    named = [("POSITION", positions)]
    if "indices" in primitive:
        indices = document.item("accessors", primitive["indices"])
        if indices["type"] != "SCALAR" or indices["componentType"] not in (5121, 5123, 5125):
            raise ValueError("indices must be unsigned SCALAR")
        named.append(("indices", indices))
    for name, accessor in named:
        if "sparse" in accessor or "bufferView" not in accessor:
            raise ValueError(f"{name} is a sparse accessor, which csm does not read")
