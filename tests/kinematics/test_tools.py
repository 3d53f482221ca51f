"""Tools on the flange, the pendant's frames, and poses as six numbers."""

import csv
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import (
    ArmKinematics,
    CalibratedURKinematics,
    CollisionChecker,
    SixAxisKinematics,
    URKinematics,
    pose,
    pose_vector,
)
from kinreach.robots import PUBLISHED_CALIBRATIONS, Gripper, Tool, arm_names, get_arm
from kinreach.robots.inside import UR_LENGTHS, link_shapes
from kinreach.sim import ArmSimulation
from tests.cases import slow

DATA = Path(__file__).parents[1] / "data/calibrations"
TOOLS = ([0, 0, 0.15, 0, 0, 0], [0.03, -0.02, 0.2, 0.3, -0.8, 0.5], [0, 0.1, 0, np.pi, 0, 0])


def test_poses_as_six_numbers():
    numbers = np.random.default_rng(0).uniform(-2, 2, (500, 6))
    T = pose(numbers)
    np.testing.assert_allclose(T[:, :3, :3], Rotation.from_rotvec(numbers[:, 3:]).as_matrix(), atol=1e-15)
    np.testing.assert_array_equal(T[:, :3, 3], numbers[:, :3])
    np.testing.assert_allclose(pose(pose_vector(T)), T, atol=1e-12)
    assert pose(numbers[0]).shape == (4, 4)
    assert pose_vector(T.reshape(50, 10, 4, 4)).shape == (50, 10, 6)
    for wrong in ([0] * 5, [0, 0, 0, 0, 0, np.nan], "0,0,0,0,0,0", [[0] * 7]):
        with pytest.raises(InputError):
            pose(wrong)
    for wrong in (np.eye(3), T.reshape(-1, 2, 8), np.zeros(16)):
        with pytest.raises(InputError, match="shape"):
            pose_vector(wrong)
    with pytest.raises(InputError, match="rotation"):
        pose_vector(np.diag([2.0, 1.0, 1.0, 1.0]))


@pytest.mark.parametrize("calibrated", [False, True])
def test_the_controllers_poses_come_back(calibrated):
    """Joint angles and poses that the pendant of a UR5e showed; it rounds to 0.01 degrees and 0.01 mm."""
    with (DATA / "controller_poses_ur5e.csv").open(encoding="utf-8") as file:
        rows = np.array([[float(cell) for cell in row] for row in list(csv.reader(file))[1:]])
    expected = pose(np.hstack([rows[:, 6:9] / 1000, rows[:, 9:]]))
    if calibrated:
        kin = URKinematics.from_calibration(DATA / "controller_calibration_ur5e.conf", model="ur5e", base="base")
    else:
        kin = URKinematics("ur5e", base="base")
    found = kin.fk(np.radians(rows[:, :6]))
    miss = np.linalg.norm(found[:, :3, 3] - expected[:, :3, 3], axis=1)
    assert len(miss) == 18
    assert miss.max() < (1e-4 if calibrated else 2e-3)
    assert calibrated or np.median(miss) > 5e-4  # what the calibration is for


@pytest.mark.parametrize(
    ("model", "tool"), [(model, TOOLS[index % len(TOOLS)]) for index, model in enumerate(sorted(UR_LENGTHS))]
)
def test_every_posture_with_any_tool(model, tool):
    rng, found = np.random.default_rng(1), 0
    bare = URKinematics(model)
    kin = URKinematics(model, tool=tool, base="base")
    assert type(kin) is URKinematics
    assert type(ArmKinematics.of(model, tool=tool)) is URKinematics
    flip = np.diag([-1.0, -1.0, 1.0, 1.0])  # base is base_link turned by pi about z, REP 199
    for q in rng.uniform(bare.lower * 0.9, bare.upper * 0.9, (10, 6)):
        T = kin.fk(q)
        np.testing.assert_allclose(T, flip @ bare.fk(q) @ pose(tool), atol=1e-12)
        solutions = kin.all_solutions(T, seed=q)
        assert len(solutions) == len(bare.all_solutions(bare.fk(q), seed=q))
        assert np.abs(solutions.q - q).max(axis=1).min() < 1e-6
        np.testing.assert_allclose(kin.fk(solutions.q), np.broadcast_to(T, (len(solutions), 4, 4)), atol=1e-7)
        found += len(solutions)
    assert found >= 40


