"""EAIK (Ostermeier et al.): subproblem decomposition in C++."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.speed.peers.base import IKPeer
from kinreach.checks import Floats
from kinreach.kinematics.arm import ArmKinematics


def make(*, least_squares: bool = False) -> IKPeer:
    """EAIK's model of the UR5, from joint axes and offsets.

    Args:
        least_squares: Keep also the answers that EAIK itself marks as approximate.
    """
    robot, tool = _robot()
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


def _robot() -> tuple[Any, Floats]:
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
