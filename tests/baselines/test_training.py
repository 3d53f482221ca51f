"""Training runs: they learn, repeat themselves, and go on where they were interrupted."""

import json
import os
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

from kinreach.baselines import training
from kinreach.baselines.evaluation import evaluate
from kinreach.baselines.export import network_of
from kinreach.baselines.learned import load_policy
from kinreach.baselines.learning_curve import read_curve
from kinreach.baselines.models import build
from kinreach.baselines.recipes import MULTI, RECIPES, get_recipe
from kinreach.baselines.training import train
from kinreach.baselines.training_reward import REWARDS
from kinreach.errors import InputError, OutputError, UnknownNameError

#: Small versions of one on-policy, one ranked and one off-policy recipe, of three segments each.
SMALL = {
    "ppo-multi": {"num_envs": 16, "steps": 768, "segments": 3, "window": 64},
    "single": {"num_envs": 64, "steps": 192 * 4, "segments": 3, "window": 64},
    "sac-single": {"num_envs": 8, "steps": 240, "segments": 3, "window": 16,
                   "settings": {**RECIPES["sac-single"].settings, "learning_starts": 40, "batch_size": 16}},
    "td3-multi": {"num_envs": 8, "steps": 240, "segments": 3, "window": 16,
                  "settings": {**RECIPES["td3-multi"].settings, "learning_starts": 40, "batch_size": 16}},
}  # fmt: skip


def small(name):
    return replace(get_recipe(name), **SMALL[name])


def weights(path):
    policy = load_policy(path)
    return np.concatenate([part.ravel() for layer in policy._network.layers for part in layer])


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return {name: train(small(name), folder / name, seed=4) for name in SMALL}


@pytest.mark.parametrize("name", SMALL)
def test_the_same_seed_gives_the_same_policy_and_another_seed_another(name, uninterrupted, tmp_path):
    whole = uninterrupted[name].folder
    train(small(name), tmp_path / "again", seed=4)
    train(small(name), tmp_path / "other", seed=5)
    np.testing.assert_array_equal(weights(tmp_path / "again/policy.safetensors"), weights(whole / "policy.safetensors"))
    assert (tmp_path / "again/curve.csv").read_text() == (whole / "curve.csv").read_text()
    assert not np.array_equal(weights(tmp_path / "other/policy.safetensors"), weights(whole / "policy.safetensors"))


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("kept", [1, 2])
def test_going_on_gives_what_no_interruption_gives(name, kept, uninterrupted, tmp_path):
    whole = uninterrupted[name].folder
    interrupted(small(name), tmp_path, kept)
    assert (tmp_path / "checkpoint.pt").exists()
    assert not (tmp_path / "policy.safetensors").exists()
    train(small(name), tmp_path, seed=4, resume=True)
    np.testing.assert_array_equal(weights(tmp_path / "policy.safetensors"), weights(whole / "policy.safetensors"))
    assert (tmp_path / "curve.csv").read_text() == (whole / "curve.csv").read_text()
    assert json.loads((tmp_path / "run.json").read_text())["resumed"]
    assert not (tmp_path / "checkpoint.pt").exists()


def test_a_finished_run_is_kept(uninterrupted, tmp_path, monkeypatch):
    finished = uninterrupted["single"]
    before = {path.name: path.read_bytes() for path in finished.folder.iterdir() if path.is_file()}
    with monkeypatch.context() as patch:
        patch.setattr(training, "build", lambda *a, **k: pytest.fail("it trains again"))
        again = train(small("single"), finished.folder, seed=4, resume=True)
    assert {path.name: path.read_bytes() for path in finished.folder.iterdir() if path.is_file()} == before
    assert (again.card.seed, again.cpu_seconds) == (4, finished.cpu_seconds)
    np.testing.assert_allclose(again.policy.act(np.ones((3, 13))), finished.policy.act(np.ones((3, 13))), atol=1e-6)
    for other in ({"seed": 5}, {"seed": 4, "steps": 400}):  # another run is trained, and so is one without a policy
        assert training._finished(finished.folder, {"recipe": {}, "versions": {}, **other}) is None
    shutil.copytree(finished.folder, tmp_path / "run")
    (tmp_path / "run/policy.safetensors").unlink()
    train(small("single"), tmp_path / "run", seed=4, resume=True)
    np.testing.assert_array_equal(
        weights(tmp_path / "run/policy.safetensors"), weights(finished.folder / "policy.safetensors")
    )


