"""Figures as functions: they take data and return a `matplotlib.figure.Figure`, all in the style of `style`.

Nothing here knows an environment or a learner, so that every layer and every notebook can draw with it. `checks` is
what figures refuse.

- `rewards`, `pentagon`: the thesis's reward and its geometry, PPO's clipped objective.
- `pictures`: renderings and the steps of the search for the ball.
- `maps`: errors, rewards and ways of an end effector over the table.
- `learning`, `series`: learning curves over seeds, episodes, discounted rewards.
- `methods`: success and errors against tolerance; the reward around a posture and what exploring there pays, and how
  near policies keep to the limit of the posture error.
- `workspace`: where an arm is agile, and where its data sheet is wrong; `check_cli`: `kinreach check`, which draws it.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinreach.plots.learning import (
        draw_discounted_rewards,
        draw_distances,
        draw_episode_rewards,
        draw_learning_curves,
    )
    from kinreach.plots.maps import RewardMap, draw_error_maps, draw_paths, draw_reward_maps
    from kinreach.plots.methods import Success, draw_error_bands, draw_local_optimum, draw_posture_errors, draw_success
    from kinreach.plots.pentagon import Pentagon, draw_pentagon_angles, draw_pentagons, pentagon_of, side_camera
    from kinreach.plots.pictures import draw_camera_steps, draw_pictures
    from kinreach.plots.rewards import draw_clipped_objective, draw_distance_reward, draw_reward_sections
    from kinreach.plots.series import Band, discounted_returns, moving_mean, per_block, seed_band

#: Name -> its module, loaded when the name is first asked for: who draws one figure does not wait for all.
_MODULES = {
    "Band": "series",
    "Pentagon": "pentagon",
    "RewardMap": "maps",
    "Success": "methods",
    "discounted_returns": "series",
    "draw_camera_steps": "pictures",
    "draw_clipped_objective": "rewards",
    "draw_discounted_rewards": "learning",
    "draw_distance_reward": "rewards",
    "draw_distances": "learning",
    "draw_episode_rewards": "learning",
    "draw_error_bands": "methods",
    "draw_error_maps": "maps",
    "draw_learning_curves": "learning",
    "draw_local_optimum": "methods",
    "draw_paths": "maps",
    "draw_pentagon_angles": "pentagon",
    "draw_pentagons": "pentagon",
    "draw_pictures": "pictures",
    "draw_posture_errors": "methods",
    "draw_reward_maps": "maps",
    "draw_reward_sections": "rewards",
    "draw_success": "methods",
    "moving_mean": "series",
    "pentagon_of": "pentagon",
    "per_block": "series",
    "seed_band": "series",
    "side_camera": "pentagon",
}

__all__ = [
    "Band",
    "Pentagon",
    "RewardMap",
    "Success",
    "discounted_returns",
    "draw_camera_steps",
    "draw_clipped_objective",
    "draw_discounted_rewards",
    "draw_distance_reward",
    "draw_distances",
    "draw_episode_rewards",
    "draw_error_bands",
    "draw_error_maps",
    "draw_learning_curves",
    "draw_local_optimum",
    "draw_paths",
    "draw_pentagon_angles",
    "draw_pentagons",
    "draw_pictures",
    "draw_posture_errors",
    "draw_reward_maps",
    "draw_reward_sections",
    "draw_success",
    "moving_mean",
    "pentagon_of",
    "per_block",
    "seed_band",
    "side_camera",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
