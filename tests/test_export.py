"""Settings of other engines: each value put back by the engine's own rule, and what is missing."""

import itertools
import math
import re
import runpy
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from any_settings import any_settings
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from test_recommendation import plane, view

import csm
from csm import _core
from csm.conversions import (
    exponent_splits,
    fit_exponent,
    fit_lambda,
    least_constant,
    power_of_two,
    resampled,
    scheme_of,
    shares,
)
from csm.decisions import TABLE
from csm.export import ENGINES

ROOT = Path(__file__).resolve().parents[1]
CAMERA = csm.Camera.look_at((6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=100, size=(320, 180))
SUN = csm.Sun((0.5, 1.0, 0.3), 0.53)
FIELDS = {field.name for field in fields(csm.ShadowSettings)}
QUICK = hypothesis_settings(max_examples=25, deadline=None)
engines = pytest.mark.parametrize("engine", ENGINES)

#: Ascending view depths from the camera's near.
split_lists = st.lists(st.floats(0.01, 3.0), min_size=1, max_size=8).map(
    lambda steps: CAMERA.near + np.cumsum([0.0, *steps])
)


@pytest.fixture(scope="module")
def box():
    return csm.scenes.plane_and_box()


def exported(engine, splits=None, camera=CAMERA, sun=SUN, scene=None, **changes):
    if splits is not None:
        changes = {"cascade_count": len(splits) - 1, "split": "histogram", **changes}
    settings = csm.ShadowSettings(**changes)
    return csm.export_settings(settings, engine, camera=camera, sun=sun, scene=scene, splits=splits)


def values(found):
    return {name: one.value for name, one in found.settings.items()}


# -- conversions against closed forms --------------------------------------------------------------


@QUICK
@given(
    ratio=st.floats(1.5, 1e5), count=st.integers(2, 8), lam=st.floats(0, 1),
    near=st.floats(0.01, 10),
)  # fmt: skip
def test_lambda_of_practical_splits_is_theirs(ratio, count, lam, near):
    splits = csm.split_distances(near, near * ratio, count, scheme="practical", lam=lam)
    found, made = fit_lambda(splits)
    assert found == pytest.approx(lam, abs=1e-9)
    assert np.allclose(made, splits, rtol=1e-9)


@QUICK
@given(splits=split_lists)
def test_lambda_is_the_least_squares_of_all(splits):
    assume(len(splits) > 2)
    lam, made = fit_lambda(splits)
    assert 0.0 <= lam <= 1.0
    assert np.allclose(
        made,
        csm.split_distances(splits[0], splits[-1], len(splits) - 1, scheme="practical", lam=lam),
    )
    square = ((made - splits) ** 2).sum()
    for other in np.linspace(0, 1, 21):
        made = csm.split_distances(
            splits[0], splits[-1], len(splits) - 1, scheme="practical", lam=other
        )
        assert square <= ((made - splits) ** 2).sum() * (1 + 1e-9) + 1e-18


@QUICK
@given(exponent=st.floats(0.2, 20), count=st.integers(2, 8), far=st.floats(1, 1e4))
def test_exponent_of_slices_that_grow_by_one_factor_is_found(exponent, count, far):
    splits = exponent_splits(exponent, 0.1, far, count)
    assert np.allclose(np.diff(splits)[1:] / np.diff(splits)[:-1], exponent, rtol=1e-6)
    found, made = fit_exponent(splits)
    assert found == pytest.approx(exponent, rel=1e-6)
    assert np.allclose(made, splits, rtol=1e-6)


def test_exponent_of_two_slices_and_of_logarithmic_ones_has_a_closed_form():
    assert fit_exponent([1.0, 3.0, 9.0])[0] == pytest.approx(6.0 / 2.0)
    splits = csm.split_distances(0.1, 1000.0, 4, scheme="logarithmic")
    assert fit_exponent(splits)[0] == pytest.approx(10.0)  # slices of a geometric series
    assert fit_exponent([0.1, 5.0])[0] == 1.0


@QUICK
@given(splits=split_lists)
def test_no_exponent_is_nearer(splits):
    assume(len(splits) > 2)
    _, made = fit_exponent(splits)
    worst = np.abs(np.log(made / splits)).max()
    for other in np.geomspace(0.1, 1000, 61):
        made = exponent_splits(other, splits[0], splits[-1], len(splits) - 1)
        assert worst <= np.abs(np.log(made / splits)).max() + 1e-9


@QUICK
@given(splits=split_lists)
def test_shares_are_of_the_range_or_of_the_distance(splits):
    near, far = splits[0], splits[-1]
    back = [near + one * (far - near) for one in shares(splits, from_near=True)]
    assert np.allclose(back, splits[1:-1])
    assert np.allclose(np.array(shares(splits, from_near=False)) * far, splits[1:-1])


@pytest.mark.parametrize("scheme", ["practical", "uniform", "logarithmic"])
def test_fewer_cascades_of_a_scheme_are_of_that_scheme(scheme):
    eight = csm.split_distances(0.1, 80.0, 8, scheme=scheme)
    for count in (1, 2, 4):
        few = csm.split_distances(0.1, 80.0, count, scheme=scheme)
        assert np.allclose(resampled(eight, count), few, rtol=1e-12)
    three = csm.split_distances(0.1, 80.0, 3, scheme="logarithmic")
    four = csm.split_distances(0.1, 80.0, 4, scheme="logarithmic")
    assert np.allclose(resampled(three, 4), four)  # along the same curve
    assert scheme_of(eight) == scheme
    assert scheme_of(csm.split_distances(0.1, 80.0, 8, lam=0.4)) is None


def test_powers_of_two_are_not_below():
    assert [power_of_two(n) for n in (1, 2, 3, 724, 1024, 1025, 2896)] == [
        1, 2, 4, 1024, 1024, 2048, 4096,
    ]  # fmt: skip


def test_least_constant_touches():
    # against nothing the steepest angle needs it all; against the need itself nothing is left
    steepest = math.tan(math.radians(89.9))
    assert least_constant(2.0, lambda t: 0.0 * t) == pytest.approx(2.0 * steepest)
    assert least_constant(2.0, lambda t: 2.0 * np.tan(t)) == 0.0
    # tan t - (1 / cos t - 1) grows to 1, which is reached at 90 degrees
    assert least_constant(1.0, lambda t: 1.0 / np.cos(t) - 1.0) == pytest.approx(1.0, abs=1e-3)


# -- splits by each engine's own rule --------------------------------------------------------------


def godot_splits(v):
    # renderer_scene_cull.cpp: min_distance + split * (max_distance - min_distance)
    far = v["directional_shadow_max_distance"]
    inner = [v[f"directional_shadow_split_{n}"] for n in (1, 2, 3)
             if f"directional_shadow_split_{n}" in v]  # fmt: skip
    return [CAMERA.near + one * (far - CAMERA.near) for one in inner]


def unity_splits(v):
    count = v["shadowCascadeCount"]
    inner = v[f"cascade{count}Split"] if count > 1 else []
    return [one * v["shadowDistance"] for one in (inner if count > 2 or not inner else [inner])]


def filament_splits(v):
    # ShadowMapManager.cpp: near + (far - near) * position, both of the camera
    inner = v.get("ShadowOptions::cascadeSplitPositions", [])
    return [CAMERA.near + one * (CAMERA.far - CAMERA.near) for one in inner]


def three_splits(v):
    near, far, count = CAMERA.near, v["CSM.maxFar"], v["CSM.cascades"]
    at = np.arange(1, count) / count
    uniform, logarithmic = near + (far - near) * at, near * (far / near) ** at
    made = {
        "uniform": uniform,
        "logarithmic": logarithmic,
        "practical": 0.5 * uniform + 0.5 * logarithmic,
    }
    if v["CSM.mode"] == "custom":
        breaks = v["CSM.customSplitsCallback"]
        assert len(breaks) == count
        assert breaks[-1] == 1.0
        return np.array(breaks[:-1]) * far
    return made[v["CSM.mode"]]


@pytest.mark.parametrize(
    ("engine", "back"),
    [
        ("godot", godot_splits),
        ("unity", unity_splits),
        ("filament", filament_splits),
        ("threejs", three_splits),
    ],
)
@QUICK
@given(splits=split_lists)
def test_splits_put_back_by_the_engine_are_ours(engine, back, splits):
    found = exported(engine, splits=splits)
    if "cascade_count" in found.rounded:
        splits = resampled(splits, len(back(values(found))) + 1)
    assert np.allclose(back(values(found)), splits[1:-1], rtol=1e-5)
    assert "split" not in found.rounded
    assert "split" not in found.missing


@pytest.mark.parametrize("scheme", ["practical", "uniform", "logarithmic"])
def test_schemes_of_three_js_go_by_name(scheme):
    found = values(exported("threejs", split=scheme))
    assert found["CSM.mode"] == scheme
    assert "CSM.customSplitsCallback" not in found


def test_residuals_of_one_number_are_told_in_metres():
    splits = np.array([0.1, 1.0, 2.0, 40.0])
    made, lam = {}, exported("babylon", splits=splits)
    value = values(lam)["CascadedShadowGenerator.lambda"]
    made["babylon"] = csm.split_distances(0.1, 40.0, 3, scheme="practical", lam=value)
    grown = exported("unreal", splits=splits)
    factor = values(grown)["CascadeDistributionExponent"]
    lengths = factor ** np.arange(3)
    made["unreal"] = 0.1 + 39.9 * np.cumsum([0.0, *lengths]) / lengths.sum()
    for name, found in (("babylon", lam), ("unreal", grown)):
        worst = int(np.argmax(np.abs(made[name] - splits)))
        told = f"split {worst} lies at {made[name][worst]:.4g} m instead of {splits[worst]:.4g} m"
        assert told in found.rounded["split"]
    # and where the scheme has them, nothing is rounded
    assert "split" not in exported("babylon", split="practical", lam=0.3).rounded
    assert values(exported("babylon", lam=0.3))["CascadedShadowGenerator.lambda"] == (
        pytest.approx(0.3)
    )


def test_sdsm_of_babylon_is_its_own():
    found = exported("babylon", splits=[2.0, 5.0, 9.0, 20.0], split="sdsm", lam=0.8)
    assert values(found)["CascadedShadowGenerator.autoCalcDepthBounds"] is True
    assert values(found)["CascadedShadowGenerator.lambda"] == 0.8
    assert values(found)["CascadedShadowGenerator.stabilizeCascades"] is False
    assert "snap" in found.rounded
    for engine in ("threejs", "godot", "unity", "unreal", "filament"):
        other = exported(engine, splits=[2.0, 5.0, 9.0, 20.0], split="sdsm", lam=0.8)
        assert "camera's near, 0.1 m, not at 2 m" in other.rounded["split"]


# -- numbers and sizes -----------------------------------------------------------------------------

COUNTS = {
    "threejs": ("CSM.cascades", range(1, 9)),
    "babylon": ("CascadedShadowGenerator.numCascades", (2, 3, 4)),
    "godot": ("directional_shadow_mode", (1, 2, 4)),
    "unity": ("shadowCascadeCount", (1, 2, 3, 4)),
    "unreal": ("DynamicShadowCascades", range(11)),
    "filament": ("ShadowOptions::shadowCascades", (1, 2, 3, 4)),
}
MODES = {"SHADOW_ORTHOGONAL": 1, "SHADOW_PARALLEL_2_SPLITS": 2, "SHADOW_PARALLEL_4_SPLITS": 4}


@engines
@pytest.mark.parametrize("ours", range(1, 9))
def test_cascades_are_as_many_as_the_engine_can_have(engine, ours):
    found = exported(engine, cascade_count=ours)
    name, allowed = COUNTS[engine]
    value = values(found)[name]
    value = MODES.get(str(value).rpartition(".")[2], value)
    assert value in allowed
    assert ("cascade_count" in found.rounded) == (value != ours)
    if ours <= max(allowed):
        assert value >= ours  # never coarser where finer is to be had
    else:
        assert value == max(allowed)


# texels along a map of one cascade, by the engine's own layout
SIZES = {
    "threejs": ("CSM.shadowMapSize", lambda n: 1, True),
    "babylon": ("CascadedShadowGenerator.mapSize", lambda n: 1, False),
    "godot": ("rendering/lights_and_shadows/directional_shadow/size",
              lambda n: 1 if n == 1 else 2, True),
    "unity": ("mainLightShadowmapResolution", lambda n: 1 if n == 1 else 2, True),
    "unreal": ("r.Shadow.MaxCSMResolution", lambda n: 1, False),
    "filament": ("ShadowOptions::mapSize", lambda n: 1, True),
}  # fmt: skip


@pytest.mark.parametrize(("size", "side"), [(4096, 4096), (2896, 4096), (512, 512), (64, 256)])
def test_one_cascade_of_unity_has_the_whole_texture(size, side):
    found = exported("unity", cascade_count=1, map_size=size)
    assert values(found)["mainLightShadowmapResolution"] == side
    assert ("map_size" in found.rounded) == (size != side)


@engines
@pytest.mark.parametrize("count", [2, 4])
@pytest.mark.parametrize("size", [256, 724, 1024, 1448, 2048])
def test_maps_are_as_large_as_ours_or_the_next_size_there_is(engine, size, count):
    found = exported(engine, cascade_count=count, map_size=size)
    name, across, powers = SIZES[engine]
    texture = values(found)[name]
    side = texture / across(count)
    assert size <= side < 2 * size
    if powers:
        assert math.log2(texture) % 1.0 == 0.0
    if side != size:
        assert f"{size} become {side:.0f} texels" in found.rounded["map_size"]


def test_last_cascade_of_filament_ends_with_the_camera():
    found = exported("filament", splits=[0.1, 2.0, 9.0])
    assert values(found)["ShadowOptions::shadowFar"] == 9.0
    assert "the camera's far, 100 m" in found.rounded["max_distance"]
    near = exported("filament", splits=[0.1, 2.0, 9.0], camera=CAMERA.replace(far=9.0))
    assert "max_distance" not in near.rounded
    assert values(near)["ShadowOptions::cascadeSplitPositions"] == pytest.approx([1.9 / 8.9])


def test_unity_has_no_larger_texture():
    found = exported("unity", map_size=4096)
    assert values(found)["mainLightShadowmapResolution"] == 4096
    assert "4096 become 2048 texels, 0.5 times" in found.rounded["map_size"]
    assert values(exported("unity", map_size=64))["mainLightShadowmapResolution"] == 256


UNEQUAL = {"cascade_count": 3, "map_size": (2880, 1152, 512), "storage": "atlas"}


@engines
def test_of_unequal_maps_the_largest_counts_and_the_price_is_told(engine):
    name, across, _ = SIZES[engine]
    found, equal = exported(engine, **UNEQUAL), exported(engine, cascade_count=3, map_size=2880)
    assert values(found)[name] == values(equal)[name]
    side, count = values(found)[name] / across(3), 4 if engine == "godot" else 3
    told = found.rounded["map_size"]
    assert f"2880, 1152, 512 become {side:.0f} texels, one size for all cascades" in told
    in_all = 2880**2 + 1152**2 + 512**2
    assert f"{count * side**2 / in_all:.3g} times as many in all" in told
    as_many = int(re.search(r"where (\d+) each would be as many", told)[1])
    assert count * as_many**2 == pytest.approx(in_all, rel=1e-3)
    assert f"rounded: map_size: {told}" in found.text


@engines
@pytest.mark.parametrize(
    ("scheme", "lam"), [("logarithmic", 1.0), ("practical", 0.9), ("practical", 0.1)]
)
def test_splits_near_the_camera_go_over(engine, scheme, lam):
    """As distances, shares, a scheme's name or its number; the one that cannot says how far off."""
    found = exported(engine, split=scheme, lam=lam, view_range="camera", **UNEQUAL)
    v, count = values(found), 4 if engine == "godot" else 3
    near, far = CAMERA.near, CAMERA.far
    at = np.arange(1, count) / count
    uniform, logarithmic = near + (far - near) * at, near * (far / near) ** at
    ours = lam * logarithmic + (1.0 - lam) * uniform
    if engine == "threejs":
        assert v["CSM.mode"] == ("logarithmic" if lam == 1.0 else "custom")
        there = ours if lam == 1.0 else far * np.array(v["CSM.customSplitsCallback"][:-1])
    elif engine == "babylon":
        there = (1.0 - v["CascadedShadowGenerator.lambda"]) * uniform
        there += v["CascadedShadowGenerator.lambda"] * logarithmic
    elif engine == "godot":  # four splits of our three, along the curve between them
        knots = np.log([near, *(lam * near * (far / near) ** (np.arange(1, 3) / 3) + (1.0 - lam)
                                * (near + (far - near) * np.arange(1, 3) / 3)), far])  # fmt: skip
        ours = np.exp(np.interp(at, np.arange(4) / 3, knots))
        there = [v[f"directional_shadow_split_{n}"] for n in (1, 2, 3)]
        there = near + (far - near) * np.array(there)
    elif engine == "unity":
        there = far * np.array(v["cascade3Split"])
    elif engine == "unreal":
        lengths = v["CascadeDistributionExponent"] ** np.arange(count)
        there = near + (far - near) * np.cumsum(lengths)[:-1] / lengths.sum()
    else:
        there = near + (far - near) * np.array(v["ShadowOptions::cascadeSplitPositions"])
    off = np.abs(there - ours).max()
    if engine == "unreal" and lam < 1.0:
        assert off > 1e-3
        worst = int(np.argmax(np.abs(there - ours)))
        assert f"split {worst + 1} lies at {there[worst]:.4g} m" in found.rounded["split"]
    else:
        assert off < 1e-6 * far
        assert "lies at" not in found.rounded.get("split", "")


@pytest.mark.parametrize("fit", ["sphere", "shifted", "box", "visible"])
def test_splits_of_equal_resolution_are_those_of_our_own_maps(fit):
    """Of unequal sizes, with the borders that our filter takes, in our windows."""
    settings = csm.ShadowSettings(
        split="resolution", fit=fit, filter="pcf", filter_size=33, view_range="camera", **UNEQUAL
    )
    seen = {"receivers": np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 1.0]])} if fit == "visible" else {}
    ours = csm.fit_cascades(CAMERA, SUN, settings, **seen).splits
    found = csm.export_settings(settings, "unity", camera=CAMERA, sun=SUN)
    assert values(found)["cascade3Split"] == pytest.approx(list(ours[1:-1] / ours[-1]), rel=1e-9)


