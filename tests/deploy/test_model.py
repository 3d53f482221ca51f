"""Another model than the one that is named never passes, in no posture; a real arm of the right model always does."""

from itertools import permutations

import numpy as np
import pytest

from kinreach._rotations import pose_error
from kinreach.deploy import Move, Program, SimulatedUR, URClient
from kinreach.deploy._controller import FINISHED, OTHER_ARM, REGISTER, Controller
from kinreach.deploy._model import (
    MAX_OFF,
    MAX_OFF_CALIBRATED,
    POSTURES,
    DhFigures,
    ModelCheck,
    allowed,
    apart,
    nearest_models,
)
from kinreach.deploy._move_cli import Comparison
from kinreach.deploy._primary import figures_package, news_in
from kinreach.errors import RobotError
from kinreach.kinematics import ArmKinematics, pose_vector
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm
from kinreach.robots.inside import UR_LENGTHS
from tests.cases import slow

#: Models of the same lengths under two names, which no kinematics can tell apart.
TWINS = [{"ur5e", "ur7e"}, {"ur10e", "ur12e"}]


def bare(name):
    """The arm of a model, without a tool."""
    arm = get_arm(name)
    return arm if arm.gripper is None else arm.with_tool([0, 0, 0, 0, 0, 0])


CHECKS = {name: ModelCheck.of(bare(name)) for name in UR_LENGTHS}
KINEMATICS = {name: ArmKinematics(bare(name), tip="tool0", base="base") for name in UR_LENGTHS}


def real_arm(rng, model, metres, radians):
    """Figures of a model with random deviations, as a calibration has them."""
    theta, a, d, alpha = DhFigures.by_data_sheet(model)
    return DhFigures(
        theta + radians * rng.uniform(-1, 1, 6), a + metres * rng.uniform(-1, 1, 6),
        d + metres * rng.uniform(-1, 1, 6), alpha + radians * rng.uniform(-1, 1, 6),
    )  # fmt: skip


def test_figures_of_the_data_sheet_are_those_of_the_arms():
    rng, tried = np.random.default_rng(0), 0
    for name, kin in KINEMATICS.items():
        figures, own = DhFigures.by_data_sheet(name), DhFigures.of(kin)
        for q in rng.uniform(-np.pi, np.pi, (20, 6)):
            np.testing.assert_allclose(figures.fk(q), kin.fk(q), atol=1e-9)
            np.testing.assert_allclose(own.fk(q), kin.fk(q), atol=1e-9)
            tried += 1
    assert tried == 20 * len(UR_LENGTHS)


@pytest.mark.parametrize("name", PUBLISHED_CALIBRATIONS)
def test_figures_of_a_calibrated_arm_give_its_poses_and_travel_as_they_are(name):
    """Where two axes are almost parallel they have hundreds of metres, as on a controller."""
    model = name.partition("_")[0]
    kin = ArmKinematics(bare(model).calibrated(PUBLISHED_CALIBRATIONS[name], model=model), tip="tool0", base="base")
    figures = DhFigures.of(kin)
    (back,) = news_in(bytearray(figures_package(figures)))
    np.testing.assert_array_equal(np.array(back), np.array(figures))
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, (50, 6)):
        np.testing.assert_allclose(figures.fk(q), kin.fk(q), atol=1e-8)
    assert model in nearest_models(kin.fk)
    for mine, check in CHECKS.items():  # a real arm passes for its model, and for no other
        same = mine == model or {mine, model} in TWINS
        assert apart(MAX_OFF, *check.difference(kin.fk)) is not same, mine


def test_an_arm_without_such_figures_has_none():
    """One whose flange is where no Denavit-Hartenberg figures have it."""
    arm = bare("ur5e")
    kin = ArmKinematics(arm, tip="tool0", base=[0.1, 0.2, 0, 0.3, 0, 0])
    assert DhFigures.of(kin) is None


