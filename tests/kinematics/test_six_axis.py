"""Six-joint arms of no kind that has a closed form here: every posture, against EAIK and by Pinocchio."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from example_robot_data.robots_loader import getModelPath

from benchmarks.speed.peers.analytic import eaik_of
from kinreach._rotations import pose_error
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, AxisGoal, PositionGoal, SixAxisKinematics, Status
from kinreach.kinematics.check import random_postures
from kinreach.robots import ArmDescription

#: A file of example-robot-data, and the tip: two arms with six joints, one of them with a hand beside the last axis.
ARMS = {
    "kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_link_6"),
    "kinova-hand": ("kinova_description/robots/kinova.urdf", None),
    "z1": ("z1_description/urdf/z1.urdf", "link06"),
}


def described(name):
    file, tip = ARMS[name]
    return ArmDescription.from_urdf(f"{getModelPath(file)}/{file}", tip=tip)


@pytest.fixture(scope="module", params=ARMS)
def kin(request):
    return ArmKinematics.of(described(request.param))


def apart(q, others):
    return np.abs((others - q + np.pi) % (2 * np.pi) - np.pi).max(axis=1).min(initial=np.inf)


def test_every_posture_is_exact_and_the_generating_one_is_there(kin):
    assert isinstance(kin, SixAxisKinematics)
    q = random_postures(kin, 25, seed=0)
    T = kin.fk(q)
    batch = kin.batch(T)
    for posture, pose, row, valid in zip(q, T, batch.q, batch.valid, strict=True):
        assert apart(posture, row[valid]) < 1e-6
        alone = kin.all_solutions(pose)
        np.testing.assert_allclose(row[valid], alone.q, atol=1e-9)
        assert (np.diff(alone.branch) > 0).all()
        assert not alone.singularity.any()  # it tells no postures apart
        for i, found in enumerate(alone.q):
            assert max(pose_error(pose, kin.fk(found))) < 1e-9
            assert kin.within_limits(found)
            assert apart(found, alone.q[:i]) > 1e-6
        nearest = kin.nearest(pose, posture)
        np.testing.assert_allclose(nearest.q, posture, atol=1e-6)


def test_postures_at_right_angles_are_solved(kin):
    """There a matrix that is inverted may be singular to the last digit."""
    q = np.random.default_rng(2).choice(np.pi / 2 * np.arange(-1, 3), (15, 6))
    T = kin.fk(q)
    batch = kin.batch(T, limits=False)
    assert batch.valid.any(axis=1).all()
    for pose, row, valid in zip(T, batch.q, batch.valid, strict=True):
        assert max(max(pose_error(pose, kin.fk(found))) for found in row[valid]) < 1e-9


def test_as_many_as_eaik_finds():
    """The Z1's second to fourth axes are parallel, and its last two meet: EAIK decomposes that in closed form."""
    pytest.importorskip("eaik")
    kin = ArmKinematics.of(described("z1"))
    peer = eaik_of(kin)
    compared = 0
    for T in kin.fk(np.random.default_rng(1).uniform(-np.pi, np.pi, (60, 6))):
        ours, theirs = kin.all_solutions(T, limits=False).q, peer.solve(T)
        theirs = [q for q in theirs if max(pose_error(T, kin.fk(q))) < 1e-6]
        assert all(apart(q, ours) < 1e-5 for q in theirs)
        assert len(ours) >= len(theirs)
        compared += len(theirs)
    assert compared > 240


