"""Actors of stable-baselines3, from tensors and from a `model.zip`.

Nothing in the zip is executed. stable-baselines3 loads the weights as tensors only (`torch.load(weights_only=True)`).
The layers follow from the tensors' names and shapes, spaces and activation from the readable text in the JSON entry
`data`, whose pickled parts are never opened.

Statistics of `VecNormalize` are not in a `model.zip`. PPO and A2C leave a trace of them, and are refused; with SAC,
TD3, DDPG, DQN and TQC, normalise inside the environment.
"""

from __future__ import annotations

import json
import pickle
import re
import zipfile
from collections.abc import Mapping
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._files import open_input
from kinreach.baselines._policy_file import Network, PolicyCard
from kinreach.errors import InputError, InstallationError

Array = NDArray[Any]

#: Largest entry `data`, and largest tensor [bytes].
MAX_DATA, MAX_WEIGHTS = 16 * 1024 * 1024, 64 * 1024 * 1024
#: Largest zip, with the optimizer's state in it, packed and unpacked [bytes].
MAX_ZIP = 512 * 1024 * 1024
#: Actors: prefix of the hidden layers, name of the last layer if it has another, function behind it, default
#: activation, and the algorithms.
ACTORS = (
    ("mlp_extractor.policy_net.", "action_net", "linear", "tanh", "PPO or A2C"),
    ("actor.latent_pi.", "actor.mu", "tanh", "relu", "SAC or TQC"),
    ("actor.mu.", "", "tanh", "relu", "TD3 or DDPG"),
    ("q_net.q_net.", "", "linear", "relu", "DQN"),
)
_ALGORITHMS = "PPO, A2C, SAC, TQC, TD3, DDPG and DQN"
#: Names of torch's activation classes.
TORCH_ACTIVATIONS = {"Tanh": "tanh", "SiLU": "silu", "ReLU": "relu", "ELU": "elu", "LeakyReLU": "leaky_relu"}
#: Modules whose policies have these actors.
_POLICIES = re.compile(r"(stable_baselines3|sb3_contrib)\.(common|sac|td3|dqn|tqc)\.policies")


def actor_network(
    tensors: Mapping[str, Array], *, activation: str | None = None, bounds: tuple[Array, Array] | None = None
) -> tuple[Network, str]:
    """Return the deterministic actor in the tensors of a stable-baselines3 perceptron, and its algorithms.

    The network has no normalisation. Without `activation` it is stable-baselines3's default; `bounds` of actions have
    shape (m,), None for discrete ones.
    """
    for actor in ACTORS:
        prefix, last, *_ = actor
        found = {match[1] for name in tensors if (match := re.fullmatch(re.escape(prefix) + r"(\d+)\.weight", name))}
        names = [f"{prefix}{number}" for number in sorted(found, key=int)] + ([last] if last else [])
        if names and all(f"{name}.{part}" in tensors for name in names for part in ("weight", "bias")):
            break
    else:
        raise InputError(f"its tensors are not those of a multilayer perceptron of {_ALGORITHMS}")
    _, _, output, usual, kind = actor
    layers = [(tensors[f"{name}.weight"], tensors[f"{name}.bias"]) for name in names]
    inputs = width = layers[0][0].shape[-1] if layers[0][0].ndim == 2 else 0
    for weight, bias in layers:
        if weight.ndim != 2 or weight.shape[1] != width or bias.shape != weight.shape[:1]:
            raise InputError(f"its layers do not fit each other: {[weight.shape for weight, _ in layers]}")
        width = len(bias)
    gain, shift, low, high = np.ones(width), np.zeros(width), None, None
    if bounds is not None and not (np.all(bounds[0] == -1.0) and np.all(bounds[1] == 1.0)):
        low, high = (np.asarray(bound, dtype=np.float64) for bound in bounds)
        if not (low.shape == high.shape == (width,) and np.isfinite([low, high]).all() and (low < high).all()):
            raise InputError(f"its {width} actions need finite bounds, got {low} and {high}")
        if output == "tanh":
            gain, shift = (high - low) / 2, (high + low) / 2
    features = np.zeros(inputs), np.ones(inputs), np.zeros(0)
    return Network(*features, layers, activation or usual, output, gain, shift, low, high), kind


