"""What a URDF may have in it, what is built from primitives, and what is derived from a chain."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kinreach.errors import InputError
from kinreach.kinematics import pose
from kinreach.robots import ArmDescription, get_arm
from kinreach.robots._urdf import (
    MAX_CHARACTERS,
    MAX_LINKS,
    MAX_NUMBER,
    CheckedUrdf,
    Follows,
    Solid,
    UrdfArm,
    add_link,
    check_urdf,
    followed,
    followers_on_way,
    is_only_way_on,
    named,
    place_origin,
    set_limits,
)
from kinreach.robots._urdf_chain import UrdfChain
from kinreach.robots.inside import origin_of

#: A robot with every attribute that is a number, each with a value that no other number in it has.
ROBOT = """<robot name="r">
  <link name="a">
    <inertial><origin xyz="0.01 0 0" rpy="0.02 0 0"/><mass value="1.5"/>
      <inertia ixx="0.11" ixy="0.12" ixz="0.13" iyy="0.14" iyz="0.15" izz="0.16"/></inertial>
    <visual><origin xyz="0.03 0 0"/><geometry><box size="0.21 0.22 0.23"/></geometry>
      <material name="m"><color rgba="0.31 0.32 0.33 1"/></material></visual>
    <collision><geometry><cylinder radius="0.41" length="0.42"/></geometry></collision>
    <collision><geometry><sphere radius="0.43"/></geometry></collision>
    <collision><geometry><mesh filename="package://a/x.stl" scale="0.51 0.52 0.53"/></geometry></collision>
  </link>
  <link name="b"/> <link name="c"/>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0.61 0"/>
    <limit lower="-0.71" upper="1.72" effort="0.73" velocity="0.74"/><dynamics damping="0.81" friction="0.82"/></joint>
  <joint name="k" type="prismatic"><parent link="b"/><child link="c"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/><mimic joint="j" multiplier="0.91" offset="0.92"/></joint>
