"""Goals for an arm whose work cell has none: where it can reach, whatever its size and wherever it stands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kinreach._checks import Floats
from kinreach.envs._reach.reach_task import tool_goal
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CollisionChecker, LevenbergMarquardtSolver
from kinreach.robots import ArmDescription

#: Goals are this far from the first joint's axis, as shares of the largest distance of the tip: away from the arm's own
#: body, and from where it is stretched.
MIN_SHARE, MAX_SHARE = 0.35, 0.75
#: Random postures that the largest distance is taken of, and those drawn for one goal before the search is given up.
POSTURES, MAX_TRIES = 2000, 500


@dataclass(frozen=True, eq=False)
class ReachableGoals:
    """Tip positions of random postures, kept where a solver reaches them as the task asks, without a collision.

    They lie above the base, but for an arm whose tip is always below it, such as a SCARA's, and at 35 to 75 % of the
    arm's reach. The solver is Levenberg-Marquardt with restarts: a goal
    that it does not find is left out for all methods.
    """

    arm: ArmDescription

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw `count` goal positions in the world frame [m], shape (count, 3)."""
        return np.array([self._one(rng) for _ in range(count)]).reshape(-1, 3)

    def _one(self, rng: np.random.Generator) -> Floats:
        kin, home = self._kinematics, np.array(self.arm.home)
        for _ in range(MAX_TRIES):
            point = kin.positions(rng.uniform(*kin.sampling_limits))
            away = np.hypot(*(point - self._base)[:2])
            if point[2] < self._lowest or not MIN_SHARE * self._reach < away < MAX_SHARE * self._reach:
                continue
            if self._solver.solve(tool_goal(self.arm, point), home, accept=self._checker.free).success:
                return point
        raise InputError(
            f"no goal that arm {self.arm.name!r} reaches without a collision was found in {MAX_TRIES} tries; give it "
            "a Workcell with goals=BoxRegion(x, y, z)"
        )

    @cached_property
    def _kinematics(self) -> ArmKinematics:
        return ArmKinematics(self.arm, base="world")

    @cached_property
    def _base(self) -> Floats:
        placement: Floats = self._kinematics.model.jointPlacements[1].translation
        return placement

    @cached_property
    def _from_base(self) -> Floats:
        """Tip positions of random postures, from the first joint [m], shape (POSTURES, 3)."""
        kin = self._kinematics
        q = np.random.default_rng(0).uniform(*kin.sampling_limits, (POSTURES, kin.n))
        return kin.positions(q) - self._base

    @cached_property
    def _reach(self) -> float:
        return float(np.hypot(*self._from_base[:, :2].T).max())

    @cached_property
    def _lowest(self) -> float:
        return float(self._base[2]) if (self._from_base[:, 2] >= 0.0).any() else -np.inf

    @cached_property
    def _checker(self) -> CollisionChecker:
        return CollisionChecker(self._kinematics)

    @cached_property
    def _solver(self) -> LevenbergMarquardtSolver:
        return LevenbergMarquardtSolver(self._kinematics, max_restarts=5)


def with_goals(arm: ArmDescription) -> ArmDescription:
    """Return the same arm with `ReachableGoals`, unless its work cell has goals already."""
    if arm.workcell.goals is not None:
        return arm
    return replace(arm, workcell=replace(arm.workcell, goals=ReachableGoals(arm)))
