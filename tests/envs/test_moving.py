"""A rolling ball: its paths are what they are called, its sights are late, and the arm keeps its limits."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import kinreach  # noqa: F401
from kinreach._registration import MOVING
from kinreach.envs._moving import (
    AGE,
    ANGLES,
    BALL,
    FRAMES,
    HOLD,
    PARTS,
    PATHS,
    RADIUS,
    RATES,
    SECONDS,
    SIDEWAYS,
    TOUCH,
    moved,
    passing_times,
    travel_times,
)
from kinreach.errors import InputError, UnknownNameError

LOW, HIGH = np.array([0.32, -0.28]), np.array([0.63, 0.28])
TIMES = np.arange(round(SECONDS * FRAMES) * PARTS + 1) / (FRAMES * PARTS)


def make(**options):
    return gym.make(MOVING, disable_env_checker=True, **options)


@pytest.mark.parametrize("path", PATHS)
def test_paths(path):
    crossed = 0
    for seed in range(40):
        speed = (0.05, 0.1, 0.3, 0.6)[seed % 4]
        places = PATHS[path](np.random.default_rng(seed), speed, TIMES, LOW, HIGH)
        steps = np.diff(places, axis=0) * FRAMES * PARTS
        np.testing.assert_allclose(np.linalg.norm(steps, axis=1), speed, rtol=2e-3)
        turns = np.linalg.norm(np.diff(steps, axis=0), axis=1) * FRAMES * PARTS
        if path == "straight":
            assert turns.max() < 1e-6
        elif path == "circle":
            np.testing.assert_allclose(turns, speed**2 / RADIUS, rtol=2e-3)
            assert (places >= LOW - 1e-9).all()
            assert (places <= HIGH + 1e-9).all()
        else:
            assert 0.05 < turns.max() < SIDEWAYS + 1e-6
            each = np.split(turns, np.flatnonzero(np.diff((TIMES[2:] / HOLD).astype(int))) + 1)
            assert [len(held) for held in each] == [58, *11 * [60], 1]
            assert max(np.ptp(held) for held in each) < 1e-4
            assert min(abs(np.diff([held[0] for held in each]))) > 0.0
        inside = ((places > LOW + (HIGH - LOW) / 4) & (places < HIGH - (HIGH - LOW) / 4)).all(axis=1)
        crossed += inside.any()
        assert (places[0] >= LOW - 1e-9).all()
        assert (places[0] <= HIGH + 1e-9).all()
    assert crossed >= 25


def test_sights_are_late_and_the_arm_keeps_its_limits():
    env = make(noise=1e-12)
    world = env.unwrapped
    rng, steps = np.random.default_rng(0), 0
    for seed in range(6):
        observation, _ = env.reset(seed=seed, options={"speed": 0.1, "path": "circle"})
        over = False
        while not over:
            rates, angles = observation[RATES], observation[ANGLES]
            # far from the ball
            observation, reward, over, _, info = env.step(rng.uniform(-1, 1, 6) * 0.2 - [0, 0.5, 0, 0, 0, 0])
            steps += 1
            assert np.abs(observation[RATES]).max() <= world.speed_limit + 1e-12
            assert np.abs(observation[RATES] - rates).max() <= world.acceleration_limit / FRAMES + 1e-9
            assert np.abs(observation[ANGLES] - angles).max() <= world.speed_limit / FRAMES + 1e-9
            if info["time"] > 0.05:
                assert observation[AGE] == pytest.approx(0.05)
                late = np.linalg.norm(observation[BALL] - info["goal"])
                assert late == pytest.approx(2 * RADIUS * np.sin(0.1 * 0.05 / RADIUS / 2), rel=0.01)
            assert reward < 0
        assert info["time"] == pytest.approx(SECONDS)
        assert not info["is_success"]
    assert steps == 6 * SECONDS * FRAMES


def test_touching_ends_it():
    env = make(noise=1e-12)
    world, touched = env.unwrapped, 0
    for seed in range(5):
        _, info = env.reset(seed=seed, options={"speed": 0.05, "path": "circle"})
        over = False
        while not over:
            from kinreach.baselines._expert import tool_down_postures
            from kinreach.kinematics import UR5Kinematics

            q = tool_down_postures(UR5Kinematics(tip="tcp", base="world"), info["goal"][None])[0]
            _, reward, over, _, info = env.step(q / np.pi)
        touched += info["is_success"]
        assert info["is_success"] == (info["distance"] <= TOUCH)
        assert reward > 0.9
        assert np.linalg.norm(world._episodes.chain.positions(info["q"][None])[0] - info["goal"]) < 0.05
    assert touched == 5
    with pytest.raises(InputError, match="the episode is over"):
        env.step(q / np.pi)


def test_joints_come_to_rest_at_their_targets():
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, v, target = rng.uniform(-2, 2, 6), np.zeros(6), rng.uniform(-2, 2, 6)
        way, beyond = np.sign(target - q), 0.0
        for _ in range(1000):
            q, v = moved(q, v, target, 1 / 240, speed=3.0, acceleration=10.0)
            beyond = max(beyond, ((q - target) * way).max())
        np.testing.assert_allclose(q, target, atol=1e-6)
        assert beyond < 1e-3


def test_braking_uses_the_whole_limit():
    """From n + 1 steps of braking, n (n + 1) / 2 steps' way before the target, it rests there after n + 1 steps."""
    dt, acceleration = 1 / 240, 10.0
    brake, counted = acceleration * dt, 0
    for n in range(1, 40):
        q, v, target = np.zeros(1), np.array([(n + 1) * brake]), np.array([brake * dt * n * (n + 1) / 2])
        for left in range(n, -1, -1):
            q, v = moved(q, v, target, dt, speed=3.0, acceleration=acceleration)
            np.testing.assert_allclose(v, left * brake, atol=1e-9)
            counted += 1
        np.testing.assert_allclose(q, target, atol=1e-12)
    assert counted == 819


