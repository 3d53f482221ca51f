"""Episodes of a number of arms in step: the whole task but for Gymnasium's interface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinreach.checks import Floats
from kinreach.envs.batch import AHEAD, RowStreams
from kinreach.envs.reach.observers import GoalObserver
from kinreach.envs.reach.task import ANGLES, GOAL, GRIPPER, OBSERVATIONS, ReachVariant
from kinreach.envs.reach.worlds import Executed, Ids, ReachWorld
from kinreach.errors import InputError
from kinreach.robots import ArmDescription
from kinreach.robots.workcell import BoxRegion, GoalRegion
from kinreach.thesis.reward import ReachReward, reach_reward


class GoalStreams(RowStreams):
    """What `BoxRegion.sample` draws for each of a number of environments, to the bit, in a third of the time.

    Args:
        region: Where goals are.
        count: Number of environments.

    Raises:
        InputError: The region is not a box.
    """

    def __init__(self, region: GoalRegion, count: int) -> None:
        if not isinstance(region, BoxRegion):
            raise InputError(f"goals of the reach tasks are drawn in a box, not in {region}")
        super().__init__(region, count)
        self._low, high = np.array([region.x, region.y, region.z]).T
        self._size = high - self._low

    def draw(self, ids: np.ndarray) -> Floats:
        """The next goal of each of the given environments, in the world frame [m], shape (len(ids), 3)."""
        goals = self._size * self._taken(ids)
        goals += self._low
        return goals

    def _drawn(self, ids: np.ndarray) -> Floats:
        """Places in a box from 0 to 1; they are brought into the region when their turn comes."""
        places = np.empty((len(ids), AHEAD, 3))
        for index, place in zip(ids, places, strict=True):
            self._rngs[index].random(out=place)
        return places


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
        found: Which of the cameras found them, shape (count, 2). New episodes have new arrays, these stay as they are.
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
        self._streams = GoalStreams(arm.workcell.goals, count)
        self._sensors = [np.random.default_rng() for _ in range(count)]
        self._observation = np.zeros((count, OBSERVATIONS))
        self._observation[:, GRIPPER] = 0.0 if arm.gripper is None else arm.gripper.opening
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
        goals = self._streams.draw(ids) if goals is None else goals.copy()
        self._world.reset(ids, goals, q)
        views, found = self._observer.look(goals, ids, self._sensors)
        if len(ids) == self._world.count:
            self.goals, self.found = goals, found
            rows: Ids | slice = slice(None)  # much faster than as many indices
        else:
            rows, self.goals, self.found = ids, self.goals.copy(), self.found.copy()
            self.goals[rows], self.found[rows] = goals, found
        self._steps[rows] = 0
        self._observation[rows, GOAL] = views

    def observe(self) -> Floats:
        """The 13 numbers of every arm, shape (count, 13)."""
        self._observation[:, ANGLES] = self._world.q
        return self._observation.copy()

    def step(self, actions: Floats) -> Outcome:
        """Act with every arm.

        Args:
            actions: In [-1, 1], shape (count, 6).
        """
        targets = self.variant.targets(self._world.q, actions)
        executed = self._world.execute(targets, two_phase=self.variant.two_phase)
        x, y, z = (executed.tip[:, axis] - self.goals[:, axis] for axis in range(3))
        distance = np.sqrt(x * x + y * y + z * z)
        scored = reach_reward(distance, executed.q, impossible=executed.impossible)
        self._steps += 1
        over = self._steps >= self.variant.max_steps
        if self.variant.max_steps == 1:
            return Outcome(executed, distance, scored, over, np.zeros_like(over))
        terminated = scored.reached & self._end_on_reached
        if executed.diverged is not None:
            over |= executed.diverged
        return Outcome(executed, distance, scored, terminated, over & ~terminated)

    def close(self) -> None:
        """Let go of the world and the cameras."""
        self._world.close()
        self._observer.close()
