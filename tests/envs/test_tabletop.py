"""Environments made of a task of one's own: those of the example that pushes a cube, and wrong ones."""

import importlib.util
import pickle
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from kinreach.envs import TabletopTask, register_tabletop
from kinreach.errors import InputError

FILE = Path(__file__).parents[2] / "examples" / "18_own_environment.py"
ID = "mine/Push-v0"
COUNT = 3


@pytest.fixture(scope="module", autouse=True)
def example():
    spec = importlib.util.spec_from_file_location("own_environment", FILE)
    sys.modules["own_environment"] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del gym.registry[ID], sys.modules["own_environment"]


class Lifted(TabletopTask):
    """Bring a ball to a height; the goal is one number."""

    goal_size, shape = 1, "ball"

    def __init__(self, height: float = 0.05) -> None:
        self.height = height

    def sample(self, rng, count, region):
        return region.sample(rng, count)[:, :2], np.zeros(count), np.full((count, 1), self.height)

    def achieved(self, state):
        return state.clearance[:, None]

    def success(self, achieved, goals):
        return (achieved >= goals)[:, 0]

    def reward_terms(self, state, goals):
        return {"near": -np.linalg.norm(state.tip - state.position, axis=1), "height": state.clearance}


@pytest.fixture(params=["push", "lifted"])
def name(request):
    if request.param == "push":
        yield ID
        return
    register_tabletop("mine/Lifted-v0", Lifted, max_episode_steps=5)
    yield "mine/Lifted-v0"
    del gym.registry["mine/Lifted-v0"]


def test_checkers(name):
    env = gym.make(name).unwrapped
    check_env(env, skip_render_check=True)
    pytest.importorskip("stable_baselines3.common.env_checker").check_env(env, warn=False)
    assert env.action_space.shape == ((6,) if name == ID else (7,))
    assert env.observation_space.shape == (6 + 1 + 3 + 3 + 6 + (3 if name == ID else 1),)


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_a_batch_is_as_many_single_ones(name, mode):
    """Bit for bit, across the ends of episodes."""
    batch = gym.make_vec(name, num_envs=COUNT, autoreset_mode=mode, max_episode_steps=5)
    alone = [gym.make(name, max_episode_steps=5) for _ in range(COUNT)]
    seen, _ = batch.reset(seed=3)
    np.testing.assert_array_equal(seen, [env.reset(seed=3 + k)[0] for k, env in enumerate(alone)])
    batch.action_space.seed(0)
    ended, compared = np.zeros(COUNT, dtype=bool), 0
    for _ in range(8):
        actions = batch.action_space.sample()
        seen, reward, terminated, truncated, _ = batch.step(actions)
        for k, env in enumerate(alone):
            if ended[k] and mode is AutoresetMode.NEXT_STEP:
                one = (env.reset()[0], 0.0, False, False)
            else:
                one = env.step(actions[k])
                terms = one[4]["reward_terms"]
                assert sum(terms.values()) == pytest.approx(one[1], abs=1e-12)
                assert one[4]["impossible"] == (terms["collision"] == -1.0)
            ended[k] = one[2] or one[3]
            first = env.reset()[0] if ended[k] and mode is AutoresetMode.SAME_STEP else one[0]
            np.testing.assert_array_equal(seen[k], first)
            assert (reward[k], terminated[k], truncated[k]) == one[1:4]
            compared += 1
    assert compared == 8 * COUNT


def test_a_seed_is_an_episode_and_options_set_it(name):
    env = gym.make(name)
    size = env.unwrapped.observation_space.shape[0] - 19
    first, _ = env.reset(seed=5)
    other, _ = env.reset()
    again, _ = env.reset(seed=5)
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    goal = np.arange(size) / 10
    seen, info = env.reset(options={"place": (0.4, 0.1), "yaw": [0.5], "goal": goal})
    np.testing.assert_array_equal(info["goal"], goal)
    np.testing.assert_array_equal(info["position"][:2], (0.4, 0.1))
    np.testing.assert_allclose(seen[13:19], [np.cos(0.5), -np.sin(0.5), np.sin(0.5), np.cos(0.5), 0, 0], atol=1e-12)
    for wrong in ({"place": (0.4,)}, {"goals": goal}, {"goal": [np.nan] * size}):
        with pytest.raises(InputError):
            env.reset(options=wrong)


