"""Closed-form inverse kinematics of UR-type arms: the core's (`_core/ur.c`), for the flange in the DH base frame."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics._core import NULL, Struct, doubles, ffi, lib
from kinreach.kinematics._solutions import Row
from kinreach.kinematics._ur.geometry import BRANCHES, Rows, URGeometry

#: Below this sin q5 rounding in the pose, 1e-13 say, is magnified to more than the smallest tolerance.
NEAR_WRIST = 1e-3
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
