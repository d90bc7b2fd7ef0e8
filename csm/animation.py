"""Animated glTF: node tracks, poses and skinned vertices.

A pose is a function of values: every node's translation, rotation and scale at a time give its
global matrix; a skin's vertices follow its joints. Section numbers are those of the glTF 2.0
specification [Khronos2021]_.

References
----------
.. [Khronos2021] The Khronos 3D Formats Working Group: glTF 2.0 Specification, version 2.0.1, 2021.
"""

from dataclasses import dataclass

import numpy as np

from .gltf import TRIANGLE_STRIP, TRIANGLES, hierarchy, parents_first
from .materials import MaterialReader
from .mesh import Mesh

__all__ = ["Animation", "read_animation", "sample_track"]

_WIDTH = {"translation": 3, "rotation": 4, "scale": 3}
_REST = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}


@dataclass(frozen=True)
class Skin:
    """Vertices of one primitive bound to joints."""

    positions: np.ndarray  # (n, 3) bind positions
    joints: np.ndarray  # (n, s) index into nodes and joint_from_bind
    weights: np.ndarray  # (n, s), rows sum to 1
    nodes: np.ndarray  # (j,) node of each joint
    joint_from_bind: np.ndarray  # (j, 4, 4) inverse bind matrices


@dataclass(frozen=True)
class Track:
    """Key frames of one property of one node."""

    node: int
    path: str  # translation, rotation or scale
    times: np.ndarray  # (k,) ascending [s]
    values: np.ndarray  # (k, c), or (k, 3, c) for CUBICSPLINE: in-tangent, value, out-tangent
    interpolation: str  # STEP, LINEAR or CUBICSPLINE


@dataclass(frozen=True)
class Animation:
    """An animated file: rest pose, tracks and what they move.

    Parameters
    ----------
    parents : tuple of int
        Parent of each node, -1 for a root.
    rest : dict of str to (n, c) ndarray
        Translation, rotation (x, y, z, w) and scale of every node.
    matrices : dict of int to (4, 4) ndarray
        Nodes that are given by a matrix instead; they are never animated.
    meshes : tuple of Mesh
        In the rest pose.
    instances : tuple of (int, int)
        Mesh and node of each instance; node -1 for skinned meshes, which stand in the world.
    skins : dict of int to Skin
        By mesh number.
    tracks : dict of str to tuple of Track
        By clip name.
    """

    parents: tuple
    rest: dict
    matrices: dict
    meshes: tuple
    instances: tuple
    skins: dict
    tracks: dict

    @property
    def clips(self):
        """Clip names and durations [s]: the time of the last key frame."""
        return {
            name: max(float(track.times[-1]) for track in tracks)
            for name, tracks in self.tracks.items()
        }

    def pose(self, clip=None, seconds=0.0):
        """Place everything at a time of a clip.

        Parameters
        ----------
        clip : str or None
            None is the rest pose.
        seconds : float
            Any finite time [s]; outside 0 to the duration the clip repeats.

        Returns
        -------
        posed : dict of int to (n, 3) float64
            Positions of the skinned meshes.
        world_from_instance : (k, 4, 4) float64
        """
        values = {path: rows.copy() for path, rows in self.rest.items()}
        if clip is not None:
            duration = self.clips[clip]
            if duration > 0.0 and not 0.0 <= seconds <= duration:
                seconds = seconds % duration
            for track in self.tracks[clip]:
                values[track.path][track.node] = sample_track(track, seconds)
        world_from_node = self.world_from_nodes(values)
        world_from_instance = np.tile(np.eye(4), (len(self.instances), 1, 1))
        for row, (_, node) in enumerate(self.instances):
            if node >= 0:
                world_from_instance[row] = world_from_node[node]
        posed = {number: _skinned(skin, world_from_node) for number, skin in self.skins.items()}
        return posed, world_from_instance

    def world_from_nodes(self, values):
        """Global matrices (n, 4, 4) of nodes whose translations, rotations and scales are given."""
        parent_from_node = _composed(**values)
        for node, matrix in self.matrices.items():
            parent_from_node[node] = matrix
        world_from_node = np.empty_like(parent_from_node)
        for node in parents_first(self.parents):
            parent = self.parents[node]
            world_from_node[node] = parent_from_node[node]
            if parent >= 0:
                world_from_node[node] = world_from_node[parent] @ parent_from_node[node]
        return world_from_node


