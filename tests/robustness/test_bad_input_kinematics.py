"""Kinematics under fuzz: whatever is passed, the answer agrees with Pinocchio, or it is a `KinreachError`."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import Arm3Kinematics, ArmKinematics, UR5Kinematics
from tests.robustness.fuzzing import NUMBERS, bad_arrays, dressed, things

ARMS = {
    "ur5": UR5Kinematics(),
    "ur5-tcp-world": UR5Kinematics(tip="tcp", base="world"),
    "arm3": Arm3Kinematics(base="world"),
    "generic": ArmKinematics("ur5", tip="tcp"),
}
CLOSED = {name: kin for name, kin in ARMS.items() if name != "generic"}
each_arm = pytest.mark.parametrize("kin", ARMS.values(), ids=ARMS)
each_closed = pytest.mark.parametrize("kin", CLOSED.values(), ids=CLOSED)


def oracle(kin, q):
    """The tip's pose in the base frame, by Pinocchio alone."""
    data = kin.model.createData()
    pin.framesForwardKinematics(kin.model, data, np.asarray(q, dtype=float))
    return np.linalg.inv(kin.T_world_base) @ data.oMf[kin.tip_frame].homogeneous


def numbers_of(value):
    return np.asarray(value).astype(float)


def angles(*shape, most=7.0):
    return arrays(np.float64, shape, elements=st.floats(-most, most))


def agrees(kin, q, T):
    """Whether a posture reaches a goal: a pose, or for three joints its position."""
    got = oracle(kin, q)
    error = np.abs(got[:3, 3] - T[:3, 3]).max() if kin.n == 3 else np.abs(got - T).max()
    given = T[:3, :3]  # what is not quite a rotation is taken for the nearest one
    return error < 1e-6 + np.abs(given.T @ given - np.eye(3)).max()


@st.composite
def targets(draw, kin):
    """Poses that are reached, and such that are scaled, mirrored, sheared, far away or of a wrong type."""
    if draw(st.integers(0, 3)) == 0:
        return draw(bad_arrays((4, 4)))
    T = oracle(kin, draw(angles(kin.n, most=3.0)))
    how = draw(
        st.sampled_from(["good", "good", "scaled", "mirrored", "sheared", "far", "entry", "row", "float32", "wild"])
    )
    size = draw(st.sampled_from([1e-9, 1e-6, 1e-4, 0.1, 1.0, 1e3, 1e8, 1e160, 1e308]))
    if how == "scaled":
        T[:3, :3] *= 1 + size
    elif how == "mirrored":
        T[:3, draw(st.integers(0, 2))] *= -1
    elif how == "sheared":
        T[draw(st.integers(0, 2)), draw(st.integers(0, 2))] += size
    elif how == "far":
        T[:3, 3] = size * np.array(draw(st.tuples(*[st.sampled_from([-1.0, 0.0, 1.0])] * 3)))
    elif how == "entry":
        T[draw(st.integers(0, 3)), draw(st.integers(0, 3))] = draw(NUMBERS)
    elif how == "row":
        T[3] = draw(arrays(np.float64, 4, elements=NUMBERS))
    elif how == "wild":
        T = np.asfortranarray(np.broadcast_to(T, (2, 4, 4)))[1]
    return T.astype(np.float32) if how == "float32" else T


@each_arm
def test_forward_kinematics_and_jacobian(kin, fuzzed):
    def run(case):
        for call in (kin.fk, kin.positions, kin.jacobian, kin.within_limits, kin.joints_outside_limits):
            try:
                got = call(case)
            except InputError:
                continue
            q = numbers_of(case)
            rows = q.reshape(-1, kin.n)
            if call in (kin.fk, kin.positions):
                T = np.array([oracle(kin, row) for row in rows]).reshape(*q.shape[:-1], 4, 4)
                np.testing.assert_allclose(got, T if call == kin.fk else T[..., :3, 3], atol=1e-9)
            elif call == kin.jacobian:
                assert got.shape == (*q.shape[:-1], 6, kin.n)
                assert np.isfinite(got).all()
            else:
                inside = bool(((q >= kin.lower - 1e-9) & (q <= kin.upper + 1e-9)).all())
                assert inside == (got if call == kin.within_limits else not got)
        kin.fk(case)

    fuzzed(bad_arrays((kin.n,)) | angles(4, kin.n, most=1e6) | angles(2, 0, kin.n), run)


@each_arm
def test_good_numbers_in_any_form(kin, fuzzed):
    def run(case):
        plain, form = case
        np.testing.assert_array_equal(kin.fk(form), kin.fk(plain))
        np.testing.assert_array_equal(kin.positions(form), kin.positions(plain))

    forms = dressed(angles(kin.n)) | dressed(angles(3, kin.n))
    assert fuzzed(forms, run, both=False).refused == 0


