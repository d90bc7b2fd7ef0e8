"""The renderer: an OpenGL context, and frames out of it."""

import atexit
import logging
import math
import os
import threading
import warnings
import weakref
from contextlib import contextmanager
from functools import partial
from importlib import resources

import numpy as np

from . import _core
from .cascades import Cascades, bias_metres, check_kinds
from .cutouts import core_meshes, has_cutout
from .errors import ContextError, GLWarning, LimitError, ShaderError
from .frame import Frame, Visibility, array_shapes, prepare_arrays
from .plans import DEFAULT_OUTPUTS, MAP_OUTPUTS, output_bits
from .settings import ShadowSettings
from .spaces import real_array
from .stages import STAGES, check_stage, faster_stage

__all__ = ["Renderer", "backends"]

log = logging.getLogger("csm.gl")

# NVIDIA's message at a first draw, that it fits the shader to the state it finds: always so.
NVIDIA_RECOMPILED = 131218

INSTALL_HINT = "install libegl1 and libgl1-mesa-dri, or libosmesa6"

DRIVER_FACTS = ("backend", "platform", "vendor", "renderer", "version", "software", "stage")

REUSE = ("never", "same", "scrolled")  # as CSM_REUSE_MAPS_* in csm.h

# A view range is held only from one frame of a walk to the next: between cameras further apart than
# this a frame must not depend on what was rendered before it.
HELD_STEP_SHARE = 0.05  # of the view range
HELD_TURN_COSINE = math.cos(math.radians(10.0))

_alive = weakref.WeakSet()
_orphans = []  # GLFW renderers that died off the main thread, which alone may close them
_opened = set()  # back ends this process has opened, and those of the process it was forked from
_lost = set()

SPAWN_HINT = "start processes with multiprocessing's 'spawn' and make a Renderer there"


def _forget_after_fork():
    """In a forked child: contexts are the parent's; locks may be held by threads that are gone.

    So may be a driver's: Mesa keeps one set of worker threads for all contexts, and a context
    made after the fork would wait for them for ever.
    """
    _lost.update(_opened)
    _orphans.clear()
    for renderer in list(_alive):
        renderer._lock = threading.RLock()
        renderer._forked = True


os.register_at_fork(after_in_child=_forget_after_fork)


class Walk:
    """What the last frame of a walk hands on to the next: see `Renderer.on_walk`."""

    __slots__ = ("held",)

    def __init__(self):
        self.held = None


