"""Contenders take turns, ratios are taken round by round, and who fails is told."""

import gc
import time
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.speed.measure import (
    Contender,
    EachContender,
    Timings,
    clock_seconds,
    interleaved,
    interleaved_each,
    ratios,
)
from benchmarks.speed.tables import calls, medians, samples, slow, time_cells, times_as_fast
from kinreach.errors import InputError


def noted(calls: list, names: str, **settings) -> list[Contender]:
    return [Contender(name, lambda name=name: calls.append(name), 1, **settings) for name in names]


def test_contenders_take_turns_and_the_order_rotates():
    calls, rounds = [], []
    timings = interleaved(noted(calls, "abc"), 4, on_round=lambda done, of: rounds.append((done, of)))
    played = ["".join(calls[i : i + 3]) for i in range(0, len(calls), 3)]
    assert len(played) == 5
    assert all(sorted(turn) == ["a", "b", "c"] for turn in played)
    assert played[1:] == ["abc", "bca", "cab", "abc"]
    assert rounds == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert list(timings) == ["a", "b", "c"]
    assert all(times.shape == (4,) and (times > 0).all() for times in timings.values())
    assert timings.failed == {}


def test_time_is_per_unit():
    """A sleep cannot be shorter than it says; one of 20 ms in ten units is at least 2 ms each."""
    timings = interleaved([Contender("sleep", lambda: time.sleep(0.02), 10)], 2)
    assert (timings["sleep"] >= 0.002).all()
    assert (timings["sleep"] < 0.02).any()
    assert timings.cores["sleep"] < 0.9, "sleeping needs no processor"


def test_short_calls_are_repeated_until_a_turn_has_lasted(monkeypatch):
    clock, calls = [0.0], []

    def work():
        calls.append(clock[0])
        clock[0] += 0.02

    stopped = SimpleNamespace(perf_counter=lambda: clock[0], process_time=lambda: clock[0])
    monkeypatch.setattr("benchmarks.speed.measure.time", stopped)
    timings = interleaved([Contender("short", work, 4)], 2, lap=0.05)
    assert len(calls) == (1 + 2) * (1 + 3)  # of every round one that does not count, three until 0.05 s are over
    np.testing.assert_allclose(timings["short"], 0.02 / 4)


def test_each_input_is_timed_on_its_own():
    seen = []
    timings = interleaved_each(
        [EachContender("a", seen.append, [1, 2, 3]), EachContender("b", lambda given: time.sleep(given), [0.0, 0.01])],
        2,
    )  # fmt: skip
    assert seen == [1, 2, 3] * 3
    assert timings["a"].shape == (2, 3)
    assert timings["b"].shape == (2, 2)
    assert (timings["b"][:, 1] >= 0.01).all()


def test_ratios_are_of_the_same_round():
    """The second round of a busy machine is ten times as slow for both: ratios do not see it, medians would."""
    times = {"ours": np.array([1.0, 20.0, 3.0]), "theirs": np.array([2.0, 20.0, 2.0])}
    np.testing.assert_allclose(ratios(times, "ours", "theirs"), [0.5, 1.0, 1.5])
    np.testing.assert_allclose(ratios(times, "theirs", "ours"), [2.0, 1.0, 2 / 3])


def test_ratios_of_calls_compare_the_medians_of_a_round():
    times = {"ours": np.array([[1.0, 2.0, 90.0], [4.0, 4.0, 4.0]]), "theirs": np.array([4.0, 2.0])}
    np.testing.assert_allclose(ratios(times, "ours", "theirs"), [0.5, 2.0])


def test_a_peer_that_fails_is_told_and_the_others_go_on():
    calls = []

    def fails_later():
        calls.append("x")
        if calls.count("x") > 2:
            raise ValueError("no such pose")

    contenders = [Contender("x", fails_later, 1, peer=True), *noted(calls, "a", peer=True)]
    timings = interleaved(contenders, 5)
    assert timings.failed == {"x": "failed with ValueError: no such pose"}
    assert list(timings) == ["a"]
    assert timings["a"].shape == (5,)
    assert calls.count("x") == 3, "it is not called again"


def test_our_own_failure_is_raised():
    def fails():
        raise ValueError("a bug")

    assert gc.isenabled()
    with pytest.raises(ValueError, match="a bug"):
        interleaved([Contender("kinreach", fails, 1)], 2)
    assert gc.isenabled()


def test_bad_rounds_and_names():
    with pytest.raises(InputError, match="rounds must be at least 1, got 0"):
        interleaved(noted([], "a"), 0)
    with pytest.raises(InputError, match="names of contenders must differ, got a, a"):
        interleaved(noted([], "aa"), 1)


def test_garbage_is_collected_between_rounds_only():
    states = []
    interleaved([Contender("a", lambda: states.append(gc.isenabled()), 1)], 2, on_round=lambda *_: states.append(True))
    assert states == [False, False, True, False, True]


def test_cells_of_a_table():
    timings = Timings()
    timings |= {"a": np.array([1e-6, 2e-6, 3e-6]), "b": np.array([[2e-6, 2e-6], [8e-6, 8e-6], [3e-6, 3e-6]])}
    assert time_cells(timings, "a", "b") == pytest.approx([2.0, 3.0, 0.5, "0.25 ... 1"])
    assert time_cells(timings, "a", "missing", "b")[2:] == pytest.approx([None, None, 0.5, "0.25 ... 1"])
    assert medians(timings) == pytest.approx({"a": 2.0, "b": 3.0})
    assert samples(timings) == {"a": [1e-6, 2e-6, 3e-6], "b": [2e-6, 8e-6, 3e-6]}
    assert calls([Contender("a", print, 1, "f(x)"), Contender("b", print, 1)]) == "How each is called: a: `f(x)`."


def test_slow_end_is_the_worst_round_or_p95_of_calls():
    rng = np.random.default_rng(0)
    for count in range(1, 41):
        rounds = rng.exponential(size=count)
        assert slow(rounds) == rounds.max()
    calls_of_rounds = rng.exponential(size=(7, 200))
    assert np.mean(calls_of_rounds <= slow(calls_of_rounds)) == pytest.approx(0.95, abs=1e-3)


def test_target_is_held_against_the_quickest_way_of_a_peer():
    timings = Timings()
    timings |= {"ours": np.ones(3), "one way": np.array([9.0, 13.0, 20.0]), "other way": np.array([11.0, 11.0, 15.0])}
    judged = {"what": "it", "bound": 12.0, "why": "because"}
    for ways in (("one way", "other way"), ("other way", "one way"), ("other way",), ("gone", "other way")):
        (target,) = times_as_fast(timings, "ours", ways, **judged)
        assert (target.measured, target.unit, target.met, target.why) == (11.0, "x other way", False, "because")
    (target,) = times_as_fast(timings, "ours", ("one way", "gone"), **judged)
    assert (target.measured, target.unit, target.met) == (13.0, "x one way", True)
    assert times_as_fast(timings, "ours", ("gone",), **judged) == []


def test_reading_the_clock_costs_little():
    assert 0 < clock_seconds() < 1e-5
