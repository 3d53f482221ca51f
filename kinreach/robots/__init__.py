"""What an arm is: description, mount, tool centre point, home, limits, gripper; and the work cell around it.

- `get_arm`, `arm_names`, `register_arm`: arms by name.
- `ArmDescription`: an arm of your own, also from its URDF file; `CameraMount`, `Workcell`, `Box`, `BoxRegion` and
  `QuadrantRegion` are its parts.
- `Obstacle`: a solid or a mesh around the arm, for collision checks and paths.
- `Tool`: what is mounted on an arm's flange.
- `read_calibration`: the factory calibration of a UR; `PUBLISHED_CALIBRATIONS` are files of real ones.
- `calibrate`: a calibration from programs, exports, recordings and tables (`PosePairs`) of an arm's owner; it returns a
  `CalibratedArm`, with a `CalibrationFit` where it was fitted.

Data only: nothing here imports a robotics engine. Every arm is one URDF that feeds Pinocchio, placo and MuJoCo. The
modules are internal.
"""

from kinreach.robots._calibrate import CalibratedArm, CalibrationFit, calibrate
from kinreach.robots._calibration import PUBLISHED_CALIBRATIONS, read_calibration
from kinreach.robots._description import ArmDescription
from kinreach.robots._obstacles import Obstacle
from kinreach.robots._pairs import PosePairs
from kinreach.robots._registry import arm_names, get_arm, register_arm
from kinreach.robots._tools import Tool
from kinreach.robots._workcell import Box, BoxRegion, CameraMount, QuadrantRegion, Workcell

__all__ = [
    "PUBLISHED_CALIBRATIONS",
    "ArmDescription",
    "Box",
    "BoxRegion",
    "CalibratedArm",
    "CalibrationFit",
    "CameraMount",
    "Obstacle",
    "QuadrantRegion",
    "PosePairs",
    "Tool",
    "Workcell",
    "arm_names",
    "calibrate",
    "get_arm",
    "read_calibration",
    "register_arm",
]
