"""The table of engines, part two: Godot and Unity; see `csm.engines_web`."""

import numpy as np

from .conversions import least_constant, power_of_two, shares
from .engine_rows import (
    BIAS,
    BLEND,
    CULLED,
    DEPTH_WINDOW,
    FILTER,
    INTERVAL,
    NEVER_TURNED,
    NO_WARP,
    ORTHONORMAL,
    RANGE,
    SNAPPED,
    SOFT_KERNEL,
    SPLITS,
    Engine,
    Fixed,
    Near,
    Setting,
    cascade_count,
    faces,
    fade_share,
    fade_start,
    from_sun,
    from_sun_mirrored,
    is_hard,
    is_soft,
    map_size,
    not_theirs,
    quality,
    shadow_distance,
    sphere,
    sun_disc,
    with_begin,
    with_constant,
)

__all__ = ["GODOT", "UNITY"]

SQRT2 = 2.0**0.5


# -- Godot ----------------------------------------------------------------------------------------

GODOT_LIGHT = "https://docs.godotengine.org/en/stable/classes/class_directionallight3d.html"
GODOT_BASE = "https://docs.godotengine.org/en/stable/classes/class_light3d.html"
GODOT_NODE = "https://docs.godotengine.org/en/stable/classes/class_node3d.html"
GODOT_PROJECT = "https://docs.godotengine.org/en/stable/classes/class_projectsettings.html"
GODOT_SERVER = "https://docs.godotengine.org/en/stable/classes/class_renderingserver.html"
GODOT_MODES = {1: "SHADOW_ORTHOGONAL", 2: "SHADOW_PARALLEL_2_SPLITS", 4: "SHADOW_PARALLEL_4_SPLITS"}
GODOT_SIDES = (2, 3, 5, 7, 9, 13)  # texels, nearly, of SHADOW_QUALITY_HARD to _SOFT_ULTRA
GODOT_QUALITIES = ("HARD", "SOFT_VERY_LOW", "SOFT_LOW", "SOFT_MEDIUM", "SOFT_HIGH", "SOFT_ULTRA")
GODOT_PANCAKE = 20.0  # m, the engine's default
GODOT_BIAS = 100.0  # of shadow_bias in a metre, in the first cascade
GODOT_ATLAS = (256, 16384)
GODOT_MOST = 10.0  # of either bias
GODOT_SLIDER = 8192.0  # m, where the editor's slider of the distance ends; numbers go on


