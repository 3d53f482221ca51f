"""The course report's task: a 3-DOF arm under torque presses a button, one at a time or in native batches."""

from kinreach.envs._button.button_task import ACTUATIONS, Actuation
from kinreach.envs._button.env import ButtonPressEnv
from kinreach.envs._button.vector_env import ButtonPressVectorEnv

__all__ = ["ACTUATIONS", "Actuation", "ButtonPressEnv", "ButtonPressVectorEnv"]
