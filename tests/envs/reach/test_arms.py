"""The reach tasks with other arms than the UR5: spaces, meaning of actions, what solvers are given."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from kinreach.baselines._policies import paced
from kinreach.envs._reach.reach_task import action_range, layout_of
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import Arm3Kinematics, AxisGoal, PositionGoal
from kinreach.robots import ArmDescription, BoxRegion, Workcell, _registry, get_arm
from tests.kinematics.test_coupled_and_sliding import SCARA, chain
from tests.robots import peoples_files as people
from tests.robots.peoples_files import MASS, shape

SINGLE, MULTI = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0"
BACKENDS = ["kinematic", "mujoco"]
HOME = (0.1, 0.5, 0.9, -0.4, 0.9, 0.2)
BLIND = replace(get_arm("arm3"), name="blind", cameras=())


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", [SINGLE, MULTI])
@pytest.mark.parametrize("arm", ["blind", BLIND])
def test_an_arm_without_cameras_observes_the_goal_in_the_world(name, backend, arm, monkeypatch):
    monkeypatch.setitem(_registry._ARMS, "blind", BLIND)
    env = gym.make(name, backend=backend, arm=arm, dtype="float64")
    check_env(env.unwrapped, skip_render_check=True)
    observation, info = env.reset(seed=3)
    layout = layout_of(env.unwrapped.arm)
    assert observation.shape == (3 + 3 + 1,)
    np.testing.assert_array_equal(observation[layout.goal], info["goal"])
    np.testing.assert_array_equal(observation[layout.q], env.unwrapped.home)
    assert observation[layout.gripper] == 0.0
    assert info["ball_found"].all()


def test_single_step_actions_map_linearly_onto_the_joint_limits():
    env = gym.make(SINGLE, backend="kinematic", arm="arm3").unwrapped
    lower, upper = env.kinematics.lower, env.kinematics.upper
    rng = np.random.default_rng(0)
    taken = 0
    for q in rng.uniform(lower, upper, (60, 3)):
        env.reset(seed=1)
        action = env.action_for(q)
        np.testing.assert_allclose(lower + (action + 1) / 2 * (upper - lower), q, atol=1e-12)
        info = env.step(action)[4]
        np.testing.assert_allclose(info["target"], q, atol=1e-12)
        assert info["impossible"] != env.accept(q)
        taken += not info["impossible"]
    assert 20 < taken < 60


def test_a_joint_that_slides_goes_10_mm_where_others_turn_by_5_degrees(tmp_path):
    file = tmp_path / "scara.urdf"
    file.write_text(chain(*SCARA))
    goals = BoxRegion(x=(0.2, 0.3), y=(-0.1, 0.1), z=(0.1, 0.1))
    arm = ArmDescription.from_file(file, workcell=Workcell(goals=goals))
    env = gym.make(MULTI, backend="kinematic", arm=arm)
    _, info = env.reset(seed=0)
    largest = np.array([np.radians(5), np.radians(5), 0.01, np.radians(5)])
    for action in (np.ones(4), -np.ones(4), np.array([0.0, 0.5, -0.25, 1.0])):
        q = info["q"]
        *_, info = env.step(action)
        np.testing.assert_allclose(info["q"] - q, largest * action, atol=1e-12)
        np.testing.assert_allclose(env.unwrapped.action_for(info["q"] + largest * action / 2), action / 2, atol=1e-12)
        np.testing.assert_allclose(paced(1.5 * largest * action, largest), 0.75 * action, atol=1e-12)


@pytest.mark.parametrize("arm", ["ur5-thesis", "arm3"])
def test_action_for_leads_straight_to_a_posture_in_several_steps(arm):
    env = gym.make(MULTI, backend="kinematic", arm=arm).unwrapped
    env.reset(seed=0)
    target = env.home + np.linspace(0.05, 0.3, len(env.home))
    ways = []
    for _ in range(10):
        action = env.action_for(target)
        assert np.abs(action).max() <= 1.0
        info = env.step(action)[4]
        ways.append(target - info["q"])
        if np.abs(ways[-1]).max() < 1e-12:
            break
    assert len(ways) == np.ceil(0.3 / np.radians(5))
    for way in ways[:-1]:  # all joints arrive together
        np.testing.assert_allclose(way / way[-1], np.linspace(0.05, 0.3, len(env.home)) / 0.3, rtol=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_closed_form_of_arm3_reaches_its_goals(backend):
    env = gym.make(SINGLE, backend=backend, arm="arm3").unwrapped
    kinematics = Arm3Kinematics(base="world")
    reached = 0
    for seed in range(20):
        _, info = env.reset(seed=seed)
        goal = env.ik_goal(info["goal"])
        assert isinstance(goal, PositionGoal)
        solution = kinematics.solve(goal, env.home, accept=env.accept)
        if not solution.success:
            continue
        _, reward, terminated, _, info = env.step(env.action_for(solution.q))
        assert terminated
        assert reward == -info["distance"]
        assert info["reached"] == (info["distance"] < 0.05 and not info["impossible"])
        reached += info["reached"]
    assert reached >= 18


@pytest.mark.parametrize("name", [SINGLE, MULTI])
@pytest.mark.parametrize("backend", BACKENDS)
def test_batches_of_other_arms_are_as_many_single_ones(name, backend):
    count = 3
    batch = gym.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", backend=backend, arm="arm3")
    singles = [gym.make(name, backend=backend, arm="arm3") for _ in range(count)]
    observations, _ = batch.reset(seed=5)
    for i, env in enumerate(singles):
        np.testing.assert_array_equal(observations[i], env.reset(seed=5 + i)[0])
    rng = np.random.default_rng(1)
    for _ in range(4):
        actions = rng.uniform(-1, 1, (count, 3))
        _, rewards, _, _, info = batch.step(actions)
        for i, env in enumerate(singles):
            _, reward, over, _, single_info = env.step(actions[i])
            assert rewards[i] == pytest.approx(reward, abs=1e-12)
            np.testing.assert_allclose(info["tip"][i], single_info["tip"], atol=1e-12)
            if over:
                env.reset()


@pytest.mark.parametrize("observation", ["camera", "pixels"])
def test_cameras_that_an_arm_has_not_are_refused(observation):
    with pytest.raises(InputError, match="a camera that measures the goal, arm 'blind' has none"):
        gym.make(SINGLE, arm=BLIND, observation=observation)


def test_unknown_arms_and_options_are_refused():
    with pytest.raises(UnknownNameError, match="arm3"):
        gym.make(SINGLE, arm="nobody")
    with pytest.raises(
        InputError, match=r"unexpected keyword argument 'colour'; available: observation, backend, .*reward"
    ):
        gym.make(SINGLE, colour="red")


def test_six_joints_are_asked_to_point_the_tool_down():
    env = gym.make(SINGLE, backend="kinematic").unwrapped
    goal = env.ik_goal([0.4, 0.1, -0.1])
    assert isinstance(goal, AxisGoal)
    np.testing.assert_array_equal(goal.axis, [0, 0, -1])


def without_end(tmp_path, *, region=True):
    """An arm with shapes whose first and last joint turn without end."""
    free = {"kind": "continuous", "inside": '<limit effort="50" velocity="3"/>'}
    limited = '<limit lower="-3.1" upper="3.1" effort="50" velocity="3"/>'
    joints = {i: free if i in (1, 6) else {"inside": limited} for i in range(1, 7)}
    solid = shape('<cylinder radius="0.02" length="0.05"/>', "collision") + MASS.replace("0.1", "0.001")
    file = tmp_path / "free.urdf"
    file.write_text(people.arm(joints=joints, links=dict.fromkeys(range(7), solid)))
    goals = BoxRegion((0.3, 0.5), (-0.2, 0.2), (0.1, 0.3))
    return ArmDescription.from_urdf(file, workcell=Workcell(goals=goals) if region else None, home=HOME)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", [SINGLE, MULTI, "kinreach/Reach-v0"])
def test_a_joint_without_end_in_an_environment(name, backend, tmp_path):
    env = gym.make(name, backend=backend, arm=without_end(tmp_path))
    check_env(env.unwrapped, skip_render_check=True)
    space, layout = env.observation_space, layout_of(env.unwrapped.arm, directed="Reach" in name)
    assert np.isfinite(space.high).all()
    assert np.isfinite(space.low).all()
    assert space.high[layout.q][0] == pytest.approx(np.pi + 0.5)
    env.reset(seed=0)
    for q in ([3.0, *HOME[1:]], [-3.0, *HOME[1:]], [3 * 2 * np.pi + 1.0, *HOME[1:5], -1.0]):
        env.reset(options={"q": q})
        for target in (np.array(q), np.array([-q[0], *HOME[1:]])):
            posture = env.unwrapped.posture_for(env.unwrapped.action_for(target))
            assert np.abs(posture - q)[[0, 5]].max() < np.pi + 1e-9  # the shorter way


def test_a_joint_without_end_turns_on(tmp_path):
    """Five degrees a step: past half a turn it goes on, and looks as it did a turn before."""
    env = gym.make(MULTI, backend="kinematic", arm=without_end(tmp_path), max_episode_steps=400)
    before, _ = env.reset(seed=0, options={"q": HOME})
    layout, seen = layout_of(env.unwrapped.arm), []
    for _ in range(216):
        observation, *_, info = env.step(np.array([1.0, 0, 0, 0, 0, -1.0]))
        assert not info["impossible"]
        assert env.observation_space.contains(observation)
        seen.append(observation[layout.q][0])
    assert info["q"][0] == pytest.approx(3 * 2 * np.pi + HOME[0])
    np.testing.assert_allclose(observation[layout.q], before[layout.q], atol=1e-9)
    assert np.ptp(seen) > 6.0


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_single_step_goes_the_shorter_way(backend, tmp_path):
    env = gym.make(SINGLE, backend=backend, arm=without_end(tmp_path))
    env.reset(seed=0, options={"q": [np.deg2rad(179), *HOME[1:]]})
    target = np.array([np.deg2rad(181), *HOME[1:]])
    *_, info = env.step(env.unwrapped.action_for(target))
    assert not info["impossible"], info["impossible_reason"]
    np.testing.assert_allclose(info["q"], target, atol=0.01)


def test_a_joint_without_end_in_native_batches(tmp_path):
    arm = without_end(tmp_path)
    envs = gym.make_vec(MULTI, num_envs=3, vectorization_mode="vector_entry_point", arm=arm, backend="kinematic")
    envs.reset(seed=0)
    for _ in range(90):
        observation, *_ = envs.step(np.tile([1.0, 0, 0, 0, 0, -1.0], (3, 1)).astype(np.float32))
        assert envs.observation_space.contains(observation)


def test_an_endless_joint_is_used_within_one_turn_each_way():
    """Actions are parts of the range: one of twenty turns could not be learned."""
    half, middle = action_range(get_arm("ur3"))
    np.testing.assert_allclose(half, np.pi * np.array([2, 2, 1, 2, 2, 2]))
    np.testing.assert_array_equal(middle, np.zeros(6))
    env = gym.make("kinreach/UR5SingleStep-v0", arm="ur3", backend="kinematic")
    env.reset(seed=0)
    *_, info = env.step(np.array([-0.25, -0.25, 0.5, -0.25, -0.25, 1.0]))
    assert info["q"][5] == pytest.approx(2 * np.pi)
