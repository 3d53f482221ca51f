"""The goal as the arm's cameras see it from the start pose: six of the 13 numbers of the thesis's observation (3.4.2).

A view is the goal's position in the frame of each camera of `arm.goal_cameras`, one after the other [m]; the UR5 has a
front and a wrist camera. Camera frames are optical: x to the picture's right, y down, z forward. The arm stands in its
start pose, where the goal is measured once per episode; the cameras' poses are therefore constants of the arm.

`geometric_goal_view` gives what perfect cameras would: rigid transforms, no rendering. `CameraGoalView` renders both
pictures and finds the ball in them. What was not found has three zeros, the place of the optical centre, where no ball
can be: the thesis's "no goal for that episode" (6.1).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import (
    MAX_DISTANCE,
    Floats,
    as_array,
    as_floats,
    as_vector,
    check_count,
    check_entries,
    check_known,
    shown,
)
from kinreach._engines import load
from kinreach.errors import InputError
from kinreach.kinematics.inside import build_model, link_frame
from kinreach.robots import THESIS_ARM, ArmDescription, get_arm
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import FrameRenderer, camera_rotation
from kinreach.vision._ball_finder import PIPELINES, BallFix, find_ball
from kinreach.vision._cameras import MAX_PIXELS, OPTICAL_IN_GL, RGBDCamera, RGBDImage, SensorNoise, check_noise

pin: Any = load("pinocchio")


@lru_cache
def goal_camera_poses(arm: ArmDescription) -> Floats:
    """Poses of the goal cameras in the world with the arm in its start pose, optical frames, shape (cameras, 4, 4).

    Computed from the description by Pinocchio, cached and read-only.
    """
    if not arm.goal_cameras:
        raise InputError(f"no camera of arm {arm.name!r} measures the goal; give it a CameraMount with observed=True")
    model = build_model(arm)
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array(arm.home))
    poses = np.empty((len(arm.goal_cameras), 4, 4))
    for T_world_camera, mount in zip(poses, arm.goal_cameras, strict=True):
        T_link_camera = np.eye(4)
        T_link_camera[:3, :3] = camera_rotation(mount) @ OPTICAL_IN_GL
        T_link_camera[:3, 3] = mount.position
        T_world_camera[:] = data.oMf[link_frame(model, mount.link)].homogeneous @ T_link_camera
    poses.flags.writeable = False
    return poses


def geometric_goal_view(arm: str | ArmDescription, goals_world: ArrayLike) -> Floats:
    """Return where perfect cameras would see goals.

    Args:
        arm: Name of a registered arm, or a description.
        goals_world: Centres of the ball in the world [m], shape (..., 3).

    Returns:
        The view of each goal [m], shape (..., 3 * cameras).

    Raises:
        UnknownNameError: Unknown arm.
        InputError: Wrong shape, a value that is not finite, or no camera of the arm measures the goal.
    """
    goals = as_floats("goals_world", goals_world)
    if goals.ndim == 0 or goals.shape[-1] != 3:
        raise InputError(f"goals_world must have shape (..., 3), got {goals.shape}")
    check_entries("goals_world", goals, MAX_DISTANCE)
    # not a matrix product, whose last bit depends on how many goals there are
    x, y, z = np.ascontiguousarray(goals.reshape(-1, 3).T)
    rows = _world_to_cameras(get_arm(arm))
    views = np.array([a * x + b * y + c * z + offset for a, b, c, offset in rows])
    return views.T.reshape(*goals.shape[:-1], len(views))


def goal_in_world(arm: str | ArmDescription, values: ArrayLike, found: ArrayLike) -> Floats | None:
    """Return the goal's position from a view: the mean over the cameras that found it.

    Args:
        arm: Name of a registered arm, or a description.
        values: The view [m], shape (3 * cameras,).
        found: Which camera found the ball, bool, shape (cameras,).

    Returns:
        Position in the world [m], shape (3,); None if no camera found the ball.

    Raises:
        UnknownNameError: Unknown arm.
        InputError: Wrong shape, a value that is not finite, or no camera of the arm measures the goal.
    """
    arm = get_arm(arm)
    count = len(goal_camera_poses(arm))
    view = as_vector("values", values, 3 * count, most=2 * MAX_DISTANCE)
    seen = as_array("found", found)
    if seen.shape != (count,) or seen.dtype != np.bool_:
        raise InputError(f"found must be {count} truth values, got {shown(found)}")
    return goals_in_world(arm, view[None], seen[None])[0] if seen.any() else None


def in_image(views: Floats) -> Floats:
    """Return where goals are in the pictures, and how deep: (u, v, z) for each camera instead of (x, y, z).

    u = x/z and v = y/z are normalised image coordinates: with the camera's intrinsics the column is cx + fx u, the row
    cy + fy v. A ball that was not found keeps its zeros, and what is not in front of a camera has u = v = 0.
    """
    points = views.reshape(*views.shape[:-1], -1, 3)
    depth = points[..., 2:]
    uv = np.divide(points[..., :2], depth, out=np.zeros_like(points[..., :2]), where=depth > 0.0)
    return np.concatenate([uv, depth], axis=-1).reshape(views.shape)


def goals_in_world(arm: ArmDescription, views: Floats, found: NDArray[np.bool_]) -> Floats:
    """Do as `goal_in_world` for many views (k, 3 * cameras): shape (k, 3), NaN where no camera found the ball."""
    T = goal_camera_poses(arm)
    points = np.einsum("nij,knj->kni", T[:, :3, :3], views.reshape(len(views), -1, 3)) + T[:, :3, 3]
    total = np.where(found[:, :, None], points, 0.0).sum(axis=1)
    count = found.sum(axis=1)[:, None]
    return np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)


@dataclass(frozen=True, eq=False)
class GoalMeasurement:
    """A measurement of the ball by the cameras.

    Attributes:
        values: The view [m], shape (3 * cameras,); zeros for a camera that did not find the ball.
        found: Which camera found it, bool, shape (cameras,).
        fixes: Result of each camera, with its circle in the picture, or None.
        images: Picture of each camera.
    """

    values: Floats
    found: NDArray[np.bool_]
    fixes: tuple[BallFix | None, ...]
    images: tuple[RGBDImage, ...]


class CameraGoalView:
    """Measures the goal as the thesis does, by rendering; to be closed, or used as a context manager.

    The cameras share one renderer, made with the first look and kept as long as the scene is the same.

    Args:
        arm: Name of a registered arm, or a description.
        width, height: Size of the pictures [pixels]. At the default most of the error is the renderer's: it draws the
            ball with facets. 1280x720, the thesis's size, gains 0.03 mm for three times the time; 320x180 is off by
            1.6 times as much in 0.4 of the time. `docs/studies/appendix/seeing.md` has the
            numbers.
        pipeline: How the ball is found, see `kinreach.vision._ball_finder`.
        noise: Of the cameras; none by default.

    Raises:
        UnknownNameError: Unknown arm or pipeline.
        InputError: A size is not a positive integer, `noise` is not a `SensorNoise`, or no camera of the arm measures
            the goal.
    """

    def __init__(
        self,
        arm: str | ArmDescription = THESIS_ARM,
        *,
        width: int = 640,
        height: int = 360,
        pipeline: str = "hybrid",
        noise: SensorNoise | None = None,
    ) -> None:
        self.arm = get_arm(arm)
        goal_camera_poses(self.arm)  # raises if it has none
        check_known("pipeline", pipeline, PIPELINES)
        check_noise(noise)
        self.width = check_count("width", width, most=MAX_PIXELS)
        self.height = check_count("height", height, most=MAX_PIXELS)
        self.pipeline = pipeline
        self.noise = noise
        self._renderer: FrameRenderer | None = None

    def measure(self, simulation: ArmSimulation, rng: np.random.Generator | None = None) -> GoalMeasurement:
        """Take a picture with each camera and find the ball.

        Args:
            simulation: Of the same arm, in its start pose: only there `goal_in_world` holds.
            rng: Draws the noise; needed if there is any. The same generator state gives the same look.

        Raises:
            InputError: A simulation of another arm, noise without a generator, or pictures larger than the scene's
                off-screen buffer.
            InstallationError: No OpenGL library works; the message names the packages.
        """
        if simulation.arm is not self.arm:
            raise InputError(f"this view is of {self.arm.name}, got a simulation of {simulation.arm.name}")
        renderer = self._renderer_for(simulation)
        values = np.zeros((len(self.arm.goal_cameras), 3))
        fixes: list[BallFix | None] = []
        images: list[RGBDImage] = []
        for value, mount in zip(values, self.arm.goal_cameras, strict=True):
            camera = RGBDCamera(simulation, mount.name, width=self.width, height=self.height, renderer=renderer)
            image = camera.capture(noise=self.noise, rng=rng)
            radius = self.arm.workcell.ball_radius
            fix = find_ball(image.rgb, image.depth, camera.intrinsics, radius, pipeline=self.pipeline)
            if fix is not None:
                value[:] = fix.position
            fixes.append(fix)
            images.append(image)
        found = np.array([fix is not None for fix in fixes])
        return GoalMeasurement(values.ravel(), found, tuple(fixes), tuple(images))

    def _renderer_for(self, simulation: ArmSimulation) -> FrameRenderer:
        if self._renderer is not None and self._renderer.model is not simulation.model:
            self.close()
        if self._renderer is None:
            self._renderer = FrameRenderer(simulation.model, width=self.width, height=self.height, shadows=False)
        return self._renderer

    def close(self) -> None:
        """Free the graphics memory; the next look allocates it again."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __enter__(self) -> CameraGoalView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@lru_cache
def _world_to_cameras(arm: ArmDescription) -> list[list[float]]:
    """The upper three rows of the transforms from the world to each camera, stacked."""
    T = goal_camera_poses(arm)
    R = np.swapaxes(T[:, :3, :3], 1, 2)
    return np.concatenate([R, -(R @ T[:, :3, 3:])], axis=2).reshape(-1, 4).tolist()
