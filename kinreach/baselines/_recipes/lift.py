"""Recipes for grasping, lifting and moving objects: those of reaching, with what is different."""

from __future__ import annotations

from dataclasses import replace

from kinreach._registration import LIFT, PICK_AND_PLACE, PUSH
from kinreach.baselines._recipes.base import Networks
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

_PICK_AND_PLACE = replace(
    PPO_MULTI,
    name="pick-and-place",
    summary="PPO in steps of 40 ms; in training it is paid for coming near, for holding, and for the object's way.",
    environment=PICK_AND_PLACE,
    steps=5_000_000,
    num_envs=128,
    reward="moved",
    networks=Networks(hidden=(256, 256), activation="silu", features="scaled"),
    settings={
        **PPO_MULTI.settings,
        "n_steps": 32,
        "minibatches": 8,
        "gamma": 0.97,
        "gae_lambda": 0.95,
        "exploration": {"first": 0.5, "last": 0.1, "until": 0.8},
        "adaptive": {"first": 1e-3, "target_kl": 0.02, "decay": 0.5},
    },
    options={},
)

LIFT_RECIPES = (
    _LIFT,
    _PICK_AND_PLACE,
    replace(_PICK_AND_PLACE, name="push", environment=PUSH, summary="As pick-and-place, with closed fingers."),
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
