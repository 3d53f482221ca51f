"""Networks in numpy, and policy files.

A policy file is a safetensors file without code. Its header's `kinreach` entry is a JSON object with the fields
of `PolicyCard`; its tensors are `mean`, `scale`, `waves`, `gain`, `shift`, then `layer0.weight`, `layer0.bias`,
`layer1.weight` ..., `low` and `high` if actions are not in [-1, 1], and for each camera of a policy that sees
`eye0.layer0.weight`, `eye0.layer0.bias` ..., `eye0.strides` and `eye0.sharpness`. One that steers to a rolling ball
has `steering.fits`, `steering.low` and `steering.high`, one with features that are differences has `differences`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as to_bytes

from kinreach._checks import STEP_LIMIT, check_path
from kinreach._files import open_input, replacing
from kinreach.baselines._eyes import Eye, picture_names
from kinreach.baselines._steering import FEATURES, PLACES, WINDOWS, Steering
from kinreach.envs.inside import moving
from kinreach.errors import InputError

Array = NDArray[Any]

#: The policy in the folder of a run.
POLICY_FILE = "policy.safetensors"
#: Tensors that not all policies have.
OPTIONAL = {"low", "high", "differences"}
#: Tensors of a policy that steers.
STEERING = ("fits", "low", "high")
#: Features that are differences are clipped to plus and minus this.
CLIP = 3.0
#: Names that options of environments had in the cards of version 0.3.
RENAMED: Mapping[str, str] = {"max_steps": STEP_LIMIT}


def _silu(x: Array) -> Array:
    with np.errstate(over="ignore"):
        return x / (1.0 + np.exp(-x))


#: Functions behind hidden layers, and behind the last one.
ACTIVATIONS: Mapping[str, Callable[[Array], Array]] = {
    "tanh": np.tanh,
    "silu": _silu,
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
    "leaky_relu": lambda x: np.where(x > 0.0, x, 0.01 * x),
}
OUTPUTS: Mapping[str, Callable[[Array], Array]] = {"linear": lambda x: x, "tanh": np.tanh}


@dataclass(frozen=True, eq=False)
class Network:
    """y = shift + gain out(W_k ... act(W_1 f + b_1) ... + b_k) of features f of an observation x.

    With eyes, x has their outputs for the cameras' pictures, one after the other. With z = (x - mean) / scale
    over the first observations, the features are z, then sin(w z) and cos(w z), in both the waves of one observation
    side by side, then D x clipped to plus and minus `CLIP`. With a steering, x has its features of an observation, and
    y its actions from these outputs.

    Attributes:
        mean, scale: Constants of the normalisation, shape (n,); only the first n observations are used.
        waves: Angular frequencies w, shape (k,).
        layers: Weights, shape (out, in), and biases, shape (out,), of one layer after the other.
        activation: Of the hidden layers, a key of `ACTIVATIONS`.
        output: Behind the last layer, a key of `OUTPUTS`.
        gain, shift: Shape (m,).
        low, high: Bounds of an action, shape (m,); None for -1 and 1.
        eyes: One for each camera, by name; none where observations are vectors.
        steering: Of a policy for a rolling ball whose outputs are shares of the possible motion; else None.
        differences: D, such as places relative to others, shape (d, n).
    """

    mean: Array
    scale: Array
    waves: Array
    layers: Sequence[tuple[Array, Array]]
    activation: str
    output: str
    gain: Array
    shift: Array
    low: Array | None = None
    high: Array | None = None
    eyes: Sequence[Eye] = ()
    steering: Steering | None = None
    differences: Array | None = None

    @property
    def inputs(self) -> int:
        """Numbers of an observation, or of what the eyes see."""
        return len(self.mean) if self.steering is None else self.steering.inputs

    def __call__(self, x: Any) -> Array:
        """Return outputs, shape (..., m), for observations, shape (..., n or more), or dictionaries with pictures."""
        if self.eyes:
            x = np.concatenate([eye(x[key]) for eye, key in zip(self.eyes, picture_names(x), strict=True)], axis=-1)
        if self.steering is None:
            return self._outputs(x)
        rows = x.reshape(-1, x.shape[-1])
        actions = self.steering.actions(rows, self._outputs(self.steering.features(rows)))
        return np.asarray(actions.reshape(*x.shape[:-1], -1))

    def _outputs(self, x: Array) -> Array:
        x = x[..., : len(self.mean)]
        h = (x - self.mean) / self.scale
        if len(self.waves):
            angles = (h[..., :, None] * self.waves).reshape(*h.shape[:-1], -1)
            h = np.concatenate([h, np.sin(angles), np.cos(angles)], axis=-1)
        if self.differences is not None:
            h = np.concatenate([h, np.clip(x @ self.differences.T, -CLIP, CLIP)], axis=-1)
        activation = ACTIVATIONS[self.activation]
        for weight, bias in self.layers[:-1]:
            h = activation(h @ weight.T + bias)
        weight, bias = self.layers[-1]
        return self.shift + self.gain * OUTPUTS[self.output](h @ weight.T + bias)


#: Version of the format; files of other versions are refused.
FORMAT = 1
#: Largest file [bytes].
MAX_BYTES = 16 * 1024 * 1024


@dataclass(frozen=True)
class PolicyCard:
    """Facts about a policy, as JSON values.

    Attributes:
        environment: Id of the environment it acts in.
        meaning: What its output is: an `action` of the environment, a `posture`, or `preferences` for discrete actions.
        activation, output: Of the network.
        algorithm: That trained it.
        recipe: Name and settings of the recipe.
        seed: Of the training.
        steps: Environment steps of the training.
        results: Evaluations, by the command that repeats them.
        versions: Of the packages that trained it.
        goal_seeds: `"training"`: seed of the goals of each segment of the training; `"held_out"`: seed of the first
            goal of `results`, goal i has that plus i. Empty in older files.
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


