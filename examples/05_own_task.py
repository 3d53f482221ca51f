"""Prints how four methods do on a task of your own: goals in the air, within 1 mm.

    python examples/05_own_task.py
    kinreach compare --task examples.05_own_task:TASK --goals 30

The closed form and LM reach all goals; the policy was trained for the table and reaches
none. Needs no extra.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach.baselines import RandomPolicy, load_policy
from kinreach.compare import (
    Method,
    Task,
    common_columns,
    compare,
    register_task,
    resets_to,
    solver_method,
)
from kinreach.kinematics import ClosedFormSolver, LevenbergMarquardtSolver


class WithinAMillimetre:
    """The environment's reward, and when the goal counts as reached."""

    def __call__(
        self, distance: np.ndarray, q: np.ndarray, impossible: np.ndarray
    ) -> tuple[np.ndarray, dict]:
        """Minus the distance [m] of k steps."""
        return -distance, {"distance": -distance}

    def reached(
        self, distance: np.ndarray, q: np.ndarray, impossible: np.ndarray
    ) -> np.ndarray:
        """Of k steps, truth values."""
        return (distance < 1e-3) & ~impossible


def goals(count: int, seed: int, env: gym.Env) -> Sequence[Mapping[str, Any]]:
    """Place balls on an arc: half a metre in front, up to a quarter above the base."""
    rng = np.random.default_rng(seed)
    turn, height = rng.uniform([-0.5, 0.0], [0.5, 0.25], (count, 2)).T
    balls = np.column_stack([0.5 * np.cos(turn), 0.5 * np.sin(turn), height])
    return resets_to(balls, seed)


TASK = register_task(
    Task(
        name="arc",
        title="UR5: tool down on an arc in the air",
        environment="kinreach/UR5SingleStep-v0",
        options={"reward": WithinAMillimetre()},
        resets=goals,
        methods={
            "closed-form": solver_method(ClosedFormSolver),
            "lm": solver_method(LevenbergMarquardtSolver),
            "ranked-single": Method(
                lambda env: load_policy("ranked-single"), kind="policy"
            ),
            "random": Method(lambda env: RandomPolicy(env.action_space), kind="chance"),
        },
        columns=common_columns(lambda trial: not trial["impossible"]),
        reached="d < 1 mm",
    )
)

if __name__ == "__main__":
    for row in compare("arc", goals=30)["methods"]:
        print(
            f"{row['name']}: {100 * row['reached']:.0f} % reached, "
            f"{row['distance_mm']['median']:.3g} mm in the median"
        )
