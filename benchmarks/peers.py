"""Other analytic IK libraries behind one call: pose of the UR5's tool0 in base_link in, solutions (k, 6) out.

Used as oracles by the tests and as rivals by the benchmarks. `pip install -c constraints.txt '.[bench]'`.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
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
    local = np.eye(3)[[2, 1, 1, 1, 2, 1]]  # axes of the joints in their own frames: z, y, y, y, z, y
    base = kin.T_base_world
    axes = np.array([base[:3, :3] @ joint.rotation @ axis for joint, axis in zip(joints, local, strict=True)])
    origins = np.array([base[:3, :3] @ joint.translation for joint in joints])
    offsets = np.vstack([origins[:1], np.diff(origins, axis=0), np.zeros((1, 3))])
    robot = HPRobot(axes.round(9), offsets)
    return robot, np.linalg.inv(robot.fwdKin(np.zeros(6))) @ kin.fk(np.zeros(6))


def eaik_solve(*, least_squares: bool = False) -> PeerSolve:
    """EAIK 1.2 (Ostermeier et al.), subproblem decomposition in C++.

    Args:
        least_squares: Also return the answers that EAIK itself marks as approximate.
    """
    robot, tool = eaik_robot()
    untool = np.linalg.inv(tool)

    def solve(T: np.ndarray) -> np.ndarray:
        solutions = robot.IK(T @ untool)
        q = np.asarray(solutions.Q).reshape(-1, 6)
        return q if least_squares else q[~np.asarray(solutions.is_LS, dtype=bool)]

    return solve


def ur_analytic_solve() -> PeerSolve:
    """ur-analytic-ik, the textbook closed form in C++."""
    from ur_analytic_ik import ur5

    def solve(T: np.ndarray) -> np.ndarray:
        return np.array(ur5.inverse_kinematics(np.ascontiguousarray(FLIP @ T))).reshape(-1, 6)

    return solve


def ssik_solve() -> PeerSolve:
    """Ssik 8 with its prebuilt UR5, C++ back end."""
    from ssik.prebuilt import ur5_ik

    kin = ArmKinematics("ur5", tip="tool0")
    tool = np.linalg.inv(kin.fk(np.zeros(6))) @ ur5_ik.fk(np.zeros(6))

    def solve(T: np.ndarray) -> np.ndarray:
        return np.array([solution.q for solution in ur5_ik.solve(T @ tool)]).reshape(-1, 6)

    return solve


#: Name as published -> maker of the solve function.
PEERS: dict[str, Callable[[], PeerSolve]] = {
    "EAIK 1.2.2": eaik_solve,
    "EAIK, approximate answers too": lambda: eaik_solve(least_squares=True),
    "ur-analytic-ik": ur_analytic_solve,
    "ssik": ssik_solve,
}


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Swallow what compiled code prints on the standard streams (ur-analytic-ik warns once per rejected branch)."""
    kept = [os.dup(1), os.dup(2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept[0], 1)
        os.dup2(kept[1], 2)
        for descriptor in (*kept, nowhere):
            os.close(descriptor)
