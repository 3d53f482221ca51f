"""The thesis's settings with stable-baselines3's PPO: values free, means in units of half the range."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from kinreach.baselines import Networks, Recipe, get_recipe, register_recipe


def _sb3(base: str, *, n_steps: int, **changed: Any) -> Recipe:
    recipe = get_recipe(base)
    settings = {name: value for name, value in recipe.settings.items() if name not in ("clip_range_vf", "gain")}
    return register_recipe(replace(recipe, algorithm="PPO", settings={**settings, "n_steps": n_steps}, **changed))


sb3_single = _sb3(
    "thesis-ppo-single",
    name="sb3-single",
    summary="thesis-ppo-single with stable-baselines3's PPO as it comes, which begins to explore half the range.",
    num_envs=1,
    n_steps=128,
    networks=Networks(),
    window=100,
)
sb3_multi = _sb3(
    "thesis-ppo-multi",
    name="sb3-multi",
    summary="thesis-ppo-multi with stable-baselines3's PPO as it comes, which begins to explore half the range.",
    num_envs=1,
    n_steps=4096,
    networks=Networks(),
)
sb3_multi_long = _sb3(
    "thesis-ppo-multi",
    name="sb3-multi-long",
    summary="thesis-ppo-multi with stable-baselines3's PPO, 128 arms, 33 times as many steps: was time lacking?",
    steps=5_000_000,
    num_envs=128,
    n_steps=32,
    window=20_480,
    trace_after=None,
)
