"""Speed profiles along straight lines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinreach.kinematics.goals import Floats


@dataclass(frozen=True, eq=False)
class TrapezoidalProfile:
    """Trapezoids of speed over time, from rest to rest, one for each of m ways; a triangle where a way is short.

    Every entry is computed on its own, by elementwise arithmetic: it does not depend, to the bit, on the other ways.

    Attributes:
        way: How far to go [rad], at least 0, shape (m,).
        speed: Largest speed [rad/s].
        acceleration: Acceleration and deceleration [rad/s^2].
    """

    way: Floats
    speed: float
    acceleration: float

    @cached_property
    def ramp(self) -> Floats:
        """Time from rest to the highest speed [s], shape (m,)."""
        return np.minimum(self.speed / self.acceleration, np.sqrt(self.way / self.acceleration))

    @cached_property
    def duration(self) -> Floats:
        """Time for the whole way [s], shape (m,)."""
        cruise = np.divide(self.way, self.acceleration * self.ramp, out=np.zeros_like(self.way), where=self.ramp > 0)
        return cruise + self.ramp

    def sample(self, times: Floats) -> tuple[Floats, Floats]:
        """How much of the way is covered [rad] and how fast [rad/s], both of shape (k, m), at k times [s]."""
        ramp, end = self.ramp, self.duration
        t = np.minimum(np.maximum(times, 0.0)[:, None], end)
        up, down = np.minimum(t, ramp), np.minimum(end - t, ramp)
        # The ramp up, the constant part and the ramp down, each up to time t.
        ways = up**2 / 2 + ramp * np.maximum(t - ramp, 0.0) - (ramp - down) ** 2 / 2
        return self.acceleration * ways, self.acceleration * np.minimum(up, down)
