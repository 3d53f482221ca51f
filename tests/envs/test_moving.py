"""A rolling ball: its paths are what they are called, its sights are late, and the arm keeps its limits."""

import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401
from kinreach._registration import MOVING
from kinreach.baselines.expert import tool_down_postures
from kinreach.envs.moving import (
    AGE,
    ANGLES,
    BALL,
    FRAMES,
    HOLD,
    OUTLIER,
    PARTS,
    PATHS,
    RADIUS,
    RATES,
    SECONDS,
    SIDEWAYS,
    TOUCH,
    moved,
    travel_times,
)
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import CollisionChecker, URKinematics

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
    env = make(noise=1e-12, collisions=False, dtype="float64")
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


def test_a_weaker_arm_is_slower_than_its_limits_say():
    env = make(strength=0.7, collisions=False, dtype="float64")
    world, fastest = env.unwrapped, 0.0
    observation, _ = env.reset(seed=0, options={"speed": 0.05, "path": "circle"})
    for _ in range(40):
        rates = observation[RATES]
        observation = env.step(np.array([1.0, -0.5, 0.5, -0.5, -0.5, 0.0]))[0]
        assert np.abs(observation[RATES] - rates).max() <= 0.7 * world.acceleration_limit / FRAMES + 1e-9
        fastest = max(fastest, np.abs(observation[RATES]).max())
    assert fastest == pytest.approx(0.7 * world.speed_limit)


@pytest.mark.parametrize("collisions", [False, True])
def test_a_frame_is_paid_and_ended_by_what_happens_in_its_parts(collisions):
    """Beside the parts one by one, of arms that come down on balls: Pinocchio's tips, and what the checker says."""
    count, kinematics = 8, URKinematics("ur5-thesis", tip="tcp", base="world")
    checker = CollisionChecker(kinematics)
    batch = gym.make_vec(MOVING, count, "vector_entry_point", collisions=collisions)
    batch.reset(seed=2, options={"speed": 0.05, "path": "circle"})
    world, least, over = batch.unwrapped.episodes, np.full(count, np.inf), np.zeros(count, dtype=bool)
    beside = np.arange(count) % 2 == 0  # every other one comes down into the table
    dive = np.arange(count) % 4 == 1  # too fast to stop after the touch
    limits, ends, both = {"speed": world.speed_limit, "acceleration": world.acceleration_limit}, [], 0
    for frame in range(70):
        height = max(0.0, 0.1 - 0.002 * frame) + np.where(beside, -0.02, 0.008)
        height[dive] = 0.12 if frame < 25 else -0.1
        places = world.rolls[:, 8 * frame + 20] + np.column_stack([0.05 * beside, 0.0 * beside, height])
        actions = tool_down_postures(kinematics, places) / np.pi
        q, v, parts = world.q.copy(), world.v.copy(), []
        for part in range(PARTS):
            q, v = moved(q, v, np.pi * np.clip(actions, -1.0, 1.0), 1.0 / (FRAMES * PARTS), **limits)
            away = np.linalg.norm(kinematics.positions(q) - world.rolls[:, PARTS * frame + 1 + part], axis=1)
            parts.append((q, away, checker.impossible(q) if collisions else np.zeros(count, dtype=bool)))
        rested = world.q[over], world.v[over], world.frames[over]
        outcome = world.step(actions, ~over)
        reward, terminated, info = outcome.reward, outcome.terminated, outcome.info
        for before, now in zip(rested, (world.q, world.v, world.frames), strict=True):
            np.testing.assert_array_equal(now[over], before)  # of ended episodes nothing moves
        assert not (terminated | info["reached"])[over].any()
        assert not reward[over].any()
        for i in np.flatnonzero(~over):
            nearest, hit = min(away[i] for _, away, _ in parts), [part for part in parts if part[2][i]]
            least[i] = min(least[i], nearest)
            touched = nearest <= 0.01 and not hit
            both += nearest <= 0.01 and bool(hit)
            assert info["distance"][i] == pytest.approx(least[i], abs=1e-9)
            assert reward[i] == pytest.approx(-nearest + touched - bool(hit), abs=1e-9)
            assert info["reached"][i] == touched
            assert info["impossible"][i] == bool(hit)
            assert terminated[i] == (touched or bool(hit))
            np.testing.assert_allclose(info["q"][i], (hit or parts[-1:])[0][0][i], atol=1e-9)
            assert np.abs(world.v[i]).max() == 0.0 if hit else np.abs(world.v[i] - v[i]).max() < 1e-9
            ends += [bool(hit)] if terminated[i] else []
        assert not outcome.truncated.any()
        over |= terminated
        if over.all():
            break
    assert sum(ends) >= (5 if collisions else 0)
    assert len(ends) - sum(ends) >= 2
    assert both >= collisions


