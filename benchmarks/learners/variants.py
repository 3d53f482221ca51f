"""Recipes of the package, changed in one thing."""

from __future__ import annotations

from dataclasses import replace

from kinreach.baselines import get_recipe, register_recipe
from kinreach.baselines._expert import GRIPPER

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
        summary="As single, with goals in a volume, tool directions up to 30 degrees off the vertical "
        "and other starts.",
        algorithm="RankedPPO",
        reward="dense",
        steps=8_000_000,
        settings=get_recipe("single").settings,
    )
)
moving_clear = register_recipe(
    replace(
        get_recipe("moving"),
        name="moving-clear",
        summary="As moving, with the gripper's corners kept above the table and the tool down.",
        settings={**get_recipe("moving").settings, "feelers": GRIPPER.tolist(), "down": 0.1},
    )
)
