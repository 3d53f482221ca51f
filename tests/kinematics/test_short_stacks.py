"""Stacks of a few postures or poses are what single calls give, bit for bit, in less time than long stacks take."""

import itertools

import numpy as np
import pytest

from benchmarks.ik_arms.random_arms import kinematics, some_arm
from kinreach.errors import InputError
from kinreach.kinematics import Arm3Kinematics, ArmKinematics, SixAxisKinematics, URKinematics
from kinreach.robots import get_arm

#: Up to so many postures, and poses, are taken one after the other.
FEW, FEW_POSES = 32, 8

NARROW = get_arm("ur5e").with_limits({"wrist_3_joint": (-1.0, 1.0)})
KINEMATICS = {
    "ur5e": lambda: URKinematics("ur5e"),
    "narrow": lambda: URKinematics(NARROW, base="world"),
    "calibrated": lambda: URKinematics.from_calibration("ur5e_a", model="ur5e"),
    "six_axis": lambda: SixAxisKinematics("ur10", tip="tool0"),
    "arm3": Arm3Kinematics,
}


@pytest.mark.parametrize("arm", ["ur5e", "panda", "arm3"])
def test_postures(arm):
    """`SerialChain` takes as long for two postures as for forty: 28 times as long as two calls."""
    kin = ArmKinematics(arm)
    q = np.random.default_rng(5).uniform(-np.pi, np.pi, (2 * FEW, kin.n))
    for count in (1, 2, 3, 8, FEW):
        stacks = [q[:count], q[:count, None]] + [q[:8].reshape(2, 4, kin.n)] * (count == 8)
        for stack, (method, shape) in itertools.product(stacks, (("fk", (4, 4)), ("jacobian", (6, kin.n)))):
            found = getattr(kin, method)(stack)
            assert found.shape == (*stack.shape[:-1], *shape)
            single = [getattr(kin, method)(row) for row in q[:count]]
            np.testing.assert_array_equal(found.reshape(count, *shape), single)
        np.testing.assert_array_equal(kin.positions(q[:count]), kin.fk(q[:count])[:, :3, 3])
    single = np.array([kin.fk(row) for row in q])
    assert not (kin.fk(q) == single).all(), "longer ones go through the chain"
    np.testing.assert_allclose(kin.fk(q), single, rtol=0, atol=1e-10)
    for empty in (q[:0], q[:0].reshape(0, 2, kin.n)):
        assert kin.fk(empty).shape == (*empty.shape[:-1], 4, 4)
        assert kin.jacobian(empty).shape == (*empty.shape[:-1], 6, kin.n)
        assert kin.positions(empty).shape == (*empty.shape[:-1], 3)


@pytest.mark.parametrize("name", KINEMATICS)
def test_poses(name):
    """Singular ones and ones out of reach, too; a long stack has the same postures."""
    kin, rng = KINEMATICS[name](), np.random.default_rng(3)
    q = rng.uniform(np.maximum(kin.lower, -np.pi), np.minimum(kin.upper, np.pi), (40, kin.n))
    q[:10, -2] = 0.0
    T, seeds = kin.fk(q), rng.uniform(-3, 3, q.shape)
    T[30:, :3, 3] *= 1.5
    T = T[:, :3, 3] if kin.n == 3 else T
    regular, postures, none = np.arange(40) >= 10, 0, 0
    for limits, few in ((True, 1), (True, 3), (False, FEW_POSES)):
        many = kin.batch(T, limits=limits)
        for start in range(0, 40, few):
            part = slice(start, min(start + few, 40))
            found, near = kin.batch(T[part], limits=limits), kin.nearest_batch(T[part], seeds[part])
            assert found.q.shape == many.q[part].shape
            np.testing.assert_array_equal(np.isnan(found.q).any(axis=2), ~found.valid)
            for index, pose in enumerate(T[part]):
                alone = kin.all_solutions(pose, limits=limits)
                np.testing.assert_array_equal(found.q[index][found.valid[index]], alone.q)
                np.testing.assert_array_equal(np.flatnonzero(found.valid[index]), alone.branch)
                single = kin.nearest(pose, seeds[start + index])
                assert bool(near.success[index]) is single.success
                np.testing.assert_array_equal(near.q[index], single.q if single.success else np.full(kin.n, np.nan))
                assert near.branch[index] == single.branch
                postures, none = postures + len(alone), none + (not len(alone))
            rows = regular[part]
            np.testing.assert_array_equal(found.valid[rows], many.valid[part][rows])
            off = np.angle(np.exp(1j * (found.q - many.q[part])))[rows]
            assert np.nanmax(np.abs(off), initial=0.0) < 1e-7
    assert postures > 100
    assert none >= 5


def test_nearest_postures_of_long_stacks_are_those_of_each_pose(tmp_path):
    """In closed form, and by Newton's method from one; there is no branch where there is no posture."""
    rng, count, none, solved = np.random.default_rng(4), 2 * FEW_POSES, 0, set()
    for off in (0.0, 1e-4):
        kin = kinematics(tmp_path, some_arm(rng, "right angles", off=off))
        solved.add(kin.solved)
        T, seeds = kin.fk(rng.uniform(-2.0, 2.0, (count, 6))), rng.uniform(-2.0, 2.0, (count, 6))
        T[::4, :3, 3] *= 9.0
        found = kin.nearest_batch(T, seeds)
        np.testing.assert_array_equal(found.success, np.arange(count) % 4 > 0)
        for row, (pose, seed) in enumerate(zip(T, seeds, strict=True)):
            one = kin.nearest(pose, seed)
            assert (found.success[row], found.branch[row]) == (one.success, one.branch)
            np.testing.assert_allclose(found.q[row], one.q if one.success else np.full(6, np.nan), atol=1e-7)
        none += (found.branch == -1).sum()
    assert solved == {"in closed form", "by Newton's method from a closed form"}
    assert none == count // 2


@pytest.mark.parametrize("kin", [URKinematics("ur5e"), Arm3Kinematics()], ids=["ur5e", "arm3"])
def test_what_is_refused_is_named_as_in_a_long_stack(kin):
    T = np.repeat(kin.fk(np.full((1, kin.n), 0.4)), 2, axis=0)
    broken = T * 1.0
    broken[1, 0, 0] = np.nan
    for few in (broken, T[0], T[:, :2], T[:, :, :2], T[:1] * 2.0):
        with pytest.raises(InputError) as said:
            kin.batch(few)
        with pytest.raises(InputError) as again:
            kin.batch(np.concatenate([few, *[few[:1]] * 12]))
        assert str(said.value).split("(")[0].split("got")[0].split(";")[0] in str(again.value)
    with pytest.raises(InputError, match="entry 1"):
        kin.batch(broken)
    for none in (0.5, T[0, 0, 0], T[0, 0], []):
        with pytest.raises(InputError):
            kin.batch(none)
        with pytest.raises(InputError):
            kin.nearest_batch(none, np.zeros(kin.n))
    with pytest.raises(InputError, match="entry 1"):
        kin.nearest_batch(broken, np.zeros(kin.n))
