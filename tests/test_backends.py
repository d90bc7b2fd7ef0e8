"""EGL, OSMesa and GLFW: the same bits, side by side in one process, guests in others' threads."""

import contextlib
import ctypes
import os
import subprocess
import sys

import numpy as np
import pytest
import small_scenes

import csm

BACKENDS = ("egl", "osmesa", "glfw")
OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps", "normal")
SUN = csm.Sun((0.4, 1.0, 0.3))


@pytest.fixture(scope="module")
def open_backends():
    """A renderer of each back end that there is, all alive at once, and why others are not."""
    with contextlib.ExitStack() as stack:
        renderers, reasons = {}, {}
        for name in BACKENDS:
            try:
                renderers[name] = stack.enter_context(csm.Renderer(name, debug=True))
            except csm.ContextError as error:
                reasons[name] = str(error)
        yield renderers, reasons


def need(open_backends, *names):
    """The renderers of these back ends; skips with the reason if one is missing."""
    renderers, reasons = open_backends
    for name in names:
        if name not in renderers:
            pytest.skip(reasons[name])
    return [renderers[name] for name in names]


def bits_of(frame):
    return {name: getattr(frame, name).tobytes() for name in OUTPUTS}


def draw(renderer, number=0, **changes):
    scene = list(small_scenes.SCENES.values())[number % 4]()
    settings = csm.ShadowSettings(**{"map_size": 256, **changes})
    camera = small_scenes.camera(number % 4)
    return renderer.render(scene, camera, SUN, settings, outputs=OUTPUTS)


# -- the same bits ---------------------------------------------------------------------------------


SLOW = pytest.mark.slow


@pytest.mark.parametrize("other", ["osmesa", "glfw"])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        pytest.param({"depth_format": "d16", "filter": "pcf", "filter_size": 2}, marks=SLOW),
        {"depth_format": "d24", "filter": "pcf", "filter_size": 7, "select": "interval"},
        pytest.param({"pancake": True, "fit": "box", "snap": "none"}, marks=SLOW),
    ],
    ids=["default", "d16 2x2", "d24 7x7", "pancake box"],
)
def test_equal_drivers_give_equal_bits(open_backends, other, changes):
    egl, renderer = need(open_backends, "egl", other)
    for fact in ("renderer", "version"):
        if egl.info[fact] != renderer.info[fact]:
            pytest.skip(f"other {fact}: {egl.info[fact]!r}, {renderer.info[fact]!r}")
    for number in range(4):
        assert bits_of(draw(egl, number, **changes)) == bits_of(draw(renderer, number, **changes))


@pytest.mark.parametrize("other", ["osmesa", "glfw"])
def test_different_drivers_stay_within_their_bounds(open_backends, other):
    # docs/architecture.md: coverage exact, depth within 1e-4 for all but 0.02 % of covered texels,
    # mask within 0.1 % of pixels. Equal drivers must meet it all the more.
    egl, renderer = need(open_backends, "egl", other)
    for number in range(4):
        one, two = draw(egl, number), draw(renderer, number)
        covered = one.shadow_maps < 1.0
        assert np.array_equal(covered, two.shadow_maps < 1.0)
        apart = np.abs(one.shadow_maps - two.shadow_maps) > 1e-4
        assert apart[covered].mean() <= 2e-4
        assert (one.mask != two.mask).mean() <= 1e-3


def test_back_ends_draw_in_turns(open_backends):
    renderers, _ = open_backends
    if len(renderers) < 2:
        pytest.skip("only one back end is available")
    alone = {name: [bits_of(draw(r, i)) for i in range(4)] for name, r in renderers.items()}
    for number in (2, 0, 3, 1, 0, 2):
        for name, renderer in renderers.items():
            assert bits_of(draw(renderer, number)) == alone[name][number]


def test_many_renderers_of_one_back_end(fresh_renderer):
    alone = bits_of(draw(fresh_renderer(), 1))
    renderers = [fresh_renderer() for _ in range(6)]
    for _ in range(2):
        for renderer in renderers:
            assert bits_of(draw(renderer, 1)) == alone
    for renderer in renderers[::2]:
        renderer.close()
    for renderer in renderers[1::2]:
        assert bits_of(draw(renderer, 1)) == alone


