"""What recipes make of models, and what training rewards count, as they were.

`KINREACH_KEEP=1 pytest tests/baselines/test_what_is_trained.py` keeps both as they are now; read the change in git.
"""

import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from gymnasium import spaces

from kinreach._registration import BUTTON, LIFT
from kinreach.baselines import _algorithms as algorithms
from kinreach.baselines._networks import TorchEye
from kinreach.baselines._recipes.button import BUTTON_RECIPES
from kinreach.baselines._recipes.lift import LIFT_RECIPES
from kinreach.baselines._recipes.reach import REACH_RECIPES
from kinreach.baselines._rewards import REWARDS
from kinreach.robots import get_arm
from tests.test_declared import said

DATA = Path(__file__).parents[1] / "data"


def models():
    """Algorithms with their parts, and the arguments of every recipe's model, a line each."""
    for each in algorithms.ALGORITHMS.values():
        if each.arguments.__module__ == algorithms.__name__ and not isinstance(each.model, str):
            yield said(each)
    for recipe in (*REACH_RECIPES, *BUTTON_RECIPES, *LIFT_RECIPES):
        size = len(get_arm(recipe.options.get("arm", "ur5-thesis")).home) + (recipe.environment == LIFT)
        env = SimpleNamespace(
            action_space=spaces.Discrete(54) if recipe.environment == BUTTON else spaces.Box(-1, 1, (size,)),
            get_attr=lambda name, index: [SimpleNamespace(episodes=f"episodes of {name} {index}")],
            looks="looks",
        )
        arguments = algorithms.ALGORITHMS[recipe.algorithm].arguments(recipe, env, 1000)
        yield f"{recipe.name}: {said(arguments)}"


def test_models_are_what_they_were(monkeypatch):
    drawn = np.random.default_rng(0).normal(size=(9, 30)).round(2)
    drawn[:, 2] = 0.5  # does not vary
    monkeypatch.setattr(algorithms, "first_observations", lambda environment, options, *, seed: drawn + seed)
    lines, path = sorted(models()), DATA / "declared" / "models.txt"
    if os.environ.get("KINREACH_KEEP"):
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    kept = path.read_text(encoding="utf-8").splitlines()
    assert [line for line in kept if line not in lines] == []
    assert len(kept) > 25


def steps():
    """A step of 40 environments, with all that any training reward reads."""
    rng, count = np.random.default_rng(0), 40
    seen = rng.uniform(-0.1, 0.1, (count, 22))
    seen[:, :3] += (0.45, 0.0, -0.1)
    seen[:, 4] = rng.uniform(0.015, 0.035, count)
    seen[:, 6:9] = (0.45, 0.35, 0.3) + 0.5 * seen[:, 6:9]  # the button
    lifting, moving = seen.copy(), seen.copy()
    lifting[:, 8:14] += get_arm("ur5-thesis").home
    lifting[::3, 15:17] = 0.001
    moving[:, 4:10] = get_arm("ur5-thesis").home + rng.uniform(-0.2, 0.2, (count, 6))
    info = {
        "distance": rng.uniform(0, 0.1, count), "posture_error": rng.uniform(0, 1, count), "reached_lately": 0.7,
        "impossible": rng.uniform(size=count) < 0.3, "held": rng.uniform(size=count) < 0.5,
        "clearance": rng.uniform(-0.01, 0.15, count),
        "reward_terms": {name: rng.uniform(-1, 1, count) for name in ("wrong_press", "distance", "touch", "collision")},
    }  # fmt: skip
    own = {"grasp-guided": lifting, "level": moving}
    rewards = rng.uniform(-120, 20, count)
    return {name: reward(rewards, {**info, "observation": own.get(name, seen)}) for name, reward in REWARDS.items()}


def test_training_rewards_count_what_they_did():
    found, path = steps(), DATA / "rewards.json"
    if os.environ.get("KINREACH_KEEP"):
        rows = {name: [round(float(value), 9) for value in values] for name, values in found.items()}
        path.write_text(json.dumps(rows).replace("], ", "],\n") + "\n", encoding="utf-8")
    kept = json.loads(path.read_text(encoding="utf-8"))
    for name, values in kept.items():
        assert np.isfinite(values).all(), name
        np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-7, err_msg=name)
    assert len(kept) >= 8


def test_an_eye_begins_with_the_softmax_itself():
    assert TorchEye().sharpness.item() == 1.0
