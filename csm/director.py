"""Shadows along a path: settings that stay until another choice is better, maps that stay too.

A `Director` renders frame after frame of one scene. Maps that provably did not change are kept on
the GPU, those that moved by whole texels are scrolled (`Renderer.render`, ``reuse=``); under a goal
the recommendation is made again where the view has changed, and followed only for a reason.
"""

import math
import re
import time

import numpy as np

from .budgets import corrected, frame_times
from .cascades import check_kinds
from .director_report import ACTIONS, DirectorReport, Look
from .errors import ContextError
from .plans import DEFAULT_OUTPUTS, map_bytes
from .recommendation import checked_goal, is_exact_goal, recommend_from
from .renderer import Renderer, Walk, check_renderer
from .spaces import as_number, as_whole
from .timing import total_ms

__all__ = ["Director"]

# Signals have moved enough to be measured again: what any of these changes is what they measure.
MOVED_SHARE = 0.05  # of the view range, by the camera
TURNED_DEG = 15.0  # the camera
SUN_TURNED_DEG = 2.0
TIMES = 30  # the latest frames since a look whose times count
SCENE_FRAMES = 30  # an animated scene is another one in every frame
# A choice that is only better must be so by this share, so many looks in a row.
MARGIN, PATIENCE = 0.1, 2
# A choice that misses the goal fewer looks after it was made was made too soon: the next one must
# meet the goal at both places, and to leave that one takes so many times the looks.
SOON, RESTRAINT = 10, 2