@pytest.mark.parametrize("backend", BACKENDS)
def test_opening_and_closing_again_and_again(open_backends, backend):
    need(open_backends, backend)
    alone = None
    for _ in range(4):
        with csm.Renderer(backend, debug=True) as renderer:
            bits = bits_of(draw(renderer, 2))
        alone = alone or bits
        assert bits == alone


def run_python(code, *arguments, **environment):
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, **environment}, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


# -- guests ----------------------------------------------------------------------------------------


class Egl:
    """A context of somebody else, made through libEGL by hand."""

    SURFACELESS = 0x31DD

    def __init__(self):
        self.library = ctypes.CDLL("libEGL.so.1")
        for name in ("GetPlatformDisplay", "CreateContext", "GetCurrentContext"):
            getattr(self.library, f"egl{name}").restype = ctypes.c_void_p
        self.display = ctypes.c_void_p(
            self.library.eglGetPlatformDisplay(self.SURFACELESS, None, None)
        )
        if not self.library.eglInitialize(self.display, None, None):
            pytest.skip("no surfaceless EGL display")
        self.library.eglBindAPI(0x30A2)  # EGL_OPENGL_API
        self.context = self.library.eglCreateContext(
            self.display, ctypes.c_void_p(), ctypes.c_void_p(), (ctypes.c_int * 1)(0x3038)
        )
        assert self.context

    def bind(self, context):
        none = ctypes.c_void_p()
        assert self.library.eglMakeCurrent(self.display, none, none, ctypes.c_void_p(context))

    @property
    def current(self):
        return self.library.eglGetCurrentContext()

    def close(self):
        self.bind(None)
        self.library.eglDestroyContext(self.display, ctypes.c_void_p(self.context))


@pytest.mark.parametrize("backend", BACKENDS)
def test_somebody_elses_egl_context_stays_current(open_backends, backend):
    need(open_backends, backend)
    foreign = Egl()
    try:
        foreign.bind(foreign.context)
        renderer = csm.Renderer(backend, debug=True)
        assert foreign.current == foreign.context, "after opening"
        draw(renderer)
        assert foreign.current == foreign.context, "after a render"
        renderer.info  # noqa: B018
        assert foreign.current == foreign.context, "after a question"
        renderer.reload()
        assert foreign.current == foreign.context, "after a reload"
        with pytest.raises(csm.LimitError):
            draw(renderer, map_size=1 << 16)
        assert foreign.current == foreign.context, "after an error"
        renderer.close()
        assert foreign.current == foreign.context, "after closing"
    finally:
        foreign.close()


@pytest.mark.parametrize("backend", BACKENDS)
def test_without_a_foreign_context_none_is_left_behind(open_backends, backend):
    (renderer,) = need(open_backends, backend)
    draw(renderer)
    foreign = Egl()
    try:
        assert not foreign.current
    finally:
        foreign.close()


LATE = """
import ctypes, sys
import csm

scene = csm.scenes.plane_and_box()
camera, sun = scene.cameras["corner"].replace(size=(64, 36)), scene.suns["diagonal"]
renderer = csm.Renderer(sys.argv[1], debug=True)
mask = renderer.render(scene, camera, sun).mask

def is_loaded(name):
    return any(name in line for line in open("/proc/self/maps"))

if sys.argv[1] == "osmesa":
    assert not is_loaded("libEGL.so")
    sys.path.append(sys.argv[2])
    from test_backends import Egl
    foreign = Egl()
    foreign.bind(foreign.context)
    context, current = foreign.context, foreign.library.eglGetCurrentContext
else:
    assert not is_loaded("libOSMesa.so")
    osmesa = ctypes.CDLL("libOSMesa.so.8")
    osmesa.OSMesaCreateContext.restype = ctypes.c_void_p
    current = osmesa.OSMesaGetCurrentContext
    current.restype = ctypes.c_void_p
    pixels = ctypes.create_string_buffer(8 * 8 * 4)
    context = osmesa.OSMesaCreateContext(0x1908, None)  # GL_RGBA
    assert osmesa.OSMesaMakeCurrent(ctypes.c_void_p(context), pixels, 0x1401, 8, 8)
assert context and current() == context
for _ in range(3):
    assert renderer.render(scene, camera, sun).mask.tobytes() == mask.tobytes()
    assert current() == context
renderer.close()
assert current() == context
print("current")
"""


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_library_that_comes_later_keeps_its_context(open_backends, backend):
    """What libraries there are is known from the first frame on, until one comes or goes."""
    need(open_backends, backend, "egl" if backend == "osmesa" else "osmesa")
    result = run_python(LATE, backend, os.path.dirname(__file__))
    assert result.stdout.strip() == "current", result.stderr


