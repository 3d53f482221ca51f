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
from kinreach.robots.inside import JOINTS, origin_of, ur_model, ur_speeds
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


#: Masses of shoulder, upper arm, forearm and the three wrists [kg], by `config/MODEL/physical_parameters.yaml` of the
#: maker's ROS description; written here a second time.
MASSES = {
    "ur3": (2.0, 3.42, 1.26, 0.8, 0.8, 0.35), "ur3e": (1.98, 3.4445, 1.437, 0.871, 0.805, 0.261),
    "ur5": (3.7, 8.393, 2.33, 1.219, 1.219, 0.1879), "ur5e": (3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
    "ur7e": (3.761, 8.058, 2.846, 1.37, 1.3, 0.365), "ur10": (7.1, 12.7, 4.27, 2.0, 2.0, 0.365),
    "ur10e": (7.369, 13.051, 3.989, 2.1, 1.98, 0.615), "ur12e": (7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
    "ur16e": (7.369, 10.45, 4.321, 2.18, 2.033, 0.907), "ur20": (16.343, 29.632, 7.879, 3.054, 3.126, 0.926),
    "ur30": (16.343, 28.542, 7.156, 3.054, 3.126, 0.926),
}  # fmt: skip


@MAKERS
def test_links_weigh_what_the_maker_says(name):
    """Models without figures of their own have those of a UR20 in the proportion of their volume."""
    links = {link.get("name"): link.find("inertial/mass") for link in get_arm(name).robot.iterfind("link")}
    weighed = [float(mass.get("value")) for mass in links.values() if mass is not None]
    scaled = np.round(np.array(MASSES["ur20"]) * 0.9**3, 4)
    np.testing.assert_allclose(weighed, MASSES.get(name, scaled), rtol=1e-12)


def cylinders(robot, link, T, axis):
    """Begin, end and radius of the cylinders of a link about an axis; T is its frame in that of the axis."""
    for shape in robot.iterfind(f"link[@name='{link}']/collision"):
        placed, solid = T @ origin_of(shape), shape.find("geometry/cylinder")
        middle, half = placed[:3, 3] @ axis, float(solid.get("length")) / 2
        if abs(placed[:3, 2] @ axis) > 0.999 and np.linalg.norm(placed[:3, 3] - middle * axis) < 1e-6:
            yield middle - half, middle + half, float(solid.get("radius"))


@MAKERS
def test_housings_of_neighbours_meet_at_their_joint(name):
    """One ends where the next begins, with nearly its radius, from the table to the flange."""
    robot = get_arm(name).robot
    joints = {joint.get("name"): joint for joint in robot.iterfind("joint")}
    met = 0
    for joint in JOINTS:
        axis = np.array(joints[joint].find("axis").get("xyz").split(), dtype=float)
        ends = [joints[joint].find(end).get("link") for end in ("parent", "child")]
        T = np.linalg.inv(origin_of(joints[joint]))
        *below, (low, high, radius) = cylinders(robot, ends[0], T, axis)
        ((begin, end, other),) = cylinders(robot, ends[1], np.eye(4), axis)
        assert -0.0105 < max(begin - high, low - end) < 0.0065, joint
        if joint == JOINTS[0]:
            ((floor, foot, widest),) = below
            assert foot == pytest.approx(low, abs=2e-4)
            assert floor == pytest.approx(-UR_MODELS[name].lengths.d1, abs=1e-9)
            assert other < radius < widest < 1.6 * radius
            assert end == pytest.approx(other, abs=1e-9)  # as far as the housing across it
        else:
            assert not below
            assert radius == pytest.approx(other, abs=2.1e-3)
            assert 1.0 * radius < high - low < 3.1 * radius
        assert 0.65 * other < end - begin < 3.0 * other
        met += 1
    assert met == 6
    assert end == pytest.approx(UR_MODELS[name].lengths.d6, abs=1e-9)


@MAKERS
def test_tubes_are_between_the_housings_at_their_ends(name):
    """Each ends at the axes of two joints, within the width of their housings, with collars that are wider than it."""
    robot, lengths, found = get_arm(name).robot, UR_MODELS[name].lengths, 0
    for link, long in (("upper_arm_link", -lengths.a2), ("forearm_link", -lengths.a3)):
        housings, along = [], []
        for shape in robot.iterfind(f"link[@name='{link}']/collision"):
            T, solid = origin_of(shape), shape.find("geometry/cylinder")
            length, radius = (float(solid.get(key)) for key in ("length", "radius"))
            is_across = abs(T[1, 2]) > 0.999
            middle = T[1 if is_across else 2, 3]
            span = middle - length / 2, middle + length / 2
            (housings if is_across else along).append((*(span if is_across else (*span, T[1, 3])), radius))
        (start, end, aside, thick), *collars = along
        assert (start, end) == pytest.approx((0.0, long), abs=1e-9)
        assert len(housings) == 2
        for low, high, radius in housings:
            assert low - 6e-3 < aside - thick
            assert aside + thick < high
            assert 0.6 * radius < thick <= 1.15 * radius
        assert len(collars) == (2 if link == "upper_arm_link" else 1)
        for begin, stop, place, wide in collars:
            assert place == aside
            assert min(abs(begin), abs(stop - long)) < 1e-9  # from one of the axes
            radius = housings[0][2] if begin == 0.0 else housings[1][2]
            assert thick <= wide <= 1.15 * radius
            assert 0.95 * radius < stop - begin < 2.4 * radius
            found += 1
    assert found == 3


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
