"""Arms from MuJoCo's MJCF files, beside MuJoCo's own kinematics and contacts, and Pinocchio's reader."""

from __future__ import annotations

import itertools
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from kinreach import cli
from kinreach._rotations import pose, pose_vector
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CollisionChecker, URKinematics
from kinreach.kinematics.inside import link_frame
from kinreach.robots import ArmDescription, _mjcf
from kinreach.robots._registry import arm_named
from kinreach.robots.inside import link_shapes
from kinreach.sim import ArmSimulation

#: Six joints with a spherical wrist, a gripper on a tendon, a floor, a loose cube and a target.
ARM = """
<mujoco model="six">
  <compiler angle="degree" meshdir="parts" eulerseq="zyx"/>
  <include file="defaults.xml"/>
  <asset>
    <mesh file="plate.stl" scale="0.001 0.001 0.001" refpos="10 0 0"/>
    <texture name="wood" type="2d" file="missing.png"/>
    <material name="blue" rgba="0.1 0.2 0.9 1" texture="wood"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 0.1"/>
    <body name="cube" pos="1 0 1"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
    <body name="goal" mocap="true"><geom type="sphere" size="0.05" contype="0" conaffinity="0"/></body>
    <body name="pedestal" pos="0.1 0.2 0.3" euler="30 0 0" childclass="arm">
      <geom type="cylinder" size="0.15 0.1" material="blue"/>
      <body name="turret" pos="0 0 0.15">
        <joint name="a1" axis="0 0 1" range="-170 170" actuatorfrcrange="-40 40"/>
        <geom type="capsule" fromto="0 0 0 0 0.1 0" size="0.04"/>
        <body name="upper" pos="0 0.1 0" euler="0 0 90">
          <joint name="a2" range="-120 120"/>
          <geom type="box" pos="0.2 0 0" size="0.2 0.03 0.03"/>
          <body name="fore" pos="0.4 0 0">
            <joint name="a3" range="-150 150" pos="0 0 0.02"/>
            <geom class="drawn" mesh="plate" material="blue"/>
            <geom type="mesh" mesh="plate" pos="0.1 0 0" mass="0"/>
            <inertial pos=".1 0 0" mass="2" diaginertia=".01 .01 .01"/>
            <body name="w1" pos="0.35 0 0" euler="0 90 0">
              <joint name="a4" range="-180 180" ref="20"/><inertial pos="0 0 0" mass=".1" diaginertia=".001 .001 .001"/>
              <body name="w2" axisangle="0 1 0 -90">
                <joint name="a5"/><inertial pos="0 0 0" mass=".1" diaginertia=".001 .001 .001"/>
                <body name="w3" euler="0 90 0">
                  <joint name="a6"/>
                  <geom type="ellipsoid" size="0.02 0.03 0.05"/>
                  <site name="flange" pos="0 0 0.09" euler="45 0 0"/>
                  <body name="left" pos="0 0.03 0.09">
                    <joint name="l" type="slide" axis="0 1 0" range="0 0.04"/><geom type="box" size="0.01 0.005 0.03"/>
                  </body>
                  <body name="right" pos="0 -0.03 0.09">
                    <joint name="r" type="slide" axis="0 -1 0" range="0 0.04"/><geom type="box" size="0.01 0.005 0.03"/>
                  </body>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="w3" body2="left"/><exclude body1="fore" body2="w3"/></contact>
  <tendon><fixed name="grip"><joint joint="l" coef="1"/><joint joint="r" coef="1"/></fixed></tendon>
  <actuator>
    <position joint="a5" kp="10" ctrlrange="-2 2" forcerange="-7 7" gear="2"/>
    <motor tendon="grip"/>
  </actuator>
  <keyframe>
    <key name="other" qpos="0 0 0 1 0 0 0 0 0 0 0 0 0 0 0"/>
    <key name="home" qpos="0 0 0 1 0 0 0 0.1 0.2 0.3 0.4 0.5 0.6 0.01 0.01"/>
  </keyframe>
</mujoco>
"""
DEFAULTS = """
<mujocoinclude>
  <default>
    <default class="arm">
      <joint axis="0 0 1" damping="0.5" frictionloss="0.1" armature="0.02"/>
      <geom group="3" density="500"/>
      <default class="drawn"><geom type="mesh" group="2" contype="0" conaffinity="0" mass="0"/></default>
    </default>
  </default>
</mujocoinclude>
"""
BALL = '<geom size="0.1"/>'
TWO = (
    '<mujoco><worldbody><body name="b"><joint name="one"/><geom size="0.1"/>'
    '<body name="c" pos="1 0 0"><joint name="two"/><geom size="0.1"/>{}</body></body></worldbody>{}</mujoco>'
)


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("menagerie")
    (folder / "parts").mkdir()
    trimesh.creation.box((200.0, 40.0, 30.0)).export(folder / "parts" / "plate.stl")
    (folder / "defaults.xml").write_text(DEFAULTS)
    (folder / "six.xml").write_text(ARM)
    return folder / "six.xml"


