"""Goals of environments, in their parts."""

import numpy as np

import kinreach  # noqa: F401 (registers the environments)
from kinreach.envs._lift.lift_task import HEIGHT, HOLD
from tests.envs.test_goal_env import single


def test_the_parts_of_a_goal_are_place_direction_and_posture():
    """An action that is impossible reaches nothing, and a posture may be as bad as it is allowed to be."""
    reach, plane, lift = (single(form, reward="sparse").unwrapped for form in ("reach", "plane", "lift"))
    down, tilted, at = [0.0, 0, -1], [0.0, np.sin(0.14), -np.cos(0.14)], [0.4, 0, 0.1]
    assert reach.compute_reward([*at, *down], [*at, *tilted], {}) == 0.0
    assert reach.compute_reward([*at, *down], [*at, 0, np.sin(0.16), -np.cos(0.16)], {}) == -1.0
    assert reach.compute_reward([*at, *down], [0.4, 0, 0.1099, *down], {}) == 0.0
    assert reach.compute_reward([*at, *down], [0.4, 0, 0.1101, *down], {}) == -1.0
    assert reach.compute_reward([*at, *down], [*at, *down], {"impossible": True}) == -1.0
    assert plane.compute_reward([*at, 0.1, 0.04], [*at, 0, 0], {}) == 0.0
    assert plane.compute_reward([*at, 0.1, 0.06], [*at, 0, 0], {}) == -1.0
    assert plane.compute_reward([*at, 25.1, 0.06], [*at, 25, 0], {}) == -1.0
    assert plane.compute_reward([*at, 25.1, 0.04], [*at, 25, 0], {}) == 0.0
    assert lift.compute_reward([HEIGHT, HOLD], [HEIGHT, HOLD], {}) == 0.0
    assert lift.compute_reward([0.15, 0.4], [HEIGHT, HOLD], {}) == -1.0
    assert lift.compute_terminated([0.0, 0], [HEIGHT, HOLD], {"attempts": 1}) is False
    assert lift.compute_terminated([0.0, 0], [HEIGHT, HOLD], {"attempts": 2}) is True
    assert plane.compute_terminated([*at, 0, 0], [*at, 0, 0], {}) is True
    assert reach.compute_terminated([*at, *down], [*at, *down], {}) is False  # end_on_reached=False
