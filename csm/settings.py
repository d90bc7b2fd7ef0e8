"""The settings of a render: every choice, with its default, checked when it is made."""

import math
from dataclasses import dataclass, fields

import numpy as np

from . import _core
from .formats import Recorded, check_keys

__all__ = ["ShadowSettings", "map_sizes"]


@dataclass(frozen=True)
class ShadowSettings(Recorded):
    """How shadows are made. Frozen; `replace` makes a changed copy.

    Lengths in texels are texels of the cascade they apply to. A setting that means nothing under
    another choice (``lam`` under ``split="uniform"``) is checked and then ignored; `canonical`
    shows what counts. `to_json`, `to_toml` and `save` write every setting, `from_json`,
    `from_toml` and `load` make equal ones of it, bit for bit.

    Parameters
    ----------
    cascade_count : int
        1 to 8.
    map_size : int or tuple of int
        Texels along a side of a shadow map, for all cascades or one per cascade. In an array
        (`storage`) a smaller map takes as many bytes as the largest.
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
    storage : {"array", "atlas", "separate", "cube"}
        Layers of one array, as large as the largest map; tiles of one texture; a texture each;
        faces of a cube, for up to six maps of one size. Prefiltered filters make their moments
        from maps stored so, and keep the moments in an array.
    tile_border : int
        Empty texels around each tile of an atlas, 0 to 64. No lookup here needs them: none leaves
        its tile.
    copied_tiles : bool
        Tiles of an atlas are drawn on their own and copied, so that they are those of an array to
        the bit; drawn in place, a rasteriser may round corners otherwise.
    reversed_depth : bool
        Maps hold 1 at the caster side and 0 far away. A `Frame`'s `shadow_maps` have 0 at the
        caster side all the same.
    caster_faces : {"both", "front", "back"}
        Which sides of triangles cast, counter-clockwise being the front, in mirroring instances
        too. Closed solids cast the same shadow by their backs, which need no bias on what the sun
        sees and leak along the foot where they stand (docs/numerics.md 30).
    filter : {"hard", "none", "pcf", "poisson", "vsm", "evsm2", "evsm4", "esm", "msm", "lvsm", \
"savsm", "fourier", "pcss"}
        ``"hard"``: one nearest compare. ``"none"``: no shadow maps at all. ``"pcf"``:
        percentage-closer filtering [Reeves1987]_; ``"poisson"``: the same with taps in a disc.
        Prefiltered: variance ``"vsm"`` [Donnelly2006]_, exponential variance of two and four
        moments ``"evsm2"`` ``"evsm4"`` [Lauritzen2008]_, exponential ``"esm"`` [Annen2008]_,
        moment ``"msm"`` [Peters2015]_, layered variance ``"lvsm"`` [Lauritzen2008]_, summed-area
        variance ``"savsm"`` [Lauritzen2007]_, convolution ``"fourier"`` [Annen2007]_.
        ``"pcss"``: percentage-closer soft shadows [Fernando2005]_, the penumbra of the sun's
        angular diameter, as far as `filter_size` texels hold it: three by default, so give more.
    filter_size : int
        Side of the kernel, of the blur or of the disc in texels: odd, up to 65, or for pcf 2, the
        hardware's bilinear compare. For pcss the widest penumbra that is searched and filtered.
    filter_weights : {"box", "bilinear", "tent", "gaussian"}
        Weights of pcf's kernel and of the blur. ``"box"`` is centred on the texel that holds the
        point, the others on the point itself; ``"bilinear"`` is a mean of bilinear lookups, a box
        narrower by a texel; ``"gaussian"`` ends at two standard deviations, where it is 0.
    filter_fetch : {"gather", "taps"}
        pcf: depths come four at a time, or one by one; the same mask.
    kernel : {"texels", "world", "screen"}
        What stays the same from cascade to cascade: the kernel's side in texels; in metres, that of
        `filter_size` texels of the first cascade [Zhang2009], but never more texels; or in pixels
        at the receiver's depth, again never more texels than `filter_size`. A blurred map has one
        kernel for all pixels, so ``"screen"`` means ``"texels"`` there.
    disc : {"poisson", "vogel"}
        How taps of poisson and pcss lie in their disc: a fixed set of points kept apart
        [Mitchell1991]_, or Vogel's spiral [Vogel1979]_.
    tap_count : int
        Taps in the disc, 1 to 64; those of disc poisson are 8 or 16. pcss takes as many for its
        search and one more.
    rotated : bool
        The disc is turned from pixel to pixel by interleaved gradient noise [Jimenez2014]_.
    pcss_map : {"depth", "variance", "summed"}
        Blockers and penumbra from taps, from filtered moments in smaller levels [Yang2010]_, or
        from their summed areas [Lauritzen2007]_, which have any width and 32 bits. Through moments
        a penumbra costs the same however wide, and light leaks where occluders overlap.
    moment_format : {"float32", "float16", "unorm16"}
        Format of filtered maps; exponents of esm and evsm are limited by it. ``"unorm16"`` holds
        0 to 1: not for evsm, nor for esm without `log_filter`. Half floats are too coarse for
        msm's four moments, which take ``"float32"`` or ``"unorm16"``; those of vsm, lvsm and
        ``pcss_map="variance"`` leak so much in half floats that ``"unorm16"``, as small, is better.
    lookup : {"bilinear", "trilinear", "anisotropic"}
        How filtered maps are looked up: at their full size, or in smaller levels by the footprint
        of the pixel.
    anisotropy : int
        Most lookups along a footprint of ``lookup="anisotropic"``, 2 to 16.
    samples : int
        1, 2, 4 or 8 samples in a texel of the maps that moments are made from.
    exponent, negative_exponent : float
        Of depth over its range, for esm and evsm (whose warps run from -1 to 1), and of the second
        warp of evsm4. 0: nine tenths of what the format holds, under `log_filter` 640 or what it
        rounds to 5 % of light; and the same as the first. Limits of esm: 88.72 in float32, 11.08 in
        float16; of evsm half of that.
    log_filter : bool
        esm: exponents are stored and blurred instead of powers, without their limit
        [Salvi2008]_.
    msm_bound : {"hamburger", "hausdorff"}
        msm: depths may lie anywhere, or between 0 and 1, which is a sharper bound.
    layer_count : int
        Layers of lvsm, 2, 4, 6 or 8; each reaches half of its part of the range further either way.
    fourier_terms : int
        Terms of the series of fourier, an even number up to 16. Shadows begin 0.6 of the depth
        range over this behind their caster: it is a filter for short ranges.
    bleed_step, bleed_power : float
        Light of a bound that is at or below the step is taken off, and the rest is raised to the
        power: less light bleeds, and penumbrae are darker [Lauritzen2007]_.
    gradients : {"hardware", "quad", "analytic"}
        Footprint of a pixel in a filtered map: differences in its quad, each pixel in its own
        cascade, which leaves a seam; with one cascade for the quad; or those of light space, the
        same for all cascades [Zhang2009].
    plane : {"normal", "derivatives"}
        The receiver's plane from its triangle, or from differences in the quad of pixels [MSDN],
        which goes wrong along outlines: two to three times the error of a hard mask in a town.
    blend : {"none", "linear", "smooth", "dither"}
        Transition to the next cascade, where that holds the point with its kernel: weighted, with
        a smooth weight, or by lot (interleaved gradient noise [Jimenez2014]_).
    blend_width : float
        Width of the transition, 0 to 1: share of half a map, under ``select="interval"`` of the
        slice. Narrower where two maps overlap less: windows of ``fit="sphere"`` and ``"diameter"``
        overlap much, those of ``"box"`` hardly.
    fade_width : float
        Share of the shadow range over which shadows fade at its end, 0 to 1; at the last split
        they are gone.
    bias : {"auto", "manual"}
        ``"auto"``: receiver plane at each texel's centre, plus a quarter texel of slope, a
        depth quantum and the rounding of float32. ``"manual"``: the five settings below, which
        start at zero: with none of them set, tilted surfaces show acne.
    bias_side : {"receiver", "caster"}
        Constant and slope bias lift receivers in the mask, or push casters back in the maps. There
        the slope is the rasteriser's, max(|gx|, |gy|) of the caster, down to half of |gx| + |gy|.
    constant_bias_texels, slope_bias : float
        Depth bias along the light, ``t * (constant + slope_bias * (|gx| + |gy|))`` [m] with t the
        larger texel side [m] and g the receiver's depth gradient; positive lightens.
    normal_offset_texels : float
        The receiver is moved by this times ``t * sin(theta)`` along its normal.
    receiver_plane : bool
        Compare against the receiver's plane at each texel's centre. Means nothing with
        ``filter_size=2``, where the hardware compares four texels with one depth, nor for filters
        of moments other than evsm4.

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
    .. [Donnelly2006] Donnelly, Lauritzen: Variance shadow maps. I3D 2006.
       doi:10.1145/1111411.1111440
    .. [Lauritzen2007] Lauritzen: Summed-area variance shadow maps. GPU Gems 3, chapter 8, 2007.
    .. [Lauritzen2008] Lauritzen, McCool: Layered variance shadow maps. Graphics Interface 2008.
    .. [Annen2007] Annen, Mertens, Bekaert, Seidel, Kautz: Convolution shadow maps. Eurographics
       Symposium on Rendering 2007.
    .. [Annen2008] Annen, Mertens, Seidel, Flerackers, Kautz: Exponential shadow maps. Graphics
       Interface 2008.
    .. [Salvi2008] Salvi: Rendering filtered shadows with exponential shadow maps. ShaderX6, 2008.
    .. [Peters2015] Peters, Klein: Moment shadow mapping. I3D 2015. doi:10.1145/2699276.2699277
    .. [Fernando2005] Fernando: Percentage-closer soft shadows. SIGGRAPH 2005 sketches.
       doi:10.1145/1187112.1187153
    .. [Yang2010] Yang, Dong, Feng, Seidel, Kautz: Variance soft shadow mapping. Pacific Graphics
       2010. doi:10.1111/j.1467-8659.2010.01800.x
    .. [Mitchell1991] Mitchell: Spectrally optimal sampling for distribution ray tracing. SIGGRAPH
       1991. doi:10.1145/122718.122736
    .. [Vogel1979] Vogel: A better way to construct the sunflower head. Mathematical Biosciences
       44(3-4), 1979. doi:10.1016/0025-5564(79)90080-4
    .. [Jimenez2014] Jimenez: Next generation post processing in Call of Duty: Advanced Warfare.
       SIGGRAPH 2014 course.

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
    storage: str = "array"
    tile_border: int = 0
    copied_tiles: bool = False
    reversed_depth: bool = False
    caster_faces: str = "both"
    filter: str = "hard"
    filter_size: int = 3
    filter_weights: str = "box"
    filter_fetch: str = "gather"
    kernel: str = "texels"
    disc: str = "poisson"
    tap_count: int = 16
    rotated: bool = False
    pcss_map: str = "depth"
    moment_format: str = "float32"
    lookup: str = "bilinear"
    anisotropy: int = 8
    samples: int = 1
    exponent: float = 0.0
    negative_exponent: float = 0.0
    log_filter: bool = False
    msm_bound: str = "hamburger"
    layer_count: int = 4
    fourier_terms: int = 16
    bleed_step: float = 0.0
    bleed_power: float = 1.0
    gradients: str = "hardware"
    plane: str = "normal"
    blend: str = "none"
    blend_width: float = 0.1
    fade_width: float = 0.0
    bias: str = "auto"
    bias_side: str = "receiver"
    constant_bias_texels: float = 0.0
    slope_bias: float = 0.0
    normal_offset_texels: float = 0.0
    receiver_plane: bool = False

    def __post_init__(self):
        own = self.__dict__
        self._take({name: own[name] for name in _KINDS})

    def _take(self, values):
        """Set fields to values, each checked, and then all together."""
        own = self.__dict__
        if "map_size" in values and "cascade_count" in values:  # the number before the sizes
            values = {"cascade_count": values["cascade_count"], **values}
        for name, value in values.items():
            if name == "map_size":
                own[name] = _map_size(value, self.cascade_count)
            else:
                own[name] = _CHECKS[_KINDS[name]](name, value)
        if self.split in _BY_HAND and len(self.manual_splits) != self.cascade_count - 1:
            raise ValueError(
                f"manual_splits must be the {self.cascade_count - 1} {_BY_HAND[self.split]} of "
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
            Settings by name. Another ``cascade_count`` cuts a tuple of map sizes, or repeats its
            last, unless ``map_size`` is given too.

        Returns
        -------
        settings : ShadowSettings

        Raises
        ------
        TypeError, ValueError
            If a name is no setting or a value breaks its rule.
        """
        if not changes.keys() <= _KINDS.keys():
            name = next(name for name in changes if name not in _KINDS)
            raise TypeError(f"{name!r} is no setting; there are {', '.join(sorted(_KINDS))}")
        if "cascade_count" in changes and isinstance(self.map_size, tuple):
            count = _whole("cascade_count", changes["cascade_count"])
            known = 1 <= count <= MOST_CASCADES  # of others, the check below says what is allowed
            size = _resized(self.map_size, count) if known else self.map_size[0]
            changes.setdefault("map_size", size)
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)  # what does not change was checked
        other._take(changes)
        return other

    def to_dict(self):
        """Every setting by name: plain values, ready for JSON.

        Returns
        -------
        settings : dict
        """
        values = {name: getattr(self, name) for name in _KINDS}
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()
        }

    @classmethod
    def from_dict(cls, values):
        """Settings of the values that `to_dict` gives, or some of them.

        Parameters
        ----------
        values : dict
            Settings by name; what is left out is at its default.

        Returns
        -------
        settings : ShadowSettings

        Raises
        ------
        TypeError, ValueError
            If a name is no setting or a value breaks its rule; the text names both, and what is
            allowed.
        """
        check_keys("ShadowSettings", values, [field.name for field in fields(cls)])
        return cls(**values)

    def canonical(self):
        """Copy with what has no meaning at its default, so that equal pictures compare equal.

        Returns
        -------
        settings : ShadowSettings
        """
        values = _core.canonical_settings(self)
        sizes = tuple(int(size) for size in values["map_size"])
        values["map_size"] = sizes[0] if len(set(sizes)) == 1 else sizes
        for name in ("manual_splits", "manual_depth_range"):
            values[name] = tuple(values[name])
        other = object.__new__(ShadowSettings)
        # of the core: as it takes valid settings, so it gives them
        other.__dict__.update({name: values[name] for name in _KINDS})
        return other