def read_zip(path: Path) -> tuple[PolicyCard, Network]:
    """Read the actor of a `model.zip` with `MlpPolicy`, and a card without an environment."""
    file = open_input(path, "the policy", most=MAX_ZIP)
    try:
        with file:
            data = _data(file)
            tensors = _tensors(file)
        return _policy(path, data, tensors)
    except InputError as error:
        raise InputError(f"{path} is not a model.zip that can be used: {error}") from None
    except OSError as error:
        raise InputError(f"cannot read the policy {path}: {error.strerror or error}") from None
    except (zipfile.BadZipFile, ValueError, RecursionError, NotImplementedError, RuntimeError, EOFError) as error:
        raise InputError(f"{path} is not a model.zip of stable-baselines3: {type(error).__name__}") from None


def _data(file: BufferedReader) -> dict[str, Any]:
    """Return the entry `data`, after checks of the entries' sizes."""
    with zipfile.ZipFile(file) as archive:
        entries = {entry.filename: entry for entry in archive.infolist()}
        for name in ("data", "policy.pth"):
            if name not in entries:
                raise InputError(f"it has no entry {name}")
        if sum(entry.file_size for entry in archive.infolist()) > MAX_ZIP:
            raise InputError(f"its entries are larger than {MAX_ZIP >> 20} MiB")
        if entries["data"].file_size > MAX_DATA:
            raise InputError(f"its entry data is larger than {MAX_DATA >> 20} MiB")
        for name in entries:
            if name.endswith(".pth"):
                with archive.open(name) as part, zipfile.ZipFile(part) as tensors:
                    if any(entry.compress_type != zipfile.ZIP_STORED for entry in tensors.infolist()):
                        raise InputError("its weights are compressed, which torch's are not")
        data = json.loads(archive.read("data"))
    if not isinstance(data, dict):
        raise InputError("its entry data is not a JSON object")
    return data


def _tensors(file: BufferedReader) -> dict[str, Array]:
    """Return the tensors of the policy by name, without the pickled parts of `data`."""
    try:
        import torch
        from stable_baselines3.common.save_util import load_from_zip_file
    except ImportError as error:
        raise InstallationError(f"a model.zip needs {error.name} to be read: pip install 'kinreach[train]'") from None
    try:
        _, states, _ = load_from_zip_file(file, load_data=False, device="cpu")
    except Exception as error:  # of torch, about a damaged file
        refused = isinstance(error, pickle.UnpicklingError)
        raise InputError(f"its weights {'hold more than tensors' if refused else 'are damaged'}") from None
    state: Any = states["policy"]
    if not isinstance(state, dict) or not all(isinstance(value, torch.Tensor) for value in state.values()):
        raise InputError("its weights are not a state dict")
    found = {}
    for name, value in state.items():
        dense = value.layout == torch.strided and value.dtype in (torch.float32, torch.float64)
        if not dense or value.numel() * value.element_size() > MAX_WEIGHTS or not torch.isfinite(value).all():
            raise InputError(f"{name} must be finite floating-point numbers")
        found[str(name)] = value.detach().contiguous().numpy()
    return found


