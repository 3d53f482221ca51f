"""Closed-form inverse kinematics of a turning base with a planar two-link arm, as pure functions on floats.

The third link's tip has to be at a point. In the frame that turns with the first joint the tip's sideways offset L
is constant, so that -x sin q1 + y cos q1 = L gives two values of q1 (front and back); in the plane of the links the
law of cosines gives two values of the elbow. The branch index is `2 * back + elbow`, elbow 0 for the bend
that turns the same way as the joint's positive direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntFlag
from math import atan2, copysign, hypot, pi, sqrt
from typing import Any

from kinreach.errors import InputError

TURN = 2 * pi
#: One solution: code (branch index + 8 * `Singularity` flags), and the three joint angles [rad] in [-pi, pi].
Branch = tuple[int, float, float, float]


class Singularity(IntFlag):
    """What was clamped or free in a solution."""

    #: The target lies on the cylinder of radius |L| around the first axis: front and back are one.
    BASE = 1
    #: The elbow is stretched or folded: both bends are one.
    ELBOW = 2


class Miss(IntFlag):
    """What kept a branch from reaching."""

    BASE_CYLINDER = 1
    ELBOW_OUT = 2
    ELBOW_IN = 4


_MISS_TEXT = {
    Miss.BASE_CYLINDER: "closer to the first axis than the arm's sideways offset",
    Miss.ELBOW_OUT: "too far away for the stretched elbow",
    Miss.ELBOW_IN: "too close for the folded elbow",
}


def miss_text(miss: int) -> str:
    """What kept the arm from a target, in words; empty for no flags."""
    return "; ".join(text for flag, text in _MISS_TEXT.items() if miss & flag)


@dataclass(frozen=True)
class YawPlanarGeometry:
    """Lengths of a base that turns about z and two links that turn about y.

    Attributes:
        shoulder: Second axis in the turning frame: x, and z above the base [m].
        upper: Second axis to third, in the plane (x, z) at zero angles [m].
        fore: Third axis to the tip, likewise [m].
        offset: Sideways offset L of the tip along y of the turning frame [m].
        upper_polar, fore_polar: Length [m] of either link, and its angle from z towards x [rad], the direction in
            which a joint about y turns.
    """

    shoulder: tuple[float, float]
    upper: tuple[float, float]
    fore: tuple[float, float]
    offset: float
    upper_polar: tuple[float, float] = field(init=False)
    fore_polar: tuple[float, float] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "upper_polar", (hypot(*self.upper), atan2(*self.upper)))
        object.__setattr__(self, "fore_polar", (hypot(*self.fore), atan2(*self.fore)))

    @classmethod
    def from_model(cls, model: Any, tip_frame: int) -> YawPlanarGeometry:
        """Read the lengths from a Pinocchio model with joints about z, y, y.

        Raises:
            InputError: The model is not of this kind.
        """
        kinds = [model.joints[i].shortname() for i in range(1, model.njoints)]
        if kinds != ["JointModelRZ", "JointModelRY", "JointModelRY"]:
            raise InputError(f"needs joints about z, y, y; the model has {kinds}")
        base, shoulder, elbow = (model.jointPlacements[i].translation for i in range(1, 4))
        tip = model.frames[tip_frame].placement.translation
        return cls(
            shoulder=(float(shoulder[0]), float(base[2] + shoulder[2])),
            upper=(float(elbow[0]), float(elbow[2])),
            fore=(float(tip[0]), float(tip[2])),
            offset=float(shoulder[1] + elbow[1] + tip[1]),
        )


def solve_position(p: Sequence[float], g: YawPlanarGeometry, *, tol: float = 1e-7) -> tuple[list[Branch], int]:
    """All postures that put the tip at a point.

    Args:
        p: Point in the frame of the base [m], three numbers.
        g: Lengths.
        tol: How far a point may be outside the reach of the joints and still be taken as on its border [m].

    Returns:
        The solutions in the order of their branch index, and the `Miss` flags of the branches that have none.
    """
    x, y, z = p
    (a, angle_a), (b, angle_b) = g.upper_polar, g.fore_polar
    r, v = hypot(x, y), z - g.shoulder[1]
    if r < abs(g.offset) - tol:
        return [], int(Miss.BASE_CYLINDER)
    if r > abs(g.offset):
        m = sqrt((r - g.offset) * (r + g.offset))
        sides: tuple[tuple[int, float], ...] = ((0, m), (2, -m))
    else:
        sides = ((8 * int(Singularity.BASE), 0.0),)
    found: list[Branch] = []
    miss = 0
    for code, radial in sides:
        u = radial - g.shoulder[0]
        rho = hypot(u, v)
        if rho > a + b + tol:
            miss |= Miss.ELBOW_OUT
            continue
        if rho < abs(a - b) - tol:
            miss |= Miss.ELBOW_IN
            continue
        cosine = (rho * rho - a * a - b * b) / (2.0 * a * b)
        q1, phi = wrap(atan2(y, x) - atan2(g.offset, radial)), atan2(u, v) - angle_a
        if -1.0 < cosine < 1.0:
            sine = sqrt(1.0 - cosine * cosine)
            bends: tuple[tuple[int, float], ...] = ((0, sine), (1, -sine))
        else:
            cosine, bends = copysign(1.0, cosine), ((8 * int(Singularity.ELBOW), 0.0),)
        for elbow, sine in bends:
            q2 = wrap(phi - atan2(b * sine, a + b * cosine))
            q3 = wrap(atan2(sine, cosine) - (angle_b - angle_a))
            found.append((code + elbow, q1, q2, q3))
    return found, int(miss)


def wrap(angle: float) -> float:
    """The angle in [-pi, pi]."""
    return angle - TURN * round(angle / TURN)
