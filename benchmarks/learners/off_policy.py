"""stable-baselines3's off-policy learners of continuous actions, with exploration and learning rate by a schedule.

They explore at the schedule's scale from the first action on; stable-baselines3 draws uniform actions until it
learns. Their critics tell actions apart that differ by little: 10 mm are 0.004 of a joint's range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import torch
from stable_baselines3 import DDPG, SAC, TD3
from stable_baselines3.common.noise import ActionNoise, NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy, ContinuousCritic
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy
from torch import Tensor, nn
from torch.optim import Optimizer

from kinreach._registration import MULTI, SINGLE
from kinreach.baselines import Algorithm, Networks, Recipe, SB3VecEnv, register_algorithm, register_recipe
from kinreach.baselines._algorithms import mlp_arguments
from kinreach.baselines._ranked_ppo import Exploration, share_left
from kinreach.baselines._rewards import REWARDS, dense
from kinreach.envs._reach.reach_task import action_range
from kinreach.robots import get_arm

#: What the weights of an actor's last layer are multiplied by to begin with.
FLATTENED = 0.01


class GainCritic(ContinuousCritic):
    """A critic that takes actions in smaller units: networks learn slowly what changes within a small part of an input.

    Args:
        gain: What actions are multiplied by.
        **kwargs: Of `ContinuousCritic`.
    """

    def __init__(self, *args: Any, gain: float, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.gain = gain

    def forward(self, obs: Any, actions: Tensor) -> tuple[Tensor, ...]:
        """Values by every network, shape (n, 1) each."""
        return super().forward(obs, self.gain * actions)

    def q1_forward(self, obs: Any, actions: Tensor) -> Tensor:
        """Values by the first network, shape (n, 1)."""
        return super().q1_forward(obs, self.gain * actions)


class WithGain(BasePolicy):
    """A policy with a `GainCritic`.

    Args:
        gain: Of the critic.
        **kwargs: Of the policy.
    """

    critic_kwargs: dict[str, Any]

    def __init__(self, *args: Any, gain: float, **kwargs: Any) -> None:
        self.gain = gain
        super().__init__(*args, **kwargs)

    def make_critic(self, features_extractor: BaseFeaturesExtractor | None = None) -> GainCritic:
        """The critic, or its target."""
        arguments = self._update_features_extractor(self.critic_kwargs, features_extractor)
        return GainCritic(**arguments, gain=self.gain).to(self.device)


class GainTD3Policy(WithGain, TD3Policy):
    """TD3 and DDPG with a gain of the actor."""


class GainSACPolicy(WithGain, SACPolicy):
    """SAC with a gain of the actor."""


class Scheduled(OffPolicyAlgorithm):
    """How far a training is, and what follows from it.

    Args:
        exploration: Schedule of the standard deviation of actions.
        planned_steps: Actions of the whole training, to which the schedules refer.
        start: Action that the actor begins with, whatever it observes, each in (-1, 1).
        decay: Share of the training at whose end the learning rate falls to zero linearly.
        **kwargs: Of the learner.
    """

    actor: Any

    def __init__(
        self,
        *args: Any,
        exploration: Exploration,
        planned_steps: int,
        start: Sequence[float],
        decay: float = 0.0,
        **kwargs: Any,
    ) -> None:
        self.exploration, self.planned_steps, self.decay, self.start = exploration, planned_steps, decay, start
        super().__init__(*args, **kwargs)

    @property
    def progress(self) -> float:
        """Share of the training that is done."""
        return min(self.num_timesteps / self.planned_steps, 1.0)

    @property
    def deviation(self) -> float:
        """The standard deviation of the next actions."""
        return self.exploration.at(self.progress)

    def _update_learning_rate(self, optimizers: list[Optimizer] | Optimizer) -> None:
        rate = self.lr_schedule(1.0) * share_left(self.progress, self.decay)
        for optimizer in optimizers if isinstance(optimizers, list) else [optimizers]:
            for group in optimizer.param_groups:
                group["lr"] = rate
        self.logger.record("train/learning_rate", rate)

    def _begin_at_start(self, head: nn.Linear) -> None:
        with torch.no_grad():
            head.weight.mul_(FLATTENED)
            head.bias.copy_(torch.tensor(self.start).atanh())


class Noisy(Scheduled):
    """A deterministic actor with normal noise."""

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MlpPolicy": GainTD3Policy}
    actor_target: Any

    def _setup_model(self) -> None:
        super()._setup_model()
        self._begin_at_start(self.actor.mu[-2])  # the last is the tanh
        self.actor_target.load_state_dict(self.actor.state_dict())

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        mean = np.zeros((n_envs, *(self.action_space.shape or ())))
        return super()._sample_action(0, NormalActionNoise(mean, np.full_like(mean, self.deviation)), n_envs)


class ScheduledTD3(Noisy, TD3):
    """TD3 (Fujimoto, van Hoof, Meger, ICML 2018)."""


class ScheduledDDPG(Noisy, DDPG):
    """DDPG (Lillicrap et al., ICLR 2016), which the thesis names (7.1)."""


class ScheduledSAC(Scheduled, SAC):
    """SAC (Haarnoja et al., ICML 2018); the entropy that it aims at is that of the scheduled normal distribution."""

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MlpPolicy": GainSACPolicy}

    def _setup_model(self) -> None:
        super()._setup_model()
        self._begin_at_start(self.actor.mu)
        nn.init.zeros_(self.actor.log_std.weight)
        nn.init.constant_(self.actor.log_std.bias, math.log(self.deviation))

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        return super()._sample_action(0, action_noise, n_envs)

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Updates towards the entropy of this part of the training."""
        size = math.prod(self.action_space.shape or ())
        self.target_entropy = size * math.log(self.deviation * math.sqrt(2 * math.pi * math.e))
        super().train(gradient_steps, batch_size)