class Renderer:
    """Renders scenes through OpenGL 4.5, without a window.

    Use it in a ``with`` block, or call `close`. Any thread may use it; calls are serialised.

    Parameters
    ----------
    backend : {"auto", "egl", "osmesa", "glfw"}
        ``"auto"`` takes the first that works, in that order, unless the environment variable
        ``CSM_BACKEND`` names one. GLFW opens and closes on the main thread alone.
    debug : bool
        A debug context: driver messages of severity error raise `GLError`, those of medium
        severity warn `GLWarning`. Slower.
    shader_dir : path, optional
        Folder of shaders to use instead of the package's own; see `reload`.
    stage : {"auto", "compute", "fragment"}
        Where passes over pixels and texels run: as compute shaders, or as fragments of a triangle
        that covers them; both give the same. ``"auto"`` is the one that this driver is faster at,
        found by drawing small frames in a context of their own when a process first opens a
        renderer on it (a fifth of a second on software GL); ``info["stage"]`` tells.

    Raises
    ------
    TypeError, ValueError
        If the back end is unknown or `shader_dir` is no folder.
    ContextError
        If no context can be made; the text says why for each back end.
    """

    def __init__(self, backend="auto", *, debug=False, shader_dir=None, stage="auto"):
        self._core = None
        self._lock = threading.RLock()
        self._forked = False
        self._scenes = {}  # id -> (weak reference, handle)
        self._dropped = []  # handles of scenes that are gone, freed at the next call
        self._warned = set()
        self._walk = threading.local()  # .held: what the thread's last frame hands on
        check_stage(stage)
        self._core = _open(backend, bool(debug), _shader_folder(shader_dir), stage)
        self._info = self._core.describe()
        self._driver = {name: self._info[name] for name in DRIVER_FACTS}  # for infos of frames
        _alive.add(self)

    # -- life --------------------------------------------------------------------------------------

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    def close(self):
        """Destroy the context; a second call does nothing.

        Raises
        ------
        ContextError
            If a GLFW renderer is closed off the main thread.
        """
        with self._lock:
            if self._core is None:
                return
            if self._info["backend"] == "glfw" and not _on_main_thread():
                raise ContextError("a GLFW renderer must be closed on the main thread")
            self._core.close()
            self._core = None
            self._scenes.clear()
            self._dropped.clear()

    def __del__(self):
        if getattr(self, "_core", None) is None or self._forked:
            return
        try:
            warnings.warn(f"unclosed {self!r}", ResourceWarning, source=self, stacklevel=2)
        finally:  # also where warnings are errors
            if self._info["backend"] != "glfw" or _on_main_thread():
                self.close()
            else:
                _orphans.append(self._core)

    def __repr__(self):
        state = "closed" if self._core is None else self._info["renderer"]
        return f"<csm.Renderer {self._info['backend'] if hasattr(self, '_info') else ''} {state}>"

    def _open_core(self):
        if self._forked:
            raise ContextError(
                f"renderer was made before a fork: a context does not survive it, {SPAWN_HINT}"
            )
        if self._core is None:
            raise ContextError("renderer is closed")
        return self._core

    @property
    def info(self):
        """Back end, driver, stage, limits, and counts of compiled programs and living objects."""
        with self._lock:
            core = self._open_core()
            self._free_dropped(core)
            return core.describe()

    def reload(self):
        """Read and compile every shader again at its next use, for people who edit `shader_dir`.

        Raises
        ------
        ContextError
            If the renderer is closed.
        """
        with self._lock:
            self._open_core().reload()

    def forget(self):
        """Begin a new walk: the calling thread's next frame holds nothing of its last one.

        What a frame holds makes it depend on those before it (see the notes of `render`, and
        `ShadowSettings` on splits and sizes that are held); after this it depends on its arguments
        alone.
        """
        self._walk.held = None

    @contextmanager
    def aside(self):
        """Context in which the calling thread's frames are no steps of its walk.

        What its last frame before holds, its first frame after gets (see `forget`).
        """
        with self.on_walk(Walk()):
            yield self

    @contextmanager
    def on_walk(self, walk):
        """Context in which the calling thread's frames are steps of another walk than its own.

        Parameters
        ----------
        walk : Walk
            What its last frame holds; whatever is rendered outside of the context leaves it alone,
            and the other way round.
        """
        own = getattr(self._walk, "held", None)
        self._walk.held = walk.held
        try:
            yield self
        finally:
            walk.held, self._walk.held = self._walk.held, own

    # -- work --------------------------------------------------------------------------------------

    def render(
        self,
        scene,
        camera,
        sun,
        settings=None,
        *,
        outputs=DEFAULT_OUTPUTS,
        out=None,
        points=None,
        point_normals=None,
        reuse="never",
        timed=True,
    ):
        """Shadow maps and the camera's shadow mask.

        Parameters
        ----------
        scene : Scene
            Uploaded at its first render, freed when it is garbage or the renderer closes.
        camera : Camera
        sun : Sun
        settings : ShadowSettings, optional
            The defaults if not given.
        outputs : sequence of str
            What to bring back; see `Frame`. What is not named is not computed.
        out : Frame, optional
            An earlier frame of the same shapes; its arrays are written again and shared with the
            new frame. Saves the page faults of fresh memory.
        points : (m, 3) array_like, optional
            World points [m] whose visibility is wanted too.
        point_normals : (m, 3) array_like, optional
            Normals of the surfaces at `points`, on the side that is seen, of any length but 0. With
            them a point is biased, and dark when it does not face the sun, as a pixel is. Without
            them every point is biased as if tilted 45 degrees to the light: steeper surfaces then
            shadow themselves (29 % of the points under a sun at 3 degrees, 0.2 % with normals).
        reuse : {"never", "same", "scrolled"}
            What of the renderer's last render may serve again (docs/numerics.md 33): what the
            camera sees, if scene and camera are the same; maps, if the render allowed it, too, and
            was of the same scene with the same settings. ``"same"``: maps whose matrices did not
            change are kept, and casters that they lack are drawn into them; the mask is the same to
            the bit. ``"scrolled"``: where a map moved by whole texels, also the part that was drawn
            before, if that costs less; depths then differ by the rasteriser's snapping.
            ``info["reuse"]`` says for every map what was done. `Director` does this along a path.
        timed : bool
            Whether passes are timed. Each is waited for then, which frames of a few milliseconds
            on a GPU are longer by. If not, the host waits where it reads what the GPU wrote, and
            ``timings_ms`` has ``readback`` alone, which is no measure of the frame.

        Returns
        -------
        frame : Frame

        Raises
        ------
        TypeError, ValueError
            If an argument breaks its rule.
        ContextError
            If the renderer is closed or belongs to a parent process.
        LimitError, ShaderError, GLError
            If the driver cannot do it.
        KeyboardInterrupt
            On Ctrl-C; the renderer stays usable.

        Notes
        -----
        Under ``view_range="scene"`` the rounded range has a memory: on a walk (camera steps below
        5 % of the range and 10 degrees) it shrinks only after two steps, so that a camera at
        the edge of a step does not flip. Cameras further apart share nothing.
        """
        settings = ShadowSettings() if settings is None else settings
        check_kinds(scene=scene, camera=camera, sun=sun, settings=settings)
        if points is not None:
            points, point_normals = _checked_points(points, point_normals)
        elif point_normals is not None:
            raise ValueError("point_normals must come with points (got no points)")
        if not isinstance(reuse, str) or reuse not in REUSE:
            raise ValueError(f"reuse must be one of {', '.join(REUSE)} (got {reuse!r})")
        if not isinstance(timed, (bool, np.bool_)):
            raise TypeError(f"timed must be True or False (got {timed!r})")
        bits, outputs = output_bits(outputs, points is not None)
        point_count = None if points is None else len(points)
        textures = _core.plan(settings, *camera.size, bits)[1]
        self._check_limits(textures, settings.storage, camera, outputs)
        arrays = prepare_arrays(array_shapes(camera, settings, outputs, point_count), out)
        with self._lock:
            core = self._open_core()
            self._free_dropped(core)
            try:
                result = core.render(
                    self._uploaded(core, scene),
                    camera,
                    sun.to_light,
                    settings,
                    scene.bounds.ravel(),
                    self._held(scene, camera, settings),
                    bits,
                    arrays,
                    points,
                    point_normals,
                    math.radians(sun.angular_diameter_deg),
                    REUSE.index(reuse),
                    timed,
                )
            except ShaderError as error:
                # every mesh of a scene has an instance: more of them, and one is drawn again
                instanced = len(scene.instance_mesh) > len(scene.meshes)
                error.defines = _core.program_defines(
                    error.pass_name, settings, bits, instanced, has_cutout(scene)
                )
                raise
            finally:
                self._tell_messages(core)
            cascades = Cascades(**result["cascades"])
            self._walk.held = (weakref.ref(scene), camera, settings, cascades)
        return Frame(
            arrays,
            cascades=cascades,
            camera=camera,
            sun=sun,
            settings=settings,
            timings_ms=result["lists"]["timings_ms"],
            info=partial(_frame_info, self._driver, result, settings, camera, cascades),
            points=points,
            point_normals=point_normals,
        )

    def visibility(self, points, normals=None):
        """What the maps of the last render say of any points.

        Parameters
        ----------
        points : (m, 3) array_like
            World points [m], in or out of the picture.
        normals : (m, 3) array_like, optional
            Normals of the surfaces there, as `render` takes `point_normals`.

        Returns
        -------
        visibility : Visibility
            By the same shader functions as the mask: points and normals of a pixel get the mask's
            value there, but where float32 decides a compare or a texel. A point has no pixel and
            no neighbours: whatever `lookup` is, filtered maps are looked up at their full size; the
            plane is that of the normal, as under ``plane="normal"``; `rotated` and
            ``blend="dither"`` draw by place, not by pixel.

        Raises
        ------
        TypeError, ValueError
            If an argument breaks its rule; if nothing was rendered yet, or the last render failed;
            if its maps held only what shadows the picture and its scene is gone.
        ContextError
            If the renderer is closed or belongs to a parent process.
        LimitError, ShaderError, GLError
            If the driver cannot do it.
        KeyboardInterrupt
            On Ctrl-C; where maps were being drawn, render again before the next call.

        Notes
        -----
        The last render is that of this renderer, whichever thread made it. Maps that were culled
        to the picture are drawn whole at the first call, from its scene. A render with points, were
        it none (``points=np.empty((0, 3))``), or with ``cull="none"`` has them so from the start.
        """
        points, normals = _checked_points(points, normals, "normals")
        found = Visibility(
            np.empty(len(points), np.float32),
            np.empty(len(points), np.uint8),
            np.empty(len(points), np.float32),
        )
        with self._lock:
            core = self._open_core()
            self._free_dropped(core)
            try:
                core.visibility(points, normals, *vars(found).values())
            finally:
                self._tell_messages(core)
        return found

    def _check_limits(self, textures, storage, camera, outputs):
        # before arrays are made: what the driver cannot hold, the host's memory may not hold either
        for name, _, width, height, layers, samples, *_ in textures:
            what = f"{name} {width} x {height} x {layers}"
            for size, limit, of in (
                (max(width, height), "max_texture_size", "GL_MAX_TEXTURE_SIZE"),
                (layers, "max_layers", "GL_MAX_ARRAY_TEXTURE_LAYERS"),
                (samples, "max_samples", "GL_MAX_DEPTH_TEXTURE_SAMPLES"),
            ):
                if size > self._info[limit]:
                    what += f" of {samples} samples" if limit == "max_samples" else ""
                    raise LimitError(f"{what} exceeds {of} {self._info[limit]}")
            cube = name == "shadow_maps" and storage == "cube"
            if cube and width > self._info["max_cube_size"]:
                limit = self._info["max_cube_size"]
                raise LimitError(f"{what} exceeds GL_MAX_CUBE_MAP_TEXTURE_SIZE {limit}")
        limit, (width, height) = self._info["max_buffer_bytes"], camera.size
        for name in outputs:
            if name not in MAP_OUTPUTS and width * height * (12 if name == "normal" else 4) > limit:
                raise LimitError(
                    f"{name} of {width} x {height} pixels exceeds "
                    f"GL_MAX_SHADER_STORAGE_BLOCK_SIZE {limit}"
                )

    def _uploaded(self, core, scene):
        known = self._scenes.get(id(scene))
        if known is not None:
            return known[1]
        handle = core.upload(
            core_meshes(scene), scene.instance_mesh, scene.world_from_instance, scene.origin
        )
        key, scenes, dropped = id(scene), self._scenes, self._dropped

        def drop(_):
            # runs wherever the scene dies, perhaps inside a render: only note it
            if scenes.pop(key, None) is not None:
                dropped.append(handle)

        self._scenes[key] = (weakref.ref(scene, drop), handle)
        return handle

    def _free_dropped(self, core):
        while self._dropped:
            core.drop(self._dropped[-1])
            self._dropped.pop()

    def _held(self, scene, camera, settings):
        # of this thread: what others render in between must not show in its frames
        held = getattr(self._walk, "held", None)
        if held is None:
            return None
        reference, last, wanted, cascades = held
        same = (
            reference() is scene
            and last.near == camera.near
            and last.size == camera.size
            and (wanted is settings or wanted == settings)
        )
        if not same:
            return None
        step = camera.eye - last.eye
        moved = math.sqrt(step @ step)
        turned = float(camera.backward @ last.backward)
        near_enough = moved <= HELD_STEP_SHARE * cascades.splits[-1] and turned >= HELD_TURN_COSINE
        return cascades.hold if near_enough else None

    def _tell_messages(self, core):
        for number, severity, text in core.messages():
            if severity != "medium" or number == NVIDIA_RECOMPILED:
                log.debug("%s: %s", severity, text)
            elif number not in self._warned:
                self._warned.add(number)
                warnings.warn(text, GLWarning, stacklevel=3)


