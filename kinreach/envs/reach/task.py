"""The two variants of the thesis's task on any arm: options, meaning of actions, observations, reset options.

Everything here works on stacks, so that one environment and thousands in a batch share it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kinreach.checks import Floats, as_flags, as_floats, as_vector, check_count, check_known, check_number
from kinreach.envs.options import option, option_rows
from kinreach.envs.reach.rewards import scorer_of
from kinreach.errors import InputError
from kinreach.kinematics import AxisGoal, CollisionChecker, PositionGoal, kinematics_of
from kinreach.robots import ArmDescription, as_arm
from kinreach.thesis.reward import REACHED_POSTURE_ERROR
from kinreach.vision.ball_finder import PIPELINES
from kinreach.vision.cameras import SensorNoise
from kinreach.vision.goal_view import geometric_goal_view, has_goal_cameras

#: How the tool points at a goal, in the world: straight down.
TOOL_DOWN = (0.0, 0.0, -1.0)
#: Largest change of a joint in one step of the multi-step task [rad].
STEP_SIZE = math.radians(5.0)
#: Cameras see no further than this; the bound of the goal's coordinates in the observation space [m].
CAMERA_RANGE = 2.0
#: The same for an arm without cameras, whose goals are given in the world [m].
GOAL_RANGE = 10.0
#: Joints come to rest within the controller's tolerance of their target, so they may stand a little past a limit [rad].
BEYOND_LIMIT = 0.02
#: URDFs write pi with eleven digits; a limit this near to it is pi [rad].
NEAR_PI = 1e-9

OBSERVATIONS = ("camera", "geometric", "pixels")
BACKENDS = ("mujoco", "kinematic")
RENDER_MODES = ("human", "rgb_array", "rgb_array_list", "depth_array")
#: Images are no wider or higher; graphics libraries draw the line somewhere below [px].
LARGEST_PICTURE = 16384


@dataclass(frozen=True, kw_only=True)
class ReachOptions:
    """Options of the reach environments, single and in native batches.

    Raises:
        UnknownNameError: A name that is not one of those there are.
        InputError: A size, a noise or a reward that cannot be, or cameras that the arm has not.
    """

    observation: str = option("geometric", '`"camera"`, `"geometric"` or `"pixels"`')
    backend: str = option("mujoco", '`"mujoco"` (dynamics) or `"kinematic"`')
    render_mode: str | None = option(
        None, '`"human"`, `"rgb_array"`, `"rgb_array_list"` (frames of the motion) or `"depth_array"`'
    )
    arm: str | ArmDescription = option("ur5", "name of a registered arm, or an `ArmDescription`")
    reward: Any = option(None, "a function as `kinreach.envs.reach.rewards` describes; by default the arm's own")
    pipeline: str = option("hybrid", 'how the ball is found: `"hybrid"` or the thesis\'s own, `"thesis"`')
    width: int = option(640, "width of the cameras' images [px]")
    height: int = option(360, "height of the cameras' images [px]")
    rgb_noise: float = option(0.0, "standard deviation of the colours' noise [levels of 255]")
    depth_noise: float = option(0.0, "standard deviation of the depth's noise [m]")
    end_on_reached: bool = option(True, "whether reaching the goal ends an episode of several steps")

    def __post_init__(self) -> None:
        check_known("observation", self.observation, OBSERVATIONS)
        check_known("backend", self.backend, BACKENDS)
        if self.render_mode is not None:
            check_known("render_mode", self.render_mode, RENDER_MODES)
        check_cameras(self.pipeline, self.width, self.height, self.rgb_noise, self.depth_noise)
        as_flags("end_on_reached", self.end_on_reached)
        arm = as_arm(self.arm)
        scorer_of(self.reward, arm)
        if self.observation != "geometric" and not has_goal_cameras(arm):
            names = ", ".join(mount.name for mount in arm.cameras) or "none"
            raise InputError(
                f"observation={self.observation!r} needs cameras named front and wrist, arm {arm.name!r} has {names}; "
                'use observation="geometric"'
            )

    @property
    def noise(self) -> SensorNoise:
        """The cameras' noise."""
        return SensorNoise(rgb_sigma=self.rgb_noise, depth_sigma=self.depth_noise)


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
class ReachVariant:
    """One way to act.

    Attributes:
        name: `"single"` or `"multi"`.
        relative: Whether an action changes the joint angles (else it sets them).
        scale: What an action of 1 means [rad]; where it sets a joint, that of one with the limits ±pi.
        two_phase: Whether the arm's `moves_last` (shoulder_lift of a UR) wait for the other joints.
        max_steps: Steps after which an episode is truncated.
    """

    name: str
    relative: bool
    scale: float
    two_phase: bool
    max_steps: int


