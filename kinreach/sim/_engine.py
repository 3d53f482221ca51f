"""MuJoCo, imported so that a missing graphics library does not stop the physics, and no log file appears."""

from __future__ import annotations

from typing import Any

from kinreach._engines import load_mujoco

mujoco: Any = load_mujoco()
