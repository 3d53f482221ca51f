"""The course report's task: a 3-DOF arm under torque presses a button, one at a time or in native batches."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules={"button_task"})
