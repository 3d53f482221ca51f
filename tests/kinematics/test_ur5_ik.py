"""Closed-form inverse kinematics of the UR5: correctness, inclusion, choice of branch, and reasons."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from kinreach._rotations import pose_error
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, PositionGoal, Status, URKinematics
from kinreach.robots import get_arm

FLANGE = URKinematics("ur5-thesis", tip="tool0")
TURN = 2 * np.pi


def postures(seed, count):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, 6))


def wide_ur5():
    """The UR5 with +-2 pi on every joint, as the real arm has it (the elbow stays at +-pi)."""
    arm = get_arm("ur5-thesis")
    elbow = arm.urdf.index('<joint name="elbow_joint"')
    after = arm.urdf.index("</joint>", elbow)
    parts = (arm.urdf[:elbow], arm.urdf[elbow:after], arm.urdf[after:])
    wide = [part.replace("3.14159265359", "6.28318530718") for part in parts]
    # the URDF writes pi in nothing but limits
    assert sum(part.count("6.28318530718") for part in wide) == 12
    return replace(arm, name="ur5_wide", build_urdf=lambda: wide[0] + parts[1] + wide[2])


@pytest.mark.parametrize(("tip", "base"), [("tool0", "base_link"), ("tcp", "world")])
def test_every_branch_reaches_and_the_generating_posture_comes_back(tip, base):
    kin = URKinematics("ur5-thesis", tip=tip, base=base)
    reference = ArmKinematics("ur5-thesis", tip=tip, base=base)
    checked = 0
    for q in postures(0, 500):
        T = reference.fk(q)
        solutions = kin.all_solutions(T)
        assert solutions.status is Status.OK
        assert np.abs(solutions.q - q).max(axis=1).min() < 1e-6
        assert solutions.residual.max() < 1e-9
        assert np.abs(reference.fk(solutions.q) - T).max() < 1e-9
        assert (np.diff(solutions.branch) > 0).all()
        assert solutions.branch[0] >= 0
        assert solutions.branch[-1] < 8
        checked += len(solutions)
    assert checked > 500 * 7


def test_batch_reaches_for_ten_thousand_poses_and_every_branch():
    q = postures(1, 10_000)
    T = FLANGE.fk(q)
    batch = FLANGE.batch(T)
    pose, branch = np.nonzero(batch.valid)
    assert len(pose) > 70_000
    assert set(branch) == set(range(8))
    np.testing.assert_allclose(FLANGE.fk(batch.q[pose, branch]), T[pose], rtol=0, atol=1e-9)
    assert np.isnan(batch.q[~batch.valid]).all()
    assert np.nanmin(np.abs(batch.q - q[:, None]).max(axis=2), axis=1).max() < 1e-4
    assert np.abs(batch.q[batch.valid]).max() <= np.pi


def test_batch_equals_single_poses():
    T = FLANGE.fk(postures(2, 500))
    batch = FLANGE.batch(T)
    for i, pose in enumerate(T):
        solutions = FLANGE.all_solutions(pose)
        np.testing.assert_array_equal(np.flatnonzero(batch.valid[i]), solutions.branch)
        np.testing.assert_allclose(batch.q[i, solutions.branch], solutions.q, rtol=0, atol=1e-9)


def test_nearest_batch_equals_nearest():
    kin = URKinematics(arm=wide_ur5(), tip="tcp", base="world")
    rng = np.random.default_rng(3)
    q = rng.uniform(kin.lower, kin.upper, (300, 6))
    seeds = rng.uniform(kin.lower, kin.upper, (300, 6))
    T = kin.fk(q)
    batch = kin.nearest_batch(T, seeds)
    assert batch.success.all()
    for i in range(300):
        single = kin.nearest(T[i], seeds[i])
        assert single.success
        assert single.branch == batch.branch[i]
        np.testing.assert_allclose(batch.q[i], single.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(kin.nearest_batch(T, q).q, q, atol=1e-5)


def test_nearest_is_exact_over_all_windings():
    kin = URKinematics(arm=wide_ur5(), tip="tool0")
    assert kin.lower[0] == pytest.approx(-TURN)
    assert kin.upper[2] == pytest.approx(np.pi)
    rng = np.random.default_rng(4)
    turns = np.array(list(itertools.product((-TURN, 0.0, TURN), repeat=6)))
    for _ in range(60):
        q, seed = rng.uniform(kin.lower, kin.upper, (2, 6))
        result = kin.nearest(kin.fk(q), seed)
        candidates = (kin.all_solutions(kin.fk(q), limits=False).q[:, None] + turns).reshape(-1, 6)
        within = ((candidates >= kin.lower - 1e-9) & (candidates <= kin.upper + 1e-9)).all(axis=1)
        best = np.linalg.norm(candidates[within] - seed, axis=1).min()
        assert np.linalg.norm(result.q - seed) == pytest.approx(best, abs=1e-9)
        assert kin.within_limits(result.q)


def test_a_seed_sorts_the_solutions():
    rng = np.random.default_rng(5)
    for _ in range(50):
        T, seed = FLANGE.fk(rng.uniform(-np.pi, np.pi, 6)), rng.uniform(-np.pi, np.pi, 6)
        distance = np.linalg.norm(FLANGE.all_solutions(T, seed=seed).q - seed, axis=1)
        assert (np.diff(distance) >= 0).all()


def test_branch_index_is_stable_along_a_path():
    """Around the start pose no singularity is crossed, so each of its branches keeps its index."""
    rng = np.random.default_rng(6)
    followed = set()
    for start in FLANGE.all_solutions(FLANGE.fk(FLANGE.arm.home)).q:
        path = start + 0.02 * np.sin(np.linspace(0, 6, 100))[:, None] * rng.choice((-1, 1), 6)
        indices = set()
        for posture in path:
            solutions = FLANGE.all_solutions(FLANGE.fk(posture))
            off = np.abs((solutions.q - posture + np.pi) % TURN - np.pi).max(axis=1)
            assert off.min() < 1e-6
            indices.add(int(solutions.branch[off.argmin()]))
        assert len(indices) == 1
        followed |= indices
    assert len(followed) == 8


def test_accept_moves_on_to_the_next_branch():
    T = FLANGE.fk([0.3, -1.0, 1.2, -0.4, 0.9, 0.2])
    order = FLANGE.all_solutions(T, seed=np.zeros(6)).q
    offered = []

    def third(q):
        offered.append(q)
        return len(offered) == 3

    result = FLANGE.nearest(T, np.zeros(6), accept=third)
    assert result.success
    assert result.position_error < 1e-9
    np.testing.assert_array_equal(np.array(offered), order[:3])
    np.testing.assert_array_equal(result.q, order[2])
    written = FLANGE.nearest(T, np.zeros(6), accept=lambda q: q.fill(9.0) is None)
    np.testing.assert_array_equal(written.q, order[0])
    refused = FLANGE.nearest(T, np.zeros(6), accept=lambda q: False)
    assert refused.status is Status.REJECTED
    assert "refused all 8" in refused.reason


def far(x, y, z):
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = x, y, z
    return T


@pytest.mark.parametrize(
    ("T", "reason"),
    [
        (far(2.0, 0, 0), "stretched elbow"),
        (far(0.05, 0, 0.5), "shoulder cylinder"),
    ],
)
def test_out_of_reach_says_which_part(T, reason):
    result = FLANGE.nearest(T, np.zeros(6))
    assert result.status is Status.OUT_OF_REACH
    assert not result.success
    assert reason in result.reason
    np.testing.assert_array_equal(result.q, np.zeros(6))
    assert len(FLANGE.all_solutions(T)) == 0
    assert FLANGE.all_solutions(T).q.shape == (0, 6)


def test_every_unreachable_pose_has_a_reason():
    rng = np.random.default_rng(13)
    counts = {"shoulder cylinder": 0, "stretched elbow": 0}
    for i, T in enumerate(FLANGE.fk(postures(13, 1500))):
        size = 0.3 if i % 2 else 1.2
        T[:3, 3] = rng.uniform(-size, size, 3) + np.array([0, 0, FLANGE.geometry.d1])
        solutions = FLANGE.all_solutions(T)
        if not solutions.success:
            assert solutions.status is Status.OUT_OF_REACH
            assert solutions.reason
            for part in counts:
                counts[part] += part in solutions.reason
    assert min(counts.values()) > 75


def test_too_close_for_a_long_upper_arm_is_called_so():
    arm = get_arm("ur5-thesis")
    urdf = arm.urdf.replace('xyz="0.0 -0.1197 0.425"', 'xyz="0.0 -0.1197 0.925"')
    kin = URKinematics(arm=replace(arm, name="long", build_urdf=lambda: urdf))
    assert kin.geometry.folded > 0.5
    for T in kin.fk(postures(15, 200)):
        T[:3, 3] = 0.2, 0.0, kin.geometry.d1
        assert kin.all_solutions(T).reason == "too close for the folded elbow"


def test_out_of_limits_names_the_joints():
    arm = get_arm("ur5-thesis")
    start = arm.urdf.index('<joint name="wrist_1_joint"')
    narrow = arm.urdf[:start] + arm.urdf[start:].replace("3.14159265359", "0.1", 2)
    kin = URKinematics(replace(arm, name="narrow", build_urdf=lambda: narrow, home=(0.0,) * 6), tip="tool0")
    T = next(T for T in FLANGE.fk(postures(14, 100)) if np.abs(FLANGE.all_solutions(T).q[:, 3]).min() > 0.2)
    assert kin.all_solutions(T, limits=False).success
    blocked = kin.all_solutions(T)
    assert blocked.status is Status.OUT_OF_LIMITS
    assert "wrist_1_joint" in blocked.reason
    q = np.array([0.3, -1.0, 1.2, 0.05, 0.9, 0.2])
    np.testing.assert_allclose(kin.nearest(FLANGE.fk(q), q).q, q, atol=1e-9)
    batch = kin.batch(np.array([T, FLANGE.fk(q)]))
    assert not batch.valid[0].any()
    assert batch.valid[1].any()


def test_calibrated_lengths_come_from_the_description():
    arm = get_arm("ur5-thesis")
    urdf = arm.urdf.replace('xyz="0.0 -0.1197 0.425"', 'xyz="0.0 -0.1201 0.4261"')
    assert urdf != arm.urdf
    kin = URKinematics(arm=replace(arm, name="calibrated", build_urdf=lambda: urdf), tip="tool0")
    assert kin.geometry.a2 == -0.4261
    assert kin.geometry.d4 == pytest.approx(0.10915 - 0.0004)
    q = postures(7, 200)
    assert np.nanmin(np.abs(kin.batch(kin.fk(q)).q - q[:, None]).max(axis=2), axis=1).max() < 1e-6


def test_an_arm_of_another_kind_is_refused():
    with pytest.raises(InputError, match="6 joints"):
        URKinematics(arm=replace(get_arm("arm3"), tips={"tool0": "end_effector"}, default_tip="tool0"), tip="tool0")


def test_tool_down_reaches_the_goal_area_on_both_natural_branches():
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
    goals = kin.arm.workcell.goals.sample(np.random.default_rng(8), 1000)
    a = b = 0
    for goal in goals:
        solutions = kin.axis_solutions(goal, (0, 0, -1), seed=kin.arm.home)
        assert solutions.residual.max() < 1e-9
        q = solutions.q
        assert (q[:, 5] == kin.arm.home[5]).all()
        a += ((q[:, 0] <= 0) & (q[:, 2] >= 0) & (np.abs(q[:, 4] + np.pi / 2) < 1e-6)).any()
        b += ((q[:, 0] >= 0) & (q[:, 2] <= 0) & (np.abs(q[:, 4] - np.pi / 2) < 1e-6)).any()
    assert (a, b) == (1000, 1000)


def test_axis_goals_contain_the_generating_posture():
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
    found = at_a_limit = 0
    for q in postures(9, 2000):
        T = kin.fk(q)
        solutions = kin.axis_solutions(T[:3, 3], 3.0 * T[:3, 2], seed=q)
        assert len(solutions) <= 8
        found += np.abs(solutions.q - q).max(axis=1).min() < 1e-6
        assert solutions.residual.max() <= 1e-7  # of those that were moved into a limit
        at_a_limit += solutions.residual.max() > 1e-9
    assert found == 2000
    assert at_a_limit <= 2


def test_where_the_seeds_wrist_3_is_refused_the_joint_turns_on_as_little_as_it_may():
    kin = URKinematics(tip="tool0", arm=wide_ur5())
    checked = 0
    for q in np.random.default_rng(7).uniform(-1.5 * np.pi, 1.5 * np.pi, (50, 6)):
        T = kin.fk(q)
        result = kin.axis_goal(T[:3, 3], T[:3, 2], q, accept=lambda found, q=q: abs(found[5] - q[5]) > 0.1)
        assert result.success
        assert abs(result.q[5] - q[5]) < np.radians(46)
        checked += abs(q[5]) > np.pi - np.radians(45)
    assert checked > 10


def test_turns_of_wrist_3_beyond_its_limits_are_left_out():
    """A quarter of a turn up is beyond them, one down is not."""
    kin = URKinematics(get_arm("ur5-thesis").with_limits({"wrist_3_joint": (-2.0, 0.2)}), tip="tool0")
    q = np.array([0.3, -1.0, 1.2, -0.4, 0.9, 0.0])
    T = kin.fk(q)
    result = kin.axis_goal(T[:3, 3], T[:3, 2], q, accept=lambda found: abs(found[5]) > 0.1)
    assert result.success
    assert result.q[5] == pytest.approx(-np.pi / 4)


def test_axis_goal_with_the_tool_parallel_to_the_middle_axes():
    kin = URKinematics("ur5-thesis", tip="tool0")
    for q in postures(10, 300):
        q[4] = 0.0
        T = kin.fk(q)
        result = kin.axis_goal(T[:3, 3], T[:3, 2], q)
        assert result.success
        assert result.position_error < 1e-7
        assert result.orientation_error < 1e-7
        np.testing.assert_allclose(result.q, q, atol=1e-5)


def test_a_free_wrist_keeps_the_seed_where_it_can():
    kept = moved = 0
    rng = np.random.default_rng(12)
    for q in postures(11, 400):
        q[4] = 0.0
        T = FLANGE.fk(q)
        near = FLANGE.nearest(T, q)
        assert near.success
        np.testing.assert_allclose(FLANGE.fk(near.q), T, atol=1e-7)
        kept += np.abs(near.q - q).max() < 1e-5
        other = FLANGE.nearest(T, rng.uniform(-np.pi, np.pi, 6))
        assert other.success
        assert max(pose_error(T, FLANGE.fk(other.q))) < 1e-7
        moved += np.abs(other.q - q).max() > 1e-3
    assert kept == 400
    assert moved > 300


def test_bare_positions_are_refused():
    with pytest.raises(InputError, match="AxisGoal"):
        FLANGE.solve(PositionGoal([0.4, 0, 0.2]), np.zeros(6))