# -- biases: planes by brute force -----------------------------------------------------------------


def planes(steepest_deg, count=4000):
    """Unit normals (m, 3) of planes up to an angle from the light, which is +z."""
    rng = np.random.default_rng(7)
    angle = np.radians(rng.uniform(0, steepest_deg, count))
    around = rng.uniform(0, 2 * np.pi, count)
    return np.stack(
        [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], axis=1
    )


def gained(normals, moved):
    """How far receivers, moved, lie above their plane along the light [m]; the light is +z."""
    return (normals * moved).sum(axis=1) / normals[:, 2]


def laws(engine, v, normals, cascade, texel):
    """Bias [m] of planes by what the engine does with its numbers."""
    cosine = normals[:, 2:]
    sine = np.sqrt(1 - cosine**2)
    light = np.array([[0.0, 0.0, 1.0]])
    if engine == "threejs":  # receiver moved along the normal, then depth over the light's range
        span = v["CSM.lightFar"] - v["CSM.lightNear"]
        moved = normals * v["LightShadow.normalBias"][cascade]
        return gained(normals, moved) - v["LightShadow.bias"][cascade] * span
    if engine == "babylon":  # casters moved against the normal by the sine; depth left out
        return gained(normals, normals * sine * v["CascadedShadowGenerator.normalBias"])
    if engine == "godot":  # BIAS_FUNC of scene_forward_clustered.glsl; texels grow with the split
        moved = normals * (1 - cosine) * v["shadow_normal_bias"] * texel
        moved = moved - light * moved[:, 2:]
        first = texel_sides(engine)[0]
        along = v["shadow_bias"] / 100.0 * texel / first
        return gained(normals, moved + light * along)
    if engine == "unity":  # ApplyShadowBias of Shadows.hlsl, on casters; soft kernels times radius
        radius = {"Low": 1.5, "Medium": 2.5, "High": 3.5}
        quality = str(v.get("softShadowQuality", "")).rpartition(".")[2]
        scale = texel * radius.get(quality, 1.0)
        moved = normals * (1 - cosine) * v["shadowNormalBias"] * scale
        return gained(normals, moved + light * v["shadowDepthBias"] * scale)
    if engine == "unreal":  # radius over resolution is half a texel; slopes up to 1
        constant = v["r.Shadow.CSMDepthBias"] * 0.5 * texel * v["ShadowBias"]
        slope = np.minimum(sine / cosine, 1.0)[:, 0]
        return constant * (1 + v["r.Shadow.CSMSlopeScaleDepthBias"] * v["ShadowSlopeBias"] * slope)
    moved = normals * sine * v["ShadowOptions::normalBias"] * texel  # filament
    return gained(normals, moved) + v["ShadowOptions::constantBias"]


