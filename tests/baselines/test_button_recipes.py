"""How the button task is learned: the training rewards, the recipes, and the policies of the package."""

import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import benchmarks.learners  # noqa: F401 (registers its recipes)
from kinreach._registration import BUTTON
from kinreach.baselines import SB3VecEnv, evaluate, get_recipe, load_policy, train
from kinreach.baselines import _training as training
from kinreach.baselines._learning_curve import LearningCurve
from kinreach.baselines._models import build
from kinreach.baselines._rewards import BRANCH_ORDER, POSTURE_WEIGHT, REWARDS, SCALE, goal_postures
from kinreach.baselines._sb3_export import actor_network
from kinreach.kinematics import Arm3Kinematics
from tests.baselines.small_runs import weights
from tests.cases import slow

GOAL = np.array([0.45, 0.35, 0.3])


def batch(count, **options):
    return gym.make_vec(BUTTON, num_envs=count, vectorization_mode="vector_entry_point", **options)


def small(name):
    """A recipe that is over after a few hundred steps, in three segments."""
    recipe = get_recipe(name)
    settings = dict(recipe.settings)
    if recipe.algorithm == "DQN":
        settings |= {"learning_starts": 64, "batch_size": 32, "buffer_size": 1000, "target_update_interval": 128}
    else:
        settings |= {"n_steps": 10, "n_epochs": 2}
    options = {**recipe.options, "max_episode_steps": 20}
    return replace(recipe, num_envs=16, steps=480, segments=3, window=80, settings=settings, options=options)


def test_postures_are_of_the_closed_form_and_on_the_first_branch_there_is():
    _, info = batch(500).reset(seed=0)
    goals, kinematics = info["goal"], Arm3Kinematics(base="world")
    q = goal_postures(goals)
    assert q.shape == (500, 3)
    reached = np.array([kinematics.fk(row)[:3, 3] for row in q])
    np.testing.assert_allclose(reached, goals, atol=1e-9)
    assert ((q >= kinematics.lower) & (q <= kinematics.upper)).all()
    taken = np.zeros(4, dtype=int)
    for goal, posture in zip(goals, q, strict=True):
        solutions = kinematics.all_solutions(goal)
        branches = [branch for branch in BRANCH_ORDER if branch in list(solutions.branch)]
        found = list(solutions.branch).index(branches[0])
        np.testing.assert_allclose(posture, solutions.q[found], atol=1e-9)
        taken[branches[0]] += 1
    assert taken[BRANCH_ORDER[0]] > 475
    assert taken[BRANCH_ORDER[1]] > 5
    assert np.isnan(goal_postures(np.array([[3.0, 0, 0]]))).all()


def step_info(q, *, wrong, lately):
    """What a reward needs of two arms in the same posture, the second of which pressed wrongly."""
    observation = np.zeros((2, 19))
    observation[:, :3], observation[:, 3:6], observation[:, 6:9] = np.cos(q), np.sin(q), GOAL
    return {
        "observation": observation,
        "reached_lately": lately,
        "reward_terms": {"wrong_press": np.array([0.0, -1.0 if wrong else 0.0])},
    }


def test_the_guided_reward_has_the_values_that_it_documents():
    own = np.array([-0.5, -1.5])
    goal = goal_postures(GOAL[None])[0]
    for lately, penalty in ((0.0, 0.05), (0.5, 2.5375), (1.0, 10.0)):
        at_goal = REWARDS["guided"](own, step_info(goal, wrong=True, lately=lately))
        np.testing.assert_allclose(at_goal, 0.05 * np.array([-0.5, -0.5 - penalty]), atol=1e-12)
        away = REWARDS["guided"](own, step_info(np.add(goal, [0.3, -0.4, 0.0]), wrong=True, lately=lately))
        np.testing.assert_allclose(away, at_goal - 0.05 * 0.3 * 0.5, atol=1e-12)
    np.testing.assert_array_equal(REWARDS["scaled"](own, {}), 0.05 * own)
    assert (SCALE, POSTURE_WEIGHT) == (0.05, 0.3)


def test_the_learner_sees_the_reward_of_where_the_step_led():
    """Also in the step that ends an episode: there the observation returned is of the next episode already."""
    env = SB3VecEnv(LearningCurve(batch(8, max_episode_steps=7), window=8), reward=REWARDS["guided"])
    single = batch(8, max_episode_steps=7)
    env.seed(3)
    env.reset()
    single.reset(seed=3)
    rng, ends = np.random.default_rng(0), 0
    for step in range(21):
        actions = rng.integers(0, 54, 8)
        _, seen, done, _ = env.step(actions)
        observation, own, _, _, info = single.step(actions)
        if done.any():
            assert done.all()
            ends += 1
            observation = info["final_obs"]
        assert np.array_equal(done, np.full(8, step % 7 == 6))
        q = np.arctan2(observation[:, 3:6], observation[:, :3])
        away = np.linalg.norm(q - goal_postures(observation[:, 6:9]), axis=1)
        expected = own - 0.95 * info["reward_terms"]["wrong_press"] - 0.3 * away  # 0.05 instead of 1
        np.testing.assert_allclose(seen, 0.05 * expected, rtol=1e-5)
    assert ends == 3


def test_the_curve_tells_rewards_how_far_the_training_is():
    env = LearningCurve(batch(4, max_episode_steps=4), window=16)
    env.reset(seed=0)
    assert env.reached_lately == 0.0
    q = goal_postures(np.tile(GOAL, (4, 1)))
    env.reset(options={"goal": np.tile(GOAL, (4, 1)), "q": q})
    shares = [env.step(np.array([40, 40, 13, 13]))[4]["reached_lately"] for _ in range(4)]
    assert shares[:3] == [0.0] * 3
    assert env.rows[0][1] == env.episodes
    assert env.reached_lately == shares[3] == env.rows[0][4] > 0


