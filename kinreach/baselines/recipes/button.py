"""Recipes for the arm that presses a button."""

from __future__ import annotations

from kinreach.baselines.recipes.base import Recipe

BUTTON_RECIPES: tuple[Recipe, ...] = ()
