"""Steps per second of the environments, in one process: native batches beside single environments and peers.

    python -m benchmarks.environments [--seconds 3]

Peers are measured where they are installed (`pip install panda-gym`, whose PyBullet is not among kinreach's packages).
Rounds are interleaved and the best of each counts, so that a busy machine hits all alike; trust the ratios.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym

import kinreach

ROUNDS = 5
PEERS = {"PandaReach-v3": "panda_gym", "Reacher-v5": "mujoco"}
Stepper = Callable[[], int]


def native(name: str, count: int, **options: Any) -> Stepper:
    """A native batch under random actions; one call is one step of all environments."""
    env = gym.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", **options)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(16)]
    turn = iter(range(sys.maxsize))

    def step() -> int:
        env.step(actions[next(turn) % len(actions)])
        return count

    return step


def single(name: str, **options: Any) -> Stepper:
    """One environment under random actions; one call is one step."""
    env = gym.make(name, **options)
    env.reset(seed=0)
    env.action_space.seed(0)

    def step() -> int:
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            env.reset()
        return 1

    return step


def steps_per_second(step: Stepper, seconds: float) -> float:
    """Rate over at least the given time."""
    steps, start = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - start) < seconds:
        steps += step()
    return steps / elapsed


def main(argv: list[str] | None = None) -> int:
    """Measure and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3.0, help="per environment, in all rounds together")
    args = parser.parse_args(argv)
    one, many, button = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0", "kinreach/ButtonPress-v0"
    steppers: dict[str, Stepper] = {
        f"{one}, kinematic, batch of 4096": native(one, 4096, backend="kinematic"),
        f"{many}, kinematic, batch of 4096": native(many, 4096, backend="kinematic"),
        f"{one}, kinematic, one": single(one, backend="kinematic"),
        f"{one}, mujoco, batch of 256, 1 thread": native(one, 256, backend="mujoco"),
        f"{one}, mujoco, batch of 256, 2 threads": native(one, 256, backend="mujoco", threads=2),
        f"{one}, mujoco, one": single(one, backend="mujoco"),
        f"{many}, mujoco, one": single(many, backend="mujoco"),
        f"{button}, batch of 256, 1 thread": native(button, 256),
        f"{button}, batch of 256, 2 threads": native(button, 256, threads=2),
        f"{button}, one": single(button),
    }
    for name, module in PEERS.items():
        try:
            __import__(module)
            steppers[name] = single(name)
        except (ImportError, gym.error.Error) as error:
            print(f"{name} left out: {error}", file=sys.stderr)
    best = dict.fromkeys(steppers, 0.0)
    for _ in range(ROUNDS):
        for name, step in steppers.items():
            best[name] = max(best[name], steps_per_second(step, args.seconds / ROUNDS))
    print(f"kinreach {kinreach.__version__}\n\n| environment | steps/s |\n|---|---|")
    for name, rate in best.items():
        print(f"| {name} | {rate:,.0f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
