"""What an arm is: description, mount, tool centre point, home, limits, gripper; and the work cell around it.

Data only: nothing here imports a robotics engine. Every arm is one URDF that feeds Pinocchio, placo and MuJoCo.
"""

from kinreach.robots.description import ArmDescription
from kinreach.robots.grippers import PARALLEL_GRIPPER, Gripper, with_parallel_gripper
from kinreach.robots.registry import arm_named, arm_names, as_arm, get_arm, register_arm
from kinreach.robots.workcell import Box, BoxRegion, CameraMount, Workcell

__all__ = [
    "PARALLEL_GRIPPER",
    "ArmDescription",
    "Box",
    "BoxRegion",
    "CameraMount",
    "Gripper",
    "Workcell",
    "arm_named",
    "arm_names",
    "as_arm",
    "get_arm",
    "register_arm",
    "with_parallel_gripper",
]
