"""A `model.zip` of stable-baselines3 answers as stable-baselines3 does, and nothing in it is executed."""

import base64
import io
import json
import os
import pickle
import zipfile

import numpy as np
import pytest

from kinreach.baselines import _sb3_zip as sb3_zip
from kinreach.baselines._policies import load_policy
from kinreach.cli import main
from kinreach.errors import InputError

torch = pytest.importorskip("torch")
stable_baselines3 = pytest.importorskip("stable_baselines3")
sb3_contrib = pytest.importorskip("sb3_contrib")

PENDULUM, CARTPOLE, REACH = "Pendulum-v1", "CartPole-v1", "kinreach/UR5SingleStep-v0"
MODELS = [
    ("PPO", PENDULUM, {}),
    ("PPO", CARTPOLE, {}),
    ("PPO", REACH, {"policy_kwargs": {"net_arch": {"pi": [], "vf": [8]}}}),
    ("A2C", PENDULUM, {"policy_kwargs": {"activation_fn": torch.nn.ELU, "net_arch": [32, 8]}}),
    ("SAC", PENDULUM, {"policy_kwargs": {"activation_fn": torch.nn.LeakyReLU}}),
    ("TD3", REACH, {}),
    ("DDPG", PENDULUM, {}),
    ("DQN", CARTPOLE, {"policy_kwargs": {"activation_fn": torch.nn.Tanh}}),
    ("TQC", PENDULUM, {"policy_kwargs": {"n_critics": 1}}),
]


def model(name, environment, **settings):
    made = getattr(stable_baselines3, name, None) or getattr(sb3_contrib, name)
    return made("MlpPolicy", environment, device="cpu", seed=0, **settings)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "model.zip"
    model("PPO", PENDULUM).save(path)
    return path


@pytest.mark.parametrize(("name", "environment", "settings"), MODELS, ids=lambda value: str(value)[:12])
def test_it_answers_as_the_model_does(name, environment, settings, tmp_path):
    made = model(name, environment, **settings)
    with torch.no_grad():
        for value in made.policy.parameters():
            value += 0.05 * torch.randn_like(value)  # so that some actions are beyond their bounds
    made.save(tmp_path / "model.zip")
    policy = load_policy(tmp_path / "model.zip", environment=environment)
    observations = np.random.default_rng(0).normal(size=(1000, *made.observation_space.shape)).astype(np.float32)
    expected = made.predict(observations, deterministic=True)[0]
    found = policy.act(observations)
    assert found.shape == expected.shape == (1000, *made.action_space.shape)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(policy.act(observations[0]), expected[0], atol=1e-6)
    policy.check_spaces(made.observation_space, made.action_space)
    with pytest.raises(InputError, match=f"must have {observations.shape[1]} numbers"):
        policy.act(np.zeros((2, 1 + observations.shape[1])))
    assert policy.card.environment == environment
    assert np.unique(expected).size > 1


@pytest.mark.parametrize(
    ("name", "environment", "settings", "message"),
    [
        ("PPO", PENDULUM, {"use_sde": True}, "use_sde"),
        ("SAC", PENDULUM, {"policy_kwargs": {"activation_fn": torch.nn.Softplus}}, "Softplus"),
        ("PPO", PENDULUM, {"policy_kwargs": {"normalize_images": False}}, "normalize_images"),
        ("QRDQN", CARTPOLE, {}, "sb3_contrib.qrdqn"),
    ],
)
def test_what_cannot_be_read_is_said(name, environment, settings, message, tmp_path):
    model(name, environment, **settings).save(tmp_path / "model.zip")
    with pytest.raises(InputError, match=message):
        load_policy(tmp_path / "model.zip")


def test_normalised_observations_are_refused(tmp_path):
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    made = model("PPO", VecNormalize(make_vec_env(PENDULUM)), n_steps=16, batch_size=16, n_epochs=1)
    made.learn(16)
    made.save(tmp_path / "model.zip")
    with pytest.raises(InputError, match="VecNormalize"):
        load_policy(tmp_path / "model.zip")


def test_images_and_dictionaries_are_refused(tmp_path):
    from stable_baselines3.common.envs import FakeImageEnv, SimpleMultiObsEnv

    for policy, environment in (("CnnPolicy", FakeImageEnv()), ("MultiInputPolicy", SimpleMultiObsEnv())):
        made = stable_baselines3.PPO(policy, environment, device="cpu", n_steps=8, batch_size=8)
        made.save(tmp_path / "model.zip")
        with pytest.raises(InputError, match="not a vector"):
            load_policy(tmp_path / "model.zip")


class Bomb:
    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return (os.mkdir, (self.path,))


