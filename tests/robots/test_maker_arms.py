"""The names `ur3` to `ur30` are the maker's robots: limits, speeds, flange, and nothing on it."""

import math

import numpy as np
import pytest

from kinreach.cli import main
from kinreach.deploy._controller import CB3, Controller, rate_of
from kinreach.deploy._planning import _joint
from kinreach.kinematics import (
    ArmKinematics,
    ClosedFormSolver,
    CollisionChecker,
    LevenbergMarquardtSolver,
    MotionLimits,
    PoseGoal,
    URKinematics,
)
from kinreach.robots import PUBLISHED_CALIBRATIONS, THESIS_ARM, arm_names, get_arm
from kinreach.robots._ur import ENDLESS, UR_MODELS
from kinreach.robots.inside import JOINTS, ur_model, ur_speeds
from kinreach.sim import ArmSimulation

TURN = 2.0 * math.pi
#: Speeds of base and shoulder, elbow, and wrists [degrees/s], by the user manuals; written here a second time.
SPEEDS = {
    "ur3": (180, 180, 360), "ur5": (180, 180, 180), "ur10": (120, 180, 180),
    "ur3e": (180, 180, 360), "ur5e": (180, 180, 180), "ur7e": (180, 180, 180),
    "ur10e": (120, 180, 180), "ur12e": (120, 180, 180), "ur16e": (120, 180, 180),
    "ur18": (180, 240, 300), "ur20": (120, 150, 210), "ur30": (120, 150, 210),
}  # fmt: skip
MAKERS = pytest.mark.parametrize("name", UR_MODELS)


@MAKERS
def test_limits_and_speeds_are_the_makers(name):
    kin, model = URKinematics(name), UR_MODELS[name]
    upper = [TURN, TURN, math.pi, TURN, TURN, ENDLESS if name in ("ur3", "ur3e") else TURN]
    np.testing.assert_array_equal(kin.upper, upper)
    np.testing.assert_array_equal(kin.lower, -kin.upper)
    base, elbow, wrist = np.radians(SPEEDS.get(name, model.speeds))
    speeds = [base, base, elbow, wrist, wrist, wrist]
    np.testing.assert_allclose(kin.velocity_limit, speeds, rtol=1e-15)
    limits = MotionLimits.of(name)
    np.testing.assert_allclose(limits.speed, speeds, rtol=1e-15)
    assert limits.acceleration.max() <= 5.0
    assert kin.model.effortLimit.tolist() == np.repeat(np.array(model.torques, dtype=float), (2, 1, 3)).tolist()


@MAKERS
def test_the_flange_is_bare_and_where_the_table_has_it(name):
    arm = get_arm(name)
    assert (arm.default_tip, dict(arm.tips), arm.gripper) == ("tool0", {"tool0": "tool0", "tcp": "tcp"}, None)
    assert arm.home == get_arm("ur5e").home
    d1, a2, a3, d4, d5, d6 = UR_MODELS[name].lengths
    # all joints at 0: the arm stretched along -x of the controller's frame
    np.testing.assert_allclose(
        URKinematics(name, base="base").fk(np.zeros(6))[:3, 3], [a2 + a3, -d4 - d6, d1 - d5], atol=1e-12
    )
    for options in ({}, {"obstacles": ()}):
        checker = CollisionChecker(ArmKinematics(arm), **options)
        links = {link for pair in checker.pairs for link in pair} - {box.name for box in arm.workcell.obstacles}
        assert links == {"base_link", "shoulder_link", "upper_arm_link", "forearm_link", *wrists()}
        assert checker.free(arm.home)


def wrists():
    return {f"wrist_{number}_link" for number in (1, 2, 3)}


@MAKERS
def test_a_posture_within_the_limits_is_the_nearest_to_itself(name):
    kin = URKinematics(name)
    q = np.random.default_rng(46).uniform(kin.lower, kin.upper, (1000, 6))
    found = [kin.nearest(T, start) for T, start in zip(kin.fk(q), q, strict=True)]
    assert all(result.success for result in found)
    assert np.abs(np.array([result.q for result in found]) - q).max() < 1e-6
    batch = kin.nearest_batch(kin.fk(q), q)
    assert batch.success.sum() == 1000
    assert np.abs(batch.q - q).max() < 1e-6


def test_a_posture_of_a_real_ur10_is_found_again():
    kin, q = URKinematics("ur10", base="base"), np.array([0.3, -1.2, 1.7, -4.56, 5.12, 0.4])
    result = kin.nearest(kin.fk(q), q)
    assert result.success
    np.testing.assert_allclose(result.q, q, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "joint", "way", "speed", "stopped"),
    [
        ("ur10", 0, 3.0, 2.09, False), ("ur10", 0, 3.0, 2.15, True), ("ur10", 5, 4.0, 3.1, False),
        ("ur3", 5, 20.0, 6.2, False), ("ur3", 5, 20.0, 6.4, True), ("ur3", 0, 3.0, 3.3, True),
    ],
)  # fmt: skip
def test_the_simulated_controller_stops_at_the_makers_speed_of_each_joint(name, joint, way, speed, stopped):
    arm = get_arm(name)
    target = np.array(arm.home)
    target[joint] += way
    done = Controller(arm).run(f"def fast():\n  movej({target.tolist()}, a=12, v={speed})\nend\n")
    assert done.reason.startswith(f"joint speed: {JOINTS[joint]}" if stopped else "")
    assert bool(done.reason) == stopped


