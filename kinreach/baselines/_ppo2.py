"""PPO2, the PPO of OpenAI Baselines and of Stable Baselines 2, in what stable-baselines3 does otherwise.

*   The value function is clipped as well: of the squared errors of the new value and of the new value held within the
    clip range of the old one, the larger counts. stable-baselines3 can clip too, but then takes the clipped one always.
*   Half of the mean squared error is what the value coefficient multiplies; stable-baselines3 has the whole.
*   An episode that ends because its steps are up has ended: no value is added for what might have followed. That is up
    to what the learner acts in, `kinreach.baselines._vec_envs.SB3VecEnv`.

All else (advantages, their normalisation in each minibatch, initial weights, Adam's ε) is the same in both.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from torch import Tensor


def ppo2_loss(
    log_ratio: Tensor,
    advantages: Tensor,
    values: Tensor,
    old_values: Tensor,
    returns: Tensor,
    *,
    clip: float,
    value_clip: float | Tensor | None,
    vf_coef: float,
) -> Tensor:
    """PPO2's loss, shape (...), without the entropy; tensors of shape (..., n) hold the n steps of a minibatch.

    Advantages are normalised here. `value_clip` is a number, or values of the shape (...) of it; None: any change.
    """
    advantages = advantages - advantages.mean(-1, keepdim=True)
    advantages = advantages / (advantages.std(-1, keepdim=True) + 1e-8)
    ratio = log_ratio.exp()
    surrogate = torch.minimum(advantages * ratio, advantages * ratio.clamp(1 - clip, 1 + clip))
    errors = (values - returns).square()
    if value_clip is not None:
        limit = torch.as_tensor(value_clip, dtype=values.dtype)[..., None]
        held = old_values + torch.maximum(torch.minimum(values - old_values, limit), -limit)
        errors = torch.maximum(errors, (held - returns).square())
    return vf_coef * 0.5 * errors.mean(-1) - surrogate.mean(-1)


class PPO2(PPO):
    """stable-baselines3's PPO with the update of PPO2; without `clip_range_vf`, values are not clipped."""

    def train(self) -> None:
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        progress: Any = self._current_progress_remaining
        clip = self.clip_range(progress)  # type: ignore[operator]
        value_clip = None if self.clip_range_vf is None else self.clip_range_vf(progress)  # type: ignore[operator]
        losses, divergences = [], []
        for _ in range(self.n_epochs):
            for batch in self.rollout_buffer.get(self.batch_size):
                values, log_prob, entropy = self.policy.evaluate_actions(batch.observations, batch.actions)
                log_ratio = log_prob - batch.old_log_prob
                loss = ppo2_loss(
                    log_ratio,
                    batch.advantages,
                    values.flatten(),
                    batch.old_values,
                    batch.returns,
                    clip=clip,
                    value_clip=value_clip,
                    vf_coef=self.vf_coef,
                )
                loss = loss - self.ent_coef * torch.as_tensor(entropy).mean()
                self.policy.optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
                self.policy.optimizer.step()
                losses.append(loss.item())
                divergences.append(float((log_ratio.exp() - 1 - log_ratio).mean().detach()))
        self._n_updates += self.n_epochs
        self.logger.record("train/loss", np.mean(losses))
        self.logger.record("train/approx_kl", np.mean(divergences))
        self.logger.record("train/std", torch.exp(self.policy.log_std).mean().item())
