"""Closed-form inverse kinematics of the 3-DOF arm."""

from dataclasses import replace

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import Arm3Kinematics, ArmKinematics, AxisGoal, PoseGoal, PositionGoal, Status
from kinreach.robots import ArmDescription, get_arm

KIN = Arm3Kinematics(base="world")


def test_every_branch_reaches_and_the_generating_posture_comes_back():
    q = np.random.default_rng(0).uniform(KIN.lower, KIN.upper, (10_000, 3))
    T = ArmKinematics("arm3", base="world").fk(q)
    batch = KIN.batch(T)
    pose, branch = np.nonzero(batch.valid)
    assert batch.q.shape == (10_000, 4, 3)
    assert set(branch) == {0, 1, 2, 3}
    assert len(pose) > 20_000
    np.testing.assert_allclose(KIN.fk(batch.q[pose, branch])[:, :3, 3], T[pose, :3, 3], rtol=0, atol=1e-9)
    assert np.nanmin(np.abs(batch.q - q[:, None]).max(axis=2), axis=1).max() < 1e-6
    inside = batch.q[batch.valid]
    assert (inside >= KIN.lower - 1e-9).all()
    assert (inside <= KIN.upper + 1e-9).all()


def test_single_targets_equal_the_batch():
    q = np.random.default_rng(1).uniform(KIN.lower, KIN.upper, (500, 3))
    T = KIN.fk(q)
    batch, nearest = KIN.batch(T), KIN.nearest_batch(T[:, :3, 3], q)
    np.testing.assert_allclose(nearest.q, q, atol=1e-6)
    for i in range(500):
        solutions = KIN.all_solutions(T[i, :3, 3])
        np.testing.assert_array_equal(solutions.branch, np.flatnonzero(batch.valid[i]))
        np.testing.assert_array_equal(solutions.q, batch.q[i, solutions.branch])
        assert solutions.residual.max() < 1e-9
        np.testing.assert_allclose(KIN.nearest(T[i], q[i]).q, q[i], atol=1e-6)


