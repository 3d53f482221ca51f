"""All trainings (seeds) of a recipe, evaluated on the same goals, and what a row of a table says of them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.studies.tables import head, line
from kinreach.baselines.evaluation import Evaluation, evaluate
from kinreach.baselines.policies import load_policy
from kinreach.errors import InputError
from kinreach.statistics import Statistic, mean, trainings_interval

POLICY = "policy.safetensors"
RESAMPLES = 500
#: Under a table in which an interval has one training to go by.
ONE_SEED = "One seed: the interval is that of the goals, and says nothing about other trainings."


def finished(runs: Path, recipes: Iterable[str]) -> dict[str, list[Path]]:
    """Folders of the trainings that were finished, by recipe, and by seed.

    Raises:
        InputError: There is none of any of the recipes.
    """
    found = {}
    for recipe in recipes:
        folders = [path.parent for path in (runs / recipe).glob("seed-*/run.json") if path.with_name(POLICY).exists()]
        if folders:
            found[recipe] = sorted(folders, key=lambda folder: (len(folder.name), folder.name))
    if not found:
        raise InputError(
            f"no finished training of {', '.join(recipes)} in {runs}; "
            f"`python -m kinreach.train RECIPE --seeds 5 --out {runs}` makes them"
        )
    return found


@dataclass(frozen=True, eq=False)
class Trainings:
    """What was trained by one recipe.

    Attributes:
        recipe: Its name.
        found: What each policy did, on the same goals.
        seconds: Processor time of each training.
    """

    recipe: str
    found: list[Evaluation]
    seconds: list[float]

    @classmethod
    def evaluated(cls, recipe: str, folders: Iterable[Path], *, goals: int, options: Mapping[str, Any]) -> Trainings:
        """Evaluate the policies in these folders on the held-out goals."""
        found, seconds = [], []
        for folder in folders:
            seconds.append(json.loads((folder / "run.json").read_text(encoding="utf-8"))["cpu_seconds"])
            found.append(evaluate(load_policy(folder / POLICY), goals=goals, options=options))
        return cls(recipe, found, seconds)

    @property
    def reached(self) -> np.ndarray:
        """Whether the task's own criterion was met, shape (seeds, goals)."""
        return np.stack([one.reached for one in self.found])

    @property
    def impossible(self) -> np.ndarray:
        """Whether the last action was impossible, shape (seeds, goals)."""
        return np.stack([one.impossible for one in self.found])

    def measured(self, name: str) -> np.ndarray:
        """One of the measures, shape (seeds, goals)."""
        return np.stack([one.measures[name] for one in self.found])

    def row(self, cells: Iterable[str]) -> str:
        """A row of a Markdown table: recipe and seeds, the cells, and how long training took."""
        seconds = f"{min(self.seconds):.0f}–{max(self.seconds):.0f}"
        return line(f"`{self.recipe}`", len(self.found), *cells, seconds)


def decimals_for(value: float) -> int:
    """As many decimals as show three digits of a value that is not negative."""
    return max(0, 2 - math.floor(math.log10(value))) if value > 0 else 2


def with_interval(
    values: np.ndarray, statistic: Statistic = mean, *, unit: float = 1.0, decimals: int | None = None
) -> str:
    """The mean over the seeds of a statistic of what is not negative, and its interval.

    Args:
        values: Shape (seeds, goals).
        statistic: Of the goals of a seed.
        unit: What to multiply with.
        decimals: As many as show three digits of the mean if None.
    """
    low, high = trainings_interval(values, statistic, least=0.0, resamples=RESAMPLES)
    middle = float(np.mean(statistic(values, axis=1)))
    decimals = decimals_for(unit * middle) if decimals is None else decimals
    said, first, last = (f"{unit * value:.{decimals}f}" for value in (middle, low, high))
    return f"{said} [{first}, {last}]"


def print_table(
    headings: Iterable[str], rows: Iterable[Trainings], cells: Callable[[Trainings], Iterable[str]]
) -> None:
    """Print a Markdown table, each row as soon as it is measured."""
    names = ("recipe", "seeds", *headings, "training, s of processor")
    print(head(*names))
    seeds = []
    for trainings in rows:
        print(trainings.row(cells(trainings)), flush=True)
        seeds.append(len(trainings.found))
    if 1 in seeds:
        print(f"\n{ONE_SEED}")
