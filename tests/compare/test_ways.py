"""Ways of the methods around obstacles."""

import gymnasium as gym
import numpy as np
import pytest

from kinreach.compare import get_task
from kinreach.compare._methods.waypoints import free_way


@pytest.fixture(scope="module")
def env():
    return gym.make("kinreach/Obstacles-v0", disable_env_checker=True, dtype="float64")


def method_of(name, env):
    return get_task("obstacles").methods[name].make(env)


@pytest.mark.parametrize("name", ["from-above", "free-way", "path-to-one", "path", "ranked-single"])
def test_the_last_waypoint_is_the_goal_and_methods_stay_there(name, env):
    """Of two episodes, one after the other; those from above move the shoulder's lift last."""
    method, world, ways = method_of(name, env), env.unwrapped, []
    assert method.reason == ""
    for seed in (2, 5):
        observation, info = env.reset(seed=seed, options={"clutter": 0})
        method.reset(observation, info)
        ways.append([world.posture_for(method.act(observation)) for _ in range(12)])
        assert method.reason == ""
        T = world.kinematics.fk(ways[-1][-1])
        assert np.linalg.norm(T[:3, 3] - info["goal"]) < (1e-6 if name != "ranked-single" else 0.01)
        assert T[2, 2] < (-1.0 + 1e-9 if name != "ranked-single" else -0.95)
        np.testing.assert_array_equal(ways[-1][-1], ways[-1][-2])
        if name in ("from-above", "ranked-single"):
            np.testing.assert_allclose(ways[-1][0][1], world.home[1], atol=1e-12)
            np.testing.assert_allclose(np.delete(ways[-1][0], 1), np.delete(ways[-1][1], 1), atol=1e-12)
            np.testing.assert_array_equal(ways[-1][1], ways[-1][2])
    assert np.abs(np.subtract(*ways)).max() > 0.05


@pytest.mark.parametrize("name", ["free-way", "path-to-one", "path"])
def test_a_method_without_a_way_says_why_until_the_next_episode(name, env, monkeypatch):
    method, world = method_of(name, env), env.unwrapped
    observation, info = env.reset(seed=0, options={"clutter": 0})
    with monkeypatch.context() as patch:
        patch.setattr(world, "goal_postures", lambda: np.array([world.home + 1.3 * np.eye(6)[1]]))  # in the table
        method.reset(observation, info)
        for _ in range(2):
            assert method.act(observation) is None
            assert ("blocked" in method.reason) if name == "free-way" else ("table" in method.reason)
    method.reset(observation, info)
    assert method.reason == ""
    assert method.act(observation).shape == (6,)


def test_a_free_way_goes_to_the_posture_with_the_least_largest_change(monkeypatch):
    env = gym.make("kinreach/Obstacles-v0", disable_env_checker=True)
    env.reset(seed=0, options={"clutter": 0})
    world = env.unwrapped
    far, near = world.home + np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.9], [0.1, -0.1, 0.1, 0.1, 0.1, 0.3]])
    for goals in ([far, near], [near, far]):
        monkeypatch.setattr(world, "goal_postures", lambda goals=goals: np.array(goals))
        np.testing.assert_array_equal(free_way(env)._waypoints(None)[-1], near)