def run_name(path: Path) -> str:
    """Return "RECIPE/seed-S" of the policy of a run, "RECIPE/seed-S/policy.safetensors"; empty of other files."""
    return "/".join(path.parts[-3:-1]) if path.name == POLICY_FILE else ""


def save_policy(path: str | Path, card: PolicyCard, network: Network) -> None:
    """Write a policy, whole or not at all."""
    tensors = {name: getattr(network, name) for name in ("mean", "scale", "waves", "gain", "shift")}
    if network.low is not None and network.high is not None:
        tensors |= {"low": network.low, "high": network.high}
    if network.differences is not None:
        tensors["differences"] = network.differences
    for index, (weight, bias) in enumerate(network.layers):
        tensors |= {f"layer{index}.weight": weight, f"layer{index}.bias": bias}
    for number, eye in enumerate(network.eyes):
        tensors |= {f"eye{number}.strides": np.array(eye.strides, float), f"eye{number}.sharpness": eye.sharpness}
        for index, (weight, bias) in enumerate(eye.layers):
            tensors |= {f"eye{number}.layer{index}.weight": weight, f"eye{number}.layer{index}.bias": bias}
    if network.steering is not None:
        tensors |= {f"steering.{name}": getattr(network.steering, name) for name in STEERING}
    tensors = {name: np.ascontiguousarray(value) for name, value in tensors.items()}
    header = {"kinreach": json.dumps({"format": FORMAT, **asdict(card)}, allow_nan=False, sort_keys=True)}
    data = to_bytes(tensors, metadata=header)
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(data)


def read_policy(path: str | Path) -> tuple[PolicyCard, Network]:
    path = check_path("policy", path)
    try:
        open_input(path, "the policy", most=MAX_BYTES).close()
        with safe_open(path, framework="numpy") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
    except OSError as error:
        raise InputError(f"cannot read the policy {path}: {error.strerror or error}") from None
    except SafetensorError as error:
        raise InputError(f"{path} is not a policy: {error}") from None
    try:
        card = _card(header)
        return card, _network(card, tensors)
    except InputError as error:
        raise InputError(f"{path} is not a policy: {error}") from None


def _refuse(constant: str) -> NoReturn:
    """Refuse NaN and the infinities, which are not JSON."""
    raise ValueError(constant)


def _card(header: Mapping[str, str]) -> PolicyCard:
    try:
        values = json.loads(header.get("kinreach", ""), parse_constant=_refuse)
    except (ValueError, RecursionError):
        raise InputError("its header has no JSON entry 'kinreach'") from None
    if not isinstance(values, dict) or values.pop("format", None) != FORMAT:
        raise InputError(f"its format is not {FORMAT}")
    known = {f.name for f in fields(PolicyCard)}
    if not known - {"goal_seeds"} <= set(values) <= known:  # older cards lack it
        raise InputError(f"its card must have the fields {sorted(known)}, got {sorted(values)}")
    kinds = {"recipe": dict, "results": dict, "versions": dict, "goal_seeds": dict, "seed": int, "steps": int}
    for name, value in values.items():
        if type(value) is not kinds.get(name, str):
            raise InputError(f"{name} must be of type {kinds.get(name, str).__name__}, got {type(value).__name__}")
    options = values["recipe"].get("options")
    if isinstance(options, dict):
        values["recipe"]["options"] = {RENAMED.get(name, name): value for name, value in options.items()}
    card = PolicyCard(**values)
    for name, value, choices in (
        ("meaning", card.meaning, ("action", "posture", "preferences")),
        ("activation", card.activation, ACTIVATIONS),
        ("output", card.output, OUTPUTS),
    ):
        if value not in choices:
            raise InputError(f"its {name} must be one of {', '.join(choices)}, got {value!r}")
    return card


