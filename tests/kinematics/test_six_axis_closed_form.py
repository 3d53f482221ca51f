"""Six-axis arms of random lengths: a spherical wrist, or three parallel axes, from the base or from the tip."""

import numpy as np
import pytest

from benchmarks.ik_arms.arms import placements_of, singular_poses
from benchmarks.ik_arms.random_arms import (
    CLASSES,
    RIGHT,
    apart,
    kinematics,
    motion,
    moves_to,
    random_motion,
    some_arm,
)
from kinreach.errors import InputError
from kinreach.kinematics import ClosedFormKinematics, SixAxisKinematics
from kinreach.kinematics._general_6r import Chain, General6R
from kinreach.kinematics._six_axis.methods import Backwards, ClosedForm, Elimination, NearlyDecoupled, method_of
from tests.cases import slow

#: Those of which the wrist is straight at 0 and pi.
RIGHT_WRISTS = ("three parallel axes, right angles", "right angles")


def poses(chain, q):
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :3] = chain.fk(q)
    return T


def eliminated(arm, T):
    """Postures of poses by elimination, from the base or from the tip; None if it is singular for the arm."""
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (50, 6))
    for way, sign in ((arm, 1), (np.linalg.inv(arm[::-1]), -1)):
        general = General6R(Chain(way))
        if general.tried(sign * q[:, ::sign]) == 1.0:
            return [sign * found[:, ::sign] for found in general.solve(T if sign == 1 else np.linalg.inv(T))]
    return None


def used(kin):
    method = kin._method
    return type(method._method if isinstance(method, Backwards) else method)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("name", CLASSES)
def test_every_posture(name, backwards, tmp_path):
    """The generating one is among them; batches have the same; a method that knows no classes finds no other."""
    rng, compared = np.random.default_rng(len(name) + backwards), 0
    for _ in range(2):
        arm = some_arm(rng, name, backwards=backwards)
        kin = kinematics(tmp_path, arm)
        assert isinstance(kin, SixAxisKinematics)
        assert used(kin) is ClosedForm
        assert kin.solved == "in closed form"
        q = rng.uniform(-np.pi, np.pi, (5, 6))
        T = kin.fk(q)
        batch = kin.batch(T, limits=False)
        others = eliminated(arm, T) or [np.empty((0, 6))] * len(q)
        for posture, pose, row, valid, other in zip(q, T, batch.q, batch.valid, others, strict=True):
            found = kin.all_solutions(pose, limits=False)
            assert apart(posture, found.q) < 1e-6
            assert found.residual.max() < 1e-9
            assert sorted(set(found.branch)) == found.branch.tolist() == np.flatnonzero(valid).tolist()
            assert max(apart(one, same[None]) for one, same in zip(row[valid], found.q, strict=True)) < 1e-8
            assert all(apart(one, found.q) < 1e-5 for one in other)
            compared += len(other)
    assert compared > 20 or name in ("right angles", "spherical wrist, axes 1 and 2 parallel")


@pytest.mark.slow
def test_batches_have_the_bits_of_single_poses_on_any_number_of_threads(tmp_path):
    """All postures, and the nearest to a seed; singular poses among them."""
    rng, compared = np.random.default_rng(22), 0
    for number, name in enumerate([*CLASSES][::2]):
        kin = kinematics(tmp_path, some_arm(rng, name, backwards=bool(number % 2)))
        T = np.vstack([kin.fk(rng.uniform(-np.pi, np.pi, (4, 6))), *singular_poses(kin, 1).values()])
        seeds = rng.uniform(-np.pi, np.pi, (len(T), 6))
        several = [(kin.batch(T, threads=n), kin.nearest_batch(T, seeds, threads=n)) for n in (1, 3)]
        for index, (pose, seed) in enumerate(zip(T, seeds, strict=True)):
            found, one = kin.all_solutions(pose), kin.nearest(pose, seed)
            for batch, nearest in several:
                assert np.array_equal(batch.q[index][batch.valid[index]], found.q)
                assert one.success == nearest.success[index]
                assert not one.success or np.array_equal(nearest.q[index], one.q)
                compared += len(found)
    assert compared > 200


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.slow
def test_singular_poses_are_solved(name, backwards, tmp_path):
    """Wrist, elbow, both, by rounding beside them, and all joints at right angles: never empty, never wrong."""
    rng, solved = np.random.default_rng(3), 0
    for _ in range(1):
        kin = kinematics(tmp_path, some_arm(rng, name, backwards=backwards))
        arm = (kin._method._method if backwards else kin._method)._arm
        for kind in range(10):
            for _ in range(3):
                theta = rng.uniform(-np.pi, np.pi, 6)
                beside = (0.0, 0.0, 1e-12, 1e-9, 1e-7, 1e-5)[kind % 6]
                if kind % 3 != 1:
                    theta[4] = rng.choice([0, np.pi]) + beside
                if kind % 3:
                    theta[2] = rng.choice([0, np.pi]) - arm.fore_angle + beside
                if kind == 9:
                    theta = rng.integers(-2, 3, 6) * RIGHT
                q = (theta - arm.dh.offset) * arm.dh.sign
                T = kin.fk(-q[::-1] if backwards else q)
                found = kin.all_solutions(T, limits=False)
                assert found.success, (kind, q)
                assert found.residual.max() < 1e-9
                row = kin.batch(T[None], limits=False)
                assert np.flatnonzero(row.valid[0]).tolist() == found.branch.tolist()
                solved += 1
    assert solved == 30


