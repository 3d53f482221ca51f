"""Evaluate policies: one deterministic episode for each of many goals that no training draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from rich.table import Table

from kinreach._checks import check_count
from kinreach._statistics import RATE, SPREAD, Column, Trial, success_columns, summarise, tables, thousandfold
from kinreach.baselines._batch import make_batch
from kinreach.baselines._loop import rollout_batch
from kinreach.baselines._policies import LearnedPolicy

Array = np.ndarray[Any, Any]

#: Seed of goals to choose settings by, above those of trainings (below 2**31).
VALIDATION = 2**40
#: Seed of goals for results, which no choice was made by.
HELD_OUT = 2**41
#: The same by the names that the command line uses.
SPLITS: Mapping[str, int] = {"held-out": HELD_OUT, "validation": VALIDATION}
#: Episodes in step, and resamples of a bootstrap.
BATCH, RESAMPLES = 500, 500
#: Width that the table fits into [characters].
TABLE_WIDTH = 110

_DISTANCE = Column("distance_mm", thousandfold("distance"), SPREAD, "distance mm\nmedian / p95", "quantiles", digits=3)
#: What is reported of an episode, if `info` has it.
COLUMNS: Sequence[Column] = (
    Column("reached", "reached", RATE, "reached % [95 % CI]", "interval"),
    Column("impossible", "impossible", RATE, "impossible %", "share"),
    _DISTANCE,
    *success_columns(lambda trial: not trial["impossible"]),
    Column("posture_error", "posture_error", SPREAD, "r_e\np95", "p95"),
    Column("wrong_presses", "wrong_presses", SPREAD, "wrong\npresses", "mean"),
    Column("energy", "energy", SPREAD, "energy\nmedian", "median"),
    Column("steps", "steps", SPREAD, "steps\nmedian", "median", digits=4),
    Column("return", "return", SPREAD, "return\nmean", "mean"),
)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Episodes of one policy.

    Attributes:
        trials: One for each goal, as `rollout_batch` returns them.
    """

    trials: Sequence[Trial]

    @cached_property
    def reached(self) -> Array:
        """The task's own criterion, shape (goals,)."""
        return np.array([trial["reached"] for trial in self.trials])

    @cached_property
    def impossible(self) -> Array:
        """Whether the last action was impossible, shape (goals,)."""
        return np.array([trial["impossible"] for trial in self.trials])

    @cached_property
    def measures(self) -> Mapping[str, Array]:
        """Last values of the episodes by name, shape (goals,): `distance` [m], `steps`, `return` and other numbers."""
        first = self.trials[0]
        names = [
            name for name, value in first.items() if isinstance(value, int | float) and not isinstance(value, bool)
        ]
        return {name: np.array([trial[name] for trial in self.trials], dtype=np.float64) for name in names}

    def summary(self) -> dict[str, Any]:
        """Rates, medians, 95th percentiles and means with 95 % intervals, as JSON types, of what was measured."""
        columns = [column for column in COLUMNS if any(column.of(trial) is not None for trial in self.trials)]
        return {"goals": len(self.trials), **summarise(columns, self.trials, resamples=RESAMPLES)}


def evaluate(
    policy: LearnedPolicy,
    *,
    goals: int = 1000,
    seed: int = HELD_OUT,
    environment: str | None = None,
    options: Mapping[str, Any] | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Evaluation:
    """Play one episode for each goal.

    Args:
        policy: As `load_policy` returns it.
        goals: How many; those of a smaller number are the first of a larger one.
        seed: Of the first goal; goal i is that of the environment's seed `seed + i`.
        environment: Id; that of the policy's card if None.
        options: Of the environment; by default with the arm and goals that the policy was trained on.
        progress: Called with the number of finished goals.

    Raises:
        InputError: No goals, or options that the environment does not take.
    """
    goals = check_count("the number of goals", goals, most=10**7)
    seed = check_count("seed", seed, least=0)
    environment = policy.card.environment if environment is None else environment
    options = {**policy.needed_options, **(options or {})}
    trials: list[Trial] = []
    for first in range(0, goals, BATCH):
        env = make_batch(environment, min(BATCH, goals - first), options)
        try:
            trials += rollout_batch(env, policy, seed=seed + first)
        finally:
            env.close()
        progress(len(trials))
    return Evaluation(trials)


def evaluation_table(summaries: Mapping[str, Mapping[str, Any]], *, title: str) -> Table:
    """Return a table of summaries by the name of the policy; which columns depends on what was measured."""
    entries = [{**summary, "name": name} for name, summary in summaries.items()]
    return tables(COLUMNS, entries, title=title, width=TABLE_WIDTH)[0]