def _network(card: PolicyCard, tensors: Mapping[str, np.ndarray[Any, Any]]) -> Network:
    for name, value in tensors.items():
        if value.dtype not in (np.float32, np.float64) or not np.isfinite(value).all():
            raise InputError(f"{name} must be finite floating-point numbers")
    eyes = [_eye(tensors, f"eye{number}.") for number in range(sum(name.endswith(".strides") for name in tensors))]
    steering = _steering({name: value for name, value in tensors.items() if name.startswith("steering.")})
    tensors = {name: value for name, value in tensors.items() if not name.startswith(("eye", "steering."))}
    count = sum(name.endswith(".weight") for name in tensors)
    names = {f"layer{i}.{part}" for i in range(count) for part in ("weight", "bias")}
    expected = {"mean", "scale", "waves", "gain", "shift"} | names | (OPTIONAL & set(tensors))
    if count == 0 or set(tensors) != expected:
        raise InputError(f"its tensors must be {sorted(expected)}, got {sorted(tensors)}")
    doubles = {name: value.astype(np.float64) for name, value in tensors.items()}
    layers = [(doubles[f"layer{i}.weight"], doubles[f"layer{i}.bias"]) for i in range(count)]
    mean, scale, waves, gain, shift = (doubles[name] for name in ("mean", "scale", "waves", "gain", "shift"))
    low, high, differences = (doubles.get(name) for name in ("low", "high", "differences"))
    if eyes and mean.size != sum(eye.places for eye in eyes):
        raise InputError(f"mean must have a number for each output of the eyes, got {mean.size}")
    if steering is not None and (mean.size, gain.size, low is None) != (FEATURES, moving.JOINTS, True):
        raise InputError(f"a steering has {FEATURES} features and {moving.JOINTS} outputs, and bounds of its own")
    width = mean.size * (1 + 2 * waves.size)
    if differences is not None:
        if differences.ndim != 2 or differences.shape[1] != mean.size or steering is not None:
            raise InputError(f"differences must have {mean.size} columns, and no steering beside it")
        width += len(differences)
    for index, (weight, bias) in enumerate(layers):
        if weight.ndim != 2 or weight.shape[1] != width or bias.shape != weight.shape[:1]:
            raise InputError(f"layer {index} must take {width} numbers, got weight {weight.shape}, bias {bias.shape}")
        width = len(bias)
    if any(value.ndim != 1 for value in (mean, scale, waves, gain, shift)) or mean.shape != scale.shape:
        raise InputError("mean, scale, waves, gain and shift must have one dimension, mean and scale the same length")
    if gain.shape != (width,) or shift.shape != (width,) or not (scale > 0).all():
        raise InputError(f"gain and shift must have {width} numbers, scale must be positive")
    if (low is None) != (high is None):
        raise InputError("low and high must both be there, or neither")
    if low is not None and high is not None and not (low.shape == high.shape == (width,) and (low < high).all()):
        raise InputError(f"low and high must have {width} numbers, low below high")
    constants = mean, scale, waves, layers, card.activation, card.output, gain, shift, low, high
    return Network(*constants, eyes, steering, differences)


def _steering(tensors: Mapping[str, np.ndarray[Any, Any]]) -> Steering | None:
    if not tensors:
        return None
    if set(tensors) != {f"steering.{name}" for name in STEERING}:
        raise InputError(f"the tensors of steering.* must be {', '.join(STEERING)}, got {sorted(tensors)}")
    fits, low, high = (tensors[f"steering.{name}"].astype(np.float64) for name in STEERING)
    sights = len(fits) if fits.ndim else 0
    if fits.shape != (sights, 2 * len(WINDOWS), sights - 1) or sights < PLACES:
        raise InputError(f"steering.fits must be of {PLACES} sights or more, got shape {fits.shape}")
    if not low.shape == high.shape == (moving.JOINTS,) or not (low < high).all():
        raise InputError(f"steering.low and steering.high must have {moving.JOINTS} numbers, low below high")
    return Steering(fits, low, high)


def _eye(tensors: Mapping[str, np.ndarray[Any, Any]], prefix: str) -> Eye:
    own = {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
    count = sum(name.endswith(".weight") for name in own)
    expected = {f"layer{i}.{part}" for i in range(count) for part in ("weight", "bias")} | {"strides", "sharpness"}
    if count == 0 or set(own) != expected:
        raise InputError(f"the tensors of {prefix}* must be {sorted(expected)}, got {sorted(own)}")
    layers = [(own[f"layer{i}.weight"].astype(float), own[f"layer{i}.bias"].astype(float)) for i in range(count)]
    channels = 3
    for index, (weight, bias) in enumerate(layers):
        shape = (len(bias) if bias.ndim else 0, channels, *weight.shape[-1:] * 2)
        if weight.ndim != 4 or weight.shape != shape or not weight.shape[-1] % 2 or bias.shape != shape[:1]:
            raise InputError(f"{prefix}layer{index} must take {channels} channels, got weight {weight.shape}")
        channels = len(bias)
    strides, sharpness = own["strides"], own["sharpness"]
    if strides.shape != (count,) or not np.isin(strides, range(1, 9)).all() or sharpness.size != 1:
        raise InputError(f"{prefix}strides must be {count} whole numbers from 1 to 8, {prefix}sharpness one number")
    return Eye(layers, [int(stride) for stride in strides], float(sharpness.reshape(())))
