"""The table of engines, part one: three.js and Babylon.js.

A row an engine, in it a row a setting and a row for everything the engine does in one way only.
Names, units and limits are those of the engines' public documentation, whose page stands beside
each name; where that does not say what a number multiplies, it is what the engine's published
source does with it (docs/export.md).
"""

import math

from .conversions import fit_lambda, power_of_two, scheme_of, shares
from .engine_rows import (
    BIAS,
    BLEND,
    CULLED,
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
    browser_map_size,
    cascade_count,
    faces,
    from_sun,
    from_sun_mirrored,
    in_metres,
    is_hard,
    is_soft,
    not_theirs,
    quality,
    shadow_distance,
    split_note,
    stabilised,
    with_begin,
)

__all__ = ["BABYLON", "THREE"]

# -- three.js -------------------------------------------------------------------------------------

CSM_PAGE = "https://threejs.org/docs/pages/CSM.html"
THREE_SHADOW = "https://threejs.org/docs/pages/LightShadow.html"
THREE_RENDERER = "https://threejs.org/docs/pages/WebGLRenderer.html"


def _three_mode(at):
    scheme = scheme_of(at.splits)
    return with_begin(at, scheme or "custom")


def _three_breaks(at):
    if scheme_of(at.splits):
        return None
    return [*shares(at.splits, from_near=False), 1.0]


def _three_type(at):
    name = at.settings.filter
    if name == "hard":
        return "THREE.BasicShadowMap"
    if name in VARIANCE:
        kept = "THREE.VSMShadowMap"
        return kept if name == "vsm" else Near(kept, not_theirs(at, kept))
    if name == "pcf":
        return "THREE.PCFShadowMap"
    return Near("THREE.PCFShadowMap", not_theirs(at, "a kernel of one width"))


def _three_kernel(at):
    if is_hard(at):
        return 1
    return SOFT_KERNEL if is_soft(at) else at.settings.filter_size


def _three_radius(at):
    return None if is_hard(at) else 0.5 * (_three_kernel(at) - 1)


def _three_margin(at):
    # light sits this far before a slice: far enough to see the scene's side towards the sun
    return at.caster_span + THREE_NEAR


def _three_far(at):
    return _three_margin(at) + float(at.diameters.max())


THREE_NEAR = 1.0  # what the addon makes of 0, too
STEP_24 = 2.0**-24  # a step of depth in 24 bits, over a range that is the addon's own


def _three_bias(at):
    span = _three_far(at) - THREE_NEAR
    return [-max(float(one) / span, STEP_24) for one in at.constant_m]


def _three_normal(at):
    return in_metres(at.normal_texels, at)


def _three_side(at):
    kept = {"both": "THREE.DoubleSide", "front": "THREE.FrontSide", "back": "THREE.BackSide"}
    return kept[faces(at)]


