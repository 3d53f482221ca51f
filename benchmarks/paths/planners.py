"""Planners: kinreach's, the same with one goal posture, and OMPL's with its own settings."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from ompl import base, geometric, util

from kinreach.errors import PathError
from kinreach.kinematics import _planning as planning
from kinreach.kinematics import plan_path
from kinreach.kinematics._motion_check import MotionCheck
from kinreach.kinematics.inside import nearest_windings, travel

#: Time for one of a pose's solutions [s].
ALONE = 3.0
#: checker, start, solutions of the goal, seconds -> waypoints, or None.
Planner = Callable[[Any, np.ndarray, Any, float], np.ndarray | None]


def kinreach(checker: Any, start: np.ndarray, goals: Any, seconds: float, *, seed: int = 0) -> np.ndarray | None:
    """Plan with `plan_path` to all solutions of the goal."""
    try:
        return plan_path(checker, start, goals, timeout=seconds, seed=seed)
    except PathError:
        return None


def each_alone(checker: Any, start: np.ndarray, goals: Any, seconds: float) -> np.ndarray | None:
    """The path of the least travel of `plan_path` to each free solution alone, each with its own time.

    In the full turns nearest to the start; one that is farther away than the best path is long has no shorter one.
    """
    kin, best = checker.kinematics, None
    wound, within = nearest_windings(goals.q.T, start[:, None], kin.lower, kin.upper)
    for goal in sorted(wound.T[within], key=lambda q: float(np.abs(q - start).max())):
        if best is not None and np.abs(goal - start).max() >= travel(best):
            break
        path = kinreach(checker, start, goal, min(seconds, ALONE)) if checker.free(goal) else None
        if path is not None and (best is None or travel(path) < travel(best)):
            best = path
    return best


def ompl(planner: str, *, as_ours: bool = False) -> Planner:
    """A planner of OMPL to all solutions, with its own settings and its own shortening, each motion proven free.

    With `as_ours`: with the settings, the goals, the coarse search, the shortening and the proof of `plan_path`.
    """

    def plan(checker: Any, start: np.ndarray, goals: Any, seconds: float) -> np.ndarray | None:
        motion, kin = MotionCheck(checker), checker.kinematics
        if as_ours:
            ends = planning._free_goals(motion, start, planning._windings(kin, start, goals.q))
            for end in ends:
                if motion.motion_free(start, end):
                    return np.array([start, end])
            step, scale = planning.SEARCH_STEP, np.sqrt(motion.reach / motion.reach.max())
            lower, upper = planning._sampled_range(kin, start, ends)
        else:
            ends = [q for q in goals.q if motion.free(q)]
            step, scale, lower, upper = None, np.ones(kin.n), kin.lower, kin.upper

        class Validator(base.MotionValidator):
            def checkMotion(self, one: Any, other: Any, last: Any = None) -> bool:
                one, other = posture(one), posture(other)
                return motion.free(other) and motion.motion_free(one, other, step=step)

        def posture(state: Any) -> np.ndarray:
            return np.array([state[joint] for joint in range(kin.n)]) / scale

        def state_of(q: np.ndarray) -> Any:
            state = space.allocState()
            for joint, value in enumerate((q * scale).tolist()):
                state[joint] = value
            return state

        util.setLogLevel(util.LOG_NONE)
        util.RNG.setSeed(1)
        space, bounds = base.RealVectorStateSpace(kin.n), base.RealVectorBounds(kin.n)
        for joint in range(kin.n):
            bounds.setLow(joint, float(lower[joint] * scale[joint]))
            bounds.setHigh(joint, float(upper[joint] * scale[joint]))
        space.setBounds(bounds)
        information = base.SpaceInformation(space)
        information.setStateValidityChecker(lambda state: motion.free(posture(state)))
        information.setMotionValidator(Validator(information))
        information.setup()
        problem, region = base.ProblemDefinition(information), base.GoalStates(information)
        problem.addStartState(state_of(start))
        for q in ends:
            region.addState(state_of(q))
        problem.setGoal(region)
        algorithm = getattr(geometric, planner)(information)
        if as_ours:
            algorithm.setRange(planning.RANGE)
        algorithm.setProblemDefinition(problem)
        algorithm.setup()
        algorithm.solve(base.timedPlannerTerminationCondition(seconds))
        if not problem.hasExactSolution():
            return None
        path = problem.getSolutionPath()
        if not as_ours:
            geometric.PathSimplifier(information).reduceVertices(path)
        found = np.array([posture(path.getState(index)) for index in range(path.getStateCount())])
        if as_ours:
            found = planning._shortened(motion, found, np.random.default_rng(0), step)
            if not all(motion.motion_free(a, b) for a, b in pairwise(found)):
                return None
        return found

    return plan


PLANNERS: dict[str, Planner] = {
    "kinreach": kinreach,
    "kinreach, each alone": each_alone,
    "RRTConnect, as kinreach": ompl("RRTConnect", as_ours=True),
    "RRTConnect": ompl("RRTConnect"),
    "LBKPIECE1": ompl("LBKPIECE1"),
    "BKPIECE1": ompl("BKPIECE1"),
}
