"""What other rooms use of this one, as `inside.pyi` lists it; what users type is in `kinreach.robots`.

- `ArmFlags`: the flags of the command line that describe an arm; `FILES`, the endings of files that do.
- Shapes of links, obstacles and meshes, for drawing, simulation and collision checks.
- `JawGripper`: the gripper of an SO-101.
- Moves of two phases: `between_phases`.
- URDF elements: `neighbours`, `origin_of`, `without_shapes`, `skeleton`.
- Joints without end: `endless_joints`, `one_number_each`; those that follow others: `followers`, `following_joints`,
  `set_follows`.
- URs: names of joints and frames, and what the maker's tables say of each model.
- Identification: an arm's frames from measured positions or poses, with a prior.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__package__, __file__)
