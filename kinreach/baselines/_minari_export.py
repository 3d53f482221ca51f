"""The episodes of an evaluation as a Minari dataset, for libraries that learn from recorded behaviour."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

import kinreach
from kinreach._checks import check_step_limit
from kinreach._engines import load_extra
from kinreach.baselines._evaluation import Evaluation
from kinreach.baselines._loop import rollout
from kinreach.baselines._policies import LearnedPolicy
from kinreach.envs.inside import in_doubles
from kinreach.errors import InputError


def check_dataset(name: str) -> None:
    """Refuse the name of a new dataset if it is malformed or taken, or if Minari or h5py is missing."""
    minari: Any = load_extra("minari", "minari")
    load_extra("h5py", "minari")
    try:
        load_extra("minari.dataset.minari_dataset", "minari").parse_dataset_id(name)
    except ValueError as error:
        raise InputError(f"--minari: {error}") from None
    if name in minari.list_local_datasets():
        raise InputError(f"--minari: there is a dataset {name} already; take another version, or minari.delete_dataset")


def record_episodes(
    name: str,
    policy: LearnedPolicy,
    *,
    goals: int,
    seed: int,
    environment: str,
    options: Mapping[str, Any],
    progress: Callable[[int], None] = lambda done: None,
) -> Evaluation:
    """Evaluate as `kinreach.baselines._evaluation.evaluate` does, and write the episodes as a Minari dataset.

    Its name was checked by `check_dataset`. It has the policy's card in its description, and every episode its seed.
    Actions are in double precision, as they were executed, even where the environment's space is of single precision.
    """
    check_step_limit(options)
    try:
        env = gym.make(environment, **{**in_doubles(environment), **policy.needed_options, **options})
    except (gym.error.Error, TypeError) as error:
        raise InputError(f"cannot make the environment {environment}: {error}") from error
    minari: Any = load_extra("minari", "minari")
    recorder = _MinariRecorder(env)
    trials = []
    try:
        for trial in rollout(recorder, policy, ({"seed": seed + index} for index in range(goals))):
            trials.append(trial)
            progress(len(trials))
        with warnings.catch_warnings():  # of a missing author and link to code
            warnings.simplefilter("ignore")
            minari.create_dataset_from_buffers(
                name,
                [
                    minari.data_collector.EpisodeBuffer(id=number, **episode)
                    for number, episode in enumerate(recorder.episodes)
                ],
                env=env,
                action_space=_in_double_precision(env.action_space),
                algorithm_name=policy.card.algorithm,
                description=json.dumps(asdict(policy.card), allow_nan=False, sort_keys=True),
                data_format="hdf5",
                requirements=[f"kinreach=={kinreach.__version__}"],
            )
    finally:
        env.close()
    return Evaluation(trials)


class _MinariRecorder(gym.Wrapper[Any, Any, Any, Any]):
    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.episodes: list[dict[str, Any]] = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        lists: dict[str, Any] = {name: [] for name in ("actions", "rewards", "terminations", "truncations")}
        self.episodes.append({"seed": seed, "observations": [observation], **lists})
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        row = (observation, action, float(reward), terminated, truncated)
        for name, value in zip(("observations", "actions", "rewards", "terminations", "truncations"), row, strict=True):
            self.episodes[-1][name].append(value)
        return observation, reward, terminated, truncated, info


def _in_double_precision(space: spaces.Space[Any]) -> spaces.Space[Any]:
    if not isinstance(space, spaces.Box):
        return space
    return spaces.Box(space.low.astype(np.float64), space.high.astype(np.float64), dtype=np.float64)
