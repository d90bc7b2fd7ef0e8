"""Any thread may use or close a renderer; scenes and renderers that nobody holds leave nothing."""

import gc
import os
import subprocess
import sys
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import small_scenes

import csm

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps", "normal")
SUN = csm.Sun((0.4, 1.0, 0.3))


def jobs(count):
    """(scene, camera, settings): a different one each, of few scenes."""
    scenes = [make() for make in small_scenes.SCENES.values()]
    return [
        (
            scenes[number % 4],
            small_scenes.camera(number // 2 % 4),
            csm.ShadowSettings(
                map_size=(64, 128, 96)[number % 3],
                filter=("hard", "pcf")[number % 2],
                depth_format=("d32f", "d16")[number // 4 % 2],
            ),
        )
        for number in range(count)
    ]


def draw(renderer, job, **more):
    scene, camera, settings = job
    return renderer.render(scene, camera, SUN, settings, outputs=OUTPUTS, **more)


def bits_of(frame):
    return {name: getattr(frame, name).tobytes() for name in OUTPUTS}


# -- threads ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [2, 5])
def test_threads_on_one_renderer_get_the_bits_of_one_thread(renderer, threads):
    work = jobs(12)
    alone = [bits_of(draw(renderer, job)) for job in work]
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(2):
            together = list(pool.map(lambda job: bits_of(draw(renderer, job)), work))
            assert together == alone


def test_renderers_in_threads_of_their_own(fresh_renderer):
    work = jobs(8)
    alone = [bits_of(draw(fresh_renderer(), job)) for job in work]
    failures = []

    def run(renderer):
        for _ in range(5):
            for job, expected in zip(work, alone, strict=True):
                if bits_of(draw(renderer, job)) != expected:
                    failures.append(job)

    workers = [threading.Thread(target=run, args=(fresh_renderer(),)) for _ in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert not failures


def test_a_renderer_made_in_one_thread_used_in_another_closed_in_a_third():
    job = jobs(1)[0]
    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(1) as two, ThreadPoolExecutor(1) as three:
        renderer = one.submit(csm.Renderer, "egl", debug=True).result()
        here = bits_of(draw(renderer, job))
        assert two.submit(lambda: bits_of(draw(renderer, job))).result() == here
        three.submit(renderer.close).result()
        with pytest.raises(csm.ContextError, match="renderer is closed"):
            one.submit(draw, renderer, job).result()


def test_closing_while_another_thread_renders():
    # Each render is finished or refused, never half done.
    job = jobs(2)[1]
    for delay in (0.0, 0.01, 0.05):
        renderer = csm.Renderer("egl", debug=True)
        expected = bits_of(draw(renderer, job))
        done, refused, started = [], [], threading.Event()

        def run(renderer=renderer, done=done, refused=refused, started=started):
            try:
                while True:
                    done.append(bits_of(draw(renderer, job)))
                    started.set()
            except csm.ContextError as error:
                refused.append(str(error))

        workers = [threading.Thread(target=run) for _ in range(2)]
        for worker in workers:
            worker.start()
        started.wait(20)
        threading.Event().wait(delay)
        renderer.close()
        renderer.close()
        for worker in workers:
            worker.join(20)
            assert not worker.is_alive()
        assert refused == ["renderer is closed"] * 2
        assert done
        assert all(bits == expected for bits in done)


def test_other_python_threads_run_while_a_frame_is_rendered(renderer):
    # The interpreter's lock is free during the work in C: another thread counts meanwhile.
    scene = csm.scenes.plane_and_box()
    camera = scene.cameras["corner"].replace(size=(640, 360))
    settings = csm.ShadowSettings(map_size=2048, filter="pcf", filter_size=15)
    renderer.render(scene, camera, SUN, settings, outputs=("mask",))
    counted, stop = [0], threading.Event()

    def count():
        while not stop.is_set():
            counted[0] += 1

    counter = threading.Thread(target=count)
    counter.start()
    try:
        before = counted[0]
        for _ in range(3):
            renderer.render(scene, camera, SUN, settings, outputs=("mask",))
        ran = counted[0] - before
    finally:
        stop.set()
        counter.join()
    # Held throughout, the lock would change hands about three times, between the renders.
    assert ran > 10_000


# -- one frame in the arrays of another ------------------------------------------------------------


def test_out_is_written_again_and_shared(renderer):
    first, second = jobs(9)[0], jobs(9)[4]
    expected = bits_of(draw(renderer, second))
    frame = draw(renderer, first)
    again = renderer.render(second[0], second[1], SUN, first[2], outputs=OUTPUTS, out=frame)
    assert all(np.shares_memory(getattr(again, n), getattr(frame, n)) for n in OUTPUTS)
    fresh = renderer.render(second[0], second[1], SUN, first[2], outputs=OUTPUTS)
    assert bits_of(again) == bits_of(fresh)
    assert expected != bits_of(fresh), "other settings, other picture"


def test_a_frame_outlives_its_renderer():
    renderer = csm.Renderer("egl", debug=True)
    frame = draw(renderer, jobs(1)[0])
    before = bits_of(frame)
    renderer.close()
    del renderer
    gc.collect()
    assert bits_of(frame) == before


# -- scenes that are gone --------------------------------------------------------------------------


def test_objects_of_a_dropped_scene_are_freed(fresh_renderer):
    renderer = fresh_renderer()
    job = jobs(1)[0]
    draw(renderer, job)
    before = renderer.info["live_objects"]
    for _ in range(5):
        copy = csm.Scene.from_arrays(*job[0].flatten())
        draw(renderer, (copy, *job[1:]))
        assert renderer.info["live_objects"] > before
        del copy
        gc.collect()
        assert renderer.info["live_objects"] == before


def test_a_scene_dropped_in_another_thread_is_freed(fresh_renderer):
    renderer = fresh_renderer()
    job = jobs(1)[0]
    draw(renderer, job)
    before = renderer.info["live_objects"]
    copies = [csm.Scene.from_arrays(*job[0].flatten()) for _ in range(4)]
    for copy in copies:
        draw(renderer, (copy, *job[1:]))
    del copy
    worker = threading.Thread(target=lambda: (copies.clear(), gc.collect()))
    worker.start()
    while worker.is_alive():
        draw(renderer, job)
    worker.join()
    assert renderer.info["live_objects"] == before


def test_a_scene_is_uploaded_once_per_renderer(fresh_renderer):
    one, two = fresh_renderer(), fresh_renderer()
    job = jobs(1)[0]
    draw(one, job)
    draw(two, job)
    counts = one.info["live_objects"], two.info["live_objects"]
    for _ in range(3):
        draw(one, job)
        draw(two, job)
    assert (one.info["live_objects"], two.info["live_objects"]) == counts


def test_many_scenes_do_not_grow_the_process(fresh_renderer):
    renderer = fresh_renderer()
    positions, triangles = csm.scenes.town(20_000).flatten()
    camera, settings = small_scenes.camera(0, (64, 36)), csm.ShadowSettings(map_size=64)

    def resident():
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    def use():
        scene = csm.Scene.from_arrays(positions, triangles)
        return renderer.render(scene, camera, SUN, settings, outputs=("mask",)).info["scene_bytes"]

    for _ in range(5):
        size = use()
    before = resident()
    for _ in range(30):
        use()
    # Thirty scenes kept would be thirty times their size; the allocator may hold on to some.
    assert resident() - before < 6 * size


# -- renderers that are gone -----------------------------------------------------------------------


def test_an_unclosed_renderer_warns_and_is_closed():
    renderers = [csm.Renderer("egl")]
    draw(renderers[0], jobs(1)[0])
    with pytest.warns(ResourceWarning, match="unclosed <csm.Renderer egl"):
        renderers.clear()


def test_a_closed_renderer_warns_of_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with csm.Renderer("egl") as renderer:
            draw(renderer, jobs(1)[0])
        del renderer
        gc.collect()


@pytest.mark.parametrize("ending", ["", "sys.exit(0)", "import os; os._exit(0)"])
def test_a_process_may_end_with_a_renderer_open(ending):
    code = f"import sys, csm; kept = csm.Renderer(); {ending}"
    result = subprocess.run(
        [sys.executable, "-W", "ignore::ResourceWarning", "-c", code],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


DYING_OFF_THE_MAIN_THREAD = """
import gc, threading, warnings
import csm
from csm import renderer as module

warnings.simplefilter("ignore", ResourceWarning)
kept = [csm.Renderer("glfw")]

def drop():
    kept.clear()
    gc.collect()
    assert len(module._orphans) == 1, "its window waits for the main thread"

worker = threading.Thread(target=drop)
worker.start()
worker.join()
assert len(module._orphans) == 1
with csm.Renderer("glfw"):
    assert not module._orphans, "the next one opened on the main thread closes it"
print("closed")
"""


def test_a_glfw_renderer_that_dies_off_the_main_thread_waits_for_it():
    if not os.environ.get("DISPLAY"):
        pytest.skip("GLFW needs a display: run under xvfb-run")
    result = subprocess.run(
        [sys.executable, "-c", DYING_OFF_THE_MAIN_THREAD],
        capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert result.stdout == "closed\n"
