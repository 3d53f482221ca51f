"""The reach environments as Gymnasium environments: interface, seeds, rewards, what is impossible."""

import itertools
import pickle
import resource

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

import kinreach
from kinreach.errors import InputError
from kinreach.kinematics import CollisionChecker, URKinematics
from kinreach.thesis import posture_error, reach_reward
from tests.cases import slow

SINGLE, MULTI = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0"
IDS = [SINGLE, MULTI]
BACKENDS = ["kinematic", "mujoco"]
HOME = np.array([-np.pi / 2, -np.pi / 2, np.pi / 2, -np.pi / 2, -np.pi / 2, 0])
KIN = URKinematics("ur5-thesis", tip="tcp", base="world")


def make(name, **options):
    assert kinreach.__version__
    return gym.make(name, **options)


def natural_postures(goal):
    """Tool-down postures of a goal on branch A and on branch B."""
    q = KIN.axis_solutions(goal, (0, 0, -1), seed=HOME).q
    a = q[(q[:, 0] <= 0) & (q[:, 2] >= 0) & (np.abs(q[:, 4] + np.pi / 2) < 1e-6)]
    b = q[(q[:, 0] >= 0) & (q[:, 2] <= 0) & (np.abs(q[:, 4] - np.pi / 2) < 1e-6)]
    return a, b


@pytest.mark.parametrize(
    ("observation", "name"), [("camera", SINGLE), ("pixels", MULTI), *slow(("camera", MULTI), ("pixels", SINGLE))]
)
def test_checks_with_cameras(name, observation, needs_gl):
    env = make(name, backend="kinematic", observation=observation, width=160, height=90)
    check_env(env.unwrapped, skip_render_check=True)
    pytest.importorskip("stable_baselines3.common.env_checker").check_env(env.unwrapped, warn=False)
    env.close()


def test_every_episode_starts_in_the_same_posture_with_a_new_goal():
    env = make(SINGLE, backend="kinematic", dtype="float64")
    goals = []
    for i in range(500):
        observation, info = env.reset(seed=0 if i == 0 else None)
        np.testing.assert_array_equal(observation[6:12], HOME)
        assert observation[12] == 0.10
        goals.append(info["goal"])
    goals = np.array(goals)
    assert len(np.unique(goals, axis=0)) == 500
    assert (goals.min(axis=0) >= [0.30, -0.30, -0.1751]).all()
    assert (goals.max(axis=0) <= [0.65, 0.30, -0.1749]).all()
    assert (np.ptp(goals, axis=0)[:2] > [0.33, 0.57]).all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.slow
def test_the_closed_form_earns_20_on_both_branches(backend):
    env = make(SINGLE, backend=backend)
    reached = np.zeros(2, dtype=int)
    for i in range(100):
        _, info = env.reset(seed=11 if i == 0 else None)
        for branch, postures in enumerate(natural_postures(info["goal"])):
            assert len(postures) >= 1
            env.reset(options={"goal": info["goal"]})
            best = min(postures, key=lambda q: np.linalg.norm(q - HOME))
            _, reward, terminated, truncated, result = env.step(best / np.pi)
            assert terminated
            assert not truncated
            assert (reward == 20) == result["is_success"] == result["reached"]
            reached[branch] += reward == 20
    assert reached.tolist() == [100, 100]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", IDS)
def test_the_reward_is_the_sum_of_its_terms(name, backend):
    env = make(name, backend=backend)
    rng = np.random.default_rng(2)
    kinds = {"impossible": 0, "possible": 0, "reached": 0}
    for i in range(60):
        _, info = env.reset(seed=5 if i == 0 else None)
        q = natural_postures(info["goal"])[0][0]
        near = (q + rng.normal(0, 0.02, 6)) / np.pi if name == SINGLE else rng.uniform(-1, 1, 6)
        action = [near, rng.uniform(-1, 1, 6), q / np.pi][i % 3]
        _, reward, _, _, info = env.step(action.astype(np.float32))
        natural, angle, distance, special = info["reward_terms"].values()
        assert natural + angle + distance + special == reward
        expected = reach_reward(info["distance"], env.unwrapped._world.q[0], impossible=info["impossible"])
        assert expected.reward == reward
        assert info["posture_error"] == expected.posture_error
        assert bool(info["impossible_reason"]) == info["impossible"]
        kinds["impossible" if info["impossible"] else "possible"] += 1
        kinds["reached"] += info["reached"]
    assert kinds["possible"] > 5
    assert name == MULTI or min(kinds.values()) > 5


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_press_into_the_table_is_impossible_and_says_table(backend):
    env = make(SINGLE, backend=backend)
    for seed in range(10):
        _, info = env.reset(seed=seed)
        q = natural_postures(info["goal"] - [0, 0, 0.05])[0][0]
        _, reward, _, _, info = env.step(q / np.pi)
        assert reward == -100
        assert info["impossible"]
        assert "table" in info["impossible_reason"]
        assert not info["reached"]


