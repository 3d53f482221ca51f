"""Calibration files of real UR arms: read alike from three kinds of file, refused where they cannot be true."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from kinreach.errors import InputError, KinreachError, UnknownNameError
from kinreach.kinematics import ArmKinematics, URKinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm, read_calibration
from kinreach.robots.inside import JOINTS, UR_LENGTHS
from tests.cases import slow

FILES = Path(__file__).parents[1] / "data" / "calibrations"
ROBOTS = sorted(PUBLISHED_CALIBRATIONS)
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])


def model_of(robot):
    return robot.split("_")[0]


def driver_fk(file, q):
    """T_base_link_tool0 (4, 4) as the driver's own description has it: Rz(pi), then xyz, rpy and Rz(q) of each link."""
    links = yaml.safe_load(file.read_text())["kinematics"]
    T = FLIP
    for link, angle in zip(LINKS, q, strict=True):
        f = links[link]
        step = np.eye(4)
        step[:3, :3] = axis_turn(2, f["yaw"]) @ axis_turn(1, f["pitch"]) @ axis_turn(0, f["roll"])
        step[:3, 3] = f["x"], f["y"], f["z"]
        turned = np.eye(4)
        turned[:3, :3] = axis_turn(2, angle)
        T = T @ step @ turned
    return T


def axis_turn(axis, angle):
    R = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    R[a, a] = R[b, b] = np.cos(angle)
    R[b, a] = np.sin(angle)
    R[a, b] = -R[b, a]
    return R


@pytest.mark.parametrize("robot", [*ROBOTS[:3], *slow(*ROBOTS[3:])])
def test_the_arm_is_the_one_in_the_file(robot):
    file, arm = PUBLISHED_CALIBRATIONS[robot], get_arm(model_of(robot))
    kin, nominal = ArmKinematics(arm.calibrated(file), tip="tool0"), ArmKinematics(arm, tip="tool0")
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (20, 6))
    off = []
    for posture in q:
        np.testing.assert_allclose(kin.fk(posture), driver_fk(file, posture), atol=5e-11)
        off.append(np.linalg.norm(kin.fk(posture)[:3, 3] - nominal.fk(posture)[:3, 3]))
    assert len(ROBOTS) == 8
    assert 1e-3 < np.median(off) < 4e-3
    calibration = read_calibration(file, model_of(robot))
    assert 5e-4 < calibration.tilts.max() < 8e-3
    assert 1e-4 < calibration.offsets.max() < 8e-3


def test_a_published_one_has_a_name():
    for name, file in PUBLISHED_CALIBRATIONS.items():
        named, read = (read_calibration(one, model_of(name)) for one in (name, file))
        assert named.file == read.file
        np.testing.assert_array_equal(named.placements, read.placements)


def test_the_controllers_own_poses():
    """18 postures and poses that a controller showed, as docs/reference/accuracy.md has them."""
    kin = ArmKinematics(get_arm("ur5e").calibrated(FILES / "controller_calibration_ur5e.conf"), tip="tool0")
    with (FILES / "controller_poses_ur5e.csv").open() as file:
        rows = np.array([list(map(float, row)) for row in list(csv.reader(file))[1:]])
    # the pendant shows poses in the DH base, which is base_link turned by pi
    shown = rows[:, 6:9] * (-1e-3, -1e-3, 1e-3)
    assert len(shown) == 18
    page = (Path(__file__).parents[2] / "docs/reference/accuracy.md").read_text(encoding="utf-8")
    for arm, name in ((kin, "the controller's file"), (ArmKinematics("ur5e", tip="tool0"), "the data sheet")):
        off = 1e3 * np.linalg.norm(arm.positions(np.radians(rows[:, :6])) - shown, axis=1)
        digits = 3 if arm is kin else 2
        assert f"| {name} | {np.median(off):.{digits}f} | {off.max():.{digits}f} |" in page
    rng, J = np.random.default_rng(0), kin.jacobian(np.radians(rows[:, :6]))[:, :3]
    rounding = np.einsum("pij,npj->npi", J, np.radians(rng.uniform(-0.005, 0.005, (2000, 18, 6))))
    off = np.linalg.norm(1e3 * rounding + rng.uniform(-0.005, 0.005, (2000, 18, 3)), axis=2)
    low, high = np.quantile(np.median(off, axis=1), (0.025, 0.975))
    assert f"a median of {low:.3f} to {high:.3f} mm" in page


