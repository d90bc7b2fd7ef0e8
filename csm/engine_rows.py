"""What a row of the table of engines is made of, and what several engines ask of our settings."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .settings import MANUAL_BIASES

__all__ = ["Engine", "Fixed", "Near", "Setting"]

SOFT_KERNEL = 5  # texels that the bias of soft shadows is for: their penumbra is not known
VARIANCE = ("vsm", "evsm2", "evsm4", "esm", "msm", "lvsm", "savsm", "fourier")
SPLITS = ("split", "lam", "manual_splits", "first_split")
RANGE = ("max_distance", "view_range")
BLEND = ("blend", "blend_width")
BIAS = ("bias", "bias_side", *MANUAL_BIASES, "receiver_plane")
FILTER = ("filter", "filter_size", "filter_weights")
LEAST_SIZE = 4  # of a map that has a texel within the border that its windows leave
COMMON_SIZE = 4096  # of textures that browsers have nearly everywhere


@dataclass(frozen=True)
class Near:
    """A value that is not quite ours, and how far from it.

    Attributes
    ----------
    value : object
    note : str
    of : str or None
        The setting of ours that the note is about; by default the row's first.
    """

    value: object
    note: str
    of: str | None = None


@dataclass(frozen=True)
class Setting:
    """A setting of an engine.

    Attributes
    ----------
    name : str
        As the engine has it.
    of : tuple of str
        Settings of ours that it stands for.
    unit : str
    page : str
        Where it is documented.
    value : callable
        Of a `csm.engine_windows.EngineWindows`: the value, `Near` it, or None where there is none
        to write.
    code : str
        A line of the snippet, ``$`` being the value.
    place : int
        Which part of the snippet it goes to.
    limits : (float, float) or None
        Least and most that the engine takes; what is beyond is held to them, and told.
    """

    name: str
    of: tuple[str, ...]
    unit: str
    page: str
    value: Callable
    code: str
    place: int = 0
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Fixed:
    """What an engine does in one way, without a setting.

    Attributes
    ----------
    of : str
        The setting of ours.
    same : tuple or callable
        Values of ours that are the same, or what gives them of an EngineWindows; all others have no
        counterpart.
    text : str
        What the engine does.
    """

    of: str
    same: tuple | Callable
    text: str


@dataclass(frozen=True)
class Engine:
    """An engine's cascaded shadow maps.

    Attributes
    ----------
    title : str
    counts : tuple of int
        Of cascades.
    map_size : callable
        Of our size and the number of cascades there: the side of a cascade's map.
    fit : callable
        Of an EngineWindows: which of our fits its windows are like.
    kernel : callable
        Of an EngineWindows: texels along the filter that it will use, for the bias.
    depth : callable
        Of an EngineWindows: which of our depth formats and ranges its maps are like, for the bias.
    settings : tuple of Setting
    fixed : tuple of Fixed
    off : Setting
        What switches the light's shadows off: all that is written where there are none.
    off_about : str
        A comment before that line: what its names stand for.
    template : str
        Of the snippet; ``@0``, ``@1`` … stand for the lines of the settings.
    comment : str
        What begins a comment.
    true, false : str
    brackets : tuple of str
        Around a list.
    suffix : str
        After a number with a point.
    """

    title: str
    counts: tuple[int, ...]
    map_size: Callable
    fit: Callable
    kernel: Callable
    depth: Callable
    settings: tuple[Setting, ...]
    fixed: tuple[Fixed, ...]
    off: Setting
    off_about: str
    template: str
    comment: str = "//"
    true: str = "true"
    false: str = "false"
    brackets: tuple[str, str] = ("[", "]")
    suffix: str = ""


# -- what several engines ask ---------------------------------------------------------------------


def cascade_count(at):
    """Cascades there."""
    if at.count == at.ours:
        return at.count
    text = f"{'one cascade becomes' if at.ours == 1 else f'{at.ours} cascades become'} {at.count}"
    return Near(at.count, f"{text}, cut anew along the same curve", "cascade_count")


def map_size(at, scale=1):
    """Side of a texture that holds ``scale`` maps along it."""
    differ = len(set(at.our_sizes)) > 1
    if at.size == at.our_size and not differ:
        return scale * at.size
    text = f"{at.our_size} become {at.size} texels, {at.size / at.our_size:.3g} times"
    if differ:
        ours, in_all = ", ".join(map(str, at.our_sizes)), sum(size**2 for size in at.our_sizes)
        text = (
            f"{ours} become {at.size} texels, one size for all cascades: "
            f"{at.count * at.size**2 / in_all:.3g} times as many in all, where "
            f"{round(math.sqrt(in_all / at.count))} each would be as many"
        )
    return Near(scale * at.size, text, "map_size")


def browser_map_size(at):
    """Side of a cascade's map in a browser, whose devices differ in what they can have."""
    kept = map_size(at)
    if at.size <= COMMON_SIZE:
        return kept
    note = f"not every device has textures of more than {COMMON_SIZE} texels"
    return Near(at.size, f"{kept.note}; {note}" if isinstance(kept, Near) else note, "map_size")


