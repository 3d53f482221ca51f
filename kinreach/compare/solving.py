"""Inverse kinematics as a method: a solver finds one posture, which is then executed."""

from __future__ import annotations

import time
from collections.abc import Mapping

from kinreach.checks import Floats
from kinreach.compare.deciding import SEEDED, SOLVER, Decide, Decision, Method
from kinreach.compare.tasks import ReachTask
from kinreach.kinematics.solvers.base import Solver


class SolverMethod:
    """Asks a solver once, with the posture in which the arm stands as the seed.

    Args:
        task: Sets the question and the acceptance test.
        solver: For the task's arm in the world frame.
    """

    kind = SOLVER
    moves = 1
    two_phase = True
    versions: Mapping[str, str] = {}

    def __init__(self, task: ReachTask, solver: Solver) -> None:
        self._task, self._solver = task, solver

    def about(self, position: Floats, view: Floats | None) -> Decide:
        """See `Method.about`."""
        goal = self._task.ik_goal(position)

        def decide(q: Floats) -> Decision:
            acceptance = _Acceptance(self._task)
            result = self._solver.solve(goal, q, accept=acceptance)
            return Decision(
                q=result.q if result.success else None,
                status="" if result.success else result.status.value,
                reason=result.reason,
                iterations=result.iterations,
                restarts=result.restarts,
                candidates=acceptance.calls,
                accept_s=acceptance.seconds,
            )

        return decide


class SeededMethod:
    """A solver that starts from the posture which another method proposes.

    Args:
        proposer: Says where to start; its own iterations are not counted, its time is.
        solver: Finishes.
    """

    kind = SEEDED
    moves = 1
    two_phase = True

    def __init__(self, proposer: Method, solver: Method) -> None:
        self._proposer, self._solver = proposer, solver
        self.versions = {**proposer.versions, **solver.versions}

    def about(self, position: Floats, view: Floats | None) -> Decide:
        """See `Method.about`."""
        propose, finish = self._proposer.about(position, view), self._solver.about(position, view)

        def decide(q: Floats) -> Decision:
            proposed = propose(q)
            return proposed if proposed.q is None else finish(proposed.q)

        return decide


class _Acceptance:
    """The task's acceptance test with a clock."""

    def __init__(self, task: ReachTask) -> None:
        self._task = task
        self.seconds = 0.0
        self.calls = 0

    def __call__(self, q: Floats) -> bool:
        start = time.perf_counter()
        accepted = self._task.accept(q)
        self.seconds += time.perf_counter() - start
        self.calls += 1
        return accepted
