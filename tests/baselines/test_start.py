"""Trainings that begin with the weights of a policy."""

import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3 as sb3

import tests.baselines.test_what_is_trained  # noqa: F401 (registers what it needs)
from kinreach.baselines import Networks, Recipe, export_policy, get_recipe, load_policy, train
from kinreach.baselines._models import build
from kinreach.baselines._policies import pretrained_names
from kinreach.baselines._sb3_export import actor_network, set_actor
from kinreach.errors import InputError
from tests.baselines.small_runs import small
from tests.cases import slow

QUICK = ("ranked-single", "ppo-lift-multi")


def numbers(network):
    eyes = [layer for eye in network.eyes for layer in eye.layers]
    return np.concatenate([part.ravel() for layer in (*network.layers, *eyes) for part in layer])


@pytest.mark.parametrize("name", [*QUICK, *slow(*(name for name in pretrained_names() if name not in QUICK))])
def test_every_policy_that_ships_begins_a_training_of_its_recipe(name):
    recipe, start = get_recipe(name), load_policy(name)
    settings = {**recipe.settings, **({"looks": 64} if "looks" in recipe.settings else {})}
    trainee = build(replace(recipe, num_envs=64, settings=settings), 3, steps=1000, start=start)
    trainee.env.close()
    np.testing.assert_allclose(numbers(trainee.network), numbers(start.network), atol=1e-7)
    model = trainee.model
    if recipe.settings.get("exploration") and not recipe.networks.posture:
        assert model.policy.log_std.exp().max() == pytest.approx(recipe.settings["exploration"]["last"])
    if "adaptive" in recipe.settings:
        assert model.rate <= 1e-5  # else the first update undoes what the policy knows


@pytest.mark.slow
def test_a_training_that_begins_with_a_policy_keeps_what_it_knows(tmp_path):
    recipe = small("ranked-single")
    run = train(recipe, tmp_path / "run", seed=4, start="ranked-single")
    new = train(recipe, tmp_path / "new", seed=4)
    known = load_policy("ranked-single")
    observations = np.random.default_rng(0).uniform([0.4, -0.2, -0.2], [0.5, 0.2, -0.1], (200, 3))
    full = np.column_stack([observations, np.tile([0, 0, 1], (200, 1)), np.tile(known.posture(np.ones(13)), (200, 1)),
                            np.zeros(200)])[:, :13]  # fmt: skip
    far = [np.abs(each.policy.posture(full) - known.posture(full)).max() for each in (run, new)]
    assert far[0] < 0.05 < far[1]
    assert run.card.recipe["start"] == known.digest
    assert json.loads((run.folder / "run.json").read_text())["start"] == known.digest
    again = train(recipe, tmp_path / "again", seed=4, start=run.folder / "policy.safetensors")
    assert again.card.recipe["start"] == run.policy.digest != known.digest


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "SAC", "TD3", "DDPG"])
def test_models_of_stable_baselines3_begin_with_their_exported_actors(algorithm, tmp_path):
    env = gym.make("kinreach/UR5SingleStep-v0", backend="kinematic")
    one, other = (getattr(sb3, algorithm)("MlpPolicy", env, seed=seed, device="cpu") for seed in (1, 2))
    policy = export_policy(one, tmp_path / "one.safetensors", environment="kinreach/UR5SingleStep-v0")
    set_actor(other, other.policy, policy.network)
    observation = np.random.default_rng(1).normal(size=(50, 13))
    np.testing.assert_allclose(other.predict(observation, deterministic=True)[0],
                               one.predict(observation, deterministic=True)[0], atol=1e-6)  # fmt: skip
    np.testing.assert_array_equal(numbers(actor_network(other)), numbers(policy.network))
    if hasattr(other, "actor_target"):
        for mine, its in zip(other.actor_target.parameters(), other.actor.parameters(), strict=True):
            assert (mine == its).all()
    env.close()


@pytest.mark.parametrize(
    ("start", "recipe", "message"),
    [
        (
            "ppo-multi",
            "ranked-single",
            "its network is 13-64-64-6, silu, linear, that of the recipe is 6 with 3 waves-64",
        ),
        ("button", "ranked-single", "button cannot begin the training of ranked-single"),
        ("pixels-single", "ranked-single", "16-16 channels|channels, 64-128"),
    ],
)
def test_another_network_is_refused_and_leaves_no_folder(start, recipe, message, tmp_path):
    with pytest.raises(InputError, match=message):
        train(get_recipe(recipe), tmp_path / "a" / "run", start=start)
    assert list(tmp_path.iterdir()) == []


def test_constants_around_layers_that_a_recipe_does_not_have_are_refused(tmp_path):
    """A raw observation cannot be scaled as that of the policy is."""
    recipe = Recipe("plain", "", "kinreach/UR5MultiStepKinematic-v0", "PPO", steps=64, num_envs=8,
                    networks=Networks(activation="silu"), settings={"n_steps": 8})  # fmt: skip
    with pytest.raises(InputError, match=r"(mean|gain) around the layers of its network is not that of the recipe"):
        train(recipe, tmp_path / "run", start="ppo-multi")
