"""Trained policies, from policy files; nothing in a file is executed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import as_floats, check_entries, check_path, shown
from kinreach._files import read_bytes
from kinreach._provenance import digest
from kinreach._registration import BUTTON, LIFT, MOVING, MULTI, MULTI_KINEMATIC, SINGLE, SPACE
from kinreach.baselines._eyes import picture_names
from kinreach.baselines._policy_file import MAX_BYTES, Network, PolicyCard, read_policy
from kinreach.envs.inside import reach_task
from kinreach.errors import InputError, UnknownNameError
from kinreach.robots import get_arm

Array = NDArray[Any]

#: Steps are not split for a remainder below this [steps].
SLACK = 1e-6


def paced(way: Array, largest: Array) -> Array:
    """Return the next multi-step action, in [-1, 1], for a way still to go [rad, m], in the fewest equal steps.

    `largest` are the joints' largest steps, shape (n,). Smaller last steps would end episodes on the way, within the
    thesis's 10 mm of the goal.
    """
    steps = way / largest
    return np.asarray(steps / np.maximum(1.0, np.ceil(np.abs(steps).max(axis=-1, keepdims=True) - SLACK)))


_SUFFIX = ".safetensors"


class LearnedPolicy:
    """A trained policy. Threads may share an instance.

    Args:
        card, network: As `read_policy` returns them.

    Attributes:
        card, network: As given.
        bounds: The least and the largest action, shape (m,) or numbers.
        stepwise: Whether its output is a posture that is approached in steps.
    """

    def __init__(self, card: PolicyCard, network: Network) -> None:
        self.card, self.network = card, network
        self.bounds = (-1.0 if network.low is None else network.low, 1.0 if network.high is None else network.high)
        self.stepwise = card.meaning == "posture" and _walks(card)

    def reset(self, observation: Any = None, info: Any = None) -> None:
        """Do nothing: a network has no memory."""

    def act(self, observation: ArrayLike | Mapping[str, ArrayLike]) -> Any:
        """Return the deterministic action for an observation, shape (n,), or for a batch of them, shape (count, n).

        For a policy that sees pictures, it is a dictionary as of environments with `observation="pixels"`.

        Returns:
            Actions, shape (..., m), or the number of a discrete action, shape (...).

        Raises:
            InputError: A wrong shape, or values that are not finite or too large.
        """
        output = self._output(observation)
        if self.card.meaning == "preferences":
            return output.argmax(axis=-1)
        action = np.clip(output, *self.bounds)
        if not self.stepwise:
            return action
        half, middle = self.action_range
        return paced(half * action + middle - self._joints(observation), self.step_sizes)

    def posture(self, observation: ArrayLike | Mapping[str, ArrayLike]) -> Array:
        """Return the posture that a reach policy aims at [rad], shape (..., m).

        Raises:
            InputError: The policy's output is not a posture of its arm, or as for `act`.
            UnknownNameError: The arm of its card is unknown.
        """
        if self.card.meaning != "posture":
            raise InputError(f"the output of {self.name} means {self.card.meaning}, not a posture")
        half, middle = self.action_range
        return np.asarray(half * np.clip(self._output(observation), *self.bounds) + middle)

    @cached_property
    def action_range(self) -> tuple[Any, Any]:
        """Half of each joint's range and its middle [rad]; half a turn and 0 if the card names no arm."""
        name = self.arm
        if not name:
            return reach_task.SINGLE_STEP.scale, 0.0
        half, middle = reach_task.action_range(get_arm(name))
        if half.shape != self.network.gain.shape:
            numbers = len(self.network.gain)
            raise InputError(f"a posture of the arm {name!r} has {len(half)} numbers, got {numbers}")
        return half, middle

    @cached_property
    def step_sizes(self) -> Array:
        """The largest change of each joint in a step [rad, m], shape (m,); 5 degrees if the card names no arm."""
        if not self.arm:
            return np.full(len(self.network.gain), reach_task.STEP_SIZE)
        return reach_task.step_sizes(get_arm(self.arm))

    @property
    def digest(self) -> str:
        """Its name, and a digest of its numbers."""
        network = self.network
        layers = [*network.layers, *(layer for eye in network.eyes for layer in eye.layers)]
        numbers = [*(part for layer in layers for part in layer), network.mean, network.scale, network.gain]
        return f"{self.name} {digest(b''.join(np.ascontiguousarray(part, dtype=float).tobytes() for part in numbers))}"

    @property
    def name(self) -> str:
        """Name of the recipe that trained it."""
        return str(self.card.recipe.get("name") or "the policy")

    @property
    def options(self) -> Mapping[str, Any]:
        """Options of the environment that it was trained in, if its card has them."""
        return _options(self.card)

    @property
    def arm(self) -> str:
        """Name of the arm that it was trained on; empty if its card has none."""
        name = self.options.get("arm")
        return name if isinstance(name, str) else ""

    @property
    def needed_options(self) -> dict[str, Any]:
        """Options of an environment that it needs: the arm, those of `NEEDED`, and the size of pictures."""
        own = NEEDED.get(self.card.environment, ())
        needed = {"arm": self.arm} if self.arm else {}
        needed |= {name: self.options[name] for name in own if name in self.options}
        if self.network.eyes:
            size = {name: self.options[name] for name in ("width", "height") if isinstance(self.options.get(name), int)}
            needed |= {"observation": "pixels", **size}
        return needed

    def check_spaces(self, observations: spaces.Space[Any], actions: spaces.Space[Any]) -> None:
        """Refuse the spaces of one environment, not of a batch, if the policy cannot act in them."""
        outputs = len(self.network.gain)
        if self.network.eyes:
            _check_pictures(self.name, len(self.network.eyes), observations)
            observations = spaces.Box(-np.inf, np.inf, (self.inputs,))
        vector = isinstance(observations, spaces.Box) and len(observations.shape) == 1
        if not vector or not self.accepts(observations.shape[0]):  # type: ignore[index]
            raise InputError(
                f"{self.name} takes a vector of at least {self.inputs} numbers, not observations of {observations}"
            )
        if self.card.meaning == "preferences":
            fits = isinstance(actions, spaces.Discrete) and actions.n == outputs
            kind = f"one of {outputs} actions"
        else:
            fits, kind = isinstance(actions, spaces.Box) and actions.shape == (outputs,), f"{outputs} numbers"
        if not fits:
            raise InputError(f"{self.name} answers with {kind}, which is not an action of {actions}")

    @property
    def inputs(self) -> int:
        """Least number of entries of an observation."""
        return max(self.network.inputs, len(self.network.gain) + 1 if self.stepwise else 0)

    def accepts(self, count: int) -> bool:
        """Return whether an observation may have `count` numbers."""
        return count >= self.inputs

    def _output(self, observation: ArrayLike | Mapping[str, ArrayLike]) -> Array:
        x: Any = self._pictures(observation) if self.network.eyes else self._numbers(observation)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            output = self.network(x)
        if not np.isfinite(output).all():
            raise InputError(f"the network of {self.name} answers with NaN or infinity")
        return output

    def _joints(self, observation: Any) -> Array:
        if self.network.eyes:
            return np.asarray(observation["joints"])
        return np.asarray(observation)[..., -1 - len(self.network.gain) : -1]  # before the gripper's opening

    def _numbers(self, observation: Any) -> Array:
        x = as_floats("observation", observation)
        if x.ndim == 0 or not self.accepts(x.shape[-1]):
            raise InputError(f"an observation must have at least {self.inputs} numbers, got shape {x.shape}")
        check_entries("observation", x, 1e6)
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


