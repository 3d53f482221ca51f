"""Recipes of the package, changed in one thing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from kinreach._checks import Floats
from kinreach._registration import LIFT
from kinreach.baselines import Recipe, get_recipe, register_recipe
from kinreach.baselines.expert import GRIPPER
from kinreach.envs.real_arm import NOISE

ppo_multi_ending = register_recipe(
    replace(
        get_recipe("ppo-multi"),
        name="ppo-multi-ending",
        summary="As ppo-multi, but reaching ends the episode in training too, as in the thesis: what loitering pays.",
        options={"backend": "kinematic"},
    )
)
pixels_light = register_recipe(
    replace(
        get_recipe("pixels-single"),
        name="pixels-light",
        summary="As pixels-single, with pictures up to four times as dark or as bright.",
        options={**get_recipe("pixels-single").options, "exposure": 4.0},
    )
)
space_ranked = register_recipe(
    replace(
        get_recipe("space-single"),
        name="space-ranked",
        summary="As ranked-single, with goals in a volume, tool directions up to 30 degrees off the vertical "
        "and other starts.",
        algorithm="RankedPPO",
        reward="dense",
        steps=8_000_000,
        settings=get_recipe("ranked-single").settings,
    )
)


def _moving_in_world(name: str, what: str, **options: Any) -> Recipe:
    """Register `ppo-moving` in a world of its own."""
    recipe = get_recipe("ppo-moving")
    return register_recipe(
        replace(recipe, name=name, summary=f"As ppo-moving, for {what}.", options={**recipe.options, **options})
    )


ppo_moving_noise = _moving_in_world(
    "ppo-moving-noise", "balls at 0.4 m/s alone that are seen with 3 mm of noise", speeds=(0.4,), noise=0.003
)
ppo_moving_delay = _moving_in_world(
    "ppo-moving-delay", "balls at 0.4, 0.8 and 1.2 m/s that are seen 200 ms late", speeds=(0.4, 0.8, 1.2), delay=0.2
)
ppo_moving_delay_08 = _moving_in_world(
    "ppo-moving-delay-08", "balls at 0.8 m/s alone that are seen 200 ms late", speeds=(0.8,), delay=0.2
)
ppo_moving_noise_10 = _moving_in_world(
    "ppo-moving-noise-10", "balls at 0.4 m/s alone that are seen with 10 mm of noise", speeds=(0.4,), noise=0.01
)
ppo_moving_hidden = _moving_in_world(
    "ppo-moving-hidden", "balls that no camera sees in a strip of 0.2 m", speeds=(0.4, 0.8, 1.2), hidden=0.2
)
gradient_moving_down = register_recipe(
    replace(
        get_recipe("gradient-moving"),
        name="gradient-moving-down",
        summary="As gradient-moving, with the gripper's corners kept above the table and the tool down.",
        settings={**get_recipe("gradient-moving").settings, "feelers": GRIPPER.tolist(), "down": 0.1},
    )
)
gradient_moving_late = register_recipe(
    replace(
        get_recipe("gradient-moving-clear"),
        name="gradient-moving-late",
        summary="As gradient-moving-clear, for balls that are seen 200 ms late.",
        options={**get_recipe("gradient-moving-clear").options, "delay": 0.2},
    )
)
gradient_moving_late_weak = register_recipe(
    replace(
        gradient_moving_late,
        name="gradient-moving-late-weak",
        summary="As gradient-moving-late, with arms of 60 to 100 % of the limits.",
        options={**gradient_moving_late.options, "randomise": {"strength": (0.6, 1.0)}},
    )
)
gradient_moving_rough = register_recipe(
    replace(
        get_recipe("gradient-moving-clear"),
        name="gradient-moving-rough",
        summary="As gradient-moving-clear, with arms of 60 to 100 % of the limits, and sights with noise and outliers.",
        options={
            **get_recipe("gradient-moving-clear").options,
            "outliers": 0.03,
            "randomise": {"strength": (0.6, 1.0), "noise": (NOISE, 0.006)},
        },
    )
)
_LATE, _PPO = get_recipe("gradient-moving-late"), get_recipe("ppo-moving")
ppo_moving_steered_late = register_recipe(
    replace(
        _PPO,
        name="ppo-moving-steered-late",
        summary="PPO with the observations and actions of gradient-moving-late; collisions are ignored.",
        options={"sights": 20, "delay": 0.2, "speeds": (0.4, 0.8, 1.2), "collisions": False},
        networks=_LATE.networks,
        settings={
            **_PPO.settings,
            "low": _LATE.settings["low"],
            "high": _LATE.settings["high"],
            "gamma": 0.97,
            "exploration": {"first": 0.5, "last": 0.05, "until": 0.8},
        },
    )
)


def touches(rewards: Floats, info: Mapping[str, Any]) -> Floats:
    """A training reward: 1 for a touch that counts."""
    touched: Floats = info["reward_terms"]["touch"]
    return touched


ppo_moving_tuned_late = register_recipe(
    replace(
        ppo_moving_steered_late,
        name="ppo-moving-tuned-late",
        summary="As ppo-moving-steered-late, to begin with a policy of gradient-moving-late; touches alone count.",
        reward="benchmarks.learners.variants:touches",
        steps=2_000_000,
        settings={
            **ppo_moving_steered_late.settings,
            "gamma": 0.99,
            "exploration": {"first": 0.03, "last": 0.03, "until": 1.0},
            "adaptive": {"first": 1e-4, "target_kl": 0.005, "decay": 0.5},
        },
    )
)
ppo_lift_single = register_recipe(
    replace(
        get_recipe("ppo-single"),
        name="ppo-lift-single",
        summary="As ppo-single, for grasping: one try an object, a critic, and the environment's own reward.",
        environment=LIFT,
        reward="own",
    )
)
ppo_lift_multi_unguided = register_recipe(
    replace(
        get_recipe("ppo-lift-multi"),
        name="ppo-lift-multi-unguided",
        summary="As ppo-lift-multi, with the environment's own reward.",
        reward="own",
    )
)
ppo_lift_multi_careful = register_recipe(
    replace(
        get_recipe("ppo-lift-multi"),
        name="ppo-lift-multi-careful",
        summary="As ppo-lift-multi, with γ 0.95, smaller updates, and less noise at the end.",
        steps=1_200_000,
        settings={
            **get_recipe("ppo-lift-multi").settings,
            "gamma": 0.95,
            "exploration": {"first": 0.3, "last": 0.05, "until": 0.7},
            "adaptive": {"first": 1e-3, "target_kl": 0.01, "decay": 0.5, "highest": 2e-3},
        },
    )
)
