"""Worlds with MuJoCo's dynamics: one simulation, or a native batch of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinreach.envs.batch_simulation import BatchSimulation
from kinreach.envs.moves import MoveResult, MoveStatus
from kinreach.envs.reach.world import Executed, Ids
from kinreach.envs.simulation import ArmSimulation
from kinreach.kinematics.goals import Floats


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