FITS = {"threejs": "diameter"}
COUNT, SIDE = 4, 1024


def texel_sides(engine):
    """Texels [m] of windows like the engine's, fitted here."""
    settings = csm.ShadowSettings(
        cascade_count=COUNT, map_size=SIDE, fit=FITS.get(engine, "sphere"), view_range="camera"
    )
    return csm.fit_cascades(CAMERA, SUN, settings).texel_size.max(axis=1)


# kernels that the engines have for a hard filter and for one of five texels
KERNELS = {
    "threejs": (1, 5), "babylon": (1, 5), "godot": (2, 5), "unity": (2, 5), "unreal": (1, 5),
    "filament": (3, 3),
}  # fmt: skip


@engines
@pytest.mark.parametrize("soft", [0, 1], ids=["hard", "pcf 5"])
def test_bias_of_every_plane_is_enough_and_not_much_more(engine, soft):
    filters = ({"filter": "hard"}, {"filter": "pcf", "filter_size": 5})[soft]
    found = values(exported(engine, cascade_count=COUNT, map_size=SIDE, view_range="camera",
                            **filters))  # fmt: skip
    normals = planes(45 if engine == "unreal" else 85)
    gradient = np.abs(normals[:, :2]).sum(axis=1) / normals[:, 2]
    ratios = []
    for cascade, texel in enumerate(texel_sides(engine)):
        # a compare against the centre of a texel half a kernel away along u and along v
        needed = 0.5 * KERNELS[engine][soft] * texel * gradient
        bias = laws(engine, found, normals, cascade, texel)
        assert (bias >= needed * (1 - 1e-9)).all()
        ratios.append((bias[gradient > 0.5] / needed[gradient > 0.5]).min())
    # tight somewhere in the cascade that needs most: a tenth less would be too little
    assert min(ratios) < 1.1