@pytest.mark.slow
@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("name", CLASSES)
def test_the_posture_of_a_singular_pose_is_found(name, backwards, tmp_path):
    """Or one that the arm can move to while its tip stays: straight wrist and bent or straight elbow."""
    rng, exact, joined = np.random.default_rng(21), 0, 0
    for _ in range(2):
        kin = kinematics(tmp_path, some_arm(rng, name, backwards=backwards))
        arm = (kin._method._method if backwards else kin._method)._arm
        for kind in range(8):
            theta = rng.uniform(-np.pi, np.pi, 6)
            beside = (0.0, 1e-12, 1e-9, 1e-7)[kind % 4]
            theta[4] = rng.choice([0, np.pi]) + beside
            if kind % 2:
                theta[2] = rng.choice([0, np.pi]) - arm.fore_angle + beside
            q = (theta - arm.dh.offset) * arm.dh.sign
            q = -q[::-1] if backwards else q
            T = kin.fk(q)
            found = kin.all_solutions(T, limits=False).q
            near = apart(q, found) < 1e-5
            assert near or moves_to(Chain(kin._placements), q, found, T), (kind, q.tolist())
            exact, joined = exact + near, joined + (not near)
    assert exact + joined == 16
    assert joined >= (3 if name in RIGHT_WRISTS else 0)


def test_a_free_joint_keeps_the_seeds_value_and_the_limits(tmp_path):
    """With the wrist stretched the fourth joint takes any value."""
    kin = kinematics(tmp_path, some_arm(np.random.default_rng(5), "right angles"))
    arm, rng, kept, moved = kin._method._arm, np.random.default_rng(6), 0, 0
    for q in rng.uniform(-3, 3, (30, 6)):
        q[4] = -arm.dh.offset[4]
        T, seed = kin.fk(q), rng.uniform(-3, 3, 6)
        for row in kin.all_solutions(T, seed=seed, limits=False).q:
            kept += abs(row[3] - seed[3]) < 1e-9
        kin.lower[5], kin.upper[5] = q[5] - 0.2, q[5] + 0.2
        ClosedFormKinematics._prepare(kin)
        within = kin.all_solutions(T, seed=seed)
        assert within.success
        assert all(abs(row[5] - q[5]) < 0.2 + 1e-9 for row in within.q)
        moved += sum(abs(row[3] - seed[3]) > 1e-9 for row in within.q)
        kin._low[5], kin._high[5] = -3.1416, 3.1416
    assert kept >= 30
    assert moved > 30


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.slow
def test_a_batch_keeps_a_free_joint_within_the_limits(backwards, tmp_path):
    """As single poses do, with limits that the seed's value of the free joint does not fit."""
    rng, kept = np.random.default_rng(15), 0
    for _ in range(2):
        arm = some_arm(rng, "right angles", backwards=backwards)
        kin = kinematics(tmp_path, arm)
        form = (kin._method._method if backwards else kin._method)._arm
        q = rng.uniform(-3, 3, (2, 6))
        q[:, 1 if backwards else 4] = -form.dh.offset[4] * form.dh.sign[4] * (-1 if backwards else 1)
        for posture in q:
            limits = np.array([posture - 0.3, posture + 0.3])
            narrow = kinematics(tmp_path, arm, limits)
            T = narrow.fk(posture + np.linspace(0.0, 0.2, 9)[:, None])  # the first is singular
            alone = narrow.all_solutions(T[0])
            assert alone.success
            batch = narrow.batch(T)
            assert np.flatnonzero(batch.valid[0]).tolist() == alone.branch.tolist()
            assert apart(batch.q[0][batch.valid[0]][0], alone.q) < 1e-6
            assert narrow.nearest_batch(T, np.zeros(6)).success.all()
            kept += 1
    assert kept == 4


