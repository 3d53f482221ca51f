"""Policies, how they are trained, and how they are evaluated.

- `load_policy`, `rollout`, `evaluate`: load a policy, play episodes with it, measure it on held-out goals.
- `Recipe`, `get_recipe`, `train`: from a recipe and a seed to a policy file, a learning curve and a checkpoint.
- `register_recipe`, `register_algorithm`: train by a recipe and an algorithm of your own.
- `SB3VecEnv`: a native batch as stable-baselines3 takes it.
- `RandomPolicy`, `SolverPolicy`, `AnalyticButtonPolicy`: policies that are not trained.

`train`, `register_algorithm` and `SB3VecEnv` need the extra `train`; the rest runs without torch. The modules are
internal.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from kinreach.errors import InstallationError

if TYPE_CHECKING:
    from kinreach.baselines.algorithms import Algorithm, register_algorithm
    from kinreach.baselines.button_controller import AnalyticButtonPolicy
    from kinreach.baselines.evaluation import HELD_OUT, VALIDATION, evaluate
    from kinreach.baselines.learning_curve import read_curve
    from kinreach.baselines.loop import Policy, RandomPolicy, rollout
    from kinreach.baselines.policies import load_policy
    from kinreach.baselines.recipes import RECIPES, Networks, Recipe, get_recipe, register_recipe
    from kinreach.baselines.solver_policy import SolverPolicy
    from kinreach.baselines.training import train
    from kinreach.baselines.vec_envs import SB3VecEnv

#: Name -> its module, imported when the name is first asked for: acting does not wait for torch.
_MODULES = {
    "Algorithm": "algorithms",
    "AnalyticButtonPolicy": "button_controller",
    "HELD_OUT": "evaluation",
    "Networks": "recipes",
    "Policy": "loop",
    "RECIPES": "recipes",
    "RandomPolicy": "loop",
    "Recipe": "recipes",
    "SB3VecEnv": "vec_envs",
    "SolverPolicy": "solver_policy",
    "VALIDATION": "evaluation",
    "evaluate": "evaluation",
    "get_recipe": "recipes",
    "load_policy": "policies",
    "read_curve": "learning_curve",
    "register_algorithm": "algorithms",
    "register_recipe": "recipes",
    "rollout": "loop",
    "train": "training",
}

__all__ = [
    "HELD_OUT",
    "RECIPES",
    "VALIDATION",
    "Algorithm",
    "AnalyticButtonPolicy",
    "Networks",
    "Policy",
    "RandomPolicy",
    "Recipe",
    "SB3VecEnv",
    "SolverPolicy",
    "evaluate",
    "get_recipe",
    "load_policy",
    "read_curve",
    "register_algorithm",
    "register_recipe",
    "rollout",
    "train",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        module = importlib.import_module(f"{__name__}.{_MODULES[name]}")
    except ModuleNotFoundError as error:
        raise InstallationError(f"{name} needs {error.name}: pip install 'kinreach[train]'") from error
    return getattr(module, name)