@engines
def test_bias_by_hand_goes_over_as_it_is(engine):
    changes = {"bias": "manual", "constant_bias_texels": 0.4, "normal_offset_texels": 0.7}
    found = values(exported(engine, cascade_count=COUNT, map_size=SIDE, view_range="camera",
                            **changes))  # fmt: skip
    for cascade, texel in enumerate(texel_sides(engine)):
        normals = planes(45 if engine == "unreal" else 80)
        tangent = np.sqrt(1 / normals[:, 2] ** 2 - 1)
        wanted = texel * (0.4 * (engine != "babylon") + 0.7 * tangent)  # its depth is apart
        bias = laws(engine, found, normals, cascade, texel)
        assert (bias >= wanted * (1 - 1e-6)).all()
    if engine == "babylon":
        assert found["CascadedShadowGenerator.bias"] > 0.0


@engines
def test_texels_are_those_of_windows_like_the_engines(engine):
    found = exported(engine, cascade_count=COUNT, map_size=SIDE, view_range="camera")
    assert found.texels == pytest.approx(tuple(texel_sides(engine)))
    assert f"texels there: {found.texels[0]:.3g}, " in str(found)


@engines
def test_no_bias_stays_none(engine):
    found = values(exported(engine, bias="manual", caster_faces="back"))
    biases = [v for name, v in found.items()
              if re.search(r"(?i)(normal|depth|constant|slope|shadow_?)bias$", name)
              and not name.startswith("r.")]  # fmt: skip
    assert biases
    assert not any(np.asarray(biases).ravel() > 1e-7)
    assert engine != "threejs" or min(found["LightShadow.bias"]) == -(2.0**-24)


