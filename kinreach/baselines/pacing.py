"""From a posture to the actions of an episode that takes the arm there."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinreach.envs.reach.task import STEP_SIZE

Array = np.ndarray[Any, Any]

#: Steps are not split for a remainder below this [steps].
_SLACK = 1e-6


def paced(way: Array) -> Array:
    """The next multi-step action on the straight way in joint space, in equal steps as few as can be.

    Equal steps end at the posture with a long one. An arm that creeps up to it would come within the thesis's 10 mm
    somewhere on the way, where the episode ends.

    Args:
        way: Joint angles still to go [rad], shape (..., 6).

    Returns:
        Action in [-1, 1], shape (..., 6).
    """
    steps = np.abs(way).max(axis=-1, keepdims=True) / STEP_SIZE
    return way / STEP_SIZE / np.maximum(1.0, np.ceil(steps - _SLACK))
