"""Training runs leave what they promise."""

import io
import json
import os
import random
from dataclasses import replace

import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from kinreach._registration import MULTI
from kinreach._statistics import wilson_interval
from kinreach.baselines import _evaluation as evaluation
from kinreach.baselines import _training as training
from kinreach.baselines import evaluate, get_recipe, load_policy, read_curve, train
from kinreach.baselines._learning_curve import COLUMNS
from kinreach.baselines._models import build
from kinreach.baselines._rewards import REWARDS
from kinreach.baselines._sb3_export import actor_network
from kinreach.baselines._training import _begin_segment, goal_seeds
from kinreach.baselines.inside import LearnedPolicy, pretrained_names
from kinreach.errors import InputError, UnknownNameError
from tests.baselines.small_runs import SMALL, small


@pytest.mark.parametrize("name", SMALL)
def test_the_exported_network_is_the_trained_one(name, tmp_path):
    trainee = build(small(name), 3, steps=1000)
    observations = trainee.env.reset()
    network = actor_network(trainee.model)
    expected, _ = trainee.model.predict(observations, deterministic=True)
    np.testing.assert_allclose(np.clip(network(observations.astype(float)), -1, 1), expected, atol=2e-6)
    assert len(observations) >= 8


@pytest.mark.parametrize(("name", "std"), [("thesis-ppo-single", 1.0), ("thesis-ppo-multi", np.radians(1.0))])
def test_the_thesis_explores_by_one_unit_of_its_actions(name, std):
    """Actions are radians in single-step, degrees in multi-step (section 3.4.3)."""
    trainee = build(get_recipe(name), 0, steps=1000)
    unit = np.pi if "single" in name else np.radians(5.0)
    np.testing.assert_allclose(unit * trainee.model.policy.log_std.exp().detach().numpy(), std, rtol=1e-6)


def test_schedules_are_followed_and_are_over_at_the_end():
    recipe = small("ranked-single")
    model = build(recipe, 0, steps=768).model
    assert not model.policy.log_std.requires_grad  # the schedule alone changes it
    used = []
    for done in (384, 384):
        rates, train_once = [], model.train

        def train_and_note(rates=rates, train_once=train_once):
            before = model.rate
            train_once()
            divergence = model.logger.name_to_value["train/approx_kl"]
            rates.append(model.rate == model.adaptive.after(before, float(divergence)) != before)

        model.train = train_and_note
        model.learn(done, reset_num_timesteps=False)
        model.train = train_once
        assert sum(rates) > 0.5 * len(rates) > 1  # the others were near enough
        progress = model.num_timesteps / 768
        used.append(model.policy.optimizer.param_groups[0]["lr"])
        assert model.logger.name_to_value["train/learning_rate"] == used[-1]
        std, share = model.exploration.at(progress), model.adaptive.share(progress)
        np.testing.assert_allclose(model.policy.log_std.exp().detach().numpy(), std, rtol=1e-5)
    assert recipe.settings["adaptive"]["decay"] > 0
    assert (progress, share) == (1.0, 0.0)
    assert std == pytest.approx(recipe.settings["exploration"]["last"] / np.pi)
    assert used[0] > used[1] == 0.0


@pytest.mark.parametrize("name", ["ppo-single", "ppo-multi"])
def test_ppo_has_the_minibatches_and_the_networks_of_its_recipe(name):
    recipe = replace(get_recipe(name), num_envs=32)
    model = build(recipe, 0, steps=1000).model
    assert model.batch_size * recipe.settings["minibatches"] == 32 * model.n_steps
    parts = model.policy.mlp_extractor
    for network in (parts.policy_net, parts.value_net):
        widths = [layer.out_features for layer in network if isinstance(layer, torch.nn.Linear)]
        assert widths == list(recipe.networks.hidden)


def test_no_segment_trains_on_the_goals_of_another(tmp_path, monkeypatch):
    seen = []

    def watched(rewards, info):
        seen.append(info["final_info"]["goal"])
        return rewards

    monkeypatch.setitem(REWARDS, "watched", watched)
    train(replace(small("ranked-single"), reward="watched"), tmp_path, seed=4)
    groups = np.concatenate(seen).reshape(-1, 8, 3)
    assert len(groups) == 768 // 8
    assert len(np.unique(groups[:, 0], axis=0)) == len(groups)


@pytest.mark.parametrize(("name", "steps"), [("thesis-ppo-single", 128), ("thesis-ppo-multi", 4096)])
def test_the_thesis_has_four_minibatches_and_four_epochs_of_its_steps(name, steps):
    model = build(get_recipe(name), 0, steps=1000).model
    assert model.n_envs * model.n_steps == 4 * model.batch_size == steps
    assert model.n_epochs == 4


