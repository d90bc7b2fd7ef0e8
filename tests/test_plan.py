"""A plan lists exactly what a render runs and holds; the renderer runs and holds exactly that."""

import itertools

import numpy as np
import pytest

import csm

SIZE = (40, 24)
PIXELS = SIZE[0] * SIZE[1]
DEPTH_BYTES = {"d32f": 4, "d24": 4, "d16": 2}
VIEW_TEXTURES = {"view_ids": 4, "view_depth": 4}
# mask, view_depth: a float; valid and cascade_index share a word; normal: three floats
OUTPUT_BYTES = {"mask": 4, "valid": 4, "view_depth": 4, "cascade_index": 4, "normal": 12}

SETTINGS = {
    "hard": csm.ShadowSettings(map_size=64),
    "one cascade": csm.ShadowSettings(map_size=64, cascade_count=1),
    "eight cascades": csm.ShadowSettings(map_size=32, cascade_count=8),
    "pcf in d16": csm.ShadowSettings(map_size=64, filter="pcf", filter_size=5, depth_format="d16"),
    "hardware 2x2": csm.ShadowSettings(map_size=64, filter="pcf", filter_size=2),
    "none": csm.ShadowSettings(filter="none"),
}
OUTPUTS = {
    "default": ("mask", "valid", "view_depth", "cascade_index", "shadow_maps"),
    "mask": ("mask",),
    "maps": ("shadow_maps",),
    "seen": ("valid",),
    "index": ("cascade_index",),
    "all": ("mask", "valid", "view_depth", "cascade_index", "shadow_maps", "normal"),
}


@pytest.fixture(scope="module")
def view():
    scene = csm.scenes.plane_and_box()
    return scene, scene.cameras["corner"].replace(size=SIZE), scene.suns["morning"]


def expected_passes(settings, outputs):
    """What has to run: a view if a pixel is asked for, maps if a map or a mask is."""
    image = set(outputs) & set(OUTPUT_BYTES)
    maps = settings.filter != "none" and {"mask", "shadow_maps"} & set(outputs)
    passes = [("view", None)] if image else []
    passes += [("shadow_map", i) for i in range(settings.cascade_count)] if maps else []
    return passes + ([("shadow_mask", None)] if image else [])


def expected_textures(settings, outputs):
    """Name to bytes."""
    passes = {name for name, _ in expected_passes(settings, outputs)}
    textures = {n: PIXELS * b for n, b in VIEW_TEXTURES.items()} if "view" in passes else {}
    if "shadow_map" in passes:
        texels = settings.cascade_count * settings.map_size**2
        textures["shadow_maps"] = texels * DEPTH_BYTES[settings.depth_format]
    return textures


def expected_bytes(settings, outputs):
    words = dict.fromkeys(outputs, 0) | {n: b for n, b in OUTPUT_BYTES.items() if n in outputs}
    if "valid" in words and "cascade_index" in words:
        words["valid"] = 0
    return sum(expected_textures(settings, outputs).values()) + PIXELS * sum(words.values())


CASES = [
    pytest.param(SETTINGS[s], OUTPUTS[o], id=f"{s}, {o}")
    for s, o in itertools.product(SETTINGS, OUTPUTS)
    if (s, o) != ("none", "maps")
]


@pytest.mark.parametrize(("settings", "outputs"), CASES)
def test_plan_lists_what_is_needed_and_nothing_else(settings, outputs):
    plan = csm.plan(settings, size=SIZE, outputs=outputs)
    passes = expected_passes(settings, outputs)
    assert [(step.name, step.cascade) for step in plan.passes] == passes
    assert {t.name: t.bytes for t in plan.textures} == expected_textures(settings, outputs)
    assert plan.bytes == expected_bytes(settings, outputs)
    # one program per kind of pass: all cascades share theirs
    assert sorted(name for name, _ in plan.programs) == sorted({name for name, _ in passes})
    assert {key for _, key in plan.programs} == {step.program for step in plan.passes}


# every kernel of eight cascades takes seconds to compile on software GL: once is enough
RUN = [case for case in CASES if "eight" not in case.id or case.id.endswith("default")]


@pytest.mark.parametrize(("settings", "outputs"), RUN)
def test_renderer_runs_and_holds_what_the_plan_says(renderer, view, settings, outputs):
    plan = csm.plan(settings, size=SIZE, outputs=outputs)
    frame = renderer.render(*view, settings, outputs=outputs)
    assert frame.info["bytes"] == plan.bytes
    named = [s.name if s.cascade is None else f"{s.name}_{s.cascade}" for s in plan.passes]
    assert list(frame.timings_ms) == [*named, "readback"]
    assert set(frame.outputs) == set(outputs) - (
        {"shadow_maps"} if settings.filter == "none" else set()
    )


