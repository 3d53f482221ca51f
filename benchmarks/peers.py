"""Other analytic IK libraries behind one call: pose of the UR5's tool0 in base_link in, solutions (k, 6) out.

Used as oracles by the tests and as rivals by the benchmarks. `pip install -c constraints.txt '.[bench]'`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kinreach.kinematics.arm import ArmKinematics

PeerSolve = Callable[[np.ndarray], np.ndarray]
FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])  # base_link -> the DH base frame that ur-analytic-ik uses


def eaik_robot() -> tuple[Any, np.ndarray]:
    """EAIK's model of the UR5 from joint axes and offsets, and the transform from its end effector to tool0."""
    from eaik.IK_HP import HPRobot

    kin = ArmKinematics("ur5", tip="tool0")
    kin.fk(np.zeros(6))
    joints = [kin.data.oMi[i] for i in range(1, 7)]
    local = [np.array(axis, dtype=float) for axis in ("001", "010", "010", "010", "001", "010") for axis in [list(axis)]]
    base = kin.T_base_world
    axes = np.array([base[:3, :3] @ joint.rotation @ axis for joint, axis in zip(joints, local, strict=True)])
    origins = np.array([base[:3, :3] @ joint.translation for joint in joints])
    offsets = np.vstack([origins[:1], np.diff(origins, axis=0), np.zeros((1, 3))])
    robot = HPRobot(axes.round(9), offsets)
    return robot, np.linalg.inv(robot.fwdKin(np.zeros(6))) @ kin.fk(np.zeros(6))


def eaik_solve() -> PeerSolve:
    """EAIK 1.2 (Ostermeier et al.), subproblem decomposition in C++."""
    robot, tool = eaik_robot()
    untool = np.linalg.inv(tool)

    def solve(T: np.ndarray) -> np.ndarray:
        solutions = robot.IK(T @ untool)
        return np.asarray(solutions.Q).reshape(-1, 6)

    return solve


def ur_analytic_solve() -> PeerSolve:
    """ur-analytic-ik, the textbook closed form in C++."""
    from ur_analytic_ik import ur5

    def solve(T: np.ndarray) -> np.ndarray:
        return np.array(ur5.inverse_kinematics(np.ascontiguousarray(FLIP @ T))).reshape(-1, 6)

    return solve
