"""Gymnasium environments: the thesis's reaching tasks (`reach`), the course report's button, and a moving ball.

`import kinreach` registers them for `gymnasium.make`. `RecordMotion` records a video with the motion of every step.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinreach.envs._button.env import ButtonPressEnv
    from kinreach.envs._button.task import PRESS_RADIUS
    from kinreach.envs._reach.env import SpaceReachEnv, UR5MultiStepEnv, UR5SingleStepEnv
    from kinreach.envs._reach.task import STEP_SIZE
    from kinreach.envs._single import RecordMotion

#: Name -> its module, imported when the name is first used: a kinematic environment loads no renderer.
_MODULES = {
    "ButtonPressEnv": "_button.env",
    "PRESS_RADIUS": "_button.task",
    "RecordMotion": "_single",
    "STEP_SIZE": "_reach.task",
    "SpaceReachEnv": "_reach.env",
    "UR5MultiStepEnv": "_reach.env",
    "UR5SingleStepEnv": "_reach.env",
}

__all__ = [
    "PRESS_RADIUS",
    "STEP_SIZE",
    "ButtonPressEnv",
    "RecordMotion",
    "SpaceReachEnv",
    "UR5MultiStepEnv",
    "UR5SingleStepEnv",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
