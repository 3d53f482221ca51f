"""Actors of stable-baselines3's models as networks in numpy, and as policy files.

Loading a `model.zip` with stable-baselines3 can run code, so that kinreach reads none: `export_policy` writes a policy
file of a model that you have in memory.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.vec_env import VecNormalize

from kinreach._checks import check_path, shown
from kinreach._files import make_writable
from kinreach.baselines._networks import ACTIVATIONS, LookFeatures, ObservationFeatures, PostureHead, SteeringFeatures
from kinreach.baselines._policies import LearnedPolicy
from kinreach.baselines._policy_file import Network, PolicyCard, save_policy
from kinreach.errors import InputError

Array = NDArray[Any]

#: How far an exported actor may be from the model's own, which computes in single precision.
EXPORT_TOLERANCE = 1e-3
_SAMPLES = 64
#: What `ObservationFeatures` and networks have around the layers.
FEATURE_CONSTANTS = ("mean", "scale", "waves", "differences")
#: Actors: prefix of the hidden layers, name of the last layer if it has another, and function behind it.
ACTORS = (
    ("mlp_extractor.policy_net.", "action_net", "linear"),  # PPO and A2C
    ("actor.latent_pi.", "actor.mu", "tanh"),  # SAC and TQC
    ("actor.mu.", "", "tanh"),  # TD3 and DDPG
    ("q_net.q_net.", "", "linear"),  # DQN
)


def export_policy(
    model: BaseAlgorithm,
    path: str | Path,
    *,
    environment: str,
    options: Mapping[str, Any] | None = None,
    normalize: VecNormalize | Literal[False] | None = None,
) -> LearnedPolicy:
    """Write the actor of a stable-baselines3 model as a policy file, which carries no code.

    Every command takes the file as it takes one of `kinreach train`. The policy must be an `MlpPolicy` of PPO, A2C,
    SAC, TQC, TD3, DDPG or DQN.

    Args:
        model: Trained, or loaded by stable-baselines3, which runs code of a file that has some.
        path: Of the file, such as `policy.safetensors`; its folder is created, and it is replaced in one step.
        environment: Id of the environment that it acts in, such as `kinreach/Reach-v0`.
        options: Of that environment, as JSON values, as it was trained with them.
        normalize: The `VecNormalize` that it was trained with, such as `VecNormalize.load("vecnormalize.pkl", venv)`;
            that of the model's environment if None; False: it was trained without. Its mean and variance become part
            of the network; what it would clip, 10 standard deviations away, is not clipped.

    Returns:
        The policy that was written.

    Raises:
        InputError: The actor is no multilayer perceptron of these, its activation is none of `Networks`, or it was
            trained with a `VecNormalize` that is not there, or is of other observations.
        OutputError: The file cannot be written.
    """
    given: Any = model
    if not isinstance(given, BaseAlgorithm):
        raise InputError(f"a model must be stable-baselines3's, got {shown(given)}")
    named: Any = environment
    if not isinstance(named, str) or not named:
        raise InputError(f"environment must be the id of one, such as kinreach/Reach-v0, got {shown(environment)}")
    path = check_path("path", path)
    if normalize is None:
        normalize = model.get_vec_normalize_env()
    off_policy = isinstance(model, OffPolicyAlgorithm)  # these note original observations in either case
    told = off_policy and model.get_env() is not None
    if normalize is None and not told and getattr(model, "_last_original_obs", None) is not None:
        raise InputError(
            f"it {'may have been' if off_policy else 'was'} trained with VecNormalize, whose statistics are in a file "
            "of their own: export_policy(..., normalize=VecNormalize.load('vecnormalize.pkl', venv))"
            + ("; normalize=False says that it was not" if off_policy else "")
        )
    check_trainable(model.observation_space, model.action_space)
    network = actor_network(model)
    check_export(model, network, type(model).__name__)
    network = network if normalize is None or normalize is False else _normalised(network, normalize)
    card = PolicyCard(
        environment=environment,
        meaning="preferences" if isinstance(model.action_space, spaces.Discrete) else "action",
        activation=network.activation,
        output=network.output,
        algorithm=type(model).__name__,
        recipe={"name": path.stem, "options": dict(options or {})},
        seed=model.seed or 0,
        steps=model.num_timesteps,
    )
    make_writable(path.parent)
    save_policy(path, card, network)
    return LearnedPolicy(card, network)


def _normalised(network: Network, normalize: VecNormalize) -> Network:
    """Return a network that normalises observations as `VecNormalize` does, without clipping."""
    given: Any = normalize
    if not isinstance(given, VecNormalize):
        raise InputError(f"normalize must be a VecNormalize of stable-baselines3, got {shown(given)}")
    if not normalize.norm_obs:
        return network
    if network.differences is not None:
        raise InputError("a network with differences takes observations as they are, not with VecNormalize")
    statistics: Any = normalize.obs_rms
    count = len(network.mean)
    if isinstance(statistics, dict) or statistics.mean.shape != (count,):
        raise InputError(f"normalize must be of observations with {count} numbers, as the model")
    spread = np.sqrt(statistics.var + normalize.epsilon)
    return replace(network, mean=statistics.mean + spread * network.mean, scale=spread * network.scale)


def averaged_actor(model: BaseAlgorithm) -> Network:
    """Return the actor with the weights that an algorithm has averaged over its updates."""
    return actor_network(model, model.average)  # type: ignore[attr-defined]


def actor_network(model: BaseAlgorithm, policy: Any = None) -> Network:
    """Return the deterministic actor of a stable-baselines3 model with `MlpPolicy`, of DQN its Q-network."""
    policy = model.policy if policy is None else policy
    names = {kind: name for name, kind in ACTIVATIONS.items()}
    if getattr(policy, "activation_fn", None) not in names:
        known = ", ".join(kind.__name__ for kind in names)
        its = getattr(getattr(policy, "activation_fn", None), "__name__", "its activation")
        raise InputError(f"{its} cannot be exported; known activations are {known}")
    space = model.action_space
    network = _perceptron(
        {name: value.detach().cpu().numpy() for name, value in policy.state_dict().items()},
        names[policy.activation_fn],
        (space.low, space.high) if isinstance(space, spaces.Box) else None,
    )
    features = _features_extractor(policy)
    if isinstance(features, ObservationFeatures):
        constants = {name: getattr(features, name) for name in FEATURE_CONSTANTS}
        found = {name: constant.numpy() for name, constant in constants.items() if constant is not None}
        network = replace(network, **found)
    elif isinstance(features, LookFeatures):
        network = replace(network, eyes=[eye.exported() for eye in features.eyes])
    elif isinstance(features, SteeringFeatures):
        network = replace(network, output="tanh", steering=features.exported())
    elif type(features) is not FlattenExtractor:
        raise InputError(f"the features extractor {type(features).__name__} cannot be exported")
    head = getattr(policy, "action_net", None)
    if isinstance(head, PostureHead):
        network = replace(network, gain=head.gain.numpy(), shift=head.shift.numpy())
    return network


def _perceptron(tensors: Mapping[str, Array], activation: str, bounds: tuple[Array, Array] | None) -> Network:
    """Return the actor in the tensors of a policy, without normalisation; bounds have shape (m,), None if discrete."""
    names, output = _actor_layers(tensors)
    layers = [(tensors[f"{name}.weight"], tensors[f"{name}.bias"]) for name in names]
    width = len(layers[-1][1])
    gain, shift, low, high = np.ones(width), np.zeros(width), None, None
    if bounds is not None and not (np.all(bounds[0] == -1.0) and np.all(bounds[1] == 1.0)):
        low, high = (np.asarray(bound, dtype=np.float64) for bound in bounds)
        if not np.isfinite([low, high]).all():
            raise InputError(f"its {width} actions need finite bounds, got {low} and {high}")
        if output == "tanh":
            gain, shift = (high - low) / 2, (high + low) / 2
    inputs = layers[0][0].shape[1]
    constants = np.zeros(inputs), np.ones(inputs), np.zeros(0)
    return Network(*constants, layers, activation, output, gain, shift, low, high)


def _actor_layers(tensors: Mapping[str, Any]) -> tuple[list[str], str]:
    """Return the names of the actor's layers among the tensors of a policy, and the function behind the last one."""
    for prefix, last, output in ACTORS:
        found = {match[1] for name in tensors if (match := re.fullmatch(re.escape(prefix) + r"(\d+)\.weight", name))}
        names = [f"{prefix}{number}" for number in sorted(found, key=int)] + ([last] if last else [])
        if names and all(f"{name}.{part}" in tensors for name in names for part in ("weight", "bias")):
            return names, output
    raise InputError("its actor is not a multilayer perceptron of PPO, A2C, SAC, TQC, TD3, DDPG or DQN")


