"""Peaks of a motion within the limits of the arm."""

import numpy as np

from kinreach.compare._motion import peaks
from kinreach.kinematics import MotionLimits, Trajectory


def test_peaks_are_those_of_a_known_motion():
    """A minimum-jerk motion by one joint: its peaks are 15/8, 10/sqrt(3) and 60 of its length and duration."""
    limits = MotionLimits(("a", "b"), np.full(2, 2.0), np.full(2, 5.0), np.full(2, 50.0))
    for length, duration in ((1.0, 1.0), (0.3, 2.0)):
        s = np.linspace(0.0, 1.0, 4001)
        q, qd = (
            length * (10 * s**3 - 15 * s**4 + 6 * s**5),
            length / duration * (30 * s**2 - 60 * s**3 + 30 * s**4),
        )
        still = np.zeros_like(q)
        found = peaks(
            Trajectory(limits.joints, s * duration, np.stack([still, q], 1), np.stack([still, qd], 1)), limits
        )
        expected = (
            length / duration * 15 / 8 / 2,
            length / duration**2 * 10 / 3**0.5 / 5,
            length / duration**3 * 60 / 50,
        )
        np.testing.assert_allclose(list(found.values()), expected, rtol=0.01)


def test_peaks_reach_from_rest_to_rest():
    """At a speed that begins and ends at once: what a sample's time makes of it, on both sides."""
    limits = MotionLimits(("a",), np.full(1, 4.0), np.full(1, 500.0), np.full(1, 250_000.0))
    for speed in (1.0, -2.0):
        moving = Trajectory(
            limits.joints, np.arange(5) / 500.0, speed * np.arange(5)[:, None] / 500.0, np.full((5, 1), speed)
        )
        np.testing.assert_allclose(list(peaks(moving, limits).values()), np.abs(speed) * np.array([0.25, 1.0, 1.0]))
