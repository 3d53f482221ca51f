"""A trajectory: its samples, what is between them, and what it refuses."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from kinreach.errors import InputError
from kinreach.kinematics import Trajectory

JOINTS = ("one", "two", "three")


def random_trajectory(seed, count=12):
    rng = np.random.default_rng(seed)
    t = np.concatenate([[0.0], rng.uniform(0.01, 0.4, count - 1).cumsum()])
    return Trajectory(JOINTS, t, rng.normal(size=(count, 3)), rng.normal(size=(count, 3)))


@pytest.mark.parametrize("seed", range(5))
def test_between_samples_it_is_the_cubic_of_their_angles_and_speeds(seed):
    path = random_trajectory(seed)
    cubic = CubicHermiteSpline(path.t, path.q, path.qd)
    times = np.random.default_rng(seed).uniform(0.0, path.duration, 200)
    q, qd = path.at(times)
    np.testing.assert_allclose(q, cubic(times), atol=1e-12)
    np.testing.assert_allclose(qd, cubic(times, 1), atol=1e-10)
    one_q, one_qd = path.at(times[3])
    assert one_q.shape == one_qd.shape == (3,)
    assert (one_q == q[3]).all()
    assert (one_qd == qd[3]).all()


def test_the_samples_come_back_and_before_and_after_it_stands():
    path = random_trajectory(7)
    q, qd = path.at(path.t)
    assert (q == path.q).all()
    np.testing.assert_allclose(qd, path.qd, atol=1e-14)
    for t, posture in ((-1.0, path.q[0]), (path.duration + 1e-6, path.q[-1]), (path.duration + 1.0, path.q[-1])):
        q, qd = path.at(t)
        assert (q == posture).all()
        assert (qd == 0.0).all()


@pytest.mark.parametrize("rate", [10.0, 125.0, 500.0])
def test_resampled_has_even_times_and_ends_in_the_last_posture(rate):
    for seed in range(20):
        path = random_trajectory(seed)
        even = path.resampled(rate)
        np.testing.assert_allclose(np.diff(even.t), 1.0 / rate, rtol=1e-9)
        assert path.duration - 1e-9 <= even.duration < path.duration + 1.0 / rate
        assert (even.q[-1] == path.q[-1]).all()
        q, qd = path.at(even.t[:-1])
        assert (even.q[:-1] == q).all()
        assert (even.qd[:-1] == qd).all()
        assert even.joints == path.joints


def test_a_duration_of_whole_periods_gets_no_sample_more():
    for count in range(2, 200):
        t = np.arange(count) * 0.002
        path = Trajectory(("a",), t, t[:, None], np.ones((count, 1)))
        even = path.resampled(500.0)
        assert len(even.t) == count
        assert even.qd[-1] == 1.0  # the end itself, not what comes after


def test_an_arm_that_does_not_move():
    path = Trajectory(("a", "b"), [0.0], [[1.0, 2.0]], [[0.0, 0.0]])
    assert path.duration == 0.0
    assert repr(path) == "Trajectory(1 samples, 0 s, joints=('a', 'b'))"
    assert path.at([0.0, 1.0])[0].tolist() == [[1.0, 2.0], [1.0, 2.0]]
    assert len(path.resampled(500.0).t) == 1


def test_it_is_a_copy_that_cannot_be_written():
    q = np.zeros((2, 1))
    path = Trajectory(["a"], [0.0, 1.0], q, q)
    q[0] = 5.0
    assert path.q[0] == 0.0
    assert path.joints == ("a",)
    with pytest.raises(ValueError, match="read-only"):
        path.q[0] = 1.0


T, Q = [0.0, 1.0], [[0.0], [1.0]]


@pytest.mark.parametrize(
    ("joints", "t", "q", "qd", "said"),
    [
        ("a", T, Q, Q, "joints must be names"),
        ((), T, Q, Q, "joints must be names"),
        (("a", "a"), T, np.zeros((2, 2)), np.zeros((2, 2)), "different names"),
        (("a", 3), T, np.zeros((2, 2)), np.zeros((2, 2)), "different names"),
        (("a",), [], np.zeros((0, 1)), np.zeros((0, 1)), "t must have shape"),
        (("a",), [[0.0, 1.0]], Q, Q, "t must have shape"),
        (("a",), [0.5, 1.0], Q, Q, "t must begin at 0, got 0.5"),
        (("a",), [0.0, 0.0], Q, Q, r"t must increase; t\[1\] = 0 follows 0"),
        (("a",), [0.0, np.inf], Q, Q, "t must be finite"),
        (("a",), T, [0.0, 1.0], Q, r"q must have shape \(2, 1\), got \(2,\)"),
        (("a",), T, Q, [[0.0]], r"qd must have shape \(2, 1\)"),
        (("a",), T, [[0.0], [np.nan]], Q, "q must be finite"),
        (("a",), T, "far", Q, "q must be an array of numbers"),
    ],
)
def test_what_is_no_trajectory_is_refused(joints, t, q, qd, said):
    with pytest.raises(InputError, match=said):
        Trajectory(joints, t, q, qd)


@pytest.mark.parametrize(("rate", "said"), [(0.0, "above 0"), (np.nan, "finite"), (1e12, "10000000 samples")])
def test_rates_are_checked(rate, said):
    with pytest.raises(InputError, match=said):
        random_trajectory(0).resampled(rate)


@pytest.mark.parametrize("t", [np.nan, [[0.0]], "now"])
def test_times_are_checked(t):
    with pytest.raises(InputError, match="t must be"):
        random_trajectory(0).at(t)
