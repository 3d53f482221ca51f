"""Training runs leave what they promise."""

import os

import numpy as np
import pytest
import torch

from kinreach.baselines.evaluation import evaluate
from kinreach.baselines.learning_curve import read_curve
from kinreach.baselines.models import build
from kinreach.baselines.networks import actor_network
from kinreach.baselines.policies import load_policy
from kinreach.baselines.recipes import get_recipe
from kinreach.baselines.training import train
from kinreach.errors import InputError, UnknownNameError
from kinreach.registration import MULTI
from kinreach.statistics import wilson_interval
from tests.baselines.small_runs import SMALL, small


@pytest.mark.parametrize("name", SMALL)
def test_the_exported_network_is_the_trained_one(name, tmp_path):
    trainee = build(small(name), 3, steps=1000)
    observations = trainee.env.reset()
    network = actor_network(trainee.model)
    expected, _ = trainee.model.predict(observations, deterministic=True)
    np.testing.assert_allclose(np.clip(network(observations.astype(float)), -1, 1), expected, atol=2e-6)
    assert len(observations) >= 8


@pytest.mark.parametrize(("name", "std"), [("thesis-single", 1.0), ("thesis-multi", np.radians(1.0))])
def test_the_thesis_explores_by_one_unit_of_its_actions(name, std):
    """Actions are radians in single-step, degrees in multi-step (section 3.4.3)."""
    trainee = build(get_recipe(name), 0, steps=1000)
    unit = np.pi if "single" in name else np.radians(5.0)
    np.testing.assert_allclose(unit * trainee.model.policy.log_std.exp().detach().numpy(), std, rtol=1e-6)


def test_runs_leave_what_they_promise(tmp_path):
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
    intervals = {mm: list(wilson_interval(round(6 * share), 6)) for mm, share in summary["success_at_mm"].items()}
    assert summary["success_at_mm_ci"] == intervals
    assert 0 < summary["success_at_mm"]["0.5"] <= 1 == summary["success_at_mm"]["10"]
    more = evaluate(policy, goals=9, options={"backend": "kinematic"}).measures["distance"]
    np.testing.assert_allclose(more[:6], found.measures["distance"], atol=1e-12)
    with pytest.raises(InputError, match="at least 1"):
        evaluate(policy, goals=0)
