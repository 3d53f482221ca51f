"""The notebooks' figures: each function takes data and returns a matplotlib `Figure` in one style.

Notebooks run in their own folder and import `figures`; from the repository's folder it is `notebooks.figures`. The
functions do not check their arguments.
"""

from kinreach.plots import draw_error_maps

from .learning import (
    draw_discounted_rewards,
    draw_distances,
    draw_episode_rewards,
    draw_learning_curves,
    moving_mean,
    seed_band,
)
from .maps import RewardMap, draw_paths, draw_reward_maps
from .methods import Success, draw_error_bands, draw_local_optimum, draw_posture_errors, draw_success
from .pentagon import Pentagon, draw_pentagon_angles, draw_pentagons, joint_origins, pentagon_of, side_camera
from .pictures import draw_camera_steps, draw_named_places, draw_pictures, places_in_picture
from .rewards import draw_clipped_objective, draw_distance_reward, draw_reward_sections

__all__ = [
    "Pentagon",
    "RewardMap",
    "Success",
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
    "draw_named_places",
    "draw_paths",
    "draw_pentagon_angles",
    "draw_pentagons",
    "draw_pictures",
    "draw_posture_errors",
    "draw_reward_maps",
    "draw_reward_sections",
    "draw_success",
    "joint_origins",
    "moving_mean",
    "pentagon_of",
    "places_in_picture",
    "seed_band",
    "side_camera",
]
