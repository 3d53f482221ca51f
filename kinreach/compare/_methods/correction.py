"""A correction of the closed form, learned on simulated arms."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from kinreach._checks import Floats
from kinreach.baselines.inside import expert
from kinreach.baselines.inside import random_arms as arms
from kinreach.compare._methods.models import JOINT_TERMS, UNKNOWN, Modelled
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
