"""Whatever is thrown at the inverse kinematics: a clear error or a valid answer, never anything else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kinreach.errors import InputError, KinreachError
from kinreach.kinematics import Arm3Kinematics, ArmKinematics, AxisGoal, IKResult, PoseGoal, PositionGoal, UR5Kinematics

KIN = UR5Kinematics(tip="tool0")
ARM3 = Arm3Kinematics()
POSE = KIN.fk(np.full(6, 0.5))
ANY = st.floats(allow_nan=True, allow_infinity=True)
ANGLES = arrays(np.float64, 6, elements=st.floats(-7, 7))


@given(arrays(np.float64, st.tuples(st.integers(0, 5), st.integers(0, 5)), elements=ANY))
def test_what_is_not_a_pose_is_refused(T):
    with np.errstate(over="ignore", invalid="ignore"):
        rotation = T.shape == (4, 4) and np.abs(T[:3, :3].T @ T[:3, :3] - np.eye(3)).max() < 1e-4
    if not rotation or not np.isfinite(T).all():
        with pytest.raises(InputError, match=r"T must|block of T"):
            KIN.all_solutions(T)


@given(ANGLES, ANGLES)
def test_any_reachable_pose_and_seed_has_an_answer(q, seed):
    T = KIN.fk(q)
    result = KIN.nearest(T, seed)
    assert result.success
    assert KIN.within_limits(result.q)
    assert result.position_error < 1e-7
    assert result.orientation_error < 1e-7


@given(st.integers(0, 2), st.integers(0, 2), st.floats(1e-4, 0.5))
def test_sheared_rotations_are_refused(i, j, size):
    T = POSE.copy()
    T[i, j] += size
    with pytest.raises(InputError, match="rotation"):
        KIN.all_solutions(T)
    with pytest.raises(InputError, match=r"rotation; entry 1 is not"):
        KIN.batch(np.array([POSE, T]))


@given(st.floats(1e-4, 1.5), st.sampled_from([-1.0, 1.0]))
def test_columns_at_other_than_right_angles_are_refused(angle, sign):
    """The first two have length one, and the third is their product: only the right angle is missing."""
    T = POSE.copy()
    T[:3, 1] = np.cos(angle) * POSE[:3, 1] + sign * np.sin(angle) * POSE[:3, 0]
    T[:3, 2] = np.cross(T[:3, 0], T[:3, 1])
    for ask in (KIN.all_solutions, lambda T: KIN.batch(np.array([POSE, T]))):
        with pytest.raises(InputError, match="rotation"):
            ask(T)


@pytest.mark.parametrize("last", [(0, 0, 0, 2), (0, 0, 1e-3, 1), (1, 0, 0, 1), (0, 0, 0, 0)])
def test_a_last_row_of_no_pose_is_refused(last):
    T = POSE.copy()
    T[3] = last
    for ask in (KIN.all_solutions, lambda T: KIN.nearest(T, np.zeros(6)), lambda T: KIN.batch(np.array([POSE, T]))):
        with pytest.raises(InputError, match="last row"):
            ask(T)


def test_a_reflection_is_refused():
    with pytest.raises(InputError, match="determinant -1"):
        KIN.all_solutions(POSE @ np.diag([1, 1, -1, 1]))


@given(arrays(np.float64, 3, elements=ANY))
@settings(max_examples=200)
def test_any_point_is_an_error_or_an_answer(p):
    if not (np.abs(p) <= 1e6).all():
        with pytest.raises(InputError, match=r"finite|within ±1e\+06"):
            ARM3.nearest(p, np.zeros(3))
        return
    result = ARM3.nearest(p, np.zeros(3))
    assert isinstance(result, IKResult)
    assert result.success == (result.position_error < 1e-7)
    assert result.success or result.reason


@pytest.mark.parametrize(
    "call",
    [
        lambda: KIN.nearest(POSE, np.zeros(5)),
        lambda: KIN.nearest(POSE, [np.nan] * 6),
        lambda: KIN.nearest(POSE, "home"),
        lambda: KIN.axis_goal([0, 0], [0, 0, 1], np.zeros(6)),
        lambda: KIN.axis_goal([0, 0, 0.5], [0, 0, 0], np.zeros(6)),
        lambda: KIN.axis_goal([0, 0, np.inf], [0, 0, 1], np.zeros(6)),
        lambda: KIN.batch(POSE),
        lambda: KIN.batch([[1, 2], [3]]),
        lambda: KIN.batch(np.full((2, 4, 4), np.nan)),
        lambda: KIN.nearest_batch([POSE, POSE], np.zeros((3, 6))),
        lambda: KIN.nearest_batch([POSE], np.full(6, np.nan)),
        lambda: ARM3.batch(np.zeros((4, 2))),
        lambda: ARM3.batch(np.full((4, 3), np.inf)),
        lambda: ARM3.all_solutions(np.zeros(2)),
        lambda: PoseGoal(np.zeros((4, 4))),
        lambda: AxisGoal([0, 0, 0], [0, 0, 0]),
        lambda: PositionGoal([0, None, 0]),
    ],
)
def test_malformed_calls_are_input_errors(call):
    with pytest.raises(InputError) as caught:
        call()
    assert isinstance(caught.value, KinreachError)
    assert str(caught.value)


def test_an_empty_batch_is_fine():
    assert KIN.batch(np.empty((0, 4, 4))).q.shape == (0, 8, 6)
    assert KIN.nearest_batch(np.empty((0, 4, 4)), np.zeros(6)).q.shape == (0, 6)


def test_what_becomes_of_the_callers_array_changes_neither_goals_nor_solutions():
    T, p, axis = np.array(POSE), np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 1.0])
    goals = PoseGoal(T), AxisGoal(p, axis), PositionGoal(p)
    solutions = KIN.all_solutions(T), ARM3.all_solutions(q := ARM3.fk(np.zeros(3))[:3, 3].copy())
    T[:3, 3] += 1.0
    p += 1.0
    q += 1.0
    for goal, wanted in zip(goals, (POSE[:3, 3], [0.1, 0.2, 0.3], [0.1, 0.2, 0.3]), strict=True):
        np.testing.assert_array_equal(goal.position, wanted)
    for found in solutions:
        assert len(found)
        assert found.residual.max() < 1e-9


@pytest.mark.parametrize("arm", ["ur5e", "arm3", "ur5-thesis"])
def test_arrays_in_any_order_of_memory_are_read_as_they_are(arm):
    kin, rng, tried = ArmKinematics.of(arm), np.random.default_rng(3), 0
    for _ in range(20):
        q = rng.uniform(kin.lower, kin.upper)
        T, seed = kin.fk(q), rng.uniform(kin.lower, kin.upper)
        strided = np.repeat(seed, 2)[::2]
        assert not strided.flags.c_contiguous
        plain, other = kin.nearest(T, seed), kin.nearest(np.asfortranarray(T), strided)
        np.testing.assert_array_equal(plain.q, other.q)
        rows = [kin.all_solutions(a, seed=b).q for a, b in ((T, seed), (np.asfortranarray(T), strided))]
        np.testing.assert_array_equal(*rows)
        many = [kin.nearest_batch(a, b).q for a, b in ((T[None], seed), (np.asfortranarray(T)[None], strided))]
        np.testing.assert_array_equal(*many)
        tried += 1
    assert tried == 20
