"""What a policy for a reach environment does on given goals, step by step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from kinreach.baselines.learned import LearnedPolicy
from kinreach.envs.reach.task import ANGLES
from kinreach.errors import InputError
from kinreach.kinematics import UR5Kinematics
from kinreach.kinematics.goals import Floats, as_floats
from kinreach.registration import MULTI, SINGLE


@dataclass(frozen=True, eq=False)
class Trace:
    """Episodes side by side; row 0 is the start, row k is after step k.

    After the end of its episode an arm stays where it is in here.

    Attributes:
        distance: To the goal [m], shape (steps + 1, n).
        q: Joint angles [rad], shape (steps + 1, n, 6).
        posture_error: r_e [rad], shape (steps, n).
        reward: Shape (steps, n); after the end not a number.
        reached: Whether the goal was reached at the end, shape (n,).
        impossible: Whether the last action was, shape (n,).
    """

    distance: Floats
    q: Floats
    posture_error: Floats
    reward: Floats
    reached: Any
    impossible: Any


def trace(policy: LearnedPolicy, goals: ArrayLike, *, options: Mapping[str, Any] | None = None) -> Trace:
    """Play one deterministic episode for each goal.

    Args:
        policy: For a reach environment.
        goals: Positions in the world [m], shape (n, 3).
        options: Of the environment.

    Raises:
        InputError: The policy is for another environment, the goals are malformed, or options that the environment does
            not take.
    """
    goals = as_floats("goals", goals)
    environment = policy.card.environment
    if environment not in (SINGLE, MULTI):
        raise InputError(f"a trace needs a policy for {SINGLE} or {MULTI}, got one for {environment}")
    if goals.ndim != 2 or goals.shape[1] != 3 or not len(goals):
        raise InputError(f"goals must have shape (n, 3), got {goals.shape}")
    env: Any = gym.make_vec(
        environment, num_envs=len(goals), vectorization_mode="vector_entry_point", **dict(options or {})
    )
    try:
        return _play(env, policy, goals)
    finally:
        env.close()


def _play(env: Any, policy: LearnedPolicy, goals: Floats) -> Trace:
    observations, _ = env.reset(seed=0, options={"goal": goals})
    start = observations[:, ANGLES]
    first = np.linalg.norm(UR5Kinematics(tip="tcp", base="world").positions(start) - goals, axis=1)
    q, distance = [start], [first]
    posture_error: list[Floats] = []
    reward: list[Floats] = []
    reached, impossible = (np.zeros(len(goals), dtype=np.bool_) for _ in range(2))
    pending = np.ones(len(goals), dtype=np.bool_)
    while pending.any():
        observations, rewards, terminated, truncated, info = env.step(policy.act(observations))
        over = terminated | truncated
        now = observations[:, ANGLES].copy()
        if over.any():  # the observation is that of the next episode
            now[over] = info["final_obs"][over][:, ANGLES]
        q.append(np.where(pending[:, None], now, q[-1]))
        distance.append(np.where(pending, info["distance"], distance[-1]))
        posture_error.append(np.where(pending, info["posture_error"], posture_error[-1] if posture_error else np.nan))
        reward.append(np.where(pending, rewards, np.nan))
        reached[pending & over] = info["reached"][pending & over]
        impossible[pending & over] = info["impossible"][pending & over]
        pending &= ~over
    return Trace(
        distance=np.array(distance),
        q=np.array(q),
        posture_error=np.array(posture_error),
        reward=np.array(reward),
        reached=reached,
        impossible=impossible,
    )
