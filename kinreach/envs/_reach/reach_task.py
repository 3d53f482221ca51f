"""The two variants of the thesis's task on any arm: options, meaning of actions, observations, reset options.

Everything here works on stacks, so that one environment and thousands in a batch share it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import (
    Floats,
    as_floats,
    as_vector,
    check_count,
    check_flag,
    check_known,
    check_number,
    shown,
)
from kinreach._rotations import wrapped
from kinreach._tensors import namespace
from kinreach.envs import _tip_control as tip_control
from kinreach.envs._batch import RowStreams, goal_streams
from kinreach.envs._goals import REWARD_NAMES, GoalOptions, goal_dict
from kinreach.envs._options import about, check_box_actions, option_rows
from kinreach.envs._randomise import WITH_CAMERAS, Ranges, about_randomise, check_randomise
from kinreach.envs._reach.rewards import (
    RewardFunction,
    Score,
    Scorer,
    check_reward,
    default_reward,
    judges_posture,
    score_of_goals,
    scorer_of,
)
from kinreach.envs._tip_control import TipControl, shortened
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, AxisGoal, CollisionChecker, PositionGoal
from kinreach.kinematics.inside import MARGIN
from kinreach.robots import THESIS_ARM, ArmDescription, BoxRegion, get_arm
from kinreach.robots.inside import between_phases
from kinreach.sim.inside import BEYOND_LIMIT, IDEAL, Imperfections, as_imperfections
from kinreach.thesis import REACHED_POSTURE_ERROR
from kinreach.thesis.inside import posture_errors
from kinreach.vision import SensorNoise, geometric_goal_view
from kinreach.vision.inside import MAX_EXPOSURE

#: How the tool points at a goal, in the world: straight down.
TOOL_DOWN = (0.0, 0.0, -1.0)
#: Largest change of a joint in one step of the multi-step task [rad], and of one that slides [m].
STEP_SIZE, STEP_LENGTH = math.radians(5.0), 0.01
#: Cameras see no further than this; the bound of the goal's coordinates in the observation space [m].
CAMERA_RANGE = 2.0
#: The same for an arm without cameras, whose goals are given in the world [m].
GOAL_RANGE = 10.0
#: Bound of the errors of a posture in a goal [rad].
ERROR_RANGE = 50.0

#: How an observation gives the goal: in metres in the cameras' frames, or as places in their pictures and depth.
CAMERA, IMAGE = GOAL_FRAMES = ("camera", "image")


@dataclass(frozen=True, kw_only=True)
class ReachOptions(GoalOptions):
    """Options of the reach environments, single and in native batches."""

    reward: RewardFunction | str | None = field(
        default=None,
        metadata=about(
            '`"sparse"` (0 where the goal is reached, else -1), or a function as `kinreach.envs._reach.rewards` '
            'describes; by default the arm\'s own, `"dense"`'
        ),
    )
    exposure: float = field(
        default=1.0,
        metadata=about(
            "largest factor by which a picture is brighter or darker, another one each time", observation=CAMERA
        ),
    )
    looks: int = field(
        default=0,
        metadata=about(
            "how many looks the cameras take beforehand; a goal then is seen with the error of the nearest of them. "
            "0: a look at every goal"
        ),
    )
    goal_in: str = field(
        default=CAMERA,
        metadata=about(
            'how each camera gives the goal: `"camera"` (x, y, z in its frame [m]) or `"image"` (u = x/z, '
            "v = y/z, both held within 2, and the depth z [m])",
            flag=None,
        ),
    )
    tolerance: float = field(
        default=0.0,
        metadata=about(
            "how far from its target a joint may end, drawn uniformly each time [rad]; of the kinematic backend, where "
            "joints otherwise end exactly there"
        ),
    )
    margin: float = field(
        default=MARGIN,
        metadata=about(
            "parts that are nearer count as colliding where `accept` judges a posture and the kinematic backend a "
            "target [m]; under dynamics contacts decide what is blocked"
        ),
    )
    end_on_reached: bool = field(
        default=True, metadata=about("whether reaching the goal ends an episode of several steps")
    )
    control: str = field(default=tip_control.JOINTS, metadata=tip_control.about_control(*tip_control.MOVE))
    imperfections: Mapping[str, float] | Imperfections | None = field(
        default=None,
        metadata=about(
            "of the arm in dynamics, by name: `friction`, `damping`, `payload` and `encoder_noise`, such as "
            '`{"payload": 0.5}`; by default it is ideal'
        ),
    )
    randomise: Ranges | None = field(default=None, metadata=about_randomise(WITH_CAMERAS))

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("exposure", self.exposure, least=1.0, most=MAX_EXPOSURE)
        check_count("looks", self.looks, least=0, most=10**6)
        check_known("goal_in", self.goal_in, GOAL_FRAMES)
        check_number("tolerance", self.tolerance, least=0.0, most=math.pi)
        if self.tolerance and self.backend != "kinematic":
            raise InputError(f'a tolerance is for backend="kinematic", got {self.backend!r}, where the dynamics decide')
        check_flag("end_on_reached", self.end_on_reached)
        check_known("control", self.control, tip_control.CONTROLS)
        if as_imperfections(self.imperfections) != IDEAL and self.backend == "kinematic":
            raise InputError(f'imperfections are of the dynamics: use backend="mujoco", got {self.backend!r}')
        check_randomise(self.randomise, backend=self.backend)
        if "camera" in (self.randomise or ()) and self.observation == "pixels":
            raise InputError("randomise['camera'] displaces what cameras measure; observation=\"pixels\" has pictures")
        check_reward(self.reward, names=REWARD_NAMES)
        if self.goal_env and self.goal_in != CAMERA:
            raise InputError(f'goal_env=True has the goal in the world: use goal_in="camera", got {self.goal_in!r}')
        arm = get_arm(self.arm)
        if arm.goal_cameras:
            return
        for name, plain in (("observation", "geometric"), ("goal_in", CAMERA)):
            if (value := getattr(self, name)) != plain:
                raise InputError(
                    f"{name}={value!r} needs a camera that measures the goal, arm {arm.name!r} has none: give it a "
                    f'CameraMount with observed=True, or use {name}="{plain}"'
                )

    @property
    def noise(self) -> SensorNoise:
        """Noise of the cameras, from `rgb_noise`, `depth_noise` and `exposure`."""
        return SensorNoise(rgb_sigma=self.rgb_noise, depth_sigma=self.depth_noise, exposure=self.exposure)


@dataclass(frozen=True)
class ReachVariant:
    """One way to act.

    Attributes:
        name: `"single"` or `"multi"`.
        relative: Whether an action changes the joint angles (else it sets them).
        scale: What an action of 1 means for a joint that turns [rad]; where it sets one, for the limits ±pi.
        two_phase: Whether the arm's `moves_last` (shoulder_lift of a UR) wait for the other joints.
        one_action: Whether an episode is over after its first action.
    """

    name: str
    relative: bool
    scale: float
    two_phase: bool
    one_action: bool


#: One action sets all joints, shoulder_lift last; the episode is over (thesis, section 3.4.5).
SINGLE_STEP = ReachVariant("single", relative=False, scale=math.pi, two_phase=True, one_action=True)
#: Actions of -5 ... 5 degrees, or -10 ... 10 mm, all joints at once.
MULTI_STEP = ReachVariant("multi", relative=True, scale=STEP_SIZE, two_phase=False, one_action=False)


class Layout(NamedTuple):
    """Where things are in an observation.

    Attributes:
        goal: The goal block: the goal in the frame of each goal camera, or without cameras in the world [m].
        direction: Where the tool is to point, a unit vector in the world; empty where it always points down.
        q: Joint angles [rad].
        gripper: Opening of the gripper [m].
    """

    goal: slice
    direction: slice
    q: slice
    gripper: int

    @classmethod
    def of(cls, goal: int, joints: int, *, direction: int = 0) -> Layout:
        """Lay goal block, direction and posture of these sizes one after the other."""
        first = goal + direction
        return cls(slice(0, goal), slice(goal, first), slice(first, first + joints), first + joints)

    @property
    def fixed(self) -> slice:
        """Goal block and direction, which stay the same during an episode."""
        return slice(0, self.direction.stop)

    @property
    def rest(self) -> slice:
        """All but these: joint angles and gripper."""
        return slice(self.q.start, self.size)

    @property
    def size(self) -> int:
        """Numbers of an observation."""
        return self.gripper + 1


#: The UR5's: goal in both cameras (6), joint angles (6), gripper opening (1).
JOINTS = 6
UR5_LAYOUT = Layout.of(goal=6, joints=JOINTS)


def layout_of(arm: ArmDescription, *, directed: bool = False) -> Layout:
    """Return the layout of the observation of an arm, with or without goal cameras."""
    return Layout.of(3 * len(arm.goal_cameras) or 3, len(arm.joints), direction=3 if directed else 0)


@lru_cache
def joint_limits(arm: ArmDescription) -> tuple[Floats, Floats]:
    """Lower and upper joint limits [rad], each of shape (n,); where a URDF has pi with eleven digits, pi.

    A joint with more than two turns each way, such as wrist_3 of a UR3, is used within one: actions are parts of the
    range. A joint that turns without end is used from -pi to pi, which is every posture of it once.
    """
    kinematics = ArmKinematics(arm)
    low, high = (
        # URDFs write pi with eleven digits
        np.where(np.abs(np.abs(limits) - math.pi) < 1e-9, np.copysign(math.pi, limits), limits)
        for limits in kinematics.sampling_limits
    )
    turn = 2.0 * math.pi
    many = high - low > 4.0 * turn
    return np.where(many, np.maximum(low, -turn), low), np.where(many, np.minimum(high, turn), high)


@lru_cache
def _endless(arm: ArmDescription) -> NDArray[np.bool_]:
    """Which joints turn without end, shape (n,)."""
    return np.isinf(ArmKinematics(arm).upper)


def held_in_limits(arm: ArmDescription, q: Floats) -> Floats:
    """Return postures (k, n) [rad] held within `joint_limits`; joints that turn without end keep their turns."""
    held = np.clip(q, *joint_limits(arm))
    return np.where(_endless(arm), q, held) if _endless(arm).any() else held


def seen_joints(arm: ArmDescription, q: Any) -> Any:
    """Return joint angles as observations have them, shape (..., n): those of joints without end within ±pi.

    A posture looks the same however often such a joint has turned, and an observation is bounded. It stays an angle, as
    that of any other joint, and is not its cosine and sine: a solver finds the posture in it, and a policy one number
    for each joint of each arm.
    """
    endless = _endless(arm)
    return np.where(endless, wrapped(np.asarray(q)), q) if endless.any() else q


def opening_of(arm: ArmDescription) -> float:
    """Return the gripper's opening in which an arm reaches [m]; 0 without a gripper."""
    return 0.0 if arm.gripper is None else arm.gripper.opening


