"""What an arm is: description, mount, tool centre point, home, limits, gripper; and the work cell around it.

- `get_arm`, `arm_names`, `register_arm`: arms by name.
- `THESIS_ARM`: the name of the thesis's arm, the default of its tasks.
- `ArmDescription`: an arm of your own, also from its URDF file; `CameraMount`, `Workcell`, `Box`, `BoxRegion` and
  `QuadrantRegion` are its parts.
- `Obstacle`: a solid or a mesh around the arm, for collision checks and paths.
- `Tool`: what is mounted on an arm's flange.
- `read_calibration`: the factory calibration of a UR; `PUBLISHED_CALIBRATIONS` are files of real ones.
- `calibrate`: a calibration from programs, exports, recordings and tables of an arm's owner, or from `PosePairs`.

Data only: nothing here imports a robotics engine. Every arm is one URDF that feeds Pinocchio, placo and MuJoCo. The
modules are internal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kinreach._lazy import on_first_use
from kinreach.robots._calibration import PUBLISHED_CALIBRATIONS, read_calibration
from kinreach.robots._description import ArmDescription
from kinreach.robots._obstacles import Obstacle
from kinreach.robots._registry import arm_names, get_arm, register_arm
from kinreach.robots._tools import Tool
from kinreach.robots._ur_arms import THESIS_ARM
from kinreach.robots._workcell import Box, BoxRegion, CameraMount, QuadrantRegion, Workcell

if TYPE_CHECKING:
    from kinreach.robots._calibrate import calibrate
    from kinreach.robots._pairs import PosePairs

#: Name -> its module, imported when the name is first used: only who calibrates needs them.
_MODULES = {
    "PosePairs": "_pairs",
    "calibrate": "_calibrate",
}

__all__ = [
    "PUBLISHED_CALIBRATIONS",
    "THESIS_ARM",
    "ArmDescription",
    "Box",
    "BoxRegion",
    "CameraMount",
    "Obstacle",
    "PosePairs",
    "QuadrantRegion",
    "Tool",
    "Workcell",
    "arm_names",
    "calibrate",
    "get_arm",
    "read_calibration",
    "register_arm",
]

__getattr__ = on_first_use(__name__, _MODULES)
