"""Arms with random errors: what looks say of them is what is true of them, and a policy learns from it."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
import torch

from kinreach._registration import RANDOM_ARM
from kinreach.baselines import get_recipe
from kinreach.baselines import random_arms as arms
from kinreach.baselines._models import build
from kinreach.baselines.expert import tool_down_postures
from kinreach.cli import main
from kinreach.errors import InputError

COUNT = 60


@pytest.fixture
def env():
    found = gym.make_vec(RANDOM_ARM, num_envs=COUNT, vectorization_mode="vector_entry_point")
    found.reset(seed=0)
    yield found
    found.close()


def test_what_looks_say_is_what_is_true(env):
    """Of as many looks as an arm had: the noise of their mean is left, and 0.1 mm of what is not linear in errors."""
    world, seen = env.unwrapped.episodes, env.unwrapped.episodes.observe()
    q = tool_down_postures(arms.ur5(), arms.on_table(50))
    places = arms.ur5().chain.positions(q)
    counts = {}
    for row in range(COUNT):
        looks = int(seen[row, arms.LOOKED])
        counts[looks] = counts.get(looks, 0) + 1
        off = world.tips(q[:looks], np.full(looks, row)) - places[:looks]
        said = seen[row, arms.SUMMARY]
        np.testing.assert_allclose(said, arms.summary(places[:looks], off), atol=3e-4)
        assert looks == 0 or np.linalg.norm(said) > 1e-4
    assert set(counts) == set(arms.LOOKS)


def test_moves_to_a_ball(env):
    world = env.unwrapped.episodes
    first = world.observe()
    q = tool_down_postures(arms.ur5(), first[:, arms.BALL])
    tips = world.tips(q)
    assert 1e-3 < np.median(np.linalg.norm(tips - world.goals, axis=1)) < 2e-2
    balls = world.goals.copy()
    then, reward, over, _, info = env.step(q / np.pi)
    np.testing.assert_allclose(-reward, np.linalg.norm(tips - balls, axis=1))
    assert 0 < over.sum() < COUNT
    then = np.where(over[:, None], info["final_obs"], then)
    np.testing.assert_allclose(then[:, arms.MISSED], tips - first[:, arms.BALL], atol=6e-4)
    np.testing.assert_allclose(then[:, arms.OFF], tips - arms.ur5().chain.positions(q), atol=6e-4)
    # who adds what it was off to its target is nearer
    better = tool_down_postures(arms.ur5(), first[:, arms.BALL] - then[:, arms.OFF])
    *_, info = env.step(better / np.pi)
    assert np.median(info["distance"][~over]) < 4e-4


def test_what_is_observed_after_each_of_up_to_three_moves(env):
    """The mean of what the tip was off, and the last miss alone; episodes end after the moves that were drawn."""
    world, seen, done = env.unwrapped.episodes, env.unwrapped.episodes.observe(), np.zeros(COUNT, dtype=int)
    rng, lengths, reached = np.random.default_rng(3), [], 0
    off, noise = ([[] for _ in range(COUNT)] for _ in range(2))
    for step in range(9):
        aim = seen[:, arms.BALL] - (0.0 if step % 3 == 0 else seen[:, arms.OFF])
        q = tool_down_postures(arms.ur5(), aim) + (rng.uniform(-0.05, 0.05, (COUNT, 6)) if step % 3 == 2 else 0.0)
        tips, balls = world.tips(q), world.goals.copy()
        then, reward, over, cut, info = env.step(q / np.pi)
        last, told = then.copy(), info
        if over.any():
            last[over], told = info["final_obs"][over], info["final_info"]
        for row in range(COUNT):
            off[row].append(tips[row] - arms.ur5().chain.positions(q[[row]])[0])
            ours = told if over[row] else info
            away = np.linalg.norm(tips[row] - balls[row])
            assert ours["distance"][row] == pytest.approx(away, abs=1e-12)
            assert ours["reached"][row] == ours["is_success"][row] == (away < 5e-4)
            assert -reward[row] == pytest.approx(away, abs=1e-12)
            assert not ours["impossible"][row]
            reached += ours["reached"][row]
            np.testing.assert_allclose(last[row, arms.OFF], np.mean(off[row], axis=0), atol=6e-4)
            np.testing.assert_allclose(last[row, arms.MISSED], tips[row] - seen[row, arms.BALL], atol=6e-4)
            noise[row].append(last[row, arms.MISSED] - (tips[row] - seen[row, arms.BALL]))
            done[row] += 1
            assert last[row, arms.DONE] == done[row]
            if over[row]:
                lengths.append(done[row])
                assert len(np.unique(np.round(noise[row], 9), axis=0)) == done[row]  # each look has its own
                done[row], off[row], noise[row] = 0, [], []
        np.testing.assert_allclose(last[:, arms.LOOKED :], seen[:, arms.LOOKED :], rtol=0, atol=1e-6)
        assert not cut.any()
        seen = then
    assert np.unique(lengths).tolist() == [1, 2, 3]
    assert len(lengths) >= 3 * COUNT
    assert 50 < reached < 9 * COUNT - 50


def test_the_objective_is_the_distance_of_the_true_tip():
    recipe = replace(get_recipe("random-arms"), num_envs=COUNT, window=COUNT)
    trainee = build(recipe, 0, steps=1000)
    try:
        model, world = trainee.model, trainee.env.get_attr("unwrapped")[0].episodes
        trainee.env.seed(3)
        observations = trainee.env.reset()
        q = tool_down_postures(arms.ur5(), world.goals)
        means = torch.as_tensor(q / np.pi, dtype=torch.float32)
        said = float(model.objective(observations)(means, torch.arange(COUNT)))
        wanted = np.linalg.norm(world.tips(q) - world.goals, axis=1).mean()
        assert said == pytest.approx(wanted, abs=1e-5)
    finally:
        trainee.env.close()


def test_the_policy_of_the_package_is_evaluated_with_and_without_its_environment(capsys):
    own = "kinreach.baselines.random_arms:" + RANDOM_ARM
    for more in ([], ["--env", own]):
        assert main(["evaluate", "random-arms", "--goals", "100", *more]) == 0
        assert "100 held-out goals" in capsys.readouterr().out
    assert main(["evaluate", "random-arms", "--goals", "100", "--env", "nowhere:" + RANDOM_ARM]) == 2
    assert "cannot import the environment nowhere:" in capsys.readouterr().err


def test_a_single_environment_is_that_of_the_batch(env):
    ours = gym.make(RANDOM_ARM)
    observation, _ = ours.reset(seed=7)
    others, _ = env.reset(seed=7)
    episodes = 0
    ours.action_space.seed(0)
    for _ in range(20):
        np.testing.assert_allclose(observation, others[0], rtol=0, atol=1e-12)
        action = ours.action_space.sample()
        observation, reward, over, _, info = ours.step(action)
        others, rewards, terminated, _, infos = env.step(np.tile(action, (COUNT, 1)))
        assert over == terminated[0]
        assert reward == pytest.approx(rewards[0], abs=1e-12)
        last = infos["final_info"] if over else infos
        assert info["distance"] == pytest.approx(last["distance"][0], abs=1e-12)
        if over:
            observation, _ = ours.reset()
            episodes += 1
    assert episodes > 5
    with pytest.raises(InputError, match="unknown reset options"):
        ours.reset(options={"goal": np.zeros(3)})
    with pytest.raises(InputError, match="shape"):
        ours.step(np.zeros(5))


def test_nothing_of_an_episode_can_be_asked_for(env):
    with pytest.raises(InputError, match="unknown reset options"):
        env.reset(options={"goal": np.zeros((COUNT, 3))})


def test_arms_balls_and_noise_are_as_large_as_promised(env):
    """Of many arms: frames by `ERRORS`, balls over the table and a little further, noise of 0.14 mm."""
    world = arms.RandomArmEpisodes(arms.RandomArmOptions(), 1000)
    for index in range(1000):
        world.seed(index, np.random.default_rng(index))
    world.begin(np.arange(1000))
    off = world.placements[:, :, :3, 3] - world.chain.placements[:, :3, 3]
    spread = np.sqrt((off**2).sum(axis=2).mean(axis=0))
    assert spread[0] == pytest.approx(3e-3 * 3**0.5, rel=0.1)
    assert spread[-1] == pytest.approx(3e-3 * 3**0.5, rel=0.5)
    low, high = (np.array([getattr(arms.ur5().arm.workcell.goals, axis)[end] for axis in "xyz"]) for end in (0, 1))
    np.testing.assert_allclose(world.goals.min(axis=0), low - 0.01, atol=2e-3)
    np.testing.assert_allclose(world.goals.max(axis=0), high + 0.01, atol=2e-3)
    seen = world.observe()
    miss = np.linalg.norm(seen[:, arms.BALL] - world.goals, axis=1)
    assert np.median(miss) == pytest.approx(1.4e-4, rel=0.1)
    assert (seen[:, [*range(3, 10)]] == 0.0).all()
    assert np.unique(seen[:, arms.LOOKED]).tolist() == sorted(arms.LOOKS)
    assert np.unique(world._moves).tolist() == [1, 2, 3]
