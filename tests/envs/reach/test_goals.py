"""Goals drawn ahead for many environments are those that each would draw alone."""

import numpy as np
import pytest

from kinreach.envs.reach.episodes import GoalStreams, goal_streams
from kinreach.errors import InputError
from kinreach.robots import Workcell, get_arm

REGION = get_arm("ur5").workcell.goals


@pytest.mark.parametrize("count", [1, 5, 300])
def test_each_sequence_is_what_its_own_generator_draws(count):
    streams = GoalStreams(REGION, count)
    for index in range(count):
        streams.seed(index, np.random.default_rng(index))
    chance = np.random.default_rng(0)
    drawn = [[] for _ in range(count)]
    for turn in range(600):  # all at once, some of them, and now and then one that starts afresh
        ids = np.arange(count) if turn % 3 == 0 else np.flatnonzero(chance.random(count) < 0.7)
        for index, goal in zip(ids, streams.draw(ids), strict=True):
            drawn[index].append(goal)
        if turn == 100:
            streams.seed(0, np.random.default_rng(0))
            drawn[0].clear()
    for index, goals in enumerate(drawn):
        np.testing.assert_array_equal(goals, REGION.sample(np.random.default_rng(index), len(goals)))
    assert min(map(len, drawn)) > 256  # more than are drawn at a time


def test_goals_that_were_drawn_stay_as_they_are():
    streams = GoalStreams(REGION, 3)
    first = streams.draw(np.arange(3))
    kept = first.copy()
    for _ in range(300):
        streams.draw(np.arange(3))
    np.testing.assert_array_equal(first, kept)


def test_regions_of_any_shape_are_drawn_from():
    cell = get_arm("arm3").workcell
    streams = goal_streams(cell, 2)
    for index in range(2):
        streams.seed(index, np.random.default_rng(index))
    drawn = np.array([streams.draw(np.arange(2)) for _ in range(200)])
    for index in range(2):
        np.testing.assert_array_equal(drawn[:, index], cell.goals.sample(np.random.default_rng(index), 256)[:200])


def test_a_cell_without_goals_says_so_when_one_is_drawn():
    streams = goal_streams(Workcell(), 1)
    with pytest.raises(InputError, match="no goals"):
        streams.draw(np.arange(1))
