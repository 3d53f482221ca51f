"""Self-motion curves are traced from starts, with joints held at values that leave a doubt."""

import numpy as np
import pytest

from kinreach.kinematics import (
    SevenAxisKinematics,
)
from kinreach.kinematics._seven_axis.tracing import SelfMotionTracer


@pytest.fixture(scope="module")
def panda():
    return SevenAxisKinematics("panda")


@pytest.mark.slow
def test_joints_are_held_between_values_that_leave_a_doubt(panda):
    """With one value of each joint curves are lost, but not with others beside those whose starts lead nowhere."""
    lost, tried = np.zeros(2, dtype=int), 0
    few = [SelfMotionTracer(panda.chain) for _ in range(2)]
    for tracer, halvings in zip(few, (0, 2), strict=True):
        tracer._starts.values, tracer._starts.halvings = 1, halvings
    for posture in range(20):
        T = panda.fk(np.random.default_rng([posture, 1]).uniform(-np.pi, np.pi, 7))
        every = panda._tracer.curves(T)[0]
        for index, tracer in enumerate(few):
            found = tracer.curves(T)[0]
            lost[index] += sum(len(tracer.beside(found, curve.q[:1], T)) for curve in every)
        tried += len(every)
    assert tried > 100
    assert lost[0] > 0
    assert lost[1] == 0


@pytest.mark.parametrize("length", [0.3, 1.0, -1.5, 2.0])
def test_a_long_way_along_a_curve_is_made_of_short_ones(panda, length):
    """It ends where the null space of the Jacobian leads, integrated without the tracer."""
    checked = 0
    for q in np.random.default_rng(5).uniform(-2.0, 2.0, (3, 7)):
        T, tangent = panda.fk(q), np.linalg.svd(panda.jacobian(q))[2][-1]
        found = panda._tracer.along(q, tangent, length, T)
        assert np.abs(panda.fk(found) - T).max() < 1e-9
        other, ahead = q.copy(), np.sign(length) * tangent
        for _ in range(200):
            null = np.linalg.svd(panda.jacobian(other))[2][-1]
            ahead = null * np.sign(null @ ahead)
            other = other + abs(length) / 200 * ahead
        assert np.linalg.norm(found - other) < 0.04
        assert np.linalg.norm(found - q) > 0.3 * abs(length)
        checked += 1
    assert checked == 3
