"""From trials to the numbers of `results.json`, each with its 95 % confidence interval."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from kinreach.compare.budget import Budget
from kinreach.compare.trials import Trial
from kinreach.statistics import Statistic, bootstrap_intervals, mean, median, p95, wilson_interval

#: Distances [mm] at which the share of goals is reported.
TOLERANCES_MM = (50, 20, 10, 5, 2, 1, 0.5)


def summarise(name: str, kind: str, trials: Sequence[Trial]) -> dict[str, Any]:
    """One entry of `methods` in `results.json`.

    Rates are over all goals. Distances are over all goals too: an impossible one counts with the distance at which
    the arm stood. A goal succeeds at a tolerance if its last move was completed and ended within it. Moving times,
    moving errors and the error budget are over goals whose last move was completed, times and counts of decisions over
    goals that the method was asked for, errors of what the cameras saw over balls that one of them found. A quantity
    that was never measured is None.

    Args:
        name: Of the method.
        kind: Of the method.
        trials: Its trials, at least one.
    """
    success = {
        f"{tolerance:g}": sum(not t.impossible and 1e3 * t.distance <= tolerance for t in trials)
        for tolerance in TOLERANCES_MM
    }
    reached, reached_ci = _rate(sum(t.reached for t in trials), len(trials))
    impossible, impossible_ci = _rate(sum(t.impossible for t in trials), len(trials))
    (reward_mean,), (reward_ci,) = _estimate([t.reward for t in trials], (mean,))
    return {
        "name": name,
        "kind": kind,
        "goals": len(trials),
        "reached": reached,
        "reached_ci": reached_ci,
        **_median_p95("distance_mm", trials, lambda t: 1e3 * t.distance),
        "success_at_mm": {key: _rate(count, len(trials))[0] for key, count in success.items()},
        "success_at_mm_ci": {key: _rate(count, len(trials))[1] for key, count in success.items()},
        "impossible": impossible,
        "impossible_ci": impossible_ci,
        "outcomes": dict(Counter(t.status for t in trials)),
        "reward_mean": reward_mean,
        "reward_mean_ci": reward_ci,
        **_median_p95("posture_error", trials, lambda t: t.posture_error),
        **_median_p95("observed_error_mm", trials, lambda t: _thousand(t.seen_error)),
        **_median_p95("look_ms", trials, lambda t: _thousand(t.look_s)),
        **_median_p95("ik_error_mm", trials, lambda t: _thousand(t.ik_error)),
        **_median_p95("move_error_mm", trials, lambda t: _thousand(t.move_error)),
        **_budget([t for t in trials if t.seeing is not None]),
        **_median_p95("solve_ms", trials, lambda t: _thousand(t.solve_s)),
        **_median_p95("accept_ms", trials, lambda t: _thousand(t.accept_s)),
        **_median_p95("move_s", trials, lambda t: t.move_s),
        **_median_p95("iterations", trials, lambda t: t.iterations),
        **_median_p95("restarts", trials, lambda t: t.restarts),
        **_median_p95("candidates", trials, lambda t: t.candidates),
    }


def _thousand(value: float | None) -> float | None:
    """From metres to millimetres, from seconds to milliseconds."""
    return None if value is None else 1e3 * value


def _budget(completed: Sequence[Trial]) -> dict[str, Any]:
    """Means of the distance and of its parts."""
    names = (*Budget._fields, "distance")
    if not completed:
        return {"budget_mm": dict.fromkeys(names), "budget_mm_ci": dict.fromkeys(names)}
    means = {name: _estimate([1e3 * getattr(t, name) for t in completed], (mean,)) for name in names}
    return {
        "budget_mm": {name: value for name, ((value,), _) in means.items()},
        "budget_mm_ci": {name: interval for name, (_, (interval,)) in means.items()},
    }


def _median_p95(key: str, trials: Sequence[Trial], value: Callable[[Trial], float | None]) -> dict[str, Any]:
    names = ("median", "p95")
    values = [v for v in map(value, trials) if v is not None]
    if not values:
        return {key: dict.fromkeys(names), f"{key}_ci": dict.fromkeys(names)}
    estimates, intervals = _estimate(values, (median, p95))
    return {key: dict(zip(names, estimates, strict=True)), f"{key}_ci": dict(zip(names, intervals, strict=True))}


def _estimate(values: Sequence[float], statistics: Sequence[Statistic]) -> tuple[list[float], list[list[float]]]:
    sample = np.array(values, dtype=np.float64)
    intervals = [list(interval) for interval in bootstrap_intervals(sample, statistics)]
    return [float(statistic(sample)) for statistic in statistics], intervals


def _rate(count: int, total: int) -> tuple[float, list[float]]:
    return count / total, list(wilson_interval(count, total))
