"""Environments of one's own: an arm with its gripper at a table, a free object on it, and a task of a few lines."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, cast

import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import register
from numpy.typing import ArrayLike

from kinreach._checks import Floats, as_array, as_floats, check_count, check_flag, check_known, check_number, shown
from kinreach._objects import load_object
from kinreach.envs._batch import Episodes, Flags, Ids, NativeVectorEnv, Outcome, RowStreams, told_terms
from kinreach.envs._goals import DENSE, REWARD_NAMES, SPARSE, GoalMethods, Told, goal_dict
from kinreach.envs._lift.lift_task import check_objects, grasping_arm, grasping_batch, table_of
from kinreach.envs._options import EnvOptions, check_box_actions, in_dtype, option_rows
from kinreach.envs._randomise import Randomisation, Ranges, about_randomise, check_randomise, drawn_of
from kinreach.envs._reach.reach_task import CAMERA_RANGE, GOAL_RANGE, joint_limits, seen_joints
from kinreach.envs._single import ArmEnv
from kinreach.envs._small_steps import STEP_OPENING, STEP_S, SmallSteps, tip_of
from kinreach.envs._tip_control import CONTROLS, JOINTS, SMALL_STEP, about_control
from kinreach.errors import InputError, UnknownOptionError
from kinreach.kinematics import ArmKinematics
from kinreach.robots import THESIS_ARM, ArmDescription, BoxRegion, Gripper
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import (
    BALL,
    BALL_GROUP,
    BEYOND_LIMIT,
    BOUNDS,
    CUBE,
    MUJOCO,
    SHAPES,
    WARP,
    Grasping,
    Objects,
)

#: Of the ball that marks a goal, beside objects that may be red.
GOAL_COLOUR = (0.10, 0.70, 0.20, 0.6)


class TabletopState(NamedTuple):
    """What a task sees of k simulations; every array has k rows, and all places are in the world frame.

    Attributes:
        q: Joint angles [rad], shape (k, n).
        opening: Between the fingers [m], shape (k,).
        tip: Place of the arm's tip [m], shape (k, 3).
        position: Of the object's centre [m], shape (k, 3).
        rotation: Of the object to the world, shape (k, 3, 3).
        gripped: Whether the object touches both fingers, shape (k,).
        clearance: Of the object's lowest point above the table [m], shape (k,).
        collides: Whether a link is in the table, another obstacle or another link, by more than 1 mm, shape (k,).
    """

    q: Floats
    opening: Floats
    tip: Floats
    position: Floats
    rotation: Floats
    gripped: Flags
    clearance: Floats
    collides: Flags


class TabletopTask(ABC):
    """What is to be done with an object on the table; a subclass and `register_tabletop` make an environment of it.

    A task says where episodes start (`sample`), what has been achieved (`achieved`) and when that is enough
    (`success`), for k simulations at once. Arm, dynamics, spaces, resets, `info`, rendering and the native batch are
    there already. Class attributes are the rest; arguments of the class are keywords of `gym.make`, with other names
    than the options of `TabletopEnv` and of native batches.

    Attributes:
        arm: Name of a UR or `so101`, or an `ArmDescription`; a UR without a gripper gets it. Its work cell has a table.
        goal_size: Numbers of a goal. One of 3 is a place in the world [m], and is drawn as a green ball.
        fingers: Whether the last number of an action moves the fingers; without, actions have none for them.
        opening: Between the fingers at the start [m]; None for that of the arm's gripper.
        shape: Of the object: `"ball"`, `"cube"` or `"cylinder"`.
        size: Its radius, or half the edge of a cube [m].
        mass: [kg].
        friction: Coefficient of sliding friction with everything that it touches.
    """

    arm: str | ArmDescription = THESIS_ARM
    goal_size: int = 3
    fingers: bool = True
    opening: float | None = None
    shape: str = CUBE
    size: float = 0.025
    mass: float = 0.05
    friction: float = 1.0

    @abstractmethod
    def sample(self, rng: np.random.Generator, count: int, region: BoxRegion) -> tuple[Floats, Floats, Floats]:
        """Draw the starts of `count` episodes.

        Args:
            rng: The only source of randomness, so that seeds mean the same everywhere.
            count: Number of episodes.
            region: Where the work cell has its goals, in the world [m]; `region.z[0]` is the height of the table's top.

        Returns:
            Where the object stands on the table, x and y [m], shape (count, 2); its turn about the vertical [rad],
            shape (count,); the goals, shape (count, goal_size).
        """

    @abstractmethod
    def achieved(self, state: TabletopState) -> Floats:
        """Return what is to become the goal, shape (k, goal_size), such as `state.position`."""

    @abstractmethod
    def success(self, achieved: Floats, goals: Floats) -> Flags:
        """Return which goals are attained, bool, shape (k,)."""

    def reward_terms(self, state: TabletopState, goals: Floats) -> dict[str, Floats]:
        """Return the terms of the reward, each of shape (k,); the reward is their sum.

        By default `distance`, minus the distance of what is achieved and the goal, and `success`, 1 for it.
        """
        return _terms_of(self, self.achieved(state), goals)


def _terms_of(task: TabletopTask, achieved: Floats, goals: Floats) -> dict[str, Floats]:
    distance = np.linalg.norm(achieved - goals, axis=1)
    return {"distance": -distance, "success": task.success(achieved, goals).astype(np.float64)}


def register_tabletop(name: str, task: type[TabletopTask] | str, *, max_episode_steps: int = 100) -> None:
    """Register a task with Gymnasium, for `gym.make` and, as a native batch, for `gym.make_vec`.

    Args:
        name: Id of the environment, such as `"mine/Push-v0"`.
        task: The class, or `"module:Class"`, which processes that import nothing else find too.
        max_episode_steps: Steps, of 0.04 s each, after which Gymnasium truncates an episode.

    Raises:
        InputError: No subclass of `TabletopTask`, one with an argument that is an option of all environments, or a
            limit below 1.
    """
    if not isinstance(task, str):
        _checked_class(task)
    register(
        name,
        entry_point=f"{__name__}:TabletopEnv",
        vector_entry_point=f"{__name__}:TabletopVectorEnv",
        max_episode_steps=check_count("max_episode_steps", max_episode_steps),
        kwargs={"task": task, "limit": max_episode_steps},
    )


def _checked_class(task: object) -> type[TabletopTask]:
    if not (isinstance(task, type) and issubclass(task, TabletopTask)):
        raise InputError(f"task must be a subclass of TabletopTask or its name, module:Class, got {shown(task)}")
    of_environments = {entry.name for entry in fields(TabletopOptions)} - {"arguments"}
    of_environments |= inspect.signature(NativeVectorEnv).parameters.keys() - {"options"}
    if taken := [name for name in inspect.signature(task).parameters if name in of_environments]:
        raise InputError(
            f"the task {task.__name__} cannot have arguments named {', '.join(map(repr, taken))}, which are the "
            "environments' own and do not get to it: rename them"
        )
    return task


class _Start(NamedTuple):
    """Values that k episodes start with; None for those that are drawn."""

    places: Floats | None = None
    yaws: Floats | None = None
    goals: Floats | None = None


_ALL_DRAWN = _Start()


@dataclass(frozen=True, kw_only=True)
class TabletopOptions(EnvOptions):
    """Options of every environment of this kind.

    Attributes:
        task: The class of the task, or its name.
        arguments: Of that class.
        limit: Steps after which episodes of a batch are truncated, as registered.
        goal_env: Whether observations have the goals apart, for hindsight experience replay.
        reward: `"dense"`, the task's own, or `"sparse"`: 0 for success, else -1.
        control: What actions change: `"joints"`, or the `"position"` or `"pose"` of the tip.
        backend: `"mujoco"`, in native batches also `"warp"`.
    """

    task: type[TabletopTask] | str
    arguments: Mapping[str, Any]
    limit: int = 100
    goal_env: bool = False
    reward: str = DENSE
    control: str = field(default=JOINTS, metadata=about_control(*SMALL_STEP))
    randomise: Ranges | None = field(default=None, metadata=about_randomise(BOUNDS))
    backend: str = MUJOCO

    def __post_init__(self) -> None:
        super().__post_init__()
        check_flag("goal_env", self.goal_env)
        check_known("reward", self.reward, REWARD_NAMES)
        check_known("control", self.control, CONTROLS)
        check_known("backend", self.backend, (MUJOCO, WARP))
        check_randomise(self.randomise, backend=self.backend, bounds=BOUNDS)

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> TabletopOptions:
        """Return the options of an environment, the arguments of its task among them."""
        own = {entry.name for entry in fields(cls)} - {"arguments"}
        arguments = {name: value for name, value in options.items() if name not in own}
        return cls(arguments=arguments, **{name: value for name, value in options.items() if name in own})


def _check_arguments(kind: type[TabletopTask], given: Mapping[str, Any]) -> None:
    """Refuse what is neither an option of the environments nor an argument of the task."""
    takes = inspect.signature(kind).parameters
    unknown = [name for name in given if name not in takes]
    if unknown and all(one.kind is not inspect.Parameter.VAR_KEYWORD for one in takes.values()):
        own = [entry.name for entry in fields(TabletopOptions) if entry.name not in ("arguments", "limit", "task")]
        names = ", ".join(map(repr, unknown))
        raise UnknownOptionError(f"got an unexpected keyword argument {names}; available: {', '.join([*takes, *own])}")


class _Setup:
    """A task on its arm: what one environment and a batch of it have in common."""

    def __init__(self, options: TabletopOptions) -> None:
        task, given = options.task, options.arguments
        kind = _checked_class(load_object("task", task) if isinstance(task, str) else task)
        _check_arguments(kind, given)
        try:
            self.task = made = kind(**given)
        except TypeError as error:
            raise InputError(f"cannot make the task: {error}") from error
        numbers = check_count("goal_size", made.goal_size, most=100)
        check_flag("fingers", made.fingers)
        check_known("shape", made.shape, SHAPES)
        self.arm = arm = grasping_arm(made.arm)
        check_objects(arm, [made.size], [made.mass], [made.friction])
        self.gripper = gripper = cast("Gripper", arm.gripper)
        opening = gripper.opening if made.opening is None else made.opening
        self.opening = check_number("opening [m]", opening, least=0.0, most=gripper.stroke)
        self.kinematics: Any = ArmKinematics.of(arm, base="world")
        self.home = np.array(arm.home)
        self.limits = joint_limits(arm)
        region: Any = arm.workcell.goals
        _, top = table_of(arm.workcell.obstacles)
        self.region = BoxRegion(region.x, region.y, (top, top))
        self.tip = tip_of(arm, options.control)
        moved = len(self.home) if self.tip is None else self.tip.size
        self.action_space = spaces.Box(-1.0, 1.0, (moved + made.fingers,), np.float32)
        lower, upper = self.limits
        places = 6 * [GOAL_RANGE]
        high = np.concatenate([upper + BEYOND_LIMIT, [CAMERA_RANGE], places, 6 * [1.0], numbers * [GOAL_RANGE]])
        low = np.concatenate([lower - BEYOND_LIMIT, [0.0], -high[len(upper) + 1 :]])
        self.whole_space = spaces.Box(low, high, dtype=np.float64)
        self.observation_space: spaces.Space[Any] = self.whole_space
        if options.goal_env:
            rest = spaces.Box(low[:-numbers], high[:-numbers], dtype=np.float64)
            self.observation_space = goal_dict(rest, spaces.Box(low[-numbers:], high[-numbers:], dtype=np.float64))

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw starts: place, yaw and goal, shape (count, 3 + goal_size)."""
        rows: Any = self.task.sample(rng, count, self.region)
        sizes = {"places": (count, 2), "turns": (count,), "goals": (count, self.task.goal_size)}
        if not isinstance(rows, tuple) or len(rows) != len(sizes):
            raise InputError(f"sample must return places, turns and goals, got {shown(rows)}")
        for (name, shape), values in zip(sizes.items(), rows, strict=True):
            if np.shape(values) != shape or not np.isfinite(values).all():
                raise InputError(f"the {name} of sample must be finite and have shape {shape}, got {np.shape(values)}")
        return np.column_stack(rows)


