"""All trainings (seeds) of a recipe, evaluated on the same goals, and their row in a table."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from benchmarks.studies.tables import head, line
from kinreach._statistics import CONFIDENCE, Interval, Statistic, bootstrap_intervals, mean, wilson_interval
from kinreach.baselines._evaluation import Evaluation, evaluate
from kinreach.baselines._policies import load_policy
from kinreach.errors import InputError

POLICY = "policy.safetensors"
RESAMPLES = 500
#: Under a table in which an interval has one training to go by.
ONE_SEED = "One seed: the interval is that of the goals, and says nothing about other trainings."


def trainings_interval(
    values: ArrayLike,
    statistic: Statistic = mean,
    *,
    least: float = -math.inf,
    most: float = math.inf,
    resamples: int = 2000,
    seed: int = 0,
    confidence: float = CONFIDENCE,
) -> Interval:
    r"""What a recipe achieves, from several trainings of it (seeds) that were evaluated on the same goals.

    The estimate is the mean over the trainings of each one's statistic, $m$. Its interval has two parts. Chance in
    training: Student's $m \pm t_{n - 1} s / \sqrt n$ over the n trainings, for the training is what was repeated
    independently, not the episode (Henderson et al. 2018, arXiv:1709.06560; Colas, Sigaud and Oudeyer 2018,
    arXiv:1806.08295; Agarwal et al. 2021, arXiv:2108.13264). Chance in the goals, which all trainings share: Wilson's
    interval of the mean share among the goals of one training where values are truth values, otherwise the percentile
    bootstrap that draws goals, with what all trainings did on each. Distances of the bounds from m add up by their
    squares, on each side by itself (Zou and Donner 2008, Stat. Med. 27), so neither part is wider than the result.

    One training gives the second part only, and says nothing about other trainings. Equal trainings have no spread:
    five of them that all succeed do not exclude that one in ten fails. Where one training in five fails altogether, a
    third of all groups of five have none that does, and the interval holds the true mean in 67 % of the groups, not in
    95 %: give the results of the single trainings beside it.

    Args:
        values: What each training did on each goal, shape (trainings, goals), finite; the mean
            of truth values is a share.
        statistic: Of the values of a training.
        least: No value can be less; the interval ends there. Of shares 0.
        most: No value can be more. Of shares 1.
        resamples: Of the bootstrap.
        seed: Of the bootstrap.
        confidence: Share of experiments whose interval holds the true value.

    Returns:
        Low and high bound of the mean over all possible trainings, on all possible goals.

    Raises:
        InputError: `values` are empty, not two-dimensional, or not finite; `least` is above `most`, or an option is not
            of its kind.
    """
    if not least <= most:
        raise InputError(f"least must not be above most, got {least:g} and {most:g}")
    sample = np.asarray(values, dtype=np.float64)
    if sample.ndim != 2 or not sample.size or not np.isfinite(sample).all():
        raise InputError(f"values must be a row of finite numbers for each training, got shape {sample.shape}")
    shares = statistic is mean and np.asarray(values).dtype == np.bool_
    least, most = (max(least, 0.0), min(most, 1.0)) if shares else (least, most)
    each = np.asarray(statistic(sample, axis=1), dtype=np.float64)
    trainings, goals = sample.shape
    middle = float(each.mean())
    if shares:
        mean_successes = sample.sum() / trainings  # no integer, so the bounds are those of its neighbours
        low = wilson_interval(math.floor(mean_successes), goals, confidence=confidence)[0]
        high = wilson_interval(math.ceil(mean_successes), goals, confidence=confidence)[1]
    else:
        ((low, high),) = bootstrap_intervals(
            sample, (statistic,), resamples=resamples, seed=seed, confidence=confidence
        )
    spread = 0.0
    if trainings > 1:
        spread = stdtrit(trainings - 1, 0.5 + confidence / 2) * float(each.std(ddof=1)) / math.sqrt(trainings)
    below, above = math.hypot(spread, max(0.0, middle - low)), math.hypot(spread, max(0.0, high - middle))
    return max(least, middle - below), min(most, middle + above)


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
    middle_text, first, last = (f"{unit * value:.{decimals}f}" for value in (middle, low, high))
    return f"{middle_text} [{first}, {last}]"


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
