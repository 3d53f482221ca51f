"""Straight lines of the tool in one branch; errors name where and why a line stops."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats, as_floats, check_number, check_poses
from kinreach._rotations import PoseLine, pose
from kinreach.errors import InputError, PathError
from kinreach.kinematics._arm import ArmKinematics, determinant_sign
from kinreach.kinematics._collision import CollisionChecker
from kinreach.kinematics._motion_check import MotionCheck

#: Rotation of the tool between two postures [rad], at most.
TURN_STEP = 0.02
#: A joint that moves farther between two postures [rad] asks for one between them; where halving the way so often does
#: not help, the branch ends in a singularity.
MAX_JUMP, HALVINGS = 0.1, 8


@dataclass(frozen=True)
class _Stop:
    """Where a line stops: its index, the part of it, the last posture, and why."""

    index: int
    fraction: float
    q: Floats
    reason: str


def tool_line(
    kinematics: ArmKinematics,
    start: ArrayLike,
    poses: ArrayLike,
    *,
    checker: CollisionChecker | None = None,
    step: float = 0.005,
    keeps: float = 0.0,
) -> Floats:
    """Return a path on which the tip moves straight from pose to pose, in the branch of the start posture.

    The position moves on a line, and the tip turns at an even rate about one axis.

    Args:
        kinematics: Of an arm with six axes and a closed form.
        start: Posture in which the first line begins [rad], shape (6,).
        poses: Poses of the tip in the base frame, one after the other: shape (4, 4) or (k, 4, 4), or as six numbers,
            (6,) or (k, 6).
        checker: With a margin; the path is then free, as in `joint_line`. Without it nothing is checked for collisions.
        step: Distance of two postures along the line [m]; between them the joints move straight.
        keeps: As for `joint_line`.

    Returns:
        Waypoints [rad], shape (m, 6), close together.

    Raises:
        PathError: The line leaves the reach or the joint limits, passes a singularity, even one where the joints could
            go on smoothly into another branch, or collides: the message and `index`, `fraction` and `q` give the place,
            `branches` and `starts` the other postures at the start that get through.
        InputError: Malformed input, or an arm without a closed form.
    """
    kin = kinematics
    if not (kin.knows_all_postures and kin.n == 6):
        raise InputError(f"lines of the tool need an arm with six axes and a closed form; {kin!r} is another")
    start = kin.as_posture("start", start)
    step = check_number("step", step, above=1e-5, most=1.0)
    motion = None if checker is None else MotionCheck(checker, keeps)
    corners = np.concatenate([kin.fk(start)[None], _as_poses(poses)])
    found = _follow(kin, start, corners, step, motion)
    if not isinstance(found, _Stop):
        return found
    others: Any = kin.all_solutions(corners[0], seed=start)  # type: ignore[attr-defined]
    through = [
        (int(branch), q)
        for branch, q in zip(others.branch, others.q, strict=True)
        if np.abs(q - start).max() > MAX_JUMP and not isinstance(_follow(kin, q, corners, step, motion), _Stop)
    ]
    length = float(np.linalg.norm(corners[found.index + 1][:3, 3] - corners[found.index][:3, 3]))
    names = ", ".join(str(branch) for branch, _ in through)
    raise PathError(
        f"line {found.index} stops after {found.fraction * length:.3f} m of {length:.3f} m, at q = "
        f"{np.round(found.q, 3).tolist()}: {found.reason}. "
        + (f"From the same pose, these branches get through: {names}" if through else "No other branch gets through"),
        index=found.index,
        fraction=found.fraction,
        q=found.q,
        branches=tuple(branch for branch, _ in through),
        starts=np.array([q for _, q in through]).reshape(-1, kin.n),
    )


def _as_poses(poses: ArrayLike) -> Floats:
    given = as_floats("poses", poses)
    if given.shape[-1:] == (6,) and given.ndim in (1, 2):
        given = pose(given)
    if given.shape[-2:] != (4, 4) or given.ndim not in (2, 3) or not len(given):
        raise InputError(f"poses must have shape (k, 4, 4) or (k, 6), got {given.shape}")
    given = given.reshape(-1, 4, 4)
    check_poses("poses", given)
    return given


def _follow(
    kin: ArmKinematics, start: Floats, corners: Floats, step: float, motion: MotionCheck | None
) -> Floats | _Stop:
    path, side = [start], float(determinant_sign(kin.jacobian(start)))
    for index in range(len(corners) - 1):
        line = PoseLine(corners[index], corners[index + 1])
        count = max(1, ceil(line.length / step), ceil(line.angle / TURN_STEP))
        for number in range(1, count + 1):
            known = len(path)
            stop = _extend(kin, path, line, (number - 1) / count, number / count, HALVINGS)
            for q in path[known:]:
                now = float(determinant_sign(kin.jacobian(q)))
                if now * side < 0.0 and stop is None:
                    stop = (
                        (number - 1) / count,
                        path[known - 1],
                        "a singularity, past which it would be in another branch",
                    )
                side = side or now
            if stop is None:
                stop = _blocked(kin, motion, path[-2:], number / count)
            if stop is not None:
                return _Stop(index, *stop)
    return np.array(path)


def _extend(
    kin: ArmKinematics, path: list[Floats], line: PoseLine, before: float, part: float, halvings: int
) -> tuple[float, Floats, str] | None:
    """Append the posture at a part of a line, with postures between where it is far; or return why there is none."""
    solutions: Any = kin.all_solutions(line.at(part), seed=path[-1], limits=False)  # type: ignore[attr-defined]
    if not solutions.success:
        return part, path[-1], f"out of reach: {solutions.reason}"
    jump = np.abs(solutions.q[0] - path[-1])
    if jump.max() <= MAX_JUMP:
        path.append(solutions.q[0])
        return None
    if halvings == 0:
        names = " and ".join(name for name, way in zip(kin.arm.joints, jump, strict=True) if way > MAX_JUMP)
        return before, path[-1], f"a singularity, where {names} would have to jump"
    middle = (before + part) / 2.0
    stop = _extend(kin, path, line, before, middle, halvings - 1)
    return stop if stop is not None else _extend(kin, path, line, middle, part, halvings - 1)


def _blocked(
    kin: ArmKinematics, motion: MotionCheck | None, ends: list[Floats], part: float
) -> tuple[float, Floats, str] | None:
    """Return why the arm cannot reach the last posture from the one before; None if it can."""
    q = ends[-1]
    if outside := kin.joints_outside_limits(q):
        return part, q, f"out of limits: {', '.join(outside)}"
    if motion is None or (fraction := motion.first_collision(ends[0], q)) is None:
        return None
    q = ends[0] + fraction * (q - ends[0])
    return part, q, f"collision: {motion.checker.reason(q)}"
