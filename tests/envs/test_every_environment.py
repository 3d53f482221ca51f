"""What holds of every environment: batches, resets, renderers, arguments."""

import copy
import inspect
from dataclasses import fields

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import kinreach  # noqa: F401 (registers the environments)
from kinreach._registration import BUTTON, LIFT, MOVING, MULTI, PICK_AND_PLACE, PUSH, REAL_ARM, SINGLE, SPACE
from kinreach.errors import InputError
from kinreach.sim import BatchSimulation
from kinreach.sim.inside import FrameRenderer
from tests.cases import slow, stand_in

OBSTACLES = "kinreach/Obstacles-v0"
OBJECTS = {"shapes": ("ball", "cube"), "sizes": (0.02, 0.03), "masses": (0.05, 0.2), "frictions": (0.5, 1.5)}
TASKS = {
    "single": (SINGLE, {"backend": "kinematic"}),
    "single, dynamics": (SINGLE, {}),
    "multi": (MULTI, {"backend": "kinematic"}),
    "space": (SPACE, {"backend": "kinematic", "tilt": 30.0, "start_spread": 0.3}),
    "button": (BUTTON, {"max_episode_steps": 7}),
    "moving": (MOVING, {}),
    "lift": (LIFT, {"attempts": 2, "clutter": True, **OBJECTS}),
    "judged": (LIFT, {"backend": "kinematic", **OBJECTS}),
    "small steps": (LIFT, {"steps": "multi", "max_episode_steps": 4, **OBJECTS}),
    "real arm": (REAL_ARM, {"balls": 2, "budgets": (0, 5), "again": 1, "errors": ("links", "everything")}),
    "obstacles": (OBSTACLES, {"clutter": (2, 4), "max_episode_steps": 2}),
}
#: Other spaces, and other ways of going on.
FORMS = TASKS | {
    "multi, dynamics": (MULTI, {}),
    "space, small steps": (SPACE, {"backend": "kinematic", "steps": "multi", "tilt": 30.0, "start_spread": 0.3}),
    "space, dynamics": (SPACE, {}),
    "button, as in the report": (BUTTON, {"actuation": "report"}),
    "moving, free": (MOVING, {"collisions": False}),
    "lift, small steps": (LIFT, {"steps": "multi", "max_episode_steps": 12}),
    "space, goals": (SPACE, {"steps": "multi", "goal_env": True, "tilt": 30.0, "reward": "sparse"}),
    "multi, goals": (MULTI, {"goal_env": True}),
    "lift, goals": (LIFT, {"goal_env": True, "steps": "multi"}),
}
COUNT = 3
COSTLY = ("moving", "lift", "judged", "small steps")
#: One arm takes the URDF's angles as they are written, many take right angles where almost right ones are written.
ROUNDED = {"single": 1e-9, "single, dynamics": 1e-11, "multi": 1e-9, "space": 1e-9, "judged": 1e-9}
#: Left out in kinematic batches of the reach tasks, or not in the same words.
SHORTENED = {"target_tip", "impossible_reason"}


def single(task):
    return limited(task).unwrapped


def limited(task):
    """With Gymnasium's limit of steps."""
    name, options = TASKS[task]
    return gym.make(name, disable_env_checker=True, **options)


def batch(task, **more):
    name, options = TASKS[task]
    return gym.make_vec(name, num_envs=COUNT, vectorization_mode="vector_entry_point", **options, **more)


def same(one, other, *, row=None, atol=0.0):
    """How many values are the same; of `other` a row if it is of a batch."""
    if isinstance(one, dict):
        names = {name for name in other if row is None or name[0] != "_"}  # the others are masks
        assert names | SHORTENED == set(one) | SHORTENED
        names -= SHORTENED if atol == ROUNDED["single"] else set()
        return sum(same(one[name], other[name], row=row, atol=atol) for name in names)
    one, other = np.asarray(one), np.asarray(other if row is None else other[row])
    if other.dtype.kind in "OU":
        assert (one == other).all(), (one, other)
    else:
        np.testing.assert_allclose(one, other, rtol=0, atol=atol)
        assert (one.dtype == np.bool_) == (other.dtype == np.bool_)
    return 1


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.slow
def test_gymnasium_and_stable_baselines3_agree(form):
    name, options = FORMS[form]
    env = gym.make(name, disable_env_checker=True, **options).unwrapped
    check_env(env, skip_render_check=True)
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(env, warn=form != "real arm", skip_render_check=True)  # one look is a row


