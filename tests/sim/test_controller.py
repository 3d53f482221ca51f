import copy

import mujoco
import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import CollisionChecker
from kinreach.sim import ArmSimulation, BatchSimulation
from kinreach.sim._controller import JointController
from kinreach.sim._plants import SinglePlant
from kinreach.sim._scene import TIMESTEP
from kinreach.sim.inside import MoveStatus

TABLE_TOP = -0.20
TIP_TO_FINGERTIP = 0.01


def test_two_phase_moves_reach_tool_down_postures(ur5, tool_down, goals):
    for goal in goals[:60]:
        ur5.reset()
        target = tool_down(goal)
        result = ur5.move(target)
        assert result.status is MoveStatus.REACHED, result.reason
        assert result.reached
        assert result.reason == ""
        np.testing.assert_array_equal(result.q, ur5.q)
        assert result.error == np.abs(ur5.q - target).max() <= 2e-4
        assert np.linalg.norm(ur5.tip_position - goal) < 2e-4
        assert 1.2 < result.duration == ur5.data.time < 1.4  # no phase waits, and no joint runs behind or overshoots
    assert len(goals) >= 60


def test_the_posture_at_the_end_is_the_one_it_keeps(ur5, tool_down, goals):
    for goal in goals[:5]:
        ur5.reset()
        assert ur5.move(tool_down(goal)).reached
        before = ur5.tip_position
        mujoco.mj_step(ur5.model, ur5.data, 1000)
        assert np.linalg.norm(ur5.tip_position - before) < 1e-4


def test_shoulder_lift_moves_last(ur5, tool_down):
    target = tool_down((0.45, -0.2, -0.175))
    others = [index for index, name in enumerate(ur5.arm.joints) if name != "shoulder_lift_joint"]
    start = ur5.q
    seen = record(ur5, lambda: ur5.move(target))
    lift_moves = np.abs(seen[:, 1] - start[1]) > 0.02
    others_arrived = (np.abs(seen[:, others] - target[others]) < 0.02).all(axis=1)
    assert lift_moves.any()
    assert others_arrived[lift_moves].all()


def test_in_one_phase_the_path_is_straight_in_joint_space(ur5):
    start, target = ur5.q, ur5.q + np.array([0.8, -0.3, 0.2, 0.5, -0.4, 1.0])
    seen = record(ur5, lambda: ur5.move(target, two_phase=False))
    share = (seen - start) @ (target - start) / ((target - start) @ (target - start))
    deviation = np.abs(seen - (start + share[:, None] * (target - start))).max()
    assert share[-1] == pytest.approx(1.0, abs=1e-3)
    assert deviation < 0.03


def test_speed_keeps_to_the_limit(ur5):
    seen = record(ur5, lambda: ur5.move(np.array([2.0, -1.0, 1.0, 1.0, 1.0, 3.0])), "qvel")
    assert 0.9 * ur5.arm.speed_limit < np.abs(seen).max() < 1.05 * ur5.arm.speed_limit


def record(simulation, run, field="qpos"):
    """What the arm's joints did in a move, by repeating it with an observer at every substep."""
    seen = []
    mujoco.set_mjcb_control(
        lambda _model, data: (
            seen.append(getattr(data, field)[simulation.controller.qpos].copy()) if data is not None else None
        )
    )
    try:
        assert run().reached
    finally:
        mujoco.set_mjcb_control(None)
    assert len(seen) > 100
    return np.array(seen)


def test_presses_into_the_table_are_blocked_by_the_table(ur5, tool_down, goals):
    for goal in goals[:12]:
        ur5.reset()
        result = ur5.move(tool_down(goal - [0.0, 0.0, 0.08]))
        assert result.status is MoveStatus.BLOCKED
        assert not result.reached
        assert "touches table" in result.reason
        assert result.error > ur5.controller.tolerance
        assert result.duration < 6.0


@pytest.mark.parametrize("depth", [1e-4, 3e-4, 1e-3])
def test_resting_on_the_table_is_blocked_also_within_the_tolerance(ur5, tool_down, depth):
    result = ur5.move(tool_down((0.45, 0.0, TABLE_TOP + TIP_TO_FINGERTIP - depth)))
    assert result.status is MoveStatus.BLOCKED
    assert result.reason.startswith("blocked: finger_")
    assert {touch.other for touch in result.touches} == {"table"}
    assert result.error < ur5.controller.tolerance
    assert 1e-5 < result.touches[0].depth < depth


