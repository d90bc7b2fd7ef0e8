"""Truths on disk, and what else takes long: made once, by whoever comes first."""

import os
import uuid
import zipfile
from dataclasses import fields
from importlib import metadata
from pathlib import Path

import numpy as np

from .digests import code_digest, digest, scene_digest
from .tracing import Truth, truth

__all__ = ["cached_truth", "kept_on_disk", "truth_arrays", "truth_from_arrays"]

SHOWN = ("scene", "camera", "sun")  # of a Truth: what it is of, which its arrays go without


def cached_truth(
    scene, camera, sun, folder=None, *, rays_per_pixel=1, standard_error=None, progress=None
):
    """Trace the truth, or read it where it was traced before.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    sun : Sun
    folder : path, optional
        Where truths are kept, one ``.npz`` for each scene, camera, sun and number of rays, told
        apart by the digest of their values and of csm; made if need be. Any number of processes
        may use it at once: a file appears when it is complete, and one that does not read is
        traced and written again. Without a folder the truth is traced.
    rays_per_pixel, standard_error, progress
        As for `csm.truth`.

    Returns
    -------
    truth : Truth
        The same to the bit, traced or read.

    Raises
    ------
    ImportError, TypeError, ValueError, KeyboardInterrupt
        As `csm.truth`.
    OSError
        If the folder cannot be written, or another folder is where the truth's file belongs.
    """
    options = {"rays_per_pixel": rays_per_pixel, "standard_error": standard_error}
    if folder is None:
        return truth(scene, camera, sun, **options, progress=progress)
    return kept_on_disk(
        Path(folder) / f"{truth_digest(scene, camera, sun, **options)}.npz",
        make=lambda: truth(scene, camera, sun, **options, progress=progress),
        to_arrays=truth_arrays,
        from_arrays=lambda saved: truth_from_arrays(saved, scene, camera, sun),
    )


def kept_on_disk(path, make, to_arrays, from_arrays):
    """Read what a file holds, or make it and write it there.

    Parameters
    ----------
    path : Path
        An ``.npz``, made with its folder if new; it appears when it is complete, and one that does
        not read is made again.
    make : callable
        Returns it.
    to_arrays, from_arrays : callable
        It as a dict of arrays, and back; the latter may raise KeyError, TypeError or ValueError.

    Returns
    -------
    found : object
        The same, made or read.

    Raises
    ------
    OSError
        If the file cannot be written, or a folder is where it belongs.
    """
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as saved:
            return from_arrays(dict(saved))
    except IsADirectoryError:
        raise IsADirectoryError(
            f"{path}: a folder is where a result is to be kept; move it away"
        ) from None
    except (FileNotFoundError, KeyError, EOFError, ValueError, TypeError, zipfile.BadZipFile):
        pass  # not there, or not whole
    made = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{uuid.uuid4().hex}.npz")
    try:
        np.savez(beside, **to_arrays(made))
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
    return made


def truth_digest(scene, camera, sun, *, rays_per_pixel=1, standard_error=None):
    """Digest of everything that a truth depends on."""
    try:
        tracer = metadata.version("embreex")
    except metadata.PackageNotFoundError:
        tracer = ""
    return digest(
        scene_digest(scene), camera, sun, rays_per_pixel, standard_error, code_digest(), tracer
    )


def truth_arrays(traced):
    """Arrays and numbers of a Truth by name, for a file or another process.

    Parameters
    ----------
    traced : Truth

    Returns
    -------
    arrays : dict of str to ndarray
    """
    arrays = {
        field.name: np.asarray(getattr(traced, field.name))
        for field in fields(Truth)
        if field.name not in SHOWN
    }
    if np.may_share_memory(traced.mask_point, traced.mask):  # a point sun has one
        del arrays["mask_point"]
    return arrays


def truth_from_arrays(arrays, scene, camera, sun):
    """Put a Truth together again.

    Parameters
    ----------
    arrays : dict of str to ndarray
        From `truth_arrays`.
    scene : Scene
    camera : Camera
    sun : Sun

    Returns
    -------
    truth : Truth
    """
    values = {name: array if array.ndim else array.item() for name, array in arrays.items()}
    values.setdefault("mask_point", values["mask"])
    return Truth(**values, scene=scene, camera=camera, sun=sun)
