"""Every learner learns something on every task it has a recipe for, if only a trivial version of it, in seconds."""

from dataclasses import replace

import numpy as np
import pytest

import benchmarks.learners  # noqa: F401 (registers its recipes)
from kinreach.baselines import evaluate, get_recipe, read_curve, train
from kinreach.baselines._rewards import REWARDS

pytestmark = pytest.mark.slow

#: Recipe -> steps after which the tip is a good part of its way to the goals.
COME_NEAR = {
    "ranked-single": 60_000,
    "ranked-multi": 50_000,
    "ppo-multi": 200_000,
}
AVOID_THE_IMPOSSIBLE = ("thesis-ppo-single",)
#: Recipe -> changes with which it takes no longer: as many actions an update, of more arms.
EARN_MORE = {"sac-single": {}, "thesis-ppo-multi": {"num_envs": 64, "n_steps": 64}}
TURN = ("td3-multi",)
#: Recipe -> steps after which what the reward counts is better than chance.
PRESS_BETTER = {"button": 38_400, "button-dqn": 32_000}
#: Recipe -> settings with which rewards of a step rise before two episodes of 1000 steps are over.
PRESS_LESS = {"button-report-both": {"n_steps": 20}}
#: Recipe -> settings with which the trivial task takes seconds.
PRESS_NOTHING = {"button-dqn-report-actuation": {"learning_starts": 1000, "target_update_interval": 640}}


def changed(name, num_envs=None, **settings):
    recipe = get_recipe(name)
    return replace(recipe, num_envs=num_envs or recipe.num_envs, settings={**recipe.settings, **settings})


@pytest.mark.parametrize("name", COME_NEAR)
def test_the_tip_comes_near(name, tmp_path):
    """The start pose is 0.4 m from a goal."""
    recipe = replace(get_recipe(name), num_envs=256, window=2560)
    run = train(recipe, tmp_path, seed=0, steps=COME_NEAR[name])
    distance = evaluate(run.policy, goals=200, options={"backend": "kinematic"}).measures["distance"]
    assert np.median(distance) < 0.2


@pytest.mark.parametrize("name", AVOID_THE_IMPOSSIBLE)
def test_what_is_impossible_becomes_rarer(name, tmp_path):
    train(get_recipe(name), tmp_path, seed=0, steps=8000)
    curve = read_curve(tmp_path / "curve.csv")
    assert len(curve["reward"]) >= 50
    assert curve["reward"][-10:].mean() > curve["reward"][:10].mean() + 10
    assert curve["impossible"][-10:].mean() < 0.8 * curve["impossible"][:10].mean()


@pytest.mark.parametrize("name", EARN_MORE)
def test_rewards_rise(name, tmp_path):
    train(changed(name, **EARN_MORE[name]), tmp_path, seed=0, steps=20_000)
    reward = read_curve(tmp_path / "curve.csv")["reward"]
    assert reward[-len(reward) // 5 :].mean() > reward[: max(1, len(reward) // 5)].mean()


@pytest.mark.parametrize("name", TURN)
def test_off_policy_learners_turn_the_base_to_the_left(name, tmp_path, monkeypatch):
    """A trivial version of the task, which takes them tens of thousands of steps: only the first joint counts."""
    angles = []

    def turned(rewards, info):
        angles.append(np.abs(info["observation"][:, 6]).mean())
        return -np.abs(info["observation"][:, 6])

    monkeypatch.setitem(REWARDS, "turned", turned)
    recipe = replace(changed(name, num_envs=32, learning_starts=1000), reward="turned")
    train(recipe, tmp_path, seed=0, steps=12_000)
    assert len(angles) >= 300
    assert np.mean(angles[-30:]) < np.mean(angles[:30]) - 0.1


@pytest.mark.parametrize("name", PRESS_BETTER)
def test_returns_of_the_button_task_rise(name, tmp_path):
    """Long before anything is pressed, chance presses less often in the wrong place and comes nearer."""
    train(replace(get_recipe(name), window=6400), tmp_path, seed=1, steps=PRESS_BETTER[name])
    returns = read_curve(tmp_path / "curve.csv")["return"]
    assert len(returns) >= 5
    assert returns[-1] > returns[0] + 8


@pytest.mark.parametrize("name", PRESS_LESS)
def test_rewards_of_the_button_task_rise(name, tmp_path):
    train(replace(changed(name, **PRESS_LESS[name]), window=2560), tmp_path, seed=0, steps=25_600)
    reward = read_curve(tmp_path / "curve.csv")["reward"]
    assert len(reward) == 10
    assert reward[-3:].mean() > reward[:3].mean() + 0.1


@pytest.mark.parametrize("name", PRESS_NOTHING)
def test_with_the_actuation_of_the_report_wrong_presses_become_rare(name, tmp_path, monkeypatch):
    """A trivial version of a task that nobody learns there: only wrong presses count, and chance presses every second
    time."""
    pressed = []

    def quiet(rewards, info):
        pressed.append(-info["reward_terms"]["wrong_press"].mean())
        return 0.05 * info["reward_terms"]["wrong_press"]

    monkeypatch.setitem(REWARDS, "quiet", quiet)
    recipe = replace(changed(name, **PRESS_NOTHING[name]), reward="quiet", window=1600)
    train(recipe, tmp_path, seed=0, steps=16_000)
    assert len(pressed) >= 250
    assert np.mean(pressed[:10]) > 0.4
    assert np.mean(pressed[-25:]) < 0.7 * np.mean(pressed[:10])
