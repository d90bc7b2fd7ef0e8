"""Bad input: an exception of the right class whose text names the argument, the value and the rule,
and a renderer that goes on as if nothing had happened. Bad commands are in test_cli.py."""

import json
import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest

import csm

NAN, INF = float("nan"), float("inf")
TRIANGLE = ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
CAMERA = csm.Camera.look_at((0, 3, 5), (0, 0, 0), near=0.5, far=40, size=(32, 18))
SUN = csm.Sun((1, 2, 1))
SETTINGS = csm.ShadowSettings(map_size=64)
FLAT = np.diag([1.0, 1, 0, 1])
PROJECTIVE = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0]])


def bad(id_, words, call, error=ValueError):
    """A call, the class it raises, and what the text must say: argument, value, rule."""
    return pytest.param(call, error, words.split("|"), id=id_)


def mesh(positions=TRIANGLE[0], triangles=TRIANGLE[1]):
    return csm.Mesh(positions, triangles)


def settings(**changes):
    return csm.ShadowSettings(**changes)


def look(**changes):
    return csm.Camera.look_at(**{"eye": (0, 1, 5), "target": (0, 0, 0), **changes})


def scene():
    return csm.Scene.from_arrays(*TRIANGLE)


def check(caught, words):
    for word in words:
        assert word in str(caught.value), str(caught.value)


# -- values ----------------------------------------------------------------------------------------

VALUES = [
    bad("NaN vertex", "positions|vertex 1|nan|finite",
        lambda: mesh([(0, 0, 0), (1, NAN, 0), (0, 1, 0)])),
    bad("infinite vertex", "positions|vertex 0|inf|finite", lambda: mesh([(INF, 0, 0)] * 3)),
    bad("flat positions", "positions|(9,)|(n, 3)", lambda: mesh(np.zeros(9))),
    bad("text for positions", "positions|<U1|real numbers", lambda: mesh([("a", "b", "c")] * 3),
        TypeError),
    bad("complex positions", "positions|complex128|real", lambda: mesh(np.zeros((3, 3), complex)),
        TypeError),
    bad("no triangle", "triangles|at least one|0",
        lambda: mesh(triangles=np.zeros((0, 3), int))),
    bad("index out of range", "triangles|0 to 2|3", lambda: mesh(triangles=[(0, 1, 3)])),
    bad("negative index", "triangles|0 to 2|-1", lambda: mesh(triangles=[(0, 1, -1)])),
    bad("float triangles", "triangles|float64|integers", lambda: mesh(triangles=[(0.0, 1.0, 2.0)]),
        TypeError),
    bad("quads", "triangles|(1, 4)|(m, 3)", lambda: mesh(triangles=[(0, 1, 2, 0)])),
    bad("empty scene", "scene|at least one mesh|none", lambda: csm.Scene([])),
    bad("no Mesh", "meshes|csm.Mesh|int", lambda: csm.Scene([5]), TypeError),
    bad("instance of no mesh", "instance_mesh|0 to 0|1", lambda: csm.Scene([mesh()], [0, 1])),
    bad("transform of another shape", "world_from_instance|(1, 4, 4)|(3, 3)",
        lambda: csm.Scene([mesh()], [0], np.eye(3))),
    bad("NaN transform", "world_from_instance|finite|instance 0|nan",
        lambda: csm.Scene([mesh()], [0], [np.diag([1, 1, 1, NAN])])),
    bad("projective transform", "world_from_instance|affine|instance 1",
        lambda: csm.Scene([mesh()], [0, 0], [np.eye(4), PROJECTIVE])),
    bad("flat transform", "world_from_instance|invertible|instance 0",
        lambda: csm.Scene([mesh()], [0], [FLAT])),
    bad("unknown clip", "clip|'walk'|not animated", lambda: scene().at("walk", 0.0)),
    bad("ground at NaN", "y|nan|finite", lambda: scene().with_ground(NAN)),
    bad("merged with an array", "merge|csm.Scene|ndarray", lambda: scene().merge(np.eye(3)),
        TypeError),
    bad("infinite height", "heights|finite|infinite",
        lambda: csm.Scene.from_elevation([[0, INF], [0, 0]], 1)),
    bad("row of heights", "heights|(rows, columns)|(5,)",
        lambda: csm.Scene.from_elevation(np.zeros(5), 1)),
    bad("terrain of holes", "heights|NaN|hole",
        lambda: csm.Scene.from_elevation(np.full((3, 3), NAN), 1)),
    bad("negative cell", "cell_size|positive|-1",
        lambda: csm.Scene.from_elevation(np.zeros((2, 2)), -1.0)),
    bad("far before near", "far|near 10|far 2", lambda: look(near=10, far=2)),
    bad("near 0", "near|> 0|near 0", lambda: look(near=0)),
    bad("NaN eye", "eye|nan|finite", lambda: look(eye=(0, NAN, 0))),
    bad("eye at target", "target|eye|differ", lambda: look(eye=(1, 2, 3), target=(1, 2, 3))),
    bad("up along the view", "up|parallel", lambda: look(eye=(0, 9, 0))),
    bad("field of view of 180 degrees", "fov_y_deg|180|between 0 and 180",
        lambda: look(fov_y_deg=180)),
    bad("image of no width", "size|(0, 9)|1 to 16384", lambda: look(size=(0, 9))),
    bad("image of half pixels", "size|(1.5, 9)|whole pixels", lambda: look(size=(1.5, 9)),
        TypeError),
    bad("zero sun", "to_light|zero|[0.0, 0.0, 0.0]", lambda: csm.Sun((0, 0, 0))),
    bad("sun in the plane", "to_light|3 numbers|(2,)", lambda: csm.Sun((1, 2))),
    bad("sun as wide as the sky", "angular_diameter_deg|180", lambda: csm.Sun((0, 1, 0), 180.0)),
    bad("sun beyond the zenith", "elevation_deg|91|90", lambda: csm.Sun.from_compass(0, 91)),
]  # fmt: skip

