"""Worlds that execute postures, kinematic or simulated, for one arm or many."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._tensors import as_device, on_device
from kinreach.envs._reach.reach_task import ReachTask
from kinreach.kinematics import ArmKinematics
from kinreach.robots import ArmDescription
from kinreach.sim import ArmSimulation, BatchSimulation
from kinreach.sim.inside import IDEAL, WARP, DrawnArms, Imperfections, MoveResult, MoveStatus

Ids = NDArray[np.intp]
Flags = NDArray[np.bool_]


class TargetStatus(IntEnum):
    """Result of an action as a number; `STATUSES` has the words."""

    COMPLETED = 0
    OUT_OF_LIMITS = 1
    #: At the target the arm would overlap an obstacle (`backend="kinematic"`).
    COLLISION = 2
    #: Two parts of the arm would overlap, or keep each other from the target (both backends).
    SELF_COLLISION = 3
    #: Something keeps the arm from the target (BLOCKED, TIMEOUT and DIVERGED: `backend="mujoco"`).
    BLOCKED = 4
    TIMEOUT = 5
    DIVERGED = 6
    #: The agent found no action.
    FORFEITED = 7


#: `info["status"]` for each `TargetStatus`.
STATUSES = np.array(
    ["completed", "out of limits", "collision", "self-collision", "blocked", "timeout", "diverged", "forfeited"],
    dtype=object,
)
#: The status of a target by its `Cause`.
STATUS_OF_CAUSE = np.array(
    [TargetStatus.COMPLETED, TargetStatus.OUT_OF_LIMITS, TargetStatus.SELF_COLLISION, TargetStatus.COLLISION],
    dtype=np.uint8,
)
_OF_MOVE = {
    MoveStatus.REACHED: TargetStatus.COMPLETED,
    MoveStatus.OUT_OF_LIMITS: TargetStatus.OUT_OF_LIMITS,
    MoveStatus.COLLISION: TargetStatus.SELF_COLLISION,
    MoveStatus.BLOCKED: TargetStatus.BLOCKED,
    MoveStatus.TIMEOUT: TargetStatus.TIMEOUT,
    MoveStatus.DIVERGED: TargetStatus.DIVERGED,
}


@dataclass(frozen=True, eq=False)
class Executed:
    """Results of the actions of all arms.

    Attributes:
        impossible: Whether the target was not reached, shape (count,).
        status: How each ended, a `TargetStatus`, shape (count,).
        reasons: Why it was impossible, one phrase per arm (empty where possible), or None.
        durations: Simulated time [s], shape (count,); None without simulation.
    """

    impossible: Flags
    status: NDArray[np.uint8]
    reasons: Sequence[str] | None = None
    durations: Floats | None = None


class ReachWorld(Protocol):
    """A number of equal arms, each with its own ball.

    Attributes:
        count: How many.
        dynamic: Whether they are simulated.
        explains: Whether there is a reason for each impossible target.
        device: Of the tensors that `snapshot` gives; None for arrays.
        drawn: Writes drawn properties of the arms; None where none is drawn.
    """

    count: int
    dynamic: bool
    explains: bool
    device: Any
    drawn: DrawnArms | None

    def reset(self, ids: Ids, goals: Floats, q: Floats | None) -> None:
        """Put arms into postures [rad], shape (k, n), or the start pose, and balls to goals [m], shape (k, 3)."""
        ...

    def execute(self, targets: Floats, *, two_phase: bool, acting: Flags | None = None) -> Executed:
        """Move arms to joint targets [rad], shape (count, n): all of them, or where `acting` is True, shape (count,).

        The others stay unchanged, with the status COMPLETED.
        """
        ...

    def snapshot(self, ids: Ids | None = None) -> tuple[Any, Any]:
        """Copy postures [rad], shape (k, n), and positions of the tips in the world [m], shape (k, 3), of all or some.

        They are tensors if the world has a device.
        """
        ...

    @property
    def q(self) -> Floats:
        """Postures of all arms [rad], shape (count, n); read-only, valid until the next move or reset."""
        ...


class KinematicWorld:
    """Arms that jump to their targets, if these are within the joint limits and free of collisions.

    An impossible target leaves the arm where it is. Collisions on the way are not checked.

    Args:
        explain: Give the reason for each impossible target, which takes time.
    """

    dynamic = False
    device = None
    drawn: DrawnArms | None = None

    def __init__(self, task: ReachTask, count: int, *, explain: bool = False) -> None:
        self.count = count
        self.explains = explain
        self._kinematics = task.kinematics
        self._checker = task.checker
        self._home = task.home[:, None]
        self._home_tip = self._kinematics.positions(self._home.T).T
        # one joint or coordinate after the other, as the formulas want them
        self._q = np.repeat(self._home, count, axis=1)
        self._tip = np.repeat(self._home_tip, count, axis=1)

    def reset(self, ids: Ids, goals: Floats, q: Floats | None) -> None:
        rows = ids if len(ids) < self.count else slice(None)
        self._q[:, rows] = self._home if q is None else q.T
        self._tip[:, rows] = self._home_tip if q is None else self._kinematics.positions(q).T

    def execute(self, targets: Floats, *, two_phase: bool, acting: Flags | None = None) -> Executed:
        status = STATUS_OF_CAUSE[self._checker.causes(targets)]
        if acting is not None:
            status[~acting] = TargetStatus.COMPLETED
        impossible = status != TargetStatus.COMPLETED
        moved = np.flatnonzero(~impossible)
        q = targets.T.take(moved, axis=1)
        for array, values in ((self._q, q), (self._tip, self._kinematics.positions(q.T).T)):
            for row, new in zip(array, values, strict=True):
                row[moved] = new
        if not self.explains:
            return Executed(impossible, status)
        reasons = [self._checker.reason(target) if bad else "" for target, bad in zip(targets, impossible, strict=True)]
        return Executed(impossible, status, reasons)

    def snapshot(self, ids: Ids | None = None) -> tuple[Floats, Floats]:
        if ids is None or len(ids) == self.count:
            return self.q.copy(order="K"), self._tip.T.copy(order="K")
        return self._q[:, ids].T, self._tip[:, ids].T

    @property
    def q(self) -> Floats:
        return self._q.T


def _executed(moves: Sequence[MoveResult]) -> Executed:
    status = np.array([_OF_MOVE[move.status] for move in moves], dtype=np.uint8)
    durations = np.array([move.duration for move in moves])
    return Executed(status != TargetStatus.COMPLETED, status, [move.reason for move in moves], durations)


class SingleDynamicWorld:
    """One arm under MuJoCo's dynamics; what draws or films its simulation may share it."""

    count = 1
    dynamic = explains = True
    device = None

    def __init__(self, simulation: ArmSimulation) -> None:
        self.simulation = simulation
        self.drawn = simulation.drawn

    def reset(self, ids: Ids, goals: Floats, q: Floats | None) -> None:
        self.simulation.reset(None if q is None else q[0])
        self.simulation.place_ball(goals[0])

    def execute(self, targets: Floats, *, two_phase: bool, acting: Flags | None = None) -> Executed:
        """Move by dynamics; a target that is not attained is impossible, and the arm stays where it got to."""
        return _executed([self.simulation.move(targets[0], two_phase=two_phase)])

    def snapshot(self, ids: Ids | None = None) -> tuple[Floats, Floats]:
        return self.q, self.simulation.tip_position[None]

    @property
    def q(self) -> Floats:
        return self.simulation.q[None]


