"""Closed-form inverse kinematics of UR-type arms, as pure functions on floats.

The arm is a turning shoulder, a planar two-link arm with three parallel axes, and two wrist axes. With P5 the
origin of wrist_3's axis, Z = (s1, -c1, 0) the normal of the arm's plane and n, o, a the columns of the flange:

* shoulder: P5 . Z = d4, a quadratic in q1 (two values);
* wrist: cos q5 = a . Z, (cos q6, sin q6) sin q5 = (n . Z, -o . Z) (two values);
* elbow: the law of cosines in the plane (two values).

That makes eight branches; the index is `4 * shoulder + 2 * wrist + elbow`, with wrist 0 for q5 >= 0 and elbow 0
for q3 >= 0. It follows a posture continuously as long as no singularity is crossed.

Singular cases (where eight branches meet or a joint becomes free) are solved, not avoided:

* arguments that leave their domain by rounding are clamped when the geometry is missed by no more than `tol`;
* at sin q5 = 0 only q234 +- q6 is given. q6 starts from the caller's value and is moved to the nearest angle from
  which the elbow can reach: as q6 turns, wrist_1's origin runs on a circle of radius d5 about P5, and the part of
  it between the folded and the stretched elbow is one interval of |eta|, bounded by two arccosines. If neither bound
  is 0 or pi that is two arcs, and each has a posture.

Every solution in which something was clamped or moved is checked by forward kinematics before it is returned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import acos, atan2, copysign, cos, hypot, pi, sin, sqrt

from kinreach.kinematics._angles import TURN, wrap
from kinreach.kinematics._solutions import ANGLES, FLAGS, Row
from kinreach.kinematics._ur.geometry import Miss, Rows, Singularity, URGeometry, ur_fk

#: Below this sin q5 rounding in the pose, 1e-13 say, is magnified to more than the smallest tolerance.
NEAR_WRIST = 1e-3
#: Two values of the shoulder or the elbow that differ by less are one [rad]: rounding of 1e-13 in the pose parts those
#: of a singular posture by up to this, and what is in the middle between them is off by 1e-12 of an arm's length.
MERGED = 1e-6


#: Shoulder and wrist values where neither is singular.
REGULAR_WRISTS = 4
SHOULDER, WRIST, ELBOW, MOVED = map(int, Singularity)
#: Shoulder and wrist of a branch: branch index, flags, q1, q5, q6, q234, and the vector (u, v) from wrist_1's
#: origin to the shoulder in the arm's plane [m].
Wrist = tuple[int, int, float, float, float, float, float, float]


def solve_pose(rows: Rows, g: URGeometry, *, tol: float = 1e-7, q6: float = 0.0) -> tuple[list[Row], int]:
    """Compute all postures that put the flange at a pose.

    Args:
        rows: Pose of the flange in the DH base frame, three rows of four numbers, rotation orthonormal.
        g: Link lengths [m].
        tol: Largest position [m] and orientation [rad] error of a clamped solution.
        q6: Value wrist_3 keeps, as far as it can, where it is free [rad].

    Returns:
        The solutions in the order of their branch index, angles in [-pi, pi], and the `Miss` flags of those missing.
    """
    (nx, ox, ax, px), (ny, oy, ay, py), (nz, oz, az, pz) = rows
    d1, _, _, d5, d6, _, _, _ = g.packed
    x, y, z = px - d6 * ax, py - d6 * ay, pz - d6 * az - d1
    wrists: list[Wrist] = []
    near = False
    for branch, flags, s1, c1 in shoulders(x, y, g.d4, tol):
        q1, u = atan2(s1, c1), -x * c1 - y * s1
        c6, s6, c5 = nx * s1 - ny * c1, oy * c1 - ox * s1, ax * s1 - ay * c1
        s5 = sqrt(c6 * c6 + s6 * s6)
        if s5 > NEAR_WRIST and s5 > tol:
            k = d5 / s5
            s, c = k * az, k * (ax * c1 + ay * s1)
            q5, q6_, q234 = atan2(s5, c5), atan2(s6, c6), atan2(-s, -c)
            wrists.append((branch, flags, q1, q5, q6_, q234, u - s, c - z))
            # the flipped wrist is -q5, q6 + pi, q234 + pi
            q6_ += pi if q6_ <= 0.0 else -pi
            q234 += pi if q234 <= 0.0 else -pi
            wrists.append((branch + 2, flags, q1, -q5, q6_, q234, u + s, -c - z))
        elif s5 > tol:
            near = True
            n_u, o_u = nx * c1 + ny * s1, ox * c1 + oy * s1
            total = atan2(nz - o_u, n_u + oz) if c5 > 0.0 else atan2(-nz - o_u, oz - n_u)
            wrists += _near_wrists((branch, flags, q1, atan2(s5, c5), atan2(s6, c6)), total, -u, z, g, tol / s5)
        else:
            # n lies in the arm's plane, at the angle q234 + q6 (q5 = 0) or q234 - q6 + pi (q5 = pi)
            angle = atan2(nz, nx * c1 + ny * s1)
            wanted, near = angle - q6 if c5 > 0.0 else angle + q6 - pi, True
            for side, flag, q5, q234, a, b in _free_wrists(c5, wanted, -u, z, g):
                q6_ = wrap(angle - q234 if c5 > 0.0 else q234 - angle + pi)
                wrists.append((branch + side, flags | flag, q1, q5, q6_, q234, a, b))
    found, miss, clamped = _elbows(wrists, g, tol)
    if len(wrists) == REGULAR_WRISTS and not (near or clamped):
        return found, miss
    return _verified(found, miss, lambda q: reaches_pose(q, g, rows, tol))


def solve_axis(
    position: Sequence[float],
    axis: Sequence[float],
    g: URGeometry,
    *,
    reach: float,
    tol: float = 1e-7,
    pitch: float = 0.0,
    q6: float = 0.0,
) -> tuple[list[Row], int]:
    """Compute all postures with a point of the tool axis at a position and the tool along a direction.

    Rotation about the tool is free and belongs to wrist_3 alone, so q6 keeps the given value and
    q1 ... q5 take up to eight values. With a = c5 Z - s5 X, the direction gives q5 and q234.

    Args:
        position: Point on the tool axis, DH base frame [m].
        axis: Unit direction of the tool, DH base frame.
        g: Link lengths [m].
        reach: Distance from the flange to the point along the tool axis [m].
        tol: Largest position [m] and direction [rad] error of a clamped solution.
        pitch: Value q234 keeps, as far as it can, where it is free (tool parallel to the middle axes) [rad].
        q6: Value of wrist_3 [rad].

    Returns:
        As `solve_pose`.
    """
    ax, ay, az = axis
    length = g.d6 + reach
    x, y, z = position[0] - length * ax, position[1] - length * ay, position[2] - length * az - g.d1
    wrists: list[Wrist] = []
    free = False
    for branch, flags, s1, c1 in shoulders(x, y, g.d4, tol):
        q1, u = atan2(s1, c1), -x * c1 - y * s1
        a_u, c5 = ax * c1 + ay * s1, ax * s1 - ay * c1
        s5 = hypot(a_u, az)
        if s5 > tol:
            s, c = az * g.d5 / s5, a_u * g.d5 / s5
            q5, q234 = atan2(s5, c5), atan2(-s, -c)
            wrists.append((branch, flags, q1, q5, q6, q234, u - s, c - z))
            q234 += pi if q234 <= 0.0 else -pi
            wrists.append((branch + 2, flags, q1, -q5, q6, q234, u + s, -c - z))
        else:
            free = True
            for side, flag, q5, q234, a, b in _free_wrists(c5, pitch, -u, z, g):
                wrists.append((branch + side, flags | flag, q1, q5, q6, q234, a, b))
    found, miss, clamped = _elbows(wrists, g, tol)
    if len(wrists) == REGULAR_WRISTS and not (free or clamped):
        return found, miss
    return _verified(found, miss, lambda q: _axis_missed_by(ur_fk(q, g), position, axis, reach) <= tol)


def shoulders(x: float, y: float, d4: float, tol: float) -> Sequence[tuple[int, int, float, float]]:
    """Return (branch index, flags, sin q1, cos q1) of the shoulder values from x sin q1 - y cos q1 = d4."""
    r2 = x * x + y * y
    m2 = r2 - d4 * d4
    if m2 > MERGED * MERGED * r2:
        d, m = d4 / r2, sqrt(m2) / r2
        xd, yd, xm, ym = x * d, y * d, x * m, y * m
        return (0, 0, xd + ym, xm - yd), (4, 0, xd - ym, -yd - xm)
    r = sqrt(r2)
    return ((0, SHOULDER, x / r, -y / r),) if r >= d4 - tol else ()


def _elbows(wrists: list[Wrist], g: URGeometry, tol: float) -> tuple[list[Row], int, bool]:
    """Both elbow solutions of every shoulder and wrist, from -u = a2 c2 + a3 c23 and -v = a2 s2 + a3 s23.

    Returns the solutions, the `Miss` flags, and whether an elbow was clamped.
    """
    _, upper, fore, _, _, _, lengths, twice = g.packed
    found: list[Row] = []
    miss, clamped = 0, False
    for branch, flags, q1, q5, q6, q234, u, v in wrists:
        c3 = (u * u + v * v - lengths) / twice
        s3 = sqrt(1.0 - c3 * c3) if -1.0 < c3 < 1.0 else 0.0
        if s3 < MERGED:
            reason = _elbow_miss(hypot(u, v), g, tol)
            if reason:
                miss |= reason
                continue
            c3, s3, flags, clamped = copysign(1.0, c3), 0.0, flags | ELBOW, True
        # wrist_1 -> shoulder points along phi, and is turned by psi >= 0 against the upper arm (a2 and a3 are negative)
        q3, phi, psi = atan2(s3, c3), atan2(v, u), atan2(fore * s3, upper + fore * c3)
        rest, bend = q234 - phi, psi - q3
        q2, q4 = phi - psi, rest + bend
        if q2 < -pi:
            q2 += TURN
        if q4 > pi:
            q4 -= TURN
        while q4 < -pi:
            q4 += TURN
        found.append((branch, flags, q1, q2, q3, q4, q5, q6))
        if s3 > 0.0:
            q2, q4 = phi + psi, rest - bend
            if q2 > pi:
                q2 -= TURN
            while q4 > pi:
                q4 -= TURN
            if q4 < -pi:
                q4 += TURN
            found.append((branch + 1, flags, q1, q2, -q3, q4, q5, q6))
    return found, miss, clamped


def _elbow_miss(rho: float, g: URGeometry, tol: float) -> int:
    """Why the elbow does not reach a distance [m], or 0 where it is missed by no more than `tol`."""
    if rho > g.stretched + tol:
        return int(Miss.ELBOW_OUT)
    return int(Miss.ELBOW_IN) if rho < g.folded - tol else 0


def _free_wrists(
    c5: float, wanted: float, u: float, v: float, g: URGeometry
) -> Iterator[tuple[int, int, float, float, float, float]]:
    """Branch, flags, q5, q234, u and v of the wrist at sin q5 = 0: of each arc of `pitches`."""
    for side, q234, flags in free_pitches(wanted, u, v, g):
        s, c = g.d5 * sin(q234), g.d5 * cos(q234)
        yield side, flags, 0.0 if c5 > 0.0 else pi, q234, s - u, -c - v


def _near_wrists(
    wrist: tuple[int, int, float, float, float], total: float, u: float, v: float, g: URGeometry, slack: float
) -> Iterator[Wrist]:
    """Both wrists where sin q5 is so small that q6 and q234, each by itself, are inexact.

    Exact is their sum `total`, where q5 is near pi the difference q234 - q6. If the elbow reaches only from a little
    beside that q234, no further than `slack` [rad], q234 is moved there, and q6 with it.
    """
    branch, flags, q1, q5, q6 = wrist
    for side, q5_ in ((0, q5), (2, -q5)):
        wanted = wrap(total - q6 if q5 < 0.5 * pi else total + q6)
        (_, q234, _), moved = next(free_pitches(wanted, u, v, g)), 0
        if abs(q234 - wanted) > slack:
            q234 = wanted
        elif q234 != wanted:
            moved = WRIST | MOVED
            q6 = total - q234 if q5 < 0.5 * pi else q234 - total
        s, c = g.d5 * sin(q234), g.d5 * cos(q234)
        yield branch + side, flags | moved, q1, q5_, wrap(q6), wrap(q234), s - u, -c - v
        q6 += pi if q6 <= 0.0 else -pi


def free_pitches(wanted: float, u: float, v: float, g: URGeometry) -> Iterator[tuple[int, float, int]]:
    """`pitches` of q234 at sin q5 = 0, P5 being at (u, v) [m]."""
    return pitches(wanted, u, v, g.d5, -0.5 * pi, g.stretched, g.folded)


def pitches(
    wanted: float, u: float, v: float, hand: float, hand_angle: float, stretched: float, folded: float
) -> Iterator[tuple[int, float, int]]:
    """Compute the pitch nearest to a wanted one at which two links reach a hand, of each arc of such pitches.

    The hand turns on a circle. Where the links reach neither its nearest point nor its farthest one, that part of the
    circle is two arcs. Where nothing is in reach the end that comes nearest is returned, and the elbow decides.

    Args:
        wanted: The pitch [rad].
        u: Where the hand's tip is, as seen from the links' root [m].
        v: As `u`.
        hand: Length of the hand [m].
        hand_angle: Its angle at pitch 0 [rad].
        stretched: The links' longest reach [m].
        folded: Their shortest reach [m].

    Returns:
        Branch, 2 for the second of two arcs; pitch; and flags. The arc that is nearest comes first.
    """
    eta = wrap(wanted + hand_angle - atan2(v, u) + pi)
    arc = lower, upper = _arc_in_reach(hypot(u, v), hand, stretched, folded)
    nearest = _nearest_on_arc(eta, arc)
    apart = lower > 0.0 and upper < pi
    moved = nearest - eta
    yield (2 if apart and nearest < 0.0 else 0), wanted + moved, WRIST | MOVED if moved else WRIST
    if apart:
        other = lower if abs(eta) + lower < 2.0 * pi - abs(eta) - upper else upper
        yield (0 if nearest < 0.0 else 2), wanted - copysign(other, nearest) - eta, WRIST | MOVED


def _nearest_on_arc(eta: float, arc: tuple[float, float]) -> float:
    """Return the angle nearest to `eta`, in [-pi, pi] [rad], whose absolute value is between two bounds."""
    lower, upper = arc
    nearest = min(max(abs(eta), lower), upper)
    return eta if nearest == abs(eta) else copysign(nearest, eta)


def _arc_in_reach(distance: float, radius: float, stretched: float, folded: float) -> tuple[float, float]:
    """Return the bounds of the absolute angles at which a point on a circle is in reach of two links [rad].

    The angle is 0 at the point farthest from the links' root, which is at a distance from the circle's centre.
    """
    scale = 2.0 * distance * radius
    if scale < 1e-12:
        return 0.0, pi
    rest = distance * distance + radius * radius
    lower = acos(min(1.0, max(-1.0, (stretched**2 - rest) / scale)))
    return lower, acos(min(1.0, max(-1.0, (folded**2 - rest) / scale)))


def _verified(found: list[Row], miss: int, reaches: Callable[[Sequence[float]], bool]) -> tuple[list[Row], int]:
    """Drop the solutions in which something was clamped or moved and that do not reach."""
    kept = [solution for solution in found if not solution[FLAGS] or reaches(solution[ANGLES])]
    if len(kept) < len(found):
        miss |= Miss.RESIDUAL
    return kept, int(miss if found or miss else Miss.SHOULDER_CYLINDER)


def reaches_pose(q: Sequence[float], g: URGeometry, wanted: Rows, tol: float) -> bool:
    """Return whether position [m] and orientation (largest difference of a rotation entry) are within `tol`."""
    got = ur_fk(q, g)
    position = hypot(*(g[3] - w[3] for g, w in zip(got, wanted, strict=True)))
    return max(position, *(abs(g[j] - w[j]) for g, w in zip(got, wanted, strict=True) for j in range(3))) <= tol


def _axis_missed_by(got: Rows, position: Sequence[float], axis: Sequence[float], reach: float) -> float:
    """Larger of position [m] and direction error [rad]."""
    offset = hypot(*(row[3] + reach * row[2] - p for row, p in zip(got, position, strict=True)))
    return max(offset, hypot(*(row[2] - a for row, a in zip(got, axis, strict=True))))