def test_stretched_folded_and_just_beyond():
    g = KIN.geometry
    stretched = np.arctan2(*g.upper) - np.arctan2(*g.fore)  # elbow angle at which both links align
    checked = 0
    for first, second in np.random.default_rng(2).uniform(-1.5, 1.5, (300, 2)):
        target = KIN.fk([first, second, stretched])[:3, 3]
        forward, sideways = np.array([[np.cos(first), np.sin(first), 0], [-np.sin(first), np.cos(first), 0]])
        base = KIN.model.jointPlacements[1].translation
        shoulder = base + forward * g.shoulder[0] + sideways * g.offset + (0, 0, g.shoulder[1])
        out = (target - shoulder) / np.linalg.norm(target - shoulder)
        branch = KIN.nearest(target, [first, second, stretched]).branch
        for scale in (0.0, 1e-9):
            solutions = KIN.all_solutions(target + scale * out)
            assert solutions.success
            assert solutions.residual[:, 0].max() < 1e-7
            if scale:
                assert np.count_nonzero(solutions.branch // 2 == branch // 2) == 1
                batch = KIN.batch((target + scale * out)[None])
                np.testing.assert_array_equal(np.flatnonzero(batch.valid[-1]), solutions.branch)
            checked += 1
        assert branch not in KIN.all_solutions(target + 1e-3 * out).branch
    assert checked == 600


def test_targets_on_the_inner_cylinder():
    offset = abs(KIN.geometry.offset)
    for angle in np.linspace(-3, 3, 50):
        target = np.array([offset * np.cos(angle), offset * np.sin(angle), 0.9])
        solutions = KIN.all_solutions(target, limits=False)
        assert solutions.success
        assert solutions.residual[:, 0].max() < 1e-9
        inside = KIN.all_solutions(target * ((1 - 1e-9 / offset), (1 - 1e-9 / offset), 1), limits=False)
        assert inside.residual[:, 0].max() < 1e-7
        assert (inside.singularity != 0).all()
        regular = KIN.all_solutions(target * (1.5, 1.5, 1), limits=False)
        assert not regular.singularity.any()
    assert "sideways offset" in KIN.all_solutions([0.0, 0.0, 0.9]).reason


def test_angles_are_within_half_a_turn_whatever_the_limits():
    for T in KIN.fk(np.random.default_rng(5).uniform(-3, 3, (200, 3))):
        alone, batch = KIN.all_solutions(T, limits=False), KIN.batch(T[None], limits=False)
        assert np.abs(alone.q).max() <= np.pi
        np.testing.assert_allclose(batch.q[0, alone.branch], alone.q, rtol=0, atol=1e-9)


def test_reasons():
    assert "stretched elbow" in KIN.nearest([3, 0, 0], np.zeros(3)).reason
    assert KIN.nearest([3, 0, 0], np.zeros(3)).status is Status.OUT_OF_REACH
    blocked = 0
    for target in KIN.arm.workcell.goals.sample(np.random.default_rng(4), 3000):
        solutions = KIN.all_solutions(target)
        if not solutions.success:
            assert KIN.all_solutions(target, limits=False).success
            assert solutions.status is Status.OUT_OF_LIMITS
            assert "link_3_joint" in solutions.reason
            blocked += 1
    assert blocked > 10


def test_what_keeps_a_target_from_an_arm_of_unequal_links(tmp_path):
    """Links of 0.4 and 0.14 m: the elbow neither folds nor stretches to what is nearer or farther."""
    straight = [((0, 0, 0.1), (0, 0, 0)), ((0, 0, 0.1), (0, 0, 0)), ((0, 0, 0.4), (0, 0, 0))]
    file = tmp_path / "arm.urdf"
    arm_of(tmp_path, straight)
    file.write_text(file.read_text().replace("0.1 0 0.3", "0 0 0.14"))
    kin = Arm3Kinematics.from_urdf(file, tip="tip")
    for away, reason in ((0.25, "too close for the folded elbow"), (0.55, "too far away for the stretched elbow")):
        found = kin.all_solutions([away, 0.0, 0.2], limits=False)
        assert (len(found), found.reason, found.status) == (0, reason, Status.OUT_OF_REACH)
    for away in (0.27, 0.53):
        assert kin.all_solutions([away, 0.0, 0.2], limits=False).success


def test_most_of_the_button_area_is_reachable():
    targets = KIN.arm.workcell.goals.sample(np.random.default_rng(3), 5000)
    share = KIN.nearest_batch(targets, np.zeros(3)).success.mean()
    assert 0.97 < share < 1.0  # the limits of the joints make about one percent unreachable


def test_orientations_are_refused():
    for goal in (PoseGoal(np.eye(4)), AxisGoal([0.3, 0, 0.3])):
        with pytest.raises(InputError, match="PositionGoal"):
            KIN.solve(goal, np.zeros(3))
    assert KIN.solve(PositionGoal(KIN.fk([0.3, 0.2, 0.5])[:3, 3]), np.zeros(3)).success


def test_arms_from_files(tmp_path):
    straight = [((0, 0, 0.1), (0, 0, 0)), ((0.05, 0, 0.1), (0, 0, 0)), ((0, 0, 0.4), (0, 0, 0))]
    arm_of(tmp_path, straight)
    kin = Arm3Kinematics.from_urdf(next(tmp_path.glob("*.urdf")), base="world")
    assert (kin.tip, kin.base, KIN.tip) == ("tip", "world", "end_effector")
    assert Arm3Kinematics("arm3").arm is KIN.arm
    np.testing.assert_allclose(
        kin.fk(np.zeros(3)), ArmKinematics.of(arm_of(tmp_path, straight), base="world").fk([0] * 3)
    )


def test_an_arm_of_another_kind_is_refused():
    ur5 = replace(get_arm("ur5"), tips={"end_effector": "tool0"}, default_tip="end_effector")
    with pytest.raises(InputError, match="z, y, y"):
        Arm3Kinematics(arm=ur5)


def arm_of(tmp_path, origins):
    """An arm with joints about z, y, y and these origins, as (xyz, rpy), of its joints in the links before."""
    links = "".join(f'<link name="link_{k}"/>' for k in range(4))
    joints = "".join(
        f'<joint name="joint_{k}" type="revolute"><parent link="link_{k}"/><child link="link_{k + 1}"/>'
        f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'
        f'<axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'
        for k, ((xyz, rpy), axis) in enumerate(zip(origins, ("0 0 1", "0 1 0", "0 1 0"), strict=True))
    )
    tip = '<joint name="fixed" type="fixed"><parent link="link_3"/><child link="tip"/><origin xyz="0.1 0 0.3"/></joint>'
    file = tmp_path / "arm.urdf"
    file.write_text(f'<robot name="arm">{links}<link name="tip"/>{joints}{tip}</robot>')
    return ArmDescription.from_urdf(file, tip="tip")


def test_an_arm_that_stands_somewhere_else_and_askew(tmp_path):
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(5):
        foot = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
        arm = arm_of(tmp_path, (foot, ((0.05, 0.02, 0.1), (0, 0, 0)), ((0.03, -0.01, 0.4), (0, 0, 0))))
        kin = ArmKinematics.of(arm)
        assert isinstance(kin, Arm3Kinematics)
        for q in rng.uniform(-3, 3, (20, 3)):
            solutions = kin.all_solutions(kin.fk(q))
            assert solutions.residual[:, 0].max() < 1e-9
            found += np.abs(solutions.q - q).max(axis=1).min() < 1e-6
    assert found == 100


@pytest.mark.parametrize("turned", [1, 2])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_arm_with_turned_frames_has_no_closed_form(tmp_path, turned, axis):
    rpy = np.zeros((3, 3))
    rpy[turned, axis] = 0.3
    arm = arm_of(tmp_path, list(zip(np.array([(0, 0, 0.1), (0.05, 0, 0.1), (0, 0, 0.4)]), rpy, strict=True)))
    with pytest.raises(InputError, match="turned"):
        Arm3Kinematics(arm=arm, tip="tip")
    assert type(ArmKinematics.of(arm)) is ArmKinematics


def test_of_many_targets_those_out_of_reach_have_no_branch():
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3))
    many = KIN.nearest_batch(points, np.zeros(3))
    branches = [KIN.nearest(point, np.zeros(3)).branch for point in points]
    np.testing.assert_array_equal(many.branch, branches)
    np.testing.assert_array_equal(many.branch == -1, ~many.success)
    assert 20 < many.success.sum() < 180
