"""An actor whose weights are averaged over its last updates, and which is exported with these."""

from __future__ import annotations

import copy
from typing import Any

import torch
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

#: Over how many updates weights are averaged.
AVERAGED = 150


class AveragedActor(OnPolicyAlgorithm):
    """An algorithm that averages weights; a subclass calls `_average` after every update.

    Attributes:
        average: The policy with the mean of its weights over the last updates, which is exported.
    """

    def _setup_model(self) -> None:
        super()._setup_model()
        self.average: Any = copy.deepcopy(self.policy)

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        modules, variables = super()._get_torch_save_params()
        return [*modules, "average"], variables

    @torch.no_grad()
    def _average(self) -> None:
        """Take the weights of the last update into the average; `_n_updates` counts it."""
        share = 1.0 / min(self._n_updates + 1, AVERAGED)
        for mean, new in zip(self.average.parameters(), self.policy.parameters(), strict=True):
            mean.lerp_(new, share)