def interrupted(recipe, folder, kept):
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
            train(recipe, folder, seed=4, progress=stop)
    finally:
        training.save_checkpoint = save


def test_a_checkpoint_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    recipe = small("single")
    interrupted(recipe, tmp_path, 1)
    before = (tmp_path / "checkpoint.pt").read_bytes()
    monkeypatch.setattr(Path, "write_bytes", lambda *a: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OutputError, match="No space left"):
        train(recipe, tmp_path, seed=4, resume=True)
    assert (tmp_path / "checkpoint.pt").read_bytes() == before
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".")]


def test_checkpoints_of_other_runs_and_damaged_ones_are_refused(tmp_path):
    recipe = small("single")
    interrupted(recipe, tmp_path, 1)
    path = tmp_path / "checkpoint.pt"
    whole = path.read_bytes()
    for other, seed in ((recipe, 5), (replace(recipe, steps=recipe.steps + 64), 4)):
        with pytest.raises(InputError, match="other settings"):
            train(other, tmp_path, seed=seed, resume=True)
    for content in (b"", whole[: len(whole) // 2], pickle.dumps(Bomb()), b"\0" * 100):
        path.write_bytes(content)
        with pytest.raises(InputError, match="no checkpoint"):
            train(recipe, tmp_path, seed=4, resume=True)
    torch.save({"identity": Bomb()}, path)
    with pytest.raises(InputError, match="no checkpoint"):
        train(recipe, tmp_path, seed=4, resume=True)
    assert not Bomb.executed


def test_a_checkpoint_sets_only_what_a_checkpoint_has(tmp_path):
    interrupted(small("single"), tmp_path, 1)
    path = tmp_path / "checkpoint.pt"
    state = torch.load(path, weights_only=True)
    torch.save({**state, "counters": {**state["counters"], "train": 1}, "curve": {**state["curve"], "step": 1}}, path)
    train(small("single"), tmp_path, seed=4, resume=True)  # neither of the functions is replaced
    interrupted(small("single"), tmp_path, 1)
    torch.save({**state, "counters": {**state["counters"], "num_timesteps": "many"}}, path)
    with pytest.raises(InputError, match="no checkpoint"):
        train(small("single"), tmp_path, seed=4, resume=True)


class Bomb:
    executed = False

    def __reduce__(self):
        return (Bomb.go_off, ())

    @staticmethod
    def go_off():
        Bomb.executed = True


@pytest.mark.parametrize("name", SMALL)
def test_the_exported_network_is_the_trained_one(name, tmp_path):
    trainee = build(small(name), 3, steps=1000)
    observations = trainee.env.reset()
    network = network_of(trainee.model)
    expected, _ = trainee.model.predict(observations, deterministic=True)
    np.testing.assert_allclose(np.clip(network(observations.astype(float)), -1, 1), expected, atol=2e-6)
    assert len(observations) >= 8


@pytest.mark.parametrize(("name", "std"), [("thesis-single", 1.0), ("thesis-multi", np.radians(1.0))])
def test_the_thesis_explores_by_one_unit_of_its_actions(name, std):
    """Actions are radians in single-step, degrees in multi-step (section 3.4.3)."""
    trainee = build(get_recipe(name), 0, steps=1000)
    unit = np.pi if "single" in name else np.radians(5.0)
    np.testing.assert_allclose(unit * trainee.model.policy.log_std.exp().detach().numpy(), std, rtol=1e-6)


def test_networks_that_cannot_be_exported_are_refused():
    trainee = build(small("ppo-multi"), 0, steps=1)
    odd = PPO("MlpPolicy", trainee.env, policy_kwargs={"activation_fn": torch.nn.ELU}, device="cpu")
    with pytest.raises(InputError, match="ELU"):
        network_of(odd)


def test_runs_leave_what_they_promise(uninterrupted, tmp_path):
    run = train(small("single"), tmp_path, seed=4, export=True)
    assert {"policy.safetensors", "curve.csv", "run.json", "tensorboard", "model.zip"} == set(os.listdir(tmp_path))
    assert any("tfevents" in name for name in os.listdir(tmp_path / "tensorboard"))
    card = run.policy.card
    assert (card.seed, card.recipe["name"], card.algorithm, card.steps) == (4, "single", "RankedPPO", 768)
    assert card.versions["torch"] == torch.__version__
    curve = read_curve(tmp_path / "curve.csv")
    assert curve["steps"][-1] == 768
    with pytest.raises(UnknownNameError, match="thesis-single"):
        get_recipe("nothing")


@pytest.mark.parametrize(
    ("name", "steps"),
    [
        ("single", 100_000),
        ("multi", 50_000),
        ("ppo-single", 50_000),
        ("ppo-multi", 300_000),
        pytest.param("ppo-multi-ending", 300_000, marks=pytest.mark.slow),
        pytest.param("thesis-multi-long", 500_000, marks=pytest.mark.slow),
    ],
)
def test_recipes_learn_in_seconds(name, steps, tmp_path):
    """A few seconds take the tip a good part of its way from the start pose, which is 0.4 m from a goal."""
    recipe = replace(get_recipe(name), num_envs=256, window=2560)
    run = train(recipe, tmp_path, seed=0, steps=steps)
    distance = evaluate(run.policy, goals=200, options={"backend": "kinematic"}).measures["distance"]
    assert np.median(distance) < 0.2


def test_the_thesis_recipe_learns_what_is_impossible_in_seconds(tmp_path):
    train(get_recipe("thesis-single"), tmp_path, seed=0, steps=6000)
    curve = read_curve(tmp_path / "curve.csv")
    assert len(curve["reward"]) >= 60
    assert curve["reward"][-10:].mean() > curve["reward"][:10].mean() + 10
    assert curve["impossible"][-10:].mean() < 0.8 * curve["impossible"][:10].mean()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sac-single", "td3-single", "thesis-multi"])
def test_slower_recipes_learn_too(name, tmp_path):
    train(get_recipe(name), tmp_path, seed=0, steps=12_000)
    reward = read_curve(tmp_path / "curve.csv")["reward"]
    assert reward[-len(reward) // 5 :].mean() > reward[: max(1, len(reward) // 5)].mean()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sac-multi", "td3-multi"])
def test_off_policy_learners_turn_the_base_to_the_left_in_seconds(name, tmp_path, monkeypatch):
    """A trivial version of the task, which takes them tens of thousands of steps: only the first joint counts."""
    angles = []

    def turned(rewards, info):
        angles.append(np.abs(info["observation"][:, 6]).mean())
        return -np.abs(info["observation"][:, 6])

    monkeypatch.setitem(REWARDS, "turned", turned)
    recipe = get_recipe(name)
    settings = {**recipe.settings, "learning_starts": 1000}
    train(replace(recipe, reward="turned", num_envs=32, settings=settings), tmp_path, seed=0, steps=12_000)
    assert len(angles) >= 300
    assert np.mean(angles[-30:]) < np.mean(angles[:30]) - 0.1


def test_evaluation_is_that_of_single_environments_and_of_no_training_goal():
    import gymnasium as gym

    policy = load_policy("multi")
    found = evaluate(policy, goals=6, options={"backend": "kinematic"})
    env = gym.make(MULTI, backend="kinematic")
    for index in range(6):
        observation, _ = env.reset(seed=2**41 + index)
        over, steps, total = False, 0, 0.0
        while not over:
            observation, reward, terminated, truncated, info = env.step(policy.act(observation))
            over, steps, total = terminated or truncated, steps + 1, total + reward
        assert found.measures["distance"][index] == pytest.approx(info["distance"], abs=1e-9)
        assert (found.measures["steps"][index], bool(found.reached[index])) == (steps, info["reached"])
        assert found.measures["return"][index] == pytest.approx(total, abs=1e-6)
    summary = found.summary()
    assert summary["goals"] == 6
    assert summary["reached_ci"][0] <= summary["reached"] <= summary["reached_ci"][1]
    more = evaluate(policy, goals=9, options={"backend": "kinematic"}).measures["distance"]
    np.testing.assert_allclose(more[:6], found.measures["distance"], atol=1e-12)
    with pytest.raises(InputError, match="at least 1"):
        evaluate(policy, goals=0)
