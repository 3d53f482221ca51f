"""Motions of the simulated controller: segments in joint space and on straight lines, blended, and the `servoj` filter.

A segment runs on a trapezoid from rest to rest. Two segments are blended by starting the second while the first still
has the blend radius to go: their motions add up. With equal speeds and accelerations the tool leaves the first line and
joins the second one at the same distance from the waypoint, the blend radius.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import PoseLine, small_motion, turn
from kinreach.kinematics import ArmKinematics, pose
from kinreach.kinematics.inside import determinant_sign
from kinreach.sim.inside import TrapezoidalProfile

#: Step in which a straight line is checked before it begins [m, rad].
STEP = 0.005
#: Newton's method: largest number of iterations, residual at which it ends [m, rad], and longest step [rad].
ITERATIONS, RESIDUAL, MAX_STEP = 12, 1e-9, 0.3
#: Metres that a turn by one radian counts as, in the length of a straight line.
METRES_PER_RADIAN = 1.0
#: Where the Jacobian's determinant is less, the tool cannot keep its speed [m^3].
SINGULAR = 1e-7


class LineError(Exception):
    """A straight line cannot be followed; the message gives the place and the reason."""


def rates_for(seconds: float, length: float, acceleration: float) -> tuple[float, float]:
    """Return speed and acceleration of a trapezoid that takes a time [s]; the acceleration is raised if it must be."""
    if acceleration * seconds**2 <= 4.0 * length or not length:
        return max(2.0 * length / seconds, 1e-9), max(4.0 * length / seconds**2, 1e-9)
    root = math.sqrt(acceleration**2 * seconds**2 - 4.0 * acceleration * length)
    return 2.0 * length / (seconds + root / acceleration), acceleration


class Segment:
    """A motion from one posture at rest to another, with a trapezoidal speed profile; `seconds` instead of a speed.

    Attributes:
        start, end: Postures [rad], shape (n,).
        q, qd: Posture [rad] and speeds [rad/s] now, shape (n,).
    """

    def __init__(
        self, start: Floats, end: Floats, length: float, speed: float, acceleration: float, seconds: float = 0.0
    ) -> None:
        self.start, self.end = start, end
        self.q, self.qd = start, np.zeros_like(start)
        self.length, self.time = length, 0.0
        if seconds:
            speed, acceleration = rates_for(seconds, length, acceleration)
        self._profile = TrapezoidalProfile(np.array([length]), speed, acceleration)
        self.duration = float(self._profile.duration[0])
        self.done = self.duration == 0.0

    def advance(self, dt: float) -> None:
        self.time += dt
        if self.time >= self.duration:
            self.q, self.qd, self.done = self.end, np.zeros_like(self.end), True
            return
        covered, rate = self._profile.sample(np.array([self.time]))
        self._place(float(covered[0, 0]), float(rate[0, 0]))

    def _place(self, covered: float, rate: float) -> None:
        raise NotImplementedError


class JointLine(Segment):
    """`movej`: a straight line in joint space; speed and acceleration are those of the joint with the longest way."""

    def __init__(self, start: Floats, end: Floats, speed: float, acceleration: float, seconds: float = 0.0) -> None:
        length = float(np.abs(end - start).max())
        super().__init__(start, end, length, speed, acceleration, seconds)
        self._direction = (end - start) / length if length else np.zeros_like(start)

    def _place(self, covered: float, rate: float) -> None:
        self.q, self.qd = self.start + covered * self._direction, rate * self._direction


class StraightLine(Segment):
    """`movel`: the tool centre point on a straight line, turning about one axis.

    Args:
        kinematics: Of the flange, in the frame of the poses.
        tcp: Pose of the tool centre point on the flange (4, 4).
        start: Posture [rad], shape (n,).
        target: Pose of the tool centre point at the end (4, 4).
        speed: Of the tool [m/s]; a turn by 1 rad counts as 1 m.
        acceleration: Of the tool [m/s^2].
        seconds: That it takes, instead of a speed; 0 for the speed.

    Raises:
        LineError: The line leaves the reach, or passes a singularity: beyond it the arm is in another branch.
    """

    def __init__(
        self,
        kinematics: ArmKinematics,
        tcp: Floats,
        start: Floats,
        target: Floats,
        speed: float,
        acceleration: float,
        seconds: float = 0.0,
    ) -> None:
        self._kin, self._tcp, self._from_tcp = kinematics, tcp, np.linalg.inv(tcp)
        self._T = kinematics.fk(start) @ tcp
        self._line = line = self._line_to(target)
        length = max(line.length, METRES_PER_RADIAN * line.angle)
        super().__init__(start, start, length, speed, acceleration, seconds)
        self.end = self._followed()
        self._covered, self._slope = 0.0, np.zeros_like(start)  # where it is, and how the joints go on there

    def _line_to(self, target: Floats) -> PoseLine:
        return PoseLine(self._T, target)

    def _followed(self) -> Floats:
        """Compute the posture at the end of the line, by small steps along it."""
        q, steps, side = self.start, max(1, int(np.ceil(self.length / STEP))), 0.0
        for step in range(steps + 1):
            q = self._solved(step / steps, q) if step else q
            now = float(determinant_sign(self._kin.jacobian(q)))
            if now * side < 0.0:
                raise LineError(f"the straight line passes a singularity before {100 * step / steps:.0f} % of the way")
            side = side or now
        return q

    def _solved(self, share: float, q: Floats) -> Floats:
        """Compute the posture at a share of the line near another one.

        Newton's method has no damping and no second start: a line that needs either is refused.
        """
        T = self._line.at(share) @ self._from_tcp
        begin = q
        for _ in range(ITERATIONS):
            now = self._kin.fk(q)
            error = small_motion(T, now)
            if np.abs(error).max() < RESIDUAL:
                return q
            try:
                step = np.linalg.solve(self._kin.jacobian(q), error)
            except np.linalg.LinAlgError:
                break
            q = q + step
            if not np.abs(q - begin).max() < MAX_STEP:
                break
        raise LineError(f"the straight line leaves the reach or passes a singularity at {100 * share:.0f} % of the way")

    def _place(self, covered: float, rate: float) -> None:
        self.q = self._solved(covered / self.length, self.q + (covered - self._covered) * self._slope)
        self._slope = np.asarray(np.linalg.solve(self._kin.jacobian(self.q), self._twist()), dtype=np.float64)
        self._covered, self.qd = covered, rate * self._slope

    def _twist(self) -> Floats:
        """Compute how the flange moves and turns for each metre of the line [m/m, rad/m], shape (6,)."""
        line = self._line
        spin = self._T[:3, :3] @ line.axis * (line.angle / self.length)
        flange = self._kin.fk(self.q)
        arm = flange[:3, 3] - (flange @ self._tcp)[:3, 3]
        return np.concatenate([self._way(flange) / self.length + np.cross(spin, arm), spin])

    def _way(self, flange: Floats) -> Floats:
        """Return how the tool centre point moves [m], for the whole line at the rate of this place, shape (3,)."""
        return self._line.way


class PoseArc(PoseLine):
    """The poses on an arc through a point: the position on a circle, the rotation at an even rate.

    Args:
        start, end: Homogeneous transforms, shape (4, 4).
        via: A point between them [m], shape (3,).
        is_fixed: Whether the rotation keeps its angle with the circle, in place of the end's rotation.

    Raises:
        LineError: The three points are on a line.
    """

    def __init__(self, start: Floats, via: Floats, end: Floats, *, is_fixed: bool) -> None:
        a, b = via - start[:3, 3], end[:3, 3] - start[:3, 3]
        normal = np.cross(a, b)
        square = float(normal @ normal)
        if not square > 1e-10 * float(a @ a) * float(b @ b):
            raise LineError("movec needs three points that are not on a line")
        aside = np.cross(normal, a) * float(b @ b) - np.cross(normal, b) * float(a @ a)
        self.centre: Floats = np.asarray(start[:3, 3] + aside / (2.0 * square), dtype=np.float64)
        self.normal: Floats = np.asarray(normal / math.sqrt(square), dtype=np.float64)
        self._radius: Floats = np.asarray(start[:3, 3] - self.centre, dtype=np.float64)
        last = end[:3, 3] - self.centre
        side = float(self.normal @ np.cross(self._radius, last))
        self.turned = math.atan2(side, float(self._radius @ last)) % (2.0 * math.pi)
        final: Floats = end.copy()
        if is_fixed:
            final[:3, :3] = turn(self.normal, self.turned) @ start[:3, :3]
        super().__init__(start, final)
        if is_fixed:
            self.axis, self.angle = np.asarray(start[:3, :3].T @ self.normal, dtype=np.float64), self.turned
        self.length = self.turned * float(np.linalg.norm(self._radius))

    def at(self, part: float) -> Floats:
        T = super().at(part)
        T[:3, 3] = self.centre + turn(self.normal, part * self.turned) @ self._radius
        return T


class Arc(StraightLine):
    """`movec`: the tool centre point on an arc; `via` and `is_fixed` as in `PoseArc`, the others as `StraightLine`."""

    def __init__(self, *line: Any, via: Floats, is_fixed: bool) -> None:
        self._via, self._is_fixed = via, is_fixed
        super().__init__(*line)

    def _line_to(self, target: Floats) -> PoseLine:
        return PoseArc(self._T, self._via, target, is_fixed=self._is_fixed)

    def _way(self, flange: Floats) -> Floats:
        arc: Any = self._line
        return arc.turned * np.cross(arc.normal, (flange @ self._tcp)[:3, 3] - arc.centre)


def segment_to(
    kinematics: ArmKinematics,
    tcp: Floats,
    start: Floats,
    command: str,
    target: Floats,
    speed: float,
    acceleration: float,
    seconds: float = 0.0,
) -> Segment:
    """Return the segment of `movej` to joint angles, or of `movel` to a pose; arguments are those of `StraightLine`."""
    if command == "movej":
        return JointLine(start, target, speed, acceleration, seconds)
    return StraightLine(kinematics, tcp, start, pose(target), speed, acceleration, seconds)


class BlendedMotion:
    """Segments one after the other; the next may begin where the one before is within its blend radius of its end.

    Args:
        tool: Position of the tool centre point in a posture [m], shape (3,).
        q: Posture in which the arm rests [rad], shape (n,).

    Attributes:
        segments: Those that run.
        end: Where the last one ends [rad], shape (n,).
        radius: Blend radius there [m].
    """

    def __init__(self, tool: Callable[[Floats], Floats], q: Floats) -> None:
        self._tool = tool
        self.segments: list[Segment] = []
        self.end, self.radius = q, 0.0

    def overlap(self, segment: Segment, radius: float) -> str:
        """Describe how the blends at both ends of a segment overlap; empty if they do not."""
        way = float(np.linalg.norm(self._tool(segment.end) - self._tool(self.end)))
        if 0.0 < self.radius + radius >= way:
            return f"radii of {self.radius:g} and {radius:g} m on a way of {way:.3f} m"
        return ""

    def add(self, segment: Segment, radius: float) -> None:
        """Begin a segment that starts where the last one ends."""
        self.segments.append(segment)
        self.end, self.radius = segment.end, radius

    def may_go_on(self) -> bool:
        """Return whether the next segment may begin."""
        if not self.segments or self.segments[-1].done:
            return True
        to_go = self._tool(self.segments[-1].q) - self._tool(self.end)
        return self.radius > 0.0 and bool(np.linalg.norm(to_go) <= self.radius)

    def advance(self, dt: float) -> tuple[Floats, Floats]:
        """Go on by a time [s]; return angles [rad] and speeds [rad/s], shapes (n,).

        Raises:
            LineError: A straight line cannot be followed.
        """
        for segment in self.segments:
            segment.advance(dt)
        while self.segments[0].done and len(self.segments) > 1:
            self.segments.pop(0)
        first, *others = self.segments
        q = first.q + sum(other.q - other.start for other in others)
        qd = first.qd + sum(other.qd for other in others)
        if first.done:
            self.segments = []
        return q, qd


class Servo:
    """`servoj`: follows a posture that changes every cycle, late by the lookahead time.

    Universal Robots does not publish its filter. In this model the speed approaches the distance over the lookahead
    time, with the gain as the rate [1/s]. With the settings of the ROS driver, 0.03 s and 2000, its users report a lag
    of 0.034 s on a real arm.
    """

    def __init__(self, q: Floats, qd: Floats) -> None:
        self.q, self.qd = q, qd

    def follow(self, target: Floats, lookahead: float, gain: float, dt: float) -> None:
        """Go on by `dt` [s] with a target posture [rad], by the implicit Euler method."""
        speed = self.qd + dt * gain * (target - self.q) / lookahead
        self.qd = speed / (1.0 + dt * gain + dt**2 * gain / lookahead)
        self.q = self.q + dt * self.qd


class JointSpeed:
    """`speedj`: joint speeds that are approached with an acceleration [rad/s], [rad/s^2]."""

    def __init__(self, wanted: Floats, acceleration: float) -> None:
        self._wanted, self._acceleration = wanted, acceleration

    def next(self, q: Floats, qd: Floats, dt: float) -> Floats:
        """Return the speeds of the next control cycle [rad/s], shape (n,)."""
        change = self._wanted - qd
        most = float(np.abs(change).max())
        return self._wanted if most <= self._acceleration * dt else qd + change * (self._acceleration * dt / most)


class ToolSpeed:
    """`speedl` and `stopl`: a speed of the tool centre point that is approached with an acceleration.

    Args:
        kinematics: Of the flange, in the frame of the speeds.
        tcp: Pose of the tool centre point on the flange (4, 4).
        begin, wanted: Speeds of the tool [m/s, rad/s], shape (6,).
        acceleration: Of the tool [m/s^2], and of its turns [rad/s^2].
    """

    def __init__(
        self, kinematics: ArmKinematics, tcp: Floats, begin: Floats, wanted: Floats, acceleration: tuple[float, float]
    ) -> None:
        self._kin, self._tcp, self._now, self._wanted, self._acceleration = kinematics, tcp, begin, wanted, acceleration

    def next(self, q: Floats, qd: Floats, dt: float) -> Floats:
        """Return the speeds of the joints in the next control cycle [rad/s], shape (n,).

        Raises:
            LineError: The arm is at a singularity.
        """
        shares = []
        for part, most in zip((slice(3), slice(3, 6)), self._acceleration, strict=True):
            change = float(np.linalg.norm(self._wanted[part] - self._now[part]))
            shares.append(1.0 if change <= most * dt else most * dt / change)
        share = np.repeat(shares, 3)
        self._now = np.where(share == 1.0, self._wanted, self._now + share * (self._wanted - self._now))
        middle = q + 0.5 * dt * qd
        flange = self._kin.fk(middle)
        arm = flange[:3, 3] - (flange @ self._tcp)[:3, 3]
        twist = np.concatenate([self._now[:3] + np.cross(self._now[3:], arm), self._now[3:]])
        jacobian = self._kin.jacobian(middle)
        if not twist.any():
            return np.zeros_like(q)
        if abs(float(np.linalg.det(jacobian))) < SINGULAR:
            raise LineError("the tool cannot keep its speed at a singularity")
        return np.asarray(np.linalg.solve(jacobian, twist), dtype=np.float64)
