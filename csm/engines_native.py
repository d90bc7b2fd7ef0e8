"""The table of engines, part three: Unreal and Filament; see `csm.engines_web`."""

from .conversions import fit_exponent, power_of_two, shares
from .engine_rows import (
    BIAS,
    BLEND,
    CULLED,
    DEPTH_WINDOW,
    FILTER,
    INTERVAL,
    LEAST_SIZE,
    NEVER_TURNED,
    NO_FADE,
    NO_WARP,
    ORTHONORMAL,
    RANGE,
    SNAPPED,
    SOFT_KERNEL,
    SPLITS,
    VARIANCE,
    Engine,
    Fixed,
    Near,
    Setting,
    blend_share,
    cascade_count,
    fade_share,
    from_sun,
    from_sun_z_up,
    is_hard,
    is_soft,
    map_size,
    not_theirs,
    quality,
    sphere,
    split_note,
    stabilised,
    sun_disc,
    with_begin,
    with_constant,
)

__all__ = ["FILAMENT", "UNREAL"]

# -- Unreal ---------------------------------------------------------------------------------------

_UNREAL = "https://dev.epicgames.com/documentation/unreal-engine/"
UNREAL_LIGHT = f"{_UNREAL}API/Runtime/Engine/Components/UDirectionalLightComponent"
UNREAL_BASE = f"{_UNREAL}API/Runtime/Engine/Components/ULightComponent"
UNREAL_VARIABLES = f"{_UNREAL}unreal-engine-console-variables-reference"
UNREAL_DEPTH, UNREAL_SLOPE = 10.0, 3.0  # r.Shadow.CSMDepthBias, r.Shadow.CSMSlopeScaleDepthBias
UNREAL_TEXELS = 0.5 * UNREAL_DEPTH  # of bias that ShadowBias 1 makes: radius over resolution
UNREAL_MAPS = (LEAST_SIZE, 16384)  # 4 to the hardware's limit, by the variable's own help
UNREAL_SIDES = (1, 2, 3, 5)  # texels, nearly, of r.ShadowQuality 1, 2, 3, 5
UNREAL_QUALITIES = (1, 2, 3, 5)


def _unreal_exponent(at):
    exponent, made = fit_exponent(at.splits)
    note = split_note(at, made, "slices that grow by one factor")
    if not 1.0 <= exponent <= 4.0:
        outside = "outside the editor's slider (1 to 4)"
        note = outside if note is None else f"{note}; {outside}"
    return exponent if note is None else Near(exponent, note, "split")


def _unreal_quality(at):
    if is_hard(at):
        return 1
    index, value = quality(at, UNREAL_SIDES, UNREAL_QUALITIES)
    if is_soft(at):
        return 5
    if at.settings.filter == "pcf" and UNREAL_SIDES[index] == at.settings.filter_size:
        return value
    what = f"{at.settings.filter} of {at.settings.filter_size} texels"
    return Near(value, f"{what} becomes a kernel of some {UNREAL_SIDES[index]}", "filter")


def _unreal_kernel(at):
    if is_hard(at):
        return 1
    return SOFT_KERNEL if is_soft(at) else quality(at, UNREAL_SIDES, UNREAL_SIDES)[1]


def _unreal_wanted(at):
    """Texels of the constant part; a slope of 1, the most there is, adds up to thrice as many."""
    constant = with_constant(at, 0.0)
    return max(constant, (constant + at.normal_texels) / (1.0 + UNREAL_SLOPE))


def _unreal_bias(at):
    return _unreal_wanted(at) / UNREAL_TEXELS


def _unreal_slope(at):
    constant = min(_unreal_wanted(at), UNREAL_TEXELS)
    missing = with_constant(at, at.normal_texels) - constant
    kept = min(missing / (UNREAL_SLOPE * constant), 1.0) if constant > 0.0 else 0.0
    if not at.normal_texels:
        return kept
    return Near(kept, "planes steeper than 45 degrees get the bias of 45", "bias")


