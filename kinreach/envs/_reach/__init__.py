"""The thesis's task as Gymnasium environments: single-step and multi-step, one at a time or in native batches."""

from kinreach.envs._reach.env import ReachEnv, UR5MultiStepEnv, UR5SingleStepEnv
from kinreach.envs._reach.rewards import DistanceReward, RewardFunction, ThesisReward
from kinreach.envs._reach.vector_env import ReachVectorEnv

__all__ = [
    "DistanceReward",
    "ReachEnv",
    "ReachVectorEnv",
    "RewardFunction",
    "ThesisReward",
    "UR5MultiStepEnv",
    "UR5SingleStepEnv",
]
