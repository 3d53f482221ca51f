"""What it costs the thesis's trainings that its pipeline sees the ball, joints end inexactly, and the arm has masses.

    python -m benchmarks.studies.thesis_world results/world [--task single] [--csv FILE]

PPO2 in the most faithful reading, in four worlds: goals told exactly; goals with the errors of the thesis's pipeline
(3.4.2, 6.1); joints that end up to 0.01 rad from where they were sent (6.3); MuJoCo's dynamics. Every policy is tried
in each of them, on held-out goals of the table, all of which both cameras rendered for it; under dynamics on the first
200. A file for each world and task keeps what was measured: `results/world/single-told.json`.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.studies.ppo2 import FAITHFUL, GOALS, PLANS, goals, play
from benchmarks.studies.side_by_side import Networks, train_stack
from benchmarks.studies.tables import head, line, spread
from kinreach._files import make_writable, write_text
from kinreach._registration import MULTI, SINGLE
from kinreach.baselines._evaluation import HELD_OUT
from kinreach.baselines._learning_curve import curve_csv
from kinreach.cli import Parser, finish
from kinreach.envs._reach.observers import CameraObserver
from kinreach.envs._reach.reach_task import ReachOptions
from kinreach.robots import get_arm

PROG = "python -m benchmarks.studies.thesis_world"

#: The thesis's cameras and its tolerance, as options of the environment.
SEEN = {"observation": "camera", "pipeline": "thesis"}
LOOSE = {"tolerance": 0.01}
DYNAMICS = {"backend": "mujoco"}
#: Worlds by what a table calls them: options of a training.
WORLDS: Mapping[str, Mapping[str, Any]] = {
    "told": {},
    "seen": {**SEEN, "looks": 1000},
    "inexact joints": LOOSE,
    "dynamics": DYNAMICS,
}
#: Held-out goals that are tried under dynamics.
MOVED = 200
TASKS = {"single": SINGLE, "multi": MULTI}
SEEDS, DIGITS = 5, 3
#: Columns of the file: numbers of the task and of the world of the training in `TASKS` and `WORLDS`, seed; goals
#: reached while it was trained; of each world that it was tried in, distance [mm], reached [%].
COLUMNS = (
    "multi", "world", "seed", "reached_training",
    *(f"{name}_{world}" for world in range(len(WORLDS)) for name in ("distance", "reached")),
)  # fmt: skip


def looked_at(places: np.ndarray) -> np.ndarray:
    """How the thesis's pipeline sees goals in the world [m], shape (k, 3): rendered, shape (k, 6)."""
    observer = CameraObserver(get_arm("ur5-thesis"), ReachOptions(backend="kinematic", **SEEN))
    views = observer.measure(places, np.zeros(len(places), dtype=np.intp), [np.random.default_rng(0)]).views
    observer.close()
    return views


def measure(networks: Networks, environment: str, views: np.ndarray) -> list[dict[str, float]]:
    """What each of the policies does in each of the worlds, by `COLUMNS`."""
    places = goals(HELD_OUT, len(views))
    found = (
        play(networks, SEEDS, environment, places),
        play(networks, SEEDS, environment, places, views=views),
        play(networks, SEEDS, environment, places, options=LOOSE),
        play(networks, SEEDS, environment, places[:MOVED], options=DYNAMICS),
    )
    return [
        {
            f"{name}_{world}": round(float(value), DIGITS)
            for world, played in enumerate(found)
            for name, value in (
                ("distance", 1e3 * np.median(played.distance[index])),
                ("reached", 100 * played.reached[index].mean()),
            )
        }
        for index in range(SEEDS)
    ]


def trained(folder: Path, task: str, world: str, views: np.ndarray) -> list[dict[str, float]]:
    """The rows of the trainings of a task in a world; they are trained if there is no file of them."""
    file = folder / f"{task}-{world.replace(' ', '-')}.json"
    if not file.exists():
        start, environment = time.process_time(), TASKS[task]
        stack = replace(PLANS[task].stack, options=WORLDS[world])
        networks, curves = train_stack(stack, [FAITHFUL.trained(environment, seed) for seed in range(SEEDS)])
        rows = [
            {
                "multi": list(TASKS).index(task),
                "world": list(WORLDS).index(world),
                "seed": seed,
                "reached_training": sum(curves.columns(seed)["reached"]),
                **row,
            }
            for seed, row in enumerate(measure(networks, environment, views))
        ]
        make_writable(folder)
        write_text(file, json.dumps(rows) + "\n")
        print(f"{file}: {time.process_time() - start:.0f} s of processor time", flush=True)
    found: list[dict[str, float]] = json.loads(file.read_text(encoding="utf-8"))
    return found


def table(rows: Sequence[Mapping[str, float]]) -> str:
    """A Markdown table with a row for each task and world: medians over the seeds, and their range."""
    headings = ["task", "trained with", "seeds", "goals reached in training"]
    headings += [f"{world}: {what}" for world in WORLDS for what in ("distance, mm", "reached, %")]
    lines = [head(*headings)]
    for multi, world in dict.fromkeys((row["multi"], row["world"]) for row in rows):
        group = [row for row in rows if (row["multi"], row["world"]) == (multi, world)]
        cells = [list(TASKS)[int(multi)], list(WORLDS)[int(world)], str(len(group))]
        for column in COLUMNS[3:]:
            digits = 1 if column.startswith("reached_") and column != "reached_training" else 0
            cells.append(spread([row[column] for row in group], digits))
        lines.append(line(*cells))
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    """Train what is missing, print the table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="folder of the results")
    parser.add_argument("--task", choices=TASKS, nargs="+", default=list(TASKS), help="which (default: both)")
    parser.add_argument("--csv", type=Path, help="write a row for each training into this file")
    arguments = parser.parse_args(argv)
    torch.set_num_threads(1)
    views = looked_at(goals(HELD_OUT, GOALS))
    rows = [row for task in arguments.task for world in WORLDS for row in trained(arguments.runs, task, world, views)]
    if arguments.csv:
        write_text(arguments.csv, curve_csv([[row[name] for name in COLUMNS] for row in rows], COLUMNS))
    print(table(rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
