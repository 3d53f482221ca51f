"""Arms from URDF files: the Panda of example-robot-data from FK to simulation, and files written for the purpose."""

from __future__ import annotations

import pickle
import re
import shutil
from contextlib import nullcontext
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin
import pytest

from kinreach import cli
from kinreach.errors import InputError, NoShapesError
from kinreach.kinematics import (
    ArmKinematics,
    ClosedFormSolver,
    CollisionChecker,
    LevenbergMarquardtSolver,
    PlacoSolver,
    PoseGoal,
    PositionGoal,
    QPSolver,
    check,
)
from kinreach.robots import ArmDescription, BoxRegion, Workcell, arm_names, get_arm, register_arm
from kinreach.sim import ArmSimulation

SHARE = Path(str(get_arm("ur5").package_root()))
PANDA = SHARE / "example-robot-data/robots/panda_description/urdf/panda.urdf"
FINGERS = ("panda_finger_joint1", "panda_finger_joint2")


@pytest.fixture(scope="module")
def panda():
    return ArmDescription.from_urdf(PANDA)


@pytest.fixture(scope="module")
def kin(panda):
    return ArmKinematics(panda, base="world")


@pytest.fixture(scope="module")
def postures(kin):
    return np.random.default_rng(0).uniform(kin.lower, kin.upper, (200, 7))


def test_what_the_panda_is(panda):
    assert panda.name == "panda"
    assert panda.joints == tuple(f"panda_joint{i}" for i in range(1, 8))
    assert panda.default_tip == "panda_hand_tcp"
    assert panda.base == "panda_link0"
    np.testing.assert_allclose(panda.home, (0, 0, 0, -1.5708, 0, 1.8675, 0))
    assert not panda.locked_joints


@pytest.mark.parametrize("tip", ["panda_hand_tcp", "panda_link8", "panda_leftfinger"])
def test_forward_kinematics_is_pinocchios_on_the_file(tip, postures):
    kin = ArmKinematics.from_urdf(PANDA, tip=tip, held={"panda_finger_joint1": 0.03})
    model = pin.buildModelFromUrdf(str(PANDA))
    data, frame = model.createData(), model.getFrameId(tip)
    poses = kin.fk(postures)
    for q, T in zip(postures, poses, strict=True):
        pin.framesForwardKinematics(model, data, np.array([*q, 0.03, 0.03]))
        np.testing.assert_allclose(T, data.oMf[frame].homogeneous, atol=1e-12)
        np.testing.assert_allclose(kin.fk(q), T, atol=1e-12)


def test_jacobian_by_finite_differences(kin, postures):
    step = 1e-6
    for q in postures[:50]:
        J, T = kin.jacobian(q), kin.fk(q)
        for joint in range(7):
            moved = [kin.fk(q + sign * step * np.eye(7)[joint]) for sign in (1, -1)]
            np.testing.assert_allclose((moved[0] - moved[1])[:3, 3] / (2 * step), J[:3, joint], atol=1e-8)
            W = (moved[0] - moved[1])[:3, :3] / (2 * step) @ T[:3, :3].T
            np.testing.assert_allclose((W[2, 1], W[0, 2], W[1, 0]), J[3:, joint], atol=1e-8)


@pytest.mark.parametrize("solver", [LevenbergMarquardtSolver, QPSolver, PlacoSolver])
def test_solvers_reach_poses(solver, kin, panda, postures):
    solver = solver(kin)
    for q in postures[:40]:
        result = solver.solve(PoseGoal(kin.fk(q)), panda.home)
        assert result.success
        assert kin.within_limits(result.q)


def test_collisions(panda, kin, postures):
    checker = CollisionChecker(panda)
    assert checker.free(panda.home)
    colliding = [checker.in_collision(q) for q in postures]
    assert 0.05 < np.mean(colliding) < 0.3
    assert ("panda_link6", "panda_link7") not in checker.pairs
    assert ("panda_hand", "panda_link5") in checker.pairs


def test_simulation(panda, kin, postures):
    checker, simulation = CollisionChecker(panda), ArmSimulation(panda)
    free = [q for q in postures if checker.free(q)][:15]
    for q in free:
        simulation.reset()
        assert simulation.move(q).reached
        np.testing.assert_allclose(simulation.tip_position, kin.fk(q)[:3, 3], atol=0.01)
    assert len(free) == 15


