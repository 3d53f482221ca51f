"""Values of a free wrist_3 that fit narrow limits.

At sin q5 = 0 only q234 + q6 is given (at q5 = pi their difference), so a branch is not one posture but a family of
them. `closed_form` returns the member with q6 nearest to the caller's value. If the joint limits forbid that one, the
nearest that they allow is searched here over `STEPS` values of q234, refined around the best. A member that is allowed
within less than a step may be missed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics._angles import wrapped
from kinreach.kinematics._solutions import NEAR_LIMIT, Row, nearest_windings
from kinreach.kinematics._ur.batch import solve_elbow
from kinreach.kinematics._ur.closed_form import MOVED, WRIST, free_pitches, reaches_pose, shoulders
from kinreach.kinematics._ur.geometry import Rows, URGeometry

#: Values of q234 that are tried on a full turn, and `ROUNDS` times around the best of them.
STEPS, STEPS_AROUND, ROUNDS = 8192, 129, 5


def free_wrist_within(
    rows: Rows, g: URGeometry, lower: Floats, upper: Floats, *, seed: Floats, tol: float
) -> list[Row]:
    """Find for each branch with a free wrist_3 the posture within the limits whose q6 is nearest to the seed's.

    Returns:
        The solutions, at most eight; none for a branch of which no member is within the limits.
    """
    (nx, ox, ax, px), (ny, oy, ay, py), (nz, _, az, pz) = rows
    x, y, z = px - g.d6 * ax, py - g.d6 * ay, pz - g.d6 * az - g.d1
    found: list[Row] = []
    for branch, flags, s1, c1 in shoulders(x, y, g.d4, tol):
        c6, s6, c5 = nx * s1 - ny * c1, oy * c1 - ox * s1, ax * s1 - ay * c1
        if sqrt(c6 * c6 + s6 * s6) <= tol:
            family = _Family(
                g, lower, upper, seed,
                q1=atan2(s1, c1), straight=c5 > 0.0, angle=atan2(nz, nx * c1 + ny * s1), u=-x * c1 - y * s1, v=-z,
            )  # fmt: skip
            for side in family.sides:
                for elbow in (0, 1):
                    q = family.nearest(side, elbow)
                    if q is not None and reaches_pose(q, g, rows, tol):
                        found.append((branch + side + elbow, flags | WRIST | MOVED, *q))
    return found


@dataclass(frozen=True)
class _Family:
    """The postures of one shoulder with a free wrist_3.

    Attributes:
        g, lower, upper, seed: As for `free_wrist_within`.
        q1: Angle of the shoulder [rad].
        straight: Whether q5 is 0; else it is pi.
        angle: What q234 and q6 have to add up to, or differ by, up to pi [rad].
        u, v: From P5 to the shoulder, in the arm's plane [m].
    """

    g: URGeometry
    lower: Floats
    upper: Floats
    seed: Floats
    q1: float
    straight: bool
    angle: float
    u: float
    v: float

    @property
    def sides(self) -> list[int]:
        """Branches of the arcs of q234 in reach, as `pitches` has them."""
        return sorted(side for side, _, _ in free_pitches(0.0, -self.u, -self.v, self.g))

    def members(self, q234: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Postures by elbow and q234, shape (6, 2, m), in windings within the limits; which are allowed, (2, m)."""
        q = np.empty((6, 2, len(q234)))
        u, v = self.u + self.g.d5 * np.sin(q234), self.v - self.g.d5 * np.cos(q234)
        with np.errstate(invalid="ignore"):
            reached, _ = solve_elbow(u, v, q234, self.g, 0.0, q[1:4])
            q[0], q[4] = self.q1, 0.0 if self.straight else pi
            q[5] = self.angle - q234 if self.straight else q234 - self.angle + pi
            q, within = nearest_windings(q, self.seed[:, None, None], self.lower, self.upper, slack=NEAR_LIMIT)
        return q, within & reached

    def nearest(self, side: int, elbow: int) -> list[float] | None:
        """Return the allowed member of an arc whose q6 is nearest to the seed's, or None."""
        q234 = np.linspace(-pi, pi, STEPS + 1)
        if len(self.sides) > 1:  # either side of the circle's farthest point
            eta = wrapped(q234 + atan2(-self.u, -self.v))
            q234 = q234[eta < 0.0] if side else q234[eta >= 0.0]
        for _ in range(ROUNDS):
            q, allowed = self.members(q234)
            away = np.where(allowed[elbow], np.abs(q[5, elbow] - self.seed[5]), np.inf)
            best = int(away.argmin())
            if away[best] == np.inf:
                return None
            nearest: list[float] = q[:, elbow, best].tolist()
            q234 = np.linspace(q234[max(best - 1, 0)], q234[min(best + 1, len(q234) - 1)], STEPS_AROUND)
        return nearest
