"""A policy that practises on an arm with errors, and corrects its aim by what it sees.

A `Learner` finds postures that bring the tip to a point, from looks. `LookingPolicy` looks as often as the environment
allows, aims, and corrects the aim by the error of the last moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach.envs.inside import real_arm


class Learner(Protocol):
    """Learn from looks which posture brings the tip to a point."""

    def where(self, count: int) -> Floats:
        """Return postures to look in [rad], shape (count, 6), beginning with those of a smaller count."""
        ...

    def learn(self, q: Floats, seen: Floats) -> None:
        """Fit all looks so far: postures [rad], shape (m, 6), and where the tip was seen [m], shape (m, 3)."""
        ...

    def aim(self, points: Floats) -> Floats:
        """Return postures (n, 6) [rad] that should bring the tip to points in the world [m], shape (n, 3)."""
        ...

    def doubt(self, points: Floats) -> float:
        """Return the standard deviation of a coordinate of the expected error at points [m]."""
        ...


class LookingPolicy:
    """Practise, aim, and correct the aim by what was seen; if `again`, also by the tip seen beside a ball."""

    def __init__(self, learner: Callable[[Any], Learner], env: gym.Env[Any, Any], *, again: bool = True) -> None:
        self._new, self._again = learner, again
        self._env: Any = env.unwrapped

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        self._learner = self._new(self._env)
        self._q, self._seen = np.empty((0, 6)), np.empty((0, 3))
        self._points = np.empty((0, 3))
        self._offsets: list[Floats] = []

    def act(self, observation: Any) -> Floats:
        balls = observation[:, real_arm.SEEN_BALL]
        if observation[0, real_arm.MOVES] == 0.0:
            self._practise(int(observation[0, real_arm.BUDGET]))
            self._points = balls
            self._offsets = []
        elif self._again:
            self._offsets.append(self._points - observation[:, real_arm.SEEN_TIP])
            # the error at a ball, from the learner (zero) and from what was seen, each by its variance
            doubt = self._learner.doubt(balls) ** 2
            share = doubt / (doubt + self._env.noise**2 / len(self._offsets))
            self._points = balls + share * np.mean(self._offsets, axis=0)
        return self._learner.aim(self._points) / math.pi

    def _practise(self, budget: int) -> None:
        new = self._learner.where(budget)[len(self._q) :] if budget else self._q
        if len(new):
            self._seen = np.concatenate([self._seen, self._env.look(new)])
            self._q = np.concatenate([self._q, new])
            self._learner.learn(self._q, self._seen)
