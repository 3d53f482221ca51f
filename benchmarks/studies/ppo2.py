"""Compare all readings of the PPO2 that the thesis had: the tables of docs/studies/appendix/ppo2.md.

python -m benchmarks.studies.ppo2 results/ppo2 --plan single multi        trains what is missing, prints the tables
python -m benchmarks.studies.ppo2 results/ppo2 --plan single --csv FILE   writes a row for each training as well
python -m benchmarks.studies.ppo2 results/ppo2 --plan multi-longest --figure FILE   draws how near they came

A file for each cell and seed: `results/ppo2/PLAN/CELL/seed-K.json`, and the policy beside it.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import torch

from benchmarks.studies.reward_parts import PARTS
from benchmarks.studies.side_by_side import Networks, Stack, Trained, train_stack
from benchmarks.studies.tables import head, line, spread
from kinreach._files import make_writable, replacing, write_text
from kinreach._registration import MULTI, SINGLE
from kinreach.baselines._batch import make_batch
from kinreach.baselines._evaluation import HELD_OUT, VALIDATION
from kinreach.baselines._learning_curve import curve_csv
from kinreach.baselines._loop import rollout_batch
from kinreach.baselines._policy_file import save_policy
from kinreach.baselines._rewards import own
from kinreach.cli import Parser, finish
from kinreach.plots._colours import PALETTE
from kinreach.plots._style import FAINT, key, label_ends, new_figure, plain
from kinreach.robots import get_arm
from kinreach.thesis import REACHED_DISTANCE

PROG = "python -m benchmarks.studies.ppo2"

#: Held-out goals of each policy, goals of the looks while it is trained, and decimals of what is measured.
GOALS, LOOK_GOALS, DIGITS = 1000, 100, 3
#: What an action of 1 is in the units in which the thesis gives actions: π radians, 5 degrees.
UNITS: Mapping[str, float] = {SINGLE: math.pi, MULTI: 5.0}


@dataclass(frozen=True)
class Cell:
    """One reading of the thesis's PPO2.

    Attributes:
        terminal: Whether the 100th step ends an episode, as `done` does in PPO2; else its value is added.
        raw: Whether actions are radians and degrees throughout; else only the first standard deviation is.
        value_clip: Whether the value function is clipped.
        openai: Whether the defaults are OpenAI Baselines', not Stable Baselines'.
        ends: Whether reaching ends the episode in training.
        reward: Which parts of the reward are paid.
        random: Share of the actions in training that are any in the range (epsilon-greedy, 6.2).
    """

    terminal: bool = True
    raw: bool = True
    value_clip: bool = True
    openai: bool = False
    ends: bool = True
    reward: str = "all"
    random: float = 0.0

    @property
    def name(self) -> str:
        """Name of the cell's folder: a word for each setting."""
        words = (
            "terminal" if self.terminal else "bootstrapped",
            "raw" if self.raw else "scaled",
            "clip" if self.value_clip else "free",
            "openai" if self.openai else "stable",
            *(() if self.ends else ("going-on",)),
            *((f"random-{self.random:g}",) if self.random else ()),
            *(() if self.reward == "all" else (self.reward.replace(" ", "-"),)),
        )
        return "-".join(words)

    def trained(self, environment: str, seed: int) -> Trained:
        """Its settings: 4.2 where the thesis says them, else the library's defaults."""
        unit = UNITS[environment]
        default = 3e-4 if self.openai else 2.5e-4
        return Trained(
            seed=seed,
            terminal=self.terminal,
            gain=1 / unit if self.raw else 1.0,
            std=1 / unit,
            value_clip=self.value_clip,
            rate=4 * default if environment == SINGLE else default,
            entropy=0.0 if self.openai else 0.01,
            reward=own if self.reward == "all" else PARTS[self.reward],
            random=self.random,
        )


#: The most faithful reading.
FAITHFUL = Cell()
_READINGS = [
    Cell(terminal, raw, value_clip, openai)
    for openai in (False, True)
    for terminal in (True, False)
    for raw in (True, False)
    for value_clip in (True, False)
]
#: Cells of single-step episodes, which end by themselves.
_SINGLE = [cell for cell in _READINGS if cell.terminal]
_ABLATED = [replace(FAITHFUL, reward=reward) for reward in PARTS if reward != "all"]
#: The step limit and the end on reaching, in the most faithful reading else.
_RULES = [replace(FAITHFUL, terminal=terminal, ends=ends) for ends in (True, False) for terminal in (True, False)]
_GREEDY = [replace(FAITHFUL, random=random) for random in (0.1, 0.3)]