</robot>"""
ABOVE_ZERO, NOT_NEGATIVE = {"size", "radius", "length"}, {"value", "effort", "velocity", "damping", "friction"}


def numbers_of(robot):
    """Every attribute of numbers: element, name, and how many there are."""
    for element in robot.iter():
        for name, text in element.attrib.items():
            words = text.split()
            if re.fullmatch(r"[-\d. ]+", text):
                yield element, name, len(words)


def test_every_number_is_one_and_has_its_sign():
    check_urdf(ROBOT, "/")
    robot, tried = ET.fromstring(ROBOT), set()
    for element, name, count in numbers_of(robot):
        kept = element.get(name)
        good, bad = {"1", "0.5", "0", "-0.5"}, {"nan", "inf", "x", f"{2 * MAX_NUMBER}", f"{-2 * MAX_NUMBER}"}
        bad |= {"-0.5"} if name in ABOVE_ZERO | NOT_NEGATIVE else set()
        bad |= {"0"} if name in ABOVE_ZERO | {"scale"} else set()
        if name == "upper":
            bad.add("-2")  # below the lower one
        for value in good - bad:
            element.set(name, " ".join([value, *["0.9"] * (count - 1)]))
            check_urdf(ET.tostring(robot, encoding="unicode"), "/")
        for text in (*(" ".join([*["0.9"] * (count - 1), value]) for value in bad), "", "1 " * (count + 1)):
            element.set(name, text)
            with pytest.raises(InputError, match=rf"^{name} of <{element.tag}> must |lower limit above the upper one"):
                check_urdf(ET.tostring(robot, encoding="unicode"), "/")
        element.set(name, kept)
        tried.add((element.tag, name))
    assert len(tried) == 24


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('<link name="b"/>', '<link name=""/>', "nameless part"),
        ('<link name="b"/>', "<link/>", "nameless part"),
        ('<link name="b"/>', '<link name="b"/><link name="b"/>', "names 'b' 2 times"),
        ('<link name="b"/>', '<link name="b\u202e"/>', "names 'b.*' 1 times"),
        ('joint name="k"', 'joint name=""', "a joint without a name"),
        ('joint name="k"', "joint", "a joint without a name"),
        ('joint name="k"', 'joint name="k\u202e"', "a joint without a name that can be printed"),
        ('joint name="k"', 'joint name="j"', "two joints of one name"),
        ('type="prismatic"', 'type="floating"', "joint 'k' of the URDF must be one of revolute"),
        ('type="prismatic"', "", "joint 'k' of the URDF must be one of revolute"),
        ('<limit lower="-1" upper="1" effort="1" velocity="1"/>', "", "joint 'k' .* has no <limit>, which it must"),
        ('<axis xyz="0 0.61 0"/>', '<axis xyz="0 9e-7 0"/>', "joint 'j' of the URDF has an axis without direction"),
        ('<child link="c"/>', "", "joint 'k' of the URDF must connect two links"),
        ('<parent link="b"/>', '<parent link="z"/>', "joint 'k' of the URDF must connect two links"),
        ('<link name="c"/>', '<link name="c"/><link name="d"/>', "got 2 that hang on none"),
        ("package://a/x.stl", "package://a/../x.stl", "files of a URDF must be within"),
        ("<geometry><box", '<geometry><mesh filename="x.stl"/><box', "files of a URDF must be within"),
        ('<color rgba="0.31 0.32 0.33 1"/>', '<texture filename="x.png"/>', "files of a URDF must be within"),
        ("<robot", "<model", "not XML"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_the_parts_is_named(old, new, said):
    assert ROBOT.count(old) == 1
    with pytest.raises(InputError, match=said):
        check_urdf(ROBOT.replace(old, new), "/")


@pytest.mark.parametrize("text", [3, None, b"<robot/>", "<robot/>" + " " * MAX_CHARACTERS], ids=type)
def test_what_is_no_text_or_a_very_long_one_is_no_urdf(text):
    with pytest.raises(InputError, match=f"a URDF must be text of at most {MAX_CHARACTERS} characters, got "):
        check_urdf(text, None)


def test_what_an_arm_needs_of_its_urdf_is_named():
    """Where a description brings the text itself; a file is repaired with a note."""
    for old, new, said in (
        (' effort="0.73"', "", r"joint 'j' of the URDF has a <limit> without effort=, its largest torque"),
        (' effort="1" velocity="1"', ' effort="1"', r"joint 'k' of the URDF has a <limit> without velocity=, its larg"),
        ('<link name="c"/>', '<link name="world"/>', r"arm 'r': the link 'world' must carry all others, and hang on"),
    ):
        text = ROBOT.replace(old, new).replace('child link="c"', f'child link="{"world" if "world" in new else "c"}"')
        assert text != ROBOT
        with pytest.raises(InputError, match=said):
            CheckedUrdf.of("r", text, "/")
    CheckedUrdf.of("r", ROBOT, "/")


def test_only_chains_of_joints_that_turn_alone_are_calibrated():
    robot = ET.fromstring(ROBOT)
    with pytest.raises(InputError, match=r"joint 'k' follows another; only arms whose joints turn, each alone, are"):
        UrdfChain.of(robot, ("j",), base="a", tip="c")
    mimic = next(robot.iter("mimic"))
    next(joint for joint in robot.iter("joint") if mimic in list(joint)).remove(mimic)
    with pytest.raises(InputError, match=r"joint 'k' slides; only arms whose joints turn"):
        UrdfChain.of(robot, ("j", "k"), base="a", tip="c")


def test_a_urdf_has_a_link_and_not_too_many():
    for count, good in ((0, False), (1, True), (MAX_LINKS, True), (MAX_LINKS + 1, False)):
        links = "".join(f'<link name="l{i}"/>' for i in range(count))
        joints = "".join(
            f'<joint name="j{i}" type="fixed"><parent link="l0"/><child link="l{i}"/></joint>' for i in range(1, count)
        )
        text = f'<robot name="r">{links}{joints}</robot>'
        if good:
            check_urdf(text, None)
        else:
            with pytest.raises(InputError, match=f"1 to {MAX_LINKS} links, got {count}"):
                check_urdf(text, None)


@pytest.mark.parametrize("centre", [None, (0.1, 0.2, 0.3)])
def test_the_inertia_of_a_solid_is_trimeshs(centre):
    rng = np.random.default_rng(0)
    shapes = {3: trimesh.creation.box, 2: trimesh.creation.cylinder, 1: trimesh.creation.icosphere}
    for count in (3, 2, 1) * 5:
        size, mass = tuple(rng.uniform(0.05, 0.5, count).tolist()), rng.uniform(0.1, 5.0)
        solid = Solid(size, tuple(rng.uniform(-1, 1, 3).tolist()), tuple(rng.uniform(-1, 1, 3).tolist()))
        robot = ET.Element("robot")
        add_link(robot, "one", mass=mass, centre=centre, solids=(solid, Solid((9.0,))), rgba="1 0 0 1")
        inertial = robot.find("link/inertial")
        assert float(inertial.find("mass").get("value")) == mass
        made = {
            3: {"extents": size},
            2: dict(zip(("radius", "height"), size, strict=False), sections=200),
            1: {"radius": size[0], "subdivisions": 4},
        }
        shape = shapes[count](**made[count])
        expected = np.diag(shape.moment_inertia) * mass / shape.volume
        found = inertial.find("inertia").attrib
        np.testing.assert_allclose([float(found[key]) for key in ("ixx", "iyy", "izz")], expected, rtol=0.01)
        assert [found[key] for key in ("ixy", "ixz", "iyz")] == ["0"] * 3
        np.testing.assert_allclose(origin_of(inertial)[:3, 3], solid.xyz if centre is None else centre)
        for kind in ("visual", "collision"):
            first, second = robot.findall(f"link/{kind}")
            np.testing.assert_array_equal(origin_of(first)[:3, 3], solid.xyz)
            np.testing.assert_array_equal(origin_of(first)[:3, :3], origin_of(inertial)[:3, :3])
            (geometry,) = first.find("geometry")
            assert [float(v) for text in geometry.attrib.values() for v in text.split()] == list(size)
            assert (first.find("material") is not None) is (kind == "visual")
            assert second.find("geometry/sphere").get("radius") == "9.0"
    bare = ET.Element("robot")
    add_link(bare, "one", solids=(Solid((1.0,)),))
    add_link(bare, "cube", mass=3.0)
    assert bare.find("link[@name='one']/inertial") is None
    assert bare.find("link/visual/material") is None
    assert float(bare.find("link[@name='cube']/inertial/inertia").get("izz")) == pytest.approx(3.0 * 0.05**2 / 6)


def chain(*, efforts=(40.0, 1.0), speeds=(2.5, 2.0)):
    """Two joints, 0.3 m apart, and a hand 0.4 m behind the second one; links of 2, 1 and 0.5 kg."""
    inertial = '<inertial><origin xyz="0.1 0 0"/><mass value="{}"/><inertia ixx="{}" iyy="{}" izz="{}"/></inertial>'
    masses = {
        "base": (9, 9, 9, 9),
        "one": (2, 0.01, 0.03, 0.02),
        "two": (1, 0.02, 0.01, 0.01),
        "hand": (0.5, 0, 0, 0.04),
    }
    links = "".join(f'<link name="{name}">{inertial.format(*numbers)}</link>' for name, numbers in masses.items())
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 {length} 0"/><axis xyz="0 0 1"/><dynamics damping="{number}.5"/>'
        f'<limit lower="-1" upper="{number}" effort="{effort}" velocity="{speed}"/></joint>'
        for number, (name, parent, child, length, effort, speed) in enumerate(
            zip(("j", "k"), ("base", "one"), ("one", "two"), (0.7, -0.3), efforts, speeds, strict=True), start=2
        )
    )
    return (
        f'<robot name="r">{links}{joints}<joint name="f" type="fixed"><parent link="two"/><child link="hand"/>'
        '<origin xyz="0 0 0.4"/></joint></robot>'
    )


def test_what_a_description_does_not_give_is_derived_from_the_chain():
    arm = ArmDescription("r", "r", chain, armature=0.2)
    second = 1.0 * 0.1**2 + 0.02 + 0.5 * 0.5**2 + 0.04
    first = 2.0 * 0.1**2 + 0.03 + 1.0 * 0.4**2 + 0.02 + 0.5 * 0.8**2 + 0.04
    np.testing.assert_allclose(arm.position_gains, 900.0 * np.array([first + 0.2, second + 0.2]))
    assert arm.acceleration_limit == pytest.approx(1.0 / 2 / (second + 0.2))
    assert (arm.speed_limit, arm.home, arm.joint_damping) == (2.0, (0.5, 1.0), (2.5, 3.5))
    assert (arm.joints, arm.base, arm.default_tip, dict(arm.tips)) == (
        ("j", "k"), "base", "hand", {"hand": "hand", "two": "two"}
    )  # fmt: skip
    (overview,) = arm.cameras
    np.testing.assert_allclose(overview.position, 1.4 * np.array([1.5, -1.5, 0.9]))
    np.testing.assert_allclose(overview.target, 1.4 * np.array([0.15, 0.0, 0.3]))
    strong = ArmDescription("r", "r", lambda: chain(efforts=(0.0, 1000.0), speeds=(0.0, 9.0)))
    assert (strong.acceleration_limit, strong.speed_limit) == (10.0, 3.0)
    assert ArmDescription("r", "r", lambda: chain(efforts=(1.0, 1.0))).acceleration_limit == pytest.approx(
        1.0 / 2 / (first + 0.1)
    )


def test_the_world_is_the_base_only_where_it_carries_several_links():
    robot = ET.fromstring(get_arm("arm3").urdf)
    assert UrdfArm("arm3", robot).base == "base_link"
    ET.SubElement(robot, "link", name="table")
    joint = ET.SubElement(robot, "joint", name="beside", type="fixed")
    ET.SubElement(joint, "parent", link="world")
    ET.SubElement(joint, "child", link="table")
    assert UrdfArm("arm3", robot).base == "world"


def test_a_home_may_be_beyond_a_limit_by_its_digits():
    arm = replace(get_arm("ur5-thesis"), home=(3.141595, *get_arm("ur5").home[1:]))
    assert arm.urdf
    for angle in (np.pi + 2e-5, -np.pi - 2e-5):
        with pytest.raises(InputError, match="outside its limits"):
            replace(arm, home=(angle, *arm.home[1:])).urdf  # noqa: B018


def tree(*joints):
    """A URDF of joints, each with its parent, child and type."""
    robot = ET.Element("robot", name="r")
    for parent, child, kind in joints:
        joint = ET.SubElement(robot, "joint", name=f"{parent}{child}", type=kind)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
    for link in sorted({name for parent, child, _ in joints for name in (parent, child)}):
        ET.SubElement(robot, "link", name=link)
    return robot


@pytest.mark.parametrize(
    ("beside", "only"),
    [
        ([], True),
        ([("c", "x", "revolute")], False),  # beside the last joint
        ([("b", "x", "revolute")], False),  # on what is fixed to its parent
        ([("a", "x", "revolute")], True),  # before the joint that moves the body
        ([("c", "x", "fixed")], False),  # a frame beside the way
        ([("b", "x", "fixed")], False),
        ([("b", "x", "fixed"), ("x", "y", "revolute")], False),
        ([("d", "x", "revolute"), ("d", "y", "revolute")], True),
    ],
)
def test_whether_a_joint_is_the_only_way_on_from_a_body(beside, only):
    """The body is all that is fixed to the joint's parent: b and c, which the joint ab moves."""
    robot = tree(("a", "b", "revolute"), ("b", "c", "fixed"), ("c", "d", "revolute"), *beside)
    assert is_only_way_on(robot, named(robot, "joint", "cd")) == only


