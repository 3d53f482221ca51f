"""The last step of an episode: a limit truncates it, as Gymnasium's does, whether or not the step terminates it."""

import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401 (registers the environments)
from kinreach.kinematics import Arm3Kinematics, URKinematics

MULTI, BUTTON = "kinreach/UR5MultiStep-v0", "kinreach/ButtonPress-v0"
NATURAL = np.array([-1.8, -1.0, 1.9, -2.47, -np.pi / 2, 0.0])
PRESS, WAIT = 40, 13


def made(name, count, **options):
    if count is None:
        return gym.make(name, **options)
    return gym.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", **options)


def rows(value, count):
    return value if count is None else np.tile(value, (count, 1)) if np.ndim(value) else np.full(count, value)


@pytest.mark.parametrize("count", [None, 2])
@pytest.mark.parametrize("backend", ["kinematic", "mujoco"])
@pytest.mark.parametrize("last", ["reached", "missed"])
def test_the_hundredth_step(last, backend, count):
    env = made(MULTI, count, backend=backend)
    turn = np.array([np.radians(4.0), 0, 0, 0, 0, 0])
    goal = URKinematics("ur5-thesis", tip="tcp", base="world").positions(NATURAL)
    env.reset(options={"q": rows(NATURAL - turn, count), "goal": rows(goal, count)})
    for _ in range(99):
        _, _, terminated, truncated, info = env.step(rows(np.zeros(6), count))
        assert not np.any(terminated | truncated)
        assert not np.any(info["reached"])
    action = turn / np.radians(5.0) if last == "reached" else np.zeros(6)
    _, _, terminated, truncated, _ = env.step(rows(action, count))
    assert np.all(terminated == (last == "reached"))
    assert np.all(truncated)


@pytest.mark.parametrize("count", [None, 2])
@pytest.mark.parametrize("action", [PRESS, WAIT])
def test_the_last_step_of_the_button(action, count):
    env = made(BUTTON, count, max_episode_steps=1)
    q = np.array([0.3, 0.8, 0.9])
    goal = Arm3Kinematics(base="world").positions(q)
    env.reset(options={"q": rows(q, count), "goal": rows(goal, count)})
    _, _, terminated, truncated, info = env.step(rows(action, count))
    assert np.all(np.asarray(info["distance"]) < 0.05)
    assert np.all(terminated == (action == PRESS))
    assert np.all(truncated)