@pytest.mark.slow
def test_no_model_passes_for_another_by_any_posture_and_every_one_for_itself():
    """By one posture some do: how many is counted, so that the five are what makes the difference."""
    rng = np.random.default_rng(2)
    postures, pairs, lucky, passed = rng.uniform(-np.pi, np.pi, (300, 6)), 0, set(), []
    for mine, theirs in permutations(UR_LENGTHS, 2):
        far, turned = CHECKS[mine].difference(KINEMATICS[theirs].fk)
        if {mine, theirs} in TWINS:
            assert (far, turned) == pytest.approx((0.0, 0.0), abs=1e-6)
            continue
        pairs += 1
        assert far > 0.028
        for q in postures:
            off, turn = pose_error(KINEMATICS[mine].fk(q), KINEMATICS[theirs].fk(q))
            if not apart(MAX_OFF, off, np.degrees(turn)):
                lucky.add((mine, theirs))
                passed += [(mine, theirs)] * (not apart(MAX_OFF, far, turned))
    assert pairs == 14 * 13 - 4
    assert passed == []
    assert len(lucky) > 20  # pairs that one posture takes for each other


def test_real_arms_pass_for_their_model_and_no_other():
    """Made-up calibrations with deviations up to 1.5 mm and 2 mrad in each figure."""
    rng, own, others = np.random.default_rng(3), 0, 0
    for _ in range(300):
        model = rng.choice(list(UR_LENGTHS))
        arm = real_arm(rng, model, 1.5e-3, 2e-3)
        other = rng.choice(list(UR_LENGTHS))
        assert not apart(MAX_OFF, *CHECKS[model].difference(arm.fk))
        assert model in nearest_models(arm.fk)
        own += 1
        if other != model and {other, model} not in TWINS:
            wrong = apart(MAX_OFF, *CHECKS[other].difference(arm.fk)) or other not in nearest_models(arm.fk)
            assert wrong, (model, other)
            others += 1
    assert own == 300
    assert others > 200


@pytest.mark.slow
def test_an_arm_with_its_calibration_is_told_from_another_of_its_model():
    """Where the five postures agree within half a millimetre, the whole workspace does within two."""
    arm = bare("ur5e").calibrated(PUBLISHED_CALIBRATIONS["ur5e_a"])
    check, kin = ModelCheck.of(arm), ArmKinematics(arm, tip="tool0", base="base")
    assert allowed(arm) == check.most == MAX_OFF_CALIBRATED
    assert not apart(check.most, *check.difference(kin.fk))
    assert apart(check.most, *check.difference(KINEMATICS["ur5e"].fk))
    rng, refused, passed, worst = np.random.default_rng(4), 0, 0, 0.0
    for _ in range(300):
        own = real_arm(rng, "ur5e", 1e-3, 1e-3)
        poses = tuple(tuple(pose_vector(own.fk(np.array(q)))) for q in POSTURES)
        check = ModelCheck(POSTURES, poses, MAX_OFF_CALIBRATED)
        size = 10 ** rng.uniform(-4.5, -2.5)
        other = DhFigures(*(row + size * rng.uniform(-1, 1, 6) for row in own))
        if apart(check.most, *check.difference(other.fk)):
            refused += 1
            continue
        passed += 1
        for q in rng.uniform(-np.pi, np.pi, (20, 6)):
            worst = max(worst, pose_error(other.fk(q), own.fk(q))[0])
    assert refused > 100
    assert passed > 80
    assert 5e-4 < worst < 2e-3


