"""Every method on every goal: solve, then execute the posture in the simulation, and measure.

All methods solve one goal before any of them is executed, and the order rotates from goal to goal: load from other
programs and the state of the processor's caches meet all methods alike. Every move starts from the same state.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from kinreach.compare.tasks import Task
from kinreach.compare.trials import COMPLETED, Trial
from kinreach.envs.simulation import ArmSimulation
from kinreach.kinematics.goals import Floats
from kinreach.kinematics.result import IKResult
from kinreach.kinematics.solvers.base import Solver

#: Goals that every method solves untimed first, and the seed they are drawn with (never among those compared).
WARM_UP_GOALS = 3
WARM_UP_SEED = 2**32 - 1


def run_trials(
    task: Task,
    solvers: Mapping[str, Solver],
    goals: Floats,
    simulation: ArmSimulation,
    *,
    done: Collection[tuple[int, str]] = (),
) -> Iterator[Trial]:
    """Yield a trial per goal and method as it is finished.

    Args:
        task: Sets the question, the acceptance test and the verdict.
        solvers: Methods by name.
        goals: Positions in the world [m], shape (n, 3).
        simulation: Executes the postures.
        done: (goal index, method name) of the trials to leave out.
    """
    for position in task.goals(WARM_UP_GOALS, WARM_UP_SEED):
        for solver in solvers.values():
            _solve(task, solver, position)
    names = list(solvers)
    for index, position in enumerate(goals):
        first = index % len(names)
        pending = [name for name in names[first:] + names[:first] if (index, name) not in done]
        answers = {name: _solve(task, solvers[name], position) for name in pending}
        for name, answer in answers.items():
            yield _execute(task, simulation, index, position, name, answer)


@dataclass(frozen=True)
class _Answer:
    """What a solver said, and what it took: wall times [s], postures tested."""

    result: IKResult
    solve_s: float
    accept_s: float
    candidates: int


class _Acceptance:
    """The task's acceptance test with a clock."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self.seconds = 0.0
        self.calls = 0

    def __call__(self, q: Floats) -> bool:
        start = time.perf_counter()
        accepted = self._task.accept(q)
        self.seconds += time.perf_counter() - start
        self.calls += 1
        return accepted


def _solve(task: Task, solver: Solver, position: Floats) -> _Answer:
    goal, acceptance = task.ik_goal(position), _Acceptance(task)
    start = time.perf_counter()
    result = solver.solve(goal, task.home, accept=acceptance)
    seconds = time.perf_counter() - start
    return _Answer(result, seconds, acceptance.seconds, acceptance.calls)


def _execute(task: Task, simulation: ArmSimulation, index: int, position: Floats, name: str, answer: _Answer) -> Trial:
    result = answer.result
    simulation.reset()
    simulation.place_ball(position)
    status, reason, move_s = result.status.value, result.reason, None
    if result.success:
        move = simulation.move(result.q)
        status, reason = (COMPLETED, "") if move.reached else (move.status.value, move.reason)
        move_s = float(move.duration) if move.reached else None
    impossible = move_s is None
    distance = float(np.linalg.norm(simulation.tip_position - position))
    verdict = task.judge(distance, simulation.q, impossible=impossible)
    x, y, z = map(float, position)
    return Trial(
        goal=index,
        method=name,
        x=x,
        y=y,
        z=z,
        reached=verdict.reached,
        impossible=impossible,
        status=status,
        reason=reason,
        distance=distance,
        posture_error=verdict.posture_error,
        reward=verdict.reward,
        ik_error=result.position_error,
        iterations=result.iterations,
        restarts=result.restarts,
        candidates=answer.candidates,
        solve_s=answer.solve_s,
        accept_s=answer.accept_s,
        move_s=move_s,
        q=tuple(map(float, result.q)) if result.success else None,
    )
