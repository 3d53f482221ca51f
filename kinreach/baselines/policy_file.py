"""Trained policies on disk: numbers in the safetensors format, everything else as JSON in its header.

Neither can carry code. What is read is checked before it is used: sizes, names, shapes, finite numbers. The header's
`kinreach` entry is a JSON object with the fields of `PolicyCard`; the tensors are `mean`, `scale`, `waves`, `gain`,
`shift`, and `layer0.weight`, `layer0.bias`, `layer1.weight` ... in the order of the layers.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as to_bytes

from kinreach.baselines.network import ACTIVATIONS, OUTPUTS, Network
from kinreach.errors import InputError
from kinreach.files import replacing
from kinreach.inputs import check_path

#: Version of the format; files of other versions are refused.
FORMAT = 1
#: No policy of ours is larger; a file that is, is refused before it is read [bytes].
MOST_BYTES = 16 * 1024 * 1024
#: What a network's output means: an action of the environment, a posture, or the preference of each discrete action.
MEANINGS = ("action", "posture", "preferences")
#: Fields that a card may lack, because there are files which were written before there were such fields.
_LATER = {"goal_seeds"}


@dataclass(frozen=True)
class PolicyCard:
    """What is known of a policy beside its numbers; JSON values only.

    Attributes:
        environment: Id of the environment it acts in.
        meaning: What its output means, one of `MEANINGS`.
        activation, output: Of the network.
        algorithm: Name of what trained it.
        recipe: Name and settings of the recipe.
        seed: Of the training: networks, exploration and goals follow from it.
        steps: Environment steps it was trained for.
        results: Measured afterwards: success, distances, with the command that measures them again.
        versions: Of the packages that trained it.
        goal_seeds: `"training"`: what the goals of each segment of the training were drawn from, one seed a segment;
            `"held_out"`: seed of the first goal of `results`, goal i has that plus i; a result whose command says
            `--split validation` has others. Empty in older files.
    """

    environment: str
    meaning: str
    activation: str
    output: str
    algorithm: str
    recipe: Mapping[str, Any]
    seed: int
    steps: int
    results: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    goal_seeds: Mapping[str, Any] = field(default_factory=dict)


def save_policy(path: str | Path, card: PolicyCard, network: Network) -> None:
    """Write a policy, whole or not at all.

    Raises:
        OutputError: The file system refused.
    """
    tensors = {name: getattr(network, name) for name in ("mean", "scale", "waves", "gain", "shift")}
    for index, (weight, bias) in enumerate(network.layers):
        tensors |= {f"layer{index}.weight": weight, f"layer{index}.bias": bias}
    tensors = {name: np.ascontiguousarray(value) for name, value in tensors.items()}
    header = {"kinreach": json.dumps({"format": FORMAT, **asdict(card)}, allow_nan=False, sort_keys=True)}
    data = to_bytes(tensors, metadata=header)
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(data)


def read_policy(path: str | Path) -> tuple[PolicyCard, Network]:
    """Read a policy.

    Raises:
        InputError: There is no such file, or it is not a policy: the message says what is wrong with it.
    """
    path = check_path("policy", path)
    try:
        size = path.stat().st_size
        if not path.is_file() or size > MOST_BYTES:
            raise InputError(f"{path} is no policy: it is no file, or larger than {MOST_BYTES >> 20} MiB")
        with safe_open(path, framework="numpy") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
    except OSError as error:
        raise InputError(f"cannot read the policy {path}: {error.strerror or error}") from None
    except SafetensorError as error:
        raise InputError(f"{path} is no policy: {error}") from None
    try:
        card = _card(header)
        return card, _network(card, tensors)
    except InputError as error:
        raise InputError(f"{path} is no policy: {error}") from None


def _refuse(constant: str) -> NoReturn:
    """What Python's parser takes for a number and JSON does not: NaN and the infinities."""
    raise ValueError(constant)


def _card(header: Mapping[str, str]) -> PolicyCard:
    try:
        values = json.loads(header.get("kinreach", ""), parse_constant=_refuse)
    except (ValueError, RecursionError):
        raise InputError("its header has no JSON entry 'kinreach'") from None
    if not isinstance(values, dict) or values.pop("format", None) != FORMAT:
        raise InputError(f"its format is not {FORMAT}")
    known = {f.name for f in fields(PolicyCard)}
    if not known - _LATER <= set(values) <= known:
        raise InputError(f"its card must have the fields {sorted(known)}, got {sorted(values)}")
    kinds = {"recipe": dict, "results": dict, "versions": dict, "goal_seeds": dict, "seed": int, "steps": int}
    for name, value in values.items():
        if type(value) is not kinds.get(name, str):
            raise InputError(f"{name} must be of type {kinds.get(name, str).__name__}, got {type(value).__name__}")
    card = PolicyCard(**values)
    for name, value, choices in (
        ("meaning", card.meaning, MEANINGS),
        ("activation", card.activation, ACTIVATIONS),
        ("output", card.output, OUTPUTS),
    ):
        if value not in choices:
            raise InputError(f"its {name} must be one of {', '.join(choices)}, got {value!r}")
    return card


def _network(card: PolicyCard, tensors: Mapping[str, np.ndarray[Any, Any]]) -> Network:
    count = sum(name.endswith(".weight") for name in tensors)
    names = {f"layer{i}.{part}" for i in range(count) for part in ("weight", "bias")}
    expected = {"mean", "scale", "waves", "gain", "shift"} | names
    if count == 0 or set(tensors) != expected:
        raise InputError(f"its tensors must be {sorted(expected)}, got {sorted(tensors)}")
    for name, value in tensors.items():
        if value.dtype not in (np.float32, np.float64) or not np.isfinite(value).all():
            raise InputError(f"{name} must be finite floating-point numbers")
    doubles = {name: value.astype(np.float64) for name, value in tensors.items()}
    layers = [(doubles[f"layer{i}.weight"], doubles[f"layer{i}.bias"]) for i in range(count)]
    mean, scale, waves, gain, shift = (doubles[name] for name in ("mean", "scale", "waves", "gain", "shift"))
    width = mean.size * (1 + 2 * waves.size)
    for index, (weight, bias) in enumerate(layers):
        if weight.ndim != 2 or weight.shape[1] != width or bias.shape != weight.shape[:1]:
            raise InputError(f"layer {index} must take {width} numbers, got weight {weight.shape}, bias {bias.shape}")
        width = len(bias)
    shapes = {"mean": mean, "scale": scale, "waves": waves}, {"gain": gain, "shift": shift}
    if any(value.ndim != 1 for group in shapes for value in group.values()) or mean.shape != scale.shape:
        raise InputError("mean, scale, waves, gain and shift must have one dimension, mean and scale the same length")
    if gain.shape != (width,) or shift.shape != (width,) or not (scale > 0).all():
        raise InputError(f"gain and shift must have {width} numbers, scale must be positive")
    return Network(mean, scale, waves, layers, card.activation, card.output, gain, shift)