def shadow_distance(at):
    """End of the shadow range [m]."""
    return at.far


def begins_late(at):
    """Note about a first cascade that begins at the camera, or None."""
    if at.begin <= at.near * (1.0 + 1e-6):
        return None
    near = f"the camera's near, {at.near:.4g} m"
    return f"the first cascade begins at {near}, not at {at.begin:.4g} m"


def with_begin(at, value):
    """Value that is about splits, with a note where the first cascade begins too early."""
    note = begins_late(at)
    return value if note is None else Near(value, note)


def split_note(at, made, what):
    """Say how far the splits of a scheme are from those wanted."""
    missed = np.abs(np.asarray(made)[1:-1] - np.asarray(at.splits)[1:-1])
    if not len(missed) or (missed <= 1e-6 * at.far).all():
        return begins_late(at)
    worst = int(np.argmax(missed))
    note = (
        f"{what}: split {worst + 1} lies at {made[worst + 1]:.4g} m instead of "
        f"{at.splits[worst + 1]:.4g} m, the farthest of them from its place"
    )
    begin = begins_late(at)
    return note if begin is None else f"{note}; {begin}"


def is_soft(at):
    """Whether penumbrae of the sun's disc are wanted."""
    return at.settings.filter == "pcss"


def is_hard(at):
    """Whether nothing is filtered."""
    return at.settings.filter == "hard"


def quality(at, sides, values):
    """Value for the smallest kernel that is not below ours, the largest if none is."""
    side = SOFT_KERNEL if is_soft(at) else at.settings.filter_size
    chosen = next((i for i, one in enumerate(sides) if one >= side), len(sides) - 1)
    return chosen, values[chosen]


def fade_start(at):
    """View depth [m] at which shadows begin to fade."""
    return at.far - at.settings.fade_width * (at.far - at.begin)


def fade_share(at):
    """Share of the shadow distance, from its end, over which shadows fade."""
    return 1.0 - fade_start(at) / at.far


def from_sun(at):
    """Unit vector along the light, away from the sun."""
    return [0.0 - float(one) for one in at.sun.to_light]


def from_sun_mirrored(at):
    """The same in left-handed axes with y up: x mirrored, as importers of glTF do."""
    x, y, z = from_sun(at)
    return [0.0 - x, y, z]


def from_sun_z_up(at):
    """The same in left-handed axes with z up: y and z change places, as importers of glTF do."""
    x, y, z = from_sun(at)
    return [x, z, y]


def faces(at):
    """Which sides of triangles cast."""
    return at.settings.caster_faces


def blend_share(at, most=1.0):
    """Width of transitions, as share of a cascade's depth."""
    if at.settings.blend == "none":
        return 0.0
    width = min(at.settings.blend_width, most)
    of = "the slice" if at.settings.select == "interval" else "half a map"
    note = f"{at.settings.blend_width:g} of {of} becomes {width:g} of a cascade's depth"
    if at.settings.blend != "linear":
        note += f", {at.settings.blend} becomes linear"
    return Near(width, note)


def sun_disc(at):
    """Width of the sun's disc [degrees], 0 where no penumbra is wanted."""
    return at.sun.angular_diameter_deg if is_soft(at) else 0.0


def not_theirs(at, name):
    """Say that a filter of ours becomes another."""
    return f"{at.settings.filter} becomes {name}"


def in_metres(texels, at):
    """Texels of each of the engine's cascades as metres."""
    return [float(one) for one in texels * at.texels]


def stabilised(at):
    """Whether windows move by whole texels."""
    if at.settings.snap != "approximate":
        return at.settings.snap == "exact"
    return Near(True, "approximate becomes windows of fixed size", "snap")


INTERVAL = Fixed("select", ("interval",), "a cascade answers for its own view depths")
NEVER_TURNED = Fixed("turned", (False,), "windows lie along the light's own axes")
ORTHONORMAL = Fixed("light_basis", ("orthonormal",), "light axes are orthonormal")
NO_WARP = Fixed("warp", ("none",), "maps have no perspective warp")
CULLED = Fixed("cull", ("inclusive",), "each cascade draws what its own frustum can need")
DEPTH_WINDOW = Fixed("depth_range", ("window",), "near and far are set for each cascade by itself")
NO_FADE = Fixed("fade_width", (0.0,), "shadows end at the distance at once")
SNAPPED = Fixed("snap", ("exact",), "windows of fixed size move by whole texels")


def held(value, limits, what):
    """Value, or list of them, held to the limits of an engine; and a note if it had to be."""
    if limits is None:
        return value, None
    low, high = limits
    if isinstance(value, list):
        kept = [min(max(one, low), high) for one in value]
        shown = ", ".join(f"{one:.4g}" for one in value)
    else:
        kept, shown = min(max(value, low), high), f"{value:.4g}"
    return kept, None if kept == value else f"{what}: {shown} is held to {low:g} to {high:g}"


def with_constant(at, texels):
    """Texels of a bias that has to hold our constant part, too, in the cascade that needs most."""
    return texels + float((at.constant_m / at.texels).max())


def sphere(at):
    """Windows are the sphere round the slice."""
    return "sphere"