@pytest.mark.parametrize(("name", "unit"), [("thesis-ppo-single", np.pi), ("thesis-ppo-multi", 5.0)])
def test_ppo2_speaks_the_thesis_s_units_throughout(name, unit):
    """Its head, its standard deviation and so its learning rate: in radians and degrees."""
    model = build(get_recipe(name), 0, steps=1000).model
    np.testing.assert_allclose(model.policy.log_std.exp().detach().numpy(), 1 / unit, rtol=1e-6)
    hidden = torch.randn(20, 64, generator=torch.Generator().manual_seed(0))
    head = model.policy.action_net
    spoken = hidden @ head.weight.T + head.bias
    np.testing.assert_allclose(unit * head(hidden).detach(), spoken.detach(), rtol=1e-4, atol=1e-6)
    assert model.clip_range_vf(1.0) == model.clip_range(1.0) == 0.2
    network = actor_network(model)
    np.testing.assert_allclose(network.gain, np.full(6, 1 / unit), rtol=1e-6)


def test_runs_leave_what_they_promise(tmp_path):
    run = train(small("ranked-single"), tmp_path, seed=4, export=True)
    left = {"policy.safetensors", "curve.csv", "run.json", "tensorboard", "model.zip", "checkpoint.pt"}
    assert left == set(os.listdir(tmp_path))
    logs = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    columns = [name for name in COLUMNS[2:] if name != "return"]
    assert {name for name in logs.Tags()["scalars"] if name.startswith("curve/")} >= {
        f"curve/{name}" for name in columns
    }
    card = run.policy.card
    assert (card.seed, card.recipe["name"], card.algorithm, card.steps) == (4, "ranked-single", "RankedPPO", 768)
    assert card.versions["torch"] == torch.__version__
    curve = read_curve(tmp_path / "curve.csv")
    assert curve["steps"][-1] == 768
    for name in columns:
        events = logs.Scalars(f"curve/{name}")
        np.testing.assert_allclose([event.value for event in events], curve[name], rtol=1e-6)
        assert [event.step for event in events] == curve["steps"].tolist()
    text = (tmp_path / "run.json").read_text()
    assert text == json.dumps(json.loads(text), indent=2) + "\n"
    assert json.loads(text)["resumed"] is False
    with pytest.raises(UnknownNameError, match="thesis-ppo-single"):
        get_recipe("nothing")


def test_evaluation_is_that_of_single_environments_and_of_no_training_goal(monkeypatch):
    import gymnasium as gym

    policy = load_policy("ranked-multi")
    found = evaluate(policy, goals=6, options={"backend": "kinematic"})
    env = gym.make(MULTI, backend="kinematic", dtype="float64")
    for index in range(6):
        observation, _ = env.reset(seed=2**41 + index)
        over, steps, total = False, 0, 0.0
        while not over:
            observation, reward, terminated, truncated, info = env.step(policy.act(observation))
            over, steps, total = terminated or truncated, steps + 1, total + reward
        assert found.trials[index]["goal"] == info["goal"].tolist()
        assert found.measures["distance"][index] == pytest.approx(info["distance"], abs=1e-9)
        assert (found.measures["steps"][index], bool(found.reached[index])) == (steps, info["reached"])
        assert found.measures["return"][index] == pytest.approx(total, abs=1e-6)
    summary = found.summary()
    assert summary["goals"] == 6
    assert summary["reached_ci"][0] <= summary["reached"] <= summary["reached_ci"][1]
    intervals = {mm: list(wilson_interval(round(6 * share), 6)) for mm, share in summary["success_at_mm"].items()}
    assert summary["success_at_mm_ci"] == intervals
    assert 0 < summary["success_at_mm"]["0.5"] <= 1 == summary["success_at_mm"]["10"]
    monkeypatch.setattr(evaluation, "BATCH", 4)  # in more than one part
    made, make, done = [], evaluation.make_batch, []
    monkeypatch.setattr(evaluation, "make_batch", lambda *given: made.append(make(*given)) or made[-1])
    more = evaluate(policy, goals=9, options={"backend": "kinematic"}, progress=done.append).measures["distance"]
    assert ([batch.num_envs for batch in made], done) == ([4, 4, 1], [4, 8, 9])
    assert all(batch.closed for batch in made)
    assert len(np.unique(more)) == 9
    np.testing.assert_allclose(more[:6], found.measures["distance"], atol=1e-12)
    with pytest.raises(InputError, match="at least 1"):
        evaluate(policy, goals=0)


