"""Policies that nobody trained: chance, and the closed form on what the cameras saw."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from kinreach.checks import Floats
from kinreach.envs.reach.task import MULTI_STEP, SINGLE_STEP, STEP_SIZE, TOOL_DOWN
from kinreach.errors import InputError
from kinreach.kinematics import CollisionChecker, UR5Kinematics
from kinreach.thesis.reward import REACHED_POSTURE_ERROR, posture_error
from kinreach.vision.goal_view import goal_in_world


class Policy(Protocol):
    """Anything that chooses an action from one observation."""

    def reset(self, info: dict[str, Any]) -> None:
        """A new episode begins; `info` is that of the environment's reset."""
        ...

    def act(self, observation: Any) -> Any:
        """The action for an observation."""
        ...


class RandomPolicy:
    """Draws from the action space.

    Args:
        action_space: Of the environment.
        seed: Of the draws.
    """

    def __init__(self, action_space: spaces.Space[Any], *, seed: int) -> None:
        self._space = action_space
        self._space.seed(seed)

    def reset(self, info: dict[str, Any]) -> None:
        """Chance does not care."""

    def act(self, observation: Any) -> Any:
        """Any action."""
        return self._space.sample()


class AnalyticReachPolicy:
    """Closed-form inverse kinematics on the observed goal: tool down, natural posture, free of collisions.

    It uses what an agent is given, not the true goal: the six goal numbers of the observation and which cameras found
    the ball.

    Args:
        variant: `"single"` or `"multi"`: what an action means.

    Raises:
        InputError: An unknown variant.
    """

    def __init__(self, variant: str) -> None:
        if variant not in (SINGLE_STEP.name, MULTI_STEP.name):
            raise InputError(f"variant must be {SINGLE_STEP.name!r} or {MULTI_STEP.name!r}, got {variant!r}")
        self._relative = variant == MULTI_STEP.name
        self._kinematics = UR5Kinematics(tip="tcp", base="world")
        self._checker = CollisionChecker(self._kinematics)
        self._home = np.array(self._kinematics.arm.home)
        self._found = np.ones(2, dtype=np.bool_)
        self._target: Floats | None = None

    def reset(self, info: dict[str, Any]) -> None:
        """Forget the last goal."""
        self._found = np.asarray(info["ball_found"])
        self._target = None

    def act(self, observation: Floats) -> Floats:
        """The action that takes the arm to the posture, or as far towards it as one action goes.

        Where no camera found the ball, or no posture is left, the arm stays where it is.
        """
        q = np.asarray(observation[6:12])
        if self._target is None:
            self._target = self._posture(np.asarray(observation[:6]), q)
        if not self._relative:
            return self._target / SINGLE_STEP.scale
        way = self._target - q
        return way / max(STEP_SIZE, float(np.abs(way).max()))  # straight in joint space, all joints arrive together

    def _posture(self, view: Floats, q: Floats) -> Floats:
        goal = goal_in_world(self._kinematics.arm, view, self._found)
        if goal is None:
            return q
        result = self._kinematics.axis_goal(goal, TOOL_DOWN, q, accept=self._accept)
        return result.q if result.success else q

    def _accept(self, q: Floats) -> bool:
        return float(posture_error(q)) < REACHED_POSTURE_ERROR and self._checker.free(q)
