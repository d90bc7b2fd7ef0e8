"""Ctrl-C in the middle of long work: a KeyboardInterrupt soon, and a renderer that goes on."""

import os
import subprocess
import sys

import pytest

# Runs `work` until SIGINT arrives from a timer thread; says when it came and when it was noticed.
# Then renders a small frame that must equal the one from before.
SCRIPT = """
import os, signal, sys, threading, time
import numpy as np
import csm

scene = csm.scenes.plane_and_box()
camera, sun = scene.cameras["corner"].replace(size=(160, 90)), scene.suns["diagonal"]
settings = csm.ShadowSettings(map_size=256)
renderer = csm.Renderer(debug=True)
before = renderer.render(scene, camera, sun, settings)
sent = [None]

def interrupt(delay):
    time.sleep(delay)
    sent[0] = time.perf_counter()
    os.kill(os.getpid(), signal.SIGINT)

def interrupted(work, delay):
    timer = threading.Thread(target=interrupt, args=(delay,))
    timer.start()
    try:
        while True:
            work()
    except KeyboardInterrupt:
        noticed = time.perf_counter()
    timer.join()
    print(f"noticed after {noticed - sent[0]:.3f} s", flush=True)
    return noticed - sent[0]

%s

after = renderer.render(scene, camera, sun, settings)
for name in ("mask", "valid", "view_depth", "cascade_index", "shadow_maps"):
    assert getattr(after, name).tobytes() == getattr(before, name).tobytes(), name
assert not [m for m in renderer._core.messages() if m[1] in ("high", "medium")]
renderer.close()
print("as before")
"""

LARGE_MAPS = """
town = csm.scenes.town(200_000)
large = csm.ShadowSettings(cascade_count=8, map_size=8192, depth_format="d16")
view = town.cameras["street"].replace(size=(320, 180))
lag = max(interrupted(lambda: renderer.render(town, view, sun, large, outputs=("mask",)), delay)
          for delay in (0.3, 0.9, 1.6))
"""

LARGE_KERNEL = """
kernel = csm.ShadowSettings(map_size=1024, filter="pcf", filter_size=33)
view = camera.replace(size=(3840, 2160))
lag = max(interrupted(lambda: renderer.render(scene, view, sun, kernel, outputs=("mask",)), delay)
          for delay in (0.2, 0.8, 1.5))
"""

MANY_TRIANGLES = """
forest = csm.scenes.forest(6000)
many = csm.ShadowSettings(cascade_count=8, cull="none")
view = forest.cameras["path"].replace(size=(320, 180))
lag = max(interrupted(lambda: renderer.render(forest, view, sun, many, outputs=("mask",)), delay)
          for delay in (0.3, 0.9, 1.7))
"""

MANY_POINTS = """
kernel = csm.ShadowSettings(map_size=512, filter="pcf", filter_size=33)
cloud = np.random.default_rng(0).uniform(-3, 3, (4_000_000, 3))
lag = max(interrupted(lambda: renderer.render(scene, camera, sun, kernel, points=cloud), delay)
          for delay in (0.7, 1.3, 2.0))
"""

MANY_INSTANCES = """
random = np.random.default_rng(1)
mesh = csm.Mesh(random.normal(size=(100, 3)), random.integers(0, 100, (190, 3)))
places = np.tile(np.eye(4), (30_000, 1, 1))
places[:, :3, 3] = random.uniform(-200, 200, (30_000, 3))
cloud = csm.Scene([mesh], np.zeros(30_000, np.int32), places)
view = csm.Camera.look_at((0, 0, 400), (0, 0, 0), far=1000, size=(640, 360))
renderer.render(cloud, view, sun, settings)
lag = max(interrupted(lambda: renderer.render(cloud, view, sun), delay)
          for delay in (0.2, 0.6, 1.1))
"""

UPLOAD = """
grid = np.add.outer(np.arange(1500.0) % 7, np.arange(1500.0) % 5)
terrain = csm.Scene.from_elevation(grid, 1.0)
def work():
    csm.Renderer(debug=True).render(terrain, camera, sun, settings)
import warnings
warnings.simplefilter("ignore", ResourceWarning)
lag = interrupted(work, 0.4)
"""

TRUTH = """
town = csm.scenes.town(50_000)
view, soft = town.cameras["street"].replace(size=(1280, 720)), csm.Sun(sun.to_light, 5.0)
csm.truth(town, camera, sun)
lag = max(interrupted(lambda: csm.truth(town, view, soft, rays_per_pixel=256), delay)
          for delay in (0.2, 1.0))
"""

# Embree builds a tree in one call that holds the interpreter, half a second per million triangles:
# what a second allows ends near two million.
TREE = """
grid = np.add.outer(np.arange(700.0) % 7, np.arange(700.0) % 5)
def work():
    csm.truth(csm.Scene.from_elevation(grid, 1.0), camera, sun)
lag = interrupted(work, 1.0)
"""


def run(work):
    environment = {**os.environ, "LP_NUM_THREADS": os.environ.get("LP_NUM_THREADS", "2")}
    result = subprocess.run(
        [sys.executable, "-c", SCRIPT % work],
        capture_output=True, text=True, timeout=100, check=False, env=environment,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert result.stdout.endswith("as before\n")
    return [float(line.split()[2]) for line in result.stdout.splitlines() if "noticed" in line]


@pytest.mark.parametrize(
    "work",
    [
        LARGE_MAPS, LARGE_KERNEL, MANY_TRIANGLES, MANY_POINTS, MANY_INSTANCES, UPLOAD, TRUTH, TREE,
    ],
    ids=[
        "large maps", "large kernel", "many triangles", "many points", "many instances", "upload",
        "truth", "tree",
    ],
)  # fmt: skip
def test_an_interrupt_is_noticed_and_leaves_a_usable_renderer(work):
    # The promise is a second. A loaded machine is not ours to judge, so a case may try three times:
    # work that never looks up is late each time.
    for _ in range(3):
        lags = run(work)
        print(f"noticed after {', '.join(f'{lag:.2f}' for lag in lags)} s")
        assert lags
        if max(lags) <= 1.0:
            return
    pytest.fail(f"noticed after {max(lags):.2f} s, three times over a second")
