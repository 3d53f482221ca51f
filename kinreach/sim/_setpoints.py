"""Setpoints of the servos in a move: planned ahead, and followed until the arm stands.

`SetpointPlanner` lays a synchronous trapezoid profile over the way of all joints; `Following` gives its setpoints to
the servos, one every control period, and determines whether the arm arrives, is blocked, or is late.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.robots import ArmDescription
from kinreach.sim._engine import mujoco
from kinreach.sim._imperfections import encoder_errors
from kinreach.sim._plants import ArmJoints, Ids, Plant, rows_and_columns

#: Time between two setpoints [s].
CONTROL_PERIOD = 0.008
#: Setpoints between two checks whether an arm has arrived, and between two whether it is held up.
ARRIVAL_CHECK, STALL_CHECK = 2, 10
#: An arm in which no joint is faster than this has come to rest [rad/s]. The slowest servo still creeps by this times
#: its time constant of 0.07 s, 4e-5 rad; at 0.002 rad/s the tip would be read up to 0.5 mm from where it will stay.
REST_SPEED = 0.0005
#: An arm in which no joint is faster than this [rad/s] at so many checks in a row (0.2 s), off its target, is blocked.
STALL_SPEED = 0.02
STALL_CHECKS = 3
#: How long the arm may take to arrive after its setpoint has [s].
PATIENCE = 2.0
#: How following ended; `JointController.move` finds that a simulation has diverged.
MOVING, ARRIVED, STALLED, LATE, DIVERGED = range(5)
#: A time that does not come.
NEVER = np.iinfo(np.intp).max // 2


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
        """Return how much of the way is covered [rad] and how fast [rad/s], both of shape (k, m), at k times [s]."""
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


def servo_response(model: Any, servos: Any) -> tuple[Floats, Floats]:
    """Return the stiffness of position servos [N m/rad], and how far they lag behind at a speed of 1 rad/s [s]."""
    stiffness = model.actuator_gainprm[servos, 0]
    return stiffness, -model.actuator_biasprm[servos, 2] / stiffness


class SetpointPlanner:
    """Plans the setpoints of an arm's servos so that the joints follow a trapezoid profile without delay.

    A servo with stiffness k and damping b moves an inertia M along q(t) with the setpoint q + b/k q' + M/k q''. M is
    that at the target: an error on the way is gone on arrival. Only elementwise arithmetic is used, so that a plan does
    not depend, to the bit, on what else is planned with it.
    """

    def __init__(self, arm: ArmDescription, model: Any, *, joints: ArmJoints, servos: Any, period: float) -> None:
        self._arm = arm
        self._model = model
        self._joints = joints
        self._period = period
        self._stiffness, self._lag = servo_response(model, servos)
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

    def settling(self, state: Floats, q: Floats) -> float:
        """Return the time constant of the slowest motion of the servos in a posture [rad], shape (n,), by damping [s].

        Args:
            state: MuJoCo's `qpos`, for the joints that are not the arm's, shape (nq,).
            q: Posture [rad], shape (n,).
        """
        count = len(q)
        inertia = self._inertia_along(np.tile(state, (count, 1)), np.tile(q, (count, 1)), np.eye(count))
        root = np.sqrt(self._stiffness * self._lag)
        return float(np.linalg.eigvalsh(inertia / root / root[:, None])[-1])

    def _inertia_along(self, state: Floats, q: Floats, direction: Floats) -> Floats:
        """The mass matrices in k postures `q`, each times a direction, shape (k, n)."""
        result = np.empty_like(direction)
        full, product = np.zeros(self._model.nv), np.empty(self._model.nv)
        for row, everything in enumerate(state):
            self._scratch.qpos[:] = everything
            self._joints.put(self._scratch.qpos[None], slice(None), q[row])
            mujoco.mj_kinematics(self._model, self._scratch)
            mujoco.mj_comPos(self._model, self._scratch)
            mujoco.mj_makeM(self._model, self._scratch)
            self._joints.spread(direction[row], full)
            mujoco.mj_mulM(self._model, self._scratch, product, full)
            result[row] = self._joints.gathered(product)
        return result


@dataclass(frozen=True, eq=False)
class Following:
    """How setpoints are followed.

    Attributes:
        qpos, dof, servos: Where the arm's joints are in MuJoCo's `qpos`, `qvel` and `ctrl`; slices or arrays of ints.
        tolerance: How far from its target a joint may come to rest [rad].
        timestep: Step of the simulation [s].
        encoder_noise: Standard deviation of the servos' readings of their joints [rad]; an error of a reading is
            subtracted from the setpoint.
    """

    qpos: Any
    dof: Any
    servos: Any
    tolerance: float
    timestep: float
    encoder_noise: float = 0.0

    @property
    def substeps(self) -> int:
        return max(1, round(CONTROL_PERIOD / self.timestep))

    @property
    def period(self) -> float:
        """Time between two setpoints [s]."""
        return self.substeps * self.timestep

    def run(self, plant: Plant, ids: Ids, phases: Sequence[Plan], noise: Floats | None = None) -> NDArray[np.int8]:
        """Move simulations through the phases of their plans, each until it stands or does not arrive.

        A phase but the last is over as soon as the arm is within the tolerance. At the end of the last it has to come
        to rest (or, leaning on something, hardly move any more).

        Args:
            plant: The simulations.
            ids: Which of them to move, ascending, shape (k,).
            phases: Plans for these k simulations.
            noise: Encoder noise of each of them [rad], shape (k,); None where all have the same.

        Returns:
            ARRIVED, STALLED or LATE for each, shape (k,).
        """
        noise = np.full(len(ids), self.encoder_noise) if noise is None else noise
        return _Run(self, plant, ids, phases, noise).finish()


class _Run:
    """The state of one `Following.run`. Times are counted in control periods from its start; arrays have k rows."""

    def __init__(self, rule: Following, plant: Plant, ids: Ids, phases: Sequence[Plan], noise: Floats) -> None:
        self.rule, self.plant, self.ids, self.phases = rule, plant, ids, phases
        self.patience = round(PATIENCE / rule.period)
        rows: Any = slice(None) if len(ids) == len(plant.ctrl) else ids
        self.at_qpos, self.at_dof = rows_and_columns(rows, rule.qpos), rows_and_columns(rows, rule.dof)
        longest = sum(len(plan.setpoints) for plan in phases) + self.patience * (len(phases) - 1)
        longest += self.patience if noise.any() else 0
        self.line = np.empty((longest, len(ids), phases[0].target.shape[1]))
        self.misread: Floats | None = None
        if noise.any():
            starts = plant.qpos[self.at_qpos]
            self.misread = np.stack(
                [
                    encoder_errors(sigma, start, target, longest)
                    for sigma, start, target in zip(noise, starts, phases[-1].target, strict=True)
                ],
                axis=1,
            )
        self.time = 0
        self.phase = np.full(len(ids), -1)
        self.goal = np.empty_like(phases[0].target)
        self.arrival, self.deadline = np.empty(len(ids), dtype=np.intp), np.empty(len(ids), dtype=np.intp)
        self.rest_speed = np.full(len(ids), np.inf)
        self.calm, self.stalled = np.zeros(len(ids), dtype=np.intp), np.zeros(len(ids), dtype=np.bool_)
        self.end = np.full(len(ids), MOVING, dtype=np.int8)
        self.begin_phase(np.arange(len(ids)))

    def begin_phase(self, rows: Ids) -> None:
        """Lay the setpoints of the next phase on the line, from the present time on."""
        self.phase[rows] += 1
        for number in set(self.phase[rows].tolist()):
            these, plan = rows[self.phase[rows] == number], self.phases[number]
            switch = self.time + len(plan.setpoints)
            self.line[self.time : switch, these] = plan.setpoints[:, these]
            self.line[switch:, these] = plan.setpoints[-1, these]
            self.goal[these] = plan.target[these]
            self.arrival[these] = self.time + plan.arrival[these]
            if number == len(self.phases) - 1:
                self.rest_speed[these] = REST_SPEED
            if self.misread is not None:
                self.line[self.time :, these] -= self.misread[self.time :, these]
        self.deadline[rows] = self.arrival[rows] + self.patience
        self.calm[rows], self.stalled[rows] = 0, False

    def end_moves(self, rows: Ids, end: int) -> None:
        """End the moves of these rows; they keep their last setpoint."""
        self.end[rows] = end
        self.arrival[rows] = self.deadline[rows] = NEVER
        self.calm[rows], self.stalled[rows] = -NEVER, False

    def finish(self) -> NDArray[np.int8]:
        rows = np.arange(len(self.ids))
        while rows.size:
            soonest, nothing_new = self.arrival.min(), True
            while nothing_new:
                until = self.next_check(soonest)
                setpoints = self.line[self.time : until]
                if len(setpoints) < until - self.time:  # the last remains
                    setpoints = self.line[np.minimum(np.arange(self.time, until), len(self.line) - 1)]
                setpoints = setpoints if rows.size == self.end.size else setpoints[:, rows]
                self.plant.follow(self.ids[rows], self.rule.servos, setpoints, self.rule.substeps)
                self.time = until
                nothing_new = not self.check()
            rows = np.flatnonzero(self.end == MOVING)
        return self.end

    def next_check(self, soonest: int) -> int:
        """Return the time of the next check; all setpoints until then are known."""
        stall_check = self.time - self.time % STALL_CHECK + STALL_CHECK
        after = max(self.time, soonest) + 1
        return min(stall_check, after + -after % ARRIVAL_CHECK)

    def check(self) -> bool:
        """End phases and moves that are over; return whether there were any.

        Before its setpoint has arrived an arm is judged at stall checks only: others may cause a check between
        them, which must not matter.
        """
        speed = np.maximum.reduce(np.abs(self.plant.qvel[self.at_dof]), axis=1)
        if self.time % STALL_CHECK == 0:
            self.calm = np.where(speed < STALL_SPEED, self.calm + 1, 0)
            self.stalled = self.calm >= STALL_CHECKS
        arrived, late = self.time > self.arrival, self.time >= self.deadline
        stands = self.stalled | (arrived & (speed <= self.rest_speed))
        if not (stands | late).any():
            return False
        off = np.maximum.reduce(np.abs(self.plant.qpos[self.at_qpos] - self.goal), axis=1)
        near = off <= self.rule.tolerance
        done = near & arrived & stands
        held = self.stalled & ~near
        late &= ~(done | held)
        over = done | held | late
        if not over.any():
            return False
        last = self.phase == len(self.phases) - 1
        for rows, end in ((done & last, ARRIVED), (held, STALLED), (late, LATE)):
            self.end_moves(rows.nonzero()[0], end)
        self.begin_phase((done & ~last).nonzero()[0])
        return True