def check_renderer(renderer):
    """Raise TypeError unless it is a Renderer, or None where one is made."""
    if renderer is not None and not isinstance(renderer, Renderer):
        raise TypeError(f"renderer must be a csm.Renderer (got {type(renderer).__name__})")


def _frame_info(driver, result, settings, camera, cascades):
    lists = result["lists"]
    return {
        **driver,
        "clock": result["clock"],
        "size": list(camera.size),
        "map_size": [int(size) for size in cascades.map_size],
        "settings": settings.canonical().to_dict(),
        "bias": bias_metres(cascades, settings),
        "bytes": result["bytes"],
        "scene_bytes": result["scene_bytes"],
        "programs_compiled": result["programs_compiled"],
        "chunks": result["chunks"],
        "chunks_viewed": result["chunks_viewed"],
        "chunks_drawn": lists["chunks_drawn"],
        "chunks_culled": [result["chunks"] - drawn for drawn in lists["chunks_drawn"]],
        "chunks_culled_exclusive": lists["chunks_in_finer"],
        "triangles_drawn": lists["triangles_drawn"],
        **{name: _map_reuse(lists[name]) for name in ("reuse",) if name in lists},
    }


def _map_reuse(rows):
    names = ("action", "shift", "texels_saved", "triangles_saved")
    return [dict(zip(names, (row[0], row[1:3], *row[3:]), strict=True)) for row in rows]


