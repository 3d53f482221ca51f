"""Trainings that are over in a moment, and interrupted ones."""

from dataclasses import replace

import numpy as np
import pytest

import benchmarks.learners  # noqa: F401 (registers its recipes)
from kinreach.baselines import _training as training
from kinreach.baselines import get_recipe, load_policy, train
from kinreach.baselines._recipes import RECIPES

#: Small versions of one on-policy, one ranked and one off-policy recipe, of three segments each.
SMALL = {
    "ppo-multi": {"num_envs": 16, "steps": 768, "segments": 3, "window": 64},
    "ranked-single": {"num_envs": 64, "steps": 192 * 4, "segments": 3, "window": 64,
                      "settings": {**RECIPES["ranked-single"].settings, "n_epochs": 2, "minibatches": 2}},
    "sac-single": {"num_envs": 8, "steps": 240, "segments": 3, "window": 16,
                   "settings": {**RECIPES["sac-single"].settings, "learning_starts": 40, "batch_size": 16}},
    # the last with a buffer that is full, and an odd number of updates, after the first segment
    "td3-multi": {"num_envs": 8, "steps": 240, "segments": 3, "window": 16,
                  "settings": {**RECIPES["td3-multi"].settings, "learning_starts": 40, "batch_size": 16,
                               "buffer_size": 72, "gradient_steps": 3}},
}  # fmt: skip


def small(name):
    return replace(get_recipe(name), **SMALL[name])


def weights(path):
    policy = load_policy(path)
    return np.concatenate([part.ravel() for layer in policy.network.layers for part in layer])


def interrupted(recipe, folder, kept, **options):
    """Ctrl-C in the segment after `kept` whole ones."""
    saved = 0

    def stop(done, planned, row):
        if saved >= kept:
            raise KeyboardInterrupt

    def count(*arguments):
        nonlocal saved
        save(*arguments)
        saved += 1

    save, training.save_checkpoint = training.save_checkpoint, count
    try:
        with pytest.raises(KeyboardInterrupt):
            train(recipe, folder, seed=4, progress=stop, **options)
    finally:
        training.save_checkpoint = save
