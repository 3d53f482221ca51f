"""Environments in groups that stand in the same state, so that several actions can be tried from it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from kinreach.baselines.pacing import paced
from kinreach.baselines.sb3_vec_env import SB3VecEnv
from kinreach.baselines.training_reward import TrainingReward
from kinreach.envs.reach.task import SINGLE_STEP

Array = np.ndarray[Any, Any]


class TriesVecEnv(SB3VecEnv):
    """A batch of reach environments in groups of `tries` that have the same goal; a step is a whole episode.

    The action is a posture. It is taken in one step, or, where the environment takes `steps` of a few degrees, walked
    to; the reward is that of where the arm then is.

    Args:
        env: The batch; its reset takes the option `goal`.
        tries: Size of a group.
        draw: Draws goals [m], shape (n, 3), from a generator.
        steps: Of an episode; 1 where actions are postures.
        reward: What the learner sees.
        blur: Standard deviation of noise on the six numbers that say where the goal is [m]: without, a network is free
            in how it answers two cameras that do not quite agree, as real ones do.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        *,
        tries: int,
        draw: Callable[[np.random.Generator, int], Array],
        steps: int,
        reward: TrainingReward,
        blur: float,
    ) -> None:
        super().__init__(env, reward=reward)
        self._tries, self._draw, self._steps, self._blur = tries, draw, steps, blur
        self._rng = np.random.default_rng()
        self._infos: list[dict[str, Any]] = [{} for _ in range(env.num_envs)]
        self._over = np.ones(env.num_envs, dtype=np.bool_)

    def reset(self) -> VecEnvObs:
        """Start all episodes."""
        if self._seeds[0] is not None:
            self._rng = np.random.default_rng(self._seeds[0])
            self._env.reset(seed=self._seeds[0])
        self._reset_seeds()
        return self._begin()

    def step_wait(self) -> VecEnvStepReturn:
        """Play an episode towards the postures."""
        if self._steps == 1:
            _, rewards, _, _, info = self._env.step(self._actions)
        else:
            rewards, info = self._walk(SINGLE_STEP.scale * np.clip(self._actions, -1, 1))
        seen = self._reward(np.asarray(rewards), info).astype(np.float32)
        return self._begin(), seen, self._over, self._infos

    def _walk(self, postures: Array) -> tuple[Any, Any]:
        q = self._first[:, 6:12]
        for _ in range(self._steps):
            observations, rewards, _, _, info = self._env.step(paced(postures - q))
            q = observations[:, 6:12]
        return rewards, info

    def _begin(self) -> Array:
        groups = self.num_envs // self._tries
        goals = self._draw(self._rng, groups)
        self._first = np.array(self._env.reset(options={"goal": np.repeat(goals, self._tries, axis=0)})[0])
        self._first[:, :6] += np.repeat(self._rng.normal(0.0, self._blur, (groups, 6)), self._tries, axis=0)
        return self._first
