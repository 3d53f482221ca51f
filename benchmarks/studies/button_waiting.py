"""What policies do in the course report's world: press, or wait at the target, which pays more there.

    python -m kinreach.train benchmarks.learners:button_report_both --seeds 5        (and the other recipes)
    python -m benchmarks.studies.button_waiting results/train

The first rows are without training: the analytic controller, the same that moves to the target and never presses, and
random actions.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

import benchmarks.learners  # noqa: F401 (registers its recipes)
from benchmarks.learners.button import REPORT_OPTIONS
from benchmarks.studies.tables import head, line
from benchmarks.studies.trainings import POLICY, finished, with_interval
from kinreach._checks import Floats
from kinreach._registration import BUTTON
from kinreach.baselines._batch import make_batch
from kinreach.baselines._button_controller import ButtonController
from kinreach.baselines._evaluation import HELD_OUT
from kinreach.baselines._loop import Policy, rollout_batch
from kinreach.baselines._policies import load_policy
from kinreach.baselines._recipes import RECIPES
from kinreach.cli import Parser, finish
from kinreach.envs._button.button_task import ACTIONS, PRESS_RADIUS

PROG = "python -m benchmarks.studies.button_waiting"
HEADINGS = (
    "policy", "seeds", "pressed, % [95 % CI over seeds]", "every seed, %",
    "pressed, or at the target at the end, every seed, %", "wrong presses an episode, every seed",
    "reward of an episode, every seed",
)  # fmt: skip


class Controller:
    """The analytic controller for a batch; with `presses=False` it stays at the target until the episode is over."""

    def __init__(self, count: int, *, presses: bool) -> None:
        self._controller, self._presses = ButtonController("report", count=count), presses

    def reset(self, observation: Floats, info: Mapping[str, Any]) -> None:
        """Begin an episode with another target in every environment."""
        self._controller.restart()

    def act(self, observation: Floats) -> Any:
        """Return the actions for observations, shape (count, 19)."""
        actions = self._controller.actions(observation)
        return actions if self._presses else actions % (ACTIONS // 2)


class Chance:
    """Random actions."""

    def __init__(self, count: int) -> None:
        self._count, self._rng = count, np.random.default_rng(0)

    def reset(self, observation: Floats, info: Mapping[str, Any]) -> None:
        """Do nothing."""

    def act(self, observation: Floats) -> Any:
        """Return random actions."""
        return self._rng.integers(0, ACTIONS, self._count)


def tried(policy: Policy, goals: int, options: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """What a policy did on the held-out targets, each of shape (goals,)."""
    with closing(make_batch(BUTTON, goals, options)) as env:
        trials = rollout_batch(env, policy, seed=HELD_OUT)
    return {
        "pressed": np.array([trial["reached"] for trial in trials], dtype=np.bool_),
        "there": np.array([trial["reached"] or trial["distance"] < PRESS_RADIUS for trial in trials], dtype=np.bool_),
        "wrong": np.array([trial["wrong_presses"] for trial in trials], dtype=np.float64),
        "return": np.array([trial["return"] for trial in trials], dtype=np.float64),
    }


def row(name: str, seeds: str, found: list[dict[str, np.ndarray]]) -> str:
    """A row of the table, of all trainings of a recipe."""

    def every(key: str, form: str, unit: float = 1.0) -> str:
        return ", ".join(f"{unit * one[key].mean():{form}}" for one in found)

    pressed = with_interval(np.stack([one["pressed"] for one in found]), unit=100, decimals=1)
    return line(
        name, seeds, pressed, every("pressed", ".1f", 100), every("there", ".1f", 100), every("wrong", ".2f"),
        every("return", ".0f"),
    )  # fmt: skip


def table(trained: Mapping[str, list[Path]], goals: int) -> Iterator[str]:
    """Yield the rows as they are measured, those of trained recipes by their folders last."""
    untrained: dict[str, Policy] = {
        "controller": Controller(goals, presses=True),
        "controller that never presses": Controller(goals, presses=False),
        "random actions": Chance(goals),
    }
    for name, policy in untrained.items():
        yield row(name, "–", [tried(policy, goals, REPORT_OPTIONS)])
    for recipe, folders in trained.items():
        options = RECIPES[recipe].options
        found = [tried(load_policy(folder / POLICY), goals, options) for folder in folders]
        yield row(f"`{recipe}`", str(len(found)), found)


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    in_the_world = [name for name, recipe in RECIPES.items() if recipe.options.get("actuation") == "report"]
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="the folder that `kinreach train --out` wrote to")
    parser.add_argument("--recipes", metavar="A,B", default=",".join(in_the_world), help="default: all in this world")
    parser.add_argument("--goals", type=int, default=300, help="targets, the same for every seed")
    arguments = parser.parse_args(argv)
    trained = finished(arguments.runs, arguments.recipes.split(","))
    print(head(*HEADINGS))
    for text in table(trained, arguments.goals):
        print(text, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