GONE = """
import _ctypes, ctypes, sys
import csm

scene = csm.scenes.plane_and_box()
camera, sun = scene.cameras["corner"].replace(size=(64, 36)), scene.suns["diagonal"]
name = "libEGL.so" if sys.argv[1] == "osmesa" else "libOSMesa.so"
masks = set()
with csm.Renderer(sys.argv[1], debug=True) as renderer:
    for _ in range(3):
        masks.add(renderer.render(scene, camera, sun).mask.tobytes())
        library = ctypes.CDLL(f"{name}.{1 if 'EGL' in name else 8}")
        masks.add(renderer.render(scene, camera, sun).mask.tobytes())
        _ctypes.dlclose(library._handle)
print(len(masks))
"""


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_library_that_goes_is_not_asked_any_more(open_backends, backend):
    need(open_backends, backend, "egl" if backend == "osmesa" else "osmesa")
    result = run_python(GONE, backend)
    assert result.returncode == 0
    assert result.stdout.strip() == "1", result.stderr


MODERNGL = """
import sys
import moderngl, csm
backend, through = sys.argv[1:]
options = {"backend": "egl"} if through == "egl" else {}
try:
    context = moderngl.create_standalone_context(require=450, **options)
except Exception as error:
    sys.exit(f"moderngl makes no context: {error}")
target = context.simple_framebuffer((8, 8))
target.use()
scene = csm.scenes.plane_and_box()
camera, sun = scene.cameras["corner"].replace(size=(64, 36)), scene.suns["diagonal"]
settings = csm.ShadowSettings(map_size=64)
for shade in (51, 102, 204):
    target.clear(shade / 255, shade / 255, shade / 255, 1.0)
    with csm.Renderer(backend, debug=True) as renderer:
        mask = renderer.render(scene, camera, sun, settings).mask
        assert target.read(components=1) == bytes([shade]) * 64
        assert renderer.render(scene, camera, sun, settings).mask.tobytes() == mask.tobytes()
    assert target.read(components=1) == bytes([shade]) * 64
    assert context.error == "GL_NO_ERROR"
print("drawn")
"""


