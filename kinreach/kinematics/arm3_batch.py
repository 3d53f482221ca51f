"""Closed-form inverse kinematics of a turning base with a planar two-link arm for many targets at once, in numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinreach.kinematics.arm3_ik import TURN, YawPlanarGeometry
from kinreach.kinematics.goals import Floats

BRANCHES = 4


def solve_positions(p: Floats, g: YawPlanarGeometry, *, tol: float = 1e-7) -> tuple[Floats, NDArray[np.bool_]]:
    """All postures that put the tip at each of many points; the formulas are those of `arm3_ik.solve_position`.

    Args:
        p: Points in the frame of the base [m], shape (3, count).
        g: Lengths.
        tol: How far a point may be outside the reach of the joints and still be taken as on its border [m].

    Returns:
        q [rad] in [-pi, pi], shape (3, 4, count), NaN where not valid; and valid, shape (4, count).
    """
    with np.errstate(over="ignore", invalid="ignore"):  # points at astronomic distances are just out of reach
        return _solve(p, g, tol)


def _solve(p: Floats, g: YawPlanarGeometry, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
    x, y, z = p
    r = np.hypot(x, y)
    near = r <= abs(g.offset)
    outside = r < abs(g.offset) - tol
    m = np.sqrt(np.maximum(r * r - g.offset**2, 0.0))
    heading, v = np.arctan2(y, x), z - g.shoulder[1]
    (a, angle_a), (b, angle_b) = g.upper_polar, g.fore_polar
    q = np.empty((3, BRANCHES, p.shape[1]))
    valid = np.empty((BRANCHES, p.shape[1]), dtype=np.bool_)
    for back, radial in enumerate((m, -m)):
        u = radial - g.shoulder[0]
        rho = np.hypot(u, v)
        too_far, too_near = rho > a + b + tol, rho < abs(a - b) - tol
        cosine = (rho * rho - a * a - b * b) / (2 * a * b)
        edge = np.abs(cosine) >= 1.0
        bend = np.arccos(np.clip(cosine, -1.0, 1.0))
        reached = ~(outside | too_far | too_near) & ~(near & (back == 1))
        for elbow, theta in enumerate((bend, -bend)):
            branch = 2 * back + elbow
            q[0, branch] = heading - np.arctan2(g.offset, radial)
            q[1, branch] = np.arctan2(u, v) - angle_a - np.arctan2(b * np.sin(theta), a + b * np.cos(theta))
            q[2, branch] = theta - (angle_b - angle_a)
            valid[branch] = reached & ~(edge & (elbow == 1))
    q -= TURN * np.rint(q / TURN)
    np.copyto(q, np.nan, where=~valid)
    return q, valid