@pytest.fixture(scope="module")
def arm(file) -> ArmDescription:
    return ArmDescription.from_file(file)


@pytest.fixture(scope="module")
def model(file):
    text = (file.parent / "six.xml").read_text().replace('<texture name="wood" type="2d" file="missing.png"/>', "")
    whole = file.with_name("whole.xml")
    whole.write_text(text.replace(' texture="wood"', ""))
    return mujoco.MjModel.from_xml_path(str(whole))


def placed(model, joints, q, name, place=None):
    """Pose of a site or body by MuJoCo (4, 4)."""
    data = mujoco.MjData(model)
    for joint, angle in {**dict(zip(joints, q, strict=True)), **(place or {})}.items():
        data.qpos[model.joint(joint).qposadr[0]] = angle
    mujoco.mj_kinematics(model, data)
    sites = [model.site(i).name for i in range(model.nsite)]
    found = data.site(name) if name in sites else data.body(name)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = found.xmat.reshape(3, 3), found.xpos
    return T


def test_what_the_arm_is(arm):
    assert (arm.name, arm.base, arm.default_tip) == ("six", "pedestal", "flange")
    assert arm.joints == ("a1", "a2", "a3", "a4", "a5", "a6")
    assert set(arm.tips) == {"flange", "w3", "left", "right"}
    np.testing.assert_allclose(arm.home, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    assert arm.joint_damping == (0.5,) * 6
    assert not arm.missing_shapes
    assert any("cube, goal are no part of the arm" in note for note in arm.notes)
    assert any("joints l, r of a gripper are held" in note for note in arm.notes)
    limits = {joint.get("name"): joint.find("limit") for joint in arm.robot.findall("joint")}
    assert float(limits["a1"].get("effort")) == 40.0
    assert float(limits["a5"].get("effort")) == 14.0
    assert float(limits["a5"].get("upper")) == 1.0  # its servo is commanded to 2 over a gear of 2


def test_forward_kinematics_is_mujocos(file, arm, model):
    kin = ArmKinematics.of(arm, base="world")
    assert kin.knows_all_postures
    rng = np.random.default_rng(0)
    for tip in arm.tips:
        kin = ArmKinematics(arm, base="world", tip=tip)
        for q in rng.uniform(*kin.sampling_limits, (50, 6)):
            np.testing.assert_allclose(kin.fk(q), placed(model, arm.joints, q, tip), atol=1e-12)
    held = ArmKinematics.from_file(file, held={"l": 0.03, "r": 0.02}, tip="left", base="world")
    np.testing.assert_allclose(held.fk(arm.home), placed(model, arm.joints, arm.home, "left", {"l": 0.03}), atol=1e-12)


def test_masses_are_mujocos(arm, model):
    links = {link.get("name"): link.find("inertial") for link in arm.robot.findall("link")}
    tried = 0
    for name in ("turret", "upper", "w3", "left"):
        mass, inertia = links[name].find("mass"), links[name].find("inertia")
        np.testing.assert_allclose(float(mass.get("value")), model.body(name).mass[0])
        moments = [float(inertia.get(key)) for key in ("ixx", "iyy", "izz")]
        np.testing.assert_allclose(moments, model.body(name).inertia, atol=1e-15)
        tried += 1
    assert tried == 4


def test_contacts_are_mujocos(arm, model):
    """Of a mesh, boxes, cylinders and capsules; only the capsule around an ellipsoid touches earlier."""
    checker, rng = CollisionChecker(arm), np.random.default_rng(1)
    kin, touched, agree = checker.kinematics, 0, 0
    assert arm.meshes == "hulls"
    own = {"pedestal", "turret", "upper", "fore", "w3", "left", "right"}
    assert {"w3", "left"} not in [set(pair) for pair in checker.pairs]
    data = mujoco.MjData(model)
    for q in rng.uniform(*kin.sampling_limits, (400, 6)):
        data.qpos[:] = model.qpos0
        for joint, angle in zip(arm.joints, q, strict=True):
            data.qpos[model.joint(joint).qposadr[0]] = angle
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        pairs = {frozenset(model.body(model.geom(g).bodyid[0]).name for g in each.geom) for each in data.contact}
        expected = {pair for pair in pairs if pair <= own and "w3" not in pair}
        found = {frozenset(pair) for pair in checker.contacts(q)}
        touched += bool(expected)
        agree += expected == {pair for pair in found if "w3" not in pair}
        assert {pair for pair in pairs if pair <= own} <= found | {frozenset(("left", "right"))}
    assert touched > 40
    assert agree >= 398  # touches to a micrometre may differ


def test_meshes_are_placed_as_in_mujoco(arm):
    (drawn,) = [shape for shape in link_shapes(arm) if shape.link == "fore"]
    np.testing.assert_allclose(drawn.vertices.min(axis=0), (-0.11, -0.02, -0.015), atol=1e-7)
    np.testing.assert_allclose(drawn.rgba, (0.1, 0.2, 0.9, 1.0))


def test_it_moves_in_simulation(arm):
    simulation = ArmSimulation(arm)
    assert simulation.move(np.array(arm.home) + 0.1).status.name == "REACHED"


def random_chain(rng: np.random.Generator, *, plain: bool) -> str:
    """A chain of bodies with placements of every kind; plain without anchors, references and second joints."""

    def number(*shape, scale=1.0):
        return " ".join(repr(float(value)) for value in rng.normal(size=shape or 1, scale=scale).ravel())

    degrees = not plain and rng.integers(2) == 1
    order = "xyz" if plain else rng.choice(["xyz", "XYZ", "zyx", "ZXZ"])
    head = f'<compiler angle="{"degree" if degrees else "radian"}" eulerseq="{order}"/>'
    ways = [lambda: f'quat="{number(4)}"', lambda: f'euler="{number(3, scale=40.0 if degrees else 1.0)}"', lambda: ""]
    ways += [] if plain else [lambda: f'zaxis="{number(3)}"', lambda: f'xyaxes="{number(6)}"']
    text, ends = "", ""
    for body in range(int(rng.integers(3, 8))):
        text += f'<body name="b{body}" pos="{number(3, scale=0.3)}" {ways[rng.integers(len(ways))]()}>'
        text += f'<inertial pos="{number(3, scale=0.1)}" mass="1" diaginertia="0.1 0.1 0.1"/>'
        for joint in range(1 if plain else int(rng.integers(0, 3))):
            more = "" if plain else f'pos="{number(3, scale=0.1)}" ref="{number(scale=20.0 if degrees else 0.5)}"'
            end = 170 if degrees else 3
            text += f'<joint name="j{body}_{joint}" axis="{number(3)}" range="-{end} {end}" {more}/>'
        text += f'<site name="s{body}" pos="{number(3, scale=0.2)}" {ways[rng.integers(len(ways))]()}/>'
        ends += "</body>"
    return f"<mujoco>{head}<worldbody>{text}{ends}</worldbody></mujoco>"


@pytest.mark.parametrize("plain", [True, False])
def test_random_chains(tmp_path, plain):
    rng, tried, joints = np.random.default_rng(plain), 0, 0
    for number in range(20):
        text = random_chain(rng, plain=plain)
        file = tmp_path / f"chain{number}.xml"
        file.write_text(text)
        model = mujoco.MjModel.from_xml_string(text)
        if model.njnt == 0:
            continue
        tip = f"s{model.nbody - 2}"
        if model.body_jntnum[-1] == 0:
            tip = f"s{int(model.jnt_bodyid[-1]) - 1}"
        kin = ArmKinematics(ArmDescription.from_file(file, tip=tip), base="world")
        assert kin.n == sum(model.jnt_bodyid <= int(tip[1:]) + 1)
        other = pin.buildModelFromMJCF(str(file)) if plain else None
        for q in rng.uniform(*kin.sampling_limits, (5, kin.n)):
            T = placed(model, kin.arm.joints, q, tip)
            np.testing.assert_allclose(kin.fk(q), T, atol=1e-12)
            if other is not None:  # it places sites otherwise; bodies it has right
                data = other.createData()
                body = placed(model, kin.arm.joints, q, f"b{tip[1:]}")
                pin.framesForwardKinematics(other, data, q)
                np.testing.assert_allclose(data.oMf[other.getFrameId(f"b{tip[1:]}")].homogeneous, body, atol=1e-9)
            tried += 1
        joints += kin.n
    assert tried >= 85
    assert joints >= 65


def test_a_ur_is_one(tmp_path):
    """Its axes as bodies: the UR's closed form."""
    ur, text = URKinematics("ur5e"), ""
    frames, axes = ur._joint_frames()
    base = ur.model.frames[link_frame(ur.model, ur.arm.base)].placement.homogeneous
    frames[0] = np.linalg.inv(base) @ frames[0]

    def place(T):
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(T[:3, :3]).ravel())
        return f'pos="{" ".join(map(repr, T[:3, 3].tolist()))}" quat="{" ".join(map(repr, quat.tolist()))}"'

    for name, T, axis in zip(ur.arm.joints, frames, axes, strict=True):
        text += f'<body name="on_{name}" {place(T)}><inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>'
        text += f'<joint name="{name}" axis="{" ".join(map(str, axis))}" range="-360 360"/>'
    text += f'<site name="tool" {place(ur.model.frames[ur.tip_frame].placement.homogeneous)}/>' + "</body>" * 7
    file = tmp_path / "ur.xml"
    file.write_text(f'<mujoco><worldbody><body name="base" {place(base)}>{text}</worldbody></mujoco>')
    read = ArmKinematics.from_file(file, base="world")
    assert isinstance(read, URKinematics)
    q = np.array([0.3, -1.2, 1.1, -0.8, -1.4, 0.2])
    assert np.abs(read.nearest(read.fk(q), q).q - q).max() < 1e-9
    np.testing.assert_allclose(read.fk(q), URKinematics("ur5e", base="world").fk(q), atol=1e-9)


