"""stable-baselines3 learns on a native batch."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import kinreach
from kinreach._registration import MULTI, SINGLE
from kinreach.errors import InputError

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO

from kinreach.baselines import SB3VecEnv, get_recipe, train


def batch(name, count):
    assert kinreach.__version__
    name = f"kinreach/{name}-v0"
    return SB3VecEnv(gym.make_vec(name, count, vectorization_mode="vector_entry_point", backend="kinematic"))


@pytest.mark.parametrize(("name", "steps"), [("UR5SingleStep", 1), ("UR5MultiStep", 100)])
def test_ends_of_episodes_are_reported(name, steps):
    env = batch(name, 4)
    env.seed(3)
    first = env.reset()
    ended = 0
    for _ in range(steps):
        observations, rewards, done, infos = env.step(np.zeros((4, 6), dtype=np.float32))
        assert observations.shape == (4, 13)
        assert rewards.dtype == np.float32
        for over, info, began, now in zip(done, infos, first, observations, strict=True):
            ended += over
            assert ("terminal_observation" in info) == over
            if over:
                np.testing.assert_array_equal(info["terminal_observation"][:6], began[:6])  # the goal that it was about
                assert (now[:6] != began[:6]).any()
                assert info["TimeLimit.truncated"] == (name == "UR5MultiStep")
                assert info["distance"] > 0
    assert ended == 4
    env.seed(3)
    np.testing.assert_array_equal(env.reset(), first)
    env.close()


def test_a_step_limit_may_be_an_end():
    """To PPO2 it is one; learners that are told of truncation add the value of what is cut off."""
    native = gym.make_vec("kinreach/UR5MultiStep-v0", 4, vectorization_mode="vector_entry_point", backend="kinematic")
    env = SB3VecEnv(native, bootstrap=False)
    env.reset()
    for _ in range(100):
        *_, done, infos = env.step(np.zeros((4, 6), dtype=np.float32))
    assert done.all()
    assert [info["TimeLimit.truncated"] for info in infos] == [False] * 4
    assert all(info["terminal_observation"].shape == (13,) for info in infos)
    env.close()


def test_ppo_trains_on_it():
    env = batch("UR5SingleStep", 64)
    model = PPO("MlpPolicy", env, n_steps=4, batch_size=64, n_epochs=1, gamma=0.0, seed=0, device="cpu")
    before = {name: value.clone() for name, value in model.policy.state_dict().items()}
    model.learn(512)
    assert model.num_timesteps == 512
    assert any((value != before[name]).any() for name, value in model.policy.state_dict().items())


def test_batches_that_reset_later_are_refused():
    env = gym.make_vec("kinreach/UR5SingleStep-v0", num_envs=2, vectorization_mode="sync", backend="kinematic")
    with pytest.raises(InputError, match="SAME_STEP"):
        SB3VecEnv(env)


@pytest.mark.parametrize("name", ["UR5MultiStep", "Lift", "Moving"])
def test_batches_of_tensors_are_refused(name):
    """stable-baselines3 takes arrays; that the tensors are on the processor does not help it."""
    env = gym.make_vec(f"kinreach/{name}-v0", 2, vectorization_mode="vector_entry_point", device="cpu")
    with pytest.raises(InputError, match="learners take arrays, not tensors: leave out the option device"):
        SB3VecEnv(env)
    env.close()


@pytest.mark.parametrize("recipe", ["ppo-multi", "imitated-push", "ranked-single", "gradient-moving-clear"])
def test_a_recipe_with_a_device_is_refused_before_the_training(recipe, tmp_path):
    given = get_recipe(recipe)
    with pytest.raises(InputError, match=r"leave out the option device.*CUDA_VISIBLE_DEVICES"):
        train(replace(given, options={**given.options, "device": "cpu"}), tmp_path / "run", steps=8)
    assert not (tmp_path / "run").exists()


def button_batch(count, **options):
    name = "kinreach/ButtonPress-v0"
    return SB3VecEnv(gym.make_vec(name, count, vectorization_mode="vector_entry_point", **options))


def test_an_environment_without_a_posture_error_is_reported_too():
    env = button_batch(3, max_episode_steps=5)
    env.reset()
    infos = [env.step(np.full(3, 40))[3] for _ in range(5)]
    assert infos[:4] == [[{}, {}, {}]] * 4
    for info in infos[4]:
        assert info["TimeLimit.truncated"]
        assert info["is_success"] is False
        assert info["wrong_presses"] == 5
        assert info["energy"] == 0.0
        assert info["terminal_observation"].shape == (19,)
        assert "posture_error" not in info


def test_ppo_trains_on_discrete_actions():
    model = PPO("MlpPolicy", button_batch(16, max_episode_steps=10), n_steps=8, batch_size=64, n_epochs=1, device="cpu")
    model.learn(256)
    assert model.num_timesteps == 256


def test_environments_of_a_batch_have_nothing_of_their_own():
    env = batch("UR5SingleStep", 3)
    assert env.env_is_wrapped(gym.Wrapper) == [False] * 3
    assert env.env_is_wrapped(gym.Wrapper, [0, 2]) == [False] * 2
    assert env.get_attr("num_envs") == [3, 3, 3]
    assert env.get_attr("num_envs", 1) == [3]
    with pytest.raises(InputError, match="seen cannot be set for some"):
        env.set_attr("seen", 3)
    with pytest.raises(InputError, match="have no methods of their own, such as render"):
        env.env_method("render")
    env.close()


def test_seeds_are_those_of_the_next_reset_only():
    env = SB3VecEnv(gym.make_vec(SINGLE, 3, "vector_entry_point", backend="kinematic"))
    starts = []
    for _ in range(2):
        env.seed(5)
        starts += [env.reset(), env.reset()]
    np.testing.assert_array_equal(starts[0], starts[2])
    np.testing.assert_array_equal(starts[1], starts[3])
    assert (starts[0] != starts[1]).any(axis=1).all()
    single = gym.make(SINGLE, backend="kinematic")
    np.testing.assert_array_equal(starts[0][2], single.reset(seed=7)[0])
    env.close()


@pytest.mark.parametrize("bootstrap", [True, False])
def test_an_episode_that_is_over_by_itself_is_not_truncated_by_its_limit_too(bootstrap):
    """The environment says both; what might have followed has no value then."""
    for name, cut in ((SINGLE, False), (MULTI, True)):
        batch = gym.make_vec(name, 4, "vector_entry_point", backend="kinematic", max_episode_steps=1)
        batch.reset(seed=0)
        _, _, terminated, truncated, _ = batch.step(np.full((4, 6), 0.1))
        assert truncated.all()
        assert terminated.all() == (not cut)
        env = SB3VecEnv(batch, bootstrap=bootstrap)
        env.seed(0)
        env.reset()
        _, _, done, infos = env.step(np.full((4, 6), 0.1))
        assert done.all()
        assert [info["TimeLimit.truncated"] for info in infos] == 4 * [cut and bootstrap]
        env.close()


def test_closing_it_closes_the_batch():
    batch, closed = gym.make_vec(SINGLE, 2, "vector_entry_point", backend="kinematic"), []
    batch.close = lambda: closed.append(True)
    env = SB3VecEnv(batch)
    assert closed == []
    env.close()
    assert closed == [True]
