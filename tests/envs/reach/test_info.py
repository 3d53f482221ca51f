"""What the environments say of a reset and of a step: where things are, what was meant, what became of it."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from kinreach.envs._reach.episodes import ReachEpisodes
from kinreach.envs._reach.worlds import STATUSES, KinematicWorld, TargetStatus
from kinreach.errors import InputError
from kinreach.robots import get_arm
from kinreach.vision import geometric_goal_view

SINGLE, MULTI = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0"
KINEMATIC = {"backend": "kinematic", "dtype": "float64"}
BACKENDS = ["kinematic", "mujoco"]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", [SINGLE, MULTI])
def test_info_agrees_with_itself(name, backend):
    env = gym.make(name, backend=backend, end_on_reached=False, dtype="float64")
    fk = env.unwrapped.kinematics.positions
    rng = np.random.default_rng(4)
    seen = dict.fromkeys(STATUSES, 0)
    over, moved = True, 0.0
    for _ in range(40):
        if over:
            observation, info = env.reset()
            np.testing.assert_array_equal(info["q"], env.unwrapped.home)
            np.testing.assert_array_equal(info["seen"], info["goal"])
            np.testing.assert_array_equal(info["view"], observation[:6])
            moved = 0.0
        observation, _, terminated, truncated, info = env.step(rng.uniform(-1, 1, 6))
        over = terminated or truncated
        np.testing.assert_array_equal(observation[6:12], info["q"])
        np.testing.assert_allclose(fk(info["q"]), info["tip"], atol=1e-9)
        np.testing.assert_allclose(fk(info["target"]), info["target_tip"], atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(info["tip"] - info["goal"]), info["distance"], atol=1e-12)
        assert {name: info[f"reward_{name}"] for name in info["reward_terms"]} == info["reward_terms"]
        assert STATUSES[info["impossible_code"]] == info["status"]
        assert (info["status"] == "completed") != info["impossible"] == bool(info["impossible_reason"])
        assert info["move_s"] > moved if backend == "mujoco" and info["status"] != "out of limits" else True
        assert backend == "mujoco" or info["move_s"] == 0.0
        moved = info["move_s"]
        seen[info["status"]] += 1
    assert seen["completed"] >= 5
    assert name == MULTI or 40 - seen["completed"] >= 5


def test_every_status_is_called_by_its_name():
    assert [int(status) for status in TargetStatus] == list(range(8))
    assert [status.name.lower() for status in TargetStatus] == [
        said.replace("-", "_").replace(" ", "_") for said in STATUSES
    ]


@pytest.mark.parametrize("backend", BACKENDS)
def test_status_of_a_target_outside_the_limits(backend):
    env = gym.make(MULTI, backend=backend)
    _, info = env.reset(options={"q": [*env.unwrapped.home[:5], np.pi - 0.01]})
    info = env.step(np.array([0, 0, 0, 0, 0, 1.0]))[4]
    assert info["status"] == "out of limits"
    assert info["target"][5] > np.pi


def test_each_arm_is_told_where_its_target_is_reached_or_not():
    """One of several, as well as one alone."""
    task = gym.make(SINGLE, backend="kinematic").unwrapped._task
    episodes = ReachEpisodes(task, KinematicWorld(task, 3, explain=True))
    episodes.begin(np.arange(3))
    np.testing.assert_array_equal(episodes.directions, 3 * [[0.0, 0.0, -1.0]])
    q = np.array(3 * [task.home])
    q[1, 1] = 1.5  # into the table
    info = episodes.step(q / np.pi).info
    assert info["impossible"].tolist() == [False, True, False]
    np.testing.assert_allclose(info["target_tip"], task.kinematics.positions(q), rtol=0, atol=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_batch_says_what_single_environments_say(backend):
    count = 4
    batch = gym.make_vec(SINGLE, num_envs=count, vectorization_mode="vector_entry_point", backend=backend)
    singles = [gym.make(SINGLE, backend=backend) for _ in range(count)]
    _, start = batch.reset(seed=2)
    actions = np.random.default_rng(3).uniform(-1, 1, (count, 6))
    info = batch.step(actions)[4]["final_info"]
    without = {"target_tip"} if backend == "kinematic" else set()
    assert info["impossible_code"].dtype == np.uint8
    for i, env in enumerate(singles):
        single_start = env.reset(seed=2 + i)[1]
        single = env.step(actions[i])[4]
        assert {key for key in start if not key.startswith("_")} == set(single_start) - without  # but Gymnasium's masks
        assert {key for key in info if not key.startswith("_")} == set(single) - without
        for key in set(single) - without - {"reward_terms", "impossible_reason", "status"}:
            np.testing.assert_allclose(start[key][i], single_start[key], atol=1e-12)
            np.testing.assert_allclose(info[key][i], single[key], atol=1e-12)
        assert start["status"][i] == single_start["status"] == ""
        assert start["impossible_reason"][i] == single_start["impossible_reason"] == ""
        assert info["status"][i] == single["status"]
        assert bool(info["impossible_reason"][i]) == single["impossible"]
        assert backend == "kinematic" or info["impossible_reason"][i] == single["impossible_reason"]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", [SINGLE, MULTI])
def test_forfeiting_is_impossible_ends_the_episode_and_moves_nothing(name, backend):
    env = gym.make(name, backend=backend).unwrapped
    before, start = env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.forfeit("no posture is left")
    np.testing.assert_array_equal(observation, before)
    assert (reward, terminated, truncated) == (-100.0, True, False)
    assert info["status"] == "forfeited"
    assert info["impossible_reason"] == "no posture is left"
    assert info["impossible"]
    assert not info["reached"]
    assert info["distance"] == start["distance"]
    np.testing.assert_array_equal(info["target"], start["q"])


@pytest.mark.parametrize("count", [None, 3])
def test_a_view_that_somebody_has_measured_is_taken_as_it_is(count):
    goal, elsewhere = np.array([0.45, 0.1, -0.175]), np.array([0.5, -0.2, -0.175])
    whole = geometric_goal_view("ur5-thesis", elsewhere)
    views = {"both": whole, "front": np.array([*whole[:3], 0, 0, 0]), "none": np.zeros(6)}
    for case, view in views.items():
        options = {"goal": goal, "view": view}
        if count is None:
            env = gym.make(SINGLE, **KINEMATIC)
        else:
            env = gym.make_vec(SINGLE, num_envs=count, vectorization_mode="vector_entry_point", **KINEMATIC)
            options = {key: np.tile(value, (count, 1)) for key, value in options.items()}
        observation, info = env.reset(options=options)
        observations, goals, found, seen = (
            np.atleast_2d(x) for x in (observation, info["goal"], info["ball_found"], info["seen"])
        )
        for row in range(count or 1):
            np.testing.assert_array_equal(observations[row, :6], view)
            np.testing.assert_array_equal(goals[row], goal)
            assert found[row].tolist() == {"both": [True, True], "front": [True, False], "none": [False, False]}[case]
            np.testing.assert_allclose(seen[row], [np.nan] * 3 if case == "none" else elsewhere, atol=1e-12)


def test_a_ball_on_a_cameras_axis_is_found():
    env = gym.make(SINGLE, backend="kinematic")
    for front in ([0.0, 0.0, 0.5], [0.0, 0.1, 0.5], [0.1, 0.0, 0.5]):
        info = env.reset(options={"view": [*front, 0.0, 0.0, 0.0]})[1]
        assert info["ball_found"].tolist() == [True, False]
        assert np.isfinite(info["seen"]).all()


def test_views_of_an_arm_without_cameras_are_goals_in_the_world():
    env = gym.make(SINGLE, arm=replace(get_arm("arm3"), name="blind", cameras=()), **KINEMATIC)
    observation, info = env.reset(seed=0, options={"view": [0.3, 0.2, 0.1]})
    np.testing.assert_array_equal(observation[:3], [0.3, 0.2, 0.1])
    np.testing.assert_array_equal(info["seen"], [0.3, 0.2, 0.1])
    assert not np.array_equal(info["goal"], info["seen"])


def test_views_that_no_camera_has_are_refused():
    env = gym.make(SINGLE, backend="kinematic")
    for view, message in ((np.full(6, 3.0), "within ±2 m, got 3"), (np.zeros(3), r"shape \(6,\)")):
        with pytest.raises(InputError, match=message):
            env.reset(options={"view": view})
    farthest = [2.0, -2.0, 2.0, 0.0, 0.0, 0.0]
    np.testing.assert_array_equal(env.reset(options={"view": farthest})[1]["view"], farthest)


@pytest.mark.slow
def test_a_given_view_takes_no_look(needs_gl):
    """The cameras' noise goes on as if the episode had not been."""
    options = {"observation": "camera", "backend": "kinematic", "depth_noise": 0.002, "width": 160, "height": 90}
    looks = []
    for views in ([], [np.zeros(6)]):
        env = gym.make(SINGLE, **options)
        goal = {"goal": [0.45, 0.1, -0.175]}
        env.reset(seed=0, options=goal)
        for view in views:
            env.reset(options={**goal, "view": view})
        looks.append(env.reset(options=goal)[0])
        env.close()
    np.testing.assert_array_equal(*looks)


def test_arrays_that_episodes_gave_away_stay_when_some_begin_anew():
    task = gym.make(SINGLE, backend="kinematic").unwrapped._task
    episodes = ReachEpisodes(task, KinematicWorld(task, 3))
    episodes.begin(np.arange(3))
    given = episodes.goals, episodes.seen, episodes.found
    before = [array.copy() for array in given]
    episodes.begin(np.array([1]))
    for array, old in zip(given, before, strict=True):
        np.testing.assert_array_equal(array, old)
    assert (episodes.goals[1] != before[0][1]).any()
    assert all(new is not old for new, old in zip((episodes.goals, episodes.seen, episodes.found), given, strict=True))
