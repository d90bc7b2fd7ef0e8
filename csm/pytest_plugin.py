"""For the test suites of engines: shadows of a scene against ray tracing, with evidence on failure.

Installed with csm, pytest knows the fixture `shadow_case` without a line of configuration.
"""

import hashlib
import json
import numbers
import re
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
import pytest

__all__ = ["ShadowCase", "assert_shadows_match", "write_evidence"]

EVIDENCE = "shadow-evidence"
SETTINGS, NUMBERS = "settings.json", "numbers.json"
LONGEST = 120  # characters of a test's name in that of its folder
RANGES = {"rendered": (0.0, 1.0), "reference": (0.0, 1.0), "difference": (-1.0, 1.0)}


@dataclass(frozen=True, eq=False)
class ShadowCase:
    """One scene under one camera and sun: what was rendered, and what is right.

    Attributes
    ----------
    frame : Frame
    truth : Truth
    report : ErrorReport
    folder : Path
        Where `check` leaves its evidence.
    """

    frame: object
    truth: object
    report: object
    folder: Path

    def check(self, *, max_error, causes=None):
        """`assert_shadows_match` of this case."""
        __tracebackhide__ = True
        assert_shadows_match(
            self.frame, self.truth, max_error=max_error, causes=causes, folder=self.folder
        )


def assert_shadows_match(frame, truth, *, max_error, causes=None, folder=None):
    """Fail if shadows are further from the truth than allowed, and leave evidence.

    Parameters
    ----------
    frame : Frame or (h, w) array_like
        As for `csm.compare`: a Frame, or a mask of any engine.
    truth : Truth or (h, w) array_like
    max_error : float
        Largest disagreement and largest mean absolute error, as a fraction.
    causes : mapping of str to float, optional
        Largest mean absolute error of single causes, e.g. ``{"false_shadow": 1e-3}``.
    folder : path, optional
        Where rendered, reference and difference (PNG and npy), errors, and of a Frame and a Truth
        settings, camera, sun, rays and the scene's digest go on failure. By default the folder of
        the test that runs, as of `shadow_case`; without one, nowhere. What lies there is replaced
        by a failure.

    Raises
    ------
    AssertionError
        With the numbers, and the folder of the evidence.
    ValueError
        If a limit is no fraction, or a cause cannot be told from what is given.
    """
    __tracebackhide__ = True
    from .causes import CAUSES
    from .metrics import compare

    limits = {"max_error": max_error, **(causes or {})}
    for name, limit in limits.items():
        real = isinstance(limit, numbers.Real) and not isinstance(limit, bool)
        if not real or not 0.0 <= limit <= 1.0:
            raise ValueError(f"{name} must be a fraction from 0 to 1 (got {limit!r})")
    report = compare(frame, truth)
    for cause in causes or ():
        if cause not in (*CAUSES, *report.mean):
            raise ValueError(f"causes: there is no {cause!r}; there are {', '.join(report.mean)}")
    folder = _running.get("folder") if folder is None else folder
    if not report.judged_count:
        said = "no pixel shows a surface that faces the sun: nothing was judged"
        raise AssertionError(said + _evidence(folder, frame, truth, {}))
    found = {
        "disagreement": (report.disagreement, max_error),
        "mean error": (report.mean["total"], max_error),
        **{cause: (report.mean[cause], limit) for cause, limit in (causes or {}).items()},
    }
    broken = {name: pair for name, pair in found.items() if not pair[0] <= pair[1]}
    if not broken:
        return
    lines = [f"{name} {value:.4%} > {limit:.4%}" for name, (value, limit) in broken.items()]
    said = "shadows do not match: " + "; ".join(lines)
    raise AssertionError(said + _evidence(folder, frame, truth, found))


def _evidence(folder, frame, truth, found):
    """Write evidence, if there is a place for it, and say where."""
    if folder is None:
        return ""
    arrays = {
        "rendered": getattr(frame, "mask", frame),
        "reference": getattr(truth, "mask", truth),
    }
    shown = _what_is_shown(frame, truth) if hasattr(frame, "settings") else None
    _remove_files(Path(folder))
    write_evidence(folder, arrays, shown, {"errors": found})
    return f"; see {folder}"


def _what_is_shown(frame, truth):
    """What it takes to repeat a comparison, in plain values; of the scene what tells it apart."""
    from .digests import scene_digest
    from .sweep_cases import camera_text, sun_text

    scene = truth.scene
    return {
        "settings": frame.settings.to_dict(),
        "camera": json.loads(camera_text(frame.camera)),
        "sun": json.loads(sun_text(frame.sun)),
        "rays_per_pixel": truth.rays_per_pixel,
        "scene": {
            "name": scene.name,
            "digest": scene_digest(scene),
            "triangles": int(scene.triangle_count),
        },
    }


def write_evidence(folder, arrays, settings=None, more=None):
    """Write what explains a failed comparison.

    Parameters
    ----------
    folder : path
        Made if need be.
    arrays : mapping of str to ndarray
        Each becomes a .npy, a two-dimensional one a .png too (row 0 on top). ``rendered`` and
        ``reference`` of one shape also give their ``difference``. Masks are drawn from black, 0, to
        white, 1, the difference from black, -1, to white, 1; anything else over its own values.
    settings : ShadowSettings or mapping, optional
        Becomes settings.json.
    more : mapping, optional
        Becomes numbers.json.
    """
    from .pictures import save_png

    folder, arrays = Path(folder), {name: np.asarray(array) for name, array in arrays.items()}
    folder.mkdir(parents=True, exist_ok=True)
    if settings is not None:
        plain = settings.to_dict() if hasattr(settings, "to_dict") else settings
        (folder / SETTINGS).write_text(json.dumps(plain, indent=1, default=str))
    if more is not None:
        (folder / NUMBERS).write_text(json.dumps(more, indent=1, default=float))
    rendered, reference = arrays.get("rendered"), arrays.get("reference")
    if rendered is not None and reference is not None and rendered.shape == reference.shape:
        arrays["difference"] = rendered.astype(np.float64) - reference.astype(np.float64)
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)
        if array.ndim == 2:
            save_png(folder / f"{name}.png", grey_picture(array, RANGES.get(name)))


