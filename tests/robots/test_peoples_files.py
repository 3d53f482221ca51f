"""URDF files as people have them: what kinematics does not use costs a note, and never the arm.

Pinocchio is the oracle of each kind: where it reads a file, so does kinreach, or says in one line why not.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from kinreach import cli
from kinreach.errors import InputError, NoShapesError
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import ArmDescription
from kinreach.robots.inside import ArmFlags, link_shapes
from kinreach.sim.inside import build_scene
from tests.robots.peoples_files import LIMIT, MASS, arm, joint, limits, shape

XACRO = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'
BALL = '<sphere radius="0.1"/>'
ROD = joint("rod", "l1", "r", inside=f'{LIMIT}<mimic joint="j2" multiplier="-0.25"/>')
SLIDES = '<limit lower="0.1" upper="3" effort="1" velocity="1"/>'
RAIL = '<link name="r"/>' + joint("rail", "r", "l0", kind="prismatic", inside=SLIDES, axis='<axis xyz="1 0 0"/>')
FLOATS = '<link name="w"/>' + joint("f", "w", "l0", kind="floating", inside="")


def material(colour, name="m"):
    return f'<material name="{name}"><color {colour}/></material>'


#: Kind of file -> its text, and what its notes say; "" where there is none.
READ = {
    "visual without size": (arm(links={6: shape('<box size="0 0 0"/>')}), "visual shape without size .*: link l6"),
    "collision without size": (arm(links={6: shape('<sphere radius="0"/>', "collision")}), "shape without size"),
    "without thickness": (arm(links={6: shape('<box size="1 1 0"/>')}), "without thickness is made 0.1 mm thick"),
    "size is text": (arm(links={6: shape('<box size="a b c"/>')}), "visual shape that cannot be read is left out"),
    "size of two numbers": (arm(links={6: shape('<box size="1 1"/>')}), "visual shape that cannot be read"),
    "size left out": (arm(links={6: shape("<box/>")}), "visual shape that cannot be read"),
    "no shape": (arm(links={6: shape("") + "<collision/>"}), "visual without a shape .*collision without a shape"),
    "two shapes in one": (arm(links={6: shape(f"{BALL}<box/>")}), ""),
    "three colours": (arm(links={6: shape(BALL, more=material('rgba="1 0 0"'))}), "three numbers .* opaque: link l6"),
    "three colours by name": (arm(more=material('rgba="1 0 0"')), "three numbers and is taken as opaque: material m"),
    "colour is text": (arm(links={6: shape(BALL, more=material('rgba="red"'))}), "colour that cannot be read"),
    "colour of bytes": (arm(links={6: shape(BALL, more=material('rgba="255 0 0 255"'))}), "up to 255"),
    "no colour": (arm(links={6: shape(BALL, more=material(""))}), "colour that cannot be read"),
    "unknown material": (arm(links={6: shape(BALL, more='<material name="no"/>')}), ""),
    "material twice": (arm(more=2 * material('rgba="1 0 0 1"')), ""),
    "effort -1": (arm(joints=limits('lower="-3" upper="3" effort="-1" velocity="1"', *range(1, 7))), "effort.*j1, j2"),
    "velocity -1": (arm(joints=limits('lower="-3" upper="3" effort="1" velocity="-1"', 2)), "speed.*: joint j2"),
    "no effort": (arm(joints=limits('lower="-3" upper="3" velocity="1"', 2)), "torque.* is missing .*: joint j2"),
    "effort is text": (arm(joints=limits('lower="-3" upper="3" effort="max" velocity=""', 2)), "torque.*speed"),
    "effort inf": (arm(joints=limits('lower="-3" upper="3" effort="inf" velocity="1e30"', 2)), "torque.*speed"),
    "plus and space": (arm(joints=limits('lower="-3.0" upper="+3.0 " effort="1" velocity="1"', 2)), ""),
    "held by its limits": (arm(joints=limits('lower="0.5" upper="0.5" effort="1" velocity="1"', 2)), "j2 cannot move"),
    "limits inf": (arm(joints=limits('lower="-inf" upper="inf" effort="1" velocity="1"', 2)), "wide.*: joint j2"),
    "limits 1e16": (arm(joints=limits('lower="-1e16" upper="1e16" effort="1" velocity="1"', 2)), "wide.*: joint j2"),
    "limits in degrees": (arm(joints=limits('lower="-180" upper="180" effort="1" velocity="1"', 2)), "j2 .*degrees"),
    "endless": (arm(joints={1: {"kind": "continuous", "inside": ""}}), ""),
    "endless with limits": (arm(joints={1: {"kind": "continuous", "inside": LIMIT.replace("-3.1", "-1e16")}}), ""),
    "no origin": (arm(joints={2: {"origin": ""}, 3: {"origin": "<origin/>"}}), ""),
    "origin over lines": (arm(joints={2: {"origin": '<origin xyz="0\t0.1\n 0"/>'}}), ""),
    "origin twice": (arm(joints={2: {"origin": '<origin xyz="0 0.2 0"/><origin xyz="9 9 9"/>'}}), ""),
    "no axis": (arm(joints={2: {"axis": ""}}), ""),
    "long axis": (arm(joints={2: {"axis": '<axis xyz="0 0 2"/>'}}), ""),
    "safety controller": (arm(joints={2: {"inside": f'{LIMIT}<safety_controller soft_lower_limit="-1"/>'}}), ""),
    "calibration": (arm(joints={2: {"inside": f'{LIMIT}<calibration rising="x"/>'}}), ""),
    "friction below zero": (arm(joints={2: {"inside": f'{LIMIT}<dynamics friction="-1"/>'}}), "friction .*: joint j2"),
    "no friction": (arm(joints={2: {"inside": f"{LIMIT}<dynamics/>"}}), ""),
    "mass below zero": (arm(links={3: MASS.replace('"1"', '"-1"')}), "mass or inertia .* left out: link l3"),
    "no mass": (arm(links={3: MASS.replace('<mass value="1"/>', "")}), "mass or inertia .* left out: link l3"),
    "mass without value": (arm(links={3: MASS.replace(' value="1"', "")}), "mass or inertia .* left out: link l3"),
    "inertia nan": (arm(links={3: MASS.replace('ixx="0.1"', 'ixx="nan"')}), "mass or inertia"),
    "inertia below zero": (arm(links={3: MASS.replace('ixx="0.1"', 'ixx="-0.1"')}), "mass or inertia"),
    "only a diagonal": (arm(links={3: re.sub('ix[yz]="0" |iyz="0" ', "", MASS)}), ""),
    "inertial twice": (arm(links={3: 2 * MASS}), ""),
    "empty inertial": (arm(links={3: "<inertial/>"}), "mass or inertia"),
    "for other programs": (
        arm(
            links={3: "<contact><lateral_friction value='1'/></contact><gazebo/>"},
            more='<gazebo reference="l1"><sensor:camera/></gazebo><transmission name="t"/><ros2_control name="c"/>'
            '<sensor name="s"/><mujoco><compiler meshdir="/etc"/></mujoco><loop_joint name="l"/>',
        ), ""),
    "default namespace": (arm(head='<robot name="a" xmlns="http://drake.mit.edu" xmlns:xsi="x" xsi:l="y">'), ""),
    "xacro's namespace": (arm(head=XACRO), ""),
    "leftover property": (arm(head=f'{XACRO}<xacro:property name="w" value=".2"/>'), "leftovers.*<xacro:property>$"),
    "leftover macro": (
        arm(head=f'{XACRO}<xacro:arg name="x"/><xacro:macro name="m"><link name="${{p}}l"/></xacro:macro>'),
        "leftovers of xacro are ignored: <xacro:arg>, <xacro:macro>$"),
    "undeclared xacro": (arm(head='<robot name="a"><xacro:property name="w"/>'), "<xacro:property>"),
    "leftover include": (
        arm(head=f'{XACRO}<xacro:include filename="$(find x)/materials.xacro"/>'),
        "ignored, with whatever they would add: <xacro:include>"),
    "leftover call": (arm(links={6: shape(BALL, more="<xacro:grey/>")}), "whatever they would add: <xacro:grey>"),
    "dashes in a comment": (arm(more="<!-- a -- b --><!-- <robot> -->"), ""),
    "ampersand": (arm(head='<robot name="a & b">'), ""),
    "document type": ("<!DOCTYPE robot>" + arm(), ""),
    "byte order mark": ('\ufeff<?xml version="1.0" encoding="utf-8"?>' + arm(), ""),
    "an empty line first": ('\n\n<?xml version="1.0"?>' + arm(), ""),
    "Latin-1": (('<?xml version="1.0" encoding="ISO-8859-1"?><!-- Größe -->' + arm()).encode("latin-1"), ""),
    "Latin-1 that is not declared": (("<!-- Größe -->" + arm()).encode("latin-1"), ""),
    "UTF-16": (('<?xml version="1.0" encoding="utf-16"?>' + arm()).encode("utf-16"), ""),
    "Windows": (arm().replace("><", ">\r\n<"), ""),
    "floats": (arm(more=FLOATS), "joint f floats and is held where the file has it"),
    "planar beside": (
        arm(more='<link name="w"/>' + joint("f", "l2", "w", kind="planar", inside="")), "joint f floats and is held"),
    "fixed with all": (
        arm(more='<link name="w"/>'
            + joint("f", "l6", "w", kind="fixed", inside='<limit effort="-1"/><mimic joint="j2"/>')), ""),
    "a rod that mimics": (arm(more='<link name="r"/>' + ROD), "joint rod follows the arm beside the way to the tip"),
    "a rod that mimics the last joint": (arm(more='<link name="r"/>' + ROD.replace("j2", "j6")), "joint rod follows"),
    "a rod that mimics a rod": (
        arm(more='<link name="r"/><link name="s"/>' + ROD
            + joint("rod2", "r", "s", inside=f'{LIMIT}<mimic joint="rod" offset="0.1"/>')),
        "joints rod, rod2 follow the arm beside"),
    "mimics nobody": (arm(more='<link name="r"/>' + ROD.replace('"j2"', '"nobody"')), "joint rod of a gripper is held"),
    "mimics itself": (arm(more='<link name="r"/>' + ROD.replace('"j2"', '"rod"')), "joint rod of a gripper is held"),
    "on a rail": (arm(more=RAIL), "joint rail slides and is held at 0.1 m.*held="),
    "world turns": (arm().replace('"l0"', '"world"'), ""),
    "world carries": (
        arm(more='<link name="world"/>'
            + joint("w", "world", "l0", kind="fixed", inside="", origin='<origin xyz="1 2 3" rpy="0 0 1"/>')), ""),
    "world on a map": (
        arm(more='<link name="map"/><link name="world"/>'
            + joint("m", "map", "world", kind="fixed", inside="", origin='<origin xyz="1 2 3" rpy="0 0 1"/>')
            + joint("w", "world", "l0", kind="fixed", inside="", origin='<origin xyz="0 0 1"/>')),
        "the link world is not the first, and is called world_1"),
    "URDF 1.2": (
        arm(joints={2: {"origin": '<origin xyz="0 1 0" quat_xyzw="0 0 0.6 0.8"/>'}}, head='<robot version="1.2">'),
        "a quaternion is taken as the rotation of its <origin>: joint j2"),
}  # fmt: skip
#: Those that Pinocchio does not read, from version 4 on.
STRICT_SINCE_4 = {"effort -1", "velocity -1", "friction below zero"}
#: Those that no version reads.
STRICT = {
    "material twice", "no effort", "effort is text", "effort inf", "plus and space", "limits inf", "origin over lines",
    "safety controller", "calibration", "no friction", "UTF-16", "URDF 1.2", "fixed with all",
}  # fmt: skip
REFUSED = {
    "no limit": (arm(joints={2: {"inside": ""}}), "joint 'j2' of the URDF is revolute and has no <limit>"),
    "empty limit": (arm(joints=limits("", 2)), "'j2' cannot move, its limits are 0 and 0 rad.* (held=|--hold j2=0)"),
    "limits 0": (arm(joints=limits('lower="0" upper="0" effort="1" velocity="1"', 2)), "'j2' cannot move"),
    "limits exchanged": (arm(joints=limits('lower="1" upper="-1" effort="1" velocity="1"', 2)), "'j2'.*1 > -1"),
    "limits nan": (arm(joints=limits('lower="nan" upper="1" effort="1" velocity="1"', 2)), "got 'nan', in joint 'j2'"),
    "decimal comma": (arm(joints=limits('lower="-3,1" upper="3,1" effort="1" velocity="1"', 2)), "'-3,1', in joint"),
    "commas": (arm(joints={2: {"origin": '<origin xyz="0,0.1,0"/>'}}), "xyz of <origin>.*'0,0.1,0', in joint 'j2'"),
    "zero axis": (arm(joints={2: {"axis": '<axis xyz="0 0 0"/>'}}), "'j2'.*axis without direction: '0 0 0'"),
    "empty axis": (arm(joints={2: {"axis": "<axis/>"}}), "'j2'.*axis without direction"),
    "bad quaternion": (arm(joints={2: {"origin": '<origin quat_xyzw="0 0 0 0"/>'}}), "quat_xyzw .* in joint 'j2'"),
    "two links of one name": (arm(more='<link name="l3"/>'), "names 'l3' 2 times"),
    "two roots": (arm(more='<link name="loose"/>'), "must hang on one, got 2"),
    "ball joint": (arm(joints={2: {"kind": "ball"}}), "joint 'j2' .* must be one of revolute.* got 'ball'"),
    "capital": (arm(joints={2: {"kind": "Revolute"}}), "joint 'j2' .* got 'Revolute'"),
    "floats amid": (arm(joints={3: {"kind": "floating", "inside": ""}}), "'j3' is floating, between joints that turn"),
    "mimics none": (arm(joints={3: {"inside": f'{LIMIT}<mimic joint="j9"/>'}}), "'j3' mimics 'j9', which is not in"),
    "mimics itself": (
        arm(joints={i: {"inside": f'{LIMIT}<mimic joint="j{j}"/>'} for i, j in ((2, 3), (3, 2))}),
        "'j3' mimics 'j2', which follows it"),
    "two robots": (arm() + arm(), "not XML: junk after document element"),
    "entity": ('<!DOCTYPE robot [<!ENTITY w "0.4">]>' + arm(), "must not have a document type"),
    "another file's type": ('<!DOCTYPE robot SYSTEM "/etc/x.dtd">' + arm(), "must not have a document type"),
    "expression": (
        arm(head=f'{XACRO}<xacro:property name="w" value="0.4"/>').replace('"0.4 0 0"', '"${w} 0 0"'),
        "is xacro.*run `xacro .*a.urdf > .*a_expanded.urdf`"),
    "argument": (arm().replace('"l3"', '"$(arg prefix)l3"'), "is xacro.*a_expanded.urdf`"),
    "SDF": (
        '<sdf version="1.6"><model name="a"/></sdf>',
        "must begin with <robot> or <mujoco>, got <'sdf'>: this is Gazebo's SDF.*sdf2mjcf",
    ),
    "an empty MJCF": ('<mujoco model="a"/>', "no joint moves the tip"),
}  # fmt: skip


def write(folder: Path, text: str | bytes, name: str = "a.urdf") -> Path:
    file = folder / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return file


def off(file: Path, kin: ArmKinematics, held: dict[str, float] | None = None, *, tip: str = "") -> float:
    """How far the poses of an arm, in world, are from Pinocchio's by the file itself."""
    model = pin.buildModelFromUrdf(str(file))
    data, frame = model.createData(), model.getFrameId(tip or kin.arm.tips[kin.tip], pin.BODY)
    low, high = np.maximum(kin.lower, -3), np.minimum(kin.upper, 3)
    worst = 0.0
    for q in np.random.default_rng(0).uniform(low, high, (20, kin.n)):
        full, places = pin.neutral(model), dict(zip(kin.arm.joints, q.tolist(), strict=True)) | (held or {})
        for index in range(1, model.njoints):
            part, name = model.joints[index], model.names[index]
            lower, upper = model.lowerPositionLimit[part.idx_q], model.upperPositionLimit[part.idx_q]
            place = places.get(name, min(max(0.0, lower), upper))
            if part.nq == 2:
                full[part.idx_q : part.idx_q + 2] = np.cos(place), np.sin(place)
            elif part.nq == 1:
                full[part.idx_q] = place
        pin.framesForwardKinematics(model, data, full)
        worst = max(worst, float(np.abs(data.oMf[frame].homogeneous - kin.fk(q)).max()))
    return worst


