"""Reaching past obstacles: a UR5 goes to a ball on a table with boxes on it, from waypoint to waypoint.

The environment `kinreach/Obstacles-v0`. A move is straight in joint space and carried out by MuJoCo. The exact checker
judges dense samples of what the arm did.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import Floats, as_vector, check_count, check_flag, check_number, shown
from kinreach._registration import MAX_EPISODE_STEPS, OBSTACLES
from kinreach.envs._batch import Episodes, Flags, Ids, NativeVectorEnv, Outcome, texts
from kinreach.envs._lift.lift_task import table_of
from kinreach.envs._options import EnvOptions, about, option_values, with_options
from kinreach.envs._randomise import (
    DRAWN,
    WITH_CAMERAS,
    Bounds,
    Randomisation,
    Ranges,
    about_randomise,
    check_randomise,
    drawn_of,
)
from kinreach.envs._reach.env import PostureEnv
from kinreach.envs._reach.observers import DEPTH_RANGE, measured
from kinreach.envs._reach.reach_task import (
    GOAL_RANGE,
    TOOL_DOWN,
    ReachOptions,
    ReachTask,
    ReachVariant,
    action_space,
    check_actions,
    goal_block,
)
from kinreach.envs._reach.worlds import STATUS_OF_CAUSE, STATUSES, TargetStatus
from kinreach.envs._single import ONLY
from kinreach.errors import InputError
from kinreach.kinematics import CollisionChecker, URKinematics
from kinreach.kinematics.inside import MIN_MARGIN, PATH_MARGIN
from kinreach.robots import THESIS_ARM, ArmDescription, Box, get_arm
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import CAMERA, FrameRenderer, Scene, box_names, drawn_sizes, spare_boxes
from kinreach.thesis import REACHED_DISTANCE, REACHED_POSTURE_ERROR

Texts = NDArray[np.object_]

#: An action names a posture, all joints go there at once, and the episode goes on.
WAYPOINT = ReachVariant("waypoint", relative=False, scale=math.pi, two_phase=False, one_action=False)
#: Numbers of obstacles, one of them an episode.
CLUTTER, MAX_CLUTTER = (0, 4, 8, 16), 20
#: Edges of an obstacle across [m], and where its centre is on the table [m].
EDGE, X, Y = (0.04, 0.10), (0.20, 0.75), (-0.45, 0.45)
#: An obstacle is at least so far from the ball's centre [m].
FROM_BALL = 0.04
#: Samples of a motion that is judged: no joint moves farther from one to the next [rad].
DENSE = 0.002
#: So many of them are judged before it is looked whether one is impossible.
AT_ONCE = 32
#: A move in which no joint turns farther than this ends the episode [rad].
STANDING = 1e-3
#: So many scenes in a row may be without a goal that can be reached.
MAX_DRAWS = 1000
#: Status of a move that ends beside the goal.
MISSED = "missed"
#: What can be drawn: of the arm and its cameras, and how far obstacles are from where they are observed [m].
TO_DRAW: Bounds = {**WITH_CAMERAS, "obstacles": (-0.1, 0.1)}
#: Size of the picture of depths [px].
DEPTH_WIDTH, DEPTH_HEIGHT = 64, 48
#: Its name in an observation.
DEPTH = f"{CAMERA}_depth"
#: Terms of the reward.
TERMS = ("distance", "reached", "collision")
#: Bounds of what is observed of a box: whether there is one, centre and edges [m].
LOW, HIGH = (0.0, *3 * [-GOAL_RANGE], *3 * [0.0]), (1.0, *6 * [GOAL_RANGE])


@dataclass(frozen=True, kw_only=True)
class ObstaclesOptions(EnvOptions):
    """Options of `kinreach/Obstacles-v0`."""

    clutter: tuple[int, ...] = field(default=CLUTTER, metadata=about("numbers of obstacles, one of them an episode"))
    heights: tuple[float, float] = field(default=(0.1, 0.4), metadata=about("least and largest height of one [m]"))
    margin: float = field(
        default=PATH_MARGIN,
        metadata=about("distance that `accept`, `clearance` and `goal_postures` keep from everything [m]"),
    )
    boxes: bool = field(
        default=False,
        metadata=about("observe the obstacles too: 20 rows of seven numbers, zeros where there is none", flag=None),
    )
    depth: bool = field(
        default=False,
        metadata=about(f"observe a picture of depths too, {DEPTH_WIDTH} by {DEPTH_HEIGHT} pixels", flag=None),
    )
    randomise: Ranges | None = field(default=None, metadata=about_randomise(TO_DRAW))

    def __post_init__(self) -> None:
        super().__post_init__()
        for count in self.clutter:
            check_clutter(count)
        low, high = as_vector("heights [m]", self.heights, 2)
        if not 0.0 < low <= high <= 1.0:
            raise InputError(
                f"heights must be above 0 and at most 1 m, the smaller one first, got {shown(self.heights)}"
            )
        check_number("margin [m]", self.margin, least=MIN_MARGIN, most=0.05)
        check_flag("boxes", self.boxes)
        check_flag("depth", self.depth)
        check_randomise(self.randomise, bounds=TO_DRAW)
        if "obstacles" in (self.randomise or ()) and not self.boxes:
            raise InputError("randomise['obstacles'] displaces observed obstacles: use boxes=True")


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


class ObstaclesStart(NamedTuple):
    """Numbers of obstacles of k episodes, shape (k,); None where they are drawn."""

    clutter: NDArray[np.intp] | None = None


class Verdict(NamedTuple):
    """What k moves led to: whether the goal is reached, why they were impossible, how they ended, what was meant."""

    reached: Flags
    impossible: Flags
    reasons: Texts
    statuses: Texts
    targets: Floats


class DepthPictures:
    """Pictures of depths, taken in one scene for all environments by the camera that looks at arm and table.

    Attributes:
        space: Of a picture [m].
    """

    def __init__(self) -> None:
        self.space = spaces.Box(0.0, DEPTH_RANGE, (DEPTH_HEIGHT, DEPTH_WIDTH, 1), np.float32)
        self._simulation = ArmSimulation(THESIS_ARM, boxes=MAX_CLUTTER)
        self._renderer: FrameRenderer | None = None

    def take(self, postures: Floats, goals: Floats, obstacles: Sequence[tuple[Box, ...]]) -> NDArray[np.float32]:
        """Return the pictures of arms in postures (k, 6) [rad], with balls at (k, 3) [m] and obstacles each."""
        simulation, pictures = self._simulation, np.empty((len(postures), *self.space.shape), np.float32)
        if self._renderer is None:
            self._renderer = FrameRenderer(simulation.model, width=DEPTH_WIDTH, height=DEPTH_HEIGHT, shadows=False)
        limits = simulation.controller
        for picture, q, goal, boxes in zip(pictures, postures, goals, obstacles, strict=True):
            simulation.reset(np.clip(q, limits.lower, limits.upper))
            simulation.put_boxes(boxes)
            simulation.place_ball(goal)
            depth = self._renderer.depth(simulation.data, CAMERA)
            picture[:, :, 0] = np.minimum(depth, np.float32(DEPTH_RANGE))
        return pictures

    def close(self) -> None:
        """Free the graphics memory; the next picture would ask for it again."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class ObstaclesEpisodes(Episodes):
    """The episodes of a number of environments, each with a simulation of its own.

    Attributes:
        task: What actions and observations mean.
        kinematics: From the world to the tip.
        obstacles: Of each environment, without those of the work cell.
        directions: Where the tools are to point, straight down, shape (count, 3).
        q: Joint angles [rad], shape (count, 6).
    """

    def __init__(self, options: ObstaclesOptions, count: int) -> None:
        self.options, self.count, self.kinematics = options, count, _kinematics()
        self.task = task = ReachTask(ReachOptions(), WAYPOINT)
        self.action_space, numbers = action_space(task.arm), task.observation_space
        if options.boxes:
            seen: Any = task.observation_space
            low, high = (
                np.append(bound, np.tile(row, MAX_CLUTTER)) for bound, row in ((seen.low, LOW), (seen.high, HIGH))
            )
            numbers = spaces.Box(low, high, dtype=np.float64)
        self._pictures = DepthPictures() if options.depth else None
        self.observation_space: spaces.Space[Any] = numbers
        if self._pictures is not None:
            self.observation_space = spaces.Dict({"observation": numbers, DEPTH: self._pictures.space})
        self._boxes = np.zeros((count, MAX_CLUTTER, len(LOW)))
        self.obstacles: list[tuple[Box, ...]] = [() for _ in range(count)]
        self.directions = np.tile(TOOL_DOWN, (count, 1))
        self.goals, self.q = np.zeros((count, 3)), np.tile(task.home, (count, 1))
        self._rngs = [np.random.default_rng() for _ in range(count)]
        goal = task.layout.goal
        sizes = {"camera": goal.stop - goal.start, "obstacles": 3 * MAX_CLUTTER}
        self._drawn = Randomisation(options.randomise, count, None, sizes={**drawn_sizes(len(task.home)), **sizes})
        self._seen = np.zeros((count, 3))
        self._begun = np.zeros(count, dtype=np.bool_)
        self._simulations: list[ArmSimulation | None] = [None for _ in range(count)]
        self._observation = np.empty((count, task.layout.size))
        self._observation[:, task.layout.gripper] = task.gripper_opening
        self._length, self._time = np.zeros(count), np.zeros(count)
        self._tips, self._distance, self._posture_error = np.empty((count, 3)), np.empty(count), np.empty(count)

    def simulation(self, index: int, *, visual: bool = False) -> ArmSimulation:
        """Return the simulation of an environment, with visuals only if it is drawn before anything else needs it."""
        made = self._simulations[index]
        if made is None:
            drawn = drawn_of(self.options.randomise)
            made = ArmSimulation(THESIS_ARM, visual=visual, boxes=MAX_CLUTTER, drawn=drawn)
            self._simulations[index] = made
            self._follow(index)
        return made

    def renew(self, index: int, *, visual: bool) -> None:
        """Make the simulation of an environment anew, with or without visuals."""
        self._simulations[index] = None
        self.simulation(index, visual=visual)

    def _follow(self, index: int) -> None:
        """Put the simulation of an environment into the start of the episode, if there are both."""
        simulation = self._simulations[index]
        if simulation is None:
            return
        if self._begun[index] and simulation.drawn is not None:
            simulation.drawn.write(ONLY, self._drawn.of_arms([index]))
        simulation.reset()
        if self._begun[index]:
            simulation.put_boxes(self.obstacles[index])
            simulation.place_ball(self.goals[index])

    def checker(self, index: int, margin: float = 0.0) -> CollisionChecker:
        """Return the collision checker of an environment; without a margin [m] it is the exact verdict."""
        return _checker_among(self.obstacles[index], margin)

    def goal_postures(self, index: int) -> Floats:
        """Return the postures at the ball that keep the margin [rad], shape (k, 6): every branch, at eight turns."""
        clearance, found, home = self.checker(index, self.options.margin), [], self.task.home
        for turn in np.arange(8) * np.pi / 8:  # the two fingers are alike
            solutions = self.kinematics.axis_solutions(self.goals[index], TOOL_DOWN, seed=[*home[:-1], home[-1] + turn])
            found += [q for q in solutions.q if clearance.free(q)]
        return np.array(found).reshape(-1, len(home))

    def seed(self, index: int, rng: np.random.Generator) -> None:
        self._rngs[index] = rng
        self._drawn.seed(index, rng.spawn(1)[0])

    def check_start(self, options: Mapping[str, Any] | None, count: int | None) -> ObstaclesStart:
        return ObstaclesStart(*option_values(options, {"clutter": check_clutter}, count))

    def check_actions(self, actions: ArrayLike, count: int | None) -> Floats:
        return check_actions(actions, count)

    def begin(self, ids: Ids, start: ObstaclesStart = ObstaclesStart()) -> None:  # noqa: B008 (immutable)
        """Draw other scenes; the arms stand in their start posture."""
        home, drawn_too = self.task.home, self.options.randomise or ()
        self._drawn.begin(ids)
        for row, index in enumerate(ids):
            drawn = self._rngs[index].choice(self.options.clutter)
            count = int(drawn if start.clutter is None else start.clutter[row])
            for _ in range(MAX_DRAWS):
                self.obstacles[index], self.goals[index] = self.scene(self._rngs[index], count)
                if self.checker(index, self.options.margin).free(home) and len(self.goal_postures(index)):
                    break
            else:
                raise InputError(f"none of {MAX_DRAWS} scenes with {count} obstacles has a free goal; choose fewer")
            self.q[index], self._length[index], self._time[index], self._begun[index] = home, 0.0, 0.0, True
            self._boxes[index] = 0.0
            for row_of_box, box in zip(self._boxes[index], self.obstacles[index], strict=False):
                row_of_box[:] = 1.0, *box.position, *box.size
            if "obstacles" in drawn_too:
                off = self._drawn.values("obstacles", index).reshape(-1, 3)
                self._boxes[index, :count, 1:4] += off[:count]
            views = self._drawn.displaced([index], goal_block(self.task.arm, self.goals[[index]]))
            self._observation[index, self.task.layout.goal] = views[0]
            self._seen[index] = measured(self.task, views).seen[0] if "camera" in drawn_too else self.goals[index]
            self._measure(index)
            self._follow(index)

    def scene(self, rng: np.random.Generator, count: int) -> tuple[tuple[Box, ...], Floats]:
        """Draw a number of obstacles, and the ball [m], shape (3,)."""
        cell = self.task.arm.workcell
        _, top = table_of(cell.obstacles)
        goal = cell.draw_goals(rng, 1)[0]
        boxes: list[Box] = []
        while len(boxes) < count:
            x, y = rng.uniform(*X), rng.uniform(*Y)
            wide, deep, height = rng.uniform(*EDGE), rng.uniform(*EDGE), rng.uniform(*self.options.heights)
            beside = np.abs(goal[:2] - (x, y)) - (wide / 2, deep / 2)
            if np.linalg.norm(beside.clip(0.0)) >= FROM_BALL:
                boxes.append(Box(box_names(count)[len(boxes)], (wide, deep, height), (x, y, top + height / 2)))
        return tuple(boxes), goal

    def step(self, actions: Floats, acting: Flags | None = None) -> Outcome:
        """Go to postures, in all environments or where `acting` is True."""
        acting = np.ones(self.count, dtype=np.bool_) if acting is None else acting
        targets = np.where(acting[:, None], self.task.targets(self.q, actions), self.q)
        ends, statuses, reasons = np.abs(targets - self.q).max(axis=1) < STANDING, texts(self.count), texts(self.count)
        for index in np.flatnonzero(acting):
            statuses[index] = MISSED
            if not ends[index]:
                statuses[index], reasons[index] = self._move(index, targets[index])
                self._measure(index)
        impossible = reasons != ""
        near = (self._distance < REACHED_DISTANCE) & (self._posture_error < REACHED_POSTURE_ERROR)
        reached = acting & near & ~impossible
        statuses[reached] = str(STATUSES[TargetStatus.COMPLETED])
        verdict = Verdict(reached, impossible, reasons, statuses, targets)
        return self._outcome(verdict, reached | impossible | ends, collided=impossible).of(acting)

    def forfeit(self, reason: str) -> Outcome:
        """Return the verdict on agents that find no path: impossible, the arms stay, the episodes end."""
        everyone, word = np.ones(self.count, dtype=np.bool_), STATUSES[TargetStatus.FORFEITED]
        reasons, statuses = (np.full(self.count, text, dtype=object) for text in (reason, word))
        verdict = Verdict(~everyone, everyone, reasons, statuses, self.q.copy())
        return self._outcome(verdict, everyone, collided=~everyone)

    def _outcome(self, verdict: Verdict, ends: Flags, *, collided: Flags) -> Outcome:
        paid = -self._distance, verdict.reached.astype(float), np.where(collided, -1.0, 0.0)
        info = self._info(slice(None), verdict, dict(zip(TERMS, paid, strict=True)))
        return Outcome(paid[0] + paid[1] + paid[2], ends, np.zeros_like(ends), info)

    def _move(self, index: int, target: Floats) -> tuple[str, str]:
        """Move to a posture; return a status, and why it was impossible, if it was."""
        simulation, now = self.simulation(index), self.q[index].copy()
        taken, shown = [now], simulation.watch

        def watch() -> None:
            taken.append(simulation.q)
            if shown is not None:
                shown()

        simulation.watch = watch
        try:
            moved = simulation.move(target, two_phase=False)
        finally:
            simulation.watch = shown
        self._length[index] += float(np.linalg.norm(target - now))
        self._time[index] += moved.duration
        samples, checker = self._dense(np.array(taken)), self.checker(index)
        for begin in range(0, len(samples), AT_ONCE):  # what comes after the first impossible one does not count
            causes = checker.causes(samples[begin : begin + AT_ONCE])
            if causes.any():
                first = int((causes != 0).argmax())
                self.q[index] = stopped = samples[begin + first]
                return str(STATUSES[STATUS_OF_CAUSE[causes[first]]]), checker.reason(stopped)
        self.q[index] = moved.q
        return MISSED if moved.reached else moved.status.value, moved.reason

    def _dense(self, taken: Floats) -> Floats:
        """Sample the straight lines through postures (m, 6) every `DENSE`."""
        ways = np.concatenate([[0.0], np.abs(np.diff(taken, axis=0)).max(axis=1).cumsum()])
        at = np.linspace(0.0, ways[-1], 1 + int(np.ceil(ways[-1] / DENSE)))
        q = np.column_stack([np.interp(at, ways, angles) for angles in taken.T])
        # a joint that stops at its limit may be beyond it by a rounding error, which is not a collision
        return np.clip(q, self.kinematics.lower, self.kinematics.upper)

    def _measure(self, index: int) -> None:
        T = self.kinematics.fk(self.q[index])
        self._tips[index], self._distance[index] = T[:3, 3], np.linalg.norm(T[:3, 3] - self.goals[index])
        self._posture_error[index] = np.arctan2(np.linalg.norm(T[:2, 2]), -T[2, 2])

    def observe(self) -> Any:
        self._observation[:, self.task.layout.q] = self.q
        numbers = self._observation.copy()
        if self.options.boxes:
            numbers = np.column_stack([numbers, self._boxes.reshape(self.count, -1)])
        if self._pictures is None:
            return numbers
        return {"observation": numbers, DEPTH: self._pictures.take(self.q, self.goals, self.obstacles)}

    def close(self) -> None:
        if self._pictures is not None:
            self._pictures.close()

    def goal_info(self, rows: Any) -> dict[str, Any]:
        obstacles, drawn = [self.obstacles[index] for index in np.arange(self.count)[rows]], self._drawn.info(rows)
        if (off := f"{DRAWN}obstacles") in drawn:
            drawn[off] = drawn[off].reshape(-1, MAX_CLUTTER, 3)
        all_boxes = ([*own, *spare_boxes(MAX_CLUTTER)[len(own) :]] for own in obstacles)
        return {
            "goal": np.array(self.goals[rows]),
            "seen": np.array(self._seen[rows]),
            "clutter": np.array([len(own) for own in obstacles]),
            "obstacles": np.array([[(*box.position, *box.size) for box in boxes] for boxes in all_boxes]),
            **drawn,
        }

    def start_info(self, ids: Ids) -> dict[str, Any]:
        nothing, terms = np.zeros(len(ids), dtype=np.bool_), {name: np.zeros(len(ids)) for name in TERMS}
        verdict = Verdict(nothing, nothing, texts(len(ids)), texts(len(ids)), self.q[ids])
        return self._info(ids, verdict, terms)

    def _info(self, rows: Any, verdict: Verdict, terms: dict[str, Floats]) -> dict[str, Any]:
        """Return the `info` of some environments; the verdict and the terms have as many rows."""
        return {
            **self.goal_info(rows),
            "q": np.array(self.q[rows]),
            "tip": np.array(self._tips[rows]),
            "distance": np.array(self._distance[rows]),
            "posture_error": np.array(self._posture_error[rows]),
            "length": np.array(self._length[rows]),
            "move_s": np.array(self._time[rows]),
            "reached": verdict.reached,
            "is_success": verdict.reached,
            "impossible": verdict.impossible,
            "impossible_reason": verdict.reasons,
            "status": verdict.statuses,
            "target": verdict.targets,
            "reward_terms": terms,
        }


