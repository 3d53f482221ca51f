"""Solve the button task with a model: closed-form inverse kinematics and computed torque.

The closed form gives the posture for the target. The wanted speed of each joint is v = clip(k (q_target - q), +-v_max);
the acceleration towards it with a time constant T, a = (v - qd) / T, needs the torque
RNEA(q, qd, a) + damping qd. An action moves each control by at most one unit towards torque / gear. The button is
pressed when the model predicts that this action brings the end effector to the target.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, check_known
from kinreach._engines import load
from kinreach._rotations import wrapped
from kinreach.envs.inside import ACTUATIONS, button_task
from kinreach.errors import InputError
from kinreach.kinematics import Arm3Kinematics

pin: Any = load("pinocchio")

#: Subtracted from the press radius in the decision to press [m].
PRESS_MARGIN = 0.005
#: Distance from the target below which a press is considered [m]; no step of a controlled arm is as long.
LOOK_RADIUS = 0.3


@dataclass(frozen=True)
class Gains:
    """Gains from a joint's error to its acceleration.

    Attributes:
        stiffness: k [1/s].
        speed: v_max [rad/s].
        time_constant: T [s].
    """

    stiffness: tuple[float, float, float]
    speed: tuple[float, float, float]
    time_constant: tuple[float, float, float]


#: By actuation. Full torque of the report's base turns it at 1.46 rad/s.
GAINS = {
    "tuned": Gains((3.0, 3.0, 3.0), (3.0, 2.0, 3.0), (0.12, 0.12, 0.12)),
    "report": Gains((8.0, 8.0, 8.0), (1.4, 3.0, 4.0), (0.02, 0.04, 0.04)),
}


class ButtonController:
    """Control `count` arms by their observations.

    It reads the controls if they are observed (`controls=True`), else it adds up its own actions.
    """

    def __init__(self, actuation: str = "tuned", *, count: int = 1) -> None:
        check_known("actuation", actuation, ACTUATIONS)
        self._actuation = ACTUATIONS[actuation]
        gains = GAINS[actuation]
        self._stiffness, self._speed, self._time_constant = map(
            np.array, (gains.stiffness, gains.speed, gains.time_constant)
        )
        self._gears, self._damping = np.array(self._actuation.gears), np.array(self._actuation.damping)
        self._kinematics = Arm3Kinematics(base="world")
        self._model = self._kinematics.model.copy()
        self._model.armature = np.array(self._actuation.armature)
        self._data = self._model.createData()
        self._fresh = np.ones(count, dtype=np.bool_)
        self._control, self._q, self._target = np.zeros((3, count, button_task.JOINTS))

    def restart(self, ids: Any = slice(None)) -> None:
        self._fresh[ids] = True

    def actions(self, observations: Floats) -> NDArray[np.intp]:
        """Return an action for each environment from observations, (count, 19), or (count, 22) with the controls."""
        if len(observations) != len(self._fresh):
            raise InputError(f"needs {len(self._fresh)} observations, got {len(observations)}")
        qd, goals = observations[:, 12:15], observations[:, 6:9]
        self._follow(np.arctan2(observations[:, 3:6], observations[:, :3]), goals)
        if observations.shape[1] > button_task.OBSERVATIONS:
            self._control = observations[:, button_task.OBSERVATIONS :].copy()
        speed = np.clip(self._stiffness * (self._target - self._q), -self._speed, self._speed)
        acceleration = (speed - qd) / self._time_constant
        torque = self._damping * qd
        for row, state in zip(torque, zip(self._q, qd, acceleration, strict=True), strict=True):
            row += pin.rnea(self._model, self._data, *state)
        wanted = np.clip(torque / self._gears, -button_task.CONTROL_LIMIT, button_task.CONTROL_LIMIT)
        change = np.clip(np.rint(wanted - self._control), -1, 1)
        self._control += change
        distance = np.linalg.norm(observations[:, 15:18], axis=1)
        if self._actuation.press_first:
            return button_task.action_of(change, distance < button_task.PRESS_RADIUS - PRESS_MARGIN)
        press = np.zeros(len(qd), dtype=np.bool_)
        for row in np.flatnonzero(distance < LOOK_RADIUS):
            tip = self._next_tip(self._q[row], qd[row], self._control[row] * self._gears)
            press[row] = np.linalg.norm(tip - goals[row]) < button_task.PRESS_RADIUS - PRESS_MARGIN
        return button_task.action_of(change, press)

    def _follow(self, angles: Floats, goals: Floats) -> None:
        """Unwrap the joint angles, and choose a posture for each new target."""
        self._q += wrapped(angles - self._q)
        new = np.flatnonzero(self._fresh)
        if len(new):
            self._fresh[new] = False
            self._control[new], self._q[new] = 0.0, angles[new]
            self._target[new] = self._soonest(goals[new], angles[new])

    def _soonest(self, goals: Floats, start: Floats) -> Floats:
        """Return for each target the posture that reaches it soonest, or the start if there is none."""
        postures = self._kinematics.batch(goals)
        time = (np.abs(postures.q - start[:, None]) / self._speed).max(axis=2)
        time[~postures.valid] = np.inf
        rows, best = np.arange(len(goals)), time.argmin(axis=1)
        found = np.isfinite(time[rows, best])
        return np.where(found[:, None], postures.q[rows, best], start)

    def _next_tip(self, q: Floats, qd: Floats, torque: Floats) -> Floats:
        """Return where the end effector is after one step of the environment under a torque [m], shape (3,)."""
        dt = self._actuation.timestep
        for _ in range(self._actuation.frame_skip):
            qd = qd + dt * pin.aba(self._model, self._data, q, qd, torque - self._damping * qd)
            q = q + dt * qd
        return self._kinematics.fk(q)[:3, 3]


class AnalyticButtonPolicy:
    """`ButtonController` for one environment, as a `kinreach.baselines._loop.Policy`.

    Args:
        actuation: `"tuned"` or `"report"`, as the environment has it.

    Raises:
        UnknownNameError: Unknown actuation.
    """

    def __init__(self, actuation: str = "tuned") -> None:
        self._controller = ButtonController(actuation)

    def reset(self, observation: Floats, info: Mapping[str, Any]) -> None:
        """Begin an episode with another target."""
        self._controller.restart()

    def act(self, observation: Floats) -> int:
        """Return the action for an observation."""
        return int(self._controller.actions(np.asarray(observation)[None])[0])