class TabletopEpisodes(Episodes):
    """The episodes of a number of arms in step."""

    def __init__(self, options: TabletopOptions, setup: _Setup, world: Grasping) -> None:
        self.options, self.setup, self.world, self.count = options, setup, world, world.count
        self.action_space, self.observation_space = setup.action_space, setup.observation_space
        self._streams = RowStreams(setup.sample, self.count, size=3 + setup.task.goal_size)
        self._drawn = Randomisation(options.randomise, self.count, world.drawn)
        self.small_steps = SmallSteps(setup.arm, setup.tip, self.count)
        self.goals = np.zeros((self.count, setup.task.goal_size))
        joints, numbers, truths = len(setup.home), np.zeros(self.count), np.zeros(self.count, dtype=np.bool_)
        self._state = TabletopState(
            np.zeros((self.count, joints)), numbers, np.zeros((self.count, 3)), np.zeros((self.count, 3)),
            np.zeros((self.count, 3, 3)), truths, numbers.copy(), truths.copy(),
        )  # fmt: skip

    def seed(self, index: int, rng: np.random.Generator) -> None:
        self._drawn.seed(index, rng.spawn(1)[0])
        self._streams.seed(index, rng)

    def goal_info(self, rows: Any) -> dict[str, Any]:
        return {**super().goal_info(rows), **self._drawn.info(rows)}

    def check_start(self, options: Mapping[str, Any] | None, count: int | None) -> _Start:
        return _Start(*option_rows(options, {"place": 2, "yaw": 1, "goal": self.setup.task.goal_size}, count))

    def check_actions(self, actions: ArrayLike, count: int | None) -> Floats:
        return check_box_actions(actions, self.action_space.shape, count)

    def begin(self, ids: Ids, start: _Start = _ALL_DRAWN) -> None:
        rows, task, world = self._streams.draw(ids), self.setup.task, self.world
        for columns, values in zip((slice(0, 2), slice(2, 3), slice(3, None)), start, strict=True):
            if values is not None:
                rows[:, columns] = values
        each = np.ones(len(ids))
        numbers = (each * number for number in (task.size, task.mass, task.friction))
        self._drawn.begin(ids)
        world.reset(ids, np.tile(self.setup.home, (len(ids), 1)))
        world.put_fingers(ids, each * self.setup.opening)
        on_table = np.column_stack([rows[:, :2], each * self.setup.region.z[0]])
        world.put(ids, 0, Objects(np.full(len(ids), SHAPES.index(task.shape)), *numbers), on_table, rows[:, 2])
        self.goals[ids] = rows[:, 3:]
        self._read(ids)
        self.small_steps.begin(ids, self._state.q[ids])

    def _read(self, ids: Ids) -> None:
        now, q = self.world.grasp(ids), self.world.q[ids]
        tip = np.asarray(self.setup.kinematics.chain.positions(q))
        read = (q, now.opening, tip, now.position, now.rotation, now.gripped, now.clearance, now.collides)
        for mine, new in zip(self._state, read, strict=True):
            mine[ids] = new

    def observe(self) -> Any:
        state, space = self._state, self.setup.whole_space
        q, turned = seen_joints(self.setup.arm, state.q), state.rotation[:, :, :2].reshape(self.count, 6)
        numbers = (q, state.opening[:, None], state.tip, state.position, turned, self.goals)
        whole = np.clip(np.concatenate(numbers, axis=1), space.low, space.high)
        if not self.options.goal_env:
            return whole
        rest, desired = np.split(whole, [-self.setup.task.goal_size], axis=1)
        return {"observation": rest, "achieved_goal": self.setup.task.achieved(state), "desired_goal": desired}

    def step(self, actions: Floats, acting: Flags | None = None) -> Outcome:
        acting = np.ones(self.count, dtype=np.bool_) if acting is None else acting
        ids, world = np.flatnonzero(acting), self.world
        lost = np.zeros(self.count, dtype=np.bool_)
        if len(ids):
            before = world.states(ids)
            changes, opening = actions[ids], np.full(len(ids), self.setup.opening)
            if self.setup.task.fingers:
                opening = self._state.opening[ids] + STEP_OPENING * changes[:, -1]
                changes = changes[:, :-1]
            q = self.small_steps.targets(ids, self._state.q[ids], changes)
            world.steer(ids, q, np.clip(opening, 0.0, self.setup.gripper.stroke), STEP_S)
            lost[ids] = diverged = world.diverged(ids)
            if diverged.any():
                world.put_back(ids[diverged], before[diverged])
            self._read(ids)
        return self._outcome(acting, lost)

    def _outcome(self, acting: Flags, lost: Flags) -> Outcome:
        collides = acting & self._state.collides
        achieved, goals = self._compared()
        success = acting & ~collides & self._success(achieved, goals)
        paid = self._paid(success, collides, lambda: self._own_terms(lambda: self._state, achieved, goals))
        terms = {name: np.where(acting, term, 0.0) for name, term in paid.items()}
        reward = sum(terms.values(), np.zeros(self.count))
        return Outcome(reward, success, (collides | lost) & ~success, self._info(slice(None), success, collides, terms))

    def _compared(self) -> tuple[Floats, Floats]:
        """Return what was achieved and the goals; of goal environments as observed, so that rewards are the same."""
        pair = self.setup.task.achieved(self._state), self.goals
        if not self.options.goal_env:
            return pair
        achieved, goals = (in_dtype(np.asarray(each), self.options.dtype).astype(np.float64) for each in pair)
        return achieved, goals

    def _own_terms(self, state: Callable[[], TabletopState], achieved: Floats, goals: Floats) -> Mapping[str, Any]:
        if type(self.setup.task).reward_terms is TabletopTask.reward_terms:
            return _terms_of(self.setup.task, achieved, goals)
        return self.setup.task.reward_terms(state(), goals)

    def _paid(self, success: Flags, collides: Flags, own: Callable[[], Mapping[str, Any]]) -> dict[str, Floats]:
        """Return the terms of the reward, each of shape (k,); `own` gives those of the task."""
        if self.options.reward == SPARSE:
            return {SPARSE: np.where(success, 0.0, -1.0)}
        terms = {}
        for name, term in {**own(), "collision": -1.0 * collides}.items():
            if np.shape(term) != collides.shape:
                raise InputError(f"reward term {name!r} must have shape {collides.shape}, got {np.shape(term)}")
            terms[name] = as_floats(name, term)
        return terms

    def _success(self, achieved: Floats, goals: Floats) -> Flags:
        found = as_array("success", self.setup.task.success(achieved, goals))
        if found.shape != goals.shape[:1] or found.dtype != np.bool_:
            raise InputError(f"success must return bool of shape ({len(goals)},), got {found.dtype} of {found.shape}")
        return found

    def judge(self, achieved: Floats, desired: Floats, told: Told) -> Outcome:
        """Return what transitions with these goals, shape (k, goal_size), lead to; its `info` is empty.

        A task with `reward_terms` of its own needs the `info` of the steps; another one only to know of collisions.
        """
        collides = told.get("impossible", False).astype(np.bool_)
        success = ~collides & self._success(achieved, desired)

        def state() -> TabletopState:
            parts = {name: told.need(name) for name in TabletopState._fields if name != "collides"}
            return TabletopState(**parts, collides=collides)

        terms = self._paid(success, collides, lambda: self._own_terms(state, achieved, desired))
        return Outcome(sum(terms.values(), np.zeros(len(success))), success, collides, {})

    def start_info(self, ids: Ids) -> dict[str, Any]:
        nothing, task = np.zeros(len(ids), dtype=np.bool_), self.setup.task
        everyone = np.zeros(self.count, dtype=np.bool_)
        names = self._paid(everyone, everyone, lambda: task.reward_terms(self._state, self.goals))
        return self._info(ids, nothing, nothing, {name: np.zeros(len(ids)) for name in names})

    def _info(self, rows: Any, success: Flags, collides: Flags, terms: dict[str, Floats]) -> dict[str, Any]:
        state = self._state
        achieved = np.array(self.setup.task.achieved(state)[rows])
        return {
            **self.goal_info(rows),
            **self.small_steps.info(rows),
            "achieved": achieved,
            "distance": np.linalg.norm(achieved - self.goals[rows], axis=1),
            **{name: np.array(each[rows]) for name, each in state._asdict().items() if name != "collides"},
            "is_success": success,
            "reached": success,
            "impossible": collides,
            **told_terms(terms),
        }


