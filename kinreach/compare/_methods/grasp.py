"""A scripted grasp: the tool straight down on the object, the fingers along its faces, and once more after a miss."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import turn
from kinreach.envs.inside import lift_task
from kinreach.kinematics import PoseGoal, Solver

#: How much narrower than the object the fingers are set [m], so that each presses with its whole force, 120 N.
SQUEEZE = 0.024
#: Least height of the tip above the table [m]; the fingers end 10 mm beyond it.
MIN_HEIGHT = 0.012
#: Turns of the fingers that are tried around a ball or a cylinder; a cube has one for each pair of faces.
TURNS = 6
UP = np.array([0.0, 0.0, 1.0])


class GraspPolicy:
    """Grasp objects of `kinreach/Lift-v0` with postures of a solver, in single steps.

    The fingers are as in the start pose, turned outwards with the object; on a cube they are parallel to its faces.
    The first turn with an accepted posture is used.

    Args:
        solver: For the arm of the environment, from the world to the tip.

    Attributes:
        diagnostics: Iterations of the solver, and poses that were asked for.
        reason: Why the last action was None, else empty.
    """

    def __init__(self, solver: Solver, env: gym.Env[Any, Any]) -> None:
        self._solver, self._env = solver, env.unwrapped
        task: Any = self._env
        self._home: Floats = task.home
        self._upright: Floats = task.kinematics.fk(self._home)[:3, :3]
        self.diagnostics: Mapping[str, float] = {}
        self.reason = ""

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Do nothing: a grasp depends on the observation only."""

    def act(self, observation: Any) -> Any:
        """Return the action of a grasp; None if no camera saw the object or no posture is accepted."""
        env: Any = self._env
        iterations = poses = 0
        self.reason = "no camera found the object"
        if observation[lift_task.SEEN].any():
            for T in self._poses(observation):
                found: Any = self._solver.solve(PoseGoal(T), self._home, accept=env.accept)
                iterations, poses, self.reason = iterations + found.iterations, poses + 1, found.reason
                if found.success:
                    self.diagnostics = {"iterations": iterations, "poses": poses}
                    return env.grasp_action(found.q, max(0.0, 2.0 * observation[lift_task.SIZE] - SQUEEZE))
        self.diagnostics = {"iterations": iterations, "poses": poses}
        return None

    def _poses(self, observation: Floats) -> Iterator[Floats]:
        place, size = observation[lift_task.SEEN].copy(), float(observation[lift_task.SIZE])
        place[2] += max(0.0, MIN_HEIGHT - size)
        outwards = math.atan2(place[1], place[0])
        step, first = math.pi / TURNS, 0.0
        if observation[lift_task.IS_CUBE]:
            step = math.pi / 2
            first = float(
                lift_task.face_angle(
                    observation[lift_task.FACES] - math.atan2(self._upright[1, 1], self._upright[0, 1])
                )
            )
        for count in range(round(2 * math.pi / step)):
            T = np.eye(4)
            aside = (count + 1) // 2 * (-1) ** count * step
            T[:3, :3], T[:3, 3] = turn(UP, outwards + first + aside) @ self._upright, place
            yield T
