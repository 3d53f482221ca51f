"""Imitation of the controller before PPO, in the report's world."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("torch")
from benchmarks.learners import button_report_demonstrated, button_report_demonstrated_19
from kinreach._registration import BUTTON
from kinreach.baselines._models import build


@pytest.mark.slow
@pytest.mark.parametrize(
    ("demonstrated", "size"), [(button_report_demonstrated, 22), (button_report_demonstrated_19, 19)]
)
def test_imitation_answers_more_often_as_the_controller_does(demonstrated, size):
    settings = {**demonstrated.settings, "rounds": 4, "length": 60, "n_steps": 10, "n_epochs": 1}
    recipe = replace(demonstrated, num_envs=16, steps=160, settings=settings)
    trainee = build(recipe, 0, steps=160)
    model = trainee.model
    env = gym.make_vec(BUTTON, num_envs=16, vectorization_mode="vector_entry_point", **recipe.options)
    observations, _ = env.reset(seed=5)
    assert observations.shape == (16, size)
    answers = model.controller.actions(observations)
    model.controller.restart()
    before = model.policy.evaluate_actions(*map(as_tensor, (observations, answers)))[1].mean().item()
    model.learn(160)
    after = model.policy.evaluate_actions(*map(as_tensor, (observations, answers)))[1].mean().item()
    assert model.num_timesteps == 160
    assert before == pytest.approx(-np.log(54), abs=0.1)
    assert after > before + 0.7
    env.close()
    trainee.env.close()


def as_tensor(values):
    import torch

    return torch.as_tensor(np.asarray(values))