class TabletopEnv(GoalMethods, ArmEnv):
    """A `TabletopTask` on its arm, under MuJoCo's dynamics, in steps of 0.04 s; `register_tabletop` gives it an id.

    The action is `Box(-1, 1, (n,), float32)`: changes of the n joints in parts of 5 degrees, and, where the task has
    `fingers`, one number more, the change of their opening in parts of 8 mm. Changes count from where joints and
    fingers stand. With `control="position"` the first numbers are three instead, the change of the tip's place along
    the world's axes in parts of 2 cm, while the tool keeps the direction in which the episode began; `control="pose"`
    has three more, a rotation vector in parts of 2 degrees. The arm's closed form finds the posture, in the branch in
    which the arm is, as in `kinreach/UR5MultiStep-v0`, with `info["tip_share"]`. The observation is `Box(float32)`:

    | Num | Observation | Unit |
    |-----|-------------|------|
    | n | joint angles | rad |
    | 1 | opening of the gripper | m |
    | 3 | place of the tip, in the world | m |
    | 3 | place of the object's centre, in the world | m |
    | 6 | its rotation to the world, row by row without the last column | 1 |
    | goal_size | the goal, as the task has it | m |

    The reward is the sum of the task's terms and of `collision`, -1 where a link is in the table, in another obstacle
    or in another link by more than 1 mm. An episode terminates with the task's success. A collision
    truncates it, or what a collision spares would make it pay where rewards are negative; so does a simulation that
    diverges. `reset(options={"place": (x, y), "yaw": angle, "goal": goal})` sets any of
    what is drawn. `info` has `goal`, `achieved`, `distance` (of the two), the fields of `TabletopState`, `is_success`,
    `reached`, `impossible` (a collision) and `reward_terms`, from `reset` too.

    With `goal_env=True` observations are a `Dict` of `observation`, without the goal, `achieved_goal` and
    `desired_goal`, and there are `compute_reward`, `compute_terminated` and `compute_truncated`, for hindsight
    experience replay.

    Args:
        task: The class of the task, or `"module:Class"`.
        randomise: Ranges of what is drawn of the arm at every reset, by name, such as `{"payload": (0, 0.5)}`:
            `payload`, `friction`, `damping`, `gears` and `encoder_noise`; `info` has `drawn_NAME`.
        **options: `goal_env`; `reward`, `"dense"` or `"sparse"` (0 for success, else -1); `control`, `"joints"`,
            `"position"` or `"pose"`; `info`, `dtype`, `render_mode`, `render_camera`, `render_width` and
            `render_height`, as every environment has them; `backend`, `"mujoco"`, or in native batches `"warp"`; and
            arguments of the task's class.

    Raises:
        InputError: A task, or options, that cannot be.
    """

    def __init__(
        self,
        task: type[TabletopTask] | str,
        *,
        randomise: Ranges | None = None,
        **options: Any,
    ) -> None:
        super().__init__(task=task, randomise=randomise, **options)

    @property
    def task(self) -> TabletopTask:
        """What is to be done."""
        return self._task.task

    @property
    def region(self) -> BoxRegion:
        """Where the work cell has its goals, in the world [m]; z is the height of the table's top."""
        region: BoxRegion = self._task.region
        return region

    def _checked(self, options: dict[str, Any]) -> TabletopOptions:
        return TabletopOptions.of(options)

    def _new_episodes(self, options: TabletopOptions) -> TabletopEpisodes:
        self._task = setup = _Setup(options)
        drawn, visual = drawn_of(options.randomise), options.render_mode is not None
        self._simulation = ArmSimulation(setup.arm, visual=visual, objects=1, drawn=drawn)
        if setup.task.goal_size == 3:  # the ball, which is hidden beside objects, marks the goal
            marker = self._simulation.model.geom(BALL)
            marker.group, marker.rgba = BALL_GROUP, GOAL_COLOUR
        return TabletopEpisodes(options, setup, Grasping(self._simulation))

    def _follow(self) -> None:
        if self._task.task.goal_size == 3:
            self._simulation.place_ball(self.episodes.goals[0])


class TabletopVectorEnv(GoalMethods, NativeVectorEnv):
    """A batch of `TabletopEnv`, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    Arguments are as of `NativeVectorEnv`; the options have `task`, the class or `"module:Class"`, and its arguments.
    With `backend="warp"` the `device` is Warp's too.
    """

    @property
    def registered_limit(self) -> int:  # type: ignore[override]
        """Steps after which episodes are truncated, unless `max_episode_steps` says otherwise."""
        limit: int = self.options.limit
        return limit

    def _checked(self, options: dict[str, Any]) -> TabletopOptions:
        return TabletopOptions.of(options)

    def _new_episodes(self, options: TabletopOptions, threads: int, device: str | None) -> TabletopEpisodes:
        setup = _Setup(options)
        world = grasping_batch(setup.arm, self.num_envs, options, objects=1, threads=threads, device=device)
        return TabletopEpisodes(options, setup, world)
