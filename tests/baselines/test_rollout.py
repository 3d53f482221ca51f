"""The loop between policies and environments, where these are anybody's."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import kinreach  # noqa: F401 (registers the environments)
from kinreach._registration import MOVING
from kinreach._statistics import success_columns
from kinreach.baselines import evaluate, load_policy
from kinreach.baselines._loop import FunctionPolicy, RandomPolicy, rollout_batch


def test_whoever_watches_gymnasiums_own_batch_sees_the_last_observations():
    same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    env = gym.make_vec(MOVING, 3, vectorization_mode="sync", vector_kwargs=same_step)
    seen = []
    trials = rollout_batch(
        env,
        FunctionPolicy(lambda observation: np.zeros((3, 6))),
        seed=0,
        watch=lambda observations, rewards, info, first: seen.append(np.array(observations)),
    )
    env.close()
    steps = [trial["steps"] for trial in trials]
    assert len(set(steps)) > 1
    assert len(seen) == max(steps)
    for index, trial in enumerate(trials):
        np.testing.assert_allclose(seen[trial["steps"] - 1][index, 4:10], trial["q"], atol=1e-12)


@pytest.mark.parametrize("observation", [np.zeros(3, np.uint8), np.zeros(5, np.float16), np.ones(7, np.bool_), 3])
def test_chance_takes_observations_of_any_size(observation):
    policy = RandomPolicy(gym.spaces.Box(-1.0, 1.0, (2,)), seed=1)
    drawn = []
    for _ in range(2):
        policy.reset(observation, {})
        drawn.append(policy.act(observation))
    np.testing.assert_array_equal(*drawn)


def test_an_evaluation_has_what_each_episode_says():
    found = evaluate(load_policy("button-report"), goals=3)
    said = [{"reached": True, "impossible": False}, {"reached": False, "impossible": True}]
    made_up = replace(found, trials=[{**found.trials[0], **one} for one in said])
    assert made_up.reached.tolist() == [True, False]
    assert made_up.impossible.tolist() == [False, True]


def test_a_distance_that_is_no_number_is_no_success():
    columns = success_columns(lambda trial: trial["completed"])
    near, nowhere, unknown = ({"completed": True, **said} for said in ({"distance": 1e-4}, {"distance": None}, {}))
    assert [column.of(near) for column in columns] == [True] * len(columns)
    assert [column.of(nowhere) for column in columns] == [False] * len(columns)
    assert [column.of(unknown) for column in columns] == [None] * len(columns)
