"""The thesis's recipes with its cameras, with its joint tolerance, and with goals in pictures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from kinreach.baselines import Recipe, get_recipe, register_recipe

#: The thesis's cameras (3.4.2), with the errors of 1000 rendered looks.
_SEEN = {"observation": "camera", "pipeline": "thesis", "looks": 1000}


def _changed(base: str, change: str, summary: str, **options: Any) -> Recipe:
    recipe = get_recipe(base)
    name, options = f"{base}-{change}", {**recipe.options, **options}
    return register_recipe(replace(recipe, name=name, summary=f"{base} {summary}", options=options))


_AS_SEEN = "from goals as the thesis's pipeline sees them: with errors of 1000 rendered looks."
thesis_ppo_single_camera = _changed("thesis-ppo-single", "camera", _AS_SEEN, **_SEEN)
thesis_ppo_multi_camera = _changed("thesis-ppo-multi", "camera", _AS_SEEN, **_SEEN)
thesis_ppo_single_image = _changed(
    "thesis-ppo-single",
    "image",
    "from goals as places in both pictures and depths, in place of points in metres.",
    goal_in="image",
)
thesis_ppo_single_tolerance = _changed(
    "thesis-ppo-single",
    "tolerance",
    "with joints that end up to 0.01 rad from where they were sent, the thesis's tolerance.",
    tolerance=0.01,
)
