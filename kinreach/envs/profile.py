"""Speed profiles along a straight line in joint space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kinreach.kinematics.goals import Floats


@dataclass(frozen=True, eq=False)
class TrapezoidalProfile:
    """Synchronous trapezoid: all joints start and stop together, so the path is straight in joint space.

    The joint with the longest way keeps to the limits (triangle where it does not get up to speed), the others are
    scaled to it.

    Attributes:
        start: Posture at time 0 [rad], shape (n,).
        target: Posture at `duration` and after [rad], shape (n,).
        speed: Largest joint speed [rad/s].
        acceleration: Largest joint acceleration [rad/s^2].
    """

    start: Floats
    target: Floats
    speed: float
    acceleration: float

    @property
    def _way(self) -> float:
        return float(np.abs(self.target - self.start).max())

    @property
    def _ramp(self) -> float:
        """Time from rest to the highest speed [s]."""
        return min(self.speed / self.acceleration, math.sqrt(self._way / self.acceleration))

    @property
    def duration(self) -> float:
        """Time from start to target [s]."""
        ramp = self._ramp
        return self._way / (self.acceleration * ramp) + ramp if ramp > 0 else 0.0

    def sample(self, times: Floats) -> tuple[Floats, Floats]:
        """Positions [rad] and velocities [rad/s] at the given times [s], both of shape (k, n) for k times."""
        way, ramp, end = self._way, self._ramp, self.duration
        t = np.clip(times, 0.0, end)
        t_left = end - t
        up, down = np.minimum(t, ramp), np.minimum(t_left, ramp)
        # Covered way: the ramp up, the constant part and the ramp down, each up to time t.
        covered = self.acceleration * (up**2 / 2 + ramp * np.clip(t - ramp, 0.0, None) - (ramp - down) ** 2 / 2)
        rate = self.acceleration * np.minimum(up, down)
        direction = (self.target - self.start) / way if way > 0 else np.zeros_like(self.start)
        return self.start + covered[:, None] * direction, rate[:, None] * direction
