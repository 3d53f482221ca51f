"""A rolling ball to be touched, seen late: `kinreach/Moving-v0`.

Thirty times a second the cameras report where the ball was 50 ms ago, and the agent names a posture; the arm goes there
with its own limits of speed and acceleration, joint by joint. The episode is over when the tip is within 10 mm of the
ball's centre, when arm or fingers collide, when the ball leaves the table area, or after three seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import MAX_DISTANCE, Floats, check_count, check_flag, check_known, check_number
from kinreach._registration import MAX_EPISODE_STEPS, MOVING
from kinreach._tensors import namespace
from kinreach.envs._batch import Episodes, Flags, Ids, NativeVectorEnv, Outcome
from kinreach.envs._options import EnvOptions, about, check_box_actions, option_values, with_options
from kinreach.envs._posed import PosedEnv
from kinreach.envs._randomise import Bounds, Randomisation, Ranges, about_randomise, check_randomise
from kinreach.envs.real_arm import MEDIAN_LENGTH, NOISE
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.kinematics.inside import MARGIN
from kinreach.robots import THESIS_ARM, ArmDescription, get_arm

#: Frames of the cameras a second, and parts of a frame in which the motion is computed.
FRAMES, PARTS = 30, 8
#: Age of what the cameras report [s], how long an episode may be [s], and how near is touching [m].
DELAY, SECONDS, TOUCH = 0.05, 3.0, 0.01
#: Radius of the circles [m]; sideways acceleration of the random walk [m/s^2], and how long it keeps one [s].
RADIUS, SIDEWAYS, HOLD = 0.12, 1.0, 0.25
#: Of the ball, unless the options say otherwise [m/s].
SPEEDS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.6)
#: How far inside the table area a path begins, and how far off an outlier among the sights is [m].
INSIDE, OUTLIER = 0.02, 0.05
#: Widest strip that may be hidden: every ball comes out of it [m].
MAX_HIDDEN = 0.2
#: Of a ball that stops within a frame [m/s^2].
MAX_FRICTION = 60.0
#: Numbers of an observation: the ball as it was last seen, its age [s], joint angles and speeds, and sights before.
BALL, AGE, ANGLES, RATES = slice(0, 3), 3, slice(4, 10), slice(10, 16)
JOINTS = 6
#: Options that can be drawn instead, and their bounds.
DRAWN: Bounds = {"noise": (0.0, 0.1), "delay": (0.0, 1.0), "strength": (0.1, 1.0)}
#: Terms of the reward.
TERMS = ("distance", "touch", "collision")
#: Targets of the greatest motion in a frame are a little beyond where a joint stops after it, so that it does not brake
#: before: by this factor of the way, and this angle [rad].
BEYOND_STOP, LEAST_WAY = 1.02, 1e-4
#: The first joint turns a tip at the far end of the table no faster [m/s].
MAX_SPEED = 2.0


def entering(rng: np.random.Generator, low: Floats, high: Floats) -> tuple[Floats, float]:
    """Draw a line through the middle half of the area: where it enters, shape (2,), and its heading [rad]."""
    size = high - low
    through, heading = rng.uniform(low + size / 4, high - size / 4), rng.uniform(0.0, 2.0 * math.pi)
    ahead = np.array([math.cos(heading), math.sin(heading)])
    behind = np.where(ahead > 0.0, through - low, high - through) / np.maximum(np.abs(ahead), 1e-9)
    return np.asarray(through - float(behind.min()) * ahead), heading


def straight(rng: np.random.Generator, speed: float, times: Floats, low: Floats, high: Floats) -> Floats:
    """Roll across the area; return the path, shape (len(times), 2)."""
    start, heading = entering(rng, low, high)
    return np.asarray(start + speed * times[:, None] * np.array([math.cos(heading), math.sin(heading)]))


def circle(rng: np.random.Generator, speed: float, times: Floats, low: Floats, high: Floats) -> Floats:
    """Roll in a circle within the area, in either direction."""
    centre, first = rng.uniform(low + RADIUS, high - RADIUS), rng.uniform(0.0, 2.0 * math.pi)
    angle = first + rng.choice((-1.0, 1.0)) * speed / RADIUS * times
    return np.asarray(centre + RADIUS * np.column_stack([np.cos(angle), np.sin(angle)]))


def random_walk(rng: np.random.Generator, speed: float, times: Floats, low: Floats, high: Floats) -> Floats:
    """Roll as `straight`, then with a sideways acceleration that is drawn every `HOLD` seconds.

    Outside of the middle half of the area it turns the ball towards the middle.
    """
    (x, y), heading = entering(rng, low, high)
    holds = (times / HOLD).astype(int)
    draws = rng.uniform(-SIDEWAYS, SIDEWAYS, holds[-1] + 1)[holds].tolist()
    (left, bottom), (right, top) = (low + high) / 2 - (high - low) / 4, (low + high) / 2 + (high - low) / 4
    places = np.empty((len(times), 2))
    for index, (sideways, dt) in enumerate(zip(draws, np.diff(times, prepend=0.0).tolist(), strict=True)):
        if not (left <= x <= right and bottom <= y <= top):
            inwards = math.atan2((bottom + top) / 2 - y, (left + right) / 2 - x)
            sideways = math.copysign(sideways, math.sin(inwards - heading))
        heading += sideways / speed * dt
        x, y = x + speed * dt * math.cos(heading), y + speed * dt * math.sin(heading)
        places[index] = x, y
    return places


#: Ways of rolling by name: from a generator, the speed [m/s], times [s], and the area's corners [m] to places [m].
PATHS: Mapping[str, Callable[[np.random.Generator, float, Floats, Floats, Floats], Floats]] = {
    "straight": straight,
    "circle": circle,
    "random": random_walk,
}


@dataclass(frozen=True, kw_only=True)
class MovingOptions(EnvOptions):
    """Options of `kinreach/Moving-v0`.

    Raises:
        UnknownNameError: An unknown path.
        InputError: A speed that the arm cannot follow, or another number out of range.
    """

    speeds: tuple[float, ...] = field(default=SPEEDS, metadata=about("of the ball, one of them an episode [m/s]"))
    paths: tuple[str, ...] = field(default=tuple(PATHS), metadata=about(f"one of them an episode: {', '.join(PATHS)}"))
    delay: float = field(default=DELAY, metadata=about("age of what the cameras report [s]"))
    noise: float = field(default=NOISE, metadata=about("median error of a sight [m]"))
    hidden: float = field(default=0.0, metadata=about("width of the strip along y = 0 that the cameras do not see [m]"))
    outliers: float = field(default=0.0, metadata=about("share of the sights that are 50 mm off"))
    dropped: float = field(default=0.0, metadata=about("share of the frames in which the cameras do not see the ball"))
    friction: float = field(default=0.0, metadata=about("what the ball's speed loses in a second [m/s^2]"))
    sights: int = field(default=1, metadata=about("how many of the last sights are observed", flag=None))
    collisions: bool = field(
        default=True, metadata=about("a collision ends the episode; without, the arm moves through the table")
    )
    margin: float = field(default=MARGIN, metadata=about("parts that are nearer count as colliding [m]"))
    strength: float = field(
        default=1.0, metadata=about("the arm's limits of speed and acceleration, as a share of those that methods know")
    )
    randomise: Ranges | None = field(default=None, metadata=about_randomise(DRAWN, '"delay": (0.03, 0.08)'))

    def __post_init__(self) -> None:
        super().__post_init__()
        for speed in self.speeds:
            check_speed(speed)
        for path in self.paths:
            check_path(path)
        for name, what in (("delay", "delay [s]"), ("noise", "noise [m]"), ("strength", "strength")):
            least, most = DRAWN[name]
            check_number(what, getattr(self, name), least=least, most=most)
        check_number("hidden [m]", self.hidden, least=0.0, most=MAX_HIDDEN)
        for name in ("outliers", "dropped"):
            check_number(name, getattr(self, name), least=0.0, most=1.0)
        check_number("friction [m/s^2]", self.friction, least=0.0, most=MAX_FRICTION)
        check_count("sights", self.sights, most=round(SECONDS * FRAMES))
        check_flag("collisions", self.collisions)
        check_number("margin [m]", self.margin, least=0.0, most=MAX_DISTANCE)
        check_randomise(self.randomise, bounds=DRAWN)


def check_speed(speed: object) -> float:
    """Check a speed of the ball [m/s] and return it.

    Raises:
        InputError: The arm cannot follow it.
    """
    value = check_number("the ball's speed [m/s]", speed, above=0.0)
    if value > MAX_SPEED:
        raise InputError(
            f"the ball's speed must be at most {MAX_SPEED:g} m/s: the arm's tip is no faster, got {value:g}"
        )
    return value


def check_path(path: str) -> str:
    """Check the name of a way of rolling and return it.

    Raises:
        UnknownNameError: An unknown path.
    """
    check_known("path", path, PATHS)
    return path


class MovingStart(NamedTuple):
    """Values that episodes begin with, instead of drawn ones.

    Attributes:
        speeds: Of the balls [m/s], shape (k,), or None.
        paths: Names, shape (k,), or None.
    """

    speeds: Floats | None = None
    paths: NDArray[np.str_] | None = None


ALL_DRAWN = MovingStart()


@cache
def ur5_checker(margin: float) -> CollisionChecker:
    """Return the collision checker of the UR5 in its work cell, without the ball, with a margin [m]."""
    return CollisionChecker(THESIS_ARM, margin=margin)


class MovingEpisodes(Episodes):
    """The episodes of a number of environments.

    Args:
        options: Of the environments.
        count: Number of environments.

    Attributes:
        checker: The verdict on collisions, with the option `margin`.
        frames: Frames so far, shape (count,).
        q, v: Joint angles [rad] and speeds [rad/s], shape (count, 6).
        area: Least and greatest place of a ball on the table [m], each shape (2,).
        due: Part of a frame in which the sight of each frame is taken if the cameras see the ball then, shape
            (count, FRAMES * SECONDS + 1).
        noise: Standard deviation of a coordinate of a sight [m], shape (count,).
        strength: The arms' limits of speed and acceleration, as a share of `speed_limit` and `acceleration_limit`,
            shape (count, 1), or (count, 6) for joints that differ.
        rolls: Where the balls are at each part of a frame [m], shape (count, PARTS * FRAMES * SECONDS + 1, 3).
    """

    fps = FRAMES

    def __init__(self, options: MovingOptions, count: int) -> None:
        self.options = options
        self.action_space, self.observation_space = spaces.Box(-1.0, 1.0, (JOINTS,)), observation_space(options)
        self.arm: ArmDescription = (arm := get_arm(THESIS_ARM))
        self.chain = ArmKinematics(arm, tip="tcp", base="world").chain
        self.checker = ur5_checker(options.margin)
        self.home, self.speed_limit, self.acceleration_limit = (
            np.array(arm.home),
            arm.speed_limit,
            arm.acceleration_limit,
        )
        region: Any = arm.workcell.goals
        self.area: tuple[Floats, Floats] = tuple(np.array([region.x, region.y]).T)
        self.height = region.z[0]
        frames = round(SECONDS * FRAMES)
        self._times = np.arange(frames * PARTS + 1) / (FRAMES * PARTS)
        self._drawn = Randomisation(options.randomise, count, None, sizes=dict.fromkeys(DRAWN, 1))
        self.due, self.noise = np.empty((count, frames + 1), dtype=np.intp), np.empty(count)
        self.strength = np.empty((count, 1))
        self._set_drawn(np.arange(count))
        self._rngs = [np.random.default_rng() for _ in range(count)]
        self.rolls = np.empty((count, len(self._times), 3))
        self._sights, self._taken = np.empty((count, frames + 1, 3)), np.empty_like(self.due)
        self._ends, self.frames = np.empty(count, dtype=np.intp), np.empty(count, dtype=np.intp)
        self.q, self.v = np.empty((count, 6)), np.empty((count, 6))
        self._speeds, self._paths = np.empty(count), np.empty(count, dtype=object)
        self._nearest, self._reasons = np.empty(count), np.empty(count, dtype=object)

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Give an environment its own generator."""
        self._rngs[index] = rng
        self._drawn.seed(index, rng.spawn(1)[0])

    def _set_drawn(self, ids: Ids) -> None:
        """Give environments what was drawn, or what their options say."""
        delay, noise, strength = (
            self._drawn.values(name, ids, getattr(self.options, name)) for name in ("delay", "noise", "strength")
        )
        late = np.round(delay * FRAMES * PARTS).astype(np.intp)
        self.due[ids] = np.maximum(np.arange(self.due.shape[1]) * PARTS - late, 0)
        self.noise[ids], self.strength[ids] = noise[:, 0] / MEDIAN_LENGTH, strength

    def check_start(self, options: Mapping[str, Any] | None, count: int | None) -> MovingStart:
        """Return the options of `reset`: `speed` [m/s] and `path`, one for all balls or one for each."""
        return MovingStart(*option_values(options, {"speed": check_speed, "path": check_path}, count))

    def check_actions(self, actions: ArrayLike, count: int | None) -> Floats:
        """Return postures to go to, each angle divided by pi, shape (k, 6)."""
        return check_box_actions(actions, (JOINTS,), count)

    def begin(self, ids: Ids, start: MovingStart = ALL_DRAWN) -> None:
        """Draw other balls; the arms rest in their start posture."""
        if self.options.randomise:
            self._drawn.begin(ids)
            self._set_drawn(ids)
        for row, index in enumerate(ids):
            rng = self._rngs[index]
            speed, path = rng.choice(self.options.speeds), str(rng.choice(list(self.options.paths)))
            speed = float(speed if start.speeds is None else start.speeds[row])
            path = path if start.paths is None else str(start.paths[row])
            rolling = self.rolling(speed, self._times)
            places = PATHS[path](rng, speed, rolling, self.area[0] + INSIDE, self.area[1] - INSIDE)
            end = int(last_part(places, self.area))
            self.rolls[index, :, :2], self.rolls[index, :, 2] = places, self.height
            sights = self.seen(rng, self.due[index], self.rolls[index], end, self.noise[index])
            self._sights[index], self._taken[index] = sights
            self._ends[index], self._speeds[index], self._paths[index] = end, speed, path
        self.frames[ids], self.q[ids], self.v[ids], self._nearest[ids] = 0, self.home, 0.0, np.inf
        self._reasons[ids] = ""

    def rolling(self, speed: float, times: Floats) -> Floats:
        """Return the times after which a ball that keeps its speed [m/s] is where one with friction is at `times`."""
        friction = self.options.friction
        if friction == 0.0:
            return times
        until = np.minimum(times, speed / friction)
        return np.asarray(until - friction * until**2 / (2.0 * speed))

    def seen(self, rng: np.random.Generator, due: Ids, rolls: Floats, ends: Any, noise: Any) -> tuple[Floats, Ids]:
        """Return what the cameras report in each frame [m], and the parts of a frame in which they saw it.

        When they do not see the ball they report the last sight again. The first place of a ball is always seen.

        Args:
            rng: Draws noise, outliers and the frames in which the ball is not seen.
            due: As the attribute, shape (..., frames).
            rolls: Where balls are at each part [m], shape (..., parts, 3).
            ends: The part from which on they are gone, shape (...).
            noise: Standard deviation of a coordinate of a sight [m], a number or shape (..., 1, 1).
        """
        errors, options = rng.normal(0.0, noise, (*due.shape, 3)), self.options
        visible = np.ones(due.shape, dtype=np.bool_)
        if options.outliers:
            angles = rng.uniform(0.0, 2.0 * math.pi, due.shape)
            off = OUTLIER * (rng.random(due.shape) < options.outliers)
            errors[..., :2] += np.stack([off * np.cos(angles), off * np.sin(angles)], axis=-1)
        if options.dropped:
            visible = rng.random(due.shape) >= options.dropped
        places = np.take_along_axis(rolls, np.minimum(due, np.asarray(ends)[..., None])[..., None], axis=-2)
        visible = (visible & (np.abs(places[..., 1]) >= options.hidden / 2.0)) | (due == 0)
        last = np.maximum.accumulate(np.where(visible, np.arange(due.shape[-1]), 0), axis=-1)
        sights = np.take_along_axis(places + errors, last[..., None], axis=-2)
        return sights, np.take_along_axis(due, last, axis=-1)

    def step(self, actions: Floats, acting: Flags | None = None) -> Outcome:
        """Simulate one frame in all environments, or where `acting` is True."""
        targets, dt = math.pi * np.clip(actions, -1.0, 1.0), 1.0 / (FRAMES * PARTS)
        speed, acceleration = (self.strength * limit for limit in (self.speed_limit, self.acceleration_limit))
        acting = np.ones(len(targets), dtype=np.bool_) if acting is None else acting
        q, v, postures = self.q, self.v, np.empty((len(targets), PARTS, 6))
        for part in range(PARTS):
            q, v = moved(q, v, targets, dt, speed=speed, acceleration=acceleration)
            postures[:, part] = q
        first = self.frames * PARTS
        at = np.minimum(first[:, None] + 1 + np.arange(PARTS), len(self._times) - 1)
        balls = self.rolls[np.arange(len(at))[:, None], at]
        apart = np.linalg.norm(self.chain.positions(postures.reshape(-1, 6)).reshape(balls.shape) - balls, axis=2)
        left = np.maximum(self._ends - first, 1)[:, None] <= np.arange(PARTS)  # the ball is gone by then
        nearest = np.where(left, np.inf, apart).min(axis=1)
        self.q, self.v = (np.where(acting[:, None], new, old) for new, old in ((q, self.q), (v, self.v)))
        self.frames = self.frames + acting
        self._nearest = np.where(acting, np.minimum(self._nearest, nearest), self._nearest)
        collided = self._collide(postures, acting)
        touched = acting & (nearest <= TOUCH) & ~collided
        gone = acting & (self.frames * PARTS >= self._ends)
        paid = -np.where(acting, nearest, 0.0), touched.astype(float), -collided.astype(float)
        terms = dict(zip(TERMS, paid, strict=True))
        info = self._info(slice(None), touched, terms)
        reward = terms["distance"] + terms["touch"] + terms["collision"]
        return Outcome(reward, touched | collided | gone, np.zeros(len(touched), dtype=np.bool_), info)

    def _collide(self, postures: Floats, acting: Flags) -> Flags:
        """Stop the arms that collide in this frame, in the first such posture; return which they are.

        Args:
            postures: In the parts of the frame [rad], shape (count, PARTS, 6).
            acting: Which arms move, shape (count,).
        """
        collided = np.zeros(len(postures), dtype=np.bool_)
        if not self.options.collisions:
            return collided
        checker = self.checker
        # a joint that stops at its limit may be beyond it by a rounding error, which is not a collision
        within = np.clip(postures[acting].reshape(-1, 6), checker.kinematics.lower, checker.kinematics.upper)
        causes = checker.causes(within).reshape(-1, PARTS)
        collided[acting] = causes.any(axis=1)
        for index, row in zip(np.flatnonzero(collided), causes[causes.any(axis=1)], strict=True):
            self.q[index], self.v[index] = postures[index, np.flatnonzero(row)[0]], 0.0
            self._reasons[index] = checker.reason(self.q[index])
        return collided

    def observe(self) -> Floats:
        """Return the observations of all environments."""
        everyone, frames = np.arange(len(self.frames)), self.frames
        seen = self._sights[everyone, frames]
        age = (frames * PARTS - self._taken[everyone, frames]) / (FRAMES * PARTS)
        before = np.maximum(frames[:, None] - np.arange(1, self.options.sights), 0)
        moved_by = self._sights[everyone[:, None], before] - seen[:, None]
        return np.concatenate([seen, age[:, None], self.q, self.v, moved_by.reshape(len(seen), -1)], axis=1)

    def start_info(self, ids: Ids) -> dict[str, Any]:
        """Return the `info` of a reset."""
        return self._info(ids, np.zeros(len(ids), dtype=np.bool_), {name: np.zeros(len(ids)) for name in TERMS})

    def goal_info(self, rows: Any) -> dict[str, Any]:
        """Return where balls and arms are now."""
        now = np.minimum(self.frames * PARTS, self._ends)[rows]
        return {
            "goal": self.rolls[np.arange(len(self.frames))[rows], now],
            "q": np.array(self.q[rows]),
            "time": self.frames[rows] / FRAMES,
            "speed": np.array(self._speeds[rows]),
            "path": np.array(self._paths[rows]),
            **self._drawn.info(rows),
        }

    def _info(self, rows: Any, touched: Flags, terms: dict[str, Floats]) -> dict[str, Any]:
        """Return the `info` of some environments, whose results have as many rows."""
        reasons = np.array(self._reasons[rows])
        return {
            **self.goal_info(rows),
            "distance": np.array(self._nearest[rows]),
            "reached": touched,
            "is_success": touched,
            "impossible": reasons != "",
            "impossible_reason": reasons,
            "reward_terms": terms,
        }