def _checked_points(points, normals, name="point_normals"):
    points = _finite_rows("points", points)
    if normals is None:
        return points, None
    normals = _finite_rows(name, normals)
    if len(normals) != len(points):
        raise ValueError(f"{name} must be as many as points, {len(points)} (got {len(normals)})")
    largest = np.abs(normals).max(axis=1, keepdims=True, initial=0.0)
    if not largest.all():
        raise ValueError(f"{name} must not be zero (number {int(np.argmin(largest))} is)")
    normals = normals / largest  # else tiny and huge ones have no length in doubles
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _finite_rows(name, rows):
    rows = np.ascontiguousarray(real_array(name, rows), dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"{name} must be (m, 3) (got shape {rows.shape})")
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        wrong = int(np.argmin(finite))
        raise ValueError(f"{name} must be finite (number {wrong} is {rows[wrong].tolist()})")
    return rows


def _shader_folder(shader_dir):
    if shader_dir is None:
        return os.fspath(resources.files("csm.shaders"))
    try:
        folder = os.fsdecode(shader_dir)
    except TypeError:
        raise TypeError(f"shader_dir must be the path of a folder (got {shader_dir!r})") from None
    if not os.path.isdir(folder):
        raise ValueError(f"shader_dir must be a folder (got {folder!r}, which is none)")
    return folder


