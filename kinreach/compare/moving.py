"""Touching a rolling ball: the closed form with an old sight, and with a forecast of where ball and arm can meet."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from kinreach.baselines.expert import tool_down_postures
from kinreach.checks import Floats
from kinreach.compare.button import decision_ms
from kinreach.compare.figures import colours_in, origin
from kinreach.compare.methods import policy_method
from kinreach.compare.task import CONTROLLER, Method, Task
from kinreach.envs import moving as ball
from kinreach.envs.moving import passing_times, travel_times
from kinreach.kinematics import UR5Kinematics
from kinreach.plots.style import key, label_ends, new_figure
from kinreach.registration import MOVING
from kinreach.statistics import wilson_interval
from kinreach.summary import QUANTILES, RATE, Column, Trial, thousandfold

#: Before the first sight: standard deviations of the ball's speed [m/s] and acceleration [m/s^2]; and how much that
#: changes in a root of a second [m/s^2.5].
SPEED, ACCELERATION, JERK = 0.5, 1.0, 1.0
#: Title of the second table.
TIME_TABLE = "Distances and times"
#: Sights that are observed: as many as the policies were trained with.
SIGHTS = 6
#: How far ahead a meeting is looked for [s], and in how many steps: 3 mm at the highest speed.
AHEAD, STEPS = 1.0, 200


class _Closed:
    """The closed form on the UR5, from the world to the tip."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._env: Any = env.unwrapped
        self._kinematics = UR5Kinematics(tip="tcp", base="world")

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Another ball."""
        self._target = np.array(info["q"])

    def _go(self, place: Floats) -> Floats:
        """The action for a place of the ball; the one before where nothing reaches it."""
        posture = tool_down_postures(self._kinematics, place[None])[0]
        if np.isfinite(posture).all():
            self._target = posture
        return self._target / math.pi


class FirstSight(_Closed):
    """Goes to where the ball was first seen: the open loop."""

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Another ball, which is looked at now."""
        super().reset(observation, info)
        self._action = self._go(observation[ball.BALL])

    def act(self, observation: Any) -> Floats:
        """There."""
        return self._action


class LastSight(_Closed):
    """Goes to where the ball was last seen."""

    def act(self, observation: Any) -> Floats:
        """There."""
        return self._go(observation[ball.BALL])


class Interception(_Closed):
    """Goes to the first place where ball and arm can be at the same time: to rest there, or else in passing.

    A Kalman filter of place, speed and acceleration forecasts the ball; how long the arm takes to a place follows from
    the limits of its joints. Both are asked again with every sight. Where there is no meeting, it goes where it is the
    least late. Numbers were chosen with balls of seed 1.
    """

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Another ball."""
        super().reset(observation, info)
        self._filter = KalmanFilter(self._env.noise)
        self._time = 0.0

    def act(self, observation: Any) -> Floats:
        """Towards the meeting."""
        age = float(observation[ball.AGE])
        self._filter.see(self._time - age, observation[ball.BALL])
        self._time += 1.0 / ball.FRAMES
        ahead = np.linspace(0.0, AHEAD, STEPS + 1)
        places = self._filter.forecast(age + ahead)
        places[:, 2] = self._env.height  # it rolls on the table
        postures = tool_down_postures(self._kinematics, places)
        known = np.isfinite(postures).all(axis=1)
        if not known.any():
            return self._target / math.pi
        postures, ahead = postures[known], ahead[known]
        limits = {"speed": self._env.speed_limit, "acceleration": self._env.acceleration_limit}
        arm = observation[ball.ANGLES], observation[ball.RATES]
        resting = travel_times(*arm, postures, **limits)
        meets = np.flatnonzero(resting.max(axis=1) <= ahead)
        if len(meets):
            self._target = postures[meets[0]]
            return self._target / math.pi
        passing, fast = passing_times(*arm, postures, **limits)
        late = passing.max(axis=1) - ahead
        at = np.flatnonzero(late <= 0.0)[0] if (late <= 0.0).any() else int(late.argmin())
        beyond = fast[at] * np.abs(fast[at]) / (2.0 * limits["acceleration"])  # who stops there is not slow before
        self._target = postures[at] + np.where(resting[at] > ahead[at], beyond, 0.0)
        return self._target / math.pi


class KalmanFilter:
    """Place, speed and acceleration of a ball, each coordinate by itself, with a white jerk.

    Args:
        noise: Standard deviation of a coordinate of a sight [m].
    """

    def __init__(self, noise: float) -> None:
        self._noise = max(noise, 1e-6)
        self._time: float | None = None
        self._state = np.zeros((3, 3))  # place, speed and acceleration by coordinate
        self._P: Floats = np.diag([1.0, SPEED**2, ACCELERATION**2])

    def see(self, time: float, place: Floats) -> None:
        """A sight [m] that was taken at a time [s], not before the last one."""
        if self._time is None:
            self._state[0] = place
        else:
            dt = time - self._time
            F = _motion(np.array([dt]))[0]
            Q = JERK**2 * np.array(
                [
                    [dt**5 / 20, dt**4 / 8, dt**3 / 6],
                    [dt**4 / 8, dt**3 / 3, dt**2 / 2],
                    [dt**3 / 6, dt**2 / 2, dt],
                ]
            )
            self._state, self._P = F @ self._state, F @ self._P @ F.T + Q
        gain = self._P[:, 0] / (self._P[0, 0] + self._noise**2)
        self._state = self._state + gain[:, None] * (place - self._state[0])
        self._P = self._P - gain[:, None] * self._P[0]
        self._time = time

    def forecast(self, ahead: Floats) -> Floats:
        """Where the ball will be [m], shape (n, 3), so long after the last sight [s], shape (n,)."""
        return np.asarray((_motion(ahead) @ self._state)[:, 0])


def _motion(dt: Floats) -> Floats:
    """How place, speed and acceleration follow from those before, shape (n, 3, 3)."""
    F = np.tile(np.eye(3), (len(dt), 1, 1))
    F[:, 0, 1] = F[:, 1, 2] = dt
    F[:, 0, 2] = dt**2 / 2
    return F


def _resets(count: int, seed: int, env: gym.Env[Any, Any]) -> list[dict[str, Any]]:
    """All paths at the first speed, then at the next, and so on with other balls."""
    options: ball.MovingOptions = env.unwrapped.options  # type: ignore[attr-defined]
    cases = [(speed, path) for speed in options.speeds for path in options.paths]
    return [
        {
            "seed": int(np.random.SeedSequence(seed, spawn_key=(index // len(cases),)).generate_state(1)[0]),
            "options": dict(zip(("speed", "path"), cases[index % len(cases)], strict=True)),
        }
        for index in range(count)
    ]


def touched(*, speed: float | None = None, path: str | None = None) -> Callable[[Trial], bool | None]:
    """Whether a trial's ball was touched; None where it rolled otherwise."""

    def value(trial: Trial) -> bool | None:
        other = (speed is not None and trial["speed"] != speed) or (path is not None and trial["path"] != path)
        return None if other else bool(trial["reached"])

    return value


