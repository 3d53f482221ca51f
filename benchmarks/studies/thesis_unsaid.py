"""What the thesis does not give, varied one at a time: goal area, height of the ball, start, inputs, one arm.

    python -m benchmarks.studies.thesis_unsaid                  # a quarter of an hour of one core
    python -m benchmarks.studies.thesis_unsaid --task single --worlds "goals as pixels and depths"

PPO2 in the most faithful reading, the thesis's number of actions, five seeds. Policies are tried without exploration on
1000 held-out goals of the world that they were trained in. A file of each row is kept in `--out`.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.studies.parts import kept
from benchmarks.studies.ppo2 import FAITHFUL, GOALS, PLANS, play
from benchmarks.studies.side_by_side import Stack, train_stack
from benchmarks.studies.tables import head, line, spread
from benchmarks.studies.thesis_world import SEEDS, TASKS
from kinreach._checks import check_count
from kinreach._files import make_writable
from kinreach.baselines._batch import first_observations
from kinreach.baselines._evaluation import HELD_OUT
from kinreach.cli import Parser, finish
from kinreach.robots import ArmDescription, get_arm
from kinreach.vision import Intrinsics

PROG = "python -m benchmarks.studies.thesis_unsaid"

#: The thesis's pictures (3.4.2).
WIDTH, HEIGHT = 1280, 720
#: A start with the tool down that holds the gripper nearer to the base.
OTHER_START = (-math.pi / 2, -2.1, 2.0, -math.pi / 2 + 0.1, -math.pi / 2, 0.0)
#: Of the middle of the goal area [m].
MIDDLE = (0.475, 0.0)


@dataclass(frozen=True)
class World:
    """One thing that the thesis does not give.

    Attributes:
        arm: The arm in its work cell; None for the package's.
        options: Of the environment.
        inputs: From the stack to what the networks subtract from observations, and divide them by.
        stack: What else is changed in the stack.
        tasks: That it is tried in.
    """

    arm: Callable[[], ArmDescription] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    inputs: Callable[[Stack], tuple[tuple[float, ...], tuple[float, ...]]] | None = None
    stack: Mapping[str, Any] = field(default_factory=dict)
    tasks: Sequence[str] = tuple(TASKS)


def area(side: float) -> ArmDescription:
    """The arm with goals in a square of this side [m] in the middle of the table area."""
    (x, y), half = MIDDLE, side / 2
    return _with_goals(f"ur5_{100 * side:g}_cm", x=(x - half, x + half), y=(y - half, y + half))


def higher(by: float) -> ArmDescription:
    """The arm with the ball higher [m]."""
    (z, _) = get_arm("ur5-thesis").workcell.goals.z  # type: ignore[union-attr]
    return _with_goals(f"ur5_{100 * by:g}_cm_up", z=(z + by, z + by))


def _with_goals(name: str, **ranges: tuple[float, float]) -> ArmDescription:
    arm = get_arm("ur5-thesis")
    region: Any = arm.workcell.goals
    return replace(arm, name=name, workcell=replace(arm.workcell, goals=replace(region, **ranges)))


def pixels(stack: Stack) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """What makes columns and rows in focal lengths into pixels of the thesis's pictures."""
    shift, scale = np.zeros(13), np.ones(13)
    for block, camera in enumerate(get_arm("ur5-thesis").goal_cameras):
        lens = Intrinsics.from_fovy(camera.fovy, WIDTH, HEIGHT)
        shift[3 * block : 3 * block + 2] = -lens.cx / lens.fx, -lens.cy / lens.fy
        scale[3 * block : 3 * block + 2] = 1.0 / lens.fx, 1.0 / lens.fy
    return tuple(shift.tolist()), tuple(scale.tolist())


def normalised(stack: Stack) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Mean and spread of first observations; what does not vary among them is only shifted."""
    seen = first_observations(stack.environment, {"backend": "kinematic", **stack.options}, seed=0)
    scale = seen.std(axis=0)
    return tuple(seen.mean(axis=0).tolist()), tuple(np.where(scale < 1e-6, 1.0, scale).tolist())


WORLDS: Mapping[str, World] = {
    "as in the other tables": World(),
    "goals in a square of 10 cm": World(arm=lambda: area(0.1)),
    "goals in a square of 2 cm": World(arm=lambda: area(0.02)),
    "ball 10 cm higher": World(arm=lambda: higher(0.1)),
    "another start": World(arm=lambda: replace(get_arm("ur5-thesis"), name="ur5_other_start", home=OTHER_START)),
    "goals as pixels and depths": World(options={"goal_in": "image"}, inputs=pixels),
    "inputs normalised": World(inputs=normalised),
    "one arm, 4096 steps": World(stack={"arms": 1, "n_steps": 4096}, tasks=("multi",)),
}


def measured(task: str, name: str, steps: int | None) -> list[dict[str, float]]:
    """Train and try; a row for each seed: goals reached in training, held-out distance [mm] and goals reached [%]."""
    world, environment = WORLDS[name], TASKS[task]
    arm = get_arm("ur5-thesis") if world.arm is None else world.arm()
    stack = replace(PLANS[task].stack, options={**world.options, "arm": arm}, **world.stack)
    stack = replace(stack, steps=steps or stack.steps)
    if world.inputs is not None:
        stack = replace(stack, inputs=world.inputs(stack))
    networks, curves = train_stack(stack, [FAITHFUL.trained(environment, seed) for seed in range(SEEDS)])
    places = arm.workcell.draw_goals(np.random.default_rng(HELD_OUT), GOALS)
    found = play(networks, SEEDS, environment, places, options=stack.options)
    return [
        {
            "reached_training": sum(curves.columns(seed)["reached"]),
            "distance": 1e3 * float(np.median(found.distance[seed])),
            "reached": 100 * float(found.reached[seed].mean()),
        }
        for seed in range(SEEDS)
    ]


def main(argv: list[str] | None = None) -> int:
    """Train what is missing, print a Markdown table: medians over the seeds, and their range."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", choices=TASKS, nargs="+", default=list(TASKS), help="which (default: both)")
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=list(WORLDS), help="which (default: all)")
    parser.add_argument("--steps", type=int, help="actions of a training (default: 150 000)")
    parser.add_argument("--out", type=Path, default=Path("results/unsaid"), help="where finished rows are kept")
    arguments = parser.parse_args(argv)
    steps = None if arguments.steps is None else check_count("--steps", arguments.steps)
    make_writable(arguments.out)
    torch.set_num_threads(1)
    print(head("task", "changed", "seeds", "goals reached in training", "held out: distance, mm", "reached, %"))
    for task in arguments.task:
        for name in arguments.worlds:
            if task not in WORLDS[name].tasks:
                continue
            key = {"task": task, "world": name, "steps": steps, "seeds": SEEDS}
            rows = kept(arguments.out, key, lambda task=task, name=name: measured(task, name, steps))
            columns = (("reached_training", 0), ("distance", 0), ("reached", 1))
            print(
                line(task, name, len(rows), *(spread([row[of] for row in rows], digits) for of, digits in columns)),
                flush=True,
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
