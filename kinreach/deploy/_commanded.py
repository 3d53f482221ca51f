"""What a program commands the joints of its arm, and whether the arm may do that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinreach._checks import Floats
from kinreach.deploy._motion import BlendedMotion, LineError, Segment, segment_to
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, Trajectory
from kinreach.robots.inside import JOINTS

if TYPE_CHECKING:
    from kinreach.deploy._program import Move

#: Samples of a move that are enough, if it takes more control cycles.
SAMPLES = 1000
#: Part by which a speed may be above its limit: rounding.
ROUNDING = 1e-3


@dataclass(frozen=True, eq=False)
class Commanded:
    """The commands of moves: a sample for each control cycle, in a slow move `SAMPLES` samples.

    Attributes:
        q, qd: Joint angles [rad] and speeds [rad/s], shape (n, 6).
        waypoints: The start posture, and where each move ends without a blend [rad], shape (moves + 1, 6).
        began: Index of the first sample of each move.
        ended: Index of the last sample of each move; where it is blended, the next move has begun before.
    """

    q: Floats
    qd: Floats
    waypoints: Floats
    began: tuple[int, ...]
    ended: tuple[int, ...]


def commanded(flange: ArmKinematics, tcp: Floats, start: Floats, moves: Sequence[Move], cycle: float) -> Commanded:
    """Compute what a controller commands the joints, as the simulated one does.

    Args:
        flange: Kinematics of the flange, in the frame `base`.
        tcp: Pose of the tool centre point on the flange (4, 4).
        start: Posture in which the first move begins [rad], shape (6,).
        moves: In their order; the last stops.
        cycle: Time between two samples [s].

    Raises:
        InputError: A straight line cannot be followed, or blends overlap; the message has the number of the move.
    """
    motion = BlendedMotion(lambda q: (flange.fk(q) @ tcp)[:3, 3], start)
    q, qd, segments = [start], [np.zeros_like(start)], list[Segment]()
    began, ended, running = list[int](), dict[int, int](), list[int]()

    def go_on() -> None:
        cycles = max(1, int(segments[-1].duration / cycle) // SAMPLES)
        state = motion.advance(cycles * cycle)
        q.append(state[0])
        qd.append(state[1])
        for move in [move for move in running if segments[move].done]:
            running.remove(move)
            ended[move] = len(q) - 1

    for number, move in enumerate(moves, start=1):
        try:
            target = np.array(move.target)
            segment = segment_to(flange, tcp, motion.end, move.command, target, move.speed, move.acceleration)
            if overlap := motion.overlap(segment, move.blend):
                raise InputError(f"the blends of move {number} overlap: {overlap}; give a smaller blend")
            motion.add(segment, move.blend)
            segments.append(segment)
            running.append(number - 1)
            began.append(len(q))
            go_on()
            while not motion.may_go_on():
                go_on()
            while number == len(moves) and motion.segments:
                go_on()
        except LineError as error:
            raise InputError(f"move {number}: {error}") from None
    waypoints = np.array([start, *(segment.end for segment in segments)])
    return Commanded(
        np.array(q), np.array(qd), waypoints, tuple(began), tuple(ended[move] for move in range(len(moves)))
    )


def check_moves(kinematics: ArmKinematics, moves: Sequence[Move], motion: Commanded) -> None:
    """Refuse moves in which a joint is faster than it can be, or leaves its limits.

    A `movej` may also not be given a higher speed than its joints have, where the way is too short to reach it.

    Args:
        kinematics: Of the arm.
        moves: In their order.
        motion: What they command.

    Raises:
        InputError: A move does; the message names it and the joint.
    """
    ends = (*motion.began[1:], len(motion.q))
    for number, (move, began, end) in enumerate(zip(moves, motion.began, ends, strict=True), start=1):
        fastest = np.abs(motion.qd[began:end]).max(axis=0)
        if move.command == "movej":
            way = np.abs(motion.waypoints[number] - motion.waypoints[number - 1])
            fastest = np.maximum(fastest, move.speed * way / max(way.max(), 1e-12))
        _refuse_fast(kinematics, fastest, f"move {number}")
        _refuse_outside(kinematics, motion.q[began:end], f"move {number}")


def check_trajectory(kinematics: ArmKinematics, trajectory: Trajectory) -> None:
    """Refuse a trajectory with an even rate in which a joint is faster than it can be, or leaves its limits."""
    _refuse_fast(kinematics, np.abs(np.diff(trajectory.q, axis=0)).max(axis=0) / trajectory.t[1], "the trajectory")
    _refuse_outside(kinematics, trajectory.q, "the trajectory")


def _refuse_fast(kinematics: ArmKinematics, fastest: Floats, what: str) -> None:
    for joint, speed, most in zip(JOINTS, fastest, kinematics.velocity_limit, strict=True):
        if speed > (1.0 + ROUNDING) * most:
            raise InputError(
                f"{what} moves {joint} at {speed:.3g} rad/s, above its limit of {most:.3g} rad/s; give a lower speed"
            )


def _refuse_outside(kinematics: ArmKinematics, q: Floats, what: str) -> None:
    for joint in np.flatnonzero(kinematics.past_limits(q).any(axis=0)):
        low, high = kinematics.lower[joint], kinematics.upper[joint]
        farthest = q[np.maximum(low - q[:, joint], q[:, joint] - high).argmax(), joint]
        raise InputError(
            f"{what} turns {JOINTS[joint]} to {farthest:.3f} rad, outside its limits of {low:.3f} to {high:.3f} rad"
        )
