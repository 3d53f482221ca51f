"""Imitation of an expert by its answers in the states that the learner itself comes to (DAgger).

Ross, Gordon and Bagnell 2011, "A reduction of imitation learning and structured prediction to no-regret online
learning" (AISTATS), algorithm 3.1: all answers so far are fitted after every round of acting. Here learner and expert
take turns within an episode, so that the learner is also led out of states in which it stands still. The loss is the
absolute error, whose minimum is one of the expert's answers where it has several in like states, not their mean.
"""

from __future__ import annotations

from typing import Any, Protocol

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import ArrayLike
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from kinreach._objects import place_of
from kinreach.baselines._adaptive_ppo import AdaptivePPO
from kinreach.baselines._averaged import AveragedActor
from kinreach.baselines._rewards import TrainingReward
from kinreach.baselines._vec_envs import SB3VecEnv, check_finite
from kinreach.errors import TrainingError

Array = np.ndarray[Any, Any]

#: Mean number of steps that learner or expert acts before it is drawn again who does.
TURN = 15
#: Largest share of the learner's turns, and the part of a training in which it grows from none.
MAX_SHARE, GROWTH = 0.5, 0.5


class Expert(Protocol):
    """What is imitated. Nobody tells it when an episode begins, so that most have no memory."""

    def act(self, observation: ArrayLike) -> Any:
        """Return the actions for rows of observations, shape (n, m); row k is always of environment k."""
        ...


class AnsweredVecEnv(SB3VecEnv):
    """A batch in which an expert answers every observation, and acts in the learner's place now and then.

    Args:
        env, reward: As of `SB3VecEnv`.
        expert: Answers what all environments observe, in every step.
        expert_env: What the expert was made of, if that is to be closed with the batch.

    Attributes:
        share: Of the learner's turns, from 0 to 1.

    Raises:
        TrainingError: In a step: the expert fails, or answers in another shape than (n, m), or not finitely.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        *,
        expert: Expert,
        reward: TrainingReward,
        expert_env: gym.Env[Any, Any] | None = None,
    ) -> None:
        super().__init__(env, reward=reward)
        self._expert_env = expert_env
        self._expert, self._rng = expert, np.random.default_rng()
        self._learner = np.zeros(env.num_envs, dtype=np.bool_)
        self.share, self._answered = 0.0, list[Array]()

    def reset(self) -> VecEnvObs:
        """Start all episodes, with the expert's turn."""
        self._rng = np.random.default_rng(self._seeds[0])
        self._learner[:] = False
        self._now: Any = super().reset()
        self._answered = []
        return np.array(self._now)

    def step_async(self, actions: Array) -> None:
        """Ask the expert, and keep the actions of those whose turn it is."""
        answers = self._answers()
        self._answered.append(np.hstack([self._now, answers]))
        again, learner = self._rng.random((2, self.num_envs))
        self._learner = np.where(again < 1.0 / TURN, learner < self.share, self._learner)
        super().step_async(np.where(self._learner[:, None], actions, answers))

    def _shown(self) -> Array:
        """Return what the expert sees now."""
        return self._now

    def _answers(self) -> Array:
        """Return the expert's actions for what it sees now."""
        space: Any = self.action_space
        expert, shape = f"the expert {type(self._expert).__name__}", (self.num_envs, *space.shape)
        try:
            given = np.asarray(self._expert.act(self._shown()), dtype=np.float64)
        except Exception as error:  # of the user's class
            raise TrainingError(f"{expert} failed: {type(error).__name__}: {error}{place_of(error)}") from error
        if given.shape != shape:
            raise TrainingError(f"the answers of {expert} must have shape {shape}, got {given.shape}")
        check_finite(f"an answer of {expert}", given)
        return np.clip(given, space.low, space.high).astype(space.dtype)

    def step_wait(self) -> VecEnvStepReturn:
        """Step, as any batch."""
        self._now, *rest = super().step_wait()
        return np.array(self._now), *rest  # type: ignore[return-value]

    def close(self) -> None:
        """Close the batch, and the environment of the expert."""
        super().close()
        if self._expert_env is not None:
            self._expert_env.close()

    def answered(self) -> Array:
        """Return the observations since this was asked last, each with the expert's action behind it; shape (n, m)."""
        rows, self._answered = np.concatenate(self._answered), []
        return rows


class Imitation(AveragedActor, AdaptivePPO):
    """Fit the actor to the expert's answers since the training began; rewards are not used.

    The environments are an `AnsweredVecEnv`.

    Args:
        memory: Number of answers that are kept, the last ones; those of a round of acting or more.
        updates: Steps of the optimiser after a round of acting, with `batch_size` answers each.
    """

    def __init__(self, *args: Any, memory: int, updates: int, **kwargs: Any) -> None:
        self.memory, self.updates = memory, updates
        super().__init__(*args, **kwargs)

    def _setup_model(self) -> None:
        super()._setup_model()
        spaces: Any = self.observation_space, self.action_space
        self.inputs, outputs = (space.shape[0] for space in spaces)
        self.answered = torch.zeros(self.memory, self.inputs + outputs)

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        modules, variables = super()._get_torch_save_params()
        return modules, [*variables, "answered"]

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> bool:
        """Act, with the learner's share of this part of the training."""
        env: Any = self.env
        env.share = MAX_SHARE * min(self.progress / GROWTH, 1.0)
        return super().collect_rollouts(*args, **kwargs)

    def train(self) -> None:
        """Keep the last round's answers, and fit the actor to all that are kept."""
        env: Any = self.env
        optimizer, policy = self.policy.optimizer, self.policy
        self._update_learning_rate(optimizer)
        new = env.answered()
        places = np.arange(self.num_timesteps - len(new), self.num_timesteps) % self.memory
        self.answered[places] = torch.as_tensor(new, dtype=torch.float32)
        losses = 0.0
        for _ in range(self.updates):
            rows = self.answered[torch.randint(min(self.num_timesteps, self.memory), (self.batch_size,))]
            distribution: Any = policy.get_distribution(rows[:, : self.inputs])
            loss = (distribution.distribution.mean - rows[:, self.inputs :]).abs().mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            self._n_updates += 1
            self._average()
            losses += loss.item() / self.updates
        self.logger.record("train/loss", losses)
        self._explore()
