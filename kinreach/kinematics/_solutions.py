"""Results of inverse kinematics: one posture, all postures of a goal, or many goals; and the nearest windings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import Floats, shown
from kinreach._rotations import TURN
from kinreach._tensors import namespace
from kinreach.errors import InputError
from kinreach.kinematics._core import as_rows
from kinreach.kinematics._goals import Goal, check_goal

if TYPE_CHECKING:
    from kinreach.kinematics._arm import ArmKinematics


class Status(Enum):
    """How a request for a posture ended."""

    OK = "ok"
    #: No posture of this geometry reaches the goal; `reason` names the part that cannot.
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
    if accept is not None and not callable(accept):
        raise InputError(f"accept must be a function of a posture, or None, got {shown(accept)}")


@dataclass(frozen=True)
class Tolerance:
    """When a goal counts as reached: position [m] and orientation [rad]."""

    position: float = 1e-4
    orientation: float = 1e-3


@dataclass(frozen=True, init=False)
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

    def __init__(
        self,
        q: Floats,
        status: Status,
        position_error: float,
        orientation_error: float,
        reason: str = "",
        branch: int = -1,
        iterations: int = 0,
        restarts: int = 0,
    ) -> None:
        self.__dict__.update(  # a third of the time of a frozen dataclass's own
            q=q, status=status, position_error=position_error, orientation_error=orientation_error, reason=reason,
            branch=branch, iterations=iterations, restarts=restarts,
        )  # fmt: skip

    @classmethod
    def of(
        cls,
        kinematics: ArmKinematics,
        goal: Goal,
        q: ArrayLike,
        *,
        tolerance: Tolerance | None = None,
        accept: Accept | None = None,
        reason: str = "",
        branch: int = -1,
        iterations: int = 0,
        restarts: int = 0,
    ) -> IKResult:
        """Judge a posture: errors by forward kinematics, joint limits, and the caller's `accept`, in this order.

        Args:
            kinematics: The arm; the goal is in its base frame and for its tip.
            goal: What was to be reached.
            q: The posture found [rad], shape (n,).
            tolerance: How near is reached; by default 1e-4 m and 1e-3 rad.
            accept: Test that the posture must also pass.
            reason: Reason of the result if the goal is not reached; by default how far off it is.
            branch: Closed-form branch index.
            iterations: Steps taken.
            restarts: Fresh seeds tried after the first.

        Raises:
            InputError: `q` is malformed.
        """
        tolerance = tolerance or Tolerance()
        check_accept(accept)
        q = kinematics.as_posture("q", q).copy()
        position, orientation = check_goal(goal).error(kinematics.fk(q))
        if position > tolerance.position or (orientation > tolerance.orientation and not goal.orientation_yields):
            status, text = Status.NOT_CONVERGED, f"{position:.3g} m and {orientation:.3g} rad from the goal"
        elif outside := kinematics.joints_outside_limits(q):
            status, text = Status.OUT_OF_LIMITS, f"outside the joint limits ({', '.join(outside)})"
        elif accept is not None and not accept(q.copy()):
            status, text = Status.REJECTED, "accept refused the posture"
        else:
            status, text = Status.OK, ""
        text = reason if reason and status is Status.NOT_CONVERGED else text
        return cls(q, status, position, orientation, text, branch, iterations, restarts)

    @property
    def success(self) -> bool:
        """Whether `q` reaches the goal within tolerance, within the limits, and was accepted."""
        return self.status is Status.OK


#: How far a joint may be past its limit by rounding [rad]: in every solver, collision check and simulation.
SLACK = 1e-9
#: A closed-form posture that is past a limit by up to this [rad] is moved into the limits, and kept if it still reaches
#: the goal within the caller's tolerance. Next to a singular posture, rounding of lengths and limits grows to this.
NEAR_LIMIT = 1e-3

#: One solution as the closed forms give it: branch index, singularity flags, joint angles [rad]. All of a goal's are
#: such rows, an array or a list of tuples.
Row = tuple[Any, ...]
BRANCH, FLAGS, ANGLES = 0, 1, slice(2, None)


class IKSolutions:
    """Every posture that reaches a goal, in the order of the branch index, or of the distance from the seed.

    Its length is how many there are. An index, or a loop, gives an `IKResult` for each; arrays are made when asked for.

    Attributes:
        status: `OK` if there is at least one.
        reason: Why there is none, else empty.
    """

    __slots__ = ("_errors", "_found", "reason", "status")

    def __init__(
        self, rows: Any, status: Status, reason: str, errors: tuple[Callable[[Any, Floats], Floats], Any]
    ) -> None:
        self._found, self.status, self.reason, self._errors = rows, status, reason, errors

    @property
    def rows(self) -> Floats:
        """A `Row` of each, shape (k, 2 + n)."""
        if type(self._found) is tuple:
            memory, count = self._found
            self._found = as_rows(memory)[:count]
        return self._found

    def errors(self, rows: Floats) -> Floats:
        """Compute errors [m, rad] of such rows by forward kinematics, shape (k, 2)."""
        of, goal = self._errors
        return of(goal, rows)

    def __len__(self) -> int:
        return self._found[1] if type(self._found) is tuple else len(self._found)

    def __getitem__(self, index: int) -> IKResult:
        row, (position, orientation) = self.rows[index], self.residual[index].tolist()
        return IKResult(row[ANGLES].copy(), Status.OK, position, orientation, branch=int(row[BRANCH]))

    def __iter__(self) -> Iterator[IKResult]:
        return (self[index] for index in range(len(self)))

    def __repr__(self) -> str:
        reason = f", reason={self.reason!r}" if self.reason else ""
        return f"{type(self).__name__}({len(self)} postures, status={self.status}{reason})"

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.rows, self.status, self.reason, (known_errors, self.residual))

    @property
    def success(self) -> bool:
        """Whether there is a solution."""
        return self.status is Status.OK

    @property
    def q(self) -> Floats:
        """Postures [rad], shape (k, n)."""
        return self.rows[:, ANGLES]

    @property
    def branch(self) -> NDArray[np.int64]:
        """Branch index of each solution, shape (k,)."""
        return self.rows[:, BRANCH].astype(np.int64)

    @property
    def singularity(self) -> NDArray[np.int64]:
        """Flags of what was clamped, free or moved in each solution, shape (k,); 0 is regular."""
        return self.rows[:, FLAGS].astype(np.int64)

    @property
    def residual(self) -> Floats:
        """Position [m] and orientation [rad] error of each solution, by forward kinematics, shape (k, 2)."""
        of, goal = self._errors
        if of is not known_errors:
            self._errors = known_errors, of(goal, self.rows)
        return self._errors[1]


def known_errors(errors: Floats, rows: Floats) -> Floats:
    return errors


class IKBatch(NamedTuple):
    """All postures of many poses.

    Attributes:
        q: Postures [rad], shape (count, branches, n), by branch index; NaN where there is no solution.
        valid: Which branches have a solution, shape (count, branches).
    """

    q: Floats
    valid: NDArray[np.bool_]


@dataclass(frozen=True)
class IKBatchNearest:
    """One posture for each of many poses.

    Attributes:
        q: Postures [rad], shape (count, n); NaN where `success` is False.
        branch: Branch index, shape (count,); -1 where `success` is False.
        success: Shape (count,).
    """

    q: Floats
    branch: NDArray[np.int64]
    success: NDArray[np.bool_]


def past_limits(q: Floats, lower: Floats, upper: Floats, slack: float = SLACK) -> NDArray[np.bool_]:
    """Return which joints are past their limits by more than the slack, of postures [rad] of any shape (..., n).

    A joint at a whole turn from an angle within them is past them, as it stands; `nearest_windings` turns it back.
    """
    past: NDArray[np.bool_] = (q < lower - slack) | (q > upper + slack)
    return past


def nearest_windings(
    q: Any, seed: Any, lower: Any, upper: Any, *, slack: float = SLACK, turns: NDArray[np.bool_] | None = None
) -> tuple[Any, Any]:
    """Compute the postures equal to `q` modulo full turns that are nearest to a seed within the limits [rad].

    Joints do not interact here, so taking the best turn of each joint is exact for any norm that grows with every
    joint's distance; nothing is enumerated.

    Args:
        q: Postures, shape (n, ...), joints first.
        seed: Of the same shape, or one that broadcasts to it.
        lower: Limits, shape (n,).
        upper: Limits, shape (n,).
        slack: How far a joint may be past them.
        turns: Which joints turn, shape (n,); the others stay. By default all do.

    Returns:
        The postures, and which of them are within the limits, shape (...).
    """
    xp = namespace(q)
    low = (lower - slack).reshape(-1, *[1] * (q.ndim - 1))
    high = (upper + slack).reshape(-1, *[1] * (q.ndim - 1))
    shifted = q + TURN * xp.round((seed - q) / TURN)
    shifted -= TURN * xp.ceil((shifted - high) / TURN).clip(0.0)
    shifted += TURN * xp.ceil((low - shifted) / TURN).clip(0.0)
    if turns is not None:
        shifted = xp.where(turns.reshape(low.shape), shifted, q)
        return shifted, ((low <= shifted) & (shifted <= high)).all(axis=0)
    return shifted, (shifted <= high).all(axis=0)