@dataclass(frozen=True)
class Plan:
    """Trainings of one length.

    Attributes:
        stack: What they have in common; `shared` and `ends` follow from the cells.
        cells: What is trained.
        seeds: How many of each.
    """

    stack: Stack
    cells: Sequence[Cell]
    seeds: int


_THESIS_SINGLE = Stack(SINGLE, 150_000, 128, 1, 0.0, shared=False, windows=150, looks=5)
_THESIS_MULTI = Stack(MULTI, 150_000, 4, 1024, 0.99, shared=False, looks=4)
_LONG = Stack(MULTI, 5_000_000, 128, 32, 0.99, shared=False, windows=100)
PLANS: Mapping[str, Plan] = {
    "single": Plan(_THESIS_SINGLE, [*_SINGLE, *_ABLATED], 5),
    "multi": Plan(_THESIS_MULTI, [*_READINGS, *_ABLATED], 5),
    "single-random": Plan(_THESIS_SINGLE, _GREEDY, 5),
    "single-long": Plan(replace(_THESIS_SINGLE, steps=600_000), [*_SINGLE[:4], *_ABLATED], 5),
    "multi-updates": Plan(replace(_THESIS_MULTI, n_steps=3_200), _RULES[:2], 5),
    "multi-readings": Plan(replace(_LONG, steps=2_000_000), _READINGS, 1),
    "multi-long": Plan(_LONG, _RULES, 5),
    "multi-longest": Plan(replace(_LONG, steps=20_000_000), _RULES, 5),
}


class Together:
    """All policies of a stack on the same goals, for `rollout_batch`.

    Args:
        networks: Of the stack.
        explore: Whether actions are drawn as in training.
    """

    def __init__(self, networks: Networks, *, explore: bool) -> None:
        self._networks, self._explore = networks, explore

    def reset(self, observation: Any, info: Any) -> None:
        """Exploration is the same in every rollout."""
        torch.manual_seed(0)

    def act(self, observation: Any) -> np.ndarray:
        """Actions, shape (trainings goals, 6)."""
        return self._networks.act(observation, explore=self._explore)


@dataclass(frozen=True, eq=False)
class Played:
    """Episodes of the policies of a stack; arrays of shape (trainings, goals).

    Attributes:
        distance, above, sideways: Of the tip from the goal in the end [m]: in all, upwards, and in the plane.
        posture_error: In the end [rad].
        reached, impossible: Whether the goal was reached, and whether the last action was impossible.
        near: Whether the tip came within 10 mm.
        waited: Steps within 10 mm in which the goal was not reached.
        failed: Share of impossible steps.
    """

    distance: Any
    above: Any
    sideways: Any
    posture_error: Any
    reached: Any
    impossible: Any
    near: Any
    waited: Any
    failed: Any


def play(
    networks: Networks,
    count: int,
    environment: str,
    places: np.ndarray,
    *,
    explore: bool = False,
    views: np.ndarray | None = None,
    options: Mapping[str, Any] = MappingProxyType({}),
) -> Played:
    """One episode of each of `count` policies for each goal.

    Args:
        networks: Of the policies.
        count: How many they are.
        environment: Id.
        places: Goals in the world [m], shape (goals, 3).
        explore: Whether actions are drawn as in training.
        views: How the goals are seen [m], shape (goals, 6); by default as perfect cameras see them.
        options: Of the environment.
    """
    size = count * len(places)
    near, waited, failed, steps = (np.zeros(size) for _ in range(4))
    tips, errors = np.zeros((size, 3)), np.zeros(size)

    def watch(observations: Any, rewards: Any, info: Mapping[str, Any], pending: Any) -> None:
        beside = pending & (info["distance"] < REACHED_DISTANCE)
        near[beside] = 1.0
        waited[beside & ~info["reached"]] += 1.0
        failed[pending & info["impossible"]] += 1.0
        steps[pending] += 1.0
        tips[pending], errors[pending] = info["tip"][pending], info["posture_error"][pending]

    starts = {"goal": np.tile(places, (count, 1))} | ({} if views is None else {"view": np.tile(views, (count, 1))})
    with closing(make_batch(environment, size, {"backend": "kinematic", **options})) as env:
        trials = rollout_batch(env, Together(networks, explore=explore), seed=0, options=starts, watch=watch)
    off = tips - np.tile(places, (count, 1))
    verdicts = (np.array([trial[name] for trial in trials]) for name in ("reached", "impossible"))
    arrays = (
        np.linalg.norm(off, axis=1), off[:, 2], np.hypot(off[:, 0], off[:, 1]), errors, *verdicts, near, waited,
        failed / steps,
    )  # fmt: skip
    return Played(*(values.reshape(count, -1) for values in arrays))