@torch.no_grad()
def set_actor(model: BaseAlgorithm, policy: Any, network: Network) -> None:
    """Give an actor, and its copy that targets are taken from, the weights of a network; the critic stays as it is.

    Args:
        model: As stable-baselines3 makes it, for its spaces.
        policy: The model's, or one of the same kind.
        network: The weights, with the constants around them.

    Raises:
        InputError: The actor has other layers, another activation, or constants around them that cannot be set.
    """
    now = actor_network(model, policy)
    if _sizes(now) != _sizes(network):
        raise InputError(f"its network is {_sizes(network)}, that of the recipe is {_sizes(now)}")
    features: Any = _features_extractor(policy)
    constants = {name: each for name in FEATURE_CONSTANTS if (each := getattr(features, name, None)) is not None}
    head = getattr(policy, "action_net", None)
    if isinstance(head, PostureHead):
        constants |= {"gain": head.gain, "shift": head.shift}
    for name, constant in constants.items():
        constant.copy_(torch.as_tensor(getattr(network, name)))
    for mine, its in zip(features.eyes if network.eyes else (), network.eyes, strict=True):
        mine.take(its)
    tensors = policy.state_dict()
    for name, (weight, bias) in zip(_actor_layers(tensors)[0], network.layers, strict=True):
        for part, value in ((f"{name}.weight", weight), (f"{name}.bias", bias)):
            copies = {re.sub(r"^(actor|q_net)\.", r"\1_target.", part), part} & set(tensors)
            for copy in copies:
                tensors[copy].copy_(torch.as_tensor(value))
    now = actor_network(model, policy)
    for name in (*FEATURE_CONSTANTS, "gain", "shift", "low", "high"):
        mine, its = getattr(now, name), getattr(network, name)
        if (mine is None) != (its is None) or (mine is not None and not np.allclose(mine, its, rtol=1e-5, atol=1e-6)):
            raise InputError(f"{name} around the layers of its network is not that of the recipe, and is fixed there")


