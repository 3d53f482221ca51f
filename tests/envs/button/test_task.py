"""The rules of the button task, each by itself: actions, observations, rewards."""

import numpy as np
import pytest

from kinreach.envs._button.button_task import (
    ACTIONS,
    INCREMENTS,
    action_of,
    action_space,
    button_reward,
    check_actions,
    meaning,
    observation,
    observation_space,
)
from kinreach.errors import InputError


def test_the_54_actions_are_distinct_and_in_the_reports_order():
    assert action_space().n == ACTIONS == 54
    change, press = meaning(np.arange(54))
    assert len({(*row, flag) for row, flag in zip(change.tolist(), press.tolist(), strict=True)}) == 54
    assert press.tolist() == [False] * 27 + [True] * 27
    # the report: 27 = 3^3 torque actions first, from all decreasing to all increasing, the last joint fastest
    written = [(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)]
    assert [tuple(row) for row in change[:27]] == written
    np.testing.assert_array_equal(change[27:], change[:27])
    np.testing.assert_array_equal(action_of(change, press), np.arange(54))
    assert not INCREMENTS[13].any()


def test_observation_layout():
    rng = np.random.default_rng(0)
    q, qd, tip, goals = rng.normal(size=(4, 7, 3))
    pushed = np.arange(7) % 2 == 0
    seen = observation(q, qd, tip, goals, pushed)
    assert seen.shape == (7, 19)
    parts = [np.cos(q), np.sin(q), goals, tip, qd, tip - goals]
    for index, part in enumerate(parts):
        np.testing.assert_array_equal(seen[:, 3 * index : 3 * index + 3], part)
    assert seen[:, 18].tolist() == [1, 0, 1, 0, 1, 0, 1]
    assert observation_space().shape == (19,)


@pytest.mark.parametrize(
    ("distance", "press", "terms"),
    [
        (0.30, False, (-0.30, 0.0, 0.0, 0.0)),  # the distance alone
        (0.00, False, (0.0, 0.1, 0.0, 0.0)),  # being near alone
        (0.04, False, (-0.04, 0.1, 0.0, 0.0)),
        (0.05, False, (-0.05, 0.0, 0.0, 0.0)),  # the radius itself is not near
        (0.05, True, (-0.05, 0.0, -1.0, 0.0)),
        (0.30, True, (-0.30, 0.0, -1.0, 0.0)),  # a wrong press
        (0.04, True, (-0.04, 0.1, 0.0, 100.0)),  # a press that counts
    ],
)
def test_each_part_of_the_reward(distance, press, terms):
    reward, parts = button_reward(np.array([distance]), np.array([press]))
    assert tuple(part[0] for part in parts.values()) == terms
    assert reward[0] == sum(terms)


def test_waiting_at_the_target_never_pays():
    longest = 1000
    waiting, _ = button_reward(np.zeros(1), np.zeros(1, dtype=bool))
    pressing, _ = button_reward(np.array([0.0499]), np.ones(1, dtype=bool))
    assert longest * waiting[0] <= pressing[0]


@pytest.mark.parametrize("action", [-1, 54, 1.0, True, None, "up", [1], [[1]], np.nan, np.array([1, 2]), [1, [2, 3]]])
def test_what_is_no_action_is_refused(action):
    with pytest.raises(InputError, match="action must be"):
        check_actions(action, None)


@pytest.mark.parametrize("actions", [5, [1, 2], [1, 2, 54], [0, -1, 3], [0.0, 1.0, 2.0], np.zeros((3, 1), dtype=int)])
def test_what_are_no_actions_of_a_batch_is_refused(actions):
    with pytest.raises(InputError, match="action must be"):
        check_actions(actions, 3)


@pytest.mark.parametrize("action", [0, 53, np.int64(7), np.array(7), np.uint8(53)])
def test_integers_of_all_kinds_are_actions(action):
    assert check_actions(action, None).tolist() == [int(action)]
