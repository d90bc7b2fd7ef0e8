"""Memory: what fails keeps none, and what the driver has not is said."""

import os

import numpy as np
import pytest

import csm

SETTINGS = csm.ShadowSettings(map_size=64)


@pytest.fixture(scope="module")
def view():
    scene = csm.scenes.plane_and_box()
    return scene, scene.cameras["corner"].replace(size=(32, 18)), scene.suns["diagonal"]


@pytest.mark.parametrize("debug", [True, False])
def test_memory_that_the_driver_has_not_is_a_memory_error(fresh_renderer, view, debug):
    renderer = fresh_renderer(debug=debug)
    expected = renderer.render(*view, SETTINGS).mask
    side = renderer.info["max_texture_size"]
    if not renderer.info["software"] or side < 16384:
        pytest.skip("only of software GL is it known that it refuses 8 GiB of maps")
    huge = csm.ShadowSettings(map_size=side, cascade_count=8)
    live = renderer.info["live_objects"]
    with pytest.raises(MemoryError, match="shadow_maps: the driver is out of memory"):
        renderer.render(*view, huge, outputs=("mask",))
    assert renderer.info["live_objects"] <= live
    assert np.array_equal(renderer.render(*view, SETTINGS).mask, expected)


@pytest.mark.skipif(
    "asan" in os.environ.get("LD_PRELOAD", ""), reason="a sanitizer holds freed memory back"
)
def test_failures_keep_no_memory(fresh_renderer, view):
    """Each failing call holds arrays of 800 kB when it fails; kept, they would be 80 MB a kind."""
    renderer = fresh_renderer()
    core, handle = renderer._core, renderer._uploaded(renderer._core, view[0])
    fit = (view[1], view[2].to_light, SETTINGS, view[0].bounds.ravel(), None)
    points = np.zeros((33_333, 3), np.float32)  # converted to doubles in a copy
    good, poor = (
        (points, np.array([triangle], np.int32)) for triangle in ((0, 1, 2), (0, 1, 99_999))
    )

    def upload(*meshes):
        count = len(meshes)
        return core.upload(
            meshes, np.arange(count, dtype=np.int32), [np.eye(4)] * count, np.zeros(3)
        )

    def render(mask, points, normals):
        return core.render(handle, *fit, 1, {"mask": mask}, points, normals, 0.0)

    small, flat = np.zeros(3, np.float32), points[:, :2]
    failures = {
        "triangles of mesh 0 must index": lambda: upload(poor),
        "triangles of mesh 1 must index": lambda: upload(good, poor),
        "positions: expected shape": lambda: upload(good, (flat, good[1])),
        "triangles: expected shape": lambda: upload(good, (points, np.zeros((9, 2), np.int32))),
        "out: mask must be": lambda: render(small, points, points),
        "points: expected shape": lambda: render(small, flat, None),
        "normals: expected shape": lambda: render(small, points, flat),
    }

    def resident():
        with open("/proc/self/statm") as pages:
            return int(pages.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    for text, fail in failures.items():
        for repeat in range(110):
            with pytest.raises(ValueError, match=text):
                fail()
            if repeat == 9:
                before = resident()
        assert resident() - before < 20e6
