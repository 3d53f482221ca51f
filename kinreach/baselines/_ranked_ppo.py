"""Ranked PPO from top to bottom: collection of data, ranks, loss, schedules, update.

It is for tasks where the reward of one action is its whole outcome, as in reaching: there, the critic is the largest
source of error of PPO. From every state s, K actions are tried, in antithetic pairs of a normal distribution:

    a_2i = μ_θ(s) + σ ε_i,   a_2i+1 = μ_θ(s) - σ ε_i,   ε_i ~ N(0, I)

The advantage of each is the normal score of its rank R_k = 0 ... K - 1 among the rewards of the K,

    A_k = Φ⁻¹((R_k + 1/2) / K) / c,   with c such that the K scores have variance 1,

so that there is no critic, and no scale of the reward to tune. The rest is PPO (Schulman et al. 2017, arXiv:1707.06347,
equation 7), in several epochs of minibatches:

    L(θ) = -E[min(ρ_k A_k, clip(ρ_k, 1 - δ, 1 + δ) A_k)],   ρ_k = π_θ(a_k | s) / π_old(a_k | s)

σ follows a schedule, and the learning rate the Kullback-Leibler divergence of the updates. Group-relative advantages
are those of GRPO (Shao et al. 2024, DeepSeekMath, section 4.1), with ranks instead of standardised rewards; normal
scores of ranks are those of evolution strategies. The networks, the loop over updates and the callbacks are
stable-baselines3's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from scipy.special import ndtri
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn
from torch.optim import Optimizer

from kinreach.baselines._batch import last_step
from kinreach.baselines._policies import paced
from kinreach.baselines._rewards import TrainingReward
from kinreach.baselines._vec_envs import SB3VecEnv
from kinreach.envs.inside import reach_task
from kinreach.errors import InputError
from kinreach.robots import THESIS_ARM, ArmDescription, get_arm

Array = np.ndarray[Any, Any]


# Collection of data


class TriesVecEnv(SB3VecEnv):
    """A batch of reach environments in groups of `tries` with the same goal; a step is a whole episode.

    Actions are postures, approached in `steps` steps; the reward is that of the last one.

    Args:
        tries: Size of a group.
        draw: Draws options of a reset, among them `goal` [m], shape (n, 3).
        steps: Of an episode; 1 if the environment's actions are postures.
        blur: Standard deviation of noise on the goal in observations [m], for cameras that do not quite agree.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        *,
        tries: int,
        draw: Callable[[np.random.Generator, int], Mapping[str, Array]],
        steps: int,
        reward: TrainingReward,
        blur: float,
        layout: reach_task.Layout = reach_task.UR5_LAYOUT,
        arm: str | ArmDescription = THESIS_ARM,
    ) -> None:
        super().__init__(env, reward=reward)
        self._tries, self._draw, self._steps, self._blur = tries, draw, steps, blur
        self._layout = layout
        self._half, self._middle = reach_task.action_range(get_arm(arm))
        self._largest = reach_task.step_sizes(get_arm(arm))
        self._rng = np.random.default_rng()
        self._infos: list[dict[str, Any]] = [{} for _ in range(env.num_envs)]
        self._over = np.ones(env.num_envs, dtype=np.bool_)

    def reset(self) -> VecEnvObs:
        if self._seeds[0] is not None:
            self._rng = np.random.default_rng(self._seeds[0])
            self._env.reset(seed=self._seeds[0])
        self._reset_seeds()
        return self._begin()

    def step_wait(self) -> VecEnvStepReturn:
        if self._steps == 1:
            _, rewards, _, _, info = self._env.step(self._actions)
        else:
            rewards, info = self._walk(self._half * np.clip(self._actions, -1, 1) + self._middle)
        seen = self._rewarded(rewards, {**info, **last_step(info)}).astype(np.float32)
        return self._begin(), seen, self._over, self._infos

    def _walk(self, postures: Array) -> tuple[Any, Any]:
        q = self._first[:, self._layout.q]
        for _ in range(self._steps):
            observations, rewards, _, _, info = self._env.step(paced(postures - q, self._largest))
            q = observations[:, self._layout.q]
        return rewards, info

    def _begin(self) -> Array:
        groups = self.num_envs // self._tries
        starts = self._draw(self._rng, groups)
        options = {name: np.repeat(rows, self._tries, axis=0) for name, rows in starts.items()}
        self._first = np.array(self._env.reset(options=options)[0])
        noise = self._rng.normal(0.0, self._blur, (groups, self._layout.goal.stop))
        self._first[:, self._layout.goal] += np.repeat(noise, self._tries, axis=0)
        return self._first


