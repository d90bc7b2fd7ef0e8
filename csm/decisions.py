"""Which effects a scene calls for: one table, one row an effect.

A row says what calls for the effect, from which threshold on and where that comes from, and what
the effect costs. Every row answers for every scene: what was taken, and what was left out, each
with its measurement. `csm.recommend` asks the rows; `Recommendation.verify` turns each answer
round and looks whether the picture minds.
"""

from collections.abc import Callable
from dataclasses import dataclass

from .caster_sides import BACK_GAIN, FACES_SHARE, LIT_NEARLY_ALL
from .flips import (
    equal_maps,
    equal_memory,
    fewer,
    half_size,
    nearest_faces,
    other_filter,
    other_split,
    other_warp,
    resized,
)
from .map_shares import WORTH, equal_side, texels_spared
from .plans import map_bytes
from .settings import ShadowSettings, draw_alike, maps_text
from .situations import (
    GAIN,
    SMALLEST,
    SOFT_PIXELS,
    WARP_GAIN,
    WORLD_ELEVATION_DEG,
    is_default_split,
    needed_bias,
    quantum_16,
    several,
)

__all__ = ["TABLE", "Decision", "Reason", "split_text", "value_of"]


@dataclass(frozen=True)
class Reason:
    """Why an effect was taken or left out.

    Attributes
    ----------
    effect : str
        The setting it is about.
    value : object
        What it was set to.
    taken : bool
    measured : str
        What was seen, with its unit.
    threshold : str
        What would have turned it.
    source : str
        Where the threshold comes from.
    cost : str
        What the effect costs, or saves.
    flipped : ShadowSettings or None
        The settings with this answer turned round; None where there is nothing to turn, because
        the effect means nothing beside the others (snapping of turned windows, blending of one
        cascade): every other answer would draw the same.
    saves : bool
        Taken to save time or memory, not to lower the error.
    """

    effect: str
    value: object
    taken: bool
    measured: str
    threshold: str
    source: str
    cost: str
    flipped: ShadowSettings | None
    saves: bool = False


@dataclass(frozen=True)
class Decision:
    """A row of the table.

    Attributes
    ----------
    effect : str
    calls_for, threshold, source, cost : str
        For people.
    taken : callable
        Of a Situation: whether the settings have the effect.
    measured : callable
        Of a Situation: text of what calls for it or does not.
    flipped : callable
        Of a Situation: changes that turn the answer round, None where there is nothing to turn.
    saves : bool
    """

    effect: str
    calls_for: str
    threshold: str
    source: str
    cost: str
    taken: Callable
    measured: Callable
    flipped: Callable
    saves: Callable = lambda at: False

    def reason(self, at):
        """Answer for a situation.

        Parameters
        ----------
        at : Situation

        Returns
        -------
        reason : Reason
        """
        changes = self.flipped(at)
        flipped = None if changes is None else at.settings.replace(**changes)
        if flipped is not None and draw_alike(flipped, at.settings):
            flipped = None  # the same would be drawn: no other answer
        return Reason(
            effect=self.effect,
            value=value_of(self.effect, at.settings),
            taken=bool(self.taken(at)),
            measured=self.measured(at),
            threshold=self.threshold,
            source=self.source,
            cost=self.cost,
            flipped=flipped,
            saves=bool(self.saves(at)),
        )


def split_text(settings):
    """The split in words: the practical scheme with its lambda, where that is not the default."""
    if settings.split != "practical" or is_default_split(settings):
        return settings.split
    return f"practical {settings.lam:g}"


def value_of(effect, settings):
    """What a reason gives as its effect's value."""
    if effect == "split":
        return split_text(settings)
    return getattr(settings, "filter" if effect == "shadows" else effect)


def _blend_ratio(at):
    sides = at.forecaster.texel_sides(at.settings)
    return sides.max() / sides.min()


def _excess(at, changes):
    gain = at.gain(**changes)
    return gain / (1.0 - gain) if gain < 1.0 else 0.0


