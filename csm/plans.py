"""What a frame will run and hold, before any OpenGL: passes, textures, programs, bytes."""

from dataclasses import dataclass
from typing import NamedTuple

from . import _core
from .camera import checked_size
from .cascades import check_kinds

__all__ = ["DEFAULT_OUTPUTS", "OUTPUTS", "Plan", "map_bytes", "plan"]

#: Outputs that can be asked for by name.
OUTPUTS = (
    "mask", "mask_single", "valid", "view_depth", "cascade_index", "shadow_maps", "moments",
    "normal",
)  # fmt: skip
#: Those that are maps, not pictures.
MAP_OUTPUTS = ("shadow_maps", "moments")
DEFAULT_OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps")


class Pass(NamedTuple):
    """One pass of a frame; `cascade` is None unless it belongs to one."""

    name: str
    cascade: int | None
    program: int


class Texture(NamedTuple):
    """One texture of a frame."""

    name: str
    format: str
    width: int
    height: int
    layers: int
    samples: int
    levels: int
    bytes: int


@dataclass(frozen=True)
class Plan:
    """Passes in order, textures, and the programs they need.

    Attributes
    ----------
    passes : tuple of (name, cascade, program)
    textures : tuple of (name, format, width, height, layers, samples, levels, bytes)
    programs : tuple of (pass name, key)
        Equal keys are one compiled program.
    bytes : int
        Of all textures, and of the buffers that images come back in.
    """

    passes: tuple[Pass, ...]
    textures: tuple[Texture, ...]
    programs: tuple[tuple[str, int], ...]
    bytes: int

    def __str__(self):
        lines = [f"{len(self.passes)} passes, {len(self.programs)} programs, {self.bytes:,} bytes"]
        for step in self.passes:
            place = "" if step.cascade is None else f" cascade {step.cascade}"
            lines.append(f"  pass     {step.name}{place}")
        for texture in self.textures:
            size = f"{texture.width} x {texture.height} x {texture.layers}"
            what = f"{texture.name} {texture.format} {size}"
            what += f", {texture.samples} samples" if texture.samples > 1 else ""
            what += f", {texture.levels} levels" if texture.levels > 1 else ""
            lines.append(f"  texture  {what}: {texture.bytes:,} bytes")
        buffers = self.bytes - sum(texture.bytes for texture in self.textures)
        if buffers:
            lines.append(f"  buffers  {buffers:,} bytes")
        return "\n".join(lines)


def output_bits(outputs, points=False):
    """Bit set of output names for the core.

    Parameters
    ----------
    outputs : sequence of str
        Names of `OUTPUTS`.
    points : bool
        Whether visibility at points is asked for too.

    Returns
    -------
    bits : int
    names : tuple of str
        `outputs`, which may be an iterator, kept.

    Raises
    ------
    TypeError, ValueError
        If `outputs` is a string, empty without points, or names what does not exist.
    """
    if isinstance(outputs, str):
        raise TypeError(f"outputs must be a sequence of names (got the string {outputs!r})")
    try:
        names = tuple(outputs)
    except TypeError:
        raise TypeError(f"outputs must be a sequence of names (got {outputs!r})") from None
    bits = _core.OUTPUTS["points"] if points else 0
    for name in names:
        if name not in OUTPUTS:
            raise ValueError(f"outputs may name {', '.join(OUTPUTS)} (got {name!r})")
        bits |= _core.OUTPUTS[name]
    if not bits:
        raise ValueError("outputs must name at least one output (got none)")
    return bits, names


def plan(
    settings, *, size=(1920, 1080), outputs=DEFAULT_OUTPUTS, instanced=False, alpha_tested=False
):
    """What rendering with these settings runs and holds; needs no OpenGL.

    Parameters
    ----------
    settings : ShadowSettings
    size : (int, int)
        Width and height of the camera in pixels.
    outputs : sequence of str
        As for `Renderer.render`.
    instanced : bool
        Whether the scene draws a mesh more than once: pixels then name their instance too.
    alpha_tested : bool
        Whether a mesh of the scene has a cut-out: the passes that draw then look it up.

    Returns
    -------
    plan : Plan
        Printable.

    Raises
    ------
    TypeError, ValueError
        If a value breaks its rule.

    Examples
    --------
    >>> import csm
    >>> print(csm.plan(csm.ShadowSettings(filter="none"), outputs=("mask",)))
    2 passes, 2 programs, 24,883,200 bytes
      pass     view
      pass     shadow_mask
      texture  view_ids r32ui 1920 x 1080 x 1: 8,294,400 bytes
      texture  view_depth d32f 1920 x 1080 x 1: 8,294,400 bytes
      buffers  8,294,400 bytes
    """
    check_kinds(settings=settings)
    bits, _ = output_bits(outputs)
    steps, textures, programs, total = _core.plan(
        settings, *checked_size(size), bits, bool(instanced), bool(alpha_tested)
    )
    return Plan(
        tuple(Pass(name, None if cascade < 0 else cascade, key) for name, cascade, key in steps),
        tuple(Texture(*texture) for texture in textures),
        tuple(programs),
        total,
    )


def map_bytes(settings):
    """Bytes of shadow maps, of moments and of what makes them, whatever the picture's size.

    Parameters
    ----------
    settings : ShadowSettings

    Returns
    -------
    bytes : int
    """
    return sum(
        texture.bytes
        for texture in plan(settings, outputs=("mask",)).textures
        if not texture.name.startswith("view_")
    )
