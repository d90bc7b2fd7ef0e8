"""Only the effects a scene calls for, each with the measurement that called for it."""

from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from html import escape
from types import SimpleNamespace

import numpy as np

from .budgets import within_budget
from .camera import Camera
from .candidates import cheapest, finest
from .cascades import check_kinds, fit_cascades
from .costs import CostModel, cost_model_of
from .decisions import TABLE
from .digests import scene_digest
from .export import export_settings
from .forecasts import check_known
from .formats import Recorded
from .plans import map_bytes
from .record_rules import GOAL_RANGES
from .records import known_scene, plain_values, read_values
from .renderer import Renderer, check_renderer
from .scene import Scene
from .search import Forecast, Search
from .settings import ShadowSettings, maps_text
from .signals import Signals, measure_signals
from .spaces import as_number, as_whole
from .sun import Sun
from .tables import table_html, table_text
from .timing import MOST_REPEATS
from .verification import verify

__all__ = ["Forecast", "Reasons", "Recommendation", "recommend"]


class Reasons(tuple):
    """A tuple of `csm.decisions.Reason` that prints as a short table."""

    __slots__ = ()
    _HEADS = ("effect", "", "measured", "threshold", "cost")
    _MOST = (None, 14, 50, 36)  # within 120 columns; what effects cost stands in HTML and files

    def _rows(self):
        return [(r.effect, _shown(r), r.measured, r.threshold, r.cost) for r in self]

    def __str__(self):
        return table_text(self._HEADS[:4], [row[:4] for row in self._rows()], self._MOST)

    def _repr_html_(self):
        return table_html(self._HEADS, self._rows())


