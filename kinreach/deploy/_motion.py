"""Motions of the simulated controller: segments in joint space and on straight lines, blended, and the `servoj` filter.

A segment runs on a trapezoid from rest to rest. Two segments are blended by starting the second while the first still
has the blend radius to go: their motions add up. With equal speeds and accelerations the tool leaves the first line and
joins the second one at the same distance from the waypoint, the blend radius.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import PoseLine
from kinreach.kinematics import ArmKinematics, pose
from kinreach.sim.inside import TrapezoidalProfile

#: Step in which a straight line is checked before it begins [m, rad].
STEP = 0.005
#: Newton's method: largest number of iterations, residual at which it ends [m, rad], and longest step [rad].
ITERATIONS, RESIDUAL, MAX_STEP = 12, 1e-9, 0.3
#: Metres that a turn by one radian counts as, in the length of a straight line.
METRES_PER_RADIAN = 1.0


#: A Jacobian's determinant that is nearer to 0 has no sign [m^3].
NO_SIGN = 1e-7


class LineError(Exception):
    """A straight line cannot be followed; the message gives the place and the reason."""


class Segment:
    """A motion from one posture at rest to another, with a trapezoidal speed profile.

    Attributes:
        start, end: Postures [rad], shape (n,).
        q, qd: Posture [rad] and speeds [rad/s] now, shape (n,).
    """

    def __init__(self, start: Floats, end: Floats, length: float, speed: float, acceleration: float) -> None:
        self.start, self.end = start, end
        self.q, self.qd = start, np.zeros_like(start)
        self.length, self.time = length, 0.0
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

    def __init__(self, start: Floats, end: Floats, speed: float, acceleration: float) -> None:
        length = float(np.abs(end - start).max())
        super().__init__(start, end, length, speed, acceleration)
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

    Raises:
        LineError: The line leaves the reach, or passes a singularity: beyond it the arm is in another branch.
    """

    def __init__(
        self, kinematics: ArmKinematics, tcp: Floats, start: Floats, target: Floats, speed: float, acceleration: float
    ) -> None:
        self._kin, self._tcp, self._from_tcp = kinematics, tcp, np.linalg.inv(tcp)
        self._T = kinematics.fk(start) @ tcp
        self._line = line = PoseLine(self._T, target)
        length = max(line.length, METRES_PER_RADIAN * line.angle)
        super().__init__(start, start, length, speed, acceleration)
        self.end = self._followed()
        self._covered, self._slope = 0.0, np.zeros_like(start)  # where it is, and how the joints go on there

    def _followed(self) -> Floats:
        """Compute the posture at the end of the line, by small steps along it."""
        q, steps, side = self.start, max(1, int(np.ceil(self.length / STEP))), 0.0
        for step in range(steps + 1):
            q = self._solved(step / steps, q) if step else q
            determinant = float(np.linalg.det(self._kin.jacobian(q)))
            if determinant * side < 0.0 and abs(determinant) > NO_SIGN:
                raise LineError(f"the straight line passes a singularity before {100 * step / steps:.0f} % of the way")
            side = side or (determinant if abs(determinant) > NO_SIGN else 0.0)
        return q

    def _solved(self, share: float, q: Floats) -> Floats:
        """Compute the posture at a share of the line near another one, by Newton's method."""
        T = self._line.at(share) @ self._from_tcp
        begin = q
        for _ in range(ITERATIONS):
            now = self._kin.fk(q)
            R = T[:3, :3] @ now[:3, :3].T
            error = np.concatenate([T[:3, 3] - now[:3, 3], 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0],
                                                                          R[1, 0] - R[0, 1]])])  # fmt: skip
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
        return np.concatenate([line.way / self.length + np.cross(spin, arm), spin])


def segment_to(
    kinematics: ArmKinematics,
    tcp: Floats,
    start: Floats,
    command: str,
    target: Floats,
    speed: float,
    acceleration: float,
) -> Segment:
    """Return the segment of `movej` to joint angles, or of `movel` to a pose; arguments are those of `StraightLine`."""
    if command == "movej":
        return JointLine(start, target, speed, acceleration)
    return StraightLine(kinematics, tcp, start, pose(target), speed, acceleration)


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
