"""Objects brought to a place: starts, checkers of other people, and goals."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from kinreach._registration import PICK_AND_PLACE, PUSH
from kinreach.envs._tabletop_tasks import EDGE, HIGHEST, PUSHES, PickAndPlace, Push
from kinreach.errors import InputError
from kinreach.robots import BoxRegion

REGION = BoxRegion((0.3, 0.65), (-0.3, 0.3), (-0.2, -0.2))
METHODS = ("compute_reward", "compute_terminated", "compute_truncated")


def test_pushes_are_short_and_leave_room_behind():
    places, yaws, goals = Push().sample(np.random.default_rng(0), 2000, REGION)
    ways = np.linalg.norm(goals[:, :2] - places, axis=1)
    assert PUSHES[0] <= ways.min() < 0.07 < 0.19 < ways.max() <= PUSHES[1]
    for points in (places, goals):
        assert (points[:, :2] >= (0.3 + EDGE, -0.3 + EDGE)).all()
        assert (points[:, :2] <= (0.65 - EDGE, 0.3 - EDGE)).all()
    np.testing.assert_allclose(goals[:, 2], -0.175)
    assert yaws.min() < -3.0 < 3.0 < yaws.max()


def test_half_of_the_places_are_on_the_table():
    places, _, goals = PickAndPlace(size=0.02).sample(np.random.default_rng(1), 2000, REGION)
    heights = goals[:, 2] + 0.18
    assert heights.min() == pytest.approx(0.0, abs=1e-12)
    assert np.mean(heights < 1e-9) == pytest.approx(0.5, abs=0.04)
    assert 0.95 * HIGHEST < heights.max() <= HIGHEST
    assert np.linalg.norm(goals[:, :2] - places, axis=1).min() >= PUSHES[0]


@pytest.mark.parametrize("goal_env", [False, True])
@pytest.mark.parametrize(
    ("name", "control", "actions"),
    [
        (PUSH, "joints", 6),
        (PUSH, "position", 3),
        (PUSH, "pose", 6),
        (PICK_AND_PLACE, "joints", 7),
        (PICK_AND_PLACE, "position", 4),
        (PICK_AND_PLACE, "pose", 7),
    ],
)
def test_checkers(name, control, actions, goal_env):
    env = gym.make(name, control=control, goal_env=goal_env).unwrapped
    check_env(env, skip_render_check=True)
    pytest.importorskip("stable_baselines3.common.env_checker").check_env(env, warn=False)
    assert env.action_space.shape == (actions,)
    size = env.observation_space["observation"].shape[0] if goal_env else env.observation_space.shape[0] - 3
    assert size == 6 + 1 + 3 + 3 + 6


def agreeing(name, reward, wanted, count):
    """How many transitions have the rewards and ends of their steps, how many reach a goal, and how many collide."""
    env = gym.make_vec(
        name, count, "vector_entry_point", goal_env=True, reward=reward, dtype="float64", autoreset_mode="Disabled"
    )
    rng, task = np.random.default_rng(3), env.unwrapped
    env.action_space.seed(4)
    found = reached = collided = 0
    while found < wanted:
        places = rng.uniform((0.4, -0.2), (0.6, 0.2), (count, 2))
        away = rng.uniform(-0.02, 0.02, (count, 2))
        goals = np.column_stack([places + away, np.full(count, -0.175)])
        env.reset(seed=found, options={"place": places, "goal": goals})
        down = np.zeros((count, env.single_action_space.shape[0]))
        down[:, 1] = 1.0  # the shoulder, into the table
        for step in range(40):
            actions = np.where(np.arange(count)[:, None] % 2, down, env.action_space.sample())
            seen, *stepped, info = env.step(actions)
            goals = seen["achieved_goal"], seen["desired_goal"]
            for method, value in zip(METHODS, stepped, strict=True):
                said = getattr(task, method)(*goals, info)
                assert said.shape == (count,)
                np.testing.assert_array_equal(said, value)
            found, reached = found + count, reached + info["is_success"].sum()
            collided += info["impossible"].sum()
            over = stepped[1] | stepped[2]
            if over.all() or step == 39:
                break
            if over.any():
                far = np.tile((0.4, 0.0, 0.0), (count, 1))
                env.reset(options={"reset_mask": over, "place": places, "goal": far})
    env.close()
    return found, reached, collided


@pytest.mark.parametrize("reward", ["dense", "sparse"])
def test_rewards_of_goals_are_those_of_steps(reward):
    found, reached, collided = agreeing(PICK_AND_PLACE, reward, 300, 8)
    assert found >= 300
    assert min(reached, collided) > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", [PUSH, PICK_AND_PLACE])
@pytest.mark.parametrize("reward", ["dense", "sparse"])
def test_rewards_of_goals_are_those_of_ten_thousand_steps(name, reward):
    found, reached, collided = agreeing(name, reward, 10_000, 64)
    assert found >= 10_000
    assert min(reached, collided) > 50


def test_goals_of_hindsight_are_reached():
    """What was achieved is a goal that is reached, one step or rows; a place 3 cm away is not."""
    env = gym.make(PUSH, goal_env=True, reward="sparse").unwrapped
    seen, info = env.reset(seed=0)
    achieved = seen["achieved_goal"]
    assert env.compute_reward(achieved, achieved, info) == 0.0
    assert env.compute_reward(achieved, achieved + np.array([0.03, 0.0, 0.0]), info) == -1.0
    rows = np.tile(achieved, (4, 1))
    np.testing.assert_array_equal(env.compute_reward(rows, rows, [info] * 4), 0.0)
    assert not env.compute_terminated(achieved, seen["desired_goal"], info)
    with pytest.raises(AttributeError, match="goal_env=True"):
        _ = gym.make(PUSH).unwrapped.compute_reward


def test_object_and_arm_are_a_choice():
    env = gym.make(PUSH, arm="ur5e", shape="cylinder", size=0.03, within=0.01).unwrapped
    _, info = env.reset(seed=0)
    assert env.arm.name == "ur5e"
    assert info["position"][2] == pytest.approx(env.region.z[0] + 0.03, abs=1e-3)
    with pytest.raises(TypeError, match=r"unexpected keyword argument 'colour'; available: arm, shape, .*, reward"):
        gym.make(PUSH, colour="red")
    for wrong in ({"within": 0.0}, {"shape": "cone"}, {"size": 1.0}, {"reward": "mine"}, {"goal_env": 1}):
        with pytest.raises(InputError):
            gym.make(PUSH, **wrong)
