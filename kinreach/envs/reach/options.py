"""The options that all reach environments share, checked in one place."""

from __future__ import annotations

from dataclasses import dataclass

from kinreach.envs.ball_finder import PIPELINES
from kinreach.envs.goal_view import CameraGoalView
from kinreach.envs.reach.observers import CameraObserver, GeometricObserver, GoalObserver
from kinreach.envs.rgbd import SensorNoise
from kinreach.inputs import check_count, check_known, check_number
from kinreach.kinematics.goals import as_flags
from kinreach.robots import ArmDescription, get_arm

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
