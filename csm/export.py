"""The nearest settings of other engines, and what has no counterpart there."""

from dataclasses import dataclass, field, fields

import numpy as np

from .cascades import check_kinds, fit_cascades
from .decisions import TABLE
from .engine_rows import BLEND, SPLITS, Near, held
from .engine_windows import EngineWindows
from .engines_desktop import GODOT, UNITY
from .engines_native import FILAMENT, UNREAL
from .engines_web import BABYLON, THREE
from .formats import write_file
from .settings import ShadowSettings

__all__ = ["ENGINES", "Exported", "Quantity", "export_settings"]

#: The engines by name.
ENGINES = {
    "threejs": THREE,
    "babylon": BABYLON,
    "godot": GODOT,
    "unity": UNITY,
    "unreal": UNREAL,
    "filament": FILAMENT,
}
SEEN = ("sdsm", "histogram")  # splits that are fitted to what is seen
ROUND = ("sphere", "shifted")  # fits for which splits of equal resolution are cut by spheres
# What means nothing with a single cascade.
OF_SEVERAL = ("select", *SPLITS, *BLEND)
WITH_TAPS = ("poisson", "pcss")  # filters that draw taps in a disc
ALL_OF_THEM = {field.name: field.default for field in fields(ShadowSettings)}


@dataclass(frozen=True)
class Quantity:
    """A value of an engine's setting.

    Attributes
    ----------
    value : bool, int, float, str or list
    unit : str
        "" where it has none.
    of : tuple of str
        The settings of ours that it stands for.
    page : str
        Where the engine documents it.
    """

    value: object
    unit: str
    of: tuple[str, ...]
    page: str

    def __str__(self):
        def text(value):
            if isinstance(value, list):
                return f"({', '.join(map(text, value))})"
            return f"{value:.6g}" if isinstance(value, float) else str(value)

        return f"{text(self.value)} [{self.unit}]" if self.unit else text(self.value)


@dataclass(frozen=True)
class Exported:
    """Settings of an engine. Prints as a table that a person reads.

    Every decision of `csm.decisions.TABLE`, and every other setting that is not at its default, is
    told of in one of these.

    Attributes
    ----------
    engine : str
    title : str
        The engine and the part of it that is meant.
    settings : dict of str to Quantity
        By the engine's names.
    rounded : dict of str to str
        By our names: what could not be had exactly, and by how much it is off.
    built_in : dict of str to str
        By our names: what the engine does in this one way, without a setting.
    missing : dict of str to str
        By our names: what has no counterpart, and what the engine does instead.
    texels : tuple of float
        Longer side of a texel of each of the engine's cascades [m], of windows as it fits them.
    text : str
        To be pasted; what is rounded and missing stands in it as comments.
    """

    engine: str
    title: str
    settings: dict
    rounded: dict
    built_in: dict
    missing: dict
    texels: tuple[float, ...]
    text: str = field(repr=False)

    def __str__(self):
        lines = [self.title, ""]
        lines += _columns([(name, str(one)) for name, one in self.settings.items()])
        if self.texels:
            lines += ["", f"texels there: {_metres(self.texels)}"]
        for head, told in (
            ("rounded", self.rounded),
            ("done so without a setting", self.built_in),
            ("no counterpart", self.missing),
        ):
            if told:
                lines += ["", f"{head}:", *_columns(list(told.items()), "  ")]
        return "\n".join(lines)

    def to_dict(self):
        """Return everything as plain values, ready for JSON; settings as value and unit."""
        settings = {
            name: {"value": one.value, "unit": one.unit, "page": one.page}
            for name, one in self.settings.items()
        }
        return {**vars(self), "settings": settings}

    def write(self, path):
        """Write the text to be pasted to a file.

        Parameters
        ----------
        path : path_like

        Raises
        ------
        OSError
            If it cannot be written.
        """
        write_file(path, self.text)


