"""A policy file of a stable-baselines3 model answers as the model does; its own files are refused unread."""

import os
import pickle
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from kinreach.baselines import load_policy
from kinreach.cli import main
from kinreach.errors import InputError

torch = pytest.importorskip("torch")
stable_baselines3 = pytest.importorskip("stable_baselines3")
sb3_contrib = pytest.importorskip("sb3_contrib")

from kinreach.baselines import export_policy  # noqa: E402
from kinreach.baselines._sb3_export import _normalised, actor_network, check_trainable  # noqa: E402

PENDULUM, CARTPOLE, REACH = "Pendulum-v1", "CartPole-v1", "kinreach/UR5SingleStep-v0"
MODELS = [
    ("PPO", PENDULUM, {}),
    ("PPO", CARTPOLE, {}),
    ("PPO", PENDULUM, {"use_sde": True}),
    ("PPO", REACH, {"policy_kwargs": {"net_arch": {"pi": [], "vf": [8]}}}),
    ("A2C", PENDULUM, {"policy_kwargs": {"activation_fn": torch.nn.ELU, "net_arch": [32, 8]}}),
    ("SAC", PENDULUM, {"policy_kwargs": {"activation_fn": torch.nn.LeakyReLU}}),
    ("TD3", REACH, {}),
    ("DDPG", PENDULUM, {}),
    ("DQN", CARTPOLE, {"policy_kwargs": {"activation_fn": torch.nn.Tanh}}),
    ("TQC", PENDULUM, {"policy_kwargs": {"n_critics": 1}}),
]


def model(name, environment, policy="MlpPolicy", **settings):
    made = getattr(stable_baselines3, name, None) or getattr(sb3_contrib, name)
    return made(policy, environment, device="cpu", seed=3, **settings)


@pytest.mark.parametrize(("name", "environment", "settings"), MODELS, ids=lambda value: str(value)[:12])
def test_it_answers_as_the_model_does(name, environment, settings, tmp_path):
    made = model(name, environment, **settings)
    with torch.no_grad():
        for value in made.policy.parameters():
            value += 0.05 * torch.randn_like(value)  # so that some actions are beyond their bounds
    path = tmp_path / "mine.safetensors"
    export_policy(made, path, environment=environment, options={"backend": "kinematic"})
    policy = load_policy(path, environment=environment)
    observations = np.random.default_rng(0).normal(size=(1000, *made.observation_space.shape)).astype(np.float32)
    expected = made.predict(observations, deterministic=True)[0]
    found = policy.act(observations)
    assert found.shape == expected.shape == (1000, *made.action_space.shape)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(policy.act(observations[0]), expected[0], atol=1e-6)
    policy.check_spaces(made.observation_space, made.action_space)
    assert (policy.card.environment, policy.card.algorithm, policy.card.seed) == (environment, name, 3)
    assert policy.card.recipe == {"name": "mine", "options": {"backend": "kinematic"}}
    assert np.unique(expected).size > 1


@pytest.mark.parametrize(
    ("name", "environment", "settings", "message"),
    [
        ("SAC", PENDULUM, {"policy_kwargs": {"activation_fn": torch.nn.Softplus}}, "Softplus"),
        ("QRDQN", CARTPOLE, {}, "not a multilayer perceptron of PPO"),
    ],
)
def test_what_cannot_be_exported_is_said(name, environment, settings, message, tmp_path):
    with pytest.raises(InputError, match=message):
        export_policy(model(name, environment, **settings), tmp_path / "p.safetensors", environment=environment)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "environment"), [("SAC", PENDULUM), ("TD3", PENDULUM), ("DQN", CARTPOLE)])
def test_a_trained_off_policy_model_is_exported(name, environment, tmp_path):
    """It keeps observations as one of VecNormalize does; once it is saved, nothing tells them apart."""
    made = model(name, environment, learning_starts=8)
    made.learn(20)
    path = tmp_path / "p.safetensors"
    export_policy(made, path, environment=environment)
    made.save(tmp_path / "model.zip")
    kind = getattr(stable_baselines3, name)
    loaded = kind.load(tmp_path / "model.zip")
    with pytest.raises(InputError, match="normalize=False says that it was not"):
        export_policy(loaded, path, environment=environment)
    for each, said in ((loaded, False), (kind.load(tmp_path / "model.zip", env=made.get_env()), None)):
        policy = export_policy(each, path, environment=environment, normalize=said)
        seen = np.zeros((1, *made.observation_space.shape))
        np.testing.assert_allclose(policy.act(seen), made.predict(seen, deterministic=True)[0], atol=1e-5)