UNREAL = Engine(
    title="Unreal Engine, DirectionalLightComponent (cascaded maps, not virtual ones)",
    counts=tuple(range(1, 11)),
    map_size=lambda size, count: min(max(size, UNREAL_MAPS[0]), UNREAL_MAPS[1]),
    fit=sphere,
    kernel=_unreal_kernel,
    depth=lambda at: ("d16", "window"),
    settings=(
        Setting("CastShadows", ("shadows",), "",
                f"{_UNREAL}API/Runtime/Engine/Components/ULightComponentBase",
                lambda at: True, "Light->SetCastShadows($);"),
        Setting("SetWorldRotation", (), "unit vector from the sun, z up, left-handed",
                f"{_UNREAL}API/Runtime/Engine/Components/USceneComponent/SetWorldRotation",
                from_sun_z_up, "Light->SetWorldRotation(FVector$.Rotation());"),
        Setting("DynamicShadowCascades", ("cascade_count",), "", UNREAL_LIGHT, cascade_count,
                "Light->SetDynamicShadowCascades($);"),
        Setting("DynamicShadowDistanceMovableLight", RANGE, "cm", UNREAL_LIGHT,
                lambda at: 100.0 * at.far, "Light->SetDynamicShadowDistanceMovableLight($);"),
        Setting("CascadeDistributionExponent", SPLITS, "length of a slice over the one before it",
                UNREAL_LIGHT, _unreal_exponent, "Light->SetCascadeDistributionExponent($);"),
        Setting(
            "CascadeTransitionFraction", BLEND, "share of a cascade's depth, up to 0.3",
            UNREAL_LIGHT, lambda at: blend_share(at, 0.3),
            "Light->SetCascadeTransitionFraction($);",
        ),
        Setting("ShadowDistanceFadeoutFraction", ("fade_width",), "share of the shadow distance",
                UNREAL_LIGHT, fade_share, "Light->SetShadowDistanceFadeoutFraction($);"),
        Setting("LightSourceAngle", ("filter",), "degrees", UNREAL_LIGHT,
                lambda at: sun_disc(at) if is_soft(at) else None,
                "Light->SetLightSourceAngle($);"),
        Setting("ShadowBias", BIAS, "0 to 1: 5 texels", UNREAL_BASE, _unreal_bias,
                "Light->SetShadowBias($);", limits=(0.0, 1.0)),
        Setting("ShadowSlopeBias", BIAS, "0 to 1: thrice ShadowBias times the slope", UNREAL_BASE,
                _unreal_slope, "Light->SetShadowSlopeBias($);", limits=(0.0, 1.0)),
        Setting("ShadowCascadeBiasDistribution", ("bias",), "1: in texels of each cascade",
                UNREAL_LIGHT, lambda at: 1.0, "Light->ShadowCascadeBiasDistribution = $;"),
        Setting("r.Shadow.Virtual.Enable", ("shadows",), "", UNREAL_VARIABLES, lambda at: 0,
                'Set(TEXT("r.Shadow.Virtual.Enable"), $);', 1),
        Setting("r.Shadow.CSM.MaxCascades", ("cascade_count",), "", UNREAL_VARIABLES,
                lambda at: at.count, 'Set(TEXT("r.Shadow.CSM.MaxCascades"), $);', 1),
        Setting("r.Shadow.MaxCSMResolution", ("map_size",), "texels of each cascade",
                UNREAL_VARIABLES, map_size, 'Set(TEXT("r.Shadow.MaxCSMResolution"), $);', 1),
        Setting("r.ShadowQuality", FILTER, "0 off, 1 unfiltered, to 5", UNREAL_VARIABLES,
                _unreal_quality, 'Set(TEXT("r.ShadowQuality"), $);', 1),
        Setting("r.Shadow.FilterMethod", ("filter",), "0 uniform, 1 PCSS", UNREAL_VARIABLES,
                lambda at: int(is_soft(at)), 'Set(TEXT("r.Shadow.FilterMethod"), $);', 1),
        Setting("r.Shadow.CSMDepthBias", ("bias",), "", UNREAL_VARIABLES,
                lambda at: UNREAL_DEPTH, 'Set(TEXT("r.Shadow.CSMDepthBias"), $);', 1),
        Setting("r.Shadow.CSMSlopeScaleDepthBias", ("bias",), "", UNREAL_VARIABLES,
                lambda at: UNREAL_SLOPE, 'Set(TEXT("r.Shadow.CSMSlopeScaleDepthBias"), $);', 1),
    ),
    fixed=(
        INTERVAL, NEVER_TURNED, ORTHONORMAL, NO_WARP, CULLED, SNAPPED, DEPTH_WINDOW,
        Fixed("fit", ("sphere",), "the sphere round the slice"),
        Fixed("storage", ("atlas",), "tiles of one texture"),
        Fixed("depth_format", (), "the platform's format of shadow depths"),
        Fixed("caster_faces", ("front",), "front faces, unless a component has "
              "bCastShadowAsTwoSided"),
    ),
    off=Setting("CastShadows", ("shadows", "filter"), "",
                f"{_UNREAL}API/Runtime/Engine/Components/ULightComponentBase", lambda at: False,
                "Light->SetCastShadows($);"),
    off_about="Light: your UDirectionalLightComponent",
    template="""\
// Light: your UDirectionalLightComponent, movable, which shines along its x
// z is up, axes are left-handed: our y and z change places, as by the importer of glTF
@0
auto Set = [](const TCHAR* Name, float Value)
{
    IConsoleManager::Get().FindConsoleVariable(Name)->Set(Value);
};
@1
""",
    brackets=("{", "}"),
    suffix="f",
)  # fmt: skip

