"""A trained policy beside the solvers ends where its episode does."""

import gymnasium as gym
import numpy as np

from kinreach._registration import SINGLE
from kinreach.baselines import load_policy
from kinreach.kinematics import AxisGoal, URKinematics
from kinreach.view._policy_solver import PolicySolver
from tests.policy_files import copy_policy


def test_a_policy_is_asked_as_it_was_trained(tmp_path):
    trained, kinematics = load_policy("thesis-ppo-single"), URKinematics("ur5-thesis", tip="tcp", base="world")
    recipe = {**trained.card.recipe, "options": {"goal_in": "image"}}
    copy_policy("thesis-ppo-single", tmp_path / "image.safetensors", recipe=recipe)
    solver = PolicySolver(str(tmp_path / "image.safetensors"), kinematics)
    env, asked = gym.make(SINGLE, backend="kinematic", goal_in="image"), 0
    for position in kinematics.arm.workcell.goals.sample(np.random.default_rng(4), 5):
        observation, _ = env.reset(seed=0, options={"goal": position})
        target = env.unwrapped.posture_for(trained.act(observation))
        np.testing.assert_allclose(solver.solve(AxisGoal(position), kinematics.arm.home).q, target, atol=1e-12)
        asked += 1
    assert asked == 5