@pytest.mark.parametrize("task", TASKS)
def test_steps_return_the_types_of_gymnasium(task):
    """Also for an arm that stays where it is."""
    env, kinds = single(task), set()
    env.action_space.seed(1)
    for still in (False, False, True):
        observation, info = env.reset(seed=5)
        action = env.action_space.sample()
        if still and task == "obstacles":
            action = env.action_for(info["q"])
        for _ in range(4):
            observation, reward, terminated, truncated, info = env.step(action)
            assert env.observation_space.contains(observation)
            kinds.add((type(reward), type(terminated), type(truncated)))
            if terminated or truncated:
                break
    assert kinds == {(float, bool, bool)}


@pytest.mark.parametrize("task", TASKS)
def test_a_copy_is_the_same_after_the_same_seed(task):
    env = single(task)
    twin = copy.deepcopy(env)
    assert twin.spec == env.spec
    np.testing.assert_array_equal(env.reset(seed=5)[0], twin.reset(seed=5)[0])
    env.action_space.seed(0)
    action = env.action_space.sample()
    for one, other in zip(env.step(action)[:4], twin.step(action)[:4], strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("task", [*(task for task in TASKS if task not in COSTLY), *slow(*COSTLY)])
def test_a_batch_says_all_that_single_environments_say(task):
    """Every entry of `info`, from reset to reset."""
    many, singles = batch(task, autoreset_mode="Disabled"), [limited(task) for _ in range(COUNT)]
    atol = ROUNDED.get(task, 0.0)
    observations, told = many.reset(seed=3)
    many.action_space.seed(0)
    compared = ends = 0
    for index, env in enumerate(singles):
        observation, info = env.reset(seed=3 + index)
        compared += same(observation, observations, row=index, atol=atol) + same(info, told, row=index, atol=atol)
    for _ in range({"multi": 101, "lift": 3, "moving": 91, "obstacles": 4}.get(task, 8)):
        actions = many.action_space.sample() * (0.3 if task == "lift" else 1)
        *stepped, told = many.step(actions)
        over = stepped[2] | stepped[3]
        for index, env in enumerate(singles):
            *alone, info = env.step(actions[index])
            for mine, theirs in zip(alone, stepped, strict=True):
                same(mine, theirs, row=index, atol=atol)
            compared += same(info, told, row=index, atol=atol)
        ends += over.sum()
        if over.any():
            observations, told = many.reset(options={"reset_mask": over})
            for index in np.flatnonzero(over):
                observation, info = singles[index].reset()
                same(observation, observations, row=index, atol=atol)
                same(info, told, row=index, atol=atol)
    assert compared > 100
    assert ends >= 2


@pytest.mark.parametrize("task", TASKS)
def test_nothing_of_earlier_episodes_is_left_after_a_seeded_reset(task):
    used, fresh = single(task), single(task)
    used.action_space.seed(1)
    used.reset(seed=9)
    for _ in range(2):
        *_, terminated, truncated, _ = used.step(used.action_space.sample())
        if terminated or truncated:
            used.reset()
    (mine, told), (theirs, said) = used.reset(seed=4), fresh.reset(seed=4)
    compared = same(mine, theirs) + same(told, said)
    for _ in range(3):
        action = used.action_space.sample()
        (*ours, told), (*others, said) = used.step(action), fresh.step(action)
        for one, other in zip(ours, others, strict=True):
            compared += same(one, other)
        compared += same(told, said)
        if ours[2] or ours[3]:
            (mine, told), (theirs, said) = used.reset(), fresh.reset()
            compared += same(mine, theirs) + same(told, said)
    assert compared > 20


@pytest.mark.parametrize("task", ["single", "lift", "obstacles"])
def test_an_episode_is_forfeited_after_a_reset_only(task):
    env = single(task)
    with pytest.raises(InputError, match="reset the environment"):
        env.forfeit("no way")
    env.reset(seed=0)
    assert env.forfeit("no way")[4]["impossible_reason"] == "no way"


class Blank:
    """A renderer without graphics."""

    made = []  # noqa: RUF012

    def __init__(self, model, *, width, height, shadows=True):
        self.model, self.width, self.height, self.shadows, self.open = model, width, height, shadows, True
        self.frames = 0
        self.made.append(self)

    def rgb(self, data, camera):
        assert self.open
        self.frames += 1
        return np.zeros((self.height, self.width, 3), np.uint8)

    def depth(self, data, camera):
        assert self.open
        return np.ones((self.height, self.width), np.float32)

    def close(self):
        self.open = False


CAMERAS = {"width": 32, "height": 18}
DRAWN = {
    "camera": (SINGLE, {"backend": "kinematic", "observation": "camera", **CAMERAS}),
    "pixels": (MULTI, {"backend": "kinematic", "observation": "pixels", **CAMERAS}),
    "frames": (MULTI, {"backend": "kinematic", "arm": "arm3", "render_mode": "rgb_array"}),
    "button": (BUTTON, {"render_mode": "rgb_array"}),
    "lift, camera": (LIFT, {"backend": "kinematic", "observation": "camera", **CAMERAS}),
    "lift, pixels": (LIFT, {"backend": "kinematic", "observation": "pixels", **CAMERAS}),
}


def test_pictures_are_taken_anew_of_those_that_have_moved(monkeypatch):
    monkeypatch.setattr(Blank, "made", [])
    stand_in(monkeypatch, FrameRenderer, Blank)
    name, options = DRAWN["pixels"]
    env = gym.make_vec(name, 2, "vector_entry_point", autoreset_mode="Disabled", **options)
    taken = [0]
    for act in (
        lambda: env.reset(seed=0),
        lambda: env.step(np.zeros((2, 6))),
        lambda: env.reset(options={"reset_mask": np.array([True, False])}),
        lambda: env.reset(),
    ):
        act()
        taken.append(sum(renderer.frames for renderer in Blank.made))
    assert np.diff(taken).tolist() == [4, 4, 2, 4]  # two cameras


@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("task", DRAWN)
def test_a_closed_environment_has_no_renderer_left(task, many, monkeypatch):
    monkeypatch.setattr(Blank, "made", [])
    stand_in(monkeypatch, FrameRenderer, Blank)
    name, options = DRAWN[task]
    env = gym.make_vec(name, 2, "vector_entry_point", **options) if many else gym.make(name, **options)
    for _ in range(2):
        env.reset(seed=0)
        if "render_mode" in options:
            env.render()
        assert any(renderer.open for renderer in Blank.made)
        env.unwrapped.close_extras() if many else env.close()
        assert not any(renderer.open for renderer in Blank.made)
    assert not any(renderer.shadows for renderer in Blank.made)
    if "width" in options:
        assert {(renderer.width, renderer.height) for renderer in Blank.made} == {(32, 18)}


@pytest.mark.parametrize("name", [SINGLE, MULTI])
def test_the_scene_is_where_the_environment_is(name):
    env = gym.make(name, backend="kinematic", arm="arm3", render_mode="rgb_array").unwrapped
    info, compared = env.reset(seed=0)[1], 0
    for action in (0.1 * np.ones(3), -0.2 * np.ones(3), None):
        np.testing.assert_allclose(env.scene.tip_position, info["tip"], atol=1e-9)
        np.testing.assert_array_equal(env.scene.ball_position, info["goal"])
        compared += 1
        info = env.step(action)[4] if action is not None else info
    assert compared == 3


@pytest.mark.parametrize("name", [SINGLE, SPACE, BUTTON, MOVING, LIFT, REAL_ARM, OBSTACLES])
def test_arguments_are_keywords(name):
    parameters = inspect.signature(type(gym.make(name).unwrapped)).parameters.values()
    assert {parameter.kind for parameter in parameters} == {inspect.Parameter.KEYWORD_ONLY}
    entries = fields(type(gym.make(name).unwrapped).Options)
    names = [entry.name for entry in entries]
    assert [parameter.name for parameter in parameters] == names
    cameras = {entry.name for entry in entries if entry.metadata["observation"] == "camera"}
    every = {"pipeline", "width", "height", "rgb_noise", "depth_noise", "exposure"}
    assert cameras == every.intersection(names)
    flagless = {entry.name for entry in entries if entry.metadata["flag"] is None}
    none = {"boxes", "control", "controls", "depth", "dtype", "frames", "goal_env", "goal_in", "info", "randomise"}
    none |= {"sights", "render_mode", "render_camera", "render_width", "render_height"}
    assert flagless == none.intersection(names) | ({"reward"} if name == LIFT else set())


#: Numbers that are options: id, name, the least and the largest that are taken (None: not tried), in lists of one value
#: where an option has several.
ENDS = [
    (SINGLE, "exposure", 1.0, 100.0), (SINGLE, "looks", 0, 10**6), (SINGLE, "rgb_noise", 0.0, 255.0),
    (SINGLE, "depth_noise", 0.0, 1.0), (SINGLE, "width", 16, 16384), (SINGLE, "height", 16, 16384),
    (SINGLE, "render_width", 1, 1920), (SINGLE, "render_height", 1, 1080), (SINGLE, "margin", 0.0, None),
    (SPACE, "goal_height", 0.0, 2.0), (SPACE, "tilt", 0.0, 90.0), (SPACE, "start_spread", 0.0, np.pi),
    (BUTTON, "frames", 1, 16), (LIFT, "attempts", 1, 10), (LIFT, "sizes", (0.01,), (0.045,)),
    (LIFT, "masses", (0.001,), (1.0,)), (LIFT, "frictions", (0.0,), (3.0,)), (LIFT, "table", None, (0.05, 0.05, 0.05)),
    (OBSTACLES, "margin", 5e-4, 0.05), (OBSTACLES, "heights", None, (1.0, 1.0)), (OBSTACLES, "clutter", (0,), (20,)),
    (MOVING, "delay", 0.0, 1.0), (MOVING, "noise", 0.0, 0.1), (MOVING, "strength", 0.1, 1.0), (MOVING, "sights", 1, 90),
    (MOVING, "outliers", 0.0, 1.0), (MOVING, "dropped", 0.0, 1.0), (MOVING, "friction", 0.0, 60.0),
    (MOVING, "hidden", 0.0, 0.2), (MOVING, "speeds", None, (2.0,)), (MOVING, "margin", 0.0, None),
]  # fmt: skip


@pytest.mark.parametrize(("name", "option", "least", "most"), ENDS)
def test_a_number_may_be_the_least_and_the_largest_and_nothing_beyond(name, option, least, most):
    options, tried = type(gym.make(name).unwrapped).Options, 0
    for end, side in ((least, -1), (most, 1)):
        if end is None:
            continue
        assert getattr(options(**{option: end}), option) == end
        first = end[0] if isinstance(end, tuple) else end
        step = side if isinstance(first, int) else side * 1e-6
        beyond = (*[value + step for value in end],) if isinstance(end, tuple) else end + step
        with pytest.raises(InputError, match=r"at (least|most)|from 0\.01 to 0\.045 m|within|0\.05"):
            options(**{option: beyond})
        tried += 1
    assert tried >= 1


@pytest.mark.parametrize("name", [SINGLE, MULTI, SPACE, BUTTON, LIFT, PUSH, PICK_AND_PLACE])
def test_a_batch_steps_its_dynamics_on_as_many_threads_as_are_asked_for(name, monkeypatch):
    """Those that MuJoCo is told to use, the caller's included."""
    import mujoco.batch

    told, begin = [], mujoco.batch.Batch.__init__

    def noted(self, model, nsim, nthread=0, **more):
        told.append((nsim, nthread))
        begin(self, model, nsim, nthread, **more)

    monkeypatch.setattr(mujoco.batch.Batch, "__init__", noted)
    for count, threads in ((3, 2), (2, 1)):
        env = gym.make_vec(name, count, "vector_entry_point", threads=threads)
        env.reset(seed=0)
        env.close()
        assert told[-1] == (count, threads)
    gym.make_vec(name, 2, "vector_entry_point").close()
    assert {each[1] for each in told[2:]} == {1}


@pytest.mark.parametrize("name", [SINGLE, MULTI, SPACE, BUTTON, MOVING, LIFT, REAL_ARM, OBSTACLES])
def test_a_batch_has_one_environment_and_one_thread_by_default(name):
    env = gym.make_vec(name, vectorization_mode="vector_entry_point", num_envs=2).unwrapped
    found = {parameter.name: parameter.default for parameter in inspect.signature(type(env)).parameters.values()}
    assert found["num_envs"] == found.get("threads", 1) == 1
    assert found["autoreset_mode"] is env.autoreset_mode is AutoresetMode.SAME_STEP
    assert inspect.signature(BatchSimulation).parameters["threads"].default == 1
    assert env.metadata["render_fps"] == gym.make(name).metadata["render_fps"] == {MOVING: 30}.get(name, 25)