THREE = Engine(
    title="three.js, addon CSM",
    counts=(1, 2, 3, 4, 5, 6, 7, 8),
    # LightShadow.mapSize: powers of 2
    map_size=lambda size, count: max(power_of_two(size), LEAST_SIZE),
    fit=lambda at: "diameter",
    kernel=_three_kernel,
    depth=lambda at: ("d24", "scene"),
    settings=(
        Setting(
            "WebGLRenderer.shadowMap.enabled", ("shadows",), "", THREE_RENDERER,
            lambda at: True, "renderer.shadowMap.enabled = $;",
        ),
        Setting(
            "WebGLRenderer.shadowMap.type", FILTER, "", THREE_RENDERER,
            _three_type, "renderer.shadowMap.type = $;",
        ),
        Setting("CSM.cascades", ("cascade_count",), "", CSM_PAGE, cascade_count, "cascades: $,", 1),
        Setting("CSM.maxFar", RANGE, "m", CSM_PAGE, shadow_distance, "maxFar: $,", 1),
        Setting("CSM.mode", SPLITS, "", CSM_PAGE, _three_mode, "mode: '$',", 1),
        Setting(
            "CSM.customSplitsCallback", SPLITS, "shares of maxFar, the last of them 1", CSM_PAGE,
            _three_breaks,
            "customSplitsCallback: (count, near, far, breaks) => breaks.push(...$),", 1,
        ),
        Setting("CSM.shadowMapSize", ("map_size",), "texels", CSM_PAGE, browser_map_size,
                "shadowMapSize: $,", 1),
        Setting(
            "CSM.lightDirection", (), "unit vector from the sun", CSM_PAGE,
            from_sun,
            "lightDirection: new THREE.Vector3(...$),", 1,
        ),
        Setting("CSM.lightNear", ("depth_range",), "m", CSM_PAGE, lambda at: THREE_NEAR,
                "lightNear: $,", 1),
        Setting("CSM.lightFar", ("depth_range",), "m", CSM_PAGE, _three_far, "lightFar: $,", 1),
        Setting("CSM.lightMargin", ("depth_range",), "m", CSM_PAGE, _three_margin,
                "lightMargin: $,", 1),
        Setting(
            "CSM.fade", BLEND, "", CSM_PAGE,
            lambda at: at.settings.blend != "none" and Near(
                True, f"{at.settings.blend} over {at.settings.blend_width:g} becomes the addon's "
                "own width, and shadows fade out at maxFar, too"
            ),
            "csm.fade = $;", 2,
        ),
        Setting(
            "LightShadow.bias", BIAS, "depth 0 to 1 of a light's range, one a cascade",
            THREE_SHADOW, _three_bias,
            "csm.lights.forEach((light, i) => { light.shadow.bias = $[i]; });", 2,
        ),
        Setting(
            "LightShadow.normalBias", BIAS, "m, one a cascade", THREE_SHADOW, _three_normal,
            "csm.lights.forEach((light, i) => { light.shadow.normalBias = $[i]; });", 2,
        ),
        Setting(
            "LightShadow.radius", FILTER, "texels", THREE_SHADOW, _three_radius,
            "csm.lights.forEach((light) => { light.shadow.radius = $; });", 2,
        ),
        Setting(
            "Material.shadowSide", ("caster_faces",), "",
            "https://threejs.org/docs/pages/Material.html", _three_side,
            "// of every material: material.shadowSide = $;", 2,
        ),
    ),
    fixed=(
        INTERVAL, NEVER_TURNED, ORTHONORMAL, NO_WARP, CULLED, SNAPPED,
        Fixed("fade_width", lambda at: (0.0,) if at.settings.blend == "none" else (),
              "shadows end at maxFar at once, or as CSM.fade has it"),
        Fixed("fit", ("diameter",), "a square as wide as the slice's longest diagonal"),
        Fixed("storage", ("separate",), "a light and a map for each cascade"),
        Fixed("depth_format", (), "the renderer chooses the format of its maps"),
    ),
    off=Setting("DirectionalLight.castShadow", ("shadows", "filter"), "",
                "https://threejs.org/docs/pages/DirectionalLight.html", lambda at: False,
                "light.castShadow = $;"),
    off_about="light: your THREE.DirectionalLight, instead of those of the addon CSM",
    template="""\
import * as THREE from 'three';
import { CSM } from 'three/addons/csm/CSM.js';

// renderer, scene, camera: yours; y is up, axes are right-handed, as ours
@0
const csm = new CSM({
  camera,
  parent: scene,
  @1
});
@2
csm.updateFrustums();
// every material: csm.setupMaterial(material); every frame: csm.update();
""",
)  # fmt: skip

# -- Babylon.js -----------------------------------------------------------------------------------

BABYLON_CSM = "https://doc.babylonjs.com/features/featuresDeepDive/lights/shadows_csm"
BABYLON_SHADOWS = "https://doc.babylonjs.com/features/featuresDeepDive/lights/shadows"
BABYLON_LIGHT = "https://doc.babylonjs.com/typedoc/classes/BABYLON.DirectionalLight"
BABYLON_API = "https://doc.babylonjs.com/typedoc/classes/BABYLON.CascadedShadowGenerator"
BABYLON_SIDES = (2, 3, 5)  # texels along the kernels of QUALITY_LOW, MEDIUM, HIGH


