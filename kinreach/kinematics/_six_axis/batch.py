"""The closed forms of `DecoupledArm` for many poses at once, in numpy."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics._angles import TURN
from kinreach.kinematics._chain import blocks
from kinreach.kinematics._six_axis.closed_form import CLOSE, ZERO, DecoupledArm
from kinreach.kinematics._ur.batch import flange_entries
from kinreach.kinematics._ur.closed_form import NEAR_WRIST
from kinreach.kinematics._ur.geometry import BRANCHES

#: Where the square of a sine is less, a shoulder, elbow or wrist is left to `DecoupledArm.solve`.
NEAR = 1e-8

_Mask = NDArray[np.bool_]


def solve_poses(arm: DecoupledArm, T: Floats, tol: float, *, off: float = 0.0) -> tuple[Floats, _Mask, _Mask]:
    """Compute every posture for many poses of the tip, except singular ones.

    Args:
        arm: The arm.
        T: Poses in the base frame, rotations orthonormal, shape (m, 4, 4).
        tol: As in `DecoupledArm.solve`.
        off: How far the poses of the arm may be off [m, rad]. What changes the number of postures is singular, too.

    Returns:
        Postures by branch, shape (6, 8, m), NaN where there is none; which there are, shape (8, m); and which poses
        are singular, or have to be solved one by one for another reason, shape (m,).
    """
    q, valid = np.empty((6, BRANCHES, len(T))), np.empty((BRANCHES, len(T)), dtype=np.bool_)
    doubtful = np.ones(len(T), dtype=np.bool_)
    if arm.by_shoulder:
        for rows in blocks(len(T)):
            doubtful[rows] = _regular(arm, T[rows], q[..., rows], valid[:, rows], tol, off)
    q[..., doubtful], valid[:, doubtful] = np.nan, False
    return q, valid, doubtful


def _regular(arm: DecoupledArm, T: Floats, q: Floats, valid: _Mask, tol: float, off: float) -> _Mask:
    """Fill in the postures of poses; returns the poses for which that needs more care."""
    entries = flange_entries(np.ascontiguousarray(T[:, :3].reshape(-1, 12).T), arm.before, arm.after)
    x, y, z = entries[3::4]
    columns = entries.reshape(3, 4, -1)[:, :3]
    ca1, sa1, amiss = arm.ca1, arm.sa1, max(tol, CLOSE)
    with np.errstate(invalid="ignore", divide="ignore"):
        across = (ca1 * z - arm.height) / sa1
        v = ca1 * across + sa1 * z
        r2 = x * x + y * y
        m2 = r2 - across * across
        r = np.sqrt(r2)
        doubtful = (m2 <= NEAR * r2 + ZERO * ZERO) & (r >= np.abs(across) - amiss) | (np.abs(m2) < 4.0 * off * r)
        doubtful |= r <= amiss  # joint 1 is free, or almost
        along = np.sqrt(m2)
        reached = m2 > 0.0
        moved: Floats | float = 0.0
        turned: Floats | float = 0.0
        if off:
            moved, turned = off * (1.0 + (r + np.abs(across)) / along), off * (1.0 + 1.0 / along)
        for shoulder, m in ((0, along), (4, -along)):
            c1, s1 = (x * m + y * across) / r2, (y * m - x * across) / r2
            q[0, shoulder : shoulder + 4] = np.arctan2(s1, c1)
            turn = _behind(columns, c1, s1, ca1, sa1)
            if arm.spherical:
                for elbow, bent, c23, s23, q2, q3 in _elbows(arm, m - arm.a1, v, tol, moved, doubtful):
                    behind = _behind(turn, c23, s23, arm.ca3, arm.sa3)
                    bends = turned + moved / (arm.fore * np.abs(np.sin(q3 + arm.fore_angle))) if off else off
                    for wrist, turns, q4, _, _, q5, q6 in _wrists(arm, behind, tol, bends, doubtful):
                        branch = shoulder + wrist + elbow
                        valid[branch] = reached & bent & turns
                        for joint, angle in enumerate((q2, q3, q4, q5, q6), 1):
                            q[joint, branch] = angle
            else:
                for wrist, turns, q234, c, s, q5, q6 in _wrists(arm, turn, tol, turned, doubtful):
                    x4, y4 = arm.a4, -arm.sa4 * arm.d5
                    u, w = m - arm.a1 - c * x4 + s * y4, v - s * x4 - c * y4
                    through = moved + turned * arm.hand / np.abs(arm.sa4 * arm.sa5 * np.sin(q5)) if off else off
                    for elbow, bent, _, _, q2, q3 in _elbows(arm, u, w, tol, through, doubtful):
                        branch = shoulder + wrist + elbow
                        valid[branch] = reached & bent & turns
                        for joint, angle in enumerate((q2, q3, q234 - q2 - q3, q5, q6), 1):
                            q[joint, branch] = angle
        blank = np.where(valid, 0.0, np.nan)
        for angles, offset, sign in zip(q, arm.dh.offset.tolist(), arm.dh.sign.tolist(), strict=True):
            angles -= offset
            angles *= sign
            angles += blank
            turns = angles * (1.0 / TURN)
            np.rint(turns, out=turns)
            turns *= TURN
            angles -= turns
    return doubtful


def _behind(columns: Floats, c: Floats, s: Floats, ca: float, sa: float) -> Floats:
    """Rotations (3, 3, m) as seen behind a joint with cosine c and sine s, and an angle between axes."""
    x, y, z = columns
    turned = np.empty_like(columns)
    turned[0] = c * x + s * y
    y = c * y - s * x
    turned[1] = ca * y + sa * z
    turned[2] = ca * z - sa * y
    return turned


def _elbows(
    arm: DecoupledArm, u: Floats, v: Floats, tol: float, off: Floats | float, doubtful: _Mask
) -> Iterator[tuple[int, _Mask, Floats, Floats, Floats, Floats]]:
    """Both elbows: branch, which reach, cosine and sine of q2 + q3, q2 and q3. Adds to the doubtful poses."""
    upper, fore, amiss = arm.upper, arm.fore, max(tol, CLOSE)
    rho2 = u * u + v * v
    c3 = (rho2 - upper * upper - fore * fore) / (2.0 * upper * fore)
    s2 = 1.0 - c3 * c3
    rho = np.sqrt(rho2)
    doubtful |= (s2 <= NEAR) & (rho <= arm.stretched + amiss) & (rho >= arm.folded - amiss) | (
        np.abs(s2) < 4.0 * off * arm.stretched / (upper * fore)
    )
    bent = s2 > 0.0
    s3 = np.sqrt(s2)
    cf, sf = np.cos(arm.fore_angle), np.sin(arm.fore_angle)
    along, aside, q3 = upper + fore * c3, fore * s3, np.arctan2(s3, c3)
    for elbow, side, third in ((0, aside, q3), (1, -aside, -q3)):
        c2, s2 = (u * along + v * side) / rho2, (v * along - u * side) / rho2
        c, s = (u - upper * c2) / fore, (v - upper * s2) / fore
        yield elbow, bent, c * cf + s * sf, s * cf - c * sf, np.arctan2(s2, c2), third - arm.fore_angle


def _wrists(
    arm: DecoupledArm, turn: Floats, tol: float, off: Floats | float, doubtful: _Mask
) -> Iterator[tuple[int, _Mask, Floats, Floats, Floats, Floats, Floats]]:
    """Both wrists: branch, which turn, q4, its cosine and sine, q5 and q6. Adds to the doubtful poses."""
    (_, _, n13), (_, _, n23), (n31, n32, n33) = turn
    ca4, sa4, ca5, sa5 = arm.ca4, arm.sa4, arm.ca5, arm.sa5
    square = n13 * n13 + n23 * n23
    doubtful |= square < np.maximum(max(NEAR_WRIST, tol), off) ** 2
    c5 = (ca4 * ca5 - n33) / (sa4 * sa5)
    s2 = square if arm.right_angles else 1.0 - c5 * c5
    if not arm.right_angles:
        doubtful |= (s2 <= NEAR) & (np.abs(sa4 * sa5) * (np.abs(c5) - 1.0) <= max(tol, CLOSE)) | (
            np.abs(s2 * sa4 * sa5) < 4.0 * off
        )
    turns, s5 = s2 > 0.0, np.sqrt(s2)
    q5 = np.arctan2(s5, c5)
    f, h = -ca4 * c5 * sa5 - sa4 * ca5, sa4 * c5 * ca5 + ca4 * sa5
    for wrist, sine, middle in ((0, s5, q5), (2, -s5, -q5)):
        g, k = sine * sa5, sine * sa4
        c, s = (n13 * g + n23 * f) / square, (n23 * g - n13 * f) / square
        q4, q6 = np.arctan2(s, c), np.arctan2(n31 * h - n32 * k, n31 * k + n32 * h)
        yield wrist, turns, q4, c, s, middle, q6
        if arm.right_angles:  # the other wrist is the same one, turned by half a turn at either end
            yield 2, turns, q4 + pi, -c, -s, -middle, q6 + pi
            return
