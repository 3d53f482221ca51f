"""Recipes for the arm that presses a button."""

from __future__ import annotations

from kinreach._registration import BUTTON
from kinreach.baselines._recipes.base import Networks, Recipe

#: Episodes last 100 steps, and so does a rollout: environments that begin together would else all be in the same part
#: of their episodes in every update.
_PPO = {
    "n_steps": 100,
    "n_epochs": 8,
    "minibatches": 8,
    "gamma": 0.95,
    "gae_lambda": 0.8,
    "clip_range": 0.3,
    "target_kl": 0.06,
    "vf_coef": 0.5,
    "ent_coef": 0.003,
    "max_grad_norm": 0.5,
    "adaptive": {"first": 2e-3, "target_kl": 0.03, "factor": 1.0, "decay": 1.0},
    "exploration": None,
}


def _ppo(name: str, summary: str, *, reward: str) -> Recipe:
    return Recipe(
        name=name,
        summary=summary,
        environment=BUTTON,
        options={"max_episode_steps": 100},
        algorithm="AdaptivePPO",
        steps=1_800_000,
        num_envs=64,
        reward=reward,
        networks=Networks(hidden=(128, 128), activation="tanh", features="button"),
        settings=_PPO,
        window=20_480,
    )


BUTTON_RECIPES = (
    _ppo(
        "button",
        "PPO; in training only, the reward prefers the posture of the closed form.",
        reward="guided",
    ),
    _ppo(
        "button-report",
        "The same from the environment's reward alone.",
        reward="scaled",
    ),
)
