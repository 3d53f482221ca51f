"""The thesis's reward and the geometry of postures behind it: pure functions on arrays."""

from kinreach.thesis._posture import (
    UNNATURAL_ERROR,
    PentagonAngles,
    gripper_angle_error,
    natural_arm_error,
    pentagon_angles,
    posture_error,
)
from kinreach.thesis._reward import (
    IMPOSSIBLE_REWARD,
    NEAR_REWARD,
    REACHED_DISTANCE,
    REACHED_POSTURE_ERROR,
    REACHED_REWARD,
    distance_reward,
    reach_reward,
)

__all__ = [
    "IMPOSSIBLE_REWARD",
    "NEAR_REWARD",
    "REACHED_DISTANCE",
    "REACHED_POSTURE_ERROR",
    "REACHED_REWARD",
    "UNNATURAL_ERROR",
    "PentagonAngles",
    "distance_reward",
    "gripper_angle_error",
    "natural_arm_error",
    "pentagon_angles",
    "posture_error",
    "reach_reward",
]
