"""The button by DQN, and in the world of the course report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from kinreach._rotations import wrapped
from kinreach.baselines import Algorithm, Networks, Recipe, get_recipe, register_algorithm, register_recipe
from kinreach.baselines._rewards import FIRST_PENALTY, LAST_PENALTY, POSTURE_WEIGHT, SCALE, Array
from kinreach.envs._button.button_task import TUNED
from kinreach.kinematics import Arm3Kinematics

#: 4 s, as in the course project's test; its steps are a tenth as long.
REPORT_OPTIONS = {"actuation": "report", "max_episode_steps": 1000}
#: Rewards of a step that ends near the target and of a wrong press in the default world.
NEAR, WRONG = TUNED.near, TUNED.wrong_press


def press_pays(rewards: Array, info: Mapping[str, Any]) -> Array:
    """Return what the default world pays for the same step: waiting near the target is worth less than a press."""
    terms = info["reward_terms"]
    near, wrong = NEAR * (terms["near"] != 0), WRONG * (terms["wrong_press"] != 0)
    return SCALE * (terms["distance"] + near + wrong + terms["press"])


def press_guided(rewards: Array, info: Mapping[str, Any]) -> Array:
    """Return the same, less 0.3 times the way that is left to the posture that the arm reaches soonest.

    The penalty of a wrong press grows with the share of episodes that reach the goal, as in `kinreach`'s own.
    """
    observation, terms = info["observation"], info["reward_terms"]
    error = np.linalg.norm(way_to_soonest(observation), axis=1)
    penalty = FIRST_PENALTY + (LAST_PENALTY - FIRST_PENALTY) * info["reached_lately"] ** 2
    wrong = 1.0 * (terms["wrong_press"] != 0)
    return SCALE * (terms["distance"] + terms["press"] - penalty * wrong - POSTURE_WEIGHT * error)


@cache
def _kinematics() -> Arm3Kinematics:
    return Arm3Kinematics(base="world")


def way_to_soonest(observation: Array) -> Array:
    """Return how far joints are from the posture that the base reaches soonest from where it starts [rad], (n, 3)."""
    q = np.arctan2(observation[:, 3:6], observation[:, :3])
    found = _kinematics().batch(observation[:, 6:9])
    turns = np.where(found.valid, np.abs(found.q[..., 0]), np.inf)
    way: Array = wrapped(found.q[np.arange(len(q)), turns.argmin(axis=1)] - q)
    return way


def _on_report_actuation(base: str, name: str, summary: str, *, reward: str | None = None, **options: Any) -> Recipe:
    recipe = get_recipe(base)
    return register_recipe(
        replace(
            recipe,
            name=name,
            summary=summary,
            steps=300_000,
            reward=recipe.reward if reward is None else f"{__name__}:{reward}",
            options={**REPORT_OPTIONS, **options},
            settings={**recipe.settings, "gamma": 0.99, "gae_lambda": 0.95},  # what pays is more steps away
        )
    )


def _dqn(name: str, summary: str, *, options: Mapping[str, Any], gamma: float, reward: str = "guided") -> Recipe:
    return register_recipe(
        Recipe(
            name=name,
            summary=summary,
            environment=get_recipe("button").environment,
            options=options,
            algorithm="DQN",
            steps=300_000,
            num_envs=64,
            reward=reward,
            networks=Networks(hidden=(128, 128), activation="relu", features="button"),
            settings={
                "learning_rate": 5e-4,
                "buffer_size": 200_000,
                "learning_starts": 10_000,
                "batch_size": 256,
                "train_freq": 1,
                "gradient_steps": 8,
                "gamma": gamma,
                "n_steps": 3,
                "target_update_interval": 6_400,
                "exploration_initial_eps": 0.1,
                "exploration_final_eps": 0.1,
            },
            segments=3,
            window=6_400,
        )
    )


register_algorithm(Algorithm("DQN", "stable_baselines3:DQN"))
button_dqn = _dqn(
    "button-dqn", "DQN with the training reward of `button`.", options=get_recipe("button").options, gamma=0.95
)
button_report_actuation = _on_report_actuation(
    "button",
    "button-report-actuation",
    "As `button`, in the world of the course report.",
    reward="press_guided",
)
button_report_both = _on_report_actuation(
    "button-report",
    "button-report-both",
    "The course report's own system: its rewards alone, in its world.",
)
button_report_controls = _on_report_actuation(
    "button-report",
    "button-report-controls",
    "As `button-report-both`, with the controls observed: the whole state.",
    controls=True,
)
button_report_frames = _on_report_actuation(
    "button-report",
    "button-report-frames",
    "As `button-report-both`, with the last four observations side by side.",
    frames=4,
)
button_report_press = _on_report_actuation(
    "button-report",
    "button-report-press",
    "As `button-report-frames`, with the default world's rewards: waiting near the target is worth less than a press.",
    reward="press_pays",
    frames=4,
)
button_dqn_report_actuation = _dqn(
    "button-dqn-report-actuation",
    "DQN with the training reward of `button-report-actuation`.",
    reward=f"{__name__}:press_guided",
    options=REPORT_OPTIONS,
    gamma=0.99,
)
