"""The compiled elimination and Newton's method: complete, the same for one pose and for many, safe with any input."""

import numpy as np
import pytest

from benchmarks.ik_arms.random_arms import CLASSES, OTHERS, apart, some_arm
from kinreach._rotations import wrapped
from kinreach.kinematics import URKinematics
from kinreach.kinematics._core import NULL, Struct, doubles, ffi, lib
from kinreach.kinematics._general_6r import Chain, General6R, miss, missed_by, nearest_by_newton, newton
from kinreach.robots import PUBLISHED_CALIBRATIONS
from tests.kinematics.test_core_faults import spoiled

#: Numbers that no arm and no pose has.
ODD = (np.nan, np.inf, -np.inf, 5e-324, 1e-310, 1.7e308, -1e300)


def poses(chain, q):
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :3] = chain.fk(q)
    return T


def postures_at(rng, count):
    return rng.uniform(-np.pi, np.pi, (count, 6))


def starts(arm, T, most):
    """Angles of joint 2 and imaginary parts of one pose's eigenvalues."""
    q, imaginary, pose = np.empty((16, 6)), np.empty(16), np.empty(16, dtype=np.int64)
    count = lib.kr_elimination_starts(
        arm.pointer, doubles(T), 1, most, doubles(q), doubles(imaginary), ffi.from_buffer("long long[]", pose)
    )
    return q[:count, 1], imaginary[:count]


def prepared(chain):
    arm = Struct("kr_elimination")
    lib.kr_elimination_prepare(doubles(chain.rows), arm.pointer)
    return arm


@pytest.mark.parametrize("name", OTHERS)
def test_eigenvalues_are_the_postures_and_nothing_extraneous(name):
    """Sixteen in all; those that are real are joint 2's angles of the postures, and none is i."""
    rng, asked = np.random.default_rng(0), 0
    for _ in range(4):
        chain = Chain(some_arm(rng, name))
        arm, general = prepared(chain), General6R(chain)
        for T in poses(chain, postures_at(rng, 20)):
            angles, imaginary = starts(arm, T, 1.0)
            real = imaginary <= 1e-11
            assert np.count_nonzero(real) + 2 * np.count_nonzero(~real) == 16
            assert imaginary.max() < 0.5 - 1e-9
            (found,) = general.solve(T[None])
            if np.linalg.svd(chain.jacobian(found)[1])[1][:, -1].min() < 1e-3:
                continue
            assert len(found) == np.count_nonzero(real)
            np.testing.assert_allclose(np.sort(wrapped(angles[real])), np.sort(found[:, 1]), atol=1e-5)
            asked += 1
    assert asked > 60


@pytest.mark.parametrize("name", [*OTHERS, *CLASSES])
@pytest.mark.parametrize("size", [0.1, 1.0, 10.0])
def test_the_posture_that_made_the_pose_is_found(name, size):
    """Of every class, also of those whose equations are singular, of any size; each posture found reaches the pose."""
    rng = np.random.default_rng(1)
    for backwards in (False, True):
        placements = some_arm(rng, name, backwards=backwards)
        placements[:, :3, 3] *= size
        chain = Chain(placements)
        general = General6R(chain)
        share = general.tried(postures_at(rng, 100))
        assert general.singular == (share < 1.0)
        assert share == 1.0 or name != "no class"
        q = postures_at(rng, 30)
        T = poses(chain, q)
        for posture, pose, found in zip(q, T, general.solve(T), strict=True):
            assert missed_by(miss(chain.fk(found), pose[None])).max() < 1e-10
            assert apart(posture, found) < 1e-5


def test_singular_poses_keep_their_postures():
    """Where two postures merge the one that made the pose is found to the root of the tolerance, or both beside it."""
    rng, asked = np.random.default_rng(2), 0
    for beside in (0.0, 1e-9, 1e-6, 1e-4):
        chain = Chain(some_arm(rng, "no class"))
        general = General6R(chain)
        for q in postures_at(rng, 12):
            values, determinant = np.linspace(-np.pi, np.pi, 61), []
            along = np.tile(q, (len(values), 1))
            along[:, 2] = values
            determinant = np.linalg.det(chain.jacobian(along)[1])
            (changes,) = np.nonzero(determinant[1:] * determinant[:-1] < 0.0)
            if not len(changes):
                continue
            low, high = values[changes[0]], values[changes[0] + 1]
            for _ in range(50):
                q[2] = 0.5 * (low + high)
                same = np.linalg.det(chain.jacobian(q[None])[1])[0] * determinant[changes[0]] > 0.0
                low, high = (q[2], high) if same else (low, q[2])
            q = q + beside * rng.normal(size=6)
            (found,) = general.solve(poses(chain, q[None]))
            assert apart(q, found) < 2e-5 + 0.1 * beside
            asked += 1
    assert asked > 20


def test_one_pose_and_many_are_the_same_to_the_last_bit():
    rng = np.random.default_rng(3)
    chain = Chain(some_arm(rng, "two pairs in the middle"))
    general = General6R(chain)
    T = poses(chain, postures_at(rng, 50))
    T[::7, :3, 3] *= 3.0  # out of reach
    together, counts = general.postures(T)
    assert {0, 2, 4} <= set(counts.tolist())
    for pose, q, count in zip(T, together, counts, strict=True):
        alone, one = general.postures(pose[None])
        assert one == [count]
        assert alone[0].tobytes() == q.tobytes()


