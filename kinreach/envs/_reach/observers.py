"""Observations of a goal: true geometry, measurements of the cameras, or their pictures."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.envs._reach.reach_task import (
    CAMERA_RANGE,
    ReachOptions,
    ReachTask,
    goal_block,
    joint_limits,
    opening_of,
    seen_joints,
)
from kinreach.envs._reach.worlds import Ids
from kinreach.robots import ArmDescription
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import BEYOND_LIMIT
from kinreach.vision import CameraGoalView, RGBDCamera
from kinreach.vision.inside import GoalMeasurement, goals_in_world

if TYPE_CHECKING:
    from kinreach.envs._lift.lift_task import LiftOptions

Flags = NDArray[np.bool_]

#: What is further away, the sky for example, has this depth [m]; the range of a RealSense D435.
DEPTH_RANGE = 10.0


class Measurements(NamedTuple):
    """Measurements of k goals.

    Attributes:
        views: Goal blocks of the observations [m], shape (k, 3 * cameras), without cameras (k, 3).
        found: Which of the cameras found the ball, shape (k, cameras); one column without cameras.
        seen: Where the goals seem to be in the world [m], shape (k, 3); NaN where no camera found the ball.
    """

    views: Floats
    found: Flags
    seen: Floats


class GoalObserver(Protocol):
    """Measures where balls are, with the arm in its start pose.

    Attributes:
        last: The last measurement, with the pictures and the circles in them; None where nothing is rendered.
    """

    last: GoalMeasurement | None

    def measure(self, goals: Floats, ids: Ids, rngs: Sequence[np.random.Generator]) -> Measurements:
        """Measure goals.

        Args:
            goals: Where the balls are in the world [m], shape (k, 3).
            ids: Whose goals they are, shape (k,).
            rngs: Generators of the sensors' noise, of all environments.
        """
        ...

    def close(self) -> None:
        """Free the cameras' graphics memory."""
        ...


class GeometricObserver:
    """Goals as perfect cameras measure them, or in the world for an arm without cameras; nothing is rendered."""

    last: GoalMeasurement | None = None

    def __init__(self, task: ReachTask) -> None:
        self._task = task

    def measure(self, goals: Floats, ids: Ids, rngs: Sequence[np.random.Generator]) -> Measurements:
        return Measurements(goal_block(self._task.arm, goals), _all_found(self._task, len(goals)), goals)

    def close(self) -> None:
        """Do nothing: nothing is rendered."""


class CameraObserver:
    """Goals as they are found in rendered images of the goal cameras."""

    last: GoalMeasurement | None = None

    def __init__(self, arm: ArmDescription, options: ReachOptions | LiftOptions) -> None:
        self._simulation = ArmSimulation(arm)
        self._view = CameraGoalView(
            arm, width=options.width, height=options.height, pipeline=options.pipeline, noise=options.noise
        )

    def measure(self, goals: Floats, ids: Ids, rngs: Sequence[np.random.Generator]) -> Measurements:
        """Render every camera for every goal; a ball that is not found has the documented value of `CameraGoalView`."""
        cameras = len(self._simulation.arm.goal_cameras)
        views, found = np.empty((len(goals), 3 * cameras)), np.empty((len(goals), cameras), dtype=np.bool_)
        for row, (goal, index) in enumerate(zip(goals, ids, strict=True)):
            self._simulation.place_ball(goal)
            self.last = seen = self._view.measure(self._simulation, rngs[index])
            views[row], found[row] = seen.values, seen.found
        return Measurements(views, found, goals_in_world(self._simulation.arm, views, found))

    def close(self) -> None:
        self._view.close()


