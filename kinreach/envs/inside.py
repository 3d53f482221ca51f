"""What other rooms use of this one, as `inside.pyi` lists it; what users type is in `kinreach.envs`.

- Modules, one a task, with its layout, constants and options: `reach_task`, `lift_task`, `button_task`, `moving`,
  `real_arm`. Beside them, what single methods need of a task: its options, drawings, observers.
- What an environment of another room is made of: `PosedEnv`, `NativeVectorEnv`, `Outcome`, `RowStreams`, ...
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__package__, __file__)
