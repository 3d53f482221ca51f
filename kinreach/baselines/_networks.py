"""Networks that stable-baselines3 lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from kinreach.baselines._eyes import MIDDLE, Eye
from kinreach.baselines._looks import Looks
from kinreach.baselines._policy_file import CLIP
from kinreach.baselines._steering import FEATURES, Steering, sight_fits

#: Activations of hidden layers by the name that recipes and policy files use.
ACTIVATIONS: Mapping[str, type[nn.Module]] = {
    "tanh": nn.Tanh,
    "silu": nn.SiLU,
    "relu": nn.ReLU,
    "elu": nn.ELU,
    "leaky_relu": nn.LeakyReLU,
}


#: Gain of the last layer of a policy that steers, before the training.
FIRST_GAIN = 0.3


class ObservationFeatures(BaseFeaturesExtractor):
    """Observations normalised by constants, waves of them, and differences.

    The features are z = (x - mean) / scale, and sin(w z), cos(w z) for every w, and D x clipped to plus and minus
    `CLIP`, with the `differences` D; x has as many of the first observations as there are means.
    """

    def __init__(
        self,
        space: spaces.Box,
        *,
        mean: Sequence[float],
        scale: Sequence[float],
        waves: Sequence[float] = (),
        differences: Sequence[Sequence[float]] = (),
    ) -> None:
        super().__init__(space, len(mean) * (1 + 2 * len(waves)) + len(differences))
        self.mean: Tensor
        self.scale: Tensor
        self.waves: Tensor
        self.register_buffer("mean", torch.tensor(mean, dtype=torch.float32))
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float32))
        self.register_buffer("waves", torch.tensor(waves, dtype=torch.float32))
        self.differences: Tensor | None
        given = torch.tensor(differences, dtype=torch.float32) if len(differences) else None
        self.register_buffer("differences", given)

    def forward(self, observations: Tensor) -> Tensor:
        x = observations[:, : len(self.mean)]
        z = (x - self.mean) / self.scale
        groups = [z]
        if len(self.waves):
            angles = (z[:, :, None] * self.waves).flatten(1)
            groups += [angles.sin(), angles.cos()]
        if self.differences is not None:
            groups.append((x @ self.differences.T).clamp(-CLIP, CLIP))
        return torch.cat(groups, dim=1)


class TorchEye(nn.Module):
    """A trainable `Eye` for pictures in uint8, shape (n, 3, height, width)."""

    #: Channels, sizes of the kernels and strides of the convolutions.
    CHANNELS, SIZES, STRIDES = (16, 32, 16), (5, 3, 3), (2, 2, 1)

    def __init__(self) -> None:
        super().__init__()
        kinds = zip((3, *self.CHANNELS), self.CHANNELS, self.SIZES, self.STRIDES, strict=False)
        self.layers = nn.ModuleList(nn.Conv2d(*kind, padding=kind[2] // 2) for kind in kinds)
        self.sharpness = nn.Parameter(torch.ones(()))

    def forward(self, pictures: Tensor) -> Tensor:
        h = pictures / MIDDLE - 1.0
        for index, layer in enumerate(self.layers):
            h = layer(h.relu() if index else h)
        across, down = (torch.linspace(-1, 1, size) for size in (h.shape[3], h.shape[2]))
        weights = (self.sharpness * h).flatten(2).softmax(dim=2).view_as(h)
        return torch.stack([weights.sum(dim=2) @ across, weights.sum(dim=3) @ down], dim=2).flatten(1)

    @torch.no_grad()
    def take(self, eye: Eye) -> None:
        """Take the weights of an exported eye with the same layers."""
        for layer, (weight, bias) in zip(self.layers, eye.layers, strict=True):
            parameters: dict[str, Tensor] = layer.state_dict()
            parameters["weight"].copy_(torch.as_tensor(weight))
            parameters["bias"].copy_(torch.as_tensor(bias))
        self.sharpness.fill_(eye.sharpness)

    def exported(self) -> Eye:
        state = {name: value.numpy() for name, value in self.state_dict().items()}
        layers = [(state[f"layers.{i}.weight"], state[f"layers.{i}.bias"]) for i in range(len(self.layers))]
        return Eye(layers, self.STRIDES, self.sharpness.item())


class LookFeatures(BaseFeaturesExtractor):
    """Outputs of the eyes for looks; an observation is the number of a look."""

    def __init__(self, space: spaces.Box, *, looks: Looks) -> None:
        cameras = looks.pictures.shape[1]
        super().__init__(space, cameras * 2 * TorchEye.CHANNELS[-1])
        self._looks = looks
        self.eyes: Any = nn.ModuleList(TorchEye() for _ in range(cameras))

    def forward(self, observations: Tensor) -> Tensor:
        numbers, rows = np.unique(observations[:, 0].long().numpy(), return_inverse=True)
        pictures = torch.from_numpy(self._looks.pictures[numbers]).movedim(-1, -3)
        return torch.cat([eye(pictures[:, camera]) for camera, eye in enumerate(self.eyes)], dim=1)[rows]


class PostureHead(nn.Linear):
    """The mean action from the last hidden layer h: shift + gain (W h + b), at first nearly the shift.

    Args:
        gain: Action of one radian, for each joint.
        shift: Action that means the start pose.
    """

    def __init__(self, hidden: int, *, gain: Sequence[float], shift: Sequence[float]) -> None:
        super().__init__(hidden, len(shift))
        self.gain: Tensor
        self.shift: Tensor
        self.register_buffer("gain", torch.tensor(gain, dtype=torch.float32))
        self.register_buffer("shift", torch.tensor(shift, dtype=torch.float32))
        nn.init.orthogonal_(self.weight, 0.01)
        nn.init.zeros_(self.bias)

    def forward(self, hidden: Tensor) -> Tensor:
        return self.shift + self.gain * super().forward(hidden)


class PosturePolicy(ActorCriticPolicy):
    """stable-baselines3's policy with a `PostureHead`."""

    def __init__(self, *args: Any, head: dict[str, Any], **kwargs: Any) -> None:
        self._head = head
        super().__init__(*args, **kwargs)

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net = PostureHead(self.mlp_extractor.latent_dim_pi, **self._head)
        new_optimizer: Any = self.optimizer_class
        self.optimizer = new_optimizer(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)