def test_a_pose_that_is_almost_reached():
    """Where two postures just vanish, what misses by less than the tolerance is returned, and nothing else is."""
    rng, asked = np.random.default_rng(4), 0
    chain = Chain(some_arm(rng, "no class"))
    general = General6R(chain)
    for q in postures_at(rng, 40):
        T, outward = poses(chain, q[None]), chain.fk(q[None])[0, :, 3]
        reached, step = 0.0, 0.5
        while step > 1e-9:  # as far outwards as there are postures
            T[0, :3, 3] = (1.0 + reached + step) * outward
            reached, step = (reached + step, step) if len(general.solve(T)[0]) else (reached, 0.5 * step)
        T[0, :3, 3] = (1.0 + reached + 2e-8) * outward
        assert not len(general.solve(T)[0])
        (near,) = general.solve(T, tol=1e-6)
        off = missed_by(miss(chain.fk(near), T))
        assert len(near)
        assert (off < 1e-6).all()
        asked += 1
    assert asked == 40


def test_no_number_makes_it_fail():
    """Poses and arms with numbers that are none, arms of length 0 or with all axes on one line: no posture, no hang."""
    rng = np.random.default_rng(5)
    arm = some_arm(rng, "no class")
    chain = Chain(arm)
    T = poses(chain, postures_at(rng, 1))[0]
    odd_poses = np.tile(T, (len(ODD) * 12, 1, 1))
    odd_poses[:, :3].reshape(-1, 12)[np.arange(len(odd_poses)), np.arange(len(odd_poses)) % 12] = np.repeat(ODD, 12)
    for found in General6R(chain).solve(odd_poses):
        assert np.isfinite(found).all()
    assert not any(len(found) for found in General6R(chain).solve(odd_poses[: 3 * 12]))  # NaN and infinite
    for value in ODD[:3]:
        for index in np.ndindex(7, 3, 4):
            broken = arm.copy()
            broken[index] = value
            assert not len(General6R(Chain(broken)).solve(T[None])[0])
    for placements in (np.zeros((7, 4, 4)), np.tile(np.eye(4), (7, 1, 1))):
        for target in (T, np.eye(4), np.zeros((4, 4))):
            assert np.isfinite(General6R(Chain(placements)).solve(target[None], tol=1.0)[0]).all()


def test_newton_arrives_and_the_damped_one_never_gets_worse():
    rng = np.random.default_rng(6)
    chain = Chain(some_arm(rng, "no class"))
    q = postures_at(rng, 200)
    T = poses(chain, q)
    near = q + rng.uniform(-0.01, 0.01, q.shape)
    found, off = newton(chain, near, T)
    assert np.count_nonzero(off < 1e-12) > 190
    np.testing.assert_allclose(off, missed_by(miss(chain.fk(found), T)), atol=1e-13)
    anywhere = np.vstack([q[:100] + rng.uniform(-0.3, 0.3, (100, 6)), postures_at(rng, 100)])
    best, least = nearest_by_newton(chain, anywhere, T)
    np.testing.assert_allclose(least, missed_by(miss(chain.fk(best), T)), atol=1e-12)
    assert (least <= missed_by(miss(chain.fk(anywhere), T)) + 1e-12).all()
    assert np.count_nonzero(least[:100] < 1e-10) > 95


def test_numbers_of_any_kind_go_through_a_calibrated_ur_and_elimination():
    """Poses, fits and placements with odd entries: the call ends, and says how many postures it wrote."""
    rng, found = np.random.default_rng(7), 0
    kin = URKinematics.from_calibration(PUBLISHED_CALIBRATIONS["ur10e_a"], model="ur10e")
    poses, rows = kin.fk(rng.uniform(-3, 3, (200, 6))), np.empty((16, 8))
    numbers, fitting = ("turned", "centre", "radius"), kin._prepared.pointer
    for k in range(600):
        arm = Struct("kr_calibrated")
        arm.pointer[0] = fitting[0]
        if k % 3 == 1:
            for name in numbers:
                setattr(arm.pointer, name, float(spoiled(rng, [getattr(fitting, name)])[0]))
            arm.pointer.zeros = spoiled(rng, list(fitting.zeros)).tolist()
            arm.pointer.fitted.d4 = float(spoiled(rng, [fitting.fitted.d4])[0])
        if k % 3 == 2:
            placements = spoiled(rng, list(fitting.elimination.placements))
            lib.kr_elimination_prepare(doubles(placements), ffi.addressof(arm.pointer, "elimination"))
        T, tol = spoiled(rng, poses[k % 200]), float(spoiled(rng, [1e-7])[0])
        n = lib.kr_solutions(
            lib.KR_CALIBRATED, arm.pointer, kin._core.pointer, doubles(T), NULL, k % 2, tol, doubles(rows)
        )
        assert -1 <= n <= 16
        assert n or 0 <= rows[0, 0] <= 16
        assert n < 1 or len(set(rows[:n, 0])) == n
        found += n > 0
    assert found > 50
