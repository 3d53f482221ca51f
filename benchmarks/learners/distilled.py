"""A planner in a network: the answers of `scenarios` to rolling balls, imitated."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from benchmarks.learners.variants import gradient_moving_late
from kinreach._checks import Floats
from kinreach.baselines import get_recipe, register_recipe
from kinreach.compare._methods.scenarios import Scenarios
from kinreach.envs import moving

#: Futures that are drawn for an answer: more touch no more balls, and take longer.
COUNT = 16


class _Planner(Scenarios):
    """As it plans where others may move the arm, so that its motions tell nothing about its limits."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env, count=COUNT)

    def _fit_arm(self, q: Floats, v: Floats) -> None:
        """Believe the data sheet."""


class ScenariosExpert:
    """A planner for each environment of a batch; row k of every call is of environment k.

    Answers are the nearest targets that lead to the same motion in the next frame.

    Args:
        env: `kinreach/Moving-v0` with so many sights that the first of an episode is known.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._env, self._planners = env, list[_Planner]()
        world: Any = env.unwrapped
        self._limits = {"speed": world.speed_limit, "acceleration": world.acceleration_limit}

    def act(self, observation: ArrayLike) -> Floats:
        """Return the actions for rows of observations, shape (n, m)."""
        rows = np.asarray(observation, dtype=float)
        self._planners += [_Planner(self._env) for _ in rows[len(self._planners) :]]
        begins = (rows[:, moving.RATES.stop :] == 0.0).all(axis=1)  # no sight differs from the last
        targets = np.empty((len(rows), moving.JOINTS))
        for k, (planner, row) in enumerate(zip(self._planners, rows, strict=False)):
            if begins[k]:
                planner.reset(row, {"q": row[moving.ANGLES]})
            targets[k] = math.pi * planner.act(row)
        ends = moving.motion_range(rows[:, moving.ANGLES], rows[:, moving.RATES], **self._limits)
        return np.asarray(np.clip(targets, *ends) / math.pi)


_PUSH, _LATE = get_recipe("imitated-push"), gradient_moving_late
distilled_moving_late = register_recipe(
    replace(
        _PUSH,
        name="distilled-moving-late",
        summary="The network of gradient-moving-late fitted to what `scenarios` answers; collisions are ignored.",
        environment=_LATE.environment,
        options={**_LATE.options, "collisions": False, "speeds": (0.4, 0.8, 1.2)},
        networks=_LATE.networks,
        steps=40_000,
        num_envs=64,
        segments=20,
        window=6400,
        settings={
            **_PUSH.settings,
            "updates": 600,
            "expert": "benchmarks.learners.distilled:ScenariosExpert",
            **{name: _LATE.settings[name] for name in ("low", "high")},
        },
    )
)