class BatchDynamicWorld:
    """Many arms under MuJoCo's dynamics, bit for bit what as many `SingleDynamicWorld` would do; or Warp's.

    Args:
        device: Of Warp and of the tensors that `snapshot` gives; with None those are arrays.
    """

    dynamic = explains = True

    def __init__(
        self,
        arm: ArmDescription,
        count: int,
        *,
        threads: int = 1,
        imperfections: Imperfections = IDEAL,
        backend: str = "mujoco",
        device: str | None = None,
        drawn: Collection[str] = (),
    ) -> None:
        self.count = count
        self.device = None if device is None else as_device(device)
        self._kinematics = ArmKinematics.of(arm, base="world")
        simulated_on = device if backend == WARP else None  # else it is only where tensors are wanted
        self._batch = BatchSimulation(
            arm,
            count,
            threads=threads,
            imperfections=imperfections,
            backend=backend,
            device=simulated_on,
            drawn=drawn,
        )
        self.drawn = self._batch.drawn

    def reset(self, ids: Ids, goals: Floats, q: Floats | None) -> None:
        self._batch.reset(ids, q)

    def execute(self, targets: Floats, *, two_phase: bool, acting: Flags | None = None) -> Executed:
        ids = np.arange(self.count) if acting is None else np.flatnonzero(acting)
        moves = [MoveResult(MoveStatus.REACHED, "", 0.0, q, 0.0) for q in self.q]
        for index, move in zip(ids, self._batch.move(ids, targets[ids], two_phase=two_phase), strict=True):
            moves[index] = move
        return _executed(moves)

    def snapshot(self, ids: Ids | None = None) -> tuple[Any, Any]:
        """Return postures and tips; as tensors, tips are computed on the device."""
        rows = np.arange(self.count) if ids is None else ids
        if self.device is None:
            return self.q[rows], self._batch.tip_positions_of(rows)
        q = on_device(self.q[rows], self.device)
        return q, self._kinematics.positions(q)

    @property
    def q(self) -> Floats:
        return self._batch.q
