"""URDF files as ROS's packages have them: meshes by package, grippers, mimic joints and xacro, from a shell."""

from __future__ import annotations

import itertools
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from kinreach import cli
from kinreach.errors import InputError, NoShapesError
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import ArmDescription, get_arm
from kinreach.robots.inside import ArmFlags, link_shapes
from kinreach.sim.inside import build_scene
from kinreach.view import TargetModel
from tests.cases import slow

ROBOTS = Path(str(get_arm("ur5").package_root())) / "example-robot-data/robots"
#: Name in ROS -> file, its folder of meshes, the joints of `q`, the default tip, and a pose that it reaches.
ARMS = {
    "ur_description": (
        "ur_description/urdf/ur5_robot.urdf", "meshes/ur5", 6, "tool0", "0.4,0.1,0.3,3.14,0,0"
    ),
    "franka_description": (
        "panda_description/urdf/panda.urdf", "meshes", 7, "panda_hand_tcp", "0.4,0.1,0.3,3.14,0,0"
    ),
    "z1_gripper_description": (
        "z1_description/urdf/z1.urdf", "meshes/collision", 6, "gripperStator", "0.3,0.1,0.3,0,0.5,0"
    ),
}  # fmt: skip
GRIPPERS = {"franka_description": "panda_finger_joint1, panda_finger_joint2", "z1_gripper_description": "jointGripper"}


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """The packages under the names that ROS gives them, and their URDFs elsewhere."""
    folder = tmp_path_factory.mktemp("ros")
    for package, (file, meshes, *_) in ARMS.items():
        own = file.split("/", maxsplit=1)[0]
        shutil.copytree(ROBOTS / own / meshes, folder / "install/share" / package / meshes)
        text = (ROBOTS / file).read_text().replace(f"example-robot-data/robots/{own}", package)
        assert f"package://{package}/meshes" in text
        (folder / "mine").mkdir(exist_ok=True)
        (folder / "mine" / f"{package}.urdf").write_text(text)
    return folder


@pytest.fixture(autouse=True)
def no_ros(monkeypatch):
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)


def run(capsys, *words):
    code = cli.main([str(word) for word in words])
    done = capsys.readouterr()
    return code, done.out, done.err.splitlines()


#: The Z1's meshes take seconds to read.
PACKAGES = ["ur_description", *slow("franka_description", "z1_gripper_description")]


@pytest.mark.parametrize(
    ("how", "package"),
    [
        ("flag", "franka_description"),
        ("ROS_PACKAGE_PATH", "ur_description"),
        ("AMENT_PREFIX_PATH", "ur_description"),
        ("nowhere", "franka_description"),
        ("nowhere", "ur_description"),
        ("flag", "z1_gripper_description"),
        ("nowhere", "z1_gripper_description"),
    ],
)
@pytest.mark.slow
def test_files_of_ros_from_a_shell(workspace, capsys, monkeypatch, package, how):
    file, pose = workspace / "mine" / f"{package}.urdf", ARMS[package][-1]
    share = workspace / "install/share"
    flags = ["--package-dir", f"{workspace / 'mine'}{os.pathsep}{share}"] if how == "flag" else []
    if how.endswith("PATH"):
        monkeypatch.setenv(how, f"/nowhere{os.pathsep}{share if how[0] == 'R' else share.parent}")
    code, out, err = run(capsys, "ik", "--arm", file, *flags, "--pose", pose)
    assert code == 0, (out, err)
    assert ("not known" in out) is (how == "nowhere")
    assert f"tip {ARMS[package][3]}" in out
    notes = [line for line in err if line.startswith("note: ")]
    assert notes == err
    if package in GRIPPERS:
        assert notes[0].startswith(f"note: joint{'s' * (package[0] == 'f')} {GRIPPERS[package]} of a gripper ")
        assert ("to take in jointGripper, name all joints of q with --joints" in notes[0]) is (package[0] == "z")
    assert len(notes) == (package in GRIPPERS) + (how == "nowhere")
    if how == "nowhere":
        assert "collision mesh" in notes[-1]
        assert "--package-dir" in notes[-1]
    code, out, again = run(capsys, "check", file, *flags, "--poses", "3")
    assert (code, again) == (0, err)
    assert ("pairs of links are checked" in out) is (how != "nowhere")
    assert ("not known: arm" in out) is (how == "nowhere")


