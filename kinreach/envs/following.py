"""The control loop: setpoints go to the servos, and every so often each arm is asked whether it has arrived.

One loop for one simulation and for many: each goes through the phases of its move at its own time, and what one does
is never seen by another, so that the results are the same to the bit whoever else is moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach.envs.plants import Ids, Plant, rows_and_columns
from kinreach.envs.setpoints import Plan

#: Time between two setpoints [s].
CONTROL_PERIOD = 0.008
#: Setpoints between two looks whether an arm has arrived, and between two whether it is held up.
ARRIVAL_LOOK, STALL_LOOK = 2, 10
#: An arm in which no joint is faster than this has come to rest [rad/s]. The slowest servo still creeps by this times
#: its time constant of 0.07 s, 4e-5 rad; at 0.002 rad/s the tip would be read up to 0.5 mm from where it will stay.
REST_SPEED = 0.0005
#: An arm in which no joint is faster than this [rad/s] at so many looks in a row (0.2 s), off its target, is blocked.
STALL_SPEED = 0.02
STALL_LOOKS = 3
#: How long the arm may take to arrive after its setpoint has [s].
PATIENCE = 2.0
#: How following ended.
MOVING, ARRIVED, STALLED, LATE = range(4)


@dataclass(frozen=True, eq=False)
class Following:
    """How setpoints are followed.

    Attributes:
        qpos, dof, servos: Where the arm's joints are in MuJoCo's `qpos`, `qvel` and `ctrl`; slices or arrays of ints.
        tolerance: How far from its target a joint may come to rest [rad].
        timestep: Step of the simulation [s].
    """

    qpos: Any
    dof: Any
    servos: Any
    tolerance: float
    timestep: float

    @property
    def substeps(self) -> int:
        """Timesteps between two setpoints."""
        return max(1, round(CONTROL_PERIOD / self.timestep))

    @property
    def period(self) -> float:
        """Time between two setpoints [s]."""
        return self.substeps * self.timestep

    def run(self, plant: Plant, ids: Ids, phases: Sequence[Plan]) -> NDArray[np.int8]:
        """Move simulations through the phases of their plans, each until it stands or is found not to arrive.

        A phase but the last is over as soon as the arm is within the tolerance. At the end of the last it has to come
        to rest (or, leaning on something, hardly move any more).

        Args:
            plant: The simulations.
            ids: Which of them to move, ascending, shape (k,).
            phases: Plans for these k simulations.

        Returns:
            ARRIVED, STALLED or LATE for each, shape (k,).
        """
        return _Run(self, plant, ids, phases).finish()


class _Run:
    """The state of one `Following.run`. Times are counted in control periods from its start; arrays have k rows."""

    def __init__(self, rule: Following, plant: Plant, ids: Ids, phases: Sequence[Plan]) -> None:
        self.rule, self.plant, self.ids, self.phases = rule, plant, ids, phases
        self.patience = round(PATIENCE / rule.period)
        rows: Any = slice(None) if len(ids) == len(plant.ctrl) else ids
        self.at_servos = rows_and_columns(rows, rule.servos)
        self.at_dof = rows_and_columns(rows, rule.dof)
        longest = sum(len(plan.setpoints) for plan in phases) + self.patience * (len(phases) - 1)
        self.line = np.empty((longest, len(ids), phases[0].target.shape[1]))
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
        self.deadline[rows] = self.arrival[rows] + self.patience
        self.first_deadline = self.deadline.min()
        self.calm[rows], self.stalled[rows] = 0, False

    def finish(self) -> NDArray[np.int8]:
        """Run until the last has ended."""
        plant, servos, line, substeps = self.plant, self.at_servos, self.line, self.rule.substeps
        moving, soonest, end = self.ids, self.arrival.min(), len(line) - 1
        while moving.size:
            plant.ctrl[servos] = line[min(self.time, end)]
            plant.step(moving, substeps)
            self.time += 1
            stall_look = self.time % STALL_LOOK == 0
            if (stall_look or (self.time > soonest and self.time % ARRIVAL_LOOK == 0)) and self.look(stall_look):
                active = self.end == MOVING
                moving = self.ids[active]
                soonest = self.arrival.min(where=active, initial=self.deadline.max())
        return self.end

    def look(self, stall_look: bool) -> bool:
        """Decide what is to be decided; returns whether a phase or a move was over.

        Before its setpoint has arrived an arm is judged at stall looks only: others may give occasion to a look between
        them, and must not matter.
        """
        speed = np.maximum.reduce(np.abs(self.plant.qvel[self.at_dof]), axis=1)
        arrived = self.time > self.arrival
        stands = arrived & ((speed <= self.rest_speed) | self.stalled)
        if stall_look:
            self.calm = (self.calm + 1) * (speed < STALL_SPEED)
            self.stalled = self.calm >= STALL_LOOKS
            stands |= self.stalled
        if self.time < self.first_deadline and not stands.any():
            return False
        rows = ((stands | (self.time >= self.deadline)) & (self.end == MOVING)).nonzero()[0]
        if not rows.size:
            return False
        q = self.plant.qpos[rows_and_columns(self.ids[rows], self.rule.qpos)]
        near = np.abs(q - self.goal[rows]).max(axis=1) <= self.rule.tolerance
        there = near & stands[rows] & arrived[rows]
        held = ~near & self.stalled[rows]
        late = ~there & ~held & (self.time >= self.deadline[rows])
        last = self.phase[rows] == len(self.phases) - 1
        self.end[rows[there & last]] = ARRIVED
        self.end[rows[held]] = STALLED
        self.end[rows[late]] = LATE
        over = rows[(there & last) | held | late]
        # Whoever is done keeps the last setpoint while others go on.
        self.line[self.time :, over] = self.line[min(self.time, len(self.line)) - 1, over]
        self.begin_phase(rows[there & ~last])
        return bool(there.any() or held.any() or late.any())