def test_the_object_lies_on_the_table_and_is_pushed(example):
    """At rest it stays; the script moves it to the goal, and that ends the episode."""
    env = gym.make(ID)
    for seed in range(3):
        _, start = env.reset(seed=seed)
        _, _, _, _, info = env.step(np.zeros(6, dtype=np.float32))
        np.testing.assert_allclose(info["position"], start["position"], atol=1e-3)
        over = False
        while not over:
            _, reward, ended, cut, info = env.step(example.script(env, info))
            over = ended or cut
        assert ended
        assert info["is_success"]
        assert np.linalg.norm(info["achieved"] - info["goal"]) < 0.015
        assert reward > 0.98


@pytest.mark.parametrize("reward", ["dense", "sparse"])
def test_a_collision_cuts_the_episode_off(reward):
    """It does not terminate: what is lost until the limit of steps would make a collision pay."""
    env = gym.make(ID, reward=reward)
    env.reset(seed=0)
    down = np.array([0, 1, 0, 0, 0, 0], dtype=np.float32)
    for _ in range(60):
        _, paid, ended, cut, info = env.step(down)
        assert not ended
        if cut:
            break
    assert info["impossible"]
    assert paid < -1.0 if reward == "dense" else paid == -1.0
    with pytest.raises(InputError, match="over"):
        env.step(down)


def test_arguments_of_the_class_are_keywords():
    register_tabletop("mine/Named-v0", f"{__name__}:Lifted")
    try:
        env = gym.make("mine/Named-v0", height=0.2, info="numbers")
        assert env.reset(seed=0)[1]["goal"] == [0.2]
        copy = pickle.loads(pickle.dumps(env.unwrapped))
        np.testing.assert_array_equal(copy.reset(seed=4)[0], env.reset(seed=4)[0])
        for wrong in ({"depth": 1}, {"render_mode": "text"}, {"info": "some"}):
            with pytest.raises(InputError):
                type(env.unwrapped)(Lifted, **wrong)
    finally:
        del gym.registry["mine/Named-v0"]


def one_step(name):
    env = gym.make(name, disable_env_checker=True).unwrapped
    env.reset(seed=0)
    env.step(np.zeros(7, dtype=np.float32))


def wrong(**changed):
    return type("Wrong", (Lifted,), changed)


