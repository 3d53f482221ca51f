"""Trained policies as methods: they are given what the environment's agent observes, and act as it does there."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import numpy as np

from kinreach.baselines.policies import load_policy, pretrained_names
from kinreach.checks import Floats
from kinreach.compare.deciding import POLICY, Decide, Decision
from kinreach.envs.reach.task import (
    ANGLES,
    GOAL,
    GRIPPER,
    MULTI_STEP,
    OBSERVATIONS,
    SINGLE_STEP,
    ReachVariant,
    check_actions,
)
from kinreach.errors import InputError
from kinreach.registration import MULTI, SINGLE
from kinreach.robots import ArmDescription
from kinreach.vision.goal_view import geometric_goal_view

#: What a method's name ends with if it is the path of a policy's file.
SUFFIX = ".safetensors"

#: Environments that policies can be compared in, by id.
VARIANTS: Mapping[str, ReachVariant] = {SINGLE: SINGLE_STEP, MULTI: MULTI_STEP}


class PolicyMethod:
    """A trained policy for one of the reach environments.

    What it does with a goal is an episode of that environment: the observation after every move, the action's meaning,
    the number of moves and the way the arm takes them are the environment's.

    Args:
        arm: Whose cameras and gripper the observation is about.
        policy: Name of a policy that comes with the package, or path of a file.

    Raises:
        InputError: There is no such policy, the file is not a policy, or it is for another task.
    """

    kind = POLICY

    def __init__(self, arm: ArmDescription, policy: str) -> None:
        self._arm = arm
        self._policy = load_policy(policy)
        environment = self._policy.card.environment
        if environment not in VARIANTS:
            raise InputError(f"the policy {policy} is for {environment}, not for one of: {', '.join(VARIANTS)}")
        self._variant = VARIANTS[environment]
        self.moves, self.two_phase = self._variant.max_steps, self._variant.two_phase
        self.versions = policy_version(policy)

    def about(self, position: Floats, view: Floats | None) -> Decide:
        """See `Method.about`; where nobody looked, the agent is given what perfect cameras would say."""
        observation = np.zeros(OBSERVATIONS)
        observation[GOAL] = geometric_goal_view(self._arm, position) if view is None else view
        observation[GRIPPER] = 0.0 if self._arm.gripper is None else self._arm.gripper.opening

        def decide(q: Floats) -> Decision:
            observation[ANGLES] = q
            action = check_actions(self._policy.act(observation), None)
            return Decision(self._variant.targets(q[None], action[None])[0], iterations=1)

        return decide


def is_policy_file(name: str) -> bool:
    """Whether a method's name is the path of a policy's file."""
    return name.endswith(SUFFIX)


def policy_version(policy: str) -> dict[str, str]:
    """What a policy's file is: the first 12 hex digits of its SHA-256, by name.

    Args:
        policy: Name of one that comes with the package, or path of a file.
    """
    shipped = policy in pretrained_names()
    file = resources.files("kinreach.baselines") / "pretrained" / f"{policy}{SUFFIX}" if shipped else Path(policy)
    return {f"policy {policy}": hashlib.sha256(file.read_bytes()).hexdigest()[:12]}
