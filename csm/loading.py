"""Files to scenes: meshes and glTF through trimesh, elevation grids, and the views beside them."""

import json
import os
import reprlib
import signal
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .animation import read_animation
from .camera import Camera
from .elevation import read_elevation
from .gltf import read_gltf, refuse_what_trimesh_misreads
from .materials import has_mask
from .mesh import Mesh
from .scene import Part, Scene
from .sun import Sun

__all__ = ["load", "load_elevation"]

_MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
_ELEVATION_SUFFIXES = (".npz", ".npy", ".tif", ".tiff")
_VIEWS_FILE = "scenes.json"


def load(path):
    """Load a scene from a mesh file.

    Node transforms and instances are kept, in double precision; +y is up and units are taken as
    metres, whatever the file says. Points and lines are left out. A glTF file with skins or
    animations comes in its rest pose, see `Scene.at`.

    Of materials only cut-outs are read, and of glTF alone: ``alphaMode`` MASK with the alpha of
    ``baseColorTexture`` times that of ``baseColorFactor``, any set of texture coordinates,
    KHR_texture_transform. The nearest texel decides, whatever the sampler's filter. BLEND is taken
    as OPAQUE: it casts a whole shadow and is seen as a whole surface.

    Parameters
    ----------
    path : str or Path
        ``.glb``, ``.gltf``, ``.obj``, ``.ply``, ``.stl`` or ``.off``. If a ``scenes.json`` beside
        it names the file, the scene has the cameras and suns given there, moved by the file's
        node ``georeference`` where there is one.

    Returns
    -------
    scene : Scene
        Named after the file; ``scene.georeference`` is the position of the node ``georeference``.

    Raises
    ------
    TypeError
        If path is not a path.
    OSError
        If the file, or a buffer it names, is missing or unreadable.
    ValueError
        If it is damaged, or would load wrongly without a word: sparse, quantised or non-finite
        positions, indices out of range, triangle fans, morph targets, required extensions,
        singular transforms, no triangles; cut-outs with vertex alpha, with an image that only an
        extension knows, or with coordinates beyond 0 to 1 that do not repeat. The text names the
        path and the cause.
    ImportError
        If trimesh is not installed, or pillow for a glTF file with cut-outs.
    """
    path = _existing(path)
    suffix = path.suffix.lower()
    if suffix in _ELEVATION_SUFFIXES:
        raise ValueError(f"{path}: a {suffix} file is a height grid; use csm.load_elevation")
    if suffix not in _MESH_SUFFIXES:
        raise ValueError(
            f"{path}: a mesh file ends in {', '.join(_MESH_SUFFIXES)} (got {suffix!r})"
        )
    trimesh = _trimesh()
    try:
        scene = _loaded(path, suffix, trimesh)
    except (ImportError, OSError):
        raise
    except Exception as error:  # of damaged structure, beside the refusals in words
        cause = str(error) or f"malformed: {type(error).__name__}"
        raise ValueError(f"{path}: {cause}") from error
    return _with_views(scene, path)


def load_elevation(path):
    """Load a terrain from a height grid, two triangles per cell.

    Parameters
    ----------
    path : str or Path
        ``.npz`` with the keys ``elevation`` and either ``cell``, ``easting0``, ``northing0`` [m]
        (sample [0, 0]) or ``dx``, ``dy``, ``xmin``, ``xmax``, ``ymin``, ``ymax`` [degrees], which
        become metres by the WGS 84 ellipsoid at the grid's middle latitude. ``.npy``: heights with
        cells of 1 m. GeoTIFF: band 1, in metres or degrees as the file says. Row 0 is north
        whatever the file's extremes say; NaN, or the file's no-data value, is a hole.

    Returns
    -------
    scene : Scene
        At its place on the map if the file gives one in metres, else centred; cameras and suns
        as in `load`.

    Raises
    ------
    TypeError
        If path is not a path.
    OSError
        If the file is missing or unreadable.
    ValueError
        If it is not a height grid; the text names the path and the cause.
    ImportError
        For a GeoTIFF without rasterio.
    """
    path = _existing(path)
    heights, cell_size, origin = read_elevation(path)
    try:
        scene = Scene.from_elevation(heights, cell_size, origin, name=path.stem)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error
    return _with_views(scene, path)


def _existing(path):
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a path (got {path!r})")
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f"{path}: is a folder, not a file")
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    return path


@contextmanager
def _interrupt_kept():
    """Hold Ctrl-C back until the block ends: trimesh catches BaseException and would swallow it."""
    handler = signal.getsignal(signal.SIGINT)
    # Only the main thread runs handlers and may set them; SIG_IGN, SIG_DFL and C's swallow nothing.
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    arrived = []
    try:
        signal.signal(signal.SIGINT, lambda *signal_and_frame: arrived.append(signal_and_frame))
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if arrived:
            handler(*arrived[0])


