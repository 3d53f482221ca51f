"""Goal environments: rewards computed from goals are those of steps, in every kind of batch, and HER replays them."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import kinreach  # noqa: F401 (registers the environments)
from kinreach.errors import InputError
from tests.cases import slow

REACH, PLANE, SINGLE, LIFT = (
    f"kinreach/{name}-v0" for name in ("Reach", "UR5MultiStep", "UR5SingleStep", "Lift")
)  # fmt: skip
SPACE = {"tilt": 30.0}
FORMS = {
    "reach": (REACH, {"backend": "kinematic", "steps": "multi", "end_on_reached": False, **SPACE}),
    "reach, single step": (REACH, {"backend": "kinematic", **SPACE}),
    "reach, dynamics": (REACH, {"steps": "multi", **SPACE}),
    "plane": (PLANE, {"backend": "kinematic"}),
    "plane, dynamics": (PLANE, {"end_on_reached": False}),
    "plane, single step": (SINGLE, {"backend": "kinematic"}),
    "another arm": (PLANE, {"backend": "kinematic", "arm": "arm3"}),
    "lift": (LIFT, {"attempts": 2}),
    "lift, by geometry": (LIFT, {"backend": "kinematic"}),
    "lift, small steps": (LIFT, {"steps": "multi", "max_episode_steps": 40}),
}
REWARDS = ("dense", "sparse")
#: Where steps return the same. No simulation diverges here, and the limit of steps is Gymnasium's.
METHODS = {"compute_reward": 1, "compute_terminated": 2, "compute_truncated": 3}
MODES = ["sync", "async", "vector_entry_point"]


def single(form, **more):
    name, options = FORMS[form]
    return gym.make(name, disable_env_checker=True, goal_env=True, **options, **more)


def batch(form, count, mode="vector_entry_point", **more):
    name, options = FORMS[form]
    return gym.make_vec(name, num_envs=count, vectorization_mode=mode, goal_env=True, **options, **more)


def starts(form, env, rng):
    """Options of `reset` that begin half of the episodes near their goals, and actions that reach them."""
    count = env.num_envs
    task = env.unwrapped.episodes.task
    if form.startswith("lift"):
        return {}, [scripted(task, place, rng) for place in env.unwrapped.episodes.goals]
    lower, upper = -0.3, 0.3
    if task.judges_posture:  # turn the shoulder only: the posture stays as natural as it was
        lower, upper = (np.array([x, 0, 0, 0, 0, 0.0]) for x in (-0.3, 0.0))
    q = task.home + rng.uniform(lower, upper, (count, len(task.home)))
    goals = task.kinematics.positions(q) + rng.uniform(-0.006, 0.006, (count, 3))
    options = {"goal": goals}
    if task.directed:
        options |= {"direction": task.axes(q)}
    if task.variant.relative:
        return options | {"q": np.where(rng.random((count, 1)) < 0.7, q, task.home)}, None
    return options, (q - task._middle) / task._half


def scripted(task, place, rng):
    kin = task.kinematics
    grasp = kin.axis_goal(place, [0, 0, -1], seed=task.home).q
    return task.action_for(grasp, 0.04)


def agreeing(form, reward, wanted, count=64):
    """How many transitions agree, and how many of them reach their goals and are impossible."""
    env, rng = batch(form, count, reward=reward, autoreset_mode="Disabled"), np.random.default_rng(5)
    env.action_space.seed(6)
    task = env.unwrapped
    found = reached = impossible = 0
    while found < wanted:
        if form.startswith("lift"):
            env.reset(seed=found)
        options, known = starts(form, env, rng)
        env.reset(seed=found, options=options)
        scale, ahead = rng.choice([0.02, 0.3, 1.0], (count, 1)), env.action_space.sample()
        for _ in range(20):
            actions = scale * np.where(scale == 1.0, np.sign(ahead), env.action_space.sample())  # some far, into things
            if known is not None:
                actions = np.where(rng.random((count, 1)) < 0.7, known, actions)
            seen, *stepped, info = env.step(actions)
            goals = seen["achieved_goal"], seen["desired_goal"]
            for method, at in METHODS.items():
                said = getattr(task, method)(*goals, info)
                assert said.shape == (count,)
                np.testing.assert_array_equal(said, stepped[at - 1])
            assert (np.isin(stepped[0], [0.0, -1.0]) | (reward != "sparse")).all()
            found, reached = found + count, reached + info["is_success"].sum()
            impossible += info["impossible"].sum()
            over = stepped[1] | stepped[2]
            if over.all():
                break
            if over.any():
                env.reset(options={"reset_mask": over})
    env.close()
    return found, reached, impossible


@pytest.mark.parametrize("reward", REWARDS)
@pytest.mark.parametrize("form", [name for name in FORMS if name != "lift"] + slow("lift"))
def test_rewards_of_goals_are_those_of_steps(form, reward):
    count = 16 if form in ("lift", "lift, small steps") or "dynamics" in form else 64
    found, reached, impossible = agreeing(form, reward, 10 * count, count)
    assert found >= 10 * count
    assert reached or form == "lift, small steps"
    assert impossible or form == "lift, small steps"


@pytest.mark.slow
@pytest.mark.parametrize("reward", REWARDS)
@pytest.mark.parametrize(("form", "steps"), [("reach", 100_000), ("plane", 100_000), ("lift, by geometry", 15_000)])
def test_rewards_of_goals_are_those_of_many_steps(form, steps, reward):
    found, reached, impossible = agreeing(form, reward, steps, 500)
    assert found >= steps
    assert reached > steps / 100
    assert impossible > steps / 100


@pytest.mark.parametrize("form", ["reach", "plane, single step", "lift, by geometry"])
@pytest.mark.slow
def test_single_environments_and_batches_are_the_same(form):
    count, compared = 2, 0
    rows, scores = {}, {}
    for mode in MODES:
        same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
        how = same_step if mode == "vector_entry_point" else {"vector_kwargs": same_step}
        env = batch(form, count, mode, reward="sparse", **how)
        env.action_space.seed(0)
        seen = [env.reset(seed=3)[0]]
        answers = []
        for _ in range(4):
            observation, reward, *_ = env.step(env.action_space.sample())
            seen.append(observation)
            answers.append(reward)
        rows[mode], scores[mode] = seen, answers
        env.close()
    for mode in MODES[1:]:
        np.testing.assert_array_equal(scores[mode], scores["sync"])
        for one, other in zip(rows[mode], rows["sync"], strict=True):
            assert one.keys() == other.keys() == {"observation", "achieved_goal", "desired_goal"}
            for name in one:
                np.testing.assert_allclose(one[name], other[name], rtol=0, atol=1e-9)
                compared += 1
    assert compared == 30


@pytest.mark.parametrize("form", FORMS)
def test_what_was_achieved_is_reached_where_it_was_desired(form):
    env, checked = batch(form, 16, reward="sparse", autoreset_mode="Disabled"), 0
    env.action_space.seed(1)
    env.reset(seed=0)
    seen, *_ = env.step(env.action_space.sample())
    achieved, compute = seen["achieved_goal"], env.unwrapped.compute_reward
    np.testing.assert_array_equal(compute(achieved, achieved, {}), 0.0)
    np.testing.assert_array_equal(compute(achieved, achieved, [{}] * 16), 0.0)
    far = achieved + 0.06
    np.testing.assert_array_equal(compute(achieved, far, {}), -1.0)
    for row, goal in zip(achieved, far, strict=True):
        assert compute(row, row, {}) == 0.0
        assert compute(row, goal, {}) == -1.0
        checked += 1
    assert checked == 16


def test_a_reward_function_gets_postures_from_info():
    def reward(distance, q, impossible):
        return -distance - np.abs(q).sum(axis=1), {"distance": -distance, "joints": -np.abs(q).sum(axis=1)}

    env, compared = single("plane", reward=reward).unwrapped, 0
    env.action_space.seed(0)
    env.reset(seed=0)
    for _ in range(10):
        seen, paid, *_, info = env.step(env.action_space.sample())
        goals = seen["achieved_goal"], seen["desired_goal"]
        assert env.compute_reward(*goals, info) == paid
        assert env.compute_reward(*goals, info | {"q": info["q"] + 0.1}) != paid
        compared += 1
    assert compared == 10
    with pytest.raises(InputError, match=r"depends on info\['q'\].*copy_info_dict=True"):
        env.compute_reward(*goals, {})


@pytest.mark.parametrize("name", [REACH, PLANE, LIFT])
def test_without_the_option_there_are_no_goals(name):
    """Other people's code asks whether there is `compute_reward`."""
    for env in (gym.make(name).unwrapped, gym.make_vec(name, 2, "vector_entry_point").unwrapped):
        assert not any(hasattr(env, method) for method in METHODS)
        with pytest.raises(AttributeError, match="goal_env=True"):
            _ = env.compute_reward


