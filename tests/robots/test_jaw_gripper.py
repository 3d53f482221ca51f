"""The gripper with one jaw that turns: openings, angles, and the jaw in a simulation."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import ArmDescription, get_arm
from kinreach.robots._so101 import JAW_MIDDLE, TOUCH
from kinreach.sim import ArmSimulation
from kinreach.sim._engine import mujoco

GRIPPER = get_arm("so101").gripper


def test_angles_of_openings_are_theirs():
    closed = float(GRIPPER.openings(np.array([GRIPPER.least])))
    assert 0.0 < closed < 0.003
    openings = np.random.default_rng(0).uniform(closed, GRIPPER.stroke, 200)
    angles = GRIPPER.positions(openings)
    assert angles.shape == (200, 1)
    np.testing.assert_allclose(GRIPPER.openings(angles), openings, atol=1e-12)
    assert (np.diff(GRIPPER.positions(np.sort(openings))[:, 0]) > 0.0).all()
    np.testing.assert_allclose(GRIPPER.positions(np.array([0.0, closed])), GRIPPER.least)
    limit = get_arm("so101").robot.find("joint[@name='gripper']/limit")
    assert float(limit.get("lower")) == GRIPPER.least
    assert GRIPPER.positions(np.array(GRIPPER.stroke)).item() < float(limit.get("upper"))


def test_the_jaw_of_a_simulation_is_where_the_opening_says():
    """The tip lies between the jaws, its y axis towards the fixed one."""
    arm, count = get_arm("so101"), 0
    simulation = ArmSimulation(replace(arm, default_tip="tcp"))
    data = simulation.data
    for opening in np.random.default_rng(1).uniform(0.003, GRIPPER.stroke, 20):
        simulation.open_gripper(opening)
        mujoco.mj_forward(simulation.model, data)
        jaw, tip = data.body("jaw_link"), data.body("tcp")
        touch = jaw.xpos + jaw.xmat.reshape(3, 3) @ [*TOUCH, JAW_MIDDLE]
        across = tip.xmat.reshape(3, 3).T @ (touch - tip.xpos)
        assert across[1] == pytest.approx(GRIPPER.beside - opening, abs=1e-9)
        assert abs(across[0]) < 2e-4
        box = data.geom(int(simulation.model.body("jaw_link").geomadr[0]))
        half = simulation.model.geom_size[box.id]
        inside = box.xmat.reshape(3, 3).T @ (touch - box.xpos)  # what touches is on the jaw's face
        assert min(half - abs(inside)) == pytest.approx(0.0, abs=1e-9)
        count += 1
    assert count == 20
    fixed = data.geom(int(simulation.model.body("gripper_link").geomadr[0]) + 1)  # behind its face
    half = fixed.xmat.reshape(3, 3) * simulation.model.geom_size[fixed.id]
    corners = fixed.xpos + np.array(list(product((-1, 1), repeat=3))) @ half.T
    across = (corners - tip.xpos) @ tip.xmat.reshape(3, 3)
    assert across[:, 1].min() == pytest.approx(GRIPPER.beside, abs=5e-4)
    assert across[:, 2].max() > 0.005
    T = ArmKinematics.of(arm, tip="tcp", base="world").fk(arm.home)
    np.testing.assert_allclose(data.body("tcp").xpos, T[:3, 3], atol=1e-9)


def test_the_opening_around_an_object_leaves_room_for_it_at_its_upper_edge():
    """The line from the jaw's axis to its tip is so far from the fixed jaw, a size behind the tip."""
    inclined = 0
    for size in np.random.default_rng(2).uniform(0.005, 0.027, 100):
        opening = GRIPPER.opening_around(size)
        slope = np.tan(GRIPPER.positions(np.array(opening)).item() - GRIPPER.ahead)
        assert opening - size * max(0.0, slope) == pytest.approx(2.0 * size, abs=1e-9)
        inclined += slope > 0.0
    assert 50 < inclined < 90
    fingers = get_arm("ur5-thesis").gripper
    assert (fingers.opening_around(0.025), fingers.meeting, GRIPPER.meeting) == (0.05, 0.0, GRIPPER.beside)


def test_it_is_held_open_where_nothing_grasps():
    arm = get_arm("so101")
    assert arm.joints == ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
    assert arm.locked_joints == {"gripper": pytest.approx(GRIPPER.positions(np.array(0.07)).item())}
    held = arm.with_tool([0.0, 0.0, 0.05, 0.0, 0.0, 0.0])
    assert held.gripper is GRIPPER
    assert CollisionChecker(held).free(held.home)


def test_a_file_with_a_jaw(tmp_path):
    arm, file = get_arm("so101"), tmp_path / "so101.urdf"
    file.write_text(arm.urdf)
    read = ArmDescription.from_file(file, tip="gripper_frame_link", gripper=GRIPPER, workcell=arm.workcell)
    assert read.joints == arm.joints
    assert read.locked_joints == arm.locked_joints


def test_the_angle_of_a_jaw_may_be_counted_from_anywhere():
    """Where the joint is at 0 and how it closes are two numbers of a gripper, and its openings stay the same."""
    rng, tried = np.random.default_rng(3), 0
    openings = rng.uniform(0.003, GRIPPER.stroke, 50)
    for angle in rng.uniform(-3.0, 3.0, 20):
        turned = replace(GRIPPER, ahead=GRIPPER.ahead + angle, least=GRIPPER.least + angle)
        np.testing.assert_allclose(turned.positions(openings), GRIPPER.positions(openings) + angle, atol=1e-12)
        np.testing.assert_allclose(turned.openings(turned.positions(openings)), openings, atol=1e-12)
        tried += 1
    assert tried == 20


REFUSED = {
    "stroke": (0.0, GRIPPER.pivot + GRIPPER.length + 1e-6), "opening": (0.001, GRIPPER.stroke + 1e-6),
    "torque": (0.0, -1.0, 1.1e6, np.nan), "tip": ("", 3), "joint": (3, ""), "length": (0.0, 1.1),
    "ahead": (-1.1e6, 1.1e6, "up"), "least": (GRIPPER.ahead - 1.571, GRIPPER.ahead + 1.571),
    "beside": (GRIPPER.opening + 1e-6, -1e-6), "pivot": ("far", -1e-6, 1.1),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_no_jaw_has_is_refused(name):
    for wrong in REFUSED[name]:
        with pytest.raises(InputError, match=f"^{name} of a gripper"):
            replace(GRIPPER, **{name: wrong})
