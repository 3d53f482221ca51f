"""Rewards: the arm's own by default, a function of the user's in their place, checked at every call."""

import gymnasium as gym
import numpy as np
import pytest

from kinreach.envs._reach.rewards import DirectedReward, DistanceReward, ThesisReward
from kinreach.errors import InputError
from kinreach.thesis import distance_reward
from tests.envs.reach.test_space import angle_of

SINGLE, MULTI = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0"
NATURAL = np.array([-1.8, -1.0, 1.9, -2.47, -np.pi / 2, 0.0])


def own(distance, q, impossible):
    terms = {"distance": -distance, "effort": -0.01 * np.abs(q).sum(axis=1), "impossible": -1.0 * impossible}
    return sum(terms.values()), terms


class OwnVerdict:
    """A reward that also says what is reached."""

    def __call__(self, distance, q, impossible):
        return -distance, {"distance": -distance}

    def reached(self, distance, q, impossible):
        return distance < 0.6


@pytest.mark.parametrize("backend", ["kinematic", "mujoco"])
@pytest.mark.parametrize("count", [None, 4])
def test_an_own_reward_is_paid_and_says_its_terms(backend, count):
    options = {"backend": backend, "reward": own}
    if count is None:
        env = gym.make(MULTI, **options)
    else:
        env = gym.make_vec(MULTI, num_envs=count, vectorization_mode="vector_entry_point", **options)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(6):
        _, reward, *_, info = env.step(rng.uniform(-1, 1, env.action_space.shape))
        np.testing.assert_allclose(sum(info["reward_terms"].values()), reward, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(info["reward_distance"], -np.asarray(info["distance"]))
        np.testing.assert_array_equal(info["reward_impossible"], -1.0 * np.asarray(info["impossible"]))
        assert "special" not in info["reward_terms"]
        assert np.shape(info["reached"]) == (() if count is None else (count,))
        assert np.all(np.asarray(info["posture_error"]) > 0)  # still the thesis's


def test_what_is_reached_is_the_rewards_own_business_if_it_says_so():
    plain, own_verdict = (
        gym.make(MULTI, backend="kinematic", reward=reward) for reward in (DistanceReward(0.01), OwnVerdict())
    )
    goal = np.array([0.45, 0.1, -0.175])
    for env in (plain, own_verdict):
        env.reset(options={"goal": goal})
    assert not plain.step(np.zeros(6))[2]
    _, _, terminated, _, info = own_verdict.step(np.zeros(6))
    assert 0.01 < info["distance"] < 0.6
    assert terminated
    assert info["reached"]


def test_what_is_impossible_reaches_nothing_however_near_the_arm_stands():
    for reward in (DistanceReward(0.05), ThesisReward()):
        score = reward.score(np.full(2, 0.001), np.tile(NATURAL, (2, 1)), np.array([True, False]))
        assert score.reached.tolist() == [False, True]


def test_what_is_on_a_limit_is_not_within_it():
    """On the radius, and at the largest angle or error of the posture; a rounding error less is enough."""
    radius, angle = 0.01, 0.15
    d = np.array([radius, np.nextafter(radius, 0.0), radius / 2, radius / 2, 2 * radius])
    angles = np.array([0.0, 0.0, angle, np.nextafter(angle, 0.0), 0.0])
    near, free = np.array([False, True, True, True, False]), np.zeros(5, dtype=bool)
    assert DistanceReward(radius).score(d, np.zeros((5, 6)), free).reached.tolist() == near.tolist()
    directed = DirectedReward(radius).score(d, np.zeros((5, 6)), free, angles)
    assert directed.reached.tolist() == [False, True, False, True, False]
    np.testing.assert_array_equal(directed.terms["distance"], np.where(near, 0.0, distance_reward(d)))
    np.testing.assert_array_equal(directed.terms["direction"], [0.0, 0.0, -angle, 0.0, 0.0])
    posture = ThesisReward().of_errors(d, np.zeros(5), angles, free)
    assert posture.reached.tolist() == directed.reached.tolist()
    np.testing.assert_array_equal(directed.terms["special"], posture.terms["special"])
    assert len(set(directed.terms["special"])) == 3
    barred = DirectedReward(radius).score(d, np.zeros((5, 6)), ~free, angles)
    assert not barred.reached.any()
    assert (barred.terms["special"] == barred.reward).all()
    assert len(set(barred.reward)) == 1


def test_rewards_can_be_called_as_a_users_function_is():
    rng = np.random.default_rng(0)
    d, q, angle = rng.uniform(0.0, 0.02, 60), NATURAL + rng.normal(0.0, 0.1, (60, 6)), rng.uniform(0.0, 0.3, 60)
    impossible = rng.random(60) < 0.2
    for reward, more in ((ThesisReward(), ()), (DistanceReward(0.01), ()), (DirectedReward(0.01), (angle,))):
        paid, terms = reward(d, q, impossible, *more)
        score = reward.score(d, q, impossible, *more)
        np.testing.assert_array_equal(paid, score.reward)
        np.testing.assert_allclose(sum(terms.values()), paid, rtol=0, atol=1e-12)
        assert terms.keys() == score.terms.keys()
        assert 5 < score.reached.sum() < 40


def test_the_thesiss_reward_can_be_named():
    rewards = []
    for reward in (None, ThesisReward()):
        env = gym.make(SINGLE, backend="kinematic", reward=reward)
        env.reset(seed=0)
        rewards.append(env.step(env.unwrapped.action_for(env.unwrapped.home))[1])
    assert rewards[0] == rewards[1]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda d, q, i: -d, "must return the rewards and a mapping"),
        (lambda d, q, i: (-d, {"distance": d}), "do not add up"),
        (lambda d, q, i: (-d[0], {"distance": -d}), r"reward must have shape \(1,\)"),
        (lambda d, q, i: (-d, {"distance": 1.0}), r"'distance' must have shape \(1,\)"),
        (lambda d, q, i: (-d, {"distance": -d * np.nan}), "finite"),
        (lambda d, q, i: ("much", {}), "array of numbers"),
    ],
)
def test_what_is_no_reward_is_refused(answer, message):
    env = gym.make(SINGLE, backend="kinematic", reward=answer).unwrapped
    env.reset(seed=0)
    with pytest.raises(InputError, match=message):
        env.step(np.zeros(6))