def test_a_gripper_and_a_work_cell_can_be_added():
    cell = Workcell(goals=BoxRegion((0.3, 0.6), (-0.2, 0.2), (0.1, 0.1)))
    arm = ArmDescription.from_urdf(PANDA, tip="panda_link8", gripper_on="panda_link8", workcell=cell, name="mine")
    assert (arm.name, arm.default_tip, len(arm.joints)) == ("mine", "tcp", 7)
    kin, link = ArmKinematics(arm), ArmKinematics(arm, tip="panda_link8")
    q = np.array(arm.home)
    np.testing.assert_allclose(kin.fk(q)[:3, 3], link.fk(q) @ (0, 0, 0.2, 1) @ np.eye(4, 3), atol=1e-12)
    simulation = ArmSimulation(arm)
    assert simulation.move(q + 0.1).reached


def test_meshes_named_relative_to_the_file_and_in_packages(tmp_path, panda):
    meshes = PANDA.parents[1] / "meshes/collision"
    text = PANDA.read_text()
    address = "package://example-robot-data/robots/panda_description/meshes/"
    robot = tmp_path / "elsewhere/robot/urdf/panda.urdf"
    robot.parent.mkdir(parents=True)
    shutil.copytree(meshes, tmp_path / "elsewhere/robot/meshes/collision")
    q = np.array(panda.home) + 0.3
    for told, options in (
        ("../meshes/", {}),
        ("package://robot/meshes/", {}),
        ("package://robot/meshes/", {"package_dirs": [tmp_path / "elsewhere"]}),
    ):
        plain = text.replace(address + "collision/", told + "collision/")
        plain = "".join(line for line in plain.splitlines(True) if "meshes/visual" not in line)
        robot.write_text(
            plain.replace("<geometry>\n            </geometry>", '<geometry><sphere radius="0.01"/></geometry>')
        )
        arm = ArmDescription.from_urdf(robot, **options)
        distance = CollisionChecker(arm).distance(q)
        assert distance.distance == pytest.approx(CollisionChecker(panda).distance(q).distance, abs=1e-6)


ARM = """<robot name="two">
  <link name="base"/> <link name="one"/> <link name="two"/> <link name="side"/> <link name="end"/>
  <joint name="a" type="{a}"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>{limit}</joint>
  <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
    <limit lower="0.5" upper="1.5" effort="1" velocity="2"/></joint>
  <joint name="c" type="prismatic"><parent link="two"/><child link="side"/><axis xyz="0 0 2"/>
    <origin xyz="0.1 0 0" rpy="0 1.57079632679489656 0"/>
    <limit lower="0.02" upper="0.4" effort="1" velocity="1"/>{mimic}</joint>
  <joint name="d" type="fixed"><parent link="two"/><child link="end"/><origin xyz="0.2 0 0"/></joint>
</robot>"""
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def write(tmp_path, a="revolute", limit=LIMIT, mimic=""):
    file = tmp_path / "two.urdf"
    file.write_text(ARM.format(a=a, limit=limit, mimic=mimic))
    return file


def test_an_arm_is_named_by_its_urdf_else_by_its_file(tmp_path):
    file = tmp_path / "stem.urdf"
    for head, name in (('<robot name="two">', "two"), ("<robot>", "stem"), ('<robot name="">', "stem")):
        file.write_text(write(tmp_path).read_text().replace('<robot name="two">', head))
        arm = ArmDescription.from_urdf(file)
        assert (arm.name, arm.title) == (name, name)
        assert ArmDescription.from_urdf(file, name="mine").title == "mine"


def test_a_joint_without_end_has_no_limits(tmp_path):
    kin = ArmKinematics.from_urdf(write(tmp_path, a="continuous", limit=""))
    assert kin.arm.joints == ("a", "b")
    assert (kin.lower[0], kin.upper[0]) == (-np.inf, np.inf)
    np.testing.assert_allclose(kin.fk([0.4, 1.0])[:3, 3], kin.fk([0.4 - 2 * np.pi, 1.0])[:3, 3], atol=1e-12)


@pytest.mark.parametrize(("options", "slid"), [({}, 0.02), ({"held": {"c": 0.3}}, 0.3), ({"joints": ["b"]}, 0.02)])
def test_joints_beside_the_arm_are_held(tmp_path, options, slid):
    kin = ArmKinematics.from_urdf(write(tmp_path), tip="side", **({"joints": ["a", "b"]} | options))
    q = np.zeros(kin.n)
    np.testing.assert_allclose(kin.fk(q)[:3, 3], (0.4 + slid, 0, 0), atol=1e-12)