@pytest.mark.slow
def test_a_calibrated_arm_with_a_tool_in_a_frame_of_ones_own():
    mount = [0.4, -0.2, 0.1, 0.0, 0.0, 0.7]
    checked = 0
    for name, file in PUBLISHED_CALIBRATIONS.items():
        model = name.partition("_")[0]
        kin = URKinematics.from_calibration(file, model=model, tool=TOOLS[1], base=mount)
        assert type(kin) is CalibratedURKinematics
        assert kin.tip == "tool"
        assert kin.base == "own"
        bare = URKinematics.from_calibration(file, model=model)
        for q in np.random.default_rng(2).uniform(-2.5, 2.5, (3, 6)):
            np.testing.assert_allclose(kin.fk(q), np.linalg.inv(pose(mount)) @ bare.fk(q) @ pose(TOOLS[1]), atol=1e-12)
            assert np.abs(kin.all_solutions(kin.fk(q), seed=q).q - q).max(axis=1).min() < 1e-6
            checked += 1
    assert checked >= 24


def test_a_turned_tip_keeps_the_closed_form(tmp_path):
    """Without a link tool0, too."""
    robot = ET.fromstring(get_arm("ur10e").urdf)
    for joint in robot.findall("joint"):
        if joint.get("name") == "tool0_joint":
            joint.find("origin").set("rpy", "0.3 0.2 0.9")
            joint.find("origin").set("xyz", "0.01 0.11 0.02")
    text = ET.tostring(robot, encoding="unicode").replace('"tool0"', '"nozzle"')
    (tmp_path / "arm.urdf").write_text(text)
    kin = ArmKinematics.from_urdf(tmp_path / "arm.urdf", tip="nozzle")
    assert type(kin) is URKinematics
    assert "tool0" not in kin.arm.tips
    for q in np.random.default_rng(3).uniform(-3, 3, (50, 6)):
        assert np.abs(kin.all_solutions(kin.fk(q), seed=q).q - q).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("name", ["ur3e_a", "ur5e_a", "ur10e_a"])
def test_a_calibrated_urdf_with_a_turned_tip(name, tmp_path):
    robot = ET.fromstring(get_arm(name.partition("_")[0]).calibrated(PUBLISHED_CALIBRATIONS[name]).urdf)
    for joint in robot.findall("joint"):
        if joint.get("name") == "tool0_joint":
            joint.find("origin").set("rpy", "0.3 0.2 0.9")
    (tmp_path / "arm.urdf").write_text(ET.tostring(robot, encoding="unicode").replace('"tool0"', '"nozzle"'))
    kin = ArmKinematics.from_urdf(tmp_path / "arm.urdf", tip="nozzle")
    assert type(kin) is CalibratedURKinematics
    for q in np.random.default_rng(3).uniform(-2.5, 2.5, (10, 6)):
        assert np.abs(kin.all_solutions(kin.fk(q), seed=q).q - q).max(axis=1).min() < 1e-6


@pytest.mark.slow
def test_a_tool_of_any_arm_collides_and_has_a_mass():
    for name in arm_names():
        arm = get_arm(name).with_tool(Tool.tube([0.02, 0, 0.25, 0, 0.3, 0], 0.04, mass=1.5))
        kin = ArmKinematics.of(arm)
        assert kin.tip == "tool"
        assert not isinstance(arm.gripper, Gripper)
        total = sum(inertia.mass for inertia in kin.model.inertias)
        assert total == pytest.approx(sum(i.mass for i in ArmKinematics.of(get_arm(name)).model.inertias), abs=1.6)
        pairs = [pair for pair in CollisionChecker(kin).pairs if "tool_body" in pair]
        assert len(pairs) >= 2
    bare = ArmKinematics.of("ur5e").model.inertias
    held = ArmKinematics.of("ur5e", tool=Tool([0, 0, 0.1, 0, 0, 0], 2.0, (0, 0, 0.05))).model.inertias
    assert sum(i.mass for i in held) == pytest.approx(sum(i.mass for i in bare) + 2.0)
    assert len(arm_names()) >= 16