def test_a_base_that_is_free_and_one_on_the_ground(tmp_path):
    free = tmp_path / "free.xml"
    free.write_text(TWO.format("", "").replace('<joint name="one"/>', "<freejoint/>"))
    arm = ArmDescription.from_file(free)
    assert (arm.joints, arm.base) == (("two",), "b")
    assert any("floats and is held" in note for note in arm.notes)
    ground = tmp_path / "ground.xml"
    ground.write_text(TWO.format("", "").replace("<worldbody>", '<worldbody><geom type="box" size=".1 .1 .1"/>'))
    arm = ArmDescription.from_file(ground)
    assert (arm.joints, arm.base, arm.default_tip) == (("one", "two"), "base", "c")
    assert {shape.name for shape in CollisionChecker(arm).shapes} == {"base", "b", "c"}


def test_couplings(tmp_path):
    """Fingers that an equality couples, and those of a closed loop, are held behind the arm."""
    fingers = (
        '<body name="f1" pos="0 .1 0"><joint name="p1" type="slide" range="0 .1"/><geom size=".01"/></body>'
        '<body name="f2" pos="0 -.1 0"><joint name="p2" type="slide" range="0 .1"/><geom size=".01"/></body>'
        '<body name="k1" pos="0 0 .1"><joint name="o1"/><geom size=".01"/>'
        '<body name="k2" pos="0 0 .1"><joint name="o2"/><geom size=".01"/></body></body>'
        '<body name="k3" pos="0 0 .2"><joint name="o3"/><geom size=".01"/></body>'
    )
    equal = (
        '<equality><joint joint1="p1" joint2="p2" polycoef="0.01 0.5 0 0 0"/>'
        '<connect body1="k2" body2="k3" anchor="0 0 0.1"/></equality>'
    )
    file = tmp_path / "hand.xml"
    file.write_text(TWO.format(fingers, equal))
    arm = ArmDescription.from_file(file, held={"p2": 0.04})
    assert (arm.joints, arm.default_tip) == (("one", "two"), "c")
    kin = ArmKinematics(arm, tip="f1", base="world")
    np.testing.assert_allclose(kin.fk([0, 0])[:3, 3], (1, 0.1, 0.01 + 0.5 * 0.04), atol=1e-12)
    with pytest.raises(InputError, match="joint 'o1' is part of a closed loop"):
        ArmDescription.from_file(file, tip="k2", joints=["one", "two", "o1", "o2"])


