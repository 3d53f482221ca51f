"""Episodes of a number of arms that grasp in step: the whole task except Gymnasium's interface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import Floats
from kinreach._rotations import turns_about_z
from kinreach.envs._batch import Episodes, Flags, Ids, Outcome, RowStreams, texts, told_terms
from kinreach.envs._goals import SPARSE, Told
from kinreach.envs._lift.lift_task import (
    CLOSING,
    HEIGHT,
    HOLD,
    MULTI,
    NEAR,
    LiftStart,
    LiftTask,
    face_angle,
)
from kinreach.envs._options import check_box_actions
from kinreach.envs._randomise import Randomisation
from kinreach.envs._reach.observers import CameraObserver, PixelObserver
from kinreach.envs._reach.reach_task import CAMERA, GOAL_RANGE
from kinreach.envs._small_steps import STEP_OPENING, STEP_S, SmallSteps
from kinreach.sim.inside import CUBE, SHAPES, Grasping, MoveStatus, Objects
from kinreach.vision.inside import GoalMeasurement

#: How far an episode got, and what stopped it there, by the number of the stage.
STARTED, REACHED, CLOSED, RAISED, LIFTED = range(5)
CAUSES = np.array(["reached", "closed", "slipped", "dropped", ""], dtype=object)
#: Terms of the reward.
TERMS = ("distance", "closed", "height", "lifted", "impossible")
#: Along the width of a finger the object's middle may be so far from the tip, and along the tool so far behind it or
#: ahead of it [m]: the pads are 22 mm wide and end 10 mm beyond the tip.
ACROSS, BEHIND, AHEAD = 0.008, 0.030, 0.006
#: Largest tilt of the tool, and largest angle between the fingers and the faces of a cube [rad].
TILT, TURN = 0.3, 0.3
#: How much narrower than the object the fingers want to be [m], and how much room they have beside it.
SQUEEZE, ROOM = 0.002, 0.003
#: Of success; more than holding the object all the time could bring.
LIFTED_REWARD = 20.0
#: Interval between two checks of a grasp while the object is to be held [s].
LOOK = 0.1
#: What is to be achieved: the object's height [m], and the time for which it is held up [s].
DESIRED = np.array([HEIGHT, HOLD])
ALL_DRAWN = LiftStart()
_SHAPES = np.array(SHAPES, dtype=object)


class LiftEpisodes(Episodes):
    """The state of the episodes and their rules, for one arm or thousands.

    Attributes:
        world: Simulates arms and objects; None where grasps are judged by geometry.
        goals: Where the objects' centres were when the cameras looked last, in the world [m], shape (count, 3).
        seen: Where the cameras saw them [m], shape (count, 3); NaN where none did.
        yaws: Turns of the objects about the vertical by then [rad], shape (count,).
        q: Postures of the arms [rad], shape (count, n).
    """

    def __init__(self, task: LiftTask, world: Grasping | None, count: int) -> None:
        self.task, self.options, self.world, self.count = task, task.options, world, count
        self.action_space = task.action_space
        self._streams = RowStreams(task.sample, count, size=9)
        self._sensors = [np.random.default_rng() for _ in range(count)]
        arms = None if world is None else world.drawn
        self._drawn = Randomisation(task.options.randomise, count, arms, sizes={"camera": 3})
        kind = task.options.observation
        self._camera = CameraObserver(task.arm, task.options) if kind == CAMERA else None
        self._pixels = PixelObserver(task.arm, task.options) if kind == "pixels" else None
        self.goals, self.seen = np.empty((count, 3)), np.empty((count, 3))
        self.yaws = np.empty(count)
        self.kinds = Objects(np.empty(count, dtype=np.intp), np.empty(count), np.empty(count), np.empty(count))
        self._others = np.empty((count, 3)) if task.options.clutter else None
        self.q, self._opening = np.empty((count, len(task.home))), np.empty(count)
        self._distance, self._clearance = np.empty(count), np.empty(count)
        self._gripped = np.empty(count, dtype=np.bool_)
        self._place, self._rotation = np.empty((count, 3)), np.empty((count, 3, 3))  # of the objects now
        self._stage, self._steps = np.empty(count, dtype=np.intp), np.empty(count, dtype=np.intp)
        self._lifted_for, self._time = np.empty(count), np.empty(count)
        self._reasons, self._status = np.empty(count, dtype=object), np.empty(count, dtype=object)
        self._achieved = np.empty((count, 2))
        self.small_steps = SmallSteps(task.arm, task.tip, count)

    def check_start(self, options: Mapping[str, Any] | None, count: int | None) -> LiftStart:
        return self.task.reset_options(options, count)

    def check_actions(self, actions: ArrayLike, count: int | None) -> Floats:
        return check_box_actions(actions, self.action_space.shape, count)

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Give an environment its own generators: of starts, and of the cameras' noise."""
        starts, self._sensors[index], drawn = rng.spawn(3)
        self._drawn.seed(index, drawn)
        self._streams.seed(index, starts)

    def begin(self, ids: Ids, start: LiftStart = ALL_DRAWN) -> None:
        rows = self._streams.draw(ids)
        given = (start.places, start.yaws, start.shapes, start.sizes, start.masses, start.frictions)
        for columns, values in zip((slice(0, 2), *(slice(k, k + 1) for k in range(2, 7))), given, strict=True):
            if values is not None:
                rows[:, columns] = values
        kinds = Objects(rows[:, 3].astype(np.intp), rows[:, 4], rows[:, 5], rows[:, 6])
        for mine, new in zip(self.kinds, kinds, strict=True):
            mine[ids] = new
        table = np.full((len(ids), 1), self.task.region.z[0])
        places, others = np.hstack([rows[:, :2], table]), np.hstack([rows[:, 7:9], table])
        self.q[ids] = self.task.home
        self._opening[ids] = self.task.gripper.opening
        self._drawn.begin(ids)
        if self.world is not None:
            self.world.reset(ids, self.q[ids])
            self.world.put(ids, 0, kinds, places, rows[:, 2])
            if self._others is not None:
                self.world.put(ids, 1, kinds, others, np.zeros(len(ids)))
        if self._others is not None:
            self._others[ids] = others + [0.0, 0.0, 1.0] * kinds.size[:, None]
        self.goals[ids] = places + [0.0, 0.0, 1.0] * kinds.size[:, None]
        self.yaws[ids] = rows[:, 2]
        self._place[ids], self._rotation[ids] = self.goals[ids], turns_about_z(rows[:, 2])[:, :3, :3]
        self._stage[ids], self._steps[ids] = STARTED, 0
        self._lifted_for[ids] = self._time[ids] = self._clearance[ids] = 0.0
        self._gripped[ids], self._reasons[ids], self._status[ids] = False, "", ""
        self._achieved[ids] = 0.0
        self.small_steps.begin(ids, self.q[ids])
        self._distance[ids] = np.linalg.norm(self._tips(ids) - self.goals[ids], axis=1)
        self._see(ids, start.views)

    def _see(self, ids: Ids, views: Floats | None = None) -> None:
        if views is not None:
            self.seen[ids] = np.where((views == 0.0).all(axis=1, keepdims=True), np.nan, views)
        elif self._camera is not None:
            self.seen[ids] = self._drawn.displaced(ids, self._camera.measure(self.goals[ids], ids, self._sensors).seen)
        else:
            self.seen[ids] = self._drawn.displaced(ids, self.goals[ids])

    def _tips(self, ids: Ids) -> Floats:
        return np.asarray(self.task.kinematics.chain.positions(self.q[ids]))

    @property
    def measurement(self) -> GoalMeasurement | None:  # type: ignore[override]
        """The cameras' last measurement of an object; None where nothing is rendered."""
        return None if self._camera is None else self._camera.last

    @property
    def observation_space(self) -> spaces.Space[Any]:
        return self.task.observation_space if self._pixels is None else self._pixels.space

    def observe(self) -> Any:
        """Return the observations, shape (count, size); with pixels or goals a dictionary of arrays with count rows."""
        everyone = np.arange(self.count)
        if self._pixels is not None:
            return self._pixels.measure(self.q, self.goals, self._sensors, self._opening)
        observation = self.task.observation(
            self.seen, self.yaws, self.kinds, self.q, self._tips(everyone), self._opening, self._others
        )
        if not self.options.goal_env:
            return observation
        desired = np.tile(DESIRED, (self.count, 1))
        return {"observation": observation, "achieved_goal": self._achieved.copy(), "desired_goal": desired}

    def goal_info(self, rows: Any) -> dict[str, Any]:
        kinds = self.kinds.of(rows)
        return {
            "goal": np.array(self.goals[rows]),
            "seen": np.array(self.seen[rows]),
            "view": np.nan_to_num(self.seen[rows]),
            "yaw": np.array(self.yaws[rows]),
            "position": np.array(self._place[rows]),
            "rotation": np.array(self._rotation[rows]),
            "shape": _SHAPES[kinds.shape],
            "size": np.array(kinds.size),
            "mass": np.array(kinds.mass),
            "friction": np.array(kinds.friction),
            **self._drawn.info(rows),
        }

    def start_info(self, ids: Ids) -> dict[str, Any]:
        nobody = np.zeros(len(ids), dtype=np.bool_)
        names = (SPARSE,) if self.options.reward == SPARSE else TERMS
        info = self._info(ids, nobody, {name: np.zeros(len(ids)) for name in names})
        return info | {"status": texts(len(ids)), "cause": texts(len(ids))}

    def step(self, actions: Floats, acting: Flags | None = None) -> Outcome:
        acting = np.ones(self.count, dtype=np.bool_) if acting is None else acting
        ids = np.flatnonzero(acting)
        if not len(ids):
            return self._outcome(acting, acting, acting)
        self._reasons[ids] = ""
        self._steps[ids] += 1
        if self.task.options.steps == MULTI:
            return self._small_step(ids, actions, acting)
        self._stage[ids] = STARTED
        self._status[ids] = ""
        self._clearance[ids], self._gripped[ids] = 0.0, False
        if self.world is None:
            self._judge_grasps(ids, actions)
        else:
            self._grasp(self.world, ids, *self.task.grasps(actions))
        over = acting & ((self._stage == LIFTED) | (self._steps >= self.task.options.attempts) | self._lost)
        again = np.flatnonzero(acting & ~over)
        outcome = self._outcome(acting, over, np.zeros_like(over))
        self._go_home(again)  # which looks again
        return replace(outcome, info={**outcome.info, **self.goal_info(slice(None))})

    @property
    def _lost(self) -> Flags:
        return np.asarray(self._status == "diverged")

    def forfeit(self, reason: str) -> Outcome:
        """Return the verdict on agents that find no action: impossible, the arms stay, the episodes end."""
        everyone = np.ones(self.count, dtype=np.bool_)
        self._stage[:], self._reasons[:], self._status[:] = STARTED, reason, "forfeited"
        return self._outcome(everyone, everyone, ~everyone)

    def _judge_grasps(self, ids: Ids, actions: Floats) -> None:
        """Take the possible postures, and judge by geometry whether fingers close around objects."""
        task = self.task
        q, opening = task.grasps(actions[ids])
        above = task.above(q)
        solved = np.isfinite(above).all(axis=1)
        bad = task.checker.causes(q) != 0
        bad[solved] |= task.checker.causes(above[solved]) != 0
        bad |= ~solved
        self._reasons[ids[bad]], self._status[ids[bad]] = "no posture, or a collision", "impossible"
        self.q[ids] = np.where(bad[:, None], self.q[ids], q)
        T = task.poses(q)
        self._distance[ids] = np.linalg.norm(T[:, :3, 3] - self.goals[ids], axis=1)
        kinds = self.kinds.of(ids)
        closed = ~bad & closes(T, opening, self.goals[ids], self.yaws[ids], kinds, sides=task.gripper.sides)
        self._gripped[ids] = closed
        self._stage[ids] = np.where(closed, LIFTED, np.where(~bad & (self._distance[ids] <= NEAR), REACHED, STARTED))

    def _grasp(self, world: Grasping, ids: Ids, postures: Floats, openings: Floats) -> None:
        """Go above, down, close, up, and hold; an arm whose move fails stays where it is.

        Args:
            world: Simulates arms and objects.
            ids: Whose grasps they are, shape (k,).
            postures: In which to close [rad], of all environments, shape (count, n).
            openings: To which the fingers close [m], likewise, shape (count,).
        """
        above = np.full_like(postures, np.nan)
        above[ids] = self.task.above(postures[ids])
        solved = np.isfinite(above[ids]).all(axis=1)
        missing = ids[~solved]
        self._reasons[missing], self._status[missing] = "out of reach: no posture above the grasp", "impossible"
        on = self._moved(world, self._moved(world, ids[solved], above), postures)
        self.q[:] = world.q
        self._distance[ids] = np.linalg.norm(self._tips(ids) - world.pose()[0][ids], axis=1)
        self._stage[on] = np.where(self._distance[on] <= NEAR, REACHED, STARTED)
        on = self._whole(world, on, lambda some: world.drive(some, openings[some], CLOSING), CLOSING)
        if len(on):
            self._stage[on] = np.where(world.grasp(on).gripped, CLOSED, self._stage[on])
        up = self._moved(world, on, above)
        self._hold(world, up)
        self.q[:] = world.q
        self._read(ids)

    def _moved(self, world: Grasping, ids: Ids, targets: Floats) -> Ids:
        """Move arms to their rows of targets [rad], shape (count, n); return those that attained them."""
        if not len(ids):
            return ids
        results = world.move(ids, targets[ids])
        for index, result in zip(ids, results, strict=True):
            self._time[index] += result.duration
            if not result.reached:
                self._reasons[index] = result.reason
                self._status[index] = "diverged" if result.status is MoveStatus.DIVERGED else "impossible"
        return ids[[result.reached for result in results]]

    def _whole(self, world: Grasping, ids: Ids, act: Callable[[Ids], object], seconds: float) -> Ids:
        """Simulate some; put back those whose simulation diverged, and return the others."""
        if not len(ids):
            return ids
        before = world.states(ids)
        act(ids)
        self._time[ids] += seconds
        return ids[~self._put_back(world, ids, before)]

    def _put_back(self, world: Grasping, ids: Ids, before: Any) -> Flags:
        """Put back those whose simulation diverged, and return which they are, shape (k,)."""
        lost = world.diverged(ids)
        if lost.any():
            world.put_back(ids[lost], before[lost])
            self._reasons[ids[lost]] = "diverged: the simulation became unstable"
            self._status[ids[lost]] = "diverged"
        return lost

    def _hold(self, world: Grasping, ids: Ids) -> None:
        for look in range(round(HOLD / LOOK) + 1):
            if look:
                ids = self._whole(world, ids, lambda some: world.rest(some, LOOK), LOOK)
            if not len(ids):
                return
            now = world.grasp(ids)
            ids = ids[now.held & (now.clearance >= HEIGHT)]
            self._stage[ids] = RAISED
        self._stage[ids] = LIFTED

    def _go_home(self, ids: Ids) -> None:
        world = self.world
        if world is None or not len(ids):
            self.q[ids] = self.task.home
            return
        world.drive(ids, np.full(len(ids), self.task.gripper.opening), CLOSING)
        up = self.task.above(self.q[ids])
        solved = np.isfinite(up).all(axis=1)
        if solved.any():
            world.move(ids[solved], up[solved])
        world.move(ids, np.tile(self.task.home, (len(ids), 1)))
        self._read(ids)
        self._look_at(ids)
        self._see(ids)

    def _look_at(self, ids: Ids) -> None:
        world: Any = self.world
        place, rotation = world.pose()
        self.goals[ids] = place[ids]
        self.yaws[ids] = np.arctan2(rotation[ids, 1, 0], rotation[ids, 0, 0])
        if self._others is not None:
            self._others[ids] = world.pose(1)[0][ids]

    def _read(self, ids: Ids) -> Any:
        """Read arms and grasps from the simulations."""
        world: Any = self.world
        now = world.grasp(ids)
        self.q[ids], self._opening[ids] = world.q[ids], now.opening
        self._gripped[ids], self._clearance[ids] = now.gripped, now.clearance
        self._place[ids], self._rotation[ids] = now.position, now.rotation
        return now

    def _small_step(self, ids: Ids, actions: Floats, acting: Flags) -> Outcome:
        task = self.task
        world: Any = self.world
        before = world.states(ids)
        q = self.small_steps.targets(ids, self.q[ids], actions[ids, :-1])
        opening = np.clip(self._opening[ids] + STEP_OPENING * actions[ids, -1], 0.0, task.gripper.stroke)
        world.steer(ids, q, opening, STEP_S)
        lost = self._put_back(world, ids, before)
        self._time[ids] += STEP_S
        now = self._read(ids)
        self._look_at(ids)
        if self._camera is None:  # from the start pose it looks once, before the episode
            self._see(ids)
        self._distance[ids] = np.linalg.norm(self._tips(ids) - self.goals[ids], axis=1)
        raised = now.held & (now.clearance >= HEIGHT)
        self._lifted_for[ids] = np.where(raised, self._lifted_for[ids] + STEP_S, 0.0)
        stage = np.select(
            [self._lifted_for[ids] >= HOLD, raised, now.gripped, self._distance[ids] <= NEAR],
            [LIFTED, RAISED, CLOSED, REACHED],
            STARTED,
        )
        self._stage[ids] = np.maximum(self._stage[ids], stage)
        hit = ids[now.collides & ~lost]
        self._reasons[hit] = self._status[hit] = "collision"
        done = self._ends(self._stage == LIFTED, self._status == "collision", self._lost)
        return self._outcome(acting, *(acting & flags for flags in done))

    def _ends(self, lifted: Flags, collides: Flags, lost: Flags) -> tuple[Flags, Flags]:
        """Return which episodes of small steps terminate and which are truncated, each of shape (k,).

        With -1 a step a collision that terminates would pay.
        """
        cut = lost | collides if self.options.reward == SPARSE else lost
        ended = lifted | (collides & ~cut)
        return ended, cut & ~ended

    def _outcome(self, acting: Flags, terminated: Flags, truncated: Flags) -> Outcome:
        lifted = acting & (self._stage == LIFTED) & (self._status != "collision")
        impossible = acting & (self._reasons != "")
        paid = self._paid(lifted, impossible, lambda: (self._distance, self._gripped, self._clearance))
        terms = {name: np.where(acting, term, 0.0) for name, term in paid.items()}
        reward = np.zeros(self.count)
        for term in terms.values():
            reward += term
        self._achieve(acting, lifted)
        words = np.where(self._status != "", self._status, np.where(lifted, "lifted", "missed"))
        cause = np.where(lifted, "", CAUSES[np.minimum(self._stage, RAISED)])
        cause = np.where(np.isnan(self.seen).any(axis=1), "seen", cause)
        info = self._info(slice(None), lifted, terms)
        info |= {"impossible": impossible, "status": words.astype(object), "cause": cause.astype(object)}
        return Outcome(reward, terminated, truncated, info)

    def _paid(
        self, lifted: Flags, impossible: Flags, grasps: Callable[[], tuple[Floats, Flags, Floats]]
    ) -> dict[str, Any]:
        """Return the terms of the reward, each of shape (k,).

        `grasps` gives distances of the tips from the objects [m], whether objects touch both fingers, and their
        heights [m].
        """
        if self.options.reward == SPARSE:
            return {SPARSE: np.where(lifted, 0.0, -1.0)}
        distance, gripped, clearance = grasps()
        weight = STEP_S if self.options.steps == MULTI else 1.0
        share = np.clip(clearance / HEIGHT, 0.0, 1.0) * gripped
        paid = (
            -weight * distance,
            weight * gripped,
            weight * share,
            LIFTED_REWARD * lifted,
            -1.0 * impossible,
        )
        return dict(zip(TERMS, paid, strict=True))

    def _achieve(self, acting: Flags, lifted: Flags) -> None:
        """Note how high the objects are held and for how long; what geometry accepts is as good as lifted."""
        time = np.where(self._status == "collision", 0.0, self._lifted_for)
        height = self._clearance * self._gripped
        if self.options.steps != MULTI:
            time, height = HOLD * lifted, np.where(lifted, np.maximum(height, HEIGHT), height)
        now = np.column_stack([height, time]).clip(0.0, GOAL_RANGE)
        self._achieved[acting] = now[acting]

    def judge(self, achieved: Floats, desired: Floats, told: Told) -> Outcome:
        """Return what transitions with these goals, shape (k, 2), lead to; its `info` is empty.

        A goal is reached by an object that is held as high and for as long. Where `info` does not say so, no action was
        impossible, and no simulation diverged.
        """
        lifted: Flags = np.all(achieved >= desired, axis=1)
        impossible = told.get("impossible", False).astype(np.bool_)
        lost = told.get("status", "") == "diverged"
        reward = np.zeros(len(lifted))

        def grasps() -> tuple[Floats, Flags, Floats]:
            return told.need("distance"), told.need("held"), told.need("clearance")

        for term in self._paid(lifted, impossible, grasps).values():
            reward += term
        if self.options.steps == MULTI:
            return Outcome(reward, *self._ends(lifted, impossible & ~lost, lost), {})
        ended = lifted | lost | (told.get("attempts", 1) >= self.options.attempts)
        return Outcome(reward, ended, np.zeros_like(ended), {})

    def _info(self, rows: Any, lifted: Flags, terms: dict[str, Floats]) -> dict[str, Any]:
        """Return the `info` of some arms, whose results have as many rows, without what an action led to."""
        ids = np.arange(self.count)[rows]
        return {
            **self.small_steps.info(rows),
            **self.goal_info(rows),
            "q": np.array(self.q[rows]),
            "tip": self._tips(ids),
            "distance": np.array(self._distance[rows]),
            "posture_error": self._misalignment(ids),
            "held": np.array(self._gripped[rows]),
            "clearance": np.array(self._clearance[rows]),
            "opening": np.array(self._opening[rows]),
            "reached": lifted,
            "is_success": lifted,
            "impossible": np.zeros(len(ids), dtype=np.bool_),
            "impossible_reason": np.array(self._reasons[rows]),
            "status": np.array(self._status[rows]),
            "cause": texts(len(ids)),
            "move_s": np.array(self._time[rows]),
            "attempts": np.array(self._steps[rows]),
            **told_terms(terms),
        }

    def _misalignment(self, ids: Ids) -> Floats:
        """Angle between tool and vertical, and of the fingers to the nearest faces of a cube [rad], summed."""
        axes = self.task.poses(self.q[ids])[:, :3, :3]
        tilt = np.arccos(np.clip(-axes[:, 2, 2], -1.0, 1.0))
        off = np.abs(face_angle(np.arctan2(axes[:, 1, 1], axes[:, 0, 1]) - self.yaws[ids]))
        return np.asarray(tilt + np.where(self.kinds.shape[ids] == SHAPES.index(CUBE), off, 0.0))

    def close(self) -> None:
        for observer in (self._camera, self._pixels):
            if observer is not None:
                observer.close()


