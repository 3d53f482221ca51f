"""What a learner is rewarded with. Evaluation always uses the environment's own reward."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from kinreach.baselines.button_reward import guided, scaled

Array = np.ndarray[Any, Any]

#: The environment's rewards, and the step's info as arrays of a batch, to what the learner sees, shape (n,). Where the
#: learner acts step by step, `info["observation"]` is what the step led to, also where a new episode has begun since.
TrainingReward = Callable[[Array, Mapping[str, Any]], Array]

#: The thesis's -100 and -25 dwarf all that is to be learned at first; below this there are no differences.
FLOOR = -30.0
#: Distance below which the dense reward has nothing left to gain [m], and its weight of the posture error.
DENSE_DISTANCE, DENSE_POSTURE, DENSE_IMPOSSIBLE = 1e-5, 5.0, -200.0


def own(rewards: Array, info: Mapping[str, Any]) -> Array:
    """The environment's."""
    return rewards


def floored(rewards: Array, info: Mapping[str, Any]) -> Array:
    """The environment's, not below `FLOOR`."""
    return np.maximum(rewards, FLOOR)


def dense(rewards: Array, info: Mapping[str, Any]) -> Array:
    """-ln(d + 1e-5) - 5 r_e, and 200 less where the action was impossible.

    The thesis's reward is flat within 1 cm of the goal, so that nothing finer can be learned from it; this one is steep
    there. Among impossible actions it still says which was nearest.
    """
    near = -np.log(info["distance"] + DENSE_DISTANCE) - DENSE_POSTURE * info["posture_error"]
    return near + np.where(info["impossible"], DENSE_IMPOSSIBLE, 0.0)


#: Training rewards by the name that recipes use.
REWARDS: Mapping[str, TrainingReward] = {
    "own": own,
    "floored": floored,
    "dense": dense,
    "scaled": scaled,
    "guided": guided,
}
