"""Goals, the acceptance test and the verdict of the tasks that are done by moving to a posture."""

import numpy as np
import pytest

from kinreach.compare.methods import METHODS
from kinreach.compare.tasks import REACH_TASKS, TASKS, Arm3Task, ReachTask, UR5Task
from kinreach.kinematics.goals import AxisGoal, PositionGoal
from kinreach.kinematics.solvers.base import ClosedFormSolver


@pytest.fixture(scope="module")
def ur5() -> UR5Task:
    """The thesis's task."""
    return UR5Task()


@pytest.fixture(scope="module")
def arm3() -> Arm3Task:
    """The reaching part of the button task."""
    return Arm3Task()


def test_every_task_has_methods_and_the_name_it_is_found_by() -> None:
    assert set(TASKS) == set(METHODS)
    assert all(TASKS[name].name == name and METHODS[name] for name in TASKS)


@pytest.mark.parametrize("name", sorted(REACH_TASKS))
def test_the_first_goals_do_not_depend_on_how_many_there_are(name: str) -> None:
    task = REACH_TASKS[name]()
    assert np.array_equal(task.goals(3, 5), task.goals(9, 5)[:3])
    assert np.array_equal(task.goals(9, 5), REACH_TASKS[name]().goals(9, 5))
    assert not np.array_equal(task.goals(3, 5), task.goals(3, 6))


def test_ur5_goals_lie_on_the_table_area_and_ask_for_the_tool_down(ur5: UR5Task) -> None:
    goals = ur5.goals(500, 0)
    assert goals.shape == (500, 3)
    assert ((goals[:, :2] >= (0.30, -0.30)) & (goals[:, :2] <= (0.65, 0.30))).all()
    assert goals[:, 2] == pytest.approx(-0.175)
    goal = ur5.ik_goal(goals[0])
    assert isinstance(goal, AxisGoal)
    assert np.array_equal(goal.axis, (0.0, 0.0, -1.0))


def test_arm3_goals_are_those_the_arm_can_reach(arm3: Arm3Task) -> None:
    solver = ClosedFormSolver(arm3.new_kinematics())
    goals = arm3.goals(100, 0)
    for position in goals:
        goal = arm3.ik_goal(position)
        assert isinstance(goal, PositionGoal)
        assert solver.solve(goal, arm3.home, accept=arm3.accept).success
    drawn = arm3.arm.workcell.goals.sample(np.random.default_rng(1), 1000)
    refused = [position for position in drawn if not arm3.usable(position)]
    assert 0 < len(refused) < 100
    assert {tuple(sign) for sign in np.sign(goals[:, :2])} == {(1, 1), (1, -1), (-1, 1), (-1, -1)}


@pytest.mark.parametrize("name", sorted(REACH_TASKS))
def test_the_start_posture_is_free(name: str) -> None:
    task = REACH_TASKS[name]()
    assert ReachTask.accept(task, task.home)


def test_ur5_accepts_both_natural_branches_and_nothing_else(ur5: UR5Task) -> None:
    assert ur5.accept(ur5.home)
    right_angle_at_wrist_2 = ur5.home + np.array([0, 0, 0, 0, 0.2, 0])
    assert not ur5.accept(right_angle_at_wrist_2)
    assert ReachTask.accept(ur5, right_angle_at_wrist_2)
    into_the_table = ur5.home + np.array([0, 1.2, 0, -1.2, 0, 0])
    assert not ur5.accept(into_the_table)


def test_ur5_verdicts_by_hand(ur5: UR5Task) -> None:
    assert ur5.judge(0.005, ur5.home, impossible=False).reward == 20.0
    assert ur5.judge(0.005, ur5.home, impossible=False).reached
    assert ur5.judge(0.005, ur5.home, impossible=False).posture_error == pytest.approx(0.0, abs=1e-9)
    far = ur5.judge(0.25, ur5.home, impossible=False)
    assert (far.reached, far.reward) == (False, pytest.approx(1.5))  # 0.5 - 0.5 log2(1/4)
    bent = ur5.judge(0.005, ur5.home + np.array([0, 0, 0, 0, 0.2, 0]), impossible=False)
    assert (bent.reached, bent.reward, bent.posture_error) == (False, pytest.approx(9.8), pytest.approx(0.2))
    impossible = ur5.judge(0.005, ur5.home, impossible=True)
    assert (impossible.reached, impossible.reward) == (False, -100.0)


def test_arm3_verdicts_by_hand(arm3: Arm3Task) -> None:
    near = arm3.judge(0.049, arm3.home, impossible=False)
    assert (near.reached, near.reward, near.posture_error) == (True, -0.049, None)
    assert not arm3.judge(0.05, arm3.home, impossible=False).reached
    blocked = arm3.judge(0.049, arm3.home, impossible=True)
    assert (blocked.reached, blocked.reward) == (False, -0.049)


def test_terms_say_what_is_alike(ur5: UR5Task, arm3: Arm3Task) -> None:
    for task in (ur5, arm3):
        assert {"goal", "seed_posture", "accept", "distance", "reached", "reward"} <= set(task.terms())
        assert task.terms()["reached"] == task.reached_means
