"""PPO2's loss and one update of it, calculated again by hand."""

import copy

import numpy as np
import pytest
import torch

from kinreach.baselines._ppo2 import PPO2, ppo2_loss


@pytest.mark.parametrize("value_clip", [None, 0.3])
def test_the_loss_is_that_of_the_paper(value_clip):
    rng = np.random.default_rng(0)
    log_ratio, advantages, values, old, returns = rng.normal(size=(5, 3, 40))
    a = (advantages - advantages.mean(1, keepdims=True)) / (advantages.std(1, ddof=1, keepdims=True) + 1e-8)
    ratio = np.exp(log_ratio)
    surrogate = np.minimum(a * ratio, a * np.clip(ratio, 0.8, 1.2))
    errors = (values - returns) ** 2
    if value_clip:
        errors = np.maximum(errors, (old + np.clip(values - old, -value_clip, value_clip) - returns) ** 2)
    expected = 0.7 * 0.5 * errors.mean(1) - surrogate.mean(1)
    parts = [torch.tensor(part) for part in (log_ratio, advantages, values, old, returns)]
    found = ppo2_loss(*parts, clip=0.2, value_clip=value_clip, vf_coef=0.7)
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-12)


@pytest.mark.parametrize("value_clip", [None, 0.2])
def test_an_update_is_a_step_along_the_gradient_of_the_loss(value_clip):
    settings = {"learning_rate": 1e-2, "n_steps": 32, "batch_size": 32, "n_epochs": 2, "max_grad_norm": 0.1}
    model = PPO2("MlpPolicy", "Pendulum-v1", **settings, ent_coef=0.05, vf_coef=0.7, clip_range_vf=value_clip, seed=0)
    _, callback = model._setup_learn(64)
    logger = Lines()
    model.set_logger(logger)
    assert model.collect_rollouts(model.env, callback, model.rollout_buffer, 32)
    policy = copy.deepcopy(model.policy)
    assert not model.policy.training
    (batch,) = copy.deepcopy(model.rollout_buffer).get(32)
    losses = []
    for _ in range(2):
        values, log_prob, entropy = policy.evaluate_actions(batch.observations, batch.actions)
        loss = ppo2_loss(
            log_prob - batch.old_log_prob, batch.advantages, values.flatten(), batch.old_values, batch.returns,
            clip=0.2, value_clip=value_clip, vf_coef=0.7,
        ) - 0.05 * entropy.mean()  # fmt: skip
        policy.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(policy.parameters(), 0.1)
        policy.optimizer.step()
        losses.append(loss.item())
    before = model._n_updates
    model.train()
    assert model._n_updates == before + 2
    assert model.policy.training  # as stable-baselines3's
    for own, expected in zip(model.policy.parameters(), policy.parameters(), strict=True):
        torch.testing.assert_close(own, expected, rtol=1e-4, atol=1e-6)
    assert logger.values["train/loss"] == pytest.approx(np.mean(losses), rel=1e-4)
    ratio = (log_prob - batch.old_log_prob).detach()
    assert logger.values["train/approx_kl"] == pytest.approx(float((ratio.exp() - 1 - ratio).mean()) / 2, rel=1e-2)
    assert logger.values["train/std"] == pytest.approx(float(policy.log_std.detach().exp().mean()), rel=1e-4)


class Lines:
    """A logger that keeps what it is told."""

    def __init__(self):
        self.values = {}

    def record(self, name, value, **options):
        self.values[name] = value
