"""The arms in MuJoCo: scene, joint controller, simulation and pictures. Knows no learning.

`ArmSimulation` is one arm in its work cell; it resets, moves by dynamics, and says where everything is.
`BatchSimulation` is any number of them, stepped together.
"""

from kinreach.envs.batch_simulation import BatchSimulation
from kinreach.envs.controller import JointController
from kinreach.envs.moves import MoveResult, MoveStatus
from kinreach.envs.rendering import FrameRenderer, render
from kinreach.envs.scene import build_scene, scene_model
from kinreach.envs.simulation import ArmSimulation

__all__ = [
    "ArmSimulation",
    "BatchSimulation",
    "FrameRenderer",
    "JointController",
    "MoveResult",
    "MoveStatus",
    "build_scene",
    "render",
    "scene_model",
]
