"""Motions within limits: every sample of speed, acceleration and jerk; the path; and how long they take."""

import sys
from itertools import pairwise

import numpy as np
import pytest

from kinreach.errors import InputError, InstallationError
from kinreach.kinematics import MotionLimits, time_path, time_waypoints
from kinreach.robots import arm_names
from kinreach.robots.inside import UR_LENGTHS

ruckig = pytest.importorskip("ruckig")
pytest.importorskip("toppra")
RATE = 500.0


@pytest.fixture(scope="module")
def limits():
    return MotionLimits.of("ur10e")


def random_paths(seed, count):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        size = 10.0 ** rng.uniform(-2.0, 0.4)
        yield rng.normal(0.0, size, (rng.integers(2, 7), 6))


def changes(t, values):
    """Mean rate of change from each sample to the next."""
    return np.diff(values, axis=0) / np.diff(t)[:, None]


def off_path(q, waypoints):
    """Largest distance of postures from the straight lines between waypoints."""
    gaps = []
    for a, b in pairwise(waypoints):
        part = ((q - a) @ (b - a) / ((b - a) @ (b - a))).clip(0.0, 1.0)
        gaps.append(np.linalg.norm(q - a - part[:, None] * (b - a), axis=1))
    return np.min(gaps, axis=0).max()


def test_jerk_limited_motions_keep_every_limit_and_the_path(limits):
    for path in random_paths(0, 60):
        motion = time_waypoints(path, limits, rate=RATE)
        assert (np.abs(motion.qd) <= limits.speed * (1 + 1e-9)).all()
        even = motion.resampled(RATE)
        qd = motion.at(even.t)[1]
        acceleration = changes(motion.t, motion.qd)
        assert (np.abs(acceleration) <= limits.acceleration * (1 + 1e-6)).all()
        middles = (motion.t[:-1] + motion.t[1:]) / 2
        apart = np.diff(middles) > 0.5 / RATE  # next to a waypoint samples lie too close together for a difference
        jerk = changes(middles, acceleration)[apart]
        assert (np.abs(jerk) <= limits.jerk * 1.2).all()
        assert off_path(motion.q, path) < 1e-9
        assert (np.abs(qd) <= limits.speed * (1 + 1e-4)).all()  # between samples
        for waypoint in path:
            assert (np.abs(motion.q - waypoint).max(axis=1) < 1e-9).any()
        assert (motion.q[[0, -1]] == path[[0, -1]]).all()
        assert not motion.qd[[0, -1]].any()


def test_from_rest_to_rest_it_takes_as_long_as_ruckig_needs(limits):
    """Ruckig's optimum lets each joint move on its own; a straight line of joints with other limits takes longer."""
    longer = []
    for each in (MotionLimits.of("ur5e"), limits):
        for path in random_paths(1, 40):
            for start, end in pairwise(path):
                way = ruckig.InputParameter(6)
                way.current_position, way.target_position = start.tolist(), end.tolist()
                way.max_velocity, way.max_acceleration = each.speed.tolist(), each.acceleration.tolist()
                way.max_jerk = each.jerk.tolist()
                profile = ruckig.Trajectory(6)
                ruckig.Ruckig(6).calculate(way, profile)
                longer.append(time_waypoints([start, end], each).duration / profile.duration)
    assert len(longer) > 150
    assert min(longer) > 1 - 1e-9
    assert max(longer) <= 1.1


@pytest.mark.slow
def test_rounded_paths_keep_speed_acceleration_and_tolerance(limits):
    for path in random_paths(2, 20):
        for tolerance in (0.003, 0.05):
            motion = time_path(path, limits, tolerance=tolerance, rate=RATE)
            assert (np.abs(motion.qd) <= limits.speed * (1 + 1e-9)).all()
            assert (np.abs(changes(motion.t, motion.qd)) <= limits.acceleration * (1 + 1e-6)).all()
            assert off_path(motion.q, path) <= tolerance * (1 + 1e-6)
            np.testing.assert_allclose(motion.q[[0, -1]], path[[0, -1]], atol=1e-9)
            assert not motion.qd[[0, -1]].any()


def test_it_does_not_stop_at_corners_and_is_faster_for_it(limits):
    path = np.zeros((4, 6))
    path[1:, 0], path[2:, 1], path[3:, 2] = 1.0, 1.0, 1.0
    stops, rounds = time_waypoints(path, limits), time_path(path, limits, blends=0.3)
    inside = (rounds.t > 0.2) & (rounds.t < rounds.duration - 0.2)
    assert np.linalg.norm(rounds.qd[inside], axis=1).min() > 0.3
    assert rounds.duration < 0.8 * stops.duration


