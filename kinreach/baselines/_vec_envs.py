"""A native batch of environments as stable-baselines3 takes it."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from kinreach._objects import place_of
from kinreach.baselines._batch import last_step
from kinreach.baselines._rewards import TrainingReward, own
from kinreach.envs.inside import NativeVectorEnv
from kinreach.errors import InputError, TrainingError

Array = np.ndarray[Any, Any]

#: Entries of an environment's `info` for stable-baselines3's loggers.
INFO_KEYS = ("is_success", "distance", "posture_error", "impossible", "wrong_presses", "energy")
#: Methods of goal environments, which `HerReplayBuffer` calls, and what they read in every step's `info`.
GOAL_METHODS = ("compute_reward", "compute_terminated", "compute_truncated")
GOAL_KEYS = ("impossible", "impossible_code", "q", "status", "attempts", "distance", "held", "clearance")


class SB3VecEnv(VecEnv):
    """Adapter from a Gymnasium vector environment that resets in the same step.

    Args:
        env: For example `gym.make_vec("kinreach/UR5SingleStep-v0", num_envs=1024,
            vectorization_mode="vector_entry_point")`.
        reward: Of the learner, instead of the environment's.
        bootstrap: Whether truncated episodes are truncated for the learner, or terminated.

    Raises:
        InputError: The environment does not reset in the same step, or gives tensors.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], *, reward: TrainingReward = own, bootstrap: bool = True) -> None:
        if env.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise InputError("stable-baselines3 needs a vector environment with AutoresetMode.SAME_STEP")
        native = env.unwrapped
        if isinstance(native, NativeVectorEnv) and native.device is not None:
            raise InputError(
                f"learners take arrays, not tensors: leave out the option device, got {str(native.device)!r}; "
                "CUDA_VISIBLE_DEVICES chooses the GPU of MuJoCo Warp"
            )
        self._env = env  # the base class asks for its attributes
        self._reward, self._bootstrap = reward, bootstrap
        self._actions: Any = None
        self._has_goals = "desired_goal" in getattr(env.single_observation_space, "spaces", ())
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def seen(self, observations: Array) -> Any:
        """Return the environment's own observations in double precision."""
        return observations.astype(np.float64)

    def reset(self) -> VecEnvObs:
        """Start all episodes, with the seeds that were set last."""
        seeds = self._seeds if any(seed is not None for seed in self._seeds) else None
        observations, _ = self._env.reset(seed=seeds)  # type: ignore[arg-type]
        self._reset_seeds()
        return _as_arrays(observations)

    def step_async(self, actions: np.ndarray[Any, Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step; the `info` of an ended episode has its last observation."""
        observations, rewards, terminated, truncated, info = self._env.step(self._actions)
        done = terminated | truncated
        last_seen = copy.deepcopy(_as_arrays(observations))
        if done.any():
            final = [_row(info["final_obs"], index) for index in np.flatnonzero(done)]
            if isinstance(last_seen, dict):
                for name, rows in last_seen.items():
                    rows[done] = np.stack([row[name] for row in final])
            else:
                last_seen[done] = np.stack(final)
        told = last_step(info)
        rewards = self._rewarded(rewards, {**info, **told, "observation": last_seen})
        for rows in last_seen.values() if isinstance(last_seen, dict) else [last_seen]:
            check_finite("an observation", rows)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if self._has_goals:
            kept = {name: told[name] for name in GOAL_KEYS if name in told}
            infos = [{name: rows[index] for name, rows in kept.items()} for index in range(self.num_envs)]
        if done.any():
            last = info["final_info"]
            columns = {key: last[key].tolist() for key in INFO_KEYS if key in last}
            cut = (truncated & ~terminated & self._bootstrap).tolist()
            for index in np.flatnonzero(done).tolist():
                infos[index] |= {key: values[index] for key, values in columns.items()}
                infos[index]["terminal_observation"] = _row(info["final_obs"], index)
                infos[index]["TimeLimit.truncated"] = cut[index]
        return _as_arrays(observations), np.asarray(rewards, dtype=np.float32), done, infos

    def _rewarded(self, rewards: Any, info: Mapping[str, Any]) -> Array:
        given = np.asarray(rewards)
        check_finite("the environment's reward", given)
        try:
            seen = np.asarray(self._reward(given, info))
        except Exception as error:  # of the user's function
            raise TrainingError(
                f"the training reward failed: {type(error).__name__}: {error}{place_of(error)}"
            ) from error
        if seen.shape != given.shape:
            raise TrainingError(f"the training reward must have shape {given.shape}, got {seen.shape}")
        check_finite("the training reward", seen)
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
        """Return what a method of a goal environment says, once for each; there are no others.

        Raises:
            InputError: Another method.
        """
        if self._has_goals and method_name in GOAL_METHODS:
            said = getattr(self._env.unwrapped, method_name)(*method_args, **method_kwargs)
            return [said] * len(list(self._get_indices(indices)))
        raise InputError(f"environments of a native batch have no methods of their own, such as {method_name}")

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each environment."""
        return [False] * len(list(self._get_indices(indices)))


def _as_arrays(observations: Any) -> Any:
    """Return observations as an array, or as a dictionary of them."""
    if isinstance(observations, Mapping):
        return {name: np.asarray(rows) for name, rows in observations.items()}
    return np.asarray(observations)


def _row(observations: Any, index: int) -> Any:
    """Return the observation of one environment."""
    if isinstance(observations, Mapping):
        return {name: rows[index] for name, rows in observations.items()}
    return observations[index]


def check_finite(what: str, values: Array) -> None:
    """Raise a `TrainingError` that names the first number that is not finite."""
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise TrainingError(f"{what} became {values[~np.isfinite(values)][0]:g}")
