"""The arms in MuJoCo: scene, joint controller, simulation and pictures. Knows no task and no learning.

`ArmSimulation` is one arm in its work cell; it resets, moves by dynamics, and gives every position.
`BatchSimulation` is any number of them, stepped together. `render` draws a picture of one.
"""

from kinreach.sim._rendering import render
from kinreach.sim._simulation import ArmSimulation, BatchSimulation

__all__ = [
    "ArmSimulation",
    "BatchSimulation",
    "render",
]
