"""What the thesis reads off its curves (chapter 5), and the same of five trainings with its settings.

    python -m benchmarks.studies.thesis_curves [--runs results/train]

By default of the logs and policies in `benchmarks/logs`, in seconds; with `--runs` of own trainings of
`thesis-ppo-single` and `thesis-ppo-multi`. What the policies do without exploration is of 1000 held-out goals of the
table. The third table is of trainings of single-step that `benchmarks.studies.ppo2` and `thesis_world` made side by
side.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.logs import EPISODE, FOLDER, Log, load_logs, logged_policies
from benchmarks.studies.tables import head, line
from benchmarks.studies.trainings import trainings_interval
from kinreach._statistics import Statistic, mean, median
from kinreach.baselines._evaluation import evaluate
from kinreach.baselines._learning_curve import read_curve
from kinreach.baselines._policies import LearnedPolicy
from kinreach.cli import Parser, finish
from kinreach.thesis._reward import IMPOSSIBLE_REWARD

PROG = "python -m benchmarks.studies.thesis_curves"

#: Episodes of single-step on either side of one, and of multi-step steps at the beginning and at the end.
AROUND, FIRST, LAST = 1000, 5_000, 15_000
#: Actions of an episode of multi-step, of them those after which the thesis's example is nearest (figure 5.5), steps
#: between two updates of it (4.2), and held-out goals of a policy.
ACTIONS, NEAREST, UPDATE, GOALS = 100, 90, 4096, 1000
#: Cells of `benchmarks.studies.ppo2`: the most faithful reading, and the same paid for the distance alone.
FAITHFUL: Mapping[str, int] = {"raw": 1, "value_clip": 1, "openai": 0, "natural_arm": 1, "gripper": 1}
DISTANCE_ALONE: Mapping[str, int] = {**FAITHFUL, "natural_arm": 0, "gripper": 0}


@dataclass(frozen=True, eq=False)
class Row:
    """Of the table.

    Attributes:
        what, thesis: What is measured, and what the thesis says of it.
        digits: Decimals.
        values: One number for each training; of policies one for each goal as well, shape (seeds, goals).
        statistic: Of the goals of a policy.
        unit: What the numbers are multiplied by.
        least, most: Bounds of the numbers.
    """

    what: str
    thesis: str
    digits: int
    values: Any
    statistic: Statistic = mean
    unit: float = 1.0
    least: float = 0.0
    most: float = math.inf

    def cells(self) -> str:
        """The value of each seed, and the mean with Student's interval over them."""
        values = np.asarray(self.values)
        values = values if values.ndim > 1 else values[:, None]
        each = [self.unit * float(self.statistic(one.astype(float))) for one in values]
        bounds = trainings_interval(values, self.statistic, least=self.least, most=self.most)
        low, high = (f"{self.unit * bound:.{self.digits}f}" for bound in bounds)
        numbers = (f"{value:.{self.digits}f}" for value in each)
        return line(self.what, self.thesis, *numbers, f"{np.mean(each):.{self.digits}f} [{low}, {high}]")


def possible(log: Mapping[str, Any], rows: Any) -> float:
    """Mean reward of the steps that were possible."""
    impossible = log["impossible"][rows]
    return float((log["reward"][rows] - IMPOSSIBLE_REWARD * impossible).sum() / (1 - impossible).sum())


def possible_each(log: Mapping[str, Any]) -> np.ndarray[Any, Any]:
    """The same of every window."""
    found: np.ndarray[Any, Any] = (log["reward"] - IMPOSSIBLE_REWARD * log["impossible"]) / (1 - log["impossible"])
    return found


def due_to_impossible(log: Mapping[str, Any]) -> float:
    """Share of the variance of the reward's changes, from window to window, that is gone without impossible steps."""
    return float(1 - np.diff(possible_each(log)).var() / np.diff(log["reward"]).var())


def across_updates(log: Mapping[str, Any]) -> float:
    """By how much rewards two windows apart differ if an update is between, as a multiple of without one."""
    reward, end = possible_each(log), log["steps"]
    rollout, begun = (end - 1) // UPDATE, np.append(0, end[:-1]) // UPDATE
    whole = rollout == begun
    pairs = whole[:-2] & whole[2:]
    change, updated = np.abs(reward[2:] - reward[:-2]), rollout[2:] != rollout[:-2]
    return float(change[pairs & updated].mean() / change[pairs & ~updated].mean())