@dataclass(frozen=True, eq=False)
class Recommendation(Recorded):
    """What `recommend` found. Prints as a short table; a table in Jupyter, too.

    `to_json`, `to_toml` and `save` write everything but the scene and the coarse pictures (of the
    scene its digest), `from_json`, `from_toml` and `load` make an equal one of it, bit for bit: two
    are equal if their files are.

    Attributes
    ----------
    settings : ShadowSettings
    reasons : Reasons
        One a row of `csm.decisions.TABLE`: effect, value, taken or not, what was measured, the
        threshold and its source, the cost.
    signals : Signals
        What was measured.
    expected_error : float
        Forecast, not rendered: see `verify`.
    expected_ms : float
        Forecast, as `forecast` makes it; for this machine only under ``budget_ms``, where it is
        corrected by frames of these very settings.
    map_bytes : int
        Of the shadow maps.
    goal : dict
        ``max_error``, ``budget_ms``, ``max_bytes`` as given.
    met : bool
        Whether the forecast meets the goal.
    obstacle : str or None
        Which effect stands in the way if not.
    splits : tuple of float
        View depths [m] between which the first view's cascades lie, fitted to what was seen; empty
        without shadow maps.
    texels : tuple of float
        Longer side of a texel of each of them [m]; empty likewise.
    scene : Scene or None
        None when it was read from a file: `with_scene` gives it back.
    path : (tuple of Camera, tuple of Sun)
    """

    settings: ShadowSettings
    reasons: Reasons
    signals: Signals
    expected_error: float
    expected_ms: float
    map_bytes: int
    goal: dict
    met: bool
    obstacle: str | None
    splits: tuple[float, ...]
    texels: tuple[float, ...]
    scene: Scene | None = field(repr=False)
    path: tuple = field(repr=False)
    scene_mark: dict | None = field(default=None, repr=False)
    _search: object = field(default=None, repr=False)
    _model: CostModel | None = field(default=None, repr=False)

    def forecast(self, settings):
        """What the same signals let expect of other settings; nothing is rendered.

        Parameters
        ----------
        settings : ShadowSettings

        Returns
        -------
        forecast : Forecast
            Error and milliseconds as `expected_error` and `expected_ms`, and whether the goal is
            met: with neither goal that of the knee. What steps of depth leave is not forecast, nor
            what blending changes.

        Raises
        ------
        TypeError
            If `settings` are none.
        ValueError
            If no error is forecast of them: filters other than ``hard`` and ``pcss`` (of depths),
            biases by hand but of back sides without any, planes by derivatives, ranges that end in
            sight or are given, stepped suns. If it was read from a file, which holds no coarse
            pictures.
        """
        check_kinds(settings=settings)
        check_known(settings)
        return self._measured().forecast(settings, self._model)

    @property
    def cost_model(self):
        """`csm.costs.CostModel` of the milliseconds; None when it was read from a file."""
        return self._model

    @property
    def forecaster(self):
        """`csm.forecasts.Forecaster` of what was measured; None when it was read from a file."""
        return None if self._search is None else self._search.forecaster

    def _measured(self):
        """Return the search over what was measured."""
        if self._search is None:
            raise ValueError(
                "a recommendation that was read from a file forecasts no other settings: it holds "
                "no coarse pictures; call csm.recommend again"
            )
        return self._search

    def meeting(self, *others):
        """Find the best settings that are forecast to meet the goal here and elsewhere.

        Parameters
        ----------
        *others : Recommendation
            From other places; each is asked about its own scene and goal.

        Returns
        -------
        settings : ShadowSettings or None
            The cheapest, or, with ``budget_ms`` alone, the most exact; None if none does.

        Raises
        ------
        TypeError
            If another is no recommendation.
        ValueError
            If one was read from a file, which holds no coarse pictures.
        """
        wrong = next((one for one in others if not isinstance(one, Recommendation)), None)
        if wrong is not None:
            raise TypeError(f"others must be csm.Recommendation (got {wrong!r})")
        best = finest if is_exact_goal(self.goal) else cheapest
        for one in others:  # also where nothing here meets the goal, and none is asked
            one._measured()
        for one in sorted(self._measured().candidates(self._model), key=best):
            if all(place.forecast(one.settings).met for place in (self, *others)):
                return one.settings
        return None

    def verify(self, *, renderer=None, rays_per_pixel=None, repeats=3):
        """Render everything on, the recommendation, and it with each decision turned round.

        Parameters
        ----------
        renderer : Renderer, optional
            One of its own by default.
        rays_per_pixel : int, optional
            Of the truth; by default 1 for a point sun, 64 for a disc.
        repeats : int
            Frames timed of each.

        Returns
        -------
        verification : Verification
            A table of error, milliseconds and bytes that proves or refutes every reason.

        Raises
        ------
        ImportError
            If embreex is missing.
        TypeError, ValueError
            If an argument is of the wrong kind or out of range.
        ValueError
            If it was read from a file, which holds no scene: give that back by `with_scene`.
        """
        if self.scene is None:
            raise ValueError(
                "verify needs the scene, of which a file holds only the digest "
                f"{self.scene_mark['digest']}: give it back by with_scene(scene)"
            )
        check_renderer(renderer)
        repeats = as_whole("repeats", repeats, 1, MOST_REPEATS)
        with ExitStack() as stack:
            renderer = renderer or stack.enter_context(Renderer())
            stack.enter_context(renderer.aside())
            judged = self
            if not self.signals.views:  # nor does a file hold the coarse pictures
                measured = measure_signals(renderer, self.scene, *self.path)
                judged = replace(self, signals=measured)
            return verify(renderer, judged, rays_per_pixel=rays_per_pixel, repeats=repeats)

    def with_scene(self, scene):
        """Copy with the scene it is about, which a file does not hold.

        Parameters
        ----------
        scene : Scene

        Returns
        -------
        recommendation : Recommendation

        Raises
        ------
        TypeError
            If `scene` is something else.
        ValueError
            If it is another scene than the recommendation's, by its digest.
        """
        check_kinds(scene=scene)
        digest, known = scene_digest(scene), known_scene(self)["digest"]
        if digest != known:
            raise ValueError(
                "scene must be the one the recommendation is about: its digest is "
                f"{digest}, not {known}"
            )
        return replace(self, scene=scene, scene_mark=None)

    def export(self, engine):
        """Nearest settings of an engine, and what has no counterpart there.

        Parameters
        ----------
        engine : {"threejs", "babylon", "godot", "unity", "unreal", "filament"}

        Returns
        -------
        exported : Exported
            For the first camera and sun of a path; see `csm.export_settings`.

        Raises
        ------
        ValueError
            If there is no such engine.
        """
        (camera, *_), (sun, *_) = self.path
        bounds = np.asarray(known_scene(self)["bounds"])
        return export_settings(
            self.settings,
            engine,
            camera=camera,
            sun=sun,
            scene=SimpleNamespace(bounds=bounds),
            splits=self.splits,
            texels=self.texels,
        )

    @classmethod
    def from_dict(cls, values):
        """Make a recommendation of what `to_dict` gives; without its scene, see `with_scene`.

        Parameters
        ----------
        values : dict

        Returns
        -------
        recommendation : Recommendation

        Raises
        ------
        TypeError, ValueError
            If a key is missing or unknown, a value is not allowed, or two contradict each other:
            splits, texels, bytes or a reason's value that are not those of the settings, a goal
            that is met beside numbers that miss it.
        """
        arguments = read_values(values)
        return cls(**{**arguments, "reasons": Reasons(arguments["reasons"])})

    def to_dict(self):
        """Return everything but the scene and the coarse pictures as plain values.

        Returns
        -------
        values : dict
            Ready for JSON; of the scene its digest and bounds, of the reasons' ``flipped`` what
            differs from the settings.
        """
        return plain_values(self)

    def __eq__(self, other):
        if not isinstance(other, Recommendation):
            return NotImplemented
        return self is other or self.to_json() == other.to_json()

    def __hash__(self):
        return hash(self.to_json())

    def _headline(self):
        s = self.settings
        fit = s.fit if s.warp == "none" else f"{s.fit}, warp {s.warp}"
        what = (
            "no shadow maps"
            if s.filter == "none"
            else f"{maps_text(s)} {s.depth_format.upper()}, {s.filter}, fit {fit}"
        )
        return (
            f"{what}: {100.0 * self.expected_error:.2g} % error and {self.expected_ms:.0f} ms "
            f"forecast, {self.map_bytes / 1e6:.1f} MB of maps"
        )

    def __str__(self):
        lines = [self._headline()]
        if not self.met:
            lines.append(f"goal not met: {self.obstacle}")
        return "\n".join([*lines, "", str(self.reasons)])

    def _repr_html_(self):
        missed = "" if self.met else f"<p>goal not met: {escape(self.obstacle)}</p>"
        return f"<p>{escape(self._headline())}</p>{missed}{self.reasons._repr_html_()}"


