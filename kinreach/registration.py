"""Makes the environments known to Gymnasium; importing this loads no engine."""

from __future__ import annotations

from gymnasium.envs.registration import register, registry

_REACH, _BUTTON = "kinreach.envs.reach", "kinreach.envs.button"
#: Ids of the environments.
SINGLE, MULTI, BUTTON = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0", "kinreach/ButtonPress-v0"
#: Environment id -> entry points of the single environment and of its native batch. Steps are limited inside.
ENVIRONMENTS = {
    SINGLE: (f"{_REACH}.env:UR5SingleStepEnv", f"{_REACH}.vector_env:single_step"),
    MULTI: (f"{_REACH}.env:UR5MultiStepEnv", f"{_REACH}.vector_env:multi_step"),
    BUTTON: (f"{_BUTTON}.env:ButtonPressEnv", f"{_BUTTON}.vector_env:ButtonPressVectorEnv"),
}


def register_environments() -> None:
    """Register every environment that is not registered yet."""
    for name, (entry_point, vector_entry_point) in ENVIRONMENTS.items():
        if name not in registry:
            register(name, entry_point=entry_point, vector_entry_point=vector_entry_point)