def test_a_joint_that_follows_a_held_one(tmp_path):
    file = write(tmp_path, mimic='<mimic joint="a" multiplier="2" offset="0.1"/>')
    kin = ArmKinematics.from_urdf(file, tip="side", joints=["b"], held={"a": 0.1})
    T = kin.fk([0.0])
    np.testing.assert_allclose(np.linalg.norm(T[:2, 3]), 0.4 + 0.3, atol=1e-12)
    follows = ArmKinematics.from_urdf(file, tip="side", joints=["a", "b"])
    np.testing.assert_allclose(np.linalg.norm(follows.fk([0.1, 0.0])[:2, 3]), 0.4 + 0.3, atol=1e-12)
    assert follows.upper[0] == pytest.approx(0.15)  # c within its limits: 2 * 0.15 + 0.1 = 0.4
    assert ArmDescription.from_urdf(file, tip="end").joints == ("a", "b")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"tip": "nowhere"}, "unknown link.*nowhere"),
        ({"joints": ["nowhere"]}, "unknown joint.*nowhere"),
        ({"joints": ["b", "a"]}, "in this order"),
        ({"tip": "base"}, "no joint moves"),
        ({"held": {"x": 0.0}}, "unknown joint"),
        ({"held": {"c": np.nan}}, "finite"),
        ({"gripper_on": "base"}, "unknown link.*gripper"),
        ({"home": [0.0]}, "home must have 2"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, options, said):
    with pytest.raises(InputError, match=said):
        ArmDescription.from_urdf(write(tmp_path), **options)


@pytest.mark.parametrize(
    "address",
    ["/etc/passwd", "../../../../../etc/passwd", "package://a/../../../x.stl", "file:///etc/x.stl", "http://a/x.stl",
     "package:///x.stl", "no.stl", "", "a\u202e.stl", "two.urdf", "package://../two.urdf"],
)  # fmt: skip
def test_meshes_elsewhere_are_refused(tmp_path, address):
    file = write(tmp_path)
    shape = f'<link name="end"><collision><geometry><mesh filename="{address}"/></geometry></collision></link>'
    file.write_text(file.read_text().replace('<link name="end"/>', shape))
    arm = ArmDescription.from_urdf(file)
    assert "<mesh" not in arm.urdf
    assert arm.package_root() is None
    assert ArmKinematics(arm).n == 2
    for use in (CollisionChecker, ArmSimulation):
        with pytest.raises(NoShapesError, match=r"the collision mesh .* of link 'end' is not found"):
            use(arm)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"<robot", b"<!DOCTYPE r><robot name='a'/>"])
def test_files_that_are_no_urdf(tmp_path, content):
    file = tmp_path / "no.urdf"
    file.write_bytes(content)
    with pytest.raises(InputError):
        ArmDescription.from_urdf(file)
    with pytest.raises(InputError, match="not a regular file"):
        ArmDescription.from_urdf(tmp_path)
    with pytest.raises(InputError, match="cannot read"):
        ArmDescription.from_urdf(tmp_path / "none.urdf")


def test_a_home_outside_the_limits_is_refused(tmp_path):
    file = write(tmp_path)
    assert ArmDescription.from_urdf(file, home=(1.0, 0.5)).home == (1.0, 0.5)
    for home, said in (((0.0, 0.0), "'b' at 0 rad, outside its limits 0.5 to 1.5"), ((-1.1, 1.0), "'a' at -1.1 rad")):
        with pytest.raises(InputError, match=said):
            ArmDescription.from_urdf(file, home=home)
        with pytest.raises(InputError, match=said):
            ArmKinematics.from_urdf(file, home=home)


def test_a_joint_whose_limits_are_left_out_is_named(tmp_path):
    for limit in ('<limit effort="1" velocity="1"/>', '<limit lower="0" upper="0" effort="1" velocity="1"/>'):
        file = write(tmp_path, limit=limit)
        with pytest.raises(InputError, match="joint 'a' cannot move, its limits are 0 and 0 rad"):
            ArmDescription.from_urdf(file)
        assert ArmDescription.from_urdf(file, held={"a": 0.0}).joints == ("b",)