def scheduled_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Keyword arguments of these learners: `exploration` as an `Exploration`, and the critic's `gain`.

    The actor begins in the middle of its actions, or, where its output is a posture, at the start pose.
    """
    arguments = mlp_arguments(recipe, env, planned) | {"planned_steps": planned}
    arguments["policy_kwargs"]["gain"] = arguments.pop("gain")
    arguments["exploration"] = Exploration(**arguments["exploration"])
    arguments["start"] = np.zeros(env.action_space.shape or ()).tolist()
    if recipe.networks.posture:
        arm = get_arm("ur5-thesis")
        half, middle = action_range(arm)
        arguments["start"] = ((np.asarray(arm.home) - middle) / half).tolist()
    return arguments


def clipped(rewards: Any, info: Mapping[str, Any]) -> Any:
    """Return the environment's reward, not below -5: lower ones spoil critics that are functions of the action."""
    return np.maximum(rewards, -5.0)


def dense_clipped(rewards: Any, info: Mapping[str, Any]) -> Any:
    """Return the dense reward, not below -20."""
    return np.maximum(dense(rewards, info), -20.0)


REWARDS.update({"clipped": clipped, "dense-clipped": dense_clipped})
for learner in (ScheduledSAC, ScheduledTD3, ScheduledDDPG):
    register_algorithm(Algorithm(learner.__name__, learner, arguments=scheduled_arguments))


#: 64 environments in step: 160 000 actions, about as many as the thesis's. The standard deviation begins with the
#: thesis's unit, 1 rad or 1 degree (an action of 1 is π rad and 5 degrees), and ends with a hundredth and a twentieth.
_OFF_POLICY = {
    "learning_rate": 1e-3,
    "learning_starts": 1_000,
    "batch_size": 256,
    "train_freq": 1,
    "gradient_steps": 4,
    "decay": 0.3,
}
#: What a search found for TD3, which reaches nothing with it either.
_DETERMINISTIC_MULTI = {"learning_rate": 1.3e-3, "learning_starts": 16_000, "gamma": 0.9, "gain": 0.3}
_RADIANS = {"first": 1 / math.pi, "last": 0.01 / math.pi, "until": 0.9}
_DEGREES = {"first": 1 / 5, "last": 0.05 / 5, "until": 0.9}


def _recipe(algorithm: str, environment: str, reward: str = "clipped", **settings: Any) -> Recipe:
    """An off-policy learner with scheduled exploration, with settings that were tuned on validation goals."""
    single = environment == SINGLE
    own = {"buffer_size": 20_000, "gamma": 0.0, "gain": 10.0, "exploration": _RADIANS}
    if not single:
        own = {"buffer_size": 160_000, "gamma": 0.5, "gain": 1.0, "exploration": _DEGREES}
    recipe = Recipe(
        name=f"{algorithm.lower()}-{'single' if single else 'multi'}",
        summary=f"{algorithm} from a replay buffer, exploring in the thesis's units; tuned.",
        environment=environment,
        options={"backend": "kinematic", **({} if single else {"end_on_reached": False})},
        algorithm=f"Scheduled{algorithm}",
        steps=160_000,
        num_envs=64,
        reward=reward,
        networks=Networks(
            hidden=(128, 128), activation="relu", features="goal waves" if single else "scaled", posture=single
        ),
        settings={**_OFF_POLICY, **own, **settings},
        window=3_200,
    )
    return register_recipe(recipe)


sac_single = _recipe("SAC", SINGLE)
td3_single = _recipe("TD3", SINGLE)
ddpg_single = _recipe("DDPG", SINGLE)
sac_multi = _recipe("SAC", MULTI)
td3_multi = _recipe("TD3", MULTI, reward="dense-clipped", **_DETERMINISTIC_MULTI)
ddpg_multi = _recipe("DDPG", MULTI, reward="dense-clipped", **_DETERMINISTIC_MULTI)