def test_goals_of_a_direction_and_reasons(kin):
    q = random_postures(kin, 3, seed=2)[1]
    T = kin.fk(q)
    down = kin.solve(AxisGoal(T[:3, 3], T[:3, 2]), q)
    assert down.success
    assert max(down.position_error, down.orientation_error) < 1e-8
    if kin.arm.tips[kin.tip] == ARMS["kinova"][1]:  # on the last axis: that joint is free and stays
        np.testing.assert_allclose(down.q, q, atol=1e-6)
    T[:3, 3] += 5.0
    lost = kin.all_solutions(T)
    assert lost.status is Status.OUT_OF_REACH
    assert lost.reason.startswith("too far away: the wrist would be ")
    assert not kin.batch(T[None]).valid.any()
    with pytest.raises(InputError, match="direction"):
        kin.solve(PositionGoal((0.3, 0.0, 0.3)), q)
    with pytest.raises(InputError, match="shape"):
        kin.batch(np.eye(4))


def test_a_last_joint_that_turns_against_the_tool_is_free_too():
    """The same arm with its last axis the other way round has the same postures, with the last angle negated."""
    arm = described("kinova")
    robot = ET.fromstring(arm.urdf)
    (axis,) = (joint.find("axis") for joint in robot.iter("joint") if joint.get("name") == arm.joints[-1])
    assert axis.get("xyz") == "0 0 1"
    axis.set("xyz", "0 0 -1")
    kin = ArmKinematics.of(arm)
    turned = ArmKinematics.of(replace(arm, build_urdf=partial(str, ET.tostring(robot, encoding="unicode"))))
    count = 0
    for q in random_postures(kin, 20, seed=4):
        T = kin.fk(q)
        expected = kin.axis_solutions(T[:3, 3], T[:3, 2], seed=q).q
        mirror = np.array([1, 1, 1, 1, 1, -1])
        found = turned.axis_solutions(T[:3, 3], T[:3, 2], seed=mirror * q).q
        np.testing.assert_allclose(found * mirror, expected, atol=1e-6)
        count += len(found)
    assert count >= 60


@pytest.mark.parametrize("written", ["1.5707963", "1.570796", "1.5708"])
def test_a_right_angle_that_a_file_rounds_leaves_the_last_joint_free(written):
    """The tip is then off the last axis by that; the other joints make up for it."""
    arm = described("kinova")
    robot = ET.fromstring(arm.urdf)
    (axis,) = (joint.find("axis") for joint in robot.iter("joint") if joint.get("name") == arm.joints[-1])
    off = float(written) - np.pi / 2
    axis.set("xyz", f"{np.sin(off)} 0 {np.cos(off)}")
    kin = ArmKinematics.of(replace(arm, build_urdf=partial(str, ET.tostring(robot, encoding="unicode"))))
    exact, count = ArmKinematics.of(arm), 0
    for q in random_postures(kin, 10, seed=6):
        T = kin.fk(q)
        found = kin.axis_solutions(T[:3, 3], T[:3, 2], seed=q)
        assert len(found) == len(exact.axis_solutions(T[:3, 3], T[:3, 2], seed=q))
        assert apart(q, found.q) < 1e-6
        assert found.residual.max() < 1e-9
        np.testing.assert_allclose(found.q[:, -1], q[-1], atol=1e-12)
        count += len(found)
    assert count >= 30


def test_a_free_last_joint_is_moved_to_its_limit_where_limits_count():
    arm = described("kinova")
    kin = ArmKinematics.of(arm.with_limits({arm.joints[-1]: (-1.0, 1.0)}))
    lower, upper, counted = np.maximum(kin.lower, -10.0)[:-1], np.minimum(kin.upper, 10.0)[:-1], 0
    for q in random_postures(kin, 20, seed=5):
        T, seed = kin.fk(q), np.append(q[:-1], 2.5)
        within = kin.axis_solutions(T[:3, 3], T[:3, 2], seed=seed).q
        np.testing.assert_allclose(within[:, -1], 1.0, atol=1e-12)
        free = kin.axis_solutions(T[:3, 3], T[:3, 2], seed=seed, limits=False).q
        np.testing.assert_allclose(free[:, -1], 2.5, atol=1e-12)
        first = free[:, :-1] + 2.0 * np.pi * np.ceil((lower - free[:, :-1]) / (2.0 * np.pi))  # of all turns
        assert len(within) == (first <= upper).all(axis=1).sum()
        counted += len(within)
    assert counted >= 40


