"""Off-policy learners with schedules: what they explore with, how fast they learn, where they begin."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.stats import norm
from stable_baselines3 import SAC
from stable_baselines3.common.logger import configure

import benchmarks.learners  # noqa: F401 (registers its recipes)
from kinreach.baselines import get_recipe
from kinreach.baselines._models import build
from kinreach.robots import get_arm

SINGLE, MULTI = ("sac-single", "td3-single", "ddpg-single"), ("sac-multi", "td3-multi", "ddpg-multi")
#: Standard deviations of the thesis's units [share of the action range]: 1 rad of π, 1 degree of 5.
FIRST = {"single": 1 / math.pi, "multi": 1 / 5}
#: Actions in step, from which deviations are measured.
COUNT = 4000


def trainee(name, count=8, **settings):
    recipe = get_recipe(name)
    built = build(replace(recipe, num_envs=count, settings={**recipe.settings, **settings}), 0, steps=recipe.steps)
    built.model.set_logger(configure(None, []))
    return built


def actions(model, done):
    """What is done first when so much of the training is done, and what would be done without exploration."""
    model.num_timesteps = int(done * model.planned_steps)
    model._last_obs = np.tile(model.env.reset()[:1], (COUNT, 1))
    return model._sample_action(model.learning_starts, None, COUNT)[1], model.predict(
        model._last_obs, deterministic=True
    )[0]


@pytest.mark.parametrize("name", [*SINGLE, *MULTI])
def test_the_schedule_begins_with_the_thesiss_unit_and_ends_as_the_recipe_says(name):
    said = get_recipe(name).settings["exploration"]
    assert said["first"] == pytest.approx(FIRST[name.split("-")[1]])
    built = trainee(name)
    deviations = []
    for done in (0.0, 0.5 * said["until"], said["until"], 1.0):
        built.model.num_timesteps = int(done * built.model.planned_steps)
        deviations.append(built.model.deviation)
    built.env.close()
    middle = math.sqrt(said["first"] * said["last"])
    assert deviations == pytest.approx([said["first"], middle, said["last"], said["last"]], rel=1e-3)


@pytest.mark.parametrize("name", ["td3-single", "ddpg-single", "td3-multi", "ddpg-multi"])
def test_noise_has_that_deviation_from_the_first_action_on(name):
    built = trainee(name)
    for done in (0.0, 0.4, 0.9):
        found, mean = actions(built.model, done)
        inside = np.abs(mean[0]) + 3 * built.model.deviation < 1  # the others are cut at the end of the range
        assert inside.sum() >= (1 if done == 0.0 else 6)
        noise = (found - mean)[:, inside]
        np.testing.assert_allclose(noise.std(axis=0), built.model.deviation, rtol=0.06)
        np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=0.08 * built.model.deviation)
    built.env.close()


@pytest.mark.parametrize("name", ["sac-single", "sac-multi"])
def test_sac_begins_with_that_deviation_and_aims_at_its_entropy(name, monkeypatch):
    """The entropy of six independent normal variables, by scipy's and not by our formula."""
    built = trainee(name)
    model = built.model
    found, mean = actions(model, 0.0)
    noise = np.arctanh(found.astype(float)) - np.arctanh(mean.astype(float))  # the distribution is squashed
    np.testing.assert_allclose(noise.std(axis=0), model.deviation, rtol=0.06)
    monkeypatch.setattr(SAC, "train", lambda *arguments: None)
    for done in (0.0, 0.3, 0.95):
        model.num_timesteps = int(done * model.planned_steps)
        model.train(1, 8)
        assert model.target_entropy == pytest.approx(6 * norm(scale=model.deviation).entropy())
    built.env.close()


@pytest.mark.parametrize("name", SINGLE)
def test_postures_begin_at_the_start_pose(name):
    """And what is bootstrapped from as well."""
    built = trainee(name)
    home = np.array(get_arm("ur5-thesis").home) / np.pi
    observations = built.env.reset()
    np.testing.assert_allclose(
        built.model.predict(observations, deterministic=True)[0], np.tile(home, (8, 1)), atol=0.01
    )
    if hasattr(built.model, "actor_target"):
        for kept, target in zip(built.model.actor.parameters(), built.model.actor_target.parameters(), strict=True):
            assert torch.equal(kept, target)
    built.env.close()


@pytest.mark.parametrize("name", ["sac-multi", "td3-single"])
def test_the_learning_rate_falls_at_the_end(name):
    built = trainee(name, learning_rate=2e-3, decay=0.4)
    rates = []
    for done in (0.0, 0.6, 0.8, 1.0):
        built.model.num_timesteps = int(done * built.model.planned_steps)
        built.model._update_learning_rate([built.model.actor.optimizer, built.model.critic.optimizer])
        rates.append(
            [each.param_groups[0]["lr"] for each in (built.model.actor.optimizer, built.model.critic.optimizer)]
        )
    built.env.close()
    np.testing.assert_allclose(rates, [[2e-3, 2e-3], [2e-3, 2e-3], [1e-3, 1e-3], [0, 0]], atol=1e-7)


@pytest.mark.parametrize("name", ["sac-multi", "ddpg-single"])
def test_critics_take_actions_in_smaller_units(name):
    """The same networks, with a gain of 5 on an action and one of 1 on five times as much."""
    small, plain = (trainee(name, gain=gain) for gain in (5.0, 1.0))
    rng = np.random.default_rng(0)
    seen = torch.as_tensor(np.array(small.env.reset()), dtype=torch.float32)
    tried = torch.as_tensor(rng.uniform(-0.2, 0.2, (8, 6)), dtype=torch.float32)
    for critic in ("critic", "critic_target"):
        one, other = (getattr(built.model, critic) for built in (small, plain))
        other.load_state_dict(one.state_dict())
        with torch.no_grad():
            for found, expected in zip(one(seen, tried), other(seen, 5 * tried), strict=True):
                assert found.std() > 0
                torch.testing.assert_close(found, expected)
            torch.testing.assert_close(one.q1_forward(seen, tried), other.q1_forward(seen, 5 * tried))
    small.env.close()
    plain.env.close()
