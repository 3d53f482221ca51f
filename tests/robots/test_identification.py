"""Identification: what looks say of an arm, beside arms that are known exactly."""

import numpy as np
import pytest

from kinreach.kinematics import ArmKinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm
from kinreach.robots.inside import IdentifiedArm, JointTerms, Prior, frames_of, joint_slopes, slopes

PRIOR = Prior(base=(0.02, 0.02), links=(1e-3, 2e-3), tool=(0.01, 0.0))
UR5S = [name for name in PUBLISHED_CALIBRATIONS if name.startswith("ur5_")]


def chain_of(calibration=None):
    arm = get_arm("ur5-thesis")
    return ArmKinematics(
        arm if calibration is None else arm.calibrated(PUBLISHED_CALIBRATIONS[calibration]), tip="tcp", base="world"
    ).chain


def postures(count, seed):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, 6))


def off(arm, true, q):
    return np.median(np.linalg.norm(arm.positions(q) - true.positions(q), axis=1))


def test_placements_are_those_of_the_chain():
    chain, q = chain_of(), postures(200, 0)
    T = np.tile(np.eye(4), (len(q), 1, 1))
    for placement, angles in zip(chain.placements, [*q.T, None], strict=True):
        T = T @ placement
        if angles is not None:
            turn = np.tile(np.eye(4), (len(q), 1, 1))
            turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angles)
            turn[:, 1, 0] = np.sin(angles)
            turn[:, 0, 1] = -np.sin(angles)
            T = T @ turn
    np.testing.assert_allclose(chain.fk(q), T, atol=1e-12)


@pytest.mark.parametrize("calibration", UR5S)
def test_looks_find_the_arm(calibration):
    """Exact looks: all of it. As the cameras see: nearer with every look, and about as near as it thinks."""
    true, nominal, test, rng = chain_of(calibration), chain_of(), postures(500, 1), np.random.default_rng(2)
    q = postures(200, 3)
    exact = IdentifiedArm(nominal.placements, q, true.positions(q), prior=PRIOR, noise=1e-7)
    assert off(exact, true, test) < 1e-6
    errors = []
    for count in (5, 20, 80, 200):
        seen = true.positions(q[:count]) + rng.normal(0, 9e-5, (count, 3))
        arm = IdentifiedArm(nominal.placements, q[:count], seen, prior=PRIOR, noise=9e-5)
        errors.append(off(arm, true, test))
        if count >= 20:
            assert 0.3 < errors[-1] / (1.54 * arm.doubt(test)) < 3.0
    assert errors[-1] < 6e-5 < errors[0]
    assert errors == sorted(errors, reverse=True)


def test_what_the_prior_excludes_stays():
    """A turned base and a longer tool are found exactly, in all postures, by who looks for nothing else."""
    nominal, q = chain_of(), postures(112, 5)
    T = nominal.fk(q)
    turn = np.array([[np.cos(0.01), -np.sin(0.01), 0], [np.sin(0.01), np.cos(0.01), 0], [0, 0, 1]])
    seen = (T[:, :3, :3] @ [1e-3, -2e-3, 5e-3] + T[:, :3, 3]) @ turn.T + [0.003, 0, 0.001]
    prior = PRIOR._replace(links=(0.0, 0.0))
    arm = IdentifiedArm(nominal.placements, q[:12], seen[:12], prior=prior, noise=1e-8)
    np.testing.assert_allclose(arm.positions(q), seen, atol=1e-9)
    links = IdentifiedArm(nominal.placements, q[:12], chain_of("ur5_a").positions(q[:12]), prior=prior, noise=9e-5)
    assert off(links, chain_of("ur5_a"), q) > 3e-4


def waves(q):
    """Sine and cosine of each joint, shape (m, 6, 12)."""
    return np.concatenate([np.eye(6) * part[:, :, None] for part in (np.sin(q), np.cos(q))], axis=2)


def test_slopes_of_joint_terms_are_differences():
    chain, q = chain_of(), postures(20, 0)
    terms = waves(q)
    J = joint_slopes(slopes(frames_of(chain.placements, q)), terms)
    for k in range(terms.shape[2]):
        step = 1e-6 * terms[:, :, k]
        change = (chain.positions(q + step) - chain.positions(q - step)) / 2e-6
        np.testing.assert_allclose(J[:, k], change.ravel(), atol=1e-8)


def test_deviations_of_joints_are_found_beside_the_frames():
    """Exact looks: all of both. Without the terms the frames cannot explain what the joints do."""
    rng, q, test = np.random.default_rng(0), postures(200, 1), postures(300, 2)
    factors = rng.normal(0, 1e-3, 12)
    true = chain_of("ur5_a")
    seen, wanted = (true.positions(one + waves(one) @ factors) for one in (q, test))
    terms = JointTerms(waves, np.full(12, 1e-3))
    with_terms = IdentifiedArm(chain_of().placements, q, seen, prior=PRIOR, noise=1e-7, terms=terms)
    without = IdentifiedArm(chain_of().placements, q, seen, prior=PRIOR, noise=1e-7)
    assert np.linalg.norm(with_terms.positions(test) - wanted, axis=1).max() < 1e-6
    assert np.median(np.linalg.norm(without.positions(test) - wanted, axis=1)) > 1e-4
    assert with_terms.doubt(test) < 1e-6
