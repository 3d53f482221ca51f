"""Ways of the methods around obstacles."""

import gymnasium as gym
import numpy as np

from kinreach.compare._methods.waypoints import free_way


def test_a_free_way_goes_to_the_posture_with_the_least_largest_change(monkeypatch):
    env = gym.make("kinreach/Obstacles-v0", disable_env_checker=True)
    env.reset(seed=0, options={"clutter": 0})
    world = env.unwrapped
    far, near = world.home + np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.9], [0.1, -0.1, 0.1, 0.1, 0.1, 0.3]])
    for goals in ([far, near], [near, far]):
        monkeypatch.setattr(world, "goal_postures", lambda goals=goals: np.array(goals))
        np.testing.assert_array_equal(free_way(env)._waypoints(None)[-1], near)