@pytest.mark.parametrize("package", PACKAGES)
def test_meshes_of_a_package_reach_every_engine(workspace, package):
    _, _, count, tip, _ = ARMS[package]
    file = workspace / "mine" / f"{package}.urdf"
    arm = ArmDescription.from_urdf(file, package_dirs=[workspace / "install/share"])
    assert (len(arm.joints), arm.default_tip, arm.missing_shapes) == (count, tip, "")
    assert len(arm.notes) == (package in GRIPPERS)
    known = ArmDescription.from_urdf(ROBOTS / ARMS[package][0])
    check, expected = CollisionChecker(arm), CollisionChecker(known)
    for q in np.random.default_rng(0).uniform(check.kinematics.lower, check.kinematics.upper, (20, count)):
        assert check.contacts(q) == expected.contacts(q)
    assert build_scene(arm).compile().nmesh >= 4
    beside = ArmDescription.from_urdf(file, package_dirs=[workspace / "install/share" / package])
    assert CollisionChecker(beside).pairs == check.pairs


def test_meshes_of_a_repository_of_packages(workspace, monkeypatch):
    """ROS searches below the folders of `ROS_PACKAGE_PATH`, where a repository holds several packages."""
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(workspace / "install"))
    assert CollisionChecker(ArmDescription.from_urdf(workspace / "mine/ur_description.urdf")).pairs


