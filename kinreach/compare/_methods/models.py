"""Learners with a model of the arm: the data sheet, an identified chain, or a Gaussian process of the errors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.baselines.inside import expert
from kinreach.baselines.inside import random_arms as arms
from kinreach.robots.inside import IdentifiedArm, JointTerms, Prior

#: How far base and tool may be from the data sheet [m, rad], and links: calibrations of UR3, UR10e, UR3e and UR5e have
#: 0.3 to 0.8 mm and 1.4 to 1.7 mrad (root mean square), none of which is among those of the task `real-arm`.
REGISTERED = Prior(base=(0.02, 0.02), links=(0.0, 0.0), tool=(0.01, 0.0))
ALL_PARAMETERS = Prior(base=(0.02, 0.02), links=(1e-3, 2e-3), tool=(0.01, 0.0))
#: Expected error without any look, and of links that registering does not fit [m].
UNKNOWN, UNMODELLED = 5e-3, 1e-4


def _joint_terms(q: Floats) -> Floats:
    """Return terms of the joints' deviations in consecutive postures (m, 6), shape (m, 6, 24).

    Of each joint: sine and cosine of its angle (an encoder off its axis), how much it lifts the tip (compliance under a
    load), and the sign of its last motion (hysteresis).
    """
    lifts = arms.ur5().chain.jacobian(q)[:, 2]
    ways = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    return np.concatenate([np.eye(6) * part[:, :, None] for part in (np.sin(q), np.cos(q), lifts, ways)], axis=2)


#: Deviations of joints: an encoder's error [rad], compliance under a load [rad/m], half of the hysteresis [rad].
JOINT_TERMS = JointTerms(_joint_terms, np.repeat((1e-3, 1e-3, 5e-3, 3e-4), 6))


class DataSheet:
    """Aim by the closed form of the data sheet."""

    def where(self, count: int) -> Floats:
        """Return no postures, shape (0, 6): the data sheet needs no looks."""
        return np.empty((0, 6))

    def learn(self, q: Floats, seen: Floats) -> None:
        """Ignore the looks: the data sheet does not change."""

    def aim(self, points: Floats) -> Floats:
        return expert.tool_down_postures(arms.ur5(), points)

    def doubt(self, points: Floats) -> float:
        return UNKNOWN


class Modelled(DataSheet):
    """Aim by the closed form at a target that is corrected by the error that a better model predicts."""

    #: Corrections of the target.
    ROUNDS = 2

    def where(self, count: int) -> Floats:
        """Return postures over the table; turns of the tool by up to 0.15 or 0.5 rad left larger errors."""
        return expert.tool_down_postures(arms.ur5(), arms.on_table(count))

    def predicted(self, q: Floats) -> Floats:
        """Return where the tip would be seen in postures (m, 6) [m], shape (m, 3)."""
        return arms.ur5().chain.positions(q)

    def aim(self, points: Floats) -> Floats:
        target = points
        for _ in range(self.ROUNDS):
            q = super().aim(target)
            target = target + points - self.predicted(q)
        return super().aim(target)


class Identified(Modelled):
    """Identify the frames of the chain by least squares with a prior.

    Args:
        prior: How far each frame may be off.
        noise: Standard deviation of a coordinate of a look [m].
        terms: Deviations of the joints that are identified, too.
    """

    def __init__(self, prior: Prior, noise: float, terms: JointTerms | None = None) -> None:
        self._prior, self._noise, self._terms = prior, noise, terms
        self._arm: IdentifiedArm | None = None

    def learn(self, q: Floats, seen: Floats) -> None:
        placements = arms.ur5().chain.placements
        self._arm = IdentifiedArm(placements, q, seen, prior=self._prior, noise=self._noise, terms=self._terms)

    def predicted(self, q: Floats) -> Floats:
        return super().predicted(q) if self._arm is None else self._arm.positions(q)

    def doubt(self, points: Floats) -> float:
        """Return the doubt of the frames, and of links that are not fitted."""
        if self._arm is None:
            return UNKNOWN
        return math.hypot(
            self._arm.doubt(expert.tool_down_postures(arms.ur5(), points)), 0.0 if self._prior.links[0] else UNMODELLED
        )


class Residual(Modelled):
    """Fit a Gaussian process to what the data sheet misses, over the place of the tip by the data sheet.

    Its covariance is that of an unknown mean, an unknown slope and a smooth rest; coordinates are independent.

    Args:
        noise: Standard deviation of a coordinate of a look [m].
    """

    #: Prior standard deviations of the mean [m], of the slope over a metre [m] and of the rest [m]; its length scale
    #: [m].
    MEAN, SLOPE, REST, LENGTH = 0.01, 0.02, 5e-4, 0.3

    def __init__(self, noise: float) -> None:
        self._noise = noise
        self._places: Floats = np.empty((0, 3))
        self._inverse: NDArray[Any] = np.empty((0, 0))
        self._weights: Floats = np.empty((0, 3))

    def learn(self, q: Floats, seen: Floats) -> None:
        self._places = arms.ur5().chain.positions(q)
        self._inverse = np.linalg.inv(self._covariance(self._places, self._places) + self._noise**2 * np.eye(len(q)))
        self._weights = np.asarray(self._inverse @ (seen - self._places))

    def predicted(self, q: Floats) -> Floats:
        places = arms.ur5().chain.positions(q)
        return np.asarray(places + self._covariance(places, self._places) @ self._weights)

    def doubt(self, points: Floats) -> float:
        """Return the standard deviation of the process, root mean square over the points."""
        if not len(self._places):
            return UNKNOWN
        K = self._covariance(points, self._places)
        left = np.diag(self._covariance(points, points)) - np.einsum("ij,jk,ik->i", K, self._inverse, K)
        return math.sqrt(max(float(left.mean()), 0.0))

    def _covariance(self, one: Floats, other: Floats) -> Floats:
        middle = arms.on_table(50).mean(axis=0)
        a, b = one - middle, other - middle
        apart = ((a[:, None] - b[None]) ** 2).sum(axis=2)
        return self.MEAN**2 + self.SLOPE**2 * a @ b.T + self.REST**2 * np.exp(-0.5 * apart / self.LENGTH**2)
