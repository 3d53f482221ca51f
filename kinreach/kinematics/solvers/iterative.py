"""What all iterative solvers share: a first descent from the caller's seed, then restarts from random postures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinreach.errors import InputError
from kinreach.inputs import check_count, check_number, shown
from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.goals import Floats, Goal, goal_error
from kinreach.kinematics.result import Accept, IKResult, Status, check_accept
from kinreach.kinematics.solvers.base import Tolerance
from kinreach.kinematics.solvers.joint_space import JointSpace

DEFAULT_TOLERANCE = Tolerance()

#: Most steps of an attempt, and most attempts: a goal that cannot be reached takes them all.
MOST_ATTEMPTS = 10_000

#: Largest duration of a step [s]: with it, speed limits limit nothing.
LONGEST_STEP = 1e3

#: A step below this [rad] ends an attempt: the limits or a singular posture hold it.
STALLED = 1e-5


class Descent(NamedTuple):
    """Where one descent ended: posture [rad] (n,), which may be some turns outside the limits, and steps taken."""

    q: Floats
    iterations: int


#: Runs from a posture within the limits down to a minimum of the error of one goal.
Descend = Callable[[Floats], Descent]


class _Candidate(NamedTuple):
    """A posture within the limits, its errors [m], [rad], and the larger of the two in units of the tolerance."""

    q: Floats
    position_error: float
    orientation_error: float
    miss: float

    def result(self, status: Status, reason: str = "", *, iterations: int, restarts: int) -> IKResult:
        return IKResult(
            q=self.q,
            status=status,
            position_error=self.position_error,
            orientation_error=self.orientation_error,
            reason=reason,
            iterations=iterations,
            restarts=restarts,
        )


class IterativeSolver(ABC):
    """A local method made global by restarts.

    Every attempt ends with the posture folded into the limits and judged anew by forward kinematics, so that success
    is a property of the posture that is returned. The random postures are drawn from a generator that each call to
    `solve` seeds afresh: equal inputs give equal results whatever was asked before. One per thread (see `Solver`).

    Args:
        kin: The arm, its tip and the base frame that goals are in.
        tolerance: How near is reached.
        max_iterations: Steps per attempt, at least 1.
        max_restarts: Attempts from random postures after the one from the seed, at least 0.
        rng_seed: Seed of the random postures.

    Raises:
        InputError: A count or a tolerance cannot be used.
    """

    name: ClassVar[str]

    def __init__(
        self,
        kin: ArmKinematics,
        *,
        tolerance: Tolerance = DEFAULT_TOLERANCE,
        max_iterations: int = 30,
        max_restarts: int = 20,
        rng_seed: int = 0,
    ) -> None:
        if not isinstance(kin, ArmKinematics):
            raise InputError(f"kin must be the kinematics of an arm, got {shown(kin)}")
        if not isinstance(tolerance, Tolerance):
            raise InputError(f"tolerance must be a Tolerance, got {shown(tolerance)}")
        for part in ("position", "orientation"):
            check_number(f"the tolerance of the {part}", getattr(tolerance, part), above=0.0)
        self.kin = kin
        self.tolerance = tolerance
        self.max_iterations = check_count("max_iterations", max_iterations, most=MOST_ATTEMPTS)
        self.max_restarts = check_count("max_restarts", max_restarts, least=0, most=MOST_ATTEMPTS)
        self.rng_seed = check_count("rng_seed", rng_seed, least=0)
        self.joint_space = JointSpace(kin)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.kin!r})"

    @abstractmethod
    def _descender(self, goal: Goal) -> Descend:
        """Prepare the descent for one goal."""

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Find a posture for `goal`; see `Solver.solve`.

        Args:
            goal: In the base frame of `kin`, for its tip. A goal with more conditions than the arm has joints (a full
                pose on the 3-DOF arm) is found if the arm can meet it, and otherwise does not converge.
            seed: First posture to descend from [rad], shape (n,); folded into the limits if it is outside.
            accept: Test that the posture must also pass; a refused one leads to the next restart.

        Returns:
            The first posture that is within tolerance and limits and accepted. Failing that, the first refused one
            with `REJECTED`, or the one nearest to the goal with `NOT_CONVERGED`.

        Raises:
            InputError: The goal or the seed is malformed.
        """
        start = self.joint_space.fold(self.kin.as_posture("seed", seed))
        check_accept(accept)
        descend = self._descender(goal)
        refused: list[_Candidate] = []
        missed: list[_Candidate] = []
        iterations = 0
        for restarts, q in enumerate(self._starts(start)):
            descent = descend(q)
            iterations += descent.iterations
            candidate = self._judge(goal, descent.q)
            if candidate.miss > 1.0:
                missed.append(candidate)
            elif accept is None or accept(candidate.q.copy()):
                return candidate.result(Status.OK, iterations=iterations, restarts=restarts)
            else:
                refused.append(candidate)
        attempts = f"{self.max_restarts + 1} attempts ({iterations} steps)"
        if refused:
            reason = f"{len(refused)} of {attempts} converged, and accept refused the posture of each"
            return refused[0].result(Status.REJECTED, reason, iterations=iterations, restarts=self.max_restarts)
        nearest = min(missed, key=lambda candidate: candidate.miss)
        reason = (
            f"none of {attempts} came within {self.tolerance.position:g} m and {self.tolerance.orientation:g} rad; "
            f"the nearest is {nearest.position_error:.3g} m and {nearest.orientation_error:.3g} rad away"
        )
        return nearest.result(Status.NOT_CONVERGED, reason, iterations=iterations, restarts=self.max_restarts)

    def _starts(self, first: Floats) -> Iterator[Floats]:
        yield first
        rng = np.random.default_rng(self.rng_seed)
        for _ in range(self.max_restarts):
            yield rng.uniform(self.kin.lower, self.kin.upper)

    def _judge(self, goal: Goal, found: Floats) -> _Candidate:
        q = self.joint_space.fold(found)
        position, orientation = goal_error(goal, self.kin.fk(q))
        miss = max(position / self.tolerance.position, orientation / self.tolerance.orientation)
        return _Candidate(q, position, orientation, miss)
