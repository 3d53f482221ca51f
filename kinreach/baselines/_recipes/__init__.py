"""Recipes by name: everything that a training depends on, beside its seed.

A recipe of your own is one `register_recipe(Recipe(...))`, or a `Recipe` in a module of your own, by the name
`module:attribute`. To add one to the package, add it to the module of its task.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from kinreach._checks import check_known, shown
from kinreach._objects import load_object
from kinreach.baselines._recipes.base import Networks, Recipe
from kinreach.baselines._recipes.button import BUTTON_RECIPES
from kinreach.baselines._recipes.lift import LIFT_RECIPES
from kinreach.baselines._recipes.reach import REACH_RECIPES
from kinreach.errors import InputError

__all__ = ["RECIPES", "Networks", "Recipe", "get_recipe", "register_recipe"]

#: Recipes by name.
RECIPES: dict[str, Recipe] = {recipe.name: recipe for recipe in (*REACH_RECIPES, *BUTTON_RECIPES, *LIFT_RECIPES)}


def register_recipe(recipe: Recipe) -> Recipe:
    """Make a recipe known by its name.

    Raises:
        InputError: It is not a recipe, or another one has its name.
    """
    given: Any = recipe
    if not isinstance(given, Recipe):
        raise InputError(f"a recipe must be a Recipe, got {shown(given)}")
    name: Any = recipe.name
    if not isinstance(name, str) or name in ("", "..") or name != Path(name).name:
        raise InputError(f"the name of a recipe is that of a folder, got {shown(name)}")
    if RECIPES.setdefault(recipe.name, recipe) != recipe:
        raise InputError(f"there is a recipe {recipe.name!r} already")
    return recipe


def get_recipe(name: str) -> Recipe:
    """Return a recipe by name, or one of your own as `module:attribute`, which it is imported from and registered.

    Raises:
        UnknownNameError: The name is unknown; the message lists the known ones.
        InputError: Unknown module or attribute, or it is not a recipe.
    """
    given: Any = name
    if isinstance(given, str) and ":" in given:
        return register_recipe(load_object("recipe", name))
    check_known("recipe", name, RECIPES)
    return RECIPES[name]