def test_an_impossible_end_is_no_success_however_near_it_is():
    near = {"reached": False, "distance": 1e-4}
    summary = evaluation.Evaluation(
        [{**near, "impossible": impossible} for impossible in (True, False, True)]
    ).summary()
    assert set(summary["success_at_mm"].values()) == {1 / 3}
    assert summary["impossible"] == pytest.approx(2 / 3)


def test_an_evaluation_on_another_arm_is_on_that_arm():
    plain = load_policy("ranked-single")
    recipe = {**plain.card.recipe, "options": {**plain.card.recipe["options"], "arm": "ur5"}}
    trained = LearnedPolicy(replace(plain.card, recipe=recipe), plain.network)
    options = {"backend": "kinematic"}
    other, asked, own = (
        evaluate(policy, goals=3, options=options | more).measures["distance"]
        for policy, more in ((plain, {"arm": "ur3"}), (trained, {"arm": "ur3"}), (trained, {}))
    )
    np.testing.assert_array_equal(asked, other)
    assert (asked != own).all()


def test_every_generator_follows_from_the_seed_and_the_segment(monkeypatch):
    trainee, seeded = build(small("ranked-single"), 0, steps=768), []
    monkeypatch.setattr(trainee.env, "seed", seeded.append)

    def draws(seed, segment):
        _begin_segment(trainee, seed, segment)
        space = trainee.model.action_space.sample().tolist()
        return random.random(), np.random.uniform(), float(torch.rand(1)), *space

    first, again, other, segment = draws(3, 1), draws(3, 1), draws(4, 1), draws(3, 2)
    assert first == again
    assert not set(first) & (set(other) | set(segment))
    assert len(set(first)) == len(first) == 9
    goals = [goal_seeds(seed, 3)["training"] for seed in (3, 4)]
    assert seeded == [goals[0][1], goals[0][1], goals[1][1], goals[0][2]]
    assert trainee.model._last_obs is None


def test_cards_name_the_goals_of_their_trainings():
    names = pretrained_names()
    for name in names:
        card = load_policy(name).card
        assert card.goal_seeds == goal_seeds(card.seed, get_recipe(card.recipe["name"]).segments)
    assert len(names) >= 10


@pytest.mark.parametrize("name", ["gradient-moving", "ppo-moving-clear", "random-arms"])
def test_a_model_is_saved_without_its_simulation(name):
    recipe = get_recipe(name)
    steps = {"n_steps": 1, "minibatches": 1}
    trainee = build(replace(recipe, num_envs=8, settings={**recipe.settings, **steps}), 0, steps=100)
    saved = io.BytesIO()
    trainee.model.save(saved)
    assert len(saved.getvalue()) > 1000
    assert "world" in trainee.model._excluded_save_params()
    before = [value.clone() for value in trainee.model.policy.mlp_extractor.policy_net.parameters()]
    trainee.model.learn(8)
    assert np.isfinite(trainee.model.logger.name_to_value["train/loss"])
    after = trainee.model.policy.mlp_extractor.policy_net.parameters()
    assert all((one != other).any() for one, other in zip(before, after, strict=True))
    trainee.env.close()


def test_trainings_stay_on_the_processor(monkeypatch):
    """Also where there is a graphics card, which is slower for networks as small as these."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    trainee = build(small("ppo-multi"), 0, steps=768)
    assert trainee.model.device == torch.device("cpu")
    trainee.env.close()


def test_a_run_that_cannot_be_read_is_no_shorter_one():
    identity = {"seed": 3, "recipe": {"name": "a", "steps": 100}}
    for steps, shorter in ((60, True), (99, True), (100, False), (101, False), ("60", False), (None, False)):
        assert training._is_shorter({**identity, "recipe": {"name": "a", "steps": steps}}, identity) is shorter
    for run in ({}, {"recipe": {}}, {"recipe": None}, {"recipe": 3, "seed": 3}):
        assert training._is_shorter(run, identity) is False
    assert training._is_shorter({**identity, "recipe": {"name": "b", "steps": 60}}, identity) is False


def test_a_refused_training_leaves_no_folders_but_those_that_were_there(tmp_path):
    recipe = small("ranked-single")
    refused = replace(recipe, num_envs=63, settings={**recipe.settings, "tries": 7})
    (tmp_path / "there").mkdir()
    for folder in ("a/b/c", "there/a/b", "there"):
        with pytest.raises(InputError, match="even number of tries"):
            train(refused, tmp_path / folder, seed=0)
        assert [*tmp_path.rglob("*")] == [tmp_path / "there"]
    (tmp_path / "there" / "mine").write_text("kept")
    with pytest.raises(InputError, match="even number of tries"):
        train(refused, tmp_path / "there" / "a", seed=0)
    assert [*(tmp_path / "there").rglob("*")] == [tmp_path / "there" / "mine"]
