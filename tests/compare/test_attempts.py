"""A method that makes several moves: when it is asked, what is counted, and when it stops."""

from collections.abc import Callable

import numpy as np
import pytest

from kinreach.checks import Floats
from kinreach.compare.attempts import Attempt, Ending, execute
from kinreach.compare.deciding import Decide, Decision
from kinreach.compare.solving import SolverMethod
from kinreach.compare.tasks import UR5Task
from kinreach.kinematics.solvers.base import ClosedFormSolver
from kinreach.sim.simulation import ArmSimulation


class Walker:
    """Goes where a function of the posture says, and remembers where it was asked."""

    kind = "policy"
    two_phase = False
    versions: dict[str, str] = {}  # noqa: RUF012 (as the protocol has it)

    def __init__(self, moves: int, step: Callable[[Floats], Decision]) -> None:
        self.moves, self.step = moves, step
        self.asked: list[Floats] = []

    def about(self, position: Floats, view: Floats | None) -> Decide:
        """Nothing is said of the goal."""

        def decide(q: Floats) -> Decision:
            self.asked.append(q.copy())
            return self.step(q)

        return decide


@pytest.fixture
def attempt(task: UR5Task, simulation: ArmSimulation) -> Callable[[Walker, Floats], tuple[Attempt, Ending]]:
    """`attempt(walker, goal)`: all of it."""

    def whole(walker: Walker, goal: Floats) -> tuple[Attempt, Ending]:
        begun = Attempt(walker, goal, None)
        begun.decide(task.home)
        return begun, execute(task, simulation, goal, begun)

    return whole


Attempts = Callable[[Walker, Floats], tuple[Attempt, Ending]]
TURN = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_it_is_asked_after_every_move_until_it_has_none_left(attempt: Attempts, task: UR5Task) -> None:
    walker = Walker(4, lambda q: Decision(q + TURN, iterations=1, accept_s=0.25, candidates=2, restarts=3))
    begun, ending = attempt(walker, task.goals(1, 0)[0])
    assert np.array_equal(walker.asked[0], task.home)
    assert np.array([q[0] for q in walker.asked]) == pytest.approx(task.home[0] + 0.05 * np.arange(4), abs=0.02)
    assert (begun.iterations, begun.accept_s, begun.candidates, begun.restarts) == (4, 1.0, 8, 12)
    assert begun.solve_s > 0
    assert (ending.status, ending.impossible, ending.verdict.reached) == ("completed", False, False)
    assert np.array_equal(ending.q, walker.asked[3] + TURN)


def test_moves_take_their_time_one_after_the_other(attempt: Attempts, task: UR5Task) -> None:
    goal = task.goals(1, 0)[0]
    times = [attempt(Walker(moves, lambda q: Decision(q + TURN)), goal)[1].move_s for moves in (1, 2, 3)]
    assert times[0] > 0.05
    assert np.diff(times) == pytest.approx(times[0], rel=0.5)


def test_it_stops_where_the_task_is_done(attempt: Attempts, task: UR5Task) -> None:
    goal = task.goals(1, 0)[0]
    there = SolverMethod(task, ClosedFormSolver(task.new_kinematics())).about(goal, None)(task.home).q
    assert there is not None
    half = (task.home + there) / 2
    walker = Walker(100, lambda q: Decision(half if np.array_equal(q, task.home) else there))
    _, ending = attempt(walker, goal)
    assert len(walker.asked) == 2
    assert (ending.verdict.reached, ending.verdict.reward) == (True, 20.0)


def test_a_blocked_move_on_the_way_is_forgiven_and_the_last_one_is_not(attempt: Attempts, task: UR5Task) -> None:
    down = task.home + np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])  # into the table
    goal = task.goals(1, 0)[0]
    _, ending = attempt(Walker(2, lambda q: Decision(down if np.array_equal(q, task.home) else task.home)), goal)
    assert (ending.status, ending.impossible) == ("completed", False)
    walker = Walker(2, lambda q: Decision(q + TURN if np.array_equal(q, task.home) else down))
    _, ending = attempt(walker, goal)
    assert (ending.impossible, ending.verdict.reward) == (True, -100.0)
    assert "table" in ending.reason


def test_a_method_may_give_up_on_the_way(attempt: Attempts, task: UR5Task) -> None:
    walker = Walker(
        9, lambda q: Decision(q + TURN) if np.array_equal(q, task.home) else Decision(None, "tired", "no more")
    )
    begun, ending = attempt(walker, task.goals(1, 0)[0])
    assert len(walker.asked) == 2
    assert begun.decision.q is ending.q is None
    assert (ending.status, ending.reason, ending.impossible) == ("tired", "no more", True)


def test_the_distance_is_that_of_the_tip_in_the_simulation(attempt: Attempts, task: UR5Task) -> None:
    checked = 0
    for goal in task.goals(5, 1):
        _, ending = attempt(Walker(1, lambda q: Decision(q + TURN)), goal)
        assert ending.distance == pytest.approx(np.linalg.norm(ending.tip - goal), rel=1e-14)
        assert ending.tip == pytest.approx(task.kinematics.fk(task.home + TURN)[:3, 3], abs=0.012)
        checked += 1
    assert checked == 5