def recommend(scene, camera, sun, *, max_error=None, budget_ms=None, max_bytes=None, renderer=None):
    """Settings with only the effects that a scene, seen by a camera under a sun, calls for.

    A few coarse renders are measured, nothing is traced; every effect is taken or left out by a
    row of `csm.decisions.TABLE`; number, sizes and splits of the maps are the cheapest whose
    forecast is on the goal's side. With neither goal it is the knee: the cheapest settings to which
    everything switched on (`csm.verification.everything_on`) is forecast to add no more than 0.02 %
    of the pixels or 2 % of the error, kernels of soft shadows aside; these may leave out no more of
    penumbrae than its own, or 5 %; or what costs at most 1 % of everything on's time more, and has
    fewer effects or less error.

    Parameters
    ----------
    scene : Scene
    camera : Camera, or sequence of Camera
        Several are a path: what stabilises is then looked at, too.
    sun : Sun, or sequence of Sun
        Several are a path; as many as the cameras, or one of either.
    max_error : float, optional
        Share, on the larger of disagreement and mean absolute error: the cheapest settings whose
        forecast reaches it.
    budget_ms : float, optional
        Milliseconds of a whole frame on this machine: the best settings that were timed to lie
        within it. For it at most 24 frames are rendered, four of each of at most six settings, so
        two runs may choose otherwise; without it nothing depends on time, and the same input on
        the same driver gives the same recommendation.
    max_bytes : int, optional
        Of the shadow maps: nothing larger is considered. Where not one map fits, the smallest is
        the nearest.
    renderer : Renderer, optional
        One of its own by default.

    Returns
    -------
    recommendation : Recommendation
        With `met` False, the nearest, and the effect that stands in the way.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of range.
    """
    cameras, suns = _path(camera, Camera, "camera"), _path(sun, Sun, "sun")
    check_kinds(scene=scene)
    check_renderer(renderer)
    goal = checked_goal(max_error, budget_ms, max_bytes)
    if len(cameras) > 1 and len(suns) > 1 and len(cameras) != len(suns):
        raise ValueError(
            f"camera and sun must be as many, or one (got {len(cameras)} and {len(suns)})"
        )
    with ExitStack() as stack:
        renderer = renderer or stack.enter_context(Renderer())
        stack.enter_context(renderer.aside())  # nothing that was rendered before may count
        return recommend_from(renderer, scene, cameras, suns, goal)