@pytest.mark.slow
def test_touching_ends_it():
    env = make(noise=1e-12, dtype="float64")
    world, touched = env.unwrapped, 0
    for seed in range(5):
        _, info = env.reset(seed=seed, options={"speed": 0.05, "path": "circle"})
        over = False
        while not over:
            above = max(0.008, 0.1 - 0.1 * info["time"])  # comes down slowly: the fingers end 15 mm above the table
            place = info["goal"] + [0.0, 0.0, above]
            q = tool_down_postures(URKinematics("ur5-thesis", tip="tcp", base="world"), place[None])[0]
            _, reward, over, _, info = env.step(q / np.pi)
        touched += info["is_success"]
        assert info["is_success"] == (info["distance"] <= TOUCH)
        assert reward > 0.9
        assert np.linalg.norm(world.episodes.chain.positions(info["q"][None])[0] - info["goal"]) < 0.05
    assert touched == 5
    with pytest.raises(InputError, match="the episode is over"):
        env.step(q / np.pi)


@pytest.mark.slow
def test_a_touch_counts_only_without_a_collision_on_the_way():
    """The same moves with and without the rule: the same until the first collision, which ends the episode."""
    checker, kinematics = CollisionChecker("ur5-thesis"), URKinematics("ur5-thesis", tip="tcp", base="world")
    free_touches = collisions = late_touches = 0
    for seed in range(16):
        ruled, lawless = make(), make(collisions=False)
        options = {"speed": 0.05}
        observation, info = ruled.reset(seed=seed, options=options)
        lawless.reset(seed=seed, options=options)
        assert (info["impossible"], info["impossible_reason"]) == (False, "")
        over = False
        while not over:
            place = observation[BALL] + [0.0, 0.0, (0.008, -0.005)[seed % 2]]
            action = tool_down_postures(kinematics, place[None])[0] / np.pi
            observation, reward, over, _, info = ruled.step(action)
            seen, _, ended, _, same = lawless.step(action)
            assert reward == sum(info["reward_terms"].values())
            assert info["impossible"] == checker.in_collision(info["q"]) == bool(info["impossible_reason"])
            assert not same["impossible"]
            if info["impossible"]:
                assert over
                assert not info["is_success"]
                assert info["impossible_reason"] == checker.reason(info["q"])
                assert info["reward_terms"]["collision"] == -1.0
            else:
                np.testing.assert_array_equal(seen, observation)
                assert (ended, same["is_success"]) == (over, info["is_success"])
        free_touches += info["is_success"]
        collisions += info["impossible"]
        while not ended:
            _, _, ended, _, same = lawless.step(action)
        late_touches += same["is_success"] and not info["is_success"]
    assert free_touches >= 3
    assert collisions >= 5
    assert late_touches >= 1


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


def test_the_least_time_of_a_way_is_what_it_takes():
    """From any speed, towards the target or away from it: beside many small steps of `moved`."""
    rng, limits, dt = np.random.default_rng(0), {"speed": 3.0, "acceleration": 10.0}, 1e-3
    q, v, target = rng.uniform(-2, 2, (300, 6)), rng.uniform(-3, 3, (300, 6)), rng.uniform(-2, 2, (300, 6))
    target[:30] = q[:30]
    expected, taken = travel_times(q, v, target, **limits), np.zeros(q.shape)
    np.testing.assert_array_equal(travel_times(q[0], v[0], target, **limits)[0], expected[0])
    for step in range(1, 4000):
        q, v = moved(q, v, target, dt, **limits)
        taken = np.where((np.abs(q - target) > 1e-6) | (np.abs(v) > 1e-3), step * dt, taken)
    assert taken.max() < 3.9
    np.testing.assert_allclose(taken, expected, atol=6 * dt)


