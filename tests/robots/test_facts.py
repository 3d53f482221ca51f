"""Every attribute of an arm may be given beside its URDF file, and is then what it says."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from kinreach.errors import InputError, UnknownOptionError
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import ArmDescription, Box, CameraMount, Gripper, Workcell, get_arm
from kinreach.robots._description import FROM_FILE, no_package
from kinreach.sim import ArmSimulation

PANDA = Path(str(get_arm("ur5").package_root())) / "example-robot-data/robots/panda_description/urdf/panda.urdf"
HAND = Gripper("panda_finger_joint1", "panda_finger_joint2", stroke=0.08, opening=0.05, force=70.0)
JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))
#: A value of every attribute, none of which is what the file gives.
FACTS = {
    "name": "mine", "title": "My arm", "joints": JOINTS, "home": (0.1, -0.5, 0.2, -1.5, 0.1, 1.5, 0.3),
    "base": "panda_link1", "tips": {"hand": "panda_hand", "flange": "panda_link8"}, "default_tip": "panda_link8",
    "workcell": Workcell(obstacles=(Box("table", (1, 1, 0.1), (0.5, 0, -0.5)),)),
    "disabled_collisions": (("panda_link0", "panda_link1"),), "meshes": "hulls",
    "position_gains": (900.0,) * 7, "speed_limit": 1.25, "acceleration_limit": 2.5, "armature": 0.2,
    "joint_damping": (3.0,) * 7, "gripper": HAND, "moves_last": ("panda_joint2",),
    "cameras": (CameraMount("overview", "world", (2.0, 0.0, 1.0), (0.0, 0.0, 0.5)),),
    "missing_shapes": "the owner says so", "notes": ("borrowed from the lab",),
}  # fmt: skip


@pytest.mark.slow
def test_every_attribute_can_be_given():
    assert set(FACTS) == {each.name for each in fields(ArmDescription)} - set(FROM_FILE)
    plain = ArmDescription.from_urdf(PANDA)
    for name, value in FACTS.items():
        arm = ArmDescription.from_urdf(PANDA, **{name: value})
        found = getattr(arm, name)
        assert found == (((*plain.notes, *value)) if name == "notes" else value), name
        assert name == "joints" or found != getattr(plain, name), name
        assert ArmKinematics(arm).n == 7
    every = ArmDescription.from_urdf(PANDA, **FACTS | {"tips": {"hand": "panda_hand", "panda_link8": "panda_link8"}})
    assert (every.title, every.default_tip, every.package_root is no_package) == ("My arm", "panda_link8", False)


def test_of_the_tips_that_are_given_the_one_of_the_file_counts_else_the_first():
    tips = {"flange": "panda_link8", "point": "panda_hand_tcp"}
    assert ArmDescription.from_urdf(PANDA, tips=tips).default_tip == "point"
    assert ArmDescription.from_urdf(PANDA, tips=tips, tip="panda_link8").default_tip == "flange"
    assert ArmDescription.from_urdf(PANDA, tips=tips, default_tip="flange").default_tip == "flange"
    assert ArmDescription.from_urdf(PANDA, tips={"hand": "panda_hand"}).default_tip == "hand"
    kin = ArmKinematics.from_urdf(PANDA, tip="panda_link8", tips=tips, title="My arm")
    assert (kin.tip, kin.arm.title) == ("flange", "My arm")
    np.testing.assert_array_equal(
        kin.fk(kin.arm.home), ArmKinematics.from_urdf(PANDA, tip="panda_link8").fk(kin.arm.home)
    )


def test_a_gripper_of_the_file_opens_and_closes():
    arm = ArmDescription.from_urdf(PANDA, gripper=HAND)
    assert (arm.joints, arm.notes) == (JOINTS, ())
    assert dict(arm.locked_joints) == {"panda_finger_joint1": 0.025, "panda_finger_joint2": 0.025}
    kin, other = ArmKinematics(arm), ArmKinematics.from_urdf(PANDA)
    np.testing.assert_allclose(kin.fk(arm.home), other.fk(arm.home), atol=1e-14)
    assert CollisionChecker(arm).free(arm.home)
    simulation = ArmSimulation(arm)
    assert simulation.move(np.array(arm.home) + 0.1).reached
    assert simulation.model.nq == 9


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"colour": 1}, "unknown attribute of an arm from a file 'colour'; available: name, title"),
        ({"build_urdf": str}, "unknown attribute .*'build_urdf'"), ({"package_root": str}, "unknown .*'package_root'"),
        ({"title": 3}, "title of an arm must be text"), ({"gripper": 3}, "gripper of an arm must be a Gripper or None"),
        ({"tips": 3}, "tips of an arm must be a mapping"), ({"notes": "abc"}, "notes of an arm must be a tuple"),
        ({"tips": {"x": "nowhere"}}, "unknown link.*nowhere"), ({"default_tip": "nowhere"}, "default_tip.*nowhere"),
        ({"gripper": Gripper("a", "b", 1, 1, 1)}, "unknown joint .*'a'"), ({"moves_last": ("a",)}, "unknown joint"),
        ({"gripper": HAND, "gripper_on": "panda_hand"}, "not both"), ({"cameras": (3,)}, "must be CameraMounts"),
    ],
)  # fmt: skip
def test_what_cannot_be_given_is_named(facts, said):
    with pytest.raises(InputError, match=said) as caught:
        ArmDescription.from_urdf(PANDA, **facts)
    assert isinstance(caught.value, UnknownOptionError) is (
        "unknown attribute" in said or "build" in said or "root" in said
    )
