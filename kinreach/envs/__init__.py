"""Gymnasium environments: `reach` is the thesis's task on any arm, `button` the course report's.

`import kinreach` registers them. `RecordMotion` films an episode with the motion of every step. The simulation that the
environments run on is `kinreach.sim`, whose names can be imported from here too, as in version 0.1.
"""

from kinreach.envs.single import RecordMotion
from kinreach.sim import (
    ArmSimulation,
    BatchSimulation,
    FrameRenderer,
    JointController,
    MoveResult,
    MoveStatus,
    build_scene,
    render,
    scene_model,
)

__all__ = [
    "ArmSimulation",
    "BatchSimulation",
    "FrameRenderer",
    "JointController",
    "MoveResult",
    "MoveStatus",
    "RecordMotion",
    "build_scene",
    "render",
    "scene_model",
]