def observation_space(options: MovingOptions) -> spaces.Box:
    """Return the space of one environment."""
    before = 3 * (options.sights - 1) * [4.0]
    high = np.array([2.0, 2.0, 2.0, SECONDS, *6 * [math.pi], *6 * [get_arm(THESIS_ARM).speed_limit], *before])
    return spaces.Box(np.where(np.arange(len(high)) == AGE, 0.0, -high), high, dtype=np.float64)


@with_options(MovingOptions)
class MovingBallEnv(PosedEnv):
    """A UR5 touches a ball that rolls over the table, seen by cameras that are late.

    ## Description
    The ball rolls straight on, in a circle of 0.12 m radius, or with a random sideways acceleration of up to 1 m/s^2.
    Thirty times a second the agent names a posture, and each joint goes there within its limits of speed and
    acceleration. A collision ends the episode: 240 times a second `kinreach.kinematics.CollisionChecker` judges arm,
    palm and open fingers. The ball has no contacts.

    ## Action Space
    `Box(-1, 1, (6,), float32)`: the posture to go to, each angle divided by pi.

    ## Observation Space
    `Box(16,), float32`; with `sights=n` 3 (n - 1) numbers more.

    | Num | Observation | Unit |
    |-----|-------------|------|
    | 0 to 2 | where the ball was last seen, in the world | m |
    | 3 | age of that sight | s |
    | 4 to 9 | joint angles | rad |
    | 10 to 15 | joint speeds | rad/s |
    | 16 on | where the ball was seen one frame earlier, two, and so on, relative to the last sight | m |

    ## Rewards
    Minus the least distance of tip and ball during the step [m], 1 more for a touch that counts, and 1 less for a
    collision. `info["reward_terms"]` has the terms `distance`, `touch` and `collision`.

    ## Starting State
    The arm rests in its start posture. Speed and path are drawn from the options. The ball enters the table area at its
    border, or, on a circle, starts anywhere on it. `reset(options={"speed": speed, "path": path})` sets a speed [m/s]
    or a path.

    ## Episode End
    The episode terminates when the tip is within 10 mm of the ball's centre, when arm or fingers are in the table or
    in the arm, when the ball leaves the table area, or after three seconds. A touch in the frame of a collision does
    not count. With `collisions=False` the arm moves through everything, and every touch counts.

    ## Info
    `reset` and `step` give the same entries, each of one type and shape. After a reset `distance` is infinite,
    nothing is touched or impossible, `impossible_reason` is empty, and rewards are 0.

    | Key | Value |
    |-----|-------|
    | `goal`, `speed`, `path` | where the ball is [m], its first speed [m/s] and its path |
    | `q`, `time` | joint angles [rad], after a collision the first that collide; time in the episode [s] |
    | `distance` | least distance of tip and ball so far [m] |
    | `impossible`, `impossible_reason` | whether the arm collided, and with what, such as `finger_left - table` |
    | `reached`, `is_success` | the ball was touched, and that counts |
    | `reward_terms` | terms of the reward |

    ## Arguments

    <table of the options>

    ## Version History
    * v0: initial version
    """

    episodes_class = MovingEpisodes

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        world = self.episodes
        self.home, self.height = world.home, world.height
        self.speed_limit, self.acceleration_limit = world.speed_limit, world.acceleration_limit

    @property
    def arm(self) -> ArmDescription:
        """The UR5, in its work cell."""
        arm: ArmDescription = self.episodes.arm
        return arm


