"""Flags that choose the arm: the tool that they describe, joints and folders, and what they refuse."""

import argparse
import os

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics
from kinreach.robots import Tool
from kinreach.robots.inside import ArmFlags

CENTRE = "0.01,-0.02 0.15,0,0,1.5"


def parsed(*words):
    parser = argparse.ArgumentParser()
    ArmFlags.add_to(parser)
    return parser.parse_args([*words])


@pytest.mark.parametrize(
    ("flags", "mass", "mesh", "scale", "radius"),
    [
        ([], 0.0, None, 1.0, None),
        (["--tool-mass", "1.5"], 1.5, None, 1.0, None),
        (["--tool-radius", "0.03"], 0.0, None, 1.0, 0.03),
        (["--tool-radius", "0.03", "--tool-mass", "1.5"], 1.5, None, 1.0, 0.03),
        (["--tool-mesh", "a.stl"], 0.0, "a.stl", 1.0, None),
        (["--tool-mesh", "a.stl", "--tool-mesh-scale", "0.001", "--tool-mass", "2"], 2.0, "a.stl", 0.001, None),
        (["--tool-mesh", "a.stl", "--tool-radius", "0.02"], 0.0, "a.stl", 1.0, 0.02),
        (["--tool-mesh-scale", "0.001"], 0.0, None, 1.0, None),
    ],
)
def test_a_tool_is_what_its_flags_say(flags, mass, mesh, scale, radius):
    tool = ArmFlags.of(parsed("--tool", CENTRE, *flags)).tool
    np.testing.assert_allclose(tool.T[:3, 3], [0.01, -0.02, 0.15])
    assert (tool.mass, tool.mesh, tool.mesh_scale) == (mass, mesh, scale)
    assert [shape.size[0] for shape in tool.shapes] == ([] if radius is None else [radius])
    if radius is not None:
        np.testing.assert_allclose(tool.shapes[0].size[1], np.linalg.norm([0.01, -0.02, 0.15]))
        np.testing.assert_allclose(tool.shapes[0].xyz, [0.005, -0.01, 0.075])
        np.testing.assert_allclose(tool.centre_of_mass, [0.005, -0.01, 0.075])


def test_tools_by_name_and_none():
    assert ArmFlags.of(parsed()).tool is None
    assert ArmFlags.of(parsed("--tool", "gripper")).tool is Tool.of("gripper")


@pytest.mark.parametrize("flag", ["mass", "radius", "mesh", "mesh-scale"])
def test_what_describes_a_tool_needs_one_without_a_shape(flag):
    with pytest.raises(InputError, match=f"^--tool-{flag} needs --tool$"):
        ArmFlags.of(parsed(f"--tool-{flag}", "1"))
    with pytest.raises(InputError, match=f"has a shape and a mass; leave out --tool-{flag}$"):
        ArmFlags.of(parsed("--tool", "gripper", f"--tool-{flag}", "1"))


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--tool", "1,2,3"], "--tool must be 6 numbers, separated by commas, got '1,2,3'"),
        (["--tool", "0,0,0,0,0,x"], "--tool must be 6 numbers, separated by commas"),
        (["--tool", CENTRE, "--tool-radius", "1 2"], "--tool-radius must be a number, got '1 2'"),
        (["--tool", CENTRE, "--tool-mesh", "a.stl", "--tool-mesh-scale", ""], "--tool-mesh-scale must be a number"),
        (["--tool", CENTRE, "--tip", "tool0"], "give --tip or --tool, not both"),
        (["--tip", "nowhere"], "tip"),
    ],
)
def test_numbers_and_contradictions_are_named(flags, said):
    with pytest.raises(InputError, match=said):
        ArmFlags.of(parsed(*flags)).arm("ur5e")


