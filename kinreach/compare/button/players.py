"""Who plays episodes of the button task: the analytic controller, trained policies, chance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from kinreach.baselines.button_controller import AnalyticButtonPolicy
from kinreach.baselines.policies import load_policy
from kinreach.baselines.rollout import Policy, RandomPolicy
from kinreach.compare.policies import policy_version
from kinreach.compare.tasks import ButtonTask
from kinreach.envs.button.task import action_space
from kinreach.registration import BUTTON

#: What kinds of players there are, and what each is given, in words, for the record beside the results.
CONTROLLER, POLICY, CHANCE = "controller", "policy", "chance"
GIVEN: Mapping[str, str] = {
    CONTROLLER: "what the environment's agent observes, and a model of the arm: closed-form inverse kinematics, and "
    "the masses, friction, gears and period of the simulation; it adds up the controls that it asked for",
    POLICY: "what the environment's agent observes and nothing else; its deterministic action; no memory, so the "
    "controls are hidden from it",
    CHANCE: "nothing: uniform among the 54 actions, seeded by the episode",
}

#: The trained policy that comes with the package.
PRETRAINED = "button"


@dataclass(frozen=True)
class Player:
    """One way to play.

    Attributes:
        kind: A key of `GIVEN`.
        policy: What acts in an episode, from the seed of the episode's environment.
        versions: What the answers depend on besides code and packages, by name: digests of files.
    """

    kind: str
    policy: Callable[[int], Policy]
    versions: Mapping[str, str] = field(default_factory=dict)


def analytic(task: ButtonTask) -> Player:
    """The controller that knows the arm."""
    policy = AnalyticButtonPolicy(task.episode.actuation)
    return Player(CONTROLLER, lambda seed: policy)


def learned(policy: str) -> Callable[[ButtonTask], Player]:
    """A trained policy.

    Args:
        policy: Name of one that comes with the package, or path of a file.

    Returns:
        A function of the task, which raises an `InputError` if there is no such policy, the file is not a policy, or
        it is for another task.
    """

    def new(task: ButtonTask) -> Player:
        loaded = load_policy(policy, environment=BUTTON)
        return Player(POLICY, lambda seed: loaded, policy_version(policy))

    return new


def chance(task: ButtonTask) -> Player:
    """Draws its actions anew for each episode, whichever were played before."""

    def policy(seed: int) -> Policy:
        own = int(np.random.SeedSequence(seed, spawn_key=(1,)).generate_state(1)[0])  # not the stream of the start
        return RandomPolicy(action_space(), seed=own)

    return Player(CHANCE, policy)
