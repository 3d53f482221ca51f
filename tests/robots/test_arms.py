"""The UR family from one table, and what an arm description fills in by itself."""

from __future__ import annotations

import copy
import pickle
import re
from dataclasses import fields, replace
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from kinreach.errors import InputError, InstallationError, UnknownNameError
from kinreach.kinematics import ArmKinematics, CollisionChecker, URKinematics
from kinreach.robots import (
    PUBLISHED_CALIBRATIONS,
    ArmDescription,
    BoxRegion,
    CameraMount,
    Tool,
    Workcell,
    arm_names,
    get_arm,
    register_arm,
)
from kinreach.robots.inside import ArmFlags
from kinreach.sim import ArmSimulation
from kinreach.thesis import posture_error
from kinreach.vision import RGBDCamera

FAMILY = ("ur3-thesis", "ur5-thesis", "ur10-thesis")
HALF_PICTURE = np.tan(np.deg2rad(29.0))


def arm_named(text, **flags):
    return ArmFlags(**flags).arm(text)


def test_an_arm_is_named_as_a_file_or_in_a_module_too(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "my_arms.py").write_text("from kinreach.robots import get_arm\nARM = get_arm('arm3')\n")
    assert arm_named("ur5") is get_arm("ur5")
    assert arm_named("my_arms:ARM") is get_arm("arm3")
    for name in ("mine.urdf", "MINE.URDF", "a:b.Xml"):
        (tmp_path / name).write_text(get_arm("arm3").urdf)
        assert arm_named(str(tmp_path / name)).joints == get_arm("arm3").joints
    assert arm_named(str(tmp_path / "mine.urdf"), tip="link_3").default_tip == "link_3"
    for name, said in (
        ("ur6", "unknown arm 'ur6'"),
        ("nowhere.urdf", "nowhere.urdf"),
        ("my_arms:NONE", "cannot import the arm"),
        ("kinreach.robots:get_arm", "kinreach.robots:get_arm is not an ArmDescription"),
    ):
        with pytest.raises(InputError, match=said):
            arm_named(name)


@pytest.mark.parametrize(
    ("endings", "said"),
    [
        (".sdf .world", "SDF"),
        (".usd .usda .usdc .usdz", "USD, which is not read"),
        (".stl .obj .dae .step .stp .glb .gltf .iges .STL", "a shape, and no arm"),
        (".yaml .yml .conf", "a calibration or settings"),
        (".srdf", "an SRDF"),
        (".py", "a program: name the object in it"),
        (".zip .gz .tar .tgz .7z", "an archive: unpack it"),
        (".urp .script .urscript", "a program of a UR"),
        (".json .csv .txt .md .png .pdf", "no description of an arm"),
    ],
)
def test_other_files_that_people_have_are_called_what_they_are(endings, said):
    for ending in endings.split():
        with pytest.raises(
            InputError, match=rf"'robot{re.escape(ending)}' is .*{said}.*; an arm is a URDF or MJCF file"
        ):
            arm_named(f"robot{ending}")


def test_missing_descriptions_are_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(
        InstallationError, match=r"descriptions of the arms are missing; install them with: pip install"
    ):
        get_arm("ur5").package_root()


def tool_down(position, turn):
    c, s = np.cos(turn), np.sin(turn)
    T = np.array([[c, s, 0, 0], [s, -c, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1.0]])
    T[:3, 3] = position
    return T


@pytest.mark.parametrize("name", FAMILY)
def test_both_natural_postures_reach_every_goal_without_a_collision(name):
    kin, checker = URKinematics(name, tip="tcp", base="world"), CollisionChecker(name)
    region = kin.arm.workcell.goals
    corners = [(x, y, region.z[0]) for x in region.x for y in region.y]
    goals = [*corners, *kin.arm.workcell.draw_goals(np.random.default_rng(0), 60)]
    assert checker.free(kin.arm.home)
    covered = 0
    for goal in goals:
        for turn in np.linspace(-3.0, 3.0, 5):
            natural = [q for q in kin.all_solutions(tool_down(goal, turn)).q if posture_error(q) < 1e-6]
            assert {q[0] < 0 for q in natural} == {True, False}
            assert all(checker.free(q) for q in natural)
            covered += len(natural)
    assert covered == 2 * 5 * len(goals)