def test_limits_are_kept_and_told_of():
    changes = {"bias": "manual", "constant_bias_texels": 40.0, "normal_offset_texels": 30.0}
    unity, unreal = (exported(engine, **changes) for engine in ("unity", "unreal"))
    assert values(unity)["shadowDepthBias"] == values(unity)["shadowNormalBias"] == 10.0
    assert "is held to 0 to 10" in unity.rounded["bias"]
    assert values(unreal)["ShadowBias"] == values(unreal)["ShadowSlopeBias"] == 1.0
    assert "is held to 0 to 1" in unreal.rounded["bias"]
    wide = exported("unreal", blend="smooth", blend_width=0.5)
    assert values(wide)["CascadeTransitionFraction"] == 0.3
    assert "smooth becomes linear" in wide.rounded["blend"]


def test_lights_of_three_js_hold_casters_and_slices(box):
    found = exported("threejs", scene=box, cascade_count=3, map_size=512)
    v = values(found)
    light = SUN.to_light
    corners = np.array([[box.bounds[i][0], box.bounds[j][1], box.bounds[k][2]]
                        for i in (0, 1) for j in (0, 1) for k in (0, 1)]) @ light  # fmt: skip
    splits = csm.fit_cascades(CAMERA, SUN, csm.ShadowSettings(cascade_count=3), scene=box).splits
    for near, far in itertools.pairwise(splits):
        along = _core.frustum_corners(CAMERA, near, far) @ light
        # CSM.update: the light stands lightMargin before the slice
        stands = along.max() + v["CSM.lightMargin"]
        if along.max() >= corners.min():  # the slice holds something that can be seen
            assert stands - corners.max() >= v["CSM.lightNear"] - 1e-9
        assert stands - along.min() <= v["CSM.lightFar"] + 1e-9
    assert v["CSM.lightDirection"] == pytest.approx(list(-light))
    assert (
        values(exported("filament"))["LightManager::Builder::direction"] == v["CSM.lightDirection"]
    )