def test_other_limits():
    arm = get_arm("ur5").with_limits({"elbow_joint": (0.1, 2.0), "wrist_3_joint": (-6.0, 6.0)})
    kin = ArmKinematics(arm)
    assert (kin.lower[2], kin.upper[2], kin.lower[5], kin.upper[5]) == (0.1, 2.0, -6.0, 6.0)
    assert kin.upper[0] == ArmKinematics("ur5").upper[0]
    assert pickle.loads(pickle.dumps(arm)).urdf == arm.urdf
    assert arm.home == get_arm("ur5").home
    assert get_arm("ur5").with_limits({"elbow_joint": (-1.0, 0.5)}).home[2] == 0.5
    for limits, said in (
        ({"elbow": (0.0, 1.0)}, "unknown joint.*elbow_joint"),
        ({"elbow_joint": (2.0, 1.9)}, "lower limit above the upper one"),
        ({"elbow_joint": (np.nan, 1.0)}, "finite"),
        ({"elbow_joint": 1.0}, "shape"),
        ({"elbow_joint": (1.0, 1.0)}, "'elbow_joint' cannot move"),
        (-1.0, "limits must be"),
        ("wide", "limits must be a number"),
    ):
        with pytest.raises(InputError, match=said):
            get_arm("ur5").with_limits(limits)


def test_names_may_have_any_characters_that_can_be_printed(tmp_path):
    """Quotes of both kinds and brackets: what is looked for by a path of its own syntax is not found, or fails."""
    strange = {name: f'it\'s "{name}"] /' for name in ("a", "b", "c", "d", "base", "one", "two", "side", "end")}
    text = write(tmp_path).read_text()
    for name, other in strange.items():
        text = text.replace(f'"{name}"', quoteattr(other))
    file = tmp_path / "strange.urdf"
    file.write_text(text)
    arm = ArmDescription.from_urdf(file, tip=strange["end"], held={strange["c"]: 0.3}, gripper_on=strange["end"])
    plain = ArmDescription.from_urdf(write(tmp_path), tip="end", held={"c": 0.3}, gripper_on="end")
    assert arm.joints == (strange["a"], strange["b"])
    kin, other = (ArmKinematics(each.with_limits({each.joints[0]: (-0.5, 0.25)}), tip="tcp") for each in (arm, plain))
    assert (kin.lower[0], kin.upper[0]) == (-0.5, 0.25)
    q = np.random.default_rng(0).uniform(kin.lower, kin.upper, (20, 2))
    np.testing.assert_array_equal(kin.fk(q), other.fk(q))
    with pytest.raises(InputError, match=r"unknown link.*it's"):
        ArmDescription.from_urdf(file, tip=strange["end"], gripper_on="it's")
    with pytest.raises(InputError, match=r"unknown joint.*it's"):
        ArmDescription.from_urdf(file, tip=strange["end"], held={"it's": 0.0})


@pytest.mark.parametrize("limit", ["", LIMIT])
def test_a_joint_without_end_takes_limits(tmp_path, limit):
    arm = ArmDescription.from_urdf(write(tmp_path, a="continuous", limit=limit))
    assert ArmKinematics(arm).upper[0] == np.inf
    kin = ArmKinematics(arm.with_limits({"a": (-1.0, 1.0)}))
    assert (kin.lower[0], kin.upper[0]) == (-1.0, 1.0)


@pytest.mark.usefixtures("needs_placo")
def test_a_speed_that_is_not_given_holds_no_joint_still(tmp_path):
    """Continuous joints often have no speed, or 0, and solvers with speed limits left them where they were."""
    for limit in ("", '<limit effort="0" velocity="0"/>'):
        arm = ArmDescription.from_urdf(write(tmp_path, a="continuous", limit=limit))
        kin = ArmKinematics(arm)
        assert kin.velocity_limit.tolist() == [3.0, 2.0]
        goal = PositionGoal(kin.fk([1.2, 1.1])[:3, 3])
        for solver in (PlacoSolver(kin), QPSolver(kin)):
            found = solver.solve(goal, [-0.8, 0.7])
            assert found.success
            np.testing.assert_allclose(found.q, [1.2, 1.1], atol=1e-2)


