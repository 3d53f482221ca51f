"""Goals as places in both pictures: what OpenCV says of MuJoCo's cameras, for one environment and for a batch."""

from dataclasses import replace

import cv2
import gymnasium as gym
import mujoco
import numpy as np
import pytest

from kinreach._registration import MULTI, SINGLE, SPACE
from kinreach.baselines import load_policy
from kinreach.baselines.inside import LearnedPolicy
from kinreach.compare import get_task
from kinreach.compare.inside import resolve_methods
from kinreach.errors import InputError, UnknownNameError
from kinreach.robots import get_arm
from kinreach.vision import geometric_goal_view
from kinreach.vision.inside import in_image
from tests.policy_files import copy_policy

IMAGE = {"backend": "kinematic", "goal_in": "image", "dtype": "float64"}
GOALS = get_arm("ur5-thesis").workcell.draw_goals(np.random.default_rng(3), 200)


def projected(simulation, goals):
    """u, v by OpenCV and the depth, of both of MuJoCo's cameras."""
    data, blocks = simulation.data, []
    mujoco.mj_forward(simulation.model, data)
    for name in ("front", "wrist"):
        R = (data.camera(name).xmat.reshape(3, 3) * (1, -1, -1)).T  # world to optical
        t = -R @ data.camera(name).xpos
        uv, _ = cv2.projectPoints(goals, cv2.Rodrigues(R)[0], t, np.eye(3), None)
        blocks += [uv[:, 0], (goals @ R.T + t)[:, 2:]]
    return np.hstack(blocks)


@pytest.mark.parametrize("name", [SINGLE, MULTI, SPACE])
def test_goals_are_where_opencv_projects_them(ur5, name):
    expected = projected(ur5, GOALS)
    assert (np.abs(expected) > 0.05).mean() > 0.9
    single = gym.make(name, **IMAGE)
    batch = gym.make_vec(name, num_envs=len(GOALS), vectorization_mode="vector_entry_point", **IMAGE)
    observations, info = batch.reset(seed=0, options={"goal": GOALS})
    np.testing.assert_allclose(observations[:, :6], expected, atol=1e-7)
    assert batch.observation_space.contains(observations)
    for row in range(0, len(GOALS), 40):
        observation, told = single.reset(seed=0, options={"goal": GOALS[row]})
        np.testing.assert_array_equal(observation[:6], observations[row, :6])
        np.testing.assert_array_equal(told["view"], info["view"][row])
        assert single.observation_space.contains(observation)
        again, _ = single.reset(seed=0, options={"goal": GOALS[row], "view": told["view"]})
        np.testing.assert_array_equal(again[:6], observation[:6])
    np.testing.assert_allclose(info["view"], geometric_goal_view("ur5-thesis", GOALS), atol=1e-12)  # metres, as ever


def test_nothing_else_changes():
    envs = [gym.make(MULTI, **{**IMAGE, "goal_in": "camera"}), gym.make(MULTI, **IMAGE)]
    plain, image = (env.reset(seed=4)[0] for env in envs)
    for action in np.random.default_rng(0).uniform(-1, 1, (5, 6)):
        (plain, *judged), (image, *told) = (env.step(action) for env in envs)
        np.testing.assert_array_equal(plain[6:], image[6:])
        assert judged[:3] == told[:3]
        assert np.abs(plain[:6] - image[:6]).max() > 0.1


def test_what_is_not_in_a_picture_has_a_place_in_the_space():
    views = np.array([[0.0] * 6, [1.5, -1.5, 0.1, 0.3, 0.2, -0.4], [0.5, 0.1, 0.0, -0.3, 0.6, 1.2]])
    np.testing.assert_allclose(
        in_image(views), [[0.0] * 6, [15.0, -15.0, 0.1, 0.0, 0.0, -0.4], [0.0, 0.0, 0.0, -0.25, 0.5, 1.2]]
    )
    env = gym.make(SINGLE, **IMAGE)
    for view in views:
        observation, _ = env.reset(seed=0, options={"view": view})
        space = env.observation_space
        np.testing.assert_array_equal(observation[:6], np.clip(in_image(view), space.low[:6], space.high[:6]))
        assert env.observation_space.contains(observation)


def test_where_it_cannot_be():
    with pytest.raises(UnknownNameError, match="goal_in"):
        gym.make(SINGLE, goal_in="pixels")
    with pytest.raises(
        InputError, match=r"goal_in='image' needs a camera that measures the goal, arm 'panda' has none"
    ):
        gym.make(SINGLE, arm="panda", **IMAGE)


def test_a_policy_that_learned_so_is_given_goals_so(tmp_path):
    policy = load_policy("thesis-ppo-single")
    card = replace(policy.card, recipe={**policy.card.recipe, "options": IMAGE})
    assert policy.needed_options == {}
    assert LearnedPolicy(card, policy.network).needed_options == {"goal_in": "image"}
    file = tmp_path / "image.safetensors"
    copy_policy("thesis-ppo-single", file, recipe=card.recipe)
    with pytest.raises(InputError, match="takes goals in pictures"):
        resolve_methods(get_task("ur5"), [str(file)])


def test_learners_that_read_metres_refuse(tmp_path):
    pytest.importorskip("stable_baselines3")
    import benchmarks.learners  # noqa: F401 (registers its recipes)
    from kinreach.baselines import get_recipe, train

    for name in ("ranked-single", "ik-net", "space-single"):
        recipe = get_recipe(name)
        with pytest.raises(InputError, match=f"{recipe.algorithm} takes goals in metres, not goal_in='image'"):
            train(replace(recipe, options={**recipe.options, "goal_in": "image"}), tmp_path / name)
