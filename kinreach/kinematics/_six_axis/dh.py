"""Denavit-Hartenberg parameters of a six-axis arm, and the closed form of those that decouple (`_core/decoupled.c`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import turns_about_z
from kinreach.kinematics._core import ROW, Struct, doubles, ffi, lib

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class DenavitHartenberg:
    """The chain `T = before Z1 X1 Z2 X2 Z3 X3 Z4 X4 Z5 X5 Z6 after`.

    Zi turns about z by `theta_i = sign_i q_i + offset_i` and moves along z by `d_i`; Xi moves along x by `a_i` and
    turns about x by `alpha_i`. The first and the last `d` are in `before` and `after`.

    Attributes:
        sign: Direction of each axis, 1 or -1, shape (6,).
        offset: Angle at which a joint's theta is 0 [rad], shape (6,).
        d: Distances along the axes [m], shape (6,); the first and the last are 0.
        a: Distances between neighbouring axes [m], shape (5,).
        alpha: Angles between neighbouring axes [rad], shape (5,).
        before: Pose of the first axis in the base frame, shape (4, 4).
        after: Pose of the tip in the frame of the last joint, shape (4, 4).
    """

    sign: Floats
    offset: Floats
    d: Floats
    a: Floats
    alpha: Floats
    before: Floats
    after: Floats

    @classmethod
    def of(cls, placements: Floats, *, length: float, angle: float) -> DenavitHartenberg:
        """Read the parameters off a chain whose joints turn about their z axes.

        Args:
            placements: A0 to A6 of `T = A0 Rz(q1) A1 ... Rz(q6) A6`, shape (7, 4, 4).
            length: Distances below this are 0 [m].
            angle: Axes that are nearer to parallel than this are parallel [rad]. They point the same way then.
        """
        A, sign = placements.copy(), np.ones(6)
        for joint in range(1, 6):
            if np.hypot(*A[joint, :2, 2]) < angle and A[joint, 2, 2] < 0.0:  # the next axis is antiparallel
                A[joint], A[joint + 1], sign[joint] = A[joint] @ _FLIP, _FLIP @ A[joint + 1], -1.0
        d, offset, a, alpha = np.zeros(6), np.zeros(6), np.zeros(5), np.zeros(5)
        for joint, placement in enumerate(A[1:6]):
            turn, along, a[joint], alpha[joint], turn_after, along_after = _screws(placement, angle)
            offset[joint] += turn
            d[joint] += along
            offset[joint + 1] += turn_after
            d[joint + 1] += along_after
        for joint in range(4, 0, -1):  # along parallel axes it does not matter on which one the tip moves
            if alpha[joint] == 0.0:
                d[joint], d[joint + 1] = d[joint] + d[joint + 1], 0.0
        before, after = A[0] @ _along_z(d[0]), _along_z(d[5]) @ A[6]
        d[[0, 5]] = 0.0
        a[np.abs(a) < length] = d[np.abs(d) < length] = 0.0
        return cls(sign, offset, d, a, alpha, before, after)

    @property
    def placements(self) -> Floats:
        """A0 to A6 of `T = A0 Rz(q1) A1 ... Rz(q6) A6`, shape (7, 4, 4)."""
        links = [self.before]
        for joint, zero in enumerate(turns_about_z(self.offset)):
            flip = np.eye(4) if self.sign[joint] > 0.0 else _FLIP  # Rz(-q) = flip Rz(q) flip
            step = np.eye(4) if joint == 5 else _about_x(self.alpha[joint])
            step[0, 3] = 0.0 if joint == 5 else self.a[joint]
            links[-1] = links[-1] @ zero @ flip
            links.append(flip @ _along_z(self.d[joint]) @ step)
        links[-1] = links[-1] @ self.after
        return np.array(links)


def _screws(A: Floats, angle: float) -> tuple[float, float, float, float, float, float]:
    """A motion as Rz(turn) Tz(along) Tx(a) Rx(alpha) Rz(turn_after) Tz(along_after)."""
    p, axis = A[:3, 3], A[:3, 2]
    sine = float(np.hypot(axis[0], axis[1]))
    if sine < angle:  # parallel: the perpendicular through the next frame's origin
        a = float(np.hypot(p[0], p[1]))
        turn = float(np.arctan2(p[1], p[0])) if a > 0.0 else 0.0
        R = A[:3, :3]
        after = float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])) - turn
        return turn, float(p[2]), a, 0.0, after, 0.0
    normal = np.array([-axis[1], axis[0], 0.0]) / sine
    along, a, along_after = np.linalg.solve(np.column_stack([[0.0, 0.0, 1.0], normal, axis]), p)
    turn, alpha = float(np.arctan2(normal[1], normal[0])), float(np.arctan2(sine, axis[2]))
    rest = (_about_x(-alpha) @ turns_about_z(np.array([-turn]))[0])[:3, :3] @ A[:3, :3]
    return turn, float(along), float(a), alpha, float(np.arctan2(rest[1, 0], rest[0, 0])), float(along_after)


def _along_z(distance: float) -> Floats:
    T = np.eye(4)
    T[2, 3] = distance
    return T


def _about_x(angle: float) -> Floats:
    T = np.eye(4)
    T[1, 1] = T[2, 2] = np.cos(angle)
    T[2, 1] = np.sin(angle)
    T[1, 2] = -T[2, 1]
    return T


#: Cosines and lengths below this are 0 [m].
ZERO = 1e-12
#: Room for rows of one call of the closed form, and with samples of what is free.
ROWS, ALL_ROWS = 64, 107_000


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
    """A six-axis arm that `decouples`, or is close to one, as the core has it.

    Args:
        dh: The arm that decouples.
        placements: The upper rows of the arm's own placements, shape (7, 3, 4).

    Attributes:
        dh: The same.
        core: What the core has prepared.
        fore_angle: Angle of the second of two links at joint 3's zero [rad].
        special_axes: Axes that make it decouple, counted from 1, and what they do, with a place for an adverb.
    """

    def __init__(self, dh: DenavitHartenberg, placements: Floats) -> None:
        self.dh = dh
        before, after = np.linalg.inv(dh.before)[:3], np.linalg.inv(dh.after)[:3]
        self.core = Struct(
            "kr_decoupled", sign=dh.sign.tolist(), offset=dh.offset.tolist(), d=dh.d.tolist(), a=dh.a.tolist(),
            alpha=dh.alpha.tolist(), before=before.ravel().tolist(), after=after.ravel().tolist(),
            placements=placements.ravel().tolist(),
        )  # fmt: skip
        lib.kr_decoupled_prepare(self.core.pointer)
        self.fore_angle = float(self.core.pointer.fore_angle)
        self.special_axes: tuple[tuple[int, ...], str] = (
            ((4, 5, 6), "{}meet in a point") if self.core.pointer.spherical else ((2, 3, 4), "are {}parallel")
        )

    def sound(self, length: float, sine: float) -> bool:
        """Return whether all that results are divided by is more than a length [m] and a sine."""
        arm = self.core.pointer
        return bool(arm.length_divisor > length and arm.sine_divisor > sine)

    def rows(self, T: Floats, tol: float, seed: Floats, *, samples: bool = False) -> tuple[Floats, set[int]]:
        """Compute rows of the closed form for a pose, and which joints (0 is the first) are free.

        Args:
            T: Pose in the base frame, rotation orthonormal, shape (4, 4).
            tol: How far one part of the geometry may be missed by a posture in which something is clamped [m, rad].
            seed: Values [rad] that free joints keep, as far as they can, shape (6,).
            samples: Add rows for many values of the joints that are free.

        Returns:
            Rows (k, 8), angles in [-pi, pi]; those with flags may miss the pose.
        """
        rows, free = np.empty((ALL_ROWS if samples else ROWS, ROW)), ffi.new("int *")
        pose, start = np.ascontiguousarray(T), np.array(seed, dtype=np.float64)
        count = lib.kr_decoupled_rows(
            self.core.pointer, doubles(pose), tol, doubles(start), samples, free, doubles(rows)
        )
        return rows[:count].copy(), {joint for joint in range(6) if free[0] >> joint & 1}
