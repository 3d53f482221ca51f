"""Trained policies on an arm with errors: as they are, with a tuned last layer, or with a summary of looks."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach.baselines.inside import LearnedPolicy
from kinreach.baselines.inside import random_arms as arms
from kinreach.compare._methods.models import DataSheet, Modelled
from kinreach.compare._methods.practice import LookingPolicy
from kinreach.envs.inside import reach_task, real_arm


class Trained(DataSheet):
    """Aim by a policy as it was trained.

    Args:
        policy: Of the UR5 in `kinreach/Reach-v0`, in a single step: corrections lead off any one plane.
    """

    def __init__(self, policy: LearnedPolicy) -> None:
        self._policy = policy

    def aim(self, points: Floats) -> Floats:
        return self._policy.posture(_observed(points))


class Tuned(Trained):
    """Tune the last layer of a policy on its own moves.

    A move to a wrong place is a correct move for that place (Andrychowicz et al. 2017, arXiv:1707.01495): the last
    layer is regressed on the looks, with a prior at its weights.

    Args:
        noise: Standard deviation of a coordinate of a look [m].
    """

    #: Prior standard deviation of a weight's change, against a posture's error of 1 rad.
    WEIGHT = 1e-3

    def __init__(self, policy: LearnedPolicy, noise: float) -> None:
        super().__init__(policy)
        self._trained, self._noise = policy, noise

    def where(self, count: int) -> Floats:
        return self._trained.posture(_observed(arms.on_table(count)))

    def learn(self, q: Floats, seen: Floats) -> None:
        network, x = self._trained.network, _observed(seen)
        *before, (weight, bias) = network.layers
        width = weight.shape[1]
        one = np.ones(width)
        last = replace(network, layers=[*before, (np.eye(width), 0.0 * one)], gain=one, shift=0.0 * one)
        h = np.column_stack([last(x), np.ones(len(x))])
        missed = (q / math.pi - network(x)) / network.gain
        K = h @ h.T + (self._noise / self.WEIGHT) ** 2 * np.eye(len(x))
        change = (h.T @ np.linalg.solve(K, missed)).T
        tuned = replace(network, layers=[*before, (weight + change[:, :-1], bias + change[:, -1])])
        self._policy = LearnedPolicy(self._trained.card, tuned)


class Informed(LookingPolicy):
    """Act by a policy of `kinreach/RandomArm-v0` for arms with random errors, which observes a summary of the looks."""

    def __init__(self, policy: LearnedPolicy, env: gym.Env[Any, Any]) -> None:
        super().__init__(lambda env: Modelled(), env)
        self._policy = policy

    def act(self, observation: Any) -> Floats:
        if observation[0, real_arm.MOVES] == 0.0:
            budget = int(observation[0, real_arm.BUDGET])
            self._practise(budget)
            places = arms.ur5().chain.positions(self._q)
            self._observation = np.zeros((len(observation), arms.SIZE))
            self._observation[:, arms.BALL], self._observation[:, arms.LOOKED] = (
                observation[:, real_arm.SEEN_BALL],
                budget,
            )
            self._observation[:, arms.SUMMARY] = arms.summary(places, self._seen - places)
        else:
            self._observation = arms.after_move(
                self._observation, observation[:, real_arm.POSTURE], observation[:, real_arm.SEEN_TIP]
            )
        return np.asarray(self._policy.act(self._observation))


def _observed(points: Floats) -> Floats:
    """Return observations of balls at points (n, 3), with the tool straight down."""
    arm = arms.ur5().arm
    rest = np.array([*reach_task.TOOL_DOWN, *arm.home, 0.0 if arm.gripper is None else arm.gripper.opening])
    return np.column_stack([reach_task.goal_block(arm, points), np.tile(rest, (len(points), 1))])
