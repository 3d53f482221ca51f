"""Observations stay in their space, wherever an arm starts and whatever holds it there."""

import itertools

import gymnasium as gym
import numpy as np
import pytest

from kinreach.envs._reach.reach_task import layout_of
from kinreach.robots import get_arm

SINGLE, MULTI = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0"


def starts(arm, count):
    """Corners of the joint limits, where links are inside one another, and random postures."""
    low, high = (np.array(limits) for limits in limits_of(arm))
    rng = np.random.default_rng(0)
    corners = np.array(list(itertools.product((0, 1), repeat=len(low))))
    return [*(low + (high - low) * corners), *rng.uniform(low, high, (count, len(low)))]


def limits_of(arm):
    env = gym.make(SINGLE, backend="kinematic", arm=arm).unwrapped
    return (env.posture_for(np.full(len(env.home), side)) for side in (-1.0, 1.0))


@pytest.mark.parametrize("arm", ["ur5-thesis", "arm3"])
@pytest.mark.slow
def test_under_dynamics(arm):
    env = gym.make(MULTI, arm=arm, disable_env_checker=True)
    rng = np.random.default_rng(0)
    angles = layout_of(get_arm(arm)).q
    steps = past = 0
    for q in starts(arm, 20):
        observation, _ = env.reset(seed=0, options={"q": q})
        assert env.observation_space.contains(observation)
        for action in [np.zeros(len(q))] * 2 + list(rng.choice([-1.0, 1.0], (3, len(q)))):
            observation, *_ = env.step(action)
            assert env.observation_space.contains(observation)
            past += bool((np.abs(observation[angles]) > np.pi + 0.02).any())
            steps += 1
    assert steps > 100
    assert past > 0 or arm == "arm3"  # limits are springs: that is what the space has to allow for


def test_a_native_batch_under_dynamics():
    q = np.array(starts("ur5-thesis", 0))[:12]
    env = gym.make_vec(MULTI, num_envs=len(q), vectorization_mode="vector_entry_point", threads=2)
    observation, _ = env.reset(seed=0, options={"q": q})
    rng = np.random.default_rng(1)
    for _ in range(4):
        observation, *_ = env.step(rng.choice([-1.0, 1.0], (len(q), 6)))
        assert env.observation_space.contains(observation)


def test_a_joint_that_is_pushed_far_past_its_limit_is_an_unstable_simulation():
    env = gym.make(MULTI).unwrapped
    env.reset(seed=0)
    simulation = env._simulation
    before = simulation.q
    follow = env._simulation._plant.follow

    def pushed(*arguments):
        follow(*arguments)
        simulation.data.qpos[simulation.controller.qpos] = [3.7, *before[1:]]
        simulation.data.qvel[:] = 0.0  # MuJoCo itself finds nothing wrong

    simulation._plant.follow = pushed
    observation, _, terminated, truncated, info = env.step(np.zeros(6))
    assert info["status"] == "diverged"
    assert (terminated, truncated) == (False, True)
    np.testing.assert_array_equal(info["q"], before)
    assert env.observation_space.contains(observation)