def test_joints_and_folders():
    assert ArmFlags.of(parsed()).joints is None
    assert ArmFlags.of(parsed("--joints", "a, b,c ")).joints == ["a", "b", "c"]
    assert ArmFlags.of(parsed()).package_dirs == []
    assert ArmFlags.of(parsed("--package-dir", f"x{os.pathsep}y", "--package-dir", f"z{os.pathsep}")).package_dirs == [
        *"xyz"
    ]
    assert ArmFlags.of(parsed("--tip", "tool0")).arm("ur5e").default_tip == "tool0"
    assert ArmFlags.of(parsed("--tool", CENTRE)).arm("ur5e").default_tip == "tool"


def test_flags_are_typed_again_as_they_were():
    words = ["--repair", "--joints", "a,b", "--hold", "rail=0.2", "--package-dir", "x", "--package-dir", "y"]
    words += ["--tool", CENTRE, "--tool-mass", "1.5"]
    again = ArmFlags.words(parsed(*words))
    assert sorted(again) == sorted(words)
    assert vars(parsed(*again)) == vars(parsed(*words))
    assert ArmFlags.words(parsed()) == []
    with pytest.raises(InputError, match="give --tip or --tool, not both"):
        ArmFlags.of(parsed("--tip", "tool0", "--tool", CENTRE)).arm("ur5e")


ARM = """<robot name="r"><link name="l0"/><link name="l1"/><link name="l2"/><link name="l3"/><link name="l4"/>
  <joint name="rail" type="prismatic"><parent link="l0"/><child link="l1"/><axis xyz="1 0 0"/>{limit}</joint>
  <joint name="turn" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 0 1"/>{limit}</joint>
  <joint name="a" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0.3 0 0"/>{limit}</joint>
  <joint name="b" type="revolute"><parent link="l3"/><child link="l4"/><origin xyz="0 0.1 0.3"/>{limit}</joint>
</robot>"""
LIMIT = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'


def test_with_degrees_what_turns_is_held_in_degrees_and_what_slides_in_metres(tmp_path):
    file = tmp_path / "r.urdf"
    file.write_text(ARM.format(limit=LIMIT))
    parser = argparse.ArgumentParser()
    parser.add_argument("--degrees", action="store_true")
    ArmFlags.add_to(parser)
    for rail, turn in np.random.default_rng(0).uniform(-1.5, 1.5, (20, 2)).tolist():
        for unit, words in ((1.0, []), (np.degrees(1.0), ["--degrees"])):
            given = parser.parse_args([*words, "--hold", f"rail={rail},turn={turn * unit}"])
            given.arm = str(file)
            again = parser.parse_args(ArmFlags.words(given))
            again.arm = given.arm
            for each in (given, again):
                assert ArmFlags.of(each).held == {"rail": rail, "turn": pytest.approx(turn)}


def test_the_arm_is_where_its_joints_are_held(tmp_path):
    """One of them has no `<origin>`."""
    file = tmp_path / "r.urdf"
    file.write_text(ARM.format(limit=LIMIT))
    for rail, turn in [(0.0, 0.0), *np.random.default_rng(0).uniform(-1.5, 1.5, (9, 2)).tolist()]:
        arm = ArmFlags.of(parsed("--hold", f"rail={rail!r},turn={turn!r}")).arm(str(file))
        c, s = np.cos(turn), np.sin(turn)
        tip = ArmKinematics(arm).fk([0.0, 0.0])[:3, 3]
        np.testing.assert_allclose(tip, [rail + 0.3 * c - 0.1 * s, 0.3 * s + 0.1 * c, 0.3], atol=1e-12)


def test_the_tip_of_a_file_says_which_joints_are_the_arms(tmp_path):
    file = tmp_path / "r.urdf"
    file.write_text(ARM.format(limit=LIMIT))
    joints = ("rail", "turn", "a", "b")
    for count in (3, 4):
        arm = ArmFlags.of(parsed("--tip", f"l{count}")).arm(str(file))
        assert (arm.joints, arm.default_tip) == (joints[:count], f"l{count}")
