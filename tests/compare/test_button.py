"""The button task: whole episodes with a controller, a policy and chance."""

from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest

from kinreach.baselines import RandomPolicy
from kinreach.compare import compare, get_task
from kinreach.compare._button import SPACING
from kinreach.compare._runner import MAX_GOALS, MAX_SEED
from kinreach.envs._button.button_task import action_space
from kinreach.envs.inside import ButtonDrawing, ButtonState


@pytest.fixture(scope="module")
def results():
    return compare("button", goals=8)


def test_who_presses(results):
    analytic, ppo, random = results["methods"]
    assert (analytic["name"], ppo["name"], random["name"]) == ("analytic", "ppo", "random")
    assert analytic["pressed"] == analytic["reached"] == 1.0
    assert ppo["pressed"] >= 0.9
    assert random["pressed"] < 0.5


def test_episodes_are_measured(results):
    analytic, _, random = results["methods"]
    assert 10 < analytic["steps"]["median"] < 50
    assert random["steps"]["p95"] == 100
    assert analytic["move_s"]["median"] == pytest.approx(0.04 * analytic["steps"]["median"])
    assert random["wrong_presses"]["mean"] > analytic["wrong_presses"]["mean"]
    assert analytic["energy"]["median"] > 0
    assert analytic["reward_mean"] > 50
    assert analytic["success_at_mm"]["50"] == 1.0


def test_chance_is_the_same_whoever_is_compared(results):
    alone = compare("button", ["random"], goals=8)["methods"][0]
    among = results["methods"][2]
    for key in ("reward_mean", "steps", "wrong_presses", "energy"):
        assert alone[key] == among[key]


def test_the_environments_options_are_the_tasks():
    (found,) = compare("button", ["random"], goals=2, options={"max_episode_steps": 7})["methods"]
    assert found["steps"]["p95"] <= 7
    (report,) = compare("button", ["analytic"], goals=2, options={"actuation": "report", "max_episode_steps": 500})[
        "methods"
    ]
    assert report["pressed"] == 1.0


def test_no_two_goals_of_two_seeds_share_an_episode():
    assert MAX_GOALS < SPACING
    assert MAX_SEED * SPACING < 2**127  # what numpy's generators take


def test_chance_is_another_in_every_episode_and_the_same_in_the_same():
    policy = RandomPolicy(action_space(), seed=3)

    def draws(observation):
        policy.reset(np.full(19, observation), {})
        return [int(policy.act(None)) for _ in range(20)]

    episodes = {tuple(draws(observation)) for observation in (0.1, 0.2, 0.3, 0.1, 0.2, 0.3)}
    assert len(episodes) == 3


@pytest.mark.parametrize(("pressed", "wrong"), [(True, 0.0), (False, 1.0), (False, 0.0)])
def test_a_picture_has_the_last_posture_and_what_became_of_the_button(pressed, wrong, monkeypatch):
    task, shown = get_task("button"), []
    monkeypatch.setattr(ButtonDrawing, "show", lambda drawing, *given: shown.append(given[1:]))
    with closing(gym.make(task.environment, **task.options)) as env:
        q = [0.3, -0.2, 0.4]
        scene = task.scene(env, {"q": q, "goal": [0.4, 0.3, 0.2], "pressed": pressed, "wrong_press": wrong})
    np.testing.assert_allclose(scene.data.qpos[:3], q)
    ((goal, state),) = shown
    np.testing.assert_array_equal(goal, [0.4, 0.3, 0.2])
    assert state == (ButtonState.PRESSED if pressed else ButtonState(int(wrong)))
