"""What becomes of a move."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from kinreach.envs.contacts import Touch
from kinreach.kinematics.goals import Floats


class MoveStatus(Enum):
    """How a move ended. Everything but REACHED is an impossible target."""

    REACHED = "reached"
    #: The target is outside the joint limits; the arm was not moved.
    OUT_OF_LIMITS = "out of limits"
    #: An obstacle holds the arm off the target or is pressed at it, or the arm has stopped for no visible reason
    #: (torque limit).
    BLOCKED = "blocked"
    #: One part of the arm holds another off the target, or presses it there.
    COLLISION = "self-collision"
    #: The arm is still moving long after it should have arrived.
    TIMEOUT = "timeout"
    #: The simulation became unstable; the arm was put back to where it stood before, at rest.
    DIVERGED = "diverged"


@dataclass(frozen=True, eq=False)
class MoveResult:
    """What became of a move.

    Attributes:
        status: How it ended.
        reason: One phrase for people when the target was not attained, else empty.
        duration: Simulated time [s].
        q: Posture in which the arm ended [rad], shape (n,).
        error: Largest distance of a joint from the target [rad].
        touches: What is in contact in that posture, deepest first; where the target was reached, touches so slight that
            they are none.
    """

    status: MoveStatus
    reason: str
    duration: float
    q: Floats
    error: float
    touches: tuple[Touch, ...] = ()

    @property
    def reached(self) -> bool:
        """Whether every joint came to rest within the tolerance of its target, and nothing is pressed there."""
        return self.status is MoveStatus.REACHED
