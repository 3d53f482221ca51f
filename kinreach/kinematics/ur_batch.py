"""Closed-form inverse kinematics of UR-type arms for many poses at once, in numpy.

The same formulas as `ur_ik`, on structure-of-arrays blocks that stay in the cache. Rows that come near a singularity
are marked and left to `ur_ik`, which knows how to treat them.
"""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

from kinreach.kinematics.goals import Floats
from kinreach.kinematics.ur_geometry import URGeometry

TURN = 2 * pi
BLOCK = 2048
BRANCHES = 8


def solve_poses(m: Floats, g: URGeometry, *, tol: float) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
    """All postures for many flange poses.

    Args:
        m: The twelve entries nx, ox, ax, px, ny, ... pz of each pose in the DH base frame, shape (12, count).
        g: Link lengths [m].
        tol: As for `ur_ik.solve_pose`.

    Returns:
        q [rad], shape (6, 8, count), meaningless where not valid; valid, shape (8, count), in the order of the
        branch index; and the rows that need `ur_ik.solve_pose`, shape (count,).
    """
    count = m.shape[1]
    q = np.empty((6, BRANCHES, count))
    valid = np.empty((BRANCHES, count), dtype=np.bool_)
    singular = np.empty(count, dtype=np.bool_)
    with np.errstate(invalid="ignore", divide="ignore"):
        for start in range(0, count, BLOCK):
            part = slice(start, start + BLOCK)
            singular[part] = _solve_block(m[:, part], g, tol, q[:, :, part], valid[:, part])
    return q, valid, singular


def _solve_block(m: Floats, g: URGeometry, tol: float, q: Floats, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    nx, ox, ax, px, ny, oy, ay, py, nz, oz, az, pz = m
    x, y, z = px - g.d6 * ax, py - g.d6 * ay, pz - g.d6 * az - g.d1
    r2 = x * x + y * y
    m2 = r2 - g.d4 * g.d4
    inside = m2 <= 0.0
    singular = inside & (r2 >= (g.d4 - tol) ** 2)
    d, side = g.d4 / r2, np.sqrt(m2) / r2
    xd, yd, xm, ym = x * d, y * d, x * side, y * side
    for shoulder, (s1, c1) in enumerate(((xd + ym, xm - yd), (xd - ym, -yd - xm))):
        first = 4 * shoulder
        q1, u = np.arctan2(s1, c1), x * c1 + y * s1
        c6, s6 = nx * s1 - ny * c1, oy * c1 - ox * s1
        s5 = np.sqrt(c6 * c6 + s6 * s6)
        singular |= s5 <= tol
        k = g.d5 / s5
        s, c = k * az, k * (ax * c1 + ay * s1)
        q5, q6, q234 = np.arctan2(s5, ax * s1 - ay * c1), np.arctan2(s6, c6), np.arctan2(-s, -c)
        q[0, first : first + 4] = q1
        q[4, first : first + 2] = q5
        q[4, first + 2 : first + 4] = -q5
        q[5, first : first + 2] = q6
        q[5, first + 2 : first + 4] = _opposite(q6)
        _solve_elbow(u + s, z - c, q234, g, tol, q[:, first : first + 2], valid[first : first + 2], singular)
        flipped = slice(first + 2, first + 4)
        _solve_elbow(u - s, z + c, _opposite(q234), g, tol, q[:, flipped], valid[flipped], singular)
    valid &= ~inside
    return singular


def _solve_elbow(
    u: Floats,
    v: Floats,
    q234: Floats,
    g: URGeometry,
    tol: float,
    q: Floats,
    valid: NDArray[np.bool_],
    singular: NDArray[np.bool_],
) -> None:
    """Fill in q2, q3, q4 of both elbows, q of shape (6, 2, count); adds to `singular`."""
    rho2 = u * u + v * v
    c3 = (rho2 - (g.a2 * g.a2 + g.a3 * g.a3)) / (2 * g.a2 * g.a3)
    reached = np.abs(c3) < 1.0
    valid[:] = reached
    edge = ~reached
    if edge.any():
        singular |= edge & (rho2 <= (g.stretched + tol) ** 2) & (rho2 >= (g.folded - tol) ** 2)
    s3 = np.sqrt(1.0 - c3 * c3)
    q3 = np.arctan2(s3, c3)
    phi, psi = np.arctan2(-v, -u), np.arctan2(-g.a3 * s3, -g.a2 - g.a3 * c3)
    rest, bend = q234 - phi, psi - q3
    q[1, 0] = phi - psi
    q[1, 1] = phi + psi
    q[2, 0] = q3
    q[2, 1] = -q3
    q[3, 0] = rest + bend
    q[3, 1] = rest - bend
    q[1] -= TURN * np.rint(q[1] * (1.0 / TURN))
    q[3] -= TURN * np.rint(q[3] * (1.0 / TURN))


def _opposite(angle: Floats) -> Floats:
    """The angle plus or minus pi, in [-pi, pi]."""
    return angle - np.copysign(pi, angle)