class RememberedObserver:
    """Goals with the error of the nearest of some measurements of the cameras, taken beforehand.

    A goal is not found where the nearest was not. The measurements are the same in every environment with the same
    options.
    """

    last: GoalMeasurement | None = None

    def __init__(self, task: ReachTask) -> None:
        self._arm = task.arm
        rng = np.random.default_rng(0)
        goals = task.arm.workcell.draw_goals(rng, task.options.looks)
        with closing(CameraObserver(task.arm, task.options)) as observer:
            taken = observer.measure(goals, np.zeros(len(goals), dtype=np.intp), [rng])
        from scipy.spatial import cKDTree  # takes as long to import as numpy

        self._nearest = cKDTree(goals)
        self._errors, self._found = taken.views - goal_block(task.arm, goals), taken.found

    def measure(self, goals: Floats, ids: Ids, rngs: Sequence[np.random.Generator]) -> Measurements:
        rows = self._nearest.query(goals)[1]
        found = self._found[rows]
        views = np.where(np.repeat(found, 3, axis=1), goal_block(self._arm, goals) + self._errors[rows], 0.0)
        return Measurements(views, found, goals_in_world(self._arm, views, found))

    def close(self) -> None:
        """Do nothing: its cameras are closed after the looks."""


def goal_observer(task: ReachTask) -> GoalObserver:
    """Return the observer of a task; with pixels it is the true geometry, kept for `info`."""
    if task.options.observation != "camera":
        return GeometricObserver(task)
    return RememberedObserver(task) if task.options.looks else CameraObserver(task.arm, task.options)


def measured(task: ReachTask, views: Floats) -> Measurements:
    """Return given goal blocks as measurements; zeros are a camera that did not find the ball."""
    if not task.arm.goal_cameras:
        return Measurements(views, _all_found(task, len(views)), views.copy())
    found: Flags = np.any(views.reshape(len(views), -1, 3), axis=2)
    return Measurements(views, found, goals_in_world(task.arm, views, found))


def _all_found(task: ReachTask, count: int) -> Flags:
    return np.ones((count, max(1, len(task.arm.goal_cameras))), dtype=np.bool_)


class PixelObserver:
    """RGB and depth of the goal cameras in the arm's present posture: the thesis's "ideal solution" (6.1).

    With the joint angles and the gripper's opening.

    Attributes:
        space: Of what is seen in one posture.
    """

    def __init__(self, arm: ArmDescription, options: ReachOptions | LiftOptions) -> None:
        height, width, (lower, upper) = options.height, options.width, joint_limits(arm)
        self._arm, self._noise, self._opening = arm, options.noise, opening_of(arm)
        self._simulation = ArmSimulation(arm)
        self._cameras = {
            mount.name: RGBDCamera(self._simulation, mount.name, width=width, height=height)
            for mount in arm.goal_cameras
        }
        parts: dict[str, spaces.Space[Any]] = {}
        for name in self._cameras:
            parts[f"{name}_rgb"] = spaces.Box(0, 255, (height, width, 3), np.uint8)
            parts[f"{name}_depth"] = spaces.Box(0.0, DEPTH_RANGE, (height, width, 1), np.float32)
        parts["joints"] = spaces.Box(lower - BEYOND_LIMIT, upper + BEYOND_LIMIT, dtype=np.float64)
        parts["gripper"] = spaces.Box(0.0, CAMERA_RANGE, (1,), np.float64)
        self.space = spaces.Dict(parts)

    def measure(
        self,
        postures: Floats,
        goals: Floats,
        rngs: Sequence[np.random.Generator],
        openings: Floats | None = None,
    ) -> dict[str, Any]:
        """Render the cameras' images of the arm in postures (k, n) [rad], with balls at (k, 3) in the world [m].

        There is a generator of the sensors' noise for each. By default the gripper is open as the task begins. The
        entries of `space` have k rows.
        """
        parts: dict[str, Any] = self.space.spaces
        seen = {name: np.empty((len(goals), *part.shape), part.dtype) for name, part in parts.items()}
        limits = self._simulation.controller
        for row, (q, goal, rng) in enumerate(zip(postures, goals, rngs, strict=True)):
            self._simulation.reset(np.clip(q, limits.lower, limits.upper))
            self._simulation.place_ball(goal)
            if openings is not None:
                self._simulation.open_gripper(openings[row])
            for name, camera in self._cameras.items():
                frame = camera.capture(noise=self._noise, rng=rng)
                seen[f"{name}_rgb"][row] = frame.rgb
                seen[f"{name}_depth"][row, ..., 0] = np.minimum(frame.depth, np.float32(DEPTH_RANGE))
        seen["joints"][:] = seen_joints(self._arm, postures)
        seen["gripper"][:, 0] = self._opening if openings is None else openings
        return seen

    def close(self) -> None:
        for camera in self._cameras.values():
            camera.close()
