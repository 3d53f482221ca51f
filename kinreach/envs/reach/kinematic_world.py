"""A world without dynamics: a posture is taken at once, if it can be."""

from __future__ import annotations

import numpy as np

from kinreach.envs.reach.world import Executed, Ids
from kinreach.kinematics import UR5Kinematics
from kinreach.kinematics.fast_collision import FastCollision
from kinreach.kinematics.goals import Floats


class KinematicWorld:
    """Arms that jump to their targets; joint limits and collisions of the target are still judged.

    An impossible target leaves the arm where it is. Collisions on the way are not judged.

    Args:
        count: Number of arms.
        explain: Say for each impossible target why; costs time, meant for single environments.
    """

    def __init__(self, count: int, *, explain: bool = False) -> None:
        self.count = count
        self._explain = explain
        self._kinematics = UR5Kinematics(tip="tcp", base="world")
        self._check = FastCollision(self._kinematics.arm)
        self._home = np.array(self._kinematics.arm.home)
        self._q = np.tile(self._home, (count, 1))

    def reset(self, ids: Ids, goals: Floats, q: Floats | None) -> None:
        """Put arms into postures [rad], shape (k, 6), or the start pose; balls need no place here."""
        self._q[ids if len(ids) < self.count else slice(None)] = self._home if q is None else q

    def execute(self, targets: Floats, *, two_phase: bool) -> Executed:
        """Take the targets that can be taken."""
        impossible = self._check.impossible(targets)
        q = self._q = np.where(impossible[:, None], self._q, targets)
        tip = self._kinematics.positions(q)
        reasons = None
        if self._explain:
            reasons = [
                self._check.reason(target) if bad else "" for target, bad in zip(targets, impossible, strict=True)
            ]
        return Executed(q, tip, impossible, reasons)

    @property
    def q(self) -> Floats:
        """Postures [rad], shape (count, 6)."""
        return self._q.copy()

    def close(self) -> None:
        """Nothing to let go of."""
