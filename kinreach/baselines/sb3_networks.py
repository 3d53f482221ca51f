"""Networks for stable-baselines3 that know what a posture is: an actor that proposes one near the start pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import DiagGaussianDistribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn


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
