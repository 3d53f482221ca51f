"""Closed-form inverse kinematics of a turning base with a planar two-link arm, in numpy, for one or many targets.

The third link's tip has to be at a point. In the frame that turns with the first joint the tip's sideways offset L
is constant, so that -x sin q1 + y cos q1 = L gives two values of q1 (front and back); in the plane of the links the
law of cosines gives two values of the elbow. The branch index is `2 * back + elbow`, elbow 0 for the bend
that turns the same way as the joint's positive direction.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach.errors import InputError
from kinreach.kinematics.goals import Floats

BRANCHES = 4


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
    """

    shoulder: tuple[float, float]
    upper: tuple[float, float]
    fore: tuple[float, float]
    offset: float

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


def solve_positions(
    p: Floats, g: YawPlanarGeometry, *, tol: float = 1e-7
) -> tuple[Floats, NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
    """All postures that put the tip at each of many points.

    Args:
        p: Points in the frame of the base [m], shape (3, count).
        g: Lengths.
        tol: How far a point may be outside the reach of the joints and still be taken as on its border [m].

    Returns:
        q [rad] in [-pi, pi], shape (3, 4, count), NaN where not valid; valid, shape (4, count); `Singularity`
        flags, shape (4, count); and `Miss` flags of each point, shape (count,).
    """
    with np.errstate(over="ignore", invalid="ignore"):  # points at astronomic distances are just out of reach
        return _solve(p, g, tol)


def _solve(
    p: Floats, g: YawPlanarGeometry, tol: float
) -> tuple[Floats, NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
    x, y, z = p
    r = np.hypot(x, y)
    near = r <= abs(g.offset)
    outside = r < abs(g.offset) - tol
    m = np.sqrt(np.maximum(r * r - g.offset**2, 0.0))
    heading, v = np.arctan2(y, x), z - g.shoulder[1]
    (a, angle_a), (b, angle_b) = _polar(g.upper), _polar(g.fore)
    q = np.empty((3, BRANCHES, p.shape[1]))
    valid = np.empty((BRANCHES, p.shape[1]), dtype=np.bool_)
    flags = np.zeros((BRANCHES, p.shape[1]), dtype=np.int64)
    miss = np.where(outside, int(Miss.BASE_CYLINDER), 0)
    for back, radial in enumerate((m, -m)):
        u = radial - g.shoulder[0]
        rho = np.hypot(u, v)
        too_far, too_near = rho > a + b + tol, rho < abs(a - b) - tol
        cosine = (rho * rho - a * a - b * b) / (2 * a * b)
        edge = np.abs(cosine) >= 1.0
        bend = np.arccos(np.clip(cosine, -1.0, 1.0))
        reached = ~(outside | too_far | too_near) & ~(near & (back == 1))
        miss |= np.where(outside, 0, np.where(too_far, int(Miss.ELBOW_OUT), np.where(too_near, int(Miss.ELBOW_IN), 0)))
        for elbow, theta in enumerate((bend, -bend)):
            branch = 2 * back + elbow
            q[0, branch] = heading - np.arctan2(g.offset, radial)
            q[1, branch] = np.arctan2(u, v) - angle_a - np.arctan2(b * np.sin(theta), a + b * np.cos(theta))
            q[2, branch] = theta - (angle_b - angle_a)
            valid[branch] = reached & ~(edge & (elbow == 1))
            flags[branch] = np.where(near, int(Singularity.BASE), 0) | np.where(edge, int(Singularity.ELBOW), 0)
    q -= 2 * np.pi * np.rint(q / (2 * np.pi))
    np.copyto(q, np.nan, where=~valid)
    return q, valid, flags, miss


def _polar(vector: tuple[float, float]) -> tuple[float, float]:
    """Length and angle from z towards x, the direction in which a joint about y turns."""
    return float(np.hypot(*vector)), float(np.arctan2(*vector))
