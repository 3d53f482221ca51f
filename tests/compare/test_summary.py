"""The numbers of the report from trials whose numbers are known."""

from collections.abc import Callable

import pytest

from kinreach.compare.deciding import POLICY, SOLVER
from kinreach.compare.summary import summarise
from kinreach.compare.trials import ReachTrial
from kinreach.statistics import wilson_interval

TrialFactory = Callable[..., list[ReachTrial]]


def test_rates_and_spreads_by_hand(make_trials: TrialFactory, impossible: ReachTrial) -> None:
    near = make_trials(8, distance=0.0004, reward=20.0, solve_s=1e-3, accept_s=4e-4, move_s=1.0)
    far = make_trials(1, distance=0.015, reward=3.0, reached=False, solve_s=5e-3, move_s=2.0)
    summary = summarise("lm", SOLVER, [*near, *far, impossible])
    assert (summary["name"], summary["goals"]) == ("lm", 10)
    assert summary["reached"] == 0.8
    assert summary["reached_ci"] == list(wilson_interval(8, 10))
    assert summary["success_at_mm"] == {"50": 0.9, "20": 0.9, "10": 0.8, "5": 0.8, "2": 0.8, "1": 0.8, "0.5": 0.8}
    assert summary["success_at_mm_ci"]["20"] == list(wilson_interval(9, 10))
    assert summary["impossible"] == 0.1
    assert summary["outcomes"] == {"completed": 9, "out of reach": 1}
    assert summary["reward_mean"] == pytest.approx((8 * 20 + 3 - 100) / 10)
    assert summary["distance_mm"]["median"] == pytest.approx(0.4)
    assert summary["distance_mm"]["p95"] == pytest.approx(15 + 0.55 * 485)  # rank 8.55 of 0 … 9
    assert summary["solve_ms"]["median"] == pytest.approx(1.0)
    assert summary["move_s"]["median"] == 1.0  # of the nine completed moves


def test_success_counts_a_distance_equal_to_the_tolerance_and_no_impossible_move(make_trials: TrialFactory) -> None:
    on_the_edge = summarise("lm", SOLVER, make_trials(1, distance=0.002))["success_at_mm"]
    assert (on_the_edge["2"], on_the_edge["1"]) == (1.0, 0.0)
    blocked_nearby = summarise(
        "lm", SOLVER, make_trials(1, distance=0.0001, impossible=True, reason="blocked", move_s=None)
    )
    assert set(blocked_nearby["success_at_mm"].values()) == {0.0}


def test_intervals_hold_their_estimates(make_trials: TrialFactory) -> None:
    spread = [t for k in range(40) for t in make_trials(1, distance=0.001 + 0.0001 * k, solve_s=1e-4 * (1 + k))]
    summary = summarise("lm", SOLVER, spread)
    checked = 0
    for key in ("distance_mm", "solve_ms"):
        for name in ("median", "p95"):
            low, high = summary[f"{key}_ci"][name]
            assert low < summary[key][name] <= high
            checked += 1
    assert checked == 4


def test_errors_are_in_millimetres_and_the_kind_is_said(make_trials: TrialFactory) -> None:
    summary = summarise("mine", POLICY, make_trials(5, ik_error=2e-3, move_error=3e-3))
    assert (summary["name"], summary["kind"]) == ("mine", "policy")
    assert (summary["ik_error_mm"]["median"], summary["move_error_mm"]["median"]) == pytest.approx((2.0, 3.0))


def test_what_was_never_measured_is_null(make_trials: TrialFactory, impossible: ReachTrial) -> None:
    summary = summarise("lm", SOLVER, [impossible] * 3)
    for key in ("move_s", "ik_error_mm"):
        assert summary[key] == summary[f"{key}_ci"] == {"median": None, "p95": None}
    assert summary["impossible"] == 1.0
    button = summarise("lm", SOLVER, make_trials(3, posture_error=None))
    assert button["posture_error"] == {"median": None, "p95": None}