ARM = """<robot name="two">
  <link name="base"/>
  <link name="one"><visual><geometry><mesh filename="{visual}"/></geometry></visual>
    <collision><geometry><mesh filename="{collision}"/></geometry></collision></link>
  <link name="two"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


def write(folder, visual, collision, box="box.stl"):
    trimesh.creation.box((0.2, 0.1, 0.06)).export(folder / box)
    file = folder / "two.urdf"
    file.write_text(ARM.format(visual=visual, collision=collision))
    return file


def test_a_missing_visual_mesh_never_matters(tmp_path):
    for visual in ("package://other/drawn.dae", "drawn.step", "file:///nowhere.stl", "/etc/passwd", "http://a/x.stl"):
        arm = ArmDescription.from_urdf(write(tmp_path, visual, "box.stl"))
        assert (arm.notes, arm.missing_shapes) == ((), "")
        assert [shape.link for shape in link_shapes(arm)] == ["one"], "drawn by its collision shape"
        assert CollisionChecker(arm).free([0, 0])
        assert build_scene(arm).compile().nq == 2


def test_meshes_where_no_shape_is_and_two_in_one(tmp_path):
    file = write(tmp_path, "box.stl", "box.stl")
    text = file.read_text()
    file.write_text(text.replace('<link name="base"/>', '<link name="base"><mesh filename="/no"/></link><mesh/>'))
    arm = ArmDescription.from_urdf(file)
    assert (arm.urdf.count("<mesh"), arm.notes) == (2, ())
    file.write_text(text.replace("</geometry></visual>", '<mesh filename="no.stl"/></geometry></visual>'))
    arm = ArmDescription.from_urdf(file)
    assert (arm.urdf.count("<mesh"), arm.notes) == (2, ())
    assert [shape.link for shape in link_shapes(arm)] == ["one"]


def test_a_missing_collision_mesh_costs_the_collisions(tmp_path):
    arm = ArmDescription.from_urdf(write(tmp_path, "box.stl", "package://other/meshes/felt.stl"))
    (note,) = arm.notes
    assert note.startswith(
        "no collision checks and no simulation: the collision mesh 'package://other/meshes/felt.stl'"
    )
    assert "\n" not in note
    kin = ArmKinematics(arm)
    assert kin.fk([0.1, 0.2]).shape == (4, 4)
    for changed in (arm, arm.with_tool([0, 0, 0.1, 0, 0, 0]), arm.with_limits(0.5)):
        for use in (CollisionChecker, build_scene):
            with pytest.raises(NoShapesError, match=r"package://other/meshes/felt\.stl"):
                use(changed)
    assert {shape.link for shape in link_shapes(arm)} == {"one"}


def test_view_and_compare_with_a_missing_collision_mesh(tmp_path, capsys):
    file = write(tmp_path, "box.stl", "package://other/meshes/felt.stl")
    assert TargetModel(ArmDescription.from_urdf(file)).checker is None
    code, _, (note, error) = run(capsys, "compare", "--arm", file, "--goals", "1", "--out", tmp_path / "out")
    assert code == 2
    assert "--package-dir" in note
    assert error.startswith("kinreach compare: error: ")
    assert "felt.stl" in error


def test_meshes_by_the_address_of_a_file(tmp_path):
    """Within the folders that are named or beside the URDF, and nowhere else."""
    folder, other = tmp_path / "a b/urdf", tmp_path / "other"
    folder.mkdir(parents=True)
    other.mkdir()
    file = write(folder, "", "", box="../box.stl")
    trimesh.creation.box((0.2, 0.1, 0.06)).export(other / "box.stl")
    for address, found in (
        (f"file://{tmp_path}/a%20b/box.stl", True),
        (f"{tmp_path}/a b/box.stl", True),
        (f"file://{other}/box.stl", False),
        (f"{folder}/../../other/box.stl", False),
        (f"file://{tmp_path}/a%20b/box.stl%00", False),
    ):
        file.write_text(ARM.format(visual=address, collision=address))
        assert bool(ArmDescription.from_urdf(file).missing_shapes) is not found, address
        assert not ArmDescription.from_urdf(file, package_dirs=[other]).missing_shapes or "%00" in address


def test_a_package_is_not_left_by_a_link(tmp_path, monkeypatch):
    """Neither where packages are looked for around the file, nor in ROS's folders."""
    ws, secret = tmp_path / "ws", tmp_path / "secret"
    (ws / "src/arm/urdf").mkdir(parents=True)
    (ws / "src/robot").mkdir()
    secret.mkdir()
    trimesh.creation.box((0.2, 0.1, 0.06)).export(secret / "box.stl")
    (ws / "src/robot/box.stl").symlink_to(secret / "box.stl")
    (ws / "src/linked").symlink_to(secret)
    for package in ("robot", "linked"):
        file = write(ws / "src/arm/urdf", "", "")
        file.write_text(ARM.format(visual="", collision=f"package://{package}/box.stl"))
        assert ArmDescription.from_urdf(file).missing_shapes
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(ws / "src"))
        assert ArmDescription.from_urdf(file).missing_shapes
        assert not ArmDescription.from_urdf(file, package_dirs=[secret]).missing_shapes
        monkeypatch.delenv("ROS_PACKAGE_PATH")