def _touched_at(trial: Trial) -> float | None:
    """When the ball was touched [s]."""
    return trial["time"] if trial["reached"] else None


def _rates(group: str, path: str | None, table: str) -> list[Column]:
    return [
        Column(f"{group}.{speed}", touched(speed=speed, path=path), RATE, f"{speed:g}\nm/s", "share", table)
        for speed in ball.SPEEDS
    ]


def draw_speeds(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Share of balls that are touched against their speed, a line a method, with Wilson's 95 % interval."""
    figure, (axes,) = new_figure("Rolling balls that are touched", size=(7.6, 4.4), note=origin(results), grid="both")
    names = [method["name"] for method in results["methods"]]
    colours = dict(zip(names, colours_in(results), strict=True))
    speeds = sorted({trial["speed"] for trial in trials})
    ends = {}
    for rank, name in enumerate(names):
        rates = []
        for speed in speeds:
            own = [trial["reached"] for trial in trials if trial["method"] == name and trial["speed"] == speed]
            rates.append((np.mean(own), *wilson_interval(sum(own), len(own))))
        rate, low, high = 100 * np.array(rates).T
        at = np.array(speeds) + 0.004 * rank  # side by side, so that equal methods do not hide each other
        axes.errorbar(
            at, rate, np.maximum([rate - low, high - rate], 0.0), color=colours[name], marker="o", ms=4, lw=1.6,
            elinewidth=1,
        )  # fmt: skip
        ends[name] = (at[-1], rate[-1])
    axes.set(xlim=(0.0, max(speeds) * 1.03), ylim=(-3, 103), xlabel="speed of the ball [m/s]")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    label_ends(axes, ends, colours)
    key(axes, "share of balls, all three kinds of paths, with 95 % intervals")
    return figure


MOVING_TASK = Task(
    name="moving",
    title="A UR5 and a rolling ball",
    environment=MOVING,
    options={"sights": SIGHTS},
    variants={"moving": MOVING},
    resets=_resets,
    methods={
        "first-sight": Method(FirstSight, CONTROLLER, colour="#7A7A7A"),
        "last-sight": Method(LastSight, CONTROLLER, colour="#0072B2"),
        "interception": Method(Interception, CONTROLLER, colour="#003F66"),
        "policy": policy_method("moving", MOVING, colour="#00674C"),
        "ppo": policy_method("ppo-moving", MOVING, colour="#D55E00"),
    },
    columns=(
        Column("reached", "reached", RATE, "all, %\n[95 % CI]", "interval"),
        *_rates("touched", None, ""),
        *(column for path in ball.PATHS for column in _rates(path, path, f"Paths: {path}")),
        Column("distance_mm", thousandfold("distance"), QUANTILES, "least\ndistance, mm", "quantiles", TIME_TABLE),
        Column("time_s", _touched_at, QUANTILES, "time to\ntouch, s", "median", TIME_TABLE),
        Column("solve_ms", decision_ms, QUANTILES, "a decision\nms", "median", TIME_TABLE),
    ),
    figures={"speeds": draw_speeds},
    reached="within 10 mm of the ball's centre before it leaves the table area, in 3 s at most",
    terms={
        "goal": "a ball that rolls over the table: straight on, on a circle of 0.12 m, or with a sideways acceleration "
        f"within {ball.SIDEWAYS:g} m/s² that is drawn anew every {ball.HOLD:g} s",
        "sight": f"{ball.FRAMES} a second, {1e3 * ball.DELAY:g} ms old, 0.14 mm off in the median",
        "arm": "a UR5 whose joints keep their limits of speed and acceleration; no collisions",
        "distance": "the least of tip and ball's centre in the episode",
    },
)

TASKS = (MOVING_TASK,)