def above_zero(log: Mapping[str, Any]) -> float:
    """From which episode on the mean around it stays above 0."""
    at = log["episodes"]
    return float(max(middle for middle in at if possible(log, np.abs(at - middle) <= AROUND) <= 0))


def reached(log: Mapping[str, Any], rows: Any) -> float:
    """Episodes that reached the goal."""
    ended = np.diff(log["episodes"], prepend=0.0)
    return float(round((np.nan_to_num(log["reached"]) * ended)[rows].sum()))


def single_rows(logs: Mapping[int, Log]) -> Iterator[Row]:
    """Yield the rows of the single-step task (thesis, section 5.1)."""

    def each(measure: Callable[[Log, Any], float]) -> list[float]:
        return [measure(log, log["episodes"]) for log in logs.values()]

    for middle, says in ((20_000, "0"), (50_000, "2"), (75_000, "2"), (100_000, "2")):
        values = [possible(log, np.abs(log["episodes"] - middle) <= AROUND) for log in logs.values()]
        yield Row(f"reward if possible, around episode {middle}", says, 2, values, least=-math.inf)
    for middle in (50_000, 75_000):
        values = each(lambda log, at, middle=middle: log["reward"][np.abs(at - middle) <= AROUND].mean())
        yield Row(f"reward, impossible episodes counted, around episode {middle}", "-", 2, values, least=-math.inf)
    yield Row("above 0 for good from episode", "20000", 0, each(lambda log, at: above_zero(log)))
    values = each(lambda log, at: log["distance"][np.abs(at - 75_000) <= AROUND].mean())
    yield Row("distance, mm, mean around episode 75000", "< 100", 0, values, unit=1e3)
    for first in (256, 2048):
        values = [log["impossible"][log["episodes"] <= first].mean() for log in logs.values()]
        yield Row(f"impossible, % of the first {first} episodes", "most", 1, values, unit=100, most=1.0)
    share = "impossible, % of the episodes"
    values = each(lambda log, at: log["impossible"][np.abs(at - 20_000) <= AROUND].mean())
    yield Row(f"{share} around 20000", "-", 1, values, unit=100, most=1.0)
    values = each(lambda log, at: log["impossible"][at > at[-1] - 10_000].mean())
    yield Row(f"{share}, last 10000", "more", 1, values, unit=100, most=1.0)
    yield Row("goals reached, first half", "-", 0, each(lambda log, at: reached(log, at <= at[-1] / 2)))
    yield Row("goals reached, second half", "more", 0, each(lambda log, at: reached(log, at > at[-1] / 2)))


def multi_rows(logs: Mapping[int, Log], episodes: Mapping[int, Log]) -> Iterator[Row]:
    """Yield the rows of the multi-step task (thesis, section 5.2)."""
    first = {seed: log["steps"] <= FIRST for seed, log in logs.items()}
    last = {seed: log["steps"] > log["steps"][-1] - LAST for seed, log in logs.items()}
    for when, says, rows in ((f"first {FIRST} steps", "less", first), (f"last {LAST} steps", "near 126.79", last)):
        values = [ACTIONS * possible(log, rows[seed]) for seed, log in logs.items()]
        yield Row(f"reward of {ACTIONS} possible actions, {when}", says, 0, values, least=-math.inf)
    for when, rows in ((f"first {FIRST} steps", first), (f"last {LAST} steps", last)):
        values = [ACTIONS * float(log["reward"][rows[seed]].mean()) for seed, log in logs.items()]
        yield Row(f"reward of {ACTIONS} actions, impossible ones counted, {when}", "-", 0, values, least=-math.inf)
    for when, rows in ((f"first {FIRST} steps", first), (f"last {LAST} steps", last)):
        values = [float(np.nanmean(log["distance"][rows[seed]])) for seed, log in logs.items()]
        yield Row(f"distance in the end of an episode, mm, {when}", "-", 0, values, unit=1e3)
    values = [np.nanmin(log["distance"]) for log in logs.values()]
    yield Row("the same, mm, in the best 1000 steps", "-", 0, values, unit=1e3)
    yield Row("goals reached", "a few", 0, [reached(log, slice(None)) for log in logs.values()])
    values = [log["impossible"][first[seed]].mean() for seed, log in logs.items()]
    yield Row(f"impossible, % of the first {FIRST} steps", "most", 1, values, unit=100, most=1.0)
    values = [due_to_impossible(log) for log in logs.values()]
    yield Row("impossible steps, % of the reward's fluctuation", "-", 1, values, unit=100, most=1.0)
    values = [across_updates(log) for log in logs.values()]
    yield Row("change of the reward over an update / without one", "more", 2, values)
    distances = [log["distance"] for log in episodes.values()]
    for what, says, values in (
        ("at first", "500", [d[0] for d in distances]),
        (f"after {NEAREST} steps", "30", [d[NEAREST - 1] for d in distances]),
        ("nearest", "-", [d.min() for d in distances]),
        ("in the end", "-", [d[-1] for d in distances]),
    ):
        yield Row(f"distance, mm, of the episode at 25000 steps, {what}", says, 0, values, unit=1e3)


