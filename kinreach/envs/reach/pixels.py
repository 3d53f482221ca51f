"""The thesis's "ideal solution" (section 6.1): the agent sees the images themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from kinreach.envs.goal_view import GOAL_CAMERAS
from kinreach.envs.reach.options import ReachOptions
from kinreach.envs.reach.task import CAMERA_RANGE, JOINT_BOUND, JOINTS
from kinreach.envs.rgbd import RGBDCamera
from kinreach.envs.simulation import ArmSimulation
from kinreach.kinematics.goals import Floats

#: What is further away, the sky for example, has this depth [m]; the range of a RealSense D435.
DEPTH_RANGE = 10.0


class PixelObserver:
    """RGB and depth of both cameras in the arm's present posture, with the joint angles and the gripper's opening.

    Args:
        options: Size of the images and the sensors' noise.
    """

    def __init__(self, options: ReachOptions) -> None:
        self._options = options
        self._simulation = ArmSimulation(options.arm)
        self._cameras = {
            name: RGBDCamera(self._simulation, name, width=options.width, height=options.height)
            for name in GOAL_CAMERAS
        }

    def space(self) -> spaces.Dict:
        """What `look` returns."""
        height, width = self._options.height, self._options.width
        images: dict[str, spaces.Space[Any]] = {}
        for name in GOAL_CAMERAS:
            images[f"{name}_rgb"] = spaces.Box(0, 255, (height, width, 3), np.uint8)
            images[f"{name}_depth"] = spaces.Box(0.0, DEPTH_RANGE, (height, width, 1), np.float32)
        images["joints"] = spaces.Box(-JOINT_BOUND, JOINT_BOUND, (JOINTS,), np.float64)
        images["gripper"] = spaces.Box(0.0, CAMERA_RANGE, (1,), np.float64)
        return spaces.Dict(images)

    def look(self, q: Floats, goal: Floats, rng: np.random.Generator) -> dict[str, Any]:
        """Both cameras' images of the arm in posture `q` [rad] and the ball at `goal` [m]."""
        self._simulation.reset(np.clip(q, self._simulation.controller.lower, self._simulation.controller.upper))
        self._simulation.place_ball(goal)
        seen: dict[str, Any] = {}
        for name, camera in self._cameras.items():
            frame = camera.capture(noise=self._options.noise, rng=rng)
            seen[f"{name}_rgb"] = frame.rgb
            seen[f"{name}_depth"] = np.minimum(frame.depth, np.float32(DEPTH_RANGE))[..., None]
        gripper = self._options.arm.gripper
        seen["joints"] = np.array(q)
        seen["gripper"] = np.array([0.0 if gripper is None else gripper.opening])
        return seen

    def close(self) -> None:
        """Free the renderers."""
        for camera in self._cameras.values():
            camera.close()