@pytest.mark.parametrize(
    ("task", "said"),
    [
        (wrong(size=0.2), "size"),
        (wrong(mass=-1.0), "mass"),
        (wrong(shape="cone"), "cone"),
        (wrong(opening=0.5), "opening"),
        (wrong(arm="arm3"), "arm3"),
        (wrong(goal_size=0), "goal_size"),
        (wrong(sample=lambda self, rng, count, region: (np.zeros((count, 3)), np.zeros(count))), "sample"),
        (wrong(sample=lambda *_: (np.zeros((1, 2)), np.zeros(1), np.zeros((1, 1)))), "places"),
        (wrong(success=lambda self, achieved, goals: achieved[:, 0]), "success"),
        (wrong(success=lambda self, achieved, goals: True), "success"),
        (wrong(reward_terms=lambda self, state, goals: {"near": 1.0}), "near"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_wrong_tasks_say_what_is_wrong(task, said):
    register_tabletop("mine/Wrong-v0", task)
    try:
        with pytest.raises(InputError, match=said):
            one_step("mine/Wrong-v0")
    finally:
        del gym.registry["mine/Wrong-v0"]


@pytest.mark.parametrize("task", [Lifted(), dict, None, 3])
def test_only_tasks_are_registered(task):
    with pytest.raises(InputError, match="TabletopTask"):
        register_tabletop("mine/None-v0", task)
    assert "mine/None-v0" not in gym.registry


class Taken(Lifted):
    """Has arguments that would never get to it."""

    def __init__(self, backend="real", height=0.05, threads=2):
        super().__init__(height)


def test_a_task_with_the_arguments_of_environments_is_refused():
    said = r"Taken cannot have arguments named 'backend', 'threads', .* rename them"
    with pytest.raises(InputError, match=said):
        register_tabletop("mine/Taken-v0", Taken)
    assert "mine/Taken-v0" not in gym.registry
    register_tabletop("mine/Taken-v0", f"{__name__}:Taken")
    try:
        with pytest.raises(InputError, match=said):
            gym.make("mine/Taken-v0")
    finally:
        del gym.registry["mine/Taken-v0"]


@pytest.mark.slow
def test_the_goal_is_drawn(needs_gl):
    env = gym.make(ID, render_mode="rgb_array")
    green = []
    for goal in ((0.5, 0.0, -0.175), (0.5, 0.0, -10.0)):
        env.reset(seed=0, options={"goal": goal})
        green.append((env.render().astype(int) @ [-1, 2, -1] > 60).sum())
    assert green[0] > 20
    assert green[1] == 0
    env.close()


def test_a_task_that_cannot_be_made_says_why():
    register_tabletop("mine/Wrong-v0", wrong(__init__=lambda self, height=0.05: None + height))
    try:
        with pytest.raises(InputError, match="cannot make the task: unsupported operand"):
            one_step("mine/Wrong-v0")
    finally:
        del gym.registry["mine/Wrong-v0"]


def test_rewards_of_a_task_with_terms_of_its_own_need_the_info_of_the_steps():
    """And then are those of the steps: by the state that `info` says."""
    touching = lambda self, state, goals: {**Lifted.reward_terms(self, state, goals), "touch": -2.0 * state.collides}  # noqa: E731
    register_tabletop("mine/Lifted-v0", wrong(reward_terms=touching), max_episode_steps=5)
    try:
        env = gym.make("mine/Lifted-v0", disable_env_checker=True, goal_env=True, dtype="float64")
        env.reset(seed=1)
        compared, said = 0, []
        for action in np.random.default_rng(2).uniform(-0.3, 0.3, (3, 7)):
            seen, reward, _, _, info = env.step(action)
            goals = seen["achieved_goal"], seen["desired_goal"]
            paid = env.unwrapped.compute_reward(*goals, info)
            assert paid == pytest.approx(reward, abs=1e-12)
            assert reward == pytest.approx(
                info["clearance"] - np.linalg.norm(np.subtract(info["tip"], info["position"])), abs=1e-9
            )
            compared += 1
        for missing in ("tip", "position", "clearance"):
            with pytest.raises(InputError, match=missing) as error:
                env.unwrapped.compute_reward(*goals, {name: each for name, each in info.items() if name != missing})
            said.append(str(error.value))
        assert (compared, len(set(said))) == (3, 3)
    finally:
        del gym.registry["mine/Lifted-v0"]


def test_a_simulation_that_diverges_is_put_back_and_ends_the_episode():
    env = gym.make(ID, disable_env_checker=True)
    env.reset(seed=0)
    before = env.unwrapped.scene.q.copy()
    env.unwrapped.scene.data.qvel[:] = 1e7
    observation, _, ended, cut, _ = env.step(np.zeros(6, dtype=np.float32))
    assert (ended, cut) == (False, True)
    assert np.isfinite(observation).all()
    np.testing.assert_allclose(env.unwrapped.scene.q, before, atol=1e-12)
    env.reset(seed=1)
    assert not env.step(np.zeros(6, dtype=np.float32))[3]


@pytest.mark.parametrize("lost", [[1], [0, 2], [0, 1, 2]])
def test_of_a_batch_only_those_that_diverge_are_put_back(lost):
    """The others go on as if nothing had happened, and so do all after the next reset."""
    options = {"dtype": "float64", "autoreset_mode": "NextStep"}
    hit, plain = (gym.make_vec(ID, 3, "vector_entry_point", **options) for _ in range(2))
    for batch in (hit, plain):
        batch.reset(seed=4)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, hit.action_space.shape)
    for batch in (hit, plain):
        told = batch.step(actions)[4]
    before = told["q"]
    hit.unwrapped.episodes.world._plant.qvel[lost] = 1e7
    (seen, reward, ended, cut, info), (same, paid, *_) = (batch.step(actions) for batch in (hit, plain))
    others = np.setdiff1d(np.arange(3), lost)
    np.testing.assert_array_equal(seen[others], same[others])
    np.testing.assert_array_equal(reward[others], paid[others])
    assert cut.nonzero()[0].tolist() == lost
    assert not (ended | info["impossible"]).any()
    np.testing.assert_allclose(info["q"][lost], before[lost], atol=1e-12)
    assert np.isfinite(seen).all()
    *_, cut, info = hit.step(actions)
    assert not cut.any()
    np.testing.assert_allclose(info["q"][lost], np.tile(hit.unwrapped.episodes.setup.home, (len(lost), 1)), atol=1e-9)
