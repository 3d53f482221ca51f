"""What is trained, with what, for how long: one recipe a name. Nothing else decides how a policy comes about.

To add a recipe, add it to the module of its task; to add an algorithm, add it to `ALGORITHMS` of
`kinreach.baselines.models`.
"""

from __future__ import annotations

from collections.abc import Mapping

from kinreach.baselines.recipes.base import Networks, Recipe
from kinreach.baselines.recipes.button import BUTTON_RECIPES
from kinreach.baselines.recipes.reach import REACH_RECIPES
from kinreach.checks import check_known

__all__ = ["RECIPES", "Networks", "Recipe", "get_recipe"]

#: Recipes by name.
RECIPES: Mapping[str, Recipe] = {recipe.name: recipe for recipe in (*REACH_RECIPES, *BUTTON_RECIPES)}


def get_recipe(name: str) -> Recipe:
    """A recipe by name.

    Raises:
        UnknownNameError: There is none of that name; the message lists those that there are.
    """
    check_known("recipe", name, RECIPES)
    return RECIPES[name]