def test_a_batch_is_as_many_single_ones():
    """Bit for bit, over the ends of episodes, with other options too."""
    options = {"sights": 4, "delay": 0.1}
    batch = gym.make_vec(MOVING, num_envs=5, vectorization_mode="vector_entry_point", **options)
    seen, _ = batch.reset(seed=7)
    singles = [make(**options) for _ in range(5)]
    np.testing.assert_array_equal(seen, [env.reset(seed=7 + i)[0] for i, env in enumerate(singles)])
    rng, over, compared = np.random.default_rng(0), np.zeros(5, dtype=bool), 0
    while not over.all():
        actions = rng.uniform(-1, 1, (5, 6))
        seen, rewards, ended, _, info = batch.step(actions)
        for i in np.flatnonzero(~over):
            observation, reward, over[i], _, said = singles[i].step(actions[i])
            np.testing.assert_array_equal(info["final_obs"][i] if over[i] else seen[i], observation)
            told = info["final_info"] if over[i] else info
            assert (reward, over[i], said["distance"]) == (rewards[i], ended[i], told["distance"][i])
            assert said["path"] == told["path"][i]
            compared += 1
    assert compared > 5 * 20


def test_earlier_sights_are_those_of_the_frames_before():
    env, seen = make(sights=4), []
    observation, _ = env.reset(seed=3)
    for frame in range(12):
        seen.append(observation[BALL])
        before = [seen[max(frame - k, 0)] - seen[frame] for k in (1, 2, 3)]
        np.testing.assert_allclose(observation[16:].reshape(3, 3), before, atol=1e-12)
        observation = env.step(env.unwrapped.home / np.pi)[0]


def test_gymnasium_agrees():
    check_env(gym.make(MOVING).unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"speeds": (3.0,)}, InputError, "at most 2 m/s: the arm's tip is no faster, got 3"),
        ({"speeds": (0.0,)}, InputError, "the ball's speed"),
        ({"speeds": ()}, InputError, "at least one"),
        ({"paths": ("zigzag",)}, UnknownNameError, "zigzag"),
        ({"delay": -0.1}, InputError, "delay"),
        ({"noise": -1.0}, InputError, "noise"),
        ({"sights": 0}, InputError, "sights must be at least 1"),
    ],
)
def test_bad_options(options, error, said):
    with pytest.raises(error, match=said):
        make(**options)


def test_bad_input():
    env = make()
    with pytest.raises(InputError, match="reset"):
        env.unwrapped.step(np.zeros(6))
    with pytest.raises(InputError, match="must be a mapping"):
        env.unwrapped.reset(options=5)
    for options, said in (({"speed": 9.0}, "no faster"), ({"ball": 1}, "unknown reset options"), ({"path": 3}, "path")):
        with pytest.raises((InputError, UnknownNameError), match=said):
            env.reset(options=options)
    env.reset(seed=0)
    with pytest.raises(InputError, match="action"):
        env.unwrapped.step(np.zeros(5))


def test_a_refused_reset_changes_nothing():
    env, same = make().unwrapped, make().unwrapped
    for world in (env, same):
        world.reset(seed=1)
    for options in ({"speed": 9.0}, {"ball": 1}, {"path": "zigzag"}, 5):
        with pytest.raises((InputError, UnknownNameError)):
            env.reset(seed=2, options=options)
        np.testing.assert_array_equal(env.reset()[0], same.reset()[0])


def test_passing_takes_as_long_as_full_acceleration_does():
    rng, dt, passed = np.random.default_rng(8), 1e-4, 0
    q, v, targets = rng.uniform(-1.0, 1.0, 300), rng.uniform(-3.0, 3.0, 300), rng.uniform(-2.0, 2.0, 300)
    times, speeds = passing_times(q, v, targets, speed=3.0, acceleration=10.0)
    side = np.sign(targets - q)
    at, fast, seen = q.copy(), v.copy(), np.full(300, np.nan)
    for step in range(1, 20_000):
        fast = np.clip(fast + side * 10.0 * dt, -3.0, 3.0)
        at = at + dt * fast
        new = np.isnan(seen) & (side * (at - targets) >= 0.0)
        seen[new] = step * dt
        np.testing.assert_allclose(fast[new], speeds[new], atol=0.02)
        passed += int(new.sum())
    assert passed == 300
    np.testing.assert_allclose(times, seen, atol=2e-3)
    resting = travel_times(q, v, targets, speed=3.0, acceleration=10.0)
    assert (times <= resting + 1e-9).all()
    assert (times < resting - 0.1).sum() > 200