# -- filters, faces, fade --------------------------------------------------------------------------


def test_soft_shadows_take_the_sun_with_them():
    soft = {"filter": "pcss", "filter_size": 15}
    assert values(exported("godot", **soft))["light_angular_distance"] == 0.53
    assert values(exported("godot", filter="hard"))["light_angular_distance"] == 0.0
    unreal = values(exported("unreal", **soft))
    assert (unreal["LightSourceAngle"], unreal["r.Shadow.FilterMethod"]) == (0.53, 1)
    babylon = values(exported("babylon", **soft))
    assert babylon["CascadedShadowGenerator.useContactHardeningShadow"] is True
    assert babylon["CascadedShadowGenerator.usePercentageCloserFiltering"] is False
    assert exported("unity", **soft).rounded["filter"]
    filament = exported("filament", **soft)
    assert values(filament)["View::setShadowType"].endswith("::PCSS")
    assert "shadowBulbRadius" in filament.rounded["filter"]


def test_filters_that_engines_have_are_not_rounded():
    for engine, changes in {
        "threejs": {"filter": "hard"}, "babylon": {"filter": "pcf", "filter_size": 5},
        "godot": {"filter": "pcf", "filter_size": 2}, "unity": {"filter": "pcf", "filter_size": 7},
        "unreal": {"filter": "hard"}, "filament": {"filter": "vsm"},
    }.items():  # fmt: skip
        found = exported(engine, **changes)
        assert not {"filter", "filter_size"} & found.rounded.keys()
        assert "filter" not in found.missing


@engines
def test_no_shadows_are_none(engine):
    found = exported(engine, filter="none")
    off = {"threejs": "DirectionalLight.castShadow", "babylon": "Light.shadowEnabled",
           "godot": "shadow_enabled", "unity": "Light.shadows", "unreal": "CastShadows",
           "filament": "LightManager::setShadowCaster"}[engine]  # fmt: skip
    assert values(found) == {off: "LightShadows.None" if engine == "unity" else False}
    assert not found.rounded
    assert not found.missing
    assert found.built_in.keys() | {"shadows", "filter"} >= {row.effect for row in TABLE}
    comment = ENGINES[engine].comment
    code = [one for one in found.text.splitlines() if not one.startswith(comment)]
    assert len(code) == 1, "only this light is changed"


@engines
def test_no_shadows_need_no_splits_and_no_near(engine):
    wanted = exported(engine, filter="none")
    changes = {"filter": "none", "split": "sdsm", "cascade_count": 1}
    assert exported(engine, camera=CAMERA, **changes) == wanted
    settings = csm.ShadowSettings(**changes)
    given = {"camera": CAMERA, "sun": SUN, "splits": [0.1, 20.0], "texels": [0.02]}
    assert csm.export_settings(settings, engine, **given) == wanted
    flat = CAMERA.replace(orthographic=True, near=-1.0)
    assert csm.export_settings(settings, engine, camera=flat, sun=SUN) == wanted


# -- the sun in the engine's own axes --------------------------------------------------------------

DIRECTIONS = {
    "threejs": "CSM.lightDirection", "babylon": "DirectionalLight.direction",
    "godot": "global_transform.basis", "unity": "Transform.rotation",
    "unreal": "SetWorldRotation", "filament": "LightManager::Builder::direction",
}  # fmt: skip


@engines
def test_sun_shines_along_the_engines_own_axes(engine):
    def direction(to_light):
        return np.array(values(exported(engine, sun=csm.Sun(to_light)))[DIRECTIONS[engine]])

    up = {"unreal": (0, 0, 1)}.get(engine, (0, 1, 0))
    assert -direction((0, 1, 0)) == pytest.approx(up)  # overhead
    turned = np.stack([direction(-axis) for axis in np.eye(3)])
    left = engine in ("babylon", "unity", "unreal")
    assert np.linalg.det(turned) == pytest.approx(-1.0 if left else 1.0)
    assert turned @ turned.T == pytest.approx(np.eye(3))
    # any other direction goes by the same map
    assert direction(SUN.to_light) == pytest.approx(-SUN.to_light @ turned)
    words = exported(engine).text
    assert ("left-handed" if left else "right-handed") in words
    assert f"{'z' if engine == 'unreal' else 'y'} is up" in words


def test_rotation_of_godot_turns_forward_to_the_sun():
    found = exported("godot")
    x, y, z = values(found)["global_transform.basis"]
    text = f"Basis(Quaternion(Vector3.FORWARD, Vector3({x:.9g}, {y:.9g}, {z:.9g})))"
    assert text in found.text
    # the shortest arc from -z, by its half angle
    forward, to = np.array([0.0, 0.0, -1.0]), np.array([x, y, z])
    axis, real = np.cross(forward, to), 1.0 + forward @ to
    length = math.sqrt(axis @ axis + real**2)
    axis, real = axis / length, real / length
    shone = forward + 2 * np.cross(axis, np.cross(axis, forward) + real * forward)
    assert shone == pytest.approx(-SUN.to_light)


