"""`actuation="report"` is the course project's world on the day of its report, 18 October 2024.

Facts of the repository github.com/ErmHuang/rl-project at commit 70e9e91 of that day, whose model and rules were run
with three releases of MuJoCo. Nothing of its code or files is here.
"""

from collections import Counter

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from kinreach._registration import BUTTON
from kinreach.envs.inside import ACTUATIONS, torque_model
from kinreach.kinematics import Arm3Kinematics
from kinreach.robots import get_arm

REPORT = ACTUATIONS["report"]
KIN = Arm3Kinematics(base="world")
PRESS = 40
#: Fastest speed of each joint in 1000 random changes of torque from rest [rad/s], the median of 20 episodes: the lower
#: and the upper of MuJoCo 4.0.0, and of 2.2.0 and 2.3.7, where facets of the meshes drive the base by themselves.
FASTEST = np.array([(0.28, 9.5), (33.2, 33.9), (58.8, 63.2)])
#: Joint angles [rad] and speeds [rad/s] after controls that act for so many timesteps of 2 ms; MuJoCo 4.0.0.
PROFILES = [
    ((0, 2, 0), 50, (0.000, 0.360, -0.765), (0.001, 6.440, -12.643)),
    ((0, 0, 2), 50, (0.000, -0.242, 0.758), (-0.001, -4.994, 15.706)),
    ((0, 1, -1), 100, (0.000, 0.906, -2.111), (0.000, 7.555, -0.235)),
]


def make(**options):
    return gym.make(BUTTON, actuation="report", **options)


@pytest.mark.slow
def test_random_actions_turn_joints_as_fast_as_there():
    count = 40
    fastest = np.zeros((count, 3))
    env = gym.make_vec(BUTTON, num_envs=count, vectorization_mode="vector_entry_point", actuation="report")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(1000):
        seen = env.step(rng.integers(0, 27, count))[0]
        fastest = np.maximum(fastest, np.abs(seen[:, 12:15]))
    env.close()
    base, *links = np.median(fastest, axis=0)
    assert FASTEST[0, 0] <= base <= FASTEST[0, 1]
    for speed, (low, high) in zip(links, FASTEST[1:], strict=True):
        assert 0.9 * low <= speed <= 1.1 * high


@pytest.mark.parametrize(("controls", "steps", "q", "qd"), PROFILES)
def test_torque_moves_the_links_as_there(controls, steps, q, qd):
    model = torque_model(get_arm("arm3"), REPORT, visual=False)
    data = mujoco.MjData(model)
    data.ctrl[:] = controls
    mujoco.mj_step(model, data, steps)
    np.testing.assert_allclose(data.qpos, q, atol=0.006)
    np.testing.assert_allclose(data.qvel, qd, atol=0.15)


def test_the_base_is_braked():
    """By what the contact between base and first link leaves of a torque, 2.9 %, and by its decay of speed, 102 / s."""
    model = torque_model(get_arm("arm3"), REPORT, visual=False)
    data = mujoco.MjData(model)

    def acceleration(speed, torque):
        mujoco.mj_resetData(model, data)
        data.qvel[0], data.qfrc_applied[0] = speed, torque
        mujoco.mj_forward(model, data)
        return data.qacc[0]

    free = 5.074  # without the contact [1/(kg m^2)]
    rest = acceleration(0.0, 0.0)
    assert (acceleration(0.0, 1000.0) - rest) / 1000.0 == pytest.approx(0.0293 * free, rel=0.01)
    assert acceleration(1.0, 0.0) - rest == pytest.approx(-102.2, rel=0.01)
    # full torque turns the base at 1000 / 686 rad/s, one action from rest at less than 0.05
    with make() as env:
        env.reset(seed=0, options={"q": np.zeros(3)})
        speeds = [env.step(22 if index < 10 else 13)[0][12] for index in range(60)]
    assert 0.0 < speeds[0] < 0.05
    assert max(speeds) == pytest.approx(1.46, abs=0.02)


def test_the_first_joint_has_no_limit():
    with make() as env:
        env.reset(seed=0, options={"q": (3.1, 0.0, 0.0)})
        for index in range(200):
            info = env.step(22 if index < 10 else 13)[4]
        assert info["q"][0] > np.pi + 0.5
        assert np.abs(info["q"][1:]).max() < 2.1


@pytest.mark.slow
def test_targets_are_where_they_are_there():
    env = gym.make_vec(BUTTON, num_envs=1000, vectorization_mode="vector_entry_point", actuation="report")
    goals = np.abs(env.reset(seed=0)[1]["goal"])
    env.close()
    assert goals[:, :2].min() == pytest.approx(0.1, abs=0.01)
    assert goals[:, :2].max() == pytest.approx(0.75, abs=0.01)
    assert goals[:, 2].min() == pytest.approx(0.0, abs=0.01)
    assert goals[:, 2].max() == pytest.approx(0.75, abs=0.01)


@pytest.mark.slow
def test_a_press_counts_by_where_the_end_effector_is_before_the_step():
    """Start with the end effector just inside or outside the radius, and let the step carry it across."""
    seen = Counter()
    rng = np.random.default_rng(0)
    env = make()
    for _ in range(400):
        q = rng.uniform((-3, -1.5, -1.5), (3, 1.5, 1.5))
        tip = KIN.fk(q)[:3, 3]
        away = rng.normal(size=3)
        goal = tip + away / np.linalg.norm(away) * (0.05 + rng.uniform(-2e-5, 2e-5))
        if tip[2] < 0.1 or not KIN.all_solutions(goal).success:
            continue
        _, start = env.reset(seed=0, options={"q": q, "goal": goal})
        _, reward, terminated, _, info = env.step(PRESS)
        before, after = start["distance"] < 0.05, info["distance"] < 0.05
        assert terminated == info["pressed"] == before
        assert info["reward_terms"] == {
            "distance": -info["distance"],
            "near": 10.0 * after,
            "wrong_press": -5.0 * (not after),
            "press": 100.0 * before,
        }
        assert reward == sum(info["reward_terms"].values())
        seen[before, after] += 1
    assert len(seen) == 4
    assert min(seen.values()) >= 10


def test_a_reward_of_your_own_leaves_how_presses_count():
    q = np.array([0.5, -0.7, 1.1])
    goal = KIN.fk(q)[:3, 3] + (0.0, 0.0, 0.0499)
    env = make(reward=lambda distance, q, press: (-distance, {"distance": -distance}))
    env.reset(seed=0, options={"q": q, "goal": goal})
    assert env.step(PRESS)[2]