def sample_track(track, seconds):
    """Value of a track at a time: appendix C.

    Parameters
    ----------
    track : Track
    seconds : float
        Before the first and after the last key frame their values hold [s].

    Returns
    -------
    value : (c,) float64
        Of unit length for rotations.
    """
    cubic = track.interpolation == "CUBICSPLINE"
    key_values = track.values[:, 1] if cubic else track.values
    after = int(np.searchsorted(track.times, seconds, side="right"))
    if after == 0 or after == len(track.times) or track.interpolation == "STEP":
        value = key_values[max(after - 1, 0)]
    else:
        before = after - 1
        step = track.times[after] - track.times[before]
        t = (seconds - track.times[before]) / step
        start, end = key_values[before], key_values[after]
        if cubic:
            leaving, arriving = step * track.values[before, 2], step * track.values[after, 0]
            value = (
                (2 * t**3 - 3 * t**2 + 1) * start
                + (t**3 - 2 * t**2 + t) * leaving
                + (3 * t**2 - 2 * t**3) * end
                + (t**3 - t**2) * arriving
            )
        elif track.path == "rotation":
            value = _slerp(start, end, t)
        else:
            value = start + t * (end - start)
    return value / np.linalg.norm(value) if track.path == "rotation" else value


def _slerp(start, end, t):
    """Turn at a constant rate along the shorter way between two unit quaternions (C.4)."""
    cosine = start @ end
    if cosine < 0.0:  # q and -q are one rotation: take the nearer
        end, cosine = -end, -cosine
    # atan2 of the chord keeps its digits where arccos(cosine) near 1 has lost them.
    angle = 2.0 * np.arctan2(np.linalg.norm(end - start), np.linalg.norm(end + start))
    if angle < 1e-9:
        return start + t * (end - start)
    return (np.sin((1 - t) * angle) * start + np.sin(t * angle) * end) / np.sin(angle)


def _composed(translation, rotation, scale):
    """Matrices T R S of nodes, (n, 4, 4) from (n, 3), (n, 4) and (n, 3); section 3.5.3."""
    x, y, z, w = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).T
    matrices = np.zeros((len(x), 4, 4))
    matrices[:, 0, 0], matrices[:, 0, 1] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w)
    matrices[:, 1, 1], matrices[:, 1, 2] = 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    matrices[:, 2, 2], matrices[:, 2, 0] = 1 - 2 * (x * x + y * y), 2 * (x * z - y * w)
    matrices[:, 0, 2], matrices[:, 1, 0] = 2 * (x * z + y * w), 2 * (x * y + z * w)
    matrices[:, 2, 1] = 2 * (y * z + x * w)
    matrices[:, :3, :3] *= scale[:, None, :]
    matrices[:, :3, 3] = translation
    matrices[:, 3, 3] = 1.0
    return matrices


def _skinned(skin, world_from_node):
    """World positions of a skin's vertices (n, 3): the weighted mean of its joints (3.7.3.3)."""
    world_from_bind = world_from_node[skin.nodes] @ skin.joint_from_bind
    blended = np.einsum("ns,nsij->nij", skin.weights, world_from_bind[skin.joints][:, :, :3])
    return np.einsum("nij,nj->ni", blended[:, :, :3], skin.positions) + blended[:, :, 3]


def read_animation(document):
    """Read the nodes, skins and clips of a glTF document.

    Parameters
    ----------
    document : csm.gltf.Document
        That `refuse_what_trimesh_misreads` let pass.

    Returns
    -------
    animation : Animation

    Raises
    ------
    ValueError
        If the file contradicts itself or animates morph targets; without the path.
    """
    nodes = document.items("nodes")
    parents, reached = hierarchy(document)
    rest, matrices = _rest_pose(nodes)
    meshes, instances, skins = [], [], {}
    shared = {}
    materials = MaterialReader(document)
    for number, node in enumerate(nodes):
        if number not in reached or "mesh" not in node:
            continue
        for primitive_number in _surfaces(document, node["mesh"]):
            key = (node["mesh"], primitive_number)
            if "skin" in node:
                mesh, skin = _read_skin(document, materials, *key, node["skin"])
                skins[len(meshes)] = skin
                instances.append((len(meshes), -1))
                meshes.append(mesh)
            else:
                if key not in shared:
                    shared[key] = len(meshes)
                    meshes.append(_read_mesh(document, materials, *key)[0])
                instances.append((shared[key], number))
    tracks = _read_clips(document, matrices)
    animation = Animation(parents, rest, matrices, tuple(meshes), tuple(instances), skins, tracks)
    for number, positions in animation.pose()[0].items():
        meshes[number] = meshes[number].posed(positions)
    return Animation(parents, rest, matrices, tuple(meshes), tuple(instances), skins, tracks)


def _rest_pose(nodes):
    rest = {path: np.tile(np.array(v, np.float64), (len(nodes), 1)) for path, v in _REST.items()}
    matrices = {}
    for number, node in enumerate(nodes):
        if "matrix" in node:
            matrices[number] = np.array(node["matrix"], np.float64).reshape(4, 4).T
        for path, rows in rest.items():
            rows[number] = node.get(path, rows[number])
    bad = ~(np.linalg.norm(rest["rotation"], axis=1) > 0)
    if bad.any():
        raise ValueError(f"node {int(np.argmax(bad))} has a rotation of length 0")
    return rest, matrices


