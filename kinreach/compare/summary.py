"""From trials to the numbers of `results.json`, each with its 95 % confidence interval."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from kinreach.compare.budget import Budget
from kinreach.compare.trials import ReachTrial, Trial
from kinreach.statistics import Statistic, bootstrap_intervals, mean, median, p95, wilson_interval

T = TypeVar("T", bound=Trial)

#: Distances [mm] at which the share of goals is reported.
TOLERANCES_MM = (50, 20, 10, 5, 2, 1, 0.5)
#: What is said of a distribution, by name.
MEDIAN_P95: Mapping[str, Statistic] = {"median": median, "p95": p95}


def summarise(name: str, kind: str, trials: Sequence[ReachTrial]) -> dict[str, Any]:
    """One entry of `methods` in `results.json` for a task that is done by moving to a posture.

    Beyond `what_all_tasks_say`: moving errors and the error budget are over goals whose last move was completed, counts
    of decisions over goals that the method was asked for, errors of what the cameras saw over balls that one of them
    found.

    Args:
        name: Of the method.
        kind: Of the method.
        trials: Its trials, at least one.
    """
    return {
        **what_all_tasks_say(name, kind, trials),
        **spread("posture_error", trials, lambda t: t.posture_error),
        **spread("observed_error_mm", trials, lambda t: thousand(t.seen_error)),
        **spread("look_ms", trials, lambda t: thousand(t.look_s)),
        **spread("ik_error_mm", trials, lambda t: thousand(t.ik_error)),
        **spread("move_error_mm", trials, lambda t: thousand(t.move_error)),
        **_budget([t for t in trials if t.seeing is not None]),
        **spread("accept_ms", trials, lambda t: thousand(t.accept_s)),
        **spread("iterations", trials, lambda t: t.iterations),
        **spread("restarts", trials, lambda t: t.restarts),
        **spread("candidates", trials, lambda t: t.candidates),
    }


def what_all_tasks_say(name: str, kind: str, trials: Sequence[Trial]) -> dict[str, Any]:
    """The keys that a method has whatever the task.

    Rates are over all goals. Distances are over all goals too: an impossible one counts with the distance at which
    the arm stood. A goal succeeds at a tolerance if its trial was completed and ended within it. Moving times are over
    completed trials, times of decisions over goals that the method was asked for. A quantity that was never measured
    is None.
    """
    success = {
        f"{tolerance:g}": rate(sum(t.completed and 1e3 * t.distance <= tolerance for t in trials), len(trials))
        for tolerance in TOLERANCES_MM
    }
    reached, reached_ci = rate(sum(t.reached for t in trials), len(trials))
    impossible, impossible_ci = rate(sum(t.impossible for t in trials), len(trials))
    (reward_mean,), (reward_ci,) = _estimate([t.reward for t in trials], (mean,))
    return {
        "name": name,
        "kind": kind,
        "goals": len(trials),
        "reached": reached,
        "reached_ci": reached_ci,
        **spread("distance_mm", trials, lambda t: 1e3 * t.distance),
        "success_at_mm": {key: share for key, (share, _) in success.items()},
        "success_at_mm_ci": {key: interval for key, (_, interval) in success.items()},
        "impossible": impossible,
        "impossible_ci": impossible_ci,
        "outcomes": dict(Counter(t.status for t in trials)),
        "reward_mean": reward_mean,
        "reward_mean_ci": reward_ci,
        **spread("solve_ms", trials, lambda t: thousand(t.solve_s)),
        **spread("move_s", trials, lambda t: t.move_s),
    }


def spread(
    key: str,
    trials: Sequence[T],
    value: Callable[[T], float | None],
    statistics: Mapping[str, Statistic] = MEDIAN_P95,
) -> dict[str, Any]:
    """Statistics of a value of the trials that have one, under `key`, and their intervals, under the key with `_ci`."""
    values = [v for v in map(value, trials) if v is not None]
    if not values:
        return {key: dict.fromkeys(statistics), f"{key}_ci": dict.fromkeys(statistics)}
    estimates, intervals = _estimate(values, tuple(statistics.values()))
    return {
        key: dict(zip(statistics, estimates, strict=True)),
        f"{key}_ci": dict(zip(statistics, intervals, strict=True)),
    }


def thousand(value: float | None) -> float | None:
    """From metres to millimetres, from seconds to milliseconds."""
    return None if value is None else 1e3 * value


def rate(count: int, total: int) -> tuple[float, list[float]]:
    """A share, and its interval."""
    return count / total, list(wilson_interval(count, total))


def _budget(completed: Sequence[ReachTrial]) -> dict[str, Any]:
    """Means of the distance and of its parts."""
    names = (*Budget._fields, "distance")
    if not completed:
        return {"budget_mm": dict.fromkeys(names), "budget_mm_ci": dict.fromkeys(names)}
    means = {name: _estimate([1e3 * getattr(t, name) for t in completed], (mean,)) for name in names}
    return {
        "budget_mm": {name: value for name, ((value,), _) in means.items()},
        "budget_mm_ci": {name: interval for name, (_, (interval,)) in means.items()},
    }


def _estimate(values: Sequence[float], statistics: Sequence[Statistic]) -> tuple[list[float], list[list[float]]]:
    sample = np.array(values, dtype=np.float64)
    intervals = [list(interval) for interval in bootstrap_intervals(sample, statistics)]
    return [float(statistic(sample)) for statistic in statistics], intervals
