"""Closed-form inverse kinematics of UR-type arms: the core's (`_core/ur.c`), for the flange in the DH base frame."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from math import acos, atan2, copysign, hypot, pi

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics._angles import wrap
from kinreach.kinematics._core import NULL, Struct, doubles, ffi, lib
from kinreach.kinematics._solutions import Row
from kinreach.kinematics._ur.geometry import BRANCHES, Rows, Singularity, URGeometry

#: Below this sin q5 rounding in the pose, 1e-13 say, is magnified to more than the smallest tolerance.
NEAR_WRIST = 1e-3
#: Two values of the shoulder or the elbow that differ by less are one [rad]: rounding of 1e-13 in the pose parts those
#: of a singular posture by up to this, and what is in the middle between them is off by 1e-12 of an arm's length.
MERGED = 1e-6
SHOULDER, WRIST, ELBOW, MOVED = map(int, Singularity)
_SAME = np.eye(4)


def core_arm(g: URGeometry, *, base: Floats = _SAME, flange: Floats = _SAME) -> Struct:
    """Return the arm as the core has it, with the transforms (4, 4) from a pose's base and to its flange."""
    return Struct(
        "kr_ur", d1=g.d1, upper=-g.a2, fore=-g.a3, d4=g.d4, d5=g.d5, d6=g.d6, stretched=g.stretched, folded=g.folded,
        base=base[:3].ravel().tolist(), flange=flange[:3].ravel().tolist(),
    )  # fmt: skip


_plain = lru_cache(maxsize=64)(core_arm)


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
    T = np.array(rows, dtype=np.float64)
    seed, found, miss = np.array([0.0, 0.0, 0.0, 0.0, 0.0, q6]), np.empty((BRANCHES, BRANCHES)), ffi.new("int *")
    count = lib.kr_ur_postures(_plain(g).pointer, NULL, doubles(T), doubles(seed), tol, doubles(found), miss)
    return [(int(row[0]), int(row[1]), *row[2:]) for row in found[:count].tolist()], miss[0]


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
