"""Why the thesis's multi-step path planning does not reach: `sb3-multi-long`, changed in one thing at a time.

`python -m benchmarks.studies.thesis_multi_step results/train` trains what is missing, twenty policies of some 100 s on
one core each, then prints a table. With `--train VARIANT --seed K` it only trains that one.
With `--csv FILE` it also writes a row for each policy: notebook 04 reads such a file. With `--engine ray` the policies
are trained side by side; machines must share the folder.
"""

from __future__ import annotations

import argparse
import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from benchmarks.learners import sb3_multi_long
from benchmarks.logs import Trace, trace
from benchmarks.studies.parts import each
from benchmarks.studies.tables import head, line, spread
from kinreach._files import write_text
from kinreach._jobs import add_options
from kinreach.baselines._evaluation import HELD_OUT
from kinreach.baselines._learning_curve import curve_csv
from kinreach.baselines._policies import LearnedPolicy
from kinreach.baselines._policy_file import read_policy
from kinreach.baselines._recipes import Recipe
from kinreach.baselines._training import train
from kinreach.cli import Parser, finish
from kinreach.envs._reach.reach_task import MULTI_STEP
from kinreach.kinematics import URKinematics
from kinreach.thesis import REACHED_DISTANCE
from kinreach.thesis._reward import IMPOSSIBLE_REWARD, REACHED_REWARD

PROG = "python -m benchmarks.studies.thesis_multi_step"

#: Held-out goals of each policy, and decimals of what is measured on them.
GOALS, DIGITS = 1000, 3
_KINEMATICS = URKinematics("ur5-thesis", tip="tcp", base="world")
#: The standard deviation begins with the thesis's degree and ends with a quarter of it, as that of `ppo-multi`; the
#: learning rate stays the thesis's, which AdaptivePPO would otherwise adapt.
_SCHEDULE = {
    "exploration": {"first": 1 / 5, "last": 1 / 20, "until": 0.8},
    "adaptive": {"first": 2.5e-4, "target_kl": 1.0, "lowest": 2.5e-4, "highest": 2.5e-4},
}


def _going_on(recipe: Recipe) -> Recipe:
    """Reaching does not end the episode in training: a step at the goal pays 20, and the next one too."""
    return replace(recipe, options={**recipe.options, "end_on_reached": False})


def _scheduled(recipe: Recipe) -> Recipe:
    """The standard deviation follows the schedule instead of being learned."""
    return replace(recipe, algorithm="AdaptivePPO", settings={**recipe.settings, **_SCHEDULE})


#: Recipes by the name of their folder: the thesis's rules, each of two changed alone, and both.
VARIANTS: Mapping[str, Recipe] = {
    "sb3-multi-long": sb3_multi_long,
    "sb3-multi-long-going-on": _going_on(sb3_multi_long),
    "sb3-multi-long-shrinking": _scheduled(sb3_multi_long),
    "sb3-multi-long-both": _scheduled(_going_on(sb3_multi_long)),
}
#: Columns of the file; distances in mm, shares in percent, posture error in rad, standard deviations in degrees.
COLUMNS = (
    "ends", "learned", "seed", "distance", "above", "sideways", "posture_error", "reached", "near", "waited",
    "sampled_reached", "sampled_distance", "sampled_impossible", "std", *(f"std_j{joint}" for joint in range(6)),
)  # fmt: skip
#: Headings, columns and digits of the table.
_CELLS = (
    ("distance, mm", "distance", 1),
    ("above the ball, mm", "above", 1),
    ("beside it, mm", "sideways", 1),
    ("came within 10 mm, %", "near", 1),
    ("steps waited there", "waited", 1),
    ("reached, %", "reached", 1),
    ("reached with exploration, %", "sampled_reached", 1),
    ("standard deviation in the end, °", "std", 2),
    ("that of j1, °", "std_j1", 2),
)


class Sampled(LearnedPolicy):
    """A policy that explores as in training.

    Args:
        file: Of the policy.
        std: Standard deviations of the actions, shape (6,).
    """

    def __init__(self, file: Path, std: np.ndarray) -> None:
        super().__init__(*read_policy(file))
        self._std, self._rng = std, np.random.default_rng(0)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """A random action for each observation, shape (count, 6)."""
        mean = self._output(observation)
        return np.clip(mean + self._std * self._rng.normal(size=mean.shape), -1.0, 1.0)