def goals(seed: int, count: int) -> np.ndarray:
    """Goals of the table area in the world [m], shape (count, 3)."""
    return get_arm("ur5-thesis").workcell.draw_goals(np.random.default_rng(seed), count)


def measure(networks: Networks, count: int, environment: str) -> list[dict[str, float]]:
    """What each policy does on held-out goals, with exploration and without.

    Distances in mm, shares in percent, posture error in rad, standard deviations in the thesis's units.
    """
    held_out = goals(HELD_OUT, GOALS)
    found, sampled = (play(networks, count, environment, held_out, explore=explore) for explore in (False, True))
    units = UNITS[environment] * networks.weights["log_std"].detach().exp().numpy()[:, 0].astype(float)
    columns = {
        "distance": 1e3 * np.median(found.distance, axis=1),
        "above": 1e3 * np.median(found.above, axis=1),
        "sideways": 1e3 * np.median(found.sideways, axis=1),
        "posture_error": np.median(found.posture_error, axis=1),
        "reached": 100 * found.reached.mean(axis=1),
        "near": 100 * found.near.mean(axis=1),
        "waited": found.waited.mean(axis=1),
        "impossible": 100 * found.impossible.mean(axis=1),
        "sampled_reached": 100 * sampled.reached.mean(axis=1),
        "sampled_distance": 1e3 * np.median(sampled.distance, axis=1),
        "sampled_impossible": 100 * sampled.failed.mean(axis=1),
        "std": units.mean(axis=1),
        **{f"std_j{joint}": units[:, joint] for joint in range(units.shape[1])},
    }
    return [{name: round(float(values[i]), DIGITS) for name, values in columns.items()} for i in range(count)]


def train_missing(runs: Path, name: str, seeds: Sequence[int], only: str | None = None) -> None:
    """Train what a plan lacks, cells of one architecture and one rule side by side."""
    plan = PLANS[name]
    for openai, ends in sorted(
        {(cell.openai, cell.ends) for cell in plan.cells}, key=lambda kind: (kind[0], not kind[1])
    ):
        jobs = [
            (cell, seed)
            for seed in seeds
            for cell in plan.cells
            if (cell.openai, cell.ends) == (openai, ends) and (only is None or only == cell.name)
            if not (runs / name / cell.name / f"seed-{seed}.json").exists()
        ]
        if jobs:
            _train(runs / name, replace(plan.stack, shared=openai, ends=ends), jobs)


def _train(folder: Path, stack: Stack, jobs: Sequence[tuple[Cell, int]]) -> None:
    environment = stack.environment
    start = time.process_time()
    looks: list[tuple[int, list[float]]] = []
    validation = goals(VALIDATION, LOOK_GOALS)

    def look(steps: int, networks: Networks) -> None:
        distances = play(networks, len(jobs), environment, validation).distance
        looks.append((steps, np.round(1e3 * np.median(distances, axis=1), 2).tolist()))
        print(f"{folder.name}: {steps} steps, {time.process_time() - start:.0f} s, {looks[-1][1]}", flush=True)

    networks, curves = train_stack(stack, [cell.trained(environment, seed) for cell, seed in jobs], look=look)
    seconds = time.process_time() - start
    measured = measure(networks, len(jobs), environment)
    for index, (cell, seed) in enumerate(jobs):
        policy = networks.policy(index, stack)
        written = {
            "cell": cell.__dict__,
            "seed": seed,
            "stack": stack.__dict__,
            "stacked": len(jobs),
            "seconds": round(seconds / len(jobs), 1),
            "curve": curves.columns(index),
            "looks": [[steps, found[index]] for steps, found in looks],
            "measured": measured[index],
        }
        make_writable(folder / cell.name)
        save_policy(folder / cell.name / f"seed-{seed}.safetensors", policy.card, policy.network)
        write_text(folder / cell.name / f"seed-{seed}.json", json.dumps(written) + "\n")


