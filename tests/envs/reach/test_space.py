"""Reaching in space: goals in a volume, tool directions, starts, on several arms."""

from dataclasses import replace
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pinocchio as pin
import pytest

import benchmarks.learners  # noqa: F401 (registers its recipes)
import kinreach  # noqa: F401 (registers the environments)
from kinreach._registration import SPACE
from kinreach.baselines import evaluate, get_recipe, rollout, train
from kinreach.baselines.inside import SolverPolicy
from kinreach.compare import compare
from kinreach.envs.inside import SpaceTask
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import ClosedFormSolver, CollisionChecker, LevenbergMarquardtSolver, URKinematics
from kinreach.robots import QuadrantRegion, get_arm

#: One arm takes the URDF's angles as they are written, many take right angles where almost right ones are written.
ROUNDED = 1e-10
WIDE = {"tilt": 30.0, "start_spread": 0.3}
ARMS = {"ur3-thesis": 13 + 3, "ur5-thesis": 13 + 3, "ur10-thesis": 13 + 3, "panda": 3 + 3 + 7 + 1}


def make(**options):
    return gym.make(SPACE, **options)


def make_vec(count, **options):
    return gym.make_vec(SPACE, num_envs=count, vectorization_mode="vector_entry_point", **options)


def angle_of(kinematics, q, direction):
    """By Pinocchio, from the rotation that takes one direction to the other."""
    turn = pin.Quaternion.FromTwoVectors(kinematics.fk(q)[:3, 2], np.array(direction))
    return float(pin.AngleAxis(turn).angle)


@pytest.mark.parametrize("arm", ARMS)
def test_every_arm(arm):
    batch = make_vec(64, arm=arm, backend="kinematic", **WIDE)
    observations, info = batch.reset(seed=3)
    assert observations.shape == (64, ARMS[arm])
    assert batch.single_observation_space.contains(observations[0])
    assert (info["posture_error"] < np.pi).all()
    after = batch.step(batch.action_space.sample())[4]["final_info"]
    assert {"direction", "distance", "special"} == set(after["reward_terms"])


def test_what_episodes_start_with():
    arm = get_arm("ur5-thesis")
    checker = CollisionChecker(arm)
    rows = SpaceTask(make(**WIDE).unwrapped.options).sample(np.random.default_rng(0), 2000)
    goals, directions, q = rows[:, :3], rows[:, 3:6], rows[:, 6:]
    box = arm.workcell.goals.wider(0.0, above=0.25)
    for axis, (low, high) in enumerate((box.x, box.y, box.z)):
        assert low <= goals[:, axis].min() < low + 0.01
        assert high - 0.01 < goals[:, axis].max() <= high
    assert box.z == (arm.workcell.goals.z[0], arm.workcell.goals.z[1] + 0.25)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-12)
    tilt = np.degrees(np.arccos(-directions[:, 2]))
    assert 29.5 < tilt.max() <= 30.0
    # uniform on the cap: its inner half has (1 - cos 15) / (1 - cos 30) of the area
    share = (1 - np.cos(np.radians(15))) / (1 - np.cos(np.radians(30)))
    assert abs((tilt < 15).mean() - share) < 0.04
    assert 0.29 < np.abs(q - arm.home).max() <= 0.3
    assert sum(checker.free(posture) for posture in q[:300]) == 300
    still = SpaceTask(make().unwrapped.options).sample(np.random.default_rng(0), 50)
    assert (still[:, 3:] == [0.0, 0.0, -1.0, *arm.home]).all()


def test_where_every_drawn_start_is_impossible_the_arm_begins_in_its_start_pose():
    task = SpaceTask(make(**WIDE).unwrapped.options)
    task.checker = SimpleNamespace(impossible=lambda q: np.ones(len(q), dtype=bool))
    rows = task.sample(np.random.default_rng(0), 5)
    np.testing.assert_array_equal(rows[:, 6:], np.tile(get_arm("ur5-thesis").home, (5, 1)))


@pytest.mark.parametrize(("backend", "count", "steps"), [("kinematic", 12, 3), ("mujoco", 4, 2)])
@pytest.mark.parametrize("variant", ["single", "multi"])
def test_a_batch_equals_single_environments(variant, backend, count, steps):
    options = {"steps": variant, "backend": backend, **WIDE}
    batch, singles = make_vec(count, **options), [make(**options) for _ in range(count)]
    observations, info = batch.reset(seed=5)
    for i, env in enumerate(singles):
        observation, said = env.reset(seed=5 + i)
        np.testing.assert_allclose(observations[i], observation, rtol=0, atol=ROUNDED)
        np.testing.assert_array_equal(info["direction"][i], said["direction"])
    rng, compared = np.random.default_rng(1), 0
    for _ in range(steps):
        home = np.array(get_arm("ur5-thesis").home) / np.pi if variant == "single" else 0.0
        actions = np.clip(home + rng.normal(0.0, 0.1, (count, 6)), -1, 1)
        observations, rewards, terminated, truncated, info = batch.step(actions)
        for i, env in enumerate(singles):
            observation, reward, over, cut, said = env.step(actions[i])
            assert (terminated[i], truncated[i]) == (over, cut)
            np.testing.assert_allclose(rewards[i], reward, rtol=0, atol=ROUNDED)
            if over or cut:
                observation, _ = env.reset()
            np.testing.assert_allclose(observations[i], observation, rtol=0, atol=ROUNDED)
            compared += 1
    assert compared == count * steps