def test_postures_are_accepted_that_are_free_and_natural():
    env, checker, rng = (
        make(SINGLE, backend="kinematic").unwrapped,
        CollisionChecker("ur5-thesis"),
        np.random.default_rng(0),
    )
    _, info = env.reset(seed=0)
    low = natural_postures(info["goal"] - [0, 0, 0.05])[0][0]
    seen = dict.fromkeys(itertools.product((False, True), repeat=2), 0)
    for q in [*(HOME + rng.uniform(-0.15, 0.15, (40, 6))), *(low + rng.uniform(-0.1, 0.1, (40, 6)))]:
        free, natural = checker.free(q), posture_error(q) < 0.15
        assert env.accept(q) == (free and natural)
        seen[free, natural] += 1
    assert min(seen.values()) >= 5


@pytest.mark.parametrize("backend", BACKENDS)
def test_leaving_the_limits_is_impossible_and_names_the_joint(backend):
    env = make(MULTI, backend=backend)
    env.reset(seed=0)
    action = np.array([0, 0, 0, 0, 0, 1], dtype=np.float32)  # wrist_3 turns freely up to pi
    infos = [env.step(action)[4] for _ in range(37)]
    assert [info["impossible"] for info in infos] == [False] * 36 + [True]
    assert "wrist_3" in infos[-1]["impossible_reason"]
    assert "limit" in infos[-1]["impossible_reason"]


def test_joints_end_somewhere_within_the_tolerance_of_their_targets():
    """Of kinematics, evenly; a joint at its limit stays within it, and what is beyond stays impossible."""
    env, off = make(SINGLE, backend="kinematic", tolerance=0.02), []
    for seed in range(60):
        env.reset(seed=seed)
        *_, info = env.step(np.append(HOME[:5] / np.pi, 1.0).astype(np.float32))  # wrist_3 at its limit
        assert not info["impossible"]
        off.append(info["q"] - env.unwrapped.posture_for(np.append(HOME[:5] / np.pi, 1.0)))
    off = np.array(off)
    assert np.abs(off).max() <= 0.02 + 1e-6
    assert off[:, :5].max() > 0.018
    assert off[:, :5].min() < -0.018
    assert abs(off[:, :5].mean()) < 0.004
    assert off[:, 5].max() <= 1e-6
    assert 0.3 < (off[:, 5] < -1e-6).mean() < 0.7
    batch = gym.make_vec(MULTI, 3, vectorization_mode="vector_entry_point", backend="kinematic", tolerance=0.02)
    before, _ = batch.reset(seed=0)
    after, *_ = batch.step(np.zeros((3, 6), dtype=np.float32))
    moved = after[:, 6:12] - before[:, 6:12]
    assert (np.abs(moved) <= 0.02 + 1e-6).all()
    assert len(np.unique(moved.round(6))) == 18
    batch.close()


@pytest.mark.parametrize(("arm", "where"), [("ur5-thesis", "2 m that the cameras see"), ("panda", "10 m of goals")])
def test_a_goal_beyond_what_is_observed_is_refused(arm, where):
    env = make(SINGLE, backend="kinematic", arm=arm)
    with pytest.raises(InputError, match=rf"goal \[ *0\. +0\. +30\.\] m is outside the {where}"):
        env.reset(options={"goal": (0.0, 0.0, 30.0)})


def test_a_move_in_two_phases_passes_the_posture_between_them():
    env = make(SINGLE, backend="kinematic").unwrapped
    last = np.isin(env.arm.joints, env.arm.moves_last)
    between, end = env.waypoints_to(HOME, HOME + 0.1)
    np.testing.assert_array_equal(between, HOME + 0.1 * ~last)
    np.testing.assert_array_equal(end, HOME + 0.1)
    assert last.sum() == 1
    env = make(MULTI, backend="kinematic").unwrapped
    assert [way.tolist() for way in env.waypoints_to(HOME, HOME + 0.1)] == [(HOME + 0.1).tolist()]