@pytest.mark.parametrize("robot", ["ur5_a", "ur3e_a"])
def test_a_calibrated_urdf_says_the_same(robot, tmp_path):
    file, model = PUBLISHED_CALIBRATIONS[robot], model_of(robot)
    urdf = tmp_path / "real.urdf"
    urdf.write_text(get_arm(model).calibrated(file).urdf)
    read = read_calibration(urdf, model)
    np.testing.assert_allclose(read.placements, read_calibration(file, model).placements, atol=1e-10)


@pytest.mark.parametrize("root", ["left_base_link", "left_base_link_inertia"])
def test_a_urdf_of_the_driver_with_a_prefix(root, tmp_path):
    """Joints as in the driver's description: all about z, behind base_link_inertia, which may be the root."""
    links = yaml.safe_load(PUBLISHED_CALIBRATIONS["ur5e_a"].read_text())["kinematics"]
    names = ["left_base_link_inertia", *(f"left_{link}_link" for link in LINKS)]
    text = "".join(f'<link name="{name}"/>' for name in dict.fromkeys([root, *names]))
    if root == "left_base_link":
        text += '<joint name="fixed" type="fixed"><origin rpy="0 0 3.141592653589793" xyz="0 0 0"/>'
        text += '<parent link="left_base_link"/><child link="left_base_link_inertia"/></joint>'
    for joint, link, parent, child in zip(JOINTS, LINKS, names, names[1:], strict=False):
        xyz, rpy = (
            " ".join(repr(links[link][key]) for key in keys) for keys in (("x", "y", "z"), ("roll", "pitch", "yaw"))
        )
        text += f'<joint name="left_{joint}" type="revolute"><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
        text += f'<parent link="{parent}"/><child link="{child}"/>'
        text += '<limit lower="-6" upper="6" effort="1" velocity="1"/></joint>'
    file = tmp_path / "driver.urdf"
    file.write_text(f'<robot name="left">{text}</robot>')
    expected = read_calibration(PUBLISHED_CALIBRATIONS["ur5e_a"], "ur5e").placements
    np.testing.assert_allclose(read_calibration(file, "ur5e").placements, expected, atol=1e-12)


@pytest.mark.parametrize("length", [1e-3, 0.5, 1.0, 20.0])
def test_a_urdf_whose_joints_turn_about_any_axis(length, tmp_path):
    """Frames that are turned in their links, with the axis in them, of any length or left out, are the same arm."""
    links = yaml.safe_load(PUBLISHED_CALIBRATIONS["ur5e_a"].read_text())["kinematics"]
    rng, names = np.random.default_rng(0), ["base_link_inertia", *(f"{link}_link" for link in LINKS), "tool0"]
    text, before, keys = (
        "".join(f'<link name="{name}"/>' for name in names),
        Rotation.identity(),
        ("roll", "pitch", "yaw"),
    )
    for index, (joint, parent, child) in enumerate(zip((*JOINTS, "flange"), names, names[1:], strict=False)):
        f = links[LINKS[index]] if index < 6 else dict.fromkeys(("x", "y", "z", *keys), 0.0)
        own = Rotation.random(random_state=rng) if index < 6 else Rotation.identity()
        if index == 2:
            own = Rotation.from_matrix(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))  # its x is z
        turned = before.inv() * Rotation.from_euler("xyz", [f[key] for key in keys]) * own
        xyz = before.inv().apply([f["x"], f["y"], f["z"]])
        axis = length * own.inv().apply([0.0, 0.0, 1.0])
        place = [" ".join(map(repr, row.tolist())) for row in (xyz, turned.as_euler("xyz"), axis)]
        text += f'<joint name="{joint}" type="{"revolute" if index < 6 else "fixed"}"><origin xyz="{place[0]}" '
        text += f'rpy="{place[1]}"/><parent link="{parent}"/><child link="{child}"/>'
        text += "" if index in (2, 6) else f'<axis xyz="{place[2]}"/>'
        text += ("" if index == 6 else '<limit lower="-6" upper="6" effort="1" velocity="1"/>') + "</joint>"
        before = own
    file = tmp_path / "turned.urdf"
    file.write_text(f'<robot name="turned">{text}</robot>')
    expected = read_calibration(PUBLISHED_CALIBRATIONS["ur5e_a"], "ur5e").placements
    np.testing.assert_allclose(read_calibration(file, "ur5e").placements, expected, atol=1e-9)