def urdf(axes):
    links = "".join(f'<link name="l{i}"/>' for i in range(7))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0.3 0 0.1"/>'
        f'<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for i, axis in enumerate(axes)
    )
    return f'<robot name="arm">{links}{joints}</robot>'


def test_an_arm_with_a_flange_that_is_no_ur_is_taken_without_a_warning(tmp_path):
    """Its last two axes are parallel: what is made for arms that are nearly URs would divide by zero."""
    file = tmp_path / "arm.urdf"
    text = urdf(["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "0 1 0"])
    file.write_text(text.replace('"l6"', '"tool0"').replace("0.3 0 0.1", "0.3 0.05 0.1"))
    kin = ArmKinematics.of(ArmDescription.from_urdf(file))
    assert type(kin) is SixAxisKinematics
    q = np.array([0.3, -0.4, 0.9, 0.5, -0.7, 0.2])
    assert apart(q, kin.all_solutions(kin.fk(q)).q) < 1e-6


def wristed(file, shoulder, elbow):
    """An arm with two parallel axes, a wrist of three that meet, and what its shoulder and its elbow are off [m]."""
    text = urdf(["0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1"])
    for origin in ("0 0 0.1", f"{shoulder} 0 0.2", "0 0 0.4", f"{elbow} 0 0.18", "0 0 0.16", "0 0 0"):
        text = text.replace("0.3 0 0.1", origin, 1)
    tip = '<joint name="end" type="fixed"><parent link="l6"/><child link="l7"/><origin xyz="0 0 0.1"/></joint></robot>'
    file.write_text(text.replace("</robot>", f'<link name="l7"/>{tip}'))
    kin = ArmKinematics.of(ArmDescription.from_urdf(file))
    assert type(kin) is SixAxisKinematics
    return kin


def test_upright_postures_are_in_reach(tmp_path):
    """Where the shoulder, the elbow and the wrist are straight, elimination alone says that no posture is."""
    kin, solved = wristed(tmp_path / "arm.urdf", 0.05, 0), 0
    for q in random_postures(kin, 20, 0) * [1, 0, 0, 1, 0, 1]:
        found = kin.all_solutions(kin.fk(q)).q
        solved += len(found) > 0
        for other in found:
            np.testing.assert_allclose(kin.fk(other), kin.fk(q), atol=1e-7)
    assert solved == 20


def test_a_jacobian_without_an_inverse_is_no_error(tmp_path):
    """A straight wrist and a straight elbow: two joints turn about one line."""
    kin = wristed(tmp_path / "arm.urdf", 0, 0.05)
    rng, found = np.random.default_rng(3), 0
    singular = [-2.1485816885391875, -1.097370350886088, 0, 2.1815157163548045, 0, -1.39991686688939]
    for q in [singular, *(random_postures(kin, 40, 0) * [1, 1, 0, 1, 0, 1] + 1e-9 * rng.normal(size=(40, 6)))]:
        for other in kin.all_solutions(kin.fk(q)).q:
            np.testing.assert_allclose(kin.fk(other), kin.fk(q), atol=1e-7)
            found += 1
    assert found >= 41


def test_axes_that_it_cannot_solve_are_named(tmp_path):
    """Six parallel axes move in a plane: a pose has a family of postures or none."""
    file = tmp_path / "plane.urdf"
    file.write_text(urdf(["0 0 1"] * 6))
    arm = ArmDescription.from_urdf(file)
    assert type(ArmKinematics.of(arm)) is ArmKinematics
    with pytest.raises(InputError, match="singular in every posture: its six joints move the tip in five directions"):
        SixAxisKinematics(arm)
    with pytest.raises(InputError, match="3 joints; six are needed"):
        SixAxisKinematics("arm3")
