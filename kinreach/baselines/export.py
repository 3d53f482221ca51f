"""From a model of stable-baselines3 to a network in numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
from stable_baselines3 import DQN, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from torch import nn

from kinreach.baselines.network import Network
from kinreach.baselines.sb3_networks import ObservationFeatures, PostureHead
from kinreach.errors import InputError

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
