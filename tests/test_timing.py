"""Times: what counts, in which order, until when; on a clock that the test turns."""

import itertools

import numpy as np
import pytest

from csm import timing


class Driver:
    """Frames on a fake clock: cold at first and after another job, else as the job says."""

    COLD = 1000.0

    def __init__(self, warm):
        self.warm = {name: iter(times) for name, times in warm.items()}
        self.drawn, self.last, self.seen = [], None, set()

    def __call__(self, job):
        self.drawn.append(job)
        cold = self.last != job
        self.last = job
        value = self.COLD if cold else next(self.warm[job])
        return {"view": 0.25 * value, "shadow_map_0": 0.5 * value, "shadow_map_1": 0.25 * value,
                "readback": 7.0}  # fmt: skip


def run(warm, **more):
    driver = Driver(warm)
    found = dict(timing.in_turns(list(warm), driver, **more))
    totals = {job: [timing.total_ms(p) for p in samples] for job, samples in found.items()}
    return driver, totals


def test_no_cold_frame_counts():
    _, totals = run({"a": itertools.repeat(10.0), "b": itertools.repeat(30.0)})
    assert totals == {"a": [10.0] * 5, "b": [30.0] * 5}


@pytest.mark.parametrize(
    ("repeats", "drawn"),
    [
        (1, "aabb"),
        (2, "aabbaabb"),
        (3, "aaabbbaabb"),
        (5, "aaaabbbbaaabbb"),
        (7, "aaaabbbb" * 2 + "aabb"),
    ],
)
def test_jobs_take_turns_that_begin_with_a_frame_that_does_not_count(repeats, drawn):
    # three frames that count to a turn at most, and two turns at least
    driver, _ = run({"a": itertools.repeat(1.0), "b": itertools.repeat(1.0)}, repeats=repeats)
    assert "".join(driver.drawn) == drawn


def test_a_gpu_is_warmed_up_before_anything_counts(monkeypatch):
    assert timing.warm_up_s({"software": True}) == 0.0
    assert timing.warm_up_s({"software": False}) >= 1.0
    clock = itertools.count()
    monkeypatch.setattr(timing.time, "perf_counter", lambda: float(next(clock)))
    driver, totals = run({"a": itertools.repeat(1.0), "b": itertools.repeat(1.0)}, repeats=1,
                         warm_up=4.0)  # fmt: skip
    assert "".join(driver.drawn) == "aaaaabb"  # three in four seconds, then turns
    assert totals == {"a": [1.0], "b": [1.0]}


def test_alone_a_job_stays_warm():
    driver, totals = run({"a": itertools.repeat(1.0)}, repeats=3)
    assert "".join(driver.drawn) == "aaaa"
    assert totals["a"] == [1.0] * 3


def test_a_job_that_has_settled_leaves_and_the_others_go_on():
    restless = itertools.cycle([1.0, 2.0])
    driver, totals = run({"a": itertools.repeat(1.0), "b": restless})
    assert len(totals["a"]) == timing.LEAST == 5
    assert len(totals["b"]) == timing.MOST == 50
    assert driver.drawn.count("a") == 7
    assert driver.drawn[11:] == ["b"] * 48, "its second turn, and it is alone from there"


def test_rounds_go_on_until_quartiles_lie_within_a_tenth():
    # Of 1, 1, 1, 1.5, 1.5 the third quartile is 1.5; with more ones it comes down to 1.
    _, totals = run({"a": itertools.chain([1.0, 1.5, 1.0, 1.5, 1.0], itertools.repeat(1.0))})
    counts = len(totals["a"])
    assert 5 < counts < 12
    median, first, third = timing.quartiles(totals["a"])
    assert max(median - first, third - median) <= 0.1 * median
    assert not timing.is_settled(totals["a"][:-1])


@pytest.mark.parametrize(("spread", "settled"), [(0.0999, True), (0.1001, False)])
def test_a_tenth_is_a_tenth(spread, settled):
    for sign in (1.0, -1.0):
        samples = [1.0, 1.0, 1.0, 1.0 + sign * spread, 1.0 + sign * spread]
        assert timing.is_settled(samples) is settled
        assert not timing.is_settled(samples[:4])


def test_a_number_of_repeats_is_kept():
    assert timing.is_settled([1.0, 9.0], 2)
    assert not timing.is_settled([1.0] * 9, 10)
    _, totals = run({"a": itertools.cycle([1.0, 9.0])}, repeats=1)
    assert totals["a"] == [1.0]


def test_quartiles_of_numbers_in_any_order():
    rng = np.random.default_rng(3)
    assert timing.quartiles(rng.permutation(np.arange(1.0, 10.0))) == [5.0, 3.0, 7.0]


def test_cascades_of_a_pass_are_added_and_readback_does_not_count():
    passes = timing.by_pass(
        {"view": 1.0, "shadow_map_0": 2.0, "shadow_blur_0": 8.0, "shadow_map_1": 4.0,
         "shadow_mask": 16.0, "readback": 1e6}
    )  # fmt: skip
    assert passes == {"view": 1, "shadow_map": 6, "shadow_blur": 8, "shadow_mask": 16,
                      "readback": 1e6}  # fmt: skip
    assert list(passes)[:3] == ["view", "shadow_map", "shadow_blur"]
    assert timing.total_ms(passes) == 31.0


def test_a_job_that_fails_leaves_the_others_alone():
    def frame_times(job):
        if job == "bad":
            raise ValueError("no")
        return {"view": 1.0}

    found = dict(timing.in_turns(["a", "bad", "b"], frame_times, repeats=2))
    assert isinstance(found.pop("bad"), ValueError)
    assert found == {"a": [{"view": 1.0}] * 2, "b": [{"view": 1.0}] * 2}


def test_where_none_may_fail_the_first_failure_is_raised_at_once():
    drawn = []

    def frame_times(job):
        drawn.append(job)
        if job == "bad":
            raise ValueError("no")
        return {"view": 1.0}

    found = timing.all_in_turns(["a", "b"], frame_times, repeats=2)
    assert found == {"a": [{"view": 1.0}] * 2, "b": [{"view": 1.0}] * 2}
    drawn.clear()
    with pytest.raises(ValueError, match="no"):
        timing.all_in_turns(["bad", "a"], frame_times, repeats=2)
    assert drawn == ["bad"], "nothing is timed for a result that nobody gets"


def test_it_stops_between_two_frames():
    drawn = []

    def frame_times(job):
        drawn.append(job)
        return {"view": 1.0}

    found = timing.in_turns(["a", "b"], frame_times, stopped=lambda: len(drawn) >= 4)
    assert list(found) == []
    assert drawn == ["a"] * 4, "within a turn, and b has none"