def _check_pictures(name: str, count: int, space: spaces.Space[Any]) -> None:
    parts = space.spaces if isinstance(space, spaces.Dict) else {}
    pictures = [parts[key] for key in picture_names(parts)]
    if len(pictures) != count or not all(isinstance(part, spaces.Box) and len(part.shape) == 3 for part in pictures):
        raise InputError(f'{name} takes {count} pictures, observation="pixels", not observations of {space}')


def pretrained_names() -> list[str]:
    folder = resources.files("kinreach.baselines") / "pretrained"
    return sorted(file.name.removesuffix(_SUFFIX) for file in folder.iterdir() if file.name.endswith(_SUFFIX))


def _options(card: PolicyCard) -> Mapping[str, Any]:
    options = card.recipe.get("options")
    return options if isinstance(options, Mapping) else {}


def _walks(card: PolicyCard) -> bool:
    """Return whether postures are approached in steps, by the environment or in training."""
    walk = card.recipe.get("walk")
    return (
        card.environment in (MULTI, MULTI_KINEMATIC)
        or (card.environment == SPACE and _options(card).get("steps") == "multi")
        or (isinstance(walk, int) and walk > 1)
    )


#: Options that change the goals or the observation, by the environment.
NEEDED: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys((SINGLE, MULTI), ("goal_in",)),
    SPACE: ("steps", "goal_height", "tilt", "start_spread", "goal_in"),
    MOVING: ("sights", "collisions"),
    LIFT: ("steps", "shapes", "sizes"),
    BUTTON: ("controls", "frames"),
}


def load_policy(policy: str | Path, *, environment: str | None = None) -> LearnedPolicy:
    """Load a policy.

    Args:
        policy: Name of one in the package, or path of a policy file.
        environment: Id of the environment that it must be for.

    Raises:
        InputError: Unknown policy, not a policy file, or a policy for another environment.

    Examples:
        >>> import gymnasium as gym
        >>> import kinreach
        >>> from kinreach.baselines import load_policy
        >>> policy = load_policy("ranked-single")
        >>> env = gym.make("kinreach/UR5SingleStep-v0", observation="geometric", backend="kinematic")
        >>> observation, info = env.reset(seed=0)
        >>> policy.act(observation).shape
        (6,)
    """
    names = pretrained_names()
    if str(policy) in names:
        with resources.as_file(resources.files("kinreach.baselines") / "pretrained" / f"{policy}{_SUFFIX}") as path:
            card, network = read_policy(path)
    elif (path := check_path("policy", policy)).suffix == ".zip":
        beside = (folder / "vecnormalize.pkl" for folder in (path.parent, path.with_suffix("")))
        found = next((f", normalize=VecNormalize.load('{file}', venv)" for file in beside if file.exists()), "")
        raise InputError(
            f"{path}: loading stable-baselines3's own files can run code in them, so kinreach reads none; if you trust "
            "it, load it in Python and write a policy file: kinreach.baselines.export_policy(PPO.load(...), "
            f"'policy.safetensors', environment=ID{found})"
        )
    elif path.suffix or path.exists():
        card, network = read_policy(path)
    else:
        raise UnknownNameError(f"there is no policy {str(policy)!r}; a file, or one of: {', '.join(names)}")
    if environment is not None and environment != card.environment:
        raise InputError(f"the policy {policy} is for {card.environment}, not for {environment}")
    return LearnedPolicy(card, network)


def policy_version(policy: str) -> dict[str, str]:
    """Return the digest of the file of a policy, a name of the package's or a path, by the policy's name."""
    shipped = resources.files("kinreach.baselines") / "pretrained" / f"{policy}{_SUFFIX}"
    content = shipped.read_bytes() if shipped.is_file() else read_bytes(Path(policy), "the policy", most=MAX_BYTES)
    return {f"policy {policy}": digest(content)}
