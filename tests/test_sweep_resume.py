"""Sweeps that are killed, interrupted, shared out: the same numbers to the bit, none twice."""

import collections
import json
import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("embreex", reason="sweeps need the extra truth")
pytest.importorskip("xarray", reason="sweeps need the extra sweep")
pytest.importorskip("netCDF4", reason="sweeps need the extra sweep")

import xarray

import csm
from csm import sweep_runs, sweep_worker
from csm.sweep_cases import cases_of

TIMES = ("ms_", "frames")
SCRIPT = """
import sys
import csm

def main(folder, lams, sizes, processes):
    csm.sweep(
        {"box": ("plane_and_box", "corner", "diagonal"), "stairs": ("stairs", None, None)},
        {"lam": [i / lams for i in range(lams)], "map_size": [16 + 4 * i for i in range(sizes)]},
        base=csm.ShadowSettings(cascade_count=2),
        out=folder, size=(32, 24), repeats=1, processes=processes,
    )

if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
"""


@pytest.fixture(scope="module", autouse=True)
def gl():
    """Skip where no back end opens."""
    try:
        csm.Renderer().close()
    except csm.ContextError as error:
        pytest.skip(f"no OpenGL here: {error}")


class Run:
    """The script at work in a process of its own; `shape` is (lams, sizes) of its axes."""

    def __init__(self, tmp_path, folder, shape, processes=1):
        script = tmp_path / "script.py"
        script.write_text(SCRIPT)
        self.journal = folder / "journal.jsonl"
        words = [str(folder), *map(str, shape), str(processes)]
        self.process = subprocess.Popen(
            [sys.executable, str(script), *words], stderr=subprocess.PIPE, text=True
        )

    def whole_lines(self):
        text = self.journal.read_text() if self.journal.exists() else ""
        return text[: text.rfind("\n") + 1].splitlines()

    def wait_for(self, count):
        """Wait until so many lines are there; their number, or None if it ended before."""
        start = time.monotonic()
        while len(self.whole_lines()) < count:
            assert time.monotonic() - start < 100
            if self.process.poll() is not None:
                return None
            time.sleep(0.001)
        return len(self.whole_lines())

    def end(self, sent=None):
        """Its return code, after a signal if one is given."""
        if sent is not None:
            self.process.send_signal(sent)
        _, self.errors = self.process.communicate(timeout=110)
        return self.process.returncode


def without_times(dataset):
    timed = [name for name in dataset if name.startswith(TIMES)]
    return dataset.drop_vars(timed).drop_attrs(deep=False)


def swept_at_once(tmp_path, shape):
    folder = tmp_path / "at once"
    assert Run(tmp_path, folder, shape).end() == 0
    return without_times(xarray.load_dataset(folder / "sweep.nc"))


def is_alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def assert_gone(pids):
    start = time.monotonic()
    while any(map(is_alive, pids)):
        assert time.monotonic() - start < 20, "a worker outlives its sweep"
        time.sleep(0.05)


