"""Recommendations put to the proof: each decision turned round, rendered, judged by the truth."""

from dataclasses import dataclass

import numpy as np

from .disc import SOFT_RAYS
from .metrics import compare
from .motion import flicker
from .sampling import NO_CASCADE
from .settings import ShadowSettings
from .tables import table_html, table_text
from .timing import all_in_turns, total_ms, warm_up_s
from .tracing import truth

__all__ = ["Row", "Verification", "everything_on", "everything_over", "verify"]

SHARE = 0.01  # of the error: a change below it is none
FLOOR = 1e-5  # of the judged pixels: two of a million-pixel picture that change with anything
SLACK = 0.05  # of milliseconds, which no two runs agree on better
FLICKER_FRAMES, FLICKER_POINTS = 6, 4000
NOTHING = "nothing to turn"
OUTPUTS = ("mask", "valid", "cascade_index")
#: What could matter for any still under a sun without a disc.
EVERYTHING = ShadowSettings(cascade_count=8, map_size=2048, fit="visible", cull="exclusive")


@dataclass(frozen=True)
class Row:
    """Settings that were rendered.

    Attributes
    ----------
    name : str
        ``"everything on"``, ``"recommended"``, or the effect that was turned round.
    taken : bool or None
        Whether the recommendation has the effect; None for the first two.
    settings : ShadowSettings
    error : float
        The larger of disagreement and mean absolute error; of a path the mean over its views.
    flicker : float
        `csm.flicker` over the path's first frames, `FlickerReport.mean`; NaN for a still.
    ms, ms_least : float
        Median and least of the frame's passes: on a busy machine the least is what repeats.
    bytes : int
    triangles : int
        Drawn into the maps.
    maps_ms : float
        Least of the maps' passes alone.
    confirmed : bool or None
        None for the first two, and for an effect of which there is nothing to turn: the numbers
        are then those of the recommendation.
    strict : bool or None
        As `confirmed`, but what was left out may not even make the picture worse by more than 1 %.
    why : str
    """

    name: str
    taken: bool | None
    settings: ShadowSettings
    error: float
    flicker: float
    ms: float
    ms_least: float
    bytes: int
    triangles: int
    maps_ms: float = float("nan")
    confirmed: bool | None = None
    strict: bool | None = None
    why: str = ""


@dataclass(frozen=True)
class Verification:
    """What was rendered, and which decisions it proves.

    Attributes
    ----------
    rows : tuple of Row
        Everything on, the recommendation, and one a reason.
    """

    rows: tuple[Row, ...]

    @property
    def everything_on(self):
        """Row with everything switched on."""
        return self.rows[0]

    @property
    def recommended(self):
        """Row of the recommendation."""
        return self.rows[1]

    @property
    def decisions(self):
        """Rows of the decisions turned round."""
        return tuple(row for row in self.rows[2:] if row.confirmed is not None)

    @property
    def unturned(self):
        """Rows of the decisions of which there is nothing to turn: they prove nothing."""
        return tuple(row for row in self.rows[2:] if row.confirmed is None)

    @property
    def confirmed_share(self):
        """Share of the decisions turned round that are confirmed, NaN without any."""
        known = [row.confirmed for row in self.decisions]
        return sum(known) / len(known) if known else float("nan")

    def to_dict(self):
        """Return plain values."""
        return {
            "confirmed_share": self.confirmed_share,
            "rows": [_plain_row(row) for row in self.rows],
        }

    def __str__(self):
        return table_text(_HEADS, [_cells(row) for row in self.rows])

    def _repr_html_(self):
        return table_html(_HEADS, [_cells(row) for row in self.rows])


def _plain_row(row):
    plain = {**vars(row), "settings": row.settings.to_dict()}
    return {
        name: None if isinstance(value, float) and np.isnan(value) else value
        for name, value in plain.items()
    }


_HEADS = ("rendered", "", "error", "flicker", "ms", "MB", "verdict")