@pytest.mark.usefixtures("needs_placo")
def test_a_link_and_a_joint_may_have_one_name(tmp_path):
    file = tmp_path / "same.urdf"
    file.write_text(ARM.format(a="revolute", limit=LIMIT, mimic="").replace('joint name="d"', 'joint name="end"'))
    kin, other = ArmKinematics.from_urdf(file, tip="end"), ArmKinematics.from_urdf(write(tmp_path), tip="end")
    q = np.random.default_rng(0).uniform(kin.lower, kin.upper, (20, 2))
    np.testing.assert_array_equal([kin.fk(row) for row in q], [other.fk(row) for row in q])
    np.testing.assert_allclose(kin.fk(q), other.fk(q), atol=1e-14)
    solver = PlacoSolver(kin)
    for row in q:
        found = solver.solve(PositionGoal(kin.fk(row)[:3, 3]), kin.arm.home)
        assert found.success
        np.testing.assert_allclose(other.fk(found.q)[:3, 3], kin.fk(row)[:3, 3], atol=1e-3)


def test_the_panda_by_its_name():
    panda, kin = get_arm("panda"), ArmKinematics("panda", base="world")
    assert panda is get_arm("panda")
    assert "panda" in arm_names()
    np.testing.assert_allclose(kin.fk(panda.home)[:3, 2], (0, 0, -1), atol=1e-9)
    assert CollisionChecker("panda").free(panda.home)
    with pytest.raises(InputError, match="registered already"):
        register_arm(ArmDescription.from_urdf(PANDA))


@pytest.mark.parametrize(
    ("file", "branches", "tip", "joints"),
    [
        ("baxter_description/urdf/baxter.urdf", "2 branches of 7 joints, which end in right_", "right_gripper", 7),
        ("solo_description/robots/solo12.urdf", "4 branches of 3 joints", "FL_FOOT", 3),
        ("alex_description/urdf/alex_sake_hands.urdf", "2 branches of 9 joints", "LeftSakeFingerTip2", 9),
    ],
)  # fmt: skip
def test_of_equal_branches_the_user_chooses(file, branches, tip, joints):
    path = SHARE / "example-robot-data/robots" / file
    with pytest.raises(InputError, match=f"{branches}.*say with tip="):
        ArmDescription.from_urdf(path)
    arm = ArmDescription.from_urdf(path, tip=tip)
    assert (len(arm.joints), arm.default_tip) == (joints, tip)
    model = pin.buildModelFromUrdf(str(path))
    data, kin = model.createData(), ArmKinematics(arm)
    full = pin.neutral(model)
    for q in np.random.default_rng(0).uniform(kin.lower, kin.upper, (20, kin.n)):
        for name, angle in zip(arm.joints, q, strict=True):
            joint = model.joints[model.getJointId(name)]
            endless = joint.nq == 2  # Pinocchio has cosine and sine of a joint without end
            full[joint.idx_q : joint.idx_q + joint.nq] = (np.cos(angle), np.sin(angle)) if endless else angle
        pin.framesForwardKinematics(model, data, full)
        base = data.oMf[model.getFrameId(arm.base, pin.BODY)]
        np.testing.assert_allclose(kin.fk(q), (base.inverse() * data.oMf[model.getFrameId(tip)]).homogeneous, atol=1e-9)


@pytest.mark.slow
def test_arms_of_other_makers():
    """Serial arms of example-robot-data by their files alone: what is found, and FK of a stack against Pinocchio's."""
    tips = {
        "xarm_description/urdf/xarm7.urdf": (7, "link_eef"),
        "z1_description/urdf/z1.urdf": (6, "gripperStator"),
        "bravo7_description/urdf/bravo7_no_ee.urdf": (6, "contact_point"),
        "bravo7_description/urdf/bravo7_gripper.urdf": (6, "grasping_poing"),
        "talos_data/robots/talos_left_arm.urdf": (6, "gripper_left_base_link"),
        "kinova_description/robots/kinova.urdf": (6, "j2s6s200_end_effector"),
        "panda_description/urdf/panda.urdf": (7, "panda_hand_tcp"),
        "finger_edu_description/robots/finger_edu.urdf": (3, "finger_tip_link"),
        "ur_description/urdf/ur10_robot.urdf": (6, "tool0"),
    }
    for file, (joints, tip) in tips.items():
        kin = ArmKinematics.from_urdf(SHARE / "example-robot-data/robots" / file)
        assert (kin.n, kin.tip) == (joints, tip)
        q = np.random.default_rng(1).uniform(*kin.sampling_limits, (50, joints))
        np.testing.assert_allclose(kin.fk(q), [kin.fk(row) for row in q], atol=2e-10)


