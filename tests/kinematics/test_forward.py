"""Forward kinematics, Jacobian and limits of both arms."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.ik_arms.random_arms import kinematics, motion
from kinreach._rotations import pose_error
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import Arm3Kinematics, ArmKinematics, UR5Kinematics, URKinematics
from kinreach.robots import Gripper, get_arm

ARMS = [("ur5", "tool0"), ("ur5", "tcp"), ("arm3", "end_effector")]


@pytest.mark.parametrize("base", ["base_link", "world"])
@pytest.mark.parametrize(("arm", "tip"), ARMS)
def test_batched_fk_equals_pinocchio(arm, tip, base):
    kin = ArmKinematics(arm, tip=tip, base=base)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (2100, kin.n))  # more than one block
    T = kin.fk(q)
    single = np.array([kin.fk(row) for row in q])
    assert T.shape == (2100, 4, 4)
    # The chain takes the 5e-12 that the URDF's twelve digits of pi/2 leave for the zeros that are meant.
    np.testing.assert_allclose(T, single, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(kin.fk(q.reshape(3, 700, kin.n)), T.reshape(3, 700, 4, 4))
    np.testing.assert_array_equal(kin.positions(q), T[:, :3, 3])
    np.testing.assert_array_equal(kin.positions(q[0]), single[0, :3, 3])
    many = kin.jacobian(q[:60].reshape(6, 10, kin.n))
    np.testing.assert_allclose(many.reshape(60, 6, kin.n), [kin.jacobian(row) for row in q[:60]], rtol=0, atol=1e-10)
    for malformed in (1.0, q[:, 1:], np.full((2, kin.n), np.nan)):
        for method in (kin.positions, kin.jacobian):
            with pytest.raises(InputError):
                method(malformed)


def without_meshes(urdf):
    robot = ET.fromstring(urdf)
    for link in robot.findall("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)
    return ET.tostring(robot, encoding="unicode")


@pytest.mark.parametrize(("arm", "tip"), ARMS)
def test_fk_equals_placo(arm, tip):
    placo = pytest.importorskip("placo")
    kin = ArmKinematics(arm, tip=tip, base="world")
    robot = placo.RobotWrapper("", placo.Flags.ignore_collisions, without_meshes(kin.arm.urdf))
    checked = 0
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, (1000, kin.n)):
        for name, value in zip(kin.arm.joints, q, strict=True):
            robot.set_joint(name, value)
        robot.update_kinematics()
        position, angle = pose_error(robot.get_T_world_frame(kin.arm.tips[tip]), kin.fk(q))
        assert position <= 1e-9
        assert angle <= 1e-9
        checked += 1
    assert checked == 1000


@pytest.mark.parametrize("base", ["base_link", "world"])
@pytest.mark.parametrize(("arm", "tip"), ARMS)
def test_jacobian_by_central_differences(arm, tip, base):
    kin = ArmKinematics(arm, tip=tip, base=base)
    step = 1e-6
    for q in np.random.default_rng(2).uniform(-2, 2, (100, kin.n)):
        J, R = kin.jacobian(q), kin.fk(q)[:3, :3]
        for j in range(kin.n):
            ahead, behind = (kin.fk(q + sign * step * np.eye(kin.n)[j]) for sign in (1, -1))
            spin = (ahead[:3, :3] - behind[:3, :3]) / (2 * step) @ R.T
            np.testing.assert_allclose(J[:3, j], (ahead - behind)[:3, 3] / (2 * step), atol=1e-8)
            np.testing.assert_allclose(J[3:, j], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_an_arm_of_one_joint_has_a_jacobian_of_one_column(kind, tmp_path):
    joint = f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
    joint += '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    fixed = '<joint name="f" type="fixed"><parent link="b"/><child link="c"/><origin xyz="1 0 0"/></joint>'
    file = tmp_path / "one.urdf"
    file.write_text(f'<robot name="a"><link name="a"/><link name="b"/><link name="c"/>{joint}{fixed}</robot>')
    kin = ArmKinematics.from_file(file, tip="c", joints=["j"])
    expected = [0, 1, 0, 0, 0, 1] if kind == "revolute" else [0, 0, 1, 0, 0, 0]
    np.testing.assert_allclose(kin.jacobian([0.0]), np.array(expected)[:, None], atol=1e-15)
    np.testing.assert_allclose(
        kin.jacobian(np.zeros((40, 1))), np.tile(np.array(expected)[:, None], (40, 1, 1)), atol=1e-15
    )


def test_links_of_whole_metres_and_right_angles_are_as_exact_as_others(tmp_path):
    """The chain leaves out sums and products with 0, 1 and -1; 2 and -2 are other numbers."""
    rng, checked = np.random.default_rng(4), 0
    for _ in range(2):
        turns, tilts = rng.integers(-1, 3, (2, 7)) * np.pi / 2
        along, out = rng.choice([-2.0, -1.0, 0.0, 1.0, 2.0], (2, 7))
        kin = kinematics(tmp_path, np.array([motion(*link) for link in zip(turns, along, out, tilts, strict=True)]))
        q = np.vstack([rng.uniform(-np.pi, np.pi, (40, 6)), rng.integers(-2, 3, (40, 6)) * np.pi / 2])
        exact = np.array([kin.fk(one) for one in q])
        np.testing.assert_allclose(kin.fk(q), exact, atol=1e-9, rtol=0)
        np.testing.assert_allclose(kin.jacobian(q), [kin.jacobian(one) for one in q], atol=1e-9, rtol=0)
        checked += len(q)
    assert checked == 160


@pytest.mark.parametrize("tilt", [1e-9, 1e-8, 3e-8, 1e-6])
def test_axes_that_are_almost_parallel_are_not_taken_for_parallel(tilt, tmp_path):
    """The cosine of a tilt of 1e-8 is 1 to rounding; its sine moves the tip by 1e-8 m."""
    rng = np.random.default_rng(0)
    chain = np.array([motion(rng.uniform(-3, 3), 0.3, 0.4, tilt) for _ in range(7)])
    kin, q = kinematics(tmp_path, chain), rng.uniform(-np.pi, np.pi, (20, 6))
    exact = np.array([kin.fk(one) for one in q])
    np.testing.assert_allclose(kin.fk(q), exact, atol=1e-10, rtol=0)
    assert np.abs(exact[:, 2, :2]).max() > 0.5 * tilt


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"gripper": Gripper("jaw", "finger_right_joint", 0.1, 0.1, 9.0)}, "the URDF has no joint 'jaw'"),
        ({"gripper": None}, "URDF joints .*'finger_left_joint'.*, described .*from_urdf holds joints"),
        (
            {"joints": get_arm("ur5").joints[::-1]},
            "URDF joints .*, described .*'wrist_3_joint', 'wrist_2_joint'",
        ),
        ({"base": "stand"}, "the URDF has no link 'stand'"),
        ({"tips": {"tool0": "tool0", "tcp": "tcp", "pen": "pen_link"}}, "the URDF has no link 'pen_link'"),
        (
            {"build_urdf": lambda: get_arm("ur5").urdf.replace("elbow_joint", "wrist_0_joint")},
            "elbow_joint|wrist_0",
        ),
    ],
)
def test_a_description_that_does_not_fit_its_urdf_is_named(facts, said):
    with pytest.raises(InputError, match=said):
        ArmKinematics(replace(get_arm("ur5-thesis"), **facts), tip="tool0")


def test_front_of_the_ur5_is_world_x():
    q = (-np.pi / 2, -np.pi / 2, np.pi / 2, -np.pi / 2, -np.pi / 2, 0)
    in_base = UR5Kinematics(base="base_link").fk(q)[:3, 3]
    in_world = UR5Kinematics(base="world").fk(q)[:3, 3]
    np.testing.assert_allclose(in_world, [-in_base[1], in_base[0], in_base[2]], atol=1e-12)
    assert in_world[0] > 0.3


def test_tcp_is_20_cm_in_front_of_the_flange():
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (100, 6))
    flange, tcp = UR5Kinematics(tip="tool0").fk(q), UR5Kinematics(tip="tcp").fk(q)
    np.testing.assert_allclose(tcp[:, :3, 3], flange[:, :3, 3] + 0.20 * flange[:, :3, 2], atol=1e-12)


def test_limits_are_named():
    kin = UR5Kinematics()
    assert kin.within_limits(kin.arm.home)
    assert kin.joints_outside_limits([0, 0, 3.2, 0, -6.4, 0]) == ("elbow_joint", "wrist_2_joint")
    np.testing.assert_allclose(URKinematics("ur5-thesis").upper, np.pi, atol=1e-9)
    assert Arm3Kinematics().joints_outside_limits([0, 2.1, -2.1]) == ("link_2_joint", "link_3_joint")


@pytest.mark.parametrize(
    ("arguments", "available"),
    [
        ({"arm": "ur6"}, "arm3, panda, so101, ur10, .*ur12e, .*ur7e, ur8long"),
        ({"arm": "ur5", "tip": "hand"}, "tcp, tool0"),
        ({"arm": "ur5", "base": "map"}, "world"),
    ],
)
def test_unknown_names_list_the_available_ones(arguments, available):
    with pytest.raises(UnknownNameError, match=available):
        ArmKinematics(**arguments)


@pytest.mark.parametrize("q", [np.zeros(5), np.zeros((3, 7)), [np.nan] * 6, 1.0, "home", [[0, 0, 0, 0, 0, np.inf]]])
def test_malformed_postures_are_refused(q):
    with pytest.raises(InputError):
        UR5Kinematics().fk(q)
