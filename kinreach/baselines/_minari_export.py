"""Played episodes as a Minari dataset, for libraries that learn from recorded behaviour."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

import kinreach
from kinreach._checks import check_step_limit
from kinreach._engines import load_extra
from kinreach._statistics import Trial
from kinreach.baselines._evaluation import Evaluation
from kinreach.baselines._loop import Policy, rollout
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
    except TypeError:
        raise InputError(
            f"--minari: the name of a dataset ends in its version, such as {name}-v0, got {name}"
        ) from None
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

    Its name was checked by `check_dataset`. It has the policy's card in its description.
    """
    check_step_limit(options)
    try:
        env = gym.make(environment, **{**in_doubles(environment), **policy.needed_options, **options})
    except (gym.error.Error, TypeError) as error:
        raise InputError(f"cannot make the environment {environment}: {error}") from error
    resets = ({"seed": seed + index} for index in range(goals))
    try:
        about = asdict(policy.card)
        trials = write_dataset(
            name, env, policy, resets, algorithm=policy.card.algorithm, about=about, progress=progress
        )
    finally:
        env.close()
    return Evaluation(trials)


def write_dataset(
    name: str,
    env: gym.Env[Any, Any],
    policy: Policy,
    resets: Iterable[Mapping[str, Any]],
    *,
    algorithm: str,
    about: Mapping[str, Any],
    progress: Callable[[int], None],
) -> list[Trial]:
    """Play episodes, write them as a Minari dataset with every `info`, and return their trials.

    Every episode has the seed and the options of its reset. One in which the policy finds no action is left out of the
    dataset. Actions are in double precision, as they were executed, even where the environment's space is of single
    precision.

    Args:
        name: Of the dataset, as `check_dataset` checked it.
        env: Its environment.
        policy: Acts.
        resets: Keyword arguments of `env.reset`, one mapping an episode.
        algorithm: In the dataset's metadata.
        about: Its description, as JSON types.
        progress: Called with the number of finished episodes.

    Raises:
        InputError: No episode has an action for every step.
    """
    minari: Any = load_extra("minari", "minari")
    recorder, trials, episodes = _MinariRecorder(env), [], []
    for trial in rollout(recorder, policy, resets):
        trials.append(trial)
        if recorder.over:
            episodes.append(recorder.episode)
        progress(len(trials))
    if not episodes:
        raise InputError(f"none of {len(trials)} episodes can be recorded: no action was found ({trials[0]['status']})")
    with warnings.catch_warnings():  # of a missing author and link to code
        warnings.simplefilter("ignore")
        minari.create_dataset_from_buffers(
            name,
            [minari.data_collector.EpisodeBuffer(id=number, **episode) for number, episode in enumerate(episodes)],
            env=env,
            action_space=_in_double_precision(env.action_space),
            algorithm_name=algorithm,
            description=json.dumps(about, allow_nan=False, sort_keys=True),
            data_format="hdf5",
            requirements=[f"kinreach=={kinreach.__version__}"],
        )
    return trials


class _MinariRecorder(gym.Wrapper[Any, Any, Any, Any]):
    """Keeps the episode that is played.

    Attributes:
        episode: Fields of an `EpisodeBuffer`.
        over: Whether it has ended by its own steps.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.episode: dict[str, Any] = {}
        self.over = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        lists: dict[str, Any] = {name: [] for name in ("actions", "rewards", "terminations", "truncations")}
        start = {"observations": _appended(None, observation), "infos": _appended(None, info)}
        self.episode, self.over = {"seed": seed, "options": options, **start, **lists}, False
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        row = (observation, info, action, float(reward), terminated, truncated)
        names = ("observations", "infos", "actions", "rewards", "terminations", "truncations")
        for name, value in zip(names, row, strict=True):
            self.episode[name] = _appended(self.episode[name], value)
        self.over = terminated or truncated
        return observation, reward, terminated, truncated, info


def _appended(rows: Any, value: Any) -> Any:
    """Append a value to a list of rows, or its entries to a mapping of such lists; without rows, begin them."""
    if isinstance(value, Mapping):
        return {name: _appended(None if rows is None else rows[name], entry) for name, entry in value.items()}
    rows = [] if rows is None else rows
    rows.append(value)
    return rows


def _in_double_precision(space: spaces.Space[Any]) -> spaces.Space[Any]:
    if not isinstance(space, spaces.Box):
        return space
    return spaces.Box(space.low.astype(np.float64), space.high.astype(np.float64), dtype=np.float64)