def chain(*joints):
    """A URDF of joints one after the other, each a type and what is in it."""
    links = "".join(f'<link name="l{i}"/>' for i in range(len(joints) + 1))
    return (
        f'<robot name="chain">{links}'
        + "".join(
            f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0.1 0.3"/>'
            f'<axis xyz="{"0 0 1" if i % 2 else "0 1 0"}"/>{inside}</joint>'
            for i, (kind, inside) in enumerate(joints)
        )
        + "</robot>"
    )


TURNS, SLIDES = ("revolute", LIMIT), ("prismatic", '<limit lower="0" upper="0.3" effort="1" velocity="1"/>')
REFUSED = {
    "text": (chain(TURNS, ("revolute", LIMIT.replace("-1", "low"))), "lower of <limit> must be a number.*'low', in"),
    "script": (chain(TURNS, ("revolute", LIMIT.replace("-1", "-١"))), "lower of <limit> must be a number.*'-١', in"),
    "axis": (chain(TURNS, TURNS).replace('"0 0 1"', '"0 0 1e-320"'), "'j1'.*axis without direction: '0 0 1e-320'"),
    "deep": ("<robot>" + "<a>" * 200_000 + "</a>" * 200_000 + "</robot>", "nested deeper than 100 elements"),
    "loop": (
        chain(TURNS, TURNS).replace('<child link="l1"/>', '<child link="l2"/>'), "each of which hangs on one joint"
    ),
    "stays": (chain(TURNS).replace("0 0.1 0.3", "0 0 0"), "no joint moves the tip 'l1' to another place"),
}  # fmt: skip


def test_a_urdf_is_as_deep_as_it_may_be(tmp_path):
    file = tmp_path / "deep.urdf"
    for depth, good in ((100, True), (101, False)):
        nested = "<a>" * (depth - 1) + "</a>" * (depth - 1)
        file.write_text(chain(TURNS, TURNS).replace("</robot>", f"{nested}</robot>"))
        with nullcontext() if good else pytest.raises(InputError, match="nested deeper than 100 elements"):
            assert ArmDescription.from_urdf(file).joints == ("j0", "j1")


@pytest.mark.parametrize("name", REFUSED)
def test_a_urdf_that_cannot_be_used_is_one_line(tmp_path, capsys, name):
    text, said = REFUSED[name]
    file = tmp_path / "chain.urdf"
    file.write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        check.reach_of(ArmKinematics.of(ArmDescription.from_urdf(file)))
    assert "\n" not in str(caught.value)
    assert cli.main(["check", str(file), "--poses", "2"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("kinreach check: error: ")
    assert re.search(said, line)


def test_joints_beyond_one_that_slides_count_where_it_is_held(tmp_path):
    file = tmp_path / "chain.urdf"
    file.write_text(chain(TURNS, TURNS, SLIDES, TURNS))
    assert ArmDescription.from_urdf(file).joints == ("j0", "j1", "j2", "j3")
    arm = ArmDescription.from_urdf(file, held={"j2": 0.2})
    assert arm.joints == ("j0", "j1", "j3")
    assert ArmDescription.from_urdf(file, joints=["j0", "j1", "j3"]).joints == ("j0", "j1", "j3")
    assert ArmDescription.from_urdf(file, tip="l2").joints == ("j0", "j1")


@pytest.mark.usefixtures("needs_placo")
def test_an_arm_of_one_joint_is_checked(tmp_path, capsys):
    file = tmp_path / "chain.urdf"
    file.write_text(chain(TURNS, ("fixed", "")))
    assert cli.main(["check", str(file), "--poses", "2"]) == 0
    out = capsys.readouterr().out
    assert "reach        0.316 m from the origin of" in out
    assert out.count("100.0 %") >= 3, out


def test_a_picture_without_a_folder_is_refused_before_the_work(tmp_path, capsys):
    for path in (tmp_path / "nowhere/x.png", tmp_path):
        assert cli.main(["check", "arm3", "--picture", str(path)]) == 2
        out, err = capsys.readouterr()
        assert not out
        assert "--picture must be a file in a folder that exists" in err


def test_the_closed_form_of_an_arm_without_one_is_refused_at_once(kin):
    with pytest.raises(InputError, match="has no closed form; the solvers placo, lm and qp take any arm"):
        ClosedFormSolver(kin)
