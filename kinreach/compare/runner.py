"""Every method on every goal: look, solve, then execute the posture in the simulation, and measure.

A goal is looked at once, and all methods are told the same. All methods solve one goal before any of them is executed,
and the order rotates from goal to goal: load from other programs and the state of the processor's caches meet all
methods alike. Every move starts from the same state.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinreach.compare.observation import Look, Sight, true_position
from kinreach.compare.tasks import Task
from kinreach.compare.trials import COMPLETED, UNSEEN, Trial
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
    look: Look = true_position,
    done: Collection[Trial] = (),
) -> Iterator[Trial]:
    """Yield a trial per goal and method as it is finished.

    Args:
        task: Sets the question, the acceptance test and the verdict.
        solvers: Methods by name.
        goals: Positions in the world [m], shape (n, 3).
        simulation: Executes the postures.
        look: Says where a goal is; the verdict is about where it truly is.
        done: Trials to leave out; the methods that are left are told what those were told.
    """
    for position in task.goals(WARM_UP_GOALS, WARM_UP_SEED):
        for solver in solvers.values():
            _solve(task, solver, position)
    names = list(solvers)
    finished = {(trial.goal, trial.method) for trial in done}
    sights = {trial.goal: _sight_of(trial) for trial in done if trial.look_s is not None}
    for index, position in enumerate(goals):
        first = index % len(names)
        pending = [name for name in names[first:] + names[:first] if (index, name) not in finished]
        if not pending:
            continue
        sight = sights[index] if index in sights else look(index, position)
        told = sight.position
        answers = {name: None if told is None else _solve(task, solvers[name], told) for name in pending}
        for name, answer in answers.items():
            yield _execute(task, simulation, _Asked(index, position, sight, name), answer)


@dataclass(frozen=True)
class _Asked:
    """Who was asked for what: the goal's index and true position, what was seen of it, and the method's name."""

    index: int
    position: Floats
    sight: Sight
    name: str


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


def _execute(task: Task, simulation: ArmSimulation, asked: _Asked, answer: _Answer | None) -> Trial:
    """Move to what was answered; without an answer the method was not asked, for want of a ball."""
    simulation.reset()
    simulation.place_ball(asked.position)
    result = None if answer is None else answer.result
    move_s = None
    if result is None:
        status, reason = UNSEEN, "no camera found the ball"
    elif result.success:
        move = simulation.move(result.q)
        status, reason = (COMPLETED, "") if move.reached else (move.status.value, move.reason)
        move_s = float(move.duration) if move.reached else None
    else:
        status, reason = result.status.value, result.reason
    impossible = move_s is None
    distance = float(np.linalg.norm(simulation.tip_position - asked.position))
    verdict = task.judge(distance, simulation.q, impossible=impossible)
    x, y, z = map(float, asked.position)
    return Trial(
        goal=asked.index,
        method=asked.name,
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
        move_s=move_s,
        q=tuple(map(float, result.q)) if result is not None and result.success else None,
        **_effort(answer),
        **_seen(asked.sight, asked.position),
    )


def _effort(answer: _Answer | None) -> dict[str, Any]:
    """The values of a trial that say how the solver fared; None where it was not asked."""
    if answer is None:
        return dict.fromkeys(("ik_error", "iterations", "restarts", "candidates", "solve_s", "accept_s"))
    return {
        "ik_error": answer.result.position_error,
        "iterations": answer.result.iterations,
        "restarts": answer.result.restarts,
        "candidates": answer.candidates,
        "solve_s": answer.solve_s,
        "accept_s": answer.accept_s,
    }


def _seen(sight: Sight, position: Floats) -> dict[str, Any]:
    """The values of a trial that say what was seen; none where nobody looked."""
    if sight.look_s is None:
        return {}
    if sight.position is None:
        return {"look_s": sight.look_s}
    x, y, z = map(float, sight.position)
    error = float(np.linalg.norm(sight.position - position))
    return {"seen_x": x, "seen_y": y, "seen_z": z, "seen_error": error, "look_s": sight.look_s}


def _sight_of(trial: Trial) -> Sight:
    """What a trial's method was told: the inverse of `_seen`."""
    told = (trial.seen_x, trial.seen_y, trial.seen_z)
    return Sight(None if trial.seen_x is None else np.array(told, dtype=np.float64), trial.look_s)
