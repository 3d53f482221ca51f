"""The native batch of the button environment equals single environments, and behaves as a vector environment."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import kinreach
from kinreach.envs.inside import ACTUATIONS
from kinreach.errors import InputError
from kinreach.kinematics import Arm3Kinematics

NAME = "kinreach/ButtonPress-v0"
KIN = Arm3Kinematics(base="world")


def make_vec(count, **options):
    assert kinreach.__version__
    return gym.make_vec(NAME, num_envs=count, vectorization_mode="vector_entry_point", **options)


@pytest.mark.parametrize("actuation", list(ACTUATIONS))
@pytest.mark.slow
def test_a_batch_equals_single_environments_bit_for_bit(actuation):
    count = 6
    batch = make_vec(count, actuation=actuation, max_episode_steps=40, threads=2)
    singles = [gym.make(NAME, actuation=actuation, max_episode_steps=40) for _ in range(count)]
    observations, info = batch.reset(seed=21)
    for i, env in enumerate(singles):
        observation, single_info = env.reset(seed=21 + i)
        np.testing.assert_array_equal(observations[i], observation)
        assert info.keys() - {f"_{key}" for key in single_info} == single_info.keys()
        for key, value in single_info.items():
            if key == "reward_terms":
                assert {name: term[i] for name, term in info[key].items()} == value
            else:
                np.testing.assert_array_equal(info[key][i], value)
    # some start at their target, so that presses count
    goals = np.array(info["goal"])
    q = np.array([KIN.all_solutions(goal).q[0] for goal in goals])
    observations, _ = batch.reset(options={"goal": goals, "q": q})
    for i, env in enumerate(singles):
        np.testing.assert_array_equal(observations[i], env.reset(options={"goal": goals[i], "q": q[i]})[0])
    pressed = truncated_ones = compared = 0
    for actions in np.random.default_rng(0).integers(0, 54, (90, count)):
        observations, rewards, terminated, truncated, info = batch.step(actions)
        for i, env in enumerate(singles):
            observation, reward, over, cut, single_info = env.step(actions[i])
            assert (rewards[i], terminated[i], truncated[i]) == (reward, over, cut)
            last = info["final_info"] if over or cut else info
            for key, value in single_info.items():
                if key == "reward_terms":
                    assert {name: term[i] for name, term in last[key].items()} == value
                else:
                    np.testing.assert_array_equal(last[key][i], value)
            compared += 1
            if over or cut:
                assert info["_final_obs"][i]
                np.testing.assert_array_equal(info["final_obs"][i], observation)
                observation, single_info = env.reset()
                np.testing.assert_array_equal(info["goal"][i], single_info["goal"])
                pressed += over
                truncated_ones += cut
            np.testing.assert_array_equal(observations[i], observation)
    assert compared == 90 * count
    assert pressed >= 3
    assert truncated_ones >= count
    batch.close()
    batch.close()


def test_the_result_depends_neither_on_threads_nor_on_the_number_of_environments():
    results = []
    actions = np.random.default_rng(1).integers(0, 54, (30, 64))
    for count, threads in ((64, 1), (64, 2), (5, 1)):
        batch = make_vec(count, threads=threads, max_episode_steps=20)
        batch.reset(seed=3)
        results.append([[part[:5] for part in batch.step(a[:count])[:2]] for a in actions])
    for other in results[1:]:
        for one, two in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(one[0], two[0])
            np.testing.assert_array_equal(one[1], two[1])


def test_the_vector_interface():
    batch = make_vec(5)
    assert batch.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    observations, _ = batch.reset(seed=[4, 5, 6, 7, 8])
    assert batch.observation_space.contains(observations)
    assert batch.action_space.contains(batch.action_space.sample())
    np.testing.assert_array_equal(observations, batch.reset(seed=4)[0])
    assert (batch.reset()[0] != observations).any()


def test_a_fixed_target_of_a_batch():
    batch = make_vec(4, fixed_target=True, max_episode_steps=3)
    _, first = batch.reset(seed=0)
    for _ in range(7):
        info = batch.step(np.full(4, 13))[4]
        np.testing.assert_array_equal(info["goal"], first["goal"])
    assert len(np.unique(first["goal"], axis=0)) == 4
    point = (0.4, 0.3, 0.3)
    np.testing.assert_array_equal(make_vec(2, fixed_target=point).reset(seed=0)[1]["goal"], [point, point])


def test_one_diverged_simulation_leaves_the_others_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log where it stands
    batch, untouched = make_vec(4), make_vec(4)
    for env in (batch, untouched):
        env.reset(seed=0)
    batch.unwrapped.episodes.world.qd[2, 0] = np.nan
    observations, _, terminated, truncated, info = batch.step(np.full(4, 13))
    assert truncated.tolist() == info["impossible"].tolist() == [False, False, True, False]
    assert not terminated.any()
    assert batch.observation_space.contains(observations)
    expected = untouched.step(np.full(4, 13))[0]
    np.testing.assert_array_equal(observations[[0, 1, 3]], expected[[0, 1, 3]])


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasiums_own_vectorisation_works(mode):
    env = gym.make_vec(NAME, num_envs=2, vectorization_mode=mode, max_episode_steps=3)
    env.reset(seed=0)
    for _ in range(8):
        assert np.isfinite(env.step(env.action_space.sample())[1]).all()
    env.close()


def test_malformed_input_is_refused():
    for options in ({"render_mode": "human"}, {"threads": 0}, {"actuation": "none"}, {"max_episode_steps": 0}):
        with pytest.raises(InputError):
            make_vec(2, **options)
    batch = make_vec(3)
    batch.reset(seed=0)
    with pytest.raises(InputError, match="from 0 to 53"):
        batch.step([0, 1, 54])
    with pytest.raises(InputError, match="2 seeds"):
        batch.reset(seed=[1, 2])
    for options in ({"goal": [0.4, 0.3, 0.3]}, {"q": np.full((3, 3), 2.5)}, {"ball": 1}):
        with pytest.raises(InputError):
            batch.reset(options=options)


@pytest.mark.parametrize("actuation", ["tuned", "report"])
def test_controls_and_earlier_observations_are_seen(actuation):
    batch = make_vec(6, actuation=actuation, controls=True, frames=3, max_episode_steps=12)
    plain = make_vec(6, actuation=actuation, max_episode_steps=12)
    (seen, _), (one, _) = batch.reset(seed=0), plain.reset(seed=0)
    assert batch.single_observation_space.shape == (66,)
    first = np.hstack([one, np.zeros((6, 3))])
    history, control = [first] * 3, np.zeros((6, 3))
    rng, began = np.random.default_rng(0), 0
    for _ in range(40):
        np.testing.assert_array_equal(seen, np.hstack(history))
        assert batch.observation_space.contains(seen)
        actions = rng.integers(0, 54, 6)
        one, _, terminated, truncated, _ = plain.step(actions)
        seen = batch.step(actions)[0]
        control = np.clip(control + np.stack(np.unravel_index(actions % 27, (3, 3, 3)), axis=1) - 1, -10, 10)
        over = (terminated | truncated)[:, None]
        control = np.where(over, 0, control)
        now = np.hstack([one, control])
        history = [now, *(np.where(over, now, earlier) for earlier in history[:2])]
        began += int(over.sum())
    assert began >= 18


def test_a_single_environment_sees_what_a_batch_of_one_does():
    options = {"controls": True, "frames": 2, "max_episode_steps": 9}
    env, batch = gym.make(NAME, **options), make_vec(1, autoreset_mode="Disabled", **options)
    check_env(env.unwrapped, skip_render_check=True)
    (one, _), (many, _) = env.reset(seed=5), batch.reset(seed=5)
    rng = np.random.default_rng(1)
    for _ in range(9):
        np.testing.assert_array_equal(one, many[0])
        action = int(rng.integers(27))
        one, many = env.step(action)[0], batch.step(np.array([action]))[0]
    np.testing.assert_array_equal(one, many[0])
    for options in ({"frames": 0}, {"frames": 17}, {"controls": "yes"}, {"controls": 1.0}):
        with pytest.raises(InputError):
            make_vec(1, **options)
