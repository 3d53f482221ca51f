"""Every method in an episode for every goal, one episode at a time.

For each goal the methods play in another random order, so that load from other programs meets all alike. An episode
depends on its seed alone: not on the others, and not on whether they were played.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinreach.baselines.evaluation import HELD_OUT
from kinreach.baselines.rollout import Policy
from kinreach.checks import Floats
from kinreach.compare.button.players import Player
from kinreach.compare.tasks import ButtonTask
from kinreach.compare.trials import EpisodeTrial
from kinreach.envs.button import ButtonPressEnv

#: Seed of an episode that every method plays untimed first; never among those compared.
WARM_UP_SEED = HELD_OUT - 1

#: `EpisodeTrial.status`.
PRESSED, NOT_PRESSED, DIVERGED = "pressed", "not pressed", "diverged"


@dataclass(frozen=True, eq=False)
class Episode:
    """What came of an episode.

    Attributes:
        reward: Sum of all rewards.
        solve_s: Wall time of all decisions [s].
        q: Joint angles at the end [rad], shape (3,).
        info: The environment's last one.
    """

    reward: float
    solve_s: float
    q: Floats
    info: Mapping[str, Any]


def play(env: ButtonPressEnv, policy: Policy, seed: int) -> Episode:
    """Play an episode from its start to its end.

    Args:
        env: The environment.
        policy: Acts.
        seed: Of the environment.
    """
    observation, info = env.reset(seed=seed)
    policy.reset(info)
    reward, solve_s, over = 0.0, 0.0, False
    while not over:
        start = time.perf_counter()
        action = policy.act(observation)
        solve_s += time.perf_counter() - start
        observation, gained, terminated, truncated, info = env.step(action)
        reward += gained
        over = terminated or truncated
    return Episode(reward, solve_s, np.arctan2(observation[3:6], observation[:3]), info)


def run_episodes(
    task: ButtonTask, players: Mapping[str, Player], goals: int, seed: int, *, done: Collection[EpisodeTrial] = ()
) -> Iterator[EpisodeTrial]:
    """Yield a trial per goal and method as it is finished.

    Args:
        task: Sets the episodes.
        players: By name of the method.
        goals: How many.
        seed: Of the comparison.
        done: Trials to leave out.
    """
    env = task.new_environment()
    for player in players.values():
        play(env, player.policy(WARM_UP_SEED), WARM_UP_SEED)
    names = list(players)
    finished = {(trial.goal, trial.method) for trial in done}
    for index in range(goals):
        episode_seed = task.environment_seed(index, seed)
        for turn in np.random.default_rng(index).permutation(len(names)):
            if (index, names[turn]) not in finished:
                policy = players[names[turn]].policy(episode_seed)
                yield _trial(task, index, names[turn], play(env, policy, episode_seed))


def _trial(task: ButtonTask, index: int, name: str, episode: Episode) -> EpisodeTrial:
    info = episode.info
    x, y, z = map(float, info["goal"])
    pressed, diverged = info["pressed"], info["impossible"]
    return EpisodeTrial(
        goal=index,
        method=name,
        x=x,
        y=y,
        z=z,
        reached=pressed,
        impossible=diverged,
        status=PRESSED if pressed else DIVERGED if diverged else NOT_PRESSED,
        reason=info["impossible_reason"],
        distance=info["distance"],
        reward=episode.reward,
        solve_s=episode.solve_s,
        move_s=info["steps"] * task.episode.options.actuation.period if pressed else None,
        q=tuple(map(float, episode.q)),
        steps=info["steps"],
        wrong_presses=info["wrong_presses"],
        energy=info["energy"],
    )