@pytest.mark.parametrize("off", [0.0, 1e-9, 1e-8, 1e-7, 1e-6])
def test_a_wrist_centre_beside_the_first_axis(off, tmp_path):
    """Within rounding joint 1 is free, a little further it is not: found, alone as in a batch."""
    rng, solved, turn = np.random.default_rng(16), 0, np.random.default_rng(17).uniform(-1, 1, 5)
    for lengths in ((0.3, 0.3), (0.35, 0.25)):
        links = (
            motion(turn[i], (0, 0, 0, 0, 0.1)[i], (0, *lengths, 0, 0)[i], (RIGHT, 0, 0, RIGHT, -RIGHT)[i])
            for i in range(5)
        )
        kin = kinematics(tmp_path, np.array([np.eye(4), *links, motion(0.3, 0.1, 0, 0)]))
        assert used(kin) is ClosedForm
        q = rng.uniform(-2.5, 2.5, (24, 6))
        ahead = lengths[0] * np.cos(q[:, 1] + turn[1]) + lengths[1] * np.cos(q[:, 1] + turn[1] + q[:, 2] + turn[2])
        q[:, 3] = np.arcsin(np.clip((off - ahead) / 0.1, -1.0, 1.0)) - q[:, 1] - q[:, 2] - turn[1:4].sum()
        q = q[np.abs(ahead) < 0.09]
        T = kin.fk(q)
        batch = kin.batch(np.vstack([T, kin.fk(rng.uniform(-2.5, 2.5, (9, 6)))]), limits=False)
        for posture, pose, valid in zip(q, T, batch.valid[: len(q)], strict=True):
            found = kin.all_solutions(pose, limits=False)
            assert found.success
            assert found.residual.max() < 1e-9
            assert np.flatnonzero(valid).tolist() == found.branch.tolist()
            assert off < 1e-8 or apart(posture, found.q) < 1e-4
            solved += 1
    assert solved >= 4


@pytest.mark.parametrize("off", [0.0, 1e-8])
@pytest.mark.slow
def test_a_wrist_centre_on_the_first_axis_with_a_hand_that_turns_fast(off, tmp_path):
    """Axis 6 is nearly parallel to axis 2: a long hand comes into the elbow's reach at few angles of joint 1."""
    rng, solved, lengths = np.random.default_rng(18), 0, (0.0, 0.106, 0.155, -0.427, 0.0)
    links = [motion(0.0, 0.0, a, tilt) for a, tilt in zip(lengths, (RIGHT, 0.0, 0.0, RIGHT, RIGHT), strict=True)]
    chain = [np.eye(4), *links, motion(0.3, 0.1, 0.0, 0.0)]
    kin = kinematics(tmp_path, np.array([step @ random_motion(rng, off, off) for step in chain]))
    for q in rng.uniform(-np.pi, np.pi, (12, 6)):
        ahead = lengths[1] * np.cos(q[1]) + lengths[2] * np.cos(q[1] + q[2])
        q[3] = np.arccos(ahead / -lengths[3]) - q[1] - q[2]
        q[4] = np.pi + rng.choice([-1, 1]) * rng.uniform(0.02, 0.06)
        found = kin.all_solutions(kin.fk(q), limits=False)
        assert found.success
        assert found.residual.max() < 1e-9
        solved += 1
    assert solved == 12