def test_the_thesis_s_gripper_on_another_arm():
    """It is where the UR10 has it, and collides as it does."""
    arms = [get_arm("ur10-thesis"), get_arm("ur10-thesis").with_tool("gripper")]
    own, named = (ArmKinematics.of(arm, base="world") for arm in arms)
    q = np.random.default_rng(0).uniform(-3, 3, (500, 6))
    np.testing.assert_allclose(named.fk(q), own.fk(q), atol=1e-9)
    masses = [sum(inertia.mass for inertia in kin.model.inertias) for kin in (own, named)]
    assert masses[0] == pytest.approx(masses[1])
    verdicts = [CollisionChecker(arm, obstacles=()).impossible(q) for arm in arms]
    assert (verdicts[0] != verdicts[1]).mean() < 0.03
    assert "gripper" not in ArmKinematics.of("ur5e").arm.urdf
    with pytest.raises(UnknownNameError, match="unknown tool 'hook'; available: gripper"):
        URKinematics("ur5e", tool="hook")


def test_the_gripper_makes_room():
    arm = get_arm("ur5-thesis").with_tool([0, 0, 0.1, 0, 0, 0])
    assert ArmSimulation(arm).contacts() == ()  # without a body of the tool
    assert "gripper_palm" not in arm.urdf
    assert "tcp" not in arm.tips
    assert arm.default_tip == "tool"
    assert "gripper_palm" in get_arm("ur5-thesis").urdf


@pytest.mark.parametrize("calibrated", [False, True])
def test_a_point_and_a_direction_with_a_turned_tool(calibrated):
    """wrist_3 does not turn such a tool about its z axis: the turns about it are 36, each posture is exact."""
    if calibrated:
        kin = URKinematics.from_calibration(PUBLISHED_CALIBRATIONS["ur5_a"], model="ur5", tool=TOOLS[1])
    else:
        kin = URKinematics("ur5e", tool=TOOLS[1])
    rng, found = np.random.default_rng(5), 0
    for q in rng.uniform(-2.5, 2.5, (5, 6)):
        T = kin.fk(q)
        solutions = kin.axis_solutions(T[:3, 3], T[:3, 2], seed=q)
        ends = kin.fk(solutions.q)
        np.testing.assert_allclose(ends[:, :3, 3] - T[:3, 3], 0.0, atol=1e-7)
        np.testing.assert_allclose(ends[:, :3, 2] - T[:3, 2], 0.0, atol=1e-7)
        nearest = kin.axis_goal(T[:3, 3], T[:3, 2], q)
        assert nearest.success
        assert np.abs(nearest.q - q).max() < 0.6  # 5 degrees of the tool at most
        refused = kin.axis_goal(T[:3, 3], T[:3, 2], q, accept=lambda posture: False)
        assert not refused.success
        found += len(solutions)
    assert found > 300


@pytest.mark.parametrize("calibrated", [False, True])
def test_without_a_seed_wrist_3_is_at_0_or_at_the_limit_next_to_it(calibrated):
    arm = get_arm("ur5e").with_limits({"wrist_3_joint": (0.5, 2.0)})
    arm = arm.calibrated(PUBLISHED_CALIBRATIONS["ur5e_a"], model="ur5e") if calibrated else arm
    kin, found = (CalibratedURKinematics if calibrated else URKinematics)(arm), 0
    for q in np.random.default_rng(8).uniform(-2.5, 2.5, (5, 6)):
        p, axis = kin.fk(q)[:3, 3], kin.fk(q)[:3, 2]
        for options, angle in (({}, 0.5), ({"limits": True}, 0.5), ({"limits": False}, 0.0), ({"seed": q}, None)):
            solutions = kin.axis_solutions(p, axis, **options)
            assert (solutions.q[:, 5] == (np.clip(q[5], 0.5, 2.0) if angle is None else angle)).all()
            assert solutions.residual.max() < 1e-7
            found += len(solutions)
    assert found > 100


