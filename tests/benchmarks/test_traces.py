"""Traces are what single environments do, step by step."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.logs import trace
from kinreach.baselines import load_policy
from kinreach.baselines.inside import LearnedPolicy
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, URKinematics
from kinreach.robots import get_arm


@pytest.fixture(scope="module")
def goals():
    return get_arm("ur5-thesis").workcell.goals.sample(np.random.default_rng(3), 8)


@pytest.mark.parametrize("name", ["ranked-single", "ranked-multi", "ppo-multi"])
def test_a_trace_is_what_single_environments_do(name, goals):
    policy = load_policy(name)
    traced = trace(policy, goals, options={"backend": "kinematic"})
    env = gym.make(policy.card.environment, backend="kinematic", dtype="float64")
    lengths = []
    for index, goal in enumerate(goals):
        observation, info = env.reset(seed=0, options={"goal": goal})
        policy.reset(info)
        over, step = False, 0
        while not over:
            observation, reward, terminated, truncated, info = env.step(policy.act(observation))
            over, step = terminated or truncated, step + 1
            assert traced.distance[step, index] == pytest.approx(info["distance"], abs=1e-9)
            assert traced.posture_error[step - 1, index] == pytest.approx(info["posture_error"], abs=1e-9)
            assert traced.reward[step - 1, index] == pytest.approx(reward, abs=1e-6)
            np.testing.assert_allclose(traced.q[step, index], observation[6:12], atol=1e-9)
        lengths.append(step)
        assert (traced.reached[index], traced.impossible[index]) == (info["reached"], info["impossible"])
        np.testing.assert_array_equal(traced.distance[step:, index], traced.distance[step, index])
        assert np.isnan(traced.reward[step:, index]).all()
    assert len(traced.distance) == max(lengths) + 1
    if name != "ranked-single":
        assert min(lengths) < max(lengths)


def trained_with(name, **options):
    """A policy of the package as if it had been trained with other options."""
    policy = load_policy(name)
    return LearnedPolicy(replace(policy.card, recipe={**policy.card.recipe, "options": options}), policy.network)


def test_it_is_traced_in_what_it_was_trained_with(goals):
    policy = trained_with("thesis-ppo-single", goal_in="image")
    env = gym.make(policy.card.environment, backend="kinematic", goal_in="image", dtype="float64")
    traced = trace(policy, goals, options={"backend": "kinematic"})
    for index, goal in enumerate(goals):
        observation, _ = env.reset(seed=0, options={"goal": goal})
        np.testing.assert_allclose(traced.distance[1, index], env.step(policy.act(observation))[4]["distance"])
    in_metres = trace(policy, goals, options={"backend": "kinematic", "goal_in": "camera"})
    assert np.abs(in_metres.distance[1] - traced.distance[1]).max() > 0.01
    with pytest.raises(InputError, match="takes pictures"):
        trace(load_policy("pixels-single"), goals)


def test_the_trace_of_another_arm():
    goals = get_arm("panda").workcell.goals.sample(np.random.default_rng(3), 4)
    traced = trace(load_policy("panda-single"), goals, options={"backend": "kinematic"})
    assert traced.q.shape == (2, 4, 7)
    np.testing.assert_allclose(traced.q[0], np.tile(get_arm("panda").home, (4, 1)), atol=1e-12)
    tips = ArmKinematics.of("panda", base="world").positions(traced.q.reshape(-1, 7)).reshape(2, 4, 3)
    np.testing.assert_allclose(traced.distance, np.linalg.norm(tips - goals, axis=2), atol=1e-9)
    assert traced.reached.all()


def test_it_starts_at_home(goals):
    traced = trace(load_policy("ranked-single"), goals, options={"backend": "kinematic"})
    home = np.array(get_arm("ur5-thesis").home)
    np.testing.assert_allclose(traced.q[0], np.tile(home, (len(goals), 1)), atol=1e-12)
    tip = URKinematics("ur5-thesis", tip="tcp", base="world").fk(home)[:3, 3]
    np.testing.assert_allclose(traced.distance[0], np.linalg.norm(goals - tip, axis=1), atol=1e-9)


@pytest.mark.parametrize(
    ("name", "goals", "message"),
    [
        ("button", np.zeros((1, 3)), "UR5SingleStep"),
        ("ranked-single", np.zeros(3), "shape"),
        ("ranked-single", np.zeros((0, 3)), "sha"),
    ],
)
def test_what_cannot_be_traced_is_refused(name, goals, message):
    with pytest.raises(InputError, match=message):
        trace(load_policy(name), goals)
