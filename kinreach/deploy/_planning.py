"""Planning of a program's moves from its goals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinreach._checks import Floats
from kinreach.deploy._program import MAX_TOOL_SPEED, Move
from kinreach.errors import InputError, PathError
from kinreach.kinematics import CollisionChecker, plan_path, pose_vector, tool_line
from kinreach.kinematics._angles import wrapped
from kinreach.kinematics._closed_form import ClosedFormKinematics
from kinreach.kinematics._remarks import why_none

#: Default part of the joints' speed limits, and of `MAX_TOOL_SPEED`.
SPEED = 0.25
#: Accelerations of the joints [rad/s^2] and of the tool [m/s^2]: the defaults of URScript.
JOINT_ACCELERATION, TOOL_ACCELERATION = 1.4, 1.2
#: Longest search for a way [s].
TIMEOUT = 5.0
#: Part of the shorter way beside a waypoint that its blend may take.
LESS_THAN_HALF = 0.45
#: Decimals of the joint angles in a program [rad], and of poses [m, rad].
ROUNDED, ROUNDED_POSE = 7, 9


@dataclass(frozen=True, eq=False)
class Leg:
    """The way to one goal.

    Attributes:
        end: Posture at the goal [rad], shape (6,).
        branch: Of that posture; -1 if it is none of the closed form's.
        free, postures: Postures of the goal that keep the margin, and all.
    """

    moves: tuple[Move, ...]
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
    rounded: bool = False,
) -> list[Leg]:
    """Plan the way from a posture through goals.

    Args:
        kinematics: Of the UR with its tool, in the frame `base`.
        checker: Of collisions, with a margin.
        start: Posture [rad], shape (6,).
        goals: Poses of the tool centre point (4, 4).
        linear: Straight lines of the tool; else straight lines in joint space, around obstacles where that is needed.
        speed: Part of the largest speeds, above 0 and at most 1.
        blend: Radius at all goals but the last [m].
        rounded: Blend also where a way around obstacles turns, with that radius or a smaller one. That way is not
            checked.

    Raises:
        InputError: A goal has no posture.
        PathError: The start is not free, or no free way to a goal was found; the message names what is in the way.
    """
    legs: list[Leg] = []
    q = start
    for number, T in enumerate(goals, start=1):
        radius = blend if number < len(goals) else 0.0
        name = f"goal {number}" if len(goals) > 1 else "the goal"
        solutions = kinematics.all_solutions(T, seed=q)
        if not len(solutions):
            raise InputError(f"{name} has no posture: {why_none(kinematics, T, solutions.reason)}")
        try:
            if linear:
                target, fastest = tuple(pose_vector(T).round(ROUNDED_POSE)), speed * MAX_TOOL_SPEED
                end = tool_line(kinematics, q, T, checker=checker)[-1]
                moves: tuple[Move, ...] = (Move("movel", target, fastest, TOOL_ACCELERATION, radius),)
            else:
                path = plan_path(checker, q, solutions, timeout=TIMEOUT)
                between = _radii(kinematics, path, blend) if rounded else [0.0] * (len(path) - 2)
                moves = _joint(path, speed * kinematics.velocity_limit, [*between, radius])
                end = path[-1]
        except PathError as error:
            raise PathError(f"{name}: {error}") from None
        off = np.abs(wrapped(solutions.q - end)).max(axis=1)  # a full turn is no difference
        branch = int(solutions.branch[off.argmin()]) if off.min() < 1e-4 else -1
        free = sum(not checker.in_collision(posture) for posture in solutions.q)
        legs.append(Leg(moves, end, branch, free, len(solutions)))
        q = end
    return legs


def _joint(path: Floats, speeds: Floats, radii: Sequence[float]) -> tuple[Move, ...]:
    """Move along a path, each joint at most at its speed [rad/s]; a move has the speed of the joint that turns most."""
    points = path.round(ROUNDED)
    ways = np.abs(np.diff(points, axis=0))
    rows = [row for row in zip(points[1:], radii, ways, strict=True) if row[2].any()] or [(points[-1], 0.0, ways[-1])]
    return tuple(
        Move("movej", tuple(point), _leading_speed(way, speeds), JOINT_ACCELERATION, radius)
        for point, radius, way in rows
    )


def _leading_speed(way: Floats, speeds: Floats) -> float:
    """Return the largest speed of the joint that turns most with which none exceeds its own [rad/s]."""
    if not way.any():
        return float(speeds.min())
    return float((speeds[way > 0.0] * way.max() / way[way > 0.0]).min())


def _radii(kinematics: ClosedFormKinematics, path: Floats, most: float) -> list[float]:
    """Compute the radius at each inner waypoint [m]: less than half of the shorter way beside it, at most `most`."""
    ways = np.linalg.norm(np.diff(kinematics.positions(path), axis=0), axis=1)
    return np.minimum(most, LESS_THAN_HALF * np.minimum(ways[:-1], ways[1:])).round(ROUNDED).tolist()
