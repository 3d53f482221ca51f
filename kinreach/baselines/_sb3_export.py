"""Actors of stable-baselines3's models as networks in numpy, and as policy files.

Loading a `model.zip` with stable-baselines3 can run code, so that kinreach reads none: `export_policy` writes a policy
file of a model that you have in memory.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.torch_layers import FlattenExtractor

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
#: Actors: prefix of the hidden layers, name of the last layer if it has another, and function behind it.
ACTORS = (
    ("mlp_extractor.policy_net.", "action_net", "linear"),  # PPO and A2C
    ("actor.latent_pi.", "actor.mu", "tanh"),  # SAC and TQC
    ("actor.mu.", "", "tanh"),  # TD3 and DDPG
    ("q_net.q_net.", "", "linear"),  # DQN
)


def export_policy(
    model: BaseAlgorithm, path: str | Path, *, environment: str, options: Mapping[str, Any] | None = None
) -> LearnedPolicy:
    """Write the actor of a stable-baselines3 model as a policy file, which carries no code.

    Every command takes the file as it takes one of `kinreach train`. The policy must be an `MlpPolicy` of PPO, A2C,
    SAC, TQC, TD3, DDPG or DQN.

    Args:
        model: Trained, or loaded by stable-baselines3, which runs code of a file that has some.
        path: Of the file, such as `policy.safetensors`; its folder is created, and it is replaced in one step.
        environment: Id of the environment that it acts in, such as `kinreach/Reach-v0`.
        options: Of that environment, as JSON values, as it was trained with them.

    Returns:
        The policy that was written.

    Raises:
        InputError: The actor is no multilayer perceptron of these, its activation is none of `Networks`, or its
            observations are normalised by `VecNormalize`, whose statistics are not in the model.
        OutputError: The file cannot be written.
    """
    given: Any = model
    if not isinstance(given, BaseAlgorithm):
        raise InputError(f"a model must be stable-baselines3's, got {shown(given)}")
    named: Any = environment
    if not isinstance(named, str) or not named:
        raise InputError(f"environment must be the id of one, such as kinreach/Reach-v0, got {shown(environment)}")
    path = check_path("path", path)
    if model.get_vec_normalize_env() is not None or getattr(model, "_last_original_obs", None) is not None:
        raise InputError("it was trained with VecNormalize, whose statistics are not in the model")
    check_trainable(model.observation_space, model.action_space)
    network = actor_network(model)
    check_export(model, network, type(model).__name__)
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
    owner = next(getattr(policy, name) for name in ("actor", "q_net", "action_net") if hasattr(policy, name))
    features = (
        policy.pi_features_extractor if owner is getattr(policy, "action_net", None) else owner.features_extractor
    )
    if isinstance(features, ObservationFeatures):
        constants = {name: getattr(features, name).numpy() for name in ("mean", "scale", "waves")}
        network = replace(network, **constants)
    elif isinstance(features, LookFeatures):
        network = replace(network, eyes=[eye.exported() for eye in features.eyes])
    elif isinstance(features, SteeringFeatures):
        network = replace(network, output="tanh", steering=features.exported())
    elif type(features) is not FlattenExtractor:
        raise InputError(f"the features extractor {type(features).__name__} cannot be exported")
    if isinstance(owner, PostureHead):
        network = replace(network, gain=owner.gain.numpy(), shift=owner.shift.numpy())
    return network


def _perceptron(tensors: Mapping[str, Array], activation: str, bounds: tuple[Array, Array] | None) -> Network:
    """Return the actor in the tensors of a policy, without normalisation; bounds have shape (m,), None if discrete."""
    for actor in ACTORS:
        prefix, last, _ = actor
        found = {match[1] for name in tensors if (match := re.fullmatch(re.escape(prefix) + r"(\d+)\.weight", name))}
        names = [f"{prefix}{number}" for number in sorted(found, key=int)] + ([last] if last else [])
        if names and all(f"{name}.{part}" in tensors for name in names for part in ("weight", "bias")):
            break
    else:
        raise InputError("its actor is not a multilayer perceptron of PPO, A2C, SAC, TQC, TD3, DDPG or DQN")
    output = actor[2]
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