def action_range(arm: ArmDescription) -> tuple[Floats, Floats]:
    """Return the change by an action of 1, from the middle of each joint's range, and the middle [rad], shape (n,)."""
    low, high = joint_limits(arm)
    return (high - low) / 2, (high + low) / 2


@lru_cache
def step_sizes(arm: ArmDescription) -> Floats:
    """Return the largest change of each joint in one step of the multi-step task [rad, m], shape (n,)."""
    return np.where(ArmKinematics(arm).slides, STEP_LENGTH, STEP_SIZE)


def action_space(arm: str | ArmDescription = THESIS_ARM) -> spaces.Box:
    """Actions of an agent, one in [-1, 1] for each joint."""
    return spaces.Box(-1.0, 1.0, (len(get_arm(arm).joints),), np.float32)


def observation_space(arm: str | ArmDescription = THESIS_ARM, *, directed: bool = False) -> spaces.Box:
    """Goal block, direction of the tool if goals have one, joint angles and gripper opening in metres and radians."""
    arm = get_arm(arm)
    layout, (lower, upper) = layout_of(arm, directed=directed), joint_limits(arm)
    low, high = np.empty(layout.size), np.empty(layout.size)
    high[layout.goal] = CAMERA_RANGE if arm.goal_cameras else GOAL_RANGE
    low[layout.goal] = -high[layout.goal]
    low[layout.direction], high[layout.direction] = -1.0, 1.0
    low[layout.q], high[layout.q] = lower - BEYOND_LIMIT, upper + BEYOND_LIMIT
    low[layout.gripper], high[layout.gripper] = 0.0, CAMERA_RANGE
    return spaces.Box(low, high, dtype=np.float64)