@pytest.mark.parametrize("name", READ)
def test_what_kinematics_does_not_use_costs_a_note(tmp_path, name):
    text, said = READ[name]
    file = write(tmp_path, text)
    described = ArmDescription.from_urdf(file)
    assert bool(described.notes) is bool(said), described.notes
    assert re.search(said, " | ".join(described.notes))
    assert not any("\n" in note for note in described.notes)
    assert described.missing_shapes == ""
    kin = ArmKinematics(described, base="world")
    assert described.joints == tuple(f"j{i}" for i in range(1, 7) if name != "held by its limits" or i != 2)
    assert described.base == {"world carries": "l0", "world turns": "world", "world on a map": "map", "floats": "w",
                              "on a rail": "r"}.get(name, "l0")  # fmt: skip
    if name in STRICT or (name in STRICT_SINCE_4 and int(pin.__version__.split(".")[0]) >= 4):
        with pytest.raises(ValueError, match=r"valid URDF|are greater than max"):
            pin.buildModelFromUrdf(str(file))
    else:
        assert off(file, kin) < 1e-12
    link_shapes(described)
    if "<collision>" not in described.urdf:
        with pytest.raises(NoShapesError, match="has no collision shapes"):
            CollisionChecker(described)


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_used_is_refused_in_one_line(tmp_path, capsys, name):
    text, said = REFUSED[name]
    file = write(tmp_path, text)
    with pytest.raises(InputError, match=said) as caught:
        ArmDescription.from_urdf(file)
    assert "\n" not in str(caught.value)
    assert cli.main(["check", str(file), "--poses", "2"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(said, line)
    assert line.startswith("kinreach check: error: ")


PLACE = '<origin xyz="0 0.01 0.02" rpy="0.1 0 0.2"/>'
#: An arm with every part that a reader knows.
FULL = arm(
    links={
        2: MASS.replace("<mass", f"{PLACE}<mass")
        + shape('<box size="0.05 0.06 0.07"/>', "collision", PLACE)
        + shape('<cylinder radius="0.02" length="0.1"/>', more=material('rgba="0.5 0.6 0.7 1"', "own") + PLACE),
        4: shape('<capsule radius="0.02" length="0.1"/>', "collision", PLACE)
        + shape('<mesh filename="box.stl" scale="1 1 1"/>', more='<material name="shared"/>'),
    },
    joints={2: {"axis": '<axis xyz="0.6 0 0.8"/>', "inside": f'{LIMIT}<dynamics damping="0.1" friction="0.2"/>'}},
    more=material('rgba="1 0 0 1"', "shared") + '<link name="r"/>' + ROD,
)


@pytest.mark.parametrize("part", ["l2", "l4", "j2", "rod", "shared"])
def test_whatever_is_left_out_of_a_part_the_arm_is_that_of_the_file_or_refused_in_one_line(tmp_path, part):
    """Each attribute and each element in turn."""
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "box.stl")
    whole, read, refused = ET.fromstring(FULL), 0, 0
    (place,) = (i for i, each in enumerate(whole) if each.get("name") == part)
    for index, element in enumerate(whole[place].iter()):
        for key in (*element.attrib, None):
            changed = copy.deepcopy(whole)
            lacking = list(changed[place].iter())[index]
            if key is not None:
                del lacking.attrib[key]
            else:
                next(each for each in changed.iter() if lacking in list(each)).remove(lacking)
            file = write(tmp_path, ET.tostring(changed, encoding="unicode"))
            try:
                described, said = ArmDescription.from_urdf(file), ""
            except InputError as error:
                said = str(error)
            if said:
                assert re.fullmatch(r".*(joint '(j2|j4|rod)'|name|must hang on one).*", said)  # one line
                refused += 1
                continue
            assert not any("\n" in note for note in described.notes)
            link_shapes(described)
            with contextlib.suppress(ValueError):  # of what Pinocchio does not read
                assert part not in ("j2", "rod") or off(file, ArmKinematics(described, base="world")) < 1e-12
            read += 1
    assert read >= (0 if part == "rod" else 2)
    assert refused >= (0 if part == "shared" else 1)
    assert read + refused >= 4


@pytest.mark.parametrize("named", ["", 'name=""'])
@pytest.mark.parametrize(
    "inside",
    [
        shape(BALL, more=material('rgba="1 0 0"')),
        shape(BALL, more=material('rgba="red"')),
        MASS.replace('mass value="1"', 'mass value="-1"'),
        shape('<sphere radius="big"/>', "collision"),
        shape('<box size="1 1 0"/>'),
        shape('<mesh filename="a.stl" scale="2"/>'),
        shape(""),
    ],
)
def test_a_part_without_a_name_is_refused_whatever_else_is_repaired(tmp_path, named, inside):
    link = f"<link {named}>{inside}</link>"
    with pytest.raises(InputError, match="the URDF has a nameless part"):
        ArmDescription.from_urdf(write(tmp_path, arm(more=link)))
    text = arm(joints=limits('lower="-3" upper="3" effort="max" velocity="-1"', 6)).replace('name="j6"', named)
    with pytest.raises(InputError, match="joint without a name"):
        ArmDescription.from_urdf(write(tmp_path, text))


#: Collision shapes that are unread cost the collisions.
UNREAD = {
    "below zero": ('<box size="-1 1 1"/>', "size of <box> is '-1 1 1'"),
    "text": ('<sphere radius="big"/>', "radius of <sphere> is 'big'"),
    "two numbers": ('<box size="1 1"/>', "size of <box> is '1 1'"),
    "left out": ('<cylinder radius="1"/>', "length of <cylinder> is ''"),
    "unknown": ('<plane normal="0 0 1"/>', "<plane> is not one of mesh, box, cylinder, sphere, capsule"),
    "infinite": ('<sphere radius="inf"/>', "radius of <sphere> is 'inf'"),
    "scale of two": ('<mesh filename="box.stl" scale="1 1"/>', "scale of <mesh> is '1 1'"),
    "scale of zero": ('<mesh filename="box.stl" scale="0 0 0"/>', "scale of <mesh> is '0 0 0'"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNREAD)
def test_a_collision_shape_that_is_unread_costs_the_collisions(tmp_path, name):
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "box.stl")
    ball = shape(BALL, "collision")
    for more in ("", "<origin xyz='0 0 x'/>"):
        solid, said = UNREAD[name] if not more else (BALL, """its <origin> is 'xyz="0 0 x"'""")
        file = write(tmp_path, arm(links={1: MASS + ball, 6: MASS + shape(solid, "collision", more)}))
        described = ArmDescription.from_urdf(file)
        (note,) = described.notes
        assert note.startswith("no collision checks and no simulation: the collision shape of link 'l6' cannot be read")
        assert said in note
        assert off(file, ArmKinematics(described, base="world")) < 1e-12
        for use in (CollisionChecker, build_scene):
            with pytest.raises(NoShapesError, match="the collision shape of link 'l6'"):
                use(described)


def test_a_capsule_is_a_cylinder_between_two_spheres(tmp_path):
    place = '<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>'
    capsule = shape('<capsule radius="0.03" length="0.2"/>', "collision", place)
    links = dict.fromkeys(range(7), MASS) | {1: MASS + shape(BALL, "collision"), 6: MASS + capsule}
    described = ArmDescription.from_urdf(write(tmp_path, arm(links=links)))
    shapes = [each for each in link_shapes(described, "collision") if each.link == "l6"]
    points = np.concatenate([each.vertices for each in shapes])
    T = pin.XYZQUATToSE3(np.array([0.1, 0.2, 0.3, *pin.Quaternion(pin.rpy.rpyToMatrix(0.4, 0.5, 0.6)).coeffs()]))
    local = (points - T.translation) @ T.rotation
    away = np.linalg.norm(local - np.clip(local, (0, 0, -0.1), (0, 0, 0.1)), axis=1)
    assert len(shapes) == 3
    np.testing.assert_allclose(away.max(), 0.03, atol=1e-4)
    np.testing.assert_allclose(np.ptp(local, axis=0), (0.06, 0.06, 0.26), atol=1e-3)
    assert build_scene(described).compile().nq == 6


def test_what_is_on_a_rod_is_not_checked(tmp_path):
    """A rod that stands still would collide where the real one swings away."""
    bodies = {i: MASS + shape('<cylinder radius="0.02" length="0.1"/>', "collision") for i in range(7)}
    box = shape('<box size="0.6 0.1 0.1"/>', "collision")
    rod = f'<link name="r">{MASS}{box}</link>'
    free = ArmDescription.from_urdf(write(tmp_path, arm(links=bodies, more=rod + ROD)))
    assert "r" not in {name for pair in CollisionChecker(free).pairs for name in pair}
    held = ArmDescription.from_urdf(write(tmp_path, arm(links=bodies, more=rod + ROD)), held={"rod": 0.5})
    assert held.notes == ()
    assert "r" in {name for pair in CollisionChecker(held).pairs for name in pair}
    assert build_scene(free).compile().nq == 6


@pytest.mark.parametrize("places", [{"rail": 0.7}, {"rail": 3.0}])
def test_a_rail_is_held_where_it_is_wanted(tmp_path, capsys, places):
    file = write(tmp_path, arm(more=RAIL))
    described = ArmDescription.from_urdf(file, held=places)
    kin = ArmKinematics(described, base="world")
    assert (described.notes, described.base) == ((), "r")
    assert off(file, kin, places) < 1e-12
    flag = [f"{name}={value}" for name, value in places.items()]
    T = kin.fk(np.full(6, 0.3))
    pose = ",".join(map(repr, [*T[:3, 3].tolist(), *pin.log3(T[:3, :3]).tolist()]))
    found = []
    for words in ([], ["--hold", *flag]):
        cli.main(["ik", "--arm", str(file), "--pose", pose, "--seed", ",".join(["0.3"] * 6), *words])
        done = capsys.readouterr()
        assert ("rail slides and is held at 0.1 m" in done.err) is not words
        found += [line for line in done.out.splitlines() if line.startswith("*")] or [""]
    assert re.search(r"0\.30000( +0\.30000){5}", found[1])
    assert found[0] != found[1]


@pytest.mark.parametrize(
    ("flag", "said"),
    [
        ("rail=5", "rail' must be within its limits, 0.1 to 3 m, got 5"), ("rail", "--hold must be JOINT=VALUE"),
        ("rial=1", "unknown joint.*did you mean rail"), ("rail=x", "--hold rail must be a number, got 'x'"),
        ("j6=90", "'j6' must be within its limits, -3.1 to 3.1 rad, got 90; it is in radians, not degrees"),
    ],
)  # fmt: skip
def test_places_that_cannot_be_are_named(tmp_path, capsys, flag, said):
    file = str(write(tmp_path, arm(more=RAIL)))
    assert cli.main(["check", file, "--hold", flag, "--poses", "2"]) == 2
    assert re.search(said, capsys.readouterr().err)
    assert (
        cli.main(["check", "ur5e", "--hold", flag.replace("rail=x", "a=1").replace("rail", "a=1"), "--poses", "2"]) == 2
    )
    assert "--hold is for URDF and MJCF files" in capsys.readouterr().err or "=" not in flag


def test_held_joints_that_turn_are_in_degrees_where_angles_are(tmp_path, capsys):
    file = str(write(tmp_path, arm(more=RAIL)))
    parser = argparse.ArgumentParser()
    ArmFlags.add_to(parser)
    for words in (["j6=90", "--hold", "rail=0.5"], ["j6=90, rail=0.5"]):
        for degrees, turned in (({"degrees": True}, np.pi / 2), ({"degrees": False}, 90.0), ({}, 90.0)):
            given = argparse.Namespace(arm=file, **degrees)
            held = ArmFlags.of(parser.parse_args(["--hold", *words], given)).held
            assert held == {"j6": turned, "rail": 0.5}
    assert cli.main(["ik", "--arm", file, "--pose", "1,0.1,0.3,0,0,0", "--hold", "j6=90", "--degrees"]) == 1
    assert "tip l5 in base_link" in capsys.readouterr().out


#: Links behind the flange, each on the one before or on a link that is named -> the tip, and what is passed over.
BEHIND = {
    "camera": (["tool0", "camera_link", "camera_optical_frame"], "tool0", "camera_optical_frame"),
    "bracket": (["flange", "camera_mount", "bracket", "d435_color_frame"], "flange", "d435_color_frame"),
    "on a camera": (["ee_link", "realsense_link", "left_frame"], "ee_link", "left_frame"),
    "imu": (["tool0", "wrist_imu"], "tool0", "wrist_imu"),
    "force": (["tool0", "ft_sensor", "tcp"], "tcp", ""),
    "force only": (["tool0", "force_torque_sensor"], "tool0", "force_torque_sensor"),
    "laser": (["tool0", "laser_scanner_link", "laser_tool_tip"], "laser_tool_tip", ""),
    "gripper": (["tool0", "gripper_base", "grasp_frame"], "grasp_frame", ""),
    "camshaft": (["tool0", "camshaft", "zedong"], "zedong", ""),
    "simulated": (["tool0", "simulated_part"], "simulated_part", ""),
    "only a camera": (["camera_link"], "l6", "camera_link"),
}


@pytest.mark.parametrize("name", BEHIND)
def test_the_tip_is_no_camera_where_there_is_a_flange(tmp_path, name):
    links, tip, passed = BEHIND[name]
    more = "".join(f'<link name="{link}"/>' for link in links)
    for before, link in zip(["l6", *links], links, strict=False):
        more += joint(f"{link}_joint", before, link, kind="fixed", inside="", origin='<origin xyz="0 0 0.05"/>')
    file = write(tmp_path, arm(more=more))
    described = ArmDescription.from_urdf(file)
    assert described.default_tip == tip
    assert set(described.tips) == {"l6", *links}
    assert off(file, ArmKinematics(described, base="world")) < 1e-12
    if passed:
        (note,) = described.notes
        assert note.startswith(f"the tip is {tip}; give tip= for {passed}, which is a sensor's by its name")
        assert all(link in note for link in links)
        chosen = ArmDescription.from_urdf(file, tip=passed)
        assert (chosen.default_tip, chosen.notes) == (passed, ())
    else:
        assert described.notes == ()


@pytest.mark.parametrize("text", ["a.sdf", "a.usd", "mesh.stl", "folder/robot", "a.zip", ".", "program.py", "a.csv"])
def test_other_files_are_no_unknown_arms(tmp_path, capsys, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    for there in (False, True):
        if there and text != ".":
            (tmp_path / text).parent.mkdir(exist_ok=True)
            (tmp_path / text).write_text("<sdf/>")
        for words in (["check", text], ["ik", "--arm", text, "--pose", "0,0,0,0,0,0"]):
            assert cli.main(words) == 2
            (line,) = capsys.readouterr().err.splitlines()
            assert "unknown" not in line
            assert re.search(
                r"an arm is a URDF or MJCF file \(\.urdf, \.xml, \.mjcf, \.xacro\), or one of .*ur5e", line
            )
    assert cli.main(["check", "ur6"]) == 2
    assert "unknown arm 'ur6'" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["arm.urdf", "arm.URDF", "arm.xacro", "arm.urdf.xacro", "an arm.urdf", "arm.xml"])
def test_no_advice_writes_onto_a_file_that_is_there(tmp_path, name):
    """`xacro a.urdf > a.urdf` empties a.urdf before xacro reads it."""
    file = write(tmp_path, arm().replace('"l3"', '"${l}3"'), name)
    seen = {file}
    for _ in range(4):
        with pytest.raises(InputError, match="is xacro") as caught:
            ArmDescription.from_urdf(file)
        source, target = re.search(r"run `xacro (.+) > (.+)`, with", str(caught.value)).groups()
        assert source.strip("'") == str(file)
        other = Path(target.strip("'"))
        assert (other.parent, other.suffix) == (tmp_path, ".urdf")
        assert other not in seen
        assert not other.exists()
        seen.add(other)
        other.write_text("")
    assert len(seen) == 5


def test_a_xacro_file_that_is_complete_is_read(tmp_path):
    file = write(tmp_path, arm(head=f'{XACRO}<xacro:property name="w" value="1"/>'), "a.urdf.xacro")
    assert len(ArmDescription.from_urdf(file).joints) == 6
    file = write(tmp_path, arm(head=f'{XACRO}<xacro:include filename="gripper.xacro"/>'), "a.urdf.xacro")
    with pytest.raises(InputError, match="is xacro"):
        ArmDescription.from_urdf(file)
    parts = arm(head=XACRO).replace('<link name="l6"></link>', '<xacro:last_link name="l6"/>')
    with pytest.raises(InputError, match="is xacro"):
        ArmDescription.from_urdf(write(tmp_path, parts))
