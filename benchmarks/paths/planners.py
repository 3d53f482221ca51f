"""Planners: kinreach's, the same with one goal posture, and OMPL's with its own settings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from ompl import base, geometric, util

from kinreach.errors import PathError
from kinreach.kinematics import plan_path
from kinreach.kinematics._motion_check import MotionCheck

#: checker, start, solutions of the goal, seconds -> waypoints, or None.
Planner = Callable[[Any, np.ndarray, Any, float], np.ndarray | None]


def kinreach(checker: Any, start: np.ndarray, goals: Any, seconds: float, *, seed: int = 0) -> np.ndarray | None:
    """`plan_path` to all solutions."""
    try:
        return plan_path(checker, start, goals, timeout=seconds, seed=seed)
    except PathError:
        return None


def one_goal(checker: Any, start: np.ndarray, goals: Any, seconds: float) -> np.ndarray | None:
    """`plan_path` to the free solution that is nearest to the start."""
    free = [q for q in goals.q if checker.free(q)]
    return kinreach(checker, start, min(free, key=lambda q: np.abs(q - start).max()), seconds)


def ompl_default(planner: str) -> Planner:
    """A planner of OMPL with its own settings and its own shortening; to all solutions, each motion proven free."""

    def plan(checker: Any, start: np.ndarray, goals: Any, seconds: float) -> np.ndarray | None:
        motion, kin = MotionCheck(checker), checker.kinematics

        class Validator(base.MotionValidator):
            def checkMotion(self, one: Any, other: Any, last: Any = None) -> bool:
                one, other = posture(one), posture(other)
                return motion.free(other) and motion.motion_free(one, other)

        def posture(state: Any) -> np.ndarray:
            return np.array([state[joint] for joint in range(kin.n)])

        def state_of(q: np.ndarray) -> Any:
            state = space.allocState()
            for joint, value in enumerate(q.tolist()):
                state[joint] = value
            return state

        util.setLogLevel(util.LOG_NONE)
        util.RNG.setSeed(1)
        space, bounds = base.RealVectorStateSpace(kin.n), base.RealVectorBounds(kin.n)
        for joint in range(kin.n):
            bounds.setLow(joint, float(kin.lower[joint]))
            bounds.setHigh(joint, float(kin.upper[joint]))
        space.setBounds(bounds)
        information = base.SpaceInformation(space)
        information.setStateValidityChecker(lambda state: motion.free(posture(state)))
        information.setMotionValidator(Validator(information))
        information.setup()
        problem, region = base.ProblemDefinition(information), base.GoalStates(information)
        problem.addStartState(state_of(start))
        for q in goals.q:
            if motion.free(q):
                region.addState(state_of(q))
        problem.setGoal(region)
        algorithm = getattr(geometric, planner)(information)
        algorithm.setProblemDefinition(problem)
        algorithm.setup()
        algorithm.solve(base.timedPlannerTerminationCondition(seconds))
        if not problem.hasExactSolution():
            return None
        path = problem.getSolutionPath()
        geometric.PathSimplifier(information).reduceVertices(path)
        return np.array([posture(path.getState(index)) for index in range(path.getStateCount())])

    return plan


PLANNERS: dict[str, Planner] = {
    "kinreach": kinreach,
    "kinreach, one goal": one_goal,
    "RRTConnect": ompl_default("RRTConnect"),
    "LBKPIECE1": ompl_default("LBKPIECE1"),
    "BKPIECE1": ompl_default("BKPIECE1"),
}
