"""The learning curves that come with the package."""

import numpy as np
import pytest

from kinreach.baselines.learning_curve import COLUMNS
from kinreach.baselines.logs import EPISODE, REWARDS, load_logs, log_names, logged_policies
from kinreach.baselines.recipes import RECIPES
from kinreach.errors import InputError, UnknownNameError
from tools.build_logs import POLICIES


def test_every_recipe_has_the_learning_curves_of_five_seeds():
    assert log_names() == sorted(RECIPES)
    curves = 0
    for name, recipe in RECIPES.items():
        logs = load_logs(name)
        assert list(logs) == list(range(5))
        for log in logs.values():
            assert set(log) == set(COLUMNS)
            assert 10 <= len(log["steps"]) <= 750
            assert (np.diff(log["steps"]) > 0).all()
            assert 0.9 < log["steps"][-1] / (recipe.walk * recipe.steps) < 1.02
            curves += 1
    assert curves == 5 * len(RECIPES)


def test_policies_are_among_the_logs_where_a_notebook_looks_into_them():
    for name in RECIPES:
        if name in POLICIES:
            assert sorted(logged_policies(name)) == list(POLICIES[name])
        else:
            with pytest.raises(InputError, match="no policies with the logs"):
                logged_policies(name)


def test_traced_episodes_are_at_most_a_hundred_steps():
    traced = [name for name, recipe in RECIPES.items() if recipe.trace_after is not None]
    assert traced == ["thesis-multi", "thesis-multi-half-range"]
    for name in traced:
        episodes = load_logs(name, EPISODE)
        assert list(episodes) == list(range(5))
        for episode in episodes.values():
            assert 1 <= len(episode["distance"]) <= 100
            assert (episode["steps"] > 25_000).all()


def test_what_followed_a_step_is_sampled_over_the_whole_training():
    for name in ("thesis-single", "thesis-single-half-range", "thesis-multi", "thesis-multi-half-range"):
        (log,) = load_logs(name, REWARDS).values()
        assert 5000 < len(log["steps"]) == len(log["discounted"]) <= 7600
        assert log["steps"][-1] > 0.99 * RECIPES[name].steps
        assert np.isfinite(log["discounted"]).all()


def test_what_is_not_there_is_named(tmp_path):
    with pytest.raises(UnknownNameError, match="thesis-single"):
        load_logs("nothing")
    with pytest.raises(UnknownNameError, match="curve"):
        load_logs("single", "song")
    with pytest.raises(InputError):
        load_logs("single", EPISODE)
    with pytest.raises(InputError):
        load_logs("single", runs=tmp_path)