@pytest.mark.parametrize("backend", ["kinematic", "mujoco"])
@pytest.mark.slow
def test_the_closed_form_reaches_everything(backend):
    """Also low over the table with the tool tilted, where a finger has to be turned away from it."""
    env = make(backend=backend, **WIDE)
    policy = SolverPolicy(ClosedFormSolver(env.unwrapped.kinematics), env)
    count = 150 if backend == "kinematic" else 25
    trials = list(rollout(env, policy, [{"seed": seed} for seed in range(count)]))
    assert sum(trial["reached"] for trial in trials) == count
    assert max(trial["posture_error"] for trial in trials) < 1e-3
    assert np.median([trial["distance"] for trial in trials]) < 1e-4


def test_refused_postures_are_turned_about_the_tool():
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
    rng, turned = np.random.default_rng(0), 0
    for _ in range(60):
        goal = get_arm("ur5-thesis").workcell.draw_goals(rng, 1)[0]
        wanted = kin.axis_goal(goal, (0, 0, -1), kin.arm.home).q
        far = lambda q, start=wanted: abs(q[5] - start[5]) > 0.5  # noqa: E731
        result = kin.axis_goal(goal, (0, 0, -1), kin.arm.home, accept=far)
        assert result.success
        assert result.position_error < 1e-9
        assert kin.within_limits(result.q)
        turned += 1
    assert turned == 60
    never = kin.axis_goal(goal, (0, 0, -1), kin.arm.home, accept=lambda q: False)
    assert never.status.name == "REJECTED"


def test_a_numeric_solver_reaches_with_seven_joints():
    env = make(arm="panda", backend="kinematic", **WIDE)
    policy = SolverPolicy(LevenbergMarquardtSolver(env.unwrapped.kinematics), env)
    trials = list(rollout(env, policy, [{"seed": seed} for seed in range(20)]))
    assert sum(trial["reached"] for trial in trials) >= 19


def test_the_angle_is_pinocchios_and_the_reward_what_is_documented():
    env = make(backend="kinematic", steps="multi", **WIDE)
    rng, near = np.random.default_rng(2), 0
    kin = env.unwrapped.kinematics
    for seed in range(40):
        _, info = env.reset(seed=seed)
        q = info["q"] + rng.normal(0.0, 0.2, 6)
        goal = kin.fk(info["q"])[:3, 3] if seed % 2 else info["goal"]
        env.reset(seed=seed, options={"goal": goal, "direction": 3 * info["direction"]})
        _, reward, _, _, said = env.step(env.unwrapped.action_for(info["q"] if seed % 2 else q))
        np.testing.assert_allclose(said["direction"], info["direction"], atol=1e-12)
        angle = angle_of(kin, said["q"], said["direction"])
        np.testing.assert_allclose(said["posture_error"], angle, atol=1e-7)
        d = np.linalg.norm(kin.fk(said["q"])[:3, 3] - said["goal"])
        expected = 0.5 - 0.5 * np.log2(d) - angle if d >= 0.01 else 20.0 if angle < 0.15 else 10 - angle
        np.testing.assert_allclose(reward, -100.0 if said["impossible"] else expected, atol=1e-6)
        near += d < 0.01
    assert near == 20


def test_rewards_of_a_users_own_are_given_the_angle():
    seen = []

    def reward(distance, q, impossible, angle):
        seen.append(angle)
        return -angle, {"angle": -angle}

    env = make(backend="kinematic", reward=reward, **WIDE)
    env.reset(seed=0)
    _, paid, _, _, info = env.step(env.action_space.sample())
    assert paid == -info["posture_error"] == -seen[-1][0]
    assert info["reward_angle"] == paid


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"steps": "many"}, UnknownNameError, "steps"),
        ({"goal_height": np.nan}, InputError, "goal_height"),
        ({"arm": "arm3"}, InputError, "six joints"),
        ({"speed": 1.0}, InputError, "unexpected keyword argument 'speed'"),
    ],
)
def test_options_that_cannot_be(options, error, message):
    for new in (make, lambda **given: make_vec(2, **given)):
        with pytest.raises(error, match=message):
            new(**options)


