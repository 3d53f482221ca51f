"""Episodes of a number of arms in step: the whole button task except Gymnasium's interface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from kinreach._checks import MAX_DISTANCE, Floats, as_vector, check_count, check_flag, check_known
from kinreach.envs._batch import Episodes, Outcome, RowStreams, told_terms
from kinreach.envs._button.button_task import (
    ACTUATIONS,
    CONTROL_LIMIT,
    JOINTS,
    PRESS_RADIUS,
    SPEED_BOUND,
    Actions,
    Actuation,
    ButtonReward,
    Flags,
    action_space,
    check_actions,
    meaning,
    observation,
    observation_space,
)
from kinreach.envs._button.world import Ids, TorqueWorld
from kinreach.envs._options import EnvOptions, about, option_rows
from kinreach.envs._randomise import TORQUE, Randomisation, Ranges, about_randomise, check_randomise
from kinreach.envs._reach.rewards import OwnReward, RewardFunction, Scorer, Terms, check_reward, term_names
from kinreach.errors import InputError
from kinreach.kinematics import Arm3Kinematics
from kinreach.robots import ArmDescription, QuadrantRegion, get_arm

#: Joint angles [rad] and velocities [rad/s] start within +- this of rest in the home posture.
SPREAD = 0.1
#: Numbers of a start: target (3), joint angles (3), joint velocities (3).
SIZE = 3 + 2 * JOINTS


@dataclass(frozen=True, kw_only=True)
class ButtonOptions(EnvOptions):
    """Options of the button environments, single and in native batches."""

    actuation: str = field(default="tuned", metadata=about('`"tuned"` or `"report"`'))
    fixed_target: bool | Sequence[float] = field(
        default=False,
        metadata=about("keep the first target (`True`), or the target itself, (x, y, z) in the world [m]"),
    )
    reward: RewardFunction | None = field(
        default=None, metadata=about("a function of distance, q and press; by default the environment's own")
    )
    controls: bool = field(default=False, metadata=about("observe the three controls, too", flag=None))
    frames: int = field(default=1, metadata=about("observe so many steps, up to 16, the newest first", flag=None))

    randomise: Ranges | None = field(default=None, metadata=about_randomise(TORQUE))

    def __post_init__(self) -> None:
        super().__post_init__()
        check_randomise(self.randomise, bounds=TORQUE)
        check_known("actuation", self.actuation, ACTUATIONS)
        check_reward(self.reward, "distance, q and press")
        check_flag("controls", self.controls)
        check_count("frames", self.frames, most=16)
        _ = self.target

    @property
    def arm(self) -> ArmDescription:
        return get_arm("arm3")

    @property
    def motors(self) -> Actuation:
        return ACTUATIONS[self.actuation]

    @property
    def observation_space(self) -> spaces.Box:
        return observation_space(controls=self.controls, frames=self.frames)

    @property
    def target(self) -> Floats | None:
        """The target of all episodes in the world [m], shape (3,), if one was given."""
        if isinstance(self.fixed_target, bool):
            return None
        return as_vector("fixed_target", self.fixed_target, 3, most=MAX_DISTANCE)


class ButtonStarts:
    """Draws starts; targets are uniform in what the arm reaches, within its limits, of a region.

    Args:
        region: None: the work cell's.
    """

    def __init__(self, region: QuadrantRegion | None = None) -> None:
        self.kinematics = Arm3Kinematics(base="world")
        self._draw = self.kinematics.arm.workcell.draw_goals if region is None else region.sample
        self._home = np.array(self.kinematics.arm.home)

    def reachable(self, targets: Floats) -> Flags:
        """Return whether the closed form has a posture within the joint limits for targets [m], shape (n, 3).

        Collisions are not checked: each of 4971 such targets of the region had a posture without one.
        """
        return np.any(self.kinematics.batch(targets).valid, axis=1)

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw `count` starts, shape (count, 9): target [m], joint angles [rad], joint velocities [rad/s]."""
        targets = self._targets(rng, count)
        q = self._home + rng.uniform(-SPREAD, SPREAD, (count, JOINTS))
        return np.concatenate([targets, q, rng.uniform(-SPREAD, SPREAD, (count, JOINTS))], axis=1)

    def _targets(self, rng: np.random.Generator, count: int) -> Floats:
        targets: Floats = self._draw(rng, count)
        while not (kept := self.reachable(targets)).all():
            targets[~kept] = self._draw(rng, int((~kept).sum()))
        return targets


