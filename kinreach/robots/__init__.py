"""What an arm is: description, mount, tool centre point, home, limits, gripper; and the work cell around it.

- `get_arm`, `arm_names`, `register_arm`: arms by name.
- `THESIS_ARM`: the name of the thesis's arm, the default of its tasks.
- `ArmDescription`: an arm of your own, also from its URDF file; `CameraMount`, `Workcell`, `Box`, `BoxRegion` and
  `QuadrantRegion` are its parts.
- `Obstacle`: a solid or a mesh around the arm, for collision checks and paths.
- `Tool`: what is mounted on an arm's flange; `Gripper`: two fingers there that move (`ArmDescription.with_gripper`).
- `read_calibration`: the factory calibration of a UR; `PUBLISHED_CALIBRATIONS` are files of real ones.
- `calibrate`: a calibration from programs, exports, recordings and tables of an arm's owner, or from `PosePairs`; the
  result is a `CalibratedArm`.

Data only: nothing here imports a robotics engine. Every arm is one URDF that feeds Pinocchio, placo and MuJoCo. The
modules are internal.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