# -- Filament -------------------------------------------------------------------------------------

_FILAMENT = "https://github.com/google/filament/blob/main/filament/include/filament/"
FILAMENT_LIGHT = f"{_FILAMENT}LightManager.h"
FILAMENT_VIEW = f"{_FILAMENT}Options.h"
FILAMENT_KERNEL = 3  # texels, nearly, of ShadowType::PCF
# What LightManager.cpp holds its numbers to: texels, metres, texels, degrees of radius.
FILAMENT_MAPS = (8, 2048)
FILAMENT_CONSTANT, FILAMENT_NORMAL, FILAMENT_SUN = (0.0, 2.0), (0.0, 3.0), (0.25, 20.0)
FILAMENT_BLUR = (0.0, 125.0)


def _filament_size(size, count):
    return min(max(power_of_two(size), FILAMENT_MAPS[0]), FILAMENT_MAPS[1])


def _filament_type(at):
    name = at.settings.filter
    if name == "pcss":
        return Near(
            "filament::ShadowType::PCSS",
            "its penumbra follows shadowBulbRadius, a length, not the sun's angle: left at its "
            "default",
        )
    if name in VARIANCE:
        kept = "filament::ShadowType::VSM"
        return kept if name == "vsm" else Near(kept, not_theirs(at, "variance shadows"))
    if name == "pcf" and at.settings.filter_size == FILAMENT_KERNEL:
        return "filament::ShadowType::PCF"
    what = "hard" if name == "hard" else f"{name} of {at.settings.filter_size} texels"
    note = f"{what} becomes a kernel of some {FILAMENT_KERNEL}"
    return Near("filament::ShadowType::PCF", note)


def _filament_positions(at):
    """Shares of the camera's own range, of which shadowFar only cuts off the end."""
    if at.count == 1:
        return None
    last = max(at.camera.far, at.far)
    return with_begin(at, shares([*at.splits[:-1], last], from_near=True))


def _filament_far(at):
    if at.count == 1 or at.camera.far <= at.far * (1.0 + 1e-6):
        return at.far
    note = f"the last cascade reaches to the camera's far, {at.camera.far:.4g} m: bring that nearer"
    return Near(at.far, note, "max_distance")


def _filament_blur(at):
    return None if at.settings.filter not in VARIANCE else float(at.settings.filter_size - 1)


def _filament_radius(at):
    return 0.5 * at.sun.angular_diameter_deg if is_soft(at) else None


def _filament_constant(at):
    largest = float(at.constant_m.max())
    if at.constant_m.min() > 0.99 * largest or not largest:
        return largest
    note = f"one length for all cascades, that of the one that needs most: {largest:.3g} m"
    return Near(largest, f"{note}, the least is {at.constant_m.min():.3g} m", "bias")


