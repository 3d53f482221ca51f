"""The button by DQN, and on the actuation of the course report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from kinreach.baselines import Algorithm, Networks, Recipe, get_recipe, register_algorithm, register_recipe

#: 2 s; its steps are a tenth as long.
_REPORT = {"actuation": "report", "max_steps": 500}


def _on_report_actuation(base: str, name: str, summary: str, **options: Any) -> Recipe:
    recipe = get_recipe(base)
    return register_recipe(
        replace(
            recipe,
            name=name,
            summary=summary,
            steps=1_200_000,
            options={**_REPORT, **options},
            settings={**recipe.settings, "gamma": 0.99, "gae_lambda": 0.95},  # what pays is more steps away
        )
    )


def _dqn(name: str, summary: str, *, options: Mapping[str, Any], gamma: float) -> Recipe:
    return register_recipe(
        Recipe(
            name=name,
            summary=summary,
            environment=get_recipe("button").environment,
            options=options,
            algorithm="DQN",
            steps=300_000,
            num_envs=64,
            reward="guided",
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
    "button", "button-report-actuation", "As `button`, on the actuation of the course report."
)
button_report_both = _on_report_actuation(
    "button-report",
    "button-report-both",
    "The course report's own system: its reward alone, on its actuation.",
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
button_guided_controls = _on_report_actuation(
    "button",
    "button-guided-controls",
    "As `button-report-actuation`, with the controls observed: the report's gears, and nothing hidden.",
    controls=True,
)
button_dqn_report_actuation = _dqn(
    "button-dqn-report-actuation",
    "As `button-dqn`, on the actuation of the course report.",
    options=_REPORT,
    gamma=0.99,
)