@each_closed
def test_all_solutions_and_nearest(kin, fuzzed):
    def run(case):
        T, seed, tol = case
        found = kin.all_solutions(T, seed=seed, tol=tol)
        goal = numbers_of(T)
        goal = np.eye(4) if goal.shape == (3,) else goal
        if np.shape(T) == (3,):
            goal[:3, 3] = numbers_of(T)
        assert found.q.shape == (len(found), kin.n)
        assert bool(found.reason) == (len(found) == 0)
        assert np.isfinite(found.residual).all()
        if tol <= 1e-6:
            assert all(agrees(kin, q, goal) and kin.within_limits(q) for q in found.q)
        if seed is not None:
            result = kin.nearest(T, seed)
            assert result.success == bool(kin.all_solutions(T))
            assert result.q.shape == (kin.n,)
            assert not result.success or (agrees(kin, result.q, goal) and kin.within_limits(result.q))

    seeds = st.none() | angles(kin.n, most=1e6) | angles(kin.n) | bad_arrays((kin.n,))
    tols = st.just(1e-7) | st.just(1e-7) | NUMBERS | things()
    fuzzed(st.tuples(targets(kin), seeds, tols), run, share=1.5)


@each_closed
def test_batches(kin, fuzzed):
    def run(case):
        T, seeds, tol = case
        found = kin.batch(T, tol=tol)
        nearest = kin.nearest_batch(T, seeds, tol=tol)
        count = len(T)
        assert found.q.shape == (*found.valid.shape, kin.n)
        assert found.valid.shape[0] == count
        assert nearest.q.shape == (count, kin.n)
        assert np.array_equal(np.isfinite(found.q).all(axis=-1), found.valid)
        assert np.array_equal(np.isfinite(nearest.q).all(axis=-1), nearest.success)
        for row in range(count):
            goal = numbers_of(T[row])
            assert found.valid[row].sum() == len(kin.all_solutions(goal, tol=tol)) or tol > 1e-6
            postures = [*found.q[row][found.valid[row]], *nearest.q[row : row + 1][nearest.success[row : row + 1]]]
            assert tol > 1e-6 or all(agrees(kin, q, goal) and kin.within_limits(q) for q in postures)

    good = st.lists(angles(kin.n, most=3.0), max_size=3).map(lambda rows: kin.fk(np.reshape(rows, (-1, kin.n))))
    stacks = (
        good
        | good
        | st.lists(targets(kin), max_size=3)
        | st.lists(targets(kin), min_size=1, max_size=1).map(
            lambda rows: np.repeat(rows, 3, axis=0) if np.shape(rows) == (1, 4, 4) else rows
        )
        | bad_arrays((2, 4, 4))
    )
    seeds = angles(kin.n) | angles(3, kin.n) | bad_arrays((kin.n,)) | angles(kin.n, most=1e6)
    tols = st.just(1e-7) | st.just(1e-7) | NUMBERS
    fuzzed(st.tuples(stacks, seeds, tols), run, share=1.5)


def test_axis_goals(fuzzed):
    kin = ARMS["ur5-tcp-world"]

    def run(case):
        position, axis, seed = case
        result = kin.axis_goal(position, axis, seed)
        assert result.q.shape == (6,)
        if result.success:
            T, a = oracle(kin, result.q), numbers_of(axis)
            assert np.abs(T[:3, 3] - numbers_of(position)).max() < 1e-6
            assert np.abs(T[:3, 2] - a / np.linalg.norm(a)).max() < 1e-6
        else:
            assert result.reason

    near = arrays(np.float64, 3, elements=st.floats(-0.7, 0.7))
    points = near | near | bad_arrays((3,))
    fuzzed(st.tuples(points, points, angles(6) | angles(6, most=1e6) | bad_arrays((6,))), run, share=2)


def test_names_and_accept(fuzzed):
    kin = ARMS["ur5"]
    T = oracle(kin, np.full(6, 0.5))

    def run(case):
        kind, value = case
        if kind == "accept":
            assert kin.nearest(T, np.zeros(6), accept=value).q.shape == (6,)
            return
        with pytest.raises(UnknownNameError):
            (UR5Kinematics if kind != "arm" else ArmKinematics)(**{kind: value})
        raise InputError("refused, as it must be")

    values = things().filter(lambda value: value is not None and not callable(value))
    fuzzed(st.tuples(st.sampled_from(["tip", "base", "arm", "accept"]), values), run, both=False)


def test_huge_batches_are_answered_row_by_row():
    q = np.random.default_rng(0).uniform(-3, 3, (120_000, 6))
    kin = ARMS["ur5"]
    T = kin.fk(q)
    found = kin.nearest_batch(T, np.zeros(6))
    assert found.q.shape == (120_000, 6)
    assert found.success.all()
    assert np.abs(kin.fk(found.q[::1000]) - T[::1000]).max() < 1e-6
    T[77_777, 0, 0] += 0.01
    with pytest.raises(InputError, match="entry 77777 is not"):
        kin.batch(T)