def rows(runs: Path, name: str) -> list[dict[str, float]]:
    """What the trainings of a plan came to, in the order of its cells and seeds."""
    return [
        _row(cell, json.loads(file.read_text(encoding="utf-8")))
        for cell in PLANS[name].cells
        for file in sorted((runs / name / cell.name).glob("seed-*.json"))
    ]


def _row(cell: Cell, run: Mapping[str, Any]) -> dict[str, float]:
    curve = {name: np.array(values, float) for name, values in run["curve"].items()}
    steps = curve["steps"]
    reward = np.where(curve["impossible"] < 1, curve["reward"], np.nan)
    below, last = steps[~(reward > 0)], steps > 0.9 * steps[-1]
    third = np.abs(steps - steps[-1] / 3) <= max(steps[-1] / 50, steps[0])
    parts = {"natural_arm": cell.reward in ("all", "natural arm"), "gripper": cell.reward in ("all", "gripper angle")}
    flags = {name: getattr(cell, name) for name in FLAGS}
    return {
        **{name: float(value) for name, value in (flags | parts).items()},
        "random": cell.random,
        "seed": run["seed"],
        "steps": steps[-1],
        "above": 0.0 if not len(below) else math.nan if below[-1] == steps[-1] else below[-1],
        "reward": _mean(reward[third]),
        "reward_last": _mean(reward[last]),
        "impossible_last": round(100 * float(curve["impossible"][last].mean()), DIGITS),
        "reached_training": float(curve["reached"].sum()),
        **_looks(run["looks"]),
        **{"tip_above" if name == "above" else name: value for name, value in run["measured"].items()},
    }


def _looks(looks: Sequence[tuple[int, float]]) -> dict[str, float]:
    """Distance [mm] at half of a training and at its end, on the goals of the looks; between two looks, linear."""
    at, distances = np.array(looks, float).T
    return {
        "distance_half": round(float(np.interp(at[-1] / 2, at, distances)), DIGITS),
        "distance_end": float(distances[-1]),
    }


def _mean(values: np.ndarray) -> float:
    """Of what is a number; NaN if nothing is."""
    numbers = values[~np.isnan(values)]
    return round(float(numbers.mean()), DIGITS) if len(numbers) else math.nan


#: What tells cells apart, and what a table says of them: headings, columns, digits.
FLAGS = ("terminal", "raw", "value_clip", "openai", "ends")
READING = (*FLAGS, "natural_arm", "gripper")
#: What is reached in training are goals; where reaching goes on, each step there.
GOALS_REACHED, STEPS_THERE = "goals reached in training", "steps that reach in training"
_TRAINING = (
    ("reward above 0 for good from", "above", 0),
    ("reward after a third", "reward", 1),
    ("in the last tenth", "reward_last", 1),
    ("impossible there, %", "impossible_last", 0),
    (GOALS_REACHED, "reached_training", 0),
)
_AFTER = (
    ("distance at half, mm", "distance_half", 0),
    ("at the end, mm", "distance_end", 0),
    ("held out: distance, mm", "distance", 0),
    ("r_e", "posture_error", 2),
    ("impossible, %", "impossible", 0),
    ("came within 10 mm, %", "near", 1),
    ("reached, %", "reached", 1),
)
_MULTI = (("steps waited there", "waited", 1), ("reached with exploration, %", "sampled_reached", 1))
CELLS: Mapping[str, Sequence[tuple[str, str, int]]] = {
    SINGLE: (*_TRAINING, *_AFTER),
    MULTI: (*_TRAINING[1:], *_AFTER, *_MULTI),
}
#: Of the learned standard deviations, in the thesis's units: by the task, unit and digits.
_UNIT: Mapping[str, tuple[str, int]] = {SINGLE: ("rad", 2), MULTI: ("°", 1)}
#: What a table says seed by seed.
SEED_BY_SEED: Mapping[str, Sequence[tuple[str, str, int]]] = {
    SINGLE: (
        ("reward in the last tenth", "reward_last", 1),
        ("impossible there, %", "impossible_last", 0),
        ("held out: distance, mm", "distance", 0),
        ("impossible, %", "impossible", 0),
    ),
    MULTI: (_TRAINING[4], *_AFTER[:3], _AFTER[-1]),
}
#: Readings whose trainings are taken together: by what they have in common.
POOLED = (("terminal",), ("value_clip",), ("openai", "raw"))
_WORDS: Mapping[str, tuple[str, str, str]] = {
    "terminal": ("100th step", "an end", "cut off"),
    "raw": ("units", "thesis's", "scaled"),
    "value_clip": ("values clipped", "yes", "no"),
    "openai": ("defaults", "OpenAI", "Stable"),
    "ends": ("reaching", "an end", "goes on"),
}


