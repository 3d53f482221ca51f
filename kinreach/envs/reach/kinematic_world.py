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
        self._home = np.array(self._kinematics.arm.home)[:, None]
        self._home_tip = self._kinematics.positions(self._home.T).T
        # one joint or coordinate after the other, as the formulas want them
        self._q = np.repeat(self._home, count, axis=1)
        self._tip = np.repeat(self._home_tip, count, axis=1)

    def reset(self, ids: Ids, goals: Floats, q: Floats | None) -> None:
        """Put arms into postures [rad], shape (k, 6), or the start pose; balls need no place here."""
        rows = ids if len(ids) < self.count else slice(None)
        self._q[:, rows] = self._home if q is None else q.T
        self._tip[:, rows] = self._home_tip if q is None else self._kinematics.positions(q).T

    def execute(self, targets: Floats, *, two_phase: bool) -> Executed:
        """Take the targets that can be taken."""
        impossible = self._check.impossible(targets)
        moved = np.flatnonzero(~impossible)
        q = targets.T.take(moved, axis=1)
        for array, values in ((self._q, q), (self._tip, self._kinematics.chain.positions(q.T).T)):
            for row, new in zip(array, values, strict=True):
                row[moved] = new
        reasons = None
        if self._explain:
            reasons = [
                self._check.reason(target) if bad else "" for target, bad in zip(targets, impossible, strict=True)
            ]
        return Executed(self.q, self._tip.T, impossible, reasons)

    @property
    def q(self) -> Floats:
        """Postures [rad], shape (count, 6)."""
        return self._q.T

    def close(self) -> None:
        """Nothing to let go of."""
