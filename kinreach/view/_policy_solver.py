"""Trained policies as solvers."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from kinreach._registration import MULTI, SINGLE
from kinreach.baselines import load_policy, rollout
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, Goal, IKResult
from kinreach.kinematics.inside import Accept


class PolicySolver:
    """A policy as a solver: an episode without dynamics, from the start pose of its training.

    It gets the position of the goal and brings the tool there pointing down; an error to another direction counts
    like any other.

    Args:
        policy: Name or file, of a policy for one of the thesis's reach tasks.

    Attributes:
        seconds: Time of its decisions for the last goal [s].
    """

    def __init__(self, policy: str, kinematics: ArmKinematics) -> None:
        self.name = policy
        self._policy = load_policy(policy)
        self._kinematics = kinematics
        self.seconds = 0.0
        environment = self._policy.card.environment
        if environment not in (SINGLE, MULTI):
            raise InputError(f"the policy {policy} is for {environment}, not for one of: {SINGLE}, {MULTI}")
        options = self._policy.needed_options | {"arm": kinematics.arm, "backend": "kinematic"}
        self._env: gym.Env[Any, Any] = gym.make(environment, disable_env_checker=True, **options)
        self._policy.check_spaces(self._env.observation_space, self._env.action_space)

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Play the policy and return its end; the seed is not used."""
        (trial,) = rollout(self._env, self._policy, [{"seed": 0, "options": {"goal": goal.frame()[:3, 3]}}])
        self.seconds = trial["solve_s"]
        q = np.array(trial["target"] if trial["steps"] == 1 else trial["q"])
        return IKResult.of(self._kinematics, goal, q, accept=accept, iterations=trial["steps"])
