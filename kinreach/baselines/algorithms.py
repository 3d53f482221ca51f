"""Algorithms: PPO with schedules, ranked PPO, their networks, and how what they learned is exported.

Where the outcome of one action can be judged at once, as the reward of reaching can, a critic that predicts the mean
outcome of a state is the largest source of error of PPO. Here K actions are tried from every state and compared with
one another: the advantage of each is the normal score of its rank among the K. There is no critic, and no scale of the
reward to tune. The rest is PPO: clipped ratios, several epochs, minibatches.

Group-relative advantages are those of GRPO (Shao et al. 2024, DeepSeekMath, section 4.1), with ranks instead of
standardised rewards; rank-based shaping with normal scores is that of evolution strategies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from scipy.special import ndtri
from stable_baselines3 import DQN, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.distributions import DiagGaussianDistribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn
from torch.optim import Optimizer

from kinreach.baselines.policies import Network
from kinreach.errors import InputError


class ObservationFeatures(BaseFeaturesExtractor):
    """The first of the observations, normalised by constants, and waves of them.

    The features are z = (x - mean) / scale, and sin(w z), cos(w z) for every w. Observations beyond the length of
    `mean` are not used.

    Args:
        space: Of the observations, shape (n,).
        mean, scale: Constants of the normalisation, at most n numbers each.
        waves: Angular frequencies w.
    """

    def __init__(
        self,
        space: spaces.Box,
        *,
        mean: Sequence[float],
        scale: Sequence[float],
        waves: Sequence[float] = (),
    ) -> None:
        super().__init__(space, len(mean) * (1 + 2 * len(waves)))
        self.mean: Tensor
        self.scale: Tensor
        self.waves: Tensor
        self.register_buffer("mean", torch.tensor(mean, dtype=torch.float32))
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float32))
        self.register_buffer("waves", torch.tensor(waves, dtype=torch.float32))

    def forward(self, observations: Tensor) -> Tensor:
        """Features, shape (n, features_dim)."""
        z = (observations[:, : len(self.mean)] - self.mean) / self.scale
        if not len(self.waves):
            return z
        angles = (z[:, :, None] * self.waves).flatten(1)
        return torch.cat([z, angles.sin(), angles.cos()], dim=1)


class PairedGaussian(DiagGaussianDistribution):
    """A normal distribution whose samples come in antithetic pairs: rows 2i and 2i + 1 have opposite noise."""

    def sample(self) -> Tensor:
        """One sample a row; the number of rows must be even."""
        mean = self.distribution.mean
        noise = torch.randn(len(mean) // 2, mean.shape[1])
        return mean + self.distribution.stddev * torch.stack([noise, -noise], dim=1).flatten(0, 1)


class PostureHead(nn.Linear):
    """The mean action from the last hidden layer h: shift + gain (W h + b), which begins at the shift.

    Args:
        hidden: Length of h.
        gain: Action of one radian.
        shift: Action that means the start pose.
    """

    def __init__(self, hidden: int, *, gain: float, shift: Sequence[float]) -> None:
        super().__init__(hidden, len(shift))
        self.gain = gain
        self.shift: Tensor
        self.register_buffer("shift", torch.tensor(shift, dtype=torch.float32))
        nn.init.orthogonal_(self.weight, 0.01)
        nn.init.zeros_(self.bias)

    def forward(self, hidden: Tensor) -> Tensor:
        """Mean actions, shape (n, outputs)."""
        return self.shift + self.gain * super().forward(hidden)


class PosturePolicy(ActorCriticPolicy):
    """stable-baselines3's policy with a `PostureHead`.

    Args:
        head: Keyword arguments of the `PostureHead`.
        paired: Whether samples come in antithetic pairs; batches must then be of even size.
        **kwargs: Of `ActorCriticPolicy`.
    """

    def __init__(self, *args: Any, head: dict[str, Any], paired: bool = False, **kwargs: Any) -> None:
        self._head, self._paired = head, paired
        super().__init__(*args, **kwargs)

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net = PostureHead(self.mlp_extractor.latent_dim_pi, **self._head)
        if self._paired:
            self.action_dist = PairedGaussian(len(self.action_net.shift))
        new_optimizer: Any = self.optimizer_class
        self.optimizer = new_optimizer(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)


@dataclass(frozen=True)
class Exploration:
    """Standard deviation of the actions over a training run: log-linear from `first` to `last`, then held.

    Attributes:
        first, last: Standard deviations.
        until: Share of the training after which `last` is held.
    """

    first: float
    last: float
    until: float

    def scaled(self, factor: float) -> Exploration:
        """The same in other units."""
        return replace(self, first=factor * self.first, last=factor * self.last)

    def at(self, progress: float) -> float:
        """The standard deviation when `progress`, in [0, 1], of the training is done."""
        share = min(progress / self.until, 1.0)
        return math.exp((1 - share) * math.log(self.first) + share * math.log(self.last))


@dataclass(frozen=True)
class AdaptiveRate:
    """A learning rate that is adjusted after every update.

    It is divided by `factor` where the Kullback-Leibler divergence was over 1.5 times its target, multiplied where it
    was under 2/3 of it; over the last `decay` of the training it falls to zero linearly.

    Attributes:
        first: To begin with.
        target_kl: Divergence of an update that is aimed at.
        factor: Of one adjustment.
        lowest, highest: Bounds.
        decay: Share of the training at whose end the rate falls.
    """

    first: float
    target_kl: float
    factor: float = 1.3
    lowest: float = 1e-6
    highest: float = 1e-2
    decay: float = 0.0

    def after(self, rate: float, divergence: float) -> float:
        """The rate after an update with a rate and a divergence."""
        if divergence > 1.5 * self.target_kl:
            rate /= self.factor
        elif divergence < self.target_kl / 1.5:
            rate *= self.factor
        return min(max(rate, self.lowest), self.highest)

    def share(self, progress: float) -> float:
        """What the decay leaves of the rate when `progress` of the training is done."""
        return min(1.0, max(1.0 - progress, 0.0) / self.decay) if self.decay > 0 else 1.0


class AdaptivePPO(PPO):
    """stable-baselines3's PPO; the standard deviation is not learned, and the learning rate adapts.

    Args:
        exploration: Schedule of the standard deviation; None where it is learned, or for discrete actions.
        adaptive: How the learning rate adapts.
        planned_steps: Steps of the whole training, to which the schedules refer.
        **kwargs: Of PPO.

    Attributes:
        rate: The learning rate before the decay; part of the state of a training run.
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
        """Share of the training that is done."""
        return min(self.num_timesteps / self.planned_steps, 1.0)

    def train(self) -> None:
        """One update, then the rate and the standard deviation of the next."""
        super().train()
        self.rate = self.adaptive.after(self.rate, float(self.logger.name_to_value["train/approx_kl"]))
        self._explore()

    def _explore(self) -> None:
        if self.exploration is not None:
            with torch.no_grad():
                self.policy.log_std.fill_(math.log(self.exploration.at(self.progress)))


