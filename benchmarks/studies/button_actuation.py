"""Why the button task has two sets of actuation parameters: both under random actions and under the controller.

    python -m benchmarks.studies.button_actuation [--targets 1000] [--seed 1000000]

Random actions run for the same simulated time on both, so that steps of 4 ms and of 40 ms compare.
"""

from __future__ import annotations

import argparse
from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np

import kinreach
from benchmarks.studies.parts import each
from benchmarks.studies.tables import head, line
from kinreach._jobs import add_options
from kinreach._registration import BUTTON
from kinreach.baselines._batch import last_step
from kinreach.baselines._button_controller import ButtonController
from kinreach.cli import Parser, finish
from kinreach.envs._button.button_task import ACTUATIONS, PRESS_RADIUS, Actuation

PROG = "python -m benchmarks.studies.button_actuation"

#: Simulated time of an episode of random actions [s].
RANDOM_TIME = 4.0
FIRST_UP = 22  # one more unit of control on the first joint, nothing else
SPEEDS, DIFFERENCE = slice(12, 15), slice(15, 18)


def batch(actuation: Actuation, count: int) -> Any:
    """That many environments in step."""
    return gym.make_vec(
        BUTTON, num_envs=count, vectorization_mode="vector_entry_point", actuation=actuation.name, dtype="float64"
    )


def one_increment(actuation: Actuation) -> float:
    """Speed of the first joint after one action from rest in the upright posture [rad/s]."""
    with closing(gym.make(BUTTON, actuation=actuation.name, dtype="float64")) as env:
        env.reset(seed=0, options={"q": np.zeros(3)})
        return float(env.step(FIRST_UP)[0][SPEEDS][0])


def random_actions(actuation: Actuation, count: int, seed: int) -> dict[str, Any]:
    """What uniformly random actions lead to, one episode per environment."""
    rng = np.random.default_rng(seed)
    fastest = np.zeros((count, 3))
    near, pressed, over = (np.zeros(count, dtype=bool) for _ in range(3))
    diverged = 0
    with closing(batch(actuation, count)) as env:
        env.reset(seed=seed)
        for _ in range(round(RANDOM_TIME / actuation.period)):
            seen, _, terminated, truncated, info = env.step(rng.integers(0, 54, count))
            seen = np.where((terminated | truncated)[:, None], info.get("final_obs", seen), seen)
            going = ~over  # episodes that have not ended before
            fastest[going] = np.maximum(fastest, np.abs(seen[:, SPEEDS]))[going]
            near |= going & (np.linalg.norm(seen[:, DIFFERENCE], axis=1) < PRESS_RADIUS)
            pressed |= going & terminated
            diverged += int((going & last_step(info)["impossible"]).sum())
            over |= terminated | truncated
    return {"fastest": fastest, "near": near.mean(), "pressed": pressed.mean(), "diverged": diverged}


def analytic(actuation: Actuation, count: int, seed: int) -> dict[str, Any]:
    """How the controller does on that many targets, one episode each."""
    controller = ButtonController(actuation.name, count=count)
    steps, wrong, over, pressed = np.zeros(count), np.zeros(count), np.zeros(count, bool), np.zeros(count, bool)
    with closing(batch(actuation, count)) as env:
        seen, _ = env.reset(seed=seed)
        while not over.all():
            seen, _, terminated, truncated, info = env.step(controller.actions(seen))
            ended = terminated | truncated
            controller.restart(ended)
            first = ended & ~over
            told = last_step(info)
            steps[first], wrong[first] = told["steps"][first], told["wrong_presses"][first]
            pressed |= first & terminated
            over |= ended
    return {"pressed": pressed.mean(), "steps": steps[pressed], "wrong": wrong.sum()}


def column(actuation: Actuation, targets: int, seed: int) -> dict[str, str]:
    """The numbers of one set, by what they are."""
    chance, model = random_actions(actuation, targets, seed), analytic(actuation, targets, seed)
    fastest, steps = chance["fastest"], model["steps"]
    median, worst = np.median(steps), steps.max()
    return {
        "gears [N m]": ", ".join(f"{gear:g}" for gear in actuation.gears),
        "time of a step": f"{1000 * actuation.period:g} ms",
        "joint 1 after one action from rest": f"{one_increment(actuation):.2g} rad/s",
        f"random, {RANDOM_TIME:g} s: fastest of joint 1 / 2 / 3, median": speeds(np.median(fastest, axis=0)),
        f"random, {RANDOM_TIME:g} s: fastest of joint 1 / 2 / 3, worst": speeds(fastest.max(axis=0)),
        f"random, {RANDOM_TIME:g} s: ever within 50 mm": f"{100 * chance['near']:.1f} %",
        f"random, {RANDOM_TIME:g} s: pressed": f"{100 * chance['pressed']:.1f} %",
        "random: simulations that diverged": str(chance["diverged"]),
        "analytic: pressed": f"{100 * model['pressed']:.1f} %",
        "analytic: steps, median / worst": f"{median:g} / {worst:g}",
        "analytic: time, median / worst": f"{median * actuation.period:.2f} / {worst * actuation.period:.2f} s",
        "analytic: wrong presses": f"{model['wrong']:g}",
    }


def speeds(values: np.ndarray) -> str:
    """Write three speeds, "A / B / C rad/s"."""
    return " / ".join(f"{value:.0f}" for value in values) + " rad/s"


def main(argv: list[str] | None = None) -> int:
    """Measure and print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--targets", type=int, default=1000, help="environments, each with a target of its own")
    parser.add_argument("--seed", type=int, default=1_000_000, help="of the first target; the others count up")
    add_options(parser)
    args = parser.parse_args(argv)
    parts = [(actuation, args.targets, args.seed) for actuation in ACTUATIONS.values()]
    columns = dict(zip(ACTUATIONS, each(args, column, parts), strict=True))
    print(f"kinreach {kinreach.__version__}, {args.targets} targets, seed {args.seed}\n")
    print(head("", *columns))
    for name in next(iter(columns.values())):
        print(line(name, *(values[name] for values in columns.values())))
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
