"""Reaching past obstacles: a UR5 goes to a ball on a table with boxes on it, from waypoint to waypoint.

The environment `kinreach/Obstacles-v0`. A move is straight in joint space and carried out by MuJoCo. The exact checker
judges dense samples of what the arm did.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from kinreach._checks import Floats, as_vector, check_count, check_number, shown
from kinreach.envs._options import (
    about,
    check_not_over,
    check_seed,
    check_started,
    given_options,
    options_from,
    with_options,
)
from kinreach.envs._reach.reach_task import (
    TOOL_DOWN,
    UR5_LAYOUT,
    action_range,
    action_space,
    check_actions,
    goal_block,
    observation_space,
    tool_goal,
)
from kinreach.envs._reach.worlds import STATUS_OF_CAUSE, STATUSES, Status
from kinreach.envs._single import WithModel
from kinreach.errors import InputError
from kinreach.kinematics import AxisGoal, CollisionChecker, URKinematics
from kinreach.kinematics.inside import MIN_MARGIN, PATH_MARGIN
from kinreach.robots import THESIS_ARM, ArmDescription, Box, get_arm
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import Scene, box_names, spare_boxes
from kinreach.thesis import REACHED_DISTANCE, REACHED_POSTURE_ERROR

#: Numbers of obstacles, one of them an episode.
CLUTTER, MAX_CLUTTER = (0, 4, 8, 16), 20
#: Edges of an obstacle across [m], and where its centre is on the table [m].
EDGE, X, Y = (0.04, 0.10), (0.20, 0.75), (-0.45, 0.45)
#: An obstacle is at least so far from the ball's centre [m].
FROM_BALL = 0.04
#: Samples of a motion that is judged: no joint moves farther from one to the next [rad].
DENSE = 0.002
#: A move in which no joint turns farther than this ends the episode [rad].
STANDING = 1e-3
#: So many scenes in a row may be without a goal that can be reached.
MAX_DRAWS = 1000
#: Status of a move that ends beside the goal.
MISSED = "missed"
#: Terms of the reward.
TERMS = ("distance", "reached", "collision")


@dataclass(frozen=True, kw_only=True)
class ObstaclesOptions:
    """Options of `kinreach/Obstacles-v0`."""

    clutter: tuple[int, ...] = field(default=CLUTTER, metadata=about("numbers of obstacles, one of them an episode"))
    heights: tuple[float, float] = field(default=(0.1, 0.4), metadata=about("least and largest height of one [m]"))
    margin: float = field(
        default=PATH_MARGIN,
        metadata=about("distance that `accept`, `clearance` and `goal_postures` keep from everything [m]"),
    )

    def __post_init__(self) -> None:
        given: Any = self.clutter
        if isinstance(given, str) or not isinstance(given, Sequence) or not given:
            raise InputError(f"clutter must be a list of at least one number, got {shown(given)}")
        for count in given:
            check_clutter(count)
        low, high = as_vector("heights [m]", self.heights, 2)
        if not 0.0 < low <= high <= 1.0:
            raise InputError(
                f"heights must be above 0 and at most 1 m, the smaller one first, got {shown(self.heights)}"
            )
        check_number("margin [m]", self.margin, least=MIN_MARGIN, most=0.05)


def check_clutter(count: object) -> int:
    return check_count("clutter", count, least=0, most=MAX_CLUTTER)


@cache
def _kinematics() -> URKinematics:
    return URKinematics(THESIS_ARM, tip="tcp", base="world")


@lru_cache(maxsize=4)
def _arm_among(obstacles: tuple[Box, ...]) -> ArmDescription:
    """Return the UR5 with more obstacles on its table."""
    arm = get_arm(THESIS_ARM)
    return replace(arm, workcell=replace(arm.workcell, obstacles=(*arm.workcell.obstacles, *obstacles)))


@lru_cache(maxsize=32)
def _checker_among(obstacles: tuple[Box, ...], margin: float) -> CollisionChecker:
    around = (*get_arm(THESIS_ARM).workcell.obstacles, *obstacles)
    return CollisionChecker(_kinematics(), obstacles=around, margin=margin)


def _verdict(
    reached: bool, impossible: bool, reason: str, status: str, target: Floats, paid: Sequence[float]
) -> dict[str, Any]:
    """Return what a move led to, as entries of `info`; `paid` are the rewards of `TERMS`."""
    return {
        "reached": reached,
        "is_success": reached,
        "impossible": impossible,
        "impossible_reason": reason,
        "status": status,
        "target": target,
        "reward_terms": dict(zip(TERMS, paid, strict=True)),
    }


@with_options(ObstaclesOptions)
class ObstaclesEnv(WithModel, gym.Env[Any, Any]):
    """A UR5 reaches a ball on a table with obstacles, from waypoint to waypoint.

    ## Description
    Boxes stand on the table of `kinreach/UR5SingleStep-v0`, at random. One action names a posture; the arm goes there
    straight in joint space, all joints at once, by MuJoCo's dynamics. Collisions are judged on the motion that the arm
    made, sampled every 0.002 rad, by `kinreach.kinematics.CollisionChecker` without a margin.

    ## Action Space
    `Box(-1, 1, (6,), float32)`: the posture to go to, each angle divided by pi. What is outside [-1, 1] is clipped.

    ## Observation Space
    `Box(13,), float64`, that of `kinreach/UR5SingleStep-v0`, without the obstacles. Planners use `info["obstacles"]`,
    or the attributes `obstacles`, `checker` and `clearance`.

    | Num | Observation | Unit |
    |-----|-------------|------|
    | 0 to 2 | goal in the front camera | m |
    | 3 to 5 | goal in the wrist camera | m |
    | 6 to 11 | joint angles | rad |
    | 12 | opening of the gripper | m |

    ## Rewards
    Minus the distance from the tip to the ball [m], 1 more where the goal is reached, and 1 less for a collision.
    `info["reward_terms"]` has the terms `distance`, `reached` and `collision`.

    ## Starting State
    The arm stands in its start posture. The ball is uniform on the table area. Obstacles are boxes of 4 to 10 cm by
    4 to 10 cm, with a height within `heights`. A scene is drawn again if the start posture is nearer to something than
    the margin, or if every posture at the ball with the tool down is. Whether a free way leads there is not checked.
    `reset(options={"clutter": count})` sets the number of obstacles.

    ## Episode End
    The episode terminates when the goal is reached (the tip within 10 mm of the ball's centre, the tool within 0.15 rad
    of straight down), after a collision, and when the arm is sent to where it stands. Gymnasium
    truncates it after 100 moves (`max_episode_steps`).

    ## Info
    `reset` and `step` give the same entries, each of one type and shape. After a reset `reached` and `impossible`
    are False, `impossible_reason` and `status` are empty, rewards are 0, and the target is where the arm stands.

    | Key | Value |
    |-----|-------|
    | `goal`, `seen` | where the ball is [m] |
    | `q`, `tip` | joint angles [rad], after a collision the first that collide; tip [m] |
    | `distance`, `posture_error` | from the tip to the ball [m]; angle between the tool and straight down [rad] |
    | `clutter`, `obstacles` | how many; centre and edges of each [m], shape (20, 6), the spare ones far below |
    | `length`, `move_s` | of the way so far, the Euclidean norm over joints [rad]; simulated time [s] |
    | `reached`, `is_success` | the goal is reached |
    | `impossible` | whether the arm touched something or was held off |
    | `impossible_reason` | what it touched, such as `wrist_1_link - box 3`; else empty |
    | `status`, `target` | how the move ended; the posture that the action meant [rad] |
    | `reward_terms` | terms of the reward |

    ## Arguments

    <table of the options>

    ## Version History
    * v0: initial version

    Attributes:
        options: As given.
        kinematics: From the world to the tip.
        obstacles: Of this episode, without those of the work cell.
    """

    def __init__(self, **options: Any) -> None:
        self.options = options_from(ObstaclesOptions, options)
        arm = get_arm(THESIS_ARM)
        self.kinematics = _kinematics()
        self.action_space = action_space(arm)
        self.observation_space: spaces.Box = observation_space(arm)
        self.obstacles: tuple[Box, ...] = ()
        self._home = np.array(arm.home)
        gripper: Any = arm.gripper
        self._opening = gripper.opening
        self._started = self._over = False
        self._simulation: ArmSimulation | None = None

    @property
    def arm(self) -> ArmDescription:
        """The arm, in its work cell with the obstacles of this episode."""
        return _arm_among(self.obstacles)

    @property
    def checker(self) -> CollisionChecker:
        """The exact verdict on collisions."""
        return _checker_among(self.obstacles, 0.0)

    @property
    def clearance(self) -> CollisionChecker:
        """Collision checks with the margin, for planners."""
        return _checker_among(self.obstacles, self.options.margin)

    @property
    def scene(self) -> Scene:
        """The simulation that is drawn; it looks good if it is asked for before the first move."""
        return self._moving(visual=True)

    @property
    def _dynamics(self) -> Scene:
        return self._moving(visual=False)

    def _moving(self, *, visual: bool) -> ArmSimulation:
        """The simulation, with visuals only if it is drawn before anything else needs it."""
        if self._simulation is None:
            self._simulation = ArmSimulation(THESIS_ARM, visual=visual, boxes=MAX_CLUTTER)
            self._follow(self._simulation)
        return self._simulation

    def _follow(self, simulation: ArmSimulation) -> None:
        """Put a simulation into the start of the episode, if there is one."""
        simulation.reset()
        if self._started:
            simulation.put_boxes(self.obstacles)
            simulation.place_ball(self._goal)

    @property
    def home(self) -> Floats:
        """The start posture [rad], shape (6,)."""
        return self._home.copy()

    def accept(self, q: ArrayLike) -> bool:
        """Return whether a posture [rad], shape (6,), keeps the margin from everything.

        Raises:
            InputError: Wrong shape, or not finite.
        """
        return self.clearance.free(q)

    def posture_for(self, action: ArrayLike) -> Floats:
        """Return the posture [rad], shape (6,), that an action asks for.

        Raises:
            InputError: Wrong shape, or not finite.
        """
        half, middle = action_range(get_arm(THESIS_ARM))
        return np.asarray(half * check_actions(action, None) + middle)

    def action_for(self, q: ArrayLike) -> Floats:
        """Return the action that asks for a posture [rad], shape (6,).

        Raises:
            InputError: Wrong shape, or not finite.
        """
        half, middle = action_range(get_arm(THESIS_ARM))
        return np.asarray((as_vector("q", q, len(half)) - middle) / half)

    def ik_goal(self, position: ArrayLike) -> AxisGoal:
        """Return the goal of a solver: the tip at a point of the world [m], the tool down.

        Raises:
            InputError: Wrong shape, or not finite.
        """
        return tool_goal(get_arm(THESIS_ARM), position)  # type: ignore[return-value]

    def waypoints_to(self, q: Floats, target: Floats) -> list[Floats]:
        """Return the postures that a move passes [rad]: only the target."""
        return [target]

    def goal_postures(self) -> Floats:
        """Return the postures at the ball that keep the margin [rad], shape (k, 6): every branch, at eight turns."""
        clearance, found = self.clearance, []
        for turn in np.arange(8) * np.pi / 8:  # the two fingers are alike
            seed = [*self._home[:-1], self._home[-1] + turn]
            solutions = self.kinematics.axis_solutions(self._goal, TOOL_DOWN, seed=seed)
            found += [q for q in solutions.q if clearance.free(q)]
        return np.array(found).reshape(-1, len(self._home))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Draw another scene; the arm stands in its start posture.

        Args:
            seed: Of the ball and the obstacles.
            options: `"clutter"`: the number of obstacles, instead of a drawn one.

        Raises:
            InputError: An invalid seed, an unknown option, or a number of obstacles that is not from 0 to 20.
        """
        seed, given = check_seed(seed), given_options(options, ("clutter",))
        super().reset(seed=seed)
        drawn = int(self.np_random.choice(self.options.clutter))
        count = check_clutter(given.get("clutter", drawn))
        for _ in range(MAX_DRAWS):
            self.obstacles, self._goal = self._scene(count)
            if self.clearance.free(self._home) and len(self.goal_postures()):
                break
        else:
            raise InputError(f"none of {MAX_DRAWS} scenes with {count} obstacles has a free goal; choose fewer")
        self._q, self._length, self._time = self._home.copy(), 0.0, 0.0
        self._started, self._over = True, False
        if self._simulation is not None:
            self._follow(self._simulation)
        unknown = _verdict(False, False, "", "", self._q.copy(), len(TERMS) * (0.0,))
        return self._observe(), {**self._state(), **unknown}

    def _scene(self, count: int) -> tuple[tuple[Box, ...], Floats]:
        rng, cell = self.np_random, get_arm(THESIS_ARM).workcell
        table = next(box for box in cell.obstacles if box.name == "table")
        top = table.position[2] + table.size[2] / 2
        goal = cell.draw_goals(rng, 1)[0]
        boxes: list[Box] = []
        while len(boxes) < count:
            x, y = rng.uniform(*X), rng.uniform(*Y)
            wide, deep, height = rng.uniform(*EDGE), rng.uniform(*EDGE), rng.uniform(*self.options.heights)
            beside = np.abs(goal[:2] - (x, y)) - (wide / 2, deep / 2)
            if np.linalg.norm(beside.clip(0.0)) >= FROM_BALL:
                boxes.append(Box(box_names(count)[len(boxes)], (wide, deep, height), (x, y, top + height / 2)))
        return tuple(boxes), goal

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Go to a posture.

        Raises:
            InputError: Wrong shape, a value that is not finite, or a step before the first reset or after the last.
        """
        check_started(self._started)
        check_not_over(self._over)
        target = self.posture_for(action)
        way = float(np.abs(target - self._q).max())
        status, reason = (MISSED, "") if way < STANDING else self._move(target)
        state = self._state()
        near = state["distance"] < REACHED_DISTANCE and state["posture_error"] < REACHED_POSTURE_ERROR
        reached = near and not reason
        paid = -state["distance"], float(reached), -float(bool(reason))
        self._over = reached or bool(reason) or way < STANDING
        verdict = _verdict(reached, bool(reason), reason, "completed" if reached else status, target, paid)
        return self._observe(), sum(paid), self._over, False, {**state, **verdict}

    def forfeit(self, reason: str) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """End the episode of an agent that finds no path; the arm stays where it is.

        Args:
            reason: Why, for `info["impossible_reason"]`.

        Returns:
            As `step`.
        """
        check_started(self._started)
        state, self._over = self._state(), True
        paid = -state["distance"], 0.0, 0.0
        verdict = _verdict(False, True, str(reason), str(STATUSES[Status.FORFEITED]), self._q.copy(), paid)
        return self._observe(), sum(paid), True, False, {**state, **verdict}

    def _move(self, target: Floats) -> tuple[str, str]:
        """Move to a posture; return a status, and why it was impossible, if it was."""
        simulation = self._moving(visual=False)
        taken, shown = [self._q], simulation.watch

        def watch() -> None:
            taken.append(simulation.q)
            if shown is not None:
                shown()

        simulation.watch = watch
        try:
            moved = simulation.move(target, two_phase=False)
        finally:
            simulation.watch = shown
        self._length += float(np.linalg.norm(target - self._q))
        self._time += moved.duration
        samples = self._dense(np.array(taken))
        causes = self.checker.causes(samples)
        if causes.any():
            first = int((causes != 0).argmax())
            self._q = samples[first]
            return str(STATUSES[STATUS_OF_CAUSE[causes[first]]]), self.checker.reason(self._q)
        self._q = moved.q
        return MISSED if moved.reached else moved.status.value, moved.reason

    def _dense(self, taken: Floats) -> Floats:
        """Sample the straight lines through postures (m, 6) every `DENSE`."""
        ways = np.concatenate([[0.0], np.abs(np.diff(taken, axis=0)).max(axis=1).cumsum()])
        at = np.linspace(0.0, ways[-1], 1 + int(np.ceil(ways[-1] / DENSE)))
        q = np.column_stack([np.interp(at, ways, angles) for angles in taken.T])
        # a joint that stops at its limit may be beyond it by a rounding error, which is not a collision
        return np.clip(q, self.kinematics.lower, self.kinematics.upper)

    def _observe(self) -> Floats:
        observation = np.empty(UR5_LAYOUT.size)
        observation[UR5_LAYOUT.goal] = goal_block(get_arm(THESIS_ARM), self._goal[None])[0]
        observation[UR5_LAYOUT.q] = self._q
        observation[UR5_LAYOUT.gripper] = self._opening
        return observation

    def _state(self) -> dict[str, Any]:
        T = self.kinematics.fk(self._q)
        boxes = [*self.obstacles, *spare_boxes(MAX_CLUTTER)[len(self.obstacles) :]]
        return {
            "goal": self._goal.copy(),
            "seen": self._goal.copy(),
            "q": self._q.copy(),
            "tip": T[:3, 3].copy(),
            "distance": float(np.linalg.norm(T[:3, 3] - self._goal)),
            "posture_error": float(np.arctan2(np.linalg.norm(T[:2, 2]), -T[2, 2])),
            "clutter": len(self.obstacles),
            "obstacles": np.array([(*box.position, *box.size) for box in boxes]),
            "length": self._length,
            "move_s": self._time,
        }
