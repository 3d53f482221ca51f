"""Episodes of a number of arms in step: the whole task except Gymnasium's interface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import Floats
from kinreach._tensors import copied, on_device, on_host
from kinreach.envs._batch import Episodes, Outcome, texts, told_terms
from kinreach.envs._goals import Told
from kinreach.envs._options import in_dtype
from kinreach.envs._randomise import Randomisation
from kinreach.envs._reach.observers import PixelObserver, goal_observer, measured
from kinreach.envs._reach.reach_task import (
    CAMERA_RANGE,
    IMAGE,
    TOOL_DOWN,
    ReachReset,
    ReachTask,
    check_actions,
    distance_between,
    held_in_limits,
    seen_joints,
)
from kinreach.envs._reach.rewards import Score, term_names
from kinreach.envs._reach.worlds import STATUSES, Executed, Ids, ReachWorld, TargetStatus
from kinreach.vision.inside import GoalMeasurement, in_image

Flags = NDArray[np.bool_]

#: `impossible_reason` where the world gives none.
_PHRASES = np.where(STATUSES == "completed", "", STATUSES)


class ReachEpisodes(Episodes):
    """The state of the episodes and their rules, for one arm or thousands.

    Attributes:
        goals: Where the balls are in the world [m], shape (count, 3).
        found: Which of the cameras found them, shape (count, cameras); one column for an arm without cameras.
        seen: Where they seem to be in the world [m], shape (count, 3). New episodes have new arrays, these stay as
            they are.
        directions: Where the tools are to point, unit vectors in the world, shape (count, 3).
    """

    def __init__(self, task: ReachTask, world: ReachWorld) -> None:
        count = world.count
        self.goals = self.seen = np.empty((count, 3))
        self.found = np.empty((count, max(1, len(task.arm.goal_cameras))), dtype=np.bool_)
        self.directions = np.tile(TOOL_DOWN, (count, 1))
        self.task, self.options = task, task.options
        self.world = world
        self.action_space = task.action_space
        self._observer = goal_observer(task)
        self._pixels = PixelObserver(task.arm, task.options) if task.options.observation == "pixels" else None
        self._pictures: dict[str, NDArray[Any]] = {}
        self._changed = np.empty(count, dtype=np.bool_)  # since the pictures were taken
        self._streams = task.streams(count)
        coordinates = task.layout.goal.stop - task.layout.goal.start
        self._drawn = Randomisation(self.options.randomise, count, world.drawn, sizes={"camera": coordinates})
        self._sensors = [np.random.default_rng() for _ in range(count)]
        self._observation = np.empty((count, task.layout.size))
        self._observation[:, task.layout.gripper] = task.gripper_opening
        self._move_time = np.empty(count)
        self._held = np.empty((count, 3, 3))  # rotations of the tips in which episodes began
        self._terms: tuple[str, ...] | None = None  # names of the reward's
        if self.options.goal_env:
            shape = (count, *task.observation_space["desired_goal"].shape)  # type: ignore[index]
            self._achieved, self._desired = np.empty(shape), np.empty(shape)

    @property
    def q(self) -> Floats:
        """Postures of the arms [rad], shape (count, n)."""
        return self.world.q

    def check_start(self, options: Mapping[str, Any] | None, count: int | None) -> ReachReset:
        return self.task.reset_options(options, count)

    def check_actions(self, actions: ArrayLike, count: int | None) -> Floats:
        return check_actions(actions, count, *self.action_space.shape)

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Give an arm its own generators, for goals and for noise."""
        goal_rng, self._sensors[index], drawn_rng = rng.spawn(3)
        self._drawn.seed(index, drawn_rng)
        self._streams.seed(index, goal_rng)

    def begin(self, ids: Ids, start: ReachReset = ReachReset()) -> None:  # noqa: B008 (immutable)
        """Start new episodes with given values or drawn ones; goals are measured once, from the start pose."""
        goals, start = self.task.completed(start, self._streams, ids)
        self._drawn.begin(ids)
        self.world.reset(ids, goals, start.q)
        if start.views is None:
            views, found, seen = self._observer.measure(goals, ids, self._sensors)
            if "camera" in (self.options.randomise or ()):
                views, found, seen = measured(self.task, self._drawn.displaced(ids, views))
        else:
            views, found, seen = measured(self.task, start.views)
        if len(ids) == self.world.count:
            self.goals, self.found, self.seen = goals, found, seen
            rows: Ids | slice = slice(None)  # much faster than as many indices
        else:
            rows, self.goals, self.found, self.seen = ids, self.goals.copy(), self.found.copy(), self.seen.copy()
            self.goals[rows], self.found[rows], self.seen[rows] = goals, found, seen
        self._changed[rows] = True
        self._move_time[rows] = 0.0
        self._observation[rows, self.task.layout.goal] = views
        if start.directions is not None:
            self.directions[rows] = start.directions
            self._observation[rows, self.task.layout.direction] = start.directions
        if self.task.tip is not None:
            self._held[rows] = self.task.tip.directions(self.world.q[rows])
        if self.options.goal_env:
            q, tip = map(on_host, self.world.snapshot(ids))
            self._achieved[rows] = in_dtype(self.task.achieved(tip, q), self.options.dtype)
            self._desired[rows] = in_dtype(self.task.desired(goals, self.directions[rows]), self.options.dtype)

    @property
    def measurement(self) -> GoalMeasurement | None:  # type: ignore[override]
        """The cameras' last measurement of a goal; None where nothing is rendered."""
        return self._observer.last

    @property
    def observation_space(self) -> spaces.Space[Any]:
        return self.task.observation_space if self._pixels is None else self._pixels.space

    def observe(self) -> Any:
        """Return the observations, shape (count, size); with pixels or goals a dictionary of arrays with count rows."""
        if self._pixels is not None:
            return self._taken_pictures(self._pixels)
        self._observation[:, self.task.layout.q] = seen_joints(self.task.arm, self.world.q)
        if self.options.goal_env:
            return {
                "observation": self._observation[:, self.task.layout.rest].copy(),
                "achieved_goal": self._achieved.copy(),
                "desired_goal": self._desired.copy(),
            }
        observation = self._observation.copy()
        if self.task.options.goal_in == IMAGE:
            block = observation[:, self.task.layout.goal]
            block[:] = np.clip(in_image(block), -CAMERA_RANGE, CAMERA_RANGE)
        return observation

    def _taken_pictures(self, pixels: PixelObserver) -> dict[str, NDArray[Any]]:
        """The pictures of every arm, new ones of those that have acted or begun since: every look draws noise."""
        rows = np.flatnonzero(self._changed)
        taken = pixels.measure(self.world.q[rows], self.goals[rows], [self._sensors[row] for row in rows])
        self._pictures = self._pictures or taken
        for name, part in taken.items():
            self._pictures[name][rows] = part
        self._changed[:] = False
        return {name: part.copy() for name, part in self._pictures.items()}

    def goal_info(self, rows: Any) -> dict[str, Any]:
        info = {
            "goal": np.array(self.goals[rows]),
            "seen": np.array(self.seen[rows]),
            "view": np.array(self._observation[rows, self.task.layout.goal]),
            "ball_found": np.array(self.found[rows]),
            **self._drawn.info(rows),
        }
        return info | {"direction": np.array(self.directions[rows])} if self.task.directed else info

    def start_info(self, ids: Ids) -> dict[str, Any]:
        count = len(ids)
        q, tip = self.world.snapshot(ids)
        nobody = np.zeros(count, dtype=np.bool_)
        goals, directions, impossible = self._on_device(self.goals[ids], self.directions[ids], nobody)
        distance = distance_between(tip, goals)
        if self._terms is None:
            self._terms = term_names(self.task.score, distance, q, impossible, directions)
        terms = {name: np.zeros(count) for name in self._terms}
        score = Score(np.zeros(count), terms, self.task.posture_error(q, directions), nobody)
        nothing = Executed(nobody, np.zeros(count, dtype=np.uint8), [""] * count if self.world.explains else None)
        info = self._info(ids, nothing, score, q, tip, distance)
        info |= {"status": texts(count), "target": copied(q)}
        if self.task.tip is not None:
            info["tip_share"] = np.zeros(count)
        return info | {"target_tip": copied(tip)} if self.world.explains else info

    def step(self, actions: Floats, acting: Flags | None = None) -> Outcome:
        """Act with every arm, or where `acting` is True; actions are in [-1, 1], shape (count, n)."""
        variant = self.task.variant
        targets, share = self.targets(actions)
        if acting is not None:
            targets = np.where(acting[:, None], targets, self.world.q)
        ends = targets if self.task.options.tolerance == 0.0 else self._ends(targets, acting)
        executed = self.world.execute(ends, two_phase=variant.two_phase, acting=acting)
        if executed.durations is not None:
            self._move_time += executed.durations
        score, info = self._judge(targets, executed, share)
        self._changed |= True if acting is None else acting
        outcome = self._outcome(score, executed.status, info)
        return outcome if acting is None else outcome.of(acting)

    def _outcome(self, score: Score, status: Any, info: dict[str, Any]) -> Outcome:
        everyone = np.ones(len(score.reached), dtype=np.bool_)
        if self.task.variant.one_action:
            return Outcome(score.reward, everyone, ~everyone, info)
        terminated = on_host(score.reached) & self.task.options.end_on_reached
        lost = status == TargetStatus.DIVERGED
        return Outcome(score.reward, terminated, lost & ~terminated, info)

    def judge(self, achieved: Floats, desired: Floats, told: Told) -> Outcome:
        """Return what transitions with these goals, shape (k, size), lead to; its `info` is empty.

        Where `info` does not say so, no action was impossible, and no simulation diverged.
        """
        impossible = told.get("impossible", False).astype(np.bool_)
        score = self.task.score_of_goals(achieved, desired, impossible, lambda: told.need("q"))
        return self._outcome(score, told.get("impossible_code", TargetStatus.COMPLETED), {})

    def _ends(self, targets: Floats, acting: Flags | None) -> Floats:
        """Where joints end near targets within their limits [rad], shape (count, n); other targets are kept."""
        arm, tolerance = self.task.arm, self.task.options.tolerance
        errors = np.zeros_like(targets)
        for row in range(self.world.count) if acting is None else np.flatnonzero(acting):
            errors[row] = self._sensors[row].uniform(-tolerance, tolerance, len(arm.joints))
        inside = targets == held_in_limits(arm, targets)
        return np.where(inside, held_in_limits(arm, targets + errors), targets)

    def forfeit(self, reason: str) -> Outcome:
        """Return the verdict on agents that find no action: impossible, the arms stay, the episodes end."""
        count = self.world.count
        everyone = np.ones(count, dtype=np.bool_)
        statuses = np.full(count, TargetStatus.FORFEITED, dtype=np.uint8)
        score, info = self._judge(self.world.q.copy(), Executed(everyone, statuses, [reason] * count))
        return Outcome(score.reward, everyone, ~everyone, info)

    def targets(self, actions: Floats) -> tuple[Floats, Floats | None]:
        """Return postures that actions ask for [rad], shape (count, n), and the parts of the ways of moved tips."""
        if self.task.tip is None:
            return self.task.targets(self.world.q, actions), None
        return self.task.tip.targets(self.world.q, actions, self._held)

    def _judge(self, targets: Floats, executed: Executed, share: Floats | None = None) -> tuple[Score, dict[str, Any]]:
        q, tip = self.world.snapshot()
        goals, directions, impossible = self._on_device(self.goals, self.directions, executed.impossible)
        distance = distance_between(tip, goals)
        if self.options.goal_env:
            q_here, tip_here = on_host(q), on_host(tip)
            # judged as it is handed out, so that `compute_reward` says the same
            self._achieved[:] = in_dtype(self.task.achieved(tip_here, q_here), self.options.dtype)
            score = self.task.score_of_goals(self._achieved, self._desired, executed.impossible, lambda: q_here)
        else:
            score = self.task.score(distance, q, impossible, directions)
        self._terms = tuple(score.terms)
        info = self._info(slice(None), executed, score, q, tip, distance) | {"target": targets}
        if self.task.tip is not None:
            info["tip_share"] = np.zeros(self.world.count) if share is None else share
        if self.world.explains:  # not in large kinematic batches, where it would take long
            info["target_tip"] = self._target_tips(targets, tip, executed.impossible)
        return score, info

    def _info(
        self, rows: Any, executed: Executed, score: Score, q: Floats, tip: Floats, distance: Floats
    ) -> dict[str, Any]:
        """Return the `info` of some arms, whose results have as many rows, without the target."""
        reasons = executed.reasons
        return {
            **self.goal_info(rows),
            "q": q,
            "tip": tip,
            "distance": distance,
            "posture_error": score.posture_error,
            "reached": score.reached,
            "is_success": score.reached,
            "impossible": executed.impossible,
            "impossible_code": executed.status,
            "impossible_reason": _PHRASES[executed.status] if reasons is None else np.array(reasons, dtype=object),
            "status": STATUSES[executed.status],
            "move_s": np.array(self._move_time[rows]),
            **told_terms(score.terms),
        }

    def _target_tips(self, targets: Floats, tip: Floats, impossible: Flags) -> Floats:
        """Where the tips would be in the targets [m], shape (count, 3)."""
        if self.world.dynamic or self.task.options.tolerance:
            return self.task.kinematics.positions(targets)
        tips = tip.copy()  # a kinematic world reaches possible targets exactly
        if impossible.any():
            tips[impossible] = self.task.kinematics.positions(targets[impossible])
        return tips

    def _on_device(self, *values: Any) -> Sequence[Any]:
        """Return arrays as what the world has its arms' places in."""
        device = self.world.device
        return values if device is None else [on_device(value, device) for value in values]

    def close(self) -> None:
        self._observer.close()
        if self._pixels is not None:
            self._pixels.close()
