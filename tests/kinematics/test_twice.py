"""No posture is listed twice, modulo a turn, where branches meet."""

import numpy as np
import pytest

from kinreach._rotations import TURN
from kinreach.kinematics import Arm3Kinematics, ArmKinematics, SixAxisKinematics, UR5Kinematics, URKinematics

#: Postures nearer to each other than this are the same [rad].
SAME = 1e-6
HALF = np.pi / 2
COUNT = 60


def at_branch_points(n, rng):
    """Postures at which branches of a UR meet, with the other joints anywhere."""
    q = rng.uniform(-np.pi, np.pi, (COUNT, n))
    elbow, wrist, both, upright, right = (q.copy() for _ in range(5))
    elbow[:, 2] = 0.0
    wrist[:, 4] = rng.choice([0.0, np.pi], COUNT)
    both[:, [2, 4]] = 0.0
    upright[:, 1:4] = -HALF, 0.0, -HALF
    right = HALF * np.round(right / HALF)
    return np.concatenate([elbow, wrist, both, upright, right, np.zeros((1, n))])


def twins(q):
    """Pairs of rows that are the same posture."""
    away = np.abs((q[:, None] - q[None] + np.pi) % TURN - np.pi).max(axis=-1)
    return np.argwhere(np.triu(away < SAME, 1)).tolist()


@pytest.mark.parametrize(
    "kin",
    [URKinematics("ur5"), URKinematics("ur5e"), URKinematics("ur3e"), UR5Kinematics(tip="tcp", base="world"),
     SixAxisKinematics("ur10")],
    ids=["ur5", "ur5e", "ur3e", "world", "six_axis"],
)  # fmt: skip
def test_a_posture_of_a_singular_pose_is_listed_once(kin):
    postures = at_branch_points(6, np.random.default_rng(0))
    postures = postures[:: 7 if isinstance(kin, SixAxisKinematics) else 1]
    T = kin.fk(postures)
    batch = kin.batch(T)
    found = 0
    for pose, row in zip(T, batch.q, strict=True):
        solutions = kin.all_solutions(pose)
        assert twins(solutions.q) == []
        assert twins(row[np.isfinite(row).all(axis=1)]) == []
        if len(solutions):
            assert solutions.residual.max() < 1e-7
            found += 1
    assert found >= 0.95 * len(T) >= 40


def test_a_posture_of_the_three_joint_arm_is_listed_once():
    kin = Arm3Kinematics()
    rng = np.random.default_rng(1)
    q = rng.uniform(kin.lower, kin.upper, (200, 3))
    q[:100, 2] = 0.0
    q[50:150, 1] = 0.0
    assert all(twins(kin.all_solutions(kin.fk(row)).q) == [] for row in q)


def test_two_elbows_a_little_apart_are_two_postures():
    kin = ArmKinematics.of("ur5")
    rng = np.random.default_rng(2)
    pairs = 0
    for q in rng.uniform(-np.pi, np.pi, (50, 6)):
        q[2], q[4] = 1e-4, 0.5 + abs(q[4]) / 2
        found = kin.all_solutions(kin.fk(q)).q
        assert np.abs((found - q + np.pi) % TURN - np.pi).max(axis=1).min() < 1e-6
        pairs += bool((np.abs(found[:, 2] + 1e-4) < 1e-6).any())
    assert pairs == 50