def test_what_an_equality_holds_and_what_it_connects_to_the_world(tmp_path):
    """A joint that is coupled to none, or not in proportion, is not the arm's; a body on a target moves freely."""
    file = tmp_path / "a.xml"
    site = '<site name="s"/><body name="d" pos="1 0 0"><joint name="three"/><geom size="0.1"/><site name="t"/></body>'
    target = '<body name="goal" mocap="true"/></worldbody>'
    for equal, joints in (
        ('<joint joint1="three" polycoef="0.1 0 0 0 0"/>', ("one", "two")),
        ('<joint joint1="three" joint2="one" polycoef="0 1 0.5 0 0"/>', ("one", "two")),
        ('<joint joint1="three" polycoef="0.1 0 0 0 0" active="false"/>', ("one", "two", "three")),
        ('<weld body1="d" body2="goal"/>', ("one", "two", "three")),
        ('<connect body1="d" anchor="0 0 0"/>', ("one", "two", "three")),
        ('<connect site1="s" site2="t"/>', ("one", "two")),
    ):
        text = TWO.format(site, f"<equality>{equal}</equality>").replace("</worldbody>", target)
        file.write_text(text)
        assert ArmDescription.from_file(file).joints == joints, equal


def test_slides_without_limits_have_far_ones_and_that_is_said(tmp_path):
    file = tmp_path / "rail.xml"
    file.write_text(TWO.format("", "").replace('name="one"', 'name="one" type="slide" axis="1 0 0"'))
    arm = ArmDescription.from_file(file)
    assert ArmKinematics(arm).lower[0] == -100.0 == -ArmKinematics(arm).upper[0]
    assert arm.notes == ("slides without limits are taken as ±100 m: one",)
    file.write_text(file.read_text().replace('type="slide"', 'type="slide" range="0 2"'))
    arm = ArmDescription.from_file(file)
    assert (ArmKinematics(arm).lower[0], ArmKinematics(arm).upper[0], arm.notes) == (0.0, 2.0, ())