FILAMENT = Engine(
    title="Filament, LightManager::ShadowOptions",
    counts=(1, 2, 3, 4),
    map_size=_filament_size,
    fit=lambda at: "box" if at.settings.snap == "none" else "sphere",
    kernel=lambda at: SOFT_KERNEL if is_soft(at) else FILAMENT_KERNEL,
    depth=lambda at: ("d16", "window"),
    settings=(
        Setting("LightManager::Builder::castShadows", ("shadows",), "", FILAMENT_LIGHT,
                lambda at: True, ".castShadows($)", 1),
        Setting("LightManager::Builder::direction", (), "unit vector from the sun", FILAMENT_LIGHT,
                from_sun, ".direction($)", 1),
        Setting("LightManager::Builder::sunAngularRadius", ("filter",), "degrees, 0.25 to 20",
                FILAMENT_LIGHT, _filament_radius, ".sunAngularRadius($)", 1, FILAMENT_SUN),
        Setting("ShadowOptions::mapSize", ("map_size",), "texels of each cascade", FILAMENT_LIGHT,
                map_size, "options.mapSize = $;"),
        Setting("ShadowOptions::shadowCascades", ("cascade_count",), "", FILAMENT_LIGHT,
                cascade_count, "options.shadowCascades = $;"),
        Setting(
            "ShadowOptions::cascadeSplitPositions", SPLITS,
            "shares of the way from the camera's near to its far", FILAMENT_LIGHT,
            _filament_positions,
            "{ const float positions[] = $; std::copy(std::begin(positions), std::end(positions), "
            "options.cascadeSplitPositions); }",
        ),
        Setting("ShadowOptions::shadowFar", RANGE, "m", FILAMENT_LIGHT, _filament_far,
                "options.shadowFar = $;"),
        Setting(
            "ShadowOptions::stable", ("snap",), "", FILAMENT_LIGHT,
            stabilised, "options.stable = $;",
        ),
        Setting(
            "ShadowOptions::lispsm", ("warp",), "", FILAMENT_LIGHT,
            lambda at: at.settings.warp == "lispsm" or (
                False if at.settings.warp == "none"
                else Near(True, f"{at.settings.warp} becomes light space perspective")
            ),
            "options.lispsm = $;",
        ),
        Setting("ShadowOptions::constantBias", BIAS, "m", FILAMENT_LIGHT, _filament_constant,
                "options.constantBias = $;", limits=FILAMENT_CONSTANT),
        Setting("ShadowOptions::normalBias", BIAS, "texels", FILAMENT_LIGHT,
                lambda at: at.normal_texels, "options.normalBias = $;", limits=FILAMENT_NORMAL),
        Setting("ShadowOptions::vsm.blurWidth", ("filter", "filter_size"), "texels, up to 125",
                FILAMENT_LIGHT, _filament_blur, "options.vsm.blurWidth = $;", limits=FILAMENT_BLUR),
        Setting("View::setShadowType", FILTER, "", FILAMENT_VIEW, _filament_type,
                "view->setShadowType($);", 2),
    ),
    fixed=(
        INTERVAL, NEVER_TURNED, ORTHONORMAL, CULLED, DEPTH_WINDOW, NO_FADE,
        Fixed("fit", (), "stable: the sphere round the slice; else what of it casts and receives"),
        Fixed("blend", ("none",), "one cascade ends where the next begins"),
        Fixed("storage", ("array",), "layers of one array"),
        Fixed("depth_format", (), "the engine chooses the format of its maps"),
        Fixed("caster_faces", (), "each material's culling decides"),
    ),
    off=Setting("LightManager::setShadowCaster", ("shadows", "filter"), "", FILAMENT_LIGHT,
                lambda at: False, "engine->getLightManager().setShadowCaster("
                "engine->getLightManager().getInstance(sun), $);"),
    off_about="engine, sun: yours",
    template="""\
// engine, view, sun: yours; y is up, axes are right-handed, as ours
filament::LightManager::ShadowOptions options;
@0
filament::LightManager::Builder(filament::LightManager::Type::SUN)
    @1
    .shadowOptions(options)
    .build(*engine, sun);
@2
""",
    brackets=("{ ", " }"),
    suffix="f",
)  # fmt: skip
