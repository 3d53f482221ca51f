"""The thesis's reward and the geometry of postures behind it: pure functions on arrays."""

from kinreach.thesis._posture import (
    pentagon_angles,
    posture_error,
)
from kinreach.thesis._reward import (
    REACHED_DISTANCE,
    REACHED_POSTURE_ERROR,
    distance_reward,
    reach_reward,
)

__all__ = [
    "REACHED_DISTANCE",
    "REACHED_POSTURE_ERROR",
    "distance_reward",
    "pentagon_angles",
    "posture_error",
    "reach_reward",
]
