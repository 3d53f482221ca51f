"""The thesis's task as Gymnasium environments: single-step and multi-step, one at a time or in native batches."""

from kinreach.envs.reach.env import UR5MultiStepEnv, UR5SingleStepEnv
from kinreach.envs.reach.vector_env import UR5ReachVectorEnv

__all__ = ["UR5MultiStepEnv", "UR5ReachVectorEnv", "UR5SingleStepEnv"]
