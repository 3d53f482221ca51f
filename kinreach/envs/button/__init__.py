"""The course report's task: a 3-DOF arm under torque presses a button, one at a time or in native batches."""

from kinreach.envs.button.env import ButtonPressEnv
from kinreach.envs.button.task import ACTUATIONS, Actuation
from kinreach.envs.button.vector_env import ButtonPressVectorEnv

__all__ = ["ACTUATIONS", "Actuation", "ButtonPressEnv", "ButtonPressVectorEnv"]
