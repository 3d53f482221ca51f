"""Ranked PPO: several actions are tried from the same state, and their ranks are the advantages.

Where the outcome of one action can be judged at once, as the reward of reaching can, a critic that predicts the mean
outcome of a state is the largest source of error of PPO. Here K actions are tried from every state and compared with
one another: the advantage of each is the normal score of its rank among the K. There is no critic, and no scale of the
reward to tune. The rest is PPO: clipped ratios, several epochs, minibatches.

Group-relative advantages are those of GRPO (Shao et al. 2024, DeepSeekMath, section 4.1), with ranks instead of
standardised rewards; rank-based shaping with normal scores is that of evolution strategies.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from scipy.special import ndtri
from stable_baselines3.common.buffers import RolloutBuffer

from kinreach.baselines.adaptive_ppo import AdaptivePPO


def normal_scores(rewards: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Normal scores of the ranks within each row, shape (n, k): mean 0, variance 1; equal rewards share a rank."""
    k = rewards.shape[1]
    left, right = rewards[:, :, None], rewards[:, None, :]
    doubled = 2 * (left > right).sum(axis=2) + (left == right).sum(axis=2) - 1  # twice the mean rank from 0
    scores = ndtri((np.arange(2 * k - 1) + 1) / (2 * k))
    return (scores / scores[::2].std())[doubled]


class RankedRolloutBuffer(RolloutBuffer):
    """A rollout buffer whose advantages are ranks among the `tries` that share a state.

    Args:
        tries: How many consecutive environments share their states.
        *args, **kwargs: Of `RolloutBuffer`.
    """

    def __init__(self, *args: Any, tries: int, **kwargs: Any) -> None:
        self.tries = tries
        super().__init__(*args, **kwargs)

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: np.ndarray[Any, Any]) -> None:
        """Rank the rewards; values are of no use."""
        outcomes = self.rewards.reshape(-1, self.tries)
        self.advantages = normal_scores(outcomes).astype(np.float32).reshape(self.rewards.shape)
        self.returns = np.zeros_like(self.rewards)


class RankedPPO(AdaptivePPO):
    """PPO with ranks among several tries instead of a critic.

    Args:
        tries: Actions tried from each state; the environment must be a `TriesVecEnv` of as many.
        **kwargs: Of `AdaptivePPO`.
    """

    def __init__(self, *args: Any, tries: int, **kwargs: Any) -> None:
        super().__init__(
            *args,
            rollout_buffer_class=RankedRolloutBuffer,
            rollout_buffer_kwargs={"tries": tries},
            vf_coef=0.0,
            normalize_advantage=False,
            **kwargs,
        )