def kill_and_resume(tmp_path, shape, kills, processes=1, seed=1):
    """Kill a sweep at random moments, each further on, and let it end; its folder."""
    folder, chance = tmp_path / "killed", random.Random(seed)
    count = 2 * shape[0] * shape[1]
    kept, workers = [], set()
    for number in range(kills):
        run = Run(tmp_path, folder, shape, processes)
        left = count - len(kept)
        # A moment among the points that are left, and within one. Before the last third of them: a
        # sweep that others slow down may else be at its end before it is killed.
        run.wait_for(len(kept) + chance.randrange(1, max(2, 2 * left // (kills - number + 2))))
        time.sleep(chance.uniform(0.0, 0.02))
        assert run.end(signal.SIGKILL) == -signal.SIGKILL, f"it ended before kill {number}"
        now = run.whole_lines()
        assert now[: len(kept)] == kept, "what was there before is there as it was"
        kept = now
        workers |= {json.loads(line)["process"] for line in now}
    assert 0 < len(kept) < count
    assert_gone(workers)
    run = Run(tmp_path, folder, shape, processes)
    assert run.end() == 0
    lines = run.whole_lines()
    assert lines[: len(kept)] == kept
    times_computed = collections.Counter(json.loads(line)["key"] for line in lines)
    assert len(times_computed) == count
    assert set(times_computed.values()) == {1}, "a point was computed twice"
    return folder


def test_killed_and_resumed_it_is_the_same(tmp_path):
    shape = (4, 6)
    folder = kill_and_resume(tmp_path, shape, kills=2)
    found = xarray.load_dataset(folder / "sweep.nc")
    assert without_times(found).identical(swept_at_once(tmp_path, shape))
    assert (found.status == "ok").all()
    assert len(np.unique(found.error_total)) > 20


@pytest.mark.slow
def test_killed_with_its_workers_it_is_the_same(tmp_path):
    shape = (4, 8)
    folder = kill_and_resume(tmp_path, shape, kills=1, processes=2)
    found = xarray.load_dataset(folder / "sweep.nc")
    assert without_times(found).identical(swept_at_once(tmp_path, shape))


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("processes", [1, 2])
def test_500_points_killed_five_times(tmp_path, processes):
    shape = (25, 10)
    folder = kill_and_resume(tmp_path, shape, kills=5, processes=processes)
    found = xarray.load_dataset(folder / "sweep.nc")
    assert found.status.size == 500
    assert without_times(found).identical(swept_at_once(tmp_path, shape))


@pytest.mark.parametrize("processes", [1, 2])
def test_interrupted_it_keeps_what_is_finished(tmp_path, processes):
    run = Run(tmp_path, tmp_path / "out", (10, 10), processes)
    run.wait_for(9)
    status = run.end(signal.SIGINT)
    lines = [json.loads(line) for line in run.whole_lines()]
    assert status != 0
    assert "KeyboardInterrupt" in run.errors
    assert 9 <= len(lines) < 200
    assert run.journal.read_text().endswith("\n")
    assert len({line["key"] for line in lines}) == len(lines)
    assert_gone({line["process"] for line in lines})


# ------------------------------------------------------------------------------- in other processes


CASES = {"box": ("plane_and_box", "corner", "diagonal"), "foot": ("plane_and_box", "contact", None)}


def sweep_small(**more):
    scene = csm.scenes.stairs(5)
    given = (scene, next(iter(scene.cameras.values())), csm.Sun((0.3, 1.0, 0.7)))
    axes = {"map_size": [32, 48, 64], "lam": [0.2, 0.5, 0.8], "filter_size": [3, 4]}
    return csm.sweep({**CASES, "given": given}, axes, base=csm.ShadowSettings(filter="pcf"),
                     size=(32, 24), repeats=1, **more)  # fmt: skip


@pytest.mark.slow
def test_in_processes_it_is_the_same(tmp_path):
    here = sweep_small()
    there = sweep_small(processes=2, out=tmp_path)
    assert without_times(there).identical(without_times(here))
    assert (here.status == "ok").sum() == 27
    lines = [json.loads(line) for line in (tmp_path / "journal.jsonl").read_text().splitlines()]
    workers = {line["process"] for line in lines}
    assert os.getpid() not in workers
    assert len(workers) <= 2
    assert there.attrs["measured_by"] == "2 processes at once"
    assert there.attrs["stage_used"] in ("compute", "fragment"), "the same for all workers"
    assert_gone(workers)


@pytest.fixture(scope="module")
def client(gl):
    if os.environ.get("CSM_BACKEND") == "glfw":
        pytest.skip("GLFW opens on a main thread, Dask's tasks are not on it")
    distributed = pytest.importorskip("distributed", reason="Dask is the extra cluster")
    pytest.importorskip("dask", reason="Dask is the extra cluster")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as found,
    ):
        yield found


def test_on_dask_it_is_the_same(client, tmp_path):
    here = sweep_small()
    there = sweep_small(client=client, out=tmp_path)
    assert without_times(there).identical(without_times(here))
    assert there.attrs["measured_by"] == "workers of Dask, 2 at once"
    assert there.attrs["stage_used"] in ("compute", "fragment"), "the same for all workers"
    lines = [json.loads(line) for line in (tmp_path / "journal.jsonl").read_text().splitlines()]
    assert len({line["process"] for line in lines}) == 2
    assert os.getpid() not in {line["process"] for line in lines}
    # One renderer for each worker, closed when the sweep is over.
    assert set(client.run(_renderers_open).values()) == {0}
    with pytest.raises(ValueError, match="processes and client exclude each other"):
        sweep_small(client=client, processes=2)


def _renderers_open():
    from csm import renderer

    return sum(one._core is not None for one in renderer._alive)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_500_points_on_dask(client, tmp_path):
    shape = (25, 10)
    cases = {"box": ("plane_and_box", "corner", "diagonal"), "stairs": ("stairs", None, None)}
    axes = {"lam": [i / 25 for i in range(25)], "map_size": [16 + 4 * i for i in range(10)]}
    there = csm.sweep(cases, axes, base=csm.ShadowSettings(cascade_count=2), size=(32, 24),
                      repeats=1, client=client)  # fmt: skip
    assert there.status.size == 500
    assert without_times(there).identical(swept_at_once(tmp_path, shape))


# ------------------------------------------------------------------------------ a worker that dies


class Deadly:
    """Settings that kill a process that unpacks them, other than where they come from."""

    def __reduce__(self):
        return _die_elsewhere, (os.getpid(),)  # Dask's scheduler unpacks them in this process


def _die_elsewhere(home):
    if os.getpid() != home:
        os._exit(1)
    return Deadly()


def work_with_a_death():
    (case,) = cases_of({"box": CASES["box"]}, (32, 24))
    truth = csm.truth(case.scene, case.camera, case.sun)
    jobs = [sweep_worker.Job(f"good {i}", csm.ShadowSettings(map_size=16 + i)) for i in range(11)]
    jobs.insert(2, sweep_worker.Job("deadly", Deadly()))
    return [(case, truth, jobs)], sweep_worker.Options(("total",), 1, "auto", "auto")


def test_processes_that_begin_are_deaf_to_an_interrupt(tmp_path):
    """Ctrl-C goes to all of a terminal's processes, those still importing among them."""
    script = tmp_path / "pool.py"
    script.write_text(
        "import os, signal, time\n"
        "from csm.sweep_runs import PoolWorkers\n"
        "if __name__ == '__main__':\n"
        "    with PoolWorkers(1) as workers:\n"
        "        future = workers._submit(os.getpid)\n"
        "        (child,) = workers._pool._processes\n"
        "        os.kill(child, signal.SIGINT)\n"
        "        assert future.result() == child\n"
        "        os.kill(child, signal.SIGINT)\n"
        "        assert workers.ask(os.getpid) == child\n"
    )
    ran = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert (ran.returncode, ran.stderr) == (0, "")


def test_a_point_that_kills_its_process_is_lost_alone():
    landed = []
    sweep_runs.run_on(sweep_runs.PoolWorkers(2), *work_with_a_death(), landed.append)
    status = {record["key"]: record["status"] for record in landed}
    assert status == {"deadly": "lost", **{f"good {i}": "ok" for i in range(11)}}
    assert len(landed) == 12
    (lost,) = (record for record in landed if record["status"] == "lost")
    assert "died" in lost["message"]


@pytest.mark.slow  # Dask waits a second for each of the workers that die
def test_a_point_that_kills_a_worker_of_dask_is_lost_alone(client):
    landed = []
    sweep_runs.run_on(sweep_runs.DaskWorkers(client), *work_with_a_death(), landed.append)
    status = {record["key"]: record["status"] for record in landed}
    assert status == {"deadly": "lost", **{f"good {i}": "ok" for i in range(11)}}