def test_what_does_not_fit_is_refused():
    for options, said in (
        ({"observation": "camera"}, "use observation=\"geometric\", got 'camera'"),
        ({"goal_in": "image"}, 'use goal_in="camera"'),
        ({"reward": "sprase"}, "reward must be 'dense', 'sparse', or a callable"),
    ):
        with pytest.raises(InputError, match=said):
            gym.make(REACH, goal_env=True, **options)
    env = single("reach").unwrapped
    with pytest.raises(InputError, match="a view is of the goal block"):
        env.reset(options={"view": np.zeros(6)})
    for goals, info, said in (
        ((np.zeros(6), np.zeros(5)), {}, r"desired_goal must have shape \(6,\), or \(k, 6\) as both, got \(5,\)"),
        ((np.zeros((2, 6)), np.zeros((3, 6))), {}, r"desired_goal must have shape"),
        ((np.zeros((2, 6)), np.zeros((2, 6))), [{}], "info must be a dictionary, or one for each of 2 goals"),
        ((np.zeros((2, 6)), np.zeros((2, 6))), {"impossible": True}, r"info\['impossible'\] must have 2 rows"),
        ((np.zeros(6), np.zeros(6)), 3, "info must be a dictionary, got 3"),
    ):
        with pytest.raises(InputError, match=said):
            env.compute_reward(*goals, info)


