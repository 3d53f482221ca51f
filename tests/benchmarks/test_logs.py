"""The learning curves of the published trainings."""

import numpy as np
import pytest

import benchmarks.learners  # noqa: F401 (registers its recipes)
from benchmarks.logs import EPISODE, REWARDS, discounted_returns, load_logs, log_names, logged_policies
from benchmarks.logs.build import POLICIES
from kinreach.baselines import get_recipe
from kinreach.baselines._learning_curve import COLUMNS
from kinreach.errors import InputError, UnknownNameError


def imitated(recipe):
    """Steps of a demonstrator's before the training, which are in the curve."""
    return recipe.settings.get("rounds", 0) * recipe.settings.get("length", 0) * recipe.num_envs


def test_logs_are_whole_learning_curves_of_their_recipes():
    curves = 0
    for name in log_names():
        recipe = get_recipe(name)
        for log in load_logs(name).values():
            assert set(log) == set(COLUMNS)
            assert 10 <= len(log["steps"]) <= 750
            assert (np.diff(log["steps"]) > 0).all()
            assert 0.9 < log["steps"][-1] / (recipe.walk * recipe.steps + imitated(recipe)) < 1.02
            curves += 1
    assert curves >= 100


def test_policies_are_among_the_logs_where_a_notebook_looks_into_them():
    for name, seeds in POLICIES.items():
        assert sorted(logged_policies(name)) == list(seeds)
    with pytest.raises(InputError, match="no policies with the logs"):
        logged_policies("td3-single")


def test_traced_episodes_are_at_most_a_hundred_steps():
    for name in ("thesis-ppo-multi", "sb3-multi"):
        for episode in load_logs(name, EPISODE).values():
            assert 1 <= len(episode["distance"]) <= 100
            assert (episode["steps"] > 25_000).all()


def test_what_followed_a_step_is_sampled_over_the_whole_training():
    for name in ("thesis-ppo-single", "sb3-single", "thesis-ppo-multi", "sb3-multi"):
        (log,) = load_logs(name, REWARDS).values()
        assert 5000 < len(log["steps"]) == len(log["discounted"]) <= 7600
        assert log["steps"][-1] > 0.99 * get_recipe(name).steps
        assert np.isfinite(log["discounted"]).all()


def test_what_is_not_there_is_named(tmp_path):
    with pytest.raises(UnknownNameError, match="thesis-ppo-single"):
        load_logs("nothing")
    with pytest.raises(UnknownNameError, match="curve"):
        load_logs("ranked-single", "song")
    with pytest.raises(InputError):
        load_logs("ranked-single", EPISODE)
    with pytest.raises(InputError):
        load_logs("ranked-single", runs=tmp_path)


def test_discounted_returns_are_the_sums():
    cases = 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        rewards, ends, gamma = rng.normal(size=40), rng.random(40) < 0.15, float(rng.uniform())
        returns = discounted_returns(rewards, ends, gamma)
        for step in range(40):
            later = np.flatnonzero(ends[step:])
            stop = step + (later[0] + 1 if later.size else 40 - step)
            assert returns[step] == pytest.approx(sum(gamma**k * r for k, r in enumerate(rewards[step:stop])))
            cases += 1
    assert cases == 2000


def test_the_thesis_sum():
    """Section 5.2: a reward of 2 for 100 steps with gamma 0.99 makes 126.79 (100 terms; the thesis's 101st is 0.73)."""
    returns = discounted_returns(np.full(101, 2.0), np.arange(101) == 100, 0.99)
    assert returns[1] == pytest.approx(126.79, abs=0.01)
    assert returns[0] - 0.99**100 * 2 == pytest.approx(126.79, abs=0.01)
