"""Motions of the joints over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import MAX_ANGLE, Floats, as_floats, check_entries, check_number, shown
from kinreach.errors import InputError

#: Largest number of samples of a trajectory.
MAX_SAMPLES = 10_000_000
#: Part of a period by which a time may be off a multiple of it by rounding.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Joint angles and speeds over time. The arrays are copies and read-only.

    Between two samples a joint moves on the cubic that has their angles and speeds.

    Attributes:
        joints: Names of the joints, in the order of `q`.
        t: Times of the samples, the first 0 and each later than the one before [s], shape (n,).
        q: Joint angles [rad], shape (n, dof).
        qd: Joint speeds [rad/s], shape (n, dof).

    Raises:
        InputError: No samples, wrong shapes, a value that is not finite, times that do not begin at 0 or do not
            increase, or names that are not different texts.
    """

    joints: tuple[str, ...]
    t: Floats
    q: Floats
    qd: Floats

    def __post_init__(self) -> None:
        names: Any = self.joints
        if isinstance(names, str) or not isinstance(names, Sequence) or not names:
            raise InputError(f"joints must be names of joints, got {shown(names)}")
        if not all(isinstance(name, str) and name for name in names) or len(set(names)) < len(names):
            raise InputError(f"joints must be different names, got {shown(names)}")
        object.__setattr__(self, "joints", tuple(names))
        for part in ("t", "q", "qd"):
            values = as_floats(part, getattr(self, part)).copy()
            values.flags.writeable = False
            object.__setattr__(self, part, values)
        if self.t.ndim != 1 or not 1 <= len(self.t) <= MAX_SAMPLES:
            raise InputError(f"t must have shape (n,) with n from 1 to {MAX_SAMPLES}, got {self.t.shape}")
        for part, values in (("q", self.q), ("qd", self.qd)):
            if values.shape != (len(self.t), len(names)):
                raise InputError(f"{part} must have shape ({len(self.t)}, {len(names)}), got {values.shape}")
            check_entries(part, values, MAX_ANGLE)
        check_entries("t", self.t, MAX_ANGLE)
        if self.t[0] != 0.0:
            raise InputError(f"t must begin at 0, got {self.t[0]:g}")
        late = np.flatnonzero(np.diff(self.t) <= 0.0)
        if len(late):
            first = late[0]
            raise InputError(f"t must increase; t[{first + 1}] = {self.t[first + 1]:g} follows {self.t[first]:g}")

    def __repr__(self) -> str:
        return f"Trajectory({len(self.t)} samples, {self.duration:.4g} s, joints={self.joints})"

    @property
    def duration(self) -> float:
        """Time of the last sample [s]."""
        return float(self.t[-1])

    def at(self, t: ArrayLike) -> tuple[Floats, Floats]:
        """Return joint angles and speeds at a time, or at many.

        Args:
            t: Time [s], a number or shape (m,). Before 0 and after the end the arm stands in the first and the last
                posture.

        Returns:
            `q` [rad] and `qd` [rad/s], each of shape (dof,) or (m, dof).

        Raises:
            InputError: A time is not finite.
        """
        times = as_floats("t", t)
        if times.ndim > 1:
            raise InputError(f"t must be a number or have shape (m,), got {times.shape}")
        if not np.isfinite(times).all():
            raise InputError("t must be finite")
        outside = (times < 0.0) | (times > self.duration)
        if len(self.t) == 1:
            q, qd = np.broadcast_to(self.q[0], (*times.shape, len(self.joints))), self.qd[0]
            return q.copy(), np.where(outside[..., None], 0.0, qd)
        times = times.clip(0.0, self.duration)
        after = np.searchsorted(self.t, times, side="right").clip(1, len(self.t) - 1)
        before = after - 1
        step = (self.t[after] - self.t[before])[..., None]
        s = (times - self.t[before])[..., None] / step
        q0, q1 = self.q[before], self.q[after]
        v0, v1 = step * self.qd[before], step * self.qd[after]
        rise = q1 - q0
        # cubic Hermite: q0 + s v0 + s^2 (3 rise - 2 v0 - v1) + s^3 (v0 + v1 - 2 rise)
        square, cube = 3.0 * rise - 2.0 * v0 - v1, v0 + v1 - 2.0 * rise
        q = q0 + s * (v0 + s * (square + s * cube))
        qd = (v0 + s * (2.0 * square + 3.0 * s * cube)) / step
        at_end = s >= 1.0
        q, qd = np.where(at_end, q1, q), np.where(at_end, self.qd[after], qd)
        return q, np.where(outside[..., None], 0.0, qd)

    def resampled(self, rate: float) -> Trajectory:
        """Return the same motion with samples at an even rate, as a robot's controller takes them.

        Args:
            rate: Samples per second [Hz].

        Returns:
            Samples at 0, 1/rate, 2/rate, …; the last is the first of these times at which the motion has ended.

        Raises:
            InputError: `rate` is not above 0, or there would be more than 10 million samples.
        """
        rate = check_number("rate", rate, above=0.0)
        periods = self.duration * rate
        if periods > MAX_SAMPLES - 2:
            raise InputError(f"{self.duration:g} s at {rate:g} Hz are more than {MAX_SAMPLES} samples")
        count = max(ceil(periods - ROUNDING), 0)
        t = np.arange(count + 1) / rate
        # a multiple that is beyond the end by rounding only is the end
        q, qd = self.at(np.where(np.abs(t - self.duration) * rate < ROUNDING, self.duration, t))
        return Trajectory(self.joints, t, q, qd)