def _cells(row):
    verdict = "" if row.confirmed is None else ("confirmed" if row.confirmed else "refuted")
    if row.taken is not None and row.confirmed is None:  # the numbers are not its own
        return (row.name, "was on" if row.taken else "was off", "", "", "", "", row.why)
    return (
        row.name if row.taken is None else f"{row.name} turned",
        "" if row.taken is None else ("was on" if row.taken else "was off"),
        f"{100.0 * row.error:.3f} %",
        "" if np.isnan(row.flicker) else f"{100.0 * row.flicker:.3f} %",
        f"{row.ms:.1f}",
        f"{row.bytes / 1e6:.1f}",
        f"{verdict}: {row.why}" if row.why else verdict,
    )


def everything_on(sun, soft_size=33, *, camera=None):
    """Settings with all that could matter for a still switched on.

    Parameters
    ----------
    sun : Sun
        With a disc, shadows are soft.
    soft_size : int
        Kernel of soft shadows [texels].
    camera : Camera, optional
        One whose near is not positive takes even splits: no other scheme begins there.

    Returns
    -------
    settings : ShadowSettings
    """
    settings = EVERYTHING
    if camera is not None and camera.near <= 0.0:
        settings = settings.replace(split="uniform")
    if sun.angular_diameter_deg > 0.0:
        settings = settings.replace(filter="pcss", filter_size=soft_size)
    return settings


def everything_over(views, soft_size=33):
    """`everything_on` that every camera of some views allows, under the first one's sun."""
    nearest = min((view.camera for view in views), key=lambda camera: camera.near)
    return everything_on(views[0].sun, soft_size, camera=nearest)


def verify(renderer, recommendation, *, rays_per_pixel=None, repeats=3, soft_size=33):
    """Render everything on, the recommendation, and each of its decisions turned round.

    Parameters
    ----------
    renderer : Renderer
    recommendation : Recommendation
    rays_per_pixel : int, optional
        Of the truth; by default 1 for a point sun, 64 for a disc.
    repeats : int
        Frames that are timed of each, in turns of a few after one that is not.
    soft_size : int
        Kernel of everything's soft shadows [texels].

    Returns
    -------
    verification : Verification
        What would draw the same turned round is not judged: `Verification.unturned`.
    """
    judge = _Judge(renderer, recommendation, rays_per_pixel)
    reasons, ours = recommendation.reasons, recommendation.settings
    wanted = [everything_over(judge.views, soft_size), ours]
    wanted += [ours if reason.flipped is None else reason.flipped for reason in reasons]
    keys = [settings.canonical() for settings in wanted]
    known = judge.measure(dict(zip(keys, wanted, strict=True)), repeats)
    rows = [
        Row(name, None, settings, **known[key])
        for name, settings, key in zip(
            ("everything on", "recommended"), wanted[:2], keys[:2], strict=True
        )
    ]
    for reason, settings, key in zip(reasons, wanted[2:], keys[2:], strict=True):
        row = Row(reason.effect, reason.taken, settings, **known[key])
        confirmed, strict, why = None, None, NOTHING
        if key != keys[1]:  # the same settings, differently said, prove nothing
            confirmed, strict, why = _verdict(reason, rows[1], row, judge.moves)
        rows.append(Row(**{**vars(row), "confirmed": confirmed, "strict": strict, "why": why}))
    return Verification(tuple(rows))


def _verdict(reason, ours, other, moves):
    """Whether a decision holds against the same turned round: plainly, strictly, and why."""
    if moves and reason.effect in ("snap", "light_basis"):
        mine, its, what = ours.flicker, other.flicker, "flicker"
    else:
        mine, its, what = ours.error, other.error, "error"
    least = max(SHARE * mine, FLOOR)
    change = its - mine
    said = f"{what} {change / mine:+.1%}" if mine > FLOOR else f"{what} {100.0 * change:+.4f} %"
    change, least = float(change), float(least)
    if not reason.taken:
        return change >= -least, abs(change) <= least, f"{said} when added"
    if reason.saves:  # but what it spares may be errors as well
        saved = _saved(ours, other)
        holds = change > least or (bool(saved) and change >= -least)
        return holds, holds, f"saves {saved or 'nothing'}; {said} without"
    return change > least, change > least, f"{said} when removed"


