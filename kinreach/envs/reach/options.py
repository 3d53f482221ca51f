"""The options that all reach environments share, checked in one place."""

from __future__ import annotations

from dataclasses import dataclass

from kinreach.envs.ball_finder import PIPELINES
from kinreach.envs.goal_view import CameraGoalView
from kinreach.envs.reach.observers import CameraObserver, GeometricObserver, GoalObserver
from kinreach.envs.rgbd import SensorNoise
from kinreach.errors import InputError, raise_unknown
from kinreach.robots import ArmDescription, get_arm

OBSERVATIONS = ("camera", "geometric", "pixels")
BACKENDS = ("mujoco", "kinematic")


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

    def __post_init__(self) -> None:
        for kind, value, known in (
            ("observation", self.observation, OBSERVATIONS),
            ("backend", self.backend, BACKENDS),
            ("pipeline", self.pipeline, PIPELINES),
        ):
            if value not in known:
                raise_unknown(kind, value, known)
        if min(self.width, self.height) < 16:
            raise InputError(f"width and height must be at least 16 px, got {self.width} x {self.height}")
        if not (0 <= self.rgb_noise < 256 and 0 <= self.depth_noise < 1):
            raise InputError(f"noise out of range: rgb_noise {self.rgb_noise}, depth_noise {self.depth_noise} m")

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