def test_a_package_is_named_by_its_package_xml(tmp_path, monkeypatch):
    """Whatever its folder is called, as after the download of a repository as an archive."""
    repository, elsewhere = tmp_path / "arm-main", tmp_path / "elsewhere/other-name"
    (repository / "robots/deep/urdf").mkdir(parents=True)
    (elsewhere / "meshes").mkdir(parents=True)
    manifest = (
        "<?xml version='1.0'?><!-- <name>other</name> --><package format='2'>\n<name> arm_description </name></package>"
    )
    (repository / "package.xml").write_text(manifest)
    (elsewhere / "package.xml").write_text(manifest.replace("arm_description", "meshes_of_arm"))
    for folder in (repository, elsewhere / "meshes"):
        trimesh.creation.box((0.2, 0.1, 0.06)).export(folder / "box.stl")
    file = write(repository / "robots/deep/urdf", "", "", box="unused.stl")
    for address, options, found in (
        ("package://arm_description/box.stl", {}, True),
        ("model://arm_description/box.stl", {}, True),
        ("$(find arm_description)/box.stl", {}, True),
        ("file://$(find arm_description)/box.stl", {}, True),
        ("file://$(find-pkg-share arm_description)/box.stl", {}, True),
        ("../../../box.stl", {}, True),  # within the package of the URDF
        (f"file://{repository}/box.stl", {}, True),
        ("..\\..\\..\\box.stl", {}, True),
        ("../../../../elsewhere/other-name/meshes/box.stl", {}, False),
        ("package://other/box.stl", {}, False),
        ("package://meshes_of_arm/meshes/box.stl", {}, False),
        ("package://meshes_of_arm/meshes/box.stl", {"package_dirs": [elsewhere]}, True),
        ("package://meshes_of_arm/meshes/box.stl", {"package_dirs": [elsewhere.parent]}, True),
        ("package://meshes_of_arm/meshes/box.stl", {"package_dirs": [tmp_path]}, True),
        ("package://arm_description/../elsewhere/other-name/meshes/box.stl", {"package_dirs": [repository]}, False),
    ):
        file.write_text(ARM.format(visual="", collision=address))
        assert bool(ArmDescription.from_urdf(file, **options).missing_shapes) is not found, (address, options)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(elsewhere.parent))
    file.write_text(ARM.format(visual="", collision="package://meshes_of_arm/meshes/box.stl"))
    assert not ArmDescription.from_urdf(file).missing_shapes


def test_package_xml_counts_before_the_names_of_folders(tmp_path):
    for folder, name, size in (("one", "two", 0.2), ("two", "one", 0.4)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "package.xml").write_text(f"<package><name>{name}</name></package>")
        trimesh.creation.box((size, 0.1, 0.1)).export(tmp_path / folder / "box.stl")
    file = write(tmp_path / "one", "", "", box="unused.stl")
    for package, size in (("two", 0.2), ("one", 0.4)):
        file.write_text(ARM.format(visual="", collision=f"package://{package}/box.stl"))
        (shape,) = (each for each in link_shapes(ArmDescription.from_urdf(file), "collision") if each.link == "one")
        assert np.ptp(shape.vertices[:, 0]) == pytest.approx(size)


def test_a_package_xml_that_is_none_names_nothing(tmp_path):
    file = write(tmp_path, "package://arm/box.stl", "package://arm/box.stl")
    for content in (
        b"",
        b"\xff" * 100,
        b"<name>",
        b"<!-- <name>arm</name>",
        b"<name>" * 150_000,
        b"<name>" + b" " * 900_000,
    ):
        (tmp_path / "package.xml").write_bytes(content)
        assert ArmDescription.from_urdf(file).missing_shapes
    (tmp_path / "package.xml").unlink()
    os.mkfifo(tmp_path / "package.xml")
    assert ArmDescription.from_urdf(file).missing_shapes


@pytest.mark.parametrize("name", ["arm.urdf.xacro", "arm.xacro", "arm.urdf", "undeclared.urdf"])
def test_xacro_is_named(tmp_path, capsys, name):
    declared = "" if name == "undeclared.urdf" else ' xmlns:xacro="http://www.ros.org/wiki/xacro"'
    file = tmp_path / name
    file.write_text(f'<robot name="a"{declared}><xacro:include filename="/etc/passwd"/><link name="l"/></robot>')
    other = tmp_path / {"undeclared.urdf": "undeclared_expanded.urdf", "arm.urdf": "arm_expanded.urdf"}.get(
        name, "arm.urdf"
    )
    with pytest.raises(InputError, match="is xacro"):
        ArmDescription.from_urdf(file)
    for words in (["ik", "--arm", file, "--pose", "0,0,0,0,0,0"], ["check", file]):
        code, out, (line,) = run(capsys, *words)
        assert (code, out) == (2, "")
        assert f"run `xacro {file} > {other}`" in line


