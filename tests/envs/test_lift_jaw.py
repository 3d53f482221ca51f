"""Lifting with an SO-101: five axes, and a jaw that turns beside a fixed one."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from kinreach._registration import LIFT
from kinreach.compare._lift import GraspPolicy
from kinreach.kinematics.inside import new_solver

ARM = {"arm": "so101", "sizes": (0.01, 0.02), "shapes": ("ball", "cube")}


def grasps(env, policy, seeds):
    """The results of first grasps."""
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        action = policy.act(observation)
        assert action is not None, policy.reason
        yield env.step(action)[-1]


def scripted(env):
    return GraspPolicy(new_solver("closed-form", env.unwrapped.kinematics), env)


@pytest.mark.parametrize(("backend", "count"), [("kinematic", 40), ("mujoco", 8)])
def test_a_script_lifts(backend, count):
    env = gym.make(LIFT, backend=backend, **ARM)
    found = list(grasps(env, scripted(env), range(count)))
    assert len(found) == count
    assert all(info["is_success"] for info in found)
    assert all(info["posture_error"] < 1e-6 for info in found if backend == "kinematic")


def test_a_grasp_beside_the_object_lifts_nothing():
    """3 cm to the side of the jaws' motion, by geometry and by dynamics."""
    for backend in ("kinematic", "mujoco"):
        env = gym.make(LIFT, backend=backend, **ARM)
        policy, count = scripted(env), 0
        for seed in range(4):
            observation, info = env.reset(seed=seed)
            observation[:2] += 0.03 * info["goal"][:2] / np.linalg.norm(info["goal"][:2])
            action = policy.act(observation)
            if action is not None:
                count += 1
                assert not env.step(action)[-1]["is_success"]
        assert count >= 3


@pytest.mark.parametrize(
    "options", [{}, {"backend": "kinematic"}, {"steps": "multi"}, {"goal_env": True}], ids=lambda options: str(options)
)
def test_gymnasium_and_stable_baselines3_agree(options):
    env = gym.make(LIFT, **ARM, **options).unwrapped
    assert env.action_space.shape == (6,)
    check_env(env, skip_render_check=True)
    pytest.importorskip("stable_baselines3.common.env_checker").check_env(env, skip_render_check=True)


def test_a_batch_equals_single_environments():
    options = {**ARM, "steps": "multi"}
    batch = gym.make_vec(LIFT, num_envs=2, vectorization_mode="vector_entry_point", **options)
    single = [gym.make(LIFT, **options) for _ in range(2)]
    rows, _ = batch.reset(seed=5)
    actions = np.random.default_rng(0).uniform(-1, 1, (6, 2, 6)).astype(np.float32)
    np.testing.assert_array_equal(rows, [env.reset(seed=5 + k)[0] for k, env in enumerate(single)])
    for both in actions:
        rows, rewards, *_ = batch.step(both)
        each = [env.step(action) for env, action in zip(single, both, strict=True)]
        np.testing.assert_array_equal(rows, [step[0] for step in each])
        np.testing.assert_array_equal(rewards, [step[1] for step in each])


def test_small_steps_move_the_jaw():
    env = gym.make(LIFT, steps="multi", **ARM)
    env.reset(seed=0)
    openings = [env.step(np.array([0, 0, 0, 0, 0, -1.0], np.float32))[-1]["opening"] for _ in range(30)]
    assert openings[0] < 0.07
    assert openings[-1] < 0.01
    assert (np.diff(openings) < 1e-4).all()