@pytest.mark.parametrize("name", ["button", "button-dqn"])
@pytest.mark.slow
def test_recipes_train_go_on_and_export_what_they_trained(name, tmp_path):
    recipe = small(name)
    run = train(recipe, tmp_path / "a", seed=1)
    again = train(recipe, tmp_path / "b", seed=1)
    for (weight, bias), (other_weight, other_bias) in zip(
        run.policy.network.layers, again.policy.network.layers, strict=True
    ):
        np.testing.assert_array_equal(weight, other_weight)
        np.testing.assert_array_equal(bias, other_bias)
    assert run.card.meaning == "preferences"
    assert run.card.steps >= 480
    trainee = build(recipe, 3, steps=480)
    trainee.model.learn(320)
    observations = np.concatenate([trainee.env.reset() for _ in range(4)])
    expected, _ = trainee.model.predict(observations, deterministic=True)
    found = actor_network(trainee.model)(observations.astype(float)).argmax(axis=1)
    assert len(observations) == 64
    assert (found == expected).mean() >= 0.98  # ties, in single precision
    json.dumps(recipe.to_dict())


@pytest.mark.parametrize(("name", "size"), [("button-report-controls", 22), ("button-report-frames", 76)])
def test_an_evaluation_observes_what_the_training_did(name, size, tmp_path):
    policy = train(small(name), tmp_path, seed=0).policy
    assert policy.inputs == size
    assert len(evaluate(policy, goals=5, options={"max_episode_steps": 10}).reached) == 5


@pytest.mark.parametrize("name", ["button", "button-dqn-report-actuation"])
@pytest.mark.slow
def test_evaluation_knows_nothing_of_the_training_reward(name, tmp_path):
    """Two policies of equal numbers, one said to be trained with another reward: every figure is the same."""
    run = train(small(name), tmp_path, seed=0)
    first = evaluate(run.policy, goals=20, options={"max_episode_steps": 20})
    rewards = np.zeros(20)
    env = batch(20, max_episode_steps=20)
    observation, _ = env.reset(seed=2**41)
    pending = np.ones(20, dtype=bool)
    for _ in range(20):
        observation, reward, terminated, truncated, info = env.step(run.policy.act(observation))
        np.testing.assert_allclose(reward, sum(info["reward_terms"].values()))
        rewards += np.where(pending, reward, 0.0)
        pending &= ~(terminated | truncated)
    np.testing.assert_allclose(first.measures["return"], rewards)


@pytest.mark.parametrize("name", ["button", *slow("button-report")])
def test_the_policies_of_the_package_press(name):
    policy = load_policy(name, environment=BUTTON)
    found = evaluate(policy, goals=200, options=policy.card.recipe["options"])
    assert found.reached.mean() >= 0.95
    assert found.measures["wrong_presses"].mean() < 1
    assert np.median(found.measures["steps"]) < 40


@pytest.mark.slow
def test_n_step_returns_end_where_a_segment_ends(tmp_path, monkeypatch):
    """The next segment begins with other episodes: nothing of them may follow a row of the last."""
    trainees = []
    monkeypatch.setattr(training, "build", lambda *a, **k: trainees.append(build(*a, **k)) or trainees[0])
    train(small("button-dqn"), tmp_path, seed=2)
    buffer, gamma, most = trainees[0].model.replay_buffer, 0.95, 3
    assert (buffer.pos, buffer.full, buffer.n_steps, buffer.gamma) == (30, False, most, gamma)
    assert not buffer.dones[:30].any()  # segments of 10 steps, episodes of 20
    checked = 0
    for row in range(30):
        found = buffer._get_samples(np.full(64, row))
        last = min(row + most - 1, 10 * (row // 10) + 9)
        for index, observation in enumerate(found.observations.numpy()):
            (env,) = np.flatnonzero((buffer.observations[row] == observation).all(axis=1))
            rewards = buffer.rewards[row : last + 1, env]
            discounts = gamma ** np.arange(len(rewards))
            np.testing.assert_array_equal(found.next_observations[index], buffer.next_observations[last, env])
            assert found.rewards[index, 0] == pytest.approx(rewards @ discounts, abs=1e-5)
            assert found.discounts[index, 0] == pytest.approx(gamma ** len(rewards), rel=1e-6)
            assert found.dones[index, 0] == 0
            checked += 1
    assert checked == 30 * 64


@pytest.mark.parametrize("exploration", [0.1, 0.9])
@pytest.mark.slow
def test_a_dqn_that_was_interrupted_gives_what_no_interruption_gives(exploration, tmp_path):
    """Also where the first action after an interruption is most likely one of chance."""
    recipe = small("button-dqn")
    rates = dict.fromkeys(("exploration_initial_eps", "exploration_final_eps"), exploration)
    recipe = replace(recipe, settings={**recipe.settings, **rates})

    def stop(done, planned, row):
        if done > 320:
            raise KeyboardInterrupt

    train(recipe, tmp_path / "whole", seed=2)
    with pytest.raises(KeyboardInterrupt):
        train(recipe, tmp_path / "cut", seed=2, progress=stop)
    train(recipe, tmp_path / "cut", seed=2, resume=True)
    assert json.loads((tmp_path / "cut/run.json").read_text())["resumed"]
    np.testing.assert_array_equal(*(weights(tmp_path / each / "policy.safetensors") for each in ("whole", "cut")))
    assert (tmp_path / "cut/curve.csv").read_text() == (tmp_path / "whole/curve.csv").read_text()
