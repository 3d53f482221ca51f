"""A ball that rolls: `kinreach/Moving-v0`, to be touched while it moves, by cameras that see it late.

Thirty times a second the cameras say where the ball was 50 ms ago, and the agent names a posture; the arm goes there
with its own limits of speed and acceleration, joint by joint. The episode is over when the tip is within 10 mm of the
ball's centre, when the ball leaves the table area, or after three seconds. Kinematics with inertia only: no collisions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from kinreach.checks import Floats, as_floats, check_known, check_number, shown
from kinreach.envs.options import about, check_seed, check_started, options_from, takes
from kinreach.envs.real_arm import MEDIAN_LENGTH, NOISE
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics
from kinreach.robots import ArmDescription, get_arm

#: Frames of the cameras a second, and parts of a frame in which the motion is computed.
FRAMES, PARTS = 30, 8
#: How old what the cameras say is [s], how long an episode may be [s], and how near is touching [m].
DELAY, SECONDS, TOUCH = 0.05, 3.0, 0.01
#: Radius of the circles [m]; sideways acceleration of the random walk [m/s^2], and how long it keeps one [s].
RADIUS, SIDEWAYS, HOLD = 0.12, 1.0, 0.25
#: Of the ball, unless the options say otherwise [m/s].
SPEEDS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.6)
#: How far inside the table area a path begins [m].
INSIDE = 0.02
#: Numbers of an observation: the ball as it was last seen, its age [s], joint angles and speeds.
BALL, AGE, ANGLES, RATES = slice(0, 3), 3, slice(4, 10), slice(10, 16)
SIZE = 16
#: The first joint turns a tip at the far end of the table no faster [m/s].
FASTEST = 2.0


def entering(rng: np.random.Generator, low: Floats, high: Floats) -> tuple[Floats, float]:
    """Where a line through a point in the middle half of the area comes in, shape (2,), and its heading [rad]."""
    size = high - low
    through, heading = rng.uniform(low + size / 4, high - size / 4), rng.uniform(0.0, 2.0 * math.pi)
    ahead = np.array([math.cos(heading), math.sin(heading)])
    behind = np.where(ahead > 0.0, through - low, high - through) / np.maximum(np.abs(ahead), 1e-9)
    return np.asarray(through - float(behind.min()) * ahead), heading


def straight(rng: np.random.Generator, speed: float, times: Floats, low: Floats, high: Floats) -> Floats:
    """Across the area, shape (len(times), 2)."""
    start, heading = entering(rng, low, high)
    return np.asarray(start + speed * times[:, None] * np.array([math.cos(heading), math.sin(heading)]))


def circle(rng: np.random.Generator, speed: float, times: Floats, low: Floats, high: Floats) -> Floats:
    """A circle within the area, either way round."""
    centre, first = rng.uniform(low + RADIUS, high - RADIUS), rng.uniform(0.0, 2.0 * math.pi)
    angle = first + rng.choice((-1.0, 1.0)) * speed / RADIUS * times
    return np.asarray(centre + RADIUS * np.column_stack([np.cos(angle), np.sin(angle)]))


def random_walk(rng: np.random.Generator, speed: float, times: Floats, low: Floats, high: Floats) -> Floats:
    """As `straight` to begin with; then with a sideways acceleration that is drawn anew again and again.

    Outside of the middle half of the area it turns the ball towards the middle.
    """
    (x, y), heading = entering(rng, low, high)
    draws = rng.uniform(-SIDEWAYS, SIDEWAYS, math.ceil(times[-1] / HOLD) + 1)[(times / HOLD).astype(int)].tolist()
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
class MovingOptions:
    """Options of `kinreach/Moving-v0`.

    Raises:
        UnknownNameError: A path that there is not.
        InputError: A speed that the arm cannot follow, or another number out of range.
    """

    speeds: tuple[float, ...] = field(default=SPEEDS, metadata=about("of the ball, one of them an episode [m/s]"))
    paths: tuple[str, ...] = field(default=tuple(PATHS), metadata=about(f"one of them an episode: {', '.join(PATHS)}"))
    delay: float = field(default=DELAY, metadata=about("how old what the cameras say is [s]"))
    noise: float = field(default=NOISE, metadata=about("median error of a sight [m]"))

    def __post_init__(self) -> None:
        for name in ("speeds", "paths"):
            given: Any = getattr(self, name)
            if isinstance(given, str) or not isinstance(given, Sequence) or not given:
                raise InputError(f"{name} must be a list of at least one, got {shown(given)}")
            object.__setattr__(self, name, tuple(given))
        for speed in self.speeds:
            check_speed(speed)
        for path in self.paths:
            check_known("path", path, PATHS)
        check_number("delay [s]", self.delay, least=0.0, most=1.0)
        check_number("noise [m]", self.noise, least=0.0, most=0.1)


def check_speed(speed: object) -> float:
    """A speed of the ball [m/s] that the arm can follow.

    Raises:
        InputError: It is none.
    """
    value = check_number("the ball's speed [m/s]", speed, above=0.0)
    if value > FASTEST:
        raise InputError(f"the ball's speed must be at most {FASTEST:g} m/s: the arm's tip is no faster, got {value:g}")
    return value


@takes(MovingOptions)
class MovingBallEnv(gym.Env[Any, Any]):
    """A UR5 that is to touch a rolling ball; the module says what an episode is.

    An action is a posture to go to, each angle divided by pi, shape (6,). An observation, shape (16,): where the ball
    was last seen [m] (3), how long ago that was [s], joint angles [rad] (6) and speeds [rad/s] (6). The reward of a
    step is minus the least distance of tip and ball during it [m], and 1 more for touching. `info`: `goal`, where the
    ball is [m], `q`, where the joints are [rad], `distance`, the least so far [m], `time` [s], `speed` [m/s] and `path`
    of the ball; `is_success`: it was touched; after a step `reward_terms`, which sum to the reward.

    <table of the options>
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (declared by Gymnasium)
    render_mode = None

    def __init__(self, **options: Any) -> None:
        self.options = given = options_from(MovingOptions, options)
        self.arm: ArmDescription = (arm := get_arm("ur5"))
        self._chain = ArmKinematics(arm, tip="tcp", base="world").chain
        self.home, self.speed_limit, self.acceleration_limit = (
            np.array(arm.home),
            arm.speed_limit,
            arm.acceleration_limit,
        )
        region: Any = arm.workcell.goals
        self._low, self._high = np.array([region.x, region.y]).T
        self.height = region.z[0]
        self._noise = given.noise / MEDIAN_LENGTH
        high = np.array([2.0, 2.0, 2.0, 2.0, *6 * [math.pi], *6 * [arm.speed_limit]])
        self.observation_space = spaces.Box(np.where(np.arange(SIZE) == AGE, 0.0, -high), high, dtype=np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (6,))
        self._started = False

    @property
    def noise(self) -> float:
        """Standard deviation of each coordinate of a sight [m]."""
        return self._noise

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Another ball; the arm rests in its start posture.

        Args:
            seed: Of the path and the cameras' noise.
            options: `"speed"` [m/s] and `"path"`: instead of drawn ones.

        Raises:
            InputError: A seed that is none, an unknown option, or a speed that the arm cannot follow.
            UnknownNameError: A path that there is not.
        """
        super().reset(seed=check_seed(seed))
        rng, given = self.np_random, dict(options or {})
        drawn = {"speed": rng.choice(self.options.speeds), "path": str(rng.choice(self.options.paths))}
        if unknown := [name for name in given if name not in drawn]:
            raise InputError(f"unknown reset options {shown(unknown)}; available: {', '.join(drawn)}")
        chosen = {**drawn, **given}
        speed = check_speed(chosen["speed"])
        check_known("path", chosen["path"], PATHS)
        times = np.arange(round(SECONDS * FRAMES) * PARTS + 1) / (FRAMES * PARTS)
        places = PATHS[chosen["path"]](rng, speed, times, self._low + INSIDE, self._high - INSIDE)
        self._path = np.column_stack([places, np.full(len(places), self.height)])
        away = np.flatnonzero(((places < self._low) | (places > self._high)).any(axis=1))
        self._end = int(away[0]) if len(away) else len(places) - 1
        self._frame, self._q, self._v = 0, self.home.copy(), np.zeros(6)
        self._info = {"speed": speed, "path": chosen["path"], "distance": math.inf, "impossible": False}
        self._started = True
        return self._observation(), self._told()

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """A frame.

        Raises:
            InputError: Wrong shape, a value that is not finite, or a step before the first reset.
        """
        check_started(self._started)
        given = as_floats("action", action)
        if given.shape != (6,) or not np.isfinite(given).all():
            raise InputError(f"action must be finite and have shape (6,), got {given.shape}")
        target, dt = math.pi * np.clip(given, -1.0, 1.0), 1.0 / (FRAMES * PARTS)
        first = self._frame * PARTS
        postures = np.empty((PARTS, 6))
        for part in range(PARTS):
            self._q, self._v = moved(
                self._q, self._v, target, dt, speed=self.speed_limit, acceleration=self.acceleration_limit
            )
            postures[part] = self._q
        balls = self._path[first + 1 : first + PARTS + 1][: max(self._end - first, 1)]
        apart = np.linalg.norm(self._chain.positions(postures)[: len(balls)] - balls, axis=1)
        nearest = float(apart.min())
        self._frame += 1
        touched = nearest <= TOUCH
        self._info["distance"] = min(self._info["distance"], nearest)
        self._info["is_success"] = bool(touched)
        self._info["reward_terms"] = {"distance": -nearest, "touch": float(touched)}
        gone = self._frame * PARTS >= self._end
        return self._observation(), touched - nearest, bool(touched or gone), False, self._told()

    def _told(self) -> dict[str, Any]:
        place = self._path[min(self._frame * PARTS, self._end)]
        return {**self._info, "goal": place, "q": self._q.copy(), "time": self._frame / FRAMES}

    def _observation(self) -> Floats:
        """The sight that has just come in: before the first was taken, the first."""
        late = round(self.options.delay * FRAMES * PARTS)
        taken = max(self._frame * PARTS - late, 0)
        seen = self._path[min(taken, self._end)] + self.np_random.normal(0.0, self._noise, 3)
        age = (self._frame * PARTS - taken) / (FRAMES * PARTS)
        return np.concatenate([seen, [age], self._q, self._v])


def moved(
    q: Floats, v: Floats, target: Floats, dt: float, *, speed: float, acceleration: float
) -> tuple[Floats, Floats]:
    """Angles and speeds after a short time on the way to a target, each joint as fast as it can and still stop there.

    Args:
        q: Angles now [rad].
        v: Speeds now [rad/s].
        target: [rad].
        dt: Time [s].
        speed: Limit [rad/s].
        acceleration: Limit [rad/s^2].
    """
    way = target - q
    # the largest speed from which it stops at the target, braking from the next moment on
    brake = acceleration * dt
    wanted = np.sign(way) * np.minimum(speed, np.sqrt(brake**2 / 4 + 2.0 * acceleration * np.abs(way)) - brake / 2)
    wanted = np.where(np.abs(way) < 0.5 * brake * dt, way / dt, wanted)
    v = v + np.clip(wanted - v, -brake, brake)
    return q + dt * v, v
