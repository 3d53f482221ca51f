"""No reinforcement learning: the network of `ranked-single`, regressed on the closed form's postures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from kinreach._checks import Floats
from kinreach._registration import SINGLE, SINGLE_KINEMATIC
from kinreach.baselines import Algorithm, Recipe, SB3VecEnv, get_recipe, register_algorithm, register_recipe
from kinreach.baselines._algorithms import actor_arguments, in_tries
from kinreach.baselines._descent import GradientLearner, Objective
from kinreach.baselines.expert import tool_down_postures
from kinreach.baselines.random_arms import ur5
from kinreach.envs._reach.reach_task import SINGLE_STEP, UR5_LAYOUT
from kinreach.errors import InputError
from kinreach.vision._goal_view import goals_in_world


class Regression(GradientLearner):
    """Regress the actor on the closed form's postures, in the UR5's single-step task."""

    def objective(self, observations: Floats) -> Objective:
        """Return the mean squared error of the postures, as actions."""
        views = observations[:, UR5_LAYOUT.goal]
        goals = goals_in_world(ur5().arm, views, np.ones((len(views), 2), dtype=np.bool_))
        postures = tool_down_postures(ur5(), goals) / SINGLE_STEP.scale
        wanted = torch.as_tensor(postures, dtype=torch.float32)
        return lambda means, rows: (means - wanted[rows]).square().mean()


def regression_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Return those of an actor; `tries` is an argument of the environments.

    Raises:
        InputError: The task is not the UR5's single-step task, whose postures the closed form gives.
    """
    arm = recipe.options.get("arm", "ur5-thesis")
    if recipe.environment not in (SINGLE, SINGLE_KINEMATIC) or arm != "ur5-thesis":
        raise InputError(f"regression is on postures of the UR5 in {SINGLE}, not of {arm!r} in {recipe.environment}")
    arguments = actor_arguments(recipe, env, planned)
    del arguments["tries"]
    return arguments


register_algorithm(Algorithm("Regression", Regression, arguments=regression_arguments, vec_env=in_tries))
ik_net = register_recipe(
    replace(
        get_recipe("ranked-single"),
        name="ik-net",
        summary="No reinforcement learning: the network of `ranked-single`, regressed on the closed form's postures.",
        algorithm="Regression",
        reward="own",
        # samples and updates of ranked PPO
        settings={**get_recipe("gradient-moving").settings, "tries": 1, "minibatches": 4},
    )
)