def checked_goal(max_error, budget_ms, max_bytes):
    """Goals of `recommend` as a dict.

    Raises
    ------
    TypeError, ValueError
        If one is no number or out of range.
    """
    given = {"max_error": max_error, "budget_ms": budget_ms, "max_bytes": max_bytes}
    return {
        name: None if value is None else as_number(name, value, *GOAL_RANGES[name])
        for name, value in given.items()
    }


def is_exact_goal(goal):
    """Whether a goal asks for the least error within a time, not for the least cost."""
    return goal["budget_ms"] is not None and goal["max_error"] is None


def recommend_from(renderer, scene, cameras, suns, goal, *, model=None, **motion):
    """Recommend what `recommend` does, from checked arguments.

    Parameters
    ----------
    renderer : Renderer
    scene : Scene
    cameras, suns : tuple of Camera, tuple of Sun
    goal : dict
        From `checked_goal`.
    model : CostModel, optional
        What frames cost here, where that is known: under ``budget_ms`` no frame is timed then.
    **motion
        ``camera_moves``, ``sun_moves``: what is known of them beyond the views given.

    Returns
    -------
    recommendation : Recommendation
    """
    signals = replace(measure_signals(renderer, scene, cameras, suns), **motion)
    info = renderer.info
    search = Search(signals, scene, goal, info["max_texture_size"], cost_model_of(info))
    if goal["budget_ms"] is not None and model is None:
        chosen, model = within_budget(renderer, scene, search)
    else:
        model = search.model if model is None else model
        chosen = search.choose(model)
    return _report(search, chosen, model, scene, (cameras, suns), goal)


def _report(search, chosen, model, scene, path, goal):
    """Make the answer: settings, reasons, and what stands in the way."""
    at = search.situation(chosen.settings)
    dark = chosen.settings.filter == "none"
    rows = [row for row in TABLE if not dark or row.effect == "shadows"]
    obstacle = obstacle_of(search, chosen, model, goal)
    splits = texels = ()
    if not dark:  # without maps there is nothing to fit, and no split that a camera may not allow
        view = search.signals.views[0]
        seen = np.concatenate([view.receivers, view.outline])
        fitted = fit_cascades(view.camera, view.sun, chosen.settings, scene=scene, receivers=seen)
        splits = tuple(fitted.splits.tolist())
        texels = tuple(fitted.texel_size.max(axis=1).tolist())
    return Recommendation(
        settings=chosen.settings,
        reasons=Reasons(row.reason(at) for row in rows),
        signals=search.signals,
        expected_error=float(chosen.error),
        expected_ms=float(chosen.ms),
        map_bytes=map_bytes(chosen.settings),
        goal=goal,
        met=obstacle is None,
        obstacle=obstacle,
        splits=splits,
        texels=texels,
        scene=scene,
        path=path,
        _search=search,
        _model=model,
    )


