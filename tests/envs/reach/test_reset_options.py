"""Goals and postures that `reset(options=)` asks for."""

import gymnasium as gym
import numpy as np
import pytest

from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import CollisionChecker
from kinreach.robots import get_arm

MULTI = "kinreach/UR5MultiStep-v0"
GOAL = np.array([0.4, 0.1, -0.175])


def free_postures(count):
    rng = np.random.default_rng(0)
    q = np.array(get_arm("ur5-thesis").home) + rng.uniform(-0.3, 0.3, (4 * count, 6))
    return q[~CollisionChecker("ur5-thesis").impossible(q)][:count]


@pytest.mark.parametrize("backend", ["kinematic", "mujoco"])
def test_the_arm_starts_where_it_is_put_and_goals_are_measured_from_the_start_pose(backend):
    postures = free_postures(16)
    assert len(postures) == 16
    env = gym.make(MULTI, backend=backend, dtype="float64")
    seen = env.reset(options={"goal": GOAL})[0][:6]
    for q in postures:
        observation, info = env.reset(options={"goal": GOAL, "q": q})
        np.testing.assert_array_equal(observation[6:12], q)
        np.testing.assert_array_equal(observation[:6], seen)
        np.testing.assert_array_equal(info["goal"], GOAL)
    batch = gym.make_vec(MULTI, num_envs=16, vectorization_mode="vector_entry_point", backend=backend, dtype="float64")
    observations, _ = batch.reset(options={"goal": np.tile(GOAL, (16, 1)), "q": postures})
    np.testing.assert_array_equal(observations[:, 6:12], postures)
    observations, *_ = batch.step(np.zeros((16, 6)))
    np.testing.assert_allclose(observations[:, 6:12], postures, atol=0.01)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"colour": "red"}, "colour.*available: goal, q, view"),
        ({"goal": [0.4, np.nan, 0]}, "goal must be finite"),
        ({"goal": [0.4, 0]}, r"shape \(3,\)"),
        ({"q": np.zeros(5)}, r"q must have shape \(6,\)"),
        ({"q": [4.0, 0, 0, 0, 0, 0]}, "shoulder_pan_joint must be within -3.14159 … 3.14159 rad, got 4"),
        ({"q": [0, 0, 0, 0, 0, -np.pi - 1e-6]}, "wrist_3_joint must be within -3.14159 … 3.14159 rad"),
    ],
)
def test_malformed_options_are_refused(options, message):
    env = gym.make(MULTI, backend="kinematic")
    with pytest.raises(InputError, match=message):
        env.reset(options=options)
    assert issubclass(UnknownNameError, InputError)
