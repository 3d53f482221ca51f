"""An arm's URDF is parsed and checked once, where it comes in; everything that is made of the arm shares it."""

import copy
import pickle
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from kinreach.deploy import Move, Program
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import ArmDescription, Gripper, _urdf, _urdf_file, get_arm
from kinreach.sim import ArmSimulation

UR5E = get_arm("ur5e").urdf


@pytest.fixture
def counted(monkeypatch):
    """How often a URDF was parsed and checked."""
    counts = {"parsed": 0, "checked": 0}

    def counting(key, function):
        def call(*args, **kwargs):
            counts[key] += 1
            return function(*args, **kwargs)

        return call

    parse = counting("parsed", _urdf.parse_xml)
    for module in (_urdf, _urdf_file):
        monkeypatch.setattr(module, "parse_xml", parse)
    monkeypatch.setattr(_urdf, "check_parts", counting("checked", _urdf.check_parts))
    monkeypatch.setattr(ET, "fromstring", counting("parsed", ET.fromstring))
    return counts


def bare():
    return ArmDescription("bare", "bare", lambda: UR5E)


def from_file(tmp_path):
    file = tmp_path / "a.urdf"
    file.write_text(UR5E, encoding="utf-8")
    return ArmDescription.from_urdf(file)


def test_a_text_is_parsed_and_checked_once(counted):
    arm = bare()
    made = arm.with_tool([0, 0, 0.1, 0, 0, 0]).calibrated("ur5e_a", model="ur5e")
    for each in (arm, made):
        ArmKinematics.of(each)
        assert each.urdf.startswith("<robot")
    assert counted == {"parsed": 2, "checked": 1}  # the second parse is that of the text's namespaces


def test_a_file_is_parsed_once(counted, tmp_path):
    ArmKinematics.of(from_file(tmp_path))
    assert counted == {"parsed": 1, "checked": 1}


def test_what_is_made_of_an_arm_of_ours_parses_nothing(counted):
    arm = get_arm("ur3e").with_tool([0, 0, 0.1, 0, 0, 0]).with_limits(3.0)
    kin = ArmKinematics.of(arm, base="base")
    home = kin.arm.home
    assert "movej" in Program.of(kin, home, [Move("movej", (0.5, *home[1:]), 1.0, 2.0)]).text
    assert counted["parsed"] == 0
    assert counted["checked"] <= 1  # the limits that were given


def test_copies_are_the_same_arm(tmp_path):
    made = get_arm("ur3e").with_tool([0, 0, 0.1, 0, 0, 0]).with_limits(3.0)
    for arm in (from_file(tmp_path), made, bare(), get_arm("ur5-thesis"), get_arm("panda")):
        for again in (copy.deepcopy(arm), pickle.loads(pickle.dumps(arm))):
            assert again.urdf == arm.urdf
            assert ET.tostring(again.robot) == ET.tostring(arm.robot)
        text = arm.urdf
        arm.with_limits(2.5)
        assert ET.tostring(arm.robot, encoding="unicode") == text  # a copy was changed


@pytest.mark.parametrize(("stroke", "length"), [(0.16, 0.20), (0.085, 0.16), (0.11, 0.23)])
def test_another_gripper(stroke, length):
    """Its fingers open so far, its tip is so far from the flange, and the palm is no wider than needed."""
    gripper = Gripper("left", "right", stroke=stroke, opening=0.5 * stroke, force=60.0, length=length)
    arm = get_arm("ur5e").with_gripper(gripper)
    assert arm.default_tip == "tcp"
    flange, tip = (ArmKinematics.of(arm, tip=name).fk(arm.home) for name in ("tool0", "tcp"))
    assert (tip - flange)[:3, 3] == pytest.approx(length * flange[:3, 2])
    limit = arm.robot.find("joint[@name='left']/limit")
    assert float(limit.get("upper")) == pytest.approx(0.5 * stroke)
    assert CollisionChecker(arm).free(arm.home)
    np.testing.assert_allclose(ArmSimulation(arm).tip_position, ArmKinematics.of(arm, base="world").fk(arm.home)[:3, 3])


@pytest.mark.parametrize("wrong", [{"stroke": 0.0}, {"opening": 0.2}, {"force": -1}, {"length": 0.1}, {"joint": ""},
                                   {"mimic_joint": "left"}, {"stroke": "wide"}], ids=str)  # fmt: skip
def test_what_no_gripper_has_is_refused(wrong):
    right = {"joint": "left", "mimic_joint": "right", "stroke": 0.1, "opening": 0.1, "force": 60.0}
    with pytest.raises(InputError):
        Gripper(**right | wrong)


def test_only_a_gripper_is_mounted():
    with pytest.raises(InputError, match=r"gripper must be a Gripper, got 0\.1"):
        get_arm("ur5e").with_gripper(0.1)


def test_a_prefix_in_a_text_is_declared():
    """Files of people are read leniently; a text that code makes is XML."""
    arm = get_arm("arm3")
    for before, after, said in (
        ("</robot>", "<sim:plugin/></robot>", "the URDF is not XML: unbound prefix"),
        ("<robot ", '<robot xmlns:sim="https://example.org" ', ""),
    ):
        text = arm.urdf.replace(before, after)
        assert text != arm.urdf
        changed = replace(arm, build_urdf=lambda text=text: text)
        if said:
            with pytest.raises(InputError, match=said):
                changed.robot  # noqa: B018 (parsed when it is asked for)
        else:
            assert len(changed.robot) == len(arm.robot)