@with_options(ObstaclesOptions)
class ObstaclesEnv(PostureEnv):
    """A UR5 reaches a ball on a table with obstacles, from waypoint to waypoint.

    ## Description
    Boxes stand on the table of `kinreach/UR5SingleStep-v0`, at random. One action names a posture; the arm goes there
    straight in joint space, all joints at once, by MuJoCo's dynamics. Collisions are judged on the motion that the arm
    made, sampled every 0.002 rad, by `kinreach.kinematics.CollisionChecker` without a margin.

    ## Action Space
    `Box(-1, 1, (6,), float32)`: the posture to go to, each angle divided by pi. What is outside [-1, 1] is clipped.

    ## Observation Space
    `Box(13,), float32`, that of `kinreach/UR5SingleStep-v0`, without the obstacles. Planners use `info["obstacles"]`,
    or the attributes `obstacles`, `checker` and `clearance`.

    | Num | Observation | Unit |
    |-----|-------------|------|
    | 0 to 2 | goal in the front camera | m |
    | 3 to 5 | goal in the wrist camera | m |
    | 6 to 11 | joint angles | rad |
    | 12 | opening of the gripper | m |

    With `boxes=True` it is `Box(153,), float32`: 20 rows of seven numbers follow, 1 where there is an obstacle, its
    centre in the world and its edges [m]; rows without one are zeros.

    With `depth=True` it is a `Dict` of this, as `observation`, and of `overview_depth`, `Box(0, 10, (48, 64, 1),
    float32)`: depths along the axis of the camera `overview` [m], with the arm and the ball in the picture.

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
    """

    episodes_class = ObstaclesEpisodes

    @property
    def kinematics(self) -> URKinematics:
        return _kinematics()

    @property
    def obstacles(self) -> tuple[Box, ...]:
        """Those of this episode, without those of the work cell."""
        boxes: tuple[Box, ...] = self.episodes.obstacles[0]
        return boxes

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
        scene: Scene = self.episodes.simulation(0, visual=True)
        return scene

    @property
    def _dynamics(self) -> Scene:
        scene: Scene = self.episodes.simulation(0)
        return scene

    def _made_later(self) -> Iterator[None]:
        for visual in (False, True):
            self.episodes.renew(0, visual=visual)
            if self._picture is not None:
                self._picture.show(self.scene)
            yield

    def accept(self, q: ArrayLike) -> bool:
        """Return whether a posture [rad], shape (6,), keeps the margin from everything.

        Raises:
            InputError: Wrong shape, or not finite.
        """
        return self.clearance.free(q)

    def goal_postures(self) -> Floats:
        """Return the postures at the ball that keep the margin [rad], shape (k, 6): every branch, at eight turns."""
        postures: Floats = self.episodes.goal_postures(0)
        return postures


class ObstaclesVectorEnv(NativeVectorEnv):
    """A batch of `kinreach/Obstacles-v0`, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    Arguments, and how episodes start anew, are as of `NativeVectorEnv`.
    """

    registered_limit = MAX_EPISODE_STEPS[OBSTACLES]
    Options = ObstaclesOptions
    episodes_class = ObstaclesEpisodes
