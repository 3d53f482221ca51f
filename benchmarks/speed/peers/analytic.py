"""Analytic solvers of the UR5: EAIK (Ostermeier et al.), ur-analytic-ik and ssik."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.speed.peers.base import IKPeer
from kinreach.checks import Floats
from kinreach.kinematics.arm import ArmKinematics


def make_eaik(*, least_squares: bool = False) -> IKPeer:
    """EAIK, subproblem decomposition in C++: its model of the UR5 from joint axes and offsets.

    Args:
        least_squares: Keep also the answers that EAIK itself marks as approximate.
    """
    robot, tool = _eaik_robot()
    untool = np.linalg.inv(tool)

    def postures(solutions: Any) -> Floats:
        q: Floats = np.asarray(solutions.Q, dtype=np.float64).reshape(-1, 6)
        return q if least_squares else q[~np.asarray(solutions.is_LS, dtype=bool)]

    def call(T: Floats) -> Any:
        solutions = robot.IK(T)
        solutions.Q  # noqa: B018 (the postures are converted only when they are asked for)
        return solutions

    def batch(T: Floats) -> Any:
        poses = T @ untool
        return lambda: robot.IK_batched(poses, 1)

    return IKPeer("IK(T).Q", lambda T: np.ascontiguousarray(T @ untool), call, postures, batch=batch)


def _eaik_robot() -> tuple[Any, Floats]:
    """EAIK's robot, and the transform from its end effector to tool0."""
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


def make_ssik() -> IKPeer:
    """ssik: its prebuilt UR5, with a C++ back end."""
    from ssik.prebuilt import ur5_ik

    kin = ArmKinematics("ur5", tip="tool0")
    tool = np.linalg.inv(kin.fk(np.zeros(6))) @ ur5_ik.fk(np.zeros(6))

    def postures(solutions: Any) -> Floats:
        return np.array([solution.q for solution in solutions], dtype=np.float64).reshape(-1, 6)

    def call(T: Floats) -> Any:
        return ur5_ik.solve(T, enumerate_windings=False)

    note = "ur5_ik.solve(T, enumerate_windings=False)"  # one winding per branch, as the others
    return IKPeer(note, lambda T: np.ascontiguousarray(T @ tool), call, postures)


FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])  # base_link -> the DH base frame that it uses


def make_ur_analytic() -> IKPeer:
    """ur-analytic-ik, the textbook closed form in C++: its UR5."""
    from ur_analytic_ik import ur5

    def postures(solutions: Any) -> Floats:
        return np.array(solutions, dtype=np.float64).reshape(-1, 6)

    return IKPeer(
        "ur5.inverse_kinematics(T)", lambda T: np.ascontiguousarray(FLIP @ T), ur5.inverse_kinematics, postures
    )


#: Name -> maker.
ANALYTIC: dict[str, Callable[[], IKPeer]] = {
    "EAIK": make_eaik,
    "ur-analytic-ik": make_ur_analytic,
    "ssik": make_ssik,
}
#: EAIK marks some answers as approximate; they are no solutions unless they are asked for.
APPROXIMATE = "EAIK, approximate answers too"
WITH_APPROXIMATE: dict[str, Callable[[], IKPeer]] = {
    "EAIK": make_eaik,
    APPROXIMATE: partial(make_eaik, least_squares=True),
    "ur-analytic-ik": make_ur_analytic,
    "ssik": make_ssik,
}