class MovingVectorEnv(NativeVectorEnv):
    """A batch of `kinreach/Moving-v0`, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    Arguments, and how episodes start anew, are as of `NativeVectorEnv`.
    """

    registered_limit = MAX_EPISODE_STEPS[MOVING]
    Options = MovingOptions
    episodes_class = MovingEpisodes


def moved(q: Any, v: Any, target: Any, dt: float, *, speed: Any, acceleration: Any) -> tuple[Any, Any]:
    """Return angles and speeds after a short time on the way to a target, at which each joint can still stop.

    Arrays, or tensors of torch, through which gradients go.

    Args:
        q: Angles now [rad].
        v: Speeds now [rad/s].
        target: [rad].
        dt: Time [s].
        speed: Limit [rad/s], or one for each angle.
        acceleration: Limit [rad/s^2], or one for each angle.
    """
    xp, way = namespace(q), target - q
    # the largest speed from which it stops at the target, braking from the next moment on
    brake = acceleration * dt
    fastest = xp.clip(xp.sqrt(brake**2 / 4 + 2.0 * acceleration * xp.abs(way)) - brake / 2, None, speed)
    wanted = xp.where(xp.abs(way) < 0.5 * brake * dt, way / dt, xp.sign(way) * fastest)
    v = v + xp.clip(wanted - v, -brake, brake)
    return q + dt * v, v


