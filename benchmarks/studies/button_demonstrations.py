"""How well the controller's answers follow from what a policy observes, with the course report's gears.

    python -m benchmarks.studies.button_demonstrations

The analytic controller plays episodes. Networks predict its action in each step from the report's 19 observations, from
those of the last four steps, and from the 19 and the controls. The table is of episodes that no network was fitted to.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from contextlib import closing
from typing import Any

import numpy as np
import torch

import kinreach  # noqa: F401  registers the environments
from benchmarks.studies.tables import head, line
from kinreach._checks import Floats, check_count
from kinreach._registration import BUTTON
from kinreach.baselines._batch import make_batch
from kinreach.baselines._button_controller import ButtonController
from kinreach.cli import Parser, finish
from kinreach.envs._button.button_task import OBSERVATIONS, meaning

PROG = "python -m benchmarks.studies.button_demonstrations"
HEADINGS = ("observed", "action right, %", "control 1 right where it changes, %", "control 2, %", "control 3, %")
#: Steps of an episode at most, and observations side by side.
STEPS, FRAMES = 500, 4
#: Of the networks.
HIDDEN, PASSES, ROWS, RATE = 256, 20, 1024, 2e-3

Array = np.ndarray[Any, Any]


def demonstrations(count: int, seed: int) -> tuple[Floats, Array]:
    """Let the controller play episodes until it presses.

    Returns:
        Observations of four steps with controls, shape (n, 4 * 22), and actions, shape (n,).
    """
    options = {"actuation": "report", "max_episode_steps": STEPS, "controls": True, "frames": FRAMES}
    seen, actions = [], []
    playing, controller = np.ones(count, dtype=np.bool_), ButtonController("report", count=count)
    with closing(make_batch(BUTTON, count, options)) as env:
        observations, _ = env.reset(seed=seed)
        for _ in range(STEPS):
            answers = controller.actions(observations[:, : observations.shape[1] // FRAMES])
            seen.append(observations[playing])
            actions.append(answers[playing])
            observations, _, terminated, truncated, _ = env.step(answers)
            controller.restart(np.flatnonzero(terminated | truncated))
            playing &= ~(terminated | truncated)
    return np.concatenate(seen), np.concatenate(actions)


def inputs(observations: Floats) -> Mapping[str, Floats]:
    """Return what each network sees."""
    frames = observations.reshape(len(observations), FRAMES, -1)
    return {
        "19 numbers": frames[:, 0, :OBSERVATIONS],
        f"19 numbers, the last {FRAMES} steps": frames[:, :, :OBSERVATIONS].reshape(len(frames), -1),
        "19 numbers and 3 controls": frames[:, 0],
    }


def parts(actions: Array) -> Array:
    """Return the action and what it adds to the three controls, shape (n, 4)."""
    return np.column_stack([actions, meaning(actions)[0]])


def predicted(x: Floats, y: Array, other: Floats, seed: int) -> Array:
    """Return the actions that a network, fitted to actions y at x, gives at others."""
    torch.manual_seed(seed)
    middle, scale = x.mean(axis=0), x.std(axis=0) + 1e-9
    rows, others = (torch.as_tensor((values - middle) / scale, dtype=torch.float32) for values in (x, other))
    wanted, actions = torch.as_tensor(y), int(y.max()) + 1
    network = torch.nn.Sequential(
        torch.nn.Linear(x.shape[1], HIDDEN), torch.nn.SiLU(), torch.nn.Linear(HIDDEN, HIDDEN), torch.nn.SiLU(),
        torch.nn.Linear(HIDDEN, actions),
    )  # fmt: skip
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE)
    decay = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.02, PASSES)
    for _ in range(PASSES):
        for some in torch.randperm(len(rows)).split(ROWS):
            optimizer.zero_grad()
            torch.nn.functional.cross_entropy(network(rows[some]), wanted[some]).backward()
            optimizer.step()
        decay.step()
    with torch.no_grad():
        return network(others).argmax(dim=1).numpy()


def table(seen: Floats, actions: Array, others: Floats, truth: Array, trainings: int) -> Iterator[list[object]]:
    """Yield a row for the most frequent answer, then one for each network that was fitted to demonstrations.

    Args:
        seen: Observations that networks are fitted to, shape (n, 4 * 22).
        actions: Their answers, shape (n,).
        others: Observations that networks are tried on, shape (m, 4 * 22).
        truth: Their answers, shape (m,).
        trainings: Of each network.
    """
    wanted = parts(truth)
    asked = wanted != 0  # where a control changes
    asked[:, 0] = True

    def row(name: str, answers: Array) -> list[object]:
        right = parts(answers) == wanted
        return [name, *(f"{100 * own[where].mean():.1f}" for own, where in zip(right.T, asked.T, strict=True))]

    yield row("nothing: the most frequent action", np.full(len(truth), np.bincount(actions).argmax()))
    for (name, x), other in zip(inputs(seen).items(), inputs(others).values(), strict=True):
        for seed in range(trainings):
            yield row(f"{name}, seed {seed}", predicted(x, actions, other, seed))


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--episodes", type=int, default=1000, help="that networks are fitted to; a fourth more are tried"
    )
    parser.add_argument("--trainings", type=int, default=2, help="of each network")
    arguments = parser.parse_args(argv)
    torch.set_num_threads(1)
    count = check_count("--episodes", arguments.episodes, least=4)
    trainings = check_count("--trainings", arguments.trainings)
    fitted, tried = demonstrations(count, 0), demonstrations(count // 4, 2**20)
    print(f"Fitted to {len(fitted[1])} steps of {count} episodes, tried on {len(tried[1])} of {count // 4} others.\n")
    print(head(*HEADINGS))
    for row in table(*fitted, *tried, trainings):
        print(line(*row), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
