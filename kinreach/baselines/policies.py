"""Policies: networks that run in numpy, the files that they come in, and how they are loaded.

A policy file is a safetensors file, and carries no code. Its header's `kinreach` entry is a JSON object with the fields
of `PolicyCard`; its tensors are `mean`, `scale`, `waves`, `gain`, `shift`, then `layer0.weight`, `layer0.bias`,
`layer1.weight` ... in the order of the layers, `low` and `high` where actions are not in [-1, 1], and where pictures
are seen, for each camera, `eye0.layer0.weight`, `eye0.layer0.bias` ..., `eye0.strides` and `eye0.sharpness`. What is
read is checked before it is used: sizes, names, shapes, finite numbers. A stable-baselines3 `model.zip` is read by
`kinreach.baselines.sb3_zip`, without running what is in it either.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as to_bytes

from kinreach.baselines.eyes import Eye
from kinreach.checks import as_floats, check_entries, check_path, shown
from kinreach.envs.reach.task import SINGLE_STEP, STEP_SIZE, action_range
from kinreach.errors import InputError, UnknownNameError
from kinreach.files import open_input, replacing
from kinreach.registration import BUTTON, MOVING, MULTI, MULTI_KINEMATIC, SINGLE, SPACE
from kinreach.robots import get_arm

Array = NDArray[Any]


def _silu(x: Array) -> Array:
    with np.errstate(over="ignore"):
        return x / (1.0 + np.exp(-x))


#: What stands behind every hidden layer, and behind the last.
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

    Where there are eyes, x is what they say of the cameras' pictures, one after the other. With z = (x - mean) / scale
    over the first observations, the features are z, then sin(w z) and cos(w z), in both the waves of one observation
    side by side.

    Attributes:
        mean, scale: Constants of the normalisation, shape (n,); only the first n observations are used.
        waves: Angular frequencies w, shape (k,).
        layers: Weights, shape (out, in), and biases, shape (out,), of one layer after the other.
        activation: Of the hidden layers, a key of `ACTIVATIONS`.
        output: Behind the last layer, a key of `OUTPUTS`.
        gain, shift: Shape (m,).
        low, high: Bounds of an action, shape (m,); None for -1 and 1.
        eyes: One for each camera, by name; none where observations are vectors.
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

    def __call__(self, x: Any) -> Array:
        """Outputs, shape (..., m), for observations of shape (..., at least n), or for dictionaries with pictures."""
        if self.eyes:
            x = np.concatenate([eye(x[key]) for eye, key in zip(self.eyes, picture_names(x), strict=True)], axis=-1)
        h = (x[..., : len(self.mean)] - self.mean) / self.scale
        if len(self.waves):
            angles = (h[..., :, None] * self.waves).reshape(*h.shape[:-1], -1)
            h = np.concatenate([h, np.sin(angles), np.cos(angles)], axis=-1)
        activation = ACTIVATIONS[self.activation]
        for weight, bias in self.layers[:-1]:
            h = activation(h @ weight.T + bias)
        weight, bias = self.layers[-1]
        return self.shift + self.gain * OUTPUTS[self.output](h @ weight.T + bias)


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
    if network.low is not None and network.high is not None:
        tensors |= {"low": network.low, "high": network.high}
    for index, (weight, bias) in enumerate(network.layers):
        tensors |= {f"layer{index}.weight": weight, f"layer{index}.bias": bias}
    for number, eye in enumerate(network.eyes):
        tensors |= {f"eye{number}.strides": np.array(eye.strides, float), f"eye{number}.sharpness": eye.sharpness}
        for index, (weight, bias) in enumerate(eye.layers):
            tensors |= {f"eye{number}.layer{index}.weight": weight, f"eye{number}.layer{index}.bias": bias}
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
        open_input(path, "the policy", most=MOST_BYTES).close()
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
    for name, value in tensors.items():
        if value.dtype not in (np.float32, np.float64) or not np.isfinite(value).all():
            raise InputError(f"{name} must be finite floating-point numbers")
    eyes = [_eye(tensors, f"eye{number}.") for number in range(sum(name.endswith(".strides") for name in tensors))]
    tensors = {name: value for name, value in tensors.items() if not name.startswith("eye")}
    count = sum(name.endswith(".weight") for name in tensors)
    names = {f"layer{i}.{part}" for i in range(count) for part in ("weight", "bias")}
    expected = {"mean", "scale", "waves", "gain", "shift"} | names | ({"low", "high"} & set(tensors))
    if count == 0 or set(tensors) != expected:
        raise InputError(f"its tensors must be {sorted(expected)}, got {sorted(tensors)}")
    doubles = {name: value.astype(np.float64) for name, value in tensors.items()}
    layers = [(doubles[f"layer{i}.weight"], doubles[f"layer{i}.bias"]) for i in range(count)]
    mean, scale, waves, gain, shift = (doubles[name] for name in ("mean", "scale", "waves", "gain", "shift"))
    if eyes and mean.size != sum(eye.places for eye in eyes):
        raise InputError(f"mean must have a number for each that the eyes say, got {mean.size}")
    width = mean.size * (1 + 2 * waves.size)
    for index, (weight, bias) in enumerate(layers):
        if weight.ndim != 2 or weight.shape[1] != width or bias.shape != weight.shape[:1]:
            raise InputError(f"layer {index} must take {width} numbers, got weight {weight.shape}, bias {bias.shape}")
        width = len(bias)
    if any(value.ndim != 1 for value in (mean, scale, waves, gain, shift)) or mean.shape != scale.shape:
        raise InputError("mean, scale, waves, gain and shift must have one dimension, mean and scale the same length")
    if gain.shape != (width,) or shift.shape != (width,) or not (scale > 0).all():
        raise InputError(f"gain and shift must have {width} numbers, scale must be positive")
    low, high = doubles.get("low"), doubles.get("high")
    if (low is None) != (high is None):
        raise InputError("low and high must both be there, or neither")
    if low is not None and high is not None and not (low.shape == high.shape == (width,) and (low < high).all()):
        raise InputError(f"low and high must have {width} numbers, low below high")
    return Network(mean, scale, waves, layers, card.activation, card.output, gain, shift, low, high, eyes)


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


#: Steps are not split for a remainder below this [steps].
SLACK = 1e-6


def paced(way: Array) -> Array:
    """The next multi-step action on the straight way in joint space, in equal steps as few as can be.

    Equal steps end at the posture with a long one. An arm that creeps up to it would come within the thesis's 10 mm
    somewhere on the way, where the episode ends.

    Args:
        way: Joint angles still to go [rad], shape (..., n).

    Returns:
        Action in [-1, 1], shape (..., n).
    """
    steps = np.abs(way).max(axis=-1, keepdims=True) / STEP_SIZE
    return way / STEP_SIZE / np.maximum(1.0, np.ceil(steps - SLACK))


#: No environment observes larger numbers.
MOST_OBSERVED = 1e6
_SUFFIX = ".safetensors"


class LearnedPolicy:
    """A trained policy, for any environment whose spaces it fits. Threads may share an instance.

    Args:
        card, network: As `read_policy` returns them.
        exact: Whether an observation has just as many numbers as the network takes; else it may have more.

    Attributes:
        card: What is known of it.
        network: Its numbers.
        bounds: The least and the largest action, shape (m,) or numbers.
        stepwise: Whether its output is a posture that it walks to in steps.
    """

    def __init__(self, card: PolicyCard, network: Network, *, exact: bool = False) -> None:
        self.card, self.network = card, network
        self._exact = exact
        self.bounds = (-1.0 if network.low is None else network.low, 1.0 if network.high is None else network.high)
        self.stepwise = card.meaning == "posture" and _walks(card)

    def reset(self, observation: Any = None, info: Any = None) -> None:
        """A trained policy remembers nothing."""

    def act(self, observation: ArrayLike | Mapping[str, ArrayLike]) -> Any:
        """The deterministic action for an observation, shape (n,), or for a batch of them, shape (count, n).

        A policy that sees pictures takes a dictionary as environments with `observation="pixels"` give it.

        Returns:
            Actions, shape (..., m), or the number of a discrete action, shape (...).

        Raises:
            InputError: A wrong shape, values that are not finite, or so large that the network's output is not.
        """
        output = self._output(observation)
        if self.card.meaning == "preferences":
            return output.argmax(axis=-1)
        action = np.clip(output, *self.bounds)
        if not self.stepwise:
            return action
        half, middle = self.action_range
        return paced(half * action + middle - self._joints(observation))

    def posture(self, observation: ArrayLike | Mapping[str, ArrayLike]) -> Array:
        """The posture that a reach policy aims at [rad], shape (..., m).

        Raises:
            InputError: The policy's output means something else, is none of its arm's postures, or as for `act`.
            UnknownNameError: There is no arm of the name that its card says.
        """
        if self.card.meaning != "posture":
            raise InputError(f"the output of {self.name} means {self.card.meaning}, not a posture")
        half, middle = self.action_range
        return np.asarray(half * np.clip(self._output(observation), *self.bounds) + middle)

    @cached_property
    def action_range(self) -> tuple[Any, Any]:
        """What an action of 1 means for each joint of its arm, from the middle of its range, and the middle [rad].

        Half a turn and 0 where the card names no arm.
        """
        name = trained_arm(self).get("arm")
        if name is None:
            return SINGLE_STEP.scale, 0.0
        half, middle = action_range(get_arm(name))
        if half.shape != self.network.gain.shape:
            numbers = len(self.network.gain)
            raise InputError(f"{numbers} numbers are no posture of arm {name!r}, which has {len(half)} joints")
        return half, middle

    @property
    def name(self) -> str:
        """Name of its recipe."""
        return str(self.card.recipe.get("name") or "the policy")

    def check_spaces(self, observations: spaces.Space[Any], actions: spaces.Space[Any]) -> None:
        """Refuse an environment that the policy cannot act in.

        Args:
            observations: Space of one environment, not of a batch.
            actions: Likewise.

        Raises:
            InputError: The observations are no vector, or too short, or the actions are of another kind or number.
        """
        outputs = len(self.network.gain)
        if self.network.eyes:
            _check_pictures(self.name, len(self.network.eyes), observations)
            observations = spaces.Box(-np.inf, np.inf, (self.inputs,))
        vector = isinstance(observations, spaces.Box) and len(observations.shape) == 1
        if not vector or not self.takes(observations.shape[0]):  # type: ignore[index]
            raise InputError(
                f"{self.name} takes a vector of {self._wanted} numbers, not observations of {observations}"
            )
        if self.card.meaning == "preferences":
            fits = isinstance(actions, spaces.Discrete) and actions.n == outputs
            kind = f"one of {outputs} actions"
        else:
            fits, kind = isinstance(actions, spaces.Box) and actions.shape == (outputs,), f"{outputs} numbers"
        if not fits:
            raise InputError(f"{self.name} answers with {kind}, which is no action of {actions}")

    @property
    def inputs(self) -> int:
        """How many numbers an observation has at least."""
        return max(len(self.network.mean), len(self.network.gain) + 1 if self.stepwise else 0)

    @property
    def _wanted(self) -> str:
        return f"{'' if self._exact else 'at least '}{self.inputs}"

    def takes(self, count: int) -> bool:
        """Whether an observation may have so many numbers."""
        return count == self.inputs if self._exact else count >= self.inputs

    def _output(self, observation: ArrayLike | Mapping[str, ArrayLike]) -> Array:
        """What the network says of observations, once they and its answer are found to be numbers."""
        x: Any = self._pictures(observation) if self.network.eyes else self._numbers(observation)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            output = self.network(x)
        if not np.isfinite(output).all():
            raise InputError(f"the network of {self.name} answers with what is no number")
        return output

    def _joints(self, observation: Any) -> Array:
        """Joint angles [rad] in an observation."""
        if self.network.eyes:
            return np.asarray(observation["joints"])
        return np.asarray(observation)[..., -1 - len(self.network.gain) : -1]  # before the gripper's opening

    def _numbers(self, observation: Any) -> Array:
        x = as_floats("observation", observation)
        if x.ndim == 0 or not self.takes(x.shape[-1]):
            raise InputError(f"an observation must have {self._wanted} numbers, got shape {x.shape}")
        check_entries("observation", x, MOST_OBSERVED)
        return x

    def _pictures(self, observation: Any) -> dict[str, Array]:
        names, wanted = picture_names(observation) if isinstance(observation, Mapping) else [], len(self.network.eyes)
        if len(names) != wanted:
            raise InputError(f"{self.name} takes observations with {wanted} pictures, got {shown(observation)}")
        pictures = {name: np.asarray(observation[name]) for name in names}
        for name, picture in pictures.items():
            if picture.dtype != np.uint8 or picture.ndim < 3 or picture.shape[-1] != 3 or not picture.size:
                raise InputError(f"{name} must be uint8, shape (..., height, width, 3), got {shown(picture)}")
        return pictures


def picture_names(observation: Mapping[str, Any]) -> list[str]:
    """Names of the colour pictures in an observation, in the order of a policy's eyes."""
    return sorted(name for name in observation if name.endswith("_rgb"))


