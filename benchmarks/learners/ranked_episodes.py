"""Ranked PPO whose tries are whole episodes: several arms meet the same ball, and each of their actions gets the rank.

A group of environments plays one episode with the same ball and the same sights. Episodes are ranked by the least
distance of tip and ball. What an arm did until it was nearest is rewarded with the normal score of its rank; what it
did afterwards is not learned from. There is no critic, as in `RankedPPO`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs

from benchmarks.learners.variants import ppo_moving_steered_late
from kinreach._checks import Floats
from kinreach.baselines import Algorithm, Recipe, SB3VecEnv, register_algorithm, register_recipe
from kinreach.baselines._algorithms import ranked_arguments
from kinreach.baselines._ranked_ppo import RankedPPO, Tries, normal_scores


def nearness(rewards: Floats, info: Mapping[str, Any]) -> Floats:
    """A training reward: minus the least distance of tip and ball in the episode so far [m]."""
    return -np.asarray(info["distance"])


class SameBalls(SB3VecEnv):
    """A batch whose resets give the same ball to all environments of a group.

    Args:
        tries: Size of a group.
        kwargs: Of `SB3VecEnv`.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], *, tries: int, **kwargs: Any) -> None:
        super().__init__(env, **kwargs)
        self._tries, self._rng = tries, np.random.default_rng()

    def reset(self) -> VecEnvObs:
        """Start all episodes anew, with balls from the seed that was set last."""
        if self._seeds[0] is not None:
            self._rng = np.random.default_rng(self._seeds[0])
        self._seeds = np.repeat(self._rng.integers(2**31, size=self.num_envs // self._tries), self._tries).tolist()
        return super().reset()


class RankedEpisodes(RankedPPO):
    """Ranked PPO with an episode of up to `n_steps` actions as a try; the environments must be `SameBalls`."""

    def collect_rollouts(self, env: Any, callback: BaseCallback, rollout_buffer: Any, n_rollout_steps: int) -> bool:
        """Play an episode in each environment, and rank it in its group; return False if the callback ends it."""
        low, high = self.action_space.low, self.action_space.high  # type: ignore[attr-defined]
        self.policy.set_training_mode(False)
        callback.on_rollout_start()
        observed, playing, played, nearest = env.reset(), np.ones(env.num_envs, dtype=np.bool_), [], []
        for _ in range(n_rollout_steps):
            tried = self.sampled(observed)
            observed, rewards, over, _ = env.step(np.clip(tried[1].numpy(), low, high))
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            played.append(tried)
            nearest.append(np.where(playing, -rewards, np.inf))
            playing &= ~over
        self._last_obs = observed
        scores = normal_scores(-np.min(nearest, axis=0).reshape(-1, self.tries)).ravel()
        frames = np.arange(n_rollout_steps)[:, None]
        until = torch.from_numpy((frames <= np.argmin(nearest, axis=0)).ravel())
        advantages = torch.as_tensor(np.tile(scores, n_rollout_steps), dtype=torch.float32)
        parts = (*map(torch.cat, zip(*played, strict=True)), advantages)
        self._collected = Tries(*(part[until] for part in parts))
        callback.on_rollout_end()
        return True


def _same_balls(batch: VectorEnv[Any, Any, Any], recipe: Recipe, reward: Any) -> SameBalls:
    return SameBalls(batch, tries=recipe.settings["tries"], reward=reward)


register_algorithm(Algorithm("RankedEpisodes", RankedEpisodes, arguments=ranked_arguments, vec_env=_same_balls))
_STEERED = ppo_moving_steered_late
ranked_moving_late = register_recipe(
    replace(
        _STEERED,
        name="ranked-moving-late",
        summary="Ranked PPO with the observations and actions of gradient-moving-late: the same ball for eight arms.",
        algorithm="RankedEpisodes",
        reward="benchmarks.learners.ranked_episodes:nearness",
        steps=3_000_000,
        num_envs=256,
        settings={
            "tries": 8,
            "n_steps": 60,
            "n_epochs": 3,
            "batch_size": 2048,
            "clip_range": 0.2,
            "max_grad_norm": 0.5,
            "exploration": _STEERED.settings["exploration"],
            "adaptive": {"first": 1e-3, "target_kl": 0.02, "decay": 0.2},
            "low": _STEERED.settings["low"],
            "high": _STEERED.settings["high"],
        },
        window=153_600,
    )
)
ranked_moving_tuned_late = register_recipe(
    replace(
        ranked_moving_late,
        name="ranked-moving-tuned-late",
        summary="As ranked-moving-late, to begin with a policy of gradient-moving-late.",
        steps=1_000_000,
    )
)