def _features_extractor(policy: Any) -> Any:
    owner = next(getattr(policy, name) for name in ("actor", "q_net", "action_net") if hasattr(policy, name))
    return policy.pi_features_extractor if owner is getattr(policy, "action_net", None) else owner.features_extractor


def _sizes(network: Network) -> str:
    """Return the numbers of inputs and outputs of a network's layers, such as "13-64-64-6, tanh"; eyes first."""
    waves = f" with {len(network.waves)} waves" if len(network.waves) else ""
    others = "" if network.differences is None else f" and {len(network.differences)} differences"
    widths = [f"{len(network.mean)}{waves}{others}", *(len(bias) for _, bias in network.layers)]
    eyes = "".join(f"{'-'.join(str(len(bias)) for _, bias in eye.layers)} channels, " for eye in network.eyes)
    steers = ", of one that steers" if network.steering is not None else ""
    return f"{eyes}{'-'.join(map(str, widths))}, {network.activation}, {network.output}{steers}"


def check_trainable(observations: spaces.Space[Any], actions: spaces.Space[Any]) -> None:
    """Refuse observations that are not vectors of numbers, and actions neither `Box` nor `Discrete` from 0."""
    if not isinstance(observations, spaces.Box) or len(observations.shape) != 1:
        raise InputError(f"training needs observations that are vectors of numbers, got {observations}")
    vector = isinstance(actions, spaces.Box) and len(actions.shape) == 1
    if not vector and not (isinstance(actions, spaces.Discrete) and actions.start == 0):
        raise InputError(f"training needs actions that are vectors or numbered from 0, got {actions}")


def check_export(
    model: BaseAlgorithm, network: Network, name: str, *, seen: Callable[[Array], Any] = lambda given: given
) -> None:
    """Refuse an exported actor that does not act as its model does; `seen` gives the environment's own observations."""
    space: Any = model.observation_space
    draws = np.random.default_rng(0).normal(size=(_SAMPLES, *space.shape))
    observations = np.clip(draws, space.low, space.high).astype(space.dtype)
    expected = model.predict(observations, deterministic=True)[0]
    found = network(seen(observations))
    if isinstance(model.action_space, spaces.Discrete):
        best = found[np.arange(_SAMPLES), expected]
        error = float((found.max(axis=1) - best).max())
    else:
        low, high = (-1.0, 1.0) if network.low is None else (network.low, network.high)
        error = float(np.abs(np.clip(found, low, high) - expected).max())
    if not error <= EXPORT_TOLERANCE:
        raise InputError(
            f"the exporter of {name} gives a network that does not answer as the model does: it is off by {error:.2g}"
        )