def _babylon_bounds(at):
    return at.settings.split == "sdsm"


def _babylon_lambda(at):
    if _babylon_bounds(at):
        return at.settings.lam
    lam, made = fit_lambda(at.splits)
    note = split_note(at, made, "the scheme with this lambda")
    return lam if note is None else Near(lam, note, "split")


def _babylon_stable(at):
    if at.settings.snap != "none" and _babylon_bounds(at):
        return Near(False, "off: bounds that change every frame leave nothing to stabilise")
    return stabilised(at)


def _babylon_kernel(at):
    return 1 if is_hard(at) else quality(at, BABYLON_SIDES, BABYLON_SIDES)[1]


def _babylon_pcf(at):
    if is_hard(at) or is_soft(at):
        return False
    return True if at.settings.filter == "pcf" else Near(True, not_theirs(at, "PCF"))


def _babylon_quality(at):
    if is_hard(at):
        return None
    names = [f"BABYLON.ShadowGenerator.QUALITY_{word}" for word in ("LOW", "MEDIUM", "HIGH")]
    index, name = quality(at, BABYLON_SIDES, names)
    if is_soft(at) or BABYLON_SIDES[index] == at.settings.filter_size:
        return name
    note = f"{at.settings.filter_size} texels become {BABYLON_SIDES[index]}"
    return Near(name, note, "filter_size")


def _babylon_bias(at):
    # clip z runs from -1 to 1 in WebGL: two units over the range; without a filter depth is 0 to 1
    span = at.diameters + (0.0 if at.settings.pancake else at.caster_span)
    per_metre = (1.0 if is_hard(at) else 2.0) / span
    every = at.constant_m * per_metre
    if at.count == 1 or not at.constant_m.any():
        return float(every.max())
    note = f"one depth for all cascades, that of the neediest: the least is {every.min():.3g}"
    return Near(float(every.max()), note, "bias")


def _babylon_normal(at):
    every = at.normal_texels * at.texels
    if at.count == 1 or not at.normal_texels:
        return float(every.max())
    note = (
        f"one length for all cascades, that of the coarsest: {every.max():.3g} m, where the finest "
        f"needs {every.min():.3g} m"
    )
    return Near(float(every.max()), note, "bias")


def _babylon_light_size(at):
    if not is_soft(at):
        return None
    tangent = 2.0 * math.tan(math.radians(0.5 * at.sun.angular_diameter_deg))
    window = float(at.texels[0]) * at.size
    ratio = tangent * float(at.diameters[0]) / window
    note = f"a sun of {at.sun.angular_diameter_deg:g} degrees in the first cascade's map, nearly"
    return Near(min(ratio, 1.0), note, "filter")