@pytest.mark.parametrize("through", ["egl", "glx"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_moderngl_draws_on_as_if_nobody_had_been_there(open_backends, backend, through):
    # In a process of its own: moderngl leaves a released context current.
    pytest.importorskip("moderngl")
    need(open_backends, backend)
    if through == "glx" and not os.environ.get("DISPLAY"):
        pytest.skip("no DISPLAY")
    result = run_python(MODERNGL, backend, through)
    if "moderngl makes no context" in result.stderr:
        pytest.skip(result.stderr.strip())
    assert result.stdout.strip() == "drawn", result.stderr
    assert result.returncode == 0
    assert not result.stderr


# -- choosing --------------------------------------------------------------------------------------


def test_auto_takes_the_first_that_works(open_backends, monkeypatch):
    renderers, _ = open_backends
    monkeypatch.delenv("CSM_BACKEND", raising=False)
    with csm.Renderer() as renderer:
        assert renderer.info["backend"] == next(name for name in BACKENDS if name in renderers)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_environment_replaces_auto(open_backends, monkeypatch, backend):
    need(open_backends, backend)
    monkeypatch.setenv("CSM_BACKEND", backend)
    with csm.Renderer() as renderer:
        assert renderer.info["backend"] == backend


def test_the_environment_never_replaces_a_name(open_backends, monkeypatch):
    need(open_backends, "egl")
    monkeypatch.setenv("CSM_BACKEND", "osmesa")
    with csm.Renderer("egl") as renderer:
        assert renderer.info["backend"] == "egl"


@pytest.mark.parametrize("value", ["", "auto"])
def test_an_empty_environment_is_none(open_backends, monkeypatch, value):
    renderers, _ = open_backends
    monkeypatch.setenv("CSM_BACKEND", value)
    with csm.Renderer() as renderer:
        assert renderer.info["backend"] in renderers


def test_an_unknown_name_in_the_environment_is_refused(monkeypatch):
    monkeypatch.setenv("CSM_BACKEND", "vulkan")
    with pytest.raises(ValueError, match=r"one of auto, egl, osmesa, glfw .*'vulkan'"):
        csm.Renderer()


def test_without_a_display_glfw_says_so():
    environment = {"DISPLAY": "", "WAYLAND_DISPLAY": ""}
    result = run_python("import csm; csm.Renderer('glfw')", **environment)
    assert result.returncode == 1
    assert "ContextError: glfw: " in result.stderr


HIDE = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>
void *dlopen(const char *name, int mode)
{
    void *(*real)(const char *, int) = dlsym(RTLD_NEXT, "dlopen");
    char hidden[256];
    strncpy(hidden, getenv("HIDDEN") ? getenv("HIDDEN") : "", sizeof hidden - 1);
    hidden[sizeof hidden - 1] = 0;
    for (char *word = strtok(hidden, " "); name && word; word = strtok(NULL, " "))
        if (strstr(name, word))
            return NULL;
    return real(name, mode);
}
"""


@pytest.fixture(scope="module")
def hide_libraries(tmp_path_factory):
    """Environment in which libraries whose names hold a word of HIDDEN cannot be opened."""
    folder = tmp_path_factory.mktemp("hide")
    (folder / "hide.c").write_text(HIDE)
    command = ["cc", "-shared", "-fPIC", "-o", folder / "hide.so", folder / "hide.c", "-ldl"]
    try:
        subprocess.run(command, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"no C compiler to hide libraries with: {error}")
    return {"LD_PRELOAD": str(folder / "hide.so"), "CSM_BACKEND": ""}


def test_without_any_library_csm_imports_and_names_what_is_missing(hide_libraries):
    result = run_python(
        "import csm; print([b['available'] for b in csm.backends()]); csm.Renderer()",
        **hide_libraries, HIDDEN="libEGL libOSMesa libglfw",
    )  # fmt: skip
    assert result.returncode == 1
    assert result.stdout.strip() == "[False, False, False]"
    last = result.stderr.strip().splitlines()[-1]
    for part in (
        "ContextError: no OpenGL context: egl: libEGL.so.1 not found; osmesa: libOSMesa",
        "; glfw: libglfw.so.3 not found; ",
        "install libegl1 and libgl1-mesa-dri, or libosmesa6",
    ):
        assert part in last


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [("libEGL", "osmesa"), ("libOSMesa", "egl"), ("libEGL libOSMesa", "glfw")],
)
def test_auto_goes_on_to_the_next(open_backends, hide_libraries, hidden, expected):
    need(open_backends, expected)
    result = run_python(
        "import csm; r = csm.Renderer(); print(r.info['backend']); r.close()",
        **hide_libraries, HIDDEN=hidden,
    )  # fmt: skip
    assert result.stdout.strip() == expected, result.stderr


def test_backends_lists_all_three():
    listed = csm.backends()
    assert [entry["name"] for entry in listed] == list(BACKENDS)
    for entry in listed:
        if entry["available"]:
            assert entry["reason"] == ""
            assert entry["info"]["backend"] == entry["name"]
        else:
            assert entry["reason"].startswith(f"{entry['name']}: ")
            assert entry["info"] == {}


# -- what is said about them -----------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_info_says_what_a_report_needs(open_backends, backend):
    (renderer,) = need(open_backends, backend)
    info = renderer.info
    assert info["backend"] == backend
    assert info["version"].startswith("4.")
    assert float(info["version"][:3]) >= 4.5
    for fact in ("platform", "vendor", "renderer", "glsl"):
        assert isinstance(info[fact], str)
        assert info[fact]
    assert info["software"] is ("llvmpipe" in info["renderer"])
    assert info["max_texture_size"] >= 16384
    assert info["max_layers"] >= 256
    assert info["max_buffer_bytes"] >= 1 << 27
    frame = draw(renderer)
    for fact in ("backend", "platform", "vendor", "renderer", "version", "software"):
        assert frame.info[fact] == info[fact]
