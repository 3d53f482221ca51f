"""Closed forms of six-axis arms by the geometry of their axes, as pure functions on floats.

With the parameters of `DenavitHartenberg`, and R and P the pose of the last frame as seen from the first, two kinds of
arms decouple:

* a spherical wrist (axes 4, 5 and 6 meet): P depends on the first three angles only (Pieper, The kinematics of
  manipulators under computer control, Stanford 1968);
* axes 2, 3 and 4 parallel: they move the wrist in a plane, so that the height of P above it and the direction of axis 6
  depend on the angles of joints 1 and 5 only.

Three equations are solved again and again (the subproblems of Paden and Kahan; Elias and Wen, IK-Geo: unified robot
inverse kinematics using subproblem decomposition, Mechanism and Machine Theory 209, 2025):

* shoulder: where axes 2 and 3 are parallel, P has a given height above their plane, which is linear in the cosine and
  sine of the first angle;
* wrist: a rotation as three turns, of which the middle one is given by one entry;
* elbow: two links in a plane, by the law of cosines.

Where a spherical wrist comes without parallel axes 2 and 3, or axes 5 and 6 do not meet behind parallel ones, two
unknown angles are left in two equations; they are one quadratic equation in the cosine and sine of one angle, with up
to four roots.

Branch index: 4 for the second shoulder, 2 for a negative wrist angle, 1 for a negative elbow angle, added; where roots
of the quadratic equation take the place of two of them, their number counts. What is singular is solved: arguments that
leave their domain by rounding are clamped, and an angle that is free takes the caller's value.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import acos, atan2, copysign, cos, hypot, pi, sin, sqrt

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics._angles import wrap
from kinreach.kinematics._general_6r import COEFFICIENTS, SAMPLES
from kinreach.kinematics._six_axis.dh import DenavitHartenberg
from kinreach.kinematics._solutions import Row
from kinreach.kinematics._ur.closed_form import (
    ELBOW,
    MERGED,
    MOVED,
    NEAR_WRIST,
    SHOULDER,
    WRIST,
    pitches,
)

#: Cosines and lengths below this are 0 [m].
ZERO = 1e-12
#: Roots of the quadratic equation are polished in as many steps, and are apart by more than this [rad].
POLISH, APART = 4, 1e-6
#: By how much parts of the geometry may be missed where the pose is singular [m, rad]: where two are singular at once,
#: rounding grows to this. By up to the second a posture may miss anywhere for the pose to be looked at more closely.
AMISS, CLOSE = 1e-4, 1e-5
#: How many angles of a free joint are tried; and shares of a turn by which one is after the other, of each such joint.
TURNS, SHARES = 36, np.sqrt([5.0, 2.0, 3.0, 7.0, 11.0, 13.0]) % 1.0
#: Sine between axes that are nearly parallel, and tangents of turns of the hand that are tried then.
NEARLY_PARALLEL, TANGENTS = 0.3, np.tan(np.linspace(-1.4, 1.4, 9)).tolist()
#: By how much an elbow may be missed at such an angle, to be reached at one near it [m, rad].
FAR_MISS = 0.03
#: How far a complex root may be off the unit circle to count.
OFF_CIRCLE = 1e-3

#: Rows of a quartic's companion matrix below the first.
_BELOW = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))
_Rows = Sequence[Sequence[float]]
#: P in the plane (u, v) [m], distance of P from axis 4 [m] and its angle there, and the wanted angle of the last joint.
_Palm = tuple[float, float, float, float, float]
#: Three angles that put P in its place, with branch index and flags.
_Position = tuple[int, int, float, float, float]


class Doubt:
    """Whether another arm, whose poses are a little off, may have other postures for a pose.

    Attributes:
        found: Whether it may.
        off: How far they are off [m, rad].
        free: Joints (0 is the first) that took the seed's value.
    """

    def __init__(self, off: float) -> None:
        self.found, self.off = False, off
        self.free: set[int] = set()

    def folded(self, sine2: float, length: float, gain: float = 1.0) -> None:
        """Take two postures that meet into account.

        Args:
            sine2: Square of the sine of half the angle between them, less than 0 where they do not exist.
            length: What it changes with [m].
            gain: How much of what poses are off arrives here.
        """
        self.found = self.found or abs(sine2) * length < 4.0 * self.off * gain

    def aligned(self, sine: float, gain: float) -> None:
        """Take the sine between the outer axes of a wrist into account; `gain` as in `folded`."""
        self.found = self.found or sine < self.off * gain


def decouples(dh: DenavitHartenberg) -> bool:
    """Return whether an arm has a spherical wrist, or axes 2, 3 and 4 parallel, and is not singular everywhere."""
    sines = np.abs(np.sin(dh.alpha)) > ZERO
    spherical = not dh.a[3:].any() and dh.d[4] == 0.0
    parallel = bool(sines[0]) and not sines[1]
    if not (sines[3:].all() and (spherical or (parallel and not sines[2]))):
        return False
    apart = (sines[:2] | (dh.a[:2] != 0.0)).all() and sines[:2].any()  # axes 1, 2 and 3
    fore = dh.a[2] != 0.0 or (spherical and sines[2] and dh.d[3] != 0.0)  # the wrist is not on axis 3
    return bool(apart and fore)


class DecoupledArm:
    """Every posture for a pose, of a six-axis arm that `decouples`."""

    def __init__(self, dh: DenavitHartenberg) -> None:
        self.dh = dh
        self.before: Floats = np.asarray(np.linalg.inv(dh.before), dtype=np.float64)
        self.after: Floats = np.asarray(np.linalg.inv(dh.after), dtype=np.float64)
        self._sign, self._offset = dh.sign.tolist(), dh.offset.tolist()
        self.a1, self.a2, self.a3, self.a4, self.a5 = dh.a.tolist()
        _, self.d2, self.d3, self.d4, self.d5, _ = dh.d.tolist()
        cosines, sines = np.cos(dh.alpha), np.sin(dh.alpha)
        cosines[np.abs(cosines) < ZERO], sines[np.abs(sines) < ZERO] = 0.0, 0.0
        self.ca1, self.ca2, self.ca3, self.ca4, self.ca5 = cosines.tolist()
        self.sa1, self.sa2, self.sa3, self.sa4, self.sa5 = sines.tolist()
        lengths = np.abs(np.concatenate([dh.a, dh.d]))
        self.size = float(lengths[lengths > 0.0].min())
        self.right_angles = self.ca4 == self.ca5 == 0.0
        parallel = self.sa2 == 0.0 != self.sa1
        self.spherical = self.a4 == self.a5 == self.d5 == 0.0
        #: Whether joint 1 is found before all others, from two values.
        self.by_shoulder = parallel and (self.spherical or self.a5 == 0.0)
        if self.spherical:
            self.fore, self.fore_angle = hypot(self.a3, self.sa3 * self.d4), atan2(-self.sa3 * self.d4, self.a3)
            self.height = self.d2 + self.d3 + self.ca3 * self.d4
        else:
            self.fore, self.fore_angle = self.a3, 0.0
            self.height = self.d2 + self.ca4 * self.d5
            self.hand, self.hand_angle = hypot(self.a4, self.sa4 * self.d5), atan2(-self.sa4 * self.d5, self.a4)
        samples = np.array([self._point(cos(q), sin(q)) for q in SAMPLES])
        self._square_of_point = (COEFFICIENTS @ (samples * samples).sum(axis=1)).tolist()
        self._height_of_point = (COEFFICIENTS @ samples[:, 2]).tolist()
        #: Length [m] and sine that results are divided by, where one is: the smaller, the less exact they are.
        meet, level = abs(self.a1) < ZERO, self.sa1 == 0.0  # axes 1 and 2
        self.length_divisor = self.sine_divisor = np.inf
        if not self.spherical and not self.by_shoulder:
            self.length_divisor = abs(self.a5)
        elif not self.by_shoulder and not (meet or level):
            self.length_divisor, self.sine_divisor = abs(self.a1), abs(self.sa1)
        #: Axes that make it decouple, counted from 1, and what they do, with a place for an adverb.
        self.special_axes: tuple[tuple[int, ...], str] = (
            ((4, 5, 6), "{}meet in a point") if self.spherical else ((2, 3, 4), "are {}parallel")
        )
        self.upper = self.a2
        self.stretched, self.folded = self.upper + self.fore, abs(self.upper - self.fore)

    def solve(
        self,
        T: Floats,
        *,
        tol: float,
        seed: Sequence[float],
        doubt: Doubt | None = None,
        aligned: float | None = None,
    ) -> list[Row]:
        """Compute every posture for a pose of the tip.

        Args:
            T: Pose in the base frame, rotation orthonormal, shape (4, 4).
            tol: How far one part of the geometry may be missed by a posture in which something is clamped [m, rad].
            seed: Values [rad] that free joints keep, as far as they can, shape (6,).
            doubt: Learns whether the postures may be others for an arm that is a little off.
            aligned: Sine between the outer axes of a wrist below which these are parallel; `tol` without it.

        Returns:
            Branch index, flags and angles in [-pi, pi] of each posture. One with flags may miss the pose.
        """
        pose = (self.before @ T @ self.after)[:3].tolist()
        start = [s * q + o for s, q, o in zip(self._sign, seed, self._offset, strict=True)]
        wrist = tol if aligned is None else aligned
        if self.spherical:
            found = list(self._spherical(pose, tol, start, doubt, wrist))
        elif self.by_shoulder:
            found = list(self._three_parallel(pose, tol, start, doubt, wrist))
        else:
            found = list(self._three_parallel_by_roots(pose, tol, start, doubt, wrist))
        s1, s2, s3, s4, s5, s6 = self._sign
        o1, o2, o3, o4, o5, o6 = self._offset
        return [
            (
                branch,
                flags,
                wrap(s1 * (q1 - o1)),
                wrap(s2 * (q2 - o2)),
                wrap(s3 * (q3 - o3)),
                wrap(s4 * (q4 - o4)),
                wrap(s5 * (q5 - o5)),
                wrap(s6 * (q6 - o6)),
            )
            for branch, flags, q1, q2, q3, q4, q5, q6 in found
        ]

    def near_singular(self, T: Floats, tols: Sequence[float], seed: Sequence[float]) -> tuple[list[Row], set[int]]:
        """Compute the postures of a pose with each of some tolerances, and which joints (0 is the first) are free.

        Arguments are those of `solve`.
        """
        doubt = Doubt(0.0)
        pairs = [(tol, aligned) for tol in tols for aligned in sorted({tol, min(tols)}, reverse=True)]
        return [
            row for tol, aligned in pairs for row in self.solve(T, tol=tol, seed=seed, doubt=doubt, aligned=aligned)
        ], doubt.free

    def samples(self, T: Floats, tol: float, seed: Sequence[float], free: set[int]) -> list[Row]:
        """Compute postures of a pose with many values of the joints that are free; arguments are those of `solve`."""
        joints = sorted(free)
        if not joints:
            return []
        count = TURNS if len(joints) == 1 else 3 * TURNS
        starts = np.tile(seed, (count, 1))
        starts[:, joints] += 2.0 * np.pi * np.arange(1, count + 1)[:, None] * SHARES[: len(joints)]
        if 0 in free:
            for q1 in (*self._parallel_hands(T, tol), *self._turning_hands(T, tol)):
                more = starts[:count:3].copy()
                more[:, 0] = q1
                starts = np.vstack([starts, more])
        tries = [(start, missed) for start in starts.tolist() for missed in (tol, FAR_MISS)]
        return [row for start, missed in tries for row in self.solve(T, tol=missed, seed=start)]

    def _parallel_hands(self, T: Floats, tol: float) -> list[float]:
        """Angles of a free joint 1 at which axis 6 is parallel to three parallel axes, so that they move together."""
        (_, _, x, _), (_, _, y, _), (_, _, z, _) = (self.before @ T @ self.after)[:3].tolist()
        q1 = atan2(self.sa1 * x, -self.sa1 * y)
        off = np.cross((x, y, z), (sin(q1) * self.sa1, -cos(q1) * self.sa1, copysign(self.ca1, z)))
        if self.spherical or np.abs(off).max() > tol:
            return []
        return [self._sign[0] * (turned - self._offset[0]) for turned in (q1, q1 + pi)]

    def _turning_hands(self, T: Floats, tol: float) -> list[float]:
        """Angles of a free joint 1 that turn the hand evenly, where axis 6 is nearly parallel to three parallel axes.

        The hand turns by as much as joint 1 divided by the angle between them: few of evenly spaced angles would reach.
        """
        (_, _, x, _), (_, _, y, _), (_, _, z, _) = (self.before @ T @ self.after)[:3].tolist()
        found: list[float] = []
        if self.spherical:
            return found
        nearest = atan2(self.sa1 * x, -self.sa1 * y)
        for q1 in (nearest, nearest + pi):
            tilt = hypot(*_cross((x, y, z), (sin(q1) * self.sa1, -cos(q1) * self.sa1, self.ca1)))
            if tol < tilt < NEARLY_PARALLEL:
                found += [self._sign[0] * (q1 + tilt * turn - self._offset[0]) for turn in TANGENTS]
        return found

    def _spherical(
        self, pose: _Rows, tol: float, start: Sequence[float], doubt: Doubt | None, aligned: float
    ) -> Iterator[Row]:
        """Postures of an arm with a spherical wrist."""
        positions = self._arm_by_shoulder if self.by_shoulder else self._arm_by_roots
        for branch, flags, q1, q2, q3 in positions(pose, tol, start, doubt):
            gain = 1.0 if doubt is None else 1.0 + self._turned_by_moves(q2, q3)
            turn = self._behind(pose, cos(q1), sin(q1), self.ca1, self.sa1)
            if self.sa2 == 0.0:
                turn = self._behind(turn, cos(q2 + q3), sin(q2 + q3), self.ca3, self.sa3)
            else:
                turn = self._behind(turn, cos(q2), sin(q2), self.ca2, self.sa2)
                turn = self._behind(turn, cos(q3), sin(q3), self.ca3, self.sa3)
            reached = False
            for side, flag, q4, q5, q6 in self._wrists(turn, aligned, doubt, gain, first=start[3]):
                reached = True
                yield branch + side, flags | flag, q1, q2, q3, q4, q5, q6
            if flags and not reached:  # other values of a free joint may reach
                yield branch, flags, q1, q2, q3, *start[3:]

    def _three_parallel(
        self, pose: _Rows, tol: float, start: Sequence[float], doubt: Doubt | None, aligned: float
    ) -> Iterator[Row]:
        """Postures of an arm with axes 2, 3 and 4 parallel, and 5 and 6 that meet."""
        for branch, flags, q1, c1, s1, u, v, gain in self._shoulders(pose, tol, start[0], doubt):
            palm = (u, v, self.hand, self.hand_angle, start[5])
            turn = self._behind(pose, c1, s1, self.ca1, self.sa1)
            turned = 1.0 + 1.0 / max(abs(u + self.a1), tol)
            reached = not flags
            for side, flag, q234, q5, q6 in self._wrists(turn, aligned, doubt, turned, palm=palm):
                through = gain + turned * self.hand / max(abs(self.sa4 * self.sa5 * sin(q5)), tol)
                for row in self._arms(
                    branch + side, flags | flag, q1, q234, q5, q6, palm, tol, start[1], doubt, through
                ):
                    reached = True
                    yield row
            if not reached:  # other values of a free joint may reach
                yield branch, flags, q1, *start[1:]

    def _three_parallel_by_roots(
        self, pose: _Rows, tol: float, start: Sequence[float], doubt: Doubt | None, aligned: float
    ) -> Iterator[Row]:
        """Postures of an arm with axes 2, 3 and 4 parallel, and 5 and 6 that do not meet.

        The height of P above the plane gives the sine of q5, and the direction of axis 6 its cosine; both are linear in
        the cosine and sine of q1.
        """
        (_, _, wx, x), (_, _, wy, y), (_, _, wz, z) = pose
        ca1, sa1, ca4, sa4, ca5, sa5, a5 = self.ca1, self.sa1, self.ca4, self.sa4, self.ca5, self.sa5, self.a5
        by_s5, by_c5 = sa4 * a5, -sa4 * sa5
        sine = ((ca1 * z - self.height) / by_s5, -sa1 * y / by_s5, sa1 * x / by_s5)
        cosine = ((ca1 * wz - ca4 * ca5) / by_c5, -sa1 * wy / by_c5, sa1 * wx / by_c5)
        square = [s + c for s, c in zip(_square(sine), _square(cosine), strict=True)]
        square[0] -= 1.0
        roots = _roots(square, start[0], tol / self.size, doubt, 2.0 / abs(by_s5) + 2.0 / abs(by_c5))
        if doubt is not None and roots == [(start[0], True)]:
            doubt.free.add(0)
        slope = 2.0 / min(abs(by_s5), abs(by_c5))  # of q1, if the nearest other root is 1 rad away
        for root, (q1, merged) in enumerate(roots):
            apart = min((abs(wrap(q1 - other)) for index, (other, _) in enumerate(roots) if index != root), default=1.0)
            turned = 1.0 + slope / max(min(apart, 1.0), APART)
            c1, s1 = cos(q1), sin(q1)
            q5 = atan2(sine[0] + sine[1] * c1 + sine[2] * s1, cosine[0] + cosine[1] * c1 + cosine[2] * s1)
            turn = self._behind(pose, c1, s1, ca1, sa1)
            u, v = x * c1 + y * s1 - self.a1, ca1 * (y * c1 - x * s1) + sa1 * z
            hand = (self.a4 + a5 * cos(q5), ca4 * a5 * sin(q5) - sa4 * self.d5)
            palm = (u, v, hypot(*hand), atan2(hand[1], hand[0]), start[5])
            tilt = hypot(turn[0][2], turn[1][2])
            if doubt is not None:
                doubt.aligned(tilt, turned)
            through = 1.0 + turned * (hypot(x, y) + palm[2] / max(tilt, tol))
            for arc, q234, q6, flag in self._outer(turn, q5, aligned, 0.0, palm, doubt):
                flags = flag | (SHOULDER if merged else 0)
                branch = 2 * root ^ arc
                yield from self._arms(branch, flags, q1, q234, q5, q6, palm, tol, start[1], doubt, through)

    def _arms(
        self,
        branch: int,
        flags: int,
        q1: float,
        q234: float,
        q5: float,
        q6: float,
        palm: _Palm,
        tol: float,
        start: float,
        doubt: Doubt | None,
        gain: float,
    ) -> Iterator[Row]:
        """Both elbows of an arm whose hand has the pitch q234."""
        u, v, hand, hand_angle, _ = palm
        angle = q234 + hand_angle
        for elbow, bent, q2, q3 in self._elbows(u - hand * cos(angle), v - hand * sin(angle), tol, start, doubt, gain):
            yield branch + elbow, flags | bent, q1, q2, q3, q234 - q2 - q3, q5, q6

    def _arm_by_shoulder(
        self, pose: _Rows, tol: float, start: Sequence[float], doubt: Doubt | None
    ) -> Iterator[_Position]:
        for branch, flags, q1, _, _, u, v, gain in self._shoulders(pose, tol, start[0], doubt):
            for elbow, bent, q2, q3 in self._elbows(u, v, tol, start[1], doubt, gain):
                yield branch + elbow, flags | bent, q1, q2, q3

    def _arm_by_roots(
        self, pose: _Rows, tol: float, start: Sequence[float], doubt: Doubt | None
    ) -> Iterator[_Position]:
        """First three angles of any three axes that bring a point to a place.

        The place's distance from the origin and its height along axis 1 do not depend on q1. With (x, y) where joint 2
        turns the point that joint 3 has brought into its plane, each is linear in one of x and y.
        """
        (_, _, _, px), (_, _, _, py), (_, _, _, pz) = pose
        a1, ca1, sa1 = self.a1, self.ca1, self.sa1
        n0, n1, n2 = self._square_of_point
        z0, z1, z2 = height = self._height_of_point
        # 2 a1 x = far, sa1 y = high, x^2 + y^2 = n - z2^2
        far = (px * px + py * py + pz * pz - a1 * a1 - n0, -n1, -n2)
        high = (pz - ca1 * z0, -ca1 * z1, -ca1 * z2)
        meet, parallel = abs(a1) < ZERO, sa1 == 0.0  # axes 1 and 2
        distance = hypot(px, py, pz)
        if meet or parallel:
            equation = [*(far if meet else high), 0.0, 0.0, 0.0]
            moved = 2.0 * distance if meet else 1.0
        else:
            by_far, by_high = sa1 * sa1, 4.0 * a1 * a1
            equation = [
                by_far * f + by_high * (h + by_far * z) - by_far * by_high * n
                for f, h, z, n in zip(_square(far), _square(high), _square(height), (n0, n1, n2, 0, 0, 0), strict=True)
            ]
            moved = 8.0 * abs(a1 * sa1) * (distance + abs(a1)) * (abs(sa1) * distance + abs(a1))
        for root, (q3, merged) in enumerate(_roots(equation, start[2], tol / self.size, doubt, moved)):
            c3, s3 = cos(q3), sin(q3)
            gain = 1.0
            if doubt is not None and (meet or parallel):  # by how much the chord's end moves, as joint 3 turns
                gain += self.fore * moved / max(abs(equation[2] * c3 - equation[1] * s3), ZERO)
                gain /= abs(sa1) if meet else min(abs(a1), 1.0)
            px2, py2, pz2 = self._point(c3, s3)
            r2 = hypot(px2, py2)
            x = 0.0 if meet else 0.5 * (far[0] + far[1] * c3 + far[2] * s3) / a1
            y = 0.0 if parallel else (high[0] + high[1] * c3 + high[2] * s3) / sa1
            if meet:
                ends = [(rest, y, flag) for rest, flag in _chord(y, r2, tol, doubt, gain)]
            elif parallel:
                ends = [(x, rest, flag) for rest, flag in _chord(x, r2, tol, doubt, gain)]
            else:
                ends = [(x, y, 0)]
            for other, (x, y, flag) in enumerate(ends):
                flags = flag | (ELBOW if merged else 0)
                q2 = atan2(y, x) - atan2(py2, px2) if r2 > tol else start[1]
                c2, s2 = cos(q2), sin(q2)
                u, v = c2 * px2 - s2 * py2 + a1, ca1 * (s2 * px2 + c2 * py2) - sa1 * pz2
                on_axis = hypot(u, v) <= tol
                q1 = start[0] if on_axis else atan2(py, px) - atan2(v, u)
                branch = 4 * root + other if meet or parallel else 4 * (root // 2) + root % 2
                if doubt is not None:
                    doubt.free |= {joint for joint, is_free in enumerate((on_axis, r2 <= tol)) if is_free}
                yield branch, flags | (SHOULDER if on_axis or r2 <= tol else 0), q1, q2, q3

    def _point(self, c3: float, s3: float) -> tuple[float, float, float]:
        """The centre of a spherical wrist behind joint 2 [m]."""
        along = self.sa3 * self.d4
        x, y, z = c3 * self.a3 + s3 * along, s3 * self.a3 - c3 * along, self.ca3 * self.d4 + self.d3
        return x + self.a2, self.ca2 * y - self.sa2 * z, self.sa2 * y + self.ca2 * z + self.d2

    def _turned_by_moves(self, q2: float, q3: float) -> float:
        """By how much joints 1 to 3 turn at most if they move the centre of a spherical wrist [rad/m]."""
        c2, s2 = cos(q2), sin(q2)
        x, y, z = self._point(cos(q3), sin(q3))  # as seen behind joint 2
        first = _cross((s2 * self.sa1, c2 * self.sa1, self.ca1), (x + self.a1 * c2, y - self.a1 * s2, z))
        second = (-y, x, 0.0)
        third = _cross((0.0, -self.sa2, self.ca2), (x - self.a2, y, z - self.d2))
        sides = _cross(second, third), _cross(third, first), _cross(first, second)
        volume = abs(sum(a * b for a, b in zip(first, sides[0], strict=True)))
        return hypot(*sides[0], *sides[1], *sides[2]) / max(volume, ZERO)

    def _shoulders(
        self, pose: _Rows, tol: float, start: float, doubt: Doubt | None
    ) -> Iterator[tuple[int, int, float, float, float, float, float, float]]:
        """Branch, flags, q1, its cosine and sine, P in the plane of joints 2 and 3 [m], how far that moves with P."""
        (_, _, _, x), (_, _, _, y), (_, _, _, z) = pose
        a1, ca1, sa1 = self.a1, self.ca1, self.sa1
        across = (ca1 * z - self.height) / sa1
        v = ca1 * across + sa1 * z
        r2 = x * x + y * y
        m2 = r2 - across * across
        if doubt is not None:
            doubt.folded(m2 / r2 if r2 > 0.0 else 0.0, sqrt(r2))
        if m2 > MERGED * MERGED * r2 + ZERO * ZERO and r2 > tol * tol:
            along = sqrt(m2)
            gain = 1.0 + (sqrt(r2) + abs(across)) / along
            for branch, m in ((0, along), (4, -along)):
                c1, s1 = (x * m + y * across) / r2, (y * m - x * across) / r2
                yield branch, 0, atan2(s1, c1), c1, s1, m - a1, v, gain
            return
        r = sqrt(r2)
        if r < abs(across) - max(tol, CLOSE):
            return
        if r <= tol:  # P is on the first axis
            if doubt is not None:
                doubt.free.add(0)
            yield 0, SHOULDER, start, cos(start), sin(start), -a1, v, 1.0
        else:
            sign = copysign(1.0, across)
            c1, s1 = sign * y / r, -sign * x / r
            yield 0, SHOULDER, atan2(s1, c1), c1, s1, -a1, v, 1.0

    @staticmethod
    def _behind(rows: _Rows, c: float, s: float, ca: float, sa: float) -> _Rows:
        """Rows of a pose's rotation as seen behind a joint with cosine c and sine s, and an angle between axes."""
        (ax, bx, cx, *_), (ay, by, cy, *_), (az, bz, cz, *_) = rows
        at, bt, ct = c * ay - s * ax, c * by - s * bx, c * cy - s * cx
        return (
            (c * ax + s * ay, c * bx + s * by, c * cx + s * cy),
            (ca * at + sa * az, ca * bt + sa * bz, ca * ct + sa * cz),
            (ca * az - sa * at, ca * bz - sa * bt, ca * cz - sa * ct),
        )

    def _wrists(
        self,
        turn: _Rows,
        tol: float,
        doubt: Doubt | None,
        gain: float,
        *,
        first: float = 0.0,
        palm: _Palm | None = None,
    ) -> Iterator[tuple[int, int, float, float, float]]:
        """Both ways to make a rotation of three turns, Rz(first) Rx(alpha4) Rz(q5) Rx(alpha5) Rz(last).

        Yields branch, flags and the three angles. Arguments as in `_outer`, and `gain` as in `Doubt.folded`.
        """
        (_, _, n13), (_, _, n23), (n31, n32, n33) = turn
        ca4, sa4, ca5, sa5 = self.ca4, self.sa4, self.ca5, self.sa5
        s = hypot(n13, n23)
        if doubt is not None:
            doubt.aligned(s, gain)
        if self.right_angles:
            middle, merged = atan2(s, -n33 * sa4 * sa5), s <= tol
            if s > NEAR_WRIST and not merged:
                first, last = atan2(n23 * sa5, n13 * sa5), atan2(-n32 * sa4, n31 * sa4)
                yield 0, 0, first, middle, last
                yield 2, 0, first + pi, -middle, last + pi
                return
        else:
            cosine = (ca4 * ca5 - n33) / (sa4 * sa5)
            if doubt is not None:
                doubt.folded(1.0 - cosine * cosine, abs(sa4 * sa5), gain)
            if abs(sa4 * sa5) * (abs(cosine) - 1.0) > max(tol, CLOSE):
                return
            middle = acos(min(1.0, max(-1.0, cosine)))
            merged = sin(middle) < MERGED
            if merged:  # between the two
                middle = 0.0 if cosine > 0.0 else pi
        for side, q5 in ((0, middle),) if merged else ((0, middle), (2, -middle)):
            for arc, q4, q6, flags in self._outer(turn, q5, tol, first, palm, doubt):
                yield side ^ arc, flags | (WRIST if merged else 0), q4, q5, q6

    def _outer(
        self, turn: _Rows, q5: float, tol: float, first: float, palm: _Palm | None, doubt: Doubt | None
    ) -> Iterator[tuple[int, float, float, int]]:
        """The first and the last of three turns, of which the middle one is known, with branch and flags.

        Args:
            turn: Rows of the rotation.
            q5: The middle turn [rad].
            tol: At which sine between the first axis and the last only the sum of their turns is given.
            first: Value of the first turn where it is free [rad].
            palm: Instead: the first turn is the pitch of this hand, and the last one keeps its value as far as the
                elbow reaches.
            doubt: As in `DecoupledArm.solve`.
        """
        (n11, _, n13), (n21, _, n23), (n31, n32, n33) = turn
        ca4, sa4, ca5, sa5 = self.ca4, self.sa4, self.ca5, self.sa5
        c5, s5, s = cos(q5), sin(q5), hypot(n13, n23)
        if s > tol:
            g, f = s5 * sa5, -ca4 * c5 * sa5 - sa4 * ca5
            q4 = atan2(n23 * g - n13 * f, n13 * g + n23 * f)
            if s > NEAR_WRIST:
                g, f = sa4 * s5, sa4 * c5 * ca5 + ca4 * sa5
                yield 0, q4, atan2(n31 * f - n32 * g, n31 * g + n32 * f), 0
                return
            arcs = [(0, q4, 0)]
            if palm is not None:
                _, nearest, flags = next(self._pitches(q4, palm, tol))
                if 0.0 < abs(nearest - q4) * s <= tol:  # the wrist is almost free
                    arcs = [(0, nearest, flags)]
        else:
            if doubt is not None:
                doubt.free.add(3 if palm is None else 5)
            if palm is None:
                arcs = [(0, first, WRIST)]
            else:
                sign = copysign(1.0, n33)  # the last joint falls as the pitch grows, or grows
                wanted = wrap(sign * (self._last(n11, n21, n31, 0.0, q5) - palm[-1]))
                arcs = list(self._pitches(wanted, palm, tol))
        for arc, q4, flags in arcs:
            yield arc, q4, self._last(n11, n21, n31, q4, q5), flags

    def _last(self, n11: float, n21: float, n31: float, q4: float, q5: float) -> float:
        """The last of three turns, from the first column of their product and the other two."""
        c, s = cos(q4), sin(q4)
        x, y, z = c * n11 + s * n21, c * n21 - s * n11, n31
        y, z = self.ca4 * y + self.sa4 * z, self.ca4 * z - self.sa4 * y
        c, s = cos(q5), sin(q5)
        x, y = c * x + s * y, c * y - s * x
        return atan2(self.ca5 * y + self.sa5 * z, x)

    def _pitches(self, wanted: float, palm: _Palm, tol: float) -> Iterator[tuple[int, float, int]]:
        """`pitches` of a hand. If it comes to axis 2, to where the elbow folds, joint 2 is free at one more pitch."""
        u, v, hand, hand_angle, _ = palm
        yield from pitches(wanted, u, v, hand, hand_angle, self.stretched, self.folded)
        if self.folded <= ZERO and abs(hypot(u, v) - hand) <= tol:
            yield 0, atan2(v, u) - hand_angle, WRIST | MOVED

    def _elbows(
        self, u: float, v: float, tol: float, start: float, doubt: Doubt | None, gain: float
    ) -> Iterator[tuple[int, int, float, float]]:
        """Branch, flags, q2 and q3 with which two links in the plane reach a point (u, v) [m]."""
        upper, fore = self.upper, self.fore
        rho2 = u * u + v * v
        c3 = (rho2 - upper * upper - fore * fore) / (2.0 * upper * fore)
        if doubt is not None:
            doubt.folded(1.0 - c3 * c3, upper * fore / self.stretched, gain)
        s3 = sqrt(1.0 - c3 * c3) if -1.0 < c3 < 1.0 else 0.0
        way = atan2(v, u)
        if s3 >= MERGED and rho2 > tol * tol:
            q3, psi = atan2(s3, c3), atan2(fore * s3, upper + fore * c3)
            yield 0, 0, way - psi, q3 - self.fore_angle
            yield 1, 0, way + psi, -q3 - self.fore_angle
            return
        rho = sqrt(rho2)
        amiss = max(tol, CLOSE)
        if self.folded - amiss <= rho <= self.stretched + amiss:
            if rho <= tol:
                way = start
                if doubt is not None:
                    doubt.free.add(1)
            straight = c3 > 0.0
            q2 = way if straight or upper >= fore else way + pi
            yield 0, ELBOW, q2, (0.0 if straight else pi) - self.fore_angle


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _chord(given: float, radius: float, tol: float, doubt: Doubt | None, gain: float) -> list[tuple[float, int]]:
    """The other coordinate of points on a circle of which one is given [m], with flags."""
    if doubt is not None:
        doubt.folded(1.0 - (given / radius) ** 2 if radius > 0.0 else 0.0, radius, gain)
    square = radius * radius - given * given
    if square > (MERGED * radius) ** 2:
        return [(sqrt(square), 0), (-sqrt(square), 0)]
    return [(0.0, SHOULDER)] if abs(given) <= radius + max(tol, CLOSE) else []


