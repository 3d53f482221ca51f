"""Every method is asked the same, in turns, and failures are told apart."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from kinreach.checks import Floats
from kinreach.compare.observation import WARM_UP_SEED, Sight
from kinreach.compare.runner import WARM_UP_GOALS, run_trials
from kinreach.compare.settings import MOST_SEED, Settings
from kinreach.compare.solving import SolverMethod
from kinreach.compare.tasks import UR5Task
from kinreach.errors import InputError
from kinreach.kinematics.goals import AxisGoal
from kinreach.kinematics.solutions import IKResult, Status
from kinreach.sim.simulation import ArmSimulation


class Recorder:
    """Writes down what it is asked, asks the acceptance test twice, and answers as told."""

    def __init__(self, name: str, log: list[tuple[str, Any]], answer: IKResult) -> None:
        self.name, self.log, self.answer = name, log, answer

    def solve(self, goal: Any, seed: Any, *, accept: Any = None) -> IKResult:
        """The answer it was made with."""
        self.log.append((self.name, (goal, np.array(seed))))
        accept(self.answer.q)
        accept(self.answer.q)
        return self.answer


def _answer(q: Floats, status: Status = Status.OK, reason: str = "") -> IKResult:
    return IKResult(q, status, position_error=0.0, orientation_error=0.0, reason=reason, iterations=3, restarts=1)


def _methods(task: UR5Task, names: str, log: list[tuple[str, Any]], answer: IKResult) -> dict[str, SolverMethod]:
    return {name: SolverMethod(task, Recorder(name, log, answer)) for name in names}


def test_all_methods_are_asked_the_same_in_turns(task: UR5Task, simulation: ArmSimulation) -> None:
    log: list[tuple[str, Any]] = []
    goals = task.goals(8, 0)
    trials = list(run_trials(task, _methods(task, "abc", log, _answer(task.home)), goals, simulation))
    assert len(trials) == 24
    measured = log[3 * WARM_UP_GOALS :]
    orders = ["".join(name for name, _ in measured[start : start + 3]) for start in range(0, 24, 3)]
    assert {"".join(sorted(order)) for order in orders} == {"abc"}
    assert {order[0] for order in orders} == {"a", "b", "c"}
    assert len(set(orders)) > 3
    for index, (_, (goal, seed)) in enumerate(measured):
        assert isinstance(goal, AxisGoal)
        assert np.array_equal(goal.position, goals[index // 3])
        assert np.array_equal(seed, task.home)
    warm_up = [goal.position for _, (goal, _) in log[: 3 * WARM_UP_GOALS]]
    assert not any(np.array_equal(w, g) for w in warm_up for g in goals)
    assert {trial.candidates for trial in trials} == {2}
    assert all(0 < trial.accept_s < trial.solve_s for trial in trials)


@pytest.mark.parametrize("seed", [0, 2**32 - 1, MOST_SEED])
def test_no_seed_of_a_comparison_draws_the_goals_of_the_warm_up(
    task: UR5Task, simulation: ArmSimulation, seed: int
) -> None:
    assert Settings(seed=seed).seed == seed
    with pytest.raises(InputError, match="the seed must be at most"):
        Settings(seed=WARM_UP_SEED)
    log: list[tuple[str, Any]] = []
    goals = task.goals(WARM_UP_GOALS, seed)
    list(run_trials(task, _methods(task, "a", log, _answer(task.home)), goals[:1], simulation))
    warm_up = [goal.position for _, (goal, _) in log[:WARM_UP_GOALS]]
    assert len(log) == WARM_UP_GOALS + 1
    assert not any(np.array_equal(w, g) for w in warm_up for g in goals)


def test_trials_that_are_done_are_left_out(task: UR5Task, simulation: ArmSimulation) -> None:
    methods = _methods(task, "ab", [], _answer(task.home))
    trials = list(run_trials(task, methods, task.goals(2, 0), simulation))
    done = [trial for trial in trials if (trial.goal, trial.method) in {(0, "a"), (1, "b")}]
    left = run_trials(task, methods, task.goals(2, 0), simulation, done=done)
    assert [(trial.goal, trial.method) for trial in left] == [(0, "b"), (1, "a")]


def test_methods_are_told_what_was_seen_and_judged_by_what_is_true(task: UR5Task, simulation: ArmSimulation) -> None:
    log: list[tuple[str, Any]] = []
    methods = _methods(task, "ab", log, _answer(task.home + 0.1))
    goals, off = task.goals(2, 0), np.array([0.03, 0.0, 0.04])
    looked: list[int] = []

    def look(index: int, position: Floats) -> Sight:
        looked.append(index)
        return Sight(position + off, 0.07)

    trials = list(run_trials(task, methods, goals, simulation, look=look))
    assert looked == [0, 1]  # once per goal
    asked = [goal.position for _, (goal, _) in log[2 * WARM_UP_GOALS :]]
    assert np.array_equal(asked, (goals + off)[[0, 0, 1, 1]])
    for trial in trials:
        goal = goals[trial.goal]
        assert (trial.x, trial.y, trial.z) == tuple(goal)
        assert (trial.seen_x, trial.seen_y, trial.seen_z) == tuple(goal + off)
        assert trial.seen_error == pytest.approx(0.05)
        assert trial.look_s == 0.07
        tip = task.kinematics.fk(task.home + 0.1)[:3, 3]
        assert trial.distance == pytest.approx(np.linalg.norm(tip - goal), abs=0.012)
        assert abs(trial.distance - np.linalg.norm(tip - goal - off)) > 0.012


def test_nobody_looks_at_a_finished_goal_and_the_rest_is_told_the_same(
    task: UR5Task, simulation: ArmSimulation
) -> None:
    view = np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0])
    sights = {
        0: Sight(None, 0.1, np.zeros(6)),
        1: Sight(np.array([0.4, 0.1, -0.2]), 0.2, view),
        2: Sight(np.array([0.5, 0.0, -0.1]), 0.3, view),
    }
    methods = _methods(task, "ab", [], _answer(task.home))
    goals = task.goals(3, 0)
    trials = list(run_trials(task, methods, goals, simulation, look=lambda index, position: sights[index]))
    assert [trial.status for trial in trials] == ["no ball found"] * 2 + ["completed"] * 4

    def never(index: int, position: Floats) -> Sight:
        pytest.fail(f"goal {index} was looked at again")

    again = list(run_trials(task, methods, goals, simulation, look=never, done=[trials[0], trials[3], *trials[4:]]))
    untimed = {"solve_s": 0.0, "accept_s": 0.0}
    assert [replace(trial, **untimed) for trial in again] == [replace(trials[k], **untimed) for k in (1, 2)]
    assert trials[2].view == (1.0, 2.0, 3.0, 0.0, 0.0, 0.0)


def test_a_ball_that_no_camera_found_is_asked_of_nobody(task: UR5Task, simulation: ArmSimulation) -> None:
    log: list[tuple[str, Any]] = []
    methods = _methods(task, "a", log, _answer(task.home))
    goals = task.goals(1, 0)
    (trial,) = run_trials(task, methods, goals, simulation, look=lambda index, position: Sight(None, 0.1))
    assert len(log) == WARM_UP_GOALS
    assert (trial.impossible, trial.reached, trial.reward) == (True, False, -100.0)
    assert (trial.status, trial.reason) == ("no ball found", "no camera found the ball")
    assert {trial.q, trial.move_s, trial.solve_s, trial.ik_error, trial.candidates} == {None}
    assert {trial.seen_x, trial.move_error, trial.moving} == {None}
    start = task.kinematics.fk(task.home)[:3, 3]
    assert trial.distance == pytest.approx(np.linalg.norm(start - task.goals(1, 0)[0]), abs=1e-6)


def test_no_posture_is_impossible_and_the_arm_stays(task: UR5Task, simulation: ArmSimulation) -> None:
    answer = _answer(task.home + 0.3, Status.REJECTED, "every posture collides")
    (trial,) = run_trials(task, _methods(task, "a", [], answer), task.goals(1, 0), simulation)
    assert (trial.impossible, trial.reached) == (True, False)
    assert (trial.status, trial.reason) == ("rejected", "every posture collides")
    assert (trial.reward, trial.move_s, trial.q) == (-100.0, None, None)
    assert {trial.ik_error, trial.move_error, trial.seeing, trial.deciding, trial.moving} == {None}
    start = task.kinematics.fk(task.home)[:3, 3]
    assert trial.distance == pytest.approx(np.linalg.norm(start - task.goals(1, 0)[0]), abs=1e-6)


def test_a_posture_that_cannot_be_executed_is_impossible_and_says_why(task: UR5Task, simulation: ArmSimulation) -> None:
    into_the_table = task.home + np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    assert task.kinematics.fk(into_the_table)[2, 3] < -0.22
    (trial,) = run_trials(task, _methods(task, "a", [], _answer(into_the_table)), task.goals(1, 0), simulation)
    assert (trial.impossible, trial.reached, trial.move_s, trial.reward) == (True, False, None, -100.0)
    assert "table" in trial.reason
    assert trial.q == tuple(into_the_table)


def test_a_completed_move_is_measured_in_the_simulation(task: UR5Task, simulation: ArmSimulation) -> None:
    (trial,) = run_trials(task, _methods(task, "a", [], _answer(task.home + 0.1)), task.goals(1, 0), simulation)
    assert (trial.impossible, trial.status, trial.reason) == (False, "completed", "")
    assert (trial.iterations, trial.restarts) == (3, 1)
    assert trial.move_s is not None
    assert 0.05 < trial.move_s < 3
    expected = np.linalg.norm(task.kinematics.fk(task.home + 0.1)[:3, 3] - task.goals(1, 0)[0])
    assert trial.distance == pytest.approx(expected, abs=0.012)
    assert trial.ik_error == pytest.approx(expected, abs=1e-12)
    assert trial.move_error is not None
    assert 0 < trial.move_error < 0.012
    assert (trial.seeing, trial.view) == (0.0, None)
    assert trial.deciding + trial.moving == pytest.approx(trial.distance, abs=1e-15)
