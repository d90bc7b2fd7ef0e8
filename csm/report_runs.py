"""What a report shows: techniques swept, the same spot under each, and its flicker."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .camera import Camera
from .digests import digest
from .disc import SOFT_RAYS
from .errors import ContextError, CsmError
from .metrics import compare
from .motion import flicker
from .renderer import Renderer
from .scene import Scene
from .settings import ShadowSettings
from .sun import Sun
from .sweep_cases import cases_of
from .sweeps import TRUTHS, sweep
from .techniques import BASELINE, settings_by_name
from .truth_cache import cached_truth, kept_on_disk

__all__ = ["crop_place", "sweep_techniques", "with_crops_and_flicker"]

CAUSES_SHOWN = (
    "total", "aliasing", "penumbra", "false_shadow", "peter_panning", "light_leak", "seam",
)  # fmt: skip
SHOWN = "shown"  # folder of crops and flicker beside the sweep's truths
SWEPT = 0.8  # of the work, roughly, is the sweep

CROP = (96, 96)  # height and width of the spot [px]
KEPT = 0.9  # of the error in the best crop, that one with the error in its middle must keep
FRAMES = 4  # of the path that flicker is taken from
STEP_SHARE = 4e-3  # of the median depth seen, that the camera goes sideways from frame to frame
TURN_DEG = 0.05
POINTS, SEED = 4000, 1
PATH = (
    f"{FRAMES} frames: from each to the next {STEP_SHARE:g} of the median depth sideways, and "
    f"{TURN_DEG:g} degrees"
)


def crop_place(error, judged, size=CROP):
    """Where a crop of this size holds most of the error, with the error in its middle.

    Of all places the one with the largest sum; from there it moves to the centroid of the error
    within it, as far as the picture goes, if it still holds nine tenths of that sum.

    Parameters
    ----------
    error : (h, w) array_like
        Not negative.
    judged : (h, w) bool
    size : (int, int)
        Height and width [px].

    Returns
    -------
    row, column : int
        Of the upper left corner.
    """
    height, width = (min(a, b) for a, b in zip(size, judged.shape, strict=True))
    # edges that are right count a little, so that a perfect picture is still cut where it matters
    value = np.where(judged, np.asarray(error, float) + 1e-6, 0.0)
    sums = np.pad(value.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    windows = (
        sums[height:, width:] - sums[:-height, width:] - sums[height:, :-width]
        + sums[:-height, :-width]
    )  # fmt: skip
    best = tuple(int(k) for k in np.unravel_index(int(np.argmax(windows)), windows.shape))
    held = value[best[0] : best[0] + height, best[1] : best[1] + width]
    if not held.any():
        return best
    centred = tuple(
        int(np.clip(round(first + _centroid(held.sum(axis=1 - k)) - side / 2), 0, last - 1))
        for k, (first, side, last) in enumerate(
            zip(best, (height, width), windows.shape, strict=True)
        )
    )
    return centred if windows[centred] >= KEPT * windows[best] else best


def _centroid(sums):
    """Where the middle of values along a line lies, in steps from its beginning."""
    return float((sums * (np.arange(len(sums)) + 0.5)).sum() / sums.sum())


def path_of(camera, depth):
    """The camera going sideways and turning a little: a walk that moves edges by parts of texels.

    Parameters
    ----------
    camera : Camera
    depth : float
        Of what is seen [m]: a step is a share of it.

    Returns
    -------
    cameras : list of Camera
        The first is `camera` itself.
    """
    path = [camera]
    for step in range(1, FRAMES):
        angle = np.radians(TURN_DEG * step)
        ahead = np.sin(angle) * camera.right - np.cos(angle) * camera.backward
        eye = camera.eye + STEP_SHARE * depth * step * camera.right
        if camera.orthographic:
            path.append(camera.translated(eye - camera.eye))
            continue
        path.append(
            Camera.look_at(
                eye, eye + ahead, up=camera.up, fov_y_deg=camera.fov_y_deg, near=camera.near,
                far=camera.far, size=camera.size,
            )
        )  # fmt: skip
    return path


def sweep_techniques(
    cases,
    *,
    families=None,
    base=None,
    out=None,
    size=None,
    repeats=None,
    rays_per_pixel=SOFT_RAYS,
    standard_error=None,
    causes=True,
    processes=1,
    client=None,
    backend="auto",
    progress=None,
):
    """Measure the techniques of the literature on scenes: all that `csm.report` shows.

    Parameters
    ----------
    cases : mapping of str to (scene, camera, sun)
        As for `csm.sweep`, objects or names.
    families : sequence of str, optional
        Of `csm.techniques.FAMILIES`; all of them by default. The baseline is always among them.
    base : ShadowSettings, optional
        What the techniques change.
    out : path, optional
        Folder of the sweep, where it goes on if it was stopped, crops and flicker included.
    size : (int, int), optional
        Width and height of every picture [px], instead of the cameras' own.
    repeats : int, optional
        As for `csm.sweep`.
    rays_per_pixel : int
        Of the truth, for suns with a disc; a point sun takes one whatever it says.
    standard_error : float, optional
        As for `csm.truth`: rays are added until that of a soft truth is at most this.
    causes : bool
        Whether errors are told by cause, which takes a ray per pixel and texel of every kernel.
    processes, client
        As for `csm.sweep`; crops and flicker are made in this process.
    backend : str
    progress : callable, optional
        Takes the share done, 0 to 1.

    Returns
    -------
    dataset : xarray.Dataset
        Of `csm.sweep` over an axis ``technique``, with crops and flicker: for `csm.report`.

    Raises
    ------
    ValueError
        If a name is no family; and as `csm.sweep`.
    TypeError, OSError, ImportError, ContextError, BlockingIOError, KeyboardInterrupt
        As `csm.sweep`.

    Examples
    --------
    >>> import csm
    >>> case = ("plane_and_box", "corner", "diagonal")
    >>> found = csm.sweep_techniques({"box": case}, families=["bias and selection"],
    ...     size=(64, 48), repeats=1, causes=False)
    >>> found.sizes["case"], "flicker" in found
    (1, True)
    """
    rays = {"rays_per_pixel": rays_per_pixel, "standard_error": standard_error}
    tell = progress or (lambda share: None)
    techniques = settings_by_name(families)
    cases = {case.name: case for case in cases_of(cases, size)}
    dataset = sweep(
        cases,
        {"technique": techniques},
        base=base,
        out=out,
        repeats=repeats,
        **rays,
        causes=CAUSES_SHOWN if causes else None,
        processes=processes,
        client=client,
        backend=backend,
        progress=lambda share: tell(SWEPT * share),
    )
    return with_crops_and_flicker(
        dataset,
        {name: (case.scene, case.camera, case.sun) for name, case in cases.items()},
        base=base,
        **rays,
        out=out,
        backend=backend,
        advance=lambda share: tell(SWEPT + (1.0 - SWEPT) * share),
    )


def with_crops_and_flicker(
    dataset,
    cases,
    *,
    base=None,
    rays_per_pixel=1,
    standard_error=None,
    out=None,
    backend="auto",
    advance=None,
):
    """Add crops and flicker to a sweep over techniques.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `csm.sweep` with an axis ``technique`` of `settings_by_name`.
    cases : mapping of str to (scene, camera, sun)
        Objects, the cameras of the sizes that were swept.
    base : ShadowSettings, optional
        What the techniques change.
    rays_per_pixel, standard_error
        Of the truth, as the sweep had them.
    out : path, optional
        Folder of the sweep: truths are read there, crops and flicker kept there.
    backend : str
    advance : callable, optional
        Takes the share done, 0 to 1.

    Returns
    -------
    dataset : xarray.Dataset
        With ``crop`` (case, technique, y, x) and ``crop_truth`` (case, y, x), visibilities, NaN
        where the truth sees no surface;
        ``crop_row`` and ``crop_column`` (case); ``flicker`` and ``flicker_transition`` (case,
        technique).
    """
    base = ShadowSettings() if base is None else base
    names = [str(name) for name in dataset.technique.values]
    changes = settings_by_name()
    shape = (len(cases), len(names))
    crops = np.full((*shape, *CROP), np.nan, np.float32)
    shown_truths = np.full((shape[0], *CROP), np.nan)
    places, rates = np.zeros((shape[0], 2), int), np.full((*shape, 2), np.nan)
    rays = {"rays_per_pixel": rays_per_pixel, "standard_error": standard_error}
    truths = None if out is None else Path(out) / TRUTHS
    sound = dataset.status.values == "ok"
    # one for all: its programs are made once
    with Renderer(backend) as renderer:
        for i, (scene, camera, sun) in enumerate(cases.values()):
            if not sound[i].any():
                continue  # not even a truth, maybe
            exact = cached_truth(scene, camera, sun, truths, **rays)
            look = _look(renderer, exact, base.replace(**changes[BASELINE]))
            places[i] = [part.start for part in look.cut]
            seen = exact.valid[look.cut]
            shown_truths[i, : seen.shape[0], : seen.shape[1]] = np.where(
                seen, exact.mask[look.cut], np.nan
            )
            for j in np.flatnonzero(sound[i]):
                key = "" if out is None else str(dataset.key.values[i, j])
                mask, rates[i, j] = look.kept(base.replace(**changes[names[j]]), out, key)
                crops[i, j, : seen.shape[0], : seen.shape[1]] = np.where(seen, mask, np.nan)
                if advance is not None:
                    advance((i + (j + 1) / shape[1]) / shape[0])
    place = ("case", "technique")
    found = dataset.assign(
        crop=((*place, "y", "x"), crops),
        crop_truth=(("case", "y", "x"), shown_truths),
        crop_row=("case", places[:, 0]),
        crop_column=("case", places[:, 1]),
        flicker=(place, rates[..., 0], {"units": "1"}),
        flicker_transition=(place, rates[..., 1], {"units": "1"}),
    )
    return found.assign_attrs(flicker_path=PATH, flicker_points=POINTS, flicker_seed=SEED)


def _look(renderer, exact, baseline):
    """What is looked at in a case: where the baseline is most wrong, and points along a path."""
    points = _points_of(exact)
    path = path_of(exact.camera, _median_depth(exact.camera, points[0]))
    report = compare(renderer.render(exact.scene, exact.camera, exact.sun, baseline), exact)
    row, column = crop_place(np.abs(report.per_pixel["total"]), report.judged)
    cut = np.s_[row : row + CROP[0], column : column + CROP[1]]
    return _Look(renderer, exact.scene, path, exact.sun, points, cut)


def _points_of(exact):
    """Points and normals of visible surfaces that face the sun, the same for all techniques."""
    seen = exact.valid & exact.facing
    points, normals = exact.position[seen], exact.normal[seen]
    chosen = np.random.default_rng(SEED).permutation(len(points))[:POINTS]
    return points[chosen], normals[chosen]


def _median_depth(camera, points):
    if not len(points):
        return 0.0
    return float(np.median((points - camera.eye) @ -camera.backward))


@dataclass(frozen=True)
class _Look:
    """What is looked at under every technique: a crop of a path's first frame, points along it."""

    renderer: Renderer
    scene: Scene
    path: list
    sun: Sun
    points: tuple
    cut: tuple

    def kept(self, settings, out, key):
        """Crop and flicker, from the sweep's folder, where they stay under the point's key.

        NaN where they cannot be had, as of maps too large for the driver beside all else.
        """
        try:
            return self._kept(settings, out, key)
        except ContextError:
            raise  # not the technique's fault
        except (CsmError, MemoryError) as error:
            warnings.warn(f"no crop and no flicker: {error}", stacklevel=3)
            return np.nan, np.full(2, np.nan)

    def _kept(self, settings, out, key):
        if out is None:
            return self._taken(settings)
        name = digest(key, [part.start for part in self.cut])
        return kept_on_disk(
            Path(out) / SHOWN / f"{name}.npz",
            make=lambda: self._taken(settings),
            to_arrays=lambda found: {"crop": found[0], "flicker": found[1]},
            from_arrays=lambda saved: (saved["crop"], saved["flicker"]),
        )

    def _taken(self, settings):
        frames = [
            self.renderer.render(
                self.scene, camera, self.sun, settings, outputs=() if step else ("mask",),
                points=self.points[0], point_normals=self.points[1],
            )
            for step, camera in enumerate(self.path)
        ]  # fmt: skip
        found = flicker(frames, scene=self.scene)
        return frames[0].mask[self.cut], np.array([found.mean, found.transition])
