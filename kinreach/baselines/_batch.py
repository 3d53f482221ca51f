"""Batches of environments: native ones if registered, else Gymnasium's own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from kinreach._checks import check_step_limit
from kinreach.envs.inside import in_doubles, spec_of
from kinreach.errors import InputError

#: Number of observations that scale a network's inputs, and of environments that they come from without native batch.
SAMPLE, _SAMPLE_ENVS = 2048, 16


def make_batch(environment: str, num_envs: int, options: Mapping[str, Any]) -> VectorEnv[Any, Any, Any]:
    """Make a batch of environments that reset in the step in which they end; `module:id` imports the module.

    They observe in double precision, unless the options say otherwise.
    """
    batch = _native(environment, num_envs, options)
    if batch is None:
        same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
        batch = _make(environment, num_envs, options, vectorization_mode="sync", vector_kwargs=same_step)
    return batch


def first_observations(environment: str, options: Mapping[str, Any], *, seed: int) -> np.ndarray[Any, Any]:
    """Return the observations at the beginning of `SAMPLE` episodes, shape (SAMPLE, n)."""
    batch = _native(environment, SAMPLE, options) or make_batch(environment, _SAMPLE_ENVS, options)
    try:
        return np.concatenate([batch.reset(seed=None if i else seed)[0] for i in range(SAMPLE // batch.num_envs)])
    finally:
        batch.close()


def _native(environment: str, num_envs: int, options: Mapping[str, Any]) -> VectorEnv[Any, Any, Any] | None:
    try:
        if spec_of(environment).vector_entry_point is None:
            return None
    except gym.error.Error as error:
        raise InputError(f"cannot make the environment {environment}: {error}") from error
    batch = _make(environment, num_envs, options, vectorization_mode="vector_entry_point")
    if batch.metadata.get("autoreset_mode") is AutoresetMode.SAME_STEP:
        return batch
    batch.close()
    return None


def _make(environment: str, num_envs: int, options: Mapping[str, Any], **how: Any) -> VectorEnv[Any, Any, Any]:
    check_step_limit(options)
    try:
        return gym.make_vec(environment, num_envs, **how, **{**in_doubles(environment), **options})
    except (gym.error.Error, TypeError) as error:
        raise InputError(f"cannot make the environment {environment}: {error}") from error


def last_value(info: Mapping[str, Any], name: str) -> Any:
    """Return an entry of each environment's last step, shape (n,); None if `info` lacks it.

    After a reset in the same step, `final_info` has the step's values of the environments that were reset.
    """
    final = info.get("final_info", {})
    if name not in final:
        return info.get(name)
    return _of_ended(info["_final_info"], final[name], info.get(name))


def last_step(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the `info` of each environment's last step, without masks."""
    names = dict.fromkeys([*info, *info.get("final_info", ())])
    return {name: last_value(info, name) for name in names if not name.startswith(("_", "final_"))}


def _of_ended(ended: Any, final: Any, other: Any) -> Any:
    """Choose entries of one value where episodes ended, else of another; of the first if there is no other."""
    if isinstance(final, Mapping):
        others = other or {}
        return {name: _of_ended(ended, part, others.get(name)) for name, part in final.items()}
    if other is None or ended.all():
        return final
    return np.where(ended.reshape(-1, *(1,) * (np.ndim(final) - 1)), final, other)