@pytest.mark.parametrize("collisions", [False, True])
def test_a_batch_is_as_many_single_ones(collisions):
    """Bit for bit, over the ends of episodes, with other options too."""
    options = {"sights": 4, "delay": 0.1, "collisions": collisions}
    batch = gym.make_vec(MOVING, num_envs=5, vectorization_mode="vector_entry_point", **options)
    seen, _ = batch.reset(seed=7)
    singles = [make(**options) for _ in range(5)]
    np.testing.assert_array_equal(seen, [env.reset(seed=7 + i)[0] for i, env in enumerate(singles)])
    rng, over, compared = np.random.default_rng(0), np.zeros(5, dtype=bool), 0
    actions, impossible = np.tile(singles[0].unwrapped.home / np.pi, (5, 1)), 0
    while not over.all():
        actions = rng.uniform(-1, 1, (5, 6)) if not collisions else actions + rng.uniform(-0.1, 0.1, (5, 6))
        seen, rewards, ended, _, info = batch.step(actions)
        for i in np.flatnonzero(~over):
            observation, reward, over[i], _, said = singles[i].step(actions[i])
            np.testing.assert_array_equal(info["final_obs"][i] if over[i] else seen[i], observation)
            told = info["final_info"] if over[i] else info
            assert (reward, over[i], said["distance"]) == (rewards[i], ended[i], told["distance"][i])
            for name in ("path", "impossible", "impossible_reason"):
                assert said[name] == told[name][i]
            np.testing.assert_array_equal(said["q"], told["q"][i])
            compared += 1
            impossible += said["impossible"]
    assert compared > 5 * 20
    assert impossible >= 3 * collisions


def test_earlier_sights_are_those_of_the_frames_before():
    env, seen = make(sights=4, dtype="float64"), []
    observation, _ = env.reset(seed=3)
    for frame in range(12):
        seen.append(observation[BALL])
        before = [seen[max(frame - k, 0)] - seen[frame] for k in (1, 2, 3)]
        np.testing.assert_allclose(observation[16:].reshape(3, 3), before, atol=1e-12)
        observation = env.step(env.unwrapped.home / np.pi)[0]


def test_a_hidden_ball_is_reported_where_it_was_last_seen():
    """Every sight is that of a place outside of the strip, and as old as it says; the first sight is always one."""
    env, bare = (make(hidden=hidden, noise=1e-9, collisions=False, dtype="float64") for hidden in (0.2, 0.0))
    hidden, again = 0, 0
    for seed in range(30):
        reports = [env.reset(seed=seed)[0], bare.reset(seed=seed)[0]]
        last = {0.0: reports[1][BALL]}  # by the time at which it was taken
        for frame in range(1, 40):
            ended = [one.step(env.unwrapped.home / np.pi) for one in (env, bare)]
            if any(step[2] or step[3] for step in ended):
                break
            (seen, bare_seen), time = (step[0] for step in ended), frame / FRAMES
            due = max(time - bare_seen[AGE], 0.0)
            if due == 0.0 or abs(bare_seen[BALL][1]) >= 0.1:
                np.testing.assert_array_equal(seen[: AGE + 1], bare_seen[: AGE + 1])
                last[due] = bare_seen[BALL]
                again += hidden > 0
            else:
                newest = max(last)
                assert seen[AGE] == pytest.approx(time - newest)
                np.testing.assert_array_equal(seen[BALL], last[newest])
                hidden += 1
    assert hidden > 150
    assert again > 150


def test_the_age_of_a_ball_that_stays_hidden_is_in_the_space():
    env, oldest = make(hidden=0.2, speeds=(0.05,), collisions=False), 0.0
    for seed in range(4):
        (observation, _), over = env.reset(seed=seed), False
        while not over:
            assert env.observation_space.contains(observation)
            observation, _, terminated, truncated, _ = env.step(env.unwrapped.home / np.pi)
            over, oldest = terminated or truncated, max(oldest, observation[AGE])
    assert oldest > 2.5