@pytest.mark.parametrize(
    ("text", "said"),
    {
        "none moves": ("<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>", "no joint moves"),
        "not MuJoCo's": ("<mujoco><worldbody><boody/></worldbody></mujoco>", "MuJoCo cannot read .*boody"),
        "no such mesh": (TWO.format('<geom type="mesh" mesh="x"/>', ""), "MuJoCo cannot read .*x"),
        "include of itself": (TWO.format("", '<include file="a.xml"/>'), "includes 'a.xml' within itself"),
        "include of nothing": (TWO.format("", '<include file="b.xml"/>'), "b.xml"),
        "include of a device": (TWO.format("", '<include file="/dev/zero"/>'), "/dev/zero"),
        "attached": (TWO.format("", '<asset><model file="b.xml"/></asset>'), "attaches other models"),
        "ball within": (
            TWO.format(f'<body><joint type="ball"/>{BALL}<body><joint/>{BALL}</body></body>', ""),
            "is spherical, between joints that turn",
        ),
        "document type": ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco>&b;</mujoco>', "document type"),
        "a part": ("<mujocoinclude/>", "must begin with <robot> or <mujoco>"),
    }.values(),
)  # fmt: skip
def test_what_is_refused(tmp_path, capfd, text, said):
    file = tmp_path / "a.xml"
    file.write_text(text)
    with pytest.raises(InputError, match=said):
        ArmDescription.from_file(file)
    assert cli.main(["check", str(file)]) == 2
    out, err = capfd.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)


def test_a_missing_mesh_costs_the_collisions(file, tmp_path):
    (tmp_path / "defaults.xml").write_text(DEFAULTS)
    (tmp_path / "six.mjcf").write_text(ARM)
    arm = arm_named(str(tmp_path / "six.mjcf"))
    assert "plate.stl" in arm.missing_shapes
    q = [0.1] * 6
    np.testing.assert_allclose(ArmKinematics(arm).fk(q), ArmKinematics.from_file(file).fk(q), atol=1e-15)


@pytest.mark.slow
def test_from_a_shell(file, arm, capsys):
    numbers = pose_vector(ArmKinematics(arm, base="world").fk(arm.home))
    pose = ",".join(map(str, [*numbers[:3], *np.rad2deg(numbers[3:])]))
    assert cli.main(["ik", "--arm", str(file), "--base", "world", "--pose", pose, "--degrees"]) == 0
    assert capsys.readouterr().out.count(",") >= 5
    assert cli.main(["check", str(file), "--poses", "20"]) == 0
    said = capsys.readouterr()
    assert "six joints: every posture of a pose exactly" in said.out
    assert "joints l, r of a gripper" in said.err
    assert cli.main(["ik", "--arm", str(file), "--hold", "l=0.02", "--degrees", "--pose", pose, "--base", "world"]) == 0


