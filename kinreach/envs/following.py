"""The control loop: setpoints go to the servos, and every so often each arm is asked whether it has arrived.

Between two looks nothing is decided, so that as many setpoints go to the simulation in one call.

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
#: How following ended; that a simulation has diverged is found by who asked for the move.
MOVING, ARRIVED, STALLED, LATE, DIVERGED = range(5)
#: A time that does not come.
NEVER = np.iinfo(np.intp).max // 2


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
        self.at_qpos, self.at_dof = rows_and_columns(rows, rule.qpos), rows_and_columns(rows, rule.dof)
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
        self.calm[rows], self.stalled[rows] = 0, False

    def end_moves(self, rows: Ids, end: int) -> None:
        """Let these keep their last setpoint, with nothing left to decide."""
        self.end[rows] = end
        self.arrival[rows] = self.deadline[rows] = NEVER
        self.calm[rows], self.stalled[rows] = -NEVER, False

    def finish(self) -> NDArray[np.int8]:
        """Run until the last has ended."""
        rows = np.arange(len(self.ids))
        while rows.size:
            soonest, nothing_new = self.arrival.min(), True
            while nothing_new:
                until = self.next_look(soonest)
                setpoints = self.line[self.time : until]
                if len(setpoints) < until - self.time:  # the last remains
                    setpoints = self.line[np.minimum(np.arange(self.time, until), len(self.line) - 1)]
                setpoints = setpoints if rows.size == self.end.size else setpoints[:, rows]
                self.plant.follow(self.ids[rows], self.rule.servos, setpoints, self.rule.substeps)
                self.time = until
                nothing_new = not self.look()
            rows = np.flatnonzero(self.end == MOVING)
        return self.end

    def next_look(self, soonest: int) -> int:
        """When something may have to be decided next; until then all setpoints are known."""
        stall_look = self.time - self.time % STALL_LOOK + STALL_LOOK
        after = max(self.time, soonest) + 1
        return min(stall_look, after + -after % ARRIVAL_LOOK)

    def look(self) -> bool:
        """Decide what is to be decided; returns whether a phase or a move was over.

        Before its setpoint has arrived an arm is judged at stall looks only: others may give occasion to a look between
        them, and must not matter.
        """
        speed = np.maximum.reduce(np.abs(self.plant.qvel[self.at_dof]), axis=1)
        if self.time % STALL_LOOK == 0:
            self.calm = (self.calm + 1) * (speed < STALL_SPEED)
            self.stalled = self.calm >= STALL_LOOKS
        arrived, late = self.time > self.arrival, self.time >= self.deadline
        stands = self.stalled | (arrived & (speed <= self.rest_speed))
        if not (stands | late).any():
            return False
        off = np.maximum.reduce(np.abs(self.plant.qpos[self.at_qpos] - self.goal), axis=1)
        near = off <= self.rule.tolerance
        there = near & arrived & stands
        held = self.stalled & ~near
        late &= ~(there | held)
        over = there | held | late
        if not over.any():
            return False
        last = self.phase == len(self.phases) - 1
        for rows, end in ((there & last, ARRIVED), (held, STALLED), (late, LATE)):
            self.end_moves(rows.nonzero()[0], end)
        self.begin_phase((there & ~last).nonzero()[0])
        return True