def policy_rows(policies: Mapping[int, LearnedPolicy]) -> Iterator[Row]:
    """Yield the rows of the trained policies, without exploration."""
    found = [evaluate(policy, goals=GOALS, options={"backend": "kinematic"}) for policy in policies.values()]
    distance = [one.measures["distance"] for one in found]
    yield Row("the policy: distance, mm, median", "-", 0, distance, statistic=median, unit=1e3)
    yield Row("the policy: impossible, %", "-", 1, [one.impossible for one in found], unit=100, most=1.0)
    yield Row("the policy: goals reached, %", "-", 1, [one.reached for one in found], unit=100, most=1.0)


def side_by_side_rows() -> Iterator[Row]:
    """Of five more trainings in the most faithful reading, and of what differs from it in one thing."""
    readings, worlds = (read_curve(FOLDER / "thesis-ppo-single" / name) for name in ("readings.csv", "worlds.csv"))

    def of(columns: Mapping[str, Any], where: Mapping[str, int], column: str) -> np.ndarray[Any, Any]:
        rows = np.all([columns[name] == value for name, value in where.items()], axis=0)
        found: np.ndarray[Any, Any] = columns[column][rows]
        return found

    yield Row("goals reached in training", "-", 0, of(readings, FAITHFUL, "reached_training"))
    yield Row("the policy: distance, mm, median", "-", 0, of(readings, FAITHFUL, "distance"))
    yield Row("the policy: goals reached, %", "-", 1, of(readings, FAITHFUL, "reached"), most=100)
    deviation = [of(readings, FAITHFUL, f"std_j{joint}") for joint in range(6)]
    yield Row("standard deviation, rad, at first 1, in the end: j0 to j4", "less", 2, np.mean(deviation[:5], axis=0))
    yield Row("the same, j5", "less", 2, deviation[5])
    values = of(readings, DISTANCE_ALONE, "near")
    yield Row("paid for the distance alone: came within 10 mm, %", "-", 1, values, most=100)
    for multi, task in enumerate(("single", "multi")):
        exact, loose = (of(worlds, {"multi": multi, "world": world}, "distance_0") for world in (0, 2))
        what = f"farther, mm, if trained with joints off by up to 0.01 rad: {task}-step"
        yield Row(what, "more", 0, loose - exact, least=-math.inf)


def tables(runs: Path | None = None) -> list[str]:
    """Those of single-step and of multi-step, and of `benchmarks/logs` that of five more trainings, as Markdown."""
    single, multi = (load_logs(name, runs=runs) for name in ("thesis-ppo-single", "thesis-ppo-multi"))
    curves = (single_rows(single), multi_rows(multi, load_logs("thesis-ppo-multi", EPISODE, runs=runs)))
    measured = {}
    for task, rows in zip(("single", "multi"), curves, strict=True):
        measured[f"{task}-step"] = [*rows, *policy_rows(logged_policies(f"thesis-ppo-{task}", runs=runs))]
    if runs is None:
        measured["single-step, five more"] = list(side_by_side_rows())
    titles = ("the thesis", *(f"seed {seed}" for seed in single), "mean [95 % CI over seeds]")
    return ["\n".join([head(what, *titles), *(row.cells() for row in rows)]) for what, rows in measured.items()]


def main(argv: list[str] | None = None) -> int:
    """Print the tables."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, help="folder of own trainings instead of benchmarks/logs")
    print("\n\n".join(tables(parser.parse_args(argv).runs)))
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