@pytest.mark.parametrize("name", ["ur5e", "ur5", *slow("panda")])
def test_a_tool_with_a_mesh(name, tmp_path):
    """In millimetres; beside meshes of the arm, which are in another folder."""
    trimesh.creation.cylinder(30.0, 160.0).apply_translation([0, 0, 80.0]).export(tmp_path / "tool.stl")
    tool = Tool([0, 0, 0.16, 0, 0, 0], 1.0, mesh=tmp_path / "tool.stl", mesh_scale=0.001)
    drawn = ArmKinematics.of(name, tool=tool)
    tube = ArmKinematics.of(name, tool=Tool.tube([0, 0, 0.16, 0, 0, 0], 0.03))
    checkers = [CollisionChecker(kin, obstacles=()) for kin in (drawn, tube)]
    q = np.random.default_rng(0).uniform(drawn.lower, drawn.upper, (400, drawn.n))
    verdicts = [checker.impossible(q) for checker in checkers]
    assert (verdicts[0] != verdicts[1]).mean() < 0.02
    assert len({shape.link for shape in link_shapes(drawn.arm)}) >= 7
    ArmSimulation(drawn.arm).reset()
    with pytest.raises(InputError, match=r"reaches 160 m away; millimetres need mesh_scale=0\.001"):
        ArmKinematics.of(name, tool=Tool([0, 0, 0.16, 0, 0, 0], mesh=tmp_path / "tool.stl"))
    with pytest.raises(InputError, match=r"missing\.stl"):
        ArmKinematics.of(name, tool=Tool([0, 0, 0.16, 0, 0, 0], mesh=tmp_path / "missing.stl"))


def test_bad_input():
    for tool, message in (
        ([0, 0, 150, 0, 0, 0], "tool must be within 5 m, got 150; lengths are metres, not millimetres"),
        ([0, 0, 0.15], "six|rx"),
        (2 * np.eye(4), "last row"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "rotation"),
        ([0, 0, np.inf, 0, 0, 0], "finite"),
    ):
        with pytest.raises(InputError, match=message):
            URKinematics("ur5e", tool=tool)
    with pytest.raises(InputError, match="a tip or a tool"):
        URKinematics("ur5e", tip="tcp", tool=TOOLS[0])
    with pytest.raises(UnknownNameError, match="base, base_link, world"):
        URKinematics("ur5e", base="table")
    with pytest.raises(UnknownNameError, match="'base'; available: base_link, world"):
        ArmKinematics.of("panda", base="base")
    with pytest.raises(InputError, match="mass"):
        Tool(TOOLS[0], -1.0)
    with pytest.raises(InputError, match="mesh of the tool cannot be a path, got 5"):
        Tool(TOOLS[0], mesh=5)
    for scale in (0.0, -1.0, 1001.0):
        with pytest.raises(InputError, match="mesh_scale of the tool"):
            Tool(TOOLS[0], mesh_scale=scale)
    with pytest.raises(InputError, match="centre_of_mass of the tool"):
        Tool(TOOLS[0], 1.0, (0, 0, 6.0))
    for shape, message in (
        ("box", "radius, length"),
        (((), (0, 0, 0)), "radius, length"),
        (((0.1, -0.1), (0, 0, 0)), "size of a shape"),
        (((0.1, 0.1), (0, 0)), "shape \\(3,\\)"),
        (((0.1, 0.1, 100), (0, 0, 0)), "size of a shape"),
    ):
        with pytest.raises(InputError, match=message):
            Tool(TOOLS[0], shapes=(shape,))
    with pytest.raises(InputError, match="1 mm apart"):
        Tool.tube([0, 0, 0, 1, 0, 0], 0.05)
    with pytest.raises(InputError, match="already"):
        get_arm("ur5e").with_tool(Tool(TOOLS[0], shapes=[((0.1, 0.1, 0.1), (0, 0, 0))])).with_tool(TOOLS[0])
    assert isinstance(ArmKinematics.of("ur5e", tool=TOOLS[0]), URKinematics)
    assert not isinstance(ArmKinematics.of("ur5e", tool=TOOLS[0]), SixAxisKinematics)


def test_shapes_are_tuples_and_a_printed_tool_is_python():
    box, tube = ((0.1, 0.1, 0.2), (0.0, 0.0, 0.1)), ((0.03, 0.1), (0.0, 0.0, 0.05), (0.0, 1.57, 0.0))
    tool = Tool(TOOLS[0], 0.5, shapes=[box, tube])
    upright = (0.0, 0.0, 0.0)
    assert eval(repr(tool.shapes)) == ((*box, upright), tube)
    assert get_arm("ur5e").with_tool(eval(repr(tool))).urdf == get_arm("ur5e").with_tool(tool).urdf