@pytest.mark.parametrize("name", FAMILY)
def test_both_cameras_see_every_goal_from_home(name):
    arm, simulation = get_arm(name), ArmSimulation(name)
    goals = arm.workcell.draw_goals(np.random.default_rng(1), 500)
    for T in (RGBDCamera(simulation, camera).T_world_camera for camera in ("front", "wrist")):
        x, y, z = ((goals - T[:3, 3]) @ T[:3, :3]).T
        assert (z > 0.1).all()
        assert (np.abs(y / z) < 0.9 * HALF_PICTURE).all()
        assert (np.abs(x / z) < 0.9 * HALF_PICTURE * 16 / 9).all()


def bare(name="arm3", **facts):
    """An arm of which only the URDF is known."""
    known = get_arm(name)
    return ArmDescription("bare", "a bare arm", known.build_urdf, package_root=known.package_root, **facts)


def test_a_description_reads_what_is_left_empty_from_the_urdf():
    arm, known = bare(), get_arm("arm3")
    assert (arm.joints, arm.base, dict(arm.tips)) == (
        known.joints,
        "base_link",
        {"end_effector": "end_effector", "link_3": "link_3"},
    )
    assert arm.default_tip == "end_effector"
    assert arm.home == (0.0, 0.0, 0.0)
    assert arm.workcell == Workcell()
    assert [camera.name for camera in arm.cameras] == ["overview"]
    assert 0 < arm.speed_limit <= 3.0
    assert 0 < arm.acceleration_limit <= 10.0
    assert len(arm.joint_damping) == 3
    ratio = np.array(arm.position_gains) / known.position_gains
    assert (ratio > 0.3).all()
    assert (ratio < 3.0).all()


def test_gripper_joints_are_no_part_of_the_posture():
    arm = bare("ur5-thesis", gripper=get_arm("ur5-thesis").gripper)
    assert arm.joints == get_arm("ur5-thesis").joints
    assert arm.default_tip == "tcp"
    q = np.random.default_rng(0).uniform(-3, 3, (20, 6))
    np.testing.assert_allclose(
        ArmKinematics(arm, tip="tool0").fk(q), ArmKinematics("ur5-thesis", tip="tool0").fk(q), atol=1e-12
    )


def test_derived_pairs_leave_the_home_posture_free_and_keep_real_collisions():
    folded = [0.0, -np.pi / 2, 3.0, -np.pi / 2, -np.pi / 2, 0.0]
    arm = bare("ur5-thesis", gripper=get_arm("ur5-thesis").gripper, home=get_arm("ur5-thesis").home)
    checker = CollisionChecker(arm)
    assert checker.free(arm.home)
    assert checker.in_collision(folded)


def test_numbers_may_be_arrays():
    arm = bare(home=np.zeros(3), position_gains=np.full(3, 100.0))
    assert (arm.home, arm.position_gains) == ((0.0, 0.0, 0.0), (100.0, 100.0, 100.0))


def test_descriptions_can_be_pickled():
    for name in ("arm3", *FAMILY):
        again = pickle.loads(pickle.dumps(get_arm(name)))
        assert again.urdf == get_arm(name).urdf
    arm = bare()
    for build in (arm.build_urdf, lambda: arm.build_urdf(), partial(copy.deepcopy, arm.robot)):  # whatever makes it
        again = pickle.loads(pickle.dumps(replace(arm, build_urdf=build)))
        assert again.urdf == arm.urdf


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"joints": ("elbow",)}, "unknown joint"),
        ({"joints": ("link_2_joint", "link_1_joint")}, "in this order"),
        ({"tips": {"tip": "nowhere"}}, "unknown link"),
        ({"tips": {"base": "base_link"}}, "no joint moves the tip"),
        ({"home": (0.0, 0.0)}, "home must have 3 numbers"),
        ({"home": "abc"}, "home must be an array of numbers"),
        ({"moves_last": ("elbow",)}, "unknown joint.*moves_last"),
        ({"position_gains": (1.0,)}, "position_gains must have 3"),
    ],
)
def test_what_cannot_be_read_is_named(facts, said):
    with pytest.raises(InputError, match=said):
        bare(**facts)


CAMERA = CameraMount("palm", "gripper_palm", (0.0, 0.0, 0.1), (0.0, 0.1, 0.5))
OWN = replace(
    get_arm("ur5-thesis"),
    cameras=(*get_arm("ur5-thesis").cameras, CAMERA),
    notes=("a",),
    armature=0.3,
    meshes="triangles",
)
BARE = replace(get_arm("ur5e"), notes=("a",), armature=0.3, meshes="triangles", moves_last=("elbow_joint",))
TOOL, FILE = Tool.tube([0, 0, 0.1, 0, 0, 0], 0.03, mass=1.0), PUBLISHED_CALIBRATIONS["ur5e_a"]


