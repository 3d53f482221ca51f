"""Recipes for the arm that presses a button."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from kinreach.baselines.recipes.base import Networks, Recipe
from kinreach.registration import BUTTON

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
_DQN = {
    "learning_rate": 5e-4,
    "buffer_size": 200_000,
    "learning_starts": 10_000,
    "batch_size": 256,
    "train_freq": 1,
    "gradient_steps": 8,
    "gamma": 0.95,
    "n_steps": 3,
    "target_update_interval": 6_400,
    "exploration_initial_eps": 0.1,
    "exploration_final_eps": 0.1,
}
_TUNED = {"max_steps": 100}
#: 2 s; its steps are a tenth as long.
_REPORT = {"actuation": "report", "max_steps": 500}
#: What pays is more steps away.
_LATER = {"gamma": 0.99, "gae_lambda": 0.95}


def _ppo(name: str, summary: str, *, reward: str, steps: int, options: Mapping[str, Any], **settings: Any) -> Recipe:
    return Recipe(
        name=name,
        summary=summary,
        environment=BUTTON,
        options=options,
        algorithm="AdaptivePPO",
        steps=steps,
        num_envs=64,
        reward=reward,
        networks=Networks(hidden=(128, 128), activation="tanh", features="button"),
        settings={**_PPO, **settings},
        window=20_480,
    )


def _dqn(name: str, summary: str, *, options: Mapping[str, Any], **settings: Any) -> Recipe:
    return Recipe(
        name=name,
        summary=summary,
        environment=BUTTON,
        options=options,
        algorithm="DQN",
        steps=300_000,
        num_envs=64,
        reward="guided",
        networks=Networks(hidden=(128, 128), activation="relu", features="button"),
        settings={**_DQN, **settings},
        segments=3,
        window=6_400,
    )


BUTTON_RECIPES = (
    _ppo(
        "button",
        "PPO; in training only, the closed form says which posture to come near.",
        reward="guided",
        steps=1_800_000,
        options=_TUNED,
    ),
    _ppo(
        "button-report",
        "The same from the environment's reward alone, which is that of the course report.",
        reward="scaled",
        steps=1_800_000,
        options=_TUNED,
    ),
    _dqn("button-dqn", "DQN with the training reward of `button`.", options=_TUNED),
    _ppo(
        "button-report-actuation",
        "As `button`, on the actuation of the course report.",
        reward="guided",
        steps=1_200_000,
        options=_REPORT,
        **_LATER,
    ),
    _ppo(
        "button-report-both",
        "The course report's own system: its reward alone, on its actuation.",
        reward="scaled",
        steps=1_200_000,
        options=_REPORT,
        **_LATER,
    ),
    _ppo(
        "button-report-controls",
        "As `button-report-both`, with the controls observed: the whole state.",
        reward="scaled",
        steps=1_200_000,
        options={**_REPORT, "controls": True},
        **_LATER,
    ),
    _ppo(
        "button-report-frames",
        "As `button-report-both`, with the last four observations side by side.",
        reward="scaled",
        steps=1_200_000,
        options={**_REPORT, "frames": 4},
        **_LATER,
    ),
    _ppo(
        "button-guided-controls",
        "As `button-report-actuation`, with the controls observed: the report's gears, and nothing hidden.",
        reward="guided",
        steps=1_200_000,
        options={**_REPORT, "controls": True},
        **_LATER,
    ),
    _dqn(
        "button-dqn-report-actuation",
        "As `button-dqn`, on the actuation of the course report.",
        options=_REPORT,
        gamma=0.99,
    ),
)
