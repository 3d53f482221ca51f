"""Planning of a program's moves from its goals."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import joints_apart
from kinreach.deploy._commanded import Commanded
from kinreach.deploy._program import AT_START, MAX_TOOL_SPEED, MIN_AT_START, Move, Program, motion_of
from kinreach.deploy._remarks import why_none
from kinreach.errors import InputError, PathError
from kinreach.kinematics import ClosedFormKinematics, CollisionChecker, joint_line, plan_path, pose_vector, tool_line
from kinreach.kinematics.inside import SAME, IKSolutions, branch_of, postures_of, travel, travels

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
#: Smallest blend radius: a smaller one is a stop [m]. Part of a radius that is left where it is reduced.
MIN_BLEND, REDUCED = 1e-3, 0.7


@dataclass(frozen=True, eq=False)
class Leg:
    """The way to one goal.

    Attributes:
        end: Posture at the goal [rad], shape (6,).
        branch: Of that posture; -1 if it is none of the closed form's.
        before: Branch in which the way begins; -1 if that is singular.
        travels: Way of each joint [rad], shape (6,).
        free, postures: Postures of the goal that keep the margin, and all.
        reduced: The largest blend radius that was reduced, as it was planned [m]; 0 if none was.
    """

    moves: tuple[Move, ...]
    end: Floats
    branch: int
    before: int
    travels: Floats
    free: int
    postures: int
    reduced: float = 0.0


def planned_program(
    kinematics: ClosedFormKinematics,
    checker: CollisionChecker,
    start: Floats,
    goals: Sequence[Floats],
    *,
    keeps: float,
    linear: bool = False,
    speed: float = SPEED,
    blend: float = 0.0,
    branch: int | str | None = None,
    max_travel: float | None = None,
) -> tuple[list[Leg], Program]:
    """Plan a way through goals that keeps a distance from everything, and its program.

    Where a rounded corner, as it is commanded, comes nearer, its blend radius is reduced until it does not. The program
    begins only so near the start posture that any posture in which it begins keeps the distance, too.

    Args:
        kinematics: As for `plan`.
        checker: As for `plan`.
        start: As for `plan`.
        goals: As for `plan`.
        keeps: Distance [m], 0.2 mm or more below the checker's margin.
        linear: As for `plan`.
        speed: As for `plan`.
        blend: As for `plan`; turns around obstacles are rounded, too.
        branch: As for `plan`.
        max_travel: As for `plan`.

    Raises:
        InputError: A goal has no posture, a joint would be too fast, or blends overlap.
        PathError: No such way was found, or the start is too near to something.
    """

    def planned(*, rounded: bool) -> tuple[list[Leg], Program]:
        legs = plan(
            kinematics, checker, start, goals,
            keeps=keeps, linear=linear, speed=speed, blend=blend, rounded=rounded, branch=branch, max_travel=max_travel,
        )  # fmt: skip
        program = Program.of(
            kinematics, start, [move for leg in legs for move in leg.moves], tolerance=_tolerance(checker, start, keeps)
        )
        program = _kept(program, kinematics, checker, keeps)
        moves = iter(program.moves)
        kept = [tuple(next(moves) for _ in leg.moves) for leg in legs]
        return [_with_moves(leg, moves) for leg, moves in zip(legs, kept, strict=True)], program

    if blend and not linear:
        with suppress(InputError, PathError):
            return planned(rounded=True)
    return planned(rounded=False)


def _tolerance(checker: CollisionChecker, start: Floats, keeps: float) -> float:
    """Return how far each joint may be from the start posture with a distance from everything left [rad]."""
    nearest, reach = checker.distance(start), float(checker.reach.sum())
    room = (nearest.distance - keeps) / reach
    if room < MIN_AT_START:
        raise PathError(
            f"the start is too near: {' - '.join(nearest.pair)} are {1e3 * nearest.distance:.2f} mm apart; with "
            f"{1e3 * (keeps + MIN_AT_START * reach):.2f} mm a program can check that the arm is there",
            q=start,
        )
    return min(AT_START, float(np.floor(1e6 * room) / 1e6))


def _kept(program: Program, kinematics: ClosedFormKinematics, checker: CollisionChecker, keeps: float) -> Program:
    """Reduce the blend radii where the commanded motion comes nearer than a distance to something."""
    while True:
        motion = motion_of(program, kinematics.arm)
        try:
            joint_line(checker, motion.q, keeps=keeps)
        except PathError as error:
            corner = _corner(program.moves, motion, error.index)
            if corner is None:
                return program  # the dry run says what is the matter
            moves = list(program.moves)
            radius = round(REDUCED * moves[corner].blend, ROUNDED)
            moves[corner] = replace(moves[corner], blend=radius if radius >= MIN_BLEND else 0.0)
            program = replace(program, moves=tuple(moves))
        else:
            return program


def _corner(moves: Sequence[Move], motion: Commanded, index: int) -> int | None:
    """Return the last move that is blended with the next one at a sample; None if there is none."""
    blended = [
        number
        for number, move in enumerate(moves[:-1])
        if move.blend and motion.began[number + 1] - 1 <= index <= motion.ended[number]
    ]
    return blended[-1] if blended else None


def _with_moves(leg: Leg, moves: tuple[Move, ...]) -> Leg:
    reduced = [before.blend for before, after in zip(leg.moves, moves, strict=True) if after.blend < before.blend]
    return replace(leg, moves=moves, reduced=max(reduced, default=0.0))


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
    keeps: float = 0.0,
    branch: int | str | None = None,
    max_travel: float | None = None,
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
        rounded: Blend also where a way around obstacles turns, with that radius or a smaller one. Blended ways are not
            checked.
        keeps: Distance from everything that the way keeps between its samples, too [m], as for `joint_line`.
        branch: In which every goal is reached, as for `plan_path`; "same" is that of the start.
        max_travel: Largest way of a joint to a goal [rad].

    Raises:
        InputError: A goal has no posture, or none of the branch.
        PathError: The start is not free, or no free way to a goal was found; the message names what is in the way.
    """
    legs: list[Leg] = []
    q, before = start, _branch(kinematics, start)
    if branch == SAME:
        branch = branch_of(kinematics, start)
    for number, T in enumerate(goals, start=1):
        radius = blend if number < len(goals) else 0.0
        name = f"goal {number}" if len(goals) > 1 else "the goal"
        solutions = kinematics.all_solutions(T, seed=q)
        if not len(solutions):
            raise InputError(f"{name} has no posture: {why_none(kinematics, T, solutions.reason)}")
        try:
            if linear:
                target, fastest = tuple(pose_vector(T).round(ROUNDED_POSE)), speed * MAX_TOOL_SPEED
                path = tool_line(kinematics, q, T, checker=checker, keeps=keeps)
                _check_line(kinematics, solutions, path, branch, max_travel)
                moves: tuple[Move, ...] = (Move("movel", target, fastest, TOOL_ACCELERATION, radius),)
            else:
                path = plan_path(
                    checker, q, solutions, branch=branch, max_travel=max_travel, timeout=TIMEOUT, keeps=keeps
                )
                between = _radii(kinematics, path, blend) if rounded else [0.0] * (len(path) - 2)
                moves = _joint(path, speed * kinematics.velocity_limit, [*between, radius])
        except PathError as error:
            raise PathError(f"{name}: {error}") from None
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
        q = path[-1]
        off = joints_apart(solutions.q, q)  # a full turn is no difference
        ends = int(solutions.branch[off.argmin()]) if off.min() < 1e-4 else -1
        free = sum(not checker.in_collision(posture) for posture in solutions.q)
        legs.append(Leg(moves, q, ends, before, travels(path), free, len(solutions)))
        before = ends
    return legs


def _branch(kinematics: ClosedFormKinematics, q: Floats) -> int:
    with suppress(InputError):
        return branch_of(kinematics, q)
    return -1


def _check_line(
    kinematics: ClosedFormKinematics,
    solutions: IKSolutions,
    path: Floats,
    branch: int | str | None,
    most: float | None,
) -> None:
    """Refuse a straight line of the tool, which has no choice, that ends in another branch or turns a joint too far."""
    if branch is not None:
        allowed = postures_of(kinematics, solutions, branch, path[0])
        if joints_apart(allowed, path[-1]).min() > 1e-4:
            raise PathError(f"the straight line of the tool ends in another branch than {branch}", q=path[-1])
    if most is not None and (turned := travel(path)) > most:
        raise PathError(
            f"a joint would turn by {turned:.3g} rad ({np.degrees(turned):.0f}°) along the straight line of the tool, "
            f"above {most:.4g} rad"
        )


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
