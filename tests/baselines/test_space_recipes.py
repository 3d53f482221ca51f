"""Recipes for reaching in space."""

from dataclasses import replace

import numpy as np
import pytest

import benchmarks.learners  # noqa: F401 (registers its recipes)
import kinreach  # noqa: F401 (registers the environments)
from kinreach.baselines import get_recipe
from kinreach.baselines._models import build
from kinreach.robots import get_arm


@pytest.mark.slow
def test_training_draws_around_the_volume():
    recipe = replace(get_recipe("space-ranked"), num_envs=64, steps=64, segments=1, window=64)
    env = build(recipe, 0, steps=64).env
    starts = env._draw(np.random.default_rng(0), 3000)
    box = get_arm("ur5-thesis").workcell.goals.wider(0.02, above=0.25)
    np.testing.assert_allclose([starts["goal"].min(axis=0), starts["goal"].max(axis=0)],
                               np.transpose([box.x, box.y, box.z]), atol=2e-3)  # fmt: skip
    groups = env.reset().reshape(8, 8, 16)
    assert (groups[:, :1, 6:] == groups[:, :, 6:]).all()
    assert len(np.unique(groups[:, 0, 6])) == 8