def _on_main_thread():
    return threading.current_thread() is threading.main_thread()


def _close_orphans():
    while _orphans:
        _orphans.pop().close()


atexit.register(_close_orphans)


def _open_one(name, debug, folder, stage):
    if name == "glfw" and not _on_main_thread():
        raise ContextError("glfw: a GLFW renderer must be opened on the main thread")
    if _on_main_thread():
        _close_orphans()
    if name in _lost:
        raise ContextError(
            f"{name}: this process was forked from one that had opened {name}, whose driver does "
            f"not survive it: {SPAWN_HINT}"
        )
    _opened.add(name)
    number = _core.BACKENDS.index(name)
    try:
        core = _core.Renderer(number, debug, folder)
        if stage == "auto":
            own = _shader_folder(None)
            stage = faster_stage(core.describe(), lambda: _core.Renderer(number, False, own))
    except ContextError as error:
        raise ContextError(f"{name}: {error}") from None
    core.set_stage(STAGES.index(stage))
    return core


def _open(backend, debug, folder, stage):
    source = "backend"
    if backend == "auto" and os.environ.get("CSM_BACKEND"):
        backend, source = os.environ["CSM_BACKEND"], "CSM_BACKEND"
    if backend != "auto":
        if backend not in _core.BACKENDS:
            raise ValueError(
                f"{source} must be one of auto, {', '.join(_core.BACKENDS)} (got {backend!r})"
            )
        return _open_one(backend, debug, folder, stage)
    reasons = []
    for name in _core.BACKENDS:
        try:
            return _open_one(name, debug, folder, stage)
        except ContextError as error:
            reasons.append(str(error))
    raise ContextError(f"no OpenGL context: {'; '.join(reasons)}; {INSTALL_HINT}")


def backends():
    """Try every back end.

    Returns
    -------
    backends : list of dict
        ``name``, ``available``, ``reason`` (why not, else ""), ``info`` (as `Renderer.info`, else
        empty).
    """
    found = []
    for name in _core.BACKENDS:
        try:
            with Renderer(name) as renderer:
                found.append({"name": name, "available": True, "reason": "", "info": renderer.info})
        except ContextError as error:
            found.append({"name": name, "available": False, "reason": str(error), "info": {}})
    return found
