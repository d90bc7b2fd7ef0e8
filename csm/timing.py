"""Times that can be trusted: warmed up, taken in turns, given as medians with quartiles.

A GPU that has nothing to do slows its clock, and takes about a second to speed up. A first frame
compiles, allocates and faults pages in; a frame after another technique's finds neither its
textures nor its caches. None of these is what the technique costs, and a mean of cold and warm
frames is nothing at all. So a turn begins with a frame that does not count, techniques take turns
of a few frames so that what drifts meets all of them, and rounds go on until the quartiles are
close.
"""

import contextlib
import math
import re
import time

import numpy as np

__all__ = [
    "HOST",
    "LEAST",
    "MOST",
    "MOST_REPEATS",
    "SPREAD",
    "all_in_turns",
    "by_pass",
    "in_turns",
    "is_settled",
    "quartiles",
    "total_ms",
    "warm_up_s",
]

LEAST = 5  # frames that count, at least
MOST = 50  # and at most
MOST_REPEATS = 10_000  # of frames, where somebody says how many
RUN = 3  # of them in a turn, after the one that does not: fewer would double the work
SPREAD = 0.10  # quartiles lie within this share of the median
HOST = "host"  # of the call, what lies outside of all passes
NOT_COUNTED = ("readback", HOST)  # the measurement's own, and what an engine does otherwise


def by_pass(timings_ms):
    """Times of a frame by pass, its cascades added up.

    Parameters
    ----------
    timings_ms : mapping of str to float
        `Frame.timings_ms`: ``shadow_map_0``, ``shadow_map_1`` …

    Returns
    -------
    by_pass : dict of str to float
        ``shadow_map`` … [ms], in order.
    """
    summed = {}
    for name, value in timings_ms.items():
        stem = re.sub(r"_\d+$", "", name)
        summed[stem] = summed.get(stem, 0.0) + value
    return summed


def total_ms(passes):
    """Sum of the passes of a frame [ms], without ``readback`` and ``host``."""
    return math.fsum(value for name, value in passes.items() if name not in NOT_COUNTED)


def quartiles(samples):
    """Median, first and third quartile of samples, as a list of floats."""
    first, median, third = np.percentile(np.asarray(samples, float), (25, 50, 75))
    return [float(median), float(first), float(third)]


def is_settled(samples, repeats=None):
    """Whether there are samples enough.

    Parameters
    ----------
    samples : sequence of float
        Totals so far [ms].
    repeats : int, optional
        So many and no more; by default at least 5, until both quartiles lie within 10 % of the
        median or there are 50.

    Returns
    -------
    settled : bool
    """
    if repeats is not None:
        return len(samples) >= repeats
    if len(samples) < LEAST:
        return False
    if len(samples) >= MOST:
        return True
    median, first, third = quartiles(samples)
    return max(median - first, third - median) <= SPREAD * median


def warm_up_s(info):
    """Seconds that frames are drawn before any is timed: none without a GPU.

    Parameters
    ----------
    info : mapping
        `Renderer.info`.

    Returns
    -------
    seconds : float
    """
    return 0.0 if info["software"] else 1.5


def in_turns(jobs, frame_times, *, repeats=None, stopped=lambda: False, warm_up=0.0):
    """Time jobs round by round; each is handed over when its times have settled.

    Parameters
    ----------
    jobs : sequence
        What is timed.
    frame_times : callable
        Takes a job, renders it once, returns its `Frame.timings_ms`.
    repeats : int, optional
        As in `is_settled`.
    stopped : callable
        Asked before every job; True ends it all.
    warm_up : float
        Seconds that frames of the first job are drawn before any is timed.

    Yields
    ------
    job
    samples : list of dict of str to float, or an Exception
        Times by pass [ms] of the frames that count; or what the job failed with, after which it is
        left out.
    """
    samples = {number: [] for number in range(len(jobs))}
    run = RUN if repeats is None else min(RUN, -(-repeats // 2))  # two turns at least
    last = None
    begun = time.perf_counter()
    with contextlib.suppress(Exception):  # a job that fails says so in its turn
        while jobs and time.perf_counter() < begun + warm_up and not stopped():
            frame_times(jobs[0])
    while samples:
        for number in list(samples):
            if stopped():
                return
            taken = samples[number]
            try:
                if last != number:  # cold, or cooled by another
                    frame_times(jobs[number])
                for _ in range(run):
                    taken.append(by_pass(frame_times(jobs[number])))
                    done = is_settled([total_ms(passes) for passes in taken], repeats)
                    if done or stopped():
                        break
            except Exception as error:  # a job's failure is its result
                del samples[number]
                yield jobs[number], error
                continue
            finally:
                last = number
            if done:
                del samples[number]
                yield jobs[number], taken


def all_in_turns(jobs, frame_times, **options):
    """Times of jobs of which none may fail.

    Parameters
    ----------
    jobs, frame_times, **options
        As for `in_turns`.

    Returns
    -------
    found : dict of job to list of dict of str to float
        Times by pass [ms] of the frames that count.

    Raises
    ------
    Exception
        What the first job that fails failed with, at once.
    """
    found = {}
    for job, samples in in_turns(jobs, frame_times, **options):
        if isinstance(samples, Exception):
            raise samples
        found[job] = samples
    return found