def table(found: Sequence[Mapping[str, float]], environment: str) -> str:
    """A Markdown table with a row for each cell: medians over the seeds, and their range; `-` where it never was."""
    columns = CELLS[environment]
    return _by_cell(
        found,
        [heading for heading, _, _ in columns],
        lambda group: [spread([row[column] for row in group], digits) for _, column, digits in columns],
    )


def deviations(found: Sequence[Mapping[str, float]], environment: str) -> str:
    """A Markdown table of the standard deviations in the end, joint by joint: medians over the seeds, and range."""
    unit, digits = _UNIT[environment]
    columns = [name for name in found[0] if name.startswith("std_j")]
    return _by_cell(
        found,
        [f"{'standard deviation in the end, ' if not joint else ''}j{joint}, {unit}" for joint in range(len(columns))],
        lambda group: [spread([row[column] for row in group], digits) for column in columns],
    )


def seed_by_seed(found: Sequence[Mapping[str, float]], environment: str) -> str:
    """A Markdown table with the value of each seed, in their order, in a cell."""
    columns = SEED_BY_SEED[environment]

    def values(group: Sequence[Mapping[str, float]]) -> list[str]:
        each = ([row[column] for row in group] for _, column, _ in columns)
        return [
            " / ".join("-" if math.isnan(value) else f"{value:.{digits}f}" for value in one)
            for one, (_, _, digits) in zip(each, columns, strict=True)
        ]

    return _by_cell(found, [heading for heading, _, _ in columns], values)


def pooled(found: Sequence[Mapping[str, float]]) -> str:
    """A Markdown table of distances, of all trainings together that share a reading and are paid for all parts.

    Empty where nothing tells them apart.
    """
    whole = [row for row in found if row["natural_arm"] and row["gripper"]]
    lines = [head("readings", "trainings", "held out: distance, mm")]
    for flags in POOLED:
        kinds = dict.fromkeys(tuple(row[flag] for flag in flags) for row in whole)
        for kind in kinds if len(kinds) > 1 else ():
            group = [row["distance"] for row in whole if tuple(row[flag] for flag in flags) == kind]
            words = (f"{_WORDS[flag][0]}: {_word(flag, value)}" for flag, value in zip(flags, kind, strict=True))
            lines.append(line(", ".join(words), len(group), spread(group, 0)))
    return "\n".join(lines) if len(lines) > 1 else ""


def _word(flag: str, value: float) -> str:
    return _WORDS[flag][1 if value else 2]