def _check_pictures(name: str, count: int, space: spaces.Space[Any]) -> None:
    """Refuse an environment whose observations do not have so many pictures."""
    parts = space.spaces if isinstance(space, spaces.Dict) else {}
    pictures = [parts[key] for key in picture_names(parts)]
    if len(pictures) != count or not all(isinstance(part, spaces.Box) and len(part.shape) == 3 for part in pictures):
        raise InputError(f'{name} takes {count} pictures, observation="pixels", not observations of {space}')


def pretrained_names() -> list[str]:
    """Names of the policies that come with the package."""
    folder = resources.files("kinreach.baselines") / "pretrained"
    return sorted(file.name.removesuffix(_SUFFIX) for file in folder.iterdir() if file.name.endswith(_SUFFIX))


def _options(card: PolicyCard) -> Mapping[str, Any]:
    """Options of the environment that a policy was trained in, as far as its card, which may be anybody's, has them."""
    options = card.recipe.get("options")
    return options if isinstance(options, Mapping) else {}


def _walks(card: PolicyCard) -> bool:
    """Whether a posture is walked to: where the environment takes steps, or the recipe says that it was in training."""
    walk = card.recipe.get("walk")
    return (
        card.environment in (MULTI, MULTI_KINEMATIC)
        or (card.environment == SPACE and _options(card).get("steps") == "multi")
        or (isinstance(walk, int) and walk > 1)
    )


