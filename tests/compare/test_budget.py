"""The parts of a distance sum to it, and mean what they say."""

from collections.abc import Callable

import numpy as np
import pytest

from kinreach.compare.budget import Budget, budget
from kinreach.compare.budget_figure import draw_budget
from kinreach.compare.deciding import POLICY
from kinreach.compare.summary import summarise
from kinreach.compare.trials import ReachTrial

TrialFactory = Callable[..., list[ReachTrial]]

ORIGIN = np.zeros(3)


def test_the_parts_sum_to_the_distance() -> None:
    rng = np.random.default_rng(0)
    checked = negative = 0
    for _ in range(500):
        scales = 10.0 ** rng.uniform(-12, 0, 3)
        goal = rng.uniform(-1, 1, 3)
        told, meant, tip = goal + np.cumsum(scales[:, None] * rng.standard_normal((3, 3)), axis=0)
        parts = budget(goal, told, meant, tip)
        distance = np.linalg.norm(tip - goal)
        assert sum(parts) == pytest.approx(distance, abs=1e-15)
        for part, step in zip(parts, (told - goal, meant - told, tip - meant), strict=True):
            assert abs(part) <= np.linalg.norm(step) * (1 + 1e-12)
        checked += 1
        negative += min(parts) < 0
    assert checked == 500
    assert 50 < negative < 450


def test_errors_in_line_are_their_lengths_and_one_across_counts_nothing() -> None:
    x = np.array([1.0, 0.0, 0.0])
    assert budget(ORIGIN, 1 * x, 3 * x, 6 * x) == pytest.approx((1, 2, 3))
    assert budget(ORIGIN, 5 * x, 3 * x, 4 * x) == pytest.approx((5, -2, 1))
    across = np.array([0.0, 2.0, 0.0])
    assert budget(ORIGIN, across, across + 4 * x, 4 * x) == pytest.approx((0, 4, 0))


def test_where_nothing_is_left_every_part_is_zero() -> None:
    away = np.array([0.1, 0.2, 0.3])
    assert budget(away, away + 0.1, away - 0.1, away) == (0.0, 0.0, 0.0)


def test_means_of_parts_sum_to_the_mean_distance_of_completed_moves(
    make_trials: TrialFactory, impossible: ReachTrial
) -> None:
    trials = [impossible]
    for k in range(20):
        trials += make_trials(1, seeing=1e-3 * k, deciding=-2e-4 * k, moving=1e-5, distance=8e-4 * k + 1e-5)
    summary = summarise("any", POLICY, trials)
    parts, intervals = summary["budget_mm"], summary["budget_mm_ci"]
    assert list(parts) == list(intervals) == [*Budget._fields, "distance"]
    assert parts["seeing"] == pytest.approx(9.5)
    assert parts["deciding"] == pytest.approx(-1.9)
    assert parts["distance"] == pytest.approx(parts["seeing"] + parts["deciding"] + parts["moving"])
    for name, part in parts.items():
        low, high = intervals[name]
        assert low - 1e-12 <= part <= high + 1e-12
    assert intervals["seeing"][0] < 9.0 < 10.0 < intervals["seeing"][1]


def test_bars_are_the_shares_and_parts_that_help_lie_left_of_zero(
    make_trials: TrialFactory, impossible: ReachTrial
) -> None:
    good = summarise("good", POLICY, make_trials(3, seeing=4e-3, deciding=-1e-3, moving=1e-3, distance=4e-3))
    none = summarise("none", POLICY, [impossible])
    figure = draw_budget({"methods": [good, none]}, note="made up")
    (axes,) = figure.axes
    bars = [(bar.get_x(), bar.get_x() + bar.get_width()) for bar in axes.patches if bar.get_width()]
    assert bars == [pytest.approx((0, 100)), pytest.approx((0, -25)), pytest.approx((100, 125))]
    assert axes.get_xlim() == pytest.approx((-25, 125))
    texts = [text.get_text() for text in axes.texts]
    assert "4.00 - 1.00 + 1.00 = 4.00 mm" in texts
    assert "none" in texts
    assert [label.get_text() for label in axes.get_yticklabels()] == ["good", "none"]


def test_without_a_completed_move_there_is_no_budget(impossible: ReachTrial) -> None:
    summary = summarise("any", POLICY, [impossible] * 2)
    assert set(summary["budget_mm"].values()) == set(summary["budget_mm_ci"].values()) == {None}
    assert summary["move_error_mm"] == {"median": None, "p95": None}