def test_a_folded_file_is_named_and_repaired_only_when_asked():
    file = FILES / "ur5e_folded.yaml"
    with pytest.raises(InputError, match=r"folded at wrist_1.*78\d.* mm.*15 mm.*repair=True"):
        read_calibration(file, "ur5e")
    repaired = read_calibration(file, "ur5e", repair=True)
    assert repaired.repaired == "wrist_1"
    assert repaired.offsets.max() < 1e-3
    kin, nominal = ArmKinematics(get_arm("ur5e").calibrated(file, repair=True)), ArmKinematics("ur5e")
    q = np.random.default_rng(0).uniform(-3, 3, (100, 6))
    assert np.median(np.linalg.norm(kin.positions(q) - nominal.positions(q), axis=1)) < 1.5e-3


def test_the_data_sheet_is_a_calibration_of_itself(tmp_path):
    assert len(UR_LENGTHS) >= 14
    for model in UR_LENGTHS:
        urdf = tmp_path / f"{model}.urdf"
        urdf.write_text(get_arm(model).urdf)
        kin, read = ArmKinematics(model), ArmKinematics(get_arm(model).calibrated(urdf))
        q = np.random.default_rng(0).uniform(-3, 3, (50, 6))
        np.testing.assert_allclose(read.fk(q), kin.fk(q), atol=1e-10)


@pytest.mark.parametrize(
    ("robot", "model"), [("ur5_a", "ur10"), ("ur3_a", "ur3e"), ("ur3e_a", "ur3"), ("ur5e_a", "ur5")]
)
def test_another_model(robot, model):
    with pytest.raises(InputError, match=rf"_joint is .* mm from where a {model} .*15 mm.*it fits .*{model_of(robot)}"):
        read_calibration(PUBLISHED_CALIBRATIONS[robot], model)