def last_part(places: Floats, area: tuple[Floats, Floats]) -> NDArray[np.intp]:
    """Return the part of a frame in which balls leave the area, or the last, of places (..., parts, 2), shape (...)."""
    away = ((places < area[0]) | (places > area[1])).any(axis=-1)
    return np.asarray(np.where(away.any(axis=-1), away.argmax(axis=-1), away.shape[-1] - 1))


def pushed(q: Any, v: Any, side: float, time: Any, *, speed: Any, acceleration: Any) -> tuple[Any, Any]:
    """Return angles and speeds after a time [s] in which joints go down (side -1) or up (1) as fast as they can.

    Nothing beyond can be reached by then. Arrays or tensors; the other arguments are as of `moved`.
    """
    xp = namespace(v)
    end = xp.clip(v + side * acceleration * time, -speed, speed)
    ramp = xp.abs(end - v) / acceleration
    return q + (v + end) / 2.0 * ramp + end * (time - ramp), end


def motion_range(q: Any, v: Any, *, speed: float, acceleration: float) -> tuple[Any, Any]:
    """Return the targets at which joints accelerate downwards, and upwards, all the next frame. Arrays or tensors.

    Args:
        q: Angles now [rad], shape (..., n).
        v: Speeds now [rad/s], likewise.
        speed: Limit [rad/s].
        acceleration: Limit [rad/s^2].
    """
    frame, brake = 1.0 / FRAMES, acceleration / (FRAMES * PARTS)
    xp, ends = namespace(v), []
    for side in (-1.0, 1.0):
        there, end = pushed(q, v, side, frame, speed=speed, acceleration=acceleration)
        stop = end * (xp.abs(end) + brake) / (2.0 * acceleration)
        ends.append(there + BEYOND_STOP * stop + LEAST_WAY * side)
    return ends[0], ends[1]