#: One action sets all joints, shoulder_lift last; the episode is over (thesis, section 3.4.5).
SINGLE_STEP = ReachVariant("single", relative=False, scale=math.pi, two_phase=True, max_steps=1)
#: Up to 100 actions of -5 ... 5 degrees, all joints at once.
MULTI_STEP = ReachVariant("multi", relative=True, scale=STEP_SIZE, two_phase=False, max_steps=100)


class Layout(NamedTuple):
    """Where things are in an observation.

    Attributes:
        goal: The goal block: the goal in the front and in the wrist camera, or in the world [m].
        q: Joint angles [rad].
        gripper: Opening of the gripper [m].
    """

    goal: slice
    q: slice
    gripper: int

    @classmethod
    def of(cls, goal: int, joints: int) -> Layout:
        """Goal blocks and postures of these sizes, one after the other."""
        return cls(slice(0, goal), slice(goal, goal + joints), goal + joints)

    @property
    def size(self) -> int:
        """How many numbers an observation has."""
        return self.gripper + 1


#: The layout of the UR5's observation: goal in both cameras (6), joint angles (6), gripper opening (1).
UR5_LAYOUT = Layout.of(goal=6, joints=6)
GOAL, ANGLES, GRIPPER = UR5_LAYOUT


class Start(NamedTuple):
    """What `reset(options=)` asks for, one row an environment; None for what it leaves open.

    Attributes:
        goals: Where the balls are in the world [m], shape (count, 3).
        q: Postures [rad], shape (count, n).
        views: Goal blocks as somebody has measured them [m], shape (count, size of the block).
    """

    goals: Floats | None = None
    q: Floats | None = None
    views: Floats | None = None


