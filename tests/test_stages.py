"""Passes over pixels and texels in compute and as fragments: the same bits, and the faster one."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest
import small_scenes

import csm
from csm import _core, stages
from csm.plans import OUTPUTS

FILTERS = next(row for row in _core.effect_table() if row["name"] == "filter")["choices"].split()
STORAGES = (
    {},
    {"storage": "atlas", "tile_border": 2, "map_size": (64, 48)},
    {"storage": "separate", "reversed_depth": True},
    {"storage": "cube", "depth_format": "d16"},
)
# Each filter once, and what else has code of its own in the passes that have two entries.
CASES = {
    **{name: {"filter": name, **STORAGES[i % 4]} for i, name in enumerate(FILTERS)},
    "pcf 2x2": {"filter": "pcf", "filter_size": 2, **STORAGES[1]},
    "pcf by taps": {"filter": "pcf", "filter_fetch": "taps", "filter_weights": "gaussian"},
    "pcss variance": {"filter": "pcss", "pcss_map": "variance"},
    "pcss summed": {"filter": "pcss", "pcss_map": "summed"},
    "samples": {"filter": "vsm", "samples": 4, "moment_format": "float16"},
    "anisotropic": {"filter": "evsm4", "lookup": "anisotropic", "gradients": "analytic"},
    "both steps": {
        "filter": "evsm4",
        "lookup": "trilinear",
        "gradients": "analytic",
        "plane": "derivatives",
    },
    "one size of blur in metres": {"filter": "evsm2", "kernel": "world", "filter_weights": "tent"},
    "warped": {"filter": "pcf", "warp": "lispsm", "blend": "smooth"},
    "dithered": {"filter": "poisson", "rotated": True, "blend": "dither", "fade_width": 0.5},
    "seen": {"filter": "hard", "fit": "visible", "turned": True, "split": "sdsm"},
}


@pytest.fixture(scope="module")
def renderers():
    made = [csm.Renderer(debug=True, stage=stage) for stage in stages.STAGES]
    yield made
    for renderer in made:
        complaints = [m for m in renderer._core.messages() if m[1] in ("high", "medium")]
        renderer.close()
        assert not complaints


@pytest.mark.parametrize("case", CASES)
def test_both_stages_give_the_same_bits(renderers, case):
    settings = csm.ShadowSettings(cascade_count=2, **{"map_size": 64, **CASES[case]})
    scene = small_scenes.soup() if len(case) % 2 else small_scenes.copies()
    camera = small_scenes.camera(len(case) % 4, size=(37, 21))  # no multiple of a group
    sun = csm.Sun(small_scenes.SUNS["high"], angular_diameter_deg=2.0)
    outputs = OUTPUTS if settings.filter != "none" else OUTPUTS[:-1]
    compute, fragment = (
        renderer.render(scene, camera, sun, settings, outputs=outputs) for renderer in renderers
    )
    assert (compute.info["stage"], fragment.info["stage"]) == ("compute", "fragment")
    assert compute.outputs == fragment.outputs
    if settings.filter != "none":
        assert np.ptp(compute.mask[compute.valid]) > 0.5
    for name in compute.outputs:
        of_compute, of_fragment = getattr(compute, name), getattr(fragment, name)
        for one, other in zip(of_compute, of_fragment, strict=True):
            assert np.array_equal(one, other, equal_nan=True), name


def test_stages_have_programs_of_their_own_and_the_same_plan(renderers):
    settings = csm.ShadowSettings(cascade_count=1, map_size=32, filter="vsm")
    for renderer in renderers:
        frame = renderer.render(
            small_scenes.soup(), small_scenes.camera(size=(8, 8)), csm.Sun((0.3, 1, 0.2)), settings,
            outputs=("mask",),
        )  # fmt: skip
        assert frame.info["bytes"] == csm.plan(settings, size=(8, 8), outputs=("mask",)).bytes
        assert frame.info["stage"] == renderer.info["stage"]


# -- the faster one --------------------------------------------------------------------------------


def test_auto_is_what_the_timing_says_and_is_asked_once(monkeypatch, fresh_renderer):
    asked = []

    def times(core):
        asked.append(core)
        return {"compute": [9.0, 1.0, 7.0], "fragment": [5.0, 0.7, 6.0]}

    monkeypatch.setattr(stages, "_known", {})
    monkeypatch.setattr(stages, "_times", times)
    first = fresh_renderer()
    assert first.info["stage"] == "fragment"
    monkeypatch.setattr(stages, "_times", lambda core: pytest.fail("timed again"))
    assert fresh_renderer().info["stage"] == "fragment"
    assert fresh_renderer(stage="compute").info["stage"] == "compute"
    assert len(asked) == 1
    with pytest.raises(csm.ContextError, match="closed"):
        asked[0].describe()  # the timing's context is gone


def test_a_named_stage_times_nothing(monkeypatch, fresh_renderer):
    monkeypatch.setattr(stages, "_known", {})
    monkeypatch.setattr(stages, "_times", lambda core: pytest.fail("timed"))
    for stage in stages.STAGES:
        assert fresh_renderer(stage=stage).info["stage"] == stage


@pytest.mark.parametrize(
    ("compute", "fragment", "faster"),
    [
        ([2.0, 9.0], [1.0, 30.0], "fragment"),  # by the least: noise only adds
        ([1.0, 9.0], [2.0, 2.0], "compute"),
        ([1.0], [0.95], "compute"),  # within noise it stays
        ([1.0], [0.85], "fragment"),
    ],
)
def test_the_faster_stage_is_that_of_the_least_time(compute, fragment, faster):
    assert stages._faster_of({"compute": compute, "fragment": fragment}) == faster


def test_the_timing_leaves_the_renderer_untouched(fresh_renderer, monkeypatch):
    named = fresh_renderer(stage="compute").info
    monkeypatch.setattr(stages, "_known", {})
    timed = fresh_renderer().info
    assert timed["stage"] in stages.STAGES
    assert {**timed, "stage": ""} == {**named, "stage": ""}  # objects and programs too


def test_the_timing_is_quick():
    """In a process of its own, without a shader cache; the bound is loose for busy machines."""
    code = (
        "import time, csm\n"
        "from csm import stages\n"
        "times, seconds = stages._times, []\n"
        "def timed(core):\n"
        "    start = time.process_time(); found = times(core)\n"
        "    seconds.append(time.process_time() - start); return found\n"
        "stages._times = timed\n"
        "csm.Renderer().close()\n"
        "print(*seconds)\n"
    )
    environment = {**os.environ, "MESA_SHADER_CACHE_DISABLE": "true"}
    found = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    (seconds,) = map(float, found.stdout.split())
    assert seconds < 0.9  # of all cores together; a third of it on an idle machine


def test_a_stage_is_one_of_three():
    start = time.perf_counter()
    with pytest.raises(ValueError, match="stage must be one of auto, compute, fragment"):
        csm.Renderer(stage="pixel")
    assert time.perf_counter() - start < 0.5  # before a context is made