@pytest.mark.parametrize(("backwards", "off"), [(False, 1e-6), (True, 1e-4)])
@pytest.mark.slow
def test_an_arm_that_is_a_little_off_its_class_has_every_posture(backwards, off, tmp_path):
    """As many as by elimination, near singular poses too, where some appear and others vanish."""
    rng, compared = np.random.default_rng(7), 0
    for name in [*CLASSES][backwards::2]:
        arm = some_arm(rng, name, backwards=backwards, off=off)
        kin = kinematics(tmp_path, arm)
        assert used(kin) is NearlyDecoupled
        assert kin.solved == "by Newton's method from a closed form"
        q = rng.uniform(-np.pi, np.pi, (10, 6))
        form = (kin._method._method if backwards else kin._method)._arm
        for row, joint in ((7, 2), (8, 4), (9, 2), (9, 4)):  # beside singular poses
            theta = 1e-4 - (form.fore_angle if joint == 2 else 0.0) - form.dh.offset[joint]
            q[row, 5 - joint if backwards else joint] = theta * form.dh.sign[joint] * (-1 if backwards else 1)
        T = kin.fk(q)
        batch = kin.batch(T, limits=False)
        others = eliminated(arm, T) or [np.empty((0, 6))] * len(q)
        for posture, pose, row, valid, other in zip(q, T, batch.q, batch.valid, others, strict=True):
            found = kin.all_solutions(pose, limits=False)
            assert apart(posture, found.q) < 1e-4  # where two merge, rounding moves them
            assert found.residual.max() < 1e-9
            assert valid.sum() == len(found)
            assert all(apart(one, found.q) < 1e-4 for one in row[valid])
            assert all(apart(one, found.q) < 1e-4 for one in other)
            compared += len(other)
    assert compared > 100


@pytest.mark.slow
def test_a_wrist_centre_on_the_first_axis(tmp_path):
    """Joint 1 is free there, but the elbow reaches at few of its angles; an arm a little off has a posture at two."""
    kin = of_ssik(tmp_path, "yam_ik")[1]
    assert used(kin) is NearlyDecoupled
    solved = 0
    for T in singular_poses(kin, 10)["elbow"]:
        found = kin.all_solutions(T, limits=False)
        assert found.success
        assert found.residual.max() < 1.1e-7
        solved += 1
    assert solved == 10


@pytest.mark.parametrize("parallel", [False, True])
def test_a_wrist_centre_on_the_second_axis(parallel, tmp_path):
    """Joint 2 turns the wrist only, which reaches at some of its angles."""
    a, d4, tilts = (0.0, 0.3, 0.27, 0.0, 0.0), 0.2, (1.2, 0.0 if parallel else RIGHT, RIGHT, RIGHT, 1.3)
    a = (0.0, 0.3, np.sqrt(0.3**2 - d4**2), 0.0, 0.0) if parallel else a
    links = (motion(0, d4 if i == 3 else 0, a[i], tilts[i]) for i in range(5))
    kin, solved = kinematics(tmp_path, np.array([np.eye(4), *links, motion(0, 0.1, 0, 0)])), 0
    assert used(kin) is ClosedForm
    q = np.random.default_rng(11).uniform(-np.pi, np.pi, (12, 6))
    q[:, 2] = np.arctan2(d4, a[2]) + np.arccos(-0.3 / np.hypot(a[2], d4))  # a2 + a3 cos q3 + d4 sin q3 = 0
    for T in kin.fk(q):
        found = kin.all_solutions(T, limits=False)
        assert found.success
        assert found.residual.max() < 1.1e-7
        assert np.flatnonzero(kin.batch(T[None], limits=False).valid[0]).tolist() == found.branch.tolist()
        solved += 1 in kin._method._arm.rows(T, 1e-4, np.zeros(6))[1]
    assert solved == 12


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("off", [0.0, 1e-6])
def test_two_joints_about_one_axis_are_refused(joint, off, tmp_path):
    """Every posture is singular, or almost: nothing is returned rather than something wrong."""
    rng = np.random.default_rng(12)
    arm = some_arm(rng, "spherical wrist")
    arm[joint + 1] = motion(0.4, 0.2, 0.0, 0.0)
    arm = np.array([step @ random_motion(rng, off, off) for step in arm])
    kin = kinematics(tmp_path, arm)
    assert not isinstance(kin, SixAxisKinematics)
    with pytest.raises(
        InputError,
        match=rf"axes {joint + 1} and {joint + 2} .* nearly coincide"
        if off
        else "every posture: axes . and . .* coincide;",
    ):
        SixAxisKinematics(kin.arm)