def normal_scores(rewards: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Normal scores of the ranks within each row, shape (n, k): mean 0, variance 1; equal rewards share a rank."""
    k = rewards.shape[1]
    left, right = rewards[:, :, None], rewards[:, None, :]
    doubled = 2 * (left > right).sum(axis=2) + (left == right).sum(axis=2) - 1  # twice the mean rank from 0
    scores = ndtri((np.arange(2 * k - 1) + 1) / (2 * k))
    return (scores / scores[::2].std())[doubled]


class RankedRolloutBuffer(RolloutBuffer):
    """A rollout buffer whose advantages are ranks among the `tries` that share a state.

    Args:
        tries: How many consecutive environments share their states.
        *args, **kwargs: Of `RolloutBuffer`.
    """

    def __init__(self, *args: Any, tries: int, **kwargs: Any) -> None:
        self.tries = tries
        super().__init__(*args, **kwargs)

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: np.ndarray[Any, Any]) -> None:
        """Rank the rewards; values are of no use."""
        outcomes = self.rewards.reshape(-1, self.tries)
        self.advantages = normal_scores(outcomes).astype(np.float32).reshape(self.rewards.shape)
        self.returns = np.zeros_like(self.rewards)


class RankedPPO(AdaptivePPO):
    """PPO with ranks among several tries instead of a critic.

    Args:
        tries: Actions tried from each state; the environment must be a `TriesVecEnv` of as many.
        **kwargs: Of `AdaptivePPO`.
    """

    def __init__(self, *args: Any, tries: int, **kwargs: Any) -> None:
        super().__init__(
            *args,
            rollout_buffer_class=RankedRolloutBuffer,
            rollout_buffer_kwargs={"tries": tries},
            vf_coef=0.0,
            normalize_advantage=False,
            **kwargs,
        )


_ACTIVATIONS = {nn.Tanh: "tanh", nn.SiLU: "silu", nn.ReLU: "relu"}


def network_of(model: BaseAlgorithm) -> Network:
    """The deterministic actor of a trained model; that of a DQN is its Q-network.

    Raises:
        InputError: An algorithm, or a layer, that is not known here.
    """
    policy: Any = model.policy
    output, gain, shift = "linear", None, None
    if isinstance(model, PPO):
        features, head = policy.pi_features_extractor, policy.action_net
        modules = [*policy.mlp_extractor.policy_net, head]
        if isinstance(head, PostureHead):
            gain, shift = np.full(head.out_features, head.gain), head.shift.numpy()
    elif isinstance(model, SAC):
        features, output = policy.actor.features_extractor, "tanh"
        modules = [*policy.actor.latent_pi, policy.actor.mu]
    elif isinstance(model, TD3):
        features, output = policy.actor.features_extractor, "tanh"
        modules = list(policy.actor.mu)[:-1]
    elif isinstance(model, DQN):
        features, modules = policy.q_net.features_extractor, list(policy.q_net.q_net)
    else:
        raise InputError(f"{type(model).__name__} has no exporter")
    linears = [module for module in modules if isinstance(module, nn.Linear)]
    kinds = {type(module) for module in modules if not isinstance(module, nn.Linear)}
    if len(kinds) != 1 or not kinds <= set(_ACTIVATIONS):
        raise InputError(f"one of {', '.join(k.__name__ for k in _ACTIVATIONS)} can be exported, got {kinds}")
    count, inputs = linears[-1].out_features, linears[0].in_features
    known = isinstance(features, ObservationFeatures)
    return Network(
        mean=features.mean.numpy() if known else np.zeros(inputs),
        scale=features.scale.numpy() if known else np.ones(inputs),
        waves=features.waves.numpy() if known else np.zeros(0),
        layers=[(m.weight.detach().numpy(), m.bias.detach().numpy()) for m in linears],
        activation=_ACTIVATIONS[kinds.pop()],
        output=output,
        gain=np.ones(count) if gain is None else gain,
        shift=np.zeros(count) if shift is None else shift,
    )
