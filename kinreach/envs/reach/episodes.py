"""Episodes of a number of arms in step: the whole task but for Gymnasium's interface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinreach.envs.reach.goals import GoalStreams
from kinreach.envs.reach.observers import GoalObserver
from kinreach.envs.reach.task import ReachVariant, observation
from kinreach.envs.reach.world import Executed, Ids, ReachWorld
from kinreach.kinematics.goals import Floats
from kinreach.kinematics.reward_geometry import ReachReward, reach_reward
from kinreach.robots import ArmDescription

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one step of all arms led to; every array has the number of arms first."""

    executed: Executed
    distance: Floats
    scored: ReachReward
    terminated: Flags
    truncated: Flags


class ReachEpisodes:
    """The state of the episodes and their rules, for one arm or thousands.

    Args:
        arm: Description of the arm.
        variant: Single- or multi-step.
        world: Executes the postures.
        observer: Measures the goals.
        end_on_reached: Whether reaching the goal ends an episode of several steps.

    Attributes:
        goals: Where the balls are in the world [m], shape (count, 3).
        found: Which of the cameras found them, shape (count, 2).
    """

    def __init__(
        self,
        arm: ArmDescription,
        variant: ReachVariant,
        world: ReachWorld,
        observer: GoalObserver,
        *,
        end_on_reached: bool,
    ) -> None:
        count = world.count
        self.variant = variant
        self.goals = np.zeros((count, 3))
        self.found = np.zeros((count, 2), dtype=np.bool_)
        self._world = world
        self._observer = observer
        self._end_on_reached = end_on_reached
        self._opening = 0.0 if arm.gripper is None else arm.gripper.opening
        self._streams = GoalStreams(arm.workcell.goals, count)
        self._sensors = [np.random.default_rng() for _ in range(count)]
        self._views = np.zeros((count, 6))
        self._steps = np.zeros(count, dtype=np.int64)

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Give an arm its own generators, for goals and for sensor noise."""
        goal_rng, self._sensors[index] = rng.spawn(2)
        self._streams.seed(index, goal_rng)

    def begin(self, ids: Ids, goals: Floats | None = None, q: Floats | None = None) -> None:
        """Start new episodes: arm in the start pose, a new goal, measured once.

        Args:
            ids: Whose episodes, shape (k,).
            goals: Goals to take instead of new ones [m], shape (k, 3).
            q: Postures to start in instead [rad], shape (k, 6); goals are measured from the start pose all the same.
        """
        goals = self._streams.draw(ids) if goals is None else goals
        self._world.reset(ids, goals, q)
        views, found = self._observer.look(goals, ids, self._sensors)
        rows = slice(None) if len(ids) == self._world.count else ids  # a slice is much faster than as many indices
        self.goals[rows], self._views[rows], self.found[rows], self._steps[rows] = goals, views, found, 0

    def observe(self) -> Floats:
        """The 13 numbers of every arm, shape (count, 13)."""
        return observation(self._views, self._world.q, self._opening)

    def step(self, actions: Floats) -> Outcome:
        """Act with every arm.

        Args:
            actions: In [-1, 1], shape (count, 6).
        """
        targets = self.variant.targets(self._world.q, actions)
        executed = self._world.execute(targets, two_phase=self.variant.two_phase)
        distance = np.sqrt(((executed.tip - self.goals) ** 2).sum(axis=1))
        scored = reach_reward(distance, executed.q, impossible=executed.impossible)
        self._steps += 1
        over = self._steps >= self.variant.max_steps
        if self.variant.max_steps == 1:
            return Outcome(executed, distance, scored, over, np.zeros_like(over))
        terminated = scored.reached & self._end_on_reached
        return Outcome(executed, distance, scored, terminated, over & ~terminated)

    def close(self) -> None:
        """Let go of the world and the cameras."""
        self._world.close()
        self._observer.close()
