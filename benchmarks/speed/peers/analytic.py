"""Analytic solvers of the UR5, and of other arms: EAIK (Ostermeier et al.), IK-Geo, ur-analytic-ik and ssik."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.speed.peers.base import IKPeer
from kinreach._checks import Floats
from kinreach.errors import InputError
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._chain import about_z


def make_eaik(*, least_squares: bool = False) -> IKPeer:
    """EAIK, subproblem decomposition in C++: its model of the UR5 from joint axes and offsets.

    Args:
        least_squares: Keep also the answers that EAIK itself marks as approximate.
    """
    return eaik_of(ArmKinematics("ur5-thesis", tip="tool0"), least_squares=least_squares)


def eaik_of(kin: ArmKinematics, *, least_squares: bool = False) -> IKPeer:
    """EAIK's model of any arm with six joints, as `make_eaik`.

    Raises:
        InputError: EAIK has no class for the arm; the message says what it calls it.
    """
    from eaik.IK_HP import HPRobot

    axes, offsets = _axes_and_offsets(kin)
    for directions in (axes, axes.round(9)):  # of a URDF with rounded angles
        robot = HPRobot(directions, offsets)
        family = robot.getKinematicFamily()
        if "Unknown" not in family:
            break
    else:
        raise InputError(f"its class of {kin.arm.name} is {family!r}, which it does not solve")
    untool = np.linalg.inv(kin.fk(np.zeros(6))) @ robot.fwdKin(np.zeros(6))

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


def _axes_and_offsets(kin: ArmKinematics) -> tuple[Floats, Floats]:
    """Directions of the joints' axes, shape (6, 3), and offsets from one to the next and to the tip, shape (7, 3)."""
    axes, joints = [], []
    frame = kin.T_base_world
    for placement, axis in zip(*kin._joint_frames(), strict=True):
        frame = frame @ placement
        joints.append(frame[:3, 3])
        axes.append(frame[:3, :3] @ axis)
    return np.array(axes), np.vstack([joints[:1], np.diff(joints, axis=0), np.zeros((1, 3))])


def make_ik_geo() -> IKPeer:
    """IK-Geo (Elias and Wen), subproblem decomposition in Rust: its class of the UR5, from joint axes and offsets.

    It takes and gives rotations transposed.
    """
    from ik_geo.ik_geo import Robot

    kin = ArmKinematics("ur5-thesis", tip="tool0")
    axes, offsets = _axes_and_offsets(kin)
    robot = Robot.three_parallel_two_intersecting(axes.round(9).tolist(), offsets.tolist())
    end, (rotation, position) = np.eye(4), robot.forward_kinematics([0.0] * 6)
    end[:3, :3], end[:3, 3] = np.array(rotation).T, position
    untool = np.linalg.inv(kin.fk(np.zeros(6))) @ end

    def prepare(T: Floats) -> tuple[list[list[float]], list[float]]:
        pose = T @ untool
        return pose[:3, :3].T.tolist(), pose[:3, 3].tolist()

    def postures(solutions: Any) -> Floats:
        return np.array([q for q, approximate in solutions if not approximate], dtype=np.float64).reshape(-1, 6)

    return IKPeer("get_ik(R, p)", prepare, lambda pose: robot.get_ik(*pose), postures)


def general_ssik_of(kin: ArmKinematics) -> IKPeer:
    """Ssik's `general_6r` for any arm with six joints; it is prepared here, which takes minutes."""
    from ssik import Manipulator
    from ssik._kinbody import JointSpec, build_kinbody

    placements, axes = kin._joint_frames()
    placements[0] = kin.T_base_world @ placements[0]
    *links, tip = about_z(placements, axes, kin.model.frames[kin.tip_frame].placement.homogeneous)
    specs = [
        JointSpec(
            parent_link_T=link,
            axis=np.array((0.0, 0.0, 1.0)),
            joint_type="revolute",
            child_link_T=tip if joint == kin.n - 1 else None,
        )
        for joint, link in enumerate(links)
    ]
    arm = Manipulator(build_kinbody(specs))
    arm.prepare()

    def call(T: Floats) -> Any:
        return arm.solve(T, respect_limits=False, enumerate_windings=False)

    def postures(solutions: Any) -> Floats:
        return np.array([solution.q for solution in solutions], dtype=np.float64).reshape(-1, 6)

    note = "Manipulator(...).solve(T, respect_limits=False, enumerate_windings=False)"
    return IKPeer(note, np.ascontiguousarray, call, postures)


def make_ssik() -> IKPeer:
    """ssik: its prebuilt UR5, with a C++ back end."""
    from ssik.prebuilt import ur5_ik

    kin = ArmKinematics("ur5-thesis", tip="tool0")
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
    "IK-Geo": make_ik_geo,
    "ur-analytic-ik": make_ur_analytic,
    "ssik": make_ssik,
}
#: EAIK marks some answers as approximate; they are no solutions unless they are asked for.
APPROXIMATE = "EAIK, approximate answers too"
WITH_APPROXIMATE: dict[str, Callable[[], IKPeer]] = {
    "EAIK": make_eaik,
    APPROXIMATE: partial(make_eaik, least_squares=True),
    "IK-Geo": make_ik_geo,
    "ur-analytic-ik": make_ur_analytic,
    "ssik": make_ssik,
}
