"""Recipes for grasping, lifting and moving objects: those of reaching, with what is different."""

from __future__ import annotations

from dataclasses import replace

from kinreach._registration import LIFT, PICK_AND_PLACE, PUSH
from kinreach.baselines._recipes.base import Networks, Recipe
from kinreach.baselines._recipes.reach import PPO_MULTI, RANKED_SINGLE

_LIFT = replace(
    RANKED_SINGLE,
    name="ranked-lift",
    summary="Ranked PPO: eight grasps tried for every ball and judged by geometry; nothing is lifted in training.",
    environment=LIFT,
    steps=1_000_000,
    reward="grasp",
    blur=0.0,
    # a grasp need not be as exact as a touch
    settings={**RANKED_SINGLE.settings, "exploration": {"first": 0.2, "last": 5e-4, "until": 0.85}},
)

_IMITATED_PICK = Recipe(
    name="imitated-pick-and-place",
    summary="Imitates the script of the comparison, by its answers in the states that the learner comes to (DAgger).",
    environment=PICK_AND_PLACE,
    algorithm="Imitation",
    steps=192_000,
    num_envs=64,
    segments=4,
    window=9_600,
    networks=Networks(hidden=(256, 256), activation="silu", features="objects"),
    settings={
        "expert": "kinreach.baselines.inside:PickAndPlaceScript",
        "memory": 200_000,
        "n_steps": 50,
        "updates": 150,
        "batch_size": 640,
        "exploration": {"first": 0.01, "last": 0.01, "until": 1.0},
        "adaptive": {"first": 1e-3, "target_kl": 0.02, "decay": 1.0},
    },
)
_IMITATED_PUSH = replace(
    _IMITATED_PICK,
    name="imitated-push",
    environment=PUSH,
    settings={**_IMITATED_PICK.settings, "expert": "kinreach.baselines.inside:PushScript"},
)

LIFT_RECIPES = (
    _LIFT,
    _IMITATED_PICK,
    _IMITATED_PUSH,
    replace(
        PPO_MULTI,
        name="ppo-lift-multi",
        summary="PPO in steps of 40 ms; in training the closed form gives the direction.",
        environment=LIFT,
        steps=1_300_000,
        num_envs=128,
        reward="grasp-guided",
        networks=Networks(hidden=(256, 256), activation="silu", features="grasps"),
        settings={
            **PPO_MULTI.settings,
            "n_steps": 32,
            "minibatches": 8,
            "gamma": 0.9,
            "gae_lambda": 0.95,
            "exploration": {"first": 0.3, "last": 0.1, "until": 0.8},
            "adaptive": {"first": 1e-3, "target_kl": 0.02, "decay": 0.5},
        },
        options={"steps": "multi"},
    ),
    replace(
        _LIFT,
        name="ranked-lift-range",
        summary="As ranked-lift, for balls, cubes and cylinders of 15 to 35 mm.",
        steps=2_000_000,
        networks=replace(_LIFT.networks, hidden=(128, 128)),
        options={**_LIFT.options, "shapes": ["ball", "cube", "cylinder"], "sizes": [0.015, 0.035]},
    ),
)
