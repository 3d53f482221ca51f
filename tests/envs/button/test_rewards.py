"""A reward of your own for the button: paid, named, checked, and the same alone and in a batch."""

import gymnasium as gym
import numpy as np
import pytest

from kinreach._registration import BUTTON
from kinreach.errors import InputError

STILL, PRESS = 13, 40
SEED = 3


def own(distance, q, press):
    terms = {"nearness": np.exp(-distance), "bent": -0.1 * np.abs(q[:, 1]), "press": -0.5 * press}
    return sum(terms.values()), terms


class PressAnywhere:
    """A press ends the episode wherever it is."""

    def __call__(self, distance, q, press):
        return 1.0 * press, {"press": 1.0 * press}

    def reached(self, distance, q, press):
        return press


def batch(count, **options):
    return gym.make_vec(BUTTON, num_envs=count, vectorization_mode="vector_entry_point", **options)


def test_an_own_reward_is_paid_alone_and_in_a_batch():
    env, envs = gym.make(BUTTON, reward=own), batch(3, reward=own)
    env.reset(seed=SEED)
    envs.reset(seed=SEED)
    rng, wrong = np.random.default_rng(0), 0
    for _ in range(30):
        actions = rng.integers(54, size=3)
        _, reward, terminated, _, info = env.step(actions[0])
        _, rewards, _, _, infos = envs.step(actions)
        distance, press = info["distance"], bool(actions[0] >= 27)
        assert info["reward_terms"] == {
            "nearness": np.exp(-distance),
            "bent": -0.1 * abs(info["q"][1]),
            "press": -0.5 * press,
        }
        assert reward == pytest.approx(sum(info["reward_terms"].values()), abs=1e-15)
        assert info["reward_bent"] == info["reward_terms"]["bent"]
        assert rewards[0] == reward
        assert infos["reward_terms"]["bent"].shape == (3,)
        assert info["wrong_press"] == (press and distance >= 0.05)
        assert terminated == info["reached"] == (press and distance < 0.05)
        wrong += info["wrong_press"]
    assert wrong >= 5


def test_the_reward_leaves_the_task_alone():
    """The arm moves the same, and the same presses count."""
    plain, paid = gym.make(BUTTON), gym.make(BUTTON, reward=own)
    for seed in range(4):
        first, second = plain.reset(seed=seed), paid.reset(seed=seed)
        np.testing.assert_array_equal(first[0], second[0])
        for action in np.random.default_rng(seed).integers(54, size=20):
            one, other = plain.step(action), paid.step(action)
            np.testing.assert_array_equal(one[0], other[0])
            assert one[2:4] == other[2:4]
            assert {key: one[4][key] for key in ("reached", "wrong_press", "wrong_presses")} == {
                key: other[4][key] for key in ("reached", "wrong_press", "wrong_presses")
            }


def test_a_reward_may_say_what_is_reached():
    env = gym.make(BUTTON, reward=PressAnywhere())
    env.reset(seed=SEED)
    assert not env.step(STILL)[2]
    _, reward, terminated, _, info = env.step(PRESS)
    assert info["distance"] > 0.05
    assert (reward, terminated, info["reached"]) == (1.0, True, True)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda d, q, p: -d, "must return the rewards and a mapping"),
        (lambda d, q, p: (-d, {"distance": d}), "do not add up"),
        (lambda d, q, p: (-d[0], {"distance": -d}), r"reward must have shape \(1,\)"),
        (lambda d, q, p: (-d, {"distance": -d * np.nan}), "finite"),
    ],
)
def test_what_is_no_reward_is_refused(answer, message):
    env = gym.make(BUTTON, reward=answer).unwrapped
    env.reset(seed=SEED)
    with pytest.raises(InputError, match=message):
        env.step(STILL)


def test_what_cannot_be_called_is_refused():
    with pytest.raises(InputError, match="reward must be a callable of distance, q and press, got 'much'"):
        gym.make(BUTTON, reward="much")
