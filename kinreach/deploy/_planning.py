"""From goals to the moves of a program: which branch, which way, and why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinreach._checks import Floats
from kinreach.deploy._controller import tcp_of
from kinreach.deploy._motion import LineError, StraightLine
from kinreach.deploy._program import MAX_TOOL_SPEED, Move
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CollisionChecker, pose_vector
from kinreach.kinematics._closed_form import ClosedFormKinematics
from kinreach.robots._tools import FLANGE

#: Part of the joints' speed limits, and of `MAX_TOOL_SPEED`, that a motion has unless another is asked for.
SPEED = 0.25
#: Accelerations of the joints [rad/s^2] and of the tool [m/s^2]: the defaults of URScript.
JOINT_ACCELERATION, TOOL_ACCELERATION = 1.4, 1.2
#: Between two postures that are checked for collisions no joint moves further [rad].
STEP = 0.01
#: Decimals of the joint angles in a program [rad].
ROUNDED = 7


@dataclass(frozen=True, eq=False)
class Leg:
    """The way to one goal.

    Attributes:
        move: What the program does.
        end: Posture at the goal [rad], shape (6,).
        branch: Of that posture; -1 if it is none of the closed form's.
        free, postures: Postures of the goal, and those that do not collide.
    """

    move: Move
    end: Floats
    branch: int
    free: int
    postures: int


def plan(
    kinematics: ClosedFormKinematics,
    checker: CollisionChecker,
    start: Floats,
    goals: Sequence[Floats],
    *,
    linear: bool = False,
    speed: float = SPEED,
    blend: float = 0.0,
) -> list[Leg]:
    """Plan the way from a posture through goals, each by the nearest branch whose way is free.

    Args:
        kinematics: Of the UR with its tool, in the frame `base`.
        checker: Of collisions.
        start: Posture [rad], shape (6,).
        goals: Poses of the tool centre point (4, 4).
        linear: Straight lines of the tool; else straight lines in joint space.
        speed: Part of the largest speeds, above 0 and at most 1.
        blend: Radius at all goals but the last [m].

    Raises:
        InputError: The start collides or is outside the limits, a goal has no free posture, or no way to it is free;
            the message says what collides and where.
    """
    if reason := checker.reason(start):
        raise InputError(f"the start posture cannot be used: {reason}")
    legs: list[Leg] = []
    q = start
    for number, T in enumerate(goals, start=1):
        radius = blend if number < len(goals) else 0.0
        where = f"goal {number}" if len(goals) > 1 else "the goal"
        leg = (_straight if linear else _joint)(kinematics, checker, q, T, where, speed, radius)
        legs.append(leg)
        q = leg.end
    return legs


def collision_on(checker: CollisionChecker, way: Floats) -> str:
    """Return what a way of postures (m, 6) runs into first and where; empty if nothing.

    Between two rows the joints move on a straight line, on which it is looked every `STEP`.
    """
    for begin, end, row in zip(way[:-1], way[1:], range(len(way)), strict=False):
        count = max(1, int(np.ceil(np.abs(end - begin).max() / STEP)))
        shares = np.linspace(0.0, 1.0, count + 1)[1:]
        postures = begin + shares[:, None] * (end - begin)
        bad = np.flatnonzero(checker.impossible(postures))
        if len(bad):
            percent = 100 * (row + shares[bad[0]]) / (len(way) - 1)
            return f"{checker.reason(postures[bad[0]])} at {percent:.0f} % of the way"
    return ""


def _joint(
    kin: ClosedFormKinematics, checker: CollisionChecker, q: Floats, T: Floats, where: str, speed: float, blend: float
) -> Leg:
    found, branches = _postures(kin, q, T, where)
    blocked: list[str] = []
    causes = [checker.reason(posture) for posture in found]
    for posture, branch, cause in zip(found, branches, causes, strict=True):
        if cause:
            continue
        end = posture.round(ROUNDED)
        if reason := collision_on(checker, np.array([q, end])):
            blocked.append(reason)
            continue
        move = Move("movej", tuple(end), speed * float(kin.velocity_limit.min()), JOINT_ACCELERATION, blend)
        return Leg(move, end, branch, causes.count(""), len(found))
    if not blocked:
        colliding = ", ".join(dict.fromkeys(causes))
        raise InputError(f"{where} has no free branch: all {len(found)} postures collide: {colliding}")
    raise InputError(
        f"no straight way in joint space to {where} is free: {'; '.join(dict.fromkeys(blocked))}; go by way of another "
        "pose"
    )


def _straight(
    kin: ClosedFormKinematics, checker: CollisionChecker, q: Floats, T: Floats, where: str, speed: float, blend: float
) -> Leg:
    found, branches = _postures(kin, q, T, where)
    flange, fastest = ArmKinematics(kin.arm, tip=FLANGE, base="base"), speed * MAX_TOOL_SPEED
    try:
        line = StraightLine(flange, tcp_of(kin.arm), q, T, fastest, TOOL_ACCELERATION)
    except LineError as error:
        raise InputError(f"{where}: {error}; leave out --linear, or begin in another branch") from None
    if reason := collision_on(checker, line.path):
        raise InputError(f"the straight line to {where} is not free: {reason}")
    off = np.abs(found - line.end).max(axis=1)
    branch = int(branches[off.argmin()]) if off.min() < 1e-4 else -1
    free = sum(not checker.in_collision(posture) for posture in found)
    move = Move("movel", tuple(pose_vector(T).round(9)), fastest, TOOL_ACCELERATION, blend)
    return Leg(move, line.end, branch, free, len(found))


def _postures(kin: ClosedFormKinematics, q: Floats, T: Floats, where: str) -> tuple[Floats, list[int]]:
    """Every posture of a goal, nearest first, and their branches."""
    solutions = kin.all_solutions(T, seed=q)
    if not len(solutions):
        raise InputError(f"{where} has no posture: {solutions.reason}")
    return solutions.q, solutions.branch.tolist()