def export_settings(settings, engine, *, camera, sun, scene=None, splits=None, texels=None):
    """Nearest settings of an engine, and what has no counterpart there.

    Distances become shares of the engine's range, sizes what its maps can have, and biases what
    its own windows and its own filter need, in its own unit. Names, units and limits are those of
    the engine's public documentation; docs/export.md has the table.

    Parameters
    ----------
    settings : ShadowSettings
    engine : {"threejs", "babylon", "godot", "unity", "unreal", "filament"}
    camera : Camera
        Its near and far are taken to be those of the engine's camera.
    sun : Sun
    scene : Scene, optional
        Its bounds end the range of ``view_range="scene"`` and say how far casters reach.
    splits : (n + 1,) array_like, optional
        View depths [m] of the cascades, as in `Cascades.splits` of a frame: needed for splits that
        are fitted to what is seen.
    texels : (n,) array_like, optional
        Longer side of a texel of each cascade [m], as in ``Cascades.texel_size.max(axis=1)``: to
        tell how much coarser or finer the engine's windows are.

    Returns
    -------
    exported : Exported

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, there is no such engine, splits are needed, or the
        camera's near is not positive. Without shadows (``filter="none"``) neither counts: all that
        is written then is what switches this light's off.

    Examples
    --------
    >>> camera, sun = Camera.look_at((0, 2, 9), (0, 1, 0)), Sun((1, 2, 1))
    >>> export_settings(ShadowSettings(), "unity", camera=camera, sun=sun).settings[
    ...     "shadowCascadeCount"
    ... ].value
    4
    """
    check_kinds(settings=settings, camera=camera, sun=sun)
    if engine not in ENGINES:
        raise ValueError(f"engine must be one of {', '.join(ENGINES)} (got {engine!r})")
    canonical = settings.canonical()
    if canonical.filter == "none":
        return _switched_off(engine, ENGINES[engine], canonical)
    if camera.near <= 0.0:
        raise ValueError(
            "camera must have near > 0, where the shadow ranges of engines begin "
            f"(got near {camera.near:g})"
        )
    splits = _splits(canonical, camera, sun, scene, splits)
    texels = _texels(texels, len(splits) - 1)
    row = ENGINES[engine]
    return _exported(engine, row, EngineWindows(row, canonical, camera, sun, scene, splits, texels))


def _texels(texels, count):
    if texels is None:
        return ()
    given = np.asarray(texels, np.float64)
    if given.shape != (count,) or not (np.isfinite(given) & (given >= 0.0)).all():
        raise ValueError(
            f"texels must be {count} lengths [m], one a cascade (got {given.tolist()})"
        )
    return tuple(given.tolist())


def _splits(settings, camera, sun, scene, splits):
    """Split distances of the settings, given or fitted."""
    if splits is None:
        if settings.split in SEEN:
            raise ValueError(
                f"split={settings.split!r} is fitted to what is seen: give splits=, for example "
                "those of a frame, frame.cascades.splits"
            )
        # windows to which splits are the same, but that nothing needs to be seen for
        if settings.split == "resolution":  # asks for sizes and for borders
            changes = {"fit": settings.fit if settings.fit in ROUND else "diameter"}
        else:  # for which small maps may have no room
            changes = {"fit": "sphere", "map_size": ShadowSettings().map_size, "filter": "hard"}
        plain = settings.replace(turned=False, warp="none", **changes)
        return fit_cascades(camera, sun, plain, scene=scene).splits
    splits = np.asarray(splits, np.float64)
    wanted = settings.cascade_count + 1
    if splits.shape != (wanted,) or not np.isfinite(splits).all() or (np.diff(splits) <= 0).any():
        raise ValueError(
            f"splits must be {wanted} ascending view depths [m], one more than cascades "
            f"(got {splits.tolist()})"
        )
    if splits[-1] <= camera.near:
        raise ValueError(f"splits must end beyond the camera's near (got {splits.tolist()})")
    return splits


def _switched_off(name, engine, canonical):
    """What switches the light's shadows off, and nothing else: the rest stays the project's."""
    row = engine.off
    value = row.value(None)
    settings = {row.name: Quantity(value, row.unit, row.of, row.page)}
    names = [one.effect for one in TABLE]
    names += [n for n, usual in ALL_OF_THEM.items() if getattr(canonical, n) != usual]
    not_needed = {n: "no shadows: not needed" for n in dict.fromkeys(names) if n not in row.of}
    exported = Exported(name, engine.title, settings, {}, not_needed, {}, (), "")
    about = [f"{engine.title}, from csm", "no shadows: only this light is changed"]
    lines = [f"{engine.comment} {one}" for one in (*about, engine.off_about)]
    lines.append(row.code.replace("$", _literal(value, engine)))
    object.__setattr__(exported, "text", "\n".join(lines) + "\n")
    return exported


