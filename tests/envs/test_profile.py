import numpy as np
import pytest

from kinreach.envs.profile import TrapezoidalProfile

SPEED, ACCELERATION = 3.0, 10.0


def profile(way):
    return TrapezoidalProfile(np.array([0.5, -1.0]), np.array([0.5, -1.0]) + way, SPEED, ACCELERATION)


@pytest.mark.parametrize("way", [(2.0, -0.7), (0.05, 0.3), (-6.0, 6.0), (0.9, 0.0), (1e-6, 0.0)])
def test_goes_from_start_to_target_within_its_limits(way):
    line = profile(np.array(way))
    times = np.linspace(0.0, line.duration, 2001)
    q, v = line.sample(times)
    np.testing.assert_allclose(q[0], line.start, atol=1e-12)
    np.testing.assert_allclose(q[-1], line.target, atol=1e-12)
    np.testing.assert_allclose(v[[0, -1]], 0.0, atol=1e-12)
    assert np.abs(v).max() <= SPEED + 1e-12
    dt = times[1]
    np.testing.assert_allclose(np.diff(q, axis=0), (v[1:] + v[:-1]) / 2 * dt, atol=ACCELERATION * dt**2)
    assert np.abs(np.diff(v, axis=0) / dt).max() <= ACCELERATION * (1 + 1e-6)


def test_is_a_straight_line():
    q, _ = profile(np.array([2.0, -0.5])).sample(np.linspace(0, 2, 50))
    share = (q - [0.5, -1.0]) / [2.0, -0.5]
    np.testing.assert_allclose(share[:, 0], share[:, 1], atol=1e-12)


def test_no_way_takes_no_time():
    line = profile(np.zeros(2))
    assert line.duration == 0.0
    q, v = line.sample(np.array([0.0, 1.0]))
    np.testing.assert_array_equal(q, [line.start, line.start])
    np.testing.assert_array_equal(v, np.zeros((2, 2)))


def test_stays_at_the_target():
    line = profile(np.array([1.0, 1.0]))
    q, v = line.sample(np.array([line.duration + 5.0]))
    np.testing.assert_allclose(q[0], line.target, atol=1e-12)
    np.testing.assert_allclose(v[0], 0.0, atol=1e-12)


def test_duration_is_that_of_the_longest_way_at_full_speed():
    assert profile(np.array([3.0, 0.1])).duration == pytest.approx(3.0 / SPEED + SPEED / ACCELERATION)
