"""Touch a rolling ball by closed-form kinematics: where it was seen, or where a Kalman filter predicts it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach.baselines._expert import tool_down_postures
from kinreach.envs import _moving as ball
from kinreach.envs._moving import passing_times, travel_times
from kinreach.kinematics import UR5Kinematics

#: Prior standard deviations of the ball's speed [m/s] and acceleration [m/s^2], and the intensity of the white jerk
#: [m/s^2.5].
SPEED, ACCELERATION, JERK = 0.5, 1.0, 1.0
#: Horizon of the forecast [s] and its number of steps: 3 mm a step at the highest speed.
HORIZON, STEPS = 1.0, 200


class _ClosedForm:
    """The closed form of the UR5 from the world to the tip, with the tool straight down."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._env: Any = env.unwrapped
        self._kinematics = UR5Kinematics(tip="tcp", base="world")

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Stay in the posture in which the episode starts."""
        self._target = np.array(info["q"])

    def _go(self, place: Floats) -> Floats:
        """Return the action for a place of the ball; the previous one if no posture reaches it."""
        posture = tool_down_postures(self._kinematics, place[None])[0]
        if np.isfinite(posture).all():
            self._target = posture
        return self._target / math.pi


class FirstSight(_ClosedForm):
    """Go to where the ball was first seen: the open loop."""

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Solve for the first sight."""
        super().reset(observation, info)
        self._action = self._go(observation[ball.BALL])

    def act(self, observation: Any) -> Floats:
        """Repeat the first action."""
        return self._action


class LastSight(_ClosedForm):
    """Go to where the ball was last seen."""

    def act(self, observation: Any) -> Floats:
        """Solve for the last sight."""
        return self._go(observation[ball.BALL])


class Interception(_ClosedForm):
    """Go to the first place where ball and arm can be at the same time: to rest there, or else in passing.

    A Kalman filter of place, speed and acceleration forecasts the ball; how long the arm takes to a place follows from
    the limits of its joints. Both are evaluated again with every sight. Without a meeting, it goes where it is the
    least late. Its parameters were chosen with balls of seed 1.
    """

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Start a new filter."""
        super().reset(observation, info)
        self._filter = KalmanFilter(self._env.noise)
        self._time = 0.0

    def act(self, observation: Any) -> Floats:
        """Go towards the meeting."""
        age = float(observation[ball.AGE])
        self._filter.see(self._time - age, observation[ball.BALL])
        self._time += 1.0 / ball.FRAMES
        ahead = np.linspace(0.0, HORIZON, STEPS + 1)
        places = self._filter.forecast(age + ahead)
        places[:, 2] = self._env.height  # it rolls on the table
        postures = tool_down_postures(self._kinematics, places)
        reachable = np.isfinite(postures).all(axis=1)
        if not reachable.any():
            return self._target / math.pi
        postures, ahead = postures[reachable], ahead[reachable]
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
        beyond = fast[at] * np.abs(fast[at]) / (2.0 * limits["acceleration"])  # stopping there does not slow it before
        self._target = postures[at] + np.where(resting[at] > ahead[at], beyond, 0.0)
        return self._target / math.pi


class KalmanFilter:
    """Filter a ball's place, speed and acceleration, each coordinate by itself, with a white jerk.

    Args:
        noise: Standard deviation of a coordinate of a sight [m].
    """

    def __init__(self, noise: float) -> None:
        self._noise = max(noise, 1e-6)
        self._time: float | None = None
        self._state = np.zeros((3, 3))  # place, speed and acceleration by coordinate
        self._P: Floats = np.diag([1.0, SPEED**2, ACCELERATION**2])

    def see(self, time: float, place: Floats) -> None:
        """Update with a sight [m] that was taken at a time [s], not before the last one."""
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
        """Return the ball's places [m], shape (n, 3), at times after the last sight [s], shape (n,)."""
        return np.asarray((_motion(ahead) @ self._state)[:, 0])


def _motion(dt: Floats) -> Floats:
    """Return the matrices from place, speed and acceleration to those a time later, shape (n, 3, 3)."""
    F = np.tile(np.eye(3), (len(dt), 1, 1))
    F[:, 0, 1] = F[:, 1, 2] = dt
    F[:, 0, 2] = dt**2 / 2
    return F