def changed(tmp_path, old, new, source=PUBLISHED_CALIBRATIONS["ur5_a"]):
    text = source.read_text()
    edited = re.sub(old, new, text, count=1, flags=re.DOTALL)
    assert edited != text
    file = tmp_path / "changed"
    file.write_text(edited)
    return file


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (r"  forearm:.*?wrist_1:", "  wrist_1:", r"lacks forearm \(elbow_joint\)"),
        (r"    yaw: -5.106[^\n]*\n", "", r"lacks yaw of upper_arm \(shoulder_lift_joint\)"),
        (r"x: -0.4262\S*", "x: .nan", r"x of forearm \(elbow_joint\) must be a number"),
        (r"x: -0.4262\S*", "x: -426.2", r"x of forearm .*±3 m, got -426.2; are these millimetres\?"),
        (r"roll: 1.5696\S*", "roll: 89.9", r"roll of upper_arm .*±12.57 rad, got 89.9; are these degrees\?"),
        (r"roll: 1.5696\S*", "roll: 1.67", r"shoulder_lift_joint is tilted by 5.6. degrees .* the 5 of any"),
        (r"x: -0.4262\S*", "x: 'long'", r"x of forearm .* must be a number \[m\], got 'long'"),
        (r"x: -0.4262\S*", "x: [1, 2]", r"x of forearm .* must be a number"),
        (r"x: -0.4262\S*", "x: true", r"x of forearm .*"),
        (r"kinematics:", "kinematics: !!python/object/apply:os.system ['false']\nrest:", "driver's kinematics.yaml"),
        (r"kinematics:", "others:", "must be the driver's kinematics.yaml"),
        (r"kinematics:", "kinematics: [", r"cannot be read: it is not YAML, from line \d+ on; it must be the driver's"),
        (r"(?s).*", "pose,x,y\n1,2,3\n", "cannot be read: it must be the driver's"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_calibration(tmp_path, old, new, said):
    with pytest.raises(KinreachError, match=said):
        read_calibration(changed(tmp_path, old, new), "ur5")


@pytest.mark.parametrize("model", ["ur5e", "ur5"])
def test_the_controllers_file_leaves_the_model_open(model):
    arm = get_arm(model).calibrated(FILES / "controller_calibration_ur5e.conf")
    note = "controller_calibration_ur5e.conf does not name its model: {} is assumed, it fits ur5, ur5e, ur7e"
    assert arm.notes == (note.format(model),)
    assert get_arm("ur5e").calibrated(PUBLISHED_CALIBRATIONS["ur5e_a"]).notes == ()
    for other in ("ur16e", "ur18", "ur3e", "ur10e"):
        with pytest.raises(InputError, match="it fits ur5 or ur5e or ur7e"):
            get_arm(other).calibrated(FILES / "controller_calibration_ur5e.conf")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (r"delta_a = [^\n]*\n", "", "six numbers delta_a"),
        (r"0\.01116\d+, ", "", r"six numbers delta_a .*got 5"),
        (r"0\.01116\d+", "nan", "delta_a of shoulder_lift_joint .*got nan"),
        (r"0\.01116\d+", "0.2", "elbow_joint is .* mm from where a ur5e"),
        (r"0\.01116\d+", "__import__('os')", "delta_a of shoulder_lift_joint must be a number"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_controllers_file(tmp_path, old, new, said):
    with pytest.raises(KinreachError, match=said):
        read_calibration(changed(tmp_path, old, new, FILES / "controller_calibration_ur5e.conf"), "ur5e")


def test_a_urdf_that_is_not_that_of_the_model():
    with pytest.raises(InputError, match="the URDF 'ur5' is not that of a ur5e by its data sheet"):
        get_arm("ur5").calibrated(PUBLISHED_CALIBRATIONS["ur5e_a"], model="ur5e")


def test_an_origin_that_is_left_out_is_put_in():
    file, arm = PUBLISHED_CALIBRATIONS["ur3e_a"], get_arm("ur3e")
    bare, count = re.subn(r'<origin xyz="0.0 0.0 0.0" rpy="0.0 0.0 0.0" />\s*(?=<parent)', "", arm.urdf)
    assert count == 1
    other = replace(arm, build_urdf=lambda: bare).calibrated(file)
    q = np.random.default_rng(0).uniform(-3, 3, (20, 6))
    np.testing.assert_allclose(ArmKinematics(other).fk(q), ArmKinematics(arm.calibrated(file)).fk(q), atol=1e-12)
    assert (other.name, other.title) == ("ur3e_calibrated", f"UR3E, calibrated by {file.name}")


def test_files_that_are_none(tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        read_calibration(tmp_path / "none.yaml", "ur5")
    (tmp_path / "binary").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="cannot read"):
        read_calibration(tmp_path / "binary", "ur5")
    (tmp_path / "other.urdf").write_text('<robot name="x"><link name="a"/></robot>')
    with pytest.raises(InputError, match="one joint shoulder_pan_joint"):
        read_calibration(tmp_path / "other.urdf", "ur5")
    with pytest.raises(UnknownNameError, match=r"unknown UR model 'ur6'.*ur30"):
        read_calibration(PUBLISHED_CALIBRATIONS["ur5_a"], "ur6")
    with pytest.raises(UnknownNameError, match="UR model 'arm3'"):
        get_arm("arm3").calibrated(PUBLISHED_CALIBRATIONS["ur5_a"])


def test_a_calibration_ends_at_the_flange():
    arm = replace(get_arm("ur5e"), tips={"wrist": "wrist_3_link"}, default_tip="wrist")
    with pytest.raises(UnknownNameError, match="unknown tip of arm 'ur5e' 'tool0'; available: wrist"):
        arm.calibrated("ur5e_a", model="ur5e")


def test_a_folded_file_is_repaired_for_kinematics_when_asked():
    file, q = FILES / "ur5e_folded.yaml", np.random.default_rng(0).uniform(-3, 3, (100, 6))
    with pytest.raises(InputError, match="folded at wrist_1"):
        URKinematics.from_calibration(file, model="ur5e")
    kin = URKinematics.from_calibration(file, model="ur5e", repair=True)
    repaired = ArmKinematics(get_arm("ur5e").calibrated(file, repair=True), base="base_link", tip="tool0")
    np.testing.assert_allclose(kin.fk(q), repaired.fk(q), atol=1e-12)
