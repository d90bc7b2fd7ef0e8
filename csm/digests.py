"""Digests of values, scenes and of csm's own code: what a result on disk is known by."""

import functools
import hashlib
import subprocess
from importlib import resources
from pathlib import Path

import numpy as np

__all__ = ["code_digest", "commit", "digest", "scene_digest"]

LENGTH = 20  # hexadecimal digits: 80 bits, a collision in 1e6 results has a chance of 1e-12


def digest(*values):
    """Digest of plain values and arrays.

    Parameters
    ----------
    *values
        None, bool, int, float, str, bytes, arrays, and sequences and mappings of them; objects
        count by their attributes. Floats count to the last bit.

    Returns
    -------
    digest : str
        20 hexadecimal digits, the same in every process and on every machine.

    Raises
    ------
    TypeError
        If a value is of none of these kinds.
    """
    hasher = hashlib.sha256()
    _feed(hasher, values)
    return hasher.hexdigest()[:LENGTH]


def scene_digest(scene):
    """Digest of what of a scene is drawn and traced: not its names, cameras and suns.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    digest : str
    """
    meshes = [
        {name: value for name, value in vars(mesh).items() if name != "name"}
        for mesh in scene.meshes
    ]
    return digest(meshes, scene.instance_mesh, scene.world_from_instance, scene.origin)


@functools.cache
def code_digest(*, compiled=True):
    """Digest of everything of csm that a number can depend on: modules, core, shaders.

    Parameters
    ----------
    compiled : bool
        Count the compiled core, which two builds of one source may have different bytes of.

    Returns
    -------
    digest : str
        Of the files as they are, whether committed or not.
    """
    kinds = (".py", ".glsl", ".vert", ".frag", ".comp", *([".so"] if compiled else []))
    content = []
    for folder in (Path(__file__).parent, Path(str(resources.files("csm.shaders")))):
        paths = sorted(path for path in folder.rglob("*") if path.suffix in kinds)
        content.append([(str(path.relative_to(folder)), path.read_bytes()) for path in paths])
    return digest(content)


@functools.cache
def commit():
    """Commit of the checkout that csm is used from.

    Returns
    -------
    commit : str
        With ``+changes`` where tracked files differ from it; "" outside of a checkout.
    """
    root = Path(__file__).parents[1]
    if not (root / ".git").exists():
        return ""
    try:
        found = _git(root, "rev-parse", "HEAD")
        return f"{found}+changes" if _git(root, "status", "--porcelain", "-uno") else found
    except (OSError, subprocess.SubprocessError):  # no git, or not ours to read
        return ""


def _git(root, *words):
    command = ["git", "-C", str(root), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=20)
    return done.stdout.strip()


def _feed(hasher, value):
    """Feed a value with its kind and length, so that no two values give one stream."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biuf":
            raise TypeError(f"no digest of an array of {value.dtype}")
        _mark(hasher, "array", value.dtype.str, value.shape)
        hasher.update(np.ascontiguousarray(value))
    elif isinstance(value, bytes):
        _mark(hasher, "bytes", len(value))
        hasher.update(value)
    elif value is None or isinstance(value, (bool, int, float, str, np.generic)):
        _mark(hasher, type(value).__name__, repr(value))
    elif isinstance(value, (tuple, list)):
        _mark(hasher, "sequence", len(value))
        for item in value:
            _feed(hasher, item)
    elif isinstance(value, dict):
        _mark(hasher, "mapping", len(value))
        for key in sorted(value):
            _feed(hasher, key)
            _feed(hasher, value[key])
    elif hasattr(value, "__dict__"):
        _feed(hasher, vars(value))
    else:
        raise TypeError(f"no digest of a {type(value).__name__}")


def _mark(hasher, *words):
    hasher.update(repr(words).encode())