def _exported(name, engine, at):
    """Ask every row."""
    settings, rounded, lines = {}, {}, {}
    for row in engine.settings:
        value = row.value(at)
        if value is None:
            continue
        about, told = row.of[0] if row.of else None, []
        if isinstance(value, Near):
            about, told, value = value.of or about, [value.note], value.value
        value, note = held(value, row.limits, row.name)
        told += [] if note is None else [note]
        for note in told:
            notes = rounded.setdefault(about, [])
            if note not in notes:
                notes.append(note)
        settings[row.name] = Quantity(value, row.unit, row.of, row.page)
        line = row.code.replace("$", _literal(value, engine))
        lines.setdefault(row.place, []).append(line)
    if at.negative_bias:
        rounded.setdefault("bias", []).insert(0, at.negative_bias)
    rounded = {about: "; ".join(notes) for about, notes in rounded.items()}
    built_in, missing = _without_setting(engine, at, settings)
    texels = tuple(at.texels.tolist())
    exported = Exported(name, engine.title, settings, rounded, built_in, missing, texels, "")
    object.__setattr__(exported, "text", _snippet(engine, exported, lines))
    return exported


def _without_setting(engine, at, settings):
    """What is done in one way only, and what has no counterpart; by our names."""
    told = {name for one in settings.values() for name in one.of}
    built_in, missing = {}, {}
    for row in engine.fixed:
        if at.ours == 1 and at.count == 1 and row.of in OF_SEVERAL:
            built_in[row.of] = "one cascade: nothing to choose"
        elif getattr(at.settings, row.of) in (row.same(at) if callable(row.same) else row.same):
            built_in[row.of] = row.text
        else:
            missing[row.of] = f"{getattr(at.settings, row.of)}: {row.text}"
            if row.of == "fit" and at.our_texels:
                there, here = _metres(at.texels), _metres(at.our_texels)
                missing["fit"] += f"; texels of {there} instead of {here}"
    names = [row.effect for row in TABLE]
    names += [n for n, usual in ALL_OF_THEM.items() if getattr(at.settings, n) != usual]
    for name in dict.fromkeys(names):
        if name in told or name in built_in or name in missing:
            continue
        if at.ours == 1 and name in OF_SEVERAL:
            built_in[name] = "one cascade: nothing to choose"
        elif name == "tap_count" and at.settings.filter not in WITH_TAPS:
            built_in[name] = f"{at.settings.filter}: no taps"
        else:
            missing[name] = f"{getattr(at.settings, name)}: no setting for it"
    return built_in, missing


def _literal(value, engine):
    """Write a value as the engine's language has it."""
    if isinstance(value, bool):
        return engine.true if value else engine.false
    if isinstance(value, list):
        left, right = engine.brackets
        return f"{left}{', '.join(_literal(one, engine) for one in value)}{right}"
    if isinstance(value, float):
        text = repr(float(f"{value:.9g}"))  # the digits of a float32
        return f"{text}{engine.suffix}"
    return str(value)


def _snippet(engine, exported, lines):
    """Text to paste: comments, then the template with its lines."""
    about = [f"{exported.title}, from csm"]
    for head, told in (("rounded", exported.rounded), ("no counterpart", exported.missing)):
        about += [f"{head}: {name}: {text}" for name, text in told.items()]
    made = [f"{engine.comment} {one}" for one in about]
    for line in engine.template.splitlines():
        stripped = line.lstrip()
        if stripped.startswith("@"):
            indent = line[: len(line) - len(stripped)]
            made += [f"{indent}{one}" for one in lines.get(int(stripped[1:]), [])]
        else:
            made.append(line)
    return "\n".join(made) + "\n"


def _metres(lengths):
    return f"{', '.join(f'{one:.3g}' for one in lengths)} m"


def _columns(rows, indent=""):
    width = max((len(name) for name, _ in rows), default=0)
    return [f"{indent}{name:{width}}  {text}" for name, text in rows]