def obstacle_of(search, chosen, model, goal):
    """Which effect stands in the goal's way, or None.

    Parameters
    ----------
    search : Search
    chosen : Candidate
    model : CostModel
    goal : dict

    Returns
    -------
    obstacle : str or None
    """
    budget, limit, most = goal["budget_ms"], goal["max_error"], goal["max_bytes"]
    if most is not None and map_bytes(chosen.settings) > most:
        return _bytes_obstacle(chosen.settings, most)
    if budget is not None and chosen.ms > budget:
        maps, others = model.parts(chosen.settings, search.forecaster)
        what = (
            "map_size: shadow maps" if maps > others else "filter: the camera's view and the mask"
        )
        return f"{what} alone take {max(maps, others):.3g} ms of {budget:g} ms"
    if limit is not None and chosen.error > limit:
        return _error_obstacle(search, chosen, model, goal)
    if budget is None and limit is None and not search.forecast(chosen.settings, model).met:
        full = "everything switched on"
        what = f"map_size: {full} is forecast to gain more than the knee allows"
        binds = "max_bytes" if search.bytes_bind else "the limits"
        return f"{what}, and finer maps exceed {binds}"
    return None


def _bytes_obstacle(settings, most):
    """What keeps one map, the smallest, from being smaller: its texels, or their depths."""
    size = map_bytes(settings)
    halves = settings.depth_format == "d32f" and size <= 2 * most
    what = "depth_format: 32 bits are called for, and in them" if halves else "map_size:"
    return f"{what} the smallest map takes {size} bytes, max_bytes is {most:.15g}"


def _error_obstacle(search, chosen, model, goal):
    """Which effect leaves more error than asked for: the largest of the forecast's three terms."""
    settings, told = chosen.settings, search.forecaster
    aliasing, soft, leak = told.aliasing(settings), told.softness(settings), told.leak(settings)
    if soft > max(aliasing, leak):
        edges = "soft" if settings.filter == "pcss" else "hard"
        return f"filter: penumbrae leave {100.0 * soft:.2g} % with {edges} edges"
    if leak > aliasing:
        what = f"bias: light within a quarter texel of slope leaves {100.0 * leak:.2g} %"
    else:
        what = f"map_size: texels alone leave {100.0 * aliasing:.2g} %"
    # what holds finer maps back is what rules out candidates that are more exact
    if goal["budget_ms"] and search.least_error() < chosen.error:
        return f"{what}, and finer maps exceed budget_ms"
    if search.bytes_bind:
        return f"{what}, and finer maps exceed max_bytes"
    return f"{what}, with the largest maps"


def _shown(reason):
    if reason.effect == "shadows":
        return "on" if reason.taken else "off"
    return str(reason.value) if not isinstance(reason.value, float) else f"{reason.value:g}"


def _path(value, kind, name):
    """A camera or sun, or several, as a tuple."""
    if isinstance(value, kind):
        return (value,)
    try:
        several = () if isinstance(value, str) else tuple(value)
    except TypeError:
        several = ()
    wrong = next((one for one in several if not isinstance(one, kind)), value)
    if not several or wrong is not value:
        got = f"one with {wrong!r}" if several else type(value).__name__
        if isinstance(value, str):
            got = repr(value)
        elif not several and isinstance(value, (list, tuple)):
            got = "an empty one"
        raise TypeError(f"{name} must be a csm.{kind.__name__} or a sequence of them (got {got})")
    return several
