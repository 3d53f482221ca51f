"""What executes postures: kinematic or simulated, for one arm and for many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach.checks import Floats
from kinreach.kinematics import UR5Kinematics
from kinreach.kinematics.fast_collision import FastCollision
from kinreach.sim.controller import MoveResult, MoveStatus
from kinreach.sim.simulation import ArmSimulation, BatchSimulation

Ids = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Executed:
    """Where the arms stand after a move; `q` and `tip` hold until the next move or reset.

    Attributes:
        q: Postures [rad], shape (count, 6).
        tip: Positions of the tcp in the world [m], shape (count, 3).
        impossible: Whether the target could not be taken, shape (count,).
        reasons: Why, one phrase per arm (empty where possible); None where the world does not say in a batch.
        diverged: Whether it was for an unstable simulation, shape (count,); None where there is no simulation.
    """

    q: Floats
    tip: Floats
    impossible: NDArray[np.bool_]
    reasons: Sequence[str] | None
    diverged: NDArray[np.bool_] | None = None


class ReachWorld(Protocol):
    """A number of equal arms, each with its own ball."""

    count: int

    def reset(self, ids: Ids, goals: Floats, q: Floats | None) -> None:
        """Put arms into postures [rad], shape (k, 6), or the start pose, and their balls to goals [m], shape (k, 3)."""
        ...

    def execute(self, targets: Floats, *, two_phase: bool) -> Executed:
        """Move all arms to joint targets [rad], shape (count, 6)."""
        ...

    @property
    def q(self) -> Floats:
        """Postures of all arms [rad], shape (count, 6), to be read only; they hold until the next move or reset."""
        ...

    def close(self) -> None:
        """Let go of what the world holds."""
        ...


class KinematicWorld:
    """Arms that jump to their targets; joint limits and collisions of the target are still judged.

    An impossible target leaves the arm where it is. Collisions on the way are not judged.

    Args:
        count: Number of arms.
        explain: Say for each impossible target why; costs time, meant for single environments.
    """

    def __init__(self, count: int, *, explain: bool = False) -> None:
        self.count = count
        self._explain = explain
        self._kinematics = UR5Kinematics(tip="tcp", base="world")
        self._check = FastCollision(self._kinematics.arm, refine=False)
        self._home = np.array(self._kinematics.arm.home)[:, None]
        self._home_tip = self._kinematics.positions(self._home.T).T
        # one joint or coordinate after the other, as the formulas want them
        self._q = np.repeat(self._home, count, axis=1)
        self._tip = np.repeat(self._home_tip, count, axis=1)

    def reset(self, ids: Ids, goals: Floats, q: Floats | None) -> None:
        """Put arms into postures [rad], shape (k, 6), or the start pose; balls need no place here."""
        rows = ids if len(ids) < self.count else slice(None)
        self._q[:, rows] = self._home if q is None else q.T
        self._tip[:, rows] = self._home_tip if q is None else self._kinematics.positions(q).T

    def execute(self, targets: Floats, *, two_phase: bool) -> Executed:
        """Take the targets that can be taken."""
        impossible = self._check.impossible(targets)
        moved = np.flatnonzero(~impossible)
        q = targets.T.take(moved, axis=1)
        for array, values in ((self._q, q), (self._tip, self._kinematics.chain.positions(q.T).T)):
            for row, new in zip(array, values, strict=True):
                row[moved] = new
        reasons = None
        if self._explain:
            reasons = [
                self._check.reason(target) if bad else "" for target, bad in zip(targets, impossible, strict=True)
            ]
        return Executed(self.q, self._tip.T, impossible, reasons)

    @property
    def q(self) -> Floats:
        """Postures [rad], shape (count, 6)."""
        return self._q.T

    def close(self) -> None:
        """Nothing to let go of."""


def _executed(moves: Sequence[MoveResult], q: Floats, tip: Floats) -> Executed:
    """What moves came to, with postures [rad], shape (count, 6), and tips [m], shape (count, 3)."""
    return Executed(
        q=q,
        tip=tip,
        impossible=np.array([not move.reached for move in moves]),
        reasons=[move.reason for move in moves],
        diverged=np.array([move.status is MoveStatus.DIVERGED for move in moves]),
    )


class SingleDynamicWorld:
    """One arm under MuJoCo's dynamics.

    Args:
        simulation: The arm's simulation; what draws or films it may share it.
    """

    count = 1

    def __init__(self, simulation: ArmSimulation) -> None:
        self.simulation = simulation

    def reset(self, ids: Ids, goals: Floats, q: Floats | None) -> None:
        """Put the whole simulation back, and the ball to the goal [m], shape (1, 3)."""
        self.simulation.reset(None if q is None else q[0])
        self.simulation.place_ball(goals[0])

    def execute(self, targets: Floats, *, two_phase: bool) -> Executed:
        """Move by dynamics; a target that is not attained is impossible, and the arm stays where it got to."""
        move = self.simulation.move(targets[0], two_phase=two_phase)
        return _executed([move], self.simulation.q[None], self.simulation.tip_position[None])

    @property
    def q(self) -> Floats:
        """Posture [rad], shape (1, 6)."""
        return self.simulation.q[None]

    def close(self) -> None:
        """Nothing to let go of."""


class BatchDynamicWorld:
    """Many arms under MuJoCo's dynamics, bit for bit what as many `SingleDynamicWorld` would do.

    Args:
        count: Number of arms.
        threads: Threads that step them.
    """

    def __init__(self, count: int, *, threads: int = 1) -> None:
        self.count = count
        self._batch = BatchSimulation("ur5", count, threads=threads)

    def reset(self, ids: Ids, goals: Floats, q: Floats | None) -> None:
        """Put simulations back, and their balls to goals [m], shape (k, 3)."""
        self._batch.reset(ids, q)
        self._batch.place_ball(ids, goals)

    def execute(self, targets: Floats, *, two_phase: bool) -> Executed:
        """Move by dynamics; see `SingleDynamicWorld.execute`."""
        moves = self._batch.move(np.arange(self.count), targets, two_phase=two_phase)
        return _executed(moves, self._batch.q, self._batch.tip_positions)

    @property
    def q(self) -> Floats:
        """Postures [rad], shape (count, 6)."""
        return self._batch.q

    def close(self) -> None:
        """Nothing to let go of."""
