"""Summaries of evaluations as a table for people."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from rich.table import Table

from kinreach.baselines.policies import LearnedPolicy
from kinreach.checks import check_count
from kinreach.statistics import bootstrap_intervals, median, p95, wilson_interval

Array = np.ndarray[Any, Any]

#: Seeds of goals. Training draws below 2**31, so these are never trained on; a choice between settings is made on the
#: first set, and what is published is measured on the second.
VALIDATION, HELD_OUT = 2**40, 2**41
#: The same by the names that the command line uses.
SPLITS: Mapping[str, int] = {"held-out": HELD_OUT, "validation": VALIDATION}
#: Distances [mm] at which the share of goals is reported.
TOLERANCES_MM = (50, 20, 10, 5, 2, 1, 0.5)
#: Episodes in step, and resamples of a bootstrap.
BATCH, RESAMPLES = 500, 500
#: What an environment's info says of a finished episode, as far as it says it, and in which unit it is reported.
_MEASURES: Mapping[str, tuple[str, float]] = {
    "distance": ("distance_mm", 1e3),
    "posture_error": ("posture_error", 1.0),
    "wrong_presses": ("wrong_presses", 1.0),
    "energy": ("energy", 1.0),
    "steps": ("steps", 1.0),
    "return": ("return", 1.0),
}


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Episodes of one policy; arrays have one value for each goal.

    Attributes:
        reached: The task's own criterion.
        impossible: Whether the last action was.
        measures: Last values of the episode by name: `distance` [m], `posture_error` [rad], `steps`, `return` (of the
            environment's reward), and what else the environment says.
    """

    reached: Array
    impossible: Array
    measures: Mapping[str, Array]

    def summary(self) -> dict[str, Any]:
        """Rates, medians and 95th percentiles with 95 % intervals, as JSON types."""
        total = len(self.reached)
        found: dict[str, Any] = {"goals": total}
        for name, flags in (("reached", self.reached), ("impossible", self.impossible)):
            found[name] = float(flags.mean())
            found[f"{name}_ci"] = list(wilson_interval(int(flags.sum()), total))
        if "posture_error" in self.measures:
            near = 1e3 * self.measures["distance"]
            within = {f"{mm:g}": (near <= mm) & ~self.impossible for mm in TOLERANCES_MM}
            found["success_at_mm"] = {mm: float(flags.mean()) for mm, flags in within.items()}
            found["success_at_mm_ci"] = {
                mm: list(wilson_interval(int(flags.sum()), total)) for mm, flags in within.items()
            }
        for name, values in self.measures.items():
            key, unit = _MEASURES[name]
            values = unit * values
            middle, high = bootstrap_intervals(values, (median, p95), resamples=RESAMPLES)
            found[key] = {"median": float(median(values)), "p95": float(p95(values)), "mean": float(values.mean())}
            found[f"{key}_ci"] = {"median": list(middle), "p95": list(high)}
        return found


def evaluate(
    policy: LearnedPolicy,
    *,
    goals: int = 1000,
    seed: int = HELD_OUT,
    options: Mapping[str, Any] | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Evaluation:
    """Play one episode for each goal.

    Args:
        policy: Of any of the environments.
        goals: How many; those of a smaller number are the first of a larger one.
        seed: Of the first goal; goal i is that of the environment's seed `seed + i`.
        options: Of the environment.
        progress: Told how many goals are done.

    Raises:
        InputError: No goals, or options that the environment does not take.
    """
    goals = check_count("the number of goals", goals, most=10**7)
    seed = check_count("seed", seed, least=0)
    parts = []
    for first in range(0, goals, BATCH):
        count = min(BATCH, goals - first)
        parts.append(_episodes(policy, count, seed + first, dict(options or {})))
        progress(first + count)
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return Evaluation(joined.pop("is_success"), joined.pop("impossible"), joined)


def _episodes(policy: LearnedPolicy, count: int, seed: int, options: dict[str, Any]) -> dict[str, Array]:
    env = gym.make_vec(policy.card.environment, num_envs=count, vectorization_mode="vector_entry_point", **options)
    found: dict[str, Array] = {"steps": np.zeros(count), "return": np.zeros(count)}
    pending = np.ones(count, dtype=np.bool_)
    try:
        observations, _ = env.reset(seed=seed)
        while pending.any():
            observations, rewards, terminated, truncated, info = env.step(policy.act(observations))
            found["steps"] += pending
            found["return"] += np.where(pending, rewards, 0.0)
            over = (terminated | truncated) & pending
            for name in ("is_success", "impossible", *_MEASURES):
                if name in info:
                    found.setdefault(name, np.zeros_like(info[name]))[over] = info[name][over]
            pending &= ~over
    finally:
        env.close()
    return found


#: Width that the table fits into [characters].
TABLE_WIDTH = 110


def evaluation_table(summaries: Mapping[str, Mapping[str, Any]], *, title: str) -> Table:
    """One row per policy; which columns depends on what the environment measures.

    Args:
        summaries: `Evaluation.summary()` by the name of the policy.
        title: Of the table.
    """
    table = Table(title=title, title_style="bold", title_justify="left", box=None, pad_edge=False, header_style="bold")
    first = next(iter(summaries.values()))
    reach = "success_at_mm" in first
    headings = ["reached % [95 % CI]", "impossible %", "distance mm\nmedian / p95"]
    headings += ["< 1 mm\n%", "< 2 mm\n%", "r_e\np95"] if reach else ["wrong\npresses", "energy\nmedian"]
    table.add_column("policy", no_wrap=True)
    for heading in [*headings, "steps\nmedian", "return\nmean"]:
        table.add_column(heading, justify="right", no_wrap=True)
    for name, summary in summaries.items():
        low, high = summary["reached_ci"]
        distance = summary["distance_mm"]
        cells = [
            f"{100 * summary['reached']:.2f} [{100 * low:.2f}, {100 * high:.2f}]",
            f"{100 * summary['impossible']:.2f}",
            f"{distance['median']:.3g} / {distance['p95']:.3g}",
        ]
        if reach:
            success = summary["success_at_mm"]
            cells += [
                f"{100 * success['1']:.2f}",
                f"{100 * success['2']:.2f}",
                f"{summary['posture_error']['p95']:.3f}",
            ]
        else:
            cells += [f"{summary['wrong_presses']['mean']:.2f}", f"{summary['energy']['median']:.3g}"]
        cells += [f"{summary['steps']['median']:.0f}", f"{summary['return']['mean']:.2f}"]
        table.add_row(name, *cells)
    return table
