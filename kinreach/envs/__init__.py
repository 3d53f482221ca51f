"""Gymnasium environments: reaching, a moving ball, lifting, an inexact arm, obstacles, and a button.

`import kinreach` registers them for `gymnasium.make`. `RecordMotion` records a video with the motion of every step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kinreach._lazy import on_first_use

if TYPE_CHECKING:
    from kinreach.envs._single import RecordMotion

__all__ = [
    "RecordMotion",
]

#: Imported when it is first used: it loads MuJoCo.
__getattr__ = on_first_use(__name__, {"RecordMotion": "_single"})
