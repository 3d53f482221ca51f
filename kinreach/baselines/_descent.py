"""Learners without trial and error: gradient descent on the actor's distance from a goal."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch

from kinreach._checks import Floats
from kinreach.baselines._adaptive_ppo import AdaptivePPO
from kinreach.baselines.expert import table_top
from kinreach.baselines.random_arms import RandomArmEpisodes
from kinreach.envs.inside import SpaceTask, measured, moving, reach_task

#: From the mean actions of some rows of a batch, and their indices, to what is to be made small.
Objective = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]


class GradientLearner(AdaptivePPO):
    """Gradient descent of the actor on an objective for the observed goals.

    Actions are rolled out as in the other algorithms for the learning curve; rewards are not used.
    """

    def objective(self, observations: Floats) -> Objective:
        """Return the objective to minimise for a batch of observations, shape (n, m)."""
        raise NotImplementedError

    def seen(self) -> Floats:
        """Return the observations to learn from, shape (n, m): all since the last update."""
        rolled: Any = self.rollout_buffer
        return np.asarray(rolled.observations.reshape(-1, rolled.obs_shape[0]).astype(np.float64))

    def train(self) -> None:
        self._update_learning_rate(self.policy.optimizer)
        observations = self.seen()
        objective, seen = self.objective(observations), torch.as_tensor(observations, dtype=torch.float32)
        for _ in range(self.n_epochs):
            for rows in torch.split(torch.randperm(len(seen)), self.batch_size):
                distribution: Any = self.policy.get_distribution(seen[rows])
                loss = objective(distribution.distribution.mean, rows)
                self.policy.optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                self.policy.optimizer.step()
        self._n_updates += self.n_epochs
        self.logger.record("train/loss", loss.item())
        self._explore()


def feeler_depth(tips: torch.Tensor, feelers: torch.Tensor, least: float) -> torch.Tensor:
    """Return the summed depth, shape (n,), of the tips' feelers below the height `least` [m].

    Tips have shape (n, 4, 4); feelers are points in their frames [m], shape (k, 3).
    """
    heights = tips[:, 2, :3] @ feelers.T + tips[:, 2, 3:]
    return (least - heights).clamp(min=0.0).sum(1)


#: Weight of the tool's angle in tasks without a direction [m/rad].
DOWN = 0.02


class AnalyticGradient(GradientLearner):
    """Analytic policy gradient of the distance from the goal, through forward kinematics.

    As in differentiable simulators (Freeman et al. 2021, Brax, arXiv:2106.13281, section 4.2), for one step. It uses
    no closed form; its branch is that of its initial posture. Collisions have no gradient: their stand-ins are the
    depth of some points of the tool in the table, and joints beyond angles at which links meet.

    Args:
        feelers: Points fixed to the tip that are to stay above the table [m], shape (k, 3).
        largest: Angles that joints are to stay within on either side of zero [rad], shape (n,); none: any.
    """

    def __init__(
        self,
        *args: Any,
        task: SpaceTask,
        feelers: Sequence[Sequence[float]] = (),
        largest: Sequence[float] = (),
        **kwargs: Any,
    ) -> None:
        self.task = task
        self.feelers = torch.tensor(feelers, dtype=torch.float32).reshape(-1, 3)
        self.largest = torch.tensor(largest or math.inf, dtype=torch.float32)
        super().__init__(*args, **kwargs)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "task"]

    def objective(self, observations: Floats) -> Objective:
        """Distance of the tip from the goal, `LEVER` times the angle of the tool, depth of the feelers [m]; mean.

        And `FOLDED` times what joints are beyond their largest angles.
        """
        task, chain = self.task, self.task.kinematics.chain
        half, middle = (torch.as_tensor(part, dtype=torch.float32) for part in reach_task.action_range(task.arm))
        goals = torch.as_tensor(measured(task, observations[:, task.layout.goal]).seen, dtype=torch.float32)
        directions = torch.as_tensor(observations[:, task.layout.direction], dtype=torch.float32)

        least = table_top(task.arm) + CLEARANCE

        def error(means: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
            q = middle + half * means
            tips = chain.fk(q)
            miss = (tips[:, :3, 3] - goals[rows]).square().sum(1)
            turn = (tips[:, :3, 2] - directions[rows]).square().sum(1)  # the angle squared, where it is small
            depth = feeler_depth(tips, self.feelers, least)
            beyond = (q.abs() - self.largest).clamp(min=0.0).sum(1)
            return ((miss + ROOT_OF).sqrt() + LEVER * (turn + ROOT_OF).sqrt() + depth + FOLDED * beyond).mean()

        return error


class SimulatorGradient(GradientLearner):
    """Gradient descent on the outcome of the next actions, in a simulation with more knowledge than the actor."""

    def __init__(self, *args: Any, world: Any, **kwargs: Any) -> None:
        self.world = world
        super().__init__(*args, **kwargs)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "world"]

    def seen(self) -> Floats:
        """Return the current observations, to which the state of the world belongs."""
        return np.array(self._last_obs, dtype=np.float64)

    def missed(
        self, q: torch.Tensor, places: Callable[[Floats], tuple[Floats, Floats]], down: float = DOWN
    ) -> torch.Tensor:
        """Return the mean distance of the tips from their goals, and `down` times the angle of the tool.

        From the postures `q` [rad], `places` gives how far the tips are from where the data sheet has them, and where
        they should be [m]; both without a gradient.
        """
        tips = self.world.chain.fk(q)
        off, goals = (torch.as_tensor(part, dtype=torch.float32) for part in places(q.detach().numpy().astype(float)))
        miss = (tips[:, :3, 3] + off - goals).square().sum(1)
        turn = (tips[:, :3, 2] - torch.tensor(reach_task.TOOL_DOWN)).square().sum(1)
        return ((miss + ROOT_OF).sqrt() + down * (turn + ROOT_OF).sqrt()).mean()


class MovingGradient(SimulatorGradient):
    """Learn to meet a rolling ball at the place where it will be when the arm can be there.

    Args:
        feelers: Points fixed to the tip that are to stay above the table, on the way as well [m], shape (k, 3).
    """

    world: moving.MovingEpisodes

    def __init__(self, *args: Any, feelers: Sequence[Sequence[float]] = (), down: float = DOWN, **kwargs: Any) -> None:
        self.feelers, self.down = torch.tensor(feelers, dtype=torch.float32).reshape(-1, 3), down
        super().__init__(*args, **kwargs)

    def objective(self, observations: Floats) -> Objective:
        """Return the distance of the tip from the ball at the time when the slowest joint has arrived.

        And the depth of the feelers, there and on the way [m].
        """
        world, rate = self.world, moving.FRAMES * moving.PARTS
        q, v, frames, rolls = world.q.copy(), world.v.copy(), world.frames.copy(), world.rolls.astype(np.float32)
        speed, acceleration = (world.strength * limit for limit in (world.speed_limit, world.acceleration_limit))
        least = table_top(world.arm) + GRIPPER_CLEARANCE

        def error(means: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
            own = rows.numpy()

            def places(targets: Floats) -> tuple[Floats, Floats]:
                limits = {"speed": speed[own], "acceleration": acceleration[own]}
                needed = moving.travel_times(q[own], v[own], targets, **limits).max(axis=1)
                at = np.minimum(np.round(frames[own] * moving.PARTS + needed * rate).astype(int), rolls.shape[1] - 1)
                return np.zeros((len(own), 3)), rolls[own, at]

            target = math.pi * means
            missed = self.missed(target, places, self.down)
            if not len(self.feelers):
                return missed
            start = torch.as_tensor(q[own], dtype=torch.float32)
            ways = (world.chain.fk(start + part * (target - start)) for part in WAY)
            return missed + sum(feeler_depth(tips, self.feelers, least).mean() for tips in ways) / len(WAY)

        return error


class RandomArmGradient(SimulatorGradient):
    """Learn to reach with arms that only looks describe."""

    world: RandomArmEpisodes

    def objective(self, observations: Floats) -> Objective:
        balls = self.world.goals.copy()

        def error(means: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
            own = rows.numpy()

            def places(q: Floats) -> tuple[Floats, Floats]:
                return self.world.tips(q, own) - self.world.chain.positions(q), balls[own]

            return self.missed(math.pi * means, places)

        return error


#: Weight of the tool's angle beside the distance [m/rad].
LEVER = 0.1
#: Weight of an angle beyond the largest [m/rad]; ten times that of the tool's, which gives way.
FOLDED = 1.0
#: How far above the table feelers are to stay [m], and those of a gripper that comes down on a ball.
CLEARANCE, GRIPPER_CLEARANCE = 0.01, 0.004
#: Parts of the way at which feelers are tried.
WAY = (0.25, 0.5, 0.75, 1.0)
#: Keeps the slope of a root finite where an error is zero.
ROOT_OF = 1e-10