@pytest.mark.parametrize(
    ("arm", "change", "new"),
    [
        (OWN, lambda arm: arm.with_tool(TOOL), {
            "name": "ur5-thesis_tool", "title": "UR5 with tool", "tips": {"tool0": "tool0", "tool": "tool"},
            "default_tip": "tool", "gripper": None, "cameras": OWN.cameras[:3],
            "disabled_collisions": (*OWN.disabled_collisions[:10], ("wrist_2_link", "tool_body")),
        }),
        (OWN, lambda arm: arm.with_tool([0, 0, 0.1, 0, 0, 0]), {
            "name": "ur5-thesis_tool", "title": "UR5 with tool", "tips": {"tool0": "tool0", "tool": "tool"},
            "default_tip": "tool", "gripper": None, "cameras": OWN.cameras[:3],
            "disabled_collisions": OWN.disabled_collisions[:10],
        }),
        (BARE, lambda arm: arm.with_tool(TOOL), {
            "name": "ur5e_tool", "title": "UR5E with tool", "tips": {"tool0": "tool0", "tcp": "tcp", "tool": "tool"},
            "default_tip": "tool",
        }),
        (BARE, lambda arm: arm.with_gripper(), {
            "title": "UR5E with parallel gripper", "default_tip": "tcp", "gripper": OWN.gripper
        }),
        (BARE, lambda arm: arm.calibrated(FILE), {
            "name": "ur5e_calibrated", "title": "UR5E, calibrated by ur5e_a.yaml"
        }),
        (OWN, lambda arm: arm.with_limits({"elbow_joint": (-1.0, 1.0)}), {
            "home": (*OWN.home[:2], 1.0, *OWN.home[3:])
        }),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_a_changed_arm_keeps_everything_else(arm, change, new):
    changed = change(arm)
    for field in fields(arm):
        value = getattr(changed, field.name)
        if field.name not in ("build_urdf", "package_root"):
            assert value == new.get(field.name, getattr(arm, field.name)), field.name
    assert changed.package_root() == arm.package_root()
    assert changed.urdf != arm.urdf
    assert pickle.loads(pickle.dumps(changed)).urdf == changed.urdf


@pytest.mark.parametrize("name", FAMILY)
def test_the_thesis_arm_stands_on_a_plate_behind_its_table(name):
    """The plate is as wide as the arm's foot and little more, and lies on a pedestal that stands on the floor."""
    boxes = {box.name: box for box in get_arm(name).workcell.obstacles}
    low, high = ({key: np.subtract(box.position, side * np.array(box.size) / 2) for key, box in boxes.items()}
                 for side in (1, -1))  # fmt: skip
    foot = get_arm(name.split("-")[0]).robot.find("link[@name='base_link']/collision/geometry/cylinder")
    radius = float(foot.get("radius"))
    assert high["mount"][2] == pytest.approx(0.0, abs=1e-12)
    assert (low["mount"][:2] < -radius).all()
    assert (high["mount"][:2] > radius).all()
    assert 2 * radius < boxes["mount"].size[1] < 2.6 * radius
    assert 3 * radius < boxes["mount"].size[0] < 4.2 * radius
    assert 0.0 < boxes["mount"].size[2] <= 0.02 < low["table"][0] - high["mount"][0]
    assert high["pedestal"][2] == pytest.approx(low["mount"][2], abs=1e-12)
    assert low["pedestal"][2] == pytest.approx(high["floor"][2], abs=1e-12)
    for axis in (0, 1):
        assert low["mount"][axis] - 1e-3 <= low["pedestal"][axis] < high["pedestal"][axis] <= high["mount"][axis] + 1e-3


#: Those of kinreach, without any that a test has registered.
OWN = [name for name in arm_names() if name.startswith(("ur", "panda", "so101", "arm3"))]


def test_tables_stand_on_the_floor_and_goals_on_them():
    """Legs end on the upper side of the floor, and goals that are balls lie at least their radius above the table."""
    stood, above = 0, 0
    for name in OWN:
        cell = get_arm(name).workcell
        boxes = {box.name: box for box in cell.obstacles}
        if not {"table", "floor"} <= set(boxes):
            continue
        table, floor = boxes["table"], boxes["floor"]
        ground, top = (box.position[2] + box.size[2] / 2 for box in (floor, table))
        bottom = top - table.size[2]
        assert bottom - table.legs == pytest.approx(ground, abs=1e-12)
        assert ground < bottom - 0.1
        assert all(floor.size[i] > table.size[i] + 2 * abs(table.position[i]) for i in (0, 1))
        stood += 1
        if isinstance(cell.goals, BoxRegion):
            assert cell.goals.z[0] >= top + cell.ball_radius - 1e-12
            for axis, ends in enumerate((cell.goals.x, cell.goals.y)):
                assert np.abs(np.subtract(ends, table.position[axis])).max() < table.size[axis] / 2
            above += 1
    assert stood >= 10
    assert above >= 10


def test_the_overview_shows_the_arm_and_its_goals():
    """The base, the tip at home and all goals are in the picture, and fill some of it; the thesis's are alike."""
    seen, corners = 0, []
    for name in OWN:
        kin = ArmKinematics.of(name, base="world")
        (camera,) = (mount for mount in kin.arm.cameras if mount.name == "overview")
        sight = np.subtract(camera.target, camera.position)
        right = np.cross(sight, camera.up)
        down = np.cross(sight, right)
        axes = np.array([each / np.linalg.norm(each) for each in (right, down, sight)])
        goals = kin.arm.workcell.draw_goals(np.random.default_rng(0), 200)
        x, y, z = axes @ (np.vstack([goals, kin.fk(kin.arm.home)[:3, 3], np.zeros(3)]) - camera.position).T
        assert (z > 0.2).all()
        half = np.tan(np.radians(camera.fovy / 2))
        assert np.abs(y / z).max() < 0.95 * half
        assert 0.35 * half < np.abs(x / z).max() < 0.7 * half * 16 / 9
        seen += 1
        if name in FAMILY:
            region = kin.arm.workcell.goals
            ends = [(x, y, region.z[0]) for x in region.x for y in region.y]
            x, y, z = axes @ np.subtract(ends, camera.position).T
            corners.append(np.array([x / z, y / z]) / half)
    assert seen >= 18
    assert len(corners) == 3
    assert np.ptp(corners, axis=0).max() < 0.15


def test_no_arm_moves_faster_than_its_slowest_joint():
    """Of the file, or 3 rad/s where no joint is slower."""
    compared = 0
    for name in OWN:
        arm = get_arm(name)
        slowest = min(float(joint.find("limit").get("velocity")) for joint in arm.robot.iterfind("joint")
                      if joint.get("name") in arm.joints)  # fmt: skip
        assert min(3.0, 0.99 * slowest) <= arm.speed_limit <= slowest
        assert 5.0 < arm.acceleration_limit <= 10.0
        assert len(arm.position_gains) == len(arm.joints)
        assert (np.diff(arm.position_gains) < 0.2 * arm.position_gains[0]).all()  # later joints carry less
        compared += 1
    assert compared >= 18


def vector(text):
    return np.array(text.split(), dtype=float)


#: Joints of `so101_new_calib.urdf`: place in the one before [m, rad], limits [rad], and of the link that each moves the
#: mass [kg] and its centre [m].
SO101 = {
    "shoulder_pan": ("0.0388353 -8.97657e-09 0.0624", "3.14159 0 -3.14159", (-1.91986, 1.91986), 0.100006,
                     (-0.0307604, -1.66727e-05, -0.0252713)),
    "shoulder_lift": ("-0.0303992 -0.0182778 -0.0542", "-1.5708 -1.5708 0", (-1.74533, 1.74533), 0.103,
                      (-0.0898471, -0.00838224, 0.0184089)),
    "elbow_flex": ("-0.11257 -0.028 0", "0 0 1.5708", (-1.69, 1.69), 0.104, (-0.0980701, 0.00324376, 0.0182831)),
    "wrist_flex": ("-0.1349 0.0052 0", "0 0 -1.5708", (-1.65806, 1.65806), 0.079,
                   (-0.000103312, -0.0386143, 0.0281156)),
    "wrist_roll": ("0 -0.0611 0.0181", "1.5708 0.0486795 3.14159", (-2.74385, 2.84121), 0.087,
                   (0.000213627, 0.000245138, -0.025187)),
    "gripper": ("0.0202 0.0188 -0.0234", "1.5708 0 0", (-0.174533, 1.74533), 0.012,
                (-0.00157495, -0.0300244, 0.0192755)),
}  # fmt: skip


def test_an_so101_is_that_of_its_maker():
    """Poses are those of the maker's file, as Pinocchio has them; servos are as strong and fast as is said of them."""
    arm = get_arm("so101")
    text = '<robot name="so101"><link name="gripper_frame_link"/><link name="base_link"/>'
    before = "base_link"
    for joint, (xyz, rpy, _, _, _) in list(SO101.items())[:5]:
        text += f'<link name="{joint}_link"/><joint name="{joint}" type="revolute"><parent link="{before}"/><child '
        text += f'link="{joint}_link"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
        text += '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        before = f"{joint}_link"
    text += f'<joint name="end" type="fixed"><parent link="{before}"/><child link="gripper_frame_link"/>'
    model = pin.buildModelFromXML(
        f'{text}<origin xyz="-0.0079 -0.000218121 -0.0981274" rpy="0 3.14159 0"/></joint></robot>'
    )
    data, frame, kin = model.createData(), model.getFrameId("gripper_frame_link"), ArmKinematics(arm, base="base_link")
    for q in np.random.default_rng(0).uniform(-1.6, 1.6, (50, 5)):
        pin.framesForwardKinematics(model, data, q)
        np.testing.assert_allclose(kin.fk(q), data.oMf[frame].homogeneous, atol=2e-5)
    joints = {joint.get("name"): joint for joint in arm.robot.iterfind("joint")}
    links = {link.get("name"): link for link in arm.robot.iterfind("link")}
    for name, (xyz, _, limits, mass, centre) in SO101.items():
        limit = {key: float(value) for key, value in joints[name].find("limit").attrib.items()}
        np.testing.assert_allclose((limit["lower"], limit["upper"]), limits, atol=1.1e-6)
        assert limit["effort"] == pytest.approx(19.5 * 9.80665e-2, rel=0.01)
        assert limit["velocity"] == pytest.approx(np.radians(60) / 0.222, rel=0.01)
        np.testing.assert_allclose(vector(joints[name].find("origin").get("xyz")),
                                   vector(xyz), atol=1e-8)  # fmt: skip
        link = links[joints[name].find("child").get("link")]
        assert float(link.find("inertial/mass").get("value")) == pytest.approx(mass, abs=1e-5)
        body = link.find("collision")
        place, turned, size = (vector(body.find(path).get(key)) for path, key in (
            ("origin", "xyz"), ("origin", "rpy"), ("geometry/box", "size")))  # fmt: skip
        inside = Rotation.from_euler("xyz", turned).inv().apply(np.subtract(centre, place))
        assert (np.abs(inside) < size / 2).all()  # the centre of mass of its parts is in it
        assert 400 < mass / size.prod() < 1500  # servos and plastic
    assert (arm.speed_limit, arm.acceleration_limit) == (3.0, 10.0)
    assert arm.armature == pytest.approx(2e-7 * 345**2, rel=0.02)


def test_the_gripper_as_a_tool_is_that_of_the_thesis():
    """On an arm that carries none: its tip, its boxes as they are when the arm reaches, and its mass."""
    tooled, own = get_arm("ur5").with_tool("gripper"), get_arm("ur5-thesis")
    q = np.random.default_rng(0).uniform(-3, 3, (5, 6))
    ends = [[np.linalg.inv(ArmKinematics(arm, tip="tool0").fk(row)) @ ArmKinematics(arm, tip=tip).fk(row) for row in q]
            for arm, tip in ((tooled, "tool"), (own, "tcp"))]  # fmt: skip
    np.testing.assert_allclose(*ends, atol=1e-9)
    links = {link.get("name"): link for link in (*own.robot.iterfind("link"), *tooled.robot.iterfind("link"))}

    def boxes(link, y=0.0):
        return [(vector(each.find("geometry/box").get("size")),
                 np.add(vector(each.find("origin").get("xyz")), (0.0, y, 0.0)))
                for each in links[link].iterfind("collision")]  # fmt: skip

    half = own.gripper.opening / 2
    expected = [*boxes("gripper_palm"), *boxes("finger_left", half), *boxes("finger_right", -half)]
    np.testing.assert_allclose(boxes("tool_body"), expected, atol=1e-9)
    masses = {name: float(links[name].find("inertial/mass").get("value"))
              for name in ("gripper_palm", "finger_left", "finger_right", "tool_body")}  # fmt: skip
    whole = masses.pop("tool_body")
    assert whole == pytest.approx(sum(masses.values()))
    middles = {"gripper_palm": boxes("gripper_palm")[0][1], "finger_left": boxes("finger_left", half)[0][1],
               "finger_right": boxes("finger_right", -half)[0][1]}  # fmt: skip
    centre = sum(mass * middles[name] for name, mass in masses.items()) / whole
    found = vector(links["tool_body"].find("inertial/origin").get("xyz"))
    np.testing.assert_allclose(found, centre, atol=3e-3)


def test_a_cell_without_goals_says_so():
    with pytest.raises(InputError, match="no goals"):
        bare().workcell.draw_goals(np.random.default_rng(0), 1)
    assert replace(get_arm("ur5-thesis"), name="other").home == get_arm("ur5-thesis").home


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"speed_limit": -1.0}, "speed_limit of arm 'ur5-thesis' must be finite and above 0"),
        ({"speed_limit": "fast"}, "speed_limit of arm 'ur5-thesis' must be a number"),
        ({"acceleration_limit": -1.0}, "acceleration_limit .* above 0"),
        ({"acceleration_limit": np.inf}, "acceleration_limit .* finite"),
        ({"position_gains": (-1.0,) * 6}, "position_gains .* above 0"),
        ({"joint_damping": (-1.0,) * 6}, "joint_damping .* at least 0"),
        ({"armature": -1.0}, "armature .* at least 0"),
        ({"home": (np.nan,) * 6}, "home of arm 'ur5-thesis' must be finite"),
        ({"name": 5}, "name of an arm must be text"),
        ({"workcell": "table"}, "workcell of an arm must be a Workcell"),
        ({"gripper": "jaw"}, "gripper of an arm must be a Gripper or None"),
        ({"build_urdf": "<robot/>"}, "build_urdf of an arm must be a function"),
        ({"cameras": ("front",)}, "cameras of arm 'ur5-thesis' must be CameraMounts"),
    ],
)
def test_what_no_arm_can_have_is_refused_at_once(facts, said):
    with pytest.raises(InputError, match=said):
        replace(get_arm("ur5-thesis"), **facts)


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"home": (0.0, 0.0, 9.0, 0.0, 0.0, 0.0)}, "home has joint 'elbow_joint' at 9 rad, outside its limits"),
        ({"cameras": (CameraMount("front", "nolink", (0, 0, 0), (1, 0, 0)),)}, "unknown link of camera 'front'"),
    ],
)
def test_what_does_not_fit_the_urdf_is_refused_when_it_is_read(facts, said):
    arm = replace(get_arm("ur5-thesis"), **facts)
    for make in (lambda: arm.urdf, lambda: ArmKinematics(arm), lambda: ArmSimulation(arm)):
        with pytest.raises(InputError, match=said):
            make()
    with pytest.raises(InputError, match=said):
        bare("ur5-thesis", gripper=get_arm("ur5-thesis").gripper, **facts)