SETTING_VALUES = [
    bad("no cascade", "cascade_count|1 to 8|0", lambda: settings(cascade_count=0)),
    bad("huge cascade_count", "cascade_count|1 to 8|1000000",
        lambda: settings(cascade_count=1_000_000)),
    bad("cascade_count beyond C", "cascade_count|32 bits|1" + 30 * "0",
        lambda: settings(cascade_count=10**30)),
    bad("half a cascade", "cascade_count|whole|2.5", lambda: settings(cascade_count=2.5)),
    bad("cascade_count as text", "cascade_count|whole|'4'", lambda: settings(cascade_count="4"),
        TypeError),
    bad("map of 70,000", "map_size|1 to 65536|70000", lambda: settings(map_size=70_000)),
    bad("map of nothing", "map_size|1 to 65536|0", lambda: settings(map_size=0)),
    bad("a map too few", "map_size|4 cascades|got 3", lambda: settings(map_size=(64, 64, 64))),
    bad("even kernel", "filter_size|odd|4", lambda: settings(filter="pcf", filter_size=4)),
    bad("huge kernel", "filter_size|65|67", lambda: settings(filter="pcf", filter_size=67)),
    bad("unknown filter", "filter|hard none pcf|'blurry'", lambda: settings(filter="blurry")),
    bad("filter as number", "filter|string|3", lambda: settings(filter=3), TypeError),
    bad("negative lam", "lam|0 to 1|-0.1", lambda: settings(lam=-0.1)),
    bad("lam of NaN", "lam|finite|nan", lambda: settings(lam=NAN)),
    bad("bias without end", "slope_bias|finite|inf", lambda: settings(slope_bias=INF)),
    bad("pancake as text", "pancake|True or False|'yes'", lambda: settings(pancake="yes"),
        TypeError),
    bad("unknown setting", "'blur'|no setting|filter_size", lambda: settings().replace(blur=3),
        TypeError),
    bad("too few manual splits", "manual_splits|3 inner|got 1",
        lambda: settings(split="manual", manual_splits=(5.0,))),
    bad("manual splits that fall", "manual_splits|ascending|number 2 is 4",
        lambda: settings(split="manual", manual_splits=(5, 4, 6))),
    bad("one number for manual splits", "manual_splits|sequence|5",
        lambda: settings(split="manual", manual_splits=5), TypeError),
    bad("several at once", "cascade_count|filter_size|lam|\n",
        lambda: settings(cascade_count=9, filter_size=4, lam=2)),
    bad("split_distances, far first", "far|near|near 10, far 2",
        lambda: csm.split_distances(10, 2, 4)),
    bad("split_distances, unknown scheme", "scheme|practical, uniform, logarithmic|'golden'",
        lambda: csm.split_distances(1, 2, 4, scheme="golden")),
    bad("split_distances, lam", "lam|0 to 1|2", lambda: csm.split_distances(1, 2, 4, lam=2)),
    bad("plan of a dict", "settings|csm.ShadowSettings|dict", lambda: csm.plan({}), TypeError),
    bad("plan of no pixels", "size|-5|1 to", lambda: csm.plan(SETTINGS, size=(-5, 3))),
    bad("fit to what is seen without it", "receivers|visible",
        lambda: csm.fit_cascades(CAMERA, SUN, settings(fit="visible"))),
    bad("percents beyond the range", "manual_splits|percents between 0 and 100|120",
        lambda: settings(cascade_count=2, split="percentages", manual_splits=(120.0,))),
    bad("depth range from far to near", "manual_depth_range|ascending|5, -5",
        lambda: settings(depth_range="manual", manual_depth_range=(5.0, -5.0))),
    bad("receivers that are no numbers", "receivers|finite|number 1 is",
        lambda: csm.fit_cascades(
            CAMERA, SUN, SETTINGS, receivers=[(0.0, 0, 0), (0, np.nan, 0)])),
    bad("another clip range", "clip_z|(0, 1), (-1, 1)|0, 2",
        lambda: csm.Cascades.from_matrices(np.eye(4)[None], [1, 2], 64, clip_z=(0, 2))),
    bad("held by a number", "held|csm.Cascades|3",
        lambda: csm.fit_cascades(CAMERA, SUN, SETTINGS, held=3), TypeError),
    bad("fit without a camera", "camera|csm.Camera|NoneType",
        lambda: csm.fit_cascades(None, SUN, SETTINGS), TypeError),
    bad("fit to receivers in the plane", "receivers|(m, 3)|(4, 2)",
        lambda: csm.fit_cascades(CAMERA, SUN, SETTINGS, receivers=np.zeros((4, 2)))),
    bad("manual splits beyond far", "manual_splits|far 40|50",
        lambda: csm.fit_cascades(
            CAMERA, SUN, settings(cascade_count=2, split="manual", manual_splits=(50.0,)))),
    bad("map below its kernel", "map_size|> 33|16 texels|got 16",
        lambda: csm.fit_cascades(
            CAMERA, SUN, settings(map_size=16, filter="pcf", filter_size=33))),
    bad("logarithmic splits from behind the eye", "near|> 0|-5",
        lambda: csm.fit_cascades(
            csm.Camera.orthographic((0, 3, 0), (0, 0, 1), near=-5), SUN, SETTINGS)),
    bad("compare with nothing", "truth|(h, w)|real numbers",
        lambda: csm.compare(np.zeros((2, 2)), None)),
    bad("compare masks of two shapes", "(2, 2)|(3, 3)",
        lambda: csm.compare(np.zeros((2, 2)), np.zeros((3, 3)))),
]  # fmt: skip


