"""Why a UR does not reach a pose: which part of it, by how much, and the nearest pose in reach."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, pi, sqrt

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics._ur.geometry import BRANCHES, Miss, Rows, URGeometry

#: Angles of the first joint in the grid of `way_into_reach`; how many minima it refines, by grids of how many angles,
#: and how often.
TURNS, VALLEYS, FINER, TIMES = 720, 6, 21, 8
#: Distance from the elbow's borders at which the closed form always has a posture [m].
INSIDE = 1e-9


@dataclass(frozen=True)
class Shortfall:
    """Why a branch has no posture.

    Attributes:
        part: The shoulder's cylinder, the stretched or the folded elbow.
        needed: Distance that the pose needs [m]: of the wrist centre from the first axis, or between shoulder and
            wrist_1.
        bound: The nearest distance that the part allows [m].
    """

    part: Miss
    needed: float
    bound: float

    @property
    def missing(self) -> float:
        """How much is missing [m]."""
        return abs(self.needed - self.bound)


def shortfalls(rows: Rows, g: URGeometry) -> dict[int, Shortfall]:
    """Explain why branches have no posture, for those that have none; empty where the wrist is singular.

    The pose is that of the flange in the DH base frame.
    """
    (nx, ox, ax, px), (ny, oy, ay, py), (_, _, az, pz) = rows
    x, y, z = px - g.d6 * ax, py - g.d6 * ay, pz - g.d6 * az - g.d1
    r = hypot(x, y)
    if r < g.d4:
        return dict.fromkeys(range(BRANCHES), Shortfall(Miss.SHOULDER_CYLINDER, r, g.d4))
    side = sqrt(r * r - g.d4 * g.d4)
    found: dict[int, Shortfall] = {}
    for branch in range(0, BRANCHES, 2):
        m, d = (side if branch < 4 else -side) / (r * r), g.d4 / (r * r)
        s1, c1 = x * d + y * m, x * m - y * d
        s5 = hypot(nx * s1 - ny * c1, oy * c1 - ox * s1)
        if s5 == 0.0:
            continue
        k = (-g.d5 if branch & 2 else g.d5) / s5
        rho = hypot(x * c1 + y * s1 + k * az, z - k * (ax * c1 + ay * s1))
        if rho > g.stretched:
            found[branch] = found[branch + 1] = Shortfall(Miss.ELBOW_OUT, rho, g.stretched)
        elif rho < g.folded:
            found[branch] = found[branch + 1] = Shortfall(Miss.ELBOW_IN, rho, g.folded)
    return found


def way_into_reach(rows: Rows, g: URGeometry) -> Floats:
    """Compute the shortest way from a pose to one in reach with the same orientation, whatever the limits.

    For an angle of the first joint, and for either sign of sin q5, the places are a ring in a plane: the wrist centre
    is d4 from the plane through the first axis, and wrist_1, whose direction from it the orientation gives, is between
    the folded and the stretched elbow. So the distance is a function of that angle alone; its least value is found on
    a grid, then on ever finer ones.

    Returns:
        In the DH base frame [m], shape (3,); no more than `INSIDE` where the pose itself is within reach.
    """
    angles, step = np.linspace(-pi, pi, TURNS, endpoint=False), 2.0 * pi / TURNS
    square = (_shifts(rows, g, angles) ** 2).sum(axis=-1).min(axis=0)
    valleys = np.flatnonzero((square <= np.roll(square, 1)) & (square <= np.roll(square, -1)))
    middle = angles[valleys[np.argsort(square[valleys])[:VALLEYS]]]
    for _ in range(TIMES):
        tried = middle[:, None] + step * np.linspace(-1.0, 1.0, FINER)
        shifts = _shifts(rows, g, tried)
        square = (shifts**2).sum(axis=-1)
        middle = np.take_along_axis(tried, square.min(axis=0).argmin(axis=1)[:, None], axis=1)[:, 0]
        step *= 2.0 / (FINER - 1)
    return shifts.reshape(-1, 3)[square.argmin()]


def _shifts(rows: Rows, g: URGeometry, angles: Floats) -> Floats:
    """The way to the nearest place on the ring for angles (...) of the first joint [rad], shape (2, ..., 3) [m]."""
    (_, _, ax, px), (_, _, ay, py), (_, _, az, pz) = rows
    s1, c1 = np.sin(angles), np.cos(angles)
    x, y, z = px - g.d6 * ax, py - g.d6 * ay, pz - g.d6 * az - g.d1
    aside = g.d4 - (x * s1 - y * c1)
    along = ax * c1 + ay * s1
    k = np.stack([one := g.d5 / np.maximum(np.hypot(along, az), 1e-12), -one])
    u, v = x * c1 + y * s1 + k * az, z - k * along
    rho = np.maximum(np.hypot(u, v), 1e-12)
    stretch = np.clip(rho, g.folded + INSIDE, g.stretched - INSIDE) / rho - 1.0
    return np.stack([aside * s1 + stretch * u * c1, stretch * u * s1 - aside * c1, stretch * v], axis=-1)
