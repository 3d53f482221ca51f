"""Trained policies, run in numpy: loading and running them needs neither torch nor the library that trained them."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach.baselines.network import Network
from kinreach.baselines.pacing import paced
from kinreach.baselines.policy_file import PolicyCard, read_policy
from kinreach.envs.reach.task import SINGLE_STEP
from kinreach.errors import InputError, UnknownNameError, raise_unknown
from kinreach.inputs import check_known, check_path
from kinreach.kinematics.goals import as_floats, check_entries
from kinreach.registration import BUTTON, MULTI, SINGLE

Array = np.ndarray[Any, Any]

#: No environment observes larger numbers.
MOST_OBSERVED = 1e6
_SUFFIX = ".safetensors"
#: Environment -> length of an observation, length of the network's output, what the output may mean.
_FITS = {
    SINGLE: (13, 6, ("action", "posture")),
    MULTI: (13, 6, ("action", "posture")),
    BUTTON: (19, 54, ("preferences",)),
}


class LearnedPolicy:
    """A policy from a file. Threads may share an instance.

    Args:
        card, network: As `read_policy` returns them.

    Attributes:
        card: What is known of it.

    Raises:
        InputError: The network does not fit the environment that its card names.
    """

    def __init__(self, card: PolicyCard, network: Network) -> None:
        if card.environment not in _FITS:
            raise_unknown("environment of a policy", card.environment, _FITS)
        inputs, outputs, meanings = _FITS[card.environment]
        if len(network.mean) > inputs or len(network.gain) != outputs or card.meaning not in meanings:
            raise InputError(
                f"a policy for {card.environment} takes at most {inputs} numbers, gives {outputs}, and means "
                f"{' or '.join(meanings)}; this one takes {len(network.mean)}, gives {len(network.gain)}, and means "
                f"{card.meaning}"
            )
        self.card = card
        self._network = network
        self._inputs = inputs
        self._walks = card.environment == MULTI

    def reset(self, info: dict[str, Any]) -> None:
        """A trained policy remembers nothing."""

    def act(self, observation: Array) -> Any:
        """The deterministic action for an observation, shape (n,), or for a batch of them, shape (count, n).

        Returns:
            Actions in [-1, 1], shape (..., 6), or the number of a discrete action, shape (...).

        Raises:
            InputError: A wrong shape, values that are not finite, or so large that the network's output is not.
        """
        if self.card.meaning == "preferences":
            return self._output(observation).argmax(axis=-1)
        if self._walks and self.card.meaning == "posture":
            return paced(self.posture(observation) - np.asarray(observation)[..., 6:12])
        return np.clip(self._output(observation), -1.0, 1.0)

    def posture(self, observation: Array) -> Array:
        """The posture that a reach policy aims at [rad], shape (..., 6).

        Raises:
            InputError: The policy's output means something else, or as for `act`.
        """
        if self.card.meaning != "posture":
            raise InputError(f"the output of {self.card.recipe.get('name')} means {self.card.meaning}, not a posture")
        return SINGLE_STEP.scale * np.clip(self._output(observation), -1.0, 1.0)

    def _output(self, observation: ArrayLike) -> Array:
        """What the network says of observations, once they and its answer are found to be numbers."""
        x = as_floats("observation", observation)
        if x.ndim == 0 or x.shape[-1] != self._inputs:
            raise InputError(f"observation must have shape (..., {self._inputs}), got {x.shape}")
        check_entries("observation", x, MOST_OBSERVED)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            output = self._network(x)
        if not np.isfinite(output).all():
            raise InputError(f"the network of {self.card.recipe.get('name')} answers with what is no number")
        return output


def pretrained_names() -> list[str]:
    """Names of the policies that come with the package."""
    folder = resources.files("kinreach.baselines") / "pretrained"
    return sorted(file.name.removesuffix(_SUFFIX) for file in folder.iterdir() if file.name.endswith(_SUFFIX))


def load_policy(policy: str | Path, *, environment: str | None = None) -> LearnedPolicy:
    """Load a policy.

    Args:
        policy: Name of one that comes with the package, or path of a file.
        environment: Id of the environment that it must be for.

    Raises:
        InputError: There is no such policy, the file is not a policy, or it is for another environment.
    """
    names = pretrained_names()
    if str(policy) in names:
        with resources.as_file(resources.files("kinreach.baselines") / "pretrained" / f"{policy}{_SUFFIX}") as path:
            loaded = LearnedPolicy(*read_policy(path))
    elif check_path("policy", policy).suffix or Path(policy).exists():
        loaded = LearnedPolicy(*read_policy(policy))
    else:
        raise UnknownNameError(f"there is no policy {policy!r}; a file, or one of: {', '.join(names)}")
    if environment is not None:
        check_known("environment", environment, _FITS)
    if environment not in (None, loaded.card.environment):
        raise InputError(f"the policy {policy} is for {loaded.card.environment}, not for {environment}")
    return loaded