def trained_arm(policy: LearnedPolicy) -> dict[str, Any]:
    """The option `arm` of the environment that a policy was trained in, as far as its card names one."""
    arm = _options(policy.card).get("arm")
    return {"arm": arm} if isinstance(arm, str) else {}


#: Options that say which goals there are, or what is observed, by the environment.
NEEDED: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys((SINGLE, MULTI), ("goal_in",)),
    SPACE: ("steps", "goal_height", "tilt", "start_spread", "goal_in"),
    MOVING: ("sights",),
    BUTTON: ("controls", "frames"),
}


def needed_options(policy: LearnedPolicy) -> dict[str, Any]:
    """Options of an environment for a policy, as far as its card has them.

    The arm, what `NEEDED` has of its environment, and pictures of the size that it learned from if it sees any.
    """
    options = _options(policy.card)
    own = NEEDED.get(policy.card.environment, ())
    needed = {**trained_arm(policy), **{name: options[name] for name in own if name in options}}
    if policy.network.eyes:
        size = {name: options[name] for name in ("width", "height") if isinstance(options.get(name), int)}
        needed |= {"observation": "pixels", **size}
    return needed


def load_policy(policy: str | Path, *, environment: str | None = None) -> LearnedPolicy:
    """Load a policy.

    Args:
        policy: Name of one that comes with the package, or path of a policy file or of a stable-baselines3
            `model.zip`. The zip does not say which environment it is for.
        environment: Id of the environment that it must be for.

    Raises:
        InputError: There is no such policy, the file is not a policy, or it is for another environment.
        InstallationError: A `model.zip`, and torch is not installed.
    """
    names = pretrained_names()
    if str(policy) in names:
        with resources.as_file(resources.files("kinreach.baselines") / "pretrained" / f"{policy}{_SUFFIX}") as path:
            card, network = read_policy(path)
    elif (path := check_path("policy", policy)).suffix == ".zip":
        from kinreach.baselines.sb3_zip import read_zip

        card, network = read_zip(path)
        return LearnedPolicy(replace(card, environment=environment or ""), network, exact=True)
    elif path.suffix or path.exists():
        card, network = read_policy(path)
    else:
        raise UnknownNameError(f"there is no policy {str(policy)!r}; a file, or one of: {', '.join(names)}")
    if environment is not None and environment != card.environment:
        raise InputError(f"the policy {policy} is for {card.environment}, not for {environment}")
    return LearnedPolicy(card, network)