def test_files_that_are_included_are_not_too_long_together(tmp_path, monkeypatch):
    part = "<mujocoinclude><option/></mujocoinclude>"
    (tmp_path / "part.xml").write_text(part)
    file = tmp_path / "a.xml"
    file.write_text(TWO.format("", '<include file="part.xml"/>' * 3))
    monkeypatch.setattr(_mjcf, "MOST", 3 * len(part))
    assert ArmDescription.from_file(file).joints == ("one", "two")
    monkeypatch.setattr(_mjcf, "MOST", 3 * len(part) - 1)
    with pytest.raises(InputError, match=f"a.xml.* includes more than {3 * len(part) - 1} characters"):
        ArmDescription.from_file(file)


def test_what_is_endless_or_the_worlds_is_no_part_of_a_link(tmp_path):
    """A plane on a fixed body is no shape; a site of the world, and one without a name, is no tip."""
    links, shapes = [], []
    for name, sites, ground in (
        ("plain", "", '<body name="p"><geom size="0.2"/>'),
        ("more", '<site name="s"/><site/>', '<site name="w"/><body name="p"><geom size="0.2"/>{}'),
    ):
        ground = ground.format('<geom type="plane" size="1 1 0.1"/>')
        text = TWO.format(sites, "").replace("<worldbody>", f"<worldbody>{ground}")
        text = text.replace("</worldbody>", "</body></worldbody>")
        (tmp_path / f"{name}.xml").write_text(text)
        robot = ArmDescription.from_file(tmp_path / f"{name}.xml").robot
        links.append({link.get("name") for link in robot.iter("link")})
        shapes.append([shape.tag for shape in robot.iter() if shape.tag in ("visual", "collision")])
    assert links[1] - links[0] == {"s"}
    assert shapes[1] == shapes[0] == ["visual", "collision"] * 3


@pytest.mark.parametrize("count", [1, 2])
def test_masses_that_follow_from_meshes_are_said(tmp_path, count):
    """Of links whose mass MuJoCo would take from a mesh file that is not read."""
    trimesh.creation.box((0.2, 0.1, 0.1)).export(tmp_path / "a.stl")
    mesh = '<geom type="mesh" mesh="a"/>'
    text = TWO.format("", '<asset><mesh name="a" file="a.stl"/></asset>')
    for _ in range(count):
        text = text.replace('<geom size="0.1"/>', mesh, 1)
    (tmp_path / "a.xml").write_text(text)
    which = "link b" if count == 1 else "links b, c"
    assert ArmDescription.from_file(tmp_path / "a.xml").notes == (
        f"the mass that follows from meshes is not computed: {which}; give <inertial> for simulations",
    )


def test_surfaces_that_a_urdf_has_not_have_no_mesh():
    """Height fields, and meshes that are turned and stretched; others are placed back by MuJoCo's reference."""
    T, turned = pose([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), pose([0, 0, 0, 0.3, -0.2, 0.1])[:3, :3]
    element, place = _mjcf._mesh_element(None, T)
    assert (element.tag, place is T) == ("surface", True)
    kinds = []
    points = np.random.default_rng(3).normal(size=(20, 3))
    for scale, R in itertools.product((np.full(3, 2.0), np.array([1.0, 2.0, 3.0])), (np.eye(3), turned)):
        mesh = _mjcf._MeshFile("a.stl", scale, R, np.array([0.5, -0.1, 0.2]))
        element, place = _mjcf._mesh_element(mesh, T)
        kinds.append(element.tag)
        if element.tag == "mesh":
            assert element.get("filename") == "a.stl"
            written = points * [float(word) for word in element.get("scale").split()] @ place[:3, :3].T + place[:3, 3]
            mujocos = scale * ((points - mesh.reference) @ R)  # S R^T (v - p)
            np.testing.assert_allclose(written, mujocos @ T[:3, :3].T + T[:3, 3], atol=1e-12)
    assert kinds == ["mesh", "mesh", "mesh", "mesh_with_refquat_and_scale"]