def _policy(path: Path, data: dict[str, Any], tensors: dict[str, Array]) -> tuple[PolicyCard, Network]:
    activation = _options(data)
    observations, actions = _part(data, "observation_space"), _part(data, "action_space")
    if _kind(observations) != "Box" or len(shape := observations.get("_shape") or []) != 1:
        raise InputError(f"it takes observations of {_kind(observations)} {observations.get('_shape')}, not a vector")
    if _kind(actions) not in ("Box", "Discrete"):
        raise InputError(f"its actions are {_kind(actions)}; Box and Discrete can be read")
    discrete = _kind(actions) == "Discrete"
    bounds = None if discrete else (_numbers(actions, "low"), _numbers(actions, "high"))
    odd = [name for name in tensors if "features_extractor" in name]
    if odd:
        raise InputError(f"it has a features extractor of its own ({odd[0]}); only MlpPolicy's can be read")
    network, kind = actor_network(tensors, activation=activation, bounds=bounds)
    prefixes = tuple(prefix for actor in ACTORS for prefix in (actor[0], actor[1] + ".") if prefix != ".")
    # actors' standard deviations, critics, target networks
    others = (
        "log_std",
        "actor.log_std",
        "mlp_extractor.value_net.",
        "value_net.",
        "critic",
        "actor_target.",
        "q_net_target.",
    )
    if strange := [name for name in tensors if not name.startswith(prefixes + others)]:
        raise InputError(f"it has tensors that no MlpPolicy has: {strange[0]}")
    if shape != [len(network.mean)]:
        raise InputError(f"its network takes {len(network.mean)} numbers, its observations have {shape}")
    if discrete and (str(actions.get("n")) != str(len(network.gain)) or str(actions.get("start", "0")) != "0"):
        raise InputError(f"its network knows {len(network.gain)} actions, its space {actions.get('n')} from 0")
    card = PolicyCard(
        environment="",
        meaning="preferences" if discrete else "action",
        activation=network.activation,
        output=network.output,
        algorithm=kind,
        recipe={"name": path.stem},
        seed=_integer(data.get("seed")),
        steps=_integer(data.get("num_timesteps")),
    )
    return card, network


def _options(data: dict[str, Any]) -> str | None:
    """Return the user's activation or None; refuse other options that change the network's output."""
    module = _part(data, "policy_class").get("__module__")
    if not (isinstance(module, str) and _POLICIES.fullmatch(module)):
        raise InputError(f"its policy is of {module}; only MlpPolicy of {_ALGORITHMS} can be read")
    if data.get("use_sde"):
        raise InputError("it explores by generalized state-dependent exploration (use_sde), which is not read")
    if data.get("_last_original_obs") is not None and "n_steps" in data and "gae_lambda" in data:
        raise InputError("it was trained with VecNormalize, whose statistics are not in the zip")
    chosen = data.get("policy_kwargs") or {}
    known = {":type:", ":serialized:", "net_arch", "activation_fn", "log_std_init", "ortho_init", "optimizer_class",
             "optimizer_kwargs", "n_critics", "n_quantiles", "use_sde", "share_features_extractor",
             "use_expln", "full_std"}  # fmt: skip
    if not isinstance(chosen, dict) or set(chosen) - known:
        raise InputError(f"its policy_kwargs have {sorted(set(chosen) - known)}, which is not read")
    if "activation_fn" not in chosen:
        return None
    name = re.fullmatch(r"<class 'torch\.nn\.modules\.activation\.(\w+)'>", str(chosen["activation_fn"]))
    if name is None or name[1] not in TORCH_ACTIVATIONS:
        raise InputError(f"its activation is {chosen['activation_fn']}; known are {', '.join(TORCH_ACTIVATIONS)}")
    return TORCH_ACTIVATIONS[name[1]]


def _part(data: dict[str, Any], name: str) -> dict[str, Any]:
    part = data.get(name)
    if not isinstance(part, dict):
        raise InputError(f"its data does not describe its {name}")
    return part


def _kind(space: dict[str, Any]) -> str:
    return str(space.get(":type:")).rpartition(".")[2].rstrip("'>")


def _numbers(space: dict[str, Any], name: str) -> Array:
    """Return the numbers of an array's text, such as `[-1. -1.]`."""
    try:
        return np.array(str(space.get(name)).strip("[]").split(), dtype=np.float64)
    except ValueError:
        raise InputError(f"it does not say what its {name}est actions are") from None


def _integer(value: Any) -> int:
    return value if type(value) is int else 0
