"""Gymnasium environments: reaching, a moving ball, lifting, an inexact arm, obstacles, and a button.

`import kinreach` registers them for `gymnasium.make`. `RecordMotion` records a video with the motion of every step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinreach.envs._single import RecordMotion

__all__ = [
    "RecordMotion",
]


def __getattr__(name: str) -> Any:
    if name != "RecordMotion":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from kinreach.envs._single import RecordMotion  # when it is first used: it loads MuJoCo

    return RecordMotion
