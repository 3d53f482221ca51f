"""Which matrices are rigid motions to rounding, how far a pose is from a goal, and how they are put right."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinreach._checks import MAX_DISTANCE
from kinreach.errors import InputError
from kinreach.kinematics import AxisGoal, PoseGoal, PositionGoal
from kinreach.kinematics._core import doubles, lib
from kinreach.kinematics._goals import nearest_rotations, rigid_poses, skewed


def random_poses(count, seed=0):
    rng = np.random.default_rng(seed)
    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3], T[:, :3, 3] = Rotation.random(count, rng=rng).as_matrix(), rng.uniform(-3, 3, (count, 3))
    return T


def with_one_fault(T, size):
    """Poses of which one thing only is wrong: a length, an angle, an entry, a coordinate, the last row."""
    n, o, _ = T[:3, :3].T
    columns = [((1 + size) * n, o), (n, (1 + size) * o), (n, np.cos(size) * o + np.sin(size) * n)]
    for x, y in columns:
        wrong = T.copy()
        wrong[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
        yield wrong
    for row in range(3):
        for column, change in ((2, size), (3, np.sign(size) * (MAX_DISTANCE + 3.0))):
            wrong = T.copy()
            wrong[row, column] += change
            yield wrong
    for column in range(4):
        wrong = T.copy()
        wrong[3, column] += size
        yield wrong


@pytest.mark.parametrize("size", [1e-9, -1e-9])
def test_one_fault_is_enough(size):
    found = 0
    for T in random_poses(50):
        assert lib.kr_is_rigid(doubles(T))
        assert not skewed(T[None, :3].reshape(-1, 12).T).any()
        for number, wrong in enumerate(with_one_fault(T, size)):
            assert not lib.kr_is_rigid(doubles(wrong)), number
            assert bool(skewed(wrong[None, :3].reshape(-1, 12).T).any()) is (number < 9), number
            found += 1
    assert found == 50 * 13


def test_rotations_are_put_right_and_other_poses_stay_as_they_are():
    T = random_poses(40)
    rough = T.copy()
    rough[::2, :3, :3] += np.random.default_rng(1).uniform(-1e-7, 1e-7, (20, 3, 3))
    rough[1, 3] += 1e-9
    before = rough.copy()
    found = rigid_poses(rough)
    np.testing.assert_array_equal(rough, before)
    np.testing.assert_allclose(
        found[:, :3, :3] @ found[:, :3, :3].swapaxes(1, 2), np.tile(np.eye(3), (40, 1, 1)), atol=2e-15
    )
    np.testing.assert_allclose(found, T, atol=2e-7)
    np.testing.assert_array_equal(found[1::2], T[1::2])
    np.testing.assert_array_equal(found[:, :3, 3], T[:, :3, 3])
    np.testing.assert_allclose(nearest_rotations(rough[::2, :3, :3]), found[::2, :3, :3], atol=1e-15)
    for wrong in (T[0], T[:, :3], np.full((2, 4, 4), np.nan), 2.0 * T):
        with pytest.raises(InputError, match="T"):
            rigid_poses(wrong)


def test_errors_are_those_of_scipys_rotations():
    poses, wanted = random_poses(100), random_poses(100, seed=1)
    wanted[::2, :3, :3] = poses[::2, :3, :3] @ Rotation.from_rotvec(1e-9 * np.eye(3)[0]).as_matrix()
    for T, goal in zip(poses, wanted, strict=True):
        turned = Rotation.from_matrix(T[:3, :3].T @ goal[:3, :3]).magnitude()
        away = np.linalg.norm(T[:3, 3] - goal[:3, 3])
        bent = 2 * np.arcsin(np.linalg.norm(T[:3, 2] - goal[:3, 2]) / 2)
        assert PoseGoal(goal).error(T) == pytest.approx((away, turned), rel=1e-6, abs=1e-13)
        assert AxisGoal(goal[:3, 3], 5.0 * goal[:3, 2]).error(T) == pytest.approx((away, bent), rel=1e-6, abs=1e-13)
        assert PositionGoal(goal[:3, 3]).error(T) == (pytest.approx(away), 0.0)
    np.testing.assert_array_equal(AxisGoal([0, 0, 1]).axis, [0, 0, -1])
    assert AxisGoal([0, 0, 1], [0, 1e-8, 0]).axis.tolist() == [0, 1, 0]
