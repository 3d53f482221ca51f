"""Time each method's motion within the arm's limits, by ruckig."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach._engines import load_extra
from kinreach._statistics import QUANTILES, Column
from kinreach.compare._task import Task
from kinreach.errors import InputError
from kinreach.kinematics import MotionLimits, Trajectory, time_waypoints

#: Samples per second [Hz].
RATE_HZ = 500.0
TABLE = "Motions within the arm's limits"


def _percent(part: str) -> Any:
    return lambda trial: None if trial.get(part) is None else 100.0 * trial[part]


MOTION_COLUMNS = (
    Column("motion_s", "motion_s", QUANTILES, "duration, s\nmedian / p95", "quantiles", TABLE),
    *(
        Column(f"motion_{part}", _percent(f"motion_{part}"), QUANTILES, f"peak {part}\n% of limit", "quantiles", TABLE)
        for part in ("speed", "acceleration", "jerk")
    ),
)


def check_motion(task: Task, env: gym.Env[Any, Any]) -> None:
    """Refuse a task whose arm does not move from posture to posture, and a missing ruckig."""
    if not hasattr(env.unwrapped, "waypoints_to"):
        raise InputError(f"the task {task.name!r} does not move its arm from posture to posture; leave out --motion")
    load_extra("ruckig", "paths")


def with_motion(task: Task) -> Task:
    return replace(task, columns=(*task.columns, *MOTION_COLUMNS))


class MotionRecorder:
    """Collect the postures of an episode, as `watch` of `rollout`."""

    def __init__(self) -> None:
        self._limits: MotionLimits | None = None
        self.points: list[Floats] = []
        self._possible = True

    def __call__(self, env: gym.Env[Any, Any], info: Mapping[str, Any]) -> None:
        if self._limits is None:  # the reset
            self._limits, self.points = MotionLimits.of(env.get_wrapper_attr("arm")), [np.asarray(info["q"])]
            return
        self.points += env.get_wrapper_attr("waypoints_to")(self.points[-1], np.asarray(info["target"]))
        self._possible &= not info["impossible"]

    def measured(self) -> dict[str, Any]:
        """Return entries of the trial; none if an action was impossible."""
        if not self._possible or self._limits is None:
            return {}
        motion = time_waypoints(np.array(self.points), self._limits, rate=RATE_HZ)
        return {
            "motion_s": motion.duration,
            **{f"motion_{name}": share for name, share in peaks(motion, self._limits).items()},
        }


def peaks(motion: Trajectory, limits: MotionLimits) -> dict[str, float]:
    """Return the largest speed, acceleration and jerk of a motion, as shares of the joints' limits.

    Accelerations and jerks are differences of the speeds, from rest to rest.
    """
    around = np.array([-2.0, -1.0]) / RATE_HZ
    times = np.concatenate([motion.t[0] + around, motion.t, motion.t[-1] - around[::-1]])
    speeds = np.pad(motion.qd, ((2, 2), (0, 0)))
    acceleration = np.diff(speeds, axis=0) / np.diff(times)[:, None]
    jerk = np.diff(acceleration, axis=0) / (np.diff(times)[:-1] + np.diff(times)[1:])[:, None] * 2.0
    return {
        "speed": float((np.abs(speeds) / limits.speed).max()),
        "acceleration": float((np.abs(acceleration) / limits.acceleration).max()),
        "jerk": float((np.abs(jerk) / limits.jerk).max()),
    }