def test_friction_slows_the_ball_until_it_stops():
    """On the way that it has without: after t seconds it is where v t - a t^2 / 2 leads."""
    friction, stopped = 0.2, 0
    for seed in range(60):
        given = {"seed": seed, "options": {"speed": (0.2, 0.4, 0.6)[seed % 3], "path": list(PATHS)[seed // 3 % 3]}}
        rolls = []
        for options in ({}, {"friction": friction}):
            env = make(**options).unwrapped
            env.reset(**given)
            rolls.append(env.episodes.rolls[0, :, :2])
        speed = given["options"]["speed"]
        speeds = np.linalg.norm(np.diff(rolls[1], axis=0), axis=1) * FRAMES * PARTS
        expected = np.maximum(speed - friction * (TIMES[1:] + TIMES[:-1]) / 2.0, 0.0)
        np.testing.assert_allclose(speeds, expected, atol=1.2e-3)
        stopped += expected[-1] == 0.0
        if given["options"]["path"] != "random":  # whose accelerations are held for a time
            ways = [np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))]) for way in rolls]
            along = np.array([np.interp(ways[1], ways[0], axis) for axis in rolls[0].T]).T
            np.testing.assert_allclose(rolls[1], along, atol=1e-4)
    assert stopped == 40


def test_a_share_of_the_sights_is_off_and_of_frames_without_one():
    """Outliers are 50 mm off, in every direction; a frame without a sight reports the last one again, older."""
    shares = {"outliers": 0.2, "dropped": 0.3}
    off, new, frames = [], 0, 0
    for seed in range(60):
        (rough, (observation, _)), (bare, (plain, _)) = (
            (env, env.reset(seed=seed, options={"path": "circle"}))
            for env in (make(noise=1e-9, collisions=False, dtype="float64", **options) for options in (shares, {}))
        )
        sights = {0.0: plain[BALL]}
        for frame in range(1, 40):
            last, time = observation, frame / FRAMES
            observation, plain = (env.step(env.unwrapped.home / np.pi)[0] for env in (rough, bare))
            sights[round(time - plain[AGE], 9)] = plain[BALL]
            if plain[AGE] == time:
                continue  # until the delay has passed, the first place is seen
            frames += 1
            if observation[AGE] > plain[AGE] + 1e-9:
                np.testing.assert_array_equal(observation[BALL], last[BALL])
                assert observation[AGE] == pytest.approx(last[AGE] + 1 / FRAMES)
                continue
            new += 1
            off.append((observation[BALL] - sights[round(time - observation[AGE], 9)])[:2])
    away = np.linalg.norm(off, axis=1)
    np.testing.assert_allclose(away[away > 1e-6], OUTLIER, atol=1e-6)
    assert np.mean(away > 1e-6) == pytest.approx(shares["outliers"], abs=0.03)
    assert new / frames == pytest.approx(1.0 - shares["dropped"], abs=0.03)
    assert frames > 2000
    angles = np.sort(np.arctan2(*np.array(off)[away > 1e-6].T))
    assert np.diff(angles).max() < 0.2


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"hidden": 0.3}, InputError, "hidden"),
        ({"speeds": (3.0,)}, InputError, "at most 2 m/s: the arm's tip is no faster, got 3"),
        ({"speeds": ()}, InputError, "at least one"),
        ({"paths": ("zigzag",)}, UnknownNameError, "zigzag"),
        ({"collisions": "no"}, InputError, "collisions must be true or false, got 'no'"),
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


def test_the_margin_counts_what_is_nearer_as_a_collision():
    """With the tip at a ball's height the fingers are 15 mm above the table."""
    kinematics, reasons = URKinematics("ur5-thesis", tip="tcp", base="world"), []
    for margin in (0.01, 0.02):
        env, checker = make(margin=margin), CollisionChecker("ur5-thesis", margin=margin)
        _, info = env.reset(seed=0, options={"speed": 0.05, "path": "circle"})
        x, y, z = 0.45, -0.29 * np.sign(info["goal"][1]), info["goal"][2]
        over = False
        while not over:
            place = np.array([[x, y, z + max(0.0, 0.1 - 0.1 * info["time"])]])  # comes down slowly
            _, _, over, _, info = env.step(tool_down_postures(kinematics, place)[0] / np.pi)
            assert checker.in_collision(info["q"]) == info["impossible"]
        reasons.append(info["impossible_reason"])
    assert reasons[0] == ""
    assert reasons[1].endswith("- table")