def closes(
    T: Floats, openings: Floats, places: Floats, yaws: Floats, kinds: Objects, *, sides: tuple[float, float]
) -> NDArray[np.bool_]:
    """Return which of k grasps hold what they are to hold, by geometry: no contact forces, nothing moves.

    Args:
        T: Tips in the world, shape (k, 4, 4); z points ahead, the fingers move along y.
        openings: To which they close [m], shape (k,).
        places: Middles of the objects in the world [m], shape (k, 3).
        yaws: Their turns about the vertical [rad], shape (k,).
        kinds: What they are.
        sides: How far the fingers are from the tip before, along its y axis and against it [m].
    """
    x, y, z = np.einsum("kji,kj->ik", T[:, :3, :3], places - T[:, :3, 3])
    turned = face_angle(np.arctan2(T[:, 1, 1], T[:, 0, 1]) - yaws)
    cube = kinds.shape == SHAPES.index(CUBE)
    half = kinds.size * np.where(cube, np.abs(np.cos(turned)) + np.abs(np.sin(turned)), 1.0)
    around = (y + half <= sides[0] - ROOM) & (half - y <= sides[1] - ROOM)
    straight = (T[:, 2, 2] <= -np.cos(TILT)) & (~cube | (np.abs(turned) <= TURN))
    between = (np.abs(x) <= ACROSS) & (z >= -np.minimum(BEHIND, kinds.size)) & (z <= AHEAD)
    return np.asarray(around & straight & between & (openings <= 2 * kinds.size - SQUEEZE))
