"""Policies, how they are trained, and how they are evaluated.

- `load_policy`, `rollout`, `evaluate`: load a policy, play episodes with it, measure it on held-out goals.
- `Recipe`, `get_recipe`, `train`: from a recipe and a seed to a policy file, a learning curve and a checkpoint.
- `register_recipe`, `register_algorithm`: train by a recipe and an algorithm of your own.
- `SB3VecEnv`: a native batch as stable-baselines3 takes it; `export_policy`: a policy file of its model.
- `RandomPolicy`, `AnalyticButtonPolicy`: policies that are not trained.

`train`, `register_algorithm`, `SB3VecEnv` and `export_policy` need the extra `train`; the rest runs without torch. The
modules are internal.
"""

from typing import Any

import lazy_loader

from kinreach.errors import InstallationError

_get, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    try:
        return _get(name)
    except ModuleNotFoundError as error:
        raise InstallationError(f"{name} needs {error.name}: pip install 'kinreach[train]'") from error