@pytest.mark.parametrize(("answer", "said"), [(True, r"reached must have shape \(1,\)"), ([0.5], "true or false")])
def test_what_is_no_verdict_is_refused(answer, said):
    class Verdict(OwnVerdict):
        def reached(self, distance, q, impossible):
            return answer

    env = gym.make(SINGLE, backend="kinematic", reward=Verdict()).unwrapped
    env.reset(seed=0)
    with pytest.raises(InputError, match=said):
        env.step(np.zeros(6))


def test_what_cannot_be_called_is_refused():
    with pytest.raises(InputError, match=r"reward must be .*a callable"):
        gym.make(SINGLE, reward="much")


@pytest.mark.parametrize("kind", [DistanceReward, DirectedReward])
@pytest.mark.parametrize("radius", ["x", None, 0.0, -0.01, np.nan, True])
def test_a_radius_is_a_length(kind, radius):
    with pytest.raises(InputError, match=r"radius \[m\] must be"):
        kind(radius)


def test_a_reward_of_directions_needs_a_task_that_has_them():
    for name in (SINGLE, MULTI):
        with pytest.raises(InputError, match="DirectedReward is for tasks in which goals have a direction"):
            gym.make(name, backend="kinematic", reward=DirectedReward(0.01))
    env = gym.make("kinreach/Reach-v0", backend="kinematic", reward=DirectedReward(0.01))
    env.reset(seed=0)
    assert "direction" in env.step(np.zeros(6))[4]["reward_terms"]


@pytest.mark.parametrize("count", [None, 3])
def test_a_reward_without_the_angle_serves_tasks_with_directions_too(count):
    for reward in (own, OwnVerdict()):
        options = {"backend": "kinematic", "reward": reward}
        if count is None:
            env = gym.make("kinreach/Reach-v0", **options)
        else:
            env = gym.make_vec("kinreach/Reach-v0", num_envs=count, vectorization_mode="vector_entry_point", **options)
        env.reset(seed=0)
        _, paid, *_, info = env.step(np.zeros(env.action_space.shape))
        np.testing.assert_array_equal(info["reward_distance"], -np.asarray(info["distance"]))
        np.testing.assert_allclose(sum(info["reward_terms"].values()), paid, rtol=0, atol=1e-15)


def test_a_reward_that_takes_other_arguments_is_refused():
    for wrong in (lambda distance, q: None, lambda d, q, i, angle: None):
        with pytest.raises(InputError, match=r"reward must take \(distance, q, impossible\), got \("):
            gym.make(SINGLE, backend="kinematic", reward=wrong)
    with pytest.raises(InputError, match=r"must take \(distance, q, impossible\), or these and angle, got \(d, q\)"):
        gym.make("kinreach/Reach-v0", backend="kinematic", reward=lambda d, q: None)
    assert gym.make(SINGLE, backend="kinematic", reward=np.hypot)  # has no signature: it is called as it is


@pytest.mark.parametrize(("given", "terms"), [(ThesisReward(), "natural_arm"), (DirectedReward(0.05), "direction")])
def test_the_error_in_space_is_the_angle_to_the_direction_whatever_the_reward(given, terms):
    env = gym.make("kinreach/Reach-v0", backend="kinematic", reward=given)
    env.reset(seed=0)
    info = env.step(env.action_space.sample())[4]
    assert terms in info["reward_terms"]
    angle = angle_of(env.unwrapped.kinematics, info["q"], info["direction"])
    np.testing.assert_allclose(info["posture_error"], angle, atol=1e-7)
