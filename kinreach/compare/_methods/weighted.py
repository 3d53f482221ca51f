"""placo with weights for point and orientation, as LeRobot drives arms of five axes: no goal is met exactly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach._engines import load
from kinreach.kinematics import AxisGoal
from kinreach.kinematics.inside import place_robot, placo_program, placo_robot

pin: Any = load("pinocchio")

#: LeRobot's weights of the squared errors [1/m^2, 1/rad^2].
POSITION, ORIENTATION = 1.0, 0.01
#: Most steps, and the longest step of a joint of a posture that has settled [rad].
MAX_STEPS, SETTLED = 200, 1e-6


class WeightedPlaco:
    """Aim at the ball with the orientation of the start posture, turned to the goal's direction if it has one.

    Steps of placo's program, each as LeRobot takes one in a tick, are taken until the posture settles. There is no
    acceptance test, no restart, and no bound of what is left.

    Args:
        env: A reach environment.

    Raises:
        InstallationError: placo cannot be loaded.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        world: Any = env.unwrapped
        self._env, self._kin = world, world.kinematics
        self._robot, tip = placo_robot(self._kin)
        self._solver = placo_program(self._kin, self._robot)
        self._task = self._solver.add_frame_task(tip, np.eye(4))
        self._task.configure("tip", "soft", POSITION, ORIENTATION)
        self._q = self._seen = np.empty(0)
        self.diagnostics: Mapping[str, float] = {}
        self.reason = ""

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        self._q, self._seen = np.asarray(info["q"]), np.asarray(info["seen"])

    def act(self, observation: Any) -> Any:
        """Return the action of the posture that has settled; None if no camera found the ball."""
        if not np.isfinite(self._seen).all():
            self.reason = "no camera found the ball"
            return None
        kin = self._kin
        self._task.T_world_frame = kin.T_world_base @ self._aim()
        place_robot(kin, self._robot, self._q)
        q, steps, longest = self._q, 0, np.inf
        while steps < MAX_STEPS and longest > SETTLED:
            try:
                self._solver.solve(True)
            except RuntimeError:  # rarely, placo finds NaN in what its program gives
                break
            self._robot.update_kinematics()
            last, q = q, np.array([self._robot.get_joint(name) for name in kin.arm.joints])
            steps, longest = steps + 1, float(np.abs(q - last).max())
        self.diagnostics = {"iterations": steps}
        return self._env.action_for(np.clip(q, *kin.sampling_limits))

    def _aim(self) -> Floats:
        """The pose that it aims at, in the base frame, shape (4, 4)."""
        goal, T = self._env.ik_goal(self._seen), self._kin.fk(self._q)
        if isinstance(goal, AxisGoal):
            T[:3, :3] = pin.Quaternion.FromTwoVectors(T[:3, 2], goal.axis).toRotationMatrix() @ T[:3, :3]
        T[:3, 3] = goal.position
        return np.asarray(T)