@pytest.mark.parametrize("pairs", [6, *slow(178)])
def test_a_program_moves_its_own_model_only(pairs):
    """It asks the robot's own kinematics before it moves; nothing but the controller takes part."""
    every = [pair for pair in permutations(UR_LENGTHS, 2) if set(pair) not in TWINS]
    chosen = np.random.default_rng(5).permutation(len(every))[:pairs]
    robots, refused = {}, 0
    for mine, theirs in [every[index] for index in chosen] + [("ur5e", "ur7e"), ("ur3", "ur3")]:
        if theirs not in robots:
            robots[theirs] = Controller(bare(theirs), q=np.array(get_arm(theirs).home).tolist())
        ur = robots[theirs]
        start = ur.actual_q
        program = Program.of(ArmKinematics.of(bare(mine), base="base"), start, [Move("movej", start + 0.05, 1.0, 2.0)])
        done = ur.run(program.text)
        same = mine == theirs or {mine, theirs} in TWINS
        assert done.status == (FINISHED if same else OTHER_ARM), (mine, theirs)
        if not same:
            np.testing.assert_allclose(done.commanded.q, np.tile(start, (len(done.commanded.t), 1)), atol=1e-12)
            refused += 1
    assert refused == pairs


def test_a_client_says_that_the_robot_is_another():
    kin = KINEMATICS["ur3e"]
    start = np.array(get_arm("ur5e").home)
    program = Program.of(kin, start, [Move("movej", start + 0.3, 1.0, 2.0)])
    with (
        SimulatedUR(bare("ur5e"), rtde_port=0, script_port=0, speed=8.0, log=(log := []).append) as robot,
        URClient(robot.address, rtde_port=robot.rtde_port, script_port=robot.script_port) as client,
    ):
        with pytest.raises(RobotError, match=r"did not move: its own kinematics is not that of the arm"):
            client.run(program)
        assert robot.controller.registers[REGISTER] == OTHER_ARM
        np.testing.assert_allclose(client.read().actual_q, start, atol=1e-6)
        assert any("popup: This is not the arm that this program was planned for" in line for line in log)
        figures = client.wait_for_figures(5.0)
        for q in np.random.default_rng(6).uniform(-3, 3, (10, 6)):
            np.testing.assert_allclose(figures.fk(q), KINEMATICS["ur5e"].fk(q), atol=1e-9)


def test_the_move_command_judges_a_model_by_the_figures_that_the_robot_says():
    """In postures in which the two models have the tool at the same place, and with deviations of real arms."""
    rng, cases = np.random.default_rng(7), 0
    with (
        SimulatedUR(bare("ur5e"), rtde_port=0, script_port=0) as robot,
        URClient(robot.address, rtde_port=robot.rtde_port, script_port=robot.script_port) as client,
    ):
        state = client.read()
    arms = {name: Comparison(bare(name)) for name in ("ur3", "ur3e", "ur5e", "ur7e")}
    while cases < 40:
        q = rng.uniform(-np.pi, np.pi, 6)
        mine, theirs = (("ur3e", "ur5e"), ("ur3", "ur3e"))[cases % 2]
        arm = real_arm(rng, theirs, 1e-3, 1e-3)
        T = arm.fk(q)
        if apart(MAX_OFF, *pose_error(KINEMATICS[mine].fk(q), T)):
            continue
        seen = type(state)(**{**vars(state), "actual_q": q, "tcp_pose": pose_vector(T), "tcp_offset": np.zeros(6)})
        assert "its tool centre point is" in arms[mine].same_arm(seen, None, "r")  # one posture cannot tell
        with pytest.raises(
            RobotError, match=f"is not this {mine.upper()}.*; its own figures are nearest to .*{theirs}"
        ):
            arms[mine].same_arm(seen, arm, "r")
        said = arms[theirs].same_arm(seen, arm, "r")
        assert "mm and" in said
        assert "in other postures; with --calibration it would be less" in said
        if theirs == "ur5e":
            assert "in other postures" in arms["ur7e"].same_arm(seen, arm, "r")
        # figures that do not give the robot's own pose are not understood, and say nothing
        assert "in other postures" not in arms[theirs].same_arm(seen, DhFigures.by_data_sheet("ur20"), "r")
        cases += 1
    assert cases == 40
