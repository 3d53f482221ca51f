"""What inverse kinematics gives back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from kinreach.errors import InputError
from kinreach.inputs import shown
from kinreach.kinematics.goals import Floats


class Status(Enum):
    """How a request for a posture ended."""

    OK = "ok"
    #: No posture of this geometry gets there; `reason` names the part that cannot.
    OUT_OF_REACH = "out of reach"
    #: There are postures, all of them outside the joint limits.
    OUT_OF_LIMITS = "out of limits"
    #: There are postures within the limits, and the caller's `accept` refused every one.
    REJECTED = "rejected"
    #: An iterative solver used up its iterations and restarts.
    NOT_CONVERGED = "not converged"


#: A caller's own test of a posture `q` (n,), such as "does not collide"; False asks for the next candidate.
Accept = Callable[[Floats], bool]


def check_accept(accept: object) -> None:
    """Refuse what cannot be called, before anything is computed."""
    if accept is not None and not callable(accept):
        raise InputError(f"accept must be a function of a posture, or None, got {shown(accept)}")


@dataclass(frozen=True)
class IKResult:
    """One posture, or the reason why there is none.

    Attributes:
        q: Posture [rad], shape (n,). When `success` is False it is the best one found (the seed if none was).
        status: How the request ended.
        position_error: Distance from the goal [m], computed on the returned `q` by forward kinematics.
        orientation_error: Angle from the goal [rad], likewise; 0 where the goal leaves it free.
        reason: One sentence for people when `success` is False, else empty.
        branch: Closed-form branch index, or -1 for iterative solvers.
        iterations: Steps taken over all restarts (0 in closed form).
        restarts: Fresh seeds tried after the first.
    """

    q: Floats
    status: Status
    position_error: float
    orientation_error: float
    reason: str = ""
    branch: int = -1
    iterations: int = 0
    restarts: int = 0

    @property
    def success(self) -> bool:
        """Whether `q` reaches the goal within tolerance, within the limits, and was accepted."""
        return self.status is Status.OK