@pytest.mark.parametrize(("call", "error", "words"), VALUES)
def test_bad_scene_camera_or_sun(call, error, words):
    with pytest.raises(error) as caught:
        call()
    check(caught, words)


@pytest.mark.parametrize(("call", "error", "words"), SETTING_VALUES)
def test_bad_setting_or_argument_of_a_function(call, error, words):
    with pytest.raises(error) as caught:
        call()
    check(caught, words)


# -- files -----------------------------------------------------------------------------------------


def broken_views(folder):
    (folder / "it.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    views = {"it": {"file": "it.obj", "cameras": {"c": {"eye": [0, 0, 1]}}}}
    (folder / "scenes.json").write_text(json.dumps(views))
    return csm.load(folder / "it.obj")


def written(name, content):
    def load(folder):
        (folder / name).write_bytes(content)
        return (csm.load_elevation if name.endswith((".npz", ".npy")) else csm.load)(folder / name)

    return load


def archive_without_cell(folder):
    np.savez(folder / "dem.npz", elevation=np.zeros((3, 3)))
    return csm.load_elevation(folder / "dem.npz")


FILES = [
    bad("missing mesh", "nowhere.glb|no such file", lambda f: csm.load(f / "nowhere.glb"),
        FileNotFoundError),
    bad("missing grid", "nowhere.npy|no such file", lambda f: csm.load_elevation(f / "nowhere.npy"),
        FileNotFoundError),
    bad("unknown suffix", "it.docx|.glb", written("it.docx", b"x")),
    bad("broken glb", "it.glb", written("it.glb", b"glTF\2\0\0\0no more")),
    bad("broken gltf", "it.gltf", written("it.gltf", b"{")),
    bad("empty obj", "it.obj|no triangles", written("it.obj", b"# nothing\n")),
    bad("broken npz", "it.npz|.npz archive", written("it.npz", b"PK no zip")),
    bad("grid without a cell size", "dem.npz|cell|got elevation", archive_without_cell),
    bad("unfinished scenes.json", "scenes.json|it.obj|'at'", broken_views),
]  # fmt: skip


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # numpy, of a broken archive
@pytest.mark.parametrize(("call", "error", "words"), FILES)
def test_bad_file(tmp_path, call, error, words):
    pytest.importorskip("trimesh", reason="files of meshes need the extra [mesh]")
    with pytest.raises(error) as caught:
        call(tmp_path)
    check(caught, words)


# -- renders ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def view():
    scene = csm.scenes.plane_and_box()
    camera = csm.Camera.look_at((-6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=100, size=(32, 18))
    return scene, camera, scene.suns["morning"]


def other_out(renderer, view, **camera):
    """An earlier frame that does not fit."""
    return renderer.render(view[0], view[1].replace(**camera), view[2], SETTINGS)


def frozen_out(renderer, view):
    frame = renderer.render(*view, SETTINGS)
    frame.mask.flags.writeable = False
    return frame


RENDERS = [
    bad("no scene", "scene|csm.Scene|NoneType",
        lambda r, v: r.render(None, v[1], v[2]), TypeError),
    bad("camera and sun swapped", "camera|csm.Camera|Sun",
        lambda r, v: r.render(v[0], v[2], v[1]), TypeError),
    bad("settings as a dict", "settings|csm.ShadowSettings|dict",
        lambda r, v: r.render(*v, {"map_size": 64}), TypeError),
    bad("unknown output", "outputs|mask, |valid, |'colour'",
        lambda r, v: r.render(*v, outputs=("mask", "colour"))),
    bad("no output", "outputs|at least one|none", lambda r, v: r.render(*v, outputs=())),
    bad("outputs as text", "outputs|sequence|'mask'",
        lambda r, v: r.render(*v, outputs="mask"), TypeError),
    bad("outputs as number", "outputs|sequence|31",
        lambda r, v: r.render(*v, outputs=31), TypeError),
    bad("out as array", "out|Frame|ndarray",
        lambda r, v: r.render(*v, out=np.zeros((18, 32))), TypeError),
    bad("out of another size", "out|mask|(18, 32)|(9, 16)",
        lambda r, v: r.render(*v, SETTINGS, out=other_out(r, v, size=(16, 9)))),
    bad("out with other maps", "out|shadow_maps|(4, 32, 32)|(4, 64, 64)",
        lambda r, v: r.render(*v, settings(map_size=32), out=other_out(r, v))),
    bad("out that is read-only", "out|mask|writable",
        lambda r, v: r.render(*v, SETTINGS, out=frozen_out(r, v))),
    bad("points at NaN", "points|finite|number 1|nan",
        lambda r, v: r.render(*v, points=[(0, 0, 0), (0, NAN, 0)])),
    bad("points in the plane", "points|(m, 3)|(4, 2)",
        lambda r, v: r.render(*v, points=np.zeros((4, 2)))),
    bad("points as text", "points|real numbers|<U4",
        lambda r, v: r.render(*v, points="here"), TypeError),
    bad("a normal too few", "point_normals|as many as points, 4|got 3",
        lambda r, v: r.render(*v, points=np.ones((4, 3)), point_normals=np.ones((3, 3)))),
    bad("a normal of no length", "point_normals|zero|number 1",
        lambda r, v: r.render(*v, points=np.ones((2, 3)),
                              point_normals=[(0, 1e-300, 0), (0, 0, 0)])),
    bad("normals of nothing", "point_normals|points",
        lambda r, v: r.render(*v, point_normals=np.ones((3, 3)))),
    bad("points of two lengths", "points|real numbers",
        lambda r, v: r.render(*v, points=[(0, 0, 0), (1, 2)]), TypeError),
    bad("map of 40,000", "shadow_maps|40000 x 40000|GL_MAX_TEXTURE_SIZE",
        lambda r, v: r.render(*v, settings(map_size=40_000)), csm.LimitError),
    bad("one of the maps below its kernel", "map_size|16",
        lambda r, v: r.render(
            *v, settings(cascade_count=2, map_size=(64, 16), filter="pcf", filter_size=33))),
    bad("manual splits beyond far", "manual_splits|far 100|300",
        lambda r, v: r.render(
            *v, settings(cascade_count=2, split="manual", manual_splits=(300.0,)))),
    bad("map below its kernel", "map_size|16",
        lambda r, v: r.render(*v, settings(map_size=16, filter="pcf", filter_size=33))),
]  # fmt: skip


@pytest.mark.parametrize(("call", "error", "words"), RENDERS)
def test_bad_render_leaves_a_renderer_that_renders(renderer, view, call, error, words):
    outputs = ("mask", "valid", "shadow_maps")
    expected = renderer.render(*view, SETTINGS, outputs=outputs)
    with pytest.raises(error) as caught:
        call(renderer, view)
    check(caught, words)
    again = renderer.render(*view, SETTINGS, outputs=outputs)
    for name in outputs:
        assert np.array_equal(getattr(again, name), getattr(expected, name))


def test_a_frame_says_why_it_lacks_an_output(renderer, view):
    frame = renderer.render(*view, SETTINGS, outputs=("mask",))
    for name, reason in (
        ("view_depth", "view_depth was not asked for: render with outputs=('view_depth', ...)"),
        ("point_visibility", "point_visibility was not asked for: render with points=..."),
        ("colour", "a Frame has no colour"),
    ):
        with pytest.raises(AttributeError) as caught:
            getattr(frame, name)
        assert str(caught.value) == reason


# -- opening and closing ---------------------------------------------------------------------------

OPENINGS = [
    bad("unknown back end", "backend|auto, egl, osmesa, glfw|'vulkan'",
        lambda: csm.Renderer("vulkan")),
    bad("back end as number", "backend|auto, egl, osmesa, glfw|3", lambda: csm.Renderer(3)),
    bad("shaders nowhere", "shader_dir|folder|/nowhere/at/all",
        lambda: csm.Renderer(shader_dir="/nowhere/at/all")),
    bad("shaders in a number", "shader_dir|folder|5", lambda: csm.Renderer(shader_dir=5),
        TypeError),
]  # fmt: skip


@pytest.mark.parametrize(("call", "error", "words"), OPENINGS)
def test_bad_opening(call, error, words):
    with pytest.raises(error) as caught:
        call()
    check(caught, words)


def test_an_unknown_back_end_in_the_environment_counts_for_auto_alone(monkeypatch):
    monkeypatch.setenv("CSM_BACKEND", "direct3d")
    with pytest.raises(ValueError, match=r"CSM_BACKEND must be one of.*egl.*'direct3d'"):
        csm.Renderer()
    with pytest.raises(ValueError, match="'vulkan'"):
        csm.Renderer("vulkan")


def test_a_closed_renderer_says_so(fresh_renderer, view):
    renderer = fresh_renderer()
    renderer.render(*view, SETTINGS)
    renderer.close()
    renderer.close()
    for use in (
        lambda: renderer.render(*view, SETTINGS),
        lambda: renderer.info,
        renderer.reload,
    ):
        with pytest.raises(csm.ContextError, match="renderer is closed"):
            use()
    assert "closed" in repr(renderer)


def run_python(code):
    """stdout of a fresh interpreter; a warning of a resource left open is an error there."""
    done = subprocess.run(
        [sys.executable, "-W", "error::ResourceWarning", "-c", textwrap.dedent(code)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    return done.stdout


def test_a_forked_child_has_no_renderer_and_the_parent_keeps_its_own():
    code = """
        import os, csm
        scene = csm.scenes.plane_and_box()
        view = scene, scene.cameras["corner"].replace(size=(16, 9)), scene.suns["diagonal"]
        settings = csm.ShadowSettings(map_size=64)
        with csm.Renderer(debug=True) as renderer:
            before = renderer.render(*view, settings).mask
            backend = renderer.info["backend"]
            child = os.fork()
            if not child:
                for use in (
                    lambda: renderer.render(*view, settings),
                    lambda: renderer.info,
                    # its driver's threads stayed behind: a new context would wait for ever
                    lambda: csm.Renderer(backend),
                ):
                    try:
                        use()
                    except csm.ContextError as error:
                        assert "fork" in str(error) and "'spawn'" in str(error), error
                    else:
                        os._exit(3)
                renderer.close()
                os._exit(0)
            print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
            print((renderer.render(*view, settings).mask == before).all())
            renderer.reload()
            print((renderer.render(*view, settings).mask == before).all())
    """
    assert run_python(code).split() == ["0", "True", "True"]


def test_glfw_opens_on_the_main_thread_alone():
    code = """
        import threading, csm
        def open_it():
            try:
                csm.Renderer("glfw")
            except csm.ContextError as error:
                print(error)
        thread = threading.Thread(target=open_it)
        thread.start()
        thread.join()
    """
    text = run_python(code)
    assert "glfw" in text
    assert "main thread" in text


def test_every_class_of_ours_is_a_csm_error():
    for error in (csm.ContextError, csm.ShaderError, csm.LimitError, csm.GLError):
        assert issubclass(error, csm.CsmError)
    assert issubclass(csm.CsmError, RuntimeError)
    assert issubclass(csm.GLWarning, Warning)
