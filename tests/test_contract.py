"""Names, order and defaults of what callers write: they may be added to, never changed."""

import dataclasses
import inspect

import pytest

import csm

REQUIRED = inspect.Parameter.empty
KEYWORD = "keyword only"
MANY = "any number"

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps")

# Of each callable the parameters that are promised, in their order: name, default, and how given
# unless by position or by name.
SIGNATURES = {
    "load": [("path", REQUIRED)],
    "load_elevation": [("path", REQUIRED)],
    "Scene.from_arrays": [("positions", REQUIRED), ("triangles", REQUIRED)],
    "Scene.from_elevation": [("heights", REQUIRED), ("cell_size", REQUIRED), ("origin", None)],
    "Scene.merge": [("self", REQUIRED), ("scenes", REQUIRED, MANY)],
    "Scene.with_ground": [("self", REQUIRED), ("y", 0.0)],
    "Scene.at": [("self", REQUIRED), ("clip", REQUIRED), ("seconds", REQUIRED)],
    "Camera.look_at": [
        ("eye", REQUIRED),
        ("target", REQUIRED),
        ("up", (0, 1, 0)),
        ("fov_y_deg", 60),
        ("near", 0.1),
        ("far", 500),
        ("size", (1920, 1080)),
    ],
    "Camera.orthographic": [
        ("eye", REQUIRED),
        ("target", REQUIRED),
        ("up", (0, 1, 0)),
        ("height", 10),
        ("near", 0.1),
        ("far", 500),
        ("size", (1920, 1080)),
    ],
    "Sun": [("to_light", REQUIRED), ("angular_diameter_deg", 0.0)],
    "Sun.from_angles": [("azimuth_deg", REQUIRED), ("elevation_deg", REQUIRED)],
    "Sun.from_compass": [("azimuth_deg", REQUIRED), ("elevation_deg", REQUIRED)],
    "Renderer": [("backend", "auto")],
    "Renderer.render": [
        ("self", REQUIRED),
        ("scene", REQUIRED),
        ("camera", REQUIRED),
        ("sun", REQUIRED),
        ("settings", None),
        ("outputs", OUTPUTS, KEYWORD),
        ("out", None, KEYWORD),
        ("points", None, KEYWORD),
    ],
    "split_distances": [
        ("near", REQUIRED),
        ("far", REQUIRED),
        ("count", REQUIRED),
        ("scheme", "practical", KEYWORD),
        ("lam", 0.5, KEYWORD),
    ],
    "fit_cascades": [
        ("camera", REQUIRED),
        ("sun", REQUIRED),
        ("settings", REQUIRED),
        ("scene", None, KEYWORD),
        ("receivers", None, KEYWORD),
    ],
    "plan": [("settings", REQUIRED)],
    "truth": [
        ("scene", REQUIRED),
        ("camera", REQUIRED),
        ("sun", REQUIRED),
        ("rays_per_pixel", 1, KEYWORD),
    ],
    "Truth.trace": [("self", REQUIRED), ("points", REQUIRED)],
    "compare": [("frame", REQUIRED), ("truth", REQUIRED)],
}

SETTINGS = {
    "cascade_count": 4,
    "map_size": 2048,
    "split": "practical",
    "lam": 0.5,
    "view_range": "scene",
    "fit": "sphere",
    "snap": "exact",
    "select": "map",
    "cull": "inclusive",
    "depth_format": "d32f",
    "filter": "hard",
    "filter_size": 3,
    "bias": "auto",
}
NUMBERS_OF_A_MANUAL_BIAS = (
    "constant_bias_texels",
    "slope_bias",
    "normal_offset_texels",
    "receiver_plane",
)


def named(path):
    """The callable of a dotted name in csm: a method as its class holds it."""
    found = csm
    for name in path.split("."):
        found = getattr(found, name)
    return found


@pytest.mark.parametrize("path", SIGNATURES)
def test_signature(path):
    parameters = list(inspect.signature(named(path)).parameters.values())
    promised = SIGNATURES[path]
    found = []
    for parameter in parameters[: len(promised)]:
        how = {parameter.KEYWORD_ONLY: (KEYWORD,), parameter.VAR_POSITIONAL: (MANY,)}
        found.append((parameter.name, parameter.default, *how.get(parameter.kind, ())))
    assert found == promised
    # What was added since is left out by those who do not know of it.
    for parameter in parameters[len(promised) :]:
        assert parameter.default is not REQUIRED, parameter


def test_settings_and_their_defaults():
    defaults = {field.name: field.default for field in dataclasses.fields(csm.ShadowSettings)}
    assert {name: defaults.get(name) for name in SETTINGS} == SETTINGS
    assert defaults.keys() >= set(NUMBERS_OF_A_MANUAL_BIAS)
    for name in SETTINGS | dict.fromkeys(NUMBERS_OF_A_MANUAL_BIAS):
        changed = csm.ShadowSettings().replace(**{name: defaults[name]})
        assert changed == csm.ShadowSettings()
        assert name in changed.to_dict()
    with pytest.raises(dataclasses.FrozenInstanceError):
        csm.ShadowSettings().lam = 0.7


def test_compare_by_keyword():
    report = csm.compare(frame=[[0.0, 1.0]], truth=[[1.0, 1.0]])
    assert report.disagreement == 0.5
