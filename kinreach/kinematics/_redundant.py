"""Kinematics of arms with more joints than a pose needs, of which no class knows every posture: numeric."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import Floats
from kinreach._rotations import small_motion
from kinreach.errors import InputError
from kinreach.kinematics._arm import POSE_JOINTS, ArmKinematics
from kinreach.kinematics._collision import CollisionChecker
from kinreach.kinematics._goals import PoseGoal, rigid_pose
from kinreach.kinematics._solutions import Accept, IKResult, Status, Tolerance, check_accept
from kinreach.kinematics._solvers.levenberg_marquardt import LevenbergMarquardtSolver

#: How near a posture comes to its pose [m, rad], and starts of the search.
EXACT, STARTS = Tolerance(1e-9, 1e-9), 8
#: Steps from each start; the first and the shortest, in the joint that moves most [rad].
STEPS, FIRST, SHORTEST = 100, 0.2, 1e-7
#: Steps of Newton's method back to the pose.
NEWTON = 6
#: Change of a posture by which a measure's derivative is taken [rad].
CHANGE = 1e-5

#: A measure of postures (n,), of which much is wanted.
Measure = Callable[[Floats], float]
#: Its gradient there, of scaled joints.
Gradient = Callable[[Floats], Floats]


class RedundantKinematics(ArmKinematics):
    """Kinematics of an arm with more than seven joints, or with seven that `SevenAxisKinematics` does not take.

    A pose has a family of postures. `nearest`, `clearest` and `manipulable` choose from it by a numeric solver from
    several starts, and steps that leave the tip where it is. They find the best posture next to each start, not
    certainly the best of all, and no call lists every posture. Threads may share an instance.

    Args:
        arm: Name of a registered arm, or a description.
        tip: Short name of the tip frame; default is the arm's own tool centre point.
        base: As in `ArmKinematics`.

    Raises:
        UnknownNameError: The arm, the tip or the base does not exist.
        InputError: The arm has six joints or fewer.
    """

    _closed_forms: ClassVar = {}

    def _prepare(self) -> None:
        if self.n <= POSE_JOINTS:
            raise InputError(f"arm {self.arm.name!r} has {self.n} joints, no more than a pose needs")
        self._solver = LevenbergMarquardtSolver(self, tolerance=EXACT, max_restarts=0, max_iterations=60)
        self._scale = np.sqrt(self._solver.joint_space.damping)  # a metre counts as what moves the tip as far

    def nearest(self, T: ArrayLike, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Compute a posture for a pose near a seed, by a numeric solver: no other next to it is nearer.

        A slide's metres count as the radians in which the tip of the stretched arm moves as far.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4).
            seed: Posture [rad, m], shape (n,).
            accept: Called with candidates, the nearest first, until it returns True.

        Raises:
            InputError: `T` is not a finite rigid motion, or the seed is malformed.
        """
        check_accept(accept)
        start, pose = self.as_posture("seed", seed), rigid_pose(T)

        def nearer(q: Floats) -> float:
            return -float(np.sum((self._scale * (q - start)) ** 2))

        found = [self._climbed(q, pose, nearer, lambda q: self._scale * (start - q)) for q in self._starts(pose, start)]
        found.sort(key=nearer, reverse=True)
        return self._first(found, pose, start, accept)

    def clearest(self, T: ArrayLike, checker: CollisionChecker) -> IKResult:
        """Compute a posture for a pose whose shapes are far from each other and the obstacles, by a numeric solver.

        Raises:
            InputError: As `nearest`, or a checker of another arm or without pairs of shapes.
        """
        best = self._best(rigid_pose(T), lambda q: checker.distance(q).distance)
        if best.success and not checker.free(best.q):
            return replace(best, status=Status.REJECTED, reason="the posture found collides")
        return best

    def manipulable(self, T: ArrayLike) -> IKResult:
        """Compute a posture for a pose with much manipulability (Yoshikawa 1985), by a numeric solver.

        The Jacobian's column of a slide is that of as many metres as in `nearest` count as a radian.

        Raises:
            InputError: As `nearest`.
        """

        def measure(q: Floats) -> float:
            J = self.jacobian(q) / self._scale
            return float(np.sqrt(max(np.linalg.det(J @ J.T), 0.0)))

        return self._best(rigid_pose(T), measure)

    def _best(self, T: Floats, measure: Measure) -> IKResult:
        home = np.array(self.arm.home, dtype=np.float64)
        found = [self._climbed(q, T, measure, None) for q in self._starts(T, home)]
        return self._first(sorted(found, key=measure, reverse=True), T, home, None)

    def _starts(self, T: Floats, seed: Floats) -> Iterator[Floats]:
        """Postures of a pose that the solver finds from a seed, and from random postures."""
        rng, (low, high) = np.random.default_rng(0), self._solver.joint_space.around(seed)
        for number in range(STARTS):
            found = self._solver.solve(PoseGoal(T), rng.uniform(low, high) if number else seed)
            if found.success:
                yield self._solver.joint_space.unfold(found.q, seed)

    def _first(self, found: list[Floats], T: Floats, seed: Floats, accept: Accept | None) -> IKResult:
        """The first posture that is accepted."""
        if not found:
            reason = f"none of {STARTS} attempts reached the pose"
            return IKResult.of(self, PoseGoal(T), seed, tolerance=EXACT, reason=reason)
        results = [IKResult.of(self, PoseGoal(T), q, tolerance=EXACT, accept=accept) for q in found]
        return next((result for result in results if result.success), results[0])

    def _climbed(self, q: Floats, T: Floats, measure: Measure, gradient: Gradient | None) -> Floats:
        """A posture of the same pose next to which none has a larger measure, within the limits.

        The gradient is that of scaled joints; without it, it is taken from differences.
        """
        value, size = measure(q), FIRST
        for _ in range(STEPS):
            free = np.ones(self.n, dtype=np.bool_)
            for _ in range(self.n):  # joints at limits that the way would pass are held
                way = self._way(q, free, T, measure, gradient)
                blocked = ((q <= self.lower) & (way < 0.0)) | ((q >= self.upper) & (way > 0.0))
                if not (blocked & free).any():
                    break
                free &= ~blocked
            longest = float(np.abs(self._scale * way).max())
            if longest < SHORTEST or size < SHORTEST:
                break
            step = way * min(1.0, size / longest) if gradient is not None else way * (size / longest)
            within = np.clip(q + step, self.lower, self.upper)
            trial = self._back(within, T, free & (within == q + step))  # what arrives at a limit stays there
            if trial is not None and (better := measure(trial)) > value:
                q, value, size = trial, better, min(2.0 * size, FIRST)
            else:
                size *= 0.5
        return q

    def _way(
        self,
        q: Floats,
        free: NDArray[np.bool_],
        T: Floats,
        measure: Measure,
        gradient: Gradient | None,
    ) -> Floats:
        """The change of a posture (n,) that leaves the tip where it is, and along which the measure grows most."""
        J = np.where(free, self.jacobian(q) / self._scale, 0.0)
        still = np.vstack([J, np.diag(np.where(free, 0.0, 1.0))[~free]])
        _, s, V = np.linalg.svd(still)
        null = V[np.count_nonzero(s > 1e-6 * s[0]) :]
        if not len(null):
            return np.zeros(self.n)
        if gradient is not None:
            along = null @ gradient(q)
        else:
            ends = [[measure(q + sign * CHANGE * each / self._scale) for sign in (1.0, -1.0)] for each in null]
            along = np.array([(ahead - back) / (2.0 * CHANGE) for ahead, back in ends])
        return (along @ null) / self._scale

    def _back(self, q: Floats, T: Floats, free: NDArray[np.bool_]) -> Floats | None:
        """The posture of a pose next to one (n,), by Newton's method on free joints; None if there is none."""
        goal = PoseGoal(T)
        for _ in range(NEWTON):
            position, orientation = goal.error(here := self.fk(q))
            if max(position, orientation) < 0.1 * EXACT.position:
                return q if self.within_limits(q) else None
            J = np.where(free, self.jacobian(q) / self._scale, 0.0)
            q = q + np.linalg.lstsq(J, small_motion(T, here), rcond=1e-6)[0] / self._scale
        return None
