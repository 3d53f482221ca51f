"""Joints that follow others, and joints that slide: kinematics against Pinocchio, limits, solvers, units."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from kinreach.cli import main
from kinreach.errors import InputError
from kinreach.kinematics import (
    ArmKinematics,
    CollisionChecker,
    PoseGoal,
    PositionGoal,
    joint_line,
    plan_path,
    pose_vector,
)
from kinreach.kinematics.inside import new_solver, place_robot, placo_robot
from kinreach.robots import ArmDescription, Box
from tests.robots.peoples_files import arm, shape

RIGHT = "1.5707963267948966"
SOLID = shape('<cylinder radius="0.02" length="0.05"/>', "collision")


def joint(name, kind, parent, *, xyz="0 0 0", rpy="0 0 0", axis="0 0 1", limits=(-3.1, 3.1), mimic=""):
    """A joint to a link of its own name."""
    ends = f'lower="{limits[0]}" upper="{limits[1]}"' if kind != "continuous" else ""
    return (
        f'<link name="{name}_link">{SOLID}</link><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{name}_link"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        f'<limit {ends} effort="9" velocity="2"/>{mimic}</joint>'
    )


def chain(*joints):
    """A URDF of joints one after the other, each its name, kind and what `joint` takes."""
    parent, text = "base", '<link name="base"/>'
    for name, kind, options in joints:
        text += joint(name, kind, parent, **options)
        parent = f"{name}_link"
    return f'<robot name="arm">{text}</robot>'


def follows(leader, multiplier=1.0, offset=0.0):
    return f'<mimic joint="{leader}" multiplier="{multiplier}" offset="{offset}"/>'


def written(folder, text, **options):
    file = folder / "arm.urdf"
    file.write_text(text)
    return ArmKinematics.from_urdf(file, **options)


PALLETIZER = (
    ("j1", "revolute", {"xyz": "0 0 0.1"}),
    ("j2", "revolute", {"rpy": f"-{RIGHT} 0 0", "limits": (-1.0, 1.5)}),
    ("j2m", "revolute", {"xyz": "0.135 0 0", "limits": (-1.2, 0.8), "mimic": follows("j2", -1)}),
    ("j3", "revolute", {}),
    ("j3m", "revolute", {"xyz": "0.147 0 0", "mimic": follows("j3", -1)}),
    ("j4", "revolute", {"xyz": "0.06 0 0", "rpy": f"{RIGHT} 0 0"}),
)
SCARA = (
    ("j1", "revolute", {"xyz": "0 0 0.2", "limits": (-2.3, 2.3)}),
    ("j2", "revolute", {"xyz": "0.25 0 0", "limits": (-2.5, 2.5)}),
    ("z", "prismatic", {"xyz": "0.2 0 0", "axis": "0 0 -1", "limits": (0.0, 0.18)}),
    ("j4", "continuous", {}),
)
RAIL = (
    ("rail", "prismatic", {"xyz": "0 0 0.1", "axis": "0 1 0", "limits": (-0.4, 0.6)}),
    ("j1", "revolute", {"xyz": "0 0 0.15"}),
    ("j2", "revolute", {"xyz": "0 0.1 0", "rpy": f"{RIGHT} 0 0", "limits": (0.0, 3.1)}),
    ("j3", "revolute", {"xyz": "0.4 0 0", "limits": (-2.0, 2.0)}),
    ("j4", "revolute", {"xyz": "0.35 0 0"}),
    ("j5", "revolute", {"xyz": "0 -0.1 0", "rpy": f"{RIGHT} 0 0"}),
    ("j6", "revolute", {"xyz": "0 0.09 0", "rpy": f"-{RIGHT} 0 0"}),
)
COUPLED_WRIST = (
    ("j1", "revolute", {"xyz": "0 0 0.2"}),
    ("j2", "revolute", {"xyz": "0 0 0.1", "rpy": f"-{RIGHT} 0 0", "limits": (-1.2, 1.2)}),
    ("j3", "revolute", {"xyz": "0.4 0 0", "limits": (-1.0, 2.0)}),
    ("j4", "revolute", {"xyz": "0.05 0 0", "rpy": f"-{RIGHT} 0 0"}),
    ("j5a", "revolute", {"xyz": "0 0 0.3", "rpy": "0.9 0 0"}),
    ("j5b", "revolute", {"xyz": "0 0 0.1", "rpy": "-1.2 0 0", "mimic": follows("j5a", -1, 0.3)}),
    ("j6", "revolute", {"xyz": "0 0 0.1", "rpy": "0.6 0 0"}),
)


def random_arm(rng, slides, followers):
    """A URDF of seven joints in random places, some of which slide, and some follow one before them."""
    names = [f"q{i}" for i in range(7)]
    sliding = set(rng.choice(names, slides, replace=False))
    following = set(rng.choice(names[1:], followers, replace=False))
    joints = []
    for index, name in enumerate(names):
        alike = [other for other in names[:index] if other not in following and (other in sliding) == (name in sliding)]
        kind = "prismatic" if name in sliding else "revolute"
        numbers = lambda size: " ".join(map(str, rng.uniform(-size, size, 3)))  # noqa: E731
        mimic = ""
        if name in following and alike:
            mimic = follows(rng.choice(alike), rng.choice([-1, 1]) * rng.uniform(0.3, 2.0), rng.uniform(-0.2, 0.2))
        limits = (-0.4, 0.5) if name in sliding else (-3.0, 3.0)
        places = {"xyz": numbers(0.3), "rpy": numbers(3.0), "axis": numbers(1.0)}
        joints.append((name, kind, {**places, "limits": limits, "mimic": mimic}))
    return chain(*joints)


def leaders(text):
    """Names of the joints of `random_arm` that follow no other."""
    return [joint.get("name") for joint in ET.fromstring(text).findall("joint") if joint.find("mimic") is None]


def test_random_arms_are_pinocchios(tmp_path):
    """One posture, stacks of them and tensors, with limits within which every joint is."""
    torch = pytest.importorskip("torch")
    rng, sliding, coupled = np.random.default_rng(0), 0, 0
    for number in range(24):
        text = random_arm(rng, slides=number % 4, followers=number // 4 % 3)
        kin = written(tmp_path, text, tip="q6_link", joints=leaders(text))
        model, alone = pin.buildModelFromXML(text, mimic=True), pin.buildModelFromXML(text)
        assert kin.n == model.nq
        data, frame = model.createData(), model.getFrameId("q6_link", pin.BODY)
        assert (kin.upper > kin.lower).all()
        Q = rng.uniform(kin.lower, kin.upper, (8, kin.n))
        places = np.array([[each.factor, each.offset, each.entry] for each in kin.moves])
        every = places[:, 0] * Q[:, places[:, 2].astype(int)] + places[:, 1]
        assert (every >= alone.lowerPositionLimit - 1e-9).all()
        assert (every <= alone.upperPositionLimit + 1e-9).all()
        stack, jacobians = kin.fk(Q), kin.jacobian(Q)
        np.testing.assert_allclose(kin.positions(Q), stack[:, :3, 3], atol=1e-12)
        np.testing.assert_allclose(kin.fk(torch.tensor(Q)).numpy(), stack, atol=1e-12)
        np.testing.assert_allclose(kin.jacobian(torch.tensor(Q)).numpy(), jacobians, atol=1e-12)
        for q, T, J in zip(Q, stack, jacobians, strict=True):
            pin.forwardKinematics(model, data, q)
            np.testing.assert_allclose(T, pin.updateFramePlacement(model, data, frame).homogeneous, atol=1e-10)
            theirs = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
            np.testing.assert_allclose(J, theirs, atol=1e-10)
            np.testing.assert_allclose(kin.fk(q), T, atol=1e-10)
            np.testing.assert_allclose(kin.jacobian(q), J, atol=1e-10)
        sliding, coupled = sliding + kin.slides.any(), coupled + (len(kin.moves) > kin.n)
    assert sliding >= 12
    assert coupled >= 9


@pytest.mark.parametrize("name", ["lm", "qp", "placo"])
def test_solvers_reach_what_random_arms_reach(name, tmp_path, request):
    if name == "placo":
        request.getfixturevalue("needs_placo")
    rng, reached, count = np.random.default_rng(1), 0, 0
    for number in range(8):
        text = random_arm(rng, slides=number % 4, followers=number // 4)
        kin = written(tmp_path, text, tip="q6_link", joints=leaders(text))
        solver = new_solver(name, kin)
        for q in rng.uniform(kin.lower, kin.upper, (3, kin.n)):
            goal = PoseGoal(kin.fk(q)) if kin.n >= 6 else PositionGoal(kin.fk(q)[:3, 3])
            found = solver.solve(goal, q + 0.2 * (kin.arm.home - q))
            assert kin.within_limits(found.q)
            reached, count = reached + found.success, count + 1
    assert count == 24
    assert reached >= 23


def test_a_palletizer_is_an_arm_of_four_axes(tmp_path):
    kin = written(tmp_path, chain(*PALLETIZER))
    assert kin.arm.joints == ("j1", "j2", "j3", "j4")
    assert kin.arm.notes == ("joint j2m follows j2 and is not part of q", "joint j3m follows j3 and is not part of q")
    assert (kin.lower[1], kin.upper[1]) == (-0.8, 1.2)  # j2m, which follows by -1, is within -1.2 and 0.8
    assert kin.tip == "j4_link"
    rng = np.random.default_rng(0)
    for q in rng.uniform(kin.lower, kin.upper, (20, 4)):
        np.testing.assert_allclose(kin.fk(q)[:3, 2], (0, 0, 1), atol=1e-12)  # its flange stays level
    for name in ("lm", "qp"):
        solver, Q = new_solver(name, kin), rng.uniform(kin.lower, kin.upper, (20, 4))
        assert sum(solver.solve(PoseGoal(kin.fk(q)), q + 0.1).success for q in Q) >= 19


def test_a_wrist_of_two_halves(tmp_path):
    """5b mimics 5a, as in painting robots: six entries, every pose of theirs is reached; also where 5b is the last."""
    places = (("0 0 0.3", "0 0 0"), ("0.1 0 0", f"{RIGHT} 0 0"), ("0.4 0 0", "0 0 0"), ("0.1 -0.3 0", f"{RIGHT} 0 0"))
    wrist = (
        *[(f"j{i}", "revolute", {"xyz": xyz, "rpy": rpy}) for i, (xyz, rpy) in enumerate(places, start=1)],
        ("5a", "revolute", {"rpy": "0.6 0 0", "limits": (-2.0, 2.0)}),
        ("5b", "revolute", {"rpy": "-1.2 0 0", "limits": (-3.0, 3.5), "mimic": follows("5a", -2.0, 0.1)}),
        ("j6", "revolute", {"xyz": "0 0 0.1", "rpy": "0.6 0 0"}),
    )
    kin = written(tmp_path, chain(*wrist))
    assert kin.arm.joints == ("j1", "j2", "j3", "j4", "5a", "j6")
    assert (kin.lower[4], kin.upper[4]) == pytest.approx((-1.7, 1.55))
    rng, solver = np.random.default_rng(0), new_solver("lm", kin)
    found = [
        solver.solve(PoseGoal(kin.fk(q)), kin.arm.home).success for q in rng.uniform(kin.lower, kin.upper, (30, 6))
    ]
    assert sum(found) >= 28
    last = written(tmp_path, chain(*wrist[:-1]))
    assert (last.arm.joints, last.tip) == (("j1", "j2", "j3", "j4", "5a"), "5b_link")


def test_of_joints_that_move_together_the_first_is_one_of_q(tmp_path):
    """Whichever mimics which, over others, or one that is not on the way."""
    q, base = np.array([0.2, 0.3, -0.4]), [("a", "revolute", {"xyz": "0 0 0.2"}), ("b", "revolute", {"rpy": "1 0 0"})]
    plain = written(
        tmp_path, chain(*base, ("c", "revolute", {"xyz": "0.2 0 0"}), ("d", "revolute", {"xyz": "0.3 0 0"}))
    )
    places = [q[0], q[1], 0.5 * q[1] + 0.1, q[2]]
    later = (
        ("b", "revolute", {"rpy": "1 0 0", "mimic": follows("c", 2.0, -0.2)}),
        ("c", "revolute", {"xyz": "0.2 0 0"}),
    )
    kin = written(tmp_path, chain(base[0], *later, ("d", "revolute", {"xyz": "0.3 0 0"})))
    assert kin.arm.joints == ("a", "b", "d")
    np.testing.assert_allclose(kin.fk(q), plain.fk(places), atol=1e-12)
    motor = joint("motor", "revolute", "base")
    beside = [
        ("b", "revolute", {"rpy": "1 0 0", "mimic": follows("motor", 4.0)}),
        ("c", "revolute", {"xyz": "0.2 0 0", "mimic": follows("half", 1.0, 0.1)}),
        ("d", "revolute", {"xyz": "0.3 0 0"}),
    ]
    text = chain(base[0], *beside).replace(
        "</robot>", f"{motor}{joint('half', 'revolute', 'base', mimic=follows('motor', 2.0))}</robot>"
    )
    kin = written(tmp_path, text)
    assert kin.arm.joints == ("a", "b", "d")
    np.testing.assert_allclose(kin.fk(q), plain.fk(places), atol=1e-12)


def test_rods_beside_the_chain_and_fingers_are_held(tmp_path):
    rod = joint("rod", "continuous", "l1", mimic=follows("j2", -0.25))
    kin = written(tmp_path, arm(more=rod))
    assert (kin.n, kin.tip) == (6, "l6")
    assert "joint rod follows the arm beside the way" in kin.arm.notes[0]
    jaws = joint("left", "prismatic", "l6", limits=(0, 0.04)) + joint("right", "prismatic", "l6", mimic=follows("left"))
    kin = written(tmp_path, arm(more=jaws))
    assert (kin.n, kin.tip) == (6, "l6")


def test_a_scara_a_gantry_and_a_rail(tmp_path):
    kin = written(tmp_path, chain(*SCARA))
    assert kin.arm.joints == ("j1", "j2", "z", "j4")
    assert kin.slides.tolist() == [False, False, True, False]
    assert (kin.lower[2], kin.upper[2], kin.upper[3]) == (0.0, 0.18, np.inf)
    assert kin.fk([0, 0, 0.1, 0])[:3, 3] == pytest.approx((0.45, 0, 0.1))
    quill = written(tmp_path, chain(*SCARA[:2], SCARA[3], SCARA[2]))
    assert (quill.arm.joints, quill.tip) == (("j1", "j2", "j4", "z"), "z_link")
    gantry = chain(*[(axis, "prismatic", {"axis": way, "limits": (0, 2.0)}) for axis, way in
                     (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 -1"))], SCARA[3])  # fmt: skip
    kin = written(tmp_path, gantry)
    assert kin.arm.joints == ("x", "y", "z", "j4")
    assert kin.fk([0.1, 0.2, 0.3, 0.0])[:3, 3] == pytest.approx((0.1, 0.2, -0.3))
    rail = joint("rail", "prismatic", "floor", axis="1 0 0", limits=(0, 3.0)).replace("rail_link", "l0")
    text = arm(more=f'<link name="floor"/>{rail}').replace('<link name="l0"></link>', "")
    held = written(tmp_path, text)
    assert held.n == 6
    assert "joint rail slides and is held at 0 m" in held.arm.notes[0]
    taken = written(tmp_path, text, joints=["rail", *held.arm.joints])
    assert (taken.n, taken.slides[0], taken.upper[0]) == (7, True, 3.0)
    q = np.array([1.0, 0.1, 0.5, 0.9, -0.4, 0.9, 0.2])
    T = held.fk(q[1:])
    T[0, 3] += 1.0
    np.testing.assert_allclose(taken.fk(q), T, atol=1e-12)
    for name in ("lm", "qp"):
        found = new_solver(name, taken).solve(PoseGoal(T), taken.arm.home)
        assert found.success


def test_what_a_joint_carries_moves_no_farther_than_its_reach(tmp_path):
    """The bound of collision checks between two samples, where joints slide or follow others, too."""
    rng, count = np.random.default_rng(2), 0
    for number in range(8):
        kin = written(tmp_path, random_arm(rng, slides=number % 4, followers=number // 4))
        checker = CollisionChecker(kin, margin=0.01)
        model, geometry = checker.model, checker.geometry
        data, placed = model.createData(), pin.GeometryData(geometry)
        for q in rng.uniform(kin.lower, kin.upper, (20, kin.n)):
            change, moved = rng.uniform(-0.02, 0.02, kin.n), []
            for posture in (q, q + change):
                pin.updateGeometryPlacements(model, data, geometry, placed, posture)
                moved.append([place.translation for place in placed.oMg])
            assert np.linalg.norm(np.subtract(*moved), axis=1).max() <= np.abs(change) @ checker.reach + 1e-12
            count += 1
    assert count == 160


def test_a_scara_plans_around_an_obstacle(tmp_path):
    kin = written(tmp_path, chain(*SCARA))
    box = Box("post", (0.05, 0.05, 0.6), (0.4, 0.0, 0.2))
    checker = CollisionChecker(kin, obstacles=[box], margin=0.005)
    path = plan_path(checker, [-0.8, 0.0, 0.1, 0.0], [0.8, 0.0, 0.1, 0.0], timeout=20.0)
    assert len(path) > 2
    assert not checker.impossible(joint_line(checker, path)).any()


def test_units_on_the_command_line(tmp_path, capsys):
    file = tmp_path / "arm.urdf"
    file.write_text(chain(*SCARA))
    kin = ArmKinematics.from_urdf(file)
    q = np.array([0.4, -0.9, 0.12, 1.0])
    pose = ",".join(f"{value:.12f}" for value in pose_vector(kin.fk(q)))
    command = ["ik", "--arm", str(file), f"--pose={pose}", "--degrees"]
    assert main([*command, "--seed", "20,-50,0.1,50"]) == 0
    out = capsys.readouterr().out
    assert "angles in degrees, z in m" in out
    best = next(line for line in out.splitlines() if line.startswith("*"))
    expected = [*np.rad2deg(q[:2]), q[2], np.rad2deg(q[3])]
    np.testing.assert_allclose([float(word) for word in best.split()[2:6]], expected, atol=0.1)
    assert "to the seed 20.0, -50.0, 0.100, 50.0" in out
    assert main([*command, "--seed", "20,-50,100,50"]) != 0
    assert "--seed must be within ±20 m, got 100; a joint that slides is in metres" in capsys.readouterr().err
    poses, table = tmp_path / "poses.csv", tmp_path / "out.csv"
    poses.write_text(f"x,y,z,rx,ry,rz\n{pose}\n")
    assert main(["ik", "--arm", str(file), "--poses", str(poses), "--out", str(table), "--degrees"]) == 0
    head, row = table.read_text().splitlines()
    assert head == "pose,q1_deg,q2_deg,q3,q4_deg,branch,reason"
    assert float(row.split(",")[3]) == pytest.approx(0.12, abs=2e-4)
    assert main(["check", str(file)]) == 0
    out = capsys.readouterr().out
    assert re.search(r"z +\+0\.000 to  \+0\.180 m, +2\.00 m/s, starts at \+0\.090 m", out)
    assert re.search(r"j4 +turns without end", out)


def test_limits_by_number_are_of_joints_that_turn(tmp_path):
    kin = ArmKinematics.of(written(tmp_path, chain(*SCARA)).arm.with_limits(1.0))
    assert kin.upper.tolist() == [1.0, 1.0, 0.18, 1.0]
    kin = ArmKinematics.of(kin.arm.with_limits({"z": (0.05, 0.1)}))
    assert (kin.lower[2], kin.upper[2]) == (0.05, 0.1)
    with pytest.raises(InputError, match=r"joint 'z' at 0.5 m, outside its limits 0 to 0.18"):
        ArmDescription.from_urdf(tmp_path / "arm.urdf", home=(0, 0, 0.5, 0))


def test_followers_that_cannot_be_within_their_limits(tmp_path):
    wrong = ("j2m", "revolute", {"limits": (2.0, 3.0), "mimic": follows("j2")})
    with pytest.raises(InputError, match="joint 'j2m', which follows 'j2', cannot be within its limits"):
        written(tmp_path, chain(PALLETIZER[0], PALLETIZER[1], wrong))
    still = ("j2m", "revolute", {"mimic": follows("j2", 0.0, 0.5)})
    with pytest.raises(InputError, match="'j2m' mimics 'j2' times 0, and does not move; hold it with held="):
        written(tmp_path, chain(PALLETIZER[0], PALLETIZER[1], still))
    assert written(tmp_path, chain(PALLETIZER[0], PALLETIZER[1], still), held={"j2m": 0.5}).n == 2


@pytest.mark.usefixtures("needs_placo")
@pytest.mark.parametrize("joints", [PALLETIZER, COUPLED_WRIST, SCARA], ids=["palletizer", "coupled wrist", "scara"])
def test_placos_robot_in_a_posture_has_its_tip_where_the_arm_has(joints, tmp_path):
    """With the joints that follow others, and their offsets."""
    kin, compared = written(tmp_path, chain(*joints)), 0
    robot, tip = placo_robot(kin)
    for q in np.random.default_rng(3).uniform(*kin.sampling_limits, (5, kin.n)):
        place_robot(kin, robot, q)
        np.testing.assert_allclose(robot.get_T_world_frame(tip), kin.T_world_base @ kin.fk(q), atol=1e-12)
        compared += 1
    assert compared == 5