def test_the_origin_of_a_joint_is_put_where_it_moves_to():
    """Compared with poses; without an <origin> or an <axis> it turns or slides along x."""
    rng, placed = np.random.default_rng(2), 0
    for kind in ("revolute", "continuous", "prismatic"):
        for axis in (None, [0.0, 0.0, 2.0], rng.normal(size=3)):
            for origin in (None, rng.uniform(-1, 1, 6)):
                joint = ET.Element("joint", name="j", type=kind)
                if axis is not None:
                    ET.SubElement(joint, "axis", xyz=" ".join(map(repr, map(float, axis))))
                before = np.eye(4)
                if origin is not None:
                    texts = (" ".join(map(repr, map(float, part))) for part in (origin[:3], origin[3:]))
                    ET.SubElement(joint, "origin", **dict(zip(("xyz", "rpy"), texts, strict=True)))
                    before = origin_of(joint)
                place = float(rng.uniform(-1, 1))
                place_origin(joint, place)
                direction = np.array([1.0, 0.0, 0.0]) if axis is None else axis / np.linalg.norm(axis)
                moved = [*(place * direction), 0, 0, 0] if kind == "prismatic" else [0, 0, 0, *(place * direction)]
                np.testing.assert_allclose(origin_of(joint), before @ pose(moved), atol=1e-9)
                placed += 1
    assert placed == 18