def _saved(ours, other):
    """What a decision spares against the same turned round, in words; "" if nothing."""
    if ours.bytes < other.bytes:
        return f"{(other.bytes - ours.bytes) / 1e6:.1f} MB"
    if ours.triangles < other.triangles:
        return f"{other.triangles - ours.triangles:,} triangles"
    if ours.maps_ms < (1.0 - SLACK) * other.maps_ms:
        return f"{1.0 - ours.maps_ms / other.maps_ms:.0%} of the maps' time"
    return ""


class _Judge:
    """Renders settings over the views of a recommendation and judges them."""

    def __init__(self, renderer, recommendation, rays_per_pixel):
        self._renderer, self._scene = renderer, recommendation.scene
        self.views = recommendation.signals.views
        self.moves = recommendation.signals.camera_moves or recommendation.signals.sun_moves
        self._path = recommendation.path
        self._truths = []
        for view in self.views:
            soft = view.sun.angular_diameter_deg > 0.0
            own = SOFT_RAYS if soft else 1
            rays = own if rays_per_pixel is None else rays_per_pixel
            self._truths.append(truth(self._scene, view.camera, view.sun, rays_per_pixel=rays))

    def measure(self, wanted, repeats):
        """Error, flicker, time and bytes of each of the settings, by their canonical form."""
        view, known = self.views[0], {}
        for key, settings in wanted.items():
            errors = []
            for at, traced in zip(self.views, self._truths, strict=True):
                frame = self._renderer.render(
                    self._scene, at.camera, at.sun, settings, outputs=OUTPUTS
                )
                errors.append(picture_error(frame, traced))
            known[key] = {
                "error": float(np.mean(errors)),
                "flicker": self._flicker(settings) if self.moves else float("nan"),
                "bytes": int(frame.info["bytes"]),
                "triangles": int(sum(frame.info["triangles_drawn"])),
            }

        def frame_times(key):
            frame = self._renderer.render(
                self._scene, view.camera, view.sun, wanted[key], outputs=OUTPUTS
            )
            return frame.timings_ms

        warm_up = warm_up_s(self._renderer.info)
        found = all_in_turns(list(wanted), frame_times, repeats=repeats, warm_up=warm_up)
        for key, samples in found.items():
            times = [total_ms(passes) for passes in samples]
            known[key] |= {
                "ms": float(np.median(times)),
                "ms_least": float(min(times)),
                "maps_ms": float(min(passes.get("shadow_map", 0.0) for passes in samples)),
            }
        return known

    def _flicker(self, settings):
        """`csm.flicker` at points that the path's first picture shows; 0 where none is seen."""
        cameras, suns = self._path
        first = self._truths[0]
        seen = np.flatnonzero(first.valid & first.facing)
        if not len(seen):
            return 0.0
        seen = seen[:: -(-len(seen) // FLICKER_POINTS)]
        points = first.position.reshape(-1, 3)[seen]
        normals = first.normal.reshape(-1, 3)[seen]
        frames = [
            self._renderer.render(
                self._scene, cameras[min(number, len(cameras) - 1)],
                suns[min(number, len(suns) - 1)], settings,
                outputs=(), points=points, point_normals=normals,
            )
            for number in range(min(FLICKER_FRAMES, max(len(cameras), len(suns))))
        ]  # fmt: skip
        mean = flicker(frames, scene=self._scene).mean
        return mean if np.isfinite(mean) else 0.0


def picture_error(frame, traced):
    """The larger of disagreement and mean absolute error, 0 where nothing is judged."""
    judged = frame.valid & traced.valid & traced.facing
    if frame.settings.filter != "none":
        judged &= frame.cascade_index != NO_CASCADE
    if not judged.any():
        return 0.0
    report = compare(frame.mask, traced.mask, valid=judged)
    return float(max(report.disagreement, report.mean["total"]))