class SteeringFeatures(BaseFeaturesExtractor):
    """Features of a policy that steers an arm to a rolling ball."""

    def __init__(
        self, space: spaces.Box, *, sights: int, delay: float, low: Sequence[float], high: Sequence[float]
    ) -> None:
        super().__init__(space, FEATURES)
        self.fits: Tensor
        self.register_buffer("fits", torch.as_tensor(sight_fits(sights, delay), dtype=torch.float32))
        self._bounds = np.array(low), np.array(high)

    @property
    def steering(self) -> Steering:
        return Steering(self.fits, *self._bounds)

    def forward(self, observations: Tensor) -> Tensor:
        features: Tensor = self.steering.features(observations)
        return features

    def exported(self) -> Steering:
        return Steering(self.fits.numpy().astype(np.float64), *self._bounds)


class SteeringPolicy(ActorCriticPolicy):
    """stable-baselines3's policy whose outputs are shares of the motion that joints can make in a frame.

    The standard deviation is one of shares, too.
    """

    features_extractor: SteeringFeatures

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        last: Any = self.action_net
        nn.init.orthogonal_(last.weight, FIRST_GAIN)

    def forward(self, obs: Any, deterministic: bool = False) -> tuple[Tensor, Tensor, Tensor]:
        distribution: Any = self.get_distribution(obs)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, self.predict_values(obs), distribution.log_prob(actions)

    def evaluate_actions(self, obs: Any, actions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        distribution: Any = self.get_distribution(obs)
        return self.predict_values(obs), distribution.log_prob(actions), distribution.entropy()

    def get_distribution(self, obs: Any) -> Any:
        spread: Tensor = self.features_extractor.steering.spread(obs.float())
        return self.action_dist.proba_distribution(self.means(obs), self.log_std + spread.log())

    def means(self, obs: Any) -> Tensor:
        """Return the actions without noise."""
        given = obs.float()
        hidden = self.mlp_extractor.forward_actor(self.features_extractor(given))
        means: Tensor = self.features_extractor.steering.actions(given, torch.tanh(self.action_net(hidden)))
        return means