def _faces_measured(at):
    told = at.signals
    measured = {"front": told.front_matters, "back": told.faces_matter}
    changes = [
        f"{side} alone changes {_percent(share)}" for side, share in measured.items() if share < 1.0
    ]
    text = "no shadow seen, or too little, to tell sides apart"
    if changes:
        text = ", ".join(changes) + " of facing pixels"
    return text + f"; {_percent(told.lit_area)} of the casters' area faces the sun"


def _percent(share):
    return f"{100.0 * share:.3g} %"


def _count_measured(at):
    ratio = f"depths in a ratio of {at.signals.depth_ratio:.3g}"
    if not several(at):
        saved = max(0.0, -at.gain(**equal_memory(at)))
        return f"{ratio}; two maps of as many texels save {_percent(saved)}"
    others = fewer(at)
    return f"{ratio}; {others['cascade_count']} leave {_percent(_excess(at, others))} more error"


def _less(gain):
    """Share less, or, of a gain below nothing, more."""
    return f"{_percent(abs(gain))} {'less' if gain >= 0.0 else 'more'}"


# -- the table ------------------------------------------------------------------------------------

TABLE = (
    Decision(
        effect="shadows",
        calls_for="a visible surface that faces the sun",
        threshold="any",
        source="a surface turned from the sun is dark under any map",
        cost="every map, and most of the mask's pass",
        taken=lambda at: at.settings.filter != "none",
        measured=lambda at: (
            f"{_percent(at.signals.facing_share)} of what is seen faces the sun, "
            f"{_percent(at.signals.shadowed_share)} of that in shadow"
        ),
        flipped=lambda at: (
            {"filter": "none"}
            if at.settings.filter != "none"
            else {"filter": "hard", "cascade_count": 1, "map_size": SMALLEST}
        ),
    ),
    Decision(
        effect="cascade_count",
        calls_for="receivers at depths of very different scale, with shadow edges at both",
        threshold="the cheapest count and size on the goal's side of the front",
        source="forecast of every count and size: docs/recommendation.md, docs/numerics.md 13",
        cost="a map each: its texels, and its casters once more",
        taken=several,
        measured=_count_measured,
        flipped=lambda at: fewer(at) if several(at) else equal_memory(at),
    ),
    Decision(
        effect="map_size",
        calls_for="shadow edges, and texels that are large in the picture",
        threshold="the cheapest count and size on the goal's side of the front",
        source="a texel displaces an edge by a quarter of itself: docs/numerics.md 13",
        cost="its square in texels",
        taken=lambda at: at.signals.edge_share > 0.0,
        measured=lambda at: (
            f"edges of {1e3 * at.signals.edge_share:.3g} px per 1000 px; half the size leaves "
            f"{_percent(_excess(at, half_size(at)))} more error"
        ),
        flipped=lambda at: half_size(at) if at.signals.edge_share > 0.0 else resized(at, 2.0),
    ),
    Decision(
        effect="fit",
        calls_for="anything seen: windows round it hold nothing else",
        threshold="any: spheres light contacts, also where the coarse picture shows no edge",
        source="measured: docs/numerics.md 22",
        cost="a pass over the picture before the maps",
        taken=lambda at: at.settings.fit == "visible",
        measured=lambda at: f"{_less(at.gain(fit='sphere', turned=False))} error than spheres",
        flipped=lambda at: (
            {"fit": "sphere", "turned": False}
            if at.settings.fit == "visible"
            else {"fit": "visible"}
        ),
    ),
    Decision(
        effect="turned",
        calls_for="a still whose receivers lie along no axis of the light",
        threshold="saves more than its pass; never in motion, where it cannot be snapped",
        source="measured: docs/numerics.md 22",
        cost="a second pass over the picture",
        taken=lambda at: at.settings.turned,
        measured=lambda at: (
            f"{_percent(at.gain(turned=not at.settings.turned))} "
            f"{'gained' if at.settings.turned else 'kept'} by windows "
            f"{'turned' if at.settings.turned else 'along the axes'}"
        ),
        flipped=lambda at: {"turned": not at.settings.turned},
    ),
    Decision(
        effect="split",
        calls_for="slices whose receivers ask for texels of another scale, or that have none",
        threshold=(
            f"maps cost {_percent(GAIN)} less for an error than by the practical scheme with "
            "lam 0.5"
        ),
        source="forecast; docs/recommendation.md, docs/numerics.md 17",
        cost="nothing; by what is seen (sdsm) a reduction over the picture",
        taken=lambda at: several(at) and not is_default_split(at.settings),
        measured=lambda at: (
            _split_gain(at)
            + "receivers of four practical cascades: "
            + " ".join(f"{100.0 * share:.0f}" for share in at.signals.cascade_shares)
            + " %"
        ),
        flipped=other_split,
    ),
    Decision(
        effect="snap",
        calls_for="motion: texels that move flicker",
        threshold="a path of cameras or suns",
        source="docs/numerics.md 7 and 22: flicker 0.3 % free, 0.00 to 0.02 % snapped",
        cost="sizes rounded up to steps of 9 %",
        taken=lambda at: at.settings.snap != "none",
        measured=lambda at: "camera or sun moves" if at.moves else "a still",
        flipped=lambda at: {"snap": "none" if at.settings.snap != "none" else "exact"},
    ),
    Decision(
        effect="light_basis",
        calls_for="a moving sun: the grid on the ground stands still along the world's axes",
        threshold=f"the sun moves, and stands above {WORLD_ELEVATION_DEG} degrees",
        source="docs/numerics.md 18",
        cost="texels stretched along the light",
        taken=lambda at: at.settings.light_basis != "orthonormal",
        measured=lambda at: (
            f"sun {'moves' if at.signals.sun_moves else 'stands still'} at "
            f"{at.signals.sun_elevation_deg:.0f} degrees"
        ),
        flipped=lambda at: {
            "light_basis": "world" if at.settings.light_basis == "orthonormal" else "orthonormal"
        },
    ),
    Decision(
        effect="select",
        calls_for="several maps that overlap: the finest that holds a point answers",
        threshold=(
            f"several cascades, and {_percent(GAIN)} of error or casters that finer maps make "
            "needless"
        ),
        source="docs/numerics.md 9 and 24",
        cost="a few multiplications a pixel",
        taken=lambda at: several(at) and at.settings.select == "map",
        measured=lambda at: (
            f"{_percent(1.0 - 1.0 / (1.0 + _excess(at, {'select': 'interval'})))} less error than "
            "by depth"
            if several(at)
            else "one map: nothing to select"
        ),
        flipped=lambda at: (
            {"select": "interval" if at.settings.select == "map" else "map"}
            if several(at)
            else None
        ),
        saves=lambda at: at.settings.cull == "exclusive" and at.gain(select="interval") < GAIN,
    ),
    Decision(
        effect="cull",
        calls_for="map selection, and casters wholly under a finer map",
        threshold="selection by map, and a chunk so left out in the coarse maps",
        source="docs/numerics.md 24: changes no mask",
        cost="nothing; saves triangles",
        taken=lambda at: at.settings.cull == "exclusive",
        measured=lambda at: (
            f"four maps leave out {at.signals.needless_chunks} chunks more, and draw "
            f"{sum(at.signals.casters):,} triangles"
        ),
        flipped=lambda at: {
            "cull": "inclusive" if at.settings.cull == "exclusive" else "exclusive"
        },
        saves=lambda at: at.settings.cull == "exclusive",
    ),
    Decision(
        effect="caster_faces",
        calls_for="closed casters: either of their sides throws the same shadow",
        threshold=(
            "front: no facing pixel changes in the coarse picture, and at most "
            f"{_percent(LIT_NEARLY_ALL)} of the casters' area faces the sun; back: at most "
            f"{_percent(FACES_SHARE)} of pixels change, or of what it gets wrong "
            f"{_percent(BACK_GAIN)} come right"
        ),
        source="coarse renders, compared: csm/caster_sides.py",
        cost="nothing; saves the fill of the other sides",
        taken=lambda at: at.settings.caster_faces != "both",
        measured=_faces_measured,
        flipped=lambda at: (
            {"caster_faces": "both", "bias": "auto"}
            if at.settings.caster_faces != "both"
            else {"caster_faces": nearest_faces(at.signals)}
        ),
        saves=lambda at: at.settings.caster_faces != "both",
    ),
    Decision(
        effect="filter",
        calls_for="a sun with a disc, and occluders far from their shadows",
        threshold=(
            f"99th percentile of the penumbra at least {SOFT_PIXELS:g} px, or an error asked for "
            "that hard edges miss"
        ),
        source="a narrower one is less than a step between pixels",
        cost="a search and a kernel at every pixel",
        taken=lambda at: at.settings.filter not in ("hard", "none"),
        measured=lambda at: (
            f"penumbra {at.signals.penumbra_pixels[0]:.2g} px, 99 % below "
            f"{at.signals.penumbra_pixels[2]:.2g} px; a variance map would light "
            f"{_percent(at.signals.layered_share)} of full shadow"
        ),
        flipped=other_filter,
    ),
    Decision(
        effect="tap_count",
        calls_for="penumbrae, whose shades are as many as taps",
        threshold="the fewest taps on the goal's side of the front",
        source="measured: 8 leave a tenth more of what hard edges miss: docs/recommendation.md",
        cost="twice each, for the search and for the kernel",
        taken=lambda at: at.settings.filter == "pcss",
        measured=lambda at: (
            f"hard edges would miss {_percent(at.forecaster.penumbra())}"
            if at.settings.filter == "pcss"
            else "no soft filter"
        ),
        flipped=lambda at: (
            {"tap_count": 4, "disc": "vogel"} if at.settings.filter == "pcss" else None
        ),
    ),
    Decision(
        effect="blend",
        calls_for="a visible boundary of cascades whose texels differ, under a soft filter",
        threshold=(
            f"never: where texels differ by a factor of 7 it changes no error by {_percent(GAIN)}"
        ),
        source="measured: docs/recommendation.md; hard edges: docs/numerics.md 9, 24",
        cost="two maps looked up in the band",
        taken=lambda at: at.settings.blend != "none",
        measured=lambda at: (
            f"{at.settings.cascade_count} cascades, texels in a ratio of {_blend_ratio(at):.2g}, "
            f"filter {at.settings.filter}"
            if several(at)
            else f"one cascade: no boundary; filter {at.settings.filter}"
        ),
        flipped=lambda at: {"blend": "linear" if at.settings.blend == "none" else "none"},
    ),
    Decision(
        effect="fade_width",
        calls_for="a shadow range that ends in sight",
        threshold="receivers beyond the range",
        source="view_range scene ends behind the scene: docs/numerics.md 2",
        cost="light over true shadows at the end",
        taken=lambda at: at.settings.fade_width > 0.0,
        measured=lambda at: (
            f"what is seen ends at {at.signals.depth_edges[-1]:.3g} m, inside the range"
        ),
        flipped=lambda at: {"fade_width": 0.1},
    ),
    Decision(
        effect="bias",
        calls_for="surfaces that are not square to the sun, and rounding",
        threshold=f"{_percent(FACES_SHARE)} of facing pixels change without, in coarse maps",
        source="two coarse renders; the amount by the closed form: docs/numerics.md 11",
        cost="light within a quarter texel of slope",
        taken=lambda at: at.settings.bias == "auto",
        measured=lambda at: (
            f"slope {at.signals.slope_percentiles[0]:.2g}, 99 % below "
            f"{at.signals.slope_percentiles[2]:.2g}: {1e3 * needed_bias(at):.2g} mm at the median"
            if at.settings.bias == "auto"
            else f"{_percent(at.signals.faces_matter + at.signals.bias_matters)} change: "
            "far sides cast, and need none"
        ),
        flipped=lambda at: {"bias": "manual" if at.settings.bias == "auto" else "auto"},
    ),
    Decision(
        effect="depth_format",
        calls_for="depth steps below the bias that slopes need anyway",
        threshold="a step of 16 bits < 1/4 texel * median slope",
        source="quantum against bias: docs/numerics.md 11",
        cost="nothing; saves half the bytes",
        taken=lambda at: at.settings.depth_format == "d16",
        measured=lambda at: (
            f"step {1e3 * quantum_16(at):.2g} mm over {at.signals.depth_span:.3g} m, "
            f"bias {1e3 * needed_bias(at):.2g} mm"
            if at.settings.warp == "none"
            else "depths are bent by the warp: no step is the same everywhere"
        ),
        flipped=lambda at: {"depth_format": "d16" if at.settings.depth_format != "d16" else "d32f"},
        saves=lambda at: at.settings.depth_format == "d16",
    ),
    Decision(
        effect="storage",
        calls_for="cascades of which some miss more than others for what their texels cost",
        threshold=(f"equal maps as good have {WORTH:g} times the texels; never in motion"),
        source="forecast: csm/map_shares.py; layers are all as large: docs/numerics.md 24",
        cost="nothing: tiles of an atlas, few pixels rounded otherwise",
        taken=lambda at: at.settings.storage != "array",
        measured=lambda at: (
            f"maps of one size, {map_bytes(at.settings) / 1e6:.3g} MB"
            if at.settings.storage == "array"
            else f"{maps_text(at.settings)}: {map_bytes(at.settings) / 1e6:.3g} MB"
            + _beside_equal(at)
        ),
        flipped=equal_maps,
        saves=lambda at: at.settings.storage != "array",
    ),
    Decision(
        effect="depth_range",
        calls_for="a depth step that shows, over a range much longer than a window's part",
        threshold="needs 16 bits, and a step above the bias",
        source="docs/numerics.md 19",
        cost="ranges that change from map to map; no exclusive culling",
        taken=lambda at: at.settings.depth_range != "scene",
        measured=lambda at: f"{at.signals.depth_span:.3g} m, {at.settings.depth_format}",
        flipped=lambda at: {"depth_range": "window"},
    ),
    Decision(
        effect="warp",
        calls_for="a still down a long view across the light",
        threshold=(
            f"the forecast gains {_percent(WARP_GAIN)}, and that saves more than it costs; never "
            "in motion, where it cannot be snapped"
        ),
        source="forecast; docs/recommendation.md, docs/numerics.md 21",
        cost="a shader writes depth: maps take 2 to 3 times as long to fill on llvmpipe",
        taken=lambda at: at.settings.warp != "none",
        measured=lambda at: (
            f"light {at.signals.light_view_angle_deg:.0f} degrees from the view, depths in a ratio "
            f"of {at.signals.depth_ratio:.3g}: {_percent(at.gain(warp=other_warp(at)))} "
            f"{'gained' if at.settings.warp != 'none' else 'kept'} by the "
            f"{'warp' if at.settings.warp != 'none' else 'plain map'}"
        ),
        flipped=lambda at: {"warp": other_warp(at)},
    ),
)


def _split_gain(at):
    """How much error the split spares beside the default one, in as many texels."""
    other = None if is_default_split(at.settings) else other_split(at)
    if other is None:
        return ""
    scheme = split_text(at.settings)
    return f"{scheme}: {_less(at.gain(**other))} error than practical; "


def _beside_equal(at):
    """What maps of unequal sizes save beside equal ones of the same error."""
    side, spared = (one(at.settings, at.forecaster) for one in (equal_side, texels_spared))
    if side is None:
        return ""
    return f"; equal maps as good are {side:.0f}², {spared:.3g} times the texels"