class ButtonReset(NamedTuple):
    """The options of `reset`, one row an environment; None for those that are not given.

    Attributes:
        goals: Targets in the world [m], shape (count, 3).
        q: Postures to start in, at rest [rad], shape (count, 3).
    """

    goals: Floats | None = None
    q: Floats | None = None


class ButtonEpisodes(Episodes):
    """The state of the episodes and their rules, for one arm or thousands.

    Attributes:
        goals: Targets in the world [m], shape (count, 3).
    """

    def __init__(self, options: ButtonOptions, world: TorqueWorld) -> None:
        count = world.count
        self.options, self.world, self.goals = options, world, np.empty((count, 3))
        self.action_space, self.observation_space = action_space(), options.observation_space
        self.fps = round(1 / options.motors.period)  # a frame a step
        self._starts = ButtonStarts(options.motors.targets)
        self._streams = RowStreams(self._starts.sample, count, size=SIZE)
        self._drawn = Randomisation(options.randomise, count, world.drawn)
        self._period = options.motors.period
        self._gears = np.array(options.motors.gears)
        self._keep = options.fixed_target is not False
        report, reward = ButtonReward(options.motors), options.reward
        self._scorer: Scorer = report if reward is None else OwnReward(reward, report)
        self._has_target = np.zeros(count, dtype=np.bool_)
        self._state = np.empty((3, count, JOINTS))  # joint angles, velocities, end effectors
        self._control = np.empty((count, JOINTS))
        self._pushed = np.empty(count, dtype=np.bool_)
        self._steps = np.empty(count, dtype=np.int64)
        self._wrong_presses = np.empty(count, dtype=np.int64)
        self._energy = np.empty(count)
        self._controls = options.controls
        self._seen = np.empty((count, options.frames, options.observation_space.shape[0] // options.frames))
        self._terms: tuple[str, ...] | None = None  # names of the reward's
        self._fixed = options.target
        if self._fixed is not None:
            self._refuse_unreachable("fixed_target", self._fixed[None])

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Give an arm its own generator; it forgets a target that it kept."""
        self._drawn.seed(index, rng.spawn(1)[0])
        self._streams.seed(index, rng)
        self._has_target[index] = False

    def check_start(self, options: Mapping[str, Any] | None, count: int | None) -> ButtonReset:
        goals, q = option_rows(options, {"goal": 3, "q": JOINTS}, count)
        if goals is not None:
            self._refuse_unreachable("goal", goals)
        if q is not None and (outside := self._starts.kinematics.past_limits(q, 0.0).any(axis=1)).any():
            raise InputError(f"q is outside the joint limits: {q[outside][0]}")
        return ButtonReset(goals, q)

    def check_actions(self, actions: ArrayLike, count: int | None) -> Actions:
        return check_actions(actions, count)

    def begin(self, ids: Ids, start: ButtonReset = ButtonReset()) -> None:  # noqa: B008 (immutable)
        """Start new episodes; by default targets are drawn, or kept, and postures are drawn, with velocities."""
        targets, postures, speeds = np.split(self._streams.draw(ids), 3, axis=1)
        if start.goals is not None:
            targets = start.goals
        elif self._fixed is not None:
            targets = np.broadcast_to(self._fixed, targets.shape)
        elif self._keep:
            targets = np.where(self._has_target[ids, None], self.goals[ids], targets)
        if start.q is not None:
            postures, speeds = start.q, np.zeros_like(start.q)
        self.goals[ids], self._has_target[ids] = targets, True
        for counter in (self._control, self._pushed, self._steps, self._wrong_presses, self._energy):
            counter[ids] = 0
        self._drawn.begin(ids)
        self.world.reset(ids, targets, postures, speeds)
        self._state[:, ids] = self.world.q[ids], self.world.qd[ids], self.world.tip[ids]
        self._seen[ids] = self._present()[ids, None]

    def observe(self) -> Floats:
        return self._seen.reshape(len(self._seen), -1).copy()

    def _present(self) -> Floats:
        q, qd, tip = self._state
        seen = observation(q, qd, tip, self.goals, self._pushed)
        return np.hstack([seen, self._control]) if self._controls else seen

    @property
    def distance(self) -> Floats:
        """From the end effectors to the targets [m], shape (count,)."""
        return np.sqrt(((self._state[2] - self.goals) ** 2).sum(axis=1))

    def step(self, actions: Actions, acting: Flags | None = None) -> Outcome:
        change, pushed = meaning(actions)
        self._pushed = pushed if acting is None else pushed & acting
        control = np.clip(self._control + change, -CONTROL_LIMIT, CONTROL_LIMIT)
        self._control = control if acting is None else np.where(acting[:, None], control, self._control)
        before = self.distance
        diverged = self._simulate(acting)
        older = self._seen[:, :-1]
        seen = np.concatenate([self._present()[:, None], older], axis=1)
        self._seen = seen if acting is None else np.where(acting[:, None, None], seen, self._seen)
        distance = self.distance
        score = self._scorer.score(distance, self._state[0].copy(), self._pushed, before)
        pressed, wrong = score.reached, self._pushed & (distance >= PRESS_RADIUS)
        self._steps += 1 if acting is None else acting
        self._wrong_presses += wrong
        self._energy += ((self._control * self._gears) ** 2).sum(axis=1) * self._period
        self._terms = tuple(score.terms)
        info = self._info(slice(None), pressed, wrong, diverged, score.terms)
        outcome = Outcome(score.reward, pressed, diverged & ~pressed, info)
        return outcome if acting is None else outcome.of(acting)

    def goal_info(self, rows: Any) -> dict[str, Any]:
        return {**super().goal_info(rows), **self._drawn.info(rows)}

    def start_info(self, ids: Ids) -> dict[str, Any]:
        nobody = np.zeros(len(ids), dtype=np.bool_)
        if self._terms is None:
            distance = self.distance[ids]
            self._terms = term_names(self._scorer.score, distance, self._state[0, ids], nobody, distance)
        return self._info(ids, nobody, nobody, nobody, {name: np.zeros(len(ids)) for name in self._terms})

    def _info(self, rows: Any, pressed: Flags, wrong: Flags, diverged: Flags, terms: Terms) -> dict[str, Any]:
        """Return the `info` of some arms, whose results have as many rows."""
        reason = f"diverged: a joint became faster than {SPEED_BOUND:g} rad/s"
        q, _, tip = self._state
        return {
            **self.goal_info(rows),
            "distance": self.distance[rows],
            "q": np.array(q[rows]),
            "tip": np.array(tip[rows]),
            "reached": pressed,
            "is_success": pressed,
            "pressed": pressed,
            "wrong_press": wrong,
            "wrong_presses": np.array(self._wrong_presses[rows]),
            "impossible": diverged,
            "impossible_code": diverged.astype(np.uint8),
            "impossible_reason": np.where(diverged, reason, "").astype(object),
            "energy": np.array(self._energy[rows]),
            "steps": np.array(self._steps[rows]),
            "move_s": self._steps[rows] * self._period,
            **told_terms(terms),
        }

    def _simulate(self, acting: Flags | None) -> Flags:
        """Step the world; return which arms have diverged. Their last good state is kept."""
        self.world.step(self._control, acting)
        good = np.all(np.abs(self.world.qd) <= SPEED_BOUND, axis=1)
        if good.all():
            self._state[:] = self.world.q, self.world.qd, self.world.tip
        else:
            now = np.stack([self.world.q, self.world.qd, self.world.tip])
            np.copyto(self._state, now, where=good[:, None])
        return ~good

    def _refuse_unreachable(self, name: str, targets: Floats) -> None:
        missed = targets[~self._starts.reachable(targets)]
        if len(missed):
            raise InputError(f"{name} {missed[0]} m cannot be reached within the joint limits")
