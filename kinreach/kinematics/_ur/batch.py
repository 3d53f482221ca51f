"""Closed-form inverse kinematics of UR-type arms for many poses at once, on tensors of torch.

Arrays go to the core. This is a second form of its formulas, because a device of torch cannot call it; the tests hold
one against the other. Rows near a singularity are marked and left to the core, which knows how to treat them; so far
from one, an arccosine is as exact as the arctangent of two arguments, and takes a third of its time where the processor
has no vector form of either.
"""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np

from kinreach._checks import Floats, is_tensor
from kinreach._rotations import TURN
from kinreach._tensors import empty, like, namespace, parts
from kinreach.kinematics._goals import skewed
from kinreach.kinematics._ur.geometry import BRANCHES, NEAR_WRIST, URGeometry

#: A square of a sine that is less than this is left to the core: its root is not exact to 1e-11.
NEAR_ROOT = 1e-9
SHOULDER_PAN, SHOULDER_LIFT, _ELBOW, WRIST_1, WRIST_2, WRIST_3 = range(6)


def solve_poses(T: Any, left: Floats, right: Floats, g: URGeometry, *, tol: float) -> tuple[Any, Any, Any, Any]:
    """Compute all postures for many tip poses.

    Args:
        T: Poses of the tip, shape (count, 4, 4); only the three upper rows are read. An array or a tensor of doubles;
            so is what is returned.
        left: Transform from the tip pose's base to the DH base frame (4, 4).
        right: Transform from the tip to the flange (4, 4).
        g: Link lengths [m].
        tol: As for the core's `kr_ur_postures`.

    Returns:
        q [rad], shape (6, 8, count), NaN where not valid; valid, shape (8, count), in the order of the branch index;
        the rows that are left to the core, shape (count,); and those whose rotation is none, shape (count,).
    """
    count = len(T)
    q, valid = empty(T, 6, BRANCHES, count), empty(T, BRANCHES, count, flags=True)
    singular, off = empty(T, count, flags=True), empty(T, count, flags=True)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for part in parts(T):
            m = T[part, :3].reshape(-1, 12).T
            m = m.contiguous() if is_tensor(m) else np.ascontiguousarray(m)
            off[part] = skewed(m)
            singular[part] = _solve_block(flange_entries(m, left, right), g, tol, q[:, :, part], valid[:, part])
    return q, valid, singular, off


def flange_entries(m: Any, left: Floats, right: Floats) -> Any:
    """Compute entries nx, ox, ax, px, ny ... pz of left @ T @ right, shape (12, count), from those of T."""
    left = like(m, left)
    rows = (left[:3, :3] @ m.reshape(3, -1)).reshape(3, 4, -1)
    rows[:, 3] += left[:3, 3:]
    if (right != np.eye(4)).any():
        turned = like(m, right[:3].T) @ rows[:, :3]
        turned[:, 3] += rows[:, 3]
        return turned.reshape(12, -1)
    return rows.reshape(12, -1)


def _solve_block(m: Any, g: URGeometry, tol: float, q: Any, valid: Any) -> Any:
    xp = namespace(m)
    half_turn = like(m, pi)
    nx, ox, ax, px, ny, oy, ay, py, _nz, _oz, az, pz = m
    x, y, z = px - g.d6 * ax, py - g.d6 * ay, pz - g.d6 * az - g.d1
    r2 = x * x + y * y
    m2 = r2 - g.d4 * g.d4
    inside = m2 <= 0.0
    singular = (m2 < NEAR_ROOT * r2) & (r2 >= (g.d4 - tol) ** 2)
    d, side = g.d4 / r2, xp.sqrt(m2) / r2
    xd, yd, xm, ym = x * d, y * d, x * side, y * side
    for first, s1, c1 in ((0, xd + ym, xm - yd), (4, xd - ym, -yd - xm)):
        q1 = xp.arctan2(s1, c1)
        minus_u = x * c1 + y * s1
        xp.negative(minus_u, out=minus_u)
        c6, s6 = nx * s1 - ny * c1, oy * c1 - ox * s1
        s5 = xp.sqrt(c6 * c6 + s6 * s6)
        singular |= s5 <= max(tol, NEAR_WRIST)
        k = g.d5 / s5
        s, c = k * az, k * (ax * c1 + ay * s1)
        q5, q6, q234 = xp.arccos(ax * s1 - ay * c1), xp.arctan2(s6, c6), xp.arctan2(-s, -c)
        for wrist, u, v in ((first, minus_u - s, c - z), (first + 2, minus_u + s, -z - c)):
            both = slice(wrist, wrist + 2)
            reached, borderline = solve_elbow(u, v, q234, g, tol, q[SHOULDER_LIFT : WRIST_1 + 1, both])
            valid[both] = reached
            singular |= borderline
            blank = xp.where(reached, 0.0, xp.nan)
            for joint, value in ((SHOULDER_PAN, q1), (WRIST_2, q5), (WRIST_3, q6)):
                q[joint, both] = value + blank
            xp.negative(q5, out=q5)
            q6 -= xp.copysign(half_turn, q6)
            q234 -= xp.copysign(half_turn, q234)
    valid &= ~inside
    return singular


def solve_elbow(
    u: Any,
    v: Any,
    q234: Any,
    g: URGeometry,
    tol: float,
    q: Any,
) -> tuple[Any, Any]:
    """Fill in q2, q3, q4 of both elbows, q of shape (3, 2, count).

    (u, v) points from wrist_1 to the shoulder, in the arm's plane. Returns what is reached, the rest of q being NaN,
    and what is stretched or folded so far that the core has to decide.
    """
    xp = namespace(u)
    rho2 = u * u
    rho2 += v * v
    c3 = rho2 - (g.a2 * g.a2 + g.a3 * g.a3)
    c3 *= 1.0 / (2 * g.a2 * g.a3)
    s3 = c3 * c3
    s3 = 1.0 - s3
    reached = s3 > 0.0
    borderline = (s3 < NEAR_ROOT) & (rho2 <= (g.stretched + tol) ** 2) & (rho2 >= (g.folded - tol) ** 2)
    xp.arccos(c3, out=q[1, 0])
    xp.negative(q[1, 0], out=q[1, 1])
    xp.sqrt(s3, out=s3)
    rise, run = -g.a3 * s3, -g.a2 - g.a3 * c3
    phi, psi = xp.arctan2(v, u), xp.arctan(rise / run) if g.a2 < g.a3 else xp.arctan2(rise, run)
    xp.subtract(phi, psi, out=q[0, 0])
    xp.add(phi, psi, out=q[0, 1])
    rest, bend = q234 - phi, psi - q[1, 0]
    xp.add(rest, bend, out=q[2, 0])
    xp.subtract(rest, bend, out=q[2, 1])
    turns = q[::2] * (1.0 / TURN)
    xp.round(turns, out=turns)
    turns *= TURN
    q[::2] -= turns
    return reached, borderline
