"""Recipes of lifting: grasps are tried as the environment has them, and what training rewards leads to a grasp."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401
from kinreach._registration import LIFT
from kinreach.baselines import get_recipe
from kinreach.baselines._algorithms import FIRST_OPENING, _fixed
from kinreach.baselines._models import build
from kinreach.baselines._rewards import training_reward
from kinreach.baselines.expert import tool_down_postures
from kinreach.kinematics import URKinematics


@pytest.mark.parametrize(
    ("name", "numbers"), [("ranked-lift", 8), ("ranked-lift-range", 8), ("ranked-single", 6), ("ranked-multi", 6)]
)
def test_an_episode_begins_with_what_stays_the_same(name, numbers):
    """Where the object is and what it is; where two cameras see the ball."""
    assert _fixed(get_recipe(name)) == slice(0, numbers)


@pytest.mark.parametrize("name", ["ranked-lift", "ranked-lift-range"])
@pytest.mark.slow
def test_a_policy_begins_at_the_start_pose_with_fingers_nearly_closed(name):
    recipe = replace(get_recipe(name), num_envs=64, steps=64, window=64)
    trainee = build(recipe, 0, steps=64)
    env = gym.make(LIFT)
    observation, _ = env.reset(seed=0)
    action = trainee.network(observation)
    np.testing.assert_allclose(action[:6] * np.pi, env.unwrapped.home, atol=0.05)
    assert action[6] == pytest.approx(FIRST_OPENING, abs=0.05)
    observations = trainee.env.reset()
    groups = observations.reshape(8, 8, -1)
    assert (groups == groups[:, :1]).all()  # eight tries of the same object
    assert len(np.unique(groups[:, 0, 0])) == 8


def test_the_guiding_reward_grows_on_the_way_to_the_grasp():
    """Home, above, in the grasp, closed, held: in this order, for objects all over the table."""
    reward, kinematics = training_reward("grasp-guided"), URKinematics("ur5-thesis", tip="tcp", base="world")
    env = gym.make_vec(LIFT, 20, vectorization_mode="vector_entry_point", steps="multi", shapes=("cube", "ball"))
    seen, _ = env.reset(seed=0)
    place, turn = seen[:, :3], seen[:, 3]
    low = tool_down_postures(kinematics, place, turn)
    high = tool_down_postures(kinematics, np.add(place, (0, 0, 0.06)), turn)
    stages = []
    for q, opening, height in (
        (seen[:, 8:14], 0.1, None),
        (high, 0.1, None),
        (low, 0.1, None),
        (low, 0.06, None),
        (low, 0.05, 0.0),
        (high, 0.05, 0.05),
        (high, 0.05, 0.12),
    ):
        now = seen.copy()
        now[:, 8:14], now[:, 14] = q, opening
        now[:, 15:18] = 0.0 if height is not None else place - kinematics.positions(q)
        held = np.full(20, height is not None)
        stages.append(reward(np.zeros(20), {"observation": now, "held": held, "clearance": np.full(20, height or 0.0)}))
    assert (np.diff(stages, axis=0) > 0).all()
