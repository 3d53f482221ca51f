"""What the thesis reads off its curves (chapter 5), and the same of five trainings with its settings.

    python -m benchmarks.studies.thesis_curves [--runs results/train]

By default of the logs and policies that come with the package, in seconds; with `--runs` of own trainings of
`thesis-single` and `thesis-multi`. What the policies do without exploration is of 1000 held-out goals of the table.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.studies.tables import head, line
from kinreach.baselines.evaluation import evaluate
from kinreach.baselines.logs import EPISODE, Log, load_logs, logged_policies
from kinreach.baselines.policies import LearnedPolicy
from kinreach.cli import Parser, finish
from kinreach.statistics import Statistic, mean, median, trainings_interval
from kinreach.thesis.reward import IMPOSSIBLE_REWARD

PROG = "python -m benchmarks.studies.thesis_curves"

#: Episodes of single-step on either side of one, and of multi-step steps at the beginning and at the end.
AROUND, FIRST, LAST = 1000, 5_000, 15_000
#: Actions of an episode of multi-step, and held-out goals of a policy.
ACTIONS, GOALS = 100, 1000


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
        said = (f"{value:.{self.digits}f}" for value in each)
        return line(self.what, self.thesis, *said, f"{np.mean(each):.{self.digits}f} [{low}, {high}]")


def possible(log: Mapping[str, Any], rows: Any) -> float:
    """Mean reward of the steps that were possible."""
    impossible = log["impossible"][rows]
    return float((log["reward"][rows] - IMPOSSIBLE_REWARD * impossible).sum() / (1 - impossible).sum())


def above_zero(log: Mapping[str, Any]) -> float:
    """From which episode on the mean around it stays above 0."""
    at = log["episodes"]
    return float(max(middle for middle in at if possible(log, np.abs(at - middle) <= AROUND) <= 0))


def reached(log: Mapping[str, Any], rows: Any) -> float:
    """Episodes that reached the goal."""
    ended = np.diff(log["episodes"], prepend=0.0)
    return float(round((np.nan_to_num(log["reached"]) * ended)[rows].sum()))


def single_rows(logs: Mapping[int, Log]) -> Iterator[Row]:
    """Of single-step (5.1)."""

    def each(measure: Callable[[Log, Any], float]) -> list[float]:
        return [measure(log, log["episodes"]) for log in logs.values()]

    for middle, says in ((20_000, "0"), (50_000, "2"), (75_000, "2"), (100_000, "2")):
        values = [possible(log, np.abs(log["episodes"] - middle) <= AROUND) for log in logs.values()]
        yield Row(f"reward if possible, around episode {middle}", says, 2, values, least=-math.inf)
    yield Row("above 0 for good from episode", "20000", 0, each(lambda log, at: above_zero(log)))
    share = "impossible, % of the episodes"
    values = each(lambda log, at: log["impossible"][np.abs(at - 20_000) <= AROUND].mean())
    yield Row(f"{share} around 20000", "-", 1, values, unit=100, most=1.0)
    values = each(lambda log, at: log["impossible"][at > at[-1] - 10_000].mean())
    yield Row(f"{share}, last 10000", "more", 1, values, unit=100, most=1.0)
    yield Row("goals reached, first half", "-", 0, each(lambda log, at: reached(log, at <= at[-1] / 2)))
    yield Row("goals reached, second half", "more", 0, each(lambda log, at: reached(log, at > at[-1] / 2)))


def multi_rows(logs: Mapping[int, Log], episodes: Mapping[int, Log]) -> Iterator[Row]:
    """Of multi-step (5.2)."""
    first = {seed: log["steps"] <= FIRST for seed, log in logs.items()}
    last = {seed: log["steps"] > log["steps"][-1] - LAST for seed, log in logs.items()}
    for when, says, rows in ((f"first {FIRST} steps", "less", first), (f"last {LAST} steps", "126.79", last)):
        values = [ACTIONS * possible(log, rows[seed]) for seed, log in logs.items()]
        yield Row(f"reward of {ACTIONS} possible actions, {when}", says, 0, values, least=-math.inf)
    for when, rows in ((f"first {FIRST} steps", first), (f"last {LAST} steps", last)):
        values = [float(np.nanmean(log["distance"][rows[seed]])) for seed, log in logs.items()]
        yield Row(f"distance in the end of an episode, mm, {when}", "-", 0, values, unit=1e3)
    yield Row("goals reached", "a few", 0, [reached(log, slice(None)) for log in logs.values()])
    distances = [log["distance"] for log in episodes.values()]
    for what, says, values in (
        ("at first", "500", [d[0] for d in distances]),
        ("nearest", "30", [d.min() for d in distances]),
        ("in the end", "30", [d[-1] for d in distances]),
    ):
        yield Row(f"distance, mm, of the episode at 25000 steps, {what}", says, 0, values, unit=1e3)


def policy_rows(policies: Mapping[int, LearnedPolicy]) -> Iterator[Row]:
    """Of policies without exploration."""
    found = [evaluate(policy, goals=GOALS, options={"backend": "kinematic"}) for policy in policies.values()]
    distance = [one.measures["distance"] for one in found]
    yield Row("the policy: distance, mm, median", "-", 0, distance, statistic=median, unit=1e3)
    yield Row("the policy: impossible, %", "-", 1, [one.impossible for one in found], unit=100, most=1.0)
    yield Row("the policy: goals reached, %", "-", 1, [one.reached for one in found], unit=100, most=1.0)


def tables(runs: Path | None = None) -> list[str]:
    """That of single-step and that of multi-step, as Markdown."""
    single, multi = (load_logs(name, runs=runs) for name in ("thesis-single", "thesis-multi"))
    curves = (single_rows(single), multi_rows(multi, load_logs("thesis-multi", EPISODE, runs=runs)))
    found = []
    for task, rows in zip(("single", "multi"), curves, strict=True):
        heading = head(f"{task}-step", "the thesis", *(f"seed {seed}" for seed in single), "mean [95 % CI over seeds]")
        policies = logged_policies(f"thesis-{task}", runs=runs)
        found.append("\n".join([heading, *(row.cells() for row in (*rows, *policy_rows(policies)))]))
    return found


def main(argv: list[str] | None = None) -> int:
    """Print the tables."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, help="folder of own trainings instead of the package's logs")
    print("\n\n".join(tables(parser.parse_args(argv).runs)))
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
