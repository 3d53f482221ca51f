"""What executes postures: one protocol for the kinematic and the simulated worlds, for one arm and for many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach.kinematics.goals import Floats

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