def test_every_corner_is_rounded_by_the_tolerance_or_up_to_the_middle_of_its_lines(limits):
    """A parabola that leaves both lines at the distance b of the corner passes it by b / 4 times the turn."""
    rng, by_tolerance, by_middle = np.random.default_rng(3), 0, 0
    for tolerance in (0.003, 0.02):
        for _ in range(2):
            ways = rng.normal(size=(5, 6)) * 10.0 ** rng.uniform(-1.5, 0.0, (5, 1))
            path = np.cumsum(ways, axis=0)
            motion = time_path(path, limits, tolerance=tolerance, rate=2000.0)
            assert off_path(motion.q, path) <= tolerance * (1 + 1e-6)
            np.testing.assert_allclose(motion.q[[0, -1]], path[[0, -1]], atol=1e-9)
            length = np.linalg.norm(ways[1:], axis=1)
            turn = np.linalg.norm(np.diff(ways[1:] / length[:, None], axis=0), axis=1)
            middle = np.minimum(length[1:], length[:-1]) / 2.0 * turn / 4.0
            for waypoint, most in zip(path[1:-1], middle, strict=True):
                nearest = np.linalg.norm(motion.q - waypoint, axis=1).min()
                assert nearest == pytest.approx(min(tolerance, most), rel=0.02)
                by_tolerance, by_middle = by_tolerance + (most > tolerance), by_middle + (most < tolerance)
    assert by_tolerance >= 4
    assert by_middle >= 3


def test_the_same_waypoint_twice_and_no_way_at_all(limits):
    point, other = np.zeros(6), np.ones(6)
    for timed in (time_waypoints, time_path):
        assert timed([point], limits).duration == 0.0
        assert timed([point, point], limits).duration == 0.0
        twice = timed([point, point, other, other], limits)
        assert twice.duration == pytest.approx(timed([point, other], limits).duration)


def test_the_limits_of_each_ur_are_in_its_table():
    assert len(UR_LENGTHS) >= 14
    for name in UR_LENGTHS:
        limits = MotionLimits.of(name)
        degrees = np.degrees(limits.speed)
        assert (degrees >= 119.9).all(), name
        assert (degrees <= 360.1).all(), name
        assert (limits.acceleration == 5.0).all()
        assert (limits.jerk == 50.0).all()
    assert np.degrees(MotionLimits.of("ur10e").speed).round().tolist() == [120, 120, 180, 180, 180, 180]
    for name in arm_names():
        assert MotionLimits.of(name).speed.min() > 0.0


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"speed": 3.0}, r"speed of shoulder_pan_joint must be at most 2\.094 rad/s, got 3"),
        ({"speed": [1.0, 2.0]}, "one for each of 6 joints"),
        ({"acceleration": 0.0}, "acceleration must be a number above 0"),
        ({"jerk": -1.0}, "jerk must be a number above 0"),
        ({"speed": np.nan}, "speed must be a number above 0"),
    ],
)
def test_limits_are_checked(given, said):
    with pytest.raises(InputError, match=said):
        MotionLimits.of("ur10e", **given)


def test_limits_are_copies_that_cannot_be_written_to():
    given = np.full(6, 1.0)
    limits = MotionLimits.of("ur10e", speed=given, acceleration=given, jerk=given)
    given[:] = 0.5
    for values in (limits.speed, limits.acceleration, limits.jerk):
        np.testing.assert_array_equal(values, np.ones(6))
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 2.0


def test_lower_limits_take_longer():
    path = np.array([np.zeros(6), np.ones(6)])
    durations = [time_waypoints(path, MotionLimits.of("ur10e", speed=speed)).duration for speed in (2.0, 1.0, 0.25)]
    assert durations == sorted(durations)
    assert durations[-1] > 4.0


def test_blends_and_paths_are_checked(limits):
    path = np.array([np.zeros(6), np.eye(6)[0], np.eye(6)[0] + np.eye(6)[1], np.ones(6)])
    with pytest.raises(InputError, match=r"blends at waypoints 1 and 2 overlap: 0\.6 \+ 0\.6 rad on a way of 1 rad"):
        time_path(path, limits, blends=0.6)
    assert time_path(path, limits, blends=0.5).duration > 1.0  # corner to corner
    with pytest.raises(InputError, match="blends at waypoints 0 and 1 overlap"):
        time_path(path, limits, blends=[1.2, 0.1])
    with pytest.raises(InputError, match="or 2 of them"):
        time_path(path, limits, blends=[0.1])
    with pytest.raises(InputError, match="waypoint 1 is where the one before it is"):
        time_path([path[0], path[0], path[1], path[2]], limits, blends=1e-3)
    for timed in (time_waypoints, time_path):
        with pytest.raises(InputError, match=r"waypoints must have shape \(m, 6\)"):
            timed(np.zeros(6), limits)
        with pytest.raises(InputError, match="rate must be"):
            timed(path, limits, rate=0.0)


@pytest.mark.parametrize(("module", "timed"), [("ruckig", time_waypoints), ("toppra.algorithm", time_path)])
def test_a_missing_package_is_named(monkeypatch, limits, module, timed):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InstallationError, match=r"pip install 'kinreach\[paths\]'"):
        timed([np.zeros(6), np.ones(6)], limits)