def changed(settings, **changes):
    """`ShadowSettings.replace` by words and numbers of a program's own, which are right.

    A search makes many settings of a few such words. Of what settings say together nothing is
    known before the core is given them, which asks about all.

    Parameters
    ----------
    settings : ShadowSettings
    **changes
        Settings by name; another ``cascade_count`` of maps of several sizes with those.

    Returns
    -------
    changed : ShadowSettings
    """
    other = object.__new__(type(settings))
    other.__dict__.update(settings.__dict__)
    other.__dict__.update(changes)
    return other


def draw_alike(one, other):
    """Whether settings are equal but for what has no meaning in them: `ShadowSettings.canonical`.

    Parameters
    ----------
    one, other : ShadowSettings

    Returns
    -------
    alike : bool
    """
    return _core.settings_draw_alike(one, other)


MOST_CASCADES = 8
#: What a bias by hand is made of.
MANUAL_BIASES = ("constant_bias_texels", "slope_bias", "normal_offset_texels")
_KINDS = {field.name: field.type for field in fields(ShadowSettings)}
#: Splits that are given, and as what.
_BY_HAND = {"manual": "inner view depths [m]", "percentages": "percents of the view range"}
_NO_NUMBERS = (bool, str, bytes)  # that int and float would take


def _number(name, value):
    if isinstance(value, _NO_NUMBERS):
        raise TypeError(f"{name} must be a number (got {value!r})")
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a number (got {value!r})") from None
    except OverflowError:  # a whole number without a float
        raise ValueError(f"{name} must be finite (got one of more than 300 digits)") from None
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite (got {value!r})")
    return number + 0.0  # no zero has a sign: equal settings are equal to the bit


def _whole(name, value):
    if isinstance(value, _NO_NUMBERS):
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


def _truth(name, value):
    if not isinstance(value, bool | np.bool_ | int) or value not in (0, 1):
        raise TypeError(f"{name} must be True or False (got {value!r})")
    return bool(value)


def _word(name, value):
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a string (got {value!r})")
    return str.__str__(value)  # of numpy's and other kinds the plain one


#: What makes a value of a field's kind its own, or refuses it.
_CHECKS = {int: _whole, float: _number, bool: _truth, str: _word, tuple[float, ...]: _depths}


def map_sizes(settings):
    """Texels along a side of each cascade's map, (n,) tuple of int, however they were given."""
    sizes = settings.map_size
    return (sizes,) * settings.cascade_count if isinstance(sizes, int) else sizes


def map_texels(settings):
    """Texels of all maps together."""
    return sum(side**2 for side in map_sizes(settings))


def maps_text(settings):
    """Maps in a few words: "4 x 2048²", or "2880² + 1152² + 512²" where sizes differ."""
    sizes = map_sizes(settings)
    if len(set(sizes)) == 1:
        return f"{len(sizes)} x {sizes[0]}²"
    return " + ".join(f"{size}²" for size in sizes)


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