def trained(runs: Path, variant: str, seed: int) -> Path:
    """The folder of a run with its `model.zip`, which holds the standard deviations; trained if it is missing."""
    folder = runs / variant / f"seed-{seed}"
    if not (folder / "model.zip").exists():
        train(replace(VARIANTS[variant], name=variant), folder, seed=seed, resume=True, export=True)
    return folder


def row(runs: Path, variant: str, seed: int) -> dict[str, float]:
    """Train a policy if it is missing, and measure it."""
    return measure(trained(runs, variant, seed), VARIANTS[variant], seed)


def measure(folder: Path, recipe: Recipe, seed: int) -> dict[str, float]:
    """What a policy does on held-out goals under the thesis's rule, with exploration and without, by `COLUMNS`."""
    with zipfile.ZipFile(folder / "model.zip") as archive:
        weights = torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)
    std = weights["log_std"].exp().numpy().astype(float)
    file = folder / "policy.safetensors"
    goals = _KINEMATICS.arm.workcell.goals.sample(np.random.default_rng(HELD_OUT), GOALS)
    options = {"backend": "kinematic"}
    found = trace(LearnedPolicy(*read_policy(file)), goals, options=options)
    sampled = trace(Sampled(file, std), goals, options=options)
    off = 1e3 * (_KINEMATICS.positions(found.q[-1]) - goals)
    steps = sampled.reward[~np.isnan(sampled.reward)]
    degrees = np.degrees(MULTI_STEP.scale) * std
    measured = {
        "ends": float(recipe.options.get("end_on_reached", True)),
        "learned": float("exploration" not in recipe.settings),
        "seed": seed,
        "distance": 1e3 * float(np.median(found.distance[-1])),
        "above": float(np.median(off[:, 2])),
        "sideways": float(np.median(np.hypot(off[:, 0], off[:, 1]))),
        "posture_error": float(np.median(found.posture_error[-1])),
        "reached": 100 * float(found.reached.mean()),
        "near": 100 * float((found.distance < REACHED_DISTANCE).any(axis=0).mean()),
        "waited": float(waits(found).sum() / GOALS),
        "sampled_reached": 100 * float(sampled.reached.mean()),
        "sampled_distance": 1e3 * float(np.median(sampled.distance[-1])),
        "sampled_impossible": 100 * float((steps == IMPOSSIBLE_REWARD).mean()),
        "std": float(degrees.mean()),
        **{f"std_j{joint}": float(value) for joint, value in enumerate(degrees)},
    }
    return {name: round(value, DIGITS) for name, value in measured.items()}  # the table is that of the file


def waits(found: Trace) -> np.ndarray:
    """Steps within 1 cm of the ball in which the goal was not reached, shape (steps, count)."""
    beside = (found.distance[1:] < REACHED_DISTANCE) & ~np.isnan(found.reward)
    return beside & (found.reward < REACHED_REWARD)


def table(rows: Sequence[Mapping[str, float]]) -> str:
    """A Markdown table with a row for each variant: medians over the seeds, and their range."""
    headings = ("reaching ends the episode", "standard deviation", "seeds", *(heading for heading, _, _ in _CELLS))
    lines = [head(*headings)]
    for ends, learned in ((1, 1), (0, 1), (1, 0), (0, 0)):
        group = [row for row in rows if (row["ends"], row["learned"]) == (ends, learned)]
        cells = ["yes" if ends else "no", "learned" if learned else "1° to 0.25°", str(len(group))]
        for _, column, digits in _CELLS:
            cells.append(spread([row[column] for row in group], digits))
        lines.append(line(*cells))
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    """Train, measure, print."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="folder of the runs, <variant>/seed-<k>/")
    parser.add_argument("--seeds", type=int, default=5, help="how many of each variant, default %(default)s")
    parser.add_argument("--train", choices=VARIANTS, metavar="VARIANT", help="only train this one, with --seed")
    parser.add_argument("--seed", type=int, default=0, help="default %(default)s")
    parser.add_argument("--csv", type=Path, help="write a row for each policy into this file")
    add_options(parser)
    arguments = parser.parse_args(argv)
    if arguments.train:
        trained(arguments.runs, arguments.train, arguments.seed)
        return 0
    parts = [(arguments.runs.resolve(), variant, seed) for variant in VARIANTS for seed in range(arguments.seeds)]
    rows = list(each(arguments, row, parts))
    if arguments.csv:
        write_text(arguments.csv, curve_csv([[row[name] for name in COLUMNS] for row in rows], COLUMNS))
    print(table(rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