REGISTERED = """
from dataclasses import replace
from kinreach.robots import arm_names, get_arm, register_arm
mine = replace(get_arm("ur5-thesis"), name="my-arm")
assert register_arm(mine) is register_arm(mine) is mine
assert get_arm("My-Arm") is mine
assert "my-arm" in arm_names()
register_arm(replace(mine))
"""


def test_a_registered_arm_has_its_name(run_python):
    done = run_python("-c", REGISTERED)
    assert done.stderr.endswith("kinreach.errors.InputError: an arm named 'my-arm' is registered already\n")


@pytest.mark.parametrize("other", ["ur5-thesis", None, get_arm])
def test_only_arms_are_registered(other):
    with pytest.raises(InputError, match="an arm must be an ArmDescription"):
        register_arm(other)


def test_other_tips_need_a_default_tip():
    arm = get_arm("ur5e")
    with pytest.raises(UnknownNameError) as caught:
        replace(arm, tips={"wrist": "wrist_3_link", "flange": "tool0"})
    assert str(caught.value) == (
        "default_tip of arm 'ur5e' is 'tool0', which is none of its tips wrist, flange; with other tips give a "
        "default_tip, too, such as default_tip='wrist'"
    )
    changed = replace(arm, tips={"wrist": "wrist_3_link", "flange": "tool0"}, default_tip="flange")
    assert ArmKinematics(changed).tip == "flange"