def test_copies_and_tensors_keep_goals():
    torch = pytest.importorskip("torch")
    env = single("reach", reward="sparse")
    env.reset(seed=1)
    env.action_space.seed(1)
    env.step(env.action_space.sample())
    twin, action = copy.deepcopy(env), env.action_space.sample()
    one, other = (each.step(action)[0] for each in (env, twin))
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])
    many = batch("reach", 4, device="cpu")
    many.reset(seed=0)
    seen, rewards, *_, info = many.step(torch.zeros(4, 6))
    said = many.unwrapped.compute_reward(seen["achieved_goal"], seen["desired_goal"], info)
    assert isinstance(said, torch.Tensor)
    assert torch.equal(said, rewards)


@pytest.mark.parametrize(("reward", "form"), [("sparse", "reach"), ("dense", "plane"), ("dense", "lift, by geometry")])
def test_hindsight_of_stable_baselines3_replays_native_batches(reward, form):
    """With `copy_info_dict` also rewards that depend on `info`."""
    sb3 = pytest.importorskip("stable_baselines3")
    from kinreach.baselines import SB3VecEnv

    env = SB3VecEnv(batch(form, 4, reward=reward, max_episode_steps=10))
    model = sb3.SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=sb3.HerReplayBuffer,
        replay_buffer_kwargs={"copy_info_dict": reward == "dense"},
        buffer_size=400,
        learning_starts=100,
        batch_size=32,
        policy_kwargs={"net_arch": [16]},
        seed=0,
    )
    model.learn(160)
    rewards = model.replay_buffer.sample(256).rewards.numpy()
    assert np.isfinite(rewards).all()
    if reward == "sparse":
        assert set(np.unique(rewards)) == {-1.0, 0.0}
    with pytest.raises(InputError, match="no methods of their own, such as close"):
        env.env_method("close")