def grey_picture(array, span=None):
    """Bytes of a two-dimensional array from black to white.

    Parameters
    ----------
    array : (h, w) array_like
    span : (float, float), optional
        Values of black and white; those of the array itself that are finite by default.

    Returns
    -------
    picture : (h, w, 3) uint8
    """
    values = np.asarray(array, np.float64)
    finite = values[np.isfinite(values)]
    if span is None:
        span = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
    low, high = span
    grey = np.nan_to_num((values - low) / ((high - low) or 1.0), nan=0.0, posinf=1.0, neginf=0.0)
    grey = np.clip(grey, 0.0, 1.0)
    return np.repeat(np.round(255 * grey).astype(np.uint8)[..., None], 3, axis=-1)


def evidence_folder(config, nodeid):
    """Folder of one test's evidence, below the root of the suite or where the option says.

    The digest in its name tells tests apart whose names do not: ``x[a/b]`` and ``x[a_b]``.
    """
    name = re.sub(r"[^\w.\-]+", "_", nodeid.removeprefix("tests/"))[:LONGEST]
    name += f"-{hashlib.sha256(nodeid.encode()).hexdigest()[:8]}"
    return Path(config.getoption("shadow_evidence") or config.rootpath / EVIDENCE) / name


def _remove_files(folder):
    """Remove the files of evidence in a folder, and nothing else."""
    for name in (SETTINGS, NUMBERS, *(f"{n}{e}" for n in RANGES for e in (".npy", ".png"))):
        with suppress(OSError):
            (folder / name).unlink()


def _remove_evidence(folder):
    """Remove what an earlier run of a test left, and nothing else."""
    for path in (*folder.glob("case_*"), folder):
        _remove_files(path)
        with suppress(OSError):  # something of somebody else's, or not there
            path.rmdir()


_running = {}  # "folder": that of the evidence of the test that runs


@pytest.hookimpl(tryfirst=True)  # before the fixtures, which may leave evidence
def pytest_runtest_setup(item):
    """Know where evidence of the test goes that begins, and remove what an earlier run left."""
    folder = _running["folder"] = evidence_folder(item.config, item.nodeid)
    if folder.exists():
        _remove_evidence(folder)


def pytest_unconfigure():
    """Forget it again: what fails in a fixture's end is still the last test's."""
    _running.clear()


def pytest_addoption(parser):
    """Let the command line name the folder of the evidence."""
    parser.getgroup("csm").addoption(
        "--shadow-evidence",
        metavar="FOLDER",
        help=f"where failed comparisons of shadows leave their pictures (default {EVIDENCE})",
    )


@pytest.fixture(scope="session")
def shadow_renderer():
    """A Renderer for the whole session; skips where there is no OpenGL 4.5."""
    from .errors import ContextError
    from .renderer import Renderer

    try:
        renderer = Renderer()
    except ContextError as error:
        pytest.skip(f"no OpenGL: {error}")
    with renderer:
        yield renderer


@pytest.fixture(scope="session")
def _shadow_truths():
    return {}


@pytest.fixture
def shadow_case(request, shadow_renderer, _shadow_truths):
    """Function that renders a scene and traces its truth, once for equal scene, camera and sun.

    ``shadow_case(scene, camera, sun, settings=None, *, rays_per_pixel=1)`` gives a `ShadowCase`;
    its ``check(max_error=..., causes={...})`` fails with evidence in the test's own folder, of a
    second case in ``case_2`` in it, and so on. What an earlier run left there goes first.
    """
    from .camera import Camera
    from .metrics import compare
    from .scene import Scene
    from .settings import ShadowSettings
    from .sun import Sun
    from .tracing import truth as trace

    folder = evidence_folder(request.config, request.node.nodeid)
    numbers_of_cases = count(1)

    def make(scene, camera, sun, settings=None, *, rays_per_pixel=1):
        settings = ShadowSettings() if settings is None else settings
        for name, value, kind in (
            ("scene", scene, Scene), ("camera", camera, Camera), ("sun", sun, Sun),
            ("settings", settings, ShadowSettings),
        ):  # fmt: skip
            if not isinstance(value, kind):
                raise TypeError(
                    f"shadow_case: {name} must be a csm.{kind.__name__} (got {value!r}); "
                    "csm.scenes makes scenes, csm.load reads them, and a scene has cameras and suns"
                )
        key = (scene, camera, tuple(sun.to_light), sun.angular_diameter_deg, rays_per_pixel)
        if key not in _shadow_truths:
            _shadow_truths[key] = trace(scene, camera, sun, rays_per_pixel=rays_per_pixel)
        truth = _shadow_truths[key]
        outputs = ("mask", "mask_single", "valid", "cascade_index")
        frame = shadow_renderer.render(scene, camera, sun, settings, outputs=outputs)
        number = next(numbers_of_cases)
        own = folder if number == 1 else folder / f"case_{number}"
        return ShadowCase(frame, truth, compare(frame, truth), own)

    return make