def _surfaces(document, mesh):
    primitives = document.item("meshes", mesh).get("primitives", [])
    drawn = (TRIANGLES, TRIANGLE_STRIP)
    return [n for n, p in enumerate(primitives) if p.get("mode", TRIANGLES) in drawn]


def _read_mesh(document, materials, mesh, primitive_number):
    """Return the Mesh of a primitive and its attributes, in the vertex order of the file."""
    mesh_item = document.item("meshes", mesh)
    primitive = mesh_item["primitives"][primitive_number]
    attributes = {
        name: document.accessor(number)
        for name, number in primitive["attributes"].items()
        if name == "POSITION" or name.startswith(("JOINTS_", "WEIGHTS_"))
    }
    positions = attributes["POSITION"]
    if "indices" in primitive:
        indices = document.accessor(primitive["indices"])
    else:
        indices = np.arange(len(positions))
    if primitive.get("mode", TRIANGLES) == TRIANGLE_STRIP:
        triangles = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
        triangles[1::2] = triangles[1::2, [1, 0, 2]]  # every other one is wound backwards
    else:
        triangles = indices.reshape(-1, 3)
    name = f"{mesh_item.get('name', 'mesh')}" + (f"_{primitive_number}" if primitive_number else "")
    return Mesh(positions, triangles, name, **materials.cutout(primitive)), attributes


def _read_skin(document, materials, mesh, primitive_number, skin_number):
    mesh, attributes = _read_mesh(document, materials, mesh, primitive_number)
    skin = document.item("skins", skin_number)
    nodes = np.array(skin["joints"], np.int64)
    for node in nodes.tolist():
        document.item("nodes", node)
    joint_from_bind = np.tile(np.eye(4), (len(nodes), 1, 1))
    if "inverseBindMatrices" in skin:
        rows = document.accessor(skin["inverseBindMatrices"])[: len(nodes)]
        joint_from_bind = rows.reshape(len(nodes), 4, 4).transpose(0, 2, 1).copy()
    sets = range(sum(name.startswith("JOINTS_") for name in attributes))
    joints = np.concatenate([attributes[f"JOINTS_{i}"] for i in sets], axis=1)
    weights = np.concatenate([attributes[f"WEIGHTS_{i}"] for i in sets], axis=1)
    used = weights > 0
    if joints.shape != weights.shape or len(joints) != len(mesh.positions):
        raise ValueError("joints and weights must have one row per vertex")
    if (joints[used] >= len(nodes)).any():
        raise ValueError(f"a vertex names joint {joints[used].max()} of {len(nodes)}")
    sums = weights.sum(axis=1, keepdims=True)
    if not (sums > 0).all() or (weights < 0).any():
        raise ValueError("weights must be 0 or more and not all 0 for a vertex")
    joints = np.where(used, joints, 0)
    return mesh, Skin(mesh.positions, joints, weights / sums, nodes, joint_from_bind)


def _read_clips(document, matrices):
    tracks = {}
    for number, clip in enumerate(document.items("animations")):
        name = str(clip.get("name", f"clip_{number}"))
        if name in tracks:
            name = f"{name}_{number}"
        channels = [c for c in clip.get("channels", []) if "node" in c.get("target", {})]
        tracks[name] = tuple(
            _read_track(document, clip, channel, name, matrices) for channel in channels
        )
    return {name: of_clip for name, of_clip in tracks.items() if of_clip}


def _read_track(document, clip, channel, name, matrices):
    node, path = channel["target"]["node"], channel["target"]["path"]
    document.item("nodes", node)
    if path not in _WIDTH:
        raise ValueError(f"clip {name!r} animates {path!r} of a node, which csm does not draw")
    if node in matrices:
        raise ValueError(f"clip {name!r} animates node {node}, which is given by a matrix")
    sampler = clip["samplers"][channel["sampler"]]
    interpolation = sampler.get("interpolation", "LINEAR")
    times, values = document.accessor(sampler["input"]), document.accessor(sampler["output"])
    if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise ValueError(f"clip {name!r}: the times of a sampler must ascend")
    shapes = {
        "STEP": (len(times), _WIDTH[path]),
        "LINEAR": (len(times), _WIDTH[path]),
        "CUBICSPLINE": (len(times), 3, _WIDTH[path]),
    }
    if interpolation not in shapes:
        raise ValueError(f"clip {name!r}: interpolation {interpolation!r} is not glTF 2.0")
    if values.size != np.prod(shapes[interpolation]) or not np.isfinite(values).all():
        raise ValueError(f"clip {name!r}: a sampler's values must be finite, one per time")
    values = values.reshape(shapes[interpolation])
    if path == "rotation" and interpolation != "CUBICSPLINE":
        # Stored as float32 they are of unit length to 1e-7 only, which would bend the slerp.
        lengths = np.linalg.norm(values, axis=1, keepdims=True)
        if not (lengths > 0).all():
            raise ValueError(f"clip {name!r}: a rotation has length 0")
        values = values / lengths
    return Track(node, path, times, values, interpolation)
