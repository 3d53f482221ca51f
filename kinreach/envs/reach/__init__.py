"""The thesis's task as Gymnasium environments: single-step and multi-step, one at a time or in native batches."""

from kinreach.envs.reach.multi_step import UR5MultiStepEnv
from kinreach.envs.reach.single_step import UR5SingleStepEnv
from kinreach.envs.reach.vector_env import UR5ReachVectorEnv

__all__ = ["UR5MultiStepEnv", "UR5ReachVectorEnv", "UR5SingleStepEnv"]
