"""The thesis's reward with parts of it left out (3.4.4, 6.2), as training rewards.

`python -m kinreach.train` takes them by name, `reward="benchmarks.studies.reward_parts:distance"` in a recipe. What is
left out is left out everywhere: of the posture error, of what a step beside the goal pays, and of what is paid as
reached.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kinreach.baselines._rewards import FLOOR, TrainingReward
from kinreach.thesis import REACHED_DISTANCE, REACHED_POSTURE_ERROR, distance_reward
from kinreach.thesis._posture import posture_errors
from kinreach.thesis._reward import IMPOSSIBLE_REWARD, NEAR_REWARD, REACHED_REWARD

Array = np.ndarray[Any, Any]


def thesis_with(info: Mapping[str, Any], *, natural_arm: bool, gripper_angle: bool) -> Array:
    """The thesis's reward of a step's `info`, shape (n,), with one, both or none of the posture's parts."""
    natural, angle = posture_errors(info["q"])
    r_e = natural_arm * natural + gripper_angle * angle
    distance = info["distance"]
    at_goal = np.where(r_e < REACHED_POSTURE_ERROR, REACHED_REWARD, NEAR_REWARD - r_e)
    away = distance_reward(np.maximum(distance, REACHED_DISTANCE)) - r_e
    return np.where(info["impossible"], IMPOSSIBLE_REWARD, np.where(distance < REACHED_DISTANCE, at_goal, away))


def distance(rewards: Array, info: Mapping[str, Any]) -> Array:
    """Return the thesis's reward with the distance alone."""
    return thesis_with(info, natural_arm=False, gripper_angle=False)


def natural_arm(rewards: Array, info: Mapping[str, Any]) -> Array:
    """The distance and the natural arm."""
    return thesis_with(info, natural_arm=True, gripper_angle=False)


def gripper_angle(rewards: Array, info: Mapping[str, Any]) -> Array:
    """The distance and the gripper's angle."""
    return thesis_with(info, natural_arm=False, gripper_angle=True)


def everything(rewards: Array, info: Mapping[str, Any]) -> Array:
    """Return the thesis's whole reward."""
    return thesis_with(info, natural_arm=True, gripper_angle=True)


def _floored(reward: TrainingReward) -> TrainingReward:
    def floored(rewards: Array, info: Mapping[str, Any]) -> Array:
        return np.maximum(reward(rewards, info), FLOOR)

    return floored


#: Training rewards by what they consist of, and the same not below -30, which the recipes `ppo-...` learn from.
PARTS: Mapping[str, TrainingReward] = {
    "distance": distance,
    "natural arm": natural_arm,
    "gripper angle": gripper_angle,
    "all": everything,
}
distance_floored, natural_arm_floored, gripper_angle_floored, everything_floored = map(_floored, PARTS.values())
