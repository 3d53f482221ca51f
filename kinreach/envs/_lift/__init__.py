"""Grasping and lifting an object with a gripper: `kinreach/Lift-v0`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules={"lift_task"})
