"""Recipes for grasping and lifting."""

from __future__ import annotations

from dataclasses import replace

from kinreach._registration import LIFT
from kinreach.baselines._recipes.base import Networks, Recipe
from kinreach.baselines._recipes.reach import RANKED

#: A grasp need not be as exact as a touch.
_SETTINGS = {**RANKED, "exploration": {"first": 0.2, "last": 5e-4, "until": 0.85}}

_LIFT = Recipe(
    name="lift",
    summary="Ranked PPO: eight grasps tried for every ball and judged by geometry; nothing is lifted in training.",
    environment=LIFT,
    algorithm="RankedPPO",
    steps=1_000_000,
    num_envs=2048,
    reward="grasp",
    margin=0.02,
    networks=Networks(activation="silu", features="goal waves", posture=True),
    settings=_SETTINGS,
    window=20_480,
    options={"backend": "kinematic"},
)

_MULTI = Recipe(
    name="lift-multi",
    summary="PPO in steps of 40 ms; in training the closed form says which way to go.",
    environment=LIFT,
    algorithm="AdaptivePPO",
    steps=1_000_000,
    num_envs=128,
    reward="grasp-guided",
    networks=Networks(hidden=(128, 128), activation="silu", features="scaled"),
    settings={
        "n_steps": 32,
        "n_epochs": 4,
        "minibatches": 4,
        "gamma": 0.97,
        "gae_lambda": 0.95,
        "clip_range": 0.2,
        "vf_coef": 0.5,
        "max_grad_norm": 0.5,
        "exploration": {"first": 0.5, "last": 0.1, "until": 0.8},
        "adaptive": {"first": 1e-3, "target_kl": 0.02},
        "adam": {"eps": 1e-5},
    },
    window=20_480,
    options={"steps": "multi"},
)

LIFT_RECIPES = (
    _LIFT,
    _MULTI,
    replace(
        _LIFT,
        name="lift-range",
        summary="As lift, for balls, cubes and cylinders of 15 to 35 mm.",
        steps=2_000_000,
        networks=replace(_LIFT.networks, hidden=(128, 128)),
        options={"backend": "kinematic", "shapes": ["ball", "cube", "cylinder"], "sizes": [0.015, 0.035]},
    ),
)
