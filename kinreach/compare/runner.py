"""Every method on every goal: look, decide, then move in the simulation, and measure.

A goal is looked at once, and all methods are told of that look. All methods decide on one goal before any of them
moves, each time in another random order: load from other programs meets all methods alike, and so does what the one
before has left in the processor's caches, which can double the time of a short decision. What a method that makes
several moves decides after its first one is timed between its moves. Every attempt starts from the same state.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np

from kinreach.checks import Floats
from kinreach.compare.attempts import Attempt, Ending, execute
from kinreach.compare.budget import budget
from kinreach.compare.deciding import Method
from kinreach.compare.observation import WARM_UP_SEED, Look, Sight, true_position
from kinreach.compare.tasks import ReachTask
from kinreach.compare.trials import ReachTrial
from kinreach.sim.simulation import ArmSimulation

#: Goals on which every method decides untimed first.
WARM_UP_GOALS = 3


def run_trials(
    task: ReachTask,
    methods: Mapping[str, Method],
    goals: Floats,
    simulation: ArmSimulation,
    *,
    look: Look = true_position,
    done: Collection[ReachTrial] = (),
) -> Iterator[ReachTrial]:
    """Yield a trial per goal and method as it is finished.

    Args:
        task: Sets the question, the acceptance test and the verdict.
        methods: By name.
        goals: Positions in the world [m], shape (n, 3).
        simulation: Executes the postures.
        look: Says where a goal is; the verdict is about where it truly is.
        done: Trials to leave out; the methods that are left are told what those were told.
    """
    for position in task.goals(WARM_UP_GOALS, WARM_UP_SEED):
        for method in methods.values():
            Attempt(method, position, None).decide(task.home)
    names = list(methods)
    finished = {(trial.goal, trial.method) for trial in done}
    sights = {trial.goal: _sight_of(trial) for trial in done if trial.look_s is not None}
    for index, position in enumerate(goals):
        turns = np.random.default_rng(index).permutation(len(names))
        pending = [names[turn] for turn in turns if (index, names[turn]) not in finished]
        if not pending:
            continue
        sight = sights[index] if index in sights else look(index, position)
        attempts = {name: _begin(task, methods[name], sight) for name in pending}
        for name, attempt in attempts.items():
            ending = execute(task, simulation, position, attempt)
            yield _trial(task, index, name, position, sight, attempt, ending)


def _begin(task: ReachTask, method: Method, sight: Sight) -> Attempt | None:
    """The method's first decision; None if there is nothing to tell it."""
    if sight.position is None:
        return None
    attempt = Attempt(method, sight.position, sight.view)
    attempt.decide(task.home)
    return attempt


def _trial(
    task: ReachTask, index: int, name: str, goal: Floats, sight: Sight, attempt: Attempt | None, ending: Ending
) -> ReachTrial:
    x, y, z = map(float, goal)
    return ReachTrial(
        goal=index,
        method=name,
        x=x,
        y=y,
        z=z,
        reached=ending.verdict.reached,
        impossible=ending.impossible,
        status=ending.status,
        reason=ending.reason,
        distance=ending.distance,
        posture_error=ending.verdict.posture_error,
        reward=ending.verdict.reward,
        move_s=None if ending.impossible else ending.move_s,
        q=None if ending.q is None else tuple(map(float, ending.q)),
        **_effort(attempt),
        **_errors(task, goal, sight, ending),
        **_seen(sight, goal),
    )


def _effort(attempt: Attempt | None) -> dict[str, Any]:
    """The values of a trial that say what the decisions took; None where the method was not asked."""
    return {
        name: None if attempt is None else getattr(attempt, name)
        for name in ("iterations", "restarts", "candidates", "solve_s", "accept_s")
    }


def _errors(task: ReachTask, goal: Floats, sight: Sight, ending: Ending) -> dict[str, Any]:
    """The values of a trial that say where its distance comes from."""
    if sight.position is None or ending.q is None:
        return {"ik_error": None}
    meant = task.kinematics.fk(ending.q)[:3, 3]
    errors = {"ik_error": float(np.linalg.norm(meant - sight.position))}
    if not ending.impossible:
        errors["move_error"] = float(np.linalg.norm(ending.tip - meant))
        errors |= budget(goal, sight.position, meant, ending.tip)._asdict()
    return errors


def _seen(sight: Sight, goal: Floats) -> dict[str, Any]:
    """The values of a trial that say what was seen; none where nobody looked."""
    if sight.look_s is None:
        return {}
    seen: dict[str, Any] = {"look_s": sight.look_s}
    if sight.view is not None:
        seen["view"] = tuple(map(float, sight.view))
    if sight.position is not None:
        x, y, z = map(float, sight.position)
        error = float(np.linalg.norm(sight.position - goal))
        seen |= {"seen_x": x, "seen_y": y, "seen_z": z, "seen_error": error}
    return seen


def _sight_of(trial: ReachTrial) -> Sight:
    """What a trial's method was told: the inverse of `_seen`."""
    position = None if trial.seen_x is None else np.array((trial.seen_x, trial.seen_y, trial.seen_z), dtype=np.float64)
    return Sight(position, trial.look_s, None if trial.view is None else np.array(trial.view))