def test_points_cost_a_pass_and_their_own_bytes(renderer, view):
    settings = SETTINGS["hard"]
    points = np.zeros((10, 3))
    with_points, without = (
        renderer.render(*view, settings, outputs=("mask",), points=given)
        for given in (points, None)
    )
    assert with_points.timings_ms.keys() - without.timings_ms.keys() == {"shadow_points"}
    # in: place and normal, three floats each; out: visibility, cascade, weight, rounded up to four
    assert with_points.info["bytes"] - without.info["bytes"] == 10 * (3 + 3 + 4) * 4


@pytest.mark.parametrize("outputs", [("shadow_maps",), ("mask",)], ids=["maps", "mask"])
def test_maps_of_d16_take_half_the_bytes_of_the_textures(outputs):
    full, half = (
        csm.plan(csm.ShadowSettings(depth_format=name), outputs=outputs) for name in ("d24", "d16")
    )
    maps = {t.name: t for t in full.textures}["shadow_maps"]
    assert (maps.format, maps.width, maps.height, maps.layers) == ("d24", 2048, 2048, 4)
    assert full.bytes - half.bytes == maps.bytes // 2


def test_textures_that_no_longer_serve_are_freed(fresh_renderer, view):
    renderer = fresh_renderer()

    def objects(settings, outputs):
        renderer.render(*view, settings, outputs=outputs)
        return renderer.info["live_objects"] - renderer.info["programs_compiled"]

    # all buffers exist after the first; from then on only textures come and go
    everything = objects(SETTINGS["hard"], OUTPUTS["all"])
    assert objects(SETTINGS["none"], OUTPUTS["all"]) == everything - 1
    assert objects(SETTINGS["hard"], OUTPUTS["maps"]) == everything - 2
    assert objects(SETTINGS["pcf in d16"], OUTPUTS["all"]) == everything


def test_a_sweep_compiles_each_distinct_program_once_and_again_nothing(fresh_renderer, view):
    renderer = fresh_renderer()
    axes = {
        "cascade_count": (1,),
        "map_size": (16, 24, 32),
        "filter": ("none", "hard", "pcf"),
        "filter_size": (2, 3),
        "slope_bias": (0.0, 1.0),
        "bias": ("auto", "manual"),
    }
    sweep = [
        csm.ShadowSettings(**dict(zip(axes, values, strict=True)))
        for values in itertools.product(*axes.values())
    ]
    keys = {key for s in sweep for _, key in csm.plan(s, size=SIZE, outputs=("mask",)).programs}
    assert 5 < len(keys) < len(sweep)
    for _ in range(2):
        frames = [renderer.render(*view, settings, outputs=("mask",)) for settings in sweep]
        compiled = [frame.info["programs_compiled"] for frame in frames]
        assert renderer.info["programs_compiled"] == len(keys)
    assert not any(compiled)


def test_each_output_compiles_its_own_mask_pass_but_not_its_own_maps():
    keys = {
        name: dict(csm.plan(SETTINGS["hard"], size=SIZE, outputs=outputs).programs)
        for name, outputs in OUTPUTS.items()
    }
    assert len({passes["shadow_map"] for passes in keys.values() if "shadow_map" in passes}) == 1
    masks = [passes["shadow_mask"] for passes in keys.values() if "shadow_mask" in passes]
    # shadow_maps is read back from the texture: "default" and "all" differ by the normal alone
    assert len(set(masks)) == len(masks) == 5


def test_instances_cost_a_word_per_pixel_and_their_own_programs(renderer, view):
    single, *rest = view
    settings = SETTINGS["hard"]
    twice = csm.Scene.merge(single, single.placed((5, 0, 0)))
    without, with_ = (
        csm.plan(settings, size=SIZE, outputs=("mask",), instanced=instanced)
        for instanced in (False, True)
    )
    assert without == csm.plan(settings, size=SIZE, outputs=("mask",))
    assert with_.bytes - without.bytes == 4 * PIXELS
    assert not {key for _, key in with_.programs} & {key for _, key in without.programs}
    for plan, scene in ((without, single), (with_, twice)):
        frame = renderer.render(scene, *rest, settings, outputs=("mask",))
        assert frame.info["bytes"] == plan.bytes


def test_plan_prints_its_passes_textures_and_bytes():
    settings = csm.ShadowSettings(cascade_count=2, map_size=64)
    lines = str(csm.plan(settings, size=(8, 4), outputs=("mask",))).splitlines()
    assert lines[0] == f"4 passes, 3 programs, {8 * 4 * 12 + 2 * 64 * 64 * 4:,} bytes"
    assert [line.split()[1] for line in lines if line.split()[0] == "pass"] == [
        "view", "shadow_map", "shadow_map", "shadow_mask",
    ]  # fmt: skip
    assert "  texture  shadow_maps d32f 64 x 64 x 2: 32,768 bytes" in lines
    assert "  buffers  128 bytes" in lines