def _godot_size(size, count):
    least, most = (side // (1 if count == 1 else 2) for side in GODOT_ATLAS)
    return min(max(power_of_two(size), least), most)  # the atlas is rounded up to a power


def _godot_distance(at):
    if at.far <= GODOT_SLIDER:
        return at.far
    return Near(at.far, f"beyond the editor's slider, which ends at {GODOT_SLIDER:g} m", RANGE[0])


def _godot_split(number):
    def value(at):
        inner = shares(at.splits, from_near=True)
        return with_begin(at, inner[number]) if number < len(inner) else None

    return value


def _godot_mode(at):
    kept = cascade_count(at)
    name = f"DirectionalLight3D.{GODOT_MODES[at.count]}"
    return Near(name, kept.note, kept.of) if isinstance(kept, Near) else name


def _godot_atlas(at):
    # two splits share the atlas as upper and lower half, four as quarters
    kept = map_size(at, 1 if at.count == 1 else 2)
    if at.count == 2 and not isinstance(kept, Near):
        note = "two splits are half as high as wide: twice our texels one way"
        return Near(kept, note, "map_size")
    return kept


def _godot_index(at):
    return 0 if is_hard(at) else quality(at, GODOT_SIDES, range(6))[0]


def _godot_quality(at):
    name = f"RenderingServer.SHADOW_QUALITY_{GODOT_QUALITIES[_godot_index(at)]}"
    if at.settings.filter == "hard":
        return Near(name, "hard becomes one bilinear compare", "filter")
    if at.settings.filter in ("pcf", "pcss"):
        return name
    return Near(name, not_theirs(at, "percentage-closer filtering"), "filter")


def _godot_normal_texels(at):
    """So that it exceeds what planes need from some angle on, and the constant does the rest."""
    return 2.0 * at.normal_texels


def _godot_bias(at):
    texels = min(_godot_normal_texels(at), GODOT_MOST)
    constant = with_constant(
        at,
        least_constant(
            at.normal_texels,
            lambda t: texels * (1.0 - np.cos(t)) * np.sin(t) * np.tan(t),
        ),
    )
    return GODOT_BIAS * constant * float(at.texels[0])


GODOT = Engine(
    title="Godot 4, DirectionalLight3D",
    counts=(1, 2, 4),
    map_size=_godot_size,
    fit=sphere,
    kernel=lambda at: SOFT_KERNEL if is_soft(at) else GODOT_SIDES[_godot_index(at)],
    depth=lambda at: ("d16" if at.settings.depth_format == "d16" else "d32f", "window"),
    settings=(
        Setting("shadow_enabled", ("shadows",), "", GODOT_BASE, lambda at: True,
                "light.shadow_enabled = $"),
        Setting("global_transform.basis", (), "unit vector from the sun, y up, right-handed",
                GODOT_NODE, from_sun,
                "light.global_transform.basis = Basis(Quaternion(Vector3.FORWARD, Vector3$))"),
        Setting("directional_shadow_mode", ("cascade_count",), "", GODOT_LIGHT, _godot_mode,
                "light.directional_shadow_mode = $"),
        Setting("directional_shadow_max_distance", RANGE, "m", GODOT_LIGHT, _godot_distance,
                "light.directional_shadow_max_distance = $"),
        *(
            Setting(f"directional_shadow_split_{n + 1}", SPLITS,
                    "share of the way from the camera's near to the max distance", GODOT_LIGHT,
                    _godot_split(n), f"light.directional_shadow_split_{n + 1} = $")
            for n in range(3)
        ),
        Setting("rendering/lights_and_shadows/directional_shadow/size", ("map_size",),
                "texels of the atlas of all splits", GODOT_PROJECT, _godot_atlas,
                "ProjectSettings.set_setting("
                '"rendering/lights_and_shadows/directional_shadow/size", $)', 1),
        Setting(
            "rendering/lights_and_shadows/directional_shadow/16_bits", ("depth_format",), "",
            GODOT_PROJECT,
            lambda at: at.settings.depth_format == "d16" or (
                False if at.settings.depth_format == "d32f"
                else Near(False, "24 bits become 32")
            ),
            "ProjectSettings.set_setting("
            '"rendering/lights_and_shadows/directional_shadow/16_bits", $)', 1,
        ),
        Setting("rendering/lights_and_shadows/directional_shadow/soft_shadow_filter_quality",
                FILTER, "", GODOT_PROJECT, _godot_quality,
                "ProjectSettings.set_setting("
                '"rendering/lights_and_shadows/directional_shadow/soft_shadow_filter_quality", $)',
                1),
        Setting("light_angular_distance", ("filter",), "degrees", GODOT_BASE, sun_disc,
                "light.light_angular_distance = $", limits=(0.0, 90.0)),
        Setting("shadow_blur", ("filter",), "", GODOT_BASE, lambda at: 1.0,
                "light.shadow_blur = $"),
        Setting(
            "directional_shadow_blend_splits", BLEND, "", GODOT_LIGHT,
            lambda at: at.settings.blend != "none" and Near(
                True, f"{at.settings.blend} over {at.settings.blend_width:g} becomes the engine's "
                "own width"
            ),
            "light.directional_shadow_blend_splits = $",
        ),
        Setting("directional_shadow_fade_start", ("fade_width",), "share of the max distance",
                GODOT_LIGHT, lambda at: fade_start(at) / at.far,
                "light.directional_shadow_fade_start = $"),
        Setting(
            "directional_shadow_pancake_size", ("depth_range", "pancake"), "m", GODOT_LIGHT,
            lambda at: Near(GODOT_PANCAKE, "casters farther before a slice than the engine's 20 m "
                            "are flattened there", "pancake") if at.settings.pancake else 0.0,
            "light.directional_shadow_pancake_size = $",
        ),
        Setting("shadow_bias", BIAS, "hundredths of a metre in the first split, growing with the "
                "others", GODOT_BASE, _godot_bias, "light.shadow_bias = $",
                limits=(0.0, GODOT_MOST)),
        Setting("shadow_normal_bias", BIAS, "texels", GODOT_BASE, _godot_normal_texels,
                "light.shadow_normal_bias = $", limits=(0.0, GODOT_MOST)),
        Setting(
            "shadow_reverse_cull_face", ("caster_faces",), "", GODOT_BASE,
            lambda at: faces(at) == "back" or (
                False if faces(at) == "front" else Near(
                    False, "front faces, unless each mesh has SHADOW_CASTING_SETTING_DOUBLE_SIDED"
                )
            ),
            "light.shadow_reverse_cull_face = $",
        ),
    ),
    fixed=(
        INTERVAL, NEVER_TURNED, ORTHONORMAL, NO_WARP, CULLED, SNAPPED,
        Fixed("fit", ("sphere",), "the sphere round the slice"),
        Fixed("storage", ("atlas",), "tiles of one atlas"),
    ),
    off=Setting("shadow_enabled", ("shadows", "filter"), "", GODOT_BASE, lambda at: False,
                "light.shadow_enabled = $"),
    off_about="light: your DirectionalLight3D",
    template="""\
# light: your DirectionalLight3D, which shines along its -z; y is up, axes are right-handed, as
# ours; project settings are read at start, hence the two calls
@1
RenderingServer.directional_shadow_atlas_set_size(
\tProjectSettings.get_setting("rendering/lights_and_shadows/directional_shadow/size"),
\tProjectSettings.get_setting("rendering/lights_and_shadows/directional_shadow/16_bits"))
RenderingServer.directional_soft_shadow_filter_set_quality(ProjectSettings.get_setting(
\t"rendering/lights_and_shadows/directional_shadow/soft_shadow_filter_quality"))
@0
""",
    comment="#",
    brackets=("(", ")"),
)  # fmt: skip

# -- Unity ----------------------------------------------------------------------------------------

UNITY_API = (
    "https://docs.unity3d.com/Packages/com.unity.render-pipelines.universal@14.0/api/"
    "UnityEngine.Rendering.Universal.UniversalRenderPipelineAsset.html"
)
UNITY_ASSET = (
    "https://docs.unity3d.com/Packages/com.unity.render-pipelines.universal@14.0/manual/"
    "universalrp-asset.html"
)
UNITY_LIGHT = "https://docs.unity3d.com/ScriptReference/Light-shadows.html"
UNITY_SIDES = (3, 5, 7)  # texels along Low (4 taps), Medium and High
UNITY_WORDS = ("Low", "Medium", "High")
UNITY_SCALE = (1.5, 2.5, 3.5)  # what the biases are multiplied by under soft shadows
UNITY_ATLAS = (256, 4096)  # ShadowResolution
UNITY_BIAS = 10.0  # the most of either bias


def _unity_size(size, count):
    least, most = (side // (1 if count == 1 else 2) for side in UNITY_ATLAS)
    return min(max(power_of_two(size), least), most)


def _unity_atlas(at):
    # two to four cascades share the texture as quarters or halves of it, one has it all
    return map_size(at, 1 if at.count == 1 else 2)


def _unity_quality(at):
    return None if is_hard(at) else quality(at, UNITY_SIDES, range(3))[0]


def _unity_softness(at):
    index = _unity_quality(at)
    if index is None:
        return None
    name = f"SoftShadowQuality.{UNITY_WORDS[index]}"
    if at.settings.filter == "pcf" and at.settings.filter_size == UNITY_SIDES[index]:
        return name
    ours, theirs = f"{at.settings.filter} of {at.settings.filter_size}", UNITY_SIDES[index]
    return Near(name, f"{ours} becomes a kernel of {theirs} texels", "filter")


def _unity_shadows(at):
    if is_hard(at):
        return Near("LightShadows.Hard", "hard becomes one bilinear compare", "filter")
    return "LightShadows.Soft"


def _unity_split(count):
    def value(at):
        if at.count != count:
            return None
        inner = shares(at.splits, from_near=False)
        return with_begin(at, inner[0] if count == 2 else inner)

    return value


def _unity_scale(at):
    index = _unity_quality(at)
    return 1.0 if index is None else UNITY_SCALE[index]


def _unity_normal_texels(at):
    return SQRT2 * at.normal_texels


def _unity_normal(at):
    return _unity_normal_texels(at) / _unity_scale(at)


def _unity_depth(at):
    texels = min(_unity_normal_texels(at), UNITY_BIAS * _unity_scale(at))
    constant = with_constant(
        at, least_constant(at.normal_texels, lambda t: texels * (1.0 / np.cos(t) - 1.0))
    )
    return constant / _unity_scale(at)


UNITY = Engine(
    title="Unity, Universal Render Pipeline",
    counts=(1, 2, 3, 4),
    map_size=_unity_size,
    fit=sphere,
    kernel=lambda at: 2 if is_hard(at) else UNITY_SIDES[_unity_quality(at)],
    depth=lambda at: ("d16", "window"),
    settings=(
        Setting("Light.shadows", ("shadows", "filter"), "", UNITY_LIGHT, _unity_shadows,
                "sun.shadows = $;"),
        Setting("Transform.rotation", (), "unit vector from the sun, y up, left-handed",
                "https://docs.unity3d.com/ScriptReference/Quaternion.LookRotation.html",
                from_sun_mirrored,
                "sun.transform.rotation = Quaternion.LookRotation(new Vector3$);"),
        Setting("shadowDistance", RANGE, "m", UNITY_API, shadow_distance,
                'asset.FindProperty("m_ShadowDistance").floatValue = $;', 1),
        Setting("shadowCascadeCount", ("cascade_count",), "", UNITY_API, cascade_count,
                'asset.FindProperty("m_ShadowCascadeCount").intValue = $;', 1),
        Setting("cascade2Split", SPLITS, "share of the shadow distance", UNITY_API,
                _unity_split(2), 'asset.FindProperty("m_Cascade2Split").floatValue = $;', 1),
        Setting("cascade3Split", SPLITS, "shares of the shadow distance", UNITY_API,
                _unity_split(3),
                'asset.FindProperty("m_Cascade3Split").vector2Value = new Vector2$;', 1),
        Setting("cascade4Split", SPLITS, "shares of the shadow distance", UNITY_API,
                _unity_split(4),
                'asset.FindProperty("m_Cascade4Split").vector3Value = new Vector3$;', 1),
        Setting("cascadeBorder", ("fade_width",), "share of the shadow distance", UNITY_API,
                fade_share, 'asset.FindProperty("m_CascadeBorder").floatValue = $;', 1),
        Setting("mainLightShadowmapResolution", ("map_size",), "texels of the texture of all "
                "cascades", UNITY_API, _unity_atlas,
                'asset.FindProperty("m_MainLightShadowmapResolution").intValue = $;', 1),
        Setting("supportsSoftShadows", ("filter",), "", UNITY_API, lambda at: not is_hard(at),
                'asset.FindProperty("m_SoftShadowsSupported").boolValue = $;', 1),
        Setting("softShadowQuality", FILTER, "", UNITY_ASSET, _unity_softness,
                'asset.FindProperty("m_SoftShadowQuality").intValue = (int)$;', 1),
        Setting("shadowDepthBias", BIAS, "texels, times the soft kernel's radius", UNITY_API,
                _unity_depth, 'asset.FindProperty("m_ShadowDepthBias").floatValue = $;', 1,
                (0.0, UNITY_BIAS)),
        Setting("shadowNormalBias", BIAS, "texels, times the soft kernel's radius", UNITY_API,
                _unity_normal, 'asset.FindProperty("m_ShadowNormalBias").floatValue = $;', 1,
                (0.0, UNITY_BIAS)),
    ),
    fixed=(
        NEVER_TURNED, ORTHONORMAL, NO_WARP, CULLED, SNAPPED, DEPTH_WINDOW,
        Fixed("select", (), "the first cascade whose sphere round its slice holds the point"),
        Fixed("fit", ("sphere",), "the sphere round the slice"),
        Fixed("blend", ("none",), "one cascade ends where the next begins"),
        Fixed("storage", ("atlas",), "tiles of one texture"),
        Fixed("depth_format", (), "the pipeline chooses the format of its maps"),
        Fixed("caster_faces", ("front",), "each material's Render Face and each renderer's "
              "shadowCastingMode decide; by default front faces cast"),
    ),
    off=Setting("Light.shadows", ("shadows", "filter"), "", UNITY_LIGHT,
                lambda at: "LightShadows.None", "sun.shadows = $;"),
    off_about="sun: your directional Light; using UnityEngine",
    template="""\
// in an Editor script: using UnityEditor; using UnityEngine; using UnityEngine.Rendering;
// using UnityEngine.Rendering.Universal; sun: your directional Light
// y is up, axes are left-handed: x is mirrored, as by importers of glTF and FBX
@0
var asset = new SerializedObject(GraphicsSettings.currentRenderPipeline);
@1
asset.ApplyModifiedProperties();
""",
    brackets=("(", ")"),
    suffix="f",
)  # fmt: skip