class Tries(NamedTuple):
    """Tried actions, from one update to the next; the first axis is n.

    Attributes:
        observations: Shape (n, m).
        actions: Before they are clipped to the action space, shape (n, k).
        log_probs: Logarithms of their densities, shape (n,).
        advantages: Shape (n,).
    """

    observations: torch.Tensor
    actions: torch.Tensor
    log_probs: torch.Tensor
    advantages: torch.Tensor


def sample_pairs(distribution: torch.distributions.Normal) -> torch.Tensor:
    """Draw one sample a row, shape (n, k), in antithetic pairs: rows 2i and 2i + 1 have opposite noise; n is even."""
    mean = distribution.mean
    noise = torch.randn(len(mean) // 2, mean.shape[1])
    return mean + distribution.stddev * torch.stack([noise, -noise], dim=1).flatten(0, 1)


# Ranks and loss


def normal_scores(rewards: Array) -> Array:
    """Normal scores of the ranks within each row, shape (n, k): mean 0, variance 1; equal rewards share a rank."""
    k = rewards.shape[1]
    left, right = rewards[:, :, None], rewards[:, None, :]
    doubled = 2 * (left > right).sum(axis=2) + (left == right).sum(axis=2) - 1  # twice the mean rank from 0
    scores = ndtri((np.arange(2 * k - 1) + 1) / (2 * k))
    return (scores / scores[::2].std())[doubled]


def clipped_loss(log_ratio: torch.Tensor, advantages: torch.Tensor, clip: float) -> torch.Tensor:
    """PPO's loss, from logarithms of the ratios ρ and advantages, both of shape (n,)."""
    ratio = log_ratio.exp()
    return -torch.min(advantages * ratio, advantages * ratio.clamp(1 - clip, 1 + clip)).mean()


# Schedules


@dataclass(frozen=True)
class Exploration:
    """Standard deviation of actions in a training: log-linear from `first` to `last`, held after its share `until`."""

    first: float
    last: float
    until: float

    def scaled(self, factor: float) -> Exploration:
        return replace(self, first=factor * self.first, last=factor * self.last)

    def at(self, progress: float) -> float:
        """Return the standard deviation when `progress`, in [0, 1], of the training is done."""
        share = min(progress / self.until, 1.0)
        return math.exp((1 - share) * math.log(self.first) + share * math.log(self.last))


def share_left(progress: float, decay: float) -> float:
    """Return the factor of a learning rate that falls to zero linearly over the last `decay` of a training."""
    return min(1.0, max(1.0 - progress, 0.0) / decay) if decay > 0 else 1.0


@dataclass(frozen=True)
class AdaptiveRate:
    """A learning rate that is adjusted after every update, within `lowest` and `highest`.

    It is divided by `factor` if the Kullback-Leibler divergence was over 1.5 times `target_kl`, and multiplied if it
    was under 2/3 of it; over the last `decay` of the training it falls to zero linearly.
    """

    first: float
    target_kl: float
    factor: float = 1.3
    lowest: float = 1e-6
    highest: float = 1e-2
    decay: float = 0.0

    def after(self, rate: float, divergence: float) -> float:
        if divergence > 1.5 * self.target_kl:
            rate /= self.factor
        elif divergence < self.target_kl / 1.5:
            rate *= self.factor
        return min(max(rate, self.lowest), self.highest)

    def share(self, progress: float) -> float:
        return share_left(progress, self.decay)


class ScheduledLearner(OnPolicyAlgorithm):
    """An algorithm of stable-baselines3 with a scheduled standard deviation and an adaptive learning rate.

    Without `exploration` the deviation is learned, or actions are discrete. `planned_steps` are those of the whole
    training, to which the schedules refer.

    Attributes:
        rate: The learning rate before the decay; checkpoints keep it.
    """

    def __init__(
        self, *args: Any, exploration: Exploration | None, adaptive: AdaptiveRate, planned_steps: int, **kwargs: Any
    ) -> None:
        self.exploration, self.adaptive, self.planned_steps = exploration, adaptive, planned_steps
        self.rate = adaptive.first
        super().__init__(*args, **{"learning_rate": adaptive.first, **kwargs})

    @property
    def progress(self) -> float:
        return min(self.num_timesteps / self.planned_steps, 1.0)

    def adapt(self, divergence: float) -> None:
        """Set the learning rate and the standard deviation of the next update, after one with this divergence."""
        self.rate = self.adaptive.after(self.rate, divergence)
        self._explore()

    def _setup_model(self) -> None:
        super()._setup_model()
        if self.exploration is not None:
            self.policy.log_std.requires_grad_(False)
            self._explore()

    def _update_learning_rate(self, optimizers: list[Optimizer] | Optimizer) -> None:
        rate = self.rate * self.adaptive.share(self.progress)
        for optimizer in optimizers if isinstance(optimizers, list) else [optimizers]:
            for group in optimizer.param_groups:
                group["lr"] = rate
        self.logger.record("train/learning_rate", rate)

    def _explore(self) -> None:
        if self.exploration is not None:
            with torch.no_grad():
                self.policy.log_std.fill_(math.log(self.exploration.at(self.progress)))


# Update


class RankedPPO(ScheduledLearner):
    """PPO with ranks among several tries instead of a critic; the environment must be a `TriesVecEnv` of as many.

    Args:
        policy, env: As of stable-baselines3.
        tries: K, the actions from each state; an even number.
        n_epochs, batch_size, clip_range, max_grad_norm: As of stable-baselines3's PPO.
        n_steps: States of each group of environments between two updates.
        gamma, gae_lambda: As of stable-baselines3's PPO; without effect, because an action is a whole episode.
        kwargs: `exploration`, `adaptive` and `planned_steps`, and others of stable-baselines3's `OnPolicyAlgorithm`.

    Raises:
        InputError: Tries are not even, or not all groups of environments have as many.
    """

    def __init__(
        self,
        policy: Any,
        env: TriesVecEnv,
        *,
        tries: int,
        n_epochs: int,
        batch_size: int,
        clip_range: float,
        max_grad_norm: float,
        n_steps: int = 1,
        gamma: float = 0.0,
        gae_lambda: float = 1.0,
        **kwargs: Any,
    ) -> None:
        if tries < 2 or tries % 2 or env.num_envs % tries:
            raise InputError(
                f"ranked PPO needs an even number of tries, and a multiple of it of environments, got {tries} tries in "
                f"{env.num_envs} environments"
            )
        self.tries, self.n_epochs, self.batch_size, self.clip_range = tries, n_epochs, batch_size, clip_range
        common: dict[str, Any] = {"gamma": gamma, "gae_lambda": gae_lambda, "max_grad_norm": max_grad_norm}
        unused: dict[str, Any] = {"ent_coef": 0.0, "vf_coef": 0.0, "use_sde": False, "sde_sample_freq": -1}
        super().__init__(policy, env, n_steps=n_steps, **common, **unused, **kwargs)

    def _setup_model(self) -> None:
        super()._setup_model()
        for part in self.policy.parameters():
            if part.requires_grad:  # zeros of the unused critic are in the sum of the norm: the order of rounding stays
                part.grad = torch.zeros_like(part)

    def collect_rollouts(self, env: Any, callback: BaseCallback, rollout_buffer: Any, n_rollout_steps: int) -> bool:
        """Try `tries` actions from each state, and rank them; return False if the callback ends the training."""
        low, high = self.action_space.low, self.action_space.high  # type: ignore[attr-defined]
        self.policy.set_training_mode(False)
        callback.on_rollout_start()
        collected = []
        for _ in range(n_rollout_steps):
            observations, actions, log_probs = self.sampled(self._last_obs)
            self._last_obs, rewards, _, _ = env.step(np.clip(actions.numpy(), low, high))
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            scores = normal_scores(rewards.reshape(-1, self.tries)).ravel()
            advantages = torch.as_tensor(scores, dtype=torch.float32)
            collected.append(Tries(observations, actions, log_probs, advantages))
        self._collected = Tries(*map(torch.cat, zip(*collected, strict=True)))
        callback.on_rollout_end()
        return True

    def sampled(self, observed: Any) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return observations as a tensor, actions that are tried, and logarithms of their densities."""
        observations = torch.tensor(observed, dtype=torch.float32)
        with torch.no_grad():
            distribution: Any = self.policy.get_distribution(observations)
            actions = sample_pairs(distribution.distribution)
            return observations, actions, distribution.log_prob(actions)

    def train(self) -> None:
        """Update the actor, several epochs long, with the tries since the last update."""
        tried, optimizer = self._collected, self.policy.optimizer
        self.policy.set_training_mode(True)
        self._update_learning_rate(optimizer)
        for _ in range(self.n_epochs):
            divergences = []
            order = np.random.permutation(len(tried.actions))
            for start in range(0, len(order), self.batch_size):
                batch = Tries(*(part[order[start : start + self.batch_size]] for part in tried))
                distribution = self.policy.get_distribution(batch.observations)
                log_ratio = distribution.log_prob(batch.actions) - batch.log_probs
                loss = clipped_loss(log_ratio, batch.advantages, self.clip_range)
                optimizer.zero_grad(set_to_none=False)
                loss.backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
                optimizer.step()
                with torch.no_grad():  # Schulman's estimate, http://joschu.net/blog/kl-approx.html
                    divergences.append((log_ratio.exp() - 1 - log_ratio).mean().numpy())
        self._n_updates += self.n_epochs
        divergence = float(np.mean(divergences))
        self.logger.record("train/loss", loss.item())
        self.logger.record("train/approx_kl", divergence)
        self.logger.record("train/std", self.policy.log_std.exp().mean().item())
        self.adapt(divergence)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_collected"]