def test_only_joints_that_move_take_limits():
    robot = tree(("a", "b", "fixed"), ("b", "c", "revolute"), ("c", "d", "continuous"), ("d", "e", "prismatic"))
    for name in ("ab", "x", "b"):
        with pytest.raises(InputError, match=f"no joint '{name}' of a kind that has limits"):
            set_limits(robot, name, 0.0, 1.0)
    for name, kind in (("bc", "revolute"), ("cd", "revolute"), ("de", "prismatic")):
        set_limits(robot, name, -0.5, 1.5, effort=3.0)
        joint = named(robot, "joint", name)
        assert joint.get("type") == kind
        assert {key: float(value) for key, value in joint.find("limit").attrib.items()} | {"velocity": 0.0} == {
            "lower": -0.5, "upper": 1.5, "effort": 3.0, "velocity": 0.0
        }  # fmt: skip


def mimicking(**joints):
    """Joints in a row, each with the attributes of its <mimic>."""
    names = list(joints)
    links = "abcdefgh"
    robot = tree(*((links[i], links[i + 1], "revolute") for i in range(len(names))))
    for joint, name in zip(robot.findall("joint"), names, strict=True):
        joint.set("name", name)
        if joints[name]:
            ET.SubElement(joint, "mimic", **joints[name])
    return robot