# -- what engines cannot hold ----------------------------------------------------------------------

HELD = {
    "godot": ("rendering/lights_and_shadows/directional_shadow/size", 16384, 8192),
    "unity": ("mainLightShadowmapResolution", 4096, 2048),
    "filament": ("ShadowOptions::mapSize", 2048, 2048),
}


@pytest.mark.parametrize("engine", HELD)
def test_largest_maps_of_engines(engine):
    name, texture, side = HELD[engine]
    found = exported(engine, map_size=16384)
    assert values(found)[name] == texture
    assert f"16384 become {side} texels" in found.rounded["map_size"]


@pytest.mark.parametrize("engine", ["threejs", "babylon"])
def test_textures_that_not_every_browser_has_are_told(engine):
    assert "not every device" in exported(engine, map_size=8192).rounded["map_size"]
    assert "map_size" not in exported(engine, map_size=4096).rounded


def test_smallest_maps_of_engines():
    assert values(exported("godot", cascade_count=1, map_size=16))[HELD["godot"][0]] == 256
    assert values(exported("filament", map_size=4))[HELD["filament"][0]] == 8


@engines
@pytest.mark.parametrize("size", [1, 2, 3, 6, 9])
def test_small_maps_are_exported_whatever_the_filter(engine, size):
    # turned windows are not snapped, so they leave no border that a small map has no room for
    for changes in ({"filter": "pcss", "filter_size": 9}, {"filter": "hard"}):
        try:
            settings = csm.ShadowSettings(map_size=size, fit="visible", turned=True, **changes)
        except ValueError:  # no kernel of ours is as wide as the map: none to export
            continue
        found = csm.export_settings(settings, engine, camera=CAMERA, sun=SUN)
        name, across, _ = SIZES[engine]
        assert values(found)[name] / across(4) >= max(size, 4)


@engines
def test_biases_beyond_the_engine_are_held_and_told(engine):
    changes = {"bias": "manual", "constant_bias_texels": 4e5, "normal_offset_texels": 900.0}
    found = exported(engine, **changes)
    limited = [row for row in ENGINES[engine].settings if row.limits and "bias" in row.of]
    for row in limited:
        assert row.limits[0] <= values(found)[row.name] <= row.limits[1]
    assert bool(limited) == ("is held to" in found.rounded.get("bias", ""))
    assert bool(limited) == (engine not in ("threejs", "babylon"))


@engines
def test_negative_biases_by_hand_are_told_and_not_written(engine):
    changes = {"bias": "manual", "constant_bias_texels": -3.0, "normal_offset_texels": -0.5}
    found = exported(engine, **changes)
    told = found.rounded["bias"]
    assert told.startswith(
        "negative, held to 0: constant_bias_texels -3, normal_offset_texels -0.5"
    )
    assert values(found) == values(exported(engine, bias="manual"))
    assert "negative" not in exported(engine, bias="manual").rounded.get("bias", "")


def test_far_shadows_of_godot_go_on_where_the_slider_ends():
    far = exported("godot", splits=[0.1, 50.0, 9000.0])
    assert values(far)["directional_shadow_max_distance"] == 9000.0
    assert "8192 m" in far.rounded["max_distance"]


def test_fade_begins_where_ours_does():
    splits = [0.1, 4.0, 20.0]
    begin = 20.0 - 0.25 * 19.9
    found = {e: values(exported(e, splits=splits, fade_width=0.25)) for e in ENGINES}
    assert found["godot"]["directional_shadow_fade_start"] * 20.0 == pytest.approx(begin)
    assert (1 - found["unity"]["cascadeBorder"]) * 20.0 == pytest.approx(begin)
    assert (1 - found["unreal"]["ShadowDistanceFadeoutFraction"]) * 20.0 == pytest.approx(begin)
    assert found["unreal"]["DynamicShadowDistanceMovableLight"] == 2000.0  # centimetres
    for engine in ("threejs", "babylon", "filament"):
        assert "fade_width" in exported(engine, splits=splits, fade_width=0.25).missing


# -- nothing is passed over ------------------------------------------------------------------------


@engines
@QUICK
@given(settings=any_settings)
def test_every_decision_and_every_setting_is_told_of(engine, settings):
    splits = None
    if settings.split in ("sdsm", "histogram"):
        splits = 0.1 + np.arange(settings.cascade_count + 1.0)
    try:
        found = csm.export_settings(
            settings.replace(first_split=0.0, max_distance=50.0),
            engine, camera=CAMERA, sun=SUN, splits=splits,
        )  # fmt: skip
    except ValueError as error:
        assume("map_size" not in str(error) and "split" not in str(error))
        raise
    told = {name for one in found.settings.values() for name in one.of}
    told |= found.rounded.keys() | found.built_in.keys() | found.missing.keys()
    assert told >= {row.effect for row in TABLE}
    canonical = settings.replace(first_split=0.0, max_distance=50.0).canonical()
    assert told >= {name for name in FIELDS
                    if getattr(canonical, name) != getattr(csm.ShadowSettings(), name)}  # fmt: skip
    assert not found.built_in.keys() & found.missing.keys()
    assert found.rounded.keys() <= {name for one in found.settings.values() for name in one.of}
    for name, one in found.settings.items():
        numbers = np.asarray(one.value, dtype=float) if not isinstance(one.value, str) else 0.0
        assert np.isfinite(numbers).all(), name


