"""How far a six-axis arm reaches, to name why it has no posture for a pose."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics._general_6r import COEFFICIENTS, SAMPLES, Chain

#: Postures from which the longest and the shortest reach are looked for, and how often each joint is turned.
STARTS, ROUNDS = 48, 25
#: How much further or nearer than the arm reaches a point has to be to be called out of reach [m].
ROUNDING = 1e-6


class WristReach:
    """Distances between an arm's shoulder and its wrist.

    The shoulder is the point of axis 1 that is nearest to axis 2, the wrist that of axis 6 nearest to axis 5. Neither
    joint 1 nor joint 6 changes their distance.
    """

    def __init__(self, placements: Floats) -> None:
        first, last = placements.copy(), np.linalg.inv(placements[5])
        self._shoulder = first[0, :3, 3] + first[0, :3, 2] * _nearest_on_z(first[1])
        wrist = np.array([0.0, 0.0, _nearest_on_z(last), 1.0])
        self._wrist_in_tip = np.linalg.inv(placements[6]) @ wrist
        first[6, :, 3] = wrist
        self._chain = Chain(first)

    def why(self, T: Floats) -> str:
        """Return in which way a pose (4, 4) is out of reach; empty if the distance is one that the arm reaches."""
        nearest, farthest = self._range
        distance = float(np.linalg.norm((T @ self._wrist_in_tip)[:3] - self._shoulder))
        if distance > farthest + ROUNDING:
            return (
                f"too far away: the wrist would be {distance:.3f} m from the shoulder, the arm reaches {farthest:.3f} m"
            )
        if distance < nearest - ROUNDING:
            return f"too close: the wrist would be {distance:.3f} m from the shoulder, the arm folds to {nearest:.3f} m"
        return ""

    @cached_property
    def _range(self) -> tuple[float, float]:
        """Shortest and longest distance [m]."""
        shortest, longest = (self._extreme(sign) for sign in (-1.0, 1.0))
        return float(np.sqrt(max(0.0, shortest.min()))), float(np.sqrt(longest.max()))

    def _extreme(self, sign: float) -> Floats:
        """Squared distances after turning one joint after the other to where it is largest, or smallest."""
        q = np.random.default_rng(0).uniform(-np.pi, np.pi, (STARTS, 6))
        for _ in range(ROUNDS):
            for joint in range(1, 5):
                values = np.empty((3, STARTS))
                for index, angle in enumerate(SAMPLES):
                    q[:, joint] = angle
                    values[index] = self._squares(q)
                _, cosine, sine = sign * COEFFICIENTS @ values
                q[:, joint] = np.arctan2(sine, cosine)
        return self._squares(q)

    def _squares(self, q: Floats) -> Floats:
        return ((self._chain.fk(q)[:, :, 3] - self._shoulder) ** 2).sum(axis=1)


def _nearest_on_z(frame: Floats) -> float:
    """Where on the z axis it is nearest to the z axis of a frame; 0 if they are parallel [m]."""
    p, axis = frame[:3, 3], frame[:3, 2]
    square = 1.0 - axis[2] ** 2
    return float((p[2] - axis[2] * (axis @ p)) / square) if square > ROUNDING**2 else 0.0
