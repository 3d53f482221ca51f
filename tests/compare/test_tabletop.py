"""Objects brought to a place in the comparison: the scripts do it, chance does not."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from kinreach._registration import PICK_AND_PLACE, PUSH
from kinreach.baselines.inside import PickAndPlaceScript, PushScript
from kinreach.compare import compare, get_task
from kinreach.errors import InputError
from tests.cases import slow

SCRIPTS = {"push": (PUSH, PushScript), "pick-and-place": (PICK_AND_PLACE, PickAndPlaceScript)}


@pytest.mark.parametrize("task", ["pick-and-place", *slow("push")])
def test_scripts_bring_objects_to_their_places(task):
    found = compare(task, ["script", "random"], goals=1, seed=1, options={"max_episode_steps": 150})
    script, random = found["methods"]
    assert (script["name"], random["name"]) == ("script", "random")
    assert script["reached"] == 1.0
    assert random["reached"] == 0.0
    assert script["distance_mm"]["p95"] < 20.0 < random["distance_mm"]["median"]
    assert 20 < script["steps"]["median"] < 150


def reached(task, seeds, **options):
    """Return of how many seeds the script brings the object to its goal."""
    name, script = SCRIPTS[task]
    env = gym.make(name, dtype="float64", **options)
    policy, count = script(env), 0
    for seed in seeds:
        observation, info = env.reset(seed=seed)
        policy.reset(observation, info)
        over = False
        while not over:
            observation, _, ended, cut, info = env.step(policy.act(observation))
            over = ended or cut
        count += info["is_success"]
    return count


#: Arms whose servos answer more slowly than those of the thesis's UR5, or whose tool is ahead at home.
OTHER_ARMS = [
    "ur3",
    "ur3e",
    "ur5",
    "ur5e",
    "ur8long",
    "ur10",
    "ur10e",
    "ur15",
    "ur16e",
    "ur18",
    "ur20",
    "ur30",
    "so101",
]


@pytest.mark.parametrize("arm", ["ur5e", "ur10e", "ur16e", "ur20", "so101"])
def test_the_scripts_suit_the_arm(arm):
    """Where servos need longer than a step, the tip swung around the object, and the fingers opened again."""
    assert reached("pick-and-place", [300], arm=arm) == 1
    if arm == "so101":  # its tool is ahead at home, not down
        assert reached("push", [303], arm=arm) == 1


@pytest.mark.parametrize("arm", ["ur10e", "so101"])
def test_another_arm_has_the_script(arm):
    """Not what was learned with the UR5."""
    found = compare("pick-and-place", goals=1, seed=1, arm=arm)
    assert [(method["name"], method["reached"]) for method in found["methods"]] == [("script", 1.0)]


@pytest.mark.slow
@pytest.mark.parametrize("task", SCRIPTS)
@pytest.mark.parametrize("arm", OTHER_ARMS)
def test_the_scripts_bring_objects_to_20_places_with_every_arm(task, arm):
    assert reached(task, range(600, 620), arm=arm) >= 19


def test_an_object_that_jaws_cannot_hold_is_refused_in_one_line():
    env = gym.make(PICK_AND_PLACE, arm="so101", size=0.03)
    with pytest.raises(InputError, match=r"^the jaws of 'gripper' cannot hold an object 0\.06 m wide: .* 0\.053 m"):
        PickAndPlaceScript(env)


@pytest.mark.slow
@pytest.mark.parametrize("task", SCRIPTS)
def test_what_learned_from_a_script_brings_objects_to_their_places(task):
    (learned,) = compare(task, [f"imitated-{task}"], goals=40, seed=3)["methods"]
    assert learned["reached"] >= 0.9


def test_an_object_is_lifted_before_it_is_carried():
    """On its way up nobody drags it over the table, however far it has to go."""
    batch, script = gym.make_vec(PICK_AND_PLACE, 6, "vector_entry_point"), PickAndPlaceScript(gym.make(PICK_AND_PLACE))
    observations, info = batch.reset(seed=3)
    start, far = info["position"], np.linalg.norm((info["goal"] - info["position"])[:, :2], axis=1) > 0.15
    lifted, dragged = np.zeros(6, dtype=bool), np.zeros(6)
    for _ in range(66):
        observations, _, ended, cut, info = batch.step(script.act(observations))
        assert not (ended | cut).any()
        way = info["position"] - start
        lifted |= way[:, 2] > 0.03
        dragged = np.where(lifted, dragged, np.maximum(dragged, np.linalg.norm(way[:, :2], axis=1)))
    assert (lifted & far).sum() >= 4
    assert dragged.max() < 0.005
    assert np.linalg.norm(way[:, :2], axis=1).max() > 0.05  # and then it is


def test_what_is_carried_stays_high_until_it_is_nearly_over_its_goal():
    """Above a goal on the table, from a stride and a half on; half a stride before it goes down."""
    env = gym.make(PICK_AND_PLACE, control="position", dtype="float64").unwrapped
    script, size, top = PickAndPlaceScript(env), env.task.size, env.region.z[0]
    observation, _ = env.reset(seed=0)
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = 0.45, 0.05, top + size + 0.06  # as high as objects are carried
    q = env.kinematics.nearest(T, env.home).q
    ways = {}
    for away in (0.2, 0.1, 0.05, 0.035, 0.009, 0.004):
        goal = T[:3, 3] + [0.0, -away, -0.06]
        held = np.concatenate([q, [2 * size - 1e-3], T[:3, 3], T[:3, 3], np.eye(3)[:, :2].ravel()])
        ways[away] = script.act(np.append(held, goal))
        assert ways[away].shape == env.action_space.shape
        assert ways[away][-1] == -1.0  # the fingers hold
        assert ways[away][1] < 0.0
    assert len(held) + 3 == len(observation)
    for away, way in ways.items():
        if away > 0.03:
            assert abs(way[2]) < 0.02
            assert way[1] < -0.9
        else:
            assert way[2] < -0.9
            assert way[1] > -0.5


def test_an_object_that_is_lost_is_grasped_again():
    """It is put elsewhere, by hand, while it is carried."""
    env = gym.make(PICK_AND_PLACE, dtype="float64")
    script = PickAndPlaceScript(env)
    observation, info = env.reset(seed=0)
    script.reset(observation, info)
    taken, over = False, False
    while not over:
        observation, _, ended, cut, info = env.step(script.act(observation))
        over = ended or cut
        if not taken and info["gripped"] and info["position"][2] > -0.15:
            joint = env.unwrapped.model.joint("object")
            env.unwrapped.data.qpos[joint.qposadr[0] : joint.qposadr[0] + 3] = (0.4, 0.0, -0.17)
            taken = True
    assert taken
    assert info["is_success"]


def test_the_picture_of_a_trial_has_arm_object_and_goal_as_it_ended():
    env = gym.make(PICK_AND_PLACE, dtype="float64")
    script = PickAndPlaceScript(env)
    observation, info = env.reset(seed=0)
    script.reset(observation, info)
    for _ in range(100):
        observation, *_, info = env.step(script.act(observation))
        if info["position"][2] > -0.15:  # it is carried
            break
    assert info["position"][2] > -0.15
    scene = get_task("pick-and-place").scene(env, {name: np.array(value).tolist() for name, value in info.items()})
    mujoco.mj_forward(scene.model, scene.data)
    np.testing.assert_allclose(scene.data.body("object").xpos, info["position"], atol=1e-9)
    np.testing.assert_allclose(scene.data.body("object").xmat, info["rotation"].ravel(), atol=1e-9)
    np.testing.assert_allclose(scene.data.body("ball").xpos, info["goal"])
    np.testing.assert_allclose(scene.q, info["q"])
    assert scene.model.geom("object").type == mujoco.mjtGeom.mjGEOM_BOX


@pytest.mark.slow
@pytest.mark.parametrize("task", SCRIPTS)
def test_scripts_bring_objects_to_150_places(task):
    assert reached(task, range(5000, 5150)) >= 149
