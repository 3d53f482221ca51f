import numpy as np
import pytest

from kinreach.sim.inside import TrapezoidalProfile

SPEED, ACCELERATION = 3.0, 10.0
WAYS = np.array([2.0, 0.3, 12.0, 0.9, 1e-6, 0.0])


def profile(ways):
    return TrapezoidalProfile(np.array(ways), SPEED, ACCELERATION)


def test_covers_the_way_within_its_limits():
    for way in WAYS:
        line = profile([way])
        times = np.linspace(0.0, line.duration[0], 2001)
        s, v = (values[:, 0] for values in line.sample(times))
        np.testing.assert_allclose(s[[0, -1]], [0.0, way], atol=1e-12)
        np.testing.assert_allclose(v[[0, -1]], 0.0, atol=1e-12)
        assert v.max() <= SPEED + 1e-12
        dt = times[1]
        np.testing.assert_allclose(np.diff(s), (v[1:] + v[:-1]) / 2 * dt, atol=ACCELERATION * dt**2)
        assert np.abs(np.diff(v)).max() <= ACCELERATION * dt * (1 + 1e-6)


def test_no_way_takes_no_time():
    line = profile([0.0])
    np.testing.assert_array_equal(line.duration, [0.0])
    s, v = line.sample(np.array([0.0, 1.0]))
    np.testing.assert_array_equal(s, np.zeros((2, 1)))
    np.testing.assert_array_equal(v, np.zeros((2, 1)))


def test_stays_at_the_end():
    line = profile(WAYS)
    s, v = line.sample(np.array([line.duration.max() + 5.0]))
    np.testing.assert_allclose(s[0], WAYS, atol=1e-12)
    np.testing.assert_allclose(v[0], 0.0, atol=1e-12)


def test_duration_is_that_of_the_way_at_full_speed_and_of_the_ramps():
    np.testing.assert_allclose(profile([3.0, 0.1]).duration, [3.0 / SPEED + SPEED / ACCELERATION, 2 * np.sqrt(0.01)])


@pytest.mark.parametrize("count", [1, 2, 3, 64])
def test_a_profile_does_not_depend_on_the_others(count):
    ways = np.resize(WAYS * np.pi, count)
    times = np.linspace(0.0, 5.0, 333)
    together = profile(ways)
    for row, way in enumerate(ways):
        alone = profile([way])
        np.testing.assert_array_equal(alone.duration, together.duration[[row]])
        for one, all_of_them in zip(alone.sample(times), together.sample(times), strict=True):
            np.testing.assert_array_equal(one[:, 0], all_of_them[:, row])