def goal_block(arm: ArmDescription, goals: Floats) -> Floats:
    """Measure goals in the world [m], shape (k, 3), as perfect cameras; without cameras return the goals."""
    return geometric_goal_view(arm, goals) if arm.goal_cameras else goals.copy()


def _check_views(arm: ArmDescription) -> None:
    """Refuse cameras that measure goals further away than an observation holds."""
    goals = arm.workcell.goals
    if arm.goal_cameras and goals is not None:
        seen = np.abs(goal_block(arm, goals.sample(np.random.default_rng(0), 64))).max(axis=0)
        if seen.max() > CAMERA_RANGE:
            camera = arm.goal_cameras[int(seen.argmax()) // 3].name
            raise InputError(
                f"camera {camera!r} of arm {arm.name!r} measures goals {seen.max():.2f} m away, more than the "
                f"{CAMERA_RANGE:g} m of an observation: put it nearer, or leave out observed=True"
            )


def distance_between(tip: Any, goals: Any) -> Any:
    """Return the distances of tips from goals [m], shape (k,), by the first three columns of both."""
    x, y, z = (tip[:, axis] - goals[:, axis] for axis in range(3))
    return namespace(x).sqrt(x * x + y * y + z * z)


def tool_goal(
    arm: ArmDescription, position: ArrayLike, direction: ArrayLike = TOOL_DOWN, *, directed: bool = False
) -> AxisGoal | PositionGoal:
    """Return the goal of a solver: the tip at a point of the world [m], the tool in a direction of the world.

    With fewer than six joints the direction is free, unless goals are `directed`.
    """
    point = as_floats("position", position)
    if directed or len(arm.joints) >= JOINTS:
        return AxisGoal(point, direction)  # type: ignore[arg-type]
    return PositionGoal(point)


def check_actions(actions: ArrayLike, count: int | None, joints: int = JOINTS) -> Floats:
    """Return actions as `check_box_actions` does, in an array in which what belongs to one joint lies side by side.

    So the formulas want it.
    """
    return np.array(check_box_actions(actions, (joints,), count).T, order="C").T


class ReachReset(NamedTuple):
    """The options of `reset`, one row an environment; None for those that are not given.

    Attributes:
        goals: Where the balls are in the world [m], shape (count, 3).
        q: Postures [rad], shape (count, n).
        views: Goal blocks [m], shape (count, size of the block).
        directions: Where the tools are to point, unit vectors in the world, shape (count, 3).
    """

    goals: Floats | None = None
    q: Floats | None = None
    views: Floats | None = None
    directions: Floats | None = None


def _refuse_outside_limits(arm: ArmDescription, q: Floats) -> None:
    """Refuse postures (m, n) that no action asks for: its range may be narrower than the arm's own limits."""
    lower, upper = joint_limits(arm)
    beyond = np.where(_endless(arm), 0.0, np.maximum(lower - q, q - upper))
    if beyond.max() > 0.0:
        row, joint = np.unravel_index(beyond.argmax(), q.shape)
        raise InputError(
            f"q: {arm.joints[joint]} must be within {lower[joint]:g} … {upper[joint]:g} rad, got {q[row, joint]:g}"
        )


class ReachTask:
    """One variant of the task on one arm; here the tool always points down.

    Attributes:
        kinematics: From the world to the arm's default tip.
        gripper_opening: In which the arm reaches [m]; 0 without a gripper.
        directed: Whether goals have a direction of the tool.
        tip: Turns actions into postures where they change the tip; None where they change joints.
    """

    directed = False

    def __init__(self, options: ReachOptions, variant: ReachVariant) -> None:
        self.options = options
        self.variant = variant
        self.arm = arm = get_arm(options.arm)
        self.kinematics = ArmKinematics(arm, base="world")
        self.scorer = scorer_of(options.reward, self.default_reward())
        self.home = np.array(arm.home)
        self.layout = layout_of(arm, directed=self.directed)
        self.gripper_opening = opening_of(arm)
        _check_views(arm)
        self._half, self._middle = action_range(arm)
        self._steps = step_sizes(arm)
        self._endless = _endless(arm)
        self.tip: TipControl | None = None
        if options.control != tip_control.JOINTS:
            if not variant.relative:
                raise InputError(
                    f'control="{options.control}" is of environments with several steps, such as kinreach/Reach-v0 '
                    'with steps="multi": here an action is a posture'
                )
            alone = options.backend != "kinematic"
            self.tip = TipControl(arm, options.control, joint_limits(arm), tip_control.MOVE, alone=alone)

    @property
    def action_space(self) -> spaces.Box:
        """Actions, in [-1, 1]."""
        return action_space(self.arm) if self.tip is None else spaces.Box(-1.0, 1.0, (self.tip.size,), np.float32)

    def default_reward(self) -> Scorer:
        """Return the reward without the option `reward`: the arm's own."""
        return default_reward(self.arm)

    @property
    def observation_space(self) -> spaces.Space[Any]:
        whole = observation_space(self.arm, directed=self.directed)
        if not self.options.goal_env:
            return whole
        rest = self.layout.rest
        return goal_dict(spaces.Box(whole.low[rest], whole.high[rest], dtype=whole.dtype.type), self._goal_space)

    @property
    def _goal_space(self) -> spaces.Box:
        high = np.array(3 * [GOAL_RANGE] + 3 * self.directed * [1.0] + 2 * self.judges_posture * [ERROR_RANGE])
        low = -high
        low[3 + 3 * self.directed :] = 0.0
        return spaces.Box(low, high, dtype=np.float64)

    @cached_property
    def judges_posture(self) -> bool:
        """Whether the thesis's errors of the posture are a part of a goal."""
        return judges_posture(self.scorer)

    def achieved(self, tip: Floats, q: Floats) -> Floats:
        """Return the goals that arms have achieved, shape (k, size).

        Place of the tip in the world [m], the tool's z axis where goals have a direction, and where the reward judges
        the posture its two errors [rad].
        """
        parts = [tip, np.clip(self.axes(q), -1.0, 1.0)]
        return np.column_stack([*parts, *posture_errors(q)] if self.judges_posture else parts)

    def desired(self, goals: Floats, directions: Floats) -> Floats:
        """Return what is to be achieved, likewise: errors of the posture are to be 0."""
        parts = [goals, np.clip(directions[:, : 3 * self.directed], -1.0, 1.0)]
        return np.column_stack([*parts, np.zeros((len(goals), 2 * self.judges_posture))])

    def score_of_goals(
        self, achieved: Floats, desired: Floats, impossible: NDArray[np.bool_], q: Callable[[], Floats]
    ) -> Score:
        """Judge k steps by goals, shape (k, size); `q` gives postures to a function of the user's.

        An error of the posture counts as far as it is larger than the desired one.
        """
        distance = distance_between(achieved, desired)
        errors = np.maximum(achieved - desired, 0.0)[:, -2:].T
        return score_of_goals(self.scorer, distance, impossible, errors=errors, q=q)

    def axes(self, q: Floats) -> Floats:
        """Return the tools' z axes in the world, shape (k, 3), where goals have a direction; else shape (k, 0)."""
        return np.empty((len(q), 0))

    def reset_options(self, options: Mapping[str, Any] | None, count: int | None) -> ReachReset:
        """Check the options of `reset`."""
        arm = self.arm
        if self.options.goal_env and isinstance(options, Mapping) and options.get("view") is not None:
            raise InputError("a view is of the goal block, which observations with goal_env=True do not have")
        sizes = {"goal": 3, "q": len(arm.joints), "view": self.layout.goal.stop}
        start = ReachReset(*option_rows(options, sizes | ({"direction": 3} if self.directed else {}), count))
        bound, where = (CAMERA_RANGE, "that the cameras see") if arm.goal_cameras else (GOAL_RANGE, "of goals")
        if start.q is not None:
            _refuse_outside_limits(arm, start.q)
        if start.goals is not None:
            seen = np.abs(goal_block(arm, start.goals)).max(axis=1)
            if (seen > bound).any():
                raise InputError(f"goal {start.goals[seen.argmax()]} m is outside the {bound:g} m {where}")
        if start.directions is not None:
            length = np.linalg.norm(start.directions, axis=1, keepdims=True)
            if (length < 1e-9).any():
                raise InputError(f"direction must not be zero, got {start.directions[length.argmin()]}")
            start = start._replace(directions=start.directions / length)
        if start.views is not None and (np.abs(start.views) > bound).any():
            raise InputError(
                f"view must be within ±{bound:g} m, got {start.views.flat[np.abs(start.views).argmax()]:g}"
            )
        return start

    def streams(self, count: int) -> RowStreams:
        return goal_streams(self.arm.workcell, count)

    def training_starts(self, rng: np.random.Generator, count: int, *, beyond: float) -> dict[str, Floats]:
        """Draw options of `reset` for learners, in the arm's region and up to `beyond` [m] around it."""
        goals = self.arm.workcell.goals
        if not isinstance(goals, BoxRegion):
            raise InputError(f"goals are drawn around a BoxRegion, arm {self.arm.name!r} has {shown(goals)}")
        return {"goal": goals.wider(beyond).sample(rng, count)}

    def completed(self, start: ReachReset, streams: RowStreams, ids: NDArray[np.intp]) -> tuple[Floats, ReachReset]:
        """Return goals and a start, with missing values drawn from the streams of the given environments."""
        return streams.draw(ids) if start.goals is None else start.goals.copy(), start

    def score(self, distance: Floats, q: Floats, impossible: NDArray[np.bool_], directions: Floats) -> Score:
        """Judge k steps.

        Args:
            distance: From the tips to the goals [m], shape (k,).
            q: Postures [rad], shape (k, n).
            impossible: Whether the actions could not be executed, shape (k,).
            directions: Where the tools are to point, unit vectors in the world, shape (k, 3).
        """
        return self.scorer.score(distance, q, impossible)

    def posture_error(self, q: Floats, directions: Floats) -> Floats:
        """Return `Score.posture_error` of postures [rad], shape (k, n); shape (k,)."""
        return self.scorer.posture_error(q)

    def targets(self, q: Floats, actions: Floats) -> Floats:
        """Joint targets [rad] of checked actions in postures `q`, all of shape (k, n).

        A joint that turns without end goes to the angle of an action by the shorter way.
        """
        if self.variant.relative:
            return q + self._steps * actions
        targets = self._half * actions + self._middle
        return np.where(self._endless, q + wrapped(targets - q), targets) if self._endless.any() else targets

    def action_for(self, q: Floats, target: Floats) -> Floats:
        """Return the action from a posture `q` to a target [rad], or straight towards it; shape (n,)."""
        if self.tip is not None:
            action: Floats = self.tip.action_for(q[None], target[None])[0]
            return action
        if self.variant.relative:
            return shortened((target - q) / self._steps)
        return np.asarray((seen_joints(self.arm, target) - self._middle) / self._half)

    def waypoints_to(self, q: Floats, target: Floats) -> list[Floats]:
        """Return the postures that a move passes: with two phases, that in which `arm.moves_last` has yet to move."""
        if not self.variant.two_phase:
            return [target]
        return [between_phases(self.arm, q, target), target]

    def natural(self, q: ArrayLike, direction: Floats) -> bool:
        """Return whether the posture error of a posture [rad], shape (n,), is small enough to reach a goal."""
        posture = as_vector("q", q, len(self.arm.joints))
        return bool(self.posture_error(posture[None], direction[None])[0] < REACHED_POSTURE_ERROR)

    def way_free(self, q: Floats, target: Floats) -> bool:
        """Return True: moves from the one start pose to natural postures are not blocked on the way."""
        return True

    @cached_property
    def checker(self) -> CollisionChecker:
        """The collision checker, with the option `margin`."""
        return CollisionChecker(self.kinematics, margin=self.options.margin)