@engines
def test_table_of_an_engine(engine):
    row = ENGINES[engine]
    names = [one.name for one in row.settings]
    assert len(names) == len(set(names))
    host = {
        "threejs": "threejs.org/docs", "babylon": "doc.babylonjs.com",
        "godot": "docs.godotengine.org", "unity": "docs.unity3d.com",
        "unreal": "dev.epicgames.com/documentation", "filament": "github.com/google/filament",
    }[engine]  # fmt: skip
    for one in row.settings:
        assert one.page.startswith(f"https://{host}")
        assert set(one.of) <= FIELDS | {"shadows"}
        assert "$" in one.code
        assert f"@{one.place}" in row.template
    for one in row.fixed:
        assert one.of in FIELDS
        assert one.text


def test_page_is_what_its_script_writes():
    write = runpy.run_path(str(ROOT / "scripts/export_page.py"))
    assert write["PAGE"].read_text() == write["page"](), "run: python -m scripts.export_page"


@engines
def test_it_reads_pastes_and_is_written(engine, tmp_path):
    found = exported(engine, filter="pcf", filter_size=5, cascade_count=3, blend="linear")
    shown, text = str(found), found.text
    for name, one in found.settings.items():
        assert name in shown
        if one.unit:
            assert f"[{one.unit}]" in shown
    for about in (found.rounded, found.missing):
        for name, sentence in about.items():
            assert sentence in shown
            assert f": {name}: {sentence}" in text
    assert "$" not in text
    assert "@" not in text
    code = re.sub(r"(//|#).*", "", text)
    for left, right in ("()", "[]", "{}"):
        assert code.count(left) == code.count(right)
    assert "True" not in code
    assert "None" not in code
    path = tmp_path / "shadows.txt"
    found.write(path)
    assert path.read_text() == text
    plain = found.to_dict()
    assert plain["settings"].keys() == found.settings.keys()
    assert plain["missing"] == found.missing


def test_wrong_arguments_are_named():
    settings = csm.ShadowSettings()
    good = {"camera": CAMERA, "sun": SUN}
    with pytest.raises(ValueError, match=r"engine must be one of threejs, babylon, .*'cryengine'"):
        csm.export_settings(settings, "cryengine", **good)
    with pytest.raises(TypeError, match=r"settings must be a csm\.ShadowSettings"):
        csm.export_settings({}, "unity", **good)
    with pytest.raises(ValueError, match=r"split='sdsm' is fitted .* give splits="):
        csm.export_settings(settings.replace(split="sdsm"), "unity", **good)
    with pytest.raises(ValueError, match="texels must be 4 lengths"):
        csm.export_settings(settings, "unity", texels=[0.1], **good)
    with pytest.raises(ValueError, match="splits must be 5 ascending view depths"):
        csm.export_settings(settings, "unity", splits=[0.1, 3.0, 2.0, 4.0, 5.0], **good)
    flat = CAMERA.replace(orthographic=True, near=-1.0)
    with pytest.raises(ValueError, match="camera must have near > 0"):
        csm.export_settings(settings, "unity", camera=flat, sun=SUN)


# -- recommendations -------------------------------------------------------------------------------


def test_recommendation_is_exported_with_what_was_seen_and_so_it_is_from_a_file(renderer, box):
    found = csm.recommend(box, CAMERA, SUN, max_error=0.002, renderer=renderer)
    again = csm.Recommendation.from_json(found.to_json())
    assert found.settings.fit == "visible"
    coarse = found.signals.views[0]
    seen = np.concatenate([coarse.receivers, coarse.outline])
    ours = csm.fit_cascades(CAMERA, SUN, found.settings, scene=box, receivers=seen)
    assert found.splits == tuple(ours.splits)
    assert found.texels == tuple(ours.texel_size.max(axis=1))
    for engine in ENGINES:
        one = found.export(engine)
        here, there = (", ".join(f"{t:.3g}" for t in sides) for sides in (found.texels, one.texels))
        assert f"texels of {there} m instead of {here} m" in one.missing["fit"]
        assert one.text == again.export(engine).text
        told = {name for q in one.settings.values() for name in q.of}
        told |= one.built_in.keys() | one.missing.keys()
        assert told >= {reason.effect for reason in found.reasons}
    with pytest.raises(ValueError, match="engine must be one of"):
        found.export("quake")
    below = csm.Sun((0.2, -1.0, 0.1))  # under the ground, which is seen from above
    dark = csm.recommend(plane(), view(), below, renderer=renderer)
    assert values(dark.export("godot"))["shadow_enabled"] is False


def test_one_cascade_is_one_in_words(renderer, box):
    one = exported("babylon", cascade_count=1).rounded["cascade_count"]
    assert one.startswith("one cascade becomes 2")
    found = csm.recommend(box, view(), csm.Sun((0.4, 1, 0.3)), renderer=renderer)
    assert found.settings.cascade_count == 1
    assert "1 cascades" not in f"{found} {found._repr_html_()} {exported('unity', cascade_count=1)}"
    with pytest.raises(ValueError, match=r"splits must be 2 ascending view depths \[m\], one more"):
        csm.export_settings(
            csm.ShadowSettings(cascade_count=1), "unity", camera=CAMERA, sun=SUN, splits=[1, 2, 3]
        )
