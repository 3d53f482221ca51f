"""Ranked PPO on its page is stable-baselines3's PPO whose advantages are ranks, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.distributions import DiagGaussianDistribution

from kinreach.baselines import get_recipe
from kinreach.baselines._models import build
from kinreach.baselines._ranked_ppo import ScheduledLearner, normal_scores, sample_pairs
from kinreach.errors import InputError
from tests.baselines.small_runs import small


class Ranks(RolloutBuffer):
    def compute_returns_and_advantage(self, last_values, dones):
        self.advantages = normal_scores(self.rewards.reshape(-1, 8)).astype(np.float32).reshape(self.rewards.shape)
        self.returns = np.zeros_like(self.rewards)


class Pairs(DiagGaussianDistribution):
    def sample(self):
        return sample_pairs(self.distribution)


class Reference(ScheduledLearner, PPO):
    """PPO without a critic, with another buffer."""

    def train(self):
        super().train()
        self.adapt(float(self.logger.name_to_value["train/approx_kl"]))


@pytest.mark.parametrize("name", ["ranked-single", "ranked-multi", "ranked-lift"])
def test_updates_are_those_of_ppo_with_other_advantages(name):
    recipe = replace(get_recipe(name), num_envs=64, steps=64 * 4, segments=1, window=64)
    trainee = build(recipe, 5, steps=recipe.steps)
    ranked = trainee.model
    common = {key: getattr(ranked, key) for key in ("exploration", "adaptive", "planned_steps", "n_epochs")}
    reference = Reference(
        type(ranked.policy), trainee.env, **common, n_steps=1, batch_size=ranked.batch_size, clip_range=0.2,
        max_grad_norm=0.5, gamma=0.0, gae_lambda=1.0, vf_coef=0.0, normalize_advantage=False, device="cpu",
        rollout_buffer_class=Ranks, policy_kwargs=ranked.policy_kwargs,
    )  # fmt: skip
    before = {name: value.clone() for name, value in ranked.policy.state_dict().items()}
    reference.policy.load_state_dict(before)
    reference.policy.action_dist = Pairs(ranked.action_space.shape[0])
    weights = []
    for model in (ranked, reference):
        trainee.env.seed(7)
        torch.manual_seed(1)
        np.random.seed(2)
        model.learn(recipe.steps)
        weights.append(torch.cat([value.ravel() for value in model.policy.state_dict().values()]))
    trainee.env.close()
    start = torch.cat([value.ravel() for value in before.values()])
    assert (weights[0] != start).float().mean() > 0.5
    assert torch.equal(*weights)


class Events(BaseCallback):
    """What an algorithm tells its callback; the training ends in a step if asked to."""

    def __init__(self, last):
        super().__init__()
        self.last, self.told = last, []

    def _on_training_start(self):
        self.told.append(("training", self.num_timesteps))

    def _on_rollout_start(self):
        self.told.append(("rollout", self.num_timesteps))

    def _on_step(self):
        self.told.append(("step", self.num_timesteps, self.locals["rewards"].shape, self.model.policy.training))
        return self.num_timesteps < self.last

    def _on_rollout_end(self):
        self.told.append(("collected", self.num_timesteps))

    def _on_training_end(self):
        self.told.append(("trained", self.num_timesteps, self.model.policy.training))


@pytest.mark.parametrize("last", [10_000, 128])
def test_a_callback_is_told_what_ppo_tells_it(last):
    """Where it returns False the training ends, in mid-rollout."""
    recipe = replace(get_recipe("ranked-single"), num_envs=64, steps=64 * 3, segments=1, window=64)
    trainee, told = build(recipe, 5, steps=recipe.steps), []
    ppo = PPO("MlpPolicy", trainee.env, n_steps=1, batch_size=64, n_epochs=1, gae_lambda=1.0, device="cpu")
    for model in (trainee.model, ppo):
        told.append(events := Events(last))
        model.learn(recipe.steps, callback=events)
    trainee.env.close()
    assert told[0].told == told[1].told
    assert len(told[0].told) == (11 if last > recipe.steps else 7)


def test_samples_come_in_opposite_pairs():
    trainee = build(small("ranked-single"), 0, steps=768)
    observations = torch.as_tensor(trainee.env.reset(), dtype=torch.float32)
    with torch.no_grad():
        distribution = trainee.model.policy.get_distribution(observations).distribution
        noise = sample_pairs(distribution) - distribution.mean
    assert noise.abs().min() > 0
    np.testing.assert_allclose(noise[::2], -noise[1::2], atol=1e-6)
    np.testing.assert_allclose(noise.std(), distribution.stddev.mean(), rtol=0.2)


@pytest.mark.parametrize(("tries", "envs"), [(1, 64), (7, 63), (8, 60)])
def test_tries_are_even_and_the_same_for_all_states(tries, envs):
    recipe = get_recipe("ranked-single")
    recipe = replace(recipe, num_envs=envs, settings={**recipe.settings, "tries": tries})
    with pytest.raises(InputError, match=f"even number of tries.*got {tries} tries in {envs} environments"):
        build(recipe, 0, steps=envs)
