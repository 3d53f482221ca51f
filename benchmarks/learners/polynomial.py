"""Reaching by a polynomial: least squares on a few answers of the closed form, without a network or trials.

python -m kinreach.compare --task ur5 --goals 200 --methods benchmarks.learners.polynomial:Polynomial
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.polynomial import chebyshev

from kinreach._checks import Floats

#: Answers that are fitted, and the degree in each coordinate of the goal.
ANSWERS, DEGREE = 100, 6
#: How far beyond the area the polynomials' domain is, as a factor.
BEYOND = 1.02


class Polynomial:
    """Map goals on the table to postures by Chebyshev polynomials of both coordinates.

    Args:
        env: `kinreach/UR5SingleStep-v0`.
        answers: Of the closed form, at goals drawn in the area, that are fitted.
        degree: In each coordinate.
    """

    name = "polynomial"

    def __init__(self, env: gym.Env[Any, Any], answers: int = ANSWERS, degree: int = DEGREE) -> None:
        self._env: Any = env.unwrapped
        arm, self._degree = self._env.arm, degree
        region = arm.workcell.goals
        self._low, self._high = np.array([region.x, region.y]).T
        goals = arm.workcell.draw_goals(np.random.default_rng(0), answers)
        kinematics = self._env.kinematics
        postures = np.array([kinematics.axis_goal(goal, [0.0, 0.0, -1.0], seed=arm.home).q for goal in goals])
        self._weights = np.linalg.lstsq(self._features(goals), postures, rcond=1e-12)[0]

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Take the goal where the cameras saw it."""
        self._goal = np.asarray(info["seen"])[None]

    def act(self, observation: Any) -> Floats:
        """Return the action of the fitted posture."""
        return np.asarray(self._env.action_for((self._features(self._goal) @ self._weights)[0]))

    def _features(self, goals: Floats) -> Floats:
        x, y = ((2.0 * goals[:, :2] - self._low - self._high) / (self._high - self._low) / BEYOND).T
        return np.asarray(chebyshev.chebvander2d(x, y, [self._degree, self._degree]))
