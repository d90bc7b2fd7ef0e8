"""The settings of a render: every choice, with its default, checked when it is made."""

import math
from dataclasses import asdict, dataclass, fields, replace

import numpy as np

from . import _core

__all__ = ["ShadowSettings"]


@dataclass(frozen=True)
class ShadowSettings:
    """How shadows are made. Frozen; `replace` makes a changed copy.

    Lengths in texels are texels of the cascade they apply to. A setting that means nothing under
    another choice (``lam`` under ``split="uniform"``) is checked and then ignored; `canonical`
    shows what counts.

    Parameters
    ----------
    cascade_count : int
        1 to 8.
    map_size : int or tuple of int
        Texels along a side of a shadow map, for all cascades or one per cascade. Maps are layers of
        one array of the largest size, so that a smaller map takes as many bytes.
    split : {"practical", "uniform", "logarithmic", "manual", "resolution", "sdsm", "percentages", \
"histogram"}
        How the view range is cut. ``"uniform"``: equal lengths; ``"logarithmic"``: equal ratios;
        ``"practical"``: their mean weighted by `lam` [Zhang2006]_. ``"manual"`` and
        ``"percentages"`` [MSDN]_: `manual_splits`. ``"resolution"`` [Stone]_: texels are equally
        many pixels at the near end of every cascade, also where map sizes differ; with equal sizes
        that is the logarithmic scheme. ``"sdsm"`` [Lauritzen2011]_: the practical scheme within
        the depths of what is seen and faces the sun; ``"histogram"``: as much of it in every
        cascade. Both hold their steps from frame to frame, so that they do not flicker. What
        divides by depth needs a camera with near > 0: practical and sdsm with `lam` > 0, and
        logarithmic.
    lam : float
        Weight of the logarithmic scheme in ``"practical"`` and ``"sdsm"``, 0 to 1.
    manual_splits : tuple of float
        The ``cascade_count - 1`` inner view depths [m] of ``split="manual"``, or percents of the
        view range of ``"percentages"`` (0 at near, 100 at its far), ascending.
    first_split : float
        View depth [m] where the first cascade ends [Stone]_, the scheme dividing the rest; 0: where
        the scheme has it. It must lie within the camera's range and `max_distance`. A nearer scene
        does not move it; where ``"sdsm"`` and ``"histogram"`` see nothing on one side of it, they
        do without. Not for splits by hand.
    max_distance : float
        Farthest view depth [m] that has shadows, beyond which all is lit and belongs to no
        cascade; 0: the camera's far. `view_range` may end it earlier.
    view_range : {"scene", "camera"}
        ``"scene"`` cuts far to the scene's bounds, rounded up to ``near * 2**(k / 4)`` so that
        texel sizes stay constant while the camera moves, but not below distances set by hand.
    fit : {"sphere", "box", "diameter", "scene", "shifted", "visible", "clipped", "focus"}
        How a light window is fitted to its slice of the view. Rigid sizes: the slice's smallest
        ``"sphere"`` [Valient2008]_; a square of its ``"diameter"``; ``"shifted"``, the sphere moved
        along the view as far as no gap opens [Sylvan]_: possible only where
        ``k**2 > (far - near) / (far + near)`` of the slice, a condition that the source does not
        state, k being the slope of a corner ray; for slices that maps share, so with
        ``select="interval"`` or a warp it is ``"sphere"``, as it is for orthographic cameras.
        Sizes that change with the view: ``"box"``, the slice's light-space box; ``"scene"``, that
        of all from near to the slice's end [MSDN]_; ``"clipped"``, that of the slice cut to the
        scene's bounds [Stone]_; ``"focus"``, that again cut to the parts of the scene in it;
        ``"visible"``, round what is seen. docs/numerics.md 4, 5, 20 and 22.
    turned : bool
        Windows of ``fit="visible"`` turned to the rectangle of smallest area; not snapped then, and
        the light basis is orthonormal. Means nothing for other fits and under a warp.
    light_basis : {"orthonormal", "world", "transported"}
        Axes of light space: from the sun's direction alone; skewed along the world's axes, so that
        the grid on the ground does not move with the sun [theomader] [Stone], orthonormal where
        the sun is below 20.7 degrees; or carried on from the frame before. The listing of
        [theomader] quantises by ``1 / W`` instead of W over the texels, adds the width to the
        upper end and anchors the grid at the moving light (docs/numerics.md 18).
        Means nothing under a warp and for `turned` windows.
    sun_step_deg : float
        The maps' sun moves in steps of this [degrees], 0 to 90; 0: with the sun.
    snap : {"exact", "none", "approximate"}
        ``"exact"`` puts windows on a texel lattice fixed in the world. ``"approximate"`` does so
        with few window sizes, for windows that change with the view [Zhang2009]; its listing 4.1.2
        rounds offsets up without a margin and loses up to a texel (docs/numerics.md 19).
    level_spacing : {"linear", "geometric"}
        How the window sizes of ``snap="approximate"`` are spaced.
    level_count : int
        Number of those sizes, 1 to 4096. Like the spacing, for ``snap="approximate"`` alone.
    level_hysteresis : int
        Levels by which a held size may be too large, 0 to 16.
    warp : {"none", "lispsm", "psm", "tsm"}
        Perspective warp of the light windows: light space perspective [Wimmer2004]_, perspective
        [Stamminger2002]_ or trapezoidal [Martin2004]_ shadow maps, for each cascade. Nothing is
        snapped under a warp, and depths are post-projective. It bounds the worst texel of a
        slice, so a near plane far before the nearest surface wastes most of a map.
    select : {"map", "interval", "frustum"}
        The first map that holds the point with its kernel, the cascade whose view depths hold it,
        or the first light frustum that holds the point itself [Sylvan]_: without a kernel the same
        as ``"map"``.
    texcoord : {"position", "interpolated"}
        Light coordinates from the receiver's position, or interpolated from its vertices.
    cull : {"inclusive", "none", "exclusive"}
        Draw only casters that can reach what the camera sees; ``"exclusive"`` leaves out also what
        lies wholly under a finer map's window [Stone]_; inclusive under ``select="interval"``,
        `pancake`, ``depth_range="window"``, a warp or a single cascade. Changes no mask.
    depth_range : {"scene", "window", "manual"}
        Near and far of the maps, modes of [MSDN]: of the scene's box; of its part within the light
        frustum; or given, where casters outside are lost and receivers outside are in no map.
        Means nothing under `pancake`.
    manual_depth_range : tuple of float
        Light-view depths [m] of clip z 0 and 1 under ``depth_range="manual"``.
    pancake : bool
        Depth range of the slice alone; casters before it are flattened onto its near plane
        (pancaking, the fourth mode of [MSDN]).
    depth_format : {"d32f", "d24", "d16"}
    filter : {"hard", "none", "pcf"}
        One nearest compare; no shadow maps at all; percentage-closer filtering [Reeves1987]_.
    filter_size : int
        Side of the pcf kernel: odd, up to 33, or 2 for the hardware's bilinear compare.
    bias : {"auto", "manual"}
        ``"auto"``: receiver plane at each texel's centre, plus a quarter texel of slope, a
        depth quantum and the rounding of float32. ``"manual"``: the four settings below, which
        start at zero: with none of them set, tilted surfaces show acne.
    constant_bias_texels, slope_bias : float
        Depth bias along the light, ``t * (constant + slope_bias * (|gx| + |gy|))`` [m] with t the
        larger texel side [m] and g the receiver's depth gradient; positive lightens.
    normal_offset_texels : float
        The receiver is moved by this times ``t * sin(theta)`` along its normal.
    receiver_plane : bool
        Compare against the receiver's plane at each texel's centre. Not with ``filter_size=2``,
        where the hardware compares four texels with one depth.

    Raises
    ------
    TypeError, ValueError
        If a value breaks its rule; the text names every one that does.

    References
    ----------
    .. [Zhang2006] Zhang, Sun, Xu, Lun: Parallel-split shadow maps for large-scale virtual
       environments. VRCIA 2006. doi:10.1145/1128923.1128975
    .. [MSDN] Microsoft: Cascaded Shadow Maps. DirectX technical articles.
    .. [Stone] Stone: Cascaded perspective variance shadow mapping. Web article.
    .. [Lauritzen2011] Lauritzen, Salvi, Lefohn: Sample distribution shadow maps. I3D 2011.
       doi:10.1145/1944745.1944761
    .. [Wimmer2004] Wimmer, Scherzer, Purgathofer: Light space perspective shadow maps. Eurographics
       Symposium on Rendering 2004.
    .. [Stamminger2002] Stamminger, Drettakis: Perspective shadow maps. SIGGRAPH 2002.
       doi:10.1145/566654.566616
    .. [Martin2004] Martin, Tan: Anti-aliasing and continuity with trapezoidal shadow maps.
       Eurographics Symposium on Rendering 2004.
    .. [Valient2008] Valient: Stable rendering of cascaded shadow maps. ShaderX6, 2008.
    .. [Sylvan] Sylvan: Improving shadow map utilization for cascaded shadow maps. Web article.
    .. [Reeves1987] Reeves, Salesin, Cook: Rendering antialiased shadows with depth maps.
       SIGGRAPH 1987. doi:10.1145/37402.37435

    Examples
    --------
    >>> ShadowSettings(filter="pcf", filter_size=5).replace(map_size=1024).map_size
    1024
    """

    cascade_count: int = 4
    map_size: int | tuple[int, ...] = 2048
    split: str = "practical"
    lam: float = 0.5
    manual_splits: tuple[float, ...] = ()
    first_split: float = 0.0
    max_distance: float = 0.0
    view_range: str = "scene"
    fit: str = "sphere"
    turned: bool = False
    light_basis: str = "orthonormal"
    sun_step_deg: float = 0.0
    snap: str = "exact"
    level_spacing: str = "linear"
    level_count: int = 64
    level_hysteresis: int = 0
    warp: str = "none"
    select: str = "map"
    texcoord: str = "position"
    cull: str = "inclusive"
    depth_range: str = "scene"
    manual_depth_range: tuple[float, ...] = ()
    pancake: bool = False
    depth_format: str = "d32f"
    filter: str = "hard"
    filter_size: int = 3
    bias: str = "auto"
    constant_bias_texels: float = 0.0
    slope_bias: float = 0.0
    normal_offset_texels: float = 0.0
    receiver_plane: bool = False

    def __post_init__(self):
        put = object.__setattr__.__get__(self)
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "map_size":
                put("map_size", _map_size(value, self.cascade_count))
            elif field.name in ("manual_splits", "manual_depth_range"):
                put(field.name, _depths(field.name, value))
            elif field.type is float:
                put(field.name, _number(field.name, value))
            elif field.type is int:
                put(field.name, _whole(field.name, value))
            elif field.type is bool:
                if not isinstance(value, bool | np.bool_ | int) or value not in (0, 1):
                    raise TypeError(f"{field.name} must be True or False (got {value!r})")
                put(field.name, bool(value))
            elif not isinstance(value, str):
                raise TypeError(f"{field.name} must be a string (got {value!r})")
        by_hand = {"manual": "inner view depths [m]", "percentages": "percents of the view range"}
        if self.split in by_hand and len(self.manual_splits) != self.cascade_count - 1:
            raise ValueError(
                f"manual_splits must be the {self.cascade_count - 1} {by_hand[self.split]} of "
                f"{self.cascade_count} cascades (got {len(self.manual_splits)})"
            )
        if self.depth_range == "manual" and len(self.manual_depth_range) != 2:
            raise ValueError(
                "manual_depth_range must be (near, far), light-view depths [m] "
                f"(got {self.manual_depth_range})"
            )
        _core.validate_settings(self)

    def replace(self, **changes):
        """Copy with other values.

        Parameters
        ----------
        **changes
            Settings by name.

        Returns
        -------
        settings : ShadowSettings

        Raises
        ------
        TypeError, ValueError
            If a name is no setting or a value breaks its rule.
        """
        known = {field.name for field in fields(self)}
        for name in changes:
            if name not in known:
                raise TypeError(f"{name!r} is no setting; there are {', '.join(sorted(known))}")
        if "cascade_count" in changes and isinstance(self.map_size, tuple):
            changes.setdefault("map_size", _resized(self.map_size, changes["cascade_count"]))
        return replace(self, **changes)

    def to_dict(self):
        """Every setting by name: plain values, ready for JSON.

        Returns
        -------
        settings : dict
        """
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    def canonical(self):
        """Copy with what has no meaning at its default, so that equal pictures compare equal.

        Returns
        -------
        settings : ShadowSettings
        """
        values = _core.canonical_settings(self)
        sizes = tuple(int(size) for size in values["map_size"])
        values["map_size"] = sizes[0] if len(set(sizes)) == 1 else sizes
        return ShadowSettings(**values)


