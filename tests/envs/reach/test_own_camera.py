"""A camera that is added to an arm's description is observed, found and rendered without anything else."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from kinreach.errors import InputError
from kinreach.robots import CameraMount, get_arm
from kinreach.sim import ArmSimulation
from kinreach.vision import RGBDCamera, geometric_goal_view, goal_in_world

SINGLE = "kinreach/UR5SingleStep-v0"
UR5 = get_arm("ur5-thesis")
SIDE = CameraMount("side", "world", (0.5, -0.9, 0.2), (0.47, 0.0, -0.18), observed=True)
ABOVE = CameraMount("above", "world", (0.47, 0.0, 0.9), (0.47, 0.0, -0.18), up=(1, 0, 0), observed=True)


def arm_with(*cameras):
    return replace(UR5, name="ur5-cameras", cameras=cameras)


@pytest.mark.parametrize("cameras", [(*UR5.goal_cameras, SIDE), (SIDE,), (ABOVE, *UR5.goal_cameras, SIDE)])
def test_each_camera_is_three_numbers_in_the_order_of_the_arm(cameras):
    arm = arm_with(*cameras)
    env = gym.make(SINGLE, backend="kinematic", arm=arm, dtype="float64")
    check_env(env.unwrapped, skip_render_check=True)
    assert env.observation_space.shape == (3 * len(cameras) + 6 + 1,)
    simulation = ArmSimulation(arm)
    poses = [RGBDCamera(simulation, camera.name).T_world_camera for camera in arm.goal_cameras]
    for seed in range(20):
        observation, info = env.reset(seed=seed)
        points = observation[: 3 * len(cameras)].reshape(-1, 3)
        for T, point in zip(poses, points, strict=True):
            np.testing.assert_allclose(T[:3, :3] @ point + T[:3, 3], info["goal"], atol=1e-12)
        assert info["ball_found"].shape == (len(cameras),)
        np.testing.assert_allclose(goal_in_world(arm, points.ravel(), info["ball_found"]), info["goal"], atol=1e-12)


@pytest.mark.parametrize(
    "make", [gym.make, lambda name, **options: gym.make_vec(name, 2, "vector_entry_point", **options)]
)
def test_a_camera_too_far_from_the_goals_is_refused(make):
    """An observation holds 2 m along each axis of a camera."""
    near, far = (CameraMount("side", "world", (0.5, y, 0.2), (0.47, 0.0, -0.18), observed=True) for y in (-1.5, -2.5))
    make(SINGLE, backend="kinematic", arm=arm_with(near)).close()
    with pytest.raises(InputError, match=r"camera 'side' of arm 'ur5-cameras' measures goals 2\.\d\d m away"):
        make(SINGLE, backend="kinematic", arm=arm_with(*UR5.goal_cameras, far))


def test_an_arm_with_cameras_and_without_goals_takes_those_of_reset():
    arm = replace(arm_with(*UR5.goal_cameras), workcell=replace(UR5.workcell, goals=None))
    env = gym.make(SINGLE, backend="kinematic", arm=arm)
    with pytest.raises(InputError, match="goal"):
        env.reset(seed=0)
    goal = UR5.workcell.goals.sample(np.random.default_rng(0), 1)[0]
    np.testing.assert_array_equal(env.reset(seed=0, options={"goal": goal})[1]["goal"], goal)


def test_a_batch_observes_what_single_environments_do():
    arm = arm_with(*UR5.goal_cameras, SIDE)
    batch = gym.make_vec(SINGLE, 4, "vector_entry_point", backend="kinematic", arm=arm)
    rows = batch.reset(seed=3)[0]
    assert rows.shape == (4, 16)
    for seed, row in enumerate(rows, start=3):
        np.testing.assert_array_equal(gym.make(SINGLE, backend="kinematic", arm=arm).reset(seed=seed)[0], row)


@pytest.mark.slow
def test_its_pictures_are_observed_and_the_ball_is_found_in_them(needs_gl):
    arm = arm_with(*UR5.goal_cameras, SIDE)
    options = {"backend": "kinematic", "arm": arm, "width": 320, "height": 180}
    pictures = gym.make(SINGLE, observation="pixels", **options)
    assert {"side_rgb", "side_depth", "front_rgb", "wrist_rgb"} <= set(pictures.observation_space.spaces)
    assert (pictures.reset(seed=0)[0]["side_rgb"] > 0).any()
    camera = gym.make(SINGLE, observation="camera", **options)
    errors = []
    for seed in range(10):
        observation, info = camera.reset(seed=seed)
        off = (observation[:9] - geometric_goal_view(arm, info["goal"])).reshape(3, 3)
        errors.extend(np.linalg.norm(off, axis=1)[2:][info["ball_found"][2:]])
    assert np.max(errors) < 0.005
    assert len(errors) >= 4  # the side camera does not see the whole table


def test_an_arm_without_a_front_and_a_wrist_camera_has_no_thesis_reward():
    terms = gym.make(SINGLE, backend="kinematic", arm=arm_with(SIDE)).reset(seed=0)[1]
    assert terms["posture_error"] == 0.0
