"""roboticstoolbox (Corke, Haviland): Levenberg-Marquardt and forward kinematics in C++."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.speed.peers.base import IKPeer, coordinate_axis
from kinreach.checks import Floats
from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.solvers import Tolerance

#: Searches that it may start, as the other solvers with restarts: one from the seed and 20 from random postures.
SEARCHES = 21


def make(seed: Floats, tolerance: Tolerance) -> IKPeer:
    """`ik_LM` of the UR5.

    Its residual is half the squared norm of the error, metres and radians alike; the bound is the one that implies
    the position's tolerance.

    Args:
        seed: Posture to start from [rad], shape (6,).
        tolerance: How near is reached.
    """
    robot = sequence(ArmKinematics("ur5", tip="tool0"))
    bound = tolerance.position**2 / 2

    def call(T: Floats) -> Any:
        return robot.ik_LM(T, q0=seed, tol=bound, slimit=SEARCHES)

    def once(T: Floats) -> Any:
        return robot.ik_LM(T, q0=seed, tol=bound, slimit=1)

    def postures(found: Any) -> Floats:
        return np.atleast_2d(found.q) if found.success else np.empty((0, 6))

    note = f"ik_LM(T, q0, tol={bound:g}, slimit={SEARCHES})"
    return IKPeer(note, np.ascontiguousarray, call, postures, once=once)


def sequence(kin: ArmKinematics) -> Any:
    """The arm as an `ETS` with its limits, from base to tip."""
    from roboticstoolbox import ET, ETS

    turns = (ET.Rx, ET.Ry, ET.Rz)
    parts = []
    for index in range(kin.n):
        placement = kin.model.jointPlacements[index + 1].homogeneous
        parts.append(ET.SE3(kin.T_base_world @ placement if index == 0 else placement))
        turn = turns[coordinate_axis(kin, index)]
        parts.append(turn(jindex=index, qlim=[kin.lower[index], kin.upper[index]]))
    parts.append(ET.SE3(kin.model.frames[kin.tip_frame].placement.homogeneous))
    return ETS(parts)