@pytest.mark.parametrize(
    "values", [{"multiplier": "two"}, {"offset": "inf"}, {"offset": ""}, {"multiplier": "1 2"}, {"offset": "١"}]
)
def test_a_mimic_with_what_is_no_number_is_named(values):
    robot = mimicking(j={}, k={"joint": "j", **values})
    with pytest.raises(InputError, match="joint 'k' of the URDF has a <mimic> with what is no number"):
        followed("r", robot, "k")


def test_joints_that_follow_one_on_the_way():
    """The first of them leads, and none follows one that is held; worked out by hand."""
    robot = mimicking(
        j={}, k={"joint": "j", "multiplier": "2", "offset": "0.5"}, m={"joint": "k", "multiplier": "-3"}, n={}
    )
    assert followed("r", robot, "m") == Follows("j", -6.0, -1.5)
    assert followers_on_way("r", robot, ["j", "k", "m", "n"], []) == {
        "k": Follows("j", 2.0, 0.5), "m": Follows("j", -6.0, -1.5)
    }  # fmt: skip
    assert followers_on_way("r", robot, ["k", "m", "n"], []) == {"m": Follows("k", -3.0, 0.0)}
    assert followers_on_way("r", robot, ["k", "m", "n"], ["j"]) == {}
    assert followers_on_way("r", robot, ["j", "k"], ["n"]) == {"k": Follows("j", 2.0, 0.5)}
    robot = mimicking(j={}, k={"joint": "j", "multiplier": "0", "offset": "0.25"})
    with pytest.raises(InputError, match=r"'k' mimics 'j' times 0, and does not move; hold it with held=\{'k': 0.25\}"):
        followers_on_way("r", robot, ["j", "k"], [])
    assert followers_on_way("r", robot, ["k"], ["j"]) == {}
