"""PPO that begins with a policy which ignores collisions, and with a table that is out of its way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from kinreach.baselines._adaptive_ppo import AdaptivePPO
from kinreach.baselines._policies import load_policy
from kinreach.envs._moving import MovingEpisodes
from kinreach.kinematics import CollisionChecker

#: Heights at which the table stands on its way up, the last is its own.
LEVELS = 6


class LoweredTablePPO(AdaptivePPO):
    """Train in a simulation whose table comes up during the training.

    Args:
        world: The simulation.
        start: Name or file of the policy whose actor it begins with, of the same size.
        lowered: How far the table is lowered at first [m].
        until: Share of the training after which the table is where it belongs.
        **kwargs: Of `AdaptivePPO`.
    """

    def __init__(
        self, *args: Any, world: MovingEpisodes, start: str, lowered: float, until: float, **kwargs: Any
    ) -> None:
        self._until = until
        self._world = [world]  # stable-baselines3 copies plain attributes where it saves a model
        obstacles = world.arm.workcell.obstacles
        self._checkers = [
            CollisionChecker(world.arm, obstacles=_lowered(obstacles, lowered * (1.0 - level / (LEVELS - 1))))
            for level in range(LEVELS)
        ]
        super().__init__(*args, **kwargs)
        self._copy_actor(start)

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> bool:
        """Put the table where it is to be, then act."""
        level = min(int(self.progress / self._until * (LEVELS - 1)), LEVELS - 1)
        self._world[0].checker = self._checkers[level]
        return super().collect_rollouts(*args, **kwargs)

    def _copy_actor(self, start: str) -> None:
        """Take over the weights of a policy's actor."""
        network: Any = load_policy(start).network
        policy: Any = self.policy
        hidden = [layer for layer in policy.mlp_extractor.policy_net if isinstance(layer, torch.nn.Linear)]
        with torch.no_grad():
            for layer, (weights, biases) in zip([*hidden, policy.action_net], network.layers, strict=True):
                layer.weight.copy_(torch.from_numpy(np.asarray(weights)))
                layer.bias.copy_(torch.from_numpy(np.asarray(biases)))


def _lowered(boxes: Sequence[Any], depth: float) -> list[Any]:
    """Return boxes with the table lower."""
    return [
        replace(box, position=(*box.position[:2], box.position[2] - depth)) if box.name == "table" else box
        for box in boxes
    ]