def test_planned_moves_are_as_fast_as_each_joint_allows():
    """The joint that turns most has the speed with which none exceeds its own limit, and one reaches it."""
    rng, slower = np.random.default_rng(3), 0
    for name in ("ur3", "ur10", "ur5e", "ur18", "ur20"):
        limit = URKinematics(name).velocity_limit
        for _ in range(200):
            way = rng.uniform(-2, 2, 6) * (rng.random(6) < 0.7)
            path = np.vstack([np.zeros(6), way])
            (move,) = _joint(path, 0.5 * limit, [0.0])
            shares = move.speed * np.abs(way) / max(np.abs(way).max(), 1e-12) / (0.5 * limit)
            assert shares.max() == pytest.approx(1.0, abs=1e-5) or not way.any()
            slower += move.speed < 0.5 * limit[np.abs(way).argmax()] - 1e-9
    assert slower > 100


def test_an_endless_wrist_may_be_turned_far(capsys):
    goal = "0.1,-0.25,0.3,3.14,0,0"
    far = "-1.57,-1.57,1.57,-1.57,-1.57,"
    assert main(["ik", "--arm", "ur3", "--pose", goal, "--seed", f"{far}40"]) == 0
    shown = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("*")).split()
    assert abs(float(shown[7]) - 40.0) <= math.pi
    for arm, angle, bound in (("ur3", "70", "62.83"), ("ur5", "7", "6.283")):
        assert main(["ik", "--arm", arm, "--pose", goal, "--seed", far + angle]) == 2
        assert f"--seed must be within ±{bound} rad, got {angle}" in capsys.readouterr().err
    for solver in (LevenbergMarquardtSolver, ClosedFormSolver):  # and searches stay within a turn of it
        kin, found = URKinematics("ur3"), 0
        rng = np.random.default_rng(1)
        for q in rng.uniform(-3, 3, (30, 6)):
            seed = np.append(rng.uniform(-3, 3, 5), 40.0)
            result = solver(kin).solve(PoseGoal(kin.fk(q)), seed)
            found += result.success
            assert not result.success or abs(result.q[5] - 40.0) <= TURN
        assert found >= 25


def test_the_thesis_has_arms_of_its_own():
    assert THESIS_ARM == "ur5-thesis"
    assert [name for name in arm_names() if name.startswith("ur") and name not in UR_MODELS] == [
        "ur10-thesis", "ur3-thesis", "ur5-thesis"
    ]  # fmt: skip
    for model in ("ur3", "ur5", "ur10"):
        maker, thesis = (URKinematics(name, tip="tcp", base="world") for name in (model, f"{model}-thesis"))
        np.testing.assert_allclose(thesis.upper, math.pi, atol=1e-9)
        q = np.random.default_rng(0).uniform(-math.pi, math.pi, (100, 6))
        np.testing.assert_allclose(maker.fk(q), thesis.fk(q), atol=1e-12)
        assert thesis.arm.gripper is not None
        assert (thesis.arm.default_tip, len(thesis.arm.goal_cameras)) == ("tcp", 2)
    for make in (ArmSimulation, URKinematics):
        assert make(THESIS_ARM).arm is get_arm(THESIS_ARM)
    assert (ArmSimulation().arm, URKinematics().arm) == (get_arm(THESIS_ARM), get_arm("ur5"))


@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("ur5", "ur5"), ("UR5E", "ur5e"), ("ur5-thesis", "ur5"), ("ur10e_calibrated_tool", "ur10e"),
        ("ur5-3-cameras", "ur5"), ("ur55", None), ("ur5x", None), ("panda", None), ("my-ur5", None),
    ],
)  # fmt: skip
def test_the_model_of_an_arm_is_what_its_name_begins_with(name, model):
    assert ur_model(name) == model
    speeds = ur_speeds(name)  # of no model the highest of all
    most = max(max(ur_speeds(each)) for each in UR_MODELS)
    assert speeds == ((most,) * 6 if model is None else ur_speeds(model))


def test_controllers_of_the_first_generations_have_125_cycles():
    slow = {name for name in UR_MODELS if rate_of(get_arm(name)) == 125}
    assert slow == set(CB3) == {"ur3", "ur5", "ur10"}
    assert rate_of(get_arm(THESIS_ARM)) == 125


@pytest.mark.parametrize("name", sorted(PUBLISHED_CALIBRATIONS))
def test_a_calibration_changes_no_limit_and_keeps_the_flange(name):
    model = name.partition("_")[0]
    kin = URKinematics.from_calibration(PUBLISHED_CALIBRATIONS[name], model=model)
    assert (kin.tip, kin.arm.joints, kin.arm.gripper) == ("tool0", JOINTS, None)
    nominal = URKinematics(model)
    np.testing.assert_array_equal([kin.lower, kin.upper], [nominal.lower, nominal.upper])
    np.testing.assert_array_equal(kin.velocity_limit, nominal.velocity_limit)
    np.testing.assert_allclose(MotionLimits.of(kin).speed, MotionLimits.of(model).speed, rtol=1e-15)


@pytest.mark.parametrize("name", UR_MODELS)
def test_an_arm_at_home_is_farther_from_itself_than_move_keeps(name):
    """Housings that always are beside each other would refuse every motion: `move` keeps 5 mm and more."""
    clearance = CollisionChecker(get_arm(name), obstacles=()).distance(get_arm(name).home)
    assert clearance.distance > 7e-3, clearance