@pytest.mark.parametrize("off", [0.0, *slow(1e-6, 1e-4)])
def test_joint_1_and_the_pitch_of_the_hand_are_free(off, tmp_path):
    """A wrist centre on axis 1, and axes 4 and 6 parallel: the elbow reaches at two angles of joint 1 only."""
    rng, solved = np.random.default_rng(13), 0
    for _ in range(2):
        a, turn = [*rng.uniform((0.02, 0.2, 0.2, 0.05), (0.05, 0.4, 0.4, 0.1)), 0.0], rng.uniform(-np.pi, np.pi, 5)
        tilts = rng.choice([-1, 1]) * RIGHT, 0.0, 0.0, RIGHT, rng.choice([-1, 1]) * RIGHT
        chain = [random_motion(rng, 0.3, np.pi), *map(motion, turn, np.zeros(5), a, tilts)]
        chain = np.array([step @ random_motion(rng, off, off) for step in (*chain, random_motion(rng, 0.2, np.pi))])
        kin = kinematics(tmp_path, chain)
        assert used(kin) is (NearlyDecoupled if off else ClosedForm)
        T = singular_poses(kin, 9)["both"]
        for pose, valid in zip(T, kin.batch(T, limits=False).valid, strict=True):
            found = kin.all_solutions(pose, limits=False)
            assert found.success
            assert found.residual.max() < 1.1e-7
            assert np.flatnonzero(valid).tolist() == found.branch.tolist()
            axes = Chain(kin._placements).jacobian(found.q)[1][:, 3:]
            solved += np.abs(np.cross(axes[..., 3], axes[..., 5])).max(axis=1).min() < 1e-3
    assert solved >= 5


def test_an_arm_of_no_class_is_solved_by_elimination(tmp_path):
    rng = np.random.default_rng(8)
    arm = some_arm(rng, "spherical wrist")
    arm[4, :3, 3] += 0.1  # axes 4 and 5 do not meet
    kin = kinematics(tmp_path, arm)
    assert used(kin) is Elimination
    assert kin.solved == "by elimination"
    for q in rng.uniform(-np.pi, np.pi, (5, 6)):
        found = kin.all_solutions(kin.fk(q), limits=False)
        assert apart(q, found.q) < 1e-6
        assert not found.singularity.any()


@pytest.mark.slow
def test_arms_whose_elimination_is_singular_are_solved(tmp_path):
    """Right angles and zeros that make no closed form: eigenvalues of one joint find a part of the postures."""
    rng, solved = np.random.default_rng(0), 0
    while solved < 4:
        a, d = np.where(rng.random((2, 6)) < 0.45, 0.0, rng.choice([-1, 1], (2, 6)) * rng.uniform(0.1, 0.5, (2, 6)))
        tilts = rng.choice([0.0, RIGHT, -RIGHT], 6)
        placements = np.array([np.eye(4), *map(motion, np.zeros(5), d, a, tilts), motion(0.3, 0.1, 0.05, 0.4)])
        if not isinstance(method := method_of(placements), float) and method.rank == 0:
            general = General6R(Chain(placements))
            if general.tried(np.random.default_rng(1).uniform(-np.pi, np.pi, (20, 6))) > 0.9:
                continue
            kin = kinematics(tmp_path, placements)
            for q in rng.uniform(-np.pi, np.pi, (20, 6)):
                found = kin.all_solutions(kin.fk(q), limits=False)
                assert apart(q, found.q) < 1e-5
                assert found.residual.max() < 1e-9
            solved += 1


def ssik_arms():
    ssik = pytest.importorskip("ssik")
    return [entry.name for entry in ssik.list_arms() if entry.dof == 6]


def of_ssik(tmp_path, name):
    """An arm that ssik ships, in both packages."""
    ssik = pytest.importorskip("ssik")
    arm = ssik.Manipulator.from_prebuilt(name)
    return arm, kinematics(tmp_path, placements_of(arm))


def same_as_ssik(tmp_path, name, count):
    arm, kin = of_ssik(tmp_path, name)
    compared = 0
    for q in np.random.default_rng(9).uniform(-np.pi, np.pi, (count, 6)):
        T = arm.fk(q)
        ours = kin.all_solutions(T, limits=False).q
        theirs = np.array([one.q for one in arm.solve(T, respect_limits=False, enumerate_windings=False)])
        assert apart(q, ours) < 1e-5, name
        assert all(apart(one, ours) < 1e-4 for one in theirs), name
        compared += len(theirs)
    assert compared >= 2 * count


@pytest.mark.parametrize(
    "name", ["irb6700_ik", "rs007n_ik", "viperx300s_ik", "widowx250s_ik", "z1_ik", "cr5_ik", "piper_ik"]
)
def test_ssik_finds_no_other(name, tmp_path):
    same_as_ssik(tmp_path, name, 8)


@pytest.mark.slow
def test_every_six_axis_arm_of_ssik(tmp_path):
    names = ssik_arms()
    for name in names:
        same_as_ssik(tmp_path, name, 10)
    assert len(names) >= 53