@pytest.mark.parametrize("name", ["PPO", "SAC"])
@pytest.mark.slow
def test_normalised_observations_are_those_of_the_environment_in_the_policy(name, tmp_path, capsys):
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    settings = {"n_steps": 16, "batch_size": 16, "n_epochs": 1} if name == "PPO" else {"learning_starts": 8}
    made = model(name, VecNormalize(make_vec_env(PENDULUM)), **settings)
    made.learn(200)
    made.save(tmp_path / "model.zip")
    made.get_vec_normalize_env().save(tmp_path / "vecnormalize.pkl")
    normalize = VecNormalize.load(tmp_path / "vecnormalize.pkl", make_vec_env(PENDULUM))
    loaded = getattr(stable_baselines3, name).load(tmp_path / "model.zip")
    path, checked = tmp_path / "p.safetensors", 0
    seen = normalize.obs_rms
    observations = seen.mean + np.sqrt(seen.var) * np.random.default_rng(0).uniform(-9, 9, (500, 3))  # not clipped
    expected = made.predict(normalize.normalize_obs(observations), deterministic=True)[0]
    for each, given in ((made, None), (loaded, normalize)):
        policy = export_policy(each, path, environment=PENDULUM, normalize=given)
        np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)
        np.testing.assert_allclose(load_policy(path).act(observations), expected, atol=1e-5)
        checked += np.ptp(expected) > 0.01
    assert checked == 2
    with pytest.raises(InputError, match="normalize must be of observations with 3 numbers"):
        export_policy(loaded, path, environment=PENDULUM, normalize=VecNormalize(make_vec_env(CARTPOLE)))
    if getattr(loaded, "_last_original_obs", None) is not None:
        with pytest.raises(InputError, match=r"normalize=VecNormalize.load\('vecnormalize.pkl', venv\)"):
            export_policy(loaded, path, environment=PENDULUM)
    assert main(["evaluate", str(tmp_path / "model.zip")]) == 2
    assert f"normalize=VecNormalize.load('{tmp_path / 'vecnormalize.pkl'}', venv)" in capsys.readouterr().err


def test_statistics_of_observations_become_part_of_the_network(tmp_path):
    """Of a model that is not trained, with statistics as a training would have left them."""
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    made, rng, path = model("PPO", PENDULUM), np.random.default_rng(0), tmp_path / "p.safetensors"
    with torch.no_grad():
        made.policy.action_net.weight.mul_(30.0)  # so that the statistics matter
    normalize = VecNormalize(make_vec_env(PENDULUM), clip_obs=1e6, epsilon=0.01)
    normalize.obs_rms.mean, normalize.obs_rms.var = rng.normal(size=3), rng.uniform(0.01, 4.0, 3)
    observations = rng.uniform(-3.0, 3.0, (200, 3))
    plain = made.predict(observations, deterministic=True)[0]
    for norm_obs in (True, False):
        normalize.norm_obs = norm_obs
        expected = made.predict(normalize.normalize_obs(observations), deterministic=True)[0]
        policy = export_policy(made, path, environment=PENDULUM, normalize=normalize)
        np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)
        assert (np.abs(expected - plain).max() > 0.01) == norm_obs
    normalize.norm_obs = True
    once = _normalised(actor_network(made), normalize)
    twice = _normalised(once, normalize)
    x = normalize.normalize_obs(normalize.normalize_obs(observations))
    np.testing.assert_allclose(twice(observations), made.predict(x, deterministic=True)[0], atol=1e-5)
    with pytest.raises(InputError, match="normalize must be of observations with 3 numbers"):
        export_policy(made, path, environment=PENDULUM, normalize=VecNormalize(make_vec_env(CARTPOLE)))
    with pytest.raises(InputError, match="must be a VecNormalize of stable-baselines3, got 3"):
        _normalised(once, 3)
    with pytest.raises(InputError, match="a network with differences takes observations as they are"):
        _normalised(SimpleNamespace(differences=np.eye(3)), normalize)


def test_only_vectors_and_numbers_from_0_are_trained():
    vector = gym.spaces.Box(-1.0, 1.0, (3,))
    for actions in (vector, gym.spaces.Discrete(4)):
        check_trainable(vector, actions)
    for actions in (gym.spaces.Discrete(4, start=1), gym.spaces.MultiBinary(3), gym.spaces.Box(-1.0, 1.0, (2, 2))):
        with pytest.raises(InputError, match="training needs actions that are vectors or numbered from 0, got "):
            check_trainable(vector, actions)
    with pytest.raises(InputError, match="training needs observations that are vectors of numbers, got Box"):
        check_trainable(gym.spaces.Box(-1.0, 1.0, (2, 2)), vector)


def test_images_dictionaries_and_other_things_are_refused(tmp_path):
    from stable_baselines3.common.envs import FakeImageEnv, SimpleMultiObsEnv

    for policy, environment in (("CnnPolicy", FakeImageEnv()), ("MultiInputPolicy", SimpleMultiObsEnv())):
        made = model("PPO", environment, policy, n_steps=8, batch_size=8)
        with pytest.raises(InputError, match="vectors of numbers"):
            export_policy(made, tmp_path / "p.safetensors", environment="Any-v0")
    with pytest.raises(InputError, match="a model must be stable-baselines3's"):
        export_policy("model.zip", tmp_path / "p.safetensors", environment=PENDULUM)
    with pytest.raises(InputError, match="environment must be the id of one"):
        export_policy(model("PPO", PENDULUM), tmp_path / "p.safetensors", environment="")


class Bomb:
    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return (os.mkdir, (self.path,))


def test_its_own_files_are_refused_unread_with_the_remedy(tmp_path, capsys):
    mark, path = tmp_path / "executed", tmp_path / "model.zip"
    path.write_bytes(pickle.dumps(Bomb(mark)))
    remedy = "kinreach.baselines.export_policy(PPO.load(...)"
    with pytest.raises(InputError) as refused:
        load_policy(path)
    assert remedy in str(refused.value)
    for argv in (["evaluate", str(path)], ["compare", "--goals", "1", "--methods", str(path)]):
        assert main(argv) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert str(path) in line
        assert remedy in line
    assert not mark.exists()