def _square(line: Sequence[float]) -> tuple[float, float, float, float, float, float]:
    """Coefficients of 1, c, s, c c, c s, s s in the square of a + b c + d s."""
    a, b, d = line
    return a * a, 2.0 * a * b, 2.0 * a * d, b * b, 2.0 * b * d, d * d


def _roots(k: Sequence[float], start: float, tol: float, doubt: Doubt | None, gain: float) -> list[tuple[float, bool]]:
    """Angles at which a quadratic function of cosine and sine is 0, or almost, and whether two roots merge there.

    Args:
        k: Coefficients of 1, c, s, c c, c s, s s.
        start: What is returned if the function is 0 everywhere [rad].
        tol: How far the function may be off where two roots merge, in shares of its largest coefficient.
        doubt: As in `DecoupledArm.solve`.
        gain: By how much the function changes for one unit that poses are off.
    """
    one, c, s, cc, cs, ss = k
    largest = max(map(abs, k))
    if largest < max(ZERO, tol):
        return [(start, True)]
    fold = 0.0 if doubt is None else 2.0 * sqrt(doubt.off * gain / largest)  # angle between roots that may meet [rad]
    high, low = complex(0.25 * (cc - ss), -0.25 * cs), complex(0.5 * c, -0.5 * s)
    middle = one + 0.5 * (cc + ss)
    if abs(high) <= ZERO * largest:  # a line
        size = 2.0 * abs(low)
        if doubt is not None:
            doubt.found = doubt.found or size == 0.0 or abs(1.0 - (middle / size) ** 2) < fold * fold
        if abs(middle) > size + 2.0 * tol * largest or size == 0.0:
            return []
        way = atan2(s, c)
        apart = acos(min(1.0, max(-1.0, -middle / size)))
        return [(way, True)] if apart < MERGED else [(way + pi, True)] if pi - apart < MERGED else [
            (way + apart, False), (way - apart, False)
        ]  # fmt: skip
    found: list[tuple[float, bool]] = []
    middles: list[float] = []  # of two roots that almost merge
    off_circle = max(OFF_CIRCLE, 2.0 * sqrt(tol))
    companion = [[-low / high, -middle / high, -low.conjugate() / high, -high.conjugate() / high], *_BELOW]
    for z in np.linalg.eigvals(companion).tolist():
        off = abs(abs(z) - 1.0)
        if doubt is not None and OFF_CIRCLE < off < 2.0 * fold:
            doubt.found = True
        if off > off_circle:
            continue
        root, slope = atan2(z.imag, z.real), 0.0
        q = root
        for _ in range(POLISH if off <= OFF_CIRCLE else 0):
            x, y = cos(q), sin(q)
            value = one + c * x + s * y + cc * x * x + cs * x * y + ss * y * y
            slope = -c * y + s * x + 2.0 * (ss - cc) * x * y + cs * (x * x - y * y)
            if abs(slope) <= ZERO * largest:
                break
            q -= value / slope
        merged = abs(slope) < MERGED * largest
        if abs(q - root) > APART + 10.0 * off:  # there is no root, only a complex one nearby
            q, merged = root, True
        near = [index for index, (other, _) in enumerate(found) if abs(wrap(other - q)) < APART]
        if merged or near:  # between the two the function is steady
            for _ in range(POLISH):
                x, y = cos(q), sin(q)
                slope = -c * y + s * x + 2.0 * (ss - cc) * x * y + cs * (x * x - y * y)
                bend = -c * x - s * y + 2.0 * (ss - cc) * (x * x - y * y) - 4.0 * cs * x * y
                if abs(slope) >= abs(bend) * off_circle:
                    break
                q -= slope / bend
            else:
                x, y = cos(q), sin(q)
                value = one + c * x + s * y + cc * x * x + cs * x * y + ss * y * y
                apart = sqrt(max(0.0, -2.0 * value / bend))
                if apart > MERGED:
                    steady = [index for index, other in enumerate(middles) if abs(wrap(other - q)) < APART]
                    middles.append(q)
                    if not steady:
                        found += [(q + apart, False), (q - apart, False)]
                    continue
        if doubt is not None and any(abs(wrap(other - q)) < fold for other, _ in found):
            doubt.found = True
        if near:
            found[near[0]] = (q, True)
        else:
            found.append((q, merged))
    return found
