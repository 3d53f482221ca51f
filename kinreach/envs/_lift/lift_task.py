"""The lifting task: options, actions, observations, and starts of episodes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

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
from kinreach.envs import _tip_control as tip_control
from kinreach.envs._goals import DENSE, REWARD_NAMES, GoalOptions, goal_dict
from kinreach.envs._options import about, given_options, option_rows
from kinreach.envs._randomise import WITH_CAMERAS, Ranges, about_randomise, check_randomise, drawn_of
from kinreach.envs._reach.reach_task import (
    CAMERA_RANGE,
    GOAL_RANGE,
    Layout,
    action_range,
    joint_limits,
    seen_joints,
)
from kinreach.envs._small_steps import tip_of
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import THESIS_ARM, ArmDescription, Box, BoxRegion, get_arm
from kinreach.robots.inside import FLANGE, JawGripper
from kinreach.sim import BatchSimulation
from kinreach.sim.inside import BALL_SHAPE, BEYOND_LIMIT, CUBE, SHAPES, WARP, Grasping, Objects

#: Ways to act: a grasp in one action, or changes of joints and fingers 25 times a second.
SINGLE, MULTI = STEPS = ("single", "multi")
#: The tip approaches a grasp from so far above and lifts the object by as much [m].
LIFT = 0.15
#: How high the object's lowest point has to be above the table [m], and for how long [s].
HEIGHT, HOLD = 0.10, 0.5
#: Time in which the fingers close or open [s].
CLOSING = 0.5
#: The tip is at the object when it is no further from its centre [m].
NEAR = 0.02
#: Bounds of the options: size, mass, friction, how far the table is moved [m].
MIN_SIZE, MIN_MASS, MAX_MASS, MAX_FRICTION, MAX_SHIFT = 0.01, 1e-3, 1.0, 3.0, 0.05
#: The fingers come open as at the start; an object is smaller than that by so much [m].
CLEARANCE = 0.01
#: Distance between the middles of two objects [m], and how often a second one is drawn until it is kept.
APART, DRAWS = 0.13, 100
MAX_ATTEMPTS = 10
#: Where an observation has the object's place, the turn of its faces, its size, and whether it is a cube; where its
#: goal block ends.
SEEN, FACES, SIZE, IS_CUBE, KIND_END = slice(0, 3), 3, 4, 6, 8


@dataclass(frozen=True, kw_only=True)
class LiftOptions(GoalOptions):
    """Options of `kinreach/Lift-v0`."""

    steps: str = field(
        default=SINGLE,
        metadata=about('`"single"` (an action is a grasp) or `"multi"` (changes of joints and fingers at 25 Hz)'),
    )
    observation: str = field(
        default="geometric",
        metadata=about('`"geometric"`; for balls of one size also `"camera"`, which finds them, or `"pixels"`'),
    )
    backend: str = field(
        default="mujoco",
        metadata=about(
            '`"mujoco"`, or `"kinematic"`: a grasp is judged by geometry and nothing is lifted; in native batches also '
            '`"warp"`, for one shape (tried on CPUs only)'
        ),
    )
    arm: str | ArmDescription = field(
        default=THESIS_ARM,
        metadata=about("a UR or `so101` by name, or an `ArmDescription`; a UR without a gripper gets it"),
    )
    shapes: tuple[str, ...] = field(
        default=(BALL_SHAPE,), metadata=about(f"one of them an episode: {', '.join(SHAPES)}")
    )
    sizes: tuple[float, ...] = field(
        default=(0.025,),
        metadata=about("radius, or half the edge, uniform between the least and the largest of them [m]"),
    )
    masses: tuple[float, ...] = field(
        default=(0.05,), metadata=about("of the object, uniform between the least and the largest of them [kg]")
    )
    frictions: tuple[float, ...] = field(
        default=(1.0,), metadata=about("coefficient, uniform between the least and the largest of them")
    )
    clutter: bool = field(default=False, metadata=about("a second object of the same kind lies on the table"))
    table: tuple[float, ...] = field(
        default=(0.0, 0.0, 0.0), metadata=about("how far the table is moved, x, y and z [m], within 0.05")
    )
    attempts: int = field(default=1, metadata=about("grasps that may be tried in an episode of single steps"))
    randomise: Ranges | None = field(default=None, metadata=about_randomise(WITH_CAMERAS))

    control: str = field(default=tip_control.JOINTS, metadata=tip_control.about_control(*tip_control.SMALL_STEP))
    reward: str = field(default=DENSE, metadata=about('`"dense"`, or `"sparse"`: 0 for success, else -1', flag=None))

    def __post_init__(self) -> None:
        super().__post_init__()
        check_known("steps", self.steps, STEPS)
        check_known("reward", self.reward, REWARD_NAMES)
        check_known("control", self.control, tip_control.CONTROLS)
        if self.control != tip_control.JOINTS and self.steps != MULTI:
            raise InputError(f'control="{self.control}" is for steps="multi": else an action is a posture')
        for shape in self.shapes:
            check_known("shape", shape, SHAPES)
        arm = grasping_arm(self.arm)
        check_objects(arm, self.sizes, self.masses, self.frictions)
        as_vector("table [m]", self.table, 3, most=MAX_SHIFT)
        check_flag("clutter", self.clutter)
        check_randomise(self.randomise, backend=self.backend)
        if "camera" in (self.randomise or ()) and self.observation == "pixels":
            raise InputError("randomise['camera'] displaces what cameras measure; observation=\"pixels\" has pictures")
        check_count("attempts", self.attempts, most=MAX_ATTEMPTS)
        if self.observation != "geometric":
            lacks = {
                f"shapes {shown(self.shapes)}": set(self.shapes) != {BALL_SHAPE},
                f"sizes {shown(self.sizes)}": len(set(self.sizes)) > 1,
                "clutter=True": self.clutter,
                f"arm {arm.name!r}, which has no goal cameras": not arm.goal_cameras,
            }
            if any(lacks.values()):
                raise InputError(
                    f'observation="{self.observation}" is for one ball, of one size, and the UR5; got '
                    f'{", ".join(what for what, so in lacks.items() if so)}; observation="geometric" takes all'
                )
        if self.backend == "kinematic" and self.steps != SINGLE:
            raise InputError('backend="kinematic" is for steps="single": in small steps the dynamics decide')
        if self.backend == WARP and len(set(self.shapes)) > 1:
            raise InputError(f'backend="warp" is for objects of one shape, got shapes={shown(self.shapes)}')


def check_objects(
    arm: ArmDescription, sizes: Iterable[object], masses: Iterable[object], frictions: Iterable[object]
) -> None:
    """Check sizes [m], masses [kg] and coefficients of friction: the gripper must get around the objects."""
    gripper: Any = arm.gripper
    most = (gripper.opening - CLEARANCE) / 2
    for size in sizes:
        value = check_number("the object's size [m]", size, least=MIN_SIZE)
        if value > most:
            raise InputError(
                f"the object's size must be from {MIN_SIZE:g} to {most:g} m, got {value:g}: it is {2 * value:g} m "
                f"wide, and the fingers come open by {gripper.opening:g} m (stroke {gripper.stroke:g} m)"
            )
    for mass in masses:
        check_number("the object's mass [kg]", mass, least=MIN_MASS, most=MAX_MASS)
    for friction in frictions:
        check_number("the object's friction", friction, least=0.0, most=MAX_FRICTION)


def grasping_arm(arm: str | ArmDescription) -> ArmDescription:
    """Return an arm with a gripper, which is added to the flange if it has none; the same value each time."""
    return _with_gripper(get_arm(arm))


@lru_cache(maxsize=16)
def _with_gripper(found: ArmDescription) -> ArmDescription:
    if found.gripper is None:
        if FLANGE not in found.tips:
            raise InputError(
                f"grasping needs a gripper, or a flange {FLANGE!r} for one, as a UR has; arm {found.name!r} has none"
            )
        found = found.with_gripper()
    elif isinstance(found.gripper, JawGripper):
        check_known(f"tip of arm {found.name!r} between the jaws", found.gripper.tip, found.tips)
        found = replace(found, default_tip=found.gripper.tip)
    if not isinstance(found.workcell.goals, BoxRegion) or not any(
        box.name == "table" for box in found.workcell.obstacles
    ):
        raise InputError(f"objects lie on a table, in a BoxRegion; the work cell of arm {found.name!r} lacks them")
    if not hasattr(ArmKinematics.of(found, base="world"), "nearest_batch"):
        raise InputError(f"grasping needs an arm with a closed form, such as a UR; arm {found.name!r} has none")
    return found


def grasping_batch(
    arm: ArmDescription, count: int, options: Any, *, objects: int, threads: int, device: str | None
) -> Grasping:
    """Return so many simulated grippers, each with its free objects; a device is also that of Warp."""
    arms = BatchSimulation(
        arm,
        count,
        threads=threads,
        backend=options.backend,
        device=device if options.backend == WARP else None,  # else it is only where tensors are wanted
        objects=objects,
        drawn=drawn_of(options.randomise),
    )
    return Grasping(arms)


def table_of(boxes: Sequence[Box]) -> tuple[Box, float]:
    """Return the table among the boxes of a work cell, and the height of its top [m]."""
    table = next(box for box in boxes if box.name == "table")
    return table, table.position[2] + table.size[2] / 2


@lru_cache(maxsize=16)
def _at_table(arm: ArmDescription, shift: tuple[float, ...], radius: float) -> ArmDescription:
    """Return an arm whose table is moved [m], with objects of a radius [m] on it; the same value each time."""
    cell = arm.workcell
    boxes = tuple(
        replace(box, position=tuple((np.array(box.position) + shift).tolist())) if box.name == "table" else box
        for box in cell.obstacles
    )
    goals: Any = cell.goals
    (x0, x1), (y0, y1), (_, top) = goals.x, goals.y, table_of(boxes)
    goals = BoxRegion((x0 + shift[0], x1 + shift[0]), (y0 + shift[1], y1 + shift[1]), (top, top))
    return replace(arm, workcell=replace(cell, obstacles=boxes, goals=goals, ball_radius=radius))


def face_angle(turn: Floats) -> Floats:
    """Return the difference of an angle [rad] from the nearest quarter turn, in [-pi/4, pi/4)."""
    return np.asarray((turn + math.pi / 4) % (math.pi / 2) - math.pi / 4)


class LiftStart(NamedTuple):
    """Values that k episodes start with; None for those that are drawn.

    Attributes:
        places: Where objects lie [m], shape (k, 2).
        yaws: Turns about the vertical [rad], shape (k, 1).
        sizes, masses, frictions: [m], [kg] and coefficients, shapes (k, 1).
        shapes: Indices into `SHAPES`, shape (k, 1).
        views: Where the cameras saw the objects [m], shape (k, 3).
    """

    places: Floats | None = None
    yaws: Floats | None = None
    sizes: Floats | None = None
    masses: Floats | None = None
    frictions: Floats | None = None
    views: Floats | None = None
    shapes: NDArray[np.intp] | None = None


#: The options of `reset` that are numbers, and how many of them.
_NUMBERS = {"place": 2, "yaw": 1, "size": 1, "mass": 1, "friction": 1, "view": 3}


class LiftTask:
    """The task on one arm: meaning of actions, observations and starts, for one environment or thousands.

    Attributes:
        arm: With its gripper and the table where the options have it.
        kinematics: From the world to the arm's tip.
        region: Where objects lie; z is the height of the table's top.
        layout: Where things are in an observation; its goal block describes the object.
        size: Numbers of an observation.
        tip: Turns actions into postures where they change the tip; None where they change joints.
    """

    def __init__(self, options: LiftOptions) -> None:
        self.options = options
        self.arm = arm = _at_table(grasping_arm(options.arm), tuple(map(float, options.table)), max(options.sizes))
        table, _ = table_of(arm.workcell.obstacles)
        self.region: Any = arm.workcell.goals
        self._table = [(at - edge / 2, at + edge / 2) for at, edge in zip(table.position, table.size, strict=True)][:2]
        self.kinematics: Any = ArmKinematics.of(self.arm, base="world")
        self.home = np.array(arm.home)
        self.gripper: Any = arm.gripper
        self._half, self._middle = action_range(self.arm)
        joints = len(arm.joints)
        self.layout = Layout.of(goal=KIND_END, joints=joints)
        self.size = self.layout.size + 3 + 3 * options.clutter
        self.tip = tip_of(self.arm, options.control)

    @cached_property
    def checker(self) -> CollisionChecker:
        """The collision checker of the arm with its fingers open, without objects, with the option `margin`."""
        return CollisionChecker(self.kinematics, margin=self.options.margin)

    @property
    def action_space(self) -> spaces.Box:
        moved = len(self.home) if self.tip is None else self.tip.size
        return spaces.Box(-1.0, 1.0, (moved + 1,), np.float32)

    @property
    def observation_space(self) -> spaces.Space[Any]:
        """Observations of one environment, except pictures, shape (size,); with goals, those too."""
        lower, upper = joint_limits(self.arm)
        high = np.concatenate([
            3 * [GOAL_RANGE], [1.0], 4 * [1.0], upper + BEYOND_LIMIT, [CAMERA_RANGE], 3 * [2 * GOAL_RANGE],
            3 * self.options.clutter * [GOAL_RANGE],
        ])  # fmt: skip
        low, layout = -high, self.layout
        low[SIZE:KIND_END] = low[layout.gripper] = 0.0
        low[layout.q] = lower - BEYOND_LIMIT
        whole = spaces.Box(low, high, dtype=np.float64)
        goal = spaces.Box(0.0, GOAL_RANGE, (2,), np.float64)
        return goal_dict(whole, goal) if self.options.goal_env else whole

    def observation(
        self,
        seen: Floats,
        yaws: Floats,
        kinds: Objects,
        q: Floats,
        tips: Floats,
        openings: Floats,
        others: Floats | None,
    ) -> Floats:
        """Put observations together, shape (k, size); see the environment's table."""
        cube = kinds.shape == SHAPES.index(CUBE)
        outwards = np.arctan2(seen[:, 1], seen[:, 0])
        parts = [
            np.clip(np.nan_to_num(seen), -GOAL_RANGE, GOAL_RANGE),
            np.nan_to_num(np.where(cube, face_angle(yaws - outwards), 0.0))[:, None],
            kinds.size[:, None],
            kinds.shape[:, None] == np.arange(len(SHAPES)),
            seen_joints(self.arm, q),
            openings[:, None],
            np.clip(np.where(np.isfinite(seen), seen - tips, 0.0), -2 * GOAL_RANGE, 2 * GOAL_RANGE),
        ]
        return np.concatenate(parts if others is None else [*parts, np.clip(others, -GOAL_RANGE, GOAL_RANGE)], axis=1)

    def grasps(self, actions: Floats) -> tuple[Floats, Floats]:
        """Return postures [rad] and final openings [m] of actions of single steps."""
        return self._middle + self._half * actions[:, :-1], (1.0 + actions[:, -1]) / 2 * self.gripper.stroke

    def action_for(self, q: Floats, opening: float) -> Floats:
        return np.append((q - self._middle) / self._half, 2.0 * opening / self.gripper.stroke - 1.0)

    def poses(self, postures: Floats) -> Floats:
        """Return poses of the tips in the world for postures [rad], shape (k, n), bit for bit as for each alone."""
        T: Floats = self.kinematics.chain.fk(postures)
        return T

    def above(self, postures: Floats) -> Floats:
        """Return postures with the tip `LIFT` higher and turned alike; NaN where there are none."""
        T = self.poses(postures)
        T[:, 2, 3] += LIFT
        if self.options.backend == "kinematic":
            return np.asarray(self.kinematics.nearest_batch(T, postures).q)
        above = np.full_like(postures, np.nan)  # one by one: products of matrices depend on how many there are
        for row, pose, posture in zip(above, T, postures, strict=True):
            found = self.kinematics.nearest(pose, posture)
            if found.success:
                row[:] = found.q
        return above

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw `count` starts, shape (count, 9): place, yaw, shape, size, mass, friction, place of the other."""
        options = self.options
        places = self.region.sample(rng, count)[:, :2]
        yaws = rng.uniform(-math.pi, math.pi, count)
        shapes = np.array([SHAPES.index(name) for name in options.shapes])[
            rng.integers(len(options.shapes), size=count)
        ]
        numbers = [
            rng.uniform(min(ends), max(ends), count) for ends in (options.sizes, options.masses, options.frictions)
        ]
        others = self.region.sample(rng, count)[:, :2]
        for _ in range(DRAWS):
            close = np.linalg.norm(others - places, axis=1) < APART
            if not (options.clutter and close.any()):
                break
            others[close] = self.region.sample(rng, int(close.sum()))[:, :2]
        return np.column_stack([places, yaws, shapes, *numbers, others])

    def training_starts(self, rng: np.random.Generator, count: int, *, beyond: float) -> dict[str, Any]:
        """Draw options of `reset` for learners, places also up to `beyond` [m] outside the region."""
        rows = self.sample(rng, count)
        rows[:, :2] = self.region.wider(beyond).sample(rng, count)[:, :2]
        return {
            "place": rows[:, :2],
            "yaw": rows[:, 2],
            "shape": np.array(SHAPES)[rows[:, 3].astype(int)],
            "size": rows[:, 4],
        }

    def reset_options(self, options: Mapping[str, Any] | None, count: int | None) -> LiftStart:
        given = given_options(options, (*_NUMBERS, "shape"))
        shapes = given.pop("shape", None)
        for name in given:
            if given[name] is not None and _NUMBERS[name] == 1:
                values = as_floats(name, given[name])
                given[name] = values[..., None] if values.ndim == (count is not None) else values
        places, yaws, sizes, masses, frictions, views = option_rows(given, _NUMBERS, count)
        given_numbers = (() if values is None else values.flat for values in (sizes, masses, frictions))
        check_objects(self.arm, *given_numbers)
        if places is not None:
            self._check_places(places)
        return LiftStart(places, yaws, sizes, masses, frictions, views, self._shapes(shapes, count))

    def _check_places(self, places: Floats) -> None:
        (x0, x1), (y0, y1) = self._table
        off = ((places < (x0, y0)) | (places > (x1, y1))).any(axis=1)
        if off.any():
            x, y = places[off.argmax()]
            raise InputError(
                f"place must be on the table, x from {x0:g} to {x1:g} m and y from {y0:g} to {y1:g} m, got {x:g}, {y:g}"
            )

    def _shapes(self, given: Any, count: int | None) -> NDArray[np.intp] | None:
        if given is None:
            return None
        if not isinstance(given, str | Sequence | np.ndarray):
            raise InputError(f"shape must be a name, or a list of one for each environment, got {shown(given)}")
        names = [given] if isinstance(given, str) else list(given)
        names = names * (count or 1) if isinstance(given, str) else names
        if len(names) != (count or 1):
            raise InputError(f"shape must have a name for each of {count or 1} environments, got {len(names)}")
        for name in names:
            check_known("shape", str(name), self.options.shapes if self.options.backend == WARP else SHAPES)
        return np.array([[SHAPES.index(str(name))] for name in names])