def steered(q: Any, v: Any, share: Any, *, speed: float, acceleration: float) -> Any:
    """Return the targets at which joints move by a share of what they can in the next frame, from -1 to 1.

    The other arguments are as of `motion_range`, whose targets are those of the shares -1 and 1.
    """
    down, up = motion_range(q, v, speed=speed, acceleration=acceleration)
    return down + (up - down) * (share + 1.0) / 2.0


def travel_times(q: Floats, v: Floats, targets: Floats, *, speed: Any, acceleration: Any) -> Floats:
    """Return the least times in which joints come to rest at targets [s], shape (m, n).

    Args:
        q: Where they are [rad], shape (n,) or (m, n).
        v: How fast they are [rad/s], likewise.
        targets: [rad], shape (m, n).
        speed: Limit [rad/s], or one for each angle.
        acceleration: Limit [rad/s^2], or one for each angle.
    """
    way = targets - q
    stop = v * np.abs(v) / (2.0 * acceleration)  # how far they go in braking at once
    side = np.where(way - stop >= 0.0, 1.0, -1.0)
    far, fast = side * way, side * v  # in the direction of the first acceleration
    top = np.minimum(np.sqrt(np.maximum(acceleration * far + fast**2 / 2, 0.0)), speed)
    cruise = np.maximum(far - (2.0 * top**2 - fast**2) / (2.0 * acceleration), 0.0) / speed
    return np.asarray((2.0 * top - fast) / acceleration + cruise)
