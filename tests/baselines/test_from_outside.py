"""Algorithms, recipes, rewards and environments from outside the package are trained, exported and evaluated."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import torch

from kinreach.baselines import (
    Algorithm,
    Networks,
    Recipe,
    get_recipe,
    load_policy,
    register_algorithm,
    register_recipe,
    train,
)
from kinreach.baselines import _algorithms as algorithms
from kinreach.baselines._batch import make_batch
from kinreach.baselines._models import build
from kinreach.baselines._recipes import RECIPES
from kinreach.cli import main
from kinreach.envs.inside import in_doubles
from kinreach.errors import InputError, UnknownNameError
from tests.cases import slow

#: As a user would write it.
MINE = """
import gymnasium as gym
import numpy as np

from kinreach.baselines._algorithms import Algorithm, register_algorithm
from kinreach.baselines._recipes import Networks, Recipe

register_algorithm(Algorithm("TQC", "sb3_contrib:TQC", defaults={"learning_starts": 32, "batch_size": 16}))
RECIPE = Recipe(
    name="tqc-single",
    summary="TQC with a net of its own.",
    environment="kinreach/UR5SingleStep-v0",
    options={"backend": "kinematic"},
    algorithm="TQC",
    steps=160,
    num_envs=8,
    reward="mine:halved",
    networks=Networks(hidden=(256, 256), activation="relu", features="scaled"),
    settings={"gamma": 0.0, "policy_kwargs": {"n_critics": 1}},
    segments=2,
    window=32,
)


def halved(rewards, info):
    return rewards / 2