class ReachTask:
    """One variant of the task on one arm.

    Args:
        options: Of the environment.
        variant: Single- or multi-step.

    Attributes:
        options, variant: As given.
        arm: The description of the arm.
        home: Its start posture [rad], shape (n,).
        lower, upper: Its joint limits [rad], shape (n,).
        kinematics: From the world to the arm's default tip.
        scorer: Judges the steps.
        cameras: Whether the goal block is what two cameras see; else it is the goal in the world.
        layout: Where things are in an observation.
        gripper_opening: In which the arm reaches [m]; 0 without a gripper.
        action_space, observation_space: Of one environment (pixels have a space of their own).
    """

    def __init__(self, options: ReachOptions, variant: ReachVariant) -> None:
        self.options = options
        self.variant = variant
        self.arm = arm = as_arm(options.arm)
        self.kinematics = kinematics_of(arm, base="world")
        self.scorer = scorer_of(options.reward, arm)
        self.home = np.array(arm.home)
        self.lower, self.upper = (_snapped(limit) for limit in (self.kinematics.lower, self.kinematics.upper))
        self.cameras = has_goal_cameras(arm)
        self.layout = Layout.of(6 if self.cameras else 3, len(arm.joints))
        self.gripper_opening = 0.0 if arm.gripper is None else arm.gripper.opening
        self.action_space = spaces.Box(-1.0, 1.0, (len(arm.joints),), np.float32)
        self.observation_space = self._observation_space()
        self._scale: Any = variant.scale
        self._middle: Floats | None = None
        if not variant.relative:
            half, middle = (self.upper - self.lower) / 2, (self.upper + self.lower) / 2
            self._scale = half if (half != variant.scale).any() else variant.scale
            self._middle = middle if middle.any() else None

    def targets(self, q: Floats, actions: Floats) -> Floats:
        """Joint targets [rad] of checked actions in postures `q`, all of shape (k, n)."""
        targets: Floats = self._scale * actions
        if self.variant.relative:
            return q + targets
        return targets if self._middle is None else targets + self._middle

    def action_for(self, q: Floats, target: Floats) -> Floats:
        """The action that takes an arm from a posture `q` to a target [rad], or straight towards it; shape (n,)."""
        if self.variant.relative:
            way = (target - q) / self._scale
            return np.asarray(way / max(1.0, float(np.abs(way).max())))
        return np.asarray((target if self._middle is None else target - self._middle) / self._scale)

    def ik_goal(self, position: ArrayLike) -> AxisGoal | PositionGoal:
        """What a solver is asked for: the tip at a point of the world [m], the tool down where there are joints enough.

        Raises:
            InputError: No point.
        """
        point = as_floats("position", position)
        return AxisGoal(point, TOOL_DOWN) if len(self.arm.joints) >= 6 else PositionGoal(point)  # type: ignore[arg-type]

    def natural(self, q: ArrayLike) -> bool:
        """Whether a posture [rad], shape (n,), has the posture error that reaching asks for."""
        posture = as_vector("q", q, len(self.arm.joints))
        return bool(self.scorer.posture_error(posture[None])[0] < REACHED_POSTURE_ERROR)

    @cached_property
    def checker(self) -> CollisionChecker:
        """The exact verdict on collisions."""
        return CollisionChecker(self.kinematics)

    def check_actions(self, actions: ArrayLike, count: int | None) -> Floats:
        """Actions of shape (n,), or (count, n) for a batch, clipped to [-1, 1].

        In the result what belongs to one joint lies side by side, as the formulas want it.

        Raises:
            InputError: Wrong shape, or a value that is not finite.
        """
        n = len(self.arm.joints)
        shape = (n,) if count is None else (count, n)
        values = as_floats("action", actions)
        if values.shape != shape:
            raise InputError(f"action must have shape {shape}, got {values.shape}")
        if values.min() >= -1.0 and values.max() <= 1.0:  # there is nothing to clip
            return np.array(values.T, order="C").T
        if not np.isfinite(values).all():
            raise InputError("action must be finite")
        return np.clip(values.T, -1.0, 1.0, order="C").T

    def check_start(self, options: Mapping[str, Any] | None, count: int | None) -> Start:
        """What `reset(options=)` asks for.

        Raises:
            InputError: An unknown option, a wrong shape, a value that is not finite, a joint outside its limits, or a
                goal or a view that an observation cannot hold.
        """
        sizes = {"goal": 3, "q": len(self.arm.joints), "view": self.layout.goal.stop}
        start = Start(*option_rows(options, sizes, count))
        if start.q is not None and ((start.q < self.lower) | (start.q > self.upper)).any():
            self._refuse_posture(start.q)
        bound = CAMERA_RANGE if self.cameras else GOAL_RANGE
        if start.goals is not None:
            seen = np.abs(self.goal_block(start.goals)).max(axis=1)
            if (seen > bound).any():
                where = "that the cameras see" if self.cameras else "in which goals are"
                raise InputError(f"goal {start.goals[seen.argmax()]} m is outside the {bound:g} m {where}")
        if start.views is not None and (np.abs(start.views) > bound).any():
            raise InputError(
                f"view must be within ±{bound:g} m, got {start.views.flat[np.abs(start.views).argmax()]:g}"
            )
        return start

    def goal_block(self, goals: Floats) -> Floats:
        """What perfect cameras would say of goals in the world [m], shape (k, 3), or without cameras the goals."""
        return geometric_goal_view(self.arm, goals) if self.cameras else goals.copy()

    def _refuse_posture(self, q: Floats) -> None:
        beyond = np.maximum(self.lower - q, q - self.upper)
        row, joint = np.unravel_index(beyond.argmax(), q.shape)
        raise InputError(
            f"q: {self.arm.joints[joint]} must be within {self.lower[joint]:g} … {self.upper[joint]:g} rad, "
            f"got {q[row, joint]:g}"
        )

    def _observation_space(self) -> spaces.Box:
        low, high = np.empty(self.layout.size), np.empty(self.layout.size)
        high[self.layout.goal] = CAMERA_RANGE if self.cameras else GOAL_RANGE
        low[self.layout.goal] = -high[self.layout.goal]
        low[self.layout.q], high[self.layout.q] = self.lower - BEYOND_LIMIT, self.upper + BEYOND_LIMIT
        low[self.layout.gripper], high[self.layout.gripper] = 0.0, CAMERA_RANGE
        return spaces.Box(low, high, dtype=np.float64)


def _snapped(limits: Floats) -> NDArray[np.float64]:
    return np.where(np.abs(np.abs(limits) - math.pi) < NEAR_PI, np.copysign(math.pi, limits), limits)