def test_directions_that_cannot_be():
    env = make(backend="kinematic")
    for direction in ([0, 0, 0], [0, 0], [0, 0, np.inf]):
        with pytest.raises(InputError, match="direction"):
            env.reset(options={"direction": direction})
    with pytest.raises(InputError, match="unknown reset options"):
        gym.make("kinreach/UR5SingleStep-v0", backend="kinematic").reset(options={"direction": [0, 0, -1]})


def test_starts_of_a_smaller_number_are_the_first_of_a_larger_one():
    for env, names in ((make(**WIDE), {"goal", "direction", "q"}), (gym.make("kinreach/UR5SingleStep-v0"), {"goal"})):
        few, many = (env.unwrapped.starts(np.random.default_rng(4), count) for count in (3, 8))
        assert set(few) == names
        for name in names:
            np.testing.assert_array_equal(few[name], many[name][:3])


def test_starts_around_a_region_need_a_box():
    with pytest.raises(InputError, match="goals are drawn around a BoxRegion, arm 'arm3' has"):
        gym.make("kinreach/UR5SingleStep-v0", arm="arm3").unwrapped.starts(np.random.default_rng(0), 1)


def test_a_comparison_in_space():
    entry = compare("space", methods=["closed-form"], goals=4, seed=3)["methods"][0]
    assert entry["reached"] == 1.0
    assert entry["distance_mm"]["p95"] < 0.2
    assert entry["posture_error"]["p95"] < 1e-3


@pytest.mark.slow
def test_a_policy_is_trained_in_several_steps(tmp_path):
    small = replace(get_recipe("space-multi"), num_envs=64, steps=64 * 2, segments=1, window=64)
    found = evaluate(train(small, tmp_path, seed=0).policy, goals=10, options=small.options)
    assert len(found.reached) == 10


@pytest.mark.slow
def test_solvers_try_again_where_the_way_to_their_posture_is_blocked():
    methods = compare("space", ["placo", "lm", "qp"], goals=110, seed=0)["methods"]
    assert {method["name"]: method["reached"] for method in methods} == {"placo": 1.0, "lm": 1.0, "qp": 1.0}
    assert all(method["restarts"]["p95"] >= 1 for method in methods)


@pytest.mark.slow
def test_a_free_posture_is_refused_where_the_arm_would_touch_itself_on_the_way():
    env, at_once = (make(backend=backend, **WIDE).unwrapped for backend in ("mujoco", "kinematic"))
    starts, solver = env.starts(np.random.default_rng(0), 100), LevenbergMarquardtSolver(env.kinematics)
    ends = {True: [], False: []}
    for goal, direction, q in zip(*(starts[name] for name in ("goal", "direction", "q")), strict=True):
        for one in (env, at_once):
            _, info = one.reset(options={"goal": goal, "direction": direction, "q": q})
        found = solver.solve(env.ik_goal(info["seen"]), q, accept=at_once.accept)
        assert found.success
        accepted = env.accept(found.q)
        ends[accepted].append(env.step(env.action_for(found.q))[-1]["status"])
    assert len(ends[True]) > 80
    assert set(ends[True]) == {"completed"}
    assert ends[False].count("self-collision") >= 5


def test_under_dynamics_a_posture_is_accepted_where_the_way_there_is_free():
    """Beside 400 samples of the way in two phases; without dynamics, and at once in place, only its end counts."""
    env, at_once = (make(backend=backend, disable_env_checker=True).unwrapped for backend in ("mujoco", "kinematic"))
    checker, rng, ways = CollisionChecker("ur5-thesis"), np.random.default_rng(0), []
    for _ in range(160):
        start, target = rng.uniform(-2.0, 2.0, (2, 6))
        start += 0.5 * env.home
        if checker.in_collision(start) or checker.in_collision(target):
            continue
        for one in (env, at_once):
            one.reset(options={"q": start, "direction": env.kinematics.fk(target)[:3, 2]})
        between = np.where(np.arange(6) == 1, start, target)  # the shoulder's lift moves last
        way = np.concatenate([np.linspace(*ends, 200) for ends in ((start, between), (between, target))])
        ways.append(not checker.impossible(way).any())
        assert env.accept(target) == ways[-1]
        assert at_once.accept(target)
    assert 5 < sum(ways) < len(ways) - 5


def test_goals_in_a_volume_need_one():
    """A work cell with goals in four quadrants, or without any, has none."""
    arm = get_arm("ur5e")
    for goals in (None, QuadrantRegion((0.3, 0.5), (0.1, 0.2))):
        other = replace(arm, workcell=replace(arm.workcell, goals=goals))
        with pytest.raises(InputError, match="goals in a volume need a BoxRegion in the work cell, arm 'ur5e'"):
            make(arm=other)


def test_no_posture_has_an_error_where_only_a_direction_is_asked_for():
    reward = SpaceTask(make().unwrapped.options).default_reward()
    np.testing.assert_array_equal(reward.posture_error(np.ones((4, 6))), np.zeros(4))
