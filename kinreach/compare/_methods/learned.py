"""What is learned of an arm with errors: a correction of the closed form, a policy's last layer, a summary of looks."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach.baselines.inside import LearnedPolicy, expert
from kinreach.baselines.inside import random_arms as arms
from kinreach.compare._methods.models import JOINT_TERMS, UNKNOWN, DataSheet, Modelled
from kinreach.compare._methods.practice import LookingPolicy
from kinreach.envs.inside import reach_task, real_arm
from kinreach.robots.inside import Prior, frames_of, joint_slopes, slopes

#: Errors of the arms in training, root mean square [m, rad]: wider than those of `kinreach/RealArm-v0`. A base that is
#: off stands for cameras, too.
TRAINED_ON = Prior(base=(8e-3, 1.2e-2), links=(1e-3, 2e-3), tool=(4e-3, 0.0))
#: Arms and balls of a training; ridge of the regression.
ARMS, BALLS, RIDGE = 4000, 60, 1e-6


class LearnedCorrection(Modelled):
    """Aim by the closed form at a target that a regression corrects, from a summary of the looks.

    To first order the summary's nine numbers and the error at a ball depend linearly on the frames' errors, so the
    regression is linear in the nine, with coefficients that are cubic in the ball's place.

    Args:
        noise: Standard deviation of a coordinate of a look [m].
        seed: Of the training.
        joints: Whether the training's arms have the joint errors of `JOINT_TERMS`, too.
    """

    def __init__(self, noise: float, seed: int = 0, *, joints: bool = False) -> None:
        self._noise, self._seed, self._joints = noise, seed, joints
        self._summary, self._weights, self._doubt = np.zeros(9), np.zeros((90, 3)), UNKNOWN

    def learn(self, q: Floats, seen: Floats) -> None:
        places = arms.ur5().chain.positions(q)
        self._summary = arms.summary(places, seen - places)
        self._weights, self._doubt = _trained(len(q), self._noise, self._seed, self._joints)

    def predicted(self, q: Floats) -> Floats:
        places = arms.ur5().chain.positions(q)
        return np.asarray(places + _features(self._summary, places) @ self._weights)

    def doubt(self, points: Floats) -> float:
        return self._doubt


@lru_cache(maxsize=64)
def _trained(looks: int, noise: float, seed: int, joints: bool) -> tuple[Floats, float]:
    """Return the weights (90, 3) of a regression for a number of looks, and its root mean square error [m]."""
    rng, chain = np.random.default_rng(seed), arms.ur5().chain
    errors = rng.normal(size=(ARMS, 42)) * TRAINED_ON.deviations(chain.joints).ravel()
    if joints:
        errors = np.hstack([errors, rng.normal(size=(ARMS, len(JOINT_TERMS.spread))) * JOINT_TERMS.spread])
    balls = arms.on_table(BALLS)

    def off(points: Floats) -> Floats:
        """Errors at points (m, 3), of all arms, shape (ARMS, m, 3)."""
        q = expert.tool_down_postures(arms.ur5(), points)
        change = slopes(frames_of(chain.placements, q))
        if joints:
            change = np.hstack([change, joint_slopes(change, JOINT_TERMS.of(q))])
        return np.asarray((errors @ change.reshape(3 * len(points), -1).T).reshape(ARMS, len(points), 3))

    places = arms.on_table(looks)
    summaries = arms.summary(places, off(places) + rng.normal(0.0, noise, (ARMS, looks, 3)))
    wanted = off(balls).reshape(-1, 3)
    x = np.concatenate([_features(one, balls) for one in summaries])
    gram = x.T @ x
    weights = np.linalg.solve(gram + RIDGE * np.diag(np.diag(gram)), x.T @ wanted)
    return weights, math.sqrt(float(np.mean((wanted - x @ weights) ** 2)))


def _features(summaries: Floats, places: Floats) -> Floats:
    """Products of nine numbers, shape (9,), and ten of places on the table (m, 3), shape (m, 90)."""
    middle = arms.on_table(50).mean(axis=0)
    x, y = 5.0 * (places - middle)[:, :2].T
    basis = np.column_stack([x**i * y**j for i in range(4) for j in range(4 - i)])
    return np.asarray((basis[:, :, None] * summaries).reshape(len(places), -1))


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