"""


@pytest.fixture
def registries(monkeypatch):
    """Copies that a test may add to."""
    monkeypatch.setattr(algorithms, "ALGORITHMS", algorithms.ALGORITHMS)
    before = dict(algorithms.ALGORITHMS), dict(RECIPES)
    yield
    for registry, kept in zip((algorithms.ALGORITHMS, RECIPES), before, strict=True):
        registry.clear()
        registry.update(kept)


@pytest.mark.parametrize("module", ["outside_worlds", "outside.worlds"])
def test_a_native_batch_of_a_users_module(module, tmp_path, monkeypatch):
    """By `module:id`, as Gymnasium takes it, also where the module is part of a package and nothing imported it."""
    file = tmp_path / f"{module.replace('.', '/')}.py"
    file.parent.mkdir(exist_ok=True)
    name = f"{module.replace('.', '-')}/Moving-v0"
    entries = ", ".join(f'{kind}="kinreach.envs.moving:{made}"' for kind, made in (
        ("entry_point", "MovingBallEnv"), ("vector_entry_point", "MovingVectorEnv")))  # fmt: skip
    file.write_text(f"import gymnasium as gym\ngym.register({name!r}, {entries})\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert in_doubles(f"{module}:{name}") == {"dtype": "float64"}
    batch = make_batch(f"{module}:{name}", 2, {})
    try:
        observed, _ = batch.reset(seed=1)
        assert (observed.shape, observed.dtype) == ((2, 16), np.float64)
    finally:
        batch.close()
        gym.registry.pop(name)
    with pytest.raises(InputError, match="cannot make the environment outside_nothing:x/Y-v0: No module named"):
        make_batch("outside_nothing:x/Y-v0", 2, {})
    with pytest.raises(gym.error.Error, match="No module named"):  # as callers take an unknown id
        in_doubles("outside_nothing:x/Y-v0")


@pytest.mark.slow
def test_a_recipe_and_an_algorithm_of_a_users_module_on_the_command_line(run_python, tmp_path, capsys):
    pytest.importorskip("sb3_contrib")
    (tmp_path / "mine.py").write_text(MINE)
    done = run_python("-c", "import sys; sys.path.remove(''); from kinreach.cli import main; "
                      "sys.exit(main(['train', 'mine:RECIPE', '--out', 'out']))")  # fmt: skip
    assert done.returncode == 0, done.stderr
    policy_file = tmp_path / "out/tqc-single/seed-0/policy.safetensors"
    policy = load_policy(policy_file)
    assert (policy.card.algorithm, policy.card.meaning) == ("TQC", "action")
    assert [weight.shape for weight, _ in policy.network.layers] == [(256, 13), (256, 256), (6, 256)]
    assert main(["evaluate", str(policy_file), "--goals", "3", "--backend", "kinematic"]) == 0
    assert "tqc-single/seed-0" in capsys.readouterr().out


RECIPE = Recipe(
    "mine", "Mine.", "Pendulum-v1", "SAC", steps=240, num_envs=4, networks=Networks(hidden=(8,), activation="relu"),
    settings={"learning_starts": 40, "batch_size": 16}, segments=2, window=80,
)  # fmt: skip


for name in ("SAC", "DQN"):
    register_algorithm(Algorithm(name, f"stable_baselines3:{name}"))


@pytest.mark.parametrize(
    ("environment", "algorithm", "settings"),
    [
        ("Pendulum-v1", "SAC", {"learning_starts": 40, "batch_size": 16}),
        ("Pendulum-v1", "PPO", {"n_steps": 20, "batch_size": 40}),
        ("CartPole-v1", "DQN", {"learning_starts": 40, "batch_size": 16}),  # whose own batch resets a step later
        ("CartPole-v1", "PPO", {"n_steps": 20, "minibatches": 4}),
    ],
)
@pytest.mark.parametrize("features", [*slow("raw"), "scaled"])
def test_environments_of_gymnasium(environment, algorithm, settings, features, tmp_path):
    recipe = replace(
        RECIPE, environment=environment, algorithm=algorithm, settings=settings,
        networks=replace(RECIPE.networks, features=features),
    )  # fmt: skip
    run = train(recipe, tmp_path, seed=1)
    env = gym.make(environment)
    policy = load_policy(tmp_path / "policy.safetensors", environment=environment)
    policy.check_spaces(env.observation_space, env.action_space)
    observation, _ = env.reset(seed=0)
    for _ in range(9):
        action = policy.act(observation)
        assert env.action_space.contains(np.asarray(action, dtype=env.action_space.dtype))
        observation, _, terminated, _, _ = env.step(action)
        if terminated:
            break
    trainee = build(recipe, 3, steps=240)
    observations = np.random.default_rng(0).normal(size=(50, len(observation))).astype(np.float32)
    expected = trainee.model.predict(observations, deterministic=True)[0]
    policy = type(policy)(run.card, trainee.network)
    np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)


def test_the_curve_counts_what_ends_where_gymnasium_resets(tmp_path):
    """CartPole ends after some ten steps of chance; every episode and its return are counted."""
    recipe = replace(RECIPE, environment="CartPole-v1", algorithm="PPO", settings={"n_steps": 100, "minibatches": 4})
    trainee = build(recipe, 0, steps=400)
    trainee.model.learn(400)
    (row,) = trainee.curve.rows[-1:]
    steps, episodes, reward, episode_return, reached, distance, posture_error, impossible = row
    assert (steps, reward) == (400, 1.0)
    assert 8 < episode_return < 60
    assert 400 / 60 < episodes < 400 / 8
    assert (reached, distance, posture_error, impossible) == (None,) * 4
    trainee.env.close()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"algorithm": "TRPO"}, "unknown algorithm 'TRPO'; available: AdaptivePPO"),
        ({"reward": "gold"}, "unknown training reward 'gold'"),
        ({"reward": "no_such_module:f"}, "cannot import the training reward no_such_module:f"),
        ({"environment": "Nowhere-v0"}, "cannot make the environment Nowhere-v0"),
        ({"options": {"speed": 3}}, "cannot make the environment Pendulum-v1.*speed"),
        ({"algorithm": "PPO", "settings": {"minibatches": 4}}, "PPO needs the setting 'n_steps', which mine lacks"),
        ({"settings": {"speed": 3}}, "SAC does not take the settings of mine.*speed"),
        ({"settings": {"policy_kwargs": {"activation_fn": torch.nn.Softplus}}}, "must be JSON values"),
        ({"settings": {"gamma": np.nan}}, "must be JSON values"),
        ({"networks": Networks(activation="cube")}, "unknown activation 'cube'"),
        ({"networks": Networks(features="cubes")}, "unknown features 'cubes'; available: arms, .*looks, .*steering"),
        ({"environment": "Blackjack-v1"}, "vectors of numbers"),
    ],
)
def test_what_cannot_be_trained_is_said_before_the_training(change, message, tmp_path):
    with pytest.raises(InputError, match=message):
        train(replace(RECIPE, **change), tmp_path, progress=lambda *_: pytest.fail("it trains"))


@pytest.mark.parametrize(
    "change",
    [
        {"steps": 0},
        {"num_envs": 0},
        {"segments": 0},
        {"window": 0},
        {"walk": 0.5},
        {"blur": -1e-3},
        {"trace_after": -1},
    ],
)
def test_numbers_that_no_recipe_has_are_refused(change):
    ((name, _),) = change.items()
    with pytest.raises(InputError, match=f"{name} of a recipe"):
        replace(RECIPE, **change)


@pytest.mark.parametrize(
    ("name", "settings", "said"),
    [
        *((name, {"n_epochs": 0}, "n_epochs of NAME must be at least 1, got 0")
          for name in ("ppo-multi", "ranked-single", "thesis-ppo-multi", "gradient-moving")),
        ("ppo-multi", {"n_epochs": 1.5}, "n_epochs of NAME must be an integer, got 1.5"),
        ("ranked-single", {"n_steps": 0}, "n_steps of NAME must be at least 1, got 0"),
        ("ranked-single", {"tries": 2.0}, "tries of NAME must be an integer, got 2.0"),
        ("ranked-single", {"tries": "8"}, "tries of NAME must be an integer, got '8'"),
        ("ranked-single", {"minibatches": 0}, "minibatches of NAME must be at least 1, got 0"),
        ("ranked-single", {"minibatches": 65}, "minibatches of NAME must be at most 64, got 65"),
        ("pixels-single", {"looks": 0}, "looks of NAME must be at least 1, got 0"),
        ("imitated-push", {"batch_size": 0}, "batch_size of NAME must be at least 1, got 0"),
        ("imitated-push", {"updates": 0}, "updates of NAME must be at least 1, got 0"),
        ("imitated-push", {"updates": 1.5}, "updates of NAME must be an integer, got 1.5"),
        ("imitated-push", {"memory": 1e5}, "memory of NAME must be an integer, got 100000.0"),
        ("imitated-push", {"memory": 639, "n_steps": 10}, "memory of NAME must be at least 640, got 639"),
        ("gradient-moving-clear", {"balls": 0}, "balls of NAME must be at least 1, got 0"),
    ],
)  # fmt: skip
def test_counts_that_no_algorithm_has_are_said_before_the_training(name, settings, said, tmp_path):
    recipe = get_recipe(name)
    recipe = replace(recipe, num_envs=64, steps=64, settings={**recipe.settings, **settings})
    with pytest.raises(InputError, match=said.replace("NAME", name)):
        train(recipe, tmp_path, progress=lambda *_: pytest.fail("it trains"))


@pytest.mark.parametrize(("hidden", "said"), [((64, 0), "at least 1, got 0"), ((1.5,), "an integer"), (64, "a list")])
def test_sizes_that_no_layer_has_are_refused(hidden, said):
    with pytest.raises(InputError, match=f"hidden.* must be {said}"):
        Networks(hidden=hidden)


def test_what_cannot_be_exported_is_said_before_the_training(registries, tmp_path):
    from stable_baselines3 import SAC

    def wrong(model):
        network = algorithms.actor_network(model)
        return replace(network, shift=network.shift + 0.1)

    def soft(recipe, env, planned):
        arguments = algorithms.mlp_arguments(recipe, env, planned)
        return arguments | {"policy_kwargs": {"activation_fn": torch.nn.Softplus}}

    class Alone:
        """Not a class of stable-baselines3."""

        def __init__(self, *arguments, **settings):
            self.policy = torch.nn.Linear(1, 1)

    register_algorithm(Algorithm("Wrong", SAC, exporter=wrong))
    register_algorithm(Algorithm("Soft", SAC, arguments=soft))
    register_algorithm(Algorithm("Fails", SAC, exporter=lambda model: model.actor["mu"]))
    register_algorithm(Algorithm("Alone", Alone))
    messages = {
        "Wrong": "does not answer as the model does",
        "Soft": "Softplus cannot be exported",
        "Fails": r"the exporter of Fails fails: TypeError: .*test_from_outside\.py, line",
        "Alone": "Alone must be a subclass of stable-baselines3's OnPolicyAlgorithm or OffPolicyAlgorithm, got a Alone",
    }
    for name, message in messages.items():
        with pytest.raises(InputError, match=message):
            train(replace(RECIPE, algorithm=name), tmp_path, progress=lambda *_: pytest.fail("it trains"))


def test_names_are_given_once(registries):
    register_recipe(RECIPE)
    assert get_recipe("mine") is register_recipe(RECIPE)
    with pytest.raises(InputError, match="already"):
        register_recipe(replace(RECIPE, steps=1))
    with pytest.raises(InputError, match="already"):
        register_algorithm(Algorithm("PPO", "sb3_contrib:TQC"))
    for given in ("TQC", None, Algorithm):
        with pytest.raises(InputError, match="an algorithm must be an Algorithm, got"):
            register_algorithm(given)
    for name in ("../up", "..", ".", "", 3):
        with pytest.raises(InputError, match="name of a recipe"):
            register_recipe(replace(RECIPE, name=name))
    with pytest.raises(UnknownNameError, match="mine"):
        get_recipe("thine")
    for path in ("os:path", "nothing:RECIPE", "os:nothing", ":x", "x:"):
        with pytest.raises(InputError):
            get_recipe(path)