@pytest.mark.parametrize("backend", BACKENDS)
def test_multi_step_turns_by_five_degrees_and_is_truncated_after_100(backend):
    env = make(MULTI, backend=backend)
    before, _ = env.reset(seed=0)
    after, *_ = env.step(np.array([0.5, 0, -1, 0, 0, 1], dtype=np.float32))
    turned = np.degrees(after[6:12] - before[6:12])
    np.testing.assert_allclose(turned, [2.5, 0, -5, 0, 0, 5], atol=0.02)
    flags = [env.step(np.zeros(6, dtype=np.float32))[2:4] for _ in range(99)]
    assert flags == [(False, False)] * 98 + [(False, True)]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("ends", [True, False])
def test_multi_step_ends_when_reached_if_asked(backend, ends):
    env = make(MULTI, backend=backend, end_on_reached=ends)
    observation, info = env.reset(seed=4)
    target = natural_postures(info["goal"])[0][0]
    for _ in range(60):
        way = target - observation[6:12]
        action = way / max(np.radians(5), np.abs(way).max())
        observation, reward, terminated, truncated, info = env.step(action.astype(np.float32))
        if info["reached"]:
            break
    assert info["reached"]
    assert reward == 20
    assert terminated == ends
    assert not truncated


@pytest.mark.parametrize("action", [np.full(6, np.nan), np.zeros(5), np.zeros((1, 6)), "up", [np.inf] * 6])
def test_malformed_actions_are_refused(action):
    env = make(SINGLE, backend="kinematic").unwrapped
    env.reset(seed=0)
    with pytest.raises(InputError):
        env.step(action)


def test_actions_outside_the_space_are_clipped():
    results = []
    for factor in (1.0, 3.0):
        env = make(SINGLE, backend="kinematic").unwrapped
        env.reset(seed=0)
        results.append(env.step(factor * np.array([-1.0, 1, 1, -1, -1, 1])))
    assert data_equivalence(*results)


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"backend": "bullet"}, "kinematic, mujoco"),
        ({"observation": "touch"}, "camera, geometric, pixels"),
        ({"render_mode": "hologram"}, "rgb_array"),
        ({"pipeline": "magic"}, "hybrid, thesis"),
        ({"tolerance": 0.01}, "tolerance is for backend"),
        ({"backend": "kinematic", "tolerance": -0.01}, "tolerance must be finite and at least 0"),
    ],
)
def test_unknown_options_are_refused(options, error):
    with pytest.raises(InputError, match=error):
        type(make(SINGLE).unwrapped)(**options)


@pytest.mark.parametrize("backend", BACKENDS)
def test_pickling_and_closing_twice(backend):
    env = make(SINGLE, backend=backend).unwrapped
    twin = pickle.loads(pickle.dumps(env))
    assert data_equivalence(env.reset(seed=1), twin.reset(seed=1))
    for _ in range(2):
        env.close()


@pytest.mark.parametrize("backend", BACKENDS)
def test_resets_do_not_grow_the_memory(backend):
    env = make(MULTI, backend=backend)
    env.reset(seed=0)
    for _ in range(500):
        env.reset()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(1500):
        env.reset()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1500  # kB


@pytest.mark.parametrize("name", IDS)
def test_what_an_environment_says_of_itself(name):
    """Its variant, its kinematics from the world, and what its cameras measured last: nothing where it has none."""
    env = make(name, backend="kinematic").unwrapped
    assert env.variant.name == ("single" if name == SINGLE else "multi")
    q = np.random.default_rng(3).uniform(-3, 3, (20, 6))
    np.testing.assert_allclose(env.kinematics.positions(q), KIN.positions(q), atol=1e-12)
    env.reset(seed=0)
    assert env.measurement is None
    env.episodes._observer.last = "a measurement"
    assert env.measurement == "a measurement"


def test_a_batch_without_a_render_mode_draws_nothing():
    batch = gym.make_vec(SINGLE, num_envs=2, vectorization_mode="vector_entry_point", backend="kinematic")
    batch.reset(seed=0)
    assert batch.render() is None
