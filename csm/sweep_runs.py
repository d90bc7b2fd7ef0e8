"""Who measures a sweep's points: this process, a pool of processes, or the workers of Dask.

A task is a few points of one case, timed in turns. What a worker that dies leaves undone is tried
again, point by point and one at a time, so that the blame falls on the point that earned it.
"""

import concurrent.futures
import contextlib
import dataclasses
import multiprocessing
import os
import pickle
import signal
import tempfile
import threading
import weakref
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection
from pathlib import Path

from .renderer import Renderer
from .sweep_journal import LOST, blank_record
from .sweep_worker import measure, packed, release, run_task, stage_of

__all__ = ["DaskWorkers", "PoolWorkers", "run_here", "run_on"]

DIED = "the process that worked on this point alone died, as one did before: out of memory?"
GROUP = 8  # points timed in turns: enough to share what drifts, few enough to lose to a kill


def groups(jobs):
    """Cut a list of jobs into tasks."""
    return [jobs[first : first + GROUP] for first in range(0, len(jobs), GROUP)]


def run_here(work, options, land):
    """Measure in this process.

    Parameters
    ----------
    work : iterable of (Case, Truth, list of Job)
    options : Options
    land : callable
        Takes each record as soon as there is one.
    """
    with Renderer(options.backend, stage=options.stage) as renderer:
        for _, truth, jobs in work:
            for group in groups(jobs):
                for record in measure(renderer, truth, group, options):
                    land(record)


def run_on(workers, work, options, land):
    """Measure on workers.

    Parameters
    ----------
    workers : PoolWorkers or DaskWorkers
    work : iterable of (Case, Truth, list of Job)
        Asked for the next case when a worker is about to be free.
    options : Options
    land : callable
        As for `run_here`; what workers have finished when an interrupt comes lands as well.
    """
    pending, suspects = {}, []

    def collect(limit):
        """Wait until at most so many tasks are pending."""
        while len(pending) > limit:
            for future in workers.wait(list(pending)):
                load, jobs = pending.pop(future)
                try:
                    records = future.result()
                except workers.lost:
                    suspects.extend((load, job) for job in jobs)
                    continue
                for record in records:
                    land(record)

    with workers:
        try:
            for case, truth, jobs in work:
                load = packed(case, truth)
                if options.stage == "auto":  # measured: workers might choose apart
                    options = dataclasses.replace(options, stage=workers.ask(stage_of, options))
                for group in groups(jobs):
                    collect(workers.width)
                    pending[workers.submit(load, group, options)] = (load, group)
            collect(0)
            while suspects:
                load, job = suspects.pop(0)
                future = workers.submit(load, [job], options)
                pending[future] = (load, [job])
                collect(0)
                if suspects and suspects[-1][1] is job:  # alone, and lost again
                    suspects.pop()
                    land(blank_record(job.key, LOST, DIED))
        except BaseException:
            for future in workers.stopped(list(pending)):
                for record in future.result():
                    land(record)
            raise


class PoolWorkers:
    """Worker processes of this machine, started afresh (spawn), each with its own renderer."""

    lost = (BrokenProcessPool,)

    def __init__(self, processes):
        self.width = processes
        self._context = multiprocessing.get_context("spawn")

    def __enter__(self):
        self._folder = tempfile.TemporaryDirectory(prefix="csm-sweep-")
        self._paths = weakref.WeakKeyDictionary()
        self._stop = self._context.Event()
        self._pool = self._new_pool()
        return self

    def __exit__(self, *exception):
        self._stop.set()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._folder.cleanup()

    def _new_pool(self):
        return concurrent.futures.ProcessPoolExecutor(
            self.width, self._context, initializer=_begin, initargs=(self._stop,)
        )

    def submit(self, load, jobs, options):
        """Start a task."""
        if load not in self._paths:  # on disk, for whichever process needs it
            path = Path(self._folder.name) / f"{len(os.listdir(self._folder.name))}.pickle"
            path.write_bytes(pickle.dumps(load, pickle.HIGHEST_PROTOCOL))
            self._paths[load] = str(path)
        task = (_pool_task, self._paths[load], jobs, options)
        try:
            return self._submit(*task)
        except BrokenProcessPool:
            self._pool.shutdown(wait=True)
            self._pool = self._new_pool()
            return self._submit(*task)

    def _submit(self, *task):
        """Submit, with Ctrl-C held back: a process that begins now is born deaf to it."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return self._pool.submit(*task)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def ask(self, function, *arguments):
        """Have one worker answer."""
        return self._submit(function, *arguments).result()

    @staticmethod
    def wait(futures):
        """Wait for the first of the tasks, return those that are done."""
        return concurrent.futures.wait(futures, return_when="FIRST_COMPLETED").done

    def stopped(self, futures):
        """Stop between two renders; return the tasks that have something to tell."""
        self._stop.set()
        self._pool.shutdown(wait=True, cancel_futures=True)
        return [f for f in futures if f.done() and not f.cancelled() and f.exception() is None]


class DaskWorkers:
    """The workers of a Dask cluster, each with its own renderer in `csm.sweep_worker`."""

    def __init__(self, client):
        try:
            from distributed import CancelledError, KilledWorker, wait
        except ImportError as error:
            raise ImportError(
                "client= needs dask and distributed: pip install cascaded-shadow-maps[cluster]"
            ) from error
        # Cancelled is what needs a case that only the dead worker had.
        self.lost = (KilledWorker, CancelledError)
        self._wait = wait
        self._client = client
        self._cases = weakref.WeakKeyDictionary()
        self.count = len(client.nthreads())
        self.width = 2 * max(1, self.count)  # the next task is there when one is done

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        with contextlib.suppress(OSError, TimeoutError):  # a cluster that is gone is released
            self._client.run(release)

    def submit(self, load, jobs, options):
        """Start a task."""
        case = self._cases.get(load)
        if case is None or case.status != "finished":
            case = self._cases[load] = self._client.scatter(load, hash=False)
        return self._client.submit(run_task, case, jobs, options, pure=False)

    def ask(self, function, *arguments):
        """Have one worker answer."""
        return self._client.submit(function, *arguments, pure=False).result()

    def wait(self, futures):
        """Wait for the first of the tasks, return those that are done."""
        with contextlib.suppress(*self.lost):
            self._wait(futures, return_when="FIRST_COMPLETED")
        return [future for future in futures if future.status != "pending"]

    def stopped(self, futures):
        """Drop what has not finished; return the tasks that have something to tell."""
        finished = [future for future in futures if future.status == "finished"]
        self._client.cancel([future for future in futures if future.status == "pending"])
        return finished


# -- in a process of the pool ---------------------------------------------------------------------

_stop = None


def _begin(stop):
    """Make a process of the pool listen to its parent alone, and end with it."""
    global _stop
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to all of a terminal's processes
    parent = multiprocessing.parent_process()
    threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel):
    """End this process when its parent does: killed, it can tell nobody to stop."""
    connection.wait([sentinel])
    os._exit(1)


def _pool_task(load, jobs, options):
    return run_task(load, jobs, options, _stop.is_set)
