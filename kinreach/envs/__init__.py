"""Gymnasium environments: the thesis's reaching tasks (`reach`), the course report's button, and a moving ball.

`import kinreach` registers them for `gymnasium.make`. `RecordMotion` records a video with the motion of every step.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinreach.envs._single import RecordMotion

#: Name -> its module, imported when the name is first used: a kinematic environment loads no renderer.
_MODULES = {
    "RecordMotion": "_single",
}

__all__ = [
    "RecordMotion",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