def test_an_expanded_file_keeps_xacros_comments(tmp_path):
    text = ARM.format(visual="", collision="box.stl").replace(
        'name="two">', 'name="two" xmlns:xacro="http://x/xacro">', 1
    )
    file = write(tmp_path, "", "box.stl")
    file.write_text(text.replace("<link", "<!-- <xacro:arm/> --><link", 1))
    assert ArmDescription.from_urdf(file).joints == ("a", "b")


def test_a_grippers_joints_are_taken_in_by_their_names():
    file = ROBOTS / "z1_description/urdf/z1.urdf"
    arm = ArmDescription.from_urdf(file)
    kin = ArmKinematics(arm)
    every = (*arm.joints, "jointGripper")
    taken = ArmDescription.from_urdf(file, joints=every)
    assert (taken.joints, taken.default_tip, taken.notes) == (every, "gripperMover", ())
    assert ArmFlags(joints=list(every)).arm(str(file)).joints == every
    tipped = ArmDescription.from_urdf(file, tip="gripperMover")
    assert tipped.joints == arm.joints
    held = ArmDescription.from_urdf(file, held={"jointGripper": -0.5})
    assert (held.joints, held.notes) == (arm.joints, ())
    q = np.random.default_rng(0).uniform(kin.lower, kin.upper, (20, 6))
    place = ArmKinematics(taken, tip="gripperMover").fk(np.column_stack([q, np.zeros(20)]))
    np.testing.assert_allclose(ArmKinematics(tipped).fk(q), place, atol=1e-12)


GRIPPER = """<robot name="g">{links}
  <joint name="j1" type="revolute"><parent link="l0"/><child link="l1"/><axis xyz="0 0 1"/>{limit}</joint>
  <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
    {limit}</joint>
  <joint name="drive" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0.1 0 0"/>{limit}</joint>
  <joint name="follower" type="revolute"><parent link="l3"/><child link="l4"/><origin xyz="0.1 0 0"/>{limit}
    <mimic joint="drive" multiplier="-1"/></joint>
  <joint name="flange" type="fixed"><parent link="l2"/><child link="l5"/></joint>
</robot>"""
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def test_joints_that_mimic_and_the_one_that_they_follow(tmp_path, capsys):
    file = tmp_path / "g.urdf"
    links = "".join(f'<link name="l{i}"/>' for i in range(6))
    file.write_text(GRIPPER.format(links=links, limit=LIMIT))
    arm = ArmDescription.from_urdf(file)
    assert (arm.joints, arm.default_tip) == (("j1", "j2"), "l5")
    assert arm.notes[0].startswith(
        "joints drive, follower of a gripper are held still and not part of q; to take in drive, "
    )
    file.write_text(GRIPPER.format(links=links, limit=LIMIT).replace('joint="drive"', 'joint="j2"'))
    assert ArmDescription.from_urdf(file, held={"follower": 0.0}).joints == ("j1", "j2", "drive")
    code, _, (line,) = run(capsys, "check", "ur5", "--joints", "elbow_joint")
    assert (code, "--joints is for URDF and MJCF files" in line) == (2, True)


@pytest.mark.parametrize("kinds", list(itertools.product(("revolute", "prismatic"), repeat=2)), ids="-".join)
def test_joints_that_mimic_are_a_grippers_where_an_arm_turns_before_them(tmp_path, kinds):
    """A machine of slides alone may have two that follow each other."""
    file, links = tmp_path / "g.urdf", "".join(f'<link name="l{i}"/>' for i in range(6))
    text = GRIPPER.format(links=links, limit=LIMIT)
    for joint, kind in zip(("j1", "j2"), kinds, strict=True):
        text = text.replace(f'"{joint}" type="revolute"', f'"{joint}" type="{kind}"')
    file.write_text(text)
    arm = ArmDescription.from_urdf(file)
    assert arm.joints == (("j1", "j2") if "revolute" in kinds else ("j1", "j2", "drive"))
