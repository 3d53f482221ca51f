"""The arms in MuJoCo: scene, joint controller, simulation and pictures. Knows no task and no learning.

`ArmSimulation` is one arm in its work cell; it resets, moves by dynamics, and says where everything is.
`BatchSimulation` is any number of them, stepped together.
"""

from kinreach.sim._controller import JointController, MoveResult, MoveStatus
from kinreach.sim._imperfections import Imperfections
from kinreach.sim._rendering import FrameRenderer, render
from kinreach.sim._scene import build_scene, scene_model
from kinreach.sim._simulation import ArmSimulation, BatchSimulation

__all__ = [
    "ArmSimulation",
    "BatchSimulation",
    "FrameRenderer",
    "Imperfections",
    "JointController",
    "MoveResult",
    "MoveStatus",
    "build_scene",
    "render",
    "scene_model",
]