@pytest.mark.parametrize("clearance", [1e-4, 1e-3])
def test_a_posture_just_above_the_table_is_reached(ur5, tool_down, clearance):
    result = ur5.move(tool_down((0.45, 0.0, TABLE_TOP + TIP_TO_FINGERTIP + clearance)))
    assert result.reached
    assert result.touches == ()


def test_verdicts_are_those_of_the_collision_checker_near_the_table(tool_down, goals):
    rng = np.random.default_rng(4)
    targets = np.array([tool_down(goal) for goal in goals])
    targets += rng.normal(size=targets.shape) * rng.choice((0.02, 0.05, 0.1), (len(targets), 1))
    batch, checker = BatchSimulation("ur5-thesis", len(targets)), CollisionChecker("ur5-thesis", margin=0.0)
    results = batch.move(np.arange(len(targets)), targets)
    colliding = np.array([checker.in_collision(target) for target in targets])
    assert 10 < colliding.sum() < len(targets) - 10
    np.testing.assert_array_equal([not result.reached for result in results], colliding)


@pytest.mark.slow
def test_verdicts_do_not_hang_on_the_timestep():
    targets = np.random.default_rng(5).uniform(-np.pi, np.pi, (40, 6))
    verdicts = []
    for timestep in (TIMESTEP, TIMESTEP / 2):
        batch = BatchSimulation("ur5-thesis", len(targets), timestep=timestep)
        verdicts.append([result.status for result in batch.move(np.arange(len(targets)), targets)])
    assert verdicts[0] == verdicts[1]
    assert all(verdicts[0].count(status) >= 8 for status in set(verdicts[0]))


def test_self_collision_is_called_so(ur5):
    folded = np.array(ur5.arm.home)
    folded[2] = 3.0
    folded[3] = 2.0
    result = ur5.move(folded)
    assert result.status is MoveStatus.COLLISION
    assert result.reason.startswith("self-collision: ")
    assert result.touches[0].with_itself


def test_arm_without_a_joint_to_move_last_and_a_press_into_the_floor():
    arm3 = ArmSimulation("arm3")
    assert arm3.move((1.0, 0.8, 0.9)).reached
    result = arm3.move((1.0, 2.0, 1.5))
    assert result.status is MoveStatus.BLOCKED
    assert "touches floor" in result.reason


@pytest.mark.parametrize("name", ["ur5-thesis", "arm3"])
def test_targets_out_of_limits_are_refused_by_joint(name):
    simulation = ArmSimulation(name)
    for index, joint in enumerate(simulation.arm.joints):
        for side in (simulation.controller.lower - 1e-6, simulation.controller.upper + 1e-6):
            target = simulation.q
            target[index] = side[index]
            result = simulation.move(target)
            assert result.status is MoveStatus.OUT_OF_LIMITS
            assert result.reason == f"out of limits: {joint}"
            assert result.duration == simulation.data.time == 0.0
            np.testing.assert_array_equal(result.q, simulation.arm.home)


def test_a_servo_too_weak_to_arrive_is_blocked_by_nothing(ur5):
    model = copy.copy(ur5.model)
    model.jnt_actfrcrange[model.joint("wrist_3_joint").id] = 0.0
    plant = SinglePlant(model, ur5.data)
    (result,) = JointController(ur5.arm, model).move(plant, np.array([0]), (ur5.q + np.eye(6)[5])[None])
    assert result.status is MoveStatus.BLOCKED
    assert result.reason == "blocked: wrist_3_joint does not arrive, nothing touches"


def test_an_arm_that_never_comes_to_rest_is_late(ur5):
    """Two seconds after it should have arrived, wherever it is by then."""
    target = ur5.q + 0.3
    assert ur5.move(target).reached
    usual, follow = ur5.data.time, SinglePlant.follow
    ur5.reset()

    class Restless(SinglePlant):
        def follow(self, *given):
            follow(self, *given)
            self.qvel[:, 4] = 0.1

    for wrist_2 in (0.0, 0.5):
        plant = Restless(ur5.model, ur5.data)
        (late,) = ur5.controller.move(plant, np.array([0]), (ur5.q + 0.3 + wrist_2 * np.eye(6)[4])[None])
        assert late.status is MoveStatus.TIMEOUT
        assert late.reason == "timeout: wrist_2_joint does not arrive, nothing touches"
        assert 1.6 < late.duration - usual < 2.4
        ur5.reset()


@pytest.mark.parametrize("target", [np.zeros(5), np.full(6, np.nan), "left"])
def test_malformed_targets_are_errors(ur5, target):
    with pytest.raises(InputError, match="q_target"):
        ur5.move(target)
