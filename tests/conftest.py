"""Fixtures of every test: renderers that must stay clean, evidence of what failed, scene files."""

from pathlib import Path

import numpy as np
import pytest
import scene_files
from hard_case_records import Recorder, cases_of

import csm
from csm.cutouts import has_cutout
from csm.pytest_plugin import evidence_folder, write_evidence

_FAILED = pytest.StashKey[bool]()
_RECORDER = pytest.StashKey[Recorder]()
_DRIVER = pytest.StashKey[str]()  # who draws, once somebody does


def pytest_addoption(parser):
    parser.addoption(
        "--hard-cases",
        metavar="FOLDER",
        type=Path,
        help="run only the tests of the hard cases (docs/numerics.md 16) and write their worst "
        "figures and pictures to FOLDER, for `csm hard-cases`",
    )


def pytest_configure(config):
    """A complaint of the driver fails the test that caused it; so does a renderer left open."""
    config.addinivalue_line("markers", "rendered: draws with the back end of CSM_BACKEND")
    config.stash[_RECORDER] = Recorder(config.getoption("--hard-cases"))
    config.addinivalue_line("filterwarnings", "error::csm.GLWarning")
    unclosed = (
        "error:Exception ignored in. .function Renderer:pytest.PytestUnraisableExceptionWarning"
    )
    config.addinivalue_line("filterwarnings", unclosed)


@pytest.hookimpl(tryfirst=True)  # before -m looks at the marks
def pytest_collection_modifyitems(config, items):
    """Mark what the session's back end draws; keep the hard cases if they are asked for."""
    for item in items:
        if {"renderer", "fresh_renderer"} & set(item.fixturenames):
            item.add_marker("rendered")
    if config.getoption("--hard-cases"):
        others = [item for item in items if not cases_of(item.name)]
        config.hook.pytest_deselected(items=others)
        items[:] = [item for item in items if cases_of(item.name)]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.when == "call":
        item.stash[_FAILED] = report.failed
    if report.when == "call" or report.outcome != "passed":
        item.config.stash[_RECORDER].outcome(item.nodeid, report.outcome)
    return report


def pytest_sessionfinish(session):
    session.config.stash[_RECORDER].write(session.config.stash.get(_DRIVER, None))


# -- renderers -------------------------------------------------------------------------------------


