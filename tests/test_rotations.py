"""Rotation vectors: those of scipy, next to no turn and half a turn too."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinreach._rotations import quick_pose_vector, rotation, rpy, turns, vectors_of

#: Angles [rad] at which formulas lose digits.
HARD = [0.0, 5e-324, 1e-200, 1e-16, 1e-8, 1e-3, np.pi / 2, 2 * np.pi / 3, np.pi - 1e-3, np.pi - 1e-8, np.pi, 4.0, 7.0]


def vectors():
    """Of random axes and those of the frame, with hard angles and others."""
    rng = np.random.default_rng(0)
    axes = np.concatenate([rng.normal(size=(400, 3)), np.eye(3), -np.eye(3), [[1.0, 1.0, 0.0], [1.0, -1.0, 1e-9]]])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.concatenate([HARD, rng.uniform(0.0, np.pi, 40)])
    return (angles[:, None, None] * axes).reshape(-1, 3)


def test_turns_are_those_of_scipy():
    r = vectors()
    assert len(r) > 20_000
    np.testing.assert_allclose(turns(r), Rotation.from_rotvec(r).as_matrix(), rtol=0, atol=2e-15)
    np.testing.assert_array_equal(turns(r.reshape(2, -1, 3))[1], turns(r)[len(r) // 2 :])


def test_vectors_of_turns_turn_as_they_do():
    R = turns(vectors())
    found = vectors_of(R)
    assert (np.linalg.norm(found, axis=1) <= np.pi + 1e-15).all()
    np.testing.assert_allclose(turns(found), R, rtol=0, atol=2e-15)
    expected = Rotation.from_matrix(R).as_rotvec()
    half = np.linalg.norm(expected, axis=1) > np.pi - 1e-6  # either sign
    assert half.sum() > 800
    np.testing.assert_allclose(found[~half], expected[~half], rtol=0, atol=2e-9)
    T = np.tile(np.eye(4), (len(R), 1, 1))
    T[:, :3, :3] = R
    np.testing.assert_allclose(turns(np.array([quick_pose_vector(each)[3:] for each in T])), R, rtol=0, atol=2e-15)


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2])
def test_roll_pitch_and_yaw_of_a_turn(pitch):
    R = rotation((0.2, pitch, -2.0))
    np.testing.assert_allclose(rotation(rpy(turns(vectors_of(R)))), R, rtol=0, atol=1e-15)