def _trimesh():
    try:
        with _interrupt_kept():
            import trimesh
    except ImportError as error:
        raise ImportError(
            "csm.load needs trimesh: pip install cascaded-shadow-maps[mesh]"
        ) from error
    return trimesh


def _loaded(path, suffix, trimesh):
    options, georeference = {}, np.zeros(3)
    if suffix in (".glb", ".gltf"):
        document = read_gltf(path)
        refuse_what_trimesh_misreads(document)
        # trimesh drops what moves, and of textures how they wrap, turn and which coordinates
        if document.items("skins") or document.items("animations") or has_mask(document):
            return _read_here(path, document)
        options["skip_materials"] = True
    elif suffix == ".obj":
        options["skip_materials"] = True
    loaded = _read_by_trimesh(path, trimesh, options)
    if "georeference" in loaded.graph.nodes:
        georeference = loaded.graph["georeference"][0][:3, 3]
    meshes = {
        name: Mesh(geometry.vertices, geometry.faces, str(name))
        for name, geometry in loaded.geometry.items()
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces)
    }
    instances = []
    for node in loaded.graph.nodes_geometry:
        world_from_node, name = loaded.graph[node]
        if name in meshes:
            instances.append((name, np.array(world_from_node, np.float64)))
    if not instances:
        raise ValueError("it holds no triangles")
    # Names of nodes may be random; a mesh's place in the file and a matrix are not.
    place = {name: number for number, name in enumerate(meshes)}
    instances.sort(key=lambda instance: (place[instance[0]], instance[1].ravel().tolist()))
    used = list(dict.fromkeys(name for name, _ in instances))
    return Scene(
        [meshes[name] for name in used],
        np.array([used.index(name) for name, _ in instances]),
        np.stack([transform for _, transform in instances]),
        name=path.stem,
        georeference=georeference,
    )


def _read_by_trimesh(path, trimesh, options):
    try:
        with _interrupt_kept():
            return trimesh.load_scene(str(path), process=False, **options)
    except OSError:
        raise
    except IndexError as error:
        raise ValueError(
            f"malformed: an index, as a face's, is beyond what the file holds ({error})"
        ) from error
    except Exception as error:  # a dozen kinds, one of them without a text
        raise ValueError(f"malformed: {error or type(error).__name__}") from error


def _read_here(path, document):
    animation = read_animation(document)
    if not animation.meshes:
        raise ValueError("it holds no triangles")
    names = [node.get("name") for node in document.items("nodes")]
    georeference = np.zeros(3)
    if "georeference" in names:
        world_from_node = animation.world_from_nodes(animation.rest)
        georeference = world_from_node[names.index("georeference"), :3, 3]
    parts = []
    if animation.tracks:
        parts = [Part(animation, tuple(range(len(animation.meshes))), 0, np.eye(4))]
    return Scene(
        animation.meshes,
        np.array([mesh for mesh, _ in animation.instances]),
        animation.pose()[1],
        name=path.stem,
        georeference=georeference,
        parts=parts,
    )


def _with_views(scene, path):
    """Give the scene the cameras and suns of the entry of scenes.json that names its file."""
    views_path = path.with_name(_VIEWS_FILE)
    if not views_path.is_file():
        return scene
    try:
        entries = _by_name("the file", json.loads(views_path.read_text(encoding="utf-8")))
        entries = [_by_name(f"entry {name!r}", entry) for name, entry in entries.items()]
        entry = next((entry for entry in entries if entry.get("file") == path.name), None)
        if entry is None:
            return scene
        given = entry.get("georeference", scene.georeference)
        if not np.array_equal(given, scene.georeference):
            raise ValueError(
                f"its georeference {given} is not that of {path.name}, "
                f"{scene.georeference.tolist()}"
            )
        cameras = {
            name: _camera(_by_name(f"camera {name!r}", view)).translated(scene.georeference)
            for name, view in _by_name("cameras", entry.get("cameras", {})).items()
        }
        suns = {
            name: _sun(_by_name(f"sun {name!r}", view))
            for name, view in _by_name("suns", entry.get("suns", {})).items()
        }
    except KeyError as error:
        raise ValueError(f"{views_path}: {path.name}: {error} is missing") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"{views_path}: {path.name}: {error}") from error
    return scene.replace(cameras=cameras, suns=suns)


def _by_name(what, value):
    if not isinstance(value, dict):
        raise ValueError(f"{what} must be a JSON object of names (got {reprlib.repr(value)})")
    return value


def _sun(view):
    return Sun(view["to_light"], view.get("angular_diameter_deg", 0.0))


def _camera(view):
    """Make the camera of an entry, at local coordinates: so its axes keep all their digits."""
    optional = {name: view[name] for name in ("up", "size") if name in view}
    return Camera.look_at(
        view["eye"],
        view["at"],
        fov_y_deg=view["fov_y_deg"],
        near=view["near"],
        far=view["far"],
        **optional,
    )
