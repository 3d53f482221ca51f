"""Six-axis arms that decouple: they have a closed form, which is the core's (`_core/decoupled.c`)."""

from __future__ import annotations

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics._core import ROW, Struct, doubles, ffi, lib
from kinreach.kinematics._six_axis.dh import DenavitHartenberg

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
