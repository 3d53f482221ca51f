"""The options that all reach environments share, and the pictures of the thesis's "ideal solution" (6.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces

from kinreach.checks import Floats, as_flags, check_count, check_known, check_number
from kinreach.envs.reach.observers import CameraObserver, GeometricObserver, GoalObserver
from kinreach.envs.reach.task import CAMERA_RANGE, JOINT_BOUND, JOINTS
from kinreach.robots import ArmDescription, get_arm
from kinreach.sim.simulation import ArmSimulation
from kinreach.vision.ball_finder import PIPELINES
from kinreach.vision.cameras import RGBDCamera, SensorNoise
from kinreach.vision.goal_view import GOAL_CAMERAS, CameraGoalView

OBSERVATIONS = ("camera", "geometric", "pixels")
#: Images are no wider or higher; graphics libraries draw the line somewhere below [px].
LARGEST_PICTURE = 16384
BACKENDS = ("mujoco", "kinematic")


def check_cameras(pipeline: object, width: object, height: object, rgb_noise: object, depth_noise: object) -> None:
    """Refuse cameras that cannot be; for the values see `ReachOptions`.

    Raises:
        UnknownNameError: There is no such pipeline.
        InputError: A size or a noise that cannot be.
    """
    check_known("pipeline", pipeline, PIPELINES)
    for name, size in (("width", width), ("height", height)):
        check_count(f"{name} [px]", size, least=16, most=LARGEST_PICTURE)
    check_number("rgb_noise", rgb_noise, least=0.0, most=255.0)
    check_number("depth_noise", depth_noise, least=0.0, most=1.0)


@dataclass(frozen=True)
class ReachOptions:
    """Options of an environment.

    Attributes:
        observation: `"camera"`, `"geometric"` or `"pixels"`.
        backend: `"mujoco"` or `"kinematic"`.
        pipeline: How the ball is found in the images, `"hybrid"` or `"thesis"`.
        width, height: Size of the cameras' images [px].
        rgb_noise: Standard deviation of the colours' noise [levels of 255].
        depth_noise: Standard deviation of the depth's noise [m].
        end_on_reached: Whether reaching the goal ends an episode of several steps.

    Raises:
        UnknownNameError: A name that is not one of those above.
        InputError: A size or a noise that cannot be.
    """

    observation: str
    backend: str
    pipeline: str
    width: int
    height: int
    rgb_noise: float
    depth_noise: float
    end_on_reached: bool = True

    def __post_init__(self) -> None:
        for kind, value, known in (
            ("observation", self.observation, OBSERVATIONS),
            ("backend", self.backend, BACKENDS),
        ):
            check_known(kind, value, known)
        check_cameras(self.pipeline, self.width, self.height, self.rgb_noise, self.depth_noise)
        as_flags("end_on_reached", self.end_on_reached)

    @property
    def arm(self) -> ArmDescription:
        """The arm that does the task."""
        return get_arm("ur5")

    @property
    def noise(self) -> SensorNoise:
        """The cameras' noise."""
        return SensorNoise(rgb_sigma=self.rgb_noise, depth_sigma=self.depth_noise)

    def observer(self) -> GoalObserver:
        """What measures the goal; with pixels the agent has to find it, and the true geometry is kept for `info`."""
        if self.observation != "camera":
            return GeometricObserver(self.arm)
        view = CameraGoalView(self.arm, width=self.width, height=self.height, pipeline=self.pipeline, noise=self.noise)
        return CameraObserver(self.arm, view)


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
