"""What the servos are told in the course of a move, planned ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach.checks import Floats
from kinreach.robots import ArmDescription
from kinreach.sim.engine import mujoco


@dataclass(frozen=True, eq=False)
class TrapezoidalProfile:
    """Trapezoids of speed over time, from rest to rest, one for each of m ways; a triangle where a way is short.

    Every entry is computed on its own, by elementwise arithmetic: it does not depend, to the bit, on the other ways.

    Attributes:
        way: How far to go [rad], at least 0, shape (m,).
        speed: Largest speed [rad/s].
        acceleration: Acceleration and deceleration [rad/s^2].
    """

    way: Floats
    speed: float
    acceleration: float

    @cached_property
    def ramp(self) -> Floats:
        """Time from rest to the highest speed [s], shape (m,)."""
        return np.minimum(self.speed / self.acceleration, np.sqrt(self.way / self.acceleration))

    @cached_property
    def duration(self) -> Floats:
        """Time for the whole way [s], shape (m,)."""
        cruise = np.divide(self.way, self.acceleration * self.ramp, out=np.zeros_like(self.way), where=self.ramp > 0)
        return cruise + self.ramp

    def sample(self, times: Floats) -> tuple[Floats, Floats]:
        """How much of the way is covered [rad] and how fast [rad/s], both of shape (k, m), at k times [s]."""
        ramp, end = self.ramp, self.duration
        t = np.minimum(np.maximum(times, 0.0)[:, None], end)
        up, down = np.minimum(t, ramp), np.minimum(end - t, ramp)
        # The ramp up, the constant part and the ramp down, each up to time t.
        ways = up**2 / 2 + ramp * np.maximum(t - ramp, 0.0) - (ramp - down) ** 2 / 2
        return self.acceleration * ways, self.acceleration * np.minimum(up, down)


@dataclass(frozen=True, eq=False)
class Plan:
    """Setpoints of k moves in one phase: straight lines in joint space.

    Attributes:
        target: Where the lines end [rad], shape (k, n).
        setpoints: One per control period [rad], shape (periods, k, n); a move that is planned to take less time than
            others has its target at the end.
        arrival: Index of the setpoint that is the target, shape (k,).
    """

    target: Floats
    setpoints: Floats
    arrival: NDArray[np.intp]


class SetpointPlanner:
    """Plans the setpoints of an arm's servos so that the joints follow a trapezoid profile without delay.

    A servo with stiffness k and damping b moves an inertia M along q(t) if told q + b/k q' + M/k q''. M is that at the
    target: there it matters, what is missing on the way is gone on arrival. Only elementwise arithmetic is used, so
    that a plan does not depend, to the bit, on what else is planned with it.

    Args:
        arm: The arm, whose limits of speed and acceleration are kept.
        model: A scene of it.
        qpos, dof, servos: Where the arm's joints are in MuJoCo's `qpos`, `qvel` and `ctrl`.
        period: Time between two setpoints [s].
    """

    def __init__(self, arm: ArmDescription, model: Any, *, qpos: Any, dof: Any, servos: Any, period: float) -> None:
        self._arm = arm
        self._model = model
        self._qpos = qpos
        self._dof = dof
        self._period = period
        self._stiffness = model.actuator_gainprm[servos, 0]
        self._lag = -model.actuator_biasprm[servos, 2] / self._stiffness
        self._scratch = mujoco.MjData(model)

    def plan(self, state: Floats, points: Sequence[Floats]) -> list[Plan]:
        """Plan k moves of one or more phases.

        Args:
            state: MuJoCo's `qpos`, for the joints that are not the arm's, shape (k, nq).
            points: Postures at the start and at the end of each phase [rad], shapes (k, n).
        """
        phases, count = len(points) - 1, len(state)
        start, target = np.concatenate(points[:-1]), np.concatenate(points[1:])
        way = target - start
        length = np.abs(way).max(axis=1)
        direction = np.divide(way, length[:, None], out=np.zeros_like(way), where=length[:, None] > 0)
        lead = self._inertia_along(np.tile(state, (phases, 1)), target, direction) / self._stiffness
        profile = TrapezoidalProfile(length, self._arm.speed_limit, self._arm.acceleration_limit)
        arrival = np.ceil(profile.duration / self._period).astype(np.intp)
        covered, rate = profile.sample(self._period * np.arange(arrival.max() + 2))
        change = (rate[1:] - rate[:-1]) / self._period
        setpoints = start + covered[1:, :, None] * direction
        setpoints += rate[1:, :, None] * (self._lag * direction)
        setpoints += change[:, :, None] * lead
        rows = [slice(phase * count, (phase + 1) * count) for phase in range(phases)]
        return [Plan(target[these], setpoints[:, these], arrival[these]) for these in rows]

    def _inertia_along(self, state: Floats, q: Floats, direction: Floats) -> Floats:
        """The mass matrices in k postures `q`, each times a direction, shape (k, n)."""
        result = np.empty_like(direction)
        full, product = np.zeros(self._model.nv), np.empty(self._model.nv)
        for row, everything in enumerate(state):
            self._scratch.qpos[:] = everything
            self._scratch.qpos[self._qpos] = q[row]
            mujoco.mj_kinematics(self._model, self._scratch)
            mujoco.mj_comPos(self._model, self._scratch)
            mujoco.mj_makeM(self._model, self._scratch)
            full[self._dof] = direction[row]
            mujoco.mj_mulM(self._model, self._scratch, product, full)
            result[row] = product[self._dof]
        return result
