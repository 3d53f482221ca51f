"""Link lengths of a UR-type arm, read from its model, and its chain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntFlag

import numpy as np

from kinreach._checks import Floats
from kinreach.errors import InputError
from kinreach.kinematics._chain import SerialChain
from kinreach.kinematics._core import Struct

#: Postures of a pose: two of the shoulder, of the wrist and of the elbow.
BRANCHES = 8

#: Below this sin q5 rounding in the pose, 1e-13 say, is magnified to more than the smallest tolerance.
NEAR_WRIST = 1e-3
_UNIT = np.eye(4)
#: The three upper rows of a homogeneous transform, ((nx, ox, ax, px), (ny, oy, ay, py), (nz, oz, az, pz)).
Rows = Sequence[Sequence[float]]


@dataclass(frozen=True)
class URGeometry:
    """Denavit-Hartenberg lengths of a UR-type arm [m] (Hawkins, Analytic inverse kinematics for the UR-5/UR-10, 2013).

    `a2` and `a3` are negative in this convention. Calibrated arms have their own values.

    Attributes:
        stretched: Distance from shoulder to wrist_1 with the elbow straight [m].
        folded: Distance from shoulder to wrist_1 with the elbow folded [m].
        packed: d1, |a2|, |a3|, d5, d6, d4, a2^2 + a3^2, 2 a2 a3, in this order, for the solvers' inner loops.
    """

    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float
    stretched: float = field(init=False)
    folded: float = field(init=False)
    packed: tuple[float, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        d1, a2, a3, d4, d5, d6 = lengths = (self.d1, self.a2, self.a3, self.d4, self.d5, self.d6)
        if not (math.isfinite(sum(lengths)) and a2 < 0 and a3 < 0 and d4 > 0):
            raise InputError(f"not the lengths of a UR-type arm (a2 < 0, a3 < 0, d4 > 0): {lengths}")
        set_field = object.__setattr__
        set_field(self, "stretched", abs(a2) + abs(a3))
        set_field(self, "folded", abs(abs(a2) - abs(a3)))
        set_field(self, "packed", (d1, -a2, -a3, d5, d6, d4, a2 * a2 + a3 * a3, 2 * a2 * a3))

    @property
    def chain(self) -> SerialChain:
        """From the DH base frame to the flange."""
        *placements, flange = ur_placements((self.d1, self.a2, self.a3, self.d4, self.d5, self.d6))
        return SerialChain(placements, [np.array([0.0, 0.0, 1.0])] * len(placements), flange)

    @classmethod
    def from_axes(cls, origins: Floats, axes: Floats, flange: Floats) -> URGeometry:
        """Read the lengths off the joints' axes with all joints at 0, however their frames are placed along them.

        Lengths are rounded to 1e-10 m: URDFs write pi/2 with few digits.

        Args:
            origins: A point of each axis in the arm's base frame [m], shape (6, 3).
            axes: Directions of the axes there, shape (6, 3).
            flange: Origin of the flange there, or a point beside it as far along the last axis [m], shape (3,).

        Raises:
            InputError: These are not six axes, or not the lengths of a UR.
        """
        if len(axes) != 6:
            raise InputError(f"a UR-type arm has 6 joints, the model has {len(axes)}")
        up, across = axes[0], axes[1]  # of the shoulder, and of the three parallel axes
        plane = np.eye(3) - np.outer(across, across)
        upper, fore = (np.linalg.norm(plane @ (origins[i + 1] - origins[i])) for i in (1, 2))
        lengths = (
            origins[1] @ up,
            -upper,
            -fore,
            abs((origins[4] - origins[0]) @ across),
            abs((origins[5] - origins[3]) @ up),
            abs((flange - origins[4]) @ across),
        )
        return cls(*(round(float(length), 10) for length in lengths))


def core_arm(g: URGeometry, *, base: Floats = _UNIT, flange: Floats = _UNIT) -> Struct:
    """Return the arm as the core has it, with the transforms (4, 4) from a pose's base and to its flange."""
    return Struct(
        "kr_ur", d1=g.d1, upper=-g.a2, fore=-g.a3, d4=g.d4, d5=g.d5, d6=g.d6, stretched=g.stretched, folded=g.folded,
        base=base[:3].ravel().tolist(), flange=flange[:3].ravel().tolist(),
    )  # fmt: skip


def ur_placements(lengths: Sequence[float]) -> Floats:
    """Return A0 to A6 of the flange in the DH base frame, `T = A0 Rz(q1) A1 ... Rz(q6) A6`, shape (7, 4, 4).

    Args:
        lengths: d1, a2, a3, d4, d5 and d6 [m].
    """
    d1, a2, a3, d4, d5, d6 = lengths
    right = np.pi / 2
    steps = ((right, 0.0, d1), (0.0, a2, 0.0), (0.0, a3, 0.0), (right, 0.0, d4), (-right, 0.0, d5), (0.0, 0.0, d6))
    placements = [np.eye(4)]
    for alpha, a, d in steps:
        c, s = np.cos(alpha), np.sin(alpha)
        placements.append(np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, d], [0, 0, 0, 1]]))
    return np.array(placements)


class Singularity(IntFlag):
    """What was clamped, free or moved in a solution."""

    #: P5 lies on the cylinder of radius d4 around the first axis: both shoulder values are one.
    SHOULDER = 1
    #: sin q5 = 0: wrist_3 is parallel to the three middle axes, q6 was chosen.
    WRIST = 2
    #: The elbow is stretched or folded: both elbow values are one.
    ELBOW = 4
    #: q6 could not keep the caller's value and was moved to the nearest feasible one.
    MOVED = 8


class Miss(IntFlag):
    """Which part of the geometry kept a branch from reaching."""

    SHOULDER_CYLINDER = 1
    ELBOW_OUT = 2
    ELBOW_IN = 4
    RESIDUAL = 8
    CALIBRATION = 16


_MISS_TEXT = {
    Miss.SHOULDER_CYLINDER: "too close to the base's axis (wrist centre inside the shoulder cylinder)",
    Miss.ELBOW_OUT: "too far away for the stretched elbow",
    Miss.ELBOW_IN: "too close for the folded elbow",
    Miss.CALIBRATION: "at the border of what this calibrated arm reaches, and beyond it",
    Miss.RESIDUAL: "a clamped solution misses the target by more than the tolerance",
}


def miss_text(miss: int) -> str:
    return "; ".join(text for flag, text in _MISS_TEXT.items() if miss & flag)