def changed(saved, path, **entries):
    """The zip with other entries; None leaves one out."""
    with zipfile.ZipFile(saved) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            content = entries.get(name.removesuffix(".pth"), old.read(name))
            if content is not None:
                new.writestr(name, content)
    return path


def packed(value):
    content = io.BytesIO()
    torch.save(value, content)
    return content.getvalue()


def test_hostile_and_damaged_files_are_refused_and_nothing_runs(saved, tmp_path):
    mark, path = tmp_path / "executed", tmp_path / "model.zip"
    with zipfile.ZipFile(saved) as archive:
        data, weights = json.loads(archive.read("data")), archive.read("policy.pth")
    tensors = torch.load(io.BytesIO(weights), weights_only=True)
    huge = torch.zeros(1).expand(2**40)
    compressed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(weights)) as old, zipfile.ZipFile(compressed, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            new.writestr(name, old.read(name))
    cases = [
        {"policy": None},
        {"data": None},
        {"data": b"[" * 100_000},
        {"data": b"[]"},
        {"data": b"\xff"},
        {"data": b" " * (17 << 20)},
        {"data": json.dumps({**data, "policy_class": {"__module__": "evil"}})},
        {"data": json.dumps({**data, "policy_class": {}})},
        {"data": json.dumps({**data, "policy_kwargs": {"features_extractor_class": "x"}})},
        {"data": json.dumps({**data, "action_space": {**data["action_space"], "low": "[nan]"}})},
        {"data": json.dumps({**data, "observation_space": {**data["observation_space"], "_shape": [9]}})},
        {"policy": pickle.dumps(Bomb(mark))},
        {"policy": packed(Bomb(mark))},
        {"policy": packed({"action_net.weight": Bomb(mark)})},
        {"policy.optimizer": packed(Bomb(mark))},
        {"policy.optimizer": compressed.getvalue()},
        {"policy": packed([1, 2])},
        {"policy": packed({})},
        {"policy": packed({**tensors, "action_net.weight": huge})},
        {"policy": packed({**tensors, "action_net.weight": torch.tensor(1.0)})},
        {"policy": packed({**tensors, "action_net.bias": tensors["action_net.bias"] * torch.nan})},
        {"policy": packed({**tensors, "pi_features_extractor.cnn": torch.zeros(3)})},
        {"policy": packed({**tensors, "strange": torch.zeros(3)})},
        {"policy": compressed.getvalue()},
    ]
    for entries in cases:
        with pytest.raises(InputError, match=r"model\.zip"):
            load_policy(changed(saved, path, **entries))
    whole = saved.read_bytes()
    for cut in np.linspace(0, len(whole) - 1, 40).astype(int):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match=r"model\.zip"):
            load_policy(path)
    for pickled in ("not base64", base64.b64encode(pickle.dumps(Bomb(mark))).decode()):  # parts that are never opened
        for text in ("policy_class", "observation_space", "action_space", "lr_schedule"):
            data[text][":serialized:"] = pickled
        load_policy(changed(saved, path, data=json.dumps(data)))
    assert not mark.exists()


def test_a_comparison_says_in_which_environment_a_file_was_used(tmp_path, capsys):
    path = tmp_path / "model.zip"
    model("PPO", REACH).save(path)
    out = str(tmp_path / "out")
    assert main(["compare", "--methods", str(path), "--goals", "1", "--backend", "kinematic", "--out", out]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"{path} names no environment and was used in kinreach/UR5SingleStep-v0; for another: {path}@multi" in said


def test_what_unpacks_to_more_than_is_read_is_refused(saved, tmp_path, monkeypatch):
    with zipfile.ZipFile(saved) as old, zipfile.ZipFile(tmp_path / "model.zip", "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            new.writestr(name, old.read(name))
        new.writestr("more", bytes(1 << 20))
    load_policy(tmp_path / "model.zip")
    monkeypatch.setattr(sb3_zip, "MAX_ZIP", 1 << 20)
    assert (tmp_path / "model.zip").stat().st_size < 1 << 20
    with pytest.raises(InputError, match="its entries are larger than 1 MiB"):
        load_policy(tmp_path / "model.zip")


def test_flipped_bits_are_refused_or_change_numbers_only(saved, tmp_path):
    whole, rng, read = saved.read_bytes(), np.random.default_rng(0), 0
    for _ in range(150):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= 1 << rng.integers(8)
        (tmp_path / "model.zip").write_bytes(bytes(damaged))
        try:
            action = load_policy(tmp_path / "model.zip").act(np.zeros(3))
        except InputError:
            continue
        assert np.isfinite(action).all()
        read += 1
    assert 0 < read < 150
