"""PPO with a scheduled standard deviation and an adaptive learning rate."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import torch
from stable_baselines3 import PPO
from torch.optim import Optimizer

from kinreach.envs.inside import moving


@dataclass(frozen=True)
class Exploration:
    """Standard deviation of actions in a training: log-linear from `first` to `last`, held after its share `until`."""

    first: float
    last: float
    until: float

    def scaled(self, factor: float) -> Exploration:
        return replace(self, first=factor * self.first, last=factor * self.last)

    def at(self, progress: float) -> float:
        """Return the standard deviation when `progress`, in [0, 1], of the training is done."""
        share = min(progress / self.until, 1.0)
        return math.exp((1 - share) * math.log(self.first) + share * math.log(self.last))


def share_left(progress: float, decay: float) -> float:
    """Return the factor of a learning rate that falls to zero linearly over the last `decay` of a training."""
    return min(1.0, max(1.0 - progress, 0.0) / decay) if decay > 0 else 1.0


@dataclass(frozen=True)
class AdaptiveRate:
    """A learning rate that is adjusted after every update, within `lowest` and `highest`.

    It is divided by `factor` if the Kullback-Leibler divergence was over 1.5 times `target_kl`, and multiplied if it
    was under 2/3 of it; over the last `decay` of the training it falls to zero linearly.
    """

    first: float
    target_kl: float
    factor: float = 1.3
    lowest: float = 1e-6
    highest: float = 1e-2
    decay: float = 0.0

    def after(self, rate: float, divergence: float) -> float:
        if divergence > 1.5 * self.target_kl:
            rate /= self.factor
        elif divergence < self.target_kl / 1.5:
            rate *= self.factor
        return min(max(rate, self.lowest), self.highest)

    def share(self, progress: float) -> float:
        return share_left(progress, self.decay)


class AdaptivePPO(PPO):
    """PPO of stable-baselines3 with a scheduled standard deviation and an adaptive learning rate.

    Without `exploration` the deviation is learned, or actions are discrete. `planned_steps` are those of the whole
    training, to which the schedules refer.

    Attributes:
        rate: The learning rate before the decay; checkpoints keep it.
    """

    def __init__(
        self, *args: Any, exploration: Exploration | None, adaptive: AdaptiveRate, planned_steps: int, **kwargs: Any
    ) -> None:
        self.exploration, self.adaptive, self.planned_steps = exploration, adaptive, planned_steps
        self.rate = adaptive.first
        super().__init__(*args, **{"learning_rate": adaptive.first, **kwargs})

    def _setup_model(self) -> None:
        super()._setup_model()
        if self.exploration is not None:
            self.policy.log_std.requires_grad_(False)
            self._explore()

    def _update_learning_rate(self, optimizers: list[Optimizer] | Optimizer) -> None:
        rate = self.rate * self.adaptive.share(self.progress)
        for optimizer in optimizers if isinstance(optimizers, list) else [optimizers]:
            for group in optimizer.param_groups:
                group["lr"] = rate
        self.logger.record("train/learning_rate", rate)

    @property
    def progress(self) -> float:
        return min(self.num_timesteps / self.planned_steps, 1.0)

    def train(self) -> None:
        super().train()
        self.rate = self.adaptive.after(self.rate, float(self.logger.name_to_value["train/approx_kl"]))
        self._explore()

    def _explore(self) -> None:
        if self.exploration is not None:
            with torch.no_grad():
                self.policy.log_std.fill_(math.log(self.exploration.at(self.progress)))


class LateCollisionsPPO(AdaptivePPO):
    """Adaptive PPO with a rolling ball; collisions end episodes only after the share `until` of the training."""

    def __init__(self, *args: Any, world: moving.MovingEpisodes, until: float, **kwargs: Any) -> None:
        self.world, self.until = world, until
        super().__init__(*args, **kwargs)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "world"]

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> bool:
        self.world.options = replace(self.world.options, collisions=self.progress >= self.until)
        return super().collect_rollouts(*args, **kwargs)
