"""Which part of a UR keeps each branch from a pose, and by how much."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt

from kinreach.kinematics.ur.geometry import Miss, Rows, URGeometry

BRANCHES = 8


@dataclass(frozen=True)
class Shortfall:
    """Why a branch has no posture.

    Attributes:
        part: What keeps it: the shoulder's cylinder, the stretched or the folded elbow.
        needed: The distance that the pose asks of that part [m]: of the wrist centre from the first axis, or between
            shoulder and wrist_1.
        bound: The nearest distance that the part allows [m].
    """

    part: Miss
    needed: float
    bound: float

    @property
    def lack(self) -> float:
        """How much is missing [m]."""
        return abs(self.needed - self.bound)


def shortfalls(rows: Rows, g: URGeometry) -> dict[int, Shortfall]:
    """Why branches have no posture, for those that have none; nothing is said where the wrist is singular.

    Args:
        rows: Pose of the flange in the DH base frame, the three upper rows.
        g: Link lengths.
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
