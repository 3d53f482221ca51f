"""The method that finds all postures of any six-joint arm, on arms of no particular kind and where it is hard."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinreach._rotations import wrapped
from kinreach.kinematics import ArmKinematics, URKinematics
from kinreach.kinematics import _general_6r as general_6r
from kinreach.kinematics._general_6r import Chain, General6R, first_of_each, miss, missed_by, newton
from kinreach.kinematics._seven_axis.starts import HeldBetween
from kinreach.kinematics._ur.kinematics import FLIP
from kinreach.robots import PUBLISHED_CALIBRATIONS


def some_arm(rng, *, parallel=False):
    """Six axes in any directions; with `parallel` the second and the third in the same."""
    placements = np.tile(np.eye(4), (7, 1, 1))
    placements[:, :3, :3] = Rotation.random(7, rng=rng).as_matrix()
    placements[:, :3, 3] = rng.uniform(-0.5, 0.5, (7, 3))
    if parallel:
        placements[2, :3, :3] = np.eye(3)
    return placements


def poses(chain, q):
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :3] = chain.fk(q)
    return T


def apart(q, others):
    return np.abs(wrapped(others - q)).max(axis=1).min(initial=np.inf)


@pytest.mark.parametrize("parallel", [False, True])
def test_postures_of_any_arm(parallel):
    """The posture that made the pose, whatever Newton's method finds from random starts, and an even number of them."""
    rng = np.random.default_rng(1)
    asked = 0
    for _ in range(6):
        chain = Chain(some_arm(rng, parallel=parallel))
        q = rng.uniform(-np.pi, np.pi, (10, 6))
        T = poses(chain, q)
        for posture, pose, found in zip(q, T, General6R(chain).solve(T), strict=True):
            assert len(found) in range(2, 17, 2)
            assert missed_by(miss(chain.fk(found), pose[None].repeat(len(found), 0))).max() < 1e-10
            assert apart(posture, found) < 1e-7
            starts = rng.uniform(-np.pi, np.pi, (60, 6))
            reached, off = newton(chain, starts, pose[None].repeat(60, 0), steps=30)
            for other in reached[off < 1e-12]:
                assert apart(other, found) < 1e-6
                asked += 1
    assert asked > 500


def test_steps_are_those_of_the_jacobian():
    """Both in their own frames: the steps are the same, and the bound holds."""
    rng = np.random.default_rng(2)
    chain = Chain(some_arm(rng))
    q = rng.uniform(-np.pi, np.pi, (20, 6))
    near = q + 1e-6 * rng.normal(size=q.shape)
    T = poses(chain, near)
    error, J, off = chain.step(q, T)
    reached, here = chain.jacobian(q)
    twist = miss(reached, T)
    ours, theirs = (np.linalg.solve(J, error[..., None]), np.linalg.solve(here, twist[..., None]))
    np.testing.assert_allclose(ours, theirs, atol=1e-8)
    np.testing.assert_allclose(q + ours[..., 0], near, atol=1e-9)
    assert (missed_by(twist) <= off * (1 + 1e-6)).all()
    turned = T @ np.diag([1.0, -1.0, -1.0, 1.0])  # by pi about the tip's x axis
    assert (chain.step(near, turned)[2] > 1.0).all()


def test_an_ill_conditioned_pose_is_solved():
    """Near sin q5 = 0 the equations hardly depend on the eigenvalue: an inverse is large, two postures were missed."""
    kin = URKinematics.from_calibration(PUBLISHED_CALIBRATIONS["ur10e_a"], model="ur10e")
    q = np.array([1.281906, 1.761483, -0.484367, -1.026086, -3.025442, 0.440775])
    general, T = kin._calibrated.general, FLIP @ kin.fk(q)
    (found,) = general.solve(T[None])
    assert apart(q, found) < 1e-7
    assert len(found) == 4


def test_eigenvalues_that_lead_nowhere_are_counted_and_the_other_way_is_taken():
    """Two axes of a Panda that can become parallel: around the ring one way, not the other."""
    placements, rng = ArmKinematics.of("panda").chain.placements, np.random.default_rng(5)
    counted = []
    for joint in range(1, 6):
        held = HeldBetween(joint, placements)
        T = np.eye(4)
        T[:3] = Chain(placements).fk(rng.uniform(-2.0, 2.0, (1, 7)))[0]
        ways = [held._six(T, backwards=backwards) for backwards in (False, True)]
        assert [six.tried(rng.uniform(-np.pi, np.pi, (20, 6))) for six in ways] == [1.0, 1.0]
        counts = [six.spurious for six in ways]
        assert held._backwards == (counts[0] > counts[1])
        counted += counts
    assert sum(map(bool, counted)) == 3


def test_the_first_of_each_of_near_postures_is_kept(monkeypatch):
    """As by comparing every two, in blocks of any size: off by more than a distance from each that is before it."""
    rng, dropped = np.random.default_rng(0), 0
    for block in (1, 7, 2**17):
        monkeypatch.setattr(general_6r, "MAX_PAIRS", block)
        for _ in range(40):
            distance, joints = 10 ** rng.uniform(-6, -0.5), rng.integers(1, 7)
            about = rng.uniform(-np.pi, np.pi, (8, joints))[rng.integers(8, size=rng.integers(0, 40))]
            q = about + distance * rng.uniform(-1, 1, about.shape)
            apart = np.abs(wrapped(q[:, None] - q)).max(axis=2)
            expected = [not (apart[row, :row] < distance).any() for row in range(len(q))]
            assert first_of_each(q, distance).tolist() == expected
            dropped += len(q) - sum(expected)
    assert dropped > 800