class _Idle:
    """A small scene whose frame touches every texture and buffer a renderer keeps from frame to
    frame: after it, what is alive beyond it belongs to scenes and programs."""

    camera = csm.Camera.look_at((0, 3, 2), (0, 0, 0), near=0.5, far=9, size=(8, 8))
    settings = csm.ShadowSettings(cascade_count=1, map_size=8, fit="visible", split="sdsm")
    outputs = (
        "mask",
        "mask_single",
        "valid",
        "view_depth",
        "cascade_index",
        "shadow_maps",
        "normal",
    )

    def __init__(self, renderer):
        self.renderer = renderer
        self.scene = self.make_scene()
        self.draw(self.scene)
        self.objects = {  # of a scene, by whether it has a cut-out
            False: self.added_by(self.make_scene()),
            True: self.added_by(self.make_scene(uv=np.zeros((4, 2)), alpha=np.ones((2, 2)))),
        }
        self.expected = self.unowned_objects()

    @staticmethod
    def make_scene(**cutout):
        positions = [[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [0, 1, 0]]
        return csm.Scene.from_arrays(positions, [[0, 1, 2], [0, 1, 3]], **cutout)

    def beside_programs(self):
        info = self.renderer.info
        return info["live_objects"] - info["programs_compiled"]

    def added_by(self, scene):
        before = self.beside_programs()
        self.draw(scene)
        return self.beside_programs() - before

    def draw(self, scene):
        self.renderer.render(
            scene,
            self.camera,
            csm.Sun((0.3, 1, 0.2)),
            self.settings,
            outputs=self.outputs,
            points=[[0.0, 0.0, 0.0]],
        )

    def unowned_objects(self):
        """OpenGL objects that neither a living scene nor a program accounts for."""
        self.draw(self.scene)
        living = [reference() for reference, _ in list(self.renderer._scenes.values())]
        scenes = sum(self.objects[has_cutout(scene)] for scene in living if scene is not None)
        return self.beside_programs() - scenes


def _complaints(renderer):
    """Messages of weight that nobody has read."""
    return [
        text for _, severity, text in renderer._core.messages() if severity in ("high", "medium")
    ]


@pytest.fixture(scope="session")
def _shared_renderer(pytestconfig):
    with csm.Renderer(debug=True) as renderer:
        info = renderer.info
        pytestconfig.stash[_DRIVER] = f"{info['renderer']}, OpenGL {info['version']}"
        yield renderer


@pytest.fixture(scope="session")
def _idle(_shared_renderer):
    return _Idle(_shared_renderer)


@pytest.fixture
def renderer(_shared_renderer, _idle):
    """A debug renderer, one for the whole session (``CSM_BACKEND`` chooses the back end).

    A test fails if it leaves a driver message of medium or high severity, an OpenGL object that
    no living scene owns, or a closed renderer. Tests of closing, programs and memory take
    `fresh_renderer`.
    """
    yield _shared_renderer
    assert _shared_renderer._core is not None, "the test closed the renderer of the session"
    assert not _complaints(_shared_renderer)
    left = _idle.unowned_objects() - _idle.expected
    _idle.expected += left  # each test answers for its own
    assert left <= 0, f"{left} OpenGL objects leaked"


@pytest.fixture
def fresh_renderer():
    """Function that makes a renderer of the test's own, ``fresh_renderer(backend="auto", **more)``
    with ``debug=True``; all of them are closed afterwards, after a look at their messages."""
    made = []

    def make(backend="auto", **more):
        made.append(csm.Renderer(backend, **{"debug": True, **more}))
        return made[-1]

    yield make
    complaints = [text for one in made if one._core is not None for text in _complaints(one)]
    for one in made:
        one.close()
    assert not complaints


@pytest.fixture(scope="session")
def plain_renderer(gl):
    """A second renderer for the whole session, that reuses nothing."""
    with csm.Renderer() as other:
        yield other


@pytest.fixture
def renderers(renderer, plain_renderer):
    """`renderer` and `plain_renderer`, both at the beginning of a walk."""
    for one in (renderer, plain_renderer):
        one.forget()
    return renderer, plain_renderer


# -- evidence --------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def gl():
    """Skip where no back end opens: what needs one says so."""
    try:
        csm.Renderer().close()
    except csm.ContextError as error:
        pytest.skip(f"no OpenGL here: {error}")


@pytest.fixture
def evidence(request):
    """Function that keeps arrays until it is known whether the test fails; only then they are
    written, with their difference and the settings, to ``shadow-evidence/<test>/``.

    ``evidence(rendered=frame.mask, reference=expected, settings=frame.settings, depth=...)``:
    every array becomes a .npy, a two-dimensional one a .png too (row 0 on top).
    """
    kept = {}
    yield kept.update
    if request.node.stash.get(_FAILED, False) and kept:
        settings = kept.pop("settings", None)
        write_evidence(evidence_folder(request.config, request.node.nodeid), kept, settings)


# -- hard cases ------------------------------------------------------------------------------------


@pytest.fixture
def figure(request):
    """Function that checks and records the worst figure of a hard case.

    ``figure(case, what, worst, tolerance, unit="", picture=None)`` fails if `worst` exceeds
    `tolerance` or is NaN; `case` is an id of the matrix in docs/numerics.md 16. The hard-case
    report shows the worst figure of each `what` with its `picture`, (h, w) or (h, w, 3) uint8 or a
    function that draws it, called only for a report.
    """
    recorder = request.config.stash[_RECORDER]

    def record(case, what, worst, tolerance, unit="", picture=None):
        worst, tolerance = float(worst), float(tolerance)
        recorder.add(case, what, worst, tolerance, unit, request.node.nodeid, picture)
        assert worst <= tolerance, f"{case} {what}: {worst:g} > {tolerance:g} {unit}"

    return record


# -- scene files -----------------------------------------------------------------------------------


@pytest.fixture
def scene_file():
    """Function from the name of a real scene's file to its path; skips where it is absent."""
    return scene_files.scene_path