class Director:
    """Renders a scene along a path, drawing only what has changed.

    Use it in a ``with`` block, or call `close`. One thread at a time.

    Parameters
    ----------
    scene : Scene
    settings : ShadowSettings, optional
        Fixed ones. Without them `recommend` chooses, for a camera in motion, by the goal.
    max_error, budget_ms : float, optional
    max_bytes : int, optional
        The goal, as `recommend` takes it; none is the knee. Not with `settings`.
    renderer : Renderer, optional
        One of its own by default. What others render with it in between costs the kept maps.
    scroll : bool
        Whether a map that moved by whole texels may be scrolled where that is estimated to cost
        less. Its depths then differ from a map drawn whole by the rasteriser's snapping, 1/256
        texel of slope (docs/numerics.md 33); without it masks are those of `Renderer.render` to the
        bit.
    margin : float
        Share by which another choice must be better to replace one that meets the goal, 0 to 1:
        cheaper, or, with `budget_ms` alone, more exact.
    patience : int
        Looks in a row in which it must be; 0: every recommendation is followed.

    Attributes
    ----------
    scene : Scene
        The last one rendered.
    settings : ShadowSettings or None
        Those held; None before the first frame under a goal.
    recommendation : Recommendation or None
        The last one made.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of range.
    ContextError
        If no context can be made.

    Notes
    -----
    The recommendation is made again before a frame whose camera has moved by 5 % of the view range,
    turned by 15 degrees or changed its lens since the last look, whose sun has turned by 2 degrees,
    or, of another scene, every 30 frames. It replaces the held settings at once if those are
    forecast to miss the goal and it is not, or if the sun has begun to move and asks for other
    axes; otherwise (and where nothing reaches the goal: it is nearer) only if it is better by
    `margin` in `patience` looks in a row. What meets the goal gives way to nothing that does not;
    of settings that exceed `max_bytes` those of fewer bytes replace others at once, and never the
    other way round. Settings that miss the goal within 10 looks of their choice give way to the
    best that are forecast to meet it at both places, and `patience` counts twofold from then on: a
    path that goes to and fro across the boundary of two choices does not change them to and fro.

    Under `budget_ms` only the first look times frames of its own, up to 24 of them. Every
    later one forecasts by what the frames since the last one took, of maps those that were drawn
    whole, and costs what a look without a budget costs.

    Examples
    --------
    >>> import csm
    >>> scene = csm.scenes.plane_and_box()
    >>> camera, sun = scene.cameras["corner"].replace(size=(64, 36)), scene.suns["diagonal"]
    >>> with csm.Director(scene, csm.ShadowSettings(map_size=128)) as director:
    ...     for step in range(3):
    ...         frame = director.render(camera, sun, outputs=("mask",))
    >>> frame.info["director"]["actions"]
    ('keep', 'keep', 'keep', 'keep')
    """

    def __init__(
        self,
        scene,
        settings=None,
        *,
        max_error=None,
        budget_ms=None,
        max_bytes=None,
        renderer=None,
        scroll=True,
        margin=MARGIN,
        patience=PATIENCE,
    ):
        check_kinds(scene=scene)
        self._goal = checked_goal(max_error, budget_ms, max_bytes)
        if settings is not None:
            check_kinds(settings=settings)
            given = [name for name, value in self._goal.items() if value is not None]
            if given:
                raise ValueError(f"settings are fixed: they take no goal (got {given[0]} too)")
        check_renderer(renderer)
        if not isinstance(scroll, bool | np.bool_):
            raise TypeError(f"scroll must be True or False (got {scroll!r})")
        self._margin = as_number("margin", margin, 0.0, 1.0)
        self._patience = as_whole("patience", patience, 0, 1000)
        self._reuse = "scrolled" if scroll else "same"
        self._fixed = settings is not None
        self.scene, self.settings, self.recommendation = scene, settings, None
        self._looked = None  # frame, scene, camera, sun of the last look
        self._sun = None
        self._streak, self._wait, self._chosen = 0, self._patience, 0
        self._times, self._new = [], False  # of frames since the last look; settings just changed
        self._whole_ms = {}  # (settings, map) -> when it was last drawn whole
        self._decisions = []
        self._maps = dict.fromkeys(ACTIONS, 0)
        self._saved = [0, 0, 0.0]
        self._frames, self._ms, self._closed = 0, 0.0, False
        self._own, self._walk = renderer is None, Walk()
        self._renderer = Renderer() if renderer is None else renderer

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    def __repr__(self):
        state = "closed" if self._closed else f"{self._frames} frames"
        return f"<csm.Director {state}>"

    def close(self):
        """Close the renderer if it is the director's own; a second call does nothing."""
        if not self._closed and self._own:
            self._renderer.close()
        self._closed = True

    # -- frames ------------------------------------------------------------------------------------

    def render(
        self, camera, sun, *, scene=None, outputs=DEFAULT_OUTPUTS, out=None, points=None,
        point_normals=None,
    ):  # fmt: skip
        """Render the next frame of the path.

        Parameters
        ----------
        camera : Camera
        sun : Sun
        scene : Scene, optional
            Another one from this frame on, such as the next of an animation; its maps are drawn
            anew.
        outputs, out, points, point_normals
            As for `Renderer.render`.

        Returns
        -------
        frame : Frame
            ``info["director"]`` tells what was done: ``actions``, one a map (``draw``, ``keep``,
            ``add``: casters drawn into what was there, ``scroll``), and ``drawn``, ``kept``,
            ``added``, ``scrolled`` with the numbers of those maps; ``texels_saved``,
            ``triangles_saved``, ``ms_saved``; ``decision``, a `Look` or None.

        Raises
        ------
        TypeError, ValueError
            If an argument breaks its rule.
        ContextError
            If the director or its renderer is closed.
        LimitError, ShaderError, GLError, KeyboardInterrupt
            As `Renderer.render`.
        """
        if self._closed:
            raise ContextError("director is closed")
        check_kinds(camera=camera, sun=sun, scene=self.scene if scene is None else scene)
        self.scene = self.scene if scene is None else scene
        decision = None if self._fixed else self._decide(camera, sun)
        with self._renderer.on_walk(self._walk):
            frame = self._renderer.render(
                self.scene, camera, sun, self.settings, outputs=outputs, out=out, points=points,
                point_normals=point_normals, reuse=self._reuse,
            )  # fmt: skip
        self._record(frame, decision)
        self._sun = sun
        return frame

    def report(self):
        """Sum up the frames so far.

        Returns
        -------
        report : DirectorReport
        """
        return DirectorReport(
            self._frames, dict(self._maps), tuple(self._saved), self._ms, tuple(self._decisions)
        )

    def _record(self, frame, decision):
        """Write what the frame spared into its info and the sums."""
        maps = frame.info.get("reuse", [])
        saved = [0, 0, 0.0]
        for i, done in enumerate(maps):
            ms = math.fsum(
                value
                for name, value in frame.timings_ms.items()
                if re.fullmatch(rf"shadow_\w+_{i}", name)
            )
            key = self.settings, i
            if done["action"] == "draw":
                self._whole_ms[key] = ms
            saved[0] += done["texels_saved"]
            saved[1] += done["triangles_saved"]
            saved[2] += self._whole_ms.get(key, ms) - ms
            self._maps[done["action"]] += 1
        self._saved = [a + b for a, b in zip(self._saved, saved, strict=True)]
        self._frames += 1
        self._ms += total_ms(frame.timings_ms)
        actions = tuple(done["action"] for done in maps)
        self._time(frame, actions)
        frame.info["director"] = {
            "actions": actions,
            **{
                word: [i for i, action in enumerate(actions) if action == name]
                for name, word in ACTIONS.items()
            },
            "texels_saved": saved[0],
            "triangles_saved": saved[1],
            "ms_saved": saved[2],
            "decision": decision,
        }

    def _time(self, frame, actions):
        """Keep what the frame took, which corrects the cost model at the next look."""
        if self._goal["budget_ms"] is None:
            return
        if self._new:  # a driver makes its code at a program's first use, and counts that
            self._new = False
            return
        ms, others = frame_times(frame)
        whole = all(action == "draw" for action in actions)
        self._times = [*self._times[1 - TIMES :], (ms if whole else None, others)]

    def _costs(self):
        """Cost model of the last look, corrected by the frames since; None before the first."""
        last = self.recommendation
        if last is None:
            return None
        return corrected(last.cost_model, self.settings, last.forecaster, self._times)

    # -- decisions ---------------------------------------------------------------------------------

    def _trigger(self, camera, sun):
        """What has changed enough since the last look, or None."""
        if self._looked is None:
            return "first frame"
        frame, scene, last, last_sun, distance = self._looked
        lens = ("size", "half_width", "half_height", "near", "far", "orthographic")
        if any(getattr(camera, name) != getattr(last, name) for name in lens):
            return "another lens"
        moved = float(np.linalg.norm(camera.eye - last.eye))
        if moved > MOVED_SHARE * distance:
            return f"camera moved by {moved:.3g} m"
        turned = _angle_deg(camera.backward, last.backward)
        if turned > TURNED_DEG:
            return f"camera turned by {turned:.0f} degrees"
        turned = _angle_deg(sun.to_light, last_sun.to_light)
        if turned > SUN_TURNED_DEG or sun.angular_diameter_deg != last_sun.angular_diameter_deg:
            return f"sun turned by {turned:.1f} degrees" if turned > SUN_TURNED_DEG else "other sun"
        if scene is not self.scene and self._frames - frame >= SCENE_FRAMES:
            return "another scene"
        return None

    def _decide(self, camera, sun):
        """Look at the scene if that is due, and follow what is found if there is a reason."""
        trigger = self._trigger(camera, sun)
        if trigger is None:
            return None
        sun_moves = (
            self._looked is not None and _angle_deg(sun.to_light, self._looked[3].to_light) > 0.0
        )
        start = time.perf_counter()
        with self._renderer.aside():
            found = recommend_from(
                self._renderer, self.scene, (camera,), (sun,), self._goal, model=self._costs(),
                camera_moves=True, sun_moves=sun_moves,
            )  # fmt: skip
        chosen, reason = self._weigh(found)
        ms = 1e3 * (time.perf_counter() - start)
        changed, self._times = chosen is not None, []
        self._new = changed
        if changed:
            self.settings, self._streak, self._chosen = chosen, 0, len(self._decisions)
        self.recommendation = found
        self._looked = self._frames, self.scene, camera, sun, _view_range(self.scene, camera)
        decision = Look(self._frames, trigger, changed, reason, ms)
        self._decisions.append(decision)
        return decision

    def _weigh(self, found):
        """Settings that replace the held ones, or None, and why."""
        if self.settings is None:
            return found.settings, "nothing was held"
        if found.settings == self.settings:
            self._streak = 0
            return None, "the same is recommended"
        if not self._patience:
            return found.settings, "every recommendation is followed"
        held = found.forecast(self.settings)
        if not held.met:
            return self._after_miss(found, held)
        if not found.met:
            self._streak = 0
            return None, "those held meet the goal, the new ones do not"
        axes = found.signals.sun_moves and found.settings.light_basis != self.settings.light_basis
        if axes:
            return found.settings, "the sun has begun to move"
        gain = _gain(self._goal, held, found)
        self._streak = self._streak + 1 if gain > self._margin else 0
        better = f"better by {100 * gain:.0f} %"
        if self._streak >= self._wait:
            return found.settings, better
        if self._streak:
            return None, f"the new ones are {better}, for {self._streak} of {self._wait} looks"
        return None, f"those held meet the goal, the new ones are {better}"

    def _after_miss(self, found, held):
        """What takes the place of settings that miss the goal."""
        told = f"{100 * held.error:.2g} %, {held.ms:.3g} ms"
        if self._goal["max_bytes"] is not None:
            told += f", {map_bytes(self.settings)} bytes"
        reason = f"those held miss the goal ({told})"
        if not found.met:
            return self._nearer(found, held, reason)
        soon = len(self._decisions) - self._chosen < SOON
        self._wait = min(RESTRAINT * self._wait, 10**6) if soon else self._patience
        both = found.meeting(self.recommendation) if soon else None
        return (found.settings if both is None else both), reason

    def _nearer(self, found, held, reason):
        """What takes the place of settings that miss the goal where every other does, too."""
        reason = f"{reason}, as does every other"
        budget, most = self._goal["budget_ms"], self._goal["max_bytes"]
        # error and time are approached; bytes are there or not, and nothing is worth more of them
        if most is not None:
            was, now = map_bytes(self.settings), found.map_bytes
            if was > max(most, now):
                return found.settings, f"{reason}: the new ones take fewer bytes"
            if now > max(most, was):
                self._streak = 0
                return None, f"{reason}; the new ones take more bytes"
        late = budget is not None and held.ms > budget
        was, now = (held.ms, found.expected_ms) if late else (held.error, found.expected_error)
        self._streak = self._streak + 1 if now < (1.0 - self._margin) * was else 0
        if self._streak >= self._wait:
            return found.settings, f"{reason}: the new ones are nearer"
        if self._streak:
            reason += f"; the new ones are nearer, for {self._streak} of {self._wait} looks"
        return None, reason


def _gain(goal, held, found):
    """Share by which what was found is better than what is held, by what the goal minimises."""
    exact = is_exact_goal(goal)
    was, now = (held.error, found.expected_error) if exact else (held.ms, found.expected_ms)
    return 1.0 - now / was if was > 0.0 else 0.0


def _angle_deg(one, other):
    across = float(np.linalg.norm(np.cross(one, other)))
    return math.degrees(math.atan2(across, float(one @ other)))


def _view_range(scene, camera):
    """Depth [m] of the farthest corner of the scene, or the camera's far where that is nearer."""
    low, high = scene.bounds.reshape(2, 3)
    reach = float(np.linalg.norm(np.maximum(np.abs(low - camera.eye), np.abs(high - camera.eye))))
    return min(reach, camera.far)
