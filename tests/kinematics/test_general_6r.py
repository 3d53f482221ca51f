"""The method that finds all postures of any six-joint arm, on arms of no particular kind and where it is hard."""

import numpy as np
import pytest
from scipy.linalg import eigvals
from scipy.spatial.transform import Rotation

from kinreach.kinematics import URKinematics
from kinreach.kinematics._angles import wrapped
from kinreach.kinematics._general_6r import MAX_ENTRY, Chain, General6R, miss, missed_by, newton
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


def test_the_problem_of_size_16_has_the_eigenvalues_of_the_one_of_size_24():
    rng = np.random.default_rng(3)
    chain = Chain(some_arm(rng))
    general = General6R(chain)
    T = poses(chain, rng.uniform(-np.pi, np.pi, (5, 6)))
    pose, start, imaginary, _ = general._candidates(T, 0, 1, general.PHASES[0])
    real = imaginary == 0.0
    far = general._far(T)
    base = np.linalg.qr(far[:, :, 1:], mode="complete")[0]
    for row, (B, C, S) in enumerate(general._problem(far, base, 0, 1)):
        left, right = np.zeros((24, 24)), np.eye(24)
        left[:12, 12:], left[12:] = np.eye(12), -np.hstack([B + C, 2.0 * S])
        right[12:, 12:] = B - C
        values = eigvals(left, right)
        assert np.count_nonzero(np.abs(values - 1j) < 1e-3) == 4
        expected = 2.0 * np.arctan(values[values.imag == 0].real)
        assert len(expected) >= 2
        np.testing.assert_allclose(
            np.sort(start[real & (pose == row), 1] % (2 * np.pi)), np.sort(expected % (2 * np.pi)), atol=1e-7
        )


def test_an_ill_conditioned_pose_is_noticed_and_solved():
    """Near sin q5 = 0 the equations hardly depend on the eigenvalue: an inverse is large, two postures were missed."""
    kin = URKinematics.from_calibration(PUBLISHED_CALIBRATIONS["ur10e_a"], model="ur10e")
    q = np.array([1.281906, 1.761483, -0.484367, -1.026086, -3.025442, 0.440775])
    general, T = kin._solver.general, FLIP @ kin.fk(q)
    assert general._candidates(T[None], *general.CHOICES[0], general.PHASES[0])[3][0] > MAX_ENTRY
    (found,) = general.solve(T[None])
    assert apart(q, found) < 1e-7
    assert len(found) == 4
