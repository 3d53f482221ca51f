"""Shared parts of the iterative solvers: the error of a goal, steps in joint space, restarts, the acceptance test.

All quantities are in the tip's own axes. With the tip at (R, p) and the goal at (R*, p*), Siciliano et al., Robotics,
section 3.7, gives

    e_p = R^T (p* - p)          [m]     J_p = rows 0-2 of the body Jacobian
    e_o = log(R^T R*)^vee       [rad]   J_o = rows 3-5

An axis goal asks for R z = a. The shortest turn that takes the tip's z axis to a has, in the tip's axes, the rotation
vector theta (z x R^T a) / |z x R^T a|, which never has a z component: two rows are left, and turning about the tool's
axis costs nothing. A position goal keeps the first three rows.

The step J dq = e is Gauss-Newton up to the left Jacobian of SO(3), which leaves the gradient J^T e exact: the
derivative of |e_o|^2 / 2 is -e_o . omega, because e_o is its own eigenvector there.

A revolute joint whose range covers 2 pi can take any angle: q and q +- 2 pi are the same posture. Limits on the way
would only stop it too early (UR5 within +-pi, random poses: placo's first attempt then succeeds in 31 % instead of
82 %). Such joints are searched without limits and folded back at the end; the others keep theirs at every step. A
joint that turns without end is searched from within one turn, and gets the turns back that are nearest to the seed.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats, check_count, check_number, shown
from kinreach._engines import load
from kinreach._rotations import TURN
from kinreach.errors import InputError
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._goals import Goal, check_goal
from kinreach.kinematics._solutions import Accept, IKResult, Status, check_accept
from kinreach.kinematics._solvers.base import Tolerance

pin: Any = load("pinocchio")

#: A joint whose range has more turns is taken as endless.
MANY_TURNS = 4


class GoalTask:
    """The error of one goal as a function of the posture."""

    def __init__(self, kin: ArmKinematics, goal: Goal, tolerance: Tolerance) -> None:
        self._model, self._data, self._frame = kin.model, kin.data, kin.tip_frame
        self._position_bound = tolerance.position**2
        self._orientation_bound = tolerance.orientation**2
        self._way, self._lengths = check_goal(goal).way, goal.lengths
        self._T_base_world = pin.SE3(kin.T_world_base).inverse()

    def linearise(self, q: Floats) -> tuple[Floats, Floats]:
        """Compute error (m,) and Jacobian (m, n) at `q`, with as many rows as the goal has conditions."""
        pin.computeJointJacobians(self._model, self._data, q)
        J = pin.getFrameJacobian(self._model, self._data, self._frame, pin.LOCAL)
        tip = self._T_base_world.act(pin.updateFramePlacement(self._model, self._data, self._frame))
        e, L = self._way(tip)
        return e, J[: len(e)] if L is None else L.dot(J)

    def reached(self, e: Floats) -> bool:
        position, orientation = e[: self._lengths], e[self._lengths :]
        near = position.dot(position) <= self._position_bound
        return bool(near and orientation.dot(orientation) <= self._orientation_bound)


class JointSpace:
    """Limits of an arm as a search sees them.

    Attributes:
        search_lower, search_upper: The arm's limits [rad, m], shape (n,); -inf and inf where a joint turns full circle.
        damping: What a squared step of each joint costs, shape (n,): 1 per rad^2, and as much per square of the metres
            by which the tip moves in a turn of 1 rad with the arm stretched out.
    """

    def __init__(self, kin: ArmKinematics) -> None:
        self._limits = lower, upper = kin.sampling_limits
        self._turns = ~kin.slides
        full_circle = (upper - lower >= TURN) & self._turns
        self.search_lower: Floats = np.where(full_circle, -np.inf, lower)
        self.search_upper: Floats = np.where(full_circle, np.inf, upper)
        self._joints = list(zip(lower.tolist(), upper.tolist(), full_circle.tolist(), strict=True))
        self.damping: Floats = np.ones(kin.n)
        if kin.slides.any():
            self.damping[kin.slides] = length_of(kin) ** -2.0
        self._endless = np.isinf(kin.lower) if np.isinf(kin.lower).any() else None

    def around(self, q: Floats) -> tuple[Floats, Floats]:
        """Return the range of random postures [rad]: the limits, and of a joint with many turns one about `q`."""
        low, high = self._limits
        near = np.clip(q, low + TURN / 2.0, high - TURN / 2.0)
        many = (high - low > MANY_TURNS * TURN) & self._turns
        return np.where(many, near - TURN / 2.0, low), np.where(many, near + TURN / 2.0, high)

    def fold(self, q: Floats) -> Floats:
        """Turn full-circle joints by the fewest turns that bring them into the limits, and clamp the others.

        A joint without end is brought within one turn, from -pi to pi.
        """
        return np.array([_fold(angle, *joint) for angle, joint in zip(q.tolist(), self._joints, strict=True)])

    def unfold(self, q: Floats, seed: Floats) -> Floats:
        """Turn joints without end by the turns that bring them next to a seed."""
        return q if self._endless is None else q + self._endless * TURN * np.rint((seed - q) / TURN)


def length_of(kin: ArmKinematics) -> float:
    """Sum of the distances from each joint to the next, and to the tip, with half of each slide [m]; 1 if it is 0."""
    links = float(np.linalg.norm(kin.chain.placements[1:, :3, 3], axis=1).sum())
    return links + 0.5 * float((kin.upper - kin.lower)[kin.slides].sum()) or 1.0


def _fold(angle: float, lower: float, upper: float, full_circle: bool) -> float:
    if lower <= angle <= upper:
        return angle
    if full_circle:
        turns = math.ceil((lower - angle) / TURN) if angle < lower else -math.ceil((angle - upper) / TURN)
        angle += turns * TURN
    return min(max(angle, lower), upper)


DEFAULT_TOLERANCE = Tolerance()

#: Largest number of steps and of restarts that can be set.
MAX_COUNT = 10_000


#: A step below this [rad] ends an attempt: the limits or a singular posture hold it.
STALLED = 1e-5


class Descent(NamedTuple):
    """End of one descent: posture [rad] (n,), which may be some turns outside the limits, and steps."""

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
        errors = self.position_error, self.orientation_error
        return IKResult(self.q, status, *errors, reason, iterations=iterations, restarts=restarts)


class IterativeSolver(ABC):
    """A local method made global by restarts.

    Every attempt ends with the posture folded into the limits and judged anew by forward kinematics, so that success
    is a property of the posture that is returned. The random postures are drawn from a generator that each call to
    `solve` seeds afresh: equal inputs give equal results whatever was asked before.

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
        self.max_iterations = check_count("max_iterations", max_iterations, most=MAX_COUNT)
        self.max_restarts = check_count("max_restarts", max_restarts, least=0, most=MAX_COUNT)
        self.rng_seed = check_count("rng_seed", rng_seed, least=0)
        self.joint_space = JointSpace(kin)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.kin!r})"

    @abstractmethod
    def _descender(self, goal: Goal) -> Descend:
        """Prepare the descent for one goal."""

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Find a posture for `goal`.

        Args:
            goal: In the base frame of `kin`, for its tip. A goal with more conditions than the arm has joints (a full
                pose on the 3-DOF arm) is found if the arm can meet it, and otherwise does not converge.
            seed: First posture to descend from [rad], shape (n,); folded into the limits if it is outside. Joints that
                turn without end are within half a turn of it in the result.
            accept: Test that the posture must also pass; a refused one leads to the next restart.

        Returns:
            The first posture that is within tolerance and limits and accepted. Failing that, the first refused one
            with `REJECTED`, or the one nearest to the goal with `NOT_CONVERGED`; a radian
            counts as the length of all links.

        Raises:
            InputError: The goal or the seed is malformed.
        """
        near = self.kin.as_posture("seed", seed)
        start = self.joint_space.fold(near)
        check_accept(accept)
        descend = self._descender(goal)
        refused: list[_Candidate] = []
        missed: list[_Candidate] = []
        iterations = 0
        for restarts, q in enumerate(self._starts(start)):
            descent = descend(q)
            iterations += descent.iterations
            candidate = self._judge(goal, descent.q, near)
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
        reach = max(float(np.linalg.norm(self.kin.chain.placements[1:, :3, 3], axis=1).sum()), self.tolerance.position)
        nearest = min(missed, key=lambda candidate: candidate.position_error / reach + candidate.orientation_error)
        reason = (
            f"none of {attempts} came within {self.tolerance.position:g} m and {self.tolerance.orientation:g} rad; "
            f"the nearest is {nearest.position_error:.3g} m and {nearest.orientation_error:.3g} rad away"
        )
        return nearest.result(Status.NOT_CONVERGED, reason, iterations=iterations, restarts=self.max_restarts)

    def _starts(self, first: Floats) -> Iterator[Floats]:
        yield first
        rng = np.random.default_rng(self.rng_seed)
        lower, upper = self.joint_space.around(first)
        for _ in range(self.max_restarts):
            yield rng.uniform(lower, upper)

    def _judge(self, goal: Goal, found: Floats, seed: Floats) -> _Candidate:
        q = self.joint_space.unfold(self.joint_space.fold(found), seed)
        position, orientation = goal.error(self.kin.fk(q))
        miss = max(position / self.tolerance.position, orientation / self.tolerance.orientation)
        return _Candidate(q, position, orientation, miss)


class SteppingSolver(IterativeSolver):
    """A local method whose steps keep to the joints' speed limits.

    Args:
        kin: The arm, its tip and the base frame that goals are in.
        tolerance: How near is reached.
        dt: Duration of one step [s]; the URDF's speed limits v allow v dt in it.
        max_iterations: Steps per attempt.
        max_restarts: Attempts from random postures after the one from the seed.
        rng_seed: Seed of the random postures.

    Raises:
        InputError: A count, a tolerance or `dt` cannot be used.
    """

    def __init__(
        self,
        kin: ArmKinematics,
        *,
        tolerance: Tolerance = DEFAULT_TOLERANCE,
        dt: float = 0.2,
        max_iterations: int = 30,
        max_restarts: int = 20,
        rng_seed: int = 0,
    ) -> None:
        super().__init__(
            kin, tolerance=tolerance, max_iterations=max_iterations, max_restarts=max_restarts, rng_seed=rng_seed
        )
        self.dt = check_number("dt", dt, above=0.0, most=1e3)
        self._prepare()

    @abstractmethod
    def _prepare(self) -> None:
        """Prepare the parts that all goals share."""
