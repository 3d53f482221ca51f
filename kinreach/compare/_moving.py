"""Touching a rolling ball: the closed form at an old sight or with a forecast, and policies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._registration import MOVING
from kinreach._statistics import QUANTILES, RATE, Column, Trial, thousandfold
from kinreach.compare._button import decision_ms
from kinreach.compare._curves import draw_speeds
from kinreach.compare._methods import policy_method
from kinreach.compare._methods.interception import FirstSight, Interception, LastSight
from kinreach.compare._task import CONTROLLER, Method, Task
from kinreach.envs import _moving as ball

#: Title of the second table.
TIME_TABLE = "Distances and times"
#: Sights that are observed: as many as the policies were trained with.
SIGHTS = 6


def _resets(count: int, seed: int, env: gym.Env[Any, Any]) -> list[dict[str, Any]]:
    """Return all paths at the first speed, then at the next, and so on with other balls."""
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
    """Return a function of a trial: whether the ball was touched, None if it rolled otherwise."""

    def value(trial: Trial) -> bool | None:
        other = (speed is not None and trial["speed"] != speed) or (path is not None and trial["path"] != path)
        return None if other else bool(trial["reached"])

    return value


def _touched_at(trial: Trial) -> float | None:
    """Return when the ball was touched [s]."""
    return trial["time"] if trial["reached"] else None


def _rates(group: str, path: str | None, table: str) -> list[Column]:
    return [
        Column(f"{group}.{speed}", touched(speed=speed, path=path), RATE, f"{speed:g}\nm/s", "share", table)
        for speed in ball.SPEEDS
    ]


MOVING_TASK = Task(
    name="moving",
    title="A UR5 and a rolling ball",
    environment=MOVING,
    options={"sights": SIGHTS},
    variants={"moving": MOVING},
    resets=_resets,
    methods={
        "first-sight": Method(FirstSight, CONTROLLER),
        "last-sight": Method(LastSight, CONTROLLER),
        "interception": Method(Interception, CONTROLLER),
        "policy": policy_method("moving", MOVING),
        "ppo": policy_method("ppo-moving", MOVING),
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
