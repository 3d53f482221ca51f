"""PPO with a scheduled standard deviation and an adaptive learning rate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from stable_baselines3 import PPO

from kinreach.baselines._ranked_ppo import ScheduledLearner
from kinreach.envs.inside import moving


class AdaptivePPO(ScheduledLearner, PPO):
    """PPO of stable-baselines3 with the schedules of ranked PPO."""

    def train(self) -> None:
        super().train()
        self.adapt(float(self.logger.name_to_value["train/approx_kl"]))


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
