"""Names, order and defaults of what callers write: they may be added to, never changed."""

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
    "Cascades.from_matrices": [
        ("clip_from_world", REQUIRED),
        ("splits", REQUIRED),
        ("map_size", REQUIRED),
        ("clip_z", (0, 1), KEYWORD),
    ],
    "check_cascades": [
        ("cascades", REQUIRED),
        ("camera", REQUIRED),
        ("select", "interval", KEYWORD),
        ("scene", None, KEYWORD),
        ("receivers", None, KEYWORD),
        ("border_texels", 0, KEYWORD),
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
    "recommend": [
        ("scene", REQUIRED),
        ("camera", REQUIRED),
        ("sun", REQUIRED),
        ("max_error", None, KEYWORD),
        ("budget_ms", None, KEYWORD),
    ],
    "sweep": [
        ("cases", REQUIRED),
        ("axes", REQUIRED),
        ("base", None, KEYWORD),
        ("out", None, KEYWORD),
        ("processes", 1, KEYWORD),
        ("client", None, KEYWORD),
        ("progress", None, KEYWORD),
        ("repeats", None, KEYWORD),
    ],
}


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


def test_compare_by_keyword():
    report = csm.compare(frame=[[0.0, 1.0]], truth=[[1.0, 1.0]])
    assert report.disagreement == 0.5
