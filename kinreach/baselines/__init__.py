"""Policies, how they are trained, and how they are evaluated.

- `load_policy`, `rollout`, `evaluate`: load a policy, play episodes with it, measure it on held-out goals.
- `Recipe`, `get_recipe`, `train`: from a recipe and a seed to a policy file, a learning curve and a checkpoint.
- `register_recipe`, `register_algorithm`: train by a recipe and an algorithm of your own.
- `SB3VecEnv`: a native batch as stable-baselines3 takes it.
- `RandomPolicy`, `AnalyticButtonPolicy`: policies that are not trained.

`train`, `register_algorithm` and `SB3VecEnv` need the extra `train`; the rest runs without torch. The modules are
internal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kinreach._lazy import on_first_use
from kinreach.errors import InstallationError

if TYPE_CHECKING:
    from kinreach.baselines._algorithms import Algorithm, register_algorithm
    from kinreach.baselines._button_controller import AnalyticButtonPolicy
    from kinreach.baselines._evaluation import HELD_OUT, evaluate
    from kinreach.baselines._learning_curve import read_curve
    from kinreach.baselines._loop import RandomPolicy, rollout
    from kinreach.baselines._policies import load_policy
    from kinreach.baselines._recipes import Networks, Recipe, get_recipe, register_recipe
    from kinreach.baselines._training import train
    from kinreach.baselines._vec_envs import SB3VecEnv

#: Name -> its module, imported when the name is first asked for: acting does not wait for torch.
_MODULES = {
    "Algorithm": "_algorithms",
    "AnalyticButtonPolicy": "_button_controller",
    "HELD_OUT": "_evaluation",
    "Networks": "_recipes",
    "RandomPolicy": "_loop",
    "Recipe": "_recipes",
    "SB3VecEnv": "_vec_envs",
    "evaluate": "_evaluation",
    "get_recipe": "_recipes",
    "load_policy": "_policies",
    "read_curve": "_learning_curve",
    "register_algorithm": "_algorithms",
    "register_recipe": "_recipes",
    "rollout": "_loop",
    "train": "_training",
}

__all__ = [
    "HELD_OUT",
    "Algorithm",
    "AnalyticButtonPolicy",
    "Networks",
    "RandomPolicy",
    "Recipe",
    "SB3VecEnv",
    "evaluate",
    "get_recipe",
    "load_policy",
    "read_curve",
    "register_algorithm",
    "register_recipe",
    "rollout",
    "train",
]

_get = on_first_use(__name__, _MODULES)


def __getattr__(name: str) -> Any:
    try:
        return _get(name)
    except ModuleNotFoundError as error:
        raise InstallationError(f"{name} needs {error.name}: pip install 'kinreach[train]'") from error
