"""The simplest learner there is: try small random moves and keep the best. Where it stops is a local optimum."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach.envs.reach.task import JOINTS, STEP_SIZE
from kinreach.errors import InputError
from kinreach.kinematics.goals import Floats, as_floats

#: Postures [rad], shape (n, 6), and which climber each belongs to, shape (n,), to their rewards, shape (n,).
Reward = Callable[[Floats, NDArray[np.intp]], Floats]


class Climb(NamedTuple):
    """Where climbers stopped.

    Attributes:
        q: Postures [rad], shape (n, 6).
        reward: Of them, shape (n,).
        steps: How many moves each made, shape (n,).
    """

    q: Floats
    reward: Floats
    steps: Floats


def climb(
    start: ArrayLike,
    reward: Reward,
    *,
    tries: int = 100,
    patience: int = 3,
    step: float = STEP_SIZE,
    steps: int = 200,
    seed: int = 0,
) -> Climb:
    """Let climbers go uphill from given postures.

    In each round a climber tries moves in which every joint turns by up to `step`, of all sizes down to a hundredth of
    it, and makes the best one if that pays more than staying.

    Args:
        start: Postures [rad], shape (n, 6), one for each climber.
        reward: What a posture pays.
        tries: Moves tried in a round.
        patience: Rounds without a better one after which a climber has stopped.
        step: Largest turn of a joint [rad].
        steps: Most rounds.
        seed: Of the moves.

    Raises:
        InputError: Starts of another shape, or counts below 1.
    """
    q = np.array(as_floats("start", start))
    if q.ndim != 2 or q.shape[1] != JOINTS or min(tries, patience, steps) < 1:
        raise InputError(f"climbing needs postures of shape (n, {JOINTS}) and counts from 1 on, got {q.shape}")
    rng = np.random.default_rng(seed)
    best = reward(q, np.arange(len(q)))
    made, idle = np.zeros(len(q)), np.zeros(len(q))
    for _ in range(steps):
        climbers = np.flatnonzero(idle < patience)
        if not climbers.size:
            break
        sizes = step * 10.0 ** rng.uniform(-2, 0, (len(climbers), tries, 1))
        tried = q[climbers, None] + sizes * rng.uniform(-1, 1, (len(climbers), tries, JOINTS))
        rewards = reward(tried.reshape(-1, JOINTS), np.repeat(climbers, tries)).reshape(len(climbers), tries)
        choice = rewards.argmax(axis=1)
        found = rewards[np.arange(len(climbers)), choice]
        better = found > best[climbers]
        movers = climbers[better]
        q[movers], best[movers] = tried[better, choice[better]], found[better]
        made[movers] += 1
        idle[climbers] = np.where(better, 0, idle[climbers] + 1)
    return Climb(q, best, made)