def _number(name, value):
    if isinstance(value, bool | str | bytes):
        raise TypeError(f"{name} must be a number (got {value!r})")
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a number (got {value!r})") from None
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite (got {value!r})")
    return number


def _whole(name, value):
    if isinstance(value, bool | str | bytes):
        raise TypeError(f"{name} must be a whole number (got {value!r})")
    try:
        number = int(value)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name} must be a whole number (got {value!r})") from None
    if number != value:
        raise ValueError(f"{name} must be a whole number (got {value!r})")
    if not -(2**31) <= number < 2**31:
        raise ValueError(f"{name} must fit 32 bits (got {value!r})")
    return number


def _depths(name, value):
    if isinstance(value, str | bytes) or not np.iterable(value):
        raise TypeError(f"{name} must be a sequence of depths [m] (got {value!r})")
    return tuple(_number(name, item) for item in value)


def _map_size(value, cascade_count):
    if isinstance(value, str | bytes) or not np.iterable(value):
        return _whole("map_size", value)
    sizes = tuple(_whole("map_size", size) for size in value)
    if len(sizes) != cascade_count:
        raise ValueError(
            f"map_size must be one number, or one for each of {cascade_count} cascades "
            f"(got {len(sizes)})"
        )
    return sizes


def _resized(sizes, count):
    """Sizes for another number of cascades: cut, or the last repeated."""
    return sizes[:count] + sizes[-1:] * (count - len(sizes))
