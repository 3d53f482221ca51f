"""Batches of environments for stable-baselines3."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from kinreach._objects import place_of
from kinreach.baselines._batch import last_step
from kinreach.baselines._looks import Looks
from kinreach.baselines._policies import paced
from kinreach.baselines._rewards import TrainingReward, own
from kinreach.envs.inside import UR5_LAYOUT, Layout, action_range
from kinreach.errors import InputError, TrainingError
from kinreach.robots import THESIS_ARM, ArmDescription, get_arm

Array = np.ndarray[Any, Any]

#: Entries of an environment's `info` for stable-baselines3's loggers.
INFO_KEYS = ("is_success", "distance", "posture_error", "impossible", "wrong_presses", "energy")


class SB3VecEnv(VecEnv):
    """Adapter from a Gymnasium vector environment that resets in the same step.

    Args:
        env: For example `gym.make_vec("kinreach/UR5SingleStep-v0", num_envs=1024,
            vectorization_mode="vector_entry_point")`.
        reward: Of the learner, instead of the environment's.
        bootstrap: Whether truncated episodes are truncated for the learner, or terminated.

    Raises:
        InputError: The environment does not reset in the same step.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], *, reward: TrainingReward = own, bootstrap: bool = True) -> None:
        if env.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise InputError("stable-baselines3 needs a vector environment with AutoresetMode.SAME_STEP")
        self._env = env  # the base class asks for its attributes
        self._reward, self._bootstrap = reward, bootstrap
        self._actions: Any = None
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def seen(self, observations: Array) -> Any:
        """Return the environment's own observations in double precision."""
        return observations.astype(np.float64)

    def reset(self) -> VecEnvObs:
        """Start all episodes, with the seeds that were set last."""
        seeds = self._seeds if any(seed is not None for seed in self._seeds) else None
        observations, _ = self._env.reset(seed=seeds)  # type: ignore[arg-type]
        self._reset_seeds()
        return np.asarray(observations)

    def step_async(self, actions: np.ndarray[Any, Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step; the `info` of an ended episode has its last observation."""
        observations, rewards, terminated, truncated, info = self._env.step(self._actions)
        done = terminated | truncated
        last_seen = np.array(observations)
        if done.any():
            last_seen[done] = np.stack(list(info["final_obs"][done]))
        rewards = self._rewarded(rewards, {**info, **last_step(info), "observation": last_seen})
        _check_finite("an observation", last_seen)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if done.any():
            last = info["final_info"]
            columns = {key: last[key].tolist() for key in INFO_KEYS if key in last}
            cut = (truncated & ~terminated & self._bootstrap).tolist()
            for index in np.flatnonzero(done).tolist():
                infos[index] = {key: values[index] for key, values in columns.items()}
                infos[index]["terminal_observation"] = info["final_obs"][index]
                infos[index]["TimeLimit.truncated"] = cut[index]
        return np.asarray(observations), np.asarray(rewards, dtype=np.float32), done, infos

    def _rewarded(self, rewards: Any, info: Mapping[str, Any]) -> Array:
        given = np.asarray(rewards)
        _check_finite("the environment's reward", given)
        try:
            seen = np.asarray(self._reward(given, info))
        except Exception as error:  # of the user's function
            raise TrainingError(
                f"the training reward failed: {type(error).__name__}: {error}{place_of(error)}"
            ) from error
        if seen.shape != given.shape:
            raise TrainingError(f"the training reward must have shape {given.shape}, got {seen.shape}")
        _check_finite("the training reward", seen)
        return seen

    def close(self) -> None:
        """Close the batch of environments beneath."""
        self._env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the batch, once for each environment."""
        return [getattr(self._env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Raise an `InputError`: environments of a batch share their attributes."""
        raise InputError(f"environments of a native batch share their attributes; {attr_name} cannot be set for some")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Raise an `InputError`: environments of a batch have no methods."""
        raise InputError(f"environments of a native batch have no methods of their own, such as {method_name}")

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each environment."""
        return [False] * len(list(self._get_indices(indices)))


def _check_finite(what: str, values: Array) -> None:
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise TrainingError(f"{what} became {values[~np.isfinite(values)][0]:g}")


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
        layout: Layout = UR5_LAYOUT,
        arm: str | ArmDescription = THESIS_ARM,
    ) -> None:
        super().__init__(env, reward=reward)
        self._tries, self._draw, self._steps, self._blur = tries, draw, steps, blur
        self._layout = layout
        self._half, self._middle = action_range(get_arm(arm))
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
            observations, rewards, _, _, info = self._env.step(paced(postures - q))
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


class LooksVecEnv(TriesVecEnv):
    """The same for pictures: an observation is the number of a look at a group's goal.

    Looks are taken when the environments are seeded.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], *, looks: Looks, **kwargs: Any) -> None:
        super().__init__(env, **kwargs)
        self.looks = looks
        self.observation_space = spaces.Box(0.0, float(len(looks.pictures) - 1), (1,))
        self._goals = np.zeros((len(looks.pictures), 3))

    def seen(self, observations: Array) -> Any:
        return self.looks.seen(observations[:, 0].astype(int))

    def reset(self) -> VecEnvObs:
        if self._seeds[0] is not None:
            rng = np.random.default_rng([self._seeds[0], 1])
            self._goals = np.array(self._draw(rng, len(self._goals))["goal"])
            self.looks.take(self._goals, rng)
        return super().reset()

    def _begin(self) -> Array:
        groups = self._rng.integers(len(self._goals), size=self.num_envs // self._tries)
        numbers = np.repeat(groups, self._tries)
        self._env.reset(options={"goal": self._goals[numbers]})
        return numbers[:, None].astype(np.float32)