def _by_cell(
    found: Sequence[Mapping[str, float]],
    headings: Sequence[str],
    values: Callable[[Sequence[Mapping[str, float]]], Sequence[str]],
) -> str:
    """A row for each reading: its settings, the number of seeds, and their results."""
    if not all(row["ends"] for row in found):
        headings = [STEPS_THERE if heading == GOALS_REACHED else heading for heading in headings]
    shown = [name for name in FLAGS if len({row[name] for row in found}) > 1]
    ablated = any(row["natural_arm"] < 1 or row["gripper"] < 1 for row in found)
    random = any(row.get("random") for row in found)
    first = [_WORDS[name][0] for name in shown] + ["any action, %"] * random + ["reward"] * ablated + ["seeds"]
    lines = [head(*first, *headings)]
    readings = [tuple(row.get(name, 0.0) for name in (*READING, "random")) for row in found]
    for reading in dict.fromkeys(readings):
        group = [row for row, other in zip(found, readings, strict=True) if other == reading]
        cells = [_word(name, group[0][name]) for name in shown]
        cells += [f"{100 * group[0]['random']:g}"] if random else []
        cells += [_paid(group[0])] * ablated + [str(len(group))]
        lines.append(line(*cells, *values(group)))
    return "\n".join(lines)


def _paid(row: Mapping[str, float]) -> str:
    parts = [word for name, word in (("natural_arm", "natural arm"), ("gripper", "gripper")) if row[name]]
    return " + ".join(["distance", *parts])


def draw(runs: Path, name: str, file: Path) -> None:
    """Distance from validation goals against steps, a line a cell: medians over the seeds, and their range."""
    cells = PLANS[name].cells
    differ = [flag for flag in FLAGS if len({getattr(cell, flag) for cell in cells}) > 1]
    note = f"{PROG} RUNS --plan {name}; medians over the seeds, and their range"
    figure, (axes,) = new_figure("How near the goal, against training", size=(9.6, 4.2), note=note)
    ends, colours = {}, {}
    for cell, colour in zip(cells, PALETTE, strict=False):
        files = sorted((runs / name / cell.name).glob("seed-*.json"))
        if not files:
            continue
        looks = np.array([json.loads(file.read_text(encoding="utf-8"))["looks"] for file in files])
        steps, distances = looks[0, :, 0] / 1e6, looks[..., 1]
        words = ", ".join(f"{_WORDS[flag][0]}: {_word(flag, getattr(cell, flag))}" for flag in differ)
        axes.fill_between(steps, distances.min(axis=0), distances.max(axis=0), color=colour, alpha=0.15, linewidth=0)
        middle = np.median(distances, axis=0)
        axes.plot(steps, middle, color=colour, marker="o", ms=4, lw=1.6)
        ends[words or cell.name], colours[words or cell.name] = (steps[-1], middle[-1]), colour
    axes.axhline(1e3 * REACHED_DISTANCE, color=FAINT, lw=1.2, ls="--")
    axes.set(yscale="log", xlabel="million steps")
    axes.set_xlim(right=max((float(x) for x, _ in ends.values()), default=None))
    axes.yaxis.set_major_formatter(plain)
    key(axes, "median distance of 100 goals [mm]; dashed: near enough to reach")
    label_ends(axes, ends, colours)
    with replacing(file) as temporary:
        figure.savefig(temporary, format="png")


def main(argv: list[str] | None = None) -> int:
    """Train the cells that are asked for, measure them and print a table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="folder of the results")
    parser.add_argument("--plan", nargs="+", choices=PLANS, required=True, help="which trainings")
    parser.add_argument("--cell", help="only this one")
    parser.add_argument("--seeds", type=int, nargs="+", help="only these")
    parser.add_argument("--no-train", action="store_true", help="only say what there is")
    parser.add_argument("--csv", type=Path, help="write a row for each training of the last plan into this file")
    parser.add_argument(
        "--figure", type=Path, metavar="FILE", help="PNG file: how near the trainings of the last plan came"
    )
    arguments = parser.parse_args(argv)
    torch.set_num_threads(1)
    for name in arguments.plan:
        if not arguments.no_train:
            train_missing(arguments.runs, name, arguments.seeds or range(PLANS[name].seeds), arguments.cell)
        found = rows(arguments.runs, name)
        if arguments.csv and found:
            columns = tuple(found[0])
            values = [[None if row[column] != row[column] else row[column] for column in columns] for row in found]
            write_text(arguments.csv, curve_csv(values, columns))
        if found:
            environment = PLANS[name].stack.environment
            tables = (make(found, environment) for make in (table, deviations, seed_by_seed))
            print(*filter(None, (*tables, pooled(found))), sep="\n\n")
            if arguments.figure is not None:
                draw(arguments.runs, name, arguments.figure)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
