"""The learning curves that come with the package."""

import numpy as np
import pytest

from kinreach.baselines.learning_curve import COLUMNS
from kinreach.baselines.logs import EPISODE, load_logs, log_names
from kinreach.baselines.recipes import RECIPES
from kinreach.errors import InputError, UnknownNameError


def test_every_log_is_a_learning_curve_of_a_recipe():
    names = log_names()
    assert {"thesis-single", "thesis-multi", "single", "multi", "ppo-multi-ending"} <= set(names) <= set(RECIPES)
    curves = 0
    for name in names:
        for log in load_logs(name).values():
            assert set(log) == set(COLUMNS)
            assert 10 <= len(log["steps"]) <= 2000
            assert (np.diff(log["steps"]) > 0).all()
            curves += 1
    assert curves >= 40


def test_traced_episodes_are_at_most_a_hundred_steps():
    episodes = load_logs("thesis-multi", EPISODE)
    assert len(episodes) == 5
    for episode in episodes.values():
        assert 1 <= len(episode["distance"]) <= 100
        assert (episode["steps"] > 25_000).all()


def test_what_is_not_there_is_named(tmp_path):
    with pytest.raises(UnknownNameError, match="thesis-single"):
        load_logs("nothing")
    with pytest.raises(UnknownNameError, match="curve"):
        load_logs("single", "song")
    with pytest.raises(InputError):
        load_logs("single", EPISODE)
    with pytest.raises(InputError):
        load_logs("single", runs=tmp_path)
