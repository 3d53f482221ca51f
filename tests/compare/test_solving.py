"""Solvers as methods, and the one that starts where a policy says."""

import numpy as np

from kinreach.checks import Floats
from kinreach.compare.attempts import Attempt
from kinreach.compare.deciding import Decide, Decision, Method
from kinreach.compare.methods import METHODS
from kinreach.compare.solving import SeededMethod, SolverMethod
from kinreach.compare.tasks import UR5Task
from kinreach.kinematics.solvers.levenberg_marquardt import LevenbergMarquardtSolver

GOALS = 100


def _attempts(task: UR5Task, method: Method, goals: Floats) -> list[Attempt]:
    attempts = [Attempt(method, goal, None) for goal in goals]
    for attempt in attempts:
        attempt.decide(task.home)
    return attempts


def test_the_hybrid_needs_fewer_iterations_and_no_more_restarts_than_the_cold_start(task: UR5Task) -> None:
    goals = task.goals(GOALS, 4)
    cold, hybrid = (_attempts(task, METHODS["ur5"][name](task), goals) for name in ("lm", "hybrid"))
    for started_cold, seeded, goal in zip(cold, hybrid, goals, strict=True):
        for attempt in (started_cold, seeded):
            assert attempt.decision.q is not None
            assert task.accept(attempt.decision.q)
            assert np.linalg.norm(task.kinematics.fk(attempt.decision.q)[:3, 3] - goal) <= 1e-4
        assert seeded.restarts <= started_cold.restarts
    iterations = [[attempt.iterations for attempt in attempts] for attempts in (cold, hybrid)]
    assert np.median(iterations[1]) < np.median(iterations[0])
    assert len(cold) == len(hybrid) == GOALS


class _Proposer:
    """Always proposes the same."""

    kind, moves, two_phase = "policy", 1, True
    versions = {"policy x": "abc"}  # noqa: RUF012 (as the protocol has it)

    def __init__(self, decision: Decision) -> None:
        self.decision = decision

    def about(self, position: Floats, view: Floats | None) -> Decide:
        """Nothing matters."""
        return lambda q: self.decision


def test_the_solver_starts_where_the_proposal_says_and_its_own_effort_counts(task: UR5Task) -> None:
    solver = SolverMethod(task, LevenbergMarquardtSolver(task.new_kinematics()))
    goal = task.goals(1, 0)[0]
    solution = _attempts(task, solver, [goal])[0].decision.q  # type: ignore[arg-type]
    assert solution is not None
    seeded = SeededMethod(_Proposer(Decision(solution, iterations=7)), solver)
    (attempt,) = _attempts(task, seeded, [goal])  # type: ignore[arg-type]
    assert (attempt.iterations, attempt.restarts, attempt.candidates) == (0, 0, 1)
    assert np.array_equal(attempt.decision.q, solution)
    assert seeded.versions == {"policy x": "abc"}


def test_without_a_proposal_there_is_no_posture(task: UR5Task) -> None:
    solver = SolverMethod(task, LevenbergMarquardtSolver(task.new_kinematics()))
    nothing = Decision(None, "lost", "no idea")
    (attempt,) = _attempts(task, SeededMethod(_Proposer(nothing), solver), task.goals(1, 0))
    assert attempt.decision is nothing


def test_a_solver_that_fails_says_why(task: UR5Task) -> None:
    solver = SolverMethod(task, LevenbergMarquardtSolver(task.new_kinematics()))
    (attempt,) = _attempts(task, solver, [np.array([3.0, 0.0, 0.0])])  # type: ignore[arg-type]
    assert attempt.decision.q is None
    assert attempt.decision.status == "not converged"
    assert "attempts" in attempt.decision.reason
    assert attempt.restarts > 0