BABYLON = Engine(
    title="Babylon.js, CascadedShadowGenerator",
    counts=(2, 3, 4),
    map_size=lambda size, count: max(size, LEAST_SIZE),
    fit=lambda at: "box" if at.settings.snap == "none" or _babylon_bounds(at) else "sphere",
    kernel=_babylon_kernel,
    depth=lambda at: ("d32f", "scene"),
    settings=(
        Setting("Light.shadowEnabled", ("shadows",), "",
                BABYLON_LIGHT, lambda at: True, "light.shadowEnabled = $;"),
        Setting("DirectionalLight.direction", (), "unit vector from the sun, y up, left-handed",
                BABYLON_LIGHT, from_sun_mirrored,
                "light.direction = new BABYLON.Vector3(...$);"),
        Setting("CascadedShadowGenerator.mapSize", ("map_size",), "texels", BABYLON_API,
                browser_map_size,
                "const generator = new BABYLON.CascadedShadowGenerator($, light);"),
        Setting("CascadedShadowGenerator.numCascades", ("cascade_count",), "", BABYLON_CSM,
                cascade_count, "generator.numCascades = $;"),
        Setting("CascadedShadowGenerator.shadowMaxZ", RANGE, "m", BABYLON_CSM, shadow_distance,
                "generator.shadowMaxZ = $;"),
        Setting("CascadedShadowGenerator.lambda", SPLITS, "", BABYLON_CSM, _babylon_lambda,
                "generator.lambda = $;"),
        Setting("CascadedShadowGenerator.autoCalcDepthBounds", ("split",), "", BABYLON_CSM,
                _babylon_bounds, "generator.autoCalcDepthBounds = $;"),
        Setting(
            "CascadedShadowGenerator.stabilizeCascades", ("snap",), "", BABYLON_CSM,
            _babylon_stable,
            "generator.stabilizeCascades = $;",
        ),
        Setting("CascadedShadowGenerator.cascadeBlendPercentage", BLEND, "0 to 1", BABYLON_CSM,
                blend_share, "generator.cascadeBlendPercentage = $;"),
        Setting("CascadedShadowGenerator.depthClamp", ("depth_range", "pancake"), "", BABYLON_CSM,
                lambda at: at.settings.pancake, "generator.depthClamp = $;"),
        Setting("CascadedShadowGenerator.usePercentageCloserFiltering", FILTER, "",
                BABYLON_SHADOWS, _babylon_pcf, "generator.usePercentageCloserFiltering = $;"),
        Setting("CascadedShadowGenerator.useContactHardeningShadow", ("filter",), "",
                BABYLON_SHADOWS, is_soft, "generator.useContactHardeningShadow = $;"),
        Setting("CascadedShadowGenerator.filteringQuality", ("filter", "filter_size"), "",
                BABYLON_SHADOWS, _babylon_quality, "generator.filteringQuality = $;"),
        Setting("CascadedShadowGenerator.contactHardeningLightSizeUVRatio", ("filter",),
                "share of a map's width", BABYLON_SHADOWS, _babylon_light_size,
                "generator.contactHardeningLightSizeUVRatio = $;"),
        Setting("CascadedShadowGenerator.bias", BIAS, "clip depth", BABYLON_API, _babylon_bias,
                "generator.bias = $;"),
        Setting("CascadedShadowGenerator.normalBias", BIAS, "m", BABYLON_API, _babylon_normal,
                "generator.normalBias = $;"),
        Setting(
            "CascadedShadowGenerator.forceBackFacesOnly", ("caster_faces",), "", BABYLON_API,
            lambda at: faces(at) == "back" or (
                False if faces(at) == "front"
                else Near(False, "each material's own culling decides; both sides need it off")
            ),
            "generator.forceBackFacesOnly = $;",
        ),
    ),
    fixed=(
        INTERVAL, NEVER_TURNED, ORTHONORMAL, NO_WARP, NO_FADE,
        Fixed("fit", lambda at: (at.fit,), "the slice's box, or its sphere when stabilised"),
        Fixed("cull", ("none",), "every caster is drawn into every cascade"),
        Fixed("storage", ("array",), "layers of one array"),
        Fixed("depth_format", (), "the generator chooses the format of its maps"),
    ),
    off=Setting("Light.shadowEnabled", ("shadows", "filter"), "", BABYLON_LIGHT, lambda at: False,
                "light.shadowEnabled = $;"),
    off_about="light: your BABYLON.DirectionalLight",
    template="""\
// light: your BABYLON.DirectionalLight; camera.maxZ: the far plane of your camera
// y is up, axes are left-handed: x is mirrored, as by the glTF loader; under
// scene.useRightHandedSystem they are ours: turn the sign of the direction's x
@0
generator.splitFrustum();
// every caster: generator.addShadowCaster(mesh); every receiver: mesh.receiveShadows = true;
""",
)  # fmt: skip
