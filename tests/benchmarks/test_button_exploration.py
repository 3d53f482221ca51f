"""Ways around exploration on the report's gears: starts on the way from the target, and imitation."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("torch")
from benchmarks.learners import button_report_demonstrated, button_report_demonstrated_19, button_report_starts
from benchmarks.learners.button_exploration import StartsOnTheWay
from kinreach._registration import BUTTON
from kinreach.baselines._models import build
from kinreach.envs._button.episodes import ButtonStarts
from kinreach.kinematics import Arm3Kinematics


class Drawn:
    """Rows as the environment draws them."""

    def draw(self, ids):
        return ButtonStarts().sample(np.random.default_rng(0), len(ids))


def test_starts_move_from_the_target_to_where_episodes_start():
    ids, kinematics = np.arange(300), Arm3Kinematics(base="world")
    starts, drawn = StartsOnTheWay(Drawn()), Drawn().draw(ids)
    at_target = starts.draw(ids)
    np.testing.assert_array_equal(at_target[:, :3], drawn[:, :3])
    tips = np.array([kinematics.fk(q)[:3, 3] for q in at_target[:, 3:6]])
    np.testing.assert_allclose(tips, drawn[:, :3], atol=1e-9)
    assert not at_target[:, 6:].any()
    starts.share = 0.5
    way = np.linalg.norm(starts.draw(ids)[:, 3:6] - at_target[:, 3:6], axis=1)
    whole = np.linalg.norm(drawn[:, 3:6] - at_target[:, 3:6], axis=1)
    assert 0.2 < np.mean(way / whole) < 0.3
    assert (way <= 0.5 * whole + 1e-12).all()
    starts.share = starts.least = 1.0
    np.testing.assert_allclose(starts.draw(ids), drawn, atol=1e-12)


@pytest.mark.slow
def test_starts_are_those_of_the_environment_at_last():
    settings = {**button_report_starts.settings, "n_steps": 10, "n_epochs": 1}
    recipe = replace(button_report_starts, num_envs=8, steps=320, settings=settings)
    trainee = build(recipe, 0, steps=320)
    trainee.model.learn(320)
    assert (trainee.model.starts.share, trainee.model.starts.least) == (1.0, 1.0)
    trainee.env.close()


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
    assert after > before + 1.0
    env.close()
    trainee.env.close()


def as_tensor(values):
    import torch

    return torch.as_tensor(np.asarray(values))
