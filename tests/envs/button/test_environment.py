"""The button environment as a Gymnasium environment: interface, seeds, presses, ends of episodes."""

import pickle

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import kinreach
from kinreach.envs.inside import ACTUATIONS
from kinreach.errors import InputError
from kinreach.kinematics import Arm3Kinematics

NAME = "kinreach/ButtonPress-v0"
KIN = Arm3Kinematics(base="world")
TARGET = (0.4, 0.3, 0.3)
STILL, PRESS = 13, 40  # actions that change no control
both = pytest.mark.parametrize("actuation", list(ACTUATIONS))


def make(**options):
    assert kinreach.__version__
    return gym.make(NAME, **options)


def at_target(env):
    """Start with the end effector in the target."""
    return env.reset(seed=0, options={"goal": TARGET, "q": KIN.all_solutions(TARGET).q[0]})


def full_state(env):
    world = env.unwrapped._world
    state = np.empty(mujoco.mj_stateSize(world.model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(world.model, world.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    return state


@both
def test_a_seeded_reset_restores_the_whole_state(actuation):
    env = make(actuation=actuation)
    env.reset(seed=3)
    before = full_state(env)
    for _ in range(2):
        env.reset()
        for action in np.random.default_rng(1).integers(0, 54, 60):
            env.step(action)
    assert not np.array_equal(full_state(env), before)
    env.reset(seed=3)
    np.testing.assert_array_equal(full_state(env), before)


@both
def test_a_press_at_the_target_ends_the_episode(actuation):
    env = make(actuation=actuation)
    _, info = at_target(env)
    assert info["distance"] < 1e-9
    observation, reward, terminated, truncated, info = env.step(PRESS)
    assert (terminated, truncated) == (True, False)
    assert info["distance"] < 0.05
    assert reward == -info["distance"] + ACTUATIONS[actuation].near + 0.0 + 100.0
    assert info["pressed"] is info["reached"] is info["is_success"] is True
    assert not info["wrong_press"]
    assert observation[18] == 1


@both
def test_being_at_the_target_without_a_press_is_not_enough(actuation):
    env = make(actuation=actuation)
    at_target(env)
    observation, reward, terminated, truncated, info = env.step(STILL)
    assert (terminated, truncated) == (False, False)
    assert reward == -info["distance"] + ACTUATIONS[actuation].near
    assert not any(info[name] for name in ("pressed", "reached", "is_success", "wrong_press"))
    assert observation[18] == 0


@both
def test_a_press_elsewhere_costs_and_changes_nothing_else(actuation):
    env, other = make(actuation=actuation), make(actuation=actuation)
    for e in (env, other):
        e.reset(seed=2)
    for count in range(1, 4):
        observation, reward, terminated, _, info = env.step(PRESS)
        without, reward_without, *_ = other.step(STILL)
        assert reward == reward_without + ACTUATIONS[actuation].wrong_press
        assert not terminated
        assert info["wrong_press"]
        assert not info["pressed"]
        assert info["wrong_presses"] == count
        assert observation[18] == 1
        np.testing.assert_array_equal(observation[:18], without[:18])
    assert env.step(STILL)[0][18] == 0  # the push state is that of the last action
    env.reset()
    assert env.step(PRESS)[4]["wrong_presses"] == 1  # of this episode


@both
def test_the_reward_is_the_sum_of_its_terms(actuation):
    env = make(actuation=actuation, max_episode_steps=200)
    rng = np.random.default_rng(4)
    kinds = {"near": 0, "wrong_press": 0, "press": 0}
    for episode in range(20):
        at_target(env) if episode % 2 else env.reset()
        for _ in range(20):
            _, reward, terminated, _, info = env.step(rng.integers(54))
            assert list(info["reward_terms"]) == ["distance", "near", "wrong_press", "press"]
            assert sum(info["reward_terms"].values()) == reward
            for kind in kinds:
                kinds[kind] += info["reward_terms"][kind] != 0
            if terminated:
                break
    assert min(kinds.values()) >= 5


@both
def test_controls_add_up_and_are_clipped(actuation):
    env = make(actuation=actuation)
    env.reset(seed=0)
    gears = np.array(ACTUATIONS[actuation].gears)
    control, energy = np.zeros(3), 0.0
    for action in [*[26] * 13, *[0] * 3, *np.random.default_rng(0).integers(0, 27, 50)]:
        change = np.array([action // 9, action // 3 % 3, action % 3]) - 1
        control = np.clip(control + change, -10, 10)
        info = env.step(action)[4]
        data = env.unwrapped._world.data
        np.testing.assert_array_equal(data.ctrl, control)
        torque = control * gears
        np.testing.assert_allclose(data.qfrc_actuator, torque, rtol=1e-12)
        energy += (torque**2).sum() * ACTUATIONS[actuation].period
        assert info["energy"] == pytest.approx(energy, rel=1e-12)
    env.reset()
    assert env.step(STILL)[4]["energy"] == 0.0


@both
def test_a_step_takes_its_time(actuation):
    env = make(actuation=actuation)
    env.reset(seed=0)
    for _ in range(25):
        info = env.step(STILL)[4]
    expected = {"tuned": 0.04, "report": 0.004}[actuation]
    assert env.unwrapped._world.data.time == pytest.approx(25 * expected)
    assert env.metadata["render_fps"] == round(1 / expected)
    assert info["steps"] == 25


@pytest.mark.parametrize(("options", "steps"), [({}, 1000), ({"max_episode_steps": 7}, 7)])
def test_episodes_are_truncated(options, steps):
    env = make(**options)
    env.reset(seed=0)
    flags = [env.step(STILL)[2:4] for _ in range(steps)]
    assert flags == [(False, False)] * (steps - 1) + [(False, True)]


@pytest.mark.parametrize("speed", [np.nan, np.inf, 1e12, 2e4])
def test_a_simulation_that_diverges_ends_the_episode(speed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log where it stands
    env = make().unwrapped
    env.reset(seed=0)
    before = env.step(STILL)[0]
    env._world.qd[0, 1] = speed
    observation, reward, terminated, truncated, info = env.step(STILL)
    assert (terminated, truncated) == (False, True)
    assert info["impossible"]
    assert np.isfinite(reward)
    np.testing.assert_array_equal(observation, before)
    assert env.observation_space.contains(env.reset()[0])
    assert not env.step(STILL)[4]["impossible"]


@both
def test_pickling_and_closing_twice(actuation):
    env = make(actuation=actuation, fixed_target=TARGET, max_episode_steps=5).unwrapped
    twin = pickle.loads(pickle.dumps(env))
    assert data_equivalence(env.reset(seed=1), twin.reset(seed=1))
    assert data_equivalence(env.step(3), twin.step(3))
    for _ in range(2):
        env.close()


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"actuation": "magic"}, "report, tuned"),
        ({"render_mode": "hologram"}, "rgb_array"),
        ({"fixed_target": (0.4, 0.3)}, "fixed_target"),
        ({"fixed_target": "there"}, "fixed_target"),
    ],
)
def test_options_that_cannot_be_are_refused(options, error):
    with pytest.raises(InputError, match=error):
        type(make().unwrapped)(**options)
