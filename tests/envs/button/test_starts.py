"""Where episodes start: targets that the arm reaches, in all four quadrants, and the arm's state."""

import gymnasium as gym
import numpy as np
import pytest

import kinreach
from kinreach.errors import InputError
from kinreach.kinematics import Arm3Kinematics

NAME = "kinreach/ButtonPress-v0"
KIN = Arm3Kinematics(base="world")
OUT_OF_REACH = (0.21, 0.21, 0.3)  # in the region of targets, too near for joints that bend by 2 rad


def make(**options):
    assert kinreach.__version__
    return gym.make(NAME, **options)


def test_all_targets_of_3000_resets_can_be_reached():
    env = make(dtype="float64").unwrapped
    targets, states = [], []
    for index in range(3_000):
        observation, info = env.reset(seed=0 if index == 0 else None)
        targets.append(info["goal"])
        states.append(observation)
    targets, states = np.array(targets), np.array(states)
    solutions = KIN.batch(targets)
    assert solutions.valid.any(axis=1).all()
    rows = np.arange(len(targets))
    q = solutions.q[rows, solutions.valid.argmax(axis=1)]
    assert KIN.within_limits(q[0])
    assert ((q >= KIN.lower) & (q <= KIN.upper)).all()
    np.testing.assert_allclose(KIN.positions(q), targets, atol=1e-9)  # forward kinematics, not the inverse, says so
    assert len(np.unique(targets, axis=0)) == 3_000
    np.testing.assert_array_equal(states[:, 6:9], targets)

    across, height = np.abs(targets[:, :2]), targets[:, 2]
    assert across.min() >= 0.2
    assert across.max() <= 0.6
    assert height.min() >= 0.1
    assert height.max() <= 0.6
    quadrants = np.bincount(2 * (targets[:, 0] > 0) + (targets[:, 1] > 0), minlength=4)
    assert (quadrants > 690).all()

    angles, speeds = np.arctan2(states[:, 3:6], states[:, :3]), states[:, 12:15]
    for values in (angles, speeds):
        assert (np.abs(values) <= 0.1).all()
        assert (np.ptp(values, axis=0) > 0.19).all()
    assert not states[:, 18].any()


def test_the_region_has_targets_out_of_reach_and_they_are_told_apart():
    region = KIN.arm.workcell.goals
    targets = region.sample(np.random.default_rng(3), 20_000)
    missed = targets[~KIN.batch(targets).valid.any(axis=1)]
    assert 50 < len(missed) < 300
    for target in missed[:100]:
        assert not KIN.all_solutions(target).success


def test_targets_out_of_reach_are_refused():
    assert not KIN.all_solutions(OUT_OF_REACH).success
    with pytest.raises(InputError, match=r"goal .* cannot be reached"):
        make().reset(options={"goal": OUT_OF_REACH})
    with pytest.raises(InputError, match=r"fixed_target .* cannot be reached"):
        make(fixed_target=OUT_OF_REACH)
    batch = gym.make_vec(NAME, num_envs=2, vectorization_mode="vector_entry_point")
    with pytest.raises(InputError, match=r"goal .* cannot be reached"):
        batch.reset(options={"goal": [[0.4, 0.3, 0.3], OUT_OF_REACH]})


def test_a_fixed_target_stays_and_the_arm_does_not():
    env = make(fixed_target=True)
    observation, info = env.reset(seed=1)
    again = [env.reset() for _ in range(5)]
    assert all((other["goal"] == info["goal"]).all() for _, other in again)
    assert len({float(seen[3]) for seen, _ in again}) == 5
    assert (env.reset(seed=2)[1]["goal"] != info["goal"]).any()
    np.testing.assert_array_equal(env.reset(seed=1)[0], observation)
    point = (0.4, -0.3, 0.3)
    env.reset(options={"goal": point})
    np.testing.assert_array_equal(env.reset()[1]["goal"], point)

    given = make(fixed_target=point, dtype="float64")
    for seed in range(3):
        observation, info = given.reset(seed=seed)
        np.testing.assert_array_equal(info["goal"], point)
        np.testing.assert_array_equal(observation[6:9], point)


def test_reset_options():
    env = make()
    q, goal = np.array([0.5, -0.7, 1.1]), np.array([-0.4, 0.3, 0.2])
    observation, info = env.reset(seed=0, options={"goal": goal, "q": q})
    np.testing.assert_array_equal(info["goal"], goal)
    np.testing.assert_allclose(np.arctan2(observation[3:6], observation[:3]), q, rtol=1e-6)
    np.testing.assert_allclose(observation[9:12], KIN.fk(q)[:3, 3], atol=1e-12)
    np.testing.assert_array_equal(observation[12:15], 0.0)
    assert info["distance"] == pytest.approx(np.linalg.norm(KIN.fk(q)[:3, 3] - goal))
    for options in ({"colour": "red"}, {"goal": [0.4, np.nan, 0]}, {"goal": [0.4, 0.3]}, {"q": [0, 0, 2.1]}, {"q": 0}):
        with pytest.raises(InputError):
            env.reset(options=options)
