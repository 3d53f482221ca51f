"""The arms in MuJoCo: scene, joint controller, simulation and pictures. Knows no learning.

`ArmSimulation` is one arm in its work cell; it resets, moves by dynamics, and says where everything is.
"""

from kinreach.envs.controller import JointController, MoveResult, MoveStatus
from kinreach.envs.rendering import FrameRenderer, render
from kinreach.envs.scene import build_scene, scene_model
from kinreach.envs.simulation import ArmSimulation

__all__ = [
    "ArmSimulation",
    "FrameRenderer",
    "JointController",
    "MoveResult",
    "MoveStatus",
    "build_scene",
    "render",
    "scene_model",
]
